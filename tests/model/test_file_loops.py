"""Loops that a robot's file closes: each element against the same four-bar with a scene's loop."""

import numpy as np
import pytest

import pinfric as pf
from pinfric.dynamics.samples.closure import consistent_motion
from pinfric.errors import PinfricWarning, RobotError, SceneError
from pinfric.new_scene import write_new

LINK = (
    '<link name="{0}"><inertial><origin xyz="{1} 0 {2}"/><mass value="0.5"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.011" iyz="0" izz="0.006"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
    '<origin xyz="{3}"/><axis xyz="0 1 0"/>'
    '<limit lower="-2" upper="2" effort="30" velocity="3"/></joint>'
)
TREE = (
    '<link name="base"/>',
    LINK.format("crank", 0, 0.1),
    LINK.format("coupler", 0.15, 0),
    LINK.format("rocker", 0, 0.1),
    JOINT.format("j1", "base", "crank", "0 0 0"),
    JOINT.format("j2", "crank", "coupler", "0 0 0.2"),
    JOINT.format("j3", "base", "rocker", "0.3 0 0"),
)
OWN = (
    "loops: [{name: NAME, kind: KIND, axis: [0, 1, 0], a: {link: coupler, xyz: [0.3, 0, 0]}, "
    "b: {link: rocker, xyz: [0, 0, 0.2]}}]"
)
LOOP_JOINT = (
    '<loop_joint name="close" type="{0}"><link1 link="coupler" xyz="0.3 0 0" rpy="0 0 0"/>'
    '<link2 link="rocker" xyz="0 0 0.2"/>{1}</loop_joint>'
)
CONSTRAINT = (
    '<constraint name="close" type="{0}"><parent link="coupler"/><parent_origin xyz="0.3 0 0"/>'
    '<parent_axis xyz="0 1 0"/><child link="rocker"/><child_origin xyz="0 0 0.2" rpy="{1}"/>'
    '<child_axis xyz="{2}"/></constraint>'
)
BALL = (
    '<drake:ball_constraint><drake:ball_constraint_body_A name="coupler"/>'
    '<drake:ball_constraint_body_B name="rocker"/><drake:ball_constraint_p_AP value="0.3 0 0"/>'
    '<drake:ball_constraint_p_BQ value="0 0 0.2"/></drake:ball_constraint>'
)
GAZEBO = (
    '<gazebo><joint name="close" type="{0}"><pose{1}>{2}</pose><parent>coupler</parent>'
    "<child>rocker</child><axis><xyz{3}>{4}</xyz></axis></joint></gazebo>"
)
TURNED = "0.4 0 1.5707963267948966"
#: Element -> the kind of the same loop in a scene.
ELEMENTS = {
    "loop_joint": (LOOP_JOINT.format("revolute", '<axis xyz="0 1 0"/>'), "revolute"),
    "loop_joint continuous": (LOOP_JOINT.format("continuous", '<axis xyz="0 2 0"/>'), "revolute"),
    "loop_joint spherical": (LOOP_JOINT.format("spherical", ""), "spherical"),
    "constraint": (CONSTRAINT.format("revolute", "0 0 0", "0 1 0"), "revolute"),
    "constraint, other axes": (CONSTRAINT.format("revolute", TURNED, "1 0 0"), "revolute"),
    "constraint spherical": (CONSTRAINT.format("spherical", "0 0 0", "0 0 0"), "spherical"),
    "ball_constraint": (BALL, "spherical"),
    "gazebo": (GAZEBO.format("revolute", "", "0 0 0.2 0 0 0", "", "0 1 0"), "revolute"),
    "gazebo, of coupler": (
        GAZEBO.format("revolute", ' relative_to="coupler"', "0.3 0 0 0 0 0", "", "0 1 0"),
        "revolute",
    ),
    "gazebo, model's axis": (
        GAZEBO.format("revolute", "", "0 0 0.2 0.3 0 0.2", ' expressed_in="__model__"', "0 1 0"),
        "revolute",
    ),
    "gazebo ball": (GAZEBO.format("ball", "", "0 0 0.2 0 0 0", "", "0 1 0"), "spherical"),
}


def scene(folder, element, more="", robot=""):
    """A scene of the four-bar, whose file has an element in its line 5."""
    text = "<robot name='x'>\n\n\n\n" + element + "\n".join(["", *TREE, "</robot>"])
    (folder / "x.urdf").write_text(text)
    robot = f"robot: {{urdf: x.urdf{robot}}}"
    (folder / "x.yaml").write_text(f"pinfric: 1\n{robot}\nactuators: [{{joint: j1}}]\n{more}\n")
    return folder / "x.yaml"


