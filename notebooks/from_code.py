"""What pages take from the code: docstrings as they are written here, files' keys, commands.

A Sphinx extension. Docstrings are plain text in Google's sections: backticks are code, what is
indented is an equation, and nothing else is markup (|F| is a norm).
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import typer
import yaml
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from pinfric.cli import app
from pinfric.study.formats import json_schema

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


#: A function or a class that a page names: kind, module with a dot behind it, name.
NAMED = re.compile(r"\{py:(func|class)\}`~?pinfric\.((?:\w+\.)*)(\w+)`")
_KINDS = {"func": "function", "class": "class"}
_NAME = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
}
_SIGNS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}


def as_markdown(text: str) -> str:
    """Return a docstring's text, its equations as blocks of code, nothing else as markup."""
    blocks = []
    for block in re.split(r"\n\n+", text):
        if block.startswith("    "):
            blocks.append(f"```text\n{inspect.cleandoc(block)}\n```")
        else:
            parts = _CODE.split(block)
            blocks.append("".join(part if i % 2 else re.sub(r"([*_|<>\[\]])", r"\\\1", part)
                                  for i, part in enumerate(parts)))  # fmt: skip
    return "\n\n".join(blocks)


class FormatPage:
    """A file's keys as Markdown, written from its JSON schema: a list for each mapping in it."""

    def __init__(self, name: str) -> None:
        self.name, schema = name, json_schema(name)
        self.defs: dict[str, Any] = schema.get("$defs", {})
        self.places: dict[str, str] = {}  # class -> where it was met first
        self.waiting: list[tuple[str, Any]] = []
        self.lines = self._keys("", schema)
        while self.waiting:
            place, found = self.waiting.pop(0)
            self.lines += self._sections(place, found)

    def _sections(self, place: str, schema: Any) -> list[str]:
        kinds = schema.get("anyOf", [])
        if not kinds:
            return self._keys(place, schema)
        return [line for kind in kinds
                for line in self._keys(place, kind, _of_kind(place, kind))]  # fmt: skip

    def _keys(self, place: str, schema: Any, title: str = "") -> list[str]:
        shown = title or place
        heading = f"`{shown}`" if place else "The file"
        lines = [f"({self.name}-{_anchor(shown)})=", f"## {heading}", ""]
        lines += [as_markdown(schema["description"]), ""]
        for key, value in schema["properties"].items():
            kind, unit = self._kind(f"{place}.{key}".lstrip("."), value), value.get("unit", "")
            if unit not in ("", "1"):
                kind += f", {unit}"
            if key in schema.get("required", []):
                kind += ", **required**"
            elif value.get("default") not in (None, {}, [], ""):
                kind += f", by default `{_yaml(value['default'])}`"
            meaning = value.get("description", "").removesuffix(f" ({unit})")
            examples = ", ".join(f"`{_yaml(given)}`" for given in value.get("examples", []))
            lines += [f"`{key}`", f": {as_markdown(meaning)}", "", f"  {kind}; e.g. {examples}", ""]
        return lines

    def _link(self, text: str, place: str) -> str:
        return f"[{text}](#{self.name}-{_anchor(place)})"

    def _kind(self, place: str, value: Any) -> str:
        """What may stand at a place, in words; mappings that are met first get a list."""
        if "$ref" in value:
            name = value["$ref"].rpartition("/")[2]
            if name not in self.places:
                if place in self.places.values():  # of several mappings, by what they must have
                    place += f": {{{', '.join(self.defs[name]['required'])}}}"
                self.places[name] = place
                self.waiting.append((place, self.defs[name]))
            place = self.places[name]
            if kinds := self.defs[name].get("anyOf"):
                return " or ".join(self._link(_kind_of(kind), _of_kind(place, kind))
                                   for kind in kinds)  # fmt: skip
            return self._link(place, place)
        if "anyOf" in value:
            kinds = [kind for kind in value["anyOf"] if kind.get("type") != "null"]
            return " or ".join(dict.fromkeys(self._kind(place, kind) for kind in kinds))
        if "const" in value:
            return f"`{value['const']}`"
        if "enum" in value:
            return " or ".join(f"`{_yaml(word)}`" for word in value["enum"])
        if value.get("type") == "array":
            if "prefixItems" in value:
                kinds = dict.fromkeys(self._kind(place, x) for x in value["prefixItems"])
                return f"[{len(value['prefixItems'])} x {', '.join(kinds)}]"
            return f"list of {self._kind(f'{place}[]', value['items'])}"
        if value.get("type") == "object":
            return f"by name: {self._kind(f'{place}.NAME', value['additionalProperties'])}"
        bounds = [f"{sign} {value[bound]:g}" for bound, sign in _SIGNS.items() if bound in value]
        return " ".join([_NAME.get(value.get("type", ""), "anything"), ", ".join(bounds)]).strip()


def _kind_of(schema: Any) -> str:
    return str(schema["properties"]["kind"]["const"])


def _of_kind(place: str, schema: Any) -> str:
    return f"{place.rpartition('.')[2]}: {{kind: {_kind_of(schema)}, ...}}"


def _yaml(value: Any) -> str:
    """A value as one line of YAML."""
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10**6)
    return text.removesuffix("\n").removesuffix("\n...").replace("|", "\\|")


def _anchor(place: str) -> str:
    return re.sub(r"\W+", "-", place).strip("-").lower()


def command_lines() -> list[str]:
    """Return what `--help` of each command says, as Markdown."""
    lines = []
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        context = command.make_context(
            f"pinfric {name}", [], resilient_parsing=True, terminal_width=78, max_content_width=78
        )
        lines += [f"## pinfric {name}", "", "```text", command.get_help(context), "```", ""]
    return lines


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


class Format(_Generated):
    """`{format} NAME`: the keys of a file, see `FormatPage`."""

    required_arguments = 1

    def markdown(self) -> list[str]:
        """See `_Generated.markdown`."""
        return FormatPage(self.arguments[0]).lines


class Named(_Generated):
    """`{named} PAGES`: the functions that pages (patterns) name, see `named_lines`."""

    required_arguments, final_argument_whitespace = 1, True

    def markdown(self) -> list[str]:
        """See `_Generated.markdown`."""
        patterns = self.arguments[0].split()
        return named_lines(page for x in patterns for page in Path(self.env.srcdir).glob(x))


class Commands(_Generated):
    """`{commands}`: what every command takes."""

    def markdown(self) -> list[str]:
        """See `_Generated.markdown`."""
        return command_lines()


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


def setup(sphinx: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx; napoleon has priority 500."""
    docstrings = _Docstrings()
    sphinx.connect("autodoc-process-docstring", docstrings.before, priority=400)
    sphinx.connect("autodoc-process-docstring", docstrings.after, priority=600)
    sphinx.add_directive("format", Format)
    sphinx.add_directive("commands", Commands)
    sphinx.add_directive("named", Named)
    sphinx.connect("doctree-read", _number_equations_by_tags)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
