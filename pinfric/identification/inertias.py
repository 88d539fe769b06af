"""Inertial parameters of links: regularised to the URDF's, and physically possible.

A body is possible if its pseudo-inertia [[Sigma, h], [h^T, m]] is positive definite, that is U U^T,

    U = exp(alpha) [[exp(d1), s12, s13, t1], [0, exp(d2), s23, t2],
                    [0, 0, exp(d3), t3], [0, 0, 0, 1]]

(Rucker and Wensing, Smooth parameterization of rigid-body inertia, 2022).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinfric.identification.normal import RIDGE, Fit, Normal, Prior, gram, non_negative, places
from pinfric.model.arrays import FloatArray

#: lambda: one N m of noise for each unit of change relative to the URDF. From 1e-5 to 3e-2
#: held-out errors are the same; without any, what no log determines drifts to the boundary.
_STRENGTH = 3e-2
#: Standard deviation of a URDF's inertial parameters, relative to mass, mass x length, mass x
#: length^2 of the link: drawn from CAD they are wrong by 10 to 40 %.
_URDF_ERROR = 0.2
#: Levenberg and Marquardt: steps at most, the damping at which nothing is gained any more, the
#: longest step (of logarithms), and the gain not worth a further step (in variances of a residual).
_STEPS, _MOST_DAMPING, _LONGEST_STEP, _ENOUGH = 80, 1e12, 3.0, 1e-3
#: Share of the largest eigenvalue below which a pseudo-inertia is no body's.
_THIN = 1e-4
#: m: links are taken as at least this large when changes of their parameters are compared.
_SMALLEST_LINK = 0.05
#: Share of the heaviest link's mass that the lightest one counts as.
_LIGHTEST = 0.02


def urdf_prior(model: pin.Model, kept: bool) -> Prior:
    """Return the prior of a robot's inertial parameters; `kept`: they stay."""
    center = parameters(model)
    bodies = center.reshape(-1, 10)
    if kept:
        return Prior(center, np.full(center.size, np.inf), np.zeros(center.size))
    scale = np.empty_like(bodies)
    heaviest = float(bodies[:, 0].max())
    for body, row in zip(bodies, scale, strict=True):
        mass = max(float(body[0]), _LIGHTEST * heaviest)
        length = max(
            float(np.sqrt(max(body[4] + body[6] + body[9], 0.0) / (2.0 * mass))), _SMALLEST_LINK
        )
        row[:] = mass * np.repeat([1.0, length, length**2], [1, 3, 6])
    return Prior(center, (_STRENGTH / scale.ravel()) ** 2, _URDF_ERROR * scale.ravel())


def parameters(model: pin.Model) -> FloatArray:
    """Return 10 parameters of each link: m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz at the joint."""
    return np.concatenate([inertia.toDynamicParameters() for inertia in model.inertias[1:]])


def mass_changes(model: pin.Model, theta: FloatArray) -> FloatArray:
    """Return the change of each link's mass over its mass, (nj,).

    Light links count with the share `_LIGHTEST` of the heaviest one's mass.
    """
    before, after = (values.reshape(-1, 10)[:, 0] for values in (parameters(model), theta))
    return np.asarray((after - before) / np.maximum(before, _LIGHTEST * before.max()))


def with_parameters(model: pin.Model, theta: FloatArray) -> pin.Model:
    """Return a copy of the model with these parameters."""
    changed = model.copy()
    for body, values in enumerate(theta.reshape(-1, 10), 1):
        changed.inertias[body] = pin.Inertia.FromDynamicParameters(values)
    return changed


def consistent_fit(
    normal: Normal, prior: Prior, start: Fit, chosen: Sequence[Sequence[int]]
) -> Fit:
    """Return the best estimate with possible links; kept parameters stay as they are.

    Slots above zero are eliminated. What is left is quadratic in theta and is minimised over alpha,
    d, s and t of every link; then the slots `chosen` follow from theta, >= 0. `start` is the
    estimate without this condition.
    """
    place = places(chosen)
    theta, x = start.theta, start.slots.ravel()
    if prior.kept:
        return start
    psi = np.concatenate([_log_cholesky(body) for body in prior.center.reshape(-1, 10)])
    strength = normal.rows * prior.weight
    for _ in range(3):
        active = place[x[place] > 0.0]
        own = normal.slots[np.ix_(active, active)]
        solved = np.linalg.solve(
            own + RIDGE * np.diag(own.diagonal()),
            np.column_stack((normal.cross[:, active].T, normal.right_slots[active])),
        )
        hessian = normal.rigid - normal.cross[:, active] @ solved[:, :-1] + np.diag(strength)
        right = normal.right_rigid + strength * prior.center
        right = right - normal.cross[:, active] @ solved[:, -1]
        best = np.asarray(np.linalg.solve(hessian, right), dtype=np.float64)
        root = np.asarray(np.linalg.cholesky(hessian).T, dtype=np.float64)
        psi = _nearest_bodies(psi, best, root)
        theta = _theta(psi)
        before, x = x, np.zeros_like(x)
        x[place] = non_negative(
            normal.slots[np.ix_(place, place)], (normal.right_slots - normal.cross.T @ theta)[place]
        )
        if np.array_equal(x > 0.0, before > 0.0):
            break
    return Fit(theta, x.reshape(start.slots.shape))


def _nearest_bodies(psi: FloatArray, best: FloatArray, root: FloatArray) -> FloatArray:
    """Return the psi that makes |root (theta(psi) - best)|^2 least, by Levenberg and Marquardt.

    All of psi are logarithms or shares of a link's size, so one damping suits them all; damping by
    curvature runs along what no log determines, to links without mass.
    """
    damping, off = 1.0, root @ (_theta(psi) - best)
    for _ in range(_STEPS):
        slope = np.hstack(
            [
                root[:, 10 * k : 10 * k + 10] @ pin.LogCholeskyParameters(body).calculateJacobian()
                for k, body in enumerate(psi.reshape(-1, 10))
            ]
        )
        curvature, down = gram(slope, np.ones(len(slope))), slope.T @ off
        while damping < _MOST_DAMPING:
            step = -np.linalg.solve(curvature + damping * np.eye(psi.size), down)
            if np.abs(step).max() < _LONGEST_STEP:
                trial = root @ (_theta(psi + step) - best)
                if trial @ trial < off @ off:
                    break
            damping *= 4.0
        else:
            return psi
        gain = float(off @ off - trial @ trial)
        psi, off, damping = psi + step, trial, 0.3 * damping
        if gain < _ENOUGH:
            return psi
    return psi


def _theta(psi: FloatArray) -> FloatArray:
    return np.concatenate(
        [pin.LogCholeskyParameters(body).toDynamicParameters() for body in psi.reshape(-1, 10)]
    )


def _log_cholesky(parameters: FloatArray) -> FloatArray:
    """Return alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3 of the nearest possible body."""
    pseudo = pin.PseudoInertia.FromDynamicParameters(parameters).toMatrix()
    values, vectors = np.linalg.eigh(pseudo)
    floor = _THIN * max(float(values[-1]), 1e-3)
    pseudo = vectors @ np.diag(np.maximum(values, floor)) @ vectors.T
    U = np.linalg.cholesky(pseudo[::-1, ::-1])[::-1, ::-1]
    alpha, U = np.log(U[3, 3]), U / U[3, 3]
    return np.array([alpha, *np.log(np.diag(U)[:3]), U[0, 1], U[1, 2], U[0, 2], *U[:3, 3]])
