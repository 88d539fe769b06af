"""Write results so that a reader finds the old file or the new one, never an incomplete one.

A command replaces neither its inputs nor, without --overwrite, files of others. It knows its
results by hashes kept beside them: a mark in a CSV would disturb readers, and would not show a
change.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pinfric.errors import PinfricError, PinfricWarning
from pinfric.model.inputs import running
from pinfric.model.yamlfile import brief, brief_path

#: Writes a whole file to the path it is given; or the file's text.
Writer = str | Callable[[Path], object]
_UNFINISHED, _ALIVE = ".unfinished-", ".alive"
#: Files that are open while a folder is removed: kept free, as a process may open few.
_SPARE = 4
#: Name -> SHA-256 of what commands wrote into a folder, and of what they wrote before: a process
#: that is killed between two files leaves either.
RECORD = ".pinfric-results.json"
#: Endings of file names; a folder of such a name is probably a mistake.
_FILES = frozenset((".csv", ".html", ".json", ".png", ".urdf", ".xml", ".yaml", ".yml"))


def file_hash(file: str | Path) -> str:
    """Return the SHA-256 of a file, or of the data files of a folder, in hexadecimal."""
    if Path(file).is_dir():
        lines = [f"{file_hash(path)} {path.name}" for path in sorted(Path(file).glob("*.[cy]*"))]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()
    with Path(file).open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def write_file(path: str | Path, write: Writer) -> Path:
    """Write a temporary file beside `path`, then rename it to `path`.

    Raises:
        PinfricError: the file cannot be written.
    """
    path = Path(path)
    if path.exists() and not path.is_file() and not path.is_dir():  # a pipe or a device stays one
        try:
            _fill(path, write)
        except OSError as problem:
            raise PinfricError(f"{path}: cannot be written: {problem.strerror}") from None
        return path
    return write_folder(path.parent, {path.name: write})[0]


def write_folder(
    folder: str | Path, writers: Mapping[str, Writer], outdated: Iterable[str] = ()
) -> list[Path]:
    """Write several files (name -> text or writer), which appear in `folder` when all are complete.

    A missing folder is created. If one of the files cannot be moved to its place, the old files are
    restored. `outdated` files, which would contradict these, are removed, but no input of the
    command nor what somebody else wrote or changed.

    Raises:
        PinfricError: the folder or a file in it cannot be written.
    """
    folder = Path(folder)
    check_writable(folder, writers)
    new_folders = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _unfinished(folder) as unfinished:
            for name, write in writers.items():
                _fill(unfinished / name, write)
            with _locked(folder, os.O_RDONLY, wait=True):  # the record is one for all runs
                recorded = _write_record(unfinished, folder, writers)
                _put_in_place(unfinished, folder, [*recorded, *writers])
                _remove_outdated(folder, outdated)
    except OSError as problem:
        raise PinfricError(f"{folder}: cannot be written: {problem.strerror or problem}") from None
    except UnicodeEncodeError as problem:
        around = brief(problem.object[max(0, problem.start - 40) : problem.end])
        raise PinfricError(
            f"{folder}: cannot be written: a file's name in it is not in UTF-8 ({around}); rename "
            "that file or its folder"
        ) from None
    finally:
        for new in new_folders:
            if new.is_dir() and not any(new.iterdir()):
                new.rmdir()
    return [folder / name for name in writers]


def _fill(path: Path, write: Writer) -> None:
    if isinstance(write, str):
        path.write_text(write, encoding="utf-8")
    else:
        write(path)


@contextmanager
def _unfinished(folder: Path) -> Iterator[Path]:
    """A temporary folder in `folder`; those of killed runs are removed, those in use stay.

    Each run locks a file in its folder; the kernel releases the lock however the run ends. The lock
    on `folder` keeps other runs from removing ours before its file is locked.
    """
    with ExitStack() as spare, ExitStack() as stack:
        for _ in range(_SPARE):
            spare.enter_context(Path(os.devnull).open())
        with _locked(folder, os.O_RDONLY, wait=True) as guarded:
            for leftover in folder.glob(f"{_UNFINISHED}*") if guarded else ():
                with _locked(leftover / _ALIVE) as dead:
                    if dead:
                        shutil.rmtree(leftover, ignore_errors=True)
            temporary = stack.enter_context(
                tempfile.TemporaryDirectory(
                    dir=folder, prefix=_UNFINISHED, ignore_cleanup_errors=True
                )
            )
            stack.callback(spare.close)  # before the folder is removed
            stack.enter_context(_locked(Path(temporary) / _ALIVE))
        yield Path(temporary)


@contextmanager
def _locked(path: Path, flags: int = os.O_RDWR | os.O_CREAT, wait: bool = False) -> Iterator[bool]:
    """Hold a lock; yields False if another holds it, or if locks do not work (some networks)."""
    try:
        descriptor = os.open(path, flags | os.O_CLOEXEC, 0o644)
    except OSError:
        yield False
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        held = True
    except OSError as problem:
        held = False
        if wait and problem.errno in (errno.EAGAIN, errno.EACCES):
            text = f"{path}: waiting for {_holder(descriptor)}, which holds the folder locked"
            warnings.warn(text, PinfricWarning, stacklevel=2)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            held = True
    try:
        yield held
    finally:
        os.close(descriptor)


def _holder(descriptor: int) -> str:
    """The process that holds a lock on a file, as far as the kernel tells."""
    with suppress(OSError, ValueError):
        file = os.fstat(descriptor)
        for line in Path("/proc/locks").read_text().splitlines():
            _, kind, _, _, process, place, *_ = line.split()
            if kind == "FLOCK" and int(place.rpartition(":")[2]) == file.st_ino:
                return f"process {process}"
    return "another process"


def _put_in_place(unfinished: Path, folder: Path, names: Sequence[str]) -> None:
    """Move the files into `folder`: all of them, or none if one cannot be moved."""
    earlier = unfinished / ".earlier"
    earlier.mkdir()
    placed: list[str] = []
    try:
        for name in names:
            if os.path.lexists(folder / name):
                path = folder / name
                copy = earlier / name
                try:
                    os.link(path, copy, follow_symlinks=False)
                except OSError:  # a file system without links
                    shutil.copy2(path, copy, follow_symlinks=False)
            os.replace(unfinished / name, folder / name)
            placed.append(name)
    except OSError:
        for name in reversed(placed):
            if os.path.lexists(earlier / name):
                os.replace(earlier / name, folder / name)
            else:
                (folder / name).unlink()
        raise


def check_writable(folder: str | Path, names: Iterable[str] = ()) -> None:
    """Raise before a long computation if its results could not be written.

    Raises:
        PinfricError: `folder` is a file or named like one; it, or its parent if it is missing, is
            read-only; a folder has the name of one of the files. In a command also: a file there is
            one of its inputs, or is not as pinfric wrote it and --overwrite is not given.
    """
    folder, names = Path(folder), list(names)
    try:
        there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    except OSError as problem:  # a name that no file system accepts
        raise PinfricError(
            f"{brief_path(folder)}: cannot be written: {problem.strerror}; name a folder"
        ) from None
    if not there.is_dir():
        raise PinfricError(f"{folder}: cannot be written: {there} is a file; name a folder")
    if folder.suffix.lower() in _FILES and not folder.is_dir():
        raise PinfricError(f"{folder}: is named like a file; name a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PinfricError(f"{folder}: cannot be written: no permission to write in {there}")
    if "" in names:  # of "." or "/"
        raise PinfricError(f"{folder.absolute()}: is a folder; name the file to write (--out)")
    for file in (folder / name for name in names):
        if file.is_symlink() and not file.exists():
            raise PinfricError(
                f"{file}: is a link to {os.readlink(file)}, where nothing is; remove it, or name "
                "another place"
            )
    taken = [name for name in names if (folder / name).is_dir()]
    if taken:
        raise PinfricError(
            f"{folder}: cannot be written: it contains a folder {', '.join(taken)}, where a file "
            "of that name must be written; move it, or name another folder"
        )
    if (command := running()) is None:
        return
    for name in names:
        file = folder / name
        if (source := _same_file(file, command.inputs)) is not None:
            same = "" if source.absolute() == file.absolute() else f" (it is {source})"
            raise PinfricError(
                f"{file}: is an input of this command{same}, which its result would replace; name "
                "another place"
            )
    if command.overwrite:
        return
    known = _recorded(folder)
    for name in names:
        file = folder / name
        if file.is_file() and not _as_written(file, known):
            why = "was changed since pinfric wrote it" if name in known else "is there already"
            raise PinfricError(f"{file}: {why}; name another place, or replace it: --overwrite")


def _same_file(file: Path, inputs: Iterable[Path]) -> Path | None:
    """The input that a regular file is, also through links and hard links."""
    for source in inputs if file.is_file() else ():
        with suppress(OSError, ValueError):  # not there, or a name that no file system takes
            if os.path.samefile(source, file):
                return source
    return None


def _as_written(file: Path, known: Mapping[str, str]) -> bool:
    """Whether a file is as a command wrote it."""
    return file.name in known and file_hash(file) in known[file.name].split()


def _remove_outdated(folder: Path, names: Iterable[str]) -> None:
    """Remove what earlier commands wrote, and nothing else, also with --overwrite."""
    known, command = _recorded(folder), running()
    for file in (folder / name for name in names):
        ours = file.is_file() and _as_written(file, known)
        if ours and command is not None and _same_file(file, command.inputs) is None:
            file.unlink()


def _recorded(folder: Path) -> dict[str, str]:
    """What earlier commands wrote into a folder: name -> SHA-256, and that before."""
    try:
        content = json.loads((folder / RECORD).read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    there = content.items() if isinstance(content, dict) else ()
    return {name: hashes for name, hashes in there if isinstance(hashes, str)}


def _write_record(unfinished: Path, folder: Path, names: Iterable[str]) -> list[str]:
    """Write the folder's record with what the running command adds, and return its name."""
    if running() is None:
        return []
    known = {name: hash_ for name, hash_ in _recorded(folder).items() if (folder / name).is_file()}
    for name in names:
        ours = (folder / name).is_file() and _as_written(folder / name, known)
        before = f" {file_hash(folder / name)}" if ours else ""
        known[name] = file_hash(unfinished / name) + before
    (unfinished / RECORD).write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
    return [RECORD]
