"""The parts that conditions give to a joint: its amplifier, its bearing or guide."""

from __future__ import annotations

from pinfric.drives.bearing import BearingRatings
from pinfric.drives.catalog import Amplifier, Catalog
from pinfric.drives.policy import OTHERS, Conditions
from pinfric.errors import CatalogError, choose_from
from pinfric.model.scene import Scene


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


def check_names(scene: Scene, conditions: Conditions) -> None:
    """Refuse conditions that name a drive that is not there: `CatalogError`."""
    for key in ("mass_in_urdf", "collision_effort", "bearings", "amplifiers"):
        for name in getattr(conditions, key):
            if name not in scene.actuator_names and (key, name) != ("amplifiers", OTHERS):
                raise CatalogError(
                    f"conditions.{key}: there is no drive {name!r}; "
                    f"{choose_from(name, scene.actuator_names)}"
                )
