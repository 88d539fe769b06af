"""Checks of logs against the robot, before and after the fit: signs, gains, one robot."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.errors import IdentificationError, problems_line
from pinfric.identification.columns import Prepared, Rows, at_rows
from pinfric.identification.inertias import urdf_prior
from pinfric.identification.laws import COULOMB, GEARS, INERTIA, PLAIN
from pinfric.identification.normal import Fit, Prior, beside, orthonormal, residuals
from pinfric.model.arrays import FloatArray
from pinfric.model.couples import delivery
from pinfric.model.scene import Scene

#: Slopes of the logged effort on that of the URDF's masses: right logs gave 0.92 to 1.35 with
#: correlations from 0.96, URDFs wrong by up to 40 %.
_SLOPES, _CORRELATION = (0.6, 1.6), 0.8
#: A slope says something where loads make at least this share of the effort, by the URDF or after
#: the slope; in the second case it must differ from 1 by more standard deviations than these.
_LEAST_LOAD, _DEVIATIONS = 0.1, 8.0
#: Rows below which a joint's effort is not judged.
_FEWEST = 50
#: An effort that changes by less than this share of itself is always the same.
_CONSTANT = 1e-9
#: The columns of friction and rotor that every drive may have.
_OWN = [*COULOMB, PLAIN.slots[2], INERTIA]
#: Logged efforts may exceed a URDF's limit, which is often a continuous one, by this factor; dry
#: friction is a smaller share of it. From the second on a URDF means that there is none, N m or N.
_OVER_LIMIT, _MOST_FRICTION, _NO_LIMIT = 1.5, 0.5, 1e6
#: Blocks from which an interval of gravity's factor is computed, the reach from which it says
#: nothing, the factor below which there is no gravity, and the change that kept masses may need.
_FEWEST_BLOCKS, _UNKNOWN, _NO_GRAVITY, OTHER_GRAVITY = 5, 0.2, 0.2, 0.15
#: How far the rigid efforts of two logs of one robot may differ, as a share.
_ONE_ROBOT = 0.3
#: Error of the fit of all logs in one of them, as a share of its effort and over that of the log's
#: own fit, from which they may be of two robots.
_UNLIKE, _OWN_ERROR = 0.1, 2.0
#: Of an effort or an angle of the other sign.
_REMEDY = (
    "in a file given by --columns `effort_scale: -1` turns the effort alone (or the factor to N m, "
    "negative), `sign: -1` turns angle and effort"
)


def check_efforts(
    scene: Scene, rows: Sequence[Rows], logs: str, confirmed: Collection[str]
) -> None:
    """Refuse efforts that do not fit this robot in N m or N.

    Args:
        rows: of each joint. logs: their names, for messages.
        confirmed: joints whose gain a person has stated: only their signs are judged.

    Raises:
        IdentificationError: a wrong sign or unit, by joint, all in one message.
    """
    prior = urdf_prior(scene.model, kept=False)
    theta, problems, factors = prior.center, [], {}
    for j, (name, own) in enumerate(zip(scene.joint_names, rows, strict=True)):
        if own.effort.size < _FEWEST:
            continue
        slope, correlation = _slope(own, prior)
        if np.ptp(own.effort) <= _CONSTANT * np.abs(own.effort).max():
            problems.append(
                f"joint {name}: its effort is always {own.effort[0]:.3g}, so it was not "
                f"measured; log it, or leave its friction out: --without {name}"
            )
        elif slope < 0.0 and correlation < -_CORRELATION:
            problems.append(
                f"joint {name}: its effort falls where the robot's weight makes it rise (slope "
                f"{slope:.2f}, correlation {correlation:.2f}): the sign of the effort or of the "
                f"angle, or the zero of the angle, is wrong; {_REMEDY}; `offset` moves the zero"
            )
        elif _turned(own, theta):
            problems.append(
                f"joint {name}: its effort acts against its motion, as if friction or inertia "
                f"drove it: the sign of the effort or of the angle is wrong; {_REMEDY}"
            )
        elif (
            correlation > _CORRELATION
            and not _SLOPES[0] < slope < _SLOPES[1]
            and name not in confirmed
        ):
            factors[j] = slope
    if factors and not _carries(rows, theta, factors):
        names = zip(scene.joint_names, rows, strict=True)
        still = ", ".join(name for name, own in names if own.effort.size == 0)
        dead = f"; {still} never moves in the log: is its encoder dead?" if still else ""
        problems += [
            f"joint {scene.joint_names[j]}: its effort is {slope:.3g} times what the URDF's masses "
            "need: is it at the motor's shaft (--effort-at motor), or in A? Give the factor to N m "
            "by --gain "
            f"{scene.joint_names[j]}=FACTOR ({scene.joint_names[j]}=1 if it is "
            f"in N m, and the masses are wrong or the scene lacks a payload){dead}"
            for j, slope in factors.items()
        ]
    if problems:
        raise IdentificationError(problems_line(logs, problems))


def gravity_scales(
    scene: Scene, logs: Sequence[Prepared], rows: Sequence[Rows]
) -> dict[int, tuple[float, float]]:
    """Return joint -> factor s on the URDF's gravity in its effort, and reach of its 95 % interval.

        y = s G(q) + s_d (t - G) + J a + friction + g |t| sign v

    t is the URDF's rigid effort, without payloads; blocks are the samples. Losses that differ by d
    between driving and driven change s by up to d/2. Joints whose logs do not determine s are left
    out.
    """
    scales, slots = {}, [*_OWN, GEARS["motor", "both"]]
    for j, own, G, inertia in _rigid_parts(scene, logs, rows):
        found = _scale(own, G, np.column_stack((inertia, own.slots[:, slots])))
        if found is not None and found.share > _LEAST_LOAD and found.reach < _UNKNOWN:
            scales[j] = found.value, found.reach
    return scales


def inertia_scales(
    scene: Scene, logs: Sequence[Prepared], rows: Sequence[Rows], fit: Fit, weights: FloatArray
) -> tuple[dict[int, tuple[float, float]], tuple[float, float] | None]:
    """Return joint -> factor s on the links' inertia in its effort, and reach of its 95 % interval.

        y = s (t - G) + s_g G + J a + friction

    t is the URDF's rigid effort, without payloads, G its gravity. The links' inertia changes with
    the posture, which no rotor's does. Then one s of all joints, `weights` their (nj,): s is the
    square of stamped over true time; None: no joint's rows tell it.
    """
    scales, products = {}, list[FloatArray]()
    for j, own, G, inertia in _rigid_parts(scene, logs, rows):
        slots = [*_OWN, *np.flatnonzero(fit.slots[j])]
        found = _scale(own, inertia, np.column_stack((G, own.slots[:, slots])))
        if found is not None:
            scales[j] = found.value, found.reach
            products.append(weights[j] * found.products)
    if not products:
        return scales, None
    whole = np.zeros((max(len(one) for one in products), 2))
    for one in products:
        whole[: len(one)] += one
    return scales, _factor(whole)


def _rigid_parts(
    scene: Scene, logs: Sequence[Prepared], rows: Sequence[Rows]
) -> Iterator[tuple[int, Rows, FloatArray, FloatArray]]:
    """Yield each joint, its rows, and the parts of its links' effort: gravity, and what is left."""
    gravity = gravity_efforts(scene.model, scene, logs)
    carried = [log.payload[log.kept] for log in logs]
    for j, own in enumerate(rows):
        G = at_rows(gravity, logs, j)
        yield j, own, G, own.load - at_rows(carried, logs, j) - G


