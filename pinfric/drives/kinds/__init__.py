"""Kinds of drives: of each all that is its own, in one module."""

from pinfric.drives.kinds import stepper
from pinfric.drives.limit import Limit

#: The rows of each kind, by its name.
KINDS: dict[str, list[Limit]] = {stepper.Stepper.NAME: stepper.LIMITS}
