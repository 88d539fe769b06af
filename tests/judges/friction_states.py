"""The judge's states of friction of one sample: every choice of limits, by Newton's method.

A sliding site has one friction, a sticking site either of its limits, a reversing site all three;
these make the efforts' ends. A choice that contracts has exactly one solution (Banach); else many
starts are tried, and nothing is proved.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from judges.judged_sample import JudgedSample, SampleMaps
from judges.plain_laws import plain_friction

from pinfric.dynamics.samples.outcome import Status
from pinfric.model.scene import Site

#: Up to this number of choices all are tried; beyond it, as many random ones.
_ENUMERATED = 4096
#: Random directions of the friction of sticking balls.
_DIRECTIONS = 32
#: Starts of a choice that may have several solutions, up to this many times the largest load.
_STARTS, _FAR = 64, 1e7
#: Passes towards a solution, and how close two solutions are one, relative to their size.
_PASSES, _DISTINCT = 200, 1e-6
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class SiteLaw:
    """Possible frictions of one site: alpha + beta load along its direction.

    Attributes:
        options: (n, 2) alpha, beta: where it slides, at its two limits, at all three.
        still: alpha, beta of 0 where it sticks, else those of sliding.
        direction: (1,) 1, or (3,) a ball's unit vector of slip.
        sphere: the first option is the radius of a sticking ball's sphere.
    """

    options: np.ndarray
    still: tuple[float, float]
    direction: np.ndarray
    sphere: bool

    @property
    def ends(self) -> np.ndarray:
        """Options along a line; a sphere has two sides."""
        return np.vstack([-self.options[:1], self.options]) if self.sphere else self.options


def site_laws(sample: JudgedSample, scale: float) -> list[SiteLaw]:
    """Return the possible frictions of each site, for loads about `scale` (N m or N)."""
    laws = []
    for k, site in enumerate(sample.scene.sites):
        velocity = sample.velocity(site)
        speed = float(np.linalg.norm(velocity))

        def limits(at: float, site: Site = site) -> list[tuple[float, float]]:
            none, some = (plain_friction(site, at, load) for load in (0.0, scale))
            return [(a, (b - a) / scale) for a, b in zip(none, some, strict=True)]

        low, high = limits(speed if site.ball else float(velocity[0]))
        rest, sticks = limits(0.0), low != high
        options = [low, high] if sticks else [low]
        if not sticks and sample.result.reversal[sample.i, k] and rest[0] != rest[1]:
            options = [*rest, low]
        sphere = site.ball and len(options) > 1
        if sphere:  # two limits are one radius
            options = [max((-options[0][0], -options[0][1]), options[1]), *options[2:]]
        direction = velocity / max(speed, 1e-300) if site.ball else np.ones(1)
        laws.append(SiteLaw(np.array(options), (0.0, 0.0) if sticks else low, direction, sphere))
    return laws


@dataclass
class FrictionStates:
    """The states of one sample.

    Attributes:
        lower, upper, friction_lower, friction_upper, reference, fewest, most: as in `States` of
            `enumeration.py`.
        certain: all choices were tried, each has exactly one solution.
    """

    lower: np.ndarray
    upper: np.ndarray
    friction_lower: np.ndarray
    friction_upper: np.ndarray
    reference: np.ndarray
    fewest: int
    most: int
    certain: bool

    def possible(self, status: Status) -> bool:
        """Return whether a sample with these states can have this status."""
        if status == Status.JAMMED:
            return self.fewest == 0
        if status == Status.CONVERGED:
            return self.most <= 1
        return self.most > 1 or not self.certain


def find_states(maps: SampleMaps, laws: list[SiteLaw]) -> FrictionStates:
    """Solve the choices of a sample; each widens the ends."""
    ns, at, U, rng = len(laws), maps.entry_site, maps.effort, np.random.default_rng(0)
    acts = np.bincount(at, np.abs(maps.contact[:, :, 1:]).sum(axis=(0, 1)), ns) > 0.0
    several = np.array([len(law.ends) > 1 for law in laws], dtype=bool)
    leaves = np.flatnonzero(several & ~acts)  # load nothing: each end picks their friction
    sizes = [1 if s in leaves else len(law.options) for s, law in enumerate(laws)]
    every = np.prod([float(size) for size in sizes]) <= _ENUMERATED
    tried: Any = product(*map(range, sizes))
    tried = list(tried) if every else rng.integers(0, sizes, (_ENUMERATED, ns))
    codes = np.array(tried, dtype=int).reshape(len(tried), ns)
    spheres = [s for s in np.flatnonzero(acts) if laws[s].sphere]
    codes = np.repeat(codes, _DIRECTIONS if spheres else 1, axis=0)
    lines = np.zeros((len(codes), ns, 2))
    for s, law in enumerate(laws):
        if s not in leaves:
            lines[:, s] = law.options[codes[:, s]]
    one = np.concatenate([np.zeros(0), *(law.direction for law in laws)])
    directions = np.tile(one, (len(codes), 1))
    for b in spheres:
        turned = rng.normal(size=(len(codes), 3))
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        directions[np.ix_(codes[:, b] == 0, at == b)] = turned[codes[:, b] == 0]
    choice, phi, sure = solve_choices(maps, lines, directions)
    still = np.array([law.still for law in laws]).reshape(1, ns, 2)
    load = np.array([maps.loads(x) for x in phi]).reshape(len(phi), ns)
    low = U[:, 0] + phi @ U[:, 1:].T
    high, ranges = low.copy(), np.full((2, ns), np.nan)
    for s, law in enumerate(laws):
        values = (phi[:, at == s] @ law.direction)[:, None]
        if s in leaves:
            values = law.ends[:, 0] + law.ends[:, 1] * load[:, s, None]
            along = U[:, 1:][:, at == s]
            lever = np.linalg.norm(along, axis=1) if law.sphere else along @ law.direction
            low += (values[:, :, None] * lever).min(axis=1)
            high += (values[:, :, None] * lever).max(axis=1)
        if len(values):
            ranges[:, s] = values.min(), values.max()
    count = np.bincount(choice, minlength=len(codes))
    return FrictionStates(
        np.fmin.reduce(low, axis=0, initial=np.nan),
        np.fmax.reduce(high, axis=0, initial=np.nan),
        ranges[0],
        ranges[1],
        solve_choices(maps, still, one[None])[1],
        int(count.min()),
        int(count.max()),
        bool(every and sure.all() and not spheres),
    )


def solve_choices(
    maps: SampleMaps, lines: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return every solution of z = k + sum |p + P phi|, phi = direction (alpha + beta z).

    Args:
        lines: (m, ns, 2) alpha and beta of each choice. directions: (m, ne).

    Returns:
        (n,) the choice, (n, ne) friction, and (m,) whether a choice has exactly one solution.
    """
    at, ns, m = maps.entry_site, len(maps.constant), len(lines)
    own = (np.arange(ns)[:, None] == maps.owner).astype(float)
    place = (at[:, None] == np.arange(ns)).astype(float)
    given, gain = directions * lines[:, at, 0], directions * lines[:, at, 1]
    forces = maps.contact[:, :, 1:]
    p = maps.contact[:, :, 0] + np.einsum("tek,mk->mte", forces, given)
    P = np.einsum("tek,mk,kj->mtej", forces, gain, place)
    steep = np.einsum("kt,mtj->mkj", own, np.sqrt((P**2).sum(axis=2)))
    sure = np.abs(np.linalg.eigvals(steep)).max(axis=1, initial=0.0) < 1.0 - 1e-9
    first = maps.constant + np.sqrt((p**2).sum(axis=2)) @ own.T
    open_, rng = np.flatnonzero(~sure), np.random.default_rng(1)
    size = np.logspace(-3, np.log10(_FAR), _STARTS)[:, None] * rng.random((_STARTS, ns))
    starts = first[open_, None] + size * first[open_].max(axis=1, initial=0.0)[:, None, None]
    choice = np.concatenate([np.arange(m), np.repeat(open_, _STARTS)])
    starts = np.concatenate([first, starts.reshape(len(open_) * _STARTS, ns)])
    z = _near(starts, sure[choice], maps.constant, own, p[choice], P[choice])
    order = np.argsort(choice, kind="stable")
    kept: list[int] = []
    begin = 0
    for n in order[np.isfinite(z[order]).all(axis=1)]:
        if kept and choice[kept[-1]] != choice[n]:
            begin = len(kept)
        far = [np.abs(z[n] - z[k]).max(initial=0.0) for k in kept[begin:]]
        if not kept[begin:] or min(far) > _DISTINCT * np.abs(z[n]).max(initial=0.0):
            kept.append(int(n))
    choice, z = choice[kept], z[kept]
    return choice, given[choice] + gain[choice] * z[:, at], sure


