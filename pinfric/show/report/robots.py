"""The bundled robots: with measured friction as a table, all others by name."""

from __future__ import annotations

from pinfric.model.robot import BUNDLED, example_robot_data
from pinfric.model.scene_file import bundled_folder, measured_scenes
from pinfric.show.report.tables import Column, ColumnKind, Report, Table, paragraphs


def robots_report() -> Report:
    """Return what `pinfric robots` prints."""
    heads = ("name", "robot", "grade", "to speed\nrad/s", "deg C", "side")
    columns = [Column(head, ColumnKind.LABEL) for head in heads]
    rows = []
    for name, m in sorted(measured_scenes().items()):
        tops = sorted({top for _, top in m.speeds})
        speeds = ", ".join(f"{top:g}" for top in tops) or "unknown"
        warmth = " to ".join(f"{x:g}" for x in m.temperature or ()) or "unknown"
        rows.append((name, m.robot, m.grade, speeds, warmth, m.side))
    scenes = sorted(x for x in bundled_folder().glob("*.yaml") if x.name.count(".") == 1)
    folder = example_robot_data()
    urdfs = sorted(str(file.relative_to(folder)) for file in folder.rglob("*.urdf"))
    return paragraphs(
        Table("bundled robots with measured friction", columns, rows),
        [
            "grade A: logs or the maker's record are public; B: the method is stated; C: neither",
            "side motor: by its current, so the gear's losses are included",
            f"scenes: {', '.join(file.stem for file in scenes)}",
            f"URDFs, for `pinfric new {BUNDLED}NAME` and `robot.urdf`: {', '.join(urdfs)}",
            f"sources, what is not known, what contradicts them: the files in {bundled_folder()}",
        ],
    )
