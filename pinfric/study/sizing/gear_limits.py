"""Limits of gears, and those that a motor file or a URDF states, as rows of the table."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pinfric.study.sizing.catalog import Nut, Screw
from pinfric.study.sizing.limit import Judged, Limit, never, nothing
from pinfric.study.sizing.rules import (
    buckling_load,
    critical_speed,
    dn_speed,
    gear_life,
    momentary_peaks,
    nut_pv,
)

#: Harmonic Drive's selection procedure, as read: "Torque based dimensioning" and life.
_HARMONIC = "Harmonic Drive engineering data 1021387 12/2018, p. 30"


def _has_gear(d: Judged) -> bool:
    return d.candidate.gear is not None


def _collision(d: Judged) -> float | None:
    return d.conditions.collision_effort.get(d.demand.name)


def _no_collision(d: Judged) -> str:
    unknown = d.gear.momentary_peak_torque is None
    return "momentary peak" if unknown else "conditions.collision_effort"


def _collisions(d: Judged) -> float | None:
    return None if d.conditions.collisions is None else d.conditions.collisions.count


def _by_rule(d: Judged) -> bool:
    """Whether the number of momentary peaks follows from the maker's rule, not from a figure."""
    return d.gear.momentary_peaks is None and d.gear.kind == "strain wave"


def _momentary_peaks(d: Judged) -> float | None:
    wanted = d.conditions.collisions
    if wanted is None or not _by_rule(d):
        return d.gear.momentary_peaks
    return momentary_peaks(d.candidate.ratio * d.demand.speed, wanted.duration)


def _gear_life(d: Judged) -> float | None:
    if d.candidate.gear is None:  # a gearmotor: its maker prints no life
        return None
    life, speed, torque = d.gear.nominal_life, d.gear.rated_speed, d.gear.rated_torque
    if life is None or speed is None or torque is None:
        return None
    mean_speed = d.candidate.ratio * d.demand.mean_speed
    return gear_life(life, speed, torque, mean_speed, d.demand.mean_cubic)[0]


_STATED = "motor file, or the URDF: used by retiming only"


def _kind(d: Judged) -> str:
    return "" if d.candidate.gear is None else d.candidate.gear.kind


def _is_screw(d: Judged) -> bool:
    return "screw" in _kind(d)


def _of_screw(rule: Callable[[Screw], float | None]) -> Callable[[Judged], float | None]:
    """What a rule gives for the gear's screw; None where its length is not known."""
    return lambda d: None if d.gear.screw is None else rule(d.gear.screw)


def _buckling(d: Judged) -> float | None:
    """By Euler; of a complete unit, which has a stroke, the maker's force."""
    if d.gear.screw is not None:
        return buckling_load(d.gear.screw)
    return None if d.gear.stroke is None else d.gear.rated_torque


def _buckling_note(d: Judged) -> str:
    if d.gear.screw is not None or _buckling(d) is None:
        return ""
    return f"the maker's rated force of a unit of {d.gear.stroke:g} m stroke"


def _tightest(d: Judged) -> tuple[float, float | None]:
    """The effort and the maker's limit at its speed, at the sample where least of it is left."""
    assert d.gear.effort_curve is not None  # the row is for gears that have one
    at, limits = np.transpose(d.gear.effort_curve)
    speed, effort = d.candidate.ratio * np.abs(d.case.cycle.velocity), np.abs(d.case.cycle.ends[0])
    if speed.max() > at[-1]:
        return float(effort[np.argmax(speed)]), None
    allowed = np.interp(speed, at, limits)
    k = int(np.argmax(effort / allowed))
    return float(effort[k]), float(allowed[k])


def _of_nut(needs: Callable[[Nut, Judged], float]) -> Callable[[Judged], float | None]:
    return lambda d: None if d.gear.nut is None else needs(d.gear.nut, d)


def _given_of_nut(figure: str) -> Callable[[Judged], float | None]:
    return lambda d: None if d.gear.nut is None else getattr(d.gear.nut, figure)


_THK = "THK, selection of ball screws: "
_PV = "Thomson, PV of lead screws with polymer nuts; at every instant of the cycle"
_LENGTH = "screw: root diameter, length and supports"
#: Name, need, what is given and a remark, unit, formula, source, what may be missing, of which
#: kinds, what it settles.
_SCREWS: tuple[tuple[Any, ...], ...] = (
    (
        "screw critical speed",
        "input speed",
        (_of_screw(critical_speed), ""),
        "rad/s",
        "ratio max |v| <= 0.8 lambda^2/l^2 sqrt(E I/(rho A))",
        _THK + "permissible rotational speed",
        _LENGTH,
        _is_screw,
        ("gear's speed",),
    ),
    (
        "screw DN value",
        "input speed",
        (_of_screw(dn_speed), ""),
        "rad/s",
        "ratio max |v| <= DN/ball circle diameter",
        _THK + "DN value",
        "screw: ball_circle and max_dn",
        lambda d: _kind(d) == "ball screw",
        (),
    ),
    (
        "screw buckling",
        "effort",
        (_buckling, _buckling_note),
        "effort",
        "max |F| <= n pi^2 E I/l^2 x 0.5",
        _THK + "buckling load",
        _LENGTH,
        _is_screw,
        ("screw's buckling",),
    ),
    (
        "nut pressure",
        _of_nut(lambda nut, d: d.demand.peak / nut.contact_area),
        (_given_of_nut("max_pressure"), ""),
        "Pa",
        "max |F|/A <= permissible pressure of the nut",
        "maker's figures",
        "nut: contact_area and max_pressure",
        lambda d: _kind(d) == "lead screw",
        ("gear's load",),
    ),
    (
        "nut PV value",
        _of_nut(lambda nut, d: nut_pv(nut, d.candidate.ratio, d.case.cycle)),
        (_given_of_nut("max_pv"), ""),
        "Pa m/s",
        "max |F|/A |v| sqrt(1 + (ratio d/2)^2) <= permissible PV of the nut",
        _PV,
        "nut: diameter, contact_area and max_pv",
        lambda d: _kind(d) == "lead screw",
        (),
    ),
)

