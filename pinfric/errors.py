"""Every error and warning pinfric raises on purpose; catch `PinfricError` to catch them all."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any

#: Longer lists are cut: a message should be read.
_MOST_NAMES, _NEAREST, _MOST_PROBLEMS = 40, 3, 5
#: Words of pydantic, and ours.
_WORDS = {
    "a valid string": "text",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
}
#: Letters of a whole message: more than any path, less than what scrolls away.
_MOST_LETTERS = 6000


class PinfricError(Exception):
    """The root of all errors of pinfric: one line for the person who made the input."""

    def __str__(self) -> str:
        return one_line(super().__str__())


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


class ClosureError(PinfricError):
    """A loop cannot close from where it was asked to.

    Attributes:
        loop: its name.
        sample: which of the configurations.
        residual: m, how far apart its frames stay (rotations times the mechanism's size).
    """

    def __init__(self, loop: str, sample: int, residual: float, reason: str = "") -> None:
        self.loop, self.sample, self.residual = loop, sample, residual
        super().__init__(
            f"loop {loop!r}, sample {sample}: {reason}"
            if reason
            else f"loop {loop!r} cannot close at sample {sample}: its frames stay {residual:.3g} m "
            "apart (rotations times the mechanism's size); start nearer, or hold other joints"
        )


class LoopMotionError(StateError):
    """A motion that a loop does not allow.

    Attributes:
        loop: its name.
        sample: the first such sample.
        amount: by how much (`unit`).
    """

    def __init__(self, loop: str, sample: int, what: str, amount: float, unit: str) -> None:
        self.loop, self.sample, self.amount, self.unit = loop, sample, amount, unit
        super().__init__(
            f"loop {loop!r} {what} at sample {sample}, by {amount:.3g} {unit}; give independent "
            "joints only and let the others follow (a trajectory file with their columns, "
            "`scene.close`, `pf.consistent_motion`)"
        )


class UndrivenMotionError(StateError):
    """A motion that takes an effort where the scene has no drive.

    Attributes:
        joint: what no drive moves.
        sample: the one that takes most.
        effort: what it takes there beyond all that friction can give (N m or N).
    """

    def __init__(self, joint: str, sample: int, effort: float, counts: str) -> None:
        self.joint, self.sample, self.effort = joint, sample, effort
        super().__init__(
            f"actuators: {counts}; undriven: {joint}, where this motion takes {effort:.3g} "
            f"(N m or N) at sample {sample}; name a drive for it, lock the joint, or give a motion "
            "that it does by itself"
        )


class ToggleError(StateError):
    """A configuration in which the loops let more motions through than elsewhere.

    Attributes:
        loop: name of one of the loops.
    """

    def __init__(self, loop: str, freedoms: int, elsewhere: int) -> None:
        self.loop, self.freedoms, self.elsewhere = loop, freedoms, elsewhere
        super().__init__(
            f"loop {loop!r}: a toggle: the mechanism has {freedoms} degrees of freedom here and "
            f"{elsewhere} elsewhere: how it moves on does not follow from its mechanics; start "
            "elsewhere or keep the motion away from it"
        )


class AccelerationError(PinfricError):
    """Stick and slip leave no acceleration, or several, at one state (base of those below).

    Attributes:
        q, v, effort: the state and the efforts (nq,), (nv,), (na,), or the motors' torques.
        given: which of the two: "effort", "motor_torque".
        site: name of the site with friction where it shows.
        time: in s where a simulation came upon it, else None.
        motion: what the simulation had computed until then, else None.
    """

    _finding = ""

    def __init__(
        self,
        q: Any,
        v: Any,
        effort: Any,
        site: str,
        reason: str,
        time: float | None = None,
        given: str = "effort",
    ) -> None:
        self.q, self.v, self.effort, self.site, self.given = q, v, effort, site, given
        self.reason, self.time = reason, time
        self.motion: Any = None
        when = "" if time is None else f" at t = {time:.9g} s"
        state = ", ".join(
            f"{name} = [{', '.join(f'{x:.6g}' for x in array)}]"
            for name, array in (("q", q), ("v", v), (given, effort))
        )
        super().__init__(f"{self._finding}{when}: joint {site!r}: {reason}; {state}")

    def at(self, time: float) -> AccelerationError:
        """Return the same finding with the time at which a simulation came upon it."""
        state = self.q, self.v, self.effort
        return type(self)(*state, self.site, self.reason, time, self.given)


class NoConsistentAcceleration(AccelerationError):  # noqa: N818 - a finding about the mechanism
    """No combination of stick and slip obeys the laws of friction at this state (Painleve)."""

    _finding = "no acceleration obeys the laws of friction"


class AmbiguousAcceleration(AccelerationError):  # noqa: N818 - a finding about the mechanism
    """Several accelerations obey the laws of friction at this state (Painleve)."""

    _finding = "several accelerations obey the laws of friction"


class UndecidedAcceleration(AccelerationError):  # noqa: N818 - a finding about the search
    """The search for stick and slip reached its bound before it found an acceleration."""

    _finding = "no acceleration was found within the search's bound"


class GearJam(AccelerationError):  # noqa: N818 - a finding about the mechanism
    """A self-locking gear whose rotor is too light for the load: no acceleration, or several."""

    _finding = "a self-locking gear jams"


class IdentificationError(PinfricError):
    """Logs from which nothing can be identified, or that contradict the robot."""


class SimulationError(PinfricError):
    """A simulation cannot start or go on; `motion` is what was computed until then, if anything."""

    def __init__(self, message: str, motion: Any = None) -> None:
        self.motion = motion
        super().__init__(message)


class CatalogError(PinfricError):
    """A catalogue of motors and gears cannot be read, or holds figures that cannot be."""


class SizingError(PinfricError):
    """Drives cannot be sized: nothing to choose from, or no candidate that fits.

    Attributes:
        report: what was found until then, or None.
    """

    def __init__(self, message: str, report: Any = None) -> None:
        self.report = report
        super().__init__(message)


class RetimeError(PinfricError):
    """Drives that cannot follow a path at any speed, or of which too little is known."""


class SweepError(PinfricError):
    """A sweep's file says something that cannot be, or its samples cannot be computed or kept."""


class PinfricWarning(UserWarning):
    """Something that can be computed but that the person who made the input should look at."""


def one_line(text: str) -> str:
    """Return a text that a terminal shows as one line, whatever the names in it hold.

    Line ends, control characters and halves of surrogate pairs are written as escapes; the middle
    of a very long text is left out.
    """
    if not text.isprintable():
        text = "".join(
            letter if letter.isprintable() else letter.encode("unicode_escape").decode()
            for letter in text
        )
    return cut(text, _MOST_LETTERS)


def cut(text: str, letters: int) -> str:
    """Return the text, or its begin and its end where it has more letters."""
    if len(text) <= letters:
        return text
    return f"{text[: letters * 2 // 3]} ... {text[len(text) - letters // 3 :]}"


def problems_line(where: str, problems: Sequence[str]) -> str:
    """Return one line for all that is wrong: how many, the first few, the rest counted.

    Args:
        where: the file or section.
        problems: one at least; the same one is said once.
    """
    problems = list(dict.fromkeys(problems))
    count = f"{len(problems)} problems: " if len(problems) > 1 else ""
    rest = len(problems) - _MOST_PROBLEMS
    more = f"; and {rest} more" if rest > 0 else ""
    return f"{where}: {count}{'; '.join(problems[:_MOST_PROBLEMS])}{more}"


def choose_from(name: object, allowed: Iterable[str], taken: Iterable[object] = ()) -> str:
    """Say which names there are, for the end of an error message; of many the nearest three.

    Args:
        name: what was found.
        allowed: the names that there are.
        taken: those that cannot have been meant.
    """
    names = list(allowed)
    if not names:
        return "there are none"
    free = [other for other in names if other not in list(taken)]
    near = difflib.get_close_matches(str(name), free, n=1, cutoff=0.6)
    if len(names) > _MOST_NAMES:
        word = str(name).lower()
        alike = [other for other in free if word in other.lower()]
        alike += difflib.get_close_matches(str(name), free, n=_NEAREST, cutoff=0.0)
        nearest = list(dict.fromkeys(alike))[:_NEAREST]
        return f"the nearest of {len(names)}: {', '.join(map(repr, nearest))}"
    guess = f"did you mean {near[0]!r}? " if near else ""
    return f"{guess}there are: {', '.join(names)}"


def plain(message: str) -> str:
    """Return what pydantic says of a value as we say it: "should be greater than 0"."""
    text = message.removeprefix("Input ").partition(", unable to parse")[0]
    for theirs, ours in _WORDS.items():
        text = text.replace(theirs, ours)
    return f"{text[0].lower()}{text[1:]}"
