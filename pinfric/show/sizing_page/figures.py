"""The sizing page's figures, as plotly's dictionaries: data and layout, no plotly in sight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pinfric.dynamics.inverse.result import runs
from pinfric.show.figure.efforts import thinned
from pinfric.study.sizing.assess import Assessment
from pinfric.study.sizing.catalog import Conditions
from pinfric.study.sizing.drivetrain import Ratings
from pinfric.study.sizing.size import JointSizing, SizingReport
from pinfric.study.summary import ends_by_magnitude

Figure = dict[str, Any]

# Okabe and Ito's palette, as in `figure.efforts`.
_BLUE, _BAND, _ORANGE, _GREEN, _RED = "#0072B2", "#A9CFE8", "#E69F00", "#009E73", "#D55E00"
_INK, _QUIET, _GRID = "#222222", "#6B6B6B", "#E6E6E6"
_SHADE = "rgba(230,159,0,0.16)"
#: Pieces a long motion is cut into, each kept with its extremes.
_PIECES = 400
#: The envelope is cut where it would make the cycle smaller than this part of the picture.
_MOST_SHRUNK = 8.0
#: Margins below are drawn at the edge.
_LEAST_MARGIN = -100.0


def torque_speed(joint: JointSizing, report: SizingReport) -> Figure:
    """Draw the cycle in the motor's envelope: torque over speed, intervals at rest as bars."""
    motor, taken = joint.motor, joint.taken
    assert motor is not None and taken is not None  # noqa: PT018 - a joint with a drive
    ratings, voltage = taken.candidate.ratings, report.conditions.bus_voltage
    t = joint.cycle.t
    lower, upper, speed = motor.torque_lower, motor.torque_upper, motor.speed
    worst = ends_by_magnitude(lower, upper)[0]
    most = 1.05 * report.conditions.peak_factor * float(np.abs(worst).max())
    top = 1.15 * max(most, ratings.continuous_torque or 0.0)
    if ratings.peak_torque is not None:
        top = max(top, 1.1 * ratings.peak_torque)
    top = min(top, _MOST_SHRUNK * most) if most > 0 else top
    reach = _speed_reach(ratings, voltage, float(np.abs(speed).max()))
    data = _envelope(ratings, report.conditions, motor.figures.hot, reach, top)
    keep = thinned([lower, upper, speed], _PIECES)
    wide = keep[(upper - lower)[keep] > 1e-9 * max(most, 1e-12)]
    bars_x, bars_y = _bars(speed[wide], lower[wide], upper[wide])
    data += [
        {
            "type": "scatter",
            "mode": "lines+markers",
            "name": "cycle",
            "x": five_digits(speed[keep]),
            "y": five_digits(worst[keep]),
            "line": {"color": _BAND, "width": 1},
            "marker": {"color": _BLUE, "size": 3.5},
            "customdata": five_digits(t[keep]),
            "hovertemplate": "%{y:.3g} N m at %{x:.4g} rad/s, t = %{customdata:.3f} s"
            "<extra></extra>",
        },
        curve(bars_x, bars_y, "interval at rest", _ORANGE, width=4, hoverinfo="skip"),
    ]
    shaft = "output" if taken.candidate.at_output else "motor"
    effort, rate = taken.candidate.units
    kind = "force" if effort == "N" else "torque"
    layout = axes_layout(f"{shaft} speed, {rate}", f"{shaft} {kind}, {effort}")
    layout["xaxis"]["range"] = [-reach, reach]
    layout["yaxis"]["range"] = [-top, top]
    return {"data": data, "layout": layout}


def effort_over_time(joint: JointSizing) -> Figure:
    """Draw the effort interval over the cycle, and the effort without friction; holds shaded."""
    cycle = joint.cycle
    series = [cycle.effort_lower, cycle.effort_upper, cycle.effort_frictionless]
    keep = _drawn(joint, series)
    t = five_digits(cycle.t[keep])
    lower, upper, bare = (five_digits(x[keep]) for x in series)
    data = [
        curve(t, lower, "lower", _BLUE, showlegend=False),
        curve(t, upper, "effort interval", _BLUE, fill="tonexty", fillcolor=_BAND),
        curve(t, bare, "without friction", _QUIET, width=1, dash="dot"),
    ]
    layout = axes_layout("time, s", f"effort at the joint, {joint.demand.unit}")
    layout["shapes"] = [
        {
            "type": "rect",
            "xref": "x",
            "yref": "paper",
            "x0": float(cycle.t[a]),
            "x1": float(cycle.t[b]),
            "y0": 0,
            "y1": 1,
            "fillcolor": _SHADE,
            "line": {"width": 0},
            "layer": "below",
        }
        for a, b in runs(cycle.holding)
    ]
    return {"data": data, "layout": layout}


