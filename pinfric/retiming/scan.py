"""The fastest profile x(s) = (ds/dt)^2 on a grid: one scan back, one forward.

At a place and a speed every limit of a drive bounds u = d^2s/dt^2. In the direction of motion the
effort y(u), friction included, and the motor's torque times the ratio F(u) = upper(y) + ... are
convex. So F <= r T leaves an interval of u, and F >= -r T takes one out. Inside an interval of the
grid u is linear in s, each end judged by itself (or constant, judged at both):

    x' - x = step (u_a + u_b),      u_a in [low, high](x),  u_b in [low', high'](x')

Backward: K_i, the greatest x from which K_{i+1} is reached. Forward: the greatest x' <= K_{i+1}
(Pham & Pham 2018, A new approach to time-optimal path parameterization based on reachability
analysis; `notebooks/theory/retiming`). j is an interval, x (ds/dt)^2 at its start.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.kernels.compiled import kernel
from pinfric.kernels.records import record
from pinfric.model.drives import Gears, gear_drag, gear_line
from pinfric.model.laws import Laws, law_at

#: How a drive is judged at one end of an interval: by its own direction and friction in motion; or
#: by both ends of its interval of standstill, each of which must be within the limits.
MOVING, WORST = range(2)
_FAR = 1.0e9
#: Levels of x that are tried where a solution is not next to the expected one, and bisections.
_LEVELS, _HALVINGS = 48, 52
_OPEN, _PASSABLE, _REACHED = range(3)
#: An interval that leaves less of x than this is taken more slowly.
_HARDEST = 0.25
_TINY = 1.0e-12


class Scan(NamedTuple):
    """Everything the scan reads.

    Attributes:
        step, start, end, stop: of `tables.Grid`. effort, gram: of `tables.Tables`.
        rate, curvature: (m, nv) q' and q'' of each row.
        top: (m,) greatest x that the speeds allow.
        way: (n, nv) sign of each drive's motion in each interval, 0 at rest.
        mode: (n, 2, nv) see `MOVING`.
        constant: (n,) bool, whether u is constant in the interval.
        share: (n,) part of torques, efforts and accelerations that may be used in the interval.
        site_start: (nv + 1,) which entries of the next three are a drive's.
        site, weight, turn: (ns,) site, its speed per speed of the drive, and the sign of that.
        term_start: (ns + 1,) which rows of `gram` are a site's.
        load: (ns,) constant part of each site's load.
        laws: of the sites. gears: of the drives.
        peak, stall, no_load_speed: (nv,) N m, N m, rad/s at the motor's shaft; infinite: no limit.
        effort_limit, acceleration: (nv,) N m or N, rad/s^2 or m/s^2 at the joint.
        work: (nt, 3), head: (8,) scratch.
        holes: (1,) how often a lower limit cut u's interval in two.
    """

    step: np.ndarray
    start: np.ndarray
    end: np.ndarray
    stop: np.ndarray
    effort: np.ndarray
    gram: np.ndarray
    rate: np.ndarray
    curvature: np.ndarray
    top: np.ndarray
    way: np.ndarray
    mode: np.ndarray
    constant: np.ndarray
    share: np.ndarray
    site_start: np.ndarray
    site: np.ndarray
    weight: np.ndarray
    turn: np.ndarray
    term_start: np.ndarray
    load: np.ndarray
    laws: Laws
    gears: Gears
    peak: np.ndarray
    stall: np.ndarray
    no_load_speed: np.ndarray
    effort_limit: np.ndarray
    acceleration: np.ndarray
    work: np.ndarray
    head: np.ndarray
    holes: np.ndarray


box_scan = record(Scan)


@kernel
def _prepare(s: Scan, row: int, d: int, direction: float, static: bool, x: float) -> int:
    """Write y(u) and F(u) of one drive in one direction into the scratch; returns how many norms.

    y = head[0] + head[1] u + sum sqrt(work . (1, u, u^2)), F = upper(y) + head[2] + head[3] u; what
    follows in head is for `gear_line`: drive, direction, speed, whether it is to leave rest.
    """
    rate, root = s.rate[row, d], np.sqrt(x)
    speed = abs(rate) * root
    base = direction * (s.effort[row, d, 0] + s.effort[row, d, 1] * x)
    count = 0
    for k in range(s.site_start[d], s.site_start[d + 1]):
        site, weight = s.site[k], s.weight[k]
        forward = direction * s.turn[k] > 0.0
        law = law_at(s.laws, site, np.copysign(speed * weight, 1.0 if forward else -1.0))
        mu, flat = law.mu, law.forward if forward else law.backward
        if static:
            mu, flat = law.static_mu, law.static_forward if forward else law.static_backward
        mu += law.drag_mu
        flat += law.drag + law.viscous * speed * weight
        base += weight * (flat + mu * s.load[site])
        square = (weight * mu) ** 2
        if square == 0.0:
            continue
        for t in range(s.term_start[site], s.term_start[site + 1]):
            g = s.gram[row, t]
            s.work[count, 0] = square * (g[0] + x * (2.0 * g[3] + x * g[1]))
            s.work[count, 1] = square * 2.0 * (g[4] + x * g[5])
            s.work[count, 2] = square * g[2]
            count += 1
    r, inertia = s.gears.ratio[d], s.gears.rotor_inertia[d]
    s.head[0], s.head[1] = base, direction * s.effort[row, d, 2]
    s.head[2] = gear_drag(s.gears, d, speed) + r * r * direction * inertia * s.curvature[row, d] * x
    s.head[3] = r * r * direction * inertia * rate
    s.head[4], s.head[5], s.head[6], s.head[7] = d, direction, speed, 1.0 if static else 0.0
    return count


@kernel
def _value(s: Scan, count: int, motor: bool, u: float) -> tuple[float, float]:
    """F(u) and its slope if it is the motor's, else y(u) and its slope."""
    f, slope = s.head[0] + s.head[1] * u, s.head[1]
    for k in range(count):
        b, c = s.work[k, 1], s.work[k, 2]
        square = s.work[k, 0] + u * (b + c * u)
        if square > 0.0:
            norm = np.sqrt(square)
            f += norm
            slope += (0.5 * b + c * u) / norm
    if motor:
        d, direction = int(s.head[4]), s.head[5]
        line = gear_line(s.gears, d, direction, s.head[6], s.head[7] > 0.0, direction * f)
        f = line[0] * f + direction * line[1] + s.head[2] + s.head[3] * u
        slope = line[0] * slope + s.head[3]
    return f, slope


