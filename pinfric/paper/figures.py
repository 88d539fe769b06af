"""The paper's five figures of results, drawn from our own runs and labelled like the paper's."""

from __future__ import annotations

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
    """Return the figures 5, 6, 8, 9 and 10 of the paper by file name."""
    return {
        "figure_5.png": _figure_5(pendulum),
        "figure_6.png": _figure_6(pendulum),
        "figure_8.png": _figure_8(three_link),
        "figure_9.png": _figure_9(three_link),
        "figure_10.png": _figure_10(three_link),
    }


def _figure_5(r: Reproduction) -> Figure:
    caption = "Fig. 5  Angular velocity and angular acceleration of a simple pendulum"
    figure, (rate, acceleration) = _axes(caption, 2)
    rate.plot(r.motion.t, r.motion.v[:, 0], color=_FORWARD)
    rate.set_ylabel("angular velocity (rad/s)")
    broken = _broken(r, r.motion.a[:, 0])
    acceleration.plot(r.motion.t, broken, color=_FORWARD)
    acceleration.set_ylabel("angular acceleration (rad/s²)")
    _finish(r, rate, acceleration)
    return figure


def _figure_6(r: Reproduction) -> Figure:
    caption = (
        "Fig. 6  Comparison of the actuating torque obtained by the inverse dynamic analysis\n"
        "and that used for forward dynamic analysis"
    )
    figure, (torque,) = _axes(caption, 1)
    _interval(torque, r, 0)
    torque.set_ylabel("actuating torque $T_A$ (N m)")
    torque.legend(**_COLUMNS, bbox_to_anchor=(0, 1))
    _finish(r, torque)
    return figure


def _figure_8(r: Reproduction) -> Figure:
    figure, (rate,) = _axes("Fig. 8  Relative angular velocity of link 2 with respect to link 1", 1)
    rate.plot(r.motion.t, r.motion.v[:, 1], color=_FORWARD)
    rate.set_ylabel("relative angular velocity (rad/s)")
    _finish(r, rate)
    return figure


def _figure_9(r: Reproduction) -> Figure:
    caption = (
        "Fig. 9  Comparison of actuating torques obtained by the inverse dynamic analysis\n"
        "and the forward dynamic analysis"
    )
    figure, axes = _axes(caption, 3)
    for joint, (torque, name) in enumerate(zip(axes, ("01", "12", "23"), strict=True)):
        _interval(torque, r, joint)
        torque.set_ylabel(f"$T_{{A{name}}}$ (N m)")
    axes[0].legend(**_COLUMNS, bbox_to_anchor=(0, 1))
    _finish(r, *axes)
    return figure


def _figure_10(r: Reproduction) -> Figure:
    caption = (
        "Fig. 10  Comparison of actuating torques obtained by the inverse dynamic analyses\n"
        "with friction and without friction"
    )
    figure, (torque,) = _axes(caption, 1)
    t = r.motion.t
    lower, upper = r.result.effort_lower[:, 1], r.result.effort_upper[:, 1]
    torque.fill_between(t, lower, upper, color=_BAND, linewidth=0, zorder=1.5)
    torque.plot(t, np.where(upper > lower, np.nan, upper), color=_INVERSE, label="with friction")
    frictionless = r.frictionless.effort_upper[:, 1]
    torque.plot(t, _broken(r, frictionless), color=_OTHER, linestyle="--", label="without friction")
    torque.set_ylabel("$T_{A12}$ (N m)")
    torque.legend(**_COLUMNS, bbox_to_anchor=(0, 1))
    _finish(r, torque)
    return figure


def _interval(axes: Axes, r: Reproduction, joint: int) -> None:
    """The torque that was applied, and what inverse dynamics makes of the motion."""
    t, lower, upper = r.motion.t, r.result.effort_lower[:, joint], r.result.effort_upper[:, joint]
    band = axes.fill_between(t, lower, upper, color=_BAND, linewidth=0, zorder=1.5)
    band.set_label("inverse, sticking: any torque in the band")
    slides = np.where(upper > lower, np.nan, upper)
    axes.plot(t, slides, color=_INVERSE, linewidth=3.5, alpha=0.6, label="inverse, sliding")
    axes.plot(t, r.motion.effort[:, joint], color=_FORWARD, linewidth=1.2, label="forward")


def _broken(r: Reproduction, values: np.ndarray) -> np.ndarray:
    """Values with gaps where the modes change: a jump is no line."""
    site = r.scene.site_names.index(r.example.site)
    gaps = np.array(values, dtype=float)
    gaps[1:][np.diff(r.result.sticking[:, site].astype(int)) != 0] = np.nan
    return gaps


def _axes(caption: str, count: int) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 1.6 + 2.4 * count), dpi=150, layout="constrained")
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0].tolist()
    figure.supxlabel(caption, fontsize=10.5, x=0.5)
    return figure, axes


def _finish(r: Reproduction, *axes: Axes) -> None:
    """Mark the stiction interval and tidy up."""
    site = r.scene.site_names.index(r.example.site)
    for one in axes:
        for first, last in runs(r.result.sticking[:, site]):
            one.axvspan(
                r.motion.t[first], r.motion.t[last], color=_STICKING, alpha=0.2, linewidth=0
            )
        one.axhline(0, color="#AAAAAA", linewidth=0.7, zorder=0)
        one.spines[["top", "right"]].set_visible(False)
        one.margins(x=0)
    axes[-1].set_xlabel("time (s)")
    start, end = r.stick
    axes[0].annotate(
        f"sticks {start:.4f} to {end:.4f} s\n(printed: {r.example.printed[0]:g} to "
        f"{r.example.printed[1]:g} s)",
        xy=(end, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(4, -4),
        textcoords="offset points",
        va="top",
        fontsize=8.5,
        color="#7A5200",
    )
