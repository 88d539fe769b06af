"""What efforts tell of gravity and of the zeros of angles, with links and friction free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.identification.checks import gravity_efforts
from pinfric.identification.columns import at_rows
from pinfric.identification.estimate import Estimate, turns
from pinfric.identification.inertias import urdf_prior, with_parameters
from pinfric.identification.influence import influence
from pinfric.identification.laws import PLAIN, Law
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
from pinfric.model.couples import delivery

#: rad, and standard errors, beyond which a base is tilted, and the share of the squared residual
#: that must be left at most. Of 30 arms on level bases, 18 of them with friction that no law
#: describes, none was beyond all three; of 9 that were tilted by 3 or 15 degrees 8 were.
_LEAST, _ERRORS, _LEFT = np.radians(2.0), 3.0, 0.95
#: rad beyond which a zero is off, share by which time stamps may be wrong, and the standard errors
#: on top of both. Of 40 true arms the farthest was 2.5 standard errors away.
_ZERO, _OFF, _SURE = 0.05, 0.05, 3.5
#: Rounds in which the unknowns' efforts follow the links that are fitted beside them.
_ROUNDS = 8
#: Part of a link's mass below which what is fitted beside the unknowns is no link.
_LIGHTEST = 0.01
#: Weight of the unknowns' prior: only what no row determines stays as the scene says.
_FREE = 1e-9
#: Half of a 95 % interval in standard errors.
REACH = 1.96

#: Columns (n, nj) of each log that the unknowns multiply, by a model with the links so far.
_Columns = Callable[[pin.Model], Sequence[Sequence[FloatArray]]]


@dataclass(frozen=True)
class Gravity:
    """Gravity by the efforts.

    Attributes:
        vector: (3,) its direction in the base's frame, as long as the scene's, m/s^2.
        angle, standard_error: from the scene's direction, rad.
        size, size_error: its length over the scene's, and the standard error.
        left: squared residual of all joints over that with the scene's gravity.
    """

    vector: FloatArray
    angle: float
    standard_error: float
    size: float
    size_error: float
    left: float

    @property
    def tilted(self) -> bool:
        """Whether the base is tilted."""
        return self.left < _LEFT and self.angle > _LEAST + _ERRORS * self.standard_error

    def time(self, reach: float = REACH) -> tuple[float, float]:
        """Return an interval of stamped time over true time; `reach`: its standard errors.

        Accelerations go with the square of time: gravity seems to be 1/s^2 of itself.
        """
        ends = (self.size + way * reach * self.size_error for way in (1.0, -1.0))
        low, high = (1.0 / np.sqrt(end) if end > 0.0 else np.inf for end in ends)
        return float(low), float(high)

    @property
    def off_the_clock(self) -> bool:
        """Whether the time stamps are wrong."""
        low, high = self.time(_SURE)
        return low > 1.0 + _OFF or high < 1.0 - _OFF


@dataclass(frozen=True)
class Zero:
    """By how much an angle's zero is off by the efforts, and its standard error, rad."""

    joint: int
    value: float
    standard_error: float

    @property
    def off(self) -> bool:
        """Whether it is off; beyond pi it is no zero, but an effort that the model lacks."""
        return _ZERO + _SURE * self.standard_error < abs(self.value) < np.pi

    @property
    def known(self) -> bool:
        """Whether efforts show that it is not off."""
        return abs(self.value) + REACH * self.standard_error < _ZERO


def gravity_by_efforts(estimate: Estimate) -> Gravity | None:
    """Return gravity's direction and length, links and friction fitted beside it; None: no gravity.

        y = Y theta + sum over i of g_i G_i(theta) + friction

    G_i are the efforts of gravity of 1 m/s^2, along two directions across the scene's, beside plain
    friction, as what a tilt does may have chosen other laws; then along it, beside the chosen laws,
    as losses of gears look like another gravity.
    """
    scene, logs = estimate.question.scene, estimate.prepared
    down = np.asarray(scene.model.gravity.linear)
    size = float(np.linalg.norm(down))
    if size == 0.0 or estimate.question.no_gravity:
        return None

    def along(directions: FloatArray, laws: Sequence[Law]) -> _Found:
        def columns(model: pin.Model) -> list[list[FloatArray]]:
            found = []
            for direction in directions:
                model.gravity.linear = direction
                found.append(gravity_efforts(model, scene, logs))
            return found

        return _beside_links(estimate, columns, len(directions), laws)

    across = np.linalg.svd(down[None])[2][1:]
    found = along(across, [PLAIN] * len(estimate.rows))
    more = along(down[None] / size, estimate.choice.laws)
    turned = found.values @ across
    aside = float(np.linalg.norm(turned))
    error = float(np.linalg.norm(found.moved @ found.values)) / max(aside, 1e-300) / size
    return Gravity(
        (down + turned) * size / np.hypot(size, aside),
        float(np.arctan2(aside, size)),
        error,
        1.0 + float(more.values[0]) / size,
        float(np.linalg.norm(more.moved)) / size,
        found.left,
    )


