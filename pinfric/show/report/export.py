"""What an export's constants cost: a table for people, a dictionary for machines."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pinfric.model.brief import file_name
from pinfric.show.report.tables import Column, Kind, Report, Table, key_columns, paragraphs
from pinfric.show.report.values import digits, json_safe
from pinfric.study.export.constants import JointConstants
from pinfric.study.export.controller import stable_scale
from pinfric.study.export.export import FORMATS, Exported


def export_json(exported: Exported, file: Path, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Return everything `pinfric export --json` prints; SI units, None for what is not known."""
    return json_safe({
        "scene": exported.scene, "trajectory": exported.trajectory, "to": exported.to,
        "file": str(file), "samples": exported.samples,
        "joints": [asdict(joint) for joint in exported.joints],
        "left_out": list(exported.left_out), "uncertainty": dict(exported.uncertainty),
        "warnings": list(warnings),
    })  # fmt: skip


def export_report(exported: Exported) -> Report:
    """Return the table and lines that `pinfric export` prints, for a rich console."""
    form = FORMATS[exported.to]
    unit, key = key_columns([joint.unit for joint in exported.joints])
    headings = ("error\nRMS", "error\npeak", "torque\npeak", "worst\nat load")
    figures = [Column(f"{heading}\n{unit}".rstrip()) for heading in headings]
    columns = (*key, *map(Column, form.terms.values()), *figures,
               Column(f"standing\nstill\n{unit}".rstrip(), Kind.LABEL))  # fmt: skip
    title = f"{Path(exported.scene).stem} · {file_name(exported.trajectory)}: {form.title}"
    lines = [] if exported.to != "cpp" else [
        "the header knows the load and needs no constants: these are what a controller would have "
        "without it, and `error` what they miss along this motion"
    ]  # fmt: skip
    lines += [
        "constants in the joint's unit, per rad/s or m/s, and in kg m^2 or kg; error: theirs "
        "against the scene's torque (motor's x ratio) where the joint moves",
        f"standing still the scene has an interval beyond the load: {form.at_rest}",
        *(f"not in the file: {line}" for line in exported.left_out),
    ]
    if alike := [joint.joint for joint in exported.joints if not joint.apart]:
        lines.append(f"the motion does not tell the constants apart of {', '.join(alike)}")
    lines += [
        f"{drive}: friction known to {e:.1%} (e); stable scale 1/(1+e) = {stable_scale(e):.3f}"
        for drive, e in exported.uncertainty.items()
    ]
    if not exported.joints:
        missing = f"{title}: drives are coupled, so constants of single joints do not compare"
        return [missing, *lines[len(lines) - len(exported.uncertainty) :]]
    rows = [(joint.joint, *([] if unit else [joint.unit]), *_figures(joint, form.terms))
            for joint in exported.joints]  # fmt: skip
    table = Table(title, columns, rows, keys=len(key))
    return paragraphs(table, lines)


def _figures(joint: JointConstants, terms: Collection[str]) -> tuple[str, ...]:
    still = f"{digits(joint.rest_lower)} to {digits(joint.rest_upper)}"
    still = still if joint.rest_lower == joint.rest_lower else "never"
    if not joint.moving:
        return "never moves", *[""] * (len(terms) + 3), still
    zero = 1e-9 * joint.torque_peak
    numbers = [*(getattr(joint, term) for term in terms), joint.error_rms, joint.error_peak,
               joint.torque_peak, joint.worst_load]  # fmt: skip
    return *(digits(x, zero) for x in numbers), still
