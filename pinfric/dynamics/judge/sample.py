"""One sample of a result: everything as an affine function of its friction, in plain NumPy.

    M a + h - J_ext^T f_ext = S^T u + P y + D phi,    w_k = w_k0 + W_k phi

P are the columns of the loops' multipliers and of undriven coordinates. An orthonormal basis of the
motions that they allow (SVD) eliminates them; the rest is least squares. Jacobians are Pinocchio's
joint Jacobians, wrenches `data.f` of its RNEA; no kernel, no twin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.judge.plain_laws import plain_displacement, plain_load_terms
from pinfric.dynamics.samples.outcome import SolvedMotion
from pinfric.model.scene import Scene, Site

#: Entries of a map this small beside its largest are rounding.
_ROUNDING = 1e-13
#: Singular values this small beside the largest are 0.
_RANK = 1e-12


class Pair(NamedTuple):
    """Where a wrench of link a on link b acts, at one sample.

    Attributes:
        a, b: joint ids of the two links, 0 for the ground.
        at: (3,) the place, world. frame: (3, 3) of b; of a cylinder with its line as z.
        direction: (6,) unit wrench of a drive, world axes at `at`; of a universal its moment about
            the common normal of both axes.
    """

    a: int
    b: int
    at: np.ndarray
    frame: np.ndarray
    direction: np.ndarray

    def in_world(self, wrench: np.ndarray) -> np.ndarray:
        """Return a wrench (6,) given in frame b in the world's axes."""
        return (self.frame @ wrench.reshape(2, 3, 1)).ravel()

    def in_frame(self, wrench: np.ndarray) -> np.ndarray:
        """Return a wrench (6,) given in the world's axes in frame b."""
        return (wrench.reshape(2, 3) @ self.frame).ravel()


class Action(NamedTuple):
    """A unit action: its effort (nv,), and the wrench (6,) in world axes if it acts at a pair."""

    effort: np.ndarray
    pair: Pair | None = None
    wrench: np.ndarray = np.zeros(6)


@dataclass(frozen=True)
class SampleMaps:
    """Everything of one sample as an affine function of its friction: [..., 0] + [..., 1:] phi.

    Attributes:
        effort: (na, 1 + ne) of the drives; the sum of u^2 / share is least.
        multipliers: (number of loops, 6, 1 + ne) in frame b; least squares where they are not
            unique (`Scene.redundancy_length`).
        wrench: (ns, 6, 1 + ne) at the sites.
        contact: (nt, 3, 1 + ne) weighted contact forces whose sizes add up to loads.
        owner: (nt,) site of each. constant: (ns,) constant part of each load.
        entry_site: (ne,) site of each friction coordinate.
        total, D: (nv,), (ne, nv) what must be balanced, and what unit friction contributes.
        missed: how far the frictionless efforts are from balancing the motion.
        regular: smallest singular value that must not be 0, relative to the largest.
        scale: of the wrenches at joints of the tree (N or N m).
    """

    effort: np.ndarray
    multipliers: np.ndarray
    wrench: np.ndarray
    contact: np.ndarray
    owner: np.ndarray
    constant: np.ndarray
    entry_site: np.ndarray
    total: np.ndarray
    D: np.ndarray
    missed: float
    regular: float
    scale: float

    def loads(self, phi: np.ndarray) -> np.ndarray:
        """Return (ns,) the loads under friction (ne,)."""
        size = np.linalg.norm(self.contact @ np.append(1.0, phi), axis=1)
        return self.constant + np.bincount(self.owner, size, len(self.constant))


