"""Efforts of a simulation: constants, tables over time, sines, or any function of (t, q, v)."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import sin
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import SimulationError, StateError, choose_from
from pinfric.model.arrays import real_numbers
from pinfric.model.csv_text import number_of, read_table
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION, impossible
from pinfric.model.scene import Scene
from pinfric.model.schema import SineEffort, TableEffort
from pinfric.model.yamlfile import brief_path

EffortFunction = Callable[[float, np.ndarray, np.ndarray], Any]


@dataclass(frozen=True, eq=False)
class Effort:
    """Efforts, or motor torques, of all drives as one function.

    Attributes:
        function: (t, q, v) -> (na,), N m or N at the joints, or N m at the motors' shafts, in the
            order of `Scene.actuator_names`; or a mapping by drive, see `by_name`. Pure, unless it
            is held.
        breakpoints: (n,) times (s) at which it or its slope jumps; integration steps end there.
        finest: time (s) within which it changes little between them; None: unknown.
        given: "effort" or "motor_torque".
        held: whether it is called at t = 0 and the breakpoints only, and held between them.
    """

    function: EffortFunction
    breakpoints: np.ndarray
    finest: float | None = None
    given: str = "effort"
    held: bool = False


#: Forms of the argument `effort` of `simulate`.
EffortLike = Effort | EffortFunction | Mapping[str, Any] | Sequence[Any] | np.ndarray | None


def make_effort(
    scene: Scene,
    effort: EffortLike,
    breakpoints: Sequence[float] | None = None,
    motor_torque: EffortLike = None,
) -> Effort:
    """Return the efforts that were given to `simulate` as one function.

    Args:
        scene: its drives.
        effort: an `Effort`; a pure function (t, q, v) -> (na,), or -> a mapping drive -> number;
            (na,) constants; (times (n,), values (n, na)), linear between and constant beyond; a
            mapping drive name -> number, function of t or of (t, q, v), or the scene file's `sine`
            and `table`; None: the scene's own `simulation.effort` or `simulation.motor_torque`.
            Arrays are in the order of `scene.actuator_names`, which need not be that of the list
            of actuators; in mappings, drives left out give 0.
        breakpoints: times (s) at which a function or its slope jumps.
        motor_torque: like `effort`, in its place.

    Raises:
        SimulationError: both; an unknown drive, a wrong shape, a value not finite.
        StateError: not real numbers.
    """
    own = real_numbers("breakpoints", [] if breakpoints is None else breakpoints).ravel()
    if impossible(own).any():
        raise SimulationError("breakpoints: hold NaN, Inf or impossible times; give times in s")
    if effort is not None and motor_torque is not None:
        raise SimulationError("found both effort and motor_torque; give one of them")
    given = "effort" if motor_torque is None else "motor_torque"
    effort = effort if motor_torque is None else motor_torque
    if effort is None:
        if scene.simulation is None:
            raise SimulationError(
                f"{scene.source}: has no `simulation` section; give `effort` or `motor_torque`: a "
                "function of (t, q, v), constants, or (times, values)"
            )
        given = "motor_torque" if scene.simulation.motor_torque else "effort"
        effort = scene.simulation.motor_torque or scene.simulation.effort
    if isinstance(effort, Effort):
        return replace(effort, breakpoints=np.union1d(effort.breakpoints, own), given=given)
    if callable(effort):
        return Effort(effort, own, given=given)
    if isinstance(effort, Mapping):
        of_drives = _by_name(scene, effort, given)
    elif isinstance(effort, tuple) and len(effort) == 2 and np.ndim(effort[0]) == 1:
        of_drives = _table(given, effort[0], effort[1], len(scene.drives))
    else:
        values = _numbers(given, effort)
        if values.shape != (len(scene.drives),):
            raise SimulationError(
                f"{given}: shape {values.shape}; should be ({len(scene.drives)},), one for each of "
                f"{', '.join(scene.actuator_names)}; a table over time is (times, values)"
            )
        of_drives = Effort(lambda t, q, v: values, np.zeros(0), np.inf)
    breaks = np.union1d(of_drives.breakpoints, own)
    constant = of_drives.finest == np.inf and not breaks.size  # asked once
    return Effort(of_drives.function, breaks, of_drives.finest, given, held=constant)


def by_name(names: Sequence[str], given: Mapping[str, Any], what: str) -> np.ndarray:
    """Return numbers (na,) given by drive; those left out are 0.

    Args:
        names: of the drives, in their order.
        given: drive -> number.
        what: the argument's name, for messages.

    Raises:
        StateError: an unknown drive, or a value that is not a number.
    """
    out = np.zeros(len(names))
    for name, value in given.items():
        if name not in names:
            raise StateError(f"{what}: there is no drive {name!r}; {choose_from(name, names)}")
        number = real_numbers(f"{what}[{name!r}]", value)
        if number.size != 1:
            raise StateError(f"{what}[{name!r}]: shape {number.shape}; should be a number")
        out[names.index(name)] = number.item()
    return out


def _by_name(scene: Scene, entries: Mapping[str, Any], given: str) -> Effort:
    names = scene.actuator_names
    constant = np.zeros(len(names))
    varying: list[tuple[int, EffortFunction]] = []
    breaks = [np.zeros(0)]
    finest: float | None = np.inf
    for name, entry in entries.items():
        if name not in names:
            own = scene.simulation is not None and entries is getattr(scene.simulation, given)
            where = f"{scene.source}: simulation.{given}" if own else given
            raise SimulationError(
                f"{where}: there is no drive {name!r}; {choose_from(name, names)}"
            )
        i = names.index(name)
        if isinstance(entry, TableEffort):
            value_of = _csv_column(scene, entry.table, name, given)
            varying.append((i, _first_column(value_of.function)))
            breaks.append(value_of.breakpoints)
        elif isinstance(entry, SineEffort):
            varying.append((i, _sine(entry)))
            if finest is not None and entry.sine.angular_frequency:
                finest = min(finest, 1.0 / abs(entry.sine.angular_frequency))
        elif callable(entry):
            varying.append((i, entry if _takes_state(entry) else _of_time(entry)))
            finest = None
        else:
            number = _numbers(f"{given}[{name!r}]", entry)
            if number.shape != ():
                raise SimulationError(
                    f"{given}[{name!r}]: shape {number.shape}; should be a number, a function of "
                    "t or of (t, q, v), or the scene file's sine or table"
                )
            constant[i] = number

    def function(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        out = constant.copy()
        for i, value_of in varying:
            out[i] = value_of(t, q, v)
        return out

    return Effort(function, np.unique(np.concatenate(breaks)), finest)


def _sine(entry: SineEffort) -> EffortFunction:
    s = entry.sine
    return lambda t, q, v: s.amplitude * sin(s.angular_frequency * t + s.phase)


def _of_time(function: Callable[[float], Any]) -> EffortFunction:
    return lambda t, q, v: function(t)


def _takes_state(function: Callable[..., Any]) -> bool:
    """Whether a function takes (t, q, v), by three arguments without default; else it takes t."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # builtins need not have one: `math.sin` is of one number
        return False
    by_position = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(p.kind in by_position and p.default is p.empty for p in parameters) == 3


