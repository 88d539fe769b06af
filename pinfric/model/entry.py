"""Entries of the files that a user writes: meaning of keys, checks of numbers, error messages.

A key is a field with its meaning, an example and a unit:

    mass: Positive = key("of the body", 2.0, "kg")
    backlash: Positive | None = optional("of its gear", 0.001, "rad")

JSON schemas and the reference show them.
"""

from __future__ import annotations

import difflib
import math
import re
import warnings
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    FiniteFloat,
    GetCoreSchemaHandler,
    Tag,
    ValidationError,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema

from pinfric.errors import (
    PinfricError,
    PinfricWarning,
    SceneError,
    choose_from,
    plain,
    problems_line,
)
from pinfric.model.magnitudes import LARGEST, SMALLEST
from pinfric.model.yamlfile import brief, yaml_line


def key(text: str, example: Any, unit: str = "", **more: Any) -> Any:
    """Return a key of a file, as a pydantic field; it is required, unless it has a default.

    Args:
        text: its meaning, read after its name.
        example: a value, as a file gives it.
        unit: empty if it has none, "1" for a ratio.
        more: of pydantic's `Field`: default, bounds.
    """
    shown = f"{text} ({unit})" if unit else text
    return Field(description=shown, examples=[example], json_schema_extra={"unit": unit}, **more)


def optional(text: str, example: Any, unit: str = "", **more: Any) -> Any:
    """Return a `key` that may be left out, and is None then."""
    return key(text, example, unit, default=None, **more)


def strict_number(value: Any) -> Any:
    """Refuse impossibly large numbers, and what pydantic would silently convert to a number."""
    if isinstance(value, bool | str):
        raise ValueError(f"should be a number, found {brief(value)}")
    if isinstance(value, int | float) and LARGEST < abs(value) < math.inf:
        raise ValueError(f"should be at most {LARGEST:g} in magnitude, found {brief(value)}")
    return value


def not_vanishing(value: float) -> float:
    """Refuse a value that is impossibly small but not 0."""
    if 0 < value < SMALLEST:
        raise ValueError(f"should be at least {SMALLEST:g}, found {value:g}")
    return value


Number = Annotated[FiniteFloat, BeforeValidator(strict_number)]
NonNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0), AfterValidator(not_vanishing)]
#: The version of a file's format; `true`, which equals 1 in Python, is refused.
Version = Annotated[Literal[1], BeforeValidator(strict_number)]
#: Words in every plausibility warning of an entry; callers may search for them.
USUALLY = "usually at most"
Vector3 = tuple[Number, Number, Number]
Text = Annotated[str, Field(min_length=1)]


class Forms:
    """Several ways to write one value, distinguished by type, and mappings by their keys.

    Args:
        forms: entries or one `dict` for mappings, a tuple for lists, a `Literal` for words; others
            are read as the first.
    """

    def __init__(self, *forms: Any) -> None:
        self.forms = {_written_as(form): form for form in forms}

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Give pydantic a union with the discriminator `chosen`."""
        members = tuple(Annotated[form, Tag(tag)] for tag, form in self.forms.items())
        return handler.generate_schema(Annotated[Union[members], Discriminator(self.chosen)])  # noqa: UP007

    def chosen(self, value: Any) -> str:
        """Return the form of a value; of several entries the one with most of its keys."""
        first, *_ = self.forms
        if isinstance(value, dict):
            fitting = {
                tag: len(value.keys() & form.key_names())
                for tag, form in self.forms.items()
                if isinstance(form, type) and issubclass(form, Entry)
            }
            return max(fitting, key=fitting.__getitem__, default=first)
        written = _written_as(value)
        return written if written in self.forms else first


def _written_as(form: Any) -> str:
    """Name of a form or of a value's type: an entry's class, list, word, mapping or number."""
    kind = form if isinstance(form, type) else get_origin(form) or type(form)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind.__name__
    kinds = {list: "list", tuple: "list", str: "word", Literal: "word", dict: "mapping"}
    return kinds.get(kind, "number")


class Entry(BaseModel):
    """Base class of all sections: unknown keys are errors, instances are immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @classmethod
    def key_names(cls) -> list[str]:
        """Return the keys that a mapping may have."""
        return list(cls.model_fields)

    @classmethod
    def kinds(cls) -> list[str]:
        """Return the words that the key `kind` of a family of classes may be."""
        return []

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        """Replace the value of an unknown key by the list of known keys, for pydantic's message.

        Keys that the mapping already has are not suggested.
        """
        if not isinstance(data, dict):
            return data
        names = cls.key_names()
        if data.keys() <= set(names):
            return data
        return {
            name: value if name in names else choose_from(name, names, data)
            for name, value in data.items()
        }

    def questions(self) -> Iterator[str]:
        """Yield warnings about implausible values of this entry (`unlikely`)."""
        yield from ()


