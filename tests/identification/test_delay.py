"""Delay of logged efforts behind the motion."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from identify_cases import DELAY, NAMES, PLAIN, guess, one_joint, true_friction
from identify_wrong_models import wrong_log

import pinfric as pf
from pinfric.identification.delay import Delay, LogDelay, common_delay, other_delays, pooled
from pinfric.identification.notes import _of_logs


def test_logs_that_differ_in_their_delay_by_more_than_they_know_do_not_determine_it():
    near = common_delay([LogDelay(0.0040, 1e-3), LogDelay(0.0050, 1e-3)])
    assert near.value == pytest.approx(0.0045)
    assert near.standard_error == pytest.approx(1e-3 / np.sqrt(2))
    far = common_delay([LogDelay(0.0, 1e-3), LogDelay(0.010, 1e-3)])
    assert far.standard_error > 0.010 / 2  # of the two values' own mean
    assert (far.value, far.determined) == (pytest.approx(0.005), False)
    assert str(near) == "4.5 ms (standard error 0.7)"
    assert str(far) == "not determined, taken as 5.0 ms"


def test_a_search_that_ends_at_its_bound_determines_no_delay():
    """Before, it was printed as -30 +- 20 ms."""
    alone = common_delay([LogDelay(-0.03, np.inf)])
    assert (alone.value, alone.determined) == (0.0, False)
    both = common_delay([LogDelay(-0.03, np.inf), LogDelay(0.004, 1e-3)])
    assert (both.value, both.standard_error) == (0.004, 1e-3)


def test_a_delay_of_its_own_is_named():
    alike = {0: (0.004, 1e-3), 1: (0.005, 1e-3), 2: (0.003, 2e-3)}
    assert other_delays(Delay(0.004, 1e-3, (), alike)) == {}
    apart = alike | {3: (-0.014, 1e-3)}
    assert 3 in other_delays(Delay(0.004, 1e-3, (), apart))


def test_joints_that_disagree_are_told_from_joints_that_know_nothing():
    """Presliding: wrists lag by 39 ms, and faster motion would not help."""
    delay = Delay(0.034, 7.6e-3, ((0.034, 7.6e-3),), {0: (0.006, 5e-3), 5: (0.039, 1e-3)})
    assert delay.disputed
    slow = replace(delay, joints={0: (0.006, 5e-3), 5: (0.039, 9e-3)})
    assert not slow.disputed
    assert not replace(delay, standard_error=1e-3).disputed
    for one, words in ((delay, "joints ask for 6.0 to 39.0 ms"), (slow, "log faster motion")):
        (said,) = (x for x in _of_logs(SimpleNamespace(delay=one, prepared=())) if "delay" in x)
        assert words in said


def test_friction_that_builds_up_after_reversals_is_no_delay():
    """Before, 15 to 27 ms were found for 4."""
    found = pf.identify(guess(21), wrong_log("presliding", 21, 30.0, 125.0), laws=PLAIN)
    delay = found.estimate.delay
    assert abs(delay.value - DELAY) < 1.5e-3
    assert delay.determined  # although the shape of the build-up leaves 2 ms
    # nor is it less Coulomb and more viscous friction: both were 3.9 % off, as a mean
    assert found.estimate.builds_up
    assert any("after reversals (presliding), over a way" in line for line in found.notes)
    alone = [x for x in true_friction(found) if x[0].joint not in NAMES[1:3]]
    assert np.mean([abs(p.value / value - 1.0) for p, value in alone]) < 0.025


def test_a_delay_is_not_drawn_to_a_multiple_of_the_step():
    """At 50 Hz no sample of a reversal is slow: 1.4 +- 0.4 ms were found for 4."""
    found = pf.identify(guess(1400), wrong_log("true", 1400, 30.0, 50.0), laws=PLAIN)
    delay = found.estimate.delay
    assert abs(delay.value - DELAY) < 2.0 * delay.standard_error < 4e-3


def test_a_long_log_of_which_few_samples_are_kept_tells_its_delay():
    """2,400 s: 3.2 +- 0.1 ms were found for 20, by slopes of the few samples that are kept."""
    random, late, t = np.random.default_rng(5), 0.020, np.arange(0.0, 2400.0, 0.01)

    def motion(t):
        turns, size = np.array([0.63, 1.27, 2.51]), np.array([0.5, 0.4, 0.3])
        angle = np.outer(t, turns)
        q, v = np.sin(angle) @ size, np.cos(angle) @ (size * turns)
        return q, v, -np.sin(angle) @ (size * turns**2)

    q, v, a = motion(t - late)
    effort = 0.51 * a - 9.81 * np.cos(q) + 6.0 * np.sign(v) + 5.0 * v
    effort += 0.3 * random.normal(size=t.size)
    log = pf.Log(t, motion(t)[0][:, None], effort[:, None])
    found = pf.identify(one_joint(), log, inertia="keep")
    delay = found.estimate.delay
    assert abs(delay.value - late) < 2.5 * delay.standard_error < 1.5e-3
    viscous = next(p for p in found.parameters if p.name == "viscous")
    assert viscous.low < 5.0 < viscous.high < 5.1


def test_a_delay_that_joints_do_not_agree_on_is_less_certain():
    alike = [(0.004, 1e-3), (0.005, 1e-3), (0.003, 2e-3)]
    mean = (4 + 5 + 3 / 4) / 2.25 * 1e-3
    assert pooled(alike) == pytest.approx((mean, 1e-3 / 1.5))
    # what position-dependent friction did: each joint is sure of another delay
    apart = [(-0.03, 1e-3), (-0.014, 1.5e-3), (0.006, 1e-3), (0.002, 1e-3)]
    assert pooled(apart)[1] > 5e-3  # then it is not determined


def test_one_joint_that_errs_draws_no_delay():
    """Friction that no law describes: a wrist was sure of 1.1 ms where five joints said 4.6."""
    five = [(5.0, 0.9), (4.7, 0.5), (4.4, 0.75), (3.8, 1.6), (4.7, 1.2)]
    mean, error = pooled([*five, (1.1, 0.25)])
    assert mean == pytest.approx(pooled(five)[0], abs=0.6)
    assert error < 1.0
    # nor does one that knows little
    assert pooled([(4.0, 1.0), (5.0, 1.0), (3.0, 2.0), (50.0, 10.0)])[0] == pytest.approx(
        4.4, abs=0.3
    )


@pytest.mark.parametrize(
    ("n", "scatter"),
    [(2, 0.0), *(pytest.param(*x, marks=pytest.mark.slow) for x in ((6, 0.0), (3, 1.5), (6, 1.5)))],
)
def test_the_error_of_a_delay_is_what_it_says(n, scatter):
    """Joints whose errors are right, and such that scatter by more."""
    rng, inside = np.random.default_rng(1), 0
    for _ in range(400):
        e = rng.uniform(0.3, 2.0, n)
        values = 4.0 + np.hypot(e, scatter) * rng.normal(size=n)
        mean, error = pooled(list(zip(values, e, strict=True)))
        inside += abs(mean - 4.0) < 1.96 * error
    assert 0.87 < inside / 400 < 0.99  # the scatter of a few joints is itself uncertain
