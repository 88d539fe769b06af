"""The judge of inverse dynamics: recomputes every field of a result, sample by sample.

It uses neither the twin nor a compiled kernel, but `judged_sample` (equilibrium), `friction_states`
(what obeys the laws) and `plain_laws`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin
from judges.friction_states import FrictionStates, SiteLaw, find_states, site_laws
from judges.judged_sample import JudgedSample, SampleMaps

from pinfric.dynamics.samples.outcome import Solution, SolvedMotion, Status

if TYPE_CHECKING:
    from pinfric.dynamics.inverse.result import InverseResult

#: Rates differ by rounding only, relative to the motion; differences and spectral radii by more.
_RATES, _DERIVATIVE, _RADIUS = 1e-9, 1e-6, 1e-6
#: With so many choices of one sample, with a ball fewer, the solver's interval may be that of a
#: search; so it may beyond the second if a choice may have several solutions.
_MANY, _SOME = 4096, 256
#: A status "singular" is wrong if no singular value that counts is as small as this.
_REGULAR = 1e-6
#: Fields that are finite if there is a solution, and NaN if there is none.
_ARRAYS = (
    *("effort_lower", "effort_upper", "motor_torque_lower", "motor_torque_upper", "normal_load"),
    *("friction_lower", "friction_upper", "wrench", "multipliers"),
)


@dataclass(frozen=True)
class Verdict:
    """Largest residuals over all samples, and the number of wrong statuses.

    All fields are judged except `reversal` (it depends on samples outside the result),
    `iterations`, `redundant`, the size of motor torques (efforts through the gears' losses), and
    accelerations of drives off the joints.

    Attributes:
        equilibrium: |M a + h - J^T f_ext - u - D phi| as an error of u (N m or N).
        friction_law: |phi - law(v, c)| (N m or N).
        wrench: |w - data.f| (N or N m); 0 where no wrench was needed.
        ends: distance of the intervals' ends from the judge's (N m or N).
        wrong_status: samples whose `Status` the judge contradicts: jammed although a state of
            friction obeys the laws, converged although several do.
        wrong_fields: samples with another false field: a number where there is no solution, none
            where there is one, rates of drives, `sticking`, `contraction` below a spectral radius
            or above its bound, `interval_exact` or `interval_searched` without or in spite of a
            reason.
        undecided: samples where states are confirmed, but there may be others.
        scale: largest effort in the result, to compare the residuals with.
        sample: that of the largest of these residuals, or the first wrong one.
    """

    equilibrium: float
    friction_law: float
    wrench: float
    ends: float
    wrong_status: int
    wrong_fields: int
    undecided: int
    scale: float
    sample: int

    def passed(self, relative: float = 1e-9) -> bool:
        """Return whether every residual is below `relative` times the scale, nothing wrong."""
        worst = np.max([self.equilibrium, self.friction_law, self.wrench, self.ends])
        small = bool(worst <= relative * max(self.scale, 1e-300))
        return small and not self.wrong_status and not self.wrong_fields


class SampleVerdict(NamedTuple):
    """The judge's result for one sample; see `Verdict`."""

    equilibrium: float = 0.0
    friction_law: float = 0.0
    wrench: float = 0.0
    ends: float = 0.0
    scale: float = 0.0
    wrong_status: bool = False
    wrong_field: bool = False
    undecided: bool = False


#: Returns the states of friction that were found at a sample.
Solutions = Callable[[int], tuple[Solution, ...]]


def judge(result: InverseResult) -> Verdict:
    """Recompute the residuals of a result, its ends and its statuses (see `Verdict`).

    What passes here also passes `result.check()`.
    """
    verdict = judge_motion(result, result.solutions)
    assert not verdict.passed() or result.check().passed(), result.check()
    return verdict


def judge_motion(result: SolvedMotion, solutions: Solutions) -> Verdict:
    """Recompute the residuals of a result (see `Verdict`), and of the solutions at its ends."""
    every = (result.effort_lower, result.effort_upper, result.effort_frictionless)
    scale = max(float(np.abs(np.nan_to_num(efforts)).max(initial=0)) for efforts in every)
    verdicts = [
        judge_sample(result, solutions, model, i)
        for start, stop, carried in result.states.phases(result.scene)
        for model in [result.scene.loaded_model(carried)]
        for i in range(start, stop)
    ]
    table = np.array(verdicts, dtype=float).reshape(-1, len(SampleVerdict._fields))
    residuals, wrong = table[:, :4], table[:, 5:7].any(axis=1)
    each = np.where(wrong, np.inf, np.nan_to_num(residuals, nan=np.inf).max(axis=1, initial=0.0))
    scale = max(scale, float(table[:, 4].max(initial=0.0)))
    equilibrium, law, wrench, ends = residuals.max(axis=0, initial=0.0).tolist()
    status, fields, undecided = table[:, 5:].sum(axis=0).astype(int).tolist()
    worst = int(np.argmax(each)) if len(each) else 0
    return Verdict(equilibrium, law, wrench, ends, status, fields, undecided, scale, worst)


def judge_sample(
    result: SolvedMotion, solutions: Solutions, model: pin.Model, i: int
) -> SampleVerdict:
    """Judge one sample; `model` carries its payloads."""
    sample, status = JudgedSample(result, model, i), Status(int(result.status[i]))
    maps, tree = sample.maps(), result.scene.linkage is None
    laws = site_laws(sample, max(1.0, float(np.abs(maps.contact[:, :, 0]).max(initial=0.0))))
    failed = status not in (Status.CONVERGED, Status.AMBIGUOUS)
    chooses = any(len(law.options) > 1 for law in laws)
    reported = [getattr(result, name) for name in _ARRAYS]
    false = any((np.isnan(x[i]) != failed).any() for x in reported if x is not None)
    false |= _wrong_rates(sample) or _wrong_certificates(sample, maps, laws, status, chooses)
    if status == Status.SINGULAR:
        false |= not np.isnan(result.effort_frictionless[i]).all()
        return SampleVerdict(wrong_status=tree or maps.regular > _REGULAR, wrong_field=false)
    frictionless = _apart(result.effort_frictionless[i], maps.effort[:, 0])
    verdict = SampleVerdict(frictionless, 0.0, 0.0, 0.0, maps.scale, tree and failed, false, True)
    if status == Status.NOT_CONVERGED:
        return verdict
    states = find_states(maps, laws)
    wrong = not states.possible(status) or (tree and failed)  # an open chain has one state
    verdict = verdict._replace(wrong_status=wrong, undecided=not states.certain)
    if failed or false:
        return verdict
    beyond = _left_by_others(sample, maps, states) if tree else 0.0
    several = chooses or status != Status.CONVERGED
    found = (() if tree else solutions(i)) if several else (_reported(sample),)
    if not chooses:
        wrong |= len(found) < states.most or (states.certain and len(found) > states.most)
    rows = [_residuals(maps, laws, one) for one in found]
    apart = _reference(sample, maps, states) if several else (0.0, 0.0)
    rows.append((float(np.max([maps.missed, frictionless, beyond])), *apart))
    equilibrium, law, wrench = np.array(rows).max(axis=0).tolist()
    ends, largest = _ends(sample, states, laws, found), [np.abs(one.effort) for one in found]
    scale = float(np.max([maps.scale, *np.concatenate([np.zeros(0), *largest])]))
    undecided = not states.certain
    return SampleVerdict(equilibrium, law, wrench, ends, scale, wrong, False, undecided)


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max(initial=0.0))


