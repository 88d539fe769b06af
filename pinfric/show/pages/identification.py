"""The identification page."""

from __future__ import annotations

from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.identification.identify import Identified, beside_measured, left_over, running_mean
from pinfric.identification.parameters import Parameter
from pinfric.identification.summary import (
    Considered,
    MoreKnown,
    considered,
    identify_summary,
    log_noise,
    more_known,
    predicted,
)
from pinfric.model.described import SPEED, unit_at
from pinfric.show.figure.measured import draw_measured
from pinfric.show.figure.panel import panel, svg
from pinfric.show.figure.style import BLUE, RED
from pinfric.show.pages.page import page
from pinfric.show.report.html import Marked, mark
from pinfric.show.report.identify import verdict
from pinfric.show.report.rows import table_of
from pinfric.show.report.values import digits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Coefficients whose standard errors are listed for each advised recording.
_WORST = 12
_SHOWN = ("section", "joint", "name", "unit", "value", "low", "high", "determined")
#: Pieces a log is cut into, each kept with its extremes; dots of a cloud (pages below 1.5 MB).
_PIECES, _DOTS = 500, 400


def identification_page(identified: Identified) -> str:
    """Return the friction identified from logs as one HTML page.

    Raises:
        PinfricError: see `page`.
    """
    summary = identify_summary(identified)
    time = _over_time(identified)
    joints: list[dict[str, Any]] = []
    for j, name in enumerate(identified.scene.joint_names):
        if name not in identified.errors:
            continue
        pictures = {"time": svg(time[j], f"Efforts of {name} over time")} | {
            kind: svg(cloud, f"Residual of {name} over {kind}")
            for kind, cloud in _residual_clouds(identified, j).items()
        }
        law, laws = identified.law_of(name), considered(identified, j)
        shown = table_of("", laws, cells={"law": partial(_law, law)})
        about = {"name": name, "law": law, "laws": shown, "considered": len(laws)}
        joints.append(about | pictures)
    more = {f"factors[{entry.name}]": partial(_told, entry.name) for entry in identified.advice}
    return page(
        "identification",
        identified.scene.joint_names,
        [joint["name"] for joint in joints],
        views=joints,
        identified=identified,
        verdict=verdict(summary),
        doubts=summary.doubts,
        notes=summary.notes[len(summary.doubts) :],
        laws=table_of("", summary.joints),
        coefficients=table_of("", summary.parameters, only=_SHOWN, cells={"determined": _said}),
        unseen=table_of("", predicted(summary)),
        delay=identified.estimate.delay,
        scene=Path(identified.scene.source).stem,
        logs=summary.logs,
        read=table_of("", summary.logs),
        noise=table_of("", log_noise(identified), keys=2),
        duration=sum(entry.duration for entry in summary.logs),
        determined=sum(p.determined for p in identified.parameters),
        more=table_of("", more_known(identified, _WORST), cells=more),
    )


def _said(p: Parameter) -> Marked:
    known = mark("ok", "determined") if p.determined else mark("bad", "not determined")
    return Marked(f"{known} {escape(p.why)}")


def _told(recording: str, row: MoreKnown) -> Marked:
    """How much a further recording improves a coefficient, coloured by it."""
    factor = row.factors[recording]
    kind = "ok" if factor <= 0.6 else "tight" if factor <= 0.8 else "none"
    return mark(kind, digits(factor))


def _law(taken: str, row: Considered) -> Marked:
    return Marked(f"<b>{escape(row.law)}</b>" if row.law == taken else escape(row.law))


def _over_time(identified: Identified) -> list[Figure]:
    """Draw each joint's measured effort over the identified scene's, rest intervals as bands.

    Logs follow one another; measured efforts are moved back by the delay.
    """
    names = identified.scene.joint_names
    units = [identified.scene.drives[j].unit for j in range(len(names))]
    figures = [panel("time, s", f"effort, {unit}", 10.0, 2.9) for unit in units]
    start = 0.0
    for number in range(len(identified.recordings)):
        result, log = beside_measured(identified, number)
        for name, (_, axes) in zip(names, figures, strict=True):
            shift = start - float(result.times[0])
            draw_measured(axes, result, log, name, shift, identified.delay, _PIECES)
        start += float(np.ptp(result.times)) + 1.0
    for _, axes in figures:  # of the first log
        for line, label in zip(axes.lines, ("measured", "identified scene"), strict=False):
            line.set_label(label)
    return [figure for figure, _ in figures]


def _residual_clouds(identified: Identified, joint: int) -> dict[str, Figure]:
    """Draw one joint's residual over velocity and over load, where a missing law shows."""
    unit = identified.scene.drives[joint].unit
    velocity, load, off = left_over(identified, joint)
    few = np.unique(np.linspace(0, off.size - 1, min(_DOTS, off.size)).astype(int))
    result = {}
    for name, x, title in (
        ("velocity", velocity, f"velocity, {unit_at(SPEED, unit)}"),
        ("load", load, f"effort without friction, {unit}"),
    ):
        result[name], axes = panel(title, f"measured - fitted, {unit}")
        axes.plot(x[few], off[few], ".", color=BLUE, alpha=0.5, markersize=3, markeredgewidth=0)
        axes.plot(*running_mean(x, off), color=RED, linewidth=1.8, label="mean")
    return result
