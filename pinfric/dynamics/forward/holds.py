"""Whether static friction holds a robot at rest: `pf.holds`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pinfric.dynamics.forward.forward import drive_vector
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.samples.closure import check_closed
from pinfric.dynamics.samples.reactions import applied_wrenches
from pinfric.dynamics.samples.states import one_of, vector
from pinfric.friction.balance import RANK, Balance
from pinfric.friction.gears import hold_chosen, lines_and_rows, ways_to_hold, without_gears
from pinfric.friction.holding import Verdict, decide, least_possible_use
from pinfric.friction.law import evaluate, stick_limits
from pinfric.friction.problem import Problem
from pinfric.friction.search import rests
from pinfric.model.scene import Scene, expect_scene

#: Joints with at least this fraction of the largest use reach their limits together.
_AT_LIMIT = 1.0 - 1e-6
#: An acceleration below this fraction of the terms of its sum is rounding.
_STILL = 1e-9
#: Uses this close, relative, are the same.
_SAME = 1e-9
#: A bound of the use has to be so much above 1 to prove something.
_MARGIN = 1e-9


@dataclass(frozen=True)
class StaticHold:
    """Whether static friction keeps a robot at rest, and with which margin.

    Attributes:
        held: True where forward dynamics lets all rest; False; None if neither could be shown.
        use: the largest ratio of a joint's friction to its static limit, the smallest found over
            all ways to share friction (up to 50 times the limits where it can wedge itself; a lower
            bound where balls rest and no friction holds). With motor torques a gear's friction is
            what it takes of the effort that arrives; one that locks itself can also hold efforts
            far from that, and then takes no part in the ratio.
        proved: whether `held` is proved: if True by the friction returned here, if False by
            branching, with balls by a motion that friction cannot resist. Friction that might
            wedge itself beyond 50 times its limits is not covered.
        least: whether `use` is proved to be the smallest, to 1e-6. A smaller use may exist if a
            contact force lies in no plane, if balls rest, or if 200 nodes of the proof are not
            enough.
        at_limit: names of the joints (or gears on joints without friction) with this ratio, which
            break away first.
        moving: names of the joints without dry friction that accelerate although all others stick.
        friction: (ns,) of the parent on the child, with that use (N m or N); NaN if no friction is
            in equilibrium.
        normal_load: (ns,) the loads with this friction.
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
    """Decide whether static friction holds a robot at rest, and with which margin.

    Friction x must be in equilibrium with effort, gravity and loops, and |x_k| <= limit_k(x) at
    every joint: use = min over all such x of max |x_k| / limit_k. Whether one holds is what forward
    dynamics tries first (`search.rests`); if none does, a proof shows that none exists (`holding`).

    Args:
        scene: the robot with its friction and drives.
        q: (nq,) rad, m; loops closed.
        effort: (na,) efforts of the drives at the joints (N m or N).
        external: frame name -> (6,) wrench on it, in its axes at its origin (N, N m).
        motor_torque: (na,) in place of `effort`, at the motors' shafts (N m); gears then also hold,
            and self-locking gears hold any load.
        attached: names of the payloads carried; None takes those attached by default.

    Raises:
        SceneError: motor torques with a drive without transmission.
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
    q, v = vector("q", q, ws.nq, "nq", ws.scene.model), np.zeros(ws.nv)
    u = drive_vector(ws, given)
    applied = None if external is None else applied_wrenches(scene, external, 1)
    if scene.loops and np.isfinite(q).all():
        check_closed(scene, q, v, slack=1e3)
    modes = ws.modes
    modes.stuck[:] = ws.plan.coordinates.dry
    ws.assemble(q, v, u, applied)
    verdict, shift = _decide_all(ws)
    modes.stuck[:], modes.direction[:] = ws.plan.coordinates.dry, 0.0
    modes.friction[:] = np.where(np.isfinite(verdict.friction), verdict.friction, 0.0)
    evaluate(ws.problem, modes.friction, modes.load, modes.rate)
    ws.finish()
    moving = _moving(ws) if verdict.held else ()
    friction = (
        ws.phi.copy() if np.isfinite(verdict.friction).all() else np.full(ws.phi.size, np.nan)
    )
    return StaticHold(
        held=False if moving else verdict.held,
        use=verdict.use,
        proved=verdict.proved or bool(moving),
        least=verdict.least,
        at_limit=_at_limit(ws, verdict.use, shift),
        moving=moving,
        friction=friction,
        normal_load=ws.load.copy(),
    )


def _decide_all(ws: Workspace) -> tuple[Verdict, np.ndarray]:
    """The verdict, with the least use over all ways of gears that lock; it stays in `ws.modes`.

    What forward dynamics lets rest is held. `held` is False, and proved, only if it is so for every
    way; the use is the least if it is the least of its way and no other has one below it. Beside it
    from where friction counts (nc,).
    """
    modes, dry = ws.modes, ws.plan.coordinates.dry
    ways = list(ways_to_hold(ws.problem, modes))
    modes.at_rest[:] = dry
    modes.forget()
    stays = not dry.any() or rests(ws.problem, modes, ws.mechanism)
    shown, efforts = modes.friction.copy(), modes.effort.copy()
    if ws.mechanism.balls:
        return _beside_balls(ws, stays, shown, ways), np.zeros(len(dry))
    tried = ways or [efforts]  # none: too many
    found = list[tuple[Verdict, np.ndarray]]()
    for choice in tried:
        _hold(ws, choice)
        used = min((verdict.use for verdict, _ in found), default=np.inf)
        found.append(_decide(ws, used))
    best = min(range(len(tried)), key=lambda i: found[i][0].use)
    verdict, shift = found[best]
    all_ways = [own for own, _ in found] if ways else []
    least = bool(ways) and all(own.least for own in all_ways)
    if stays and not verdict.held:  # by rounding, or where a proof took too long
        _hold(ws, efforts)
        _, shift = _from_there(ws)
        use = min(_share(ws, shown, shift), 1.0)
        return Verdict(True, use, shown, True, False), shift
    _hold(ws, tried[best])
    if stays:
        friction = _as_in_forward_dynamics(ws, verdict, shift, shown)
        return replace(verdict, proved=True, least=least, friction=friction), shift
    shown_none = bool(ways) and all(own.held is False for own in all_ways)
    proved = shown_none and all(own.proved for own in all_ways)
    held = False if shown_none else None
    return replace(verdict, held=held, proved=proved, least=least), shift


def _hold(ws: Workspace, efforts: np.ndarray) -> None:
    """Let gears at rest hold the intervals of these efforts."""
    ws.modes.effort[:] = efforts
    hold_chosen(ws.problem, ws.modes)


def _share(ws: Workspace, friction: np.ndarray, shift: np.ndarray) -> float:
    """The largest ratio of friction (nc,), counted from a shift, to its limit; a ball's has one."""
    dry, load, rate = ws.plan.coordinates.dry, ws.modes.load.copy(), ws.modes.rate.copy()
    least, most = np.empty((2, len(dry)))
    evaluate(ws.problem, friction, load, rate)
    stick_limits(ws.problem, load, least, most)
    x = friction - shift
    size = np.sqrt(ws.mechanism.summed(x**2))
    limit = np.where(ws.mechanism.ball | (x > 0.0), most - shift, shift - least)
    limit = np.maximum(limit, _STILL * np.abs(shift) + 1e-300)
    return float((size / limit)[dry].max(initial=0.0))


