"""Demand of a cycle on each drive, from the effort intervals of inverse dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from pinfric.drives.bearing import (
    BearingLoad,
    GuideLoad,
    bearing_load,
    guide_load,
    joint_loads,
)
from pinfric.drives.duty import Schedule, once
from pinfric.drives.overload import longest_above
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.reversals import reversals
from pinfric.errors import StateError
from pinfric.kernels.compiled import kernel
from pinfric.model.coordinates import one_number
from pinfric.model.described import EFFORT, SPEED, between, described, quantity
from pinfric.model.scene import Scene
from pinfric.motions.summary import ends_by_magnitude, integral, rms


@described
class Power:
    """A power over time: mechanical at a joint, or electrical at a motor or a bus."""

    driving: float = quantity("largest driving power", "W", "peak power")
    braking: float = quantity("largest braking power", "W", "braking")
    delivered: float = quantity("driving energy over the cycle", "J", "energy")
    returned: float = quantity(
        "braking energy over the cycle: what a lossless drive could regenerate", "J", "returned"
    )


@described
class GearDemand:
    """Demand at the joint for the gear's criteria, worst case over the interval."""

    name: str = quantity("the drive's", heading="joint", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    peak: float = quantity("largest effort", EFFORT, "peak")
    speed: float = quantity("largest |v|", SPEED, "speed")
    mean_speed: float = quantity("mean |v|", SPEED)
    mean_cubic: float = quantity("cube root of the speed-weighted mean of |u|^3", EFFORT)
    bearing: BearingLoad | None = quantity(
        "loads of the joint's bearing, or of a sliding joint's screw; none: not known",
        heading="*",
    )
    travel: float | None = quantity(
        "of a sliding joint: max q - min q over the cycle; otherwise none", "m"
    )
    guide: GuideLoad | None = quantity(
        "loads of a sliding joint's guide; none: it turns, or not known", heading="*"
    )


@described
class JointDemand(GearDemand):
    """All that one drive must do, at its joint; magnitudes, worst case over the effort interval.

    `least` figures take the smallest magnitude in each sample's interval: friction at rest helps as
    much as it can. `frictionless` ones leave out all friction of the joints.
    """

    peak_time: float = quantity("time of the largest effort", "s")
    speed_at_peak: float = quantity("joint speed at that time", SPEED, "speed\nat the peak")
    rms: float = quantity(
        "root mean square over the cycle",
        EFFORT,
        "RMS\nleast\N{EN DASH}worst",
        between("rms_least", "rms"),
    )
    rms_least: float = quantity("the same for the smallest efforts", EFFORT)
    holding: tuple[float, float] | None = quantity(
        "(least, worst) largest effort over the holds (all joints of the robot at rest); none "
        "without a hold",
        EFFORT,
        "holding",
    )
    holding_frictionless: float | None = quantity("the same without friction", EFFORT)
    breakaway: float | None = quantity(
        "largest end of the effort interval while the joint is at rest or reverses, with load; "
        "none if it never rests",
        EFFORT,
        "break-\naway",
    )
    breakaway_friction: float | None = quantity(
        "the friction in it", EFFORT, "friction at\nbreak-away"
    )
    duty: float = quantity(
        "share of the time in which the joint moves", heading="moves", cell="{duty:%}"
    )
    hold_share: float = quantity(
        "part of the time spent in holds", heading="holds", cell="{hold_share:%}"
    )
    power: Power = quantity("at the joint", heading="*")
    power_frictionless: Power = quantity("at the joint, without friction")
    peak_frictionless: float = quantity(
        "of the effort without friction",
        EFFORT,
        "frictionless\npeak, RMS",
        "{peak_frictionless}, {rms_frictionless}",
    )
    rms_frictionless: float = quantity("of the effort without friction", EFFORT)


#: Fields of `DriveCycle` that are of all samples together, the last ones.
_OF_ALL = "stick_velocity", "duty"


@dataclass(frozen=True)
class DriveCycle:
    """One drive's samples over the cycle, as criteria take them.

    Attributes:
        t: (T,) s, each cycle of a duty once.
        effort_lower, effort_upper, effort_frictionless: (T,) at the joint, N m or N; 0 while
            switched off.
        velocity, acceleration: (T,) of the joint.
        at_rest: (T,) it stands still, or reverses beside the sample. holding: (T,) all joints do.
        stick_velocity: at or below this speed it stands still.
        duty: the cycles of a period; None: one cycle.
    """

    t: np.ndarray
    effort_lower: np.ndarray
    effort_upper: np.ndarray
    effort_frictionless: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    at_rest: np.ndarray
    holding: np.ndarray
    stick_velocity: float
    duty: Schedule | None = None

    @cached_property
    def schedule(self) -> Schedule:
        """Which samples are which cycle, and how often it is run."""
        return self.duty or once(len(self.t))

    @cached_property
    def stretched(self) -> np.ndarray:
        """(T,) time spent in a period, s: means over it are means over the period."""
        return self.schedule.stretched(self.t)

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """(T,) the effort's end of largest magnitude, and its number of smallest."""
        return ends_by_magnitude(self.effort_lower, self.effort_upper)

    @cached_property
    def powered(self) -> np.ndarray:
        """(T,) not switched off."""
        return self.schedule.powered(len(self.t))

    @cached_property
    def standing(self) -> np.ndarray:
        """(T,) this joint stands still, in two samples or more."""
        return drop_single_samples(np.abs(self.velocity) <= self.stick_velocity)

    def some(self, keep: np.ndarray, duty: Schedule | None) -> DriveCycle:
        """Return a part of the samples (T,), which are the cycles of a schedule."""
        arrays = {x.name: getattr(self, x.name)[keep] for x in fields(self)[: -len(_OF_ALL)]}
        return replace(self, **arrays, duty=duty)

    def longest_above(self, x: np.ndarray, limit: float, still: bool = False) -> float:
        """Return the longest time (s) in which |x| (T,) is above a limit (`overload`).

        Args:
            x: (T,) over the cycle. limit: of |x|. still: only while the joint stands still.
        """
        where = self.standing if still else np.ones(len(x), dtype=bool)
        return longest_above(self.t, x, limit, where, self.duty)


def drive_cycle(
    result: InverseResult, actuator: int, holding: np.ndarray, duty: Schedule | None = None
) -> DriveCycle:
    """Return one drive's samples of a result with times.

    Args:
        actuator: its column. holding: (T,) of `hold_samples`.
        duty: the cycles of a period; None: one cycle.

    Raises:
        StateError: the result has no times, or one sample.
    """
    if result.t is None or len(result.t) < 2:
        raise StateError("sizing needs a motion with times and at least two samples")
    stick = result.scene.stick_velocity_of(result.scene.drives[actuator])
    velocity = result.actuator_velocity[:, actuator]  # a cylinder's rate is no joint's
    turns = reversals(velocity[:, None], np.array([stick]))[:, 0]
    on = (duty or once(len(result.t))).powered(len(result.t))
    return DriveCycle(
        t=result.t,
        # products are copies: a view would keep the whole result
        effort_lower=result.effort_lower[:, actuator] * on,
        effort_upper=result.effort_upper[:, actuator] * on,
        effort_frictionless=result.effort_frictionless[:, actuator] * on,
        velocity=velocity,
        acceleration=result.actuator_acceleration[:, actuator],
        at_rest=(turns | (np.abs(velocity) <= stick)) & on,
        holding=holding & on,
        stick_velocity=stick,
        duty=duty,
    )


def hold_samples(scene: Scene, v: np.ndarray) -> np.ndarray:
    """Return (T,) where the robot holds: every joint stands still, in two samples or more.

    Args:
        scene: gives the stick velocities. v: (T, nv) rad/s or m/s.
    """
    limits = np.full(v.shape[1], scene.stick_velocity)
    for drive in scene.drives:
        if drive.velocity_index >= 0:  # a cylinder moves no column of its own
            limits[drive.velocity_index] = scene.stick_velocity_of(drive)
    return drop_single_samples((np.abs(v) <= limits).all(axis=1))


def drop_single_samples(still: np.ndarray) -> np.ndarray:
    """The mask (T,) without lone samples: a zero of the velocity at a reversal is no rest."""
    beside = np.zeros_like(still)
    beside[1:] |= still[:-1]
    beside[:-1] |= still[1:]
    return still & beside


def gear_demand(
    result: InverseResult,
    actuator: int,
    cycle: DriveCycle,
    carried: bool = True,
    wrench: np.ndarray | None = None,
) -> GearDemand:
    """Return the figures of one drive that criteria ask for (see `GearDemand`).

    Args:
        actuator: the drive's column. cycle: its samples.
        carried: whether to say what its bearing carries.
        wrench: (T, 6) that the joint transmits; None: as in the result.
    """
    t, speed, (worst, _) = cycle.stretched, np.abs(cycle.velocity), cycle.ends
    unit, bearing, guide = result.scene.drives[actuator].unit, None, None
    joint = driven_joint(result.scene, actuator)
    if carried and unit == "N":
        none = np.zeros_like(worst)  # of a screw's nut: the effort along it
        bearing = bearing_load(t, cycle.velocity, none, worst, none)
        guide = None if joint is None else guide_load(result, joint - 1, wrench)
    elif carried and joint is not None:
        across = joint_loads(result, joint - 1, wrench)
        bearing = None if across is None else bearing_load(t, cycle.velocity, *across)
    return GearDemand(
        name=result.scene.drives[actuator].name,
        unit=unit,
        peak=largest(worst),
        speed=float(speed.max()),
        mean_speed=mean(t, speed),
        mean_cubic=average_output_effort(t, worst, speed),
        bearing=bearing,
        travel=travel(result.scene, actuator, result.states.q),
        guide=guide,
    )


def joint_demand(result: InverseResult, actuator: int, cycle: DriveCycle) -> JointDemand:
    """Return all figures of one drive (see `JointDemand`); arguments as `gear_demand`."""
    t, v, (worst, least) = cycle.stretched, cycle.velocity, cycle.ends
    top = int(np.argmax(np.abs(worst)))
    still, hold = cycle.at_rest, cycle.holding
    bare = cycle.effort_frictionless
    friction = np.maximum(cycle.effort_upper - bare, bare - cycle.effort_lower)
    return JointDemand(
        **vars(gear_demand(result, actuator, cycle)),
        peak_time=float(cycle.t[top]),
        speed_at_peak=float(np.abs(v[top])),
        rms=rms(t, worst),
        rms_least=rms(t, least),
        holding=(largest(least[hold]), largest(worst[hold])) if hold.any() else None,
        holding_frictionless=largest(bare[hold]) if hold.any() else None,
        breakaway=largest(worst[still]) if still.any() else None,
        breakaway_friction=largest(friction[still]) if still.any() else None,
        duty=share(t, np.abs(v) > cycle.stick_velocity),
        hold_share=share(t, hold),
        power=_power(t, cycle.effort_lower * v, cycle.effort_upper * v),
        power_frictionless=_power(t, bare * v, bare * v),
        peak_frictionless=largest(bare),
        rms_frictionless=rms(t, bare),
    )


def hardest(demands: Sequence[JointDemand]) -> JointDemand:
    """Return the largest of each figure of several demands on one joint; the rest of the first."""

    def most(values: Sequence[Any]) -> Any:
        known = [x for x in values if x is not None]
        if not known or isinstance(known[0], str | BearingLoad | GuideLoad):
            return values[0]
        if isinstance(known[0], Power):
            return Power(*(max(x) for x in zip(*(vars(x).values() for x in known), strict=True)))
        if isinstance(known[0], tuple):
            return tuple(max(x) for x in zip(*known, strict=True))
        return max(known)

    names = (x.name for x in fields(demands[0]))
    return replace(demands[0], **{x: most([getattr(one, x) for one in demands]) for x in names})


def driven_joint(scene: Scene, actuator: int) -> int | None:
    """The model's index of a drive's joint; None for one direction of a joint with several."""
    moved, model = scene.drives[actuator].velocity_index, scene.model
    joints = list(zip(model.idx_vs.tolist(), model.nvs.tolist(), strict=True))
    return joints.index((moved, 1), 1) if (moved, 1) in joints[1:] else None


def travel(scene: Scene, actuator: int, q: np.ndarray) -> float | None:
    """Return max q - min q of a drive's sliding joint over a path (T, nq), m; None: it turns."""
    joint = driven_joint(scene, actuator)
    if joint is None or not scene.drives[actuator].slides:
        return None
    return float(np.ptp(one_number(scene.model.joints[joint], q)))


def average_output_effort(
    t: np.ndarray, effort: np.ndarray, velocity: np.ndarray, exponent: float = 3.0
) -> float:
    """Return T_av = (int |v T^p| dt / int |v| dt)^(1/p), which wears a gear: p = 3, strain wave.

    Args:
        t: (T,) s. effort, velocity: (T,) at the output; 0 where it never moves. exponent: p.

    Source: Harmonic Drive engineering data 1021387 12/2018, p. 30.
    """
    return float(average_effort(t, effort, np.ascontiguousarray(velocity), exponent))


@kernel
def average_effort(
    t: np.ndarray, effort: np.ndarray, velocity: np.ndarray, exponent: float
) -> float:
    """See `average_output_effort`."""
    wear, weight, wear_before, before = 0.0, 0.0, 0.0, 0.0
    for k in range(t.size):
        speed, worst = abs(velocity[k]), abs(effort[k])
        worn = worst * worst * worst if exponent == 3.0 else worst**exponent
        worn *= speed
        if k > 0:
            step = t[k] - t[k - 1]
            wear += step * (worn + wear_before)
            weight += step * (speed + before)
        wear_before, before = worn, speed
    if not weight > 0.0:
        return 0.0
    return np.cbrt(wear / weight) if exponent == 3.0 else (wear / weight) ** (1.0 / exponent)


def mean(t: np.ndarray, x: np.ndarray) -> float:
    """Return 1/T int x dt by the trapezoidal rule."""
    return integral(t, x) / float(t[-1] - t[0])


def largest(x: np.ndarray) -> float:
    """Return max |x|."""
    return float(np.abs(x).max())


def share(t: np.ndarray, mask: np.ndarray) -> float:
    """Return the part of the time in which a mask holds, by the trapezoidal rule."""
    return mean(t, mask.astype(float))


def power_figures(t: np.ndarray, power: np.ndarray) -> Power:
    """Return peaks and energies, int max(P, 0) dt and int max(-P, 0) dt, of a power over time.

    Args:
        t: (T,) s. power: (T,) W, linear between samples.
    """
    return Power(*_power_figures(t, power))


@kernel
def _power_figures(t: np.ndarray, power: np.ndarray) -> tuple[float, float, float, float]:
    """See `power_figures`."""
    most, least, delivered, returned = max(power[0], 0.0), min(power[0], 0.0), 0.0, 0.0
    for k in range(1, t.size):
        most, least = max(most, power[k]), min(least, power[k])
        step = t[k] - t[k - 1]
        high, low = max(power[k - 1], power[k]), min(power[k - 1], power[k])
        if high > 0.0 and low < 0.0:
            delivered += step * high * high / (2 * (high - low))
            returned += step * low * low / (2 * (high - low))
        elif high > 0.0:
            delivered += step * (high + low) / 2
        else:
            returned -= step * (high + low) / 2
    return most, -least, delivered, returned


def _power(t: np.ndarray, product: np.ndarray, other: np.ndarray) -> Power:
    most = power_figures(t, np.maximum(product, other))
    least = power_figures(t, np.minimum(product, other))
    return Power(most.driving, least.braking, most.delivered, least.returned)
