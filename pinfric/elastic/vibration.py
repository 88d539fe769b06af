"""Natural frequencies of a mechanism whose drives are springs, in the drives' coordinates.

With S the drives' rates, K the gears' tangents, I = r^2 J_rotor and N a basis of the motions that
loops and rigid drives allow, the squares of the angular frequencies are the eigenvalues of

    K^1/2 Lambda K^1/2              motors held,     Lambda = S N (N^T M N)^-1 N^T S^T
    K^1/2 (Lambda + I^-1) K^1/2     motors free

(`notebooks/theory/elastic.md`). Motions that strain no spring, or have no inertia, have no
frequency; the latter follow at once, so that the springs strain least.

Sources: Spong, Modeling and control of elastic joint robots, 1987; De Luca and Book, Robots with
flexible elements, in Springer Handbook of Robotics, 2nd ed. 2016, ch. 11.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: Singular values and squares of frequencies below this many times the largest are zero.
_ZERO = 1e-9
#: Motions have no inertia below this many times that of their parts, each alone.
_LIGHT = 1e-12


class Mode(NamedTuple):
    """One natural mode.

    Attributes:
        frequency: Hz; NaN, as the others, where nothing has inertia.
        shares: (ne,) of the strain energy in each spring, their sum 1.
        shape: (nv,) of the joints, its largest entry 1.
    """

    frequency: float
    shares: np.ndarray
    shape: np.ndarray


def free_motions(rows: np.ndarray, nv: int) -> np.ndarray:
    """Return N (n, nv, k), an orthonormal basis of the velocities v with rows v = 0.

    Args:
        rows: (n, m, nv), of one rank in all samples; m may be 0.
        nv: number of velocities.
    """
    if rows.shape[1] == 0:
        return np.broadcast_to(np.eye(nv), (len(rows), nv, nv))
    n, same = len(rows), bool((rows == rows[:1]).all())  # as without loops
    _, sizes, V = np.linalg.svd(rows[:1] if same else rows)
    rank = int((sizes > _ZERO * sizes.max(axis=1, keepdims=True)).sum(axis=1).max())
    return np.broadcast_to(np.swapaxes(V[:, rank:], 1, 2), (n, nv, nv - rank))


def inertias(mass: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return inertias (n, k): eigenvalues of N^T M N with diagonal 1; and their motions (n, nv, k).

    Args:
        mass: (n, nv, nv) M.
        N: (n, nv, k), see `free_motions`.
    """
    inner = np.swapaxes(N, 1, 2) @ mass @ N
    own = np.diagonal(inner, axis1=1, axis2=2)
    scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
    sizes, parts = np.linalg.eigh(scale[:, :, None] * inner * scale[:, None, :])
    return sizes, N @ (scale[:, :, None] * parts)


def has_light(mass: np.ndarray, closed: np.ndarray) -> bool:
    """Return whether a motion has no inertia in any sample.

    Args:
        mass, closed: see `mobility`.
    """
    sizes, _ = inertias(mass, free_motions(closed, mass.shape[1]))
    return bool((sizes < _LIGHT).any())


def mobility(mass: np.ndarray, rates: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Return Lambda (n, ne, ne) = S N (N^T M N)^-1 N^T S^T.

    Args:
        mass: (n, nv, nv) M.
        rates: (n, ne, nv) S, of the elastic drives.
        closed: (n, m, nv) rows of loops and rigid drives.
    """
    N = free_motions(closed, mass.shape[1])
    moved = rates @ N
    inner = np.swapaxes(N, 1, 2) @ mass @ N
    return np.asarray(moved @ np.linalg.solve(inner, np.swapaxes(moved, 1, 2)))


def frequencies(mobility: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Return the natural frequencies (n, ne), Hz, ascending; NaN where springs outnumber motions.

    Args:
        mobility: (n, ne, ne) Lambda, or Lambda + I^-1.
        stiffness: (n, ne) tangents, N m/rad.
    """
    root = np.sqrt(stiffness)
    squares = np.linalg.eigvalsh(root[:, :, None] * mobility * root[:, None, :])
    squares = np.where(squares > _ZERO * squares[:, -1:], squares, np.nan)
    return np.asarray(np.sort(np.sqrt(squares), axis=1) / (2.0 * np.pi))


def lowest_mode(
    mass: np.ndarray, rates: np.ndarray, closed: np.ndarray, stiffness: np.ndarray
) -> Mode:
    """Return the lowest mode of one configuration, all motors held.

    Args:
        mass, rates, closed: (nv, nv), (ne, nv), (m, nv) as in `mobility`.
        stiffness: (ne,) tangents.
    """
    root = np.sqrt(stiffness)
    (sizes,), (motions,) = inertias(mass[None], free_motions(closed[None], len(mass)))
    light, N = motions[:, sizes < _LIGHT], motions[:, sizes >= _LIGHT]
    if light.size:  # it follows: min |K^1/2 S (N a + light b)| over b
        strain = root[:, None] * rates
        N = N - light @ (np.linalg.pinv(strain @ light) @ (strain @ N))
    if not N.size:
        return Mode(np.nan, np.full(len(rates), np.nan), np.full(len(mass), np.nan))
    moved = N @ np.linalg.solve(N.T @ mass @ N, (rates @ N).T)  # q of a push at each spring
    squares, strains = np.linalg.eigh(root[:, None] * (rates @ moved) * root)
    first = int(np.argmax(squares > _ZERO * squares[-1]))
    shape = moved @ (root * strains[:, first])
    shape /= shape[np.argmax(np.abs(shape))]
    return Mode(float(np.sqrt(squares[first]) / (2 * np.pi)), strains[:, first] ** 2, shape)


def bracket(inertia: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest value (n,), Hz, that the lowest frequency can have, motors
    held.

        1/(2 pi sqrt(sum_j J_j/K_j))  <=  f_1  <=  min_j sqrt(K_j/J_j)/(2 pi)

    The upper end is that of one joint with all others rigid.

    Args:
        inertia: (n, ne) J about each elastic drive while the others stand, kg m^2.
        stiffness: (n, ne) tangents, N m/rad.

    Source: Dunkerley 1894 (lower), Rayleigh's quotient (upper).
    """
    compliance = inertia / stiffness
    with np.errstate(divide="ignore"):
        low, high = compliance.sum(axis=1), compliance.max(axis=1)
        return 1 / (2 * np.pi * np.sqrt(low)), 1 / (2 * np.pi * np.sqrt(high))


def lowest_frequencies(mass: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Return the lowest frequency (n,), Hz, where each coordinate has its spring.

        1/(2 pi f)^2 = the largest eigenvalue of K^-1/2 Lambda^-1 K^-1/2

    Faster than `frequencies`; NaN where nothing has inertia.

    Args:
        mass: (n, ne, ne) Lambda^-1; M of a tree in which every joint has one elastic drive.
        stiffness: (n, ne) tangents, N m/rad.
    """
    root = 1.0 / np.sqrt(stiffness)
    squares = np.linalg.eigvalsh(root[:, :, None] * mass * root[:, None, :])[:, -1]
    squares = np.where(squares > 0.0, squares, np.nan)
    return np.asarray(1.0 / (2.0 * np.pi * np.sqrt(squares)))
