"""Friction of a scene in the parameters of actuator models that trainers run, with their errors.

Each joint's models are fitted to three kinds of samples: those of a motion in which it moves; the
same at accelerations for which the motors give up to their limits, without which friction could not
be told from the torque that overcomes it; and break-away, forward and backward, in the same
postures. The error is that of the friction.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.random_states import random_states
from pinfric.exporting.actuator_law import MODELS, friction_budget
from pinfric.exporting.constants import JointConstants, Sampled
from pinfric.exporting.tree import rotor_inertias
from pinfric.model.described import EFFORT, described, effort_where, in_json, quantity
from pinfric.model.mass_matrix import mass_matrices
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import JointColumn, stated_limit

#: A model is taken where its error is below this part of the friction, or this multiple of the
#: least error of all models.
_ENOUGH, _ALIKE = 0.05, 1.1
#: Speeds (rad/s or m/s) and exponents that are tried where friction falls from rest to motion.
_FALLS = [(speed, power) for speed in (0.005, 0.02, 0.05, 0.1, 0.3, 1.0) for power in (1.0, 2.0)]
#: Rounds in which the signs of loads are found.
_ROUNDS = 20


@described
class ActuatorForm:
    """A model of one joint's friction, and its error."""

    joint: str = quantity("its name", heading="joint", name=True)
    unit: str = quantity('unit of its efforts, "N m" or "N"', heading="unit")
    model: str = quantity("m1 to m6; m1 is constants: frictionloss and damping", heading="model")
    taken: bool = quantity(
        "whether it is the simplest whose errors in motion, at the motors' limits and at "
        "break-away, as one RMS, are below 5 % of the friction or 1.1 times the least of any model"
    )
    error_rms: float = quantity(
        "RMS error of the friction while the joint moves", EFFORT, "error\nRMS"
    )
    error_peak: float = quantity("the largest", EFFORT, "error\npeak")
    pushed_rms: float = quantity(
        "RMS error at accelerations for which motors give up to their limits",
        EFFORT,
        "at motor\nlimits RMS",
    )
    rest_rms: float = quantity("RMS error of the friction at break-away", EFFORT, "break-away\nRMS")
    friction_rms: float = quantity("RMS of the friction while it moves", EFFORT, "friction\nRMS")
    parameters: Mapping[str, float] = quantity("by the keys of the model's files", EFFORT)


class _Samples(NamedTuple):
    """Friction of one joint, (n,) each.

    Attributes:
        kind: 0 of the motion, 1 at other accelerations, 2 break-away.
        v, motor, external, friction: see `friction_budget`.
    """

    kind: np.ndarray
    v: np.ndarray
    motor: np.ndarray
    external: np.ndarray
    friction: np.ndarray

    @property
    def weight(self) -> np.ndarray:
        """(n,) so that all kinds weigh the same."""
        return 1.0 / np.sqrt(np.bincount(self.kind, minlength=3))[self.kind]


def actuator_forms(
    result: InverseResult, columns: Sequence[JointColumn]
) -> tuple[ActuatorForm, ...]:
    """Return the models of every joint, the simplest first: bounded least squares.

        |r T_m - r^2 J a - tau_id| = F(v, r T_m, -h(q, v)) + damping |v|

    A joint that never moves in the motion is fitted over random states.

    Args:
        result: inverse dynamics of the scene along the motion, or of states.
        columns: its joints, one degree of freedom and one drive each.

    Source: `friction_budget`; Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23.
    """
    scene = replace(result.scene, measured=None)  # what was measured is said once
    along, forms = _Sides.of(result), []
    anywhere: _Sides | None = None
    for column in columns:
        (d,) = (d for d, x in enumerate(scene.drives) if x.velocity_index == column.index_v)
        sides = along
        if not along.moving.moving(d).any():
            anywhere = anywhere or _Sides.of(inverse_dynamics(scene, *random_states(scene)))
            sides = anywhere
        falls = [*_FALLS, *_own_falls(scene, column.index_v)]
        forms += _forms(column.name, effort_where(column.unit == "m"), sides.samples(d), falls)
    return tuple(forms)


