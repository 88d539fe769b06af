"""Limits of drive and load together, as rows of the table."""

from __future__ import annotations

import numpy as np

from pinfric.model.springs import softest
from pinfric.model.transmission import driven_efficiency
from pinfric.study.sizing.criterion import Criterion, Status
from pinfric.study.sizing.limit import Judged, Limit, nothing
from pinfric.study.sizing.rules import resonance

#: Why a load inertia is not known.
_LOOPS = "inertia about a joint of a closed loop"


def _inertia_ratio(d: Judged) -> float | None:
    """Load to motor side, max J_load/(ratio^2 (J_motor + J_gear input)).

    The gear's input (a wave generator) counts with the rotor: it sits on the motor's side of the
    compliance, across which load and motor swing; the rule bounds how unlike they may be.
    """
    inertia, load = d.candidate.rotor_inertia, d.case.load_inertia
    return None if inertia is None or load is None else load / (d.candidate.ratio**2 * inertia)


def _no_inertia(d: Judged) -> str:
    return _LOOPS if d.case.load_inertia is None else d.missing or "rotor inertia"


def _least_resonance(d: Judged) -> float:
    return d.conditions.resonance_hand if d.case.hand else d.conditions.resonance_base


def _stiffness(d: Judged) -> float | None:
    gear = d.candidate.gear
    return None if gear is None or gear.stiffness is None else softest(gear.stiffness)


def _resonance(d: Judged) -> float | None:
    """The joint and those beyond it swing, those nearer the base stand: Dunkerley's lower bound.

    The maker's rule takes the other joints as rigid, which is an upper bound.
    """
    stiffness, inertia = _stiffness(d), d.case.load_inertia
    if stiffness is None or inertia is None:
        return None
    swing = inertia / stiffness + d.case.beyond
    return resonance(1.0, swing) if swing > 0 else np.inf


def _resonance_note(d: Judged) -> str:
    stiffness, inertia = _stiffness(d), d.case.load_inertia
    if stiffness is None or not inertia or not d.case.beyond > 0:
        return ""
    alone = resonance(stiffness, inertia)
    return f"lower bound (Dunkerley); with all other joints rigid {alone:.3g} Hz"


def _back_driving(d: Judged) -> Criterion:
    candidate, wanted = d.candidate, d.conditions.back_driving
    name, formula = "back-driving", "eta_b > 0: a large enough load moves the motor"
    source = "Harmonic Drive: do not rely on the back-driving torque to hold a load"
    effort = candidate.back_driving_torque
    unit = "N" if candidate.linear else "N m"
    note = "" if effort is None else f"the load moves the motor above {effort:.3g} {unit}"
    transmission = candidate.transmission
    known = transmission is not None and (not candidate.at_output or effort is not None)
    if wanted == "any" or not known:
        status = Status.NOT_REQUIRED if wanted == "any" else Status.NOT_CHECKED
        text = note or ("" if wanted == "any" else "no value (losses when the load drives)")
        return Criterion(name, status, None, None, "", None, formula, source, text)
    assert transmission is not None
    back = driven_efficiency(transmission)
    if wanted == "required":
        locked = "self-locking" if back <= 0 else note
        status = Status.PASSES if back > 0 else Status.FAILS
        return Criterion(name, status, None, None, "", back, formula, source, locked)
    status = Status.PASSES if back <= 0 else Status.FAILS
    text = "self-locking" if back <= 0 else "not self-locking: it needs a brake"
    return Criterion(name, status, None, None, "", -back, "eta_b <= 0: self-locking", source, text)


_PRACTICE = "common practice of servo drives"


GEAR_RESONANCE = Limit(
    "gear resonance",
    need=_least_resonance,
    gives=_resonance,
    unit="Hz",
    formula="f = 1/(2 pi sqrt(sum of max J_load/K_1 over this joint and those beyond))",
    source="rule of a maker of strain wave gears: 8 Hz base axes, 15 Hz hand axes (retyped)",
    missing=lambda d: _LOOPS if d.case.load_inertia is None else "stiffness",
    note=_resonance_note,
)

#: In the order of reports.
JOINT_LIMITS = [
    Limit(
        "inertia ratio",
        need=_inertia_ratio,
        gives=lambda d: d.conditions.inertia_ratio,
        unit="",
        formula="max J_load / (ratio^2 (J_motor + J_gear input))",
        source=_PRACTICE + "; the gear's input is on the motor's side of the compliance",
        missing=_no_inertia,
    ),
    GEAR_RESONANCE,
    Limit(
        "backlash",
        need=lambda d: d.candidate.backlash,
        gives=lambda d: d.conditions.backlash,
        unit="place",
        formula="backlash of the gear <= conditions.backlash",
        source="maker's figures",
        missing="backlash of the gear",
        applies=lambda d: d.conditions.backlash is not None,
        settles=("gear's backlash",),
    ),
    Limit(
        "back-driving",
        need=nothing,
        gives=nothing,
        unit="",
        formula="",
        source="",
        settles=("back-driving",),
        verdict=_back_driving,
    ),
]
