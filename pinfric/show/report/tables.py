"""The table of all reports: it fits the width, and never cuts a number.

    Table("efforts", (Column("joint", ColumnKind.NAME), Column("peak\\nN m")), [("elbow", "5.20")])

Names lose letters in their middle; words are wrapped; columns that do not fit go into a further
block below, with the names again. The width is that of the terminal (of any standard stream, so
also behind `| less`), or the environment's COLUMNS, else 80.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

from pinfric.show.report.names import affixes, least_room, left_out, said_short, shortened, without

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult

#: What a rich console prints, one part below the other.
Report = list["RenderableType"]

#: Blanks between columns.
_GAP = 2
#: Letters that a name keeps, and a column of words, before another block is begun for the rest.
_NAME, _WORDS = 14, 19


class ColumnKind(Enum):
    """How a column behaves in little room."""

    #: Right-aligned; never cut, never wrapped.
    NUMBER = "number"
    #: Short words, left-aligned; never cut, never wrapped.
    LABEL = "label"
    #: A name a line; cut in the middle, so that each stands for one name only.
    NAME = "name"
    #: Wrapped at blanks.
    WORDS = "words"


@dataclass(frozen=True)
class Column:
    """A column's heading, of one or more lines, and its kind.

    `among`: further names, not in the table, from which a cut name must differ.
    """

    heading: str
    kind: ColumnKind = ColumnKind.NUMBER
    among: Sequence[str] = ()

    @property
    def shortened(self) -> bool:
        """Whether a report shortens its names, of joints and drives, by their common ends."""
        return self.kind is ColumnKind.NAME and not self.among


@dataclass(frozen=True)
class Table:
    """A table for a rich console.

    Args:
        title: printed above; empty for none.
        columns: from left to right.
        rows: a text per column.
        keys: number of columns at the left that name a row: every block repeats them.
        sections: rows above which a rule is drawn.
        faint: rows that are printed dim.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    keys: int = 1
    sections: frozenset[int] = frozenset()
    faint: frozenset[int] = frozenset()

    def names(self) -> list[str]:
        """Return the names of joints and drives in its cells."""
        columns = [(c, x) for c, x in enumerate(self.columns) if x.shortened]
        cells = (row[c].split("\n") for c, _ in columns for row in self.rows)
        return [name for names in cells for name in names]

    def without(self, front: str, back: str) -> Table:
        """Return the table with names without this beginning and end."""
        named = {c for c, column in enumerate(self.columns) if column.shortened}
        cut = dict(zip(self.names(), without(self.names(), front, back), strict=True))
        rows = [
            [
                "\n".join(cut[x] for x in t.split("\n")) if c in named else t
                for c, t in enumerate(row)
            ]
            for row in self.rows
        ]
        return replace(self, rows=rows)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        from rich.box import SIMPLE_HEAD
        from rich.table import Table as RichTable
        from rich.text import Text

        cells, widths, blocks = _lay_out(self, options.max_width)
        if self.title:
            yield Text(self.title, style="bold")
        for i, block in enumerate(blocks):
            if i:
                yield Text()
            # a table wider than the console would be cut: a terminal that wraps it loses nothing
            width = sum(widths[c] for c in block) + _GAP * len(block)
            wide = options.update(max_width=max(options.max_width, width))
            grid = RichTable(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
            for c in block:
                number = self.columns[c].kind is ColumnKind.NUMBER
                grid.add_column(
                    self.columns[c].heading,
                    justify="right" if number else "left",
                    overflow="fold",
                    width=widths[c],
                )
            for r in range(len(self.rows)):
                if r in self.sections and r:
                    grid.add_section()
                texts = [Text(cells[c][r]) for c in block]  # no markup: names may hold [brackets]
                grid.add_row(*texts, style="dim" if r in self.faint else None)
            yield from console.render(grid, wide)


def paragraphs(*parts: Table | str | Sequence[str] | None) -> Report:
    """Return a report: its parts with a blank line between them.

    The common beginning and end of all names in its tables is left out, also in lines, and stated
    in the title of the first. Lines that begin with "! " say what fails, bold and red.

    Args:
        parts: tables, titles (one text), lines; None and empty ones are left out.
    """
    from rich.text import Text

    tables = [part for part in parts if isinstance(part, Table)]
    names = [name for table in tables for name in table.names()]
    front, back = affixes(names)
    short = dict(zip(names, without(names, front, back), strict=True))
    note = left_out(front, back)
    printed: Report = []
    for part in parts:
        printed += [Text()] * bool(printed and part)
        if isinstance(part, Table):
            table = part.without(front, back)
            titles = [text for text in (table.title, note * (part is tables[0])) if text]
            printed.append(replace(table, title="; ".join(titles)))
        elif isinstance(part, str):
            printed.append(Text(part, style="bold"))
        else:
            printed += [
                Text(said_short(line, short), style="bold red" if line.startswith("! ") else "")
                for line in part or ()
            ]
    return printed


def _lay_out(table: Table, width: int) -> tuple[list[list[str]], list[int], list[list[int]]]:
    """Return the cells as printed, each column's width, the columns of each block."""
    cells = [[row[c] for row in table.rows] for c in range(len(table.columns))]
    whole = [
        _widest((column.heading, *texts))
        for column, texts in zip(table.columns, cells, strict=True)
    ]
    least = [
        _least(column, _lines(texts), whole[c], width)
        for c, (column, texts) in enumerate(zip(table.columns, cells, strict=True))
    ]
    blocks = _blocks(least, table.keys, width)
    for narrower in range(width - 1, 0, -1):  # as even as so many blocks can be
        even = _blocks(least, table.keys, narrower)
        if len(even) > len(blocks):
            break
        blocks = even
    # A block's spare width goes to the keys, then to the others, left to right; words beside a long
    # key shrink below what is good where their block would be too wide
    widths = list(least)

    def spare(block: Sequence[int]) -> int:
        return width - sum(widths[c] + _GAP for c in block) + _GAP

    for c in range(table.keys):
        widths[c] = min(whole[c], widths[c] + max(min(map(spare, blocks)), 0))
    for block in blocks:
        for c in block[table.keys :]:
            column = table.columns[c]
            folds = column.kind is ColumnKind.WORDS
            floor = _widest((column.heading,)) if folds else widths[c]
            widths[c] = min(whole[c], max(widths[c] + spare(block), floor))
    for c, column in enumerate(table.columns):
        names = [*_lines(cells[c]), *column.among]
        if column.kind is ColumnKind.NAME and least_room(names) <= widths[c]:
            short = dict(zip(names, shortened(names, widths[c]), strict=True))
            cells[c] = ["\n".join(short[x] for x in cell.split("\n")) for cell in cells[c]]
    return cells, widths, blocks


def _widest(texts: Sequence[str]) -> int:
    from rich.cells import cell_len

    return max((cell_len(line) for text in texts for line in text.split("\n")), default=0)


def _least(column: Column, texts: Sequence[str], whole: int, width: int) -> int:
    """The width below which a column goes to another block."""
    heading = _widest((column.heading,))
    if column.kind is ColumnKind.NAME:
        tell_apart = least_room([*texts, *column.among])
        if tell_apart > width // 2:  # no shorter name is one name only: they are folded
            tell_apart = 0
        return min(whole, max(heading, tell_apart, min(_widest(texts), _NAME)))
    if column.kind is ColumnKind.WORDS:
        word = _widest([word for text in texts for word in text.split()])
        return min(whole, max(heading, _WORDS, word if word <= width // 2 else 0))
    return whole


def _blocks(least: Sequence[int], keys: int, width: int) -> list[list[int]]:
    """The columns of each block: as many as fit beside the keys, at least one."""
    key = list(range(keys))
    taken = sum(least[c] + _GAP for c in key)
    blocks: list[list[int]] = []
    room = 0
    for c in range(keys, len(least)):
        if not blocks or least[c] > room:
            blocks.append([*key])
            room = width - taken
        blocks[-1].append(c)
        room -= least[c] + _GAP
    return blocks or [key]


def _lines(cells: Sequence[str]) -> list[str]:
    return [line for cell in cells for line in cell.split("\n")]
