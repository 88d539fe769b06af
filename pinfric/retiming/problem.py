"""A path with its drives as one problem of `scan.fastest`, and what went wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pinfric.drives.limit import signals
from pinfric.drives.limits import instant_limits
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import RetimeError
from pinfric.model.couples import rate_rows
from pinfric.model.drives import gear_table
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import JointColumn, configurations
from pinfric.retiming.limits import DriveLimits, drive_speeds, joint_speeds
from pinfric.retiming.path import Path
from pinfric.retiming.profile import Profile, columns_to_velocities
from pinfric.retiming.scan import MOVING, WORST, Scan, box_scan, fastest
from pinfric.retiming.tables import Grid, Tables, carried_names


@dataclass(frozen=True)
class Policy:
    """Accuracy settings of retiming.

    Where a joint stands still, starts or reverses, both ends of its interval of efforts are within
    the limits, as `inverse_dynamics` reports them.

    Attributes:
        sample_rate: Hz, of the samples that are within the limits.
        tolerance: part of a limit by which it may be exceeded between grid points.
    """

    sample_rate: float = 1000.0
    tolerance: float = 1e-3


@dataclass(frozen=True)
class PathProblem:
    """A grid with everything that limits the speed along it.

    Attributes:
        scene: an open chain, with the drives' transmissions. limits: (na,) of these.
        mode: (n, 2, nv) see `scan.MOVING`. constant: (n,) bool, u is constant in the interval.
        share: (n,) part of the limits that may be used in the interval.
    """

    scene: Scene
    path: Path
    columns: tuple[JointColumn, ...]
    limits: tuple[DriveLimits, ...]
    policy: Policy
    grid: Grid
    tables: Tables
    mode: np.ndarray
    constant: np.ndarray
    share: np.ndarray

    @cached_property
    def _sites(self) -> dict[str, np.ndarray]:
        """The fields of `Scan` that say which sites' friction acts on which drive."""
        sites, nv = self.scene.site_tables, self.scene.model.nv
        order = np.argsort(sites.velocity_index, kind="stable")
        counts = np.bincount(sites.velocity_index, minlength=nv)
        terms = np.bincount(sites.contacts.site, minlength=len(order))
        return {
            "site_start": np.concatenate(([0], np.cumsum(counts))),
            "site": order,
            "weight": np.abs(sites.ratio[order]),
            "turn": np.sign(sites.ratio[order]),
            "term_start": np.concatenate(([0], np.cumsum(terms))),
            "load": sites.contacts.constant,
        }

    def scan(self) -> Scan:
        """Return what `scan.fastest` reads."""
        grid, limits, drives = self.grid, self.limits, self.scene.drives
        S = rate_rows(drives, self.scene.model.nv)
        rate, curvature = grid.rate @ S.T, grid.curvature @ S.T
        with np.errstate(divide="ignore"):
            top = ((drive_speeds(drives, limits) / np.abs(rate)) ** 2).min(axis=1)
            own = ((joint_speeds(self.scene) / np.abs(grid.rate)) ** 2).min(axis=1)
        share = np.ones(len(top))
        np.minimum.at(share, grid.start, self.share)
        np.minimum.at(share, grid.end, self.share)
        top = share**2 * np.minimum(top, own)
        stick = [self.scene.stick_velocity_of(drive) for drive in drives]

        def least(signal: str) -> np.ndarray:
            return np.array([x.least(signal) for x in limits])

        return Scan(
            step=grid.step,
            start=grid.start,
            end=grid.end,
            stop=grid.stop,
            effort=self.tables.effort,
            gram=self.tables.gram,
            rate=rate,
            curvature=curvature,
            top=np.minimum(top, 1e15),
            way=grid.direction,
            mode=self.mode,
            constant=self.constant,
            share=self.share,
            laws=self.scene.site_tables.laws,
            gears=gear_table([drive.transmission for drive in drives], stick),
            peak=least("motor torque"),
            stall=np.array([x.stall_torque for x in limits]),
            no_load_speed=np.array([x.no_load_speed for x in limits]),
            effort_limit=least("effort"),
            acceleration=least("acceleration"),
            work=np.empty((self.tables.gram.shape[1], 3)),
            head=np.empty(8),
            holes=np.zeros(1, dtype=np.int64),
            **self._sites,
        )

    def solve(self) -> Profile:
        """Return the fastest profile.

        Raises:
            RetimeError: there is none; names the place, the drive, what it needs and has.
        """
        x, u = np.empty(len(self.grid.stop)), np.empty((len(self.grid.step), 2))
        scan = self.scan()
        failed = fastest(box_scan(scan), x, u)
        if failed >= 0:
            raise RetimeError(self._why(failed))
        return replace(Profile.of(self.grid, x, u), holes=int(scan.holes[0]))

    def states(
        self,
        s: np.ndarray,
        piece: np.ndarray,
        x: np.ndarray,
        u: np.ndarray,
        attached: np.ndarray | None = None,
    ) -> InverseResult:
        """Return inverse dynamics at places of the path, as states without order.

        Args:
            s, piece: (m,) places. x, u: (m,) (ds/dt)^2 and d^2s/dt^2.
            attached: (m, np) what is carried; None: by the pieces.
        """
        q, rate, bend = (np.empty((len(s), self.path.nj)) for _ in range(3))
        for p in np.unique(piece):
            here, curve = piece == p, self.path.pieces[p]
            q[here], rate[here], bend[here] = curve(s[here]), curve(s[here], 1), curve(s[here], 2)
        v = columns_to_velocities(self.columns, rate * np.sqrt(x)[:, None])
        a = columns_to_velocities(self.columns, rate * u[:, None] + bend * x[:, None])
        if attached is None and self.path.attached is not None:
            attached = self.path.attached[piece]
        full = configurations(self.columns, q, self.scene.model.nq)
        return inverse_dynamics(self.scene, full, v, a, attached=attached)

    def _why(self, interval: int) -> str:
        """Say where the path cannot be followed further, and which drive is why."""
        grid, n = self.grid, len(self.grid.step)
        row = grid.start[interval]
        piece, s = int(grid.piece[row]), float(grid.s[row])
        where = self.place(piece, s)
        still = self.states(np.array([s]), np.array([piece]), np.zeros(1), np.zeros(1))
        use = usage(still, self.limits)[0]
        d, kind = divmod(int(use.argmax()), use.shape[1])
        if use[d, kind] > 1.0:
            what = "break away" if grid.stop[interval] and grid.direction[interval, d] else "hold"
            return f"{where}: drive {self.limits_text(still, d, kind, what)}"
        for k, drive in enumerate(self.scene.drives):
            x, u = np.empty(n + 1), np.empty((n, 2))
            limits = (*self.limits[:k], DriveLimits(), *self.limits[k + 1 :])
            if fastest(box_scan(replace(self, limits=limits).scan()), x, u) != interval:
                return (
                    f"{where}: drive {drive.name!r} cannot follow the path on from there at "
                    "any speed; a stronger drive, or less curvature"
                )
        return f"{where}: several drives together cannot follow the path at any speed"

    def stalled(self, profile: Profile, interval: int) -> str:
        """Say where a profile would stop within an interval (`stalls`), and which drive is why."""
        row = self.grid.start[interval]
        s, piece = float(self.grid.s[row]), int(self.grid.piece[row])
        x, u = profile.x[[interval]], profile.u[interval, :1]
        use = usage(self.states(np.array([s]), np.array([piece]), x, u), self.limits)[0]
        d, kind = divmod(int(use.argmax()), use.shape[1])
        return (
            f"{self.place(piece, s)}: drive {self.scene.drives[d].name!r}, at its "
            f"{instant_limits()[kind].name}, comes to a standstill and cannot follow the path on; "
            "a stronger drive, or less curvature"
        )

    def place(self, piece: int, s: float) -> str:
        """Say where on the path a place is."""
        curve = self.path.pieces[piece]
        share = (s - curve.x[0]) / (curve.x[-1] - curve.x[0])
        text = "at the start" if share <= 0 else f"at {100 * share:.0f} %"
        return f"{self.path.source}: {text} of piece {piece}{self.carrying(piece)}"

    def carrying(self, piece: int) -> str:
        """Say what a piece carries; empty if nothing."""
        carried = carried_names(self.scene, self.path, piece)
        return f", carrying {', '.join(carried)}" if carried else ""

    def limits_text(self, result: InverseResult, d: int, kind: int, what: str) -> str:
        """Say what a drive would need in the first sample to `what`, and what it has."""
        torques = result.motor_torque_lower[0, d], result.motor_torque_upper[0, d]
        efforts = result.effort_lower[0, d], result.effort_upper[0, d]
        x, unit = self.limits[d], self.scene.drives[d].unit
        name = self.scene.drives[d].name
        if instant_limits()[kind].need == "effort":
            need, have, of = max(map(abs, efforts)), x.least("effort"), unit
        else:
            need, have = max(map(abs, torques)), min(x.least("motor torque"), x.stall_torque)
            of = f"{self.scene.drives[d].motor_unit} of its motor"
        return f"{name!r} cannot {what}: needs {need:.4g} {of}, has {have:.4g}"


