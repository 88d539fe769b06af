"""Translational joints (18-22) and closed loops: closed forms, and the reduced formulation."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from builders import example

import pinfric as pf
from pinfric.errors import PinfricError
from pinfric.motions.joint_columns import joint_columns, single_positions
from pinfric.paper.bodies import (
    GROUND,
    Actuator,
    Body,
    GuideFriction,
    LoopPin,
    Mechanism,
    PinFriction,
    RevoluteJoint,
    TranslationalJoint,
)
from pinfric.paper.equations import place
from pinfric.paper.examples import slider_crank
from pinfric.paper.forward import forward
from pinfric.paper.inverse import inverse
from pinfric.paper.simulate import simulate

X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)


# ---------------------------------------------------------------- translational joints


def block_on_a_moving_body(mass=3.0, static=0.5, kinetic=0.4) -> Mechanism:
    """Fig. 2: body 1 on body 2, both moving along X; F acts on body 1 past the joints."""
    bodies = Body("body_2", 5.0, np.eye(3), ORIGIN), Body("body_1", mass, np.eye(3), ORIGIN)
    joints = (
        TranslationalJoint("rail", GROUND, "body_2", ORIGIN, X),
        TranslationalJoint(
            "contact", "body_2", "body_1", ORIGIN, X, GuideFriction(0.2, static, kinetic)
        ),
    )
    actuators = (
        Actuator("rail", GROUND, "body_2", ORIGIN, force=X, through="rail"),
        Actuator("F", GROUND, "body_1", ORIGIN, force=X),
    )
    return Mechanism(bodies, joints, (0.0, 0.0, -9.81), actuators)


@pytest.mark.parametrize("relative", [-0.3, 0.0, 0.7])
def test_a_block_on_a_moving_body_is_equations_18_to_22(relative):
    mass, weight = 3.0, 3.0 * 9.81
    v_2, a_2, a_relative = 1.5, 2.0, 0.0 if relative == 0 else -1.3
    found = inverse(block_on_a_moving_body(), [0.4, 0.1], [v_2, relative], [a_2, a_relative])
    a_1 = a_2 + a_relative
    sliding = np.full(2, 0.4 * np.sign(relative))
    ends = weight * (np.array([-0.5, 0.5]) if relative == 0 else sliding)  # (21), (20)
    lower, upper = found.effort_lower[0], found.effort_upper[0]
    assert [lower[1], upper[1]] == pytest.approx(mass * a_1 + ends, rel=1e-12)  # (19), (22)
    # body 2 is carried along by the friction, the opposite way
    assert [upper[0], lower[0]] == pytest.approx(5.0 * a_2 - ends, rel=1e-12)
    assert found.normal_load[0, 0] == pytest.approx(weight, rel=1e-13)
    assert found.sticking[0, 0] == (relative == 0)


def scene_of(mechanism: Mechanism) -> pf.Scene:
    """The same mechanism for the reduced formulation: its joint frames parallel to the ground."""
    model = pin.Model()
    model.gravity.linear = np.asarray(mechanism.gravity, float)
    model.addBodyFrame(GROUND, 0, pin.SE3.Identity(), 0)
    body = {b.name: b for b in mechanism.bodies}
    origin, ids = {GROUND: np.zeros(3)}, {GROUND: 0}
    for joint in mechanism.joints:
        slides, axis = isinstance(joint, TranslationalJoint), np.asarray(joint.axis, float)
        kind = pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned
        origin[joint.child] = np.asarray(joint.point, float)
        arm = pin.SE3(np.eye(3), origin[joint.child] - origin[joint.parent])
        made = kind(axis / np.linalg.norm(axis))
        ids[joint.child] = model.addJoint(ids[joint.parent], made, arm, joint.name)
        b = body[joint.child]
        com = np.asarray(b.center_of_mass) - origin[joint.child]
        inertia = pin.Inertia(b.mass, com, np.asarray(b.inertia, float))
        model.appendBodyToJoint(ids[joint.child], inertia, pin.SE3.Identity())
        frame = pin.Frame(joint.child, ids[joint.child], pin.SE3.Identity(), pin.FrameType.BODY)
        model.addFrame(frame)
    friction = {}
    for joint in mechanism.joints:
        given = dataclasses.asdict(joint.friction)
        mu = {name: given.pop(name) for name in ("static", "kinetic")}
        given.pop("stick_velocity")
        kind = "pin" if isinstance(joint.friction, PinFriction) else "guide"
        bearing = {"kind": kind} | {k: v for k, v in given.items() if v is not None}
        friction[joint.name] = {"bearing": bearing, "mu": mu}
    return pf.Scene(model=model, friction=friction)


def assert_both_agree(scene, mechanism, motion, ours=None):
    """Compare efforts, intervals, loads, reactions to 1e-9 of the largest; `ours`: q, v, a."""
    judge = inverse(mechanism, *motion)
    result = pf.inverse_dynamics(scene, *(motion if ours is None else ours))
    assert (result.status == 0).all()
    assert result.interval_exact.all()
    names = [joint.name for joint in (*mechanism.joints, *mechanism.loops)]
    joints = [names.index(site) for site in result.site_names]
    sites = [mechanism.geometry.sites.tolist().index(joint) for joint in joints]
    np.testing.assert_array_equal(result.sticking, judge.sticking[:, sites])
    pairs = {
        "lower": (result.effort_lower, judge.effort_lower),
        "upper": (result.effort_upper, judge.effort_upper),
        "frictionless": (result.effort_frictionless, judge.effort_frictionless),
        "load": (result.normal_load, judge.normal_load[:, sites]),
        "friction, lower": (result.friction_lower, judge.friction_lower[:, sites]),
        "friction, upper": (result.friction_upper, judge.friction_upper[:, sites]),
        "wrench": (result.wrench, judge.wrench[:, joints]),
    }
    for name, (found, expected) in pairs.items():
        within = 1e-9 * np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=within, err_msg=name)
    return judge


def test_the_drawer_pushed_at_its_corner_against_pinfric():
    """A guide that turns a couple into load, and a load that depends on the effort."""
    guide = GuideFriction(0.3, static=0.5, kinetic=0.4)
    drawer = Body("drawer", 4.0, np.diag([0.06, 0.04, 0.1]), ORIGIN)
    slide = TranslationalJoint("slide", GROUND, "drawer", ORIGIN, X, guide)
    push = Actuator("push", GROUND, "drawer", (-0.15, 0.2, 0.0), force=X)
    mechanism = Mechanism((drawer,), (slide,), (0.0, 0.0, -9.81), (push,))
    rate = np.array([0.3, -0.3, 0.0, 0.0, 0.2])
    acceleration = np.array([1.0, 1.0, 0.0, 0.0, -0.5])
    motion = (np.linspace(0, 0.3, 5)[:, None], rate[:, None], acceleration[:, None])
    scene = pf.load_scene("drawer")
    judge = assert_both_agree(scene, mechanism, motion)
    assert judge.iterations.min() > 5  # it is solved, not read off
    assert judge.effort_upper[2, 0] - judge.effort_lower[2, 0] > 30

    simulated = simulate(
        mechanism, [0.0], [0.0], lambda t: 28.0 * np.sin(6.0 * np.array([t])), 0.8, sample_step=0.1
    )
    ours = pf.simulate(
        dataclasses.replace(scene, simulation=scene.simulation.model_copy(update={"t_end": 0.8}))
    )
    expected = simulated.stick_intervals("slide")
    found = [(one.start, one.end) for one in ours.stick_intervals()]
    assert len(expected) > 1
    np.testing.assert_allclose(found, expected, atol=1e-7)


def mixed_chain(seed: int) -> Mechanism:
    """Four bodies in a branching tree, turning and sliding about general axes."""
    rng = np.random.default_rng(seed)
    bodies, joints, placed = [], [], [GROUND]
    for k in range(4):
        half = rng.normal(size=(3, 3)) * 0.2
        bodies.append(
            Body(
                f"link_{k}",
                0.5 + rng.random(),
                half @ half.T + 0.05 * np.eye(3),
                rng.normal(size=3) * 0.3,
            )
        )
        place = (
            f"joint_{k}",
            placed[rng.integers(max(0, k - 1), k + 1)],
            f"link_{k}",
            rng.normal(size=3) * 0.3,
            rng.normal(size=3),
        )
        if (k + seed) % 2:
            width = 0.2 + rng.random()
            friction = GuideFriction(0.3, static=0.2, kinetic=0.15, width=width)
            joints.append(TranslationalJoint(*place, friction))
        else:
            length = None if k == 2 else 0.1
            joints.append(RevoluteJoint(*place, PinFriction(0.03, length, 0.35, 0.3)))
        placed.append(f"link_{k}")
    return Mechanism(tuple(bodies), tuple(joints), (1.0, -2.0, -9.0))


@pytest.mark.parametrize("seed", range(6))
def test_trees_of_both_kinds_of_joint_against_pinfric(seed):
    mechanism = mixed_chain(seed)
    motion = np.random.default_rng(100 + seed).uniform(-1.5, 1.5, (3, 30, 4))
    motion[1:, 10:20] *= np.random.default_rng(seed).random((10, 4)) < 0.5  # some at rest
    motion[1:, 20] = 0.0
    judge = assert_both_agree(scene_of(mechanism), mechanism, motion)
    assert judge.sticking[20].all()
    assert not judge.sticking[:10].any()


@pytest.mark.parametrize("seed", range(6))
def test_what_sticks_on_moving_links_stays_forward_as_inverse(seed):
    """A joint at rest on links that turn keeps its place although its axis accelerates."""
    mechanism = mixed_chain(seed)
    position, rate, acceleration = np.random.default_rng(200 + seed).uniform(-1.5, 1.5, (3, 4))
    stuck = [1 + seed % 2, 3]
    rate[stuck] = acceleration[stuck] = 0.0
    judge = inverse(mechanism, position, rate, acceleration)
    effort = (judge.effort_lower + judge.effort_upper)[0] / 2
    there = forward(mechanism, position, rate, effort)
    size = 1e-9 * max(1.0, np.abs(judge.wrench).max())
    np.testing.assert_array_equal(there.modes, np.sign(rate))
    np.testing.assert_allclose(there.acceleration, acceleration, atol=size)
    np.testing.assert_allclose(there.wrench, judge.wrench[0], atol=size)
    ours = pf.forward_dynamics(scene_of(mechanism), position, rate, effort)
    np.testing.assert_allclose(ours.a, there.acceleration, atol=size)
    np.testing.assert_allclose(ours.wrench, there.wrench, atol=size)


# ---------------------------------------------------------------- closed loops


def four_bar() -> Mechanism:
    """The bundled scene `four_bar`, number by number."""
    friction = PinFriction(0.01, None, static=0.35, kinetic=0.30)
    bars = {"crank": (0.5, 0.0, 0.1), "coupler": (1.2, 0.1, 0.35), "rocker": (0.9, 0.3, 0.25)}
    across = {
        "crank": (3.333333333e-5, 4.166666667e-4),
        "coupler": (8e-5, 0.01225),
        "rocker": (6e-5, 0.0046875),
    }
    bodies = tuple(
        Body(
            name,
            mass,
            np.diag([across[name][0], *[across[name][1]] * 2]),
            (start + length / 2, 0.0, 0.0),
        )
        for name, (mass, start, length) in bars.items()
    )
    joints = (
        RevoluteJoint("crank_pin", GROUND, "crank", ORIGIN, Z, friction),
        RevoluteJoint("coupler_pin", "crank", "coupler", (0.1, 0.0, 0.0), Z, friction),
        RevoluteJoint("ground_pin", GROUND, "rocker", (0.3, 0.0, 0.0), Z, friction),
    )
    loop = LoopPin("rocker_pin", "coupler", "rocker", (0.45, 0, 0), (0.55, 0, 0), Z, friction)
    drive = Actuator("crank_pin", GROUND, "crank", ORIGIN, torque=Z, through="crank_pin")
    return Mechanism(bodies, joints, (0.0, -9.81, 0.0), (drive,), (loop,))


def bundled(name, mechanism, samples):
    """A bundled scene, its own motion (q, v, a), and the same for the mechanism."""
    scene, motion = example(name, f"{name}.waypoints.yaml")
    every = slice(None, None, len(motion.t) // samples)
    q, v, a = motion.q[every], motion.v[every], motion.a[every]
    columns = {c.name: c for c in joint_columns(scene.model, name)}
    position = single_positions(q, [c.nq for c in columns.values()])
    order = [list(columns).index(joint.name) for joint in mechanism.joints]
    return scene, (q, v, a), [values[:, order] for values in (position, v, a)]


CLOSED = {"slider_crank": slider_crank, "four_bar": four_bar}


@pytest.mark.parametrize("name", CLOSED)
def test_a_closed_loop_against_pinfric_moving_and_at_rest(name):
    mechanism = CLOSED[name]()
    scene, ours, motion = bundled(name, mechanism, samples=150)
    judge = assert_both_agree(scene, mechanism, motion, ours)
    at_rest = judge.sticking.all(axis=1)
    assert 10 < at_rest.sum() < 100
    assert not judge.sticking[~at_rest].any()
    assert (judge.effort_upper > judge.effort_lower + 1e-3)[at_rest].all()
    assert judge.iterations.max() > 5  # the loads depend on the friction


@pytest.mark.parametrize("name", CLOSED)
def test_forward_dynamics_of_a_closed_loop_in_motion(name):
    mechanism = CLOSED[name]()
    scene, (configuration, *_), (q, v, a) = bundled(name, mechanism, samples=12)
    names = [joint.name for joint in mechanism.joints]
    order = [names.index(name) for name in scene.joint_names]
    judge = inverse(mechanism, q, v, a)
    slides = np.flatnonzero(~judge.sticking.any(axis=1))
    assert len(slides) > 5
    for i in slides:
        there = forward(mechanism, q[i], v[i], judge.effort_lower[i])
        size = max(1.0, np.abs(a[i]).max())
        np.testing.assert_allclose(there.acceleration[:3], a[i], atol=1e-9 * size)
        np.testing.assert_allclose(there.wrench, judge.wrench[i], atol=1e-9 * size)
        ours = pf.forward_dynamics(scene, configuration[i], v[i, order], judge.effort_lower[i])
        np.testing.assert_allclose(ours.a, there.acceleration[order], atol=1e-9 * size)
    rest = np.flatnonzero(judge.sticking.all(axis=1))[0]
    with pytest.raises(PinfricError, match="joints at rest in a loop"):
        forward(mechanism, q[rest], v[rest], judge.effort_frictionless[rest])
    with pytest.raises(PinfricError, match="without loops"):
        simulate(mechanism, q[0], v[0], lambda _: [0.0], 0.1)


def test_the_loop_s_two_points_coincide_where_it_is_closed():
    mechanism = slider_crank()
    _, _, motion = bundled("slider_crank", mechanism, samples=20)
    q = place(mechanism, motion[0])
    end_of_rod = q.position[:, 1] + q.orientation[:, 1] @ [0.075, 0.0, 0.0]
    np.testing.assert_allclose(end_of_rod, q.position[:, 2], atol=1e-12)


@pytest.mark.parametrize("level", ["position", "rate", "acceleration"])
def test_a_motion_that_opens_its_loop_is_refused(level):
    mechanism = slider_crank()
    _, _, motion = bundled("slider_crank", mechanism, samples=20)
    motion[("position", "rate", "acceleration").index(level)][5, 1] += 1e-3
    with pytest.raises(PinfricError, match=f"loop piston_pin: the {level} of .* at sample 5"):
        inverse(mechanism, *motion)


def test_loops_and_guides_that_cannot_be_are_refused():
    mechanism = slider_crank()
    with pytest.raises(PinfricError, match="3 actuators for 1 degrees of freedom"):
        dataclasses.replace(mechanism, actuators=())
    twice = (*mechanism.loops, dataclasses.replace(mechanism.loops[0], name="again"))
    three = dataclasses.replace(mechanism, loops=(), actuators=())
    with pytest.raises(PinfricError, match="for -1 degrees of freedom"):
        dataclasses.replace(three, loops=twice, actuators=mechanism.actuators)
    pin_in_a_guide = dataclasses.replace(mechanism.joints[2], friction=mechanism.loops[0].friction)
    with pytest.raises(PinfricError, match="joint guide: its friction should be GuideFriction"):
        dataclasses.replace(mechanism, joints=(*mechanism.joints[:2], pin_in_a_guide))


# ---------------------------------------------------------------- step 5


@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-6, 1e-10])
def test_the_iteration_ends_where_the_efforts_do_not_change_any_more(tolerance):
    """Step 5, against the paper's iteration written out for a drawer that is pushed off its axis.

    P = m a + mu N, and N = |F_r/2 + couple| + |F_r/2 - couple| = 2 P offset / length, where the
    couple of the push is the larger part and no weight presses.
    """
    mass, length, offset, mu = 4.0, 0.3, 0.2, 0.4
    slide = TranslationalJoint("slide", GROUND, "drawer", ORIGIN, X, GuideFriction(length, mu, mu))
    push = Actuator("push", GROUND, "drawer", (0.0, offset, 0.0), force=X)
    mechanism = Mechanism((Body("drawer", mass, np.eye(3), ORIGIN),), (slide,), ORIGIN, (push,))
    found = inverse(mechanism, [0.0], [1.0], [2.0], tolerance=tolerance)
    efforts = [mass * 2.0 * (1 + 2 * mu * offset / length)]  # step 1: the load without friction
    while len(efforts) < found.iterations[0]:
        efforts.append(mass * 2.0 + mu * 2 * efforts[-1] * offset / length)
    assert found.effort_lower[0, 0] == pytest.approx(efforts[-1], rel=1e-12)
    size = mass * 2.0  # of the terms: m a, and the effort itself
    changes = np.abs(np.diff(efforts))
    assert changes[-1] <= tolerance * (size + efforts[-1])
    assert len(changes) == 1 or changes[-2] > tolerance * (size + efforts[-2])
