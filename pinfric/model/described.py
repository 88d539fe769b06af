"""Descriptions of the figures of a result: each is written once, in the result's class.

    @described
    class Summary:
        unit: str = quantity('of every effort here, "N m" or "N"')
        peak: float = quantity("max |u|", EFFORT, "peak")

JSON and its schema, tables, columns of a DataFrame, the docstring's attributes and the reference
are made from these fields. `@derived` below `@property` includes a property; its docstring is its
meaning.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import sys
import textwrap
import types
import typing
from collections.abc import Callable, Mapping
from enum import Enum, IntEnum
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, dataclass_transform

import numpy as np

#: Units of figures at a joint: turning or sliding.
EFFORT, SPEED, PLACE = "N m or N", "rad/s or m/s", "rad or m"
INERTIA = "kg m^2 or kg"
#: Of efforts at the motor's shaft: the field that says it.
MOTOR = "in motor_unit"

_Class = TypeVar("_Class", bound=type)
_Result = TypeVar("_Result")
_Method = TypeVar("_Method", bound=Callable[..., Any])


class Quantity(NamedTuple):
    """The description of one field.

    Attributes:
        meaning: for docstring, schema and reference.
        unit: SI, or empty; "N m or N" depends on the row's joint, "in motor_unit" on the row's
            field `motor_unit`: see `unit_of`.
        heading: of its column; empty: in no table. "peak *" (of a nested result): its fields become
            columns, with this line above their headings. "{} %" (of a mapping): a column for each
            key.
        cell: format of its cells: "{least} to {most}" of the row's fields, with a display unit:
            "{share:%}", "{sag:mm}"; empty: the number.
        name: whether it is a name, which tables may shorten.
    """

    meaning: str
    unit: str = ""
    heading: str = ""
    cell: str = ""
    name: bool = False


def quantity(
    meaning: str,
    unit: str = "",
    heading: str = "",
    cell: str = "",
    *,
    name: bool = False,
    default: Any = dataclasses.MISSING,
    default_factory: Any = dataclasses.MISSING,
) -> Any:
    """Return a dataclass field with its description: see `Quantity`."""
    metadata = {"quantity": Quantity(meaning, unit, heading, cell, name)}
    if default_factory is not dataclasses.MISSING:
        return dataclasses.field(default_factory=default_factory, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def between(least: str, most: str, display: str = "") -> str:
    """Return the cell "least–most" of two fields; one number where both print alike."""
    return "\N{EN DASH}".join(f"{{{name}:{display}}}" for name in (least, most))


def derived(unit: str = "", heading: str = "", cell: str = "") -> Callable[[_Method], _Method]:
    """Include a property in the class's JSON, tables and schema, as a field is."""

    def mark(method: _Method) -> _Method:
        meaning = " ".join((method.__doc__ or "").split()).removesuffix(".")
        method.quantity = Quantity(meaning, unit, heading, cell)  # type: ignore[attr-defined]
        return method

    return mark


@dataclass_transform(frozen_default=True, field_specifiers=(quantity, dataclasses.field))
def described(cls: _Class) -> _Class:
    """Make a frozen dataclass whose docstring lists its described fields as attributes."""
    dataclasses.dataclass(frozen=True)(cls)  # the same class, completed
    lines = [
        textwrap.fill(
            f"{entry.name}: {stated.meaning}{f' ({stated.unit})' * bool(stated.unit)}.",
            92,
            initial_indent="    ",
            subsequent_indent=" " * 8,
        )
        for entry in dataclasses.fields(cls)
        if (stated := entry.metadata.get("quantity"))
    ]
    text = textwrap.dedent(f"    {cls.__doc__ or ''}").strip()
    cls.__doc__ = "\n".join([text, *([""] if "Attributes:" in text else ["", "Attributes:"])])
    cls.__doc__ += "\n" + "\n".join(lines) + "\n"
    return cls


def gathered(kind: Callable[..., _Result], source: Any, **own: Any) -> _Result:
    """Return a described result: fields as given, others from the source's attributes by name."""
    names = [entry.name for entry in dataclasses.fields(kind) if entry.name not in own]  # type: ignore[arg-type]
    return kind(**{name: getattr(source, name) for name in names}, **own)


def quantities(kind: type) -> dict[str, Quantity]:
    """Return the descriptions of a class's figures, fields first, then derived ones."""
    described_fields = {
        entry.name: entry.metadata["quantity"]
        for entry in dataclasses.fields(kind)
        if "quantity" in entry.metadata
    }
    for base in reversed(kind.__mro__):
        for name, value in vars(base).items():
            mark = getattr(getattr(value, "fget", None), "quantity", None)
            if mark is not None:
                described_fields[name] = mark
    return described_fields


