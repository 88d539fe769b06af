"""Coupled inverse dynamics against closed forms, an independent program, and itself."""

import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import example, sliding_block
from cases import (
    Case,
    crank_motion,
    decelerating_drawer,
    drawer_forces,
    drawer_scene,
    hinged_weight,
    jamming_drawer,
    slider_crank,
    turning_four_bar,
)
from judges.planar_newton_euler import PINS, FourBar, crank_torque
from judges.verdict import judge
from mechanisms import (
    FOUR_BAR,
    LENGTHS,
    MASSES,
    add_link,
    bar,
    four_bar,
    grounded_model,
    pin_friction,
)
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.inverse.choices import friction_laws
from pinfric.dynamics.inverse.interval_ends import choice_of_sample
from pinfric.dynamics.inverse.solutions import one_sample
from pinfric.dynamics.samples.outcome import Status
from pinfric.friction.given_modes import fixed_point, newton

ROBOTS = Path(__file__).parents[3] / "robots"


# ---------------------------------------------------------------- the four-bar


@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
@pytest.mark.parametrize("rate", [6.28, -6.28, 1e3])
def test_four_bar_against_newton_and_euler_bar_by_bar(kind, rate):
    case = turning_four_bar(60, "B", kind, rate)
    result = case.inverse()
    expected = [crank_torque(FourBar(), angle, rate, 3.0) for angle in case.known["angles"]]
    slides = ~result.reversal.any(axis=1) & ~result.sticking.any(axis=1)
    assert slides.sum() > 55
    torque = np.array([torque for torque, _, _ in expected])
    scale = max(1.0, (rate / 6.28) ** 2)  # inertia forces grow with the speed squared
    for effort in (result.effort_lower[:, 0], result.effort_upper[:, 0]):
        assert_allclose(effort[slides], torque[slides], rtol=0, atol=1e-9 * scale)
    for pin_name in PINS:
        s = result.site_names.index(pin_name)
        forces = np.array([np.hypot(*forces[pin_name]) for _, forces, _ in expected])
        assert_allclose(
            result.normal_load[slides, s], 0.01 * forces[slides], rtol=1e-9, atol=1e-12 * scale
        )


def test_four_bar_without_friction_against_newton_and_euler():
    case = turning_four_bar(50)
    expected = [crank_torque(FourBar(mu=0.0), x, 6.28, 3.0)[0] for x in case.known["angles"]]
    assert_allclose(case.inverse().effort_frictionless[:, 0], expected, atol=1e-12)


def bar_power(q, v, a, joints_to_bars, gravity):
    """Rate of kinetic and potential energy of the three bars, from their own motion."""
    angle, rate, acceleration = (joints_to_bars(x) for x in (q, v, a))
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    power = np.zeros(len(q))
    for b, name in enumerate(("crank", "coupler", "rocker")):
        length, mass = LENGTHS[name], MASSES[name]
        velocity = 0.5 * length * across[:, b] * rate[:, b, None]
        swing = across[:, b] * acceleration[:, b, None] - along[:, b] * rate[:, b, None] ** 2
        push = 0.5 * length * swing - np.array(gravity)
        if name == "coupler":
            velocity = velocity + 0.1 * across[:, 0] * rate[:, 0, None]
            start = across[:, 0] * acceleration[:, 0, None] - along[:, 0] * rate[:, 0, None] ** 2
            push = push + 0.1 * start
        power += mass * (velocity * push).sum(axis=1)
        power += mass * length**2 / 12 * rate[:, b] * acceleration[:, b]
    return power


def test_four_bar_the_cranks_power_is_energy_and_the_pins_losses():
    case = turning_four_bar(300)
    result = case.inverse()

    def to_bars(x):  # the tree is crank, coupler (on the crank), rocker
        names = list(case.scene.joint_names)
        crank, coupler, rocker = (x[:, names.index(n)] for n in "OAC")
        return np.column_stack([crank, crank + coupler, rocker])

    slides = ~result.reversal.any(axis=1)
    given = result.effort_lower[:, 0] * to_bars(case.v)[:, 0]
    energy = bar_power(case.q, case.v, case.a, to_bars, (0.0, -9.81))
    rates = to_bars(case.v)
    slip = {
        "O": rates[:, 0],
        "A": rates[:, 1] - rates[:, 0],
        "B": rates[:, 2] - rates[:, 1],
        "C": rates[:, 2],
    }
    loss = sum(
        0.3 * result.normal_load[:, s] * np.abs(slip[name])
        for s, name in enumerate(result.site_names)
    )
    rest = np.abs(given - energy - loss)[slides]
    assert rest.max() <= 1e-10 * np.abs(given).max()
    assert loss.max() > 0.05 * np.abs(given).max()  # friction matters here


