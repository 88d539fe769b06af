"""Stops of a cycle, as tables."""

from __future__ import annotations

from pathlib import Path

from pinfric.model.brief import counted
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Report, Table, paragraphs
from pinfric.show.report.values import digits
from pinfric.stops.screen import StopScreen
from pinfric.stops.study import StopSummary


def stop_report(
    scene: str, summary: StopSummary, verbose: bool = True, written: bool = False
) -> Report:
    """Return what `pinfric stop` prints.

    Args:
        scene: its file.
        verbose: also by payload and speed, and all notes.
        written: see `sizing_report`.
    """
    title = f"{Path(scene).stem} · {Path(summary.trajectory).name}: {how(summary)}"
    failing = [f"! {line}" for line in summary.unmet]
    opening, unchecked = [verdict(summary), *failing], not_checked(summary)
    notes = [f"note: {line}" for line in summary.notes]
    if not verbose:
        kinds = counted(len(unchecked), "kind of criteria was", "kinds of criteria were")
        reasons = f"why {kinds} not checked, " if unchecked else ""
        ending = f"{reasons}stops by payload and speed, {counted(len(notes), 'note')}: -v"
        ending += "" if written else "; page: --out FOLDER"
        return paragraphs(opening, axes_table(summary, title), [ending])
    return paragraphs(opening, axes_table(summary, title), grid_table(summary), unchecked, notes)


def axes_table(summary: StopSummary, title: str = "the worst stops of each axis") -> Table | None:
    """Return the worst stops of each drive's joint."""
    return table_of(title, summary.axes)


def verdict(summary: StopSummary) -> str:
    """Return in a line the longest stop, the tool's path, and what is not met."""
    at = f"commanded at {digits(summary.command)} s"
    said = f"every stop ends within {digits(summary.time)} s ({at})"
    if summary.path is not None:
        said += f", the tool's path within {1e3 * summary.path:.0f} mm"
    criteria = [c for axis in summary.axes for c in axis.criteria]
    unchecked = sum(c.unchecked for c in criteria)
    unmet = counted(len(summary.unmet), "criterion", "criteria")
    met = f"{unmet} not met" if summary.unmet else "no criterion fails"
    return f"{said}; {met}, {unchecked} of {len(criteria)} not checked"


def not_checked(summary: StopSummary) -> list[str]:
    """Return a line for each unchecked criterion: its axes, and what is missing."""
    axes: dict[tuple[str, str], list[str]] = {}
    for axis in summary.axes:
        for criterion in axis.criteria:
            if criterion.unchecked:
                axes.setdefault((criterion.name, criterion.note), []).append(axis.name)
    return [f"not checked: {name} of {', '.join(of)}: {why}" for (name, why), of in axes.items()]


def how(summary: StopSummary | StopScreen) -> str:
    """Return how the robot was stopped."""
    least, greatest = summary.friction
    friction = "" if least == greatest == 1.0 else f", friction x {least:g} to {greatest:g}"
    return (
        f"category {summary.category}, {digits(1e3 * summary.reaction_time)} ms reaction{friction}"
    )


def grid_table(
    summary: StopSummary,
    title: str = "by payload and speed, at the samples of the longest and the farthest stop",
) -> Table | None:
    """Return stopping times and travels by payload and speed."""
    return table_of(title, summary.grid, keys=2)
