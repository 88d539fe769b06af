"""One picture and one table for every result: `pf.plot`, `pf.summary`.

Results' own methods `plot` and `summary` call them through the package's public names.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import pandas as pd

from pinfric.accuracy.explain import Explanation
from pinfric.accuracy.study import Accuracy
from pinfric.checking.findings import CheckReport
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.simulation.motion import Motion
from pinfric.elastic.motion import Elasticity
from pinfric.elastic.summary import elastic_summary
from pinfric.errors import StateError
from pinfric.exporting.export import Exported
from pinfric.identification.identify import Identified
from pinfric.model.described import quantities
from pinfric.motions.summary import summarize
from pinfric.retiming.retime import RetimeResult
from pinfric.retiming.summary import retime_summary
from pinfric.show.figure.registry import figure_of
from pinfric.show.motion_summary import drive_work
from pinfric.show.report.html import html_of
from pinfric.show.report.rows import flat, table_of
from pinfric.sizing.report import SizingReport
from pinfric.stops.study import StopResult
from pinfric.sweeps.cycle import DEMANDS
from pinfric.sweeps.result import SweepResult
from pinfric.sweeps.summary import DriveSpread

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot(result: Any, figure: str = "", **options: Any) -> Figure:
    """Return a figure of a result: the one that `--out` writes, or one of its page.

    Args:
        result: of `inverse_dynamics` (options: `trajectory`, a name for the title; `joints`, names
            of those to draw; `ax`, axes of your own, one each), `elasticity` (the tool's places at
            rest; options: `title`, `rest`), `simulate`, `size` (efforts of the cycle with the
            chosen drives' masses; options as of `inverse_dynamics`), `retime`, `stop`, `sweep`,
            `identify` (measured efforts over those of the scene found; option: `log`, its number)
            or `accuracy`.
        figure: its name; empty: the first. `size` has "bus", too. These draw one drive, whose
            number `drive` is: "envelope", "effort", "heat" of `size`, "speed", "effort" of `stop`,
            "time", "velocity", "load" of `identify`.
        options: see there.

    Raises:
        StateError: it is none of these, or has no times; there is no such figure.
    """
    chosen = figure_of(result, figure)
    if chosen.one and not isinstance(options.get("drive"), int):
        raise StateError(f"figure: {figure!r} draws one drive: give its number, as drive=0")
    drawing = chosen.draw(result, **options)
    if drawing is None:
        raise StateError(f"figure: this {type(result).__name__} lacks what {figure!r} shows")
    if "ax" not in options:  # a notebook shows it, of which pyplot knows nothing
        drawing._repr_png_ = partial(_png, drawing)
    return drawing


def summary(result: Any) -> pd.DataFrame:
    """Return the figures of each drive, a row each; SI units, NaN for unknown ones.

    `attrs["units"]` of the table has the unit of each column.

    Args:
        result: of `inverse_dynamics` (`peak`, `rms`, ... as `--json` names them), `simulate`
            (efforts, their work, heat and time at rest of its joint), `size` (demand and choice),
            `retime` (largest part of each limit used), `stop`, `sweep` (percentiles: `peak_95`
            ...), `elasticity` (wind-up at the worst rest), `export` (a row per joint), `check` (per
            finding), `explain` (per effect), `accuracy` (per run) or `identify` (per coefficient).

    Raises:
        StateError: it is none of these, or has no times.
    """
    table: pd.DataFrame = _of(_TABLES, result, "table")(result)
    return table


def _of(known: Mapping[type, Callable[..., Any]], result: Any, what: str) -> Callable[..., Any]:
    for kind, function in known.items():
        if isinstance(result, kind):
            return function
    kinds = ", ".join(kind.__name__ for kind in known)
    raise StateError(f"a {type(result).__name__} has no {what}; these have one: {kinds}")


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


def _frame(rows: Sequence[Any], index: str, label: str = "") -> pd.DataFrame:
    """Return a table of described rows, with the units of its columns."""
    table = pd.DataFrame([flat(row) for row in rows] or {index: []}).set_index(index)
    known = quantities(type(rows[0])) if rows else {}
    table.attrs["units"] = {name: field.unit for name, field in known.items() if field.unit}
    shown = table_of("", rows) if rows else None
    table.attrs["html"] = "" if shown is None else html_of(shown)
    return table.rename_axis(label or index)


def _elastic(result: Elasticity) -> pd.DataFrame:
    summary = elastic_summary(result)
    shares = summary.lowest_frequency.strain_energy
    rows = {} if summary.worst is None else summary.rests[summary.worst].wind_up
    table = _frame(list(rows.values()), "name", "drive")
    table = table.reindex(list(summary.drives)).rename_axis("drive")
    return table.assign(strain_energy=pd.Series(shares))


def _sizing(result: SizingReport) -> pd.DataFrame:
    table = _frame([joint.demand for joint in result.joints], "name", "drive")
    chosen = [joint.choice for joint in result.joints]
    candidates = [getattr(choice, "candidate", None) for choice in chosen]
    for column, name in (("choice", "name"), ("mass", "mass"), ("ratio", "ratio")):
        table[column] = [getattr(candidate, name, None) for candidate in candidates]
    verdicts = result.verdict.joints or [None] * len(chosen)
    table["margin"] = [getattr(verdict, "margin", None) for verdict in verdicts]
    table["nearest_miss"] = [joint.no_fit or None for joint in result.joints]
    table.attrs["units"] |= {"mass": "kg", "ratio": "1 or rad/m", "margin": "1"}
    return table


def _retimed(result: RetimeResult) -> pd.DataFrame:
    rows = [
        {
            "drive": drive.name,
            **drive.use,
            "limiting": sum(drive.limiting.values()),
            "continuous torque": float("nan") if drive.rms is None else drive.rms,
        }
        for drive in retime_summary(result).drives
    ]
    table = pd.DataFrame(rows).set_index("drive")
    table.attrs["units"] = dict.fromkeys(table.columns, "1")
    return table


def _swept(result: SweepResult) -> pd.DataFrame:
    columns: dict[str, Any] = {"drive": result.actuator_names, "unit": result.units}
    for figure in DEMANDS if result.solved.any() else ():
        for p, values in zip(result.percentiles, result.quantiles(figure), strict=True):
            columns[f"{figure}_{p:g}"] = values
    table = pd.DataFrame(columns).set_index("drive")
    for trial in result.trials:
        share = result.probability(result.sufficing(trial)).value
        table.loc[result.actuator_names[trial.actuator], "suffices"] = share
    known = quantities(DriveSpread)
    figures = {column: column.rpartition("_")[0] for column in table.columns}
    table.attrs["units"] = {c: known[f].unit for c, f in figures.items() if f in known}
    return table


def _identified(result: Identified) -> pd.DataFrame:
    table = _frame(result.parameters, "name")
    table.insert(0, "key", [parameter.key for parameter in result.parameters])
    return table.reset_index().set_index("key")


_TABLES: dict[type, Callable[[Any], pd.DataFrame]] = {
    InverseResult: lambda result: _frame(summarize(result), "name", "drive"),
    Elasticity: _elastic,
    SizingReport: _sizing,
    Motion: lambda motion: _frame(drive_work(motion), "name", "drive"),
    Exported: lambda exported: _frame(exported.joints, "joint"),  # none of coupled drives
    CheckReport: lambda report: _frame(report.findings, "place"),
    Explanation: lambda explanation: _frame(explanation.effects, "name", "effect"),
    Accuracy: lambda accuracy: _frame(accuracy.runs, "method"),
    RetimeResult: _retimed,
    StopResult: lambda result: _frame(result.axes, "name", "drive"),
    SweepResult: _swept,
    Identified: _identified,
}
