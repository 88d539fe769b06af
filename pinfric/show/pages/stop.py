"""The page of stops."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pinfric.show.pages.page import drawn, page
from pinfric.show.report.rows import table_of
from pinfric.show.report.stop import axes_table, grid_table, how, not_checked, verdict
from pinfric.stops.study import StopResult, stop_summary


def stop_page(result: StopResult) -> str:
    """Return the stops of a cycle as one HTML page.

    Raises:
        PinfricError: see `page`.
    """
    summary = stop_summary(result)
    axes: list[dict[str, Any]] = []
    for d, axis in enumerate(summary.axes):
        axes.append(
            {
                "name": axis.name,
                "command": axis.command,
                "load": axis.load,
                "pictures": drawn(result, d, axis.name),
                "criteria": table_of("", axis.criteria),
            }
        )
    robot = result.scene.robot
    files = [result.scene.source, str(robot.urdf) if robot else "", result.trajectory.source]
    return page(
        "stop",
        result.scene.actuator_names,
        [axis.name for axis in summary.axes],
        files,
        views=axes,
        summary=summary,
        scene=Path(result.scene.source).stem,
        trajectory=Path(result.trajectory.source).name,
        verdict=verdict(summary),
        how=how(summary),
        worst=axes_table(summary, ""),
        grid=grid_table(summary, ""),
        not_checked=not_checked(summary),
    )
