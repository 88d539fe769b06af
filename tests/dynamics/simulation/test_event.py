"""Events: guards that are restarted on, grazed, met together, or that accumulate."""

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump, plane_friction, random_tree, sliding_block
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from simulation_cases import Belt, G

import pinfric as pf
from pinfric.dynamics.simulation.event import EventIntegration
from pinfric.errors import SimulationError


@cache
def belt_errors() -> dict[float, tuple[float, int]]:
    """rtol -> (error at the end after nine mode changes, right-hand sides)."""
    belt = Belt()
    end = belt.first_slip + 4.8 * belt.period - 0.9 * belt.stick_time
    found = {}
    for rtol in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11):
        m = belt.run(end, rtol=rtol, atol=1e-2 * rtol, sample_step=end, max_step=end)
        assert len(m.events) == 9
        found[rtol] = abs(float(m.q[-1, 0]) - belt.position(end)), m.evaluations
    return found


def test_the_error_of_event_follows_its_tolerance_over_six_decades():
    errors = belt_errors()
    for rtol, (error, _) in errors.items():
        assert error < 2 * rtol
    assert errors[1e-10][0] < 1e-4 * max(errors[1e-4][0], errors[1e-5][0])


def test_the_cost_of_event_is_bounded():
    evaluations = [n for _, n in belt_errors().values()]
    assert max(evaluations[:5]) < 1800
    assert max(evaluations) < 2900


@pytest.mark.parametrize("at", ["stick", "slip"])
def test_restart_exactly_on_a_guard(at):
    belt = Belt()
    end = belt.first_slip + 2.6 * belt.period
    whole = belt.run(end, rtol=1e-10, atol=1e-12)
    event = [e for e in whole.events if e.kind == at][1]
    i = int(whole.t.searchsorted(event.time))
    assert whole.t[i] == event.time
    assert whole.v[i, 0] == 0.0

    def shifted(t, q, v):
        return belt.effort(t + event.time, q, v)

    rest = pf.simulate(
        belt.scene, whole.q[i], whole.v[i], shifted, end - event.time, rtol=1e-10, atol=1e-12
    )
    expected = [e.kind for e in whole.events if e.time > event.time]
    # at break-away the restarted block sticks, to rounding, and then slips
    found = [e for e in rest.events if e.time > 1e-9]
    assert [e.kind for e in found] == expected
    assert len(rest.events) - len(found) <= (at == "slip")
    assert_allclose(rest.q[-1], whole.q[-1], atol=1e-8)


@pytest.mark.parametrize("excess", [-1e-9, 0.0, 1e-9, 1e-6])
def test_an_effort_that_just_reaches_break_away(excess):
    """A ramp up to the static limit, and a plateau there: it sticks up to the limit itself."""
    scene = sliding_block(plane_friction(0.35, 0.3))
    limit = 0.35 * 2 * G
    ramp = [0.0, 1.0, 5.0], [[0.0], [limit * (1 + excess)], [limit * (1 + excess)]]
    motion = pf.simulate(scene, [0.0], [0.0], ramp, 3.0)
    if excess <= 0:
        assert motion.events == ()
        assert (motion.q == 0).all()
    else:
        (event,) = motion.events
        assert event.kind == "slip"
        assert event.time == pytest.approx(1 / (1 + excess), abs=1e-10)
        expected = 0.5 * (0.05 * G) * (3 - event.time) ** 2
        assert motion.q[-1, 0] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("peak", [1 - 1e-7, 1 + 1e-7])
def test_a_peak_of_effort_that_grazes_the_limit_between_two_looks(peak):
    scene = sliding_block(plane_friction(0.35, 0.3))
    limit = 0.35 * 2 * G

    def effort(t, q, v):
        return np.array([limit * (peak - 0.3 * (t - 1.234567) ** 2)])

    motion = pf.simulate(scene, [0.0], [0.0], effort, 2.0)
    assert [e.kind for e in motion.events][:1] == (["slip"] if peak > 1 else [])
    if peak > 1:  # it breaks away before the top by sqrt(1e-7 / 0.3)
        assert motion.events[0].time == pytest.approx(1.234567 - np.sqrt(1e-7 / 0.3), abs=1e-9)


@pytest.mark.parametrize("gap", [1e-6, -1e-6])
def test_a_velocity_that_grazes_zero_between_two_looks(gap):
    """v = (t - 0.777)^2 + gap: it reaches zero, sticks for a moment and goes on, or never does."""
    scene = sliding_block(plane_friction(0.1, 0.1))
    kinetic = 0.1 * 2 * G

    def effort(t, q, v):
        return np.array([kinetic + 2 * 2 * (t - 0.777)])

    v0 = 0.777**2 + gap
    motion = pf.simulate(scene, [0.0], [v0], effort, 1.5, rtol=1e-10, atol=1e-12)
    kinds = [e.kind for e in motion.events]
    assert kinds == ([] if gap > 0 else ["stick", "slip"])
    if gap < 0:
        assert motion.events[0].time == pytest.approx(0.777 - 1e-3, abs=1e-8)
        assert motion.events[1].time == pytest.approx(0.777, abs=1e-8)


def test_events_at_one_instant_are_handled_together():
    blocks = {f"block_{i}": lump(1.0 + i) for i in range(3)}
    model = chain(*((n, pin.JointModelPX(), body) for n, body in blocks.items()), beside=True)
    scene = pf.Scene(model=model, friction=dict.fromkeys(blocks, plane_friction(0.3, 0.3)))
    motion = pf.simulate(scene, np.zeros(3), np.ones(3), np.zeros(3), 1.0)
    times = [e.time for e in motion.events]
    assert [e.kind for e in motion.events] == ["stick"] * 3
    assert_allclose(times, 1 / (0.3 * G), rtol=1e-12)
    assert_allclose(motion.q[-1], 0.5 / (0.3 * G), rtol=1e-9)
    assert motion.evaluations < 2200


