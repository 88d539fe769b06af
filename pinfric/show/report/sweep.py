"""Result of a sweep, as tables."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Column, ColumnKind, Report, Table, paragraphs
from pinfric.show.report.values import digits
from pinfric.sweeps.result import Probability, SweepResult
from pinfric.sweeps.summary import SweepSummary, TriedMotor

#: So small a share of the samples is rounding.
_NONE = 1e-9
#: Parameters named per drive and figure, and what stands where there is none.
_NAMED, _NOTHING = 2, "nothing found"
_AT_JOINT = ("peak", "rms")
_DESIGNS = {
    "random": "random samples",
    "sobol": "samples of a Sobol design",
    "grid": "points of a grid",
}


def sweep_report(result: SweepResult, summary: SweepSummary) -> Report:
    """Return what `pinfric sweep` prints."""
    title = f"{Path(result.scene).stem} · {Path(result.trajectory).name}: "
    title += f"{result.samples} {_DESIGNS[result.sampling]}"
    tables: list[Table | None] = []
    if result.solved.any():
        where = shaft(result)
        for names in dict.fromkeys((_AT_JOINT, result.rated)):
            at = " at the joints" if names == _AT_JOINT else where
            keys = ["name", "unit" if names == _AT_JOINT else "motor_unit"]
            figures = [f"{name}.percentiles[{p:g}]" for name in names for p in result.percentiles]
            tables.append(table_of(at[1:], summary.joints, only=[*keys, *figures]))
        tables.append(_driver_table(result, where))
    if elastic := result.elastic_quantiles():
        rows = []
        for name, values in elastic.items():
            scale, unit = (1.0, "Hz") if name == "lowest_frequency" else (1e3, "mm")
            rows.append((name.replace("_", " "), unit, *(digits(scale * x) for x in values)))
        columns = [Column("figure", ColumnKind.LABEL), Column("unit", ColumnKind.LABEL)]
        columns += [Column(f"{p:g} %") for p in result.percentiles]
        tables.append(Table("elastic gears: the worst of each cycle", columns, rows, keys=2))
    if summary.motors:
        cells: dict[str, Callable[[Any], str]] = {
            "suffices": lambda motor: percent(motor.suffices, interval=True),
            "criteria": partial(_failures, unsolved=float(np.mean(~result.solved))),
        }
        title_of_trials = "motors: share of samples in which they suffice, and what fails"
        tables.append(table_of(title_of_trials, summary.motors, cells=cells))
    lines = []
    if result.trials:
        tried, drives = len(result.trials), len(result.actuator_names)
        sufficing = f"all motors on trial ({tried} of {drives} drives) suffice"
        if tried == drives:
            sufficing = "all motors suffice"
        elif tried == 1:
            sufficing = f"the motor on trial (1 of {drives} drives) suffices"
        share = percent(result.probability(result.sufficing()), interval=True)
        lines.append(f"{sufficing} in {share} of the samples")
        if result.sampling == "random":
            lines.append("in brackets: 95 % confidence interval, for the number of samples only")
        for trial in result.trials:
            if missing := result.not_checked(trial):
                lines.append(f"{trial.drive}: {', '.join(missing)} not checked: no figure")
        masses = ", ".join(
            f"{t.drive} {'not known' if (m := t.candidate.mass) is None else f'{digits(m)} kg'}"
            for t in result.trials
        )
        lines.append(
            f"criteria of `pinfric size`; drive masses added to the parent links: {masses} (other "
            "joints: as in the scene; conditions.mass_in_urdf: masses that the links already "
            "include)"
        )
    if not result.solved.all():
        lines.append(
            f"{np.count_nonzero(~result.solved)} samples have no solution: not in the percentiles, "
            "counted as samples in which no motor suffices"
        )
    lines.append("peak, RMS: worst end of the effort interval; percentiles over the samples")
    if not result.has_shares:
        lines.append(
            f"correlations below {digits(result.correlation_noise)} are not significant; "
            "non-monotonic effects are missed (use sampling: sobol)"
        )
    return paragraphs(title, *tables, lines)


def _driver_table(result: SweepResult, where: str) -> Table:
    signed = not result.has_shares
    columns = [Column("joint", ColumnKind.NAME)]
    rows = [[drive] for drive in result.actuator_names]
    names = [brief(parameter) for parameter in result.parameter_names]
    for title, figure in zip(("peak", "RMS"), result.rated, strict=True):
        columns += [Column(title, ColumnKind.NAME, names), Column("")]
        for row, influence in zip(rows, result.influences(figure).T, strict=True):
            most = result.strongest(influence, _NAMED)
            row.append("\n".join(own(result.parameter_names[j], row[0]) for j in most) or _NOTHING)
            row.append("\n".join(f"{influence[j]:{'+' if signed else ''}.2f}" for j in most))
    return Table(f"most influential parameters{where}: {measure(result)}", columns, rows)


def shaft(result: SweepResult) -> str:
    """Return where motors are rated: at their shafts, of ideal drives at the joints."""
    return " at the joints" if result.rated == _AT_JOINT else " at the motors' shafts"


def measure(result: SweepResult) -> str:
    """Return the name of the measure of influence."""
    shares = "share of the variance, with interactions"
    return shares if result.has_shares else "rank correlation"


def own(parameter: str, drive: str) -> str:
    """Return a parameter's brief name, of the drive's own joint "its coulomb"."""
    name = brief(parameter)
    return f"its {name.removeprefix(f'{drive}.')}" if name.startswith(f"{drive}.") else name


def brief(parameter: str) -> str:
    """Return a parameter's name without its section: panda_joint5.coulomb."""
    return parameter.split(".", 1)[-1]


def _failures(motor: TriedMotor, unsolved: float) -> str:
    """The criteria that fail in any sample, and how often, the most frequent first.

    Args:
        unsolved: share of samples without a solution, stated apart.
    """
    missed = {name: 1.0 - met.value - unsolved for name, met in motor.criteria.items()}
    shares = {name: share for name, share in missed.items() if share > _NONE}
    order = sorted(shares, key=lambda name: -shares[name])
    return "\n".join(f"{name} {100 * shares[name]:.1f} %" for name in order) or "nothing"


def percent(probability: Probability, interval: bool = False) -> str:
    """Return a share as text, with its confidence interval if asked for and known."""
    text = f"{100 * probability.value:.1f} %"
    if interval and probability.low is not None and probability.high is not None:
        text += f" ({100 * probability.low:.1f}–{100 * probability.high:.1f})"  # noqa: RUF001
    return text
