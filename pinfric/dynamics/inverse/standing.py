"""Robots that stand where no forces at their feet are known: the range of each effort.

Forces f at the feet's contacts are inside friction, f = G c with c >= 0, and balance the free base
(paper eq. 16, the rows of the base; no drive acts there):

    A c = (M a + h)_base,     u = S^+ (M a + h - J^T G c)

A linear program at each sample finds the least and the greatest u of each drive over all such c.
One choice among them, the forces with the least sum of squares, is labelled as such. A cone of
friction is replaced by a pyramid of `SIDES` sides around it, which exceeds it by 2 % at its edges.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.problem.plan import drive_delivery
from pinfric.dynamics.samples.reactions import rigid_efforts
from pinfric.dynamics.samples.states import MotionLike, States, attached_columns
from pinfric.errors import SceneError, StateError
from pinfric.model.floating import stands
from pinfric.model.scene import Scene, expect_scene

#: Sides of the pyramid around a cone of friction.
SIDES = 16
#: m: feet whose heights differ by more stand on no common level ground.
LEVEL = 0.02
#: Share of the weight that the nearest forces may miss of the base's equations.
_BALANCED = 1e-6
#: Weight of these equations beside the forces' squares, in the search for the least forces.
_WEIGHT = 1e4


@dataclass(frozen=True)
class Standing:
    """What the joints of a robot that stands may have to deliver, its forces not being known.

    Attributes:
        external: foot -> (T, 6) the forces with the least sum of squares among all that balance the
            robot within friction, in the foot's axes at its origin (N, N m): one choice.
        result: inverse dynamics with these.
        effort_lower, effort_upper: (T, na) least and greatest effort of each drive over all such
            forces, with friction; exact where friction does not depend on load, else with that of
            the forces at the end.
        frictionless_lower, frictionless_upper: (T, na) the same without friction.
        lower_forces, upper_forces: foot -> (T, na, 6) the forces at these ends.
    """

    external: Mapping[str, np.ndarray]
    result: InverseResult
    effort_lower: np.ndarray
    effort_upper: np.ndarray
    frictionless_lower: np.ndarray
    frictionless_upper: np.ndarray
    lower_forces: Mapping[str, np.ndarray]
    upper_forces: Mapping[str, np.ndarray]


def needs_forces(scene: Scene, motion: MotionLike) -> bool:
    """Return whether a robot stands on its `feet`, and its motion brings no forces on them."""
    return bool(scene.feet) and not getattr(motion, "external", None)


def stand(
    scene: Scene, motion: MotionLike, progress: Callable[[int, int], None] | None = None
) -> Standing:
    """Return the range of each drive's effort over all forces at the feet within friction.

    Args:
        scene: whose base floats and has no drive, with `feet`, and without loops.
        motion: with all feet on the ground.
        progress: told how many samples of how many are done.

    Raises:
        SceneError: it does not float, has no `feet`, or has loops.
        StateError: feet at different heights; a sample that no forces within friction balance.
    """
    expect_scene(scene, "stand")
    _check(scene)
    attached = attached_columns(scene, motion)
    states = States.of(scene, motion.q, motion.v, motion.a, motion.t, attached)
    T, na, feet = len(states.q), len(scene.drives), list(scene.feet)
    least = {foot: np.empty((T, 6)) for foot in feet}
    ends = {foot: np.empty((2, T, na, 6)) for foot in feet}
    efforts = np.empty((2, T, na))
    P = drive_delivery(scene)
    for start, stop, carried in states.phases(scene):
        twin = scene.twin(carried)
        rigid = rigid_efforts(twin, *(x[start:stop] for x in (states.q, states.v, states.a)))[1]
        for i in range(start, stop):
            contacts = _Contacts(scene, states.q[i], i, motion)
            needed, A = rigid[i - start], contacts.on_joints
            c = contacts.least(needed[:6])
            bounds = contacts.ends(P @ A, needed[:6])
            efforts[:, i] = P @ needed - np.einsum("dg,edg->ed", P @ A, bounds)
            for foot, wrench in contacts.wrenches.items():
                least[foot][i] = wrench @ c
                ends[foot][:, i] = bounds @ wrench.T
            if progress is not None:
                progress(i + 1, T)
    result = inverse_dynamics(scene, motion, external=least)
    lower, upper = _with_friction(scene, states, ends)
    return Standing(
        external=least,
        result=result,
        effort_lower=lower,
        effort_upper=upper,
        frictionless_lower=efforts[0],
        frictionless_upper=efforts[1],
        lower_forces={foot: both[0] for foot, both in ends.items()},
        upper_forces={foot: both[1] for foot, both in ends.items()},
    )


def _with_friction(
    scene: Scene, states: States, ends: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return each drive's effort (T, na) under the forces at its least and its greatest one."""
    motion, found = (states.q, states.v, states.a), np.empty((2, len(states.q), len(scene.drives)))
    for d in range(len(scene.drives)):
        for end, name in enumerate(("effort_lower", "effort_upper")):
            on = {foot: np.ascontiguousarray(both[end, :, d]) for foot, both in ends.items()}
            one = inverse_dynamics(scene, *motion, on, t=states.t, attached=states.attached)
            found[end, :, d] = getattr(one, name)[:, d]
    return found[0], found[1]


