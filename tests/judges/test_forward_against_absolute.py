"""Forward dynamics and simulation against the paper's equations in absolute coordinates.

No code is shared: eq. (3) with multipliers, constraint addition-deletion, its own guards.
"""

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from paper_cases import three_pins

import pinfric as pf
from pinfric.errors import AccelerationError
from pinfric.paper import examples
from pinfric.paper.forward import NoConsistentFriction, forward
from pinfric.paper.simulate import simulate


def gravity_torque(scene, q):
    return pin.rnea(scene.model, scene.model.createData(), q, np.zeros(3), np.zeros(3))


def efforts(scene, rng, q):
    """Some that hold the robot at rest, some that move it, some that throw it about."""
    return gravity_torque(scene, q) + rng.uniform(-1, 1, 3) * rng.choice([0.02, 1.0, 60.0])


@pytest.mark.parametrize("seed", range(40))
def test_one_instant(seed):
    scene, mechanism = three_pins()
    rng = np.random.default_rng(seed)
    q, v = rng.uniform(-2, 2, 3), rng.uniform(-2, 2, 3)
    v[rng.random(3) < 0.6] = 0.0
    u = efforts(scene, rng, q)
    try:
        judge = forward(mechanism, q, v, u)
    except NoConsistentFriction:
        with pytest.raises(AccelerationError):
            pf.forward_dynamics(scene, q, v, u)
        return
    ours = pf.forward_dynamics(scene, q, v, u)
    assert ours.modes.tolist() == judge.modes.tolist()
    scale = max(1.0, np.abs(judge.acceleration).max(), np.abs(judge.wrench).max())
    assert_allclose(ours.a, judge.acceleration, atol=1e-9 * scale)
    assert_allclose(ours.friction, judge.friction, atol=1e-9 * scale)
    assert_allclose(ours.normal_load, judge.normal_load, atol=1e-9 * scale)
    assert_allclose(ours.wrench, judge.wrench, atol=1e-9 * scale)


def test_the_instants_above_are_of_every_kind():
    scene, _ = three_pins()
    seen = set()
    for seed in range(40):
        rng = np.random.default_rng(seed)
        q, v = rng.uniform(-2, 2, 3), rng.uniform(-2, 2, 3)
        v[rng.random(3) < 0.6] = 0.0
        u = efforts(scene, rng, q)
        instant = pf.forward_dynamics(scene, q, v, u)
        seen.add((int((v == 0).sum()), int((instant.modes == 0).sum())))
    assert {(3, 3), (2, 1), (2, 0), (1, 0), (1, 1), (0, 0)} <= seen


@pytest.mark.parametrize("name", ["pendulum", "three_link"])
def test_the_paper_s_examples(name):
    example = getattr(examples, name)()
    end = 1.3 if name == "pendulum" else 0.7
    start = example.position, example.rate
    judge = simulate(example.mechanism, *start, example.effort, end, sample_step=0.1)
    motion = pf.simulate(pf.load_scene(name), *start, None, end, rtol=1e-10, atol=1e-12)
    site = motion.site_names[0]
    (interval,), (expected,) = motion.stick_intervals(), judge.stick_intervals(site)
    assert (interval.start, interval.end) == pytest.approx(expected, abs=1e-9)
    for t in np.linspace(0, end, 9)[1:-1]:
        angle, rate, instant = judge.sample(t)
        ours = motion.sample([t])
        assert_allclose(ours.q[0], angle, atol=1e-8)
        assert_allclose(ours.v[0], rate, atol=1e-8)
        assert_allclose(ours.a[0], instant.acceleration, atol=1e-7)


def test_friction_in_every_joint_through_several_sticks():
    scene, mechanism = three_pins(static=(0.3, 0.35, 0.25))

    start = np.array([0.1, -0.3, 0.2]), np.array([0.05, 0.0, -0.1])
    hold = gravity_torque(scene, start[0])

    def effort(t):
        return hold + np.array([4 * np.sin(9 * t), 2 * np.cos(7 * t), 0.1 * np.sin(11 * t)])

    judge = simulate(mechanism, *start, effort, 1.0, sample_step=0.1)
    motion = pf.simulate(scene, *start, lambda t, q, v: effort(t), 1.0, rtol=1e-10, atol=1e-12)
    kinds = [(e.kind, e.name) for e in motion.events]
    assert len(kinds) == 14
    # where joint_1 comes to rest the load in joint_12 jumps, and it breaks away at that instant
    assert motion.events[5].time == motion.events[6].time
    assert kinds[5:7] == [("stick", "joint_1"), ("slip", "joint_12")]
    pairs = zip(scene.site_names, mechanism.joints, strict=True)
    for site, joint in pairs:
        ours = [(i.start, i.end) for i in motion.stick_intervals() if i.site == site]
        assert_allclose(ours, judge.stick_intervals(joint.name), atol=1e-8)
    angle, rate, _ = judge.sample(1.0)
    assert_allclose(motion.q[-1], angle, atol=1e-7)
    assert_allclose(motion.v[-1], rate, atol=1e-7)
