"""The judge's enumeration of states at rest."""

from __future__ import annotations

from cases import (
    four_bars_in_a_row,
)

from pinfric.dynamics.judge import states as check_states


def test_ten_pins_at_rest_are_searched_where_there_are_too_many_to_enumerate(monkeypatch):
    case = four_bars_in_a_row(1, radius=0.03)
    found = case.inverse()
    assert found.check().passed(1e-11), found.check()
    monkeypatch.setattr(check_states, "_ENUMERATED", 100)
    assert found.check().passed(1e-11)
    assert found.check().undecided == 1
    found.effort_upper[:] *= 1 - 1e-6
    assert not found.check().passed()
