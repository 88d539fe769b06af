"""One stop: the motion from the moment at which the drives react until everything is at rest.

    category 0    power off, T_m = 0; each brake closes after its delay
    category 1    every axis is braked under power; at rest power goes off, brakes close as before,
                  or, if the drives hold until then, brakes close and power goes off

A closed brake is dry friction T_b at the motor's shaft, with the gear's losses; so is a drive that
brakes with all its effort and then holds. Each phase is one simulation with friction. With a stated
deceleration the drives impose v_j - sign(v_j) d_j t, and inverse dynamics gives their efforts.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.drives.demand import driven_joint
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.samples.closure import working_rates
from pinfric.dynamics.simulation.motion import Motion
from pinfric.dynamics.simulation.simulate import simulate, simulate_constant
from pinfric.errors import (
    AccelerationError,
    AmbiguousAcceleration,
    ClosureError,
    PinfricWarning,
    SimulationError,
    StateError,
    StopError,
)
from pinfric.model.closure import velocity_names
from pinfric.model.robot import link_frame
from pinfric.model.scene import Scene
from pinfric.motions.summary import ends_by_magnitude, running_integral
from pinfric.stops.path import Slowed

#: Longest time between samples of a stop, s; more lie before and after every change.
_SAMPLE = 2e-3
#: Tolerances of a stop's simulation (rad, m, and per second).
_RTOL, _ATOL = 3e-7, 1e-9
#: Longest step, s: the simulation looks for events 250 times in four of them.
_LONGEST_STEP = 0.25
#: A stop that takes longer than this (s) does not end; the first piece that is simulated.
LONGEST, _PIECE = 5.0, 0.25
#: Step (s) of time stepping, which passes what the events of a stop cannot, and its time (s).
_STEP, _STEPPED = 2e-4, 0.02
#: Samples of a motion that the drives impose.
_RAMP_SAMPLES = 201


@dataclass(frozen=True, eq=False)
class BrakedMachine:
    """A robot ready to be stopped: its scene with one friction, one load and one set of brakes.

    Attributes:
        scene: brakes open. carried: names of the payloads carried.
        torque: drive -> torque of its brake (N m).
        delay: drive -> time from power-off until its brake holds (s).
        drive_torque: drive -> torque (N m) with which it brakes under power until rest; empty: it
            does not (category 0, or a stated deceleration).
        deceleration: (nv,) of an imposed motion, rad/s^2 or m/s^2; None: none is imposed.
        holds: whether the drives, under power at rest, hold until all brakes have closed.
        products: of `Machines`.
    """

    scene: Scene
    carried: tuple[str, ...]
    torque: Mapping[str, float]
    delay: Mapping[str, float]
    drive_torque: Mapping[str, float]
    deceleration: np.ndarray | None
    holds: bool = False
    products: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def _closed(self) -> dict[tuple[tuple[str, float], ...], Workspace]:
        return {}

    def closed(self, torques: Mapping[str, float]) -> Workspace:
        """Return the workspace of the scene with these torques (N m) holding the shafts."""
        which = tuple(sorted(torques.items()))
        if which not in self._closed:
            scene = self.scene.with_(closed_brakes=dict(torques)) if which else self.scene
            self._closed[which] = Workspace(scene, self.carried, motors=True)
        return self._closed[which]


@dataclass(frozen=True, eq=False)
class StopMotion:
    """A stop (see the module).

    Attributes:
        t: (T,) s, from the drives' reaction; a sample before and one after each change of a brake.
        q, v: (T, nq), (T, nv).
        rate: (T, na) of the drives' joints, rad/s or m/s.
        effort: (T, na) that the gears deliver at the joints (N m or N), the worst end at rest.
        power_off: time at which power goes off (s).
        energy: (na,) that the closed brakes took (J).
        parts: the simulations; an imposed motion is none.
    """

    scene: Scene
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    rate: np.ndarray
    effort: np.ndarray
    power_off: float
    energy: np.ndarray
    parts: tuple[Motion, ...]

    @cached_property
    def travel(self) -> np.ndarray:
        """(T, na) way of each drive's joint, rad or m."""
        return _ways(self.scene, self.t, self.q, self.rate)

    @cached_property
    def rest_time(self) -> np.ndarray:
        """(na,) from when on each drive's joint is at rest, s."""
        last = np.where(self.rate != 0.0, np.arange(len(self.t))[:, None], -1).max(axis=0)
        return self.t[np.minimum(last + 1, len(self.t) - 1)]

    @property
    def after_power_off(self) -> np.ndarray:
        """(na,) way of each drive's joint from power-off to the end, rad or m."""
        return self.travel[-1] - self.travel[self._off]

    @property
    def braking(self) -> np.ndarray:
        """(na,) largest effort of the gears under power, N m or N; in category 0 at the start."""
        return np.abs(self.effort[: self._off + 1]).max(axis=0)

    @property
    def _off(self) -> int:
        """The last sample under power."""
        return int(self.t.searchsorted(self.power_off))


