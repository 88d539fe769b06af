"""The judge of scenes with loops, cylinders and forces; it uses none of the solver's kernels.

Jacobians come from Pinocchio's joint Jacobians, wrenches from `data.f` of its RNEA with every
closure force, drive and friction torque as external forces, laws from plain NumPy (`plain_laws`).
The ends of efforts, and whether a sample has one state of friction, several or none, come from a
separate enumeration (`states`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.judge.balance import Balance, balance, drive_rates
from pinfric.dynamics.judge.pairs import Pair, Sample, pair_friction
from pinfric.dynamics.judge.plain_laws import plain_displacement, plain_friction, plain_normal_load
from pinfric.dynamics.judge.states import Enumeration, SiteLaw, States, site_laws
from pinfric.dynamics.samples.outcome import Solution, SolvedMotion, Status
from pinfric.model.scene import Scene

#: Rates differ by rounding only, relative to the motion; differences and spectral radii by more.
_RATES, _DERIVATIVE, _RADIUS = 1e-9, 1e-6, 1e-6
#: With so many choices of one sample, with a ball fewer, the solver's interval may be that of a
#: search; so it may beyond the second if a choice may have several solutions.
_MANY, _SOME = 4096, 256
#: A status "singular" is wrong if no singular value that counts is as small as this.
_REGULAR = 1e-6
#: Fields that are finite if there is a solution, and NaN if there is none.
_ARRAYS = (
    "effort_lower",
    "effort_upper",
    "motor_torque_lower",
    "motor_torque_upper",
    "normal_load",
    "friction_lower",
    "friction_upper",
    "wrench",
    "multipliers",
)


class Verdict(NamedTuple):
    """The judge's result for one sample.

    Attributes:
        equilibrium, friction_law, wrench, ends: residuals, see `check.Check`.
        scale: the largest effort.
        wrong_status: the judge finds another status.
        undecided: its search stopped before it was complete.
        wrong_field: a field without a residual is false, see `check.Check`.
    """

    equilibrium: float = 0.0
    friction_law: float = 0.0
    wrench: float = 0.0
    ends: float = 0.0
    scale: float = 0.0
    wrong_status: bool = False
    undecided: bool = False
    wrong_field: bool = False


def judge_linkage(
    result: SolvedMotion,
    solutions: Callable[[int], tuple[Solution, ...]],
    model: pin.Model,
    data: pin.Data,
    i: int,
) -> Verdict:
    """Judge one sample.

    Args:
        result: of a scene with loops or drives off the joints.
        solutions: see `check.check_result`.
        model, data: with the payloads of this sample.
        i: the sample.
    """
    status, sample = Status(int(result.status[i])), Sample.of(result, model, data, i)
    maps = balance(sample)
    laws = site_laws(sample, max(1.0, float(np.abs(maps.contact[:, :, 0]).max(initial=0.0))))
    failed = status not in (Status.CONVERGED, Status.AMBIGUOUS)
    velocity = [sample.velocity(site) for site in result.scene.sites]
    false = wrong_rates(result, i, velocity, drive_rates(sample))
    false |= _wrong_certificates(sample, maps, laws, status)
    false |= any((np.isnan(getattr(result, name)[i]) != failed).any() for name in _ARRAYS)
    if status == Status.SINGULAR:
        false |= not np.isnan(result.effort_frictionless[i]).all()
        return Verdict(wrong_status=maps.regular > _REGULAR, wrong_field=false)
    frictionless = _apart(result.effort_frictionless[i], maps.effort[:, 0])
    if status == Status.NOT_CONVERGED:
        return Verdict(frictionless, scale=maps.scale, undecided=True, wrong_field=false)
    states = Enumeration(maps, laws).run()
    wrong, undecided = not states.possible(status), not states.certain
    if failed or false:
        return Verdict(
            frictionless,
            scale=maps.scale,
            wrong_status=wrong,
            undecided=undecided,
            wrong_field=false,
        )
    chooses = any(len(law.options) > 1 for law in laws)
    if chooses or status == Status.AMBIGUOUS:
        found = solutions(i)
        wrong |= not chooses and states.certain and len(found) != states.most
        searched = result.interval_searched[i] or any(law.sphere for law in laws)
        apart, law = _ends(sample, states, found, bool(searched))
        law = max(law, _reference(sample, maps, states)) if chooses or states.certain else law
    else:
        found, law = (_reported(sample),), 0.0
        apart = max(
            _apart(result.effort_lower[i], result.effort_upper[i]),
            _apart(result.friction_lower[i], result.friction_upper[i]),
        )
    rows = [_residuals(sample, one) for one in found]
    worst = np.array([*rows, np.zeros(3)]).max(axis=0)
    equilibrium = float(np.max([worst[0], maps.missed, frictionless]))
    scale = max([maps.scale, *(float(np.abs(one.effort).max(initial=0.0)) for one in found)])
    return Verdict(
        equilibrium, float(np.max([worst[1], law])), float(worst[2]), apart, scale, wrong, undecided
    )


def wrong_rates(
    result: SolvedMotion, i: int, velocity: list[np.ndarray], rates: tuple[np.ndarray, np.ndarray]
) -> bool:
    """Return whether the drives' rates, or which sites stick, are not those of the motion.

    Args:
        result, i: one sample.
        velocity: of each site.
        rates: (na,), (na,) of what each drive moves, and its derivative.
    """
    scene, v, a = result.scene, result.states.v[i], result.states.a[i]
    size = 1.0 if scene.linkage is None else min(1.0, scene.linkage.size)
    fastest = float(np.abs(v).max(initial=0.0))
    stick = np.array([site.law.stick_velocity for site in scene.sites])
    beyond = np.array([np.linalg.norm(one) for one in velocity]) - stick
    clear = np.abs(beyond) > _RATES * fastest
    if (clear & ((beyond <= 0.0) != result.sticking[i])).any():
        return True
    most = _DERIVATIVE * (float(np.abs(a).max(initial=0.0)) + fastest**2 / size)
    return not (
        _apart(result.actuator_velocity[i], rates[0]) <= _RATES * fastest
        and _apart(result.actuator_acceleration[i], rates[1]) <= most
    )


def _wrong_certificates(sample: Sample, maps: Balance, laws: list[SiteLaw], status: Status) -> bool:
    """Whether `contraction`, `interval_exact` or `interval_searched` is false.

    The contraction bounds the spectral radius of A_kj = |gain_k| Lip(load_k along friction j) from
    above, no worse than the largest sum of a row does.
    """
    contraction = sample.result.contraction[sample.i]
    exact = bool(sample.result.interval_exact[sample.i])
    searched = bool(sample.result.interval_searched[sample.i])
    if status == Status.SINGULAR:
        return exact or searched or contraction != 0.0
    ns, spheres = len(laws), any(law.sphere for law in laws)
    slope = np.zeros((ns, ns))
    for j, law in enumerate(laws):
        forces = maps.contact[:, :, 1:][:, :, maps.entry_site == j]
        along = (
            np.linalg.svd(forces, compute_uv=False)[:, 0]
            if law.sphere
            else (np.linalg.norm(forces @ law.direction, axis=1))
        )
        slope[:, j] = np.bincount(maps.owner, along, ns)
    every = np.array([np.abs(law.options[:, 1]).max() for law in laws])
    still = np.array([abs(law.still[1]) for law in laws])
    choices = np.prod([float(len(law.options)) for law in laws])
    tried = status == Status.CONVERGED and not spheres and choices <= _MANY
    least = np.linalg.eigvals((every if tried else still).reshape(-1, 1) * slope)
    most = (1.0 + _RADIUS) * float((every * slope.sum(axis=1)).max(initial=0.0))
    radius = float(np.abs(least).max(initial=0.0)) - _RADIUS * most
    rests = bool(sample.scene.mobility.undriven) and any(len(law.options) > 1 for law in laws)
    certain = status == Status.CONVERGED and not spheres and not rests and not searched
    may_search = choices > _MANY or (choices > _SOME and (spheres or contraction >= 1.0))
    return not radius <= contraction <= most or exact != certain or (searched and not may_search)


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max(initial=0.0))


def _ends(
    sample: Sample, states: States, solutions: tuple[Solution, ...], searched: bool
) -> tuple[float, float]:
    """How far the reported ends of efforts and frictions are from those that the judge has found.

    Where the judge may have missed some, reported ends may lie farther out if a solution attains
    them. Ranges of friction that come from a search are not compared.
    """
    result, i = sample.result, sample.i
    lower, upper = result.effort_lower[i], result.effort_upper[i]
    inside = np.concatenate([lower - states.lower, states.upper - upper])
    if not lower.size:  # of no drive
        apart = 0.0
    elif states.certain:
        apart = float(np.abs(inside).max())
    else:
        efforts = np.array([one.effort for one in solutions])
        attained = max(_apart(lower, efforts.min(axis=0)), _apart(upper, efforts.max(axis=0)))
        apart = float(np.fmax.reduce(inside, initial=attained))
    if not states.certain or searched:
        return apart, 0.0
    return apart, max(
        _apart(result.friction_lower[i], states.friction_lower),
        _apart(result.friction_upper[i], states.friction_upper),
    )


def _reference(sample: Sample, maps: Balance, states: States) -> float:
    """How far loads, wrenches and multipliers are from a state in which what sticks has none."""
    result, i = sample.result, sample.i
    assert result.wrench is not None
    assert result.multipliers is not None
    nearest = 0.0 if len(states.reference) == 0 else np.inf
    for phi in states.reference:
        one = np.concatenate([[1.0], phi])
        size = np.linalg.norm(maps.contact @ one, axis=1)
        load = maps.constant + np.bincount(maps.owner, size, len(maps.constant))
        nearest = min(
            nearest,
            max(
                _apart(result.normal_load[i], load),
                _apart(result.wrench[i], maps.wrench @ one),
                _apart(result.multipliers[i], maps.multipliers @ one),
            ),
        )
    return nearest


def _reported(sample: Sample) -> Solution:
    """The result's own figures of a sample where everything slides."""
    result, i = sample.result, sample.i
    assert result.wrench is not None
    assert result.multipliers is not None
    parts = [np.zeros(0)]
    for site, size in zip(result.scene.sites, result.friction_lower[i], strict=True):
        velocity = sample.velocity(site)
        speed = float(np.linalg.norm(velocity))
        parts.append(size * velocity / speed if site.ball else np.array([size]))
    return Solution(
        result.effort_lower[i],
        result.friction_lower[i],
        np.concatenate(parts),
        result.normal_load[i],
        result.wrench[i],
        result.multipliers[i],
    )


