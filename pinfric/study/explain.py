"""What each effect of a scene costs and changes: measured, effect by effect."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse import inverse_dynamics
from pinfric.dynamics.result import InverseResult
from pinfric.errors import StateError
from pinfric.model.effects import effects, with_effects
from pinfric.model.scene import Scene
from pinfric.study.summary import ends_by_magnitude
from pinfric.study.trajectory import Trajectory

_ROUNDS = 9
#: Samples a timing takes at least; a short motion is repeated to that length.
_TIMED = 4000


@dataclass(frozen=True)
class Explained:
    """One effect of a scene, with what it costs and changes on one motion.

    Attributes:
        name, on, why: as `Effect`.
        cost_us: what leaving the effect out saves per sample (us); NaN where it is off.
        peak_change: change of the largest effort magnitude of any drive through the effect,
            in the drive's unit, of the drive where the change is largest; NaN where it is off.
        rms_change: the same of the RMS.
        drive: that drive's name; empty where the effect is off.
        motor_side: True where the change is of motor torques (a transmission changes nothing at
            the joint).
    """

    name: str
    on: bool
    why: str
    cost_us: float
    peak_change: float
    rms_change: float
    drive: str
    motor_side: bool


@dataclass(frozen=True)
class Explanation:
    """All effects of a scene, and what the whole costs.

    Attributes:
        effects: one row each.
        total_us: inverse dynamics with everything on, per sample, on one thread.
        plain_us: the same motion without any effect.
        samples: of the motion.
    """

    effects: tuple[Explained, ...]
    total_us: float
    plain_us: float
    samples: int


def explain(scene: Scene, trajectory: Trajectory | None = None) -> Explanation:
    """Measure what each effect of a scene costs per sample and changes in the efforts.

    Args:
        scene: the robot.
        trajectory: the motion; None is a seeded random one inside the limits.
    """
    motion = _Motion.of(scene, trajectory)
    whole = motion.solve(scene)
    found = effects(scene)
    variants = {"": scene} | {
        e.name: with_effects(scene, without=[e.name]) for e in found if e.on
    }  # fmt: skip
    plain = with_effects(scene, only=[])
    seconds = _interleaved(
        {name: motion.timed(variant) for name, variant in variants.items()}
        | {"plain": motion.timed(plain)}
    )
    rows = []
    for effect in found:
        if not effect.on:
            nan = float("nan")
            rows.append(Explained(effect.name, False, effect.why, nan, nan, nan, "", False))
            continue
        motor_side = effect.name == "transmission"
        without = motion.solve(variants[effect.name])
        peak, rms, drive = _change(whole, without, motor_side)
        cost = 1e6 * (seconds[""] - seconds[effect.name]) / motion.timed_samples
        rows.append(
            Explained(effect.name, True, effect.why, cost, peak, rms, drive, motor_side)
        )  # fmt: skip
    each = 1e6 / motion.timed_samples
    return Explanation(
        tuple(rows), seconds[""] * each, seconds["plain"] * each, len(motion.trajectory[0])
    )


def _change(
    whole: InverseResult, without: InverseResult, motor_side: bool
) -> tuple[float, float, str]:
    """Changes of peak and RMS through an effect, of the drive where its RMS changes most."""
    ends = ("motor_torque_lower", "motor_torque_upper") if motor_side else (
        "effort_lower", "effort_upper")  # fmt: skip
    worst = [
        ends_by_magnitude(getattr(r, ends[0]), getattr(r, ends[1]))[0] for r in (whole, without)
    ]
    peaks = [np.abs(w).max(axis=0) for w in worst]
    rms = [np.sqrt((w**2).mean(axis=0)) for w in worst]
    i = int(np.argmax(np.abs(rms[0] - rms[1])))
    return float((peaks[0] - peaks[1])[i]), float((rms[0] - rms[1])[i]), whole.actuator_names[i]


@dataclass(frozen=True)
class _Motion:
    """Arrays to solve and to time; payload columns go with the scenes that have the payloads."""

    trajectory: tuple[np.ndarray, np.ndarray, np.ndarray]
    attached: np.ndarray | None
    payloads: tuple[str, ...]
    repeats: int

    @classmethod
    def of(cls, scene: Scene, trajectory: Trajectory | None) -> _Motion:
        if trajectory is None and scene.linkage is not None:
            raise StateError(
                f"{scene.source}: random states do not close its loops; give a trajectory"
            )
        if trajectory is None:
            qva: tuple[np.ndarray, np.ndarray, np.ndarray] = _random_motion(scene)
            attached = None
        else:
            qva = trajectory.q, trajectory.v, trajectory.a
            attached = trajectory.attached
        return cls(qva, attached, tuple(scene.payloads), max(1, -(-_TIMED // len(qva[0]))))

    @property
    def timed_samples(self) -> int:
        return self.repeats * len(self.trajectory[0])

    def solve(self, scene: Scene) -> InverseResult:
        attached = self.attached if tuple(scene.payloads) == self.payloads else None
        return inverse_dynamics(scene, *self.trajectory, attached=attached, threads=1)

    def timed(self, scene: Scene) -> Callable[[], object]:
        attached = self.attached if tuple(scene.payloads) == self.payloads else None
        q, v, a = (np.tile(x, (self.repeats, 1)) for x in self.trajectory)
        phases = None if attached is None else np.tile(attached, (self.repeats, 1))
        return lambda: inverse_dynamics(scene, q, v, a, attached=phases, threads=1)


def _random_motion(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """1000 seeded states inside the position limits, at up to 1 rad/s or m/s."""
    import pinocchio as pin

    model = scene.model
    rng = np.random.default_rng(0)
    low = np.clip(np.nan_to_num(model.lowerPositionLimit, neginf=-1.0), -1.0, 1.0)
    high = np.clip(np.nan_to_num(model.upperPositionLimit, posinf=1.0), -1.0, 1.0)
    pin.seed(0)
    q = np.array([pin.randomConfiguration(model, low, np.maximum(low, high)) for _ in range(1000)])
    v, a = rng.uniform(-1, 1, (2, 1000, model.nv))
    return q, v, a


def _interleaved(contestants: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Median seconds of each, all timed in every round: a busy machine slows all alike."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for run in contestants.values():
        run()
    for _ in range(_ROUNDS):
        for name, run in contestants.items():
            start = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in times.items()}
