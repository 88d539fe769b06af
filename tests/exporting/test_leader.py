"""The guide's leader arm: light in the hand, loaded and slow."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "notebooks/guide/leader.md").read_text(encoding="utf-8")


def lines(text):
    """Each line's words and its figures."""
    return [
        (re.sub(r"[\d.]+", "#", line), [float(x) for x in re.findall(r"[\d.]+", line)])
        for line in text.splitlines()
    ]


def test_the_code_is_one_screen():
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert len(code.splitlines()) <= 75


@pytest.mark.slow
def test_the_page_prints_what_it_shows():
    pytest.importorskip("mujoco")
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    (shown,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    found, known = lines(run.stdout), lines(shown)
    assert [words for words, _ in found] == [words for words, _ in known]
    for (_, figures), (_, expected) in zip(found, known, strict=True):
        assert figures == pytest.approx(expected, rel=0.05, abs=1e-3)
    (_, [_, stuck]), (_, [_, guided]), (_, [_, sunk]), (_, [_, held]), *slow = found
    assert guided > 5.0 * stuck
    assert held < 0.01 < sunk
    none, switch, hold = (figures[0] for _, figures in slow)
    assert hold < switch < none / 10.0