#: In the order of reports.
GEAR_LIMITS = [
    Limit(
        "gear average torque",
        need=lambda d: d.demand.mean_cubic,
        gives=("gear.average_torque",),
        unit="effort",
        formula="T_av = cbrt(int |v T^3| dt/int |v| dt) <= limit for average torque",
        source=_HARMONIC,
        missing="limit for average torque",
        applies=_has_gear,
    ),
    Limit(
        "gear repeated peak torque",
        need="effort",
        gives=("gear.repeated_peak_torque", "gear.average_torque", "gear.rated_torque"),
        unit="effort",
        formula="max |T| <= limit for repeated peak torque",
        source=_HARMONIC,
        missing="limit for repeated peak torque",
        applies=_has_gear,
        settles=("gear's load",),
    ),
    Limit(
        "gear effort at its speed",
        need=lambda d: _tightest(d)[0],
        gives=lambda d: _tightest(d)[1],
        unit="effort",
        formula="|T| <= the maker's limit at the input speed of the same instant",
        source="maker's figures",
        missing="the maker's curve ends below the input speed",
        applies=lambda d: _has_gear(d) and d.gear.effort_curve is not None,
    ),
    Limit(
        "effort",
        need="effort",
        gives=nothing,
        unit="effort",
        formula="max |effort| <= effort",
        source=_STATED,
        applies=never,
        settles=("gear's load",),
        key="effort",
    ),
    Limit(
        "gear momentary peak torque",
        need=_collision,
        gives=("gear.momentary_peak_torque",),
        unit="effort",
        formula="collision or emergency stop <= limit for momentary peak torque",
        source=_HARMONIC,
        missing=_no_collision,
        applies=_has_gear,
    ),
    Limit(
        "gear momentary peaks",
        need=_collisions,
        gives=_momentary_peaks,
        unit="",
        formula=lambda d: (
            "collisions <= N = 10^4/(2 (n/60) t), n the greatest input speed in rpm"
            if _by_rule(d)
            else "collisions <= N"
        ),
        source=lambda d: (
            "Harmonic Drive CSF/CSG catalogue, momentary peak torque"
            if _by_rule(d)
            else "maker's number"
        ),
        missing="momentary_peaks",
        applies=lambda d: _has_gear(d) and d.conditions.collisions is not None,
        endless="the joint never moves",
    ),
    Limit(
        "gear maximum input speed",
        need="input speed",
        gives=("gear.max_input_speed", "gear.average_input_speed"),
        unit="rad/s",
        formula="ratio max |v| <= maximum input speed",
        source=_HARMONIC,
        missing="maximum input speed",
        applies=_has_gear,
        settles=("gear's speed",),
        key="input_speed",
    ),
    Limit(
        "joint speed",
        need="speed",
        gives=nothing,
        unit="rad/s or m/s",
        formula="max |v| <= velocity",
        source=_STATED,
        applies=never,
        settles=("motor's speed", "gear's speed"),
        key="velocity",
    ),
    Limit(
        "acceleration",
        need="acceleration",
        gives=nothing,
        unit="rad/s^2 or m/s^2",
        formula="max |a| <= acceleration",
        source=_STATED,
        applies=never,
        key="acceleration",
    ),
    Limit(
        "gear average input speed",
        need=lambda d: d.candidate.ratio * d.demand.mean_speed,
        gives=("gear.average_input_speed",),
        unit="rad/s",
        formula="ratio 1/T int |v| dt <= limit for average input speed",
        source=_HARMONIC,
        missing="limit for average input speed",
        applies=_has_gear,
    ),
    Limit(
        "gear life L10",
        need=lambda d: d.conditions.life,
        gives=_gear_life,
        unit="h",
        formula="L10 = L50/5, L50 = L_n (n_N/n_in,av)(T_N/T_av)^3",
        source="Harmonic Drive engineering data 1021387 12/2018, p. 32, equations 32.2, 32.3",
        missing="nominal life, rated speed or rated torque",
        endless="the joint never moves",
        settles=("gear's life",),
        optional=True,
    ),
    *(
        Limit(name, need, gives, unit, formula, source, missing, note, applies=applies, settles=of)
        for name, need, (gives, note), unit, formula, source, missing, applies, of in _SCREWS
    ),
    Limit(
        "stroke",
        need=lambda d: d.demand.travel,
        gives=("gear.stroke",),
        unit="m",
        formula="max q - min q <= stroke",
        source="maker's figures",
        missing="stroke",
        applies=lambda d: _has_gear(d) and d.gear.output == "linear",
    ),
]
