"""Bounds of what the sign of each friction can change of an effort, for branch and bound.

Friction at rest is x_s = a_s load_s(x) + b_s with (a_s, b_s) at w_s from 0 to 1 between its two
limits; other sites have one (a_s, b_s). An effort u = U x changes with

    du / dw_s = g_s ((a_high - a_low)_s load_s + (b_high - b_low)_s),    g = U (I - L)^-1,
    L_sj = a_s d load_s / d x_j

The second factor is not negative. Where intervals show that g_s has one sign whatever the other
sites do, the site is at one limit at the end of the effort.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.friction.dense import solve_dense
from pinfric.friction.law import contact_force
from pinfric.kernels.arrays import array
from pinfric.kernels.compiled import kernel

#: Passes that narrow the friction, and the slopes of the effort.
_PASSES = 6
#: Friction that grows by more than this where it feeds itself does not count as contracting.
_MOST_GROWTH = 1e6


class Limits(NamedTuple):
    """Friction x = a load + b (ns,) at the limits of least and greatest friction; equal if one."""

    a_low: np.ndarray = array("ns")
    b_low: np.ndarray = array("ns")
    a_high: np.ndarray = array("ns")
    b_high: np.ndarray = array("ns")


class Slopes(NamedTuple):
    """Bounds (ns,) of g, least and greatest, and the most by which a site's limits differ."""

    least: np.ndarray = array("ns")
    greatest: np.ndarray = array("ns")
    width: np.ndarray = array("ns")


@kernel
def bound_slopes(
    contact: np.ndarray,
    owner: np.ndarray,
    constant: np.ndarray,
    limits: Limits,
    U: np.ndarray,
    slopes: Slopes,
) -> bool:
    """Write bounds of slopes; False: a choice of limits may have several frictions, or none.

    Args:
        contact: (nt, 1 + ns, 3) contact forces as functions of the friction.
        owner: (nt,) site of each. constant: (ns,) part of the loads.
        limits: of all sites.
        U: (ns,) the effort's change with each friction.
        slopes: overwritten.
    """
    (nt, columns, _), a_low, a_high = contact.shape, limits.a_low, limits.a_high
    # 1. Friction contracts if K, the most by which it changes with itself, has (I - K)^-1 >= 0.
    gain, size = np.maximum(np.abs(a_low), np.abs(a_high)), np.sqrt((contact**2).sum(axis=2))
    inner, growth = np.eye(columns - 1), np.eye(columns - 1)
    unmoved = gain * constant + np.maximum(np.abs(limits.b_low), np.abs(limits.b_high))
    for t in range(nt):
        inner[owner[t]] -= gain[owner[t]] * size[t, 1:]
        unmoved[owner[t]] += gain[owner[t]] * size[t, 0]
    if not solve_dense(inner, growth) or not 0.0 <= growth.min() <= growth.max() < _MOST_GROWTH:
        return False
    # 2. Intervals of friction and loads.
    high = (growth * unmoved).sum(axis=1)
    low, center, length, spread = -high, np.empty((nt, 3)), np.empty(nt), np.empty(nt)
    lightest, heaviest = constant, constant
    for _ in range(_PASSES):
        lightest, heaviest = constant.copy(), constant.copy()
        between = 0.5 * (low + high)
        for t in range(nt):
            length[t], spread[t] = contact_force(contact, t, between, center[t]), 0.0
            for j in range(columns - 1):
                spread[t] += size[t, 1 + j] * 0.5 * (high[j] - low[j])
            lightest[owner[t]] += max(length[t] - spread[t], 0.0)
            heaviest[owner[t]] += length[t] + spread[t]
        low = np.maximum(low, limits.b_low + np.minimum(a_low * lightest, a_low * heaviest))
        high = np.minimum(high, limits.b_high + np.maximum(a_high * lightest, a_high * heaviest))
    # 3. The middle and the radius of d load_s / d x_j: a contact force turns by little.
    middle, radius = np.zeros(growth.shape), np.zeros(growth.shape)
    for t in range(nt):
        certain = spread[t] < length[t]
        turn = 2 * np.sin(0.5 * np.arcsin(spread[t] / length[t])) if certain else 2.0
        for j in range(columns - 1):
            most, along = size[t, 1 + j], 0.0
            for e in range(3 if certain else 0):
                along += center[t, e] * contact[t, 1 + j, e] / length[t]
            least, greatest = max(along - turn * most, -most), min(along + turn * most, most)
            middle[owner[t], j] += 0.5 * (least + greatest)
            radius[owner[t], j] += 0.5 * (greatest - least)
    # 4. g, by how much L may be off its middle.
    for s in range(columns - 1):
        radius[s] = 0.5 * (a_high[s] - a_low[s]) * np.abs(middle[s]) + gain[s] * radius[s]
        middle[s] *= -0.5 * (a_high[s] + a_low[s])
        middle[s, s] += 1.0
    inverse = np.eye(columns - 1)
    if not solve_dense(middle, inverse):
        return False
    g = (inverse.T * U).sum(axis=1)
    slopes.greatest[:] = (growth.T * np.abs(U)).sum(axis=1)
    slopes.least[:] = -slopes.greatest
    for _ in range(_PASSES):
        off = (radius.T * np.maximum(np.abs(slopes.least), np.abs(slopes.greatest))).sum(axis=1)
        reach = (np.abs(inverse).T * off).sum(axis=1)
        slopes.least[:] = np.maximum(slopes.least, g - reach)
        slopes.greatest[:] = np.minimum(slopes.greatest, g + reach)
    slopes.width[:] = (a_high - a_low) * heaviest + limits.b_high - limits.b_low
    return True
