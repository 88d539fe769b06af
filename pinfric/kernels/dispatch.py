"""What numba's dispatcher does when kernels call each other, in less time.

A call is compiled for the types of its arguments. Numba would compile one for each constant, write
for each kernel what Python calls, and stop the time of each call of LLVM once for every kernel that
waits for a callee.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import types, typing
from numba.core.compiler_lock import global_compiler_lock
from numba.core.event import trigger_event


def compiled_for(kernel: Any, types_: tuple[Any, ...]) -> Any:
    """Return a kernel compiled for arguments of these types, or loaded; Python cannot call it."""
    with global_compiler_lock:
        if types_ not in kernel.overloads and not load(kernel, types_, kernel._cache.load_overload):
            kernel._cache_misses[types_] += 1
            data = {"dispatcher": kernel, "args": types_, "return_type": None}
            with kernel._compiling_counter, trigger_event("numba:compile", data=data):
                kernel.add_overload(kernel._compiler.compile(types_, None))
            kernel._cache.save_overload(types_, kernel.overloads[types_])
        return kernel.overloads[types_]


def load(kernel: Any, types_: tuple[Any, ...], kept: Callable[..., Any]) -> bool:
    """Load a kernel from what is kept, and return whether it was there."""
    if (compiled := kept(types_, kernel.targetctx)) is None:
        return False
    kernel._cache_hits[types_] += 1
    key, code = compiled.entry_point, compiled.library
    kernel.targetctx.insert_user_function(key, compiled.fndesc, [code])
    kernel.add_overload(compiled)
    return True


def template(
    kernel: Any, args: Any, kws: Any, returned: Callable[[tuple[Any, ...]], Any]
) -> tuple[Any, ...]:
    """Return what numba wants to know of a call; `returned`: the type of a result, by arguments."""
    named = {name: types.unliteral(kind) for name, kind in kws.items()}
    signature, folded = kernel.fold_argument_types([types.unliteral(kind) for kind in args], named)
    name, types_ = kernel.py_func.__name__, tuple(folded)
    made = typing.make_concrete_template(
        f"CallTemplate({name})", name, [typing.signature(returned(types_), *types_)]
    )
    return made, signature, types_, {}
