"""What inverse dynamics returns: labelled arrays that can check themselves."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from pinfric.dynamics.reactions import AppliedWrench
from pinfric.dynamics.states import States
from pinfric.errors import StateError
from pinfric.model.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

    from pinfric.dynamics.check import Check


class Status(IntEnum):
    """How the solution of one sample ended."""

    CONVERGED = 0


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
class InverseResult:
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
        from pinfric.dynamics.check import check

        return check(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return all columns with names: `t`, then `<actuator>.<quantity>`, `<site>.<quantity>`."""
        import pandas as pd

        columns: dict[str, np.ndarray] = {} if self.t is None else {"t": self.t}
        for quantity in ("effort_lower", "effort_upper", "effort_frictionless",
                         "motor_torque_lower", "motor_torque_upper"):  # fmt: skip
            for i, name in enumerate(self.actuator_names):
                columns[f"{name}.{quantity}"] = getattr(self, quantity)[:, i]
        for quantity in ("sticking", "reversal", "normal_load", "friction_lower", "friction_upper"):
            for s, name in enumerate(self.site_names):
                columns[f"{name}.{quantity}"] = getattr(self, quantity)[:, s]
        return pd.DataFrame(columns)


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, last) index of each run of True in a (T,) mask."""
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    firsts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(first), int(end) - 1) for first, end in zip(firsts, ends, strict=True)]
