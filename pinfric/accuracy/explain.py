"""Measured cost and change of each effect of a scene."""

from __future__ import annotations

import numpy as np

from pinfric.accuracy.timing import TimedMotion, saved
from pinfric.accuracy.variants import (
    Efforts,
    effort_change,
    effort_changes,
    hardly_rubbing,
    one_pass,
    solve,
)
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.random_states import random_states
from pinfric.elastic.matters import ElasticEffect, elastic_effect
from pinfric.model.brief import screen
from pinfric.model.described import EFFORT, described, quantity
from pinfric.model.effects import MOTOR_SIDE, Effect, effects, uncoupled, with_effects
from pinfric.model.scene import Scene
from pinfric.model.upward import Shown
from pinfric.motions.summary import ends_by_magnitude, known_rms, unit_of_drive
from pinfric.motions.trajectory import Trajectory

_ROUNDS = 9
#: Samples a timing takes at least; a short motion is repeated to that length.
_TIMED = 4000
#: What is timed beside the scene without one effect: the scene, and it without any.
_ALL, _PLAIN = "", "plain"
_NAN = float("nan")


@described
class Explained:
    """One effect of a scene, with its cost and change on one motion."""

    name: str = quantity("the effect", heading="effect")
    on: bool = quantity("whether the scene has the effect", heading="on")
    why: str = quantity("the keys that switch it on", heading="why")
    cost_us: float = quantity(
        "computing time per sample saved by leaving the effect out, microseconds; for coupling, "
        "the passes after the first; NaN if it is off, and for loops, which cannot be left out",
        "us",
        "cost",
        "{cost}",
    )
    resolution_us: float = quantity("smallest cost that the timing can resolve, microseconds", "us")
    unit: str = quantity('unit of the changes, "N m" or "N"; empty: drives differ', heading="unit")
    peak_change: float = quantity(
        "change of the peak effort through the effect, of the drive where it is largest; for "
        "coupling: against one pass with the loads without friction",
        EFFORT,
        "peak\nchange",
        "{peak_change:+}",
    )
    rms_change: float = quantity("the same for the RMS", EFFORT, "RMS\nchange", "{rms_change:+}")
    drive: str = quantity("that drive; empty if the effect is off", heading="of", name=True)
    motor_side: bool = quantity(
        "the change is of motor torques (a transmission changes nothing at the joint)",
        heading="motor\nside",
    )

    @property
    def cost(self) -> str:
        """The cost as tables show it; below what the clock resolves it is said as that."""
        if self.cost_us != self.cost_us:
            return ""
        least = max(self.resolution_us, 0.01)
        return f"<{least:.2f}" if self.cost_us < least else f"{self.cost_us:.2f}"


@described
class GearLoss:
    """Load-dependent loss of a gear, as torque at its motor."""

    drive: str = quantity("its name", heading="joint", name=True)
    peak_change: float = quantity(
        "change of the motor's peak torque through that loss",
        "N m",
        "peak\nchange",
        "{peak_change:+}",
    )
    rms_change: float = quantity("the same for the RMS", "N m", "RMS\nchange", "{rms_change:+}")
    rms: float = quantity("RMS motor torque with the loss", "N m", "RMS")


@described
class Explanation(Shown):
    """All effects of a scene, and their total cost."""

    def __repr__(self) -> str:
        on = [effect.name for effect in self.effects if effect.on]
        cost = f"{self.total_us:.2f} us per sample, {self.plain_us:.2f} us without any effect"
        return screen("Explanation", cost, {"on": ", ".join(on), "more": ".effects .summary()"})

    effects: tuple[Explained, ...] = quantity("one row each")
    gears: tuple[GearLoss, ...] = quantity("gears whose loss grows with their load")
    total_us: float = quantity("inverse dynamics per sample, one thread, microseconds")
    plain_us: float = quantity("the same motion without any effect")
    samples: int = quantity("of the motion")
    elastic: ElasticEffect | None = quantity(
        "what elastic gears change; none: no gear has a stiffness", default=None
    )


def explain(scene: Scene, trajectory: Trajectory | None = None) -> Explanation:
    """Measure the cost per sample of each effect of a scene, and its change of the efforts.

    Args:
        scene: the robot.
        trajectory: the motion; None is a seeded random one inside the limits.
    """
    motion = _motion(scene, trajectory)
    whole = motion.solve(scene)
    found = effects(scene)
    variants = {e.name: _without(scene, e) for e in found if e.on and e.name != "loops"}
    timed = {**variants, _ALL: scene, _PLAIN: with_effects(scene, only=[])}
    times = motion.times(timed, _ROUNDS)
    rows = []
    for effect in found:
        if effect.name not in variants:
            figures = (_NAN, _NAN, "", _NAN, _NAN, "", False)
            rows.append(Explained(effect.name, effect.on, effect.why, *figures))
            continue
        motor_side = effect.name in MOTOR_SIDE
        if effect.name == "coupling":
            assert trajectory is not None  # where something couples there is one
            change = _coupling_change(scene, trajectory)
        else:
            without = Efforts.of(motion.solve(variants[effect.name]))
            change = effort_change(scene, Efforts.of(whole), without, motor_side)
        cost, resolved = saved(times[_ALL], times[effect.name])
        unit = unit_of_drive(scene, change[2], motor_side)
        row = Explained(effect.name, True, effect.why, cost, resolved, unit, *change, motor_side)
        rows.append(row)
    return Explanation(
        effects=tuple(rows),
        gears=_gear_losses(scene, motion, whole),
        total_us=float(np.median(times[_ALL])),
        plain_us=float(np.median(times[_PLAIN])),
        samples=len(motion.states[0]),
        elastic=elastic_effect(whole),
    )


def _gear_losses(scene: Scene, motion: TimedMotion, whole: InverseResult) -> tuple[GearLoss, ...]:
    """By drive, for gears do not act on each other: one scene without all their losses."""
    unloaded = with_effects(scene, without=["gear"])
    here, below = Efforts.of(whole), Efforts.of(motion.solve(unloaded))
    peaks, rms = effort_changes(here, below, motor=True)
    worst, _ = ends_by_magnitude(here.motor_lower, here.motor_upper)
    lossy = [
        drive.transmission != ideal.transmission
        for drive, ideal in zip(scene.drives, unloaded.drives, strict=True)
    ]
    size = known_rms(here.t, worst)
    return tuple(
        GearLoss(drive.name, float(peaks[d]), float(rms[d]), float(size[d]))
        for d, drive in enumerate(scene.drives)
        if lossy[d]
    )


def _without(scene: Scene, effect: Effect) -> Scene:
    """The scene without an effect; without coupling: loads as if there were no friction."""
    if effect.name == "coupling":
        return hardly_rubbing(scene)
    if effect.name == "couples":
        return uncoupled(scene)
    return with_effects(scene, without=[effect.name])


def _coupling_change(scene: Scene, trajectory: Trajectory) -> tuple[float, float, str]:
    """What solving for the loads changes, friction of the loads alone."""
    loads = with_effects(scene, only=["payload", "load", "bending"])
    coupled = Efforts.of(solve(loads, trajectory))
    return effort_change(scene, coupled, one_pass(loads, trajectory), motor=False)


def _motion(scene: Scene, trajectory: Trajectory | None) -> TimedMotion:
    payloads = tuple(scene.payloads)
    if trajectory is None:
        motion = TimedMotion(random_states(scene), None, None, payloads)
    else:
        states = trajectory.q, trajectory.v, trajectory.a
        motion = TimedMotion(states, trajectory.t, trajectory.attached, payloads)
    return motion.repeated(scene, _TIMED)
