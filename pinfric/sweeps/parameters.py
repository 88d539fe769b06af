"""Parameters of a sweep: names resolved against a scene, values set in it.

The names, with their units, are listed in `notebooks/reference/sweep.md`.
"""

from __future__ import annotations

import fnmatch
import math
import warnings
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from inspect import signature
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin

from pinfric.errors import PinfricWarning, SweepError, choose_from, problems_line
from pinfric.model.friction_terms import TERMS, CoulombFriction
from pinfric.model.inputs import note_input
from pinfric.model.scene import Scene
from pinfric.model.schema import Actuator, Friction, Payload
from pinfric.model.transmission import MakersEfficiency, OwnTransmission
from pinfric.motions.trajectory import Trajectory
from pinfric.sweeps.distributions import Distribution, TableColumn
from pinfric.sweeps.file import MOST_SAMPLES, SweepFile

#: Numbers that a sweep sets; all else it multiplies.
SET = ("efficiency", "back_efficiency")
_DIRECTIONS = ("positive", "negative")
_TRANSMISSION_KEYS = (
    *(f"no_load_torque.{way}" for way in _DIRECTIONS),
    "no_load_torque",
    "motor_viscous",
    "rotor_inertia",
    "stiffness",
    "hysteresis",
    *reversed(SET),
)
#: What changes elastic gears, and so the tool's place and frequencies.
ELASTIC = ("stiffness", "hysteresis")
_PAYLOAD_KEYS = ("mass", "com.x", "com.y", "com.z")
_ANGLES = ("roll", "pitch")
_FORMS = (
    "friction.<joint>.mu",
    "friction.<joint>.coulomb",
    "friction.<joint>.viscous",
    "transmission.<drive>.no_load_torque",
    "transmission.<drive>.motor_viscous",
    "payload.<name>.mass",
    "payload.<name>.com.x",
    "speed",
    "mounting.roll",
    "mounting.pitch",
)
#: Base angles beyond this were meant in degrees.
_LARGEST_ANGLE = 2 * math.pi


@dataclass(frozen=True)
class Target:
    """One column of the samples: the values of the scene that it changes.

    Attributes:
        name: as in the sweep file (with `each`: of one joint).
        section: friction, transmission, payload, speed or mounting.
        key: of the section, for instance mu.
        names: the joints, drives or the payload that it changes.
        distribution: of its values.
    """

    name: str
    section: str
    key: str
    names: tuple[str, ...]
    distribution: Distribution


def resolve(scene: Scene, sweep: SweepFile, source: str) -> tuple[Target, ...]:
    """Return the columns that a sweep draws, each with what it changes in this scene.

    Raises:
        SweepError: unknown names and impossible values, all in one message.
    """
    problems: list[str] = []
    targets: list[Target] = []
    for name, parameter in sweep.parameters.items():
        try:
            section, key, names = _find(scene, name)
        except SweepError as problem:
            problems.append(f"`parameters.{name}`: {problem}")
            continue
        wrong = _impossible(section, key, parameter.kind, parameter.distribution)
        if wrong:
            problems.append(f"`parameters.{name}`: {wrong}")
        if parameter.each and section in ("speed", "mounting", "payload"):
            problems.append(f"`parameters.{name}.each`: there is only one {name}; leave it out")
        groups = [(n,) for n in names] if parameter.each else [names]
        for group in groups:
            column = f"{section}.{group[0]}.{key}" if parameter.each else name
            targets.append(Target(column, section, key, group, parameter.distribution))
    targets += _table_targets(scene, sweep.table, problems)
    columns = [target.name for target in targets]
    twice = {column for column in columns if columns.count(column) > 1}
    problems += [f"`parameters`: {column} is given twice" for column in sorted(twice)]
    if problems:
        raise SweepError(problems_line(source, problems))
    for target in targets:
        if target.key == "hysteresis":
            _warn_of_full_springs(scene, target)
    return tuple(targets)


