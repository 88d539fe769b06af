"""Base of the integrators: state, start, pieces between breakpoints."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.simulation.recorder import Recorder
from pinfric.dynamics.simulation.system import Chart, Settings, System, difference


def standing(ws: Workspace, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return velocities (nv,), exactly 0 where coordinates stick."""
    speed = ws.mechanism.speeds(ws.constraints.rates(q, v))
    slow = ws.plan.coordinates.dry & (speed <= ws.plan.coordinates.stick_velocity)
    return ws.constraints.stop(q, v, slow)[0]


def begin(
    system: System, record: Recorder, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Record t = 0; return the state, with velocities exactly 0 where coordinates stick."""
    ws, v = system.ws, standing(system.ws, q, v)
    system.control(0.0, q, v)
    system.solve(0.0, q, v)
    record.phase(0.0)
    record.sample(0.0, q, v)
    return ws.constraints.hold_position(q, ws.modes.stuck), v


class Integration:
    """One simulation by an integrator of SciPy's: y = [xi; v] (2 nv,), d(xi, v)/dt = `rhs`.

    Attributes:
        system, settings, record: of this simulation.
        ws: the system's workspace.
        linked: whether loops close.
        chart: what the coordinates xi count from.
        given: the modes that hold now.
    """

    def __init__(self, system: System, settings: Settings, record: Recorder) -> None:
        self.system, self.settings, self.record = system, settings, record
        self.ws = system.ws
        self.linked = system.ws.scene.linkage is not None
        self.chart: Chart
        self.given = self.ws.modes.kept()

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the accelerations (nv,) of a state."""
        raise NotImplementedError

    def start(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return y of the first state, in a chart around it."""
        self.chart = Chart.at(self.ws.scene.model, q)
        return np.concatenate([self.chart.coordinates(q), v])

    def ends(self) -> Iterator[float]:
        """Yield the end (s) of each piece between breakpoints, as it begins."""
        for piece in self.system.pieces(self.settings.t_end):
            self.system.within(*piece)
            yield piece[1]

    def state(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return q (nq,), v (nv,)."""
        nv = self.ws.nv
        return self.chart.configuration(np.ascontiguousarray(y[:nv])), np.ascontiguousarray(y[nv:])

    def projected(self, y: np.ndarray) -> np.ndarray:
        """Return the state nearest to y with closed loops and sticking coordinates at rest."""
        nv = self.ws.nv
        before, v = self.state(y)
        q, v = self.ws.constraints.project(before, v, self.given.stuck)
        moved = self.chart.rate(y[:nv], difference(self.chart.model, before, q))
        return np.concatenate([y[:nv] + moved, v])

    def rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return d(xi, v)/dt (2 nv,)."""
        q, v = self.state(y)
        return np.concatenate([self.chart.rate(y[: self.ws.nv], v), self.acceleration(t, q, v)])
