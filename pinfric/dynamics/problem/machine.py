"""Tables and buffers of the kernels of forward dynamics: plan, Pinocchio's figures, results.

Poses, velocities and wrenches are views of Pinocchio's memory, or copied where a build has another
layout.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.problem.plan import Plan
from pinfric.dynamics.samples.reactions import AppliedWrench
from pinfric.dynamics.samples.states import unit_parts
from pinfric.friction.problem import Modes, Problem, empty_problem
from pinfric.kernels.arrays import array, make, rows_of
from pinfric.kernels.compiled import KernelArgument, kernel
from pinfric.kernels.records import record
from pinfric.model.closure import tree_tables
from pinfric.model.drives import most_lines
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION
from pinfric.model.twin import Twin


class Tree(NamedTuple):
    """The tree's nj joints with one payload, and their nf motions.

    Attributes:
        parent: (nj,) the joint that carries each, -1: the ground.
        mass: (nj,) of all links that each joint carries (kg).
        gravity: (3,) m/s^2.
        armature: (nv,) rotor inertia reflected to the joints.
        held_inertia: (nv,) 1 where a velocity moves no mass (`model.massless`), else 0: in M alone,
            which has nothing else in their rows and columns.
        first_freedom: (nj + 1,) index of each joint's first motion.
        freedom_velocity: (nf,) column of the velocity.
        twist: (nf, 6) motion per unit of it, in the joint's child frame, linear first.
        unit_first, unit_count: (nu,) where in q the parts of length 1 begin, how long they are.
    """

    parent: np.ndarray
    mass: np.ndarray
    gravity: np.ndarray
    armature: np.ndarray
    held_inertia: np.ndarray
    first_freedom: np.ndarray
    freedom_velocity: np.ndarray
    twist: np.ndarray
    unit_first: np.ndarray
    unit_count: np.ndarray


class PinocchioData(NamedTuple):
    """Pinocchio's figures at one state: views of its `Data` after `crba` (world) and `rnea`.

    The first row of each but `h` is the ground's, as in Pinocchio.

    Attributes:
        R, p: (1 + nj, 3, 3), (1 + nj, 3) of the joints' child frames in the world.
        velocity, acceleration: (1 + nj, 6) of the links in their joints' frames; accelerations at
            a = 0, of a ground that accelerates against gravity.
        force: (1 + nj, 6) wrench of each joint at a = 0, in its child's frame.
        lever, inertia: (1 + nj, 3), (1 + nj, 6) centre of mass of what a joint carries, and the
            inertia about that (xx, xy, yy, xz, yz, zz), in world axes.
        h: (nv,).
    """

    R: np.ndarray
    p: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray
    lever: np.ndarray
    inertia: np.ndarray
    h: np.ndarray


class ChainState(NamedTuple):
    """What kernels read of an open chain at the last state that RNEA computed.

    Attributes:
        unit_first, unit_count: see `Tree`. force, h: see `PinocchioData`.
        joint, displacement_q, displacement_ratio, displacement_shift: (ns,), see `plan.Sites`.
    """

    unit_first: np.ndarray
    unit_count: np.ndarray
    force: np.ndarray
    h: np.ndarray
    joint: np.ndarray
    displacement_q: np.ndarray
    displacement_ratio: np.ndarray
    displacement_shift: np.ndarray

    @classmethod
    def of(cls, machine: Machine) -> ChainState:
        """Take the arrays that `Pinocchio` writes."""
        tree, sites = machine.tree, machine.plan.sites
        return cls(
            tree.unit_first,
            tree.unit_count,
            machine.pinocchio.force,
            machine.pinocchio.h,
            sites.joint,
            sites.displacement_q,
            sites.displacement_ratio,
            sites.displacement_shift,
        )


@kernel
def read_sites(
    chain: ChainState, q: np.ndarray, wrench: np.ndarray, displacement: np.ndarray
) -> None:
    """Write the wrench (ns, 6) and the displacement (ns,) of every site."""
    for s in range(chain.joint.size):
        displacement[s] = chain.displacement_ratio[s] * q[chain.displacement_q[s]]
        displacement[s] += chain.displacement_shift[s]
        for e in range(6):
            wrench[s, e] = chain.force[1 + chain.joint[s], e]


class Kinematics(NamedTuple):
    """Kinematics of one state, in world axes.

    Attributes:
        R, p, velocity, acceleration: (1, nj, ...), of the links (`relate_pairs`).
        motion, momentum: (nf, 6) S and I S of each freedom about the world's origin.
        X, J: (1, nj + pairs, 6, nx), (1, nx, nv), `act_on_joints`.
        gap, rate, rate_derivative, tilt, terms: see `relate_pairs`.
        D, S: (nc, nv), (na, nv) rate of every coordinate, of every drive, per unit velocity.
        coordinate_rate: (nc,) relative velocity of each coordinate.
    """

    R: np.ndarray = array("1 nj 3 3")
    p: np.ndarray = array("1 nj 3")
    velocity: np.ndarray = array("1 nj 6")
    acceleration: np.ndarray = array("1 nj 6")
    motion: np.ndarray = array("nf 6")
    momentum: np.ndarray = array("nf 6")
    X: np.ndarray = array("1 rows 6 nx")
    J: np.ndarray = array("1 nx nv")
    gap: np.ndarray = array("1 nx")
    rate: np.ndarray = array("1 nx")
    rate_derivative: np.ndarray = array("1 nx")
    tilt: np.ndarray = array("1 pairs")
    terms: np.ndarray = array("1 pairs 2")
    D: np.ndarray = array("nc nv")
    S: np.ndarray = array("na nv")
    coordinate_rate: np.ndarray = array("nc")


class AffineMaps(NamedTuple):
    """All quantities of one state as functions of friction, [..., 0] + [..., 1:] x.

    Attributes:
        acceleration: (nv, 1 + nc). multiplier: (nl, 1 + nc). wrench: (nr, 6, 1 + nc).
        delivered: (na, 1 + nc) efforts of the drives, without the friction of gears.
        M: (nv, nv) mass matrix, with armature; of a time step with drag.
        Z: (nv, nv) motions that loops allow, in its first columns; `freedoms`: (1,) how many.
        a_closure: (nv,) one acceleration that keeps them closed.
        factor: (nv, nc) A of rate_slope = A^T A, its first d rows.
        unbalanced, push, push_terms: (nv,) S u - h; that less M a_closure; size of S u and h.
        idle: (nc,) whether a joint is near its dead centre.
        drag, damping: (nc,) of a time step: drag now, and its change per unit of speed at the end.
    """

    acceleration: np.ndarray = array("nv columns")
    multiplier: np.ndarray = array("nl columns")
    wrench: np.ndarray = array("nr 6 columns")
    delivered: np.ndarray = array("na columns")
    M: np.ndarray = array("nv nv")
    Z: np.ndarray = array("nv nv")
    freedoms: np.ndarray = array("1", np.int64)
    a_closure: np.ndarray = array("nv")
    factor: np.ndarray = array("nv nc")
    unbalanced: np.ndarray = array("nv")
    push: np.ndarray = array("nv")
    push_terms: np.ndarray = array("nv")
    idle: np.ndarray = array("nc", bool)
    drag: np.ndarray = array("nc")
    damping: np.ndarray = array("nc")


class Rotors(NamedTuple):
    """Rotors of the na drives, as armature: what each delivers if its gear loses nothing.

    Attributes:
        inertia: (na,) reflected to the drive's rate, of a time step with drag; 0 where efforts are
            given.
        arriving: (na,) r T_m, or the effort, less drag and what the rotor takes at a = 0.
    """

    inertia: np.ndarray = array("na")
    arriving: np.ndarray = array("na")


class FreeMotion(NamedTuple):
    """What one ABA takes while everything slides and no load changes friction, see `sliding`.

    Attributes:
        effort, armature: (nv,) of drives and friction together, on the lines that gears are on.
    """

    effort: np.ndarray = array("nv")
    armature: np.ndarray = array("nv")


class Results(NamedTuple):
    """Results that follow from the friction that was found.

    Attributes:
        a, effort: (nv,), (na,) accelerations, and efforts of the drives.
        driving: (na,) int8, of gears that move: 1 where the motor drives, -1 where the load does.
        multiplier: (nl,) forces that close loops, of side a on side b, in the order of the
            linkage's rows.
        least, most: (nc,) static limits of the friction x.
        phi, load, wrench: (ns,), (ns,), (ns, 6) friction, load and wrench of each site.
        entry_phi: (ne + gears,).
        site_modes: (ns,) int8, -1, 0, 1; of a ball 0, 1.
    """

    a: np.ndarray = array("nv")
    effort: np.ndarray = array("na")
    driving: np.ndarray = array("na", np.int8)
    multiplier: np.ndarray = array("nl")
    least: np.ndarray = array("nc")
    most: np.ndarray = array("nc")
    phi: np.ndarray = array("ns")
    load: np.ndarray = array("ns")
    wrench: np.ndarray = array("ns 6")
    entry_phi: np.ndarray = array("ne")
    site_modes: np.ndarray = array("ns", np.int8)


class Scratch(NamedTuple):
    """Intermediate results."""

    lower: np.ndarray = array("nv nv")
    right: np.ndarray = array("nv columns")
    below: np.ndarray = array("nj columns 6")
    above: np.ndarray = array("nj columns 6")


class Machine(NamedTuple):
    """All tables and buffers of one scene's kernels, as one argument."""

    plan: Plan
    tree: Tree
    pinocchio: PinocchioData
    kinematics: Kinematics
    maps: AffineMaps
    rotors: Rotors
    free_motion: FreeMotion
    results: Results
    scratch: Scratch
    modes: Modes
    problem: Problem


