"""The bill of materials of a sizing: every part once, how many are needed, and for which joints."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

from pinfric.study.sizing.brake import Standstill
from pinfric.study.sizing.catalog import Catalog, Sourced
from pinfric.study.sizing.size import JointSizing, SizingReport

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


def bill_of_materials(report: SizingReport) -> str:
    """Return the parts of the chosen drives as CSV; empty where none was chosen.

    Columns: part, quantity, joints, mass of one and of all (kg), price of one and of all (in the
    catalogue's currency), dimensions, source, its grade; what is not known stays empty. Joints for
    which nothing fits are left out.

    Args:
        report: of `size`.
    """
    if report.catalog is None:
        return ""
    joints: dict[str, list[str]] = {}
    entries: dict[str, Sourced] = {}
    for joint, still in zip(report.joints, report.standstills, strict=True):
        for name, entry in _parts(report.catalog, report, joint, still):
            joints.setdefault(name, []).append(joint.name)
            entries[name] = entry
    if not entries:
        return ""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for name, entry in entries.items():
        count, mass = len(joints[name]), getattr(entry, "mass", None)
        costs = [
            x for one in (mass, entry.price) for x in (one, None if one is None else count * one)
        ]
        writer.writerow(
            [
                name,
                count,
                " ".join(joints[name]),
                *("" if x is None else f"{x:.6g}" for x in costs),
                entry.dimensions,
                entry.source,
                entry.grade,
            ]
        )
    return file.getvalue()


def _parts(
    catalog: Catalog, report: SizingReport, joint: JointSizing, still: Standstill
) -> Iterator[tuple[str, Sourced]]:
    """The parts of one joint's choice, by name: motor and gear or gearmotor, brake, own bearing."""
    if joint.choice is None:
        return
    drive = joint.choice.candidate
    if drive.gear_name is None:
        yield drive.motor, catalog.gearmotors[drive.motor]
    else:
        yield drive.motor, catalog.motors[drive.motor]
        gear = catalog.gears[drive.gear_name]
        ratio = f", i = {drive.ratio:g}" if len(gear.ratios) > 1 else ""
        yield drive.gear_name + ratio, gear
    if still.brake and still.fitted:
        yield still.brake, catalog.brakes[still.brake]
    if own := report.conditions.bearings.get(joint.name):
        yield own, catalog.bearings[own]
