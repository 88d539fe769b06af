"""What a kind of drives gives, whose torque follows other laws than an electric motor's."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from pinfric.drives.policy import Conditions
from pinfric.model.entry import Entry


class Kind(Entry):
    """What a kind has in place of continuous and peak torque and of the speed-torque line.

    Attributes:
        NAME: in words, of one. NEEDS: what its maker must print, as of `policy.NEEDS`.
        PRODUCT: of `policy.SURROUNDINGS`. ON_BUS: whether the bus feeds it.
        REPLACED: names of rows of motors that do not apply; its own are its module's `LIMITS`.
        SHOWN: names of its rows that are printed beside the choice.
        UNFED: why no amplifier of the catalogue feeds it. NOT_RETIMED: why no motion is retimed.
    """

    NAME: ClassVar[str]
    NEEDS: ClassVar[Mapping[str, str]]
    PRODUCT: ClassVar[str] = "motor"
    ON_BUS: ClassVar[bool] = True
    REPLACED: ClassVar[Collection[str]]
    SHOWN: ClassVar[tuple[str, ...]] = ()
    UNFED: ClassVar[str]
    NOT_RETIMED: ClassVar[str]

    @property
    def by_rule(self) -> str:
        """Say what of it is by a rule, and makes it the last choice of equal masses; or empty."""
        return ""

    @property
    def driver_heat(self) -> float | None:
        """Heat of its driver that is not in the bus power, W; None: not known."""
        return 0.0

    @property
    def highest_voltage(self) -> float:
        """Of the bus, where its maker prints none, V."""
        return np.inf

    @property
    def torques(self) -> tuple[float | None, str]:
        """What stands for its continuous and peak torque, N m or N, and why."""
        raise NotImplementedError

    @property
    def serves(self) -> str:
        """Which joints take it, of a section of its own, as `parts.output_of` says."""
        return "linear"

    @property
    def stroke(self) -> float | None:
        """Of one of `drives`, m; None: it has no end."""
        return None

    def drives(self, name: str) -> Iterator[tuple[str, Kind, dict[str, Any]]]:
        """Yield the drives of an entry: name, figures of one, what a gearmotor has of it."""
        yield from ()

    @property
    def unbraked(self) -> tuple[bool, str]:
        """Whether it holds its joint without power and without a brake, and how or why not."""
        return False, ""

    def share(
        self, torque: np.ndarray, speed: np.ndarray, standing: np.ndarray, conditions: Conditions
    ) -> float:
        """Return the largest share of its torque that a cycle takes; NaN: it has no such share.

        Args:
            torque, speed, standing: (T,) at its shaft, the worst end of the torque.
        """
        return np.nan

    @classmethod
    def least_shares(
        cls,
        kinds: Sequence[Kind],
        torque: np.ndarray,
        speed: np.ndarray,
        slow: float,
        conditions: Conditions,
    ) -> np.ndarray:
        """Return lower bounds (n, m) of `share` of m of this kind behind n gears.

        Args:
            torque: (k, n, m), speed: (k, n), magnitudes at some samples of a cycle.
            slow: speed, rad/s, above which it certainly does not stand still.
        """
        return np.full(torque.shape[1:], np.nan)
