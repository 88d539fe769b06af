"""Time steps with impulses: order, events within a step, stability."""

from __future__ import annotations

import numpy as np
from builders import block, plane_friction
from simulation_cases import Belt

import pinfric as pf


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
    np.testing.assert_allclose(slips, belt.first_slip + belt.period * np.arange(4), atol=5 * dt)
    stuck = motion.modes[:, 0] == 0
    assert (motion.v[stuck] == 0).all()
    expected = [belt.position(t) for t in motion.t]
    np.testing.assert_allclose(motion.q[:, 0], expected, atol=5 * dt)


def test_timestepping_is_stable_at_any_step():
    """One step of 10 s with friction far beyond what explicit friction would survive."""
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.5, 0.5, viscous=1e6)})
    motion = pf.simulate(scene, [0.0], [5.0], [0.0], 100.0, "timestepping", dt=10.0)
    assert (motion.v[1:] == 0).all()
    assert np.isfinite(motion.q).all()
