"""Limits of a drive when its brake closes at speed, as rows of the table.

The brake on the motor's side stops rotor and load through the gear, the other joints held:

    |t| = (|r| T_b + J_r G/J_L)/(eta_b + J_r/J_L),     J_r = r^2 J_rotor,

of J_L a = t + G and, in the gear, eta_b t = -|r| T_b - J_r a, without the joint's friction. G is
the largest effort of the cycle, J_L the largest inertia. `pinfric stop` simulates all joints.
"""

from __future__ import annotations

from pinfric.model.transmission import driven_efficiency
from pinfric.study.sizing.limit import Judged, Limit


def brake_peak(
    torque: float, ratio: float, rotor: float, load: float, effort: float, efficiency: float
) -> float | None:
    """Return the effort (N m or N) that a gear bears when a brake closes; see the module.

    Args:
        torque: T_b at the motor's shaft, N m. ratio: motor turns per turn or m of the joint.
        rotor: J_rotor at the shaft, kg m^2. load: J_L about the joint, kg m^2 (kg).
        effort: G that the load pushes on, N m or N. efficiency: eta_b of the driven gear; where a
            self-locking gear jams there is no bound: None.
    """
    heavy = ratio**2 * rotor / load
    slope = efficiency + heavy
    return (abs(ratio) * torque + heavy * effort) / slope if slope > 0.0 else None


def _brake_peak(d: Judged) -> float | None:
    gear, load = d.candidate.transmission, d.case.load_inertia
    if gear is None or gear.brake is None or load is None or not load > 0.0:
        return None
    torque = gear.brake.torque_max or gear.brake.torque
    eta = driven_efficiency(gear)
    return brake_peak(torque, gear.ratio, gear.rotor_inertia, load, d.demand.peak, eta)


def _braked(d: Judged) -> bool:
    """Whether a gear lies between the drive's brake and the joint."""
    return d.candidate.brake != "" and (d.candidate.gear is not None or d.candidate.ratio != 1.0)


def _momentary_peak(d: Judged) -> float | None:
    return None if d.candidate.gear is None else d.gear.momentary_peak_torque


def _missing(d: Judged) -> str:
    """What the row lacks, in words; a gear whose catalogue prints no limit first."""
    if d.candidate.gear is None:
        return "momentary peak of the gear in the gearmotor"
    if d.gear.momentary_peak_torque is None:
        return "momentary peak"
    if d.candidate.transmission is None:
        return d.missing
    return "inertia of the load" if not d.case.load_inertia else "a bound: the driven gear jams"


STOP_LIMITS = [
    Limit(
        "gear momentary peak torque, brake closing",
        need=_brake_peak,
        gives=_momentary_peak,
        unit="effort",
        formula="(|r| T_b + J_r G/J_L)/(eta_b + J_r/J_L) <= limit for momentary peak torque",
        source="statics and dynamics of one axis, the gear rigid; pinfric stop simulates all",
        missing=_missing,
        applies=_braked,
    )
]
