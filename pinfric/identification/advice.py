"""The most informative next recording: standard errors with it are those of (H + H_new)^-1.

A motion's columns do not need its efforts, so H_new is known before a recording is made.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinfric.identification.columns import joint_rows, prepare
from pinfric.identification.estimate import Estimate, reloaded, scale_is_known
from pinfric.identification.excitation import SPEED_UP, Reach, informative_moves
from pinfric.identification.information import Criterion
from pinfric.identification.laws import INERTIA, K
from pinfric.identification.normal import BlockProducts, FrictionNormalEquations, Normal, above_zero
from pinfric.identification.parameters import scene_key
from pinfric.identification.recordings import Recording
from pinfric.model.arrays import FloatArray
from pinfric.model.described import described, quantity
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import configurations, joint_columns
from pinfric.motions.trajectory import Trajectory
from pinfric.motions.waypoints import WayPoint, WayPointFile, sample_waypoints, waypoints_text

#: s of each recording that is weighed, and Hz of its samples.
_DURATION, _RATE = 30.0, 100.0
#: s of a hold at each way-point: every departure shows friction at rest.
_HOLD = 0.3
#: rad or m, and s: a departure so slow that the effort rises until the joint breaks away.
_BREAK_AWAY, _SLOWLY = 0.03, 2.5
#: Share of the robot's mass that a load of contrast has, and m by which it stands off.
_LOAD, _OFF = 0.1, 0.1
#: Samples of the logs that tell which next moves show something new, and among whose postures they
#: are.
_KNOWN = 400


@described
class Advice:
    """A recording that has not been made.

    Attributes:
        points: as a way-point file holds them.
    """

    name: str = quantity("short description of the recording")
    points: tuple[WayPoint, ...]
    load: float = quantity("mass to carry at the last link; 0: none", "kg")
    factors: dict[str, float] = quantity(
        "key of a coefficient -> standard error with this recording / present standard error"
    )


def advise(estimate: Estimate) -> tuple[Advice, ...]:
    """Return recordings of 30 s each, the most informative one first.

    Where only the scale of all masses keeps a gear's losses from being known, one with a known
    payload comes first. Way-points are postures that the logs visit; the motion between them is not
    checked for collisions.
    """
    problem = estimate.problem
    normal = problem.normal()
    weighed = [_weighed(estimate, normal, *recording) for recording in _recordings(estimate)]
    gears = any(estimate.choice.laws[j].load == "gear" for j in estimate.known)
    scale = gears and not scale_is_known(estimate)

    def rank(advice: Advice) -> tuple[bool, float]:
        return not (scale and advice.load > 0.0), float(sum(np.log(list(advice.factors.values()))))

    return tuple(sorted(weighed, key=rank))


def advice_text(advice: Advice, scene: Scene) -> str:
    """Return a recording as a way-point file that begins with slow departures."""
    start = advice.points[0].q
    departures = [
        WayPoint(q=(*start[:j], start[j] + step, *start[j + 1 :]), duration=_SLOWLY, hold=_HOLD)
        for j in range(len(start))
        for step in (_BREAK_AWAY, 0.0, -_BREAK_AWAY, 0.0)
    ]
    file = WayPointFile(
        pinfric_trajectory=1,
        sample_rate=_RATE,
        joints=scene.joint_names,
        points=(WayPoint(q=start, hold=1.0), *departures, *advice.points[1:]),
    )
    return waypoints_text(
        file,
        [
            f"{advice.name}. What 30 s of it would change:",
            "",
            *(
                f"  standard error of {key}: {factor:.2f} of the present one"
                for key, factor in sorted(advice.factors.items(), key=lambda pair: pair[1])[:8]
            ),
            "",
            "First each joint leaves rest alone, in both directions, so slowly that its effort",
            "rises until it breaks away: only this shows static friction. Postures are from your",
            "logs; the moves between them are straight in joint space: check them for collisions.",
        ],
    )


def _recordings(estimate: Estimate) -> Iterator[tuple[str, tuple[WayPoint, ...], float]]:
    """Yield name, way-points among logged postures, and load of each recording to weigh."""
    motions = [log.recording.trajectory for log in estimate.prepared]
    q = np.concatenate([motion.joint_positions() for motion in motions])
    v, a = (np.concatenate([getattr(motion, x) for motion in motions]) for x in "va")
    limits = 0.8 * np.array([c.velocity_limit for c in joint_columns(estimate.scene.model)])
    fastest = np.minimum(np.maximum(np.quantile(np.abs(v), 0.98, axis=0), 1e-3), limits)
    heavy = float(f"{_LOAD * sum(i.mass for i in tuple(estimate.scene.model.inertias)[1:]):.1g}")
    thin = slice(None, None, max(1, len(q) // _KNOWN))
    criterion = Criterion.of(estimate.scene, q[thin])
    duration = sum(motion.duration for motion in motions)
    known = criterion.products(q[thin], v[thin], a[thin]) * (duration / len(q[thin]))

    def way(speed: FloatArray) -> tuple[WayPoint, ...]:
        reach = Reach(q.min(axis=0), q.max(axis=0), speed, speed / SPEED_UP)
        return informative_moves(criterion, known, reach, q[thin], _DURATION, hold=_HOLD)

    yield "As fast as before", (again := way(fastest)), 0.0
    yield "At a fifth of the speed", way(0.2 * fastest), 0.0
    yield "Up to twice as fast", way(np.minimum(2.0 * fastest, limits)), 0.0
    if _links(estimate.scene):
        yield f"As fast as before, carrying {heavy:g} kg at the last link", again, heavy


def _links(scene: Scene) -> list[str]:
    """The links that joints move; none where a model made in Python names none."""
    return [
        frame.name
        for frame in scene.model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint > 0
    ]


def _weighed(
    estimate: Estimate, normal: Normal, name: str, points: tuple[WayPoint, ...], load: float
) -> Advice:
    grams = _grams(estimate, points, load)
    more = Normal.of(grams, np.ones(1, dtype=bool), estimate.problem.weights)
    both = Normal(
        *(getattr(normal, name) + getattr(more, name) for name in Normal.__dataclass_fields__)
    )
    both = replace(both, rows=normal.rows)  # which weigh the prior: a recording is none of it
    place = above_zero(estimate.fit, estimate.problem.slots(estimate.choice.laws))
    present, reduced = (
        _standard_errors(
            FrictionNormalEquations(equations, estimate.problem.prior).left[np.ix_(place, place)]
        )
        for equations in (normal, both)
    )
    factors = {}
    for at, ratio in zip(place.tolist(), (reduced / present).tolist(), strict=True):
        j, slot = divmod(at, K)
        if slot != INERTIA and j in estimate.known:
            section, key, _ = scene_key(estimate.scene, j, estimate.choice.laws[j], slot)
            factors[f"{section}.{estimate.scene.joint_names[j]}.{key}"] = float(ratio)
    return Advice(name, points, load, factors)


def _grams(estimate: Estimate, points: tuple[WayPoint, ...], load: float) -> list[BlockProducts]:
    scene = estimate.scene
    columns = joint_columns(scene.model)
    file = WayPointFile(pinfric_trajectory=1, sample_rate=_RATE, points=points)
    motion = sample_waypoints(file, columns, {}, "")
    q = configurations(columns, motion.position, scene.model.nq)
    loaded = scene.with_(payloads={})
    if load > 0.0:
        loaded = scene.with_(
            payloads={"load": {"link": _links(scene)[-1], "mass": load, "com": (0.0, 0.0, _OFF)}}
        )
    trajectory = Trajectory.from_arrays(loaded, motion.t, q, motion.velocity, motion.acceleration)
    recording = Recording.of(
        loaded,
        "",
        trajectory,
        1.0 / _RATE,
        np.zeros_like(motion.velocity),
        estimate.prepared[0].recording.noise,
    )
    prepared = reloaded(
        estimate, prepare(loaded, recording, no_gravity=estimate.question.no_gravity), loaded
    )
    rows = [joint_rows([prepared], j, 0.0) for j in range(scene.model.nv)]
    return [
        BlockProducts.of(replace(r, block=np.zeros_like(r.block)), np.ones(r.effort.size), 1)
        for r in rows
    ]


def _standard_errors(left: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(left))
    inverse = np.linalg.inv(left / np.outer(size, size))
    return np.sqrt(np.maximum(np.diag(inverse), 0.0)) / size
