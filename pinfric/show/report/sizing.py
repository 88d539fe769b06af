"""Result of a sizing, as tables."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from pinfric.drives.criterion import Status
from pinfric.drives.friction import drive_friction, sites_of
from pinfric.drives.mounting import mounted
from pinfric.elastic.summary import elastic_summary
from pinfric.model.brief import counted
from pinfric.motions.summary import beyond_limits
from pinfric.show.report.drives import (
    amplifier_lines,
    ask_table,
    backlash_line,
    brake_line,
    brake_table,
    bus_lines,
    bus_table,
    choice_table,
    currents_table,
    kind_lines,
    lighter_table,
    mass_table,
    mounting_table,
    product_lines,
    provisional_table,
    rating_table,
    sensitivity_table,
    smaller_table,
    turn,
    unchecked_table,
)
from pinfric.show.report.elastic import frequency_lines
from pinfric.show.report.rows import table_of
from pinfric.show.report.stop import how
from pinfric.show.report.tables import Report, Table, paragraphs
from pinfric.show.report.values import digits
from pinfric.sizing.report import SizingReport
from pinfric.sizing.summary import SizingSummary, sizing_summary

#: Efforts below (N m, N) are rounding.
ROUNDING = 1e-9
#: Efforts below this part of the joint's peak print as 0, not as 3.2e-6 beside 0.249.
_VISIBLE = 1e-4


#: A mounting that only the notes name.
_USUAL = "The robot is mounted standing, as the scene's gravity says."


def sizing_report(report: SizingReport, verbose: bool = True, written: bool = False) -> Report:
    """Return what `pinfric size` prints.

    Args:
        verbose: all of it; else what is chosen, what fails, and what to ask for.
        written: the files of --out are written; the last line does not name it.
    """
    notes = [f"note: {line}" for line in report.notes]
    failing = [*beyond_limits(report.result_without_masses), *report.verdict.failing]
    summary = sizing_summary(report)
    said = (*rating_lines(summary, verbose), *body_lines(report), *friction_line(report))
    said = (*said, *report.verdict.remarks)
    how_ = mounted(report.given, report.conditions.mounting == "any", report.elsewhere)
    if not how_.startswith(_USUAL):
        said = (*said, how_)
    head = verdict(report, verbose)
    opening = [head, *said, *(f"! {line}" for line in failing if line not in head)]
    rating = rating_table(summary)
    if report.catalog is None:
        tables = rating, demand_table(report), mounting_table(summary)
        return paragraphs(opening, *tables, elastic_lines(report), notes)
    if not verbose:
        return _short(report, summary, opening, written)
    return paragraphs(
        opening,
        rating,
        demand_table(report),
        mounting_table(summary),
        choice_table(summary),
        provisional_table(summary),
        lighter_table(summary),
        sensitivity_table(summary),
        kind_lines(summary),
        mass_table(summary),
        smaller_table(summary),
        product_lines(summary),
        ask_table(summary),
        brake_table(summary),
        stop_lines(summary, written),
        currents_table(summary),
        bus_table(report),
        bus_lines(report),
        elastic_lines(report),
        unchecked_table(summary),
        notes,
    )


def _short(
    report: SizingReport, summary: SizingSummary, opening: Sequence[Any], written: bool
) -> Report:
    first = [f"note: {line}" for line in report.assumptions[: len(report.unclosed) > 0]]
    asked, said = counted(len(summary.ask), "product"), len(product_lines(summary))
    ending = [f"{asked} to ask about", counted(said, "remark")]
    last = f"more by -v ({', '.join(x for x in ending if not x.startswith('0 '))})"
    last += "" if written else "; page and parts: --out FOLDER"
    return paragraphs(
        list(opening),
        choice_table(summary, short=True),
        kind_lines(summary),
        mounting_table(summary),
        provisional_table(summary),
        lighter_table(summary),
        sensitivity_table(summary),
        [
            *brake_line(summary),
            *backlash_line(summary),
            *amplifier_lines(summary),
            *bus_lines(report)[:1],
            *stop_lines(summary, written),
            *first,
            last,
        ],
    )


def friction_line(report: SizingReport) -> list[str]:
    """Return for how many joints friction is taken as the old drive's, where drives were chosen."""
    names = report.given.actuator_names
    sites = sites_of(report.given, names)
    reasons = [
        dict.fromkeys(why.values())
        for name, why in drive_friction(report.given).items()
        if name in sites and report.catalog is not None
    ]
    counts = {why: sum(why in own for own in reasons) for own in reasons for why in own}
    if not counts:
        return []
    said = ", ".join(f"{n} of {len(names)} joints {why}" for why, n in counts.items())
    return [f"friction: {said}; drives' losses replace it"]


def body_lines(report: SizingReport) -> list[str]:
    """Return which payloads were taken as cubes of water, and what that adds."""
    names: dict[str, list[str]] = {}
    for place, why in report.bodies.items():
        name = place.removeprefix("robot.payloads.").removesuffix(".inertia")
        names.setdefault(why, []).append(name)
    if not names:
        return []
    said = ", ".join(f"payload {', '.join(of)}: {why}" for why, of in names.items())
    heavier, lighter = (f"{digits(x or 0.0)} kg" for x in (report.drive_mass, report.point_mass))
    adds = f"; {heavier} of drives, {lighter} for a point"
    if report.point_mass is None:
        adds = ""
    elif report.point_mass == report.drive_mass:
        adds = "; it makes no drive heavier"
    return [f"guess: {said}, for want of its `inertia`{adds}"]


