"""Pictures of the identification page: measured and predicted effort, and residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pinfric.identification.identify import Identified, beside_measured, left_over, running_mean
from pinfric.model.described import SPEED, unit_at
from pinfric.motions.summary import effort_unit
from pinfric.show.figure.measured import draw_measured
from pinfric.show.figure.panel import panel
from pinfric.show.figure.style import BLUE, RED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Pieces a log is cut into, each kept with its extremes; dots of a cloud.
_PIECES, _DOTS = 500, 600


def over_time(found: Identified) -> list[Figure]:
    """Draw each joint's measured effort over the identified scene's, rest intervals as bands.

    Logs stand one after another; measured efforts are moved back by the delay.
    """
    names = found.scene.joint_names
    units = [effort_unit(found.scene, j) for j in range(len(names))]
    figures = [panel("time, s", f"effort, {unit}", 10.0, 2.9) for unit in units]
    start = 0.0
    for number in range(len(found.recordings)):
        result, log = beside_measured(found, number)
        assert result.t is not None  # a log has times
        for name, (_, axes) in zip(names, figures, strict=True):
            shift = start - float(result.t[0])
            draw_measured(axes, result, log, name, shift, found.delay, _PIECES)
        start += float(result.t[-1] - result.t[0]) + 1.0
    for _, axes in figures:  # of the first log
        for line, label in zip(axes.lines, ("measured", "identified scene"), strict=False):
            line.set_label(label)
    return [figure for figure, _ in figures]


def residual_clouds(found: Identified, joint: int) -> dict[str, Figure]:
    """Draw one joint's residual over velocity and over load: a missing law shows there.

    Args:
        found: what was identified.
        joint: its number.
    """
    unit = effort_unit(found.scene, joint)
    velocity, load, off = left_over(found, joint)
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
