"""Notes: what was read, and what the log cannot tell."""

import numpy as np
from identify_cases import (
    NAMES,
    Motion,
    excitation,
    guess,
    motor_effort,
    short,
    truth,
)

import pinfric as pf
from pinfric.identification.laws import Law


def test_what_was_read_and_what_the_log_cannot_tell_is_said(found):
    said = "\n".join(found.notes)
    assert "left out 2 rows of 7500" in said
    assert "one log only" in said
    assert "never rests" in said
    line = next(line for line in found.notes if line.startswith("the load hardly changes"))
    assert NAMES[5] in line
    assert NAMES[1] not in line
    assert "never fast" not in said
    assert np.isnan(list(found.spread.values())).all()


def test_a_log_that_never_is_fast_says_that_speeds_are_extrapolated():
    fast = excitation(0, 20.0, 100.0)
    motion = Motion(10.0 * fast.t, fast.q, fast.v / 10.0, fast.a / 100.0)
    noise = short().effort - motor_effort(truth(), fast)
    slow = pf.Log(motion.t, short().q, motor_effort(truth(), motion) + noise)
    found = pf.identify(guess(0), slow, inertia="keep", laws=dict.fromkeys(NAMES, Law()))
    line = next(line for line in found.notes if line.startswith("never fast"))
    assert NAMES[1] in line
    # what is slow tells no delay either
    assert found.delay == 0.0
    assert found.estimate.delay.standard_error > 0.005
    assert "the delay of the efforts is not determined" in "\n".join(found.notes)
