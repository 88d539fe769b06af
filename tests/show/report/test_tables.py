"""Tables fit their width, cut no number, and cut names so that they stay different."""

import io
import itertools
import os
import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example
from report_cases import FINGERS, printed
from rich.console import Console

import pinfric as pf
from pinfric.drives.catalog_file import load_catalog
from pinfric.model.described import in_json
from pinfric.show.inverse_summary import inverse_summary
from pinfric.show.report.inverse import inverse_report
from pinfric.show.report.sizing import ROUNDING, sizing_report
from pinfric.show.report.tables import Column, ColumnKind, Table, paragraphs
from pinfric.show.report.values import digits, span
from pinfric.sizing.summary import sizing_summary
from pinfric.terminal import show

WIDTHS = (40, 60, 80, 120)


def linked(names):
    """Links of 0.1 m in a row; every third joint slides."""
    kinds = itertools.cycle([pin.JointModelRZ(), pin.JointModelRZ(), pin.JointModelPY()])
    body = pin.Inertia.FromBox(0.1, 0.1, 0.02, 0.02)
    return chain(*((n, kind, body, [0.1, 0, 0]) for n, kind in zip(names, kinds, strict=False)))


@pytest.fixture(scope="module")
def humanoid():
    """48 joints with long names, of which some hold still."""
    assert len(FINGERS) == 48
    friction = {name: dry(0.12 + 0.01 * i, 0.1) for i, name in enumerate(FINGERS)}
    scene = pf.Scene(model=linked(FINGERS), friction=friction, source="humanoid.yaml")
    t = np.linspace(0.0, 2.0, 51)
    reach = 0.1 / (1 + np.arange(48))
    q = reach * (1 - np.cos(np.pi * t))[:, None]
    v = reach * np.pi * np.sin(np.pi * t)[:, None]
    a = reach * np.pi**2 * np.cos(np.pi * t)[:, None]
    q[:, ::5] = v[:, ::5] = a[:, ::5] = 0.0
    return scene, pf.Trajectory.from_arrays(scene, t, q, v, a)


@pytest.fixture(scope="module")
def sized(humanoid):
    every = load_catalog("default")
    motors, gears = ({x: kind[x] for x in list(kind)[::48]} for kind in (every.motors, every.gears))
    some = replace(every, motors=motors, gears=gears, gearmotors={})
    return pf.size(*humanoid, some, on_miss="ignore")


def cells(lines, title):
    """Row by row what the table below a title says, its blocks side by side: [[name, ...], ...]."""
    start = next(i for i, line in enumerate(lines) if line.startswith(title))
    rows, rules = [], 0
    for line in lines[start:]:
        if line.startswith("──"):
            rules, row = rules + 1, 0
        elif rules and not line:
            row = None
            continue
        elif rules and row is not None:
            found = re.split(r" {2,}", line.strip())
            if len(rows) <= row:
                rows.append([found[0]])
            assert rows[row][0] == found[0]  # the same name in every block
            rows[row] += found[1:]
            row += 1
        elif rules and not re.search(r"\S {2,}\S|^\s", line):
            break  # prose below the table
    return rows


def whole_names(lines, short, names):
    """The whole names of a table's shortened ones, without the ellipsis."""
    note = r"left out of each name: (?:(\S+)…)?(?: and )?(?:…(\S+))?"
    front, back = (re.search(note, " ".join(map(str.strip, lines))) or re.match("()()", "")).groups(
        ""
    )
    found = []
    for name in short:
        pattern = re.escape(front) + re.escape(name).replace("…", ".+") + re.escape(back)
        (one,) = [x for x in names if re.fullmatch(pattern, x)]
        found.append(one)
    return found


@pytest.mark.parametrize("width", WIDTHS)
def test_every_figure_of_48_joints_is_printed_whole_beside_a_name_that_is_one_joints(
    humanoid, width
):
    scene, motion = humanoid
    result = pf.inverse_dynamics(scene, motion)
    lines = printed(inverse_report(result, inverse_summary(result, "fingers.csv")), width)
    assert max(map(len, lines)) <= width
    rows = cells(lines, "humanoid")
    joints = in_json(inverse_summary(result, "fingers.csv"))["joints"]
    assert len(rows) == len(joints) == 48
    assert whole_names(lines, [row[0] for row in rows], FINGERS) == FINGERS
    largest = max(np.abs(x).max() for x in (result.effort_lower, result.effort_upper))
    for row, joint in zip(rows, joints, strict=True):
        figures = [x for x in row[1:] if x not in ("N", "N m")]
        zero = 1e-9 * largest
        assert figures == [
            digits(joint["peak"], zero),
            span(joint["rms_least"], joint["rms"], zero),
            f"{digits(joint['peak_frictionless'], zero)}, "
            f"{digits(joint['rms_frictionless'], zero)}",
            f"{100 * joint['friction_share']:.0f} %",
            digits(joint["stick_time"]),
            digits(joint["max_interval"], zero),
        ]


