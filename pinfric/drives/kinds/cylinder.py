"""Hydraulic and pneumatic cylinders: entry, areas, rows, needs.

The rod goes out where the effort F is positive, and in where it is negative:

    p_push = F/(s A_1),   p_pull = -F/(s A_2),   A_1 = pi D^2/4,   A_2 = pi (D^2 - d^2)/4,

with bore D, rod d, and the share s of pressure times area that a load may take. At rest valves lock
both chambers, of which one bears the whole load: |F|/A. A rod that pushes buckles at

    F_k = pi^2 E I/l^2,   I = pi d^4/64,   l = buckling_length x distance of the pins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import pi
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from pinfric.drives.demand import largest
from pinfric.drives.kinds.kind import Kind
from pinfric.drives.limit import Candidates, Figure, Limit, number
from pinfric.drives.sourced import Sourced
from pinfric.model.entry import NonNegative, Number, Positive, key, optional

#: Medium -> part of pressure times area that a load may take, where an entry gives none, and why.
LOAD_SHARE = {
    "hydraulic": (0.9, "seals and return line, by rule"),
    "pneumatic": (0.5, "SMC, air cylinders, model selection: load factor of loads that move"),
}
#: Medium -> density of what its cylinders are made of, kg/m^3, of which a mass is by rule.
_DENSITY = {"hydraulic": 7850.0, "pneumatic": 2700.0}
#: Elasticity of steel, Pa (Haenchen, buckling of hydraulic cylinders).
_STEEL = 2.1e11
_BAR, _PER_MINUTE = 1e5, 6e4


class Cylinder(Sourced, Kind):
    """A double-acting cylinder with one rod, in each of its strokes a drive of its own.

    Its mass, where it is not printed, is that of a solid block: heads 1.6 bores wide and 2 bores +
    0.1 m long, and 1.25 bores thick along the stroke; steel, of pneumatic ones aluminium. That is
    more than fits into the envelope of ISO 6020-2.
    """

    NAME: ClassVar[str] = "cylinder"
    NEEDS: ClassVar[dict[str, str]] = {
        "rod diameter": "rod",
        "rated pressure": "rated_pressure",
        "largest speed": "max_speed",
    }
    PRODUCT: ClassVar[str] = "cylinder"
    ON_BUS: ClassVar[bool] = False
    REPLACED: ClassVar[frozenset[str]] = frozenset(
        (
            *("continuous torque", "short-term torque", "overloaded standstill", "peak torque"),
            *("peak torque of braking", "bus voltage", "motor voltage", "speed-torque line"),
            *("motor speed", "winding temperature", "amplifier currents", "inertia ratio"),
            *("gear momentary peak torque", "stroke", "back-driving"),
        )
    )
    SHOWN: ClassVar[tuple[str, ...]] = (
        *("cylinder push pressure", "cylinder pull pressure", "cylinder holding pressure"),
        "cylinder flow",
    )
    UNFED: ClassVar[str] = "a cylinder takes a valve"
    NOT_RETIMED: ClassVar[str] = (
        "a cylinder, whose pressures `retime` does not bound; give the peak_torque (N) and the "
        "max_speed (m/s) that it has at all places of the motion"
    )

    medium: Literal["hydraulic", "pneumatic"] = key("what moves it", "hydraulic")
    bore: Positive = key("diameter of its piston", 0.08, "m")
    rod: NonNegative | None = optional("diameter of its rod; 0: it has no rod side", 0.045, "m")
    strokes: tuple[Positive, ...] = key("that it comes in", [0.5, 0.63, 0.8], "m", min_length=1)
    rated_pressure: Positive | None = optional("highest, for ever", 1.6e7, "Pa")
    max_speed: Positive | None = optional("of its piston", 0.5, "m/s")
    load_share: Number | None = optional(
        "part of pressure times area that a load may take: friction of its seals, pressure on the "
        "other side; left out: 0.9 of hydraulic ones, 0.5 of pneumatic ones",
        0.9,
        "1",
        gt=0,
        le=1,
    )
    dead_length: Positive | None = optional(
        "distance of its pins with its rod in, less the stroke; left out: 3 bores + 0.15 m",
        0.39,
        "m",
    )
    mass: Positive | None = optional("without stroke", 16.0, "kg")
    mass_per_stroke: Positive | None = optional("of each metre of stroke", 27.0, "kg/m")

    @model_validator(mode="after")
    def _rod_is_inside(self) -> Cylinder:
        if self.rod is not None and self.rod >= self.bore:
            raise ValueError(f"rod {self.rod:g} m is not thinner than bore {self.bore:g} m")
        if self.rated_pressure is not None and self.rated_pressure < _BAR:
            raise ValueError(
                f"rated_pressure {self.rated_pressure:g} Pa is below that of the air: in bar? "
                "1 bar is 1e5 Pa"
            )
        if (self.mass is None) != (self.mass_per_stroke is None):
            raise ValueError("mass, mass_per_stroke: give both, or none of them")
        return self

    @property
    def serves(self) -> str:
        """Joints of its medium."""
        return self.medium

    @property
    def stroke(self) -> float:
        """Of a drive: its only one, m."""
        return self.strokes[0]

    @property
    def areas(self) -> tuple[float, float]:
        """Of its piston, and of the ring around its rod, m^2; 0 without a rod, NaN: not known."""
        ring = 0.0 if self.rod == 0.0 else self.bore**2 - number(self.rod) ** 2
        return pi / 4 * self.bore**2, pi / 4 * ring

    @property
    def share_taken(self) -> float:
        """Part of pressure times area that a load may take."""
        return self.load_share or LOAD_SHARE[self.medium][0]

    @property
    def dead_length_taken(self) -> float:
        """Distance of its pins with its rod in, less the stroke, m."""
        return self.dead_length or 3 * self.bore + 0.15

    @property
    def mass_taken(self) -> float:
        """Of it with its stroke, kg; see the class."""
        if self.mass is not None and self.mass_per_stroke is not None:
            return self.mass + self.mass_per_stroke * self.stroke
        heads = (1.6 * self.bore) ** 2 * (2 * self.bore + 0.1)
        return _DENSITY[self.medium] * (heads + pi / 4 * (1.25 * self.bore) ** 2 * self.stroke)

    @property
    def torques(self) -> tuple[float | None, str]:
        """Its force at the rated pressure, N, and why."""
        pressure, area = self.rated_pressure, self.areas[0]
        force = None if pressure is None else self.share_taken * pressure * area
        return force, "force at the rated pressure; see its pressures"

    @property
    def unbraked(self) -> tuple[bool, str]:
        """Oil that valves lock in holds the joint; air yields and leaks."""
        if self.medium == "hydraulic":
            return True, "a valve at its port locks the oil in (pilot-operated check valve)"
        return False, "locked air yields and leaks: the joint needs a rod lock or a counterweight"

    def drives(self, name: str) -> Iterator[tuple[str, Cylinder, dict[str, Any]]]:
        """Yield its drives: name, itself with one stroke, and what a gearmotor has of it."""
        taken = dict(self.stand_ins)
        if self.load_share is None:
            share, why = LOAD_SHARE[self.medium]
            taken["load share"] = f"{share:g}: {why}"
        if self.mass is None:
            taken["mass"] = "a solid block of its envelope, by rule: heavier than it is"
        own = {x: getattr(self, x) for x in (*Sourced.model_fields, "max_speed")}
        for stroke in self.strokes:
            one = self.model_copy(update={"strokes": (stroke,)})
            more = {"stand_ins": taken, "mass": one.mass_taken}
            yield f"{name}, stroke {stroke:g} m", one, own | more


def _of(d: Candidates) -> Cylinder:
    own = d.ratings.special
    assert isinstance(own, Cylinder)  # its rows are for cylinders
    return own


def _cylinders(d: Candidates) -> bool:
    return d.kind is Cylinder


def _hydraulic(d: Candidates) -> bool:
    return _cylinders(d) and _of(d).medium == "hydraulic"


def _forces(d: Candidates) -> tuple[float, float]:
    """The largest that pushes and that pulls, N."""
    cycle = d.case.cycle
    return max(cycle.effort_upper.max(), 0.0), max(-cycle.effort_lower.min(), 0.0)


def _held(d: Candidates) -> tuple[float, float]:
    """The same of what it holds without power, N; NaN: not known."""
    if d.case.rest is None:
        return np.nan, np.nan
    load = d.case.rest.load
    return max(load.max(), 0.0), max(-load.min(), 0.0)


def _pressure(force: float, area: float, share: float = 1.0) -> float:
    """In bar; NaN where the area is not known."""
    if not force:
        return 0.0
    return force / (share * area) / _BAR if area else np.inf


def _needed(side: int) -> Figure:
    return lambda d: _pressure(_forces(d)[side], _of(d).areas[side], _of(d).share_taken)


def _locked(d: Candidates) -> float:
    own = _of(d)
    return float(np.max([_pressure(f, a) for f, a in zip(_held(d), own.areas, strict=True)]))


def _rated(d: Candidates) -> float:
    return number(_of(d).rated_pressure) / _BAR


def _supply(d: Candidates) -> float:
    return getattr(d.conditions, _supplied(d)[0]) / _BAR


def _supplied(d: Candidates) -> tuple[str, ...]:
    return (f"{_of(d).medium}_pressure",)


def _given(d: Candidates) -> float:
    return min(_supply(d), _rated(d))


def _area(side: int) -> str:
    return ("pi/4 bore^2", "pi/4 (bore^2 - rod^2)")[side]


def _formula(side: int) -> Callable[[Candidates], str]:
    return lambda d: (
        f"max F/({_of(d).share_taken:g} x {_area(side)}) <= lower of supply and rated pressure"
    )


def _note(side: int) -> Callable[[Candidates], str]:
    def said(d: Candidates) -> str:
        words = f"{('pushes', 'pulls')[side]} {_forces(d)[side]:.4g} N"
        below = f"; a valve brings {_supply(d):.4g} bar down to its {_rated(d):.4g} bar"
        return words + below * (_supply(d) > _rated(d)) if _of(d).rod or side == 0 else _bare(d)

    return said


def _bare(d: Candidates) -> str:
    """Say of a cylinder without a rod side what it must do; else empty."""
    words = (f"{word} {f:.4g} N" for word, f in zip(("pushes", "pulls"), _forces(d), strict=True))
    return f"{', '.join(words)}, and it has no rod side (rod: 0)" if _of(d).rod == 0.0 else ""


def _speed(d: Candidates) -> float:
    return largest(d.case.cycle.velocity)


def _flow(d: Candidates) -> float:
    """The largest that it takes, L/min: out into the bore, in around the rod."""
    out, back = (max(x.max(), 0.0) for x in (d.case.cycle.velocity, -d.case.cycle.velocity))
    bore, ring = _of(d).areas
    return max(out * bore, back * (bore if np.isnan(ring) else ring)) * _PER_MINUTE


def _closed(d: Candidates) -> float:
    """Distance of its pins with its rod in, m."""
    own = _of(d)
    return own.stroke + own.dead_length_taken


def _length(d: Candidates) -> float:
    """Distance of its pins, m: the largest of the cycle, on a joint with its rod out."""
    return _way("longest")(d) if _pinned(d) else _closed(d) + _of(d).stroke


def _buckling(d: Candidates) -> float:
    length = d.conditions.buckling_length * _length(d)
    return pi**3 * _STEEL * number(_of(d).rod) ** 4 / (64 * length**2)


def _way(figure: str) -> Figure:
    return lambda d: number(d.case.way and getattr(d.case.way, figure))


def _pinned(d: Candidates) -> bool:
    return _cylinders(d) and d.case.way is not None and d.case.way.between_pins


def _stroke_note(d: Candidates) -> str:
    span = _way("range")(d)
    if np.isnan(span):
        return ""
    said = f"{span:.4g} m between the joint's limits"
    return said + ": its stroke ends before them" * (span > _of(d).stroke)


_ISO = "pressure = force/area; ISO 6020-2 (bores, rods), ISO 15552"
# fmt: off
LIMITS = [
    Limit("cylinder push pressure", _needed(0), _given, "bar", _formula(0), _ISO,
          "rated pressure", _note(0), stage="entry", condition=_supplied, applies=_cylinders),
    Limit("cylinder pull pressure", _needed(1), _given, "bar", _formula(1), _ISO,
          "rod diameter", _note(1), stage="entry", condition=_supplied, applies=_cylinders),
    Limit("cylinder holding pressure", _locked, _rated, "bar",
          "max |F|/area at rest, in the chamber that bears it <= rated pressure", _ISO,
          "rod diameter, or the load at rest",
          lambda d: f"holds {largest(np.array(_held(d))):.5g} N, its chambers locked",
          stage="entry", applies=_cylinders),
    Limit("cylinder speed", _speed, lambda d: number(_of(d).max_speed), "m/s",
          "max |v| <= largest speed of its piston", "maker's figures", "largest speed",
          stage="entry", applies=_cylinders),
    Limit("cylinder flow", _flow, lambda d: number(d.conditions.hydraulic_flow) * _PER_MINUTE,
          "L/min", "max |v| x area <= conditions.hydraulic_flow", "flow = speed x area",
          "conditions.hydraulic_flow: of the valve or pump", condition=("hydraulic_flow",),
          stage="entry", applies=_hydraulic),
    Limit("cylinder stroke", _way("travel"),
          lambda d: d.gear.stroke if d.one is None else _of(d).stroke, "m",
          "longest - shortest distance of its ends in the motion <= stroke", "maker's figures",
          "the joint's travel", _stroke_note, stage="gear", applies=_cylinders),
    Limit("cylinder closed length", _closed, _way("shortest"), "m",
          "stroke + dead length <= shortest distance of its pins in the motion",
          lambda d: "maker's figures" if _of(d).dead_length else "by rule: 3 bores + 0.15 m",
          stage="entry", applies=_pinned),
    Limit("rod buckling", lambda d: _forces(d)[0], _buckling, "N",
          lambda d: f"{d.conditions.buckling_factor:g} max F <= pi^2 E I/l^2, "
          f"l = {d.conditions.buckling_length:g} x {_length(d):.4g} m",
          "Euler; Haenchen, buckling: safety 3 to 5", "rod diameter", _bare,
          stage="entry", reserve="buckling_factor", condition=("buckling_length",),
          applies=_cylinders),
]
# fmt: on
