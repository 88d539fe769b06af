"""The sizing page: one self-contained HTML file, to read, to print and to sign."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from pinfric.drives.criterion import Criterion, Status
from pinfric.model.described import described, quantity
from pinfric.show.figure.panel import svg
from pinfric.show.pages.page import NO_FIGURE, figure, formula, page
from pinfric.show.pages.sizing_figures import (
    effort_over_time,
    power_over_time,
    temperature,
    torque_speed,
)
from pinfric.show.report.drives import (
    ask_table,
    brake_table,
    bus_lines,
    bus_table,
    by_text,
    choice_table,
    provisional_table,
    rating_table,
    smaller_table,
    turn,
    unchecked_table,
)
from pinfric.show.report.html import Marked, mark
from pinfric.show.report.names import short_names
from pinfric.show.report.rows import table_of
from pinfric.show.report.sizing import (
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
from pinfric.show.report.tables import Table
from pinfric.show.report.values import percentage
from pinfric.sizing.size import JointSizing, SizingReport
from pinfric.sizing.summary import (
    Margins,
    SizedJoint,
    SizingSummary,
    margins,
    sizing_summary,
)

#: Margins below are called tight.
_TIGHT = 0.1
#: Products to ask for that the page lists; the JSON has all.
_ASKED = 10


def sizing_page(report: SizingReport, command: str = "", inputs: Iterable[str | Path] = ()) -> str:
    """Return the report as one HTML page, to read, to print and to sign.

    Args:
        report: of `size`.
        command: that made it, if one did, as it was typed.
        inputs: files that it read, beside those that the report knows.

    Raises:
        PinfricError: the extra `report` (jinja2) is not installed.
    """
    found, short = sizing_summary(report), short_names(report.scene.actuator_names)
    joints = [
        _joint_view(joint, report, found.joints[k], k) for k, joint in enumerate(report.joints)
    ]
    # What was demanded, in a line
    c = report.conditions
    payloads = [f"payload {n}, {figure(p.mass)} kg" for n, p in report.given.payloads.items()]
    arm = f"whole arm {figure(c.lowest_frequency)} Hz" if c.lowest_frequency else "each axis alone"
    demanded = [
        *payloads,
        f"bus {figure(c.bus_voltage)} V",
        f"ambient {figure(c.ambient)} °C",
        f"peak torque times {figure(c.peak_factor)}",
        f"inertia ratio up to {figure(c.inertia_ratio)}",
        f"{figure(c.resonance_base)} Hz base, {figure(c.resonance_hand)} Hz hand, {arm}",
        f"brakes {figure(c.brake_factor)} times the load",
        f"L10 {'not demanded' if c.life is None else f'{figure(c.life)} h'}",
    ]
    # Every condition with its value, and which are not the defaults
    default = type(report.conditions)()
    said = []
    for name, value in report.conditions:
        given = "" if value == getattr(default, name) else " (given)"
        if value is not None and value != {}:
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            said.append(f"{name} {shown}{given}")
    taken = (joint.installed for joint in report.joints)
    documents = by_text(line for one in taken if one for line in one.candidate.sources)
    return page(
        "sizing",
        report.scene.actuator_names,
        [joint.name for joint in found.joints],
        (*report.files, *map(str, inputs)),
        views=joints,
        report=report,
        scene=Path(report.given.source).stem,
        trajectory=Path(report.trajectory).name,
        cycle=report.period,
        samples=len(report.result.status),
        found=found,
        choices=None if report.catalog is None else choice_table(found, _CELLS),
        provisional=provisional_table(found),
        matrix=table_of(
            "Margins: the part of each limit that is left",
            [
                Margins(row.criterion, {short[name]: c for name, c in row.joints.items()})
                for row in margins(found)
            ],
            cells={f"joints[{name}]": partial(_cell, name) for name in short.values()},
        ),
        bus_figures=bus_table(report),
        bus=bus_lines(report),
        bus_picture=report.catalog and svg(power_over_time(report), "Power from the bus"),
        turn=turn(report),
        elastic=elastic_lines(report),
        remarks=[*rating_lines(found), *friction_line(report), *found.verdict.remarks],
        demand=demand_table(report),
        power=power_table(report),
        brakes=brake_table(found),
        stops=None if found.stops is None else axes_table(found.stops, ""),
        stop_lines=stop_lines(found),
        verdict="" if report.catalog is None else verdict(report),
        unchecked=unchecked_table(found, title=""),
        ask=ask_table(found, _ASKED),
        rules=_rules(found, short),
        smaller=smaller_table(found),
        rating=rating_table(found),
        conditions_line="Demanded: " + "; ".join(demanded) + ".",
        all_conditions="; ".join(said),
        command=command,
        passes=passes(report),
        repetition=repetition(report),
        sources=[f"{', '.join(of)}: {text}" for text, of in documents.items()],
        Status=Status,
    )


def _joint_view(
    joint: JointSizing, report: SizingReport, found: SizedJoint, k: int
) -> dict[str, Any]:
    """What the template shows of one joint."""
    taken, name = found.installed, found.name
    drawn = [("effort", "Effort at the joint over the cycle", effort_over_time(joint))]
    missing = []
    if joint.motor is not None:
        title = "The cycle in the motor's torque-speed limits"
        drawn.insert(0, ("envelope", title, torque_speed(joint, report)))
        warm = temperature(joint, report)
        if warm is not None:
            drawn.append(("heat", "Winding temperature, settled cycle", warm))
        elif taken is not None:  # a stepper's winding has a criterion of its own, without a curve
            heat = [c for c in taken.criteria if c.name == "winding temperature"]
            missing += [("Winding temperature", f"{c.status}: {c.note}") for c in heat]
    pictures = [
        (f"{kind}-{k}", title, svg(figure, f"{title} of {name}")) for kind, title, figure in drawn
    ]
    return {
        "found": found,
        "figures": pictures,
        "missing": missing,
        "criteria": () if taken is None else _criteria(taken.criteria),
        "remarks": [] if taken is None else _remarks(taken.criteria),
        "units": joint.installed.candidate.units if joint.installed is not None else (),
        "at_output": joint.installed is not None and joint.installed.candidate.at_output,
        "fitting": table_of("", found.alternatives),
        "unloaded": joint.unloaded and report.catalog is not None,
    }


def _margin(margin: float | None) -> Marked:
    """A margin on the ground that says how it ended."""
    if margin is None:
        return Marked(NO_FIGURE)
    return mark("bad" if margin < 0 else "tight" if margin < _TIGHT else "ok", percentage(margin))


#: Cells of the chosen drives that the page shows in its own way.
_CELLS: dict[str, Callable[[SizedJoint], str]] = {
    "verdict.margin": lambda joint: _margin(joint.verdict.margin if joint.verdict else None),
}


def _ended(c: Criterion) -> Marked:
    """How a criterion ended, with its margin."""
    if c.status == Status.NOT_CHECKED:
        return mark("none", "not checked", c.note)
    if c.status == Status.NOT_REQUIRED:
        return mark("free", "not required", c.note)
    if c.status == Status.PASSES and not c.scaled:
        return mark("free", "passes", c.why)  # a step has no reserve
    return Marked(f'<span title="{escape(c.why)}">{_margin(c.margin)}</span>')


def _criteria(criteria: Sequence[Criterion]) -> tuple[Table | None, ...]:
    """All criteria of a drive in two tables, each with a bar of the used part of its limit."""

    def margin(c: Criterion) -> Marked:
        if (
            c.status in (Status.NOT_CHECKED, Status.NOT_REQUIRED)
            or c.margin is None
            or not c.scaled
        ):
            return _ended(c)
        used = min(max(100.0 * (1.0 - c.margin), 0.0), 100.0)
        colour = "red" if c.status == Status.FAILS else "blue"
        bar = f'<i style="width:{used:.1f}%;background:var(--{colour})"></i>'
        return Marked(f'{_ended(c)} <span class="bar" title="used part of the limit">{bar}</span>')

    cells: dict[str, Callable[[Criterion], str]] = {
        "required": lambda c: figure(c.required),
        "available": lambda c: figure(c.available),
        "margin": margin,
    }
    half, without = (len(criteria) + 1) // 2, ("status", "formula", "source")
    parts = (criteria[:half], criteria[half:])
    return tuple(table_of("", part, cells=cells, without=without) for part in parts)


def _remarks(criteria: Sequence[Criterion]) -> list[tuple[str, str]]:
    """What is remarked of criteria, once; what was not checked has a table of its own."""
    said: dict[str, list[str]] = {}
    for c in criteria:
        if c.note and c.status != Status.NOT_CHECKED:
            said.setdefault(c.note, []).append(c.name)
    return [(", ".join(names), note) for note, names in said.items()]


@described
class Rule:
    """How a criterion is judged."""

    criterion: str = quantity("its name", heading="criterion")
    formula: str = quantity("of the check", heading="formula")
    source: str = quantity("of the rule", heading="source")
    joints: tuple[str, ...] = quantity("where it is so; empty: everywhere", heading="joints")


def _rules(found: SizingSummary, short: Mapping[str, str]) -> Table | None:
    """How each criterion is judged, once; where it differs between joints, with the joints."""
    said: dict[tuple[str, str, str], list[str]] = {}
    judged: dict[str, int] = {}
    for joint in found.joints:
        for c in () if joint.installed is None else joint.installed.criteria:
            said.setdefault((c.name, c.formula, c.source), []).append(short[joint.name])
            judged[c.name] = judged.get(c.name, 0) + 1
    rows = [
        Rule(*key, () if len(of) == judged[key[0]] else tuple(of))
        for key, of in sorted(said.items(), key=lambda item: list(judged).index(item[0][0]))
    ]
    cells = {
        "formula": lambda row: Marked(formula(row.formula)),
        "joints": lambda row: ", ".join(row.joints),
    }
    return table_of("", rows, cells=cells)


def _cell(joint: str, row: Margins) -> Marked:
    return _ended(row.joints[joint]) if joint in row.joints else Marked("·")
