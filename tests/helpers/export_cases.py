import atexit
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example, lump, random_friction, random_inertia, random_tree

import pinfric as pf
from pinfric.dynamics.forward.compensation import CompensationOptions
from pinfric.exporting.cpp import Bounds, cpp_files, header_name


def moved(scene, speed=5.0, samples=200):
    """A motion of every joint to and fro, each at its own frequency, with a second at rest."""
    t = np.linspace(0.0, 3.0, samples)
    w = speed * (1.0 + 0.37 * np.arange(scene.model.nv))
    phase = w * np.clip(t[:, None] - 1.0, 0.0, None)
    v, a = np.sin(phase), w * np.cos(phase) * (t[:, None] > 1.0)
    still = t <= 1.0
    q = np.where(still[:, None], 0.0, (1.0 - np.cos(phase)) / w)
    return pf.Trajectory.from_arrays(scene, t, q, v, a)


COMPILER = shutil.which("g++") or shutil.which("clang++") or shutil.which("c++")


needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler (g++, clang++, c++)")


STRICT = [
    *("-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion"),
    *("-Wsign-conversion", "-Wold-style-cast", "-fno-exceptions", "-fno-rtti"),
]


DRIVER = Path(__file__).parents[1] / "exporting" / "compensator_driver.cpp"


BUNDLED = ("ur10_machine_tending", "ur5_pick_and_place", "panda_pick_and_place", "so101")


WHOLE = CompensationOptions()


def rich(seed, couples=False, mimic=False):
    """A branched tree with every kind of friction and gear that a compensator takes."""
    rng, model = np.random.default_rng(seed), random_tree(seed, 6, sliding=0.3)
    model.armature = rng.uniform(0.0, 0.3, model.nv)
    names = list(model.names)[1:]
    friction = random_friction(model, seed)
    if mimic:
        leader = next(j for j in (1, 2, 3) if model.joints[j].nq == 1)
        follower = next(j for j in (6, 5, 4) if model.joints[j].nq == 1)
        model = pin.transformJointIntoMimic(model, leader, follower, -0.7, 0.1)
        names = [n for n in names if n != model.names[follower]]
    friction[names[0]]["viscous"] = {"coefficient": 0.4, "exponent": 0.6}
    friction.pop(names[1])  # a joint without friction
    last = model.joints[model.getJointId(names[-1])]
    if not mimic and not last.shortname().startswith("JointModelP"):  # its drive loses nothing
        friction[names[-1]]["bearing"] = {"kind": "gear"}
    actuators = [{"joint": name, "transmission": _gear(rng, k)} for k, name in enumerate(names)]
    if couples:
        actuators[1]["couples"] = {names[0]: float(rng.normal())}
        actuators[3]["couples"] = {names[2]: float(rng.normal()), names[1]: 0.7}
    kind = f"rich_{seed}" + "_coupled" * couples + "_mimic" * mimic
    return pf.Scene(model, friction=friction, actuators=actuators, source=f"{kind}.yaml")


def _gear(rng, k):
    """Ideal, one number, self-locking, a maker's curve over the load, one over the speed."""
    ratio = float(rng.choice([-1, 1]) * rng.uniform(20, 100))
    directed = {
        "positive": {"static": 0.02, "kinetic": 0.01},
        "negative": {"static": 0.03, "kinetic": 0.03},
    }
    return [
        None,
        {
            "ratio": ratio,
            "efficiency": 0.8,
            "back_efficiency": 0.7,
            "no_load_torque": directed,
            "motor_viscous": {"coefficient": 0.003, "exponent": 0.7},
            "rotor_inertia": 2e-4,
        },
        {"ratio": ratio, "efficiency": 0.4, "back_efficiency": -0.4, "no_load_torque": 0.02},
        {
            "ratio": ratio,
            "efficiency": {"over_load": [[8, 0.52], [20, 0.70], [34, 0.78]]},
            "back_efficiency": "same_loss",
        },
        {
            "ratio": ratio,
            "back_efficiency": 0.6,
            "efficiency": {"load": 30.0, "over_speed": [[10.0, 0.8], [40.0, 0.75], [100.0, 0.68]]},
        },
        {"ratio": ratio, "rotor_inertia": 1e-4},
    ][k % 6]


