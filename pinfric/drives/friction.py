"""Whose friction it is: the joint's own, or its old drive's, which another drive does not have."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from pinfric.model.bearings import Gear
from pinfric.model.friction_terms import DirectedCoulombFriction
from pinfric.model.scene import Scene
from pinfric.model.schema import guesses_left


def drive_friction(scene: Scene) -> dict[str, dict[str, str]]:
    """Return what of the friction is the drives', not the joints' own: joint -> key -> why.

    Coulomb and viscous friction that a starting scene guessed ("guessed": by what motors of a
    UR10e draw), that was measured on the motor's side ("measured by motor currents"), or beside
    which `includes_drive` stands; and what its gear loses. Another drive brings its own losses.
    """
    guesses = {} if scene.assumed is None else scene.assumed.values
    by_motors = scene.measured is not None and scene.measured.side == "motor"
    reasons = {}
    for name, entry in scene.friction.items():
        why = {
            key: "guessed"
            if f"friction.{name}.{key}" in guesses
            else "measured by motor currents"
            if by_motors
            else "lost in the gear"
            if key == "mu"
            else "with `includes_drive`" * entry.includes_drive
            for key, term in entry
            if (key in ("coulomb", "viscous") or (key == "mu" and isinstance(entry.bearing, Gear)))
            and term
        }
        reasons[name] = {key: text for key, text in why.items() if text}
    return {name: why for name, why in reasons.items() if why}


def without_drives(scene: Scene, names: Collection[str]) -> Scene:
    """Return the scene without the `drive_friction` of the named drives."""
    sites = sites_of(scene, names)
    changed = {
        name: (entry := scene.friction[name]).model_copy(
            update={key: getattr(entry, key).scaled(0.0) for key in keys}
        )
        for name, keys in drive_friction(scene).items()
        if name in sites
    }
    if not changed:
        return scene
    friction = {**scene.friction, **changed}
    assumed = scene.assumed and guesses_left(scene.assumed, scene.friction, friction)
    return replace(scene, friction=friction, assumed=assumed)


def sites_of(scene: Scene, names: Collection[str]) -> set[str]:
    """Return the names of the named drives' friction: mostly their joints'."""
    if scene.actuators is None:
        return set(names)
    return {a.joint or a.drive_name for a in scene.actuators if a.drive_name in names}


def own_friction(scene: Scene, name: str) -> float:
    """Return the dry friction of a joint that is known to be its own, N m or N, moving.

    The lesser of both directions, without `drive_friction` and without what grows with the load:
    rolling bearings hold nothing reliable.
    """
    term = scene.friction[name].coulomb if name in scene.friction else None
    if term is None or "coulomb" in drive_friction(scene).get(name, {}):
        return 0.0
    if isinstance(term, DirectedCoulombFriction):
        return min(term.positive.kinetic, term.negative.kinetic)
    return float(term.kinetic)
