"""Result of inverse dynamics, as tables and lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pinfric.checking.findings import Severity, errors, lines
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.outcome import Status
from pinfric.model.brief import counted
from pinfric.motions.joint_columns import stated_limit
from pinfric.motions.log.effort_place import EFFORT_PLACES
from pinfric.motions.log.judged import JudgedLog
from pinfric.motions.summary import ROUNDING, ActuatorSummary, rounding
from pinfric.show.inverse_summary import InverseSummary
from pinfric.show.report.elastic import elastic_line, elasticity_parts
from pinfric.show.report.rows import table_of, text_of
from pinfric.show.report.tables import Report, Table, paragraphs
from pinfric.show.report.values import digits, rough

#: Fields of the table of motors.
_SHAFT = ("name", "motor_unit", "motor_peak", "motor_rms", "motor_friction_share")
#: A share that prints as 0 %.
_NO_SHARE = 0.005


def inverse_report(
    result: InverseResult,
    summary: InverseSummary,
    log: JudgedLog | None = None,
    verbose: bool = True,
) -> Report:
    """Return what `pinfric inverse` prints.

    Args:
        result: with times.
        log: how the trajectory was read, if it came from samples.
        verbose: elastic gears by rest and gear; else in a line.
    """
    elastic = summary.elasticity
    bent: Sequence[Table | Sequence[str] | None] = ()
    if elastic is not None:
        whole = elasticity_parts(elastic, result.actuator_names) if verbose else ()
        bent = whole or ([elastic_line(elastic), "elastic gears at each rest, by gear: -v"],)
    geared = [
        joint
        for joint, drive in zip(summary.joints, result.scene.drives, strict=True)
        if drive.transmission is not None and joint.motor_unit != "N"  # it has a shaft
    ]
    failing = [f"! {line}" for line in (*summary.beyond_limits, *unbalanced(summary))]
    zero = ROUNDING * max((s.motor_peak for s in geared), default=0.0)
    # What the table cannot say: how often joints rest, and what is carried
    base, lines = summary.base, ["no joint has friction"]
    if sites := summary.sites:
        sticking = sum(site.stick_intervals > 0 for site in sites)
        resting = f"{sticking} of {counted(len(sites), 'joint')} with friction stick"
        if sticking:
            resting += f": {counted(sum(site.stick_intervals for site in sites), 'rest')}"
        reversals = sum(site.reversals for site in sites)
        lines = [f"{resting}; {counted(reversals, 'reversal')} between samples"]
    for name, spans in summary.payloads.items():
        times = ", ".join(f"{digits(span.start)}-{digits(span.end)} s" for span in spans)
        lines.append(f"payload {name}: {f'carried {times}' if spans else 'not carried'}")
    if standing := summary.standing:
        lines.append(
            "no forces at the feet are given: the first table is of those with the least sum of "
            "squares, the second of all within friction"
        )
    elif base is not None:
        lines.append(
            f"at the free base the forces given leave {digits(base.force)} N and "
            f"{digits(base.moment)} N m (RMS), {text_of(base.share, '%')} of the weight"
        )
    return paragraphs(
        [verdict(result, summary), *failing],
        _effort_table(result, summary),
        table_of("over all forces at the feet within friction", standing) if standing else None,
        table_of("at the motors' shafts", geared, only=_SHAFT, zero=zero),
        None
        if log is None or not log.measured
        else table_of(
            f"efforts of the whole log ({EFFORT_PLACES[log.at]}) beside computed ones",
            list(log.measured.values()),
        ),
        *bent,
        [
            *lines,
            *log_lines(log, {s.name: s.unit for s in summary.joints}),
            *(log.notes if log is not None else ()),
        ],
    )


def verdict(result: InverseResult, summary: InverseSummary) -> str:
    """Return in a line whether all samples have a solution, and efforts are within their limits."""
    failed = np.flatnonzero(result.status != Status.CONVERGED)
    solved = f"all {counted(summary.samples, 'sample')} solved"
    if failed.size:
        solved = f"{counted(failed.size, 'sample')} without a solution, the first {failed[0]}"
    limits = np.asarray(result.scene.model.effortLimit, dtype=np.float64)
    indices = [drive.velocity_index for drive in result.scene.drives]
    limited = sum(v >= 0 and math.isfinite(stated_limit(float(limits[v]))) for v in indices)
    drives = counted(len(indices), "drive")
    within = f"{len(summary.beyond_limits)} of {drives} beyond the URDF's effort limits"
    if not summary.beyond_limits:
        within = "efforts are within the URDF's limits" if limited else "the URDF limits no effort"
        within += f", which {limited} of {drives} have" * (0 < limited < len(indices))
    if len(summary.massless) == result.scene.model.nv:
        within = "nothing has mass: the efforts are friction only"
    elif summary.massless:
        moves = "moves" if len(summary.massless) == 1 else "move"
        within += f"; {', '.join(summary.massless)} {moves} no mass: friction only"
    if unbalanced(summary):
        within += "; the forces given do not balance the base"
    narrow = f"; {counted(summary.too_narrow, 'sample')} whose intervals may be too narrow"
    found = result.scene.quick_findings
    said = [*(f"not to be used: {line}" for line in errors(found))]
    said += lines(f for f in found if f.unsigned and f.severity == Severity.WARNING)
    return "; ".join([f"{solved}; {within}" + narrow * (summary.too_narrow > 0), *said])


def unbalanced(summary: InverseSummary) -> list[str]:
    """Return that the forces given do not balance a free base, beyond the condition, or nothing."""
    base = summary.base
    if base is None or base.within:
        return []
    return [
        f"the forces given do not balance the motion: they leave {digits(base.force)} N and "
        f"{digits(base.moment)} N m (RMS) at the base, {text_of(base.share, '%')} of the weight; "
        f"the condition is {text_of(base.limit, '%')}: check their sensors, frames and times, and "
        "the robot's mass"
    ]


def log_lines(log: JudgedLog | None, units: Mapping[str, str]) -> list[str]:
    """Return "filtered at 11 Hz, noise 1.0e-05 rad, peak efforts known to ±0.4 N m", or nothing.

    Args:
        log: None if the motion is not a log's.
        units: drive -> N m or N.
    """
    if log is None or not log.reading.noise_line:
        return []
    known = ""
    if log.peak_uncertainty:
        name = max(log.peak_uncertainty, key=log.peak_uncertainty.__getitem__)
        known = f", peak efforts known to ±{rough(log.peak_uncertainty[name])} {units[name]}"
    return [f"{log.reading.noise_line}{known}"]


def _effort_table(result: InverseResult, summary: InverseSummary) -> Table | None:
    file = Path(summary.trajectory).name
    title = f"{Path(result.scene.source).stem} · {file}" if file else result.scene.source
    title += f": {counted(summary.samples, 'sample')}, {digits(summary.end - summary.start)} s"
    zero = rounding(result)
    known = {} if summary.input is None else summary.input.peak_uncertainty

    def peak(drive: ActuatorSummary) -> str:
        """The peak effort, with its uncertainty if this is more than a tenth of it."""
        uncertain = known.get(drive.name, 0.0)
        doubt = f" ±{rough(uncertain)}" if uncertain > max(0.1 * drive.peak, zero) else ""
        return f"{digits(drive.peak, zero)}{doubt}"

    def share(drive: ActuatorSummary) -> str:
        """The share of friction; of a loss before the joint, where it sits."""
        if drive.friction_share < _NO_SHARE <= drive.motor_friction_share:
            return "at motor"
        return text_of(drive.friction_share, "%")

    cells = {"peak": peak, "friction_share": share}
    return table_of(title, summary.joints, without=_SHAFT[1:], cells=cells, zero=zero)
