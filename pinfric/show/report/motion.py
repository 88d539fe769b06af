"""Result of a simulation, as tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pinfric.dynamics.simulation.motion import FINISHED, Event, Motion, listed_times
from pinfric.model.brief import counted
from pinfric.show.motion_summary import MotionSummary
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Column, ColumnKind, Report, Table, paragraphs
from pinfric.show.report.values import digits

#: Of more stick intervals, events or sites than this the first, or the largest, are printed.
_MOST_ROWS = 12


def motion_report(motion: Motion, summary: MotionSummary) -> Report:
    """Return what `pinfric simulate` prints."""
    motors = motion.motor_torque is not None
    title = (
        f"{Path(motion.scene.source).stem} · {summary.method}: {digits(summary.t_end)} s, "
        f"{summary.samples} samples, {summary.evaluations} right-hand sides"
        f"{', torques of the motors given' if motors else ''}"
    )
    sticks = _first("sticks", summary.stick_intervals) or ["no joint sticks"]

    def direction(event: Event) -> str:
        ways = (
            {1: "above", -1: "below"} if event.kind == "limit" else {1: "forward", -1: "backward"}
        )
        return ways.get(event.direction, "")

    events = _first("events", summary.events, {"direction": direction})
    energy = None
    if (balance := summary.energy) is not None:  # the sites with the most heat, others in one line
        losses = {f"heat at {site}": loss for site, loss in balance.friction_loss.items()}
        if motors:
            losses |= {f"heat in the gear of {drive}": x for drive, x in balance.gear_loss.items()}
        order = sorted(losses, key=lambda place: -abs(losses[place]))
        few = len(order) <= _MOST_ROWS
        shown = set(order) if few else {place for place in order[:_MOST_ROWS] if losses[place]}
        rows = [
            (f"work of the {'motors' if motors else 'drives'}", balance.work),
            ("kinetic and potential", balance.change),
            *((place, loss) for place, loss in losses.items() if place in shown),
        ]
        if unshown := [losses[place] for place in order if place not in shown]:
            kind = "further place" if motors else "further joint"
            rows.append((f"heat at {counted(len(unshown), kind)}", sum(unshown)))
        rows.append(("unaccounted", balance.residual))
        columns = (Column("", ColumnKind.WORDS), Column("J"))
        energy = Table("energy", columns, [(place, digits(x)) for place, x in rows])
    ended = [f"{summary.status}: {summary.message}"] if summary.status != FINISHED else []
    return paragraphs(title, sticks, events, energy, listed_times(summary.unproved), ended)


def _first(
    title: str, rows: Sequence[Any], cells: Mapping[str, Callable[[Any], str]] | None = None
) -> Table | None:
    if len(rows) > _MOST_ROWS:
        title += f" (the first {_MOST_ROWS} of {len(rows)})"
    return table_of(title, rows[:_MOST_ROWS], cells=cells)
