"""The decorators of kernels, which run once per sample: numba with a checked cache."""

from __future__ import annotations

import gc
import os
import pickle
import re
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Generic, cast

import llvmlite
import numba
import numpy as np
from llvmlite import binding as llvm
from numba import config, typeof
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.codegen import CPUCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.cpu import CPUContext
from numba.core.dispatcher import Dispatcher, _FunctionCompiler  # type: ignore[attr-defined]
from numba.core.runtime import rtsys
from numba.core.sigutils import normalize_signature

from pinfric.errors import PinfricError, PinfricWarning
from pinfric.kernels import lanes, late, records
from pinfric.kernels.dispatch import compiled_for, load, template
from pinfric.kernels.interpreted import CLOCK, interpreted, is_small
from pinfric.kernels.late import called_late, make_late, slot
from pinfric.kernels.progress import CompileProgress
from pinfric.kernels.records import Fields, RecordType, boxed, described, record_type, refuse_lent
from pinfric.kernels.stamp import SIZE, content, digest, stamp

#: Of what the files hold, and of how kernels are compiled.
_FORMAT = 5
#: What else makes a kernel what it is.
_MADE_BY = (
    _FORMAT,
    numba.__version__,
    llvmlite.__version__,
    np.__version__,
    content(records.__file__),
    content(late.__file__),
    content(lanes.__file__),
)
#: So many versions of a kernel's sources keep what was compiled from them.
_KEPT = 8


#: The versions of numba that the tests have run with, from the first to below the second.
_TESTED = (0, 61), (0, 69)
#: Undocumented parts of numba that this module replaces or calls.
_INNER = {
    _FunctionCompiler: ("_compile_core",),
    CPUCodeLibrary: ("_get_module_for_linking",),
    FunctionIdentity: ("_unique_ids",),
    CPUContext: (
        "create_cpython_wrapper",
        "get_executable",
        "insert_func_defn",
        "insert_user_function",
    ),
    Dispatcher: (
        "_compile_for_args",
        "_insert",
        "add_overload",
        "compile",
        "fold_argument_types",
        "get_call_template",
        "get_overload",
    ),
    FunctionCache: ("load_overload", "save_overload", "_impl_class", "_index_key"),
    IndexDataCacheFile: ("_dump", "_load_index", "_load_data", "_save_index", "_save_data"),
}


def check_numba(version: str) -> None:
    """Warn of a version of numba that was not tested; refuse one that cannot work.

    Raises:
        PinfricError: a part of numba that this module uses is missing, or switched off.
    """
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        raise PinfricError("NUMBA_DISABLE_JIT=1: kernels cannot be interpreted for good; unset it")
    first, last = (".".join(map(str, end)) for end in _TESTED)
    what = f"numba {version}: pinfric is tested with numba>={first},<{last}"
    missing = [
        f"{kind.__name__}.{name}"
        for kind, names in _INNER.items()
        for name in names
        if not hasattr(kind, name)
    ]
    if missing:
        raise PinfricError(
            f"{what}; this version has no {', '.join(missing)}; install a tested one"
        )
    release = tuple(int(number) for number in re.findall(r"\d+", version)[:2])
    if not _TESTED[0] <= release < _TESTED[1]:
        text = f"{what}; install a tested one if kernels fail to compile or to load"
        warnings.warn(text, PinfricWarning, stacklevel=2)


check_numba(numba.__version__)


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a per-sample kernel with numba, cached on disk where a folder is writable.

    For small problems it is interpreted until compiling saves time (`interpreted`). `fastmath` is
    never used: it makes `isnan` false and reorders sums, and a norm at zero load must stay 0.

    Call it from Python or from kernels only: numba's own cache would keep another caller without
    the large kernels that it needs, and crash the process that loads it.
    """
    return _compiled(function, {"nogil": True, "error_model": "numpy"}, waits=True)


def late_kernel(part: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Compile a kernel like `kernel`, but not with its callers: when one first calls it.

    For what belongs to a part that most robots lack. It returns nothing or numbers, as its
    annotation says. `compile_late` compiles it before a control loop.
    """

    def decorated(function: Callable[..., Any]) -> Callable[..., Any]:
        made = kernel(function)
        make_late(made, part)
        return made

    return decorated


def call_compiled(kernel: Any, *arguments: Any) -> Any:
    """Call a kernel compiled even for a small problem: the call may take long."""
    CLOCK.hurried += 1
    try:  # what `compiling` does, in a tenth of its time
        return kernel(*arguments)
    finally:
        CLOCK.hurried -= 1


