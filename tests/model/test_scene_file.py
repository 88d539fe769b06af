"""Scene files: found by name, and refused if they do not fit their robot."""

import warnings

import pytest
from robot_cases import joint, link, scene, urdf
from tables import table

import pinfric as pf
from pinfric.errors import PinfricWarning, RobotError, SceneError
from pinfric.model.scene_file import bundled_folder, measured_scenes

MISFITS = r"""
friction: {swnig: {viscous: 1}}  no joint 'swnig'
friction: {swing: {bearing: {kind: guide, length: 0.1}, mu: MU}}  not fit a turning joint; take pin
friction: {swing: {bearing: {kind: ball, radius: 0.1}, mu: MU}}  take pin or linear or gear
actuators: [{joint: swing}, {joint: swing}]  listed twice
actuators: [{joint: wing}]  'swing'
actuators: [{cylinder: {name: boom}}]  `actuators\[0\].cylinder.a`
actuators: [{force: {name: push}}]  `actuators\[0\].force.link`
masses: with_drive  `robot\.masses`: should be 'with_drives' or 'wi
payloads: {box: {link: amr, mass: 1, com: [0, 0, 0]}}  payloads\.box\.link.*'arm'
payloads: {box: {link: arm, mass: 1, com: [0, 0, 0], inertia: [1, 0, 0, 1, 0, 3]}}  triangle
loops: [{name: rocker}]  `loops\[0\].kind` is missing; .*, universal; `loops\[0\].a`
"""


@pytest.mark.parametrize(("text", "says"), table(MISFITS))
def test_a_scene_that_does_not_fit_its_robot_is_refused(tmp_path, text, says):
    urdf(tmp_path, link("arm"), joint())
    own = text.startswith(("masses", "payloads"))  # keys of the robot
    text = text.replace("MU", "{static: 0, kinetic: 0}")
    content = f"robot: {{urdf: robot.urdf{', ' * own}{text * own}}}\n{text * (not own)}"
    with pytest.raises(SceneError, match=says):
        pf.load_scene(scene(tmp_path, content))


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


def test_a_scene_says_whose_masses_the_links_have():
    """Of all drives, by drive, or not at all; of UR's URDF, whose 32.7 kg are a whole UR10."""
    arm = pf.load_scene("ur10_machine_tending")
    assert arm.masses_hold == (True,) * 6
    assert pf.load_scene("scara").masses_hold == (False,) * 3
    by_drive = arm.with_(masses={"elbow_joint": "without_drives", "others": "with_drives"})
    assert by_drive.masses_hold == (True, True, False, True, True, True)
    only = arm.with_(masses={"elbow_joint": "without_drives"})
    assert only.masses_hold == (None, None, False, None, None, None)
    assert arm.with_(masses=None).masses_hold == (None,) * 6
    for wrong, says in (
        ({"elbow": "with_drives"}, "masses: there is no drive 'elbow'; did you mean 'elbow_joint'"),
        ("with", "masses: should be with_drives or without_drives, found 'with'"),
        ({"others": None}, "found None"),
    ):
        with pytest.raises(SceneError, match=says):
            arm.with_(masses=wrong)


def test_bundled_scenes_say_whose_masses_they_have():
    files = [f for f in bundled_folder().glob("*.yaml") if "." not in f.stem]
    assert len(files) >= 20
    for file in files:
        assert None not in pf.load_scene(file).masses_hold, file


def test_a_task_with_a_robots_friction_is_not_listed_as_another_robot():
    scenes = measured_scenes()
    task = pf.load_scene("ur10_machine_tending").measured
    assert scenes["ur10"] == task  # so that its faster cycle is warned of
    assert "ur10_machine_tending" not in scenes
