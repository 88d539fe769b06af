"""The result of a simulation."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.result import StickInterval, runs
from pinfric.dynamics.samples.closure import working_rates
from pinfric.dynamics.samples.reactions import spring_energy
from pinfric.errors import PinfricError, SimulationError, StateError
from pinfric.model.arrays import real_numbers
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.closure import velocity_names
from pinfric.model.coordinates import motion_columns
from pinfric.model.described import described, quantity
from pinfric.model.drives import lossy_gears, write_motor_torques
from pinfric.model.files import write_file
from pinfric.model.scene import Scene
from pinfric.model.upward import Shown

if TYPE_CHECKING:
    import pandas as pd

FINISHED, INTERRUPTED, FAILED = "finished", "interrupted", "failed"
FORMAT = 1
#: So often a step of integration is halved towards a bend.
_MOST_HALVES = 16
#: Efforts this small beside a drive's largest have no sign.
_ROUNDING = 1e-12
#: Arrays of a motion that go into its file as they are.
ARRAYS = (
    "t",
    "q",
    "v",
    "a",
    "effort",
    "modes",
    "friction",
    "normal_load",
    "phase_t",
    "phase_modes",
)
#: Those of them with a column for each site.
SITE_ARRAYS = ("modes", "friction", "normal_load")

#: Time (s) of a sample; q, v, a, effort, modes, friction, load, and motor torques where given.
Row = tuple[float, np.ndarray]

#: What a motion can do, as its `repr` says.
_MORE = ".summary() .plot() .to_dataframe() .stick_intervals() .energy() .sample(t)"


@described
class Event:
    """An event at an instant."""

    time: float = quantity("when", "s", "time", "{time:.6f}")
    name: str = quantity("the site or joint", heading="joint", name=True)
    kind: str = quantity(
        "`stick`, `slip`, `reversal` (a site passes through rest without sticking), `limit` (a "
        "joint leaves its range)",
        heading="what",
    )
    direction: int = quantity(
        "of the slip that follows, or side of the limit: -1, 0, 1", heading="direction"
    )


@dataclass(frozen=True)
class Energy:
    """Energy balance, J: work = change + sum(friction_loss) + sum(gear_loss) + `residual`.

    Attributes:
        work: of the efforts or motor torques that were given.
        change: of kinetic and potential energy, with the rotors' where motor torques were given.
        friction_loss: (ns,) heat at each site.
        gear_loss: (na,) heat in each gear and its motor; 0 where efforts were given.
        residual: the error of the integration.
    """

    work: float
    change: float
    friction_loss: np.ndarray
    gear_loss: np.ndarray
    residual: float


@dataclass(frozen=True, eq=False)
class Motion(Shown):
    """The result of `simulate`; one row per sample, SI units.

    At an instant where modes change there is one sample, with the values after the change.

    Attributes:
        scene: what was simulated.
        method: `event`, `timestepping` or `regularized`.
        t: (T,) s.
        q, v, a: (T, nq), (T, nv), (T, nv); v and a exactly 0 where a joint sticks (not by
            `regularized`, which has no stick).
        effort: (T, na) N m or N at the joints: given, or `motor_torque` after the gears' losses.
        modes: (T, ns) -1, 0, 1: slips backward, sticks, slips forward.
        friction, normal_load: (T, ns), see `Instant`.
        events: in the order of time.
        phase_t: (P + 1,) borders of the times of constant modes; phase_modes: (P, ns).
        status: `finished`, `interrupted` or `failed`; message: why it ended.
        evaluations: right-hand sides computed.
        carried: names of the payloads carried; None: those attached by default.
        motor_torque: (T, na) N m at the motors' shafts; None: efforts were given.
        unproved: times (s) from which other modes may obey the laws, too (`Instant.answers` 0).
        dense: the integrator's polynomials; None where there are none.
    """

    scene: Scene
    method: str
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    effort: np.ndarray
    modes: np.ndarray
    friction: np.ndarray
    normal_load: np.ndarray
    events: tuple[Event, ...]
    phase_t: np.ndarray
    phase_modes: np.ndarray
    status: str
    message: str
    evaluations: int
    carried: tuple[str, ...] | None = None
    motor_torque: np.ndarray | None = None
    unproved: tuple[float, ...] = ()
    dense: Dense | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        driven = "" if self.motor_torque is None else ", torques of the motors given"
        title = (
            f"of {file_name(self.scene.source)} by {self.method}{driven}: "
            f"{counted(len(self.t), 'sample')}, {self.t[-1] - self.t[0]:.4g} s"
        )
        kinds = [event.kind for event in self.events]
        happened = [counted(kinds.count(kind), kind) for kind in dict.fromkeys(kinds)]
        intervals = self.stick_intervals()
        sticks = [f"{i.start:.4g}-{i.end:.4g} s" for i in intervals]
        speeds = [f"{x:.3g}" for x in np.abs(self.v).max(axis=0, initial=0.0)]
        largest = listed(velocity_names(self.scene.model), speeds)
        return screen(
            "Motion",
            title,
            {
                "speeds": f"{largest} (largest, rad/s or m/s)",
                "sticks": listed([i.site for i in intervals], sticks) or "none",
                "events": ", ".join(happened) or "none",
                "unproved": listed_times(self.unproved),
                "status": f"{self.status}; {counted(self.evaluations, 'right-hand side')}"
                + (f"; {self.message}" if self.status != FINISHED else ""),
                "more": _MORE,
            },
        )

    @property
    def given(self) -> str:
        """The input of the drives: "effort" or "motor_torque"."""
        return "effort" if self.motor_torque is None else "motor_torque"

    @property
    def site_names(self) -> tuple[str, ...]:
        """Names of the columns of modes, friction and normal_load."""
        return self.scene.site_names

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """Names of the columns of effort."""
        return self.scene.actuator_names

    @property
    def attached(self) -> np.ndarray | None:
        """(T, np) payloads carried, as `inverse_dynamics` takes it; None: the default."""
        if self.carried is None:
            return None
        return np.tile([name in self.carried for name in self.scene.payloads], (len(self.t), 1))

    def stick_intervals(self) -> tuple[StickInterval, ...]:
        """Return when each site sticks, in the order of the sites; ends as located, not sampled."""
        intervals = []
        for s, site in enumerate(self.scene.sites):
            if not site.law.dry:
                continue
            for first, last in runs(self.phase_modes[:, s] == 0):
                start, end = self.phase_t[first], self.phase_t[last + 1]
                intervals.append(StickInterval(site.name, float(start), float(end)))
        return tuple(intervals)

    def sample(self, t: Any) -> Motion:
        """Return the motion at other times (T',), from the integrator's polynomials.

        Accelerations and friction are computed at each time, in its modes (at a change: those after
        it). Events and stick intervals stay those of the whole motion.

        Raises:
            StateError: times outside the motion or not increasing; a motion from a file, or of
                another method than `event`.
        """
        times = np.atleast_1d(real_numbers("t", t))
        if self.dense is None:
            raise StateError(
                f"this motion cannot be sampled at other times (method {self.method!r}, or read "
                "from a file); use its samples, or simulate with a smaller `sample_step`"
            )
        if not ((times >= self.t[0]) & (times <= self.t[-1])).all():
            raise StateError(f"sample: times outside {self.t[0]:g} to {self.t[-1]:g} s")
        if (np.diff(times) <= 0).any():
            raise StateError("sample: times do not increase")
        return self.dense.sample(self, times)

    def energy(self) -> Energy:
        """Return the balance of energy over the whole motion.

        `event`: by Gauss quadrature on the integrator's polynomials, as exact as the motion; else
        by the trapezoidal rule over the samples.
        """
        return self._energy

    @cached_property
    def _energy(self) -> Energy:
        model = self.scene.loaded_model(self.carried)
        data, springs = model.createData(), spring_energy(self.scene.twin(), self.q[[0, -1]])

        def total(i: int) -> float:
            return mechanical_energy(model, data, self.q[i], self.v[i]) + float(springs[i])

        if self.dense is not None:
            sums = self.dense.integrate(self)
        else:
            sums = np.trapezoid(powers(self), self.t, axis=0)
        change, ns = total(-1) - total(0), len(self.scene.sites)
        if self.motor_torque is not None:
            ends = self.q[[0, -1]], self.v[[0, -1]]
            gears, (rate, _) = self.scene.gears(), working_rates(self.scene, *ends)
            rotors = 0.5 * gears.ratio**2 * gears.rotor_inertia * rate**2
            change += float((rotors[1] - rotors[0]).sum())
        return Energy(
            float(sums[0]),
            change,
            sums[1 : 1 + ns],
            sums[1 + ns :],
            float(sums[0] - change - sums[1:].sum()),
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return all columns with names: t, `<joint>.q` (one number), then `<name>.<quantity>`."""
        import pandas as pd

        columns: dict[str, np.ndarray] = {"t": self.t}
        columns |= motion_columns(self.scene.model, self.q, self.v, self.a)
        site = {quantity: self.site_names for quantity in SITE_ARRAYS}
        drive = {"effort": self.actuator_names}
        if self.motor_torque is not None:
            drive["motor_torque"] = self.actuator_names
        for array, names in {**drive, **site}.items():
            for i, name in enumerate(names):
                columns[f"{name}.{array}"] = getattr(self, array)[:, i]
        return pd.DataFrame(columns)

    def save(self, path: str | Path) -> Path:
        """Write an npz file for `load_motion`, with a digest of the scene's parts; return its path.

        A name without the ending `.npz` gets it.
        """
        path = Path(path)
        if path.suffix != ".npz":
            path = path.with_name(f"{path.name}.npz")
        about = {
            "format": FORMAT,
            "method": self.method,
            "status": self.status,
            "message": self.message,
            "evaluations": self.evaluations,
            "scene": scene_digests(self.scene, self.given),
            "source": self.scene.source,
            "carried": self.carried,
            "unproved": self.unproved,
            "events": [[e.time, e.name, e.kind, e.direction] for e in self.events],
        }
        arrays = {name: getattr(self, name) for name in ARRAYS}
        if self.motor_torque is not None:
            arrays["motor_torque"] = self.motor_torque

        def write(file: Path) -> None:
            np.savez_compressed(
                file, allow_pickle=False, about=np.array(json.dumps(about)), **arrays
            )

        try:
            return write_file(path, write)
        except PinfricError as problem:
            raise SimulationError(str(problem)) from None


def listed_times(unproved: tuple[float, ...]) -> str:
    """Say from when on other modes may obey the laws, too; "" if never."""
    if not unproved:
        return ""
    more = f", and after {len(unproved) - 1} later changes" if len(unproved) > 1 else ""
    return f"other modes may obey the laws as well from {unproved[0]:.6g} s on{more}"


def mechanical_energy(model: pin.Model, data: pin.Data, q: np.ndarray, v: np.ndarray) -> float:
    """Return kinetic plus potential energy (J), with mimic joints, which Pinocchio leaves out."""
    if any(joint.shortname() == "JointModelMimic" for joint in model.joints[1:]):
        weight = pin.rnea(model, data, q, 0.0 * v, 0.0 * v)  # `crba` wants joints depth first
        kinetic = 0.5 * v @ (pin.rnea(model, data, q, 0.0 * v, v) - weight)
        centre = pin.centerOfMass(model, data, q)
        return float(kinetic - pin.computeTotalMass(model) * model.gravity.linear @ centre)
    kinetic = pin.computeKineticEnergy(model, data, q, v)
    return float(kinetic + pin.computePotentialEnergy(model, data, q))


def scene_digests(scene: Scene, given: str) -> dict[str, str]:
    """Return a digest of each part of a scene that a motion depends on.

    Args:
        scene: what was simulated.
        given: `Motion.given`; the gears count for "motor_torque".
    """
    model = scene.model
    joints = range(1, model.njoints)
    bodies = [model.inertias[j].toDynamicParameters().tolist() for j in joints]
    frames = [model.jointPlacements[j].homogeneous.tolist() for j in joints]
    kinds = [(model.joints[j].shortname(), int(model.parents[j])) for j in joints]
    twin = scene.twin()
    parts: dict[str, Any] = {
        "joints": [scene.joint_names, kinds, frames, twin.axis.tolist(), twin.ratio.tolist()],
        "inertias": [bodies, np.asarray(model.armature).tolist()],
        "gravity": np.asarray(model.gravity.linear).tolist(),
        "payloads": {name: p.model_dump() for name, p in sorted(scene.payloads.items())},
        "friction": {name: f.model_dump() for name, f in sorted(scene.friction.items())},
        "stick velocity": scene.stick_velocity,
        "springs": [spring.model_dump() for spring in scene.springs],
        "actuators": scene.actuator_names,
    }
    named = {"installed"}  # a product's name moves nothing
    actuators = [actuator.model_dump(exclude=named) for actuator in scene.actuators or ()]
    if given == "motor_torque":
        parts["transmissions"] = actuators
        if scene.closed_brakes:
            parts["closed brakes"] = sorted(scene.closed_brakes.items())
    if scene.linkage is not None:
        parts["loops"] = [loop.model_dump() for loop in scene.loops]
        parts["actuators"] = actuators
    return {
        name: hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]
        for name, content in parts.items()
    }


