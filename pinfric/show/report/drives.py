"""Tables of a sizing: the drives, next smaller ones, brakes, the bus."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from math import degrees, radians

from pinfric.drives.criterion import Status
from pinfric.drives.drivetrain import RETYPED
from pinfric.drives.kinds import KINDS
from pinfric.drives.power import BusPower
from pinfric.model.brief import counted
from pinfric.show.report.names import short_names
from pinfric.show.report.rows import NONE, table_of
from pinfric.show.report.tables import Table
from pinfric.show.report.values import digits
from pinfric.sizing.report import SizingReport
from pinfric.sizing.sensitivity import FACTORS, Sensitivity
from pinfric.sizing.summary import SizedJoint, SizingSummary, Unchecked
from pinfric.sizing.verdict import JointState

#: rad, 3 arcmin: planetary gears for robots have less (Beckhoff AG2400, TP), strain wave gears 1.
_LOOSE = radians(3.0 / 60.0) * (1 + 1e-9)
#: N m; torques of brakes below print as 0.
_ROUNDING = 1e-9
#: Fields of a joint that say which drive was chosen.
_INSTALLED = ("brake", "mass", "backlash", "backlash_at_tool")
_VERDICT = ("verdict.margin", "verdict.tightest")
_CHOICE = ("name", "choice", "decided_by", *(f"installed.{name}" for name in _INSTALLED), *_VERDICT)
_SMALLER = ("name", "next_smaller.name", "next_smaller.mass", "next_smaller.short_by")
_STILL = tuple(f"standstill.{name}" for name in ("effort", "shaft", "use", "brake", "margin"))


#: The same in short.
_SHORT = ("name", "choice", "decided_by", "installed.mass", *_VERDICT)


def choice_table(
    summary: SizingSummary,
    cells: Mapping[str, Callable[[SizedJoint], str]] | None = None,
    short: bool = False,
) -> Table | None:
    """Return the chosen drives of a sizing with a catalogue.

    Args:
        cells: fields to show beside the usual ones or in another way, and how.
    """
    voltage = f", {digits(summary.conditions['bus_voltage'])} V" if summary.bus.feeds else ""
    title = f"drives from {summary.catalog}{voltage}"
    own = {"choice": _chosen, **(cells or {})}
    return table_of(title, summary.joints, only={*(_SHORT if short else _CHOICE), *own}, cells=own)


def rating_table(summary: SizingSummary) -> Table | None:
    """Return what a rating demands of each joint; None without one."""
    rows = () if summary.rating is None else summary.rating.joints
    title = "the rating, each joint in its worst posture and alone"
    return table_of(title, rows, zero=_ROUNDING)


def mounting_table(summary: SizingSummary) -> Table | None:
    """Return the hardest of several mountings for each joint; None if there is one."""
    return table_of("the hardest mounting of each joint", summary.mountings, zero=_ROUNDING)


def _chosen(joint: SizedJoint) -> str:
    if joint.provisional is not None:
        return f"not signed: {joint.provisional.drive}"
    if joint.verdict is not None and joint.verdict.state == JointState.UNLOADED:
        return "moves no mass: not sized"
    nearest = "" if joint.installed is None else f"; nearest {joint.installed.judged}"
    ended = {JointState.FAILS: " (fails)", JointState.PROVISIONAL: " (provisional)"}
    said = "" if joint.verdict is None else ended.get(joint.verdict.state, "")
    return f"{joint.choice or f'none{nearest}'}{said}"


def mass_table(summary: SizingSummary) -> Table | None:
    """Return the effect of the drives' own mass, if it is more than a twentieth."""
    rows = [joint for joint in summary.joints if joint.rms > 1.05 * joint.rms_without_masses]
    only = ("name", "unit", "rms", "rms_without_masses")
    return table_of("RMS with the drives' own mass and without", rows, only=only)


def smaller_table(summary: SizingSummary) -> Table | None:
    """Return the shortfalls of the next smaller drives; None if no joint has one."""
    rows = [joint for joint in summary.joints if joint.next_smaller is not None]
    return table_of("the next smaller drives", rows, only=_SMALLER)


def brake_line(summary: SizingSummary) -> list[str]:
    """Return the brakes of the chosen drives, and why other joints need none."""
    joints: dict[str, list[str]] = {}
    without: dict[str, list[str]] = {}
    for joint in summary.joints:
        if joint.installed is not None and joint.installed.brake:
            joints.setdefault(joint.installed.brake, []).append(joint.name)
        elif joint.installed is not None and joint.standstill.torque.status == Status.NOT_REQUIRED:
            without.setdefault(joint.standstill.torque.note, []).append(joint.name)
    said = "; ".join(f"{name} ({', '.join(of)})" for name, of in joints.items())
    lines = [f"{', '.join(of)}: {why}" for why, of in without.items()]
    return [f"brakes: {said}", *lines] if said else lines


