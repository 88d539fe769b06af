"""What the tests of model share."""

from __future__ import annotations

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
