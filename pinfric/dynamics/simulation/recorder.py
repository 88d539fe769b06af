"""Records of a running simulation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinfric.dynamics.forward.constraints import Standing
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.simulation.motion import Dense, Event, Motion, Row, columns
from pinfric.dynamics.simulation.system import Chart, System, timed
from pinfric.errors import RollMomentError
from pinfric.friction.problem import Modes
from pinfric.model.scene import Scene

#: A joint beyond its range by less than this (rad or m) is still at its end, to rounding.
_AT_LIMIT = 1e-9


class Recorder:
    """Samples, events, phases of constant modes and polynomials of a running simulation.

    Attributes:
        rows: samples; t increases strictly.
        events, phase_t, unproved: see `Motion`.
        phase_modes: of all `Workspace.places`.
        steps: (polynomial, chart, what stands still) of every step, where the integrator has them.
    """

    def __init__(
        self,
        scene: Scene,
        system: System,
        method: str,
        sample_step: float,
        carried: tuple[str, ...] | None = None,
    ) -> None:
        self.scene, self.system, self.method, self.carried = scene, system, method, carried
        self.sample_step = sample_step
        self.rows: list[Row] = []
        self.events: list[Event] = []
        self.phase_t: list[float] = []
        self.unproved: list[float] = []
        self.phase_modes: list[np.ndarray] = []
        self.step_t: list[float] = []
        self.steps: list[tuple[Callable[[float], np.ndarray], Chart, Standing | None]] = []
        self.progress: Callable[[float], None] = lambda t: None
        self._limits = _limits(scene)
        self._beyond = np.zeros(len(self._limits[0]), dtype=int)

    def row(self, t: float, q: np.ndarray, v: np.ndarray) -> Row:
        """Make a sample of the system's present solution.

        Raises:
            SimulationError: a guide without width is loaded by a moment about its axis.
        """
        ws = self.system.ws
        try:
            ws.failures.check_roll_moments(ws.wrench)
        except RollMomentError as problem:
            raise timed(problem, t) from None
        row = [q, v, ws.a, ws.effort, ws.site_modes, ws.phi, ws.load]
        if ws.given == "motor_torque":
            row.append(self.system.u / ws.plan.drives.gears.ratio)
        return t, np.concatenate(row)

    def sample(self, t: float, q: np.ndarray, v: np.ndarray) -> None:
        """Keep the system's present solution, in place of a sample at the same time."""
        row = self.row(t, q, v)
        if self.rows and t <= self.rows[-1][0]:
            self.rows[-1] = row
        else:
            self.rows.append(row)

    def still(self, times: np.ndarray, q: np.ndarray, v: np.ndarray) -> None:
        """Keep the system's present solution at times (n,) after the last sample."""
        row = self.row(0.0, q, v)[1]
        self.rows += [(t, row) for t in times.tolist()]

    def due(self, start: float, end: float) -> np.ndarray:
        """Return the times in (start, end] at which a sample is due."""
        first = np.floor(start / self.sample_step) + 1
        times = np.arange(first, np.ceil(end / self.sample_step) + 1) * self.sample_step
        margin = 1e-9 * self.sample_step
        return np.minimum(times[(times > start + margin) & (times <= end + margin)], end)

    def phase(self, t: float) -> None:
        """Note that from t on the present modes hold."""
        modes = self.system.ws.place_modes
        if self.system.ws.count.many[0] == 0:
            self.unproved.append(float(t))
        if self.phase_t and t <= self.phase_t[-1]:
            self.phase_modes[-1] = modes
        elif not self.phase_modes or (modes != self.phase_modes[-1]).any():
            self.phase_t.append(t)
            self.phase_modes.append(modes)

    def event(self, t: float, name: str, kind: str, direction: float) -> None:
        """Note an event."""
        self.events.append(Event(float(t), name, kind, int(np.sign(direction))))

    def changes(self, t: float, before: Modes, turned: np.ndarray) -> None:
        """Note what came to rest or left it since `before`, and what turned (nc,) through it."""
        ws = self.system.ws
        self.phase(t)
        if not (turned.any() or (ws.modes.stuck != before.stuck).any()):
            return
        for (name, c, _), mode in zip(ws.places, ws.place_modes.tolist(), strict=True):
            if not ws.plan.coordinates.dry[c]:
                continue
            if ws.modes.stuck[c] and not before.stuck[c]:
                self.event(t, name, "stick", 0)
            elif before.stuck[c] and not ws.modes.stuck[c]:
                self.event(t, name, "slip", mode)
            elif turned[c]:
                self.event(t, name, "reversal", mode)

    def watch_limits(
        self, start: float, end: float, configuration: Callable[[float], np.ndarray]
    ) -> None:
        """Note the joints that left their range between two times.

        Args:
            start, end: s.
            configuration: time -> q (nq,) between them.
        """
        names, index, lower, upper = self._limits
        if not names:
            return
        q = configuration(end)[index]
        sides = np.where(q > upper + _AT_LIMIT, 1, np.where(q < lower - _AT_LIMIT, -1, 0))
        for i in np.flatnonzero(sides != self._beyond):
            side = int(sides[i])
            if side:
                bound = upper[i] if side > 0 else lower[i]
                low, high = start, end
                for _ in range(60):  # bisection: once per crossing, and nothing to converge wrongly
                    middle = 0.5 * (low + high)
                    outside = side * (configuration(middle)[index[i]] - bound) > 0
                    low, high = (low, middle) if outside else (middle, high)
                self.event(high, names[i], "limit", side)
            self._beyond[i] = side

    def motion(self, status: str, message: str) -> Motion:
        """Return what was recorded, at least one sample."""
        ns, phase_t = self.system.ws.phi.size, np.array([*self.phase_t, self.rows[-1][0]])
        phase_modes = np.array(self.phase_modes, dtype=np.int8).reshape(
            len(self.phase_modes), len(self.system.ws.places)
        )
        return Motion(
            scene=self.scene,
            method=self.method,
            **columns(self.scene, self.rows, self.system.ws.given),
            events=tuple(sorted(self.events, key=lambda event: event.time)),
            phase_t=phase_t,
            phase_modes=phase_modes[:, :ns],
            status=status,
            message=message,
            evaluations=self.system.evaluations,
            carried=self.carried,
            unproved=tuple(self.unproved),
            dense=self._dense(phase_t, phase_modes),
        )

    def _dense(self, phase_t: np.ndarray, phase_modes: np.ndarray) -> Dense | None:
        if not self.steps:
            return None
        steps, system, lent, nv = self.steps, self.system, self.system.ws, self.system.ws.nv
        pieces = system.pieces(self.step_t[-1])
        starts = np.array([start for start, _, _ in pieces])

        def at(step: int, t: float) -> tuple[np.ndarray, np.ndarray]:
            if system.ws is lent:  # it may serve another simulation by now
                system.ws = Workspace(lent.scene, self.carried, lent.given == "motor_torque")
            polynomial, chart, system.ws.constraints.standing = steps[step]
            y = polynomial(t)
            return chart.configuration(y[:nv].copy()), y[nv:].copy()

        def row(t: float, q: np.ndarray, v: np.ndarray) -> Row:
            phase = np.clip(phase_t.searchsorted(t, side="right") - 1, 0, len(phase_modes) - 1)
            given = system.ws.modes_of(phase_modes[phase])
            system.within(*pieces[max(int(starts.searchsorted(t, side="right")) - 1, 0)])
            q, v = system.ws.constraints.project(q, v, given.stuck)
            system.solve_given_modes(t, q, v, given)
            return self.row(t, q, v)

        return Dense(np.array(self.step_t), at, row)


def along(
    chart: Chart, polynomial: Callable[[float], np.ndarray], nv: int
) -> Callable[[float], np.ndarray]:
    """Return time -> configuration along a polynomial of the state in a chart."""
    return lambda t: chart.configuration(polynomial(t)[:nv].copy())


def _limits(scene: Scene) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Names, indices in q and bounds of the one-number joints that have a range."""
    model = scene.model
    lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    single = (np.array(model.nqs) == 1) & (np.array(model.nvs) == 1)
    index = np.array(model.idx_qs)[single]
    ranged = (np.abs(lower[index]) < 1e300) | (np.abs(upper[index]) < 1e300)
    indices = index[ranged]
    names = [str(model.names[j]) for j in np.flatnonzero(single)[ranged].tolist()]
    return names, indices, lower[indices], upper[indices]
