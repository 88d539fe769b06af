"""Limits of drives: of a motors file, of the catalogue, as `size` judges them."""

import re
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import chain, lump
from retime_cases import lifting, straight
from sizing_cases import GEAR, MOTOR, one_drive, turntable, write_catalog

import pinfric as pf
from pinfric.drives.catalog import Amplifier
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.drivetrain import drives_of
from pinfric.drives.policy import Conditions
from pinfric.errors import CatalogError
from pinfric.retiming.limits import candidate_limits, read_limits
from pinfric.retiming.path import Path
from pinfric.retiming.retime import retime

DRIVE = """pinfric_motors: 1
conditions: {peak_factor: 1.0, bus_voltage: 24.0}
drives:
  j: {drive: CubeMars AK80-64, acceleration: 2.0}
"""


def test_motors_file_with_a_drive_of_the_catalogue(tmp_path):
    """Its figures at the motor's shaft: a gearmotor's are printed at the output."""
    file = tmp_path / "motors.yaml"
    file.write_text(DRIVE)
    limits = read_limits(lifting(), file)[0]
    entry = load_catalog().gearmotors["CubeMars AK80-64"]
    assert limits.acceleration == 2.0
    assert limits.peak_torque == pytest.approx(entry.peak_torque / entry.ratio)
    assert limits.no_load_speed == pytest.approx(
        0.9 * entry.no_load_speed * entry.ratio * 24.0 / entry.nominal_voltage
    )
    found = retime(lifting(), straight(1.0), file)
    assert found.duration == pytest.approx(np.sqrt(4 * 1.0 / 2.0), rel=1e-3)
    assert found.fitted == ("j: CubeMars AK80-64",)


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        (
            DRIVE.replace("AK80-64", "AK80-6000"),
            pf.RetimeError,
            r"drives.j: the catalogue has no drive .* \(default\); the nearest of",
        ),
        (
            "pinfric_motors: 1\nothers: {max_speed: 3.0}",
            pf.RetimeError,
            "others: nothing limits its torque",
        ),
        (
            "pinfric_motors: 1\ndrives: {jay: {peak_torque: 3.0}}",
            pf.RetimeError,
            "drives: there is no drive 'jay'",
        ),
        (DRIVE.replace("drives", "motors"), pf.PinfricError, "unknown key `motors`"),
    ],
)
def test_motors_files_that_cannot_be_are_refused(tmp_path, text, error, says):
    (tmp_path / "motors.yaml").write_text(text)
    with pytest.raises(error, match=f"motors.yaml: {says}"):
        retime(lifting(), straight(1.0), tmp_path / "motors.yaml")


def table_drive(tmp_path, gear=None, motor=None, **conditions):
    """A turntable, the drive of `sizing_cases` with figures changed, and its limits."""
    catalog = one_drive(tmp_path, motor, gear)
    ((_, make),) = drives_of(catalog, False)
    candidate = make()
    return turntable(), candidate_limits(candidate, Conditions(**conditions)), candidate


def test_an_amplifiers_continuous_current_is_heat_of_its_own(tmp_path):
    """Its RMS is used up, and named, if it is less than the motor's continuous torque."""
    amplifier = Amplifier(
        source="invented", grade="R", continuous_current=2.0, peak_current=20.0, current="dc"
    )
    scene, _, candidate = table_drive(tmp_path)
    fed = replace(candidate, amplifier=amplifier)
    path = Path.from_waypoints([[0.0], [2.0], [0.0]])
    found = retime(scene, path, {"table": fed})
    assert found.limiting["table"]["amplifier continuous current"] == 1.0
    by_name = {c.name: c for c in found.criteria["table"]}
    assert by_name["amplifier continuous current"].margin == pytest.approx(0.0, abs=2e-3)
    assert by_name["amplifier continuous current"].available == 2.0 * MOTOR["torque_constant"]


def test_a_drive_of_the_catalogue_is_limited_as_size_judges_it(tmp_path):
    """The retimed motion uses all of a limit that `size` finds used up, and heat is one."""
    scene, limits, candidate = table_drive(tmp_path)
    assert limits.peak_torque == MOTOR["peak_torque"] / Conditions().peak_factor
    hot = 1 + 0.0039 * (MOTOR["thermal"]["max_winding"] - 25)
    stall = 0.9 * 48.0 * MOTOR["torque_constant"] / (MOTOR["resistance"] * hot)
    assert limits.stall_torque == pytest.approx(stall)
    path = Path.from_waypoints([[0.0], [2.0], [0.0]])
    once = retime(scene, path, {"table": candidate}, heat=False)
    with pytest.warns(pf.PinfricWarning, match="table: this motion, repeated, does not pass"):
        found = retime(scene, path, {"table": candidate})
    assert once.duration < found.duration
    assert found.limiting["table"]["continuous torque"] == 1.0
    assert found.rms == pytest.approx([1.0], abs=2e-3)
    by_name = {c.name: c for c in found.criteria["table"]}
    assert by_name["continuous torque"].margin == pytest.approx(0.0, abs=2e-3)
    given = {key: getattr(Conditions(), key) for key in ("ambient", "rms_factor")}
    asked = {"conditions": given, "on_miss": "ignore"}
    report = pf.size(scene, found.trajectory, one_drive(tmp_path), **asked)
    for mine, theirs in zip(
        found.criteria["table"], report.joints[0].assessments[0].criteria, strict=True
    ):
        assert mine.name == theirs.name
        if theirs.margin is not None:
            assert mine.margin == pytest.approx(theirs.margin, rel=1e-9)


