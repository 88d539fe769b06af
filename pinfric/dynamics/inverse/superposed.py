"""Cycles of an open chain as sums of stored ones, each reduced to a few figures per drive.

Newton-Euler is linear in inertial parameters and in gravity, and quadratic in the speed factor. So
of cycles along one path that differ in nothing else

    w(t) = sum_b k_b w_b(t),     tau_id(t) = sum_b k_b tau_b(t)

with few numbers k_b for each. What follows from w is not linear, and computed by the kernels that
`inverse_tree` runs: normal loads, friction, efforts, motor torques.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.dynamics.problem.motion_kernels import effort_bounds, mark_reversals
from pinfric.kernels.compiled import kernel
from pinfric.model.bearings import Contacts, normal_loads
from pinfric.model.drives import Gears, gears_of_row, write_motor_torques
from pinfric.model.laws import Laws, friction_bounds, laws_of_row

#: Samples whose wrenches are summed at once: they stay in the first-level cache.
_BLOCK = 64


class Path(NamedTuple):
    """What all cycles share.

    Attributes:
        v, a: (T, nv) at a speed factor of 1, rad/s or m/s, and per second.
        weight: (T,) of each sample in a mean over time; their sum is 1.
        displacement: (T, ns) see `normal_loads`; empty where nothing looks at it.
        joint, velocity_index, ratio: (ns,) row of the site's wrench, and what it moves with.
        contacts: of the sites.
        stick_velocity, site_stick_velocity: (na,) of the drives, (ns,) of the sites.
        geared: whether there is a transmission.
    """

    v: np.ndarray
    a: np.ndarray
    weight: np.ndarray
    displacement: np.ndarray
    joint: np.ndarray
    velocity_index: np.ndarray
    ratio: np.ndarray
    contacts: Contacts
    stick_velocity: np.ndarray
    site_stick_velocity: np.ndarray
    geared: bool


class Basis(NamedTuple):
    """The stored cycles.

    Attributes:
        effort: (nb, T nv) tau_b, one drive per degree of freedom.
        wrench: (nb, T 6 ns) w_b at the sites; no columns where nothing looks at wrenches.
    """

    effort: np.ndarray
    wrench: np.ndarray


class Varied(NamedTuple):
    """What differs from cycle to cycle.

    Attributes:
        coefficient: (n, nb) k_b. speed: (n,) the speed factor.
        laws, gears: `law_table` and `gear_table`, what varies with n (or 1: the same) rows before:
            strengths of the laws, no-load torques, viscous friction and rotors of the gears.
    """

    coefficient: np.ndarray
    speed: np.ndarray
    laws: Laws
    gears: Gears


class Cycle(NamedTuple):
    """One cycle; the names are those of `InverseResult`.

    Attributes:
        velocity, acceleration: (T, na). turns: (T, na) bool, reversals of the drives.
        effort_frictionless, effort_lower, effort_upper: (T, na).
        motor_torque_lower, motor_torque_upper: (T, na).
        site_velocity, normal_load, friction_lower, friction_upper: (T, ns).
        reversal, sticking: (T, ns) bool.
        wrench: (T or block, ns, 6).
    """

    velocity: np.ndarray
    acceleration: np.ndarray
    turns: np.ndarray
    effort_frictionless: np.ndarray
    effort_lower: np.ndarray
    effort_upper: np.ndarray
    motor_torque_lower: np.ndarray
    motor_torque_upper: np.ndarray
    site_velocity: np.ndarray
    normal_load: np.ndarray
    friction_lower: np.ndarray
    friction_upper: np.ndarray
    reversal: np.ndarray
    sticking: np.ndarray
    wrench: np.ndarray

    @classmethod
    def of(cls, path: Path, whole: bool) -> Cycle:
        """Make the buffers for a path, of all wrenches or of a block of them."""
        drives, sites = path.v.shape, (len(path.v), len(path.joint))
        samples = len(path.v) if whole else _BLOCK
        flags = {"turns": drives, "reversal": sites, "sticking": sites}
        arrays = {name: np.empty(shape, dtype=bool) for name, shape in flags.items()}
        for name in cls._fields:
            of_sites = name in ("site_velocity", "normal_load", "friction_lower", "friction_upper")
            arrays.setdefault(name, np.empty(sites if of_sites else drives))
        return cls(**{**arrays, "wrench": np.empty((samples, len(path.joint), 6))})


@kernel
def write_figures(
    effort: np.ndarray,
    wrench: np.ndarray,
    path: Path,
    varied: Varied,
    now: Cycle,
    figures: np.ndarray,
    start: int,
    stop: int,
) -> None:
    """Write what each cycle takes of each drive: figures of the worst end of its efforts.

    Args:
        effort, wrench: `Basis`.
        path, varied: what the cycles share, and what not.
        now: buffers, which hold the last cycle afterwards.
        figures: (n, na, 5) peak, RMS, both at the motor's shaft, largest speed; overwritten.
        start, stop: which of the n cycles.
    """
    for c in range(start, stop):
        _move(path, varied.speed[c], now)
        _superpose(effort, varied.coefficient[c], 0, now.effort_frictionless.reshape(-1))
        _write_loads(wrench, path, varied.coefficient[c], now)
        friction_bounds(
            now.site_velocity,
            now.normal_load,
            laws_of_row(varied.laws, c % varied.laws.viscous.shape[0]),
            now.reversal,
            now.friction_lower,
            now.friction_upper,
            now.sticking,
        )
        efforts = now.effort_lower, now.effort_upper
        effort_bounds(
            now.effort_frictionless,
            now.friction_lower,
            now.friction_upper,
            path.velocity_index,
            path.ratio,
            *efforts,
        )
        _reduce(path.weight, *efforts, figures[c], 0)
        torques = efforts
        if path.geared:
            torques = now.motor_torque_lower, now.motor_torque_upper
            write_motor_torques(
                gears_of_row(varied.gears, c % varied.gears.viscous.shape[0]),
                *efforts,
                now.velocity,
                now.acceleration,
                now.turns,
                *torques,
            )
        _reduce(path.weight, *torques, figures[c], 2)
        for d in range(figures.shape[1]):
            figures[c, d, 4] = np.abs(now.velocity[:, d]).max()


@kernel
def _move(path: Path, speed: float, now: Cycle) -> None:
    """Write velocities, accelerations and reversals at a speed factor."""
    for i in range(path.v.shape[0]):
        for d in range(path.v.shape[1]):
            now.velocity[i, d] = path.v[i, d] * speed
            now.acceleration[i, d] = path.a[i, d] * (speed * speed)
            now.turns[i, d] = False
        for s in range(path.joint.size):
            now.site_velocity[i, s] = now.velocity[i, path.velocity_index[s]] * path.ratio[s]
            now.reversal[i, s] = False
    mark_reversals(now.velocity, path.stick_velocity, now.turns)
    mark_reversals(now.site_velocity, path.site_stick_velocity, now.reversal)


@kernel
def _superpose(basis: np.ndarray, coefficient: np.ndarray, start: int, out: np.ndarray) -> None:
    """Write sum_b k_b basis_b, as many numbers as `out` has, from the place `start` on."""
    for i in range(out.size):
        out[i] = 0.0
    for b in range(coefficient.size):
        k, row = coefficient[b], basis[b, start : start + out.size]
        for i in range(out.size):
            out[i] += k * row[i]


@kernel
def _write_loads(wrench: np.ndarray, path: Path, coefficient: np.ndarray, now: Cycle) -> None:
    """Write the normal loads of the summed wrenches, block by block."""
    samples, width = path.v.shape[0], 6 * path.joint.size
    for start in range(0, samples, now.wrench.shape[0]):
        stop = min(start + now.wrench.shape[0], samples)
        here = now.wrench[: stop - start]
        if wrench.shape[1] > 0:
            _superpose(wrench, coefficient, start * width, here.reshape(-1))
        normal_loads(
            here,
            path.joint,
            path.contacts,
            path.displacement[start:stop],
            now.normal_load[start:stop],
        )


@kernel
def _reduce(
    weight: np.ndarray, lower: np.ndarray, upper: np.ndarray, figures: np.ndarray, column: int
) -> None:
    """Write peak and RMS of the ends of larger magnitude, from a column of figures (na, 5) on."""
    for d in range(figures.shape[0]):
        peak, square = 0.0, 0.0
        for i in range(weight.size):
            worst = max(abs(lower[i, d]), abs(upper[i, d]))
            peak = max(peak, worst)
            square += weight[i] * worst * worst
        figures[d, column], figures[d, column + 1] = peak, np.sqrt(square)
