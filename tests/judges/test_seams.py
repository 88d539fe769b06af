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
    sys.path[:0] = [str(Path(__file__).parents[1] / end) for end in ("", "helpers")]
    warnings.simplefilter("ignore")  # of scenes that helpers make

import pytest
from judges.ledger import Ledger
from judges.seams_of_commands import (
    MISTAKES,
    judge_explained,
    judge_identified,
    judge_masses,
    judge_mistakes,
    judge_new,
    judge_rating,
    judge_route,
)
from judges.seams_of_robots import judge_changed
from judges.seams_of_states import judge_massless, judge_states

import pinfric as pf

DATA = "example-robot-data:"

#: Case -> function of a ledger and an empty folder.
FAST = {
    f"states of {name}": partial(judge_states, name)
    for name in ("ur10_machine_tending", "scara", "gantry", "excavator", "four_bar", "delta")
}
FAST |= {
    f"changed {name}": partial(judge_changed, name) for name in ("scara", "gantry", "excavator")
}
FAST |= {
    f"scara with {mistake}": partial(judge_mistakes, "scara", mistakes=[mistake])
    for mistake in ("limits in degrees", "a centre of mass outside")
}
FAST |= {
    f"files of size of {name}": partial(judge_route, name, quick=True)
    for name in ("pendulum", "four_bar")
}
FAST |= {"a joint without mass": judge_massless}

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
NIGHTLY |= {
    f"{name} with {mistake}": partial(judge_mistakes, name, mistakes=[mistake])
    for name in ("scara", "gantry", "three_link")
    for mistake in MISTAKES
}
NIGHTLY |= {
    f"route of {name}": partial(judge_route, name)
    for name in (
        *("pendulum", "gantry", "four_bar", "scara", "so101", "excavator", "delta", "drawer"),
        *("slider_crank", "three_link", "ur10_machine_tending", "ur5_pick_and_place"),
    )
}
NIGHTLY |= {
    "route of ur10_braked": partial(judge_route, "ur10_braked", cycle="ur10_machine_tending"),
    "route of ur10_machine_tending, rated": partial(
        judge_route, "ur10_machine_tending", words=("--rating", "payload=10")
    ),
    "so101 and its masses": partial(
        judge_masses, "so101", masses=("", "with_drives", "without_drives")
    ),
    "identified arm": judge_identified,
}
NIGHTLY |= {
    f"explained {name}": partial(judge_explained, name, loads="load")
    for name in ("four_bar", "slider_crank")
}
NIGHTLY |= {
    f"rating of {name}": partial(judge_rating, name, payload=payload, urdf=f"{DATA}{urdf}")
    for name, payload, urdf in (
        ("ur5", 5, "ur_description/urdf/ur5_robot.urdf"),
        ("z1", 2, "z1_description/urdf/z1.urdf"),
    )
}
NIGHTLY |= {
    f"new {urdf}": partial(judge_new, f"{DATA}{urdf}")
    for urdf in (
        "ur_description/urdf/ur3_joint_limited_robot.urdf",
        "z1_description/urdf/z1.urdf",
        "panda_description/urdf/panda.urdf",
        "kinova_description/robots/kinova.urdf",
        "double_pendulum_description/urdf/double_pendulum.urdf",
        "go2_description/urdf/go2.urdf",
        "solo_description/robots/solo12.urdf",
        "allegro_hand_description/urdf/allegro_left_hand.urdf",
        "finger_edu_description/robots/finger_edu.urdf",
        "laikago_description/urdf/laikago.urdf",
    )
}


#: Kind that is violated today -> why. Delete a line with what mends it.
OPEN = {
    "rating = its way-points": "as a cycle, the motion that `new` writes dilutes a rating",
    "retimed motion": "`retime` does not bound the loads of bearings, it says that they fail",
}


@pytest.mark.parametrize("case", FAST)
def test_answers_agree(case, tmp_path):
    expect(judged(FAST, case, tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("case", NIGHTLY)
def test_answers_agree_everywhere(case, tmp_path):
    expect(judged(NIGHTLY, case, tmp_path))


def expect(ledger):
    """Fail for what does not agree; where only open kinds do not, it is an expected failure."""
    why = {kind: [OPEN[x] for x in OPEN if kind.startswith(x)] for kind in ledger.violated}
    assert not [line for kind in why if not why[kind] for line in ledger.violated[kind]]
    if why:
        pytest.xfail("; ".join(sorted({reason for reasons in why.values() for reason in reasons})))


def judged(cases, case, folder):
    """What a case compared."""
    ledger = Ledger()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pf.PinfricWarning)  # what is said is compared, too
        cases[case](ledger, folder)
    assert ledger.tried
    return ledger


def main():
    """Print the table of the cases that the command line names."""
    words = [word for word in sys.argv[1:] if word != "--all"]
    cases = FAST | (NIGHTLY if "--all" in sys.argv else {})
    whole = Ledger()
    for case in cases:
        if not words or any(word in case for word in words):
            with tempfile.TemporaryDirectory() as folder:
                whole.add(judged(cases, case, Path(folder)))
    print(whole, *whole.failures(), sep="\n")
    return int(bool(whole.failures()))


if __name__ == "__main__":
    sys.exit(main())
