"""The keys of files as Markdown, from their JSON schemas: what the reference shows of them."""

from __future__ import annotations

import inspect
import re
from typing import Any

from pinfric.drives.catalog import RatedEntry
from pinfric.drives.sourced import Sourced
from pinfric.formats import json_schema
from pinfric.model.yamlfile import yaml_line

#: Heading -> class whose keys several others inherit: they are listed once.
_INHERITED = {"Keys of every entry": Sourced, "Keys of motors and gearmotors": RatedEntry}

CODE = re.compile(r"(`[^`\n]+`)")
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
            parts = CODE.split(block)
            plain = (
                part if i % 2 else re.sub(r"([*_|<>\[\]])", r"\\\1", part)
                for i, part in enumerate(parts)
            )
            blocks.append("".join(plain))
    return "\n\n".join(blocks)


class FormatPage:
    """A file's keys as Markdown, written from its JSON schema: a list for each mapping in it.

    Args:
        name: of the format. places: class -> page and place where it was met first; pages that are
            written later link to them.
    """

    def __init__(self, name: str, places: dict[str, tuple[str, str]]) -> None:
        schema = json_schema(name)
        self.defs: dict[str, Any] = schema.get("$defs", {})
        self.name, self.places = name, places
        self.waiting: list[tuple[str, Any]] = []
        self.lines = self._keys("", schema)
        while self.waiting:
            place, found = self.waiting.pop(0)
            self.lines += self._sections(place, found)

    def _sections(self, place: str, schema: Any) -> list[str]:
        if "discriminator" not in schema:
            return self._keys(place, schema)
        return [
            line
            for kind, cls in self._kinds(schema).items()
            for line in self._keys(place, cls, _of_kind(place, kind))
        ]

    def _kinds(self, schema: Any) -> dict[str, Any]:
        """The members of a union, by their `kind`."""
        named = schema["discriminator"]["mapping"].items()
        return {kind: self.defs[ref.rpartition("/")[2]] for kind, ref in named}

    def _keys(self, place: str, schema: Any, title: str = "") -> list[str]:
        shown, keys = title or place, dict(schema["properties"])
        heading = place if place in _INHERITED else f"`{shown}`" if place else "The file"
        lines = [f"## {heading}", "", as_markdown(schema["description"]), ""]
        if place not in _INHERITED and (lists := self._inherited(schema, keys)):
            lines += [f"Also the {' and the '.join(lists)}.", ""]
        lines += ["| key | what | value |", "|---|---|---|"]
        for key, value in keys.items():
            kind, unit = self._kind(f"{place}.{key}".lstrip("."), value), value.get("unit", "")
            if unit not in ("", "1"):
                kind += f", {unit}"
            if key in schema.get("required", []):
                kind += ", **required**"
            elif value.get("default") not in (None, {}, [], ""):
                kind += f", by default `{as_yaml(value['default'])}`"
            meaning = value.get("description", "").removesuffix(f" ({unit})")
            examples = ", ".join(f"`{as_yaml(given)}`" for given in value.get("examples", []))
            lines.append(f"| `{key}` | {as_markdown(meaning)} | {kind}; e.g. {examples} |")
        return [*lines, ""]

    def _inherited(self, schema: Any, keys: dict[str, Any]) -> list[str]:
        """Take inherited keys out of a list; return links to the lists of those."""
        links = []
        for heading, cls in _INHERITED.items():
            if set(cls.__annotations__) <= keys.keys():
                own = {key: keys.pop(key) for key in cls.__annotations__}
                if heading not in self.places:
                    self.places[heading] = self.name, heading
                    content = {"description": inspect.getdoc(cls), "properties": own}
                    self.waiting.append((heading, content | {"required": schema["required"]}))
                links.append(self._link(heading.lower(), heading, self.places[heading][0]))
        return links

    def _kind(self, place: str, value: Any) -> str:
        """What may stand at a place, in words; mappings that are met first get a list."""
        if value is True:
            return "anything"
        if "$ref" in value:
            name = value["$ref"].rpartition("/")[2]
            if name not in self.places:
                if (
                    self.name,
                    place,
                ) in self.places.values():  # of several mappings, by what they must have
                    place += f": {{{', '.join(self.defs[name]['required'])}}}"
                self.places[name] = self.name, place
                self.waiting.append((place, self.defs[name]))
            page, place = self.places[name]
            if "discriminator" in self.defs[name]:
                kinds = self._kinds(self.defs[name])
                return " or ".join(self._link(kind, _of_kind(place, kind), page) for kind in kinds)
            return self._link(place, place, page)
        if "discriminator" in value:  # a union that has no name of its own
            if (own := f"{self.name} {place}") not in self.places:
                self.places[own] = self.name, place
                self.waiting.append((place, value))
            return " or ".join(
                self._link(kind, _of_kind(place, kind)) for kind in self._kinds(value)
            )
        if forms := value.get("anyOf", value.get("oneOf")):
            kinds = [form for form in forms if form.get("type") != "null"]
            return " or ".join(dict.fromkeys(self._kind(place, kind) for kind in kinds))
        if "const" in value:
            return f"`{value['const']}`"
        if "enum" in value:
            return " or ".join(f"`{as_yaml(word)}`" for word in value["enum"])
        if value.get("type") == "array":
            if "prefixItems" in value:
                kinds = dict.fromkeys(self._kind(place, x) for x in value["prefixItems"])
                return f"[{len(value['prefixItems'])} x {', '.join(kinds)}]"
            return f"list of {self._kind(f'{place}[]', value['items'])}"
        if value.get("type") == "object":
            return f"by name: {self._kind(f'{place}.NAME', value['additionalProperties'])}"
        bounds = [f"{sign} {value[bound]:g}" for bound, sign in _SIGNS.items() if bound in value]
        return " ".join([_NAME.get(value.get("type", ""), "anything"), ", ".join(bounds)]).strip()

    def _link(self, text: str, place: str, page: str = "") -> str:
        """A link to a place's heading, by the anchor that GitHub and MyST make of it."""
        anchor = re.sub(r"[^\w -]", "", place.lower()).replace(" ", "-")
        file = f"{page}.md" if page not in ("", self.name) else ""
        return f"[{text}]({file}#{anchor})"


def _of_kind(place: str, kind: str) -> str:
    return f"{place.rpartition('.')[2]}: {{kind: {kind}, ...}}"


def as_yaml(value: Any) -> str:
    """Return a value as one line of YAML in a table's cell."""
    return yaml_line(value).replace("|", "\\|")
