"""Kernels: cycles of an open chain as sums of stored ones, reduced to a few figures per drive.

tau_id(t) = sum_b k_b tau_b(t), and likewise the parts B w of wrenches whose norms are the sites'
loads, as `superposition` explains. Loads, friction, efforts and motor torques are not linear; the
kernels of `dynamics` and `model` compute them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.drives.cycles import Rated, write_asked
from pinfric.dynamics.samples.motion_kernels import (
    TreeSamples,
    effort_bounds,
    mark_reversals,
    part_of,
)
from pinfric.kernels.compiled import kernel
from pinfric.model.drives import Gears, gears_of_row, write_motor_torques
from pinfric.model.laws import Laws, friction_bounds, laws_of_row
from pinfric.model.scene import SiteTables

#: Samples whose parts are summed at once: they stay in the first-level cache.
_BLOCK = 64


class Path(NamedTuple):
    """The common data of all cycles.

    Attributes:
        t: (T,) s. v, a: (T, nv) rad/s or m/s, and per second; at a speed factor of 1.
        weight: (T,) of each sample in a mean over time; their sum is 1.
        sites: `Scene.site_tables`.
        stick_velocity: (na,) of the drives.
        geared: whether there is a transmission.
    """

    t: np.ndarray
    v: np.ndarray
    a: np.ndarray
    weight: np.ndarray
    sites: SiteTables
    stick_velocity: np.ndarray
    geared: bool


class Basis(NamedTuple):
    """The stored cycles.

    Attributes:
        effort: (nb, T nv) tau_b, one drive per degree of freedom.
        part: (nb, T np) of w_b: (B + s C) w_b of each term of `Contacts`, its rank of numbers, then
            force and moment of each drive on trial whose bearing is judged, in axes of its joint.
    """

    effort: np.ndarray
    part: np.ndarray


class Varied(NamedTuple):
    """What differs from cycle to cycle.

    Attributes:
        coefficient: (n, nb) k_b. speed: (n,) the speed factor.
        laws, gears: `law_table` and `gear_table`; the strengths of the laws, no-load torques,
            viscous friction and rotors of the gears with n (or 1: the same) rows before.
    """

    coefficient: np.ndarray
    speed: np.ndarray
    laws: Laws
    gears: Gears


class Cycle(NamedTuple):
    """Buffers of one cycle.

    Attributes:
        samples: of its joints.
        velocity, acceleration: (T, na) of the drives. turns: (T, na) bool, their reversals.
        motor_torque_lower, motor_torque_upper: (T, na).
        part: (block, np).
        t: (T,). of_drive: (5, T) of one drive on trial: velocity, ends of effort and motor torque.
        carried: (k, T, 6) of joints on trial: force and moment in axes of their own.
    """

    samples: TreeSamples
    velocity: np.ndarray
    acceleration: np.ndarray
    turns: np.ndarray
    motor_torque_lower: np.ndarray
    motor_torque_upper: np.ndarray
    part: np.ndarray
    t: np.ndarray
    of_drive: np.ndarray
    carried: np.ndarray

    @classmethod
    def of(cls, path: Path, basis: Basis, trials: int) -> Cycle:
        """Make the buffers for a path, its wrenches block by block, and drives on trial."""
        samples, ns = len(path.v), len(path.sites.joint)
        of_sites, of_drives = np.empty((4, samples, ns)), np.empty((7, *path.v.shape))
        flags = np.empty((2, samples, ns), dtype=bool)
        of_samples = TreeSamples._make(
            [of_sites[0], flags[0], np.empty((0, 0)), *of_drives[:3], *of_sites[1:], flags[1]]
        )
        turns = np.empty(path.v.shape, dtype=bool)
        part = np.empty((_BLOCK, basis.part.shape[1] // samples))
        tried = np.empty(samples), np.empty((5, samples)), np.empty((trials, samples, 6))
        return cls._make([of_samples, *of_drives[3:5], turns, *of_drives[5:], part, *tried])


@kernel
def write_figures(
    effort: np.ndarray,
    part: np.ndarray,
    path: Path,
    varied: Varied,
    cycle: Cycle,
    tried: Rated | None,
    figures: np.ndarray,
    asked: np.ndarray,
) -> None:
    """Write the figures of each cycle and drive, at the worst end of its efforts.

    Args:
        effort, part: `Basis`.
        path, varied: what the cycles share, and what not.
        cycle: buffers.
        tried: the k drives on trial; None: there are none.
        figures: (n, na, 5) peak, RMS, both at the motor's shaft, largest speed; overwritten.
        asked: (n, k, ...) what each cycle asks of drives on trial (`Asked`); overwritten.
    """
    x = cycle.samples
    for c in range(figures.shape[0]):
        _move(path, varied.speed[c], cycle)
        _superpose(effort, varied.coefficient[c], 0, x.effort_frictionless.reshape(-1))
        _bound_blocks(part, path, varied, c, cycle, tried)
        efforts = x.effort_lower, x.effort_upper
        _reduce(path.weight, *efforts, figures[c], 0)
        torques = efforts
        if path.geared:
            torques = cycle.motor_torque_lower, cycle.motor_torque_upper
            write_motor_torques(
                gears_of_row(varied.gears, c % varied.gears.viscous.shape[0]),
                *efforts,
                cycle.velocity,
                cycle.acceleration,
                cycle.turns,
                *torques,
            )
        _reduce(path.weight, *torques, figures[c], 2)
        for d in range(figures.shape[1]):
            figures[c, d, 4] = np.abs(cycle.velocity[:, d]).max()
        if tried is not None:
            for i in range(path.t.size):
                cycle.t[i] = path.t[0] + (path.t[i] - path.t[0]) / varied.speed[c]
            for k in range(tried.column.size):
                _write_trial(path, cycle, torques, tried, k, asked[c, k])


@kernel
def _write_trial(
    path: Path,
    cycle: Cycle,
    torques: tuple[np.ndarray, np.ndarray],
    tried: Rated,
    k: int,
    asked: np.ndarray,
) -> None:
    """Write what the buffered cycle asks of one drive on trial."""
    d, x, own = tried.column[k], cycle.samples, cycle.of_drive
    for i in range(path.t.size):
        own[0, i] = cycle.velocity[i, d]
        own[1, i], own[2, i] = x.effort_lower[i, d], x.effort_upper[i, d]
        own[3, i], own[4, i] = torques[0][i, d], torques[1][i, d]
    carried = cycle.carried[k] if tried.carried[k] >= 0 else cycle.carried[k, :0]
    stick = path.stick_velocity[d]
    write_asked(tried, k, cycle.t, own[0], own[1:3], own[3:], carried, stick, asked)


@kernel
def _move(path: Path, speed: float, cycle: Cycle) -> None:
    """Write velocities, accelerations and reversals at a speed factor."""
    sites, x = path.sites, cycle.samples
    for i in range(path.v.shape[0]):
        for d in range(path.v.shape[1]):
            cycle.velocity[i, d] = path.v[i, d] * speed
            cycle.acceleration[i, d] = path.a[i, d] * (speed * speed)
            cycle.turns[i, d] = False
        for s in range(sites.joint.size):
            x.velocity[i, s] = cycle.velocity[i, sites.velocity_index[s]] * sites.ratio[s]
            x.reversal[i, s] = False
    mark_reversals(cycle.velocity, path.stick_velocity, cycle.turns)
    mark_reversals(x.velocity, sites.laws.stick_velocity, x.reversal)


@kernel
def _superpose(basis: np.ndarray, coefficient: np.ndarray, start: int, out: np.ndarray) -> None:
    """Write sum_b k_b basis_b into `out`, from column `start` of the basis on."""
    for i in range(out.size):
        out[i] = 0.0
    for b in range(coefficient.size):
        k, row = coefficient[b], basis[b, start : start + out.size]
        for i in range(out.size):
            out[i] += k * row[i]


@kernel
def _bound_blocks(
    part: np.ndarray,
    path: Path,
    varied: Varied,
    c: int,
    cycle: Cycle,
    tried: Rated | None,
) -> None:
    """Write loads, friction and efforts of one cycle from the summed parts, by blocks."""
    sites, samples, width = path.sites, path.t.size, cycle.part.shape[1]
    laws = laws_of_row(varied.laws, c % varied.laws.viscous.shape[0])
    for start in range(0, samples, cycle.part.shape[0]):
        stop = min(start + cycle.part.shape[0], samples)
        here, x = cycle.part[: stop - start], part_of(cycle.samples, start, stop)
        _superpose(part, varied.coefficient[c], start * width, here.reshape(-1))
        _write_loads(here, sites, x.normal_load)
        lower, upper = x.friction_lower, x.friction_upper
        friction_bounds(x.velocity, x.normal_load, laws, x.reversal, lower, upper, x.sticking)
        effort_bounds(
            x.effort_frictionless,
            lower,
            upper,
            sites.velocity_index,
            sites.ratio,
            x.effort_lower,
            x.effort_upper,
        )
        if tried is not None:
            for k in range(tried.column.size):
                if tried.carried[k] >= 0:
                    for i in range(stop - start):
                        for j in range(6):
                            cycle.carried[k, start + i, j] = here[i, tried.carried[k] + j]


@kernel
def _write_loads(part: np.ndarray, sites: SiteTables, load: np.ndarray) -> None:
    """Write each site's normal load (n, ns), as `normal_loads`, from parts (n, np)."""
    contacts = sites.contacts
    for i in range(part.shape[0]):
        for s in range(sites.joint.size):
            load[i, s] = contacts.constant[s]
        first = 0
        for t in range(contacts.site.size):
            square = 0.0
            for j in range(first, first + contacts.rank[t]):
                square += part[i, j] * part[i, j]
            load[i, contacts.site[t]] += np.sqrt(square)
            first += contacts.rank[t]


@kernel
def _reduce(
    weight: np.ndarray, lower: np.ndarray, upper: np.ndarray, figures: np.ndarray, column: int
) -> None:
    """Write peak and RMS of the ends of larger magnitude into two columns of figures (na, 5)."""
    for d in range(figures.shape[0]):
        peak, square = 0.0, 0.0
        for i in range(weight.size):
            worst = max(abs(lower[i, d]), abs(upper[i, d]))
            peak = max(peak, worst)
            square += weight[i] * worst * worst
        figures[d, column], figures[d, column + 1] = peak, np.sqrt(square)
