"""A scene for integrators: coordinates for the integration, efforts, accelerations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.dynamics.forward.efforts import Effort, by_name
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.samples.reactions import AppliedWrench
from pinfric.errors import AccelerationError, PinfricError, SimulationError, StateError
from pinfric.friction.problem import GivenModes
from pinfric.model.arrays import real_numbers

#: Joints described around a base configuration, and how many of their last numbers are rotations.
_LOCAL = {"JointModelPlanar": 1, "JointModelSpherical": 3, "JointModelFreeFlyer": 3}


@dataclass(frozen=True, eq=False)
class Chart:
    """Coordinates xi (nv,) of configurations: q = base integrated by xi.

    Angles and lengths count from zero and never wrap; planar, spherical and floating joints are the
    exponential around `base`, which moves along before it degenerates.

    Attributes:
        base: (nq,) neutral but for those joints.
        local: (n,) indices of xi that are rotations around `base`.
        plain: True where q is xi itself.
    """

    model: pin.Model
    base: np.ndarray
    local: np.ndarray
    plain: bool

    @classmethod
    def at(cls, model: pin.Model, q: np.ndarray) -> Chart:
        """Return a chart in which q can be described."""
        base = pin.neutral(model)
        local: list[int] = []
        for joint in model.joints[1:]:
            if joint.shortname() in _LOCAL:
                entries = slice(joint.idx_q, joint.idx_q + joint.nq)
                base[entries] = q[entries]
                last = joint.idx_v + joint.nv
                local += range(last - _LOCAL[joint.shortname()], last)
        return cls(model, base, np.array(local, dtype=int), model.nq == model.nv)

    def configuration(self, xi: np.ndarray) -> np.ndarray:
        """Return q (nq,) on its manifold."""
        return xi if self.plain else np.asarray(pin.integrate(self.model, self.base, xi))

    def coordinates(self, q: np.ndarray) -> np.ndarray:
        """Return xi (nv,) of q."""
        return q.copy() if self.plain else difference(self.model, self.base, q)

    def rate(self, xi: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return d xi / dt (nv,) at velocity v."""
        if not self.local.size:
            return v
        J = pin.dIntegrate(self.model, self.base, xi)[1]
        return np.asarray(np.linalg.solve(J, v))

    def is_far(self, xi: np.ndarray) -> bool:
        """Whether a rotation is so far from `base` that this must move."""
        return bool(self.local.size) and bool(np.abs(xi[self.local]).max() > 1.0)

    def moved(self, xi: np.ndarray) -> tuple[Chart, np.ndarray]:
        """Return a chart around the configuration xi, and xi in it; angles keep their turns."""
        chart = Chart.at(self.model, self.configuration(xi))
        fresh = xi.copy()
        for joint in self.model.joints[1:]:
            if joint.shortname() in _LOCAL:
                fresh[joint.idx_v : joint.idx_v + joint.nv] = 0.0
        return chart, fresh


