"""URDFs that are impossible, or that other programs accept."""

import copy

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from robot_cases import INERTIA, joint, link, urdf
from tables import table

from pinfric.errors import PinfricWarning, RobotError
from pinfric.model import robot
from pinfric.model.robot import read_robot
from pinfric.model.urdf import implausible_body
from pinfric.motions.joint_columns import stated_limit, stated_range

#: What is in the URDF of a link `arm` on a joint `swing`, what stands there instead, what is said.
IMPOSSIBLE = r"""
value="1"  value="-1"  'arm'.*mass -1 kg is negative
izz="0.1"  izz="-0.3"  the links that joint 'swing' moves have a negative kinetic energy
xyz="0 0 1"  xyz="0 0 0"  'swing' has the axis \[0.0, 0.0, 0.0\]
child link="arm"  child link="amr"  'swing' names link 'amr'.*'arm'
</robot>  AGAIN</robot>  'again'.*tree
</robot>  <link name="loose"/></robot>  one root link
xyz="0 0 1"  xyz="0 0"  'swing'.*axis xyz='0 0'.*3 finite numbers
lower="-1"  lower="3"  'swing': limits lower 3
</joint>  <dynamics friction="x"/></joint>  'swing'.*friction='x'
</robot>  RING</robot>  \['a', 'b'\] form a ring
 xyz="0 0 1"  NONE  'swing' has an <axis> without xyz
</inertial>  </inertial>{<box size="1 2"/>}  'arm': <box size='1 2'> should be 3 finite
</inertial>  </inertial><visual/>  a <visual> needs a <geometry>, of box, cylinder, sphere, mesh
</inertial>  </inertial>{<cone/>}  'arm': a <visual> needs a <geometry>
</inertial>  </inertial>{<cylinder radius="1"/>}  'arm'.*<cylinder> without length
xyz="0 0 1"  xyz="1e200 1e200 0"  'swing'.*should be at most 1e.12
xyz="0 0 1"  xyz="1e10 0 0"  'swing' has the axis
value="1"  value="1e304"  'arm': <mass value='1e304'> should be at most
<mass value="1"/>  NONE  'arm'.*without <mass
iyy="0.1"  NONE  'arm'.*without inertia iyy
</inertial>  </inertial><inertial/>  'arm' has 2 <inert
value="1"  value="nan"  'arm': <mass value='nan'>
xyz="0 0 1"  xyz="0SPACE0 1"  joint 'swing': <.* should be
"5"  "5_0"  joint 'swing': <.* should be
"5"  "nan"  effort='nan'> should be a number
revolute  fixed  no joint of this robot can move
name="swing"  NONE  joint number 1 has no name
revolute  hinge  type 'hinge'; there are: revolute
"""
WORDS = {
    "NONE": "",
    "RING": link("a") + link("b") + joint("r", "a", "b") + joint("s", "b", "a"),
    "AGAIN": joint("again"),
    "SPACE": "\N{NO-BREAK SPACE}",
    "{": "<visual><geometry>",
    "}": "</geometry></visual>",
}


@pytest.mark.parametrize(("old", "new", "says"), table(IMPOSSIBLE))
@pytest.mark.filterwarnings("ignore:.*one is negative")
def test_what_no_robot_can_be_is_refused(tmp_path, old, new, says):
    file = urdf(tmp_path, link("arm"), joint())
    for word, meaning in WORDS.items():
        new = new.replace(word, meaning)
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(RobotError, match=says) as caught:
        read_robot(file, {})
    assert "\n" not in str(caught.value)


def test_negative_limits_are_none_with_a_warning(tmp_path):
    file = urdf(tmp_path, link("arm"), joint().replace('"5"', '"-1.0"').replace('"2"', '"-1"'))
    with pytest.warns(
        PinfricWarning, match=r"are read as none: 'swing' \(effort -1.0\) and 1 more"
    ):
        model = read_robot(file, {}).model
    assert model.effortLimit[0] == model.velocityLimit[0] == 0.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("<robot", "not well-formed"),
        ("", "robot.urdf: is empty"),
        ("<sdf version='1.6'/>", "root element is <sdf>.*SDF: convert it"),
        ("<mujoco model='a'/>", "has no <worldbody>"),
        ("a: 1", "not well-formed"),
        ("<robot name='r'/>", "no <link>"),
    ],
)
def test_what_is_no_urdf_is_refused(tmp_path, text, says):
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    with pytest.raises(RobotError, match=says):
        read_robot(file, {})


def test_a_missing_mesh_is_one_warning(tmp_path):
    mesh = '<visual><geometry><mesh filename="package://no/a.stl"/></geometry></visual>'
    body = link("arm").replace("</link>", mesh + mesh.replace("a.stl", "b.stl") + "</link>")
    with pytest.warns(PinfricWarning, match=r"no mesh package://no/a\.stl and 1 more") as caught:
        robot = read_robot(urdf(tmp_path, body, joint()), {})
    assert len(caught) == 1
    assert robot.model.nv == 1


