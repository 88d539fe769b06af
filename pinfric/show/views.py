"""One picture and one table for every result: `pf.plot`, `pf.summary`.

The results' own methods `plot` and `summary` come here through the package's public names.
"""

from __future__ import annotations

from dataclasses import asdict
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.closure import working_rates
from pinfric.dynamics.simulation.motion import Motion
from pinfric.errors import StateError
from pinfric.show.figure.efforts import effort_figure
from pinfric.show.figure.elastic import tool_figure
from pinfric.show.figure.measured import measured_figure
from pinfric.show.figure.motion import motion_figure
from pinfric.show.figure.retime import retime_figure
from pinfric.show.figure.sweep import sweep_figure
from pinfric.study.elastic.motion import Elasticity
from pinfric.study.export.export import Exported
from pinfric.study.identify.identify import Identified, beside_measured
from pinfric.study.retime.limits import KINDS
from pinfric.study.retime.retime import RetimeResult
from pinfric.study.sizing.size import JointSizing, SizingReport
from pinfric.study.summary import effort_unit, rms, summarize
from pinfric.study.sweep.cycle import DEMANDS
from pinfric.study.sweep.result import SweepResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@singledispatch
def plot(result: Any, **options: Any) -> Figure:
    """Return the figure that `--out` writes of a result.

    Args:
        result: of `inverse_dynamics` (options: `trajectory`, a name for the title; `drives`, the
            names of those to draw), `elasticity` (the tool's places at rest; options: `title`,
            `rest`), `simulate`, `size` (the efforts of the cycle with the chosen
            drives' masses; the same options), `sweep`, or `identify` (measured efforts over those
            of the scene found; option: `log`, its number).
        options: see there.

    Raises:
        StateError: it is none of these, or has no times.
    """
    raise _nothing("picture", result)


@singledispatch
def summary(result: Any) -> pd.DataFrame:
    """Return the figures of each drive, a row a drive; SI units, NaN for what is not known.

    Args:
        result: of `inverse_dynamics` (`peak`, `rms`, ... as `--json` names them), `simulate`
            (efforts, their work, and at its joint heat and time at rest), `size` (demand and
            choice), `retime` (largest part of each limit used), `sweep` (percentiles, `peak_95`
            and so on), `elasticity` (wind-up at the worst rest), `export` (a row a joint)
            or `identify` (a row a coefficient).

    Raises:
        StateError: it is none of these, or has no times.
    """
    raise _nothing("table", result)


def _nothing(what: str, result: Any) -> StateError:
    kinds = "inverse_dynamics, simulate, size, retime, sweep and identify"
    return StateError(f"a {type(result).__name__} has no {what}; results of {kinds} have one")


@plot.register(InverseResult)
def _(result: InverseResult, **options: Any) -> Figure:
    return effort_figure(result, **options)


@plot.register(Elasticity)
def _(result: Elasticity, **options: Any) -> Figure:
    return tool_figure(result, **options)


@plot.register(SizingReport)
def _(result: SizingReport, **options: Any) -> Figure:
    return effort_figure(result.result, **options)


@plot.register(RetimeResult)
def _(result: RetimeResult) -> Figure:
    return retime_figure(result)


@plot.register(Motion)
def _(result: Motion) -> Figure:
    return motion_figure(result)


@plot.register(SweepResult)
def _(result: SweepResult) -> Figure:
    return sweep_figure(result)


@plot.register(Identified)
def _(result: Identified, log: int = 0) -> Figure:
    return measured_figure(*beside_measured(result, log), result.recordings[log].name)