def _first_column(table: EffortFunction) -> EffortFunction:
    return lambda t, q, v: table(t, q, v)[0]


def _table(where: str, times: Any, values: Any, width: int) -> Effort:
    """Linear interpolation over time, constant beyond the ends; it bends at its rows."""
    t, u = _numbers(f"{where}: times", times), _numbers(f"{where}: values", values)
    if u.shape != (len(t), width) or len(t) == 0:
        raise SimulationError(
            f"{where}: values of shape {u.shape}; should be ({len(t)}, {width}): "
            "one row per time, one column per drive"
        )
    if (np.diff(t) <= 0).any():
        i = int(np.argmax(np.diff(t) <= 0)) + 1
        raise SimulationError(f"{where}: times do not increase at row {i} ({t[i]:g} s)")

    def function(time: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        i = int(t.searchsorted(time, side="right"))
        if i == 0 or i == len(t):
            return u[min(i, len(t) - 1)].copy()
        share = (time - t[i - 1]) / (t[i] - t[i - 1])
        return np.asarray((1 - share) * u[i - 1] + share * u[i])

    slope = np.vstack([np.zeros(width), np.diff(u, axis=0) / np.diff(t)[:, None], np.zeros(width)])
    bends = (np.abs(np.diff(slope, axis=0)) > 1e-12 * np.abs(slope).max(initial=0.0)).any(axis=1)
    return Effort(function, t[bends], np.inf)


def _csv_column(scene: Scene, table: str, name: str, given: str) -> Effort:
    """A column of a CSV file with a header `t, <drive>, ...`, as the scene file names it."""
    path = Path(scene.source).parent / table
    where = f"{scene.source}: simulation.{given}.{name}.table: {brief_path(path)}"
    _, header, rows = read_table(path, SimulationError, where)
    for column in ("t", name):
        if column not in header:
            raise SimulationError(
                f"{where}: has no column {column!r}; {choose_from(column, header)}"
            )
    try:
        picked = [
            [number_of(row[header.index(column)]) for column in ("t", name)]
            for _, row in rows
            if not row[0].startswith("#")
        ]
    except (ValueError, IndexError) as problem:
        raise SimulationError(f"{where}: {problem}") from None
    numbers = np.array(picked, dtype=float).reshape(-1, 2)
    return _table(where, numbers[:, 0], numbers[:, 1:], 1)


def _numbers(where: str, values: Any) -> np.ndarray:
    try:
        array = np.array(real_numbers(where, values))  # what the caller does to his later stays his
    except StateError as problem:
        raise StateError(
            f"{problem}, (times, values), a mapping by drive or a function of (t, q, v)"
        ) from None
    if impossible(array).any():
        raise SimulationError(f"{where}: holds NaN, Inf or more than {LARGEST_OF_A_MOTION:g}")
    return array
