"""The judge's data of one sample: where loops, cylinders and forces act, and on which links.

Jacobians are Pinocchio's joint Jacobians, wrenches `data.f` of its RNEA; no kernel, no twin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.dynamics.samples.outcome import SolvedMotion
from pinfric.model.scene import Scene, Site


@dataclass(frozen=True)
class Pair:
    """A wrench of side a on side b: its place and its links, at one sample.

    Attributes:
        name: of the loop or the drive.
        a, b: joint ids of the two links, 0 for the ground.
        at: (3,) where it acts, world. frame: (3, 3) frame b. direction: (6,) unit wrench of a
            drive in the world's axes at `at`; of a loop along what moves, of a universal about
            the common normal of its axes.
        along_line: whether it is a cylinder, along whose line its friction acts, too.
    """

    name: str
    a: int
    b: int
    at: np.ndarray
    frame: np.ndarray
    direction: np.ndarray
    along_line: bool = False

    def in_world(self, wrench: np.ndarray) -> np.ndarray:
        """Return a wrench (6,) given in frame b in the world's axes."""
        return np.concatenate([self.frame @ wrench[:3], self.frame @ wrench[3:]])

    def in_frame(self, wrench: np.ndarray) -> np.ndarray:
        """Return a wrench (6,) given in the world's axes in frame b."""
        return np.concatenate([wrench[:3] @ self.frame, wrench[3:] @ self.frame])

    def on_link(self, data: pin.Data, joint: int, wrench: np.ndarray) -> pin.Force:
        """Return a wrench (6,) on side b (world axes, at `at`) in a joint's own frame."""
        moment = wrench[3:] + np.cross(self.at, wrench[:3])  # about the world's origin
        return data.oMi[joint].actInv(pin.Force(wrench[:3], moment))


@dataclass(frozen=True)
class Sample:
    """One sample of a result, with Pinocchio's joint Jacobians and all pairs by name.

    Attributes:
        result, i: which.
        model, data: with the payloads of this sample, Jacobians computed.
        pairs: loops and drives off the joints.
    """

    result: SolvedMotion
    i: int
    model: pin.Model
    data: pin.Data
    pairs: dict[str, Pair]

    @classmethod
    def of(
        cls,
        result: SolvedMotion,
        model: pin.Model,
        data: pin.Data,
        i: int,
        q: np.ndarray | None = None,
    ) -> Sample:
        """Place everything at the sample's configuration, or at another q (nq,)."""
        pin.computeJointJacobians(model, data, result.states.q[i] if q is None else q)
        return cls(result, i, model, data, _pairs(result.scene, model, data))

    @property
    def scene(self) -> Scene:
        """The scene that was solved."""
        return self.result.scene

    @property
    def motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(nq,), (nv,), (nv,): q, v, a."""
        s = self.result.states
        return s.q[self.i], s.v[self.i], s.a[self.i]

    def external(self) -> list[pin.Force]:
        """Return the external wrench on each link, in its joint's frame."""
        forces = [pin.Force.Zero() for _ in range(self.model.njoints)]
        for applied in self.result.external:
            forces[applied.joint + 1] += pin.Force(applied.wrench[self.i])
        forces[0] = pin.Force.Zero()
        return forces

    def rnea(self, forces: list[pin.Force]) -> tuple[np.ndarray, np.ndarray]:
        """Return (nv,) M a + h - J^T f and (nj, 6) `data.f` under forces on the links."""
        vector, work = pin.StdVec_Force(), self.model.createData()
        vector.extend(forces)
        total = pin.rnea(self.model, work, *self.motion, vector)
        return total, np.array([f.vector for f in work.f][1:]).reshape(-1, 6)

    def generalized(self, pair: Pair, wrench: np.ndarray) -> np.ndarray:
        """(nv,) effort of a wrench (world, at the pair's place) on b and its opposite on a."""
        total = np.zeros(self.model.nv)
        for joint, sign in ((pair.b, 1.0), (pair.a, -1.0)):
            if joint:
                J = pin.getJointJacobian(
                    self.model, self.data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
                )
                arm = pair.at - self.data.oMi[joint].translation
                moment = wrench[3:] + np.cross(arm, wrench[:3])
                total += sign * (J[:3].T @ wrench[:3] + J[3:].T @ moment)
        return total

    def friction_in_world(self, site: Site, phi: np.ndarray) -> np.ndarray:
        """(6,) friction of a on b, world axes, at the pair's place; a cylinder's is on its line."""
        pair = self.pairs[site.name]
        if pair.along_line:
            return phi[0] * pair.direction
        return pair.in_world(pair_friction(site, phi))

    def velocity(self, site: Site) -> np.ndarray:
        """(1,) relative velocity of a site, (3,) in frame b for a ball."""
        v = self.motion[1]
        if site.pair < 0:
            return np.array([site.ratio * v[site.velocity_index]])
        units = np.eye(3) if site.ball else np.ones((1, 1))
        wrenches = [self.friction_in_world(site, unit) for unit in units]
        return np.array(
            [self.generalized(self.pairs[site.name], wrench) @ v for wrench in wrenches]
        )


def pair_friction(site: Site, phi: np.ndarray) -> np.ndarray:
    """(6,) friction of a on b in frame b, of a cylinder in axes whose z is its line."""
    along = phi if site.ball else phi[0] * site.axis
    none = np.zeros(3)
    return np.concatenate([along, none] if site.sliding else [none, along])


def _pairs(scene: Scene, model: pin.Model, data: pin.Data) -> dict[str, Pair]:
    """All pairs of one sample by name, from the scene's own entries."""
    pairs = {}

    def place(link: str, xyz: tuple[float, ...], rpy: tuple[float, ...] = (0.0, 0.0, 0.0)):  # type: ignore[no-untyped-def]
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        local = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
        return frame.parentJoint, data.oMi[frame.parentJoint] * frame.placement * local

    for loop in scene.loops:
        a, start = place(loop.a.link, loop.a.xyz, loop.a.rpy)
        b, pose = place(loop.b.link, loop.b.xyz, loop.b.rpy)
        axis = pose.rotation @ np.array(loop.axis) / np.linalg.norm(loop.axis)
        if loop.kind == "universal":
            axis = np.cross(start.rotation @ loop.axis, pose.rotation @ loop.axis_b)
            axis /= np.linalg.norm(axis)
        still = np.zeros(3)
        direction = np.concatenate([axis, still] if loop.kind == "prismatic" else [still, axis])
        pairs[loop.name] = Pair(loop.name, a, b, pose.translation, pose.rotation, direction)
    for actuator in scene.actuators or ():
        if actuator.cylinder is not None:
            a, start = place(actuator.cylinder.a.link, actuator.cylinder.a.xyz)
            b, end = place(actuator.cylinder.b.link, actuator.cylinder.b.xyz)
            line = end.translation - start.translation
            direction = np.concatenate([line / np.linalg.norm(line), np.zeros(3)])
            name = actuator.cylinder.name
            pairs[name] = Pair(name, a, b, end.translation, end.rotation, direction, True)
        elif actuator.force is not None:
            force = actuator.force
            b, pose = place(force.link, force.xyz)
            along = np.array(force.direction) / np.linalg.norm(force.direction)
            direction = np.concatenate([pose.rotation @ along, np.zeros(3)])
            pairs[force.name] = Pair(force.name, 0, b, pose.translation, pose.rotation, direction)
        elif actuator.joint in pairs:  # of a loop, under the drive's own name
            pairs[actuator.drive_name] = pairs[actuator.joint]
    return pairs
