"""Logs with known truth: a UR5 with friction that depends on load, measured as robots measure."""

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump

import pinfric as pf
from pinfric.identification.columns import Prepared, Rows
from pinfric.identification.identify import Identified
from pinfric.identification.laws import SLOTS, Law
from pinfric.identification.normal import Fit, Prior

#: Recordings of real robots, too large for the repository.
LOGS = Path(__file__).parents[3] / "shared" / "data"
needs_logs = pytest.mark.skipif(
    not LOGS.is_dir(),
    reason=f"no recordings of a UR10, a Panda and a KR 300 in {LOGS} (notebooks/judges.md)",
)

#: s by which measured efforts lag behind, share of an effort's RMS that is white noise, and that
#: hangs together over `MEMORY` s; counts of an encoder over a turn.
DELAY, NOISE, MEMORY, COUNTS = 0.004, 0.02, 0.2, 2**18


RATIO = 101.0


#: Gears, and a plain bearing at the elbow: the load-dependent friction that is hidden.
EFFICIENCY, BACK_EFFICIENCY, MU = 0.95, 0.93, 0.08


PIN = {"kind": "pin", "radius": 0.05, "length": 0.06}


COULOMB = ((6.0, 5.0), (8.0, 7.0), (4.0, 4.6), (1.6, 1.3), (1.2, 1.4), (1.0, 1.1))


VISCOUS = (9.0, 11.0, 7.0, 2.0, 1.6, 1.4)


ROTOR = (7e-5, 7e-5, 7e-5, 1.2e-5, 1.2e-5, 1.2e-5)


@cache
def robot() -> pf.Scene:
    """The bundled UR5 without friction and drives."""
    scene = pf.load_scene("ur5_pick_and_place")
    return scene.with_(friction={}, actuators=None, payloads={})


@cache
def truth() -> pf.Scene:
    """The robot as it is."""
    scene = robot()
    friction, actuators = {}, []
    for j, name in enumerate(scene.joint_names):
        (up, down), viscous = COULOMB[j], VISCOUS[j]
        friction[name] = {
            "coulomb": {
                "positive": {"static": up, "kinetic": up},
                "negative": {"static": down, "kinetic": down},
            },
            "viscous": viscous,
        }
        transmission = {"ratio": RATIO, "rotor_inertia": ROTOR[j]}
        if j == 1:
            transmission |= {"efficiency": EFFICIENCY, "back_efficiency": BACK_EFFICIENCY}
        actuators.append({"joint": name, "transmission": transmission})
    elbow = scene.joint_names[2]
    friction[elbow] |= {"bearing": PIN, "mu": {"static": MU, "kinetic": MU}}
    return scene.with_(friction=friction, actuators=actuators)


def guess(seed: int, bearing: bool = True) -> pf.Scene:
    """Prior knowledge: masses wrong by 20 %, a guessed coefficient at the elbow's bearing."""
    true = truth()
    model, rng = true.model.copy(), np.random.default_rng(1000 + seed)
    for body in range(1, model.njoints):
        inertia = model.inertias[body].copy()
        factor = 1.0 + 0.2 * rng.choice([-1.0, 1.0])
        inertia.mass *= factor
        inertia.inertia = inertia.inertia * factor
        model.inertias[body] = inertia
    elbow = true.joint_names[2]
    friction = {elbow: {"bearing": PIN, "mu": {"static": 0.1, "kinetic": 0.1}}} if bearing else {}
    actuators = [{"joint": name, "transmission": {"ratio": RATIO}} for name in true.joint_names]
    return true.with_(model=model, friction=friction, actuators=actuators)


@dataclass(frozen=True)
class Motion:
    """A motion with its exact derivatives."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def excitation(seed: int, duration: float = 60.0, rate: float = 500.0, still=()) -> Motion:
    """Sums of sines about a bent arm; joints in `still` stand."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(duration * rate)) / rate
    nj = 6
    middle = np.array([0.0, -1.2, 1.2, -0.5, 0.5, 0.0])
    reach = np.array([2.0, 1.3, 1.8, 2.0, 2.0, 2.5])
    q, v, a = (np.zeros((t.size, nj)) for _ in range(3))
    harmonics = 2 * np.pi * 0.05 * np.arange(1, 13)
    for j in range(nj):
        if j in still:
            continue
        size = rng.normal(size=12) / np.maximum(1.0, np.arange(1, 13) / 3.0)
        angle = np.outer(t, harmonics) + rng.uniform(0.0, 2 * np.pi, 12)
        size *= reach[j] / np.abs(np.sin(angle) @ size).max()
        q[:, j] = np.sin(angle) @ size
        v[:, j] = np.cos(angle) @ (size * harmonics)
        a[:, j] = -np.sin(angle) @ (size * harmonics**2)
    return Motion(t, middle + q, v, a)


