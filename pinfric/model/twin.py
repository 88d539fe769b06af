"""The wrench twin: the same robot with every joint opened to six degrees of freedom.

RNEA on the twin returns, as generalized forces, the wrench w that every joint transmits. The
embedding E(q) maps joint rates to twin rates; it is the paper's partial velocity matrix B (eq. 6).
See `notebooks/theory/wrench_twin.md`.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.errors import RobotError
from pinfric.kernels.compiled import kernel, late_kernel
from pinfric.model.kinematics import rotation
from pinfric.model.spring_forces import Springs

# How a joint's configuration becomes a placement.
REVOLUTE, PRISMATIC, CONTINUOUS, PLANAR, SPHERICAL, TRANSLATION, FREE = range(7)

#: Velocity components (of vx, vy, vz, wx, wy, wz) that each many-degree joint has, in its order.
_COMPONENTS = {PLANAR: (0, 1, 5), SPHERICAL: (3, 4, 5), TRANSLATION: (0, 1, 2), FREE: range(6)}
_MANY_DEGREES = {
    "JointModelPlanar": PLANAR,
    "JointModelSpherical": SPHERICAL,
    "JointModelTranslation": TRANSLATION,
    "JointModelFreeFlyer": FREE,
}


class Embedding(NamedTuple):
    """The tables of `Twin` for its kernels, one row per joint."""

    kind: np.ndarray
    q_index: np.ndarray
    v_index: np.ndarray
    ratio: np.ndarray
    shift: np.ndarray
    axis: np.ndarray
    components: np.ndarray


@dataclass(frozen=True)
class Twin:
    """The robot and the tables of the embedding, one row per joint (universe left out).

    Attributes:
        model: the robot itself.
        kind: (nj,) how the configuration becomes a placement.
        q_index, v_index: (nj,) where the joint's (for a mimic joint: its leader's) numbers start.
        ratio, shift: (nj,) angle = ratio * leader's angle + shift; 1 and 0 except for mimic joints.
        axis: (nj, 6) unit motion subspace of one-degree joints, linear first, zero for others.
        components: (nj, 6) velocity components of many-degree joints, in order, padded with -1.
        armature: (nv,) rotor inertia reflected to the joints, from the model.
        springs: of the scene, if any.
        pools: Pinocchio's pools and data by use and threads; made when first used, not pickled.
    """

    model: pin.Model
    kind: np.ndarray
    q_index: np.ndarray
    v_index: np.ndarray
    ratio: np.ndarray
    shift: np.ndarray
    axis: np.ndarray
    components: np.ndarray
    armature: np.ndarray
    springs: Springs | None = None
    pools: dict[Any, pin.ModelPool] = field(default_factory=dict, compare=False, repr=False)

    @property
    def nv(self) -> int:
        """Number of the robot's degrees of freedom."""
        return int(self.model.nv)

    @property
    def n_joints(self) -> int:
        """Number of joints, the universe left out."""
        return len(self.kind)

    @property
    def embedding(self) -> Embedding:
        """The columns that the kernels read."""
        return Embedding(*(getattr(self, name) for name in Embedding._fields))

    def displacements(self, joint: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return positions (n, len(joint)) along the joints' axes (rad or m)."""
        return np.asarray(
            self.ratio[joint] * q.take(self.q_index[joint], axis=1) + self.shift[joint]
        )

    def plain_pool(self, threads: int) -> pin.ModelPool:
        """Return the pool of the ordinary model, for efforts without reactions."""
        key = "plain", threads
        if key not in self.pools:
            self.pools[key] = pin.ModelPool(self.model, threads)
        return self.pools[key]

    def poses(self) -> tuple[pin.Data, list[np.ndarray], list[np.ndarray]]:
        """Return this thread's data and views of its `data.oMi`: (3,) and (3, 3) of each joint."""
        key = "poses", threading.get_ident()
        if key not in self.pools:
            data = self.model.createData()
            placed = [data.oMi[j] for j in range(1, self.model.njoints)]
            self.pools[key] = data, [M.translation for M in placed], [M.rotation for M in placed]
        return self.pools[key]

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "pools": {}}


def make_twin(model: pin.Model) -> Twin:
    """Tabulate how the joints of `model` embed.

    Raises:
        RobotError: a joint that no URDF can describe (helical, universal, composite, ...).
    """
    rows = [_embedding_row(model, index) for index in range(1, model.njoints)]
    columns = list(zip(*rows, strict=True)) if rows else [()] * 7
    kind, q_index, v_index = (np.array(c, dtype=np.int64) for c in columns[:3])
    ratio, shift = (np.array(c, dtype=float) for c in columns[3:5])
    axis = np.array(columns[5], dtype=float).reshape(-1, 6)
    components = np.array(columns[6], dtype=np.int64).reshape(-1, 6)
    return Twin(
        model,
        kind,
        q_index,
        v_index,
        ratio,
        shift,
        axis,
        components,
        np.array(model.armature, dtype=float),
    )


