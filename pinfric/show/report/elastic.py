"""Effects of elastic gears as tables in mm and arcmin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinfric.elastic.summary import ElasticSummary
from pinfric.show.report.names import short_names
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Table
from pinfric.show.report.values import digits, span

#: Below it a wind-up or a displacement is rounding (rad, m).
_ZERO = 1e-12
#: Below it a wind-up prints as 0: 0.005 arcmin (rad).
_ANGLE = 1.5e-6


def elasticity_parts(
    summary: ElasticSummary, names: Sequence[str]
) -> list[Table | list[str] | None]:
    """Return the tables and lines that `pinfric inverse` prints of elastic gears.

    Args:
        names: of all drives, by which names are shortened.
    """
    parts: list[Table | list[str] | None] = []
    placed = [rest for rest in summary.rests if rest.tool is not None]
    if placed:
        title = f"elastic gears: position of {summary.tool} at rest, relative to the commanded one"
        carried = {"payloads": lambda rest: ", ".join(rest.payloads) or "nothing"}
        parts.append(table_of(title, placed, zero=_ZERO, cells=carried))
    if summary.rests:
        rest = summary.rests[-1 if summary.worst is None else summary.worst]
        title = "wind-up of the gears, motor ahead of joint, at rest "
        title += f"{rest.start:.2f}\N{EN DASH}{rest.end:.2f} s"
        parts.append(table_of(title, list(rest.wind_up.values()), zero=_ANGLE))
    return [*parts, [*frequency_lines(summary, names), *summary.notes]]


_NO_MASS = "no natural frequency: nothing that the elastic gears carry has a mass"


def elastic_line(summary: ElasticSummary) -> str:
    """Return in a line the tool's error at rest, and the lowest frequency."""
    lowest, places = summary.lowest_frequency, [rest.tool for rest in summary.rests if rest.tool]
    said = f"lowest frequency, motors held: {digits(lowest.least)} Hz at {lowest.time:.2f} s"
    if not np.isfinite(lowest.least):
        said = _NO_MASS
    if not places:
        return f"elastic gears: {said}"
    sag = digits(1e3 * max(place.sag_distance for place in places))
    open_ = digits(1e3 * max(place.interval_farthest for place in places))
    return (
        f"elastic gears: {summary.tool} is up to {sag} mm off at rest, and friction "
        f"leaves ±{open_} mm open; {said}"
    )


def frequency_lines(summary: ElasticSummary, names: Sequence[str]) -> list[str]:
    """Return "lowest frequency 8.17 Hz at 7.00 s, ...", a line for each kind of figure."""
    lowest = summary.lowest_frequency
    shares = sorted(lowest.strain_energy.items(), key=lambda entry: -entry[1])
    if not np.isfinite(lowest.least):
        return [_NO_MASS]
    short = short_names(names)
    energy = ", ".join(
        f"{short[n]} {100 * share:.0f} %" for n, share in shares[:3] if share >= 0.05
    )
    lines = [
        f"lowest frequency, motors held: {digits(lowest.least)} Hz at {lowest.time:.2f} s, strain "
        f"energy in {energy}; over the motion {span(lowest.least, lowest.greatest)} Hz",
    ]
    low, high = lowest.bracket
    if np.isfinite(high) and len(summary.drives) > 1:
        lines.append(
            f"bounds at that time: {digits(low)} Hz (Dunkerley) and {digits(high)} Hz (only the "
            "softest gear elastic)"
        )
    if lowest.motors_free is not None:
        listed = ", ".join(digits(f) for f in lowest.motors_free if np.isfinite(f))
        lines.append(f"frequencies at that time, motors free: {listed} Hz")
    return lines
