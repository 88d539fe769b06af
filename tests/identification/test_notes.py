"""Notes: what was read, and what the log cannot show."""

from dataclasses import replace
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest
from identify_cases import (
    NAMES,
    PLAIN,
    Motion,
    excitation,
    guess,
    motor_effort,
    robot,
    short,
    truth,
)
from rich.console import Console

import pinfric as pf
from pinfric.identification.laws import BACKWARD
from pinfric.identification.notes import _of_rest
from pinfric.identification.rest import RestBound
from pinfric.identification.summary import identify_summary
from pinfric.show.report.identify import identify_report


def test_what_was_read_and_what_the_log_cannot_tell_is_said(found):
    said = "\n".join(found.notes)
    assert "left out 2 rows of 7500" in said
    assert "one log only" in said
    assert "never rests" in said
    line = next(line for line in found.notes if line.startswith("the load hardly changes"))
    assert NAMES[5] in line
    assert NAMES[1] not in line
    assert "never fast" not in said
    assert np.isnan(list(found.spread.values())).all()


def test_the_short_report_is_a_screen_with_all_doubts_and_the_long_one_has_all_notes(found):
    assert found.notes[: len(found.doubts)] == found.doubts
    summary = identify_summary(found)

    def printed(*options):
        console = Console(file=StringIO(), width=80)
        console.print(*identify_report(found, summary, *options), sep="\n")
        return console.file.getvalue()

    short_one, words = printed(False), " ".join(printed(False).split())
    assert len(short_one.splitlines()) < 40  # six joints, whose laws take two lines or more
    assert words.count("! ") == len(found.doubts)
    assert "-v; scene, page: --out FOLDER" in words
    assert "--out" not in printed(False, True)  # these files are written
    assert found.given
    assert all(line[:60] in words for line in found.given)
    assert "one log only" not in words
    assert "one log only" in " ".join(printed(True).split())


def test_what_holds_do_not_show_is_said_of_those_joints_alone():
    names = ("never", "held", "broke", "still")
    found = SimpleNamespace(scene=SimpleNamespace(joint_names=names))
    rest = {name: RestBound(2.0 * (name != "never"), 1.0, 1.0, 1.0, 0) for name in names}
    said = _of_rest(found, [0, 1, 2], rest, {(2, BACKWARD): None})
    assert list(said.values()) == [["never"], ["held"]]


def test_a_joint_whose_effort_is_a_models_is_named():
    """Its effort is that of the rigid body alone, and lags by nothing."""
    motion, effort = excitation(0, 20.0, 100.0), short().effort.copy()
    rigid = pf.inverse_dynamics(robot(), motion.q, motion.v, motion.a, t=motion.t)
    effort[:, 4] = rigid.effort_frictionless[:, 4]
    given = {"inertia": "keep", "laws": PLAIN}
    found = pf.identify(truth(), replace(short(), effort=effort), **given)
    (line,) = [line for line in found.doubts if "holds no friction" in line]
    assert line.endswith(f"(--without): {NAMES[4]}")


@pytest.mark.slow
def test_a_log_that_never_is_fast_says_that_speeds_are_extrapolated():
    fast = excitation(0, 20.0, 100.0)
    motion = Motion(10.0 * fast.t, fast.q, fast.v / 10.0, fast.a / 100.0)
    noise = short().effort - motor_effort(truth(), fast)
    slow = pf.Log(motion.t, short().q, motor_effort(truth(), motion) + noise)
    found = pf.identify(guess(0), slow, inertia="keep", laws=PLAIN)
    line = next(line for line in found.notes if line.startswith("never fast"))
    assert NAMES[1] in line
    # what is slow tells no delay either
    assert found.delay == 0.0
    assert found.estimate.delay.standard_error > 0.005
    assert "the delay of the efforts is not determined" in "\n".join(found.notes)
