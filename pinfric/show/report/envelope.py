"""The frame of every `--json` result, and the schema of all of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pinfric import __version__
from pinfric.checking.findings import Finding
from pinfric.model.described import Schema, closed, in_json
from pinfric.model.files import file_hash
from pinfric.model.scene import Scene


def envelope(
    command: str,
    result: Any,
    scene: Scene | None = None,
    inputs: Iterable[str | Path] = (),
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the JSON of one run of a command; SI units, None for NaN and infinity.

    Args:
        scene: what it is about; None: no scene.
        inputs: names of files that were read; what is no file is left out.
        warnings: of this run.
    """
    return {
        "pinfric": __version__,
        "command": command,
        "scene": None if scene is None else scene.source,
        "findings": [] if scene is None else in_json(scene.quick_findings),
        "inputs": hashes(inputs),
        "result": in_json(result),
        "warnings": list(warnings),
    }


def hashes(inputs: Iterable[str | Path]) -> dict[str, str]:
    """Return the SHA-256 of each input that is a file, or a folder of data files, once."""
    files: dict[Path, str] = {}
    for name in map(str, inputs):
        if name and (Path(name).is_file() or Path(name).is_dir()):  # a pipe is read once
            files.setdefault(Path(name).resolve(), name)
    return {name: file_hash(name) for name in files.values()}


def result_schema(results: Mapping[str, Sequence[type]]) -> dict[str, Any]:
    """Return the JSON schema of all envelopes.

    Args:
        results: command -> the described classes of its results.
    """
    schema, kinds = Schema(), []
    text, name = {"type": "string"}, {"type": ["string", "null"]}
    for command, classes in results.items():
        kinds += [
            closed(
                {
                    "pinfric": {**text, "description": "version"},
                    "command": {"const": command},
                    "scene": {**name, "description": "its file"},
                    "findings": {
                        "type": "array",
                        "items": schema.of_class(Finding),
                        "description": "errors of scene and robot, and what else asks for no mesh",
                    },
                    "inputs": {
                        "type": "object",
                        "additionalProperties": text,
                        "description": "file that was read -> its SHA-256",
                    },
                    "result": schema.of_class(described),
                    "warnings": {"type": "array", "items": text},
                }
            )
            for described in classes
        ]
    return schema.whole({"oneOf": kinds})
