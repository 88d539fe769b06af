"""Forward dynamics with friction at one instant: accelerations, stick or slip, reactions.

    M a + h - J_ext^T f_ext = u + D phi,     phi_k opposes v_k and depends on the wrench w_k

(paper eq. 3, 16, 17), see `problem.instant` and `friction.problem`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pinfric.dynamics.forward.efforts import by_name
from pinfric.dynamics.forward.workspace import Workspace, workspace
from pinfric.dynamics.problem.instant import FREE
from pinfric.dynamics.samples.closure import check_closed
from pinfric.dynamics.samples.outcome import Status
from pinfric.dynamics.samples.reactions import AppliedWrench, applied_wrenches
from pinfric.dynamics.samples.states import States, one_of, vector
from pinfric.errors import AccelerationError, PinfricError, StateError
from pinfric.model.brief import counted, screen
from pinfric.model.described import EFFORT
from pinfric.model.scene import Scene, expect_scene

if TYPE_CHECKING:
    import pandas as pd

_MODES = {-1: "slips backward", 0: "sticks", 1: "slips forward"}


class Instant(NamedTuple):
    """Accelerations and friction at one state (a tuple: a dataclass takes 2 us longer to make).

    Of a batch of states each field is an array whose first axis is the sample.

    Attributes:
        a: (nv,) accelerations (rad/s^2, m/s^2); exactly 0 where a joint sticks.
        modes: (ns,) -1, 0, 1: slips backward, sticks, slips forward; of a ball 0, 1.
        friction: (ns,) of the parent on the child (of side a on side b), along the joint's positive
            direction; of a ball minus its size.
        multipliers: (nl,) forces and moments of each loop's side a on side b along the directions
            that it closes, loop after loop (N, N m); an open chain has none.
        normal_load: (ns,) load c of each joint's bearing.
        wrench: (ns, 6) parent on child, in the child's joint frame, linear first.
        contraction: below 1 the friction is unique in these modes; NaN where joints that can only
            move together rest and share it (`rest.py`).
        status: `Status`.
        iterations: passes of the coupled solve.
        effort: (na,) efforts of the drives at the joints (N m or N): as given, or the motors'
            torques after the losses of the gears.
        driving: (na,) int8, of gears that move: 1 where the motor drives, -1 where the load does.
        answers: how many accelerations obey the laws (`friction/gears.py`); of several this is the
            only stable one. 0: one was found, others may exist, as where more than eight joints at
            rest depend on each other.
    """

    a: np.ndarray
    modes: np.ndarray
    friction: np.ndarray
    multipliers: np.ndarray
    normal_load: np.ndarray
    wrench: np.ndarray
    contraction: float
    status: Status
    iterations: int
    effort: np.ndarray
    driving: np.ndarray
    answers: int

    def summary(self, scene: Scene) -> pd.DataFrame:
        """Return a row for each joint with friction: `mode` in words, `friction`, `normal_load`.

        Args:
            scene: of which it is; an instant holds numbers only.

        Raises:
            StateError: a batch of states, or of another scene.
        """
        import pandas as pd

        if np.ndim(self.a) > 1:
            raise StateError(
                f"a table is of one state, and here are {len(self.a)}; "
                "pf.Instant(*(field[k] for field in found)) is the one of sample k"
            )
        expect_scene(scene, "summary")
        names = scene.site_names
        if (np.size(self.a), len(self.modes)) != (scene.model.nv, len(names)):
            raise StateError(
                f"{scene.source}: another scene; it has {counted(len(names), 'joint')} "
                f"with friction, this instant {len(self.modes)}"
            )
        modes = [
            "slips" if site.ball and mode else _MODES[int(mode)]
            for site, mode in zip(scene.sites, self.modes, strict=True)
        ]
        columns = {"mode": modes, "friction": self.friction, "normal_load": self.normal_load}
        table = pd.DataFrame(columns, index=pd.Index(names, name="joint"))
        table.attrs["units"] = {"friction": EFFORT, "normal_load": EFFORT}
        return table

    def __repr__(self) -> str:
        def some(x: np.ndarray) -> str:
            return np.array2string(x, precision=4, threshold=10, edgeitems=4, max_line_width=10**6)

        if np.ndim(self.a) > 1:
            shapes = {name: f"{np.shape(x)} array" for name, x in self._asdict().items()}
            return screen("Instant", counted(len(self.a), "sample"), shapes)
        title = f"{self.status.name.lower()}, {counted(self.iterations, 'pass', 'passes')}"
        return screen(
            "Instant",
            title,
            {
                "a": some(self.a),
                "modes": some(self.modes),
                "friction": some(self.friction),
                "normal_load": some(self.normal_load),
                "multipliers": some(self.multipliers) if self.multipliers.size else "",
                "wrench": f"{self.wrench.shape} array",
                "contraction": f"{self.contraction:.4g}",
                "answers": f"{self.answers}, this is the stable one; driving {some(self.driving)}"
                if self.answers > 1
                else ""
                if self.answers
                else "one was found, others may exist",
            },
        )


def forward_dynamics(
    scene: Scene,
    q: np.ndarray,
    v: np.ndarray,
    effort: np.ndarray | Mapping[str, float] | None = None,
    external: Mapping[str, np.ndarray] | None = None,
    *,
    motor_torque: np.ndarray | Mapping[str, float] | None = None,
    attached: Iterable[str] | None = None,
) -> Instant:
    """Return the accelerations, modes and friction that efforts cause at one state, or at many.

    a = M^-1 (u - h + J_ext^T f_ext + D phi) with phi by the laws of friction (paper eq. 3, 20,
    21). A joint at or below its stick velocity sticks if that is consistent; one that moves no mass
    rests, as if it were locked (`model.massless`). The solver starts from this thread's last
    solution for the scene, so the last digits depend on the previous call, by some 1e-14 of the
    largest acceleration.

    Args:
        scene: the robot with its friction and drives.
        q, v: (nq,), (nv,) in rad, m and per second; or (T, nq), (T, nv), for T states.
        effort: (na,), or (T, na), what the drives deliver at the joints (N m or N), in the order of
            `scene.actuator_names`, which need not be that of the list of actuators; or a mapping
            drive name -> number, in which those left out give 0.
        external: frame name -> (6,) wrench on it, in its axes at its origin (N, N m).
        motor_torque: like `effort` and in its place, at the motors' shafts (N m); gears lose a part
            of it and rotors need a part to accelerate (`model/transmission.py`).
        attached: names of the payloads carried; None takes those attached by default.

    Raises:
        SceneError: motor torques with a drive without transmission; a joint that moves no mass gets
            an effort beyond its friction.
        GearJam: a self-locking gear has too light a rotor: no acceleration obeys its law, or one
            that is unstable.
        StateError: neither or both of effort and motor_torque; a wrong shape, a value not finite; a
            loop that is open or that the velocities violate (`LoopMotionError`), a toggle
            (`ToggleError`).
        NoConsistentAcceleration, AmbiguousAcceleration: no acceleration, or several, obey the laws.
        UndecidedAcceleration: the search ended before it found one, or ruled out others.
        RollMomentError: a guide without width is loaded by a moment about its axis.

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> instant = pf.forward_dynamics(scene, [0.0], [1.0], [0.0])
    >>> instant.a.round(4), instant.friction.round(4)
    (array([-0.6526]), array([-0.3018]))
    """
    expect_scene(scene, "forward_dynamics")
    given = one_of("forward_dynamics", effort, motor_torque)
    ws = workspace(scene, attached, motors=effort is None)
    if np.ndim(q) > 1:
        return _at_each(ws, q, v, given, external)
    applied = None if external is None else applied_wrenches(scene, external, 1)
    solve_checked(ws, *checked_state(ws, q, v, given), applied)
    return instant(ws)


def _at_each(
    ws: Workspace,
    q: np.ndarray,
    v: np.ndarray,
    given: np.ndarray | Mapping[str, float],
    external: Mapping[str, np.ndarray] | None,
) -> Instant:
    """The instants of a batch as one, see `Instant`; efforts of one sample are those of all."""
    samples = len(q)
    if not samples:
        raise StateError("forward_dynamics: q has no samples; give at least one state")
    states = {"q": q, "v": v} | ({} if isinstance(given, Mapping) else {ws.given: given})
    for name, x in states.items():
        of_all = name == ws.given and np.ndim(x) < 2
        if not of_all and (np.ndim(x) != 2 or len(x) != samples):
            raise StateError(
                f"forward_dynamics: {name} has shape {np.shape(x)}; q has {samples} samples, so "
                f"{name} needs {samples} rows"
            )
    wrenches = [] if external is None else applied_wrenches(ws.scene, external, samples)
    instants = []
    for i in range(samples):
        applied = [AppliedWrench(w.joint, w.wrench[i : i + 1]) for w in wrenches]
        effort: Any = given if isinstance(given, Mapping) or np.ndim(given) < 2 else given[i]
        try:
            solve_checked(ws, *checked_state(ws, q[i], v[i], effort), applied or None)
        except PinfricError as problem:
            problem.args = (f"sample {i}: {problem}", *problem.args[1:])
            raise
        instants.append(instant(ws))
    return Instant._make(np.array(figures) for figures in zip(*instants, strict=True))


def checked_state(
    ws: Workspace,
    q: np.ndarray,
    v: np.ndarray,
    effort: np.ndarray | Mapping[str, float] | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a state as arrays that kernels take: q (nq,), v (nv,) and efforts (na,).

    Raises:
        StateError: a wrong shape, an effort of no drive.
    """
    q, v = vector("q", q, ws.nq, "nq", ws.scene.model), vector("v", v, ws.nv, "nv")
    return q, v, drive_vector(ws, effort)


