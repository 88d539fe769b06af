"""`pf.identify`: a robot's friction from its own logs, with intervals."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import IdentificationError, choose_from
from pinfric.identification.checks import check_one_robot
from pinfric.identification.estimate import Estimate, Question, after, estimate, turns
from pinfric.identification.files import identified_files
from pinfric.identification.findings import Findings
from pinfric.identification.laws import COULOMB, RESTS_ON, STRIBECK_VELOCITY, K, Law
from pinfric.identification.misfit import misfits
from pinfric.identification.normal import Fit, FrictionNormalEquations, residuals
from pinfric.identification.notes import notes
from pinfric.identification.parameters import (
    identified_scene,
    on_motor,
    parameters,
    scene_key,
    scene_value,
)
from pinfric.identification.prediction import held_out_errors, unseen_errors
from pinfric.identification.recordings import Recording, check_scene, read_recordings
from pinfric.identification.rest import break_aways, rest_bounds
from pinfric.identification.standing import on_chain
from pinfric.identification.uncertainty import Uncertainty, uncertainty
from pinfric.model.arrays import FloatArray
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.couples import taking_part
from pinfric.model.files import write_folder
from pinfric.model.floating import stands
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.upward import Shown
from pinfric.motions.log.effort_place import check_effort_place, factors_to_joint
from pinfric.motions.log.frame import Log
from pinfric.motions.log.judged import JudgedLog, compare_effort
from pinfric.motions.log.reading import ReadingOptions

#: Mean change of the logarithm of the joints' errors in all moving rows from which ways are kept.
_EARNED = -0.05
#: Rows of the posterior: enough for its percentiles from 1 to 99.
_DRAWS = 400


class Identified(Findings, Shown):  # noqa: D101 (that of its fields)
    __doc__ = Findings.__doc__

    @cached_property
    def beside_measured(self) -> dict[int, tuple[InverseResult, JudgedLog]]:
        """Of each log that was asked for, what `beside_measured` returns."""
        return {}

    def save(self, folder: str | Path) -> list[Path]:
        """Write scene.yaml, robot.urdf if inertias changed, posterior.csv, sweep.yaml, advice.

        Args:
            folder: is created where it is missing.

        Raises:
            IdentificationError: the scene has no URDF. PinfricError: it cannot be written.
        """
        return write_folder(folder, identified_files(self, Path(folder)))

    def __repr__(self) -> str:
        logs = counted(len(self.recordings), "log")
        unknown = [p.key for p in self.parameters if not p.determined]
        errors = [f"{100 * error.moving_share:.1f} %" for error in self.errors.values()]
        return screen(
            "Identified",
            f"{file_name(self.scene.source)} from {logs}",
            {
                "laws": listed(tuple(self.laws), [str(law) for law in self.laws.values()]),
                "errors": listed(tuple(self.errors), errors),
                "delay": str(self.estimate.delay),
                "not determined": listed(unknown),
                "more": ".parameters .posterior .scene .advice .summary() .plot() .save(folder)",
            },
        )


def identify(
    scene: Scene,
    logs: Sequence[str | Path | Log] | str | Path | Log,
    *,
    gain: Mapping[str, float] | None = None,
    effort_at: Literal["reflected", "motor", "joint"] = "reflected",
    inertia: Literal["consistent", "keep"] = "consistent",
    laws: Mapping[str, Law] | None = None,
    payloads: Mapping[str, str] | None = None,
    held_out: Sequence[str | Path | Log] = (),
    options: ReadingOptions = ReadingOptions(),  # noqa: B008
    seed: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> Identified:
    """Return the friction of an open chain's joints from logs of motion and effort.

    Of a robot that stands, logs have the base's pose and the forces at its feet; `found.scene` has
    six joints in place of the base (`root_joint.x` to `.roll`), and `save` writes the base.

        y(t + delay) = Y(q, v, a) theta + J a + friction,    theta: the links' inertial parameters

    Each joint gets the smallest law whose error on held-out blocks is not worse. Coefficients are
    least squares >= 0; intervals come from whole blocks as samples and from the logs' spread.

    Args:
        scene: the robot; its bearings are candidates, its coefficients are not used.
        logs: files that `load_trajectory` reads, with efforts, or `Log` arrays.
        gain: joint -> factor from its logged effort to N m (N): N m per A.
        effort_at: what that effort is: "reflected", motor torque times gear ratio, as most robots
            log it (rotor and gear losses are in it); "motor", torque at the motor's shaft, which
            the scene's ratio multiplies; "joint", measured behind the gear.
        inertia: "consistent" corrects the links' inertias to ones that can exist, "keep" takes the
            URDF's, as they are taken where the base floats.
        laws: joint -> its law, where it is not to be chosen.
        payloads: log's name, or its path where several have that name -> payload of the scene that
            it carries throughout, or "none".
        held_out: further logs, which are only predicted.
        options: columns, units, cutoff, joints without usable efforts.
        seed: of the posterior's draws.
        progress: called with the number of finished steps and of all.

    Raises:
        IdentificationError: logs without efforts, too short, with wrong signs or units, of two
            robots; a robot with loops, mimic joints or joints of several degrees of freedom.
        TrajectoryError: a log that cannot be read.
    """
    expect_scene(scene, "identify")
    check_scene(scene)
    scene = replace(scene, measured=None)  # its friction is not used
    _check_options(scene, effort_at, inertia, laws or {})
    logs = [logs] if isinstance(logs, str | Path | Log) else logs
    for sources in (logs, held_out):
        for log in sources if isinstance(sources, list | tuple) else [sources]:
            if not isinstance(log, str | os.PathLike | Log):
                raise IdentificationError(
                    f"identify: a log is a {type(log).__name__}; give a file's name, or "
                    "pf.Log(t, q, effort): measured efforts belong to it"
                )
    floating = scene if stands(scene) else None
    if floating is not None:
        scene = on_chain(floating)
    read = partial(read_recordings, scene, options=options, floating=floating)
    recordings = read(logs, gain or {}, payloads or {})
    unseen = read(held_out, gain or {}, {}) if held_out else ()
    factors = factors_to_joint(scene, effort_at)
    recordings, unseen = (
        tuple(replace(recording, effort=recording.effort * factors) for recording in read)
        for read in (recordings, unseen)
    )
    kept = inertia == "keep" or floating is not None
    question = Question(
        scene,
        recordings,
        effort_at,
        kept,
        laws or {},
        gain or {},
        options.without,
        floating=floating,
    )
    finished = 0

    def tell(done: int, total: int) -> None:
        nonlocal finished
        finished = done
        if progress is not None:
            progress(done, total)

    result = estimate(question, tell)
    if result.builds_up:  # ways were found beside plain friction: laws may explain it without them
        jumping = estimate(replace(question, jumps=True), after(tell, finished))
        built_up, jumped = _left(result), _left(jumping)
        changes = [np.log(built_up[name] / jumped[name]) for name in built_up if name in jumped]
        result = result if np.mean(changes) < _EARNED else jumping
    names, said = [recording.name for recording in recordings], payloads or {}
    stated = [k for k, log in enumerate(logs) if {names[k], str(log)} & said.keys()]
    check_one_robot(scene.joint_names, result.rows, _fits(result), names, stated)
    return _identified(result, unseen, seed)


def _left(estimate: Estimate) -> dict[str, float]:
    """Return each joint's error in all moving rows, N m or N."""
    errors = held_out_errors(estimate, identified_scene(estimate, break_aways(estimate)))
    return {name: max(error.moving_error, 1e-300) for name, error in errors.items()}


