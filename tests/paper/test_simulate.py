"""Simulations of the independent judge: closed forms, the paper's stick times, the law itself."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pinfric.paper import examples
from pinfric.paper.bodies import GROUND, Body, Mechanism, PinFriction, RevoluteJoint
from pinfric.paper.equations import body_speeds, place, relative_jacobian
from pinfric.paper.examples import Case, pendulum, three_link
from pinfric.paper.forward import NoConsistentFriction, forward
from pinfric.paper.inverse import inverse
from pinfric.paper.simulate import AbsoluteMotion, _Run, simulate

PENDULUM_LENGTH, PENDULUM_MASS, PENDULUM_J, PIN_RADIUS = 0.25, 1.0, 0.4, 0.1


@cache
def simulated(example: str) -> tuple[Case, AbsoluteMotion]:
    case = getattr(examples, example)()
    motion = simulate(
        case.mechanism, case.position, case.rate, case.effort, case.t_end, sample_step=4e-3
    )
    return case, motion


def spinning_rotor(ratio: float) -> Mechanism:
    """No gravity, no effort; kappa = mu R m l / (J + m l^2) is the ratio given."""
    about_pin = PENDULUM_J + PENDULUM_MASS * PENDULUM_LENGTH**2
    mu = ratio * about_pin / (PIN_RADIUS * PENDULUM_MASS * PENDULUM_LENGTH)
    case = pendulum()
    joint = replace(case.mechanism.joints[0], friction=PinFriction(PIN_RADIUS, None, mu, mu))
    return replace(case.mechanism, joints=(joint,), gravity=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("ratio", [0.3, 0.99])
def test_rotor_slows_down_in_closed_form(ratio):
    """a = -kappa sqrt(a^2 + w^4), so w = w0 / (1 + b w0 t) with b = kappa / sqrt(1 - kappa^2)."""
    mechanism, b = spinning_rotor(ratio), ratio / np.sqrt(1 - ratio**2)
    motion = simulate(mechanism, [0.1], [3.0], lambda _: [0.0], 0.3, sample_step=0.1)
    rate = 3.0 / (1 + b * 3.0 * motion.t)
    assert_allclose(motion.rate[:, 0], rate, rtol=1e-9)
    assert_allclose(motion.position[:, 0], 0.1 + np.log1p(b * 3.0 * motion.t) / b, rtol=1e-9)
    assert_allclose(motion.acceleration[:, 0], -b * rate**2, rtol=1e-8)


def test_rotor_beyond_the_critical_friction_has_no_acceleration():
    with pytest.raises(NoConsistentFriction) as caught:
        forward(spinning_rotor(1.01), [0.1], [3.0], [0.0])
    assert_array_equal(caught.value.rate, [3.0])


@pytest.mark.parametrize(
    ("example", "joint", "start", "end"),
    [
        ("pendulum", "joint_1", (1.060, 1.072), (1.208, 1.216)),
        ("three_link", "joint_12", (0.515, 0.523), (0.555, 0.561)),
    ],
)
def test_paper_stick_times(example, joint, start, end):
    _, motion = simulated(example)
    ((first, last),) = motion.stick_intervals(joint)
    assert start[0] <= first <= start[1]
    assert end[0] <= last <= end[1]
    signs = {"pendulum": [1, 0, -1], "three_link": [-1, 0, 1]}[example]
    assert [phase.modes[0] for phase in motion.phases] == signs  # no guard fires twice


def test_pendulum_sticks_when_its_scalar_equation_says():
    """Stick ends where |2 sin 2t - m g l sin| first reaches mu_s R m g at the resting angle."""
    _, motion = simulated("pendulum")
    ((first, last),) = motion.stick_intervals("joint_1")
    angle, rate, instant = motion.sample((first + last) / 2)
    assert rate[0] == 0
    needed = 2 * np.sin(2 * last) - PENDULUM_LENGTH * 9.81 * np.sin(angle[0])
    assert abs(needed) == pytest.approx(0.35 * PIN_RADIUS * 9.81, rel=1e-10)
    assert instant.acceleration[0] == pytest.approx(0, abs=1e-13)


@pytest.mark.parametrize("example", ["pendulum", "three_link"])
def test_inverse_dynamics_recovers_the_efforts_of_the_motion(example):
    case, motion = simulated(example)
    geo = case.mechanism.geometry
    result = inverse(case.mechanism, motion.position, motion.rate, motion.acceleration)
    stuck = result.sticking.any(axis=1)
    assert 5 < stuck.sum() < 0.2 * len(stuck)
    for end in (result.effort_lower, result.effort_upper):
        assert_allclose(end[~stuck], motion.effort[~stuck], rtol=0, atol=1e-10)
    assert np.all(result.effort_lower[stuck] <= motion.effort[stuck] + 1e-10)
    assert np.all(motion.effort[stuck] <= result.effort_upper[stuck] + 1e-10)
    width = (result.effort_upper - result.effort_lower)[stuck][:, geo.sites]
    assert_allclose(width, 2 * 0.35 * result.normal_load[stuck], rtol=1e-12)
    assert_allclose(result.normal_load, motion.normal_load, rtol=1e-10)


def energy(mechanism: Mechanism, angle, rate) -> np.ndarray:
    q = place(mechanism, angle)
    speed = body_speeds(relative_jacobian(mechanism, q), rate).reshape(len(angle), -1, 6)
    total = np.zeros(len(angle))
    for k, body in enumerate(mechanism.bodies):
        omega = speed[:, k, 3:]
        total += body.mass * (speed[:, k, :3] ** 2).sum(axis=1) / 2
        total += np.einsum("ti,ij,tj->t", omega, body.inertia, omega) / 2
        total -= body.mass * q.position[:, k] @ np.asarray(mechanism.gravity)
    return total


def test_energy_is_kept_without_friction_and_effort():
    mechanism = three_link().mechanism
    joints = tuple(replace(joint, friction=None) for joint in mechanism.joints)
    mechanism = replace(mechanism, joints=joints)
    motion = simulate(
        mechanism, np.ones(3), [1.0, -2.0, 1.0], lambda _: np.zeros(3), 0.5, sample_step=0.05
    )
    kept = energy(mechanism, motion.position, motion.rate)
    assert np.ptp(motion.rate, axis=0).min() > 0.5
    assert_allclose(kept, kept[0], rtol=1e-9)


def test_energy_changes_by_the_work_of_efforts_and_friction():
    case, motion = simulated("three_link")
    change = np.diff(energy(case.mechanism, motion.position[[0, -1]], motion.rate[[0, -1]]))[0]
    nodes, weights = np.polynomial.legendre.leggauss(64)
    work = lost = 0.0
    for phase in motion.phases:
        half = (phase.end - phase.start) / 2
        for node, weight in zip(nodes, weights, strict=True):
            time = phase.start + half * (1 + node)
            _, rate, instant = motion.sample(time)
            work += half * weight * (case.effort(time) @ rate)
            lost -= half * weight * (instant.friction[0] * rate[1])
    assert lost > 1.0
    assert work - lost == pytest.approx(change, rel=1e-8)


def test_literal_reading_ends_where_nothing_is_consistent():
    case = pendulum("literal")
    with pytest.raises(NoConsistentFriction) as caught:
        simulate(case.mechanism, case.position, case.rate, case.effort, case.t_end)
    # it sticks for a while; past mu_s N = 0.30 N stick is over, and slip would need 0.35 N
    assert 0.3 < caught.value.time < 1.5
    assert caught.value.rate[0] == 0
    needed = 2 * np.sin(2 * caught.value.time)
    needed -= PENDULUM_LENGTH * 9.81 * np.sin(caught.value.position[0])
    assert abs(needed) == pytest.approx(0.30 * PIN_RADIUS * 9.81, rel=1e-10)


def test_equal_coefficients_release_without_a_jump():
    """At mu_s = mu_k the acceleration starts from zero: the guard must not fire again there."""
    mechanism = pendulum().mechanism
    pin = PinFriction(0.1, None, 0.3, 0.3)
    mechanism = replace(mechanism, joints=(replace(mechanism.joints[0], friction=pin),))
    release = 0.3 * PIN_RADIUS * 9.81
    motion = simulate(mechanism, [0.0], [0.0], lambda t: [t], release + 0.05, sample_step=0.1)
    assert [p.modes.tolist() for p in motion.phases] == [[0], [1]]
    assert motion.phases[0].end == pytest.approx(release, rel=1e-12)
    # the effort beyond the limit grows as t; the weight has hardly begun to pull back
    assert motion.rate[-1, 0] == pytest.approx(0.05**2 / 2 / 0.4625, rel=5e-3)


def test_reversal_without_sticking_is_one_event():
    """Thrown up against gravity far from balance: the pin cannot hold it at the top."""
    mechanism = pendulum().mechanism
    motion = simulate(mechanism, [1.2], [1.0], lambda _: [0.0], 0.8, sample_step=0.1)
    assert [p.modes.tolist() for p in motion.phases] == [[1], [-1]]
    assert motion.stick_intervals("joint_1") == []
    angle, rate, instant = motion.sample(motion.phases[1].start)
    assert rate[0] == 0
    needed = PENDULUM_LENGTH * 9.81 * np.sin(angle[0]) - 0.30 * instant.normal_load[0]
    assert instant.acceleration[0] == pytest.approx(-needed / 0.4625, rel=1e-10)


def test_break_away_of_one_joint_takes_another_along():
    """The reaction jumps where the outer joint of a double pendulum slips: so does the inner."""
    bars = tuple(
        Body(name, 1.0, 0.05 * np.eye(3), (x, 0.0, 0.0)) for name, x in (("a", 0.25), ("b", 0.75))
    )
    inner, outer = (PinFriction(radius, None, 0.6, 0.3) for radius in (0.02, 0.06))
    joints = (
        RevoluteJoint("inner", GROUND, "a", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), inner),
        RevoluteJoint("outer", "a", "b", (0.5, 0.0, 0.0), (0.0, 0.0, 1.0), outer),
    )
    mechanism = Mechanism(bars, joints, (9.81, 0.0, 0.0))
    motion = simulate(
        mechanism,
        [0, 0],
        [0, 0],
        lambda t: np.sin(6 * t) * np.array([1.0, 7.0]),
        0.2,
        sample_step=0.1,
    )
    assert [phase.modes.tolist() for phase in motion.phases] == [[0, 0], [-1, 1]]
    release = motion.phases[0].end
    assert 7 * np.sin(6 * release) == pytest.approx(0.6 * 0.06 * 9.81, rel=1e-10)  # outer's limit
    _, _, held = motion.sample(release * (1 - 1e-9))
    assert abs(held.friction[0]) < 0.9 * 0.6 * held.normal_load[0]  # the inner one had margin


def test_two_pendulums_that_change_together_are_two_single_ones():
    case, single = simulated("pendulum")
    (bar,), (pin,) = case.mechanism.bodies, case.mechanism.joints
    mechanism = replace(
        case.mechanism,
        bodies=(bar, replace(bar, name="twin", center_of_mass=(0.25, 0.0, 1.0))),
        joints=(pin, replace(pin, name="twin_pin", child="twin", point=(0.0, 0.0, 1.0))),
        actuators=(),
    )
    start, effort = ([0.524] * 2, [1.0] * 2), lambda t: np.tile(case.effort(t), 2)
    motion = simulate(mechanism, *start, effort, 1.3, sample_step=0.1)
    for joint in ("joint_1", "twin_pin"):
        assert_allclose(
            motion.stick_intervals(joint), single.stick_intervals("joint_1"), atol=1e-11
        )


def test_pendulum_without_any_load_stays_at_rest():
    mechanism = replace(pendulum().mechanism, gravity=(0.0, 0.0, 0.0))
    motion = simulate(mechanism, [0.3], [0.0], lambda _: [0.0], 0.5, sample_step=0.1)
    assert motion.stick_intervals("joint_1") == [(0.0, 0.5)]
    assert_array_equal(motion.position, 0.3)


def test_guard_that_starts_from_zero_is_located_where_it_returns_to_zero():
    run = _Run(pendulum().mechanism, lambda _: [0.0], 1e-8, 1e-10, 0.1)
    slip = np.array([1])
    located = run.locate(lambda t: np.array([0.0, t * (0.01 - t)]), 0.0, 0.05, slip, 0, np.zeros(1))
    assert located == pytest.approx(0.01, rel=1e-12)
    assert run.locate(lambda t: np.array([0.0, -t]), 0.0, 0.05, slip, 0, np.zeros(1)) == 0.0


def test_three_frictional_joints_obey_the_law_at_every_sample():
    case = three_link()
    pin = PinFriction(0.02, 0.1, 0.35, 0.30)
    joints = tuple(replace(j, friction=pin) for j in case.mechanism.joints)
    mechanism = replace(case.mechanism, joints=joints, gravity=(0.0, 0.0, -9.81))
    motion = simulate(
        mechanism,
        np.zeros(3),
        np.zeros(3),
        lambda t: np.array([5.0, 3.0, 2.0]) * np.sin(np.array([7.0, 8.0, 9.0]) * t),
        0.6,
        rtol=1e-8,
        max_step=0.05,
        sample_step=0.01,
    )
    limit = motion.normal_load * np.where(motion.modes == 0, 0.35, 0.30)
    slips = motion.modes != 0
    assert np.all(np.abs(motion.friction) <= limit * (1 + 1e-9))
    assert_allclose(motion.friction[slips], -(motion.modes * limit)[slips], rtol=1e-10)
    assert np.all(motion.modes * motion.rate >= -1e-12)
    assert np.all(motion.rate[~slips] == 0)
    sticks = [len(motion.stick_intervals(joint.name)) for joint in joints]
    assert sticks == [2, 1, 0]
    for before, after in pairwise(motion.phases):
        assert_allclose(before.solution(before.end), after.solution(after.start), atol=1e-10)
