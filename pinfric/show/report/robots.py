"""The bundled robots whose friction was measured, as a table for people."""

from __future__ import annotations

from pinfric.model.scene_file import bundled_folder, measured_scenes
from pinfric.model.schema import Measured
from pinfric.show.report.tables import Column, Kind, Report, Table, paragraphs


def robots_report() -> Report:
    """Return the table that `pinfric robots` prints, for a rich console."""
    heads = ("name", "robot", "grade", "to speed\nrad/s", "deg C", "side")
    columns = [Column(head, Kind.LABEL) for head in heads]
    rows = [(name, m.robot, m.grade, _speeds(m), _pair(m), m.side) for name, m in _scenes()]
    return paragraphs(
        Table("bundled robots with measured friction", columns, rows),
        [
            "grade A: logs or the maker's record are public; B: the method is stated; C: neither",
            "side motor: by its current, so the gear's losses are included",
            f"sources, what is not known, what contradicts them: the files in {bundled_folder()}",
        ],
    )


def _scenes() -> list[tuple[str, Measured]]:
    return sorted(measured_scenes().items())


def _speeds(measured: Measured) -> str:
    tops = sorted({top for _, top in measured.speeds})
    return ", ".join(f"{top:g}" for top in tops) or "unknown"


def _pair(measured: Measured) -> str:
    return " to ".join(f"{x:g}" for x in measured.temperature or ()) or "unknown"
