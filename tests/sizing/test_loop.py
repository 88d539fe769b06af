"""The choice of drives ends where each was judged in the arm that is chosen."""

import re

import numpy as np
import pytest
from builders import example
from sizing_cases import GEAR, MOTOR, trapezoid, turntable, write_catalog

import pinfric as pf
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.policy import Conditions
from pinfric.drives.robot import DrivenRobot
from pinfric.sizing import memory
from pinfric.sizing.drive_search import DriveSearch
from pinfric.sizing.memory import thinned


def judged_and_carried(report):
    """(joint, peak at which its drive was judged, peak with the masses chosen)."""
    return [(j.name, j.installed.drives.case.demand.peak, j.demand.peak) for j in report.joints]


@pytest.mark.slow
def test_a_stiff_arm_of_bare_links_is_judged_with_the_drives_it_gets():
    scene, motion = example("ur5_pick_and_place", masses="without_drives")
    wanted = {"lowest_frequency": 12.0}
    report = pf.size(scene, motion, "default", conditions=wanted, on_miss="ignore")
    for name, judged, carried in judged_and_carried(report):
        assert judged == pytest.approx(carried, rel=1e-9), name
    assert report.verdict.fitted == 6


def test_drives_are_judged_with_the_masses_and_the_stops_that_are_chosen():
    scene, motion = example("ur5_pick_and_place", masses="without_drives")
    report = pf.size(scene, motion, "default", on_miss="ignore")
    for name, judged, carried in judged_and_carried(report):
        assert judged == pytest.approx(carried, rel=1e-9), name
    again = pf.size(scene, motion, report.catalog, on_miss="ignore")
    assert [d and d.name for d in again.drives] == [d and d.name for d in report.drives]


def test_a_load_is_searched_once(monkeypatch):
    """Every round asks for each joint; what it asks is computed once for each load and stops."""
    made, counted = DriveSearch.__init__, []

    def counting(self, *given, **more):
        counted.append(given[1]._replace(stop_effort=repr(given[1].stop_effort)))
        made(self, *given, **more)

    monkeypatch.setattr(DriveSearch, "__init__", counting)
    scene, motion = example("ur5_pick_and_place")
    report = pf.size(scene, motion, "default", on_miss="ignore")
    asked = {(c.demand.name, c.cycle.effort_upper.tobytes(), c.stop_effort) for c in counted}
    assert len(asked) == len(counted) < report.passes * len(report.joints)


def long_hold(samples):
    """A case of the turntable that stands still for 100 s, in so many samples."""
    scene = turntable()
    motion = trapezoid(scene)
    t = np.concatenate([motion.t, motion.t[-1] + np.linspace(0.0, 100.0, samples + 1)[1:]])
    rest = np.zeros((samples, 1))
    q, v, a = (np.concatenate([x, rest]) for x in (motion.q, motion.v, motion.a))
    return scene, pf.Trajectory.from_arrays(scene, t, q, v, a)


def test_a_hold_of_many_samples_is_thinned_and_changes_no_figure(tmp_path, monkeypatch):
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml"))
    scene, motion = long_hold(5000)
    case = DrivenRobot(scene, motion, None, Conditions()).case(0, {})
    few = thinned(case).cycle
    assert len(case.cycle.t) > 5000
    assert len(few.t) < 2000
    assert few.t[-1] == case.cycle.t[-1]
    report = pf.size(scene, motion, catalog, on_miss="ignore")
    monkeypatch.setattr(memory, "thinned", lambda case: case)
    full = pf.size(scene, motion, catalog, on_miss="ignore")
    for one, other in zip(
        report.joints[0].installed.criteria, full.joints[0].installed.criteria, strict=True
    ):
        assert one.name == other.name
        if other.required is not None:
            assert one.required == pytest.approx(other.required, rel=1e-5, nan_ok=True), one.name


def test_what_decides_is_asked_of_the_arm_that_is_chosen(tmp_path):
    """Gears of 1 and 3 kg: the rating of a joint takes the heavy one, its cycle the light one."""
    torques = "average_torque", "repeated_peak_torque", "momentary_peak_torque", "rated_torque"
    weak = GEAR | dict.fromkeys(torques, 40.0) | {"mass": 1.0}
    strong = GEAR | dict.fromkeys(torques, 400.0) | {"mass": 3.0}
    motor = MOTOR | {"continuous_torque": 5.0, "peak_torque": 20.0, "resistance": 0.01}
    catalog = load_catalog(
        write_catalog(tmp_path / "c.yaml", {"M": motor}, {"weak": weak, "strong": strong})
    )
    scene, motion = example("ur5_pick_and_place")
    wanted = {"holding_brake": "any", "inertia_ratio": 1e4, "resonance_base": 1e-3,
              "resonance_hand": 1e-3}  # fmt: skip
    report = pf.size(
        scene, motion, catalog, rating={"payload": 5.0}, conditions=wanted, on_miss="ignore"
    )
    for joint in report.joints:
        mine = {name: a and re.search("weak|strong", a.name)[0] for name, a in joint.alone.items()}
        peaks = report.rating.own
        column = report.scene.actuator_names.index(joint.name)
        effort = np.maximum(*(np.abs(x[:, column]) for x in (
            report.result.effort_lower, report.result.effort_upper)))  # fmt: skip
        for part, samples in (("cycle", peaks), ("rating", ~peaks)):
            if mine[part] is not None:
                heavy = effort[samples].max() > 40.0
                assert mine[part] == ("strong" if heavy else "weak"), (joint.name, part)
