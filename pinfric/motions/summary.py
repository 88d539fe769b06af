"""The figures of a result that size a drive: peak, RMS, and share of friction."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.inverse.result import InverseResult, runs
from pinfric.errors import StateError
from pinfric.model.coordinates import is_sliding
from pinfric.model.couples import reaches
from pinfric.model.described import EFFORT, MOTOR, SPEED, between, described, quantity
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import stated_limit, stated_range


@described
class ActuatorSummary:
    """What one drive must deliver along a motion.

    At every sample the effort u lies in [lower, upper]; its worst value is the end that is larger
    in magnitude, its least value the number of smallest magnitude in between (0 where the interval
    encloses it). All RMS are over time, by the trapezoidal rule.
    """

    name: str = quantity("the drive's", heading="joint", name=True)
    unit: str = quantity('unit of its efforts, "N m" or "N"', heading="unit")
    peak: float = quantity("max |u_worst|", EFFORT, "peak")
    peak_time: float = quantity("when", "s")
    peak_velocity: float = quantity("the joint's velocity at that time", SPEED)
    rms: float = quantity(
        "sqrt(1/T int u_worst^2 dt)",
        EFFORT,
        "RMS\nleast\N{EN DASH}worst",
        between("rms_least", "rms"),
    )
    rms_least: float = quantity("sqrt(1/T int u_least^2 dt)", EFFORT)
    peak_frictionless: float = quantity(
        "peak of the effort without friction u_0",
        EFFORT,
        "frictionless\npeak, RMS",
        "{peak_frictionless}, {rms_frictionless}",
    )
    rms_frictionless: float = quantity("RMS of u_0", EFFORT)
    friction_share: float = quantity(
        "R_f / (R_f + R_0); R_f is the RMS of u_worst - u_0, R_0 that of u_0: 0 without friction, "
        "1 if there is only friction, 0.5 if friction is as large as the rest (rms / "
        "rms_frictionless would hide friction that holds the load)",
        heading="friction\nshare",
        cell="{friction_share:%}",
    )
    stick_time: float = quantity(
        "sum of (end - start) over the stick intervals; a stick of one sample is a passage through "
        "rest: it counts as an interval and adds no time",
        "s",
        "sticks",
    )
    sticks: int = quantity("number of stick intervals")
    reversals: int = quantity("number of reversals between samples")
    max_interval: float = quantity("max (upper - lower)", EFFORT, "widest\ninterval")
    motor_unit: str = quantity("at the motor's shaft; for an ideal drive, `unit`", heading="unit")
    motor_peak: float = quantity(
        "peak at the motor's shaft; for an ideal drive, `peak`", MOTOR, "motor\npeak"
    )
    motor_rms: float = quantity(
        "RMS there",
        MOTOR,
        "motor RMS\nleast\N{EN DASH}worst",
        between("motor_rms_least", "motor_rms"),
    )
    motor_rms_least: float = quantity("least RMS there", MOTOR)
    motor_friction_share: float = quantity(
        "`friction_share` at the motor's shaft, with all losses between the motor and the joint: "
        "without them the motor delivers u_0/r + r J_rotor a",
        heading="friction\n+ losses",
        cell="{motor_friction_share:%}",
    )


def summarize(result: InverseResult) -> tuple[ActuatorSummary, ...]:
    """Return the summary of every drive, in the order of `result.actuator_names`.

    A drive sticks while a site on its degree of freedom does: its own joint or a mimic follower.

    Raises:
        StateError: the result has no times.
    """
    if result.t is None:
        raise StateError("a summary needs times: give `t` to inverse_dynamics")
    t, summaries = result.t, []
    for i, drive in enumerate(result.scene.drives):
        frictionless = result.effort_frictionless[:, i]
        worst, least = ends_by_magnitude(result.effort_lower[:, i], result.effort_upper[:, i])
        motor_worst, motor_least = ends_by_magnitude(
            result.motor_torque_lower[:, i], result.motor_torque_upper[:, i]
        )
        # a motor's torque if nothing rubbed
        gear, shaft = drive.transmission, frictionless
        if gear is not None:
            rotor = gear.ratio * gear.rotor_inertia * result.actuator_acceleration[:, i]
            shaft = frictionless / gear.ratio + rotor
        sites, sticks = sites_on(result.scene, i), runs(rests(result, i))
        top = int(np.argmax(np.abs(worst)))
        summaries.append(
            ActuatorSummary(
                name=drive.name,
                unit=result.scene.drives[i].unit,
                peak=float(np.abs(worst[top])),
                peak_time=float(t[top]),
                peak_velocity=float(result.actuator_velocity[top, i]),
                rms=rms(t, worst),
                rms_least=rms(t, least),
                peak_frictionless=float(np.abs(frictionless).max()),
                rms_frictionless=rms(t, frictionless),
                friction_share=_share(t, worst, frictionless),
                stick_time=float(sum(t[last] - t[first] for first, last in sticks)),
                sticks=len(sticks),
                reversals=int(np.count_nonzero(result.reversal[:, sites].any(axis=1))),
                max_interval=float((result.effort_upper[:, i] - result.effort_lower[:, i]).max()),
                motor_unit=result.scene.drives[i].motor_unit,
                motor_peak=float(np.abs(motor_worst).max()),
                motor_rms=rms(t, motor_worst),
                motor_rms_least=rms(t, motor_least),
                motor_friction_share=_share(t, motor_worst, shaft),
            )
        )
    return tuple(summaries)


def _share(t: np.ndarray, worst: np.ndarray, frictionless: np.ndarray) -> float:
    """Return the share of friction in an effort over time, 0 to 1; arrays (T,)."""
    friction, without = rms(t, worst - frictionless), rms(t, frictionless)
    return friction / (friction + without) if friction > 0 else friction


def beyond_limits(result: InverseResult) -> tuple[str, ...]:
    """Return in words the drives whose efforts pass the URDF's limit."""
    limits, lines = np.asarray(result.scene.model.effortLimit, dtype=np.float64), []
    for i, drive in enumerate(result.scene.drives):
        if drive.velocity_index < 0:
            continue
        limit = stated_limit(float(limits[drive.velocity_index]))
        ends = np.abs([result.effort_lower[:, i], result.effort_upper[:, i]])
        peak, unit = float(np.fmax.reduce(ends, axis=None)), result.scene.drives[i].unit
        if peak > limit:
            lines.append(f"{drive.name} needs {peak:.3g} {unit}; the URDF allows {limit:g} {unit}")
    return tuple(lines)