def motor_effort(scene: pf.Scene, motion: Motion) -> np.ndarray:
    """Motor torques times the gears' ratio; the middle of intervals at rest."""
    found = pf.inverse_dynamics(scene, motion.q, motion.v, motion.a, t=motion.t)
    ratio = np.array([drive.transmission.ratio for drive in scene.drives])
    return 0.5 * ratio * (found.motor_torque_lower + found.motor_torque_upper)


def log(seed: int, duration: float = 60.0, rate: float = 500.0, still=(), name="log") -> pf.Log:
    """The excitation as a robot logs it: encoder counts, noisy late efforts, ns stamps."""
    motion = excitation(seed, duration, rate, still)
    return logged(seed, motion, motor_effort(truth(), motion), name)


def logged(
    seed: int, motion: Motion, effort: np.ndarray, name: str = "log", every: int = 1
) -> pf.Log:
    """A motion and its efforts as a robot logs them, one of so many samples."""
    late = np.column_stack([np.interp(motion.t - DELAY, motion.t, y) for y in effort.T])
    motion = Motion(*(x[::every] for x in (motion.t, motion.q, motion.v, motion.a)))
    effort, late = effort[::every], late[::every]
    rate = 1.0 / (motion.t[1] - motion.t[0])
    rng = np.random.default_rng(5000 + seed)
    size = NOISE * np.sqrt(np.mean(effort**2, axis=0))
    keep = np.exp(-1.0 / (rate * MEMORY))
    from scipy.signal import lfilter

    slow = lfilter([np.sqrt(1 - keep**2)], [1, -keep], rng.normal(size=effort.shape), axis=0)
    measured = late + size * (rng.normal(size=effort.shape) + slow)
    step = 2 * np.pi / COUNTS
    stamps = 1_700_000_000_000_000_000 + np.rint(motion.t * 1e9).astype(np.int64)
    return pf.Log(stamps, step * np.rint(motion.q / step), measured, name=name)


#: A KUKA KR300's links by its maker: d, a (m), alpha (deg), mass (kg), centre of mass (m) and Ixx,
#: Iyy, Izz, Ixy, Iyz, Ixz (kg m^2) in the link's frame, ratio of the gear; the last with 200 kg.
KR300 = (
    (-0.675, 0.35, 90, 395.4, (-0.353, 0.174, -0.004), (17, 30, 33, -1.7, 0.1, 4.4), 1798 / 7),
    (-0.189, 1.15, 0, 339.1, (-0.709, -0.001, 0.023), (7.5, 89, 89, 0.4, 0.2, -4.4), 1872 / 7),
    (0.189, 0.041, -90, 105.2, (-0.018, -0.018, -0.076), (11, 10, 1.9, 0.1, -0.6, -0.1), 757 / 3),
    (-1.0, 0.0, 90, 35.8, (0.0, 0.236, 0.001), (0.425, 0.218, 0.428, 0.0, -0.011, 0.0), 221.0),
    (0.0, 0.0, -90, 31.5, (0.0, -0.08, -0.009), (0.284, 0.23, 0.258, 0.0, -0.02, 0.0), 5032 / 21),
    (-0.24, 0.0, 180, 217.8, (0.0, 0.0, 0.088), (0.5, 0.5, 0.1, 0.0, 0.0, 0.0), 206793 / 1340),
)


def kr300(path: Path) -> tuple[pf.Scene, pf.Log]:
    """A KUKA KR300 by its Denavit-Hartenberg parameters, and one of its logs, signs as logged."""
    from scipy.io import loadmat

    model, place = pin.Model(), pin.SE3(pin.utils.rotate("x", np.pi), np.zeros(3))
    for j, (d, a, alpha, mass, com, (xx, yy, zz, xy, yz, xz), _) in enumerate(KR300):
        place = place * pin.SE3(pin.utils.rotate("z", np.pi / 2 * (j == 2)), np.zeros(3))
        joint = model.addJoint(j, pin.JointModelRZ(), place, f"a{j + 1}")
        place = pin.SE3(pin.utils.rotate("x", np.deg2rad(alpha)), np.array([a, 0.0, d]))
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        body = place.act(pin.Inertia(mass, np.array(com), inertia))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    rec = loadmat(path, squeeze_me=True, struct_as_record=False)["rec"]
    q, torque = (
        np.asarray(x).reshape(6, -1).T if len(x) == 6 else np.asarray(x)
        for x in (rec.act_pos_mot_deg, rec.act_torque_abs_nm)
    )
    effort = torque * [link[-1] for link in KR300]
    return pf.Scene(model=model), pf.Log(0.004 * np.arange(len(q)), np.deg2rad(q), effort)


