"""Stops of a cycle, as tables for people."""

from __future__ import annotations

from pathlib import Path

from pinfric.model.brief import counted
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Report, Table, paragraphs
from pinfric.show.report.values import digits
from pinfric.stops.study import StopSummary


def stop_report(
    scene: str, found: StopSummary, verbose: bool = True, written: bool = False
) -> Report:
    """Return the tables and lines that `pinfric stop` prints, for a rich console.

    Args:
        scene: its file. found: the stops. verbose: also by payload and speed, and all notes.
        written: the files of --out are, and the last line does not name it.
    """
    title = f"{Path(scene).stem} · {Path(found.trajectory).name}: {how(found)}"
    failing = [f"! {line}" for line in found.unmet]
    opening, unchecked = [verdict(found), *failing], not_checked(found)
    notes = [f"note: {line}" for line in found.notes]
    if not verbose:
        kinds = counted(len(unchecked), "kind of criteria was", "kinds of criteria were")
        rest = f"why {kinds} not checked, " if unchecked else ""
        ending = f"{rest}stops by payload and speed, {counted(len(notes), 'note')}: -v"
        ending += "" if written else "; page: --out FOLDER"
        return paragraphs(opening, axes_table(found, title), [ending])
    return paragraphs(opening, axes_table(found, title), grid_table(found), unchecked, notes)


def axes_table(found: StopSummary, title: str = "the worst stops of each axis") -> Table | None:
    """Return the worst of each drive's joint."""
    return table_of(title, found.axes)


def verdict(found: StopSummary) -> str:
    """Return in a line how long a stop takes, how far the tool goes, and what is not met."""
    said = f"every stop ends within {digits(found.time)} s (commanded at {digits(found.command)} s)"
    if found.path is not None:
        said += f", the tool's path within {1e3 * found.path:.0f} mm"
    every = [c for axis in found.axes for c in axis.criteria]
    unchecked = sum(c.unchecked for c in every)
    unmet = counted(len(found.unmet), "criterion", "criteria")
    met = f"{unmet} not met" if found.unmet else "no criterion fails"
    return f"{said}; {met}, {unchecked} of {len(every)} not checked"


def not_checked(found: StopSummary) -> list[str]:
    """Return a line for each criterion that was not checked: of which axes, and what is missing."""
    axes: dict[tuple[str, str], list[str]] = {}
    for axis in found.axes:
        for criterion in axis.criteria:
            if criterion.unchecked:
                axes.setdefault((criterion.name, criterion.note), []).append(axis.name)
    return [f"not checked: {name} of {', '.join(of)}: {why}" for (name, why), of in axes.items()]


def how(found: StopSummary) -> str:
    """Return how the robot was stopped, in words."""
    least, greatest = found.friction
    friction = "" if least == greatest == 1.0 else f", friction x {least:g} to {greatest:g}"
    return f"category {found.category}, {digits(1e3 * found.reaction_time)} ms reaction{friction}"


def grid_table(
    found: StopSummary,
    title: str = "by payload and speed, at the samples of the longest and the farthest stop",
) -> Table | None:
    """Return stopping times and travels by payload and speed."""
    return table_of(title, found.grid, keys=2)
