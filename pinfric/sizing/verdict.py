"""The verdict of a sizing, of which headline, colours, tables, signature and exit code are made.

A joint can be signed if a drive was chosen of which every necessary figure is known, and if all
`SizingReport.criteria` of it pass. A criterion is judged once:

- of a drive: a row of `drives.limits.LIMITS`,
- of a brake: `Standstill.criteria`,
- of a stop and where it ends: `SizingReport.screened.criteria[i]`; of a rating alone its gear's
  peak: `SizingReport.open_stops`,
- of the bus or the whole robot: `SizingReport.bus` and `.arm_criteria`.

Only `Status.FAILS` counts. What was not checked counts where a drive cannot be signed without it
(`Assessment.fits`).
"""

from __future__ import annotations

from enum import StrEnum

from pinfric.model.brief import counted
from pinfric.model.described import derived, described, quantity

#: Lines of what fails at the robot as a whole that the headline repeats.
_MOST_FAILING = 2


class JointState(StrEnum):
    """How the choice for a joint ended."""

    SIGNED = "can be signed"
    FAILS = "fails"
    PROVISIONAL = "provisional"
    NONE = "none"
    UNLOADED = "moves no mass"


@described
class JointVerdict:
    """The verdict on one joint."""

    name: str = quantity("the drive's", name=True)
    state: JointState = quantity(
        "can be signed; fails: a brake, a stop, or the place where it ends; provisional; none; "
        "moves no mass: not sized"
    )
    mass: float = quantity("of its drive, as far as known; 0 where none fits", "kg")
    margin: float | None = quantity(
        "the least of all criteria of drive, brake, stop and place; none: none was checked",
        heading="least\nmargin",
        cell="{margin:margin}",
    )
    tightest: str | None = quantity(
        "the criterion of the least margin; none: none was checked", heading="tightest\ncriterion"
    )
    why: str = quantity("what fails, in short; empty: nothing")
    failing: tuple[str, ...] = quantity("a line for each thing that fails")


@described
class Verdict:
    """The verdict on all joints and the robot.

    Attributes:
        joints: in the order of the report's; empty without a catalogue.
    """

    joints: tuple[JointVerdict, ...]
    failing: tuple[str, ...] = quantity(
        "a line for everything that keeps the sizing from being signed, of joints and robot"
    )
    question: str = quantity("what the scene leaves open, with both answers; empty: nothing")
    remarks: tuple[str, ...] = quantity("what is doubted, though it does not fail")

    @property
    @derived()
    def signed(self) -> bool:
        """Whether the choice can be signed: there is one, and `failing` is empty."""
        return bool(self.joints) and not self.failing

    @property
    @derived()
    def fitted(self) -> int:
        """Number of joints that can be signed."""
        return len(self.of(JointState.SIGNED))

    @property
    @derived()
    def sized(self) -> int:
        """Number of joints that get a drive: all but those that move no mass."""
        return len(self.joints) - len(self.of(JointState.UNLOADED))

    @property
    @derived("kg")
    def mass(self) -> float:
        """Mass of the drives that can be signed."""
        return sum(joint.mass for joint in self.of(JointState.SIGNED))

    @property
    @derived()
    def headline(self) -> str:
        """How many joints can be signed, the mass of their drives, which cannot, and the robot."""
        if not self.joints:
            unmet = f"{counted(len(self.failing), 'criterion', 'criteria')} not met"
            return unmet if self.failing else "no criterion fails"
        provisional = self.of(JointState.PROVISIONAL)
        said = f"{self.fitted} of {self.sized} joints can be signed"
        said += f", {len(provisional)} provisional" * bool(provisional)
        wrong = [joint.name for joint in self.joints if joint.why]
        parts = [f"{said}, not {', '.join(wrong)}" if wrong else said]
        if self.fitted:
            these = " for these" * (self.fitted < self.sized)
            parts.append(f"{self.mass:.2f} kg of drives{these}")
        if provisional:
            parts.append(f"{sum(joint.mass for joint in provisional):.2f} kg provisional")
        if unloaded := self.of(JointState.UNLOADED):
            named = ", ".join(joint.name for joint in unloaded)
            parts.append(f"{named}: moves no mass, not sized")
        parts += self.failing[sum(len(joint.failing) for joint in self.joints) :][:_MOST_FAILING]
        return "; ".join([*parts, *([self.question] if self.question else ())])

    def of(self, state: JointState) -> tuple[JointVerdict, ...]:
        """Return the joints that ended so."""
        return tuple(joint for joint in self.joints if joint.state == state)
