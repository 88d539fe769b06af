"""The share of friction that has built up along a motion, against closed forms."""

import numpy as np
import pytest

from pinfric.dynamics.samples.presliding import carry_shares
from pinfric.model.presliding import GRADUAL

#: A velocity that turns at once: between two samples it adds nothing to what positions say.
SLOW = 1e-12


def shares(q, v, way, gradual=False, known=np.inf, stick=0.0, t=None):
    """Both ends (T, 2) of one coordinate's share."""
    t = np.arange(len(q), dtype=float) if t is None else t
    ways = way * np.array([GRADUAL if gradual else (1.0, np.nan, np.nan)])
    low, high = np.empty((2, len(q), 1))
    columns = (np.ascontiguousarray(x)[:, None] for x in (q, v))
    carry_shares(t, *columns, np.array([stick]), ways, known, low, high)
    return np.hstack([low, high])


@pytest.mark.parametrize("gradual", [False, True])
@pytest.mark.parametrize("times", [0.5, 1.0, 1.5, 3.0, 30.0])
def test_the_area_of_a_loop_is_4_f_times_amplitude_less_way(times, gradual):
    """In steps that end where a stop comes to its end: there z is straight between samples."""
    way, amplitude = 1e-3, times * 1e-3
    stops = way * np.array(GRADUAL if gradual else [1.0])
    corners = np.concatenate([[0.0], 2.0 * stops, [2.0 * amplitude]])
    stroke = np.unique(corners[corners <= 2.0 * amplitude]) - amplitude
    q = np.concatenate([stroke, *([-stroke[1:], stroke[1:]] * 4)])
    v = SLOW * np.sign(np.diff(q, append=-q[-1]))
    z = shares(q, v, way, gradual)[:, 0]
    cycle = slice(-2 * len(stroke) + 1, None)
    area = np.trapezoid(z[cycle], q[cycle])
    expected = np.mean(4.0 * np.maximum(amplitude - stops, 0.0))
    assert area == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("gradual", [False, True])
def test_twice_the_way_is_what_a_full_reversal_lacks(gradual):
    """2 d = integral of (1 - z) dq, whatever the shape."""
    q = np.concatenate([np.linspace(0.0, -0.05, 200), np.linspace(-0.05, 0.05, 200_001)])
    v = SLOW * np.sign(np.diff(q, append=1.0))
    z = shares(q, np.where(v == 0.0, SLOW, v), 2e-3, gradual)[200:, 0]
    lacking = np.trapezoid(1.0 - z, q[200:])
    assert lacking == pytest.approx(4e-3 * np.mean(GRADUAL if gradual else 1.0), rel=1e-4)
    assert np.mean(GRADUAL) == pytest.approx(1.0, abs=1e-3)


def test_ends_that_are_not_known_meet_after_twice_the_way():
    q = np.linspace(0.0, 0.004, 41)
    found = shares(q, np.ones(41), 1e-3)
    assert found[0].tolist() == [-1.0, 1.0]
    assert found[19, 0] < 1.0
    assert found[10, 0] == pytest.approx(0.0)
    assert (found[20:] == 1.0).all()


def test_biased_efforts_do_not_creep():
    """A load that swings between -0.15 and 0.95 F moves the stop to and fro: 1,000 times."""
    stretch, way = np.tile([0.95, -0.15], 1000), 1e-3
    q = way * np.concatenate([[-3.0, 0.0], stretch - 1.0])  # z = 1 + q/d: no slip
    v = SLOW * np.sign(np.diff(q, prepend=q[0] - 1.0))
    z = shares(q, v, way)[2:, 0]
    assert np.abs(z - stretch).max() < 1e-12


def test_a_turning_point_between_samples_is_taken_there():
    """A parabola through its top: up and down by 2 ways, both samples at the same place."""
    t = np.array([0.0, 1.0])
    q = np.array([-1.0, 0.0, 0.0])
    v = np.array([1.0, 1.0, -1.0])
    top = 0.25  # v t/2 of half the time
    z = shares(q, v, 0.2, t=np.array([-1.0, *t]))
    assert z[2, 0] == pytest.approx(1.0 - top / 0.2)


@pytest.mark.parametrize(("moved", "share"), [(-0.4, 0.55), (-0.2, 0.7)])
def test_an_uneven_turning_point_is_where_the_velocity_is_zero(moved, share):
    """From 1 to -3 in 0.4 s: 0.1 s ahead by 0.05, 0.3 s back by 0.45.

    What positions say beyond these -0.4 is spread evenly in time: 0.05 of 0.2 until it turns.
    """
    q, v, t = np.array([-5.0, 0.0, moved]), np.array([1.0, 1.0, -3.0]), np.array([-5.0, 0.0, 0.4])
    assert shares(q, v, 1.0, t=t)[2, 0] == pytest.approx(share)


def test_a_hold_forgets_and_a_turning_point_does_not():
    q = np.array([0.0, 1.0, 1.0, 1.0, 0.9999])
    v = SLOW * np.array([1.0, 1.0, 0.0, 0.0, -1.0])
    held = shares(q, v, 1e-3)
    assert held[1].tolist() == [1.0, 1.0]
    assert held[2].tolist() == held[3].tolist() == [-1.0, 1.0]
    assert held[4] == pytest.approx([-1.0, 0.9])
    turned = shares(q[[0, 1, 2, 4]], v[[0, 1, 2, 4]], 1e-3)
    assert turned[2].tolist() == [-1.0, 1.0]
    assert turned[3] == pytest.approx([0.9, 0.9])
    known = shares(q, v, 1e-3, known=1e-4)
    assert known[3] == pytest.approx([0.9, 1.0])
    assert known[4] == pytest.approx([0.8, 0.9])
    assert np.abs(shares(q, v, 1e-3, known=0.0)[2:4] - 1.0).max() == 0.0


@pytest.mark.parametrize(
    ("times", "error", "work"),
    [(1.5, 1.08, 0.67), (3, 0.90, 0.33), (10, 0.66, 0.10), (100, 0.37, 0.01)],
)
def test_what_friction_that_acts_at_once_gets_wrong(times, error, work):
    """A sine of so many ways: the figures of the page."""
    angle = np.linspace(0.0, 6.0 * np.pi, 60_001)
    q, v = 1e-3 * times * np.sin(angle), np.cos(angle)
    z = shares(q, SLOW * v, 1e-3)[20_000:, 0]
    q, at_once = q[20_000:], np.sign(v[20_000:])
    assert np.sqrt(np.mean((at_once - z) ** 2)) == pytest.approx(error, abs=0.006)
    invented = np.trapezoid(at_once - z, q) / (8e-3 * times)
    assert invented == pytest.approx(work, abs=0.006)
