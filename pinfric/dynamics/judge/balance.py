"""The judge's separate equations of one sample: efforts and loads as affine functions of friction.

    M a + h - J_ext^T f_ext = S u + P y + D phi,    u = u_0 + U phi,    w_k = w_k0 + W_k phi

P are the columns of the loops' multipliers and of undriven coordinates. An orthonormal basis of the
motions that they allow (SVD) eliminates them; the rest is least squares in NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.dynamics.judge.pairs import Pair, Sample, pair_friction
from pinfric.dynamics.judge.plain_laws import plain_displacement, plain_load_terms

#: Entries of a map this small beside its largest are rounding.
_ROUNDING = 1e-13
#: Singular values this small beside the largest are 0.
_RANK = 1e-12


@dataclass(frozen=True)
class Balance:
    """Everything of one sample as an affine function of its friction: [..., 0] + [..., 1:] phi.

    Attributes:
        effort: (na, 1 + ne) of the drives; the sum of u^2 / share is least.
        multipliers: (number of loops, 6, 1 + ne) in frame b; least squares where they are not
            unique (`Scene.redundancy_length`).
        wrench: (ns, 6, 1 + ne) at the sites.
        contact: (nt, 3, 1 + ne) weighted contact forces whose sizes add up to loads.
        owner: (nt,) site of each. constant: (ns,) constant part of each load.
        entry_site: (ne,) site of each friction coordinate.
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
    missed: float
    regular: float
    scale: float


@dataclass(frozen=True)
class _Columns:
    """Unit actions of one kind, one per column: the effort (nv,) of each, and where it acts.

    Attributes:
        effort: (n, nv).
        acting: (n,) pair and wrench in world axes at its place; None on a joint of the tree.
    """

    effort: np.ndarray
    acting: Sequence[tuple[Pair, np.ndarray] | None]


def balance(sample: Sample) -> Balance:
    """Return the judge's maps of one sample."""
    scene, nv = sample.scene, sample.model.nv
    total, wrenches = sample.rnea(sample.external())
    friction, drives, multipliers = _frictions(sample), _drives(sample), _multipliers(sample)
    undriven = np.eye(nv)[list(scene.mobility.undriven)]
    P = np.vstack([undriven, multipliers.effort]).T
    right = np.column_stack([total, -friction.effort.T])
    basis, size, _ = np.linalg.svd(P) if P.size else (np.eye(nv), np.zeros(0), None)
    rank = int((size > _RANK * size.max(initial=0.0)).sum())
    free = basis[:, rank:].T
    root = np.sqrt([drive.share or 1.0 for drive in scene.drives])
    reduced = free @ drives.effort.T * root
    effort = root[:, None] * np.linalg.lstsq(reduced, free @ right, rcond=_RANK)[0]
    missed = free @ (drives.effort.T @ effort[:, 0] - total)
    left = right - drives.effort.T @ effort
    y = np.linalg.lstsq(P, left, rcond=_RANK)[0] if P.size else np.zeros((0, right.shape[1]))
    loose = np.linalg.svd(P)[2][rank:].T if P.size else np.zeros((0, 0))
    loose = loose[:, np.abs(loose[: len(undriven)]).max(axis=0, initial=0.0) < 1e-9]
    identity = np.eye(1 + len(friction.effort))[1:]
    acting = [(drives, effort), (friction, identity)]
    given = wrenches[:, :, None] * np.eye(1, 1 + len(identity))[0]
    own = [_joint_maps(sample, columns) for columns, _ in acting]
    before = given + sum(m @ x for m, (_, x) in zip(own, acting, strict=True))
    pairs = sum((_loop_maps(sample, c) @ x for c, x in acting), np.zeros((len(scene.loops), 6, 1)))
    of_y = _joint_maps(sample, multipliers), _loop_maps(sample, multipliers)
    y = _share(
        scene.redundancy_length, before, pairs, of_y, y[len(undriven) :], loose[len(undriven) :]
    )
    site_wrench = _site_wrenches(sample, before + of_y[0] @ y, of_y[1] @ y, effort)
    contact, owner, constant = _contacts(sample, site_wrench)
    sizes = np.linalg.svd(reduced, compute_uv=False) if reduced.size else np.ones(1)
    lever = 1.0 if scene.linkage is None else min(1.0, scene.linkage.size)  # the least that counts
    regular = 0.0
    if len(free) <= len(scene.drives):
        regular = float(sizes[: len(free)].min(initial=np.inf) / max(sizes[0], lever))
    counts = [3 if site.ball else 1 for site in scene.sites]
    return Balance(
        effort,
        of_y[1] @ y,
        site_wrench,
        contact,
        owner,
        constant,
        np.repeat(np.arange(len(counts)), counts),
        float(np.abs(missed).max(initial=0.0)),
        min(regular, float(size[:rank].min(initial=1.0) / max(size.max(initial=1.0), 1e-300))),
        float(np.abs(wrenches).max(initial=0.0)),
    )


