"""Write results so that a reader finds the old file or the new one, never half of one."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from pinfric.errors import PinfricError

#: Writes a whole file to the path it is given.
Writer = Callable[[Path], object]


def write_file(path: str | Path, write: Writer) -> Path:
    """Let `write` fill a temporary file beside `path`, then put it in place at once.

    Raises:
        PinfricError: the file cannot be written.
    """
    path = Path(path)
    return write_folder(path.parent, {path.name: write})[0]


def write_folder(folder: str | Path, writers: Mapping[str, Writer]) -> list[Path]:
    """Write several files, by name; they appear in `folder` once all of them are complete.

    The folder is made where there is none; other files in it stay.

    Raises:
        PinfricError: the folder or a file in it cannot be written.
    """
    folder = Path(folder)
    check_writable(folder)
    made = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as unfinished:
            for name, write in writers.items():
                write(Path(unfinished) / name)
            for name in writers:
                os.replace(Path(unfinished) / name, folder / name)
    except OSError as problem:
        raise PinfricError(f"{folder}: cannot be written: {problem.strerror or problem}") from None
    finally:
        for new in made:
            if new.is_dir() and not any(new.iterdir()):
                new.rmdir()
    return [folder / name for name in writers]


def check_writable(folder: str | Path) -> None:
    """Say before a long computation that its results could not be written.

    Raises:
        PinfricError: `folder` is a file, or it (where it is not there: its parent) is read-only.
    """
    folder = Path(folder)
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    if not there.is_dir():
        raise PinfricError(f"{folder}: cannot be written: {there} is a file; name a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PinfricError(f"{folder}: cannot be written: no permission to write in {there}")
