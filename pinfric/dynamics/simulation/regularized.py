"""Simulation with regularized friction, the method of many other tools, for comparison.

    x = -tanh(v / velocity) (mu(v) c + coulomb(v)) - drag

One stiff solver (SciPy's Radau) integrates without events. Joints never stick: a load that static
friction would hold creeps at v = velocity artanh(load / limit), with the limit of kinetic friction.
"""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.simulation.integration import Integration
from pinfric.dynamics.simulation.recorder import along
from pinfric.dynamics.simulation.system import finite
from pinfric.errors import SimulationError
from pinfric.friction.problem import GivenModes

#: Of SciPy's steps for differences, relative to the state. In each Jacobian it makes a step tenfold
#: where a difference is 0, as for the place of a prismatic joint: in the end to infinity.
_LARGEST_STEP = 1e-3


class RegularizedIntegration(Integration):
    """One simulation with smoothed friction."""

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return a (nv,) with smoothed friction; modes are 0 below the regularization velocity."""
        ws, velocity = self.ws, self.settings.regularization_velocity
        rates = ws.constraints.rates(q, v)
        speed = ws.mechanism.speeds(rates)
        share = np.divide(rates, speed, out=np.zeros_like(rates), where=speed > 0.0)
        dry, site_coordinate = ws.plan.coordinates.dry, ws.plan.site_coordinate
        direction = np.where(dry, np.tanh(speed / velocity), 1.0) * share
        held = dry & np.isin(ws.plan.coordinates.velocity_index, ws.held)  # no mass: they rest
        self.given = GivenModes(held, direction, balls_turn=False)
        a = self.system.solve_given_modes(t, q, v, self.given)
        if held.any() and (ws.margins.nearest[held] < 0.0).any():
            pushed = held & (ws.margins.nearest < 0.0)
            raise SimulationError(ws.failures.pushed(ws.plan.coordinates.velocity_index[pushed]))
        slow = speed <= velocity
        ws.site_modes[slow[site_coordinate] & dry[site_coordinate]] = 0
        return a

    def run(self, q: np.ndarray, v: np.ndarray) -> None:
        """Integrate from t = 0 into the record."""
        settings, nv = self.settings, self.ws.nv
        y, t = self.start(q, v), 0.0
        self.system.control(0.0, q, v)
        self._sample(0.0, y)
        for end in self.ends():
            self.system.control(t, *self.state(y))
            while t < end:
                t, y = self._smooth(t, y, end)
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
            if solver.jac_factor is not None:
                solver.jac_factor = np.minimum(solver.jac_factor, _LARGEST_STEP)
            polynomial = solver.dense_output()
            for time in self.record.due(solver.t_old, solver.t):
                self._sample(time, polynomial(time))
            self.record.watch_limits(solver.t_old, solver.t, along(chart, polynomial, nv))
            self.record.progress(solver.t)
            if self.linked:  # what the integration leaves open is closed: no drift
                solver.y = self.projected(solver.y)
                solver.f = self.rhs(solver.t, solver.y)
            if chart.is_far(solver.y[:nv]):
                break
        return float(solver.t), solver.y.copy()

    def _sample(self, t: float, y: np.ndarray) -> None:
        q, v = self.state(self.projected(y) if self.linked else y)
        self.acceleration(t, q, v)
        self.record.phase(t)
        self.record.sample(t, q, v)
