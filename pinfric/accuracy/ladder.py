"""Friction models in increasing order: change of the efforts and computing time of each step.

frictionless -> a constant fitted to the same motion -> radial load -> + bending -> + static ->
+ Stribeck -> + coulomb -> + viscous -> + transmission -> + coupling
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.accuracy.timing import TimedMotion
from pinfric.accuracy.variants import (
    Efforts,
    effort_change,
    fitted_constants,
    one_pass,
    solve,
    with_constant_friction,
)
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import MotionLike, attached_columns
from pinfric.errors import PinfricError
from pinfric.model.described import EFFORT, described, quantity
from pinfric.model.effects import MOTOR_SIDE, effects, switchable, with_effects
from pinfric.model.scene import Scene
from pinfric.motions.summary import known_rms, unit_of_drive

#: Samples a timing takes at least; a short motion is repeated to that length.
_TIMED = 2000
_NAN = float("nan")


@described
class Rung:
    """One model of friction, compared with the simpler one before it."""

    name: str = quantity("effect that this step adds", heading="model")
    on: bool = quantity("whether the scene calls for it; if not, the figures are NaN")
    why: str = quantity("the keys of the scene that switch it on, or what was done")
    us: float = quantity(
        "inverse dynamics per sample on one thread, microseconds; NaN if no solver ran",
        heading="time\nus",
        default=_NAN,
    )
    peak_change: float = quantity(
        "change of the peak against the step below, of the drive whose RMS changes most",
        EFFORT,
        "peak\nchange",
        "{peak_change:+}",
        default=_NAN,
    )
    rms_change: float = quantity(
        "change of the RMS, likewise", EFFORT, "RMS\nchange", "{rms_change:+}", default=_NAN
    )
    drive: str = quantity("that drive's name", heading="of", default="")
    motor_side: bool = quantity(
        "the change is of motor torques (a transmission changes nothing at the joint)",
        heading="motor\nside",
        default=False,
    )
    distance: float = quantity(
        "RMS of the difference from the full model / RMS of the full model, mean over the drives",
        heading="missing",
        cell="{distance:percent}",
        default=_NAN,
    )
    unit: str = quantity(
        'unit of these changes, "N m" or "N"; empty: drives differ', heading="unit", default=""
    )
    problem: str = quantity("why it failed; empty: it did not fail", heading="", default="")


@dataclass(frozen=True, eq=False)
class _Step:
    """A rung before it is compared: its efforts, and the scene that is timed (None: no solver)."""

    name: str
    why: str
    scene: Scene | None
    efforts: Efforts | None
    problem: str = ""


def ladder(scene: Scene, motion: MotionLike, rounds: int = 5) -> tuple[Rung, ...]:
    """Return every rung for one motion.

    Args:
        scene: the robot with all its effects; payloads are carried on every rung.
        motion: with t, q, v, a.
        rounds: timings of each rung, all of them in every round.

    Raises:
        PinfricError: the whole scene has no solution for this motion.
    """
    result = solve(scene, motion)
    steps = _steps(scene, motion, result)
    states, attached = (motion.q, motion.v, motion.a), attached_columns(scene, motion)
    timed = TimedMotion(states, motion.t, attached, tuple(scene.payloads)).repeated(scene, _TIMED)
    scenes = {
        i: step.scene
        for i, step in enumerate(steps)
        if step.scene is not None and step.efforts is not None
    }
    times = timed.times(scenes, rounds)
    rungs: list[Rung] = []
    below: Efforts | None = None
    for i, step in enumerate(steps):
        if step.efforts is None:
            rungs.append(Rung(step.name, bool(step.problem), step.why, problem=step.problem))
            continue
        motor = step.name.removeprefix("+ ") in MOTOR_SIDE
        change = (
            (_NAN, _NAN, "") if below is None else effort_change(scene, step.efforts, below, motor)
        )
        distance = _distance(Efforts.of(result), step.efforts)
        us = float(np.median(times[i])) if i in times else _NAN
        unit = unit_of_drive(scene, change[2], motor)
        rungs.append(Rung(step.name, True, step.why, us, *change, motor, distance, unit))
        below = step.efforts
    return tuple(rungs)


def _steps(scene: Scene, motion: MotionLike, whole: InverseResult) -> list[_Step]:
    """All rungs from below; those the scene does not call for have no efforts."""
    names = [name for name in switchable() if name != "payload"]
    on = {effect.name: effect for effect in effects(scene)}
    steps = [
        _step("frictionless", "no friction", with_effects(scene, only=["payload"]), motion),
        _step(
            "constant",
            "coulomb fitted to the friction of this motion",
            with_constant_friction(scene, fitted_constants(whole)),
            motion,
        ),
    ]
    kept = ["payload"]
    for name in names:
        title = "radial load" if name == "load" else f"+ {name}"
        if not on[name].on:
            steps.append(_Step(title, on[name].why, None, None))
            continue
        kept.append(name)
        if name == "load" and scene.linkage is not None:
            why = "loads computed without friction, in one pass: an estimate, no solver"
            radial = with_effects(scene, only=kept)
            steps.append(_Step("radial load", why, None, one_pass(radial, motion)))
            title = "+ coupling"
        steps.append(_step(title, on[name].why, with_effects(scene, only=kept), motion))
    if scene.linkage is None:
        why = "open chain with a drive on every joint: friction changes no other joint's load"
        steps.append(_Step("+ coupling", why, None, None))
    return steps


def _step(name: str, why: str, scene: Scene, motion: MotionLike) -> _Step:
    try:
        return _Step(name, why, scene, Efforts.of(solve(scene, motion)))
    except PinfricError as problem:
        return _Step(name, why, None, None, " ".join(str(problem).split()))


def _distance(whole: Efforts, here: Efforts) -> float:
    """Share that is missing, RMS over both ends and time, mean over the drives."""
    missing = np.hypot(here.lower - whole.lower, here.upper - whole.upper)
    size = known_rms(whole.t, np.hypot(whole.lower, whole.upper))
    counts = size > 1e-9 * size.max(initial=0.0)
    share = known_rms(whole.t, missing)[counts] / size[counts]
    return float(share.mean()) if share.size else 0.0
