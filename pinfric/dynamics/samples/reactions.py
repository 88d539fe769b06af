"""Joint reactions of many samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.dynamics.samples.states import States
from pinfric.dynamics.samples.threaded import reactions_in_parts, team, threads_for
from pinfric.errors import RollMomentError, SceneError, StateError, choose_from
from pinfric.model.arrays import real_numbers
from pinfric.model.closure import embedded, tree_tables
from pinfric.model.kinematics import place_links
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION, impossible
from pinfric.model.recursion import links, write_reactions
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.twin import Twin, project, transmit

#: Samples per batch and thread: the twin's arrays of one batch stay in the second-level cache.
CHUNK = 512
#: The same where several threads wait for each other: fewer and longer batches.
_SHARED_CHUNK = 1024


@dataclass(frozen=True)
class AppliedWrench:
    """An external wrench on the robot.

    Attributes:
        joint: row of the joint whose child link it acts on; -1 is the ground.
        wrench: (T, 6), force and moment on the link, in that joint's frame, linear first.
    """

    joint: int
    wrench: np.ndarray


def joint_wrenches(
    scene: Scene,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    external: Mapping[str, np.ndarray] | None = None,
    *,
    threads: int | None = None,
) -> np.ndarray:
    """Return the wrench that every joint transmits, parent on child, as Pinocchio's `data.f`.

    w = RNEA_twin(q, E v, E a) - sum of X f_ext (the multipliers of paper eq. 17).

    Args:
        scene: the robot, with the payloads attached by default.
        q, v, a: (T, nq), (T, nv), (T, nv).
        external: frame name -> (T, 6) or (6,) wrench on it, in its axes at its origin (N, N m).
        threads: of Pinocchio; None chooses by the number of samples.

    Returns:
        (T, nj, 6), N and N m, in each joint's child frame, linear first.
    """
    expect_scene(scene, "joint_wrenches")
    states = States.of(scene, q, v, a)
    return state_wrenches(scene, states, applied_wrenches(scene, external, len(states.q)), threads)


def state_wrenches(
    scene: Scene, states: States, applied: Sequence[AppliedWrench] = (), threads: int | None = None
) -> np.ndarray:
    """Return `joint_wrenches` (T, nj, 6) with the payloads that each state carries."""
    threads = threads_for(len(states.q), threads)
    out = np.empty((len(states.q), scene.twin().n_joints, 6))
    for start, stop, carried in states.phases(scene):
        twin = scene.twin(carried)
        for part in slices(start, stop, batch_size(threads)):
            reactions(twin, states.part(part), part_of(applied, part), out[part], threads)
    return out


def part_of(applied: Sequence[AppliedWrench], part: slice) -> list[AppliedWrench]:
    """Return the wrenches on some of the samples."""
    return [AppliedWrench(one.joint, one.wrench[part]) for one in applied]


def reactions(
    twin: Twin,
    states: States,
    applied: Sequence[AppliedWrench],
    wrench: np.ndarray,
    threads: int,
) -> None:
    """Write w = RNEA_twin(q, E v, E a) less springs and external wrenches (paper eq. 17).

    Args:
        twin: with the springs.
        states, applied: of one batch.
        wrench: (n, nj, 6), overwritten.
        threads: of numba.
    """
    q, v, a = states.q, states.v, states.a
    arguments = q, v, a, twin.embedding, links(twin), wrench
    if threads == 1:
        write_reactions(*arguments)
    else:
        with team(threads) as parts:
            reactions_in_parts(parts, *arguments)
    if not applied and twin.springs is None:
        return
    q_twin = embedded(twin, q, v, a)[0]
    for joint, on_link in spring_wrenches(twin, q, q_twin):
        transmit(on_link, joint, *tree_tables(twin), q_twin, wrench)
    for one in applied:
        transmit(one.wrench, one.joint, *tree_tables(twin), q_twin, wrench)


def rigid_efforts(
    twin: Twin, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the wrenches (n, nj, 6) and efforts (n, nv) of states without friction (`reactions`).

    Args:
        twin: with the springs. q, v, a: (n, nq), (n, nv), (n, nv).
    """
    wrench, effort = np.empty((len(q), twin.n_joints, 6)), np.empty(v.shape)
    for part in slices(0, len(q), batch_size(1)):
        reactions(twin, States(q[part], v[part], a[part]), (), wrench[part], 1)
    project(wrench, twin.embedding, twin.armature, a, effort)
    return wrench, effort