def _fits(estimate: Estimate) -> list[Fit]:
    """The fit of all logs, and of each log alone with the same laws (a hold has none)."""
    problem, log_of = estimate.problem, np.full(estimate.problem.folds.size, -1)
    for rows in estimate.rows:
        log_of[rows.block] = rows.log
    slots = problem.slots(estimate.choice.laws)
    alone = [problem.normal(log_of == log) for log in range(len(estimate.prepared))]
    return [
        estimate.fit,
        *(
            FrictionNormalEquations(own, problem.prior).fit(slots) if own.rows else estimate.fit
            for own in alone
        ),
    ]


def _identified(estimate: Estimate, unseen: Sequence[Recording], seed: int) -> Identified:
    scene = estimate.question.scene
    shapes = misfits(estimate)
    known = uncertainty(estimate, shapes)
    static = break_aways(estimate)
    better = identified_scene(estimate, static)
    names = scene.joint_names
    bounds = dict(zip(names, rest_bounds(estimate, better), strict=True))
    spread = dict(zip(names, known.spread.tolist(), strict=True))
    coefficients = parameters(estimate, known, static)
    errors = held_out_errors(estimate, better)
    factors = estimate.effort_factors()
    said = notes(estimate, bounds, coefficients, static, errors, factors, shapes, known.uneven)
    return Identified(
        scene=better,
        laws={names[j]: estimate.choice.laws[j] for j in estimate.known},
        parameters=coefficients,
        posterior=_posterior(estimate, known, seed),
        errors=errors,
        unseen={log.name: unseen_errors(estimate, better, log) for log in unseen},
        rest=bounds,
        spread=spread,
        delay=estimate.delay.value,
        doubts=said.doubts,
        given=said.given,
        notes=said.doubts + said.given + said.others,
        misfits=shapes,
        effort_factors=factors,
        estimate=estimate,
    )


