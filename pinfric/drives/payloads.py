"""Payloads whose inertia is not given: cubes of water, a guess.

A point of mass m becomes a cube of density 1000 kg/m^3,

    s = (m/rho)^(1/3),      I = m s^2/6 about each axis through its centre of mass.

A body may ask less of a joint than its point: a load that swings down by itself needs no torque. As
a guess may make drives heavier and never lighter, they are held against both.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from pinfric.model.scene import Scene
from pinfric.model.schema import Payload

#: Density of water, kg/m^3: most of what robots carry is less dense on the whole, and so larger.
_WATER = 1000.0


def points(scene: Scene) -> tuple[str, ...]:
    """Return the names of the payloads whose inertia is not given."""
    return tuple(name for name, load in scene.payloads.items() if load.inertia is None)


def with_bodies(scene: Scene) -> Scene:
    """Return the scene with a cube of water for each payload whose inertia is not given."""
    if not (names := points(scene)):
        return scene
    bodies = {name: _cube(scene.payloads[name]) for name in names}
    return replace(scene, payloads={**scene.payloads, **bodies})


def guessed_bodies(scene: Scene, names: Iterable[str]) -> dict[str, str]:
    """Return the entries of a scene that `with_bodies` guessed of some payloads, and why."""
    said = {}
    for name in names:
        load = scene.payloads[name]
        said[f"robot.payloads.{name}.inertia"] = (
            f"a cube of water {_side(load):.3g} m wide, {_moment(load):.3g} kg m^2"
        )
    return said


def _side(load: Payload) -> float:
    return float((load.mass / _WATER) ** (1.0 / 3.0))


def _moment(load: Payload) -> float:
    return load.mass * _side(load) ** 2 / 6.0


def _cube(load: Payload) -> Payload:
    moment = _moment(load)
    return load.model_copy(update={"inertia": (moment, 0.0, 0.0, moment, 0.0, moment)})
