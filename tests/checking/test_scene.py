import re
from pathlib import Path

import pinocchio as pin
import pytest
import yaml
from check_cases import GEAR, GOOD_SCENE, SCENE, arm
from cli_cases import told
from tables import table

import pinfric as pf
from pinfric.checking.findings import Severity
from pinfric.new_scene import Begun, new_scene

FINDINGS = r"""
friction  {bearing: {kind: pin, radius: 12}, mu: MU}        friction.swing.bearing.radius  links it joins are 0\.406 m large.*mm: 0\.012 m
friction  {bearing: {kind: linear, radial: 0.02}, mu: MU}   friction.swing.mu.static  rolling bearings have
friction  {coulomb: {static: 50, kinetic: 50}}              friction.swing.coulomb    effort limit is 40 N m
friction  {viscous: 20}                                     friction.swing.viscous    60 N m at the joint's speed
payload   {link: rod, mass: 1000, com: [0, 0, 0]}           robot.payloads.box.mass   2\.5 kg of the robot move.*in g: 1 kg
payload   {link: rod, mass: 1, com: [0, 0, 150]}            robot.payloads.box.com    is 0\.4 m long.*in mm: 0\.15 m
payload   {link: rod, mass: 1, com: [0, 0, 0], inertia: [9, 0, 0, 9, 0, 9]}  robot.payloads.box.inertia  radius of gyration 3 m
start     90                                                simulation.start.q.swing  outside its limits -2 to 2.*degrees: 1\.57
locked    {turn: 45}                                        robot.locked.turn         outside.*degrees: 0\.785
gear      {ratio: 100}                                      actuators[0].transmission.ratio           URDF's <transmission> says 120
gear      {ratio: 120, no_load_torque: 1}                   actuators[0].transmission.no_load_torque  120 at joint swing
gear      {ratio: 120, rotor_inertia: 0.05}                 actuators[0].transmission.rotor_inertia   kg cm\^2: 5e-06
"""  # noqa: E501


@pytest.mark.parametrize(("key", "value", "place", "says"), table(FINDINGS))
def test_findings_of_a_scene(tmp_path, key, value, place, says):
    changes = {key: value.replace("MU", "{static: 0.2, kinetic: 0.1}")}
    if key == "gear":
        changes["actuators"] = f"[{{joint: swing, transmission: {value}}}, {{joint: turn}}]"
    if key == "locked":
        changes["actuators"] = "[{joint: swing}]"
    arm(tmp_path, more=GEAR.format(joint="swing", ratio=120))
    file = tmp_path / "scene.yaml"
    file.write_text(SCENE.format(**GOOD_SCENE))
    assert not pf.check(file).count(Severity.WARNING)
    file.write_text(SCENE.format(**(GOOD_SCENE | changes)))
    found = [f for f in pf.check(file).findings if f.severity == Severity.WARNING]
    assert place in {f.place for f in found}, found
    (matching,) = [f for f in found if f.place == place]
    assert re.search(says, matching.text), matching.text


CASES = """
{link: rod, mass: 1, com: [0, 0, 0.4]}   {}         ''
{link: rod, mass: 1500, com: [0, 0, 0]}  {}         'robot.payloads.box.mass: 1500 kg'
{link: rod, mass: 1, com: [0, 0, 50]}    {}         'robot.payloads.box.com: 50 m'
{link: base, mass: 1, com: [0, 0, 0]}    {}         'robot.payloads.box.link: base: this link'
{link: rod, mass: 1, com: [0, 0, 0]}     {tip: ''}  'joint turn: moves no mass'
"""


@pytest.mark.parametrize(
    ("payload", "robot", "warning"),
    table(CASES, str, yaml.safe_load, yaml.safe_load),
)
def test_inverse_says_what_makes_efforts_wrong_by_a_multiple(
    tmp_path, monkeypatch, capsys, payload, robot, warning
):
    monkeypatch.chdir(tmp_path)
    arm(tmp_path, more=GEAR.format(joint="swing", ratio=120), **robot)
    Path("scene.yaml").write_text(SCENE.format(**(GOOD_SCENE | {"payload": payload})))
    Path("way.csv").write_text("t,swing,turn\n" + "".join(f"{0.1 * i},0,0\n" for i in range(9)))
    said = told(capsys, "inverse", "scene.yaml", "way.csv").err
    assert said.count("warning") == bool(warning), said
    assert warning in said


