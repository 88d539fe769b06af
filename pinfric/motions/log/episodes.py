"""Files of several recordings, numbered by a column, as those of LeRobot: one of them is a log."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from pinfric.motions.joint_columns import listing
from pinfric.motions.log.frame import LogFrame, OpenedLog, Remarks

#: Columns that number recordings, the first that is there counts.
EPISODES = ("episode_index", "episode_id", "episode")


def one_episode(log: OpenedLog, chosen: int | None, said: Remarks) -> OpenedLog:
    """Return the log of one recording in a file; others would join to one motion with jumps.

    Args:
        chosen: its number; None: the file must have no other.
        said: several without a choice, no such number, rows apart are added to its problems.
    """
    column = next((name for name in EPISODES if name in log.header), None)
    if column is None:
        if chosen is not None:
            said.problems.append(f"columns: episode: the log has no column {EPISODES[0]}")
        return log
    frame = log.read([column], said.problems, ())
    lines, numbers = np.asarray(frame.lines), frame.column(column)
    there = np.unique(numbers)
    if frame.dropped:
        said.problems.append(f"column {column}: {frame.why}")
    if said.problems or (there.size < 2 and chosen is None):
        return log
    range_ = listing(f"{x:g}" for x in there)
    if chosen is None:
        said.problems.append(
            f"has {there.size} recordings (column {column}: {range_}), and they are no one motion: "
            f"choose one by `episode: {there[0]:g}` in a YAML file given by --columns, or write "
            f"each to a file of its own: pandas.read_parquet(FILE).groupby('{column}')"
        )
        return log
    own = np.flatnonzero(numbers == chosen)
    if not own.size:
        said.problems.append(f"columns: episode: there is no {chosen}; there are {range_}")
        return log
    again = own[np.flatnonzero(np.diff(own) > 1) + 1]
    if again.size:
        said.problems.append(
            f"column {column}: {chosen} is there again from line {lines[again[0]]} on, after "
            "others: recordings with one number, or mixed, are no one motion; number them anew"
        )
    first, last = lines[own[0]], lines[own[-1]]

    def read(names: Sequence[str], problems: list[str], may_lack: Collection[str]) -> LogFrame:
        frame = log.read(names, problems, may_lack)
        numbers = np.asarray(frame.lines)
        keep = (numbers >= first) & (numbers <= last)
        return replace(frame, values=frame.values[keep], lines=numbers[keep].tolist())

    return replace(log, read=read, notes=(*log.notes, f"recording {chosen} of {there.size}"))
