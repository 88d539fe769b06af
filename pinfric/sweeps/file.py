"""The sweep's file format: parameters with distributions, and motors to check."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from pinfric.drives.policy import GivenConditions
from pinfric.errors import SweepError
from pinfric.model.entry import Entry, Number, Version, key, optional, parse
from pinfric.model.scene_file import find_file
from pinfric.model.yamlfile import read_yaml
from pinfric.sweeps.distributions import (
    Distribution,
    LogNormal,
    Normal,
    OneOf,
    Steps,
    TruncatedNormal,
    Uniform,
)

#: More cycles than this would take weeks: a slip of the pen, most likely in a grid.
MOST_SAMPLES = 10_000_000
_KINDS = ("normal", "truncated_normal", "uniform", "lognormal", "choice", "steps")


class SweptParameter(Entry):
    """Distribution of one parameter."""

    normal: Normal | None = optional(
        "with a mean and a standard deviation", {"mean": 0.0, "std": 0.0175}
    )
    truncated_normal: TruncatedNormal | None = optional(
        "normal, truncated to a range", {"mean": 2.0, "std": 0.2, "low": 1.0}
    )
    uniform: Uniform | None = optional("between two values", {"low": 0.9, "high": 1.1})
    lognormal: LogNormal | None = optional("of a factor", {"median": 1.0, "sigma": 0.34})
    choice: OneOf | None = optional("one of a list", {"values": [0.0, 1.0, 2.0]})
    steps: Steps | None = optional(
        "at equal distances, for grids", {"low": 0.5, "high": 1.5, "count": 11}
    )
    each: bool = key(
        "one value for each joint that `*` matches, or one for all", True, default=False
    )

    @model_validator(mode="after")
    def _one_distribution(self) -> SweptParameter:
        kinds = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(kinds) != 1:
            raise ValueError(f"give one of {', '.join(_KINDS)}; found {', '.join(kinds) or 'none'}")
        return self

    @property
    def kind(self) -> str:
        """The distribution's name."""
        return next(kind for kind in _KINDS if getattr(self, kind) is not None)

    @property
    def distribution(self) -> Distribution:
        """The distribution that is given."""
        distribution: Distribution = getattr(self, self.kind)
        return distribution


class MotorOnTrial(Entry):
    """A drive of the catalogue, motor and gear, that every sample is held against.

    By the name that `pinfric size` prints, checked by all its criteria; its transmission replaces
    the scene's, and its mass is added to the links unless `robot.masses` says that they hold it.
    """

    drive: str = key("motor and gear of the catalogue, by name", "CubeMars AK80-64")


class SweepFile(Entry):
    """A whole sweep file.

    `sampling`: random; sobol (Saltelli's design: samples is a power of two N, N (d + 2) cycles are
    computed for d parameters, and the shares of the variance come out); grid (every combination
    of choice and steps). `table`: a CSV file with a column per parameter; every sample draws a
    whole row, so that correlated values stay together.
    """

    pinfric_sweep: Version = key("version of the format", 1)
    parameters: dict[str, SweptParameter] = key(
        "parameter -> its distribution",
        {"friction.*.mu": {"lognormal": {"median": 1.0, "sigma": 0.34}}},
        default_factory=dict,
    )
    table: str | None = optional("CSV file of samples, beside this file", "posterior.csv")
    samples: Annotated[int, Field(ge=1, le=MOST_SAMPLES, strict=True)] | None = optional(
        "number of cycles", 1000
    )
    sampling: Literal["random", "sobol", "grid"] = key(
        "random, Saltelli's design, or all combinations", "random", default="random"
    )
    seed: int = key("seed of the random numbers", 1, ge=0, strict=True, default=0)
    percentiles: tuple[Number, ...] = key(
        "percentiles to show", [5, 50, 95, 99], "%", min_length=1, default=(5.0, 50.0, 95.0, 99.0)
    )
    catalog: str = key("file, or `default` for the bundled one", "default", default="default")
    conditions: GivenConditions = key(
        "values that replace those of the catalogue", {"peak_factor": 1.3}, default_factory=dict
    )
    motors: dict[str, MotorOnTrial] = key(
        "motors to check, by drive",
        {"panda_joint2": {"drive": "CubeMars AK80-64"}},
        default_factory=dict,
    )

    @model_validator(mode="after")
    def _design_can_be(self) -> SweepFile:
        for p in self.percentiles:
            if not 0 <= p <= 100:
                raise ValueError(f"percentiles: {p:g} is not between 0 and 100")
        if not self.parameters and self.table is None:
            raise ValueError("`parameters` or `table` is missing: give at least one")
        if self.table is not None and self.sampling != "random":
            raise ValueError(
                f"`table`: its rows are drawn at random; leave out `sampling: {self.sampling}`"
            )
        if self.sampling == "grid":
            if self.samples is not None:
                raise ValueError("`samples`: the values of a grid set their number; leave it out")
            for name, parameter in self.parameters.items():
                if parameter.distribution.levels is None:
                    raise ValueError(
                        f"parameters.{name}: a grid takes `steps` or `choice`, not {parameter.kind}"
                    )
        elif self.samples is None:
            raise ValueError(
                f"`samples` is missing: number of samples of the {self.sampling} design"
            )
        elif self.sampling == "sobol" and (self.samples == 1 or self.samples.bit_count() > 1):
            near = max(2, 2 ** round(math.log2(self.samples)))
            raise ValueError(
                f"samples: {self.samples} is not a power of two from 2 on, which Sobol's sequence "
                f"needs; take {near}"
            )
        return self


def load_sweep(sweep: SweepFile | Mapping[str, Any] | str | Path) -> tuple[SweepFile, str]:
    """Return a sweep and its source, from a file, a bundled file's name, or a mapping.

    Raises:
        SweepError: all that is wrong with it, in one message.
    """
    if isinstance(sweep, SweepFile):
        return sweep, "sweep"
    if isinstance(sweep, Mapping):
        return parse(SweepFile, dict(sweep), "sweep", SweepError), "sweep"
    path = find_file(sweep, (".sweep.yaml",), SweepError)
    content = read_yaml(path, SweepError, "pinfric_sweep")
    entries = parse(SweepFile, content, str(path), SweepError)
    if entries.table is not None:
        entries = entries.model_copy(update={"table": str(path.parent / entries.table)})
    return entries, str(path)
