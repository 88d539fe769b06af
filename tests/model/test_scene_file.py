"""Scene files: found by name, and refused where they do not fit their robot."""

from __future__ import annotations

import warnings

import pytest
from robot_cases import joint, link, scene, urdf

import pinfric as pf
from pinfric.errors import PinfricWarning, RobotError, SceneError


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        ("friction: {swnig: {viscous: 1}}", SceneError, "no joint 'swnig'"),
        (
            "friction: {swing: {bearing: {kind: guide, length: 0.1}, mu: {static: 0, kinetic: 0}}}",
            SceneError,
            "a guide does not fit a turning joint; take pin",
        ),
        (
            "friction: {swing: {bearing: {kind: ball, radius: 0.1}, mu: {static: 0, kinetic: 0}}}",
            SceneError,
            "take pin or linear .a ball fits a spherical loop",
        ),
        ("actuators: [{joint: swing}, {joint: swing}]", SceneError, "listed twice"),
        ("actuators: [{joint: wing}]", SceneError, "'swing'"),
        ("actuators: [{cylinder: {name: boom}}]", SceneError, r"`actuators\[0\].cylinder.a`"),
        ("actuators: [{force: {name: push}}]", SceneError, r"`actuators\[0\].force.link`"),
        ("loops: [{name: rocker}]", SceneError, r"`loops\[0\].kind` is missing"),
    ],
)
def test_a_scene_that_does_not_fit_its_robot_is_refused(tmp_path, text, error, says):
    urdf(tmp_path, link("arm"), joint())
    with pytest.raises(error, match=says):
        pf.load_scene(scene(tmp_path, "robot: {urdf: robot.urdf}\n" + text))


def test_bundled_scenes_are_found_by_name_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert pf.load_scene("three_link").model.nv == 3
    assert pf.load_scene("robots/three_link.yaml").model.nv == 3
    with pytest.raises(SceneError, match=r"'three_link\.yaml'"):
        pf.load_scene("three_lnk")
    for elsewhere in ("mine/three_link.yaml", tmp_path / "three_link.yaml"):
        with pytest.raises(SceneError, match="there is no file"):
            pf.load_scene(elsewhere)
    with pytest.raises(RobotError, match="example-robot-data has no"):
        pf.load_scene(scene(tmp_path, "robot: {urdf: 'example-robot-data:ur5.urdf'}"))


def test_reductions_of_the_urdf_are_mentioned_until_actuators_name_them(tmp_path):
    gear = """<transmission name="t"><type>SimpleTransmission</type><joint name="swing"/>
      <actuator name="m"><mechanicalReduction>100</mechanicalReduction></actuator></transmission>"""
    urdf(tmp_path, link("arm"), joint(), gear)
    with pytest.warns(PinfricWarning, match=r"reductions \(swing 100\)"):
        found = pf.load_scene(scene(tmp_path, "robot: {urdf: robot.urdf}"))
    assert found.robot.reductions == {"swing": 100.0}
    named = "robot: {urdf: robot.urdf}\nactuators: [{joint: swing, transmission: {ratio: 100}}]"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pf.load_scene(scene(tmp_path, named))