@pytest.mark.parametrize("name", ELEMENTS)
def test_an_element_is_the_loop_that_a_scene_states(tmp_path, name):
    """Closed configurations and efforts are those of the same loop in a scene."""
    element, kind = ELEMENTS[name]
    read = pf.load_scene(scene(tmp_path, element))
    stated = pf.load_scene(scene(tmp_path, "", OWN.replace("KIND", kind).replace("NAME", "close")))
    assert [(loop.name, loop.kind) for loop in read.loops] == [
        ("loop_1" if element == BALL else "close", kind)
    ]
    rng = np.random.default_rng(3)
    guesses, rates, a = rng.uniform(-0.4, 0.4, (20, 3)), *rng.normal(size=(2, 20, 1))
    q = np.array([stated.close(x) for x in guesses])
    np.testing.assert_allclose([read.close(x) for x in guesses], q, atol=1e-9)
    motion = consistent_motion(stated, q, ["j1"], rates, a)
    efforts = [pf.inverse_dynamics(s, q, *motion).effort_frictionless for s in (stated, read)]
    np.testing.assert_allclose(*efforts, atol=1e-9)
    assert np.abs(efforts[0]).max() > 0.1


@pytest.mark.parametrize(
    ("element", "said"),
    [
        (LOOP_JOINT.format("gearbox", ""), "line 5, <loop_joint> 'close'"),
        (LOOP_JOINT.format("universal", ""), "one axis"),
        (CONSTRAINT.format("prismatic", "0 0 0", "1 0 0"), "its axes differ"),
        ("<kinematic_loop/>", "line 5, <kinematic_loop>"),
        ("<drake:linear_bushing_rpy/>", "line 5, <drake:linear_bushing_rpy> is not read"),
        (GAZEBO.format("screw", "", "0 0 0 0 0 0", "", "0 1 0"), "line 5, <joint> 'close'"),
    ],
)
def test_what_is_not_read_is_said_by_every_command(tmp_path, element, said):
    """A warning where the scene is loaded; in `check` with its line, and no drive is signed."""
    file = scene(tmp_path, element)
    with pytest.warns(PinfricWarning, match="is not read"):
        assert pf.load_scene(file).loops == ()
    for source in (file, tmp_path / "x.urdf"):
        (finding,) = (f for f in pf.check(source).findings if f.kind == "loop not read")
        assert said in finding.text
        assert "open tree" in finding.text
        assert finding.refuses


@pytest.mark.parametrize(
    ("element", "said"),
    [
        (LOOP_JOINT.format("revolute", "").replace("rocker", "rokcer"), "did you mean 'rocker'"),
        (LOOP_JOINT.format("revolute", "").replace("rocker", "coupler"), "both sides are link"),
        ('<loop_joint name="close" type="revolute"><link1 link="rocker"/></loop_joint>', "<link2>"),
        (CONSTRAINT.replace("<child link", "<kid link"), "has no <child>"),
        (LOOP_JOINT.format("spherical", "").replace("0.3 0 0", "0.3 0"), "3 finite numbers"),
        (2 * LOOP_JOINT.format("spherical", ""), "two loops have this name"),
        (GAZEBO.format("ball", "", "0 0 0", "", "0 1 0"), "6 finite numbers"),
    ],
)
def test_an_element_with_one_link_or_wrong_numbers_is_refused(tmp_path, element, said):
    """One line that names the file, the line and the element."""
    with pytest.raises(RobotError, match=said) as refused:
        pf.load_scene(scene(tmp_path, element.format("revolute", "0 0 0", "0 1 0")))
    assert "x.urdf: line 5, <" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_scene_replaces_a_loop_by_its_name_or_ignores_all(tmp_path):
    """The same place by another name would hold twice, and is refused."""
    element = ELEMENTS["loop_joint"][0]
    own = OWN.replace("KIND", "spherical")
    replaced = pf.load_scene(scene(tmp_path, element, own.replace("NAME", "close")))
    assert [(loop.name, loop.kind) for loop in replaced.loops] == [("close", "spherical")]
    with pytest.raises(SceneError, match="'pin' closes what the robot's file closes by 'close'"):
        pf.load_scene(scene(tmp_path, element, own.replace("NAME", "pin")))
    ignored = pf.load_scene(scene(tmp_path, element, robot=", urdf_loops: ignore"))
    assert ignored.loops == ()
    assert "left out by" in next(f for f in pf.check(ignored).findings if f.kind == "loops").text


def test_check_says_of_a_urdf_that_its_loops_cannot_close(tmp_path):
    far = ELEMENTS["loop_joint"][0].replace('xyz="0.3 0 0"', 'xyz="9 0 0"')
    scene(tmp_path, far)
    (finding,) = (f for f in pf.check(tmp_path / "x.urdf").findings if f.kind == "loop")
    assert "cannot close" in finding.text


def test_new_drives_what_the_loops_leave_free(tmp_path, monkeypatch):
    """The written scene and motion run: one drive, and its joint alone in the way-points."""
    monkeypatch.chdir(tmp_path)
    scene(tmp_path, ELEMENTS["loop_joint"][0])
    (tmp_path / "new").mkdir()
    write_new("x.urdf", "new")
    begun = pf.load_scene("new/x.yaml")
    assert begun.actuator_names == ("j1",)
    assert [loop.name for loop in begun.loops] == ["close"]
    assert [name for name in begun.site_names if begun.friction[name].coulomb] == ["j1"]
    motion = pf.load_trajectory("new/x.waypoints.yaml", begun)
    efforts = pf.inverse_dynamics(begun, motion).effort_upper
    assert efforts.shape == (len(motion.t), 1)
    assert np.isfinite(efforts).all()
    assert motion.q[:, 1].std() > 0.01
