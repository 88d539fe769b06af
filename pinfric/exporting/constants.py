"""Constants in place of a scene's friction, fitted along a motion, with their errors.

Other engines have one dry friction, one damping and one rotor inertia per joint. A joint that never
moves in the motion is fitted over random states, with its rotor's armature r^2 J.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.random_states import random_states
from pinfric.errors import PinfricError
from pinfric.model.described import EFFORT, INERTIA, SPEED, described, effort_where, quantity
from pinfric.motions.joint_columns import JointColumn
from pinfric.motions.log.judged import measured_interval

#: The constants, in the order of the columns sign(v), v, a.
TERMS = ("frictionloss", "damping", "armature")


@described
class JointConstants:
    """The constants of one joint, and their errors.

    Torques are the motor's times the ratio: N m, or N of a sliding joint.
    """

    joint: str = quantity("its name", heading="joint", name=True)
    unit: str = quantity('unit of its efforts, "N m" or "N"', heading="unit")
    ratio: float = quantity("motor turns per turn of the joint", "rad/rad or rad/m")
    frictionloss: float = quantity("dry friction in motion", EFFORT, "frictionloss")
    damping: float = quantity("friction per speed", "N m s/rad or N s/m", "damping")
    armature: float = quantity(
        "rotor inertia at the joint beyond the model's own", INERTIA, "armature"
    )
    moving: int = quantity("samples used for the fit, in which the joint moves")
    unmoved: bool = quantity(
        "whether the joint never moves in the motion: its constants are of random states, and its "
        "armature is ratio^2 times the rotor inertia"
    )
    fitted_rms: float = quantity(
        "RMS error with a fitted armature in place of the known one; NaN where it is fitted", EFFORT
    )
    apart: bool = quantity("whether the motion determines each constant")
    error_rms: float = quantity(
        "RMS difference between the torque of the constants and the scene's", EFFORT, "error\nRMS"
    )
    error_peak: float = quantity("the largest", EFFORT, "error\npeak")
    torque_rms: float = quantity("RMS of the scene's torque", EFFORT)
    torque_peak: float = quantity("peak of the scene's torque", EFFORT, "torque\npeak")
    loads: tuple[float, float] = quantity(
        "least and greatest torque of the frictionless robot in the samples of the fit", EFFORT
    )
    speeds: tuple[float, float] = quantity("least and greatest velocity in them", SPEED)
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

        r T_m - tau_id = frictionloss sign(v) + damping v + armature a,     all three >= 0

    Args:
        result: inverse dynamics of the scene along the motion.
        columns: its joints, one degree of freedom each.
        terms: those of `TERMS` that the format has; the others are 0, which adds to the error.

    Raises:
        PinfricError: a joint with no drive or several: no torque shows its friction.

    Source: Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23.
    """
    scene, constants = result.scene, []
    along, anywhere = Sampled.of(result), None
    for column in columns:
        drives = [d for d, x in enumerate(scene.drives) if x.velocity_index == column.index_v]
        if len(drives) != 1:
            raise PinfricError(
                f"{scene.source}: joint {column.name!r} has {len(drives)} drives; constants need "
                "exactly one: name one under `actuators`, or lock the joint"
            )
        d, still = drives[0], along
        if unmoved := not along.moving(drives[0]).any():
            anywhere = anywhere or Sampled.of(inverse_dynamics(scene, *random_states(scene)))
            still = anywhere
        constants.append(_constants(still, d, column, terms, unmoved, along.at_rest(d)))
    return tuple(constants)


class Sampled(NamedTuple):
    """Inverse dynamics of samples, with the motors' torques at the joints."""

    result: InverseResult
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, result: InverseResult) -> Sampled:
        """Of a result with its drives."""
        return cls(result, *measured_interval(result, "reflected"))

    def slow(self, d: int) -> np.ndarray:
        """(T,) bool: whether a drive sticks at its velocity."""
        limit = self.result.scene.stick_velocity_of(self.result.scene.drives[d])
        return np.abs(self.result.actuator_velocity[:, d]) <= limit

    def moving(self, d: int) -> np.ndarray:
        """(T,) bool: faster than the stick velocity, and without a reversal beside the sample."""
        return ~self.slow(d) & (self.lower[:, d] == self.upper[:, d])

    def at_rest(self, d: int) -> dict[str, float]:
        """Torques at rest less the frictionless ones."""
        resting = self.slow(d) & (self.result.actuator_acceleration[:, d] == 0.0)
        load = self.result.effort_frictionless[:, d]
        return {
            "rest_lower": float((self.lower[:, d] - load)[resting].min())
            if resting.any()
            else np.nan,
            "rest_upper": float((self.upper[:, d] - load)[resting].max())
            if resting.any()
            else np.nan,
        }


def _constants(
    samples: Sampled,
    d: int,
    column: JointColumn,
    terms: tuple[str, ...],
    unmoved: bool,
    at_rest: dict[str, float],
) -> JointConstants:
    result, lower, moving = samples.result, samples.lower[:, d], samples.moving(d)
    drive, load = result.scene.drives[d], result.effort_frictionless[:, d]
    velocity, acceleration = result.actuator_velocity[:, d], result.actuator_acceleration[:, d]
    there = np.array([float(term in terms) for term in TERMS])
    regressors = np.column_stack([np.sign(velocity), velocity, acceleration])[moving] * there
    gear = drive.transmission  # r^2 J, the rotor's inertia at the joint
    rotor = 0.0 if gear is None else gear.ratio**2 * gear.rotor_inertia
    known = np.array([0.0, 0.0, rotor * there[2] if unmoved else 0.0])
    free = there * [1.0, 1.0, 0.0 if unmoved else 1.0]
    target = (lower - load)[moving]
    constants, apart = _fit(regressors * free, target - regressors @ known)
    constants += known
    missed = target - regressors @ constants
    better = target - regressors @ _fit(regressors, target)[0]
    worst = np.flatnonzero(moving)[np.abs(missed).argmax()] if moving.any() else None
    no = 0.0 if moving.any() else np.nan
    return JointConstants(
        joint=column.name,
        unit=effort_where(column.unit == "m"),
        ratio=drive.ratio,
        **dict(zip(TERMS, constants.tolist(), strict=True)),
        moving=int(moving.sum()),
        unmoved=unmoved,
        fitted_rms=_rms(better) if unmoved else np.nan,
        apart=apart,
        error_rms=_rms(missed),
        error_peak=float(np.abs(missed).max(initial=no)),
        torque_rms=_rms(lower[moving]),
        torque_peak=float(np.abs(lower[moving]).max(initial=no)),
        loads=_range(load[moving]),
        speeds=_range(velocity[moving]),
        worst_load=_at(load, worst),
        worst_speed=_at(velocity, worst),
        worst_time=_at(result.t, worst),
        **at_rest,
    )


def _fit(regressors: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, bool]:
    """Constants >= 0 by least squares, and whether the samples determine each."""
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


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else np.nan


def _range(values: np.ndarray) -> tuple[float, float]:
    return (float(values.min()), float(values.max())) if values.size else (np.nan, np.nan)


def _at(values: np.ndarray | None, sample: int | None) -> float:
    return np.nan if values is None or sample is None else float(values[sample])
