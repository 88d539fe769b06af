"""Dynamics of one state at a time for control loops: prepared once, results in the same memory.

    u = M a + h - D phi     (paper eq. 16, 17; at rest eq. 21, 22),     a = M^-1 (u - h + D phi)

In an open chain with joint drives Pinocchio's RNEA computes the wrenches of all joints; one kernel
then computes loads, friction and efforts. Where reactions and friction are coupled, inverse
dynamics is that of a batch of one sample.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.derivatives.derivatives import (
    Differentiator,
    ForwardDerivatives,
    InverseDerivatives,
    check_differentiable,
)
from pinfric.dynamics.derivatives.parameters import ParameterDerivatives, by_parameters
from pinfric.dynamics.derivatives.smoothed import Smoothed
from pinfric.dynamics.forward.compensation import (
    CompensatedSample,
    CompensationOptions,
    Travelled,
    box_compensated,
    check_reach,
    check_used,
    compensate_sample,
    make_compensated,
    quiet_options,
    reach,
)
from pinfric.dynamics.forward.forward import Instant, checked_state, solution, solve_checked
from pinfric.dynamics.forward.workspace import Workspace, closed_configuration, rehearse
from pinfric.dynamics.inverse.linkage import solve_linkage
from pinfric.dynamics.inverse.tree import check_finite, solve_tree
from pinfric.dynamics.inverse.undriven import check_shares, negligible_efforts
from pinfric.dynamics.problem.accelerations import is_normalized
from pinfric.dynamics.problem.machine import ChainState, read_sites
from pinfric.dynamics.samples.motion_kernels import TreeSamples, bound_within
from pinfric.dynamics.samples.outcome import Status
from pinfric.dynamics.samples.reactions import AppliedWrench, applied_wrenches, external_frame
from pinfric.dynamics.samples.states import States, one_of, vector
from pinfric.errors import PinfricError, StateError, one_line
from pinfric.kernels.compiled import compile_for, compiling, entry_point, kernel
from pinfric.kernels.records import record
from pinfric.model.arrays import real_numbers
from pinfric.model.drives import Gears, joint_effort_ends, write_motor_torques
from pinfric.model.entry import parse
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION
from pinfric.model.scene import Scene, SiteTables, expect_scene, payload_names
from pinfric.model.schema import Friction

#: Of an array of floats that lie next to each other: what kernels and Pinocchio take as it is.
_FLOAT, _NEXT = np.dtype(float), (8,)
#: Of `Solver._compensate`: the names of a motion's parts, and of a measured one's.
_MOTION = ("v", "a", "v_ref", "error", "v_now")
_MEASURED = ("v", "a", "v_now", "error", "v_now")
_DEFAULT = CompensationOptions()
_FLAGS = {flags: np.array(flags) for flags in product((False, True), repeat=4)}


class InverseInstant(NamedTuple):
    """The efforts of a motion at one state; fields as in `InverseResult`, without its first axis.

    So efforts are (na,), what belongs to sites (ns,), and `wrench` is (ns, 6).

    Attributes:
        joint_effort_lower, joint_effort_upper: (na,) motors' torques seen from the joints, ratio x
            motor_torque: all that a torque command there contains.
        gear_ratio: (na,) of the drives.
        status: `Status`; always `CONVERGED` unless reactions and friction are coupled.
    """

    effort_lower: np.ndarray
    effort_upper: np.ndarray
    effort_frictionless: np.ndarray
    motor_torque_lower: np.ndarray
    motor_torque_upper: np.ndarray
    sticking: np.ndarray
    normal_load: np.ndarray
    friction_lower: np.ndarray
    friction_upper: np.ndarray
    wrench: np.ndarray
    gear_ratio: np.ndarray
    status: Status

    @property
    def joint_effort_lower(self) -> np.ndarray:
        """(na,) least `joint_effort` (N m or N), a new array."""
        return self._joint_effort[0]

    @property
    def joint_effort_upper(self) -> np.ndarray:
        """(na,) greatest `joint_effort`, a new array."""
        return self._joint_effort[1]

    @property
    def _joint_effort(self) -> tuple[np.ndarray, np.ndarray]:
        torques = self.motor_torque_lower, self.motor_torque_upper
        return joint_effort_ends(self.gear_ratio, *torques)


class Sample(NamedTuple):
    """One sample of an open chain: its state, the tables of its scene, and the results.

    Attributes:
        q, v, a: (nq,), (1, nv), (1, nv).
        chain: of the last RNEA.
        sites: `Scene.site_tables`, `joint` the row of the site itself. gears: of its drives.
        geared: (1,) bool, whether a drive has a gear.
        turns: (1, na), False: no reversals.
        found: of this sample. wrench: (1, ns, 6).
        drive: (na,) velocity of each. undriven, slack: (nu,) the others, which have no friction,
            and the effort there that counts as none.
        moved: (2, 1, na) velocities and accelerations of the drives.
        effort_frictionless, effort_lower, effort_upper: (1, na); those of `found` where every
            degree of freedom has a drive.
        motor_torque_lower, motor_torque_upper: (1, na).
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    chain: ChainState
    sites: SiteTables
    gears: Gears
    geared: np.ndarray
    turns: np.ndarray
    found: TreeSamples
    wrench: np.ndarray
    drive: np.ndarray
    undriven: np.ndarray
    slack: np.ndarray
    moved: np.ndarray
    effort_frictionless: np.ndarray
    effort_lower: np.ndarray
    effort_upper: np.ndarray
    motor_torque_lower: np.ndarray
    motor_torque_upper: np.ndarray


