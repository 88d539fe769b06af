"""Result of an identification, as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pinfric.identification.advice import Advice
from pinfric.identification.identify import Identified
from pinfric.identification.parameters import Parameter
from pinfric.identification.summary import IdentifySummary, predicted
from pinfric.model.brief import counted
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Column, ColumnKind, Report, Table, paragraphs
from pinfric.show.report.values import digits, percent, rough, span

#: What stands on the page and in JSON only.
_PAGE = ("rest.largest", "rest.share", "spread_between_logs")
#: Share of half an interval by which its middle may be off the value that is printed with +-.
_SKEW = 0.15
#: Key of a coefficient -> its column, and whether it is stated at the motor's shaft. Of a gear's
#: losses the product is what logs without a known payload show.
_COULOMB, _VISCOUS = "Coulomb\nforward, back", "viscous or\nby speed^p"
_COLUMNS = {
    **{f"coulomb.{way}": (_COULOMB, False) for way in ("positive", "negative")},
    **{f"no_load_torque.{way}": (_COULOMB, True) for way in ("positive", "negative")},
    **{
        f"coulomb.{way}.static": ("at rest\nforward, back", False)
        for way in ("positive", "negative")
    },
    **{
        f"no_load_torque.{way}.static": ("at rest\nforward, back", True)
        for way in ("positive", "negative")
    },
    "viscous": (_VISCOUS, False),
    "motor_viscous": (_VISCOUS, True),
    "mu": ("mu of its\nbearing", False),
    "mu.static": ("mu at\nrest", False),
    "efficiency_product": ("efficiency\nboth ways", False),
    "stribeck.velocity": ("Stribeck\nrad/s or m/s", False),
    "presliding.way": ("builds up over\nrad or m", False),
}


def identify_report(
    identified: Identified, summary: IdentifySummary, verbose: bool = True, written: bool = False
) -> Report:
    """Return what `pinfric identify` prints.

    Args:
        verbose: coefficients by their keys, with rotors, and all notes.
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
    advice = [_advised(identified.advice[0])] if identified.advice else []
    others = summary.notes[len(summary.doubts) :]
    if not verbose:
        fewer = counted(len(others) - len(summary.given), "note")
        more = f"keys in the scene, rotors, {fewer}: -v"
        out = "" if written else "; scene, page: --out FOLDER"
        friction = friction_table(identified)
        closing = [*_unseen(summary), *advice, f"{more}{out}"]
        return paragraphs(opening, laws, friction, summary.given, closing)
    lines = [f"delay of the logged efforts: {identified.estimate.delay}", *others, *advice]
    return paragraphs(opening, laws, figures, unseen, lines)


def _advised(best: Advice) -> str:
    least = min(best.factors, key=best.factors.__getitem__)
    return (
        f"most informative next recording, 30 s: {best.name.lower()} (standard error of {least}: "
        f"{best.factors[least]:.2f} of the present one)"
    )


def _unseen(summary: IdentifySummary) -> list[str]:
    """Return a line of errors for each log that was only predicted."""
    each = {
        log: ", ".join(f"{joint} {percent(error.moving_share)}" for joint, error in joints.items())
        for log, joints in summary.unseen.items()
    }
    return [f"{log}, only predicted, error moving: {errors}" for log, errors in each.items()]


def friction_table(identified: Identified) -> Table | None:
    """Return the friction of each joint, as it acts there, with 95 % intervals; None: no joint."""
    drives = dict(zip(identified.scene.joint_names, identified.scene.drives, strict=True))
    found: dict[str, dict[str, list[Parameter]]] = {}
    for p in identified.parameters:
        if p.name in _COLUMNS:
            ratio, exponent = abs(drives[p.joint].ratio), identified.laws[p.joint].exponent or 0.0
            heading, on_shaft = _COLUMNS[p.name]
            factor = ratio ** (1.0 + exponent * (heading == _VISCOUS)) if on_shaft else 1.0
            ends = (factor * x for x in (p.value, p.low, p.high))
            value, low, high = ends
            at_joint = replace(p, value=value, low=low, high=high)
            found.setdefault(p.joint, {}).setdefault(heading, []).append(at_joint)
    heads = [
        x
        for x in dict.fromkeys(x for x, _ in _COLUMNS.values())
        if any(x in f for f in found.values())
    ]
    units = {
        joint: identified.scene.drives[identified.scene.joint_names.index(joint)].unit
        for joint in found
    }
    same = set(units.values()) == {"N m"}
    columns = [Column("joint", ColumnKind.NAME), *[Column("unit", ColumnKind.LABEL)] * (not same)]
    columns += [Column(head) for head in heads]
    rows = [
        [joint, *[units[joint]] * (not same), *(_cell(own.get(head, ())) for head in heads)]
        for joint, own in found.items()
    ]
    title = "friction at the joint, with 95 % intervals; (in brackets): not determined"
    title += ", N m" * same
    return Table(title, columns, rows, keys=1 if same else 2) if rows else None


def _cell(parameters: Sequence[Parameter]) -> str:
    """Coefficients of one kind with their interval: 11.2, 10.9 ±0.3; or 0.90 0.85–0.97."""
    if not parameters:
        return "-"
    known = [p for p in parameters if math.isfinite(p.low) and math.isfinite(p.high)]
    halves = [0.5 * (p.high - p.low) for p in known]
    even = all(abs(p.low + h - p.value) <= _SKEW * h for p, h in zip(known, halves, strict=True))
    texts = []
    for p in parameters:
        text = digits(p.value)
        if p in known and not even:
            text += f" {span(p.low, p.high)}"
        texts.append(text if p.determined else f"({text})")
    return ", ".join(texts) + (f" ±{rough(max(halves))}" if known and even else "")


def verdict(summary: IdentifySummary) -> str:
    """Return in a line for how many joints friction was found, and how well it is known."""
    explained = sum(joint.law is not None for joint in summary.joints)
    known = sum(parameter.determined for parameter in summary.parameters)
    said = f"friction of {explained} of {counted(len(summary.joints), 'joint')} found; {known} of "
    said += f"{counted(len(summary.parameters), 'coefficient')} determined"
    return f"{said}; {counted(len(summary.doubts), 'doubt')}" if summary.doubts else said
