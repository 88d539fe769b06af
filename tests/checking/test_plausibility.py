"""`pinfric check`: wrong units are found and named, good robots cause no finding."""

import re
import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import yaml
from builders import lump, row
from check_cases import GEAR, GOOD_SCENE, SCENE, TIP, J, arm, errors
from cli_cases import told
from robot_cases import urdf
from tables import table

import pinfric as pf
from pinfric.checking import link_extent
from pinfric.checking.findings import Severity, remarks
from pinfric.errors import PinfricError, PinfricWarning, RobotError
from pinfric.model.robot import example_robot_data, read_robot

#: Robots of which nothing is wrong but notes; arms, legs and a lift.
GOOD = (
    "ur_description/urdf/ur10_robot.urdf",
    "xarm_description/urdf/xarm7.urdf",
    "z1_description/urdf/z1.urdf",
    "panda_description/urdf/panda.urdf",
)


INERTIA = {key: 1 for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
_INERTIA = [("link/inertial/inertia", key) for key in INERTIA]


LENGTHS = (("joint/origin", "xyz"), ("link/inertial/origin", "xyz"), ("link/*/origin", "xyz"))


def scaled(urdf, folder, changes, factor):
    """A copy of a URDF with attributes multiplied: `changes` are (path, attribute)."""
    tree = ElementTree.parse(urdf)
    done = set()
    for path, attribute in changes:
        for element in tree.getroot().findall(path):
            text = element.get(attribute)
            if text and (element, attribute) not in done:
                done.add((element, attribute))
                values = [factor * float(word) for word in text.split()]
                element.set(attribute, " ".join(f"{value:.12g}" for value in values))
    assert done
    file = folder / "robot.urdf"
    tree.write(file)
    return file


def robots():
    return [next(example_robot_data().rglob(name.rpartition("/")[2])) for name in GOOD]


def quick_errors(urdf):
    """Errors of what every command asks."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)
        robot = read_robot(Path(urdf), {})
        found = pf.Scene(robot.model, robot=robot).quick_findings
    return [finding for finding in found if finding.severity == Severity.ERROR]


@pytest.mark.parametrize("urdf", robots(), ids=lambda p: p.stem)
def test_good_robots_have_no_errors_and_few_warnings(urdf, monkeypatch):
    report = pf.check(urdf)
    assert not errors(report)
    monkeypatch.setattr(link_extent, "_mesh", None)  # no command reads a mesh to know it
    assert not quick_errors(urdf)
    assert report.count(Severity.WARNING) <= 3
    report.check()


@pytest.mark.parametrize("urdf", robots(), ids=lambda p: p.stem)
@pytest.mark.parametrize(
    ("changes", "factor", "kind", "unit"),
    [
        (LENGTHS, 1e3, "lengths", "mm"),
        ([("link/inertial/mass", "value")], 1e3, "masses", "g"),
        ([("link/inertial/mass", "value"), *_INERTIA], 1e-3, "masses", "t"),
        (_INERTIA, 1e6, "large inertia", "kg mm^2"),
        (_INERTIA, 1e9, "large inertia", "g mm^2"),
        ([("link/inertial/origin", "xyz")], 1e3, "centre of mass", "mm"),
        (
            [
                ("joint[@type='revolute']/limit", "lower"),
                ("joint[@type='revolute']/limit", "upper"),
            ],
            180 / np.pi,
            "range",
            "degrees",
        ),
        ([("joint/origin", "rpy")], 180 / np.pi, "rpy", "degrees"),
    ],
    ids=[
        "lengths mm",
        "masses g",
        "masses t",
        "kg mm2",
        "g mm2",
        "com mm",
        "limits deg",
        "rpy deg",
    ],
)
def test_wrong_units_are_errors_that_name_the_unit(urdf, changes, factor, kind, unit, tmp_path):
    if kind == "rpy" and urdf.stem == "z1":
        pytest.skip("turns no frame")
    report = pf.check(scaled(urdf, tmp_path, changes, factor))
    found = [f for f in errors(report) if f.kind == kind]
    assert found
    assert {f.kind for f in errors(report)} == {kind}  # no storm of others
    places = [(f.kind, f.place, f.if_unit) for f in errors(report)]
    assert sorted((f.kind, f.place, f.if_unit) for f in quick_errors(report.files[0])) == sorted(
        places
    )
    share = [f"in {unit}:" in f.if_unit for f in found]
    assert np.mean(share) > 0.8
    with pytest.raises(PinfricError, match=r"robot\.urdf: "):
        report.check()


def test_meshes_in_millimetres_are_named_with_their_scale(tmp_path):
    tree = ElementTree.parse(robots()[0])
    for mesh in tree.getroot().iter("mesh"):
        mesh.set("scale", "1000 1000 1000")
    tree.write(tmp_path / "robot.urdf")
    report = pf.check(tmp_path / "robot.urdf")
    found = [f for f in report.findings if f.kind == "shape"]
    assert len(found) >= 6
    assert all("in mm (scale 0.001)" in f.if_unit for f in found)
    assert {f.kind for f in report.findings if f.severity > Severity.NOTE} == {"shape"}


def test_plain_arm_has_one_note_of_what_never_moves(tmp_path):
    report = pf.check(arm(tmp_path))
    (note,) = report.findings
    assert (note.severity, note.kind) == (Severity.NOTE, "fixed mass")
    assert "7 kg never move (link base)" in note.text
    assert report.figures["moving_mass"] == 2.5
    assert report.figures["reach"] == pytest.approx(0.4)
    report.check(strict=True)


FINDINGS = r"""
name: ''                            NOTE     robot        has no name
axis: ''                            WARNING  joint swing  no <axis>: read as 1 0 0
{low: 0, high: 0}                   WARNING  joint swing  limits 0 to 0
{low: -180, high: 180}              ERROR    joint swing  limits -180 to 180 rad.*in degrees: -3\.14 to 3\.14 rad
tip: ''                             WARNING  joint turn   moves no mass
dynamics: <dynamics friction="50"/>  WARNING  joint swing  friction 50 N m: its effort limit is 40 N m
dynamics: <dynamics damping="0.7"/>  NOTE    robot        swing \(.*damping 0\.7\)
gear: {joint: swing, ratio: 120}    NOTE     robot        gives swing 120
gear: {joint: elbow, ratio: 120}    WARNING  joint elbow  no such
gear: {joint: swing, ratio: 0}      WARNING  joint swing  connects no
"""  # noqa: E501


@pytest.mark.parametrize(
    ("changes", "severity", "place", "says"), table(FINDINGS, yaml.safe_load, str, str, str)
)
def test_single_findings(tmp_path, changes, severity, place, says):
    if gear := changes.pop("gear", None):
        changes["more"] = GEAR.format(**gear)
    report = pf.check(arm(tmp_path, **changes))
    found = [f for f in report.findings if f.severity.name == severity and f.place == place]
    assert any(re.search(says, f.text) for f in found), report.findings


def test_unreadable_and_missing_meshes_are_notes(tmp_path):
    (tmp_path / "torn.stl").write_bytes(b"\x00" * 90)
    meshes = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        for name in ("torn.stl", "gone.stl")
    )
    report = pf.check(arm(tmp_path, tip=TIP + meshes))
    by_kind = {f.kind: f for f in report.findings}
    assert by_kind["unreadable mesh"].place == "mesh torn.stl"
    assert "gone.stl" in by_kind["missing mesh"].text
    assert not report.count(Severity.WARNING)


def test_what_loading_questions_is_asked_once(tmp_path):
    arm(tmp_path)
    file = tmp_path / "scene.yaml"
    rubbing = "{bearing: {kind: pin, radius: 0.02}, mu: {static: 2.5, kinetic: 0.1}}"
    file.write_text(SCENE.format(**(GOOD_SCENE | {"friction": rubbing, "actuators": "null"})))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        places = [f.place for f in pf.check(file).findings]
    assert sum("mu.static" in place for place in places) == 1


def test_a_robot_that_cannot_move_is_still_judged(tmp_path):
    file = tmp_path / "table.urdf"
    file.write_text(
        f'<robot name="t"><link name="top"><inertial><mass value="4"/>{J}</inertial></link></robot>'
    )
    report = pf.check(file)
    assert [f.kind for f in errors(report)] == ["does not load"]
    assert "no joint of this robot can move" in report.findings[0].text
    with pytest.raises(RobotError):
        pf.check(tmp_path / "none.urdf")


def test_new_writes_the_urdfs_ratios_and_dynamics_and_lists_doubts_once(tmp_path, capsys):
    more = GEAR.format(joint="swing", ratio=120)
    urdf = arm(
        tmp_path,
        more=more,
        dynamics='<dynamics friction="0.3" damping="0.7"/>',
        tip=TIP.format(J=J.replace('izz="0.0008"', 'izz="0.9"')),
    )
    said = told(capsys, "new", urdf, "--out", tmp_path / "out")
    assert said.err == ""
    assert said.out.count("triangle") == 1
    text = (tmp_path / "out/arm.yaml").read_text()
    assert "{joint: swing, transmission: {ratio: 120}}  # the URDF" in text
    assert re.search(r"viscous: \S+  # guess: .*; <dynamics>: 0.7$", text, re.MULTILINE)
    assert "<dynamics>: 0.3" in text
    assert "2.5 kg that move" in text  # the base's 7 kg do not
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)
        scene = pf.load_scene(tmp_path / "out/arm.yaml")
    assert scene.drives[0].transmission.ratio == 120
    assert scene.drives[1].transmission is None


def test_a_robot_has_one_reach(tmp_path):
    """A pedestal of 900 m in mm is no reach: the tip is 400 m from the first joint that moves."""
    file = arm(tmp_path)
    text = file.read_text().replace("0 0 0.4", "0 0 400")
    file.write_text(
        text.replace(
            '<joint name="swing" type="revolute">',
            '<joint name="swing" type="revolute"><origin xyz="0 0 900"/>',
        )
    )
    report = pf.check(file)
    (found,) = errors(report)
    assert report.figures["reach"] == 400.0
    assert "its joints reach 400 m" in found.text
    assert quick_errors(file) == [found]


def test_a_mass_that_is_doubted_can_be_confirmed_and_bare_links_may_be_light(tmp_path):
    """Three rods of 0.5 m: 1.8 kg/m^3 of the reach cubed, or 600."""
    light, heavy = (
        pf.Scene(row(["a", "b", "c"], lump(mass, [0.25, 0, 0]), 0.5)) for mass in (0.6, 200.0)
    )

    def masses(scene):
        return [(f.severity.name, f.refuses) for f in scene.findings if "masses" in f.kind]

    assert masses(light) == [("WARNING", True)]
    assert "bare links are said by `robot.masses: without_drives`" in light.findings[0].text
    assert masses(light.with_(masses="without_drives")) == [("WARNING", False)]
    assert masses(heavy) == [("WARNING", False)]
    confirmed = heavy.with_(masses_confirmed=True)
    assert masses(confirmed) == [("NOTE", False)]
    assert "confirmed by `robot.masses_confirmed`" in confirmed.findings[0].text
    assert remarks(confirmed.findings) == [f"robot: {confirmed.findings[0].text}"]
    impossible = pf.Scene(row(["a", "b", "c"], lump(2e3, [0.25, 0, 0]), 0.5))
    assert masses(impossible) == [("ERROR", True)]
    assert masses(impossible.with_(masses_confirmed=True)) == [("NOTE", False)]


def test_a_turntable_turns_inertia_and_its_limit_is_no_placeholder(tmp_path):
    """120 kg that carry no weight, of any radius."""
    file = urdf(
        tmp_path,
        f'<link name="table"><inertial><mass value="120"/>{J}</inertial></link>',
        '<joint name="turn" type="revolute"><parent link="base"/><child link="table"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="400" velocity="3"/></joint>',
    )
    assert [finding.kind for finding in pf.check(file).findings] == []


def test_limits_that_are_infinite_are_no_finding(tmp_path):
    """Revolute and sliding; Pinocchio alone refuses the file."""
    file = arm(tmp_path, low="-inf", high="inf")
    file.write_text(file.read_text().replace('type="revolute"', 'type="prismatic"', 1))
    assert [f for f in pf.check(file).findings if "range" in f.kind] == []
