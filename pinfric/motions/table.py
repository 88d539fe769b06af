"""A motion as a table of numbers, one per joint; its derivatives, and what spoils them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.motions.derivatives import (
    find_holds,
    position_derivatives,
    velocity_derivative,
)
from pinfric.motions.joint_columns import JointColumn, listing
from pinfric.motions.log.rows import GAP_FACTOR, gaps
from pinfric.motions.log.still import with_resting_ends

#: Share of a joint's peak speed by which its velocities may miss those of its positions (RMS).
_MISMATCH_SHARE = 0.1
#: The same where rows are few, and their velocities' means say less of the motion between them.
_FEW_ROWS_MISMATCH = 0.5
#: Fewer samples than this say too little about a mismatch.
_FEWEST_SAMPLES = 20
#: Share of its speed (RMS) by which a joint may change it from row to row where derivatives come
#: from a spline: 8 rows in a move from rest to rest, 14 in a period of an oscillation. Splines
#: through fewer are off by some 10 % of the peak acceleration.
_COARSE_SHARE = 0.5
#: Share by which a time step differs from the usual one to be odd, and the share of all steps that
#: such are at most.
_ODD_STEP, _FEW_ODD = 0.5, 0.02
#: Fewer rows than this in a motion say nothing about its acceleration.
_FEWEST_ROWS = 5
#: A robot starts and stops at rest: its mean speed in the first step of a move is half the next
#: one's, or less. Stops at equal distances have this share of the RMS speed at once, or more.
_AT_SPEED = 0.75
#: Joints of which a message shows the positions.
_SHOWN = 8
#: s; nobody writes stops at shorter steps, and recordings seldom come at longer ones (10 Hz).
_STOPS_PACE = 0.101


@dataclass(frozen=True)
class TrajectoryTable:
    """A motion with one number per joint, (T, nj); a column of NaN is one that was not given.

    `attached`: payload -> (T,) bool. `resolution`: (nj,) last digit printed of the positions, 0:
    not rounded.
    """

    t: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    attached: dict[str, BoolArray]
    resolution: FloatArray


@np.errstate(over="ignore", invalid="ignore")  # what overflows is refused as not finite
def complete_derivatives(
    columns: Sequence[JointColumn],
    table: TrajectoryTable,
    problems: list[str],
    warnings: list[str],
) -> tuple[FloatArray, FloatArray]:
    """Return velocities and accelerations (T, nj), those not given from splines (`derivatives`).

    The table's times increase and its positions are finite. What cannot be derived is appended to
    `problems`; accelerations that rounding spoils, and velocities that do not fit the positions, to
    `warnings`.
    """
    v, a = table.velocity, table.acceleration
    warnings += mismatch_warnings(columns, table)
    missing = [i for i in range(len(columns)) if np.isnan(v[0, i]) or np.isnan(a[0, i])]
    if missing:
        v, a = v.copy(), a.copy()
    if missing and table.t.size == 1:
        names = ", ".join(columns[i].name for i in missing)
        problems.append(f"one sample has no derivatives: give .v and .a for {names}")
        return v, a
    bare = [i for i in missing if np.isnan(v[0, i])]
    problems += _coarse_rows([columns[i] for i in bare], table.t, table.position[:, bare])
    apart, across = gaps(table.t) if missing else (), dict[str, list[str]]()
    for i in missing:
        q, resolution = table.position[:, i], table.resolution[i]
        holds = find_holds(q, resolution)
        step = float(table.t[1] - table.t[0])
        if resolution > 0.0 and np.ptp(np.diff(table.t)) < 1e-6 * step:
            (holds,) = with_resting_ends(q[:, None], step, [resolution / np.sqrt(12.0)], [holds])
        if moved := [k for k in apart if q[k] != q[k + 1]]:
            where = listing(f"{table.t[k]:.6g} to {table.t[k + 1]:.6g} s" for k in moved)
            across.setdefault(where, []).append(columns[i].name)
        try:
            if not np.isnan(v[0, i]):
                a[:, i] = velocity_derivative(table.t, v[:, i], holds)
                continue
            fitted_v, fitted_a = position_derivatives(table.t, q, holds)
        except ValueError as problem:  # SciPy: numbers too far apart for a spline
            problems.append(
                f"joint {columns[i].name}: no spline can be fitted to its samples "
                f"({problem}); give .v and .a"
            )
            continue
        v[:, i] = fitted_v
        if np.isnan(a[0, i]):
            a[:, i] = fitted_a
    problems += [
        f"joint{'s' * (len(names) > 1)} {', '.join(names)}: moves across gaps in time ({where}), "
        "where its derivatives are unknown; give .v and .a, or the missing samples"
        for where, names in across.items()
    ]
    return v, a


def _coarse_rows(columns: Sequence[JointColumn], t: FloatArray, positions: FloatArray) -> list[str]:
    """Say that rows are too far apart to be samples: they may be way-points."""
    if t.size < 2 or not columns:
        return []
    slopes = np.diff(positions, axis=0) / np.diff(t)[:, None]
    moves = (slopes != 0.0).sum(axis=0) + 1
    speed = np.sqrt(np.mean(slopes**2, axis=0))
    change = np.sqrt(np.mean(np.diff(slopes, axis=0) ** 2, axis=0)) if len(t) > 2 else 0.0 * speed
    share = change / np.where(speed > 0.0, speed, 1.0)
    # Few rows, seldom enough to be stops, that begin and end in the middle of a joint's motion
    often = t.size >= _FEWEST_SAMPLES or float(np.median(np.diff(t))) <= _STOPS_PACE
    slowest = np.minimum(np.abs(slopes[0]), np.abs(slopes[-1]))
    at_speed = (slowest >= _AT_SPEED * speed) & (not often)
    coarse = (speed > 0.0) & ((share > _COARSE_SHARE) | (moves < _FEWEST_ROWS) | at_speed)
    if not coarse.any():
        return []
    if stamp := _odd_stamp(t, slopes, speed):
        return [stamp]
    i = int(np.argmax(np.where(coarse, share, -1.0)))
    why = ""
    if share[i] > _COARSE_SHARE:
        why = f", its speed changes by {100 * share[i]:.0f} % from row to row"
    elif at_speed[i]:
        first, last = np.abs(slopes[[0, -1], i])
        unit = columns[i].unit
        why = (
            f" at {first:.3g} {unit}/s in the first step and {last:.3g} in the last, but robots "
            "start and stop at rest"
        )
    start, second = (", ".join(f"{x:.4g}" for x in row) for row in positions[:2])
    way = f"{{q: [{start}]}}, {{q: [{second}], duration: {t[1] - t[0]:.4g}}}, "
    points = f"points: [{way if positions.shape[1] <= _SHOWN else ''}...]"
    return [
        f"rows are too far apart for the motion between them: joint {columns[i].name} moves over "
        f"{moves[i]} rows{why}. Where rows are stops, write them as a way-point file "
        f"(`pinfric_trajectory: 1`, `{points}`), which is planned from rest to rest; where they "
        "are samples, give more of them, or .v and .a"
    ]


def _odd_stamp(t: FloatArray, slopes: FloatArray, speed: FloatArray) -> str:
    """Say which time stamp is odd, if without the steps beside a few such the motion is smooth."""
    steps = np.diff(t)
    usual = float(np.median(steps))
    odd = np.abs(steps - usual) > _ODD_STEP * usual
    if not 0 < odd.sum() <= _FEW_ODD * steps.size:
        return ""
    change = np.diff(slopes, axis=0)[~(odd[1:] | odd[:-1])]
    left = np.sqrt(np.mean(change**2, axis=0)) if len(change) else np.inf
    if (left > _COARSE_SHARE * np.where(speed > 0.0, speed, 1.0)).any():
        return ""
    k = int(np.argmax(odd)) + 1
    return (
        f"a time stamp is odd: sample {k} at {t[k]:.6g} s comes {steps[k - 1]:.3g} s after the one "
        f"before, others {usual:.3g} s ({int(odd.sum())} such steps), and no joint jumps so: mend "
        "it, or leave this sample out"
    )


def mismatch_warnings(columns: Sequence[JointColumn], table: TrajectoryTable) -> list[str]:
    """Return a line for each joint whose velocities are not those of its positions.

    Compared are the mean velocities of each time step, which cost little over millions of samples.
    Few rows with v = 0 are stops, not samples.
    """
    t, lines = table.t, []
    steps = np.diff(t)
    if t.size < 2 or (steps <= 0.0).any():
        return []
    dense = steps <= GAP_FACTOR * np.median(steps)
    share = _MISMATCH_SHARE if t.size >= _FEWEST_SAMPLES else _FEW_ROWS_MISMATCH
    joints = zip(columns, table.position.T, table.velocity.T, table.resolution, strict=True)
    for column, q, v, resolution in joints:
        if not np.isfinite(v).all():
            continue
        moves = np.diff(q)
        if column.nq == 2:  # an angle may be written within +-pi
            moves -= 2.0 * np.pi * np.round(moves / (2.0 * np.pi))
        by_position = moves[dense] / steps[dense]
        by_velocity = 0.5 * (v[1:] + v[:-1])[dense]
        # two roundings of resolution / sqrt(12) each, and three standard deviations
        noise = 3.0 * resolution / np.sqrt(6.0) / float(np.median(steps))
        peak = max(float(np.abs(by_position).max()) - noise, float(np.abs(v).max()))
        miss = float(np.sqrt(np.mean((by_position - by_velocity) ** 2)))
        if miss > share * peak + noise:
            lines.append(
                f"joint {column.name}: the velocities given do not fit the positions: they differ "
                f"by {miss:.3g} {column.unit}/s (RMS) at speeds up to {peak:.3g}; check units, "
                "order and sign, or leave the velocities out"
            )
    return lines
