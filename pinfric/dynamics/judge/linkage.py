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

from pinfric.dynamics.judge.balance import Balance, balance
from pinfric.dynamics.judge.pairs import Pair, Sample, pair_friction
from pinfric.dynamics.judge.plain_laws import plain_displacement, plain_friction, plain_normal_load
from pinfric.dynamics.judge.states import Enumeration, States, site_laws
from pinfric.dynamics.samples.outcome import Solution, SolvedMotion, Status
from pinfric.model.scene import Scene

#: A status "singular" is wrong if no singular value that counts is as small as this.
_REGULAR = 1e-6
#: Fields that must be finite if there is a solution.
_ARRAYS = (
    "effort_lower",
    "effort_upper",
    "effort_frictionless",
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
    """

    equilibrium: float = 0.0
    friction_law: float = 0.0
    wrench: float = 0.0
    ends: float = 0.0
    scale: float = 0.0
    wrong_status: bool = False
    undecided: bool = False


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
    if status in (Status.SINGULAR, Status.NOT_CONVERGED):
        wrong = status == Status.SINGULAR and maps.regular > _REGULAR
        return Verdict(wrong_status=wrong, undecided=status == Status.NOT_CONVERGED)
    laws = site_laws(sample, max(1.0, float(np.abs(maps.contact[:, :, 0]).max(initial=0.0))))
    states = Enumeration(maps, laws).run()
    wrong, undecided = not states.possible(status), not states.certain
    if status == Status.JAMMED:
        return Verdict(wrong_status=wrong, undecided=undecided)
    if any(np.isnan(getattr(result, name)[i]).any() for name in _ARRAYS):
        return Verdict(np.inf, wrong_status=wrong, undecided=undecided)
    chooses = any(len(law.options) > 1 for law in laws)
    if chooses or status == Status.AMBIGUOUS:
        found = solutions(i)
        wrong |= not chooses and states.certain and len(found) != states.most
        apart, law = _ends(sample, states, found, any(law.sphere for law in laws))
        law = max(law, _reference(sample, maps, states)) if chooses else law
    else:
        found, law = (_reported(sample),), 0.0
        apart = max(
            _apart(result.effort_lower[i], result.effort_upper[i]),
            _apart(result.friction_lower[i], result.friction_upper[i]),
        )
    rows = [_residuals(sample, one) for one in found]
    worst = np.array([*rows, np.zeros(3)]).max(axis=0)
    frictionless = _apart(result.effort_frictionless[i], maps.effort[:, 0])
    equilibrium = float(np.max([worst[0], maps.missed, frictionless]))
    scale = max([maps.scale, *(float(np.abs(one.effort).max(initial=0.0)) for one in found)])
    return Verdict(
        equilibrium, float(np.max([worst[1], law])), float(worst[2]), apart, scale, wrong, undecided
    )


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max(initial=0.0))


def _ends(
    sample: Sample, states: States, solutions: tuple[Solution, ...], spheres: bool
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
    if not states.certain or spheres or not result.interval_exact[i]:
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
