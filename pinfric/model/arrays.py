"""Checks of arguments: arrays of real numbers, flags, counts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import PinfricError, StateError

#: Arrays of real numbers, of whole ones, of truths.
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_FLOAT = np.dtype(float)
#: Content of NumPy's kinds of arrays that are not real numbers; all other kinds hold objects.
_OTHERS = {
    "b": "true and false",
    "c": "complex numbers",
    "U": "text",
    "S": "text",
    "M": "dates",
    "m": "durations",
}


def real_numbers(name: str, value: Any, error: type[PinfricError] = StateError) -> np.ndarray:
    """Return a C-ordered array of float64 (the given one, if it is one), or raise `error`.

    NumPy alone would drop imaginary parts, and read True as 1 and "2" as 2.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.flags.c_contiguous:
        return value
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as problem:
        text = " ".join(str(problem).split())
        raise error(f"{name}: is not an array of numbers: {text}") from None
    if array.dtype.kind not in "fiu":
        what = _OTHERS.get(array.dtype.kind, "objects")
        raise error(f"{name}: is not an array of numbers: it holds {what}; give real numbers")
    return np.asarray(array, dtype=float, order="C")


def flags(name: str, value: Any) -> np.ndarray:
    """Return an array of bool from bools or numbers 0 and 1; raise StateError for anything else."""
    array = value if isinstance(value, np.ndarray) and value.dtype == bool else np.asarray(value)
    if array.dtype != bool:
        array = real_numbers(name, value)
        if not np.isin(array, (0.0, 1.0)).all():
            raise StateError(f"{name}: holds other numbers than 0 and 1; give true or false")
    return np.asarray(array, dtype=bool)


def whole_number(name: str, value: Any, least: int = 1) -> int:
    """Return a whole number, Python's or NumPy's, of at least `least`.

    Raises:
        StateError: anything else, also 2.0 and True.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < least:
        raise StateError(f"{name} = {value!r}; should be a whole number of at least {least}")
    return int(value)
