"""Read YAML safely: no objects, no duplicate keys, and the scalars of YAML 1.2.

PyYAML follows YAML 1.1, where 010 is 8, 1:30 is 90, `on` (a guide's key) is true and 1e-6 is text.
Here a plain scalar is what YAML 1.2's core schema says (yaml.org/spec/1.2.2, section 10.3.2):
010 is 10, true and false are the only truths, and what is no number there (1:30, 1_000) is text.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from pinfric.errors import PinfricError, cut

#: Letters of a value that a message repeats: enough to find it in the file.
_SHOWN = 80
#: Aliases may repeat what they point to this often; ten levels of ten make 10^10 nodes of a page.
_MOST_REPEATS = 100


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with YAML 1.2's scalars; of two equal keys it refuses the second."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - none of YAML 1.1's

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                continue
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {brief(key)} stands twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)

    def construct_whole(self, node: Any) -> int:
        """An integer: decimal, 0o octal or 0x hexadecimal."""
        text = str(self.construct_scalar(node))
        base = {"0o": 8, "0x": 16}.get(text[:2], 10)
        try:
            return int(text[2:] if base != 10 else text, base)
        except ValueError:  # Python refuses thousands of digits; a tag may stand at anything
            raise yaml.constructor.ConstructorError(
                None, None, f"{brief(text)} is no integer that can be meant", node.start_mark
            ) from None


for _tag, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", list("-+.0123456789")),
    ("float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", list("-+.")),
):
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_tag}", re.compile(rf"^(?:{_pattern})$"), _first
    )
_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_whole)


def read_yaml(path: Path, error: type[PinfricError]) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping.

    Raises `error`, naming the file (and the line where YAML itself is malformed).
    """
    try:
        content = _load(path.read_text(encoding="utf-8"))
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise error(f"{brief_path(path)}: cannot be read: {reason}") from None
    except UnicodeDecodeError:
        raise error(f"{path}: is not a text file in UTF-8") from None
    except RecursionError:
        raise error(f"{path}: is nested too deep to be meant; check its brackets") from None
    except (ValueError, KeyError, AttributeError, TypeError) as problem:  # !!float at a word
        raise error(f"{path}: a tag (!!) does not fit its value: {brief(str(problem))}") from None
    except yaml.YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        text = getattr(problem, "problem", None) or getattr(problem, "reason", None) or problem
        one_line = cut(" ".join(str(text).split()), 3 * _SHOWN)
        raise error(f"{path}{line}: not valid YAML: {one_line}") from None
    if not isinstance(content, dict):
        found = "an empty file" if content is None else f"a {type(content).__name__}"
        raise error(f"{path}: should be a mapping of keys, found {found}")
    return content


def _load(text: str) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        sizes: dict[int, int] = {}
        size = _expanded_size(node, sizes)
        if size > _MOST_REPEATS * len(sizes):
            raise yaml.constructor.ConstructorError(
                None,
                None,
                f"its aliases (*name) make {size:.2g} entries of {len(sizes)}: nothing "
                "that is meant; write out what they repeat",
                node.start_mark,
            )
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _expanded_size(node: Any, sizes: dict[int, int]) -> int:
    """Number of nodes where every alias is written out; `sizes` collects that of each node."""
    known = sizes.get(id(node))
    if known == 0:  # still being counted: it lies within itself
        raise yaml.constructor.ConstructorError(
            None, None, "an alias (*name) stands within what it refers to", node.start_mark
        )
    if known is None:
        sizes[id(node)] = 0
        children: list[Any] = []
        if isinstance(node, yaml.MappingNode):
            children = [part for pair in node.value for part in pair]
        elif isinstance(node, yaml.SequenceNode):
            children = node.value
        known = sizes[id(node)] = 1 + sum(_expanded_size(child, sizes) for child in children)
    return known


def brief(value: object, letters: int = _SHOWN) -> str:
    """Return repr(value), cut in its middle where it is too long for a message."""
    return cut(repr(value), letters)


def brief_path(path: str | Path) -> str:
    """Return a path for a message; whole unless no file system would take it."""
    return cut(str(path), 4096 if max(map(len, Path(path).parts), default=0) < 256 else _SHOWN)
