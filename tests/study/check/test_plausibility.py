"""`pinfric check`: wrong units of good robots are found and named, good robots stay quiet."""

from __future__ import annotations

import re
import warnings
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import trimesh
from envelopes import result_of, validated

import pinfric as pf
from pinfric import cli
from pinfric.errors import PinfricError, PinfricWarning, RobotError
from pinfric.model.robot import example_robot_data
from pinfric.show.replay.meshes import read_mesh
from pinfric.study.check.findings import Severity
from pinfric.study.check.link_extent import Extent
from pinfric.study.check.robot import RobotFacts

#: Robots of which nothing is wrong but notes; arms, legs and a lift.
GOOD = (
    "ur_description/urdf/ur10_robot.urdf",
    "xarm_description/urdf/xarm7.urdf",
    "z1_description/urdf/z1.urdf",
    "panda_description/urdf/panda.urdf",
)
INERTIA = {key: 1 for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
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


def errors(report):
    return [f for f in report.findings if f.severity == Severity.ERROR]


@pytest.mark.parametrize("urdf", robots(), ids=lambda p: p.stem)
def test_good_robots_have_no_errors_and_few_warnings(urdf):
    report = pf.check(urdf)
    assert not errors(report)
    assert report.count(Severity.WARNING) <= 3
    report.check()


@pytest.mark.parametrize("urdf", robots(), ids=lambda p: p.stem)
@pytest.mark.parametrize(
    ("changes", "factor", "kind", "unit"),
    [
        (LENGTHS, 1e3, "lengths", "mm"),
        ([("link/inertial/mass", "value")], 1e3, "masses", "g"),
        ([("link/inertial/inertia", key) for key in INERTIA], 1e6, "large inertia", "kg mm^2"),
        ([("link/inertial/inertia", key) for key in INERTIA], 1e9, "large inertia", "g mm^2"),
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
    ids=["lengths mm", "masses g", "kg mm2", "g mm2", "com mm", "limits deg", "rpy deg"],
)
def test_wrong_units_are_errors_that_name_the_unit(urdf, changes, factor, kind, unit, tmp_path):
    if kind == "rpy" and urdf.stem == "z1":
        pytest.skip("turns no frame")
    report = pf.check(scaled(urdf, tmp_path, changes, factor))
    found = [f for f in errors(report) if f.kind == kind]
    assert found
    assert {f.kind for f in errors(report)} == {kind}  # no storm of others
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


ARM = """<robot{name}><link name="base"><inertial><mass value="7"/>{J}</inertial></link>
  <link name="rod"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>{J}</inertial>
    <visual><origin xyz="0 0 0.2"/><geometry><box size="0.05 0.05 0.4"/></geometry></visual></link>
  <link name="tip">{tip}</link>
  <joint name="swing" type="revolute"><parent link="base"/><child link="rod"/>{axis}
    <limit lower="{low}" upper="{high}" effort="40" velocity="3"/>{dynamics}</joint>
  <joint name="turn" type="revolute"><parent link="rod"/><child link="tip"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="4" velocity="3"/></joint>
  {more}</robot>"""
TIP = '<inertial><mass value="0.5"/>{J}</inertial>'
J = '<inertia ixx="0.02" iyy="0.02" izz="0.0008" ixy="0" ixz="0" iyz="0"/>'
PLAIN = {
    "name": ' name="arm"',
    "tip": TIP,
    "axis": '<axis xyz="0 1 0"/>',
    "low": -2,
    "high": 2,
    "dynamics": "",
    "more": "",
}
GEAR = """<transmission name="t"><joint name="{joint}"/><actuator name="m">
  <mechanicalReduction>{ratio}</mechanicalReduction></actuator></transmission>"""


def arm(folder, **changes):
    text = ARM.format(J="{J}", **(PLAIN | changes)).replace("{J}", J)
    (folder / "arm.urdf").write_text(text)
    return folder / "arm.urdf"


def test_plain_arm_has_one_note_of_what_never_moves(tmp_path):
    report = pf.check(arm(tmp_path))
    (note,) = report.findings
    assert (note.severity, note.kind) == (Severity.NOTE, "fixed mass")
    assert "7 kg never move (link base)" in note.text
    assert report.figures["moving_mass"] == 2.5
    assert report.figures["reach"] == pytest.approx(0.4)
    report.check(strict=True)


@pytest.mark.parametrize(
    ("changes", "severity", "place", "says"),
    [
        ({"name": ""}, "NOTE", "robot", "has no name"),
        ({"axis": ""}, "WARNING", "joint swing", "no <axis>: read as 1 0 0"),
        ({"low": 0, "high": 0}, "WARNING", "joint swing", "limits 0 to 0"),
        (
            {"low": -180, "high": 180},
            "ERROR",
            "joint swing",
            r"limits -180 to 180 rad.*in degrees: -3\.14 to 3\.14 rad",
        ),
        ({"tip": ""}, "WARNING", "joint turn", "moves no mass"),
        (
            {"dynamics": '<dynamics friction="50"/>'},
            "WARNING",
            "joint swing",
            r"friction 50 N m: its effort limit is 40 N m",
        ),
        ({"dynamics": '<dynamics damping="0.7"/>'}, "NOTE", "robot", r"swing \(.*damping 0\.7\)"),
        ({"more": GEAR.format(joint="swing", ratio=120)}, "NOTE", "robot", "gives swing 120"),
        ({"more": GEAR.format(joint="elbow", ratio=120)}, "WARNING", "joint elbow", "no such"),
        ({"more": GEAR.format(joint="swing", ratio=0)}, "WARNING", "joint swing", "connects no"),
    ],
)
def test_single_findings(tmp_path, changes, severity, place, says):
    report = pf.check(arm(tmp_path, **changes))
    found = [f for f in report.findings if f.severity.name == severity and f.place == place]
    assert any(re.search(says, f.text) for f in found), report.findings


@pytest.mark.parametrize(
    ("shape", "severity"), [("0.05 0.05 0.4", "WARNING"), ("1e-3 " * 3, "NOTE")]
)
def test_a_link_with_shapes_should_have_a_mass(tmp_path, shape, severity):
    """Without one it is a frame between two joints; its weight would be missing silently."""
    file = arm(tmp_path)
    rod = f'<inertial><origin xyz="0 0 0.2"/><mass value="2"/>{J}</inertial>'
    text = file.read_text()
    assert rod in text
    file.write_text(text.replace(rod, "").replace("0.05 0.05 0.4", shape))
    (found,) = (f for f in pf.check(file).findings if f.kind == "massless link")
    assert (found.severity.name, found.place) == (severity, "link rod")


def test_centre_of_mass_against_the_link_itself(tmp_path):
    """The rod is 0.05 x 0.05 x 0.4 about (0, 0, 0.2): 0.3 m beside it is 0.275 m outside."""
    file = arm(tmp_path)
    file.write_text(
        file.read_text().replace('<origin xyz="0 0 0.2"/><mass', '<origin xyz="0.3 0 0.2"/><mass')
    )
    (found,) = (f for f in pf.check(file).findings if f.kind == "centre of mass")
    assert "0.275 m outside" in found.text
    assert found.if_unit == ""


def test_a_last_link_without_shapes_may_be_longer_than_the_rest(tmp_path):
    """Of one rod on a short stand the URDF tells no length: 0.1 m says nothing of 0.25 m."""
    file = tmp_path / "rod.urdf"
    for stand in (0.0, 0.1):
        file.write_text(f"""<robot name="r"><link name="base"/>
          <link name="rod"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>{J}</inertial></link>
          <joint name="j" type="continuous"><parent link="base"/><child link="rod"/>
          <origin xyz="0 0 {stand}"/><axis xyz="0 1 0"/></joint></robot>""")
        assert not pf.check(file).count(Severity.WARNING)
    file.write_text(file.read_text().replace("0.25 0 0", "250 0 0"))
    (found,) = errors(pf.check(file))
    assert found.if_unit == "if it is in mm: 0.25 m"


def test_boxes_know_distances():
    box = Extent(np.array([0.0, 0.0, 0.0]), np.array([1.0, 2.0, 2.0]))
    assert box.diagonal == 3.0
    assert box.distance(np.array([0.5, 1.0, 1.0])) == 0.0
    assert box.distance(np.array([4.0, 6.0, 1.0])) == 5.0
    assert box.farthest(np.array([0.0, 0.0, 0.0])) == 3.0


def test_shapes_are_measured_where_they_stand(tmp_path):
    """A cylinder along z, turned by 90 degrees about x and moved, lies along y."""
    shape = """<visual><origin xyz="1 0 0" rpy="1.5707963267948966 0 0"/><geometry>
      <cylinder radius="0.1" length="2"/></geometry></visual>"""

    file = arm(tmp_path, tip=TIP + shape)
    extent = RobotFacts.of(file).extents["tip"]
    np.testing.assert_allclose(extent.low, [0.9, -1.0, -0.1], atol=1e-12)
    np.testing.assert_allclose(extent.high, [1.1, 1.0, 0.1], atol=1e-12)


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


SCENE = """pinfric: 1
robot: {{urdf: arm.urdf, payloads: {{box: {payload}}}, locked: {locked}}}
friction: {{swing: {friction}}}
actuators: {actuators}
simulation: {{t_end: 1.0, start: {{q: {{swing: {start}}}}}}}
"""
GOOD_SCENE = {
    "payload": "{link: rod, mass: 1.0, com: [0, 0, 0.4]}",
    "locked": "{}",
    "friction": "{bearing: {kind: pin, radius: 0.02}, mu: {static: 0.2, kinetic: 0.1}}",
    "actuators": "[{joint: swing, transmission: {ratio: 120}}, {joint: turn}]",
    "start": 0.5,
}


@pytest.mark.parametrize(
    ("changes", "place", "says"),
    [
        (
            {"friction": "{bearing: {kind: pin, radius: 20}, mu: {static: 0.2, kinetic: 0.1}}"},
            "friction.swing.bearing.radius",
            r"links it joins are 0\.406 m large.*mm: 0\.02 m",
        ),
        (
            {
                "friction": "{bearing: {kind: linear, radial: 0.02}, "
                "mu: {static: 0.2, kinetic: 0.1}}"
            },
            "friction.swing.mu.static",
            "rolling bearings have",
        ),
        (
            {"friction": "{coulomb: {static: 50, kinetic: 50}}"},
            "friction.swing.coulomb",
            "effort limit is 40 N m",
        ),
        ({"friction": "{viscous: 20}"}, "friction.swing.viscous", "60 N m at the joint's speed"),
        (
            {"payload": "{link: rod, mass: 1000, com: [0, 0, 0]}"},
            "robot.payloads.box.mass",
            r"2\.5 kg of the robot move.*in g: 1 kg",
        ),
        (
            {"payload": "{link: rod, mass: 1, com: [0, 0, 150]}"},
            "robot.payloads.box.com",
            r"reaches 0\.4 m.*in mm: 0\.15 m",
        ),
        (
            {"payload": "{link: rod, mass: 1, com: [0, 0, 0], inertia: [9, 0, 0, 9, 0, 9]}"},
            "robot.payloads.box.inertia",
            "radius of gyration 3 m",
        ),
        ({"start": 90}, "simulation.start.q.swing", r"outside its limits -2 to 2.*degrees: 1\.57"),
        (
            {"locked": "{turn: 45}", "actuators": "[{joint: swing}]"},
            "robot.locked.turn",
            r"outside.*degrees: 0\.785",
        ),
        (
            {"actuators": "[{joint: swing, transmission: {ratio: 100}}, {joint: turn}]"},
            "actuators[0].transmission.ratio",
            "URDF's <transmission> says 120",
        ),
        (
            {
                "actuators": "[{joint: swing, transmission: {ratio: 120, no_load_torque: 1}}, "
                "{joint: turn}]"
            },
            "actuators[0].transmission.no_load_torque",
            "120 at joint swing",
        ),
        (
            {
                "actuators": "[{joint: swing, transmission: {ratio: 120, rotor_inertia: 0.05}}, "
                "{joint: turn}]"
            },
            "actuators[0].transmission.rotor_inertia",
            r"kg cm\^2: 5e-06",
        ),
    ],
)
def test_findings_of_a_scene(tmp_path, changes, place, says):
    arm(tmp_path, more=GEAR.format(joint="swing", ratio=120))
    file = tmp_path / "scene.yaml"
    file.write_text(SCENE.format(**GOOD_SCENE))
    assert not pf.check(file).count(Severity.WARNING)
    file.write_text(SCENE.format(**(GOOD_SCENE | changes)))
    found = [f for f in pf.check(file).findings if f.severity == Severity.WARNING]
    assert place in {f.place for f in found}, found
    (matching,) = [f for f in found if f.place == place]
    assert re.search(says, matching.text), matching.text


def test_what_loading_questions_is_asked_once(tmp_path):
    arm(tmp_path)
    file = tmp_path / "scene.yaml"
    rubbing = "{bearing: {kind: pin, radius: 0.02}, mu: {static: 2.5, kinetic: 0.1}}"
    file.write_text(SCENE.format(**(GOOD_SCENE | {"friction": rubbing, "actuators": "null"})))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        texts = [f.text for f in pf.check(file).findings]
    assert sum("mu.static" in text for text in texts) == 1


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as left:
        cli.main(["check", *map(str, arguments)])
    said = capsys.readouterr()
    return left.value.code, said.out, said.err


def test_exit_codes_and_json(tmp_path, capsys):
    good = arm(tmp_path)
    assert run(capsys, good, "--strict")[0] == 0
    doubtful = arm(tmp_path, low=0, high=0)
    assert run(capsys, doubtful)[0] == 0
    code, out, err = run(capsys, doubtful, "--strict")
    assert (code, len(err.splitlines())) == (2, 1)
    assert "joint swing: limits 0 to 0" in err
    assert "1 warning" in out
    wrong = arm(tmp_path, low=-180, high=180)
    code, out, err = run(capsys, wrong, "--json")
    assert code == 2
    found = result_of(out)
    assert found["errors"] == 1
    assert found["findings"][0]["if_unit"].startswith("if they are in degrees")
    assert found["findings"][0]["severity"] == "error"


@pytest.mark.parametrize("content", ["", "<sdf/>", "<mujoco/>", "a: 1", "<robot name='r'/>"])
def test_what_is_no_robot_is_one_line(tmp_path, capsys, content):
    file = tmp_path / "robot.urdf"
    file.write_text(content)
    code, out, err = run(capsys, file)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "robot.urdf" in err


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


@pytest.mark.parametrize("command", ["inverse", "size", "explain", "replay", "simulate"])
def test_the_warning_of_an_implausible_body_reaches_every_commands_json(
    tmp_path, capsys, monkeypatch, command
):
    monkeypatch.chdir(tmp_path)
    arm(tmp_path, tip=TIP.format(J=J.replace('izz="0.0008"', 'izz="0.9"')))
    (tmp_path / "scene.yaml").write_text(
        "pinfric: 1\nrobot: {urdf: arm.urdf}\nfriction: {swing: {viscous: 0.1}}\n"
        "simulation: {t_end: 0.01}\n"
    )
    rows = "".join(f"{0.1 * i:.1f},{0.01 * i},0\n" for i in range(12))
    (tmp_path / "motion.csv").write_text("t,swing,turn\n" + rows)
    motion = [] if command == "simulate" else ["motion.csv"]
    with pytest.raises(SystemExit) as left:
        cli.main([command, "scene.yaml", *motion, "--json"])
    said = capsys.readouterr()
    assert left.value.code == 0
    assert sum("'tip'" in line for line in said.err.splitlines()) == 1
    assert any("'tip'" in text for text in validated(said.out)["warnings"])


def test_new_writes_the_urdfs_ratios_and_dynamics_and_lists_doubts_once(tmp_path, capsys):
    more = GEAR.format(joint="swing", ratio=120)
    urdf = arm(
        tmp_path,
        more=more,
        dynamics='<dynamics friction="0.3" damping="0.7"/>',
        tip=TIP.format(J=J.replace('izz="0.0008"', 'izz="0.9"')),
    )
    with pytest.raises(SystemExit) as left:
        cli.main(["new", str(urdf), "--out", str(tmp_path / "out")])
    said = capsys.readouterr()
    assert left.value.code == 0
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


def test_collada_meshes_are_in_the_unit_that_they_name(tmp_path):
    """As RViz and Gazebo read them: a box of 40 mm is 0.04 m."""
    box = trimesh.creation.box(extents=(40.0, 20.0, 10.0))
    text = trimesh.exchange.dae.export_collada(box).decode()
    unit = '<unit name="millimeter" meter="0.001"/>'
    text = text.replace("</created>", f"</created>\n{unit}", 1)
    assert unit in text
    (tmp_path / "box.dae").write_text(text)
    mesh = '<visual><geometry><mesh filename="box.dae"/></geometry></visual>'
    file = arm(tmp_path, tip=TIP + mesh)
    size = RobotFacts.of(file).extents["tip"].size
    np.testing.assert_allclose(size, [0.04, 0.02, 0.01], rtol=1e-6)
    np.testing.assert_allclose(np.ptp(read_mesh(tmp_path / "box.dae").vertices, axis=0), size)
