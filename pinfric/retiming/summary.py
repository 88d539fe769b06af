"""Summary of retiming, as `pinfric retime` prints and writes it."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinfric.drives.criterion import Criterion
from pinfric.drives.limits import instant_limits
from pinfric.model.described import described, gathered, quantity
from pinfric.retiming.retime import RetimeResult


@described
class DriveUse:
    """Largest use of the limits of one drive."""

    name: str = quantity("the drive's", heading="drive", name=True)
    motor: str | None = quantity("its name in the catalogue; none: limits given as numbers")
    limits: dict[str, Any] = quantity("limits, with the keys of a motor file")
    use: dict[str, float] = quantity(
        "limit -> largest used part of it", heading="most of a limit used"
    )
    limiting: dict[str, float] = quantity(
        "limit -> part of the moving time for which it holds the motion back",
        heading="holds the motion back,\nof the time moving",
    )
    rms: float | None = quantity(
        "RMS torque over the cycle / continuous torque; none: not known, or not asked for",
        heading="continuous\ntorque used",
        cell="{rms:percent}",
    )
    criteria: tuple[Criterion, ...] = quantity(
        "criteria of `size` for a drive of the catalogue, this motion repeated"
    )


@described
class RetimedMove:
    """One move between two stops."""

    number: int = quantity("from 0", heading="move")
    duration: float = quantity("its time", "s", "takes")
    hold_before: float = quantity("hold before the move", "s", "after a\nhold of")
    hold_after: float = quantity("hold after the move", "s", "before a\nhold of")


@described
class RetimeSummary:
    """The fastest motion along a path, and the limits that hold it back."""

    path: str = quantity("source of the path")
    duration: float = quantity("holds included", "s")
    before: float | None = quantity("duration before retiming; none: it had no times", "s")
    moves: np.ndarray = quantity("duration of each move", "s")
    holds: list[float] = quantity("hold at each stop", "s")
    uniform: float | None = quantity(
        "duration if the whole motion were slowed down to keep the continuous torques; none: not "
        "checked",
        "s",
    )
    smooth: float = quantity("length of the moving average", "s")
    excess: float = quantity("largest excess of a sample over any limit, relative to the limit")
    sample_rate: float = quantity("of the trajectory", "Hz")
    grid_points: int = quantity("number of grid points along the path")
    drives: tuple[DriveUse, ...] = quantity("in the order of the scene")
    failing: tuple[str, ...] = quantity(
        "criteria of `size` that this motion, repeated, does not pass, with their drives"
    )
    notes: tuple[str, ...] = quantity("limits that are exceeded or were not checked")


def retime_summary(result: RetimeResult) -> RetimeSummary:
    """Return the summary of retiming."""
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
        )
        for d, (drive, limits) in enumerate(zip(problem.scene.drives, problem.limits, strict=True))
    ]
    return gathered(
        RetimeSummary,
        result,
        path=problem.path.source,
        holds=list(problem.path.holds),
        sample_rate=problem.policy.sample_rate,
        grid_points=len(result.profile.x),
        drives=tuple(drives),
    )
