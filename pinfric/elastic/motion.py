"""Wind-up, the tool's position at rest and natural frequencies along a motion.

At rest static friction holds any torque of the drive's interval, so the wind-up lies between
f(lower) and f(upper); a joint that came to rest slowly keeps the friction of its approach. Places
are of first order in the wind-up, at the commanded pose. See `notebooks/theory/elastic.md`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from pinfric.drives.demand import hold_samples
from pinfric.drives.inertia import joint_inertias
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult, runs
from pinfric.elastic.places import extents, farthest, joint_answer
from pinfric.elastic.vibration import (
    Mode,
    bracket,
    free_motions,
    frequencies,
    has_light,
    lowest_frequencies,
    lowest_mode,
    mobility,
)
from pinfric.errors import PinfricError, StateError
from pinfric.model.closure import action_maps, closure_jacobian, loop_state
from pinfric.model.couples import rate_rows, taking_part
from pinfric.model.mass_matrix import frame_jacobians, link_poses, mass_matrices
from pinfric.model.mobility import lightest_joint
from pinfric.model.robot import link_frame
from pinfric.model.scene import Scene
from pinfric.model.upward import Shown
from pinfric.motions.summary import ends_by_magnitude

#: Wind-up that the approach leaves, and the opposite one.
_Ways = tuple[np.ndarray | None, np.ndarray | None]


@dataclass(frozen=True)
class ToolPlace:
    """Position of the tool at rest relative to its commanded one; m and rad, in world axes.

    Attributes:
        middle, sag: (6,) displacement of the middle of the interval, and without friction.
        generators: (6, na) of the zonotope of places around the middle (`places`).
        approach, opposite: (6,) displacements after the approach and after the opposite one; None:
            unknown.
    """

    middle: np.ndarray
    sag: np.ndarray
    generators: np.ndarray
    approach: np.ndarray | None
    opposite: np.ndarray | None

    @property
    def sag_distance(self) -> float:
        """Distance |sag|, m, by the load without friction."""
        return float(np.linalg.norm(self.sag[:3]))

    @property
    def extents(self) -> np.ndarray:
        """(6,) half-widths of the interval along and about the world's axes, m and rad."""
        return extents(self.generators)

    @property
    def farthest(self) -> float:
        """Largest distance from the middle at which static friction holds the tool, m."""
        return farthest(self.generators[:3])

    @property
    def farthest_angle(self) -> float:
        """The same for the tool's orientation, rad."""
        return farthest(self.generators[3:])

    @property
    def reversal(self) -> float | None:
        """Reversal error, m: distance between the positions after opposite approaches."""
        if self.approach is None or self.opposite is None:
            return None
        return float(np.linalg.norm((self.approach - self.opposite)[:3]))


@dataclass(frozen=True)
class RestPeriod:
    """A time in which all joints stand still under one load.

    Attributes:
        start, end: s. sample: its last one.
        payloads: those carried.
        wind_up_lower, wind_up_upper: (na,) interval of each drive's wind-up, rad (m); 0 of rigid
            drives.
        wind_up_sag: (na,) without friction.
        wind_up_approach, wind_up_opposite: (na,) after the approach and after the opposite one;
            None: unknown.
        frequency: Hz, lowest with motors held, at the least and the greatest torque held.
        mode: that at the least torque.
        tool: None where `Elasticity.notes` say why.
    """

    start: float
    end: float
    sample: int
    payloads: tuple[str, ...]
    wind_up_lower: np.ndarray
    wind_up_upper: np.ndarray
    wind_up_sag: np.ndarray
    wind_up_approach: np.ndarray | None
    wind_up_opposite: np.ndarray | None
    frequency: tuple[float, float]
    mode: Mode
    tool: ToolPlace | None


