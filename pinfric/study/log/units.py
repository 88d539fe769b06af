"""Units of a log: recognised where the evidence is clear, else the choice is put to the person."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pinfric.study.joint_columns import LIMIT_TOLERANCE, JointColumn, listing
from pinfric.study.log.reading import ANGLE_UNITS, TIME_UNITS

FloatArray = NDArray[np.float64]

#: Hz; robots log at no less and no more than these.
_SLOWEST, _FASTEST = 20.0, 20_000.0
#: Fewer samples than this are a table that somebody wrote, in seconds.
_FEWEST = 20
#: rad: no joint turns twice round one way and twice the other, but for those without limits.
_TWO_TURNS = 4.0 * np.pi
#: rad: an angle below this says nothing about its unit.
_SMALL = 0.02
#: Times its velocity limit, no joint moves; nor at this speed (rad/s or m/s) without a limit.
_TOO_FAST, _FASTEST_JOINT = 3.0, 30.0
#: rad/s or m/s: no recording has no joint faster than this.
_CREEP = 0.01
#: s since 1970, of the years 2001 to 2096: what a clock shows.
_EPOCH = (1e9, 4e9)


def time_factor(
    name: str,
    t: FloatArray,
    start: float,
    given: str | None,
    speeds: tuple[float, float],
    problems: list[str],
    said: list[str],
) -> float:
    """Return s per unit of a time column.

    Steps tell: only one of s, ms, us, ns makes 20 Hz to 20 kHz of them. Slower files exist too, in
    seconds; there the joints' speeds must tell.

    Args:
        name: the column's.
        t: (T,) what stands in it, `start` perhaps subtracted.
        start: its first number.
        given: the unit, where somebody said it.
        speeds: the largest way over velocity limit of the joints, and the largest way, between
            two rows (s; rad or m).
        problems, said: lines are appended here.
    """
    if given is not None:
        return TIME_UNITS[given]
    with np.errstate(over="ignore"):  # times that cannot be meant are refused elsewhere
        steps = np.diff(t[np.isfinite(t)])
    steps = steps[steps > 0.0]
    if steps.size < _FEWEST - 1:
        return 1.0
    step = float(np.median(steps))
    fits = [u for u, factor in TIME_UNITS.items() if _SLOWEST <= 1.0 / (step * factor) <= _FASTEST]
    if fits in ([], ["s"]):
        return 1.0
    unit = fits[0]
    clock = is_clock(start * TIME_UNITS[unit])
    rate = 1.0 / (step * TIME_UNITS[unit])
    of_limits, speed = (x / (step * TIME_UNITS[unit]) for x in speeds)
    possible = of_limits <= _TOO_FAST if of_limits > 0.0 else speed <= _FASTEST_JOINT
    slow = 0.0 < speed * TIME_UNITS[unit] < _CREEP
    if clock or (possible and slow and step > 1.0):
        said.append(f"column {name} is in {unit}: steps of {step:.6g} are {rate:.6g} Hz")
        return TIME_UNITS[unit]
    if step <= 1.0 or not possible:
        return 1.0
    problems.append(
        f"column {name}: steps of {step:.6g} may be {unit} ({rate:.6g} Hz) or s ({1.0 / step:.3g} "
        f"Hz); say which: --time-unit {unit} or --time-unit s"
    )
    return 1.0


def is_clock(start: float) -> bool:
    """Whether a time in s is one that a clock shows, since 1970."""
    return _EPOCH[0] <= start <= _EPOCH[1]


def angle_unit(
    columns: Sequence[JointColumn],
    position: FloatArray,
    known: Sequence[str | None],
    given: str | None,
    problems: list[str],
    said: list[str],
) -> list[float]:
    """Return rad per unit of each joint's positions, 1 for joints that slide.

    Degrees are clear where a joint is far beyond its limits (and beyond two turns) as radians and
    all joints are within theirs as degrees.

    Args:
        columns: (nj,) the joints.
        position: (T, nj) what stands in the file; NaN is passed over.
        known: (nj,) units that names or a mapping say.
        given: the unit of all others, where somebody said it.
        problems, said: lines are appended here.
    """
    turning = [c.unit == "rad" for c in columns]
    factors = [ANGLE_UNITS[k or given or "rad"] if turns else 1.0
               for k, turns in zip(known, turning, strict=True)]  # fmt: skip
    open_ = [i for i, k in enumerate(known) if turning[i] and k is None and given is None]
    if not open_ or position.shape[0] == 0:
        return factors
    size = np.nanmax(np.abs(np.where(np.isfinite(position), position, 0.0)), axis=0)
    beyond = [i for i in open_ if size[i] > max(_TWO_TURNS, _reach(columns[i]) + LIMIT_TOLERANCE)]
    degree = ANGLE_UNITS["deg"]
    if not beyond or any(size[i] * degree > _reach(columns[i]) + _SMALL for i in open_):
        return factors  # what is out of its limits either way is an error of its own
    names = listing(f"{columns[i].name} {size[i]:.4g}" for i in beyond)
    unclear = [i for i in open_ if _SMALL < size[i] <= 2.0 * np.pi]
    if not unclear:
        said.append(f"angles are in degrees (as radians beyond the limits: {names})")
        return [degree if i in open_ else factor for i, factor in enumerate(factors)]
    others = listing(f"{columns[i].name} {size[i]:.4g}" for i in unclear)
    problems.append(
        f"angles look like degrees ({names}), but may be radians ({others}): say which: --unit deg "
        "for all, or `unit` by joint in a file given by --columns"
    )
    return factors


def _reach(column: JointColumn) -> float:
    """The largest angle a joint's limits allow; infinite without limits."""
    return max(abs(column.lower), abs(column.upper))