def stop_motion(
    machine: BrakedMachine, q: np.ndarray, v: np.ndarray, slowed: Slowed | None = None
) -> StopMotion:
    """Return the stop from a state (nq,), (nv,) at which the drives react.

    Args:
        slowed: the motion that the drives impose until rest; None: of the machine's deceleration.

    Raises:
        StopError: a joint does not come to rest; names it and what to give. Or the motion cannot be
            simulated, as where a loop comes to a place in which it cannot close.
    """
    rows: list[_Rows] = []
    braked: list[Motion] = []
    if machine.deceleration is not None:
        rows = [_imposed(machine, slowed or _ramps(machine, q, v))]
    elif machine.drive_torque:
        braked = list(_until_rest(machine, machine.drive_torque, q, v, "braked under power"))
        rows = _in_a_row(braked, 0.0)
        rows[-1] = rows[-1].until_rest()
    if rows and machine.holds:
        rows.append(rows[-1].held(max(machine.delay.values(), default=0.0)))
    power_off = float(rows[-1].t[-1]) if rows else 0.0
    if rows:
        q, v = rows[-1].q[-1], np.zeros_like(v)
    coasting = _without_power(machine, q, v)
    rows += _in_a_row(coasting, power_off)
    t, q, v, rate, effort = map(np.concatenate, zip(*rows, strict=True))
    energy = np.sum([_brake_energy(motion) for motion in coasting], axis=0)
    parts = (*braked, *coasting)
    return StopMotion(machine.scene, t, q, v, rate, effort, power_off, energy, parts)


class _Rows(NamedTuple):
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    rate: np.ndarray
    effort: np.ndarray

    def until_rest(self) -> _Rows:
        """Return the samples up to the first from which on all is at rest."""
        moves = np.flatnonzero(self.v.any(axis=1))
        n = min(int(moves[-1]) + 2 if moves.size else 1, len(self.t))
        return _Rows(*(x[:n] for x in self))

    def held(self, time: float) -> _Rows:
        """Return the last sample again, after a time (s)."""
        return _Rows(self.t[-1:] + time, *(x[-1:] for x in self[1:]))


def _in_a_row(parts: Sequence[Motion], begin: float) -> list[_Rows]:
    rows = []
    for part in parts:
        rate = working_rates(part.scene, part.q, part.v)[0]
        rows.append(_Rows(begin + part.t, part.q, part.v, rate, part.effort))
        begin += float(part.t[-1])
    return rows


def _ramps(machine: BrakedMachine, q: np.ndarray, v: np.ndarray) -> Slowed:
    model, d = machine.scene.loaded_model(machine.carried), machine.deceleration
    assert d is not None
    ends = np.abs(v) / d
    times = np.unique([*np.linspace(0.0, ends.max(), _RAMP_SAMPLES), *ends])
    gone = np.minimum(times[:, None], ends)
    speed = v - np.sign(v) * d * gone
    speed[times[:, None] >= ends] = 0.0
    way = v * gone - 0.5 * np.sign(v) * d * gone**2
    a = np.where(times[:, None] < ends, -np.sign(v) * d, 0.0)
    return Slowed(times, np.array([pin.integrate(model, q, step) for step in way]), speed, a)


def _imposed(machine: BrakedMachine, given: Slowed) -> _Rows:
    """A motion that the drives impose, with the efforts that it takes."""
    attached = np.tile([n in machine.carried for n in machine.scene.payloads], (len(given.t), 1))
    with warnings.catch_warnings():  # a slow stop goes far beyond the limits: these are no degrees
        warnings.filterwarnings("ignore", "q: joint .* in degrees", PinfricWarning)
        result = inverse_dynamics(
            machine.scene, given.q, given.v, given.a, attached=attached if attached.size else None
        )
    effort = ends_by_magnitude(result.effort_lower, result.effort_upper)[0]
    rate = working_rates(machine.scene, given.q, given.v)[0]
    return _Rows(given.t, given.q, given.v, rate, effort)


def _without_power(machine: BrakedMachine, q: np.ndarray, v: np.ndarray) -> list[Motion]:
    parts: list[Motion] = []
    t, closed = 0.0, dict(machine.torque) if machine.holds else dict[str, float]()
    for delay in [] if machine.holds else sorted(set(machine.delay.values())):
        parts += _simulate(machine, closed, q, v, delay - t)
        q, v, t = parts[-1].q[-1], parts[-1].v[-1], delay
        closed |= {n: machine.torque[n] for n, after in machine.delay.items() if after == delay}
    return [*parts, *_until_rest(machine, closed, q, v, "without power")]


def _until_rest(
    machine: BrakedMachine, torques: Mapping[str, float], q: np.ndarray, v: np.ndarray, how: str
) -> Iterator[Motion]:
    gone, piece = 0.0, _PIECE
    while gone < LONGEST:
        parts = _simulate(machine, torques, q, v, piece)
        yield from parts
        q, v, gone, piece = parts[-1].q[-1], parts[-1].v[-1], gone + piece, 2.0 * piece
        if not v.any():
            return
    raise StopError(_does_not_stop(machine, torques, v, gone, how))


