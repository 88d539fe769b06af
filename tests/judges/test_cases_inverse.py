"""The hard cases of `helpers/cases.py` under inverse dynamics: each asserts a number or a property.

Each comment names the case's safeguard and what happens without it, as tried once by editing the
source.
"""

from contextlib import nullcontext

import numpy as np
import pinocchio as pin
import pytest
from cases import (
    Case,
    ball_tripod,
    decelerating_drawer,
    drawer_forces,
    four_bar_of_masses,
    four_bars_in_a_row,
    hinged_weight,
    holding_four_bar,
    jamming_drawer,
    long_chain,
    measured_four_bar,
    resting_four_bar,
    rocker_driven_four_bar,
    shaking_four_bar,
    turning_four_bar,
)
from judges.planar_newton_euler import FourBar, crank_torque
from judges.verdict import judge
from mechanisms import pin_friction
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.samples.outcome import Status
from pinfric.motions.summary import summarize

SOLVED = {Status.CONVERGED, Status.AMBIGUOUS}


def is_sound(result, relative=1e-10):
    """What every result must obey: NaN exactly where the status says so, residuals, dissipation."""
    solved = np.isin(result.status, [int(status) for status in SOLVED])
    for name in ("effort_lower", "effort_upper", "friction_lower", "normal_load", "wrench"):
        array = getattr(result, name).reshape(len(solved), -1)
        assert np.isfinite(array[solved]).all(), name
        assert np.isnan(array[~solved]).all() or name == "wrench", name
    assert (result.effort_lower <= result.effort_upper)[solved].all()
    assert np.isfinite(result.contraction).all()
    check = judge(result)
    assert check.passed(relative), check
    slides = (result.status == Status.CONVERGED) & ~(result.sticking | result.reversal).any(axis=1)
    gained = (result.effort_lower - result.effort_frictionless) * result.actuator_velocity
    assert (gained.sum(axis=1)[slides] >= -1e-9 * max(check.scale, 1e-300)).all()
    return True


# Safeguard: the search at contraction >= 1 ends in JAMMED, efforts NaN. Without (an outcome of no
# solution left CONVERGED): the status is 0 beyond the critical mu.
@pytest.mark.parametrize("mu", [0.5 - 1e-6, 0.5 + 1e-6])
def test_jamming_drawer_from_both_sides(mu):
    result = jamming_drawer(mu).inverse()
    assert result.status[0] == (Status.CONVERGED if mu < 0.5 else Status.JAMMED)
    assert (result.contraction[0] < 1) == (mu < 0.5)
    assert is_sound(result)


# Safeguard: at contraction >= 1 other solutions are looked for. Without (the first one taken):
# CONVERGED with -5.5 N and nothing said of 141.9 N.
def test_decelerating_drawer_beyond_its_critical_mu():
    case = decelerating_drawer()
    result = case.inverse()
    assert result.status[0] == Status.AMBIGUOUS
    assert sorted(s.effort[0] for s in result.solutions(0)) == pytest.approx(case.known["forces"])
    assert is_sound(result)


# Safeguard: contraction >= 1 is looked into, pivots near zero end in SINGULAR. Without the rank
# test the toggle itself comes out AMBIGUOUS, with efforts of 1e16 N m.
def test_self_locking_four_bar_near_its_toggle():
    offsets = np.concatenate([-np.geomspace(0.5, 1e-4, 10), [0.0], np.geomspace(1e-4, 0.5, 10)])
    result = rocker_driven_four_bar(offsets).inverse()
    assert result.status[10] == Status.SINGULAR
    locked = result.status == Status.JAMMED
    assert locked[8:10].all()
    assert locked[11:13].all()
    assert (result.contraction[locked] >= 1).all()
    far = np.abs(offsets) > 0.4
    assert (result.status[far] == Status.CONVERGED).all()
    assert (np.diff(np.flatnonzero(locked | (offsets == 0))) == 1).all()  # one range around it
    assert is_sound(result)
    narrower = rocker_driven_four_bar(offsets, mu=0.1).inverse().status == Status.JAMMED
    assert narrower.sum() < locked.sum()


