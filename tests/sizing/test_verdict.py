"""One verdict: headline, tile, colour, table, signature, bill, JSON and exit code agree."""

import re
from dataclasses import replace
from functools import partial
from io import StringIO

import pytest
from rich.console import Console
from sizing_cases import GEAR, MOTOR, one_drive, sized_cycle, trapezoid, turntable

import pinfric as pf
from pinfric.checking.findings import error, note, warning
from pinfric.errors import SizingError
from pinfric.model.described import in_json
from pinfric.show.pages.sizing import sizing_page
from pinfric.show.report.bill import bill_of_materials
from pinfric.show.report.sizing import sizing_report
from pinfric.sizing.summary import sizing_summary

BRAKE = {
    "source": "invented",
    "grade": "R",
    "torque": 0.5,
    "torque_max": 0.7,
    "engage_time": 0.02,
    "stop_energy": 20.0,
    "rotor_inertia": 1e-5,
    "mass": 0.1,
}
STOPS = {"category": 0, "reaction_time": 0.01, "per_hour": 4}
#: What is changed -> state of the joint, tightest criterion or "", part of a failing line.
CASES = {
    "all passes": ({}, "can be signed", "", ""),
    "its drive": ({"peak_factor": 50.0}, "none", "peak torque", "none of 1 candidate fits"),
    "no brake": ({"brakes": {}}, "fails", "holding brake", "has no brakes, and table would"),
    "a stop": (
        {"brakes": {"B": BRAKE | {"stop_energy": None, "stops_per_hour": 2.0}}},
        "fails",
        "stop: brake stops in an hour",
        "brake stops in an hour: needs 4 1/h, has 2 1/h",
    ),
    "the bus": ({"supply_power": 1.0}, "can be signed", "", "bus: supply power: needs"),
    "a stop that is not known": (
        {"brakes": {"B": BRAKE | {"engage_time": None}}},
        "can be signed",
        "",
        "has no `engage_time`",
    ),
}


def sized(tmp_path, brakes=None, scene=None, **conditions):
    catalog = one_drive(tmp_path, MOTOR, GEAR, brakes={"B": BRAKE} if brakes is None else brakes)
    given = {"holding_brake": "all", **conditions}
    scene = scene or turntable().with_(stops=STOPS)
    return sized_cycle(catalog, scene, conditions=given, on_miss="ignore")


def assert_said_alike(report, state, line):
    """All outputs of a sizing of one joint agree."""
    verdict, signed = report.verdict, not line and state == "can be signed"
    fitted = int(state == "can be signed")
    assert (verdict.signed, verdict.fitted) == (signed, fitted)
    assert verdict.headline.startswith(f"{fitted} of 1 joints can be signed")
    console = Console(file=StringIO(), width=400)
    console.print(*sizing_report(report), sep="\n")
    said, page, found = (
        console.file.getvalue(),
        sizing_page(report),
        in_json(sizing_summary(report)),
    )
    assert verdict.headline in said
    (judged,) = (joint["verdict"] for joint in found["joints"])
    assert (found["verdict"]["signed"], judged["state"]) == (signed, state)
    assert ("<span>Signature</span>" in page) == signed
    assert ("Not to be signed" in page) == (not signed)
    tile = re.search(r'<div class="fact (\w+)"><b>(\d+) of 1</b><span>joints', page)
    assert tile.groups() == ("ok" if fitted else "bad", str(fitted))
    assert re.search(r'class="verdict (yes|no)"', page).group(1) == ("yes" if signed else "no")
    assert bool(bill_of_materials(report)) == bool(fitted)
    if signed:
        report.check()
        return
    assert any(line in text for text in verdict.failing)
    with pytest.raises(SizingError, match=re.escape(line)):
        report.check()


@pytest.mark.parametrize("case", CASES)
def test_whatever_fails_is_counted_coloured_and_returned_alike(tmp_path, case):
    changed, state, tightest, line = CASES[case]
    report = sized(tmp_path, **changed)
    assert_said_alike(report, state, line)
    (joint,) = report.verdict.joints
    least = min(
        (c.margin, c.name)
        for c in (*report.joints[0].installed.criteria, *report.standstills[0].criteria)
        if c.margin is not None and c.scaled
    )
    if report.screened is not None:
        own = ((c.margin, f"stop: {c.name}") for c in report.screened.criteria[0])
        least = min(least, *(one for one in own if one[0] is not None))
    assert (joint.margin, joint.tightest) == least
    assert joint.tightest == (tightest or joint.tightest)
    assert (joint.margin < 0) == bool(tightest)


@pytest.mark.parametrize("refused", [error, partial(warning, unsigned=True)])
def test_nothing_is_signed_against_a_finding(tmp_path, refused):
    """An error, or legs that hang: it is said in headline, table, page and JSON."""
    scene = turntable().with_(stops=STOPS)
    vars(scene)["findings"] = (refused("k", "link l", "1.4 m off", "its shapes are 0.2 m large"),)
    report = sized(tmp_path, scene=scene)
    line = "link l: 1.4 m off: its shapes are 0.2 m large"
    assert_said_alike(report, "provisional", line)
    assert report.verdict.failing == (line,)
    assert line in report.verdict.headline


def test_what_is_doubted_stands_on_the_page_to_sign(tmp_path):
    scene = turntable().with_(stops=STOPS)
    doubts = [warning("k", f"link {name}", "0.06 m off", "") for name in "ab"]
    vars(scene)["findings"] = (*doubts, note("k", "robot", "has no name", ""))
    report = sized(tmp_path, scene=scene)
    assert_said_alike(report, "can be signed", "")
    said = "link a: 0.06 m off; also b"
    assert report.verdict.remarks == (said,)
    assert said in sizing_page(report)


@pytest.mark.parametrize(
    ("limit", "says"),
    [("velocityLimit", "table moves at 1.5 rad/s; the URDF allows 1.4"), ("", "")],
)
def test_a_cycle_beyond_the_limits_of_the_robot_is_not_signed(tmp_path, limit, says):
    """The trapezoid turns at 1.5 rad/s; a thousandth more is rounding."""
    model = turntable().model.copy()
    model.velocityLimit[0] = 1.4 if limit else 1.499
    scene = turntable().with_(stops=STOPS, model=model)
    state = "provisional" if says else "can be signed"
    assert_said_alike(sized(tmp_path, scene=scene), state, says)


def test_an_assembly_that_a_search_chose_is_not_signed(tmp_path):
    scene = turntable().with_(stops=STOPS)
    motion = replace(trapezoid(scene), assembly="loops do not close near the start")
    catalog = one_drive(tmp_path, MOTOR, GEAR, brakes={"B": BRAKE})
    given = {"conditions": {"holding_brake": "all"}, "on_miss": "ignore"}
    for cycle in (motion, pf.Duty(((motion, 1.0),))):
        report = pf.size(scene, cycle, catalog, **given)
        assert_said_alike(report, "provisional", "loops do not close near the start")


def test_a_choice_that_still_alternates_is_not_signed(tmp_path):
    report = replace(sized(tmp_path), settled=False, passes=12)
    assert_said_alike(report, "can be signed", "still alternates after 12 rounds")
