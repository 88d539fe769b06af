"""Kinds of drives: of each all that is its own, in one module."""

from typing import NamedTuple

from pinfric.drives.kinds import cylinder, stepper
from pinfric.drives.kinds.kind import Kind
from pinfric.drives.limit import Limit


class KindOfDrive(NamedTuple):
    """A kind: what it has in place of a motor's figures, and its rows."""

    figures: type[Kind]
    limits: list[Limit]


KINDS = (
    KindOfDrive(stepper.Stepper, stepper.LIMITS),
    KindOfDrive(cylinder.Cylinder, cylinder.LIMITS),
)
