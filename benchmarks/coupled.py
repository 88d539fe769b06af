"""Cost of a coupled solve: the paper's fixed point and Newton, to a series of tolerances.

    x = G(x) = -sign(v) (mu c(x) + coulomb) - viscous v,    c(x) = sum |p_0 + P x| + const

(the paper's 16 and 17). Each pass of the fixed point multiplies the error by the slope of G at the
solution, which tends to 1 towards the jam; of the drawer it is mu / critical mu there. Newton's
passes stay few. Both are written out here, without the safeguards of `friction.given_modes`, whose
solution is the reference.

    python benchmarks/coupled.py

prints both for the bundled drawer and four-bar.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from rich.console import Console

import pinfric as pf
from pinfric.accuracy.explain import all_rounds
from pinfric.dynamics.inverse.choices import SLIDES, friction_laws
from pinfric.dynamics.inverse.interval_ends import EndTables, choice_of_sample
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.inverse.solutions import one_sample
from pinfric.friction.dense import solve_dense
from pinfric.friction.given_modes import Reduced
from pinfric.kernels.compiled import kernel
from pinfric.model.described import described, quantity
from pinfric.show.report.rows import text_of
from pinfric.show.report.tables import Column, ColumnKind, Table
from pinfric.show.report.values import digits, power_of_ten

#: Coefficients of friction as shares of those at which the mechanism jams.
SHARES = (0.2, 0.6, 0.9, 0.98, 0.9998)
#: Relative residuals at which the solvers stop.
TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
#: The solvers, and the passes after which each gives up.
MOST_PASSES = {"fixed point": 200_000, "Newton": 60}
#: Samples among which the one that jams first is looked for.
_LOOKS = 40
#: Factors above the certain one (contraction 1) up to which a jam is looked for, and how closely.
_FARTHEST, _CLOSE = 64.0, 1e-9
#: A timing repeats its solve for this many passes at least.
_TIMED_PASSES = 2000
_NAN = float("nan")


@described
class CoupledRun:
    """One solver to one tolerance, all coefficients of the load times one factor."""

    t: float = quantity("time of the sample; its number where there are no times", "s")
    mu_factor: float = quantity("on every coefficient mu of the scene")
    share: float = quantity("the same as a share of the factor at which the sample jams")
    contraction: float = quantity(
        "of `given_modes`; below 1 the solution is certain, and the only one"
    )
    solver: str = quantity("`fixed point` or `Newton`")
    tolerance: float = quantity("relative residual max |x - G(x)| / max |G(x)| at which it stops")
    iterations: int = quantity("passes, an evaluation of G each", default=0)
    error: float = quantity("largest of friction, relative to the largest friction", default=_NAN)
    wall_s: float = quantity("of one solve of one sample", "s", default=_NAN)
    problem: str = quantity("why it failed; empty where it did not", default="")


class CoupledFriction(NamedTuple):
    """The coupled friction of a sliding sample: x = G(x) = rest + gain c(x).

    Attributes:
        free: (nt, 3) contact forces without friction; slope: (nt, ns, 3) their change with x.
        site: (nt,) site of each contact force.
        gain, rest: (ns,), at the scene's own coefficients.
        constant: (ns,) constant part of the loads.
    """

    free: np.ndarray
    slope: np.ndarray
    site: np.ndarray
    gain: np.ndarray
    rest: np.ndarray
    constant: np.ndarray


@dataclass(frozen=True, eq=False)
class _Sample:
    """One sliding sample: when, the package's solver with mu times a factor, and G."""

    t: float
    solver: Callable[[float], tuple[EndTables, int, Reduced]]
    friction: CoupledFriction

    @classmethod
    def of(cls, result: InverseResult, sample: int) -> _Sample | None:
        """Return a sample's problem; None where the drives cannot balance its load."""
        plan, samples = one_sample(result, sample)
        if samples.singular[0]:
            return None
        law = friction_laws(plan, samples)
        ns = len(plan.sites.joint)

        def solver(factor: float) -> tuple[EndTables, int, Reduced]:
            scaled = law._replace(mu=factor * law.mu)
            return choice_of_sample(plan, samples, scaled, law.code[0])

        slope = np.zeros((len(plan.contacts.site), ns, 3))
        for s in range(ns):
            first = plan.sites.first_entry[s]
            part = slice(first, first + plan.sites.entry_count[s])
            along = samples.contact[0, :, 1:][:, part]
            slope[:, s] = np.einsum("tke,k->te", along, law.direction[0, part])
        times = result.states.t
        return cls(
            t=float(sample if times is None else times[sample]),
            solver=solver,
            friction=CoupledFriction(
                free=np.ascontiguousarray(samples.contact[0, :, 0]),
                slope=slope,
                site=plan.contacts.site,
                gain=-law.way[SLIDES, 0] * law.mu[SLIDES, 0],
                rest=-law.way[SLIDES, 0] * law.coulomb[SLIDES, 0],
                constant=plan.sites.constant,
            ),
        )

    def known(self, factor: float) -> tuple[int, np.ndarray, float]:
        """Return the package's solutions with mu times a factor: how many, one, contraction."""
        search, found, _ = self.solver(factor)
        return found, search.choice.x[0], float(search.answer.contraction[0])

    def solve(
        self, solver: str, factor: float, tolerance: float, times: int = 1
    ) -> tuple[np.ndarray, int]:
        """Return friction (ns,) and passes, -1 where it fails, of `times` solves."""
        x, scaled = np.zeros(len(self.friction.gain)), factor * self.friction.gain
        passes = solve(
            self.friction._replace(gain=scaled),
            solver == "Newton",
            tolerance,
            MOST_PASSES[solver],
            times,
            x,
        )
        return x, int(passes)


