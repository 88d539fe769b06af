"""Influence of each block, and of all other uncertain values, on the estimate.

The estimate z = (theta, coefficients above zero) is where the gradient is zero,

    g(z) = sum over blocks b of A_b^T W (y_b - A_b z) - P (theta - theta_0) = 0

with the columns A, some of which depend on the estimate, and the weight P that draws theta to the
URDF's theta_0. To first order what adds dg to the gradient moves the estimate by

    dz = (H + F)^-1 dg,    H = sum of A_b^T W A_b + P,    F = A^T W (dA/dz) z

dg is a block's own part of g; P d, with the URDF's error d; A^T W Z, with shapes Z that the model
lacks.

Source: MacKinnon, Nielsen and Webb, Fast and reliable jackknife and bootstrap methods for
cluster-robust inference (2023).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinfric.identification.laws import K
from pinfric.identification.normal import BlockProducts, Fit, Prior
from pinfric.model.arrays import FloatArray, IntArray

#: Share of a block that is left out. Less than 1: where one block alone shows a coefficient, the
#: matrix must not be singular.
_LEFT_OUT = 0.99
#: Where no row tells a coefficient from others it is as uncertain as its own size.
_RIDGE = 1e-10


def of_joint(place: IntArray, joint: int, p: int) -> tuple[IntArray, IntArray]:
    """Return where theta (p,) and a joint's coefficients stand in z, and among the joint's columns.

    Args:
        place: (n,) of the coefficients above zero among (nj K,).
    """
    own, theta = np.flatnonzero(place // K == joint), np.arange(p)
    return np.append(theta, p + own), np.append(theta, p + place[own] % K)


def influence(
    grams: Sequence[BlockProducts],
    weights: FloatArray,
    prior: Prior,
    fit: Fit,
    place: IntArray,
    feedback: FloatArray | float = 0.0,
    unknown: FloatArray | None = None,
) -> tuple[FloatArray, int]:
    """Return the influence of each block on the estimate, and of all else that is uncertain.

        M = S (H + F)^-T,    the covariance is M^T M

    Rows of S: the blocks' gradients less their mean; P times the deviation of the prior's center;
    gradients of what the model lacks; each coefficient times a ridge, for what no row determines.
    For its own gradient a block is left out of H: with few blocks each pulls the fit to itself.

    Args:
        grams, weights: of each joint. prior: of theta; kept parameters take no part.
        fit: the estimate. place: (n,) of the coefficients above zero among (nj K,).
        feedback: (p + n, p + n) F.
        unknown: (m, p + n) gradients of what the model lacks, of one standard deviation each.

    Returns:
        (blocks + p + m + n, p + n), without p where theta is kept; how many blocks have rows.
    """
    p, n, blocks = fit.theta.size, place.size, grams[0].count.size
    hessian, scores = np.zeros((p + n, p + n)) + feedback, np.zeros((blocks, p + n))
    own_parts = np.zeros((blocks, p + n, p + n))
    for j, (products, weight) in enumerate(zip(grams, weights, strict=True)):
        to, columns = of_joint(place, j, p)
        weighted = weight * products.products[:, columns]
        own_parts[np.ix_(np.arange(blocks), to, to)] += weighted[:, :, columns]
        scores[:, to] += weighted @ np.append(-fit.of_joint(j), 1.0)
    hessian += own_parts.sum(axis=0)
    drawn = np.zeros((0, p + n)) if unknown is None else unknown
    if prior.kept:
        hessian, scores, own_parts = hessian[p:, p:], scores[:, p:], own_parts[:, p:, p:]
        drawn = drawn[:, p:]
    else:
        strength = sum(float(products.count.sum()) for products in grams) * prior.weight
        hessian[:p, :p] += np.diag(strength)
        drawn = np.vstack((np.eye(p, p + n) * (strength * prior.deviation)[:, None], drawn))
    # Changes of the estimate by blocks and by all else, (., size); how many blocks have rows
    values = fit.slots.ravel()[place]
    used = (scores != 0.0).any(axis=1)
    scores, own_parts, count = scores[used], own_parts[used], int(used.sum())
    scores = (scores - scores.mean(axis=0)) * np.sqrt((count - 1.0) / count)
    size = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled, parts = (x / np.outer(size, size) for x in (hessian, own_parts))
    scaled = scaled + _RIDGE * np.eye(size.size)
    itself = np.append(np.zeros(size.size - values.size), values)
    drawn = np.vstack((drawn, np.diag(_RIDGE * itself * size**2)[size.size - values.size :]))
    without = scaled - _LEFT_OUT * parts
    moved = np.linalg.solve(without, (scores / size)[:, :, None])[:, :, 0]
    known = np.linalg.solve(scaled, (drawn / size).T).T
    return np.concatenate((moved, known)) / size, count
