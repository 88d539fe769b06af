"""Bounds of what the sign of each friction can change of an effort, for branch and bound.

Friction that rests is x_s = a_s load_s(x) + b_s with (a_s, b_s) between its two limits; the other
sites have one (a_s, b_s). Let 0 <= w_s <= 1 say where between the limits a site is. An effort
u = U x then changes with

    du / dw_s = g_s ((a_high - a_low)_s load_s + (b_high - b_low)_s),    g = U (I - L)^-1,
    L_sj = a_s d load_s / d x_j

The second factor is not negative. Where intervals show that g_s has one sign whatever the other
sites do, the site is at one limit at the end of the effort.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: Passes that narrow the friction, and the slopes of the effort.
_PASSES = 6
#: So far below 1 the contraction counts as certain.
_CERTAIN = 1e-6


class Limits(NamedTuple):
    """Friction (ns,) of each site, x = a load + b, at its two limits; equal where it has one.

    Attributes:
        a_low, b_low: at the limit of the least friction.
        a_high, b_high: at that of the greatest.
    """

    a_low: np.ndarray
    b_low: np.ndarray
    a_high: np.ndarray
    b_high: np.ndarray


def slope_bounds(
    contact: np.ndarray, owner: np.ndarray, constant: np.ndarray, limits: Limits, U: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return bounds (ns,) of g, least and greatest, and the most by which a site's limits differ.

    Args:
        contact: (nt, 1 + ns, 3) contact forces as functions of the friction.
        owner: (nt,) whose load each is part of. constant: (ns,) the rest of it.
        limits: of all sites.
        U: (ns,) the effort's change with each friction.

    The friction must contract, see `contracts`.
    """
    ns = len(constant)
    size = np.linalg.norm(contact, axis=2)
    gain = np.maximum(np.abs(limits.a_low), np.abs(limits.a_high))
    dry = np.maximum(np.abs(limits.b_low), np.abs(limits.b_high))
    whole = np.linalg.inv(np.eye(ns) - _coupling(contact, owner, limits))
    most = whole @ (gain * (constant + _per_site(size[:, 0], owner, ns)) + dry)
    low, high = -most, most
    for _ in range(_PASSES):
        center = contact[:, 0] + np.einsum("tje,j->te", contact[:, 1:], (low + high) / 2)
        length, spread = np.linalg.norm(center, axis=1), size[:, 1:] @ ((high - low) / 2)
        load = (
            constant + _per_site(np.maximum(length - spread, 0.0), owner, ns),
            constant + _per_site(length + spread, owner, ns),
        )
        low = np.maximum(low, limits.b_low + np.minimum(*(limits.a_low * some for some in load)))
        high = np.minimum(
            high, limits.b_high + np.maximum(*(limits.a_high * some for some in load))
        )
    middle, radius = _load_slopes(contact, owner, ns, center, length, spread)
    mean, half = (limits.a_high + limits.a_low) / 2, (limits.a_high - limits.a_low) / 2
    L = mean[:, None] * middle
    L_radius = half[:, None] * np.abs(middle) + gain[:, None] * radius
    inverse = np.linalg.inv(np.eye(ns) - L)
    g, g_radius = U @ inverse, np.abs(U) @ whole
    least, greatest = -g_radius, g_radius
    for _ in range(_PASSES):
        reach = (np.maximum(np.abs(least), np.abs(greatest)) @ L_radius) @ np.abs(inverse)
        least, greatest = np.maximum(least, g - reach), np.minimum(greatest, g + reach)
    width = (limits.a_high - limits.a_low) * load[1] + limits.b_high - limits.b_low
    return least, greatest, width


def contracts(contact: np.ndarray, owner: np.ndarray, limits: Limits) -> bool:
    """Return whether every choice of limits has one friction (contraction below 1).

    Args: see `slope_bounds`.
    """
    radius = np.abs(np.linalg.eigvals(_coupling(contact, owner, limits))).max(initial=0.0)
    return bool(radius < 1.0 - _CERTAIN)


def _coupling(contact: np.ndarray, owner: np.ndarray, limits: Limits) -> np.ndarray:
    """(ns, ns) the most by which friction changes with friction: |a_s| sum of |contact_tj|."""
    gain = np.maximum(np.abs(limits.a_low), np.abs(limits.a_high))
    return gain[:, None] * _per_site(np.linalg.norm(contact[:, 1:], axis=2), owner, len(gain))


def _load_slopes(
    contact: np.ndarray,
    owner: np.ndarray,
    ns: int,
    center: np.ndarray,
    length: np.ndarray,
    spread: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (ns, ns) the middle and the radius of d load_s / d x_j.

    Args:
        contact, owner, ns: see `slope_bounds`.
        center, length: (nt, 3), (nt,) contact forces in the middle of the friction, their sizes.
        spread: (nt,) by how much they may differ from it.
    """
    size = np.linalg.norm(contact[:, 1:], axis=2)
    certain = spread < length
    share = np.divide(spread, length, out=np.zeros_like(length), where=certain)
    turn = np.where(certain, 2 * np.sin(np.arcsin(share) / 2), 0.0)
    along = np.einsum("te,tje->tj", center / np.maximum(length, 1e-300)[:, None], contact[:, 1:])
    least = np.where(certain[:, None], np.maximum(along - turn[:, None] * size, -size), -size)
    most = np.where(certain[:, None], np.minimum(along + turn[:, None] * size, size), size)
    return (
        _per_site((least + most) / 2, owner, ns),
        _per_site((most - least) / 2, owner, ns),
    )


def _per_site(values: np.ndarray, owner: np.ndarray, ns: int) -> np.ndarray:
    """Sum values (nt, ...) of contact forces over each site's."""
    out = np.zeros((ns, *values.shape[1:]))
    np.add.at(out, owner, values)
    return out