@dataclass(frozen=True)
class Elasticity(Shown):
    """Effects of elastic gears along a motion.

    Attributes:
        result: of the rigid robot.
        drives: names of the elastic ones.
        frequency: (T,) lowest natural frequency with motors held, Hz, each gear with its tangent at
            the torque of least magnitude in its interval; NaN where there is no solution.
        rests: in the order of time.
        notes: what is left out, and why.
    """

    result: InverseResult
    drives: tuple[str, ...]
    frequency: np.ndarray
    rests: tuple[RestPeriod, ...]
    notes: tuple[str, ...]

    @property
    def worst(self) -> RestPeriod | None:
        """The rest with the widest interval at the tool; None without a tool."""
        known = [rest for rest in self.rests if rest.tool is not None]
        return max(known, key=lambda rest: rest.tool.farthest if rest.tool else 0.0, default=None)

    @cached_property
    def slowest(self) -> int:
        """The sample of the lowest frequency."""
        return int(np.argmin(np.where(np.isnan(self.frequency), np.inf, self.frequency)))

    @cached_property
    def mode(self) -> Mode:
        """The mode at that sample."""
        return modes_of(self.result, [self.slowest], _torques(self.result)[1])[0]

    @cached_property
    def bracket(self) -> tuple[float, float]:
        """Dunkerley's and Rayleigh's bounds of the lowest frequency there, Hz; NaN with loops."""
        scene, sample = self.result.scene, slice(self.slowest, self.slowest + 1)
        if scene.linkage is not None:
            return np.nan, np.nan
        inertia = joint_inertias(scene, self.result.states.part(sample))[:, list(scene.elastic)]
        low, high = bracket(inertia, stiffness_at(scene, _torques(self.result)[1][sample]))
        return float(low[0]), float(high[0])

    @cached_property
    def free(self) -> np.ndarray | None:
        """(ne,) natural frequencies there with motors free, Hz; None without all inertias."""
        return free_frequencies(self.result, self.slowest)


def elasticity(result: InverseResult) -> Elasticity:
    """Return wind-up, places at rest and natural frequencies along a motion.

    Args:
        result: of inverse dynamics, with times.

    Raises:
        StateError: it has no times, or no drive has a `stiffness`.
    """
    scene = result.scene
    if not scene.elastic:
        raise StateError(f"{scene.source}: no gear has a stiffness; give transmission.stiffness")
    if result.t is None:
        raise StateError("elasticity needs times: give `t` to inverse_dynamics")
    notes, rest_samples = _notes(scene), _rest_samples(result)
    ways = _approaches(result, rest_samples, notes)
    stiffest, softest = (
        modes_of(result, [last for *_, last in rest_samples], torque) for torque in _torques(result)
    )
    rests = tuple(
        _rest(result, span, ways[n], (softest[n], stiffest[n].frequency))
        for n, span in enumerate(rest_samples)
    )
    mass, closed = _masses(result, [0]), _rows(scene, result.states.q[:1])[1]
    if has_light(mass, closed):
        joint = lightest_joint(scene.model, mass[0], closed[0])
        notes.append(f"a joint moves no mass ({joint}): its gear adds no natural frequency")
    names = tuple(scene.drives[d].name for d in scene.elastic)
    return Elasticity(result, names, trajectory_frequencies(result), rests, tuple(notes))


def _notes(scene: Scene) -> list[str]:
    notes = []
    at_joint = [scene.drives[d].name for d in scene.elastic if scene.drives[d].encoder == "joint"]
    if at_joint:
        notes.append(
            f"encoder at the joint: {', '.join(at_joint)}: the controller corrects the wind-up of "
            "these gears, so they add no sag and no interval at the tool"
        )
    if scene.tool is None:
        notes.append("no `tool` in the scene: name its link to get the tool's position at rest")
    elif scene.mobility.undriven or scene.mobility.redundant:
        notes.append(
            "joints without drive, or redundant drives: the wind-up of the drives does not "
            "determine the tool's position"
        )
    elif scene.linkage is not None or taking_part(scene.drives):
        notes.append(
            "loops or couples: intervals of drives depend on each other, so the tool's "
            "interval is a bound"
        )
    return notes


def trajectory_frequencies(result: InverseResult) -> np.ndarray:
    """Return the lowest natural frequency (T,), Hz, as `Elasticity.frequency`."""
    scene = result.scene
    torque = _torques(result)[1]
    known = np.isfinite(torque).all(axis=1)
    hertz = np.full(len(torque), np.nan)
    if not known.any():
        return hertz
    all_known = known.all()  # a copy of everything takes as long as the mass matrices
    samples = np.arange(len(torque)) if all_known else np.flatnonzero(known)
    K, M = stiffness_at(scene, torque if all_known else torque[known]), _masses(result, samples)
    if scene.one_drive_each and len(scene.elastic) == scene.model.nv:
        hertz[samples] = lowest_frequencies(M, K)
        return hertz
    hertz[samples] = _lowest(M, *_rows(scene, result.states.q[samples]), K)
    return hertz


