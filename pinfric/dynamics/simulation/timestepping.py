"""Simulation by time stepping: fixed steps, friction as implicit impulses.

Moreau's midpoint scheme (Moreau 1988; Jean 1999):

    q_m = q + dt/2 v,    v' = v + dt a_free(q_m, v) + dt a_slope x,    q' = q_m + dt/2 v'

where x obeys the friction laws at the *end* of the step: a coordinate sticks if an x within the
static limits brings it to v' = 0 exactly, else it slips against x. This is the problem of an
instant with the next velocity in place of the acceleration. First order; stable with friction at
any step; sticking joints are exactly at rest. Drag also acts at the end of the step
(`accelerations._add_drag`), efforts at its middle: those that depend on q need a step below 2/omega
of the oscillation that they cause. Steps end where an effort or its slope jumps.

A step that ends at exactly zero velocity is a stop only if static friction holds the joint at that
instant; otherwise the motion reverses. Friction that builds up over a way: see `build_up`.

Where self-locking gears in motion leave no acceleration (`friction/gears.py`) a step may have an
answer, in which the rotor stops with a jump. It is refused, too: what moves then depends on the
damping of the shafts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin

from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.simulation.build_up import BuildUp
from pinfric.dynamics.simulation.integration import begin, standing
from pinfric.dynamics.simulation.recorder import Recorder
from pinfric.dynamics.simulation.system import Settings, System
from pinfric.errors import AccelerationError, GearJam
from pinfric.friction.problem import Modes, SearchOutcome

#: What comes to rest in a step from more than so many times its deceleration jumps.
_JUMP = 2.0


def step_through(
    system: System, settings: Settings, record: Recorder, q: np.ndarray, v: np.ndarray
) -> None:
    """Step from t = 0 to the end into the record.

    Args:
        system, settings, record: of this simulation; `dt` is shortened to divide each piece between
            breakpoints.
        q, v: (nq,), (nv,) at the start.

    Raises:
        NoConsistentAcceleration: a step has no solution: it jams.
        GearJam: see the module.
    """
    ws, model = system.ws, system.ws.scene.loaded_model()
    try:
        q, v = begin(system, record, q, v)
    except AccelerationError as problem:
        v = _begin_with_a_step(system, settings, record, (q, v), problem)
    before, since, build_up = ws.modes.copy(), 0.0, BuildUp(ws)
    build_up.note(ws)
    for t, end, dt in _steps(system, settings):
        start, since = q, since + dt
        middle = pin.integrate(model, q, 0.5 * dt * v)
        system.assemble(t + 0.5 * dt, middle, v, dt)
        rates, rests = ws.constraints.rates(middle, v), ws.plan.coordinates.dry
        if not ws.has_one_answer():
            before, rests = _at_instant(system, t, dt, (middle, v), rates)
        build_up.add(ws, dt)
        outcome = _solve_step(ws, rates, before, rests)
        if outcome != SearchOutcome.SOLVED:
            raise ws.failures.failure(outcome, ws.state).at(t)
        build_up.note(ws)
        stands = ws.modes.stuck & ~build_up.builds
        stopped = bool((stands & ~before.stuck).any())
        ws.finish()
        a = ws.accelerations()
        ws.check_held(a)
        v = v + dt * a
        v = ws.constraints.project(middle, v, stands)[1]
        q = pin.integrate(model, middle, 0.5 * dt * v)
        # v obeys the loops at the middle; made to obey them here it would lack half their impulse
        q, at_end = ws.constraints.project(q, v, stands)
        if end < settings.t_end:
            system.control(end, q, at_end)
        if stopped and not build_up.builds.any():  # else the next step decides
            _hold_or_turn(system, end, q, at_end, before)
        ws.constraints.hold_position(q, stands)
        turned = (ws.modes.direction * before.direction < 0.0) & ~ws.plan.coordinates.ball
        # what came to rest did so at the step's end, what left at its start
        record.changes(end if stopped else t, before, turned)
        before = ws.modes.copy()
        record.watch_limits(t, end, _between(model, t, dt, start, q))
        due = max(1, round(settings.sample_step / dt)) * dt
        if since >= due * (1.0 - 1e-9) or end == settings.t_end:
            since = 0.0
            if not build_up.builds.any():  # else the sample has the step's own accelerations
                system.solve_given_modes(end, q, at_end, before.kept())
            record.sample(end, q, at_end)
        record.progress(end)


def _at_instant(
    system: System,
    t: float,
    dt: float,
    state: tuple[np.ndarray, np.ndarray],
    rates: np.ndarray,
) -> tuple[Modes, np.ndarray]:
    """Return the modes of a step's instant, and which coordinates may rest at its end (nc,).

    Args:
        t, dt, state: the step's start and length (s), the state at which it is assembled.
        rates: (nc,) relative velocities.

    Raises:
        GearJam: see the module.
    """
    ws, (q, v) = system.ws, state
    try:
        ws.solve(q, v, system.u, system.applied)
    except AccelerationError as problem:
        raise problem.at(t) from None
    modes = ws.modes.copy()
    slows = np.abs(rates) <= -_JUMP * dt * modes.rate * np.sign(rates)
    ws.assemble(q, v, system.u, system.applied, dt)
    return modes, ws.plan.coordinates.dry & (modes.at_rest | slows)


def _begin_with_a_step(
    system: System,
    settings: Settings,
    record: Recorder,
    state: tuple[np.ndarray, np.ndarray],
    problem: AccelerationError,
) -> np.ndarray:
    """Record t = 0 where there is no acceleration, or several, with the first step's friction.

    Returns v, see `begin`.

    Raises:
        AccelerationError: `problem`, where a step has no solution either, or a gear jams.
    """
    ws, q = system.ws, state[0]
    many, stable = ws.count.many
    if isinstance(problem, GearJam) or stable != many:
        raise problem
    v, modes = standing(ws, *state), ws.modes
    rates = ws.constraints.rates(q, v)
    modes.stuck[:] = ws.plan.coordinates.dry & (ws.mechanism.speeds(rates) == 0.0)
    modes.direction[:] = np.where(modes.stuck, 0.0, np.sign(rates))
    modes.direction[:] = ws.mechanism.slip_direction(modes, rates)
    system.assemble(0.0, q, v, next(_steps(system, settings))[2])
    if _solve_step(ws, rates, modes.copy(), ws.plan.coordinates.dry) != SearchOutcome.SOLVED:
        raise problem
    ws.finish()
    record.phase(0.0)
    record.sample(0.0, q, v)
    return v


def _steps(system: System, settings: Settings) -> Iterator[tuple[float, float, float]]:
    """Yield start, end and length (s) of the steps between breakpoints."""
    for first, last, _ in system.pieces(settings.t_end):
        steps = max(1, int(np.ceil((last - first) / settings.dt - 1e-9)))
        dt = (last - first) / steps
        for k in range(steps):
            yield first + k * dt, first + (k + 1) * dt if k + 1 < steps else last, dt


def _between(
    model: pin.Model, t: float, dt: float, start: np.ndarray, end: np.ndarray
) -> Callable[[float], np.ndarray]:
    """Time -> configuration within a step."""
    return lambda time: np.asarray(pin.interpolate(model, start, end, (time - t) / dt))


def _solve_step(
    ws: Workspace, rates: np.ndarray, before: Modes, rests: np.ndarray
) -> SearchOutcome:
    """Find the modes at a step's end, from those before it; `rests` (nc,): what may rest."""
    modes, dry = ws.modes, ws.plan.coordinates.dry
    modes.at_rest[:] = rests
    modes.stuck[:] = before.stuck
    # where there is no dry friction there is no mode: the direction only says which way it moves
    modes.direction[:] = np.where(dry, before.direction, np.sign(rates))
    return ws.search_step()


def _hold_or_turn(system: System, t: float, q: np.ndarray, v: np.ndarray, before: Modes) -> None:
    """Let what a step brought to rest stick only if static friction holds it at the step's end."""
    ws = system.ws
    stopped = ws.modes.copy()
    ws.modes.at_rest[:] = ws.modes.stuck
    system.assemble(t, q, v)
    if ws.search(held=before.stuck) != SearchOutcome.SOLVED:
        ws.modes.take(stopped)  # the next step decides
    ws.finish()
