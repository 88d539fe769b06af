"""Findings of a check: one for each place, with the value in another unit."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from functools import partial

from pinfric.errors import PinfricError
from pinfric.model.brief import file_name, screen
from pinfric.model.described import derived, described, quantity
from pinfric.model.upward import Shown


class Severity(IntEnum):
    """Severity of a finding."""

    #: What one should know; nothing is wrong.
    NOTE = 1
    #: Implausible; the figures that depend on it deserve doubt.
    WARNING = 2
    #: The figures would be wrong, or there are none.
    ERROR = 3


@described
class Finding:
    """One finding of a check."""

    severity: Severity = quantity("error, warning or note", heading="severity")
    kind: str = quantity("identifier of this kind of finding, for programs")
    place: str = quantity(
        'where: "link NAME", "joint NAME", "robot", or a key of the scene', heading="where"
    )
    found: str = quantity("the value found there")
    why: str = quantity("why it is implausible, or what follows; may be empty")
    if_unit: str = quantity(
        "the value if it is in another unit; empty: no unit explains it", default=""
    )
    excess: float = quantity("factor by which it exceeds the plausible limit", default=1.0)
    unsigned: bool = quantity(
        "of a warning: whether no drive is signed beside it, as beside an error", default=False
    )

    @property
    @derived()
    def refuses(self) -> bool:
        """Whether no drive is signed beside it."""
        return self.unsigned or self.severity == Severity.ERROR

    @property
    @derived(heading="what")
    def text(self) -> str:
        """The finding as one line, without its place."""
        said = f"{self.found}: {self.why}" if self.why else self.found
        return f"{said}; {self.if_unit}" if self.if_unit else said


note, warning, error = (partial(Finding, severity) for severity in Severity)

#: Kind of a doubted mass that the robot's owner confirms.
CONFIRMED = "confirmed masses"
#: The same finding at more places is one line, with so many of their names.
_MOST_NAMES = 4


def alike(findings: Iterable[Finding]) -> list[tuple[Finding, str]]:
    """Return the first finding of each severity and kind, and at which other places it is, too."""
    groups: dict[tuple[Severity, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.severity, finding.kind), []).append(finding)
    named = []
    for first, *same in groups.values():
        word = first.place.partition(" ")[0]
        names = ", ".join(f.place.removeprefix(f"{word} ") for f in same[:_MOST_NAMES])
        more = f" and {len(same) - _MOST_NAMES} more" if len(same) > _MOST_NAMES else ""
        named.append((first, f"; also {names}{more}" if same else ""))
    return named


def lines(findings: Iterable[Finding]) -> list[str]:
    """Return findings in words, the same finding at several places as one."""
    return [f"{first.place}: {first.text}{also}" for first, also in alike(findings)]


def errors(findings: Iterable[Finding]) -> list[str]:
    """Return in words the findings beside which no figure is right."""
    return lines(finding for finding in findings if finding.severity == Severity.ERROR)


def remarks(findings: Iterable[Finding]) -> list[str]:
    """Return in words what is doubted: warnings, and a mass that is confirmed."""
    doubted = (f for f in findings if f.severity == Severity.WARNING or f.kind == CONFIRMED)
    return lines(doubted)


@described
class CheckReport(Shown):
    """All findings on a robot or a scene, the most severe first."""

    source: str = quantity("the file")
    findings: tuple[Finding, ...] = quantity("sorted by severity, then by excess")
    figures: dict[str, float] = quantity(
        "the robot as a whole: links, joints, moving_mass and fixed_mass (kg), reach (m; along its "
        "joints, from the first that moves)",
        default_factory=dict,
    )
    files: tuple[str, ...] = quantity("files that were read: the scene, its URDF", default=())

    def __repr__(self) -> str:
        counts = f"{self.errors} errors, {self.warnings} warnings, {self.notes} notes"
        return screen(
            "CheckReport",
            f"{file_name(self.source)}: {counts}",
            {
                "first": f"{self.findings[0].place}: {self.findings[0].text}"
                if self.findings
                else "",
                "more": ".findings .summary() .check()",
            },
        )

    @property
    @derived()
    def errors(self) -> int:
        """How many errors there are."""
        return self.count(Severity.ERROR)

    @property
    @derived()
    def warnings(self) -> int:
        """How many warnings there are."""
        return self.count(Severity.WARNING)

    @property
    @derived()
    def notes(self) -> int:
        """How many notes there are."""
        return self.count(Severity.NOTE)

    def count(self, severity: Severity) -> int:
        """Return how many findings there are of one severity."""
        return sum(finding.severity == severity for finding in self.findings)

    def check(self, strict: bool = False) -> None:
        """Raise if there are errors, or with `strict` warnings.

        Raises:
            PinfricError: says how many there are, and the first.
        """
        least = Severity.WARNING if strict else Severity.ERROR
        failed = [finding for finding in self.findings if finding.severity >= least]
        if failed:
            first = failed[0]
            more = f" (and {len(failed) - 1} more)" if len(failed) > 1 else ""
            raise PinfricError(f"{self.source}: {first.place}: {first.text}{more}")
