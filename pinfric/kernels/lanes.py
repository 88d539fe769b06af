"""Arithmetic on several samples at once, in vectors of the processor, for kernels of batches.

A function of rows of `LANES` samples is written once. In Python its rows are NumPy's. In a compiled
kernel it is run once by the compiler, and each operation writes LLVM's on a vector: that takes
numba a tenth of the time that it takes for a kernel of as many operations. Each lane has the bits
that it would have alone, on every processor: LLVM neither fuses nor reorders operations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin

#: Samples in a row.
LANES = 8
_DOUBLE = ir.DoubleType()
_ROW = ir.VectorType(_DOUBLE, LANES)
_ANY = ir.Constant(_ROW, ir.Undefined)


class OnLanes:
    """A function of arrays that kernels and Python call: it reads and writes rows of lanes.

    Args:
        function: of C-ordered float arrays: one of shape (n,) holds constants, of shape (n, LANES)
            rows, which it may write. It uses + - * and > on them, numbers, `where`, and others of
            its kind, in straight lines: its loops are unrolled. It returns nothing.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    def __call__(self, *arguments: Any) -> None:
        """Run it in Python."""
        self.function(*arguments)


def on_lanes(function: Callable[..., Any]) -> OnLanes:
    """Let compiled kernels call a function of rows of lanes; see `OnLanes`."""
    made = OnLanes(function)

    @infer_global(made, typing_key=function)
    class Call(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            assert all(kind.layout == "C" and kind.ndim <= 2 for kind in args)
            return signature(types.none, *args)

    @lower_builtin(function, types.VarArg(types.Any))
    def write(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        function(
            *(
                (_Rows if kind.ndim == 2 else _Constants)(
                    builder, context.make_array(kind)(context, builder, value).data
                )
                for kind, value in zip(sig.args, args, strict=True)
            )
        )
        return context.get_dummy_value()

    return made


def where(condition: Any, then: Any, otherwise: Any) -> Any:
    """Return in each lane the one or the other."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, then, otherwise)
    builder = condition.builder
    return _Lanes(
        builder, builder.select(condition.value, _value(builder, then), _value(builder, otherwise))
    )


class _Lanes:
    """A vector in a kernel that is being compiled."""

    __array_ufunc__ = None

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def _of(self, operation: str, *operands: Any) -> _Lanes:
        values = (_value(self.builder, one) for one in operands)
        return _Lanes(self.builder, getattr(self.builder, operation)(*values))

    def __add__(self, other: Any) -> _Lanes:
        return self._of("fadd", self, other)

    def __radd__(self, other: Any) -> _Lanes:
        return self._of("fadd", other, self)

    def __sub__(self, other: Any) -> _Lanes:
        return self._of("fsub", self, other)

    def __rsub__(self, other: Any) -> _Lanes:
        return self._of("fsub", other, self)

    def __mul__(self, other: Any) -> _Lanes:
        return self._of("fmul", self, other)

    def __rmul__(self, other: Any) -> _Lanes:
        return self._of("fmul", other, self)

    def __neg__(self) -> _Lanes:
        return self._of("fneg", self)

    def __gt__(self, other: Any) -> _Lanes:
        value = self.builder.fcmp_ordered(">", self.value, _value(self.builder, other))
        return _Lanes(self.builder, value)


def _value(builder: Any, operand: Any) -> Any:
    """The vector of an operand: a number fills all lanes."""
    return (
        operand.value
        if isinstance(operand, _Lanes)
        else ir.Constant(_ROW, [float(operand)] * LANES)
    )


class _Rows:
    """The rows of an array in a kernel that is being compiled."""

    def __init__(self, builder: Any, data: Any) -> None:
        self._builder, self._data = builder, builder.bitcast(data, _ROW.as_pointer())

    def _at(self, row: int) -> Any:
        return self._builder.gep(self._data, [ir.Constant(ir.IntType(64), row)])

    def __getitem__(self, row: int) -> _Lanes:
        return _Lanes(self._builder, self._builder.load(self._at(row), align=8))

    def __setitem__(self, row: int, value: _Lanes) -> None:
        self._builder.store(_value(self._builder, value), self._at(row), align=8)


class _Constants:
    """The numbers of an array in a kernel that is being compiled: each fills all lanes."""

    def __init__(self, builder: Any, data: Any) -> None:
        self._builder, self._data = builder, data

    def __getitem__(self, place: int) -> _Lanes:
        builder = self._builder
        number = builder.load(builder.gep(self._data, [ir.Constant(ir.IntType(64), place)]))
        one = builder.insert_element(_ANY, number, ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return _Lanes(builder, builder.shuffle_vector(one, _ANY, zeros))
