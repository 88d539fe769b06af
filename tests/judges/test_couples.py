"""Coupled drives: a motor that other joints turn, too (wrists), against closed forms and judges."""

from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import chain, dry, gantry, lump, random_friction, random_states, random_tree
from judges.verdict import judge
from mechanisms import pin_friction, shifted
from scipy.optimize import linprog

import pinfric as pf
from pinfric.accuracy.explain import explain
from pinfric.drives.inertia import load_inertias
from pinfric.errors import PinfricError, SceneError
from pinfric.model.couples import rate_rows
from pinfric.motions.summary import rests, sites_on

_LOSSY = yaml.safe_load("""
ratio: -30.0
efficiency: 0.8
back_efficiency: 0.7
rotor_inertia: 0.0002
no_load_torque:
  positive: {static: 0.013, kinetic: 0.01}
  negative: {static: 0.02, kinetic: 0.02}
motor_viscous: {coefficient: 0.003, exponent: 0.7}
""")


def _arm(seed: int, friction: bool = True, **gear: object) -> pf.Scene:
    """Five joints: the second drive moves with the first joint, the fourth with two others."""
    model, rng = random_tree(seed, 5), np.random.default_rng(seed)
    names, couples = list(model.names)[1:], {}
    couples[names[1]] = {names[0]: float(rng.normal())}
    couples[names[3]] = {names[2]: float(rng.normal()), names[1]: 0.7}
    entries = random_friction(model, seed) if friction else {}
    for entry in entries.values():
        entry["mu"] = {key: 0.1 * value for key, value in entry["mu"].items()}
    actuators = [
        {
            "joint": name,
            "couples": couples.get(name, {}),
            "transmission": _LOSSY | gear | {"ratio": 30.0 * rng.choice([-1.0, 1.0])},
        }
        for name in names
    ]
    return pf.Scene(model, friction=entries, actuators=actuators)


def _planar(lengths: tuple[float, float] = (0.4, 0.3)) -> pin.Model:
    """Two parallel axes in a vertical plane, point masses 3 and 2 kg at the links' ends."""
    ends = [lump(m, [x, 0, 0], 0.0) for m, x in zip((3.0, 2.0), lengths, strict=True)]
    turn = pin.JointModelRZ()
    model = chain(("j1", turn, ends[0]), ("j2", turn, ends[1], [lengths[0], 0, 0]))
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    return model


