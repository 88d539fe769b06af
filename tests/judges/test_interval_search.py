"""The search by interval arithmetic: roots of quadratic equations."""

from dataclasses import replace

import numpy as np
import pytest
from cases import four_bars_in_a_row, jamming_drawer
from judges import enumeration
from judges.interval_search import Loads, _Reduced, _settled, all_solutions
from judges.verdict import judge
from scipy.optimize import fsolve

from pinfric.dynamics.samples.outcome import Status


def test_the_search_finds_the_roots_of_quadratic_equations():
    """z = k + |p + P z| squared: none, one or two roots, all proved to be all."""
    rng = np.random.default_rng(0)
    counts = []
    for _ in range(200):
        k, p, P = abs(rng.normal()), rng.normal(size=3), 0.8 * rng.normal(size=3)
        roots = np.roots([1 - P @ P, -2 * (k + p @ P), k**2 - p @ p])
        roots = np.sort(roots[np.isreal(roots)].real)
        roots = roots[roots >= k]
        found = all_solutions(
            Loads(np.array([k]), np.ones((1, 1)), p[None, None], P[None, None, :, None])
        )
        assert found.decided.all()
        np.testing.assert_allclose(np.sort(found.z[:, 0]), roots, rtol=1e-9)
        counts.append(len(roots))
    assert set(counts) == {0, 1, 2}


@pytest.mark.parametrize("offset", [-0.5, -0.1, 0.0, 0.3])
def test_a_box_with_one_root_shrinks_to_it(offset):
    """z = 1 + |(1, 0, 0.2) + (0.5, 0.3, 0) z|, from boxes about the root and beside it."""
    p, P = np.array([1.0, 0.0, 0.2]), np.array([0.5, 0.3, 0.0])
    here = _Reduced.of(Loads(np.ones(1), np.ones((1, 1)), p[None, None], P[None, None, :, None]))
    root = max(np.roots([1 - P @ P, -2 * (1 + p @ P), 1 - p @ p]).real)
    radius = np.array([[0.4]])
    y = here.c + (root - 1.0) * here.M[:, 0]
    np.testing.assert_allclose(_settled(here, y + offset * radius, radius)[0], y, rtol=1e-12)


def test_two_roots_close_to_a_line_are_both_found():
    """Newton's method from the middle of either box ends at the same one."""
    p = np.array([[[-206.68767, 1.270554, 0.0], [-257.217756, 1.260912, 0.0]]])
    P = np.array(
        [
            [
                [[7.486386, 14.97529], [0.13411, 0.13411], [0.0, 0.0]],
                [[9.318053, 18.636251], [0.0, -0.166925], [0.0, 0.0]],
            ]
        ]
    )
    loads = Loads(np.zeros(2), np.eye(2), p, P)
    roots = set()
    for start in np.random.default_rng(0).uniform(5.0, 12.0, size=(200, 2)):
        z, _, good, _ = fsolve(lambda z: loads.residual(z[None])[0], start, full_output=True)
        if good == 1 and np.abs(loads.residual(z[None])).max() < 1e-9:
            roots.add(tuple(np.round(z, 6).tolist()))
    found = all_solutions(loads)
    assert found.decided.all()
    assert {tuple(np.round(z, 6).tolist()) for z in found.z} == roots
    assert len(roots) == 2


# The enumeration of states at rest.


@pytest.mark.parametrize("acceleration", [-12.0, -7.5, -2.0, 0.0, 1.0])
@pytest.mark.parametrize("mu", [0.1, 0.4999, 0.5001, 0.6, 2.0])
def test_the_states_of_drawers_are_proved(mu, acceleration):
    check = judge(jamming_drawer(mu, acceleration).inverse())
    assert (check.wrong_status, check.undecided, check.passed(1e-8)) == (0, 0, True)


def test_efforts_in_place_of_a_jam_are_a_wrong_status():
    jam = jamming_drawer(0.6, 1.0).inverse()
    assert (jam.status[0], judge(jam).undecided) == (Status.JAMMED, 0)
    right = jamming_drawer(0.49, 1.0).inverse()
    assert judge(replace(right, scene=jam.scene)).wrong_status == 1


def test_ten_pins_at_rest_are_searched_where_there_are_too_many_to_enumerate(monkeypatch):
    case = four_bars_in_a_row(1, radius=0.03)
    found = case.inverse()
    assert judge(found).passed(1e-11), judge(found)
    monkeypatch.setattr(enumeration, "_ENUMERATED", 100)
    assert judge(found).passed(1e-11)
    assert judge(found).undecided == 1
    found.effort_upper[:] *= 1 - 1e-6
    assert not judge(found).passed()