def temperature(joint: JointSizing, report: SizingReport) -> Figure | None:
    """Draw winding and housing over the settled cycle; None where they are not known."""
    motor, taken = joint.motor, joint.taken
    if motor is None or taken is None or motor.winding is None or motor.winding.runaway:
        return None
    winding, housing = motor.winding.winding, motor.winding.housing
    keep = _drawn(joint, [winding, housing])
    t = five_digits(joint.cycle.t[keep])
    data = [
        curve(t, five_digits(winding[keep]), "winding", _RED),
        curve(t, five_digits(housing[keep]), "housing", _ORANGE),
    ]
    thermal = taken.candidate.ratings.thermal
    limit = report.conditions.max_winding
    if thermal is not None and thermal.max_winding is not None:
        limit = thermal.max_winding
    ends = [t[0], t[-1]]
    if limit is not None:
        data.append(curve(ends, [limit] * 2, "limit", _INK, width=1, dash="dash"))
    data.append(curve(ends, [report.conditions.ambient] * 2, "ambient", _QUIET, 1, dash="dot"))
    layout = axes_layout("time, s", "temperature, °C")
    layout["yaxis"]["rangemode"] = "tozero"
    return {"data": data, "layout": layout}


def power_over_time(report: SizingReport) -> Figure:
    """Draw what all drives take from their bus together; below 0 it flows back."""
    power, t = report.bus.power, report.result.t
    assert t is not None  # size refuses a motion without times
    keep = thinned([power], _PIECES)
    keep = keep[report.duty.powered(len(t))[keep]]
    x, y = five_digits(t[keep]), five_digits(power[keep])
    mean = [report.bus.mean] * 2
    data = [
        curve(x, y, "power", _BLUE, fill="tozeroy", fillcolor=_BAND),
        curve([x[0], x[-1]], mean, "mean of the period", _INK, 1, dash="dash"),
    ]
    return {"data": data, "layout": axes_layout("time, s", "power of all drives, W")}


def _drawn(joint: JointSizing, series: Sequence[np.ndarray]) -> np.ndarray:
    """Which samples to draw over time: a period's time off would leave no room for the rest."""
    keep = thinned(list(series), _PIECES)
    return np.asarray(keep[joint.cycle.powered[keep]])


def mass_against_margin(joint: JointSizing) -> Figure:
    """Draw every judged candidate: mass and least margin, and the front of those that fit."""
    judged = [a for a in joint.assessments if not a.lacking]
    fitting = [a for a in judged if a.fits]
    failing = [a for a in judged if not a.fits]
    data = [_cloud(failing, "rejected", _RED, "circle-open"), _cloud(fitting, "fits", _GREEN)]
    front = pareto_front(fitting)
    data.insert(
        0,
        curve(
            [a.candidate.mass or 0.0 for a in front],
            [100 * a.margin for a in front],
            "best trade",
            _GREEN,
            1,
            shape="hv",
            hoverinfo="skip",
        ),
    )
    if joint.taken is not None:
        name = "choice" if joint.choice is not None else "nearest miss"
        data.append(_cloud([joint.taken], name, _BLUE, "star", size=14))
    layout = axes_layout("mass of motor and gear, kg", "least margin, %")
    layout["yaxis"]["range"] = [1.12 * _LEAST_MARGIN, 112]
    layout["xaxis"]["rangemode"] = "tozero"
    return {"data": data, "layout": layout}


def pareto_front(assessments: Sequence[Assessment]) -> list[Assessment]:
    """Return those than which no other is both lighter and of greater margin, by mass."""
    front: list[Assessment] = []
    for a in sorted(assessments, key=lambda a: (a.candidate.mass or 0.0, -a.margin)):
        if not front or a.margin > front[-1].margin:
            front.append(a)
    return front


def _speed_reach(ratings: Ratings, voltage: float, used: float) -> float:
    """How far the speed axis goes: the envelope's end, unless the cycle uses little of it."""
    ends = [1.25 * used]
    limit = ratings.speed_limit(voltage)[0]
    if limit is not None:
        ends.append(1.05 * limit)
    if ratings.no_load_speed is not None and ratings.nominal_voltage is not None:
        ends.append(1.05 * ratings.no_load_speed * voltage / ratings.nominal_voltage)
    elif ratings.torque_constant is not None:
        ends.append(1.05 * voltage / ratings.torque_constant)
    reach = max(ends) or 1.0
    return min(reach, _MOST_SHRUNK * used) if used > 0 else reach


