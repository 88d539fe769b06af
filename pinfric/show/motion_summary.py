"""Summary of a simulated motion, as `pinfric simulate` prints and writes it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinfric.dynamics.inverse.result import StickInterval
from pinfric.dynamics.samples.closure import working_rates
from pinfric.dynamics.simulation.motion import INTERRUPTED, Event, Motion
from pinfric.model.described import EFFORT, PLACE, SPEED, described, gathered, quantity
from pinfric.motions.summary import rms


@described
class DriveWork:
    """What one drive did in a motion."""

    name: str = quantity("the drive's", heading="drive", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    peak: float = quantity("largest effort", EFFORT, "peak")
    rms: float = quantity("RMS over time", EFFORT, "RMS")
    work: float = quantity("work of its effort", "J", "work")
    heat: float = quantity("friction heat of its joint; NaN: no friction", "J", "heat")
    gear_heat: float = quantity("heat of its gear and motor; NaN: efforts given", "J", "of gear")
    stick_time: float = quantity("time its joint sticks; NaN: no friction", "s", "sticks")


@described
class EnergySummary:
    """Where the energy went: work = change + sum of losses + residual."""

    work: float = quantity("work of the drives' efforts, or of the motor torques if given", "J")
    change: float = quantity("change of kinetic and potential energy", "J")
    friction_loss: Mapping[str, float] = quantity("heat at each joint with friction", "J")
    gear_loss: Mapping[str, float] = quantity("heat in each gear and its motor", "J")
    residual: float = quantity("energy error of the integration", "J")


@described
class State:
    """A state of the robot."""

    q: np.ndarray = quantity("(nq,) configuration", PLACE)
    v: np.ndarray = quantity("(nv,) velocities", SPEED)


@described
class MotionSummary:
    """What a simulated motion comes to."""

    method: str = quantity("`event`, `timestepping` or `regularized`")
    given: str = quantity('input of the drives: "effort" or "motor_torque"')
    status: str = quantity("`finished`, `interrupted` or `failed`")
    message: str = quantity("why it ended")
    t_end: float = quantity("its last time", "s")
    samples: int = quantity("number of samples")
    evaluations: int = quantity("right-hand sides computed")
    stick_intervals: tuple[StickInterval, ...] = quantity("in the order of the joints")
    events: tuple[Event, ...] = quantity("in the order of time")
    unproved: tuple[float, ...] = quantity(
        "from when on the modes are one answer of which others may exist", "s"
    )
    energy: EnergySummary | None = quantity("none: the motion was interrupted")
    end: State = quantity("final state")


def motion_summary(motion: Motion) -> MotionSummary:
    """Return the summary of a motion.

    An interrupted motion has no energy: integrating it may take as long as the simulation.
    """
    energy = None
    if motion.status != INTERRUPTED:
        flows = motion.energy()
        energy = gathered(
            EnergySummary,
            flows,
            friction_loss=dict(zip(motion.site_names, flows.friction_loss.tolist(), strict=True)),
            gear_loss=dict(zip(motion.actuator_names, flows.gear_loss.tolist(), strict=True)),
        )
    return gathered(
        MotionSummary,
        motion,
        t_end=float(motion.t[-1]),
        samples=len(motion.t),
        stick_intervals=motion.stick_intervals(),
        energy=energy,
        end=State(motion.q[-1], motion.v[-1]),
    )


def drive_work(motion: Motion) -> list[DriveWork]:
    """Return the work, heat and stick time of each drive."""
    scene, t = motion.scene, motion.t
    rates, _ = working_rates(scene, motion.q, motion.v)
    energy = motion.energy()
    heat = dict(zip(motion.site_names, energy.friction_loss.tolist(), strict=True))
    gears = motion.motor_torque is not None
    stick_time: dict[str, float] = dict.fromkeys(motion.site_names, 0.0)
    for interval in motion.stick_intervals():
        stick_time[interval.site] += interval.duration
    return [
        DriveWork(
            name=drive.name,
            unit=scene.drives[i].unit,
            peak=float(np.abs(motion.effort[:, i]).max()),
            rms=rms(t, motion.effort[:, i]),
            work=float(np.trapezoid(motion.effort[:, i] * rates[:, i], t)),
            heat=heat.get(drive.name, np.nan),
            gear_heat=float(energy.gear_loss[i]) if gears else np.nan,
            stick_time=stick_time.get(drive.name, np.nan),
        )
        for i, drive in enumerate(scene.drives)
    ]
