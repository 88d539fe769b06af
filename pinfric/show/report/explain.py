"""What each effect of a scene costs and changes: tables for people, a dictionary for machines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pinfric.show.report.tables import Column, Kind, Table
from pinfric.show.report.values import digits, json_safe
from pinfric.study.explain import Explanation, GearLoss

if TYPE_CHECKING:
    from rich.console import RenderableType


def explain_json(
    explanation: Explanation, scene: str, warnings: Sequence[str] = ()
) -> dict[str, Any]:
    """Return everything `pinfric explain --json` prints; SI units but for `_us` (microseconds).

    Args:
        explanation: what was measured.
        scene: its file.
        warnings: what was noticed on the way.
    """
    return json_safe({"scene": scene, **asdict(explanation), "warnings": list(warnings)})


def explain_report(explanation: Explanation, scene: str) -> list[RenderableType]:
    """Return the tables and lines that `pinfric explain` prints, for a rich console."""
    from rich.text import Text

    name = Path(scene).stem
    called = Table(
        f"{name}: the effects it calls for",
        (Column("effect", Kind.LABEL), Column("", Kind.LABEL), Column("why", Kind.WORDS)),
        [(row.name, "on" if row.on else "off", row.why) for row in explanation.effects],
        faint=frozenset(i for i, row in enumerate(explanation.effects) if not row.on),
    )
    measured = Table(
        f"{name}: what they cost and change",
        (Column("effect", Kind.LABEL), Column("cost\nus"), Column("peak\nchange"),
         Column("RMS\nchange"), Column("of", Kind.NAME)),
        [(row.name, f"{row.cost_us:.2f}", _signed(row.peak_change), _signed(row.rms_change),
          f"{row.drive}{' (motor)' if row.motor_side else ''}")
         for row in explanation.effects if math.isfinite(row.cost_us)],
    )  # fmt: skip
    tables: list[RenderableType] = [called, Text(), measured, Text()]
    if explanation.gears:
        tables += [_gear_table(explanation.gears), Text()]
    lines = [
        f"all of it {explanation.total_us:.2f} us per sample, nothing of it "
        f"{explanation.plain_us:.2f} us; one thread, {explanation.samples} samples",
        "cost: what leaving it out saves; change: what it adds to the worst effort of the drive "
        "where the RMS changes most",
    ]
    if any(row.name == "coupling" and row.on for row in explanation.effects):
        lines.append("coupling: against one pass with the loads that there are without friction")
    return [*tables, *(Text(line) for line in lines)]


def _gear_table(gears: Sequence[GearLoss]) -> Table:
    columns = (Column("joint", Kind.NAME), Column("RMS\nN m"), Column("peak\nchange"),
               Column("RMS\nchange"))  # fmt: skip
    rows = [(gear.drive, digits(gear.rms), _signed(gear.peak_change), _signed(gear.rms_change))
            for gear in gears]  # fmt: skip
    return Table("gear by joint: motor torque, and what the loss with the load adds", columns, rows)


def _signed(x: float) -> str:
    return f"{'+' if x > 0 else '-' if x < 0 else ''}{digits(abs(x))}"
