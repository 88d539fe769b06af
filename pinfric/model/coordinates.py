"""Coordinates for tables and files: a name and one number for each joint with one axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin


def one_number(joint: Any, q: np.ndarray) -> np.ndarray:
    """Return (T,) the angle (unwrapped) or length of a one-degree joint, from q (T, nq)."""
    first = q[:, joint.idx_q]
    return first if joint.nq == 1 else unwrapped_angle(first, q[:, joint.idx_q + 1])


def is_sliding(joint: Any) -> bool:
    """Return whether a joint has one coordinate and this is a length."""
    return bool(joint.nv == 1 and joint.shortname().startswith("JointModelP"))


def from_angles(model: pin.Model, width: int) -> str:
    """Return a hint on how to make q from one number per joint, "" unless `width` is nv."""
    turning = [n for n, j in zip(model.names, model.joints, strict=True) if (j.nq, j.nv) == (2, 1)]
    if width != model.nv or not turning:
        return ""
    return (
        f"; {', '.join(turning)}: cos and sin of the angle; from one number per joint: "
        "q = pin.integrate(model, pin.neutral(model), numbers)"
    )


def unwrapped_angle(cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Return (T,) the angle without jumps, the first within +-pi."""
    return np.asarray(np.unwrap(np.arctan2(sine, cosine)))


def motion_columns(
    model: pin.Model, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> dict[str, np.ndarray]:
    """Return columns `<joint>.q`, then all `.v`, then all `.a`, as `load_trajectory` reads them.

    A joint with several degrees of freedom has columns `<joint>.q[0]` and so on, a mimic follower
    none. q is (T, nq), v and a are (T, nv).
    """
    columns: dict[str, np.ndarray] = {}
    moving = [
        (name, joint)
        for name, joint in list(zip(model.names, model.joints, strict=True))[1:]  # not the ground
        if joint.nv and joint.shortname() != "JointModelMimic"
    ]
    for name, joint in moving:
        if joint.nv == 1:
            columns[f"{name}.q"] = one_number(joint, q)
        else:
            columns |= {f"{name}.q[{i}]": q[:, joint.idx_q + i] for i in range(joint.nq)}
    for letter, rates in (("v", v), ("a", a)):
        for name, joint in moving:
            if joint.nv == 1:
                columns[f"{name}.{letter}"] = rates[:, joint.idx_v]
            else:
                columns |= {
                    f"{name}.{letter}[{i}]": rates[:, joint.idx_v + i] for i in range(joint.nv)
                }
    return columns