def backlash_line(summary: SizingSummary) -> list[str]:
    """Return the joints whose gear has more backlash than a robot's joint usually has."""
    turning = [joint for joint in summary.joints if joint.unit == "N m"]
    gaps = [(j.name, (j.installed and j.installed.backlash) or 0.0) for j in turning]
    loose = [f"{name} {degrees(gap) * 60:.3g}" for name, gap in gaps if gap > _LOOSE]
    if not loose:
        return []
    return [f"backlash, arcmin at the joint: {', '.join(loose)}; conditions.backlash limits it"]


def currents_table(summary: SizingSummary) -> Table | None:
    """Return the currents of each motor and its amplifier; None where no current is known."""
    figures = ("peak_current", "rms_current", "current_kind")
    only = ("name", *(f"installed.motor.{name}" for name in figures), "installed.amplifier")
    rows = [joint for joint in summary.joints if joint.installed is not None]
    cells = {"installed.amplifier": _amplifier}
    return table_of("currents of the motors, and their amplifiers", rows, only=only, cells=cells)


def _amplifier(joint: SizedJoint) -> str:
    taken = joint.installed
    return NONE if taken is None else taken.amplifier or taken.no_amplifier


#: Rows of kinds of drives that are printed beside the choice.
_SHOWN = {name: kind.figures.NAME for kind in KINDS for name in kind.figures.SHOWN}


def kind_lines(summary: SizingSummary) -> list[str]:
    """Return what drives of a kind of their own need and have, by joint."""
    lines, short = list[str](), short_names([joint.name for joint in summary.joints])
    for joint in summary.joints:
        said = []
        for c in () if joint.installed is None else joint.installed.criteria:
            if c.name in _SHOWN and c.required is not None:
                have = "" if c.available is None else f" of {digits(c.available)}"
                name = c.name.removeprefix(f"{_SHOWN[c.name]} ")
                said.append(f"{name} {digits(c.required)}{have} {c.unit}")
        lines += [f"{short[joint.name]}: {', '.join(said)}"] * bool(said)
    return lines


def amplifier_lines(summary: SizingSummary) -> list[str]:
    """Return the amplifiers in a sentence, with the currents of the motors that they feed."""
    short = short_names([joint.name for joint in summary.joints])
    by_name: dict[str, list[str]] = {}
    taken_ = [joint.installed for joint in summary.joints if joint.installed is not None]
    kinds = {drive.motor.current_kind for drive in taken_ if drive.motor is not None} - {""}
    alike = f" {kinds.pop()}" if len(kinds) == 1 else ""
    for joint in summary.joints:
        if (taken := joint.installed) is None:
            continue
        said, motor = short[joint.name], taken.motor
        if motor is not None and motor.peak_current is not None and motor.rms_current is not None:
            said += f" {digits(motor.peak_current)}, {digits(motor.rms_current)}"
            said += "" if alike else f" {motor.current_kind}"
        by_name.setdefault(taken.amplifier or f"none: {taken.no_amplifier}", []).append(said)
    said = "; ".join(f"{name} ({'; '.join(of)})" for name, of in by_name.items())
    fed = said and summary.bus.feeds
    return [f"amplifiers, peak and RMS current in A{alike}: {said}"] if fed else []


def by_text(lines: Iterable[str]) -> dict[str, dict[str, None]]:
    """Return the names for each text of lines `name: text`, each once."""
    whose: dict[str, dict[str, None]] = {}
    for line in lines:
        name, _, text = line.partition(": ")
        whose.setdefault(text, {})[name] = None
    return whose


def product_lines(summary: SizingSummary) -> list[str]:
    """Return the catalogue's remarks on the chosen products, a line each."""
    taken = (joint.installed for joint in summary.joints)
    products = by_text(note for drive in taken if drive is not None for note in drive.notes)
    retyped = list(products.pop(RETYPED, {}))
    more = f" and {len(retyped) - 1} more" * (len(retyped) > 1)
    lines = [f"{', '.join(names)}: {said}" for said, names in products.items()]
    return [*lines, *(f"{name}{more}: {RETYPED}" for name in retyped[:1])]


def provisional_table(summary: SizingSummary) -> Table | None:
    """Return what would fit joints without a signed drive; None: there are none."""
    rows = [joint for joint in summary.joints if joint.provisional is not None]
    asked = dict.fromkeys(x for j in rows for x in (j.provisional.ask if j.provisional else ()))
    only = ("name", *(f"provisional.{name}" for name in ("drive", "mass", "would")))
    return table_of("not signed" + f": ask for {', '.join(asked)}" * bool(asked), rows, only=only)


def lighter_table(summary: SizingSummary) -> Table | None:
    """Return drives that weigh no more than what they move, where the chosen ones do."""
    rows = summary.lighter
    asked = dict.fromkeys(figure for row in rows for figure in row.ask)
    mass = digits(sum(row.mass or 0.0 for row in rows))
    title = f"lighter, {mass} kg in all, but not signed: ask for {', '.join(asked)}"
    return table_of(title, rows)


