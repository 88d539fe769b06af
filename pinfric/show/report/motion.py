"""What a simulated motion says: tables for people, a dictionary for machines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pinfric.dynamics.simulation.motion import FINISHED, INTERRUPTED, Motion
from pinfric.model.brief import counted
from pinfric.show.report.tables import Column, Kind, Report, Table, paragraphs
from pinfric.show.report.values import digits, json_safe

#: Of more stick intervals, events or sites than this the first, or the largest, are printed.
_MOST_ROWS = 12


def motion_json(motion: Motion, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Return everything `pinfric simulate --json` prints; SI units, None for what is no number.

    Of a motion that Ctrl-C ended there is no energy: to integrate it can take as long as it took.
    """
    energy = None if motion.status == INTERRUPTED else motion.energy()
    return json_safe({
        "scene": motion.scene.source,
        "method": motion.method,
        "given": motion.given,
        "status": motion.status,
        "message": motion.message,
        "t_end": motion.t[-1],
        "samples": len(motion.t),
        "evaluations": motion.evaluations,
        "stick_intervals": [asdict(interval) for interval in motion.stick_intervals()],
        "events": [asdict(event) for event in motion.events],
        "energy": energy and {
            "work": energy.work,
            "change": energy.change,
            "friction_loss": dict(zip(motion.site_names, energy.friction_loss, strict=True)),
            "gear_loss": dict(zip(motion.actuator_names, energy.gear_loss, strict=True)),
            "residual": energy.residual,
        },
        "end": {"q": motion.q[-1], "v": motion.v[-1]},
        "warnings": list(warnings),
    })  # fmt: skip


def motion_report(motion: Motion) -> Report:
    """Return the tables and lines that `pinfric simulate` prints, for a rich console."""
    name = Path(motion.scene.source).stem
    title = (
        f"{name} · {motion.method}: {digits(float(motion.t[-1]))} s, {len(motion.t)} samples, "
        f"{motion.evaluations} right-hand sides"
        f"{', torques of the motors given' if motion.motor_torque is not None else ''}"
    )
    sticks: Table | list[str] = ["no joint sticks"]
    intervals = motion.stick_intervals()
    if intervals:
        rows = [
            (i.site, f"{i.start:.6f}", f"{i.end:.6f}", digits(i.end - i.start)) for i in intervals
        ]
        columns = (
            Column("joint", Kind.NAME, motion.site_names),
            *map(Column, ("from s", "to s", "for s")),
        )
        sticks = _first("sticks", columns, rows)
    events = None
    if motion.events:
        rows = [(f"{e.time:.6f}", e.name, e.kind, _way(e.kind, e.direction)) for e in motion.events]
        columns = (Column("time s"), Column("joint", Kind.NAME, motion.scene.joint_names),
                   Column("what", Kind.LABEL), Column("way", Kind.LABEL))  # fmt: skip
        events = _first("events", columns, rows)
    energy = _energy_table(motion) if motion.status != INTERRUPTED else None
    ended = [f"{motion.status}: {motion.message}"] if motion.status != FINISHED else []
    return paragraphs(title, sticks, events, energy, ended)


def _way(kind: str, direction: int) -> str:
    if kind == "limit":
        return "above" if direction > 0 else "below"
    return {1: "forward", -1: "backward"}.get(direction, "")


def _first(title: str, columns: Sequence[Column], rows: Sequence[tuple[str, ...]]) -> Table:
    if len(rows) > _MOST_ROWS:
        title += f" (the first {_MOST_ROWS} of {len(rows)})"
    return Table(title, columns, rows[:_MOST_ROWS])


def _energy_table(motion: Motion) -> Table:
    """The balance; of many sites those with the most heat, and the rest in one line."""
    energy = motion.energy()
    motors = motion.motor_torque is not None
    places = [f"heat at {site}" for site in motion.site_names]
    losses = [float(loss) for loss in energy.friction_loss]
    if motors:
        places += [f"heat in the gear of {drive}" for drive in motion.actuator_names]
        losses += [float(loss) for loss in energy.gear_loss]
    order = sorted(range(len(losses)), key=lambda s: -abs(losses[s]))
    few = len(order) <= _MOST_ROWS
    shown = set(order) if few else {s for s in order[:_MOST_ROWS] if losses[s]}
    rows = [
        (f"work of the {'motors' if motors else 'drives'}", digits(energy.work)),
        ("kinetic and potential", digits(energy.change)),
        *((place, digits(losses[s])) for s, place in enumerate(places) if s in shown),
    ]
    if rest := [s for s in order if s not in shown]:
        heat = digits(sum(losses[s] for s in rest))
        kind = "further place" if motors else "further joint"
        rows.append((f"heat at {counted(len(rest), kind)}", heat))
    rows.append(("unaccounted", digits(energy.residual)))
    return Table("energy", (Column("", Kind.NAME), Column("J")), rows)
