"""Limits of a joint's bearing, or of a screw's nut, as rows of the table."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from pinfric.study.sizing.bearing import (
    BALL,
    KINDS,
    bearing_life,
    equivalent_load,
    guide_safety,
    static_load,
)
from pinfric.study.sizing.limit import Judged, Limit, Text, nothing


def _turning(d: Judged) -> bool:
    """Whether a bearing carries the joint."""
    return not d.candidate.linear


def _nut(d: Judged) -> bool:
    """Whether a screw's nut with ratings as a bearing's carries the joint: not one that slides."""
    gear = d.candidate.gear
    return d.candidate.linear and gear is not None and "screw" in gear.kind and gear.nut is None


def _rule(d: Judged) -> str:
    """Where the rule is from, and the ratings, where they are from elsewhere."""
    rule = KINDS[d.bearing.kind].source
    return f"{rule}; ratings: {d.bearing.source}" if d.bearing.source else rule


def _of_bearing(words: str) -> Text:
    return lambda d: words if d.demand.bearing else "the joint's wrench"


def _peak(part: str) -> Callable[[Judged], float | None]:
    """The largest of one of its loads."""
    return lambda d: d.demand.bearing and getattr(d.demand.bearing, part)


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


def _guided(d: Judged) -> bool:
    """Whether a guide carries the joint."""
    return d.candidate.linear and d.candidate.guide is not None


def _guide_safety(d: Judged) -> float | None:
    return d.demand.guide and guide_safety(d.guide, d.demand.guide)


def _bearing_only(carried: Callable[[Judged], bool]) -> Callable[[Judged], bool]:
    return lambda d: carried(d) and d.candidate.bearing is None


def _unrated(name: str, source: str, applies: Callable[[Judged], bool]) -> Limit:
    """The row that says that nothing is known of what carries a joint."""
    what, formula = name.partition(" ")[0], "loads and life by its ratings"
    missing = f"ratings of the {what}" + "; conditions.bearings" * (what == "guide")
    return Limit(name, nothing, nothing, "", formula, source, missing, applies=applies)


#: Row, need, what the maker gives, unit, formula, what may be missing, what is said of no load.
_ROWS: dict[str, tuple[Any, ...]] = {
    "tilting moment": (
        _tilting,
        ("bearing.max_moment",),
        "N m",
        "max M + R max F_r <= permissible tilting moment",
        _of_bearing("permissible tilting moment"),
        "",
    ),
    "radial force": (
        _peak("radial"),
        ("bearing.max_radial",),
        "N",
        "max |F_r| <= permissible radial force",
        _of_bearing("permissible radial force"),
        "",
    ),
    "axial force": (
        _peak("axial"),
        ("bearing.max_axial",),
        "N",
        "max |F_a| <= permissible axial force",
        _of_bearing("permissible axial force"),
        "",
    ),
    "static safety": (
        lambda d: d.bearing.static_safety,
        _static_safety,
        "",
        _safety_formula,
        "static load rating C_0 or pitch diameter",
        "no load",
    ),
    "life L10": (
        lambda d: d.conditions.life,
        _bearing_life,
        "h",
        _life_formula,
        "dynamic load rating C or pitch diameter",
        "it never turns under load",
    ),
}
_LIFE = "life L10"


def _settled(what: str, name: str) -> tuple[str, ...]:
    """What a row settles (`Limit.settles`): of a screw load and life are the gear's."""
    if name == _LIFE:
        return ("gear's life",) if what == "screw" else ("bearing's life",)
    return ("gear's load",) if what == "screw" and name in ("axial force", "static safety") else ()


def _rated(what: str, carried: Callable[[Judged], bool], names: Iterable[str]) -> list[Limit]:
    """The rows of what carries a joint whose ratings are known."""
    return [
        Limit(
            f"{what} {name}",
            need,
            gives,
            unit,
            formula,
            _rule,
            missing,
            _life_note if name == _LIFE else "",
            applies=lambda d: carried(d) and d.candidate.bearing is not None,
            endless=endless,
            settles=_settled(what, name),
            optional=name == _LIFE,
        )
        for name, (need, gives, unit, formula, missing, endless) in _ROWS.items()
        if name in names
    ]


#: In the order of reports.
BEARING_LIMITS = [
    _unrated("bearing loads", KINDS["crossed roller"].source, _bearing_only(_turning)),
    *_rated("bearing", _turning, _ROWS),
    _unrated("screw loads", KINDS["ball screw"].source, _bearing_only(_nut)),
    *_rated("screw", _nut, ("axial force", "static safety", "life L10")),
    _unrated(
        "guide loads",
        KINDS["linear guide"].source,
        lambda d: d.candidate.linear and not _guided(d),
    ),
    Limit(
        "guide static safety",
        need=lambda d: d.guide.least_safety,
        gives=_guide_safety,
        unit="",
        formula="f_s = 1/(sqrt(2) F/C_0 + M/M_0 + M_a/M_a0)",
        source=lambda d: f"{KINDS['linear guide'].source}; ratings: {d.guide.source}",
        missing="the joint's wrench, or static_rating, static_moment, static_roll of the guide",
        applies=_guided,
        endless="no load",
    ),
]
