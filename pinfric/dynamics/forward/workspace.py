"""Buffers of one scene, and the steps of forward dynamics and integrators at a state."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from math import hypot
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.forward.constraints import Constraints
from pinfric.dynamics.forward.failures import Failures, State
from pinfric.dynamics.forward.margins import Margins
from pinfric.dynamics.problem.accelerations import is_exact, measure_rates, relate
from pinfric.dynamics.problem.instant import (
    FREE,
    GIVEN,
    NOT_TRIED,
    TURNED,
    UNSOLVED,
    accelerations_under_friction,
    finish,
    solve_instant,
)
from pinfric.dynamics.problem.machine import Machine, Pinocchio, make_machine
from pinfric.dynamics.problem.plan import kept_plan
from pinfric.dynamics.problem.sliding import deliver, slide_freely
from pinfric.dynamics.samples.reactions import AppliedWrench
from pinfric.errors import (
    ClosureError,
    PinfricError,
    SceneError,
)
from pinfric.friction.balls import kernel_of_balls
from pinfric.friction.gears import bind, fit, gear_margins, hold_chosen, one_answer, write_rows
from pinfric.friction.given_modes import judge, reduce_problem, try_modes
from pinfric.friction.law import add_load_slopes, evaluate, stick_limits
from pinfric.friction.minimax import least_violation
from pinfric.friction.problem import GivenModes, Modes, Problem, SearchOutcome
from pinfric.friction.rest import Mechanism, solve_modes
from pinfric.friction.search import SearchStatistics, search, solve_given
from pinfric.friction.several import kernel_of_simplices
from pinfric.friction.smoothing import kernel_of_smoothing
from pinfric.friction.tree import kernels_of_tree
from pinfric.kernels.compiled import KernelArgument, compile_for, compiling, entry_point
from pinfric.kernels.late import compile_late
from pinfric.model.closure import guesses
from pinfric.model.drives import slope_range
from pinfric.model.massless import massless
from pinfric.model.scene import Scene, payload_names

#: An effort (N m or N) that no joint at rest can hold.
_OVERWHELMING = 1e8
#: An effort (N m or N, and of the largest) that is none.
_ROUNDING = 1e-9
#: |a| above this: a singular mass matrix, or an overflow, which `solve_instant` names.
_FASTEST = 1e10
#: Lines of gears that are tried before the search takes over.
_LINES = 8


class FirstTry(NamedTuple):
    """What was tried at one state.

    Attributes:
        solutions: their number, or -1. obeying: how many obey the laws.
        resting: how many coordinates rest, where modes were free.
        tried: whether the modes were; not where joints stick that may share their friction.
    """

    solutions: int
    obeying: int
    resting: int
    tried: bool


class Workspace:
    """Buffers of one scene for one thread: every solve overwrites them.

    Attributes:
        machine, plan: its arrays, and the indices of the scene's parts in them.
        given: "effort", or "motor_torque"; then `effort` is r T_m of each drive.
        problem, modes: the coupled problem and its solution.
        mechanism: the coupling of its coordinates.
        must_project: whether a configuration can be invalid: open loops, unnormalized quaternions.
        closed: see `Closure.dependent`.
        state: the last state, to which `search`, `finish` and failures refer.
        constraints, margins, failures: of its scene and its solution.
        count: what its last search counted.
        a, effort, phi, load, wrench, multipliers, least, most, site_modes: see `Results`.
        forces: (ns, 6) `wrench` after `slides`, of Pinocchio's own; None: it never does.
        views: what `forward.solution` returns then, beside accelerations; empty at first.
        shapes: of q, v and effort. ratio: (na,) of the drives.
        locked: whether sticking coordinates prevent all motion (known where loops close).
        held: velocities that move no mass (`model.massless`): as if locked, see `check_held`.
        places: (name, coordinate, whether it is a ball) of all that can stick: sites, then gears on
            joints without friction.
    """

    def __init__(
        self, scene: Scene, attached: Iterable[str] | None = None, motors: bool = False
    ) -> None:
        if motors:
            check_transmissions(scene)
        self.given = "motor_torque" if motors else "effort"
        self.scene, self.twin = scene, scene.twin(attached)
        self.nq, self.nv, self.na = scene.model.nq, self.twin.nv, len(scene.drives)
        kept = kept_plan(scene, self.given)
        self.plan = t = kept.given
        coordinates, drives = t.coordinates, t.drives
        self.must_project = scene.linkage is not None or self.nq != self.nv
        self.pinocchio = Pinocchio(self.twin)
        self.closed = t.closure.dependent
        self.held = np.flatnonzero(massless(scene, attached))
        self.machine = m = make_machine(self.twin, t, self.pinocchio.views)
        m.tree.held_inertia[self.held] = 1.0
        self._argument = KernelArgument(m, kept)
        self.problem, self.modes = m.problem, m.modes
        results = m.results
        self.a, self.effort, self.phi, self.load = (
            results.a,
            results.effort,
            results.phi,
            results.load,
        )
        self.wrench, self.multipliers, self.site_modes = (
            results.wrench,
            results.multiplier,
            results.site_modes,
        )
        self.least, self.most = results.least, results.most
        geared = drives.gear_coordinate[drives.gear_coordinate >= 0]
        self._geared = bool(geared.size)
        # losses grow steadily with speed: at no speed or at a large one slopes are least
        pairs = ((d, x) for d in np.flatnonzero(drives.gear_coordinate >= 0) for x in (0.0, 1e6))
        self._locks = any(slope_range(drives.gears, d, x)[0] <= 0.0 for d, x in pairs)
        names = zip(scene.site_names, t.site_coordinate.tolist(), strict=True)
        self.places = [(name, c, bool(coordinates.ball[c])) for name, c in names]
        self._alone = np.setdiff1d(geared, t.entries.coordinate)
        of = drives.gear_coordinate.tolist()
        self.places += [(scene.drives[of.index(c)].name, c, False) for c in self._alone.tolist()]
        self._tau, self._free = m.free_motion.effort, self._free_model()
        self._solve_instant: Any = solve_instant
        self._slide_freely: Any = slide_freely
        self.shapes, self.ratio = ((self.nq,), (self.nv,), (self.na,)), drives.gears.ratio
        self._deliver: Any = deliver
        self.state: State
        self.count = SearchStatistics()
        self.failures = Failures(scene, m, self.given, self.count)
        self.renew()

    def kernels_of_sliding(self) -> list[tuple[Any, tuple[Any, ...]]]:
        """Return the kernels that `slides` calls, with arguments of their types."""
        if self._free is None:
            return []
        calls: list[tuple[Any, tuple[Any, ...]]]
        calls = [(slide_freely, (self.argument, self._tau, self._tau, FREE))]
        if all(drive.transmission for drive in self.scene.drives):
            calls.append((deliver, (self.argument, self._tau)))
        return calls

    def call_directly(self) -> None:
        """Call kernels without numba's look at the types of arguments, which are always as here."""
        v, given = np.zeros(self.nv), np.zeros(self.na)
        state = self._argument.record(), np.zeros(self.nq), v, given
        self._solve_instant = entry_point(solve_instant, *state, 0.0, FREE)
        for kernel, arguments in self.kernels_of_sliding():
            name = "_deliver" if kernel is deliver else "_slide_freely"
            setattr(self, name, entry_point(kernel, *arguments))

    def renew(self) -> None:
        """Forget all solutions, so that the next one does not depend on them."""
        coordinates, maps = self.plan.coordinates, self.machine.maps
        self._kept: tuple[object, ...] | None = None
        self.locked = False
        for array in (*self.modes, *self.machine.results):
            array.fill(0)
        self._forget()
        way = np.zeros(len(coordinates.dry))
        self.mechanism = Mechanism(
            self.closed, maps.factor, coordinates.block, coordinates.ball, maps.idle, way
        )
        self.constraints = Constraints(self.scene, self.pinocchio, self._argument)
        self.margins = Margins(self.machine, self.mechanism)

    @property
    def argument(self) -> Machine:
        """The machine for kernels: tuples while they are interpreted, then one record."""
        return self._argument.now

    def accelerations(self) -> np.ndarray:
        """Return accelerations (nv,) under the friction in `modes`, those of what sticks, too.

        At the end of a time step what sticks is at rest, and not at its beginning.
        """
        a = np.empty(self.nv)
        accelerations_under_friction(self.argument, a)
        return a

    # ------------------------------------------------------------ solving

    def _free_model(self) -> pin.Model | None:
        """Return the model whose ABA has the motion while all slides; None: there is none.

        Loads must not change friction, and every drive must move one velocity of an open chain.
        """
        t, drives, pinocchio = self.plan, self.plan.drives, self.pinocchio
        coupled = self.closed or t.contacts.owner.size or t.sites.guides.size or t.off_joints
        alone = (drives.velocity_index >= 0) & (drives.action < 0)
        alone &= (drives.rate_row != 0.0).sum(axis=1) == 1
        mimic = any("Mimic" in joint.shortname() for joint in pinocchio.model.joints)
        odd = self._locks or self.held.size or t.coordinates.ball.any() or pinocchio.copies
        odd = odd or self.twin.springs is not None  # ABA would not know them
        self.forces: Any = None
        self.views: tuple[Any, ...] = ()
        if coupled or mimic or odd or not alone.all():
            return None
        row = 1 + t.sites.joint
        gaps = not row.size or (np.diff(row) != 1).any()
        self._taken, force = row if gaps else None, pinocchio.views.force
        self.forces = np.empty((row.size, 6)) if gaps else force[row[0] : row[-1] + 1]
        model = pinocchio.model.copy()  # its armature is that of the lines that gears are on
        self._armature = model.armature if self.given == "motor_torque" else None
        return model

    def slides(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None,
        choice: int,
    ) -> bool:
        """Solve a state in which everything slides and no load matters; False: it is another.

        Args: see `solve`; choice: see `instant.solve_instant`.
        """
        if self._free is None or applied:
            return False
        machine, armature, tries = self._argument.now, self._armature, 0
        while True:
            if tries == _LINES or not self._slide_freely(machine, v, effort, choice):
                return False
            if armature is not None:
                armature[:] = self.machine.free_motion.armature
            a = pin.aba(self._free, self.pinocchio.data, q, v, self._tau)
            if not hypot(*a.tolist()) < _FASTEST:
                return False
            if armature is None or self._deliver(machine, a):
                break
            tries += 1
        self.a = a
        if self._taken is not None:
            np.take(self.pinocchio.views.force, self._taken, 0, self.forces)
        if self.wrench is not self.forces:  # the first of several
            self.wrench = self.forces
            self.count.many, self.count.tried = (1, 1), 1
        return True

    def solve(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None = None,
    ) -> None:
        """Find modes, friction and accelerations at one state.

        Args:
            q, v, effort: (nq,), (nv,), (na,), C-ordered.
            applied: wrenches from outside, one sample each.

        Raises:
            StateError: a value is not finite; SceneError: the mass matrix is singular.
            ToggleError: the loops allow more degrees of freedom here than elsewhere.
            AccelerationError: there is none, there are several, or the search found none.
        """
        if not self.slides(q, v, effort, applied, FREE):
            self.solve_coupled(q, v, effort, applied)

    def solve_coupled(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None,
    ) -> None:
        """`solve` where something rests, or loads matter."""
        if self._locks:
            self._forget()
        solutions, obeying, resting, _ = self._run(q, v, effort, applied, FREE)
        # one was found; there may be others
        several = self.modes.figures[0] >= 1.0 or not self.has_one_answer()
        if obeying == 1 and not several:
            return
        tries = resting or several or self._geared
        if tries:
            self._forget()
        outcome = self.search() if tries else self.count.of_one_mode(solutions, obeying)
        if outcome != SearchOutcome.SOLVED:
            raise self.failures.failure(outcome, self.state)
        self.finish()

    def check_held(self, a: np.ndarray) -> None:
        """Refuse a solution in which a joint that moves no mass, at rest, does not stay so.

        Args:
            a: (nv,) of the solution, with inertias of 1 there; made exactly 0 there.

        Raises:
            SceneError: names the joint.
        """
        if not self.held.size:
            return
        rounding = _ROUNDING * max(1.0, float(np.abs(self.pinocchio.views.h).max()))
        if (moves := self.held[np.abs(a[self.held]) > rounding]).size:
            raise SceneError(self.failures.pushed(moves))
        a[self.held] = 0.0

    def _forget(self) -> None:
        """Drop the warm start: with several solutions it would decide which one is found."""
        self.modes.forget()
        self.modes.load[:] = self.modes.effort[:] = 0.0

    def solve_given_modes(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None,
        fixed: GivenModes,
    ) -> None:
        """Find friction and accelerations in given modes.

        Args, raises: see `solve`.
        """
        self.modes.stuck[:], self.modes.direction[:] = fixed.stuck, fixed.direction
        if self._kept is not None and self._kept == self._key(q, v, effort, applied):
            return  # nothing moves and nothing has changed
        if self.slides(q, v, effort, applied, GIVEN):
            return
        turned = TURNED if self.mechanism.balls and fixed.balls_turn else GIVEN
        solutions, obeying, _, tried = self._run(q, v, effort, applied, turned)
        if obeying == 1 and tried and self.has_one_answer():
            return
        outcome = self.count.of_one_mode(solutions, obeying)
        if not tried or self._geared:
            outcome = solve_given(self.problem, self.modes, self.mechanism, self.count)
            if outcome == SearchOutcome.SOLVED:
                self.finish()
        if outcome != SearchOutcome.SOLVED:
            raise self.failures.failure(outcome, self.state)
        self._kept = self._key(q, v, effort, applied) if self.locked else None

    def _key(
        self, q: np.ndarray, v: np.ndarray, effort: np.ndarray, applied: list[AppliedWrench] | None
    ) -> tuple[object, ...]:
        """What the solution in `modes` belongs to."""
        modes = self.modes
        arrays = q, v, effort, modes.stuck, modes.direction, modes.friction
        return id(applied), *(array.tobytes() for array in arrays)

    def _run(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None,
        choice: int,
        step: float = 0.0,
    ) -> FirstTry:
        """Write the problem, and try modes of a choice; see `instant.solve_instant`."""
        self._kept, self.state = None, (q, v, effort, applied, step)
        if self.forces is not None:
            self.a, self.wrench = self.machine.results.a, self.machine.results.wrench
        if choice != UNSOLVED:
            self.count.many, self.count.tried, self.locked = (1, 1), 1, False
        self.pinocchio.at(q, v, applied)
        refused, solutions, obeying, resting = self._solve_instant(
            self.argument, q, v, effort, step, choice
        )
        if refused == 0 and choice != UNSOLVED:
            return FirstTry(solutions, obeying, resting, True)
        if refused not in (0, NOT_TRIED):
            self.failures.refuse(refused, self.state)
        self.mechanism.factor = self.machine.maps.factor[: self.machine.maps.freedoms[0]]
        return FirstTry(solutions, obeying, resting, False)

    def assemble(
        self,
        q: np.ndarray,
        v: np.ndarray,
        effort: np.ndarray,
        applied: list[AppliedWrench] | None = None,
        step: float = 0.0,
    ) -> None:
        """Write the coupled problem at one state, unsolved.

        Args:
            q, v, effort, applied: see `solve`.
            step: see `instant.solve_instant`.

        Raises:
            StateError, SceneError, ToggleError: see `solve`.
        """
        self._run(q, v, effort, applied, UNSOLVED, step)

    def search(
        self, forced: Mapping[int, float] | None = None, held: np.ndarray | None = None
    ) -> SearchOutcome:
        """Search the modes of what is at rest; see `friction/search.py`."""
        outcome = search(self.problem, self.modes, self.mechanism, forced, held, self.count)
        if outcome == SearchOutcome.SOLVED and self.closed:
            self._leave_dead_centres()
        return outcome

    def has_one_answer(self) -> bool:
        """Whether there is one answer in the present modes, on whatever lines of gears."""
        return not self._locks or one_answer(self.problem, self.modes)

    def _leave_dead_centres(self) -> None:
        """Let joints that rest at their dead centre slip in the direction of the mechanism.

        Their own rates are zero; a moment later their sign is that of the rate at v = a.
        """
        m = self.modes
        dead = m.at_rest & m.stuck & ~self.mechanism.factor.any(axis=0)
        q, v, effort, applied, step = self.state
        if step > 0.0 or not dead.any():
            return
        a_map = self.machine.maps.acceleration
        free = a_map[:, 0]
        a = free + a_map[:, 1:] @ m.friction
        terms = float(np.abs(free).max(initial=0.0)) + 1e-300
        if np.abs(a).max(initial=0.0) <= 1e-12 * terms:
            return
        kept = m.copy()
        self.assemble(q, a, effort, applied)
        way = np.sign(self.problem.rate_free[dead])
        self.assemble(q, v, effort, applied)
        m.stuck[dead], m.direction[dead], m.at_rest[dead] = way == 0.0, way, False
        if solve_modes(self.problem, m, self.mechanism)[1] != 1:
            m.take(kept)
            solve_modes(self.problem, m, self.mechanism)

    def search_step(self) -> SearchOutcome:
        """Search the modes at the end of a time step, from those in `modes`, else all of them."""
        return search(self.problem, self.modes, self.mechanism, count=self.count, follow=True)

    @property
    def place_modes(self) -> np.ndarray:
        """(len(places),) int8, as `site_modes`."""
        gears = np.sign(self.modes.direction[self._alone]).astype(np.int8)
        return np.concatenate([self.site_modes, gears])

    def modes_of(self, places: np.ndarray) -> GivenModes:
        """Return modes of places, as `place_modes`, as modes of their coordinates."""
        entries, direction = self.plan.entries, np.zeros(len(self.modes.direction))
        direction[entries.coordinate] = places[entries.site] * np.sign(entries.ratio)
        direction[self._alone] = places[len(self.plan.sites.joint) :]
        return GivenModes((direction == 0.0) & self.plan.coordinates.dry, direction)

    def finish(self) -> None:
        """Write a, multipliers, wrenches and each site's friction from the solution in `modes`."""
        finish(self.argument)
        self.locked = self.closed and self.mechanism.is_locked(self.modes.stuck)
        if self.locked:
            self.a[:] = 0.0


