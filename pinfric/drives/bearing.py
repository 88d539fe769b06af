"""Loads on the bearing that carries a joint, or on a screw's nut: mean, equivalent load, life.

The bearing takes the joint's wrench but its part along the joint's freedom: radial force F_r, axial
force F_a and tilting moment M about the joint's origin, which is taken to lie on the output flange,
`offset` R before the rolling elements: M_b = M + R F_r, the worst way round. In an open chain
friction about the axis changes none of them. A screw's nut takes the joint's effort as its axial
force, the worst of its interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, final

import numpy as np
from pydantic import model_validator

from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.reactions import state_wrenches
from pinfric.model.bearings import axes_along
from pinfric.model.described import described, quantity
from pinfric.model.entry import Entry, NonNegative, Positive, key, optional

BALL, ROLLER = 3.0, 10.0 / 3.0


class Factors(Entry):
    """P = X P_r + Y F_a, (X, Y) by F_a/P_r up to `limit` and above; P_0 = X_0 P_r + Y_0 F_a."""

    limit: NonNegative = key("of F_a/P_r", 1.5, "1")
    below: tuple[NonNegative, NonNegative] = key("X and Y up to it", [1.0, 0.45], "1")
    above: tuple[NonNegative, NonNegative] = key("X and Y above it", [0.67, 0.67], "1")
    static: tuple[NonNegative, NonNegative] = key("X_0 and Y_0", [1.0, 0.44], "1")


class BearingKind(NamedTuple):
    """Formulas for a kind of bearing; `factors` None: the maker's, in the entry."""

    exponent: float
    factors: Factors | None
    source: str


_ISO = "ISO 281 (life), ISO 76 (static)"
KINDS = {
    "crossed roller": BearingKind(
        ROLLER,
        Factors(limit=1.5, below=(1.0, 0.45), above=(0.67, 0.67), static=(1.0, 0.44)),
        "Harmonic Drive, output bearing: FHA-C manual; IKO crossed roller bearings: the same",
    ),
    "ball": BearingKind(BALL, None, _ISO),
    "roller": BearingKind(ROLLER, None, _ISO),
    "ball screw": BearingKind(
        BALL,
        Factors(limit=0.0, below=(0.0, 1.0), above=(0.0, 1.0), static=(0.0, 1.0)),
        "ISO 3408-5 (ball screws: as ISO 281)",
    ),
    "linear guide": BearingKind(
        BALL, None, "THK LM Guide, static safety factor; PBC Linear, load calculation factors"
    ),
}


#: THK LM Guide, guideline for the static safety factor: without vibrations and impacts; 5 with.
_GUIDE_SAFETY = 2.0


class BearingRatings(Entry):
    """Load ratings of a bearing, or of a screw's nut."""

    kind: Literal["crossed roller", "ball", "roller", "ball screw", "linear guide"] = key(
        "bearing type, which sets the formulas", "crossed roller"
    )
    dynamic_rating: Positive | None = optional("C, dynamic load rating", 21800.0, "N")
    static_rating: Positive | None = optional("C_0", 35800.0, "N")
    pitch_diameter: Positive | None = optional(
        "of a single bearing that carries the tilting moment", 0.077, "m"
    )
    spacing: Positive | None = optional(
        "between the two bearings of a pair that carries the moment; ratings of one bearing",
        0.06,
        "m",
    )
    offset: NonNegative = key(
        "from the output flange to the rolling elements", 0.013, "m", default=0.0
    )
    max_moment: Positive | None = optional("permissible tilting moment", 187.0, "N m")
    max_radial: Positive | None = optional("permissible radial force", 3200.0, "N")
    max_axial: Positive | None = optional("permissible axial force", 4800.0, "N")
    static_moment: Positive | None = optional(
        "of a linear guide, M_0 about axes across the rail", 630.0, "N m"
    )
    static_roll: Positive | None = optional("of a linear guide, M_a0 about the rail", 820.0, "N m")
    static_safety: Positive = key(
        "required C_0/P_0; left out: 1.5, of a linear guide 2", 1.5, "1", default=1.5
    )
    factors: Factors | None = optional(
        "of the equivalent load, if the maker prints other values",
        {"limit": 1.5, "below": [1.0, 0.45], "above": [0.67, 0.67], "static": [1.0, 0.44]},
    )
    source: str = key(
        "source of the ratings, if not the entry's", "data sheet of the bearing", default=""
    )

    @model_validator(mode="after")
    def _can_be_reckoned(self) -> BearingRatings:
        if self.pitch_diameter is not None and self.spacing is not None:
            raise ValueError("`pitch_diameter` is for one bearing, `spacing` for a pair: give one")
        rated = self.dynamic_rating is not None or self.static_rating is not None
        if rated and self.rule is None and not self.guide:
            raise ValueError(
                f"a {self.kind} with ratings needs `factors` (limit, below, above, "
                "static): its maker prints them"
            )
        return self

    @property
    def rule(self) -> Factors | None:
        """The factors of the equivalent load: the entry's, else the kind's."""
        return self.factors or KINDS[self.kind].factors

    @property
    def screw(self) -> bool:
        """Whether it is a screw's nut, which turns `ratio` times as fast as the joint slides."""
        return self.kind == "ball screw"

    @property
    def least_safety(self) -> float:
        """The required C_0/P_0: the entry's, else 2 of a guide."""
        stated = "static_safety" in self.model_fields_set or not self.guide
        return self.static_safety if stated else _GUIDE_SAFETY

    @property
    def guide(self) -> bool:
        """Whether it is the guide of a sliding joint."""
        return self.kind == "linear guide"

    def radial_load(self, radial: float, moment: float) -> float | None:
        """Return P_r = F_r + 2 M_b/d_p, or half of F_r + 2 M_b/spacing for a pair, N."""
        span = self.pitch_diameter or self.spacing
        if self.screw:
            return 0.0
        if span is None:
            return None
        return (0.5 if self.spacing else 1.0) * (radial + 2 * moment / span)


