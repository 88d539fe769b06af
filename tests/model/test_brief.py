"""Short texts about an object."""

from __future__ import annotations

from pinfric.model.brief import screen


def test_a_screen_keeps_its_width_whatever_it_is_told():
    text = screen("Thing", "word " * 100, {"fact": "x" * 500, "none": "", "many": "a b " * 300})
    assert max(map(len, text.splitlines())) <= 100
    assert len(text.splitlines()) <= 6
    assert "none" not in text
