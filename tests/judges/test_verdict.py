"""The judge notices what is wrong: each test spoils a right result, or the solver behind it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump, plane_friction, sliding_block
from cases import (
    Case,
    ball_tripod,
    decelerating_drawer,
    drawer_forces,
    jamming_drawer,
    resting_four_bar,
    reversing_ball,
    turning_four_bar,
)
from judges.falsified import EFFORTS, FALSE, NOTHING, SITUATIONS, falsified
from judges.verdict import judge
from mechanisms import pin_friction

import pinfric as pf
from pinfric.dynamics.inverse import interval_ends, result
from pinfric.dynamics.inverse.choices import LOWER, SLIDES, UPPER
from pinfric.dynamics.samples.outcome import Status


def resting_balls():
    case = ball_tripod()
    return Case(case.scene, case.q[:1], 0 * case.v[:1], 0 * case.a[:1])


def resting_block():
    scene = sliding_block(plane_friction(0.5, 0.3))
    return Case(scene, *np.zeros((3, 1, 1)))


def spoiled(found, sample, status, **values):
    """The same result with another status and other numbers at one sample."""
    arrays = {name: getattr(found, name).copy() for name in (*values, "status")}
    arrays["status"][sample] = status
    for name, value in values.items():
        arrays[name][sample] = value
    return replace(found, **arrays)


@pytest.mark.parametrize("change", [1e-6, -1e-6])
@pytest.mark.parametrize("name", ["effort_lower", "effort_upper"])
@pytest.mark.parametrize(
    "case",
    [resting_block, partial(resting_four_bar, 2), resting_balls],
    ids=["block", "four_bar", "balls"],
)
def test_an_end_a_millionth_too_narrow_or_too_wide_is_noticed(case, name, change):
    found = case().inverse()
    assert judge(found).passed(1e-12), judge(found)
    getattr(found, name)[0] += change * judge(found).scale
    assert not judge(found).passed()


@pytest.mark.parametrize("factor", [1 - 1e-6, 1 + 1e-6])
@pytest.mark.parametrize(
    "case", [partial(resting_four_bar, 2), resting_balls], ids=["four_bar", "balls"]
)
def test_ends_that_the_solver_itself_gets_wrong_are_noticed(monkeypatch, case, factor):
    """Its solutions then agree with its ends: only the judge's own limits show it."""
    friction_laws = interval_ends.friction_laws

    def wrong_laws(*given):
        law = friction_laws(*given)
        law.mu[[LOWER, UPPER]] *= factor
        return law

    case = case()
    assert judge(case.inverse()).passed(1e-12)
    monkeypatch.setattr(interval_ends, "friction_laws", wrong_laws)
    found = case.inverse()
    attained = [solution.effort[0] for solution in found.solutions(0)]
    assert found.effort_upper[0, 0] == pytest.approx(max(attained), rel=1e-12)
    assert not judge(found).passed()


def test_an_end_that_the_solver_has_not_looked_at_is_noticed(monkeypatch):
    """All pins stay at their lower limits."""
    laws_without(monkeypatch, UPPER, LOWER)
    found = resting_four_bar(2).inverse()
    assert found.interval_exact.all()
    assert judge(found).ends > 1e-3
    assert not judge(found).passed()


def test_a_ball_that_never_slides_where_it_turns_round_is_noticed(monkeypatch):
    """Sliding costs more there than what holds it at rest."""
    assert judge(reversing_ball(5.0).inverse()).passed()
    laws_without(monkeypatch, SLIDES, UPPER)
    found = reversing_ball(5.0).inverse()
    assert judge(found).ends > 1.0
    assert not judge(found).passed()


def laws_without(monkeypatch, code, other):
    """Replace friction `code` of sites that rest or reverse by their friction `other`."""
    friction_laws = interval_ends.friction_laws

    def wrong_laws(*given):
        law = friction_laws(*given)
        for values in (law.way, law.mu, law.coulomb):
            values[code] = np.where(law.options > 1, values[other], values[code])
        return law

    monkeypatch.setattr(interval_ends, "friction_laws", wrong_laws)


@pytest.mark.parametrize(
    "case",
    [
        partial(turning_four_bar, 3),
        partial(resting_four_bar, 3),
        partial(jamming_drawer, 0.49),
        resting_balls,
        decelerating_drawer,
    ],
    ids=["turning", "resting", "drawer", "balls", "ambiguous"],
)
@pytest.mark.parametrize("status", [Status.JAMMED, Status.SINGULAR])
def test_a_false_jam_and_a_false_toggle_are_noticed(case, status):
    found = case().inverse()
    assert judge(found).passed(1e-11)
    check = judge(spoiled(found, 0, status, **NOTHING))
    assert (check.wrong_status, check.passed()) == (1, False)
    assert check.sample == 0