@kernel
def _root(s: Scan, count: int, motor: bool, u: float, side: float, target: float) -> float:
    """Newton from above a function's level to it, leftwards (side -1) or rightwards.

    Where a gear's efficiency rises with its load the function is not quite convex, and what Newton
    overshoots is bisected. NaN where it does not come down on this side.
    """
    outside, inside = u, np.nan
    for _ in range(80):
        f, slope = _value(s, count, motor, u)
        if abs(f - target) <= _TINY * (abs(target) + abs(s.head[0])):  # rounding from afar: below
            return u
        if f > target:
            outside = u
            if side * slope >= 0.0 and inside != inside:
                return np.nan
        else:
            inside = u
        following = u - (f - target) / slope if slope != 0.0 else outside
        if inside == inside and not (following - inside) * (following - outside) < 0.0:
            following = 0.5 * (inside + outside)
        if following == u:
            return u
        u = following
    return u


@kernel
def _within(
    s: Scan, count: int, motor: bool, least: float, most: float, low: float, high: float
) -> tuple[float, float]:
    """Part of [low, high] in which least <= f(u) <= most, f convex; low > high where none is."""
    f_low, slope_low = _value(s, count, motor, low)
    f_high, slope_high = _value(s, count, motor, high)
    if f_high > most or f_low > most:
        if f_high > most:
            high = _root(s, count, motor, high, -1.0, most)
        if f_low > most:
            low = _root(s, count, motor, low, 1.0, most)
        if not low <= high:
            return _FAR, -_FAR
        f_low, slope_low = _value(s, count, motor, low)
        f_high, slope_high = _value(s, count, motor, high)
    slack = _TINY * (abs(least) + abs(s.head[0])) if least > -np.inf else 0.0
    below_low, below_high = f_low < least - slack, f_high < least - slack
    if below_low and below_high:
        return _FAR, -_FAR
    if below_low:
        return _root(s, count, motor, high, -1.0, least), high
    if below_high:
        return low, _root(s, count, motor, low, 1.0, least)
    if slope_low < 0.0 < slope_high and least > -np.inf:
        meet = (f_high - f_low + slope_low * low - slope_high * high) / (slope_low - slope_high)
        if f_low + slope_low * (meet - low) < least:  # the tangents go below: f may, too
            left = _root(s, count, motor, low, 1.0, least)
            if left == left:
                right = _root(s, count, motor, high, -1.0, least)
                if right > left:
                    s.holes[0] += 1
                    if left - low >= high - right:
                        return low, left
                    return right, high
    return low, high


