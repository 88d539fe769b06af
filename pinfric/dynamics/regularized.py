"""Simulation with regularized friction, as others do it: for comparison.

    x = -tanh(v / velocity) (mu(v) c + coulomb(v)) - drag

Smooth, so one stiff solver (SciPy's Radau) runs through; but nothing ever sticks: a load that
static friction would hold creeps at v = velocity artanh(load / limit), and the limit is the sliding
one, since at rest there is no friction at all.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.record import Recorder, along
from pinfric.dynamics.system import Chart, Settings, System, difference, finite
from pinfric.errors import SimulationError


class RegularizedIntegration:
    """One simulation with smoothed friction; the attributes are those of `EventIntegration`."""

    def __init__(self, system: System, settings: Settings, record: Recorder) -> None:
        self.system, self.settings, self.record = system, settings, record
        self.ws = system.ws
        self.ws.turns_balls = False  # their directions are smooth, too
        self.linked = system.ws.scene.linkage is not None
        self.chart: Chart

    def solve(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return a (nv,) with smoothed friction; modes are 0 below the regularization velocity."""
        ws, velocity = self.ws, self.settings.regularization_velocity
        rates = ws.rates(q, v)
        speed = ws.speeds(rates)
        part = np.divide(rates, speed, out=np.zeros_like(rates), where=speed > 0.0)
        ws.modes.stuck[:] = False
        ws.modes.direction[:] = np.where(ws.tables.dry, np.tanh(speed / velocity) * part, 0.0)
        a = self.system.solve_given_modes(t, q, v)
        slow = speed <= velocity
        ws.site_modes[slow[ws.tables.coordinate] & ws.tables.dry[ws.tables.coordinate]] = 0
        return a

    def rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return d(xi, v)/dt (2 nv,)."""
        nv = self.ws.nv
        xi, v = np.ascontiguousarray(y[:nv]), np.ascontiguousarray(y[nv:])
        out = np.empty(2 * nv)
        out[nv:] = self.solve(t, self.chart.configuration(xi), v)
        out[:nv] = self.chart.rate(xi, v)
        return out

    def run(self, q: np.ndarray, v: np.ndarray) -> None:
        """Integrate from t = 0; the record holds what happens."""
        settings, nv = self.settings, self.ws.nv
        self.chart = Chart.at(self.ws.scene.loaded_model(), q)
        y = np.concatenate([self.chart.coordinates(q), v])
        self._sample(0.0, y)
        breaks = self.system.effort.breakpoints
        t = 0.0
        for end in [*breaks[(breaks > 0.0) & (breaks < settings.t_end)], settings.t_end]:
            self.system.within(t, float(end), end in breaks)
            while t < end:
                t, y = self._smooth(t, y, float(end))
                if self.chart.is_far(y[:nv]):
                    self.chart, y[:nv] = self.chart.moved(y[:nv])
        self._sample(settings.t_end, y)

    def _smooth(self, t: float, y: np.ndarray, end: float) -> tuple[float, np.ndarray]:
        """Integrate until `end` or until the chart must move."""
        from scipy.integrate import Radau

        s, nv, chart = self.settings, self.ws.nv, self.chart
        with finite(t):
            solver = Radau(self.rhs, t, y, end, rtol=s.rtol, atol=s.atol, max_step=s.max_step)
        while solver.status == "running":
            with finite(solver.t):
                message = solver.step()
            if solver.status == "failed":
                raise SimulationError(f"at t = {solver.t:.9g} s the integration fails: {message}")
            polynomial = solver.dense_output()
            for time in self.record.due(solver.t_old, solver.t):
                self._sample(time, polynomial(time))
            self.record.watch_limits(solver.t_old, solver.t, along(chart, polynomial, nv))
            self.record.progress(solver.t)
            if self.linked:  # what the integration leaves open is closed: no drift
                solver.y = self._closed(solver.y)
                solver.f = self.rhs(solver.t, solver.y)
            if chart.is_far(solver.y[:nv]):
                break
        return float(solver.t), solver.y.copy()

    def _closed(self, y: np.ndarray) -> np.ndarray:
        """The state nearest to y in which loops are closed."""
        nv = self.ws.nv
        before = self.chart.configuration(np.ascontiguousarray(y[:nv]))
        q, v = self.ws.obey(before, np.ascontiguousarray(y[nv:]))
        moved = self.chart.rate(y[:nv], difference(self.chart.model, before, q))
        return np.concatenate([y[:nv] + moved, v])

    def _sample(self, t: float, y: np.ndarray) -> None:
        nv = self.ws.nv
        if self.linked:
            y = self._closed(y)
        q, v = self.chart.configuration(np.ascontiguousarray(y[:nv])), y[nv:].copy()
        self.solve(t, q, v)
        self.record.phase(t)
        self.record.sample(t, q, v)