class _Scale(NamedTuple):
    """A column's factor, reach of its 95 % interval, and share that it makes of the effort.

    `products`: (blocks, 2) of the column with the effort and with itself.
    """

    value: float
    reach: float
    share: float
    products: FloatArray


def _scale(rows: Rows, column: FloatArray, others: FloatArray) -> _Scale | None:
    """Return the factor of a column (n,) beside others (n, m) and an offset; None: too few rows."""
    if rows.effort.size < _FEWEST or np.unique(rows.block).size <= _FEWEST_BLOCKS:
        return None
    basis = orthonormal(np.column_stack((others, np.ones(column.size))))
    y, g = beside(basis, np.column_stack((rows.effort, column))).T
    size = float(g @ g)
    if size <= 1e-18 * float(column @ column):
        return None
    columns = [np.bincount(rows.block, g * x) for x in (y, g)]
    products = np.column_stack(columns).astype(np.float64)
    value, reach = _factor(products)
    whole = max(float(rows.effort @ rows.effort), 1e-12)
    return _Scale(value, reach, max(1.0, abs(value)) * float(np.sqrt(size / whole)), products)


def _factor(products: FloatArray) -> tuple[float, float]:
    """Return a column's factor and the reach of its 95 % interval; `products`: see `_Scale`."""
    from scipy.special import stdtrit

    with_effort, size = products.sum(axis=0)
    value, count = float(with_effort / size), int((products[:, 1] > 0.0).sum())
    scores = float(np.linalg.norm(products[:, 0] - value * products[:, 1]))
    return value, scores / float(size) * float(stdtrit(count - 1, 0.975))