@pytest.mark.filterwarnings("ignore:joint_")
@pytest.mark.parametrize(
    "masses", [None, pytest.param("without_drives", marks=pytest.mark.slow), "with_drives"]
)
def test_drives_of_a_retimed_arm_are_those_that_size_judges(tmp_path, masses):
    """The masses of the drives, the bearing of the conditions, the old drive's friction."""
    ring = {"kind": "crossed roller", "max_moment": 77.0, "static_rating": 9e3}
    catalog = write_catalog(
        tmp_path / "catalog.yaml",
        bearings={"ring": {"source": "invented", "grade": "R", "ratings": ring}},
        conditions={"peak_factor": 1.5},
    )
    conditions = {"inertia_ratio": 100.0, "bearings": {"joint_1": "ring"}}
    motors = {"pinfric_motors": 1, "catalog": str(catalog), "conditions": conditions}
    motors["drives"] = dict.fromkeys(("joint_1", "joint_2"), "M + G")
    (tmp_path / "motors.yaml").write_text(yaml.safe_dump(motors))
    dry = {"static": 2.0, "kinetic": 2.0}
    friction = {"joint_1": {"coulomb": dry, "includes_drive": True}, "joint_2": {"coulomb": dry}}
    upper, lower = (lump(1.0, [0.25, 0, 0]) for _ in range(2))
    joints = [
        ("joint_1", pin.JointModelRY(), upper),
        ("joint_2", pin.JointModelRY(), lower, [0.5, 0, 0]),
    ]
    scene = pf.Scene(model=chain(*joints), masses=masses, friction=friction)
    path = Path.from_waypoints([[0.0, 0.0], [0.6, -0.4], [0.0, 0.0]])
    found = retime(scene, path, tmp_path / "motors.yaml")
    report = pf.size(scene, found.trajectory, catalog, conditions=conditions, on_miss="ignore")
    for joint in report.joints:
        assert joint.installed, joint.no_fit
        theirs = {c.name: c for c in joint.installed.criteria}
        mine = {c.name: c for c in found.criteria[joint.name]}
        assert mine.keys() == theirs.keys()
        for name, criterion in theirs.items():
            if criterion.margin is None:
                assert mine[name].margin is None
            else:
                assert mine[name].margin == pytest.approx(criterion.margin, rel=1e-9), name
    assert {c.name: c for c in found.criteria["joint_1"]}[
        "bearing tilting moment"
    ].available == 77.0
    held = found.problem.scene.masses_hold
    assert held == (True, True)
    again = retime(found.problem.scene, path, tmp_path / "motors.yaml")
    assert again.duration == found.duration  # no mass is added twice
    motors["conditions"] = {"bearings": {"joint_3": "ring"}}
    (tmp_path / "motors.yaml").write_text(yaml.safe_dump(motors))
    with pytest.raises(CatalogError, match=r"bearings: there is no drive 'joint_3'"):
        read_limits(scene, tmp_path / "motors.yaml")


def test_the_momentary_peak_of_a_gear_is_no_limit_of_a_cycle(tmp_path):
    gear = {"repeated_peak_torque": None}
    _, limits, _ = table_drive(tmp_path, gear)
    assert limits.least("effort") == GEAR["average_torque"]
    gear |= {"average_torque": None, "rated_torque": None}
    scene, _, candidate = table_drive(tmp_path, gear)
    path = Path.from_waypoints([[0.0], [2.0]])
    with pytest.raises(pf.RetimeError, match=r"M \+ G cannot be checked: .* gear repeated peak"):
        retime(scene, path, {"table": candidate})


@pytest.mark.filterwarnings("ignore:.*this motion, repeated, does not pass `size`")
def test_motors_file_in_the_guide_fits_the_panda(tmp_path):
    page = (File(__file__).parents[2] / "notebooks/guide/retime.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```yaml\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (tmp_path / "motors.yaml").write_text(example)
    scene = pf.load_scene("panda_pick_and_place")
    found = pf.retime(scene, "panda_pick_and_place.csv", tmp_path / "motors.yaml", points=100)
    assert found.excess < 1e-3
    assert found.duration < found.before
