"""Write results so that a reader finds the old file or the new one, never half of one."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pinfric.errors import PinfricError
from pinfric.model.yamlfile import brief_path

#: Writes a whole file to the path it is given.
Writer = Callable[[Path], object]
_UNFINISHED, _ALIVE = ".unfinished-", ".alive"
#: What is named so is a file: who gives it as a folder expects one, too.
_FILES = frozenset((".csv", ".html", ".json", ".png", ".urdf", ".xml", ".yaml", ".yml"))


def write_file(path: str | Path, write: Writer) -> Path:
    """Let `write` fill a temporary file beside `path`, then put it in place at once.

    Raises:
        PinfricError: the file cannot be written.
    """
    path = Path(path)
    if path.exists() and not path.is_file() and not path.is_dir():  # a pipe or a device stays one
        try:
            write(path)
        except OSError as problem:
            raise PinfricError(f"{path}: cannot be written: {problem.strerror}") from None
        return path
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
        with _unfinished(folder) as unfinished:
            for name, write in writers.items():
                write(unfinished / name)
            _put_in_place(unfinished, folder, list(writers))
    except OSError as problem:
        raise PinfricError(f"{folder}: cannot be written: {problem.strerror or problem}") from None
    finally:
        for new in made:
            if new.is_dir() and not any(new.iterdir()):
                new.rmdir()
    return [folder / name for name in writers]


@contextmanager
def _unfinished(folder: Path) -> Iterator[Path]:
    """A folder in `folder` to write in; those of killed runs are removed, those of others stay.

    Each run holds the lock of a file in its own, which the kernel gives back however the run ends.
    The lock on `folder` keeps others from taking ours for a dead one before it is locked.
    """
    with ExitStack() as stack:
        with _locked(folder, os.O_RDONLY, wait=True) as guarded:
            for left in folder.glob(f"{_UNFINISHED}*") if guarded else ():
                with _locked(left / _ALIVE) as dead:
                    if dead:
                        shutil.rmtree(left, ignore_errors=True)
            made = stack.enter_context(
                tempfile.TemporaryDirectory(
                    dir=folder, prefix=_UNFINISHED, ignore_cleanup_errors=True
                )
            )
            stack.enter_context(_locked(Path(made) / _ALIVE))
        yield Path(made)


@contextmanager
def _locked(path: Path, flags: int = os.O_RDWR | os.O_CREAT, wait: bool = False) -> Iterator[bool]:
    """Hold a lock; yields False where another holds it, or none can be had (some networks)."""
    try:
        descriptor = os.open(path, flags | os.O_CLOEXEC, 0o644)
    except OSError:
        yield False
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        held = True
    except OSError:
        held = False
    try:
        yield held
    finally:
        os.close(descriptor)


@contextmanager
def only_one(path: Path) -> Iterator[bool]:
    """Hold a lock file while something is done that only one process may do at a time.

    The kernel gives the lock back however this process ends; the file is removed at the end.
    Yields False where another process holds it. A file system without locks lets all go on.

    Raises:
        OSError: the file cannot be made.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            yield False
            return
        except OSError:
            break
        with suppress(OSError):
            if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                break
        os.close(descriptor)  # its holder has removed it since we opened it
    try:
        yield True
    finally:
        path.unlink(missing_ok=True)
        os.close(descriptor)


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
        PinfricError: `folder` is a file or named like one, or it (where it is not there: its
            parent) is read-only, or a folder stands where a file should go.
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
    if folder.suffix.lower() in _FILES and not folder.is_dir():
        raise PinfricError(f"{folder}: is named like a file; name a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PinfricError(f"{folder}: cannot be written: no permission to write in {there}")
    taken = [name for name in names if (folder / name).is_dir()]
    if taken:
        raise PinfricError(
            f"{folder}: cannot be written: {', '.join(taken)} is a folder in there, and a file of "
            "that name is to be written; move it, or name another folder"
        )
