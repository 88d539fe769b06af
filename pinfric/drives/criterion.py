"""One check of a drive: required value, available value, and the result.

    margin = 1 - required/available,

0.25: a quarter of the limit is left; negative: it fails. A criterion that lacks a figure is *not
checked* and names it.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

import numpy as np

from pinfric.model.described import described, quantity

#: Voltages that pass are no tighter the nearer they are; a motor's own is often that of the bus.
STEPS = "bus voltage", "motor voltage", "amplifier bus voltage", "amplifier least voltage"
#: Margin that stands for minus infinity: nothing is available, or more than any number is needed.
LEAST_MARGIN = -1e9


class Status(StrEnum):
    """Result of a criterion."""

    PASSES = "passes"
    FAILS = "fails"
    NOT_CHECKED = "not checked"
    NOT_REQUIRED = "not required"


@described
class Criterion:
    """One check of one candidate."""

    name: str = quantity("name of the criterion", heading="criterion")
    status: Status = quantity("met, not met or not checked", heading="status")
    required: float | None = quantity("what the motion needs; none: not known", "in unit", "needs")
    available: float | None = quantity("what the drive has; none: not known", "in unit", "has")
    unit: str = quantity("of both", heading="unit")
    margin: float | None = quantity(
        "1 - required/available; none: not checked", heading="margin", cell="{margin:margin}"
    )
    formula: str = quantity("formula of the check", heading="formula")
    source: str = quantity("source of the rule", heading="source and remarks")
    note: str = quantity("remark, or the value that is missing", default="")
    condition: str = quantity(
        "the keys of the conditions that set one side, and their defaults", default=""
    )
    missing: str = quantity("the figure that is missing, where it is not checked", default="")

    @property
    def fails(self) -> bool:
        """Whether it is not met."""
        return self.status == Status.FAILS

    @property
    def unchecked(self) -> bool:
        """Whether a figure is missing."""
        return self.status == Status.NOT_CHECKED

    @property
    def lacks(self) -> str:
        """The missing figure of a criterion that was not checked; else its note."""
        return self.missing or self.note

    @property
    def scaled(self) -> bool:
        """Whether the margin is a measure of the reserve.

        Back-driving has no scale; of `STEPS` only what fails has one.
        """
        if self.margin is None or self.name == "back-driving":
            return False
        return self.name not in STEPS or self.fails

    @property
    def _no_finite_margin(self) -> bool:
        """Whether too much is asked for, or nothing is there."""
        beyond = self.margin is not None and self.margin <= LEAST_MARGIN
        return beyond and (self.required == np.inf or (self.available or 0.0) <= 0.0)

    @property
    def shortfall(self) -> str:
        """Shortfall or reserve relative to the limit; in words if there is no number."""
        if self.margin is None or (self._no_finite_margin and self.note):
            return self.note
        share = abs(self.margin) * 100
        return f"{share:.3g} %" if share < 1000 else "a factor of more than ten"

    @property
    def why(self) -> str:
        """Return shortfall or reserve in words, or what is missing."""
        said = self.condition if self.fails else ""
        by = f" ({said})" if said else ""
        if self._no_finite_margin and self.note:
            return f"{self.name}: {self.note}{by}"  # no number says more
        if self.margin is None or self.required is None or self.available is None:
            return f"{self.name}: {self.status}" + (f": {self.note}" if self.note else "") + by
        tail = f"short by {self.shortfall}" if self.margin < 0 else f"{self.shortfall} in reserve"
        unit, ends = f" {self.unit}" if self.unit else "", (self.required, self.available)
        digits = next((d for d in range(4, 9) if len({f"{x:.{d}g}" for x in ends}) == 2), 4)
        needs, has = (f"{x:.{digits}g}{unit}" for x in ends)
        tail += f"; {said}" if said else ""
        return f"{self.name}: needs {needs}, has {has} ({tail})"


def compare(
    name: str,
    required: float | None,
    available: float | None,
    unit: str,
    formula: str,
    source: str,
    missing: str = "",
    note: str = "",
    condition: str = "",
) -> Criterion:
    """Return the criterion required <= available, or "not checked: no figure" where one is None.

    Args:
        required, available: numbers >= 0; infinite `required` fails, whatever is available.
        missing: the figure that is missing if one is None.
        condition: that sets one side, in words.
    """
    if required is None or (available is None and required < np.inf):
        text = f"no figure ({missing})" if missing else "no figure"
        text = f"{text}; {note}" if note else text
        status, figures = Status.NOT_CHECKED, (required, available, unit, None)
        return Criterion(name, status, *figures, formula, source, text, condition, missing)
    margin = 0.0 if required <= 0 else -np.inf  # where nothing is available
    if available is not None and available > 0:
        margin = 1 - required / available
    margin = max(margin, LEAST_MARGIN)
    status = Status.PASSES if margin >= 0 else Status.FAILS
    least = float(margin)
    return Criterion(
        name, status, required, available, unit, least, formula, source, note, condition
    )


def least_margin(criteria: Iterable[Criterion]) -> float:
    """Return the least margin of what was checked and has a scale; 0 if nothing was."""
    return min((c.margin for c in criteria if c.margin is not None and c.scaled), default=0.0)