@pytest.mark.parametrize("width", WIDTHS)
def test_sizing_clips_no_number_at_any_width(sized, width):
    report = sized
    lines = printed(sizing_report(report), width)
    assert max(map(len, lines)) <= width
    rows = cells(lines, "humanoid")
    joints = in_json(sizing_summary(report))["joints"]
    assert len(rows) == len(joints) == 48
    guides = [d["guide"] for d in joints if d["guide"] is not None]
    largest = {key: max(guide[key] for guide in guides) for key in guides[0]}
    for row, d in zip(rows, joints, strict=True):
        peak = d["peak"]
        assert d["holding"] is None  # a column of which no joint knows anything is left out
        assert [x for x in row[1:] if x not in ("N", "N m")] == [
            digits(peak),
            digits(d["speed"]),
            *(
                digits(d["guide"][key], zero=1e-12 * most) if d["guide"] else "-"
                for key, most in largest.items()
            ),
            between(d["rms_least"], d["rms"], peak),
            beside(d["breakaway"], peak) if d["breakaway"] is not None else "-",
            f"{beside(d['peak_frictionless'], peak)}, {beside(d['rms_frictionless'], peak)}",
        ]


def beside(x, scale):
    """A figure as the table of demands shows it: what vanishes beside the joint's peak is 0."""
    return digits(x, zero=max(ROUNDING, 1e-4 * scale))


def between(least, worst, scale):
    """Two ends as a table shows them, once where they print alike."""
    ends = dict.fromkeys([beside(least, scale), beside(worst, scale)])
    return "\N{EN DASH}".join(ends)


@pytest.mark.parametrize("width", WIDTHS)
def test_panda_fits(width):
    result = pf.inverse_dynamics(*example("panda_pick_and_place", "panda_pick_and_place.csv"))
    lines = printed(
        inverse_report(result, inverse_summary(result, "panda_pick_and_place.csv")), width
    )
    assert max(map(len, lines)) <= width
    whole = [line for line in lines if line.startswith("joint1 ")]
    # at 80 columns in one block, names and all; at 40 in several, still with their names
    assert len(whole) == {40: 4, 60: 3, 80: 2, 120: 2}[width]
    assert "left out of each name: panda_…" in " ".join(map(str.strip, lines))


def test_a_table_too_wide_for_any_terminal_loses_no_digit(monkeypatch, capsys):
    table = Table(
        "", [Column("joint", ColumnKind.NAME), Column("effort")], [("elbow", "1234567.891011")]
    )
    assert "1234567.891011" in "\n".join(printed([table], 10))
    monkeypatch.setenv("COLUMNS", "10")
    show([table])
    assert "1234567.891011" in capsys.readouterr().out


def test_brackets_in_a_name_are_no_markup():
    table = Table(
        "", [Column("joint", ColumnKind.NAME), Column("x")], [("arm[0]", "1"), ("[red]", "2")]
    )
    assert [line.split()[0] for line in printed([table], 80)[2:]] == ["arm[0]", "[red]"]


def test_width_is_the_terminals_of_a_pipe_eighty_and_columns_beats_both(monkeypatch, capsys):
    def none_of_the_streams_is_a_terminal(stream):
        raise OSError

    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr(os, "get_terminal_size", none_of_the_streams_is_a_terminal)
    wide = Table("", [Column(f"{i}\n" + "x" * 12) for i in range(12)], [["1"] * 12])
    show([wide])
    assert 60 < max(map(len, capsys.readouterr().out.splitlines())) <= 80
    monkeypatch.setattr(os, "get_terminal_size", lambda stream: os.terminal_size((120, 24)))
    show([wide])
    assert 80 < max(map(len, capsys.readouterr().out.splitlines())) <= 120
    monkeypatch.setenv("COLUMNS", "60")
    show([wide])
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 60


def test_a_report_says_names_in_lines_as_in_its_tables():
    table = Table("", (Column("joint", ColumnKind.NAME),), [("panda_a",), ("panda_b",)])
    console = Console(file=io.StringIO(), width=80)
    console.print(*paragraphs(table, ["panda_a sticks"]), sep="\n")
    assert console.file.getvalue().splitlines()[-1] == "a sticks"


def test_a_joint_without_friction_says_where_its_loss_sits():
    """Before, "0 %" stood there."""
    gear = {"ratio": 50.0, "no_load_torque": 0.3}
    scene = pf.load_scene("pendulum").with_(friction={})
    (drive,) = scene.drives
    moved = [[0.4]], [[1.0]], [[0.0]]
    for actuators, said in (
        ([{"joint": drive.name, "transmission": gear}], "at motor"),
        ([], "0 %"),
    ):
        result = pf.inverse_dynamics(
            scene.with_(actuators=actuators or None), *(x * 2 for x in moved), t=[0.0, 1.0]
        )
        text = " ".join(printed(inverse_report(result, inverse_summary(result, "a.csv")), 100))
        assert (" at motor " in text) == (said == "at motor")
        assert (" 0 % " in text) == (said == "0 %")
