"""When joints break away as motors' torques grow: `simulate` against `inverse_dynamics`.

The first slip is when the first torque leaves the interval of inverse dynamics, which knows neither
modes nor guards.
"""

import numpy as np
import pytest
from builders import geared_arm, random_states
from judges.test_gears import WORM, hoist
from scipy.optimize import brentq

import pinfric as pf
from pinfric.errors import SimulationInterrupted


def first_slip(scene: pf.Scene, q: np.ndarray, torque, enough: float) -> float:
    """The time of the first slip from rest within 1 s, inf without; it ends after `enough` s."""

    def stop(t: float) -> None:
        if t > enough:
            raise KeyboardInterrupt

    still = np.zeros(scene.model.nv)
    try:
        found = pf.simulate(scene, q, still, t_end=1.0, motor_torque=torque, progress=stop)
    except SimulationInterrupted as interrupt:
        found = interrupt.motion
    return next((event.time for event in found.events if event.kind == "slip"), np.inf)


def ramp(seed: int) -> tuple[float, float]:
    """When a random arm breaks away, by inverse dynamics and by `simulate`.

    Torques leave their intervals one after the other, along straight lines, given as a function or
    as a table, or along a sine.
    """
    scene, rng = geared_arm(seed, locks=(0.15, 0.5)[seed % 2])
    (q,), _, _ = random_states(scene.model, seed, 1)
    n = len(scene.drives)
    holding = pf.inverse_dynamics(scene, q, np.zeros(n), np.zeros(n))
    ends = np.array([holding.motor_torque_lower[0], holding.motor_torque_upper[0]])
    start = ends[0] + rng.uniform(0.0, 1.0, n) * (ends[1] - ends[0])
    leave = rng.uniform(0.05, 3.0, n)
    leave[rng.integers(n)] = rng.uniform(0.05, 0.95)
    rise = np.where(rng.random(n) < 0.5, ends[0], ends[1]) - start
    wave = np.sin if seed % 3 == 2 else float  # it rises as long as an argument below pi/2 does
    reach = rise / np.array([wave(min(t, 1.5)) for t in leave])

    def torque(t: float, *_: object) -> np.ndarray:
        return start + reach * wave(t)

    def inside(t: float) -> float:
        return float(np.minimum(torque(t) - ends[0], ends[1] - torque(t)).min())

    wanted = brentq(inside, 0.0, 1.0, xtol=1e-14) if inside(1.0) < 0.0 else np.inf
    given = torque if seed % 3 else ([0.0, 1.0], [torque(0.0), torque(1.0)])
    return wanted, first_slip(scene, q, given, wanted + 0.01)


FALL = ([0.0, 2.9, 3.0, 10.0], [[0.0], [3.0], [0.0], [-7.0]])


@pytest.mark.parametrize(
    ("mass", "torque", "t_end", "wanted"),
    [
        (10.0, FALL, 10.0, 3.0 + 20.62 / 50),  # u = eta_b h - n = -20.62
        (10.0, ([0.0, 3.0, 10.0], [[0.0], [3.0], [-4.0]]), 10.0, 6.0 + 20.62 / 50),
        (
            0.1,
            lambda t, q, v: [0.5 * np.sin(np.pi * t)],
            5.0,
            np.arcsin((0.981 / 0.4 + 1.0) / 25.0) / np.pi,
        ),  # u = h / eta + n
    ],
)
def test_a_worm_breaks_away_where_its_motor_pushes_enough(mass, torque, t_end, wanted):
    """From a state that it holds whatever the load: the first slip by hand, to 1e-9 s."""
    scene = hoist({**WORM, "rotor_inertia": 3.0 / 50**2}, mass)
    found = pf.simulate(scene, [0.0], [0.0], t_end=t_end, motor_torque=torque)
    assert [found.events[0].kind, found.events[0].name] == ["slip", "lift"]
    assert found.events[0].time == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(
    "seed", [pytest.param(x, marks=[pytest.mark.slow] * (x > 11)) for x in range(24)]
)
def test_an_arm_breaks_away_where_inverse_dynamics_ends(seed):
    wanted, found = ramp(seed)
    assert found == pytest.approx(wanted, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 200, 100))
def test_two_hundred_arms_break_away_where_inverse_dynamics_ends(first):
    """A thousand did (`range(0, 1000, 100)`), in five minutes."""
    late = {}
    for seed in range(first, first + 100):
        wanted, found = ramp(seed)
        if not abs(found - wanted) < 1e-6 and found != wanted:
            late[seed] = wanted, found
    assert not late