def difference(model: pin.Model, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the velocity (nv,) from one configuration (nq,) to another in unit time."""
    if model.nq == model.nv:
        return np.asarray(end - start)
    out = np.asarray(pin.difference(model, start, end))
    for joint in model.joints[1:]:
        if joint.nq == 2:  # continuous: Pinocchio's loses 1e-8 next to 0 and to pi
            (c, s), (d, e) = start[joint.idx_q :][:2], end[joint.idx_q :][:2]
            out[joint.idx_v] = np.arctan2(c * e - s * d, c * d + s * e)
    return out


@dataclass(frozen=True)
class Settings:
    """Settings of a simulation; see `simulate`."""

    t_end: float
    rtol: float
    atol: float
    dt: float
    control_period: float | None
    max_step: float
    sample_step: float
    regularization_velocity: float
    max_events: int


class System:
    """A scene with its efforts: the right-hand side of every integrator.

    Attributes:
        ws: its own buffers, because an effort function may call `forward_dynamics`.
        evaluations: right-hand sides computed.
        u: (na,) efforts at the last one, or motor torques times ratios where those are given.
    """

    def __init__(self, ws: Workspace, effort: Effort, applied: list[AppliedWrench]) -> None:
        self.ws, self.effort, self.applied = ws, effort, applied
        self.evaluations = 0
        self.u = np.zeros(ws.na)
        self._window = -np.inf, np.inf
        self._held: list[np.ndarray] = []

    def within(self, start: float, end: float, jumps: bool) -> None:
        """Evaluate efforts only inside (start, end) (s): at a breakpoint a function has two values.

        `jumps`: whether `end` is a breakpoint.
        """
        margin = 1e-12 * max(1.0, end)
        self._window = start + margin if start > 0.0 else 0.0, end - margin if jumps else np.inf

    def pieces(self, last: float) -> list[tuple[float, float, bool]]:
        """Return start, end (s) of each piece between breakpoints, and whether one ends it."""
        breaks = self.effort.breakpoints
        inside = breaks[(breaks > 0.0) & (breaks < last)].tolist()
        jumps = [*[True] * len(inside), bool((breaks == last).any())]
        return list(zip([0.0, *inside], [*inside, last], jumps, strict=True))

    def control(self, t: float, q: np.ndarray, v: np.ndarray) -> None:
        """Ask an effort that is held between breakpoints for its next value, if due.

        Args:
            t, q, v: s, (nq,), (nv,) at the start and then at breakpoints, in the order of time.

        Raises:
            SimulationError: see `efforts`.
        """
        if self.effort.held and self._period(t) == len(self._held):
            self._held.append(self._ask(t, t, q.copy(), v.copy()).copy())

    def _period(self, t: float) -> int:
        return int(self.effort.breakpoints.searchsorted(t, side="right"))

    def efforts(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return `u` (na,) at one state.

        Raises:
            SimulationError: the function raises, or returns no (na,) numbers.
        """
        if len(self._held) == 1:
            self.u = self._held[0]
            return self.u
        at = min(max(t, self._window[0]), self._window[1])
        if self.effort.held:
            self.u = self._held[min(self._period(at), len(self._held) - 1)]
        else:
            self.u = self._ask(at, t, q, v)
        return self.u

    def _ask(self, at: float, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Call the function at a time (s) beside t, which messages name."""
        try:
            answer = self.effort.function(at, q, v)
        except PinfricError:
            raise
        except Exception as problem:
            called = "; it is called with (t, q, v)" if isinstance(problem, TypeError) else ""
            raise SimulationError(
                f"{self.ws.given}: the function raised {type(problem).__name__} at t = {t:.9g} s: "
                f"{problem}{called}"
            ) from problem
        try:
            if type(answer) is not np.ndarray and isinstance(answer, Mapping):
                answer = by_name(self.ws.scene.actuator_names, answer, self.ws.given)
            u = real_numbers(self.ws.given, answer)
            u = u if u.ndim else u[None]
        except StateError as problem:
            raise SimulationError(
                f"{self.ws.given}: the function returned no numbers at t = {t:.9g} s: {problem}"
            ) from None
        if u.shape != (self.ws.na,):
            raise SimulationError(
                f"{self.ws.given}: the function returned shape {u.shape} at t = {t:.9g} s; should "
                f"be ({self.ws.na},)"
            )
        return u * self.ws.plan.drives.gears.ratio if self.ws.given == "motor_torque" else u

    def solve(self, t: float, q: np.ndarray, v: np.ndarray) -> None:
        """Find modes by velocities, friction and accelerations in `ws`."""
        self.evaluations += 1
        u = self.efforts(t, q, v)
        try:
            self.ws.solve(q, v, u, self.applied)
            self.ws.check_held(self.ws.a)
        except PinfricError as problem:
            raise timed(problem, t) from None

    def solve_given_modes(
        self, t: float, q: np.ndarray, v: np.ndarray, given: GivenModes
    ) -> np.ndarray:
        """Return a (nv,), a view, in given modes."""
        self.evaluations += 1
        u = self.efforts(t, q, v)
        try:
            self.ws.solve_given_modes(q, v, u, self.applied, given)
            self.ws.check_held(self.ws.a)
        except PinfricError as problem:
            raise timed(problem, t) from None
        return self.ws.a

    def assemble(self, t: float, q: np.ndarray, v: np.ndarray, step: float = 0.0) -> None:
        """Write the coupled problem in `ws`, unsolved."""
        self.evaluations += 1
        u = self.efforts(t, q, v)
        try:
            self.ws.assemble(q, v, u, self.applied, step)
        except PinfricError as problem:
            raise timed(problem, t) from None


def timed(problem: PinfricError, t: float) -> PinfricError:
    """Return the error with the time (s) in the simulation."""
    if isinstance(problem, AccelerationError):
        return problem if problem.time is not None else problem.at(t)
    if isinstance(problem, SimulationError):
        return problem
    return SimulationError(f"at t = {t:.9g} s: {problem}")


@contextmanager
def finite(t: float) -> Iterator[None]:
    """Convert an overflow inside SciPy's integrator at t (s) into one line.

    Raises:
        SimulationError: SciPy found NaN or infinity.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            yield
    except ValueError as problem:
        if "infs or NaNs" not in str(problem):  # SciPy's word for it; others are defects
            raise
        raise SimulationError(
            f"at t = {t:.9g} s the integration fails: values are too large ({problem})"
        ) from None
