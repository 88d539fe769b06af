"""The motion of a replay: where it is read, and with which drives."""

from __future__ import annotations

import os
from pathlib import Path

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.simulation.motion import Motion, scene_digests
from pinfric.dynamics.simulation.motion_file import load_motion
from pinfric.dynamics.simulation.simulate import simulate
from pinfric.errors import StateError, TrajectoryError
from pinfric.model.scene import Scene
from pinfric.motions.log.judged import JudgedLog, judge_log
from pinfric.motions.log.reading import ReadingOptions
from pinfric.motions.trajectory import load_trajectory
from pinfric.retiming.limits import DriveLimits, LimitsLike, limited_scene, read_limits


def motion_to_replay(
    scene: Scene,
    name: str | None = None,
    log: ReadingOptions = ReadingOptions(),  # noqa: B008
    effort_at: str = "reflected",
) -> tuple[InverseResult | Motion, JudgedLog | None]:
    """Return the motion of `pinfric replay SCENE [NAME]`, and how a log's own efforts fit it.

    Args:
        scene: the robot.
        name: a saved motion (.npz), a trajectory (log, CSV, way-points; a file or bundled), or
            None: the scene's own simulation.
        log: how a log is read.
        effort_at: what its efforts are, "reflected", "motor" or "joint" (`judge_log`).

    Raises:
        PinfricError: the file cannot be read or is of another scene; there is no simulation.
    """
    if name is None:
        return simulate(scene), None
    if Path(name).suffix.lower() == ".npz":
        if not os.path.isfile(name):
            raise TrajectoryError(f"there is no file {name}; `Motion.save` writes such files")
        return load_motion(name, scene), None
    trajectory = load_trajectory(name, scene, log)
    result, reading = inverse_dynamics(scene, trajectory), trajectory.reading
    return result, None if reading is None else judge_log(result, reading, effort_at)


def with_drives(
    scene: Scene, motion: InverseResult | Motion, limits: LimitsLike
) -> tuple[Scene, InverseResult, tuple[DriveLimits, ...]]:
    """Return scene and motion with the gears of given drives, and the drives' limits.

    Args:
        motion: of inverse dynamics.
        limits: of the drives, as `retime` takes them.

    Raises:
        StateError: a simulated motion; gears of a catalogue with external forces.
        RetimeError: impossible limits.
    """
    drive_limits = read_limits(scene, limits)
    geared = limited_scene(scene, drive_limits)
    if isinstance(motion, Motion) or (geared is not scene and motion.external):
        raise StateError(
            "replay: limits are for results of inverse dynamics, not for a "
            "simulation, and not for gears of a catalogue with external forces"
        )
    if geared is not scene:
        old = motion.states
        motion = inverse_dynamics(geared, old.q, old.v, old.a, t=old.t, attached=old.attached)
    return geared, motion, drive_limits


def check_same_scene(scene: Scene, motion: InverseResult | Motion) -> None:
    """Refuse a motion of another scene, which would move the wrong joints.

    Raises:
        StateError: says which parts of the scenes differ.
        SceneError: a `scene.model` was changed after its scene was made.
    """
    other = motion.scene
    scene.check_unchanged()
    other.check_unchanged()
    if other is scene:
        return
    drive_input = motion.given if isinstance(motion, Motion) else "effort"
    here, there = scene_digests(scene, drive_input), scene_digests(other, drive_input)
    differ = [key for key in here if here[key] != there[key]]
    if differ:
        raise StateError(
            f"replay: the motion is of another scene, {other.source}; {scene.source} differs in "
            f"{', '.join(differ)}"
        )
