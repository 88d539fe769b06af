"""Inverse dynamics in absolute coordinates: closed forms, Newton-Euler, momentum, iteration."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from paper_cases import (
    PENDULUM_J,
    PENDULUM_LENGTH,
    PENDULUM_MASS,
    PIN_RADIUS,
    SLIDING,
    push_in_closed_form,
    pushed_pendulum,
    random_motion,
    random_tree,
)
from scipy.spatial.transform import Rotation

from pinfric.errors import PinfricError
from pinfric.paper.bodies import (
    GROUND,
    Actuator,
    GuideFriction,
    Mechanism,
    PinFriction,
    TranslationalJoint,
)
from pinfric.paper.equations import (
    body_speeds,
    place,
    relative_jacobian,
)
from pinfric.paper.examples import pendulum, three_link
from pinfric.paper.inverse import FixedPointError, inverse


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
    assert_allclose(result.wrench[:, 0], expected, rtol=1e-13, atol=1e-13)
    assert_allclose(result.normal_load[:, 0], load, rtol=1e-13)
    assert_allclose(result.effort_frictionless[:, 0], total, rtol=1e-13, atol=1e-13)
    lower, upper = (-0.35, 0.35) if rate == 0 else (0.30 * np.sign(rate),) * 2
    assert_allclose(result.effort_lower[:, 0], total + lower * load, atol=1e-13)
    assert_allclose(result.effort_upper[:, 0], total + upper * load, atol=1e-13)
    assert_array_equal(result.sticking, np.full((13, 1), rate == 0))
    assert_allclose(result.friction_lower[:, 0], -upper * load, atol=1e-13)


@pytest.mark.parametrize("seed", range(5))
def test_tree_agrees_with_newton_euler(seed):
    mechanism = random_tree(seed, bodies=5, translational=SLIDING[seed])
    motion = random_motion(mechanism, seed)
    motion[1, 0, 1:3] = 0.0  # two joints at rest in the first sample
    result = inverse(mechanism, *motion)
    for t in range(motion.shape[1]):
        wrench = newton_euler(mechanism, *motion[:, t])
        assert_allclose(result.wrench[t], wrench, rtol=1e-12, atol=1e-11)
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
    assert_array_equal(result.iterations, 2)


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
    assert_allclose(carried, change, atol=1e-8)


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
    assert_array_equal(result.sticking, [[True, False, True]])
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
    assert_allclose(result.effort_lower[0], np.min(reached, axis=0), rtol=1e-9)
    assert_allclose(result.effort_upper[0], np.max(reached, axis=0), rtol=1e-9)


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
    assert_allclose(result.effort_lower[0], alone, rtol=1e-12)


def test_units_of_an_effort_do_not_matter():
    mechanism = pushed_pendulum()
    in_newton = inverse(mechanism, [0.8], [2.0], [3.0])
    tera = replace(mechanism.actuators[0], force=(0.0, 1e12, 0.0))
    pico = replace(mechanism.actuators[0], force=(0.0, 1e-12, 0.0))
    for actuator, unit in ((tera, 1e12), (pico, 1e-12)):
        scaled = inverse(replace(mechanism, actuators=(actuator,)), [0.8], [2.0], [3.0])
        assert_allclose(scaled.effort_lower * unit, in_newton.effort_lower, rtol=1e-12)


def test_iteration_that_cannot_settle_says_where():
    mechanism = pushed_pendulum(static=9.0, kinetic=9.0)
    with pytest.raises(FixedPointError) as caught:
        inverse(mechanism, [[0.8], [0.8]], [[2.0], [2.0]], [[3.0], [3.0]])
    assert_array_equal(caught.value.samples, [0, 1])


IDLE = Actuator("idle", GROUND, "bar", (0.0, 0.0, 0.0), force=(0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda b, j: Mechanism(b, j[1:], (0, 0, 0)), "no earlier joint places 'link_1'"),
        (lambda b, j: Mechanism(b, (j[0], j[0]), (0, 0, 0)), "cannot place body 'link_1'"),
        (lambda b, j: Mechanism(b, j[:2], (0, 0, 0)), "link_3"),
        (lambda b, j: inverse(three_link().mechanism, *[[0, 0]] * 3), "position must be"),
        (lambda b, j: three_link("printed"), "consistent, literal"),
        (
            lambda b, j: inverse(
                replace(pushed_pendulum(), actuators=(IDLE,)), [0.8], [2.0], [3.0]
            ),
            "undriven",
        ),
    ],
)
def test_input_that_cannot_be_is_refused(made, message):
    mechanism = three_link().mechanism
    with pytest.raises(PinfricError, match=message):
        made(mechanism.bodies, mechanism.joints)
