"""Frames of a motion: placements, friction, what holds, what is about to break away."""

import dataclasses
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from builders import example, plane_friction, random_tree, sliding_block
from numpy.testing import assert_allclose, assert_array_equal
from replay_cases import ROBOTS, page_data, result_of

import pinfric as pf
from pinfric.dynamics.simulation.motion import Motion
from pinfric.errors import PinfricError, StateError
from pinfric.show.timeline.frames import frame_times, make_frames, site_rates
from pinfric.show.timeline.motion import motion_to_replay

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


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
    scene = sliding_block(angle=np.deg2rad(30.0), actuators=[drive])
    t = np.linspace(0.0, 3.0, 301)
    moving = (t > 1.0) & (t < 2.0)
    v = np.where(moving, 1.0 - np.cos(2 * np.pi * t), 0.0)[:, None]
    a = np.where(moving, 2 * np.pi * np.sin(2 * np.pi * t), 0.0)[:, None]
    result = pf.inverse_dynamics(scene, np.zeros_like(v), v, a, t=t)
    rest = ((0.0, 1.0), (2.0, 3.0))
    assert make_frames(scene, result).gears == ({"slide": rest} if holds else {})


def test_a_gear_without_a_load_holds_nothing():
    worm = {"ratio": 50.0, "efficiency": 0.4, "back_efficiency": -0.2, "no_load_torque": 0.1}
    scene = sliding_block(actuators=[{"joint": "slide", "transmission": worm}])
    still = np.zeros((11, 1))
    result = pf.inverse_dynamics(scene, still, still, still, t=np.linspace(0.0, 1.0, 11))
    assert make_frames(scene, result).gears == {}


def test_a_gear_holds_in_a_simulation_while_its_joint_rests():
    worm = {"ratio": 50.0, "efficiency": 0.4, "back_efficiency": -0.2}
    scene = sliding_block(
        plane_friction(0.5, 0.5), actuators=[{"joint": "slide", "transmission": worm}]
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
            assert_allclose(frames.placement[f, j - 1], expected, atol=1e-12)
        assert_array_equal(frames.friction_upper[f], result.friction_upper[i])
        assert_array_equal(frames.force[f], result.wrench[i, :, :3])


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
    assert_array_equal(times, t[index])
    assert {17, 4321, 0, 10_000} <= set(index.tolist())
    assert 301 <= len(times) <= 303


def test_long_motion_gets_fewer_frames_a_second(monkeypatch, three_link):
    scene, result = three_link
    monkeypatch.setattr("pinfric.show.timeline.frames.MOST_FRAMES", 40)
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
    monkeypatch.setattr("pinfric.show.timeline.frames.MOST_FRAMES", 500)
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


@cache
def solved(name):
    scene, trajectory = example(ROBOTS / f"{name}.yaml", ROBOTS / f"{name}.waypoints.yaml")
    return scene, pf.inverse_dynamics(scene, trajectory)


@pytest.fixture(scope="module")
def delta():
    return solved("delta")


@pytest.fixture(scope="module")
def four_bar():
    return solved("four_bar")


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
            assert_allclose(rates[sample, s], expected, atol=1e-9)
    speeds = np.linalg.norm(rates, axis=2)
    assert_array_equal(speeds <= 1e-6, result.sticking)


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
                assert_allclose(frames.slip[f, s], moved, atol=1e-6)
        turning = [s for s, site in enumerate(scene.sites) if not site.ball]
        expected = np.tile(scene.site_tables.axis[turning], (len(frames.t), 1, 1))
        assert_array_equal(frames.slip[:, turning], expected)


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
        assert_allclose(
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
    assert pf.replay(scene, ajar).page.rstrip().endswith("</html>")


@pytest.mark.parametrize("name", ["slider_crank", "delta", "excavator", "drawer"])
def test_own_simulation_of_loops_and_cylinders_is_replayed(name):
    scene = pf.load_scene(ROBOTS / f"{name}.yaml")
    frames = make_frames(scene, pf.simulate(scene, t_end=0.1))
    assert np.isfinite(frames.force).all()
    assert np.isfinite(frames.friction_upper).all()
    sticks = np.isfinite(frames.use)
    assert (frames.use[sticks] <= 1.0 + 1e-9).all()
    for s, site in enumerate(frames.sites):
        inside = [any(a <= t < b for a, b in site.sticking) for t in frames.t]
        assert_array_equal(sticks[:-1, s], inside[:-1])


# The motion of a replay: a saved one of this scene only.


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
