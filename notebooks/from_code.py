"""What pages take from the code: docstrings as they are written here, files' keys, commands.

A Sphinx extension. Docstrings are plain text in Google's sections: backticks are code, what is
indented is an equation, and nothing else is markup (|F| is a norm).
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_SECTION = re.compile(r"(Args|Attributes|Raises|Returns|Warns|Yields):$")
_CODE = re.compile(r"(`[^`\n]+`)")
#: Several attributes described at once; to Sphinx the first of two words would be a type.
_NAMES = re.compile(r"    \w+(, \w+)+:")


def as_restructured_text(lines: list[str]) -> list[str]:
    """Return a docstring's lines with its code and equations marked, all else without a meaning."""
    made: list[str] = []
    section, literal = False, -1  # in a section; indent of the equation one is in
    for line in lines:
        text = line.strip()
        indent = len(line) - len(line.lstrip())
        if not text:
            made.append("")
            continue
        if indent == 0:
            section, literal = bool(_SECTION.match(line)), -1
        elif literal < 0 and not section and not (made and made[-1]):
            made += ["::", ""]
            literal = indent
        names = _NAMES.match(line) if section else None
        if names:
            line = names[0].replace(", ", ",") + line[names.end() :]
        made.append(line if literal >= 0 else _escaped(line))
    return made


def _escaped(line: str) -> str:
    """A line of text: `code` in double backticks, no other markup."""
    parts = _CODE.split(line)
    return "".join(f"`{part}`" if i % 2 else re.sub(r"([*|]|_\b)", r"\\\1", part)
                   for i, part in enumerate(parts))  # fmt: skip


class _Docstrings:
    """Marks docstrings before napoleon reads their sections; of a property it would make a type."""

    def __init__(self) -> None:
        self.marked: list[str] = []

    def before(self, app: Sphinx, what: str, name: str, it: Any, o: Any, lines: list[str]) -> None:
        self.marked = as_restructured_text(lines)
        lines[:] = self.marked

    def after(self, app: Sphinx, what: str, name: str, it: Any, o: Any, lines: list[str]) -> None:
        if what in ("property", "attribute", "data"):
            lines[:] = self.marked


def _number_equations_by_tags(app: Sphinx, doctree: nodes.document) -> None:
    """Sphinx puts equations of several lines into an environment that allows no tags."""
    for node in doctree.findall(nodes.math_block):
        if not node.get("no-wrap", node.get("nowrap")):
            node["no-wrap"] = node["nowrap"] = True
            node[:] = [nodes.Text(f"\\begin{{equation*}}{node.astext()}\\end{{equation*}}")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx; napoleon has priority 500."""
    docstrings = _Docstrings()
    app.connect("autodoc-process-docstring", docstrings.before, priority=400)
    app.connect("autodoc-process-docstring", docstrings.after, priority=600)
    app.connect("doctree-read", _number_equations_by_tags)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
