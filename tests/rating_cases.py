"""Arms that are rated: published ones, and one of every kind of joint."""

from __future__ import annotations

from pathlib import Path

import pinfric as pf
from pinfric.model.robot import read_robot, urdf_file

#: Turns endlessly, lifts between limits that leave out the stretched posture, slides, and turns.
ARM = """<robot name="arm"><link name="base"/>
{links}<joint name="pan" type="continuous"><parent link="base"/><child link="column"/>
<origin xyz="0 0 0.3"/><axis xyz="0 0 1"/><limit effort="50" velocity="2"/></joint>
<joint name="lift" type="revolute"><parent link="column"/><child link="boom"/>
<axis xyz="0 -1 0"/><limit lower="0.3" upper="1.9" effort="90" velocity="1.5"/></joint>
<joint name="slide" type="prismatic"><parent link="boom"/><child link="stick"/>
<origin xyz="0.4 0 0"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.5" effort="90" velocity="0.2"/></joint>
<joint name="wrist" type="revolute"><parent link="stick"/><child link="tool"/>
<origin xyz="0.2 0.05 0" rpy="0 1.5708 0"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="9" velocity="3"/></joint></robot>"""
_LINK = (
    '<link name="{}"><inertial><mass value="{}"/><origin xyz="0.1 0 0.02"/><inertia ixx="0.02" '
    'iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
)
_LINKS = {"column": 4.0, "boom": 3.0, "stick": 2.0, "tool": 0.5}

#: Name -> URDF, what its maker prints (kg; Panda's 3 kg less its hand), link, top speeds (rad/s).
ROBOTS = {
    "ur10": ("ur_description/urdf/ur10_robot.urdf", 10.0, "tool0", [2.09] * 2 + [3.14] * 4),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", 5.0, "tool0", [3.14] * 6),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", 3.0, "tool0", [3.14] * 3 + [6.28] * 3),
    "panda": ("panda_description/urdf/panda.urdf", 2.27, "panda_link8", []),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", 3.5, "link_eef", []),
    "arm": ("", 2.0, "tool", []),
}


def write_arm(folder: Path, old: str = "", new: str = "") -> Path:
    """Write the arm's URDF, one text of it replaced."""
    file = folder / "arm.urdf"
    links = "".join(_LINK.format(*link) for link in _LINKS.items())
    file.write_text(ARM.format(links=links).replace(old, new) if old else ARM.format(links=links))
    return file


def rated_robot(name: str, folder: Path) -> tuple[pf.Scene, dict[str, object]]:
    """A robot whose links hold its drives, and the keys of its rating."""
    urdf, payload, link, speeds = ROBOTS[name]
    file = urdf_file(f"example-robot-data:{urdf}") if urdf else write_arm(folder)
    robot = read_robot(file, {})
    scene = pf.Scene(robot.model, robot=robot, masses="with_drives", source=str(file))
    named = dict(zip(scene.joint_names, speeds, strict=False))
    return scene, {"payload": payload, "link": link, "speed": named}
