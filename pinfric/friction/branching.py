"""The proof that no friction holds: branching on the directions of the contact forces.

In a sector of directions a linear function bounds |p| from above, so a linear program bounds the
use of friction from below (`notebooks/theory/resting.md`; Land and Doig 1960).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.law import contact_force
from pinfric.friction.least_use import Rest, friction_and_limits, write_limit
from pinfric.friction.minimax import least_violation
from pinfric.kernels.compiled import call_compiled, kernel

#: Accuracy of the linear programs.
_EXACT = 1e-12
#: Largest number of waiting nodes.
_MOST_WAITING = 4096
#: Most proofs end within the first number of nodes, only longer ones are compiled; the limit.
_FEW_NODES, MOST_NODES = 200, 40_000


class Program(NamedTuple):
    """Rows of a node's linear program, G z + h <= m s, and the forces' bounds in it.

    Attributes:
        G, h, s: (4 n + 2 nf, dz), (4 n + 2 nf,) twice: limits, box, sides of sectors.
        bound: (nf, dz + 1): |p_i| <= bound[:dz] z + bound[dz].
        scale: (n,) size of the limits.
        target: the use that nodes are asked for. enough: the use that ends the search.
    """

    G: np.ndarray
    h: np.ndarray
    s: np.ndarray
    bound: np.ndarray
    scale: np.ndarray
    target: float
    enough: float


def prove(rest: Rest, z: np.ndarray, use: float, margin: float, most_nodes: int) -> int:
    """Find a z (dz,) with at most a use: 1; or prove that there is none: 0; or give up: -1.

    Args:
        rest: `Rest`, forces in planes.
        z: overwritten.
        use: that is looked for.
        margin: the proof is that none has less than use (1 - margin).
        most_nodes: where to give up.
    """
    n, dz = rest.N.shape
    rows, nf = 4 * n + 2 * len(rest.owner), len(rest.owner)
    above, below = np.empty(n), np.empty(n)
    friction_and_limits(rest, z, np.empty(n), above, below)
    scale = np.where(
        above < np.inf,
        np.where(below < np.inf, np.maximum(above, below), above),
        np.where(below < np.inf, below, 1.0),
    )
    program = Program(
        np.empty((rows, dz)),
        np.empty(rows),
        np.empty(rows),
        np.empty((nf, dz + 1)),
        scale,
        use * (1.0 - margin),
        use,
    )
    outcome = branch(rest, program, z, min(_FEW_NODES, most_nodes))
    if outcome < 0 and most_nodes > _FEW_NODES:
        outcome = call_compiled(branch, rest, program, z, most_nodes)
    return int(outcome)


@kernel
def bound_force(
    rest: Rest, i: int, centre: float, half: float, line: np.ndarray, sides: np.ndarray
) -> int:
    """Write a linear bound of |p_i| from above, and the sides of its sector; return their number.

    Args:
        rest, i: which force.
        centre, half: its sector (rad); half < 0: none yet.
        line: (dz + 1,), overwritten: |p| <= line[:dz] z + line[dz].
        sides: (2, dz + 1), overwritten: the sector is sides[:, :dz] z + sides[:, dz] <= 0.
    """
    dz = rest.N.shape[1]
    f, S = rest.contact[i, 0], rest.contact[i, 1:]
    if half < 0.0:
        # p_e^2 <= (low + high) p_e - low high on its range, |p| <= (|p|^2 + r^2) / (2 r)
        square, total = 0.0, 0.0
        for j in range(dz + 1):
            line[j] = 0.0
        for e in range(2):
            low, high = rest.low[i, e], rest.high[i, e]
            square += 0.5 * (low * low + high * high)
            for j in range(dz):
                line[j] += (low + high) * S[j, e]
            total += (low + high) * f[e] - low * high
        r = max(np.sqrt(square), 1e-300)
        for j in range(dz):
            line[j] *= 0.5 / r
        line[dz] = 0.5 * r + 0.5 * total / r
        return 0
    along = 1.0 / np.cos(half)
    cx, cy = np.cos(centre), np.sin(centre)
    for j in range(dz):
        line[j] = along * (cx * S[j, 0] + cy * S[j, 1])
    line[dz] = along * (cx * f[0] + cy * f[1])
    if half == 0.0:  # on a line: |p| is exact
        for j in range(dz + 1):
            sides[0, j] = -line[j]
        return 1
    for side in range(2):
        angle = centre - half if side == 0 else centre + half
        sign = 1.0 if side == 0 else -1.0
        nx, ny = sign * np.sin(angle), -sign * np.cos(angle)
        for j in range(dz):
            sides[side, j] = nx * S[j, 0] + ny * S[j, 1]
        sides[side, dz] = nx * f[0] + ny * f[1]
    return 2


@kernel
def write_program(rest: Rest, program: Program, centre: np.ndarray, half: np.ndarray) -> int:
    """Write a node's program for the sectors (nf,) of its forces; return its rows.

    m <= 0 is possible where any x in the box whose forces lie in the sectors holds.
    """
    n, dz = rest.N.shape
    G, h, s = program.G, program.h, program.s
    target = program.target
    for k in range(n):
        for side in range(2):
            r, limit = 2 * k + side, rest.above[k] if side == 0 else rest.below[k]
            write_limit(rest, rest.x0, r, target, limit + rest.least[k], G, h, s)
            if limit < np.inf:
                s[r] = program.scale[k]
            s[2 * n + r] = program.scale[k]
    rows, sides = 4 * n, np.empty((2, dz + 1))
    for i in range(half.size):
        line = program.bound[i]
        count = bound_force(rest, i, centre[i], half[i], line, sides)
        for side in range(2):
            r = 2 * rest.owner[i] + side
            if (rest.above if side == 0 else rest.below)[rest.owner[i]] == np.inf:
                continue
            h[r] -= target * line[dz]
            for j in range(dz):
                G[r, j] -= target * line[j]
        for side in range(count):
            s[rows], h[rows] = 1.0, sides[side, dz]
            for j in range(dz):
                G[rows, j] = sides[side, j]
            rows += 1
    return rows


@kernel
def worst_bounded(
    rest: Rest, program: Program, half: np.ndarray, z: np.ndarray
) -> tuple[int, float]:
    """Return the force whose bound is farthest from its size at z, and its direction; -1: none."""
    dz = z.size
    cut, gap, angle, p = -1, 0.0, 0.0, np.empty(3)
    for i in range(half.size):
        size, over = contact_force(rest.contact, i, z, p), program.bound[i, dz]
        for j in range(dz):
            over += program.bound[i, j] * z[j]
        short = (over - size) / program.scale[rest.owner[i]]
        if short > gap and half[i] != 0.0:
            cut, gap = i, short
            angle = np.arctan2(p[1], p[0])
            if rest.on_a_line[i]:
                angle = 0.0 if p[0] >= 0.0 else np.pi
    return cut, angle


@kernel
def branch(rest: Rest, program: Program, z: np.ndarray, most_nodes: int) -> int:
    """Find a z (dz,) that holds, or prove that none does; see `prove`.

    Args:
        rest: `Rest`, forces in planes.
        program: buffers.
        z: overwritten with what holds.
        most_nodes: where to give up.
    """
    n, nf = rest.x0.size, rest.owner.size
    x, above, below = np.empty(n), np.empty(n), np.empty(n)
    reach = 0.0
    for j in range(z.size):
        reach = max(reach, rest.reach[j])
    # each waiting node: centre and half angle of every force's sector, depth first
    centres, halves = np.zeros((_MOST_WAITING, nf)), np.full((_MOST_WAITING, nf), -1.0)
    centre, half = np.empty(nf), np.empty(nf)
    waiting, nodes = 1, 0
    while waiting > 0:
        if nodes >= most_nodes:
            return -1
        nodes += 1
        waiting -= 1
        for i in range(nf):
            centre[i], half[i] = centres[waiting, i], halves[waiting, i]
        rows = write_program(rest, program, centre, half)
        if least_violation(program.G, program.h, program.s, rows, reach, z) > _EXACT:
            continue
        if friction_and_limits(rest, z, x, above, below) <= program.enough:
            return 1
        cut, angle = worst_bounded(rest, program, half, z)
        if cut < 0 or waiting + 4 > _MOST_WAITING:
            return -1
        whole = half[cut] < 0.0
        parts = 2 if rest.on_a_line[cut] or not whole else 4
        for part in range(parts):
            for i in range(nf):
                centres[waiting, i], halves[waiting, i] = centre[i], half[i]
            if whole:  # the present direction is looked at first, so it is put on top
                centres[waiting, cut] = angle + 2.0 * np.pi * (parts - 1 - part) / parts
                halves[waiting, cut] = 0.0 if rest.on_a_line[cut] else 0.25 * np.pi
            else:
                centres[waiting, cut] = centre[cut] + (part - 0.5) * half[cut]
                halves[waiting, cut] = 0.5 * half[cut]
            waiting += 1
    return 0
