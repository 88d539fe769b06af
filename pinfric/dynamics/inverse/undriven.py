"""Inverse dynamics of scenes with redundant drives, or with joints without a drive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinfric.dynamics.samples.states import States
from pinfric.errors import SceneError, UndrivenMotionError
from pinfric.model.closure import velocity_names
from pinfric.model.floating import stands
from pinfric.model.scene import Scene
from pinfric.model.twin import PRISMATIC

#: A sum below this fraction of its terms counts as zero, because angles have six digits.
_OBEYS = 1e-5


def check_shares(scene: Scene) -> None:
    """Refuse redundant drives without shares of the work.

    Raises:
        SceneError: redundant drives without `share`.
    """
    mobility, drives = scene.mobility, scene.drives
    if all(drives[d].share for d in mobility.redundant):
        return
    names = ", ".join(drives[d].name for d in mobility.redundant)
    count = len(mobility.redundant) - len(drives) + mobility.freedoms - len(mobility.undriven)
    raise SceneError(
        f"{scene.source}: actuators: {mobility.counts(len(drives))}: the motion does not determine "
        f"how they share the work; give each of them a `share`, or keep only {count} of {names}"
    )


def check_undriven(
    scene: Scene,
    states: States,
    whole: slice,
    lower: np.ndarray,
    upper: np.ndarray,
    left: Sequence[int] = (),
) -> None:
    """Refuse a motion that needs an effort where no drive is.

    Args:
        scene: with its undriven velocities.
        states: of all samples. whole: the T samples that were solved.
        lower, upper: (T, number undriven) least and greatest effort there, over all frictions; NaN
            where there is no solution.
        left: velocities at which the rest is reported (`balance.base_rows`).

    Raises:
        UndrivenMotionError: 0 is not between them, beyond rounding.
    """
    judged = [k for k, v in enumerate(scene.mobility.undriven) if v not in left]
    undriven = [scene.mobility.undriven[k] for k in judged]
    if not undriven or not len(lower):
        return
    lower, upper = lower[:, judged], upper[:, judged]
    missing, weights = (
        np.nan_to_num(np.fmax(np.fmax(lower, -upper), 0.0)),
        _weights(scene)[undriven],
    )
    if (missing <= negligible_efforts(scene)[judged]).all():
        return  # without the terms of the motion, which take longer
    size = np.maximum(_terms(scene, states.part(whole)), weights)
    sample, place = np.unravel_index(np.argmax(missing / np.maximum(size, 1e-300)), missing.shape)
    needed = (missing > _OBEYS * size).any(axis=0)
    if needed[place]:
        names = [velocity_names(scene.model)[v] for v in undriven]
        raise UndrivenMotionError(
            names[place],
            whole.start + int(sample),
            float(missing[sample, place]),
            scene.mobility.counts(len(scene.drives)),
            [name for k, name in enumerate(names) if needed[k] and k != place],
            stands(scene) and undriven[place] < 6,
        )


def negligible_efforts(scene: Scene) -> np.ndarray:
    """Return the efforts (number undriven,) that count as zero beside weights (N m or N)."""
    return np.asarray(_OBEYS * _weights(scene)[list(scene.mobility.undriven)])


def _terms(scene: Scene, states: States) -> float:
    """The largest |h| + |M a| of a motion (N m or N)."""
    pool = scene.twin().plain_pool(1)
    bias, whole = np.empty_like(states.v), np.empty_like(states.v)
    pin.rneaInParallel(1, pool, states.q.T, states.v.T, np.zeros_like(states.a).T, bias.T)
    pin.rneaInParallel(1, pool, states.q.T, states.v.T, states.a.T, whole.T)
    return float((np.abs(bias) + np.abs(whole - bias)).max(initial=0.0))


def _weights(scene: Scene) -> np.ndarray:
    """(nv,) greatest effort due to the weight that a joint carries (N m or N), kept."""
    pools, model = scene.twin().pools, scene.model
    if "weights" in pools:
        return np.asarray(pools["weights"])
    pools["weights"] = out = np.zeros(model.nv)
    data, g = model.createData(), float(np.linalg.norm(model.gravity.linear))
    pin.crba(model, data, pin.neutral(model))
    for kind, joint, carried in zip(
        scene.twin().kind, list(model.joints)[1:], list(data.Ycrb)[1:], strict=True
    ):
        lever = 1.0 if kind == PRISMATIC else float(np.linalg.norm(carried.lever))
        out[joint.idx_v : joint.idx_v + joint.nv] = carried.mass * g * lever
    return out


def narrow_friction(scene: Scene, effort: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    """Narrow friction of undriven joints of an open chain to equilibrium.

    sum of ratio phi over a joint's sites = effort: each has what the others leave.

    Args:
        scene: an open chain.
        effort: (T, nv) without friction.
        lower, upper: (T, ns), overwritten.
    """
    sites = scene.site_tables
    for v in scene.mobility.undriven:
        on = np.flatnonzero(sites.velocity_index == v)
        if not on.size:
            continue
        ends = np.sort([sites.ratio[on] * lower[:, on], sites.ratio[on] * upper[:, on]], axis=0)
        least, most = ends.sum(axis=2, keepdims=True)
        needed = effort[:, v, None]
        narrowed = np.clip([needed - (most - ends[1]), needed - (least - ends[0])], *ends)
        narrowed = np.sort(narrowed / sites.ratio[on], axis=0)
        lower[:, on], upper[:, on] = narrowed
