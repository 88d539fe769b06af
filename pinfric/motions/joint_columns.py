"""The joints of a model as files see them: one column, one number, its limits.

Arguments: columns (nj,) the joints, position (T, nj) rad or m, velocity (T, nv), t (T,) s.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.errors import TrajectoryError, problems_line
from pinfric.model.arrays import FloatArray
from pinfric.model.coordinates import is_sliding, unwrapped_angle
from pinfric.model.floating import POSE, base_configuration, base_motion, free_joint

#: rad or m (rad/s, m/s); a value this far beyond a limit is rounding of the file, no violation.
LIMIT_TOLERANCE = 1.0e-6
_UNLIMITED = 1.0e300  # Pinocchio's "no limit" is inf or the largest float


@dataclass(frozen=True)
class JointColumn:
    """A one-dof joint as a file sees it: one number; limits in rad or m, infinite where none.

    `follows` says how a mimic follower depends on its leader; empty for all others. `free`: one of
    the six numbers of a free base (`floating.POSE`), whose v and a are others (`base_motion`).
    """

    name: str
    index_q: int
    index_v: int
    nq: int
    unit: str
    lower: float
    upper: float
    velocity_limit: float
    follows: str = ""
    free: bool = False

    @property
    def why(self) -> str:
        """The end of a message about it: what it follows."""
        return f"; it follows {self.follows}" if self.follows else ""


def joint_columns(
    model: pin.Model, source: str = "model", free_base: bool = False
) -> tuple[JointColumn, ...]:
    """Return the joints a file has a column for: one dof each, mimic followers left out.

    `free_base`: whether a base that floats has six columns.

    Raises:
        TrajectoryError: planar, spherical or floating joints, which files cannot describe.
    """
    base = free_joint(model) if free_base else ""
    joints = list(zip(model.names, model.joints, strict=True))[1:]  # the first is the ground
    moving = [(name, joint) for name, joint in joints if joint.nv > 0]
    several = [
        f"{name} ({joint.nv} degrees of freedom)"
        for name, joint in moving
        if joint.nv > 1 and name != base
    ]
    if several:
        raise TrajectoryError(
            f"{source}: files give one number per joint, which is not enough for "
            f"{', '.join(several)}; make the trajectory in Python: Trajectory.from_arrays"
        )
    columns = []
    for name, joint in moving:
        if name == base:
            columns += base_columns(name)
            continue
        lower, upper = -np.inf, np.inf
        if joint.nq == 1:
            low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
            lower, upper = stated_range(float(low), float(high))
        speed = stated_limit(float(model.velocityLimit[joint.idx_v]))
        unit = "m" if is_sliding(joint) else "rad"
        place = joint.idx_q, joint.idx_v, joint.nq
        columns.append(JointColumn(name, *place, unit, lower, upper, speed))
    return tuple(columns)


def base_columns(name: str) -> list[JointColumn]:
    """Return the six columns of the first joint, a free base."""
    return [
        JointColumn(
            f"{name}.{part}", k, k, 1, "m" if k < 3 else "rad", -np.inf, np.inf, np.inf, free=True
        )
        for k, part in enumerate(POSE)
    ]


def stated_range(low: float, high: float) -> tuple[float, float]:
    """Return a joint's limits, infinite if none is stated.

    A URDF's limit without lower and upper reads as 0 to 0; any other range is meant, also one of a
    single position.
    """
    if low > high or low == high == 0.0:
        return -np.inf, np.inf
    return (low if low > -_UNLIMITED else -np.inf), (high if high < _UNLIMITED else np.inf)


def stated_limit(limit: float) -> float:
    """Return a speed or effort limit, infinite if none is stated (0, or the largest float)."""
    return limit if 0.0 < limit < _UNLIMITED else np.inf


def limit_problems(
    columns: Sequence[JointColumn], t: FloatArray, position: FloatArray
) -> list[str]:
    """Return one line per joint and side on which finite positions pass a limit."""
    problems: list[str] = []
    for index, column in enumerate(columns):
        q = np.where(np.isfinite(position[:, index]), position[:, index], np.nan)
        for side, limit, beyond in (
            ("below its lower", column.lower, q < column.lower - LIMIT_TOLERANCE),
            ("above its upper", column.upper, q > column.upper + LIMIT_TOLERANCE),
        ):
            if beyond.any():
                samples = np.flatnonzero(beyond)
                worst = samples[np.argmax(np.abs(q[samples] - limit))]
                problems.append(
                    f"joint {column.name}: {q[worst]:.6g} {column.unit} is {side} limit "
                    f"{limit:.6g} (first at t = {t[samples[0]]:.6g} s, sample {samples[0]}; "
                    f"samples beyond it: {samples.size}){column.why}"
                )
    return problems


def velocity_warnings(
    columns: Sequence[JointColumn], t: FloatArray, velocity: FloatArray
) -> list[str]:
    """Return one line per joint that is faster than its limit."""
    warnings = []
    for column in columns:
        speed = np.abs(velocity[:, column.index_v])
        beyond = np.flatnonzero(speed > column.velocity_limit + LIMIT_TOLERANCE)
        if beyond.size:
            warnings.append(
                f"joint {column.name}: reaches {speed.max():.6g} {column.unit}/s, above its "
                f"velocity limit {column.velocity_limit:.6g} (first at t = "
                f"{t[beyond[0]]:.6g} s; samples beyond it: {beyond.size}){column.why}"
            )
    return warnings


def configurations(columns: Sequence[JointColumn], position: FloatArray, nq: int) -> FloatArray:
    """Return Pinocchio's q (T, nq) from one number per joint: cos, sin where continuous."""
    q = np.zeros((position.shape[0], nq))
    if free := [index for index, column in enumerate(columns) if column.free]:
        q[:, :7] = base_configuration(position[:, free])
    for index, column in enumerate(columns):
        if column.free:
            continue
        q[:, column.index_q] = position[:, index]
        if column.nq == 2:
            q[:, column.index_q] = np.cos(position[:, index])
            q[:, column.index_q + 1] = np.sin(position[:, index])
    return q


