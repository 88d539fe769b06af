"""The identification page's figures, as plotly's dictionaries: measured beside predicted."""

from __future__ import annotations

from typing import Any

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import runs
from pinfric.show.figure.efforts import thinned
from pinfric.show.sizing_page.figures import axes_layout, curve, five_digits
from pinfric.study.identify.identify import Identified
from pinfric.study.identify.normal import residuals
from pinfric.study.summary import effort_unit, rests
from pinfric.study.trajectory.log.judged import measured_interval

Figure = dict[str, Any]

# Okabe and Ito's palette, as in `sizing_page.figures`.
_BLUE, _BAND, _ORANGE, _RED = "#0072B2", "#A9CFE8", "#E69F00", "#D55E00"
_SHADE = "rgba(230,159,0,0.16)"
#: Pieces a log is cut into, each kept with its extremes; dots of a cloud.
_PIECES, _DOTS = 500, 1500


def over_time(found: Identified) -> list[Figure]:
    """Draw each joint's measured effort over the identified scene's, rest intervals as bands.

    Logs stand one after another; efforts are those measured, moved back by the delay.
    """
    units = [effort_unit(found.scene, j) for j in range(found.scene.model.nv)]
    figures: list[Figure] = [
        {"data": [], "layout": axes_layout("time, s", f"effort, {unit}")} for unit in units
    ]
    start = 0.0
    for number, recording in enumerate(found.recordings):
        motion, first = recording.trajectory, number == 0
        result = inverse_dynamics(found.scene, motion)
        lower, upper = measured_interval(result, found.estimate.question.at)
        time = motion.t - motion.t[0] + start
        for j, figure in enumerate(figures):
            measured = np.interp(motion.t + found.delay, motion.t, recording.effort[:, j])
            known = np.isfinite(measured)
            keep = thinned([lower[:, j], upper[:, j], np.where(known, measured, 0.0)], _PIECES)
            t = five_digits(time[keep])
            shown = [
                x if is_known else None
                for x, is_known in zip(five_digits(measured[keep]), known[keep], strict=True)
            ]
            figure["data"] += [
                curve(t, five_digits(lower[keep, j]), "", _BLUE, 1.0, showlegend=False),
                curve(
                    t,
                    five_digits(upper[keep, j]),
                    "identified scene",
                    _BLUE,
                    1.0,
                    fill="tonexty",
                    fillcolor=_BAND,
                    showlegend=first,
                ),
                curve(t, shown, "measured", _ORANGE, 1.2, showlegend=first),
            ]
            figure["layout"].setdefault("shapes", []).extend(
                {
                    "type": "rect",
                    "xref": "x",
                    "yref": "paper",
                    "x0": float(time[a]),
                    "x1": float(time[b]),
                    "y0": 0,
                    "y1": 1,
                    "fillcolor": _SHADE,
                    "line": {"width": 0},
                    "layer": "below",
                }
                for a, b in runs(rests(result, j))
                if b > a
            )
        start = float(time[-1]) + 1.0
    return figures


def residual_clouds(found: Identified, joint: int) -> dict[str, Figure]:
    """Draw what one joint's fit leaves over velocity and over load: a law that lacks shows there.

    Args:
        found: what was identified.
        joint: its number.
    """
    rows = found.estimate.rows[joint]
    off = residuals(rows, found.estimate.fit, joint)
    unit = effort_unit(found.scene, joint)
    keep = np.unique(np.linspace(0, off.size - 1, min(_DOTS, off.size)).astype(int))
    result = {}
    speed = "m/s" if unit == "N" else "rad/s"
    for name, x, title in (
        ("velocity", rows.velocity, f"velocity, {speed}"),
        ("load", rows.load, f"effort without friction, {unit}"),
    ):
        data = [
            {
                "type": "scatter",
                "mode": "markers",
                "x": five_digits(x[keep]),
                "y": five_digits(off[keep]),
                "marker": {"color": _BLUE, "size": 3, "opacity": 0.5},
                "showlegend": False,
                "name": "residual",
            }
        ]
        middle, means = _running_mean(x, off)
        data.append(curve(middle, means, "mean", _RED, 2.0))
        result[name] = {"data": data, "layout": axes_layout(title, f"measured - fitted, {unit}")}
    return result


def _running_mean(x: np.ndarray, y: np.ndarray) -> tuple[list[float], list[float]]:
    """Means of y over twelfths of x."""
    parts = np.array_split(np.argsort(x), 12)
    return (
        [float(f"{x[part].mean():.4g}") for part in parts if part.size],
        [float(f"{y[part].mean():.4g}") for part in parts if part.size],
    )
