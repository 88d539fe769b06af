"""Cells of text tables: one rule for logs, catalogues, and efforts over time."""

from __future__ import annotations

import csv
from pathlib import Path

from pinfric.errors import PinfricError
from pinfric.model.yamlfile import NOT_UTF_8, bounded, brief_path


def separator_of(line: str) -> str:
    """Return the mark that separates a line's cells; a space if there is no other."""
    mark = max("\t;,", key=lambda x: (line.count(x), x == ","))
    return mark if mark in line else " "


def number_of(cell: str) -> float:
    """Return a cell's number; as in a URDF only ASCII digits count, without underscores.

    Raises:
        ValueError: it is no such number.
    """
    if not cell.isascii() or "_" in cell:
        raise ValueError(f"could not convert string to float: {cell!r}")
    return float(cell)


def cells_of(line: str, separator: str) -> list[str]:
    """Return a line's cells without their quotes."""
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def read_table(
    path: Path, error: type[PinfricError], where: str = ""
) -> tuple[str, list[str], list[tuple[int, list[str]]]]:
    """Return a small table: its separator, its header, and (line number, cells) of filled rows.

    Comments above the header are skipped, unless the last one is the header: it has as many names
    as the row of figures below it. Messages name `where`, or else the file.

    Raises:
        PinfricError: as `error`: unreadable, too large, not text.
    """
    where = where or brief_path(path)
    try:
        lines = bounded(path, error).decode("utf-8-sig").splitlines()
        first = next((n for n, x in enumerate(lines) if x.strip() and x.lstrip()[0] != "#"), 0)
        separator = separator_of("".join(lines[first : first + 1]))
        if first and _is_header(lines[first - 1], lines[first], separator):
            first -= 1
            lines[first] = lines[first].lstrip().lstrip("#").strip()
        reader = csv.reader(lines[first:], delimiter=separator)
        rows = [(first + reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except UnicodeDecodeError:
        raise error(f"{where}: {NOT_UTF_8}") from None
    except (OSError, ValueError, csv.Error) as problem:  # also a name that no file system takes
        reason = getattr(problem, "strerror", None) or str(problem)
        raise error(f"{where}: cannot be read: {reason}") from None
    (_, header), *below = rows or [(1, [])]
    return separator, header, [(line, row) for line, row in below if any(row)]


def _is_header(comment: str, row: str, separator: str) -> bool:
    """Whether a comment is the header of the row below: names, as many as its cells, of figures."""

    def figures(cells: list[str]) -> int:
        return sum(_is_figure(cell) for cell in cells)

    if not comment.lstrip().startswith("#"):
        return False
    names, cells = (cells_of(x, separator) for x in (comment.lstrip().lstrip("#").strip(), row))
    return len(names) == len(cells) > 1 and figures(cells) > 0 == figures(names)


def _is_figure(cell: str) -> bool:
    try:
        number_of(cell)
    except ValueError:
        return False
    return True
