"""Kernels as plain Python, until compiling them saves time.

Compiling the kernels of forward dynamics takes some 20 s of processor time; simulating an arm for a
second with them interpreted takes 1 s. So small problems are interpreted until this has taken about
as long as compiling, summed over this run and earlier ones. That costs at most twice as much as the
better choice (the ski rental problem; Karlin et al. 1988, Competitive snoopy caching).
"""

from __future__ import annotations

import atexit
import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

#: How long kernels are interpreted before they are compiled (s).
PATIENCE = 20.0
#: Arguments with up to this many numbers in all are small; larger ones are a batch of samples.
_FEW = 2000


class _Clock:
    """The time (s) spent interpreting: in this process, and earlier (from a file in the cache).

    Attributes:
        here: in this process.
        hurried: while above 0, kernels are compiled at once (`compiled.compiling`).
    """

    def __init__(self) -> None:
        self.here, self._before, self._file = 0.0, -1.0, Path()
        self.hurried = 0

    def keep_in(self, folder: str) -> None:
        self._file = Path(folder) / "pinfric.interpreted"

    def is_over(self) -> bool:
        """Whether the time for interpreting is used up."""
        if self.hurried:
            return True
        if self._before < 0.0:
            self._before = self._read()
        return self.here + self._before >= PATIENCE

    def add(self, seconds: float) -> None:
        if self.here == 0.0:
            atexit.register(self._write)
        self.here += seconds

    def _read(self) -> float:
        try:
            return max(0.0, float(self._file.read_text()))
        except (OSError, ValueError):  # not written yet, or incomplete
            return 0.0

    def _write(self) -> None:
        if not self._file.name:
            return
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            beside = self._file.with_name(f"{self._file.name}.{os.getpid()}")
            beside.write_text(f"{self._read() + self.here:.3f}\n")
            beside.replace(self._file)


CLOCK = _Clock()
#: Each kernel as a Python function; each module's names, such functions in place of kernels.
_PLAIN: dict[Any, FunctionType] = {}
_NAMES: dict[str, dict[str, Any]] = {}


def is_small(arguments: tuple[Any, ...]) -> bool:
    """Whether a kernel's arguments are small: no batch, and no types that only numba reads."""
    total = 0
    for argument in arguments:
        if isinstance(argument, np.ndarray):
            total += argument.size
        elif not isinstance(argument, tuple | float | int | np.generic):
            return False
    return total <= _FEW


def interpreted(
    kernel: Callable[..., Any], otherwise: Callable[..., Callable[..., Any]]
) -> Callable[..., Any]:
    """Return a kernel's function for one call, its callees interpreted, too.

    Args:
        kernel: made by numba.
        otherwise: compiles the kernel for arguments and returns the function to call; used if
            Python's numbers raise on overflow or division by zero, unlike NumPy's. The arrays are
            restored before, as the kernel may have written to them.
    """

    def run(*arguments: Any) -> Any:
        start = time.process_time()
        before = [(array, array.copy()) for array in arrays_in(arguments) if array.flags.writeable]
        try:
            with np.errstate(all="ignore"):
                return plain(kernel)(*arguments)
        except (ZeroDivisionError, OverflowError):
            for array, content in before:
                array[...] = content
            return otherwise(*arguments)(*arguments)
        finally:
            CLOCK.add(time.process_time() - start)

    return run


def arrays_in(arguments: tuple[Any, ...]) -> Iterator[np.ndarray]:
    """Yield every array among a kernel's arguments, also in tuples."""
    for argument in arguments:
        if isinstance(argument, np.ndarray):
            yield argument
        elif isinstance(argument, tuple):
            yield from arrays_in(argument)


def plain(kernel: Any) -> FunctionType:
    """Return the Python function of a kernel, its callees as Python functions, too."""
    if kernel not in _PLAIN:
        function = kernel.py_func
        _PLAIN[kernel] = FunctionType(
            function.__code__,
            _plain_names(function.__globals__),
            function.__name__,
            function.__defaults__,
            function.__closure__,
        )
    return _PLAIN[kernel]


def _plain_names(names: dict[str, Any]) -> dict[str, Any]:
    """Return a module's names with functions for kernels, found by identity, not by name."""
    module = names["__name__"]
    if module not in _NAMES:
        _NAMES[module] = here = dict(names)
        for name, value in names.items():
            if isinstance(value, Dispatcher):
                here[name] = plain(value)
    return _NAMES[module]