def rates(
    columns: Sequence[JointColumn], position: FloatArray, v: FloatArray, a: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return Pinocchio's v, a (T, nv) from the derivatives of one number per joint."""
    free = [index for index, column in enumerate(columns) if column.free]
    if not free:
        return v, a
    v, a = v.copy(), a.copy()
    v[:, free], a[:, free] = base_motion(position[:, free], v[:, free], a[:, free])
    return v, a


def single_positions(q: FloatArray, joint_nq: Sequence[int]) -> FloatArray:
    """Return one number per joint (T, nj) from Pinocchio's q: cos, sin become an unwrapped angle.

    `joint_nq`: (nj,) entries of q per joint, 1 or 2, in order.
    """
    position = np.empty((q.shape[0], len(joint_nq)))
    starts = np.concatenate(([0], np.cumsum(joint_nq, dtype=np.int64)))
    for index, (start, nq) in enumerate(zip(starts, joint_nq, strict=False)):
        position[:, index] = q[:, start]
        if nq == 2:
            position[:, index] = unwrapped_angle(q[:, start], q[:, start + 1])
    return position


def unit_circle_problems(columns: Sequence[JointColumn], q: FloatArray) -> list[str]:
    """Return one line per continuous joint whose entries of q are no cosine and sine."""
    problems = []
    for column in columns:
        if column.nq == 2:
            length = np.linalg.norm(q[:, column.index_q : column.index_q + 2], axis=1)
            wrong = np.flatnonzero(np.abs(length - 1.0) > LIMIT_TOLERANCE)
            if wrong.size:
                problems.append(
                    f"joint {column.name}: q[{column.index_q}:{column.index_q + 2}] is "
                    f"(cos, sin) of its angle, but not at samples {listing(wrong)}"
                )
    return problems


def refuse(source: str, problems: Sequence[str]) -> None:
    """Raise a TrajectoryError with all problems in one message, if any."""
    if problems:
        raise TrajectoryError(problems_line(source, problems))


def listing(items: Iterable[object], limit: int = 10) -> str:
    """Return the items separated by commas, at most `limit`, and how many there are."""
    texts = [str(item) for item in items]
    shown = ", ".join(texts[:limit])
    return shown if len(texts) <= limit else f"{shown}, ... ({len(texts)} in all)"