def _check(scene: Scene) -> None:
    if not stands(scene):
        raise SceneError(
            f"{scene.source}: stand: the base does not float, or has drives: write `robot: "
            "{floating: true}`"
        )
    if not scene.feet:
        raise SceneError(
            f"{scene.source}: stand: write under `feet` on which links the robot stands, as `feet: "
            "{LINK: {mu: 0.6}}`"
        )
    if scene.linkage is not None:
        raise SceneError(
            f"{scene.source}: stand: a robot with loops needs the forces at its feet: give "
            "`external`"
        )


class _Contacts:
    """The feet's contacts at one sample; c (ng,) >= 0 are forces along their generators.

    Attributes:
        on_joints: (nv, ng) efforts J^T G. wrenches: foot -> (6, ng) in its axes at its origin.
        forces: (3 contacts, ng) in the world's axes.
    """

    def __init__(self, scene: Scene, q: np.ndarray, sample: int, motion: Any) -> None:
        model, data = scene.model, scene.model.createData()
        self.sample, self.motion, self.scene = sample, motion, scene
        pin.computeJointJacobians(model, data, q)
        gravity = np.asarray(model.gravity.linear)
        self.weight = pin.computeTotalMass(model) * float(np.linalg.norm(gravity))
        if not self.weight:
            raise StateError(f"{scene.source}: stand: without weight nothing holds a robot down")
        up = -gravity / np.linalg.norm(gravity)
        points = [(foot, p) for foot in scene.feet for p in _points(scene, foot)]
        count = SIDES * len(points)
        self.on_joints = np.empty((model.nv, count))
        self.forces = np.zeros((3 * len(points), count))
        self.wrenches = {foot: np.zeros((6, count)) for foot in scene.feet}
        heights: dict[str, float] = {}
        for k, (foot, p) in enumerate(points):
            frame = model.getFrameId(foot)
            pose = pin.updateFramePlacement(model, data, frame)
            J = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
            rays = _generators(up, scene.feet[foot].mu)
            local = pose.rotation.T @ rays
            here = slice(k * SIDES, (k + 1) * SIDES)
            wrench = np.vstack([local, np.cross(p, local.T).T])
            self.on_joints[:, here] = J.T @ wrench
            self.wrenches[foot][:, here] = wrench
            self.forces[3 * k : 3 * k + 3, here] = rays
            heights.setdefault(f"{foot} {p}", float(up @ pose.act(p)))
        self._check_level(heights)
        # moments about the base count by the distance of the feet
        scale = max(float(np.abs(self.on_joints[3:6]).max()), 1e-3)
        self.rows = 1.0 / np.array([1.0, 1.0, 1.0, scale, scale, scale])

    def _check_level(self, heights: Mapping[str, float]) -> None:
        low, high = min(heights, key=heights.__getitem__), max(heights, key=heights.__getitem__)
        if (gap := heights[high] - heights[low]) > LEVEL:
            names = high.partition(" ")[0], low.partition(" ")[0]
            what = f"{names[0]} is {gap:.3g} m above {names[1]}"
            if names[0] == names[1]:
                what = f"{names[0]} is tilted, by {gap:.3g} m over its sole"
            raise StateError(
                f"{self.where}: {what}: feet carry the robot on one level ground: correct the "
                "motion, leave a foot that is lifted out of the scene's `feet`, or give the forces"
            )

    @property
    def where(self) -> str:
        """Its file, sample and time, for messages."""
        t = self.motion.t
        time = "" if t is None else f" (t = {t[self.sample]:.4g} s)"
        return f"{getattr(self.motion, 'source', 'motion')}: sample {self.sample}{time}"

    def least(self, needed: np.ndarray) -> np.ndarray:
        """Return c with the least sum of squares of forces that meet the base's equations."""
        from scipy.optimize import nnls

        A, b = self.rows[:, None] * self.on_joints[:6], self.rows * needed
        stacked = np.vstack([_WEIGHT * A, self.forces])
        c = nnls(stacked, np.concatenate([_WEIGHT * b, np.zeros(len(self.forces))]))[0]
        used = c > 0.0
        c[used] += np.linalg.pinv(A[:, used]) @ (b - A @ c)  # what the weight left
        missed = float(np.linalg.norm(b - A @ c))
        if missed > _BALANCED * self.weight or c.min(initial=0.0) < -_BALANCED * self.weight:
            raise self._unbalanced()
        return np.maximum(c, 0.0)

    def ends(self, on_drives: np.ndarray, needed: np.ndarray) -> np.ndarray:
        """Return c (2, na, ng) at the least and greatest effort of each drive.

        on_drives: (na, ng) what c takes off the drives' efforts.
        """
        from scipy.optimize import linprog
        from scipy.sparse import block_diag

        A, b = self.rows[:, None] * self.on_joints[:6], self.rows * needed / self.weight
        na, count = on_drives.shape
        # the least effort takes off most; all programs are one, since they share nothing
        cost = np.concatenate([-on_drives, on_drives]).ravel()
        found = linprog(
            cost, A_eq=block_diag([A] * (2 * na), format="csr"), b_eq=np.tile(b, 2 * na)
        )
        if not found.success:
            raise self._unbalanced()
        return np.asarray(self.weight * found.x.reshape(2, na, count))

    def _unbalanced(self) -> StateError:
        return StateError(
            f"{self.where}: no forces within friction at {', '.join(self.scene.feet)} balance the "
            "robot there: it falls, slips or flies; correct the motion, `mu` or the soles, or give "
            "the forces"
        )


def _points(scene: Scene, foot: str) -> list[np.ndarray]:
    """Return the contacts of a foot in its frame, m: where it touches, or its sole's corners."""
    x, y = 0.5 * scene.feet[foot].length, 0.5 * scene.feet[foot].width
    corners = {(i * x, j * y, 0.0) for i in (-1, 1) for j in (-1, 1)}
    return [np.array(corner) + scene.feet[foot].xyz for corner in sorted(corners)]


def _generators(up: np.ndarray, mu: float) -> np.ndarray:
    """Return the edges (3, SIDES) of a pyramid around the cone of friction about `up`."""
    side = np.linalg.svd(up[None])[2][1:]  # two directions in the ground
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    slope = mu / np.cos(np.pi / SIDES)
    return np.asarray(up[:, None] + slope * side.T @ np.array([np.cos(angle), np.sin(angle)]))
