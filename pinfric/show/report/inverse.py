"""What inverse dynamics says: tables for people, a dictionary for machines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pinfric import __version__
from pinfric.dynamics.inverse.result import InverseResult, runs
from pinfric.dynamics.samples.outcome import Status
from pinfric.model.brief import counted
from pinfric.show.report.elastic import elasticity_json, elasticity_parts
from pinfric.show.report.tables import Column, Kind, Report, Table, key_columns, paragraphs
from pinfric.show.report.values import digits, json_safe, rough, span
from pinfric.study.elastic.motion import Elasticity
from pinfric.study.summary import (
    ROUNDING,
    ActuatorSummary,
    payload_phases,
    rounding,
    summarize,
)
from pinfric.study.trajectory.log.judged import JudgedLog

#: A peak that is known to no better than this share of itself is printed with its uncertainty.
_UNCERTAIN_SHARE = 0.1


def inverse_json(
    result: InverseResult,
    trajectory: str,
    warnings: Sequence[str] = (),
    log: JudgedLog | None = None,
    elastic: Elasticity | None = None,
) -> dict[str, Any]:
    """Return everything `pinfric inverse --json` prints; SI units, None for what is not a number.

    Args:
        result: with times.
        trajectory: its name or path.
        warnings: what was noticed on the way.
        log: how the trajectory was read, if it came from samples.
        elastic: what its elastic gears do, where it has any.

    Raises:
        StateError: the result has no times.
    """
    summaries = summarize(result)
    assert result.t is not None  # summarize refuses a result without
    return json_safe({
        "pinfric": __version__,
        "scene": result.scene.source,
        "trajectory": trajectory,
        "samples": len(result.t),
        "start": result.t[0],
        "end": result.t[-1],
        "joints": [asdict(summary) for summary in summaries],
        "sites": [
            {"name": name, "stick_intervals": len(runs(result.sticking[:, s])),
             "reversals": result.reversal[:, s].sum(),
             "max_normal_load": result.normal_load[:, s].max()}
            for s, name in enumerate(result.site_names)
        ],
        "stick_intervals": [asdict(interval) for interval in result.stick_intervals()],
        "payloads": {name: [{"start": start, "end": end} for start, end in spans]
                     for name, spans in payload_phases(result).items()},
        "status": {status.name.lower(): (result.status == status).sum() for status in Status},
        "warnings": list(warnings),
        "input": None if log is None else _input_json(log),
        **({} if elastic is None else {"elasticity": elasticity_json(elastic)}),
    })  # fmt: skip


def _input_json(log: JudgedLog) -> dict[str, Any]:
    """How a log was read: Hz, s, rad or m by joint; N m or N by drive."""
    reading = log.reading
    return {
        "samples": reading.samples,
        "dropped": reading.dropped,
        "resampled": reading.resampled,
        "jitter": reading.jitter,
        "noise": dict(reading.noise),
        "cutoff": dict(reading.cutoff),
        "peak_uncertainty": dict(log.peak_uncertainty),
        "measured": {name: asdict(found) for name, found in log.measured.items()},
        "said": list(reading.said),
    }


def inverse_report(
    result: InverseResult,
    trajectory: str,
    log: JudgedLog | None = None,
    elastic: Elasticity | None = None,
) -> Report:
    """Return the tables and lines that `pinfric inverse` prints, for a rich console.

    Args:
        result: with times.
        trajectory: its name, for the title.
        log: how the trajectory was read, if it came from samples.
        elastic: what its elastic gears do, where it has any.

    Raises:
        StateError: the result has no times.
    """
    summaries = summarize(result)
    geared = [s for s, drive in zip(summaries, result.scene.drives, strict=True)
              if drive.transmission is not None]  # fmt: skip
    return paragraphs(
        _effort_table(result, summaries, trajectory, log),
        _motor_table(geared) if geared else None,
        _measured_table(log) if log is not None and log.measured else None,
        *(elasticity_parts(elastic) if elastic is not None else ()),
        [*_footer(result), *log_lines(log, {s.name: s.unit for s in summaries})],
    )


def log_lines(log: JudgedLog | None, units: Mapping[str, str]) -> list[str]:
    """Return "filtered at 11 Hz, noise 1.0e-05 rad, peak efforts known to ±0.4 N m", or nothing.

    Args:
        log: None where the motion is no log's.
        units: drive -> N m or N.
    """
    if log is None:
        return []
    if not log.reading.noise_line:
        return []
    known = ""
    if log.peak_uncertainty:
        name = max(log.peak_uncertainty, key=log.peak_uncertainty.__getitem__)
        known = f", peak efforts known to ±{rough(log.peak_uncertainty[name])} {units[name]}"
    return [f"{log.reading.noise_line}{known}"]


def _effort_table(
    result: InverseResult,
    summaries: Sequence[ActuatorSummary],
    trajectory: str,
    log: JudgedLog | None,
) -> Table:
    assert result.t is not None
    unit, key = key_columns([s.unit for s in summaries])
    title = (
        f"{Path(result.scene.source).stem} · {trajectory}" if trajectory else result.scene.source
    )
    count = len(result.t)
    title += f": {count} sample{'s' * (count > 1)}, {digits(result.t[-1] - result.t[0])} s"
    headings = (
        ("peak", unit), ("RMS\nleast–worst", unit),  # noqa: RUF001 - a range
        ("frictionless\npeak, RMS", unit),
        ("friction\nshare", ""), ("sticks", "s"), ("widest\ninterval", unit),
    )  # fmt: skip
    figures = [Column(heading + (f"\n{unit}" if unit else "")) for heading, unit in headings]
    zero = rounding(result)
    rows = [
        (
            s.name, *([] if unit else [s.unit]),
            _peak(s, zero, log), span(s.rms_least, s.rms, zero),
            f"{digits(s.peak_frictionless, zero)}, {digits(s.rms_frictionless, zero)}",
            "n/a" if math.isnan(s.friction_share) else f"{100 * s.friction_share:.0f} %",
            digits(s.stick_time), digits(s.max_interval, zero),
        )
        for s in summaries
    ]  # fmt: skip
    return Table(title, [*key, *figures], rows, keys=len(key))


def _measured_table(log: JudgedLog) -> Table:
    """Measured efforts beside the computed ones."""
    rows = [
        (name, digits(m.rms), digits(m.rms_error),
         f"{100 * m.relative_error:.0f} %" if np.isfinite(m.relative_error) else "",
         digits(m.rest), "" if np.isnan(m.coverage) else f"{100 * m.coverage:.0f} %")
        for name, m in log.measured.items()
    ]  # fmt: skip
    columns = (Column("joint", Kind.NAME), Column("measured\nRMS"), Column("off\nRMS"),
               Column("off"), Column("sticks\ns"), Column("of it in\nthe band"))  # fmt: skip
    return Table(f"logged efforts (at the {log.at}) beside the computed ones", columns, rows)


def _peak(summary: ActuatorSummary, zero: float, log: JudgedLog | None) -> str:
    """The peak effort; beside it how far it is known, where that is more than a tenth of it."""
    text = digits(summary.peak, zero)
    uncertain = 0.0 if log is None else log.peak_uncertainty.get(summary.name, 0.0)
    if uncertain <= max(_UNCERTAIN_SHARE * summary.peak, zero):
        return text
    return f"{text} ±{rough(uncertain)}"


def _motor_table(geared: Sequence[ActuatorSummary]) -> Table:
    zero = ROUNDING * max(s.motor_peak for s in geared)
    rows = [
        (s.name, digits(s.motor_peak, zero), span(s.motor_rms_least, s.motor_rms, zero))
        for s in geared
    ]
    columns = (Column("joint", Kind.NAME), Column("peak\nN m"), Column("RMS\nN m"))
    return Table("at the motors' shafts", columns, rows)


def _footer(result: InverseResult) -> list[str]:
    """What the table cannot say: how often joints rest, what is carried, what did not converge."""
    sites = len(result.site_names)
    lines = []
    if sites:
        sticks = [len(runs(result.sticking[:, s])) for s in range(sites)]
        resting = f"{np.count_nonzero(sticks)} of {counted(sites, 'joint')} with friction stick"
        resting += f", in {counted(sum(sticks), 'interval')}" if any(sticks) else ""
        reversals = counted(int(result.reversal.sum()), "reversal")
        lines.append(f"{resting}; {reversals} between samples")
    else:
        lines.append("no joint has friction")
    for name, spans in payload_phases(result).items():
        times = ", ".join(f"{digits(start)}-{digits(end)} s" for start, end in spans)
        lines.append(f"payload {name}: {f'carried {times}' if spans else 'not carried'}")
    failed = np.flatnonzero(result.status != Status.CONVERGED)
    if failed.size:
        lines.append(f"{counted(failed.size, 'sample')} without a solution, the first {failed[0]}")
    if sites:
        lines.append("share: RMS of friction / (RMS of friction + frictionless RMS)")
    return lines
