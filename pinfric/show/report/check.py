"""The findings of `pinfric check`, as a list."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from pinfric.checking.findings import CheckReport, Finding, Severity, alike
from pinfric.model.brief import counted

if TYPE_CHECKING:
    from rich.console import RenderableType

_STYLES = {Severity.ERROR: "bold red", Severity.WARNING: "yellow", Severity.NOTE: "dim"}


def check_report(report: CheckReport) -> list[RenderableType]:
    """Return what `pinfric check` prints."""
    from rich.text import Text

    figures, title = report.figures, Path(report.source).name
    if figures:
        links, joints = (counted(int(figures[f"{x}s"]), x) for x in ("link", "joint"))
        title += f": {links}, {joints}, {figures['moving_mass']:.4g} kg that move"
        title += f", {figures['reach']:.3g} m reach" if figures["reach"] else ""
    items: list[RenderableType] = [Text(title, style="bold"), Text()]
    items += [finding_list(report.findings), Text()] if report.findings else []
    numbers = {s: report.count(s) for s in (Severity.ERROR, Severity.WARNING, Severity.NOTE)}
    kinds = {s: len({f.kind for f in report.findings if f.severity == s}) for s in numbers}
    listed = ", ".join(
        counted(n, s.name.lower()) + (f" of {counted(kinds[s], 'kind')}" if kinds[s] < n else "")
        for s, n in numbers.items()
        if n
    )
    if numbers[Severity.ERROR]:
        closing = f"{listed}: correct the errors before you use any result."
    elif numbers[Severity.WARNING]:
        closing = f"{listed}: usable; look at the warnings first."
    else:
        closing = f"nothing implausible found{f' ({listed})' if listed else ''}."
    return [*items, Text(closing)]


def doubts(report: CheckReport) -> list[RenderableType]:
    """Return what `pinfric new` prints of a robot: errors, warnings, and how many notes."""
    from rich.text import Text

    grave = [finding for finding in report.findings if finding.severity > Severity.NOTE]
    notes = len(report.findings) - len(grave)
    items: list[RenderableType] = [finding_list(grave)] if grave else []
    if notes:
        also = "also " if grave else ""
        items.append(Text(f"{also}{counted(notes, 'note')}, listed by `pinfric check`"))
    return items


def finding_list(findings: Iterable[Finding]) -> RenderableType:
    """Return findings as lines, the same finding at several places as one."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for first, also in alike(findings):
        table.add_row(
            Text(first.severity.name.lower(), _STYLES[first.severity]),
            Text.assemble((first.place, "bold"), f": {first.text}{also}"),
        )
    return table