def compile_for(kernel: Any, *arguments: Any) -> None:
    """Compile a kernel for arguments like these, without calling it."""
    kernel.compile(tuple(typeof(argument) for argument in arguments))


def entry_point(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """Return a kernel as compiled for arguments like these, which does not look at their types.

    A call takes 0.5 us, and 2 us with numba's look at five arguments.
    """
    types_ = tuple(map(records.type_of, arguments))
    return cast("Callable[..., Any]", kernel.compile(types_))


@contextmanager
def compiling() -> Iterator[None]:
    """Within, compile kernels at their first call, also for small problems."""
    CLOCK.hurried += 1
    try:
        yield
    finally:
        CLOCK.hurried -= 1


def inlined_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a small kernel like `kernel`, inlined into its callers.

    A call with a tuple of arrays costs more than what such a kernel computes.
    """
    options = {"nogil": True, "error_model": "numpy", "inline": "always"}
    return _compiled(function, options, waits=True)


def inlined(kernel: Any) -> Callable[..., Any]:
    """Return a kernel as an `inlined_kernel`, for callers in a hurry."""
    return inlined_kernel(kernel.py_func)


def parallel_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel like `kernel`, with its `prange` loops on several threads."""
    options = {"nogil": True, "error_model": "numpy", "parallel": True}
    return _compiled(function, options, waits=False)


def _compiled(
    function: Callable[..., Any], options: dict[str, Any], *, waits: bool
) -> Callable[..., Any]:
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    dispatcher: Any = numba.njit(**options)(function)
    try:
        cached: Any = _CheckedCache(function, options)
        CLOCK.keep_in(cached.cache_path)
        _KERNELS.setdefault(cached.name, []).append(dispatcher)
        compiler = dispatcher._compiler
        compiler._compile_core = _as_kept(compiler._compile_core, cached)
    except RuntimeError:  # numba finds no folder to cache in (a read-only installation)
        cached = _NoCache(function)
    vars(dispatcher)["_cache"] = cached
    entries: dict[tuple[Any, ...], Any] = {}

    def compile_to_call(sig: Any) -> Any:
        """Compile for a call from Python, and return what it calls: most are called by kernels."""
        types_ = normalize_signature(sig)[0]
        if types_ not in entries:
            with global_compiler_lock:
                entries[types_] = cached.entry(compiled_for(dispatcher, types_))
            dispatcher._insert([kind._code for kind in types_], entries[types_], False)
        return entries[types_]

    def template_of_types(args: Any, kws: Any) -> Any:
        """Compile callees by types; numba would compile one for each constant."""
        return template(
            dispatcher,
            args,
            kws,
            lambda types_: compiled_for(dispatcher, types_).signature.return_type,
        )

    def add_overload(compiled: Any) -> None:
        dispatcher.overloads[tuple(compiled.signature.args)] = compiled

    vars(dispatcher)["compile"] = compile_to_call
    vars(dispatcher)["add_overload"] = add_overload
    vars(dispatcher)["get_call_template"] = template_of_types
    if waits:
        for_arguments = dispatcher._compile_for_args

        def first_call(*arguments: Any) -> Any:
            if is_small(arguments) and not is_ready(dispatcher, arguments):
                return interpreted(dispatcher, for_arguments)
            return for_arguments(*arguments)

        vars(dispatcher)["_compile_for_args"] = first_call
    return dispatcher


def _as_kept(compile_core: Callable[..., Any], cached: Any) -> Callable[..., Any]:
    """Compile without garbage collection, under one symbol in every process (`_Place`).

    Loops are not vectorized: they are short, and LLVM would take a fifth longer.
    """

    def run(*arguments: Any) -> Any:  # numba holds its lock
        number = int.from_bytes(digest(cached.index.encode()))
        collects, numbers = gc.isenabled(), FunctionIdentity._unique_ids
        FunctionIdentity._unique_ids = chain([number], numbers)  # type: ignore[assignment]
        gc.disable()
        vectorizes = config.LOOP_VECTORIZE  # type: ignore[attr-defined]
        config.LOOP_VECTORIZE = 0  # type: ignore[attr-defined]
        try:
            compiled = compile_core(*arguments)
            refuse_lent(compiled)
            return compiled
        finally:
            config.LOOP_VECTORIZE = vectorizes  # type: ignore[attr-defined]
            FunctionIdentity._unique_ids = numbers
            if collects:
                gc.enable()

    return run


def is_ready(kernel: Any, arguments: tuple[Any, ...]) -> bool:
    """Whether to call a kernel compiled: it is, or is cached, or no time to interpret is left."""
    if CLOCK.is_over():
        return True
    if kernel.overloads or kernel not in _MISSING:
        types_ = tuple(typeof(argument) for argument in arguments)
        if types_ in kernel.overloads:
            return True
        if kernel not in _MISSING and kernel._cache.kept(types_, kernel.targetctx) is not None:
            return True
        _MISSING.add(kernel)
    return False


#: Kernels that are not in numba's cache, so that it is not searched again.
_MISSING: set[Any] = set()


#: Says that kernels compile; nothing if all are cached.
PROGRESS = CompileProgress()


def _wrapper(compiled: Any) -> Any:
    """Return a library with what Python calls to call a kernel.

    A kernel from the cache has a context that does not count the references of arrays: Python would
    get arrays that are nowhere.
    """
    context: Any = compiled.target_context.subtarget(enable_nrt=True)
    name = compiled.fndesc.llvm_cpython_wrapper_name
    library = context.codegen().create_library(name)
    library.enable_object_caching()
    library.add_linking_library(rtsys.library)
    context.create_cpython_wrapper(
        library, compiled.fndesc, compiled.environment, None, release_gil=True
    )
    return library


def _entry(compiled: Any, library: Any) -> Any:
    return compiled.target_context.get_executable(library, compiled.fndesc, compiled.environment)


_NOT_KEPT = "in every run (no folder to keep them in is writable; set NUMBA_CACHE_DIR)"


class _NoCache(NullCache):
    """The cache where no folder is writable: it keeps nothing."""

    def kept(self, sig: Any, target_context: Any) -> None:
        """Find nothing."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__()
        self._function = function
        self.index = f"{function.__module__}.{function.__qualname__}"  # nothing is read by it

    def entry(self, compiled: Any) -> Any:
        """Return what Python calls to call a kernel."""
        return _entry(compiled, _wrapper(compiled))

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """Find nothing: numba compiles next."""
        PROGRESS.begin(self._function, _NOT_KEPT)

    def save_overload(self, sig: Any, data: Any) -> None:
        PROGRESS.end(self._function, compiled=True)


class KernelArgument(Generic[Fields]):
    """A permanent argument: a NamedTuple while kernels are interpreted, then its record.

    The record is made at once if a kernel that takes it is cached.

    Args:
        given: the NamedTuple, an attribute.
        kept: arguments that are fields of it.
    """

    def __init__(self, given: Fields, *kept: KernelArgument[Any]) -> None:
        self.given, self._kept = given, kept
        self._boxed: Fields | None = None
        if _is_kept(given):
            self.record()

    def record(self) -> Fields:
        """Return the record, made at the first call."""
        if self._boxed is None:
            self._boxed = boxed(self.given, {id(one.given): one.record() for one in self._kept})
        return self._boxed

    @property
    def now(self) -> Fields:
        """The argument for a kernel that is called now."""
        if self._boxed is not None:
            return self._boxed
        return self.record() if CLOCK.is_over() else self.given

    def beside(self, *arrays: np.ndarray) -> Fields:
        """Return the argument for a kernel whose other arguments are these arrays."""
        return self.record() if self._boxed is None and not is_small(arrays) else self.now


def _is_kept(values: Any) -> bool:
    """Whether a kernel that takes the record of a NamedTuple is cached, or no time is left."""
    if CLOCK.is_over():
        return True
    kind = record_type(values)
    if kind not in _SEEN and any(note.exists() for note in _notes(kind)):
        _SEEN.add(kind)
    return kind in _SEEN


#: Types of records that a cached kernel takes.
_SEEN: set[RecordType] = set()


def _notes(kind: RecordType) -> Iterator[Path]:
    """Yield the empty files that say that a kernel which takes such a record is cached."""
    return (folder / f"{kind.name}.kept" for folder in _folders(config.CACHE_DIR))  # type: ignore[attr-defined]


@cache
def _folders(named: str) -> tuple[Path, ...]:
    """Where kernels are written, and the folder that NUMBA_CACHE_DIR names, if that is another."""
    try:
        own = Path(_Place(kernel).locator.get_cache_path())
    except RuntimeError:  # no folder is writable
        return ()
    return tuple(dict.fromkeys((own, Path(named, _FOLDER)) if named else (own,)))


_Numba: Any = FunctionCache._impl_class
#: Numba's way to the folder that NUMBA_CACHE_DIR names, the first of several.
_Named: Any = _Numba._locator_classes[0]


#: Of pinfric in NUMBA_CACHE_DIR, shared by all clones; numba's are one per path.
_FOLDER = "pinfric"


class _NamedFolder(_Named):
    """The folder `_FOLDER`."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)
        self._cache_path = os.path.join(os.path.dirname(self.get_cache_path()), _FOLDER)


class _ReadOnlyFolder(_NamedFolder):
    """The same where no folder is writable: a container's image may hold kernels."""

    def ensure_cache_path(self) -> None:
        """Refuse a folder that is missing."""
        if not os.path.isdir(self.get_cache_path()):
            raise FileNotFoundError(self.get_cache_path())


#: A kernel with more LLVM instructions is called where it is; a smaller one is copied into its
#: callers and compiled again with each, which may inline it.
_COPIED = 500
#: Name -> kernels, which differ in their sources, options or outer variables.
_KERNELS: dict[str, list[Any]] = {}
#: Symbol of a kernel that is called where it is -> its name, index, types of its arguments.
_CALLED: dict[str, tuple[str, str, tuple[Any, ...]]] = {}


class _Place(_Numba):
    """What a file holds: a kernel, and the kernels that it calls, which must be loaded first."""

    _locator_classes = (_NamedFolder, *_Numba._locator_classes[1:], _ReadOnlyFolder)
    cache: Any

    def reduce(self, compiled: Any) -> Any:
        """Return what is pickled; from now on callers call a large kernel, without a copy of it."""
        symbols = [f.name for f in compiled.library._final_module.functions if f.is_declaration]
        called = [(name, *_CALLED[name]) for name in symbols if name in _CALLED]
        slots = called_late(compiled.library)
        late_ones = [(x.kernel._cache.name, x.kernel._cache.index, x.types) for x in slots]
        content = called, late_ones, super().reduce(compiled)
        self._call(compiled)
        return content

    def rebuild(self, target_context: Any, content: Any) -> Any:
        """Return the kernel; None if one that it calls has changed or is missing in the cache."""
        called, late_ones, kernel_itself = content
        for name, index, types_ in late_ones:
            kernel = _found(name, index)
            if kernel is None:
                return None
            slot(kernel, types_)
        for symbol, name, index, types_ in called:
            if not _is_loaded(symbol, name, index, types_):
                return None
        compiled = super().rebuild(target_context, kernel_itself)
        self._call(compiled)
        return compiled

    def _call(self, compiled: Any) -> None:
        library, symbol = compiled.library, compiled.fndesc.llvm_func_name
        blocks = library._get_module_for_linking().get_function(symbol).blocks
        if sum(1 for block in blocks for _ in block.instructions) > _COPIED:
            _CALLED[symbol] = self.cache.name, self.cache.index, compiled.signature.args
            library._shared_module = llvm.parse_assembly("")  # callers declare what they call


def _found(name: str, index: str) -> Any:
    """Return a kernel of this process; None if its sources have changed."""
    found = (kernel for kernel in _KERNELS.get(name, ()) if kernel._cache.index == index)
    return next(found, None)


def _is_loaded(symbol: str, name: str, index: str, types_: tuple[Any, ...]) -> bool:
    """Load a kernel, and return whether it has this symbol: LLVM ends the process at another."""
    kernel = _found(name, index)
    if kernel is None or (
        types_ not in kernel.overloads and not load(kernel, types_, kernel._cache.kept)
    ):
        return False
    return bool(kernel.overloads[types_].fndesc.llvm_func_name == symbol)


class _CheckedCache(FunctionCache):
    """Numba's cache with digests of its files: a damaged kernel is compiled again, never run.

    Numba unpickles any file: a truncated one raises EOFError, and machine code with a flipped bit
    is executed. Numba notices only edits of a kernel's own file; here an edit counts that changes
    what a kernel or one that it calls computes (`stamp`).

    Attributes:
        name: of the kernel and of Python's version.
    """

    _impl_class = _Place

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function)
        self._function, self._options, self._impl.cache = function, options, self
        name = f"{function.__module__}.{function.__qualname__}.{sys.implementation.cache_tag}"
        self.name = re.sub("[^.\\w]", "", name)
        del self._cache_file  # numba's own

    @cached_property
    def _cache_file(self) -> Any:  # type: ignore[override]
        """Made at the first call: a kernel may use names that its module defines later."""
        made = self.name, (*_MADE_BY, stamp(self._function, self._options))
        named = config.CACHE_DIR and os.path.join(config.CACHE_DIR, _FOLDER)  # type: ignore[attr-defined]
        beside = _CheckedFile(named, *made) if named and named != self.cache_path else None
        return _CheckedFile(self.cache_path, *made, beside)

    @property
    def index(self) -> str:
        """The name of its index in the cache, unlike that of other sources."""
        return str(self._cache_file._index_name)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return numba's key with texts for types: of a NamedTuple numba notes its class alone."""
        _, target, code = super()._index_key(sig, codegen)
        return tuple(map(described, getattr(sig, "args", sig))), target, code

    def kept(self, sig: Any, target_context: Any) -> Any:
        """Return the cached kernel for arguments of these types, or None."""
        compiled = super().load_overload(sig, target_context)
        if compiled is not None:
            PROGRESS.end(self._function, compiled=False)
        return compiled

    def entry(self, compiled: Any) -> Any:
        """Return what Python calls to call a kernel, cached beside it."""
        key = *self._index_key(compiled.signature, compiled.codegen), "Python, counting"
        constants = compiled.environment.consts  # the wrapper reads those that it needs by place
        if (kept := self._cache_file.load(key)) is not None:
            constants[:], library = kept[0], compiled.codegen.unserialize_library(kept[1])
            return _entry(compiled, library)
        library = _wrapper(compiled)
        entry = _entry(compiled, library)
        with suppress(OSError):
            self._cache_file.save(key, (list(constants), library.serialize_using_object_code()))
        return entry

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached kernel; if None, numba compiles next."""
        compiled = self.kept(sig, target_context)
        if compiled is None:
            keeps = os.access(self.cache_path, os.W_OK)
            PROGRESS.begin(self._function, "they are kept for later runs" if keeps else _NOT_KEPT)
        return compiled

    def save_overload(self, sig: Any, data: Any) -> None:
        """Cache the compiled kernel; a full disk is ignored."""
        PROGRESS.end(self._function, compiled=True)
        with suppress(OSError):
            super().save_overload(sig, data)
            for kind in data.signature.args:
                if isinstance(kind, RecordType):
                    next(_notes(kind)).touch()


class _CheckedFile(IndexDataCacheFile):
    """An index and its files, each with a digest behind its pickle.

    Their names contain the digest of the sources, so clones with different ones share a folder.

    Args:
        beside: files that may only be read, where these hold no kernel.
    """

    def __init__(
        self, folder: str, name: str, stamp: tuple[Any, ...], beside: _CheckedFile | None = None
    ) -> None:
        super().__init__(folder, f"{name}.{digest(repr(stamp).encode()).hex()}", None)
        self._of_all_sources = f"{name}.{'[0-9a-f]' * 2 * SIZE}.nbi"
        self._beside = beside

    def load(self, key: Any) -> Any:
        """Return what is kept of a kernel, or None."""
        found = super().load(key)
        return self._beside.load(key) if found is None and self._beside is not None else found

    def save(self, key: Any, data: Any) -> None:
        """Save a kernel. Numba numbers files: of two processes one may overwrite the other's."""
        name = f"{Path(self._index_path).stem}.{digest(repr(key).encode()).hex()}.nbc"
        self._save_data(name, data)
        self._save_index({**self._load_index(), key: name})

    def _save_index(self, overloads: Any) -> None:
        """Save the index; keep only the `_KEPT` last used ones of this kernel."""
        super()._save_index(overloads)
        with suppress(OSError):  # another process may remove the same
            folder = Path(self._cache_path)
            used = {index: index.stat().st_mtime for index in folder.glob(self._of_all_sources)}
            for index in sorted(used, key=used.__getitem__)[:-_KEPT]:
                for file in [index, *folder.glob(f"{index.stem}.*.nbc")]:
                    file.unlink()

    def _dump(self, content: Any) -> bytes:
        body: bytes = super()._dump(content)
        return body + digest(body)

    def _load_index(self) -> dict[Any, Any]:
        version = pickle.dumps(self._version, protocol=-1)  # begins every index, see numba
        content = self._intact(self._index_path, len(version))
        if content is None:
            return {}
        with suppress(OSError):  # of another user
            if os.access(self._cache_path, os.W_OK):
                os.utime(self._index_path)
        return dict(content[1])

    def _load_data(self, name: str) -> Any:
        return self._intact(os.path.join(self._cache_path, name), 0)

    def _intact(self, path: str, start: int) -> Any:
        """Return the content of a file from byte `start` on; remove a damaged one and return None.

        Also None if it names a class that no longer exists.
        """
        try:
            whole = Path(path).read_bytes()
        except OSError:  # not there yet, or another process has just removed it
            return None
        body = whole[start:-SIZE]
        if digest(body) == whole[-SIZE:]:
            with suppress(AttributeError, ImportError):
                return pickle.loads(body)
            return None
        warnings.warn(
            f"{path}: a compiled kernel in numba's cache is damaged; it is compiled again",
            PinfricWarning,
            stacklevel=2,
        )
        with suppress(OSError):
            os.unlink(path)
        return None