def with_static(static: float, **more: object) -> pf.Scene:
    """The robot with so many times its Coulomb friction at rest, and more terms of its joints."""
    scene, friction = truth(), {}
    for name, entry in scene.friction.items():
        coulomb = {
            way: {"static": static * one.kinetic, "kinetic": one.kinetic}
            for way, one in (
                ("positive", entry.coulomb.positive),
                ("negative", entry.coulomb.negative),
            )
        }
        others = {key: x for key, x in entry if x is not None and key != "coulomb"}
        friction[name] = others | {"coulomb": coulomb} | more
    return scene.with_(friction=friction)


def slow_departures(
    joints: tuple[int, ...], static: float, rate: float = 100.0, rise: float = 1.2
) -> pf.Log:
    """A log in which joints leave rest while their efforts rise to `static` x Coulomb friction.

    They take `rise` s of a hold of 1.2 s for that.
    """
    scene = with_static(static)
    here, q, push = np.array([0.3, -1.0, 1.1, -0.4, 0.5, 0.2]), [], []
    s = np.arange(1, int(2.5 * rate) + 1) / (2.5 * rate)
    for joint, way in [(j, way) for _ in range(3) for j in joints for way in (1.0, -1.0)]:
        held = np.maximum(np.linspace(1.0 - 1.2 * 1.2 / rise, 1.0, int(1.2 * rate)), -0.2)
        there = here + 0.08 * way * (np.arange(6) == joint)
        q += [
            np.tile(here, (held.size, 1)),
            here + np.outer(s**3 * (10 - 15 * s + 6 * s**2), there - here),
        ]
        push += [np.outer(held, way * (np.arange(6) == joint)), np.zeros((s.size, 6))]
        here = there
    q, push = np.concatenate(q), np.concatenate(push)
    motion = pf.Trajectory.from_arrays(scene, np.arange(len(q)) / rate, q)
    found = pf.inverse_dynamics(scene, motion)
    low, high = RATIO * found.motor_torque_lower, RATIO * found.motor_torque_upper
    effort = 0.5 * (low + high) + 0.5 * push * (high - low)
    late = np.column_stack([np.interp(motion.t - DELAY, motion.t, y) for y in effort.T])
    size = 0.01 * np.sqrt(np.mean(effort**2, axis=0))
    late += size * np.random.default_rng(0).normal(size=late.shape)
    step = 2 * np.pi / COUNTS
    return pf.Log(motion.t, step * np.rint(q / step), late, name="departures")


NAMES = truth().joint_names
#: No load, no Stribeck effect: laws that are given, so that none is chosen.
PLAIN = dict.fromkeys(NAMES, Law())


def csv_log(path: Path, seed: int, rate: float = 125.0, torn: tuple[int, ...] = ()) -> Path:
    """Write a log as a file with stamps in ns and some torn rows."""
    given = log(seed, rate=rate)
    header = ["timestamp", *NAMES, *(f"{name}/effort" for name in NAMES)]
    rows = [
        ",".join([str(t), *(f"{x:.9g}" for x in q), *(f"{x:.6g}" for x in y)])
        for t, q, y in zip(given.t, given.q, given.effort, strict=True)
    ]
    for row in torn:
        rows[row] = rows[row][:40]
    path.write_text("\n".join([",".join(header), *rows]))
    return path


@cache
def short(seed: int = 0, still: tuple[int, ...] = ()) -> pf.Log:
    return log(seed, 20.0, 100.0, still)


def rows_of(effort: np.ndarray, columns: dict, rigid: np.ndarray | None = None, **more) -> Rows:
    """Rows of one joint made by hand: slot -> column; by default in one block, at rest."""
    n = len(effort)
    slots = np.zeros((n, len(SLOTS)))
    for slot, column in columns.items():
        slots[:, slot] = column
    whole = {name: np.zeros(n, dtype=int) for name in ("block", "log")}
    still = dict.fromkeys(("time", "velocity", "load"), np.zeros(n))
    rigid = np.zeros((n, 10)) if rigid is None else rigid
    return Rows(rigid=rigid, slots=slots, effort=effort, **whole | still | more)


#: Of links whose inertias are kept.
KEPT = Prior(np.zeros(10), np.full(10, np.inf), np.zeros(10))


