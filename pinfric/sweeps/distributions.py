"""Distributions of a sweep's parameters: each maps numbers of [0, 1) to values.

All designs (random, Sobol) are made in the unit cube and mapped by the quantile function, so a seed
gives the same values on every machine.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, model_validator

from pinfric.model.entry import Entry, Number, Positive, key, optional

if TYPE_CHECKING:
    from scipy.stats.distributions import rv_frozen

#: A truncation that keeps less than this of its normal distribution was not meant.
_LEAST_KEPT = 1e-6


class Distribution(Entry):
    """Base: values from numbers u of [0, 1), and their range."""

    @property
    def frozen(self) -> rv_frozen:
        """SciPy's distribution with these parameters."""
        raise NotImplementedError

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return the values x with P(X <= x) = u, same shape as u."""
        # a normal's quantile is infinite at 0 and 1
        return self.frozen.ppf(np.clip(u, 2.0**-54, 1.0 - 2.0**-53))

    @property
    def support(self) -> tuple[float, float]:
        """The least and the greatest value; infinite if unbounded."""
        low, high = self.frozen.support()
        return float(low), float(high)

    @property
    def levels(self) -> tuple[float, ...] | None:
        """All values if they are finitely many, else None."""
        return None

    def probability_below(self, x: float) -> float:
        """Return P(X < x)."""
        return float(self.frozen.cdf(np.nextafter(x, -math.inf)))


class Normal(Distribution):
    """Normal with a mean and a standard deviation; unbounded on both sides."""

    mean: Number = key("of the values", 0.0, "of the parameter")
    std: Positive = key("standard deviation", 0.0175, "of the parameter")

    @property
    def frozen(self) -> rv_frozen:
        """SciPy's `norm`."""
        from scipy.stats import norm

        return norm(self.mean, self.std)


class TruncatedNormal(Distribution):
    """Normal with a mean and a standard deviation (before truncation), kept in [low, high]."""

    mean: Number = key("before truncation", 2.0, "of the parameter")
    std: Positive = key("standard deviation, before truncation", 0.2, "of the parameter")
    low: Number | None = optional(
        "smallest value; `low` or `high` is needed", 1.0, "of the parameter"
    )
    high: Number | None = optional("largest value", 3.0, "of the parameter")

    @model_validator(mode="after")
    def _keeps_something(self) -> TruncatedNormal:
        if self.low is None and self.high is None:
            raise ValueError("a truncated normal needs `low` or `high`")
        low, high = self.support
        _ascending(low, high)
        within = Normal(mean=self.mean, std=self.std).frozen
        if within.cdf(high) - within.cdf(low) < _LEAST_KEPT:
            raise ValueError(
                f"[{low:g}, {high:g}] contains almost nothing of a normal distribution with mean "
                f"{self.mean:g} and standard deviation {self.std:g}"
            )
        return self

    @property
    def frozen(self) -> rv_frozen:
        """SciPy's `truncnorm`."""
        from scipy.stats import truncnorm

        low, high = ((x - self.mean) / self.std for x in self.support)
        return truncnorm(low, high, self.mean, self.std)

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return the values x with P(X <= x) = u; rounding never leaves [low, high]."""
        return np.clip(super().quantile(u), *self.support)

    @property
    def support(self) -> tuple[float, float]:
        """[low, high]."""
        return (
            -math.inf if self.low is None else self.low,
            math.inf if self.high is None else self.high,
        )


class Uniform(Distribution):
    """Any value from low to high, all as likely."""

    low: Number = key("smallest value", 0.9, "of the parameter")
    high: Number = key("largest value", 1.1, "of the parameter")

    @model_validator(mode="after")
    def _in_order(self) -> Uniform:
        _ascending(self.low, self.high)
        return self

    @property
    def frozen(self) -> rv_frozen:
        """SciPy's `uniform`."""
        from scipy.stats import uniform

        return uniform(self.low, self.high - self.low)


class LogNormal(Distribution):
    """exp(normal): half of the values below `median`; `sigma` is the deviation of the logarithm.

    68 % of the values lie within a factor of exp(sigma) of the median: 0.7 is a factor of two.
    """

    median: Positive = key("half of the values are below it", 1.0, "of the parameter")
    sigma: Positive = key("standard deviation of the logarithm", 0.34, "1")

    @property
    def frozen(self) -> rv_frozen:
        """SciPy's `lognorm`."""
        from scipy.stats import lognorm

        return lognorm(self.sigma, scale=self.median)

    @property
    def support(self) -> tuple[float, float]:
        """(0, infinity), without 0 itself."""
        return math.nextafter(0.0, 1.0), math.inf


class _Counted(Distribution):
    """One of some values, all equally likely."""

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return the value whose equal share of [0, 1) contains u, in the order given."""
        values = np.array(self.levels)
        return values[np.minimum((u * len(values)).astype(np.int64), len(values) - 1)]

    @property
    def support(self) -> tuple[float, float]:
        values = self.levels or ()
        return min(values), max(values)

    def probability_below(self, x: float) -> float:
        return float(np.mean(np.array(self.levels) < x))


class OneOf(_Counted):
    """One of a list of values, all as likely."""

    values: tuple[Number, ...] = key(
        "the values, all different", [0.0, 1.0, 2.0], "of the parameter", min_length=1
    )

    @model_validator(mode="after")
    def _all_different(self) -> OneOf:
        if len(set(self.values)) < len(self.values):
            raise ValueError("`values` contains a value twice")
        return self

    @property
    def levels(self) -> tuple[float, ...] | None:
        """The values."""
        return self.values


class TableColumn(_Counted):
    """A column of a table, all rows equally likely; one u gives one row in all columns."""

    values: Annotated[tuple[Number, ...], Field(min_length=1)]

    @property
    def levels(self) -> tuple[float, ...] | None:
        """The rows' values."""
        return self.values


class Steps(_Counted):
    """`count` values from low to high at equal distances, for grids."""

    low: Number = key("first value", 0.5, "of the parameter")
    high: Number = key("last value", 1.5, "of the parameter")

    count: int = key("number of values, both ends included", 11, "1", ge=2, le=100_000, strict=True)

    @model_validator(mode="after")
    def _in_order(self) -> Steps:
        _ascending(self.low, self.high)
        return self

    @property
    def levels(self) -> tuple[float, ...] | None:
        """All steps."""
        return tuple(np.linspace(self.low, self.high, self.count).tolist())


def _ascending(low: float, high: float) -> None:
    if not low < high:
        raise ValueError(f"low {low:g} is not below high {high:g}")
