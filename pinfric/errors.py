"""All errors and warnings of pinfric; catch `PinfricError` to catch every error."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any

#: Longer lists are cut: so that messages stay readable.
_MOST_NAMES, _NEAREST, _MOST_PROBLEMS = 40, 3, 5
#: Words of pydantic, and ours.
_WORDS = {
    "a valid string": "text",
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
}
#: Letters of a whole message: longer than any path, shorter than a screen.
_MOST_LETTERS = 6000


class PinfricError(Exception):
    """The base class of all errors of pinfric; the message is one line."""

    def __str__(self) -> str:
        return one_line(super().__str__())


class SceneError(PinfricError):
    """A scene file (or the arguments of `Scene`) contains an impossible or unknown entry."""


class RobotError(PinfricError):
    """A URDF cannot be read, or describes an impossible body."""


class TrajectoryError(PinfricError):
    """A trajectory cannot be read, or does not fit the robot."""


class StateError(PinfricError):
    """Arrays of states or efforts have a wrong shape or impossible values."""


class StopError(PinfricError):
    """A stop cannot be computed, or does not end."""


class RollMomentError(PinfricError):
    """A guide without a width is loaded by a moment about its axis, which it cannot carry."""

    def __init__(self, site: str, sample: int, moment: float) -> None:
        self.site, self.sample, self.moment = site, sample, moment
        super().__init__(
            f"friction.{site}.bearing: sample {sample} loads this guide with a moment of "
            f"{moment:.6g} N m about its axis, and a guide without width cannot carry "
            f"it; give `width` (m, between the two rails or keys)"
        )


class ClosureError(PinfricError):
    """A loop cannot close near the given configuration.

    Attributes:
        loop: its name.
        sample: index of the configuration.
        residual: m, remaining distance of its frames (rotations times the mechanism's size).
    """

    def __init__(self, loop: str, sample: int, residual: float, reason: str = "") -> None:
        self.loop, self.sample, self.residual = loop, sample, residual
        super().__init__(
            f"loop {loop!r}, sample {sample}: {reason}"
            if reason
            else f"loop {loop!r} cannot close at sample {sample}: its frames stay {residual:.3g} m "
            "apart (rotations times the mechanism's size); start nearer, or fix other joints"
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
    """A motion that needs an effort where the scene has no drive.

    Attributes:
        joint: the undriven joint.
        sample: the one with the largest effort.
        effort: needed there beyond the largest friction (N m or N).
        others: further undriven joints that need one.
    """

    def __init__(
        self,
        joint: str,
        sample: int,
        effort: float,
        counts: str,
        others: Sequence[str] = (),
        standing: bool = False,
    ) -> None:
        self.joint, self.sample, self.effort, self.others = joint, sample, effort, tuple(others)
        more = f", and efforts at {', '.join(others)}" if others else ""
        remedy = "add a drive for it, lock the joint, or give a motion that needs no effort there"
        if others:
            remedy = "add drives for them, lock the joints, or give a motion that needs none there"
        if standing:
            remedy = (
                "give the forces at the feet with the motion, or name them under `feet` in the "
                "scene: `pinfric inverse` (pf.stand) takes all forces within friction"
            )
        super().__init__(
            f"actuators: {counts}; undriven: {joint}, where this motion needs {effort:.3g} "
            f"(N m or N) at sample {sample}{more}; {remedy}"
        )


class ToggleError(StateError):
    """A configuration in which the loops allow more degrees of freedom than elsewhere.

    Attributes:
        loop: name of one of the loops.
    """

    def __init__(self, loop: str, freedoms: int, elsewhere: int) -> None:
        self.loop, self.freedoms, self.elsewhere = loop, freedoms, elsewhere
        super().__init__(
            f"loop {loop!r}: a toggle: the mechanism has {freedoms} degrees of freedom here and "
            f"{elsewhere} elsewhere, so its further motion is not determined; start "
            "elsewhere or keep the motion away from it"
        )


class AccelerationError(PinfricError):
    """Stick and slip allow no acceleration, or several, at one state: the base of those below.

    Attributes:
        q, v, effort: the state and the efforts (nq,), (nv,), (na,), or the motors' torques.
        given: which of the two: "effort" or "motor_torque".
        site: name of the joint with friction at which it was found.
        time: s, in a simulation; else None.
        motion: what the simulation computed until then; else None.
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
        """Return the same error with the time in a simulation."""
        state = self.q, self.v, self.effort
        return type(self)(*state, self.site, self.reason, time, self.given)


class NoConsistentAcceleration(AccelerationError):  # noqa: N818 - a finding about the mechanism
    """No combination of stick and slip obeys the laws of friction at this state (Painleve)."""

    _finding = "no acceleration obeys the laws of friction"


class AmbiguousAcceleration(AccelerationError):  # noqa: N818 - a finding about the mechanism
    """Several accelerations obey the laws of friction at this state (Painleve)."""

    _finding = "several accelerations obey the laws of friction"


class UndecidedAcceleration(AccelerationError):  # noqa: N818 - a finding about the search
    """The search for stick and slip ended before it found an acceleration, or ruled out others."""

    _finding = "the search for the acceleration ended undecided"


class GearJam(AccelerationError):  # noqa: N818 - a finding about the mechanism
    """A self-locking gear whose rotor is too light for the load: no acceleration, or several."""

    _finding = "a self-locking gear jams"


class IdentificationError(PinfricError):
    """Logs from which nothing can be identified, or that contradict the robot."""


class SimulationError(PinfricError):
    """A simulation cannot start or continue; `motion` was computed until then, or is None."""

    def __init__(self, message: str, motion: Any = None) -> None:
        self.motion = motion
        super().__init__(message)


class SimulationInterrupted(KeyboardInterrupt):
    """Ctrl-C ended a simulation; `motion` was computed until then."""

    def __init__(self, motion: Any) -> None:
        self.motion = motion
        super().__init__("stopped by the user")


class CatalogError(PinfricError):
    """A catalogue of motors and gears cannot be read, or contains impossible figures."""


class SizingError(PinfricError):
    """Drives cannot be sized: nothing to choose from, or no candidate that fits.

    Attributes:
        report: the results until then, or None.
    """

    def __init__(self, message: str, report: Any = None) -> None:
        self.report = report
        super().__init__(message)


class RetimeError(PinfricError):
    """Drives that cannot follow a path at any speed, or whose data are incomplete."""


class SweepError(PinfricError):
    """A sweep's file has an impossible entry, or its samples cannot be computed or saved."""


class PinfricWarning(UserWarning):
    """A result is computed, but the user should check the input."""


class FindingWarning(PinfricWarning):
    """A warning of what `pinfric check` lists as a finding."""


def one_line(text: str) -> str:
    """Return a text that a terminal shows as one line.

    Line ends, control characters and halves of surrogate pairs are written as escapes; a very long
    text loses its middle.
    """
    if not text.isprintable():
        text = "".join(
            letter if letter.isprintable() else letter.encode("unicode_escape").decode()
            for letter in text
        )
    return cut(text, _MOST_LETTERS)


def cut(text: str, letters: int) -> str:
    """Return the text, or its beginning and its end if it has more letters."""
    if len(text) <= letters:
        return text
    return f"{text[: letters * 2 // 3]} ... {text[len(text) - letters // 3 :]}"


def problems_line(where: str, problems: Sequence[str]) -> str:
    """Return one line: how many problems there are, the first few, and how many more.

    Args:
        where: the file or section.
        problems: at least one; equal ones are listed once.
    """
    problems = list(dict.fromkeys(problems))
    count = f"{len(problems)} problems: " if len(problems) > 1 else ""
    unlisted = len(problems) - _MOST_PROBLEMS
    more = f"; and {unlisted} more" if unlisted > 0 else ""
    return f"{where}: {count}{'; '.join(problems[:_MOST_PROBLEMS])}{more}"


def choose_from(name: object, allowed: Iterable[str], taken: Iterable[object] = ()) -> str:
    """Return the allowed names for the end of an error message; of many the nearest three.

    Args:
        name: what was given.
        allowed: the allowed names.
        taken: names in use, which are not suggested.
    """
    names = list(allowed)
    if not names:
        return "there are none"
    free = [other for other in names if other not in list(taken)]
    near = difflib.get_close_matches(str(name), free, n=_NEAREST, cutoff=0.6)
    if len(names) > _MOST_NAMES:
        word = str(name).lower()
        alike = [other for other in free if word in other.lower()]
        if len(near) < _NEAREST:  # less alike ones, too
            near = difflib.get_close_matches(str(name), free, n=_NEAREST, cutoff=0.0)
        alike += near
        nearest = list(dict.fromkeys(alike))[:_NEAREST]
        return f"the nearest of {len(names)}: {', '.join(map(repr, nearest))}"
    guess = f"did you mean {near[0]!r}? " if near else ""
    return f"{guess}there are: {', '.join(names)}"


def plain(message: str) -> str:
    """Return pydantic's message in our words: "should be greater than 0"."""
    text = message.removeprefix("Input ").partition(", unable to parse")[0]
    for theirs, ours in _WORDS.items():
        text = text.replace(theirs, ours)
    return f"{text[0].lower()}{text[1:]}"
