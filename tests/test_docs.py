"""The documentation says what there is: public names, and nothing outside the repository.

`sphinx-build -W` builds the pages (in `.ci/run`); what it cannot know is compared here, without it.
"""

from __future__ import annotations

import re
from pathlib import Path

import pinfric as pf

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "notebooks"


def test_every_public_name_is_on_the_page_of_names():
    page = (PAGES / "reference" / "python.md").read_text(encoding="utf-8")
    shown = re.findall(r"^\.\. auto(?:function|class|exception):: pinfric\.(\w+)$", page, re.M)
    assert sorted([*shown, "__version__"]) == sorted(pf.__all__)
    assert "`pf.__version__`" in page
