"""What a kind of drives gives, whose torque follows other laws than an electric motor's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from pinfric.drives.policy import Conditions
from pinfric.model.entry import Entry


class Kind(Entry):
    """What a kind has in place of continuous and peak torque and of the speed-torque line.

    The rows of motors that hang on these do not apply to it; its own are its module's `LIMITS`.

    Attributes:
        NAME: in words, of one. NEEDS: what its maker must print, as of `policy.NEEDS`.
        UNFED: why no amplifier of the catalogue feeds it. NOT_RETIMED: why no motion is retimed.
    """

    NAME: ClassVar[str]
    NEEDS: ClassVar[Mapping[str, str]]
    UNFED: ClassVar[str]
    NOT_RETIMED: ClassVar[str]

    @property
    def by_rule(self) -> str:
        """Say what of it is by a rule, and makes it the last choice of equal masses; or empty."""
        raise NotImplementedError

    @property
    def driver_heat(self) -> float | None:
        """Heat of its driver that is not in the bus power, W; None: not known."""
        raise NotImplementedError

    @property
    def highest_voltage(self) -> float:
        """Of the bus, where its maker prints none, V."""
        raise NotImplementedError

    @property
    def torques(self) -> tuple[float, str]:
        """What stands for its continuous and peak torque, N m, and why."""
        raise NotImplementedError

    def share(
        self, torque: np.ndarray, speed: np.ndarray, standing: np.ndarray, conditions: Conditions
    ) -> float:
        """Return the largest share of its torque that a cycle takes.

        Args:
            torque, speed, standing: (T,) at its shaft, the worst end of the torque.
        """
        raise NotImplementedError

    def least_share(
        self, torque: np.ndarray, speed: np.ndarray, slow: float, conditions: Conditions
    ) -> np.ndarray:
        """Return a lower bound (n,) of `share` behind n gears.

        Args:
            torque, speed: (k, n) magnitudes at some samples of a cycle.
            slow: speed, rad/s, above which it certainly does not stand still.
        """
        raise NotImplementedError
