"""Sizing in words and figures: tables for people, a dictionary for machines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pinfric import __version__
from pinfric.show.report.drives import (
    brake_table,
    bus_lines,
    drives_json,
    sets_table,
    smaller_table,
    standstill_json,
)
from pinfric.show.report.elastic import elasticity_json, frequency_lines
from pinfric.show.report.tables import Column, Kind, Report, Table, key_columns, paragraphs
from pinfric.show.report.values import digits, json_safe, span
from pinfric.study.sizing.assess import Assessment
from pinfric.study.sizing.brake import Standstill
from pinfric.study.sizing.criteria import Criterion, Status, load_factor, optimum_ratio
from pinfric.study.sizing.size import JointSizing, SizingReport
from pinfric.study.summary import ends_by_magnitude

#: Efforts below (N m, N) are rounding.
ROUNDING = 1e-9
#: Efforts below this part of the joint's peak print as 0, not as 3.2e-6 beside 0.249.
_VISIBLE = 1e-4


def sizing_json(report: SizingReport, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Return everything `pinfric size --json` prints; SI units, None for what is not known.

    `holding` is [least, worst] effort while every joint of the robot stands still; what a joint
    that stands while others move must bear is in `breakaway` and, at its motor, `motor.standing`.

    Args:
        report: of `size`.
        warnings: what was noticed on the way.
    """
    return json_safe(
        {
            "pinfric": __version__,
            "scene": report.given.source,
            "trajectory": report.trajectory,
            "catalog": None if report.catalog is None else report.catalog.source,
            "conditions": report.conditions.model_dump(),
            "cycle_time": report.period,
            "cycles": [
                {"name": name, "repeats": n}
                for (name, _), n in zip(report.duty.parts(), report.duty.repeats, strict=False)
            ],
            "off": _off(report),
            "unclosed": list(report.unclosed),
            "passes": report.passes,
            "settled": report.settled,
            "drive_mass": report.drive_mass,
            "joints": [
                _joint_json(joint, still)
                for joint, still in zip(report.joints, report.standstills, strict=True)
            ],
            **drives_json(report),
            "misses": list(report.misses),
            "short": list(report.short),
            **({} if report.elastic is None else {"elasticity": elasticity_json(report.elastic)}),
            **_asked_json(report),
            "notes": list(report.notes),
            "warnings": list(warnings),
        }
    )


def _asked_json(report: SizingReport) -> dict[str, Any]:
    """The criteria of the whole robot, where conditions ask for some."""
    criteria = report.arm_criteria
    return {"robot": {"criteria": [asdict(c) for c in criteria]}} if criteria else {}


def _joint_json(joint: JointSizing, still: Standstill) -> dict[str, Any]:
    d = joint.demand
    entry: dict[str, Any] = {
        "name": d.name, "unit": d.unit,
        "peak": d.peak, "rms": d.rms, "rms_least": d.rms_least,
        "breakaway": d.breakaway, "breakaway_friction": d.breakaway_friction,
        "holding": None if d.holding is None else list(d.holding),
        "speed": d.speed, "speed_at_peak": d.speed_at_peak, "mean_speed": d.mean_speed,
        "mean_cubic": d.mean_cubic, "duty": d.duty, "hold_share": d.hold_share,
        "power": asdict(d.power), "travel": d.travel,
        "bearing": None if d.bearing is None else {
            "radial": d.bearing.radial, "axial": d.bearing.axial, "moment": d.bearing.moment,
        },
        "frictionless": {
            "peak": d.peak_frictionless, "rms": d.rms_frictionless,
            "holding": d.holding_frictionless, "power": asdict(d.power_frictionless),
            "choice": _name(joint.choice_frictionless),
        },
        "without_drive_masses": {
            "peak": joint.demand_without_masses.peak, "rms": joint.demand_without_masses.rms,
            "choice": _name(joint.choice_without_masses),
        },
        "load_inertia": joint.load_inertia,
        "choice": _name(joint.choice), "mass": None, "not_checked": None, "margin": None,
        "margins": {}, "criteria": [], "motor": None,
    }  # fmt: skip
    if joint.taken is not None:
        entry |= _taken_json(joint, joint.taken, still)
    entry["standstill"] = standstill_json(still)
    fitting = [a for a in joint.assessments if a.fits]
    rejected = [a for a in joint.assessments if not a.fits]
    entry["alternatives"] = [
        {"name": a.candidate.name, "mass": a.candidate.mass, "margin": a.margin,
         "not_checked": len(a.not_checked)}
        for a in fitting if a is not joint.choice
    ]  # fmt: skip
    entry["rejected"] = [{"name": a.candidate.name, "why": a.why} for a in rejected]
    entry["nearest_miss"] = joint.miss or None
    smaller = joint.next_smaller
    entry["next_smaller"] = smaller and {"name": smaller.candidate.name, "why": smaller.why}
    return entry


