"""Uncertainty of the coefficients: from blocks within a log, and from differences between logs.

Residuals of friction are autocorrelated over half a second and longer: standard errors that take
rows as independent are 3 to 8 times too small. So whole blocks are the samples
(`notebooks/theory/identification`, "Uncertainty").
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.identification.columns import Prepared, bearings_only
from pinfric.identification.estimate import Estimate
from pinfric.identification.inertias import with_parameters
from pinfric.identification.influence import influence, of_joint
from pinfric.identification.laws import (
    BACKWARD,
    BEARING,
    COULOMB,
    DIRECTIONS,
    FORWARD,
    GEARS,
    INERTIA,
    RESTS_ON,
    SLOTS,
    SPEEDS,
    STRIBECK_BACKWARD,
    STRIBECK_FORWARD,
    STRIBECK_LOAD,
    STRIBECK_VELOCITY,
    K,
    Law,
)
from pinfric.identification.misfit import TIME, UNEVEN, Misfit, in_log, uneven
from pinfric.identification.normal import (
    FrictionNormalEquations,
    above_zero,
    beside,
    orthonormal,
    residuals,
)
from pinfric.identification.stribeck import beside_other, stribeck_decay
from pinfric.identification.ways import change_by_way
from pinfric.model.arrays import FloatArray, IntArray

#: Share of a standard deviation by which a link's parameter is changed to see what its load does.
_STEP = 0.1
#: Columns of the friction that passes a gear between it and the motor.
_INNER = (FORWARD, BACKWARD, *SPEEDS, *RESTS_ON, STRIBECK_VELOCITY)
#: Regularization where shapes are nearly the same.
_RIDGE = 1e-9
#: Reaches of its 95 % interval by which a difference between directions must be large to be named.
_CLEARLY = 1.5
#: Logs from which a spread between them can be told.
_FEWEST_LOGS = 2


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the coefficients.

    Attributes:
        place: (n,) of the coefficients above zero among (nj K,).
        within, between: (n, n) covariance by blocks and shapes, and by differences between logs.
        freedom, logs: of `within`: blocks less one; of `between`: logs less one.
        spread: (nj,) standard deviation of a log's factor on the joint's friction; NaN with one
            log.
        uneven: joint -> half the difference of its Coulomb friction by direction, where clearly
            large.
    """

    place: IntArray
    within: FloatArray
    between: FloatArray
    freedom: int
    logs: int
    spread: FloatArray
    uneven: Mapping[int, float] = field(default_factory=dict)

    def of(self, weights: Mapping[int, float], level: float = 0.95) -> tuple[float, float]:
        """Return standard error and interval's reach to either side of a sum of coefficients.

            (a + b)^2 / (a^2/n_a + b^2/n_b)    freedom of two summed variances (Satterthwaite 1946)

        Args:
            weights: place among (nj K,) -> weight in the sum; those at zero are taken as known.
            level: share of the intervals that hold the sum.
        """
        from scipy.special import stdtrit

        w = np.array([weights.get(at, 0.0) for at in self.place.tolist()])
        own, other = (float(w @ x @ w) for x in (self.within, self.between))
        both = own + other
        if both <= 0.0:
            return 0.0, 0.0
        inverse = (own / both) ** 2 / self.freedom + (other / both) ** 2 / max(self.logs - 1, 1)
        error = float(np.sqrt(both))
        return error, float(stdtrit(1.0 / inverse, 0.5 + 0.5 * level)) * error

    def draws(self, values: FloatArray, count: int, seed: int) -> FloatArray:
        """Return (count, nj K) correlated draws around coefficients (nj, K), none below zero."""
        rng = np.random.default_rng(seed)
        rows = np.tile(values.ravel(), (count, 1))
        for covariance, freedom in (
            (self.within, self.freedom),
            (self.between, max(self.logs - 1, 1)),
        ):
            size, vectors = np.linalg.eigh(covariance)
            root = vectors * np.sqrt(np.maximum(size, 0.0))
            wide = np.sqrt(freedom / rng.chisquare(freedom, count))
            rows[:, self.place] += wide[:, None] * (rng.normal(size=(count, size.size)) @ root.T)
        return np.maximum(rows, 0.0)


