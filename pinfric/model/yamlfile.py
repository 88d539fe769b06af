"""Read and write YAML 1.2 without objects and duplicate keys, with comments beside entries."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinfric.errors import PinfricError, cut
from pinfric.model.inputs import note_input

if TYPE_CHECKING:
    from ruamel.yaml import YAML

#: The first key of each kind of file, with its version, and what such a file is.
FORMATS = {
    "pinfric": "scene",
    "pinfric_trajectory": "trajectory",
    "pinfric_sweep": "sweep",
    "pinfric_motors": "motors file",
    "pinfric_catalog": "catalogue",
}
#: What gives an empty file its content.
_WRITTEN_BY = {
    "pinfric": "`pinfric new URDF` writes a scene",
    "pinfric_trajectory": "`pinfric new URDF` writes way-points beside its scene",
    "pinfric_sweep": "`pinfric schema sweep` has its keys, `pinfric identify` writes one",
    "pinfric_motors": "`pinfric schema motors` has its keys",
    "pinfric_catalog": "`pinfric catalog` makes a catalogue of a table",
}
#: What is no YAML, by the ends of names.
_OTHERS = {
    "log or a table": (
        *(".csv", ".tsv", ".txt", ".parquet", ".mat", ".npz", ".jsonl", ".ndjson"),
        *(".db3", ".mcap", ".bag"),
    ),
    "page or a picture": (".html", ".pdf", ".png", ".svg"),
    "program": (".cpp", ".hpp", ".py"),
}
#: What a command's `--out` writes for others, beside what it found.
_BESIDE = {
    "size": "sized.scene.yaml and, for --motors, motors.yaml",
    "retime": "trajectory.csv, its motion,",
    "inverse": "efforts.csv, the motion with its efforts,",
    "simulate": "motion.npz, its motion,",
    "identify": "scene.yaml and sweep.yaml",
}
NOT_UTF_8 = "is not a text file in UTF-8; save it in this encoding (not UTF-16 or that of Windows)"
#: Letters of a value that a message repeats: enough to find it in the file.
_SHOWN = 80
#: Bytes of a file that is read as a whole, 64 MiB; a large catalogue has a tenth.
_LARGEST_FILE = 2**26
#: What the parser says where a line does not fit the indentation of those above.
_WRONGLY_INDENTED = ("expected <block end>", "mapping values are not allowed")
#: In a mapping's braces a number with a decimal comma; it may be something else.
_DECIMAL_COMMA = re.compile(r":\s*[-+]?\d+,\d+\s*[,}]")
#: Aliases may repeat what they point to this often; ten levels of ten make 10^10 nodes of a page.
_MOST_REPEATS = 100


def path_of(path: object, error: type[PinfricError]) -> Path:
    """Return the path of a file's name; raise `error` if it is no name."""
    if not isinstance(path, str | os.PathLike):
        raise error(f"the file is a {type(path).__name__}; should be a name or a path")
    return Path(path).expanduser() if str(path).startswith("~") else Path(path)


