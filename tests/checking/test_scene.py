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