def _near(
    z: np.ndarray,
    pass_helps: np.ndarray,
    k: np.ndarray,
    own: np.ndarray,
    p: np.ndarray,
    P: np.ndarray,
) -> np.ndarray:
    """Return the solutions (n, nz) that Newton's method reaches from z; NaN where none.

    Where `pass_helps` (n,) and Newton's step does not, a step of the fixed point is taken.
    """

    def residual(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        force = p + np.einsum("mtej,mj->mte", P, z)
        size = np.sqrt((force**2).sum(axis=2))
        rest = z - k - size @ own.T
        unit = force / np.where(size > 0.0, size, 1.0)[:, :, None]
        return rest, np.abs(rest).max(axis=1, initial=0.0), unit

    rest, error, unit = residual(z)
    best, least = z, error
    for _ in range(_PASSES):
        J = np.eye(z.shape[1]) - np.einsum("kt,mte,mtej->mkj", own, unit, P)
        good = np.abs(np.linalg.det(J)) > 1e-14
        step = rest.copy()
        step[good] = np.linalg.solve(J[good], rest[good][:, :, None])[:, :, 0]
        worse = pass_helps & ~(residual(z - step)[1] < 0.9 * error)
        step[worse] = rest[worse]
        z = np.where(np.isfinite(step), z - step, z)
        rest, error, unit = residual(z)
        better = error < least
        best, least = np.where(better[:, None], z, best), np.where(better, error, least)
        if not better.any():
            break
    terms = np.abs(p).sum(axis=2) + np.einsum("mtej,mj->mt", np.abs(P), np.abs(best))
    rounding = _EPS * (np.abs(best) + k + terms @ own.T)
    found = (np.abs(residual(best)[0]) <= 1e4 * rounding).all(axis=1)
    return np.where(found[:, None], best, np.nan)
