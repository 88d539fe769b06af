"""The files that a command reads: none of its results may replace them (`files.check_writable`)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Command:
    """What the running command has read, and whether it may replace what pinfric did not write."""

    inputs: dict[Path, None] = field(default_factory=dict)
    overwrite: bool = False


#: None: no command runs. Functions write where they are told, as those of NumPy and pandas do.
_running: Command | None = None


def running() -> Command | None:
    """Return the command that runs in this process; None where a script calls functions."""
    return _running


@contextmanager
def running_command() -> Iterator[None]:
    """A context within which a command runs."""
    global _running
    before, _running = _running, Command()
    try:
        yield
    finally:
        _running = before


def note_input(*paths: str | Path) -> None:
    """Note files that the running command reads; names without a file do not matter."""
    if _running is not None:
        _running.inputs.update(dict.fromkeys(map(Path, paths)))
