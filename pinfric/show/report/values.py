"""Numbers in reports, and values in scripts of pages."""

from __future__ import annotations

import json
import math
from typing import Any

from pinfric.model.described import in_json

#: Margins below are of something infinite, or of a limit of nothing.
_BEYOND = -1e6


def digits(x: float, zero: float = 0.0) -> str:
    """Return x with three significant digits, a whole number below 1e5 in full; "n/a" for NaN.

    There is no exponent from 0.001 to below 1e5: 0.00123, 12.3, 12346, 1.23e5.

    Args:
        x: the number.
        zero: values up to this print as 0; see `rounding`.
    """
    if not math.isfinite(x):
        return "n/a"
    if x == 0.0 or abs(x) <= zero:
        return "0"
    size = math.floor(math.log10(abs(float(f"{x:.2e}"))))  # after rounding: 9.996 is 10.0
    if -3 <= size <= 4:
        return f"{x:.{max(2 - size, 0)}f}"
    return power_of_ten(x, 2)


def power_of_ten(x: float, decimals: int) -> str:
    """Return 3.7e-5, not 3.7e-05."""
    mantissa, exponent = f"{x:.{decimals}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def signed(x: float, zero: float = 0.0) -> str:
    """Return `digits` of x with its sign, also +."""
    return f"{'+' if x > 0 else '-' if x < 0 else ''}{digits(abs(x), zero)}"


def percentage(x: float) -> str:
    """Return a share or a margin in percent; a miss of many times the limit in words.

    One decimal near 0, where a margin fails, and near 10 %, where it is tight.
    """
    if x <= _BEYOND:
        return "beyond any limit"
    if not math.isfinite(x):
        return "n/a"
    if x <= -10:
        return "more than 10 times the limit"
    near = abs(x) < 0.005 or abs(x - 0.1) < 0.005
    text = f"{100 * x:.{1 if near and x else 0}f} %"
    return text if text != "-0.0 %" else f"{min(100 * x, -0.01):.1g} %"  # a miss, not a fit


def percent(x: float) -> str:
    """Return a share in percent, with digits below one."""
    return f"{digits(100 * x, 1e-6)} %" if math.isfinite(x) else "n/a"


def rough(x: float) -> str:
    """Return x with two significant digits, for uncertainties."""
    return f"{float(f'{x:.1e}'):g}"


def span(least: float, worst: float, zero: float = 0.0) -> str:
    """Return "least–worst", or one number if both print alike."""
    low, high = digits(least, zero), digits(worst, zero)
    return low if low == high else f"{low}–{high}"  # noqa: RUF001 - a range


def json_for_script(content: Any) -> str:
    """Return a value as JSON that is safe in a script element, whatever names it holds."""
    text = json.dumps(in_json(content), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