# Safeguard: Newton where the fixed point diverges. Without (three passes): solvable samples of
# contraction above 1 come out JAMMED, and `solutions` finds none where the status says CONVERGED.
@pytest.mark.filterwarnings("ignore:mu.static:pinfric.errors.PinfricWarning")
@pytest.mark.filterwarnings("ignore:.*usually at most")
def test_four_bar_with_mu_from_0_to_10():
    widths = []
    for mu in (0.0, 0.1, 0.3, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0):
        result = turning_four_bar(15, mu=mu).inverse()
        assert is_sound(result)
        assert (result.status[result.contraction < 1] == Status.CONVERGED).all()
        widths.append(float(np.nanmean(np.abs(result.effort_lower - result.effort_frictionless))))
    assert widths[0] == 0.0
    assert widths == sorted(widths)


# Safeguard: up to twelve sticking sites every corner. Without (single flips beyond eight): ends of
# other chains of ten pins are up to 30 % too narrow (`test_pin_chains.py`).
def test_ten_sites_that_stick_at_once():
    result = four_bars_in_a_row().inverse()
    assert result.sticking.sum(axis=1).tolist() == [10] * 5
    assert result.interval_exact.all()
    assert (result.effort_lower < result.effort_frictionless).all()
    assert (result.effort_frictionless < result.effort_upper).all()
    assert is_sound(result)


def test_sixty_joints_held_by_a_force_at_the_tip():
    case = long_chain()
    result = case.inverse()
    assert result.wrench.shape[1] == 60
    assert (result.status == Status.CONVERGED).all()
    assert judge(result).passed(1e-11)


# Safeguard: residuals are relative. Without (an absolute tolerance of 1e-11): light bars end too
# early, check fails.
@pytest.mark.parametrize("ratio", [1e-3, 1.0, 1e3])
def test_mass_ratios_of_a_million(ratio):
    """Bars of 1, r and r^2: 1e-6 to 1e6."""
    result = four_bar_of_masses(ratio).inverse()
    assert (result.status == Status.CONVERGED).all()
    assert is_sound(result, 1e-12)
    light = Case(result.scene, *(getattr(result.states, n) for n in "qva"))
    assert judge(light.inverse()).passed(1e-12)


# Safeguard: loads at the two ends of a pin. Without (moments ignored): check fails for the short
# one.
@pytest.mark.parametrize("length", [1e-6, 1e6])
def test_pins_a_micrometre_and_a_thousand_kilometres_long(length):
    friction = pin_friction(0.3, length=length)
    gravity = (1.0, -8.0, 5.0)  # out of the plane: pins carry moments
    with pytest.warns(pf.PinfricWarning) if length > 1 else nullcontext():
        case = turning_four_bar(24, "B", "revolute", gravity=gravity, friction=friction)
    result = case.inverse()
    assert is_sound(result)
    if length > 1:  # moments have no lever left: a pin without length
        plain = turning_four_bar(24, "B", "revolute", gravity=gravity).inverse()
        assert_allclose(result.effort_lower, plain.effort_lower, rtol=1e-6, atol=1e-9)
    else:
        assert np.nanmax(np.abs(result.normal_load)) > 1e3  # 1 N m across 1 micrometre


# Safeguard: a scene with nothing to choose still has one choice. Without: no ends at reversals, an
# array of no size.
def test_pins_of_radius_zero_have_no_friction():
    result = turning_four_bar(30, friction=pin_friction(0.3, radius=0.0)).inverse()
    assert_array_equal(result.effort_lower, result.effort_frictionless)
    assert (result.friction_upper == 0).all()
    assert is_sound(result)


def massless(case):
    """The same motion of a mechanism without mass: only friction itself loads its pins."""
    model = case.scene.model.copy()
    for joint in range(1, model.njoints):
        model.inertias[joint] = pin.Inertia.Zero()
    scene = pf.Scene(
        model=model,
        friction=case.scene.friction,
        loops=case.scene.loops,
        actuators=case.scene.actuators,
    )
    return Case(scene, case.q, case.v, case.a)


@pytest.mark.parametrize("moving", [True, False])
def test_no_load_and_no_motion_is_no_effort(moving):
    case = turning_four_bar(6, gravity=(0.0, 0.0, 0.0))
    case = massless(case) if moving else Case(case.scene, case.q, 0 * case.v, 0 * case.a)
    result = case.inverse()
    for name in ("effort_lower", "effort_upper", "friction_upper", "normal_load"):
        assert (getattr(result, name) == 0).all(), name
    assert (result.status == Status.CONVERGED).all()
    assert judge(result).equilibrium == 0


