"""The enumeration of states at rest."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases import four_bars_in_a_row, jamming_drawer
from judges import enumeration

from pinfric.dynamics.samples.outcome import Status


@pytest.mark.parametrize("acceleration", [-12.0, -7.5, -2.0, 0.0, 1.0])
@pytest.mark.parametrize("mu", [0.1, 0.4999, 0.5001, 0.6, 2.0])
def test_the_states_of_drawers_are_proved(mu, acceleration):
    check = jamming_drawer(mu, acceleration).inverse().check()
    assert (check.wrong_status, check.undecided, check.passed(1e-8)) == (0, 0, True)


def test_efforts_in_place_of_a_jam_are_a_wrong_status():
    jam = jamming_drawer(0.6, 1.0).inverse()
    assert (jam.status[0], jam.check().undecided) == (Status.JAMMED, 0)
    right = jamming_drawer(0.49, 1.0).inverse()
    assert replace(right, scene=jam.scene).check().wrong_status == 1


def test_ten_pins_at_rest_are_searched_where_there_are_too_many_to_enumerate(monkeypatch):
    case = four_bars_in_a_row(1, radius=0.03)
    found = case.inverse()
    assert found.check().passed(1e-11), found.check()
    monkeypatch.setattr(enumeration, "_ENUMERATED", 100)
    assert found.check().passed(1e-11)
    assert found.check().undecided == 1
    found.effort_upper[:] *= 1 - 1e-6
    assert not found.check().passed()
