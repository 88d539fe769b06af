"""Long holds: few samples, and every figure over them as of all samples.

The judge is the same motion with every sample of its holds.
"""

from dataclasses import fields

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from retime_cases import MOTORS, planar

import pinfric as pf
from pinfric.drives.demand import power_figures
from pinfric.drives.overload import Lag, longest_above, settled_heat
from pinfric.drives.thermal import Thermal, winding_cycle
from pinfric.elastic.matters import elastic_effect
from pinfric.errors import TrajectoryError
from pinfric.model.described import in_json
from pinfric.motions import sample_times
from pinfric.motions.sample_times import check_memory
from pinfric.motions.sample_times import sample_times as times
from pinfric.motions.summary import ends_by_magnitude, summarize
from pinfric.sizing.summary import sizing_summary

WAY = """pinfric_trajectory: 1
profile: {profile}
sample_rate: {rate}
points:
  - {{q: [0.2], hold: 0.2}}
  - {{q: [1.4], duration: 1.0, hold: {hold}}}
  - {{q: [1.4], duration: {hold}}}
  - {{q: [0.2], duration: 0.8123, hold: 7}}
"""
THERMAL = Thermal(winding_housing=2.0, housing_ambient=3.0, winding_time=20.0, housing_time=300.0)


@pytest.fixture
def both(monkeypatch):
    """Return what a function gives with few and with all samples of long holds."""

    def results(function):
        few = function()
        monkeypatch.setattr(sample_times, "LONG_REST", 10**12)
        return few, function()

    return results


def way(tmp_path, hold=21.0, rate=250, profile="trapezoidal"):
    """A way-point file of the pendulum with a long hold, and as long a move to where it is."""
    file = tmp_path / "way.yaml"
    file.write_text(WAY.format(hold=hold, rate=rate, profile=profile))
    return file


def numbers(content):
    """All numbers of nested lists and mappings, in order."""
    if isinstance(content, dict | list | tuple):
        inside = content.values() if isinstance(content, dict) else content
        return [x for each in inside for x in numbers(each)]
    return [float(content)] if isinstance(content, int | float) else []


@pytest.mark.parametrize("profile", ["trapezoidal", "quintic"])
def test_samples_that_are_kept_are_those_of_all(tmp_path, both, profile):
    scene, file = pf.load_scene("pendulum"), way(tmp_path, profile=profile)
    few, every = both(lambda: pf.load_trajectory(file, scene))
    assert len(few.t) < 2000 < 12000 < len(every.t)
    kept = np.isin(every.t, few.t)
    assert kept.sum() == len(few.t)
    for name in ("t", "q", "v", "a", "attached"):
        assert_array_equal(getattr(every, name)[kept], getattr(few, name), err_msg=name)
    still = (every.v == 0).all(axis=1) & (every.a == 0).all(axis=1)
    assert still[~kept].all()  # only rests lost samples
    assert [(x.start, x.end) for x in few.holds()] == [(x.start, x.end) for x in every.holds()]


@pytest.mark.parametrize(("rate", "hold"), [(1000.0, 2.0), (100.0, 6.0)])
def test_a_short_hold_is_sampled_as_moves_are(rate, hold):
    t = times(hold + 1.0, rate, [(0.5, hold + 0.5)], "file")
    assert_array_equal(t, np.arange(int((hold + 1.0) * rate) + 1) / rate)


@pytest.mark.parametrize("hold", [3.0, 1e5, 1e9])
def test_any_hold_takes_few_samples(hold):
    t = times(hold + 1.0, 1000.0, [(1.0, hold + 1.0)], "file")
    assert len(t) < 1500
    assert (np.diff(t) > 0).all()
    assert_array_equal(t[:1000], np.arange(1000) / 1000.0)
    assert t[-1] == hold + 1.0


def test_what_no_time_can_be():
    with pytest.raises(TrajectoryError, match=r"file: 1e\+11 s .* at most 1e\+10 s"):
        times(1e11, 1.0, [(0.0, 1e11)], "file")
    with pytest.raises(TrajectoryError, match="samples; at most 20000000 are made"):
        times(1e6, 1000.0, [(0.0, 1.0)], "file")


def test_what_does_not_fit_the_memory_is_refused(monkeypatch):
    """Linux ends a process that takes more, without a word."""
    monkeypatch.setattr("os.sysconf", {"SC_PHYS_PAGES": 4_000_000, "SC_PAGE_SIZE": 4096}.get)
    check_memory(10_000_000, 10, "file")
    with pytest.raises(
        TrajectoryError, match=r"20000000 samples of 10 joints take some 30 GB, .* 16"
    ):
        check_memory(20_000_000, 10, "file")


def test_a_hold_of_a_day_is_sized(tmp_path):
    scene = pf.load_scene("pendulum")
    report = pf.size(scene, pf.load_trajectory(way(tmp_path, hold=1e5), scene))
    demand, result = report.joints[0].demand, report.result
    assert len(result.times) < 2500
    assert demand.hold_share == pytest.approx(1.0, abs=1e-4)
    # all but 1e-4 of the time in one hold: its efforts are the means
    k = int(np.searchsorted(result.times, 1e3))
    worst, least = ends_by_magnitude(result.effort_lower[k], result.effort_upper[k])
    assert demand.rms == pytest.approx(abs(worst[0]), rel=1e-4)
    assert demand.rms_least == pytest.approx(abs(least[0]), rel=1e-4)


