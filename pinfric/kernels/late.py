"""Late kernels: what most robots lack. Their callers find them in a slot, compiled when needed.

    the address in the slot; if it is 0, Python compiles the kernel and writes it there

So a solver of an open chain compiles nothing of loops and gears, and no caller is compiled twice.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from llvmlite import binding as llvm
from llvmlite import ir
from numba.core import cgutils, types

from pinfric.errors import PinfricError
from pinfric.kernels.dispatch import compiled_for, template
from pinfric.kernels.records import described
from pinfric.kernels.stamp import digest

#: What a late kernel may return, as its annotation says.
_RETURNS = {
    "None": types.none,
    "bool": types.boolean,
    "int": types.int64,
    "float": types.float64,
    "tuple[int, int]": types.UniTuple(types.int64, 2),
}
#: The symbol of the function that compiles what a slot lacks; what slots' symbols begin with.
_COMPILE, _PREFIX = "pinfric.compile", "pinfric.late."
#: The return code of a kernel that raises: without an exception Python says SystemError.
_FAILED = ir.Constant(ir.IntType(32), -1)


class _Slot:
    """Where callers find the address of a kernel for arguments of some types."""

    def __init__(self, symbol: str, kernel: Any, types_: tuple[Any, ...]) -> None:
        self.kernel, self.types, self.address = kernel, types_, ctypes.c_void_p()
        llvm.add_symbol(symbol, ctypes.addressof(self.address))
        if types_ in kernel.overloads:
            self.fill(kernel.overloads[types_])

    def fill(self, compiled: Any) -> None:
        self.address.value = compiled.library.get_pointer_to_function(
            compiled.fndesc.llvm_func_name
        )


#: Part of a robot -> its late kernels.
_PARTS: dict[str, list[Any]] = {}
#: Symbol -> slot; address of a slot -> slot.
_SLOTS: dict[str, _Slot] = {}
_AT: dict[int, _Slot] = {}


def make_late(kernel: Any, part: str) -> None:
    """Let callers of a kernel find it in a slot, without compiling it; say what it returns."""
    function = kernel.py_func
    returns = _RETURNS[function.__annotations__["return"]]
    add_overload = kernel.add_overload
    _PARTS.setdefault(part, []).append(kernel)

    def template_of_types(args: Any, kws: Any) -> Any:
        return template(kernel, args, kws, lambda _: returns)

    def implementation(args: Any) -> str:
        """Return the key of the code that calls a slot: its symbol."""
        symbol = slot(kernel, tuple(args))
        if symbol not in _WRITTEN:
            _WRITTEN.add(symbol)
            code = _call(symbol, returns, tuple(args))
            kernel.targetctx.insert_func_defn([(code, symbol, tuple(args))])
        return symbol

    def add(compiled: Any) -> None:
        found = compiled.signature.return_type
        if found != returns:
            raise PinfricError(f"late kernel {function.__qualname__}: it returns {found}")
        add_overload(compiled)
        for each in _SLOTS.values():
            if each.kernel is kernel and each.types == tuple(compiled.signature.args):
                each.fill(compiled)

    vars(kernel)["get_call_template"] = template_of_types
    vars(kernel)["get_overload"] = implementation
    vars(kernel)["add_overload"] = add


#: Symbols of slots for which numba has code that calls them.
_WRITTEN: set[str] = set()


def is_late(kernel: Any) -> bool:
    """Whether a kernel is not compiled with its callers."""
    return any(kernel in kernels for kernels in _PARTS.values())


def compile_late(part: str) -> None:
    """Compile the late kernels of a part of a robot that a caller in this process may call."""
    seen = 0
    while seen < len(_SLOTS):  # which grow: a late kernel may call others
        each = list(_SLOTS.values())[seen]
        seen += 1
        if each.kernel in _PARTS[part]:
            compiled_for(each.kernel, each.types)


def slot(kernel: Any, types_: tuple[Any, ...]) -> str:
    """Return the symbol of the slot of a kernel for arguments of these types, made at first."""
    which = repr((kernel._cache.index, tuple(map(described, types_))))
    symbol = f"{_PREFIX}{kernel.py_func.__name__}.{digest(which.encode()).hex()}"
    if symbol not in _SLOTS:
        made = _SLOTS[symbol] = _Slot(symbol, kernel, types_)
        _AT[ctypes.addressof(made.address)] = made
    return symbol


def called_late(library: Any) -> list[_Slot]:
    """Return the slot of each late kernel that a library calls."""
    names = (variable.name for variable in library._final_module.global_variables)
    return [_SLOTS[name] for name in names if name in _SLOTS]


def _call(symbol: str, returns: Any, types_: tuple[Any, ...]) -> Callable[..., Any]:
    """Return what writes a call of the kernel in a slot into the module of its caller."""

    def call(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        module, kind = builder.module, context.call_conv.get_function_type(returns, types_)
        name = f"{symbol}.call"
        if name not in module.globals:
            _write(module, symbol, ir.Function(module, kind, name))
        status, value = context.call_conv.call_function(
            builder, module.globals[name], returns, types_, arguments
        )
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return value

    return call


def _write(module: Any, symbol: str, function: Any) -> None:
    """Write the function that calls what is in a slot."""
    function.linkage = "internal"
    builder = ir.IRBuilder(function.append_basic_block())
    slot = ir.GlobalVariable(module, function.type, symbol)
    word = ir.IntType(8).as_pointer()

    def is_empty() -> Any:
        return cgutils.is_null(builder, builder.load(slot))

    with cgutils.if_unlikely(builder, is_empty()):
        kind = ir.FunctionType(ir.VoidType(), [word])
        builder.call(
            cgutils.get_or_insert_function(module, kind, _COMPILE), [builder.bitcast(slot, word)]
        )
        with cgutils.if_unlikely(builder, is_empty()):
            builder.ret(_FAILED)
    builder.ret(builder.call(builder.load(slot), function.args))


@ctypes.CFUNCTYPE(None, ctypes.c_void_p)
def _compile(address: int) -> None:
    """Compile what a slot lacks; kernels call it without Python's lock, which ctypes takes."""
    lacking = _AT[address]
    compiled_for(lacking.kernel, lacking.types)


llvm.add_symbol(_COMPILE, ctypes.cast(_compile, ctypes.c_void_p).value)
