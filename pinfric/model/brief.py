"""Short texts about an object, for `print`: one screen, no arrays."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Iterable, Mapping, Sequence
from math import floor, log10
from pathlib import Path

#: Letters a line, and lines a fact may take.
_WIDTH, _LINES = 100, 2
#: Letters of a name from a file.
_NAME = 60


def screen(kind: str, title: str, facts: Mapping[str, str]) -> str:
    """Return a title and a line or two for each fact that is not empty, in 100 columns."""
    shown = {name: text for name, text in facts.items() if text}
    width = max(map(len, shown), default=0)
    lines = textwrap.wrap(f"{kind} {title}", _WIDTH, max_lines=_LINES, placeholder=" …")
    for name, text in shown.items():
        lines += textwrap.wrap(
            text,
            _WIDTH,
            max_lines=_LINES,
            placeholder=" …",
            initial_indent=f"  {name:<{width}}  ",
            subsequent_indent=" " * (width + 4),
        )
    return "\n".join(lines)


def file_name(source: str) -> str:
    """Return a file's name without its folder, cut where it is very long."""
    name = Path(source).name or source
    return name if len(name) <= _NAME else f"{name[: _NAME - 1]}…"


def listed(names: Sequence[str], values: Iterable[str] = (), room: int = 150) -> str:
    """Return "7: a, b, …, g", or "2: a 1.5, b 2" with `values`; a long list keeps its last name."""
    values = list(values)
    items = [f"{n} {v}" for n, v in zip(names, values, strict=True)] if values else list(names)
    items = [item if len(item) <= 70 else f"{item[:69]}…" for item in items]
    if not items:
        return ""
    kept = list(items)
    while len(kept) > 1 and len(", ".join([*kept, "…, ", items[-1]])) > room:
        kept.pop()
    if len(kept) < len(items):
        kept = [*kept, "…", items[-1]]
    return f"{len(items)}: {', '.join(kept)}"


def counted(count: int, noun: str, several: str = "") -> str:
    """Return "1 joint" or "2 joints"; `several` is an irregular plural."""
    return f"{count} {noun if count == 1 else several or f'{noun}s'}"


def rounded_up(x: float) -> str:
    """Return three digits of a number, no less than it."""
    near = float(f"{x:.3g}")
    return f"{near if near >= x else near + 10.0 ** (floor(log10(x)) - 2):.3g}"


def rounded_down(x: float) -> str:
    """Return three digits of a number, no more than it."""
    near = float(f"{x:.3g}")
    return f"{near if near <= x else near - 10.0 ** (floor(log10(x)) - 2):.3g}"


def time_left(began: float, done: int, total: int, least: float = 1.0) -> str:
    """Return ", about 12 s left" of like steps; empty while none is done, or below `least` s.

    Args:
        began: `time.monotonic()` at the first, s. done, total: numbers of steps.
    """
    left = (time.monotonic() - began) * (total - done) / max(done, 1)
    if not done or left < least:
        return ""
    if left < 120.0:
        return f", about {left:.0f} s left"
    return (
        f", about {left / 60.0:.0f} min left"
        if left < 7200.0
        else f", about {left / 3600.0:.0f} h left"
    )