def one_joint(**more: object) -> pf.Scene:
    """An arm on an axis along y, its mass of 2 kg 0.5 m out along x."""
    return pf.Scene(chain(("arm", pin.JointModelRY(), lump(2.0, (0.5, 0.0, 0.0)))), **more)


def fit_of(columns: dict, theta: np.ndarray = np.zeros(10)) -> Fit:  # noqa: B008
    """One joint's coefficients made by hand: slot -> value."""
    return Fit(theta, np.array([[columns.get(slot, 0.0) for slot in SLOTS]]))


def prepared_of(v: np.ndarray, columns: dict, **more: object) -> Prepared:
    """A log of one joint made by hand, ten samples a second, with those of `rows_of`."""
    t, still = 0.1 * np.arange(len(v)), np.zeros((len(v), 1))
    recording = SimpleNamespace(
        trajectory=SimpleNamespace(t=t), step=0.1, velocity=v[:, None], acceleration=still
    )
    given = {"kept": np.arange(len(v)), "slides": (v != 0.0)[:, None], "load": still}
    given |= {"rigid": np.zeros((len(v), 1, 10)), "effort": None, "payload": still}
    given |= {"missing": still, "presliding": np.zeros((len(v), 1, 3))}
    given |= {"share": np.sign(v)[:, None]}
    given |= {"bearing": still, "turns": np.zeros((len(v), 1), dtype=bool)} | more
    slots = rows_of(t, columns).slots[:, None]
    given |= {"rigid_rates": given["rigid"], "slot_rates": 0.0 * slots}
    return Prepared(recording=recording, slots=slots, **given)


def count_goes_on(told: list[tuple[int, int]]) -> None:
    """Judge what `progress` was told: each step once, and all of them at the end only."""
    assert [done for done, _ in told] == list(range(1, len(told) + 1))
    assert [done == total for done, total in told] == [False] * (len(told) - 1) + [True]


def parameter(found: Identified, section: str, joint: int, name: str):
    return next(
        p for p in found.parameters if (p.section, p.joint, p.name) == (section, NAMES[joint], name)
    )


def true_friction(found: Identified):
    """Yield each coefficient of Coulomb and viscous friction beside the true one."""
    for j in range(6):
        for key, value in zip(
            ("coulomb.positive", "coulomb.negative", "viscous"),
            (*COULOMB[j], VISCOUS[j]),
            strict=True,
        ):
            yield parameter(found, "friction", j, key), value


@cache
def identified_arm() -> Identified:
    """The arm, identified once per process from a file with torn rows; another log held out."""
    with tempfile.TemporaryDirectory() as folder:
        path = csv_log(Path(folder) / "arm.csv", 0, torn=(500, 700))
        return pf.identify(guess(0), path, held_out=[log(7, 20.0, 125.0, name="other")])


@cache
def identified_ur10() -> Identified:
    """A UR10, identified once per process from a log of its own."""
    urdf = "example-robot-data:ur_description/urdf/ur10_robot.urdf"
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "ur10.yaml"
        scene.write_text(f"pinfric: 1\nrobot: {{urdf: '{urdf}'}}\n")
        return pf.identify(pf.load_scene(scene), LOGS / "ur10" / "ur10_exciting_trajectory.db3")


def whole_friction(found: Identified, name: str, speed: float) -> np.ndarray:
    """Draws of a joint's Coulomb and viscous friction at a speed, mean of both ways, N m."""
    law, drive = found.laws[name], found.scene.drives[found.scene.joint_names.index(name)]
    motor = law.side == "motor"  # torques at the motor's shaft, and its speed
    section, dry, wet = (
        ("transmission", "no_load_torque", "motor_viscous")
        if motor
        else ("friction", "coulomb", "viscous")
    )
    ratio, none = abs(drive.ratio) if motor else 1.0, np.zeros(1)
    total = found.posterior.get(f"{section}.{name}.{wet}", none) * (ratio * speed) ** (
        law.exponent or 0.0
    )
    for way in ("positive", "negative"):
        total = total + 0.5 * found.posterior.get(f"{section}.{name}.{dry}.{way}", none)
    return ratio * total + excess(found.scene, name, speed)


def excess(scene: pf.Scene, name: str, speed: float) -> float:
    """What remains at a speed of the excess of a joint's friction at rest, mean of both ways."""
    entry = scene.friction.get(name)
    if entry is None or entry.stribeck is None or entry.coulomb is None:
        return 0.0
    ways = entry.coulomb.positive, entry.coulomb.negative
    left = np.exp(-((speed / entry.stribeck.velocity) ** entry.stribeck.exponent))
    return 0.5 * float(left) * sum(way.static - way.kinetic for way in ways)