def rehearse(ws: Workspace) -> None:
    """Compile every kernel that a solve may call, so that none is compiled in a control loop.

    It overwrites the solutions: use a separate workspace.
    """
    if not ws.nv:
        return
    q, v, effort = closed_configuration(ws.scene), np.zeros(ws.nv), np.zeros(ws.na)
    m, balls = ws.argument, ws.mechanism.ball.any()
    state = m, q, v, effort
    for function, arguments in (
        (solve_instant, (*state, 0.0, FREE)),
        (finish, (m,)),
        (accelerations_under_friction, (m, ws.a)),
        (relate, (m, v)),
        (measure_rates, (m, v)),
        (is_exact, (m, q)),
        *ws.kernels_of_sliding(),
        *_kernels_of_search(ws.problem, ws.modes),
        *([kernel_of_balls()] if balls else kernels_of_tree(ws.problem, ws.closed)),
    ):
        compile_for(function, *arguments)
    if ws.machine.kinematics.tilt.size:
        compile_late("loops")
    if any(drive.transmission for drive in ws.scene.drives):
        compile_late("gears")
    dry = ws.plan.coordinates.dry
    stuck = GivenModes(dry, np.zeros(len(dry)))
    with compiling():
        for push in (0.0, _OVERWHELMING):
            with suppress(PinfricError):
                ws.solve_given_modes(q, v, effort + push, None, stuck)


