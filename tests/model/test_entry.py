"""Entries of files: every problem at once, any value read or refused in one line."""

import re

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from schema_cases import WHOLE, anything, with_change

from pinfric.errors import SceneError
from pinfric.model.bearings import KINDS, Bearing
from pinfric.model.entry import parse
from pinfric.model.schema import Friction, SceneFile


@pytest.mark.parametrize("kind", ["pin", "guide", "linear", "ball"])
def test_every_key_of_a_bearing_is_used_by_a_kind(kind):
    fields = KINDS[kind].model_fields.items()
    needed = {key: 0.1 for key, field in fields if field.is_required() and key != "kind"}
    more = {"radial": 0.1} if kind == "linear" else {}
    Bearing.model_validate({"kind": kind, **needed, **more})
    for key in needed:
        rest = {k: v for k, v in needed.items() if k != key}
        with pytest.raises(SceneError, match=f"x: `{key}` is missing"):
            parse(Bearing, {"kind": kind, **rest, **more}, "x")


def every_path(content, path=()):
    items = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from every_path(value, (*path, key))


@pytest.mark.slow
@settings(max_examples=400, deadline=None)
@given(path=st.sampled_from(list(every_path(WHOLE))), value=anything)
@pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
def test_any_value_anywhere_is_read_or_refused_in_one_line(path, value):
    try:
        parse(SceneFile, with_change(path, value), "scene.yaml")
    except SceneError as error:
        message = str(error)
    else:
        message = "scene.yaml: read"
    assert message.startswith("scene.yaml: ")
    assert not re.search(r"pydantic|function-|constrained|finite-float|\[_|Friction", message)


@settings(max_examples=100, deadline=None)
@given(
    kinetic=st.floats(0, 2),
    more=st.floats(0, 1),
    radius=st.floats(0, 0.9),
    length=st.none() | st.floats(1e-6, 0.9),
    viscous=st.floats(0, 10, exclude_min=True),
)
@pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
def test_what_is_written_is_what_is_read(kinetic, more, radius, length, viscous):
    bearing = {"kind": "pin", "radius": radius}
    if length is not None:
        bearing["length"] = length
    written = {
        "bearing": bearing,
        "mu": {"static": kinetic + more, "kinetic": kinetic},
        "viscous": viscous,
    }
    entry = parse(Friction, yaml.safe_load(yaml.safe_dump(written)), "x")
    written["viscous"] = {"coefficient": viscous}  # which a number stands for
    assert entry.model_dump(exclude_unset=True) == written
