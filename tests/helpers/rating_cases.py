"""Arms that are rated: published ones, and one of every kind of joint."""

from pathlib import Path

from machines import RATED, rated

import pinfric as pf
from pinfric.model.robot import read_robot

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

#: Published arms, and the one above.
ROBOTS = (*RATED, "arm")


def write_arm(folder: Path, old: str = "", new: str = "") -> Path:
    """Write the arm's URDF, one text of it replaced."""
    file = folder / "arm.urdf"
    links = "".join(_LINK.format(*link) for link in _LINKS.items())
    file.write_text(ARM.format(links=links).replace(old, new) if old else ARM.format(links=links))
    return file


def rated_robot(name: str, folder: Path) -> tuple[pf.Scene, dict[str, object]]:
    """A robot whose links hold its drives, and the keys of its rating."""
    if name in RATED:
        return rated(name)
    file = write_arm(folder)
    robot = read_robot(file, {})
    scene = pf.Scene(robot.model, robot=robot, masses="with_drives", source=str(file))
    return scene, {"payload": 2.0, "link": "tool"}