@pytest.mark.parametrize("bearing", [{}, {"length": 0.02, "thrust_radius": 0.008}])
@pytest.mark.parametrize(
    ("kind", "gravity"),
    [
        ("planar_pin", (0.0, -9.81, 0.0)),
        ("revolute", (0.0, -9.81, 0.0)),
        ("revolute", (1.0, -8.0, 5.0)),
    ],
)
def test_every_cut_of_the_four_bar_gives_the_same_efforts(kind, gravity, bearing):
    """Also where the closure is redundant, gravity is tilted and pins carry moments."""
    if kind == "planar_pin" and bearing:
        pytest.skip("a planar_pin carries no moment")
    friction = {
        "bearing": {"kind": "pin", "radius": 0.01, **bearing},
        "mu": {"static": 0.35, "kinetic": 0.3},
    }
    results = {}
    for cut in FOUR_BAR:
        case = turning_four_bar(16, cut, kind, gravity=gravity, friction=friction)
        results[cut] = result = case.inverse()
        assert result.redundant == (kind == "revolute")
        assert judge(result).passed(1e-12)
    first = results["O"]
    for result in results.values():
        for name in ("effort_lower", "effort_upper", "effort_frictionless"):
            assert_allclose(getattr(result, name), getattr(first, name), atol=1e-9)
        order = [result.site_names.index(name) for name in first.site_names]
        assert_allclose(result.normal_load[:, order], first.normal_load, atol=1e-11)


@pytest.mark.parametrize("level", [{"coupler": 0.03, "rocker": -0.02}, {}])
def test_redundant_reactions_are_those_of_least_squares(level):
    """Any other multipliers that balance the same have a larger sum over all joints.

    Where bars lie above each other, the forces that balance their weights tilt the pins, too.
    """
    length, gravity = 0.05, (1.0, -8.0, 5.0)
    scene, joints = four_bar(
        "B", "revolute", gravity=gravity, level=level, redundancy_length=length
    )
    q, v, a = crank_motion(joints, np.linspace(0.3, 5.9, 7))
    result = pf.inverse_dynamics(scene, q, v, a)
    weight = np.array([1, 1, 1, *[1 / length**2] * 3])
    linkage, samples = result.scene.linkage, one_sample(result, 3)[1]
    order = [list(scene.joint_names).index(n) for n in result.site_names[:3]]
    wrenches = np.zeros((4, 6))
    wrenches[[*order, 3]] = result.wrench[3]
    rows = samples.X[0][:, :, linkage.lambdas]  # change of every joint's wrench
    J = np.array([[0.0] * 3] * 5)
    for j, row in enumerate(range(3)):
        axis = scene.twin().axis[row]
        J[:, j] = -(axis @ rows[row])
    passive = [i for i, name in enumerate(scene.joint_names) if name != "O"]
    _, size, right = np.linalg.svd(J[:, passive].T)
    null = right[np.sum(size > 1e-9) :]
    assert len(null) == 3  # three too many
    slopes = np.einsum("jek,nk->nje", rows, null)
    first_order = np.einsum("nje,e,je->n", slopes, weight, wrenches)
    assert np.abs(first_order).max() < 1e-10 * np.einsum("je,e,je->", wrenches, weight, wrenches)


# ---------------------------------------------------------------- slider-crank, drawer, cylinders


def test_slider_crank_against_its_closed_form():
    case = slider_crank(np.linspace(0.05, 6.2, 150))
    result = case.inverse()
    slides = ~result.reversal.any(axis=1)
    for i in np.flatnonzero(slides):
        known = case.known["torque"][i]
        assert len(known) == 1
        assert result.effort_lower[i, 0] == pytest.approx(known[0], rel=1e-10, abs=1e-12)
    assert judge(result).passed(1e-12)