#: Part of a limit by which a motion may pass it: noise of a log, a time step of a retimed motion.
_PASSES = 1e-3


def moves_beyond(scene: Scene, q: np.ndarray, v: np.ndarray) -> tuple[str, ...]:
    """Return in words the joints that a motion (T, nq), (T, nv) moves beyond the URDF's limits."""
    model, found = scene.model, []
    for name, joint in zip(scene.joint_names, tuple(model.joints)[1:], strict=True):
        if joint.nv != 1:
            continue
        unit = "m" if is_sliding(joint) else "rad"
        fastest = float(np.abs(v[:, joint.idx_v]).max(initial=0.0))
        limit = stated_limit(float(model.velocityLimit[joint.idx_v]))
        if fastest > limit * (1.0 + _PASSES):
            found.append(f"{name} moves at {fastest:.4g} {unit}/s; the URDF allows {limit:g}")
        if joint.nq == 1:
            i, own = joint.idx_q, q[:, joint.idx_q]
            lower, upper = stated_range(
                float(model.lowerPositionLimit[i]), float(model.upperPositionLimit[i])
            )
            spare = _PASSES * min(upper - lower, 2.0 * np.pi)
            low, high = float(own.min(initial=np.inf)), float(own.max(initial=-np.inf))
            if low < lower - spare:
                found.append(f"{name} moves to {low:.4g} {unit}; the URDF allows {lower:g}")
            if high > upper + spare:
                found.append(f"{name} moves to {high:.4g} {unit}; the URDF allows {upper:g}")
    return tuple(found)


#: What is smaller than this beside the largest effort or reaction is rounding of the dynamics.
ROUNDING = 1e-9


def rounding(result: InverseResult) -> float:
    """Return the effort (N m or N) below which a figure is rounding, to print as 0.

    1e-9 of the result's largest effort, force or moment.
    """
    arrays = [result.effort_lower, result.effort_upper, result.effort_frictionless, result.wrench]
    ends = [
        abs(float(end.reduce(x, axis=None, initial=0.0)))  # fmin, fmax pass over NaN
        for x in arrays
        if x is not None
        for end in (np.fmin, np.fmax)
    ]
    return ROUNDING * max(ends)


def payload_phases(result: InverseResult) -> dict[str, list[tuple[float, float]]]:
    """Return when each payload is carried: (start, end) in s; it is put down at the end.

    Raises:
        StateError: the result has no times.
    """
    t, attached = result.t, result.states.carried(result.scene)
    if t is None:
        raise StateError("payload phases need times: give `t` to inverse_dynamics")
    return {
        name: [
            (float(t[first]), float(t[min(last + 1, len(t) - 1)]))
            for first, last in runs(attached[:, p])
        ]
        for p, name in enumerate(result.scene.payloads)
    }


