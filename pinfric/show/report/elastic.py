"""What elastic gears do: tables for people (mm, arcmin), a dictionary for machines."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinfric.show.report.names import affixes, without
from pinfric.show.report.tables import Column, Kind, Table
from pinfric.show.report.values import digits, json_safe, span
from pinfric.study.elastic.motion import Elasticity, Rest, ToolPlace

#: Minutes of arc of a radian, mm of a metre.
ARCMIN, MM = 60.0 * 180.0 / np.pi, 1e3
#: Below it a wind-up or a displacement is rounding (rad, m).
_ZERO = 1e-12
_THREE_WORDS = (
    "interval: where static friction can hold it; reversal error: between approaches from "
    "opposite sides; a maker's repeatability is of approaches from one side, a third figure"
)


def elasticity_json(found: Elasticity) -> dict[str, Any]:
    """Return what `pinfric inverse --json` prints under `elasticity`; SI units, Hz."""
    low, high = found.bracket
    return json_safe(
        {
            "drives": list(found.drives),
            "lowest_frequency": {
                "least": found.frequency[found.slowest],
                "greatest": np.fmax.reduce(found.frequency),
                "time": _times(found)[found.slowest],
                "bracket": [low, high],
                "strain_energy": dict(zip(found.drives, found.mode.shares, strict=True)),
                "motors_free": found.free,
            },
            "tool": found.result.scene.tool,
            "rests": [_rest_json(found, rest) for rest in found.rests],
            "notes": list(found.notes),
        }
    )


def _rest_json(found: Elasticity, rest: Rest) -> dict[str, Any]:
    names, tool = found.result.actuator_names, rest.tool
    wind_up = {
        name: {
            "sag": rest.wind_up_sag[d],
            "lower": rest.wind_up_lower[d],
            "upper": rest.wind_up_upper[d],
            "approach": None if rest.wind_up_approach is None else rest.wind_up_approach[d],
        }
        for d, name in enumerate(names)
        if name in found.drives
    }
    placed = (
        None
        if tool is None
        else {
            "sag": tool.sag,
            "interval_middle": tool.middle,
            "interval_extents": tool.extents,
            "interval_farthest": tool.farthest,
            "interval_farthest_angle": tool.farthest_angle,
            "approach": tool.approach,
            "reversal_error": tool.reversal,
        }
    )
    return {
        "start": rest.start,
        "end": rest.end,
        "payloads": list(rest.payloads),
        "lowest_frequency": list(rest.frequency),
        "wind_up": wind_up,
        "tool": placed,
    }


def elasticity_parts(found: Elasticity) -> list[Table | list[str]]:
    """Return the tables and lines that `pinfric inverse` prints of elastic gears."""
    parts: list[Table | list[str]] = []
    if any(rest.tool is not None for rest in found.rests):
        parts.append(_tool_table(found))
    worst = found.worst or (found.rests[-1] if found.rests else None)
    if worst is not None:
        parts.append(_wind_up_table(found, worst))
    words = [_THREE_WORDS] if any(rest.tool is not None for rest in found.rests) else []
    return [*parts, [*frequency_lines(found), *words, *found.notes]]


def _tool_table(found: Elasticity) -> Table:
    columns = (
        Column("rest\ns", Kind.LABEL),
        Column("carries", Kind.WORDS),
        Column("sag\nmm"),
        Column("interval\n± mm"),
        Column("interval\n± arcmin"),
        Column("by approach\nmm"),
        Column("reversal\nerror, mm"),
        Column("lowest\nHz"),
    )
    rows = [
        (
            _time(rest),
            ", ".join(rest.payloads) or "nothing",
            digits(MM * rest.tool.sag_distance),
            digits(MM * rest.tool.farthest, _ZERO),
            digits(ARCMIN * rest.tool.farthest_angle, _ZERO),
            _beside(rest.tool),
            _reversal(rest.tool),
            span(*rest.frequency),
        )
        for rest in found.rests
        if rest.tool is not None
    ]
    title = f"elastic gears: where {found.result.scene.tool} stands beside its commanded place"
    return Table(title, columns, rows)


def _beside(tool: ToolPlace) -> str:
    """How far the place by approach is from the middle of the interval."""
    if tool.approach is None:
        return ""
    return digits(MM * float(np.linalg.norm((tool.approach - tool.middle)[:3])), _ZERO)


def _reversal(tool: ToolPlace) -> str:
    return "" if tool.reversal is None else digits(MM * tool.reversal, _ZERO)


def _time(rest: Rest) -> str:
    return f"{rest.start:.2f}–{rest.end:.2f}"  # noqa: RUF001 - a range


def _wind_up_table(found: Elasticity, rest: Rest) -> Table:
    names = list(found.result.actuator_names)
    rows = []
    for name in found.drives:
        d = names.index(name)
        angles = [rest.wind_up_sag[d], rest.wind_up_lower[d], rest.wind_up_upper[d]]
        sag, low, high = (_angle(ARCMIN * x) for x in angles)
        approach = rest.wind_up_approach
        part = (
            ""
            if rest.tool is None
            else digits(MM * float(np.linalg.norm(rest.tool.generators[:3, d])), _ZERO)
        )
        rows.append(
            (
                name,
                sag,
                f"{low} to {high}",
                "" if approach is None else _angle(ARCMIN * approach[d]),
                part,
            )
        )
    columns = (
        Column("joint", Kind.NAME),
        Column("sag\narcmin"),
        Column("interval\narcmin"),
        Column("by approach\narcmin"),
        Column("part of the\ninterval, mm"),
    )
    return Table(
        f"wind-up of the gears, motor before joint, at rest {_time(rest)} s", columns, rows
    )


def _angle(arcmin: float) -> str:
    return f"{arcmin:.2f}" if abs(arcmin) >= 0.005 else "0"


def frequency_lines(found: Elasticity) -> list[str]:
    """Return "lowest frequency 8.17 Hz at 7.00 s, ...", a line for each kind of figure."""
    first = found.frequency[found.slowest]
    front, back = affixes(found.result.actuator_names)
    names, shares = without(list(found.drives), front, back), found.mode.shares
    order = [d for d in np.argsort(-shares) if shares[d] >= 0.05][:3]
    energy = ", ".join(f"{names[d]} {100 * shares[d]:.0f} %" for d in order)
    time = _times(found)[found.slowest]
    lines = [
        f"lowest frequency, motors held: {digits(first)} Hz at {time:.2f} s, strain energy in"
        f" {energy}; over the motion {span(first, np.fmax.reduce(found.frequency))} Hz",
    ]
    low, high = found.bracket
    if np.isfinite(high) and len(found.drives) > 1:
        lines.append(
            f"bounds there: {digits(low)} Hz of all joints by themselves (Dunkerley), "
            f"{digits(high)} Hz of the softest with all others rigid"
        )
    if found.free is not None:
        listed = ", ".join(digits(f) for f in found.free if np.isfinite(f))
        lines.append(f"frequencies there, motors free: {listed} Hz")
    return lines


def _times(found: Elasticity) -> np.ndarray:
    assert found.result.t is not None  # elasticity refuses a result without
    return found.result.t