def _taken_json(joint: JointSizing, taken: Assessment, still: Standstill) -> dict[str, Any]:
    """What there is to say of the choice; of the nearest miss where nothing fits."""
    candidate, criteria = taken.candidate, (*taken.criteria, *still.criteria)
    return {
        "judged": candidate.name,
        "mass": candidate.mass,
        "ratio": candidate.ratio,
        "not_checked": len(taken.not_checked),
        "margin": taken.margin,
        "margins": {c.name: c.margin for c in criteria},
        "criteria": [asdict(c) for c in criteria],
        "motor": None if taken.motor is None else asdict(taken.motor),
        "losses": candidate.losses,
        "stand_ins": list(candidate.stand_ins),
        "sources": list(candidate.sources),
        **ratio_figures(joint, taken),
    }


def ratio_figures(joint: JointSizing, taken: Assessment) -> dict[str, float | None]:
    """Return how good a drive's ratio is: the best one, and Giberti's factors of motor and load.

    `optimum_ratio` (least RMS motor torque), `load_factor` beta and `accelerating_factor`
    T_N^2/J_rotor, W/s; None where a figure is missing or the joint never accelerates.
    """
    candidate, inertia = taken.candidate, taken.candidate.rotor_inertia
    worst = ends_by_magnitude(joint.cycle.effort_lower, joint.cycle.effort_upper)[0]
    torque = candidate.ratings.continuous_torque
    if torque is not None and candidate.at_output:
        torque /= candidate.ratio
    alpha = None if torque is None or inertia is None else torque**2 / inertia
    best = None if inertia is None else optimum_ratio(joint.cycle, worst, inertia)
    if best is not None and not np.isfinite(best):
        best = None  # a joint that never accelerates gains by any ratio
    return {"optimum_ratio": best, "load_factor": load_factor(joint.cycle, worst),
            "accelerating_factor": alpha}  # fmt: skip


def sizing_report(report: SizingReport) -> Report:
    """Return the tables and lines that `pinfric size` prints, for a rich console.

    Args:
        report: of `size`.
    """
    from rich.text import Text

    notes = [f"note: {line}" for line in report.notes]
    if report.catalog is None:
        failing = [Text(f"! {line}", style="bold red") for line in report.short]
        return paragraphs(_demand_table(report), elastic_lines(report), failing, notes)
    return paragraphs(
        _demand_table(report), _choice_table(report),
        [f"{digits(report.drive_mass)} kg of drives; {passes(report)}"],
        _heavier(report), smaller_table(report), sets_table(report), brake_table(report),
        bus_lines(report), _changes(report), elastic_lines(report),
        [Text(f"! {line}", style="bold red") for line in (*report.misses, *report.short)], notes,
    )  # fmt: skip


def elastic_lines(report: SizingReport) -> list[str]:
    """Return the lowest frequency on the chosen gears, and what conditions ask of the robot."""
    asked = [c.why for c in report.arm_criteria if c.status != Status.FAILS]
    if report.elastic is None:
        return asked
    rigid = [drive.name for drive in report.scene.drives if drive.spring is None]
    lines = frequency_lines(report.elastic)
    if rigid:
        lines.append(f"stiffness not known: {', '.join(rigid)}: taken as rigid, so these "
                     "frequencies are upper bounds")  # fmt: skip
    return [*lines, *asked]


def repetition(report: SizingReport) -> str:
    """Return how the cycle is taken to go on, in words."""
    if len(report.duty.repeats) > 1:
        return "the period, repeated" + ("; not all cycles close" if report.unclosed else "")
    return "repeated, though it does not close" if report.unclosed else "repeated without a pause"


def _off(report: SizingReport) -> float:
    """Time switched off in a period, s."""
    t = report.result.t
    assert t is not None  # size refuses a motion without times
    return float(t[-1] - t[report.duty.starts[-2]]) if report.duty.off else 0.0


