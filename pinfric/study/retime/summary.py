"""What retiming comes to: what `pinfric retime` prints and writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pinfric.model.described import described, quantity
from pinfric.study.retime.retime import RetimeResult
from pinfric.study.sizing.criteria import instant_limits
from pinfric.study.sizing.criterion import Criterion


@described
class DriveUse:
    """How near one drive comes to its limits."""

    name: str = quantity("the drive's", heading="drive", name=True)
    motor: str | None = quantity("of the catalogue; none: its figures are given")
    limits: dict[str, Any] = quantity("as a motor file says them")
    use: dict[str, float] = quantity(
        "limit -> largest part of it that is used", heading="most of a limit used"
    )
    limiting: dict[str, float] = quantity(
        "limit -> part of the moving time in which it holds the motion back",
        heading="holds the motion back,\nof the time moving",
    )
    rms: float | None = quantity(
        "part of its continuous torque over the cycle; none: not known, or not asked for",
        heading="continuous\ntorque used",
    )
    criteria: tuple[Criterion, ...] = quantity(
        "what `size` says of a drive of the catalogue for this motion, repeated"
    )
    sensitivity: dict[str, float] | None = quantity(
        "limit -> d ln T/d ln limit of the moving time T; none: not asked for"
    )


@described
class Move:
    """One move between two stops."""

    number: int = quantity("from 0", heading="move")
    duration: float = quantity("its time", "s", "takes")
    hold_before: float = quantity("at the stop before", "s", "after a\nhold of")
    hold_after: float = quantity("at the stop after", "s", "before a\nhold of")


@described
class Sensitivity:
    """What more of one limit would bring."""

    drive: str = quantity("its name", heading="drive", name=True)
    limit: str = quantity("which", heading="limit")
    change: float = quantity(
        "of the time moving, in percent for 1 % more", heading="change", cell="{change:+.3f} %"
    )


@described
class RetimeSummary:
    """The fastest motion along a path, and what holds it back."""

    path: str = quantity("where the path comes from")
    duration: float = quantity("holds included", "s")
    before: float | None = quantity("how long the motion took before; none: it had no times", "s")
    moves: np.ndarray = quantity("of each move", "s")
    holds: list[float] = quantity("at each stop", "s")
    uniform: float | None = quantity(
        "if it were slowed down as a whole to keep the continuous torques; none: not judged", "s"
    )
    smooth: float = quantity("of the moving mean", "s")
    excess: float = quantity("the most by which a sample exceeds any limit, as a part of it")
    sample_rate: float = quantity("of the trajectory", "Hz")
    grid_points: int = quantity("of the speed along the path")
    drives: tuple[DriveUse, ...] = quantity("in the order of the scene")
    notes: tuple[str, ...] = quantity("what is exceeded or was not judged")


def retime_summary(
    result: RetimeResult, sensitivity: Mapping[str, Mapping[str, float]] | None = None
) -> RetimeSummary:
    """Return what retiming comes to.

    Args:
        result: of `retime`.
        sensitivity: drive -> limit -> d ln T/d ln limit, where that was asked for.
    """
    problem, most = result.problem, result.usage.max(axis=0, initial=0.0)
    # limits that no drive of this robot has would be columns of zeros
    rows = [
        (k, limit.name)
        for k, limit in enumerate(instant_limits())
        if any(np.isfinite(limits.bound(limit)) for limits in problem.limits)
    ]
    drives = [
        DriveUse(
            name=drive.name,
            motor=limits.motor or None,
            limits=limits.model_dump(exclude={"transmission", "motor"}),
            use={name: float(most[d, k]) for k, name in rows},
            limiting=result.limiting.get(drive.name, {}),
            rms=None if result.rms is None else float(result.rms[d]),
            criteria=result.criteria.get(drive.name, ()),
            sensitivity=None if sensitivity is None else dict(sensitivity.get(drive.name, {})),
        )
        for d, (drive, limits) in enumerate(zip(problem.scene.drives, problem.limits, strict=True))
    ]
    return RetimeSummary(
        path=problem.path.source,
        duration=result.duration,
        before=result.before,
        moves=result.moves,
        holds=list(problem.path.holds),
        uniform=result.uniform,
        smooth=result.smooth,
        excess=result.excess,
        sample_rate=problem.policy.sample_rate,
        grid_points=len(result.profile.x),
        drives=tuple(drives),
        notes=result.notes,
    )