def _kernels_of_search(problem: Problem, modes: Modes) -> list[tuple[Any, tuple[Any, ...]]]:
    """Return the kernels that Python calls in a search of modes, with arguments of their types."""
    line, empty = np.empty(0), np.empty((0, 0))
    lines, rows = np.empty((len(modes.effort), 4)), np.empty((len(modes.stuck), 3))
    of_gears = [
        (hold_chosen, (problem, modes)),
        (gear_margins, (problem, modes, 0)),
        (fit, (problem, modes, lines, True)),
        (write_rows, (problem, modes, lines, rows)),
    ]
    return [
        *(of_gears if len(modes.effort) else []),
        (try_modes, (problem, modes, False)),
        (bind, (problem, modes.stuck, rows, empty)),
        (judge, (problem, modes)),
        (evaluate, (problem, modes.friction, modes.load, modes.rate)),
        (stick_limits, (problem, modes.load, line, line)),
        (add_load_slopes, (problem.contact, problem.coordinate, line, line, empty)),
        (reduce_problem, (problem, modes.stuck, modes.direction, rows)),
        (least_violation, (empty, line, line, 0, 0.0, line)),
        kernel_of_simplices(),
        *([] if len(modes.effort) else [kernel_of_smoothing(problem)]),
    ]


def closed_configuration(scene: Scene) -> np.ndarray:
    """Return a configuration (nq,) with all loops closed, near the start; else the start."""
    for guess in guesses(scene.model, scene.start_configuration):
        with suppress(ClosureError):
            return scene.close(guess)
    return scene.start_configuration


