"""Simulation with located events: the reference among the three methods.

SciPy's Dormand-Prince 8(5,3), at loose tolerances its 5(4), integrates while no joint changes its
mode. Guards are evaluated on its polynomials: the velocity of slipping joints, the distance of
sticking joints' friction from its static limits. Where one reaches zero, the modes are searched
again and the integration restarts. A robot at rest under constant efforts is not integrated.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pinfric.dynamics.simulation.crossing import first_crossing
from pinfric.dynamics.simulation.integration import Integration, begin
from pinfric.dynamics.simulation.recorder import Recorder, along
from pinfric.dynamics.simulation.system import Settings, System, finite
from pinfric.errors import AccelerationError, SimulationError
from pinfric.friction.problem import SearchOutcome

#: From this relative tolerance on a method of order 5 needs fewer right-hand sides than one of 8.
_LOOSE = 1e-7
#: Least number of looks at the guards within a step, both ends included, and in the whole time.
_LOOKS, _ALL_LOOKS = 6, 250
#: Instants closer than this, relative to the time, are one.
_SAME_TIME = 1e-12
#: So many events within `_CROWDED` of the whole time are an accumulation.
_MANY, _CROWDED = 60, 1e-9
#: Beyond a limit by this part of its width is no rounding any more.
_CLEARLY = 1e-9
#: Shortest step (s, relative to the time) at which an inconsistent right-hand side is believed.
_SHORTEST = 1e-12


class EventIntegration(Integration):
    """One simulation with located events.

    Attributes:
        t, y: time (s) and state (2 nv,).
        forward: (nc,) direction of slip, in which each coordinate's speed is watched.
        allowance: (nc,) how far a guard that was just handled may stay below zero.
        changed: (nc,) time (s) of each coordinate's last change of mode.
        recent: times (s) of all changes.
        _guards_now: (1, nc) guards at the present state; (0, nc): not known.
    """

    def __init__(self, system: System, settings: Settings, record: Recorder) -> None:
        super().__init__(system, settings, record)
        self.nc = len(self.ws.plan.coordinates.dry)
        self.t, self.y = 0.0, np.zeros(0)
        self.forward = np.zeros(self.nc)
        self.allowance = np.zeros(self.nc)
        self.changed = np.full(self.nc, -np.inf)
        self.recent: list[float] = []
        self._guards_now = np.zeros((0, self.nc))

    def run(self, q: np.ndarray, v: np.ndarray) -> None:
        """Integrate from t = 0 into the record.

        Args:
            q, v: (nq,), (nv,) at the start; coordinates at rest get exactly 0 velocity.
        """
        self.y = self.start(*begin(self.system, self.record, q, v))
        self.given = self.ws.modes.kept()
        self._allow()
        first_step: float | None = None
        for end in self.ends():
            self.system.control(self.t, *self.state(self.y))
            self._guards_now = self._guards_now[:0]  # efforts may have jumped
            if self.t > 0.0 and self.record.rows[-1][0] == self.t:
                self._sample_now()  # what holds after the breakpoint
            while self.t < end:
                first_step = self._smooth(end, first_step)
        self._sample_now()

    def _sample_now(self) -> None:
        q, v = self.state(self.y)
        self.system.solve_given_modes(self.t, q, v, self.given)
        self.record.sample(self.t, q, v)

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return a (nv,) in the present modes."""
        if self.ws.locked and not v.any():
            return np.zeros(self.ws.nv)
        return self.system.solve_given_modes(t, q, v, self.given)

    def _smooth(self, end: float, first_step: float | None) -> float | None:
        """Integrate to `end`, a change of modes or of the chart; return the next step's length."""
        from scipy.integrate import DOP853, RK45

        if self._rests():
            self._rest(end)
            return None
        if first_step is not None:
            first_step = min(first_step, end - self.t)
        method = DOP853 if self.settings.rtol < _LOOSE else RK45
        with finite(self.t):
            solver = method(
                self.rhs,
                self.t,
                self.y,
                end,
                rtol=self.settings.rtol,
                atol=self.settings.atol,
                max_step=self.settings.max_step,
                first_step=first_step,
            )
        longest = self.settings.max_step
        while solver.status == "running":
            self._step(solver)
            polynomial = solver.dense_output()
            event = self._first_event(solver.t_old, solver.t, polynomial)
            stop = solver.t if event is None else event[0]
            self._keep_step(solver.t_old, stop, polynomial)
            if event is not None:
                self.t = stop
                self.y = solver.y.copy() if stop == solver.t else polynomial(stop)
                self._change_modes(event[1])
                return None
            self.t, self.y = solver.t, solver.y.copy()
            self.allowance[self._guards_now[-1] >= 0.0] = 0.0
            if self.linked:  # what the integration leaves open is closed: no drift
                self.y = self.projected(self.y)
                solver.y, solver.f = self.y.copy(), self.rhs(solver.t, self.y)
                self._watch()
            solver.max_step = min(longest, 2.0 * solver.max_step)
            if self.chart.is_far(self.y[: self.ws.nv]):
                self.chart, self.y[: self.ws.nv] = self.chart.moved(self.y[: self.ws.nv])
                break
        return float(solver.h_abs)  # what the next step would be

    def _rests(self) -> bool:
        """Whether nothing moves, and constant efforts let nothing move later."""
        constant = self.system.effort.finest == np.inf and not self.system.effort.breakpoints.size
        still = constant and not self.linked and not self.y[self.ws.nv :].any()
        return still and not self.rhs(self.t, self.y).any()

    def _rest(self, end: float) -> None:
        """Record that nothing changes until `end`."""
        kept, (q, v) = self.y.copy(), self.state(self.y)
        self.record.step_t += [end] if self.record.step_t else [self.t, end]
        self.record.steps.append((lambda t: kept, self.chart, self.ws.constraints.standing))
        self.record.still(self.record.due(self.t, end), q, v)
        self.record.progress(end)
        self.t = end

    def _step(self, solver: Any) -> None:
        """Take one step, shorter where its stages have no acceleration."""
        while True:
            try:
                with finite(solver.t):
                    message = solver.step()
            except AccelerationError:
                shorter = 0.1 * min(solver.h_abs, solver.max_step)
                if shorter < _SHORTEST * max(1.0, abs(self.t)):
                    raise
                solver.h_abs = solver.max_step = shorter
                continue
            if solver.status == "failed":
                raise SimulationError(
                    f"at t = {solver.t:.9g} s the integration fails: {message}; a discontinuous "
                    "effort needs `breakpoints`, too small tolerances cannot be met"
                )
            return

    def _keep_step(self, start: float, end: float, polynomial: object) -> None:
        """Record the step's polynomial, its samples, and joints that leave their range."""
        assert callable(polynomial)
        record, nv = self.record, self.ws.nv
        if end > start:
            if not record.step_t:
                record.step_t.append(start)
            record.step_t.append(end)
            record.steps.append((polynomial, self.chart, self.ws.constraints.standing))
        due = record.due(start, end)
        for t, y in zip(due.tolist(), np.ascontiguousarray(polynomial(due).T), strict=True):
            q, v = self.state(y)
            if self.linked and not (self.ws.locked and not v.any()):
                q, v = self.ws.constraints.project(q, v, self.given.stuck)
            self.system.solve_given_modes(t, q, v, self.given)
            record.sample(t, q, v)
        record.watch_limits(start, end, along(self.chart, polynomial, nv))
        record.progress(end)

    # ------------------------------------------------------------ guards

    def _guards(self, times: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Guards (n, nc) at times (n,): positive while the modes hold; NaN without dry friction.

        Slipping: speed in its direction. Sticking: distance of friction from its limits.
        """
        stuck, dry = self.given.stuck, self.ws.plan.coordinates.dry
        guards = np.full((len(times), self.nc), np.nan)
        slips = dry & ~stuck
        if slips.any():
            guards[:, slips] = self._advance(states)[:, slips]
        if stuck.any():
            for i, (t, y) in enumerate(zip(times.tolist(), states, strict=True)):
                self.system.solve_given_modes(t, *self.state(y), self.given)
                guards[i, stuck] = self.ws.margins.nearest[stuck]
        return guards

    def _advance(self, states: np.ndarray) -> np.ndarray:
        """(n, nc) speeds along `forward` at states (n, 2 nv); a ball's at its three coordinates."""
        if self.ws.constraints.off_joints:
            rates = np.array([self.ws.constraints.rates(*self.state(y)) for y in states])
        else:
            rates = states[:, self.ws.nv + self.ws.plan.coordinates.velocity_index]
        return self.ws.mechanism.summed(self.forward * rates)

    def _watch(self) -> None:
        """Watch each coordinate's speed in its direction of slip."""
        self.forward = self.ws.mechanism.slip_direction(
            self.ws.modes, self.ws.constraints.rates(*self.state(self.y))
        )

    def _slack(self) -> np.ndarray:
        """(nc,) rounding of the guards: of friction where stuck, of velocity where slipping."""
        slack = np.full(self.nc, 1e-15 * np.abs(self.y[self.ws.nv :]).max(initial=0.0))
        stuck = self.given.stuck
        if stuck.any():
            slack[stuck] = self.ws.margins.rounding()[stuck]
        return slack

    def _allow(self) -> None:
        """After a change of modes, keep guards that are below zero from firing again."""
        self._watch()
        self._guards_now = self._guards(np.array([self.t]), self.y[None, :])
        guards = self._guards_now[0]
        self.allowance = np.where(guards < -0.5 * self._slack(), -2.0 * guards, 0.0)

    def _first_event(
        self, start: float, end: float, polynomial: Any
    ) -> tuple[float, np.ndarray] | None:
        """First time in a step at which guards fire, and which (nc,)."""
        if not self.ws.plan.coordinates.dry.any():
            self._guards_now = np.zeros((1, self.nc))
            return None
        longest = max(
            self.settings.t_end, 4 * self.settings.max_step
        )  # more than the default: fewer
        looks = 1 + int((end - start) / longest * _ALL_LOOKS)
        times = np.linspace(start, end, max(_LOOKS, looks))
        states = np.ascontiguousarray(polynomial(times).T)
        known = self._guards_now[:0] if self.linked else self._guards_now
        values = np.vstack([known, self._guards(times[len(known) :], states[len(known) :])])
        self._guards_now = values[-1:]
        values, slack = values + self.allowance, self._slack()
        fired, first = np.full(self.nc, np.inf), end
        for c in np.flatnonzero(self.ws.plan.coordinates.dry).tolist():
            some = int(times.searchsorted(first, side="left")) + 1  # later ones do not matter
            crossing = first_crossing(
                self._guard(c, polynomial), times[:some], values[:some, c], float(slack[c])
            )
            if crossing is not None:
                fired[c], first = crossing, min(first, crossing)
        time = float(fired.min())
        if np.isinf(time):
            return None
        together = np.flatnonzero(fired <= time + _SAME_TIME * max(1.0, abs(time)))
        return time, together

    def _guard(self, c: int, polynomial: Any) -> Callable[[float], float]:
        """One guard plus its allowance, as a function of time in a step."""
        allowed, forward = float(self.allowance[c]), float(self.forward[c])

        def of_friction(t: float) -> float:
            self.system.solve_given_modes(t, *self.state(polynomial(t)), self.given)
            return float(self.ws.margins.nearest[c]) + allowed

        def of_speed(t: float) -> float:
            return float(self._advance(polynomial(t)[None, :])[0, c]) + allowed

        if self.given.stuck[c]:
            return of_friction
        if (
            self.ws.constraints.off_joints
            or self.ws.mechanism.balls
            or not hasattr(polynomial, "Q")
        ):
            return of_speed
        # of RK45, one number of its polynomial: a tenth of the time
        i = self.ws.nv + int(self.ws.plan.coordinates.velocity_index[c])
        begin, step, v = polynomial.t_old, polynomial.h, float(polynomial.y_old[i])
        k1, k2, k3, k4 = polynomial.Q[i].tolist()

        def of_joint(t: float) -> float:
            x = (t - begin) / step
            return forward * (v + step * x * (k1 + x * (k2 + x * (k3 + x * k4)))) + allowed

        return of_joint

    # ------------------------------------------------------------ changes of modes

    def _change_modes(self, fired: np.ndarray) -> None:
        """Search the modes at an instant where guards crossed zero.

        First with slip of what broke away; where that has no solution, without.

        Args:
            fired: (nc,) which.
        """
        ws, modes = self.ws, self.ws.modes
        before = modes.copy()
        stopped = self._stop([int(c) for c in fired if not modes.stuck[c]])
        fired = np.union1d(fired[modes.stuck[fired]], stopped).astype(int)
        if not fired.size:  # a ball that turned on: nothing changes its mode
            self._watch()
            self._guards_now = self._guards_now[:0]
            return
        q, v = self.state(self.y)
        forced: dict[int, float] = {}
        if len(stopped) < len(fired):
            self.system.solve_given_modes(self.t, q, v, self.given)
            way = ws.margins.breakaway_direction()
            broken = ws.mechanism.companions(modes.stuck, fired[modes.stuck[fired]])
            forced = {int(c): float(way[c]) for c in broken}
        modes.at_rest[:] = modes.stuck
        modes.at_rest[stopped] = True
        self.system.assemble(self.t, q, v)
        outcome = SearchOutcome.NONE
        again = [int(c) for c in fired if self.changed[c] == self.t]
        if again:  # a slip that would not start, a stick that would not hold: rounding decides
            modes.at_rest[again] = False
            modes.stuck[again], modes.direction[again] = True, 0.0
            outcome = ws.search(held=before.stuck)
        elif forced:
            outcome = ws.search(forced, before.stuck)
        slips = modes.copy()
        still = outcome == SearchOutcome.SOLVED and bool(forced)
        still = still and ws.mechanism.is_locked(modes.stuck)  # what breaks away would not move
        if outcome != SearchOutcome.SOLVED or still:
            modes.take(before)
            modes.at_rest[:] = modes.stuck
            modes.at_rest[stopped] = True
            outcome = ws.search(held=before.stuck)
        if still and outcome != SearchOutcome.SOLVED:
            modes.take(slips)
            outcome = ws.search(forced, before.stuck)
        if outcome != SearchOutcome.SOLVED:
            raise ws.failures.failure(outcome, ws.state).at(self.t)
        ws.finish()
        self.given = modes.kept()
        self.changed[(modes.stuck != before.stuck) | (modes.direction != before.direction)] = self.t
        turned = np.isin(np.arange(self.nc), stopped) & (modes.direction != before.direction)
        self.record.changes(self.t, before, turned)
        if self.linked:
            self.y = self.projected(self.y)
            q, v = self.state(self.y)
            self.ws.constraints.hold_position(q, modes.stuck)
        self.record.sample(self.t, q, v)
        self._allow()
        held = fired[before.stuck[fired] & modes.stuck[fired]]
        if len(held) == len(fired):  # at its limit, to rounding: asked again where clearly beyond
            self.allowance[held] += _CLEARLY * ws.margins.width[held]
        self._watch_accumulation()

    def _stop(self, slow: list[int]) -> list[int]:
        """Stop coordinates whose speed has come to zero; return all that come to rest.

        In a mechanism others stop too, or none does, where a joint passes its dead centre.
        """
        if self.linked:
            self.y = self.projected(self.y)
        if not slow:
            return []
        q, v = self.state(self.y)
        stopped = self.ws.modes.stuck.copy()  # what stands stays so
        stopped[slow] = True
        v, stopped = self.ws.constraints.stop(q, v, stopped)
        self.y[self.ws.nv :] = v
        return [int(c) for c in np.flatnonzero(stopped & ~self.ws.modes.stuck)]

    def _watch_accumulation(self) -> None:
        """Refuse events that come ever closer together, or are too many."""
        self.recent.append(self.t)
        if len(self.recent) > self.settings.max_events:
            raise SimulationError(
                f"more than {self.settings.max_events} changes between stick and slip until "
                f"t = {self.t:.9g} s; if this is intended, raise `max_events`"
            )
        if len(self.recent) < _MANY:
            return
        if self.recent[-1] - self.recent[-_MANY] > _CROWDED * self.settings.t_end:
            return
        names = sorted({event.name for event in self.record.events[-_MANY:]})
        raise SimulationError(
            f"{_MANY} changes between stick and slip within "
            f"{self.recent[-1] - self.recent[-_MANY]:.3g} s at t = {self.t:.12g} s, at joint "
            f"{', '.join(names)}: they accumulate; method 'timestepping' passes such a point"
        )
