"""The identification page: one self-contained HTML file, no network."""

from __future__ import annotations

from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from pinfric.identification.identify import Identified
from pinfric.identification.parameters import Parameter
from pinfric.identification.summary import (
    Considered,
    IdentifySummary,
    MoreKnown,
    considered,
    identify_summary,
    log_noise,
    more_known,
    predicted,
)
from pinfric.show.figure.panel import svg
from pinfric.show.identification_page.figures import over_time, residual_clouds
from pinfric.show.report.html import Marked, mark
from pinfric.show.report.page import page_environment
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Table
from pinfric.show.report.values import digits

#: Coefficients whose standard errors are listed for each advised recording.
_WORST = 12


def identification_page(found: Identified) -> str:
    """Return the friction identified from logs as one HTML page.

    Args:
        found: of `identify`.

    Raises:
        PinfricError: the extra `report` (jinja2) is not installed.
    """
    environment = page_environment(found.scene.joint_names, Path(__file__).parent)
    summary = identify_summary(found)
    time = over_time(found)
    joints: list[dict[str, Any]] = []
    for j, name in enumerate(found.scene.joint_names):
        if name not in found.errors:
            continue
        pictures = {"time": svg(time[j], f"Efforts of {name} over time")} | {
            kind: svg(cloud, f"Residual of {name} over {kind}")
            for kind, cloud in residual_clouds(found, j).items()
        }
        joints.append(_joint_view(found, j, name) | pictures)
    page: str = environment.get_template("identification.html.j2").render(
        found=found,
        laws=table_of("", summary.joints),
        coefficients=_coefficients(summary),
        unseen=table_of("", predicted(summary)),
        published=table_of("", summary.published, keys=2),
        delay=found.estimate.delay,
        scene=Path(found.scene.source).stem,
        logs=summary.logs,
        read=table_of("", summary.logs),
        noise=table_of("", log_noise(found), keys=2),
        duration=sum(one.duration for one in summary.logs),
        determined=sum(p.determined for p in found.parameters),
        joints=joints,
        more=_more(found),
    )
    return page


def _coefficients(summary: IdentifySummary) -> Table | None:
    def said(p: Parameter) -> Marked:
        known = mark("ok", "determined") if p.determined else mark("bad", "not determined")
        return Marked(f"{known} {escape(p.why)}")

    shown = ("section", "joint", "name", "unit", "value", "low", "high", "determined")
    return table_of("", summary.parameters, only=shown, cells={"determined": said})


def _more(found: Identified) -> Table | None:
    """What further recordings would tell of what is known worst, marked by how much."""
    rows = more_known(found, _WORST)

    def told(recording: str, row: MoreKnown) -> Marked:
        factor = row.factors[recording]
        kind = "ok" if factor <= 0.6 else "tight" if factor <= 0.8 else "none"
        return mark(kind, digits(factor))

    cells = {f"factors[{one.name}]": partial(told, one.name) for one in found.advice}
    return table_of("", rows, cells=cells)


def _joint_view(found: Identified, joint: int, name: str) -> dict[str, Any]:
    """What the template shows of one joint."""
    taken, laws = found.law_of(name), considered(found, joint)

    def said(row: Considered) -> Marked:
        return Marked(f"<b>{escape(row.law)}</b>" if row.law == taken else escape(row.law))

    return {
        "name": name,
        "law": taken,
        "laws": table_of("", laws, cells={"law": said}),
        "considered": len(laws),
    }
