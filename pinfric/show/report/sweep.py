"""What a sweep says, as tables for people."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Column, Kind, Report, Table, paragraphs
from pinfric.show.report.values import digits
from pinfric.study.sweep.result import Probability, SweepResult
from pinfric.study.sweep.summary import MotorOnTrial, SweepSummary

#: So small a share of the samples is rounding.
_NONE = 1e-9
#: Parameters named per drive and figure, and the least share of the variance that is.
_NAMED, _LEAST_SHARE = 2, 0.01
_AT_JOINT, _AT_MOTOR = ("peak", "rms"), ("motor_peak", "motor_rms")
_HEADINGS = {"peak": "peak", "rms": "RMS", "motor_peak": "peak", "motor_rms": "RMS"}
_DESIGNS = {
    "random": "random samples",
    "sobol": "samples of a Sobol design",
    "grid": "points of a grid",
}


def sweep_report(result: SweepResult, found: SweepSummary) -> Report:
    """Return the tables and lines that `pinfric sweep` prints, for a rich console.

    Args:
        result: of `sweep`.
        found: its summary.
    """
    title = f"{Path(result.scene).stem} · {Path(result.trajectory).name}: "
    title += f"{result.samples} {_DESIGNS[result.sampling]}"
    tables: list[Table | None] = []
    if result.solved.any():
        tables = [_percentile_table(result, _AT_JOINT, result.units, "at the joints")]
        names, where = shaft_figures(result)
        if names == _AT_MOTOR:
            tables.append(_percentile_table(result, names, shaft_units(result), where[1:]))
        tables.append(_driver_table(result, names, where))
    if elastic := result.elastic_quantiles():
        tables.append(_elastic_table(result, elastic))
    if found.motors:
        cells: dict[str, Callable[[Any], str]] = {
            "name": lambda motor: motor.name or "as given",
            "suffices": lambda motor: percent(motor.suffices, interval=True),
            "criteria": partial(_failures, unsolved=float(np.mean(~result.solved))),
        }
        title_of_trials = "motors on trial: in how many samples they suffice, and what fails"
        tables.append(table_of(title_of_trials, found.motors, cells=cells))
    return paragraphs(title, *tables, _footer(result))


def _elastic_table(result: SweepResult, found: dict[str, np.ndarray]) -> Table:
    rows = []
    for name, values in found.items():
        scale, unit = (1.0, "Hz") if name == "lowest_frequency" else (1e3, "mm")
        shown = (digits(scale * x) for x in values)
        rows.append((name.replace("_", " "), unit, *shown))
    columns = [Column("figure", Kind.LABEL), Column("unit", Kind.LABEL)]
    columns += [Column(f"{p:g} %") for p in result.percentiles]
    return Table("elastic gears: the worst of each cycle", columns, rows, keys=2)


def _percentile_table(
    result: SweepResult, names: Sequence[str], units: Sequence[str], title: str
) -> Table:
    unit = units[0] if len(set(units)) == 1 else ""
    key = [Column("joint", Kind.NAME)] + ([] if unit else [Column("unit", Kind.LABEL)])
    figures = [Column(f"{_HEADINGS[name]}\n{p:g} %") for name in names for p in result.percentiles]
    quantiles = np.concatenate([result.quantiles(name) for name in names])
    rows = [
        (drive, *([] if unit else [units[i]]), *(digits(x) for x in quantiles[:, i]))
        for i, drive in enumerate(result.actuator_names)
    ]
    title = f"{title}, {unit}" if unit else title
    return Table(title, [*key, *figures], rows, keys=len(key))


def _driver_table(result: SweepResult, names: Sequence[str], where: str) -> Table:
    """Which parameters decide a drive's peak and RMS."""
    measure, _ = strengths(result, names[0])
    columns = [Column("joint", Kind.NAME)]
    rows = [[drive] for drive in result.actuator_names]
    for name in names:
        parameters = [brief(parameter) for parameter in result.parameter_names]
        columns += [Column(_HEADINGS[name], Kind.NAME, parameters), Column("")]
        strength = strengths(result, name)[1]
        for i, row in enumerate(rows):
            row += _strongest(result, row[0], strength[:, i])
    return Table(f"what drives it{where}: {measure}", columns, rows)


def shaft_figures(result: SweepResult) -> tuple[tuple[str, str], str]:
    """Return the names of peak and RMS at the motors' shafts (of ideal drives: at the joints)."""
    at_joint, at_motor = result.figure("peak"), result.figure("motor_peak")
    if (at_joint != at_motor)[result.solved].any():
        return _AT_MOTOR, " at the motors' shafts"
    return _AT_JOINT, " at the joints"


