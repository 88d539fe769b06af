"""Coordinates for tables and files: a name and one number for each joint with one axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.model.floating import POSE, base_numbers, base_rates, free_joint

#: What files call the components of a wrench on a frame, behind its name: N, then N m.
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


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

    A free base has columns `<joint>.x.q` and so on (`floating.POSE`), another joint with several
    degrees of freedom `<joint>.q[0]` and so on, a mimic follower none. q is (T, nq), v and a are
    (T, nv).
    """
    base, columns = free_joint(model), dict[str, np.ndarray]()
    moving = [
        (name, joint)
        for name, joint in list(zip(model.names, model.joints, strict=True))[1:]  # not the ground
        if joint.nv and joint.shortname() != "JointModelMimic"
    ]
    numbers = base_numbers(q) if base else q
    of_base = numbers, *(base_rates(numbers, v[:, :6], a[:, :6]) if base else (v, a))
    for letter, rates, own in zip("qva", (q, v, a), of_base, strict=True):
        for name, joint in moving:
            count, first = (joint.nv, joint.idx_v) if letter != "q" else (joint.nq, joint.idx_q)
            if name == base:
                columns |= {f"{name}.{part}.{letter}": own[:, k] for k, part in enumerate(POSE)}
            elif joint.nv == 1:
                own_rate = one_number(joint, q) if letter == "q" else rates[:, first]
                columns[f"{name}.{letter}"] = own_rate
            else:
                columns |= {f"{name}.{letter}[{i}]": rates[:, first + i] for i in range(count)}
    return columns
