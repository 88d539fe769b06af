"""One sample of a result: everything as an affine function of its friction, in plain NumPy.

    M a + h - J_ext^T f_ext = S^T u + P y + D phi,    w_k = w_k0 + W_k phi

P: columns of the loops' multipliers and of undriven coordinates. An orthonormal basis of the
motions that they allow (SVD) eliminates them; they follow by least squares. Jacobians are
Pinocchio's joint Jacobians, wrenches `data.f` of its RNEA; no kernel, no twin.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from judges.plain_laws import plain_displacement, plain_load_terms

from pinfric.dynamics.samples.outcome import SolvedMotion
from pinfric.model.scene import Scene, Site

#: Entries of a map this small beside its largest are rounding.
_ROUNDING = 1e-13
#: Singular values this small beside the largest are 0.
_RANK = 1e-12
#: Step of differences along the motion, as a share of the least lever.
_STEP = 1e-5


class Pair(NamedTuple):
    """Where a wrench of link a on link b acts, at one sample.

    Attributes:
        row: number of the pair.
        a, b: joint ids of the two links, 0 for the ground.
        at: (3,) the place, world. frame: (3, 3) of b; of a cylinder with its line as z.
        direction: (6,) unit wrench of a drive, world axes at `at`; of a universal its moment about
            the common normal of both axes.
    """

    row: int
    a: int
    b: int
    at: np.ndarray
    frame: np.ndarray
    direction: np.ndarray

    def in_world(self, wrench: np.ndarray) -> np.ndarray:
        """Return a wrench (6,) given in frame b in the world's axes."""
        return (self.frame @ wrench.reshape(2, 3, 1)).ravel()


