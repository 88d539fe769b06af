"""Logs as identification sees them: motion and effort, one column per joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import IdentificationError, choose_from
from pinfric.identification.standing import base_joints, left_at_base, motion_on_chain
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.couples import drive_rates, rate_rows
from pinfric.model.floating import stands
from pinfric.model.scene import Scene
from pinfric.motions.derivatives import SPLINE_GAINS
from pinfric.motions.log.frame import Log
from pinfric.motions.log.reading import Reading, ReadingOptions, Thinning
from pinfric.motions.trajectory import Trajectory, read_trajectory

#: What a log carries of which a person says that it carries nothing.
NO_PAYLOAD = "none"
#: rad/s or m/s: a joint that is never faster than this has not moved.
STILL = 0.01
#: Standard deviations beyond which a velocity is not noise.
_CLEAR = 3.0
#: Fewest samples that a low pass and a spline can use.
_FEWEST = 100
#: Hz: logs are thinned to 125 Hz, after a low pass of efforts and accelerations. The fit uses
#: far lower frequencies; break-aways are looked for in what this low pass leaves.
PEAK_PASS = 40.0
_THINNING = Thinning(125.0, PEAK_PASS)


@dataclass(frozen=True)
class Recording:
    """One log, read and filtered; columns are the joints', in the model's order.

    Attributes:
        step: s between samples.
        velocity, acceleration: (T, nv) of the drives; those of coupled drives are not their
            joints'.
        effort: (T, nv) measured, N m or N at the joint; NaN where there is none.
        noise: (nv,) standard deviation of the velocities, rad/s or m/s.
        rates: (nv, nv) S of `model.couples`, the identity without couples.
        left_at_base: see `standing.left_at_base`; 0 where the base is fixed.
    """

    name: str
    trajectory: Trajectory
    step: float
    velocity: FloatArray
    acceleration: FloatArray
    effort: FloatArray
    noise: FloatArray
    rates: FloatArray
    left_at_base: float = 0.0

    @cached_property
    def position(self) -> FloatArray:
        """(T, nv) of the drives, rad or m."""
        return np.asarray(self.trajectory.joint_positions() @ self.rates.T)

    @property
    def position_noise(self) -> FloatArray:
        """(nv,) standard deviation of the drives' positions, rad or m; 0: not known."""
        noise, joints = self.reading.noise, self.trajectory.joint_names
        own = np.array([noise.get(name, 0.0) for name in joints])
        return np.asarray(np.abs(self.rates) @ own)

    @property
    def unclear(self) -> FloatArray:
        """(nv,) speed up to which noise may move a drive that stands, rad/s or m/s."""
        return np.asarray(_CLEAR * self.noise)

    @property
    def slowest(self) -> FloatArray:
        """(nv,) speed below which noise or presliding decides, rad/s or m/s."""
        return np.maximum(STILL, self.unclear)

    @property
    def reading(self) -> Reading:
        """How the log was read."""
        assert self.trajectory.reading is not None
        return self.trajectory.reading

    @property
    def rests(self) -> BoolArray:
        """(T, nv) where a drive is held."""
        return (self.velocity == 0.0) & (self.acceleration == 0.0)

    @classmethod
    def of(
        cls,
        scene: Scene,
        name: str,
        trajectory: Trajectory,
        step: float,
        effort: FloatArray,
        noise: FloatArray,
    ) -> Recording:
        """Return a recording with the drives' velocities and accelerations."""
        v, a = trajectory.v, trajectory.a
        rates = rate_rows(scene.drives, scene.model.nv)
        if not np.array_equal(rates, np.eye(scene.model.nv)):
            v, a = (drive_rates(scene.drives, x, x[:, :0]) for x in (v, a))
        return cls(name, trajectory, step, v, a, effort, noise, rates)


def stick_velocity(scene: Scene, recordings: Sequence[Recording]) -> float:
    """Return the velocity (rad/s, m/s) up to which joints stick: the scene's, or more by noise."""
    unclear = max(float(recording.unclear.max()) for recording in recordings)
    return max(scene.stick_velocity, float(f"{min(unclear, STILL):.1e}"))


def check_scene(scene: Scene) -> None:
    """Refuse all but open chains with one drive per joint.

    Raises:
        IdentificationError: loops, drives off the joints, mimic joints, several degrees of freedom.
    """
    why = ""
    if scene.closed_by:
        why = f"this scene has {scene.closed_by}"
    elif len(scene.model.mimicking_joints):
        why = "here joints mimic others; lock them in the scene (robot: locked)"
    elif any(joint.nv != 1 for joint in tuple(scene.model.joints)[1 + stands(scene) :]):
        why = "here a joint has several degrees of freedom"
    if why:
        raise IdentificationError(
            f"{scene.source}: identification takes open chains with one drive per joint: {why}"
        )


