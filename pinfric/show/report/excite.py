"""An excitation, as a table."""

from __future__ import annotations

from pathlib import Path

from pinfric.identification.excite import Excitation
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Report, paragraphs
from pinfric.show.report.values import digits


def excite_report(excitation: Excitation, written: bool = False) -> Report:
    """Return what `pinfric excite` prints; `written`: to a folder."""
    summary = excitation.summary
    slowed = summary.slowed > 1.0
    lines = [
        f"samples: to {digits(summary.staircases_from)} s all joints together, in periods of "
        f"{digits(summary.period)} s; then each alone, at three speeds",
        f"way-points: the same from point to point, {digits(summary.moves_duration)} s",
        *[f"{summary.slowed:.2f} times as slow for the limits of efforts"] * slowed,
        "not checked: collisions, and cables; try it slowly first. Narrow the ranges with --range",
        *["excitation.csv, excitation.waypoints.yaml: --out FOLDER"] * (not written),
    ]
    title = f"{Path(excitation.scene.source).stem} · excitation"
    return paragraphs([verdict(excitation)], table_of(title, summary.joints), lines)


def verdict(excitation: Excitation) -> str:
    """Return the length of an excitation in a line."""
    s = excitation.summary
    return f"excitation of {digits(s.duration)} s at {s.rate:g} Hz, at rest at both ends"
