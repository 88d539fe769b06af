"""Duties: against figures weighted by hand, and against the same cycles one by one."""

from dataclasses import astuple, replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain
from sizing_cases import (
    ACCELERATION,
    COULOMB,
    CYCLE,
    GEAR,
    INERTIA,
    MOTOR,
    PAUSE,
    PLATEAU,
    RAMP,
    RATE,
    hour_with_a_stall,
    one_drive,
    sized_cycle,
    trapezoid,
    turntable,
)

import pinfric as pf
from pinfric.drives.criterion import Status
from pinfric.drives.duty import Schedule
from pinfric.drives.overload import Lag, settled_heat
from pinfric.errors import CatalogError, SizingError


def mean_square(speed):
    """Of the turntable's worst effort over the trapezoidal cycle at a fraction of its speed."""
    push = INERTIA * ACCELERATION * speed**2
    parts = (push + COULOMB, RAMP), (COULOMB, PLATEAU), (push - COULOMB, RAMP), (COULOMB, PAUSE)
    return sum(effort**2 * time for effort, time in parts) / CYCLE


@pytest.mark.parametrize("on", [1.0, 0.4])
def test_rms_of_a_mixed_duty_is_that_weighted_by_hand(on):
    scene = turntable()
    fast = trapezoid(scene)
    duty = pf.Duty(((fast, 0.7), (fast.with_speed(0.5), 0.3)), on=on)
    report = pf.size(scene, duty)
    demand = report.joints[0].demand
    by_hand = on * (0.7 * mean_square(1.0) + 0.3 * mean_square(0.5))
    assert demand.rms == pytest.approx(np.sqrt(by_hand), rel=1e-6)
    assert demand.duty == pytest.approx(0.5 * on, abs=1e-3)
    assert demand.peak == pytest.approx(INERTIA * ACCELERATION + COULOMB)
    assert report.period == pytest.approx(600.0)


def test_counts_are_the_cycles_written_out_one_by_one(tmp_path):
    """Every figure of every criterion, temperatures, windows and standstills across cycles."""
    scene = turntable()
    fast = trapezoid(scene, samples=40)
    slow, catalog = fast.with_speed(0.6), one_drive(tmp_path)
    runs, end = [], 0.0
    for cycle in (fast, fast, fast, slow, slow):
        runs.append(replace(cycle, t=cycle.t - cycle.t[0] + end))
        end = runs[-1].t[-1] + 1e-9
    long = replace(
        fast,
        t=np.concatenate([run.t for run in runs]),
        **{
            x: np.concatenate([getattr(run, x) for run in runs])
            for x in ("q", "v", "a", "attached")
        },
    )
    given = {"thermal_time": 3.0, "inertia_ratio": 20.0}
    (joint,) = pf.size(scene, pf.Duty(((fast, 3), (slow, 2))), catalog, conditions=given).joints
    (same,) = pf.size(scene, long, catalog, conditions=given).joints
    for found, wanted in zip(joint.installed.criteria, same.installed.criteria, strict=True):
        assert found.name == wanted.name
        if wanted.required is not None:
            assert found.required == pytest.approx(wanted.required, rel=1e-6)
    # energies: a cycle's copper loss is that of its hottest repetition
    numbers = [[x for x in astuple(j.motor.figures) if isinstance(x, float)] for j in (joint, same)]
    assert numbers[0] == pytest.approx(numbers[1], rel=1e-4)
    assert joint.motor.winding.peak > joint.motor.winding.winding[0]  # it varies over the period


def test_switched_off_the_motor_cools_and_bears_nothing(tmp_path):
    scene = turntable()
    catalog = one_drive(tmp_path)
    fast = trapezoid(scene, samples=40)
    hot, cool = (
        pf.size(scene, pf.Duty(((fast, 1.0),), on), catalog, conditions={"inertia_ratio": 20.0})
        for on in (1.0, 0.25)
    )
    figures, off = hot.joints[0].motor.figures, cool.joints[0].motor
    assert off.figures.rms == pytest.approx(0.5 * figures.rms, rel=1e-9)
    assert off.figures.mean_temperature - 25 < 0.26 * (figures.mean_temperature - 25)
    assert off.figures.mean_temperature < off.figures.peak_temperature < figures.peak_temperature
    assert (off.torque_lower[-2:] == 0).all()
    assert (off.torque_upper[-2:] == 0).all()


def test_the_housing_is_hottest_after_the_motor_was_switched_off(tmp_path):
    scene = turntable()
    duty = pf.Duty(((trapezoid(scene, samples=40), 1.0),), on=0.2, period=300.0)
    (joint,) = pf.size(scene, duty, one_drive(tmp_path), conditions={"inertia_ratio": 20.0}).joints
    winding, off = joint.motor.winding, ~joint.cycle.powered
    first, thermal = np.flatnonzero(off)[0], MOTOR["thermal"]
    # without current: x' = A x from where it was switched off, by eigenvectors
    g1, g2 = 1 / thermal["winding_housing"], 1 / thermal["housing_ambient"]
    c1, c2 = thermal["winding_time"] * g1, thermal["housing_time"] * g2
    rates, ways = np.linalg.eig([[-g1 / c1, g1 / c1], [g1 / c2, -(g1 + g2) / c2]])
    start = np.linalg.solve(ways, [winding.winding[first] - 25, winding.housing[first] - 25])
    rise = np.exp(np.outer(np.linspace(0, 240, 20_001), rates)) * start @ ways[1]
    assert rise.max() > 1.02 * max(rise[0], rise[-1])
    assert winding.housing.max() - 25 == pytest.approx(rise.max(), rel=1e-3)
    assert joint.cycle.t[off][-1] - joint.cycle.t[off][0] == pytest.approx(240.0)


