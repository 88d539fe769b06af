"""Drives that a file names: the drive, its joint's own parts, and its criteria over a motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pinfric.drives.bearing import BearingRatings
from pinfric.drives.catalog import Amplifier, Catalog
from pinfric.drives.criterion import Criterion
from pinfric.drives.demand import drive_cycle, driven_joint, gear_demand
from pinfric.drives.drivetrain import Candidate, drives_of, motor_cycle
from pinfric.drives.limit import JointCase
from pinfric.drives.limits import check
from pinfric.drives.policy import BASE_AXES, OTHERS, Conditions
from pinfric.drives.robot import depth
from pinfric.drives.way import pins, way_of
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import CatalogError, choose_from
from pinfric.model.scene import Scene


def output_of(scene: Scene, actuator: int, conditions: Conditions) -> str:
    """Return what a drive's joint takes: `rotary`, `linear`, the medium of a cylinder; else "".

    A drive between two points is a cylinder; a force and a joint with several axes take nothing.
    """
    named = scene.drives[actuator].name in conditions.cylinders
    if named or pins(scene, actuator):
        return conditions.medium
    if driven_joint(scene, actuator) is None:
        return ""
    return "linear" if scene.drives[actuator].slides else "rotary"


def named_drive(
    scene: Scene, actuator: int, name: str, catalog: Catalog, conditions: Conditions
) -> Candidate:
    """Return the drive of a catalogue that `pinfric size` prints by a name, with its joint's parts.

    Raises:
        CatalogError: there is none for such a joint; as `own_parts`.
    """
    linear = scene.drives[actuator].slides
    some = replace(  # names of all pairs take seconds
        catalog,
        motors={key: x for key, x in catalog.motors.items() if name.startswith(key)},
        gears={key: x for key, x in catalog.gears.items() if key in name},
        gearmotors={key: x for key, x in catalog.gearmotors.items() if key == name},
        kinds={key: x for key, x in catalog.kinds.items() if name.startswith(key)},
    )
    drives = dict(drives_of(some, linear, conditions.ambient))
    if name not in drives:
        there = dict(drives_of(catalog, linear, conditions.ambient))
        raise CatalogError(
            f"the catalogue has no drive {name!r} ({catalog.source}); {choose_from(name, there)}"
        )
    parts: dict[str, Any] = own_parts(catalog, conditions, scene.drives[actuator].name, linear)
    return replace(drives[name](), **parts)


def criteria_over(
    result: InverseResult,
    actuator: int,
    candidate: Candidate,
    conditions: Conditions,
    holding: np.ndarray,
    inertia: float | None,
) -> tuple[Criterion, ...]:
    """Return the criteria of a drive over a motion that is repeated, as `size` has them.

    Args:
        actuator: its column. holding: (T,) of `demand.hold_samples`.
        inertia: largest about the joint, kg m^2 (kg); None: not known.
    """
    cycle = drive_cycle(result, actuator, holding)
    demand = gear_demand(result, actuator, cycle, carried=candidate.carried)
    hand = depth(result.scene, actuator) > BASE_AXES
    motor = motor_cycle(candidate, cycle, conditions)
    way = way_of(result.scene, actuator, result.states.q)
    return check(candidate, motor, JointCase(demand, cycle, inertia, hand, conditions, way=way))


def own_parts(
    catalog: Catalog, conditions: Conditions, joint: str, linear: bool
) -> dict[str, BearingRatings | Amplifier]:
    """Return what the conditions give to a joint, by its field of a candidate.

    Raises:
        CatalogError: the catalogue does not have it, or not its ratings; it does not fit the joint.
    """
    parts: dict[str, BearingRatings | Amplifier] = {}
    key = joint if joint in conditions.amplifiers else OTHERS
    if (fed := conditions.amplifiers.get(key)) is not None:
        if fed not in catalog.amplifiers:
            raise CatalogError(
                f"conditions.amplifiers.{key}: there is no amplifier {fed!r} in the catalogue; "
                f"{choose_from(fed, catalog.amplifiers)}"
            )
        parts["amplifier"] = catalog.amplifiers[fed]
    if (name := conditions.bearings.get(joint)) is None:
        return parts
    where, entry = f"conditions.bearings.{joint}: ", catalog.bearings.get(name)
    if entry is None or entry.ratings is None:
        rated = [known for known, other in catalog.bearings.items() if other.ratings is not None]
        what = "has no `ratings`" if name in catalog.bearings else "is not in the catalogue"
        raise CatalogError(f"{where}the bearing {name!r} {what}; {choose_from(name, rated)}")
    if entry.ratings.guide != linear or entry.ratings.screw:
        joint_kind = "sliding joint takes a `linear guide`" if linear else "turning joint a bearing"
        nut = "; a screw's nut is its gear's `bearing`" if entry.ratings.screw else ""
        raise CatalogError(f"{where}{name!r} is a {entry.ratings.kind}; a {joint_kind}{nut}")
    source = entry.ratings.source or entry.source
    ratings = entry.ratings.model_copy(update={"source": source})
    return parts | {"guide" if linear else "bearing": ratings}


def check_names(scene: Scene, conditions: Conditions, catalog: Catalog | None) -> None:
    """Refuse conditions that name a joint or a product that is not there, or one joint twice.

    Raises:
        CatalogError: as said, or a bearing or a drive does not fit its joint.
    """
    shared = [name for group in conditions.same_drive for name in group]
    for name in shared:
        if shared.count(name) > 1:
            raise CatalogError(f"conditions.same_drive: {name!r} occurs {shared.count(name)} times")
    keys = "mass_in_urdf", "collision_effort", "bearings", "amplifiers", "take", "cylinders"
    for key in (*keys, "same_drive"):
        for name in shared if key == "same_drive" else getattr(conditions, key):
            if name not in scene.actuator_names and (key, name) != ("amplifiers", OTHERS):
                raise CatalogError(
                    f"conditions.{key}: there is no drive {name!r}; "
                    f"{choose_from(name, scene.actuator_names)}"
                )
    for group in conditions.same_drive:
        if len({scene.drives[scene.actuator_names.index(name)].slides for name in group}) > 1:
            raise CatalogError(
                f"conditions.same_drive: of {', '.join(group)} some turn and some slide; they have "
                "no drive in common"
            )
    for name in conditions.cylinders:
        if not scene.drives[scene.actuator_names.index(name)].slides:
            raise CatalogError(
                f"conditions.cylinders: {name!r} turns; a cylinder is for a sliding joint, or acts "
                "between two points (`cylinder` under `actuators`)"
            )
    known = catalog or Catalog("no catalogue")
    for i, joint in enumerate(scene.actuator_names):
        if joint in conditions.take:
            named_drive(scene, i, conditions.take[joint], known, conditions)
        elif joint in conditions.bearings:
            own_parts(known, conditions, joint, scene.drives[i].slides)
