"""Simulation against closed forms: stick-slip, spin-down, energy, standstill, guards, orders."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest
from builders import block, plane_friction, random_friction, random_states, random_tree

import pinfric as pf
from pinfric.dynamics.simulation.simulate import _READ, METHODS, Numbers
from pinfric.errors import AmbiguousAcceleration, NoConsistentAcceleration, SimulationError

G = 9.81


# ---------------------------------------------------------------- stick-slip on a belt


class Belt:
    """A block on a moving belt, held by a spring; coordinates relative to the belt.

    From rest on the belt the spring force grows until break-away at mu_s N; the block slips back
    and comes to rest again, always in the same way (closed form; m = 2 kg, load N = m g).
    """

    mass, stiffness, speed, static, kinetic = 2.0, 50.0, 0.4, 0.35, 0.25

    def __init__(self, **more):
        friction = {"slide": plane_friction(self.static, self.kinetic, **more)}
        self.scene = pf.Scene(model=block(0.0, self.mass), friction=friction)
        self.omega = np.sqrt(self.stiffness / self.mass)
        self.holds = self.static * self.mass * G  # force at break-away
        drop = (self.static - self.kinetic) * self.mass * G
        angle = np.arctan(drop * self.omega / (self.stiffness * self.speed))
        self.slip_time = 2 / self.omega * (np.pi - angle)
        self.stick_time = 2 * drop / (self.stiffness * self.speed)
        self.period = self.slip_time + self.stick_time
        # the block starts unstretched and at rest on the belt
        self.first_slip = self.holds / (self.stiffness * self.speed)

    def effort(self, t, q, v):
        """Spring from the ground: the block is at q on a belt that has gone `speed` t."""
        return -self.stiffness * (q + self.speed * t)

    def run(self, t_end, method="event", **options):
        return pf.simulate(self.scene, [0.0], [0.0], self.effort, t_end, method, **options)

    def position(self, t):
        """Relative to the belt, at any time: from the phase of its period."""
        t = t - self.first_slip
        if t <= 0:
            return 0.0
        cycles, t = divmod(t, self.period)
        stretch = self.holds / self.stiffness  # at the start of every slip
        middle = self.kinetic * self.mass * G / self.stiffness
        rest = 2 * middle - stretch
        start = -(self.period * self.speed) * cycles  # the cycle moves with the ground
        if t > self.slip_time:
            return start + rest - stretch - self.speed * self.slip_time
        x = (
            middle
            + (stretch - middle) * np.cos(self.omega * t)
            + self.speed / self.omega * np.sin(self.omega * t)
        )
        return start + x - stretch - self.speed * t


def test_the_belt_sticks_and_slips_by_the_closed_form():
    belt = Belt()
    motion = belt.run(belt.first_slip + 4.5 * belt.period, rtol=1e-11, atol=1e-13)
    assert [e.kind for e in motion.events] == ["slip", "stick"] * 4 + ["slip", "stick"][:1]
    slips = np.array([e.time for e in motion.events if e.kind == "slip"])
    sticks = np.array([e.time for e in motion.events if e.kind == "stick"])
    assert slips[0] == pytest.approx(belt.first_slip, rel=1e-12)
    np.testing.assert_allclose(np.diff(slips), belt.period, rtol=1e-9)
    np.testing.assert_allclose(sticks - slips[:4], belt.slip_time, rtol=1e-9)
    intervals = motion.stick_intervals()
    assert len(intervals) == 5
    np.testing.assert_allclose([i.end - i.start for i in intervals[1:]], belt.stick_time, rtol=1e-8)
    expected = [belt.position(t) for t in motion.t]
    np.testing.assert_allclose(motion.q[:, 0], expected, atol=1e-9)


def test_samples_of_a_stick_are_at_rest_exactly_and_inverse_dynamics_sees_them():
    belt = Belt()
    motion = belt.run(3 * belt.period)
    stuck = motion.modes[:, 0] == 0
    assert (motion.v[stuck] == 0).all()
    assert (motion.a[stuck] == 0).all()
    assert 100 < stuck.sum() < 900
    inverse = pf.inverse_dynamics(belt.scene, motion)
    assert inverse.sticking[stuck, 0].all()
    assert (inverse.effort_lower <= motion.effort + 1e-9).all()
    assert (inverse.effort_upper >= motion.effort - 1e-9).all()
    slides = ~inverse.sticking[:, 0] & ~inverse.reversal[:, 0]
    np.testing.assert_allclose(inverse.effort_lower[slides], motion.effort[slides], atol=1e-10)
    assert inverse.check().passed()


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


def test_regularized_follows_the_belt_with_an_error_of_its_own():
    """Without a static peak (static = kinetic) it comes as near as its velocity lets it."""
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.3, 0.3)})

    def effort(t, q, v):
        return np.array([8.0 * np.sin(3 * t)])

    exact = pf.simulate(scene, [0.0], [0.0], effort, 3.0, rtol=1e-10)
    near = pf.simulate(scene, [0.0], [0.0], effort, 3.0, "regularized")
    nearer = pf.simulate(
        scene, [0.0], [0.0], effort, 3.0, "regularized", regularization_velocity=1e-5
    )
    errors = [abs(m.q[-1, 0] - exact.q[-1, 0]) for m in (near, nearer)]
    assert 1e-6 < errors[0] < 1e-2
    assert errors[1] < 0.1 * errors[0]


# ---------------------------------------------------------------- spin-down and Painleve


def pinned_body(b: float) -> pf.Scene:
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "pin")
    body = pin.Inertia(1.0, np.array([1.0, 0, 0]), np.zeros((3, 3)))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return pf.Scene(
        model=model,
        friction={
            "pin": {"bearing": {"kind": "pin", "radius": 1.0}, "mu": {"static": b, "kinetic": b}}
        },
    )


@pytest.mark.parametrize("b", [0.2, 0.8, 0.999])
def test_spin_down_by_the_closed_form(b):
    k, v0 = b / np.sqrt(1 - b**2), 3.0
    motion = pf.simulate(pinned_body(b), [0.0], [v0], [0.0], 2.0, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(motion.v[:, 0], v0 / (1 + k * v0 * motion.t), rtol=1e-8)
    np.testing.assert_allclose(motion.q[:, 0], np.log1p(k * v0 * motion.t) / k, rtol=1e-8)
    assert motion.events == ()  # it never comes to rest
    assert motion.evaluations < 3000


def test_beyond_the_threshold_the_spinning_body_cannot_even_start():
    with pytest.raises(NoConsistentAcceleration, match="t = 0 s") as error:
        pf.simulate(pinned_body(1.0 + 1e-9), [0.0], [3.0], [0.0], 1.0)
    assert error.value.time == 0.0
    assert error.value.motion is None


def test_a_motion_that_runs_into_an_inconsistency_says_when_and_keeps_what_it_had():
    """A driven slider carries the pinned mass inward: b = mu R m l / (J + m l^2) grows to 1."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "pin")
    model.appendBodyToJoint(
        joint, pin.Inertia(1e-9, np.zeros(3), np.diag([1.0, 1, 1.0])), pin.SE3.Identity()
    )
    slide = model.addJoint(joint, pin.JointModelPX(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(
        slide, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity()
    )
    mu_radius = 2.2
    friction = {
        "pin": {
            "bearing": {"kind": "pin", "radius": mu_radius / 2.0},
            "mu": {"static": 2.0, "kinetic": 2.0},
        }
    }
    with pytest.warns(pf.PinfricWarning, match="radius"):
        scene = pf.Scene(model=model, friction=friction)

    def hold(t, q, v):  # the slider moves inward steadily whatever the centrifugal force
        return np.array([0.0, -(v[0] ** 2) * q[1]])

    with pytest.raises(NoConsistentAcceleration) as error:
        pf.simulate(scene, [0.0, 2.0], [1e-3, -0.1], hold, 20.0)
    reached = error.value.motion
    assert reached.status == "failed"
    assert 4.0 < reached.t[-1] <= error.value.time < 5.0
    l_end = error.value.q[1]
    assert mu_radius * l_end / (1 + l_end**2) == pytest.approx(1.0, abs=1e-6)


# ---------------------------------------------------------------- energy


@pytest.mark.parametrize("seed", [1, 2, 5, 6, 8, 9])
def test_energy_is_balanced_on_random_trees(seed):
    model = random_tree(seed, 4)
    friction = random_friction(model, seed)
    for entry in friction.values():
        entry["mu"] = {key: 0.1 * value for key, value in entry["mu"].items()}
    scene = pf.Scene(model=model, friction=friction)
    q, v, u = random_states(model, seed, 1)
    motion = pf.simulate(
        scene, q[0], v[0], lambda t, q, v: u[0] * np.cos(4 * t), 1.0, rtol=1e-9, atol=1e-11
    )
    energy = motion.energy()
    assert (energy.friction_loss >= -1e-12).all()
    assert energy.friction_loss.sum() > 0.05
    assert abs(energy.residual) < 1e-6 * (abs(energy.work) + energy.friction_loss.sum())


def test_a_free_body_keeps_its_momentum_and_energy():
    """A tumbling free-flyer: the chart has to move along many times."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    body = pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
    model.appendBodyToJoint(base, body, pin.SE3.Identity())
    scene = pf.Scene(model=model)
    q0, v0 = pin.neutral(model), np.array([0.3, -0.2, 0.1, 1.0, 4.0, 0.5])
    motion = pf.simulate(scene, q0, v0, np.zeros(6), 5.0, rtol=1e-10, atol=1e-12)
    data = model.createData()
    momenta = []
    for q, v in zip(motion.q, motion.v, strict=True):
        pin.computeCentroidalMomentum(model, data, q, v)
        momenta.append(data.oMi[1].act(model.inertias[1] * pin.Motion(v)).vector)
    np.testing.assert_allclose(momenta, np.tile(momenta[0], (len(momenta), 1)), atol=1e-7)
    assert abs(motion.energy().residual) < 1e-8
    np.testing.assert_allclose(np.linalg.norm(motion.q[:, 3:], axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("joint", [pin.JointModelPlanar, pin.JointModelSpherical])
def test_joints_of_many_degrees_keep_their_energy(joint):
    model = pin.Model()
    index = model.addJoint(0, joint(), pin.SE3.Identity(), "base")
    body = pin.Inertia(2.0, np.array([0.1, 0.2, 0.0]), np.diag([0.1, 0.2, 0.25]))
    model.appendBodyToJoint(index, body, pin.SE3.Identity())
    scene = pf.Scene(model=model)
    motion = pf.simulate(
        scene,
        pin.neutral(model),
        np.array([2.0, -1.0, 3.0]),
        np.zeros(3),
        3.0,
        rtol=1e-10,
        atol=1e-12,
    )
    assert abs(motion.energy().residual) < 1e-8
    stepped = pf.simulate(
        scene,
        pin.neutral(model),
        np.array([2.0, -1.0, 3.0]),
        np.zeros(3),
        1.0,
        "timestepping",
        dt=2e-4,
    )
    at_one = motion.sample([1.0])
    np.testing.assert_allclose(stepped.q[-1], at_one.q[0], atol=5e-3)


def test_a_continuous_joint_moves_like_a_revolute_one():
    def pendulum(kind):
        model = pin.Model()
        joint = model.addJoint(0, kind(), pin.SE3.Identity(), "pin")
        body = pin.Inertia(1.0, np.array([0, 0.3, 0.2]), 0.01 * np.eye(3))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        return pf.Scene(
            model=model,
            friction={
                "pin": {
                    "bearing": {"kind": "pin", "radius": 0.05},
                    "mu": {"static": 0.3, "kinetic": 0.25},
                }
            },
        )

    fine = {"rtol": 1e-10, "atol": 1e-12}
    turns = pf.simulate(pendulum(pin.JointModelRX), [0.5], [9.0], [0.0], 4.0, **fine)
    start = [np.cos(0.5), np.sin(0.5)]
    circle = pf.simulate(pendulum(pin.JointModelRUBX), start, [9.0], [0.0], 4.0, **fine)
    assert turns.q[:, 0].max() > 2 * np.pi  # it goes over the top
    assert [e.kind for e in turns.events] == [e.kind for e in circle.events]
    np.testing.assert_allclose([e.time for e in turns.events], [e.time for e in circle.events])
    common = np.linspace(0, 4, 101)
    a, b = turns.sample(common), circle.sample(common)
    np.testing.assert_allclose(np.cos(a.q[:, 0]), b.q[:, 0], atol=1e-7)
    np.testing.assert_allclose(a.v, b.v, atol=1e-7)


# ---------------------------------------------------------------- standstill


def arm() -> pf.Scene:
    """Two links under gravity, horizontal, held by the static friction of their pins."""
    model = pin.Model()
    parent, placement = 0, pin.SE3.Identity()
    friction = {}
    for i in range(2):
        parent = model.addJoint(parent, pin.JointModelRY(), placement, f"pin_{i}")
        body = pin.Inertia(1.0, np.array([0.1, 0, 0]), 0.01 * np.eye(3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        placement = pin.SE3(np.eye(3), np.array([0.2, 0, 0]))
        friction[f"pin_{i}"] = {
            "bearing": {"kind": "pin", "radius": 0.05, "preload": 500.0},
            "mu": {"static": 0.25, "kinetic": 0.2},
        }
    return pf.Scene(model=model, friction=friction)


@pytest.mark.parametrize(("method", "options"), [("event", {}), ("timestepping", {"dt": 0.05})])
def test_an_arm_held_by_static_friction_stays_exactly_for_100_s(method, options):
    motion = pf.simulate(arm(), [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], 100.0, method, **options)
    assert (motion.q == 0).all()
    assert (motion.v == 0).all()
    assert [(i.start, i.end) for i in motion.stick_intervals()] == [(0.0, 100.0)] * 2
    assert motion.evaluations < 4100


def test_regularized_creeps_as_predicted():
    """v = velocity artanh(torque / limit) while the arm has hardly moved."""
    scene = arm()
    velocity = 1e-6
    motion = pf.simulate(
        scene,
        [0.0, 0.0],
        [0.0, 0.0],
        [0.0, 0.0],
        100.0,
        "regularized",
        regularization_velocity=velocity,
    )
    torque = np.array([G * 0.1 + G * 0.3, G * 0.1])  # of both links, of the second one
    limit = 0.2 * 0.05 * (np.array([2 * G, G]) + 500)
    speed = velocity * np.arctanh(torque / limit)
    np.testing.assert_allclose(motion.q[-1], 100 * speed, rtol=1e-3)
    assert (motion.q[-1] > 1e-5).all()


def test_timestepping_is_stable_at_any_step():
    """One step of 10 s with friction far beyond what explicit friction would survive."""
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.5, 0.5, viscous=1e6)})
    motion = pf.simulate(scene, [0.0], [5.0], [0.0], 100.0, "timestepping", dt=10.0)
    assert (motion.v[1:] == 0).all()
    assert np.isfinite(motion.q).all()


# ---------------------------------------------------------------- guards


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
    np.testing.assert_allclose(rest.q[-1], whole.q[-1], atol=1e-8)


@pytest.mark.parametrize("excess", [-1e-9, 0.0, 1e-9, 1e-6])
def test_an_effort_that_just_reaches_break_away(excess):
    """A ramp up to the static limit, and a plateau there: it sticks up to the limit itself."""
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.35, 0.3)})
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
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.35, 0.3)})
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
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.1, 0.1)})
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
    model = pin.Model()
    for i in range(3):
        joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), f"block_{i}")
        model.appendBodyToJoint(
            joint, pin.Inertia(1.0 + i, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity()
        )
    scene = pf.Scene(
        model=model, friction={f"block_{i}": plane_friction(0.3, 0.3) for i in range(3)}
    )
    motion = pf.simulate(scene, np.zeros(3), np.ones(3), np.zeros(3), 1.0)
    times = [e.time for e in motion.events]
    assert [e.kind for e in motion.events] == ["stick"] * 3
    np.testing.assert_allclose(times, 1 / (0.3 * G), rtol=1e-12)
    np.testing.assert_allclose(motion.q[-1], 0.5 / (0.3 * G), rtol=1e-9)
    assert motion.evaluations < 2200


def test_events_that_accumulate_end_in_an_error_and_timestepping_passes():
    """An effort that always drives back to zero velocity: any slip ends at once."""
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.1, 0.1)})

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
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.1, 0.1)})

    breaks = np.arange(1, 100) * 1e-3

    def switching(t, q, v):
        return np.array([30.0 if breaks.searchsorted(t, side="right") % 2 == 0 else -22.0])

    motion = pf.simulate(scene, [0.0], [1.0], switching, 0.1, breakpoints=breaks)
    expected = 1.0 + (30 - 22) / 2 / 2 * 0.1 - 0.1 * G * 0.1
    assert motion.v[-1, 0] == pytest.approx(expected, abs=1e-9)
    assert motion.evaluations < 2750  # 26 a breakpoint, 10 of them samples
    stepped = pf.simulate(scene, [0.0], [1.0], switching, 0.1, "timestepping", dt=1e-4)
    assert stepped.v[-1, 0] == pytest.approx(expected, abs=1e-9)


def test_too_many_events_are_an_error():
    belt = Belt()
    with pytest.raises(SimulationError, match="max_events"):
        belt.run(5 * belt.period, max_events=3)


# ---------------------------------------------------------------- the paper's examples


def test_the_paper_s_pendulum_sticks_when_it_should():
    scene = pf.load_scene("pendulum")
    motion = pf.simulate(scene, [0.524], [1.0], None, 2.0)
    (interval,) = motion.stick_intervals()
    assert 1.060 <= interval.start <= 1.072
    assert 1.208 <= interval.end <= 1.216
    assert motion.evaluations < 2500


def test_the_paper_s_robot_sticks_when_it_should_and_its_efforts_are_recovered():
    scene = pf.load_scene("three_link")
    motion = pf.simulate(scene, np.zeros(3), [1.0, -1.0, 1.0], None, 1.0)
    (interval,) = motion.stick_intervals()
    assert 0.515 <= interval.start <= 0.523
    assert 0.555 <= interval.end <= 0.561
    inverse = pf.inverse_dynamics(scene, motion)
    stuck = motion.modes[:, 0] == 0
    assert (inverse.effort_lower <= motion.effort + 1e-9).all()
    assert (inverse.effort_upper >= motion.effort - 1e-9).all()
    slides = ~inverse.sticking[:, 0] & ~inverse.reversal[:, 0]
    np.testing.assert_allclose(inverse.effort_lower[slides], motion.effort[slides], atol=1e-9)
    width = inverse.effort_upper[stuck, 1] - inverse.effort_lower[stuck, 1]
    np.testing.assert_allclose(width, 2 * 0.35 * inverse.normal_load[stuck, 0], rtol=1e-12)
    assert motion.evaluations < 2500


def test_all_three_methods_agree_on_the_paper_s_robot():
    scene = pf.load_scene("three_link")
    q0, v0 = np.zeros(3), [1.0, -1.0, 1.0]
    exact = pf.simulate(scene, q0, v0, None, 1.0, rtol=1e-10)
    stepped = pf.simulate(scene, q0, v0, None, 1.0, "timestepping", dt=2.5e-4, sample_step=0.01)
    smooth = pf.simulate(scene, q0, v0, None, 1.0, "regularized", sample_step=0.01)
    np.testing.assert_allclose(stepped.q[-1], exact.q[-1], atol=0.02)
    np.testing.assert_allclose(smooth.q[-1], exact.q[-1], atol=0.02)
    assert np.abs(stepped.q[-1] - exact.q[-1]).max() > 1e-6


def test_a_joint_that_comes_to_rest_leaves_what_sticks_alone():
    """Either joint could slip at that instant; the one that has been sticking sticks on."""
    scene = pf.load_scene("three_link")
    radii, lengths = (0.05, 0.08, 0.03), (0.12, 0.10, None)
    static, kinetic = (0.3, 0.35, 0.25), (0.25, 0.30, 0.2)
    friction = {}
    for i, name in enumerate(scene.joint_names):
        bearing = {"kind": "pin", "radius": radii[i]}
        if lengths[i]:
            bearing["length"] = lengths[i]
        mu = {"static": static[i], "kinetic": kinetic[i]}
        friction[name] = {"bearing": bearing, "mu": mu}
    scene = pf.Scene(model=scene.model, friction=friction)
    q0 = np.array([0.1, -0.3, 0.2])
    hold = pin.rnea(scene.model, scene.model.createData(), q0, np.zeros(3), np.zeros(3))

    def effort(t, q, v):
        return hold + np.array([5 * np.sin(9 * t), 2 * np.cos(7 * t), 0.12 * np.sin(11 * t)])

    motion = pf.simulate(scene, q0, [0.05, 0.0, -0.1], effort, 0.6)
    event = motion.events[-1]
    assert (event.name, event.kind) == ("joint_1", "reversal")
    i = int(motion.t.searchsorted(event.time))
    assert motion.modes[i - 1 : i + 1, 1].tolist() == [0, 0]
    with pytest.raises(AmbiguousAcceleration, match="several"):  # the instant alone cannot tell
        pf.forward_dynamics(scene, motion.q[i], motion.v[i], motion.effort[i])


def test_a_pulse_that_starts_at_a_breakpoint_and_is_gone_at_the_next_look():
    scene = pf.Scene(model=block(0.0), friction={"slide": plane_friction(0.35, 0.3)})
    limit = 0.35 * 2 * G

    def effort(t, q, v):
        return np.array([1.5 * limit * np.exp(-(t - 0.5) / 1e-3) if t >= 0.5 else 0.0])

    motion = pf.simulate(scene, [0.0], [0.0], effort, 2.0, breakpoints=[0.5])
    assert [e.kind for e in motion.events] == ["slip", "stick"]
    assert motion.events[0].time == 0.5
    assert motion.q[-1, 0] > 0


def test_what_balances_to_rounding_stays_where_friction_is_next_to_nothing():
    """The effort misses the weight by rounding, and the limit is smaller still."""
    model = block(0.4, 3.7)
    weight = pin.rnea(model, model.createData(), np.zeros(1), np.zeros(1), np.zeros(1))
    friction = {"slide": {"coulomb": {"static": 1e-16, "kinetic": 1e-16}}}
    scene = pf.Scene(model=model, friction=friction)
    for effort in (np.nextafter(weight, 0.0), weight, np.nextafter(weight, -100.0)):
        motion = pf.simulate(scene, [0.0], [0.0], effort, 5.0)
        assert motion.events == ()
        assert (motion.q == 0).all()
        assert motion.evaluations < 2300


def test_what_overflows_in_the_integrator_is_no_warning_of_its_own():
    """A block of 1e-300 kg: accelerations are numbers, their squares in SciPy's norms are none."""
    scene = pf.Scene(model=block(0.0, 1e-300), friction={"slide": plane_friction(0.1, 0.1)})

    def effort(t, q, v):
        return [28.0 * np.sin(6.0 * t)]

    assert np.isfinite(pf.simulate(scene, [0.0], [0.0], effort, 0.03).q).all()
    with pytest.raises(SimulationError, match="t = 0 s the integration fails: values are too"):
        pf.simulate(scene, [0.0], [0.0], effort, 0.03, "regularized")


@pytest.mark.parametrize(
    ("method", "number", "text"),
    [
        ("event", {"dt": 1e-3}, "dt = 0.001: is for timestepping; event takes rtol, atol"),
        ("timestepping", {"rtol": 1e-6}, "is for event and regularized; timestepping takes dt"),
        ("timestepping", {"max_step": 0.1}, "max_step = 0.1: is for event and regularized"),
        ("regularized", {"max_events": 5}, "max_events = 5: is for event;"),
        ("event", {"regularization_velocity": 1e-3}, "is for regularized;"),
    ],
)
def test_a_number_that_the_method_would_ignore_is_refused(method, number, text):
    """Whoever gives a step expects that the error follows it."""
    with pytest.raises(SimulationError) as caught:
        pf.simulate(pf.load_scene("pendulum"), [0.0], [0.0], [0.0], 0.01, method, **number)
    assert text in str(caught.value)


def test_every_number_is_read_by_a_method():
    """One that is None is not given."""
    assert {name for names in _READ.values() for name in names} == set(Numbers.__annotations__)
    assert set(_READ) == set(METHODS)
    scene = pf.load_scene("pendulum")
    motion = pf.simulate(scene, [0.0], [0.0], [0.0], 0.01, "timestepping", dt=1e-3, max_step=None)
    assert len(motion.t) == 11  # dt is the step


@pytest.mark.parametrize("method", ["event", "regularized"])
def test_an_effort_too_fast_for_any_run_is_refused(method):
    """28 million periods: it would be integrated for hours."""
    scene = pf.load_scene("pendulum")
    fast = {"effort": {"joint_1": {"sine": {"amplitude": 2.0, "angular_frequency": 6e9}}}}
    start = scene.simulation.model_dump() | fast
    with pytest.raises(
        SimulationError, match=r"efforts that change within 1\.66667e-10 s: 1\.8e\+08"
    ):
        pf.run_scene(scene.with_(simulation=start), t_end=0.03, method=method)
    with pytest.raises(SimulationError, match="max_step = 1e-10 s: 3e"):
        pf.simulate(scene, [0.0], [0.0], [0.0], 0.03, method, max_step=1e-10)
