"""Forward dynamics in time: one function, three methods."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypedDict, Unpack

import numpy as np

from pinfric.dynamics.forward.efforts import Effort, EffortLike, make_effort
from pinfric.dynamics.forward.workspace import Workspace, lent
from pinfric.dynamics.samples.closure import check_closed
from pinfric.dynamics.samples.reactions import applied_wrenches
from pinfric.dynamics.samples.states import States, mention_unmeasured, vector
from pinfric.dynamics.simulation.event import EventIntegration
from pinfric.dynamics.simulation.motion import FAILED, FINISHED, INTERRUPTED, Motion
from pinfric.dynamics.simulation.recorder import Recorder
from pinfric.dynamics.simulation.regularized import RegularizedIntegration
from pinfric.dynamics.simulation.start import start_state
from pinfric.dynamics.simulation.system import Settings, System
from pinfric.dynamics.simulation.timestepping import step_through
from pinfric.errors import (
    AccelerationError,
    PinfricWarning,
    SimulationError,
    SimulationInterrupted,
    StateError,
    choose_from,
)
from pinfric.model.closure import velocity_names
from pinfric.model.drives import lossy_gears
from pinfric.model.magnitudes import LARGEST_OF_A_MOTION, LONGEST_TIME, SMALLEST, impossible
from pinfric.model.scene import Scene, expect_scene, payload_names

#: A run that takes longer than this (s) shows its progress on a terminal.
_PATIENCE = 2.0
#: The finest relative tolerance that an integrator can keep: a hundred times rounding.
_FINEST = 100 * np.finfo(float).eps
#: Samples of a motion by default; of a short one no closer than this (s), but at least so many.
_SAMPLES, _SHORTEST, _FEWEST = 1000, 1e-5, 10
#: More steps would take days and too much memory.
_MOST_STEPS = 1e9
#: The same for the longest step of an integrator: each has six right-hand sides.
_MOST_SHORT_STEPS = 1e7

METHODS = ("event", "timestepping", "regularized")
#: Which of the `Numbers` each method reads.
_READ = {
    "event": ("rtol", "atol", "control_period", "sample_step", "max_step", "max_events"),
    "timestepping": ("dt", "control_period", "sample_step"),
    "regularized": (
        "rtol",
        "atol",
        "control_period",
        "sample_step",
        "max_step",
        "regularization_velocity",
    ),
}


class Numbers(TypedDict, total=False):
    """Numerical options of `simulate`; an option that the method does not use is an error.

    Attributes:
        rtol, atol: tolerances of `event` and `regularized` (rad, m, and per second); 1e-8, 1e-10.
        dt: step of `timestepping` (s); 1e-3.
        control_period: of all methods (s); the effort is asked at t = 0, T, 2T ... before t_end, in
            this order, and holds until the next: a digital controller. None: it is asked wherever
            the method needs it. `timestepping` shortens `dt` to divide it.
        sample_step: time between samples (s); None gives 1001 samples, of less than 10 ms one every
            10 us, at least 11. `event` adds one at every event; `timestepping` takes the nearest
            step.
        max_step: longest step of `event` and `regularized` (s); None gives t_end / 4, or t_end / 50
            for an effort function: a change that lasts less than a sixth of it may be missed.
        regularization_velocity: of `regularized` (rad/s or m/s); 1e-3.
        max_events: of `event`; more are an error; 100 000.
    """

    rtol: float
    atol: float
    dt: float
    control_period: float | None
    sample_step: float | None
    max_step: float | None
    regularization_velocity: float
    max_events: int


def simulate(
    scene: Scene,
    q0: np.ndarray | None = None,
    v0: np.ndarray | None = None,
    effort: EffortLike = None,
    t_end: float | None = None,
    method: str = "event",
    *,
    motor_torque: EffortLike = None,
    breakpoints: Sequence[float] | None = None,
    external: Mapping[str, np.ndarray] | None = None,
    attached: Iterable[str] | None = None,
    progress: bool | Callable[[float], None] | None = None,
    **numbers: Unpack[Numbers],
) -> Motion:
    """Return the motion that efforts cause from a state at t = 0, with stick and slip.

    M a + h = u + D phi in time (paper eq. 16, 20, 21). A joint that moves no mass is held at its
    start as long as its friction bears its effort. `event`: the modes change at located instants,
    the reference. `timestepping`: Moreau and Jean's scheme, fixed steps, implicit friction, first
    order, exact standstill. `regularized`: mu(v) smoothed by tanh(v / velocity) and a stiff solver;
    no static friction, joints creep where the other methods hold them. Friction that builds up
    over a way (`presliding`) is for `timestepping`.

    Args:
        scene: the robot with its friction and drives.
        q0, v0: (nq,), (nv,) at t = 0; a joint at or below its stick velocity starts at rest. None,
            both: the scene's own, `simulation.start`; only v0: at rest.
        effort: a function (t, q, v) -> (na,), constants (na,), (times, values), a mapping by drive
            to numbers or functions, or None for the scene's own; see `efforts.make_effort`. A
            function must be pure; a controller with a state needs `control_period`.
        t_end: s; None: the scene's own.
        method: `event`, `timestepping` or `regularized`.
        motor_torque: in place of `effort`, at the motors' shafts (N m), see `forward_dynamics`.
        breakpoints: times (s) at which an effort function or its slope jumps; not for tables.
        external: frame name -> (6,) constant wrench on it, in its axes at its origin (N, N m).
        attached: names of the payloads carried; None takes those attached by default.
        progress: function of t, called at every step; True shows a bar, False none; None shows one
            on a terminal if the run takes longer than two seconds.
        numbers: control_period, rtol, atol, dt, sample_step, ...; see `Numbers`.

    Raises:
        SimulationError: an effort beyond the friction of a joint that moves no mass, an invalid
            argument, an effort function that raises, an integration that cannot continue.
        StateError: q0, v0 of a wrong shape or not finite.
        AccelerationError: none, several, undecided or a jam, with time, state and the
            `motion` until then.
        SimulationInterrupted: a KeyboardInterrupt with the `motion` until then, after Ctrl-C
            (before the first sample the plain interrupt).

    >>> import pinfric as pf
    >>> scene = pf.load_scene("pendulum")
    >>> pf.simulate(scene, t_end=0.5).status
    'finished'
    >>> motion = pf.simulate(scene, [0.0], [1.0], [0.0], 1.0)
    >>> motion.q[-1].round(4)
    array([0.237])
    """
    settings, (q, v) = _read(scene, method, t_end, numbers), _start(scene, q0, v0)
    _check_presliding(scene, method, motor_torque is not None)
    drive_efforts = make_effort(scene, effort, breakpoints, motor_torque)
    if settings.control_period is not None:
        drive_efforts = _held(drive_efforts, settings, breakpoints)
    if numbers.get("max_step") is None:
        settings = replace(settings, max_step=_longest_step(drive_efforts, method, settings.t_end))
    applied = applied_wrenches(scene, external, 1)
    carried = payload_names(attached)
    with lent(scene, carried, drive_efforts.given == "motor_torque") as ws:
        system = System(ws, drive_efforts, applied)
        record = Recorder(scene, system, method, settings.sample_step, carried)
        if ws.held.size:
            names = [velocity_names(scene.model)[k] for k in ws.held.tolist()]
            warnings.warn(
                f"{scene.source}: {', '.join(names)} {'moves' if len(names) == 1 else 'move'} no "
                "mass: held at the start position",
                PinfricWarning,
                stacklevel=2,
            )
        with _Progress(progress, settings.t_end) as record.progress:
            return _run(method, system, settings, record, q, v)


def simulate_constant(
    ws: Workspace,
    q0: np.ndarray,
    v0: np.ndarray,
    effort: np.ndarray,
    t_end: float,
    carried: tuple[str, ...],
    **numbers: Unpack[Numbers],
) -> Motion:
    """Return the motion under constant efforts by `event`, in a workspace of the caller's.

    Args:
        ws: of the scene with the payloads `carried`; overwritten.
        q0, v0, effort: (nq,), (nv,), (na,) N m or N, at the shafts if `ws` is of the motors.
        t_end: s.
        numbers: of the method `event`.
    """
    drive_efforts = Effort(lambda t, q, v: effort, np.zeros(0), np.inf, ws.given, held=True)
    settings = _settings("event", t_end, **numbers)
    system = System(ws, drive_efforts, [])
    record = Recorder(ws.scene, system, "event", settings.sample_step, carried)
    return _run("event", system, settings, record, q0, v0)


def _read(scene: Scene, method: str, t_end: float | None, numbers: Numbers) -> Settings:
    """Return the settings; refuse options that are unknown, or not of the method."""
    if unknown := numbers.keys() - Numbers.__annotations__.keys():
        raise TypeError(f"simulate() got an unexpected keyword argument {min(unknown)!r}")
    settings = _settings(method, end_of(scene, t_end), **numbers)
    for name, value in numbers.items():
        if value is not None and name not in _READ[method]:
            readers = " and ".join(m for m, names in _READ.items() if name in names)
            raise SimulationError(
                f"{name} = {value!r}: is for {readers}; {method} takes {', '.join(_READ[method])}"
            )
    return settings


def _check_presliding(scene: Scene, method: str, motors: bool) -> None:
    """Refuse friction that builds up where it is not simulated; say what is simplified."""
    if scene.ways is None:
        return
    if method != "timestepping":
        raise SimulationError(
            f"{scene.source}: presliding: {method} has no friction that builds up over a way; take "
            "method timestepping, or leave it out (`scene.without_presliding`)"
        )
    if motors and any(lossy_gears(scene.gears())):
        raise SimulationError(
            f"{scene.source}: presliding: losses of gears do not build up in simulations; give "
            "efforts at the joints, or leave it out (`scene.without_presliding`)"
        )
    if scene.ways.gradual.any():
        warnings.warn(
            f"{scene.source}: presliding.shape gradual: simulated as sharp, with the same way",
            PinfricWarning,
            stacklevel=3,
        )


def end_of(scene: Scene, t_end: float | None = None) -> float:
    """Return the end of a simulation, s: the one given, else the scene's.

    Raises:
        SimulationError: the scene has none.
    """
    expect_scene(scene, "simulate")
    if t_end is not None:
        return t_end
    if scene.simulation is None:
        raise SimulationError(
            f"{scene.source}: has no `simulation` section; add one with start, effort and t_end, "
            "or give q0, v0, effort and t_end (s)"
        )
    if scene.simulation.t_end is None:
        raise SimulationError(
            f"{scene.source}: `simulation.t_end` is missing; e.g. t_end: 1.0, or give t_end (s)"
        )
    return scene.simulation.t_end


def _held(effort: Effort, settings: Settings, breakpoints: Sequence[float] | None) -> Effort:
    """Return an effort that is asked once a period, as a digital controller is."""
    period = settings.control_period
    assert period is not None
    if breakpoints is not None:
        raise SimulationError(
            f"breakpoints: with control_period = {period:g} s efforts jump only where a period "
            "begins; leave them out"
        )
    periods = int(np.ceil(settings.t_end / period - 1e-9))
    return replace(effort, breakpoints=np.arange(1, periods) * period, finest=np.inf, held=True)


def _longest_step(effort: Effort, method: str, t_end: float) -> float:
    """Longest step (s) that resolves the efforts, as far as they are known."""
    step = t_end / 50 if effort.finest is None else min(t_end / 4, effort.finest)
    _check_steps(method, "efforts that change within", step, t_end)
    return step


def _check_steps(method: str, what: str, step: float | None, t_end: float) -> None:
    """Refuse a longest step with which the run would not end."""
    if method != "timestepping" and step is not None and t_end / step > _MOST_SHORT_STEPS:
        raise SimulationError(
            f"t_end = {t_end:g} s with {what} {step:g} s: {t_end / step:.3g} steps; {method} takes "
            f"at most {_MOST_SHORT_STEPS:g}; shorten t_end, or give the mean of a fast effort"
        )


def _run(
    method: str, system: System, settings: Settings, record: Recorder, q: np.ndarray, v: np.ndarray
) -> Motion:
    """Integrate; return the motion so far where the user or an error ends the run."""
    v = np.where(np.isin(np.arange(len(v)), system.ws.held), 0.0, v)
    try:
        if method == "event":
            EventIntegration(system, settings, record).run(q, v)
        elif method == "timestepping":
            step_through(system, settings, record, q, v)
        else:
            RegularizedIntegration(system, settings, record).run(q, v)
    except KeyboardInterrupt as interrupt:
        if not record.rows:  # before the first sample
            raise
        raise SimulationInterrupted(
            record.motion(INTERRUPTED, "stopped by the user")
        ) from interrupt
    except (AccelerationError, SimulationError) as problem:
        if record.rows:
            problem.motion = record.motion(FAILED, str(problem))
        raise
    motion = record.motion(FINISHED, f"reached t_end = {settings.t_end:g} s")
    mention_unmeasured(motion.scene, motion.v)
    return motion


def _settings(
    method: str,
    t_end: float,
    *,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    dt: float = 1e-3,
    control_period: float | None = None,
    sample_step: float | None = None,
    max_step: float | None = None,
    regularization_velocity: float = 1e-3,
    max_events: int = 100_000,
) -> Settings:
    """Check the numbers and fill in defaults that depend on others."""
    if method not in METHODS:
        raise SimulationError(f"method {method!r}: {choose_from(method, METHODS)}")
    steps = {
        "dt": dt,
        "control_period": control_period,
        "sample_step": sample_step,
        "max_step": max_step,
    }
    others = {"rtol": rtol, "atol": atol, "max_events": max_events}
    others["regularization_velocity"] = regularization_velocity
    for name, value in {"t_end": t_end, **steps, **others}.items():
        if value is None:
            continue
        good = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not good or not np.isfinite(value) or value <= 0:
            raise SimulationError(f"{name} = {value!r}: should be a positive number")
        if name in ("t_end", *steps) and value < SMALLEST:
            raise SimulationError(f"{name} = {value:g} s: should be at least {SMALLEST:g} s")
    if max_events != int(max_events):
        raise SimulationError(f"max_events = {max_events!r}: should be a whole number")
    if not _FINEST <= rtol <= 1 or atol > 1:
        raise SimulationError(
            f"rtol = {rtol:g}, atol = {atol:g}: should be at most 1, rtol at "
            f"least {_FINEST:g} (rounding)"
        )
    fixed = dt if method == "timestepping" else None
    _check_counts(t_end, sample_step=sample_step, dt=fixed, control_period=control_period)
    _check_steps(method, "max_step =", max_step, t_end)
    if t_end > LONGEST_TIME:
        raise SimulationError(f"t_end = {t_end:g} s: should be at most {LONGEST_TIME:g} s")
    t_end = float(t_end)
    return Settings(
        t_end=t_end,
        rtol=float(rtol),
        atol=float(atol),
        dt=float(dt),
        control_period=None if control_period is None else float(control_period),
        max_step=t_end if max_step is None else float(max_step),
        sample_step=_default_step(t_end) if sample_step is None else float(sample_step),
        regularization_velocity=float(regularization_velocity),
        max_events=int(max_events),
    )


def _default_step(t_end: float) -> float:
    """Return the time between samples (s); a short motion has fewer, since each costs a solve."""
    return max(t_end / _SAMPLES, min(t_end / _FEWEST, _SHORTEST))


def _check_counts(t_end: float, **steps: float | None) -> None:
    """Refuse fixed steps (s) that are too many."""
    for name, step in steps.items():
        most = _MOST_SHORT_STEPS if name == "control_period" else _MOST_STEPS
        if step is not None and t_end / step > most:
            raise SimulationError(
                f"t_end = {t_end:g} s at {name} = {step:g} s: {t_end / step:.3g} "
                f"steps; at most {most:g} are possible"
            )


def _start(scene: Scene, q0: Any, v0: Any) -> tuple[np.ndarray, np.ndarray]:
    model = scene.model
    if q0 is None:
        own = start_state(scene)
        q0, v0 = own[0], own[1] if v0 is None else v0
    v0 = np.zeros(model.nv) if v0 is None else v0
    q, v = vector("q0", q0, model.nq, "nq", model), vector("v0", v0, model.nv, "nv")
    for name, array in (("q0", q), ("v0", v)):
        if (wrong := impossible(array)).any():
            i = int(np.argmax(wrong))
            raise StateError(
                f"{name}: column {i} is {array[i]}; should be finite and at most "
                f"{LARGEST_OF_A_MOTION:g}"
            )
    states = States.of(scene, q, v, np.zeros(scene.model.nv))
    q, v = states.q[0], states.v[0]
    if scene.linkage is not None:
        check_closed(scene, q, v)
    return q, v


class _Progress:
    """Calls the user's function, or shows a bar if a run takes long."""

    def __init__(self, wanted: bool | Callable[[float], None] | None, t_end: float) -> None:
        self.wanted, self.t_end = wanted, t_end
        self.bar: Any = None
        self.start = time.monotonic()

    def __enter__(self) -> Callable[[float], None]:
        if callable(self.wanted):
            return self.wanted
        if self.wanted is False or (self.wanted is None and not sys.stderr.isatty()):
            return lambda t: None
        return self._show

    def _show(self, t: float) -> None:
        if self.bar is None:
            if self.wanted is None and time.monotonic() - self.start < _PATIENCE:
                return
            from rich.console import Console
            from rich.progress import Progress

            self.bar = Progress(console=Console(stderr=True), transient=True)
            self.bar.start()
            self.task = self.bar.add_task("simulating", total=self.t_end)
        self.bar.update(self.task, completed=t)

    def __exit__(self, *_: object) -> None:
        if self.bar is not None:
            self.bar.stop()
