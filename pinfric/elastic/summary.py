"""Summary of elastic gears, as `pinfric inverse` prints and writes it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinfric.elastic.motion import Elasticity, RestPeriod, ToolPlace
from pinfric.model.described import PLACE, between, derived, described, gathered, quantity


@described
class WindUp:
    """Wind-up of a gear at rest, motor ahead of joint."""

    name: str = quantity("the drive", heading="joint", name=True)
    sag: float = quantity("without friction", PLACE, "sag", "{sag:arcmin}")
    lower: float = quantity("smallest wind-up that friction can hold", PLACE)
    upper: float = quantity(
        "largest wind-up that friction can hold",
        PLACE,
        "interval",
        "{lower:arcmin} to {upper:arcmin}",
    )
    approach: float | None = quantity(
        "wind-up after the motion's approach", PLACE, "by approach", "{approach:arcmin}"
    )
    tool: float | None = quantity(
        "its part of the interval of the tool's position", "m", "part of the\ninterval", "{tool:mm}"
    )


@described
class ToolSummary:
    """Position of the tool at rest relative to the commanded one, in world axes."""

    sag: np.ndarray = quantity("(6,) displacement without friction", "m, rad")
    interval_middle: np.ndarray = quantity("(6,) middle of the interval", "m, rad")
    interval_extents: np.ndarray = quantity("(6,) half its width along the axes", "m, rad")
    sag_distance: float = quantity("|sag|", "m", "sag", "{sag_distance:mm}")
    interval_farthest: float = quantity(
        "largest distance from the interval's middle at which friction can hold the tool",
        "m",
        "interval ±",
        "{interval_farthest:mm}",
    )
    interval_farthest_angle: float = quantity(
        "the same for its orientation", "rad", "interval ±", "{interval_farthest_angle:arcmin}"
    )
    approach: np.ndarray | None = quantity(
        "(6,) displacement after the motion's approach", "m, rad"
    )
    approach_distance: float | None = quantity(
        "distance from the middle to the tool's position after the motion's approach",
        "m",
        "by approach",
        "{approach_distance:mm}",
    )
    reversal_error: float | None = quantity(
        "distance between the tool's positions after opposite approaches",
        "m",
        "reversal\nerror",
        "{reversal_error:mm}",
    )


@described
class RestSummary:
    """A time in which all joints stand still under one load."""

    start: float = quantity("its first time", "s", "rest", between("start", "end", ".2f"))
    end: float = quantity("its last time", "s")
    payloads: tuple[str, ...] = quantity("payloads that are carried", heading="carries")
    wind_up: Mapping[str, WindUp] = quantity("of each elastic drive")
    tool: ToolSummary | None = quantity("the tool's position; none: see the notes", heading="*")
    lowest_frequency: tuple[float, float] = quantity(
        "lowest natural frequency, motors held, at the least and the greatest holding torque",
        "Hz",
        "lowest",
    )


@described
class LowestFrequency:
    """Natural frequency with motors held, along a motion."""

    least: float = quantity("smallest value over the motion", "Hz")
    greatest: float = quantity("largest value over the motion", "Hz")
    time: float = quantity("when it is smallest", "s")
    bracket: tuple[float, float] = quantity("Dunkerley's and Rayleigh's bounds at that time", "Hz")
    strain_energy: Mapping[str, float] = quantity("share of each gear at that time")
    motors_free: np.ndarray | None = quantity("frequencies at that time with free motors", "Hz")


@described
class ElasticSummary:
    """Effects of elastic gears along a motion."""

    drives: tuple[str, ...] = quantity("drives with an elastic gear")
    lowest_frequency: LowestFrequency = quantity("motors held")
    tool: str | None = quantity("the link whose position is given")
    rests: tuple[RestSummary, ...] = quantity("in the order of time")
    notes: tuple[str, ...] = quantity("results that are missing, and why")

    @property
    @derived()
    def worst(self) -> int | None:
        """Number of the rest with the widest interval at the tool."""
        known = [(r.tool.interval_farthest, -n) for n, r in enumerate(self.rests) if r.tool]
        return -max(known)[1] if known else None


def elastic_summary(effects: Elasticity) -> ElasticSummary:
    """Return the summary of elastic gears."""
    t = effects.result.times
    frequency = LowestFrequency(
        least=float(effects.frequency[effects.slowest]),
        greatest=float(np.fmax.reduce(effects.frequency)),
        time=float(t[effects.slowest]),
        bracket=effects.bracket,
        strain_energy=dict(zip(effects.drives, effects.mode.shares.tolist(), strict=True)),
        motors_free=effects.free,
    )
    rests = tuple(_rest(effects, rest) for rest in effects.rests)
    return ElasticSummary(
        effects.drives, frequency, effects.result.scene.tool, rests, effects.notes
    )


def _rest(effects: Elasticity, rest: RestPeriod) -> RestSummary:
    names, approach, tool = effects.result.actuator_names, rest.wind_up_approach, rest.tool
    wind_up = {
        name: WindUp(
            name,
            float(rest.wind_up_sag[d]),
            float(rest.wind_up_lower[d]),
            float(rest.wind_up_upper[d]),
            None if approach is None else float(approach[d]),
            None if tool is None else float(np.linalg.norm(tool.generators[:3, d])),
        )
        for d, name in enumerate(names)
        if name in effects.drives
    }
    placed = None if tool is None else _tool(tool)
    return RestSummary(rest.start, rest.end, rest.payloads, wind_up, placed, rest.frequency)


def _tool(tool: ToolPlace) -> ToolSummary:
    way = tool.approach
    return gathered(
        ToolSummary,
        tool,
        interval_middle=tool.middle,
        interval_extents=tool.extents,
        interval_farthest=tool.farthest,
        interval_farthest_angle=tool.farthest_angle,
        approach_distance=None if way is None else float(np.linalg.norm((way - tool.middle)[:3])),
        reversal_error=tool.reversal,
    )
