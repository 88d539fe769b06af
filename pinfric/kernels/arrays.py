"""NamedTuples of arrays; the default of each field states the array's shape."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def array(shape: str, kind: type = float, fill: float | None = 0.0) -> Any:
    """Return the default of a field: sizes by name or number, type, first value (None: any)."""
    return shape.split(), kind, fill


def make(fields: Any, **sizes: int) -> Any:
    """Return a NamedTuple of arrays as its fields' defaults (`array`) describe them."""
    arrays = {}
    for name, (shape, kind, fill) in fields._field_defaults.items():
        arrays[name] = np.empty([sizes[n] if n in sizes else int(n) for n in shape], kind)
        if fill is not None:
            arrays[name].fill(fill)
    return fields(**arrays)


def rows_of(arrays: Sequence[np.ndarray]) -> np.ndarray | None:
    """Return a view whose rows are these arrays if they are equally spaced in memory, else None."""
    places = np.diff([x.__array_interface__["data"][0] for x in arrays])
    if not (places == places[:1]).all() or not (places > 0).all():
        return None
    first = arrays[0]
    strides = (int(places[0]) if places.size else first.nbytes, *first.strides)
    return np.lib.stride_tricks.as_strided(first, (len(arrays), *first.shape), strides)
