"""The C++ compensator, compiled: it is inverse dynamics, passive, and refused by name."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, random_friction, random_inertia, random_tree
from cases import drawer_scene
from envelopes import result_of
from mechanisms import four_bar

import pinfric as pf
from pinfric.cli import main
from pinfric.dynamics.forward.compensation import CompensationOptions
from pinfric.errors import PinfricError
from pinfric.model.couples import rate_rows
from pinfric.show.report.export import export_report
from pinfric.study.export.controller import compensation
from pinfric.study.export.cpp import cpp_files, default_frames, namespace
from pinfric.study.trajectory.joint_columns import single_positions

COMPILER = shutil.which("g++") or shutil.which("clang++") or shutil.which("c++")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler (g++, clang++, c++)")
STRICT = [
    *("-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion"),
    *("-Wsign-conversion", "-Wold-style-cast", "-fno-exceptions", "-fno-rtti"),
]
DRIVER = Path(__file__).with_name("compensator_driver.cpp")
BUNDLED = ("ur10_machine_tending", "ur5_pick_and_place", "panda_pick_and_place", "so101")
WHOLE = CompensationOptions(scale=1.0, viscous_scale=1.0)


# ---------------------------------------------------------------- scenes


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


def worm():
    """A self-locking hinge whose friction is about as large as its weight, which drives it."""
    body = pin.Inertia(1.0, np.array([0.6, 0.0, 0.0]), 0.1 * np.eye(3))
    gear = {"ratio": 40.0, "efficiency": 0.5, "back_efficiency": -0.6}
    friction = {"hinge": {"coulomb": {"static": 5.0, "kinetic": 5.0}}}
    actuators = [{"joint": "hinge", "transmission": gear}]
    model = chain(("hinge", pin.JointModelRY(), body))
    return pf.Scene(model, friction=friction, actuators=actuators, source="worm.yaml")


RICH = [
    *(rich(seed) for seed in range(4)),
    rich(4, mimic=True),
    rich(6, mimic=True),
    rich(7, couples=True),
    rich(8, couples=True),
]


def positions(scene, q):
    return single_positions(q, [joint.nq for joint in list(scene.model.joints)[1:] if joint.nq])


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


# ---------------------------------------------------------------- the compiled headers


def header(scene, frames=()):
    """The header of a scene without limits."""
    return cpp_files(scene, frames, [np.inf] * len(scene.drives), [], ["a test"]).header


class Headers:
    """Several compensators in one program.

    Args:
        folder: where it is made.
        scenes: each with another source.
        flags: beside STRICT.
        edit: changes a header's text.
    """

    def __init__(self, folder, scenes, flags=("-O2",), edit=lambda text: text):
        self.folder, names = folder, [namespace(scene.source) for scene in scenes]
        for scene, name in zip(scenes, names, strict=True):
            text = edit(header(scene, getattr(scene, "frames_wanted", ())))
            (folder / f"{name}.hpp").write_text(text)
        includes = "\n".join(f'#include "{name}.hpp"' for name in names)
        calls = "\n  ".join(
            f'if (!std::strcmp(arguments[1], "{name}"))\n    good = good && answer<{name}::Robot, '
            f"{name}::Compensator, {name}::Options, {name}::Instant>(in, out);"
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
        payloads=(),
        wrenches=(),
    ):
        """Named columns of what the compensator says of each state.

        Args:
            q: (n, nv), one number per freedom. v, a: (n, nv) or None, None.
            v_ref, error, v_now: (n, nv); v_ref by default v.
            payloads: (frame, mass, com, inertia). wrenches: (frame, wrench).
        """
        nv, na, ns = scene.model.nv, len(scene.drives), len(scene.sites)
        given = [q, v, a, v if v_ref is None else v_ref, error, v_now]
        rows = [np.zeros_like(q) if x is None else x for x in given]
        rows.append(np.broadcast_to(options.table(scene).ravel(), (len(q), 6 * na)))
        counts = [len(payloads), len(wrenches), len(q), *(x is not None for x in (v, error, v_now))]
        flat = [np.array(counts, dtype=float)]
        flat += [np.hstack([frame, mass, com, inertia]) for frame, mass, com, inertia in payloads]
        flat += [np.hstack([frame, wrench]) for frame, wrench in wrenches]
        np.concatenate([*flat, np.hstack(rows).ravel()]).astype(float).tofile(self.folder / "in")
        command = [
            self.folder / "driver",
            namespace(scene.source),
            self.folder / "in",
            self.folder / "out",
        ]
        subprocess.run(command, check=True, timeout=60)
        widths = {
            "good": 5,
            "rigid_body": nv,
            "friction": na,
            "feed_forward": na,
            "effort_frictionless": na,
            "effort_lower": na,
            "effort_upper": na,
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


def bundled(name):
    scene = pf.load_scene(name)
    return scene


@pytest.fixture(scope="module")
def headers(tmp_path_factory):
    if COMPILER is None:
        pytest.skip("no C++ compiler (g++, clang++, c++)")
    scenes = [worm(), *RICH, *(bundled(name) for name in BUNDLED), loadable()]
    return Headers(tmp_path_factory.mktemp("cpp"), scenes)


def assert_columns(found, expected, name, tolerance=1e-12):
    """Each column to within that part of its peak; a column that is 0 but for rounding to 1e-12."""
    peak = np.abs(expected).max(axis=0, initial=0.0)
    scale = np.maximum(peak, 1e-2 * peak.max(initial=0.0) + 1e-6)
    worst = (np.abs(found - expected) / scale).max(initial=0.0)
    assert worst <= tolerance, (name, worst)


COMPARED = (
    "effort_frictionless",
    "effort_lower",
    "effort_upper",
    "motor_torque_lower",
    "motor_torque_upper",
    "normal_load",
    "friction_lower",
    "friction_upper",
)


def assert_is_inverse(found, result):
    assert (found["good"] == 1.0).all()
    for name in COMPARED:
        assert_columns(found[name], getattr(result, name), name)
    np.testing.assert_array_equal(found["sticking"] == 1.0, result.sticking)
    if result.wrench is not None:
        assert_columns(found["wrench"], result.wrench.reshape(len(found["wrench"]), -1), "wrench")


@pytest.mark.parametrize("scene", RICH, ids=lambda scene: scene.source)
def test_it_is_inverse_dynamics(headers, scene):
    q, v, a = sampled(scene, 1)
    result = pf.inverse_dynamics(scene, configurations(scene, q), v, a)
    assert_is_inverse(headers.ask(scene, q, v, a), result)


@pytest.mark.parametrize("name", BUNDLED)
def test_it_is_inverse_dynamics_of_bundled_arms(headers, name):
    scene = bundled(name)
    q, v, a = sampled(scene, 2, 2000)
    result = pf.inverse_dynamics(scene, configurations(scene, q), v, a)
    assert_is_inverse(headers.ask(scene, q, v, a), result)


@pytest.mark.parametrize("name", BUNDLED)
def test_it_is_inverse_dynamics_along_trajectories(headers, name):
    scene = bundled(name)
    motion = pf.load_trajectory(f"{name}.csv" if "pick" in name else name, scene)
    q = motion.joint_positions()
    result = pf.inverse_dynamics(scene, motion.q, motion.v, motion.a)
    found = headers.ask(scene, q, motion.v, motion.a)
    assert_is_inverse(found, result)
    lower, upper = result.motor_torque_lower, result.motor_torque_upper
    still, scale = lower < upper, 1e-12 * np.abs(upper).max()
    assert still.any()
    assert (found["feed_forward"] >= lower - scale)[still].all()  # at rest inside the interval
    assert (found["feed_forward"] <= upper + scale)[still].all()


@pytest.mark.parametrize("scene", [*RICH, bundled(BUNDLED[0])], ids=lambda scene: scene.source)
def test_feed_forward_outside_the_band_is_the_torque_that_the_motion_takes(headers, scene):
    q, _, a = sampled(scene, 3)
    rng = np.random.default_rng(3)
    v = rng.choice([-1.0, 1.0], a.shape) * rng.uniform(0.3, 2.0, a.shape)
    options = CompensationOptions(scale=1.0, viscous_scale=1.0, switch_velocity=1e-3)
    found = headers.ask(scene, q, v, a, options=options)
    result = pf.inverse_dynamics(scene, configurations(scene, q), v, a)
    assert_columns(found["feed_forward"], result.motor_torque_lower, "feed-forward")


# ---------------------------------------------------------------- the same law in Python


SETTINGS = [
    WHOLE,
    CompensationOptions(),
    CompensationOptions(scale=0.9, hold_error=0.01, switch_velocity=0.5, limit=3.0),
    CompensationOptions(scale=1.3, hold_error=0.02, switch_velocity=0.3, power=0.01),
]


@pytest.mark.parametrize("options", SETTINGS, ids=range(len(SETTINGS)))
@pytest.mark.parametrize("scene", RICH[2:], ids=lambda scene: scene.source)
def test_the_solver_compensates_as_the_header(headers, scene, options):
    q, v, a = sampled(scene, 4, 40)
    rng = np.random.default_rng(4)
    v_ref, v_now = v + rng.normal(scale=0.1, size=v.shape), v + rng.normal(scale=0.1, size=v.shape)
    error = rng.normal(scale=0.01, size=v.shape)
    solver, full = scene.solver(), configurations(scene, q)
    for moving in (True, False):
        state = (v, a) if moving else (None, None)
        found = headers.ask(scene, q, *state, v_ref, error=error, v_now=v_now, options=options)
        expected = [
            solver.compensate(
                full[i],
                *(x[i] if moving else None for x in (v, a)),
                v_ref[i],
                error=error[i],
                v_now=v_now[i],
                options=options,
            )
            for i in range(len(q))
        ]
        assert_columns(found["friction"], np.array(expected), "friction")


# ---------------------------------------------------------------- payload and wrench


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


def test_payload_and_wrench_at_run_time(headers):
    scene, frames = loadable(), default_frames(loadable())
    tool, (q, v, a) = scene.payloads["tool"], sampled(loadable(), 5, 100)
    place, full = frames.index("link_5"), configurations(loadable(), q)
    wrench = np.array([3.0, -20.0, 8.0, 1.0, 0.3, -2.0])
    carried = headers.ask(
        scene,
        q,
        v,
        a,
        payloads=[(place, tool.mass, tool.com, tool.inertia)],
        wrenches=[(place, wrench)],
    )
    attached = np.ones((len(q), 1), dtype=bool)
    result = pf.inverse_dynamics(scene, full, v, a, attached=attached, external={"link_5": wrench})
    assert_is_inverse(carried, result)
    free = pf.inverse_dynamics(scene, full, v, a)
    assert np.abs(result.normal_load - free.normal_load).max() > 1.0
    solver = scene.solver(["tool"])
    for i in range(20):
        found = solver.compensate(
            full[i], v[i], a[i], v[i], options=WHOLE, external={"link_5": wrench}
        )
        np.testing.assert_allclose(found, carried["friction"][i], rtol=1e-10, atol=1e-10)


def test_a_wrench_is_replaced_and_a_payload_added(headers):
    scene = loadable()
    tool, (q, v, a) = scene.payloads["tool"], sampled(scene, 6, 10)
    push = np.array([3.0, -20.0, 8.0, 1.0, 0.3, -2.0])
    place = default_frames(scene).index("link_5")
    plain = headers.ask(scene, q, v, a)
    again = headers.ask(scene, q, v, a, wrenches=[(place, push), (place, 0.0 * push)])
    np.testing.assert_array_equal(plain["effort_lower"], again["effort_lower"])
    half = place, 0.5 * tool.mass, tool.com, 0.5 * np.array(tool.inertia)
    whole = place, tool.mass, tool.com, tool.inertia
    twice, once = (headers.ask(scene, q, v, a, payloads=p) for p in ([half, half], [whole]))
    assert_columns(twice["effort_lower"], once["effort_lower"], "payload")


@pytest.mark.parametrize(
    "payload",
    [
        (-1, 1.0, [0, 0, 0], [0] * 6),
        (99, 1.0, [0, 0, 0], [0] * 6),
        (0, -1.0, [0, 0, 0], [0] * 6),
        (0, np.nan, [0, 0, 0], [0] * 6),
        (0, 1.0, [0, np.inf, 0], [0] * 6),
    ],
)
def test_payloads_that_cannot_be_are_refused_and_change_nothing(headers, payload):
    scene = loadable()
    q, v, a = sampled(scene, 6, 5)
    found, plain = headers.ask(scene, q, v, a, payloads=[payload]), headers.ask(scene, q, v, a)
    assert (found["good"][:, 0] == 0.0).all()
    np.testing.assert_array_equal(found["effort_lower"], plain["effort_lower"])


# ---------------------------------------------------------------- passive, bounded, smooth


def judge_passive(headers, scene, options, states=40):
    """The most power (W) beyond what friction takes at each velocity; and the largest compensation.

    What friction takes is the model's own, from inverse dynamics at the same velocity: the motor's
    torque in motion less what it gives without friction, at any speed.
    """
    rng, nv = np.random.default_rng(9), scene.model.nv
    q, v, a = sampled(scene, 8, states)
    speeds = np.concatenate([np.geomspace(1e-5, 3.0, 31), -np.geomspace(1e-5, 3.0, 31)])
    rows = [np.repeat(x, len(speeds), axis=0) for x in (q, v, a)]
    v_ref = np.tile(speeds, states)[:, None] * rng.uniform(0.5, 1.0, (states * len(speeds), nv))
    found = headers.ask(scene, *rows, v_ref, options=options)
    sharp = CompensationOptions(scale=1.0, viscous_scale=1.0, switch_velocity=0.0)
    lost = headers.ask(scene, *rows, v_ref, options=sharp)
    rate = v_ref  # drive d moves freedom d
    excess = found["friction"] * rate - options.scale * lost["friction"] * rate
    return excess.max(), np.abs(found["friction"]).max(), (lost["friction"] * rate).min()


PASSIVE = [worm(), *RICH[:6], bundled("ur10_machine_tending"), bundled("panda_pick_and_place")]


@pytest.mark.parametrize("scene", PASSIVE, ids=lambda scene: scene.source)
@pytest.mark.parametrize("scale", [0.8, 1.0])
def test_it_gives_no_more_power_than_friction_takes(headers, scene, scale):
    options = CompensationOptions(scale=scale, viscous_scale=scale, switch_velocity=0.05)
    excess, size, least = judge_passive(headers, scene, options)
    assert least >= 0.0
    assert excess <= 1e-13 * size


def test_what_friction_takes_is_that_of_inverse_dynamics(headers):
    """The loss that passivity is judged by, at any speed above that of sticking."""
    for scene in PASSIVE[:4]:
        q, _, a = sampled(scene, 10, 50)
        v = np.random.default_rng(2).choice([-1.0, 1.0], a.shape) * 1e-4
        sharp = CompensationOptions(scale=1.0, viscous_scale=1.0, switch_velocity=0.0)
        found = headers.ask(scene, q, v, a, options=sharp)
        result = pf.inverse_dynamics(scene, configurations(scene, q), v, a)
        ratio, rotor = np.array(
            [
                (d.ratio, d.transmission.rotor_inertia if d.transmission else 0.0)
                for d in scene.drives
            ]
        ).T
        passing = result.motor_torque_lower * ratio - ratio**2 * rotor * a
        assert_columns(found["friction"], passing - result.effort_frictionless, "loss", 1e-11)


ENDS = """dry[d] = sum - detail::delivered(d, rest);"""
BLENDED_LOAD = (
    """double blend[Robot::freedoms];
      for (int i = 0; i < Robot::freedoms; ++i)
        blend[i] = rest[i] + 0.5 * (1.0 + s) * ahead[i] - 0.5 * (1.0 - s) * back[i];
      const double t = detail::delivered(d, blend);
      sum = 0.5 * (1.0 + s) * detail::gear_value(d, 1.0, speed, leaving, t) +
            0.5 * (1.0 - s) * detail::gear_value(d, -1.0, speed, leaving, t);
      """
    + ENDS
)


@needs_compiler
def test_blending_the_load_in_place_of_the_ends_would_not_be_passive(tmp_path):
    """The mutant that the test above is for: F(t(s)) gives more than friction takes."""
    mutant = Headers(tmp_path, [worm()], edit=lambda text: text.replace(ENDS, BLENDED_LOAD))
    options = CompensationOptions(scale=1.0, viscous_scale=1.0, switch_velocity=0.05)
    excess, size, _ = judge_passive(mutant, worm(), options)
    assert excess > 1e-4 * size


@pytest.mark.parametrize("scene", RICH, ids=lambda scene: scene.source)
def test_it_is_continuous_in_the_velocity(headers, scene):
    """Ten times finer steps of velocity give about ten times smaller steps."""
    options = CompensationOptions(
        scale=1.0, viscous_scale=1.0, switch_velocity=0.05, hold_error=0.01
    )
    (q, _, a), nv, steps = sampled(scene, 11, 1), scene.model.nv, []
    for count in (2001, 20001):
        v = np.linspace(-0.1, 0.1, count)[:, None] * np.ones(nv)
        rows = np.repeat(q, count, axis=0), np.zeros((count, nv)), np.repeat(a, count, axis=0)
        found = headers.ask(scene, *rows, v, error=np.full_like(v, 0.004), v_now=v, options=options)
        steps.append(np.abs(np.diff(found["friction"], axis=0)).max())
    assert steps[1] < 0.2 * steps[0]


def test_power_is_watched(headers):
    """Somebody pushes against the desired direction: no more than friction takes, and P0."""
    for scene in (RICH[0], RICH[1], RICH[6]):
        q, v, a = sampled(scene, 12, 200)
        v_ref, v_now = np.sign(v + 1e-9), np.random.default_rng(1).normal(size=v.shape)
        free = CompensationOptions(scale=1.5, viscous_scale=1.0)
        watched = CompensationOptions(scale=1.5, viscous_scale=1.0, power=0.5)
        sharp = CompensationOptions(scale=1.0, viscous_scale=1.0, switch_velocity=0.0)
        loose, found, lost = (
            headers.ask(scene, q, v, a, vr, v_now=v_now, options=options)["friction"]
            for vr, options in ((v_ref, free), (v_ref, watched), (v_now, sharp))
        )
        rate = v_now @ rate_rows(scene.drives, scene.model.nv).T
        assert ((found - lost) * rate).max() <= 0.5 + 1e-9
        assert ((loose - lost) * rate).max() > 1.0
        within = (loose - lost) * rate <= 0.5
        np.testing.assert_array_equal(found[within], loose[within])


def test_limits_hold(headers):
    scene = RICH[0]
    q, v, a = sampled(scene, 13, 100)
    limit = np.linspace(0.0, 1.0, len(scene.drives))
    options = CompensationOptions(scale=1.0, limit=limit)
    found = headers.ask(scene, q, v, a, options=options)["friction"]
    assert (np.abs(found) <= limit).all()
    assert (np.abs(found) == limit).any()


def test_hold_asks_for_break_away_and_fades_as_the_joint_slips(headers):
    gear = {"ratio": 50.0, "no_load_torque": {"static": 0.04, "kinetic": 0.02}}
    model = chain(("hinge", pin.JointModelRZ(), pin.Inertia(1.0, np.zeros(3), np.eye(3))))
    friction = {"hinge": {"coulomb": {"static": 5.0, "kinetic": 3.0}}}
    scene = pf.Scene(
        model,
        friction=friction,
        source="hinge.yaml",
        actuators=[{"joint": "hinge", "transmission": gear}],
    )
    solver, at = scene.solver(), [np.zeros(1)]
    options = CompensationOptions(scale=1.0, hold_error=0.01, switch_velocity=0.02)

    def found(v_ref, error, v_now):
        motion = {"error": [error], "v_now": [v_now], "options": options}
        return solver.compensate(*at, None, None, [v_ref], **motion)[0]

    assert found(0.0, 0.01, 0.0) == pytest.approx(5.0 + 50.0 * 0.04)
    assert found(0.0, -0.02, 0.0) == pytest.approx(-(5.0 + 50.0 * 0.04))
    assert found(0.0, 0.01, 0.02) == pytest.approx(3.0 + 50.0 * 0.02)  # it slips
    assert found(0.0, 0.0, 0.0) == 0.0
    assert found(0.02, -0.05, 0.02) == pytest.approx(3.0 + 50.0 * 0.02)  # as desired


# ---------------------------------------------------------------- numbers that are none


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["q", "v", "a", "v_ref", "error", "v_now"])
def test_what_is_not_finite_gives_false_and_zeros(headers, place, wrong):
    scene = RICH[6]
    q, v, a = sampled(scene, 14, 3)
    given = {"q": q, "v": v, "a": a, "v_ref": v.copy(), "error": 0.0 * v, "v_now": 0.0 * v}
    given[place][1, 2] = wrong
    state = [given.pop(name) for name in ("q", "v", "a", "v_ref")]
    found = headers.ask(scene, *state, **given)
    assert (found["good"][[0, 2]] == 1.0).all()
    whole = place in ("q", "v", "a")
    assert found["good"][1].tolist() == [
        1.0,
        not whole,
        not whole,
        0.0,
        not (whole or place in ("error", "v_now")),
    ]
    names = ("rigid_body", "friction", "feed_forward", *COMPARED, "sticking", "wrench")
    for name in names if whole else ("friction",):
        np.testing.assert_array_equal(found[name][1], 0.0)
    arguments = [configurations(scene, q)[1], *(x[1] for x in state[1:])]
    if place in ("q", "v", "a", "v_ref"):
        with pytest.raises(PinfricError):
            scene.solver().compensate(*arguments)


@pytest.mark.parametrize("watched", [False, True])
@pytest.mark.parametrize("wrong", [np.nan, -1.0])
def test_an_option_that_is_none_gives_false_and_zeros(headers, monkeypatch, wrong, watched):
    scene = RICH[0]
    q, v, a = sampled(scene, 14, 3)
    more = {"error": v, "v_now": v} if watched else {}
    for entry in range(6):
        rows = WHOLE.table(scene)
        rows[entry, 0] = wrong
        monkeypatch.setattr(CompensationOptions, "table", lambda *_, rows=rows: rows)
        found = headers.ask(scene, q, v, a, **more)
        assert (found["good"][:, 3] == 0.0).all()
        assert (found["friction"] == 0.0).all()
        monkeypatch.undo()


# ---------------------------------------------------------------- the program


@needs_compiler
def test_sanitizers_find_nothing(tmp_path):
    scenes = [RICH[4], RICH[7]]
    made = Headers(
        tmp_path, scenes, ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    )
    for scene in scenes:
        q, v, a = sampled(scene, 15, 30)
        found = made.ask(scene, q, v, a, error=v, v_now=v, options=SETTINGS[3])
        assert (found["good"] == 1.0).all()
    q[1, 0] = np.nan
    assert (made.ask(scene, q, v, a)["good"][1, 1:] == 0.0).all()


@needs_compiler
def test_it_calls_nothing_but_mathematics(tmp_path):
    """No allocation, no exception, no table of virtual functions: what is undefined is libm's."""
    scene = RICH[1]
    name = namespace(scene.source)
    (tmp_path / f"{name}.hpp").write_text(header(scene))
    (tmp_path / "use.cpp").write_text(
        f'#include "{name}.hpp"\n'
        f"bool use(const double* q, {name}::Options& o, double* out, {name}::Instant& i) {{\n"
        f"  {name}::Compensator c;\n  o = {name}::Options();\n"
        "  return c.set_gravity(q) && c.set_wrench(0, q) && c.add_payload(0, *q, q, q) &&\n"
        "         c.rigid_body(q, q, q, out) && c.friction(q, q, q, q, q, q, o, out) &&\n"
        "         c.motor_torque(q, q, q, q, q, o, out, i) && c.inverse(q, q, q, i);\n}\n"
    )
    for flags in (["-O2"], ["-O0"]):
        command = [COMPILER, *STRICT, *flags, "-c", tmp_path / "use.cpp", "-o", tmp_path / "use.o"]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        listed = subprocess.run(
            ["nm", "-u", tmp_path / "use.o"], check=True, capture_output=True, text=True
        ).stdout.split()
        undefined = {symbol for symbol in listed if symbol != "U"}
        allowed = {
            "sin",
            "cos",
            "sincos",
            "sqrt",
            "pow",
            "exp",
            "fmin",
            "fmax",
            "fabs",
            "memset",
            "memcpy",
            "_GLOBAL_OFFSET_TABLE_",
            "__stack_chk_fail",
        }
        assert undefined <= allowed, undefined - allowed