def solve_checked(
    ws: Workspace,
    q: np.ndarray,
    v: np.ndarray,
    effort: np.ndarray,
    applied: list[AppliedWrench] | None,
) -> None:
    """Solve one state, of arrays as of `checked_state`, in a workspace.

    Raises:
        See `forward_dynamics`.
    """
    if not ws.must_project and ws.slides(q, v, effort, applied, FREE):
        return
    held = ws.held.size > 0
    if held:
        v = v.copy()
        v[ws.held] = 0.0
    exact = not ws.must_project  # or closed and normalized to 1e-8
    if exact:
        ws.solve_coupled(q, v, effort, applied)
    else:
        try:
            ws.solve(q, v, effort, applied)
            exact = ws.constraints.is_exact(q)
        except PinfricError as error:  # errors of the state come first
            ws.failures.check_finite(ws.state)
            if isinstance(error, AccelerationError) and ws.constraints.is_exact(q):
                raise
    if not exact:
        states = States.of(ws.scene, q, v, np.zeros(ws.nv))
        q, v = states.q[0], states.v[0]
        if ws.scene.loops:  # what an integrator hands to an effort function obeys them roughly
            check_closed(ws.scene, q, v, slack=1e3)
        ws.solve(q, v, effort, applied)
    if held:
        ws.check_held(ws.a)
    if ws.failures.guides:
        ws.failures.check_roll_moments(ws.wrench)


