"""Every error and warning pinfric raises on purpose; catch `PinfricError` to catch them all."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class PinfricError(Exception):
    """The root of all errors of pinfric: a message for the person who made the input."""


class SceneError(PinfricError):
    """A scene file (or the arguments of `Scene`) says something that cannot be."""


class RobotError(PinfricError):
    """A URDF cannot be read, or describes a body that cannot exist."""


class TrajectoryError(PinfricError):
    """A trajectory cannot be read, or does not fit the robot."""


class StateError(PinfricError):
    """Arrays of states or efforts have a wrong shape or hold values that cannot be."""


class RollMomentError(PinfricError):
    """A guide without a width carries a moment about its axis, which it has no lever to resist."""

    def __init__(self, site: str, sample: int, moment: float) -> None:
        self.site, self.sample, self.moment = site, sample, moment
        super().__init__(
            f"friction.{site}.bearing: sample {sample} loads this guide with a moment of "
            f"{moment:.6g} N m about its axis, and a guide without width has no lever to resist "
            f"it; give `width` (m, between the two rails or keys)"
        )


class PinfricWarning(UserWarning):
    """Something that can be computed but that the person who made the input should look at."""


def choose_from(name: object, allowed: Iterable[str]) -> str:
    """Say which names there are, the nearest one first, for the end of an error message."""
    names = list(allowed)
    if not names:
        return "there are none"
    near = difflib.get_close_matches(str(name), names, n=1, cutoff=0.6)
    guess = f"did you mean {near[0]!r}? " if near else ""
    return f"{guess}there are: {', '.join(names)}"
