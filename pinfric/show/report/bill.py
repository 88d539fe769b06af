"""The bill of materials of a sizing: every part with its number and joints."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

from pinfric.drives.brake import Standstill
from pinfric.drives.catalog import Catalog, Motor
from pinfric.drives.policy import KIT
from pinfric.drives.sourced import Sourced
from pinfric.sizing.report import JointSizing, SizingReport
from pinfric.sizing.verdict import JointState

_COLUMNS = (
    "part",
    "quantity",
    "joints",
    "mass_kg",
    "mass_total_kg",
    "price",
    "price_total",
    "dimensions",
    "source",
    "grade",
)
_KIT_SOURCE = f"estimate: {100 * KIT:g} % of motor and gear"


def bill_of_materials(report: SizingReport) -> str:
    """Return the parts of the chosen drives as CSV; empty if none was chosen.

    Columns: part, quantity, joints, mass of one and of all (kg), price of one and of all (in the
    catalogue's currency), dimensions, source, its grade; unknown ones are empty. Housing, shaft and
    bearings of a frameless kit are one line, so masses add up to the drives'. Joints that cannot be
    signed are left out.
    """
    if report.catalog is None:
        return ""
    joints: dict[str, list[str]] = {}
    entries: dict[str, Sourced | float] = {}
    rows = zip(report.joints, report.standstills, report.verdict.joints, strict=True)
    for joint, still in ((j, still) for j, still, v in rows if v.state == JointState.SIGNED):
        for name, entry in _parts(report.catalog, report, joint, still):
            joints.setdefault(name, []).append(joint.name)
            entries[name] = entry
    if not entries:
        return ""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for name, entry in entries.items():
        count = len(joints[name])
        if isinstance(entry, Sourced):
            mass = getattr(entry, "mass_taken", getattr(entry, "mass", None))
            price = entry.price
            about = [entry.dimensions, entry.source, entry.grade]
        else:
            mass, price, about = entry, None, ["", _KIT_SOURCE, ""]
        costs = [x for one in (mass, price) for x in (one, None if one is None else count * one)]
        writer.writerow(
            [
                name,
                count,
                " ".join(joints[name]),
                *("" if x is None else f"{x:.6g}" for x in costs),
                *about,
            ]
        )
    return file.getvalue()


def _parts(
    catalog: Catalog, report: SizingReport, joint: JointSizing, still: Standstill
) -> Iterator[tuple[str, Sourced | float]]:
    """Yield name and entry of each part of one joint's choice.

    Motor and gear or gearmotor, kit, brake, the joint's own bearing; the kit of a frameless drive
    has only a mass (kg).
    """
    if joint.choice is None:
        return
    drive = joint.choice.candidate
    motor, gear = drive.entry, drive.gear
    yield drive.motor, motor
    if gear is not None:
        ratio = f", i = {drive.ratio:g}" if len(gear.ratios) > 1 else ""
        yield f"{drive.gear_name}{ratio}", gear
        kit = isinstance(motor, Motor) and motor.frameless
        if kit and motor.mass is not None and gear.mass is not None:
            yield f"housing, shaft, bearings: {drive.name}", KIT * (motor.mass + gear.mass)
    if still.brake and still.fitted:
        yield still.brake, catalog.brakes[still.brake]
    if own := report.conditions.bearings.get(joint.name):
        yield own, catalog.bearings[own]