@dataclass(frozen=True, eq=False)
class Dense:
    """The integrator's polynomials, and accelerations on them.

    Attributes:
        t: (N + 1,) borders of the steps.
        at: step number, time (s) -> q (nq,), v (nv,).
        row: time, q, v -> what a sample holds in the modes of that time, see `Recorder.row`.
    """

    t: np.ndarray
    at: Callable[[int, float], tuple[np.ndarray, np.ndarray]]
    row: Callable[[float, np.ndarray, np.ndarray], Row]

    def rows(self, times: np.ndarray) -> list[Row]:
        """`Recorder.row` at times of the motion."""
        steps = np.clip(self.t.searchsorted(times, side="right") - 1, 0, len(self.t) - 2)
        return [
            self.row(time, *self.at(int(step), time))
            for time, step in zip(times.tolist(), steps, strict=True)
        ]

    def sample(self, motion: Motion, times: np.ndarray) -> Motion:
        """See `Motion.sample`."""
        return replace(motion, **columns(motion.scene, self.rows(times), motion.given))

    def integrate(self, motion: Motion) -> np.ndarray:
        """Integral of `powers` (J) over the motion, by Gauss's rule in every step."""
        total = np.zeros(1 + len(motion.scene.sites) + len(motion.scene.drives))
        inside = self.t[(self.t > motion.t[0]) & (self.t < motion.t[-1])]
        for start, end in pairwise([motion.t[0], *inside, motion.t[-1]]):
            total += self._integral(motion, start, end, 0)
        return total

    def _integral(self, motion: Motion, start: float, end: float, depth: int) -> np.ndarray:
        """`integrate` from start to end; in halves where a gear's mesh reverses: its loss bends."""
        nodes, weights = np.polynomial.legendre.leggauss(6)
        half = (end - start) / 2
        samples = self.sample(motion, start + half * (1 + nodes))
        if motion.motor_torque is not None and depth < _MOST_HALVES:
            lossy = lossy_gears(motion.scene.gears())
            either = np.minimum(samples.effort.max(axis=0), -samples.effort.min(axis=0))
            size = np.abs(motion.effort).max(axis=0, initial=0.0)
            if (either > _ROUNDING * size)[lossy].any():
                middle, deeper = start + half, depth + 1
                return self._integral(motion, start, middle, deeper) + self._integral(
                    motion, middle, end, deeper
                )
        return np.asarray(half * (weights @ powers(samples)))


