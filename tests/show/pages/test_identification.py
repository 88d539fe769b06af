from dataclasses import replace

import pytest
from identify_cases import NAMES

from pinfric.identification.summary import identify_summary
from pinfric.show.pages.identification import identification_page
from pinfric.show.report.identify import verdict


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


def test_the_page_shows_the_delay_that_was_taken_where_logs_do_not_tell_it(found):
    pytest.importorskip("jinja2")
    for value in (0.0062, 0.0):
        delay = replace(found.estimate.delay, value=value, standard_error=0.004)
        vague = replace(found, estimate=replace(found.estimate, delay=delay))
        head = identification_page(vague).split('class="facts"', 1)[1]
        assert f"<b>{1e3 * value:.1f} ms</b><span>taken as delay of the efforts: not" in head


@pytest.mark.slow
def test_the_page_begins_with_what_contradicts_the_result(found):
    """The verdict and each doubt come before the figures."""
    pytest.importorskip("jinja2")
    doubt = "the zero of elbow_joint is off by 0.2 rad"
    doubted = replace(found, doubts=(doubt,), notes=(doubt, *found.notes))
    page = identification_page(doubted)
    head, rest = page.split('class="facts"', 1)
    assert f"{verdict(identify_summary(doubted))}.".endswith("; 1 doubt.")
    assert f"{verdict(identify_summary(doubted))}." in head
    assert f'class="alarm small">{doubt.replace("_joint", "")}' in head
    assert "is off by 0.2 rad" not in rest  # said once
    assert "one log only" in rest