@pytest.mark.parametrize(("excess", "said"), [(-0.02, False), (5e-4, False), (0.02, True)])
def test_the_triangle_inequality_from_both_sides(excess, said):
    """A plate is at the limit, J_z = J_x + J_y; 0.0005 of it is what three digits round."""
    flat = np.diag([0.1, 0.1, 0.2 * (1 + excess)])
    assert (implausible_body(1.0, flat) is not None) == said


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (link("arm", inertia=INERTIA.replace('ixx="0.1"', 'ixx="0.3"')), "triangle inequality"),
        (link("arm", inertia=INERTIA.replace('ixx="0.1"', 'ixx="-0.3"')), "one is negative"),
        (link("arm", mass="0"), "without a mass"),
    ],
)
def test_bodies_that_other_programs_take_are_one_warning_with_all_their_names(tmp_path, body, says):
    hand = body.replace('"arm"', '"hand"')
    parts = body, joint(), hand, joint(name="wrist", parent="arm", child="hand")
    with pytest.warns(PinfricWarning, match=rf"'arm'.*{says}.*also hand; used") as caught:
        robot = read_robot(urdf(tmp_path, *parts), {})
    assert len(caught) == 1
    as_written = np.array([[0.1]]) * 2  # izz of both about the common axis, no lever
    M = pin.crba(robot.model, robot.model.createData(), np.zeros(2))
    assert_allclose(M[0, 0], as_written[0, 0], atol=1e-15)


def test_links_that_never_move_may_say_what_they_like(tmp_path):
    weird = link("foot", inertia=INERTIA.replace('ixx="0.1"', 'ixx="9"'))
    fixed = joint(name="bolt", child="foot", kind="fixed")
    robot = read_robot(urdf(tmp_path, weird, fixed, link("arm"), joint()), {})
    assert robot.model.nv == 1


def number_text(mass="2", ixx="0.1", xyz="0.1 0.2 0.3"):
    body = link("arm", mass, INERTIA.replace('ixx="0.1"', f'ixx="{ixx}"'))
    body = body.replace("<inertial>", f'<inertial><origin xyz="{xyz}"/>')
    return body.replace("\t", "&#9;").replace("\n", "&#10;").replace("\r", "&#13;")


@pytest.mark.parametrize(
    "spelling",
    ["0.2", "+0.2", ".2", "2e-1", "+2.E-01", " 0.2 ", "0.2\t", "\n0.2", "0.2\r", "000.2e0"],
)
def test_numbers_are_read_as_they_are_spelled(tmp_path, spelling):
    file = urdf(tmp_path, number_text(spelling, spelling, f"{spelling} 1\t2"), joint())
    body = read_robot(file, {}).model.inertias[1]
    assert body.mass == 0.2
    assert_allclose(body.lever, [0.2, 1.0, 2.0], rtol=1e-15)
    assert_allclose(body.inertia, np.diag([0.2, 0.1, 0.1]), atol=1e-15)


NO_NUMBERS = [
    *("2\N{NO-BREAK SPACE}", "\N{NO-BREAK SPACE}2", "2\N{THIN SPACE}", "2\N{IDEOGRAPHIC SPACE}"),
    *("1_0", "0_0.1", "\N{FULLWIDTH DIGIT TWO}", "\N{DEVANAGARI DIGIT TWO}", "2\N{NEXT LINE}"),
    *("2f", "2d0", "0x2", "2,5", "2e", "+ 2", "++2", "", ".", "inf", "nan", "1e400"),
    *("1e-400", "-1e-310", "0.1e-9999", "0." + 400 * "0" + "1"),
]


@pytest.mark.parametrize("spelling", NO_NUMBERS)
@pytest.mark.parametrize("place", ["mass", "ixx", "xyz"])
def test_numbers_that_urdfdom_drops_with_the_whole_body_are_refused(tmp_path, place, spelling):
    text = number_text(**{place: spelling if place != "xyz" else f"0 {spelling} 0"})
    with pytest.raises(
        RobotError, match=r"link 'arm': <(mass|inertia|origin) .* should be"
    ) as told:
        read_robot(urdf(tmp_path, text, joint()), {})
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("limitless", ["inf", "INFINITY", "+Inf", "1e400"])
def test_an_infinite_limit_is_none(tmp_path, limitless):
    swing = joint().replace('"5"', f'"{limitless}"').replace('velocity="2"', 'velocity="inf"')
    model = read_robot(urdf(tmp_path, link("arm"), swing.replace('"-1"', '"-inf"')), {}).model
    assert stated_limit(model.effortLimit[0]) == stated_limit(model.velocityLimit[0]) == np.inf
    assert stated_range(model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-np.inf, 1.0)


def test_a_body_that_the_model_lost_is_an_error(tmp_path, monkeypatch):
    """urdfdom drops a body whose number it cannot read, and keeps the other links."""
    built = robot._from_xml

    def losing(root):
        root = copy.deepcopy(root)
        root.find("link[@name='hand']").clear()
        root.find("link[3]").set("name", "hand")
        return built(root)

    monkeypatch.setattr(robot, "_from_xml", losing)
    hand = [link("hand"), joint("grip", "arm", "hand", "fixed")]
    with pytest.raises(RobotError, match=r"'arm' or 'hand' \(1 kg\) than is written \(2 kg\)"):
        read_robot(urdf(tmp_path, link("arm"), joint(), *hand), {})
