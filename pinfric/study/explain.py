"""What each effect of a scene costs and changes: measured, effect by effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.model.described import EFFORT, described, quantity
from pinfric.model.effects import MOTOR_SIDE, Effect, effects, uncoupled, with_effects
from pinfric.model.scene import Scene
from pinfric.study.elastic.matters import ElasticEffect, elastic_effect
from pinfric.study.random_states import random_states
from pinfric.study.summary import ends_by_magnitude, known_rms
from pinfric.study.timing import interleaved, repeated_times, timed_repeats
from pinfric.study.trajectory.trajectory import Trajectory
from pinfric.study.variants import (
    Efforts,
    effort_change,
    effort_changes,
    hardly_rubbing,
    one_pass,
    solve,
)

_ROUNDS = 9
#: Samples a timing takes at least; a short motion is repeated to that length, unless that takes
#: longer than so many seconds. A motion that takes longer by itself is timed once.
_TIMED, _PATIENCE = 4000, 0.2
_NAN = float("nan")


@described
class Explained:
    """One effect of a scene, with what it costs and changes on one motion."""

    name: str = quantity("the effect", heading="effect")
    on: bool = quantity("whether the scene calls for it")
    why: str = quantity("the keys that call for it")
    cost_us: float = quantity(
        "what leaving the effect out saves per sample, microseconds; of coupling, the passes after "
        "the first; NaN where it is off, and of loops, which cannot be left out",
        heading="cost\nus",
        cell="{cost_us:.2f}",
    )
    peak_change: float = quantity(
        "change of the largest effort magnitude of any drive through the effect, of the drive "
        "where the change is largest; of coupling: against one pass, loads without friction",
        EFFORT,
        "peak\nchange",
        "{peak_change:+}",
    )
    rms_change: float = quantity("the same of the RMS", EFFORT, "RMS\nchange", "{rms_change:+}")
    drive: str = quantity("that drive; empty where the effect is off", heading="of", name=True)
    motor_side: bool = quantity(
        "the change is of motor torques (a transmission changes nothing at the joint)",
        heading="motor\nside",
    )


@described
class GearLoss:
    """What a gear loses in proportion to its load, as its motor feels it."""

    drive: str = quantity("its name", heading="joint", name=True)
    peak_change: float = quantity(
        "of the motor's torque through that loss", "N m", "peak\nchange", "{peak_change:+}"
    )
    rms_change: float = quantity("the same of the RMS", "N m", "RMS\nchange", "{rms_change:+}")
    rms: float = quantity("of the motor's torque with it", "N m", "RMS")


@described
class Explanation:
    """All effects of a scene, and what the whole costs."""

    effects: tuple[Explained, ...] = quantity("one row each")
    gears: tuple[GearLoss, ...] = quantity("each gear whose loss grows with its load")
    total_us: float = quantity("inverse dynamics per sample, one thread, microseconds")
    plain_us: float = quantity("the same motion without any effect")
    samples: int = quantity("of the motion")
    elastic: ElasticEffect | None = quantity(
        "whether elastic gears matter; none: there are none", default=None
    )


def explain(scene: Scene, trajectory: Trajectory | None = None) -> Explanation:
    """Measure what each effect of a scene costs per sample and changes in the efforts.

    Args:
        scene: the robot.
        trajectory: the motion; None is a seeded random one inside the limits.
    """
    motion = _Motion.of(scene, trajectory)
    whole = motion.solve(scene)
    found = effects(scene)
    variants = {e.name: _without(scene, e) for e in found if e.on and e.name != "loops"}
    timed = {name: motion.timed(variant) for name, variant in variants.items()}
    timed |= {"": motion.timed(scene), "plain": motion.timed(with_effects(scene, only=[]))}
    for run in timed.values() if motion.repeats else ():
        run()
    seconds = interleaved(timed, _ROUNDS if motion.repeats else 1)
    each = 1e6 / motion.timed_samples
    rows = []
    for effect in found:
        if effect.name not in variants:
            rows.append(Explained(effect.name, effect.on, effect.why, _NAN, _NAN, _NAN, "", False))
            continue
        motor_side = effect.name in MOTOR_SIDE
        if effect.name == "coupling":
            assert trajectory is not None  # where something couples there is one
            change = _coupling_change(scene, trajectory)
        else:
            without = Efforts.of(motion.solve(variants[effect.name]))
            change = effort_change(scene, Efforts.of(whole), without, motor_side)
        cost = each * (seconds[""] - seconds[effect.name])
        rows.append(Explained(effect.name, True, effect.why, cost, *change, motor_side))
    return Explanation(
        tuple(rows), _gear_losses(scene, motion, whole),
        seconds[""] * each, seconds["plain"] * each, len(motion.trajectory[0]),
        elastic_effect(whole),
    )  # fmt: skip


def _gear_losses(scene: Scene, motion: _Motion, whole: InverseResult) -> tuple[GearLoss, ...]:
    """By drive, for gears do not act on each other: one scene without all their losses."""
    unloaded = with_effects(scene, without=["gear"])
    here, below = Efforts.of(whole), Efforts.of(motion.solve(unloaded))
    peaks, rms = effort_changes(here, below, motor=True)
    worst, _ = ends_by_magnitude(here.motor_lower, here.motor_upper)
    lossy = [drive.transmission != ideal.transmission
             for drive, ideal in zip(scene.drives, unloaded.drives, strict=True)]  # fmt: skip
    size = known_rms(here.t, worst)
    return tuple(
        GearLoss(drive.name, float(peaks[d]), float(rms[d]), float(size[d]))
        for d, drive in enumerate(scene.drives) if lossy[d]
    )  # fmt: skip


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


@dataclass(frozen=True)
class _Motion:
    """Arrays to solve and to time; payload columns go with the scenes that have the payloads.

    `t` is None where they are states without order; `repeats` is 0 where the motion takes so long
    that it is timed once.
    """

    trajectory: tuple[np.ndarray, np.ndarray, np.ndarray]
    t: np.ndarray | None
    attached: np.ndarray | None
    payloads: tuple[str, ...]
    repeats: int

    @classmethod
    def of(cls, scene: Scene, trajectory: Trajectory | None) -> _Motion:
        if trajectory is None:
            qva: tuple[np.ndarray, np.ndarray, np.ndarray] = random_states(scene)
            t, attached = None, None
        else:
            qva = trajectory.q, trajectory.v, trajectory.a
            t, attached = trajectory.t, trajectory.attached
        first = cls(qva, t, attached, tuple(scene.payloads), 0)
        repeats = timed_repeats(lambda: first.solve(scene), len(qva[0]), _TIMED, _PATIENCE)
        return replace(first, repeats=repeats)

    @property
    def timed_samples(self) -> int:
        return max(self.repeats, 1) * len(self.trajectory[0])

    def solve(self, scene: Scene) -> InverseResult:
        attached = self.attached if tuple(scene.payloads) == self.payloads else None
        return inverse_dynamics(scene, *self.trajectory, t=self.t, attached=attached, threads=1)

    def timed(self, scene: Scene) -> Callable[[], object]:
        attached = self.attached if tuple(scene.payloads) == self.payloads else None
        n = max(self.repeats, 1)
        q, v, a = (np.tile(x, (n, 1)) for x in self.trajectory)
        t = None if self.t is None else repeated_times(self.t, n)
        phases = None if attached is None else np.tile(attached, (n, 1))
        return lambda: inverse_dynamics(scene, q, v, a, t=t, attached=phases, threads=1)