def _warn_of_full_springs(scene: Scene, target: Target) -> None:
    """Warn from which factor on no more friction can move behind a gear's spring."""
    top = target.distribution.support[1]
    top = top if np.isfinite(top) else float(target.distribution.quantile(np.array([0.999]))[0])
    for actuator in scene.actuators or ():
        gear, entry = actuator.transmission, scene.friction.get(actuator.joint or "")
        if actuator.drive_name not in target.names or gear is None or entry is None:
            continue
        lost, coulomb = gear.no_load_torque, entry.coulomb
        assert isinstance(coulomb, CoulombFriction)  # `_matches`
        there = lost.static if isinstance(lost, CoulombFriction) else 0.0
        most = 1.0 + abs(gear.ratio) * there / coulomb.static if coulomb.static else np.inf
        if top > most * (1.0 + 1e-9):
            warnings.warn(
                f"{target.name}: factors above {most:.3g} change nothing at {actuator.drive_name}: "
                "its no_load_torque has no more friction that could act behind the spring",
                PinfricWarning,
                stacklevel=2,
            )


def _table_targets(scene: Scene, table: str | None, problems: list[str]) -> list[Target]:
    """Return the columns of a table; append what is wrong with it to `problems`."""
    if table is None:
        return []
    try:
        note_input(table)
        frame = pd.read_csv(table, comment="#")
    except (OSError, ValueError) as problem:
        problems.append(f"`table`: {table} cannot be read: {' '.join(str(problem).split())[:200]}")
        return []
    targets = []
    for name in map(str, frame.columns):
        column = pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=float)
        wrong = np.flatnonzero(~np.isfinite(column))
        try:
            section, key, names = _find(scene, name)
            if wrong.size or not column.size:
                raise SweepError(
                    f"row {wrong[0] + 1} has no finite number" if wrong.size else "has no rows"
                )
            drawn = TableColumn(values=tuple(column.tolist()))
            if impossible := _impossible(section, key, "its column", drawn):
                raise SweepError(impossible)
        except SweepError as problem:
            problems.append(f"`table`: {name}: {problem}")
            continue
        targets.append(Target(name, section, key, names, drawn))
    return targets


def _find(scene: Scene, name: str) -> tuple[str, str, tuple[str, ...]]:
    """Return the section, key and names that a parameter's name means."""
    if name == "speed":
        return "speed", "", ()
    section, _, path = name.partition(".")
    if section == "mounting" and path in _ANGLES:
        return section, path, ()
    keys = {
        "friction": (
            *(f"coulomb.{way}" for way in _DIRECTIONS),
            "mu",
            "coulomb",
            "viscous",
            *TERMS,
        ),
        "transmission": _TRANSMISSION_KEYS,
        "payload": _PAYLOAD_KEYS,
    }.get(section, ())
    for key in keys:
        if path.endswith(f".{key}"):
            return section, key, _matches(scene, section, key, path[: -len(key) - 1])
    raise SweepError(f"unknown parameter; {choose_from(name, _FORMS)}")


