"""Errors for states without an acceleration, with several, or for which the search found none."""

from __future__ import annotations

from math import hypot, prod
from typing import NoReturn

import numpy as np

from pinfric.dynamics.problem.accelerations import NOT_FINITE, TOGGLE
from pinfric.dynamics.problem.machine import Machine
from pinfric.dynamics.samples.reactions import AppliedWrench
from pinfric.errors import (
    AccelerationError,
    AmbiguousAcceleration,
    GearJam,
    NoConsistentAcceleration,
    RollMomentError,
    SceneError,
    StateError,
    ToggleError,
    UndecidedAcceleration,
)
from pinfric.friction.gears import jam
from pinfric.friction.problem import SearchOutcome
from pinfric.friction.search import MOST_ENUMERATED, MOST_PASSES, SearchStatistics
from pinfric.model.closure import velocity_names
from pinfric.model.mobility import lightest_joint
from pinfric.model.scene import Scene

#: What an instant is asked for: q (nq,), v (nv,), effort (na,) as drives are given it, r T_m where
#: motors drive; wrenches from outside; 0, or the time step (s) at whose end r is the velocity.
State = tuple[np.ndarray, np.ndarray, np.ndarray, list[AppliedWrench] | None, float]


class Failures:
    """The errors of a workspace's scene.

    Attributes:
        guides: bearings that cannot carry a moment about their axis: site, axis, lever.
    """

    def __init__(self, scene: Scene, machine: Machine, given: str, count: SearchStatistics) -> None:
        """Take the scene, its tables and buffers; `given` is "effort" or "motor_torque"."""
        self._scene, self._machine, self._given = scene, machine, given
        self._count = count
        self._plan, self._modes, plan = machine.plan, machine.modes, machine.plan
        self.guides = [
            (int(s), scene.sites[s].axis.tolist(), float(plan.sites.roll_lever[s]))
            for s in plan.sites.guides
        ]

    def check_roll_moments(self, wrench: np.ndarray) -> None:
        """Check one state like `reactions.check_roll_moments`, at a tenth of its cost.

        Args:
            wrench: (ns, 6) at the sites, N and N m.

        Raises:
            RollMomentError: see there.
        """
        for s, (x, y, z), lever in self.guides:
            fx, fy, fz, mx, my, mz = wrench[s].tolist()
            roll = mx * x + my * y + mz * z
            if abs(roll) > 1e-9 * (hypot(mx, my, mz) + lever * hypot(fx, fy, fz)):
                raise RollMomentError(self._scene.sites[s].name, 0, roll)

    def check_finite(self, state: State) -> None:
        """Refuse a state with values that are not finite.

        Raises:
            StateError: see there.
        """
        for name, array in zip(("q", "v", self._given), state[:3], strict=True):
            if not np.isfinite(array).all():
                i = int(np.flatnonzero(~np.isfinite(array))[0])
                raise StateError(f"{name}: column {i} is {array[i]}; should be finite")

    def refuse(self, outcome: int, state: State) -> NoReturn:
        """Raise the error for an outcome of `instant.solve_instant`; see `Workspace.solve`."""
        self.check_finite(state)
        if outcome == NOT_FINITE:
            raise StateError("forward dynamics overflows at this state: values are too large")
        if outcome == TOGGLE:
            raise ToggleError(
                self._scene.loops[0].name,
                int(self._machine.maps.freedoms[0]),
                self._plan.closure.freedoms,
            )
        raise SceneError(
            f"{self._scene.source}: the mass matrix is not positive definite at this state: a "
            f"joint moves no mass ({self._lightest()}); give its link an inertia, or lock it"
        )

    def pushed(self, velocities: np.ndarray) -> str:
        """Return that joints that move no mass get more effort than their friction bears."""
        names = [velocity_names(self._scene.model)[k] for k in velocities.tolist()]
        each = "moves no mass and gets" if len(names) == 1 else "move no mass and get"
        return (
            f"{self._scene.source}: {', '.join(names)} {each} an effort beyond its friction: no "
            "finite acceleration; give the link an <inertial>, lock the joint, or leave the effort "
            "out"
        )

    def _lightest(self) -> str:
        k, closure = self._machine.kinematics, self._plan.closure
        rows = k.J[0, closure.off_joint : closure.off_joint + closure.multipliers]
        return lightest_joint(self._scene.model, self._machine.maps.M, rows)

    def failure(self, outcome: SearchOutcome, state: State) -> AccelerationError:
        """Return the error with the reason and the joint for which no acceleration was found."""
        jammed = self._jam(outcome, state)
        if jammed and outcome in (SearchOutcome.NONE, SearchOutcome.UNSTABLE):
            return jammed
        contraction, (modes, names) = self._modes.figures[0], self._resting()
        finding: type[AccelerationError] = NoConsistentAcceleration
        (many, stable), tried = self._count.many, self._count.tried
        counted = f"{many} in {tried} mode{'s' * (tried != 1)} tried{modes}"
        if many and outcome == SearchOutcome.UNDECIDED:
            counted += ", others are not ruled out"
        reason = f"{counted}; neither sticking nor slipping either way is consistent"
        if contraction >= 1.0:
            reason = (
                f"{counted}; the loads grow with the friction they cause (contraction "
                f"{contraction:.4g}); below 1 there would be one: less friction, smaller radii or "
                "more inertia"
            )
        if outcome == SearchOutcome.AMBIGUOUS:
            finding = AmbiguousAcceleration
            if many > 1 and stable != many:
                reason = f"{counted}, {stable or 'none'} of them stable"
            elif not contraction >= 1.0:
                reason = (
                    f"{counted}; static friction is above kinetic, so one set of joints may break "
                    "away and the others hold, or another set of as many; the motion before this "
                    "state, or method 'timestepping' of simulate, would decide"
                )
        elif outcome == SearchOutcome.NOT_CONVERGED:
            reason = f"the coupled solve does not reach its tolerance (contraction {contraction})"
        elif outcome == SearchOutcome.UNDECIDED:
            finding = UndecidedAcceleration
            if self._count.may_miss:
                reason = (
                    f"{counted}; self-locking gears in motion allow more choices of lines than are "
                    "tried; fewer of them, or curves of fewer points, would decide"
                )
            elif not (many and contraction >= 1.0):
                reason = (
                    f"{counted}; {self._untried()}, so there may be one; remove friction from "
                    "joints where it does not matter, or take method 'timestepping' of simulate, "
                    "which goes on"
                )
        reason += names
        if jammed:
            reason += f"; joint {jammed.site!r}: {jammed.reason}"
        return finding(*self._as_given(state), self._worst_site(), reason, given=self._given)

    def _resting(self) -> tuple[str, str]:
        """Say how many modes the joints at rest have, and which joints these are."""
        m, here, t = self._modes, self._decided(), self._plan.entries
        rests = np.flatnonzero(m.at_rest & here)
        if not rests.size:
            return "", ""
        joints = np.unique(self._plan.coordinates.block[rests])
        modes = prod(2 if self._plan.coordinates.ball[c] else 3 for c in joints.tolist())
        of = np.unique(t.site[np.isin(t.coordinate, rests)]).tolist()
        names = ", ".join(self._scene.site_names[s] for s in of)
        alone = not here.all() and names
        return f" of {modes}", f"; the other joints do not matter to {names}" if alone else ""

    def _untried(self) -> str:
        """Say what a search that proves nothing has not tried."""
        balls = self._decided() & self._plan.coordinates.ball
        if (self._modes.at_rest & balls).any():
            return "the direction in which a ball slips is searched from one start"
        few = f"{MOST_PASSES} passes and tries every mode of {MOST_ENUMERATED} joints at rest only"
        return f"the search ends after {few}"

    def _decided(self) -> np.ndarray:
        """(nc,) bool: the coordinates that decided the outcome, one island or all."""
        coordinates = np.arange(self._modes.stuck.size)
        return np.isin(coordinates, self._count.island if self._count.island.size else coordinates)

    def _as_given(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Copies of q, v, and of efforts or motor torques, as they were given."""
        ratio = self._plan.drives.gears.ratio if self._given == "motor_torque" else 1.0
        return state[0].copy(), state[1].copy(), state[2] / ratio

    def _jam(self, outcome: SearchOutcome, state: State) -> GearJam | None:
        """The error for moving self-locking gears without an answer, or a single stable one."""
        m, drives = self._modes, self._plan.drives
        kept = m.stuck.copy()
        m.stuck[m.at_rest & ~self._decided()] = False
        worm = jam(self._machine.problem, m)
        if worm is None and m.at_rest.any():  # they move with all that may slip, if at all
            m.stuck[m.at_rest] = False
            worm = jam(self._machine.problem, m)
        m.stuck[:] = kept
        if worm is None:
            return None
        geared, gears, step = np.flatnonzero(drives.gear_entry >= 0), drives.gears, state[4] or 1.0
        enough = {
            int(geared[g]): inertia * step / gears.ratio[geared[g]] ** 2
            for g, inertia in worm.inertia.items()
        }
        d = next(iter(enough)) if len(enough) == 1 else int(geared[worm.gear])
        reason = (
            f"E + I^1/2 M^-1 I^1/2 has the eigenvalue {worm.eigenvalue:.3g}; {self._remedy(enough)}"
        )
        if drives.gears.rotor_inertia[d] == 0.0:
            reason = f"its rotor has no inertia; {reason}"
        if outcome == SearchOutcome.UNSTABLE:
            reason = f"the one acceleration that obeys its law is unstable; {reason}"
        elif outcome == SearchOutcome.NONE:
            tried = self._count.tried
            reason = f"no acceleration obeys its law ({tried} modes tried); {reason}"
        return GearJam(
            *self._as_given(state), self._scene.drives[d].name, reason, given=self._given
        )

    def _remedy(self, enough: dict[int, float]) -> str:
        """What would leave one answer: rotor inertias (kg m^2) of drives."""
        if not enough:
            return "no rotor inertia makes sure of one answer, only fewer gears that lock"
        if len(enough) == 1:
            (inertia,) = enough.values()
            return (
                f"there would be one answer with a rotor inertia above {inertia:.6g} kg m^2, or "
                "with a gear that does not lock"
            )
        each = (f"{x:.6g} ({self._scene.drives[d].name})" for d, x in enough.items())
        return (
            f"there would be one answer with rotor inertias above {', '.join(each)} kg m^2, or "
            "with gears that do not lock"
        )

    def _worst_site(self) -> str:
        """Name of the site whose load grows most with friction: there it is inconsistent."""
        p = self._machine.problem
        growth = np.zeros(len(p.constant))
        norms = np.linalg.norm(p.contact[:, 1:], axis=2).sum(axis=1)
        np.add.at(growth, p.contact_entry, norms)
        open_ = (~self._modes.stuck | self._modes.at_rest) & self._decided()
        worst = np.argmax(growth * p.mu_slip + np.where(open_[p.coordinate], 0.0, -np.inf))
        if worst < len(self._plan.entries.site):
            return self._scene.site_names[self._plan.entries.site[worst]]
        geared = np.flatnonzero(self._plan.drives.gear_entry == worst)
        return self._scene.drives[int(geared[0])].name