def solution(ws: Workspace) -> Instant:
    """Return the workspace's solution: `a` is its own, the rest are overwritten next time."""
    if ws.wrench is ws.forces:  # one ABA
        if not ws.views:
            modes, effort, driving = ws.site_modes, ws.effort, ws.machine.results.driving
            ws.views = (modes, ws.phi, ws.multipliers, ws.load, ws.wrench, 0.0, Status.CONVERGED, 0)
            ws.views += (effort, driving, 1)
        return tuple.__new__(Instant, (ws.a, *ws.views))
    contraction, passes = ws.modes.figures.tolist()
    return Instant(
        ws.a.copy(),
        ws.site_modes,
        ws.phi,
        ws.multipliers,
        ws.load,
        ws.wrench,
        contraction,
        Status.CONVERGED,
        int(passes),
        ws.effort,
        ws.machine.results.driving,
        ws.count.many[0],
    )


def instant(ws: Workspace) -> Instant:
    """Return the workspace's solution with arrays of its own."""
    contraction, passes = ws.modes.figures.tolist()
    multipliers = ws.multipliers.copy() if ws.closed else ws.multipliers
    return Instant(
        ws.a.copy(),
        ws.site_modes.copy(),
        ws.phi.copy(),
        multipliers,
        ws.load.copy(),
        ws.wrench.copy(),
        contraction,
        Status.CONVERGED,
        int(passes),
        ws.effort.copy(),
        ws.machine.results.driving.copy(),
        ws.count.many[0],
    )


def drive_vector(ws: Workspace, given: Any) -> np.ndarray:
    """Return (na,) of the drives: efforts, or r T_m (N m or N at the joint) where motors drive."""
    if type(given) is not np.ndarray and isinstance(given, Mapping):
        given = by_name(ws.scene.actuator_names, given, ws.given)
    array = vector(ws.given, given, ws.na, "na")
    return array * ws.ratio if ws.given == "motor_torque" else array
