"""Zeros of angles that are off by a quarter turn."""

import re
from dataclasses import replace

import numpy as np
import pytest
from identify_cases import (
    NAMES,
    guess,
    log,
    short,
)

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.laws import Law
from pinfric.identification.zeros import turned_zeros


def test_masses_or_loads_tell_a_zero_that_is_off_by_a_quarter_turn():
    laws = dict.fromkeys(NAMES, Law())

    def turned(joint: int, angle: float) -> pf.Log:
        return replace(short(), q=short().q + angle * (np.arange(6) == joint))

    line = next(
        line
        for line in pf.identify(guess(0), turned(3, np.pi / 2), laws=laws).notes
        if line.startswith("masses that differ from the URDF's by more than 50 %")
    )
    assert NAMES[4] in line
    with pytest.raises(IdentificationError, match=f"{NAMES[1]}: its effort is"):
        pf.identify(guess(0), turned(2, -np.pi / 2), laws=laws)


@pytest.mark.parametrize("turn", [90, -90])
def test_a_wrong_zero_that_the_last_links_take_up_is_named(turn):
    """Masses move by less than a URDF is off by, and errors stay at 3 %; but another zero fits."""
    off = np.deg2rad(turn) * (np.arange(6) == 4)
    found = pf.identify(
        guess(0), replace(short(), q=short().q + off), laws=dict.fromkeys(NAMES, Law())
    )
    assert max(one.error / one.rms for one in found.errors.values()) < 0.05
    line = next(line for line in found.notes if "another zero" in line)
    assert f"%: {NAMES[4]} {-turn:+d} degrees;" in line


@pytest.mark.parametrize(("joint", "turn"), [(4, 0.2), (2, -0.2)])
def test_a_zero_that_is_off_by_a_little_is_named(joint, turn):
    """Of wrist 2 a turn of 0.2 rad itself is no better than the errors of its gain."""
    given = log(4, 60.0, 100.0)
    turned = replace(given, q=given.q + turn * (np.arange(6) == joint))
    found = pf.identify(guess(4), turned, laws=dict.fromkeys(NAMES, Law()))
    line = next(line for line in found.notes if "another zero" in line)
    degrees = float(re.search(rf"{NAMES[joint]} ([+-]\d+) degrees", line)[1])
    assert degrees == pytest.approx(-np.degrees(turn), abs=6.0)


def test_masses_are_said_beside_the_urdfs(found):
    line = next(line for line in found.notes if "kg in the URDF -> found" in line)
    for name, one in zip(NAMES, tuple(found.scene.model.inertias)[1:], strict=True):
        assert re.search(rf"{name} [\d.]+ -> {one.mass:.3g}", line)
    assert not any(line.startswith("masses that differ from the URDF's") for line in found.notes)
    assert turned_zeros(found.estimate) == ()