_PARTS = Tree, PinocchioData, Kinematics, AffineMaps, Rotors, FreeMotion, Results, Scratch
for _part in (*_PARTS, Machine):
    record(_part)


def make_machine(twin: Twin, plan: Plan, views: PinocchioData) -> Machine:
    """Make the buffers of a scene, with the masses of one payload."""
    tree, drives, actions = make_tree(twin), plan.drives, plan.closure.actions
    pairs, nc = len(actions.pair_kind), len(plan.coordinates.dry)
    geared = drives.gear_coordinate[drives.gear_coordinate >= 0]
    problem = empty_problem(
        np.concatenate([plan.entries.coordinate, geared]),
        np.concatenate([plan.entries.ratio, np.ones(len(geared))]),
        plan.contacts.owner,
        np.concatenate([plan.sites.constant[plan.entries.site], np.zeros(len(geared))]),
        len(geared),
        most_lines(drives.gears),
    )
    sizes = {
        "nv": twin.nv,
        "nj": twin.n_joints,
        "nf": len(tree.freedom_velocity),
        "nx": len(actions.column_pair),
        "pairs": pairs,
        "rows": twin.n_joints + pairs,
        "nc": nc,
        "columns": 1 + nc,
        "na": len(drives.action),
        "nl": plan.closure.multipliers,
        "nr": len(plan.contacts.joint),
        "ns": len(plan.sites.joint),
        "ne": len(problem.coordinate),
    }
    return Machine(
        plan=plan,
        tree=tree,
        pinocchio=views,
        kinematics=make(Kinematics, **sizes)._replace(
            D=plan.coordinates.rate_row.copy(), S=drives.rate_row.copy()
        ),
        maps=make(AffineMaps, **sizes)._replace(Z=np.eye(twin.nv)),
        rotors=make(Rotors, **sizes),
        free_motion=make(FreeMotion, **sizes),
        results=make(Results, **sizes),
        scratch=make(Scratch, **sizes),
        modes=Modes.of(nc, len(problem.coordinate), len(geared)),
        problem=problem,
    )


