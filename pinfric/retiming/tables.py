"""Demand of a path on each drive, as functions of x = (ds/dt)^2 and u = d^2s/dt^2 along it.

    v = q' sqrt(x),    a = q' u + q'' x,    wrenches  w = w_g + w_b x + w_a u
    w_g = RNEA(q, 0, 0),    w_a = RNEA(q, 0, q') - w_g,    w_b = RNEA(q, q', q'') - w_g

(Bobrow, Dubowsky & Gibson 1985, with the reactions on the wrench twin). So each norm of a bearing's
load is the root of a quadratic in (x, u).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin
from scipy.interpolate import PPoly

from pinfric.dynamics.samples.reactions import rigid_efforts
from pinfric.model.couples import delivery, rate_rows
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin
from pinfric.motions.joint_columns import JointColumn, configurations
from pinfric.retiming.path import Path, reversals

#: Grid points nearer than this part of a piece are one.
_SAME_POINT = 1.0e-9
#: A second derivative that jumps by more than this part of its largest value has two values.
_JUMP = 1.0e-9


@dataclass(frozen=True)
class Grid:
    """The points of all pieces, one piece after the other.

    A row is a place with its derivatives; where q'' jumps, and at stops, a point has two.

    Attributes:
        s, piece: (m,) place of each row. q: (m, nj) positions.
        rate, curvature: (m, nv) q' and q''.
        start, end: (n,) rows of the ends of each interval.
        stop: (n + 1,) bool, whether the robot stands still at each point.
        direction: (n, na) sign of each drive's rate in each interval.
    """

    s: np.ndarray
    piece: np.ndarray
    q: np.ndarray
    rate: np.ndarray
    curvature: np.ndarray
    start: np.ndarray
    end: np.ndarray
    stop: np.ndarray
    direction: np.ndarray

    @property
    def step(self) -> np.ndarray:
        """(n,) lengths of the intervals."""
        return self.s[self.end] - self.s[self.start]


@dataclass(frozen=True)
class Tables:
    """Efforts and loads at every row as functions of (x, u).

    Attributes:
        effort: (m, na, 3) frictionless effort g + b x + a u of each drive (N m or N).
        gram: (m, nt, 6) of each norm of a load: products gg, bb, aa, gb, ga, ba of its vectors.
    """

    effort: np.ndarray
    gram: np.ndarray


def rates_of(scene: Scene, columns: tuple[JointColumn, ...]) -> np.ndarray:
    """Return (na, nj) each drive's rate per unit speed of each joint."""
    return rate_rows(scene.drives, scene.model.nv)[:, [column.index_v for column in columns]]


def natural_points(piece: PPoly, drives: np.ndarray) -> np.ndarray:
    """Return the points of every grid: knots of a piece, and where a joint or a drive reverses.

    `drives`: (na, nj) `rates_of`.
    """
    rates = np.unique(np.concatenate([np.eye(drives.shape[1]), drives]), axis=0)
    places = [np.asarray(piece.x), reversals(PPoly(piece.c @ rates.T, piece.x))]
    return distinct(np.concatenate(places), piece, piece.x)


def distinct(s: np.ndarray, piece: PPoly, kept: np.ndarray) -> np.ndarray:
    """Return places of a piece in order, no two at one point; those in `kept` stay."""
    order = np.unique(np.concatenate((s, kept)))
    near = np.diff(order) <= _SAME_POINT * (piece.x[-1] - piece.x[0])
    fixed = np.isin(order, kept)
    drop = np.zeros(len(order), dtype=bool)
    drop[1:] |= near & ~fixed[1:]
    drop[:-1] |= near & ~fixed[:-1] & fixed[1:]
    return order[~drop]


