"""Result of an identification, as tables."""

from __future__ import annotations

from pathlib import Path

from pinfric.identification.identify import Identified
from pinfric.identification.summary import IdentifySummary, predicted
from pinfric.model.brief import counted
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Report, paragraphs
from pinfric.show.report.values import digits

#: What stands on the page and in JSON only.
_PAGE = ("rest.largest", "rest.share", "spread_between_logs")


def identify_report(
    identified: Identified, summary: IdentifySummary, verbose: bool = True, written: bool = False
) -> Report:
    """Return what `pinfric identify` prints.

    Args:
        verbose: also the coefficients, and all notes.
        written: see `sizing_report`.
    """
    logs = ", ".join(log.name for log in summary.logs)
    duration = sum(log.duration for log in summary.logs)
    title = f"{Path(identified.scene.source).stem} · {logs}: {digits(duration)} s"
    cells = {"law": lambda joint: identified.law_of(joint.name)}
    laws = table_of(title, summary.joints, cells=cells, without=_PAGE)
    opening = [verdict(summary), *(f"! {x}" for x in summary.doubts)]
    unseen = table_of("logs that were only predicted", predicted(summary), keys=2)
    figures = table_of(
        "coefficients, with 95 % intervals; (in brackets): not determined",
        summary.parameters,
        cells={"value": lambda p: digits(p.value) if p.determined else f"({digits(p.value)})"},
        without=["section"],
        keys=2,
    )
    best = identified.advice[0]
    least = min(best.factors, key=best.factors.__getitem__)
    advice = (
        f"most informative next recording, 30 s: {best.name.lower()} (standard error of {least}: "
        f"{best.factors[least]:.2f} of the present one)"
    )
    others = summary.notes[len(summary.doubts) :]
    if not verbose:
        more = f"coefficients with intervals, {counted(len(others), 'note')}: -v"
        out = "" if written else "; scene, page: --out FOLDER"
        return paragraphs(opening, laws, unseen, [advice, f"{more}{out}"])
    lines = [f"delay of the logged efforts: {identified.estimate.delay}", *others, advice]
    return paragraphs(opening, laws, figures, unseen, lines)


def verdict(summary: IdentifySummary) -> str:
    """Return in a line for how many joints friction was found, and how well it is known."""
    explained = sum(joint.law is not None for joint in summary.joints)
    known = sum(parameter.determined for parameter in summary.parameters)
    said = f"friction of {explained} of {counted(len(summary.joints), 'joint')} found; {known} of "
    said += f"{counted(len(summary.parameters), 'coefficient')} determined"
    return f"{said}; {counted(len(summary.doubts), 'doubt')}" if summary.doubts else said