def _matches(scene: Scene, section: str, key: str, pattern: str) -> tuple[str, ...]:
    if section == "friction":
        there = [n for n, f in scene.friction.items() if _found(f, key)]
        what = f"joint with {key} in this scene"
    elif section == "transmission":
        there = [d.name for d in scene.drives if _found(d.transmission, key)]
        what = f"drive with {key} in this scene"
    else:
        there, what = list(scene.payloads), "payload"
    names = tuple(n for n in there if n == pattern or fnmatch.fnmatchcase(n, pattern))
    if not names:
        raise SweepError(
            f"there is no {what} that is called {pattern!r}; {choose_from(pattern, there)}"
        )
    for actuator in scene.actuators or () if key == "hysteresis" else ():
        entry, gear = scene.friction.get(actuator.joint or ""), actuator.transmission
        coulomb = None if entry is None else entry.coulomb
        lost = None if gear is None else gear.no_load_torque
        if actuator.drive_name in names and not (
            isinstance(coulomb, CoulombFriction) and isinstance(lost, CoulombFriction | None)
        ):
            raise SweepError(
                f"the hysteresis of {actuator.drive_name} moves friction between its joint's "
                "`coulomb` and its gear's `no_load_torque`: give `coulomb`, and both the same in "
                "both directions"
            )
    for drive in scene.drives if section == "transmission" and key != "stiffness" else ():
        gear = drive.transmission
        if drive.name not in names or gear is None:
            continue
        if key in SET and isinstance(gear, OwnTransmission):
            raise SweepError(f"{drive.name} has losses of kind {gear.kind!r}; it has no {key}")
        if isinstance(gear.efficiency, MakersEfficiency):
            raise SweepError(
                f"the efficiency of {drive.name} includes the no-load loss: "
                "give it as a number, without the no-load loss"
            )
    if section == "payload" and len(names) > 1:
        raise SweepError(f"matches {len(names)} payloads; name one: {', '.join(names)}")
    return names


def _found(entry: Any, key: str) -> Any:
    """Return the value at a key, also `coulomb.positive`; None if there is none."""
    for field in key.split("."):
        entry = getattr(entry, field, None)
    return entry


def _scaled(entry: Any, key: str, factor: float) -> Any:
    """Return the entry with the value at a key times a factor (a key of `SET`: set to it)."""
    first, _, inner = key.partition(".")
    value = getattr(entry, first)
    if inner:
        changed = _scaled(value, inner, factor)
    elif first in SET:
        changed = factor
    else:
        changed = factor * value if isinstance(value, float) else value.scaled(factor)
    return entry.model_copy(update={first: changed})


def _impossible(section: str, key: str, kind: str, distribution: Distribution) -> str:
    low = distribution.support[0]
    with np.errstate(over="ignore"):
        ends = distribution.quantile(np.array([0.0, 0.05, 0.95, 1.0 - 2.0**-53]))
    if not np.isfinite(ends).all():
        return f"{kind}: its values reach infinity; check its width"
    if section == "mounting":
        if np.abs(ends[1:3]).max() > _LARGEST_ANGLE:
            return f"{kind}: angles from {ends[1]:.3g} to {ends[2]:.3g} rad; are these degrees?"
        return ""
    if section == "payload" and key != "mass":
        return ""
    if key in SET:
        high = distribution.support[1]
        if high > 1.0 or (key == "efficiency" and low <= 0.0):
            least = "above 0 and " if key == "efficiency" else ""
            return f"{kind} reaches from {low:g} to {high:g}; the value must be {least}at most 1"
        return ""
    positive = section in ("payload", "speed") or key in ELASTIC
    what = {"payload": "a mass", "speed": "a speed factor"}.get(section, "a factor on friction")
    what = f"a factor on {key}" if key in ELASTIC else what
    if low > 0 or (low == 0 and not positive):
        return ""
    reach = f"reaches down to {low:g}" if math.isfinite(low) else "has no lower bound"
    below = distribution.probability_below(0.0)
    often = f" ({100 * below:.2g} % of it lies below 0)" if below > 0 else ""
    bound = "above 0" if positive else "0 or more"
    cure = "; take truncated_normal with `low`, or lognormal" if kind == "normal" else ""
    return f"{kind} {reach}{often}, and {what} must be {bound}{cure}"


def apply(
    scene: Scene, trajectory: Trajectory, targets: Sequence[Target], values: Sequence[float]
) -> tuple[Scene, Trajectory]:
    """Return scene and trajectory with one sample's values.

    Args:
        scene, trajectory: stay as they are.
        values: (number of targets,) in their order.
    """
    for target, value in zip(targets, map(float, values), strict=True):
        if target.section == "speed":
            trajectory = trajectory.with_speed(value)
    return vary(scene, targets, values), trajectory


