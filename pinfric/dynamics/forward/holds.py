"""Does a robot at rest stay at rest? The question as users ask it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinfric.dynamics.forward.forward import drive_vector, one_of, vector
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.samples.closure import check_closed
from pinfric.dynamics.samples.reactions import AppliedWrench, applied_wrenches
from pinfric.errors import AccelerationError
from pinfric.friction.balance import RANK, Balance
from pinfric.friction.consistency import evaluate
from pinfric.friction.holding import Verdict, can_move, decide
from pinfric.model.scene import Scene, expect_scene

#: A joint that needs this share of what the most used one needs is at its limit with it.
_AT_LIMIT = 1.0 - 1e-6
#: An acceleration this small beside the terms it is the sum of is rounding.
_STILL = 1e-9


@dataclass(frozen=True)
class StaticHold:
    """Whether static friction keeps a robot at rest, and what it takes.

    Attributes:
        held: True, False, or None where neither could be shown.
        use: the share of its static limit that the most used joint needs; above 1 where nothing
            holds. It is the least found over all ways to share friction among the joints. Where
            friction can wedge itself, more friction may use a smaller share of its limits; then it
            is the least over frictions up to 50 times the limits.
        proved: whether `held` is proved: by the friction here where it is True, by branching where
            it is False. What friction might wedge beyond 50 times its limits is not proved.
        least: whether `use` is proved to be the least, to 1e-6, as self-locking gears hold here.
            It is not where a contact force lies in no plane, where balls rest, and where 200 nodes
            of the proof are not enough: there a smaller use may exist.
        at_limit: names of the joints with friction, or with a gear alone, that need that share:
            what breaks away first.
        moving: names of the joints without dry friction that accelerate although all that rubs
            sticks: they cannot rest.
        friction: (ns,) of the parent on the child, with that use (N m or N); NaN where no friction
            is in equilibrium.
        normal_load: (ns,) the loads that come with it.
    """

    held: bool | None
    use: float
    proved: bool
    least: bool
    at_limit: tuple[str, ...]
    moving: tuple[str, ...]
    friction: np.ndarray
    normal_load: np.ndarray


def holds(
    scene: Scene,
    q: np.ndarray,
    effort: np.ndarray | None = None,
    external: Mapping[str, np.ndarray] | None = None,
    *,
    motor_torque: np.ndarray | None = None,
    attached: Iterable[str] | None = None,
) -> StaticHold:
    """Say whether static friction holds a robot that stands still, and with what margin.

    Wanted is a friction in equilibrium with effort, gravity and loops, |x_k| <= limit_k(x) at every
    joint: use = min over all of them of max |x_k| / limit_k. Limits follow the loads, which follow
    friction, so this is decided by a search and, where it finds none, by a proof (`holding`). Each
    joint is measured in its own limit, so limits may be decades apart and units do not matter.

    Args:
        scene: the robot with its friction and drives.
        q: (nq,) rad, m; loops closed.
        effort: (na,) what the drives deliver at the joints (N m or N).
        external: frame name -> (6,) wrench on it, in its axes at its origin (N, N m).
        motor_torque: (na,) in place of `effort`, at the motors' shafts (N m); gears hold, too, and
            self-locking ones whatever the load.
        attached: names of the payloads carried; None takes those attached by default.

    Raises:
        SceneError: a motor's torque of a drive without transmission.
        StateError: neither or both of effort and motor_torque; a wrong shape, a value not finite,
            an open loop.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> pf.holds(scene, [0.0], [0.0]).held, pf.holds(scene, [1.57], [0.0]).held
    (True, False)
    """
    expect_scene(scene, "holds")
    given = one_of("holds", effort, motor_torque)
    ws = Workspace(scene, attached, motors=effort is None)
    q, v = vector("q", q, ws.nq, "nq"), np.zeros(ws.nv)
    u = drive_vector(ws, given)
    applied = applied_wrenches(scene, external, 1) if external else None
    if scene.loops and np.isfinite(q).all():
        check_closed(scene, q, v, slack=1e3)
    modes = ws.modes
    modes.stuck[:] = ws.plan.coordinates.dry
    ws.assemble(q, v, u, applied)
    found = _decide_all(ws, q, u, applied)
    modes.stuck[:], modes.direction[:] = ws.plan.coordinates.dry, 0.0
    modes.friction[:] = np.where(np.isfinite(found.friction), found.friction, 0.0)
    evaluate(ws.problem, modes.friction, modes.load, modes.rate)
    ws.finish()
    moving = _moving(ws) if found.held else ()
    friction = ws.phi.copy() if np.isfinite(found.friction).all() else np.full(ws.phi.size, np.nan)
    return StaticHold(
        held=False if moving else found.held,
        use=found.use,
        proved=found.proved or bool(moving),
        least=found.least,
        at_limit=_at_limit(ws, found.use),
        moving=moving,
        friction=friction,
        normal_load=ws.load.copy(),
    )


def _decide_all(
    ws: Workspace, q: np.ndarray, effort: np.ndarray, applied: list[AppliedWrench] | None
) -> Verdict:
    """The first verdict of a way in which self-locking gears hold, else that of the first way.

    That nothing holds is shown, and proved, where it is for every way.
    """
    verdicts, shown = [], True
    for every in ws.locking.ways_to_hold(ws.couple):
        verdicts.append(_decide(ws, q, effort, applied))
        if verdicts[-1].held:
            return verdicts[-1]
        shown = shown and every and verdicts[-1].held is False
    return replace(
        verdicts[0],
        held=False if shown else None,
        proved=shown and all(verdict.proved for verdict in verdicts),
    )


def _decide(
    ws: Workspace, q: np.ndarray, effort: np.ndarray, applied: list[AppliedWrench] | None
) -> Verdict:
    """The verdict on everything with dry friction at rest."""
    dry = ws.plan.coordinates.dry
    if not dry.any():
        return Verdict(True, 0.0, np.zeros(len(dry)), True, True)
    if not ws.mechanism.balls:
        resting = can_move(ws.mechanism.factor, dry)
        return decide(ws.problem, ws.mechanism.factor, dry, _statics(ws, resting), least=True)
    # a ball's limit is a sphere: what holds is found as forward dynamics finds it, not proved
    try:
        ws.solve(q, np.zeros(ws.nv), effort, applied)
    except AccelerationError:
        return Verdict(None, np.inf, np.full(len(dry), np.nan), False)
    held = bool(ws.modes.stuck[dry].all())
    limit = np.maximum(np.maximum(ws.most, -ws.least), 1e-300)
    size = np.sqrt(ws.mechanism.summed(ws.modes.friction**2))
    use = float((size / limit)[dry].max())
    friction = ws.modes.friction.copy()
    ws.assemble(q, np.zeros(ws.nv), effort, applied)
    return Verdict(True if held else None, use, friction, held)


def _statics(ws: Workspace, resting: np.ndarray) -> Balance:
    """What friction must balance where nothing moves, Z^T D^T x = Z^T (h - S u), Z all motions.

    The mass matrix has no part in it: through it the rounding of a large effort would reach a small
    limit. Where some freedoms Z B are not held at all, their inertia is part of it.
    """
    w, D = ws.machine.maps, ws.machine.kinematics.D[resting]
    d = int(w.freedoms[0])
    Z = w.Z[:, :d] if ws.closed else np.eye(ws.nv)
    rows, need, terms = Z.T @ D.T, -Z.T @ w.push, np.abs(Z.T) @ _terms(ws)
    size = np.linalg.norm(rows, axis=0)
    left, values, _ = np.linalg.svd(rows / size)
    rank = int((values > RANK * values[:1]).sum())
    if rank == d:
        return Balance(rows, need, terms)
    held, B = left[:, :rank].T, left[:, rank:]
    M = Z.T @ w.M @ Z
    need = need - M @ B @ np.linalg.solve(B.T @ M @ B, B.T @ need)
    return Balance(held @ rows, held @ need, np.abs(held) @ terms)


def _terms(ws: Workspace) -> np.ndarray:
    """Size of the terms (nv,) that a joint's effort is the sum of (N m, N): what rounds it.

    Of gravity at most |S_i^T I g| <= (M_ii m)^1/2 |g|, m what the joint carries.
    """
    tree, maps, carried = ws.machine.tree, ws.machine.maps, np.zeros(ws.nv)
    joint = np.repeat(np.arange(len(tree.mass)), np.diff(tree.first_freedom))
    np.add.at(carried, tree.freedom_velocity, tree.mass[joint])
    weight = np.sqrt(np.diag(maps.M) * carried) * np.linalg.norm(tree.gravity)
    return np.asarray(maps.push_terms + weight)


def _at_limit(ws: Workspace, use: float) -> tuple[str, ...]:
    """Names of the sites, and gears, whose coordinate is used that much."""
    if not use > 0.0:  # a limit may be infinite: a self-locking gear's
        return ()
    x = ws.modes.friction
    limit = np.where(x > 0.0, ws.most, -ws.least)
    used = np.abs(x) >= _AT_LIMIT * use * limit
    used &= ws.plan.coordinates.dry & (np.abs(x) > 0.0)
    return tuple(name for name, c, _ in ws.places if used[c])


def _moving(ws: Workspace) -> tuple[str, ...]:
    """Names of the joints that accelerate although everything with dry friction sticks."""
    if ws.locked:
        return ()
    x = np.concatenate([[1.0], ws.modes.friction])
    a_map, coordinates = ws.machine.maps.acceleration, ws.plan.coordinates
    a, terms = a_map @ x, np.abs(a_map) @ np.abs(x)
    rubs = set(coordinates.velocity_index[coordinates.dry].tolist())
    scale = _STILL * float(terms.max(initial=0.0))
    model = ws.scene.model
    joints = list(zip(model.names, model.joints, strict=True))[1:]  # the first is the ground
    return tuple(
        name
        for name, joint in joints
        if any(
            c not in rubs and abs(a[c]) > scale for c in range(joint.idx_v, joint.idx_v + joint.nv)
        )
    )