def columns(scene: Scene, rows: list[Row], given: str) -> dict[str, Any]:
    """Return the arrays of a `Motion` with these samples, see `Motion.given`."""
    nv, na, ns, names = scene.model.nv, len(scene.drives), len(scene.sites), ARRAYS[1:8]
    times, numbers = zip(*rows, strict=True)
    ends = np.cumsum([scene.model.nq, nv, nv, na, ns, ns, ns])
    parts = np.split(np.array(numbers), ends, axis=1)
    arrays = {name: x.copy() for name, x in zip((*names, "motor_torque"), parts, strict=True)}
    arrays["modes"] = arrays["modes"].astype(np.int8)
    if given == "effort":
        del arrays["motor_torque"]
    return {"t": np.array(times), **arrays}


def powers(motion: Motion) -> np.ndarray:
    """Return (T, 1 + ns + na) W: of all drives, lost at each site, lost in each gear.

    A gear loses |v| (n + mu |t|) and its motor's viscous friction (`model/drives.py`); none where
    efforts at the joints were given.
    """
    scene, torque = motion.scene, motion.motor_torque
    drives, sites = working_rates(scene, motion.q, motion.v)
    drive_effort, lost = motion.effort, np.zeros_like(drives)
    if torque is not None:
        # a motion says itself what stands still: there rates are 0; all else loses as it slips
        gears = scene.gears()
        gears = gears._replace(stick_velocity=np.zeros_like(gears.stick_velocity))
        drive_effort, still = torque * gears.ratio, drives == 0.0
        lower, upper = np.empty((2, *drives.shape))
        write_motor_torques(
            gears, motion.effort, motion.effort, drives, np.zeros_like(drives), still, lower, upper
        )
        lost = np.where(still, 0.0, (lower * gears.ratio - motion.effort) * drives)
    work = (drive_effort * drives).sum(axis=1, keepdims=True)
    return np.concatenate([work, -motion.friction * sites, lost], axis=1)
