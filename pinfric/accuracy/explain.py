"""Measured cost and change of each effect of a scene."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.random_states import random_states
from pinfric.elastic.matters import ElasticEffect, elastic_effect
from pinfric.model.brief import screen
from pinfric.model.described import EFFORT, described, quantity
from pinfric.model.effects import MOTOR_SIDE, Effect, effects, uncoupled, with_effects
from pinfric.model.friction_terms import CoulombFriction, LoadFriction
from pinfric.model.scene import Scene
from pinfric.model.schema import Friction
from pinfric.model.upward import Shown
from pinfric.motions.summary import ends_by_magnitude, known_rms, unit_of_drive
from pinfric.motions.trajectory import Trajectory

_ROUNDS = 9
#: Samples a timing takes at least: a short motion is repeated to that length, within so many s.
_TIMED, _PATIENCE = 4000, 0.2
#: A coefficient so small that the load it reports is that without friction.
_HARDLY = 1e-9
#: What is timed beside the scene without one effect: the scene, and it without any.
_ALL, _PLAIN = "", "plain"
_NAN = float("nan")

_Key = TypeVar("_Key", bound=Hashable)


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
        """The cost as tables show it; where it is below what the clock resolves, "<" that."""
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

    `trajectory`: the motion; None is a seeded random one inside the limits.
    """
    payloads = tuple(scene.payloads)
    if trajectory is None:
        motion = _Motion(random_states(scene), None, None, payloads)
    else:
        states = trajectory.q, trajectory.v, trajectory.a
        on = getattr(trajectory, "external", {})
        motion = _Motion(states, trajectory.t, trajectory.attached, payloads, on)
    whole = motion.solve(scene)
    listed = effects(scene)
    variants = {e.name: _without(scene, e) for e in listed if e.on and e.name != "loops"}
    timed = {**variants, _ALL: scene, _PLAIN: with_effects(scene, only=[])}
    times = motion.times(timed, scene)
    rows = []
    for effect in listed:
        if effect.name not in variants:
            figures = (_NAN, _NAN, "", _NAN, _NAN, "", False)
            rows.append(Explained(effect.name, effect.on, effect.why, *figures))
            continue
        motor_side = effect.name in MOTOR_SIDE
        if effect.name == "coupling":
            # what solving for the loads changes, friction of the loads alone
            loads = with_effects(scene, only=["payload", "load", "bending"])
            coupled = Efforts.of(motion.solve(loads))
            change = effort_change(scene, coupled, _one_pass(loads, motion), motor=False)
        else:
            without = Efforts.of(motion.solve(variants[effect.name]))
            change = effort_change(scene, Efforts.of(whole), without, motor_side)
        cost, resolved = _saved(times[_ALL], times[effect.name])
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


def _gear_losses(scene: Scene, motion: _Motion, whole: InverseResult) -> tuple[GearLoss, ...]:
    """All gears' losses from one scene without any, for gears do not act on each other."""
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
    """The scene without an effect; without coupling loads ignore friction."""
    if effect.name == "coupling":
        return _hardly_rubbing(scene)
    if effect.name == "couples":
        return uncoupled(scene)
    return with_effects(scene, without=[effect.name])


def all_rounds(
    contestants: Mapping[_Key, Callable[[], object]], rounds: int
) -> dict[_Key, list[float]]:
    """Return the seconds that each takes, round by round."""
    times: dict[_Key, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, run in contestants.items():
            start = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - start)
    return times