def gravity_efforts(model: pin.Model, scene: Scene, logs: Sequence[Prepared]) -> list[FloatArray]:
    """Return of each log the drives' efforts (n, nj) that hold a model, perhaps not the scene's."""
    data, P, parts = model.createData(), delivery(scene.drives, model.nv), []
    for prepared in logs:
        q = prepared.recording.trajectory.q[prepared.kept]
        gravity = np.array([pin.computeGeneralizedGravity(model, data, x) for x in q])
        gravity = gravity.reshape(len(q), -1)
        parts.append(gravity @ P.T if P.size else gravity)
    return parts


def holds_no_gravity(scales: Mapping[int, tuple[float, float]]) -> bool:
    """Return whether efforts hold no gravity, at all joints that can tell."""
    return bool(scales) and all(abs(s) + reach < _NO_GRAVITY for s, reach in scales.values())


def check_gravity(
    scene: Scene,
    scales: Mapping[int, tuple[float, float]],
    logs: str,
    confirmed: Collection[str],
) -> None:
    """Refuse efforts with another gravity than that of the kept masses.

    Joints whose unit a person has `confirmed` pass. `logs`: their names, for messages.

    Raises:
        IdentificationError: by joint, all in one message.
    """
    problems = []
    for j, (scale, reach) in scales.items():
        name = scene.joint_names[j]
        if abs(scale - 1.0) > OTHER_GRAVITY + reach and name not in confirmed:
            problems.append(
                f"joint {name}: its effort holds {scale:.3g} +- {reach:.2g} times the gravity of "
                "the URDF's masses, which --inertia keep holds fixed: are its unit, gear ratio, or "
                "the masses wrong, is the base tilted, or is it balanced by a spring? Give the "
                f"factor to N m by --gain {name}=FACTOR ({name}=1 if it is in N m), or let masses "
                "be corrected: --inertia consistent"
            )
    if problems:
        raise IdentificationError(problems_line(logs, problems))


def check_limits(
    scene: Scene, rows: Sequence[Rows], fit: Fit, names: str, confirmed: Collection[str]
) -> None:
    """Refuse efforts and friction beyond the URDF's limits of effort, but of `confirmed` joints.

    Raises:
        IdentificationError: by joint, all in one message.
    """
    problems, limits = [], np.asarray(scene.model.effortLimit, dtype=np.float64)
    for j, (joint, own) in enumerate(zip(scene.joint_names, rows, strict=True)):
        if joint in confirmed or own.effort.size < _FEWEST or not 0.0 < limits[j] < _NO_LIMIT:
            continue
        most = float(np.quantile(np.abs(own.effort), 0.99))
        dry = 0.5 * float(fit.slots[j, COULOMB].sum())
        what = (
            f"efforts reach {most:.3g}"
            if most > _OVER_LIMIT * limits[j]
            else f"Coulomb friction would be {dry:.3g}"
            if dry > _MOST_FRICTION * limits[j]
            else ""
        )
        if what:
            problems.append(
                f"joint {joint}: its {what}, but the URDF limits it to {limits[j]:g} N m (N): is "
                f"the effort in N mm, or in A? Give the factor to N m by --gain {joint}=FACTOR "
                f"({joint}=1 if it is in N m, and the URDF's limit is wrong)"
            )
    if problems:
        raise IdentificationError(problems_line(names, problems))


def _carries(rows: Sequence[Rows], theta: FloatArray, factors: Mapping[int, float]) -> bool:
    """Whether a payload at the last link explains all efforts better than factors on some do.

    effort = Y theta + Y_last (m, m c)    or    effort = factor Y theta
    """
    by_factors, offs, lasts = 0.0, [], []
    for j, own in enumerate(rows):
        if own.effort.size < _FEWEST:
            continue
        y, load, last = _beside_friction(own, own.effort, own.rigid @ theta, own.rigid[:, -10:-6])
        scale = 1.0 / max(float(np.linalg.norm(y)), 1e-300)
        by_factors += float(np.sum((scale * (y - factors.get(j, 1.0) * load)) ** 2))
        offs.append(scale * (y - load))
        lasts.append(scale * last)
    off, payload_columns = np.concatenate(offs), np.concatenate(lasts)
    payload = np.linalg.lstsq(payload_columns, off, rcond=1e-9)[0]
    return bool(payload[0] > 0.0 and np.sum((off - payload_columns @ payload) ** 2) < by_factors)


