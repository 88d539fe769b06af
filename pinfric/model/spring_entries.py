"""Springs of a scene: forces on links by their positions alone, without a drive.

The stiffness of gears is part of their transmission (`model.springs`).
"""

from __future__ import annotations

from typing import Annotated, Literal, get_args

import numpy as np
from pydantic import Field, model_validator

from pinfric.model.entry import Entry, NonNegative, Number, Positive, Text, Vector3, key

#: How far beyond its stroke a gas spring's law is used, of the stroke: its force is measured some
#: mm before the end.
_BEYOND = 0.05


class LinkPoint(Entry):
    """A point of a link."""

    link: str = key("of the robot", "base")
    xyz: Vector3 = key("in the link's frame", [0.2, 0, 0.1], "m", default=(0.0, 0.0, 0.0))


class Spring(Entry):
    """Base class of all kinds: `kind` says which."""

    kind: str
    name: Text = key("of the spring or hose", "balancer")

    @classmethod
    def kinds(cls) -> list[str]:
        """See `Entry.kinds`."""
        return list(get_args(cls.model_fields["kind"].annotation))


class TorsionSpring(Spring):
    """A spring in a joint, between its two links; in a sliding joint its torque is a force.

    torque = preload - stiffness (q - rest)
    """

    kind: Literal["torsion"] = key("a spring in a joint", "torsion")
    joint: str = key("of the robot, with one axis", "joint_2")
    stiffness: NonNegative = key("torque per angle", 20.0, "N m/rad or N/m")
    rest: Number = key("position where it gives `preload`", 0.5, "rad or m", default=0.0)
    preload: Number = key(
        "torque at `rest`, positive in the joint's direction", -5.0, "N m or N", default=0.0
    )

    def effort(self, q: np.ndarray) -> np.ndarray:
        """Return its torque or force on the joint at positions q (rad or m)."""
        return np.asarray(self.preload - self.stiffness * (q - self.rest))

    def energy(self, q: np.ndarray) -> np.ndarray:
        """Return its potential energy (J), 0 at `rest`."""
        x = q - self.rest
        return np.asarray(0.5 * self.stiffness * x**2 - self.preload * x)


class Hose(Spring):
    """A hose or cable that turns a joint with a constant torque; a sliding one it pushes."""

    kind: Literal["hose"] = key("a constant torque", "hose")
    joint: str = key("of the robot, with one axis", "joint_6")
    torque: Number = key(
        "on the joint, positive in its direction; where it slides, a force", 1.5, "N m or N"
    )

    def effort(self, q: np.ndarray) -> np.ndarray:
        """Return its torque or force on the joint, the same at all positions q."""
        return np.full_like(q, self.torque)

    def energy(self, q: np.ndarray) -> np.ndarray:
        """Return its potential energy (J), 0 at q = 0."""
        return np.asarray(-self.torque * q)


class TensionSpring(Spring):
    """A spring between two points that pulls them together; slack below its free length.

        pull = initial_tension + stiffness (length - free_length),    length > free_length

    With `pushes` it is also a compression spring: the same line below the free length.
    """

    kind: Literal["tension"] = key("a spring between two points", "tension")
    a: LinkPoint = key("one end", {"link": "base", "xyz": [0.2, 0, 0.1]})
    b: LinkPoint = key("the other end", {"link": "upper_arm", "xyz": [0.1, 0, 0.3]})
    stiffness: NonNegative = key("force per length", 2000.0, "N/m")
    free_length: NonNegative = key("without any force", 0.25, "m")
    initial_tension: NonNegative = key(
        "that opens it: a coil spring wound with its turns pressed together", 30.0, "N", default=0.0
    )
    pushes: bool = key("whether it also pushes below its free length", True, default=False)

    @model_validator(mode="after")
    def _one_law(self) -> TensionSpring:
        if self.pushes and self.initial_tension:
            raise ValueError(
                "`initial_tension` is of a spring whose turns touch, which cannot push; leave it "
                "or `pushes` out"
            )
        return self

    def pull(self, length: np.ndarray) -> np.ndarray:
        """Return the force (N) by which it pulls its ends together, at lengths (m)."""
        x = length - self.free_length
        taut = (x > 0.0) | self.pushes
        return np.asarray(np.where(taut, self.initial_tension + self.stiffness * x, 0.0))

    def energy(self, length: np.ndarray) -> np.ndarray:
        """Return its potential energy (J), 0 at its free length."""
        x = length - self.free_length
        x = x if self.pushes else np.maximum(x, 0.0)
        return np.asarray(self.initial_tension * x + 0.5 * self.stiffness * x**2)

    @property
    def reach(self) -> tuple[float, float]:
        """Between which lengths (m) its law holds."""
        return 0.0, np.inf


