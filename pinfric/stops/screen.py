"""What of stops algebra settles, so that a choice of drives simulates only what it leaves open.

    gear      1.32 `stop_factor` times its peak by algebra (`stops.peaks`) <= its limit
    energy    the lesser of |r_j| T_b way_j, which the brake takes on its way, and of all there is,
              max kinetic energy with rotors + sum_k max|load of k at rest| way_k <= stop_energy
    place     no limit within way_j of any place of the cycle,    way_j = 1.3 times the estimate

with what others' stops add (`Estimates.most`). Gears that are left open are simulated with the
greatest friction and brakes, places with the least, energies with both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pinfric.drives.criterion import Criterion
from pinfric.model.described import described, quantity
from pinfric.model.mass_matrix import mass_matrices
from pinfric.motions.trajectory import Trajectory
from pinfric.stops.axes import Figures, Nearest, axis_criteria, not_met, simulated
from pinfric.stops.machines import MachineKind, Machines
from pinfric.stops.search import Measured, StopCycle, StopSearch, estimates, past
from pinfric.stops.study import StopResult, checked_cycle, result_of

#: Reserve on peaks of gears by algebra: simulated ones are 0.76 to 1.06 of them in category 0 of
#: three arms, and were once 1.32 of another.
PEAK_RESERVE = 1.32
#: Reserve on estimated ways (`Estimates.most`).
WAY_RESERVE = 1.3


@dataclass(frozen=True, eq=False)
class ScreenedStops:
    """The stops of a cycle as far as a choice of drives needs them.

    Attributes:
        search: with the stops that were simulated.
        criteria: of each drive.
        peaks: simulated peaks of gears by their columns, N m or N, of those that algebra leaves.
    """

    search: StopSearch
    criteria: tuple[tuple[Criterion, ...], ...]
    peaks: Mapping[int, float]

    @cached_property
    def result(self) -> StopResult:
        """All stops, with their times and ways; simulated when it is asked for.

        Raises:
            StopError: of `stop`.
        """
        return result_of(replace(self.search, measured=None, found=dict(self.search.found)))


@described
class StopScreen:
    """The stops of a sizing."""

    category: int = quantity("of IEC 60204-1")
    reaction_time: float = quantity("from the command until the drives react", "s")
    friction: tuple[float, float] = quantity("least and greatest factor on all friction")
    payload: tuple[str, ...] = quantity("payloads of the full load")
    simulated: int = quantity("number of stops simulated; the others are settled by algebra")
    criteria: int = quantity("number of criteria of all joints")
    not_checked: int = quantity("number of them that lack a figure")
    unmet: tuple[str, ...] = quantity("criteria that are not met")


def stop_screen(stops: ScreenedStops) -> StopScreen:
    """Return what a sizing prints and writes of its stops."""
    machines = stops.search.machines
    names = machines.scene.actuator_names
    pairs = [(name, c) for name, own in zip(names, stops.criteria, strict=True) for c in own]
    return StopScreen(
        category=machines.settings.category,
        reaction_time=machines.settings.reaction_time,
        friction=machines.settings.friction,
        payload=machines.full,
        simulated=len(stops.search.found),
        criteria=len(pairs),
        not_checked=sum(c.unchecked for _, c in pairs),
        unmet=tuple(not_met(name, c) for name, c in pairs if c.fails),
    )


def screened_stops(
    machines: Machines,
    trajectory: Trajectory,
    peaks: np.ndarray | None,
    progress: Callable[[int, int], None],
) -> ScreenedStops:
    """Return the criteria of a cycle's stops, simulated only where algebra does not settle them.

    Args:
        peaks: (na,) of gears by algebra (`cycle_peaks`), N m or N; None or NaN: it tells none.
        progress: as of `stop`.

    Raises:
        StopError: of `stop`. TrajectoryError: of `stop`.
    """
    cycle, drives = checked_cycle(machines, trajectory), machines.scene.drives
    bounds = zip(*_bounds(machines, cycle), strict=True)
    told = np.full(len(drives), np.nan) if peaks is None else peaks
    figures = [
        _by_algebra(machines, float(told[d]), float(energy), nearest)
        for d, (energy, nearest) in enumerate(bounds)
    ]
    judged = [axis_criteria(machines, cycle, d, own) for d, own in enumerate(figures)]
    is_open = {
        name: np.array([any(c.fails for c in own[name]) for own in judged])
        for name in Measured._fields
    }
    search = StopSearch(machines, cycle, progress, measured=Measured(**is_open))
    search.run()
    shown = {d: simulated(search, d) for d in range(len(drives)) if search.found}
    for d, own in enumerate(judged):
        if which := [name for name in is_open if is_open[name][d]]:
            by_stops = axis_criteria(machines, cycle, d, shown[d])
            own |= {name: by_stops[name] for name in which}
    return ScreenedStops(
        search,
        tuple(tuple(c for rows in own.values() for c in rows) for own in judged),
        {d: own.peak for d, own in shown.items() if is_open["peak"][d]},
    )


def _by_algebra(machines: Machines, peak: float, energy: float, nearest: Nearest | None) -> Figures:
    reserve, most = PEAK_RESERVE * machines.reserve, peak if np.isfinite(peak) else np.inf
    return Figures(
        most,
        reserve,
        reserve * most,
        energy,
        nearest,
        (
            "x the peak in stops of all joints",
            "algebra (`stops.peaks`), friction and brake at their greatest, a rigid gear",
        ),
        (
            "min(|r| T_b way, max kinetic energy + sum of max |load at rest| way)",
            f"algebra, on {WAY_RESERVE:g} x the estimated way",
        ),
        (f"{WAY_RESERVE:g} x the estimated way", "estimate (`stops.search`); the URDF's limit"),
    )


def _bounds(machines: Machines, cycle: StopCycle) -> tuple[np.ndarray, list[Nearest | None]]:
    """Return (na,) the most energy of any brake (J), and what comes nearest to a limit."""
    scene, trajectory = machines.scene, cycle.trajectory
    count, q = len(scene.drives), trajectory.q[:, cycle.place]
    ratio = np.abs(scene.gears().ratio)
    heavy = scene.gears().rotor_inertia * ratio**2
    moves = np.flatnonzero(trajectory.v.any(axis=1))
    energy, nearest = np.zeros(count), list[Nearest | None]([None] * count)
    for load in (0.0, 1.0) if machines.full else (0.0,):
        taken = np.zeros(count)
        for kind in (MachineKind(True, load), MachineKind(False, load)):
            way = WAY_RESERVE * estimates(machines, cycle, kind).most
            torque = machines.of(kind).torque
            brake = np.array([torque.get(drive.name, 0.0) for drive in scene.drives])
            taken = np.maximum(taken, _work(brake * ratio, way))
        v, rate = trajectory.v[moves], cycle.rate[moves]
        M = mass_matrices(scene.twin(machines.of(kind).carried), trajectory.q[moves])
        kinetic = 0.5 * (np.einsum("ti,tij,tj->t", v, M, v) + rate**2 @ heavy)
        added = _work(np.abs(cycle.hold[load > 0.0]).max(axis=0), way).sum()
        energy = np.maximum(energy, np.minimum(taken, kinetic.max(initial=0.0) + added))
        reach = np.stack([past(cycle.limits, q - way)[..., 0], past(cycle.limits, q + way)[..., 1]])
        for d in np.flatnonzero(np.isfinite(cycle.limits).any(axis=1)).tolist():
            side, sample = divmod(int(np.argmax(reach[..., d])), len(q))
            beyond, before = float(reach[side, sample, d]), nearest[d]
            if before is None or beyond > before.beyond:
                command = cycle.before(sample, 1.0)[0]
                nearest[d] = Nearest(sample, 1.0, command, load, side, beyond)
    return energy, nearest


def _work(effort: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return (na,) effort times the longest way; 0 where the effort (na,) is, J."""
    return np.multiply(effort, way.max(axis=0), out=np.zeros(len(effort)), where=effort > 0.0)