# Safeguard: a norm at zero has no direction. Without (p / |p| in the Jacobian): NaN where Newton is
# needed, samples of contraction above 1 come out JAMMED.
def test_thrust_rings_that_nothing_loads():
    """In the plane no pin carries a force along its axis: that contact force is always zero."""
    friction = pin_friction(1.3, 0.05, thrust_radius=0.02)
    result = turning_four_bar(24, "B", "revolute", friction=friction).inverse()
    assert result.contraction.min() < 1 < result.contraction.max()
    assert (result.status == Status.CONVERGED).all()
    plain = turning_four_bar(24, "B", "revolute", friction=pin_friction(1.3, 0.05)).inverse()
    assert_allclose(result.effort_lower, plain.effort_lower, rtol=1e-12)


def test_constant_friction_loads_pins_that_nothing_else_loads():
    friction = {**pin_friction(1.3, 0.05), "coulomb": {"static": 0.05, "kinetic": 0.05}}
    result = massless(turning_four_bar(24, gravity=(0, 0, 0), friction=friction)).inverse()
    assert (result.status == Status.CONVERGED).all()
    assert (result.effort_frictionless == 0).all()
    assert (result.effort_lower > 0.05).all()  # the crank's own 0.05 N m, and the others'
    assert is_sound(result)


# Safeguard: rates of loops are compared with the terms they are the difference of. Without (1e-12
# m/s and 1e-9 m/s^2 absolute): rounding is a violation at 1e6 rad/s.
@pytest.mark.parametrize("rate", [1e3, -1e3, 1e6])
def test_a_crank_at_a_thousand_and_a_million_radians_per_second(rate):
    acceleration = -0.2 * rate**2
    case = turning_four_bar(40, rate=rate, acceleration=acceleration)
    result = case.inverse()
    slides = ~result.reversal.any(axis=1)
    expected = np.array(
        [crank_torque(FourBar(), x, rate, acceleration)[0] for x in case.known["angles"]]
    )
    scale = np.abs(expected).max()
    assert np.abs(result.effort_lower[:, 0] - expected)[slides].max() < 1e-11 * scale
    assert is_sound(result)


# Safeguard: dependent joints follow from the closure, sample by sample. Without (their own noise
# left in): LoopMotionError.
def test_a_noisy_measured_crank():
    case = measured_four_bar(120)
    result = case.inverse()
    assert (result.status == Status.CONVERGED).all()
    assert is_sound(result)
    noisy = case.q + 1e-3 * np.random.default_rng(1).normal(size=case.q.shape)
    with pytest.raises(pf.PinfricError, match="is open at sample 0"):
        Case(case.scene, noisy, case.v, case.a).inverse()


# Safeguard: least squares over all joints where closures are redundant. Without (free unknowns 0):
# every cut gives other efforts.
def test_redundant_loops_under_gravity_out_of_the_plane():
    efforts = []
    for cut in "OABC":
        friction = pin_friction(0.3, 0.05, length=0.02)
        case = turning_four_bar(20, cut, "revolute", gravity=(2.0, -5.0, 8.0), friction=friction)
        result = case.inverse()
        assert result.redundant
        assert is_sound(result)
        efforts.append(result.effort_lower)
    for other in efforts[1:]:
        assert_allclose(other, efforts[0], atol=1e-9)


# Safeguard: a sign change between two samples is a passage through rest. Without: no sample has an
# interval.
def test_a_crank_that_turns_round_every_millisecond():
    result = shaking_four_bar(60).inverse()
    assert not result.sticking.any()
    assert result.reversal.all(axis=1).sum() >= 59
    wide = result.effort_upper[:, 0] - result.effort_lower[:, 0]
    rest = resting_at(result).inverse()
    limits = rest.effort_upper[0, 0] - rest.effort_lower[0, 0]
    assert wide[result.reversal.all(axis=1)] == pytest.approx(limits, rel=1e-3)  # 0.05 rad/s
    assert is_sound(result)


def resting_at(result):
    zero = np.zeros((1, 3))
    return Case(result.scene, result.states.q[:1], zero, zero)


