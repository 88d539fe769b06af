"""Result of retiming, as tables."""

from __future__ import annotations

import math
from pathlib import Path

from pinfric.retiming.retime import RetimeResult
from pinfric.retiming.summary import DriveUse, RetimedMove, RetimeSummary
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Report, paragraphs
from pinfric.show.report.values import digits, percent


def retime_report(
    result: RetimeResult, summary: RetimeSummary, verbose: bool = True, written: bool = False
) -> Report:
    """Return what `pinfric retime` prints.

    Args:
        verbose: also the moves one by one.
        written: see `sizing_report`.
    """
    holds = summary.holds
    moves = [
        RetimedMove(i, float(time), holds[i], holds[i + 1])
        for i, time in enumerate(summary.moves.tolist())
    ]
    drives = table_of(
        f"{Path(result.problem.scene.source).stem} · {Path(summary.path).name}",
        summary.drives,
        cells={
            "use": _nearest,
            "limiting": lambda drive: ", ".join(
                f"{kind} {percent(drive.limiting[kind])}"
                for kind in sorted(drive.limiting, key=lambda kind: -drive.limiting[kind])
            ),
        },
        without=[] if result.rms is not None else ["rms"],
    )
    rate = result.problem.policy.sample_rate
    lines = [f"! {note}" for note in result.notes]
    if result.fitted:
        lines.append(
            "installed for this motion, with gear, rotor and mass, as the scene has no gear there: "
            f"{'; '.join(result.fitted)}"
        )
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
    if not verbose and len(moves) > 1:
        out = "" if written else "; the motion: --out FOLDER"
        lines.append(f"each of {len(moves)} moves: -v{out}")
    shown = table_of("moves", moves) if verbose else None
    return paragraphs([verdict(summary)], drives, shown, lines)


def verdict(summary: RetimeSummary) -> str:
    """Return in a line the motion's duration, and the drive that limits it most."""
    said = f"{digits(summary.duration)} s"
    if summary.before is not None:
        faster = 100.0 * (1.0 - summary.duration / summary.before)
        said += f", {digits(summary.before)} s before: {abs(faster):.3g} % "
        said += "less" if faster >= 0 else "more"
    held = [(share, d.name, kind) for d in summary.drives for kind, share in d.limiting.items()]
    if held:
        share, name, kind = max(held)
        said += f"; {name} holds it back most ({kind}, {percent(share)} of the time moving)"
    if summary.failing:
        more = len(summary.failing) - 1
        said += f"; does not pass `size`: {summary.failing[0]}" + f"; {more} more" * bool(more)
    return said


def _nearest(drive: DriveUse) -> str:
    kind = max(drive.use, key=drive.use.__getitem__)
    return f"{percent(drive.use[kind])} {kind}"
