"""What accuracy costs in time: tables for people, a dictionary for machines, rows for a CSV."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.show.report.tables import Column, Kind, Report, Table, paragraphs
from pinfric.show.report.values import digits, json_safe, power_of_ten, signed
from pinfric.study.accuracy.coupled import CoupledRun
from pinfric.study.accuracy.ladder import Rung
from pinfric.study.accuracy.precision import Run
from pinfric.study.accuracy.sampling import Sampled
from pinfric.study.accuracy.study import Accuracy

if TYPE_CHECKING:
    import pandas as pd


def accuracy_json(found: Accuracy, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Return everything `pinfric accuracy --json` prints; SI units but for `us` (microseconds)."""
    return json_safe({
        "scene": found.scene.source,
        "trajectory": found.trajectory,
        "runs": [asdict(run) for run in found.runs],
        "reference_difference": found.reference_difference,
        "sampling": [asdict(row) for row in found.sampling],
        "coupled": [asdict(run) for run in found.coupled],
        "ladder": [asdict(rung) for rung in found.ladder],
        "notes": list(found.notes),
        "warnings": list(warnings),
    })  # fmt: skip


def accuracy_frame(found: Accuracy) -> pd.DataFrame:
    """Return all rows of all studies; column `study` says which, others are empty where foreign."""
    import pandas as pd

    studies: tuple[tuple[str, tuple[Run | Sampled | CoupledRun | Rung, ...]], ...] = (
        ("simulation", found.runs), ("sampling", found.sampling),
        ("coupled", found.coupled), ("ladder", found.ladder),
    )  # fmt: skip
    return pd.DataFrame([{"study": name, **asdict(row)} for name, rows in studies for row in rows])


def accuracy_report(found: Accuracy) -> Report:
    """Return the tables and lines that `pinfric accuracy` prints, for a rich console."""
    name = Path(found.scene.source).stem
    title = f"{name}: {found.trajectory}"
    return paragraphs(
        *_simulated(f"{name}: simulation", found.runs, _reference_lines(found)),
        _sampling_table(f"{title}, fewer samples", found.sampling),
        [f"given {row.given}, {digits(row.rate)} per s: {row.problem}"
         for row in found.sampling if row.problem],
        _coupled_table(f"{title}, coupled friction", found.coupled) if found.coupled else None,
        _coupled_lines(found.coupled) if found.coupled else None,
        _ladder_table(f"{title}, friction models", found.ladder),
        [*_ladder_lines(found.ladder), *found.notes],
    )  # fmt: skip


def _simulated(title: str, runs: Sequence[Run], lines: Sequence[str]) -> list[Table | list[str]]:
    """A table, and below it why rows failed: a column is too narrow for reasons; () without any."""
    if not runs:
        return []
    failed = [f"{run.method}, {run.setting}: {run.problem}" for run in runs if run.problem]
    return [_runs_table(title, runs), [*failed, *lines]]


def _reference_lines(found: Accuracy) -> list[str]:
    lines = ["errors against `event`, two decades tighter; rad or m, and s"]
    if np.isfinite(found.reference_difference):
        lines.insert(0, "its reference and absolute coordinates differ by "
                     f"{_power(found.reference_difference)} at most")  # fmt: skip
    return lines


def _runs_table(title: str, runs: Sequence[Run]) -> Table:
    headings = ("error\nof q", "at the\nend", "of stick\ns", "time\nms", "evalua-\ntions")
    columns = (Column("method", Kind.LABEL), Column("setting", Kind.WORDS), *map(Column, headings))
    rows: list[tuple[str, ...]] = []
    for run in runs:
        if run.problem:
            rows.append((run.method, run.setting, "fails", "", "", "", ""))
            continue
        stick = f"misses {run.missed}" if run.missed else _power(run.stick_error)
        rows.append((
            run.method, run.setting, _power(run.error), _power(run.end_error), stick,
            digits(1e3 * run.wall_s), str(run.rhs),
        ))  # fmt: skip
    methods = [run.method for run in runs]
    changes = frozenset(i for i in range(1, len(runs)) if methods[i] != methods[i - 1])
    return Table(title, columns, rows, keys=2, sections=changes)


