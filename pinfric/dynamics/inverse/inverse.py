"""Inverse dynamics with friction: the efforts of a motion, as intervals where joints stick."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, overload

import numpy as np

from pinfric.dynamics.inverse.balance import check_reading
from pinfric.dynamics.inverse.linkage import solve_linkage
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.inverse.tree import solve_tree
from pinfric.dynamics.inverse.undriven import check_shares
from pinfric.dynamics.samples.presliding import built_up
from pinfric.dynamics.samples.reactions import applied_wrenches, slices
from pinfric.dynamics.samples.states import (
    MotionLike,
    States,
    attached_columns,
    mention_degrees,
    mention_unmeasured,
)
from pinfric.errors import StateError
from pinfric.model.arrays import whole_number
from pinfric.model.scene import Scene, expect_scene


@overload
def inverse_dynamics(
    scene: Scene,
    q: np.ndarray | MotionLike,
    v: np.ndarray | None = ...,
    a: np.ndarray | None = ...,
    external: Mapping[str, np.ndarray] | None = ...,
    *,
    t: np.ndarray | None = ...,
    attached: np.ndarray | None = ...,
    threads: int | None = ...,
    chunks: None = ...,
    position_known: float | None = ...,
) -> InverseResult: ...
@overload
def inverse_dynamics(
    scene: Scene,
    q: np.ndarray | MotionLike,
    v: np.ndarray | None = ...,
    a: np.ndarray | None = ...,
    external: Mapping[str, np.ndarray] | None = ...,
    *,
    t: np.ndarray | None = ...,
    attached: np.ndarray | None = ...,
    threads: int | None = ...,
    chunks: int,
    position_known: float | None = ...,
) -> Iterator[InverseResult]: ...
def inverse_dynamics(
    scene: Scene,
    q: np.ndarray | MotionLike | None = None,
    v: np.ndarray | None = None,
    a: np.ndarray | None = None,
    external: Mapping[str, np.ndarray] | None = None,
    *,
    t: np.ndarray | None = None,
    attached: np.ndarray | None = None,
    threads: int | None = None,
    chunks: int | None = None,
    position_known: float | None = None,
) -> InverseResult | Iterator[InverseResult]:
    """Return the drives' efforts along a motion, with friction: intervals where joints stick.

    M a + h - J_ext^T f_ext = S u + J_c^T lambda + D phi (paper eq. 16, 17; at rest eq. 21, 22).
    With times, a joint that reverses between two samples passes through rest: the sample nearest to
    the reversal has the interval of standstill. Where friction builds up over a way (`presliding`)
    it has the share of the way since the joint reversed, which is not known before it moved by
    twice its way, and after a hold. Without times the samples are states without order, and
    friction acts at once.

    Args:
        scene: the robot with its friction and drives.
        q, v, a: (T, nq), (T, nv), (T, nv) in rad, m and per second; or, in place of q alone, a
            motion that has t, q, v, a (and `attached`).
        external: frame name -> (T, 6) or (6,) wrench on it, in its axes at its origin (N, N m);
            None: those of the motion, if it has any. What they leave at a free base is a result
            (`base_residual`).
        t: (T,) times in s, for reversals, stick intervals and time-weighted figures; None: states
            without order, no reversals are looked for.
        attached: (T, np) which payloads are carried; columns as `scene.payloads`.
        threads: of Pinocchio; None chooses by the number of samples (one in a forked process).
        chunks: return an iterator of results of this many samples each; a stick interval that
            continues into the next is in both.
        position_known: how well positions at rest are known (rad or m), for joints whose friction
            builds up: then a hold has the interval that this leaves; None: not to a way.

    Raises:
        StateError: not real numbers, a wrong shape, a value not finite, times not increasing, ends
            of a cylinder that coincide.
        RollMomentError: a guide without width is loaded by a moment about its axis.
        LoopMotionError: a loop is open, or the motion violates it.
        SceneError: redundant drives without `share`.
        UndrivenMotionError: a joint without a drive needs one.
        StateError: forces in other axes, or with the other sign, would balance a free base.

    Warns:
        PinfricWarning: angles that are within the joints' limits only in degrees; joints faster
            than the friction of the scene was measured.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> motion = pf.load_trajectory("pendulum", scene)
    >>> result = pf.inverse_dynamics(scene, motion)
    >>> [(round(stick.start, 2), round(stick.end, 2)) for stick in result.stick_intervals()]
    [(0.0, 0.2), (1.2, 1.7), (2.5, 2.8)]
    """
    states = _states(scene, q, v, a, t, attached)
    if external is None:
        external = getattr(q, "external", None) or None
    applied = applied_wrenches(scene, external, len(states.q))
    check_shares(scene)
    built = built_up(scene, states, position_known)
    solve = solve_linkage if scene.linkage is not None else partial(solve_tree, built=built)
    if chunks is None:
        result = solve(scene, states, applied, slice(0, len(states.q)), threads)
        if result.balance is not None:
            check_reading(scene, states, external or {}, result.balance)
        return result
    parts = slices(0, len(states.q), whole_number("chunks", chunks))
    return (solve(scene, states, applied, part, threads) for part in parts)


def _states(scene: Scene, q: Any, v: Any, a: Any, t: Any, attached: Any) -> States:
    """The samples given to `inverse_dynamics`: arrays, or one motion."""
    expect_scene(scene, "inverse_dynamics")
    if isinstance(q, str | os.PathLike) and v is None and a is None:
        name = str(q)
        raise StateError(
            f"inverse_dynamics: the motion is a file's name, {name!r}; give "
            f"pf.load_trajectory({name!r}, scene)"
        )
    if not isinstance(q, np.ndarray) and hasattr(q, "q"):
        if not (v is None and a is None and t is None):
            raise StateError("inverse_dynamics: a motion has its own v, a and t; leave them out")
        motion = q
        q, v, a, t = motion.q, motion.v, motion.a, motion.t
        attached = attached_columns(scene, motion) if attached is None else attached
    if v is None or a is None:
        raise StateError("inverse_dynamics needs q, v and a, or one motion that has all of them")
    states = States.of(scene, q, v, a, t, attached)
    mention_degrees(scene, states.q)
    mention_unmeasured(scene, states.v)
    return states
