"""Entries of the files a user writes: what a number is, and what is said of one that cannot be.

What a key means stands in the section `Attributes` of its class: name (unit): text, e.g. example.
Reference pages and JSON schemas are made of it (`documented`).
"""

from __future__ import annotations

import inspect
import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from pinfric.errors import PinfricError, PinfricWarning, SceneError, choose_from, problems_line
from pinfric.model.magnitudes import LARGEST, SMALLEST
from pinfric.model.yamlfile import brief


def strict_number(value: Any) -> Any:
    """Refuse what pydantic would silently turn into a number, and what no machine has."""
    if isinstance(value, bool | str):
        raise ValueError(f"should be a number, found {brief(value)}")
    if isinstance(value, int | float) and LARGEST < abs(value) < math.inf:
        raise ValueError(f"should be at most {LARGEST:g} in magnitude, found {brief(value)}")
    return value


def not_vanishing(value: float) -> float:
    """Refuse what is not 0 but smaller than any machine's."""
    if 0 < value < SMALLEST:
        raise ValueError(f"should be at least {SMALLEST:g}, found {value:g}")
    return value


Number = Annotated[FiniteFloat, BeforeValidator(strict_number)]
NonNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0), AfterValidator(not_vanishing)]
#: The version of a file's format; `true`, which Python takes for 1, is none.
Version = Annotated[Literal[1], BeforeValidator(strict_number)]
#: What every question of an entry says; its reader may ask for it.
USUALLY = "usually at most"
#: What reads the value of a key, before pydantic checks its type.
Reader = Callable[[Any], Any]


def number_or(entry: Reader, number: Any, made: Reader = lambda x: x) -> Reader:
    """Return what reads a mapping as `entry` says, anything else as `made` of a number.

    Decided here, an error names the one form that was meant, not every member of a union.

    Args:
        entry: reads a mapping.
        number: the annotation of numbers.
        made: of a valid number.
    """
    adapter = TypeAdapter(number)

    def read(value: Any) -> Any:
        if value is None or isinstance(value, Entry):
            return value
        return entry(value) if isinstance(value, dict) else made(adapter.validate_python(value))

    return read


Vector3 = tuple[Number, Number, Number]


class Entry(BaseModel):
    """Base of all sections: unknown keys are errors, nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def keys_and_kinds(cls) -> dict[str, Any]:
        """Return the keys a mapping may have, and the annotation of what stands there."""
        return {key: field.annotation for key, field in cls.model_fields.items()}

    def questions(self) -> Iterator[str]:
        """Yield what to ask about values of this entry alone: `unlikely` of each; `parse` warns."""
        yield from ()

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Add to the schema what the class says of its keys."""
        schema = handler(core)
        cls.describe_keys(handler.resolve_ref_schema(schema))
        return schema

    @classmethod
    def describe_keys(cls, schema: JsonSchemaValue) -> JsonSchemaValue:
        """Write what the class says of its keys into its JSON schema, and return it."""
        schema["description"] = _text(cls).partition("\n\nAttributes:")[0]
        for name, key in documented(cls).items():
            shown = schema["properties"].get(name, {})
            shown |= {"description": key.shown, "examples": [key.example], "unit": key.unit}
            if shown.get("default") in (math.inf, None):  # JSON has no infinity
                shown.pop("default", None)
        return schema


class Key(NamedTuple):
    """What a class says of one of its keys.

    Attributes:
        text: its meaning. unit: empty where it has none, "1" of a ratio.
        example: a value, as a file gives it.
    """

    text: str
    unit: str
    example: Any

    @property
    def shown(self) -> str:
        """Meaning and unit in one text."""
        return f"{self.text} ({self.unit})" if self.unit else self.text


_KEY = re.compile(r"    (\w+)(?: \((.+?)\))?: (.+),\s+e\.g\.\s+(.+)", re.DOTALL)


def _text(cls: type[BaseModel]) -> str:
    return inspect.cleandoc(vars(cls).get("__doc__") or "")


def documented(entry: type[BaseModel]) -> dict[str, Key]:
    """Return what a class and its bases say of its keys, by name."""
    found: dict[str, Key] = {}
    for cls in reversed(entry.__mro__):
        if issubclass(cls, BaseModel):
            section = _text(cls).partition("\n\nAttributes:\n")[2]
            for item in re.split(r"\n(?=    \S)", section):
                if match := _KEY.fullmatch(item):
                    name, unit, *texts = match.groups()
                    meaning, example = (" ".join(text.split()) for text in texts)
                    found[name] = Key(meaning, unit or "", yaml.safe_load(example))
    return found