def _wrong_rates(sample: JudgedSample) -> bool:
    """Whether the drives' rates, or which sites stick, are not those of the motion."""
    result, i, scene, v, a = sample.result, sample.i, sample.scene, sample.v, sample.a
    size = 1.0 if scene.linkage is None else min(1.0, scene.linkage.size)
    fastest = float(np.abs(v).max(initial=0.0))
    speed = np.array([np.linalg.norm(sample.velocity(site)) for site in scene.sites])
    beyond = speed - np.array([site.law.stick_velocity for site in scene.sites])
    clear = np.abs(beyond) > _RATES * fastest
    if (clear & ((beyond <= 0.0) != result.sticking[i])).any():
        return True
    rate, slope = sample.drive_rates()
    most = _DERIVATIVE * (float(np.abs(a).max(initial=0.0)) + fastest**2 / size)
    return not (
        _apart(result.actuator_velocity[i], rate) <= _RATES * fastest
        and _apart(result.actuator_acceleration[i], slope) <= most
    )


def _wrong_certificates(
    sample: JudgedSample, maps: SampleMaps, laws: list[SiteLaw], status: Status, chooses: bool
) -> bool:
    """Whether `contraction`, `interval_exact` or `interval_searched` is false.

    The contraction bounds the spectral radius of A_kj = |gain_k| Lip(load_k along friction j) from
    above, no worse than the largest sum of a row does.
    """
    result, ns, spheres = sample.result, len(laws), any(law.sphere for law in laws)
    contraction = result.contraction[sample.i]
    exact, searched = result.interval_exact[sample.i], result.interval_searched[sample.i]
    if status == Status.SINGULAR:
        return bool(exact or searched or contraction != 0.0)
    slope = np.zeros((ns, ns))
    for j, law in enumerate(laws):
        forces = maps.contact[:, :, 1:][:, :, maps.entry_site == j]
        along = np.linalg.norm(forces @ law.direction, axis=1)
        if law.sphere:
            along = np.linalg.svd(forces, compute_uv=False)[:, 0]
        slope[:, j] = np.bincount(maps.owner, along, ns)
    every = np.array([np.abs(law.options[:, 1]).max() for law in laws])
    still = np.array([abs(law.still[1]) for law in laws])
    choices = np.prod([float(len(law.options)) for law in laws])
    tried = status == Status.CONVERGED and not spheres and choices <= _MANY
    least = np.linalg.eigvals((every if tried else still).reshape(-1, 1) * slope)
    most = (1.0 + _RADIUS) * float((every * slope.sum(axis=1)).max(initial=0.0))
    radius = float(np.abs(least).max(initial=0.0)) - _RADIUS * most
    rests = chooses and sample.scene.linkage is not None and bool(sample.scene.mobility.undriven)
    certain = status == Status.CONVERGED and not spheres and not rests and not searched
    may_search = choices > _MANY or (choices > _SOME and (spheres or contraction >= 1.0))
    wrong = not radius <= contraction <= most or exact != certain
    return bool(wrong or (searched and not may_search))


