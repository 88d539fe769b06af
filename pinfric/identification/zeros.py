"""Angles whose zero is wrong by a quarter or half turn, or by a little: search for a better zero.

Links that a fit is free to choose take up much of a wrong zero near the end of a robot. So masses
need not move far, and held-out errors stay small; but the right zero leaves less.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.identification.columns import Prepared
from pinfric.identification.estimate import Estimate
from pinfric.identification.laws import INERTIA
from pinfric.model.arrays import FloatArray, IntArray
from pinfric.model.couples import delivery

#: rad: turns that are tried, and one to either side from which the best small one follows.
_TURNS, _LITTLE = (0.5 * np.pi, -0.5 * np.pi, np.pi), 0.2
#: rad: a zero off by less is not named.
_LEAST = 0.1
#: Samples of all logs that are compared; s over which residuals are autocorrelated.
_SAMPLES, _SPAN = 800, 1.5
#: Standard errors by which another zero must be better: five zeros of each joint are tried. Right
#: zeros stayed at or below 3.3 in ten real and synthetic logs.
_CLEARLY = 3.5
#: Joints with parallel axes explain the same: named are those with this share of the best gain.
_ALIKE = 0.95


@dataclass(frozen=True)
class TurnedZero:
    """A zero that would explain efforts better.

    Attributes:
        joint: which one.
        turn: rad by which its logged angle should be larger.
        gain: share of the residual's mean square, weighted over all joints, that would go.
    """

    joint: int
    turn: float
    gain: float


def turned_zeros(found: Estimate) -> tuple[TurnedZero, ...]:
    """Return the zeros that would explain efforts clearly better than the logged ones.

    For each joint and turn the links' parameters and friction are fitted again, with the same laws,
    to some samples; gains are summed over spans of time, whose scatter gives a standard error.

    Args:
        found: the estimate.

    Returns:
        The best, and what is hardly worse; () where the logged zeros are as good.
    """
    model = found.scene.model
    before = _left(found, 0, 0.0)
    better = []
    for joint in range(model.nv):
        slides = model.joints[joint + 1].shortname().startswith("JointModelP")
        if slides or not len(model.children[joint + 1]):  # the last link's parameters turn along
            continue
        for turn in _TURNS:
            gain = before - _left(found, joint, turn)
            if gain.sum() > _CLEARLY * np.sqrt(gain.size) * np.std(gain):
                share = float(gain.sum() / before.sum())
                better.append(TurnedZero(joint, turn, share))
        # the gain of a little turn x is slope x - curve x^2
        up, down = (before - _left(found, joint, x) for x in (_LITTLE, -_LITTLE))
        slopes = (up - down) / (2.0 * _LITTLE)
        slope, curve = float(slopes.sum()), -float((up + down).sum()) / (2.0 * _LITTLE**2)
        if curve > 0.0 and abs(slope) > _CLEARLY * np.sqrt(slopes.size) * np.std(slopes):
            turn = 0.5 * slope / curve
            if _LEAST < abs(turn) < 0.25 * np.pi:
                share = 0.25 * slope**2 / curve / float(before.sum())
                better.append(TurnedZero(joint, turn, share))
    most = max((one.gain for one in better), default=0.0)
    return tuple(one for one in better if one.gain >= _ALIKE * most)


def _left(found: Estimate, joint: int, turn: float) -> FloatArray:
    """Weighted square that is left in each span of time, with one joint's angle turned."""
    prior, size = found.problem.prior, found.fit.theta.size
    parts, spans = [], []
    for rigid, friction, effort, span, weight in _rows(found, joint, turn):
        own, values, _ = np.linalg.svd(friction, full_matrices=False)
        own = own[:, values > 1e-9 * values[0]]  # friction takes what it can
        both = np.column_stack((rigid, effort))
        parts.append(weight * (both - own @ (own.T @ both)))
        spans.append(span)
    rows, of_row = np.concatenate(parts), np.concatenate(spans)
    products = rows.T @ rows
    theta = prior.center
    if not prior.kept:
        strength = len(rows) * prior.weight
        left = products[:size, :size] + np.diag(strength)
        theta = np.asarray(np.linalg.solve(left, products[:size, size] + strength * prior.center))
    off = rows[:, size] - rows[:, :size] @ theta
    _, number = np.unique(of_row, return_inverse=True)
    return np.bincount(number, off**2).astype(np.float64)


def _rows(
    found: Estimate, joint: int, turn: float
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray, IntArray, float]]:
    """Yield each joint's columns of links and of friction, efforts, spans and weight."""
    thin = max(1, sum(one.kept.size for one in found.prepared) // _SAMPLES)
    picked = [np.arange(0, one.kept.size, thin) for one in found.prepared]
    regressors = [
        _regressor(found, one, one.kept[pick], joint, turn)
        for one, pick in zip(found.prepared, picked, strict=True)
    ]
    for j in found.known:
        columns = [INERTIA, *found.choice.laws[j].slots]
        parts, first = [], 0
        for one, pick, every in zip(found.prepared, picked, regressors, strict=True):
            own = one.slides[pick, j]
            t = one.recording.trajectory.t[one.kept[pick][own]]
            span = first + ((t - one.recording.trajectory.t[0]) / _SPAN).astype(np.int64)
            parts.append(
                (
                    every[own, j],
                    one.slots[pick[own], j][:, columns],
                    one.effort(t + found.delay.value)[:, j],
                    span,
                )
            )
            first = int(span.max(initial=first)) + 1
        rigid, friction, effort, span = (np.concatenate(x) for x in zip(*parts, strict=True))
        if effort.size > len(columns):
            yield rigid, friction, effort, span, float(np.sqrt(found.problem.weights[j]))


def _regressor(found: Estimate, one: Prepared, at: IntArray, joint: int, turn: float) -> FloatArray:
    """Columns of the links' parameters at some samples, (n, nj, 10 nj), with one angle turned."""
    model, motion = found.scene.model, one.recording.trajectory
    data, step = model.createData(), turn * (np.arange(model.nv) == joint)
    every = np.array(
        [
            pin.computeJointTorqueRegressor(model, data, pin.integrate(model, q, step), v, a)
            for q, v, a in zip(motion.q[at], motion.v[at], motion.a[at], strict=True)
        ]
    ).reshape(at.size, model.nv, 10 * model.nv)
    P = delivery(found.scene.drives, model.nv)
    return np.asarray(P @ every if P.size else every)
