"""Constants in place of a scene's friction: fitted along a motion, each with the error it makes.

Other engines have one dry friction, one damping and one rotor inertia for a joint. What a motor
gives beyond the frictionless robot, r T_m - tau_id, is fitted by them where the joint moves:

    r T_m - tau_id = frictionloss sign(v) + damping v + armature a,     all three >= 0
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.motor_torques import drive_stick_velocity
from pinfric.errors import PinfricError
from pinfric.model.described import EFFORT, INERTIA, SPEED, described, effort_where, quantity
from pinfric.study.trajectory.joint_columns import JointColumn
from pinfric.study.trajectory.log.judged import measured_interval

#: The constants, in the order of the columns sign(v), v, a.
TERMS = ("frictionloss", "damping", "armature")


@described
class JointConstants:
    """The constants of one joint, and their errors.

    Torques are those of the motor times the ratio: N m, or N of a sliding joint.
    """

    joint: str = quantity("its name", heading="joint", name=True)
    unit: str = quantity('unit of its efforts, "N m" or "N"', heading="unit")
    ratio: float = quantity("motor turns per turn of the joint", "rad/rad or rad/m")
    frictionloss: float = quantity("dry friction in motion", EFFORT, "frictionloss")
    damping: float = quantity("friction per speed", "N m s/rad or N s/m", "damping")
    armature: float = quantity(
        "rotor inertia at the joint beyond the model's own", INERTIA, "armature"
    )
    moving: int = quantity("samples used for the fit; 0: the joint never moves, no constants")
    apart: bool = quantity("whether the motion determines each constant")
    error_rms: float = quantity(
        "RMS difference between the torque of the constants and the scene's", EFFORT, "error\nRMS"
    )
    error_peak: float = quantity("the largest", EFFORT, "error\npeak")
    torque_rms: float = quantity("RMS of the scene's torque", EFFORT)
    torque_peak: float = quantity("peak of the scene's torque", EFFORT, "torque\npeak")
    worst_load: float = quantity(
        "torque of the frictionless robot where the error is largest", EFFORT, "worst\nat load"
    )
    worst_speed: float = quantity("velocity there", SPEED)
    worst_time: float = quantity("time of the largest error; NaN for states without times", "s")
    rest_lower: float = quantity(
        "smallest torque at rest (v = a = 0), less the frictionless torque; NaN if the joint never "
        "rests",
        EFFORT,
        "standing\nstill",
        "{rest_lower} to {rest_upper}",
    )
    rest_upper: float = quantity("the greatest", EFFORT)


def joint_constants(
    result: InverseResult, columns: tuple[JointColumn, ...], terms: tuple[str, ...] = TERMS
) -> tuple[JointConstants, ...]:
    """Return the constants of every joint: bounded least squares over the samples where it moves.

    min sum (r T_m - tau_id - X c)^2 over c >= 0, X = [sign(v), v, a] (Lawson and Hanson, Solving
    Least Squares Problems, 1974, ch. 23).

    Args:
        result: inverse dynamics of the scene along the motion.
        columns: its joints, one degree of freedom each.
        terms: those of `TERMS` that the format has; the others are 0, and their lack an error.

    Raises:
        PinfricError: a joint with no drive or several: no torque says what its friction takes.
    """
    scene, found = result.scene, []
    torque = measured_interval(result, "reflected")
    for column in columns:
        drives = [d for d, x in enumerate(scene.drives) if x.velocity_index == column.index_v]
        if len(drives) != 1:
            raise PinfricError(
                f"{scene.source}: joint {column.name!r} has {len(drives)} drives; constants need "
                "exactly one: name one under `actuators`, or lock the joint"
            )
        found.append(_constants(result, drives[0], column, torque, terms))
    return tuple(found)


def _constants(
    result: InverseResult,
    d: int,
    column: JointColumn,
    torque: tuple[np.ndarray, np.ndarray],
    terms: tuple[str, ...],
) -> JointConstants:
    drive = result.scene.drives[d]
    lower, upper = (end[:, d] for end in torque)
    load = result.effort_frictionless[:, d]
    velocity, acceleration = result.actuator_velocity[:, d], result.actuator_acceleration[:, d]
    slow = np.abs(velocity) <= drive_stick_velocity(result.scene, drive)
    moving = ~slow & (lower == upper)  # an interval: it passes through rest beside this sample
    rest = slow & (acceleration == 0.0)
    there = [float(term in terms) for term in TERMS]
    regressors = np.column_stack([np.sign(velocity), velocity, acceleration])[moving] * there
    constants, apart = _fit(regressors, (lower - load)[moving])
    missed = (lower - load)[moving] - regressors @ constants
    worst = np.flatnonzero(moving)[np.abs(missed).argmax()] if moving.any() else None
    return JointConstants(
        joint=column.name,
        unit=effort_where(column.unit == "m"),
        ratio=drive.ratio,
        **dict(zip(TERMS, constants.tolist(), strict=True)),
        moving=int(moving.sum()),
        apart=apart,
        **_figures(missed, lower[moving]),
        worst_load=_at(load, worst),
        worst_speed=_at(velocity, worst),
        worst_time=_at(result.t, worst),
        rest_lower=float((lower - load)[rest].min()) if rest.any() else np.nan,
        rest_upper=float((upper - load)[rest].max()) if rest.any() else np.nan,
    )


def _fit(regressors: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, bool]:
    """Constants >= 0 of least squares, and whether the samples tell them apart."""
    size = np.linalg.norm(regressors, axis=0)
    used = size > 0.0
    if not used.any():
        return np.zeros(len(size)), True
    scaled = regressors[:, used] / size[used]  # speeds and accelerations differ by decades
    constants = np.zeros(len(size))
    fitted = nnls(scaled, target)[0]
    fitted[fitted < 1e-12 * np.linalg.norm(target)] = 0.0  # rounding is no constant
    constants[used] = fitted / size[used]
    return constants, bool(np.linalg.matrix_rank(scaled, tol=1e-6) == used.sum())


def _figures(missed: np.ndarray, torque: np.ndarray) -> dict[str, float]:
    if not missed.size:
        return dict.fromkeys(("error_rms", "error_peak", "torque_rms", "torque_peak"), np.nan)
    return {
        "error_rms": float(np.sqrt(np.mean(missed**2))),
        "error_peak": float(np.abs(missed).max()),
        "torque_rms": float(np.sqrt(np.mean(torque**2))),
        "torque_peak": float(np.abs(torque).max()),
    }


def _at(values: np.ndarray | None, sample: int | None) -> float:
    return np.nan if values is None or sample is None else float(values[sample])
