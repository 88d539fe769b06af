"""The sizing page: one self-contained HTML file, plotly inlined once, no network."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from pinfric import __version__
from pinfric.errors import PinfricError
from pinfric.show.figure.panel import svg
from pinfric.show.report.drives import brake_table, bus_lines, shortfall, turn
from pinfric.show.report.html import html_of
from pinfric.show.report.sizing import (
    ROUNDING,
    demand_table,
    elastic_lines,
    passes,
    power_table,
    repetition,
    tightest,
)
from pinfric.show.report.tables import Table
from pinfric.show.report.values import digits, json_for_script
from pinfric.show.sizing_page.figures import (
    effort_over_time,
    mass_against_margin,
    power_over_time,
    temperature,
    torque_speed,
)
from pinfric.study.sizing.assess import Assessment
from pinfric.study.sizing.criterion import Criterion, Status
from pinfric.study.sizing.size import JointSizing, SizingReport
from pinfric.study.sizing.summary import ratio_figures

#: What stands where there is no figure.
_NONE = "\N{EN DASH}"
#: Rejected candidates are listed nearest first; beyond this many only counted.
_MOST_REJECTED = 100
#: Margins below are of something infinite, or of a limit of nothing.
_BEYOND = -1e6


def sizing_page(report: SizingReport) -> str:
    """Return the report as one HTML page.

    Args:
        report: of `size`.

    Raises:
        PinfricError: the extra `report` (jinja2, plotly) is not installed.
    """
    environment, plotly = page_parts(), _needed("plotly.offline").get_plotlyjs()
    environment.filters.update(formula=_formula)
    figures: dict[str, Any] = {}
    joints = [_joint_view(joint, report, figures, k) for k, joint in enumerate(report.joints)]
    title = "Power from the bus"
    bus_picture = "" if report.catalog is None else svg(power_over_time(report), title)
    t = report.result.t
    assert t is not None  # size refuses a motion without times
    page: str = environment.get_template("sizing.html.j2").render(
        report=report,
        scene=Path(report.given.source).stem,
        trajectory=Path(report.trajectory).name,
        cycle=report.period,
        samples=len(t),
        joints=joints,
        matrix=_matrix(report),
        bus=bus_lines(report),
        bus_picture=bus_picture,
        turn=turn(report),
        elastic=elastic_lines(report),
        demand=demand_table(report),
        power=power_table(report),
        brakes=brake_table(report),
        passes=passes(report),
        repetition=repetition(report),
        sources=_sources(report),
        plotly=plotly,
        figures=json_for_script(figures),
        version=__version__,
        Status=Status,
    )
    return page


def _needed(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError:
        raise PinfricError(
            f"a page needs {module.partition('.')[0]}: pip install 'pinfric[report]'"
        ) from None


def _joint_view(
    joint: JointSizing, report: SizingReport, figures: dict[str, Any], k: int
) -> dict[str, Any]:
    """What the template shows of one joint; its map of candidates is added to `figures`."""
    taken, d = joint.installed, joint.demand
    drawn = [("effort", "Effort at the joint over the cycle", effort_over_time(joint))]
    missing = []
    if joint.motor is not None:
        title = "The cycle in the motor's envelope"
        drawn.insert(0, ("envelope", title, torque_speed(joint, report)))
        warm = temperature(joint, report)
        if warm is not None:
            drawn.append(("heat", "Winding temperature, settled cycle", warm))
        elif taken is not None:
            heat = next(c for c in taken.criteria if c.name == "winding temperature")
            missing.append(("Winding temperature", f"{heat.status}: {heat.note}"))
    pictures = [
        (f"{kind}-{k}", title, svg(figure, f"{title} of {d.name}")) for kind, title, figure in drawn
    ]
    if joint.assessments:
        figures[f"trade-{k}"] = mass_against_margin(joint)
        pictures.append((f"trade-{k}", "Candidates: mass against margin", ""))
    fitting = [a for a in joint.assessments if a.fits and a is not joint.choice]
    rejected = [a for a in joint.assessments if not a.fits]
    return {
        "sizing": joint,
        "demand": d,
        "installed": taken,
        "figures": pictures,
        "missing": missing,
        "criteria": _criteria(report, k),
        "smaller": joint.next_smaller,
        "shortfall": "" if joint.next_smaller is None else shortfall(joint.next_smaller),
        "tightest": None if taken is None else tightest(taken),
        "fitting": fitting,
        "rejected": rejected[:_MOST_REJECTED],
        "more_rejected": max(len(rejected) - _MOST_REJECTED, 0),
        "without_masses": _name(joint.choice_without_masses),
        "frictionless": _name(joint.choice_frictionless),
        "ratios": None if taken is None else ratio_figures(joint, taken),
    }


def _matrix(report: SizingReport) -> list[tuple[str, list[Criterion | None]]]:
    """(criterion, one entry per joint): the margins of all drives at a glance."""
    columns = [{c.name: c for c in _criteria(report, k)} for k in range(len(report.joints))]
    names = dict.fromkeys(name for column in columns for name in column)
    last = ("inertia", "gear res", "back", "holding", "brake")
    order = sorted(names, key=lambda name: name.startswith(last))
    return [(name, [column.get(name) for column in columns]) for name in order]


def _criteria(report: SizingReport, k: int) -> tuple[Criterion, ...]:
    """All criteria of the drive taken for one joint, and of what holds it without power."""
    taken = report.joints[k].installed
    return () if taken is None else (*taken.criteria, *report.standstills[k].criteria)


def _sources(report: SizingReport) -> list[str]:
    lines = (
        line
        for joint in report.joints
        if joint.installed is not None
        for line in joint.installed.candidate.sources
    )
    return list(dict.fromkeys(lines))


def page_parts(*folders: Path) -> Any:
    """Return jinja2's environment for a page.

    Args:
        folders: of templates, beside this one with the style.

    Raises:
        PinfricError: the extra `report` (jinja2, plotly) is not installed.
    """
    jinja2 = _needed("jinja2")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, Path(__file__).parent]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(digits=_digits, percent=_percent, table=_table)
    return environment


def _table(table: Table | None) -> Any:
    return "" if table is None else import_module("markupsafe").Markup(html_of(table))


def _digits(x: float | None) -> str:
    if x is None:
        return _NONE
    if np.isinf(x):
        return "\N{INFINITY}"
    return digits(x) if abs(x) > ROUNDING else "0"


def _percent(x: float | None) -> str:
    if x is None:
        return _NONE
    if x <= _BEYOND:
        return "beyond any limit"
    if x <= -10:
        return f"{1 - x:.3g} times the limit"
    near = abs(x) < 0.005 or abs(x - 0.1) < 0.005  # of failing, of what is called tight
    return f"{100 * x:.{1 if near and x else 0}f} %".replace("-", "\N{MINUS SIGN}")


def _formula(text: str) -> Any:
    """A formula in plain letters as HTML: Greek letters, roots, integrals, subscripts, powers."""
    markup = import_module("markupsafe")
    html = str(markup.escape(text)).replace("&lt;=", "≤").replace("&gt;", ">")
    for pattern, sign in (
        (r"\bint ", "∫ "),
        (r"\bsqrt", "√"),
        (r"\bcbrt", "∛"),
        (r"\bomega", "ω"),
        (r"\beta", "η"),
        (r"\bpi\b", "π"),
        (r"\^2", "²"),
        (r"\^3", "³"),
    ):
        html = re.sub(pattern, sign, html)
    return markup.Markup(re.sub(r"(?<=\w)_([A-Za-z0-9,\-]*[A-Za-z0-9])", r"<sub>\1</sub>", html))


def _name(assessment: Assessment | None) -> str:
    return "none" if assessment is None else assessment.candidate.name
