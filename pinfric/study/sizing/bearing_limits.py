"""Limits of a joint's bearing, or of a screw's nut, as rows of the table."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinfric.study.sizing.bearing import (
    BALL,
    KINDS,
    bearing_life,
    equivalent_load,
    static_load,
)
from pinfric.study.sizing.limit import Judged, Limit, Text, nothing


def _turning(d: Judged) -> bool:
    """Whether a bearing carries the joint."""
    return not d.candidate.linear


def _nut(d: Judged) -> bool:
    """Whether a screw's nut carries the joint; belts and linear motors have none."""
    candidate = d.candidate
    return candidate.linear and candidate.gear is not None and "screw" in candidate.gear.kind


def _rule(d: Judged) -> str:
    """Where the rule is from, and the ratings, where they are from elsewhere."""
    rule = KINDS[d.bearing.kind].source
    return f"{rule}; ratings: {d.bearing.source}" if d.bearing.source else rule


def _of_bearing(words: str) -> Text:
    return lambda d: words if d.demand.bearing else "the joint's wrench"


def _tilting(d: Judged) -> float | None:
    load = d.demand.bearing
    return load and load.moment + d.bearing.offset * load.radial


def _static_safety(d: Judged) -> float | None:
    carried = d.demand.bearing and static_load(d.bearing, d.demand.bearing)
    if carried is None or d.bearing.static_rating is None:
        return None
    return d.bearing.static_rating / carried if carried > 0 else np.inf


def _safety_formula(d: Judged) -> str:
    if d.bearing.rule is None or d.bearing.screw:
        return "f_s = C_0/P_0"
    x, y = d.bearing.rule.static
    return f"f_s = C_0/P_0, P_0 = {x:g} P_r + {y:g} F_a"


def _equivalent(d: Judged) -> float | None:
    return d.demand.bearing and equivalent_load(d.bearing, d.demand.bearing)


def _bearing_life(d: Judged) -> float | None:
    load, equivalent, rating = d.demand.bearing, _equivalent(d), d.bearing.dynamic_rating
    if load is None or equivalent is None or rating is None:
        return None
    speed = load.speed * (d.candidate.ratio if d.bearing.screw else 1.0)
    exponent = KINDS[d.bearing.kind].exponent
    return bearing_life(rating, d.conditions.shock * equivalent, speed, exponent)


def _life_formula(d: Judged) -> str:
    exponent = "3" if KINDS[d.bearing.kind].exponent == BALL else "10/3"
    return f"L10 = 10^6 revolutions (C/({d.conditions.shock:g} P))^({exponent})"


def _life_note(d: Judged) -> str:
    equivalent = _equivalent(d)
    return "" if equivalent is None else f"P = {equivalent:.4g} N"


def _rated(carried: Callable[[Judged], bool]) -> Callable[[Judged], bool]:
    return lambda d: carried(d) and d.candidate.bearing is not None


def _unrated(what: str, carried: Callable[[Judged], bool]) -> Limit:
    """The row that says that nothing is known of what carries a joint."""
    return Limit(
        f"{what} loads",
        need=nothing,
        gives=nothing,
        unit="",
        formula="loads and life by its ratings",
        source=KINDS["ball screw" if what == "screw" else "crossed roller"].source,
        missing=f"ratings of the {what}",
        applies=lambda d: carried(d) and d.candidate.bearing is None,
    )


def _axial(what: str, carried: Callable[[Judged], bool]) -> list[Limit]:
    """The rows that a bearing and a screw's nut share."""
    settles = ("gear's load",) if what == "screw" else ()  # of a screw its ratings do
    return [
        Limit(
            f"{what} axial force",
            need=lambda d: d.demand.bearing and d.demand.bearing.axial,
            gives=("bearing.max_axial",),
            unit="N",
            formula="max |F_a| <= permissible axial force",
            source=_rule,
            missing=_of_bearing("permissible axial force"),
            applies=_rated(carried),
            settles=settles,
        ),
        Limit(
            f"{what} static safety",
            need=lambda d: d.bearing.static_safety,
            gives=_static_safety,
            unit="",
            formula=_safety_formula,
            source=_rule,
            missing="static load rating C_0 or pitch diameter",
            applies=_rated(carried),
            endless="no load",
            settles=settles,
        ),
        Limit(
            f"{what} life L10",
            need=lambda d: d.conditions.life,
            gives=_bearing_life,
            unit="h",
            formula=_life_formula,
            source=_rule,
            missing="dynamic load rating C or pitch diameter",
            note=_life_note,
            applies=_rated(carried),
            endless="it never turns under load",
        ),
    ]


#: In the order of reports.
BEARING_LIMITS = [
    _unrated("bearing", _turning),
    Limit(
        "bearing tilting moment",
        need=_tilting,
        gives=("bearing.max_moment",),
        unit="N m",
        formula="max M + R max F_r <= permissible tilting moment",
        source=_rule,
        missing=_of_bearing("permissible tilting moment"),
        applies=_rated(_turning),
    ),
    Limit(
        "bearing radial force",
        need=lambda d: d.demand.bearing and d.demand.bearing.radial,
        gives=("bearing.max_radial",),
        unit="N",
        formula="max |F_r| <= permissible radial force",
        source=_rule,
        missing=_of_bearing("permissible radial force"),
        applies=_rated(_turning),
    ),
    *_axial("bearing", _turning),
    _unrated("screw", _nut),
    *_axial("screw", _nut),
]
