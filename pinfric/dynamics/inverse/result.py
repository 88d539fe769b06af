"""What inverse dynamics returns: labelled arrays that can check themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pinfric.dynamics.inverse.outcome import Solution, Status
from pinfric.dynamics.inverse.solutions import find_jamming_site, find_solutions
from pinfric.dynamics.judge.check import Check, check_result
from pinfric.dynamics.problem.reactions import AppliedWrench
from pinfric.dynamics.problem.states import States
from pinfric.errors import StateError
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.coordinates import motion_columns
from pinfric.model.scene import Scene
from pinfric.model.upward import Shown

if TYPE_CHECKING:
    import pandas as pd


#: Columns `<actuator>.<quantity>` and `<site>.<quantity>` of a result's table.
ACTUATOR_QUANTITIES = (
    "effort_lower",
    "effort_upper",
    "effort_frictionless",
    "motor_torque_lower",
    "motor_torque_upper",
)
SITE_QUANTITIES = ("sticking", "reversal", "normal_load", "friction_lower", "friction_upper")


@dataclass(frozen=True)
class StickInterval:
    """A time during which a site sticks without a break.

    Attributes:
        site: its name.
        start, end: times of the first and last sticking sample (s).
    """

    site: str
    start: float
    end: float


@dataclass(frozen=True)
class InverseResult(Shown):
    """Efforts, friction and reactions along a motion; samples first, SI units.

    The ends of the intervals of different drives are each attained, but not all at one instant.

    Attributes:
        scene, states, external: what was solved.
        effort_lower, effort_upper: (T, na) what each drive must deliver at its joint; equal where
            everything on it slides.
        effort_frictionless: (T, na) the same without friction.
        motor_torque_lower, motor_torque_upper: (T, na) at the motors' shafts (N m; for an ideal
            drive without a transmission: the effort itself).
        sticking: (T, ns) the site's speed is at most its stick velocity.
        reversal: (T, ns) the site passes through rest beside this sample.
        normal_load: (T, ns) load c its friction acts on (N m about its axis, N along it).
        friction_lower, friction_upper: (T, ns) friction of the parent on the child, along the
            joint's positive direction.
        wrench: (T, ns, 6) force and moment the parent transmits to the child, in the child's joint
            frame, linear first; None where nothing in the scene looks at reactions
            (`joint_wrenches` gives them for any scene).
        iterations: (T,) passes of the coupled solve; 0 in an open chain with joint drives.
        contraction: (T,) its certificate: below 1 the solution is unique; 0 without coupling.
        status: (T,) `Status`.
        multipliers: (T, number of loops, 6) force and moment of side a on side b of each loop, in
            frame b, friction and drives at the loop's joint left out; None without loops.
        interval_exact: (T,) the ends are certain; False where more sites stick than are enumerated
            (a search by single flips), a coupled ball sticks, or a sample has several solutions;
            and, with loops, cylinders or forces, where something sticks and a joint has no drive:
            there they are bounds, since friction balances that joint, too.
        redundant: the loops close more directions than are independent: reactions are those of
            least sum of |F|^2 + |M/l|^2 over all joints.
        actuator_velocity, actuator_acceleration: (T, na) of what each drive moves (rad/s or m/s,
            and per second).

    With loops, cylinders or forces, wrenches, multipliers and loads depend on the friction: where
    something sticks they are those of the state in which what sticks has none.
    """

    scene: Scene
    states: States
    external: tuple[AppliedWrench, ...]
    effort_lower: np.ndarray
    effort_upper: np.ndarray
    effort_frictionless: np.ndarray
    motor_torque_lower: np.ndarray
    motor_torque_upper: np.ndarray
    sticking: np.ndarray
    reversal: np.ndarray
    normal_load: np.ndarray
    friction_lower: np.ndarray
    friction_upper: np.ndarray
    wrench: np.ndarray | None
    iterations: np.ndarray
    contraction: np.ndarray
    status: np.ndarray
    multipliers: np.ndarray | None
    interval_exact: np.ndarray
    redundant: bool
    actuator_velocity: np.ndarray
    actuator_acceleration: np.ndarray

    def __repr__(self) -> str:
        samples = counted(len(self.status), "sample")
        span = "" if self.t is None else f", {self.t[-1] - self.t[0]:.4g} s"
        sticks = [len(runs(self.sticking[:, s])) for s in range(len(self.site_names))]
        friction = f"{np.count_nonzero(sticks)} of {counted(len(sticks), 'joint')} stick, "
        friction += f"in {counted(sum(sticks), 'interval')}; "
        friction += f"{counted(int(self.reversal.sum()), 'reversal')} between samples"
        worst = np.fmax(np.abs(self.effort_lower), np.abs(self.effort_upper))
        peaks = [f"{x:.3g}" for x in np.fmax.reduce(worst, axis=0, initial=0.0)]
        ended = [(status.name.lower(), int((self.status == status).sum())) for status in Status]
        return screen(
            "InverseResult",
            f"of {file_name(self.scene.source)}: {samples}{span}",
            {
                "drives": listed(self.actuator_names),
                "peaks": f"{listed(self.actuator_names, peaks)} (N m or N)" if peaks else "",
                "friction": friction if sticks else "none",
                "status": ", ".join(f"{count} {name}" for name, count in ended if count),
                "more": ".summary() .plot() .to_dataframe() .stick_intervals() .check()",
            },
        )

    @property
    def critical_mu(self) -> np.ndarray:
        """(T,) common factor on all coefficients at which `contraction` reaches 1, or inf.

        Below it the solution exists and is the only one. Exact for a single guide that jams,
        conservative for several bearings (by 14 to 29 % on a four-bar): a bound.
        """
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.contraction)

    def solutions(self, sample: int) -> tuple[Solution, ...]:
        """Return the states of friction that obey the laws at one sample.

        Where everything slides: all that a wide search finds, none if it jams. Where something
        sticks or reverses: those in which the ends of the efforts are attained.

        Raises:
            StateError: there is no such sample.
        """
        self._check_sample(sample)
        return find_solutions(self, sample)

    def jamming_site(self, sample: int) -> str | None:
        """Return the site whose load grows most with the friction it and the others cause.

        The largest part of the eigenvector that belongs to `contraction`: where a jam, or a second
        solution, comes from. None where no load depends on friction, and at a `SINGULAR` sample.

        Raises:
            StateError: there is no such sample.
        """
        self._check_sample(sample)
        return find_jamming_site(self, sample)

    def _check_sample(self, sample: int) -> None:
        if not 0 <= sample < len(self.status):
            raise StateError(f"there is no sample {sample}; there are {len(self.status)}")

    @property
    def t(self) -> np.ndarray | None:
        """(T,) times in s, or None."""
        return self.states.t

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the robot's joints."""
        return self.scene.joint_names

    @property
    def site_names(self) -> tuple[str, ...]:
        """Names of the columns of sticking, reversal, load, friction and wrench."""
        return self.scene.site_names

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """Names of the columns of efforts and motor torques."""
        return self.scene.actuator_names

    def stick_intervals(self) -> tuple[StickInterval, ...]:
        """Return when each site sticks, in the order of the sites.

        Raises:
            StateError: the result has no times.
        """
        if self.t is None:
            raise StateError("stick intervals need times: give `t` to inverse_dynamics")
        return tuple(
            StickInterval(name, float(self.t[first]), float(self.t[last]))
            for s, name in enumerate(self.site_names)
            for first, last in runs(self.sticking[:, s])
        )

    def check(self) -> Check:
        """Recompute the residuals of the equilibrium and of the friction laws, sample by sample.

        Independent of the solver: Pinocchio's RNEA with external forces, one sample at a time, and
        the friction laws in plain NumPy.
        """
        return check_result(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return all columns with names: `t`, the motion, then what was found.

        The motion is `<joint>.q` (one number: an angle or a length), `.v`, `.a`, and
        `payload.<name>` where the trajectory said so: a CSV of it is a trajectory again. Then come
        `<actuator>.<quantity>` and `<site>.<quantity>`.
        """
        import pandas as pd

        states = self.states
        columns: dict[str, np.ndarray] = {} if self.t is None else {"t": self.t}
        columns |= motion_columns(self.scene.model, states.q, states.v, states.a)
        if states.attached is not None:
            columns |= {
                f"payload.{name}": states.attached[:, p].astype(np.int8)
                for p, name in enumerate(self.scene.payloads)
            }
        for quantity in ACTUATOR_QUANTITIES:
            for i, name in enumerate(self.actuator_names):
                columns[f"{name}.{quantity}"] = getattr(self, quantity)[:, i]
        for quantity in SITE_QUANTITIES:
            for s, name in enumerate(self.site_names):
                columns[f"{name}.{quantity}"] = getattr(self, quantity)[:, s]
        return pd.DataFrame(columns)


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, last) index of each run of True in a (T,) mask."""
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    firsts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(first), int(end) - 1) for first, end in zip(firsts, ends, strict=True)]
