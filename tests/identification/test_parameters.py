"""Coefficients under the keys of a scene."""

from types import SimpleNamespace

import numpy as np
import pytest
from identify_cases import (
    COULOMB,
    NAMES,
    excitation,
    guess,
    motor_effort,
    truth,
)

import pinfric as pf
from pinfric.identification.files import posterior_text
from pinfric.identification.laws import SLOT, SLOTS, Law
from pinfric.identification.parameters import _rest_excess


def test_a_joint_that_moves_one_way_has_the_same_friction_the_other_way():
    motion = excitation(0, 20.0, 100.0)
    t = motion.t
    motion.q[:, 5] = 0.3 * t - 0.25 * np.cos(0.8 * t)
    motion.v[:, 5], motion.a[:, 5] = 0.3 + 0.2 * np.sin(0.8 * t), 0.16 * np.cos(0.8 * t)
    log = pf.Log(t, motion.q, motor_effort(truth(), motion))
    found = pf.identify(guess(0), log, laws=dict.fromkeys(NAMES, Law()))
    assert (
        "hardly slides backward, the Coulomb friction of the other direction is used: "
        f"{NAMES[5]}" in found.notes
    )
    assert not any((p.joint, p.name) == (NAMES[5], "coulomb.negative") for p in found.parameters)
    coulomb = found.scene.friction[NAMES[5]].coulomb
    assert coulomb.negative == coulomb.positive
    assert coulomb.positive.kinetic == pytest.approx(COULOMB[5][0], rel=0.05)
    assert all(np.isfinite(x) for one in found.advice for x in one.factors.values())
    ways = [f"friction.{NAMES[5]}.coulomb.{way}" for way in ("positive", "negative")]
    assert (found.posterior[ways[0]] == found.posterior[ways[1]]).all()
    assert np.ptp(found.posterior[ways[0]]) > 0.0
    assert ways[1] in posterior_text(found).splitlines()[0].split(",")


@pytest.mark.parametrize(
    ("exponent", "speed"), [(None, 0.0), (1.0, 0.0), (0.8, 0.01), (0.67, 0.01), (0.33, 0.1)]
)
def test_friction_that_rises_steeply_from_rest_holds_what_slow_sliding_shows(exponent, speed):
    """Before, exponents above a half had none: 97.1 % of a lift's holds were inside, not 98.5 %."""
    law, rows = Law(exponent=exponent), SimpleNamespace(velocity=np.full(9, 0.1))
    slots = 20.0 * (np.arange(len(SLOTS)) == SLOT.get(law.speed, -1))
    expected = 20.0 * speed ** (exponent or 1.0)
    assert _rest_excess(rows, law, slots) == pytest.approx(expected, rel=1e-12)
