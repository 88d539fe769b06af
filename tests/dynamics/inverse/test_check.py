"""Errors that `result.check()` notices; `judges/test_verdict.py` has those of the judge alone."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from builders import random_states, scene_of
from cases import Case, ball_tripod, slider_crank, turning_four_bar
from judges.falsified import FALSE, SITUATIONS, falsified

import pinfric as pf
from pinfric.dynamics.inverse import interval_ends, linkage, solutions
from pinfric.dynamics.inverse.check import Residual

#: A field, and whether `check` sees that it is false; `judges.verdict` sees all of them.
SEEN = dict.fromkeys(FALSE, True) | {"interval_exact": False}


@pytest.mark.parametrize("situation", SITUATIONS)
def test_false_fields_are_noticed(situation):
    found = SITUATIONS[situation]().inverse()
    assert found.check().passed(1e-12), found.check()
    false = {name: falsified(found, name) for name in SEEN}
    seen = {name: not x.check().passed() for name, x in false.items() if x is not None}
    assert seen.items() <= SEEN.items()
    loops = situation in ("singular", "turning", "resting")
    assert len(seen) == 15 + loops  # of 93, 87 are seen


def resting_tripod():
    case = ball_tripod()
    return Case(case.scene, case.q[:1], 0 * case.v[:1], 0 * case.a[:1])


def arm():
    scene = scene_of(3)
    return Case(scene, *random_states(scene.model, 3, 2))


def excavator():
    scene = pf.load_scene("excavator")
    motion = pf.load_trajectory("excavator", scene)
    few = np.array([0, len(motion.t) // 3])
    return Case(scene, motion.q[few], motion.v[few], motion.a[few])


CASES = {
    **{name: SITUATIONS[name] for name in ("ambiguous", "turning", "resting", "tree")},
    "balls": resting_tripod,
    "cylinders": excavator,
    "slider": partial(slider_crank, np.array([0.4, 2.0])),
    "arm": arm,
}
FIELDS = (
    *("effort_lower", "effort_upper", "effort_frictionless", "friction_lower", "friction_upper"),
    *("normal_load", "wrench", "multipliers", "actuator_velocity", "actuator_acceleration"),
    "contraction",
)


@pytest.mark.parametrize("name", CASES)
def test_a_figure_that_is_a_millionth_off_is_noticed_where_it_is(name):
    found = CASES[name]().inverse()
    assert found.check().passed(1e-12), found.check()
    for field in FIELDS:
        values = getattr(found, field)
        largest = 0.0 if values is None else np.abs(values).max(initial=0.0)
        for place in [] if largest == 0.0 else np.argwhere(np.abs(values) > 1e-3 * largest):
            false = values.copy()
            false[tuple(place)] *= 1.0 + 1e-6
            check = replace(found, **{field: false}).check()
            assert not check.passed(1e-12), (field, place)
            kinds = [one for one in vars(check).values() if isinstance(one, Residual)]
            samples = [max(kinds).sample, *check.wrong]
            assert place[0] in samples, (field, place)


def test_a_solver_that_errs_by_a_millionth_is_noticed(monkeypatch):
    """It repeats its error where a sample is solved again: only the equations show it."""
    friction_laws, loop_wrenches = interval_ends.friction_laws, linkage.loop_wrenches

    def wrong_laws(*given):
        law = friction_laws(*given)
        law.mu[:] *= 1.0 + 1e-6
        return law

    case = turning_four_bar(3)
    with monkeypatch.context() as broken:
        broken.setattr(interval_ends, "friction_laws", wrong_laws)
        check = case.inverse().check()
    assert check.laws.size > 1e-9 > 1e-12 > check.equilibrium.size
    for module in (linkage, solutions):
        monkeypatch.setattr(module, "loop_wrenches", lambda *x: (1.0 + 1e-6) * loop_wrenches(*x))
    assert case.inverse().check().equilibrium.size > 1e-9
