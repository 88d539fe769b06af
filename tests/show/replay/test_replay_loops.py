"""Replays of closed loops: what slides in a loop's joint, balls, jams, simulated motions."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinfric as pf
from pinfric.dynamics.simulation.motion import Motion
from pinfric.study.timeline.frames import make_frames, site_rates

ROBOTS = Path(__file__).parents[3] / "robots"


def solved(name):
    scene = pf.load_scene(ROBOTS / f"{name}.yaml")
    trajectory = pf.load_trajectory(ROBOTS / f"{name}.waypoints.yaml", scene)
    return scene, pf.inverse_dynamics(scene, trajectory)


@pytest.fixture(scope="module")
def delta():
    return solved("delta")


@pytest.fixture(scope="module")
def four_bar():
    return solved("four_bar")


def page_data(shown):
    return json.loads(re.search(r'id="data">(.*?)</script>', shown.page, re.DOTALL)[1])


def relative_spin(scene, loop, q, v):
    """Angular velocity of a loop's side b relative to side a, in frame b, by Pinocchio alone."""
    model = scene.model
    data = model.createData()
    pin.forwardKinematics(model, data, q, v)
    spins = []
    for side in (loop.a, loop.b):
        frame = model.frames[model.getFrameId(side.link)]
        turn = data.oMi[frame.parentJoint].rotation
        spins.append(turn @ data.v[frame.parentJoint].angular)
        turn = turn @ frame.placement.rotation @ pin.rpy.rpyToMatrix(np.array(side.rpy))
    return turn.T @ (spins[1] - spins[0])