class GasSpring(Spring):
    """A gas spring, which pushes two points apart, more as it is compressed; its gas is ideal.

        force at s = force / (1 - (1 - 1/progression) s / stroke),    s = length - present length

    With `pulls` it is a traction gas spring: it pulls them together, more as it is extended by s.
    Friction of its seal is an entry of its name in `friction`, as of a cylinder. A state with s
    beyond 0 to `stroke` (and a little more) is refused.
    """

    kind: Literal["gas"] = key("a gas spring", "gas")
    a: LinkPoint = key("one end", {"link": "base", "xyz": [0.2, 0, 0.1]})
    b: LinkPoint = key("the other end", {"link": "upper_arm", "xyz": [0.1, 0, 0.3]})
    force: Positive = key("at `length`, its least", 400.0, "N")
    length: Positive = key("between its ends, extended; of one that pulls, drawn in", 0.5, "m")
    stroke: Positive = key("by which it can be compressed, or drawn out", 0.2, "m")
    progression: Number = key("force after the stroke / force", 1.3, "1", ge=1, default=1.0)
    pulls: bool = key("whether it pulls its ends together", True, default=False)

    @model_validator(mode="after")
    def _has_a_rod(self) -> GasSpring:
        if self.stroke >= self.length and not self.pulls:
            raise ValueError(
                f"stroke {self.stroke:g} m is not below the length {self.length:g} m of the "
                "extended spring, measured between its ends"
            )
        return self

    @property
    def _steepness(self) -> float:
        return (1.0 - 1.0 / self.progression) / self.stroke

    def _stroke_at(self, length: np.ndarray) -> np.ndarray:
        return length - self.length if self.pulls else self.length - length

    def pull(self, length: np.ndarray) -> np.ndarray:
        """Return the force (N) by which it pulls its ends together, below 0 if it pushes."""
        force = self.force / (1.0 - self._steepness * self._stroke_at(length))
        return np.asarray(force if self.pulls else -force)

    def energy(self, length: np.ndarray) -> np.ndarray:
        """Return its potential energy (J), 0 at `length`."""
        s, steepness = self._stroke_at(length), self._steepness
        if steepness * self.stroke < 1e-9:
            return np.asarray(self.force * s)
        return np.asarray(-self.force / steepness * np.log1p(-steepness * s))

    @property
    def reach(self) -> tuple[float, float]:
        """Between which lengths (m) its law holds."""
        ends = self.length, self.length + (self.stroke if self.pulls else -self.stroke)
        spare = _BEYOND * self.stroke
        return min(ends) - spare, max(ends) + spare


JointSpring = TorsionSpring | Hose
LineSpring = TensionSpring | GasSpring


SpringsKey = Annotated[
    list[Annotated[JointSpring | LineSpring, Field(discriminator="kind")]],
    key(
        "springs and hoses that act on links",
        [{"kind": "hose", "name": "dress_pack", "joint": "joint_6", "torque": 1.5}],
    ),
]


class SpringList(Entry):
    """The springs of a scene made in Python."""

    springs: SpringsKey