def test_one_link_a_thousand_times_too_heavy_is_asked_about():
    """`inverse` and `size` ask, too; of bundled robots nothing is asked."""
    model = pf.load_scene("three_link").model.copy()
    assert not [x for x in pf.Scene(model).quick_findings if x.kind == "one heavy link"]
    body = model.inertias[2].copy()
    model.inertias[2] = pin.Inertia(1000 * body.mass, body.lever, 1000 * body.inertia)
    (found,) = [x for x in pf.Scene(model).quick_findings if x.kind == "one heavy link"]
    assert found.place == f"what joint {model.names[2]} moves"
    assert f"{1000 * body.mass:.4g} kg, all others" in found.text
    assert "if it is in g" in found.text


@pytest.mark.parametrize(("key", "static"), [("positive", 200.0), ("negative", 300.0)])
def test_dry_friction_of_one_direction_is_judged_as_that_of_both(key, static):
    """The UR5's elbow has 150 N m."""
    ways = {"positive": {"static": 2, "kinetic": 2}, "negative": {"static": 2, "kinetic": 2}}
    ways[key] = {"static": static, "kinetic": 2}
    scene = pf.load_scene("ur5_pick_and_place")
    scene = scene.with_(friction={"elbow_joint": {"coulomb": ways}})
    (finding,) = [f for f in pf.check(scene).findings if f.kind == "coulomb"]
    assert finding.place == f"friction.elbow_joint.coulomb.{key}"
    assert f"{static:g} N m" in finding.text
    assert "could not break away" in finding.text


ROD = (
    '<mujoco><worldbody><body name="crank"><joint name="j1" axis="0 1 0"/>{0}'
    '<body name="rod" pos="0 0 0.2"><joint name="{1}" type="{2}"/>{0}</body></body>'
    '<body name="rocker" pos="0.3 0 0"><joint name="j3" axis="0 1 0"/>{0}</body></worldbody>'
    '<equality><connect name="c" body1="rod" body2="rocker" anchor="0.3 0 0"/></equality></mujoco>'
)


@pytest.mark.parametrize(("joint", "loose"), [("ball", ["joint b"]), ("hinge", [])])
def test_a_rod_between_balls_that_turns_freely_is_said(tmp_path, joint, loose):
    """A rod on a hinge is held; four mechanisms of the bundled scenes have no such rod."""
    inertia = '<inertial pos="0 0 0.1" mass="0.5" diaginertia="0.02 0.03 0.025"/>'
    text = ROD.format(inertia, "b", joint).replace('type="hinge"', 'axis="0 1 0"')
    (tmp_path / "rod.xml").write_text(text)
    (tmp_path / "rod.yaml").write_text(
        "pinfric: 1\nrobot: {mjcf: rod.xml}\nactuators: [{joint: j1}]\n"
    )
    found = [f.place for f in pf.check(tmp_path / "rod.yaml").findings if f.kind == "loose link"]
    assert found == loose
    for name in ("four_bar", "delta", "excavator"):
        assert "loose link" not in [f.kind for f in pf.check(name).findings]


def test_the_owner_of_a_urdf_is_told_nothing_of_the_model_made_of_it(tmp_path, recwarn):
    """`model.damping` is a matter of who makes models in Python: `check` speaks of <dynamics>."""
    robot = tmp_path / "arm.urdf"
    text = (
        '<robot name="a"><link name="b"/><link name="l"><inertial><mass value="1"/><inertia '
        'ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j" type="revolute"><parent link="b"/><child link="l"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="1"/>'
        '<dynamics friction="1" damping="2"/></joint></robot>'
    )
    robot.write_text(text)
    report = pf.check(robot)
    new_scene(Begun.read(robot))
    assert [str(warning.message) for warning in recwarn] == []
    assert any("friction 1, damping 2" in f.text for f in report.findings)