def beside_measured(identified: Identified, log: int = 0) -> tuple[InverseResult, JudgedLog]:
    """Return the identified scene's efforts along a log, and the log's own beside them."""
    known = identified.beside_measured
    if log not in known:
        known[log] = _beside_measured(identified, log)
    return known[log]


def _beside_measured(identified: Identified, log: int) -> tuple[InverseResult, JudgedLog]:
    recording = identified.recordings[log]
    result = inverse_dynamics(identified.scene, recording.trajectory)
    at = identified.estimate.question.at
    whole = recording.effort + identified.estimate.prepared[log].missing
    effort = dict(zip(identified.scene.joint_names, whole.T, strict=True))
    reading = replace(recording.reading, effort=effort)
    measured = {
        name: compare_effort(result, j, y, at) for j, (name, y) in enumerate(effort.items())
    }
    return result, JudgedLog(reading, measured=measured, at=at)


def left_over(identified: Identified, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (n,) velocity, effort without friction, and measured less fitted effort of a joint."""
    rows = identified.estimate.rows[joint]
    return rows.velocity, rows.load, residuals(rows, identified.estimate.fit, joint)


def running_mean(x: np.ndarray, y: np.ndarray, parts: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Return means of x and y over `parts` groups of equal size, in the order of x."""
    order = [indices for indices in np.array_split(np.argsort(x), parts) if indices.size]
    return np.array([x[k].mean() for k in order]), np.array([y[k].mean() for k in order])


def _check_options(scene: Scene, effort_at: str, inertia: str, laws: Mapping[str, Law]) -> None:
    check_effort_place(effort_at, IdentificationError)
    if inertia not in (kinds := ("consistent", "keep")):
        raise IdentificationError(f"--inertia {inertia}: {choose_from(inertia, kinds)}")
    if effort_at == "joint" and (coupled := taking_part(scene.drives)):
        raise IdentificationError(
            f"--effort-at joint: the drive {scene.drives[coupled[0]].name!r} is coupled, so a "
            "sensor at one joint does not measure its effort; leave the `couples` out, or log the "
            "efforts at the motors"
        )
    for name, law in laws.items():
        if name not in scene.joint_names:
            raise IdentificationError(
                f"laws: there is no joint {name!r}; {choose_from(name, scene.joint_names)}"
            )
        if effort_at == "joint" and (law.load == "gear" or on_motor(law)):
            raise IdentificationError(
                f"laws: {name}: {law}: an effort measured after the gear does "
                "not contain it (--effort-at joint)"
            )
        bare = (entry := scene.friction.get(name)) is None or entry.bearing is None
        if law.load == "bearing" and bare and (effort_at == "joint" or not turns(scene, name)):
            raise IdentificationError(
                f"laws: {name}: {law}: the scene names no bearing of it; add `bearing` and `mu` to "
                f"friction.{name}, or take another law"
            )


def _posterior(estimate: Estimate, known: Uncertainty, seed: int) -> dict[str, FloatArray]:
    """Draws of every coefficient above zero, in the scene's terms."""
    draws = known.draws(estimate.fit.slots, _DRAWS, seed)
    slots, ways = estimate.problem.slots(estimate.choice.laws), set(COULOMB)
    stribeck = {*RESTS_ON, STRIBECK_VELOCITY}  # no key of a sweep
    result = {}
    for at in known.place.tolist():
        j, slot = divmod(at, K)
        if j not in estimate.known or slot in stribeck:
            continue
        law = estimate.choice.laws[j]
        ratio = abs(estimate.scene.drives[j].ratio)
        values = np.asarray(scene_value(law, slot, draws[:, at], ratio))
        # what moved one way only has this friction the other way, too
        for own in ways if slot in ways and not ways <= set(slots[j]) else {slot}:
            section, name, _ = scene_key(estimate.scene, j, law, own)
            result[f"{section}.{estimate.scene.joint_names[j]}.{name}"] = values
    return result
