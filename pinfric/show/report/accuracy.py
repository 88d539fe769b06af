"""Computing time against accuracy, as a table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pinfric.accuracy.study import Accuracy, Run
from pinfric.model.described import quantities
from pinfric.show.report.rows import cell, table_of
from pinfric.show.report.tables import Report, Table, paragraphs

_REFERENCE = "errors against `event` with a 100 times smaller tolerance; rad or m, and s"


def accuracy_report(found: Accuracy) -> Report:
    """Return the table and lines that `pinfric accuracy` prints, for a rich console."""
    failed = [f"{run.method}, {run.setting}: {run.problem}" for run in found.runs if run.problem]
    return paragraphs(accuracy_table(found), [*failed, _REFERENCE])


def accuracy_table(found: Accuracy) -> Table | None:
    """Return a row a run; one that failed has no figures: a column is too narrow for reasons."""
    own = quantities(Run)

    def shown(name: str) -> Callable[[Run], str]:
        def write(run: Run) -> str:
            if run.problem:
                return "fails" if name == "error" else ""
            if name == "stick_error" and run.missed:
                return f"misses {run.missed}"
            return cell(run, name, own[name], 1e-9)

        return write

    figures = ("error", "end_error", "stick_error", "wall_s", "rhs")
    methods = [run.method for run in found.runs]
    changes = frozenset(i for i in range(1, len(methods)) if methods[i] != methods[i - 1])
    title = f"{Path(found.scene.source).stem}: simulation"
    cells = {name: shown(name) for name in figures}
    return table_of(title, found.runs, keys=2, sections=changes, cells=cells)
