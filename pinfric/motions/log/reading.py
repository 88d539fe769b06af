"""How a log is to be read, and what its reading did."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pinfric.errors import TrajectoryError, choose_from
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.csv_text import number_of
from pinfric.motions.log.noise import low_pass

#: rad per unit of angle, s per unit of time.
ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180.0, "turn": 2.0 * np.pi}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class Thinning:
    """Which samples of a recording are kept.

    Args:
        rate: Hz, down to which samples are left out.
        cutoff: Hz of the low pass on accelerations and efforts before, against aliasing.
    """

    rate: float
    cutoff: float

    def every(self, step: float) -> int:
        """Return the number of samples of which one is kept; `step` in s."""
        return max(1, int((1.0 + 1e-6) / (self.rate * step)))

    def acceleration(self, column: FloatArray, step: float) -> FloatArray:
        """Return one joint's accelerations (T,) low-passed; where they are 0, they stay."""
        return np.where(column != 0.0, low_pass(column, step, self.cutoff), 0.0)

    def effort(self, column: FloatArray, step: float) -> FloatArray:
        """Return one joint's efforts (T,) low-passed, NaN where there is none."""
        known = np.isfinite(column)
        if not known.any():
            return column
        place = np.arange(column.size)
        whole = column if known.all() else np.interp(place, place[known], column[known])
        return np.where(known, low_pass(whole, step, self.cutoff), np.nan)


@dataclass(frozen=True)
class ReadingOptions:
    """What a person says about a log; None is found out from the log itself, or refused.

    Args:
        columns: file that maps joints to columns; None takes LOG.columns.yaml beside the log.
        unit: of angles, "rad", "deg" or "turn". time_unit: "s", "ms", "us" or "ns".
        cutoff: Hz of the low pass on every joint, or "none": positions are taken as they are.
        thinning: which samples of a filtered recording are kept; None keeps all.
        currents: joints whose current, where no effort is logged, is read as their effort.
        without: joints whose efforts are not read: `identify` lets them move as logged, and keeps
            the scene's friction.

    Raises:
        TrajectoryError: a unit that there is not, a cutoff that is not positive.
    """

    columns: Path | str | None = None
    unit: str | None = None
    time_unit: str | None = None
    cutoff: float | str | None = None
    thinning: Thinning | None = None
    currents: frozenset[str] = frozenset()
    without: Collection[str] = frozenset()

    def __post_init__(self) -> None:
        object.__setattr__(self, "without", frozenset(self.without))
        for option, value, units in (
            ("unit", self.unit, ANGLE_UNITS),
            ("time-unit", self.time_unit, TIME_UNITS),
        ):
            if value is not None and value not in units:
                raise TrajectoryError(f"--{option} {value}: {choose_from(value, units)}")
        if self.cutoff is None or self.cutoff == "none":
            return
        try:
            frequency = number_of(self.cutoff) if isinstance(self.cutoff, str) else self.cutoff
        except ValueError:
            frequency = np.nan
        if not (np.isfinite(frequency) and frequency > 0.0):
            raise TrajectoryError(f"--cutoff {self.cutoff}: give a frequency in Hz, or none")
        object.__setattr__(self, "cutoff", frequency)


@dataclass(frozen=True)
class DerivativeNoise:
    """What noise and low pass leave uncertain in a log's derivatives; columns as the joints'.

    Args:
        moving: (T, nj) bool, where a joint is not held; only there is anything uncertain.
        velocity, acceleration: (nj,) standard deviations, rad/s (m/s) and rad/s^2 (m/s^2).
        acceleration_shift: (T, nj) change of the acceleration with a cutoff lower by 1/sqrt(2), of
            a Gaussian low pass by 1/2: as much may be lost near the cutoff.
        acceleration_cut: (nj,) RMS of the motion above the cutoff that the low pass took away.
    """

    moving: BoolArray
    velocity: FloatArray
    acceleration: FloatArray
    acceleration_shift: FloatArray
    acceleration_cut: FloatArray


@dataclass(frozen=True)
class Reading:
    """What the reading of a file found and did.

    Args:
        samples: rows that became samples.
        dropped: rows left out (torn, not finite, doubled or backward stamps, repeats of a slower
            rate, ends in motion).
        resampled: samples interpolated between rows.
        jitter: RMS of the stamps about regular time, s.
        noise: joint -> standard deviation of its positions' noise, rad or m; 0: rounding.
        cutoff: joint -> Hz; None: not filtered.
        notes: a line for everything that was guessed, repaired or filtered.
        noise_line: the one on noise and what was done about it.
        external: frame -> (T, 6) the log's own wrench on it, N and N m.
        world: frames whose wrenches are in the world's axes, not in theirs.
        effort: joint -> (T,) the log's own effort at the motion's samples, N m or N.
        uncertain: what stays uncertain in the derivatives; None where nothing was filtered.
    """

    samples: int
    dropped: int = 0
    resampled: int = 0
    jitter: float = 0.0
    noise: Mapping[str, float] = field(default_factory=dict)
    cutoff: Mapping[str, float | None] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    noise_line: str = ""
    effort: Mapping[str, FloatArray] = field(default_factory=dict)
    external: Mapping[str, FloatArray] = field(default_factory=dict)
    world: frozenset[str] = frozenset()
    uncertain: DerivativeNoise | None = None

    @property
    def filtered(self) -> bool:
        """Whether any joint's positions were low-passed."""
        return any(frequency is not None for frequency in self.cutoff.values())