def with_ways(scene, way, shape="sharp"):
    """The scene with a way at each joint that may have one, and at coupled drives."""
    key = {"way": way, "shape": shape}
    followers = {n for n, j in zip(scene.model.names, scene.model.joints, strict=True) if not j.nv}
    followers |= {
        n
        for n, j in zip(scene.model.names, scene.model.joints, strict=True)
        if j.shortname() == "JointModelMimic"
    }
    friction = {
        name: entry.model_dump(exclude_defaults=True)
        | ({} if name in followers else {"presliding": key})
        for name, entry in scene.friction.items()
    }
    named = {other for a in scene.actuators or () for other in a.couples}
    drives = [a.model_dump(exclude_defaults=True) for a in scene.actuators or ()]
    for drive in drives:
        coupled = "couples" in drive or drive["joint"] in named
        if drive.get("transmission") and (coupled or drive["joint"] not in friction):
            drive["transmission"]["presliding"] = key
    return scene.with_(friction=friction, actuators=drives or None)


def planar():
    """A joint of three degrees, which nothing exports."""
    model = chain(("skates", pin.JointModelPlanar(), pin.Inertia.Random()))
    return pf.Scene(model=model)


def worm():
    """A self-locking hinge with friction about as large as its weight, which drives it."""
    body = lump(1.0, [0.6, 0.0, 0.0], 0.1)
    gear = {"ratio": 40.0, "efficiency": 0.5, "back_efficiency": -0.6}
    friction = {"hinge": dry(5.0)}
    actuators = [{"joint": "hinge", "transmission": gear}]
    model = chain(("hinge", pin.JointModelRY(), body))
    return pf.Scene(model, friction=friction, actuators=actuators, source="worm.yaml")


def geared(efficiency, back, rotor):
    """A weight on a hinge behind a gear: a weak one, or one that jams with a light rotor."""
    gear = {"ratio": 50.0, "efficiency": efficiency, "back_efficiency": back}
    model = chain(("hinge", pin.JointModelRY(), lump(5.0, [0.3, 0.0, 0.0], 0.1)))
    model.addBodyFrame("bar", 1, pin.SE3.Identity(), 0)
    drives = [{"joint": "hinge", "transmission": gear | {"rotor_inertia": rotor}}]
    friction = {"hinge": dry(1.0, 0.8)}
    return pf.Scene(model, friction=friction, actuators=drives, source="geared.yaml")


RICH = [
    *(rich(seed) for seed in range(4)),
    rich(4, mimic=True),
    rich(6, mimic=True),
    rich(7, couples=True),
    rich(8, couples=True),
]


#: The same, whose friction builds up over 5 mrad (mm).
BUILDING = [
    with_ways(scene, 5e-3).with_(source=f"building_{scene.source}") for scene in (RICH[1], RICH[4])
]


def configurations(scene, q):
    """Pinocchio's q of one number per freedom."""
    columns = []
    for joint in list(scene.model.joints)[1:]:
        if joint.nq == 1:
            columns.append(q[:, joint.idx_v])
        elif joint.nq == 2:
            columns += [np.cos(q[:, joint.idx_v]), np.sin(q[:, joint.idx_v])]
    return np.column_stack(columns)


def sampled(scene, seed, count=300):
    """States fast and slow, a third of the joints at rest, some below the stick velocity."""
    rng, nv = np.random.default_rng(seed), scene.model.nv
    q, v, a = (rng.normal(scale=scale, size=(count, nv)) for scale in (1.5, 1.0, 3.0))
    v[rng.random(v.shape) < 0.3] = 0.0
    creeping = rng.random(v.shape) < 0.1
    v[creeping] = rng.uniform(-1.0, 1.0, creeping.sum()) * 1e-6
    return q, v, a


def header(scene, frames=(), bounds=None):
    """The header of a scene, without limits by default."""
    bounds = bounds or Bounds.none(len(scene.drives))
    return cpp_files(scene, frames, bounds, [], ["a test"]).header


