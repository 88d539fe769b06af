"""What the site takes from the code: docstrings as they are written here.

A Sphinx extension. Docstrings are plain text in Google's sections: backticks are code, what is
indented is an equation, and nothing else is markup (|F| is a norm).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from file_keys import CODE, as_yaml
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from pinfric.model.entry import Entry

_SECTION = re.compile(r"(Args|Attributes|Raises|Returns|Warns|Yields):$")
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
    parts = CODE.split(line)
    return "".join(
        f"`{part}`" if i % 2 else re.sub(r"([*|]|_\b)", r"\\\1", part)
        for i, part in enumerate(parts)
    )


#: A function or a class that a page names: kind, module with a dot behind it, name.
NAMED = re.compile(r"\{py:(func|class)\}`~?pinfric\.((?:\w+\.)*)(\w+)`")
_KINDS = {"func": "function", "class": "class"}


class _Generated(SphinxDirective):
    """Markdown that the code gives."""

    def run(self) -> list[nodes.Node]:
        """Return the nodes of it."""
        self.env.note_reread()  # the code may have changed, of which Sphinx knows nothing
        made = nodes.container()
        lines = "\n".join(self.markdown()).splitlines()
        self.state.nested_parse(StringList(lines, self.name), 0, made, match_titles=True)
        return made.children

    def markdown(self) -> list[str]:
        """Return its lines."""
        raise NotImplementedError


def named_lines(pages: Iterable[Path]) -> list[str]:
    """Return directives for the docstrings of all that pages name, module by module."""
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    modules: dict[str, list[str]] = {}
    for kind, module, name in sorted(set(re.findall(NAMED, text)), key=lambda found: found[1:]):
        if module:  # else a public name, which has a page of its own
            modules.setdefault(module, []).append(f".. auto{_KINDS[kind]}:: pinfric.{module}{name}")
    lines = []
    for module, directives in sorted(modules.items()):
        lines += [f"## {module.rstrip('.')}", "", "```{eval-rst}", *directives, "```", ""]
    return lines


class Named(_Generated):
    """`{named} PAGES`: the functions that pages (patterns) name, see `named_lines`."""

    required_arguments, final_argument_whitespace = 1, True

    def markdown(self) -> list[str]:
        """See `_Generated.markdown`."""
        patterns = self.arguments[0].split()
        return named_lines(page for x in patterns for page in Path(self.env.srcdir).glob(x))


def key_lines(it: Any) -> list[str]:
    """Return what a class of a file's section says of its keys, as a section of its docstring."""
    if not (isinstance(it, type) and issubclass(it, Entry)):
        return []
    fields = {name: field for name, field in it.model_fields.items() if field.examples}
    keys = [
        f"    {name}: {field.description}, e.g. `{as_yaml(*field.examples)}`"
        for name, field in fields.items()
    ]
    return ["", "Attributes:", *keys] if keys else []


class _Docstrings:
    """Marks docstrings before napoleon reads their sections; of a property it would make a type."""

    def __init__(self) -> None:
        self.marked: list[str] = []

    def before(self, app: Sphinx, what: str, name: str, it: Any, o: Any, lines: list[str]) -> None:
        self.marked = as_restructured_text([*lines, *key_lines(it)])
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


def setup(sphinx: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx; napoleon has priority 500."""
    docstrings = _Docstrings()
    sphinx.connect("autodoc-process-docstring", docstrings.before, priority=400)
    sphinx.connect("autodoc-process-docstring", docstrings.after, priority=600)
    sphinx.add_directive("named", Named)
    sphinx.connect("doctree-read", _number_equations_by_tags)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
