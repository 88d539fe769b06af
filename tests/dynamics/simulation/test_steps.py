import numpy as np
import pinocchio as pin
import pytest
from builders import plane_friction, sliding_block
from simulation_cases import G, arm

import pinfric as pf
from pinfric.dynamics.simulation.crossing import first_crossing, root
from pinfric.errors import SimulationError

# Crossing: first crossings of zero in a step.


@pytest.mark.parametrize(
    ("guard", "expected"),
    [
        (lambda t: 0.7 - t, 0.7),
        (lambda t: (t - 0.41) ** 2 + 1e-6, None),
        (lambda t: (t - 0.41) ** 2 - 1e-6, 0.409),
        (lambda t: t * (0.5 - t), 0.5),  # starts on zero
        (lambda t: t - 0.1, 0.0),  # below from the start
        (lambda t: t**3, None),  # starts on zero and leaves upwards
        (lambda t: -t, 0.0),  # fires where it starts
        (lambda t: -1e-12 * np.ones_like(t), None),  # rounding
        (lambda t: max(0.0, 0.3 - t) if t < 0.6 else 0.55 - t, 0.6),  # a jump
        (lambda t: 0.0 if t < 0.5 else 0.5 - t, 0.5),  # on zero for a while, then below
        (
            lambda t: 1.0 + np.cos(20 * t) - 0.02,
            (np.pi - np.arccos(0.98)) / 20,
        ),  # waves between looks
    ],
)
def test_first_crossing(guard, expected):
    times = np.linspace(0.0, 1.0, 6)
    found = first_crossing(guard, times, np.array([guard(t) for t in times]), 1e-11)
    if expected is None:
        assert found is None
    else:
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("before", "after"), [(1e-3, -1.0), (0.3, -0.3), (0.5, -1e-9), (2.0, -0.1)]
)
def test_the_root_of_a_jump_is_its_far_side(before, after):
    """There the fired guard is below zero; a stick or slip that is tried there goes on."""
    for place in np.random.default_rng(0).uniform(0.1, 0.9, 20):

        def guard(t, place=place):
            return before if t < place else after

        found = root(guard, 0.0, 1.0)
        assert guard(found) == after
        assert found - place < 1e-14


# Regularized: regularized friction: its own error, and creep as predicted.


@pytest.mark.slow
def test_regularized_follows_the_belt_with_an_error_of_its_own():
    """Without a static peak (static = kinetic) it comes as near as its velocity lets it."""
    scene = sliding_block(plane_friction(0.3, 0.3))

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


def scaled_drawer(factor):
    """The bundled drawer with its lengths times a factor; in time it is sqrt(factor) slower."""
    scene = pf.load_scene("drawer")
    model = scene.model.copy()
    body = model.inertias[1]
    model.inertias[1] = pin.Inertia(body.mass, factor * body.lever, factor**2 * body.inertia)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -np.inf, np.inf
    push = [-0.15 * factor, 0.2 * factor, 0.0]
    bearing = {"kind": "guide", "length": 0.3 * factor}
    return pf.Scene(
        model=model,
        friction={"slide": {"bearing": bearing, "mu": {"static": 0.5, "kinetic": 0.4}}},
        actuators=[
            {"force": {"name": "push", "link": "drawer", "xyz": push, "direction": [1.0, 0, 0]}}
        ],
    )


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_a_drawer_of_other_lengths_moves_alike(method):
    """For 3 s: SciPy's steps for differences grew to infinity, as the place changes no force."""
    given = {
        "event": lambda factor: {"atol": 1e-10 * factor},
        "timestepping": lambda factor: {"dt": 1e-3 * factor**0.5},
        "regularized": lambda factor: {
            "atol": 1e-10 * factor,
            "regularization_velocity": 1e-3 * factor**0.5,
        },
    }[method]

    def place(factor):
        slower = factor**0.5

        def push(t, q, v):
            return np.array([28.0 * np.sin(6.0 / slower * t)])

        start = [0.0], [0.0], push, 3.0 * slower, method
        numbers = given(factor) | {"sample_step": 0.03 * slower}
        motion = pf.simulate(scaled_drawer(factor), *start, **numbers)
        times = np.linspace(0.0, 3.0, 101) * slower
        return np.interp(times, motion.t, motion.q[:, 0]) / factor

    expected = place(1.0)
    assert np.ptp(expected) > 0.04
    for factor in (0.01, 3.0)[: 1 if method == "regularized" else 2]:
        np.testing.assert_allclose(place(factor), expected, atol=1e-6)


# Scene run: the `simulation` section of a scene file, run.


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
@pytest.mark.parametrize("t_end", [0, 0.0, -1.0])
def test_an_end_that_is_given_is_not_replaced_by_the_scenes(method, t_end):
    """At 0 the scene's own two seconds ran."""
    with pytest.raises(SimulationError, match="t_end"):
        pf.simulate(pf.load_scene("pendulum"), t_end=t_end, method=method)


def test_without_an_end_it_is_the_scenes():
    scene = pf.load_scene("pendulum")
    assert pf.simulate(scene).t[-1] == scene.simulation.t_end
    assert pf.simulate(scene, t_end=0.25).t[-1] == 0.25
