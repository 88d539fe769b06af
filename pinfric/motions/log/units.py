"""Units of a log: recognised where the evidence is clear, else the person is asked.

Arguments: columns (nj,) the joints; t (T,) s; position (T, nj) rad or m; lines (T,) in the file;
stated, a unit that somebody said; said, to which notes and problems are added.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pinfric.dynamics.inverse.result import runs
from pinfric.model.arrays import FloatArray
from pinfric.motions.joint_columns import LIMIT_TOLERANCE, JointColumn, listing
from pinfric.motions.log.frame import FEWEST, Remarks
from pinfric.motions.log.reading import ANGLE_UNITS, TIME_UNITS
from pinfric.motions.log.rows import GAP_FACTOR

#: Hz; robots log at no less and no more than these.
_SLOWEST, _FASTEST = 20.0, 20_000.0
#: Hz; slower logs exist where a clock counts ms, us or ns.
_SLOWEST_CLOCK = 2.0
#: rad: no joint turns twice round one way and twice the other, but for those without limits.
_TWO_TURNS = 4.0 * np.pi
#: rad: an angle below this says nothing about its unit.
_SMALL = 0.02
#: Times its velocity limit, no joint moves; nor at this speed (rad/s or m/s) without a limit.
_TOO_FAST, _FASTEST_JOINT = 3.0, 30.0
#: rad/s or m/s: no recording has no joint faster than this.
_CREEP = 0.01
#: Share of its velocity limit that some joint of a recording exceeds.
_CRAWL = 0.02
#: Rows for which a frozen encoder stands still; 1/s: no joint stops in less than 1/15 s from its
#: velocity limit, nor in a like time from less.
_FROZEN, _STOPPING = 10, 15.0
#: Times the way that one row of a hundred exceeds, a jump is.
_JUMP = 5.0
#: Parts over which ways and integrals of velocities are compared: how many, fewest, s of each at
#: most, fewest rows of each. A lag or a low pass of velocities hardly shows over a second.
_PARTS, _FEWEST_PARTS, _LONGEST_PART, _FEWEST_ROWS = 40, 10, 1.0, 5
#: What correlates less is no multiple of it, but another quantity, or noise.
_CORRELATION = 0.95
#: A factor between velocities and positions within this of 1 may be one of calibration.
_CALIBRATED = 0.02
#: s since 1970, of the years 2001 to 2096: what a clock shows.
_EPOCH = (1e9, 4e9)


def time_factor(
    name: str,
    t: FloatArray,
    start: float,
    stated: str | None,
    columns: Sequence[JointColumn],
    position: FloatArray,
    said: Remarks,
) -> float:
    """Return s per unit of a time column, whose first number is `start`.

    At 20 Hz or more in s they are s. Else they may be ms, us or ns, if that makes 2 Hz to 20 kHz,
    and the joints' speeds decide: no joint is so fast, no recording so slow.
    """
    if stated is not None:
        return TIME_UNITS[stated]
    with np.errstate(over="ignore"):  # times that cannot be meant are refused elsewhere
        steps = np.diff(t[np.isfinite(t)])
    steps = steps[steps > 0.0]
    if steps.size < FEWEST - 1:
        return 1.0
    step = float(np.median(steps))
    if 1.0 / step >= _SLOWEST or is_clock(start):
        return 1.0
    rates = {unit: 1.0 / (step * factor) for unit, factor in TIME_UNITS.items() if unit != "s"}
    fits = [unit for unit, rate in rates.items() if _SLOWEST_CLOCK <= rate <= _FASTEST]
    clocks = [unit for unit in fits if is_clock(start * TIME_UNITS[unit])]
    ways = _largest_ways(columns, position)
    possible = [unit for unit in fits if _possible(ways, rates[unit])]
    creeps = 0.0 < ways[1] / step < _CREEP
    chosen = clocks or (possible if creeps and step > 1.0 else [])
    if len(chosen) == 1:
        said.notes.append(
            f"column {name} is in {chosen[0]}: steps of {step:.6g} are {rates[chosen[0]]:.6g} Hz"
        )
        return TIME_UNITS[chosen[0]]
    counts = creeps and bool((t == np.rint(t)).all())
    if not possible or (step <= 1.0 and not counts):
        return 1.0
    choice = ", ".join(f"{unit} ({rates[unit]:.6g} Hz)" for unit in possible)
    options = ", ".join(f"--time-unit {unit}" for unit in possible)
    said.problems.append(
        f"column {name}: steps of {step:.6g} may be {choice} or s ({1.0 / step:.3g} "
        f"Hz); give {options} or --time-unit s"
    )
    return 1.0


def _largest_ways(columns: Sequence[JointColumn], position: FloatArray) -> tuple[float, float]:
    """Largest step between rows over a joint's velocity limit (s), and largest step."""
    if len(position) < 2:
        return 0.0, 0.0
    largest = np.zeros(len(columns))
    for i, q in enumerate(position.T):  # one after another: a long log fills much of the memory
        steps = unwrapped_steps(q)
        largest[i] = np.max(steps, where=np.isfinite(steps), initial=0.0)
    limits = np.array([column.velocity_limit for column in columns])
    return float((largest / limits).max(initial=0.0)), float(largest.max(initial=0.0))


