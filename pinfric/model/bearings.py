"""Bearings: from the wrench a joint transmits to the load its friction acts on.

Every bearing is a sum of norms of the wrench's parts with weights of its own:

    c = two_end (|F_r/2 + M_b x k/length| + |F_r/2 - M_b x k/length|)
      + radial |F_r| + axial |F_a| + bending |M_b| + roll |M_a| + constant

with k the joint axis, F the force (F_a along k, F_r across it) and M the moment about the bearing's
middle (M_a along k, M_b across it) of the parent on the child. So c is convex in the wrench, zero
only where nothing presses, and friction effort = mu c: N m about an axis, N along one.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from pinfric.model.compiled import kernel
from pinfric.model.schema import Bearing

#: Columns of `weight_table`: the bearing's middle, and whether it follows the parent.
OFFSET, FOLLOWS_PARENT = 7, 8


@dataclass(frozen=True)
class LoadWeights:
    """The weights of one bearing's normal load; zero leaves a term out.

    Attributes:
        two_end: weight of the two end forces of a bearing of finite length (m, or 1 for a guide).
        inverse_length: 1/length (1/m) of that bearing.
        radial, axial: weights of |F_r| and |F_a| (m, or 1).
        bending, roll: weights of |M_b| and |M_a| (1, or 1/m).
        constant: the preload's share (N m or N).
        offset: middle of the bearing along the axis from the joint's origin (m).
        follows_parent: 1 where the bearing is fixed to the parent and the rod slides through it.
    """

    two_end: float = 0.0
    inverse_length: float = 0.0
    radial: float = 0.0
    axial: float = 0.0
    bending: float = 0.0
    roll: float = 0.0
    constant: float = 0.0
    offset: float = 0.0
    follows_parent: float = 0.0


def load_weights(bearing: Bearing | None) -> LoadWeights:
    """Return the weights of a bearing's normal load (`pin` is the paper's Fig. 3).

    Args:
        bearing: the scene's entry; None is a joint without a load-carrying bearing.
    """
    if bearing is None:
        return LoadWeights()
    if bearing.kind in ("pin", "ball"):
        radius = bearing.radius or 0.0
        thrust = bearing.thrust_radius or 0.0
        constant = radius * bearing.preload
        if bearing.length is None:
            return LoadWeights(radial=radius, axial=thrust, constant=constant,
                               offset=bearing.offset)  # fmt: skip
        return LoadWeights(two_end=radius, inverse_length=1.0 / bearing.length, axial=thrust,
                           constant=constant, offset=bearing.offset)  # fmt: skip
    if bearing.kind == "guide":
        assert bearing.length is not None  # the schema requires it
        return LoadWeights(
            two_end=1.0,
            inverse_length=1.0 / bearing.length,
            roll=0.0 if bearing.width is None else 2.0 / bearing.width,
            constant=bearing.preload,
            offset=bearing.offset,
            follows_parent=1.0 if bearing.on == "parent" else 0.0,
        )
    return LoadWeights(
        radial=bearing.radial or 0.0,
        axial=bearing.axial or 0.0,
        bending=bearing.moment or 0.0,
        constant=bearing.preload,
        offset=bearing.offset,
    )


def weight_table(weights: list[LoadWeights]) -> np.ndarray:
    """Return the weights of all sites as one (ns, 9) table for `normal_loads`."""
    return np.array([astuple(w) for w in weights], dtype=float).reshape(-1, 9)


@kernel
def normal_loads(
    wrench: np.ndarray,
    joint: np.ndarray,
    axis: np.ndarray,
    weights: np.ndarray,
    displacement: np.ndarray,
    load: np.ndarray,
) -> None:
    """Write each site's normal load c (N m about its axis, N along it).

    Args:
        wrench: (n, nj, 6), parent on child in the child's joint frame, linear first.
        joint: (ns,) row of the joint at which each site sits.
        axis: (ns, 3), unit joint axis in the child's frame.
        weights: (ns, 9), `weight_table`.
        displacement: (n, ns), position of the child along the axis; read only for bearings fixed
            to the parent, whose middle moves backwards in the child's frame.
        load: (n, ns), overwritten.
    """
    for i in range(wrench.shape[0]):
        for s in range(joint.size):
            w = wrench[i, joint[s]]
            kx, ky, kz = axis[s, 0], axis[s, 1], axis[s, 2]
            fa = w[0] * kx + w[1] * ky + w[2] * kz
            fx, fy, fz = w[0] - fa * kx, w[1] - fa * ky, w[2] - fa * kz
            middle = weights[s, OFFSET]
            if weights[s, FOLLOWS_PARENT] != 0.0:
                middle -= weights[s, FOLLOWS_PARENT] * displacement[i, s]
            # M about the middle: M - middle k x F; k x F has no part along k
            mx = w[3] - middle * (ky * fz - kz * fy)
            my = w[4] - middle * (kz * fx - kx * fz)
            mz = w[5] - middle * (kx * fy - ky * fx)
            ma = mx * kx + my * ky + mz * kz
            mx, my, mz = mx - ma * kx, my - ma * ky, mz - ma * kz
            total = weights[s, 3] * abs(fa) + weights[s, 5] * abs(ma) + weights[s, 6]
            if weights[s, 0] != 0.0:
                g = weights[s, 1]
                gx, gy, gz = (
                    g * (my * kz - mz * ky),
                    g * (mz * kx - mx * kz),
                    g * (mx * ky - my * kx),
                )
                ax, ay, az = 0.5 * fx + gx, 0.5 * fy + gy, 0.5 * fz + gz
                bx, by, bz = 0.5 * fx - gx, 0.5 * fy - gy, 0.5 * fz - gz
                total += weights[s, 0] * (
                    np.sqrt(ax * ax + ay * ay + az * az) + np.sqrt(bx * bx + by * by + bz * bz)
                )
            if weights[s, 2] != 0.0:
                total += weights[s, 2] * np.sqrt(fx * fx + fy * fy + fz * fz)
            if weights[s, 4] != 0.0:
                total += weights[s, 4] * np.sqrt(mx * mx + my * my + mz * mz)
            load[i, s] = total