def _frictions(sample: Sample) -> _Columns:
    """Unit friction along every coordinate."""
    rows: list[np.ndarray] = []
    acting: list[tuple[Pair, np.ndarray] | None] = []
    for site in sample.scene.sites:
        for unit in np.eye(3) if site.ball else np.ones((1, 1)):
            if site.pair < 0:
                row = np.zeros(sample.model.nv)
                row[site.velocity_index] = site.ratio
                rows.append(row)
                acting.append(None)
                continue
            at = sample.pairs[site.name], sample.friction_in_world(site, unit)
            rows.append(sample.generalized(*at))
            acting.append(at)
    return _Columns(np.array(rows).reshape(-1, sample.model.nv), acting)


def _drives(sample: Sample) -> _Columns:
    """Unit efforts of the drives."""
    rows, acting = [], []
    for drive in sample.scene.drives:
        row, at = np.zeros(sample.model.nv), None
        if drive.velocity_index >= 0:
            row[drive.velocity_index] = 1.0
            row[[v for v, _ in drive.couples]] = [factor for _, factor in drive.couples]
        else:
            at = sample.pairs[drive.name], sample.pairs[drive.name].direction
            row = sample.generalized(*at)
        rows.append(row)
        acting.append(at)
    return _Columns(np.array(rows).reshape(-1, sample.model.nv), acting)


