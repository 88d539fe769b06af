"""Closing loops: configurations, velocities and accelerations that satisfy the loops' equations.

    Phi(q) = 0,     J_c v = 0,     J_c a + Jdot_c v = 0          (paper eq. 2, 5, 6)

Phi are the gaps along the multipliers. Full pivoting of J_c, the paper's rank-revealing choice,
determines which joints are independent.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.errors import ClosureError, SceneError, choose_from
from pinfric.model.kinematics import (
    Actions,
    act_on_joints,
    move_links,
    place_links,
    relate_pairs,
)
from pinfric.model.loops import Linkage, loop_place
from pinfric.model.twin import Twin, embed

#: A gap below this many times the mechanism's size counts as closed: the accuracy that Newton's
#: method must reach, and the error that a given configuration may have (files print few digits).
CLOSED, NEARLY_CLOSED = 1e-10, 1e-6
#: Pivots below this many times the largest one are zero: the rows depend on each other.
RANK = 1e-9
_PASSES = 100


@dataclass(frozen=True)
class LoopState:
    """How the pairs of a linkage relate in n samples (`kinematics.relate_pairs`).

    Attributes:
        gap, rate, rate_derivative: (n, nx) along every action.
        tilt: (n, np) rad. scale: (n, np, 2).
        p, R: (n, nj, 3), (n, nj, 3, 3) of the links.
    """

    gap: np.ndarray
    rate: np.ndarray
    rate_derivative: np.ndarray
    tilt: np.ndarray
    scale: np.ndarray
    p: np.ndarray
    R: np.ndarray


def tree_tables(twin: Twin) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return parents' rows and fixed placements of all joints, as `place_links` takes them."""
    if "tree" not in twin.pools:
        model = twin.model
        joints = range(1, model.njoints)
        twin.pools["tree"] = (
            np.array([model.parents[j] - 1 for j in joints], dtype=np.int64),
            np.array([model.jointPlacements[j].translation for j in joints]).reshape(-1, 3),
            np.array([model.jointPlacements[j].rotation for j in joints]).reshape(-1, 3, 3),
        )
    tables: tuple[np.ndarray, np.ndarray, np.ndarray] = twin.pools["tree"]
    return tables


