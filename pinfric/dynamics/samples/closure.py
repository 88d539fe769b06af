"""Motions of scenes with loops: checks, and solution from independent joints.

    Phi(q) = 0,   J_c v = 0,   J_c a + Jdot_c v = 0;      v = [v_d; v_i],  v_d = -J_d^-1 J_i v_i

(paper eq. 2, 5, 6). The independent joints are the user's, or the paper's choice by full pivoting.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from pinfric.errors import ClosureError, LoopMotionError, SceneError, StateError
from pinfric.model.arrays import real_numbers
from pinfric.model.closure import (
    NEARLY_CLOSED,
    RANK,
    LoopState,
    action_maps,
    approach,
    close,
    closure_jacobian,
    full_pivot,
    guesses,
    is_closed,
    loop_state,
    velocity_indices,
    velocity_names,
)
from pinfric.model.couples import drive_rates
from pinfric.model.loops import CYLINDER, Linkage
from pinfric.model.scene import Scene, expect_scene

#: Velocities and accelerations may violate a loop by this fraction of the terms that cancel.
_MOTION = 1e-6
#: Samples per batch.
_BATCH = 512


def check_pairs(
    linkage: Linkage, state: LoopState, here: slice, checked: slice, slack: float = 1.0
) -> None:
    """Refuse motions that loops or cylinders prevent.

    Args:
        linkage: with the pairs. state: of the samples `here`.
        checked: the samples of them that are checked.
        slack: factor on the tolerances.

    Raises:
        LoopMotionError: a loop is open, or its velocities or accelerations violate it.
        StateError: the ends of a cylinder coincide.
    """
    samples = np.arange(here.start, here.stop)
    inside = np.logical_and(samples >= checked.start, samples < checked.stop)
    for drive in linkage.drives:
        if linkage.pair_kind[linkage.column_pair[drive.column]] == CYLINDER:
            short = (state.gap[:, drive.column] <= 1e-9 * linkage.size) & inside
            if short.any():
                sample = here.start + int(np.argmax(short))
                raise StateError(
                    f"cylinder {drive.name!r}: its ends coincide at sample {sample}: "
                    "it has no direction there"
                )
    for row, loop in enumerate(linkage.loops):
        tilted = np.logical_and(state.tilt[:, row] > slack * NEARLY_CLOSED, inside)
        if loop.kind == "planar_pin" and tilted.any():
            sample = int(np.argmax(tilted))
            raise StateError(
                f"loop {loop.name!r}: the axes of its sides differ by "
                f"{state.tilt[sample, row]:.3g} "
                f"rad at sample {here.start + sample}: a planar_pin closes planar mechanisms; take "
                "spherical or revolute"
            )
    rows, pairs = linkage.lambdas, linkage.column_pair[linkage.lambdas]
    turning = linkage.turning
    allowed = slack * np.where(turning, NEARLY_CLOSED, NEARLY_CLOSED * linkage.size)
    figures = (
        ("is open", np.abs(state.gap[:, rows]), allowed, ("m", "rad")),
        (
            "is violated by the velocities",
            np.abs(state.rate[:, rows]),
            slack * _MOTION * state.scale[:, pairs, 0] + 1e-12,
            ("m/s", "rad/s"),
        ),
        (
            "is violated by the accelerations",
            np.abs(state.rate_derivative[:, rows]),
            _MOTION * state.scale[:, pairs, 1] + 1e-9,
            ("m/s^2", "rad/s^2"),
        ),
    )
    for what, amount, most, units in figures:
        beyond = np.logical_and(amount > most, inside[:, None])
        if beyond.any():
            sample = int(np.argmax(np.any(beyond, axis=1)))
            row = int(np.argmax(np.where(beyond, amount, -1.0)[sample]))
            raise LoopMotionError(
                linkage.name_of_row(row),
                here.start + sample,
                what,
                float(amount[sample, row]),
                units[int(turning[row])],
            )


def working_rates(scene: Scene, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocities with which efforts and friction do work (rad/s or m/s).

    Args:
        scene: with or without loops. q, v: (T, nq), (T, nv).

    Returns:
        (T, na) of each drive, a cylinder's lengthening; (T, ns) of each site, a ball's speed.
    """
    tables = scene.site_tables
    sites = v[:, tables.velocity_index] * tables.ratio
    if scene.linkage is None:
        return drive_rates(scene.drives, v, v[:, :0]), sites
    linkage = scene.linkage
    rate = loop_state(scene.twin(), linkage, q, v, np.zeros_like(v)).rate
    drives = drive_rates(scene.drives, v, rate)
    for s, site in enumerate(scene.sites):
        if site.pair >= 0:
            first = linkage.friction_column[site.pair]
            parts = rate[:, first : first + (3 if site.ball else 1)]
            sites[:, s] = np.linalg.norm(parts, axis=1) if site.ball else parts[:, 0]
    return drives, sites


