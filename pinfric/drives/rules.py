"""Rules of makers and textbooks that the limits of drives quote."""

from __future__ import annotations

import numpy as np

from pinfric.drives.bearing import BALL
from pinfric.drives.catalog import Nut, Screw
from pinfric.drives.demand import DriveCycle


def momentary_peaks(speed: float, duration: float) -> float:
    """Return how often a strain wave gear bears its momentary peak torque, N = 1e4/(2 n t).

    Args:
        speed: of its input before, rad/s (n turns per second). duration: t of each, s.

    Source: Harmonic Drive CSF/CSG catalogue, rating of the momentary peak torque.
    """
    with np.errstate(divide="ignore"):
        return np.divide(1e4, 2 * speed / (2 * np.pi) * duration)


#: Supports of a screw -> lambda of its first bending mode, n of Euler's buckling load.
_SUPPORTS = {
    "fixed-free": (1.875, 0.25),
    "supported-supported": (3.142, 1.0),
    "fixed-supported": (3.927, 2.0),
    "fixed-fixed": (4.730, 4.0),
}


def critical_speed(screw: Screw) -> float:
    """Return 0.8 of the speed at which a screw whirls, rad/s.

    0.8 lambda^2/l^2 sqrt(E I/(rho A)) of its root, I/A = d^2/16.

    Source: THK, selection of ball screws: permissible rotational speed.
    """
    bending, _ = _SUPPORTS[screw.supports]
    wave = np.sqrt(screw.elasticity / screw.density) * screw.root_diameter / 4
    return float(0.8 * bending**2 / screw.length**2 * wave)


def buckling_load(screw: Screw) -> float:
    """Return half of the axial load at which a screw buckles, N: n pi^2 E I/l^2 x 0.5.

    Source: THK, selection of ball screws: buckling load, with its factor of 0.5.
    """
    _, n = _SUPPORTS[screw.supports]
    second_moment = np.pi * screw.root_diameter**4 / 64
    return float(0.5 * n * np.pi**2 * screw.elasticity * second_moment / screw.length**2)


def dn_speed(screw: Screw) -> float | None:
    """Return the speed of the permissible DN value, rad/s; None where it is not printed.

    Source: THK, selection of ball screws: DN value.
    """
    if screw.max_dn is None or screw.ball_circle is None:
        return None
    return screw.max_dn / (1e3 * screw.ball_circle) * np.pi / 30


def nut_pv(nut: Nut, ratio: float, cycle: DriveCycle) -> float:
    """Return the largest pressure times sliding speed of a nut over a cycle, Pa m/s.

    p v_s = |F|/A |v| sqrt(1 + (ratio d/2)^2), along the thread's helix.

    Args:
        nut: diameter d and contact area A. ratio: of the screw, 2 pi/lead, rad/m.
        cycle: of the joint; the force's worst case.

    Source: Thomson, lead screws: PV; Linear Motion Tips: PV of a lead screw.
    """
    along = np.hypot(1.0, ratio * nut.diameter / 2)
    return float((np.abs(cycle.ends[0] * cycle.velocity)).max() * along / nut.contact_area)


def gear_life(
    nominal_life: float,
    rated_speed: float,
    rated_torque: float,
    average_input_speed: float,
    average_torque: float,
    exponent: float = 3.0,
) -> float:
    """Return L10 of a gear by the bearing of its input, in hours.

    Strain wave gears: L50 = L_n (n_N/n_in,av)(T_N/T_av)^3, L10 = L50/5, of the wave generator's
    balls; infinite where nothing turns or loads. Cycloidal gears print L10 as L_n, of the crank's
    rollers: L10 = L_n (n_N/n_in,av)(T_N/T_av)^(10/3).

    Args:
        nominal_life: L_n, h (L50 at rated torque and speed).
        rated_speed, average_input_speed: n_N and n_in,av, rad/s; pauses count in the average.
        rated_torque, average_torque: T_N and T_av, N m at the output.
        exponent: 3 of balls; that of rollers, 10/3, makes `nominal_life` an L10.

    Source: Harmonic Drive engineering data 1021387 12/2018, p. 32, equations 32.2, 32.3. Rollers:
    ISO 281's exponent, by rule.
    """
    with np.errstate(divide="ignore"):
        turns = nominal_life * np.divide(rated_speed, average_input_speed)
        life = turns * np.divide(rated_torque, average_torque) ** exponent
    return life / 5 if exponent == BALL else life


def resonance(stiffness: float, inertia: float) -> float:
    """Return f = sqrt(K/J)/(2 pi), Hz, of a load J (kg m^2) behind a gear K (N m/rad)."""
    with np.errstate(divide="ignore"):  # a load without inertia
        return np.sqrt(np.divide(stiffness, inertia)) / (2 * np.pi)
