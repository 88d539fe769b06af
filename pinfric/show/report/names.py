"""Long names, cut so that each stays unique."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence

#: Common beginnings and ends shorter than this are not worth a line of their own.
_WORTH = 3


def affixes(names: Sequence[str]) -> tuple[str, str]:
    """Return the beginning and the end that all names share, up to a separator: _ . / - or blank.

    Empty if too short, or if nothing would be left of a name; a beginning stays if only a number
    would be left.
    """
    unique = list(dict.fromkeys(names))
    if len(unique) < 2:
        return "", ""
    front = re.sub(r"[^_./\- ]*$", "", unique[0][: _common(unique)])
    front = front if len(front) >= _WORTH else ""
    backward = [name[len(front) :][::-1] for name in unique]
    back = re.sub(r"^[^_./\- ]*", "", backward[0][: _common(backward)][::-1])
    back = back if len(back) >= _WORTH else ""
    if min(map(len, unique)) <= len(front) + len(back):
        return "", ""
    kept = without(unique, front, back)
    return "" if any(name.isdigit() for name in kept) else front, back


def without(names: Sequence[str], front: str, back: str) -> list[str]:
    """Return the names without this beginning and end."""
    return [name.removeprefix(front).removesuffix(back) for name in names]


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Return name -> name without the common beginning and end, as in all tables."""
    front, back = affixes(names)
    return dict(zip(names, without(names, front, back), strict=True))


def said_short(text: str, short: Mapping[str, str]) -> str:
    """Return a text with names short as in tables, but whole in quotes and keys: mu.elbow_joint.

    Args:
        short: of `short_names`.
    """
    longest = sorted((name for name in short if short[name] != name), key=len, reverse=True)
    if not longest:
        return text
    names = "|".join(map(re.escape, longest))
    pattern = rf"(?<![\w./'\"-])({names})(?![\w/'\"-]|\.\w)"
    return re.sub(pattern, lambda match: short[match[1]], text)


def picture_names(names: Sequence[str], room: int) -> tuple[list[str], str]:
    """Return names for a picture, and "; left out of each name: …" for its title.

    Args:
        room: letters for each.
    """
    front, back = affixes(names)
    note = left_out(front, back)
    return shortened(without(names, front, back), room), f"; {note}" if note else ""


def left_out(front: str, back: str) -> str:
    """Return the line that states what `without` removed; empty for nothing."""
    shared = [f"{front}…"] * bool(front) + [f"…{back}"] * bool(back)
    return f"left out of each name: {' and '.join(shared)}" if shared else ""


def shortened(names: Sequence[str], room: int) -> list[str]:
    """Cut names longer than `room` letters in their middle: "hand_ind…tual_1".

    Where their ends are alike they are cut around the part in which they differ.
    """
    cut = _cut_in_the_middle(names, room)
    if cut is not None:
        return cut
    alike = len(set(names)) == 1
    front = 0 if alike else _common(names)
    back = 0 if alike else _common([name[::-1] for name in names])
    cut = list(names)
    for i, name in enumerate(names):
        if len(name) > room:
            middle = (front + len(name) - min(back, len(name) - front)) // 2
            start = min(max(middle - room // 2, 0), len(name) - room)
            window = name[start : start + room]
            window = "…" + window[1:] if start > 0 else window
            cut[i] = window[:-1] + "…" if start + room < len(name) else window
    return cut


def least_room(names: Sequence[str]) -> int:
    """Return the number of letters that keeps names, cut in the middle, unique."""
    longest = max(map(len, names), default=0)
    return next((r for r in range(3, longest) if _cut_in_the_middle(names, r)), longest)


def _cut_in_the_middle(names: Sequence[str], room: int) -> list[str] | None:
    """Keep the names' ends, as evenly as keeps them unique; None if nothing does."""
    unique = set(names)
    kept = room - 1
    if kept < 2:
        return None if any(len(name) > room for name in unique) else list(names)
    heads = sorted(range(1, kept), key=lambda head: abs(2 * head - kept))
    matching: dict[int, Counter[tuple[str, str]]] = {}
    cut: dict[str, str] = {}
    for name in unique:
        if len(name) <= room:
            cut[name] = name
            continue
        for head in heads:
            if head not in matching:
                tail = kept - head
                ends = ((n[:head], n[-tail:]) for n in unique if len(n) >= kept)
                matching[head] = Counter(ends)
            ends_of_this = name[:head], name[head - kept :]
            if matching[head][ends_of_this] == 1:
                cut[name] = "…".join(ends_of_this)
                break
        else:
            return None
    return [cut[name] for name in names]


def _common(names: Sequence[str]) -> int:
    columns = zip(*names, strict=False)
    return sum(1 for _ in itertools.takewhile(lambda letters: len(set(letters)) == 1, columns))