# Safeguard: |v| <= stick velocity sticks, at the first sample too. Without (<): no interval.
def test_stick_exactly_at_the_first_sample():
    case = turning_four_bar(30)
    v, a = case.v.copy(), case.a.copy()
    v[0] = a[0] = 0.0
    scene = pf.Scene(
        model=case.scene.model,
        loops=case.scene.loops,
        friction=case.scene.friction,
        actuators=case.scene.actuators,
        stick_velocity=0.0,
    )
    result = pf.inverse_dynamics(scene, case.q, v, a, t=np.linspace(0, 1, 30))
    assert result.sticking[:, 0].tolist() == [True] + [False] * 29
    assert result.effort_lower[0, 0] < result.effort_upper[0, 0]
    assert result.stick_intervals()[0].start == 0.0
    assert is_sound(result)


# No safeguard of its own: equal samples have equal answers to the last bit.
def test_holding_for_1e5_seconds_at_growing_steps():
    case = holding_four_bar()
    result = case.inverse()
    assert case.t[-1] == pytest.approx(1e5)
    for name in ("effort_lower", "effort_upper", "wrench", "normal_load"):
        assert np.ptp(getattr(result, name), axis=0).max() == 0.0, name
    (summary,) = summarize(result)
    worst = max(abs(result.effort_lower[0, 0]), abs(result.effort_upper[0, 0]))
    assert summary.rms == pytest.approx(worst, rel=1e-12)  # time-weighted
    assert summary.stick_time == pytest.approx(1e5)


# Safeguard: steps are weighted by time. Without (a mean over samples): the RMS is 0.3 % off.
def test_uneven_steps_do_not_change_what_is_time_weighted():
    case = turning_four_bar(4001)
    t = np.linspace(0, 1, 4001)
    even = pf.inverse_dynamics(case.scene, case.q, case.v, case.a, t=t)
    keep = np.sort(np.random.default_rng(0).choice(4001, 2500, replace=False))
    keep = np.unique(np.concatenate([[0, 4000], keep[keep > 1000], np.arange(0, 1000, 2)]))
    uneven = pf.inverse_dynamics(case.scene, case.q[keep], case.v[keep], case.a[keep], t=t[keep])
    assert_allclose(uneven.effort_frictionless, even.effort_frictionless[keep])
    assert summarize(uneven)[0].rms == pytest.approx(summarize(even)[0].rms, rel=1e-3)


# Safeguard: the twin has the model's gravity. Without (left in the plane): check fails.
def test_gravity_misaligned_with_the_plane():
    tilted = (0.3, -9.7, 1.2)
    result = turning_four_bar(
        20, "B", "revolute", gravity=tilted, friction=pin_friction(0.3, length=0.02)
    ).inverse()
    assert is_sound(result)
    # out of the plane nothing moves: the two ground pins carry the weight's part along z
    ground = [result.site_names.index(name) for name in "OC"]
    along = result.wrench[:, ground, 2].sum(axis=1)
    assert_allclose(along, -(0.5 + 1.2 + 0.9) * 1.2, rtol=1e-12)


# Safeguard: pivots are compared with the levers' size: rounding is no lever. Without: JAMMED.
@pytest.mark.parametrize("line", [0.0, 1e-13, 1e-6])
def test_a_cylinder_in_line_with_its_pin_cannot_hold(line):
    case = hinged_weight(line)
    result = case.inverse()
    if line < 1e-9:
        assert result.status[0] == Status.SINGULAR
        assert np.isnan(result.effort_lower).all()
        assert result.solutions(0) == ()
    else:  # the ram's force loads the pin beyond what its lever overcomes
        assert result.status[0] == Status.JAMMED
    with np.errstate(invalid="raise"):
        assert judge(result).passed()


# Safeguard: a ball at rest has no direction of slip. Without: 0 / 0.
def test_a_ball_that_does_not_turn_is_held_by_its_sphere():
    case = ball_tripod()
    result = Case(case.scene, case.q, 0 * case.v, 0 * case.a).inverse()
    assert (result.effort_lower < result.effort_upper).all()
    assert is_sound(result)


def test_the_known_drawer_forces_are_what_bisection_finds():
    """The closed form that several tests use, by another way."""
    for mu, acceleration in ((0.3, 1.0), (0.6, -7.5)):
        for force in drawer_forces(mu, acceleration):
            load = np.hypot(4.0 * 9.81, 2 * force)
            assert force == pytest.approx(4.0 * acceleration + mu * load, rel=1e-12)


def test_resting_four_bar_is_sound():
    assert is_sound(resting_four_bar(static=0.4).inverse())