def check_closed(scene: Scene, q: np.ndarray, v: np.ndarray, slack: float = 1.0) -> None:
    """Refuse a state (nq,), (nv,) that the loops do not allow; see `check_pairs`."""
    assert scene.linkage is not None
    state = loop_state(scene.twin(), scene.linkage, q[None], v[None], np.zeros((1, len(v))))
    state.rate_derivative[:] = 0.0  # accelerations are not given
    check_pairs(scene.linkage, state, slice(0, 1), slice(0, 1), slack)


def independent_joints(scene: Scene, q: np.ndarray) -> tuple[str, ...]:
    """Return joints whose velocities are independent at q, by full pivoting (paper eq. 5).

    Args:
        scene: with loops.
        q: (nq,) closed.
    """
    assert scene.linkage is not None
    J = closure_jacobian(scene.twin(), scene.linkage, np.array(q, dtype=float)[None])[0]
    rank, order = full_pivot(J, min(1.0, scene.linkage.size))
    names = velocity_names(scene.model)
    return tuple(names[v] for v in sorted(order[rank:]))


def consistent_motion(
    scene: Scene,
    q: np.ndarray,
    independent: Sequence[str],
    rates: np.ndarray,
    accelerations: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities and accelerations of all joints from those of the independent ones.

    v_d = -J_d^-1 J_i v_i,  a_d = -J_d^-1 (J_i a_i + Jdot_c v)      (paper eq. 6)

    Args:
        scene: with loops.
        q: (T, nq) closed.
        independent: names of ni joints.
        rates, accelerations: (T, ni) rad/s or m/s, and per second, in the order of the names.

    Returns:
        v, a: (T, nv).

    Raises:
        SceneError: an unknown name. StateError: not real numbers.
        ClosureError: the joints do not determine the motion, or contradict a loop (with sample).
    """
    expect_scene(scene, "consistent_motion")
    linkage, twin = scene.linkage, scene.twin()
    assert linkage is not None
    chosen = _in_order(scene, independent)
    q = np.atleast_2d(real_numbers("q", q))
    rates = real_numbers("rates", rates)
    accelerations = real_numbers("accelerations", accelerations)
    v, a = np.zeros((len(q), twin.nv)), np.zeros((len(q), twin.nv))
    v[:, chosen], a[:, chosen] = rates, accelerations
    dependent = np.setdiff1d(np.arange(twin.nv), chosen)
    for start in range(0, len(q), _BATCH):
        batch = slice(start, start + _BATCH)
        zero = np.zeros_like(v[batch])
        state = loop_state(twin, linkage, q[batch], zero, zero)
        J = action_maps(twin, linkage, state.p, state.R)[1][:, linkage.lambdas]
        inverse = _inverse(J[:, :, dependent], start, linkage)
        v[batch, dependent] = -_times(inverse, _times(J[:, :, chosen], v[batch][:, chosen]))
        moving = loop_state(twin, linkage, q[batch], v[batch], a[batch])
        a[batch, dependent] -= _times(inverse, moving.rate_derivative[:, linkage.lambdas])
    return v, a


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("tij,tj->ti", matrices, vectors)


def _inverse(J: np.ndarray, first: int, linkage: Linkage) -> np.ndarray:
    """(n, nd, nc) inverse of the dependent columns on the range they have; their rank is full."""
    left, size, right = np.linalg.svd(J, full_matrices=False)
    least = RANK * np.maximum(size[:, 0], min(1.0, linkage.size)) if size.size else np.zeros(0)
    lost = J.shape[2] > size.shape[1] or size[:, -1] <= least
    if np.any(lost):
        sample = first + (0 if lost is True else int(np.argmax(lost)))
        raise ClosureError(
            linkage.loops[0].name,
            sample,
            0.0,
            "the independent joints do not determine how the others move there (a toggle, or too "
            "few of them)",
        )
    return np.einsum("tki,tk,tjk->tij", right, 1.0 / size, left)


def _in_order(scene: Scene, joints: Sequence[str]) -> list[int]:
    """The velocity index of each joint named; each has one."""
    where = f"{scene.source}: independent joints"
    indices = []
    for name in joints:
        index = velocity_indices(scene.model, [name], where)
        if len(index) != 1:
            raise SceneError(f"{where}: {name!r} has {len(index)} degrees of freedom; name others")
        indices.append(int(index[0]))
    return indices


def first_closed(
    scene: Scene, q_guess: np.ndarray, independent: Sequence[str], q: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Return a closed configuration (nq,) with independent joints as in q; whether it was searched.

    The nearest one to the guess, if loops close from there; else the first that closes from one of
    30 places around it, of an assembly that nobody chose. A mechanism whose bars lie in a line at
    its guess needs the search: its Jacobian is singular there.

    Args:
        scene, independent: as of `complete_configurations`. q_guess: (nq,). q: (nq,).

    Raises:
        ClosureError: none closes; gives the remaining distance from the guess.
    """
    linkage, twin = scene.linkage, scene.twin()
    assert linkage is not None
    held, entries = _held(scene, independent)
    worst, apart = 0, 0.0
    for attempt, guess in enumerate(guesses(scene.model, q_guess)):
        guess[entries] = q[entries]
        near, gap = approach(twin, linkage, guess, held)
        if is_closed(linkage, gap):
            return near, attempt > 0
        if attempt == 0:
            worst, apart = int(np.argmax(np.abs(gap))), float(np.linalg.norm(gap))
    index = [scene.model.joints[scene.model.getJointId(name)].idx_q for name in independent]
    places = ", ".join(f"{n} = {q[at]:.4g}" for n, at in zip(independent, index, strict=True))
    raise ClosureError(
        linkage.name_of_row(worst),
        0,
        apart,
        f"cannot close in 30 searches (frames {apart:.3g} m apart): these links do not reach "
        f"{places}, or positions are in another unit (`unit: deg`)",
    )


def _held(scene: Scene, independent: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return (nv,) and (nq,) bool, velocities and positions of the named joints."""
    held = np.zeros(scene.model.nv, dtype=bool)
    held[_in_order(scene, independent)] = True
    entries = np.zeros(scene.model.nq, dtype=bool)
    for name in independent:
        joint = scene.model.joints[scene.model.getJointId(name)]
        entries[joint.idx_q : joint.idx_q + joint.nq] = True
    return held, entries


def complete_configurations(
    scene: Scene, q_guess: np.ndarray, independent: Sequence[str], q: np.ndarray
) -> np.ndarray:
    """Return closed configurations (T, nq) in which the independent joints are as in q.

    Each starts from the one before, so a trajectory stays in one assembly.

    Args:
        scene: with loops.
        q_guess: (nq,) near the first one.
        independent: names of joints.
        q: (T, nq); only the entries of the independent joints count.

    Raises:
        ClosureError: a sample cannot close; gives the sample and the remaining distance.
    """
    linkage, twin, model = scene.linkage, scene.twin(), scene.model
    assert linkage is not None
    held, entries = _held(scene, independent)
    out = np.empty_like(q)
    guess, step = np.array(q_guess, dtype=float), np.zeros(twin.nv)
    for i in range(len(q)):
        start = guess if i == 0 else pin.integrate(model, guess, step)
        start[entries] = q[i, entries]
        out[i] = close(twin, linkage, start, held, i)
        step = pin.difference(model, guess, out[i]) if i > 0 else step
        guess = out[i].copy()
    return out
