"""The identification page."""

import pytest
from identify_cases import NAMES

from pinfric.show.pages.identification import identification_page


def test_the_page_shows_every_joint_its_laws_and_what_is_left(found):
    pytest.importorskip("jinja2")
    page = identification_page(found)
    for k, name in enumerate(NAMES):
        assert f'<figure id="time-{k}"><svg role="img"' in page
        assert f'<figure id="velocity-{k}"><svg role="img"' in page
        assert f"{name.removesuffix('_joint')}: {found.laws[name]}" in page.replace("&#39;", "'")
    assert "one log only" in page
    assert "overflow-wrap: break-word" in page  # keys in lists of them are wider than a phone
    assert "<script" not in page
    assert "https://" not in page