def test_demands_and_efforts_of_few_samples_are_those_of_all(tmp_path, both):
    scene, file = pf.load_scene("pendulum"), way(tmp_path)

    def figures():
        report = pf.size(scene, pf.load_trajectory(file, scene))
        return numbers(in_json(sizing_summary(report))) + numbers(
            in_json(list(summarize(report.result)))
        )

    few, every = both(figures)
    assert len(few) > 60
    assert_allclose(few, every, rtol=1e-9, atol=1e-12)


def test_heat_lag_and_energy_of_few_samples_are_those_of_all(tmp_path, both):
    scene, file = pf.load_scene("pendulum"), way(tmp_path)

    def figures():
        result = pf.inverse_dynamics(scene, pf.load_trajectory(file, scene))
        worst, _ = ends_by_magnitude(result.effort_lower[:, 0], result.effort_upper[:, 0])
        t, v = result.times, result.actuator_velocity[:, 0]
        winding = winding_cycle(t, worst, 0.8, THERMAL, 40.0, no_load=np.abs(v))
        lag = Lag((20.0, 300.0), (0.4, 0.6), "")
        power = power_figures(t, worst * v)
        return [
            winding.peak - 40.0,
            winding.housing.max() - 40.0,
            settled_heat(t, worst, lag),
            longest_above(t, worst, 0.5 * np.abs(worst).max(), np.ones(len(t), dtype=bool)),
            *(getattr(power, x.name) for x in fields(power)),
        ]

    few, every = both(figures)
    assert few[0] > 1.0
    assert_allclose(few, every, rtol=1e-9)


def test_elasticity_of_few_samples_is_that_of_all(tmp_path, both):
    gear = {"ratio": 50.0, "rotor_inertia": 1e-4, "stiffness": 2e3}
    scene = pf.load_scene("pendulum").with_(actuators=[{"joint": "joint_1", "transmission": gear}])
    file = way(tmp_path)

    def figures():
        result = pf.inverse_dynamics(scene, pf.load_trajectory(file, scene))
        return numbers(in_json(elastic_effect(result)))

    few, every = both(figures)
    assert_allclose(few, every, rtol=1e-9)
    assert few[1] > 0.1  # Hz, bandwidth


def test_bandwidth_of_a_day(tmp_path):
    """That of the same moves closer together: only the lines within their spectrum differ."""
    gear = {"ratio": 50.0, "rotor_inertia": 1e-4, "stiffness": 2e3}
    scene = pf.load_scene("pendulum").with_(actuators=[{"joint": "joint_1", "transmission": gear}])
    found = []
    for hold in (21.0, 1e5):
        motion = pf.load_trajectory(way(tmp_path, hold=hold), scene)
        found.append(elastic_effect(pf.inverse_dynamics(scene, motion)).bandwidth)
    assert found[1] == pytest.approx(found[0], rel=0.05)


def test_a_sweep_over_few_samples_is_that_over_all(tmp_path, both):
    scene, file = pf.load_scene("pendulum"), way(tmp_path)
    spread = {"lognormal": {"median": 1.0, "sigma": 0.4}}
    varied = {"friction.*.mu": spread, "speed": {"uniform": {"low": 0.9, "high": 1.1}}}
    sweep = {"pinfric_sweep": 1, "samples": 4, "seed": 1, "parameters": varied}

    def figures():
        return pf.sweep(scene, pf.load_trajectory(file, scene), sweep).figures

    few, every = both(figures)
    assert np.ptp(few, axis=0).max() > 0.0
    assert_allclose(few, every, rtol=1e-9)


def test_retimed_holds_are_sparse_too(tmp_path, both):
    scene, limits = planar(), {name: x | {"continuous_torque": 0.2} for name, x in MOTORS.items()}
    path = pf.Path.from_waypoints([[0.0, 0.0], [0.8, -1.2], [0.0, 0.0]], holds=[0.1, 30.0, 0.1])
    few, every = both(lambda: pf.retime(scene, path, limits))
    assert len(few.trajectory.t) < 3000 < 30000 < len(every.trajectory.t)
    assert few.duration == pytest.approx(every.duration, rel=1e-9)
    assert_allclose(few.rms, every.rms, rtol=1e-9)
    assert few.limiting.keys() == every.limiting.keys()


def test_a_table_of_few_samples_is_read_as_it_was_written(tmp_path):
    scene = pf.load_scene("pendulum")
    motion = pf.load_trajectory(way(tmp_path, hold=1e5), scene)
    back = pf.load_trajectory(motion.to_csv(tmp_path / "motion.csv", digits=17), scene)
    assert not back.warnings
    for name in ("t", "q", "v", "a"):
        assert_array_equal(getattr(back, name), getattr(motion, name))
