"""Computing time against accuracy, as tables and as rows for a CSV file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.accuracy.ladder import Rung
from pinfric.accuracy.precision import Run
from pinfric.accuracy.sampling import Sampled
from pinfric.accuracy.study import Accuracy
from pinfric.model.described import quantities
from pinfric.show.report.rows import cell, table_of, text_of
from pinfric.show.report.tables import Report, Table, paragraphs
from pinfric.show.report.values import digits

if TYPE_CHECKING:
    import pandas as pd

_REFERENCE = "errors against `event` with a 100 times smaller tolerance; rad or m, and s"


def accuracy_frame(found: Accuracy) -> pd.DataFrame:
    """Return all rows of all studies; column `study` says which, others are empty where foreign."""
    import pandas as pd

    studies: tuple[tuple[str, tuple[Run | Sampled | Rung, ...]], ...] = (
        ("simulation", found.runs),
        ("sampling", found.sampling),
        ("ladder", found.ladder),
    )
    return pd.DataFrame([{"study": name, **asdict(row)} for name, rows in studies for row in rows])


def accuracy_report(found: Accuracy) -> Report:
    """Return the tables and lines that `pinfric accuracy` prints, for a rich console."""
    name = Path(found.scene.source).stem
    title = f"{name}: {found.trajectory}"
    return paragraphs(
        *_simulated(f"{name}: simulation", found.runs, [_REFERENCE]),
        _sampling_table(f"{title}, fewer samples", found.sampling),
        [
            f"given {row.given}, {digits(row.rate)} per s: {row.problem}"
            for row in found.sampling
            if row.problem
        ],
        _ladder_table(f"{title}, friction models", found.ladder),
        [*_ladder_lines(found.ladder), *found.notes],
    )


def _simulated(
    title: str, runs: Sequence[Run], lines: Sequence[str]
) -> list[Table | list[str] | None]:
    """A table, and below it why rows failed: a column is too narrow for reasons; () without any."""
    if not runs:
        return []
    failed = [f"{run.method}, {run.setting}: {run.problem}" for run in runs if run.problem]
    return [_runs_table(title, runs), [*failed, *lines]]


def _runs_table(title: str, runs: Sequence[Run]) -> Table | None:
    def stick(run: Run) -> str:
        return f"misses {run.missed}" if run.missed else text_of(run.stick_error, "decade")

    methods = [run.method for run in runs]
    changes = frozenset(i for i in range(1, len(runs)) if methods[i] != methods[i - 1])
    cells = _failing({"stick_error": stick}, "error", ("end_error", "stick_error", "wall_s", "rhs"))
    return table_of(title, runs, keys=2, sections=changes, cells=cells)


def _failing(
    cells: dict[str, Callable[[Any], str]], first: str, others: Sequence[str]
) -> dict[str, Callable[[Any], str]]:
    """Cells that say "fails" in the first of the figures where there is a problem."""

    def of(name: str, said: str) -> Callable[[Any], str]:
        def write(row: Any) -> str:
            if row.problem:
                return said
            own = quantities(type(row))[name]
            return cells[name](row) if name in cells else cell(row, name, own, 1e-9)

        return write

    return {first: of(first, "fails")} | {name: of(name, "") for name in others}


def _sampling_table(title: str, rows: Sequence[Sampled]) -> Table | None:
    return table_of(title, rows, cells=_failing({}, "missed_stick", ("stick", "peak_error")))


def _ladder_table(title: str, rungs: Sequence[Rung]) -> Table | None:
    def drive(rung: Rung) -> str:
        return rung.problem or f"{rung.drive}{' (motor)' if rung.motor_side else ''}"

    shown = [rung for rung in rungs if rung.on or rung.problem]
    cells = _failing({}, "us", ("distance", "peak_change", "rms_change")) | {"drive": drive}
    return table_of(title, shown, without=["motor_side"], cells=cells)


def _ladder_lines(rungs: Sequence[Rung]) -> list[str]:
    """What the columns mean, and the rungs that are not there."""
    lines = [
        "change: against the row above, of the drive where the RMS changes most",
        "missing: RMS difference of efforts from the full model, mean over the drives",
    ]
    if any(rung.name == "constant" for rung in rungs):
        lines.append("constant: coulomb friction fitted to the friction of this motion")
    if any(rung.on and not rung.problem and not np.isfinite(rung.us) for rung in rungs):
        lines.append(
            "radial load: loads computed without friction, one pass; an estimate, not timed"
        )
    if off := [rung.name for rung in rungs if not rung.on]:
        lines.append(f"not in this scene: {', '.join(off)}")
    return lines
