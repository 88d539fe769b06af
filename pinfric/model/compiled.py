"""The one decorator of every kernel that runs once per sample."""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache

from pinfric.errors import PinfricWarning

_DIGEST_SIZE = 16


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a per-sample kernel with numba, cached on disk where a folder is writable.

    Never `fastmath`: it makes `isnan` false and reorders sums, and a norm at zero load must stay 0.
    """
    return _compiled(function, {"nogil": True, "error_model": "numpy"})


def inlined_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a small kernel as `kernel` does, its body into the kernels that call it.

    A call with a tuple of arrays costs more than what it computes.
    """
    return _compiled(function, {"nogil": True, "error_model": "numpy", "inline": "always"})


def parallel_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel as `kernel` does, its `prange` loops for several threads."""
    return _compiled(function, {"nogil": True, "error_model": "numpy", "parallel": True})


def _compiled(function: Callable[..., Any], options: dict[str, Any]) -> Callable[..., Any]:
    made: Callable[..., Any] = numba.njit(**options)(function)
    try:
        vars(made)["_cache"] = _CheckedCache(function)
    except RuntimeError:  # numba finds no folder to cache in (a read-only installation)
        vars(made)["_cache"] = _NoCache()
    return made


@cache
def say_compiling(again: str = "once") -> None:
    """Say on stderr, once a process, why nothing seems to happen; never where all is cached."""
    print(
        f"pinfric: compiling kernels for this machine, {again}: seconds, or a minute",
        file=sys.stderr, flush=True,
    )  # fmt: skip


class _NoCache(NullCache):
    """Where nothing can be kept."""

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """Find nothing: numba compiles next."""
        say_compiling("in every run (no folder to keep them in is writable; set NUMBA_CACHE_DIR)")


class _CheckedCache(FunctionCache):
    """Numba's cache, its files with digests: a damaged one is compiled anew, never run.

    Numba unpickles what it finds: a truncated file ends in an EOFError, and a flipped bit in the
    machine code is executed.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFile(
            self._cache_path, f"{self._impl.filename_base}.checked",
            self._impl.locator.get_source_stamp(),
        )  # fmt: skip

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what was kept; where that is None, numba compiles next."""
        found = super().load_overload(sig, target_context)
        if found is None:
            say_compiling()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, where there is room: a full disk stops no computation."""
        with suppress(OSError):
            super().save_overload(sig, data)


class _CheckedFile(IndexDataCacheFile):
    """An index and the files it names, each with a digest behind its pickle."""

    def _dump(self, content: Any) -> bytes:
        body: bytes = super()._dump(content)
        return body + _digest(body)

    def _load_index(self) -> dict[Any, Any]:
        version = pickle.dumps(self._version, protocol=-1)  # begins every index, see numba
        found = self._intact(self._index_path, len(version))
        if found is None:
            return {}
        stamp, overloads = found
        return dict(overloads) if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        return self._intact(os.path.join(self._cache_path, name), 0)

    def _intact(self, path: str, start: int) -> Any:
        """What stands in a file from byte `start` on; None of one that is damaged, which goes."""
        try:
            content = Path(path).read_bytes()
        except OSError:  # not there yet, or another process has just removed it
            return None
        body, digest = content[start:-_DIGEST_SIZE], content[-_DIGEST_SIZE:]
        if _digest(body) == digest:
            return pickle.loads(body)
        warnings.warn(
            f"{path}: a compiled kernel in numba's cache is damaged; it is compiled anew",
            PinfricWarning, stacklevel=2,
        )  # fmt: skip
        with suppress(OSError):
            os.unlink(path)
        return None


def _digest(body: bytes) -> bytes:
    return hashlib.blake2b(body, digest_size=_DIGEST_SIZE).digest()
