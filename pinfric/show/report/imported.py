"""How a maker's table was understood."""

from __future__ import annotations

from pinfric.drives.table import ImportedTable
from pinfric.model.brief import counted
from pinfric.show.report.tables import Column, ColumnKind, Report, Table, paragraphs


def imported_report(imported: ImportedTable) -> Report:
    """Return what `pinfric catalog` prints: the first row's figures, and what was left out."""
    heads = ("column", "read as", "in the first row", "in SI", "")
    columns = [Column(head, ColumnKind.LABEL) for head in heads]
    said = []
    if imported.unused:
        said.append(f"columns not used: {', '.join(imported.unused)}")
    if imported.left_out:
        said.append(f"{counted(len(imported.left_out), 'row')} left out:")
        said += imported.left_out
    return paragraphs(Table("how the table was understood", columns, list(imported.first)), said)
