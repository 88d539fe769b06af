"""Distributions of a sweep's parameters: each turns numbers of [0, 1) into values.

Every design of samples (random, Sobol) is made in the unit cube; the quantile function maps it to
values, so that a seed gives the same values on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from pinfric.model.entry import Entry, Number, Positive, key

#: A truncation that keeps less than this of its normal distribution was not meant.
_LEAST_KEPT = 1e-6


class Distribution(Entry):
    """Base: values from numbers u of [0, 1), and the least and greatest value there can be."""

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return the values x with P(X <= x) = u, same shape as u."""
        raise NotImplementedError

    @property
    def support(self) -> tuple[float, float]:
        """The least and the greatest value; infinite where there is none."""
        raise NotImplementedError

    @property
    def levels(self) -> tuple[float, ...] | None:
        """The values where they can be counted, else None."""
        return None

    def probability_below(self, x: float) -> float:
        """Return P(X < x) roughly, for messages: by counting 10^4 quantiles."""
        u = (np.arange(10_000) + 0.5) / 10_000
        return float((self.quantile(u) < x).mean())


class Normal(Distribution):
    """Normal with a mean and a standard deviation; unbounded on both sides."""

    mean: Annotated[Number, key("of the values", 0.0, "of the parameter")]
    std: Annotated[Positive, key("standard deviation", 0.0175, "of the parameter")]

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return mean + std Phi^-1(u)."""
        from scipy.special import ndtri

        return self.mean + self.std * ndtri(_open(u))

    @property
    def support(self) -> tuple[float, float]:
        """Everything."""
        return -math.inf, math.inf


class TruncatedNormal(Distribution):
    """Normal with a mean and a standard deviation (before truncation), kept in [low, high]."""

    mean: Annotated[Number, key("before it is cut", 2.0, "of the parameter")]
    std: Annotated[Positive, key("standard deviation, before it is cut", 0.2, "of the parameter")]
    low: Annotated[
        Number | None, key("least value; `low` or `high` is needed", 1.0, "of the parameter")
    ] = None
    high: Annotated[Number | None, key("greatest value", 3.0, "of the parameter")] = None

    @model_validator(mode="after")
    def _keeps_something(self) -> TruncatedNormal:
        if self.low is None and self.high is None:
            raise ValueError("a truncated normal needs `low` or `high`")
        low, high = self.support
        _ascending(low, high)
        first, last = self._cumulative
        if last - first < _LEAST_KEPT:
            raise ValueError(
                f"[{low:g}, {high:g}] keeps next to nothing of a normal around {self.mean:g} with "
                f"standard deviation {self.std:g}"
            )
        return self

    @property
    def _cumulative(self) -> tuple[float, float]:
        from scipy.special import ndtr

        low, high = ((x - self.mean) / self.std for x in self.support)
        return float(ndtr(low)), float(ndtr(high))

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return mean + std Phi^-1(Phi(low) + u (Phi(high) - Phi(low)))."""
        from scipy.special import ndtri

        first, last = self._cumulative
        x = self.mean + self.std * ndtri(_open(first + _open(u) * (last - first)))
        return np.clip(x, *self.support)  # rounding must not leave the interval

    @property
    def support(self) -> tuple[float, float]:
        """[low, high]."""
        return (
            -math.inf if self.low is None else self.low,
            math.inf if self.high is None else self.high,
        )


class _Between(Distribution):
    """From `low` to `high`."""

    low: Number
    high: Number

    @model_validator(mode="after")
    def _in_order(self) -> _Between:
        _ascending(self.low, self.high)
        return self

    @property
    def support(self) -> tuple[float, float]:
        """[low, high]."""
        return self.low, self.high


class Uniform(_Between):
    """Any value from low to high, all as likely."""

    low: Annotated[Number, key("least value", 0.9, "of the parameter")]
    high: Annotated[Number, key("greatest value", 1.1, "of the parameter")]

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return low + u (high - low)."""
        return self.low + u * (self.high - self.low)


class LogNormal(Distribution):
    """exp(normal): half of the values below `median`; `sigma` is the deviation of the logarithm.

    68 % of the values lie within a factor of exp(sigma) of the median: 0.7 is a factor of two.
    """

    median: Annotated[Positive, key("half of the values are below it", 1.0, "of the parameter")]
    sigma: Annotated[Positive, key("standard deviation of the logarithm", 0.34, "1")]

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return median exp(sigma Phi^-1(u))."""
        from scipy.special import ndtri

        return self.median * np.exp(self.sigma * ndtri(_open(u)))

    @property
    def support(self) -> tuple[float, float]:
        """(0, infinity): the bound itself is never attained."""
        return math.nextafter(0.0, 1.0), math.inf


class _Listed(Distribution):
    """One of some values, all as likely."""

    values: Annotated[tuple[Number, ...], Field(min_length=1)]

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return the value whose share of [0, 1) holds u, the shares in the order given."""
        return _pick(self.values, u)

    @property
    def support(self) -> tuple[float, float]:
        """The least and the greatest value."""
        return min(self.values), max(self.values)


class Choice(_Listed):
    """One of a list of values, all as likely."""

    values: Annotated[
        tuple[Number, ...],
        Field(min_length=1),
        key("all different", [0.0, 1.0, 2.0], "of the parameter"),
    ]

    @model_validator(mode="after")
    def _all_different(self) -> Choice:
        if len(set(self.values)) < len(self.values):
            raise ValueError("`values` names one value twice")
        return self

    @property
    def levels(self) -> tuple[float, ...] | None:
        """The values."""
        return self.values


class Column(_Listed):
    """A column of a table, all rows as likely: one u gives one row in all columns."""


class Steps(_Between):
    """`count` values from low to high at equal distances, for grids."""

    low: Annotated[Number, key("first value", 0.5, "of the parameter")]
    high: Annotated[Number, key("last value", 1.5, "of the parameter")]

    count: Annotated[
        int, Field(ge=2, le=100_000, strict=True), key("of the values, both ends counted", 11, "1")
    ]

    def quantile(self, u: np.ndarray) -> np.ndarray:
        """Return the step whose share of [0, 1) holds u."""
        return _pick(self.levels or (), u)

    @property
    def levels(self) -> tuple[float, ...] | None:
        """All steps."""
        return tuple(np.linspace(self.low, self.high, self.count).tolist())


def _pick(values: Sequence[float], u: np.ndarray) -> np.ndarray:
    """Return the value whose equal share of [0, 1) holds u."""
    count = len(values)
    return np.array(values)[np.minimum((u * count).astype(np.int64), count - 1)]


def _ascending(low: float, high: float) -> None:
    if not low < high:
        raise ValueError(f"low {low:g} is not below high {high:g}")


def _open(u: np.ndarray | float) -> np.ndarray:
    """Keep u off 0 and 1, where a normal's quantile is infinite."""
    return np.clip(u, 2.0**-54, 1.0 - 2.0**-53)