def check_transmissions(scene: Scene) -> None:
    """Refuse motor torques if a drive has no transmission.

    Raises:
        SceneError: names the drive.
    """
    for drive in scene.drives:
        if drive.transmission is None:
            raise SceneError(
                f"{scene.source}: motor_torque: drive {drive.name!r} has no transmission; give it "
                "one in `actuators` (a direct drive has ratio: 1), or give `effort`"
            )


class _Last(threading.local):
    """The scene this thread asked for last (a weak reference), what drove it, its workspace."""

    scene: Callable[[], Scene | None] = staticmethod(lambda: None)
    motors: bool
    found: Workspace


_LAST = _Last()


def workspace(
    scene: Scene, attached: Iterable[str] | None = None, motors: bool = False
) -> Workspace:
    """Return this thread's workspace of a scene, made at first; it lives in the scene's twin.

    Scenes that differ in friction alone may share a twin: the last one asked for has its workspace.
    """
    if attached is None and _LAST.scene() is scene and _LAST.motors == motors:
        scene.check_unchanged()
        return _LAST.found
    attached = payload_names(attached)  # read twice below
    twin = scene.twin(attached)
    key = "motors" if motors else "forward", threading.get_ident()
    if key not in twin.pools or twin.pools[key].scene is not scene:
        twin.pools[key] = Workspace(scene, attached, motors)
    found: Workspace = twin.pools[key]
    if attached is None:
        _LAST.scene, _LAST.motors, _LAST.found = weakref.ref(scene), motors, found
    return found


@contextmanager
def lent(scene: Scene, attached: Iterable[str] | None, motors: bool) -> Iterator[Workspace]:
    """Lend a workspace as if it were new; nothing else uses it meanwhile.

    It lives in the scene's twin; one that an error left is not lent again.
    """
    kept: list[Workspace] = scene.twin(attached).pools.setdefault(("lent", motors), [])
    ws: Workspace | None = None
    with suppress(IndexError):  # none is left
        ws = kept.pop()
    if ws is None or ws.scene is not scene:
        ws = Workspace(scene, attached, motors)
    else:
        ws.renew()
    yield ws
    kept.append(ws)