def _beside_friction(rows: Rows, *given: FloatArray) -> Iterator[FloatArray]:
    """Yield columns less what friction, a rotor and an offset can make of them."""
    others = np.column_stack((rows.slots[:, _OWN], np.ones(rows.effort.size)))
    others = others / np.maximum(np.abs(others).max(axis=0), 1e-12)
    basis = np.linalg.qr(others)[0]
    for x in given:
        yield beside(basis, x.reshape(len(x), -1)).reshape(x.shape)


def _turned(rows: Rows, theta: FloatArray) -> bool:
    """Whether masses, friction and a rotor explain the negative effort only.

    +-effort = A x,    x >= 0: factors on the rigid effort, friction and acceleration
    """
    from scipy.optimize import nnls

    columns = np.column_stack((rows.rigid @ theta, rows.slots[:, _OWN]))
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    as_logged, turned = (
        nnls(columns, y)[1] / max(float(np.linalg.norm(y)), 1e-300)
        for y in (rows.effort, -rows.effort)
    )
    return bool(turned**2 < 1.0 - _CORRELATION**2 < as_logged**2)


def _slope(rows: Rows, prior: Prior) -> tuple[float, float]:
    """Slope and correlation of effort on rigid effort beside friction, inertia and offset.

    1 and 0 where loads make little of the effort, and usual errors of a URDF may explain the slope.
    """
    theta = prior.center
    load = rows.rigid @ theta
    y, t, uncertain = _beside_friction(rows, rows.effort, load, rows.rigid * prior.deviation)
    size, whole = float(t @ t), float(rows.effort @ rows.effort)
    if size <= 1e-18 * float(load @ load):
        return 1.0, 0.0
    slope = float(y @ t) / size
    explained = abs(slope - 1.0) < _DEVIATIONS * float(np.linalg.norm(uncertain)) / np.sqrt(size)
    if size < _LEAST_LOAD**2 * whole and (explained or slope**2 * size < _LEAST_LOAD**2 * whole):
        return 1.0, 0.0
    return slope, float(y @ t) / np.sqrt(size * max(float(y @ y), 1e-300))


def check_one_robot(
    joints: Sequence[str],
    rows: Sequence[Rows],
    fits: Sequence[Fit],
    logs: Sequence[str],
    stated: Collection[int] = (),
) -> None:
    """Refuse logs whose rigid efforts cannot be from one robot.

    Their factors on the rigid effort differ, and the common fit predicts one of them much worse
    than its own fit does: what no law describes shows in both.

    Args:
        fits: of all logs, and then of each log alone.
        stated: numbers of logs whose payload a person has stated; no two of these are compared.

    Raises:
        IdentificationError: names joint and logs.
    """
    whole, *own_fits = fits
    for j, own in enumerate(rows):
        load = own.rigid @ whole.theta
        if load @ load < _LEAST_LOAD * float(own.effort @ own.effort):
            continue
        off, slopes, strange = residuals(own, whole, j), {}, False
        for log, fit in enumerate(own_fits):
            in_log = own.log == log
            size = float(load[in_log] @ load[in_log])
            if size > 0.0:
                slopes[log] = 1.0 + float(load[in_log] @ off[in_log]) / size
                ours, alone = (float(x[in_log] @ x[in_log]) for x in (off, residuals(own, fit, j)))
                most = _UNLIKE**2 * float(own.effort[in_log] @ own.effort[in_log])
                strange |= ours > max(most, _OWN_ERROR**2 * alone)
        if not strange:
            continue
        low, high = min(slopes, key=slopes.__getitem__), max(slopes, key=slopes.__getitem__)
        if slopes[high] - slopes[low] > _ONE_ROBOT and not {low, high} <= set(stated):
            raise IdentificationError(
                f"joint {joints[j]}: its effort is {slopes[high]:.2f} times the rigid effort in "
                f"{logs[high]}, and {slopes[low]:.2f} times in {logs[low]}: logs of two robots, or "
                "with a payload; say what each carries: --payload LOG=NAME, or LOG=none"
            )
