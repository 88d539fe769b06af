"""Progress while kernels compile: how many are done and to go, and about how long it takes.

Numba tells neither. The work of a call is all uncached kernels that its root reaches; the time of
each is taken in proportion to the length of its byte code.
"""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from numba.core import event
from numba.core.dispatcher import Dispatcher

from pinfric.kernels import NOTICES
from pinfric.kernels.late import is_late

#: Seconds between two lines at most; on a terminal one line is drawn again after each `_TICK`.
PERIOD, _TICK = 10.0, 1.0
#: To the line's begin, and clear it.
_CLEAR = "\r\x1b[K"
#: With fewer kernels to go no time is said: one that is half compiled would be most of it.
_FEW = 5


class CompileProgress(event.Listener):
    """Prints lines on stderr while numba compiles, from a thread, as a kernel may take long.

    While a bar or a spinner replaces stderr, lines go above it.
    """

    def __init__(self) -> None:
        self._left: dict[Callable[..., Any], int] = {}  # to be compiled -> length of its code
        self._count, self._done, self._seconds = 0, 0, 0.0
        self._depth, self._began, self._watching = 0, 0.0, False
        self._drawn, self._drawing = False, threading.Lock()
        event.register("numba:compile", self)

    def begin(self, function: Callable[..., Any], kept: str) -> None:
        """Note that a kernel is not in the cache; `kept`, printed once, says where it will be."""
        if not self._watching:
            self._watching = True
            _say(f"compiling kernels for this machine; {kept}")
            threading.Thread(target=self._watch, daemon=True).start()
        if function not in self._left:
            self._left |= {each: len(each.__code__.co_code) for each in _reached(function)}

    def end(self, function: Callable[..., Any], compiled: bool) -> None:
        """Note that a kernel was compiled, or found in the cache."""
        length = self._left.pop(function, 0)
        if compiled:
            self._count, self._done = self._count + 1, self._done + length

    def on_start(self, _: Any) -> None:
        """Numba begins to compile a function: a root or a callee."""
        if self._depth == 0:
            self._began = time.monotonic()
            NOTICES["busy"] = True
        self._depth += 1

    def on_end(self, _: Any) -> None:
        """Numba has compiled it, or failed."""
        self._depth -= 1
        if self._depth == 0:
            NOTICES["busy"] = False
            self._seconds += time.monotonic() - self._began
            self._left.clear()
            with self._drawing:
                if self._drawn:
                    print(end=_CLEAR, file=sys.stderr, flush=True)
                self._drawn = False

    def line(self) -> str:
        """Return the progress as one line."""
        seconds, remaining = self._seconds + time.monotonic() - self._began, dict(self._left)
        done = f"{self._count} done in {seconds:.0f} s"
        said = f"compiling kernels: {done}, {len(remaining)} to go in this step"
        if len(remaining) < _FEW or not self._done:
            return said
        return f"{said}, about {seconds * sum(remaining.values()) / self._done:.0f} s"

    def _watch(self) -> None:
        last = time.monotonic()
        while True:
            time.sleep(_TICK)
            stream, width = sys.stderr, shutil.get_terminal_size().columns - 1
            with self._drawing:
                if self._depth == 0 or not NOTICES["compiling"]:
                    continue
                if stream.isatty() and stream is sys.__stderr__:
                    print(_CLEAR, self.line()[:width], sep="", end="", file=stream, flush=True)
                    self._drawn = True
                elif time.monotonic() - last > PERIOD - _TICK:
                    _say(self.line())
                    last = time.monotonic()


def _say(text: str) -> None:
    if NOTICES["compiling"]:
        print(f"pinfric: {text}", file=sys.stderr, flush=True)


def _reached(function: Callable[..., Any]) -> set[Callable[..., Any]]:
    """Return the functions of a kernel and of all kernels that are compiled with it.

    So without late and inlined ones.
    """
    functions, queue = {function}, [function]
    for each in queue:  # grows while it is walked
        for name in each.__code__.co_names:
            callee = each.__globals__.get(name)
            if not isinstance(callee, Dispatcher) or is_late(callee):
                continue
            if callee.py_func not in functions:
                queue.append(callee.py_func)
                if callee.targetoptions.get("inline", "never") == "never":
                    functions.add(callee.py_func)
    return functions