def _reported(sample: JudgedSample) -> Solution:
    """The result's own figures of a sample where everything slides."""
    result, i, parts = sample.result, sample.i, [np.zeros(0)]
    for site, size in zip(sample.scene.sites, result.friction_lower[i], strict=True):
        velocity = sample.velocity(site)
        slip = velocity / max(float(np.linalg.norm(velocity)), 1e-300)
        parts.append(size * (slip if site.ball else np.ones(1)))
    wrench, multipliers = (
        np.zeros((0, 6)) if x is None else x[i] for x in (result.wrench, result.multipliers)
    )
    return Solution(
        result.effort_lower[i],
        result.friction_lower[i],
        np.concatenate(parts),
        result.normal_load[i],
        wrench,
        multipliers,
    )


def _residuals(maps: SampleMaps, laws: list[SiteLaw], one: Solution) -> tuple[float, float, float]:
    """Equilibrium, friction law and wrench of one solution: what its friction causes."""
    phi = one.friction_coordinates
    x, load = np.append(1.0, phi), maps.loads(phi)
    law = _apart(one.normal_load, load)
    for k, site in enumerate(laws):
        own, values = phi[maps.entry_site == k], site.options @ np.array([1.0, load[k]])
        errors = [_apart(own, value * site.direction) for value in values]
        if site.sphere:
            errors[0] = abs(float(np.linalg.norm(own)) - abs(values[0]))
        law = float(np.max([law, np.min(errors)]))
    wrench = _apart(one.wrench, maps.wrench @ x) if len(one.wrench) else 0.0
    wrench = float(np.max([wrench, _apart(one.multipliers, maps.multipliers @ x)]))
    return _apart(one.effort, maps.effort @ x), law, wrench


def _reference(
    sample: JudgedSample, maps: SampleMaps, states: FrictionStates
) -> tuple[float, float]:
    """How far loads, and wrenches, are from a state in which what sticks has no friction."""
    result, i = sample.result, sample.i
    nearest = (0.0, 0.0) if len(states.reference) == 0 else (np.inf, np.inf)
    for phi in states.reference:
        x, wrench = np.append(1.0, phi), 0.0
        if result.wrench is not None:
            wrench = _apart(result.wrench[i], maps.wrench @ x)
        if result.multipliers is not None:
            wrench = float(np.max([wrench, _apart(result.multipliers[i], maps.multipliers @ x)]))
        nearest = min(nearest, (_apart(result.normal_load[i], maps.loads(phi)), wrench), key=max)
    return nearest


def _left_by_others(sample: JudgedSample, maps: SampleMaps, states: FrictionStates) -> float:
    """Narrow the range of friction where it alone balances a joint, D phi = total there.

    Each site has what the others on that joint leave. Returns the unbalanced part.
    """
    low, high, D, beyond = states.friction_lower, states.friction_upper, maps.D, 0.0
    for v in sample.scene.mobility.undriven:
        on, total = np.flatnonzero(D[:, v]), maps.total[v]
        ends = np.sort(D[on, v] * np.array([low[on], high[on]]), axis=0)
        least, most = ends.sum(axis=1)
        beyond = float(np.max([beyond, least - total, total - most]))
        for n, s in enumerate(on):
            others = np.delete(ends, n, axis=1).sum(axis=1)
            own = np.clip(total - others[::-1], *ends[:, n]) / D[s, v]
            low[s], high[s] = own.min(), own.max()
    return beyond


def _ends(
    sample: JudgedSample, states: FrictionStates, laws: list[SiteLaw], found: tuple[Solution, ...]
) -> float:
    """How far the reported ends of efforts and frictions are from those of the states.

    Where all slides, or states may be missing, solutions must attain the reported ends.
    """
    result, i, slides = sample.result, sample.i, all(len(law.options) == 1 for law in laws)
    lower, upper = result.effort_lower[i], result.effort_upper[i]
    friction = result.friction_lower[i], result.friction_upper[i]
    if states.certain and not slides:
        apart = [_apart(lower, states.lower), _apart(upper, states.upper)]
        if not result.interval_searched[i] and not any(law.sphere for law in laws):
            apart.append(_apart(friction[0], states.friction_lower))
            apart.append(_apart(friction[1], states.friction_upper))
        return float(np.max(apart))
    efforts = np.array([one.effort for one in found])
    apart = [_apart(lower, efforts.min(axis=0)), _apart(upper, efforts.max(axis=0))]
    if not slides:
        apart.append(float(np.fmax.reduce(lower - states.lower, initial=0.0)))
        apart.append(float(np.fmax.reduce(states.upper - upper, initial=0.0)))
    else:
        each = np.array([one.friction for one in found])
        apart += [_apart(friction[0], each.min(axis=0)), _apart(friction[1], each.max(axis=0))]
    return float(np.max(apart))
