"""The fuzzer's short run, and that it notices faults (`python tools/fuzz.py`: long)."""

import os

import fuzz
import pytest

CASE = fuzz.Case({"arm.yaml": b""}, ["inverse", "arm.yaml", "way.yaml", "--json"], "scene of arm")
ERROR = "pinfric: error: arm.yaml: `pinfric` is missing\n"


@pytest.mark.slow
def test_a_short_run_finds_nothing():
    findings, counts = fuzz.fuzz(150, seed=0)
    assert findings == []
    assert set(counts) == fuzz.FOUND
    assert min(counts.values()) >= 20  # both are tried


@pytest.mark.parametrize(
    ("code", "out", "err", "found"),
    [
        (0, "{}", "", "exit 0"),
        (0, "{}", "pinfric: warning: arm.yaml: heavy\n", "exit 0"),
        (2, "", ERROR, "exit 2"),
        (2, "", "pinfric: warning: heavy\n" + ERROR, "exit 2"),
        (70, "", "pinfric: internal error: arm.yaml\n", "exit 70, 1 errors"),
        (2, "", "", "exit 2, 0 errors"),
        (2, "", ERROR * 2, "exit 2, 2 errors"),
        (2, "", ERROR + "  1. more\n", "raw text on stderr"),
        (2, "", ERROR.replace(" `", "\x1b[1m"), "raw text on stderr"),
        (2, "", "pinfric: error: something is wrong\n", "names no place"),
        (2, "", "pinfric: error: arm.yaml " + "x" * 9999 + "\n", "a line without end"),
        (0, "{}", "numpy/x.py:1: RuntimeWarning: overflow\n", "raw text on stderr"),
        (0, '{"joints": [{"peak": NaN}]}', "", "a number that is none"),
        (0, '{"peak": 1e999}', "", "a number that is none"),
        (0, "peak 1", "", "stdout is no JSON"),
        (
            0,
            '{"status": {"converged": 2}, "joints": [{"name": "a", "peak": null, "rms": 1}]}',
            "",
            "null without a reason",
        ),
    ],
)
def test_what_is_a_finding(code, out, err, found):
    assert fuzz.verdict(CASE, code, out, err)[0] == found


def test_a_death_and_a_hang_are_told_by_their_case(monkeypatch):
    worker = fuzz.Worker()
    script = (
        "import os, sys, time\nfor line in sys.stdin: os.abort() if '7' in line else time.sleep(9)"
    )
    monkeypatch.setattr(worker, "_start", lambda: _begin(worker, script))
    assert worker.run(7)[:2] == [7, "the interpreter died (-6)"]
    monkeypatch.setattr(fuzz, "LIMIT", 0.3)
    assert worker.run(1)[:2] == [1, "no end in 0.3 s"]
    assert worker.process is None


def _begin(worker, script):
    worker.process = fuzz.subprocess.Popen(
        [fuzz.sys.executable, "-c", script],
        stdin=fuzz.subprocess.PIPE,
        stdout=fuzz.subprocess.PIPE,
        text=True,
        env=dict(os.environ),
    )


def test_a_case_depends_on_its_seed_alone():
    maker = fuzz.Maker()
    first = [maker.case(seed) for seed in range(20)]
    again = [maker.case(seed) for seed in reversed(range(20))][::-1]
    assert first == again
    assert len({(*sorted(case.files.items()), *case.arguments) for case in first}) == 20


def test_a_base_that_is_refused_is_said():
    """Before, an unmutated log was refused, so that no mutation of logs was ever read."""
    maker = fuzz.Maker()
    read = {case.arguments[2] for case in maker.bases() if case.arguments[0] == "inverse"}
    assert read >= {f"motion.{ending}" for ending in fuzz.LOGS}
    maker.robots = {"arm": ({}, *maker.robots["arm"][1:])}
    with pytest.raises(AssertionError, match="not mutated: exit 2: "):
        maker.check_bases()
