"""The keys of what `--json` prints as Markdown, from the fields of results."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from file_keys import as_markdown

from pinfric.cli import result_classes
from pinfric.model.described import Schema


def result_lines(results: Mapping[str, Sequence[type]] | None = None) -> list[str]:
    """Return what each command's `--json` holds as its result, as Markdown: a table for each class.

    Args:
        results: command -> classes; None: of all commands.
    """
    lines, known = [], set()
    for command, classes in (results or result_classes()).items():
        lines += [f"## pinfric {command}", ""]
        schema = Schema()
        for kind in classes:
            schema.of_class(kind)
        for name, content in reversed(schema.defs.items()):
            if name in known:
                continue
            known.add(name)
            lines += [f"### {name}", "", content["description"], "", "| key | unit | what |"]
            lines += ["|---|---|---|"]
            for key, found in content["properties"].items():
                inside = ", ".join(f"[{x}](#{x.lower()})" for x in _references(found))
                what = as_markdown(found["description"]) + (f": {inside}" if inside else "")
                lines.append(f"| `{key}` | {found.get('unit', '')} | {what} |")
            lines.append("")
    return lines


def _references(schema: Any) -> list[str]:
    """Classes that a schema refers to."""
    return re.findall(r"#/\$defs/(\w+)", str(schema))