def embedded(twin: Twin, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the twin's states (n, 7 nj), (n, 6 nj), (n, 6 nj) of a batch."""
    n, nj = len(q), twin.n_joints
    out = np.empty((n, 7 * nj)), np.empty((n, 6 * nj)), np.empty((n, 6 * nj))
    embed(q, v, a, twin.embedding, *out)
    return out


def actions_of(twin: Twin, linkage: Linkage) -> Actions:
    """Return the tables that the kernels of loops read."""
    return Actions(
        *(getattr(linkage if name in vars(linkage) else twin, name) for name in Actions._fields)
    )


def loop_state(
    twin: Twin, linkage: Linkage, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> LoopState:
    """Return how pairs relate at q (n, nq) with v and a (n, nv)."""
    q_twin, v_twin, a_twin = embedded(twin, q, v, a)
    n, nj, (parents, *placement) = len(q), twin.n_joints, tree_tables(twin)
    p, R = np.empty((n, nj, 3)), np.empty((n, nj, 3, 3))
    velocity, acceleration = np.zeros((n, nj, 6)), np.zeros((n, nj, 6))
    place_links(q_twin, parents, *placement, p, R)
    if v_twin.any() or a_twin.any():
        move_links(v_twin, a_twin, parents, p, R, velocity, acceleration)
    return _related(twin, linkage, p, R, velocity, acceleration)


def _related(
    twin: Twin, linkage: Linkage, p: np.ndarray, R: np.ndarray, *rates: np.ndarray
) -> LoopState:
    """How pairs relate for these poses, velocities and accelerations of the links."""
    n, nx, pairs = len(p), len(linkage.column_pair), len(linkage.pair_kind)
    gap, rate, derivative = (np.empty((n, nx)) for _ in range(3))
    tilt, scale = np.empty((n, pairs)), np.empty((n, pairs, 2))
    actions = actions_of(twin, linkage)
    relate_pairs(p, R, *rates, actions, gap, rate, derivative, tilt, scale)
    return LoopState(gap, rate, derivative, tilt, scale, p, R)


def action_maps(
    twin: Twin, linkage: Linkage, p: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return X (n, nj + pairs, 6, nx) and J (n, nx, nv) of a batch (`kinematics.act_on_joints`)."""
    n, nx = len(p), len(linkage.column_pair)
    X = np.empty((n, twin.n_joints + len(linkage.pair_kind), 6, nx))
    J = np.empty((n, nx, twin.nv))
    act_on_joints(p, R, actions_of(twin, linkage), X, J)
    return X, J


def closure_jacobian(twin: Twin, linkage: Linkage, q: np.ndarray) -> np.ndarray:
    """Return J_c (n, nc, nv), the rate of the gaps along the multipliers per unit velocity."""
    zero = np.zeros((len(q), twin.nv))
    state = loop_state(twin, linkage, q, zero, zero)
    return action_maps(twin, linkage, state.p, state.R)[1][:, linkage.lambdas]


def close(
    twin: Twin, linkage: Linkage, q_guess: np.ndarray, held: np.ndarray, sample: int = 0
) -> np.ndarray:
    """Return the configuration (nq,) near a guess that closes every loop: Newton on Phi(q) = 0.

    Joints that are fixed in the linkage (`loops.stand_still`), or whose velocities are `held`
    (nv,), keep their positions.

    Raises:
        ClosureError: no step brings the frames nearer, and they are still apart; names `sample`.
    """
    q, gap = approach(twin, linkage, q_guess, held)
    if not is_closed(linkage, gap):
        worst = linkage.name_of_row(int(np.argmax(np.abs(gap))))
        raise ClosureError(worst, sample, float(np.linalg.norm(gap)))
    return q


def is_closed(linkage: Linkage, gap: np.ndarray) -> bool:
    """Return whether what `approach` leaves (nc,) is closed."""
    return bool(np.abs(gap).max(initial=0.0) <= CLOSED * linkage.size)


def approach(
    twin: Twin, linkage: Linkage, q_guess: np.ndarray, held: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return where Newton's method ends and the gaps (nc,) left there, see `close`.

    The gaps are in m: rotations times the mechanism's size.
    """
    q = pin.normalize(twin.model, np.array(q_guess, dtype=float))
    free = np.flatnonzero(~held)
    gap, J = _gap(twin, linkage, q)
    for _ in range(_PASSES):
        size = float(np.linalg.norm(gap))
        if size <= 1e-14 * linkage.size or not free.size:
            break
        step = np.zeros(twin.nv)
        step[free] = -np.linalg.lstsq(J[:, free], gap, rcond=RANK)[0]
        step *= min(1.0, 0.7 / max(float(np.abs(step).max()), 1e-300))
        for _ in range(12):
            trial = pin.integrate(twin.model, q, step)
            trial_gap, trial_J = _gap(twin, linkage, trial)
            if np.linalg.norm(trial_gap) < size:
                break
            step *= 0.5
        else:
            break
        q, gap, J = trial, trial_gap, trial_J
    return q, gap


def _gap(twin: Twin, linkage: Linkage, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(nc,) gaps, rotations times the mechanism's size, and their Jacobian (nc, nv).

    For one configuration Pinocchio's poses are faster than the batch kernels.
    """
    data, *placed = twin.poses()
    pin.forwardKinematics(twin.model, data, q)
    p, R = (np.array([of_links]) for of_links in placed)
    still = np.zeros((1, twin.n_joints, 6))
    state = _related(twin, linkage, p, R, still, still)
    _, J = action_maps(twin, linkage, p, R)
    rows = linkage.closed
    length = np.where(linkage.turning, linkage.size, 1.0)
    return length * (state.gap[0, rows] - linkage.rest_gap[rows]), length[:, None] * J[0, rows]


def full_pivot(A: np.ndarray, scale: float = 0.0) -> tuple[int, list[int]]:
    """Return the rank of A (m, n) and its columns in the order of full pivoting.

    The first `rank` columns are the dependent coordinates (paper eq. 5). What is small beside
    `scale`, the size of the terms that A's entries are sums of, counts as zero.
    """
    A = np.array(A, dtype=float)
    columns = list(range(A.shape[1]))
    largest = max(float(np.abs(A).max(initial=0.0)), scale)
    for k in range(min(A.shape)):
        remaining = np.abs(A[k:, k:])
        i, j = divmod(int(np.argmax(remaining)), remaining.shape[1])
        if not remaining[i, j] > RANK * largest:
            return k, columns
        A[[k, k + i]] = A[[k + i, k]]
        A[:, [k, k + j]] = A[:, [k + j, k]]
        columns[k], columns[k + j] = columns[k + j], columns[k]
        A[k + 1 :] -= np.outer(A[k + 1 :, k] / A[k, k], A[k])
    return min(A.shape), columns


def driving_joints(twin: Twin, linkage: Linkage, q: np.ndarray) -> tuple[str, ...]:
    """Return independent joints at q, each as near to the root as can be: where drives stand.

    A joint is taken if the loops still determine all joints that are not.

    Args:
        twin, linkage: with loops.
        q: (nq,) closed.
    """
    J = closure_jacobian(twin, linkage, np.array(q, dtype=float)[None])[0]
    size = min(1.0, linkage.size)
    rank = full_pivot(J, size)[0]
    left = list(range(J.shape[1]))
    for column in range(J.shape[1]):
        others = [v for v in left if v != column]
        if full_pivot(J[:, others], size)[0] == rank:
            left = others
    names = velocity_names(twin.model)
    return tuple(name for v, name in enumerate(names) if v not in left)


def velocity_names(model: pin.Model) -> list[str]:
    """Return a name for every velocity: its joint's, with an index if the joint has several."""
    names = []
    for name, joint in zip(tuple(model.names)[1:], list(model.joints)[1:], strict=True):
        if joint.nv and joint.shortname() != "JointModelMimic":
            names += [name] if joint.nv == 1 else [f"{name}[{i}]" for i in range(joint.nv)]
    return names


def velocity_indices(model: pin.Model, joints: Sequence[str], where: str) -> np.ndarray:
    """Return the indices of the named joints' velocities, ascending.

    Raises:
        SceneError: an unknown name.
    """
    indices: list[int] = []
    for name in joints:
        known = tuple(model.names)[1:]
        if name not in known:
            raise SceneError(f"{where}: there is no joint {name!r}; {choose_from(name, known)}")
        joint = model.joints[model.getJointId(name)]
        indices += range(joint.idx_v, joint.idx_v + joint.nv)
    return np.array(sorted(set(indices)), dtype=np.int64)


def closed_configurations(
    twin: Twin,
    linkage: Linkage,
    start: np.ndarray,
    source: str,
    doubts: Mapping[str, str],
    wanted: int = 3,
) -> list[np.ndarray]:
    """Return several closed configurations, because one alone may be singular.

    The search begins at `start` (nq,); `source` and `doubts` as in `mobility.mobility_of_linkage`.

    Raises:
        SceneError: a loop that cannot close.
    """
    held = np.zeros(twin.nv, dtype=bool)
    closed: list[np.ndarray] = []
    least = np.full(linkage.multipliers, np.inf)
    for guess in guesses(twin.model, start):
        q, gap = approach(twin, linkage, guess, held)
        if is_closed(linkage, gap):
            closed.append(q)
        elif np.linalg.norm(gap) < np.linalg.norm(least):
            least = gap
        if len(closed) == wanted:
            return closed
    if closed:
        return closed
    loop = linkage.name_of_row(int(np.argmax(np.abs(least))))
    turning = linkage.turning
    way, angle = np.linalg.norm(least[~turning]), np.linalg.norm(least[turning]) / linkage.size
    place = loop_place(linkage.loops, loop)
    raise SceneError(
        f"{source}: {place}: cannot close: in 30 searches its frames stay "
        f"at least {way:.3g} m{f' and {angle:.3g} rad' if turning.any() else ''} apart; check "
        "`xyz` and `rpy` of its sides, or loop_tolerance if they are rounded"
        + (f"; {doubts[loop]}" if loop in doubts else "")
    )


def guesses(model: pin.Model, start: np.ndarray) -> Iterator[np.ndarray]:
    """Yield 30 configurations: the start, some near it, and some anywhere."""
    rng = np.random.default_rng(0)
    for attempt in range(30):
        reach = 0.0 if attempt == 0 else 0.3 if attempt < 8 else 2.0
        yield pin.integrate(model, start, rng.normal(scale=reach, size=model.nv))