def test_events_that_accumulate_end_in_an_error_and_timestepping_passes():
    """An effort that always drives back to zero velocity: any slip ends at once."""
    scene = sliding_block(plane_friction(0.1, 0.1))

    def back(t, q, v):
        return np.array([-10.0 if v[0] > 0 else 10.0])

    with pytest.raises(SimulationError, match=r"accumulate.*timestepping") as error:
        pf.simulate(scene, [0.0], [1.0], back, 2.0)
    stops = 1 / (5.0 + 0.1 * G)
    assert error.value.motion.t[-1] == pytest.approx(stops, abs=1e-6)
    motion = pf.simulate(scene, [0.0], [1.0], back, 2.0, "timestepping", dt=1e-3)
    assert abs(motion.v[-1, 0]) < 0.02
    assert motion.q[-1, 0] == pytest.approx(0.5 * stops, rel=0.02)


def test_an_effort_that_switches_every_millisecond():
    scene = sliding_block(plane_friction(0.1, 0.1))

    breaks = np.arange(1, 100) * 1e-3

    def switching(t, q, v):
        return np.array([30.0 if breaks.searchsorted(t, side="right") % 2 == 0 else -22.0])

    motion = pf.simulate(scene, [0.0], [1.0], switching, 0.1, breakpoints=breaks)
    expected = 1.0 + (30 - 22) / 2 / 2 * 0.1 - 0.1 * G * 0.1
    assert motion.v[-1, 0] == pytest.approx(expected, abs=1e-9)
    assert motion.evaluations < 2750  # 26 a breakpoint, 10 of them samples
    stepped = pf.simulate(scene, [0.0], [1.0], switching, 0.1, "timestepping", dt=1e-4)
    assert stepped.v[-1, 0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("limit", "spin", "part"), [(20.0, 20.0, 0.2), (40.0, 35.0, 0.1)])
def test_a_shorter_max_step_is_no_fewer_looks(limit, spin, part):
    """An unbalanced rotor speeds up on a cart at rest; long steps hold several of its turns."""
    body = lump(0.2, [0.1, 0.0, 0.0], 1e-3)
    model = chain(
        ("cart", pin.JointModelPX(), lump(5.0, moment=1.0)), ("rotor", pin.JointModelRZ(), body)
    )
    friction = {"cart": dry(limit, 0.8 * limit)}
    scene, end, torque = pf.Scene(model=model, friction=friction), 4.0, spin * (1e-3 + 0.2 * 0.01)

    def beyond(t):
        angle = 0.5 * spin * t**2
        push = 0.2 * 0.1 * ((spin * t) ** 2 * np.cos(angle) + spin * np.sin(angle))
        return abs(push) - limit

    t = np.linspace(0.0, end, 100_001)
    i = int(np.argmax(beyond(t) > 0.0))
    expected = brentq(beyond, t[i - 1], t[i], xtol=1e-14)
    for max_step in (None, part * end):
        motion = pf.simulate(scene, [0, 0], [0, 0], [0.0, torque], end, max_step=max_step)
        assert motion.events[0].time == pytest.approx(expected, abs=1e-9)


def test_too_many_events_are_an_error():
    belt = Belt()
    with pytest.raises(SimulationError, match="max_events"):
        belt.run(5 * belt.period, max_events=3)


def test_a_pulse_that_starts_at_a_breakpoint_and_is_gone_at_the_next_look():
    scene = sliding_block(plane_friction(0.35, 0.3))
    limit = 0.35 * 2 * G

    def effort(t, q, v):
        return np.array([1.5 * limit * np.exp(-(t - 0.5) / 1e-3) if t >= 0.5 else 0.0])

    motion = pf.simulate(scene, [0.0], [0.0], effort, 2.0, breakpoints=[0.5])
    assert [e.kind for e in motion.events] == ["slip", "stick"]
    assert motion.events[0].time == 0.5
    assert motion.q[-1, 0] > 0


@pytest.mark.parametrize("rtol", [1e-3, 1e-10])
def test_one_guard_between_looks_is_that_of_all(rtol, monkeypatch):
    """RK45 reads a joint's speed from its polynomial alone; DOP853 takes small tolerances."""
    compared = []
    first_event = EventIntegration._first_event

    def look(self, start, end, polynomial):
        own, self.allowance = self.allowance, np.linspace(0.5, 1.0, self.nc)
        for t in np.linspace(start, end, 4):
            guards = self._guards(np.array([t]), polynomial(t)[None, :])[0] + self.allowance
            mine = [self._guard(c, polynomial)(t) for c in range(self.nc)]
            assert_allclose(mine, guards, rtol=1e-12, atol=1e-12)
            compared.extend(self.given.stuck)
        self.allowance = own
        return first_event(self, start, end, polynomial)

    monkeypatch.setattr(EventIntegration, "_first_event", look)
    model = random_tree(1, 2)
    first, second = list(model.names)[1:]
    friction = {
        first: dry(1e3),
        second: dry(0.2, 0.1),
    }
    scene = pf.Scene(model=model, friction=friction)
    q, v = pin.neutral(model), np.zeros(model.nv)
    v[model.idx_vs[2]] = 1.0
    effort = np.full(model.nv, 0.3)
    pf.simulate(scene, q, v, lambda t, q, v: effort * np.sin(5.0 * t), 1.0, rtol=rtol)
    assert {bool(stuck) for stuck in compared} == {True, False}