@pytest.mark.parametrize("acceleration", [0.0, 1.0, -2.0])
@pytest.mark.parametrize("mu", [0.0, 0.1, 0.3, 0.49, 0.5 - 1e-6])
def test_drawer_below_its_critical_mu_against_its_closed_form(mu, acceleration):
    result = jamming_drawer(mu, acceleration).inverse()
    (expected,) = drawer_forces(mu, acceleration)
    assert result.status[0] == Status.CONVERGED
    assert result.effort_lower[0, 0] == pytest.approx(expected, rel=1e-8)  # 1/(1 - mu/critical)
    assert result.effort_upper[0, 0] == result.effort_lower[0, 0]
    assert judge(result).passed(1e-9)


@pytest.mark.parametrize("mu", [0.2, 0.5 - 1e-6, 0.5 + 1e-6, 2.0])
def test_drawers_critical_mu_is_length_over_twice_the_offset(mu):
    result = jamming_drawer(mu).inverse()
    assert mu * result.critical_mu[0] == pytest.approx(0.3 / (2 * 0.3), rel=1e-12)
    jams = mu > 0.5
    assert result.status[0] == (Status.JAMMED if jams else Status.CONVERGED)
    assert np.isnan(result.effort_lower[0, 0]) == jams
    assert len(result.solutions(0)) == (0 if jams else 1)


@pytest.mark.slow
def test_a_second_solution_that_newton_misses_from_rest_and_far_out_is_found():
    """A ring of five pins, three of them with friction; two states obey."""
    height = [-0.0967089515, 0.0478765526, 0.3418381237, 0.1411391439, -0.0616641828]
    place = np.column_stack([0.3 * np.arange(5), height])
    gravity = 9.0153110924, -8.0129454118, 0.0
    model, parent, turned, at = grounded_model(gravity), 0, 0.0, place[0]
    q = []
    for k, mass in enumerate([0.9610563018, 5.5600508755, 0.1914113952, 4.9825390311]):
        along = place[k + 1] - place[k]
        length, angle = np.hypot(*along), np.arctan2(along[1], along[0])
        start = pin.SE3(np.eye(3), np.array([*at, 0.0]))
        parent = add_link(model, parent, pin.JointModelRZ(), start, f"p{k}", bar(mass, length))
        q.append(angle - turned)
        turned, at = angle, np.array([length, 0.0])
    at_end, on_ground = [*at, 0.0], [*place[4], 0.0]
    ends = {"a": {"link": "p3", "xyz": at_end}, "b": {"link": "ground", "xyz": on_ground}}
    radius = {"p0": 0.0475957602, "p2": 0.0202658341, "L": 0.0669774954}
    scene = pf.Scene(
        model=model,
        friction={name: pin_friction(1.2251227851, r) for name, r in radius.items()},
        loops=[{"name": "L", "kind": "planar_pin", **ends}],
        actuators=[{"joint": "p0"}, {"joint": "p1"}],
    )
    q = scene.close(np.array(q))
    rates, accelerations = [[0.796784408, -1.352419026]], [[7.778423898, -13.656162439]]
    v, a = pf.consistent_motion(scene, q[None], ["p0", "p1"], rates, accelerations)
    result = pf.inverse_dynamics(scene, q, v, a)
    assert result.status[0] == Status.AMBIGUOUS
    efforts = [solution.effort for solution in result.solutions(0)]
    assert np.abs(efforts[0] - efforts[1]).max() > 10.0
    for effort in efforts:  # each causes the motion
        back = pf.forward_dynamics(scene, q, v[0], effort)
        assert_allclose(back.a, a[0], rtol=1e-8)
    assert judge(result).passed()


def test_a_decelerating_drawer_beyond_its_critical_mu_has_two_solutions():
    result = decelerating_drawer().inverse()
    assert result.status[0] == Status.AMBIGUOUS
    efforts = sorted(solution.effort[0] for solution in result.solutions(0))
    assert efforts == pytest.approx([-5.5365, 141.9002], abs=1e-4)
    assert efforts == pytest.approx(drawer_forces(0.6, -7.5), rel=1e-12)
    assert (result.effort_lower[0, 0], result.effort_upper[0, 0]) == pytest.approx(tuple(efforts))
    assert not result.interval_exact[0]
    assert judge(result).passed(1e-12)
    for solution in result.solutions(0):
        assert solution.friction[0] == pytest.approx(-0.6 * solution.normal_load[0])


