"""Checked states of a motion, one row per sample."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol, cast

import numpy as np
import pinocchio as pin

from pinfric.errors import PinfricWarning, StateError
from pinfric.model.arrays import flags, real_numbers
from pinfric.model.coordinates import from_angles
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION, impossible
from pinfric.model.scene import Scene

#: Compared by identity: a tenth of the time.
_FLOAT = np.dtype(float)


class MotionLike(Protocol):
    """An object with a motion: a `Trajectory`, a simulated `Motion`."""

    @property
    def t(self) -> np.ndarray:  # noqa: D102
        ...

    @property
    def q(self) -> np.ndarray:  # noqa: D102
        ...

    @property
    def v(self) -> np.ndarray:  # noqa: D102
        ...

    @property
    def a(self) -> np.ndarray:  # noqa: D102
        ...


@dataclass(frozen=True)
class States:
    """Checked samples of a motion.

    Attributes:
        q, v, a: (T, nq), (T, nv), (T, nv), finite, C-ordered float64, q on its manifold.
        t: (T,) increasing times in s of one motion; None: states without order.
        attached: (T, np) which payloads are carried, columns as `scene.payloads`; None: the scene's
            default.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    t: np.ndarray | None = None
    attached: np.ndarray | None = None

    @property
    def times(self) -> np.ndarray:
        """`t` of states that have it."""
        assert self.t is not None
        return self.t

    @classmethod
    def of(
        cls, scene: Scene, q: Any, v: Any, a: Any, t: Any = None, attached: Any = None
    ) -> States:
        """Check arrays against the scene; a single sample may come without its first axis.

        Raises:
            StateError: not real numbers, a wrong shape, a value not finite, times not increasing.
        """
        model = scene.model
        q, v, a = (_samples(name, x, model) for name, x in (("q", q), ("v", v), ("a", a)))
        if not len(q) == len(v) == len(a):
            raise StateError(f"q, v, a have {len(q)}, {len(v)}, {len(a)} samples; should be equal")
        if t is not None:
            t = real_numbers("t", t)
            if t.shape != (len(q),) or impossible(t).any():
                raise StateError(f"t: shape {t.shape}; should be ({len(q)},) finite times in s")
            if (np.diff(t) <= 0).any():
                i = int(np.argmax(np.diff(t) <= 0)) + 1
                raise StateError(f"t: not increasing at sample {i} ({t[i - 1]:g} s, {t[i]:g} s)")
        if attached is not None:
            attached = flags("attached", attached)
            wanted = (len(q), len(scene.payloads))
            if attached.shape != wanted:
                raise StateError(
                    f"attached: shape {attached.shape}; should be {wanted}: samples, "
                    f"then {list(scene.payloads)}"
                )
        return cls(_on_manifold(model, q), v, a, t, attached)

    def part(self, part: slice) -> States:
        """Return the samples of one slice."""
        t = None if self.t is None else self.t[part]
        attached = None if self.attached is None else self.attached[part]
        return States(self.q[part], self.v[part], self.a[part], t, attached)

    def around(self, part: slice) -> slice:
        """Return a slice with one sample more on each side, where a motion has one."""
        if self.t is None:
            return part
        return slice(max(part.start - 1, 0), min(part.stop + 1, len(self.q)))

    def inside(self, part: slice) -> slice:
        """Return where a slice is within `around`."""
        first = part.start - self.around(part).start
        return slice(first, first + part.stop - part.start)

    def carried(self, scene: Scene) -> np.ndarray:
        """Return (T, number of payloads) which of the scene's payloads are carried."""
        if self.attached is not None:
            return self.attached
        always = np.array([payload.attached for payload in scene.payloads.values()], dtype=bool)
        return np.broadcast_to(always, (len(self.q), len(always)))

    def phases(self, scene: Scene) -> Iterator[tuple[int, int, tuple[str, ...] | None]]:
        """Yield (start, stop, names of the payloads carried; None: default) of each phase."""
        if self.attached is None or not scene.payloads:
            yield 0, len(self.q), None
            return
        names = tuple(scene.payloads)
        change = np.flatnonzero((self.attached[1:] != self.attached[:-1]).any(axis=1)) + 1
        borders = [0, *change.tolist(), len(self.q)]
        for start, stop in pairwise(borders):
            carried = (n for n, on in zip(names, self.attached[start], strict=True) if on)
            yield start, stop, tuple(carried)


def attached_columns(scene: Scene, motion: Any) -> np.ndarray | None:
    """Return a motion's `attached` in the columns of `scene.payloads`, or None.

    Raises:
        StateError: the motion was made for other joints or other payloads.
    """
    movable = [n for n, nv in zip(scene.joint_names, tuple(scene.model.nvs)[1:], strict=True) if nv]
    made_for = getattr(motion, "joint_names", None)
    if made_for is not None and list(made_for) != movable:
        raise StateError(f"the motion is of the joints {list(made_for)}, the scene has {movable}")
    attached = getattr(motion, "attached", None)
    names = getattr(motion, "payload_names", None)
    if attached is None or names is None or tuple(names) == tuple(scene.payloads):
        return attached
    if set(names) != set(scene.payloads):
        raise StateError(
            f"the motion carries the payloads {list(names)}, the scene has {list(scene.payloads)}"
        )
    return np.asarray(attached)[:, [tuple(names).index(name) for name in scene.payloads]]