@pytest.mark.parametrize("name", ["four_bar", "delta", "slider_crank"])
def test_rates_of_loops_joints_are_those_of_the_bodies_they_join(name):
    scene, result = solved(name)
    states = result.states
    rates = site_rates(scene, states.q, states.v)
    for sample in (0, len(states.q) // 3, len(states.q) // 2):
        for s, site in enumerate(scene.sites):
            if site.pair < 0:
                expected = site.axis * states.v[sample, site.velocity_index]
            else:
                q, v = states.q[sample], states.v[sample]
                expected = relative_spin(scene, scene.loops[site.pair], q, v)
                if not site.ball:
                    expected = site.axis * (expected @ site.axis)
            np.testing.assert_allclose(rates[sample, s], expected, atol=1e-9)
    speeds = np.linalg.norm(rates, axis=2)
    np.testing.assert_array_equal(speeds <= 1e-6, result.sticking)


def test_friction_of_a_ball_acts_about_the_direction_of_its_slip(delta):
    scene, result = delta
    frames = make_frames(scene, result)
    for s in (s for s, site in enumerate(scene.sites) if site.ball):
        moved = None
        for f, t in enumerate(frames.t):
            i = int(np.searchsorted(result.t, t, side="right") - 1)
            spin = relative_spin(
                scene, scene.loops[scene.sites[s].pair], result.states.q[i], result.states.v[i]
            )
            assert np.linalg.norm(frames.slip[f, s]) == pytest.approx(1.0)
            if not result.sticking[i, s]:
                moved = spin / np.linalg.norm(spin)
                assert frames.friction_upper[f, s] <= 0  # against the slip
            if moved is not None:  # at rest: as it slipped last
                np.testing.assert_allclose(frames.slip[f, s], moved, atol=1e-6)
        turning = [s for s, site in enumerate(scene.sites) if not site.ball]
        expected = np.tile(scene.site_tables.axis[turning], (len(frames.t), 1, 1))
        np.testing.assert_array_equal(frames.slip[:, turning], expected)


def simulated(scene, result, part):
    """A motion as a simulation of a scene with loops would return it, from inverse dynamics."""
    t = result.t[part]
    modes = np.where(result.sticking, 0, -np.sign(result.friction_upper)).astype(int)[part]
    change = np.flatnonzero((modes[1:] != modes[:-1]).any(axis=1)) + 1
    return Motion(
        scene=scene,
        method="event",
        t=t,
        q=result.states.q[part],
        v=result.states.v[part],
        a=result.states.a[part],
        effort=result.effort_upper[part],
        modes=modes,
        friction=np.where(result.sticking, 0.3, 1.0)[part] * result.friction_upper[part],
        normal_load=result.normal_load[part],
        events=(),
        phase_t=t[[0, *change, len(t) - 1]],
        phase_modes=modes[[0, *change]],
        status="finished",
        message="",
        evaluations=0,
    )


@pytest.mark.parametrize("name", ["four_bar", "delta", "excavator"])
def test_simulated_motion_of_loops_and_cylinders_is_replayed_with_its_forces(name):
    scene, result = solved(name)
    motion = simulated(scene, result, slice(0, None))
    frames = make_frames(scene, motion)
    sample = np.searchsorted(result.t, frames.t, side="right") - 1
    carried = result.states.attached
    if carried is None or not carried.any():
        moves = ~result.sticking[sample].any(axis=1)
        np.testing.assert_allclose(
            frames.force[moves], result.wrench[sample][moves, :, :3], rtol=1e-6, atol=1e-6
        )
    assert np.isfinite(frames.force).all()
    sticks = result.sticking[sample]
    assert np.isfinite(frames.use[sticks]).all()
    assert np.isnan(frames.use[~sticks]).all()
    shown = pf.replay(scene, motion)
    assert shown.stick_intervals == motion.stick_intervals()
    assert [site["name"] for site in page_data(shown)["sites"]] == list(scene.site_names)


def test_simulated_motion_whose_loops_are_a_little_open_is_replayed_without_forces(four_bar):
    scene, result = four_bar
    motion = simulated(scene, result, slice(100, 400))
    opened = [pin.integrate(scene.model, q, np.array([0.0, 1e-3, 0.0])) for q in motion.q]
    ajar = dataclasses.replace(motion, q=np.array(opened))
    frames = make_frames(scene, ajar)
    assert np.isnan(frames.force).all()
    assert np.isfinite(frames.placement).all()
    assert len(pf.replay(scene, ajar).page) > 500_000


def jammed_drawer():
    scene = pf.load_scene(ROBOTS / "drawer.yaml")
    guide = {"bearing": {"kind": "guide", "length": 0.3}, "mu": {"static": 0.95, "kinetic": 0.9}}
    scene = dataclasses.replace(scene, friction={"slide": guide})
    trajectory = pf.load_trajectory(ROBOTS / "drawer.waypoints.yaml", scene)
    return scene, pf.inverse_dynamics(scene, trajectory)


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
    arrow = placed["/meshcat/world/slide/drive push"]
    head = placed["/meshcat/world/slide/drive push/head"]
    np.testing.assert_allclose(arrow[:3, 2], [1, 0, 0], atol=1e-6)
    begin = (arrow @ head @ [0, 0, 0, 1])[:3]  # of the head, which ends at the point
    assert begin[0] < -0.15
    np.testing.assert_allclose(begin[1:], [0.2, 0.0], atol=1e-6)
    assert -0.15 - begin[0] < 0.05


@pytest.mark.parametrize("name", ["slider_crank", "delta", "excavator", "drawer"])
def test_own_simulation_of_loops_and_cylinders_is_replayed(name):
    from pinfric.study.scene_run import run_scene

    scene = pf.load_scene(ROBOTS / f"{name}.yaml")
    frames = make_frames(scene, run_scene(scene, t_end=0.1))
    assert np.isfinite(frames.force).all()
    assert np.isfinite(frames.friction_upper).all()
    sticks = np.isfinite(frames.use)
    assert (frames.use[sticks] <= 1.0 + 1e-9).all()
    for s, site in enumerate(frames.sites):
        inside = [any(a <= t < b for a, b in site.sticking) for t in frames.t]
        np.testing.assert_array_equal(sticks[:-1, s], inside[:-1])
