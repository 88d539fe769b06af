"""How a table of a maker was understood, for people."""

from __future__ import annotations

from pinfric.drives.table import ImportedTable
from pinfric.model.brief import counted
from pinfric.show.report.tables import Column, ColumnKind, Report, Table, paragraphs


def imported_report(found: ImportedTable) -> Report:
    """Return what `pinfric catalog` prints: the first row's figures, and what was left out."""
    heads = ("column", "read as", "in the first row", "in SI", "")
    columns = [Column(head, ColumnKind.LABEL) for head in heads]
    said = []
    if found.unused:
        said.append(f"columns not used: {', '.join(found.unused)}")
    if found.left_out:
        said.append(f"{counted(len(found.left_out), 'row')} left out:")
        said += found.left_out
    return paragraphs(Table("how the table was understood", columns, list(found.first)), said)
