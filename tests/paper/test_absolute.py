"""The independent judge against closed forms, invariants and a Newton-Euler written here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from pinfric.errors import PinfricError
from pinfric.paper.bodies import (
    GROUND,
    Actuator,
    Body,
    GuideFriction,
    Mechanism,
    PinFriction,
    RevoluteJoint,
    TranslationalJoint,
)
from pinfric.paper.equations import (
    acceleration_bias,
    actuator_forces,
    body_speeds,
    full_pivoting,
    partial_velocity_matrix,
    place,
    relative_jacobian,
)
from pinfric.paper.examples import pendulum, three_link
from pinfric.paper.forward import NoConsistentFriction, forward
from pinfric.paper.inverse import FixedPointError, inverse

#: Which joints of a random tree are translational, by its seed.
SLIDING = ((), (1,), (0, 2), (0, 1, 2, 3), (0, 3, 4))
PENDULUM_LENGTH, PENDULUM_MASS, PENDULUM_J, PIN_RADIUS = 0.25, 1.0, 0.4, 0.1


def random_tree(seed: int, bodies: int = 4, translational: tuple[int, ...] = ()) -> Mechanism:
    """A random tree of joints, branching, with pins of both kinds, and guides where they slide."""
    rng = np.random.default_rng(seed)
    parts, joints, names = [], [], [GROUND]
    for k in range(bodies):
        turn = Rotation.random(random_state=rng).as_matrix()
        inertia = turn @ np.diag(0.1 + rng.random() * np.array([1.0, 0.8, 0.6])) @ turn.T
        parts.append(Body(f"body_{k}", 0.5 + rng.random(), inertia, rng.normal(size=3) * 0.3))
        pin = PinFriction(0.02, 0.1 if k % 2 else None, 0.4, 0.3)
        parent = names[rng.integers(max(0, k - 1), k + 1)]
        place = f"joint_{k}", parent, f"body_{k}", rng.normal(size=3) * 0.3, rng.normal(size=3)
        if k in translational:
            joints.append(TranslationalJoint(*place, GuideFriction(0.2, 0.06, 0.04, width=0.3)))
        else:
            joints.append(RevoluteJoint(*place, pin))
        names.append(f"body_{k}")
    return Mechanism(tuple(parts), tuple(joints), (1.0, -2.0, -9.0))


def random_motion(mechanism: Mechanism, seed: int, samples: int = 5) -> np.ndarray:
    shape = (3, samples, len(mechanism.joints))
    return np.random.default_rng(seed).uniform(-2, 2, size=shape)


def newton_euler(mechanism: Mechanism, angle, rate, acceleration) -> np.ndarray:
    """Wrench (nj, 6) of each joint on its child, joint's point and child's axes, one sample.

    Two recursions in ground axes on joint points: nothing shared with the code under test.
    """
    state = {GROUND: (np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3))}
    reference = {GROUND: np.zeros(3)}  # the point of each body its accelerations are given at
    body = {b.name: b for b in mechanism.bodies}
    force, moment = {}, {}
    for k, joint in enumerate(mechanism.joints):
        A, p, w, dw, acc = state[joint.parent]
        axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
        slides = isinstance(joint, TranslationalJoint)
        arm = A @ (np.asarray(joint.point) - reference[joint.parent] + slides * angle[k] * axis)
        k_axis = A @ axis
        acc = acc + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
        if slides:
            acc = acc + k_axis * acceleration[k] + 2 * np.cross(w, k_axis) * rate[k]
        else:
            dw = dw + k_axis * acceleration[k] + np.cross(w, k_axis) * rate[k]
            w = w + k_axis * rate[k]
            A = A @ Rotation.from_rotvec(axis * angle[k]).as_matrix()
        state[joint.child] = (A, p + arm, w, dw, acc)
        reference[joint.child] = np.asarray(joint.point)
        b = body[joint.child]
        arm = A @ (np.asarray(b.center_of_mass) - reference[joint.child])
        a_com = acc + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
        J = A @ np.asarray(b.inertia) @ A.T
        force[joint.child] = b.mass * (a_com - np.asarray(mechanism.gravity))
        moment[joint.child] = J @ dw + np.cross(w, J @ w) + np.cross(arm, force[joint.child])
    wrench = np.empty((len(mechanism.joints), 6))
    for k, joint in reversed(list(enumerate(mechanism.joints))):
        A, p = state[joint.child][:2]
        if joint.parent != GROUND:
            lever = p - state[joint.parent][1]
            moment[joint.parent] += moment[joint.child] + np.cross(lever, force[joint.child])
            force[joint.parent] += force[joint.child]
        wrench[k] = np.concatenate([A.T @ force[joint.child], A.T @ moment[joint.child]])
    return wrench


def normal_load(pin: PinFriction | GuideFriction, axis, wrench) -> float:
    """The load of a pin (N m) or a guide (N), from its definition."""
    k = np.asarray(axis) / np.linalg.norm(axis)
    force = wrench[:3] - k * (k @ wrench[:3])
    if isinstance(pin, GuideFriction):
        ends = np.array([force / 2 + sign * np.cross(wrench[3:], k) / 0.2 for sign in (1, -1)])
        return np.linalg.norm(ends, axis=1).sum() + 2 * abs(k @ wrench[3:]) / 0.3
    if pin.length is None:
        return pin.radius * np.linalg.norm(force)
    couple = np.cross(wrench[3:], k) / pin.length
    ends = np.linalg.norm(force / 2 + couple) + np.linalg.norm(force / 2 - couple)
    return pin.radius * ends


# ---------------------------------------------------------------- coordinates and constraints


def test_initial_state_is_the_papers_tables():
    case = three_link()
    q = place(case.mechanism, case.position[None])
    speed = body_speeds(relative_jacobian(case.mechanism, q), case.rate[None]).reshape(3, 6)
    table = [[-0.2, 0, 0, 0, 0, 1], [-0.4, -0.25, 0, -1, 0, 1], [-0.4, -0.35, -0.15, -1, 1, 1]]
    np.testing.assert_allclose(speed, table, atol=1e-15)
    np.testing.assert_array_equal(q.euler_parameters[0], np.tile([0, 0, 0, 1.0], (4, 1)))
    case = pendulum()
    q = place(case.mechanism, case.position[None])
    speed = body_speeds(relative_jacobian(case.mechanism, q), case.rate[None])[0]
    np.testing.assert_allclose(q.position[0, 0, :2], [0.217, 0.125], atol=6e-4)  # as printed
    np.testing.assert_allclose(speed[[0, 1, 5]], [-0.125, 0.217, 1.0], atol=6e-4)


@pytest.mark.parametrize("seed", range(4))
def test_speeds_and_accelerations_are_the_derivatives_of_the_placement(seed):
    mechanism = random_tree(seed, translational=SLIDING[seed])
    angle, rate, acceleration = (x[0] for x in random_motion(mechanism, seed))
    h = 2e-3
    steps = h * np.arange(-3, 4)[:, None]
    q = place(mechanism, angle + rate * steps + acceleration * steps**2 / 2)
    r = q.position[:, :-1]
    first, second = (
        np.array([-1, 9, -45, 0, 45, -9, 1]) / 60,
        np.array([2, -27, 270, -490, 270, -27, 2]) / 180,
    )
    here = place(mechanism, angle[None])
    jacobian = relative_jacobian(mechanism, here)
    speed = body_speeds(jacobian, rate[None])
    bodies = speed.reshape(-1, 6)
    A = q.orientation[:, :-1]
    spin = np.einsum("bij,bik->bjk", A[3], np.tensordot(first, A, 1) / h)  # omega~ in body axes
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
    np.testing.assert_allclose(bodies[:, :3], np.tensordot(first, r, 1) / h, atol=1e-9)
    np.testing.assert_allclose(bodies[:, 3:], omega, atol=1e-9)
    result = inverse(mechanism, angle, rate, acceleration)
    accelerations = result.body_acceleration.reshape(-1, 6)
    np.testing.assert_allclose(accelerations[:, :3], np.tensordot(second, r, 1) / h**2, atol=1e-7)
    gamma = acceleration_bias(mechanism, here, speed).constraint
    np.testing.assert_allclose(
        np.einsum("tmn,tn->tm", jacobian.constraint, result.body_acceleration), gamma, atol=1e-12
    )


@pytest.mark.parametrize("seed", range(4))
def test_partial_velocity_matrix_is_a_basis_of_the_null_space(seed):
    mechanism = random_tree(seed, bodies=5, translational=SLIDING[seed])
    placement = place(mechanism, random_motion(mechanism, seed)[0])
    constraint = relative_jacobian(mechanism, placement).constraint
    dependent, independent = full_pivoting(constraint)
    B = partial_velocity_matrix(constraint, dependent, independent)
    assert np.abs(constraint @ B).max() < 1e-13
    for t in range(len(B)):
        assert sorted([*dependent[t], *independent[t]]) == list(range(30))
        np.testing.assert_array_equal(B[t, independent[t]], np.eye(5))
    # a pivot is the largest entry left, so no entry of the basis is large
    assert np.abs(B).max() < 30


def test_actuators_work_on_the_relative_motion_of_what_they_act_on():
    """Power of a unit effort: g . (v_j - v_i) at the point + h . (omega_j - omega_i), (10)-(15)."""
    mechanism = random_tree(1, translational=(1,))
    point, g, h = np.array([0.2, -0.1, 0.3]), np.array([1.0, 2.0, -1.0]), np.array([0.5, 0.0, 2.0])
    between = Actuator("between", "body_1", "body_3", point, g, h)
    mechanism = replace(mechanism, actuators=(*mechanism.actuators[:3], between))
    angle, rate, _ = random_motion(mechanism, 1)
    q = place(mechanism, angle)
    speed = body_speeds(relative_jacobian(mechanism, q), rate)
    power = np.einsum("tna,tn->ta", actuator_forces(mechanism, q), speed)
    np.testing.assert_allclose(power[:, :3], rate[:, :3], atol=1e-13)
    arm = point - np.asarray(mechanism.bodies[3].center_of_mass)
    for t in range(len(rate)):
        A_i, A_j = q.orientation[t, [1, 3]]
        v_i, w_i, v_j, w_j = speed[t].reshape(4, 2, 3)[[1, 3]].reshape(4, 3)
        at = q.position[t, 3] + A_j @ arm
        relative = v_j + np.cross(A_j @ w_j, at - q.position[t, 3])
        relative -= v_i + np.cross(A_i @ w_i, at - q.position[t, 1])
        expected = (A_j @ g) @ relative + (A_j @ h) @ (A_j @ w_j - A_i @ w_i)
        assert power[t, 3] == pytest.approx(expected, rel=1e-12)


def test_dependent_constraints_are_refused():
    placement = place(random_tree(0), np.zeros((1, 4)))
    constraint = relative_jacobian(random_tree(0), placement).constraint
    with pytest.raises(PinfricError, match="depend on each other"):
        full_pivoting(np.concatenate([constraint, constraint[:, 2:3] - constraint[:, 7:8]], axis=1))


# ---------------------------------------------------------------- inverse dynamics


@pytest.mark.parametrize("rate", [-1.3, 0.0, 0.7])
def test_pendulum_effort_and_reaction_in_closed_form(rate):
    angle, acceleration = np.linspace(-3, 3, 13), np.linspace(4, -5, 13)
    case = pendulum()
    result = inverse(case.mechanism, angle[:, None], np.full((13, 1), rate), acceleration[:, None])
    tangential = PENDULUM_MASS * (PENDULUM_LENGTH * acceleration + 9.81 * np.sin(angle))
    inward = PENDULUM_MASS * (PENDULUM_LENGTH * rate**2 + 9.81 * np.cos(angle))
    about_pin = PENDULUM_J + PENDULUM_MASS * PENDULUM_LENGTH**2
    total = about_pin * acceleration + PENDULUM_MASS * PENDULUM_LENGTH * 9.81 * np.sin(angle)
    load = PIN_RADIUS * np.hypot(tangential, inward)
    zero = np.zeros(13)
    expected = np.stack([-inward, tangential, zero, zero, zero, total], axis=1)
    np.testing.assert_allclose(result.wrench[:, 0], expected, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(result.normal_load[:, 0], load, rtol=1e-13)
    np.testing.assert_allclose(result.effort_frictionless[:, 0], total, rtol=1e-13, atol=1e-13)
    lower, upper = (-0.35, 0.35) if rate == 0 else (0.30 * np.sign(rate),) * 2
    np.testing.assert_allclose(result.effort_lower[:, 0], total + lower * load, atol=1e-13)
    np.testing.assert_allclose(result.effort_upper[:, 0], total + upper * load, atol=1e-13)
    np.testing.assert_array_equal(result.sticking, np.full((13, 1), rate == 0))
    np.testing.assert_allclose(result.friction_lower[:, 0], -upper * load, atol=1e-13)


@pytest.mark.parametrize("seed", range(5))
def test_tree_agrees_with_newton_euler(seed):
    mechanism = random_tree(seed, bodies=5, translational=SLIDING[seed])
    motion = random_motion(mechanism, seed)
    motion[1, 0, 1:3] = 0.0  # two joints at rest in the first sample
    result = inverse(mechanism, *motion)
    for t in range(motion.shape[1]):
        wrench = newton_euler(mechanism, *motion[:, t])
        np.testing.assert_allclose(result.wrench[t], wrench, rtol=1e-12, atol=1e-11)
        for k, joint in enumerate(mechanism.joints):
            axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
            load = normal_load(joint.friction, axis, wrench[k])
            part = slice(3) if isinstance(joint, TranslationalJoint) else slice(3, 6)
            total, rate = axis @ wrench[k, part], motion[1, t, k]
            spread = joint.friction.static * load if rate == 0 else 0.0
            middle = total + joint.friction.kinetic * load * np.sign(rate)
            assert result.normal_load[t, k] == pytest.approx(load, rel=1e-12)
            assert result.effort_frictionless[t, k] == pytest.approx(total, rel=1e-12, abs=1e-11)
            assert result.effort_lower[t, k] == pytest.approx(middle - spread, rel=1e-12, abs=1e-11)
            assert result.effort_upper[t, k] == pytest.approx(middle + spread, rel=1e-12, abs=1e-11)
    # with joint drives nothing is coupled: the second solution of (16) repeats the first
    np.testing.assert_array_equal(result.iterations, 2)


def test_ground_carries_the_rate_of_change_of_momentum():
    mechanism = random_tree(3, bodies=4, translational=(0, 2))
    grounded = [k for k, j in enumerate(mechanism.joints) if j.parent == GROUND]
    angle, rate, acceleration = (x[0] for x in random_motion(mechanism, 3))
    h = 2e-3
    steps = h * np.arange(-3, 4)[:, None]
    angles = angle + rate * steps + acceleration * steps**2 / 2
    q = place(mechanism, angles)
    speed = body_speeds(relative_jacobian(mechanism, q), rate + acceleration * steps)
    momentum = np.zeros((7, 6))
    for k, body in enumerate(mechanism.bodies):
        r, A, v = q.position[:, k], q.orientation[:, k], speed[:, 6 * k : 6 * k + 6]
        spin = np.einsum("tij,jk,tk->ti", A, body.inertia, v[:, 3:])
        momentum[:, :3] += body.mass * v[:, :3]
        momentum[:, 3:] += body.mass * np.cross(r, v[:, :3]) + spin
    change = np.array([-1, 9, -45, 0, 45, -9, 1]) @ momentum / (60 * h)
    for k, body in enumerate(mechanism.bodies):
        weight = body.mass * np.asarray(mechanism.gravity)
        change -= np.concatenate([weight, np.cross(q.position[3, k], weight)])
    result = inverse(mechanism, angle, rate, acceleration)
    carried = np.zeros(6)
    for k in grounded:
        child = [b.name for b in mechanism.bodies].index(mechanism.joints[k].child)
        force, moment = (q.orientation[3, child] @ x for x in np.split(result.wrench[0, k], 2))
        arm = np.asarray(mechanism.joints[k].point) - mechanism.bodies[child].center_of_mass
        point = q.position[3, child] + q.orientation[3, child] @ arm  # that of the child
        carried += np.concatenate([force, moment + np.cross(point, force)])
    np.testing.assert_allclose(carried, change, atol=1e-8)


def pushed_pendulum(static: float = 0.35, kinetic: float = 0.30) -> Mechanism:
    """A pendulum of 0.5 m pushed at 0.3 m across by a force: its reaction depends on the push."""
    mechanism = pendulum().mechanism
    joint = replace(mechanism.joints[0], friction=PinFriction(0.1, None, static, kinetic))
    push = Actuator("push", GROUND, "bar", (0.3, 0.0, 0.0), force=(0.0, 1.0, 0.0))
    return replace(mechanism, joints=(joint,), actuators=(push,))


def push_in_closed_form(angle, rate, acceleration, coefficient) -> float:
    """P of 0.3 P = (J + m l^2) a + m g l sin + coefficient R |F|, where F depends on P too."""
    l, g = PENDULUM_LENGTH, 9.81  # noqa: E741
    across = l * acceleration + g * np.sin(angle)
    along = l * rate**2 + g * np.cos(angle)
    total = (PENDULUM_J + l**2) * acceleration + g * l * np.sin(angle)
    return brentq(
        lambda p: 0.3 * p - total - coefficient * PIN_RADIUS * np.hypot(across - p, along),
        -1e3,
        1e3,
        xtol=1e-14,
        rtol=1e-15,
    )


@pytest.mark.parametrize("rate", [-2.0, 0.0, 2.0])
def test_reaction_that_depends_on_the_effort_is_iterated(rate):
    mechanism = pushed_pendulum()
    result = inverse(mechanism, [0.8], [rate], [3.0])
    if rate == 0:
        ends = [push_in_closed_form(0.8, 0, 3.0, c) for c in (-0.35, 0.35)]
    else:
        ends = [push_in_closed_form(0.8, rate, 3.0, 0.30 * np.sign(rate))] * 2
    assert result.effort_lower[0, 0] == pytest.approx(ends[0], rel=1e-12)
    assert result.effort_upper[0, 0] == pytest.approx(ends[1], rel=1e-12)
    assert result.iterations[0] > 4
    # the push does not pass through the pin: only friction does
    assert result.wrench[0, 0, 5] == pytest.approx(-0.30 * np.sign(rate) * result.normal_load[0, 0])


def test_ends_of_coupled_intervals_hold_every_admissible_friction():
    """Two sticking pins whose loads depend on both efforts: corners, not one site at a time."""
    case = three_link()
    pin = PinFriction(0.08, 0.1, 0.35, 0.30)
    joints = tuple(replace(j, friction=pin) for j in case.mechanism.joints)
    actuators = tuple(
        Actuator(f"push_{k}", GROUND, f"link_{k}", point, force=force)
        for k, point, force in (
            (1, (0.0, 0.3, 0.0), (1.0, 0.0, 0.0)),
            (2, (0.1, 0.4, -0.4), (0.0, 1.0, 0.2)),
            (3, (0.3, 0.4, -0.5), (0.0, 0.3, 1.0)),
        )
    )
    mechanism = replace(case.mechanism, joints=joints, actuators=actuators)
    result = inverse(mechanism, [0.3, -0.4, 0.5], [0.0, 0.7, 0.0], [1.0, -2.0, 0.5])
    np.testing.assert_array_equal(result.sticking, [[True, False, True]])
    reached = []
    for effort in ([1, 1], [1, -1], [-1, 1], [-1, -1]):
        # the same corners as sliding at the static coefficient, just faster than stick velocity
        pins = [PinFriction(0.08, 0.1, 0.9, c, 1e-15) for c in (0.35, 0.30, 0.35)]
        moving = tuple(replace(j, friction=p) for j, p in zip(joints, pins, strict=True))
        rate = [-1e-12 * effort[0], 0.7, -1e-12 * effort[1]]
        corner = inverse(
            replace(mechanism, joints=moving), [0.3, -0.4, 0.5], rate, [1.0, -2.0, 0.5]
        )
        reached.append(corner.effort_lower[0])
    np.testing.assert_allclose(result.effort_lower[0], np.min(reached, axis=0), rtol=1e-9)
    np.testing.assert_allclose(result.effort_upper[0], np.max(reached, axis=0), rtol=1e-9)


def test_effort_that_settles_at_once_does_not_stop_the_others():
    pushed, plain = pushed_pendulum(), pendulum().mechanism
    twin = replace(plain.joints[0], name="twin_pin", child="twin")
    mechanism = replace(
        pushed,
        bodies=(*pushed.bodies, replace(plain.bodies[0], name="twin")),
        joints=(*pushed.joints, twin),
        actuators=(
            *pushed.actuators,
            replace(plain.actuators[0], child="twin", through="twin_pin"),
        ),
    )
    result = inverse(mechanism, [0.8, 0.8], [2.0, 2.0], [3.0, 3.0])
    alone = [inverse(m, [0.8], [2.0], [3.0]).effort_lower[0, 0] for m in (pushed, plain)]
    np.testing.assert_allclose(result.effort_lower[0], alone, rtol=1e-12)


def test_units_of_an_effort_do_not_matter():
    mechanism = pushed_pendulum()
    in_newton = inverse(mechanism, [0.8], [2.0], [3.0])
    tera = replace(mechanism.actuators[0], force=(0.0, 1e12, 0.0))
    pico = replace(mechanism.actuators[0], force=(0.0, 1e-12, 0.0))
    for actuator, unit in ((tera, 1e12), (pico, 1e-12)):
        scaled = inverse(replace(mechanism, actuators=(actuator,)), [0.8], [2.0], [3.0])
        np.testing.assert_allclose(scaled.effort_lower * unit, in_newton.effort_lower, rtol=1e-12)


def test_iteration_that_cannot_settle_says_where():
    mechanism = pushed_pendulum(static=9.0, kinetic=9.0)
    with pytest.raises(FixedPointError) as caught:
        inverse(mechanism, [[0.8], [0.8]], [[2.0], [2.0]], [[3.0], [3.0]])
    np.testing.assert_array_equal(caught.value.samples, [0, 1])


# ---------------------------------------------------------------- forward dynamics


@pytest.mark.parametrize("seed", range(4))
def test_forward_dynamics_is_undone_by_inverse_dynamics(seed):
    mechanism = random_tree(seed, translational=SLIDING[seed])
    angle, rate, effort = (x[0] for x in random_motion(mechanism, seed))
    instant = forward(mechanism, angle, rate, effort)
    result = inverse(mechanism, angle, rate, instant.acceleration)
    np.testing.assert_array_equal(instant.modes, np.sign(rate))
    np.testing.assert_allclose(result.effort_lower[0], effort, atol=1e-11)
    np.testing.assert_allclose(result.friction_upper[0], instant.friction, atol=1e-11)
    np.testing.assert_allclose(result.wrench[0], instant.wrench, atol=1e-11)
    np.testing.assert_allclose(result.multipliers[0], instant.multipliers, atol=1e-11)
    np.testing.assert_allclose(result.body_acceleration[0], instant.body_acceleration, atol=1e-11)


def test_pushed_pendulum_forward_is_undone_by_inverse_dynamics():
    mechanism = pushed_pendulum()
    instant = forward(mechanism, [0.8], [2.0], [7.0])
    push = push_in_closed_form(0.8, 2.0, instant.acceleration[0], 0.30)
    assert push == pytest.approx(7.0, rel=1e-12)


@pytest.mark.parametrize("side", [-1, 1])
def test_pendulum_at_rest_breaks_away_at_the_static_limit(side):
    mechanism = pendulum().mechanism
    limit = 0.35 * PIN_RADIUS * 9.81  # at rest the pin carries the weight
    weight = PENDULUM_LENGTH * 9.81 * np.sin(0.524)
    held = forward(mechanism, [0.524], [0.0], [weight + side * limit * (1 - 1e-9)])
    assert held.modes == [0]
    assert held.friction[0] == pytest.approx(-side * limit, rel=1e-8)
    assert abs(held.acceleration[0]) < 1e-14
    gone = forward(mechanism, [0.524], [0.0], [weight + side * limit * (1 + 1e-9)])
    assert gone.modes == [side]
    assert gone.friction[0] == pytest.approx(-side * 0.30 * gone.normal_load[0], rel=1e-12)
    assert side * gone.acceleration[0] > 0.1


def test_joints_at_rest_stick_and_slip_each_for_itself():
    case = three_link()
    pin = PinFriction(0.08, 0.1, 0.35, 0.30)
    joints = tuple(replace(j, friction=pin) for j in case.mechanism.joints)
    mechanism = replace(case.mechanism, joints=joints)
    rest = inverse(mechanism, np.zeros(3), np.zeros(3), np.zeros(3))
    held = forward(mechanism, np.zeros(3), np.zeros(3), rest.effort_frictionless[0])
    np.testing.assert_array_equal(held.modes, [0, 0, 0])
    np.testing.assert_allclose(held.friction, 0, atol=1e-13)
    effort = rest.effort_frictionless[0] + [0, 0, 1.2 * 0.35 * rest.normal_load[0, 2]]
    slipping = forward(mechanism, np.zeros(3), np.zeros(3), effort)
    np.testing.assert_array_equal(slipping.modes, [0, 0, 1])
    np.testing.assert_allclose(slipping.acceleration[:2], 0, atol=1e-13)
    assert slipping.acceleration[2] > 0
    again = inverse(mechanism, np.zeros(3), [0, 0, 1e-5], slipping.acceleration)
    assert again.effort_lower[0, 2] == pytest.approx(effort[2], abs=1e-8)
    assert np.all(again.effort_lower[0, :2] < effort[:2])
    assert np.all(effort[:2] < again.effort_upper[0, :2])


def test_static_below_kinetic_leaves_no_consistent_mode():
    mechanism = pendulum("literal").mechanism
    effort = PENDULUM_LENGTH * 9.81 * np.sin(0.524) + 0.32 * PIN_RADIUS * 9.81
    with pytest.raises(NoConsistentFriction) as caught:
        forward(mechanism, [0.524], [0.0], [effort])
    assert caught.value.consistent == []
    assert caught.value.time is None


def test_two_consistent_choices_are_an_error_that_shows_both():
    """Heavy pins (0.8, 30 cm): either of two joints may stick while the other one slips."""
    mechanism = random_tree(1645, bodies=3)
    pin = PinFriction(0.3, None, 0.8, 0.7)
    mechanism = replace(mechanism, joints=tuple(replace(j, friction=pin) for j in mechanism.joints))
    angle, effort = [1.71, -0.715, 1.643], [2.022, -0.152, 1.618]
    with pytest.raises(NoConsistentFriction) as caught:
        forward(mechanism, angle, np.zeros(3), effort)
    both = [tuple(modes) for modes in caught.value.consistent]
    assert both == [(1, 0, 1), (1, 1, 0)]
    for modes in both:
        instant = forward(mechanism, angle, np.zeros(3), effort, modes)
        limit = np.where(np.array(modes) == 0, 0.8, 0.7) * instant.normal_load
        assert np.all(np.abs(instant.friction) <= limit * (1 + 1e-12))
        assert np.all(np.array(modes) * instant.acceleration >= -1e-12)


def test_input_that_cannot_be_is_refused():
    case = three_link()
    bodies, joints = case.mechanism.bodies, case.mechanism.joints
    with pytest.raises(PinfricError, match="no earlier joint places 'link_1'"):
        Mechanism(bodies, joints[1:], (0, 0, 0))
    with pytest.raises(PinfricError, match="cannot place body 'link_1'"):
        Mechanism(bodies, (joints[0], joints[0]), (0, 0, 0))
    with pytest.raises(PinfricError, match="link_3"):
        Mechanism(bodies, joints[:2], (0, 0, 0))
    with pytest.raises(PinfricError, match="position must be"):
        inverse(case.mechanism, [0, 0], [0, 0], [0, 0])
    with pytest.raises(PinfricError, match="consistent, literal"):
        three_link("printed")
    idle = Actuator("idle", GROUND, "bar", (0.0, 0.0, 0.0), force=(0.0, 1.0, 0.0))
    with pytest.raises(PinfricError, match="undriven"):
        inverse(replace(pushed_pendulum(), actuators=(idle,)), [0.8], [2.0], [3.0])