@kernel
def _limited(
    s: Scan,
    row: int,
    d: int,
    direction: float,
    static: bool,
    x: float,
    ends: tuple[float, float],
    share: float,
) -> tuple[float, float]:
    """Part of the `ends` of u that a share of a drive's torque and effort leaves, in one direction.

    At rest (`static`) only the torque in that direction is bounded; the other one bounds the rest.
    """
    low, high = ends
    r, speed = abs(s.gears.ratio[d]), abs(s.rate[row, d]) * np.sqrt(x)
    line = r * speed / s.no_load_speed[d]
    most, least = r * min(share * s.peak[d], s.stall[d] * (share - line)), -np.inf
    if not static:
        least = -r * min(share * s.peak[d], s.stall[d] * (share + line))
    count = _prepare(s, row, d, direction, static, x)
    if most < np.inf or least > -np.inf:
        low, high = _within(s, count, True, least, most, low, high)
    limit = share * s.effort_limit[d]
    if limit < np.inf and low <= high:
        least = -np.inf if static else -limit
        low, high = _within(s, count, False, least, limit, low, high)
    return low, high


@kernel
def bounds(s: Scan, j: int, side: int, x: float) -> tuple[float, float]:
    """Return least and greatest u at an interval's start (side 0) or end (1), where it has x.

    The least one is greater than the greatest where there is none.
    """
    row = s.start[j] if side == 0 else s.end[j]
    low, high, share = -_FAR, _FAR, s.share[j]
    if x > s.top[row] * (1.0 + _TINY):
        return high, low
    for d in range(s.rate.shape[1]):
        most, rate, bend = share * s.acceleration[d], s.rate[row, d], s.curvature[row, d] * x
        if most < np.inf:
            if rate != 0.0:
                ends = (-most - bend) / rate, (most - bend) / rate
                low, high = max(low, min(ends)), min(high, max(ends))
            elif abs(bend) > most:
                return _FAR, -_FAR
        mode, direction = s.mode[j, side, d], s.way[j, d]
        if mode == MOVING and low <= high:
            low, high = _limited(s, row, d, direction, False, x, (low, high), share)
        elif low <= high:
            low, high = _limited(s, row, d, 1.0, True, x, (low, high), share)
            if low <= high:
                low, high = _limited(s, row, d, -1.0, True, x, (low, high), share)
        if not low <= high:
            return _FAR, -_FAR
    return low, high