def drive_rates(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
    """Return (na,) rate of what each drive moves, by duality S v, and its derivative.

    S of drives on joints is constant; else four differences along the motion give dS/dt.
    """
    scene, (q, v, a), model = sample.scene, sample.motion, sample.model
    S = _drives(sample).effort
    fastest = float(np.abs(v).max(initial=0.0))
    if fastest == 0.0 or all(drive.velocity_index >= 0 for drive in scene.drives):
        return S @ v, S @ a
    assert scene.linkage is not None
    h = 1e-3 * min(1.0, scene.linkage.size) / fastest
    slope = np.zeros(len(S))
    for steps, weight in ((1, 8), (-1, -8), (2, -1), (-2, 1)):
        at = pin.integrate(model, q, steps * h * v)
        moved = Sample.of(sample.result, model, model.createData(), sample.i, at)
        slope += weight * (_drives(moved).effort @ (v + steps * h * a)) / (12.0 * h)
    return S @ v, slope


def _multipliers(sample: Sample) -> _Columns:
    """Unit multipliers of the loops."""
    linkage, loops = sample.scene.linkage, sample.scene.loops
    assert linkage is not None
    rows, acting = [], []
    for c in range(linkage.off_joint, linkage.off_joint + linkage.multipliers):
        loop = loops[linkage.column_pair[c]]
        pair = sample.pairs[loop.name]
        turns = loop.kind == "universal" and linkage.unit[c, 3:].any()
        at = pair, pair.direction if turns else pair.in_world(linkage.unit[c])
        rows.append(sample.generalized(*at))
        acting.append(at)
    return _Columns(np.array(rows).reshape(-1, sample.model.nv), acting)


def _joint_maps(sample: Sample, columns: _Columns) -> np.ndarray:
    """(nj, 6, n) how the wrench that each joint transmits changes with unit actions.

    An action on a link changes the wrench of every joint that carries the link.
    """
    out = np.zeros((sample.model.njoints - 1, 6, len(columns.acting)))
    for c, acting in enumerate(columns.acting):
        if acting is None:
            continue
        pair, wrench = acting
        carries = np.zeros(sample.model.njoints)
        for joint, sign in ((pair.b, 1.0), (pair.a, -1.0)):
            carries[list(sample.model.supports[joint])] += sign
        for row in np.flatnonzero(carries[1:]):
            force = pair.on_link(sample.data, int(row) + 1, wrench)
            out[row, :, c] = -carries[row + 1] * force.vector
    return out


def _loop_maps(sample: Sample, columns: _Columns) -> np.ndarray:
    """(number of loops, 6, n) the wrench of a on b in frame b that unit actions at a loop are."""
    names = [loop.name for loop in sample.scene.loops]
    out = np.zeros((len(names), 6, len(columns.acting)))
    for c, acting in enumerate(columns.acting):
        for row, name in enumerate(names):
            if acting is not None and acting[0] is sample.pairs[name]:
                out[row, :, c] = acting[0].in_frame(acting[1])
    return out


def _share(
    length: float,
    joints: np.ndarray,
    loops: np.ndarray,
    maps: tuple[np.ndarray, np.ndarray],
    y: np.ndarray,
    loose: np.ndarray,
) -> np.ndarray:
    """Return the multipliers of least sum |F|^2 + |M/l|^2 over all joints, the loops' too.

    Args:
        length: l (m).
        joints, loops: (nj, 6, 1 + ne), (number of loops, 6, 1 + ne) wrenches without multipliers.
        maps: their change per unit multiplier.
        y: (ny, 1 + ne) multipliers. loose: (ny, nf) what may be added to them.
    """
    if not loose.shape[1]:
        return y
    weight = np.repeat([1.0, 1.0 / length], 3)[:, None]
    change = np.vstack([(weight * (m @ loose)).reshape(-1, loose.shape[1]) for m in maps])
    now = np.vstack(
        [
            (weight * (given + m @ y)).reshape(-1, y.shape[1])
            for given, m in zip((joints, loops), maps, strict=True)
        ]
    )
    return np.asarray(y - loose @ np.linalg.lstsq(change, now, rcond=_RANK)[0])


def _site_wrenches(
    sample: Sample, joints: np.ndarray, multipliers: np.ndarray, effort: np.ndarray
) -> np.ndarray:
    """(ns, 6, 1 + ne) of the joints' wrenches, and of what acts where loops close."""
    scene, columns, out, first = sample.scene, joints.shape[2], [], 0
    for site in scene.sites:
        count = 3 if site.ball else 1
        if site.pair < 0:
            w = joints[site.joint].copy()
        else:
            w = np.zeros((6, columns))
            for k, unit in enumerate(np.eye(count)):
                w[:, 1 + first + k] = pair_friction(site, unit)
            if not sample.pairs[site.name].along_line:
                w += multipliers[site.pair]
            for drive, u in zip(scene.drives, effort, strict=True):
                if drive.velocity_index < 0 and sample.pairs[drive.name] is sample.pairs[site.name]:
                    w += np.outer(pair_friction(site, np.ones(1)), u)
        out.append(w)
        first += count
    return np.array(out).reshape(-1, 6, columns)


def _contacts(sample: Sample, wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Contact forces (nt, 3, 1 + ne), their sites (nt,), constant parts of loads (ns,)."""
    scene, q = sample.scene, sample.motion[0]
    forces, owner, constant = [], [], np.zeros(len(scene.sites))
    slope = wrench[:, :, 1:]
    noise = _ROUNDING * max(1.0, float(np.abs(slope).max(initial=0.0)))
    slope[np.abs(slope) < noise] = 0.0
    for s, site in enumerate(scene.sites):
        moved = plain_displacement(scene, site, q) if site.pair < 0 else 0.0
        maps, constant[s] = plain_load_terms(site, moved)
        for B in maps:
            force = B @ wrench[s]
            part = np.abs(B) @ np.abs(wrench[s])
            force[:, 1:][np.abs(force[:, 1:]) < _ROUNDING * part[:, 1:]] = 0.0
            forces.append(force)
            owner.append(s)
    ne = wrench.shape[2]
    return (np.array(forces).reshape(-1, 3, ne), np.array(owner, dtype=int), constant)
