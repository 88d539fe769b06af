"""Factors on single joints' efforts, beside free masses: a wrong unit, ratio or motor constant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinfric.identification.checks import OTHER_GRAVITY
from pinfric.identification.estimate import Estimate
from pinfric.identification.inertias import consistent_fit, mass_changes
from pinfric.identification.influence import influence
from pinfric.identification.normal import (
    BlockProducts,
    Fit,
    FrictionNormalEquations,
    Normal,
    Prior,
    above_zero,
)
from pinfric.model.arrays import FloatArray

#: A factor is beyond 1 by so many standard errors, and takes off this share of its joint's square.
#: Of six arms whose gears lose up to 20 %, by directions differently, one had a factor of 0.16 at a
#: joint without gravity, which took off 9 %; a true factor of 0.6 took off 128 %.
_ERRORS, _WORTH = 2.5, 0.1
#: Losses of gears that differ between driving and driven look like factors up to this from 1: 0.22
#: in true arms. Efforts behind the gears hold none (`OTHER_GRAVITY`).
_LOSSES = 0.3
#: A factor with a larger standard error is not known: a last joint carries next to nothing.
_KNOWN = 0.25
#: URDFs' masses are wrong by 10 to 40 %: a larger change has another cause.
MOVED = 0.5
#: Share of a residual's square by which some joint's rows must ask for it, and weight of the URDF's
#: masses that holds them, over the usual one.
_ASKED, _HELD = 0.01, 1e4
#: Gauss-Newton steps; the third changes a factor by some thousandths.
_ROUNDS = 3
#: Weight of a factor's prior beside its own column: only what no row determines stays at 1. Beside
#: rounding it is large: of one joint the factor's column is a multiple of the links'.
_FREE = 1e-10


@dataclass(frozen=True)
class EffortScale:
    """Factor by which a joint's effort differs from what the other joints' efforts ask for.

    Attributes:
        joint: its number. value, standard_error: of the factor.
        gain: squared residual of all joints that it takes off, over that of its own joint.
    """

    joint: int
    value: float
    standard_error: float
    gain: float

    @property
    def differs(self) -> bool:
        """Whether it is known, and clearly not 1, by more than masses' errors make of it."""
        away = abs(self.value - 1.0)
        return self.standard_error < _KNOWN and away > max(
            OTHER_GRAVITY, _ERRORS * self.standard_error
        )

    def is_beyond(self, most: float) -> bool:
        """Return whether it is known, explains something, and differs from 1 by more."""
        away = abs(self.value - 1.0)
        return self.differs and self.gain > _WORTH and away > most + _ERRORS * self.standard_error


def doubted(scales: Sequence[EffortScale], motor: bool) -> list[EffortScale]:
    """Return the factors that no gear's losses explain, the best explanation first.

    `motor`: whether efforts are the motors', which hold the losses of gears.
    """
    most = _LOSSES if motor else OTHER_GRAVITY
    return _by_gain(scale for scale in scales if scale.is_beyond(most))


def noted(scales: Sequence[EffortScale], motor: bool) -> list[EffortScale]:
    """Return the factors that losses of gears may explain, or a wrong unit."""
    return _by_gain(
        scale for scale in scales if motor and scale.differs and not scale.is_beyond(_LOSSES)
    )


def _by_gain(scales: Iterable[EffortScale]) -> list[EffortScale]:
    return sorted(scales, key=lambda scale: -scale.gain)


def effort_scales(estimate: Estimate) -> list[EffortScale]:
    """Return one factor for each explained joint, each with all others at 1.

        y_j = s_j Y_j theta + friction,    y_i = Y_i theta + friction    for all i but j

    A link beyond several joints shows in all their efforts; so s_j shows although masses are free.
    Kept masses need none of it (`check_gravity`).
    """
    if estimate.question.inertias_stay:
        return []
    problem, fit = estimate.problem, estimate.fit
    slots, p = problem.slots(estimate.choice.laws), fit.theta.size
    squares, found = _squares(problem.grams, problem.weights, fit), []
    for j in estimate.known:
        scale, theta = 1.0, fit.theta
        for _ in range(_ROUNDS):  # s_j Y_j theta about the present s_j and theta
            grams = [
                _with_scale(own, scale, theta) if i == j else _with_scale(own, 1.0, 0.0 * theta)
                for i, own in enumerate(problem.grams)
            ]
            normal = Normal.of(grams, np.ones(problem.folds.size, dtype=bool), problem.weights)
            prior = _with_factor(problem.prior, float(normal.rigid[p, p]) / normal.rows)
            own_fit = FrictionNormalEquations(normal, prior).fit(slots)
            theta, change = own_fit.theta[:p], float(own_fit.theta[p])
            scale += change
        moved, _ = influence(grams, problem.weights, prior, own_fit, above_zero(own_fit, slots))
        left = _squares(grams, problem.weights, own_fit)
        error = float(np.linalg.norm(moved[:, p]))
        gain = float((squares - left).sum()) / max(float(squares[j]), 1e-300)
        found.append(EffortScale(j, scale, error, gain))
    return found


def moved_masses(estimate: Estimate) -> dict[int, float]:
    """Return joint -> change of its link's mass, as a share, where it is large and rows ask for it.

    Links that can exist are found along what no row tells, too: a mass may move far for nothing.
    So the fit is repeated with all masses held at the URDF's; if that leaves no joint's residual
    larger, the rows do not tell them.
    """
    problem, fit = estimate.problem, estimate.fit
    changes = mass_changes(estimate.question.scene.model, fit.theta)
    moved = np.flatnonzero(np.abs(changes) > MOVED).tolist()
    if not moved:
        return {}
    weight = problem.prior.weight.copy()
    weight[::10] *= _HELD
    slots, prior = problem.slots(estimate.choice.laws), replace(problem.prior, weight=weight)
    held = consistent_fit(problem.normal(), prior, fit, slots)
    left, own = (_squares(problem.grams, problem.weights, x) for x in (held, fit))
    asked = bool((left > (1.0 + _ASKED) * own).any())
    return {j: float(changes[j]) for j in moved if asked}


def _with_factor(links: Prior, square: float) -> Prior:
    """Return the prior of the links and of a factor whose column has this mean square."""
    return Prior(
        np.append(links.center, 0.0),
        np.append(links.weight, _FREE * (square or 1.0)),
        np.append(links.deviation, 0.0),
    )


def _squares(grams: Sequence[BlockProducts], weights: FloatArray, fit: Fit) -> FloatArray:
    """(nj,) weighted squared residual of each joint."""
    result = np.zeros(len(grams))
    for j, own in enumerate(grams):
        x = np.append(-fit.of_joint(j), 1.0)
        result[j] = float(weights[j] * (x @ own.products.sum(axis=0) @ x))
    return result


def _with_scale(own: BlockProducts, scale: float, theta: FloatArray) -> BlockProducts:
    """Return the products of columns with s Y and Y theta in place of the links' columns Y."""
    p, size = theta.size, own.products.shape[1]
    made = np.zeros((size, size + 1))
    made[:p, :p] = scale * np.eye(p)
    made[:p, p] = theta
    made[p:, p + 1 :] = np.eye(size - p)
    return BlockProducts(made.T @ own.products @ made, own.count)
