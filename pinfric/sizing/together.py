"""What joints share: a lowest frequency of the whole arm, and one drive for several joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinfric.drives.robot import carried
from pinfric.sizing.branch import SwingingArm, stiff_enough
from pinfric.sizing.drive_search import Assessment, DriveSearch, stiffness_of
from pinfric.sizing.task import Task


def together(
    task: Task, searches: Mapping[int, DriveSearch], own: Mapping[int, Assessment]
) -> dict[int, Assessment]:
    """Return the lightest drives that meet `lowest_frequency` and `same_drive`.

    Args:
        searches: of the drives at each joint. own: the lightest of each joint by itself.
    """
    taken = _stiff(task, dict(own), searches)
    return taken | _shared(task, taken, searches)


def _stiff(
    task: Task, taken: dict[int, Assessment], searches: Mapping[int, DriveSearch]
) -> dict[int, Assessment]:
    """Return the lightest set that swings no slower than `lowest_frequency`, or `taken`.

    Where the lightest drives swing fast enough they are that set.
    """
    wanted, scene = task.conditions.lowest_frequency, task.scene
    turning = [i for i in sorted(searches) if not searches[i].arrays.linear]
    if wanted is None or scene.loops or not turning:
        return taken
    others = {i: m for i, m in task.added(taken).items() if i not in turning}
    arm = _arm(task, turning, others, wanted)

    def entry(i: int, a: Assessment) -> tuple[float, float, float]:
        added = task.added({i: a}).get(i, 0.0) if carried(scene, i) else 0.0
        return a.mass or 0.0, stiffness_of(a), added

    if all(i in taken and taken[i].fits for i in turning):
        _, stiffness, added = np.array([entry(i, taken[i]) for i in turning]).T
        if not np.isnan(stiffness).any() and arm.swings(added, stiffness):
            return taken
    task.progress(f"drives that swing at {wanted:g} Hz together")
    fronts = [searches[i].front() for i in turning]
    if not all(fronts):
        return taken
    table = [[entry(i, a) for a in front] for i, front in zip(turning, fronts, strict=True)]
    picked, _ = stiff_enough(arm, table)
    if picked is None:
        return taken
    return taken | {i: front[p] for i, front, p in zip(turning, fronts, picked, strict=True)}


def _arm(
    task: Task, turning: Sequence[int], others: Mapping[int, float], frequency: float
) -> SwingingArm:
    robot, scene = task.robot, task.scene
    states = robot.base.result.states
    poses = np.flatnonzero(np.append(True, (states.q[1:] != states.q[:-1]).any(axis=1)))
    own = [scene.drives[i].velocity_index for i in turning]
    still = robot.mass_matrices(others, poses)
    per_mass = np.zeros((len(turning), len(poses), len(own), len(own)))
    for k, i in enumerate(turning):
        if carried(scene, i):
            more = robot.mass_matrices({**others, i: 1.0}, poses) - still
            per_mass[k] = more[:, own][:, :, own]
    return SwingingArm(still[:, own][:, :, own], per_mass, frequency)


def _shared(
    task: Task, taken: Mapping[int, Assessment], searches: Mapping[int, DriveSearch]
) -> dict[int, Assessment]:
    """Return the lightest motor and gear of each group of `same_drive` that fits all its joints."""
    shared: dict[int, Assessment] = {}
    for group in task.conditions.same_drive:
        own = [i for i in map(task.scene.actuator_names.index, group) if i in searches]
        if not own:
            continue
        heaviest = max(own, key=lambda i: taken[i].mass or 0.0 if i in taken else 0.0)
        for _, _, *drive in searches[heaviest].offers():
            judged = {i: searches[i].judge(*drive) for i in own}
            banned = {a.name for a in judged.values()} & {
                name for i in own for name in searches[i].parts.banned
            }
            if all(a.fits for a in judged.values()) and not banned:
                shared |= judged
                break
    return shared
