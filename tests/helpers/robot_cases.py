"""Robots of example-robot-data."""

import pytest

from pinfric.model.robot import example_robot_data

INERTIA = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'


def link(name, mass="1", inertia=INERTIA):
    return f'<link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial></link>'


def joint(name="swing", parent="base", child="arm", kind="revolute", axis="0 0 1", more=""):
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <axis xyz="{axis}"/><limit lower="-1" upper="1" effort="5" velocity="2"/>{more}</joint>"""


def urdf(tmp_path, *parts):
    file = tmp_path / "robot.urdf"
    file.write_text(f'<robot name="r"><link name="base"/>{"".join(parts)}</robot>')
    return file


def scene(tmp_path, text):
    file = tmp_path / "scene.yaml"
    file.write_text("pinfric: 1\n" + text)
    return file


#: Of the robots of example-robot-data those that differ, for fast tests: an arm, continuous joints,
#: tilted axes, slides and followers, these and more than 20 joints, followers before their
#: leaders, implausible bodies, no joint at all, no valid URDF.
DIFFERENT = {
    "ur5_robot",
    "kinova",
    "finger_edu",
    "baxter",
    "tiago_pro",
    "romeo",
    "bolt",
    "iris_simple",
    "ur3",
}


def each_robot():
    """Every URDF of example-robot-data, for parametrize; slow but for those that differ."""
    return [
        pytest.param(file, id=file.stem, marks=[] if file.stem in DIFFERENT else pytest.mark.slow)
        for file in sorted(example_robot_data().rglob("*.urdf"))
    ]