def spring_wrenches(twin: Twin, q: np.ndarray, q_twin: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Return the springs' wrenches on links (`Springs.wrenches`) of a batch.

    Args:
        twin: with the springs. q: (n, nq). q_twin: (n, 7 nj), as `embed` writes it.
    """
    return [] if twin.springs is None else twin.springs.wrenches(*_places(twin, q, q_twin))


def spring_energy(twin: Twin, q: np.ndarray) -> np.ndarray:
    """Return (n,) the potential energy (J) of the springs at configurations q (n, nq)."""
    if twin.springs is None:
        return np.zeros(len(q))
    zero = np.zeros((len(q), twin.nv))
    return twin.springs.energy(*_places(twin, q, embedded(twin, q, zero, zero)[0]))


def _places(
    twin: Twin, q: np.ndarray, q_twin: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions of the springs' joints, poses of all links."""
    assert twin.springs is not None
    n, nj = len(q), twin.n_joints
    p, R = np.empty((n, nj, 3)), np.empty((n, nj, 3, 3))
    place_links(q_twin, *tree_tables(twin), p, R)
    return twin.displacements(twin.springs.joint, q), p, R


def applied_wrenches(
    scene: Scene, external: Mapping[str, np.ndarray] | None, samples: int
) -> list[AppliedWrench]:
    """Check `external` and move each wrench from its frame to its joint's frame.

    Raises:
        SceneError: there is no such frame; StateError: a wrong shape or a value not finite.
    """
    applied = []
    if not isinstance(external, Mapping | None):
        raise StateError(
            f"external: should be a mapping of frames to wrenches on them, found "
            f"{type(external).__name__}"
        )
    for name, array in (external or {}).items():
        wrench = real_numbers(f"external[{name!r}]", array)
        if wrench.shape not in ((6,), (samples, 6)):
            raise StateError(
                f"external[{name!r}]: shape {wrench.shape}; should be (6,) or ({samples}, 6), "
                "force then moment on the frame, in its axes"
            )
        if impossible(wrench).any():
            raise StateError(
                f"external[{name!r}]: holds NaN, Inf or more than {LARGEST_OF_A_MOTION:g}"
            )
        frame = external_frame(scene, name)
        in_joint = wrench @ frame.placement.toDualActionMatrix().T
        in_joint = np.ascontiguousarray(np.broadcast_to(in_joint, (samples, 6)))
        applied.append(AppliedWrench(frame.parentJoint - 1, in_joint))
    return applied


def external_frame(scene: Scene, name: str) -> pin.Frame:
    """Return the frame of that name, a link's first: in URDFs joints may have the same names.

    Raises:
        SceneError: there is none.
    """
    model = scene.model
    named = [frame for frame in model.frames if frame.name == name]
    bodies = [frame for frame in named if frame.type == pin.FrameType.BODY]
    if bodies or named:
        return (bodies or named)[0]
    if model.existJointName(name):  # a model made in Python need not have frames
        return pin.Frame(name, model.getJointId(name), pin.SE3.Identity(), pin.FrameType.JOINT)
    names = [frame.name for frame in model.frames] + list(model.names)[1:]
    raise SceneError(f"external: there is no frame {name!r}; {choose_from(name, names)}")


def constant_payloads(
    scene: Scene, states: States, whole: slice, size: int
) -> Iterator[tuple[slice, Twin]]:
    """Cut `whole` into batches of constant payload, each with its twin."""
    for start, stop, carried in states.phases(scene):
        batches = list(slices(max(start, whole.start), min(stop, whole.stop), size))
        if batches:
            twin = scene.twin(carried)  # once: it looks whether the scene has changed
            yield from ((batch, twin) for batch in batches)


def check_roll_moments(scene: Scene, wrench: np.ndarray, first: int) -> None:
    """Refuse a moment about the axis that a bearing cannot carry (beyond rounding).

    Args:
        scene: with the bearings.
        wrench: (n, ns, 6) of the sites, N and N m.
        first: number of the first sample, for the message.

    Raises:
        RollMomentError: a guide without width is loaded so.
    """
    for s, site in enumerate(scene.sites):
        bearing = site.friction.bearing
        lever = None if bearing is None else bearing.roll_lever()
        if lever is None:
            continue
        force, moment = wrench[:, s, :3], wrench[:, s, 3:]
        roll = moment @ site.axis
        scale = np.linalg.norm(moment, axis=1) + lever * np.linalg.norm(force, axis=1)
        beyond = np.abs(roll) > 1e-9 * scale
        if beyond.any():
            sample = int(np.argmax(beyond))
            raise RollMomentError(site.name, first + sample, float(roll[sample]))


def batch_size(threads: int) -> int:
    """Return the samples of a batch, which stays in each thread's cache."""
    return CHUNK if threads == 1 else _SHARED_CHUNK * threads


def slices(start: int, stop: int, size: int) -> Iterator[slice]:
    """Cut [start, stop) into slices of at most `size`."""
    for begin in range(start, stop, size):
        yield slice(begin, min(begin + size, stop))
