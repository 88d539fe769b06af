"""What a free base's six equations leave, where the forces on the robot are given.

    r = (M a + h - sum of J^T f)_base,   0 where forces and motion agree (paper eq. 16)

No drive acts there, so a measured force that is wrong by a few percent shows in r alone, and not in
the efforts of the joints' equations; r is reported, and its RMS has a limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.dynamics.samples.reactions import AppliedWrench, external_frame
from pinfric.dynamics.samples.states import States
from pinfric.errors import StateError
from pinfric.model.floating import stands
from pinfric.model.scene import Scene

#: Share of the weight, and of the weight times the base's height, that may be left (RMS).
LIMIT = 0.1
#: Samples at most on which the height is measured, and another reading of the forces tried.
_TRIED = 100


@dataclass(frozen=True)
class Balance:
    """What given forces leave of a free base's six equations.

    Attributes:
        residual: (T, 6) force and moment that would have to act on the base besides, in its axes
            at its origin (N, N m).
        weight: of the robot, N.
        height: distance of the base from the frames with forces, m.
    """

    residual: np.ndarray
    weight: float
    height: float

    @property
    def force(self) -> float:
        """RMS of the force, N."""
        return float(np.sqrt(np.mean(np.sum(self.residual[:, :3] ** 2, axis=1))))

    @property
    def moment(self) -> float:
        """RMS of the moment, N m."""
        return float(np.sqrt(np.mean(np.sum(self.residual[:, 3:] ** 2, axis=1))))

    @property
    def share(self) -> float:
        """The larger of force over weight, and moment over weight times height."""
        return max(self.force / self.weight, self.moment / (self.weight * self.height))

    @property
    def within(self) -> bool:
        """Whether `share` is at most `LIMIT`."""
        return self.share <= LIMIT


def base_rows(scene: Scene, external: object) -> list[int]:
    """Return the six velocities of an undriven free base whose forces are given; else none."""
    return list(range(6)) if external and stands(scene) else []


def balance_of(
    scene: Scene, states: States, applied: Sequence[AppliedWrench], residual: np.ndarray
) -> Balance:
    """Return what forces leave of the equations of a free base.

    Args:
        states: T samples. applied: on the robot. residual: (T, 6) of the base.
    """
    model, data = scene.model, scene.model.createData()
    weight = pin.computeTotalMass(model) * float(np.linalg.norm(model.gravity.linear))
    joints = {one.joint + 1 for one in applied if one.joint >= 0}
    heights = list[float]()
    for q in states.q[_some(len(states.q))]:
        pin.forwardKinematics(model, data, q)
        places = (data.oMi[1].actInv(data.oMi[j]).translation for j in joints)
        heights += [float(np.linalg.norm(place)) for place in places]
    return Balance(residual, max(weight, 1e-300), max(float(np.mean(heights or [0.0])), 1e-3))


def check_reading(
    scene: Scene, states: States, external: Mapping[str, np.ndarray], found: Balance
) -> None:
    """Refuse forces that do not balance the motion, but would if they were read otherwise.

    Args:
        states: T samples. external: frame -> (T, 6) or (6,) as given to `inverse_dynamics`.

    Raises:
        StateError: they would in the world's axes, or with the other sign.
    """
    if found.within:
        return
    places = _some(len(states.q))
    poses = _poses(scene, states.q[places], list(external))
    given = {n: np.broadcast_to(w, (len(states.q), 6))[places] for n, w in external.items()}
    asked = found.residual[places] + _on_base(poses, given)
    readings = {
        "in the axes of the world (`axes: world`)": (1.0, True),
        "with the other sign, as forces of the ground on the robot": (-1.0, False),
        "with the other sign and in the axes of the world": (-1.0, True),
    }
    for words, (sign, world) in readings.items():
        left = asked - sign * _on_base(poses, given, world)
        if Balance(left, found.weight, found.height).within:
            raise StateError(
                f"external: the forces on {', '.join(external)}, read in the axes of these frames, "
                f"leave {100 * found.share:.3g} % of the weight of {found.weight:.4g} N at the "
                f"base; {words} they would balance the motion: give them so"
            )


def _some(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, _TRIED)).astype(int))


def _poses(
    scene: Scene, q: np.ndarray, names: Sequence[str]
) -> list[list[tuple[pin.SE3, np.ndarray]]]:
    """Return by sample and frame its pose in the base, and the rotation of the world in it."""
    model, data, out = scene.model, scene.model.createData(), []
    frames = [external_frame(scene, name) for name in names]
    for row in q:
        pin.forwardKinematics(model, data, row)
        poses = [data.oMi[frame.parentJoint] * frame.placement for frame in frames]
        out.append([(data.oMi[1].actInv(pose), pose.rotation.T) for pose in poses])
    return out


def _on_base(
    poses: Sequence[Sequence[tuple[pin.SE3, np.ndarray]]],
    given: Mapping[str, np.ndarray],
    world: bool = False,
) -> np.ndarray:
    """Return the sum of the wrenches (n, 6) at the base, in its axes; `world`: read in the world's.

    given: frame -> (n, 6).
    """
    total = np.zeros((len(poses), 6))
    for i, row in enumerate(poses):
        for (pose, turn), wrench in zip(row, given.values(), strict=True):
            one = wrench[i]
            if world:
                one = np.concatenate([turn @ one[:3], turn @ one[3:]])
            total[i] += pose.toDualActionMatrix() @ one
    return total