def test_lagrange_of_a_planar_wrist_by_hand() -> None:
    """Motors turn by n1 q1 and n2 (q2 + c q1); Lagrange's equations with both rotors."""
    n1, n2, c, rotor, drag = 50.0, -80.0, -1.2, 1e-4, 0.002
    gear = {"rotor_inertia": rotor, "motor_viscous": drag}
    scene = pf.Scene(
        _planar(),
        actuators=[
            {"joint": "j1", "transmission": gear | {"ratio": n1}},
            {"joint": "j2", "transmission": gear | {"ratio": n2}, "couples": {"j1": c}},
        ],
    )
    q, v, a = (np.array(x) for x in ([0.4, -0.9], [1.1, 0.7], [-2.0, 3.0]))
    l1, l2, m1, m2, g = 0.4, 0.3, 3.0, 2.0, 9.81
    cos, sin, tip = l1 * l2 * m2 * np.cos(q[1]), l1 * l2 * m2 * np.sin(q[1]), m2 * l2**2
    weight2 = m2 * g * l2 * np.cos(q[0] + q[1])
    tau2 = (tip + cos) * a[0] + tip * a[1] + sin * v[0] ** 2 + weight2
    tau1 = (
        ((m1 + m2) * l1**2 + tip + 2 * cos) * a[0]
        + (tip + cos) * a[1]
        - sin * v[1] * (2 * v[0] + v[1])
        + weight2
        + (m1 + m2) * g * l1 * np.cos(q[0])
    )
    rates, bends = np.array([v[0], v[1] + c * v[0]]), np.array([a[0], a[1] + c * a[0]])
    effort = np.array([tau1 - c * tau2, tau2])
    ratio = np.array([n1, n2])
    torque = effort / ratio + ratio * (rotor * bends + drag * rates)
    result = pf.inverse_dynamics(scene, q, v, a)
    assert result.effort_lower[0] == pytest.approx(effort, rel=1e-12)
    assert result.motor_torque_lower[0] == pytest.approx(torque, rel=1e-12)
    assert result.actuator_velocity[0] == pytest.approx(rates, rel=1e-14)
    found = pf.forward_dynamics(scene, q, v, motor_torque=torque)
    assert found.a == pytest.approx(a, rel=1e-10)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rotors_are_an_armature_matrix_of_pinocchio(seed: int) -> None:
    """(M + S^T I S) a + h = S^T (r T - drag), I = r^2 J, of gears without losses."""
    scene = _arm(seed, friction=False, efficiency=1.0, back_efficiency=None, no_load_torque=0.0)
    model, rng = scene.model, np.random.default_rng(seed)
    q, v, _ = (x[0] for x in random_states(model, seed, 1))
    torque, S = rng.normal(size=5), rate_rows(scene.drives, 5)
    r = np.array([drive.transmission.ratio for drive in scene.drives])
    data, none = model.createData(), np.zeros(5)
    h = pin.rnea(model, data, q, v, none).copy()
    weight = pin.rnea(model, data, q, none, none).copy()
    M = np.array([pin.rnea(model, data, q, none, one) - weight for one in np.eye(5)])
    M += S.T @ np.diag(r**2 * 2e-4) @ S
    speed = r * (S @ v)
    drag = r * 0.003 * np.sign(speed) * np.abs(speed) ** 0.7
    a = np.linalg.solve(M, S.T @ (r * torque - drag) - h)
    found = pf.forward_dynamics(scene, q, v, motor_torque=torque)
    assert found.a == pytest.approx(a, rel=1e-9, abs=1e-10)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_forward_after_inverse_with_everything_on(seed: int) -> None:
    """Bearings, coulomb, lossy gears: forward dynamics, solvers and residuals agree."""
    scene = _arm(seed)
    q, v, a = random_states(scene.model, seed, 4)
    result, solver = pf.inverse_dynamics(scene, q, v, a), scene.solver()
    assert judge(result).equilibrium < 1e-11
    for i in range(4):
        torque = result.motor_torque_lower[i]
        found = pf.forward_dynamics(scene, q[i], v[i], motor_torque=torque)
        assert found.a == pytest.approx(a[i], abs=1e-10)
        assert found.effort == pytest.approx(result.effort_lower[i], abs=1e-10)
        by_effort = pf.forward_dynamics(scene, q[i], v[i], result.effort_upper[i])
        assert by_effort.a == pytest.approx(a[i], abs=1e-10)
        again = solver.inverse(q[i], v[i], a[i]).motor_torque_lower
        assert again == pytest.approx(torque, abs=1e-12)


def test_at_rest_efforts_are_intervals_that_hold_and_break() -> None:
    """All combinations of the joints' frictions: the judge's ends, and holds agrees with both."""
    scene = _arm(1, efficiency=1.0, back_efficiency=None, no_load_torque=0.0)
    q = random_states(scene.model, 1, 1)[0]
    none = np.zeros((1, 5))
    result = pf.inverse_dynamics(scene, q, none, none)
    assert judge(result).equilibrium < 1e-11
    assert (result.effort_upper - result.effort_lower > 0.1).all()
    middle = result.effort_frictionless[0]
    assert pf.holds(scene, q[0], middle).held
    for d in range(5):
        for end, side in ((result.effort_lower, -1.0), (result.effort_upper, 1.0)):
            beyond = middle.copy()
            beyond[d] = end[0, d] + side * 1e-3
            assert pf.holds(scene, q[0], beyond).held is False


def test_a_gantry_on_two_belts_is_the_one_turned_by_45_degrees() -> None:
    """Relabelled coordinates: holds, breaks away, slides and stops alike, gears lossy."""
    gear = _LOSSY | {"no_load_torque": {"static": 0.3, "kinetic": 0.2}, "ratio": 40.0}
    made = gantry(False, gear), gantry(True, gear)
    belts, slides = (pf.Scene(model, actuators=actuators) for model, actuators in made)
    to_turned = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    for torque in ([-0.35, -0.35], [-0.9, -0.35], [0.2, -0.9], [-0.2, -0.1]):
        one, other = (
            pf.holds(s, np.zeros(2), motor_torque=np.array(torque)) for s in (belts, slides)
        )
        assert (one.held, one.proved) == (other.held, other.proved)

    def torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([-0.35 + 0.6 * np.sin(5.0 * t), -0.4 - 0.5 * np.sin(3.0 * t)])

    one, other = (
        pf.simulate(s, np.zeros(2), np.zeros(2), t_end=1.5, motor_torque=torque)
        for s in (belts, slides)
    )
    changes = [[(e.time, e.kind) for e in m.events] for m in (one, other)]
    assert len(changes[0]) == len(changes[1]) >= 3
    assert [t for t, _ in changes[0]] == pytest.approx([t for t, _ in changes[1]], abs=1e-6)
    assert other.q[-1] == pytest.approx(to_turned @ one.q[-1], abs=1e-6)
    energy = one.energy()
    assert abs(energy.residual) < 1e-5 * abs(energy.work)
    assert energy.gear_loss == pytest.approx(other.energy().gear_loss, rel=1e-4)


