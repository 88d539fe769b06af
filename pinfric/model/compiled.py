"""The one decorator of every kernel that runs once per sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a per-sample kernel with numba, cached on disk where a folder is writable.

    Never `fastmath`: it makes `isnan` false and reorders sums, and a norm at zero load must stay 0.
    """
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # numba found no folder to cache in (a read-only installation)
        return numba.njit(nogil=True, error_model="numpy")(function)