box_sample = record(Sample)


@kernel
def is_valid(x: Sample) -> bool:
    """Return whether q, v, a are finite and not impossibly large, and q is on its manifold."""
    for i in range(x.q.size):
        if not abs(x.q[i]) <= LARGEST_OF_A_MOTION:
            return False
    for i in range(x.v.size):
        if not (abs(x.v[0, i]) <= LARGEST_OF_A_MOTION and abs(x.a[0, i]) <= LARGEST_OF_A_MOTION):
            return False
    chain = x.chain
    return is_normalized(chain.unit_first, chain.unit_count, x.q)


@kernel
def finish_sample(x: Sample, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> bool:
    """Write loads, friction, efforts and motor torques of the last motion that RNEA computed.

    Args:
        x: q (nq,), v and a (nv,) of the motion are kept in it.

    Returns:
        False: an invalid state (`is_valid`), an overflow, or possibly an effort where no drive is.
    """
    found, chain, wrench = x.found, x.chain, x.wrench  # arrays of a record are counted every time
    for i in range(q.size):
        x.q[i] = q[i]
    for i in range(v.size):
        x.v[0, i], x.a[0, i] = v[i], a[i]
    for s in range(chain.joint.size):
        found.velocity[0, s] = x.v[0, x.sites.velocity_index[s]] * x.sites.ratio[s]
    read_sites(chain, q, wrench[0], found.displacement[0])
    for i in range(v.size):
        found.effort_frictionless[0, i] = chain.h[i]
    bound_within(x.sites, wrench, found)
    lower, upper, v_drive, a_drive = found.effort_lower, found.effort_upper, x.v, x.a
    finite = True
    if x.undriven.size > 0:
        for k in range(x.undriven.size):
            least, most = lower[0, x.undriven[k]], upper[0, x.undriven[k]]
            finite &= least <= x.slack[k] and most >= -x.slack[k]
        lower, upper, v_drive, a_drive = x.effort_lower, x.effort_upper, x.moved[0], x.moved[1]
        for d in range(x.drive.size):
            c = x.drive[d]
            lower[0, d], upper[0, d] = found.effort_lower[0, c], found.effort_upper[0, c]
            x.effort_frictionless[0, d] = found.effort_frictionless[0, c]
            v_drive[0, d], a_drive[0, d] = x.v[0, c], x.a[0, c]
    motor_lower, motor_upper = x.motor_torque_lower, x.motor_torque_upper
    if x.geared[0]:
        write_motor_torques(
            x.gears, lower, upper, v_drive, a_drive, x.turns, motor_lower, motor_upper
        )
    for d in range(lower.size):
        finite &= abs(lower[0, d] + upper[0, d]) < np.inf
        finite &= abs(motor_lower[0, d] + motor_upper[0, d]) < np.inf
    return finite and is_valid(x)


def make_sample(ws: Workspace, scene: Scene) -> Sample:
    """Make the buffers of one sample of an open chain, on the Pinocchio data of a workspace."""
    ns, na = len(scene.sites), len(scene.drives)
    effort, motor = np.zeros((3, 1, ws.nv)), np.zeros((2, 1, na))
    own = np.zeros((3, 1, na)) if scene.mobility.undriven else effort
    of_sites, flags = np.zeros((5, 1, ns)), np.zeros((2, 1, ns), dtype=bool)
    geared = any(drive.transmission for drive in scene.drives)
    return Sample(
        q=np.zeros(ws.nq),
        v=np.zeros((1, ws.nv)),
        a=np.zeros((1, ws.nv)),
        chain=ChainState.of(ws.machine),
        sites=scene.site_tables._replace(joint=np.arange(ns)),
        gears=scene.gears(brakes=False),
        geared=np.array([geared]),
        turns=np.zeros((1, na), dtype=bool),
        found=TreeSamples._make(
            [of_sites[0], flags[0], of_sites[1], *effort, *of_sites[2:], flags[1]]
        ),
        wrench=np.zeros((1, ns, 6)),
        drive=np.array([drive.velocity_index for drive in scene.drives], dtype=np.int64),
        undriven=np.array(scene.mobility.undriven, dtype=np.int64),
        slack=negligible_efforts(scene),
        moved=np.zeros((2, 1, na)),
        effort_frictionless=own[0],
        effort_lower=own[1],
        effort_upper=own[2],
        motor_torque_lower=motor[0] if geared else own[1],
        motor_torque_upper=motor[1] if geared else own[2],
    )


class _Sample:
    """A sample, the views of its state, the kernel, what it takes, and what `inverse` returns."""

    def __init__(self, ws: Workspace, scene: Scene) -> None:
        self.whole = x = make_sample(ws, scene)
        self.q, self.v, self.a = x.q, x.v[0], x.a[0]
        self.argument, one = box_sample(x), np.zeros(ws.nv)
        self.finish = entry_point(finish_sample, self.argument, self.q, one, one)
        fields = x.found._asdict() | x._asdict()
        figures = {name: fields[name][0] for name in InverseInstant._fields[:-2]}
        self.found = InverseInstant(**figures, gear_ratio=x.gears.ratio, status=Status.CONVERGED)


def compensated_sample(ws: Workspace, scene: Scene) -> CompensatedSample:
    """Return what the kernel of `compensate` takes; it reads the workspace's last RNEA.

    Args:
        ws: computes reactions; it may be that of the scene with other friction.
        scene: with the friction that is compensated.
    """
    position, circle = np.full((2, ws.nv), -1)
    for joint in list(scene.model.joints)[1:]:
        if joint.nv == 1:
            (position if joint.nq == 1 else circle)[joint.idx_v] = joint.idx_q
    ns = len(scene.sites)
    return CompensatedSample(
        tables=make_compensated(scene),
        chain=ChainState.of(ws.machine),
        reach=reach(scene),
        position=position,
        circle=circle,
        travelled=Travelled.none(ws.nq, len(scene.drives)),
        wrench=np.zeros((1, ns, 6)),
        displacement=np.zeros((1, ns)),
        load=np.zeros((1, ns)),
    )


def compensated_states(
    scene: Scene, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> list[np.ndarray]:
    """Return `Solver.compensate` (na,) of a few states at their own velocities; compiles nothing.

    Args:
        scene: that a solver compensates.
        q, v, a: (n, nq), (n, nv), (n, nv).
    """
    ws = Workspace(scene, None)
    x, (rows, _), still = compensated_sample(ws, scene), _DEFAULT.tables(scene), np.zeros(ws.nv)
    flags, friction = _FLAGS[(False,) * 4], np.empty((len(q), len(scene.drives)))
    for state, out in zip(zip(q, v, a, strict=True), friction, strict=True):
        ws.pinocchio.balance(*state)
        compensate_sample(x, *state, state[1], still, still, state[0], flags, rows, out)
    return list(friction)


class _Compensated:
    """What the kernel of `compensate` takes, and the compiled options of the last call."""

    def __init__(self, ws: Workspace, scene: Scene) -> None:
        sample = compensated_sample(ws, scene)
        self.reach, self.argument = sample.reach, box_compensated(sample)
        self.travelled = sample.travelled
        self.still, self.na = np.zeros(ws.nv), len(scene.drives)
        self._scene, self._options = scene, _DEFAULT
        self._rows = self._tables(self._options)

    def rows(self, options: CompensationOptions, measured: bool) -> tuple[np.ndarray, bool]:
        """Return the options as rows, and whether they need what is measured."""
        if options is not self._options:
            tables = self._tables(options)
            if any(isinstance(value, np.ndarray | list) for value in vars(options).values()):
                return tables[1] if measured else tables[0], tables[2]  # it may change
            self._options, self._rows = options, tables
        desired, own, needs_measured = self._rows
        return own if measured else desired, needs_measured

    def _tables(self, options: CompensationOptions) -> tuple[np.ndarray, np.ndarray, bool]:
        if not isinstance(options, CompensationOptions):
            raise StateError(
                f"options: should be a pf.CompensationOptions(...); found {one_line(repr(options))}"
            )
        desired, measured = options.tables(self._scene)
        needs_measured = (desired[3] > 0.0).any() or (desired[5] < np.inf).any()
        return desired, measured, bool(needs_measured)


class _Buffers(threading.local):
    """What a solver computes in: each thread has its own; each is made at its first use.

    Attributes:
        both: the workspace, and where each drive has its own joint a sample. A solver of other
            friction computes reactions in the workspace of the one it was made of.
        given: the workspaces where efforts (False) and motors' torques (True) are given.
        compensated: of `compensate`.
        derived: derivatives in these two workspaces.
    """

    def __init__(
        self, scene: Scene, carried: tuple[str, ...] | None, base: _Buffers | None = None
    ) -> None:
        ws = Workspace(scene, carried) if base is None else base.both[0]
        self.given = {False: ws} if base is None else {}
        if base is None:
            ws.call_directly()
        rubs = np.isin(scene.site_tables.velocity_index, scene.mobility.undriven).any()
        sample = _Sample(ws, scene) if scene.own_drives and not rubs else None
        self.both: tuple[Workspace, _Sample | None] = ws, sample
        self.compensated: _Compensated | None = None
        self.derived: dict[bool, Differentiator] = {}


class Solver:
    """Inverse and forward dynamics of one scene, one state at a time.

    For controllers, optimizers and integrators. When the solver is made, the kernels of `inverse`
    and `forward` are compiled, which takes a minute or two with an empty cache; that of
    `compensate` at its first call. The next call of the same thread overwrites the arrays of a
    result: copy those that you want to keep. Later changes of `scene.model` do not affect the
    solver.

    Attributes:
        scene: the scene, unchanged since.

    Args:
        scene: the robot with its friction and drives.
        attached: names of the payloads carried; None takes those attached by default.

    Raises:
        SceneError: an unknown payload.
    """

    def __init__(self, scene: Scene, attached: Iterable[str] | None = None) -> None:
        expect_scene(scene, "Solver")
        self.scene = scene.with_()
        self._carried = payload_names(attached)
        self._frames: dict[tuple[str, ...], tuple[np.ndarray, np.ndarray]] = {}
        with compiling():
            self._own = _Buffers(self.scene, self._carried)
            self._rehearse()

    def __repr__(self) -> str:
        carries = f", carries {', '.join(self._carried)}" if self._carried else ""
        return f"<Solver of {repr(self.scene).partition(chr(10))[0]}{carries}>"

    def _rehearse(self) -> None:
        """Compile what the solver's methods call."""
        rehearse(Workspace(self.scene, self._carried))
        ws, x = self._own.both
        if x is not None:
            for name in self.scene.joint_names[-1:]:
                self._balance(ws, x.q, x.v, x.a, {name: np.zeros(6)})
            return
        q, a = closed_configuration(self.scene), np.zeros(ws.nv)
        push = [AppliedWrench(0, np.zeros((1, 6)))]
        for speed, applied in ((0.0, []), (1.0, []), (1.0, push)):
            with suppress(PinfricError):  # a motion that its loops or drives do not allow
                self._inverse_of_batch(q, a + speed, a, applied)

    def with_friction(self, friction: Mapping[str, Any]) -> Solver:
        """Return a solver of the same robot with other friction, e.g. of a random draw.

        Where only coefficients of joints that rub change, in an open chain, it takes some 0.2 ms:
        kernels, reactions and the robot are those of this solver. Where a joint gains or loses its
        friction or has another `bearing`, or there are loops, the solver is made anew, which takes
        tens of milliseconds.

        Args:
            friction: joint -> friction, as `Friction` or as the mapping of a scene file; the other
                joints keep theirs.

        Raises:
            SceneError: an unknown joint, or an impossible entry.
        """
        scene, at = self.scene, ("friction",)
        entries = {
            name: parse(Friction, entry, scene.source, at=(*at, name))
            for name, entry in friction.items()
        }
        changed = scene.with_coefficients(entries)
        if changed is None:
            return Solver(scene.with_(friction={**scene.friction, **entries}), self._carried)
        solver = object.__new__(Solver)
        solver.scene, solver._carried, solver._frames = changed, self._carried, self._frames
        solver._own = _Buffers(changed, self._carried, self._own)
        return solver

    def __reduce__(self) -> tuple[Any, ...]:
        return Solver, (self.scene, self._carried)  # another process makes buffers of its own

    def inverse(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        *,
        external: Mapping[str, np.ndarray] | None = None,
    ) -> InverseInstant:
        """Return the efforts of a motion with friction: intervals where joints stick.

        M a + h - J_ext^T f_ext = S u + J_c^T lambda + D phi (paper eq. 16, 17; at rest eq. 21, 22);
        `inverse_dynamics` of one state without times.

        Args:
            q, v, a: (nq,), (nv,), (nv,) in rad, m and per second.
            external: frame name -> (6,) wrench on it, in its axes at its origin (N, N m).

        Returns:
            Views that the next call overwrites; if efforts are NaN, `status` gives the reason.

        Raises:
            See `inverse_dynamics`.
        """
        ws, x = self._own.both
        if x is None:
            applied = [] if external is None else applied_wrenches(self.scene, external, 1)
            return self._inverse_of_batch(q, v, a, applied)
        if not (
            type(q) is type(v) is type(a) is np.ndarray
            and q.dtype is v.dtype is a.dtype is _FLOAT
            and q.strides == v.strides == a.strides == _NEXT
            and q.shape == ws.shapes[0]
            and v.shape == a.shape == ws.shapes[1]
        ):
            q = vector("q", q, ws.nq, "nq", self.scene.model)
            v, a = vector("v", v, ws.nv, "nv"), vector("a", a, ws.nv, "nv")
        self._balance(ws, q, v, a, external)
        while not x.finish(x.argument, q, v, a):
            if self.scene.mobility.undriven:  # says what is wrong, or that it is rounding
                applied = [] if external is None else applied_wrenches(self.scene, external, 1)
                return self._inverse_of_batch(q, v, a, applied)
            q = self._normalize(x)
            self._balance(ws, q, v, a, external)
        if ws.failures.guides:
            ws.failures.check_roll_moments(x.found.wrench)
        return x.found

    def _balance(
        self,
        ws: Workspace,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        external: Mapping[str, np.ndarray] | None,
    ) -> None:
        """Compute wrenches and efforts without friction, see `Pinocchio.balance`."""
        ws.pinocchio.balance(q, v, a)
        if external is None:
            return
        if not isinstance(external, Mapping):
            applied_wrenches(self.scene, external, 1)  # refuses it
        if not external:
            return
        names, wrench = tuple(external), np.empty((len(external), 6))
        row, action = self._frames.get(names) or self._add_frames(names)
        for k, given in enumerate(external.values()):
            if type(given) is not np.ndarray or given.shape != (6,):
                applied_wrenches(self.scene, external, 1)  # refuses it
            wrench[k] = given
        if not ws.pinocchio.relieve(row, action, wrench):
            applied_wrenches(self.scene, external, 1)

    def _add_frames(self, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Remember frames on which wrenches act: rows of joints, actions (k, 6, 6) to these."""
        frames = [external_frame(self.scene, name) for name in names]
        row = np.array([frame.parentJoint - 1 for frame in frames], dtype=np.int64)
        action = np.array([frame.placement.toDualActionMatrix() for frame in frames])
        self._frames[names] = found = row, action.reshape(-1, 6, 6)
        return found

    def _inverse_of_batch(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, applied: list[AppliedWrench]
    ) -> InverseInstant:
        attached = None
        if self._carried is not None:
            attached = np.array([[name in self._carried for name in self.scene.payloads]])
        states = States.of(self.scene, q, v, a, None, attached)
        check_shares(self.scene)
        solve = solve_tree if self.scene.linkage is None else solve_linkage
        batch = solve(self.scene, states, applied, slice(0, 1), 1)
        if batch.wrench is None:  # nothing depends on reactions, and nothing is applied
            ws, _ = self._own.both
            ws.pinocchio.balance(states.q[0], states.v[0], states.a[0])
            wrench = ws.pinocchio.views.force[1 + ws.plan.sites.joint]
            batch = replace(batch, wrench=wrench[None])
        figures = {name: getattr(batch, name)[0] for name in InverseInstant._fields[:-2]}
        ratio = np.array([drive.ratio for drive in self.scene.drives])
        return InverseInstant(**figures, gear_ratio=ratio, status=Status(batch.status[0]))

    def forward(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray | Mapping[str, float] | None = None,
        *,
        motor_torque: np.ndarray | Mapping[str, float] | None = None,
        external: Mapping[str, np.ndarray] | None = None,
    ) -> Instant:
        """Return the accelerations, modes and friction that efforts cause.

        a = M^-1 (u - h + J_ext^T f_ext + D phi) (paper eq. 3, 20, 21); as `forward_dynamics`.

        Args:
            q, v, effort, motor_torque, external: see `forward_dynamics`, of one state.

        Returns:
            `a` is an array of its own; the others are views that the next call overwrites.

        Raises:
            See `forward_dynamics`.
        """
        given = effort if motor_torque is None else motor_torque
        if (effort is None) == (motor_torque is None):
            one_of("Solver.forward", effort, motor_torque)  # refuses it
        ws = self._own.given.get(effort is None) or self._workspace(effort is None)
        applied = None if external is None else applied_wrenches(self.scene, external, 1)
        if (
            type(q) is type(v) is type(given) is np.ndarray
            and q.dtype is v.dtype is given.dtype is _FLOAT
            and q.strides == v.strides == given.strides == _NEXT
            and (q.shape, v.shape, given.shape) == ws.shapes
        ):
            solve_checked(ws, q, v, given if effort is not None else ws.ratio * given, applied)
        else:
            solve_checked(ws, *checked_state(ws, q, v, given), applied)
        return solution(ws)

    def inverse_derivatives(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        *,
        external: Mapping[str, np.ndarray] | None = None,
    ) -> InverseDerivatives:
        """Return the derivatives of the efforts of a motion by q, v and a.

        du = dtau_id - D ((dphi/dc) dc + (dphi/dv) dv), with c the load of each joint, exact in the
        modes of the state; see `derivatives.wrenches` and `derivatives.efforts`. Where a joint
        rests, its efforts have two ends, and dtau_dv is 0. The kernel is compiled at the first
        call.

        Args:
            q, v, a: (nq,), (nv,), (nv,) in rad, m and per second.
            external: frame name -> (6,) wrench on it, in its axes at its origin (N, N m), held
                constant there.

        Returns:
            Arrays that the next call overwrites.

        Raises:
            SceneError: loops or drives off the joints; redundant drives without shares.
            StateError: not real numbers, a wrong shape, a value not finite.
            RollMomentError: a guide without width is loaded by a moment about its axis.
        """
        derived = self._differentiator(motors=False)
        return derived.at(*derived.checked(external, q, v, a))

    def forward_derivatives(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray | Mapping[str, float] | None = None,
        *,
        motor_torque: np.ndarray | Mapping[str, float] | None = None,
        external: Mapping[str, np.ndarray] | None = None,
    ) -> ForwardDerivatives:
        """Return the accelerations that efforts cause, and their derivatives in the modes found.

        da_s = U_a[s,s]^-1 (du_s - U_q dq - U_v dv), with U_q, U_v, U_a the derivatives of the
        efforts in these modes and s what slips; what sticks has rows of 0. A mode does not change
        with the state: an optimizer never learns from them to break away (`smoothed` does).

        Args:
            q, v, effort, motor_torque, external: see `forward`.

        Returns:
            Arrays that the next call overwrites.

        Raises:
            See `forward` and `inverse_derivatives`.
        """
        check_differentiable(self.scene)
        instant = self.forward(q, v, effort, motor_torque=motor_torque, external=external)
        motors = effort is None
        ws, derived = self._workspace(motors), self._differentiator(motors)
        applied, q, v = derived.checked(external, q, v)
        if ws.must_project:
            q = States.of(self.scene, q, v, instant.a).q[0]
        if ws.held.size:
            v = np.where(np.isin(np.arange(ws.nv), ws.held), 0.0, v)
        return derived.of_solution(applied, q, v, instant.a, ws.held, motors)

    def parameter_derivatives(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, names: Sequence[str]
    ) -> ParameterDerivatives:
        """Return the derivatives of efforts and motors' torques by coefficients and inertias.

        d tau/d theta = E^T W - ratio (dphi/dc) g . W_k; see `derivatives.parameters`.

        Args:
            q, v, a: see `inverse_derivatives`.
            names: keys of friction, "mu.kinetic", "coulomb.static", "viscous" ..., of each joint
                that has it; "inertia": m, m c and the inertia about its joint, of each link. Of
                gears "loss.driving", "loss.driven", by the slope of the loss where the motor or
                the load drives (1/efficiency - 1, 1 - back_efficiency), "no_load_torque.static",
                "no_load_torque.kinetic", "motor_viscous", "rotor_inertia".

        Raises:
            StateError: nothing has such a coefficient; and see `inverse_derivatives`.
        """
        derived = self._differentiator(motors=False)
        applied, q, v, a = derived.checked(None, q, v, a)
        derived.at(applied, q, v, a)
        return by_parameters(derived, q, v, a, names)

    def smoothed(self, width: float) -> Smoothed:
        """Return the dynamics with friction that is smooth through rest, for optimizers.

        phi = -s(v/width) (mu c + coulomb) - drag, with s a polynomial: exact at |v| >= width.
        Below, efforts leave the intervals of exact joints at rest by at most `Smoothed.bound`. It
        is 0 where drag within the width is no more than static exceeds kinetic friction.

        Args:
            width: rad/s or m/s.

        Raises:
            StateError: a width of 0 or below. SceneError: see `inverse_derivatives`.
        """
        with compiling():
            ws = Workspace(self.scene, self._carried)
            derived = Differentiator(self.scene, ws.pinocchio, ws.machine, ws.argument)
        return Smoothed(derived, width, ws.held)

    def _workspace(self, motors: bool) -> Workspace:
        """The workspace for efforts, or for torques of motors, made at first."""
        workspaces = self._own.given
        if motors not in workspaces:
            with compiling():
                workspaces[motors] = Workspace(self.scene, self._carried, motors=motors)
                workspaces[motors].call_directly()
        return workspaces[motors]

    def _differentiator(self, motors: bool) -> Differentiator:
        """Derivatives in the workspace for efforts, or for torques of motors."""
        differentiators = self._own.derived
        if motors not in differentiators:
            ws = self._workspace(motors)
            with compiling():
                differentiators[motors] = Differentiator(
                    self.scene, ws.pinocchio, ws.machine, ws.argument
                )
        return differentiators[motors]

    def compensate(
        self,
        q: np.ndarray,
        v: np.ndarray | None,
        a: np.ndarray | None,
        v_ref: np.ndarray | None = None,
        *,
        q_ref: np.ndarray | None = None,
        error: np.ndarray | None = None,
        v_now: np.ndarray | None = None,
        options: CompensationOptions = _DEFAULT,
        external: Mapping[str, np.ndarray] | None = None,
    ) -> np.ndarray:
        """Return the friction at a desired velocity that a controller adds, under the state's load.

        out = scale D(v_ref) + viscous_scale (P drag + motor's drag)(v_ref); see `compensation`. The
        header of `pinfric export --to cpp` computes the same (`friction`). Where friction builds up
        over a way (`presliding`) its share follows the desired positions of this thread's calls,
        z <- clip(z + dq_ref/way, -1, 1), with no band of velocities; z = 0 at the first. Its
        kernels are compiled at the first call.

        Args:
            q, v, a: (nq,), (nv,), (nv,) state that determines the load; v, a None: gravity only.
            v_ref: (nv,) desired velocity; None: v. Of a measured one see `compensate_measured`.
            q_ref: (nq,) desired positions, each cycle, where q are not; None: q.
            error: (nv,) desired less actual position, for `hold_error`.
            v_now: (nv,) measured velocity, for `hold_error` and `power`.
            options: scales, band, hold, limits.
            external: link -> (6,) wrench on it, in its axes at its origin, linear first (N, N m).

        Returns:
            (na,) N m or N at the joints, a new array.

        Raises:
            StateError: no velocity, a wrong shape, a value far beyond limits, an option without
                what it needs.
            PinfricError: loops, drives off the joints, joints without a drive or with several.
        """
        motion = v, a, v if v_ref is None else v_ref, error, v_now
        return self._compensate(q, q_ref, motion, options, external)

    def joint_effort(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        v_ref: np.ndarray | None = None,
        *,
        q_ref: np.ndarray | None = None,
        error: np.ndarray | None = None,
        v_now: np.ndarray | None = None,
        options: CompensationOptions = _DEFAULT,
        external: Mapping[str, np.ndarray] | None = None,
    ) -> np.ndarray:
        """Return all that a torque command at the joints contains for a desired motion.

        P tau + r^2 J a + `compensate`: rigid body, rotors, friction and gear losses. Outside the
        band of switch_velocity it is the `joint_effort_lower` of `inverse`. Of the header:
        `joint_effort`, without its limit.

        Args:
            q, v, a: (nq,), (nv,), (nv,) of the desired motion.
            v_ref, q_ref, error, v_now, options, external: see `compensate`; v_ref None: v.

        Returns, raises: see `compensate`.
        """
        motion = v, a, v if v_ref is None else v_ref, error, v_now
        return self._compensate(q, q_ref, motion, options, external, whole=True)

    def compensate_measured(
        self,
        q: np.ndarray,
        v_now: np.ndarray,
        *,
        v: np.ndarray | None = None,
        a: np.ndarray | None = None,
        options: CompensationOptions = _DEFAULT,
        external: Mapping[str, np.ndarray] | None = None,
    ) -> np.ndarray:
        """Return the friction at a measured velocity that a controller may add to its own.

        out = measured_scale (D + P drag + motor's drag)(v_now), with z in place of S(v_now/v_s):
        z <- clip(z + dq/measured_way, -1, 1), dq since the last call of this thread, z = 0 at the
        first. This is a feedback loop, passive while the joints' friction is at least
        measured_scale times the model's and they slip after at most measured_way: a joint that
        yields farther may swing without end after a push.

        Args:
            q: (nq,) measured positions, each cycle: not filtered.
            v_now: (nv,) measured velocity, low-passed.
            v, a: (nv,) motion that determines the load; None: gravity only.
            options, external: see `compensate`; `hold_error` is refused.

        Returns, raises: see `compensate`.
        """
        motion = v, a, v_now, None, v_now
        return self._compensate(q, None, motion, options, external, measured=True)

    def _compensate(
        self,
        q: np.ndarray,
        q_ref: np.ndarray | None,
        motion: tuple[np.ndarray | None, ...],
        options: CompensationOptions,
        external: Mapping[str, np.ndarray] | None,
        *,
        measured: bool = False,
        whole: bool = False,
    ) -> np.ndarray:
        """Compensate at q, q_ref (nq,) and v, a, v_ref, error, v_now (nv,), see `compensate`."""
        if motion[2] is None:
            asked = "v_now" if measured else "v_ref"
            raise StateError(
                f"{asked}: missing: whose friction should be compensated? Give the "
                f"{'measured' if measured else 'desired'} velocity, ({self.scene.model.nv},)"
            )
        own = self._own
        (ws, _), x = own.both, own.compensated or self._begin_compensation()
        q, nv, still = vector("q", q, ws.nq, "nq", ws.scene.model), ws.nv, x.still
        there = q if q_ref is None else vector("q_ref", q_ref, ws.nq, "nq", ws.scene.model)
        names = _MEASURED if measured else _MOTION
        given = [
            still if part is None else vector(name, part, nv, "nv")
            for name, part in zip(names, motion, strict=True)
        ]
        v, a, v_ref, error, v_now = given
        has_error, has_v_now = motion[3] is not None, motion[4] is not None
        rows, needs_measured = x.rows(options, measured)
        if needs_measured:
            check_used(self.scene, rows, has_error, has_v_now, measured)
        flags = _FLAGS[has_error and has_v_now, has_v_now, whole, measured]
        out = np.empty(x.na)
        self._balance(ws, q, v, a, external)
        if compensate_sample(x.argument, q, v, a, v_ref, error, v_now, there, flags, rows, out):
            return out
        # Not normalized, or no state of this robot
        named = zip(names, given, motion, strict=True)
        checked = {name: None if one is None else part for name, part, one in named}
        check_reach(self.scene, x.reach, {"q": q, "q_ref": there}, checked)
        normal = States.of(self.scene, q, v, a).q[0]
        if not np.array_equal(normal, q):
            return self._compensate(
                normal, q_ref, motion, options, external, measured=measured, whole=whole
            )
        check_finite(self.scene, (out[None], out[None]), 0)
        raise AssertionError

    def options_at_rest(
        self,
        q: np.ndarray,
        v_now: np.ndarray,
        options: CompensationOptions = _DEFAULT,
    ) -> CompensationOptions:
        """Return options whose bands are wide enough for the noise of a recorded second at rest.

        measured_way >= 20 ptp(q), hold_error >= 11.25 ptp(q) where there is a hold, hold_velocity
        >= 5 sd(v_now): noise then moves the compensation by at most 5 % of the friction in
        `compensate_measured` and 20 % in a hold, from peak to peak, beside viscous x ptp(v_now).

        Args:
            q: (T, nq) measured positions, each cycle, as they go into the calls.
            v_now: (T, nv) measured velocities, low-passed as they go into the calls.
            options: what else they hold stays; so do bands that are wider.

        Returns:
            With one number for each drive.

        Raises:
            StateError: less than 100 samples, a value that is not finite, a robot that moved.
        """
        model = self.scene.model
        positions, speeds = (
            np.atleast_2d(real_numbers(name, x)) for name, x in (("q", q), ("v_now", v_now))
        )
        for name, rows, width in (("q", positions, model.nq), ("v_now", speeds, model.nv)):
            if rows.shape != (len(positions), width):
                raise StateError(
                    f"options_at_rest: {name}: shape {rows.shape}; should be (T, {width}), as many "
                    "samples of both"
                )
        first = positions[0]
        moved = np.array([pin.difference(model, first, row) for row in positions])
        return quiet_options(self.scene, moved, speeds, options)

    def reset_compensation(self) -> None:
        """Forget in which direction the joints moved, as after a stop of the controller.

        Of this thread. From then on z is 0 in `compensate_measured`, and where friction builds up
        in `compensate` and `joint_effort`; it is right again after a joint has moved by twice its
        way in one direction.
        """
        x = self._own.compensated
        if x is not None:
            for kept in x.travelled:
                kept[:] = 0

    def _begin_compensation(self) -> _Compensated:
        """Make this thread's buffers of `compensate`, and compile its kernel at the first call."""
        ws, _ = self._own.both
        x = _Compensated(ws, self.scene)
        still, flags = x.still, _FLAGS[(False,) * 4]
        rows, _ = x.rows(_DEFAULT, False)
        with compiling():
            q = np.zeros(ws.nq)
            arrays = q, *[still] * 5, q, flags, rows, np.empty(x.na)
            compile_for(compensate_sample, x.argument, *arrays)
        self._own.compensated = x
        return x

    def _normalize(self, x: _Sample) -> np.ndarray:
        """Return q (nq,) on its manifold, or raise the error of the state or of its solution."""
        q, figures = States.of(self.scene, x.q, x.v, x.a).q[0], x.whole.found
        if np.array_equal(q, x.q):
            check_finite(self.scene, (figures.effort_lower, figures.effort_upper), 0)
            motors = x.whole.motor_torque_lower, x.whole.motor_torque_upper
            check_finite(self.scene, motors, 0)
        return q
