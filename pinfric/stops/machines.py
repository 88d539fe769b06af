"""What is stopped: the scene with least or greatest friction, its brakes, and a load."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pinfric.drives.policy import STOP_FACTOR
from pinfric.errors import StopError, choose_from
from pinfric.model.scene import Scene
from pinfric.model.schema import Stops
from pinfric.motions.trajectory import Trajectory
from pinfric.stops.motion import LONGEST, BrakedMachine

#: An effort limit from here on (N m or N) is none: Pinocchio has the largest number.
UNLIMITED = 1e300


class MachineKind(NamedTuple):
    """Which machine is stopped.

    Attributes:
        greatest: friction and brakes at their greatest, else at their least.
        load: share of the full payload, 0 to 1.
    """

    greatest: bool
    load: float


@dataclass(frozen=True)
class Machines:
    """The machines of one scene, made at first use.

    Attributes:
        settings: how it is stopped.
        full: names of the payloads that make the full load.
        products: drive -> what was chosen for it; the scene's own drives have none.
        reserve: factor on the peaks that gears must bear.
    """

    scene: Scene
    settings: Stops
    full: tuple[str, ...]
    products: Mapping[str, str] = field(default_factory=dict)
    reserve: float = STOP_FACTOR
    _made: dict[MachineKind, BrakedMachine] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check(self.scene, self.settings)

    def of(self, kind: MachineKind) -> BrakedMachine:
        """Return a machine."""
        if kind not in self._made:
            self._made[kind] = _machine(self, kind)
        return self._made[kind]

    @cached_property
    def deceleration(self) -> np.ndarray | None:
        """(nv,) of a motion that the drives impose, rad/s^2 or m/s^2; None: they impose none."""
        settings, drives = self.settings, self.scene.drives
        if settings.category == 0 or not settings.deceleration:
            return None
        most = np.zeros(self.scene.model.nv)
        for drive in drives:
            most[drive.velocity_index] = settings.deceleration[drive.name]
        return most


def stop_settings(scene: Scene, category: int | None) -> Stops:
    """Return how a scene is stopped.

    Args:
        category: in place of that of the scene's `stops`; None: that one.

    Raises:
        StopError: the scene has no `stops`.
    """
    stops = scene.stops
    if stops is None:
        raise StopError(
            f"{scene.source}: has no `stops` section, and the reaction time cannot be known; add "
            "`stops: {category: 0, reaction_time: 0.02}` with your controller's figures"
        )
    if category is None or category == stops.category:
        return stops
    if category not in (0, 1):
        raise StopError(f"category {category!r}: should be 0 or 1 (IEC 60204-1)")
    powered = {} if category == 1 else {"deceleration": {}, "power_until_braked": False}
    return stops.model_copy(update={"category": category, **powered})


def full_load(scene: Scene, trajectory: Trajectory) -> tuple[str, ...]:
    """Return the payloads carried where a trajectory carries most mass."""
    names = trajectory.payload_names
    mass = trajectory.attached @ np.array([scene.payloads[name].mass for name in names])
    heaviest = trajectory.attached[int(np.argmax(mass))] if len(names) else ()
    return tuple(name for name, on in zip(names, heaviest, strict=True) if on)


def carried_by(machines: Machines, load: float, samples: int) -> np.ndarray | None:
    """Return (T, number of payloads) which are carried at a share of the full load; None: none."""
    names = machines.scene.payloads
    if not names:
        return None
    return np.tile([load > 0.0 and name in machines.full for name in names], (samples, 1))


def check_brakes(scene: Scene) -> None:
    """Refuse what a simulated stop needs and the scene lacks.

    Raises:
        StopError: a drive has no transmission, or a brake no `engage_time`, or one that is absurd.
    """
    for drive in scene.drives:
        where = f"{scene.source}: actuators ({drive.name})"
        gear = drive.transmission
        if gear is None:
            raise StopError(
                f"{where}: has no `transmission`, and a brake acts at a motor's shaft; give ratio, "
                "losses, rotor_inertia and brake (a direct drive has `ratio: 1`)"
            )
        if gear.brake is None:
            continue
        delay, key = gear.brake.engage_time, f"{where}.transmission.brake"
        if delay is None:
            raise StopError(
                f"{key}: has no `engage_time`; give the time (s) from power-off until it holds, as "
                "its maker states it"
            )
        if delay > LONGEST:
            raise StopError(
                f"{key}: engage_time is {delay:g} s; should be at most {LONGEST:g} s (30 ms is "
                "0.03)"
            )


def _check(scene: Scene, settings: Stops) -> None:
    if settings.category == 0 or not settings.deceleration:
        return
    where, names = f"{scene.source}: stops.deceleration", scene.actuator_names
    for name in settings.deceleration:
        if name not in names:
            raise StopError(f"{where}: there is no drive {name!r}; {choose_from(name, names)}")
    if missing := [name for name in names if name not in settings.deceleration]:
        raise StopError(f"{where}: has no value for {', '.join(missing)}; give one for each drive")
    if not scene.one_drive_each:
        raise StopError(
            f"{where}: needs an open chain with one drive on each joint: elsewhere drives and "
            "joints do not slow down one by one; leave it out to brake by the effort limits"
        )


def _machine(machines: Machines, kind: MachineKind) -> BrakedMachine:
    scene, settings = machines.scene, machines.settings
    brakes = {
        d.name: d.transmission.brake
        for d in scene.drives
        if d.transmission is not None and d.transmission.brake is not None
    }
    by_limits = settings.category == 1 and not settings.deceleration
    return BrakedMachine(
        scene=with_loads(scene, settings.friction[kind.greatest], kind.load),
        carried=machines.full if kind.load > 0.0 else (),
        torque={
            name: brake.greatest if kind.greatest else brake.torque
            for name, brake in brakes.items()
        },
        delay={name: float(brake.engage_time or 0.0) for name, brake in brakes.items()},
        drive_torque=dict(_limits(scene)) if by_limits else {},
        deceleration=machines.deceleration,
        holds=settings.power_until_braked,
        products=machines.products,
    )


def _limits(scene: Scene) -> Iterator[tuple[str, float]]:
    """Drive -> torque at the shaft with which it brakes: the URDF's effort limit / |ratio|."""
    for drive in scene.drives:
        i = drive.velocity_index
        limit = float(scene.model.effortLimit[i]) if i >= 0 else 0.0
        if not 0.0 < limit < UNLIMITED:
            raise StopError(
                f"{scene.source}: actuators ({drive.name}): the URDF has no effort limit of its "
                "joint, by which category 1 could brake it; give `stops.deceleration`"
            )
        yield drive.name, limit / abs(drive.ratio)


def with_loads(scene: Scene, factor: float, load: float) -> Scene:
    """Return a scene with scaled friction and losses, and a share of its payloads."""
    change: dict[str, object] = {}
    if factor != 1.0:
        change["friction"] = {name: f.scaled(factor) for name, f in scene.friction.items()}
        # whose friction it is does not change
        change |= {"measured": scene.measured, "assumed": scene.assumed}
        change["actuators"] = scene.actuators and [
            a
            if a.transmission is None
            else a.model_copy(update={"transmission": a.transmission.with_losses(factor)})
            for a in scene.actuators
        ]
    if load not in (0.0, 1.0):
        change["payloads"] = {name: p.scaled(load) for name, p in scene.payloads.items()}
    return scene.with_(**change) if change else scene
