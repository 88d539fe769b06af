"""Entries of the files a user writes: what a key means, what a number is, what cannot be.

A key is a field with its meaning, an example and a unit beside its type:

    mass: Annotated[Positive, key("of the body", 2.0, "kg")]

JSON schemas and the reference show them, for pydantic keeps them with the field.
"""

from __future__ import annotations

import difflib
import math
import warnings
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal, TypeVar, Union, get_origin

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
from pinfric.model.yamlfile import brief


def key(text: str, example: Any, unit: str = "") -> Any:
    """Return what a key of a file means, as pydantic's field.

    Args:
        text: its meaning, read after its name.
        example: a value, as a file gives it.
        unit: empty where it has none, "1" of a ratio.
    """
    shown = f"{text} ({unit})" if unit else text
    return Field(description=shown, examples=[example], json_schema_extra={"unit": unit})


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
Vector3 = tuple[Number, Number, Number]


class Forms:
    """Several ways to write one value, told apart by its type, and mappings by their keys.

    Args:
        forms: first, of all that no other fits; entries for mappings, a tuple for lists, a
            `Literal` for words.
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
        """Return the form of a value; of several entries that with most of a mapping's keys."""
        found, *_ = self.forms
        if isinstance(value, dict):
            fitting = {
                tag: len(value.keys() & form.key_names())
                for tag, form in self.forms.items()
                if isinstance(form, type) and issubclass(form, Entry)
            }
            return max(fitting, key=fitting.__getitem__, default=found)
        written = _written_as(value)
        return written if written in self.forms else found


def _written_as(form: Any) -> str:
    """How a form or a value is written: the name of its entry, or a list, a word or a number."""
    kind = form if isinstance(form, type) else get_origin(form) or type(form)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind.__name__
    return {list: "list", tuple: "list", str: "word", Literal: "word"}.get(kind, "number")


class Entry(BaseModel):
    """Base of all sections: unknown keys are errors, nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @classmethod
    def key_names(cls) -> list[str]:
        """Return the keys a mapping may have."""
        return list(cls.model_fields)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, given: Any) -> Any:
        """Put what there is to choose from in place of the value of an unknown key.

        Pydantic refuses the key and gives that back. A key that is given was not meant.
        """
        if not isinstance(given, dict):
            return given
        names = cls.key_names()
        return {
            name: value if name in names else choose_from(name, names, given)
            for name, value in given.items()
        }

    def questions(self) -> Iterator[str]:
        """Yield what to ask about values of this entry alone: `unlikely` of each; `parse` warns."""
        yield from ()


_Kind = TypeVar("_Kind", bound=BaseModel)


def place(path: Iterable[int | str]) -> str:
    """Return how messages name a place in a file, e.g. actuators[1].transmission.ratio."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).removeprefix(".")


def parse(
    entry: type[_Kind],
    content: Any,
    where: str,
    error: type[PinfricError] = SceneError,
    at: tuple[int | str, ...] = (),
) -> _Kind:
    """Validate `content` as `entry`; all problems in one error that begins with `where`.

    What entries ask (`Entry.questions`) comes as warnings that begin with `where`, too.

    Args:
        entry: what it should be.
        content: a mapping, or such an entry.
        where: the file.
        error: what is raised.
        at: the place of `content` in the file.
    """
    if isinstance(content, entry):
        return content
    if not isinstance(content, dict):
        key = f"`{place(at)}`: " if at else ""
        raise error(f"{where}: {key}should be a mapping of keys, found {brief(content)}")
    try:
        made = entry.model_validate(content)
    except ValidationError as found:
        problems = [_problem(problem, content, at) for problem in found.errors()]
        raise error(problems_line(where, problems)) from None
    for path, text in _questions(made, at):
        warnings.warn(
            f"{where}: {place(path)}{'.' * bool(path)}{text}", PinfricWarning, stacklevel=2
        )
    return made


def _problem(problem: Any, content: Any, at: tuple[int | str, ...]) -> str:
    """One pydantic problem in our words: place, what was found, what is allowed."""
    kind, found = problem["type"], brief(problem["input"])
    key = place((*at, *_path(problem["loc"], content, kind == "missing")))
    if kind == "extra_forbidden":
        return f"unknown key `{key}`; {problem['input']}"
    if kind == "missing":
        return f"`{key}` is missing"
    if kind == "union_tag_not_found":
        meant = difflib.get_close_matches("kind", map(str, problem["input"]), n=1)
        return f"`{key}.kind` is missing" + (f"; did you mean it by `{meant[0]}`?" if meant else "")
    if kind == "union_tag_invalid":
        kinds = problem["ctx"]["expected_tags"].replace("'", "").split(", ")
        tag = problem["ctx"]["tag"]
        return f"`{key}.kind`: there is no {brief(tag)}; {choose_from(tag, kinds)}"
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        text = f"should be a mapping of keys, found {found}"
    elif kind in ("tuple_type", "list_type"):
        text = f"should be a list, found {found}"
    elif kind in ("too_short", "too_long"):
        text = f"has a wrong length, found {found}"
    elif kind == "value_error":
        text = str(problem["ctx"]["error"])
    else:
        text = f"{plain(problem['msg'])}, found {found}"
    return f"`{key}`: {text}" if key else text


def _path(loc: tuple[int | str, ...], content: Any, missing: bool) -> list[int | str]:
    """The keys on the way to a problem, without the members of unions, which no file names.

    Args:
        loc: pydantic's, both among it.
        content: what was read.
        missing: whether the last part is a key that is not there.
    """
    path: list[int | str] = []
    for part in loc:
        inside = range(len(content)) if isinstance(content, list | tuple) else content
        if isinstance(inside, dict | range) and part in inside:
            path, content = [*path, part], content[part]
    return [*path, loc[-1]] if missing else path


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


def _questions(made: Any, at: tuple[int | str, ...]) -> Iterator[tuple[tuple[int | str, ...], str]]:
    """What the entries at and below a place ask about what they hold, each with its place."""
    if isinstance(made, Entry):
        yield from ((at, text) for text in made.questions())
    if isinstance(made, BaseModel | dict):
        parts: Iterable[tuple[Any, Any]] = made.items() if isinstance(made, dict) else made
    else:
        parts = enumerate(made) if isinstance(made, list | tuple) else ()
    for name, part in parts:
        yield from _questions(part, (*at, name))