def test_continuous_torque_follows_the_makers_curve_at_the_mean_speed(tmp_path):
    curve = [[0.0, 0.5], [600.0, 0.1]]
    catalog = one_drive(tmp_path, motor={"continuous_torque": None, "continuous_curve": curve})
    (joint,) = sized_cycle(catalog).joints
    mean_speed = GEAR["ratio"] * RATE * (RAMP + PLATEAU) / CYCLE
    found = joint.assessments[0].criteria[0]
    assert found.available == pytest.approx(0.5 - 0.4 * mean_speed / 600.0, rel=1e-6)
    assert "of the maker's curve at the mean speed, 56.25 rad/s" in found.note
    with pytest.raises(CatalogError, match="rad/s ascending"):
        one_drive(tmp_path, motor={"continuous_curve": curve[::-1]})


@pytest.mark.parametrize(("rating", "longest"), [(1.24, 300.0), (1.26, 0.0)])
def test_a_stall_rating_counts_at_a_standstill(tmp_path, rating, longest):
    scene, hour, drive = hour_with_a_stall()
    drive["motor"]["continuous_stall_torque"] = rating  # 1.25 N m are asked for
    (joint,) = pf.size(scene, hour, one_drive(tmp_path, **drive), on_miss="ignore").joints
    found = next(c for c in joint.assessments[0].criteria if c.name == "overloaded standstill")
    assert found.required == pytest.approx(longest, abs=0.3)
    assert "continuous stall torque" in found.formula


@pytest.mark.parametrize(
    ("gear", "borne"), [({"kind": "strain wave"}, 1047.2), ({"momentary_peaks": 1000}, 1000)]
)
def test_overloads_are_counted_against_what_the_gear_bears(tmp_path, gear, borne):
    """150 rad/s at its input are 23.873 turns a second: 1e4/(2 x 23.873 x 0.2 s)."""
    conditions = {
        "collision_effort": {"table": 80.0},
        "collisions": {"count": 1020, "duration": 0.2},
    }
    catalog = one_drive(tmp_path, gear=gear, conditions=conditions)
    (joint,) = sized_cycle(catalog, on_miss="ignore").joints
    found = next(c for c in joint.assessments[0].criteria if c.name == "gear momentary peaks")
    assert found.available == pytest.approx(borne, rel=1e-4)
    assert (found.status == Status.PASSES) == (borne > 1020)


def two_joints():
    return pf.Scene(chain(*((name, pin.JointModelRZ()) for name in "ab"), beside=True))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"weights": (0.7, 0.2)}, "the shares 0.7, 0.2 add up to 0.9; shares of the time add up"),
        ({"weights": (2, 0.5)}, "the shares 2, 0.5 add up to 2.5"),
        ({"weights": (-1, 2)}, "share or count -1; give"),
        ({"weights": (0.5, np.nan)}, "share or count nan"),
        ({"on": 1.4}, "switched on for 1.4 of the period; give a share above 0, at most 1"),
        ({"on": 0.0}, "switched on for 0 of"),
        ({"period": -1.0}, "a period of -1 s"),
        ({"weights": (2, 3), "period": 60.0}, "a period of 60 s is given too"),
        ({"period": 3.0}, "takes 2 s, longer than its share 0.5, 1.5 s of a period of 3 s"),
        ({"other": True}, r"moves \['a', 'b'\], trajectory \['table'\]; all cycles must be of one"),
    ],
)
def test_duties_that_cannot_be_say_so_in_one_line(change, said):
    cycle = trapezoid(turntable(), samples=3)
    other, weights = cycle, change.pop("weights", (0.5, 0.5))
    if change.pop("other", False):
        zero = np.zeros((2, 2))
        other = pf.Trajectory.from_arrays(two_joints(), [0.0, 1.0], zero, zero, zero)
    with pytest.raises(SizingError, match=said) as problem:
        pf.Duty(tuple(zip((cycle, other), weights, strict=True)), **change)
    assert "\n" not in str(problem.value)


def test_a_part_that_is_not_run_counts_for_no_mean_and_no_heat():
    t = np.concatenate([np.linspace(0, 2, 21), np.linspace(2.1, 5, 30)])
    x = np.concatenate([np.full(21, 3.0), np.linspace(1, 2, 30)])
    duty = Schedule((0, 21, 51), (1.0, 1.0), ("a", "b")).only({1})
    assert list(duty.parts()) == [("b", slice(21, 51))]
    lag = Lag((4.0,), (1.0,), "")
    assert settled_heat(t, x, lag, duty) == pytest.approx(settled_heat(t[21:], x[21:], lag))
    assert np.ptp(duty.stretched(t)) == pytest.approx(2.9 + 0.1)  # and the step between the parts