def _demand_table(report: SizingReport) -> Table:
    unit, key = key_columns([joint.demand.unit for joint in report.joints])
    title = f"{Path(report.given.source).stem} · {Path(report.trajectory).name}"
    headings = ("peak", "RMS", "frictionless\npeak, RMS", "holding", "break-\naway")
    figures = [Column(heading + (f"\n{unit}" if unit else "")) for heading in headings]
    speed = {"N m": "\nrad/s", "N": "\nm/s"}.get(unit, "\nrad/s, m/s")
    rows = [
        (
            d.name, *([] if unit else [d.unit]),
            digits(d.peak), span_beside(d.rms_least, d.rms, d.peak),
            f"{beside(d.peak_frictionless, d.peak)}, {beside(d.rms_frictionless, d.peak)}",
            "-" if d.holding is None else span_beside(*d.holding, d.peak),
            "-" if d.breakaway is None else beside(d.breakaway, d.peak),
            digits(d.speed),
        )
        for d in (joint.demand for joint in report.joints)
    ]  # fmt: skip
    return Table(
        f"{title}: {digits(report.period)} s, {repetition(report)}",
        [*key, *figures, Column(f"speed{speed}")], rows, keys=len(key),
    )  # fmt: skip


def _choice_table(report: SizingReport) -> Table:
    source = report.catalog.source if report.catalog is not None else ""
    columns = (
        Column("joint", Kind.NAME), Column("lightest that fits", Kind.WORDS), Column("mass\nkg"),
        Column("least\nmargin"), Column("tightest\ncriterion", Kind.WORDS), Column("not\nchecked"),
        Column("fit"),
    )  # fmt: skip
    rows = []
    for joint in report.joints:
        fits = sum(a.fits for a in joint.assessments)
        count = f"{fits} of {len(joint.assessments)}"
        if joint.choice is None:
            name = "none" if joint.nearest is None else f"none; nearest {_name(joint.nearest)}"
            rows.append((joint.name, name, "", "", "", "", count))
            continue
        tight = tightest(joint.choice)
        rows.append((
            joint.name, joint.choice.candidate.name, digits(joint.choice.candidate.mass or 0.0),
            f"{100 * joint.choice.margin:.0f} %", tight.name if tight else "",
            str(len(joint.choice.not_checked)), count,
        ))  # fmt: skip
    title = f"drives from {source}, {digits(report.conditions.bus_voltage)} V"
    return Table(title, columns, rows)


def tightest(assessment: Assessment) -> Criterion | None:
    """Return the criterion with the least margin, or None where none was compared."""
    compared = [c for c in assessment.criteria if c.scaled]
    return min(compared, key=lambda c: c.margin or 0.0, default=None)


def passes(report: SizingReport) -> str:
    """Return how the choice of drives ended, in words."""
    count = f"{report.passes} pass" + "es" * (report.passes != 1)
    return (
        f"settled after {count}" if report.settled else f"not settled after {count}: it alternates"
    )


def _heavier(report: SizingReport) -> Table | None:
    """What the drives' own mass changed, where it is more than a twentieth."""
    rows = [
        (j.name, digits(j.demand_without_masses.rms), digits(j.demand.rms), j.demand.unit)
        for j in report.joints if j.demand.rms > 1.05 * j.demand_without_masses.rms
    ]  # fmt: skip
    columns = (Column("joint", Kind.NAME), Column("RMS\nwithout"), Column("with"),
               Column("", Kind.LABEL))  # fmt: skip
    return Table("what the drives' own mass adds", columns, rows) if rows else None


def _changes(report: SizingReport) -> list[str]:
    """What neglecting the drives' own mass, or friction, would have bought."""
    lines = []
    for joint in report.joints:
        for other, text in ((joint.choice_without_masses, "without the drives' mass"),
                            (joint.choice_frictionless, "without friction")):  # fmt: skip
            if _name(other) != _name(joint.choice):
                lines.append(f"{joint.name}: {text} it would be {_name(other) or 'none'}")
    unchecked = sum(len(j.choice.not_checked) for j in report.joints if j.choice is not None)
    if unchecked:
        lines.append(f"{unchecked} criteria of the chosen drives are not checked: no figure "
                     "(--json and the report name them)")  # fmt: skip
    return lines


def beside(x: float, scale: float) -> str:
    """Return x as `digits` does; what vanishes beside `scale`, of the same unit, is 0."""
    return digits(x, zero=max(ROUNDING, _VISIBLE * scale))


def span_beside(least: float, worst: float, scale: float) -> str:
    """Return "least–worst" as `span` does; what vanishes beside `scale` is 0."""
    return span(least, worst, zero=max(ROUNDING, _VISIBLE * scale))


def _name(assessment: Assessment | None) -> str | None:
    return None if assessment is None else assessment.candidate.name
