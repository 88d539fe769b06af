"""What an identification says: tables for people, a dictionary for machines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pinfric import __version__
from pinfric.show.report.tables import Column, Kind, Report, Table, paragraphs
from pinfric.show.report.values import digits, json_safe
from pinfric.study.identify.identify import Identified
from pinfric.study.summary import effort_unit


def identify_json(found: Identified, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """Return everything `pinfric identify --json` prints; SI units, None for what is not a number.

    Args:
        found: of `identify`.
        warnings: what was noticed on the way.
    """
    tables = zip(found.scene.joint_names, found.estimate.choice.errors, strict=True)
    considered = {name: {str(law): x for law, x in table.items()} for name, table in tables}
    return json_safe({
        "pinfric": __version__,
        "scene": found.scene.source,
        "logs": [{"name": one.name, "samples": one.trajectory.t.size,
                  "duration": one.trajectory.duration, "noise": dict(one.reading.noise),
                  "cutoff": dict(one.reading.cutoff), "dropped": one.reading.dropped}
                 for one in found.recordings],
        "delay": found.delay,
        "delay_standard_error": found.estimate.delay.standard_error,
        "joints": [
            {"name": name, "law": str(found.laws[name]) if name in found.laws else None,
             "error": asdict(error), "held_out": considered[name],
             "rest": asdict(found.rest[name]), "spread_between_logs": found.spread[name]}
            for name, error in found.errors.items()
        ],
        "parameters": [asdict(parameter) for parameter in found.parameters],
        "unseen": {log: {name: asdict(error) for name, error in joints.items()}
                   for log, joints in found.unseen.items()},
        "inertias": "kept" if found.keeps_inertias else "corrected",
        "advice": [asdict(one) | {"points": None} for one in found.advice],
        "said": list(found.said),
        "warnings": list(warnings),
    })  # fmt: skip


def identify_report(found: Identified) -> Report:
    """Return the tables and lines that `pinfric identify` prints, for a rich console."""
    logs = ", ".join(one.name for one in found.recordings)
    duration = sum(one.trajectory.duration for one in found.recordings)
    title = f"{Path(found.scene.source).stem} · {logs}: {digits(duration)} s"
    units = {name: effort_unit(found.scene, j) for j, name in enumerate(found.scene.joint_names)}
    laws = Table(title, [
        Column("joint", Kind.NAME), Column("law", Kind.WORDS), Column("effort\nRMS"),
        Column("off, where\nnot fitted"), Column("of Coulomb\n+ viscous"),
    ], [(name, found.law_of(name), f"{digits(error.rms)} {units[name]}", error.share,
         f"{error.error / error.plain:.2f}") for name, error in found.errors.items()])  # fmt: skip
    figures = Table("coefficients, with 95 % intervals; (in brackets): not determined", [
        Column("joint", Kind.NAME), Column("coefficient", Kind.LABEL), Column("value"),
        Column("from"), Column("to"), Column("unit", Kind.LABEL),
    ], [(p.joint, p.name, digits(p.value) if p.determined else f"({digits(p.value)})",
         digits(p.low), digits(p.high), p.unit) for p in found.parameters], keys=2)  # fmt: skip
    best = found.advice[0]
    least = min(best.factors, key=best.factors.__getitem__)
    lines = [f"logged efforts' delay: {found.estimate.delay}", *found.said,
             f"30 s more would tell most so: {best.name.lower()} (standard error of {least}: "
             f"{best.factors[least]:.2f} of now)"]  # fmt: skip
    unseen = _unseen(found, units) if found.unseen else None
    return paragraphs(laws, figures, unseen, lines)


def _unseen(found: Identified, units: dict[str, str]) -> Table:
    rows = [(log, name, f"{digits(error.rms)} {units[name]}", error.share)
            for log, joints in found.unseen.items() for name, error in joints.items()]  # fmt: skip
    columns = [Column("log held out", Kind.NAME), Column("joint", Kind.NAME),
               Column("effort\nRMS"), Column("off")]  # fmt: skip
    return Table("logs that were only predicted", columns, rows, keys=2)
