"""Tables as HTML."""

from __future__ import annotations

from html import escape

from pinfric.show.report.tables import ColumnKind, Table

#: Separators in a name behind which a browser may break it.
_BREAKS = "_./"


def html_of(table: Table) -> str:
    """Return a table as HTML, as on the terminal: numbers to the right."""
    left = [column.kind is not ColumnKind.NUMBER for column in table.columns]
    names = [column.kind is ColumnKind.NAME for column in table.columns]
    heads = "".join(
        _cell("th", column.heading, is_left)
        for column, is_left in zip(table.columns, left, strict=True)
    )
    rows = [
        "".join(_cell("td", *of) for of in zip(row, left, names, strict=True)) for row in table.rows
    ]
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    first = table.title.split(" ")[0].rstrip(",:")
    named = table.title.capitalize()[0] + table.title[1:] if first.isalpha() else table.title
    title = f"<h3>{escape(named)}</h3>\n" if table.title else ""
    return (
        f'{title}<div class="scroll"><table class="wide figures">\n'
        f"<thead><tr>{heads}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>"
    )


class Marked(str):
    """A cell that is HTML already."""

    def __html__(self) -> str:
        return self


def mark(kind: str, text: str, title: str = "") -> Marked:
    """Return text on a coloured ground: "ok", "tight", "bad", "none" or "free" of the pages' style.

    Args:
        title: shown where a reader points at it.
    """
    more = f' title="{escape(title)}"' if title else ""
    return Marked(f'<span class="m {kind}"{more}>{escape(text)}</span>')


def _cell(tag: str, text: str, left: bool, name: bool = False) -> str:
    content = text if isinstance(text, Marked) else escape(text).replace("\n", "<br>")
    for letter in _BREAKS if name else "":
        content = content.replace(letter, f"{letter}<wbr>")
    kind = ' class="l"' if left else ""
    return f"<{tag}{kind}>{content}</{tag}>"