def mention_degrees(scene: Scene, q: np.ndarray) -> None:
    """Warn where angles q (T, nq) are far beyond limits, and all would be within in degrees."""
    model, beyond = scene.model, None
    joints = zip(list(model.names)[1:], list(model.joints)[1:], strict=True)  # 0 is the world
    for name, joint in joints:
        if joint.nq != 1 or not joint.shortname().startswith("JointModelR"):
            continue
        i = joint.idx_q
        lower, upper = model.lowerPositionLimit[i], model.upperPositionLimit[i]
        low, high = q[:, i].min(initial=np.inf), q[:, i].max(initial=-np.inf)
        if np.radians(low) < lower or np.radians(high) > upper:
            return
        largest = max(abs(low), abs(high))
        far = largest > 2.0 * np.pi and largest / _FAR_BEYOND > max(abs(lower), abs(upper))
        if far and beyond is None:
            beyond = name, largest, lower, upper
    if beyond is not None:
        name, largest, lower, upper = beyond
        warnings.warn(
            f"q: joint {name!r} is at {largest:.4g} rad, beyond its limits ({lower:.4g} to "
            f"{upper:.4g}), and all joints are within theirs in degrees; if q is in degrees, give "
            "np.radians(q)",
            PinfricWarning,
            stacklevel=4,
        )


def mention_unmeasured(scene: Scene, v: np.ndarray) -> None:
    """Warn where joints are faster in a motion v (T, nv) than their friction was measured."""
    if scene.measured is None:
        return
    beyond = []
    for site in scene.sites:
        top = scene.measured.top_speed(site.name)
        if top is None or site.velocity_index < 0:
            continue
        fastest = np.abs(site.ratio * v[:, site.velocity_index]).max(initial=0.0)
        if fastest > top * (1.0 + 1e-9):
            beyond.append(f"{site.name} {fastest:.3g} (measured to {top:g})")
    if beyond:
        warnings.warn(
            f"{scene.source}: faster than friction was measured, rad/s or m/s: "
            f"{', '.join(beyond)}; laws of friction do not extrapolate: slow the motion down, or "
            "measure there",
            PinfricWarning,
            stacklevel=4,
        )


def one_of(where: str, effort: Any, motor_torque: Any) -> np.ndarray:
    """Return the one that is given; raise `StateError` for both or neither."""
    if (effort is None) == (motor_torque is None):
        both = "both" if effort is not None else "neither"
        raise StateError(f"{where}: found {both} of effort and motor_torque; give one of them")
    return cast("np.ndarray", motor_torque if effort is None else effort)


def vector(
    name: str, values: Any, size: int, symbol: str, model: pin.Model | None = None
) -> np.ndarray:
    """Return a (size,) C-ordered float array, or raise `StateError` naming it.

    Args:
        name, symbol: of the array and its size, for the message.
        model: of a configuration, to say in the message how it is made from angles.
    """
    if type(values) is np.ndarray and values.dtype is _FLOAT and values.shape == (size,):
        return np.ascontiguousarray(values)
    array = np.atleast_1d(real_numbers(name, values))
    if array.shape != (size,):
        remedy = from_angles(model, array.size) if model is not None else ""
        raise StateError(
            f"{name}: shape {np.shape(values)}; should be ({size},), {symbol} = {size}{remedy}"
        )
    return array


def _samples(name: str, values: Any, model: pin.Model) -> np.ndarray:
    array = np.atleast_2d(real_numbers(name, values))
    width = model.nq if name == "q" else model.nv
    if array.ndim != 2 or array.shape[1] != width:
        raise StateError(
            f"{name}: shape {np.shape(values)}; should be (T, {width}), samples first, "
            f"{'nq' if name == 'q' else 'nv'} = {width}"
            f"{from_angles(model, array.shape[-1]) if name == 'q' else ''}"
        )
    if len(array) == 0:
        raise StateError(f"{name}: no samples")
    if (wrong := impossible(array)).any():
        i, j = np.argwhere(wrong)[0]
        raise StateError(
            f"{name}: sample {i}, column {j} is {array[i, j]}; should be finite and "
            f"at most {LARGEST_OF_A_MOTION:g}"
        )
    return array


#: An angle this many times its limit is not one that only passes it.
_FAR_BEYOND = 3.0
#: Where the unit vectors of a joint's configuration lie: (offset, length).
_UNIT_PARTS = {
    "JointModelFreeFlyer": (3, 4),
    "JointModelSpherical": (0, 4),
    "JointModelPlanar": (2, 2),
}


def unit_parts(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    """Return where in q (cos, sin) pairs and quaternions begin (nu,), and their lengths (nu,)."""
    places = []
    for joint in model.joints[1:]:
        continuous = (0, 2 if (joint.nq, joint.nv) == (2, 1) else 0)
        first, size = _UNIT_PARTS.get(joint.shortname(), continuous)
        if size:
            places.append((joint.idx_q + first, size))
    begins, sizes = np.ascontiguousarray(np.array(places, dtype=np.int64).reshape(-1, 2).T)
    return begins, sizes


def _on_manifold(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Normalize (cos, sin) pairs and quaternions; warn of more than rounding."""
    if model.nq == model.nv:
        return q
    normal = q.copy()
    largest = 0.0
    for first, size in zip(*unit_parts(model), strict=True):
        span = slice(first, first + size)
        norm = np.linalg.norm(q[:, span], axis=1, keepdims=True)
        if (norm < 1e-6).any():
            i = int(np.argmin(norm))
            raise StateError(
                f"q: sample {i}, columns {span.start}-{span.stop - 1}: a direction of length 0; "
                "give (cos, sin) or a unit quaternion"
            )
        largest = max(largest, float(np.abs(norm - 1).max()))
        normal[:, span] = q[:, span] / norm
    if largest > 1e-6:
        warnings.warn(
            f"q: not on the configuration manifold (a norm differs from 1 by {largest:.2g}); "
            "normalized",
            PinfricWarning,
            stacklevel=4,
        )
    return normal