def _embedding_row(model: pin.Model, index: int) -> tuple[object, ...]:
    """(kind, q_index, v_index, ratio, shift, axis, components) of one joint."""
    joint = model.joints[index]
    nothing = (-1,) * 6
    if joint.shortname() in _MANY_DEGREES:
        kind = _MANY_DEGREES[joint.shortname()]
        filled = (*_COMPONENTS[kind], *nothing)[:6]
        return kind, joint.idx_q, joint.idx_v, 1.0, 0.0, np.zeros(6), filled
    if joint.shortname() == "JointModelMimic":
        mimic = joint.extract()
        ratio, shift = float(mimic.scaling), float(mimic.offset)
        leader = model.mimicked_joints[list(model.mimicking_joints).index(index)]
        if model.joints[leader].nq != 1:
            raise RobotError(
                f"joint {model.names[index]!r} mimics a continuous joint: not supported"
            )
        axis = twist(model, joint) / ratio
    elif joint.nv == 1 and joint.nq in (1, 2):
        ratio, shift = 1.0, 0.0
        axis = twist(model, joint)
    else:
        raise RobotError(
            f"joint {model.names[index]!r} is a {joint.shortname()}: only revolute, continuous, "
            "prismatic, planar, spherical, translation, free-flyer and mimic joints are supported"
        )
    turns = float(np.linalg.norm(axis[3:]))
    pitch = float(axis[:3] @ axis[3:]) / turns**2 if turns else 0.0
    if abs(pitch) > 1e-12:
        raise RobotError(
            f"joint {model.names[index]!r} is helical ({pitch:g} m/rad): write it as a revolute "
            "joint and, on its axis, a prismatic one with <mimic> and multiplier "
            f"{pitch:g}; or, if only its nut matters, as a prismatic joint with transmission ratio "
            f"{1 / pitch:g}"
        )
    if not abs(np.linalg.norm(axis) - 1.0) < 1e-6:
        raise RobotError(
            f"joint {model.names[index]!r} has an axis of length {np.linalg.norm(axis):g}; give a "
            "direction"
        )
    kind = CONTINUOUS if joint.nq == 2 else REVOLUTE if turns else PRISMATIC
    return kind, joint.idx_q, joint.idx_v, ratio, shift, axis, nothing


def twist(model: pin.Model, joint: pin.JointModel) -> np.ndarray:
    """Return the twist (6,) of a one-degree joint's child in its frame at unit (leader's) rate."""
    data = joint.createData()
    joint.calc(data, pin.neutral(model), np.ones(model.nv))
    return np.array(data.v.vector)


@kernel
def embed(
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    joints: Embedding,
    q_twin: np.ndarray,
    v_twin: np.ndarray,
    a_twin: np.ndarray,
) -> None:
    """Write the twin's configuration, velocity E v and acceleration E a of each sample.

    Args:
        q, v, a: (n, nq), (n, nv), (n, nv) of the robot.
        q_twin, v_twin, a_twin: (n, 7 nj), (n, 6 nj), (n, 6 nj), overwritten: position and
            quaternion (x, y, z, w) of each joint's child side, its twist and its derivative in the
            child's frame, linear first. These joints have no bias acceleration.
    """
    kind, ratio, shift, axis = joints.kind, joints.ratio, joints.shift, joints.axis
    for i in range(q.shape[0]):
        for j in range(kind.size):
            k, iq, iv = kind[j], joints.q_index[j], joints.v_index[j]
            p, s = 7 * j, 6 * j
            if k > CONTINUOUS:
                embed_many(
                    k,
                    q[i, iq:],
                    v[i, iv:],
                    a[i, iv:],
                    joints.components[j],
                    q_twin[i, p:],
                    v_twin[i, s:],
                    a_twin[i, s:],
                )
                continue
            rate, acceleration = ratio[j] * v[i, iv], ratio[j] * a[i, iv]
            for c in range(6):
                v_twin[i, s + c] = axis[j, c] * rate
                a_twin[i, s + c] = axis[j, c] * acceleration
            if k == PRISMATIC:
                distance = ratio[j] * q[i, iq] + shift[j]
                sine, cosine = 0.0, 1.0
            else:
                distance = 0.0
                if k == CONTINUOUS:
                    half = 0.5 * np.arctan2(q[i, iq + 1], q[i, iq])
                else:
                    half = 0.5 * (ratio[j] * q[i, iq] + shift[j])
                sine, cosine = np.sin(half), np.cos(half)
            for c in range(3):
                q_twin[i, p + c] = axis[j, c] * distance
                q_twin[i, p + 3 + c] = axis[j, 3 + c] * sine
            q_twin[i, p + 6] = cosine