def zeros_by_efforts(estimate: Estimate) -> list[Zero]:
    """Return of each turning joint whose angle efforts depend on how far its zero is off.

        y = Y theta + sum over k of d_k (d(Y theta)/dq_k) + friction

    All are unknown together; a base's upright axis is left out, as its zero changes no effort.
    """
    scene, logs = estimate.question.scene, estimate.prepared
    names, P = scene.joint_names, delivery(scene.drives, scene.model.nv)
    slopes = _slopes(scene.model, estimate)
    whole = [np.linalg.norm(own.effort) for own in estimate.rows]
    asked = [
        k
        for k, name in enumerate(names)
        if turns(scene, name)
        and any(
            np.linalg.norm(at_rows([own[:, :, k] for own in slopes], logs, j)) > 1e-3 * size > 0.0
            for j, size in enumerate(whole)
        )
    ]
    if not asked:
        return []

    def columns(model: pin.Model) -> list[list[FloatArray]]:
        slopes = _slopes(model, estimate)
        seen = [[own[:, :, k] for own in slopes] for k in asked]
        return [[part @ P.T for part in own] if P.size else own for own in seen]

    found = _beside_links(estimate, columns, len(asked), estimate.choice.laws)
    errors = np.linalg.norm(found.moved, axis=0)
    return [
        Zero(k, float(-value), float(error))
        for k, value, error in zip(asked, found.values, errors, strict=True)
    ]


def _slopes(model: pin.Model, estimate: Estimate) -> list[FloatArray]:
    """Return of each log the derivatives of efforts by angles (n, nj, nj)."""
    data, parts = model.createData(), []
    for prepared in estimate.prepared:
        motion, kept = prepared.recording.trajectory, prepared.kept
        own = np.empty((kept.size, model.nv, model.nv))
        for k, state in enumerate(zip(motion.q[kept], motion.v[kept], motion.a[kept], strict=True)):
            pin.computeRNEADerivatives(model, data, *state)
            own[k] = data.dtau_dq
        parts.append(own)
    return parts


class _Found(NamedTuple):
    """Unknowns (n,); influence on each, (m, n); what is left of the squared residual, a share."""

    values: FloatArray
    moved: FloatArray
    left: float


def _beside_links(estimate: Estimate, columns: _Columns, count: int, laws: Sequence[Law]) -> _Found:
    """Return `count` unknowns, with links and friction by `laws` fitted beside their columns."""
    scene, problem, logs = estimate.question.scene, estimate.problem, estimate.prepared
    links, none = urdf_prior(scene.model, kept=False), np.zeros(count)
    prior = Prior(
        np.append(links.center, none),
        np.append(links.weight, none + _FREE),
        np.append(links.deviation, none),
    )
    slots, p = problem.slots(laws), links.center.size
    theta, row_weights, weights = estimate.fit.theta, estimate.row_weights, problem.weights
    first = 1.0
    for number in range(_ROUNDS + 1):
        # 1. their columns, with the links so far; first none: the error that they have to beat
        parts = columns(with_parameters(scene.model, theta))
        # 2. a fit beside them
        rows = []
        for j, own in enumerate(estimate.rows):
            seen = [at_rows(part, logs, j) * (number > 0) for part in parts]
            rows.append(replace(own, rigid=np.column_stack((own.rigid, *seen))))
        pairs = zip(rows, row_weights, strict=True)
        grams = [BlockProducts.of(own, w, problem.folds.size) for own, w in pairs]
        normal = Normal.of(grams, np.ones(problem.folds.size, dtype=bool), weights)
        fit = FrictionNormalEquations(normal, prior).fit(slots)
        off = [float(np.sum(residuals(own, fit, j) ** 2)) for j, own in enumerate(rows)]
        left, linked = float(problem.weights @ off), fit.theta[:p]
        light = linked[::10] <= _LIGHTEST * links.center[::10]
        if not (light & (links.center[::10] > 0.0)).any():  # slopes of such links are rounding
            theta = linked
        if number == 0:
            first = left
        elif number < _ROUNDS:
            row_weights, weights = weighted(rows, fit)
    moved, _ = influence(grams, weights, prior, fit, above_zero(fit, slots))
    return _Found(fit.theta[p:], moved[:, p : p + count], left / max(first, 1e-300))