def _possible(ways: tuple[float, float], rate: float) -> bool:
    """Whether joints can be so fast at this rate of rows, Hz."""
    of_limits, speed = (rate * way for way in ways)
    return of_limits <= _TOO_FAST if of_limits > 0.0 else speed <= _FASTEST_JOINT


def is_clock(start: float) -> bool:
    """Whether a time in s is that of a clock, since 1970."""
    return _EPOCH[0] <= start <= _EPOCH[1]


def angle_unit(
    columns: Sequence[JointColumn],
    raw: Iterable[FloatArray],
    known: Sequence[str | None],
    stated: str | None,
    said: Remarks,
) -> list[float]:
    """Return rad per unit of each joint's positions, 1 for joints that slide.

    Degrees are clear where a joint is far beyond its limits (and beyond two turns) as radians and
    all joints are within theirs as degrees.

    Args:
        raw: (nj,) of (T,) as in the file; NaN is passed over.
        known: (nj,) units by names or a mapping. stated: the unit of all others.
    """
    turning = [c.unit == "rad" for c in columns]
    factors = [
        ANGLE_UNITS[k or stated or "rad"] if turns else 1.0
        for k, turns in zip(known, turning, strict=True)
    ]
    open_ = [i for i, k in enumerate(known) if turning[i] and k is None and stated is None]
    if not open_:
        return factors
    size = [float(np.max(np.abs(q), where=np.isfinite(q), initial=0.0)) for q in raw]
    beyond = [i for i in open_ if size[i] > max(_TWO_TURNS, _reach(columns[i]) + LIMIT_TOLERANCE)]
    degree = ANGLE_UNITS["deg"]
    if not beyond or any(size[i] * degree > _reach(columns[i]) + _SMALL for i in open_):
        return factors  # what is out of its limits either way is an error of its own
    names = listing(f"{columns[i].name} {size[i]:.4g}" for i in beyond)
    unclear = [i for i in open_ if _SMALL < size[i] <= 2.0 * np.pi]
    if not unclear:
        said.notes.append(f"angles are in degrees (as radians beyond the limits: {names})")
        return [degree if i in open_ else factor for i, factor in enumerate(factors)]
    others = listing(f"{columns[i].name} {size[i]:.4g}" for i in unclear)
    said.problems.append(
        f"angles look like degrees ({names}), but may be radians ({others}): give --unit deg or "
        "--unit rad for all, or `unit` by joint in a file given by --columns"
    )
    return factors


def _reach(column: JointColumn) -> float:
    """The largest angle within a joint's limits."""
    return max(abs(column.lower), abs(column.upper))