def rating_lines(summary: SizingSummary, verbose: bool = True) -> list[str]:
    """Return the robot's rating; verbose: also how it was judged, and the lowest frequency."""
    if (rating := summary.rating) is None:
        return []
    most = max(rating.joints, key=lambda joint: joint.held)
    aside = f", for {rating.across} as far off its axis" if rating.across else ""
    beside = "; beside the cycle: each joint bears both" if rating.joints[0].by_rating else ""
    rated = (
        f"rated for {digits(rating.payload)} kg, {digits(rating.payload_offset)} m beyond "
        f"{rating.link}{aside}, up to {digits(rating.reach)} m from the second joint"
    )
    if not verbose:
        return [rated + beside]
    lines = [
        f"{rated}: held in the worst posture of each joint, at most {digits(most.held)} "
        f"{most.unit} ({most.name}) without the masses of chosen drives, and lifted from there by "
        f"it alone, in {digits(rating.acceleration_time)} s to top speed, at most "
        f"90\N{DEGREE SIGN}{beside}"
    ]
    swings = {joint.name: joint.frequency for joint in rating.joints if joint.frequency}
    if swings:
        slowest = min(swings, key=lambda name: swings[name])
        base, hand = (summary.conditions[f"resonance_{x}"] for x in ("base", "hand"))
        lines.append(
            f"with the rated payload {slowest} swings at {digits(swings[slowest])} Hz, the lowest "
            f"of all joints; {digits(base)} and {digits(hand)} Hz are demanded of a cycle only"
        )
    return lines


def stop_lines(summary: SizingSummary, written: bool = False) -> list[str]:
    """Return whether the robot with its drives and brakes stops well; none without `stops`."""
    stops = summary.stops
    if stops is None:
        return []
    unmet = counted(len(stops.unmet), "criterion", "criteria")
    met = f"{unmet} not met" if stops.unmet else "no criterion fails"
    by = f"{counted(stops.simulated, 'stop')} simulated" if stops.simulated else "by algebra alone"
    line = f"stops, {how(stops)}: {met}, {stops.not_checked} of {stops.criteria} not checked, {by}"
    return [line if written else f"{line}; times and ways: the page (--out FOLDER)"]


def elastic_lines(report: SizingReport) -> list[str]:
    """Return the lowest frequency with the chosen gears, and the criteria of the whole robot."""
    elsewhere = {Status.FAILS} | ({Status.NOT_CHECKED} if report.catalog else set())
    asked = [c.why for c in report.arm_criteria if c.status not in elsewhere]
    if report.catalog is None:
        names = report.scene.actuator_names
        pairs = zip(names, report.reversals, strict=False)
        asked += [f"{name}: {c.why}" for name, c in pairs if not c.fails]
    if report.elastic is None:
        return asked
    rigid = [drive.name for drive in report.scene.drives if drive.spring is None]
    lines = frequency_lines(elastic_summary(report.elastic), report.scene.actuator_names)
    if rigid:
        lines.append(
            f"stiffness not known: {', '.join(rigid)}: assumed rigid, so these frequencies are "
            "upper bounds"
        )
    return [*lines, *asked]


def repetition(report: SizingReport) -> str:
    """Return how the cycle is assumed to repeat."""
    if report.rating is not None and report.rating.duty is None:
        return "means of each joint over its own part"
    if len(list(report.duty.parts())) > 1:
        return "the period, repeated" + ("; not all cycles close" if report.unclosed else "")
    return "repeated, but it does not close" if report.unclosed else "repeated without a pause"


#: What a cycle demands beside, on the page.
_ON_THE_PAGE = (
    *("speed_at_peak", "breakaway_friction", "duty", "hold_share"),
    *("power.driving", "power.braking", "power.delivered", "power.returned"),
    *("bearing.radial", "bearing.axial", "bearing.moment"),
)


def demand_table(report: SizingReport) -> Table | None:
    """Return what the cycle demands of each joint."""
    title = f"{Path(report.given.source).stem} · {Path(report.trajectory).name}"
    title = f"{title}: {digits(report.period)} s, {repetition(report)}"
    return _demands(report, title, without=_ON_THE_PAGE)


def power_table(report: SizingReport) -> Table | None:
    """Return the page's further table: speed, friction, power, energy, bearing loads."""
    title = f"power, energy per {turn(report)}, loads of bearings"
    return _demands(report, title, only=("name", "unit", *_ON_THE_PAGE))


def _demands(
    report: SizingReport, title: str, only: Collection[str] = (), without: Collection[str] = ()
) -> Table | None:
    return table_of(
        title,
        [joint.demand for joint in report.joints],
        zero=lambda demand: max(ROUNDING, _VISIBLE * demand.peak),
        only=only,
        without=without,
    )


def verdict(report: SizingReport, verbose: bool = True) -> str:
    """Return in a line the headline, and what is not checked or guessed.

    Args:
        verbose: also how the choice ended if it settled, and what is said of each joint below.
    """
    if report.catalog is None:
        beyond = beyond_limits(report.result_without_masses)
        within = f"{counted(len(beyond), 'drive')} beyond the URDF's effort limits; " * bool(beyond)
        return f"{within}{report.verdict.headline}; drives that fit: --catalog default"
    nearest = [
        joint.name
        for joint in report.joints
        if joint.choice is None and joint.nearest and not joint.nearest.would
    ]
    unchecked = counted(report.not_checked, "criterion", "criteria")
    parts = [report.verdict.headline, f"{unchecked} not checked"]
    if nearest:
        parts.append(f"{', '.join(nearest)}: computed with the closest candidate")
    if report.given.assumed is not None:
        parts.append(f"{len(report.given.assumed.values)} entries of the scene are guesses")
    return "; ".join([*parts, *[passes(report)] * (verbose or not report.settled)])


def passes(report: SizingReport) -> str:
    """Return how the choice of drives ended."""
    count = counted(report.passes, "round")
    return (
        f"settled after {count}" if report.settled else f"not settled after {count}: it alternates"
    )
