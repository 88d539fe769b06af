"""Each room keeps within its budget of tokens: what raises a number says what it bought."""

from __future__ import annotations

import tokenize
import tomllib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
COUNTED = {tokenize.NAME, tokenize.OP, tokenize.NUMBER, tokenize.STRING}


def tokens():
    """Python tokens of each room; the modules beside the rooms are one, `top`."""
    found = Counter()
    for file in (ROOT / "pinfric").rglob("*.py"):
        place = file.relative_to(ROOT / "pinfric").parts
        with file.open("rb") as opened:
            count = sum(token.type in COUNTED for token in tokenize.tokenize(opened.readline))
        found[place[0] if len(place) > 1 else "top"] += count
    return found


def test_no_room_has_more_tokens_than_its_budget():
    """After a change: raise a number in pyproject.toml, and say in the commit what it bought."""
    budget = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pinfric"]["tokens"]
    found = tokens()
    assert found.keys() == budget.keys()
    assert {room: n for room, n in found.items() if n > budget[room]} == {}