@needs_compiler
@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only"])
def test_fast_math_is_an_error(tmp_path, flag):
    (tmp_path / "use.cpp").write_text(header(RICH[0]))
    made = subprocess.run(
        [COMPILER, "-std=c++17", flag, "-fsyntax-only", tmp_path / "use.cpp"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert made.returncode != 0
    assert "-ffast-math takes away the checks for NaN" in made.stderr


@needs_compiler
def test_a_robot_without_friction_and_one_without_frames_compile(tmp_path):
    """C++ has no empty arrays."""
    plain = pf.Scene(random_tree(3, 2), source="plain.yaml")
    made = Headers(tmp_path, [plain])
    q, v, a = sampled(plain, 1, 5)
    found = made.ask(plain, q, v, a)
    assert (found["friction"] == 0.0).all()
    assert (found["good"] == 1.0).all()


# ---------------------------------------------------------------- without a compiler


def test_the_text_is_the_same_each_time():
    assert header(rich(2)) == header(rich(2))


def test_constants_come_back():
    """Parsed from the text and put through Newton's law in NumPy: at rest, tau is gravity's."""
    scene = RICH[0]
    bodies = [
        [
            float(x)
            for x in re.findall(
                r"[-+.\de]+", line.split("//")[0].replace("true", "1").replace("false", "0")
            )
        ]
        for line in re.search(r"Body bodies\[\] = \{\n(.*?)\n\};", header(scene), re.S)[
            1
        ].splitlines()
    ]
    (q, _, _), model = sampled(scene, 3, 1), scene.model
    R, p, pull = [], [], []
    effort = np.zeros(model.nv)
    for body in bodies:
        parent, turns, freedom = (int(x) for x in body[:3])
        P, at = np.reshape(body[5:14], (3, 3)), np.array(body[14:17])
        move = body[3] * q[0, freedom] + body[4]
        local = P @ pin.exp3(np.array([0.0, 0.0, move])) if turns else P
        at = at if turns else at + P[:, 2] * move
        base, origin = (R[parent], p[parent]) if parent >= 0 else (np.eye(3), np.zeros(3))
        R.append(base @ local)
        p.append(origin + base @ at)
        pull.append((body[26], p[-1] + R[-1] @ np.array(body[27:30])))
    gravity = model.gravity.linear
    for j, body in enumerate(bodies):
        carried = [k for k in range(len(bodies)) if j in _ancestors(bodies, k)]
        force = sum(-pull[k][0] * gravity for k in carried)
        moment = sum(np.cross(pull[k][1] - p[j], -pull[k][0] * gravity) for k in carried)
        along = moment if body[1] else force
        effort[int(body[2])] += body[3] * (R[j][:, 2] @ along)
    full = configurations(scene, q)[0]
    expected = pin.computeGeneralizedGravity(model, model.createData(), full)
    np.testing.assert_allclose(effort, expected, atol=1e-12 * np.abs(expected).max())


def _ancestors(bodies, k):
    found = []
    while k >= 0:
        found.append(k)
        k = int(bodies[k][0])
    return found


# ---------------------------------------------------------------- refused


def planar():
    model = pin.Model()
    model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "skates")
    model.appendBodyToJoint(1, pin.Inertia.Random(), pin.SE3.Identity())
    return pf.Scene(model=model)


def two_joints(**more):
    model = random_tree(1, 2, sliding=0.0)
    return pf.Scene(model, **more)


def narrow():
    guide = {"kind": "guide", "length": 0.2}
    friction = {"slide": {"bearing": guide, "mu": {"static": 0.2, "kinetic": 0.1}}}
    return pf.Scene(chain(("slide", pin.JointModelPX(), pin.Inertia.Random())), friction=friction)


REFUSED = [
    (lambda: four_bar()[0], "the loop '", ()),
    (lambda: pf.load_scene("excavator"), "the drive off the joints 'boom_cylinder'", ()),
    (lambda: drawer_scene(0.3), "the drive off the joints", ()),
    (planar, "'skates' has several degrees of freedom", ()),
    (lambda: two_joints(actuators=[{"joint": "joint_1"}]), "'joint_2' has no drive", ()),
    (
        lambda: two_joints(
            actuators=[
                {"joint": "joint_1"},
                {"joint": "joint_1", "name": "b"},
                {"joint": "joint_2"},
            ]
        ),
        "'joint_1' has several drives",
        (),
    ),
    (narrow, r"friction.slide.bearing.width: missing", ()),
    (lambda: pf.load_scene("ur10_machine_tending"), "no link 'tol0'.*tool0", ("tol0",)),
    (
        lambda: pf.load_scene("ur10_machine_tending"),
        "'base_link' is fixed to the ground",
        ("base_link",),
    ),
    (lambda: pf.Scene(pin.Model()), "has no joint", ()),
]


@pytest.mark.parametrize(("scene", "message", "frames"), REFUSED)
def test_what_cannot_be_compensated_is_named(scene, message, frames):
    made = scene()
    with pytest.raises(PinfricError, match=message) as found:
        cpp_files(made, frames, [np.inf] * len(made.drives), [], [""])
    assert "\n" not in str(found.value)
    if not frames:
        with pytest.raises(PinfricError, match=message):
            made.solver().compensate(*np.zeros((4, made.model.nv)))


# ---------------------------------------------------------------- pf.export and the command


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main(["export", *arguments])
    return ended.value.code


def test_the_command_writes_a_header_and_its_test_and_says_what_constants_miss(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    given = "ur10_machine_tending", "--trajectory", "ur10_machine_tending", "--to", "cpp"
    assert run(*given, "--frame", "tool0", "--frame", "wrist_1_link", "--out", "made") == 0
    out = capsys.readouterr().out
    assert "the header uses the present load and needs no constants" in out
    name = "pinfric_ur10_machine_tending"
    assert sorted(p.name for p in Path("made").iterdir()) == [f"{name}.hpp", f"{name}_test.cpp"]
    text = Path("made", f"{name}.hpp").read_text()
    assert 'frames[] = {"tool0", "wrist_1_link"}' in text
    assert run(*given, "--json", "--out", "again") == 0
    joints = {joint["joint"]: joint for joint in result_of(capsys.readouterr().out)["joints"]}
    lift, wrist = joints["shoulder_lift_joint"], joints["wrist_3_joint"]
    assert lift["error_rms"] > 1.0 > 0.1 > wrist["error_rms"]  # the lift carries, the wrist not
    assert run("four_bar", "--to", "cpp") == 2
    assert "the loop 'rocker_pin'" in capsys.readouterr().err
    assert run(*given, "--frame", "tol0", "--out", "none") == 2
    assert not Path("none").exists()
    assert run("so101", "--to", "mjcf", "--frame", "gripper") == 2


@needs_compiler
def test_the_written_test_agrees_replays_and_notices(tmp_path):
    scene = bundled("ur10_machine_tending")
    motion = pf.load_trajectory("ur10_machine_tending", scene)
    made = pf.export(scene, motion, "cpp")
    made.write(tmp_path)
    (test,) = tmp_path.glob("*_test.cpp")
    compiled(test, tmp_path / "check", "-O2")
    said = subprocess.run([tmp_path / "check"], capture_output=True, text=True, timeout=60)
    assert said.returncode == 0
    assert said.stdout.count(": agrees") == 6
    motion.to_csv(tmp_path / "motion.csv", digits=17)
    done = subprocess.run(
        [tmp_path / "check", tmp_path / "motion.csv"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    replayed = done.stdout.splitlines()
    assert (
        done.stderr
        == "column payload.blank is not read: nothing is carried here, see add_payload\n"
    )
    rows = np.array([[float(x) for x in line.split(",")] for line in replayed[1:]])
    result = pf.inverse_dynamics(scene, motion.q, motion.v, motion.a)
    assert_columns(rows[:, 3::4], result.motor_torque_lower, "least")
    assert_columns(rows[:, 4::4], result.motor_torque_upper, "greatest")
    for cell in ("abc", "", "1x"):
        lines = (tmp_path / "motion.csv").read_text().splitlines()[:3]
        lines[2] = ",".join([lines[2].split(",")[0], cell, *lines[2].split(",")[2:]])
        (tmp_path / "wrong.csv").write_text("\n".join(lines))
        broken = subprocess.run(
            [tmp_path / "check", tmp_path / "wrong.csv"], capture_output=True, text=True, timeout=60
        )
        assert broken.returncode == 1
        assert "line 3 is no state of the robot" in broken.stderr
    (tmp_path / "motion.csv").write_text("t,elbow_joint\n0,1\n")
    broken = subprocess.run(
        [tmp_path / "check", tmp_path / "motion.csv"], capture_output=True, text=True, timeout=60
    )
    assert broken.returncode == 1
    assert "shoulder_pan_joint is missing" in broken.stderr
    (hpp,) = tmp_path.glob("*.hpp")
    hpp.write_text(hpp.read_text().replace("now.mu * c + now.coulomb[1] - drag", "now.mu * c"))
    compiled(test, tmp_path / "check", "-O2")
    said = subprocess.run([tmp_path / "check"], capture_output=True, text=True, timeout=60)
    assert said.returncode == 1
    assert "DIFFERS" in said.stdout


def test_coupled_drives_are_exported_without_constants():
    made = pf.export(rich(7, couples=True), to="cpp")
    assert made.joints == ()
    assert "coupled" in str(export_report(made)[0])
    assert "Exported" in repr(made)
    assert len(made.summary()) == 0


def test_limits_are_above_what_the_motion_takes():
    scene = bundled("panda_pick_and_place")
    motion = pf.load_trajectory("panda_pick_and_place.csv", scene)
    text = pf.export(scene, motion, "cpp").text
    limits = [float(x) for x in re.search(r"default_limit\[\] = \{(.*)\};", text)[1].split(",")]
    result = pf.inverse_dynamics(scene, motion)
    lost = [np.abs(compensation(result, end)).max(axis=0) for end in ("lower", "upper")]
    np.testing.assert_allclose(limits, 1.5 * np.max(lost, axis=0), rtol=5e-3)


def identified(folder):
    """A scene of one hinge with a posterior beside it: levels known to 10 %, drag to 30 %."""
    (folder / "arm.urdf").write_text(
        '<robot name="arm"><link name="a"/><link name="b"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="hinge" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    (folder / "scene.yaml").write_text(
        "pinfric: 1\nrobot: {urdf: arm.urdf}\nfriction: {hinge: {coulomb: {static: 3, kinetic: 3}}}"
    )
    draws = 1.0 + 0.1 * np.linspace(-1.0, 1.0, 400)
    lines = ["friction.hinge.coulomb", *(f"{x:.6f}" for x in draws)]
    (folder / "posterior.csv").write_text("\n".join(lines) + "\n")
    return pf.load_scene(folder / "scene.yaml")


def test_an_identified_scene_says_how_far_its_level_is_known(tmp_path):
    made = pf.export(identified(tmp_path), to="cpp")
    assert made.uncertainty["hinge"] == pytest.approx(0.095, abs=1e-4)  # 95 % of +-10 %
    assert "friction known to 9.5%" in made.text
    assert "1/(1+e) = 0.913" in made.text
    (tmp_path / "posterior.csv").rename(tmp_path / "elsewhere.csv")
    scene = pf.load_scene(tmp_path / "scene.yaml")
    assert pf.export(scene, to="cpp").uncertainty == {}
    again = pf.export(scene, to="cpp", posterior=tmp_path / "elsewhere.csv")
    assert again.uncertainty == made.uncertainty
    with pytest.raises(PinfricError, match="are for 'cpp' only"):
        pf.export(scene, to="mjcf", posterior=tmp_path / "elsewhere.csv")
