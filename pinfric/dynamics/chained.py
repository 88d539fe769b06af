"""Kernels that call kernels of other files.

numba's cache on disk notices edits of a kernel's own file only. Here the callees' source becomes
part of the name under which the kernel is cached, so an edit there compiles it anew.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterable
from types import ModuleType
from typing import Any

from pinfric.model.compiled import kernel


def kernel_calling(
    *modules: ModuleType, compiled: Callable[..., Callable[..., Any]] = kernel
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the decorator `compiled.kernel` for functions that call kernels of these modules.

    Args:
        modules: whose kernels are called; those that they call in turn are found by themselves.
        compiled: that decorator, or `compiled.parallel_kernel`.
    """
    source = "".join(inspect.getsource(module) for module in _reached(modules))
    digest = hashlib.sha256(source.encode()).hexdigest()[:12]

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        function.__qualname__ = f"{function.__qualname__}_{digest}"
        return compiled(function)

    return decorate


def _reached(modules: Iterable[ModuleType]) -> list[ModuleType]:
    """Modules, and those of this package that they name to call their kernels, each once."""
    found = list(modules)
    for module in found:  # grows while it is walked
        for named in vars(module).values():
            if isinstance(named, ModuleType) and named.__name__.startswith("pinfric."):
                found += [named] if named not in found else []
    return found