def _sampling_table(title: str, rows: Sequence[Sampled]) -> Table:
    headings = ("samples\nper s", "samples", "stick missed\ns", "of\ns", "error of\npeaks, %")
    cells = [
        (row.given, digits(row.rate), str(row.samples), *(("fails", "", "") if row.problem else (
            digits(row.missed_stick, 1e-9), digits(row.stick), digits(100 * row.peak_error, 1e-6)
        )))
        for row in rows
    ]  # fmt: skip
    return Table(title, (Column("given", Kind.WORDS), *map(Column, headings)), cells)


def _coupled_table(title: str, runs: Sequence[CoupledRun]) -> Table:
    """Passes to each tolerance, a row per coefficient and solver; error and time at the last."""
    tolerances = sorted({run.tolerance for run in runs}, reverse=True)
    columns = (
        Column("mu / mu\nat jam"), Column("contrac-\ntion"), Column("solver", Kind.LABEL),
        *(Column(f"passes\n{power_of_ten(tolerance, 0)}") for tolerance in tolerances),
        Column("error\nleft"), Column("time\nus"),
    )  # fmt: skip
    rows = []
    for share in dict.fromkeys(run.share for run in runs):
        for n, solver in enumerate(dict.fromkeys(run.solver for run in runs)):
            own = [run for run in runs if (run.share, run.solver) == (share, solver)]
            last = own[-1]
            passes = ["fails" if run.problem else str(run.iterations) for run in own]
            first = ("", "") if n else (f"{share:g}", f"{last.contraction:.4f}")
            rows.append((*first, solver, *passes, _power(last.error), digits(1e6 * last.wall_s)))
    return Table(title, columns, rows, keys=3)


def _coupled_lines(runs: Sequence[CoupledRun]) -> list[str]:
    jam = runs[0].mu_factor / runs[0].share
    return [
        f"at t = {digits(runs[0].t)} s, where it jams first as all mu grow: at {digits(jam)} times "
        "the scene's",
        "passes from no friction to a relative residual; error left in friction (relative) and "
        "time of one solve to the least of them",
    ]


def _ladder_table(title: str, rungs: Sequence[Rung]) -> Table:
    headings = ("time\nus", "peak\nchange", "RMS\nchange", "missing\n%")
    rows: list[tuple[str, ...]] = []
    for rung in rungs:
        if rung.problem:
            rows.append((rung.name, "fails", "", "", "", rung.problem))
        elif rung.on:
            rows.append((
                rung.name, digits(rung.us), _change(rung.peak_change), _change(rung.rms_change),
                digits(100 * rung.distance, 1e-6),
                f"{rung.drive}{' (motor)' if rung.motor_side else ''}",
            ))  # fmt: skip
    columns = (Column("model", Kind.LABEL), *map(Column, headings), Column("of", Kind.WORDS))
    return Table(title, columns, rows)


def _ladder_lines(rungs: Sequence[Rung]) -> list[str]:
    """What the columns mean, and the rungs that are not there."""
    lines = ["change: against the rung above, of the drive where the RMS changes most",
             "missing: RMS of effort to the whole model, mean over the drives"]  # fmt: skip
    if any(rung.name == "constant" for rung in rungs):
        lines.append("constant: coulomb friction fitted to the friction of this motion")
    if any(rung.on and not rung.problem and not np.isfinite(rung.us) for rung in rungs):
        lines.append("radial load: from loads without friction, one pass; an estimate, not timed")
    if off := [rung.name for rung in rungs if not rung.on]:
        lines.append(f"not in this scene: {', '.join(off)}")
    return lines


def _change(x: float) -> str:
    return signed(x, 1e-12) if np.isfinite(x) else ""


def _power(x: float) -> str:
    """An error as a decade: 3.7e-5; 0 as 0."""
    if not np.isfinite(x):
        return "n/a"
    return "0" if x == 0.0 else power_of_ten(x, 1)
