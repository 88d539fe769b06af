"""Derivatives by parameters against differences between changed scenes."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import random_states
from dynamics.derivatives.test_derivatives import scene_of

import pinfric as pf
from pinfric.errors import StateError

NAMES = ["mu.static", "mu.kinetic", "coulomb.kinetic", "coulomb.positive.kinetic", "viscous"]


def ends_of(scene, state):
    found = scene.solver().inverse(*state)
    return np.array([found.effort_lower, found.effort_upper])


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("seed", [2, 5])
def test_coefficients_against_another_scene(seed, moving):
    """Static ones grow and kinetic ones shrink, so that static stays the larger."""
    scene = scene_of(seed)
    state = [x[0] for x in random_states(scene.model, seed, 1)]
    state[1] *= moving
    found = scene.solver().parameter_derivatives(*state, NAMES)
    before = ends_of(scene, state)
    for k, name in enumerate(found.names):
        joint, *path = name.split(".")
        entry = scene.friction[joint].model_dump(exclude_none=True)
        at = entry
        path = [*path, "coefficient"] if path == ["viscous"] else path
        for word in path[:-1]:
            at = at[word]
        step = -0.3 * at[path[-1]] if path[-1] == "kinetic" else 0.1
        at[path[-1]] += step
        after = ends_of(scene.with_(friction={**scene.friction, joint: entry}), state)
        one = np.array([found.effort_lower[:, k], found.effort_upper[:, k]])
        scale = np.abs(before).max()
        np.testing.assert_allclose(step * one, after - before, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("seed", [0, 1])
def test_inertias_against_differences(seed):
    scene = scene_of(seed)
    state = [x[0] for x in random_states(scene.model, seed, 1)]
    found = scene.solver().parameter_derivatives(*state, ["inertia"])

    def at(k, h):
        model = scene.model.copy()
        theta = model.inertias[1 + k // 10].toDynamicParameters()
        theta[k % 10] += h
        model.inertias[1 + k // 10] = pin.Inertia.FromDynamicParameters(theta)
        return ends_of(scene.with_(model=model), state)

    for k in range(0, len(found.names), 7):
        near, far = ((at(k, h) - at(k, -h)) / (2 * h) for h in (1e-4, 2e-4))
        one = np.array([found.effort_lower[:, k], found.effort_upper[:, k]])
        atol = 1e-8 * max(1.0, np.abs(one).max())
        np.testing.assert_allclose(one, (4 * near - far) / 3, rtol=0, atol=atol)


def test_an_unknown_coefficient_is_refused():
    solver = pf.load_scene("pendulum").solver()
    with pytest.raises(StateError, match=r"no friction has 'mu\.size'"):
        solver.parameter_derivatives([0.0], [1.0], [0.0], ["mu.size"])