def _split(scene: Scene, phi: np.ndarray) -> list[np.ndarray]:
    counts = np.cumsum([3 if site.ball else 1 for site in scene.sites])
    return np.split(phi, counts[:-1]) if len(counts) else []


def _residuals(sample: Sample, end: Solution) -> np.ndarray:
    """(3,) equilibrium, friction law, wrench, with all that acts in a solution on the links."""
    scene, pairs, forces = sample.scene, sample.pairs, sample.external()
    for pair, wrench in _acting(sample, end):
        for joint, sign in ((pair.b, 1.0), (pair.a, -1.0)):
            forces[joint] += pair.on_link(sample.data, joint, sign * wrench)
    forces[0] = pin.Force.Zero()
    total, wrenches = sample.rnea(forces)
    left = total - _joint_efforts(sample, end)
    if not sample.result.interval_exact[sample.i]:  # ends of whatever balances what is undriven
        left[list(scene.mobility.undriven)] = 0.0
    law = wrench_error = 0.0
    for k, (site, phi) in enumerate(
        zip(scene.sites, _split(scene, end.friction_coordinates), strict=True)
    ):
        if site.pair >= 0:
            w = pair_friction(site, phi)
            if not pairs[site.name].along_line:
                w = w + end.multipliers[site.pair]
            for drive, effort in zip(scene.drives, end.effort, strict=True):
                if drive.velocity_index < 0 and pairs[drive.name] is pairs[site.name]:
                    w = w + effort * pair_friction(site, np.ones(1))
        else:
            w = wrenches[site.joint]
        wrench_error = float(np.max([wrench_error, np.abs(end.wrench[k] - w).max()]))
        law = float(np.max([law, _law_error(sample, k, end, phi, w)]))
    return np.array([float(np.abs(left).max(initial=0.0)), law, wrench_error])