class JudgedSample:
    """One sample of a result, with Pinocchio's joint Jacobians and all pairs by name.

    Args:
        result, i: which.
        model: with the payloads of this sample.
        q: (nq,) another configuration than the sample's.
    """

    def __init__(
        self, result: SolvedMotion, model: pin.Model, i: int, q: np.ndarray | None = None
    ) -> None:
        states, self.scene = result.states, result.scene
        self.result, self.i, self.model, self.data = result, i, model, model.createData()
        self.q, self.v, self.a = states.q[i] if q is None else q, states.v[i], states.a[i]
        pin.computeJointJacobians(model, self.data, self.q)
        self.pairs = _pairs(self.scene, model, self.data)

    def at(self, pair: Pair, wrench: np.ndarray) -> Action:
        """Return the action of a wrench (6,), world axes at the pair's place, on b, not on a."""
        total = np.zeros(self.model.nv)
        for joint, sign in ((pair.b, 1.0), (pair.a, -1.0)):
            if joint:
                J = pin.getJointJacobian(
                    self.model, self.data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
                )
                arm = pair.at - self.data.oMi[joint].translation
                total += sign * (wrench @ J + wrench[:3] @ pin.skew(arm).T @ J[3:])
        return Action(total, pair, wrench)

    def frictions(self, site: Site) -> list[Action]:
        """Return unit friction along every coordinate of a site."""
        if site.pair < 0:
            return [Action(site.ratio * np.eye(self.model.nv)[site.velocity_index])]
        pair, along = self.pairs[site.name], np.eye(3) if site.ball else site.axis[None]
        units = np.hstack([along, 0 * along] if site.sliding else [0 * along, along])
        return [self.at(pair, pair.in_world(unit)) for unit in units]

    def velocity(self, site: Site) -> np.ndarray:
        """(1,) relative velocity of a site, (3,) in frame b for a ball."""
        return np.array([action.effort @ self.v for action in self.frictions(site)])

    def drives(self) -> list[Action]:
        """Return unit efforts of the drives."""
        out = []
        for drive in self.scene.drives:
            if drive.velocity_index < 0:
                out.append(self.at(self.pairs[drive.name], self.pairs[drive.name].direction))
                continue
            row = np.eye(self.model.nv)[drive.velocity_index]
            row[[v for v, _ in drive.couples]] = [factor for _, factor in drive.couples]
            out.append(Action(row))
        return out

    def drive_rates(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (na,) rate of what each drive moves, by duality S v, and its derivative.

        S of drives on joints is constant; else four differences along the motion give dS/dt.
        """
        S, size = _rows(self.drives(), self.model.nv), _size(self.scene)
        fastest, slope = float(np.abs(self.v).max(initial=0.0)), S @ self.a
        if fastest == 0.0 or all(drive.velocity_index >= 0 for drive in self.scene.drives):
            return S @ self.v, slope
        h, slope = 1e-3 * size / fastest, np.zeros(len(S))
        for steps, weight in ((1, 8), (-1, -8), (2, -1), (-2, 1)):
            there = pin.integrate(self.model, self.q, steps * h * self.v)
            moved = JudgedSample(self.result, self.model, self.i, there).drives()
            rate = _rows(moved, self.model.nv) @ (self.v + steps * h * self.a)
            slope += weight * rate / (12.0 * h)
        return S @ self.v, slope

    def multipliers(self) -> list[Action]:
        """Return unit multipliers of the loops."""
        linkage, out = self.scene.linkage, []
        if linkage is None:
            return []
        for c in range(linkage.off_joint, linkage.off_joint + linkage.multipliers):
            loop = self.scene.loops[linkage.column_pair[c]]
            pair, unit = self.pairs[loop.name], linkage.unit[c]
            turns = loop.kind == "universal" and unit[3:].any()
            out.append(self.at(pair, pair.direction if turns else pair.in_world(unit)))
        return out

    def given(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (nv,) M a + h - J^T f_ext and (nj, 6) `data.f`."""
        forces, work = pin.StdVec_Force(), self.model.createData()
        forces.extend([pin.Force.Zero() for _ in range(self.model.njoints)])
        for applied in self.result.external:
            forces[applied.joint + 1] += pin.Force(applied.wrench[self.i])
        total = pin.rnea(self.model, work, self.q, self.v, self.a, forces)
        return total, np.array([f.vector for f in work.f][1:]).reshape(-1, 6)

    def carried(self, action: Action) -> np.ndarray:
        """(nj, 6) how an action changes the wrench of every joint that carries one of its links."""
        out = np.zeros((self.model.njoints - 1, 6))
        if action.pair is None:
            return out
        carries, pair, force = np.zeros(self.model.njoints), action.pair, action.wrench[:3]
        for joint, sign in ((pair.b, 1.0), (pair.a, -1.0)):
            carries[list(self.model.supports[joint])] += sign
        about_origin = pin.Force(force, action.wrench[3:] + pin.skew(pair.at) @ force)
        for row in np.flatnonzero(carries[1:]):
            out[row] = -carries[row + 1] * self.data.oMi[int(row) + 1].actInv(about_origin).vector
        return out

    def maps(self) -> SampleMaps:
        """Return the sample's maps."""
        scene, nv = self.scene, self.model.nv
        total, given = self.given()
        drives, multipliers = self.drives(), self.multipliers()
        each = [self.frictions(site) for site in scene.sites]
        frictions = [action for actions in each for action in actions]
        S, D, undriven = _rows(drives, nv), _rows(frictions, nv), list(scene.mobility.undriven)
        P = np.vstack([np.eye(nv)[undriven], _rows(multipliers, nv)]).T
        right = np.column_stack([total, -D.T])
        basis, size, across = np.linalg.svd(P) if P.size else (np.eye(nv), np.zeros(0), P[:0])
        rank = int((size > _RANK * size.max(initial=0.0)).sum())
        free, loose = basis[:, rank:].T, across[rank:].T
        root = np.sqrt([drive.share or 1.0 for drive in scene.drives])
        reduced = free @ S.T * root
        effort = root[:, None] * np.linalg.lstsq(reduced, free @ right, rcond=_RANK)[0]
        y = np.linalg.lstsq(P, right - S.T @ effort, rcond=_RANK)[0][len(undriven) :]
        loose = loose[:, np.abs(loose[: len(undriven)]).max(axis=0, initial=0.0) < 1e-9]
        loose = loose[len(undriven) :]
        actions, none = [*drives, *frictions, *multipliers], np.eye(1, right.shape[1])[0]
        acting = np.vstack([effort, np.eye(right.shape[1])[1:], y])
        wrenches = self._reactions(actions, acting)
        wrenches[: len(given)] += given[:, :, None] * none
        if loose.shape[1]:  # the least sum |F|^2 + |M/l|^2 over all joints, the loops' too
            more = self._reactions(multipliers, loose)
            weight = np.repeat([1.0, 1.0 / scene.redundancy_length], 3)[:, None]
            flat, now = ((weight * w).reshape(-1, w.shape[2]) for w in (more, wrenches))
            change = np.linalg.lstsq(flat, now, rcond=_RANK)[0]
            wrenches -= more @ change
            y -= loose @ change
            acting[-len(y) :] = y
        at_sites = [
            wrenches[site.joint]
            if site.pair < 0
            else _at_pair(self.pairs[site.name], actions, acting)
            for site in scene.sites
        ]
        site_wrench = np.array(at_sites).reshape(-1, 6, right.shape[1])
        sizes = np.linalg.svd(reduced, compute_uv=False) if reduced.size else np.ones(1)
        regular = float(size[:rank].min(initial=1.0) / max(size.max(initial=1.0), 1e-300))
        least = sizes[: len(free)].min(initial=np.inf) / max(sizes[0], _size(scene))
        missed = free @ (S.T @ effort[:, 0] - total)
        return SampleMaps(
            effort,
            self._loops(multipliers, y),
            site_wrench,
            *_contacts(self, site_wrench),
            np.repeat(np.arange(len(each)), [len(actions) for actions in each]),
            total,
            D,
            float(np.abs(missed).max(initial=0.0)),
            min(regular, float(least)) if len(free) <= len(drives) else 0.0,
            float(np.abs(given).max(initial=0.0)),
        )

    def _loops(self, actions: Sequence[Action], x: np.ndarray) -> np.ndarray:
        """(number of loops, 6, columns) of a on b in frame b."""
        loops = [_at_pair(self.pairs[loop.name], actions, x) for loop in self.scene.loops]
        return np.array(loops).reshape(-1, 6, x.shape[1])

    def _reactions(self, actions: Sequence[Action], x: np.ndarray) -> np.ndarray:
        """(nj + number of loops, 6, columns) the wrenches that actions x (n, columns) cause."""
        joints = np.zeros((self.model.njoints - 1, 6, x.shape[1]))
        for action, row in zip(actions, x, strict=True):
            if action.pair is not None:
                joints += self.carried(action)[:, :, None] * row
        return np.concatenate([joints, self._loops(actions, x)])


def _size(scene: Scene) -> float:
    """The least lever that counts (m)."""
    return 1.0 if scene.linkage is None else min(1.0, scene.linkage.size)


def _rows(actions: Sequence[Action], nv: int) -> np.ndarray:
    return np.array([action.effort for action in actions]).reshape(-1, nv)


def _at_pair(pair: Pair, actions: Sequence[Action], x: np.ndarray) -> np.ndarray:
    """(6, columns) all that acts at one pair, in its frame."""
    total = np.zeros((6, x.shape[1]))
    for action, row in zip(actions, x, strict=True):
        if action.pair is pair:
            total += np.outer(pair.in_frame(action.wrench), row)
    return total


def _contacts(
    sample: JudgedSample, wrench: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contact forces (nt, 3, 1 + ne), their sites (nt,), constant parts of loads (ns,)."""
    scene, slope = sample.scene, wrench[:, :, 1:]
    forces, owner, constant = [], [], np.zeros(len(scene.sites))
    noise = _ROUNDING * max(1.0, float(np.abs(slope).max(initial=0.0)))
    slope[np.abs(slope) < noise] = 0.0
    for s, site in enumerate(scene.sites):
        moved = plain_displacement(scene, site, sample.q) if site.pair < 0 else 0.0
        maps, constant[s] = plain_load_terms(site, moved)
        for B in maps:
            force = B @ wrench[s]
            part = np.abs(B) @ np.abs(wrench[s])
            force[:, 1:][np.abs(force[:, 1:]) < _ROUNDING * part[:, 1:]] = 0.0
            forces.append(force)
            owner.append(s)
    shape = (-1, 3, wrench.shape[2])
    return np.array(forces).reshape(shape), np.array(owner, dtype=int), constant


def _pairs(scene: Scene, model: pin.Model, data: pin.Data) -> dict[str, Pair]:
    """All pairs of one sample by name, from the scene's own entries."""
    pairs, still = {}, np.zeros(3)

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
        direction = np.concatenate([axis, still] if loop.kind == "prismatic" else [still, axis])
        pairs[loop.name] = Pair(a, b, pose.translation, pose.rotation, direction)
    for actuator in scene.actuators or ():
        if actuator.cylinder is not None:
            a, start = place(actuator.cylinder.a.link, actuator.cylinder.a.xyz)
            b, end = place(actuator.cylinder.b.link, actuator.cylinder.b.xyz)
            line = end.translation - start.translation
            line /= np.linalg.norm(line)
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), line).matrix()
            direction = np.concatenate([line, still])
            pairs[actuator.cylinder.name] = Pair(a, b, end.translation, turn, direction)
        elif actuator.force is not None:
            force = actuator.force
            b, pose = place(force.link, force.xyz)
            along = pose.rotation @ np.array(force.direction) / np.linalg.norm(force.direction)
            direction = np.concatenate([along, still])
            pairs[force.name] = Pair(0, b, pose.translation, pose.rotation, direction)
        elif actuator.joint in pairs:  # of a loop, under the drive's own name
            pairs[actuator.drive_name] = pairs[actuator.joint]
    return pairs
