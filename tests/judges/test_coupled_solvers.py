"""Fixed point against Newton up to the jam: passes and errors by the drawer's closed form.

F the push, x = -mu c(F) the friction: F = m a - x and c = sqrt(w^2 + (2 F e / L)^2). So each pass
of the fixed point leaves rate = mu (2 e / L)^2 F / c of the error, below mu / critical mu.
"""

import dataclasses

import coupled as module
import numpy as np
import pytest
from builders import example
from cases import Case, drawer_forces, jamming_drawer, turning_four_bar
from coupled import (
    SHARES,
    TOLERANCES,
    CoupledFriction,
    coupled,
    lines,
    solve,
    table,
)

import pinfric as pf

WEIGHT, LEVER = 4.0 * 9.81, 2 * 0.3 / 0.3  # m g, 2 e / L


def of(rows, solver, share=None):
    return [r for r in rows if r.solver == solver and (share is None or r.share == share)]


@pytest.fixture(scope="module", autouse=True)
def _timed_once():
    """Run each solve once: `python benchmarks/coupled.py` measures their times."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_TIMED_PASSES", 1)
        yield


@pytest.fixture(scope="module")
def drawer():
    return coupled(jamming_drawer(0.3, 1.0).inverse(), rounds=1)


def rate(mu):
    (force,) = drawer_forces(mu, 1.0)
    return mu * LEVER**2 * force / np.hypot(WEIGHT, LEVER * force)


def test_the_jam_is_the_drawers_critical_mu(drawer):
    for row in drawer:
        assert 0.3 * row.mu_factor == pytest.approx(0.5 * row.share, rel=1e-8)
        assert row.contraction == pytest.approx(row.share, rel=1e-8)
    assert len(drawer) == 2 * len(SHARES) * len(TOLERANCES)
    assert not any(row.problem for row in drawer)
    assert all(row.wall_s > 0 for row in drawer)


@pytest.mark.parametrize("share", SHARES)
def test_each_pass_of_the_fixed_point_leaves_the_rate_of_the_closed_form(drawer, share):
    *_, third, last = of(drawer, "fixed point", share)
    expected = np.log(last.tolerance / third.tolerance) / np.log(rate(0.5 * share))
    assert last.iterations - third.iterations == pytest.approx(expected, rel=1e-3, abs=1)
    for row in of(drawer, "fixed point", share):
        # the first pass is as long as a residual may be, the contraction leaves so much of each
        assert row.iterations <= 2 + np.log(row.tolerance) / np.log(row.contraction)
        left = row.tolerance * row.contraction / (1 - row.contraction)
        assert row.error <= 1.01 * left + 1e-14 / (1 - row.contraction)


def test_newtons_passes_stay_few_and_the_fixed_points_do_not(drawer, capsys):
    tightest = {
        solver: [r for r in of(drawer, solver) if r.tolerance == min(TOLERANCES)]
        for solver in ("fixed point", "Newton")
    }
    assert all(row.iterations <= 12 for row in tightest["Newton"])
    slow = [row.iterations for row in tightest["fixed point"]]
    assert slow == sorted(slow)
    assert slow[0] < 20
    assert slow[-1] > 50_000
    for row in tightest["Newton"]:
        assert row.error <= 1e-12 / (1 - row.contraction)
    from rich.console import Console

    with capsys.disabled():
        console = Console(width=80, record=True)
        console.print()
        console.print(table("drawer", drawer), *lines(drawer), sep="\n")
    text = console.export_text()
    assert "…" not in text
    for row in tightest["fixed point"]:
        assert f" {row.iterations} " in text


@pytest.mark.parametrize("newton", [False, True])
@pytest.mark.parametrize("mu", [0.1, 0.3, 0.45])
def test_both_solvers_find_the_push_of_the_closed_form(newton, mu):
    """Two pads: p = +-(F e / L) across, w / 2 down, F = m a - x."""
    side = 0.5 * LEVER
    free = np.array([[4.0 * side, 0.5 * WEIGHT, 0.0], [-4.0 * side, 0.5 * WEIGHT, 0.0]])
    slope = np.array([[[-side, 0.0, 0.0]], [[side, 0.0, 0.0]]])
    x, zero = np.zeros(1), np.zeros(1)
    friction = CoupledFriction(free, slope, np.zeros(2, np.int64), np.array([-mu]), zero, zero)
    assert solve(friction, newton, 1e-14, 2000, 1, x) > 0
    assert 4.0 - x[0] == pytest.approx(drawer_forces(mu, 1.0)[0], rel=1e-12)
    assert solve(friction, newton, 1e-14, 2, 1, x) == -1


@pytest.mark.slow
def test_a_four_bar_jams_beyond_its_certificate():
    """Contraction 1 is a bound there: the jam comes 14 to 29 % later."""
    case, near = turning_four_bar(40), slice(34, 39)  # of the turn, where it jams first
    case = Case(case.scene, *(x[near] for x in (case.q, case.v, case.a, case.t)))
    rows = coupled(case.inverse(), rounds=1)
    for row in rows:
        assert not row.problem
        assert 1.10 * row.share < row.contraction < 1.35 * row.share
        assert row.error < (1e-3 if row.tolerance == min(TOLERANCES) else 1.0)
    slow = [r.iterations for r in of(rows, "fixed point", SHARES[-1])]
    fast = [r.iterations for r in of(rows, "Newton", SHARES[-1])]
    assert slow[-1] > 1000 * fast[-1]


def test_passes_without_end_are_rows_with_a_reason(monkeypatch):
    monkeypatch.setitem(module.MOST_PASSES, "fixed point", 100)
    rows = coupled(jamming_drawer(0.3).inverse(), rounds=1)
    failed = [row for row in rows if row.problem]
    assert {row.solver for row in failed} == {"fixed point"}
    assert {row.problem for row in failed} == {"not within 100 passes"}
    assert {row.share for row in failed} == {0.9, 0.98, 0.9998}
    assert all(np.isnan(row.wall_s) for row in failed)


def test_where_nothing_couples_or_slides_there_is_nothing_to_study():
    scene, trajectory = example("pendulum", "pendulum.waypoints.yaml")
    assert coupled(pf.inverse_dynamics(scene, trajectory)) == ()
    case = jamming_drawer(0.3)
    assert coupled(dataclasses.replace(case, v=0 * case.v, a=0 * case.a).inverse()) == ()
