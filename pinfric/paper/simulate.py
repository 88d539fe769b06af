"""Simulation of stick and slip in absolute coordinates, for the paper's forward curves.

Joint positions and rates are integrated; absolute coordinates and speeds are computed from them at
every evaluation, so there is no drift. Guards are located here, not by SciPy's event search, which
fires again when restarted exactly on a guard.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DOP853, OdeSolution
from scipy.optimize import brentq

from pinfric.errors import PinfricError
from pinfric.paper.bodies import Array, Mechanism
from pinfric.paper.forward import (
    AbsoluteInstant,
    Modes,
    NoConsistentFriction,
    find_modes,
    forward,
    prepare,
)

MOST_EVENTS = 1000
GUARD_POINTS = 4  # looks at each guard within one step of the integration


@dataclass(frozen=True, eq=False)
class Phase:
    """A time in which no joint changes between stick and slip."""

    start: float  # s
    end: float  # s
    modes: Modes  # (ns,)
    solution: OdeSolution  # time s -> positions and rates (2 nj,)


@dataclass(frozen=True, eq=False)
class AbsoluteMotion:
    """A simulated motion; where modes change there are two samples, before and after.

    `sample(t)` gives the instant and the state at any time.
    """

    mechanism: Mechanism
    phases: tuple[Phase, ...]
    drive: Callable[[float], ArrayLike]
    t: Array  # (T,) s
    position: Array  # (T, nj) rad or m
    rate: Array  # (T, nj) rad/s or m/s
    acceleration: Array  # (T, nj) rad/s^2 or m/s^2
    effort: Array  # (T, na)
    modes: Modes  # (T, ns)
    friction: Array  # (T, ns) N m or N
    normal_load: Array  # (T, ns) N m or N
    evaluations: int  # right-hand sides computed

    def stick_intervals(self, joint: str) -> list[tuple[float, float]]:
        """Start and end (s) of each time a joint with friction sticks."""
        sites = [self.mechanism.joints[k].name for k in self.mechanism.geometry.sites]
        if joint not in sites:
            raise PinfricError(f"no joint with friction is called {joint!r}, but {sites} are")
        intervals: list[tuple[float, float]] = []
        for phase in self.phases:
            if phase.modes[sites.index(joint)] == 0:
                start = phase.start
                if intervals and intervals[-1][1] == start:
                    start = intervals.pop()[0]
                intervals.append((start, phase.end))
        return intervals

    def sample(self, time: float) -> tuple[Array, Array, AbsoluteInstant]:
        """Positions and rates (nj,) and the instant at a time s; at a change those after it."""
        if not self.phases[0].start <= time <= self.phases[-1].end:
            raise PinfricError(f"the motion does not contain t = {time} s")
        phase = next(p for p in reversed(self.phases) if p.start <= time)
        return _sample(self.mechanism, phase, self.drive, time)


def _sample(
    mechanism: Mechanism, phase: Phase, drive: Callable[[float], ArrayLike], time: float
) -> tuple[Array, Array, AbsoluteInstant]:
    position, rate = np.split(phase.solution(time), 2)
    rate[mechanism.geometry.sites[phase.modes == 0]] = 0.0
    return position, rate, forward(mechanism, position, rate, drive(time), phase.modes)


def simulate(
    mechanism: Mechanism,
    position: ArrayLike,
    rate: ArrayLike,
    effort: Callable[[float], ArrayLike],
    t_end: float,
    rtol: float = 1e-10,
    atol: float = 1e-12,
    max_step: float = 0.05,
    sample_step: float = 2e-3,
) -> AbsoluteMotion:
    """Integrate a motion from t = 0 with stick and slip changing at located instants.

    Accelerations are from (3) by `forward`; guards are mode x rate = 0 for a joint that slips and
    mu_s N - |friction| = 0 for one that sticks, located on the integrator's dense output.

    Args:
        mechanism: bodies, joints, gravity and actuators; no loops.
        position, rate: (nj,) rad or m, and per second, at t = 0.
        effort: time s -> (na,) N m.
        t_end: s.
        rtol: relative tolerance of the Dormand-Prince 8(5,3) steps.
        atol: absolute tolerance, rad, m and per second.
        max_step: s; guards are evaluated four times in each step.
        sample_step: s between the samples of the result.

    Raises:
        NoConsistentFriction: with time and state, where neither stick nor slip is consistent.
        PinfricError: the mechanism has loops, whose joints' positions would drift apart.

    Source: the paper, (3), (20), (21); Wu, Yang, Haug 1984.
    """
    if mechanism.loops:
        raise PinfricError("simulate: takes mechanisms without loops")
    state = np.concatenate([np.asarray(position, float), np.asarray(rate, float)])
    run = _Run(mechanism, effort, rtol, atol, max_step)
    modes = run.modes_at_start(0.0, state)
    time, phases = 0.0, []
    while True:
        phase, event = run.phase(time, state, modes, t_end)
        phases.append(phase)
        if event is None:
            break
        if len(phases) >= MOST_EVENTS:
            raise PinfricError(f"more than {MOST_EVENTS} mode changes up to t = {phase.end:.6g} s")
        time = phase.end
        state, modes = run.change(time, phase.solution(time), phase.modes, event)
    return _sampled(run, tuple(phases), sample_step)


def _sampled(run: _Run, phases: tuple[Phase, ...], sample_step: float) -> AbsoluteMotion:
    rows = []
    for phase in phases:
        count = 2 + int((phase.end - phase.start) / sample_step)
        for time in np.linspace(phase.start, phase.end, count):
            rows.append((time, *_sample(run.mechanism, phase, run.drive, time)))
    instants = [row[3] for row in rows]
    return AbsoluteMotion(
        mechanism=run.mechanism,
        phases=phases,
        drive=run.drive,
        t=np.array([row[0] for row in rows]),
        position=np.array([row[1] for row in rows]),
        rate=np.array([row[2] for row in rows]),
        acceleration=np.array([i.acceleration for i in instants]),
        effort=np.array([np.asarray(run.drive(row[0]), float) for row in rows]),
        modes=np.array([i.modes for i in instants]),
        friction=np.array([i.friction for i in instants]),
        normal_load=np.array([i.normal_load for i in instants]),
        evaluations=run.evaluations,
    )


class _Run:
    """One simulation."""

    def __init__(
        self,
        mechanism: Mechanism,
        drive: Callable[[float], ArrayLike],
        rtol: float,
        atol: float,
        max_step: float,
    ) -> None:
        self.mechanism, self.drive = mechanism, drive
        self.tolerances = {"rtol": rtol, "atol": atol, "max_step": max_step}
        self.sites = mechanism.geometry.sites
        self.joints = len(mechanism.joints)
        self.evaluations = 0

    def instant(self, time: float, y: Array, modes: Modes) -> AbsoluteInstant:
        """The instant in given modes, with sticking joints exactly at rest."""
        self.evaluations += 1
        rate = y[self.joints :].copy()
        rate[self.sites[modes == 0]] = 0.0
        try:
            return forward(self.mechanism, y[: self.joints], rate, self.drive(time), modes)
        except NoConsistentFriction as error:
            raise NoConsistentFriction(
                time, error.position, error.rate, error.effort, []
            ) from error

    def derivative(self, time: float, y: Array, modes: Modes) -> Array:
        """Of positions and rates (2 nj,)."""
        acceleration = self.instant(time, y, modes).acceleration.copy()
        acceleration[self.sites[modes == 0]] = 0.0  # not their rounding errors
        return np.concatenate([y[self.joints :], acceleration])

    def guards(self, time: float, y: Array, modes: Modes) -> Array:
        """(ns,) not negative while the modes hold."""
        values = modes * y[self.joints + self.sites]
        if np.any(modes == 0):
            instant = self.instant(time, y, modes)
            limit = self.mechanism.geometry.static * instant.normal_load
            values = np.where(modes == 0, limit - np.abs(instant.friction), values)
        return values

    def modes_at_start(self, time: float, y: Array) -> Modes:
        """The modes of the first phase; rates of joints that stick become exactly zero in y."""
        position, rate = np.split(y, 2)
        try:
            instant = forward(self.mechanism, position, rate, self.drive(time))
        except NoConsistentFriction as error:
            raise NoConsistentFriction(
                time, error.position, error.rate, error.effort, error.consistent
            ) from error
        y[self.joints + self.sites[instant.modes == 0]] = 0.0
        return instant.modes

    def phase(self, start: float, y: Array, modes: Modes, t_end: float) -> tuple[Phase, int | None]:
        """Integrate to the first guard that gives way, which is returned (None: to t_end)."""
        solver = DOP853(
            lambda t, z: self.derivative(t, z, modes), start, y, t_end, **self.tolerances
        )
        times, pieces = [start], []
        before = self.guards(start, y, modes)
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                raise PinfricError(f"integration failed at t = {solver.t:.6g} s: {message}")
            piece = solver.dense_output()
            pieces.append(piece)
            looks = np.linspace(times[-1], solver.t, GUARD_POINTS + 1)
            for early, late in itertools.pairwise(looks):
                after = self.guards(late, piece(late), modes)
                if np.any(after < 0):
                    located = [
                        (self.locate(piece, early, late, modes, site, before), site)
                        for site in np.flatnonzero(after < 0).tolist()
                    ]
                    end, event = min(located)
                    end = max(end, np.nextafter(times[-1], np.inf))
                    return Phase(start, end, modes, OdeSolution([*times, end], pieces)), event
                before = after
            times.append(solver.t)
        return Phase(start, t_end, modes, OdeSolution(times, pieces)), None

    def locate(
        self,
        piece: Callable[[float], Array],
        early: float,
        late: float,
        modes: Modes,
        site: int,
        before: Array,
    ) -> float:
        """The instant in (early, late] where a site's guard, negative at late, leaves zero.

        A guard that starts from zero (a slip that has just begun) must rise first: the search goes
        back to where it is positive. One that never rises gives way at once, at early.
        """
        if before[site] <= 0:
            for _ in range(50):
                middle = early + (late - early) / 2
                if self.guards(middle, piece(middle), modes)[site] > 0:
                    early = middle
                    break
                late = middle
            else:
                return early
        return brentq(
            lambda t: self.guards(t, piece(t), modes)[site], early, late, xtol=1e-15, rtol=1e-14
        )

    def change(self, time: float, y: Array, modes: Modes, event: int) -> tuple[Array, Modes]:
        """State and modes after the guard of a site gave way.

        Another guard at zero at this instant gives way at once in the new phase.
        """
        y, at_rest, free, trial = y.copy(), modes == 0, modes == 0, modes.copy()
        at_rest[event] = True
        y[self.joints + self.sites[at_rest]] = 0.0
        free[event] = modes[event] != 0
        if modes[event] == 0:  # released: friction opposes the slip it could not prevent
            trial[event] = -np.sign(self.instant(time, y, modes).friction[event])
        position, rate = np.split(y, 2)
        state = prepare(self.mechanism, position, rate, np.asarray(self.drive(time), float))
        return y, find_modes(state, trial, free, at_rest, (time, position, rate)).modes
