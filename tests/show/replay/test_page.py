"""The page: one file that fetches nothing."""

from __future__ import annotations

import pytest
from replay_cases import result_of

import pinfric as pf
from pinfric.errors import PinfricError

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def test_page_is_one_file_that_fetches_nothing(three_link, tmp_path):
    import re

    scene, result = three_link
    shown = pf.replay(scene, result, html=tmp_path / "deep" / "out.html", title="a < b & </script>")
    page = shown.html.read_text()
    assert page == shown.page
    assert "<title>a &lt; b &amp; &lt;/script&gt;</title>" in page
    ours = page.replace(page[page.index("<script>") : page.index('<script type="application')], "")
    assert not re.search(r"""(src|href)=["'](?!data:)|https?://|@import|fetch\(""", ours)
    assert ours.count("</script>") == 4  # data, commands, frames, ours
    assert not list((tmp_path / "deep").glob(".unfinished*"))
    assert (shown.frames, shown.duration) == (179, pytest.approx(2.9))


@pytest.mark.slow
def test_pages_of_the_bundled_robots_stay_below_6_mb(tmp_path):
    for name in ("panda_pick_and_place", "so101"):
        scene, result = result_of(name)
        shown = pf.replay(scene, result)
        assert 1e6 < len(shown.page) < 6e6
        assert shown.html is None


def test_page_that_cannot_be_written_is_one_clear_error(three_link, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PinfricError, match="cannot be written"):
        pf.replay(*three_link, html=tmp_path / "file" / "out.html")