def test_an_open_chain_cannot_jam():
    found = resting_block().inverse()
    values = {name: value for name, value in NOTHING.items() if name != "multipliers"}
    assert judge(spoiled(found, 0, Status.JAMMED, **values)).wrong_status == 1


def test_a_jam_is_confirmed_and_efforts_in_its_place_are_not():
    jam = jamming_drawer(0.6, 1.0).inverse()
    assert jam.status[0] == Status.JAMMED
    check = judge(jam)
    assert (check.wrong_status, check.undecided, check.passed()) == (0, 1, True)  # not proved
    right = jamming_drawer(0.49, 1.0).inverse()
    assert not judge(replace(right, scene=jam.scene)).passed()


def test_numbers_that_are_missing_are_noticed():
    for case in (turning_four_bar(3), resting_block()):
        for name in ("effort_upper", "friction_lower", "normal_load", "wrench"):
            found = case.inverse()
            getattr(found, name)[0] = np.nan
            assert not judge(found).passed(), name


@pytest.mark.parametrize("kept", [0, 1])
def test_a_missing_second_solution_is_noticed(monkeypatch, kept):
    """A braked drawer beyond its critical friction, whose other push is not mentioned."""
    case = decelerating_drawer()
    found = case.inverse()
    both = found.solutions(0)
    np.testing.assert_allclose(sorted(s.effort[0] for s in both), case.known["forces"], rtol=1e-12)
    monkeypatch.setattr(result, "find_solutions", lambda *_: both[kept : kept + 1])
    one = both[kept]
    values = {
        **dict.fromkeys(EFFORTS, one.effort),
        "wrench": one.wrench,
        "normal_load": one.normal_load,
        "friction_lower": one.friction,
        "friction_upper": one.friction,
    }
    for status in (Status.CONVERGED, Status.AMBIGUOUS):
        check = judge(spoiled(found, 0, status, **values))
        assert (check.wrong_status, check.passed()) == (1, False)


def test_a_third_solution_is_part_of_the_range_of_friction():
    """Between the two that starts far out lead to, with the least friction of all at pin B."""
    case = turning_four_bar(60, rate=6.0, acceleration=3.0, friction=pin_friction(2.0, 0.1))
    one = Case(case.scene, case.q[30:31], case.v[30:31], case.a[30:31]).inverse()
    least = min(abs(solution.friction[3]) for solution in one.solutions(0))
    assert min(abs(one.friction_lower[0, 3]), abs(one.friction_upper[0, 3])) == pytest.approx(least)
    assert judge(one).passed(1e-12)


@pytest.mark.parametrize("acceleration", [-12.0, -7.5, -2.0, 0.0, 1.0])
@pytest.mark.parametrize("mu", [0.1, 0.4999, 0.5001, 0.6, 2.0])
def test_drawers_end_as_their_closed_form_says(mu, acceleration):
    case = jamming_drawer(mu, acceleration)
    count = len(drawer_forces(mu, acceleration))
    right = (Status.JAMMED, Status.CONVERGED, Status.AMBIGUOUS)[count]
    found = case.inverse()
    assert found.status[0] == right
    check = judge(found)
    assert (check.wrong_status, check.undecided, check.passed(1e-8)) == (0, mu > 0.5, True)


@pytest.mark.parametrize("name", FALSE)
@pytest.mark.parametrize("situation", SITUATIONS)
def test_a_false_field_is_noticed(situation, name):
    found = SITUATIONS[situation]().inverse()
    assert judge(found).passed(1e-11), judge(found)
    if (false := falsified(found, name)) is not None:
        check = judge(false)
        assert (check.passed(), check.sample) == (False, 0)


@pytest.mark.parametrize("name", ["friction_lower", "friction_upper", "wrench", "normal_load"])
def test_a_field_of_an_ambiguous_sample_that_is_a_millionth_off_is_noticed(name):
    found = decelerating_drawer().inverse()
    assert found.status[0] == Status.AMBIGUOUS
    getattr(found, name)[0] *= 1.0 + 1e-6
    assert not judge(found).passed()


def test_a_robot_without_friction_is_checked():
    """A worm hoist with friction only in the gear: it ended in a ValueError."""
    gear = {"ratio": 50.0, "efficiency": 0.4, "back_efficiency": -0.2}
    model = chain(("lift", pin.JointModelPZ(), lump(10.0)))
    scene = pf.Scene(model=model, actuators=[{"joint": "lift", "transmission": gear}])
    found = pf.inverse_dynamics(scene, *np.zeros((3, 1, 1)))
    assert judge(found).passed()
    wrong = replace(found, effort_lower=found.effort_lower + 1.0)
    assert not judge(wrong).passed()