def _lowest(
    mass: np.ndarray, rates: np.ndarray, closed: np.ndarray, stiffness: np.ndarray
) -> np.ndarray:
    """Return the lowest frequencies (n,), Hz, motors held; arguments as in `mobility`."""
    if has_light(mass, closed):
        samples = zip(mass, rates, closed, stiffness, strict=True)
        return np.array([lowest_mode(*sample).frequency for sample in samples])
    return np.asarray(frequencies(mobility(mass, rates, closed), stiffness)[:, 0])


def unloaded_frequency(scene: Scene) -> float:
    """Return the lowest natural frequency, Hz, at the scene's start, each gear at its softest.

    Motors are held, payloads as attached by default; NaN if the loops do not close there, or
    nothing has inertia.
    """
    try:
        q = scene.close(scene.start_configuration)[None]
    except PinfricError:
        return np.nan
    nothing = np.zeros((1, len(scene.drives)))
    S, closed = _rows(scene, q)
    mass = _with_armature(scene, mass_matrices(scene.twin(), q))
    return float(_lowest(mass, S, closed, stiffness_at(scene, nothing))[0])


def modes_of(result: InverseResult, samples: list[int], torque: np.ndarray) -> list[Mode]:
    """Return the slowest mode at some samples, motors held.

    Args:
        result: of inverse dynamics.
        samples: which.
        torque: (T, na) that the gears carry.
    """
    scene = result.scene
    if not samples:
        return []
    K, M = stiffness_at(scene, torque[samples]), _masses(result, samples)
    S, closed = _rows(scene, result.states.q[samples])
    return [lowest_mode(*matrices) for matrices in zip(M, S, closed, K, strict=True)]


def free_frequencies(result: InverseResult, sample: int) -> np.ndarray | None:
    """Return the natural frequencies (ne,) with motors free, Hz; None without all inertias.

    Rotors of elastic drives swing against their joints, those of rigid ones turn with them.
    """
    scene = result.scene
    rotors = [rotor_inertia(scene, d) for d in range(len(scene.drives))]
    if any(rotors[d] == 0.0 for d in scene.elastic):
        return None
    S, closed = _rows(scene, result.states.q[[sample]], rigid=False)
    rates, _ = _rows(scene, result.states.q[[sample]], all_drives=True)
    M = _masses(result, [sample])[0]
    for d in set(range(len(rotors))) - set(scene.elastic):
        M = M + rotors[d] * np.outer(rates[0, d], rates[0, d])
    if has_light(M[None], closed):
        return None
    inverse = np.diag([1.0 / rotors[d] for d in scene.elastic])
    K = stiffness_at(scene, _torques(result)[1][[sample]])
    return np.asarray(frequencies(mobility(M[None], S, closed) + inverse, K)[0])


def stiffness_at(scene: Scene, torque: np.ndarray) -> np.ndarray:
    """Return the tangents (n, ne) of the elastic gears at torques (n, na) of all drives."""
    return np.column_stack(
        [
            spring.tangent(torque[:, d])
            for d in scene.elastic
            if (spring := scene.drives[d].spring) is not None
        ]
    )


def rotor_inertia(scene: Scene, d: int) -> float:
    """Return r^2 J_rotor of a drive and Pinocchio's armature of its joint, kg m^2 (kg)."""
    drive = scene.drives[d]
    own = 0.0 if drive.transmission is None else drive.transmission.rotor_inertia
    armature = scene.model.armature[drive.velocity_index] if drive.velocity_index >= 0 else 0.0
    return float(drive.ratio**2 * own + armature)


def _torques(result: InverseResult) -> tuple[np.ndarray, np.ndarray]:
    """(T, na) of largest magnitude in each interval, where gears are stiffest, and of least."""
    return ends_by_magnitude(result.effort_lower, result.effort_upper)


