"""Gravity's direction as an unknown: a base mounted at another angle than the scene says."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinfric.identification.checks import gravity_efforts
from pinfric.identification.columns import at_rows
from pinfric.identification.estimate import Estimate
from pinfric.identification.inertias import urdf_prior, with_parameters
from pinfric.identification.influence import influence
from pinfric.identification.laws import PLAIN
from pinfric.identification.normal import (
    BlockProducts,
    FrictionNormalEquations,
    Normal,
    Prior,
    above_zero,
    residuals,
    weighted,
)
from pinfric.model.arrays import FloatArray

#: rad, and standard errors, beyond which a base is tilted, and the share of the squared residual
#: that must be left at most. Of 30 arms on level bases, 18 of them with friction that no law
#: describes, none was beyond all three; of 9 that were tilted by 3 or 15 degrees 8 were.
_LEAST, _ERRORS, _LEFT = np.radians(2.0), 3.0, 0.95
#: Rounds in which gravity's efforts follow the links that are fitted beside the direction.
_ROUNDS = 8
#: Weight of the direction's prior: only what no row determines stays as the scene says.
_FREE = 1e-9


@dataclass(frozen=True)
class Tilt:
    """Gravity's direction by the efforts.

    Attributes:
        gravity: (3,) in the base's frame, m/s^2, as long as the scene's.
        angle, standard_error: from the scene's direction, rad.
        left: squared residual of all joints over that without a tilt.
    """

    gravity: FloatArray
    angle: float
    standard_error: float
    left: float

    @property
    def doubted(self) -> bool:
        """Whether the base is tilted."""
        return self.left < _LEFT and self.angle > _LEAST + _ERRORS * self.standard_error


def base_tilt(estimate: Estimate) -> Tilt | None:
    """Return gravity's direction, with links and friction fitted beside it; None: no gravity.

        y = Y theta + sum over i of g_i G_i(theta) + friction

    G_i are the efforts of gravity of 1 m/s^2 along two directions across the scene's. Friction is
    plain: what a tilt does may have chosen other laws.
    """
    scene, problem, logs = estimate.question.scene, estimate.problem, estimate.prepared
    down = np.asarray(scene.model.gravity.linear)
    size = float(np.linalg.norm(down))
    if size == 0.0 or estimate.question.no_gravity:
        return None
    across = np.linalg.svd(down[None])[2][1:]
    links = urdf_prior(scene.model, kept=False)
    prior = Prior(
        np.append(links.center, [0.0, 0.0]),
        np.append(links.weight, [_FREE, _FREE]),
        np.append(links.deviation, [0.0, 0.0]),
    )
    slots, p = problem.slots([PLAIN] * len(estimate.rows)), links.center.size
    theta, row_weights, weights = estimate.fit.theta, estimate.row_weights, problem.weights
    first = 1.0
    for number in range(_ROUNDS + 1):
        # 1. gravity's efforts, with the links so far; first none: the error that a tilt has to beat
        columns = []
        for direction in across * (number > 0):
            model = with_parameters(scene.model, theta)
            model.gravity.linear = direction
            efforts = gravity_efforts(model, scene, logs)
            columns.append([at_rows(efforts, logs, j) for j in range(len(estimate.rows))])
        # 2. a fit beside them
        rows = [
            replace(own, rigid=np.column_stack((own.rigid, *seen)))
            for own, *seen in zip(estimate.rows, *columns, strict=True)
        ]
        pairs = zip(rows, row_weights, strict=True)
        grams = [BlockProducts.of(own, w, problem.folds.size) for own, w in pairs]
        normal = Normal.of(grams, np.ones(problem.folds.size, dtype=bool), weights)
        fit = FrictionNormalEquations(normal, prior).fit(slots)
        off = [float(np.sum(residuals(own, fit, j) ** 2)) for j, own in enumerate(rows)]
        left, theta = float(problem.weights @ off), fit.theta[:p]
        if number == 0:
            first = left
        elif number < _ROUNDS:
            row_weights, weights = weighted(rows, fit)
    # 3. direction and its error
    moved, _ = influence(grams, weights, prior, fit, above_zero(fit, slots))
    turned = fit.theta[p:] @ across
    aside = float(np.linalg.norm(turned))
    error = float(np.linalg.norm(moved[:, p : p + 2] @ fit.theta[p:])) / max(aside, 1e-300) / size
    gravity = (down + turned) * size / np.hypot(size, aside)
    return Tilt(gravity, float(np.arctan2(aside, size)), error, left / max(first, 1e-300))