def unwrapped_steps(q: FloatArray) -> FloatArray:
    """Return a joint's steps from row to row, (T - 1,); an angle may wrap."""
    steps = np.abs(np.diff(q))
    return np.minimum(steps, np.abs(steps - 2.0 * np.pi))


def fast_angles(
    columns: Sequence[JointColumn],
    t: FloatArray,
    position: FloatArray,
    known: Sequence[str | None],
    stated: str | None,
) -> list[str]:
    """Return one line where joints whose unit nobody said would be far too fast in rad/s.

    Small ways in degrees lie within the limits of radians; only their speeds tell.
    """
    if stated is not None:
        return []
    fast = [
        f"{column.name} {speed:.3g} rad/s, limit {column.velocity_limit:.3g}"
        for column, speed, unit in zip(columns, _speeds(t, position), known, strict=False)
        if column.unit == "rad" and unit is None and speed > _TOO_FAST * column.velocity_limit
    ]
    if not fast:
        return []
    return [
        f"too fast for a joint ({listing(fast)}): are the angles in degrees (--unit deg), the "
        "times in another unit (--time-unit), or are these other columns (--columns FILE)? "
        "--unit rad takes them as they are"
    ]


def slow_angles(
    columns: Sequence[JointColumn], t: FloatArray, position: FloatArray, factors: Sequence[float]
) -> list[str]:
    """Return one line where a header says degrees, with which all joints hardly move.

    `factors`: (nj,) rad per unit, by the header.
    """
    degree, shares = ANGLE_UNITS["deg"], [0.0]
    joints = zip(columns, _speeds(t, position), position.T, factors, strict=False)
    for column, speed, q, factor in joints:
        if factor == degree:
            if np.abs(q).max() / degree > min(_reach(column) + LIMIT_TOLERANCE, 2.0 * np.pi):
                return []  # as radians beyond its limits
            shares.append(speed / min(column.velocity_limit, _FASTEST_JOINT))
    most = max(shares)
    if not _CRAWL < most / degree < _TOO_FAST:
        return []
    return [
        f"the header says degrees, but then no joint exceeds {100 * most:.2g} % of its velocity "
        f"limit or leaves the range of radians; as radians {100 * most / degree:.3g} %: give "
        "--unit deg or --unit rad"
    ]


def impossible_motions(
    columns: Sequence[JointColumn], t: FloatArray, position: FloatArray, lines: Sequence[int]
) -> list[str]:
    """Return a line for each joint that stands still or jumps as no joint can.

    `position` is unwrapped. A frozen encoder stops from full motion within a row, or leaps
    afterwards to where the joint is.
    A jump is too fast for the time since the joint last moved, and far longer than other steps.
    """
    steps, problems = np.diff(t), []
    if t.size < FEWEST or not (steps > 0.0).all():
        return []
    longest = np.maximum(steps, np.median(steps))
    for column, q in zip(columns, position.T, strict=True):
        ways = np.abs(np.diff(q))
        speed = ways / longest
        limit = column.velocity_limit if np.isfinite(column.velocity_limit) else _FASTEST_JOINT
        for first, last in runs(speed == 0.0):
            if last - first + 1 < _FROZEN:
                continue
            before, after = speed[max(first - 3, 0) : first], speed[last + 1 : last + 2]
            leaps = after.max(initial=0.0) > _TOO_FAST * limit
            stops = before.size == 3 and before.min() > _STOPPING * limit * longest[first]
            if leaps or stops:
                how = (
                    f"and then jumps by {after[0] * longest[last + 1]:.3g} {column.unit} in line "
                    f"{lines[last + 2]}"
                    if leaps
                    else f"and stopped from {before[-1]:.3g} {column.unit}/s within a row, line "
                    f"{lines[first + 1]}"
                )
                problems.append(
                    f"joint {column.name}: its angle stands still from {t[first]:.6g} to "
                    f"{t[last + 1]:.6g} s {how}, which no joint can: its encoder was frozen; leave "
                    "that time out, and split the log there"
                )
                break
        else:
            moved = np.flatnonzero(ways)
            since = np.diff(t[moved + 1], prepend=t[0] - longest[0])
            far = ways[moved] > _TOO_FAST * limit * np.maximum(since, longest[moved])
            far &= far.any() and ways[moved] > _JUMP * np.quantile(ways[moved], 0.99)
            for k in moved[far][:1].tolist():
                problems.append(
                    f"joint {column.name}: it jumps by {ways[k]:.3g} {column.unit} in line "
                    f"{lines[k + 1]}, at {t[k + 1]:.6g} s, which no joint can: rows are missing "
                    "there, or its encoder slipped; leave out what is wrong, or split the log there"
                )
    return problems


