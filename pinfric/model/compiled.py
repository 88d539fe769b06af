"""The one decorator of every kernel that runs once per sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a per-sample kernel with numba, cached on disk where a folder is writable.

    Never `fastmath`: it makes `isnan` false and reorders sums, and a norm at zero load must stay 0.
    """
    return _compiled(function, {"nogil": True, "error_model": "numpy"})


def parallel_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel as `kernel` does, its `prange` loops for several threads."""
    return _compiled(function, {"nogil": True, "error_model": "numpy", "parallel": True})


def _compiled(function: Callable[..., Any], options: dict[str, Any]) -> Callable[..., Any]:
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder to cache in (a read-only installation)
        return numba.njit(**options)(function)
