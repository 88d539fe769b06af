"""Candidate laws of joints: gears' losses, joints that never move."""

import pytest
from identify_cases import (
    BACK_EFFICIENCY,
    EFFICIENCY,
    NAMES,
    guess,
    parameter,
    short,
    truth,
)

import pinfric as pf
from pinfric.identification.laws import Law


def test_both_losses_of_a_gear_show_where_masses_are_known():
    gear = Law(load="gear", both_ways=False)
    laws = dict.fromkeys(NAMES, Law()) | {NAMES[1]: gear, NAMES[2]: Law(load="bearing")}
    found = pf.identify(truth(), short(), inertia="keep", laws=laws)
    drives, driven = (
        parameter(found, "transmission", 1, name).value
        for name in ("efficiency", "back_efficiency")
    )
    assert drives == pytest.approx(EFFICIENCY, abs=0.01)
    assert driven == pytest.approx(BACK_EFFICIENCY, abs=0.02)
    transmission = found.scene.drives[1].transmission
    assert (transmission.efficiency, transmission.back_efficiency) == pytest.approx(
        (drives, driven), rel=1e-5
    )


def test_a_joint_that_never_moves_keeps_what_the_scene_says():
    laws = dict.fromkeys(NAMES, Law())
    found = pf.identify(guess(1), short(still=(2,)), laws=laws)
    assert f"keeps the scene's friction: {NAMES[2]}" in "\n".join(found.notes)
    assert found.scene.friction[NAMES[2]] == guess(1).friction[NAMES[2]]
    assert all(p.joint != NAMES[2] for p in found.parameters)
