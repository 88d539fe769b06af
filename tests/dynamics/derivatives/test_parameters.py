"""Derivatives by parameters against differences between changed scenes."""

import numpy as np
import pinocchio as pin
import pytest
from builders import random_states
from dynamics.derivatives.test_derivatives import GEAR, WORM, scene_of

import pinfric as pf
from pinfric.dynamics.derivatives.parameters import ParameterDerivatives
from pinfric.errors import StateError

FRICTION = ["mu.static", "mu.kinetic", "coulomb.kinetic", "coulomb.positive.kinetic", "viscous"]
STEP = 1e-3
PLAIN = {"ratio": 1.0, "efficiency": 1.0, "back_efficiency": 1.0}
#: Coefficient of a gear -> its keys with one step more of it.
MORE = {
    "loss.driving": lambda x: {"efficiency": 1.0 / (1.0 / x["efficiency"] + STEP)},
    "loss.driven": lambda x: {"back_efficiency": x["back_efficiency"] - STEP},
    "no_load_torque.static": lambda x: {"no_load_torque": {"static": STEP, "kinetic": 0.0}},
    "no_load_torque.kinetic": lambda x: {"no_load_torque": STEP},
    "motor_viscous": lambda x: {"motor_viscous": {"coefficient": STEP, "exponent": 1.0}},
    "rotor_inertia": lambda x: {"rotor_inertia": x.get("rotor_inertia", 0.0) + STEP},
}


def ends_of(scene, state):
    found = scene.solver().inverse(*state)
    return np.array([getattr(found, name) for name in ParameterDerivatives._fields[1:]])


def assert_linear(found, k, before, after, step):
    one = np.array([end[:, k] for end in found[1:]])
    atol = 1e-12 * np.abs(before).max(axis=1, keepdims=True)
    assert (np.abs(step * one - (after - before)) <= atol).all(), found.names[k]


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("seed", [2, 5])
def test_coefficients_against_another_scene(seed, moving):
    """Static ones grow and kinetic ones shrink, so that static stays the larger.

    At rest a self-locking gear has its torque at another corner, so it has no derivative.
    """
    scene = scene_of(seed, worm=moving)
    state = [x[0] for x in random_states(scene.model, seed, 1)]
    state[1] *= moving
    found = scene.solver().parameter_derivatives(*state, FRICTION)
    before = ends_of(scene, state)
    for k, name in enumerate(found.names):
        joint, *path = name.split(".")
        entry = scene.friction[joint].model_dump(exclude_none=True)
        at = entry
        path = [*path, "coefficient"] if path == ["viscous"] else path
        for word in path[:-1]:
            at = at[word]
        step = -0.01 * at[path[-1]] if path[-1] == "kinetic" else STEP
        at[path[-1]] += step
        after = ends_of(scene.with_(friction={**scene.friction, joint: entry}), state)
        assert_linear(found, k, before, after, step)


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize(("name", "more"), MORE.items(), ids=MORE)
def test_coefficients_of_gears_against_another_scene(name, more, moving):
    scene, gear = scene_of(4), GEAR | {"no_load_torque": 0.0, "motor_viscous": 0.0}
    gears = [PLAIN, gear, WORM if moving else gear, gear]
    state = [x[0] for x in random_states(scene.model, 4, 1)]
    state[1] *= moving

    def driven(gears):
        drives = zip(scene.actuator_names, gears, strict=True)
        return scene.with_(actuators=[{"joint": n, "transmission": gear} for n, gear in drives])

    scene = driven(gears)
    found = scene.solver().parameter_derivatives(*state, name)
    before = ends_of(scene, state)
    assert found.names == tuple(f"{n}.{name}" for n in scene.actuator_names)
    for d, gear in enumerate(gears):
        after = ends_of(driven([*gears[:d], gear | more(gear), *gears[d + 1 :]]), state)
        if name != "no_load_torque.kinetic" or moving:
            assert_linear(found, d, before, after, STEP)
        else:  # its static value grows, too
            assert not found.motor_torque_upper.any()


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
        one = np.array([end[:, k] for end in found[1:]])
        atol = 1e-8 * max(1.0, np.abs(one).max())
        np.testing.assert_allclose(one, (4 * near - far) / 3, rtol=0, atol=atol)


def test_an_unknown_coefficient_is_refused():
    solver = pf.load_scene("pendulum").solver()
    with pytest.raises(StateError, match=r"nothing has 'mu\.size'"):
        solver.parameter_derivatives([0.0], [1.0], [0.0], ["mu.size"])
