"""Cost and change of each effect of a scene, as tables."""

from __future__ import annotations

import math
from pathlib import Path

from pinfric.accuracy.explain import Explanation
from pinfric.elastic.matters import ElasticEffect
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Report, paragraphs
from pinfric.show.report.values import digits

#: Fields that say which effects a scene calls for.
_CALLED = ("name", "on", "why")


def explain_report(explanation: Explanation, scene: str) -> Report:
    """Return what `pinfric explain` prints."""
    name = Path(scene).stem
    faint = frozenset(i for i, row in enumerate(explanation.effects) if not row.on)
    called = table_of(f"{name}: effects", explanation.effects, only=_CALLED, faint=faint)
    timed = [row for row in explanation.effects if math.isfinite(row.cost_us)]
    side = {"motor_side": lambda row: "(motor)" if row.motor_side else ""}
    measured = table_of(
        f"{name}: cost and change of each effect", timed, cells=side, without=_CALLED[1:]
    )
    title = "gear by joint: motor torque, and the part due to the load-dependent loss"
    gears = table_of(title, explanation.gears)
    lines = [
        f"all effects {explanation.total_us:.2f} us per sample, no effect "
        f"{explanation.plain_us:.2f} us; one thread, {explanation.samples} samples",
        "cost: what leaving it out saves, < where the timings' spread hides it; change: what it "
        "adds to the worst effort of the drive that it changes most",
    ]
    if any(row.name == "coupling" and row.on for row in explanation.effects):
        lines.append("coupling: compared with one pass with the loads without friction")
    elastic = [] if explanation.elastic is None else elastic_lines(explanation.elastic)
    return paragraphs(called, measured, gears, lines, elastic)


def elastic_lines(effect: ElasticEffect) -> list[str]:
    """Return the effect of elastic gears on motors, motion and the tool's position."""
    if not math.isfinite(effect.frequency):
        return ["elastic gears: no natural frequency; loops stay open, or nothing has a mass"]
    if effect.bandwidth is None or effect.motor_share is None:
        return [
            f"elastic gears: lowest frequency {digits(effect.frequency)} Hz at the scene's "
            "start; give a motion to see whether it matters"
        ]
    ratio = effect.bandwidth / effect.frequency
    lines = [
        f"elastic gears: lowest frequency {digits(effect.frequency)} Hz, motion up to "
        f"{digits(effect.bandwidth)} Hz (95 % of its accelerations): error of the wind-up about "
        f"{100 * ratio**2:.2g} %",
        f"  motor torque: winding up the gears needs {100 * effect.motor_share:.2g} % of the RMS "
        f"({effect.drive}); no command includes it",
    ]
    if effect.sag is not None and effect.interval is not None:
        lines.append(
            f"  tool at rest: sags by up to {digits(1e3 * effect.sag)} mm; friction can hold it "
            f"within ±{digits(1e3 * effect.interval)} mm"
        )
    if effect.corrected:
        lines.append(
            f"  encoder at the joint of {', '.join(effect.corrected)}: the controller corrects "
            "their wind-up, which is not in the sag and the range"
        )
    return lines
