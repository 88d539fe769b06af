"""Records of arrays that are described once: a field's default is its shape."""

from __future__ import annotations

from typing import Any

import numpy as np


def array(shape: str, kind: type = float, fill: float | None = 0.0) -> Any:
    """Return the default of a field: sizes by name or number, type, first value or None: any."""
    return shape.split(), kind, fill


def make(fields: Any, **sizes: int) -> Any:
    """Return a NamedTuple of arrays, of which `array` describes every field."""
    made = {}
    for name, (shape, kind, fill) in fields._field_defaults.items():
        made[name] = np.empty([sizes[n] if n in sizes else int(n) for n in shape], kind)
        if fill is not None:
            made[name].fill(fill)
    return fields(**made)
