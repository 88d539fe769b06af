"""A motor constant from logs with and without a known payload."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from identify_cases import NAMES, PLAIN, excitation, guess, logged, motor_effort, truth

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.summary import identify_summary

ELBOW = 2
BOX = {"link": "tool0", "mass": 4.0, "com": (0.0, 0.0, 0.1), "inertia": (0.02, 0, 0, 0.02, 0, 0.02)}


@cache
def with_and_without():
    """Logs of a UR5 that carries nothing, then 4 kg; the masses of `guess` are wrong."""
    logs = []
    for seed, name, payloads in ((80, "empty", {}), (81, "loaded", {"box": BOX})):
        scene, motion = truth(), excitation(seed, 40.0, 125.0)
        effort = motor_effort(scene.with_(payloads=payloads), motion)
        logs.append(logged(seed, motion, effort, name))
    return logs


def identified(factors, robot=None, **more):
    scene = (robot or guess(80)).with_(payloads={"box": BOX | {"attached": False}})
    logs = [replace(one, effort=one.effort * factors) for one in with_and_without()]
    payloads = {"empty": "none", "loaded": "box"}
    return pf.identify(scene, logs, laws=PLAIN, payloads=payloads, **more)


@pytest.mark.slow
@pytest.mark.parametrize("factors", [{}, {1: 1.2, 2: 1.3}], ids=["right", "wrong"])
def test_factors_are_in_their_intervals_and_wrong_ones_are_doubted(factors):
    """Both at once, where other joints' efforts would contradict neither alone."""
    given = np.array([factors.get(j, 1.0) for j in range(6)])
    found = identified(given)
    known = {x.name: x for x in identify_summary(found).effort_factors}
    assert {NAMES[1], NAMES[2]} <= known.keys()
    for name, factor in known.items():
        true = given[NAMES.index(name)]
        assert abs(factor.value - true) < 4.0 * factor.standard_error
        assert factor.wrong == (true != 1.0)
    assert known[NAMES[1]].high - known[NAMES[1]].low < 0.1
    said = [line for line in found.doubts if "by the known payload" in line]
    assert len(said) == bool(factors)
    assert all(NAMES[j] in line for line in said for j in factors)


@pytest.mark.slow
def test_where_all_logs_carry_it_nothing_is_said():
    scene = guess(80).with_(payloads={"box": BOX | {"attached": False}})
    found = pf.identify(scene, with_and_without()[1], laws=PLAIN, payloads={"loaded": "box"})
    assert found.effort_factors == ()


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "inertia"), [(1.5, "keep"), (2.5, "consistent"), (0.4, "keep")])
def test_what_was_refused_without_a_payload_is_a_factor_with_one(factor, inertia):
    """Of kept masses the weight, of free ones a slope: neither is asked where the payload tells."""
    given = np.array([factor if j == ELBOW else 1.0 for j in range(6)])
    alone = replace(with_and_without()[0], effort=with_and_without()[0].effort * given)
    with pytest.raises(IdentificationError, match=f"{NAMES[ELBOW]}: its effort"):
        pf.identify(truth(), alone, laws=PLAIN, inertia=inertia)
    found = identified(given, truth(), inertia=inertia)
    (elbow,) = (x for x in found.effort_factors if x.name == NAMES[ELBOW])
    assert elbow.low < factor < elbow.high < 1.1 * elbow.low
    (said,) = (line for line in found.doubts if "by the known payload" in line)
    assert f"{NAMES[ELBOW]} {elbow.value:.3g} [{elbow.low:.3g}, {elbow.high:.3g}]" in said