def _envelope(
    ratings: Ratings, conditions: Conditions, hot: float, reach: float, top: float
) -> list[dict[str, Any]]:
    """What the motor can do: the line of the bus voltage cut by peak torque, and continuously."""
    data, voltage = [], conditions.bus_voltage
    name = "envelope" if ratings.has_line else "envelope (no line known)"
    continuous, _ = ratings.continuous_at(conditions)
    if ratings.continuous_curve is not None and continuous is not None:
        share = continuous / ratings.continuous_over(np.zeros(1))[0]  # of a warm place
        at = np.linspace(-reach, reach, 201)
        torque = share * ratings.continuous_over(at)
        both = [*five_digits(torque), None, *five_digits(-torque)]
        data.append(
            curve(
                [*five_digits(at), None, *five_digits(at)],
                both,
                "continuous torque",
                _INK,
                1,
                dash="dash",
                hoverinfo="skip",
            )
        )
        continuous = None
    fastest = ratings.speed_limit(voltage)[0]
    end = reach if fastest is None else min(fastest, reach)
    speed = np.linspace(-end, end, 201)
    limit = ratings.torque_limit(speed, voltage, hot)
    if np.isfinite(limit).all():
        x = np.concatenate([speed, speed[::-1], speed[:1]])
        y = np.concatenate([limit, -limit, limit[:1]])
        y = np.clip(y, -2 * top, 2 * top)
        data.append(
            curve(
                five_digits(x),
                five_digits(y),
                name,
                _GREEN,
                1,
                fill="toself",
                fillcolor="rgba(0,158,115,0.10)",
                hoverinfo="skip",
            )
        )
    for text, torque, dash in (
        ("continuous torque", continuous, "dash"),
        ("peak torque", ratings.peak_torque, "dot"),
    ):
        if torque is not None and torque <= 1.3 * top:
            ends = [-reach, reach, None, -reach, reach]
            levels = [torque, torque, None, -torque, -torque]
            data.append(curve(ends, levels, text, _INK, 1, dash=dash, hoverinfo="skip"))
    return data


def _bars(
    x: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[list[float | None], list[float | None]]:
    """One upright stroke per interval, None between them; equal ones once."""
    seen = {
        (round(float(s), 9), float(f"{a:.3g}"), float(f"{b:.3g}"))
        for s, a, b in zip(x, lower, upper, strict=True)
    }
    xs: list[float | None] = []
    ys: list[float | None] = []
    for s, a, b in sorted(seen):
        xs += [s, s, None]
        ys += [a, b, None]
    return xs, ys


def _cloud(
    assessments: Sequence[Assessment], name: str, colour: str, symbol: str = "circle", size: int = 8
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": [a.candidate.mass for a in assessments],
        "y": [max(100 * a.margin, _LEAST_MARGIN) for a in assessments],
        "marker": {"color": colour, "symbol": symbol, "size": size, "line": {"width": 1}},
        "customdata": [
            [a.candidate.name, f"{100 * a.margin:.3g}", len(a.not_checked)] for a in assessments
        ],
        "hovertemplate": "%{customdata[0]}<br>%{x:.3g} kg, least margin %{customdata[1]} %, "
        "%{customdata[2]} not checked<extra></extra>",
    }


def curve(
    x: Sequence[float | None],
    y: Sequence[float | None],
    name: str,
    colour: str,
    width: float = 1.6,
    dash: str = "solid",
    shape: str = "linear",
    **more: Any,
) -> dict[str, Any]:
    """Return one of plotly's lines."""
    line = {"color": colour, "width": width, "dash": dash, "shape": shape}
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": list(x),
        "y": list(y),
        "line": line,
        **more,
    }


def axes_layout(x: str, y: str) -> dict[str, Any]:
    """Return plotly's layout with the axes' titles."""
    axis = {
        "gridcolor": _GRID,
        "zerolinecolor": "#BBBBBB",
        "linecolor": _QUIET,
        "automargin": True,
        "ticks": "outside",
        "tickcolor": _QUIET,
    }
    return {
        "xaxis": {**axis, "title": {"text": x, "standoff": 8}},
        "yaxis": {**axis, "title": {"text": y, "standoff": 8}},
        "font": {
            "family": "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif",
            "size": 12,
            "color": _INK,
        },
        "margin": {"l": 56, "r": 12, "t": 28, "b": 44},
        # below the axis: above the plot the mode bar would cover it
        "legend": {
            "orientation": "h",
            "x": 0,
            "y": 0,
            "yref": "container",
            "yanchor": "bottom",
            "font": {"size": 11},
        },
        "plot_bgcolor": "white",
        "paper_bgcolor": "white",
        "hovermode": "closest",
    }


def five_digits(x: np.ndarray) -> list[float]:
    """Return numbers with five digits: a third of the page's size."""
    return [float(f"{value:.5g}") for value in x.tolist()]
