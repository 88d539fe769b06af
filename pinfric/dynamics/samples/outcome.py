"""Results of inverse dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from pinfric.dynamics.samples.presliding import BuiltUp
from pinfric.dynamics.samples.reactions import AppliedWrench
from pinfric.dynamics.samples.states import States
from pinfric.model.drives import joint_effort_ends
from pinfric.model.scene import Scene


class Status(IntEnum):
    """How the solution of one sample ended."""

    CONVERGED = 0
    #: No friction obeys the laws in this motion (moving), or friction holds against any effort (at
    #: rest): efforts are NaN.
    JAMMED = 1
    #: Several do: `solutions(sample)` returns them, the interval of the efforts encloses them.
    AMBIGUOUS = 2
    #: Undecided, efforts are NaN: rounding keeps the solver from a solution that is there, or the
    #: search for the ends of efforts came to its bound (then a warning says so).
    NOT_CONVERGED = 3
    #: The drives cannot balance the load here, or the closure changes its rank: a toggle, NaN.
    SINGULAR = 4


@dataclass(frozen=True)
class Solution:
    """One state of friction, efforts and reactions that obeys the laws at one sample.

    Attributes:
        effort: (na,). friction: (ns,), a ball's along its direction of slip.
        friction_coordinates: (nf,) the same, a ball's as three components in frame b.
        normal_load: (ns,). wrench: (ns, 6). multipliers: (number of loops, 6).
    """

    effort: np.ndarray
    friction: np.ndarray
    friction_coordinates: np.ndarray
    normal_load: np.ndarray
    wrench: np.ndarray
    multipliers: np.ndarray


@dataclass(frozen=True)
class SolvedMotion:
    """Efforts, friction and reactions along a motion; samples first, SI units.

    Each end of a drive's interval can occur, but those of several drives not always at once.

    Attributes:
        scene, states, external: what was solved.
        effort_lower, effort_upper: (T, na) what each drive must deliver at its joint; equal where
            everything on it slides.
        effort_frictionless: (T, na) the same without friction.
        motor_torque_lower, motor_torque_upper: (T, na) at the motors' shafts (N m; without a
            transmission the effort itself).
        joint_effort_lower, joint_effort_upper: (T, na) ratio x motor_torque: all that a torque
            command at the joint contains.
        sticking: (T, ns) the site's speed is at most its stick velocity.
        reversal: (T, ns) the site passes through rest next to this sample.
        normal_load: (T, ns) load c of its bearing (N m about its axis, N along it).
        friction_lower, friction_upper: (T, ns) friction of the parent on the child, along the
            joint's positive direction.
        wrench: (T, ns, 6) force and moment the parent transmits to the child, in the child's joint
            frame, linear first; None if nothing in the scene depends on reactions (then see
            `joint_wrenches`).
        iterations: (T,) passes of the coupled solve; 0 in an open chain with joint drives.
        contraction: (T,) its certificate: below 1 the solution is unique; 0 without coupling.
        status: (T,) `Status`.
        multipliers: (T, number of loops, 6) force and moment of side a on side b of each loop, in
            frame b, friction and drives at the loop's joint left out; None without loops.
        interval_exact: (T,) the ends are certain; False where they were searched, a coupled ball
            sticks, or a sample has several solutions; and, with loops, cylinders or forces, where
            something sticks and a joint has no drive: there they are bounds, since friction
            balances that joint, too.
        interval_searched: (T,) many sites stick, and the ends, of a search, may be too narrow.
        redundant: the loops have redundant constraints; the reactions are those with the least sum
            of |F|^2 + |M/l|^2 over all joints.
        actuator_velocity, actuator_acceleration: (T, na) of what each drive moves (rad/s or m/s,
            and per second).
        base_residual: (T, 6) force and moment that the forces given leave to act on a free base, in
            its axes at its origin (N, N m); None where it is fixed, or no force is given.
        presliding: shares of friction that have built up; None where it acts at once, or samples
            have no order.

    With loops, cylinders or forces, wrenches, multipliers and loads depend on friction: where
    joints stick, they are those without friction in these joints.
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
    interval_searched: np.ndarray
    redundant: bool
    actuator_velocity: np.ndarray
    actuator_acceleration: np.ndarray
    presliding: BuiltUp | None = None
    base_residual: np.ndarray | None = None

    @property
    def joint_effort_lower(self) -> np.ndarray:
        """(T, na) least `joint_effort`, ratio x motor_torque (N m or N)."""
        return self._joint_effort[0]

    @property
    def joint_effort_upper(self) -> np.ndarray:
        """(T, na) greatest `joint_effort`."""
        return self._joint_effort[1]

    @property
    def _joint_effort(self) -> tuple[np.ndarray, np.ndarray]:
        ratio = np.array([drive.ratio for drive in self.scene.drives])
        return joint_effort_ends(ratio, self.motor_torque_lower, self.motor_torque_upper)