def uncertainty(estimate: Estimate, shapes: Sequence[Misfit] = ()) -> Uncertainty:
    """Return the coefficients' covariance, within logs, by the URDF's errors, and between logs.

        (H + F)^-1 (sum over blocks of s s^T + P S P + G^T G) (H + F)^-T + sum over joints of b b^T

    `influence` derives the first part: s is a block's part of the gradient, S the variance of the
    URDF's parameters, G the `gradients` of what the model may have absorbed of the residuals'
    shapes, of unknown sign. b is the `bias` by a joint's shapes; these are independent.
    """
    problem, fit = estimate.problem, estimate.fit
    # Places among (nj K,) of coefficients above zero and of the speeds of Stribeck friction
    speeds = [
        j * K + STRIBECK_VELOCITY for j in estimate.known if fit.slots[j, list(RESTS_ON)].any()
    ]
    place = above_zero(fit, problem.slots(estimate.choice.laws))
    place = np.sort(np.append(place, np.array(speeds, dtype=np.int64)))
    moved, count = influence(
        problem.grams,
        problem.weights,
        problem.prior,
        fit,
        place,
        _feedback(estimate, place),
        gradients(estimate, shapes, place),
    )
    moved = moved[:, moved.shape[1] - place.size :]
    within = moved.T @ moved
    seen = [replace(shape, columns=shape.columns[:, : shape.shown]) for shape in shapes]
    of_joints = [
        [shape for shape in seen if shape.joint == j] for j in {shape.joint for shape in shapes}
    ]
    biases = [bias(estimate, own, place) for own in of_joints]
    for off in (
        *biases,
        *_drifts(estimate, shapes, place),
        *_other_exponents(estimate, place),
        *_other_loads(estimate, place),
        *_other_ways(estimate, place),
    ):
        within += np.outer(off, off)
    between, logs = for_a_further_log(estimate, place)
    known = Uncertainty(place, within, between, count - 1, logs, between_logs(estimate))
    clear = {}
    for j, half in uneven(estimate).items():  # if an offset explains it
        _, reach = known.of({j * K + FORWARD: 0.5, j * K + BACKWARD: -0.5})
        if abs(half) > 0.5 * UNEVEN * estimate.fit.slots[j, COULOMB].sum() + _CLEARLY * reach:
            clear[j] = half
        off = half * ((place == j * K + FORWARD) * 1.0 - (place == j * K + BACKWARD))
        within = within + np.outer(off, off)
    return replace(known, within=within, uneven=clear)


def gradients(estimate: Estimate, shapes: Sequence[Misfit], place: IntArray) -> FloatArray:
    """Return (m, p + n) the gradients A^T W Z by the estimate, for the columns Z of all shapes.

    Args:
        shapes: of the estimate's residuals.
        place: (n,) of the coefficients above zero among (nj K,).
    """
    p = estimate.fit.theta.size
    result = np.zeros((sum(shape.columns.shape[1] for shape in shapes), p + place.size))
    first = 0
    for shape in shapes:
        to, columns = of_joint(place, shape.joint, p)
        rows, last = estimate.rows[shape.joint], first + shape.columns.shape[1]
        weighed = shape.columns * _row_weights(estimate, shape.joint)
        result[first:last, to] = weighed.T @ rows.columns[:, columns]
        first = last
    return result


def bias(estimate: Estimate, shapes: Sequence[Misfit], place: IntArray) -> FloatArray:
    """Return (n,) changes of the coefficients when one joint's shapes join the model.

        [H  G^T    ] [dz]   [0      ]
        [G  Z^T W Z] [b ] = [Z^T W r],    G: `gradients`, r: residuals

    `place`: (n,) of the coefficients above zero among (nj K,).
    """
    problem, p = estimate.problem, estimate.fit.theta.size
    hessian, beside = _left(estimate, place), gradients(estimate, shapes, place)
    joint, columns = shapes[0].joint, np.hstack([shape.columns for shape in shapes])
    weighed = columns * _row_weights(estimate, joint)
    hessian = np.block([[hessian, beside.T], [beside, columns.T @ weighed]])
    off = weighed.T @ residuals(estimate.rows[joint], estimate.fit, joint)
    right = np.append(np.zeros(p + place.size), off)
    if problem.prior.kept:
        hessian, right, p = hessian[p:, p:], right[p:], 0
    return _solved(hessian, right)[p : p + place.size]