@kernel
def _near(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """The range of u at one end, no farther from that at the other than this is wide.

    Where the only joint that moves reverses, nothing limits u at that place, but close to it.
    """
    beyond = abs(b[0]) + abs(b[1])
    return max(a[0], b[0] - beyond), min(a[1], b[1] + beyond)


@kernel
def _span(s: Scan, j: int, a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Least and greatest u_a + u_b of an interval; least > greatest where there is none."""
    if a[0] > a[1] or b[0] > b[1]:
        return _FAR, -_FAR
    if s.constant[j]:
        return 2.0 * max(a[0], b[0]), 2.0 * min(a[1], b[1])
    first, second = _near(a, b), _near(b, a)
    return first[0] + second[0], first[1] + second[1]


@kernel
def _reaches(s: Scan, j: int, x: float, a: tuple[float, float], end: float) -> int:
    """Whether x' = end is reached from x: 0 yes, 1 it is too great, -1 too small, 2 no u there."""
    least, most = _span(s, j, a, bounds(s, j, 1, end))
    if least > most + _TINY * (abs(least) + abs(most)):
        return 2
    step = s.step[j]
    need = (end - x) / step
    slack = 1e-10 * (abs(least) + abs(most)) + _TINY * (abs(x) + abs(end)) / step
    if need > most + slack:
        return 1
    return -1 if need < least - slack else 0


@kernel
def _passes(s: Scan, j: int, what: int, x: float, a: tuple[float, float], value: float) -> bool:
    """Whether a value has the property of `_greatest`."""
    if what == _OPEN:
        least, most = bounds(s, j, 0, value)
        return least <= most
    if what == _REACHED:
        return _reaches(s, j, x, a, value) == 0
    least, most = _span(s, j, a, bounds(s, j, 1, value))
    return least <= most


@kernel
def _greatest(
    s: Scan, j: int, what: int, x: float, a: tuple[float, float], guess: float, most: float
) -> float:
    """The greatest value <= most with a property, or -1: levels below a guess, then bisection.

    Properties: `_OPEN`: there is any u at the start of the interval; `_PASSABLE`: at its end,
    beside that in a at its start; `_REACHED`: it is reached from x, whose range of u is a.
    """
    for k in range(_LEVELS + 1):
        good, bad = guess * (1.0 - k / _LEVELS), min(guess * (1.0 - (k - 1) / _LEVELS), most)
        if _passes(s, j, what, x, a, good):
            for _ in range(_HALVINGS if bad > good else 0):
                middle = 0.5 * (good + bad)
                if _passes(s, j, what, x, a, middle):
                    good = middle
                else:
                    bad = middle
            return good
    return -1.0


@kernel
def largest_reachable(s: Scan, j: int, x: float, limit: float) -> float:
    """Return the greatest x' <= limit that is reached from x over interval j, or -1."""
    a = bounds(s, j, 0, x)
    if a[0] > a[1]:
        return -1.0
    limit = _greatest(s, j, _PASSABLE, x, a, limit, limit)
    verdict = -1 if limit < 0.0 else _reaches(s, j, x, a, limit)
    if verdict <= 0:
        return limit if verdict == 0 else -1.0
    step, last, miss = s.step[j], 0.0, 0.0
    guess = min(max(x + 2.0 * step * a[1], 0.0), limit)
    end = guess
    for k in range(40):  # x' = x + step (high + high'(x')), by secants
        most = _span(s, j, a, bounds(s, j, 1, end))[1]
        if most <= -_FAR:
            break
        excess = x + step * most - end
        if abs(excess) <= 1e-15 * (x + limit) and _reaches(s, j, x, a, end) == 0:
            return end
        slope = (excess - miss) / (end - last) if k > 0 and end != last else -1.0
        last, miss = end, excess
        end = min(max(end - excess / min(slope, -0.2), 0.0), limit)
        if end == last:
            if end > 0.0 and _reaches(s, j, x, a, end) == 0:  # at 0 it was only cut off
                return end
            break
    return _greatest(s, j, _REACHED, x, a, guess, limit)  # there is no u at some speeds


@kernel
def _goes_on(s: Scan, j: int, x: float, limit: float) -> bool:
    """Whether the interval can be passed from x without nearly stopping in it.

    Between far points a speed can be so high that only an emergency stop is left, and a lower one
    goes on.
    """
    return largest_reachable(s, j, x, limit) >= min(limit, _HARDEST * x)


@kernel
def _greatest_start(s: Scan, j: int, guess: float, most: float, limit: float) -> float:
    """The greatest x <= most that `_goes_on`, or -1: levels below a guess, then bisection.

    A loop of its own: `_goes_on` calls `_greatest`, and kernels do not call themselves.
    """
    for k in range(_LEVELS + 1):
        good, bad = guess * (1.0 - k / _LEVELS), min(guess * (1.0 - (k - 1) / _LEVELS), most)
        if _goes_on(s, j, good, limit):
            for _ in range(_HALVINGS if bad > good else 0):
                middle = 0.5 * (good + bad)
                if _goes_on(s, j, middle, limit):
                    good = middle
                else:
                    bad = middle
            return good
    return -1.0


@kernel
def largest_controllable(s: Scan, j: int, limit: float) -> float:
    """Return the greatest x from which some x' <= limit is reached over interval j, or -1."""
    limit = _greatest(s, j, _PASSABLE, 0.0, (-_FAR, _FAR), limit, limit)
    if limit < 0.0:
        return -1.0
    end = bounds(s, j, 1, limit)
    step, top, last, miss = s.step[j], s.top[s.start[j]], 0.0, 0.0
    x = min(max(limit - 2.0 * step * end[0], 0.0), top)
    guess = x
    for k in range(40):  # x = limit - step (low(x) + low'), by secants
        least, most = _span(s, j, bounds(s, j, 0, x), end)
        if least > most:
            break
        excess = limit - step * least - x
        if abs(excess) <= 1e-15 * (x + limit):
            return x
        if x == top and excess >= 0.0 and _goes_on(s, j, x, limit):
            return x
        slope = (excess - miss) / (x - last) if k > 0 and x != last else -1.0
        last, miss = x, excess
        x = min(max(x - excess / min(slope, -0.2), 0.0), top)
        guess = max(x, guess)
        if x == last:
            if x > 0.0 and _goes_on(s, j, x, limit):  # at 0 it was only cut off
                return x
            break
    hardest = bounds(s, j, 0, 0.0)[0]
    guess = min(max(guess, limit - 2.0 * step * hardest), top)
    return _greatest_start(s, j, guess, top, limit)  # there is no u at some speeds


@kernel
def fastest(s: Scan, x: np.ndarray, u: np.ndarray) -> int:
    """Write the fastest profile; -1, or the interval that cannot be passed.

    Args:
        x, u: overwritten: (n + 1,) (ds/dt)^2 at each point, (n, 2) d^2s/dt^2 at both ends of each
            interval.
    """
    n = s.step.size
    most = np.zeros(n + 1)
    failed = _back(s, n, most)
    j, again = 0, 0
    while failed < 0 and j < n:
        if s.stop[j]:
            x[j] = 0.0
        x[j + 1] = largest_reachable(s, j, x[j], most[j + 1])
        if x[j + 1] < 0.0 or (x[j + 1] == 0.0 and not s.stop[j + 1]):
            if s.stop[j] or again > n:
                return j
            again += 1  # too fast to go on from here: slower, and back to the stop before
            most[j] = _greatest_start(s, j, x[j] * (1.0 - 1e-9), x[j], most[j + 1])
            if most[j] <= 0.0:
                return j
            failed = _back(s, j, most)
            while not s.stop[j]:
                j -= 1
            continue
        j += 1
    for j in range(n if failed < 0 else 0):
        a, b = bounds(s, j, 0, x[j]), bounds(s, j, 1, x[j + 1])
        a, b = _near(a, b), _near(b, a)
        total = (x[j + 1] - x[j]) / s.step[j]
        first = min(max(0.5 * total, a[0], total - b[1]), a[1], total - b[0])
        u[j, 0] = 0.5 * total if s.constant[j] else first
        u[j, 1] = total - u[j, 0]
    return failed


@kernel
def _back(s: Scan, end: int, most: np.ndarray) -> int:
    """Write the greatest x at each point before `end`, to the stop before it; -1 or where none is.

    Before the last point, all stops are passed.
    """
    for j in range(end - 1, -1, -1):
        if s.stop[j]:
            most[j] = 0.0
            if end < s.step.size:
                return -1
        else:
            most[j] = largest_controllable(s, j, most[j + 1])
            if most[j] < 0.0:
                return j
    return -1


@kernel
def ranges(s: Scan, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    """Write `bounds` low and high (n, 2) at both ends of every interval, by x (n, 2) there."""
    for j in range(x.shape[0]):
        for side in range(2):
            low[j, side], high[j, side] = bounds(s, j, side, x[j, side])


@kernel
def torques(s: Scan, x: np.ndarray, u: np.ndarray, torque: np.ndarray) -> None:
    """Write the motors' torques in the direction of motion, (n, 2, nv) N m, by x and u (n, 2).

    Of a drive at rest the greater end of its interval of standstill.
    """
    for j in range(x.shape[0]):
        for side in range(2):
            row = s.start[j] if side == 0 else s.end[j]
            for d in range(torque.shape[2]):
                direction = s.way[j, d]
                count = _prepare(
                    s, row, d, direction if direction != 0.0 else 1.0, direction == 0.0, x[j, side]
                )
                most = _value(s, count, True, u[j, side])[0]
                if direction == 0.0:
                    count = _prepare(s, row, d, -1.0, True, x[j, side])
                    most = max(most, _value(s, count, True, u[j, side])[0])
                torque[j, side, d] = most / abs(s.gears.ratio[d])


@kernel
def limit_curve(s: Scan, most: float, x: np.ndarray) -> None:
    """Write the greatest (ds/dt)^2 <= most with any u, at the start of each interval."""
    for j in range(x.size):
        top = min(s.top[s.start[j]], most)
        x[j] = _greatest(s, j, _OPEN, 0.0, (-_FAR, _FAR), top, top)