def _simulate(
    machine: BrakedMachine, torques: Mapping[str, float], q: np.ndarray, v: np.ndarray, time: float
) -> list[Motion]:
    """A time with some brakes closed: by events, past what these cannot by short time stepping."""
    ws, unpowered = machine.closed(torques), np.zeros(len(machine.scene.drives))
    parts, left = list[Motion](), time
    while True:
        try:
            motion = simulate_constant(
                ws,
                q,
                v,
                unpowered,
                left,
                machine.carried,
                rtol=_RTOL,
                atol=_ATOL,
                sample_step=_SAMPLE,
                max_step=_LONGEST_STEP,
            )
            return [*parts, motion]
        # events that accumulate; several answers; a loop that a long step leaves open
        except (SimulationError, AmbiguousAcceleration, ClosureError):
            parts.append(_stepped(ws.scene, machine.carried, q, v, min(left, _STEPPED)))
        q, v, left = parts[-1].q[-1], parts[-1].v[-1], left - _STEPPED
        if left <= 0.0:
            return parts


def _stepped(
    scene: Scene, carried: Sequence[str], q: np.ndarray, v: np.ndarray, time: float
) -> Motion:
    try:
        return simulate(
            scene,
            q,
            v,
            t_end=time,
            method="timestepping",
            motor_torque=np.zeros(len(scene.drives)),
            attached=carried,
            sample_step=_SAMPLE,
            progress=False,
            dt=_STEP,
        )
    except (AccelerationError, ClosureError, SimulationError, StateError) as problem:
        load = f"carrying {', '.join(carried) or 'nothing'}"
        raise StopError(f"{scene.source}: {load}, a stop cannot be simulated: {problem}") from None


def no_brake(products: Mapping[str, str], name: str, place: str) -> str:
    """Say that a drive has no brake.

    Args:
        products: of `Machines`. name: the drive's. place: what lacks it where none was chosen.
    """
    if name in products:
        return f"{name}: {products[name]}, chosen for it, has no brake"
    return f"{place} has no brake"


def _does_not_stop(
    machine: BrakedMachine, torques: Mapping[str, float], v: np.ndarray, gone: float, how: str
) -> str:
    scene = machine.scene
    i = int(np.argmax(np.abs(v)))
    joint = velocity_names(scene.model)[i]
    names = [drive.name for drive in scene.drives if drive.velocity_index == i]
    unit = "m/s" if scene.slides(i) else "rad/s"
    brakes = [f"{torques[name]:g} N m at {name}'s motor" for name in names if name in torques]
    load = f"carrying {', '.join(machine.carried)}" if machine.carried else "carrying nothing"
    moves = f"{joint} still moves at {v[i]:.3g} {unit} {gone:.3g} s after, {load}"
    if brakes:
        cure = f"its brake of {', '.join(brakes)} is too weak: give a stronger one"
    elif names:
        lacks = no_brake(machine.products, names[0], "it")
        cure = (
            f"{lacks}: give actuators ({names[0]}) `transmission.brake: {{torque: N m, "
            "engage_time: s}`, or dry friction that stops it"
        )
    else:
        cure = "no drive moves it: give it friction that stops it, or lock it"
    return f"{scene.source}: {how}, {moves}; {cure}"


def _brake_energy(part: Motion) -> np.ndarray:
    """(na,) T_b |r| times the way of the brakes that are closed, J."""
    closed = part.scene.closed_brakes
    force = [closed.get(drive.name, 0.0) * abs(drive.ratio) for drive in part.scene.drives]
    rate = working_rates(part.scene, part.q, part.v)[0]
    return force * np.abs(np.diff(_ways(part.scene, part.t, part.q, rate), axis=0)).sum(0)


def _ways(scene: Scene, t: np.ndarray, q: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """(T, na) ways of the drives: of places in q, or integrated rates where there is none."""
    way = running_integral(t, rate)
    for d in range(len(scene.drives)):
        if (joint := driven_joint(scene, d)) is not None and scene.model.joints[joint].nq == 1:
            place = q[:, scene.model.joints[joint].idx_q]
            way[:, d] = place - place[0]
    return way


def tool_path(scene: Scene, carried: tuple[str, ...], q: np.ndarray) -> np.ndarray | None:
    """Return the way (T,) of the scene's `tool` along configurations (m), or None without one."""
    if scene.tool is None:
        return None
    model = scene.loaded_model(carried)
    data, frame = model.createData(), link_frame(model, scene.tool)
    moved = np.append(True, (q[1:] != q[:-1]).any(axis=1))  # most of a stop may be at rest
    places = []
    for configuration in q[moved]:
        pin.framesForwardKinematics(model, data, configuration)
        places.append(data.oMf[frame].translation.copy())
    steps = np.linalg.norm(np.diff(np.array(places)[np.cumsum(moved) - 1], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