@final
@described
class BearingLoad:
    """Loads of a bearing over a cycle, magnitudes.

    Attributes:
        means: exponent p -> (radial, axial, moment) as of `bearing_load`, what wears.
        speed: mean |v|, rad/s; m/s of a screw.
    """

    radial: float = quantity("largest radial force", "N", "on its bearing,\nradial")
    axial: float = quantity("largest force", "N", "axial")
    moment: float = quantity("largest tilting moment, about the joint's origin", "N m", "moment")
    means: Mapping[float, tuple[float, float, float]]
    speed: float


@final
@described
class GuideLoad:
    """Largest loads of a sliding joint's guide over a cycle, about the joint's origin."""

    across: float = quantity("largest force across the travel", "N", "on its guide,\nacross")
    pitch: float = quantity("largest moment about axes across the travel", "N m", "pitch, yaw")
    roll: float = quantity("largest moment about the travel", "N m", "roll")


def guide_safety(ratings: BearingRatings, load: GuideLoad) -> Any:
    """Return the static safety of a guide, f_s; NaN where a rating of a load is missing.

    1/f_s = sqrt(2) F/C_0 + M/M_0 + M_a/M_a0 of a guide that bears alike upwards, downwards and
    sideways; sqrt(2): across the travel it may lie any way round. Four carriages of C_0 each, l
    apart on rails w apart: 4 C_0, M_0 = 2 C_0 l, M_a0 = 2 C_0 w.

    Source: THK LM Guide, static safety factor; PBC Linear, load calculation factors, p. 52.
    """
    parts = (
        (2**0.5 * load.across, ratings.static_rating),
        (load.pitch, ratings.static_moment),
        (load.roll, ratings.static_roll),
    )
    loads = np.array([x for x, _ in parts])
    there = loads > 1e-9 * loads.max(axis=0)  # the rest is rounding
    rated = np.array([np.nan if rating is None else rating for _, rating in parts])
    with np.errstate(divide="ignore"):
        return 1 / np.where(there.T, loads.T / rated, 0.0).sum(axis=-1)


def bearing_load(
    t: np.ndarray, speed: np.ndarray, radial: np.ndarray, axial: np.ndarray, moment: np.ndarray
) -> BearingLoad:
    """Return peaks and means of a bearing's loads over a cycle.

    x_av = (int |v| |x|^p dt/int |v| dt)^(1/p), p = 3 for balls, 10/3 for rollers.

    Args:
        t: (T,) s. speed: (T,) of the joint. radial, axial, moment: (T,) N, N, N m.

    Source: Harmonic Drive, output bearing: average loads; ISO 281.
    """
    weight, span = np.abs(speed), float(t[-1] - t[0])
    turned = float(np.trapezoid(weight, t))

    def mean(x: np.ndarray, p: float) -> float:
        top = float(np.abs(x).max())
        if not (top > 0 and turned > 0):
            return 0.0
        weighted = np.trapezoid(weight * (np.abs(x) / top) ** p, t)  # at most 1: no overflow
        return top * float(weighted / turned) ** (1 / p)

    peaks = [float(np.abs(x).max()) for x in (radial, axial, moment)]
    means = {p: (mean(radial, p), mean(axial, p), mean(moment, p)) for p in (BALL, ROLLER)}
    return BearingLoad(peaks[0], peaks[1], peaks[2], means, turned / span)


