"""Write results so that a reader finds the old file or the new one, never half of one."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from pinfric.errors import PinfricError
from pinfric.model.yamlfile import brief_path

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

    The folder is made where there is none; other files in it stay. Where one cannot be put in its
    place, those put before it make way for what was there.

    Raises:
        PinfricError: the folder or a file in it cannot be written.
    """
    folder = Path(folder)
    check_writable(folder, writers)
    made = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as unfinished:
            for name, write in writers.items():
                write(Path(unfinished) / name)
            _put_in_place(Path(unfinished), folder, list(writers))
    except OSError as problem:
        raise PinfricError(f"{folder}: cannot be written: {problem.strerror or problem}") from None
    finally:
        for new in made:
            if new.is_dir() and not any(new.iterdir()):
                new.rmdir()
    return [folder / name for name in writers]


def _put_in_place(unfinished: Path, folder: Path, names: Sequence[str]) -> None:
    """Move the files into `folder`: all of them, or none where one cannot be moved."""
    earlier = unfinished / ".earlier"
    earlier.mkdir()
    placed: list[str] = []
    try:
        for name in names:
            if os.path.lexists(folder / name):
                _keep(folder / name, earlier / name)
            os.replace(unfinished / name, folder / name)
            placed.append(name)
    except OSError:
        for name in reversed(placed):
            if os.path.lexists(earlier / name):
                os.replace(earlier / name, folder / name)
            else:
                (folder / name).unlink()
        raise


def _keep(path: Path, copy: Path) -> None:
    try:
        os.link(path, copy, follow_symlinks=False)
    except OSError:  # a file system without links
        shutil.copy2(path, copy, follow_symlinks=False)


def check_writable(folder: str | Path, names: Iterable[str] = ()) -> None:
    """Say before a long computation that its results could not be written.

    Args:
        folder: where they go.
        names: the files that will be written there.

    Raises:
        PinfricError: `folder` is a file, or it (where it is not there: its parent) is read-only,
            or a folder stands where a file should go.
    """
    folder = Path(folder)
    try:
        there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    except OSError as problem:  # a name no file system takes
        raise PinfricError(
            f"{brief_path(folder)}: cannot be written: {problem.strerror}; name a folder"
        ) from None
    if not there.is_dir():
        raise PinfricError(f"{folder}: cannot be written: {there} is a file; name a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PinfricError(f"{folder}: cannot be written: no permission to write in {there}")
    taken = [name for name in names if (folder / name).is_dir()]
    if taken:
        raise PinfricError(
            f"{folder}: cannot be written: {', '.join(taken)} is a folder in there, and a file of "
            "that name is to be written; move it, or name another folder"
        )
