"""The smooth law against the exact one, its bound, and differences of its solutions."""

import numpy as np
import pytest
from builders import random_states
from dynamics.derivatives.test_derivatives import assert_close, scene_of
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.errors import StateError
from pinfric.model.friction_terms import DirectedCoulombFriction

NAMES = "effort", "joint_effort", "motor_torque"


@pytest.mark.parametrize("seed", range(4))
def test_from_the_width_on_it_is_the_exact_law(seed):
    scene = scene_of(seed)
    solver, smooth = scene.solver(), scene.solver().smoothed(0.1)
    for q, v, a in zip(*random_states(scene.model, seed, 20), strict=True):
        v = np.copysign(np.maximum(np.abs(v), 0.1), v)
        exact, found = solver.inverse(q, v, a), smooth.inverse(q, v, a)
        for name in NAMES:
            judge, one = getattr(exact, f"{name}_lower"), getattr(found, name)
            scale = np.abs(judge).max()
            assert_allclose(one, judge, rtol=0, atol=1e-12 * scale)


def static_of(coulomb):
    """Against forward and backward motion."""
    if coulomb is None:
        return 0.0, 0.0
    if isinstance(coulomb, DirectedCoulombFriction):
        return coulomb.positive.static, coulomb.negative.static
    return coulomb.static, coulomb.static


@pytest.mark.parametrize("width", [0.3, 0.1, 0.03])
def test_below_it_the_bound_is_attained_and_never_exceeded(width):
    """3000 states; the interval at rest is tau_id -+ (mu_s c + static), by the scene's keys."""
    scene = pf.load_scene("ur10")
    solver, smooth = scene.solver(), scene.solver().smoothed(width)
    bound, rng = smooth.bound(), np.random.default_rng(1)
    laws = [site.friction for site in scene.sites]
    mu = np.array([f.mu.static if f.mu else 0.0 for f in laws])
    steady = np.array([not f.mu or f.mu.static == f.mu.kinetic for f in laws])
    ahead, back = np.array([static_of(f.coulomb) for f in laws]).T
    most, joints = np.zeros(6), np.arange(6)
    for k, (q, v, a) in enumerate(zip(*random_states(scene.model, 1, 3000), strict=True)):
        v = width * rng.uniform(-1.0, 1.0, 6)
        v[joints == k % 6] = width * (1 - 1e-12) * (-1) ** (k // 6)
        exact, u = solver.inverse(q, v, a), smooth.inverse(q, v, a).effort
        rubbed, held = u - exact.effort_frictionless, mu * exact.normal_load
        most = np.maximum(most, np.maximum(rubbed - held - ahead, -rubbed - held - back))
    assert (most <= bound + 1e-9).all()
    assert steady.any()
    assert_allclose(most[steady], bound[steady], atol=1e-9)


@pytest.mark.parametrize("width", [0.5, 0.05])
@pytest.mark.parametrize("seed", [0, 1])
def test_derivatives_against_differences(seed, width):
    scene = scene_of(seed, mild=0.1, worm=False)
    smooth = scene.solver().smoothed(width)
    q, v, a = (x[0] for x in random_states(scene.model, seed, 1))
    v *= 0.2
    of = smooth.inverse(q, v, a)
    found = [
        np.array(x) for x in zip(of.of_effort, of.of_joint_effort, of.of_motor_torque, strict=True)
    ]

    def efforts(q, v, a):
        return np.array(smooth.inverse(q, v, a)[:3])

    steps = (1e-3, 2e-4, 2e-5)
    assert_close(found, efforts, scene.model, (q, v, a), 1e-8, None, steps)
    u = efforts(q, v, a)[0]
    there = smooth.forward(q, v, u)
    assert_allclose(there.a, a, atol=1e-8 * np.abs(a).max())
    unit = np.abs(u).max()
    blocks = [x[None].copy() for x in (there.ddq_dq, there.ddq_dv, unit * there.ddq_dtau)]
    state = q, v, u / unit
    assert_close(
        blocks,
        lambda q, v, u: smooth.forward(q, v, unit * u).a[None],
        scene.model,
        state,
        1e-6,
        None,
        steps,
    )
    end = smooth.step(q, v, u, dt=0.01)
    blocks = [x[None].copy() for x in (end.dv_dq, end.dv_dv, unit * end.dv_dtau)]
    assert_close(
        blocks,
        lambda q, v, u: smooth.step(q, v, unit * u, dt=0.01).v[None],
        scene.model,
        state,
        1e-6,
        None,
        steps,
    )


@pytest.mark.parametrize("width", [0.3, 1e-4])
def test_a_step_is_stable_at_any_length_and_holds(width):
    """What static friction would hold creeps at less than the width."""
    scene = pf.load_scene("ur10")
    smooth = scene.solver().smoothed(width)
    q, v = np.array([0.0, -1.0, 1.0, 0.0, 0.5, 0.0]), np.zeros(6)
    exact = scene.solver().inverse(q, v, v)
    u = 0.3 * exact.effort_upper + 0.7 * exact.effort_lower
    for k in range(10):
        q, v = smooth.step(q, v, u, dt=0.05)[:2]
        assert (np.abs(v) < width).all(), k
    v = smooth.step(q, v + 0.5, u, dt=10.0).v
    assert (np.abs(v) < width).all()


@pytest.mark.parametrize("width", [0.0, -1.0, np.nan, [0.1]])
def test_a_width_that_is_none_is_refused(width):
    with pytest.raises(StateError, match="width"):
        pf.load_scene("pendulum").solver().smoothed(width)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda x: x.inverse([0.0, 0.0], [0.0], [0.0]), "q: shape"),
        (lambda x: x.inverse([0.0], ["fast"], [0.0]), "v: "),
        (lambda x: x.inverse([0.0], [0.0], [0.0, 0.0]), "a: shape"),
        (lambda x: x.forward([0.0], [0.0], [0.0], motor_torque=[0.0]), "found both"),
        (lambda x: x.forward([0.0], [0.0], [0.0, 0.0]), "effort: shape"),
        (lambda x: x.step([0.0], [0.0, 0.0], [0.0], dt=0.1), "v: shape"),
        (lambda x: x.step([0.0], [0.0], motor_torque={"bar": 1.0}, dt=0.1), "motor_torque: "),
        (lambda x: x.step([0.0], [0.0], [0.0], dt="soon"), "dt: "),
    ],
)
def test_bad_input_is_refused_in_one_line(call, says):
    with pytest.raises(StateError, match=says) as refused:
        call(pf.load_scene("pendulum").solver().smoothed(0.1))
    assert "\n" not in str(refused.value)
