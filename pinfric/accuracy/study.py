"""Computing time against accuracy: reference, methods, errors, seconds of a scene's simulation.

The reference is the `event` method two decades tighter than the tightest contestant; another judge
that shares no code with them may be given. What fails is a row with its reason.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.accuracy.explain import all_rounds
from pinfric.dynamics.inverse.result import StickInterval
from pinfric.dynamics.simulation.motion import Motion
from pinfric.dynamics.simulation.simulate import end_of, simulate
from pinfric.errors import PinfricError, SceneError
from pinfric.model.brief import file_name, screen
from pinfric.model.described import PLACE, described, quantity
from pinfric.model.scene import Scene
from pinfric.model.upward import Shown

#: Relative tolerances of `event`; the absolute ones are a hundredth of them.
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
#: Steps of `timestepping` over the whole motion.
STEPS = (50, 160, 500, 1600, 5000)
#: Velocities (rad/s or m/s) at which `regularized` smooths friction, and its tolerance.
VELOCITIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
_SMOOTH_TOLERANCE = 1e-7
#: Samples at which a motion is compared; of a motion that knows no stick, those it is looked for.
_COMPARED, _LOOKS = 400, 2000
#: A run that takes longer than this (s) is timed once.
_PATIENCE = 2.0
_NAN = float("nan")


@described
class TimedRun:
    """One method with one setting: its errors, and what it took."""

    method: str = quantity(
        "`event`, `timestepping`, `regularized`, or a peer's name", heading="method"
    )
    setting: str = quantity("tolerance or step, in words", heading="setting")
    error: float = quantity(
        "largest error of q over the motion; NaN without a motion",
        PLACE,
        "error\nof q",
        "{error:decade}",
        default=_NAN,
    )
    end_error: float = quantity(
        "error of q at the end", PLACE, "at the\nend", "{end_error:decade}", default=_NAN
    )
    stick_error: float = quantity(
        "largest error of a stick interval's start or end, each compared with the interval that "
        "overlaps it most; NaN if one has no counterpart; 0 if no joint sticks",
        "s",
        "of stick",
        "{stick_error:decade}",
        default=_NAN,
    )
    missed: int = quantity("stick intervals of the reference without a counterpart", default=0)
    wall_s: float = quantity("median computing time", "s", "time", "{wall_s:ms}", default=_NAN)
    rhs: int = quantity("right-hand sides or steps computed", heading="evalua-\ntions", default=0)
    problem: str = quantity("why it failed; empty: it did not fail", default="")


@described
class Accuracy(Shown):
    """Computing time against accuracy for one scene."""

    def __repr__(self) -> str:
        methods = ", ".join(dict.fromkeys(run.method for run in self.runs))
        more = {
            "simulations": f"{len(self.runs)}, by {methods}",
            "more": ".runs .summary() .plot()",
        }
        return screen("Accuracy", file_name(self.scene.source), more)

    scene: Scene
    runs: tuple[TimedRun, ...] = quantity("simulations")


def accuracy(scene: Scene, *, rounds: int = 3) -> Accuracy:
    """Measure computing time against accuracy of each method of simulation.

    Args:
        scene: the robot, with a `simulation` section.
        rounds: timings of each contestant, of which the median counts.

    Raises:
        SceneError: there is no `simulation` section.
        PinfricError: the reference cannot be simulated.
    """
    if scene.simulation is None:
        raise SceneError(
            f"{scene.source}: has no `simulation` section; give it one (`pinfric explain` measures "
            "the effects of a scene in inverse dynamics)"
        )
    judge = judge_of(reference(scene))
    return Accuracy(scene=scene, runs=compete(contestants(scene), judge, rounds))


@dataclass(frozen=True, eq=False)
class JudgedTrack:
    """A contestant's motion as it is judged.

    Attributes:
        t, q: (T,) s, (T, nq).
        readings: when its sites stick; several where a threshold decides: the best one counts.
        evaluations: right-hand sides or steps.
        wall_s: of computing it with no sample but the end (s); NaN where that was not done.
    """

    t: np.ndarray
    q: np.ndarray
    readings: tuple[tuple[StickInterval, ...], ...]
    evaluations: int
    wall_s: float = _NAN


@dataclass(frozen=True, eq=False)
class Contestant:
    """One method with one setting.

    Attributes:
        bare: computes the motion with no sample but the end; this is timed.
        judged: computes it with samples.
    """

    method: str
    setting: str
    bare: Callable[[], object]
    judged: Callable[[], JudgedTrack]


@dataclass(frozen=True, eq=False)
class Judge:
    """A motion taken for true: configurations at any times, and stick intervals."""

    name: str
    scene: Scene
    at: Callable[[np.ndarray], np.ndarray]
    sticks: tuple[StickInterval, ...]

    def errors(self, track: JudgedTrack) -> np.ndarray:
        """Return the largest error of any coordinate (rad or m) at each compared sample, (n,)."""
        stride = max(1, len(track.t) // _COMPARED)
        chosen = np.unique(np.append(np.arange(0, len(track.t), stride), len(track.t) - 1))
        true, model = self.at(track.t[chosen]), self.scene.model
        pairs = zip(true, track.q[chosen], strict=True)
        return np.array([np.abs(pin.difference(model, own, other)).max() for own, other in pairs])

    def stick_errors(self, track: JudgedTrack) -> list[float]:
        """Return the larger error of both ends of each true interval (s), NaN if missed."""

        def error(true: StickInterval, intervals: Sequence[StickInterval]) -> float:
            """Of the interval that overlaps a true one most."""
            off = {
                min(f.end, true.end) - max(f.start, true.start): max(
                    abs(f.start - true.start), abs(f.end - true.end)
                )
                for f in intervals
                if f.site == true.site
            }
            most = max(off, default=-1.0)
            return off[most] if most >= 0.0 else _NAN

        read = [[error(true, reading) for true in self.sticks] for reading in track.readings]
        return min(read, key=lambda e: (np.isnan(e).sum(), np.nan_to_num(e).max(initial=0.0)))


def reference(scene: Scene) -> Motion:
    """Simulate a scene's own motion two decades tighter than the tightest contestant.

    Steps are t_end / 50 at most: no guard hides within a long one.
    """
    rtol = 1e-2 * min(TOLERANCES)
    return simulate(scene, rtol=rtol, atol=1e-2 * rtol, max_step=end_of(scene) / 50)


def judge_of(motion: Motion) -> Judge:
    """Return a motion of the `event` method as a judge."""

    def at(times: np.ndarray) -> np.ndarray:
        return motion.sample(np.minimum(times, motion.t[-1])).q

    return Judge("event", motion.scene, at, motion.stick_intervals())


def contestants(scene: Scene, methods: Collection[str] | None = None) -> list[Contestant]:
    """Return pinfric's methods, or those wanted, each with all its settings.

    `event` without a limit to its steps, so that the tolerance alone decides, and once with its
    defaults.
    """
    t_end = end_of(scene)
    smooth = {"rtol": _SMOOTH_TOLERANCE, "atol": 1e-2 * _SMOOTH_TOLERANCE}
    settings: dict[str, dict[str, dict[str, float]]] = {
        "event": {
            f"rtol {rtol:.0e}": {"rtol": rtol, "atol": 1e-2 * rtol, "max_step": t_end}
            for rtol in TOLERANCES
        }
        | {"defaults": {}},
        "timestepping": {f"dt {t_end / n:.2e} s": {"dt": t_end / n} for n in STEPS},
        "regularized": {
            f"velocity {v:.0e}": {"regularization_velocity": v, **smooth} for v in VELOCITIES
        },
    }
    return [
        _own(scene, method, setting, options)
        for method, tolerances in settings.items()
        if methods is None or method in methods
        for setting, options in tolerances.items()
    ]


def _own(scene: Scene, method: str, setting: str, options: Mapping[str, Any]) -> Contestant:
    t_end, samples = end_of(scene), _LOOKS if method == "regularized" else _COMPARED

    def bare() -> Motion:
        return simulate(scene, method=method, sample_step=t_end, **options)

    def judged() -> JudgedTrack:
        # the samples cost evaluations, too; those of the method are counted without them
        start = time.perf_counter()
        motion = bare()
        count, seconds = motion.evaluations, time.perf_counter() - start
        if motion.dense is not None:
            motion = motion.sample(np.linspace(0.0, motion.t[-1], samples + 1))
        else:
            motion = simulate(scene, method=method, sample_step=t_end / samples, **options)
        return JudgedTrack(motion.t, motion.q, (motion.stick_intervals(),), count, seconds)

    return Contestant(method, setting, bare, judged)


def compete(entries: Sequence[Contestant], judge: Judge, rounds: int = 3) -> tuple[TimedRun, ...]:
    """Judge and time contestants; one that fails is a row with its reason.

    Each is timed in all rounds; what takes seconds once.
    """
    runs: list[TimedRun] = []
    quick: dict[int, Callable[[], object]] = {}
    slow: dict[int, Callable[[], object]] = {}
    for i, entry in enumerate(entries):
        start = time.perf_counter()
        runs.append(_judged(entry, judge))
        if runs[i].problem:
            continue
        if time.perf_counter() - start < _PATIENCE:
            quick[i] = entry.bare
        elif not np.isfinite(runs[i].wall_s):
            slow[i] = entry.bare
    seconds = all_rounds(quick, rounds) | all_rounds(slow, 1)
    return tuple(
        replace(run, wall_s=statistics.median(seconds[i])) if i in seconds else run
        for i, run in enumerate(runs)
    )


def _judged(entry: Contestant, judge: Judge) -> TimedRun:
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # a coarse step may well explode
            track = entry.judged()
    except PinfricError as problem:
        return TimedRun(entry.method, entry.setting, problem=" ".join(str(problem).split()))
    if not np.isfinite(track.q).all():
        return TimedRun(entry.method, entry.setting, problem="diverges: q is not finite")
    errors = judge.errors(track)
    ends = judge.stick_errors(track)
    return TimedRun(
        method=entry.method,
        setting=entry.setting,
        error=float(errors.max()),
        end_error=float(errors[-1]),
        stick_error=float(np.max(ends, initial=0.0)),
        missed=int(np.isnan(ends).sum()),
        wall_s=track.wall_s,
        rhs=track.evaluations,
    )