def make_grid(
    scene: Scene, path: Path, columns: tuple[JointColumn, ...], points: list[np.ndarray]
) -> Grid:
    """Return the rows at the given points of each piece, its two ends among them.

    Args:
        scene: with a drive for every velocity. points: for each piece increasing places s.
    """
    velocity, drives = [column.index_v for column in columns], rates_of(scene, columns)
    rows, start, end, stop, direction, count = [], [], [], [], [], 0
    for p, (piece, s) in enumerate(zip(path.pieces, points, strict=True)):
        first, second = piece.derivative(), piece.derivative(2)
        left = np.nextafter(s[1:-1], -np.inf)
        before, after = second(left), second(s[1:-1])
        jumps = np.abs(after - before) > _JUMP * np.abs(second(s)).max()
        double = 1 + np.flatnonzero(jumps.any(axis=1))
        places = np.insert(s, double, np.nextafter(s[double], -np.inf))  # in front: the left side
        own = np.arange(len(s)) + np.searchsorted(double, np.arange(len(s)), side="right")
        start.append(count + own[:-1])
        end.append(count + own[1:] - np.isin(np.arange(1, len(s)), double))
        stop.append(np.arange(len(s) - 1) == 0)
        direction.append(np.sign(first(0.5 * (s[:-1] + s[1:])) @ drives.T))
        rows.append((places, np.full(len(places), p), piece(places), first(places), second(places)))
        count += len(places)
    s, of, q, q1, q2 = (np.concatenate(column) for column in zip(*rows, strict=True))
    rate, curvature = np.zeros((2, count, max(velocity) + 1))
    rate[:, velocity], curvature[:, velocity] = q1, q2
    return Grid(
        s,
        of,
        q,
        rate,
        curvature,
        np.concatenate(start),
        np.concatenate(end),
        np.concatenate([*stop, [True]]),
        np.concatenate(direction),
    )


def carried_names(scene: Scene, path: Path, piece: int) -> tuple[str, ...] | None:
    """Return the payloads that a piece carries; None: as the scene says."""
    if path.attached is None:
        return None
    return tuple(n for n, on in zip(scene.payloads, path.attached[piece], strict=True) if on)


def make_tables(scene: Scene, path: Path, columns: tuple[JointColumn, ...], grid: Grid) -> Tables:
    """Return efforts and loads along a grid (the module's equations)."""
    q, contacts = configurations(columns, grid.q, scene.model.nq), scene.site_tables.contacts
    m, nt = len(q), len(contacts.site)
    tables = Tables(np.empty((m, scene.model.nv, 3)), np.empty((m, nt, 6)))
    borders = np.concatenate(([0], 1 + np.flatnonzero(np.diff(grid.piece)), [m]))
    groups: dict[tuple[str, ...] | None, list[slice]] = {}
    for first, last in pairwise(borders.tolist()):
        name = carried_names(scene, path, int(grid.piece[first]))
        groups.setdefault(name, []).append(slice(first, last))
    for names, parts in groups.items():
        rows = np.concatenate([np.arange(table.start, table.stop) for table in parts])
        twin = scene.twin(names)
        at_rest = np.zeros_like(grid.rate[rows])
        states = (
            (at_rest, at_rest),
            (grid.rate[rows], grid.curvature[rows]),
            (at_rest, grid.rate[rows]),
        )
        reacting = nt > 0 or twin.springs is not None
        batches = []
        for v, a in states:
            if reacting:
                batches.append(rigid_efforts(twin, q[rows], v, a))
            else:
                effort = np.empty(v.shape)
                pin.rneaInParallel(1, twin.plain_pool(1), q[rows].T, v.T, a.T, effort.T)
                batches.append((np.empty(0), effort))
        for k, (_, effort) in enumerate(batches):
            tables.effort[rows, :, k] = effort if k == 0 else effort - batches[0][1]
        if nt:
            g = batches[0][0]
            wrenches = g, batches[1][0] - g, batches[2][0] - g
            tables.gram[rows] = _gram(scene, twin, q[rows], wrenches)
    if (P := delivery(scene.drives, scene.model.nv)).size:
        tables.effort[:] = np.einsum("de,mek->mdk", P, tables.effort)
    return tables


def _gram(scene: Scene, twin: Twin, q: np.ndarray, wrenches: tuple[np.ndarray, ...]) -> np.ndarray:
    """(m, nt, 6) products of the vectors B w of each term of a load."""
    sites, contacts = scene.site_tables, scene.site_tables.contacts
    joint = sites.joint[contacts.site]
    vectors = [np.einsum("tek,mtk->mte", contacts.map, w[:, joint]) for w in wrenches]
    moving = contacts.moves[contacts.site]
    if moving.any():
        away = twin.displacements(joint[moving], q)[:, :, None]
        for vector, w in zip(vectors, wrenches, strict=True):
            shift = np.einsum("tek,mtk->mte", contacts.map_moved[moving], w[:, joint[moving]])
            vector[:, moving] += away * shift
    g, b, a = vectors
    pairs = ((g, g), (b, b), (a, a), (g, b), (g, a), (b, a))
    return np.stack([(x * y).sum(axis=2) for x, y in pairs], axis=2)
