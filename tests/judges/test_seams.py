"""One question, one answer: what public functions and commands say of the same thing must agree.

    python tests/judges/test_seams.py [--all] [WORD ...]

prints what was compared, by kind, and what did not agree; `--all` with what runs at night, a word
picks the cases whose names hold it.
"""

import sys
import tempfile
import warnings
from functools import partial
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).parents[k] / end) for k, end in ((1, ""), (1, "helpers"))]

import pytest
from judges.ledger import Ledger
from judges.seams_of_robots import judge_changed
from judges.seams_of_states import judge_states

#: Case -> function of a ledger and an empty folder.
FAST = {
    f"states of {name}": partial(judge_states, name)
    for name in ("ur10_machine_tending", "scara", "gantry", "excavator", "four_bar", "delta")
}
FAST |= {
    f"changed {name}": partial(judge_changed, name) for name in ("scara", "gantry", "excavator")
}
NIGHTLY = {
    f"states of {name}": partial(judge_states, name, count=12)
    for name in (
        *("panda_pick_and_place", "ur5_pick_and_place", "so101", "three_link", "pendulum"),
        *("drawer", "slider_crank", "ur10_braked", "kr300", "fr3", "ur5e"),
    )
}
NIGHTLY |= {
    f"changed {name}": partial(judge_changed, name)
    for name in ("four_bar", "delta", "slider_crank", "drawer", "pendulum", "three_link")
}


@pytest.mark.parametrize("case", FAST)
def test_answers_agree(case, tmp_path):
    assert not judged(FAST, case, tmp_path).failures()


@pytest.mark.slow
@pytest.mark.parametrize("case", NIGHTLY)
def test_answers_agree_everywhere(case, tmp_path):
    assert not judged(NIGHTLY, case, tmp_path).failures()


def judged(cases, case, folder):
    """What a case compared."""
    ledger = Ledger()
    cases[case](ledger, folder)
    assert ledger.tried
    return ledger


def main():
    """Print the table of the cases that the command line names."""
    words = [word for word in sys.argv[1:] if word != "--all"]
    cases = FAST | (NIGHTLY if "--all" in sys.argv else {})
    whole = Ledger()
    warnings.simplefilter("ignore")
    for case in cases:
        if not words or any(word in case for word in words):
            with tempfile.TemporaryDirectory() as folder:
                whole.add(judged(cases, case, Path(folder)))
    print(whole, *whole.failures(), sep="\n")
    return int(bool(whole.failures()))


if __name__ == "__main__":
    sys.exit(main())