def _as_in_forward_dynamics(
    ws: Workspace, verdict: Verdict, shift: np.ndarray, shown: np.ndarray
) -> np.ndarray:
    """The friction (nc,) that forward dynamics shows, if none has a smaller use; else that found.

    Joints that do not reach the largest use may have many.
    """
    if not ws.mechanism.groups(ws.plan.coordinates.dry):
        return verdict.friction
    same = _share(ws, shown, shift) <= verdict.use * (1.0 + _SAME)
    return shown if same else verdict.friction


def _decide(ws: Workspace, least_below: float) -> tuple[Verdict, np.ndarray]:
    """The verdict on everything with dry friction at rest, with the least use if it is below one.

    Beside it from where friction counts (nc,): 0, or the nearest that a self-locking gear holds.
    """
    dry = ws.plan.coordinates.dry
    nothing = np.zeros(len(dry))
    if not dry.any():
        return Verdict(True, 0.0, nothing, True, True), nothing
    plain, shift = _from_there(ws)
    balance = _statics(ws, dry, shift)
    verdict = decide(plain, ws.mechanism.factor, dry, balance, least_below)
    return replace(verdict, friction=verdict.friction + shift), shift


def _from_there(ws: Workspace) -> tuple[Problem, np.ndarray]:
    """The problem without gears, and from where its friction counts (nc,).

    That is 0, or the nearest that a self-locking gear holds.
    """
    without = without_gears(ws.problem, ws.modes, lines_and_rows(ws.problem, ws.modes)[1])
    assert without is not None  # no gear is in motion
    plain, of_y = without
    return plain, of_y[:, 0] if of_y.size else np.zeros(len(ws.modes.stuck))


