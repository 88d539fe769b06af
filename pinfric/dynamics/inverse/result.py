"""The result of inverse dynamics."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pinfric.dynamics.inverse.balance import Balance, balance_of
from pinfric.dynamics.inverse.check import Check, check_result
from pinfric.dynamics.inverse.solutions import find_jamming_site, find_solutions
from pinfric.dynamics.samples.outcome import Solution, SolvedMotion, Status
from pinfric.errors import StateError
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.coordinates import WRENCH, motion_columns
from pinfric.model.described import derived, described, quantity
from pinfric.model.upward import Shown

if TYPE_CHECKING:
    import pandas as pd


#: Columns `<actuator>.<quantity>` and `<site>.<quantity>` of a result's table.
ACTUATOR_QUANTITIES = (
    "effort_lower",
    "effort_upper",
    "effort_frictionless",
    "joint_effort_lower",
    "joint_effort_upper",
    "motor_torque_lower",
    "motor_torque_upper",
)
SITE_QUANTITIES = ("sticking", "reversal", "normal_load", "friction_lower", "friction_upper")


@described
class StickInterval:
    """A time during which a site sticks without a break."""

    site: str = quantity("its name", heading="joint", name=True)
    start: float = quantity("time of the first sticking sample", "s", "from", "{start:.6f}")
    end: float = quantity("time of the last sticking sample", "s", "to", "{end:.6f}")

    @property
    @derived("s", "for")
    def duration(self) -> float:
        """The end less the start."""
        return self.end - self.start


class InverseResult(SolvedMotion, Shown):  # noqa: D101 (that of its fields)
    __doc__ = SolvedMotion.__doc__

    def __repr__(self) -> str:
        samples = counted(len(self.status), "sample")
        span = "" if self.t is None else f", {self.t[-1] - self.t[0]:.4g} s"
        sticks = [len(runs(self.sticking[:, s])) for s in range(len(self.site_names))]
        friction = f"{np.count_nonzero(sticks)} of {counted(len(sticks), 'joint')} stick: "
        friction += f"{counted(sum(sticks), 'rest')}; "
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
                "more": ".to_dataframe() .check()"
                if self.t is None
                else ".summary() .plot() .to_dataframe() .stick_intervals() .check()",
            },
        )

    @property
    def critical_mu(self) -> np.ndarray:
        """(T,) common factor on all coefficients at which `contraction` reaches 1, or inf.

        Below it the solution exists and is the only one. Exact for a single guide that jams; a
        lower bound for several bearings (by 14 to 29 % on a four-bar).
        """
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.contraction)

    def solutions(self, sample: int) -> tuple[Solution, ...]:
        """Return the states of friction that obey the laws at one sample.

        If all joints slide, all that a wide search finds, none if it jams; if a joint sticks or
        reverses, those at the ends of the efforts.

        Raises:
            StateError: there is no such sample.
        """
        self._check_sample(sample)
        return find_solutions(self, sample)

    def jamming_site(self, sample: int) -> str | None:
        """Return the joint whose load grows most with friction: the cause of a jam.

        It is largest in the eigenvector of `contraction`. None if no load depends on friction, and
        at a `SINGULAR` sample.

        Raises:
            StateError: there is no such sample.
        """
        self._check_sample(sample)
        return find_jamming_site(self, sample)

    def _check_sample(self, sample: int) -> None:
        if not 0 <= sample < len(self.status):
            raise StateError(f"there is no sample {sample}; there are {len(self.status)}")

    @cached_property
    def balance(self) -> Balance | None:
        """What the forces given leave at a free base; None as `base_residual`."""
        residual = self.base_residual
        if residual is None:
            return None
        return balance_of(self.scene, self.states, self.external, residual)

    @property
    def t(self) -> np.ndarray | None:
        """(T,) times in s, or None."""
        return self.states.t

    @property
    def times(self) -> np.ndarray:
        """(T,) times in s; of a result that has times only."""
        return self.states.times

    @property
    def q(self) -> np.ndarray:
        """(T, nq) configurations of the motion."""
        return self.states.q

    @property
    def v(self) -> np.ndarray:
        """(T, nv) velocities of the motion."""
        return self.states.v

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
        """Recompute the residuals of equilibrium, friction laws, loops and power; see `Check`.

        By Pinocchio's plain RNEA with friction and multipliers as external wrenches, sample by
        sample. Motor torques behind gears are judged only for where they are NaN.
        """
        return check_result(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return all columns with names: `t`, the motion, then the results.

        The motion is `<joint>.q` (one number: an angle or a length), `.v`, `.a`, and
        `payload.<name>` if the trajectory has it, and `<joint>.fx` to `.mz` for forces given on the
        link that a joint moves, in the joint's frame: a CSV of it is a trajectory again. Then come
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
        on: dict[int, np.ndarray] = {}
        for one in self.external:
            if one.joint >= 0:  # on the ground they load no joint
                on[one.joint] = one.wrench + on.get(one.joint, 0.0)
        for joint, wrench in on.items():
            name = self.joint_names[joint]
            columns |= dict(zip((f"{name}.{part}" for part in WRENCH), wrench.T, strict=True))
        for array in ACTUATOR_QUANTITIES:
            for i, name in enumerate(self.actuator_names):
                columns[f"{name}.{array}"] = getattr(self, array)[:, i]
        for array in SITE_QUANTITIES:
            for s, name in enumerate(self.site_names):
                columns[f"{name}.{array}"] = getattr(self, array)[:, s]
        for end in ("lower", "upper") if self.presliding is not None else ():
            shares = getattr(self.presliding, end), getattr(self.presliding, f"drive_{end}")
            for names, array in zip((self.site_names, self.actuator_names), shares, strict=True):
                for i, name in enumerate(names):  # a joint and its gear have one share
                    columns.setdefault(f"{name}.presliding_{end}", array[:, i])
        return pd.DataFrame(columns)


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, last) index of each run of True in a (T,) mask."""
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    firsts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(first), int(end) - 1) for first, end in zip(firsts, ends, strict=True)]