def sensitivity_table(summary: SizingSummary) -> Table | None:
    """Return by which factors on loads the choice changes; None: not asked for."""
    short = short_names([joint.name for joint in summary.joints])
    cells: dict[str, Callable[[Sensitivity], str]] = {
        "factor": lambda row: "more than 2" if row.factor is None else f"{row.factor:g}",
        "joints": lambda row: ", ".join(short[name] for name in row.joints) or "none",
    }
    title = f"where the choice changes first, from {FACTORS[0]:g} to {FACTORS[-1]:g} times"
    return table_of(title, summary.sensitivity, cells=cells)


def ask_table(summary: SizingSummary, most: int = 0) -> Table | None:
    """Return the products that lack a figure, fewest figures first; None: none.

    Where drives are chosen, these are lighter ones.

    Args:
        most: rows to show; 0: all.
    """
    rows, short = summary.ask[: most or None], short_names([joint.name for joint in summary.joints])
    cells = {"joints": lambda row: ", ".join(short[name] for name in row.joints)}
    more = f"; {len(summary.ask) - len(rows)} more" if len(rows) < len(summary.ask) else ""
    chosen = {joint.name for joint in summary.joints if joint.choice is not None}
    lighter = "lighter, but " if all(chosen.issuperset(row.joints) for row in rows) else ""
    title = f"{lighter}a figure is missing: cannot be signed{more}"
    return table_of(title, rows, cells=cells)


def brake_table(summary: SizingSummary) -> Table | None:
    """Return the joints that hold without power, the required brake torques, and the brakes."""
    title = "without power, at any pose of the cycle: with friction\N{EN DASH}without friction"
    cells = {"standstill.use": holds_alone, "standstill.brake": _brake}
    only = ("name", "unit", *_STILL)  # the unit is of the effort beside it alone: no second key
    return table_of(title, summary.joints, only=only, cells=cells, zero=_ROUNDING, keys=1)


def _brake(joint: SizedJoint) -> str:
    still = joint.standstill
    if still.torque.required == 0.0 and still.brake is None:
        return "none needed"
    return still.brake or ("none holds it" if still.torque.available else NONE)


def holds_alone(joint: SizedJoint) -> str:
    """Return whether friction alone holds a joint, and its reserve."""
    still = joint.standstill
    if still.held is None:
        return "not known"
    return (
        "moves"
        if still.use is None
        else f"friction holds it, {100 * (1 - still.use):.0f} % reserve"
    )


def unchecked_table(
    summary: SizingSummary, title: str = "not checked, a value is missing"
) -> Table | None:
    """Return what was not checked, with the missing figures; None if nothing."""
    short = short_names([joint.name for joint in summary.joints])

    def joints(row: Unchecked) -> str:
        if not row.joints:
            return "robot"
        if len(row.joints) == len(short):
            return "all"
        return ", ".join(short[name] for name in row.joints)

    return table_of(title, summary.unchecked, cells={"joints": joints})


def turn(report: SizingReport) -> str:
    """Return what is repeated: a cycle, or a period of several."""
    return "period" if len(list(report.duty.parts())) > 1 else "cycle"


def bus_table(report: SizingReport) -> Table | None:
    """Return the power of all drives from and to the bus; None if no drive has a motor."""
    least = "\N{GREATER-THAN OR EQUAL TO}" if report.bus.at_least else ""

    def at_least(name: str) -> Callable[[BusPower], str]:
        return lambda bus: f"{least}{digits(getattr(bus, name))}"

    drawn = ("peak", "drawn", "mean", "current", "rms_current")
    cells = {name: at_least(name) for name in drawn}
    rows = [report.bus] if report.bus.known else []
    return table_of(f"the bus, a {turn(report)}", rows, cells=cells, keys=0)


def bus_lines(report: SizingReport) -> list[str]:
    """Return how braking energy is absorbed, and which drives are left out."""
    bus = report.bus
    if not bus.feeds:
        return []
    lines = [f"braking: {bus.remedy}"]
    special = {
        joint.name: own
        for joint in report.joints
        if joint.installed and (own := joint.installed.candidate.ratings.special) and own.ON_BUS
    }
    if missing := [name for name in bus.mechanical if name not in special]:
        lines.append(
            f"copper loss of {counted(len(missing), 'drive')} is missing: no torque constant or "
            "resistance"
        )
    if special:
        kinds = Counter(own.NAME for own in special.values())
        whose = ", ".join(counted(n, name) for name, n in kinds.items())
        heat = [own.driver_heat for own in special.values()]
        known, unknown = sum(filter(None, heat)), counted(heat.count(None), "has", "have")
        more = [f"at most {digits(known)} W more, 2 R I^2"] * (known > 0)
        more += [f"{unknown} no resistance"] * (None in heat)
        lines.append(
            f"the heat of {whose} is not in the bus power, as its "
            f"driver keeps up the current whatever the torque: {'; '.join(more)}"
        )
    if bus.left_out and bus.known:
        lines.append(f"{', '.join(bus.left_out)}: not in the bus power, no motor")
    return lines