def make_tree(twin: Twin) -> Tree:
    """Tabulate the joints of a twin, with the masses of its payload."""
    unit_first, unit_count = unit_parts(twin.model)
    parent, mass = tree_tables(twin)[0], np.array([body.mass for body in twin.model.inertias])[1:]
    joint, column, twist = [], [], []
    for j in range(twin.n_joints):
        if twin.components[j, 0] < 0:
            joint.append(j)
            column.append(int(twin.v_index[j]))
            twist.append(twin.ratio[j] * twin.axis[j])
        for n, component in enumerate(twin.components[j]):
            if component >= 0:
                joint.append(j)
                column.append(int(twin.v_index[j]) + n)
                twist.append(np.eye(6)[component])
    for j in range(len(mass) - 1, 0, -1):  # parents come before their children
        if parent[j] >= 0:
            mass[parent[j]] += mass[j]
    return Tree(
        parent=parent,
        mass=mass,
        gravity=np.array(twin.model.gravity.linear),
        armature=twin.armature.copy(),
        held_inertia=np.zeros(twin.nv),
        first_freedom=np.searchsorted(joint, np.arange(twin.n_joints + 1)).astype(np.int64),
        freedom_velocity=np.array(column, dtype=np.int64),
        twist=np.array(twist, dtype=float).reshape(-1, 6),
        unit_first=unit_first,
        unit_count=unit_count,
    )