def _left(estimate: Estimate, place: IntArray) -> FloatArray:
    """(p + n, p + n) left side of the estimate's normal equations."""
    problem, p = estimate.problem, estimate.fit.theta.size
    normal = problem.normal()
    cross = normal.cross[:, place]
    hessian = np.block([[normal.rigid, cross], [cross.T, normal.slots[np.ix_(place, place)]]])
    if not problem.prior.kept:
        hessian[:p, :p] += np.diag(normal.rows * problem.prior.weight)
    return hessian


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(size, size) + _RIDGE * np.eye(size.size)
    return np.asarray(np.linalg.solve(scaled, right / size) / size)


def _other_exponents(estimate: Estimate, place: IntArray) -> Iterator[FloatArray]:
    """Yield (n,) the changes of the coefficients with each other exponent that is admitted.

    If that exponent is right, they are the error, so its square adds to the variance.
    """
    p = estimate.fit.theta.size
    alternatives = [
        (j, stribeck, other)
        for j, stribeck in enumerate(estimate.stribeck)
        if stribeck is not None and estimate.choice.laws[j].stribeck_slots
        for other in stribeck.others
    ]
    for j, stribeck, other in alternatives:
        direct = {
            STRIBECK_FORWARD: other.forward - stribeck.forward,
            STRIBECK_BACKWARD: other.backward - stribeck.backward,
            STRIBECK_LOAD: other.load - stribeck.load,
            STRIBECK_VELOCITY: float(np.log(other.velocity / stribeck.velocity)),
        }
        own = [j * K + slot for slot in direct]
        others, off = place[~np.isin(place, own)], np.zeros(place.size)
        to, columns = of_joint(others, j, p)
        rows, right = estimate.rows[j], np.zeros(p + others.size)
        more = beside_other(estimate.prepared, j, stribeck, other)[:, None] * _row_weights(
            estimate, j
        )
        right[to] = -(rows.columns[:, columns].T @ more)[:, 0]
        hessian = _left(estimate, others)
        if estimate.problem.prior.kept:
            hessian, right = hessian[p:, p:], right[p:]
        off[~np.isin(place, own)] = _solved(hessian, right)[right.size - others.size :]
        for at, change in zip(own, direct.values(), strict=True):
            off[place == at] = change
        yield off


def _other_loads(estimate: Estimate, place: IntArray) -> Iterator[FloatArray]:
    """Yield (n,) changes of the coefficients with each load that is not ruled out."""
    problem, laws = estimate.problem, list(estimate.choice.laws)
    equations = FrictionNormalEquations(problem.normal(), problem.prior)

    def fitted(joint: int, law: Law) -> FloatArray:
        slots = equations.fit(problem.slots([*laws[:joint], law, *laws[joint + 1 :]])).slots
        own, losses = slots[joint], list(GEARS.values())
        if law.load == "gear" == laws[joint].load:  # one loss beside two is their mean
            ways = DIRECTIONS[2:] if law.both_ways else DIRECTIONS[:2]
            own[losses] = np.mean([own[GEARS[law.side, way]] for way in ways])
        return np.asarray(slots.ravel()[place])

    for j in estimate.known:
        for law in estimate.choice.rivals[j]:
            yield fitted(j, law) - fitted(j, laws[j])


def _drifts(estimate: Estimate, shapes: Sequence[Misfit], place: IntArray) -> Iterator[FloatArray]:
    """Yield (n,) deviations of a joint's friction at a time of the logs from its mean over time.

        x(t) = x + a t + b (t^2 - 1/3),    t: -1 to 1 over each log

    They are taken as even up to that of the farther end, d: their standard deviation is d/sqrt(3).
    """
    for j in {shape.joint for shape in shapes if shape.over == TIME}:
        rows, weight = estimate.rows[j], np.sqrt(estimate.row_weights[j])[:, None]
        here = [at for at in COULOMB + list(SPEEDS) if j * K + at in place]
        t = in_log(estimate, j)[:, None]
        changing = [rows.slots[:, here] * shape for shape in (t, t**2 - 1.0 / 3.0)]
        off = residuals(rows, estimate.fit, j)
        basis = orthonormal(np.column_stack((rows.rigid, rows.slots)) * weight)
        columns = beside(basis, np.column_stack((*changing, off)) * weight)
        a, b = np.linalg.lstsq(columns[:, :-1], columns[:, -1], rcond=_RIDGE)[0].reshape(2, -1)
        result = np.zeros(place.size)
        for at, x in zip(here, (np.abs(a) + np.abs(b) * 2.0 / 3.0).tolist(), strict=True):
            result[place == j * K + at] = x / np.sqrt(3.0)
        yield result


