"""Kernels that call kernels of other files.

numba's cache on disk notices edits of a kernel's own file only. Here the callees' source becomes
part of the name under which the kernel is cached, so an edit there compiles it anew.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from types import ModuleType
from typing import Any

from pinfric.model.compiled import kernel


def kernel_calling(
    *modules: ModuleType, compiled: Callable[..., Callable[..., Any]] = kernel
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the decorator `compiled.kernel` for functions that call kernels of these modules.

    Args:
        modules: every module whose kernels are reached, directly or through others.
        compiled: that decorator, or `compiled.parallel_kernel`.
    """
    source = "".join(inspect.getsource(module) for module in modules)
    digest = hashlib.sha256(source.encode()).hexdigest()[:12]

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        function.__qualname__ = f"{function.__qualname__}_{digest}"
        return compiled(function)

    return decorate
