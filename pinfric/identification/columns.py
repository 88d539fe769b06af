"""The linear model of one log: all columns that coefficients multiply, low-passed and thinned.

    y = Y(q, v, a) theta + J a + friction      theta: 10 inertial parameters per link

Rows are kept where a joint slides, away from its turning points: no law describes presliding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.samples.presliding import carry_shares
from pinfric.identification.laws import BACKWARD, BEARING, FORWARD, GEARS, INERTIA, SIDES, SPEEDS, K
from pinfric.identification.recordings import Recording
from pinfric.model.arrays import BoolArray, FloatArray, IntArray
from pinfric.model.couples import delivery
from pinfric.model.friction_terms import LoadFriction
from pinfric.model.presliding import GRADUAL
from pinfric.model.scene import Scene
from pinfric.model.schema import Friction
from pinfric.motions.log.noise import low_pass
from pinfric.motions.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


#: Hz of the low pass on all columns: friction's steps at reversals have no end in frequency.
PASS = 8.0
#: Samples per period of that low pass.
_PER_PERIOD = 4.0
#: Periods of the low pass that are left out beside what does not slide; s left out at both ends.
_BESIDE, _AT_ENDS = 0.35, 0.3
#: Periods of it between samples from which a reversal between two of them is left out: both signs
#: fall on samples, which draws a delay to multiples of the step.
COARSE = 0.125
#: s: half of the time as slow as noise from which a joint rests, and does not only turn.
_TURN = 0.1
#: Samples of all logs that are kept, an hour at 4 Hz: residuals are autocorrelated over a longer
#: time than these are apart, so more would tell little.
_MOST = 15_000
#: Numbers that are low-passed at once.
_AT_ONCE = 2**20
#: Samples computed at a time; s beyond both ends after which the low pass has no influence.
PART, _FORGOTTEN = 8192, 2.0
#: s: blocks must be longer than residuals are autocorrelated, and short enough to be many.
_BLOCK = (1.0, 5.0)
_BLOCKS, _MOST_BLOCKS = 10, 200
#: rad or m: ways over which friction may build up after a reversal, of the fit of a delay.
PRESLIDING = (1e-3, 4e-3, 1.6e-2)
#: Rows of a joint in one direction from which friction in that direction is its own coefficient.
FEWEST_ROWS = 25
#: A coefficient so small that the load it reports is that without friction.
_HARDLY = 1e-9


@dataclass(frozen=True)
class Rows:
    """The rows of one joint that slide in any log, low-passed and thinned.

    Attributes:
        rigid: (n, 10 nj) derivatives of the effort by the links' inertial parameters.
        slots: (n, K) what the joint's own coefficients multiply.
        effort: (n,) measured less what payloads take, N m or N.
        block, log: (n,) numbers of each row's block and log.
        time, velocity, load: (n,) s, rad/s or m/s, and effort without friction (N m or N).
    """

    rigid: FloatArray
    slots: FloatArray
    effort: FloatArray
    block: IntArray
    log: IntArray
    time: FloatArray
    velocity: FloatArray
    load: FloatArray

    @property
    def columns(self) -> FloatArray:
        """(n, 10 nj + K) `rigid` and `slots` side by side."""
        return np.hstack((self.rigid, self.slots))


@dataclass(frozen=True)
class Prepared:
    """The columns of one log, low-passed and thinned; T samples, n of them kept.

    Attributes:
        kept: (n,) samples that stay after thinning.
        slides: (n, nj) where a joint slides: the rows that are fitted.
        rigid, slots: (n, nj, ...) as in `Rows`; slots of loads are 0 before `with_loads`.
        rigid_rates, slot_rates: their derivatives by time, from all samples: those that are kept
            are too far apart to be differentiated. They only weigh the delay: single precision.
        effort: time -> (., nj) low-passed, less what payloads and springs take. A cubic spline:
            linear interpolation has less noise between samples, which would bias delays.
        payload: (T, nj) what payloads take, less what springs and forces on frames give, N m or N.
        load, bearing: (T, nj) by the present estimate, N m or N: effort without friction; load of
            the joint's bearing, or of its gear where the scene names no bearing.
        presliding: (n, nj, 3) what friction lacks that builds up over a way; only the delay has it.
        turns: (n, nj) sliding rows so soon after a reversal that friction may still build up.
        missing: (T, nj) gravity by the URDF where the efforts hold none, else 0, N m or N.
        share: (T, nj) of dry friction against forward motion: the sign of the velocity, or what
            has built up of it.
    """

    recording: Recording
    kept: IntArray
    slides: BoolArray
    rigid: FloatArray
    slots: FloatArray
    rigid_rates: NDArray[np.float32]
    slot_rates: NDArray[np.float32]
    effort: BSpline
    payload: FloatArray
    load: FloatArray
    bearing: FloatArray
    presliding: FloatArray
    turns: BoolArray
    missing: FloatArray
    share: FloatArray


def thinning(recordings: Sequence[Recording]) -> int:
    """Return the factor of thinning beyond what the low pass allows, for all logs."""
    count = sum(recording.trajectory.t.size / _spacing(recording.step) for recording in recordings)
    return int(np.ceil(count / _MOST))


def _spacing(step: float) -> int:
    return max(1, int(1.0 / (_PER_PERIOD * PASS * step)))


def prepare(
    scene: Scene, recording: Recording, thin: int = 1, no_gravity: bool = False
) -> Prepared:
    """Return a log's columns, with loads by the URDF's inertias.

    Args:
        scene: the robot as its URDF has it. recording: one log.
        thin: factor of thinning beyond what the low pass allows.
        no_gravity: whether the efforts hold no gravity; loads of bearings and gears do.
    """
    from scipy.interpolate import BSpline, make_interp_spline

    motion, step, nj = recording.trajectory, recording.step, scene.model.nv
    rigid_effort = along(scene, motion)[0]
    payload = missing = np.broadcast_to(0.0, rigid_effort.shape)
    seen, gravity_as_logged = rigid_effort, scene
    if no_gravity:
        gravity_as_logged = scene.with_(model=weightless(scene.model), friction={})
        seen = along(gravity_as_logged, motion)[0]
        missing = rigid_effort - seen
    if scene.payloads or scene.springs or motion.external:
        empty = replace(motion, attached=np.zeros_like(motion.attached), external={})
        bare = gravity_as_logged.with_(friction={}, springs=())
        payload = seen - along(bare, empty)[0]
    known = np.isfinite(recording.effort)
    measured = np.where(known, recording.effort, seen) - payload
    kept = np.arange(0, motion.t.size, thin * _spacing(step))
    slides = _sliding(recording, known)[kept]
    # one after another, to spare memory
    splines = [make_interp_spline(motion.t, column, k=3) for column in passed(measured, step).T]
    effort = BSpline(splines[0].t, np.column_stack([spline.c for spline in splines]), 3)
    v, sign = recording.velocity, np.sign(recording.velocity)
    own = {INERTIA: recording.acceleration, FORWARD: v > 0.0, BACKWARD: -1.0 * (v < 0.0)}
    own |= {slot: sign * np.abs(v) ** p for slot, p in SPEEDS.items()}
    slots = np.zeros((kept.size, nj, K))
    slot_rates = slots.astype(np.float32)
    for slot, columns in own.items():
        whole = passed(columns.astype(np.float64), step)
        slots[:, :, slot], slot_rates[:, :, slot] = thinned(whole, kept, step)
    rigid, rigid_rates = _rigid_columns(gravity_as_logged, recording, kept)
    presliding, turns = _presliding(recording, kept)
    return Prepared(
        recording,
        kept,
        slides,
        rigid,
        slots,
        rigid_rates,
        slot_rates,
        effort,
        payload,
        rigid_effort,
        rigid_effort,
        presliding,
        turns & slides,
        missing,
        np.sign(v),
    )


def shares(recording: Recording, joint: int, way: float, gradual: bool) -> FloatArray:
    """Return (T,) the share z of a joint's friction along a log, 0 where its start is not known.

    `way`: d, rad or m; 0: friction acts at once.
    """
    t, v = recording.trajectory.t, recording.velocity[:, joint]
    if way <= 0.0:
        return np.sign(v)
    stops = way * np.array([GRADUAL if gradual else (1.0, np.nan, np.nan)])
    low, high = np.empty((2, v.size, 1))
    q, v = (np.ascontiguousarray(x)[:, None] for x in (recording.position[:, joint], v))
    carry_shares(t, q, v, np.array([-1.0]), stops, 0.0, low, high)
    return 0.5 * (low + high)[:, 0]


def _presliding(recording: Recording, kept: IntArray) -> tuple[FloatArray, BoolArray]:
    """Return sign v - z(d), low-passed (n, nj, 3), and where a joint has just reversed (n, nj).

    z builds up gradually over each way of `PRESLIDING`; just is within the longest.
    """
    step, nj = recording.step, recording.velocity.shape[1]
    columns = np.zeros((kept.size, nj, len(PRESLIDING)))
    soon = np.zeros(recording.velocity.shape, dtype=bool)
    for j, sign in enumerate(np.sign(recording.velocity).T):
        for k, way in enumerate(PRESLIDING):
            lacks = sign - shares(recording, j, way, gradual=True)
            columns[:, j, k] = passed(lacks, step)[kept]
        soon[:, j] = shares(recording, j, 0.5 * PRESLIDING[-1], gradual=False) != sign
    return columns, _beside(soon, step)[kept]


def weightless(model: pin.Model) -> pin.Model:
    """Return a copy of a robot without gravity."""
    copied = model.copy()
    copied.gravity.linear = np.zeros(3)
    return copied


def along(scene: Scene, motion: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Return effort without friction (T, nj) and sites' loads (T, sites), by parts."""
    parts = [
        (chunk.effort_frictionless, chunk.normal_load)
        for chunk in inverse_dynamics(scene, motion, chunks=PART)
    ]
    effort, load = (np.concatenate(column) for column in zip(*parts, strict=True))
    return effort, load