@late_kernel("joints of several degrees")
def embed_many(
    kind: int,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    components: np.ndarray,
    q_twin: np.ndarray,
    v_twin: np.ndarray,
    a_twin: np.ndarray,
) -> None:
    """`embed` of one joint of many degrees; arrays begin with its numbers."""
    for c in range(6):
        q_twin[c] = v_twin[c] = a_twin[c] = 0.0
    q_twin[6] = 1.0
    n = 0
    while n < 6 and components[n] >= 0:
        v_twin[components[n]], a_twin[components[n]] = v[n], a[n]
        n += 1
    if kind == PLANAR:
        half = 0.5 * np.arctan2(q[3], q[2])
        q_twin[0], q_twin[1] = q[0], q[1]
        q_twin[5], q_twin[6] = np.sin(half), np.cos(half)
    elif kind == SPHERICAL:
        for c in range(4):
            q_twin[3 + c] = q[c]
    elif kind == TRANSLATION:
        for c in range(3):
            q_twin[c] = q[c]
    else:
        for c in range(7):
            q_twin[c] = q[c]


@kernel
def project(
    wrench: np.ndarray, joints: Embedding, armature: np.ndarray, a: np.ndarray, effort: np.ndarray
) -> None:
    """Write tau_id = E^T w + armature a, the total effort of a motion.

    Args:
        wrench: (n, nj, 6), parent on child, in the child's joint frame, linear first.
        armature: (nv,) inertia of rotors, reflected to the joints.
        a: (n, nv) rad/s^2, m/s^2.
        effort: (n, nv), overwritten.
    """
    v_index, ratio, axis, components = joints.v_index, joints.ratio, joints.axis, joints.components
    for i in range(wrench.shape[0]):
        for c in range(effort.shape[1]):
            effort[i, c] = 0.0
        for j in range(v_index.size):
            if components[j, 0] < 0:
                total = 0.0
                for c in range(6):
                    total += axis[j, c] * wrench[i, j, c]
                effort[i, v_index[j]] += ratio[j] * total
            else:
                n = 0
                while n < 6 and components[j, n] >= 0:
                    effort[i, v_index[j] + n] += wrench[i, j, components[j, n]]
                    n += 1
        for c in range(effort.shape[1]):
            effort[i, c] += armature[c] * a[i, c]


@kernel
def transmit(
    wrench_on_link: np.ndarray,
    start: int,
    parents: np.ndarray,
    placement_p: np.ndarray,
    placement_R: np.ndarray,
    q_twin: np.ndarray,
    wrench: np.ndarray,
) -> None:
    """Subtract a wrench f on one link from those of all joints between it and the ground.

        w_j -= X_j f

    Args:
        wrench_on_link: (n, 6), on the link of joint `start`, in that joint's frame.
        start: row of that joint; -1 is the ground.
        parents, placement_p, placement_R: as in `kinematics.place_links`.
        q_twin: (n, 7 nj), as `embed` writes it.
        wrench: (n, nj, 6), changed in place.
    """
    carried, R = np.empty(6), np.empty((3, 3))
    for i in range(wrench.shape[0]):
        for c in range(6):
            carried[c] = wrench_on_link[i, c]
        j = start
        while j >= 0:
            for c in range(6):
                wrench[i, j, c] -= carried[c]
            p = 7 * j
            rotation(q_twin[i, p + 3], q_twin[i, p + 4], q_twin[i, p + 5], q_twin[i, p + 6], R)
            _move_wrench(R, q_twin[i, p : p + 3], carried)  # to the joint's side on the parent
            _move_wrench(placement_R[j], placement_p[j], carried)  # to the parent joint's frame
            j = parents[j]


@kernel
def _move_wrench(R: np.ndarray, p: np.ndarray, wrench: np.ndarray) -> None:
    """Write a wrench (6,) of a frame in the frame of its placement: R f, R m + p x R f."""
    x, y, z = wrench[0], wrench[1], wrench[2]
    for r in range(3):
        wrench[r] = R[r, 0] * x + R[r, 1] * y + R[r, 2] * z
    x, y, z = wrench[3], wrench[4], wrench[5]
    for r in range(3):
        wrench[3 + r] = R[r, 0] * x + R[r, 1] * y + R[r, 2] * z
    wrench[3] = wrench[3] + p[1] * wrench[2] - p[2] * wrench[1]
    wrench[4] = wrench[4] + p[2] * wrench[0] - p[0] * wrench[2]
    wrench[5] = wrench[5] + p[0] * wrench[1] - p[1] * wrench[0]
