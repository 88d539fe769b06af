"""Replays without a browser: frames, what each site does, shapes, pages, bad input."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import block, plane_friction, random_tree
from mechanisms import add_link, bar, four_bar, grounded_model, pin_friction

import pinfric as pf
from pinfric.errors import PinfricError, PinfricWarning, StateError
from pinfric.model.described import in_json
from pinfric.model.equivalent_box import equivalent_box
from pinfric.show.replay.meshes import urdf_visuals
from pinfric.show.replay.page import RecordingWindow
from pinfric.show.replay.replay import (
    Replay,
    open_page,
    replay_lines,
    replay_summary,
)
from pinfric.show.replay.shapes import robot_shapes
from pinfric.show.replay.stage import SEGMENTS, SIDES, _tube, set_stage
from pinfric.study.retime.limits import read_limits
from pinfric.study.timeline.frames import frame_times, make_frames
from pinfric.study.timeline.motion import motion_to_replay

ROBOTS = Path(__file__).parents[3] / "robots"
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def bundled(name):
    scene = pf.load_scene(ROBOTS / f"{name}.yaml")
    return scene, pf.load_trajectory(ROBOTS / f"{name}.waypoints.yaml", scene)


def result_of(name):
    scene, trajectory = bundled(name)
    return scene, pf.inverse_dynamics(scene, trajectory)


@pytest.fixture(scope="module")
def three_link():
    return result_of("three_link")


@pytest.fixture(scope="module")
def pendulum_motion():
    scene = pf.load_scene(ROBOTS / "pendulum.yaml")
    return scene, pf.simulate(scene, [0.524], [1.0], None, 2.0)


# ---------------------------------------------------------------- frames


def test_every_begin_and_end_of_sticking_is_a_frame(three_link):
    scene, result = three_link
    frames = make_frames(scene, result, rate=5.0)
    assert len(result.stick_intervals()) == 3
    for interval in result.stick_intervals():
        assert np.abs(frames.t - interval.start).min() == 0.0
        assert np.abs(frames.t - interval.end).min() == 0.0
    assert (frames.t[0], frames.t[-1]) == (result.t[0], result.t[-1])
    assert len(frames.t) < 30  # 5 per second for 2.9 s, and what changes


@pytest.mark.parametrize(
    ("gear", "holds"),
    [
        ({"efficiency": 0.4, "back_efficiency": -0.2}, True),  # self-locking
        ({"efficiency": 0.4, "back_efficiency": 0.5}, False),
        # at rest all of 1e-9 N m decides: no_load r against the weight along the slope, 9.81 N
        ({"no_load_torque": 9.81 / 50.0 + 1e-9}, True),
        ({"no_load_torque": 9.81 / 50.0 - 1e-9}, False),
        ({"ratio": -50.0, "efficiency": 0.4, "back_efficiency": 0.0}, True),
        (None, False),
    ],
)
def test_a_gear_holds_by_itself_where_its_motor_may_be_without_torque(gear, holds):
    drive = (
        {"joint": "slide"}
        if gear is None
        else {"joint": "slide", "transmission": {"ratio": 50.0, **gear}}
    )
    scene = pf.Scene(model=block(np.deg2rad(30.0), 2.0), actuators=[drive])
    t = np.linspace(0.0, 3.0, 301)
    moving = (t > 1.0) & (t < 2.0)
    v = np.where(moving, 1.0 - np.cos(2 * np.pi * t), 0.0)[:, None]
    a = np.where(moving, 2 * np.pi * np.sin(2 * np.pi * t), 0.0)[:, None]
    result = pf.inverse_dynamics(scene, np.zeros_like(v), v, a, t=t)
    rest = ((0.0, 1.0), (2.0, 3.0))
    assert make_frames(scene, result).gears == ({"slide": rest} if holds else {})


def test_a_gear_without_a_load_holds_nothing():
    worm = {"ratio": 50.0, "efficiency": 0.4, "back_efficiency": -0.2, "no_load_torque": 0.1}
    scene = pf.Scene(model=block(), actuators=[{"joint": "slide", "transmission": worm}])
    still = np.zeros((11, 1))
    result = pf.inverse_dynamics(scene, still, still, still, t=np.linspace(0.0, 1.0, 11))
    assert make_frames(scene, result).gears == {}


def test_a_gear_holds_in_a_simulation_while_its_joint_rests():
    worm = {"ratio": 50.0, "efficiency": 0.4, "back_efficiency": -0.2}
    scene = pf.Scene(
        model=block(),
        friction={"slide": plane_friction(0.5, 0.5)},
        actuators=[{"joint": "slide", "transmission": worm}],
    )
    motion = pf.simulate(scene, [0.0], [1.0], np.array([5.0]), 1.0)
    (interval,) = motion.stick_intervals()
    ((start, end),) = make_frames(scene, motion).gears["slide"]
    assert (start, end) == (interval.start, interval.end)
    assert start > 0.1


def test_frames_hold_pinocchios_placements_and_the_results_friction(three_link):
    scene, result = three_link
    frames = make_frames(scene, result)
    data = scene.model.createData()
    for f in (0, len(frames.t) // 2, len(frames.t) - 1):
        i = int(np.flatnonzero(result.t == frames.t[f])[0])
        pin.forwardKinematics(scene.model, data, result.states.q[i])
        for j in range(1, scene.model.njoints):
            expected = pin.SE3ToXYZQUAT(data.oMi[j])
            np.testing.assert_allclose(frames.placement[f, j - 1], expected, atol=1e-12)
        np.testing.assert_array_equal(frames.friction_upper[f], result.friction_upper[i])
        np.testing.assert_array_equal(frames.force[f], result.wrench[i, :, :3])


def test_frames_between_coarse_samples_meet_positions_and_velocities():
    scene = pf.Scene(model=random_tree(0, joints=2, sliding=0.0))
    t = np.linspace(0.0, 2.0, 9)  # four samples a second of sin(2 t)
    ones = np.ones(scene.model.nv)
    exact = lambda times: np.array(  # noqa: E731
        [pin.integrate(scene.model, pin.neutral(scene.model), s * ones) for s in np.sin(2 * times)]
    )
    result = pf.inverse_dynamics(
        scene, exact(t), np.outer(2 * np.cos(2 * t), ones), np.outer(-4 * np.sin(2 * t), ones), t=t
    )
    frames = make_frames(scene, result, rate=60.0)
    assert len(frames.t) >= 120
    dense = pf.inverse_dynamics(
        scene,
        exact(frames.t),
        np.zeros((len(frames.t), 2)),
        np.zeros((len(frames.t), 2)),
        t=frames.t,
    )
    wanted = make_frames(scene, dense, rate=60.0)
    # cubic Hermite: h^4/384 max|x''''| = 0.25^4/384 x 16 = 1.6e-4 rad
    assert np.abs(frames.placement - wanted.placement).max() < 5e-4
    linear = np.interp(frames.t, t, np.sin(2 * t)) - np.sin(2 * frames.t)
    assert np.abs(linear).max() > 0.02  # what joining the samples by lines would have cost


def test_frame_times_are_samples_where_these_are_dense_and_fewer():
    t = np.linspace(0.0, 10.0, 10_001)
    times, index = frame_times(t, np.array([17, 4321]), rate=30.0)
    np.testing.assert_array_equal(times, t[index])
    assert {17, 4321, 0, 10_000} <= set(index.tolist())
    assert 301 <= len(times) <= 303


def test_long_motion_gets_fewer_frames_a_second(monkeypatch, three_link):
    scene, result = three_link
    monkeypatch.setattr("pinfric.study.timeline.frames.MOST_FRAMES", 40)
    assert len(make_frames(scene, result).t) <= 40 + 12  # and what changes


def test_end_of_an_interval_is_about_to_break_away_unless_the_motion_ends_there(three_link):
    scene, result = three_link
    (site,) = make_frames(scene, result).sites
    assert [near[1] for near in site.near] == [s[1] for s in site.sticking[:-1]]
    assert all(0 < end - start <= 0.1 + 1e-12 for start, end in site.near)
    assert site.sticking[-1][1] == result.t[-1]


def test_simulated_site_is_near_break_away_where_its_friction_nears_the_limit(pendulum_motion):
    scene, motion = pendulum_motion
    frames = make_frames(scene, motion)
    assert frames.simulated
    (interval,) = motion.stick_intervals()
    assert frames.sites[0].sticking == ((interval.start, interval.end),)
    ((start, end),) = frames.sites[0].near
    # friction leaves the limit it had while sliding, and reaches the other one at break-away
    assert interval.start < start < end <= interval.end
    assert interval.end - end < 2.1e-3  # one sample
    i = int(np.searchsorted(motion.t, start))
    limit = 0.35 * motion.normal_load[i, 0]
    assert abs(motion.friction[i, 0]) >= 0.9 * limit
    assert abs(motion.friction[i - 1, 0]) < 0.9 * 0.35 * motion.normal_load[i - 1, 0]
    inside = (frames.t >= interval.start) & (frames.t < interval.end)
    assert np.isfinite(frames.use[inside]).all()
    assert np.isnan(frames.use[~inside]).all()


def test_payload_is_shown_while_it_is_carried():
    scene, result = result_of("panda_pick_and_place")
    ((start, end),) = make_frames(scene, result).carried["box"]
    column = result.states.attached[:, 0]
    assert column[np.searchsorted(result.t, start)]
    assert not column[np.searchsorted(result.t, start) - 1]
    assert not column[np.searchsorted(result.t, end)]


def test_log_whose_noise_passes_zero_all_the_time_keeps_the_page_small(monkeypatch, three_link):
    scene = three_link[0]
    t = np.arange(0.0, 3.0, 1e-3)
    v = np.sin(t)[:, None] * np.ones(3)
    v[::2, 1] = 0.0  # sticks at every other sample
    monkeypatch.setattr("pinfric.study.timeline.frames.MOST_FRAMES", 500)
    result = pf.inverse_dynamics(scene, 0 * v, v, 0 * v, t=t)
    assert len(result.stick_intervals()) == 1500
    frames = make_frames(scene, result)
    assert len(frames.t) <= 2 * 500 + 2
    assert len(frames.sites[0].sticking) == 1500  # the colours lose none


def test_simulation_that_ended_early_says_so_on_its_page(pendulum_motion):
    import dataclasses

    scene, motion = pendulum_motion
    stopped = dataclasses.replace(motion, status="failed", message="at t = 2 s: the end")
    assert make_frames(scene, motion).ended == ""
    assert "It ended early: at t = 2 s: the end" in pf.replay(scene, stopped).page
    assert "It ended early" not in pf.replay(scene, motion).page


# ---------------------------------------------------------------- shapes


def test_box_of_equal_inertia_has_the_bodys_moments():
    edges = np.array([0.3, 0.2, 0.7])
    mass, turn = 2.5, pin.exp3(np.array([0.4, -0.2, 0.9]))
    moments = mass / 12 * (edges @ edges - edges**2)
    body = pin.Inertia(mass, np.array([0.1, 0.2, 0.3]), turn @ np.diag(moments) @ turn.T)
    box = equivalent_box(body)
    np.testing.assert_allclose(np.sort(box.edges), np.sort(edges), rtol=1e-9)
    axes = box.placement.rotation
    back = axes @ np.diag(mass / 12 * (box.edges @ box.edges - box.edges**2)) @ axes.T
    np.testing.assert_allclose(back, body.inertia, atol=1e-12)
    np.testing.assert_array_equal(box.placement.translation, body.lever)
    assert equivalent_box(pin.Inertia.Zero()) is None


def test_robot_without_urdf_is_drawn_from_its_inertias():
    scene = pf.Scene(model=random_tree(2, joints=4))
    shapes = robot_shapes(scene)
    assert [shape.joint for shape in shapes if shape.kind == "body"] == [1, 2, 3, 4]
    assert sum(shape.kind == "line" for shape in shapes) == 4
    window = drawn(scene)
    assert (
        sum(b"/body_" in command and b"set_object" in command for command in window.commands) == 4
    )


def drawn(scene):
    import meshcat

    window = RecordingWindow()
    placement = np.tile([0, 0, 0, 0, 0, 0, 1.0], (1, scene.model.njoints - 1, 1))
    set_stage(meshcat.Visualizer(window=window), scene, placement)
    return window


def boom():
    """A bar lifted by a cylinder between two points 0.3 m and 0.7 m from its hinge."""
    model = grounded_model(gravity=(0.0, 0.0, -9.81))
    add_link(
        model,
        0,
        pin.JointModelRY(),
        pin.SE3(np.eye(3), np.array([0, 0, 0.5])),
        "boom",
        bar(20.0, 1.5),
    )
    ends = {"a": {"link": "ground", "xyz": [0.3, 0, 0]}, "b": {"link": "boom", "xyz": [0.7, 0, 0]}}
    return pf.Scene(
        model=model,
        friction={"boom": pin_friction(0.15)},
        actuators=[{"cylinder": {"name": "lift", **ends}}],
    )


def test_loops_and_cylinders_are_drawn_where_they_act():
    import meshcat

    closed, _ = four_bar()
    window = RecordingWindow()
    rest = np.tile([0, 0, 0, 0, 0, 0, 1.0], (1, 3, 1))
    staged = set_stage(meshcat.Visualizer(window=window), closed, rest)
    loop = closed.site_names.index("B")
    place = staged.markers[loop]
    frame = closed.linkage.frame_p[0, 1]
    np.testing.assert_allclose(place.placement.translation, frame)
    assert closed.joint_names[place.joint - 1] in staged.site_paths[loop]
    assert staged.site_paths[loop].endswith("site B")
    lifted = boom()
    staged = set_stage(meshcat.Visualizer(window=RecordingWindow()), lifted, rest[:, :1])
    (cylinder,) = staged.cylinders
    assert cylinder.path == "world/cylinder lift"
    assert (cylinder.a[0], cylinder.b[0]) == (0, 1)
    np.testing.assert_array_equal(cylinder.b[1], [0.7, 0, 0])


def test_urdfs_primitives_are_drawn_as_they_are():
    scene = pf.load_scene(ROBOTS / "three_link.yaml")
    visuals, missing = urdf_visuals(scene.model, scene.robot)
    assert (len(visuals), missing) == (6, {})
    bar = visuals[1]  # link_1's box, 0.07 x 0.4 x 0.07 at (0, 0.2, 0), red
    assert bar.joint == 1
    np.testing.assert_allclose(np.ptp(bar.mesh.vertices, axis=0), [0.07, 0.4, 0.07])
    np.testing.assert_array_equal(bar.placement.translation, [0, 0.2, 0])
    assert tuple(bar.mesh.visual.vertex_colors[0]) == (204, 76, 64, 255)


def test_first_faces_of_an_arc_are_its_beginning():
    tube = _tube(1.0, 0.01, np.deg2rad(90.0))
    assert len(tube.faces) == 2 * SEGMENTS * SIDES
    quarter = tube.vertices[tube.faces[: len(tube.faces) // 4]].reshape(-1, 3)
    angle = np.arctan2(quarter[:, 1], quarter[:, 0])
    assert np.rad2deg(angle.max()) == pytest.approx(22.5)


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
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


def test_mesh_beside_the_urdf_is_scaled_and_painted(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "plate.obj").write_text(OBJ)
    scene = arm(tmp_path, "meshes/plate.obj")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shapes = robot_shapes(scene)
    (plate,) = [shape for shape in shapes if shape.joint == 1]
    assert plate.kind == "visual"
    np.testing.assert_allclose(plate.mesh.vertices.max(axis=0), [2, 2, 0])
    assert tuple(plate.mesh.visual.vertex_colors[0]) == (255, 0, 0, 128)


def test_missing_and_broken_meshes_become_shapes_with_one_warning(tmp_path):
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    scene = arm(tmp_path, "package://nowhere/a.dae", "broken.stl", "c.obj")
    with pytest.warns(PinfricWarning) as caught:
        shapes = robot_shapes(scene)
    assert len(caught) == 1
    text = str(caught[0].message)
    assert all(name in text for name in ("nowhere/a.dae", "broken.stl", "c.obj", "arm.urdf"))
    assert [shape.joint for shape in shapes if shape.kind == "body"] == [1]


def test_replay_goes_on_without_meshes(tmp_path):
    scene = arm(tmp_path, "gone.stl")
    t = np.linspace(0, 1, 50)[:, None]
    result = pf.inverse_dynamics(scene, t, np.ones_like(t), 0 * t, t=t[:, 0])
    with pytest.warns(PinfricWarning, match="gone.stl"):
        shown = pf.replay(scene, result, html=tmp_path / "out.html")
    assert shown.html.stat().st_size > 500_000


# ---------------------------------------------------------------- the page


def test_page_is_one_file_that_fetches_nothing(three_link, tmp_path):
    import re

    scene, result = three_link
    shown = pf.replay(scene, result, html=tmp_path / "deep" / "out.html", title="a < b & </script>")
    page = shown.html.read_text()
    assert page == shown.page
    assert "<title>a &lt; b &amp; &lt;/script&gt;</title>" in page
    ours = page.replace(page[page.index("<script>") : page.index('<script type="application')], "")
    assert not re.search(r"""(src|href)=["'](?!data:)|https?://|@import|fetch\(""", ours)
    assert ours.count("</script>") == 4  # data, commands, frames, ours
    assert not list((tmp_path / "deep").glob(".unfinished*"))
    assert (shown.frames, shown.duration) == (179, pytest.approx(2.9))