def test_the_site_that_jams_is_named():
    assert jamming_drawer(0.7).inverse().jamming_site(0) == "drawer"
    friction = {name: pin_friction(0.3, 0.08 if name == "A" else 0.001) for name in "OABC"}
    case = turning_four_bar(3)
    scene = pf.Scene(
        model=case.scene.model,
        friction=friction,
        loops=case.scene.loops,
        actuators=case.scene.actuators,
    )
    result = Case(scene, case.q, case.v, case.a).inverse()
    assert [result.jamming_site(i) for i in range(3)] == ["A"] * 3
    bare = pf.Scene(model=case.scene.model, loops=case.scene.loops, actuators=[{"joint": "O"}])
    assert Case(bare, case.q, case.v, case.a).inverse().jamming_site(0) is None


def test_a_drawer_at_rest_is_held_between_closed_form_limits():
    """|F| = mu_s sqrt((m g)^2 + (2 F e / L)^2) at both ends."""
    static, weight = 0.4, 4.0 * 9.81
    one = np.ones((1, 1))
    result = Case(drawer_scene(0.3, static), 0 * one, 0 * one, 0 * one).inverse()
    limit = static * weight / np.sqrt(1 - (2 * static) ** 2)
    assert result.effort_upper[0, 0] == pytest.approx(limit, rel=1e-12)
    assert result.effort_lower[0, 0] == pytest.approx(-limit, rel=1e-12)
    assert result.interval_exact[0]
    # beyond the critical mu it locks itself: friction holds against any push, no end is finite
    locked = Case(drawer_scene(0.3, 0.6), 0 * one, 0 * one, 0 * one).inverse()
    assert locked.status[0] == Status.JAMMED
    assert np.isnan(locked.effort_upper[0, 0])


def test_a_cylinder_against_its_lever_with_the_pins_friction():
    """-u h = m g c + mu R |F_pin|, F_pin from cylinder, weight and centripetal force, by hand."""
    line, mu, radius = 0.05, 0.2, 0.02
    case = hinged_weight(line)
    result = case.inverse()
    weight = 2.0 * 9.81
    # the ram lies at y = line, along x: pushing to the right turns clockwise, lever = line
    u = -weight * 0.3 / line
    for _ in range(200):
        u = -(weight * 0.3 + mu * radius * np.hypot(-u - 2.0 * 0.5**2 * 0.3, weight)) / line
    assert result.effort_lower[0, 0] == pytest.approx(u, rel=1e-12)


def excavator():
    return example(ROBOTS / "excavator.yaml", ROBOTS / "excavator.waypoints.yaml")