def regressors(scene: Scene, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
    """Return (T, nj, 10 nj) efforts by inertial parameters of links; P times it with couples."""
    model, nj = scene.model, scene.model.nv
    data, P = model.createData(), delivery(scene.drives, nj)
    states = zip(q, v, a, strict=True)
    Y = np.array(
        [pin.computeJointTorqueRegressor(model, data, *state) for state in states]
    ).reshape(-1, nj, 10 * nj)  # of one joint they are vectors
    return np.asarray(P @ Y) if P.size else Y


def _rigid_columns(
    scene: Scene, recording: Recording, kept: IntArray
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Return regressors of the links' inertial parameters, low-passed: (n, nj, 10 nj); rates.

    Computed in parts to fit in memory; they overlap by the time over which the low pass has
    influence.
    """
    motion, nj = recording.trajectory, scene.model.nv
    beyond = int(np.ceil(_FORGOTTEN / recording.step))
    thin = np.zeros((kept.size, nj, 10 * nj))
    rates = thin.astype(np.float32)
    for first in range(0, motion.t.size, PART):
        own = np.flatnonzero((kept >= first) & (kept < first + PART))
        start = max(first - beyond, 0)
        span = slice(start, first + PART + beyond)
        regressor = regressors(scene, motion.q[span], motion.v[span], motion.a[span])
        for j in range(nj):
            used = np.flatnonzero(regressor[:, j].any(axis=0))
            whole = passed(regressor[:, j, used], recording.step)
            at = own[:, None], j, used
            thin[at], rates[at] = thinned(whole, kept[own] - start, recording.step)
    return thin, rates


def thinned(columns: FloatArray, kept: IntArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return kept rows of columns (T, ...) and their derivatives by time, of fourth order.

        x'(t) = (8 (x(t + h) - x(t - h)) - (x(t + 2 h) - x(t - 2 h)))/(12 h)

    At both ends, where nothing slides, samples beyond are taken as the last. `step`: h, s.
    """
    before2, before, after, after2 = (
        columns[np.clip(kept + away, 0, len(columns) - 1)] for away in (-2, -1, 1, 2)
    )
    return columns[kept], (8.0 * (after - before) - (after2 - before2)) / (12.0 * step)


def passed(columns: FloatArray, step: float) -> FloatArray:
    """Return columns (T, ...) behind the common low pass; `step` in s."""
    if step * PASS >= 0.45:
        return columns
    if columns.size < _AT_ONCE or columns.ndim == 1:
        return low_pass(columns, step, PASS)
    return np.column_stack([low_pass(column, step, PASS) for column in columns.T])


def _sliding(recording: Recording, known: BoolArray) -> BoolArray:
    """(T, nj) where a joint slides with a known effort, turning points left out."""
    step, v = recording.step, recording.velocity
    stands = (np.abs(v) <= recording.slowest) | ~known
    if coarse(step):  # else signs tell the reversals, and these the delay
        stands[1:] |= v[1:] * v[:-1] < 0.0  # between two samples it was as slow
    return _apart(stands, step)


def coarse(step: float) -> bool:
    """Return whether samples (s apart) are so rare that signs fall on them at reversals."""
    return step * PASS > COARSE


def unresting(recording: Recording) -> BoolArray:
    """(T, nj) where a joint moves or only turns, with a known effort."""
    fast = np.abs(recording.velocity) > recording.slowest
    held = ~_near(fast, int(np.ceil(_TURN / recording.step)))
    return _apart(held | ~np.isfinite(recording.effort), recording.step)


def _apart(stands: BoolArray, step: float) -> BoolArray:
    """Return (T, nj) where no low pass reaches from what stands, nor from a log's ends."""
    apart, ends = ~_beside(stands, step), int(np.ceil(_AT_ENDS / step))
    apart[:ends] = apart[-ends:] = False
    return apart


def _beside(where: BoolArray, step: float) -> BoolArray:
    """Return (T, nj) where `where` holds or reaches through the low pass."""
    return _near(where, int(np.ceil(_BESIDE / (PASS * step))))


def _near(where: BoolArray, reach: int) -> BoolArray:
    """Return (T, nj) where `where` holds up to `reach` samples before or after."""
    count = np.cumsum(np.pad(where, ((reach + 1, reach), (0, 0)), mode="edge"), axis=0)
    return np.asarray(count[2 * reach + 1 :] - count[: -2 * reach - 1] > 0)


def settled(prepared: Prepared) -> Prepared:
    """Return a log without the rows in which friction may still build up after a reversal.

    A joint keeps them if they are most of its rows.
    """
    slides = prepared.slides & ~prepared.turns
    few = 2 * slides.sum(axis=0) < prepared.slides.sum(axis=0)
    return replace(prepared, slides=np.where(few, prepared.slides, slides))


def with_loads(prepared: Prepared, scene: Scene, inner: FloatArray) -> Prepared:
    """Return the columns with those of loads, by an estimate's effort without friction.

    Args:
        prepared: one log. scene: with the estimate's link inertias.
        inner: (T, nj) the estimate's friction on the joint's side of the gear, N m or N.
    """
    recording = prepared.recording
    motion, step = recording.trajectory, recording.step
    probe = bearings_only(scene)
    rigid, sites = along(probe, motion)
    slots, rates = prepared.slots.copy(), prepared.slot_rates.copy()
    kept, bearing = prepared.kept, np.abs(rigid)

    def put(j: int, slot: int, column: FloatArray) -> None:
        slots[:, j, slot], rates[:, j, slot] = thinned(passed(column, step), kept, step)

    for j, name in enumerate(scene.joint_names):  # one after another: long logs fill the memory
        sign = prepared.share[:, j]
        for slot, dry in ((FORWARD, np.maximum(sign, 0.0)), (BACKWARD, np.minimum(sign, 0.0))):
            put(j, slot, dry)
        if name in probe.site_names:
            bearing[:, j] = sites[:, probe.site_names.index(name)]
            put(j, BEARING, sign * bearing[:, j])
        for side, x in zip(SIDES, (rigid[:, j], rigid[:, j] + inner[:, j]), strict=True):
            both = sign * np.abs(x)
            for direction, where in (
                ("driving", x * sign > 0.0),
                ("driven", x * sign < 0.0),
                ("both", True),
            ):
                put(j, GEARS[side, direction], both * where)
        if name not in probe.site_names:
            for columns in (slots, rates):
                columns[:, j, BEARING] = columns[:, j, GEARS["motor", "both"]]
    return replace(prepared, slots=slots, slot_rates=rates, load=rigid, bearing=bearing)


def bearings_only(scene: Scene) -> Scene:
    """Return the scene with bearings of negligible friction, for their loads."""
    return scene.with_(
        friction={
            name: Friction(bearing=entry.bearing, mu=LoadFriction(static=_HARDLY, kinetic=_HARDLY))
            for name, entry in scene.friction.items()
            if entry.bearing is not None
        }
    )


def joint_rows(logs: Sequence[Prepared], joint: int, delay: float) -> Rows:
    """Return one joint's rows in all logs, whose efforts lag behind the motion by `delay` s.

    In a direction in which it hardly slides its Coulomb friction is taken as in the other.
    """
    parts, first = [], 0
    for number, prepared in enumerate(logs):
        t = prepared.recording.trajectory.t
        rows = prepared.kept[prepared.slides[:, joint]]
        count, block = blocks(t)
        parts.append(
            Rows(
                prepared.rigid[prepared.slides[:, joint], joint],
                prepared.slots[prepared.slides[:, joint], joint],
                prepared.effort(t[rows] + delay)[:, joint],
                first + block[rows],
                np.full(rows.size, number),
                t[rows],
                prepared.recording.velocity[rows, joint],
                prepared.load[rows, joint],
            )
        )
        first += count
    joined = Rows(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in Rows.__dataclass_fields__
        )
    )
    forward, backward = joined.slots[:, FORWARD], joined.slots[:, BACKWARD]
    for seen, own, other in (
        (joined.velocity > 0.0, forward, backward),
        (joined.velocity < 0.0, backward, forward),
    ):
        if seen.sum() < FEWEST_ROWS:  # what the low pass leaks into it would fit anything
            other += own
            own[:] = 0.0
    return joined


def at_rows(parts: Sequence[FloatArray], logs: Sequence[Prepared], joint: int) -> FloatArray:
    """Return a joint's column at its rows in all logs, of columns (n, nj) at what each keeps."""
    pairs = zip(parts, logs, strict=True)
    return np.concatenate([part[log.slides[:, joint], joint] for part, log in pairs])


def blocks(t: FloatArray) -> tuple[int, IntArray]:
    """Return the number of blocks of 1 to 5 s of a log, and each sample's block.

    A log of more than 1000 s has 200 longer blocks.
    """
    span = float(t[-1] - t[0])
    count = max(1, round(span / float(np.clip(span / _BLOCKS, *_BLOCK))))
    count = min(count, _MOST_BLOCKS)
    return count, np.minimum(((t - t[0]) / span * count).astype(np.int64), count - 1)