def _beside_balls(ws: Workspace, stays: bool, shown: np.ndarray, ways: list[np.ndarray]) -> Verdict:
    """The verdict where balls rest, whose limits are spheres: friction as in forward dynamics.

    Where that finds none over all ways of gears (none given: too many), and a bound of the use is
    above 1 for each, none holds.
    """
    efforts, dry = ws.modes.effort.copy(), ws.plan.coordinates.dry
    use = _share(ws, shown, np.zeros(len(dry))) if np.isfinite(shown).all() else np.inf
    if stays:
        _hold(ws, efforts)
        return Verdict(True, use, shown, True)
    resting, block = np.flatnonzero(dry), ws.mechanism.block[dry]
    balance = _statics(ws, dry, np.zeros(len(dry)))
    bounds = [0.0] * (not ways)
    for choice in ways:
        _hold(ws, choice)
        bounds.append(least_possible_use(ws.problem, resting, balance, block))
    _hold(ws, efforts)
    if min(bounds) > 1.0 + _MARGIN:
        return Verdict(False, min(bounds), np.full(len(dry), np.nan), True)
    return Verdict(None, use, shown, False)


def _statics(ws: Workspace, resting: np.ndarray, shift: np.ndarray) -> Balance:
    """The equilibrium of friction at rest, counted from a shift (nc,): Z^T D^T x = Z^T (h - S u).

    Z are all motions. The mass matrix, whose rounding would affect small limits, is left out; it
    contains the inertia of motions Z B that nothing holds.
    """
    w, D = ws.machine.maps, ws.machine.kinematics.D[resting]
    dead = ~ws.mechanism.factor[:, resting].any(axis=0)
    d = int(w.freedoms[0])
    Z = w.Z[:, :d] if ws.closed else np.eye(ws.nv)
    push = w.push + D.T @ shift[resting]
    rows, need, terms = Z.T @ D.T, -Z.T @ push, np.abs(Z.T) @ _terms(ws)
    rows[:, dead] = 0.0
    size = np.linalg.norm(rows, axis=0)
    U, values, _ = np.linalg.svd(rows / np.where(dead, 1.0, size))
    rank = int((values > RANK * values[:1]).sum())
    if rank == d:
        return Balance(rows, need, terms)
    held, B = U[:, :rank].T, U[:, rank:]
    M = Z.T @ w.M @ Z
    need = need - M @ B @ np.linalg.solve(B.T @ M @ B, B.T @ need)
    return Balance(held @ rows, held @ need, np.abs(held) @ terms)


def _terms(ws: Workspace) -> np.ndarray:
    """Size of the terms (nv,) of the sum of a joint's effort (N m, N), which gives its rounding.

    Of gravity at most |S_i^T I g| <= (M_ii m)^1/2 |g|, m what the joint carries.
    """
    tree, maps, carried = ws.machine.tree, ws.machine.maps, np.zeros(ws.nv)
    joint = np.repeat(np.arange(len(tree.mass)), np.diff(tree.first_freedom))
    np.add.at(carried, tree.freedom_velocity, tree.mass[joint])
    weight = np.sqrt(np.diag(maps.M) * carried) * np.linalg.norm(tree.gravity)
    return np.asarray(maps.push_terms + weight)


def _at_limit(ws: Workspace, use: float, shift: np.ndarray) -> tuple[str, ...]:
    """Names of the sites, and gears, whose coordinate is used that much, counted from (nc,)."""
    if not use > 0.0:  # a limit may be infinite: a self-locking gear's
        return ()
    x = ws.modes.friction - shift
    limit = np.where(x > 0.0, ws.most - shift, shift - ws.least)
    used = np.abs(x) >= _AT_LIMIT * use * limit
    used &= ws.plan.coordinates.dry & (np.abs(x) > _STILL * np.abs(shift))
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
