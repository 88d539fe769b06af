"""What another processor's rounding must not decide: events, stops, whether there is a solution.

Another BLAS, compiler or order of sums changes last digits. So the hard cases are simulated again
from states, and over times, that differ by 1e-15: the events stay the same.
"""

from contextlib import nullcontext

import numpy as np
import pytest
from builders import dry, plane_friction, sliding_block
from cases import boxer, four_bars_in_a_row, resting_four_bar, rocker_driven_four_bar
from dynamics.simulation.test_simulate import Belt, pinned_body
from judges.test_linked_simulate import parallelogram_scene, swing
from mechanisms import pin_friction

import pinfric as pf
from pinfric.dynamics.simulation.start import start_state
from pinfric.errors import NoConsistentAcceleration

EPS = 1e-15


def bundled(name, t_end=None):
    scene = pf.load_scene(name)
    assert scene.simulation is not None
    return scene, *start_state(scene), None, t_end or scene.simulation.t_end


def of_case(case, effort, t_end, sample=0):
    return case.scene, case.q[sample], case.v[sample], effort, t_end


def swinging_parallelogram():
    coulomb = dry(0.05)
    return parallelogram_scene(coulomb), swing(0.8), np.zeros(3), [0.0], 5.2


def loaded_parallelogram():
    return parallelogram_scene(pin_friction(0.3, 0.02)), swing(0.8), np.zeros(3), [0.0], 2.2


def belt():
    example = Belt()
    return example.scene, [0.0], [0.0], example.effort, example.first_slip + 2.6 * example.period


def pushed_block():
    """A ramp up to the static limit itself, and a plateau there: it holds."""
    scene = sliding_block(plane_friction(0.35, 0.3))
    limit = 0.35 * 2 * 9.81
    return scene, [0.0], [0.0], ([0.0, 1.0, 5.0], [[0.0], [limit], [limit]]), 2.0


#: What is simulated: scene, q, v, effort, t_end.
HARD = {
    "pendulum": lambda: bundled("pendulum"),
    "three-link robot": lambda: bundled("three_link"),
    "four-bar": lambda: bundled("four_bar", 0.5),
    "slider-crank": lambda: bundled("slider_crank"),
    "drawer at the end of its range": lambda: bundled("drawer"),
    "excavator": lambda: bundled("excavator"),
    "delta": lambda: bundled("delta", 0.3),
    "belt": belt,
    "pushed to its limit": pushed_block,
    "parallelogram, constant friction": swinging_parallelogram,
    "parallelogram, load-dependent friction": loaded_parallelogram,
    "two pistons through their dead centres": lambda: of_case(
        boxer(cylinders=2, angle=-0.5, rate=10.0), [0.8], 0.6
    ),
    "two pistons from their dead centres": lambda: of_case(
        boxer(cylinders=2, angle=0.0, rate=3.0), [0.0], 0.6
    ),
    "ten pins that rest": lambda: of_case(four_bars_in_a_row(1), [-3.0], 0.3),
    "four pins that break away": lambda: of_case(
        resting_four_bar(3, static=0.35), {"O": lambda t: 4.0 * t}, 0.5, sample=1
    ),
    "rocker near its toggle": lambda: of_case(rocker_driven_four_bar([0.3]), [0.0], 0.3),
}


def perturbed(x, rng):
    """x with every entry moved by 1e-15 of its size, or of 1."""
    x = np.array(x, dtype=float)
    return x + EPS * rng.choice([-1.0, 1.0], x.shape) * np.maximum(np.abs(x), 1.0)


def events_of(motion):
    """(name, kind, direction) in order of time, joints of one instant by name; and the times."""
    ordered = sorted(motion.events, key=lambda e: (round(e.time, 6), e.name))
    return [(e.name, e.kind, e.direction) for e in ordered], [e.time for e in ordered]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["event", "timestepping"])
@pytest.mark.parametrize("name", HARD)
def test_states_that_differ_by_rounding_have_the_same_events(name, method):
    scene, q, v, effort, t_end = HARD[name]()
    options = {"dt": 2e-3} if method == "timestepping" else {}
    kinds, times = events_of(pf.simulate(scene, q, v, effort, t_end, method, **options))
    rng = np.random.default_rng(len(name))
    for sign in (-1.0, 1.0):
        v_near = perturbed(v, rng) if np.any(v) else np.asarray(v, dtype=float)
        motion = pf.simulate(
            scene, perturbed(q, rng), v_near, effort, t_end * (1 + sign * EPS), method, **options
        )
        kinds_near, times_near = events_of(motion)
        assert kinds_near == kinds
        np.testing.assert_allclose(times_near, times, rtol=0, atol=1e-6)
        assert all(stick.start < stick.end for stick in motion.stick_intervals())


@pytest.mark.slow
@pytest.mark.parametrize("steps", [501, 997, 1013, 1511, 2003])
def test_time_stepping_takes_no_turning_point_for_a_stop(steps):
    """A block on a spring with dry friction: it turns round while the spring can pull it back.

    x = 1 - (2 n mu g / w^2) at the n-th turn, until the spring is weaker than friction: w^2 |x| <=
    mu g. The step that meets a turn may end at exactly zero velocity; how many do depends on dt.
    """
    mu, omega = 0.05, 4.0
    scene = sliding_block(plane_friction(mu, mu))
    mass, lost = 2.0, 2 * mu * 9.81 / omega**2
    turns = int(np.ceil((1.0 - mu * 9.81 / omega**2) / lost))
    stop = turns * np.pi / omega

    def spring(t, q, v):
        return -mass * omega**2 * q

    t_end = stop + 0.3
    motion = pf.simulate(
        scene,
        [1.0],
        [0.0],
        spring,
        t_end,
        "timestepping",
        dt=t_end / steps,
        sample_step=t_end / steps,
    )
    (stick,) = motion.stick_intervals()
    assert stick.start == pytest.approx(stop, abs=2 * t_end / steps)
    assert stick.end == motion.t[-1]
    assert [e.kind for e in motion.events] == ["reversal"] * (turns - 1) + ["stick"]
    limit = mu * mass * 9.81
    assert (np.abs(motion.friction) <= limit * (1 + 1e-9)).all()  # at the turns, too


@pytest.mark.slow
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("bits", range(20, 53, 2))
def test_next_to_contraction_1_there_is_one_acceleration_or_none_and_never_two(bits, sign):
    """|a| = v^2 b / sqrt(1 - b^2) below 1 as far as rounding can resolve it; then none."""
    b = 1.0 + sign * 2.0**-bits
    known = sign < 0 and bits <= 30
    with nullcontext() if known else pytest.raises(NoConsistentAcceleration):
        a = pf.forward_dynamics(pinned_body(b), [0.4], [2.0], [0.0]).a[0]
        assert a == pytest.approx(-4 * b / np.sqrt((1 - b) * (1 + b)), rel=1e-6)