def test_excavators_cylinders_without_friction_are_virtual_work():
    """Each cylinder turns one pin: u = tau / (dL/dq), dL/dq by the sine of the triangle."""
    scene, motion = excavator()
    result = pf.inverse_dynamics(scene, motion)
    pivots = {
        "boom_cylinder": ("boom_pin", "house"),
        "stick_cylinder": ("stick_pin", "boom"),
        "bucket_cylinder": ("bucket_pin", "stick"),
    }
    parts = {d.cylinder.name: d.cylinder for d in scene.actuators}
    for i in range(0, len(motion.t), 50):
        carried = ["soil"] if motion.attached[i, 0] else []
        model = scene.loaded_model(carried)
        data = model.createData()
        tau = pin.rnea(model, data, motion.q[i], motion.v[i], motion.a[i])
        for d, name in enumerate(result.actuator_names):
            joint, parent = pivots[name]
            j = model.getJointId(joint)
            a, b = np.array(parts[name].a.xyz), np.array(parts[name].b.xyz)
            assert parts[name].a.link == parent
            a = a - model.jointPlacements[j].translation  # both from the pin, parent's axes
            angle = motion.q[i, model.joints[j].idx_q]
            turn = np.array(
                [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
            )
            b = turn @ b
            swing = np.cross([0.0, -1.0, 0.0], b)  # db/dq, the axis is -y
            rate = (b - a) @ swing / np.linalg.norm(b - a)
            expected = tau[model.joints[j].idx_v] / rate
            assert result.effort_frictionless[i, d] == pytest.approx(expected, rel=1e-10)
            assert result.actuator_velocity[i, d] == pytest.approx(
                rate * motion.v[i, model.joints[j].idx_v], rel=1e-10, abs=1e-14
            )


def test_excavator_power_is_work_and_friction():
    scene, motion = excavator()
    result = pf.inverse_dynamics(scene, motion)
    slides = ~(result.sticking | result.reversal).any(axis=1)
    given = (result.effort_lower * result.actuator_velocity).sum(axis=1)
    useful = (result.effort_frictionless * result.actuator_velocity).sum(axis=1)
    loss = 0.10 * (result.normal_load * np.abs(motion.v)).sum(axis=1)
    rest = np.abs(given - useful - loss)[slides]
    assert rest.max() <= 1e-10 * np.abs(given).max()
    assert slides.sum() > 1000


def test_a_geared_cylinder_has_its_own_velocity_and_acceleration():
    """Motor torque of a screw: effort / ratio + J ratio L'', L'' against differences of L'."""
    scene, motion = excavator()
    screw = {"ratio": 600.0, "rotor_inertia": 1e-3}
    actuators = [
        a.model_copy(update={"transmission": None}).model_dump(exclude_none=True)
        | {"transmission": screw}
        for a in scene.actuators
    ]
    geared = pf.Scene(model=scene.model, actuators=actuators, payloads=scene.payloads)
    with_inertia = pf.inverse_dynamics(geared, motion)
    L_rate = with_inertia.actuator_velocity
    inertia = with_inertia.motor_torque_lower - with_inertia.effort_lower / 600.0
    acceleration = np.gradient(L_rate, motion.t, axis=0)
    steps = slice(100, -100)
    size = 600.0 * 1e-3 * np.abs(acceleration).max()
    assert_allclose(inertia[steps], 600.0 * 1e-3 * acceleration[steps], atol=0.005 * size)


# ---------------------------------------------------------------- what holds always


def test_balls_reverse_with_the_arms_that_turn_them():
    """A delta's arms, and with them its balls, whose axes differ, reverse between two samples."""
    scene = pf.load_scene("delta")
    arms = ["arm_1", "arm_2", "arm_3"]
    columns = [scene.joint_names.index(name) for name in arms]
    way, t = np.array([10.0, -6.0, 3.0]), 0.004 * (np.arange(6) - 2.7)
    q = np.tile(pf.load_trajectory("delta", scene).q[0], (6, 1))
    q[:, columns] += np.outer(0.5 * t**2, way)
    q = np.array([scene.close(row, arms) for row in q])
    v, a = pf.consistent_motion(scene, q, arms, np.outer(t, way), np.tile(way, (6, 1)))
    result = pf.inverse_dynamics(scene, q, v, a, t=t)
    assert not result.sticking.any()
    assert (result.reversal == (np.arange(6) == 3)[:, None]).all()  # 1.2 ms after; 2.8 before
    assert (result.effort_upper > result.effort_lower + 0.1).any(axis=1).tolist() == [
        False,
        False,
        False,
        True,
        False,
        False,
    ]


def test_chunks_threads_and_pickles_change_nothing():
    case = turning_four_bar(1300, friction=pin_friction(0.3, 0.01, static=0.4))
    t = np.linspace(0, 1, 1300)
    whole = pf.inverse_dynamics(case.scene, case.q, case.v, case.a, t=t)
    pieces = list(pf.inverse_dynamics(case.scene, case.q, case.v, case.a, t=t, chunks=111))
    names = (
        "effort_lower",
        "effort_upper",
        "wrench",
        "reversal",
        "multipliers",
        "status",
        "friction_lower",
        "contraction",
        "interval_exact",
        "actuator_velocity",
    )
    for name in names:
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        assert_array_equal(joined, getattr(whole, name))
    again = pickle.loads(pickle.dumps(case.scene))
    copy = pf.inverse_dynamics(again, case.q, case.v, case.a, t=t, threads=1)
    assert_array_equal(copy.effort_lower, whole.effort_lower)


def test_check_sees_every_wrong_figure():
    case = turning_four_bar(8, "B", "revolute", friction=pin_friction(0.3, 0.01, length=0.02))
    result = case.inverse()
    error = 1e-6 * judge(result).scale
    for name in (
        "effort_lower",
        "effort_upper",
        "effort_frictionless",
        "friction_lower",
        "friction_upper",
        "normal_load",
        "wrench",
        "multipliers",
    ):
        array = getattr(result, name)
        array[2, 0] += error
        assert not judge(result).passed(1e-9), name
        array[2, 0] -= error
    assert judge(result).passed(1e-12)


def test_external_wrenches_and_payloads_act_in_loops():
    box = {"link": "coupler", "mass": 3.0, "com": [0.1, 0.05, 0], "attached": False}
    scene, joints = four_bar(payloads={"box": box})
    q, v, a = crank_motion(joints, np.linspace(0.3, 5.9, 20))
    attached = (np.arange(20) >= 10)[:, None]
    wrench = np.tile([1.0, -20.0, 0, 0, 0, 0.5], (20, 1))
    result = pf.inverse_dynamics(scene, q, v, a, {"coupler": wrench}, attached=attached)
    assert judge(result).passed(1e-12)
    # the drive's share of virtual work: external power + frictionless effort x rate = without
    plain = pf.inverse_dynamics(scene, q, v, a, attached=attached)
    data, frame = scene.model.createData(), scene.model.getFrameId("coupler")
    for i in range(20):
        pin.forwardKinematics(scene.model, data, q[i], v[i])
        twist = pin.getFrameVelocity(scene.model, data, frame, pin.ReferenceFrame.LOCAL).vector
        less = plain.effort_frictionless[i, 0] - result.effort_frictionless[i, 0]
        crank = v[i, list(scene.joint_names).index("O")]
        assert less * crank == pytest.approx(wrench[i] @ twist, rel=1e-10)


def test_open_chains_do_not_come_here(monkeypatch):
    from builders import plane_friction

    import pinfric.dynamics.inverse.inverse as module

    monkeypatch.setattr(module, "solve_linkage", None)
    scene = sliding_block(plane_friction(0.5, 0.3))
    result = pf.inverse_dynamics(scene, [[0.0]], [[1.0]], [[0.0]])
    assert result.interval_exact.all()
    assert (result.multipliers, result.redundant) == (None, False)
    assert result.critical_mu[0] == np.inf
    (solution,) = result.solutions(0)
    assert solution.effort == pytest.approx(result.effort_lower[0])


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "drawer", "excavator", "delta"])
def test_bundled_mechanisms_run_and_check(name):
    scene, motion = example(ROBOTS / f"{name}.yaml", ROBOTS / f"{name}.waypoints.yaml")
    result = pf.inverse_dynamics(scene, motion)
    assert (result.status == Status.CONVERGED).all()
    assert motion.warnings == ()
    few = slice(0, len(motion.t), max(1, len(motion.t) // 40))
    part = pf.inverse_dynamics(
        scene, motion.q[few], motion.v[few], motion.a[few], attached=motion.attached[few]
    )
    assert judge(part).passed(1e-10), judge(part)
    sliding = ~(result.sticking | result.reversal).any(axis=1)
    power = (result.effort_lower * result.actuator_velocity).sum(axis=1)
    useful = (result.effort_frictionless * result.actuator_velocity).sum(axis=1)
    assert (power[sliding] >= useful[sliding] - 1e-9 * np.abs(power).max()).all()


# ---------------------------------------------------------------- iterations


def test_iterations_of_fixed_point_and_newton_up_to_the_jam(capsys):
    """The fixed point's passes grow like 1 / (1 - contraction), Newton's do not."""
    rows = []
    for mu in (0.05, 0.1, 0.2, 0.3, 0.4, 0.45, 0.49, 0.499, 0.4999):
        result = jamming_drawer(mu, 1.0).inverse()
        plan, samples = one_sample(result, 0)
        law = friction_laws(plan, samples)
        reduced = choice_of_sample(plan, samples, law, law.code[0])[2]
        z, w = np.zeros(1), np.zeros(1)
        slow = fixed_point(reduced, z, 1e-13)
        error, fast = newton(reduced, w, True)
        assert error <= 1e-13
        if slow < 5000:
            assert z[0] == pytest.approx(w[0], rel=1e-8)
        rows.append((mu, float(result.contraction[0]), slow, fast))
    with capsys.disabled():
        print("\ndrawer, critical mu 0.5: passes to a relative residual of 1e-13")
        print("    mu  contraction  fixed point  Newton")
        for mu, contraction, slow, fast in rows:
            print(f"{mu:6.4f}  {contraction:11.4f}  {slow:>11}  {fast:6d}")
    assert all(fast <= 12 for *_, fast in rows)
    assert [slow for _, _, slow, _ in rows] == sorted(slow for _, _, slow, _ in rows)
    assert rows[-3][2] > 500