_Kind = TypeVar("_Kind", bound=BaseModel)


def parse(
    entry: type[_Kind], content: Any, where: str, error: type[PinfricError] = SceneError
) -> _Kind:
    """Validate `content` as `entry`; all problems in one error that begins with `where`.

    What entries ask (`Entry.questions`) comes as warnings that begin with `where`, too.
    """
    if isinstance(content, entry):
        return content
    if not isinstance(content, dict):
        raise error(f"{where}: should be a mapping of keys, found {brief(content)}")
    try:
        made = entry.model_validate(content)
    except ValidationError as found:
        problems = [_problem(entry, problem) for problem in found.errors()]
        raise error(problems_line(where, problems)) from None
    for text in _questions(made, ""):
        warnings.warn(f"{where}: {text}", PinfricWarning, stacklevel=2)
    return made


def _problem(entry: type[BaseModel], problem: Any) -> str:
    """One pydantic problem in our words: key path, what was found, what is allowed."""
    path = [str(part) for part in problem["loc"] if not _is_union_tag(part)]
    key = ".".join(path)
    if problem["type"] == "extra_forbidden":
        allowed = _fields_at(entry, problem["loc"][:-1])
        return f"unknown key `{key}`; {choose_from(path[-1], allowed)}"
    if problem["type"] == "missing":
        return f"`{key}` is missing"
    if problem["type"] in ("model_type", "dict_type", "model_attributes_type"):
        text = f"should be a mapping of keys, found {brief(problem['input'])}"
    elif problem["type"] in ("tuple_type", "list_type"):
        text = f"should be a list, found {brief(problem['input'])}"
    elif problem["type"] in ("too_short", "too_long"):
        text = f"has a wrong length, found {brief(problem['input'])}"
    elif problem["type"] == "value_error":
        text = str(problem["ctx"]["error"])
    else:
        text = f"{problem['msg'][0].lower()}{problem['msg'][1:]}, found {brief(problem['input'])}"
    return f"`{key}`: {text}" if key else text


def _is_union_tag(part: int | str) -> bool:
    return isinstance(part, str) and part in {
        "SineEffort",
        "TableEffort",
        "CoulombFriction",
        "DirectedCoulombFriction",
        "constrained-float",
        "finite-float",
        "function-before[strict_number(), finite-float]",
    }


def _fields_at(entry: type[BaseModel], path: tuple[int | str, ...]) -> list[str]:
    """The keys allowed where `path` leads, by walking the annotations."""
    current: Any = entry
    for part in path:
        found = _step(current, part)
        if found is None:
            return []
        current = found
    models = _models_in(current)
    return [key for model in models for key in model.keys_and_kinds()]


def _step(current: Any, part: int | str) -> Any:
    for model in _models_in(current):
        if part in model.keys_and_kinds():
            return model.keys_and_kinds()[str(part)]
        if model.__name__ == part:
            return model
    return current  # an index into a list or a name in a mapping: the annotation covers it


def _models_in(annotation: Any) -> list[type[Entry]]:
    if isinstance(annotation, type) and issubclass(annotation, Entry):
        return [annotation]
    return [model for arg in getattr(annotation, "__args__", ()) for model in _models_in(arg)]


def unlikely(
    key: str, value: float | None, most: float, unit: str, hint: str = ""
) -> Iterator[str]:
    """Yield what to say where a magnitude is possible but so unusual that a wrong unit is likelier.

    Args:
        key: below the entry that asks, e.g. mu.static.
        value, most, unit: what is there, and what it usually is at most.
        hint: what may have gone wrong; by default, that the unit may be wrong.
    """
    if value is not None and value > most:
        number, usual = (f"{x:g} {unit}".rstrip() for x in (value, most))
        yield f"{key} = {number}: {USUALLY} {usual}; {hint or 'check the unit'}"


def _questions(made: Any, path: str) -> Iterator[str]:
    """What the entries at and below a path ask about what they hold, each key with its path."""
    if isinstance(made, Entry):
        yield from (f"{path}{text}" for text in made.questions())
    if isinstance(made, BaseModel | dict):
        parts: Iterable[tuple[Any, Any]] = made.items() if isinstance(made, dict) else made
    else:
        parts = enumerate(made) if isinstance(made, list | tuple) else ()
    for key, part in parts:
        yield from _questions(part, f"{path}{key}.")