def coupled(result: InverseResult, rounds: int = 3) -> tuple[CoupledRun, ...]:
    """Return passes, errors and times of both solvers up to the jam; () where nothing couples.

    Of the sliding samples, the one is taken that jams first as the coefficients grow. Both are
    timed in each of the `rounds`.
    """
    found = _first_to_jam(result)
    if found is None:
        return ()
    sample, jam = found
    rows: list[CoupledRun] = []
    timed: dict[int, Callable[[], object]] = {}
    repeats: dict[int, int] = {}
    for share in SHARES:
        factor = share * jam
        _, reference, contraction = sample.known(factor)
        for solver, most in MOST_PASSES.items():
            for tolerance in TOLERANCES:
                row = CoupledRun(sample.t, factor, share, contraction, solver, tolerance)
                x, passes = sample.solve(solver, factor, tolerance)
                if passes < 0:
                    rows.append(replace(row, problem=f"not within {most:,} passes"))
                    continue
                error = np.abs(x - reference).max() / np.abs(reference).max()
                n = repeats[len(rows)] = max(1, _TIMED_PASSES // passes)
                timed[len(rows)] = partial(sample.solve, solver, factor, tolerance, n)
                rows.append(replace(row, iterations=passes, error=float(error)))
    seconds = {i: float(np.median(x)) for i, x in all_rounds(timed, rounds).items()}
    return tuple(
        replace(row, wall_s=seconds[i] / repeats[i]) if i in seconds else row
        for i, row in enumerate(rows)
    )


def _first_to_jam(result: InverseResult) -> tuple[_Sample, float] | None:
    """The sliding sample that jams at the least factor on its coefficients, and that factor."""
    if result.scene.linkage is None:
        return None
    slides = ~(result.sticking | result.reversal).any(axis=1) & (result.contraction > 0.0)
    samples = np.flatnonzero(slides)
    best: tuple[_Sample, float] | None = None
    for i in samples[:: max(1, len(samples) // _LOOKS)]:
        sample = _Sample.of(result, int(i))
        if sample is None:
            continue
        jam = _jam(sample, np.inf if best is None else best[1])
        if best is None or jam < best[1]:
            best = sample, jam
    return best


def _jam(sample: _Sample, least: float) -> float:
    """The factor on mu beyond which no solution is found, or inf if it is no less than `least`.

    It is at least the factor at which the contraction is 1; that one where none jams at all.
    """
    certain = 1.0 / sample.known(1.0)[2]
    if certain >= least or (np.isfinite(least) and sample.known(least)[0] != 0):
        return np.inf
    low, high = certain, min(least, _FARTHEST * certain)
    if sample.known(high)[0] != 0:
        return certain
    while high - low > _CLOSE * high:
        middle = 0.5 * (low + high)
        if sample.known(middle)[0] == 0:
            high = middle
        else:
            low = middle
    return low


@kernel
def evaluate(friction: CoupledFriction, x: np.ndarray, g: np.ndarray, jacobian: np.ndarray) -> None:
    """Write g = G(x) (ns,) and, if it has any rows, the Jacobian (ns, ns) of x - G(x)."""
    free, slope, site, gain, rest, constant = friction
    ns, differentiate = x.size, jacobian.shape[0] > 0
    for s in range(ns):
        g[s] = rest[s] + gain[s] * constant[s]
        if differentiate:
            for j in range(ns):
                jacobian[s, j] = 1.0 if j == s else 0.0
    p = np.empty(3)
    for t in range(site.size):
        s = site[t]
        for e in range(3):
            p[e] = free[t, e]
            for j in range(ns):
                p[e] += slope[t, j, e] * x[j]
        norm = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
        g[s] += gain[s] * norm
        if differentiate and norm > 0.0:  # at zero load: an element of the generalized Jacobian
            for j in range(ns):
                along = p[0] * slope[t, j, 0] + p[1] * slope[t, j, 1] + p[2] * slope[t, j, 2]
                jacobian[s, j] -= gain[s] * along / norm


@kernel
def close_enough(x: np.ndarray, g: np.ndarray, tolerance: float) -> bool:
    """Say whether max |x - g| <= tolerance max |g|."""
    off, size = 0.0, 0.0
    for s in range(x.size):
        off, size = max(off, abs(x[s] - g[s])), max(size, abs(g[s]))
    return off <= tolerance * size


@kernel
def solve(
    friction: CoupledFriction, newton: bool, tolerance: float, most: int, times: int, x: np.ndarray
) -> int:
    """Solve x = G(x) from x = 0; return passes, -1 if it fails.

    Args:
        friction: G.
        newton: semi-smooth Newton on x - G(x) = 0; else x <- G(x), as in the paper.
        tolerance: of `close_enough`. most: passes. times: how often, for timing.
        x: (ns,) overwritten.
    """
    ns = x.size
    g, step = np.empty(ns), np.empty((ns, 1))
    jacobian = np.empty((ns if newton else 0, ns))
    passes = -1
    for _ in range(times):
        x[:] = 0.0
        passes = -1
        for n in range(most):
            evaluate(friction, x, g, jacobian)
            done = close_enough(x, g, tolerance)
            if not newton:
                x[:] = g
            elif not done:
                for s in range(ns):
                    step[s, 0] = x[s] - g[s]
                if not solve_dense(jacobian, step):
                    break
                for s in range(ns):
                    x[s] -= step[s, 0]
            if done:
                passes = n + 1
                break
    return passes


def table(title: str, runs: Sequence[CoupledRun]) -> Table:
    """Passes to each tolerance, a row per coefficient and solver; error and time at the last."""
    tolerances = sorted({run.tolerance for run in runs}, reverse=True)
    columns = (
        Column("mu / mu\nat jam"),
        Column("contrac-\ntion"),
        Column("solver", ColumnKind.LABEL),
        *(Column(f"passes\n{power_of_ten(tolerance, 0)}") for tolerance in tolerances),
        Column("error\nleft"),
        Column("time\nus"),
    )
    rows = []
    for share in dict.fromkeys(run.share for run in runs):
        for n, solver in enumerate(dict.fromkeys(run.solver for run in runs)):
            own = [run for run in runs if (run.share, run.solver) == (share, solver)]
            last = own[-1]
            passes = ["fails" if run.problem else str(run.iterations) for run in own]
            first = ("", "") if n else (f"{share:g}", f"{last.contraction:.4f}")
            rows.append((*first, solver, *passes, _decade(last.error), digits(1e6 * last.wall_s)))
    return Table(title, columns, rows, keys=3)


def lines(runs: Sequence[CoupledRun]) -> list[str]:
    jam = runs[0].mu_factor / runs[0].share
    return [
        f"at t = {digits(runs[0].t)} s, where it jams first as all mu grow: at {digits(jam)} times "
        "the scene's",
        "passes from no friction to a relative residual; error left in friction (relative) and "
        "time of one solve to the least of them",
    ]


def _decade(x: float) -> str:
    return text_of(x, "decade")


def main() -> None:
    """Print figures of both solvers, up to the jam."""
    for name in ("drawer", "four_bar"):
        scene = pf.load_scene(name)
        runs = coupled(pf.inverse_dynamics(scene, pf.load_trajectory(name, scene)))
        Console().print(table(name, runs), *lines(runs), sep="\n")


if __name__ == "__main__":
    main()
