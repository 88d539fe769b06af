"""Overload within a cycle: heat and standstills by hand, and against an independent integration."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sizing_cases import MOTOR, hour_with_a_stall, one_drive

import pinfric as pf
from pinfric.drives.criterion import Status
from pinfric.drives.duty import Schedule
from pinfric.drives.overload import Lag, heat_lag, longest_above, settled_heat
from pinfric.drives.policy import Conditions
from pinfric.drives.thermal import Thermal

EVER = np.ones(100, dtype=bool)


def one(tau):
    return Lag((tau,), (1.0,), "")


@pytest.mark.parametrize(("tau", "on"), [(50.0, 240.0), (600.0, 240.0), (1e5, 60.0)])
def test_the_overload_rule_of_intermittent_duty(tau, on):
    """IEC 60034-1, S3: p^2 (1 - e^(-on/tau)) = 1 - e^(-period/tau) heats as 1 does for ever."""
    period = 600.0
    t = np.array([0.0, on, on + 1e-9, period])
    p = np.sqrt(-np.expm1(-period / tau) / -np.expm1(-on / tau))
    x = np.array([p, p, 0.0, 0.0])
    assert settled_heat(t, x, one(tau)) == pytest.approx(1.0, rel=1e-7)


def test_two_nodes_add_up_by_their_resistances():
    """Each node has its own share of the rise, and its own decay after a block."""
    t, taus, parts = np.array([0.0, 30.0, 30.0 + 1e-9, 400.0]), (20.0, 300.0), (0.4, 0.6)
    at_end = [
        part * np.expm1(-30.0 / tau) / np.expm1(-400.0 / tau)
        for tau, part in zip(taus, parts, strict=True)
    ]
    found = settled_heat(t, np.array([2.0, 2.0, 0.0, 0.0]), Lag(taus, parts, ""))
    assert found == pytest.approx(2.0 * np.sqrt(sum(at_end)), rel=1e-7)
    lag = heat_lag(Thermal(**MOTOR["thermal"]), None, Conditions())
    assert (lag.times, lag.parts) == ((20.0, 300.0), (0.4, 0.6))
    assert heat_lag(None, 1200.0, Conditions()).times == (1200.0,)
    assert heat_lag(None, None, Conditions()).times == (Conditions().thermal_time,)


def test_time_off_makes_room_for_overload_and_is_not_ignored():
    t = np.array([0.0, 10.0])
    duty = Schedule((0, 2, 4), (24.0, 1.0), ("work",), off=True)
    cycles = np.concatenate([t, t[-1] + 1e-9 + np.array([0.0, 360.0])])
    x = np.array([1.0, 1.0, 0.0, 0.0])
    expected = np.sqrt(np.expm1(-240 / 900) / np.expm1(-600 / 900))
    assert settled_heat(cycles, x, one(900.0), duty) == pytest.approx(expected, rel=1e-6)
    assert expected == pytest.approx(0.694, abs=1e-3)  # 44 % more than for ever


@given(st.integers(0, 10_000), st.floats(0.05, 20.0))
def test_a_fine_integration_finds_the_same(seed, tau):
    rng = np.random.default_rng(seed)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, 11))])
    y = rng.uniform(0.0, 4.0, 12)
    fine = np.linspace(0.0, t[-1], 20_001)
    heat, step, theta = np.interp(fine, t, y), fine[1], 0.0
    keep, add = np.exp(-step / tau), -np.expm1(-step / tau)
    theta = 0.0
    for value in (heat[1:] + heat[:-1]) / 2:  # once round from cold gives the settled start
        theta = keep * theta + add * value
    theta /= -np.expm1(-t[-1] / tau)
    at, most = 0, 0.0
    for k, value in enumerate((heat[1:] + heat[:-1]) / 2):
        theta = keep * theta + add * value
        while at < 11 and t[at + 1] <= fine[k + 1] + step / 2:
            at += 1
            most = max(most, theta)
    found = settled_heat(t, np.sqrt(y), one(tau))
    # x^2 of the samples is linear between them; the integration's grid misses them by half a step
    assert found**2 == pytest.approx(most, rel=2e-3 * max(1.0, 1.0 / tau))


def test_a_cycle_much_shorter_than_the_time_constant_counts_by_its_mean():
    t, x = np.linspace(0, 3, 50), np.random.default_rng(0).normal(size=50)
    rms = np.sqrt(np.trapezoid(x**2, t) / 3)
    assert settled_heat(t, x, one(1e5)) == pytest.approx(rms, rel=1e-4)


def test_a_constant_torque_is_its_own_to_the_last_bit():
    t = np.cumsum(np.random.default_rng(0).uniform(0.1, 1.0, 300))
    assert settled_heat(t, np.full(300, 0.3), one(7.3)) <= 0.3


def test_the_longest_time_above_a_limit():
    t = np.arange(100.0)
    x = np.where((t >= 10) & (t < 20), -3.0, 0.0)  # crosses 1 a third into its edges' seconds
    assert longest_above(t, x, 1.0, EVER) == pytest.approx(9 + 2 * 2 / 3, rel=1e-12)
    moving = EVER.copy()
    moving[15] = False
    assert longest_above(t, x, 1.0, moving) == pytest.approx(4 + 2 / 3, rel=1e-12)
    assert longest_above(t, np.roll(x, -15), 1.0, EVER) == pytest.approx(8 + 4 / 3, rel=1e-12)
    assert longest_above(t, x, 3.0, EVER) == 0.0
    assert longest_above(t, 0 * x + 2, 1.0, EVER) == np.inf


@pytest.mark.parametrize("thermal", [True, False])
def test_a_motor_stalled_five_minutes_of_an_hour_does_not_pass(tmp_path, thermal):
    """At 2.5 times its continuous torque; over the hour that is 2.5 sqrt(300/3600) = 0.72 of it."""
    scene, hour, drive = hour_with_a_stall()
    if not thermal:
        drive["motor"]["thermal"] = None
    with pytest.warns(pf.PinfricWarning, match="none of 1 candidate fits"):
        (joint,) = pf.size(scene, hour, one_drive(tmp_path, **drive)).joints
    found = {c.name: c for c in joint.assessments[0].criteria}
    assert found["continuous torque"].required == pytest.approx(0.722 * 0.5, rel=0.01)
    assert found["continuous torque"].status == Status.PASSES
    short, standing = found["short-term torque"], found["overloaded standstill"]
    assert (short.status, standing.status) == (Status.FAILS, Status.FAILS)
    if thermal:  # five minutes for winding and housing, then 55 minutes to cool
        rise = sum(
            part * np.expm1(-300 / tau) / np.expm1(-3600 / tau)
            for tau, part in ((20.0, 0.4), (300.0, 0.6))
        )
        assert short.required == pytest.approx(2.5 * 0.5 * np.sqrt(rise), rel=2e-3)
    else:
        assert short.required == pytest.approx(2.5 * 0.5, rel=1e-5)
    assert short.available == 0.5
    assert standing.required == pytest.approx(300.0, rel=1e-9)
    assert standing.available == 20.0  # the winding's constant, or what the conditions say
    assert ("winding and housing" if thermal else "conditions.thermal_time") in short.source
    assert ("winding's time constant" if thermal else "thermal_time") in standing.source
    failed = {c.name for c in joint.assessments[0].failed}
    hot = {"winding temperature", "speed-torque line"} if thermal else set()
    assert failed - hot == {"short-term torque", "overloaded standstill"}


def test_a_short_overload_passes(tmp_path):
    """The same for 2 s: the winding takes 1 - e^(-2/20) of its part, the housing hardly any."""
    scene, hour, drive = hour_with_a_stall(stall=2.0)
    (joint,) = pf.size(scene, hour, one_drive(tmp_path, **drive)).joints
    found = {c.name: c for c in joint.assessments[0].criteria}
    assert found["short-term torque"].status == Status.PASSES
    least = 2.5 * np.sqrt(0.4 * -np.expm1(-2 / 20))
    assert least < found["short-term torque"].required / 0.5 < 1.3 * least
    assert found["overloaded standstill"].required == pytest.approx(2.0, rel=1e-9)
    assert joint.choice is not None