def read_yaml(
    path: Path,
    error: type[PinfricError],
    kind: str = "",
    check: Callable[[bytes], None] = lambda content: None,
) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping, or raise `error` with the file (and line).

    Args:
        kind: its first key, one of `FORMATS`; a file of another kind is refused as such.
        check: raises if the content is not worth parsing.
    """
    from ruamel.yaml.error import YAMLError

    for what, ends in _OTHERS.items():
        if kind and path.suffix.lower() in ends:
            table = what == "log or a table" and kind in ("pinfric_catalog", "pinfric_motors")
            catalog_hint = f"`pinfric catalog {path}` makes a catalogue of a table"
            said = f"{path}: is a {what}, not a {FORMATS[kind]} (YAML, `{kind}: 1`)"
            raise error(f"{said}; {catalog_hint if table else _order(kind)}")
    try:
        check(content := bounded(path, error))
        content = _load(content.decode("utf-8"))
    except FileNotFoundError:
        raise error(f"there is no file {brief_path(path)}") from None
    except OSError as problem:
        reason = problem.strerror or str(problem)
        raise error(f"{brief_path(path)}: cannot be read: {reason}") from None
    except UnicodeDecodeError:
        raise error(f"{path}: {NOT_UTF_8}") from None
    except RecursionError:
        raise error(f"{path}: is nested too deep to be meant; check its brackets") from None
    except YAMLError as problem:
        mark = getattr(problem, "problem_mark", None)
        line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        text = getattr(problem, "problem", None) or getattr(problem, "reason", None) or problem
        one_line = cut(" ".join(str(text).split()), 3 * _SHOWN)
        one_line = re.sub(r"^found (duplicate key \S+).*", r"\1 in one mapping; keep one", one_line)
        if "'\\t'" in one_line:
            one_line = "a tab; indent with blanks"
        elif mark and one_line.startswith(_WRONGLY_INDENTED):
            one_line = _indentation(content.decode("utf-8").splitlines(), mark.line) or one_line
        raise error(f"{path}{line}: not valid YAML: {one_line}") from None
    if content is None:
        written = f"; {_WRITTEN_BY[kind]}" if kind in _WRITTEN_BY else ""
        raise error(f"{path}: the file is empty{written}")
    if not isinstance(content, dict):
        raise error(f"{path}: should be a mapping of keys, found a {type(content).__name__}")
    refuse_result(path, content, error)
    other = next((key for key in content if key in FORMATS), kind)
    if kind and kind not in content and other != kind:
        raise error(f"{path}: is a {FORMATS[other]}, not a {FORMATS[kind]}; {_order(kind, other)}")
    return content


def _indentation(lines: list[str], at: int) -> str:
    """Return how a line (from 0) is indented beside the keys above; "" if that is not its fault."""
    keys = [
        (i, key.start(1), key.group(1), key.group(2))
        for i, line in enumerate(lines[: at + 1])
        if (key := re.match(r"^ *(?:- )?([^\s#:{}\[\],]+):(?:\s+(.*))?$", line.rstrip()))
    ]
    if len(keys) < 2 or keys[-1][0] != at:
        return ""
    (above, blanks, name, _), (_, own, _, _) = keys[-2:]
    if own == blanks or lines[at].lstrip(" ").startswith("- "):
        return ""
    if len(keys) > 2 and keys[-3][1] == blanks and not keys[-3][3]:
        line, _, parent, _ = keys[-3]
        return (
            f"`{name}` in line {above + 1} is not below `{parent}` of line {line + 1}: indent it "
            f"by {own} blanks, as the line after it"
        )
    less = "less" if own < blanks else "more"
    return (
        f"it is indented by {own} blanks, {less} than `{name}` in line {above + 1} ({blanks}): "
        "keys of one mapping are indented alike"
    )


def _check_decimal_commas(node: Any) -> None:
    """Refuse {radius: 0,02}, which is {radius: 0, 2: null}."""
    from ruamel.yaml.composer import ComposerError
    from ruamel.yaml.nodes import MappingNode, ScalarNode

    if isinstance(node, ScalarNode):
        return
    if not isinstance(node, MappingNode):
        for part in node.value:
            _check_decimal_commas(part)
        return
    before = None
    for key, value in node.value:
        if before is not None and value.value == "" and str(key.value).isdigit():
            problem = (
                f"{before.value},{key.value}: decimals have a point: {before.value}.{key.value}"
            )
            raise ComposerError(None, None, problem, key.start_mark)
        whole = isinstance(value, ScalarNode) and re.fullmatch(r"[-+]?\d+", value.value)
        before = value if whole else None
        _check_decimal_commas(value)


def _order(*kinds: str) -> str:
    """Where files of some kinds are given."""
    if {"pinfric_motors", "pinfric_catalog"}.isdisjoint(kinds):
        return "commands take SCENE TRAJECTORY SWEEP in this order"
    return (
        "--motors takes a motors file (`pinfric size --out` writes motors.yaml), --catalog a "
        "catalogue"
    )


def refuse_result(path: Path, content: Mapping[str, Any], error: type[PinfricError]) -> None:
    """Refuse a result of `--out` or `--json` where a command reads a file.

    Raises:
        PinfricError: `error`, with what to take instead.
    """
    command = str(content.get("command", "")) if "pinfric" in content else ""
    if command := "export" if {"pinfric_constants", "pinfric_actuator"} & {*content} else command:
        beside = _BESIDE.get(command, "")
        raise error(
            f"{path}: is what `pinfric {command}` found, no file for other commands"
            + f"; `pinfric {command} --out` writes {beside} beside it" * bool(beside)
        )


def bounded(path: Path, error: type[PinfricError], most: int = _LARGEST_FILE) -> bytes:
    """Return a file's bytes, at most so many.

    Raises:
        PinfricError: `error`: the file is larger, as a device without end is.
        OSError: it cannot be read.
    """
    note_input(path)
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise error(f"{brief_path(path)}: is larger than {most / 2**20:.0f} MiB")
    return content


def _load(text: str) -> Any:
    yaml = _yaml()
    yaml.Constructor = _constructor()
    node = yaml.compose(text)
    if node is None:
        return None
    if "&" in text:
        _check_aliases(node)
    if _DECIMAL_COMMA.search(text):
        _check_decimal_commas(node)
    return yaml.constructor.construct_document(node)


def _check_aliases(root: Any) -> None:
    """Refuse aliases that expand to far more entries than the file has, or refer to themselves."""
    from ruamel.yaml.composer import ComposerError
    from ruamel.yaml.nodes import MappingNode, ScalarNode

    sizes: dict[int, int] = {}  # of each node, where every alias is written out

    def size_of(node: Any) -> int:
        known = sizes.get(id(node))
        if known == 0:  # still being counted: it lies within itself
            problem = "an alias (*name) stands within what it refers to"
            raise ComposerError(None, None, problem, node.start_mark)
        if known is None:
            sizes[id(node)] = 0
            parts = () if isinstance(node, ScalarNode) else node.value
            if isinstance(node, MappingNode):
                parts = [part for pair in node.value for part in pair]
            known = sizes[id(node)] = 1 + sum(size_of(part) for part in parts)
        return known

    if size_of(root) > _MOST_REPEATS * len(sizes):
        problem = (
            f"its aliases (*name) make {sizes[id(root)]:.2g} entries of {len(sizes)}: nothing that "
            "is meant; write out what they repeat"
        )
        raise ComposerError(None, None, problem, root.start_mark)


@cache
def _constructor() -> type:
    """The library's constructor, with the line of a value that does not fit its type."""
    from ruamel.yaml.constructor import ConstructorError, SafeConstructor

    class Constructor(SafeConstructor):
        def construct_object(self, node: Any, deep: bool = False) -> Any:
            try:
                return super().construct_object(node, deep)
            except (ValueError, TypeError, AttributeError, KeyError):
                problem = f"{brief(node.value)} is no !!{node.tag.rpartition(':')[2]}"
                raise ConstructorError(None, None, problem, node.start_mark) from None

    # a date is text, as in YAML 1.2
    Constructor.add_constructor("tag:yaml.org,2002:timestamp", SafeConstructor.construct_yaml_str)
    return Constructor


