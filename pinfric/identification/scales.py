"""Factors on single joints' efforts, beside free masses: a wrong unit, ratio or motor constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.identification.estimate import Estimate
from pinfric.identification.influence import influence
from pinfric.identification.normal import (
    BlockProducts,
    FrictionNormalEquations,
    Normal,
    Prior,
    above_zero,
)
from pinfric.model.arrays import FloatArray

#: A factor is doubted beyond this share and so many standard errors. Of 21 true arms of three
#: joints none was; of 12 with the factors 0.6, 0.75 or 1.6 at one joint 11 were.
_LEAST, _ERRORS = 0.05, 2.5
#: A factor with a larger standard error is not known: a last joint carries next to nothing.
_KNOWN = 0.25
#: Gauss-Newton steps; the third changes a factor by some thousandths.
_ROUNDS = 3
#: Weight of a factor's prior: only what no row determines stays at 1.
_FREE = 1e-12


@dataclass(frozen=True)
class EffortScale:
    """Factor by which a joint's effort differs from what the other joints' efforts ask for.

    Attributes:
        joint: its number. value, standard_error: of the factor.
        left: squared residual of all joints with this factor.
    """

    joint: int
    value: float
    standard_error: float
    left: float

    @property
    def doubted(self) -> bool:
        """Whether it is known and not 1."""
        return (
            self.standard_error < _KNOWN
            and abs(self.value - 1.0) > _LEAST + _ERRORS * self.standard_error
        )


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
    links = problem.prior
    prior = Prior(
        np.append(links.center, 0.0),
        np.append(links.weight, _FREE),
        np.append(links.deviation, 0.0),
    )
    found = []
    for j in estimate.known:
        scale, theta = 1.0, fit.theta
        for _ in range(_ROUNDS):  # s_j Y_j theta about the present s_j and theta
            grams = [
                _with_scale(own, scale, theta) if i == j else _with_scale(own, 1.0, 0.0 * theta)
                for i, own in enumerate(problem.grams)
            ]
            normal = Normal.of(grams, np.ones(problem.folds.size, dtype=bool), problem.weights)
            own_fit = FrictionNormalEquations(normal, prior).fit(slots)
            theta, change = own_fit.theta[:p], float(own_fit.theta[p])
            scale += change
        moved, _ = influence(grams, problem.weights, prior, own_fit, above_zero(own_fit, slots))
        left = 0.0
        for i, (own, weight) in enumerate(zip(grams, problem.weights, strict=True)):
            x = np.append(-own_fit.of_joint(i), 1.0)
            left += float(weight * (x @ own.products.sum(axis=0) @ x))
        error = float(np.linalg.norm(moved[:, p]))
        found.append(EffortScale(j, scale, error, left))
    return found


def _with_scale(own: BlockProducts, scale: float, theta: FloatArray) -> BlockProducts:
    """Return the products of columns with s Y and Y theta in place of the links' columns Y."""
    p, size = theta.size, own.products.shape[1]
    made = np.zeros((size, size + 1))
    made[:p, :p] = scale * np.eye(p)
    made[:p, p] = theta
    made[p:, p + 1 :] = np.eye(size - p)
    return BlockProducts(made.T @ own.products @ made, own.count)
