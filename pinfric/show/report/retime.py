"""What retiming found: tables for people, a dictionary for machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.show.report.tables import Column, Kind, Report, Table, paragraphs
from pinfric.show.report.values import digits, json_safe
from pinfric.study.retime.fastest import DriveSet
from pinfric.study.retime.limits import KINDS
from pinfric.study.retime.retime import RetimeResult

#: drive -> limit -> d ln T/d ln limit.
Sensitivity = Mapping[str, Mapping[str, float]]


def retime_json(
    result: RetimeResult, sensitivity: Sensitivity | None = None, warnings: Sequence[str] = ()
) -> dict[str, Any]:
    """Return everything `pinfric retime --json` prints; SI units, None for what is no number."""
    problem, most = result.problem, result.usage.max(axis=0, initial=0.0)
    rms = result.rms
    return json_safe({
        "scene": problem.scene.source,
        "path": problem.path.source,
        "duration": result.duration,
        "before": result.before,
        "moves": result.moves,
        "holds": list(problem.path.holds),
        "uniform": result.uniform,
        "smooth": result.smooth,
        "excess": result.excess,
        "sample_rate": problem.policy.sample_rate,
        "grid_points": len(result.profile.x),
        "drives": [
            {
                "name": drive.name,
                "motor": limits.motor or None,
                "limits": limits.model_dump(exclude={"transmission", "motor"}),
                "use": dict(zip(KINDS, most[d], strict=True)),
                "limiting": result.limiting.get(drive.name, {}),
                "rms": None if rms is None else float(rms[d]),
                "sensitivity": None if sensitivity is None else sensitivity.get(drive.name, {}),
            }
            for d, (drive, limits) in enumerate(
                zip(problem.scene.drives, problem.limits, strict=True)
            )
        ],
        "warnings": list(warnings),
    })  # fmt: skip


def retime_report(result: RetimeResult, sensitivity: Sensitivity | None = None) -> Report:
    """Return the tables and lines that `pinfric retime` prints, for a rich console."""
    path = result.problem.path
    name = f"{Path(result.problem.scene.source).stem} · {Path(path.source).name}"
    before = ""
    if result.before is not None:
        faster = 100.0 * (1.0 - result.duration / result.before)
        before = f", {digits(result.before)} s before: {abs(faster):.3g} % " + (
            "less" if faster >= 0 else "more"
        )
    title = f"{name}: {digits(result.duration)} s{before}"
    slopes = None if sensitivity is None else _sensitivities(sensitivity)
    return paragraphs(title, _moves(result), _drives(result), slopes, _lines(result))


def fastest_table(sets: Sequence[DriveSet]) -> Table:
    """Return the sets of drives that no other one beats in both mass and time.

    Args:
        sets: of `fastest.fastest_sets`.
    """
    best = [x for x in sets if x.best]
    rows = []
    for now in best:
        changed = [f"{joint}: {name}" for joint, name in now.drives.items()
                   if best[0].drives[joint] != name]  # fmt: skip
        rows.append((digits(now.mass), f"{now.duration:.3f}", "; ".join(changed), now.held_by))
    columns = (
        Column("drives\nkg"),
        Column("cycle\ns"),
        Column("other than in the first", Kind.WORDS),
        Column("held back by", Kind.WORDS),
    )
    title = f"fastest along the path, {len(sets)} sets of drives tried"
    return Table(title, columns, rows, keys=2)


def _moves(result: RetimeResult) -> Table:
    holds = result.problem.path.holds
    rows = [(str(i), digits(time), digits(holds[i]), digits(holds[i + 1]))
            for i, time in enumerate(result.moves)]  # fmt: skip
    columns = (Column("move"), Column("takes\ns"), Column("after a\nhold of s"),
               Column("before a\nhold of s"))  # fmt: skip
    return Table("moves", columns, rows)


def _drives(result: RetimeResult) -> Table:
    """Which limits hold the motion back, and how near each drive comes to its nearest one."""
    most = result.usage.max(axis=0, initial=0.0)
    rows = []
    for d, drive in enumerate(result.problem.scene.drives):
        nearest = int(np.argmax(most[d]))
        shares = result.limiting.get(drive.name, {})
        text = ", ".join(f"{kind} {percent(share)}" for kind, share in
                         sorted(shares.items(), key=lambda entry: -entry[1]))  # fmt: skip
        row = [drive.name, text, f"{percent(most[d, nearest])} {KINDS[nearest]}"]
        if result.rms is not None:
            row.append(percent(float(result.rms[d])))
        rows.append(tuple(row))
    columns = [Column("drive", Kind.NAME), Column("holds the motion back,\nof the time moving",
               Kind.WORDS), Column("most of a limit used", Kind.WORDS)]  # fmt: skip
    if result.rms is not None:
        columns.append(Column("continuous\ntorque used"))
    return Table("drives", columns, rows)


def _sensitivities(sensitivity: Sensitivity) -> Table:
    entries = [(drive, kind, value) for drive, kinds in sensitivity.items()
               for kind, value in kinds.items()]  # fmt: skip
    entries.sort(key=lambda entry: entry[2])
    rows = [(drive, kind, f"{value:+.3f} %") for drive, kind, value in entries]
    columns = (Column("drive", Kind.NAME), Column("limit", Kind.LABEL), Column("change"))
    return Table("time moving, for 1 % more of a limit", columns, rows)


def _lines(result: RetimeResult) -> list[str]:
    rate = result.problem.policy.sample_rate
    lines = [f"no limit is exceeded by more than {100 * result.excess:.2g} % at {rate:g} Hz "
             "(inverse dynamics)"]  # fmt: skip
    if result.uniform is not None:
        gain = 100.0 * (result.uniform / result.duration - 1.0)
        lines.append(f"slowed down as a whole to keep the continuous torques it would take "
                     f"{digits(result.uniform)} s: {gain:.3g} % more")  # fmt: skip
    if result.smooth:
        cost = result.smooth * len(result.moves)
        lines.append(f"smoothing over {1e3 * result.smooth:g} ms costs {digits(cost)} s")
    if result.profile.holes:
        lines.append(f"{result.profile.holes} times a lower limit cut the accelerations in two; "
                     "the larger part was kept")  # fmt: skip
    return lines


def percent(share: float) -> str:
    """Return a share as a percentage with two digits or three."""
    return f"{100 * share:.3g} %" if share >= 1e-3 else "<0.1 %"
