"""The stamp of a kernel: a digest of all that its machine code depends on, and of nothing else.

Byte code has neither comments nor line numbers, and docstrings are left out: an edit of them
compiles nothing. With it go the constants and classes that it names, and all of this of the kernels
that it calls.
"""

from __future__ import annotations

import enum
import hashlib
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from pinfric.kernels.lanes import OnLanes

#: Bytes of a digest.
SIZE = 16
#: What numba compiles by itself; its version is in the key of every kernel.
_LIBRARIES = ("builtins", "math", "numba", "numpy")


def digest(body: bytes) -> bytes:
    """Return the digest of some bytes."""
    return hashlib.blake2b(body, digest_size=SIZE).digest()


def stamp(function: Callable[..., Any], options: Mapping[str, Any]) -> bytes:
    """Return the stamp of a kernel, once all names that it uses are there.

    Args:
        function: of the kernel. options: of numba.
    """
    seen: set[Any] = set()
    queue: list[tuple[Any, Mapping[str, Any]]] = [(function, options)]
    parts = []
    for each, how in queue:  # grows while it is walked
        own, callees = _own(each)
        parts.append((each.__module__, each.__qualname__, sorted(how.items()), own))
        for callee in callees:
            if callee not in seen:
                seen.add(callee)
                queue.append((callee.py_func, callee.targetoptions))
    return digest(repr(parts).encode())


@cache
def _own(function: Any) -> tuple[bytes, tuple[Any, ...]]:
    """Digest of what one function is made of, and the kernels that it calls."""
    callees: list[Any] = []
    names = dict(function.__globals__)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        names[name] = cell.cell_contents
    parts = list(_code(function.__code__, function.__doc__, names, callees))
    parts.append(repr((function.__defaults__, function.__kwdefaults__)))
    return digest(repr(parts).encode()), tuple(callees)


def _code(
    code: CodeType, docstring: str | None, names: Mapping[str, Any], callees: list[Any]
) -> Iterator[Any]:
    yield code.co_code, code.co_argcount, code.co_kwonlyargcount, code.co_flags, code.co_varnames
    yield code.co_names, getattr(code, "co_exceptiontable", b"")
    for place, constant in enumerate(code.co_consts):
        if isinstance(constant, CodeType):
            yield from _code(constant, None, names, callees)
        elif place or docstring is None or constant != docstring:  # a docstring is the first
            yield place, type(constant).__name__, repr(constant)
    for name in (*code.co_names, *code.co_freevars):
        if name in names:
            yield name, _value(names[name], names, callees)


def _run_by(called: OnLanes) -> list[FunctionType]:
    """Return the functions that the compiler runs where a kernel calls a function on lanes."""
    queue: list[Any] = [called.function]
    for each in queue:  # grows while it is walked
        codes = [each.__code__]
        for code in codes:  # with those of its comprehensions
            codes += (inner for inner in code.co_consts if isinstance(inner, CodeType))
            for name in code.co_names:
                used = each.__globals__.get(name)
                if isinstance(used, FunctionType) and used not in queue:
                    queue.append(used)
    return queue


def _value(value: Any, names: Mapping[str, Any], callees: list[Any]) -> Any:
    """What a name stands for; of an unknown kind of thing, the files that may define it."""
    if isinstance(value, Dispatcher):
        callees.append(value)
        return value.py_func.__module__, value.py_func.__qualname__
    if isinstance(value, OnLanes):
        return [_own(function)[0] for function in _run_by(value)]
    if isinstance(value, int | float | complex | str | bytes | None):
        return type(value).__name__, repr(value)
    if isinstance(value, np.ndarray | np.generic):
        return str(value.dtype), value.shape, value.tobytes()
    if isinstance(value, tuple):
        inner = [_value(part, names, callees) for part in value]
        return type(value).__name__, getattr(value, "_fields", ()), inner
    if isinstance(value, type) and hasattr(value, "_fields"):
        return value.__module__, value.__qualname__, value._fields
    if isinstance(value, enum.EnumMeta):
        return [
            (name, repr(member.value)) for name, member in dict[str, Any](value.__members__).items()
        ]
    if isinstance(value, FunctionType):  # an attribute's name: numba compiles no call of it
        return "function"
    module = value.__name__ if isinstance(value, ModuleType) else _module(value)
    if module.partition(".")[0] in _LIBRARIES:
        return module, getattr(value, "__qualname__", repr(value))
    files = [names.get("__file__"), getattr(sys.modules.get(module), "__file__", None)]
    return [module, *(content(file) for file in files if file)]


def _module(value: Any) -> str:
    """Where a thing is from; NumPy's ufuncs do not say."""
    return "numpy" if isinstance(value, np.ufunc) else getattr(value, "__module__", None) or ""


def content(file: str) -> bytes:
    """Return the digest of a file."""
    return _content(file, Path(file).stat().st_mtime_ns)


@cache
def _content(file: str, changed_at: int) -> bytes:
    return digest(Path(file).read_bytes())