def shaft_units(result: SweepResult) -> tuple[str, ...]:
    """Return (na,) units of these figures: N m behind a gear."""
    motor = result.figure("motor_peak")
    geared = (result.figure("peak") != motor)[result.solved].any(axis=0)
    return tuple("N m" if g else u for g, u in zip(geared, result.units, strict=True))


def strengths(result: SweepResult, name: str) -> tuple[str, np.ndarray]:
    """Return how each parameter moves a figure, (np, na), and what that is called."""
    shares = result.sobol(name) if result.has_shares else None
    if shares is None:
        return "rank correlation", result.rank_correlation(name)
    total = np.column_stack([drive.total for drive in shares])
    return "share of the variance, interactions included", total


def _strongest(result: SweepResult, drive: str, strength: np.ndarray) -> tuple[str, str]:
    """The parameters that matter most, and how much; those within the noise are left out."""
    signed = not result.has_shares
    least = result.correlation_noise if signed else _LEAST_SHARE
    order = np.argsort(-np.nan_to_num(np.abs(strength), nan=-1.0), kind="stable")
    found = [j for j in order[:_NAMED] if abs(strength[j]) > least]
    if not found:
        return "nothing found", ""
    names = [own(result.parameter_names[j], drive) for j in found]
    return "\n".join(names), "\n".join(f"{strength[j]:{'+' if signed else ''}.2f}" for j in found)


def own(parameter: str, drive: str) -> str:
    """Return a parameter's brief name, of the drive's own joint "its coulomb"."""
    name = brief(parameter)
    return f"its {name.removeprefix(f'{drive}.')}" if name.startswith(f"{drive}.") else name


def brief(parameter: str) -> str:
    """Return a parameter's name without its section, which the key tells: panda_joint5.coulomb."""
    return parameter.split(".", 1)[-1]


def _failures(motor: MotorOnTrial, unsolved: float) -> str:
    """The criteria that fail in any sample, and in how many, the most frequent first.

    Args:
        motor: on trial.
        unsolved: share of samples without a solution, which meet none and are said apart.
    """
    missed = {name: 1.0 - met.value - unsolved for name, met in motor.criteria.items()}
    shares = {name: share for name, share in missed.items() if share > _NONE}
    order = sorted(shares, key=lambda name: -shares[name])
    return "\n".join(f"{name} {100 * shares[name]:.1f} %" for name in order) or "nothing"


def percent(probability: Probability, interval: bool = False) -> str:
    """Return a share as text, with its confidence interval where asked for and known."""
    text = f"{100 * probability.value:.1f} %"
    if interval and probability.low is not None and probability.high is not None:
        text += f" ({100 * probability.low:.1f}–{100 * probability.high:.1f})"  # noqa: RUF001
    return text


def _footer(result: SweepResult) -> list[str]:
    lines = []
    if result.trials:
        every = percent(result.probability(result.sufficing()), interval=True)
        lines.append(f"all motors suffice in {every} of the samples")
        if result.sampling == "random":
            lines.append("in brackets: 95 % confidence, of the number of samples alone")
    lines += _trial_notes(result)
    if not result.solved.all():
        lines.append(
            f"{np.count_nonzero(~result.solved)} samples have no solution: left out of "
            "percentiles, no motor suffices in them"
        )
    lines.append("peak, RMS: of the worst end of the effort's interval; percentiles over samples")
    if not result.has_shares:
        lines.append(
            f"correlations below {digits(result.correlation_noise)} are not told from chance, and "
            "a minimum in mid-range is not seen (sampling: sobol sees it)"
        )
    return lines


def _trial_notes(result: SweepResult) -> list[str]:
    """What was not checked, and what was put into the model."""
    lines = []
    for trial in result.trials:
        if missing := trial.not_checked(result.figures):
            lines.append(f"{trial.drive}: {', '.join(missing)} not checked: no figure")
    bare = [trial.drive for trial in result.trials if not trial.checks]
    if bare:
        factor = result.trials[0].peak_factor
        lines.append(
            f"{', '.join(bare)}: ratings alone, the peak times {factor:g}; gear, life, voltage and "
            "winding temperature are not looked at (`drive:` does)"
        )
    judged = [trial for trial in result.trials if trial.checks]
    if judged:
        masses = ", ".join(
            f"{t.drive} " + ("not known" if t.mass is None else f"{digits(t.mass)} kg")
            for t in judged
        )
        lines.append(
            f"criteria of `pinfric size`; masses of drives, on their joints' parent links: {masses}"
            " (those of the other joints are as in the scene; conditions.mass_in_urdf says what "
            "the links have already)"
        )
    return lines
