"""Rooms, tests and tools keep within their budgets of tokens; a larger number says why."""

from __future__ import annotations

import tokenize
import tomllib
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
#: Since Python 3.12 a formatted string is many tokens, from a start to an end; it counts as one.
STARTS, ENDS = (getattr(tokenize, f"FSTRING_{end}", None) for end in ("START", "END"))
#: What is counted whole -> its folders; `package` is the sum of the rooms.
WHOLE = {
    "tests": ("tests",),
    "tools_and_benchmarks": ("tools", "benchmarks"),
    "scripts_of_notebooks": ("notebooks",),
}
COUNTED = {tokenize.NAME, tokenize.OP, tokenize.NUMBER, tokenize.STRING, STARTS}


def tokens_of(file):
    """Python tokens of a file."""
    count, within = 0, 0
    with file.open("rb") as opened:
        for token in tokenize.tokenize(opened.readline):
            count += within == 0 and token.type in COUNTED
            within += (token.type == STARTS) - (token.type == ENDS)
    return count


def tokens():
    """Python tokens of each room, of the modules beside them (`top`), and of all in `WHOLE`."""
    found = Counter()
    for file in (ROOT / "pinfric").rglob("*.py"):
        place = file.relative_to(ROOT / "pinfric").parts
        found[place[0] if len(place) > 1 else "top"] += tokens_of(file)
    found["package"] = found.total()
    for name, folders in WHOLE.items():
        found[name] = sum(
            tokens_of(file) for folder in folders for file in (ROOT / folder).rglob("*.py")
        )
    return found


@pytest.mark.slow
def test_no_room_has_more_tokens_than_its_budget():
    """After a change: raise a number in pyproject.toml, and say in the commit what it bought."""
    budget = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pinfric"]["tokens"]
    found = tokens()
    assert found.keys() == budget.keys()
    assert {room: n for room, n in found.items() if n > budget[room]} == {}
