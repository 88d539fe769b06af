"""Whether modes are consistent: loads, static limits and slip directions of a solved `Problem`.

A sticking coordinate must stay within its static limits (paper eq. 21). A slipping one that starts
from rest must move in the direction that its friction opposes (eq. 20).
"""

from __future__ import annotations

import numpy as np

from pinfric.friction.gears import (
    FEW_PASSES,
    MOST_PASSES,
    fit,
    gear_margins,
    gear_site,
    guess_lines,
    slip_friction,
    write_rows,
)
from pinfric.friction.given_modes import MOST_SOLUTIONS, solve_given_modes
from pinfric.friction.law import site_limits, sliding, stick_limits, write_loads, write_rates
from pinfric.friction.modes import Modes
from pinfric.friction.problem import Problem
from pinfric.friction.sliding import slide
from pinfric.kernels.compiled import kernel

#: How far beyond its law a sticking or slipping coordinate may be, relative to the terms: rounding.
ROUNDING = 1e-11
#: `judge`'s verdict on a slipping coordinate that moves against its direction.
SHOULD_STICK = 2


@kernel
def evaluate(problem: Problem, friction: np.ndarray, load: np.ndarray, rate: np.ndarray) -> None:
    """Write each site's load (ns,) and each coordinate's rate (nc,) under given friction (nc,)."""
    write_loads(problem.contact, problem.contact_site, problem.constant, friction, load)
    write_rates(problem, friction, rate)


@kernel
def limit_width(lower: float, upper: float) -> float:
    """Return the scale for rounding of static limits: their width, or the finite limit."""
    width = upper - lower
    return width if width < np.inf else min(abs(lower), abs(upper), 1e300)


@kernel
def site_friction(
    problem: Problem, modes: Modes, lower: np.ndarray, upper: np.ndarray, phi: np.ndarray
) -> None:
    """Write each site's friction (ns,); sites that share a sticking coordinate share its friction.

    The motion determines only the sum; it is shared in proportion to the limits. If one site holds
    any load, the others get the middle of the range that is left for them.

    Args:
        problem: `Problem`.
        modes: `Modes`, solved.
        lower, upper: (nc,), `stick_limits`.
        phi: (ns,), overwritten.
    """
    stuck, direction, friction, load = modes.stuck, modes.direction, modes.friction, modes.load
    for s in range(phi.size):
        c, ratio = problem.coordinate[s], problem.ratio[s]
        if stuck[c]:
            width = upper[c] - lower[c]
            if not width < np.inf:
                continue
            share = (friction[c] - lower[c]) / width if width > 0.0 else 0.5
            least, greatest = site_limits(problem, load, s)
            phi[s] = (least + share * (greatest - least)) / ratio
        else:
            gain, offset = sliding(problem, s, direction[c])
            phi[s] = (gain * load[s] + offset) / ratio
    for c in range(stuck.size):
        if stuck[c] and not upper[c] - lower[c] < np.inf:
            _share_unlimited(problem, friction[c], load, c, phi)


@kernel
def _share_unlimited(
    problem: Problem, friction: float, load: np.ndarray, c: int, phi: np.ndarray
) -> None:
    """Write the friction of the sites of a coordinate at rest of which one or more have no limit.

    The limited ones get the middle of what the others leave, each unlimited one what it must have
    at least; the last that can take it, the rest.
    """
    low = high = beyond_low = beyond_high = 0.0
    for s in range(phi.size):
        if problem.coordinate[s] == c:
            least, greatest = site_limits(problem, load, s)
            if greatest - least < np.inf:
                low, high = low + least, high + greatest
            else:
                beyond_low, beyond_high = beyond_low + least, beyond_high + greatest
    middle = 0.5 * (max(low, friction - beyond_high) + min(high, friction - beyond_low))
    share = (middle - low) / (high - low) if high > low else 0.5
    left = friction - middle
    for spread in (True, False):  # the second time from the last site on
        for n in range(phi.size):
            s = n if spread else phi.size - 1 - n
            if problem.coordinate[s] != c:
                continue
            least, greatest = site_limits(problem, load, s)
            had = 0.0 if spread else phi[s] * problem.ratio[s]
            part = min(max(0.0 if spread else had + left, least), greatest)
            if greatest - least < np.inf:
                part = least + share * (greatest - least)
            else:
                left -= part - had
            phi[s] = part / problem.ratio[s]


