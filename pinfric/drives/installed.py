"""The installed drive, one for all commands: the scene has its figures, a catalogue its limits.

The scene's `transmission` is the gear with the rotor of motor and brake that all dynamics move, and
`installed` names the product. What holds a product's name against the scene stands here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from pinfric.drives.catalog import Brake
from pinfric.drives.drivetrain import Candidate, with_brake
from pinfric.errors import CatalogError, choose_from
from pinfric.model.scene import Scene
from pinfric.model.schema import Actuator, Sized, Transmission

#: Figures of a product in a file are written to ten digits; more than this part is another.
_SAME = 1e-6
#: Of a transmission, what tells products apart; losses and stiffness may have been identified.
_OF_PRODUCT: dict[str, Callable[[Transmission], float]] = {
    "ratio": lambda gear: gear.ratio,
    "rotor_inertia": lambda gear: gear.rotor_inertia,
    "brake.torque": lambda gear: 0.0 if gear.brake is None else gear.brake.torque,
}


def actuator_of(scene: Scene, drive: int) -> Actuator:
    """Return the scene's entry of a drive, by its column."""
    name = scene.actuator_names[drive]
    listed = (a for a in scene.actuators or () if a.drive_name == name)
    return next(listed, Actuator.model_construct(joint=name))


def installed_drive(
    scene: Scene, drive: int, candidate: Candidate, brakes: Mapping[str, Brake]
) -> Candidate:
    """Return a drive of a catalogue as it is in a scene: with its brake, and the scene's gear.

    Where the scene has no gear it is returned as given, for `equip`.

    Args:
        drive: its column. brakes: of the catalogue.

    Raises:
        CatalogError: another gear or product is there.
    """
    there, name = actuator_of(scene, drive), scene.actuator_names[drive]
    gear, product, place = there.transmission, there.installed, f"{scene.source}: actuators: {name}"
    if gear is None:
        return candidate
    if product is None:
        raise CatalogError(
            f"{place} has a gear of its own, which no file of motors replaces by {candidate.name}: "
            "take its `transmission` out, or give limits as numbers; a scene that an older `size` "
            "wrote lacks `installed`: run `pinfric size --out` again"
        )
    if product.drive != candidate.name:
        raise CatalogError(
            f"{place}: `installed` is {product.drive}, not {candidate.name}: give files of one "
            "`pinfric size --out`"
        )
    if product.brake is not None and candidate.brake != product.brake:
        if product.brake not in brakes:
            raise CatalogError(
                f"{place}: the catalogue has no brake {product.brake!r} (`installed`); "
                f"{choose_from(product.brake, brakes)}"
            )
        candidate = with_brake(candidate, product.brake, brakes[product.brake])
    for key, figure in _OF_PRODUCT.items():
        mine, theirs = figure(gear), figure(candidate.transmission or gear)
        if abs(mine - theirs) > _SAME * abs(theirs):
            raise CatalogError(
                f"{place}.transmission.{key} is {mine:.6g}, but {theirs:.6g} of {candidate.name}"
                + f" with {product.brake}" * (product.brake is not None)
                + ", which `installed` names: run `pinfric size --out` again, or take `installed` "
                "out and give limits as numbers"
            )
    return replace(candidate, transmission=gear)


def sized_for(scene: Scene) -> Sized:
    """Return the masses for which drives are chosen: of joints' bodies and payloads, kg."""
    bodies = zip(scene.model.names.tolist()[1:], scene.model.inertias.tolist()[1:], strict=True)
    return Sized(
        joints={str(name): float(body.mass) for name, body in bodies},
        payloads={name: payload.mass for name, payload in scene.payloads.items()},
    )


def check_masses(scene: Scene) -> None:
    """Refuse other masses than those for which a scene's drives were chosen: `CatalogError`."""
    if scene.sized is None:
        return
    now = sized_for(scene)
    for what, mine, theirs in (
        ("joint", now.joints, scene.sized.joints),
        ("payload", now.payloads, scene.sized.payloads),
    ):
        for name, mass in mine.items():
            chosen = theirs.get(name, 0.0)
            if abs(mass - chosen) > _SAME * max(mass, chosen):
                raise CatalogError(
                    f"{scene.source}: {what} {name}: {mass:.6g} kg, but the drives were chosen for "
                    f"{chosen:.6g} kg (`sized`): run `pinfric size --out` again, or take `sized` "
                    "out if these drives are to move it"
                )