def vary(scene: Scene, targets: Sequence[Target], values: Sequence[float]) -> Scene:
    """Return the scene with one sample's values, as `apply`, without the trajectory's speed."""
    friction = dict(scene.friction)
    payloads = dict(scene.payloads)
    losses: dict[str, dict[str, float]] = {}
    splits: dict[str, float] = {}
    angles = dict.fromkeys(_ANGLES, 0.0)
    for target, value in zip(targets, map(float, values), strict=True):
        if target.section == "mounting":
            angles[target.key] = value
        elif target.section == "payload":
            name = target.names[0]
            payloads[name] = _with_payload(payloads[name], target.key, value)
        elif target.key == "hysteresis":
            for name in target.names:
                splits[name] = splits.get(name, 1.0) * value
        elif target.section == "friction":
            for name in target.names:
                friction[name] = _scaled(friction[name], target.key, value)
        elif target.section == "transmission":
            for name in target.names:
                factors = losses.setdefault(name, {})
                before = 1.0 if target.key in SET else factors.get(target.key, 1.0)
                factors[target.key] = before * value
    sections = {target.section for target in targets}
    change: dict[str, Any] = {}
    if "friction" in sections:
        change["friction"] = friction
    if "payload" in sections:
        change["payloads"] = payloads
    actuators = list(scene.actuators or ())
    if losses:
        change["actuators"] = actuators = [_with_losses(a, losses) for a in actuators]
    if splits:
        moved = [_split(a, friction, splits.get(a.drive_name, 1.0)) for a in actuators]
        change["actuators"], change["friction"] = moved, friction
    if "mounting" in sections:
        change["model"] = turned = scene.model.copy()
        turned.gravity.linear = mounted_gravity(scene.model, angles["roll"], angles["pitch"])
    return _varied(scene, change) if change else scene


def _varied(scene: Scene, change: dict[str, Any]) -> Scene:
    """Return the scene with other numbers in the same places.

    `Scene` would check every entry again and open a new wrench twin: half of a short cycle's time.
    `resolve` has checked the values; what does not depend on them is kept.
    """
    varied = copy(scene)  # without what it has derived
    for name, value in change.items():
        object.__setattr__(varied, name, value)
    kept = [] if "model" in change else ["_made_of"]
    kept += [] if change.keys() & {"model", "payloads"} else ["_variants"]
    if scene.linkage is None:
        kept += [] if "friction" in change else ["sites", "site_tables"]
        kept += [] if "actuators" in change else ["drives"]
    for name in kept:
        varied.__dict__[name] = getattr(scene, name)
    return varied


def mounted_gravity(model: pin.Model, roll: float, pitch: float) -> np.ndarray:
    """Return (3,) gravity in the axes of a base turned by R = R_y(pitch) R_x(roll): R^T g, m/s^2.

    Args:
        roll, pitch: rad, about the world's x, then its y axis.
    """
    return pin.rpy.rpyToMatrix(roll, pitch, 0.0).T @ model.gravity.linear


def _with_payload(payload: Payload, key: str, value: float) -> Payload:
    if key == "mass":
        return payload.scaled(value / payload.mass)
    com = list(payload.com)
    com["xyz".index(key[-1])] = value
    return payload.model_copy(update={"com": tuple(com)})


def _with_losses(actuator: Actuator, losses: dict[str, dict[str, float]]) -> Actuator:
    factors = losses.get(actuator.drive_name)
    if not factors or actuator.transmission is None:
        return actuator
    transmission = actuator.transmission
    for key, factor in factors.items():
        transmission = _scaled(transmission, key, factor)
    return actuator.model_copy(update={"transmission": transmission})