def test_pages_of_the_bundled_robots_stay_below_6_mb(tmp_path):
    for name in ("panda_pick_and_place", "so101"):
        scene, result = result_of(name)
        shown = pf.replay(scene, result)
        assert 1e6 < len(shown.page) < 6e6
        assert shown.html is None


def test_notebook_shows_the_page_in_a_frame(three_link):
    shown = pf.replay(*three_link)
    inside = shown._repr_html_()
    assert inside.startswith("<iframe srcdoc=")
    assert '"' not in inside.split('srcdoc="')[1].split('" style=')[0]


def test_json_is_what_the_command_prints(three_link, tmp_path):
    shown = pf.replay(*three_link, html=tmp_path / "out.html")
    printed = json.loads(json.dumps(in_json(replay_summary(shown))))
    assert set(printed) == {"html", "duration", "frames", "stick_intervals"}
    assert printed["html"] == str(tmp_path / "out.html")
    assert [i["site"] for i in printed["stick_intervals"]] == ["joint_12"] * 3


def pushed():
    """2 kg m^2 that 4 N m speed up for 1 s, that rests on at 2 rad/s, that 6 N m brake; rest."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "j")
    model.appendBodyToJoint(
        joint, pin.Inertia(1.0, np.zeros(3), 2.0 * np.eye(3)), pin.SE3.Identity()
    )
    t = np.arange(3001) / 1000.0
    a = np.select([t <= 1.0, t <= 2.0, t < 2.0 + 2 / 3], [2.0, 0.0, -3.0], 0.0)[:, None]
    v = np.where(t <= 1.0, 2.0 * t, np.clip(2.0 - 3.0 * (t - 2.0), 0.0, 2.0))[:, None]
    scene = pf.Scene(model=model)
    return scene, pf.inverse_dynamics(scene, np.cumsum(v, axis=0) / 1000.0, v, a, t=t)


def test_limits_that_hold_the_motion_back_are_marked_while_it_moves():
    scene, result = pushed()
    limits = {"j": {"peak_torque": 4.01, "velocity": 2.0}}
    marked = make_frames(scene, result, limits=read_limits(scene, limits)).limiting
    (torque, over), (speed, faster) = marked["j"]["peak torque"], marked["j"]["joint speed"]
    np.testing.assert_allclose(torque, [(0.0, 1.0), (2.0, 2.0 + 2 / 3)], atol=3e-3)
    np.testing.assert_allclose(over, torque[1:], atol=1e-9)
    np.testing.assert_allclose(speed, [(1.0, 2.0)], atol=3e-3)
    assert faster == ()
    assert make_frames(scene, result).limiting == {}
    page = pf.replay(scene, result, limits=limits).page
    assert "peak torque exceeded" in page
    geared = limits["j"] | {"transmission": {"ratio": 2.0}}  # whose motor gives half the torque
    assert "peak torque" not in pf.replay(scene, result, limits={"j": geared}).page


def test_limits_of_a_simulated_motion_are_refused(pendulum_motion):
    scene, motion = pendulum_motion
    limits = {name: {"peak_torque": 1.0} for name in scene.actuator_names}
    with pytest.raises(StateError, match="limits are for results of inverse dynamics"):
        pf.replay(scene, motion, limits=limits)


def test_command_takes_a_trajectory_a_saved_motion_or_the_scenes_simulation(
    pendulum_motion, tmp_path, capsys
):
    scene, motion = pendulum_motion
    given, log = motion_to_replay(scene, "pendulum.waypoints.yaml")
    assert isinstance(given, pf.InverseResult)
    assert log is None  # way-points have no efforts of their own
    file = motion.save(tmp_path / "motion.npz")
    assert motion_to_replay(scene, str(file))[0].stick_intervals() == motion.stick_intervals()
    own, _ = motion_to_replay(scene)
    assert own.stick_intervals()[0].start == pytest.approx(1.07, abs=0.01)  # printed in the paper
    with pytest.raises(PinfricError, match=r"nothing\.csv"):
        motion_to_replay(scene, "nothing.csv")
    shown = pf.replay(scene, own, html=tmp_path / "out.html")
    first, second = replay_lines(shown, opened=False)
    assert "1 stiction interval: " in first
    assert str(tmp_path / "out.html") in first
    assert "no display" in second
    assert len(replay_lines(shown, opened=True)) == 1


def test_replay_does_not_load_plotting_or_a_server(tmp_path):
    code = (
        "import sys, warnings, pinfric as pf\n"
        f"s = pf.load_scene(r'{ROBOTS / 'three_link.yaml'}')\n"
        f"t = pf.load_trajectory(r'{ROBOTS / 'three_link.waypoints.yaml'}', s)\n"
        f"pf.replay(s, pf.inverse_dynamics(s, t), html=r'{tmp_path / 'o.html'}')\n"
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pinfric.show.replay.page" in done.stdout
    assert "matplotlib.pyplot" not in done.stdout
    assert "pinocchio.visualize" not in done.stdout


# ---------------------------------------------------------------- bad input


def test_motion_of_another_scene_is_refused_and_says_what_differs(three_link, pendulum_motion):
    scene, _ = three_link
    with pytest.raises(StateError, match=r"pendulum\.yaml.*three_link\.yaml differs in joints"):
        pf.replay(scene, pendulum_motion[1])
    smoother = pf.Scene(model=scene.model, friction={"joint_12": {"viscous": 0.1}})
    with pytest.raises(StateError, match="differs in friction"):
        pf.replay(smoother, three_link[1])


def test_saved_motion_of_another_scene_is_refused(three_link, pendulum_motion, tmp_path):
    file = pendulum_motion[1].save(tmp_path / "motion.npz")
    back = pf.load_motion(file, pendulum_motion[0])
    assert pf.replay(pendulum_motion[0], back).stick_intervals == (
        pendulum_motion[1].stick_intervals()
    )
    with pytest.raises(PinfricError, match=r"pendulum\.yaml.*differs in joints"):
        pf.load_motion(file, three_link[0])


def test_motion_file_that_is_not_there_is_called_so(pendulum_motion):
    with pytest.raises(PinfricError, match=r"there is no file nothing\.npz"):
        motion_to_replay(pendulum_motion[0], "nothing.npz")


def test_result_without_times_is_refused(three_link):
    scene, _ = three_link
    result = pf.inverse_dynamics(scene, np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)))
    with pytest.raises(StateError, match="give `t`"):
        pf.replay(scene, result)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
def test_rate_must_be_positive(three_link, rate):
    with pytest.raises(StateError, match="rate"):
        pf.replay(*three_link, rate=rate)


def test_page_that_cannot_be_written_is_one_clear_error(three_link, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PinfricError, match="cannot be written"):
        pf.replay(*three_link, html=tmp_path / "file" / "out.html")


def test_without_display_the_page_is_written_and_named(three_link, monkeypatch):
    import webbrowser

    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(webbrowser, "open", lambda _: pytest.fail("a text browser was started"))
    shown = pf.replay(*three_link, open_browser=True)
    assert shown.html.read_text() == shown.page
    assert str(shown.html) in repr(shown)
    assert shown.open() is False
    monkeypatch.setenv("DISPLAY", ":0")
    asked = []
    monkeypatch.setattr(webbrowser, "open", lambda url: asked.append(url) or True)
    assert open_page(shown.html)
    assert open_page("http://127.0.0.1:7000/static/")
    assert asked == [shown.html.as_uri(), "http://127.0.0.1:7000/static/"]
    assert Replay("", None, 0.0, 0, ()).open() is False


@pytest.mark.parametrize(("mass", "drawn"), [(1.0, True), (1e-300, False), (1e-30, False)])
def test_an_inertia_without_mass_is_no_box_beyond_every_machine(mass, drawn):
    """0.1 kg m^2 with 1e-300 kg is a cube of 8e149 m, which single precision does not hold."""
    box = equivalent_box(pin.Inertia(mass, np.zeros(3), 0.1 * np.eye(3)))
    assert (box is not None) == drawn
    if drawn:
        np.testing.assert_allclose(box.edges, np.sqrt(0.6), rtol=1e-12)