def _by_drive(rows: list[dict[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame(rows or {"name": []}).set_index("name").rename_axis("drive")


@summary.register(InverseResult)
def _(result: InverseResult) -> pd.DataFrame:
    return _by_drive([asdict(drive) for drive in summarize(result)])


@summary.register(Elasticity)
def _(result: Elasticity) -> pd.DataFrame:
    names, worst = result.result.actuator_names, result.worst
    rows: list[dict[str, Any]] = []
    for share, name in zip(result.mode.shares, result.drives, strict=True):
        d = names.index(name)
        row: dict[str, Any] = {"name": name, "strain_energy": float(share)}
        if worst is not None:
            row |= {"sag": float(worst.wind_up_sag[d]), "lower": float(worst.wind_up_lower[d]),
                    "upper": float(worst.wind_up_upper[d])}  # fmt: skip
        rows.append(row)
    return _by_drive(rows)


@summary.register(SizingReport)
def _(result: SizingReport) -> pd.DataFrame:
    return _by_drive([_sized(joint) for joint in result.joints])


def _sized(joint: JointSizing) -> dict[str, Any]:
    demand = asdict(joint.demand)
    row = {key: value for key, value in demand.items() if not isinstance(value, dict | tuple)}
    least, worst = joint.demand.holding or (None, None)
    row |= {"holding_least": least, "holding_worst": worst, "choice": None, "mass": None,
            "ratio": None, "margin": None}  # fmt: skip
    if joint.choice is not None:
        drive = joint.choice.candidate
        row |= {"choice": drive.name, "mass": drive.mass, "ratio": drive.ratio,
                "margin": joint.choice.margin}  # fmt: skip
    return row


@summary.register(Motion)
def _(result: Motion) -> pd.DataFrame:
    scene, t = result.scene, result.t
    rates, _ = working_rates(scene, result.q, result.v)
    energy = result.energy()
    heat = dict(zip(result.site_names, energy.friction_loss, strict=True))
    gears = result.motor_torque is not None
    rest: dict[str, float] = dict.fromkeys(result.site_names, 0.0)
    for interval in result.stick_intervals():
        rest[interval.site] += interval.end - interval.start
    rows = []
    for i, drive in enumerate(scene.drives):
        effort = result.effort[:, i]
        rows.append({
            "name": drive.name, "unit": effort_unit(scene, i),
            "peak": float(np.abs(effort).max()), "rms": rms(t, effort),
            "work": float(np.trapezoid(effort * rates[:, i], t)),
            "heat": float(heat.get(drive.name, np.nan)),
            "gear_heat": float(energy.gear_loss[i]) if gears else np.nan,
            "stick_time": rest.get(drive.name, np.nan),
        })  # fmt: skip
    return _by_drive(rows)


@summary.register(Exported)
def _(result: Exported) -> pd.DataFrame:
    rows = [asdict(joint) for joint in result.joints]  # none of coupled drives
    return pd.DataFrame(rows or {"joint": []}).set_index("joint")


@summary.register(RetimeResult)
def _(result: RetimeResult) -> pd.DataFrame:
    most = result.usage.max(axis=0, initial=0.0)
    rows: list[dict[str, Any]] = [
        {"name": drive.name, **dict(zip(KINDS, most[d].tolist(), strict=True)),
         "limiting": sum(result.limiting.get(drive.name, {}).values()),
         "continuous torque": np.nan if result.rms is None else float(result.rms[d])}
        for d, drive in enumerate(result.problem.scene.drives)
    ]  # fmt: skip
    return _by_drive(rows)


@summary.register(SweepResult)
def _(result: SweepResult) -> pd.DataFrame:
    rows: list[dict[str, Any]] = [
        {"name": name, "unit": unit}
        for name, unit in zip(result.actuator_names, result.units, strict=True)
    ]
    for figure in DEMANDS if result.solved.any() else ():
        for p, values in zip(result.percentiles, result.quantiles(figure), strict=True):
            for row, value in zip(rows, values, strict=True):
                row[f"{figure}_{p:g}"] = float(value)
    for trial in result.trials:
        share = result.probability(result.sufficing(trial)).value
        rows[trial.actuator]["suffices"] = share
    return _by_drive(rows)


@summary.register(Identified)
def _(result: Identified) -> pd.DataFrame:
    rows = [{"key": p.key} | asdict(p) for p in result.parameters]
    return pd.DataFrame(rows).set_index("key")
