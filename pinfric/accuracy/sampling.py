"""Errors of inverse dynamics with a coarser trajectory: stick time between samples is missed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult, StickInterval
from pinfric.dynamics.samples.states import MotionLike, attached_columns
from pinfric.errors import PinfricError
from pinfric.model.described import described, quantity
from pinfric.model.scene import Scene
from pinfric.motions.summary import ends_by_magnitude
from pinfric.motions.trajectory import Trajectory

#: Every how many samples of the trajectory one is kept.
STRIDES = (1, 2, 5, 10, 20, 50, 100)
_FEWEST = 10
_NAN = float("nan")


@described
class Sampled:
    """The same motion with fewer samples."""

    rate: float = quantity("samples per second, on average", "1/s", "samples")
    samples: int = quantity("how many", heading="samples")
    given: str = quantity(
        "`q, v, a`, or `q`: velocities and accelerations from a spline", heading="given"
    )
    missed_stick: float = quantity(
        "time at rest that is missed, summed over the joints", "s", "stick missed", default=_NAN
    )
    stick: float = quantity("time at rest in the whole trajectory", "s", "of", default=_NAN)
    peak_error: float = quantity(
        "largest error of any drive's peak effort, as a share of that peak",
        heading="error of\npeaks",
        cell="{peak_error:percent}",
        default=_NAN,
    )
    problem: str = quantity("why it failed; empty: it did not fail", default="")


@dataclass(frozen=True)
class _Unlimited:
    """A scene as trajectories need it, whose joints go anywhere: simulated motions do."""

    model: pin.Model
    payloads: dict[str, Any]

    @classmethod
    def of(cls, scene: Scene) -> _Unlimited:
        model = scene.model.copy()
        model.lowerPositionLimit = np.full(model.nq, -np.inf)
        model.upperPositionLimit = np.full(model.nq, np.inf)
        model.velocityLimit = np.full(model.nv, np.inf)
        return cls(model, dict(scene.payloads))


def sampling(scene: Scene, motion: MotionLike) -> tuple[Sampled, ...]:
    """Return the errors of inverse dynamics with fewer samples, by stride.

    Args:
        scene: the robot.
        motion: with t, q, v, a; all its samples are the reference.

    Raises:
        PinfricError: the reference itself has no solution.
    """
    whole = _solve(scene, motion, 1, "q, v, a")
    count = len(motion.t)
    rows = []
    # a spline through each joint by itself opens loops
    for given in ("q, v, a", "q") if scene.linkage is None else ("q, v, a",):
        for stride in STRIDES:
            kept = len(motion.t[::stride])
            if kept < min(_FEWEST, count):
                break
            rate = (count - 1) / stride / float(motion.t[-1] - motion.t[0])
            try:
                thin = (
                    whole
                    if (stride, given) == (1, "q, v, a")
                    else _solve(scene, motion, stride, given)
                )
            except PinfricError as problem:
                text = " ".join(str(problem).split())
                rows.append(Sampled(rate, kept, given, problem=text))
                if stride == 1:  # all samples do not do: fewer will not either
                    break
                continue
            stick, missed = missed_stick(whole.stick_intervals(), thin.stick_intervals())
            rows.append(Sampled(rate, kept, given, missed, stick, _peak_error(whole, thin)))
    return tuple(rows)


def _solve(scene: Scene, motion: MotionLike, stride: int, given: str) -> InverseResult:
    part = slice(None, None, stride)
    attached = attached_columns(scene, motion)
    carried = None if attached is None else attached[part]
    t, q = motion.t[part], motion.q[part]
    if given == "q":
        named = {} if carried is None else dict(zip(scene.payloads, carried.T, strict=True))
        thin = Trajectory.from_arrays(_Unlimited.of(scene), t, q, attached=named)
        return inverse_dynamics(scene, thin, threads=1)
    v, a = motion.v[part], motion.a[part]
    return inverse_dynamics(scene, q, v, a, t=t, attached=carried, threads=1)


def missed_stick(
    true: Iterable[StickInterval], found: Iterable[StickInterval]
) -> tuple[float, float]:
    """Return the time of the true intervals, and how much of it the found ones do not cover (s)."""
    found = tuple(found)
    total = covered = 0.0
    for one in true:
        total += one.end - one.start
        covered += sum(
            max(0.0, min(one.end, f.end) - max(one.start, f.start))
            for f in found
            if f.site == one.site
        )
    return total, total - covered


def _peak_error(whole: InverseResult, thin: InverseResult) -> float:
    """Largest change of a drive's peak, as a share of it; drives that only see rounding left out"""
    true, other = (
        np.nanmax(np.abs(ends_by_magnitude(r.effort_lower, r.effort_upper)[0]), axis=0)
        for r in (whole, thin)
    )
    counts = true > 1e-9 * true.max()
    return float((np.abs(other - true)[counts] / true[counts]).max(initial=0.0))