def unit_at(unit: str, effort: str) -> str:
    """Return a unit at one joint: of "N m or N" the first if the joint's effort is in N m.

    With an unknown `effort`, "", both stay.
    """
    turning, _, sliding = unit.partition(" or ")
    if not sliding or not effort:
        return unit
    return sliding if effort == "N" else turning


def effort_where(slides: bool) -> str:
    """Return the unit of an effort: N along a sliding joint, N m about a turning one."""
    return unit_at(EFFORT, "N" if slides else "N m")


def unit_of(row: Any, unit: str) -> str:
    """Return a figure's unit in one row of results, as the row's joint or another field gives it.

    The row's field `unit` is the unit of its joint's efforts.
    """
    if unit.startswith("in "):
        return str(getattr(row, unit.removeprefix("in ")))
    return unit_at(unit, getattr(row, "unit", ""))


def in_json(value: Any) -> Any:
    """Return a described result in JSON's types: arrays as lists, NaN and infinity as None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {name: in_json(getattr(value, name)) for name in quantities(type(value))}
    if isinstance(value, IntEnum):
        return value.name.lower()
    if isinstance(value, Mapping):
        return {str(key): in_json(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [in_json(entry) for entry in value]
    if isinstance(value, np.ndarray | np.generic):
        return in_json(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


_NAMES = {str: "string", Path: "string", bool: "boolean", int: "integer", type(None): "null"}
_DRAFT = "https://json-schema.org/draft/2020-12/schema"


class Schema:
    """JSON schemas (2020-12) of described classes, each class once in `defs`."""

    def __init__(self) -> None:
        self.defs: dict[str, Any] = {}
        self._kinds: dict[str, type] = {}

    def of_class(self, kind: type) -> dict[str, Any]:
        """Return a reference to a class's schema, which is made at the first call."""
        if self._kinds.setdefault(kind.__name__, kind) is not kind:
            raise AssertionError(f"two described classes are called {kind.__name__}")
        if kind.__name__ not in self.defs:
            self.defs[kind.__name__] = {}  # it may hold itself
            keys = {}
            for name, stated in quantities(kind).items():
                unit = {"unit": stated.unit} if stated.unit else {}
                keys[name] = {
                    **self.of_type(_annotation(kind, name)),
                    "description": stated.meaning,
                    **unit,
                }
            first = (kind.__doc__ or "").partition("\n")[0]
            self.defs[kind.__name__] = closed(keys) | {"description": first}
        return {"$ref": f"#/$defs/{kind.__name__}"}

    def of_type(self, kind: Any) -> dict[str, Any]:
        """Return the schema of an annotation."""
        origin, inner = typing.get_origin(kind), typing.get_args(kind)
        if origin in (typing.Union, types.UnionType):
            return {"anyOf": [self.of_type(argument) for argument in inner]}
        if origin is tuple and len(inner) == 2 and inner[1] is Ellipsis:
            return {"type": "array", "items": self.of_type(inner[0])}
        if origin is tuple:
            return {"type": "array", "prefixItems": [self.of_type(argument) for argument in inner]}
        if isinstance(origin, type) and issubclass(origin, Mapping):
            return {"type": "object", "additionalProperties": self.of_type(inner[1])}
        if kind is float:
            return {"type": ["number", "null"]}
        if kind is np.ndarray or origin is np.ndarray:
            return {"type": "array"}
        if isinstance(kind, type) and issubclass(kind, Enum):
            return {"enum": [in_json(member) for member in kind]}
        if dataclasses.is_dataclass(kind):
            return self.of_class(typing.cast(type, kind))
        return {"type": _NAMES[kind]} if kind in _NAMES else {}

    def whole(self, content: dict[str, Any]) -> dict[str, Any]:
        """Return a schema with the definitions that it refers to."""
        return {"$schema": _DRAFT, **content, "$defs": self.defs}


def closed(keys: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of an object that has these keys and no others."""
    return {
        "type": "object",
        "properties": keys,
        "required": list(keys),
        "additionalProperties": False,
    }


def _annotation(kind: type, name: str) -> Any:
    """The type of a field or property, evaluated in the module of its class."""
    for base in kind.__mro__:
        member = getattr(vars(base).get(name), "fget", None)
        annotations = inspect.get_annotations(member or base)
        text = annotations.get("return" if member else name)
        if text is not None:
            return eval(text, vars(sys.modules[base.__module__])) if isinstance(text, str) else text
    raise AssertionError(f"{kind.__name__}.{name} has no type")
