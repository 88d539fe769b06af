"""Trajectories: what the joints do over time and what the robot carries meanwhile.

A file has one number per joint; `Trajectory` has Pinocchio's q (cos and sin of a continuous joint,
nothing of a mimic follower).
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pinfric.dynamics.inverse.result import runs
from pinfric.errors import PinfricError, PinfricWarning, TrajectoryError, choose_from
from pinfric.model.arrays import BoolArray, FloatArray, real_numbers
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.coordinates import WRENCH, from_angles
from pinfric.model.files import write_file
from pinfric.model.floating import POSE, base_numbers, base_rates
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION, impossible
from pinfric.model.robot import Robot
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.scene_file import find_file
from pinfric.model.yamlfile import path_of
from pinfric.motions.followers import find_followers, follower_problems, follower_warnings
from pinfric.motions.joint_columns import (
    JointColumn,
    configurations,
    joint_columns,
    limit_problems,
    listing,
    rates,
    refuse,
    single_positions,
    unit_circle_problems,
    velocity_warnings,
)
from pinfric.motions.log.formats.bags import is_bag
from pinfric.motions.log.frame import Log, Remarks
from pinfric.motions.log.reader import read_log
from pinfric.motions.log.reading import Reading, ReadingOptions
from pinfric.motions.loop_motion import complete_motion, named_columns
from pinfric.motions.table import TrajectoryTable, complete_derivatives
from pinfric.motions.tool_points import solve_tool_points
from pinfric.motions.waypoints import Rating, read_waypoints, sample_waypoints


class HasModel(Protocol):
    """What a trajectory needs of a scene."""

    @property
    def model(self) -> pin.Model:
        """The robot, locked joints removed."""

    @property
    def payloads(self) -> Mapping[str, Any]:
        """Name -> payload; its `attached` says if it is carried where nothing else says so."""


@dataclass(frozen=True)
class Hold:
    """All joints stand still (v = a = 0) from `start` to `end`, s; samples `first` to `last`."""

    start: float
    end: float
    first: int
    last: int


@dataclass(frozen=True)
class Trajectory:
    """Samples of a motion in Pinocchio's coordinates, samples first.

    Args:
        t: (T,) increasing, s.
        q: (T, nq) configurations.
        v: (T, nv) velocities, rad/s or m/s.
        a: (T, nv) accelerations, rad/s^2 or m/s^2.
        attached: (T, np) bool, which payload is carried at each sample; columns `payload_names`.
        payload_names: (np,) all payloads of the scene, in its order.
        joint_names: the joints in the model's order, mimic followers left out.
        external: frame -> (T, 6) measured wrench on it, in its axes at its origin (N, N m), which
            inverse dynamics takes where it is given none.
        source: where it came from, for messages.
        joint_nq: entries of q per joint in `joint_names` (2: continuous); default 1 each.
        warnings: what a person should look at (velocity limits exceeded, noisy derivatives).
        reading: how a file of samples was read; None for way-points and arrays.
        rating: whose motion it is, as `pinfric new --payload` writes it; None: of none.
        assembly: of closed loops, the start that a search chose for want of one, in words; nothing
            is signed with it. Empty: none was sought.

    Raises:
        TrajectoryError: no samples, shapes that do not agree, time not increasing, not finite.
    """

    t: FloatArray
    q: FloatArray
    v: FloatArray
    a: FloatArray
    attached: BoolArray
    payload_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    source: str
    joint_nq: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()
    reading: Reading | None = None
    rating: Rating | None = None
    assembly: str = ""
    external: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("t", "q", "v", "a"):
            where = f"{self.source}: {name}"
            array = np.atleast_1d(real_numbers(where, getattr(self, name), TrajectoryError))
            object.__setattr__(self, name, array)
        object.__setattr__(self, "attached", np.asarray(self.attached, dtype=bool))
        if not self.joint_nq:
            object.__setattr__(self, "joint_nq", (1,) * len(self.joint_names))
        count = self.t.size
        shapes = (
            ("t", self.t.shape, (count,)),
            ("q", self.q.shape[:1], (count,)),
            ("v", self.v.shape[:1], (count,)),
            ("a", self.a.shape, self.v.shape),
            ("attached", self.attached.shape, (count, len(self.payload_names))),
            *((f"external[{n!r}]", np.shape(w), (count, 6)) for n, w in self.external.items()),
        )
        wrong = [
            f"{name} has shape {shape} where {needed} is needed"
            for name, shape, needed in shapes
            if shape != needed
        ]
        refuse(
            self.source,
            wrong or _value_problems(self.t, (("q", self.q), ("v", self.v), ("a", self.a))),
        )

    @classmethod
    def from_arrays(
        cls,
        scene: HasModel,
        t: ArrayLike,
        q: ArrayLike,
        v: ArrayLike | None = None,
        a: ArrayLike | None = None,
        attached: Mapping[str, ArrayLike] | None = None,
        source: str = "trajectory",
        external: Mapping[str, ArrayLike] | None = None,
    ) -> Trajectory:
        """Make a trajectory of any model (planar and floating joints too) from arrays.

        Missing v or a come from splines, as in `load_trajectory`; that takes one-dof joints.

        Args:
            scene: its model and payloads.
            t, q: (T,) increasing, s; (T, nq).
            v, a: (T, nv), or None.
            attached: payload name -> (T,) bool or one bool; others as the scene's defaults.
            source: name for messages.
            external: see `Trajectory`.

        Raises:
            TrajectoryError: no scene; shapes, values, limits or names that do not fit; all at once.
        """
        if not isinstance(getattr(scene, "model", None), pin.Model):
            raise TrajectoryError(
                f"{source}: from_arrays(scene, t, q, ...): scene is a {type(scene).__name__}, "
                "which has no Pinocchio model; give the scene first"
            )
        model, payloads, carried = scene.model, _defaults(scene), attached or {}
        arrays = {
            name: real_numbers(f"{source}: {name}", array, TrajectoryError)
            for name, array in (("t", t), ("q", q), ("v", v), ("a", a))
            if array is not None or name in ("t", "q")
        }
        times = np.atleast_1d(arrays.pop("t"))
        rows, widths = times.size, {"q": model.nq, "v": model.nv, "a": model.nv}
        problems = [
            f"{name} has shape {array.shape}; the model needs (T, {'nq' if name == 'q' else 'nv'}) "
            f"= ({rows}, {widths[name]})"
            + (from_angles(model, array.shape[-1]) if name == "q" and array.ndim else "")
            for name, array in arrays.items()
            if array.shape != (rows, widths[name])
        ]
        problems += [
            f"attached: unknown payload {name!r}; {choose_from(name, payloads)}"
            for name in carried
            if name not in payloads
        ]
        problems += [
            f"attached: {name!r} has shape {np.shape(values)}; one bool or ({rows},) is needed"
            for name, values in carried.items()
            if np.shape(values) not in ((), (rows,))
        ]
        has_many = any(count > 1 for count in model.nvs)
        if has_many and len(arrays) < len(widths):
            problems.append("a planar, spherical or floating joint needs v and a given")
        refuse(source, problems or _value_problems(times, arrays.items()))
        if has_many:
            joints = zip(model.names, model.nqs, model.nvs, strict=True)
            moving = {name: int(nq) for name, nq, nv in joints if nv > 0}
            q, v, a = arrays.values()
            phases = _attached_columns(payloads, carried, rows)
            names, nqs, on = tuple(moving), tuple(moving.values()), _wrenches(source, external)
            of_payloads = phases, tuple(payloads)
            return cls(times, q, v, a, *of_payloads, names, source, nqs, external=on)
        columns = joint_columns(model, source)
        refuse(source, unit_circle_problems(columns, arrays["q"]))
        nothing = np.full((rows, model.nv), np.nan)
        table = TrajectoryTable(
            times,
            single_positions(arrays["q"], [column.nq for column in columns]),
            arrays.get("v", nothing),
            arrays.get("a", nothing),
            {name: np.asarray(values, dtype=bool) for name, values in carried.items()},
            np.zeros(len(columns)),
        )
        motion = _from_table(source, scene, columns, columns, table)
        return replace(motion, external=_wrenches(source, external))

    def __repr__(self) -> str:
        rate = (self.t.size - 1) / self.duration if self.duration else 0.0
        title = f"{file_name(self.source)}: {counted(self.t.size, 'sample')}, {self.duration:.4g} s"
        speeds = [f"{x:.3g}" for x in np.abs(self.v).max(axis=0)]
        one_each = len(speeds) == len(self.joint_names)
        carried = [f"{100 * x:.0f} % of samples" for x in self.attached.mean(axis=0)]
        return screen(
            "Trajectory",
            f"{title}, {rate:.4g} per s",
            {
                "joints": listed(self.joint_names),
                "speeds": f"{listed(self.joint_names, speeds)} (largest, rad/s or m/s)"
                if one_each
                else "",
                "holds": counted(len(self.holds()), "hold"),
                "carried": listed(self.payload_names, carried),
                "warnings": "; ".join(self.warnings),
            },
        )

    @property
    def duration(self) -> float:
        """From the first sample to the last, s."""
        return float(self.t[-1] - self.t[0])

    def joint_positions(self) -> FloatArray:
        """Return one number per joint: (T, number of joints), angles (unwrapped) or lengths.

        Raises:
            TrajectoryError: a joint with several degrees of freedom has no one number.
        """
        self._one_number_each(self.joint_nq)
        return single_positions(self.q, self.joint_nq)

    def _one_number_each(self, joint_nq: Sequence[int]) -> None:
        whole = sum(self.joint_nq) == self.q.shape[1]
        if any(nq not in (1, 2) for nq in joint_nq) or not whole:
            raise TrajectoryError(
                f"{self.source}: planar, spherical or floating joints have several positions; use q"
            )

    def with_speed(self, scale: float) -> Trajectory:
        """Return the same path `scale` times as fast: t / scale, v scale, a scale^2; no warnings.

        Raises:
            TrajectoryError: scale is not positive; forces were measured, at another speed.
        """
        if self.external:
            raise TrajectoryError(
                f"{self.source}: the forces on {listing(self.external)} were measured at one speed "
                "and are others at another; leave `external` out"
            )
        if not (np.isfinite(scale) and scale > 0.0):
            raise TrajectoryError(
                f"speed scale is {scale}; give a positive number (2: twice as fast)"
            )
        t = self.t[0] + (self.t - self.t[0]) / scale
        return replace(
            self,
            t=t,
            v=self.v * scale,
            a=self.a * scale**2,
            warnings=(),
            reading=None,
            rating=None,
            source=f"{self.source} at {scale:g} x speed",
        )

    def holds(self) -> tuple[Hold, ...]:
        """Return the intervals in which every joint stands still (v = a = 0), 2 samples or more."""
        still = ((self.v == 0.0) & (self.a == 0.0)).all(axis=1)
        return tuple(
            Hold(float(self.t[first]), float(self.t[last]), first, last)
            for first, last in runs(still)
            if last > first
        )

    def to_csv(self, path: str | Path, digits: int = 9) -> Path:
        """Write the file that `load_trajectory` reads, to `digits` significant digits (17: all).

        Continuous joints are written as unwrapped angles (the first within +-pi).

        Raises:
            TrajectoryError: a joint with several degrees of freedom; the file cannot be written.
        """
        names, single = self.joint_names, self.joint_nq
        q, v, a = self.q, self.v, self.a
        if base := self.joint_nq[:1] == (7,):
            names = *(f"{names[0]}.{part}" for part in POSE), *names[1:]
            numbers, single = base_numbers(q), single[1:]
            of_base = base_rates(numbers, v[:, :6], a[:, :6])
            v, a = (np.hstack([own, x[:, 6:]]) for own, x in zip(of_base, (v, a), strict=True))
        self._one_number_each(single)
        position = single_positions(q[:, 7 * base :], single)
        position = np.hstack([numbers, position]) if base else position
        header = ["t", *names, *(f"{n}.v" for n in names), *(f"{n}.a" for n in names)]
        header += [f"{n}.{part}" for n in self.external for part in WRENCH]
        header += [f"payload.{name}" for name in self.payload_names]
        # + 0.0 turns -0.0 into 0.0
        parts = self.t, position, v, a, *self.external.values()
        table = np.column_stack(parts) + 0.0
        formats = [f"%.{digits}g"] * table.shape[1] + ["%d"] * len(self.payload_names)
        rows = np.column_stack((table, self.attached.astype(np.float64)))

        def write(file: Path) -> None:
            np.savetxt(file, rows, fmt=formats, delimiter=",", header=",".join(header), comments="")

        try:
            return write_file(path, write)
        except PinfricError as problem:
            raise TrajectoryError(str(problem)) from None


def load_trajectory(
    path: str | Path | Log,
    scene: HasModel,
    options: ReadingOptions = ReadingOptions(),  # noqa: B008
) -> Trajectory:
    """Read a log, a table of samples or a way-point file (YAML, `waypoints`) and fit it to a scene.

    Samples (CSV, Parquet, a ROS 2 bag) have columns as `log.columns` recognises them; in our own
    format `t` (s) and `<joint>` (rad, m), optionally `<joint>.v`, `<joint>.a`, and
    `payload.<name>`, 1 where it is carried (default: as the scene says). Missing derivatives come
    from splines, holds have none (`derivatives`); noisy positions are low-passed first
    (`log.motion`).

    Args:
        path: the file, or a bag's folder; where there is none, the bundled one of that name; or the
            arrays of a log.
        scene: its model and payloads.
        options: what a person says about a log's columns, units and cutoff.

    Raises:
        TrajectoryError: everything wrong with the file, in one message. Velocities beyond the
            model's limits are only `warnings`.

    Warns:
        PinfricWarning: each of the trajectory's `warnings`: what was guessed, repaired or filtered.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> motion = pf.load_trajectory("pendulum", scene)
    >>> len(motion.t), motion.duration
    (2801, 2.8)
    """
    trajectory = read_trajectory(path, scene, options)
    for text in trajectory.warnings:
        warnings.warn(f"{trajectory.source}: {text}", PinfricWarning, stacklevel=2)
    return trajectory


def read_trajectory(
    path: str | Path | Log,
    scene: HasModel,
    options: ReadingOptions = ReadingOptions(),  # noqa: B008
) -> Trajectory:
    """Do what `load_trajectory` does, for callers that show its `warnings` themselves."""
    if not (hasattr(scene, "model") and hasattr(scene, "payloads")):
        expect_scene(scene, "load_trajectory")
    if isinstance(path, Log):
        source: Path | Log = path
        name = path.name
    else:
        if not (os.path.isdir(path_of(path, TrajectoryError)) and is_bag(Path(path))):
            path = find_file(path, (".csv", ".waypoints.yaml", ".yaml", ".yml"), TrajectoryError)
        source, name = Path(path), str(path)
    columns = joint_columns(scene.model, name, free_base=not getattr(scene, "loops", ()))
    if isinstance(source, Path) and source.suffix.lower() in (".yaml", ".yml"):
        if options.unit is not None:
            raise TrajectoryError(
                f"{name}: way-points state their own unit: write `unit: {options.unit}` in the "
                "file in place of --unit"
            )
        if options.columns is not None:
            raise TrajectoryError(
                f"{name}: --columns says which column of a log is what, and way-points have no "
                "columns: leave it out (their key `joints` names the joints)"
            )
        waypoints, problems, name = read_waypoints(source), list[str](), str(source)
        names = [c.name for c in columns] if waypoints.joints is None else waypoints.joints
        named = named_columns(scene, columns, names, problems)
        refuse(name, problems)
        waypoints, lines = solve_tool_points(waypoints, scene, columns, name)
        table = sample_waypoints(waypoints, named, _defaults(scene), name, lines)
        trajectory = _from_table(name, scene, columns, named, table)
        rating = waypoints.rating
        return trajectory if rating is None else replace(trajectory, rating=rating.itself)
    robot = getattr(scene, "robot", None)  # none of a model made in Python
    said, choose = Remarks(), partial(named_columns, scene, columns)
    locked, payloads = _locked(robot) if robot else {}, list(scene.payloads)
    frames = [frame.name for frame in scene.model.frames]
    read = source, columns, payloads, choose, options, said, locked, frames
    named, table, reading = read_log(*read)
    trajectory = _from_table(name, scene, columns, named, table, said.problems, reading.filtered)
    on = in_frames(scene.model, trajectory.q, reading.external, reading.world)
    notes = *reading.notes, *trajectory.warnings
    return replace(trajectory, reading=reading, warnings=notes, external=on)


def _locked(robot: Robot) -> dict[str, tuple[float, str]]:
    """Joint -> where the scene fixes it, and its unit, rad or m."""
    if not robot.locked:
        return {}
    kinds = {joint.get("name"): joint.get("type") for joint in robot.xml().findall("joint")}
    return {
        name: (place, "m" if kinds[name] == "prismatic" else "rad")
        for name, place in robot.locked.items()
    }


def _from_table(
    source: str,
    scene: HasModel,
    columns: Sequence[JointColumn],
    named: Sequence[JointColumn],
    table: TrajectoryTable,
    problems: Sequence[str] = (),
    filtered: bool = False,
) -> Trajectory:
    """Check limits, complete derivatives and make Pinocchio's q; raise with all that is wrong.

    `filtered`: derivatives come from each joint by itself, as those of splines do.
    """
    followers = find_followers(scene, columns)
    wrong = [*problems]
    for name in ("t", "position", "velocity", "acceleration"):
        array: FloatArray = getattr(table, name)  # not finite where derivatives are to come
        if (large := np.isfinite(array) & impossible(array)).any():
            wrong.append(f"{name}: {array[large][0]:g} is beyond {LARGEST_OF_A_MOTION:g}")
    wrong += limit_problems(named, table.t, table.position)
    if len(named) == len(columns):
        wrong += follower_problems(followers, columns, table.t, table.position)
    refuse(source, wrong)
    said: list[str] = []
    with np.errstate(all="ignore"):  # what overflows is found below, by what it comes to
        v, a = complete_derivatives(named, table, wrong, said)
    refuse(source, wrong or _value_problems(table.t, (("v", v), ("a", a))))
    v, a = rates(columns, table.position, v, a)
    assembly = ""
    if isinstance(scene, Scene) and scene.loops:
        derived = filtered or bool(
            np.isnan(table.velocity).any() or np.isnan(table.acceleration).any()
        )
        q, v, a, assembly = complete_motion(
            scene, source, columns, named, table.position, v, a, derived, said
        )
        moved = single_positions(q, [column.nq for column in columns])
        wrong = limit_problems(columns, table.t, moved)
        refuse(source, wrong + follower_problems(followers, columns, table.t, moved))
    else:
        q = configurations(columns, table.position, scene.model.nq)
    said += velocity_warnings(columns, table.t, v)
    said += follower_warnings(followers, table.t, v)
    return Trajectory(
        t=table.t,
        q=q,
        v=v,
        a=a,
        attached=_attached_columns(_defaults(scene), table.attached, table.t.size),
        payload_names=tuple(scene.payloads),
        **_joints(columns),
        source=source,
        warnings=tuple(said),
        assembly=assembly,
    )


def _joints(columns: Sequence[JointColumn]) -> dict[str, Any]:
    """Names and entries of q of the joints; a free base is one joint of 7."""
    single = [column for column in columns if not column.free]
    base = [column.name.rpartition(".")[0] for column in columns if column.free][:1]
    names = *base, *(column.name for column in single)
    return {"joint_names": names, "joint_nq": (*[7] * len(base), *(c.nq for c in single))}


def _wrenches(source: str, external: Mapping[str, ArrayLike] | None) -> dict[str, FloatArray]:
    return {
        name: np.atleast_2d(real_numbers(f"{source}: external[{name!r}]", wrench, TrajectoryError))
        for name, wrench in (external or {}).items()
    }


def in_frames(
    model: pin.Model, q: FloatArray, external: Mapping[str, FloatArray], world: Collection[str]
) -> dict[str, FloatArray]:
    """Return wrenches (T, 6) in the axes of their frames; those of `world` are in the world's.

    q: (T, nq).
    """
    data, turned = model.createData(), {name: wrench.copy() for name, wrench in external.items()}
    places = {name: model.getFrameId(name) for name in world if name in turned}
    for i in range(len(q) if places else 0):
        pin.forwardKinematics(model, data, q[i])
        for name, frame in places.items():
            R = pin.updateFramePlacement(model, data, frame).rotation
            turned[name][i] = np.concatenate([R.T @ turned[name][i, :3], R.T @ turned[name][i, 3:]])
    return turned


def _defaults(scene: HasModel) -> dict[str, bool]:
    return {name: bool(payload.attached) for name, payload in scene.payloads.items()}


def _attached_columns(
    payloads: Mapping[str, bool], carried: Mapping[str, ArrayLike], count: int
) -> BoolArray:
    attached = np.empty((count, len(payloads)), dtype=bool)
    for column, (name, default) in enumerate(payloads.items()):
        attached[:, column] = np.asarray(carried.get(name, default), dtype=bool)
    return attached


def _value_problems(t: FloatArray, arrays: Iterable[tuple[str, FloatArray]]) -> list[str]:
    if t.size == 0:
        return ["there are no samples"]
    problems = []
    for name, array in (("t", t), *arrays):
        if (wrong := impossible(array)).any():
            samples = np.unique(np.argwhere(wrong)[:, 0])
            finite = np.isfinite(array).all()
            what = f"beyond {LARGEST_OF_A_MOTION:g}" if finite else "not finite"
            problems.append(f"{name} is {what} at samples {listing(samples)}")
    back = np.flatnonzero(np.diff(t) <= 0)
    if back.size:
        problems.append(f"time must increase; it does not after samples {listing(back)}")
    return problems