class Links(NamedTuple):
    """What wrenches from outside act through, see `relieve`; the first row of R, p, force: ground.

    Attributes:
        parent: (nj,), -1: the ground. R, p: (1 + nj, 3, 3), (1 + nj, 3) of each joint's child in
            the frame of its parent's. force, h: see `PinocchioData`.
        v_index, ratio, axis, components: (nj,), (nj,), (nj, 6), (nj, 6) of the twin.
    """

    parent: np.ndarray
    R: np.ndarray
    p: np.ndarray
    force: np.ndarray
    h: np.ndarray
    v_index: np.ndarray
    ratio: np.ndarray
    axis: np.ndarray
    components: np.ndarray


record(Links)


@kernel
def relieve(links: Links, row: np.ndarray, action: np.ndarray, wrench: np.ndarray) -> bool:
    """Let wrenches on links relieve the joints that carry them; False where one is impossible.

    Args:
        links: `force` and `h` are changed.
        row: (k,) joint whose child each acts on, -1: the ground.
        action: (k, 6, 6) from the axes of each wrench to those of the joint's child.
        wrench: (k, 6) N, N m, linear first.
    """
    for k in range(row.size):
        for e in range(6):
            if not abs(wrench[k, e]) <= LARGEST_OF_A_MOTION:
                return False
    f, moved = np.empty(6), np.empty(6)
    for k in range(row.size):
        for i in range(6):
            f[i] = 0.0
            for e in range(6):
                f[i] += action[k, i, e] * wrench[k, e]
        j = row[k]
        while j >= 0:
            first, sum_ = links.v_index[j], 0.0
            for e in range(6):
                links.force[j + 1, e] -= f[e]
                sum_ += links.axis[j, e] * f[e]
            if links.components[j, 0] < 0:
                links.h[first] -= links.ratio[j] * sum_
            else:
                for n in range(6):
                    if links.components[j, n] >= 0:
                        links.h[first + n] -= f[links.components[j, n]]
            R, p = links.R[j + 1], links.p[j + 1]
            for i in range(3):
                moved[i] = R[i, 0] * f[0] + R[i, 1] * f[1] + R[i, 2] * f[2]
                moved[3 + i] = R[i, 0] * f[3] + R[i, 1] * f[4] + R[i, 2] * f[5]
            f[0], f[1], f[2] = moved[0], moved[1], moved[2]
            f[3] = moved[3] + p[1] * moved[2] - p[2] * moved[1]
            f[4] = moved[4] + p[2] * moved[0] - p[0] * moved[2]
            f[5] = moved[5] + p[0] * moved[1] - p[1] * moved[0]
            j = links.parent[j]
    return True


_WORLD = pin.Convention.WORLD
#: The action of wrenches that stand in their joint's axes.
_THERE = np.eye(6)[None]