class _Sides(NamedTuple):
    """Inverse dynamics of samples as they are, at other accelerations, without any, and at rest."""

    moving: Sampled
    pushed: Sampled
    held: np.ndarray
    rest: Sampled

    @classmethod
    def of(cls, result: InverseResult) -> _Sides:
        scene, states = replace(result.scene, measured=None), result.states
        still = np.zeros_like(states.v)

        def at(v: np.ndarray, a: np.ndarray) -> InverseResult:
            return inverse_dynamics(scene, states.q, v, a, attached=states.attached)

        pushed = at(states.v, _pushed(result))
        held, rest = at(states.v, still).effort_frictionless, at(still, still)
        return cls(Sampled.of(result), Sampled.of(pushed), held, Sampled.of(rest))

    def samples(self, d: int) -> _Samples:
        """Of one drive. Where a gear locks by itself nothing breaks away: no sample is taken."""
        moves, gears = self.moving.moving(d), self.moving.result.scene.gears()
        rotor = gears.ratio[d] ** 2 * gears.rotor_inertia[d]
        load = np.tile(self.rest.result.effort_frictionless[:, d], 2)
        ends = np.concatenate([self.rest.upper[:, d], self.rest.lower[:, d]])
        kept = np.isfinite(ends)
        rows = []
        for kind, sampled in enumerate((self.moving, self.pushed)):
            result, motor = sampled.result, sampled.lower[moves, d]
            v, a = (x[moves, d] for x in (result.actuator_velocity, result.actuator_acceleration))
            lost = np.sign(v) * (motor - rotor * a - result.effort_frictionless[moves, d])
            rows.append((np.full(len(v), kind), v, motor, -self.held[moves, d], lost))
        ends, load = ends[kept], load[kept]
        rows.append((np.full(len(ends), 2), 0.0 * ends, ends, -load, np.abs(ends - load)))
        return _Samples(*(np.concatenate(column) for column in zip(*rows, strict=True)))


def _pushed(result: InverseResult) -> np.ndarray:
    """(T, nv) accelerations of random torques up to the joints' limits, or thrice the motion's."""
    scene, q = result.scene, result.states.q
    mass = mass_matrices(scene.twin(), q) + np.diag(rotor_inertias(scene))
    effort = np.abs(result.joint_effort_upper)
    usual = 3.0 * effort.max(axis=0, where=np.isfinite(effort), initial=0.0)
    largest = np.zeros(scene.model.nv)
    for drive, most in zip(scene.drives, usual.tolist(), strict=True):
        stated = stated_limit(scene.model.effortLimit[drive.velocity_index])
        largest[drive.velocity_index] = stated if stated < np.inf else most
    torque = np.random.default_rng(0).uniform(-1.0, 1.0, (len(q), scene.model.nv)) * largest
    found: np.ndarray = np.einsum("tij,tj->ti", np.linalg.pinv(mass), torque)
    return found


def _own_falls(scene: Scene, velocity: int) -> list[tuple[float, float]]:
    """Speeds and exponents with which the scene's own friction falls at a joint."""
    laws, falls = scene.site_tables.laws, []
    for s, site in enumerate(scene.sites):
        if site.velocity_index != velocity:
            continue
        for row in range(int(laws.row_start[s]), int(laws.row_end[s])):
            if np.isfinite(laws.velocity[row]):
                falls.append((float(laws.velocity[row]), float(laws.exponent[row])))
    return falls


def _forms(
    name: str, unit: str, samples: _Samples, falls: Sequence[tuple[float, float]]
) -> list[ActuatorForm]:
    forms: list[ActuatorForm] = []
    best: dict[str, dict[str, float]] = {}
    for model in MODELS:
        tried = falls
        if model in ("m5", "m6"):  # where friction falls is known from M4
            tried = [(best["m4"]["dtheta_stribeck"], best["m4"]["alpha"])]
        elif "alpha" not in MODELS[model]:
            tried = falls[:1]
        fits = [_fit(model, samples, *fall, best.get("m4", {})) for fall in tried]
        best[model] = min(fits, key=lambda fit: _whole(_missed(fit, samples), samples))
        missed = _missed(best[model], samples)
        moving, rest = missed[samples.kind == 0], missed[samples.kind == 2]
        size = _rms(samples.friction[samples.kind == 0])
        pushed = _rms(missed[samples.kind == 1])
        error = _rms(moving), float(np.abs(moving).max(initial=0.0)), pushed, _rms(rest)
        forms.append(ActuatorForm(name, unit, model, False, *error, size, best[model]))
    errors = [_whole(_missed(form.parameters, samples), samples) for form in forms]
    enough = max(_ENOUGH * _whole(samples.friction, samples), _ALIKE * min(errors))
    first = next(k for k, error in enumerate(errors) if error <= enough)
    return [replace(form, taken=k == first) for k, form in enumerate(forms)]


def _whole(values: np.ndarray, samples: _Samples) -> float:
    return float(np.linalg.norm(samples.weight * values))


def _missed(parameters: Mapping[str, float], samples: _Samples) -> np.ndarray:
    budget, damping = friction_budget(parameters, samples.v, samples.motor, samples.external)
    return np.asarray(budget + damping * np.abs(samples.v) - samples.friction)


