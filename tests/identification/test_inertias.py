"""Inertias of links: physically possible, or kept."""

import numpy as np
import pinocchio as pin
import pytest
from identify_cases import (
    NAMES,
    guess,
    short,
    truth,
)

import pinfric as pf
from pinfric.identification.laws import Law


def test_corrected_links_can_exist(found):
    for inertia in tuple(found.scene.model.inertias)[1:]:
        pseudo = pin.PseudoInertia.FromInertia(inertia).toMatrix()
        assert np.linalg.eigvalsh(pseudo)[0] > 0.0
    masses = [inertia.mass for inertia in tuple(found.scene.model.inertias)[1:]]
    guessed = [inertia.mass for inertia in tuple(guess(0).model.inertias)[1:]]
    assert masses != pytest.approx(guessed)


def test_kept_inertias_stay_and_an_effort_behind_the_gear_needs_no_rotor():
    laws = dict.fromkeys(NAMES, Law())
    found = pf.identify(truth(), short(), inertia="keep", effort_at="joint", laws=laws)
    assert found.scene.model == truth().model
    assert all(p.section == "friction" for p in found.parameters)
    assert "inertias were kept" in "\n".join(found.notes)
