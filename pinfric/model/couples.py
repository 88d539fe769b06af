"""Coupled drives, which other joints turn as well, as in wrists whose gears run over a joint.

    s = q_own + sum_j c_j q_j,     motor speed = ratio ds/dt,     ds/dt = S v,     tau = S^T u

with a constant S (`notebooks/theory/gears.md`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinfric.errors import SceneError
from pinfric.model.drives import Drive

#: A couples matrix is singular where its least singular value is this small beside the greatest.
_SINGULAR = 1e-9


def rate_rows(drives: Sequence[Drive], nv: int) -> np.ndarray:
    """Return S (na, nv): the rate of each drive per unit velocity; 0 for drives off the joints."""
    S = np.zeros((len(drives), nv))
    for d, drive in enumerate(drives):
        for v, factor in ((drive.velocity_index, 1.0), *drive.couples):
            if v >= 0:
                S[d, v] = factor
    return S


def drive_rates(drives: Sequence[Drive], v: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the rates of drives (n, na), rad/s or m/s: S v, or those along actions off the joints.

    v is (n, nv), `along` (n, nx) the rates along the linkage's actions; accelerations give the
    rates' derivatives.
    """
    rates = np.empty((len(v), len(drives)))
    for d, drive in enumerate(drives):
        own = drive.velocity_index
        rates[:, d] = v[:, own] if own >= 0 else along[:, drive.column]
        for other, factor in drive.couples:
            rates[:, d] += factor * v[:, other]
    return rates


def taking_part(drives: Sequence[Drive]) -> list[int]:
    """Return the indices of the drives that couple joints, and of those on the joints coupled."""
    named = {v for drive in drives for v, _ in drive.couples}
    return [d for d, drive in enumerate(drives) if drive.couples or drive.velocity_index in named]


def delivery(drives: Sequence[Drive], nv: int) -> np.ndarray:
    """Return P (na, na), or (0, 0) without couples: drives deliver u = P tau.

    tau (na,) are the efforts of their own joints, C^T u with C the columns of S of these joints.
    """
    here = taking_part(drives)
    if not here:
        return np.zeros((0, 0))
    P, own = np.eye(len(drives)), [drives[d].velocity_index for d in here]
    P[np.ix_(here, here)] = np.linalg.inv(rate_rows(drives, nv)[np.ix_(here, own)].T)
    return P


def reaches(drives: Sequence[Drive], nv: int) -> np.ndarray:
    """Return (na, nv) bool: which joints' efforts and frictions act on which drive on a joint."""
    own, P = rate_rows([replace(drive, couples=()) for drive in drives], nv), delivery(drives, nv)
    if P.size:
        own = np.where(np.abs(P) > _SINGULAR * np.abs(P).max(), P, 0.0) @ own
    return own != 0.0


def mixed(drives: Sequence[Drive], nv: int) -> np.ndarray:
    """Return (na,) bool: the drives on which friction of other joints than their own acts."""
    felt = reaches(drives, nv)
    return np.array(
        [bool(drive.couples) or felt[:, drive.velocity_index].sum() > 1 for drive in drives],
        dtype=bool,
    )


def deliver_interval(
    P: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and greatest u = P tau (n, na) over all tau from `lower` to `upper`."""
    ahead, back = np.maximum(P, 0.0).T, np.minimum(P, 0.0).T
    return lower @ ahead + upper @ back, upper @ ahead + lower @ back


def check_couples(drives: Sequence[Drive], names: Sequence[str], source: str) -> None:
    """Refuse couples that do not determine the efforts; `names` (nv,) are those of the velocities.

    Raises:
        SceneError: a coupled joint without a drive of its own, or with several; motors whose speeds
            do not determine their joints'.
    """
    own = [drive.velocity_index for drive in drives]
    for drive in drives:
        for v in [v for v, _ in drive.couples] + [drive.velocity_index] * bool(drive.couples):
            if own.count(v) != 1:
                raise SceneError(
                    f"{source}: actuators: {drive.name!r} couples joint {names[v]!r}, which has "
                    f"{own.count(v) or 'no'} drives; coupled joints need one drive each"
                )
    here = taking_part(drives)
    C = rate_rows(drives, len(names))[np.ix_(here, [own[d] for d in here])]
    size = np.linalg.svd(C, compute_uv=False)
    if here and size[-1] <= _SINGULAR * size[0]:
        raise SceneError(
            f"{source}: actuators: the couples of {', '.join(drives[d].name for d in here)} are "
            "singular: these joints can move while all their motors are at rest; check the factors"
        )