def joint_loads(
    result: InverseResult, row: int, wrench: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return radial and axial force (N) and tilting moment (N m) of a joint's bearing, (T,) each.

    None in a robot with loops where the joint's wrench was not computed.

    Args:
        row: of a turning joint, in `joint_names`.
        wrench: (T, 6) that it transmits; None: as in the result.
    """
    along = _along(result, row, wrench)
    if along is None:
        return None
    force, moment = along
    return np.hypot(*force.T[:2]), np.abs(force[:, 2]), np.hypot(*moment.T[:2])


def guide_load(
    result: InverseResult, row: int, wrench: np.ndarray | None = None
) -> GuideLoad | None:
    """Return the largest loads of a sliding joint's guide, or None; arguments as `joint_loads`."""
    along = _along(result, row, wrench)
    if along is None:
        return None
    force, moment = along
    loads = np.hypot(*force.T[:2]), np.hypot(*moment.T[:2]), np.abs(moment[:, 2])
    return GuideLoad(*(float(x.max()) for x in loads))


def _along(
    result: InverseResult, row: int, wrench: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Force and moment (T, 3) of a joint, z along its axis; None: not known."""
    scene = result.scene
    column = next((s for s, site in enumerate(scene.sites) if site.joint == row), None)
    if wrench is not None:
        pass
    elif result.wrench is not None and column is not None:
        wrench = result.wrench[:, column]
    elif scene.loops:
        return None
    else:
        wrench = state_wrenches(scene, result.states, result.external)[:, row]
    axis = scene.twin().axis[row]
    turn = axes_along(axis[3:] if axis[3:].any() else axis[:3])
    return wrench[:, :3] @ turn.T, wrench[:, 3:] @ turn.T


def equivalent_load(ratings: BearingRatings, load: BearingLoad) -> Any:
    """Return the dynamic equivalent load P of the mean loads, N; None where a figure is missing.

    P = X P_r + Y F_a with P_r of `BearingRatings.radial_load`, (X, Y) by F_a/P_r (`Factors`).

    Source: Harmonic Drive, output bearing; IKO; ISO 281.
    """
    radial, axial, moment = load.means[KINDS[ratings.kind].exponent]
    across = ratings.radial_load(radial, moment + ratings.offset * radial)
    if across is None or ratings.rule is None:
        return None
    rule = ratings.rule
    x, y = (
        np.where(axial <= rule.limit * across, *ends)
        for ends in zip(rule.below, rule.above, strict=True)
    )
    return x * across + y * axial


def static_load(ratings: BearingRatings, load: BearingLoad) -> float | None:
    """Return the static equivalent load P_0 = X_0 P_r + Y_0 F_a of the largest loads, N, or None.

    Source: Harmonic Drive, output bearing: P_0 = F_r + 2 M/d_p + 0.44 F_a; ISO 76.
    """
    across = ratings.radial_load(load.radial, load.moment + ratings.offset * load.radial)
    if across is None or ratings.rule is None:
        return None
    x, y = ratings.rule.static
    return x * across + y * load.axial


def bearing_life(dynamic_rating: float, load: Any, speed: Any, exponent: float) -> Any:
    """Return L10 = (C/P)^p x 10^6 revolutions, in hours; infinite where nothing turns or loads.

    Swaying counts by its way: (90/phi) of a round trip of half angle phi is the same.

    Args:
        dynamic_rating: C, N. load: P, with its factor for shocks, N.
        speed: mean |omega|, rad/s; pauses count in it. exponent: 3 for balls, 10/3 for rollers.

    Source: ISO 281.
    """
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        turns = np.divide(dynamic_rating, load) ** exponent * 1e6
        lasts = (np.asarray(speed) > 0) & (np.asarray(load) > 0)
        return np.where(lasts, turns * 2 * np.pi / np.asarray(speed) / 3600, np.inf)[()]
