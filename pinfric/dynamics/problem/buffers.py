"""What kernels work on (`machine`): a scene's tables, buffers, and views of Pinocchio's data.

Pinocchio keeps poses, velocities and wrenches of all joints one behind the other. Views of these
arrays stay live, so that nothing is copied from one state to the next; where a build of Pinocchio
lays them out otherwise, they are copied after every call.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.dynamics.problem.layout import Layout
from pinfric.dynamics.problem.machine import Supply, Tables, Work
from pinfric.dynamics.problem.reactions import AppliedWrench
from pinfric.dynamics.problem.states import unit_parts
from pinfric.friction.modes import Modes
from pinfric.friction.problem import empty_problem
from pinfric.model.closure import actions_of
from pinfric.model.loops import Linkage, no_linkage
from pinfric.model.twin import Twin

_WORLD = pin.Convention.WORLD


class Supplier:
    """Pinocchio's figures of one robot at the state asked for last.

    Attributes:
        model, data: of Pinocchio.
        supply: live views of the data, the ground first.
    """

    def __init__(self, twin: Twin) -> None:
        self.twin, self.model, self.data = twin, twin.model, twin.model.createData()
        self._zero = np.zeros(twin.nv)
        self._copies: list[tuple[np.ndarray, Sequence[np.ndarray]]] = []
        data, joints = self.data, range(twin.model.njoints)
        pin.crba(self.model, data, pin.neutral(self.model), _WORLD)
        lever = self._rows([data.oYcrb[j].lever for j in joints])
        self.supply = Supply(
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
        if self._copies:
            self._copy()
        if applied:
            for wrench in applied:
                self._subtract(wrench.joint, wrench.wrench[0])

    def balance(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> None:
        """Compute the wrenches and, in `h`, the efforts that a motion takes without friction."""
        pin.rnea(self.model, self.data, q, v, a)
        if self._copies:
            self._copy()

    def move(self, q: np.ndarray, v: np.ndarray) -> None:
        """Compute poses and velocities only."""
        pin.forwardKinematics(self.model, self.data, q, v)
        self._copy()

    def _subtract(self, row: int, wrench: np.ndarray) -> None:
        """Let a wrench on a link, in its joint's frame, relieve the joints that carry it."""
        twin, h, force = self.twin, self.supply.h, pin.Force(wrench)
        while row >= 0:
            f = force.vector
            self.supply.force[row + 1] -= f
            first = twin.v_index[row]
            if twin.components[row, 0] < 0:
                h[first] -= twin.ratio[row] * (twin.axis[row] @ f)
            else:
                moved = twin.components[row][twin.components[row] >= 0]
                h[first : first + len(moved)] -= f[moved]
            force = self.data.liMi[row + 1].act(force)
            row = self.model.parents[row + 1] - 1

    def _rows(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """One array whose rows are the given ones of Pinocchio's memory, or follow them."""
        places = np.diff([x.__array_interface__["data"][0] for x in arrays])
        first = arrays[0]
        if (places == places[:1]).all() and (places > 0).all():
            strides = (int(places[0]) if places.size else first.nbytes, *first.strides)
            return np.lib.stride_tricks.as_strided(first, (len(arrays), *first.shape), strides)
        # of the same layout as the view would have: other types are other kernels
        wider = np.zeros((len(arrays), 2 * first.size))
        out = wider[:, : first.size] if first.size != 6 else np.zeros((len(arrays), 6))
        out = np.lib.stride_tricks.as_strided(
            out, (len(arrays), *first.shape), (out.strides[0], *first.strides)
        )
        self._copies.append((out, arrays))
        return out

    def _inertias(self, lever: np.ndarray) -> np.ndarray:
        """(nj, 6) rotational inertias: they stand behind the levers, which is put to the test."""
        rows, columns = np.array([0, 1, 1, 2, 2, 2]), np.array([0, 0, 1, 0, 1, 2])
        given = np.array([y.inertia[rows, columns] for y in self.data.oYcrb])
        if not self._copies:
            behind = np.lib.stride_tricks.as_strided(lever, (len(given), 9), lever.strides)[:, 3:]
            if np.array_equal(behind, given):
                return behind
        out = np.zeros((len(given), 9))[:, 3:]
        self._copies.append((out, _Inertias(self.data, rows, columns)))
        return out

    def _copy(self) -> None:
        for target, sources in self._copies:
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


def make_tables(twin: Twin, linkage: Linkage | None, layout: Layout) -> Tables:
    """Tabulate a scene, with the masses of one payload, for the kernels."""
    model, nj = twin.model, twin.n_joints
    unit_q, unit_count = unit_parts(model)
    parent = np.array(list(model.parents)[1:], dtype=np.int64) - 1
    mass = np.array([y.mass for y in model.inertias[1:]]).reshape(nj)
    for j in range(nj - 1, 0, -1):  # parents come before their children
        if parent[j] >= 0:
            mass[parent[j]] += mass[j]
    freedoms = _freedoms(twin)
    actions = actions_of(twin, linkage or no_linkage(twin.model))
    closed = linkage is not None and linkage.multipliers > 0
    # where multipliers are shared all joints are wanted, and first
    rows = np.union1d(np.arange(layout.sharing) if closed else [], layout.joint).astype(np.int64)
    row_of = np.full(nj + len(actions.pair_kind), -1, dtype=np.int64)
    row_of[rows] = np.arange(len(rows))
    chosen = [
        (e, i)
        for e, s in enumerate(layout.entry_site)
        for i in np.flatnonzero(layout.contact_site == s)
        if layout.rubs[s]
    ]
    entry = np.array([e for e, _ in chosen], dtype=np.int64)
    contact = np.array([i for _, i in chosen], dtype=np.int64)
    kinds = [] if linkage is None else [loop.kind for loop in linkage.loops]
    direction_size = np.zeros(len(layout.coordinate_v))
    for c, action in enumerate(layout.coordinate_action):
        if action >= 0 and (action < layout.off_joint or actions.unit[action, :3].any()):
            direction_size[c] = layout.scale
    return Tables(
        layout=layout,
        parent=parent,
        mass=mass,
        gravity=np.array(model.gravity.linear),
        **freedoms,
        armature=twin.armature,
        unit_q=unit_q,
        unit_count=unit_count,
        wrench_row=rows,
        contact_row=row_of[layout.joint[layout.entry_site[entry]]],
        contact_site=entry,
        contact_rank=layout.contact_rank[contact],
        contact_map=layout.contact_map[contact],
        contact_map_moved=layout.contact_map_moved[contact],
        site_row=row_of[layout.joint],
        actions=actions,
        planar=np.array([kind == "planar_pin" for kind in kinds], dtype=bool),
        direction_size=direction_size,
        multipliers=layout.solved - layout.off_joint,
        dependent=layout.solved > layout.off_joint or layout.off_joints,
    )


def _freedoms(twin: Twin) -> dict[str, np.ndarray]:
    """Joint, velocity, ratio and axis of every motion that a joint can do; mimics' joints too."""
    found: list[tuple[int, int, float, np.ndarray]] = []
    for j in range(twin.n_joints):
        if twin.components[j, 0] < 0:
            found.append((j, int(twin.v_index[j]), float(twin.ratio[j]), twin.axis[j]))
            continue
        for n, component in enumerate(c for c in twin.components[j] if c >= 0):
            found.append((j, int(twin.v_index[j]) + n, 1.0, np.eye(6)[component]))
    return {
        "first_freedom": np.searchsorted([j for j, *_ in found], np.arange(twin.n_joints + 1)),
        "freedom_v": np.array([f[1] for f in found], dtype=np.int64),
        "freedom_ratio": np.array([f[2] for f in found], dtype=float),
        "freedom_axis": np.array([f[3] for f in found], dtype=float).reshape(-1, 6),
    }


def make_work(twin: Twin, layout: Layout, tables: Tables) -> Work:
    """Make the buffers of a scene."""
    nc, na = len(layout.coordinate_v), len(layout.drive_v)
    geared = layout.gear_coordinate[layout.gear_coordinate >= 0]
    problem = empty_problem(
        np.concatenate([layout.entry_coordinate, geared]),
        np.concatenate([layout.entry_ratio, np.ones(len(geared))]),
        tables.contact_site,
        np.concatenate([layout.constant[layout.entry_site], np.zeros(len(geared))]),
    )
    ne = len(problem.coordinate)
    shapes = _shapes_of_motion(twin, tables) | _shapes_of_solution(twin, layout, tables, ne)
    return Work(
        **{name: np.zeros(shape) for name, shape in shapes.items()},
        D=layout.coordinate_row.copy(),
        S=layout.drive_row.copy(),
        Z=np.eye(twin.nv),
        idle=np.zeros(nc, dtype=bool),
        freedoms=np.zeros(1, dtype=np.int64),
        modes=Modes.of(nc, ne),
        site_modes=np.zeros(len(layout.joint), dtype=np.int8),
        slope=np.ones(na),
        locking=np.zeros(1, dtype=np.int64),
        problem=problem,
    )


def _shapes_of_motion(twin: Twin, tables: Tables) -> dict[str, tuple[int, ...]]:
    """Shapes of what a state of motion fills: poses, velocities, what actions do."""
    nv, nj, nx = twin.nv, twin.n_joints, len(tables.actions.column_pair)
    pairs, nf = len(tables.actions.pair_kind), len(tables.freedom_v)
    return {
        "R": (1, nj, 3, 3),
        "p": (1, nj, 3),
        "velocity": (1, nj, 6),
        "acceleration": (1, nj, 6),
        "motion": (nf, 6),
        "momentum": (nf, 6),
        "X": (1, nj + pairs, 6, nx),
        "J": (1, nx, nv),
        "gap": (1, nx),
        "rate": (1, nx),
        "rate_derivative": (1, nx),
        "tilt": (1, pairs),
        "terms": (1, pairs, 2),
    }


def _shapes_of_solution(
    twin: Twin, layout: Layout, tables: Tables, ne: int
) -> dict[str, tuple[int, ...]]:
    """Shapes of the affine maps of friction and of the solution, with ne laws of friction."""
    nv, nj, ns, nl = twin.nv, twin.n_joints, len(layout.joint), tables.multipliers
    nc, na, rows = len(layout.coordinate_v), len(layout.drive_v), len(tables.wrench_row)
    return {
        "M": (nv, nv),
        "factor": (nv, nc),
        "a_map": (nv, 1 + nc),
        "multiplier_map": (nl, 1 + nc),
        "wrench_map": (rows, 6, 1 + nc),
        "coordinate_rate": (nc,),
        "drag": (nc,),
        "damping": (nc,),
        "given": (nv,),
        "size": (nv,),
        "push": (nv,),
        "a_closure": (nv,),
        "lower": (nv, nv),
        "right": (nv, 1 + nc),
        "below": (nj, 1 + nc, 6),
        "above": (nj, 1 + nc, 6),
        "row": (6,),
        "least": (nc,),
        "most": (nc,),
        "a": (nv,),
        "effort": (na,),
        "phi": (ns,),
        "load": (ns,),
        "wrench": (ns, 6),
        "multiplier": (nl,),
        "entry_phi": (ne,),
        "gear_way": (na,),
        "delivered": (na,),
        "delivered_map": (na, 1 + nc),
        "offset": (na,),
        "reflected": (na,),
        "line": (na, 2),
        "held": (na, 2),
        "arriving": (na,),
        "push_size": (1,),
    }