def _masses(result: InverseResult, samples: np.ndarray | list[int]) -> np.ndarray:
    """M (n, nv, nv) with the payloads of each sample and the armature of undriven joints."""
    at = np.asarray(samples)
    parts = []
    for start, stop, carried in result.states.phases(result.scene):
        twin = result.scene.twin(carried)
        inside = at[(at >= start) & (at < stop)]
        if inside.size:
            parts.append((inside, mass_matrices(twin, result.states.q[inside])))
    if len(parts) == 1:
        masses = parts[0][1]
    else:
        masses = np.concatenate([M for _, M in parts])
        order = np.concatenate([inside for inside, _ in parts])
        if not np.array_equal(order, at):
            masses = masses[np.searchsorted(order, at)]
    return _with_armature(result.scene, masses)


def _with_armature(scene: Scene, mass: np.ndarray) -> np.ndarray:
    """Add the armature of joints without drive; a driven joint's is on its motor's side."""
    armature = np.array(scene.model.armature)
    armature[[d.velocity_index for d in scene.drives if d.velocity_index >= 0]] = 0.0
    return mass + np.diag(armature) if armature.any() else mass


def _rows(
    scene: Scene, q: np.ndarray, rigid: bool = True, all_drives: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Rates (n, ne, nv) of the elastic drives, and rows (n, m, nv) of constraints, at q (n, nq).

    Args:
        rigid: rigid drives stand still, as with motors held.
        all_drives: rates of all drives; rows of loops only.
    """
    nv = scene.model.nv
    S = np.broadcast_to(rate_rows(scene.drives, nv), (len(q), len(scene.drives), nv))
    closed = np.zeros((len(q), 0, nv))
    if scene.linkage is not None:
        twin, S = scene.twin(), S.copy()
        closed = closure_jacobian(twin, scene.linkage, q)
        along = action_maps(twin, scene.linkage, *link_poses(twin, q))[1]
        for d, drive in enumerate(scene.drives):
            if drive.velocity_index < 0:
                S[:, d] = along[:, drive.column]
    if all_drives:
        return S, closed
    elastic = list(scene.elastic)
    if rigid and len(elastic) < len(scene.drives):
        stiff = [d for d in range(len(scene.drives)) if d not in elastic]
        closed = np.concatenate([closed, S[:, stiff]], axis=1)
    return S[:, elastic], closed


def _wind_ups(scene: Scene, torque: np.ndarray) -> np.ndarray:
    """(n, na) at torques (n, na); 0 of rigid drives."""
    angles = np.zeros(torque.shape)
    for d in scene.elastic:
        spring = scene.drives[d].spring
        assert spring is not None  # scene.elastic
        angles[:, d] = spring.wind_up(torque[:, d])
    return angles


def _rest_samples(result: InverseResult) -> list[tuple[int, int, int]]:
    """(first of the hold, first, last) of each time at rest under one load."""
    still = hold_samples(result.scene, result.states.v)
    still &= np.isfinite(result.effort_lower).all(axis=1)
    starts = [start for start, _, _ in result.states.phases(result.scene)]
    rests = []
    for first, last in runs(still):
        cuts = [first, *(start for start in starts if first < start <= last), last + 1]
        rests += [(first, a, b - 1) for a, b in pairwise(cuts)]
    return rests


def _approaches(
    result: InverseResult, rests: list[tuple[int, int, int]], notes: list[str]
) -> list[_Ways]:
    """Wind-up (na,) after the slow approach to each rest, and after the opposite one.

    None where nothing moved before, and, with a note, where such a motion cannot be computed.
    """
    scene, states = result.scene, result.states
    nothing: list[_Ways] = [(None, None)] * len(rests)
    if result.external or not rests:
        if result.external:
            notes.append("external wrenches: positions by approach are not computed")
        return nothing
    last = [sample for *_, sample in rests]
    way = np.array([_direction(result, hold) for hold, _, _ in rests])
    a = np.zeros_like(way)
    if scene.linkage is not None:
        q, twin = states.q[last], scene.twin()
        rows = closure_jacobian(twin, scene.linkage, q)
        N = free_motions(rows, scene.model.nv)
        way = np.einsum("nik,njk,nj->ni", N, N, way)
        bias = loop_state(twin, scene.linkage, q, way, a).rate_derivative[:, scene.linkage.lambdas]
        a = -np.einsum("nij,nj->ni", np.linalg.pinv(rows), bias)
    attached = None if states.attached is None else states.attached[last]
    wind_ups: list[np.ndarray] = []
    for sign in (1.0, -1.0):
        try:
            moving = inverse_dynamics(scene, states.q[last], sign * way, a, attached=attached)
        except PinfricError as problem:
            notes.append(f"positions by approach are not computed: {problem}")
            return nothing
        lower, upper = (_wind_ups(scene, x) for x in (moving.effort_lower, moving.effort_upper))
        wind_ups.append(0.5 * (lower + upper))
    return [
        (along, other) if moved.any() else (None, None)
        for along, other, moved in zip(*wind_ups, way, strict=True)
    ]


def _direction(result: InverseResult, hold: int) -> np.ndarray:
    """Velocities (nv,): each joint's last direction before a sample, just too fast to stick.

    With loops the whole motion of the last moving sample.
    """
    scene, v = result.scene, result.states.v[:hold]
    stick = np.full(scene.model.nv, scene.stick_velocity)
    for drive in scene.drives:
        if drive.velocity_index >= 0:
            stick[drive.velocity_index] = scene.stick_velocity_of(drive)
    moving = np.abs(v) > stick
    if scene.loops:
        some = np.flatnonzero(moving.any(axis=1))
        if not some.size:
            return np.zeros(scene.model.nv)
        before = v[some[-1]]
        return np.asarray(before * (1e3 * stick.max() / np.abs(before).max()))
    last = [np.flatnonzero(column)[-1:] for column in moving.T]
    signs = np.array([np.sign(v[k, j]).sum() for j, k in enumerate(last)])
    return np.asarray(2.0 * np.maximum(stick, 1e-9) * signs)


def _rest(
    result: InverseResult,
    span: tuple[int, int, int],
    ways: _Ways,
    swing: tuple[Mode, float],
) -> RestPeriod:
    scene, (_, first, last), t = result.scene, span, result.times
    torque = [result.effort_lower, result.effort_upper, result.effort_frictionless]
    lower, upper, sag = (_wind_ups(scene, x[[last]])[0] for x in torque)
    mode, stiffest = swing
    return RestPeriod(
        start=float(t[first]),
        end=float(t[last]),
        sample=last,
        payloads=_carried(result, last),
        wind_up_lower=lower,
        wind_up_upper=upper,
        wind_up_sag=sag,
        wind_up_approach=ways[0],
        wind_up_opposite=ways[1],
        frequency=(mode.frequency, stiffest),
        mode=mode,
        tool=_tool(result, last, (lower, upper, sag), ways),
    )


def _carried(result: InverseResult, sample: int) -> tuple[str, ...]:
    scene, attached = result.scene, result.states.attached
    if attached is None:
        return tuple(name for name, payload in scene.payloads.items() if payload.attached)
    return tuple(n for n, on in zip(scene.payloads, attached[sample], strict=True) if on)


def _tool(
    result: InverseResult,
    sample: int,
    ends: tuple[np.ndarray, np.ndarray, np.ndarray],
    ways: _Ways,
) -> ToolPlace | None:
    scene, q = result.scene, result.states.q[[sample]]
    if scene.tool is None or scene.mobility.undriven or scene.mobility.redundant:
        return None
    S, closed = _rows(scene, q, all_drives=True)
    Q = joint_answer(S[0], closed[0])
    if Q is None:
        return None
    J = frame_jacobians(scene.twin(), q, link_frame(scene.model, scene.tool))[0]
    felt = np.array([0.0 if drive.encoder == "joint" else 1.0 for drive in scene.drives])
    answer = -J @ Q * felt
    lower, upper, sag = ends
    approach, opposite = (None if way is None else answer @ way for way in ways)
    return ToolPlace(
        answer @ (0.5 * (lower + upper)),
        answer @ sag,
        answer * (0.5 * (upper - lower)),
        approach,
        opposite,
    )
