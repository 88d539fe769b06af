"""The identification page."""

from __future__ import annotations

from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from pinfric.identification.identify import Identified
from pinfric.identification.parameters import Parameter
from pinfric.identification.summary import (
    Considered,
    MoreKnown,
    considered,
    identify_summary,
    log_noise,
    more_known,
    predicted,
)
from pinfric.show.pages.page import drawn, page
from pinfric.show.report.html import Marked, mark
from pinfric.show.report.identify import verdict
from pinfric.show.report.rows import table_of
from pinfric.show.report.values import digits

#: Coefficients whose standard errors are listed for each advised recording.
_WORST = 12
_SHOWN = ("section", "joint", "name", "unit", "value", "low", "high", "determined")


def identification_page(identified: Identified) -> str:
    """Return the friction identified from logs as one HTML page.

    Raises:
        PinfricError: see `page`.
    """
    summary = identify_summary(identified)
    joints: list[dict[str, Any]] = []
    for j, name in enumerate(identified.scene.joint_names):
        if name not in identified.errors:
            continue
        law, laws = identified.law_of(name), considered(identified, j)
        shown = table_of("", laws, cells={"law": partial(_law, law)})
        about = {"name": name, "law": law, "laws": shown, "considered": len(laws)}
        joints.append(about | {"pictures": drawn(identified, j, name)})
    more = {f"factors[{entry.name}]": partial(_told, entry.name) for entry in identified.advice}
    return page(
        "identification",
        identified.scene.joint_names,
        [joint["name"] for joint in joints],
        views=joints,
        identified=identified,
        verdict=verdict(summary),
        doubts=summary.doubts,
        notes=summary.notes[len(summary.doubts) :],
        laws=table_of("", summary.joints),
        coefficients=table_of("", summary.parameters, only=_SHOWN, cells={"determined": _said}),
        unseen=table_of("", predicted(summary)),
        delay=identified.estimate.delay,
        scene=Path(identified.scene.source).stem,
        logs=summary.logs,
        read=table_of("", summary.logs),
        noise=table_of("", log_noise(identified), keys=2),
        duration=sum(entry.duration for entry in summary.logs),
        determined=sum(p.determined for p in identified.parameters),
        more=table_of("", more_known(identified, _WORST), cells=more),
    )


def _said(p: Parameter) -> Marked:
    known = mark("ok", "determined") if p.determined else mark("bad", "not determined")
    return Marked(f"{known} {escape(p.why)}")


def _told(recording: str, row: MoreKnown) -> Marked:
    """How much a further recording improves a coefficient, coloured by it."""
    factor = row.factors[recording]
    kind = "ok" if factor <= 0.6 else "tight" if factor <= 0.8 else "none"
    return mark(kind, digits(factor))


def _law(taken: str, row: Considered) -> Marked:
    return Marked(f"<b>{escape(row.law)}</b>" if row.law == taken else escape(row.law))
