"""What cannot be sized is refused in one line; and a long choice says how far it is."""

import re

import pinocchio as pin
import pytest
from sizing_cases import GEAR, MOTOR, one_drive, sized_cycle, trapezoid, turntable, write_catalog

import pinfric as pf
from pinfric.drives.duty import Duty
from pinfric.errors import SizingError


def mounted(**gravity):
    """A duty on the floor, and scenes that are mounted otherwise, one cycle in each."""
    scene = turntable()
    model = scene.model.copy()
    model.addBodyFrame("plate", 1, pin.SE3.Identity(), 0)
    scene = scene.with_(model=model)
    motion = trapezoid(scene)
    others = [scene.with_(gravity=list(g)).with_(source=name) for name, g in gravity.items()]
    elsewhere = tuple((other, Duty(((trapezoid(other), 1.0),))) for other in others)
    return scene, Duty(((motion, 1.0),), elsewhere=elsewhere)


def refused(tmp_path, said, duty, scene, **more):
    with pytest.raises(SizingError, match=said) as found:
        pf.size(scene, duty, one_drive(tmp_path, MOTOR, GEAR), on_miss="ignore", **more)
    assert "\n" not in str(found.value)


def test_mountings_that_contradict_are_refused(tmp_path):
    floor = turntable().model.gravity.linear
    scene, duty = mounted(same=floor)
    refused(
        tmp_path, "with another gravity and nothing else, found: gravity is the same", duty, scene
    )
    scene, duty = mounted(nowhere=(0.0, 0.0, 0.0))
    refused(tmp_path, r"robot.gravity is \[0, 0, 0\]; give the gravity", duty, scene)


def test_a_rating_beside_a_cycle_of_another_scene_is_refused(tmp_path):
    scene, duty = mounted(wall=(9.81, 0.0, 0.0))
    rating = {"payload": 1.0, "link": "plate", "speed": {"table": 1.0}}
    refused(tmp_path, "a rating beside cycles of other scenes", duty, scene, rating=rating)


def test_a_catalogue_of_one_gear_says_that_it_has_no_motors(tmp_path):
    catalog = write_catalog(tmp_path / "c.yaml", motors={})
    report = sized_cycle(catalog, on_miss="ignore")
    (joint,) = report.joints
    assert joint.choice is joint.nearest is None
    assert joint.nothing_because == f"{catalog} has no motors"
    assert not report.verdict.signed


def test_a_choice_says_which_of_how_many_drives_it_asks(tmp_path):
    steps = []
    sized_cycle(one_drive(tmp_path, MOTOR, GEAR), on_miss="ignore", progress=steps.append)
    assert any(re.fullmatch(r"round 1: table, drive 1 of 1", line) for line in steps)
