"""Markers of drives, jams and small links."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from builders import dry
from numpy.testing import assert_allclose
from replay_cases import ROBOTS, page_data
from trimesh import creation

import pinfric as pf
from pinfric.show.replay.markers import site_marker
from pinfric.show.replay.meshes import DrawnShape


def jammed_drawer():
    scene = pf.load_scene(ROBOTS / "drawer.yaml")
    guide = {"bearing": {"kind": "guide", "length": 0.3}, "mu": {"static": 0.95, "kinetic": 0.9}}
    scene = dataclasses.replace(scene, friction={"slide": guide})
    trajectory = pf.load_trajectory(ROBOTS / "drawer.waypoints.yaml", scene)
    return scene, pf.inverse_dynamics(scene, trajectory)


@pytest.mark.slow
def test_jammed_motion_is_replayed_as_jammed():
    scene, result = jammed_drawer()
    assert np.isnan(result.effort_upper).sum() > 100
    shown = pf.replay(scene, result)
    (site,) = page_data(shown)["sites"]
    assert site["times"]["jammed"] == [[0.0, 1.9]]
    assert [(i.start, i.end) for i in shown.stick_intervals] == [(0.0, 0.1), (0.9, 1.2), (1.8, 1.9)]


def test_force_drive_is_drawn_with_its_tip_where_it_pushes():
    import meshcat
    import umsgpack

    from pinfric.show.replay.page import RecordingWindow
    from pinfric.show.replay.stage import set_stage

    scene, window = pf.load_scene(ROBOTS / "drawer.yaml"), RecordingWindow()
    set_stage(meshcat.Visualizer(window=window), scene, np.array([[[0, 0, 0, 0, 0, 0, 1.0]]]))
    placed = {}
    for command in map(umsgpack.unpackb, window.commands):
        if command["type"] == "set_transform":
            placed[command["path"]] = np.reshape(command["matrix"], (4, 4)).T
    arrow = placed["/meshcat/world/1 slide/drive push"]
    head = placed["/meshcat/world/1 slide/drive push/head"]
    assert_allclose(arrow[:3, 2], [1, 0, 0], atol=1e-6)
    begin = (arrow @ head @ [0, 0, 0, 1])[:3]  # of the head, which ends at the point
    assert begin[0] < -0.15
    assert_allclose(begin[1:], [0.2, 0.0], atol=1e-6)
    assert -0.15 - begin[0] < 0.05


def test_rings_at_small_links_are_small_and_those_at_large_ones_are_not():
    scene = pf.load_scene(ROBOTS / "pendulum.yaml")
    friction = {"joint_1": dry(1.0)}
    (site,) = scene.with_(friction=friction).sites
    found = {}
    for extent in (0.06, 0.6):
        sides = np.full(3, extent / np.sqrt(3.0))  # of a box with this diagonal, off the axis
        shape = DrawnShape("visual", 1, pin.SE3(np.eye(3), np.ones(3)), creation.box(sides))
        found[extent] = site_marker(scene, site, [shape], size=1.5)
    assert found[0.06].radius == pytest.approx(0.4 * 0.06)
    assert found[0.6].radius == pytest.approx(0.04 * 1.5)
    assert found[0.06].size < found[0.6].size == 1.5