def _split(actuator: Actuator, friction: dict[str, Friction], factor: float) -> Actuator:
    """Let `factor` of a joint's Coulomb friction act behind its gear's spring, the rest before it.

        coulomb' = factor coulomb
        |r| no_load_torque' = |r| no_load_torque + (1 - factor) coulomb

    At most the friction before the spring moves behind it. Changes `friction`.
    """
    gear, joint = actuator.transmission, actuator.joint
    entry = None if joint is None else friction.get(joint)
    if gear is None or gear.hysteresis is None or entry is None or factor == 1.0:
        return actuator
    coulomb, lost = entry.coulomb, gear.no_load_torque
    assert isinstance(coulomb, CoulombFriction)  # `_matches`
    size, there = abs(gear.ratio), lost or CoulombFriction(static=0.0, kinetic=0.0)
    assert isinstance(there, CoulombFriction)
    change = {k: (factor - 1.0) * getattr(coulomb, k) for k in ("static", "kinetic")}
    moved = {k: min(x, size * getattr(there, k)) for k, x in change.items()}
    behind = {k: getattr(coulomb, k) + x for k, x in moved.items()}
    before = {k: getattr(there, k) - x / size for k, x in moved.items()}
    assert joint is not None  # it has an entry
    friction[joint] = entry.model_copy(update={"coulomb": coulomb.model_copy(update=behind)})
    update = {
        "no_load_torque": there.model_copy(update=before),
        "hysteresis": factor * gear.hysteresis,
    }
    return actuator.model_copy(update={"transmission": gear.model_copy(update=update)})


def count(targets: Sequence[Target], sweep: SweepFile) -> int:
    """Return the number of samples.

    Raises:
        SweepError: a grid or design of more than `MOST_SAMPLES`.
    """
    total, design = sweep.samples or 0, "the grid"
    if sweep.sampling == "grid":
        total = math.prod(len(target.distribution.levels or ()) for target in targets)
    elif sweep.sampling == "sobol":
        total, design = total * (len(targets) + 2), "Sobol's design"
    if total > MOST_SAMPLES:
        raise SweepError(f"{design} has {total:,} samples; at most {MOST_SAMPLES:,}")
    return total


def draw(targets: Sequence[Target], sweep: SweepFile) -> np.ndarray:
    """Return every sample's values (n, number of targets), which depend on the seed only.

    Sobol's design stacks Saltelli's matrices A, B and A with one column of B, for each target.
    """
    d = len(targets)
    if sweep.sampling == "grid":
        levels = [target.distribution.levels or () for target in targets]
        total = count(targets, sweep)
        index = np.unravel_index(np.arange(total), [len(values) for values in levels])
        return _columns(np.array(values)[i] for values, i in zip(levels, index, strict=True))
    assert sweep.samples is not None  # the file's check
    if sweep.sampling == "random":
        u = np.random.default_rng(sweep.seed).random((sweep.samples, d))
    else:
        from scipy.stats import qmc

        # scrambled, the shares come out ten times as well as with the sequence shifted as a whole
        points = qmc.Sobol(2 * d, scramble=True, **seeded(qmc.Sobol, "seed", sweep.seed))
        A, B = np.hsplit(points.random(sweep.samples), 2)
        u = np.concatenate([A, B, *(np.where(np.arange(d) == j, B, A) for j in range(d))])
    rows = [j for j, target in enumerate(targets) if isinstance(target.distribution, TableColumn)]
    u[:, rows] = u[:, rows[:1]]  # one row of the table in all its columns
    return _columns(target.distribution.quantile(u[:, j]) for j, target in enumerate(targets))


def seeded(function: Any, before: str, seed: int) -> dict[str, np.random.Generator]:
    """Return the argument that seeds one of SciPy's functions: `rng`, or `before` in older ones."""
    known = signature(function).parameters
    return {"rng" if "rng" in known else before: np.random.default_rng(seed)}


def _columns(columns: Iterable[np.ndarray]) -> np.ndarray:
    return np.column_stack(list(columns)).astype(float)