def rms(t: np.ndarray, x: np.ndarray) -> float:
    """Return sqrt(1/T int x^2 dt) by the trapezoidal rule, t (T,) s; |x| of one sample."""
    return float(column_rms(t, x[:, None])[0])


def column_rms(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return `rms` of each column of x (T, n), (n,)."""
    largest: np.ndarray = np.abs(x).max(axis=0)
    if len(t) == 1:
        return largest
    scale = np.where(largest > 0, largest, 1.0)  # its square cannot overflow; NaN is not above 0
    square = (x / scale) ** 2
    steps = (t[1:] - t[:-1])[:, None] * (square[1:] + square[:-1])  # of `@` BLAS makes threads
    mean_square = steps.sum(axis=0) / (2 * (t[-1] - t[0]))
    return np.where(largest > 0, scale * np.sqrt(mean_square), largest)


def known_rms(t: np.ndarray | None, x: np.ndarray) -> np.ndarray:
    """Return sqrt(1/T int x^2 dt) of each column of x (T, n) over the steps with both ends known.

    x is NaN where it is not known. t None: states without order, of which each counts alike.
    """
    square = x**2
    if t is None or len(t) < 2:
        return np.asarray(np.sqrt(np.nanmean(square, axis=0)))
    step = np.diff(t)[:, None]
    both = square[1:] + square[:-1]
    known = ~np.isnan(both)
    total = np.where(known, step * both, 0.0).sum(axis=0) / 2
    time = np.where(known, step, 0.0).sum(axis=0)
    return np.asarray(np.sqrt(total / np.where(time > 0.0, time, np.nan)))


def running_integral(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return (T, n) int x dt from the first time on, by the trapezoidal rule."""
    steps = np.diff(t)[:, None] * (x[1:] + x[:-1]) / 2.0
    return np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(steps, axis=0)])


def integral(t: np.ndarray, x: np.ndarray) -> float:
    """Return int x dt by the trapezoidal rule, faster than NumPy's; without threads of BLAS."""
    return float(((t[1:] - t[:-1]) * (x[1:] + x[:-1])).sum()) / 2


def ends_by_magnitude(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of largest and smallest magnitude in each [lower, upper], (T,)."""
    worst = np.where(np.abs(upper) >= np.abs(lower), upper, lower)
    return worst, np.minimum(np.maximum(0.0, lower), upper)


def sites_on(scene: Scene, actuator: int) -> list[int]:
    """Return the columns of the sites whose friction a drive feels: its joint's, its followers'.

    Of coupled drives those of the others' joints, too; with loops, cylinders or forces those of all
    joints that these tie to it, each to the joints between its two ends.
    """
    nv, linkage = scene.model.nv, scene.linkage
    if linkage is None:
        felt = reaches(scene.drives, nv)[actuator]
        return [s for s, site in enumerate(scene.sites) if felt[site.velocity_index]]
    from scipy.sparse.csgraph import connected_components  # 0.2 s to import

    first = scene.twin().v_index  # a joint, with its followers, is its first velocity
    ties = np.zeros((nv + len(linkage.pair_kind),) * 2, dtype=bool)
    for pair, support in zip(linkage.column_pair, linkage.support, strict=True):
        ties[nv + pair, first[support != 0]] = True
    for coupled in scene.drives:
        ties[coupled.velocity_index, [v for v, _ in coupled.couples]] = True
    group = connected_components(ties, directed=False)[1]
    drive = scene.drives[actuator]
    own = first[first <= drive.velocity_index].max(initial=-1)
    own = nv + linkage.column_pair[drive.column] if own < 0 else own
    at = [nv + site.pair if site.pair >= 0 else site.velocity_index for site in scene.sites]
    return np.flatnonzero(group[at] == group[own]).tolist() if at else []


def rests(result: InverseResult, actuator: int) -> np.ndarray:
    """Return (T,) where a drive sticks: any site on it does."""
    return np.asarray(result.sticking[:, sites_on(result.scene, actuator)].any(axis=1))


def unit_of_drive(scene: Scene, name: str, motor: bool = False) -> str:
    """Return the unit of a drive's efforts (or at its `motor`); of no name the common one."""
    if name:
        drive = scene.drives[scene.actuator_names.index(name)]
        return drive.motor_unit if motor else drive.unit
    units = {drive.unit for drive in scene.drives}
    return units.pop() if len(units) == 1 else ""
