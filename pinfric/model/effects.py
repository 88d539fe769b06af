"""The effects of a scene, and the keys of the file that switch them on.

The dynamics evaluate only the effects that are on: without friction one plain RNEA batch, with
constant friction no wrenches, with bearings the twin, with loops or drives off the joints the
iteration.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from pinfric.errors import SceneError, choose_from
from pinfric.model.friction_terms import TERMS, FrictionTerm
from pinfric.model.loops import loop_place
from pinfric.model.scene import Scene
from pinfric.model.schema import Actuator, Friction, Transmission


@dataclass(frozen=True)
class Effect:
    """One effect of a scene, by its name in `with_effects`.

    `on` says whether the scene contains it, `why` which keys of the scene file switch it on, or
    would.
    """

    name: str
    on: bool
    why: str


@dataclass(frozen=True)
class _Kind:
    """An effect that a friction entry may contain, and that can be removed from it."""

    name: str
    key: str
    present: Callable[[Friction], bool]
    removed: Callable[[Friction], dict[str, Any]]


def _has_load(friction: Friction) -> bool:
    return friction.mu is not None and friction.mu.static > 0


def _bends(friction: Friction) -> bool:
    bearing = friction.bearing
    return _has_load(friction) and bearing is not None and bearing.without_bending() != bearing


def _without_bending(friction: Friction) -> dict[str, Any]:
    assert friction.bearing is not None
    bearing = friction.bearing.without_bending()
    return {"bearing": bearing} if bearing is not None else {"bearing": None, "mu": None}


def _without_static(friction: Friction) -> dict[str, Any]:
    terms = {key: x.without_static() for key, x in friction if isinstance(x, FrictionTerm)}
    return {"stribeck": None} | terms


def _kinds() -> tuple[_Kind, ...]:
    def term(key: str) -> _Kind:
        """The effect of one key of the entry: a term, or the Stribeck curve."""
        return _Kind(key, key, lambda f: bool(getattr(f, key, None)), lambda _: {key: None})

    return (
        _Kind("load", "bearing", _has_load, lambda _: {"bearing": None, "mu": None}),
        _Kind("bending", "bearing.length, bearing.moment", _bends, _without_bending),
        _Kind(
            "static",
            "mu.static, coulomb.static",
            lambda f: any(x.without_static() != x for x in f.terms),
            _without_static,
        ),
        *(term(key) for key in ("stribeck", "coulomb", "viscous", *TERMS)),
    )


def switchable() -> tuple[str, ...]:
    """Return the effects that can be switched, in the order in which they build on each other."""
    return *(kind.name for kind in _kinds()), "transmission", "gear", "payload", "springs"


#: Effects that change motors' torques, but no effort at a joint.
MOTOR_SIDE = ("transmission", "gear")
#: Effects that cannot be switched: they follow from the structure of the mechanism.
STRUCTURAL = ("loops", "couples", "coupling")


def effects(scene: Scene) -> tuple[Effect, ...]:
    """Return a scene's effects, `switchable` and `STRUCTURAL`, with the keys that cause them."""
    listed = []
    for kind in _kinds():
        where = [name for name, friction in scene.friction.items() if kind.present(friction)]
        listed.append(_effect(kind.name, f"friction.{{}}.{kind.key}", where))
    actuators = dict(enumerate(scene.actuators or ()))
    geared = [i for i, actuator in actuators.items() if _lossless(actuator) != actuator]
    ideal = not geared and any(a.transmission is not None for a in actuators.values())
    listed.append(
        Effect("transmission", False, "actuators[].transmission have ratios only, no losses")
        if ideal
        else _listed("transmission", "actuators[{}].transmission", scene, geared)
    )
    lossy = [i for i, actuator in actuators.items() if _unloaded(actuator) != actuator]
    listed.append(_listed("gear", "actuators[{}].transmission.efficiency", scene, lossy))
    listed.append(_effect("payload", "robot.payloads.{}", list(scene.payloads)))
    springs = [f"[{i}] ({spring.name})" for i, spring in enumerate(scene.springs)]
    listed.append(_effect("springs", "springs{}", springs, "springs"))
    loops = [loop_place(scene.loops, loop.name).removeprefix("loops") for loop in scene.loops]
    listed.append(_effect("loops", "loops{}", loops, "loops"))
    coupled = [i for i, actuator in actuators.items() if actuator.couples]
    listed.append(_listed("couples", "actuators[{}].couples", scene, coupled))
    # Loads that depend on friction: with loops or drives off the joints
    loaded = [name for name, friction in scene.friction.items() if _has_load(friction)]
    listed.append(
        Effect("coupling", False, "no loops, no actuators[].cylinder or force, no spring that rubs")
        if scene.linkage is None
        else _effect("coupling", "friction.{}.bearing", loaded)
    )
    return tuple(listed)


