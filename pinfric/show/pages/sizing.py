"""The sizing page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from pinfric.drives.criterion import Criterion, Status
from pinfric.drives.policy import Conditions
from pinfric.errors import StopError
from pinfric.show.pages.page import NO_FIGURE, drawn, figure, formula, page
from pinfric.show.report.drives import (
    ask_table,
    backlash_line,
    brake_table,
    bus_lines,
    bus_table,
    by_text,
    choice_table,
    currents_table,
    lighter_table,
    product_lines,
    provisional_table,
    rating_table,
    sensitivity_table,
    smaller_table,
    turn,
    unchecked_table,
)
from pinfric.show.report.html import Marked, mark
from pinfric.show.report.names import short_names
from pinfric.show.report.rows import table_of
from pinfric.show.report.sizing import (
    body_lines,
    demand_table,
    elastic_lines,
    friction_line,
    passes,
    power_table,
    rating_lines,
    repetition,
    stop_lines,
    verdict,
)
from pinfric.show.report.stop import axes_table
from pinfric.show.report.stop import verdict as verdict_of_stops
from pinfric.show.report.tables import Table
from pinfric.show.report.values import percentage
from pinfric.sizing.report import JointSizing, SizingReport
from pinfric.sizing.summary import (
    Candidacy,
    CriterionMargins,
    SizedJoint,
    SizingSummary,
    margins,
    sizing_summary,
)
from pinfric.stops.study import stop_summary

#: Margins below are called tight.
_TIGHT = 0.1
#: Products to ask for that the page lists; the JSON has all.
_ASKED = 6


def sizing_page(report: SizingReport, command: str = "", inputs: Iterable[str | Path] = ()) -> str:
    """Return the report as one HTML page, to read, to print and to sign.

    Args:
        report: of `size`.
        command: that made it, as typed; empty: none.
        inputs: files read, beside those that the report knows.

    Raises:
        PinfricError: see `page`.
    """
    summary, short = sizing_summary(report), short_names(report.scene.actuator_names)
    own, shared = _remarks(summary.joints, short)
    failing = by_text(summary.verdict.failing)
    documents = by_text(line for drive in report.drives if drive for line in drive.sources)
    matrix = [
        CriterionMargins(row.criterion, {short[name]: c for name, c in row.joints.items()})
        for row in margins(summary)
    ]
    stops, said_of_stops = _stops(report)
    return page(
        "sizing",
        report.scene.actuator_names,
        [joint.name for joint in summary.joints],
        (*report.files, *map(str, inputs)),
        report=report,
        summary=summary,
        Status=Status,
        # The head
        scene=Path(report.given.source).stem,
        trajectory=Path(report.trajectory).name,
        cycle=report.period,
        repetition=repetition(report),
        samples=len(report.result.status),
        verdict="" if report.catalog is None else verdict(report),
        passes=passes(report),
        failing=[f"{', '.join(of)}: {text}" for text, of in failing.items()],
        remarks=[
            *rating_lines(summary),
            *body_lines(report),
            *friction_line(report),
            *backlash_line(summary),
            *summary.verdict.remarks,
        ],
        choices=None if report.catalog is None else choice_table(summary, _CELLS),
        products=product_lines(summary),
        conditions_line=_demanded(report),
        command=command,
        # The drives
        rating=rating_table(summary),
        demand=demand_table(report),
        power=power_table(report),
        matrix=table_of(
            "Margins: the part of each limit that is left",
            matrix,
            cells={f"joints[{name}]": partial(_cell, name) for name in short.values()},
        ),
        smaller=smaller_table(summary),
        sensitivity=sensitivity_table(summary),
        views=[
            _joint_view(joint, report, summary.joints[k], k) | {"remarks": own[k]}
            for k, joint in enumerate(report.joints)
        ],
        remarks_of_all=shared,
        # All together
        turn=turn(report),
        bus_pictures=drawn(report),
        currents=currents_table(summary),
        bus_figures=bus_table(report),
        bus=bus_lines(report),
        brakes=brake_table(summary),
        stop_lines=[*stop_lines(summary, written=True), *said_of_stops],
        stops=stops,
        elastic=elastic_lines(report),
        # What stands behind it
        unchecked=unchecked_table(summary, title=""),
        all_conditions=_conditions(report.conditions),
        rules=_rules(summary, short),
        sources=[f"{', '.join(of)}: {text}" for text, of in documents.items()],
        provisional=provisional_table(summary),
        lighter=lighter_table(summary),
        ask=ask_table(summary, _ASKED),
    )


def _stops(report: SizingReport) -> tuple[Table | None, list[str]]:
    """The table of all stops, which are simulated for it, and what they come to."""
    try:
        result = report.stops
    except StopError as problem:
        return None, [f"times and ways are not known: {problem}"]
    if result is None:
        return None, []
    found = stop_summary(result)
    return axes_table(found, ""), [verdict_of_stops(found)]


def _demanded(report: SizingReport) -> str:
    c = report.conditions
    arm = f"whole arm {figure(c.lowest_frequency)} Hz" if c.lowest_frequency else "each axis alone"
    parts = [
        *(f"payload {n}, {figure(p.mass)} kg" for n, p in report.given.payloads.items()),
        *[f"bus {figure(c.bus_voltage)} V"] * report.bus.feeds,
        f"ambient {figure(c.ambient)} °C",
        f"peak torque times {figure(c.peak_factor)}",
        f"inertia ratio up to {figure(c.inertia_ratio)}",
        f"{figure(c.resonance_base)} Hz base, {figure(c.resonance_hand)} Hz hand, {arm}",
        f"brakes {figure(c.brake_factor)} times the load",
        f"L10 {'not demanded' if c.life is None else f'{figure(c.life)} h'}",
    ]
    return f"Demanded: {'; '.join(parts)}."


def _conditions(conditions: Conditions) -> str:
    default, said = Conditions(), []
    for name, value in conditions:
        if value is not None and value != {}:
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            said.append(f"{name} {shown}" + " (given)" * (value != getattr(default, name)))
    return "; ".join(said)


def _joint_view(
    joint: JointSizing, report: SizingReport, summary: SizedJoint, k: int
) -> dict[str, Any]:
    taken, name = summary.installed, summary.name
    pictures = drawn(report, k, name)
    missing = []
    if joint.motor is not None and taken is not None and "heat" not in [p.name for p in pictures]:
        # a stepper's winding has a criterion of its own, without a curve
        heat = [c for c in taken.criteria if c.name == "winding temperature"]
        missing += [("Winding temperature", f"{c.status}: {c.note}") for c in heat]
    return {
        "summary": summary,
        "pictures": pictures,
        "missing": missing,
        "criteria": () if taken is None else _criteria(taken.criteria),
        "units": joint.installed.candidate.units if joint.installed is not None else (),
        "at_output": joint.installed is not None and joint.installed.candidate.at_output,
        "fitting": table_of("", (*summary.taken, *summary.alternatives), cells=_OFFERED),
        "unloaded": joint.unloaded and report.catalog is not None,
    }


def _margin(margin: float | None) -> Marked:
    if margin is None:
        return Marked(NO_FIGURE)
    return mark("bad" if margin < 0 else "tight" if margin < _TIGHT else "ok", percentage(margin))


#: Cells of the chosen drives that the page shows in its own way.
_CELLS: dict[str, Callable[[SizedJoint], str]] = {
    "verdict.margin": lambda joint: _margin(joint.verdict.margin if joint.verdict else None),
}


#: The same of the drives that fit a joint.
_OFFERED: dict[str, Callable[[Candidacy], str]] = {"margin": lambda drive: _margin(drive.margin)}


def _ended(c: Criterion) -> Marked:
    if c.unchecked:
        return mark("none", "not checked", c.note)
    if c.status == Status.NOT_REQUIRED:
        return mark("free", "not required", c.note)
    if c.status == Status.PASSES and not c.scaled:
        return mark("free", "passes", c.why)  # a step has no reserve
    return Marked(f'<span title="{escape(c.why)}">{_margin(c.margin)}</span>')


def _criteria(criteria: Sequence[Criterion]) -> tuple[Table | None, ...]:
    """All criteria of a drive with figures or without a required one, in three tables."""
    criteria = [c for c in criteria if c.status != Status.NOT_REQUIRED or c.available is not None]
    cells: dict[str, Callable[[Criterion], str]] = {
        "required": lambda c: figure(c.required),
        "available": lambda c: figure(c.available),
        "margin": _ended,
    }
    rows, without = -(-len(criteria) // 3), ("status", "formula", "source")
    parts = (criteria[k : k + rows] for k in range(0, len(criteria), rows))
    return tuple(table_of("", group, cells=cells, without=without) for group in parts)


#: What is remarked on: criteria or figures, joints, the text.
Remark = tuple[list[str], list[str], str]


def _remarks(
    joints: Sequence[SizedJoint], short: Mapping[str, str]
) -> tuple[list[list[Remark]], list[Remark]]:
    """Return the remarks on each joint alone, and those on several; each text once.

    Unchecked criteria, and remarks on products, have their own places.
    """
    said: dict[tuple[str, str], list[str]] = {}
    for joint in joints:
        if (taken := joint.installed) is not None:
            noted = [c for c in taken.criteria if c.note and not c.unchecked]
            lines = [(c.name, c.note) for c in noted] + [("losses", taken.losses)]
            lines += [
                (name, text) for line in taken.stand_ins for name, _, text in [line.partition(": ")]
            ]
            for line in dict.fromkeys(lines):
                said.setdefault(line, []).append(short[joint.name])
    once: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for (name, text), of in said.items():
        once.setdefault((text, tuple(of)), []).append(name)
    remarks = [(names, list(of), text) for (text, of), names in once.items()]
    own = [[r for r in remarks if r[1] == [short[joint.name]]] for joint in joints]
    return own, [r for r in remarks if len(r[1]) > 1]


def _rules(summary: SizingSummary, short: Mapping[str, str]) -> list[tuple[str, str, Any, str]]:
    """Criterion, joints, formula and source, once; joints only where it is judged differently."""
    said: dict[tuple[str, str, str], list[str]] = {}
    judged: dict[str, int] = {}
    for joint in summary.joints:
        for c in () if joint.installed is None else joint.installed.criteria:
            said.setdefault((c.name, c.formula, c.source), []).append(short[joint.name])
            judged[c.name] = judged.get(c.name, 0) + 1
    return [
        (name, ", ".join(of) * (len(of) < judged[name]), formula(rule), source)
        for (name, rule, source), of in sorted(
            said.items(), key=lambda item: list(judged).index(item[0][0])
        )
    ]


def _cell(joint: str, row: CriterionMargins) -> Marked:
    return _ended(row.joints[joint]) if joint in row.joints else Marked("·")