def _other_ways(estimate: Estimate, place: IntArray) -> Iterator[FloatArray]:
    """Yield (n,) changes of the coefficients with a way longer, or a delay larger, by its error."""
    build, p = estimate.build, estimate.fit.theta.size
    if build is None or not estimate.builds_up:
        return
    later, hessian = np.zeros(p + place.size), _left(estimate, place)
    hessian, first = (hessian[p:, p:], p) if estimate.problem.prior.kept else (hessian, 0)
    for j, (rows, way) in enumerate(zip(estimate.rows, build.ways, strict=True)):
        to, columns = of_joint(place, j, p)
        weighted = rows.columns[:, columns] * _row_weights(estimate, j)
        fitted = np.concatenate((estimate.fit.theta, estimate.fit.slots[j]))
        later[to] += build.error * (weighted.T @ (_rates(estimate, j) @ fitted))
        if way is not None:
            right = np.zeros(p + place.size)
            more = change_by_way(estimate.prepared, j, way) @ estimate.fit.slots[j, COULOMB]
            right[to] = -(weighted.T @ more)
            yield _solved(hessian, right[first:])[p - first :]
    yield _solved(hessian, later[first:])[p - first :]


def _rates(estimate: Estimate, joint: int) -> FloatArray:
    """(n, p + K) derivatives by time of a joint's columns."""
    parts = [
        np.hstack((log.rigid_rates[own, joint], log.slot_rates[own, joint]))
        for log in estimate.prepared
        for own in [log.slides[:, joint]]
    ]
    return np.concatenate(parts).astype(np.float64)


def _row_weights(estimate: Estimate, joint: int) -> FloatArray:
    """(rows, 1) of a joint."""
    return (estimate.problem.weights[joint] * estimate.row_weights[joint])[:, None]


