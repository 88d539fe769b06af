"""The guide's trajectory optimization: fewer losses, and torques that reach the tip's goal."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.mark.slow
def test_the_guides_optimization_reaches_its_goal_in_exact_stick_slip():
    page = (ROOT / "notebooks/guide/optimize.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    before, after, off = map(float, re.findall(r"[\d.]+(?= ->| N| mm)", run.stdout))
    assert after < 0.5 * before
    assert off < 5.0
