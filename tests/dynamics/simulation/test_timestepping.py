"""Time steps with impulses: order, events within a step, stability."""

import numpy as np
import pytest
from builders import dry, plane_friction, sliding_block
from cases import painleve_rod
from mechanisms import FIVE_BAR, five_bar
from numpy.testing import assert_allclose
from simulation_cases import Belt

import pinfric as pf
from pinfric.dynamics.samples.closure import consistent_motion


def test_timestepping_is_first_order():
    """On the paper's robot, through its stick."""
    scene, q0, v0 = pf.load_scene("three_link"), np.zeros(3), [1.0, -1.0, 1.0]
    exact = pf.simulate(scene, q0, v0, None, 0.8, rtol=1e-10).q[-1]
    steps = np.array([4e-3, 2e-3, 1e-3, 5e-4])
    errors = []
    for dt in steps:
        m = pf.simulate(scene, q0, v0, None, 0.8, "timestepping", dt=dt, sample_step=0.1)
        errors.append(np.abs(m.q[-1] - exact).max())
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 0.9 < order < 1.2
    assert errors[-1] < 5e-3
    assert m.evaluations == 1600 + 8 + 1 + 1  # steps, samples, the start, one look at the stop


def test_timestepping_meets_the_events_of_the_belt_to_its_step():
    belt = Belt()
    dt = 1e-3
    motion = belt.run(belt.first_slip + 3.5 * belt.period, "timestepping", dt=dt)
    assert [e.kind for e in motion.events] == ["slip", "stick"] * 3 + ["slip"]
    slips = np.array([e.time for e in motion.events if e.kind == "slip"])
    assert_allclose(slips, belt.first_slip + belt.period * np.arange(4), atol=5 * dt)
    stuck = motion.modes[:, 0] == 0
    assert (motion.v[stuck] == 0).all()
    expected = [belt.position(t) for t in motion.t]
    assert_allclose(motion.q[:, 0], expected, atol=5 * dt)


def test_timestepping_is_stable_at_any_step():
    """One step of 10 s with friction far beyond the bound of explicit methods."""
    scene = sliding_block(plane_friction(0.5, 0.5, viscous=1e6))
    motion = pf.simulate(scene, [0.0], [5.0], [0.0], 100.0, "timestepping", dt=10.0)
    assert (motion.v[1:] == 0).all()
    assert np.isfinite(motion.q).all()


def test_a_start_without_an_acceleration_is_an_impact():
    """Painleve's rod beyond its critical mu stops its slider at once, and swings about it.

    Of the angular momentum about the slider, m v (l/2) sin t = (m l^2 / 3) w remains.
    """
    angle = np.arctan(2.0)
    case = painleve_rod(1.4, angle)
    motion = pf.simulate(
        case.scene, case.q[0], case.v[0], np.zeros(2), 1e-4, "timestepping", dt=1e-5
    )
    assert motion.v[0].tolist() == case.v[0].tolist()
    assert motion.v[-1, 0] == 0.0
    assert motion.v[-1, 1] == pytest.approx(1.5 * np.sin(angle) / 0.6, rel=1e-3)


@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_a_loop_s_pin_that_sticks_keeps_its_angle(speed):
    """From the start, or from where it stops; two arms of two bars meet in it."""
    weak, strong = (dry(f, 0.8 * f) for f in (0.02, 0.5))
    friction = dict.fromkeys(FIVE_BAR, weak) | {"B": strong}
    scene, q = five_bar("B", friction, gravity=(0.0, 0.0, 0.0))
    v = consistent_motion(scene, q[None], ["O", "D"], [[speed, 0.0]], [[0.0, 0.0]])[0][0]
    motion = pf.simulate(scene, q, v, [0.2, 0.15], 0.2, "timestepping", dt=2e-3)
    sticks = motion.modes[:, scene.site_names.index("B")] == 0
    assert sticks[0] == (speed == 0.0)
    assert sticks[50:].all()
    assert scene.joint_names == ("O", "A", "D", "C")
    assert np.ptp(motion.q[sticks] @ [1.0, 1.0, -1.0, -1.0]) < 1e-14
    assert (np.ptp(motion.q[sticks], axis=0) > 0.01).all()


@pytest.mark.parametrize("width", [0.5e-3, 1.4e-3, 2.6e-3])
@pytest.mark.parametrize("table", [False, True])
def test_a_step_ends_where_the_effort_jumps(width, table):
    """A block of 2 kg under a pulse that no step of 1 ms divides: (F / m - mu g) w, then mu g."""
    force, drag = 2000.0, 0.1 * 9.81
    edge = 1e-9  # of the table
    rows = [0.0, width, width + edge], [[force], [force], [0.0]]
    motion = pf.simulate(
        sliding_block(plane_friction(0.2, 0.1)),
        [0.0],
        [0.0],
        rows if table else lambda t, q, v: [force if t < width else 0.0],
        4.0,
        "timestepping",
        dt=1e-3,
        sample_step=0.05,
        **({} if table else {"breakpoints": [width]}),
    )
    speed = (force / 2.0 - drag) * width
    length = 0.5 * speed * width + speed**2 / (2.0 * drag)
    assert motion.q[-1, 0] == pytest.approx(length, abs=drag * 1e-6 + 2.0 * force * edge)
    assert np.diff(motion.t).max() < 0.06
