"""Records: NamedTuples of arrays as kernels take them, in one argument.

    record = the address of a table of words: of each array size, item's size, place, shape, strides

Kernels load a field from the table where they read it. They count no reference: the record holds
the arrays as long as it lives, so no kernel may return one of them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar, cast

import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    register_model,
    unbox,
)

from pinfric.errors import PinfricError
from pinfric.kernels.stamp import digest

Fields = TypeVar("Fields", bound=tuple[Any, ...])
_WORD = ir.IntType(64)


class Record:
    """A kernel's argument: where the table of a NamedTuple's fields is, and what owns them."""

    __slots__ = "_address", "_given", "_numba_type_", "_table"

    def __init__(self, kind: RecordType, given: Any) -> None:
        self._given, self._numba_type_ = given, kind
        self._table = np.array(list(_words(given)), dtype=np.int64)
        self._address = self._table.ctypes.data


class RecordType(types.Type):
    """The type of a `Record`: fields that kernels read and never replace.

    Attributes:
        fields: name -> type. place: name -> first word in the table.
    """

    def __init__(self, fields: Mapping[str, types.Type]) -> None:
        self.fields, self.place, words = dict(fields), {}, 0
        for name, kind in fields.items():
            self.place[name] = words
            words += _size(kind)
        super().__init__("")
        self.name = f"{type(self).__name__}_{digest(described(self).encode()).hex()}"


def described(kind: Any) -> str:
    """Return a type as text with the names of fields in their order: kernels read them by place."""
    of: Any = getattr(kind, "instance_class", type(kind))
    if isinstance(kind, RecordType):
        fields = kind.fields
    elif isinstance(kind, types.BaseTuple):
        parts: Any = kind
        names: Any = getattr(of, "_fields", range(len(parts)))
        fields = dict(zip(names, parts, strict=True))
    else:
        return str(kind)
    inner = ", ".join(f"{name}: {described(part)}" for name, part in fields.items())
    return f"{of.__module__}.{of.__qualname__}({inner})"


def refuse_lent(compiled: Any) -> None:
    """Refuse a kernel that may return an array of a record, which has no owner there.

    Raises:
        PinfricError: names the kernel.
    """
    if _has(compiled.signature.return_type, types.Array) and any(
        _has(kind, RecordType) for kind in compiled.signature.args
    ):
        raise PinfricError(
            f"kernel {compiled.fndesc.qualname}: takes a record and returns an array; one of a "
            "record lives no longer than the record: write into an array that is an argument"
        )


def _has(kind: Any, wanted: type) -> bool:
    """Whether a type, or one in a tuple, is of a class."""
    parts: Any = kind if isinstance(kind, types.BaseTuple) else ()
    return isinstance(kind, wanted) or any(_has(part, wanted) for part in parts)


def _size(kind: Any) -> int:
    """How many words a field takes: as `_words` gives it."""
    if isinstance(kind, types.Array):
        return 3 + 2 * kind.ndim
    if isinstance(kind, types.BaseTuple):
        return sum(map(_size, cast("Any", kind)))
    if isinstance(kind, RecordType | types.Integer | types.Boolean | types.Float):
        return 1
    raise PinfricError(f"a record holds arrays, numbers and records, not {kind}")


def _words(given: Any) -> Iterator[int]:
    for entry in given:
        if isinstance(entry, np.ndarray):
            yield from (entry.size, entry.itemsize, entry.ctypes.data, *entry.shape, *entry.strides)
        elif isinstance(entry, Record):
            yield entry._address
        elif isinstance(entry, float):
            yield int(np.float64(entry).view(np.int64))
        elif isinstance(entry, int | np.integer | np.bool_):
            yield int(entry)
        else:
            yield from _words(entry)


def _load(context: Any, builder: Any, kind: Any, table: Any, word: int) -> Any:
    """Load a field from its words, which never change."""

    def load(index: int, what: Any) -> Any:
        at = builder.gep(table, [ir.Constant(_WORD, index)])
        found = builder.load(builder.bitcast(at, what.as_pointer()))
        found.set_metadata("invariant.load", builder.module.add_metadata([]))
        return found

    if isinstance(kind, RecordType | types.Float):
        return load(word, context.get_value_type(kind))
    if isinstance(kind, types.Integer | types.Boolean):
        return builder.trunc(load(word, _WORD), context.get_value_type(kind))
    if isinstance(kind, types.BaseTuple):
        parts = []
        for part in cast("Any", kind):
            parts.append(_load(context, builder, part, table, word))
            word += _size(part)
        return context.make_tuple(builder, kind, parts)
    array, n = context.make_array(kind)(context, builder), kind.ndim
    context.populate_array(
        array,
        data=load(word + 2, context.get_data_type(kind.dtype).as_pointer()),
        shape=cgutils.pack_array(builder, [load(word + 3 + i, _WORD) for i in range(n)]),
        strides=cgutils.pack_array(builder, [load(word + 3 + n + i, _WORD) for i in range(n)]),
        itemsize=load(word + 1, _WORD),
        meminfo=None,
    )
    return array._getvalue()


def record(fields: type) -> Any:
    """Return a function that makes a kernel's argument from a NamedTuple of the given class.

    Passing a tuple from Python costs 0.1 us for each array in it, a record 0.1 us in all. A kernel
    reads both in the same way, so an interpreted kernel takes the NamedTuple itself.
    """
    module, name = sys.modules[fields.__module__], fields.__name__
    kind = type(f"{name}Struct", (RecordType,), {"__module__": fields.__module__})
    setattr(module, kind.__name__, kind)  # where pickle, and so the cache, finds it

    @register_model(kind)
    class Model(models.PrimitiveModel):
        def __init__(self, manager: Any, of: Any) -> None:
            super().__init__(manager, of, _WORD.as_pointer())

    @infer_getattr
    class Attributes(AttributeTemplate):
        key = kind

        def generic_resolve(self, of: Any, field: str) -> Any:  # type: ignore[override]
            return of.fields.get(field)

    @lower_getattr_generic(kind)
    def get(context: Any, builder: Any, of: Any, value: Any, field: str) -> Any:
        return _load(context, builder, of.fields[field], value, of.place[field])

    @unbox(kind)
    def read(of: Any, given: Any, c: Any) -> Any:
        number = c.pyapi.object_getattr_string(given, "_address")
        address = c.pyapi.long_as_longlong(number)
        c.pyapi.decref(number)
        return NativeValue(c.builder.inttoptr(address, _WORD.as_pointer()))

    _KINDS[fields] = kind
    return boxed


#: Class -> type of its record.
_KINDS: dict[type, Any] = {}


def record_type(values: Any) -> RecordType:
    """Return the type of a NamedTuple's record."""
    return _interned(type(values), tuple(map(type_of, values)))


