"""Rules of makers and textbooks that the limits of drives quote."""

from __future__ import annotations

import numpy as np

from pinfric.study.sizing.demand import DriveCycle
from pinfric.study.summary import rms


def momentary_peaks(speed: float, duration: float) -> float:
    """Return how often a strain wave gear bears its momentary peak torque, N = 1e4/(2 n t).

    Args:
        speed: of its input before, rad/s (n turns per second). duration: t of each, s.

    Source: Harmonic Drive CSF/CSG catalogue, rating of the momentary peak torque.
    """
    return 1e4 / (2 * speed / (2 * np.pi) * duration) if speed > 0 else np.inf


def gear_life(
    nominal_life: float,
    rated_speed: float,
    rated_torque: float,
    average_input_speed: float,
    average_torque: float,
) -> tuple[float, float]:
    """Return (L10, L50) of a strain wave gear's wave generator bearing, in hours.

    L50 = L_n (n_N/n_in,av)(T_N/T_av)^3, L10 = L50/5; infinite where nothing turns or loads.

    Args:
        nominal_life: L_n, h (L50 at rated torque and speed).
        rated_speed, average_input_speed: n_N and n_in,av, rad/s; pauses count in the average.
        rated_torque, average_torque: T_N and T_av, N m at the output.

    Source: Harmonic Drive engineering data 1021387 12/2018, p. 32, equations 32.2, 32.3.
    """
    if not (average_input_speed > 0 and average_torque > 0):
        return np.inf, np.inf
    l50 = nominal_life * rated_speed / average_input_speed * (rated_torque / average_torque) ** 3
    return l50 / 5, l50


def resonance(stiffness: float, inertia: float) -> float:
    """Return f = sqrt(K/J)/(2 pi), Hz, of a load J (kg m^2) behind a gear K (N m/rad)."""
    return float(np.sqrt(stiffness / inertia) / (2 * np.pi))


def optimum_ratio(cycle: DriveCycle, effort: np.ndarray, rotor_inertia: float) -> float:
    """Return the ratio of least RMS motor torque: r^2 = rms(T*)/(J_rotor rms(a)).

    From T_m,rms^2 = rms(T*)^2/r^2 + 2 J mean(T* a) + r^2 J^2 rms(a)^2, gear losses left out;
    infinite where the joint never accelerates.

    Args:
        cycle: the joint's samples.
        effort: (T,) T*, N m. rotor_inertia: J at the motor's shaft, kg m^2.

    Source: Giberti, Cinquemani, Legnani: choice of motor and ratio by accelerating factor.
    """
    moving = rms(cycle.stretched, cycle.acceleration)
    inertial = rotor_inertia * moving  # a product of two positive numbers may still be 0
    return float(np.sqrt(rms(cycle.stretched, effort) / inertial)) if inertial > 0 else np.inf


def load_factor(cycle: DriveCycle, effort: np.ndarray) -> float:
    """Return beta = 2 (rms(a) rms(T*) + mean(a T*)), W/s: what the load asks of T_N^2/J_rotor.

    A motor can do it with some ratio if its accelerating factor T_N^2/J_rotor >= beta/eta.

    Args:
        cycle: the joint's samples.
        effort: (T,) T*, N m.

    Source: Giberti, Cinquemani, Legnani: choice of motor and ratio by accelerating factor.
    """
    a, t = cycle.acceleration, cycle.stretched
    mixed = float(np.trapezoid(a * effort, t) / (t[-1] - t[0]))
    return 2 * (rms(t, a) * rms(t, effort) + mixed)
