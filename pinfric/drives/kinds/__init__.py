"""Kinds of drives: of each all that is its own, in one module; here what catalogues take of them.

A kind stands in for a motor's figures under a key of motors (`KindsOfMotors`), or has a section of
its own (`KindSections`), whose entries are whole drives.
"""

from typing import NamedTuple

from pinfric.drives.kinds.cylinder import LIMITS as CYLINDERS
from pinfric.drives.kinds.cylinder import Cylinder
from pinfric.drives.kinds.kind import Kind
from pinfric.drives.kinds.stepper import LIMITS as STEPPERS
from pinfric.drives.kinds.stepper import Stepper
from pinfric.drives.limit import Limit
from pinfric.model.entry import Entry, key, optional


class KindOfDrive(NamedTuple):
    """A kind: what it has in place of a motor's figures, and its rows."""

    figures: type[Kind]
    limits: list[Limit]


KINDS = KindOfDrive(Stepper, STEPPERS), KindOfDrive(Cylinder, CYLINDERS)


class KindsOfMotors(Entry):
    """Keys of a motor that make it one of a kind."""

    stepper: Stepper | None = optional(
        "of a stepper motor, in place of torques and speeds",
        {"holding_torque": 0.59, "current": 2.0, "resistance": 1.4, "inductance": 0.003},
    )

    @property
    def special(self) -> Kind | None:
        """What it has in place of torques and a speed-torque line; None: it has these."""
        return next((kind for name in _KEYS if (kind := getattr(self, name)) is not None), None)


#: Of a class pydantic looks up its fields anew each time.
_KEYS = tuple(KindsOfMotors.model_fields)


class KindSections(Entry):
    """Sections of a catalogue whose entries are whole drives."""

    cylinders: dict[str, Cylinder] = key(
        "hydraulic and pneumatic, for drives between two points and `conditions.cylinders`",
        {
            "C 80/45": {
                "source": "data sheet",
                "grade": "R",
                "medium": "hydraulic",
                "bore": 0.08,
                "rod": 0.045,
                "strokes": [0.5, 0.8],
                "rated_pressure": 1.6e7,
            }
        },
        default_factory=dict,
    )