def yaml_text(content: Any, comments: Mapping[tuple[str, ...], str] | None = None) -> str:
    """Return content as YAML: flat mappings and sequences on one line, others indented.

    `comments` are keyed by the path of keys (and indices, as text) that they stand beside.
    """
    yaml = _yaml("rt")
    yaml.indent(mapping=2, sequence=4, offset=2)
    return _dumped(yaml, _with_comments(content, (), comments or {}))


def yaml_line(value: Any, within: bool = False) -> str:
    """Return a value as YAML on one line; `within`: as it stands in [...] or {...}."""
    yaml = _yaml()
    yaml.default_flow_style = True
    if within:
        return _dumped(yaml, [value]).removesuffix("\n")[1:-1]
    return _dumped(yaml, value).removesuffix("\n").removesuffix("\n...")


def _yaml(kind: str = "safe") -> YAML:
    from ruamel.yaml import YAML  # where it is used: 0.03 s

    yaml = YAML(typ=kind, pure=True)
    yaml.width = 10**6
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    return yaml


def _dumped(yaml: YAML, content: Any) -> str:
    writer = yaml.representer
    writer.ignore_aliases = lambda _: True
    writer.yaml_representers = {**writer.yaml_representers, float: _number}
    stream = io.StringIO()
    yaml.dump(content, stream)
    return stream.getvalue()


def _number(writer: Any, value: float) -> Any:
    """A float as YAML 1.1 reads it, too: 6e-05 would be text there."""
    node = type(writer).represent_float(writer, value)
    node.value = node.value if "." in node.value else node.value.replace("e", ".0e")
    return node


def _with_comments(value: Any, at: tuple[str, ...], comments: Mapping[tuple[str, ...], str]) -> Any:
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    if isinstance(value, float):
        return float(f"{value:.10g}")
    if not isinstance(value, Mapping | list | tuple):
        return value
    pairs = value.items() if isinstance(value, Mapping) else enumerate(value)
    parts = {key: _with_comments(part, (*at, str(key)), comments) for key, part in pairs}
    commented = CommentedMap(parts) if isinstance(value, Mapping) else CommentedSeq(parts.values())
    flat = not any(isinstance(part, dict | list) for part in parts.values())
    if at and flat and not any(len(key) > len(at) and key[: len(at)] == at for key in comments):
        commented.fa.set_flow_style()
    for key in parts:
        if text := comments.get((*at, str(key))):
            commented.yaml_add_eol_comment(text, key, column=0)
    return commented


def brief(value: object, letters: int = _SHOWN) -> str:
    """Return repr(value), cut in its middle if it is too long for a message."""
    return cut(repr(value), letters)


def brief_path(path: str | Path) -> str:
    """Return a path for a message, whole unless no file system would take it."""
    return cut(str(path), 4096 if max(map(len, Path(path).parts), default=0) < 256 else _SHOWN)
