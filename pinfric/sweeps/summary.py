"""Summary of a sweep, as `pinfric sweep` prints and writes it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinfric.model.described import EFFORT, MOTOR, SPEED, described, gathered, quantity
from pinfric.sweeps.cycle import DEMANDS
from pinfric.sweeps.result import Probability, SweepResult


@described
class VariedParameter:
    """One parameter that varies, over all samples."""

    name: str = quantity("its key", heading="parameter")
    min: float = quantity("the least", heading="least")
    mean: float = quantity("the mean", heading="mean")
    max: float = quantity("the greatest", heading="greatest")


@described
class SobolShare:
    """Share of a figure's variance that one parameter takes; 95 % bootstrap intervals."""

    first: float = quantity("share of the variance from the parameter alone (first order)")
    total: float = quantity("share of the variance with its interactions (total effect)")
    first_low: float = quantity("lower end of the interval of `first`")
    first_high: float = quantity("upper end of the interval of `first`")
    total_low: float = quantity("lower end of the interval of `total`")
    total_high: float = quantity("upper end of the interval of `total`")


@described
class Spread:
    """Spread of one figure of a drive over the samples."""

    percentiles: Mapping[str, float] = quantity(
        "percentile -> value, in the figure's unit", heading="{} %"
    )
    rank_correlation: Mapping[str, float] = quantity("parameter -> Spearman's, with the figure")
    sobol: Mapping[str, SobolShare] | None = quantity("parameter -> share; none: other designs")


@described
class DriveSpread:
    """Spread of the demand on one drive over the samples."""

    name: str = quantity("the drive's", heading="joint", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    peak: Spread = quantity("largest effort", EFFORT, "peak *")
    rms: Spread = quantity("RMS of the worst effort", EFFORT, "RMS *")
    motor_unit: str = quantity("at the motor's shaft; of an ideal drive, `unit`", heading="unit")
    motor_peak: Spread = quantity("largest torque at the motor's shaft", MOTOR, "peak *")
    motor_rms: Spread = quantity("RMS at the motor's shaft", MOTOR, "RMS *")
    speed: Spread = quantity("largest |v|", SPEED)


@described
class TriedMotor:
    """Share of samples in which one drive of the catalogue suffices."""

    drive: str = quantity("its drive", heading="joint", name=True)
    actuator: int = quantity("its index in the scene")
    name: str = quantity("in the catalogue", heading="motor")
    continuous_torque: float | None = quantity(
        "at the motor's shaft and the ambient; none: not known", "N m"
    )
    peak_torque: float | None = quantity("at the motor's shaft; none: not known", "N m")
    ratio: float = quantity("motor turns per joint turn")
    mass: float | None = quantity("none: not known", "kg")
    suffices: Probability = quantity("share of samples in which it suffices", heading="suffices")
    criteria: Mapping[str, Probability] = quantity(
        "criterion -> share of samples in which it is met", heading="fails"
    )
    not_checked: tuple[str, ...] = quantity("criteria for which a value is missing")


@described
class SweepSummary:
    """Summary of a sweep: spread of the demand, motors, influences."""

    trajectory: str = quantity("name of the motion")
    sweep: str = quantity("name of the sweep's file")
    sampling: str = quantity("random, sobol or grid")
    seed: int = quantity("seed of the samples")
    samples: int = quantity("number of cycles")
    solved: int = quantity("number of cycles with a solution")
    parameters: tuple[VariedParameter, ...] = quantity("what varies")
    joints: tuple[DriveSpread, ...] = quantity("the drives")
    correlation_noise: float = quantity("smaller rank correlations are not significant")
    motors: tuple[TriedMotor, ...] = quantity("on trial")
    all_motors_suffice: Probability | None = quantity("share of samples; none: no motor is checked")
    elastic: Mapping[str, Mapping[str, float]] = quantity(
        "result of elastic gears -> percentile -> value, Hz or m; the worst of each cycle"
    )


def sweep_summary(result: SweepResult) -> SweepSummary:
    """Return the summary of a sweep."""
    spreads = {name: _spreads(result, name) for name in DEMANDS}
    trials = result.trials
    return gathered(
        SweepSummary,
        result,
        solved=int(result.solved.sum()),
        parameters=tuple(
            VariedParameter(name, float(column.min()), float(column.mean()), float(column.max()))
            for name, column in zip(result.parameter_names, result.values.T, strict=True)
        ),
        joints=tuple(
            DriveSpread(
                name=result.actuator_names[i],
                unit=result.units[i],
                motor_unit=result.motor_units[i],
                **{figure: spreads[figure][i] for figure in DEMANDS},
            )
            for i in range(len(result.actuator_names))
        ),
        motors=tuple(
            gathered(
                TriedMotor,
                trial,
                name=trial.candidate.name,
                ratio=trial.candidate.ratio,
                mass=trial.candidate.mass,
                suffices=result.probability(result.sufficing(trial)),
                criteria={name: result.probability(met) for name, met in result.met(trial).items()},
                not_checked=result.not_checked(trial),
            )
            for trial in trials
        ),
        all_motors_suffice=result.probability(result.sufficing()) if trials else None,
        elastic={
            name: _by_percentile(result, values)
            for name, values in result.elastic_quantiles().items()
        },
    )


def _by_percentile(result: SweepResult, values: np.ndarray) -> dict[str, float]:
    return {f"{p:g}": float(x) for p, x in zip(result.percentiles, values, strict=True)}


def _spreads(result: SweepResult, figure: str) -> list[Spread]:
    quantiles = result.quantiles(figure) if result.solved.any() else None
    correlation, shares = result.rank_correlation(figure), result.sobol(figure)
    names, spreads = result.parameter_names, []
    for i in range(len(result.actuator_names)):
        sobol = None
        if shares is not None:
            columns = {key: value.tolist() for key, value in vars(shares[i]).items()}
            sobol = {
                name: SobolShare(**{key: column[j] for key, column in columns.items()})
                for j, name in enumerate(names)
            }
        percentiles = {} if quantiles is None else _by_percentile(result, quantiles[:, i])
        ranks = dict(zip(names, correlation[:, i].tolist(), strict=True))
        spreads.append(Spread(percentiles, ranks, sobol))
    return spreads