class Action(NamedTuple):
    """A unit action: its effort (nv,), what it adds to wrenches (joints and pairs, 6)."""

    effort: np.ndarray
    reaction: np.ndarray


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
        regular: smallest singular value that must not be 0, over the largest.
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
    """Sample i of a result, with Pinocchio's joint Jacobians and all pairs by name.

    Args:
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
        rows = model.njoints - 1 + len({pair.row for pair in self.pairs.values()})
        self.none = Action(np.zeros(model.nv), np.zeros((rows, 6)))

    def at(self, pair: Pair, wrench: np.ndarray) -> Action:
        """Return the action of a wrench (6,), world axes at the pair's place, on b, not on a."""
        about_origin = pin.Force(wrench[:3], wrench[3:] + np.cross(pair.at, wrench[:3]))
        effort, reaction = np.zeros(self.model.nv), np.zeros_like(self.none.reaction)
        reaction[self.model.njoints - 1 + pair.row] = (wrench.reshape(2, 3) @ pair.frame).ravel()
        for joint, sign in ((pair.b, 1.0), (pair.a, -1.0)):
            if joint:
                world = pin.ReferenceFrame.WORLD
                J = pin.getJointJacobian(self.model, self.data, joint, world)
                effort += sign * (about_origin.vector @ J)
            for carries in list(self.model.supports[joint])[1:]:
                reaction[carries - 1] -= sign * self.data.oMi[carries].actInv(about_origin).vector
        return Action(effort, reaction)

    def frictions(self, site: Site) -> list[Action]:
        """Return unit friction along every coordinate of a site."""
        if site.pair < 0:
            effort = site.ratio * np.eye(self.model.nv)[site.velocity_index]
            return [self.none._replace(effort=effort)]
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
            out.append(self.none._replace(effort=row))
        return out

    def drive_rates(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (na,) rate of what each drive moves, by duality S v, and its derivative."""
        S = self.rows(self.drives())
        slope, fastest = S @ self.a, float(np.abs(self.v).max(initial=0.0))
        step = _STEP * _size(self.scene) / max(fastest, 1e-300)
        for way in (1.0, -1.0) if fastest > 0.0 else ():  # dS/dt v along the motion
            there = pin.integrate(self.model, self.q, way * step * self.v)
            moved = JudgedSample(self.result, self.model, self.i, there)
            slope += way * moved.rows(moved.drives()) @ self.v / (2.0 * step)
        return S @ self.v, slope

    def rows(self, actions: Sequence[Action]) -> np.ndarray:
        """(n, nv) the efforts of actions."""
        return np.array([action.effort for action in actions]).reshape(-1, self.model.nv)

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

    def maps(self) -> SampleMaps:
        """Return the sample's maps."""
        scene, nv, total, given = self.scene, self.model.nv, *self.given()
        drives, multipliers = self.drives(), self.multipliers()
        each = [self.frictions(site) for site in scene.sites]
        frictions = [action for actions in each for action in actions]
        S, D, undriven = self.rows(drives), self.rows(frictions), list(scene.mobility.undriven)
        P = np.vstack([np.eye(nv)[undriven], self.rows(multipliers)]).T
        right, known = np.column_stack([total, -D.T]), np.eye(1 + len(D))
        basis, size, across = np.linalg.svd(P) if P.size else (np.eye(nv), np.zeros(0), P[:0])
        rank = int((size > _RANK * size.max(initial=0.0)).sum())
        free, loose = basis[:, rank:].T, across[rank:].T
        root = np.sqrt([drive.share or 1.0 for drive in scene.drives])
        reduced = free @ S.T * root
        effort = root[:, None] * np.linalg.lstsq(reduced, free @ right, rcond=_RANK)[0]
        y = np.linalg.lstsq(P, right - S.T @ effort, rcond=_RANK)[0][len(undriven) :]
        loose = loose[:, np.abs(loose[: len(undriven)]).max(axis=0, initial=0.0) < 1e-9]
        loose = loose[len(undriven) :]
        W, Y = (
            np.array([action.reaction for action in actions]).reshape(-1, *self.none.reaction.shape)
            for actions in (drives + frictions, multipliers)
        )
        wrench = np.tensordot(W, np.vstack([effort, known[1:]]), axes=(0, 0))
        wrench[: len(given), :, 0] += given
        closing = np.tensordot(Y, y, axes=(0, 0))
        if loose.shape[1]:  # the least sum |F|^2 + |M/l|^2 over all joints, the loops' too
            weight = np.repeat([1.0, 1.0 / scene.redundancy_length], 3)[:, None]
            shared, more = len(given) + len(scene.loops), np.tensordot(Y, loose, axes=(0, 0))
            flat, now = (
                (weight * w[:shared]).reshape(6 * shared, -1) for w in (more, wrench + closing)
            )
            closing -= more @ np.linalg.lstsq(flat, now, rcond=_RANK)[0]
        at_sites = (wrench + closing)[[self.row(site) for site in scene.sites]]
        sizes = np.linalg.svd(reduced, compute_uv=False) if reduced.size else np.ones(1)
        regular = float(size[:rank].min(initial=1.0) / max(size.max(initial=1.0), 1e-300))
        least = sizes[: len(free)].min(initial=np.inf) / max(sizes[0], _size(scene))
        missed = free @ (S.T @ effort[:, 0] - total)
        return SampleMaps(
            effort,
            closing[len(given) : len(given) + len(scene.loops)],
            at_sites,
            *_contacts(self, at_sites),
            np.repeat(np.arange(len(each)), [len(actions) for actions in each]),
            total,
            D,
            float(np.abs(missed).max(initial=0.0)),
            min(regular, float(least)) if len(free) <= len(drives) else 0.0,
            float(np.abs(given).max(initial=0.0)),
        )

    def row(self, site: Site) -> int:
        """Where a site's wrench is among those of joints and pairs."""
        return site.joint if site.pair < 0 else self.model.njoints - 1 + self.pairs[site.name].row


def _size(scene: Scene) -> float:
    """The least lever that counts (m)."""
    return 1.0 if scene.linkage is None else min(1.0, scene.linkage.size)


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
    """All pairs of one sample by name, from the scene's own entries; loops first."""
    pairs: dict[str, Pair] = {}

    def place(at: Any, rpy: Any = (0.0, 0.0, 0.0)) -> tuple[int, pin.SE3]:
        frame = model.frames[model.getFrameId(at.link, pin.FrameType.BODY)]
        local = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(at.xyz))
        return frame.parentJoint, data.oMi[frame.parentJoint] * frame.placement * local

    def add(name: str, ends: tuple[int, int], pose: pin.SE3, line: Any, slides: bool) -> None:
        unit, still = line / np.linalg.norm(line), np.zeros(3)
        direction = np.concatenate([unit, still] if slides else [still, unit])
        pairs[name] = Pair(len(pairs), *ends, pose.translation, pose.rotation, direction)

    for loop in scene.loops:
        (a, start), (b, pose) = place(loop.a, loop.a.rpy), place(loop.b, loop.b.rpy)
        axis = pose.rotation @ np.array(loop.axis)
        if loop.kind == "universal":
            axis = np.cross(start.rotation @ loop.axis, pose.rotation @ loop.axis_b)
        add(loop.name, (a, b), pose, axis, loop.kind == "prismatic")
    for actuator in scene.actuators or ():
        if actuator.cylinder is not None:
            (a, start), (b, end) = place(actuator.cylinder.a), place(actuator.cylinder.b)
            line = end.translation - start.translation
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), line).matrix()
            pose = pin.SE3(turn, end.translation)
            add(actuator.cylinder.name, (a, b), pose, line, slides=True)
        elif actuator.force is not None:
            b, pose = place(actuator.force)
            line = pose.rotation @ np.array(actuator.force.direction)
            add(actuator.force.name, (0, b), pose, line, slides=True)
        elif actuator.joint in pairs:  # of a loop, under the drive's own name
            pairs[actuator.drive_name] = pairs[actuator.joint]
    return pairs
