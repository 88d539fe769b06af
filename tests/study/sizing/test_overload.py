"""Overload within a cycle: windows and standstills by hand, and against a search of its own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sizing_cases import hour_with_a_stall, one_drive

import pinfric as pf
from pinfric.study.sizing.criterion import Status
from pinfric.study.sizing.duty import Schedule
from pinfric.study.sizing.overload import longest_above, moving_rms

EVER = np.ones(100, dtype=bool)


def test_a_block_of_overload_fills_its_part_of_the_window():
    """2.5 for 3 s, else 0: over 5 s sqrt(3/5) of it, over 2 s all of it."""
    t = np.array([0.0, 4.0, 4.0 + 1e-9, 7.0, 7.0 + 1e-9, 60.0])
    x = np.array([0.0, 0.0, 2.5, -2.5, 0.0, 0.0])
    assert moving_rms(t, x, 5.0) == pytest.approx(2.5 * np.sqrt(3 / 5), rel=1e-8)
    assert moving_rms(t, x, 2.0) == pytest.approx(2.5, rel=1e-8)
    assert moving_rms(t, x, 60.0) == pytest.approx(2.5 * np.sqrt(3 / 60), rel=1e-8)


def test_the_best_window_begins_and_ends_between_samples():
    """x^2 a triangle of height 1 over 4 s: in 1 s about its top it falls to 3/4 on each side."""
    t, x = np.array([0.0, 2.0, 4.0, 30.0]), np.sqrt([0.0, 1.0, 0.0, 0.0])
    assert moving_rms(t, x, 1.0) == pytest.approx(np.sqrt(7 / 8), rel=1e-12)


def test_windows_run_on_from_the_end_to_the_start():
    t = np.array([0.0, 2.0, 2.0 + 1e-9, 8.0, 8.0 + 1e-9, 10.0])
    x = np.array([1.0, 1.0, 0.0, 0.0, -1.0, -1.0])
    assert moving_rms(t, x, 4.0) == pytest.approx(1.0, rel=1e-8)


@pytest.mark.parametrize("window", [5.0, 12.0, 19.0, 33.0])
def test_repetitions_that_a_duty_leaves_out_hide_no_window(window):
    """Ten cycles of 10 s with overload at both ends, then rest: it meets itself where they join."""
    t = np.array([0.0, 1.0, 1.0 + 1e-9, 9.0 - 1e-9, 9.0, 10.0, 10.0 + 1e-9, 40.0])
    x = np.array([2.0, 2.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0])
    duty = Schedule((0, 6, 8), (10.0, 1.0), ("work", "rest"))
    order, every = duty.played(t)
    assert moving_rms(t, x, window, duty) == pytest.approx(moving_rms(every, x[order], window))


def test_a_window_longer_than_the_cycle_is_the_cycle():
    t, x = np.linspace(0, 3, 50), np.random.default_rng(0).normal(size=50)
    rms = np.sqrt(np.trapezoid(x**2, t) / 3)
    assert moving_rms(t, x, 3.0) == pytest.approx(rms, rel=1e-12)
    assert moving_rms(t, x, 1e9) == pytest.approx(rms, rel=1e-12)


def test_a_constant_torque_is_its_own_rms_to_the_last_bit():
    t = np.cumsum(np.random.default_rng(0).uniform(0.1, 1.0, 300))
    assert moving_rms(t, np.full(300, 0.3), 7.3) <= 0.3


@given(st.integers(0, 10_000), st.floats(0.02, 0.98))
def test_no_window_of_a_search_is_larger(seed, share):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.01, 1.0, 12))
    x, window = rng.normal(size=12), share * (t[-1] - t[0])
    x[-1] = x[0]
    fine = np.linspace(t[0], 2 * t[-1] - t[0], 4001)
    twice = np.concatenate([t[:-1], t + t[-1] - t[0]])
    y = np.interp(fine, twice, np.concatenate([x[:-1], x]) ** 2)
    integral = np.concatenate([[0], np.cumsum((y[1:] + y[:-1]) / 2 * np.diff(fine))])
    start = fine[:2001]
    over = np.interp(start + window, fine, integral) - integral[:2001]
    searched = np.sqrt(over.max() / window)
    found = moving_rms(t, x, window)
    assert found >= searched * (1 - 1e-3)  # the search's own grid
    assert found <= searched * (1 + 5e-3)


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
    with pytest.warns(pf.PinfricWarning, match="none of 1 candidates fits"):
        (joint,) = pf.size(scene, hour, one_drive(tmp_path, **drive)).joints
    found = {c.name: c for c in joint.assessments[0].criteria}
    assert found["continuous torque"].required == pytest.approx(0.722 * 0.5, rel=0.01)
    assert found["continuous torque"].status == Status.PASSES
    short, standing = found["short-term torque"], found["overloaded standstill"]
    assert (short.status, standing.status) == (Status.FAILS, Status.FAILS)
    assert short.required == pytest.approx(2.5 * 0.5, rel=1e-9)
    assert short.available == 0.5
    assert standing.required == pytest.approx(300.0, rel=1e-9)
    assert standing.available == 20.0  # the winding's constant, or what the conditions say
    where = "winding's time constant" if thermal else "conditions.thermal_time"
    assert where in short.source
    assert where in standing.source
    failed = {c.name for c in joint.assessments[0].failed}
    hot = {"winding temperature", "speed-torque line"} if thermal else set()
    assert failed - hot == {"short-term torque", "overloaded standstill"}


def test_a_short_overload_passes(tmp_path):
    """The same for 2 s: 2.5 sqrt(2/20) = 0.79 of the continuous torque within 20 s."""
    scene, hour, drive = hour_with_a_stall(stall=2.0)
    (joint,) = pf.size(scene, hour, one_drive(tmp_path, **drive)).joints
    found = {c.name: c for c in joint.assessments[0].criteria}
    assert found["short-term torque"].status == Status.PASSES
    assert found["short-term torque"].required / 0.5 > 2.5 * np.sqrt(2 / 20)
    assert found["overloaded standstill"].required == pytest.approx(2.0, rel=1e-9)
    assert joint.choice is not None
