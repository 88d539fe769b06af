"""What `result.check()` notices; what only `tests/judges` does is in `judges/test_verdict.py`."""

from __future__ import annotations

import pytest
from judges.falsified import FALSE, SITUATIONS, falsified

#: What must be proved, not recomputed: `judges.verdict` does.
UNSEEN = {"interval_exact"}


@pytest.mark.parametrize("situation", SITUATIONS)
def test_false_fields_are_noticed(situation):
    found = SITUATIONS[situation].inverse()
    assert found.check().passed(1e-12), found.check()
    false = {name: falsified(found, name) for name in FALSE}
    false = {name: result for name, result in false.items() if result is not None}
    assert len(false) == 16 - (situation == "tree") - (situation in ("jammed", "ambiguous"))
    assert {name for name, result in false.items() if result.check().passed()} == UNSEEN