def wrong_velocities(
    columns: Sequence[JointColumn], t: FloatArray, position: FloatArray, velocity: FloatArray
) -> list[str]:
    """Return one line where logged velocities are a multiple of the slopes of the positions.

        int v dt = k (q(end) - q(start)) + offset    over parts of the log

    Both sides have errors, so k is between the regressions of either on the other, and its interval
    holds both with theirs, of 95 %. A clock at half its speed makes k = 2. `position` is
    unwrapped; `velocity`: (T, nj) as logged, rad/s or m/s; NaN where there is none.

    Source: Frisch, Statistical Confluence Analysis (1934): bounds with errors in both variables.
    """
    from scipy.special import stdtrit

    steps, multiples = np.diff(t), []
    if t.size < _FEWEST_PARTS * _FEWEST_ROWS or not (steps > 0.0).all():
        return []
    step = float(np.median(steps))
    rows = max(int(min(_LONGEST_PART, (t[-1] - t[0]) / _PARTS) / step), _FEWEST_ROWS)
    edges = np.arange(0, t.size, rows)
    first, steps = edges[:-1], steps[: edges[-1]]
    whole = np.maximum.reduceat(steps, first) <= GAP_FACTOR * step
    if whole.sum() < _FEWEST_PARTS:
        return []
    for column, q, v in zip(columns, position.T, velocity.T, strict=True):
        means = 0.5 * (v[1:] + v[:-1])[: steps.size]
        x, y = np.diff(q[edges])[whole], np.add.reduceat(means * steps, first)[whole]
        x, y = x - x.mean(), y - y.mean()
        xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
        if not xy**2 > _CORRELATION**2 * xx * yy:  # nor where there are no velocities
            continue
        spread = np.sqrt(max(xx * yy / xy**2 - 1.0, 0.0) / (x.size - 2))
        spread *= float(stdtrit(x.size - 2, 0.975))
        forward, reverse = xy / xx, yy / xy
        low, high = sorted((forward * (1.0 - spread), reverse * (1.0 + spread)))
        k = 0.5 * (forward + reverse)
        if abs(k - 1.0) > max(_CALIBRATED, 0.5 * (high - low)):
            multiples.append(f"{column.name} {k:.4g} [{low:.4g}, {high:.4g}]")
    if not multiples:
        return []
    return [
        "logged velocities are a multiple of the slopes of the positions (with its 95 % interval): "
        f"{listing(multiples)}. The same one at all joints is the clock's: correct the time "
        "stamps; else it is a unit, sign or scale: correct it in a file given by --columns, "
        "which may also name position and effort of a joint only, if its velocities are known to "
        "be wrong"
    ]


def _speeds(t: FloatArray, position: FloatArray) -> list[float]:
    """Speed of each joint that one row of a hundred exceeds; () if times say nothing."""
    steps = np.diff(t)
    if t.size < FEWEST or not (steps > 0.0).all():
        return []
    mean = np.mean(steps)  # rows written at once say nothing about speeds
    speeds = []
    for q in position.T:  # one joint after another: a long log fills much of the memory
        speed = unwrapped_steps(q)
        at = np.flatnonzero(speed)  # a source may hold its positions for some rows
        since = np.diff(t[at + 1], prepend=t[0])
        speed[at] /= np.maximum(since, mean)
        speeds.append(float(np.quantile(speed, 0.99)))
    return speeds