_Kind = TypeVar("_Kind", bound=BaseModel)


def register(table: dict[str, Any], name: str, cls: type[BaseModel]) -> None:
    """Write a class under its name in a table that scene files use.

    Raises:
        SceneError: another class has the name. A class that is run again replaces itself.
    """
    known = table.setdefault(name, cls)
    if (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
        raise SceneError(
            f"{cls.__qualname__}: {name!r} is the name of {known.__module__}.{known.__qualname__}, "
            f"and all scenes use it; choose another name (taken: {', '.join(table)})"
        )
    table[name] = cls


def register_kind(table: dict[str, Any], cls: type[BaseModel]) -> None:
    """Write a class into a table under its `kind`, a `Literal` of one word; see `register`."""
    (name,) = get_args(cls.model_fields["kind"].annotation)
    register(table, name, cls)


def place(path: Iterable[int | str]) -> str:
    """Return the path of a key for messages, e.g. actuators[1].transmission.ratio."""
    parts = (f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)
    return "".join(parts).removeprefix(".")


def parse(
    entry: type[_Kind],
    content: Any,
    where: str,
    error: type[PinfricError] = SceneError,
    at: tuple[int | str, ...] = (),
) -> _Kind:
    """Validate `content` as `entry`; raise one `error`, beginning with `where`, with all problems.

    `content` is a mapping or such an entry, `at` its place in the file. Plausibility warnings of
    the entries (`Entry.questions`) also begin with `where`.
    """
    if isinstance(content, entry):
        return content
    if not isinstance(content, dict):
        key = f"`{place(at)}`: " if at else ""
        raise error(f"{where}: {key}should be a mapping of keys, found {brief(content)}")
    try:
        parsed = entry.model_validate(content)
    except ValidationError as found:
        problems = [_problem(problem, entry, content, at) for problem in found.errors()]
        raise error(problems_line(where, problems)) from None
    for path, text in questions_below(parsed, at):
        warnings.warn(
            f"{where}: {place(path)}{'.' * bool(path)}{text}", PinfricWarning, stacklevel=2
        )
    return parsed


def _problem(problem: Any, entry: type[BaseModel], content: Any, at: tuple[int | str, ...]) -> str:
    """One pydantic problem as a text: key, what was found, what is allowed."""
    kind, found = problem["type"], brief(problem["input"])
    key = place((*at, *_path(problem["loc"], content, kind == "missing")))
    if kind == "extra_forbidden":
        section = _section_of(problem["loc"][-1], entry, problem["loc"][:-1])
        hint = f"it belongs under `{section}`" if section else problem["input"]
        return f"unknown key `{key}`; {hint}"
    field, classes = _key_at(entry, problem["loc"])
    example = _example(field, problem["loc"])
    if kind == "missing":
        words = () if field is None else get_args(field.annotation)
        several = len(words) > 1 and all(isinstance(word, str) for word in words)
        choice = f"; there are: {', '.join(words)}" if several else example
        return f"`{key}` is missing{choice}"
    if kind == "union_tag_not_found":
        meant = difflib.get_close_matches("kind", map(str, problem["input"]), n=1)
        kinds = [name for one in classes if issubclass(one, Entry) for name in one.kinds()]
        hints = ["is missing"]
        hints += [f"there are: {', '.join(kinds)}"] if kinds else []
        hints += [f"did you mean it by `{meant[0]}`?"] if meant else []
        return f"`{key}.kind` {'; '.join(hints)}"
    if kind == "union_tag_invalid":
        kinds = problem["ctx"]["expected_tags"].replace("'", "").split(", ")
        tag = problem["ctx"]["tag"]
        return f"`{key}.kind`: there is no {brief(tag)}; {choose_from(tag, kinds)}"
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        text = f"should be a mapping of keys, found {found}{example}"
    elif kind in ("tuple_type", "list_type"):
        text = f"should be a list, found {found}{example}"
    elif kind in ("too_short", "too_long"):
        text = f"has a wrong length, found {found}{example}"
    elif kind == "value_error":
        text = str(problem["ctx"]["error"])
    else:
        text = f"{plain(problem['msg'])}, found {found}"
    if comma := re.fullmatch(r"([-+]?\d*),(\d+)", str(problem["input"]).strip()):
        text += f"; decimals have a point: {comma[1]}.{comma[2]}"
    return f"`{key}`: {text}" if key else text


def _key_at(
    entry: type[BaseModel], loc: tuple[int | str, ...]
) -> tuple[FieldInfo | None, list[type[BaseModel]]]:
    """Return the field of a key, None if it is unknown, and the classes that it may be."""
    classes, field = [entry], None
    for number, key in enumerate(loc):
        owner = next((one for one in classes if key in one.model_fields), None)
        if owner is None:  # the name of a union's member, or a place in a list or a mapping
            field = field if number < len(loc) - 1 else None
            continue
        field = owner.model_fields[str(key)]
        classes = list(_entries_in(field.annotation))
    return field, classes


def _example(field: FieldInfo | None, loc: tuple[int | str, ...]) -> str:
    """Return "; e.g. {static: 0.15, kinetic: 0.1}" for a key that has an example, else ""."""
    if field is None or not field.examples:
        return ""
    return f"; e.g. {loc[-1]}: {yaml_line(field.examples[0])}"


def _section_of(name: Any, entry: type[BaseModel], loc: tuple[int | str, ...]) -> str:
    """Return the key of the section below that has this key, "" if none or several have it."""
    if loc:
        return ""
    homes = [
        key
        for key, field in entry.model_fields.items()
        if get_origin(field.annotation) not in (dict, list, tuple)
        and any(name in one.model_fields for one in _entries_in(field.annotation))
    ]
    return homes[0] if len(homes) == 1 else ""


def _entries_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the entries that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _entries_in(argument)
    for form in getattr(annotation, "forms", {}).values():
        yield from _entries_in(form)


def _path(loc: tuple[int | str, ...], content: Any, missing: bool) -> list[int | str]:
    """The keys that lead to a problem: pydantic's `loc` without the names of union members.

    `missing` says that the last part is a missing key.
    """
    path: list[int | str] = []
    for key in loc:
        inside = range(len(content)) if isinstance(content, list | tuple) else content
        if isinstance(inside, dict | range) and key in inside:
            path, content = [*path, key], content[key]
    return [*path, loc[-1]] if missing else path


#: Types of values without parts.
_PLAIN = frozenset((type(None), bool, int, float, str))


def unlikely(
    key: str, value: float | None, most: float, unit: str, hint: str = ""
) -> Iterator[str]:
    """Yield a warning if a magnitude is so unusual that its unit is probably wrong.

    Args:
        key: path below the entry, e.g. mu.static.
        most: the usual maximum.
        hint: the probable mistake; by default a wrong unit.
    """
    if value is not None and value > most:
        number, usual = (f"{x:g} {unit}".rstrip() for x in (value, most))
        yield f"{key} = {number}: {USUALLY} {usual}; {hint or 'check the unit'}"


def questions_below(
    node: Any, at: tuple[int | str, ...]
) -> Iterator[tuple[tuple[int | str, ...], str]]:
    """Yield the plausibility warnings of the entries at and below a place, each with its place."""
    if isinstance(node, Entry):
        yield from ((at, text) for text in node.questions())
    parts: Iterable[tuple[Any, Any]] = enumerate(node) if isinstance(node, list | tuple) else ()
    if isinstance(node, dict):
        parts = node.items()
    elif isinstance(node, BaseModel):
        parts, product = vars(node).items(), vars(node).get("installed")
        if product is not None:  # its figures are its maker's
            parts = [(name, value) for name, value in parts if name != "transmission"]
    for name, value in parts:
        if type(value) in _PLAIN:  # of most values; to ask pydantic's classes takes ten times it
            continue
        if isinstance(value, BaseModel | dict | list | tuple) and value:
            yield from questions_below(value, (*at, name))