@dataclass(frozen=True)
class _Motion:
    """A motion whose inverse dynamics is timed, on one thread, for several scenes.

    `attached`: (T, payloads), for scenes with all of `payloads`; None: carried all the time.
    """

    states: tuple[np.ndarray, np.ndarray, np.ndarray]
    t: np.ndarray | None
    attached: np.ndarray | None
    payloads: tuple[str, ...]
    external: Mapping[str, np.ndarray] = field(default_factory=dict)

    def solve(self, scene: Scene) -> InverseResult:
        attached = self.attached if tuple(scene.payloads) == self.payloads else None
        return inverse_dynamics(
            scene, *self.states, self.external, t=self.t, attached=attached, threads=1
        )

    def times(self, scenes: Mapping[_Key, Scene], whole: Scene) -> dict[_Key, np.ndarray]:
        """Microseconds per sample that each scene takes, round by round.

        A motion that takes longer than `_PATIENCE` is run once, in one round.
        """
        self.solve(whole)  # kernels are read from disk, or compiled
        start, samples = time.perf_counter(), len(self.states[0])
        self.solve(whole)
        fit = int(_PATIENCE / (time.perf_counter() - start))
        repeats = max(min(-(-_TIMED // samples), fit), 1)
        q, v, a = (np.tile(x, (repeats, 1)) for x in self.states)
        t = self.t
        if t is not None:  # a step between two runs
            step = (t[-1] - t[0]) / max(len(t) - 1, 1) or 1.0
            starts = np.arange(repeats) * (t[-1] - t[0] + step)
            t = np.tile(t, repeats) + np.repeat(starts, len(t))
        carried = None if self.attached is None else np.tile(self.attached, (repeats, 1))
        on = {name: np.tile(wrench, (repeats, 1)) for name, wrench in self.external.items()}
        long = _Motion((q, v, a), t, carried, self.payloads, on)
        if fit:
            for scene in scenes.values():
                long.solve(scene)
        runs = {name: partial(long.solve, scene) for name, scene in scenes.items()}
        rounds = all_rounds(runs, _ROUNDS if fit else 1)
        return {name: 1e6 / (repeats * samples) * np.array(x) for name, x in rounds.items()}


def _saved(whole: np.ndarray, without: np.ndarray) -> tuple[float, float]:
    """What leaving something out saves, and what the clock resolves of it, by times (rounds,).

    Medians of the rounds' differences and of their distances from that, these times 3/sqrt(rounds):
    some two standard errors. Of one round a twentieth of the whole time.
    """
    differences = whole - without
    middle = float(np.median(differences))
    if len(differences) == 1:
        return middle, 0.05 * float(whole[0])
    spread = float(np.median(np.abs(differences - middle)))
    return middle, 3.0 * spread / math.sqrt(len(differences))


@dataclass(frozen=True, eq=False)
class Efforts:
    """(T, na) ends of the efforts at the joints and at the motors' shafts; t (T,) s or None."""

    lower: np.ndarray
    upper: np.ndarray
    motor_lower: np.ndarray
    motor_upper: np.ndarray
    t: np.ndarray | None

    @classmethod
    def of(cls, r: InverseResult) -> Efforts:
        """Return the efforts of a result."""
        return cls(r.effort_lower, r.effort_upper, r.motor_torque_lower, r.motor_torque_upper, r.t)


def with_constant_friction(scene: Scene, constants: Mapping[str, float]) -> Scene:
    """Return the scene with ideal drives, its payloads, and constant friction by site, N m or N."""
    friction = {
        name: Friction(coulomb=CoulombFriction(static=F, kinetic=F))
        for name, F in constants.items()
        if F > 0.0
    }
    return dataclasses.replace(with_effects(scene, only=["payload"]), friction=friction)


def _hardly_rubbing(scene: Scene) -> Scene:
    """The scene with the loads that it has without friction."""
    friction = {
        name: entry.model_copy(update={"mu": LoadFriction(static=_HARDLY, kinetic=_HARDLY)})
        if entry.mu is not None
        else entry
        for name, entry in scene.friction.items()
    }
    return dataclasses.replace(scene, friction=friction)


def _one_pass(radial: Scene, motion: _Motion) -> Efforts:
    """Efforts with friction from loads without friction, in one pass: no coupling.

    Efforts are linear in friction, so each site adds its share of a constant friction there. It is
    kinetic also at sites that stick; `radial` has no other friction.
    """
    plain = motion.solve(with_effects(radial, only=["payload"]))
    loads = motion.solve(_hardly_rubbing(radial)).normal_load
    efforts = plain.effort_lower.copy()
    for s, name in enumerate(radial.site_names):
        mu = radial.friction[name].mu
        if mu is None:
            continue
        alone = motion.solve(with_constant_friction(radial, {name: 1.0}))
        unit = 0.5 * (alone.effort_lower + alone.effort_upper) - plain.effort_lower
        efforts += unit * mu.kinetic * loads[:, s : s + 1]
    return Efforts(efforts, efforts, efforts, efforts, plain.t)


def effort_change(
    scene: Scene, here: Efforts, below: Efforts, motor: bool
) -> tuple[float, float, str]:
    """Changes of peak and RMS of the worst end, of the drive that changes most."""
    peaks, rms = effort_changes(here, below, motor)
    i = int(np.argmax(np.abs(rms)))
    return float(peaks[i]), float(rms[i]), scene.actuator_names[i]


def effort_changes(here: Efforts, below: Efforts, motor: bool) -> tuple[np.ndarray, np.ndarray]:
    """Changes (na,) of peak and RMS of the worst end of every drive's effort."""
    worst = [
        ends_by_magnitude(*((e.motor_lower, e.motor_upper) if motor else (e.lower, e.upper)))[0]
        for e in (here, below)
    ]
    peaks = [np.nanmax(np.abs(w), axis=0) for w in worst]
    rms = [known_rms(e.t, w) for e, w in zip((here, below), worst, strict=True)]
    return peaks[0] - peaks[1], rms[0] - rms[1]