class Pinocchio:
    """Pinocchio's figures of one robot at the last state.

    Attributes:
        model, data: of Pinocchio.
        views: live ones of the data, the ground first.
        copies: of what has another memory layout, with where it comes from.
    """

    def __init__(self, twin: Twin) -> None:
        self.twin, self.model, self.data = twin, twin.model, twin.model.createData()
        self._zero = np.zeros(twin.nv)
        self.copies: list[tuple[np.ndarray, Sequence[np.ndarray]]] = []
        self._links: KernelArgument[Links] | None = None
        data, joints = self.data, range(twin.model.njoints)
        pin.crba(self.model, data, pin.neutral(self.model), _WORLD)
        lever = self._rows([data.oYcrb[j].lever for j in joints])
        self.views = PinocchioData(
            R=self._rows([data.oMi[j].rotation for j in joints]),
            p=self._rows([data.oMi[j].translation for j in joints]),
            velocity=self._rows([data.v[j].vector for j in joints]),
            acceleration=self._rows([data.a_gf[j].vector for j in joints]),
            force=self._rows([data.f[j].vector for j in joints]),
            lever=lever,
            inertia=self._inertias(lever),
            h=data.tau,
        )

    def at(self, q: np.ndarray, v: np.ndarray, applied: Sequence[AppliedWrench] | None) -> None:
        """Compute everything at one state (nq,), (nv,), under wrenches from outside."""
        pin.crba(self.model, self.data, q, _WORLD)
        pin.rnea(self.model, self.data, q, v, self._zero)
        if self.copies:
            self._copy()
        if applied or self.twin.springs is not None:
            self._load(q, applied or ())

    def balance(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, applied: Sequence[AppliedWrench] = ()
    ) -> None:
        """Compute the wrenches and, in `h`, the efforts of a motion without friction."""
        pin.rnea(self.model, self.data, q, v, a)
        if self.twin.springs is not None:
            pin.updateGlobalPlacements(self.model, self.data)
        if self.copies:
            self._copy()
        if applied or self.twin.springs is not None:
            self._load(q, applied)

    def move(self, q: np.ndarray, v: np.ndarray) -> None:
        """Compute poses and velocities only."""
        pin.forwardKinematics(self.model, self.data, q, v)
        self._copy()

    def _load(self, q: np.ndarray, applied: Sequence[AppliedWrench]) -> None:
        """Let wrenches from outside, and those of springs, relieve the joints."""
        acting = [(wrench.joint, wrench.wrench[0]) for wrench in applied]
        if (springs := self.twin.springs) is not None:
            moved = self.twin.displacements(springs.joint, q[None])
            R, p = self.views.R[None, 1:], self.views.p[None, 1:]
            acting += [(row, pull[0]) for row, pull in springs.wrenches(moved, p, R)]
        row, wrench = (np.array(column) for column in zip(*acting, strict=True))
        self.relieve(row, np.repeat(_THERE, len(row), axis=0), wrench)

    def relieve(self, row: np.ndarray, action: np.ndarray, wrench: np.ndarray) -> bool:
        """Let wrenches on links, at the last state, relieve the joints; see the kernel."""
        if self._links is None:
            data, joints, twin = self.data, range(self.model.njoints), self.twin
            links = Links(
                parent=tree_tables(twin)[0],
                R=self._rows([data.liMi[j].rotation for j in joints]),
                p=self._rows([data.liMi[j].translation for j in joints]),
                force=self.views.force,
                h=self.views.h,
                v_index=twin.v_index,
                ratio=twin.ratio,
                axis=twin.axis,
                components=twin.components,
            )
            if self.copies:
                self._copy()
            self._links = KernelArgument(links)
        return bool(relieve(self._links.now, row, action, wrench))

    def _rows(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """One array whose rows are the given ones of Pinocchio's memory, or follow them."""
        first = arrays[0]
        if (view := rows_of(arrays)) is not None:
            return view
        # of the same layout as the view would have: other types are other kernels
        wider = np.zeros((len(arrays), 2 * first.size))
        out = wider[:, : first.size] if first.size != 6 else np.zeros((len(arrays), 6))
        out = np.lib.stride_tricks.as_strided(
            out, (len(arrays), *first.shape), (out.strides[0], *first.strides)
        )
        self.copies.append((out, arrays))
        return out

    def _inertias(self, lever: np.ndarray) -> np.ndarray:
        """(1 + nj, 6) rotational inertias: they stand behind the levers, which is tested."""
        rows, columns = np.array([0, 1, 1, 2, 2, 2]), np.array([0, 0, 1, 0, 1, 2])
        inertias = np.array([y.inertia[rows, columns] for y in self.data.oYcrb])
        if not self.copies:
            behind = np.lib.stride_tricks.as_strided(lever, (len(inertias), 9), lever.strides)[
                :, 3:
            ]
            if np.array_equal(behind, inertias):
                return behind
        out = np.zeros((len(inertias), 9))[:, 3:]
        self.copies.append((out, _Inertias(self.data, rows, columns)))
        return out

    def _copy(self) -> None:
        for target, sources in self.copies:
            for row, source in enumerate(sources):
                target[row] = source


class _Inertias(Sequence[np.ndarray]):
    """Rotational inertias of a `Data`, read anew each time: they are no views."""

    def __init__(self, data: pin.Data, rows: np.ndarray, columns: np.ndarray) -> None:
        self.data, self.rows, self.columns = data, rows, columns

    def __len__(self) -> int:
        return len(self.data.oYcrb)

    def __getitem__(self, i: Any) -> Any:
        return self.data.oYcrb[i].inertia[self.rows, self.columns]