def _listed(name: str, key: str, scene: Scene, where: list[int]) -> Effect:
    """An effect of actuators: the place and the drive of the first one."""
    drives = [f"{key.format(i)} ({(scene.actuators or ())[i].drive_name})" for i in where]
    return _effect(name, "{}", drives, key.format(""))


def _effect(name: str, key: str, where: list[str], absent: str = "") -> Effect:
    if not where:
        return Effect(name, False, f"no {absent or key.format('<name>')}")
    first, *others = where
    more = f" and {len(others)} more" if others else ""
    return Effect(name, True, key.format(first) + more)


def with_effects(
    scene: Scene, *, only: Iterable[str] | None = None, without: Iterable[str] | None = None
) -> Scene:
    """Return the scene with `only` some effects, or `without` some, for study.

    Raises:
        SceneError: an unknown effect, or both `only` and `without`.
    """
    if (only is None) == (without is None):
        raise SceneError("with_effects: give either `only` or `without`")
    named = list(only if only is not None else without or ())
    for name in named:
        if name not in switchable():
            raise SceneError(f"with_effects: no effect {name!r}; {choose_from(name, switchable())}")
    off = set(switchable()) - set(named) if only is not None else set(named)
    friction = dict(scene.friction)
    for kind in _kinds():
        if kind.name in off:
            for name, entry in friction.items():
                if kind.present(entry):
                    friction[name] = entry.model_copy(update=kind.removed(entry))
    if "springs" in off:
        friction = {n: x for n, x in friction.items() if n not in {s.name for s in scene.springs}}
    # an empty entry makes no site, so it costs no time
    friction = {name: entry for name, entry in friction.items() if entry.bearing or entry.terms}
    actuators = scene.actuators
    for name, changed in (("gear", _unloaded), ("transmission", _lossless)):
        if name in off and actuators is not None:
            actuators = tuple(changed(actuator) for actuator in actuators)
    return dataclasses.replace(
        scene,
        friction=friction,
        actuators=actuators,
        payloads={} if "payload" in off else scene.payloads,
        springs=() if "springs" in off else scene.springs,
    )


def _unloaded(actuator: Actuator) -> Actuator:
    """The actuator without losses that grow with the load: `efficiency` and `back_efficiency`."""
    gear = actuator.transmission
    if gear is None or not any(any(loss.slopes) for loss in gear.losses()):
        return actuator
    return actuator.model_copy(update={"transmission": gear.without_load_loss()})


def _lossless(actuator: Actuator) -> Actuator:
    """The actuator with its ratio alone, which keeps motor torques comparable."""
    gear = actuator.transmission
    if gear is None or (
        _unloaded(actuator) == actuator
        and not (gear.no_load_torque or gear.motor_viscous or gear.rotor_inertia)
    ):
        return actuator
    return actuator.model_copy(update={"transmission": Transmission(ratio=gear.ratio)})


def uncoupled(scene: Scene) -> Scene:
    """Return the scene without couples: each drive moves its own joint only (efforts differ)."""
    actuators = [a.model_copy(update={"couples": {}}) for a in scene.actuators or ()]
    return scene.with_(actuators=actuators)