def modes(grid: Grid, zones: Sequence[tuple[int, int, float, float]]) -> np.ndarray:
    """Return the mode of each drive at both ends of each interval, (n, 2, nv).

    `zones`: (drive, piece, from s, to s) in which it reverses, and both signs count.
    """
    direction, rests_ = grid.direction, grid.direction == 0.0
    mode = np.full((*direction.shape[:1], 2, direction.shape[1]), MOVING)
    for j in range(len(direction)):
        new = np.ones(direction.shape[1], bool) if grid.stop[j] else rests_[j - 1]
        mode[j, 0, new] = WORST
    middle = 0.5 * (grid.s[grid.start] + grid.s[grid.end])
    for d, piece, first, last in zones:
        inside = (grid.piece[grid.start] == piece) & (first < middle) & (middle < last)
        mode[inside, :, d] = WORST
    mode[np.broadcast_to(rests_[:, None, :], mode.shape)] = WORST
    return mode


def usage(result: InverseResult, limits: Sequence[DriveLimits], needed: bool = False) -> np.ndarray:
    """Return the used part of each limit, (T, na, number of `instant_limits`).

    `needed`: of a drive at rest only the least torque of its interval counts: it can hold.
    """
    rows = instant_limits()
    line = np.array(
        [x.stall_torque / x.no_load_speed if x.stall_torque < np.inf else 0.0 for x in limits]
    )
    asked = signals(result, line, needed)
    use = np.empty((*asked["speed"].shape, len(rows)))
    for k, limit in enumerate(rows):
        use[:, :, k] = asked[str(limit.need)] / [x.bound(limit) for x in limits]
        if limit.need == "speed":  # the URDF's, of the joints
            joints = np.abs(result.states.v) / joint_speeds(result.scene)
            for d, drive in enumerate(result.scene.drives):
                if drive.velocity_index >= 0:  # a cylinder has no joint's limit
                    own = joints[:, drive.velocity_index]
                    use[:, d, k] = np.maximum(use[:, d, k], own)
    return use
