"""Errors of an export's constants, as a table."""

from __future__ import annotations

from pathlib import Path

from pinfric.exporting.constants import TERMS
from pinfric.exporting.controller import stable_scale
from pinfric.exporting.export import FORMATS, Exported
from pinfric.model.brief import file_name
from pinfric.show.report.rows import table_of
from pinfric.show.report.tables import Report, paragraphs
from pinfric.show.report.values import digits


def export_report(exported: Exported) -> Report:
    """Return what `pinfric export` prints."""
    form = FORMATS[exported.to]
    title = f"{Path(exported.scene).stem} · {file_name(exported.trajectory)}: {form.title}"
    uncertain = [
        f"{drive}: friction known to {e:.1%} (e); stable scale 1/(1+e) = {stable_scale(e):.3f}"
        for drive, e in exported.uncertainty.items()
    ]
    if not exported.joints:
        coupled = "drives are coupled, so constants of single joints are not comparable"
        return [f"{title}: {coupled}", *uncertain]
    if exported.forms:
        return _models(exported, title)
    table = table_of(
        title,
        exported.joints,
        without=[term for term in TERMS if term not in form.terms],
        cells={
            "frictionloss": lambda joint: (
                digits(joint.frictionloss, 1e-9 * joint.torque_peak)
                if joint.moving
                else "cannot move"
            ),
            "rest_lower": lambda joint: (
                "never"
                if joint.rest_lower != joint.rest_lower
                else f"{digits(joint.rest_lower)} to {digits(joint.rest_upper)}"
            ),
        },
        zero=lambda joint: 1e-9 * joint.torque_peak,
    )
    # What the columns mean, and what the file does not hold
    lines = [
        "the header uses the present load and needs no constants; those in the table are for "
        "comparison, `error` is how far they are off there"
    ] * (form.write is None)
    lines += [
        "constants in the joint's unit, per rad/s or m/s, and in kg m^2 or kg; error: compared "
        "with the scene's torque (motor torque x ratio) while the joint moves",
        f"at rest the scene has a torque range beside the load: {form.at_rest}",
        *(f"not in the file: {line}" for line in exported.left_out),
        *exported.notes,
    ]
    if still := [joint for joint in exported.joints if joint.unmoved]:
        shown = ", ".join(f"{x.joint} ({x.fitted_rms:.3g} {x.unit})" for x in still)
        lines.append(
            "never moves in this motion, so its constants are of random states, with the armature "
            f"ratio^2 x rotor inertia (RMS error if that were fitted instead): {shown}"
        )
    if alike := [joint.joint for joint in exported.joints if not joint.apart]:
        lines.append(f"the motion does not determine each constant of {', '.join(alike)}")
    return paragraphs(table, [*lines, *uncertain])


def _models(exported: Exported, title: str) -> Report:
    """The models of each joint, and which one to take."""
    table = table_of(
        title,
        exported.forms,
        cells={"model": lambda form: f"{form.model} *" if form.taken else form.model},
        zero=lambda form: 1e-9 * form.friction_rms,
    )
    lines = [
        "* the one to take: the simplest whose errors in motion, at the motors' limits and at "
        "break-away, as one RMS, are below 5 % of the friction or 1.1 times the least of any "
        "model; m1 is constants",
        *(f"not in the file: {line}" for line in exported.left_out),
        *exported.notes,
    ]
    return paragraphs(table, lines)
