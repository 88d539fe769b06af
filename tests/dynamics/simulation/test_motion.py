"""Use of simulate: efforts of every kind, bad input, interruption, limits, files, sampling."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import random_states, random_tree, sliding_block
from numpy.testing import assert_allclose, assert_array_equal
from simulation_cases import slope, swing

import pinfric as pf
from pinfric.dynamics.simulation.motion import Dense, mechanical_energy
from pinfric.errors import StateError


def test_dense_sampling_agrees_with_the_samples():
    fine, coarse = swing(), swing(sample_step=2.0)
    times = fine.t[1:-1:7]
    dense = coarse.sample(times)
    assert_allclose(dense.q, fine.q[1:-1:7], atol=1e-9)
    assert_allclose(dense.a, fine.a[1:-1:7], atol=1e-7)
    assert_array_equal(dense.modes, fine.modes[1:-1:7])
    assert (dense.v[dense.modes[:, 0] == 0] == 0).all()
    inverse = pf.inverse_dynamics(coarse.scene, dense)
    assert (inverse.effort_lower <= dense.effort + 1e-9).all()
    assert (inverse.effort_upper >= dense.effort - 1e-9).all()
    part = fine.sample(np.linspace(0.7, 1.1, 5)).energy()
    assert part.work != pytest.approx(fine.energy().work, rel=0.1)
    assert abs(part.residual) < 1e-7
    for bad in ([-0.1], [2.1], [1.0, 1.0]):
        with pytest.raises(StateError):
            coarse.sample(bad)
    with pytest.raises(StateError, match="timestepping"):
        swing("timestepping").sample([1.0])


def test_efforts_between_samples_are_those_of_their_own_piece():
    """A sine with breakpoints that change nothing: sampled anywhere, the sine; and no energy lost.

    At a breakpoint the function is asked on the side that the samples are on.
    """
    breaks = [0.3, 0.5, 1.0]
    scene = sliding_block()
    motion = pf.simulate(
        scene, [0.0], [0.0], lambda t, q, v: [np.sin(10 * t)], 1.0, breakpoints=breaks
    )
    t = np.linspace(0.0, 1.0, 101)
    sampled = motion.sample(t)
    assert_allclose(sampled.effort[:, 0], np.sin(10 * t), atol=1e-10)
    mass = scene.model.inertias[1].mass
    velocity = (1 - np.cos(10 * t)) / (10 * mass)
    assert_allclose(sampled.v[:, 0], velocity, atol=1e-9)
    energy = motion.energy()
    assert energy.work == pytest.approx(0.5 * mass * velocity[-1] ** 2, rel=1e-8)
    assert abs(energy.residual) < 1e-9 * abs(energy.work)
    step = pf.simulate(
        scene, [0.0], [0.0], lambda t, q, v: [float(t > 0.5)], 1.0, breakpoints=[0.5]
    )
    assert step.sample([0.25, 0.5, 0.75]).effort[:, 0].tolist() == [0.0, 1.0, 1.0]


@pytest.mark.parametrize(("efficiency", "parts", "left"), [(1.0, 1, 1e-9), (0.8, 40, 1e-4)])
def test_energy_halves_steps_where_a_lossy_gears_effort_changes_its_sign(
    efficiency, parts, left, monkeypatch
):
    """An ideal gear loses nothing on either side, so no step is halved."""
    drive = {
        "joint": "slide",
        "transmission": {
            "ratio": 10.0,
            "efficiency": efficiency,
            "back_efficiency": 2 - 1 / efficiency,
        },
    }
    scene = sliding_block(actuators=[drive])
    motion = pf.simulate(
        scene, [0.0], [1.0], t_end=1.0, motor_torque={"slide": lambda t: 0.01 * np.sin(10 * t)}
    )
    asked = []
    sample = Dense.sample
    monkeypatch.setattr(Dense, "sample", lambda *of: asked.append(of) or sample(*of))
    energy = motion.energy()
    assert abs(energy.residual) < left * abs(energy.work)
    steps = len(motion.dense.t) - 1
    assert steps <= len(asked) <= parts * steps


def test_energy_ends_where_a_gears_effort_is_rounding(monkeypatch):
    """Noise around zero changes its sign in every part of a step."""
    drive = {
        "joint": "slide",
        "transmission": {"ratio": 10.0, "efficiency": 0.8, "back_efficiency": 0.75},
    }
    scene = sliding_block(actuators=[drive])
    motion = pf.simulate(scene, [0.0], [1.0], t_end=0.1, motor_torque=[0.01])
    sample, rng, asked = Dense.sample, np.random.default_rng(0), []

    def noisy(self, motion, times):
        asked.append(times)
        assert len(asked) < 1000
        part = sample(self, motion, times)
        return replace(part, effort=1e-17 * rng.normal(size=part.effort.shape))

    monkeypatch.setattr(Dense, "sample", noisy)
    motion.energy()


def test_energy_of_every_method():
    exact = swing(rtol=1e-10, atol=1e-12)
    energy = exact.energy()
    assert abs(energy.residual) < 1e-9
    assert energy.work == pytest.approx(energy.change + energy.friction_loss.sum(), abs=1e-9)
    for method in ("timestepping", "regularized"):
        other = swing(method).energy()
        assert abs(other.residual) < 5e-3 * energy.work
        assert other.work == pytest.approx(energy.work, rel=0.3)


@pytest.mark.parametrize("seed", [3, 5])
def test_the_energy_with_a_mimic_joint_is_that_of_the_joints_apart(seed):
    """Their joints are not numbered depth first, as Pinocchio's `crba` assumes."""
    model = random_tree(seed, 5, sliding=0.0)
    mimic = pin.transformJointIntoMimic(model, 1, 5, -0.7, 0.1)
    (q,), (v,), _ = random_states(mimic, seed, 1)
    apart = np.append(q, -0.7 * q[0] + 0.1), np.append(v, -0.7 * v[0])
    data = model.createData()
    wanted = pin.computeKineticEnergy(model, data, *apart)
    wanted += pin.computePotentialEnergy(model, data, apart[0])
    assert mechanical_energy(mimic, mimic.createData(), q, v) == pytest.approx(wanted, rel=1e-12)


def test_repr_names_events_and_sticks_or_says_that_there_are_none():
    swinging = repr(swing())
    assert "events  3 slips, 2 sticks\n" in swinging
    assert "sticks  3: slide 0-0.1782 s, " in swinging  # 9 sin(4 t) = 0.3 * 2 * 9.81
    falling = repr(pf.simulate(slope(0.5), [0.0], [1.0], [0.0], 0.1))
    assert "sticks  none\n  events  none\n" in falling