@kernel
def judge(problem: Problem, modes: Modes) -> int:
    """Write how each coordinate violates its law; return the number that do (paper eq. 20, 21).

    Args:
        problem: `Problem`.
        modes: `Modes`, solved; its `verdict` is overwritten.
    """
    resting = 0
    for c in range(modes.stuck.size):
        modes.verdict[c] = 0
        resting += modes.at_rest[c]
    return _judge_resting(problem, modes) if resting > 0 else 0


@kernel
def _judge_resting(problem: Problem, modes: Modes) -> int:
    """`judge` where joints rest, which needs more preparation."""
    nc, verdict, wrong = modes.stuck.size, modes.verdict, 0
    lower, upper = np.empty(nc), np.empty(nc)
    stick_limits(problem, modes.load, lower, upper)
    for c in range(nc):
        if not modes.at_rest[c]:
            continue
        x, terms = modes.friction[c], problem.rate_scale[c]
        for d in range(nc):
            terms += abs(problem.rate_slope[c, d] * modes.friction[d])
        if modes.stuck[c]:
            slack = ROUNDING * (limit_width(lower[c], upper[c]) + terms / problem.rate_slope[c, c])
            if x < lower[c] - slack:
                verdict[c] = 1
            elif not x <= upper[c] + slack:  # nor does what is not a number obey
                verdict[c] = -1
        elif not modes.direction[c] * modes.rate[c] >= -ROUNDING * terms:
            verdict[c] = SHOULD_STICK
        wrong += verdict[c] != 0
    for g in range(problem.gear_rotor.shape[0]):  # slips the way its law is broken: a worm's may be
        c = problem.coordinate[gear_site(problem, g)]  # against the load
        if modes.stuck[c] and abs(verdict[c]) == 1:
            backward, forward = gear_margins(problem, modes, g)
            if min(backward, forward) < 0.0:
                verdict[c] = -1 if backward < forward else 1
    return wrong


@kernel
def try_modes(problem: Problem, modes: Modes, chosen: bool) -> tuple[int, int]:
    """Solve given modes and judge the solutions; write the first that obeys, else the first.

    Every gear in motion is on the line that fits, by Newton's method over the lines.

    Args:
        problem: `Problem`.
        modes: `Modes`; its `friction` and `effort` are where the solve starts from.
        chosen: whether gears in motion are to keep their lines instead; solutions off them do not
            count.

    Returns:
        (number of solutions or -1, how many of them obey), see `solve_given_modes`.
    """
    if not chosen and slide(problem, modes):
        return 1, 1
    nc, ng = modes.stuck.size, modes.effort.size
    friction, guess, solutions = modes.friction, modes.friction, np.empty((MOST_SOLUTIONS, nc))
    lines, rows = np.empty((ng, 4)), np.empty((nc if ng > 0 else 0, 3))
    for passes in range(MOST_PASSES):
        if ng > 0:
            guess = np.empty(nc)
            slip_friction(problem, modes, guess)
            write_rows(problem, modes, passes > FEW_PASSES and passes % 2 == 1, lines, rows)
            if passes == 0 and not chosen:
                guess_lines(problem, modes, guess, lines, rows)
        found = solve_given_modes(
            problem, modes.stuck, modes.direction, rows, guess, solutions, modes.figures
        )
        first, obeying, wrong, there = -1, 0, 0, 0
        for i in range(found - 1, -1, -1):
            friction[:] = solutions[i]
            evaluate(problem, friction, modes.load, modes.rate)
            left, changed = fit(problem, modes, lines, True) if ng > 0 else (0, 0)
            if left > 0 and chosen:
                continue
            obeys = judge(problem, modes) == 0
            there, obeying = there + 1, obeying + obeys
            if first < 0 or obeys or obeying == 0:
                first, wrong = i, left + changed
        if first > 0:  # another was written last
            friction[:] = solutions[first]
            evaluate(problem, friction, modes.load, modes.rate)
            fit(problem, modes, lines, True)
            judge(problem, modes)
        if chosen or found <= 0 or wrong == 0:
            return min(found, there), obeying
    return -1, 0
