"""Result of retiming, as tables for people."""

from __future__ import annotations

import math
from pathlib import Path

from pinfric.retiming.retime import RetimeResult
from pinfric.retiming.summary import DriveUse, Move, RetimeSummary
from pinfric.show.report.rows import NONE, table_of
from pinfric.show.report.tables import Report, paragraphs
from pinfric.show.report.values import digits


def retime_report(result: RetimeResult, found: RetimeSummary) -> Report:
    """Return the tables and lines that `pinfric retime` prints, for a rich console.

    Args:
        result: of `retime`.
        found: its summary.
    """
    title = f"{Path(result.problem.scene.source).stem} · {Path(found.path).name}"
    title += f": {digits(found.duration)} s"
    if found.before is not None:
        faster = 100.0 * (1.0 - found.duration / found.before)
        title += f", {digits(found.before)} s before: {abs(faster):.3g} % "
        title += "less" if faster >= 0 else "more"
    holds = found.holds
    moves = [
        Move(i, float(time), holds[i], holds[i + 1]) for i, time in enumerate(found.moves.tolist())
    ]
    drives = table_of(
        "drives",
        found.drives,
        cells={"use": _nearest, "limiting": _limiting, "rms": _continuous},
        without=[] if result.rms is not None else ["rms"],
    )
    return paragraphs(title, table_of("moves", moves), drives, _lines(result))


def _limiting(drive: DriveUse) -> str:
    shares = sorted(drive.limiting.items(), key=lambda entry: -entry[1])
    return ", ".join(f"{kind} {percent(share)}" for kind, share in shares)


def _nearest(drive: DriveUse) -> str:
    kind = max(drive.use, key=drive.use.__getitem__)
    return f"{percent(drive.use[kind])} {kind}"


def _continuous(drive: DriveUse) -> str:
    return NONE if drive.rms is None else percent(drive.rms)


def _lines(result: RetimeResult) -> list[str]:
    rate = result.problem.policy.sample_rate
    lines = [f"! {note}" for note in result.notes]
    lines.append(
        f"no limit is exceeded by more than {100 * result.excess:.2g} % at {rate:g} Hz "
        "(inverse dynamics)"
    )
    limits = zip(result.problem.scene.drives, result.problem.limits, strict=True)
    cold = [d.name for d, x in limits if not (x.motor or math.isfinite(x.continuous_torque))]
    if cold:
        whose = "any drive" if len(cold) == len(result.problem.limits) else ", ".join(cold)
        lines.append(f"heat is not checked for {whose}: no continuous torque is given")
    if result.uniform is not None and result.uniform > result.duration * 1.0005:
        gain = 100.0 * (result.uniform / result.duration - 1.0)
        lines.append(
            f"slowing down the whole motion to keep the continuous torques would need "
            f"{digits(result.uniform)} s: {gain:.3g} % more"
        )
    if result.smooth:
        cost = result.smooth * len(result.moves)
        lines.append(f"smoothing over {1e3 * result.smooth:g} ms costs {digits(cost)} s")
    if result.profile.holes:
        lines.append(
            f"at {result.profile.holes} points the permitted accelerations are two separate "
            "ranges; the larger range was used"
        )
    return lines


def percent(share: float) -> str:
    """Return a share as a percentage with two digits or three."""
    return f"{100 * share:.3g} %" if share >= 1e-3 else "<0.1 %"
