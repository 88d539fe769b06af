"""Read YAML safely: no objects, no duplicate keys, and 1e-6 is a number."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from pinfric.errors import PinfricError


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader without two traps: it keeps the last of two equal keys, and it reads
    1e-6 (a number in YAML 1.2) as text."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                continue
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key!r} stands twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:\d[\d_]*)(?:\.\d*)?[eE][-+]?\d+$|^[-+]?\.\d+(?:[eE][-+]?\d+)?$"),
    list("-+0123456789."),
)


def read_yaml(path: Path, error: type[PinfricError]) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping.

    Raises `error`, naming the file (and the line where YAML itself is malformed).
    """
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _Loader)  # a SafeLoader
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise error(f"{path}: cannot be read: {reason}") from None
    except UnicodeDecodeError:
        raise error(f"{path}: is not a text file in UTF-8") from None
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        text = getattr(problem, "problem", None) or getattr(problem, "reason", None) or problem
        one_line = " ".join(str(text).split())
        raise error(f"{path}{line}: not valid YAML: {one_line}") from None
    if not isinstance(content, dict):
        found = "an empty file" if content is None else f"a {type(content).__name__}"
        raise error(f"{path}: should be a mapping of keys, found {found}")
    return content
