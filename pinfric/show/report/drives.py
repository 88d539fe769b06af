"""What stands beside the choice of drives: next smaller ones, brakes, the bus."""

from __future__ import annotations

from pinfric.show.report.tables import Column, Kind, Table
from pinfric.show.report.values import digits, span
from pinfric.study.sizing.assess import Assessment
from pinfric.study.sizing.brake import Standstill
from pinfric.study.sizing.size import SizingReport

#: Criteria that a table names of a drive that misses several.
_MOST_MISSES = 3
#: N m; torques of brakes below print as 0.
_ROUNDING = 1e-9


def smaller_table(report: SizingReport) -> Table | None:
    """Say what the next smaller drive of each joint lacks; None where no joint has one."""
    rows = [
        (joint.name, small.candidate.name, digits(small.candidate.mass or 0.0), shortfall(small))
        for joint in report.joints
        if (small := joint.next_smaller) is not None
    ]
    columns = (
        Column("joint", Kind.NAME),
        Column("next smaller", Kind.WORDS),
        Column("mass\nkg"),
        Column("would fit,\nbut is short by", Kind.WORDS),
    )
    return Table("the next smaller drives", columns, rows) if rows else None


def shortfall(assessment: Assessment) -> str:
    """Return the criteria that a drive fails and by how much, the worst first."""
    failed = assessment.failed
    parts = [f"{c.name}: {c.shortfall}" for c in failed[:_MOST_MISSES]]
    return "; ".join(parts + [f"{len(failed) - _MOST_MISSES} more"] * (len(failed) > _MOST_MISSES))


def brake_table(report: SizingReport) -> Table:
    """Say which joints hold without power, what their brakes must bear, and which ones do."""
    rows = []
    for joint, still in zip(report.joints, report.standstills, strict=True):
        brake = still.criteria[-1]
        rows.append(
            (
                joint.name,
                span(*still.effort, zero=_ROUNDING),
                "-" if still.shaft is None else span(*still.shaft, zero=_ROUNDING),
                holds_alone(still),
                still.brake or ("none bears it" if brake.available else "-"),
                "-" if brake.margin is None else f"{100 * brake.margin:.0f} %",
            )
        )
    units = {joint.demand.unit for joint in report.joints}
    unit = units.pop() if len(units) == 1 else "N m, N"
    columns = (
        Column("joint", Kind.NAME),
        Column(f"at the\njoint\n{unit}"),
        Column("at the\nmotor\nN m"),
        Column("without\nbrake", Kind.LABEL),
        Column("smallest brake", Kind.WORDS),
        Column("\nmargin"),
    )
    title = "without power, anywhere along the cycle: friction helping most\N{EN DASH}least"
    return Table(title, columns, rows)


def holds_alone(still: Standstill) -> str:
    """Return whether friction alone holds a joint, and which part of it that takes."""
    if still.held is None:
        return "not known"
    return "moves" if still.use is None else f"holds, {100 * (1 - still.use):.0f} % left"


def turn(report: SizingReport) -> str:
    """Return what is repeated: a cycle, or a period of several."""
    return "period" if len(report.duty.repeats) > 1 else "cycle"


def bus_lines(report: SizingReport) -> list[str]:
    """Return what all drives take from the bus, in words."""
    bus, each = report.bus, turn(report)
    if not bus.known:
        return [f"bus and braking: {bus.remedy}"]
    lines = [
        f"bus: peak {'of at least ' if bus.at_least else ''}{digits(bus.peak)} W "
        f"({digits(bus.current)} A), {digits(bus.mean)} W on average "
        f"({digits(bus.rms_current)} A RMS); {digits(bus.drawn)} J a {each}",
        f"braking: {digits(bus.braking)} W at most, {digits(bus.returned)} J a {each}, "
        f"{digits(bus.burst)} J in one go: {bus.remedy}"
        if bus.resistor is not None
        else f"braking: {bus.remedy}",
    ]
    if bus.mechanical:
        lines.append(
            f"{len(bus.mechanical)} of the drives without copper loss: no torque constant "
            "or resistance"
        )
    if bus.left_out:
        lines.append(f"the bus without {', '.join(bus.left_out)}: no motor")
    return lines
