import json
import re
from functools import cache
from pathlib import Path

import numpy as np
from builders import example

import pinfric as pf
from pinfric.show.replay.page import RecordingWindow
from pinfric.show.replay.stage import set_stage

ROBOTS = Path(__file__).parents[2] / "robots"


def bundled(name):
    return example(ROBOTS / f"{name}.yaml", ROBOTS / f"{name}.waypoints.yaml")


def result_of(name):
    scene, trajectory = bundled(name)
    return scene, pf.inverse_dynamics(scene, trajectory)


def drawn(scene):
    import meshcat

    window = RecordingWindow()
    placement = np.tile([0, 0, 0, 0, 0, 0, 1.0], (1, scene.model.njoints - 1, 1))
    set_stage(meshcat.Visualizer(window=window), scene, placement)
    return window


ARM = """<robot name="arm">
  <link name="base"/>
  <link name="link"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    {visuals}</link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="link"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>"""


def arm(folder, *meshes):
    visuals = "".join(
        f'<visual><origin xyz="0 0 1"/><geometry><mesh filename="{name}" scale="2 2 2"/></geometry>'
        '<material name="m"><color rgba="1 0 0 0.5"/></material></visual>'
        for name in meshes
    )
    (folder / "arm.urdf").write_text(ARM.format(visuals=visuals))
    (folder / "arm.yaml").write_text(
        "pinfric: 1\nrobot: {urdf: arm.urdf}\nfriction: {shoulder: {bearing: "
        "{kind: pin, radius: 0.05}, mu: {static: 0.2, kinetic: 0.1}}}\n"
    )
    return pf.load_scene(folder / "arm.yaml")


def page_data(shown):
    return json.loads(re.search(r'id="data">(.*?)</script>', shown.page, re.DOTALL)[1])


@cache
def simulated_pendulum():
    """A scene and its simulation over 2 s."""
    scene = pf.load_scene(ROBOTS / "pendulum.yaml")
    return scene, pf.simulate(scene, [0.524], [1.0], None, 2.0)


@cache
def three_links():
    """The result of the bundled arm of three links."""
    return result_of("three_link")
