"""Regularized friction: its own error, and creep as predicted."""

from __future__ import annotations

import numpy as np
from builders import block, plane_friction
from simulation_cases import G, arm

import pinfric as pf


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