class Headers:
    """Several compensators in one program.

    Args:
        scenes: each with another source.
        flags: beside STRICT.
        edit: changes a header's text.
    """

    def __init__(self, folder, scenes, flags=("-O2",), edit=lambda text: text):
        self.folder, names = folder, [header_name(scene.source) for scene in scenes]
        for scene, name in zip(scenes, names, strict=True):
            text = edit(header(scene, getattr(scene, "frames_wanted", ())))
            (folder / f"{name}.hpp").write_text(text)
        includes = "\n".join(f'#include "{name}.hpp"' for name in names)
        calls = "\n  ".join(
            f'if (!std::strcmp(arguments[1], "{name}"))\n    good = good && answer<{name}::Robot, '
            f"{name}::Compensator, {name}::Options, {name}::InverseInstant, {name}::State, "
            f"{name}::Freedoms, {name}::Drives, "
            f"{name}::View<double, {name}::Robot::freedoms>>(in, out);"
            for name in names
        )
        text = DRIVER.read_text().replace("// @@INCLUDES", includes).replace("// @@SCENES", calls)
        (folder / "driver.cpp").write_text(text)
        compiled(folder / "driver.cpp", folder / "driver", *flags)

    def ask(
        self,
        scene,
        q,
        v,
        a,
        v_ref=None,
        *,
        error=None,
        v_now=None,
        options=WHOLE,
        joint_effort_limit=np.inf,
        payloads=(),
        wrenches=(),
        **more,
    ):
        """Named columns of the compensator's results at each state.

        Args:
            q, v, a, v_ref, error, v_now: (n, nv), one number per freedom; v_ref by default v.
            more: q_ref (n, nv), by default q.
            payloads: (frame, mass, com, inertia). wrenches: (frame, wrench).
        """
        nv, na, ns = scene.model.nv, len(scene.drives), len(scene.sites)
        given = [q, v, a, v if v_ref is None else v_ref, error, v_now]
        given.append(more.get("q_ref", q))
        rows = [np.zeros_like(q) if x is None else x for x in given]
        settings = np.vstack([options.table(scene), np.broadcast_to(joint_effort_limit, na)])
        rows.append(np.broadcast_to(settings.ravel(), (len(q), 10 * na)))
        counts = [len(payloads), len(wrenches), len(q), *(x is not None for x in (v, error, v_now))]
        flat = [np.array(counts, dtype=float)]
        flat += [np.hstack([frame, mass, com, inertia]) for frame, mass, com, inertia in payloads]
        flat += [np.hstack([frame, wrench]) for frame, wrench in wrenches]
        np.concatenate([*flat, np.hstack(rows).ravel()]).astype(float).tofile(self.folder / "in")
        command = [
            self.folder / "driver",
            header_name(scene.source),
            self.folder / "in",
            self.folder / "out",
        ]
        subprocess.run(command, check=True, timeout=60)
        widths = {
            "good": 7,
            "rigid_body": nv,
            "friction": na,
            "friction_measured": na,
            "limited": na,
            "feed_forward": na,
            "joint_effort": na,
            "effort_frictionless": na,
            "effort_lower": na,
            "effort_upper": na,
            "joint_effort_lower": na,
            "joint_effort_upper": na,
            "motor_torque_lower": na,
            "motor_torque_upper": na,
            "normal_load": ns,
            "friction_lower": ns,
            "friction_upper": ns,
            "sticking": ns,
            "wrench": 6 * ns,
        }
        found = np.fromfile(self.folder / "out").reshape(len(q), sum(widths.values()))
        parts = np.split(found, np.cumsum(list(widths.values()))[:-1], axis=1)
        return dict(zip(widths, parts, strict=True))


def compiled(source, program, *flags):
    command = [COMPILER, *STRICT, *flags, "-I", source.parent, source, "-o", program]
    made = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert made.returncode == 0, made.stderr[:2000]


def assert_columns(found, expected, name, tolerance=1e-12):
    """Assert each column to that part of its peak; one that is 0 but for rounding to 1e-12."""
    peak = np.abs(expected).max(axis=0, initial=0.0)
    scale = np.maximum(peak, 1e-2 * peak.max(initial=0.0) + 1e-6)
    worst = (np.abs(found - expected) / scale).max(initial=0.0)
    assert worst <= tolerance, (name, worst)


SETTINGS = [
    WHOLE,
    CompensationOptions(scale=0.8, viscous_scale=0.7, measured_scale=0.6),
    CompensationOptions(scale=0.9, hold_error=0.01, hold_velocity=0.5, limit=3.0),
    CompensationOptions(scale=1.3, hold_error=0.02, hold_velocity=0.3, power=0.01),
]


def loadable():
    """A rich tree whose last joint's link may carry a payload."""
    scene = rich(2)
    model = scene.model.copy()
    for joint in range(1, model.njoints):
        placement = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.5 * joint])), np.array([0.1, 0.2, 0.0]))
        model.addFrame(pin.Frame(f"link_{joint}", joint, placement, pin.FrameType.BODY))
    inertia = random_inertia(np.random.default_rng(7))
    rows = inertia.inertia[np.triu_indices(3)].tolist()
    tool = {
        "link": "link_5",
        "mass": inertia.mass,
        "com": inertia.lever.tolist(),
        "inertia": rows,
        "attached": False,
    }
    return scene.with_(model=model, payloads={"tool": tool}, source="loadable.yaml")


@cache
def exported_ur5():
    """The arm, its motion, their export, and inverse dynamics."""
    scene, motion = example("ur5_pick_and_place", "ur5_pick_and_place.csv")
    return scene, motion, pf.export(scene, motion), pf.inverse_dynamics(scene, motion)


@cache
def compiled_headers(optimized: str) -> Headers:
    """The headers of all scenes, compiled once per process."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    scenes = [worm(), *RICH, *BUILDING, *map(pf.load_scene, BUNDLED), loadable()]
    return Headers(Path(folder.name), scenes, (optimized,))
