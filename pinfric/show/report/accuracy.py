"""Table of computing time against accuracy."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from pathlib import Path

from pinfric.accuracy.study import Accuracy, TimedRun
from pinfric.model.described import quantities
from pinfric.show.report.rows import cell, table_of
from pinfric.show.report.tables import Report, paragraphs

_REFERENCE = "errors against `event` with a 100 times smaller tolerance; rad or m, and s"


def accuracy_report(accuracy: Accuracy) -> Report:
    """Return what `pinfric accuracy` prints: a row per run, reasons of failures below the table."""
    own = quantities(TimedRun)

    def shown(name: str, run: TimedRun) -> str:
        if run.problem:
            return "fails" if name == "error" else ""
        if name == "stick_error" and run.missed:
            return f"misses {run.missed}"
        return cell(run, name, own[name], 1e-9)

    figures = ("error", "end_error", "stick_error", "wall_s", "rhs")
    pairs = enumerate(pairwise(run.method for run in accuracy.runs), 1)
    table = table_of(
        f"{Path(accuracy.scene.source).stem}: simulation",
        accuracy.runs,
        keys=2,
        sections=frozenset(i for i, (before, after) in pairs if before != after),
        cells={name: partial(shown, name) for name in figures},
    )
    failed = [f"{run.method}, {run.setting}: {run.problem}" for run in accuracy.runs if run.problem]
    return paragraphs(table, [*failed, _REFERENCE])
