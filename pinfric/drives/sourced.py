"""What all entries of a catalogue have: the source of their figures."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

from pydantic import model_validator

from pinfric.model.entry import Entry, Positive, Text, key, optional


class Sourced(Entry):
    """Source of an entry's figures."""

    source: Text = key("maker's document and page", "a maker's catalogue, p. 197")
    grade: Literal["R", "T"] = key(
        "R: read in the maker's document, T: retyped by a third party", "R"
    )
    note: str = key("remarks", "peak printed without a duration", default="")
    price: Positive | None = optional("of one piece", 310.0, "of the catalogue's currency")
    dimensions: str = key("in words", "60 mm x 88 mm", default="")
    stand_ins: dict[str, str] = key(
        "values taken from another product, and which, or from a rule",
        {"stiffness": "the next smaller size"},
        default_factory=dict,
    )

    @model_validator(mode="after")
    def _stand_ins_are_figures(self) -> Sourced:
        for name in self.stand_ins:
            if getattr(self, name, None) is None:
                raise ValueError(f"stand_ins: {name!r} is not a figure of this entry")
        return self


def rising(entry: Sourced, curve: str, point: str) -> None:
    """Refuse a curve of one point, or whose first figures do not ascend."""
    at = [first for first, _ in getattr(entry, curve) or ()]
    if any(b <= a for a, b in pairwise(at)) or len(at) == 1:
        first = point.partition(",")[0]
        raise ValueError(f"{curve}: points [{point}], {first} ascending, two or more")


def ascending(entry: Sourced, smaller: str, larger: str) -> None:
    """Refuse two figures in the wrong order."""
    low, high = getattr(entry, smaller), getattr(entry, larger)
    if low is not None and high is not None and low > high:
        raise ValueError(f"{smaller} {low:g} is more than {larger} {high:g}: swapped, or a unit?")