def _acting(sample: Sample, end: Solution) -> list[tuple[Pair, np.ndarray]]:
    """Everything that acts between pairs in one solution, world axes, at the pair's place."""
    scene, pairs = sample.scene, sample.pairs
    acting = [
        (pairs[loop.name], pairs[loop.name].in_world(end.multipliers[row]))
        for row, loop in enumerate(scene.loops)
    ]
    for drive, effort in zip(scene.drives, end.effort, strict=True):
        if drive.velocity_index < 0:
            acting.append((pairs[drive.name], effort * pairs[drive.name].direction))
    for site, phi in zip(scene.sites, _split(scene, end.friction_coordinates), strict=True):
        if site.pair >= 0:
            acting.append((pairs[site.name], sample.friction_in_world(site, phi)))
    return acting


def _joint_efforts(sample: Sample, end: Solution) -> np.ndarray:
    """(nv,) what drives and friction on the tree's joints contribute."""
    scene, total = sample.scene, np.zeros(sample.model.nv)
    for drive, effort in zip(scene.drives, end.effort, strict=True):
        if drive.velocity_index >= 0:
            total[drive.velocity_index] += effort
        for v, factor in drive.couples:
            total[v] += factor * effort
    for site, phi in zip(scene.sites, _split(scene, end.friction_coordinates), strict=True):
        if site.pair < 0:
            total[site.velocity_index] += site.ratio * phi[0]
    return total


def _law_error(sample: Sample, k: int, end: Solution, phi: np.ndarray, w: np.ndarray) -> float:
    """How far one site's load and friction are from the formulas."""
    scene, q = sample.scene, sample.motion[0]
    site = scene.sites[k]
    velocity = sample.velocity(site)
    moved = plain_displacement(scene, site, q) if site.pair < 0 else 0.0
    load = plain_normal_load(site, w, moved)
    error, passes = abs(end.normal_load[k] - load), bool(sample.result.reversal[sample.i, k])
    if not site.ball:
        least, most = plain_friction(site, float(velocity[0]), load, passes)
        return float(np.max([error, least - phi[0], phi[0] - most]))
    speed = float(np.linalg.norm(velocity))
    least, most = plain_friction(site, speed, load, passes)
    if least < most:
        return float(np.max([error, np.linalg.norm(phi) - max(-least, most)]))
    return float(np.max([error, np.abs(phi - least * velocity / max(speed, 1e-300)).max()]))