def _fit(
    model: str, samples: _Samples, speed: float, power: float, start: Mapping[str, float]
) -> dict[str, float]:
    """The coefficients of a model by least squares, all of them >= 0.

    M5 and M6 have the magnitude of a difference: its sign in each sample is that of the last fit,
    from three starts, until it stays.
    """
    keys = [key for key in MODELS[model] if key not in ("dtheta_stribeck", "alpha")]
    fixed = {"dtheta_stribeck": speed, "alpha": power} if "alpha" in MODELS[model] else {}
    load = start.get("load_friction_base", 0.0), start.get("load_friction_stribeck", 0.0)
    starts: list[Sequence[tuple[float, float]]] = [()]
    if "load_friction_motor" in keys:
        alike = [(x, x) for x in load]
        starts = [alike, [(1.0, 0.0)] * 2, [(0.0, 1.0)] * 2]
    fits = []
    for weights in starts:
        found: dict[str, float] = {}
        before = None
        for _ in range(_ROUNDS):
            signs = _signs(weights, samples)
            if before is not None and np.array_equal(signs, before):
                break
            found = {**_solve(keys, samples, fixed, signs), **fixed}
            fits.append(found)
            before = signs
            weights = tuple(
                (
                    found.get(f"load_friction_external{end}", 0.0),
                    found.get(f"load_friction_motor{end}", 0.0),
                )
                for end in ("", "_stribeck")
            )
    return min(fits, key=lambda fit: _whole(_missed(fit, samples), samples))


def _signs(weights: Sequence[tuple[float, float]], samples: _Samples) -> np.ndarray:
    """(2, n) signs of external and motor's loads, of the whole and of the part that falls."""
    rows = [np.sign(a * samples.external - b * samples.motor) for a, b in weights]
    return np.array(rows or [np.ones(len(samples.v))] * 2)


def _solve(
    keys: Sequence[str], samples: _Samples, fixed: Mapping[str, float], signs: np.ndarray
) -> dict[str, float]:
    """Least squares with each sample's sign of the load given."""
    v, motor, external = samples.v, samples.motor, samples.external
    share = np.zeros(len(v))
    if fixed:
        share = np.exp(-(np.abs(v / fixed["dtheta_stribeck"]) ** fixed["alpha"]))
    one, apart = np.ones(len(v)), np.abs(external - motor)
    against = np.sign(external) != np.sign(motor)
    smaller = np.abs(external) < np.abs(motor)
    larger = np.abs(external) > np.abs(motor)
    columns = {
        "friction_base": one,
        "friction_viscous": np.abs(v),
        "friction_stribeck": share,
        "load_friction_base": apart,
        "load_friction_stribeck": share * apart,
        "load_friction_external": signs[0] * external,
        "load_friction_motor": -signs[0] * motor,
        "load_friction_external_stribeck": share * signs[1] * external,
        "load_friction_motor_stribeck": -share * signs[1] * motor,
        "load_friction_external_quad": share * against * smaller * external**2,
        "load_friction_motor_quad": share * against * larger * motor**2,
    }
    A = np.column_stack([columns[key] for key in keys]) * samples.weight[:, None]
    size = np.linalg.norm(A, axis=0)
    used = size > 0.0
    values = np.zeros(len(keys))
    if used.any():
        values[used] = (
            nnls(A[:, used] / size[used], samples.weight * samples.friction)[0] / size[used]
        )
    return dict(zip(keys, values.tolist(), strict=True))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else np.nan


def actuators(
    scene: Scene,
    joints: Sequence[JointConstants],
    forms: Sequence[ActuatorForm],
    header: Sequence[str],
) -> str:
    """Return the file: each joint's models by the keys of their readers, and which one to take."""
    rows = []
    for joint, rotor in zip(joints, rotor_inertias(scene).tolist(), strict=True):
        own = [form for form in forms if form.joint == joint.joint]
        models: dict[str, Any] = {
            form.model: {
                "model": form.model,
                **form.parameters,
                "armature": rotor,
                "error_rms": form.error_rms,
                "error_peak": form.error_peak,
                "pushed_rms": form.pushed_rms,
                "rest_rms": form.rest_rms,
            }
            for form in own
        }
        plain = models["m1"]
        rows.append(
            {
                "joint": joint.joint,
                "unit": joint.unit,
                "armature": rotor,
                "frictionloss": plain["friction_base"],
                "damping": plain["friction_viscous"],
                "break_away": max(
                    models["m2"]["friction_base"] + models["m2"]["friction_stribeck"],
                    plain["friction_base"],
                ),
                "friction_rms": own[0].friction_rms,
                "take": next(form.model for form in own if form.taken),
                "models": models,
            }
        )
    content = {"pinfric_actuator": 1, "about": list(header), "joints": rows}
    return json.dumps(in_json(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