def read_recordings(
    scene: Scene,
    logs: Sequence[str | Path | Log],
    gain: Mapping[str, float],
    payloads: Mapping[str, str],
    options: ReadingOptions,
    floating: Scene | None = None,
) -> tuple[Recording, ...]:
    """Read logs with measured efforts; arguments are those of `identify`.

    `floating`: the scene with the free base that six joints of `scene` stand for.

    Raises:
        IdentificationError: no log, one log twice, an effort that is missing, a log too short.
        TrajectoryError: a log cannot be read or does not fit the robot.
    """
    names = scene.joint_names
    for name in options.without:
        if name not in names:
            raise IdentificationError(
                f"without: there is no joint {name!r}; {choose_from(name, names)}"
            )
    if set(options.without) >= set(names):
        raise IdentificationError("without: names every joint, so nothing is left to identify")
    for name in gain:
        if name not in names:
            raise IdentificationError(
                f"gain: there is no joint {name!r}; {choose_from(name, names)}"
            )
        if not np.isfinite(gain[name]) or gain[name] == 0.0:
            raise IdentificationError(f"gain {name}={gain[name]:g}: should be finite, not zero")
    if not logs:
        raise IdentificationError("identification needs a log: a motion with measured efforts")
    recordings = [_read(scene, log, gain, options, floating) for log in logs]
    recordings = [
        replace(recording, name=_label(recordings, logs, number))
        for number, recording in enumerate(recordings)
    ]
    for recording, other in combinations(recordings, 2):
        if np.array_equal(recording.trajectory.q, other.trajectory.q) and np.array_equal(
            recording.effort, other.effort, equal_nan=True
        ):
            raise IdentificationError(
                f"{recording.name} and {other.name} are the same log: give it once"
            )
    carried = {
        str(log): recording.name
        for log, recording in zip(logs, recordings, strict=True)
        if not isinstance(log, Log)
    }
    carries = {carried.get(label, label): payload for label, payload in payloads.items()}
    labels = [recording.name for recording in recordings]
    for label in carries:
        if label not in labels:
            raise IdentificationError(
                f"payload: there is no log {label!r}; {choose_from(label, labels)}"
            )
    return tuple(
        _carrying(scene, recording, carries.get(recording.name)) for recording in recordings
    )


def _label(recordings: Sequence[Recording], logs: Sequence[str | Path | Log], number: int) -> str:
    """A log's name; where several have it, its path as given, or its number."""
    name, log = recordings[number].name, logs[number]
    if sum(recording.name == name for recording in recordings) == 1:
        return name
    return f"{name} ({number + 1})" if isinstance(log, Log) else str(log)


def _read(
    scene: Scene,
    log: str | Path | Log,
    gain: Mapping[str, float],
    options: ReadingOptions,
    floating: Scene | None,
) -> Recording:
    reads = replace(options, thinning=_THINNING, currents=frozenset(gain))
    trajectory = read_trajectory(log, floating or scene, reads)
    base, left = tuple[str, ...](), 0.0
    if floating is not None:
        base, moved = base_joints(floating), motion_on_chain(trajectory, floating)
        trajectory, left = moved, left_at_base(trajectory, floating)
    name, reading = Path(trajectory.source).name, trajectory.reading
    if reading is None:
        raise IdentificationError(f"{name}: holds way-points; a log has samples and efforts")
    if reading.samples < _FEWEST:
        raise IdentificationError(
            f"{name}: {reading.samples} samples can be used; at least {_FEWEST} are needed"
        )
    measured = [joint for joint in scene.joint_names if joint not in (*options.without, *base)]
    missing = [joint for joint in measured if joint not in reading.effort]
    if missing:
        raise IdentificationError(
            f"{name}: no measured effort of {', '.join(missing)}; name the columns by --columns "
            "FILE (currents with `effort_scale`, N m per A), convert currents by --gain (N m per "
            f"A), or leave their friction out: --without {','.join(missing)}"
        )
    effort = np.full((trajectory.t.size, len(scene.joint_names)), np.nan)
    for joint in measured:
        own = gain.get(joint, 1.0) * reading.effort[joint]
        effort[:, scene.joint_names.index(joint)] = own
    step = float(np.median(np.diff(trajectory.t)))
    if reading.uncertain is not None:
        noise = reading.uncertain.velocity
    else:
        noise = np.array([reading.noise.get(joint, 0.0) for joint in scene.joint_names])
        noise = noise * SPLINE_GAINS[0] / step
    noise[: len(base)] = 0.0  # no row is the base's
    noise = np.abs(rate_rows(scene.drives, noise.size)) @ noise
    # what is not used below would fill much of the memory
    trajectory = replace(trajectory, reading=replace(reading, effort={}, uncertain=None))
    if (stride := _THINNING.every(step)) > 1:
        # it was not filtered when it was read, and so not thinned there
        a = np.column_stack([_THINNING.acceleration(x, step)[::stride] for x in trajectory.a.T])
        effort = np.column_stack([_THINNING.effort(x, step)[::stride] for x in effort.T])
        thin: dict[str, Any] = {
            name: np.ascontiguousarray(getattr(trajectory, name)[::stride])
            for name in ("t", "q", "v", "attached")
        }
        forces = {
            name: np.column_stack([_THINNING.effort(x, step)[::stride] for x in wrench.T])
            for name, wrench in trajectory.external.items()
        }
        trajectory = replace(trajectory, a=a, external=forces, **thin)
    recording = Recording.of(scene, name, trajectory, stride * step, effort, noise)
    return replace(recording, left_at_base=left)


def _carrying(scene: Scene, recording: Recording, payload: str | None) -> Recording:
    if payload is None or (payload == NO_PAYLOAD and payload not in scene.payloads):
        return recording
    if payload not in scene.payloads:
        raise IdentificationError(
            f"payload: {scene.source} has no payload {payload!r}; "
            f"{choose_from(payload, [*scene.payloads, NO_PAYLOAD])}"
        )
    attached = np.zeros_like(recording.trajectory.attached)
    attached[:, list(scene.payloads).index(payload)] = True
    return replace(recording, trajectory=replace(recording.trajectory, attached=attached))
