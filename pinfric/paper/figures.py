"""The paper's five figures of results from our own runs, with the paper's captions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.dynamics.inverse.result import runs
from pinfric.paper.reproduction import Reproduction

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FORWARD, _INVERSE, _OTHER, _STICKING = "#222222", "#0072B2", "#D55E00", "#E69F00"
#: The band is opaque: shading shining through would change its colour.
_BAND = "#A9CFE8"
_COLUMNS: dict[str, Any] = {"ncols": 3, "frameon": False, "loc": "lower left"}


def paper_figures(pendulum: Reproduction, three_link: Reproduction) -> dict[str, Figure]:
    """Return the paper's figures 5, 6, 8, 9 and 10 by file name."""
    figure_5, (rate, acceleration) = _axes(
        pendulum, "Fig. 5  Angular velocity and angular acceleration of a simple pendulum", 2
    )
    rate.plot(pendulum.motion.t, pendulum.motion.v[:, 0], color=_FORWARD)
    rate.set_ylabel("angular velocity (rad/s)")
    broken = _broken(pendulum, pendulum.motion.a[:, 0])
    acceleration.plot(pendulum.motion.t, broken, color=_FORWARD)
    acceleration.set_ylabel("angular acceleration (rad/s²)")
    figure_6, axes = _axes(
        pendulum,
        "Fig. 6  Comparison of the actuating torque obtained by the inverse dynamic analysis\n"
        "and that used for forward dynamic analysis",
    )
    _intervals(pendulum, axes, ["actuating torque $T_A$"])
    figure_8, (rate,) = _axes(
        three_link, "Fig. 8  Relative angular velocity of link 2 with respect to link 1"
    )
    rate.plot(three_link.motion.t, three_link.motion.v[:, 1], color=_FORWARD)
    rate.set_ylabel("relative angular velocity (rad/s)")
    figure_9, axes = _axes(
        three_link,
        "Fig. 9  Comparison of actuating torques obtained by the inverse dynamic analysis\n"
        "and the forward dynamic analysis",
        3,
    )
    _intervals(three_link, axes, [f"$T_{{A{name}}}$" for name in ("01", "12", "23")])
    figure_10, (torque,) = _axes(
        three_link,
        "Fig. 10  Comparison of actuating torques obtained by the inverse dynamic analyses\n"
        "with friction and without friction",
    )
    t, bare = three_link.motion.t, three_link.frictionless.effort_upper[:, 1]
    slides = _band(three_link, torque, 1)
    torque.plot(t, slides, color=_INVERSE, label="with friction")
    torque.plot(t, _broken(three_link, bare), "--", color=_OTHER, label="without friction")
    torque.set_ylabel("$T_{A12}$ (N m)")
    torque.legend(**_COLUMNS, bbox_to_anchor=(0, 1))
    return {
        "figure_5": figure_5,
        "figure_6": figure_6,
        "figure_8": figure_8,
        "figure_9": figure_9,
        "figure_10": figure_10,
    }


def _band(r: Reproduction, axes: Axes, joint: int, label: str = "") -> np.ndarray:
    """Draw a torque's interval where a joint sticks; return the torque (T,), NaN there."""
    lower, upper = r.result.effort_lower[:, joint], r.result.effort_upper[:, joint]
    axes.fill_between(r.motion.t, lower, upper, color=_BAND, linewidth=0, zorder=1.5, label=label)
    return np.where(upper > lower, np.nan, upper)


def _intervals(r: Reproduction, axes: Sequence[Axes], names: Sequence[str]) -> None:
    for joint, (torque, name) in enumerate(zip(axes, names, strict=True)):
        slides = _band(r, torque, joint, "inverse, sticking: any torque in the band")
        (line,) = torque.plot(r.motion.t, slides, color=_INVERSE, label="inverse, sliding")
        line.set(linewidth=3.5, alpha=0.6)
        effort = r.motion.effort[:, joint]
        torque.plot(r.motion.t, effort, color=_FORWARD, linewidth=1.2, label="forward")
        torque.set_ylabel(f"{name} (N m)")
    axes[0].legend(**_COLUMNS, bbox_to_anchor=(0, 1))


def _broken(r: Reproduction, values: np.ndarray) -> np.ndarray:
    """Return values with gaps where the modes change: a jump is no line."""
    site = r.scene.site_names.index(r.example.site)
    gaps = np.array(values, dtype=float)
    gaps[1:][np.diff(r.result.sticking[:, site].astype(int)) != 0] = np.nan
    return gaps


def _axes(r: Reproduction, caption: str, count: int = 1) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 1.6 + 2.4 * count), dpi=150, layout="constrained")
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0].tolist()
    figure.supxlabel(caption, fontsize=10.5, x=0.5)
    site, t = r.scene.site_names.index(r.example.site), r.motion.t
    for panel in axes:
        for first, last in runs(r.result.sticking[:, site]):
            panel.axvspan(t[first], t[last], color=_STICKING, alpha=0.2, linewidth=0)
        panel.axhline(0, color="#AAAAAA", linewidth=0.7, zorder=0)
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0)
    axes[-1].set_xlabel("time (s)")
    (start, end), (low, high) = r.stick, r.example.printed
    axes[0].annotate(
        f"sticks {start:.4f} to {end:.4f} s\n(printed: {low:g} to {high:g} s)",
        xy=(end, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(4, -4),
        textcoords="offset points",
        va="top",
        fontsize=8.5,
        color="#7A5200",
    )
    return figure, axes
