"""Coefficients under the keys of a scene."""

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
from pinfric.study.identify.files import posterior_text
from pinfric.study.identify.laws import Law


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