def test_joints_and_gears_stick_and_slip_together() -> None:
    """Two joints' friction and two gears' on two freedoms: work goes where it should."""
    friction = {name: dry(most, 2.0) for name, most in (("j1", 3.0), ("j2", 2.0))}
    gear = {"ratio": 20.0, "no_load_torque": {"static": 0.09, "kinetic": 0.05}} | {
        "efficiency": 0.9,
        "back_efficiency": 0.8,
        "rotor_inertia": 1e-3,
    }
    scene = pf.Scene(
        _planar(),
        friction=friction,
        actuators=[
            {"joint": "j1", "transmission": gear},
            {"joint": "j2", "transmission": gear, "couples": {"j1": 1.0}},
        ],
    )

    def torque(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([1.5 + np.sin(4.0 * t), 0.5 * np.sin(7.0 * t)])

    motion = pf.simulate(scene, np.zeros(2), np.zeros(2), t_end=1.0, motor_torque=torque)
    stepped = pf.simulate(
        scene,
        np.zeros(2),
        np.zeros(2),
        t_end=1.0,
        motor_torque=torque,
        method="timestepping",
        dt=1e-3,
    )
    energy = motion.energy()
    assert len(motion.events) >= 3
    assert abs(energy.residual) < 1e-5 * abs(energy.work)
    assert (np.append(energy.friction_loss, energy.gear_loss) > 0.0).all()
    assert stepped.q[-1] == pytest.approx(motion.q[-1], abs=0.02)


def test_beside_a_loop_the_couples_reach_the_efforts() -> None:
    """A force holds one joint, two more are coupled: the residuals judge every end."""
    model = random_tree(4, 3, sliding=0.0)
    model.addBodyFrame("tip", 3, pin.SE3.Identity(), 0)
    names = list(model.names)[1:]
    friction = {name: pin_friction(0.1, 0.02, static=0.12) for name in names}
    actuators = [
        {"joint": names[1], "transmission": _LOSSY},
        {"joint": names[2], "couples": {names[1]: 0.8}, "transmission": _LOSSY},
        {
            "force": {
                "name": "pull",
                "link": "tip",
                "xyz": [0.3, 0.2, 0.1],
                "direction": [0.0, 0.6, 0.8],
            },
            "transmission": _LOSSY | {"ratio": 100.0},
        },
    ]
    scene = pf.Scene(model, friction=friction, actuators=actuators)
    q, v, a = random_states(model, 4, 4)
    v[3] = a[3] = 0.0
    result = pf.inverse_dynamics(scene, q, v, a)
    assert judge(result).equilibrium < 1e-9
    for i in range(3):
        found = pf.forward_dynamics(scene, q[i], v[i], motor_torque=result.motor_torque_lower[i])
        assert found.a == pytest.approx(a[i], abs=1e-8)


@pytest.mark.parametrize(
    ("couples", "message"),
    [
        ([{}, {"j9": 1.0}], "actuators: j2.couples: joint 'j9' is not there; "),
        ([{}, {"j2": 1.0}], "`couples` names its own joint 'j2'"),
        ([{}, {"j1": 0.0}], "`couples.j1` must not be 0"),
        ([{}, {"j1": float("inf")}], "couples.j1"),
        ([{"j2": 2.0}, {"j1": 0.5}], "the couples of j1, j2 are singular"),
        ([None, {"j1": 0.5}], "'j2' couples joint 'j1', which has no drives"),
    ],
)
def test_couples_that_cannot_be_are_refused(couples: list, message: str) -> None:
    actuators = [
        {"joint": f"j{i + 1}", "couples": entry}
        for i, entry in enumerate(couples)
        if entry is not None
    ]
    with pytest.raises(SceneError) as problem:
        pf.Scene(_planar(), actuators=actuators)
    assert message in str(problem.value)
    assert "\n" not in str(problem.value)


def test_two_motors_that_both_move_both_joints_are_a_differential_wrist() -> None:
    """Couples both ways are allowed while the motors' speeds determine the joints'."""
    scene = pf.Scene(
        _planar(),
        actuators=[
            {"joint": "j1", "couples": {"j2": 1.0}},
            {"joint": "j2", "couples": {"j1": -1.0}},
        ],
    )
    tau, found = (
        pf.inverse_dynamics(s, [0.3, 0.2], [0.5, 1.0], [2.0, 1.0]).effort_lower[0]
        for s in (pf.Scene(_planar()), scene)
    )
    assert found == pytest.approx([(tau[0] + tau[1]) / 2, (tau[1] - tau[0]) / 2], rel=1e-12)


def test_every_command_sees_the_coupling(tmp_path: Path) -> None:
    """Its key in a file; explain; the friction a drive feels; its inertia when others stand."""
    model = _planar()
    (tmp_path / "scene.yaml").write_text("""
pinfric: 1
robot: {urdf: "example-robot-data:ur_description/urdf/ur5_robot.urdf"}
actuators: [{joint: wrist_2_joint}, {joint: wrist_3_joint, couples: {wrist_2_joint: 1.0}}]
""")
    assert pf.load_scene(tmp_path / "scene.yaml").drives[1].couples == ((4, 1.0),)
    friction = {name: dry(2.0, 1.0) for name in ("j1", "j2")}
    actuators = [{"joint": "j1"}, {"joint": "j2", "couples": {"j1": -0.5}}]
    scene = pf.Scene(model, friction=friction, actuators=actuators)
    q, v = np.array([[0.1, 0.2], [0.3, -0.4]]), np.array([[0.0, 1.0], [1.0, 0.5]])
    result = pf.inverse_dynamics(scene, q, v, v)
    assert [rests(result, d).tolist() for d in (0, 1)] == [[True, False], [False, False]]
    assert [sites_on(scene, d) for d in (0, 1)] == [[0, 1], [1]]
    largest = np.zeros(2)
    for angles in q:  # inertias about the motors: C^-T M C^-1
        M = np.triu(pin.crba(model, model.createData(), angles))
        there = np.linalg.inv([[1.0, 0.0], [-0.5, 1.0]])
        largest = np.maximum(largest, (there.T @ (M + np.triu(M, 1).T) @ there).diagonal())
    assert load_inertias(result) == pytest.approx(largest, rel=1e-12)
    told = next(e for e in explain(scene).effects if e.name == "couples")
    assert (told.on, told.why) == (True, "actuators[1].couples (j2)")
    assert told.peak_change != 0.0
    with pytest.raises(PinfricError, match="the drive 'j2' is coupled with another joint"):
        pf.export(scene)


def _wrist() -> pin.Model:
    """Four joints: upright, two across, along the last link."""
    bodies = [
        (pin.JointModelRZ(), (0, 0, 0.3), 4.0, (0.02, 0, 0.1), (0.03, 0.04, 0.05)),
        (pin.JointModelRY(), (0, 0, 0.2), 3.0, (0.2, 0.01, 0), (0.01, 0.05, 0.045)),
        (pin.JointModelRY(), (0.4, 0, 0), 2.0, (0.15, 0, 0.02), (0.008, 0.02, 0.025)),
        (pin.JointModelRX(), (0.3, 0, 0.02), 1.2, (0.05, 0.03, -0.02), (0.004, 0.006, 0.005)),
    ]
    return chain(
        *(
            (f"j{n}", kind, pin.Inertia(mass, np.array(com, float), np.diag(inertia)), place)
            for n, (kind, place, mass, com, inertia) in enumerate(bodies, 1)
        )
    )


def _something_holds(
    S: np.ndarray, gravity: np.ndarray, most: np.ndarray, ratio: np.ndarray, torque: np.ndarray
) -> bool:
    """Whether efforts u exist, each held by its worm, and friction, that balance gravity.

    A worm of efficiency 0.7 that nothing drives back holds x = u / ratio for motor torques from 0
    to x / 0.7, widened by 0.02 N m: linear for each choice of the signs of x.
    """
    for signs in product((1.0, -1.0), repeat=4):
        rows, bounds = [], []
        for i, sign in enumerate(signs):
            x = np.zeros(8)
            x[i] = sign / ratio[i]
            rows += [-x, -x / 0.7]
            bounds += [0.0, 0.02 - sign * torque[i]]
            if sign * torque[i] < -0.02:
                rows.append(0 * x)
                bounds.append(-1.0)
        found = linprog(
            np.zeros(8),
            A_ub=np.array(rows),
            b_ub=bounds,
            b_eq=gravity,
            A_eq=np.hstack([S.T, np.eye(4)]),
            bounds=[(None, None)] * 4 + [(-f, f) for f in most],
        )
        if found.status == 0:
            return True
    return False


@pytest.mark.parametrize(
    ("q", "torque"),
    [
        (
            (-0.629198, 0.63182042, -1.52974933, 0.58649888),
            (0.04366365, 0.4752141, -0.02715205, 0.10457133),
        ),
        (
            (-1.33137549, -0.01821387, -0.47555035, -1.36471367),
            (0.1070537, 0.38480338, -0.26479378, 0.09757029),
        ),
        (
            (0.735286691243179, 0.37541423630285253, 0.48453662476500625, 1.458235566779575),
            (0.13083736386044004, 0.5718054253571943, 0.02803052705379918, 0.004354420561207932),
        ),
        ((0.2, 1.5707963, 0.0, 0.3), (0.0, 0.05, -0.05, 0.0)),
    ],
)
def test_coupled_worms_hold_where_something_holds(
    q: tuple[float, ...], torque: tuple[float, ...]
) -> None:
    """Against linear programs; an unbounded limit hid what the others cannot hold."""
    most, ratio = np.array([4.0, 5.0, 2.0, 1.0]), np.array([60.0, -60.0, 60.0, -60.0])
    gear = {
        "efficiency": 0.7,
        "back_efficiency": 0.0,
        "no_load_torque": 0.02,
        "rotor_inertia": 1e-4,
    }
    names = [f"j{n}" for n in range(1, 5)]
    scene = pf.Scene(
        _wrist(),
        friction={name: dry(f, 0.7 * f) for name, f in zip(names, most, strict=True)},
        actuators=[
            {
                "joint": name,
                "couples": {"j2": -0.45} if name == "j4" else {},
                "transmission": {"ratio": r, **gear},
            }
            for name, r in zip(names, ratio, strict=True)
        ],
    )
    S, state = np.eye(4), np.array(q)
    S[3, 1] = -0.45
    gravity = pin.computeGeneralizedGravity(scene.model, scene.model.createData(), state)
    holds = _something_holds(S, gravity, most, ratio, np.array(torque))
    found = pf.forward_dynamics(scene, state, np.zeros(4), motor_torque=np.array(torque))
    assert (np.abs(found.a).max() < 1e-9) == holds
    assert pf.holds(scene, state, motor_torque=np.array(torque)).held == holds


@pytest.mark.parametrize("method", ["event", "timestepping"])
def test_joints_that_coupled_gears_hold_between_them_stand_exactly(method: str) -> None:
    """Motors turn by n1 (q1 + c q2), n2 (q2 + d q1): both held, both joints are; q3 swings."""
    model = _planar()
    third = model.addJoint(2, pin.JointModelRZ(), shifted(0.3), "j3")
    body = lump(1.0, [0.2, 0.1, 0.0])
    model.appendBodyToJoint(third, body, pin.SE3.Identity())
    model.gravity.linear = np.array([0.0, -1.0, 0.0])
    gear = {"efficiency": 0.7, "back_efficiency": 0.5, "no_load_torque": 0.5}
    scene = pf.Scene(
        model,
        actuators=[
            {"joint": "j1", "couples": {"j2": 0.3}, "transmission": gear | {"ratio": 50.0}},
            {"joint": "j2", "couples": {"j1": -0.7}, "transmission": gear | {"ratio": -80.0}},
            {"joint": "j3", "transmission": {"ratio": 1.0}},
        ],
    )
    found = pf.simulate(
        scene,
        [0.3, 0.2, 0.5],
        [0.2, -0.3, 1.0],
        t_end=0.2,
        method=method,
        motor_torque=[0.0, 0.0, 0.0],
    )
    assert [event.kind for event in found.events] == ["stick", "stick"]
    held = found.t > found.events[1].time
    assert held.sum() > 100
    assert np.abs(found.v[held, 2]).min() > 0.5
    assert not found.v[held, :2].any()
    assert not found.a[held, :2].any()