def for_a_further_log(estimate: Estimate, place: IntArray) -> tuple[FloatArray, int]:
    """Return (n, n) the covariance of a further log's coefficients x about those of L logs, and L.

        s^2 (1 + 1/L) x x^T    of each joint, s^2: variance of its factor between L logs

    The L that is returned is the least of all joints; L - 1 is the freedom. `place`: (n,) of the
    coefficients among (nj K,).
    """
    factors_of = [_log_factors(estimate, j)[0] for j in range(len(estimate.rows))]
    values = estimate.fit.slots.ravel()[place] * (place % K != INERTIA)
    between = np.zeros((place.size, place.size))
    for j, factors in enumerate(factors_of):
        if len(factors) >= _FEWEST_LOGS:
            own = values * (place // K == j)
            share = np.var(factors, ddof=1) * (1.0 + 1.0 / len(factors))
            between += share * np.outer(own, own)
    counts = [len(factors) for factors in factors_of if len(factors) >= _FEWEST_LOGS]
    return between, min(counts, default=1)


def _feedback(estimate: Estimate, place: IntArray) -> FloatArray:
    """What loads' columns add to H, (p + n, p + n), since they depend on the estimate.

    F = A^T W x dA/d(theta, coefficients), x: coefficient of the column
    """
    p = estimate.fit.theta.size
    result = np.zeros((p + place.size, p + place.size))
    for whole in place.tolist():
        j, slot = divmod(whole, K)
        slopes = _load_slopes(estimate, j, slot)
        if slopes is None:
            continue
        to, columns = of_joint(place, j, p)
        weight, rows = _row_weights(estimate, j) * estimate.fit.slots[j, slot], estimate.rows[j]
        weighted = rows.columns[:, columns] * weight
        result[np.ix_(to, to)] += weighted.T @ slopes[:, columns]
    return result


def _load_slopes(estimate: Estimate, joint: int, slot: int) -> FloatArray | None:
    """Derivatives (rows, p + K) of a load's column by theta and slots; None: no load."""
    rows = estimate.rows[joint]
    none = np.zeros_like(rows.slots)
    if estimate.question.no_gravity:  # then loads are the URDF's
        return None
    if slot == STRIBECK_LOAD:
        stribeck, whole = estimate.stribeck[joint], _load_slopes(estimate, joint, BEARING)
        assert stribeck is not None  # its law has one
        assert whole is not None  # loads are found here
        return whole * stribeck_decay(rows.velocity, stribeck.velocity, stribeck.exponent)[:, None]
    if slot == BEARING:
        entry = estimate.scene.friction.get(estimate.scene.joint_names[joint])
        if entry is None or entry.bearing is None:  # the load is that of the gear
            return np.hstack((rows.rigid * np.sign(rows.velocity * rows.load)[:, None], none))
        slopes = [_bearing_slopes(estimate, log, joint) for log in estimate.prepared]
        return np.hstack((np.concatenate(slopes), none))
    if slot not in GEARS.values():
        return None
    side, way = next(key for key, place in GEARS.items() if place == slot)
    direction = np.sign(rows.velocity * rows.load)
    direction *= (
        (direction < 0.0) if way == "driven" else (direction > 0.0) if way == "driving" else 1.0
    )
    inner = [side == "joint" and own in _INNER for own in SLOTS]
    return np.hstack((rows.rigid, rows.slots * inner)) * direction[:, None]


def _bearing_slopes(estimate: Estimate, prepared: Prepared, joint: int) -> FloatArray:
    """Derivatives (rows, p) of a bearing's column in one log by the carried links."""
    scene, motion = estimate.scene, prepared.recording.trajectory
    at = prepared.kept[prepared.slides[:, joint]]
    if not at.size:  # it stands still in this log
        return np.zeros((0, estimate.fit.theta.size))
    q, v, a = (np.ascontiguousarray(x[at]) for x in (motion.q, motion.v, motion.a))
    probe, theta = bearings_only(scene), estimate.fit.theta

    def load(theta: FloatArray) -> FloatArray:
        changed = probe.with_(model=with_parameters(scene.model, theta))
        result = inverse_dynamics(changed, q, v, a, attached=motion.attached[at])
        return result.normal_load[:, result.site_names.index(scene.joint_names[joint])]

    slopes, here = np.zeros((at.size, theta.size)), load(theta)
    carried = np.isin(np.arange(theta.size) // 10 + 1, scene.model.subtrees[joint + 1])
    for k in np.flatnonzero(carried & (estimate.problem.prior.deviation > 0.0)):
        step = _STEP * estimate.problem.prior.deviation[k]
        slopes[:, k] = (load(theta + step * (np.arange(theta.size) == k)) - here) / step
    return slopes * np.sign(v[:, [joint]])


def between_logs(estimate: Estimate) -> FloatArray:
    """Return (nj,) standard deviation of a joint's friction from log to log, as a share.

    It is the scatter of each log's factor on friction, less that of blocks in a log.
    """
    result = []
    for j in range(len(estimate.rows)):
        factors, noise = _log_factors(estimate, j)
        enough = len(factors) >= _FEWEST_LOGS
        variance = np.var(factors, ddof=1) - np.mean(noise) if enough else np.nan
        result.append(float(np.sqrt(max(variance, 0.0))) if enough else np.nan)
    return np.array(result)


def _log_factors(estimate: Estimate, joint: int) -> tuple[list[float], list[float]]:
    """Each log's factor on friction, and its variance by the log's blocks."""
    rows, factors, noise = estimate.rows[joint], [], []
    values = np.where(np.arange(K) == INERTIA, 0.0, estimate.fit.slots[joint])
    friction, off = rows.slots @ values, residuals(rows, estimate.fit, joint)
    for log in range(len(estimate.prepared)):
        own = [
            _factor(friction[in_block], off[in_block])
            for b in np.unique(rows.block)
            if (in_block := (rows.block == b) & (rows.log == log)).any()
        ]
        if len(own) > 1:
            factors.append(_factor(friction[rows.log == log], off[rows.log == log]))
            noise.append(float(np.var(own, ddof=1)) / len(own))
    return factors, noise


def _factor(friction: FloatArray, off: FloatArray) -> float:
    size = float(friction @ friction)
    return 1.0 + float(friction @ off) / size if size > 0.0 else 1.0