def boxed(values: Fields, known: Mapping[int, Any] | None = None) -> Fields:
    """Return the record of a NamedTuple, with records for those of its fields that have one.

    Args:
        values: the NamedTuple.
        known: id of a field -> the record that it has already.
    """
    parts = [
        known[id(entry)]
        if known and id(entry) in known
        else boxed(entry)
        if type(entry) in _KINDS
        else entry
        for entry in values
    ]
    return cast("Fields", Record(_interned(type(values), tuple(map(type_of, parts))), parts))


def type_of(entry: Any) -> Any:
    """Return the type of a field; numba's own look at an array takes 30 us."""
    if isinstance(entry, np.ndarray):
        seen = entry.dtype, entry.ndim, entry.flags.num
        if seen not in _ARRAYS:
            _ARRAYS[seen] = typeof(entry)
        return _ARRAYS[seen]
    if isinstance(entry, Record):
        return entry._numba_type_
    if isinstance(entry, tuple) and type(entry) not in _KINDS:
        parts = tuple(map(type_of, entry))
        made = type(entry), *map(id, parts)
        if made not in _TUPLES:
            _TUPLES[made] = types.unliteral(typeof(entry)), parts
        return _TUPLES[made][0]
    return record_type(entry) if type(entry) in _KINDS else types.unliteral(typeof(entry))


def _interned(of: Any, kinds: tuple[Any, ...]) -> RecordType:
    """Return the type of a class's record with fields of these types, made once: it is hashed."""
    made = of, *map(id, kinds)
    if made not in _TYPES:
        _TYPES[made] = _KINDS[of](dict(zip(of._fields, kinds, strict=True))), kinds
    return _TYPES[made][0]


#: Class, ids of the types of its fields, which numba has once -> type of its record, these types.
#: Hashing them takes longer than all else, and while they are held no other has their ids.
_TYPES: dict[tuple[Any, ...], tuple[RecordType, tuple[Any, ...]]] = {}
#: The same of other tuples: class, ids of the parts' types -> type of the tuple, these types.
_TUPLES: dict[tuple[Any, ...], tuple[Any, tuple[Any, ...]]] = {}
#: Items, dimensions and flags of an array -> its type.
_ARRAYS: dict[tuple[Any, int, int], Any] = {}
