"""The formats of files that users write, and their JSON schemas for editors."""

from __future__ import annotations

import math
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from pinfric.drives.catalog import CatalogFile
from pinfric.drives.table import TableMapping
from pinfric.errors import PinfricError, choose_from
from pinfric.model.entry import Entry
from pinfric.model.schema import SceneFile
from pinfric.motions.log.columns import ColumnsFile
from pinfric.motions.waypoints import WayPointFile
from pinfric.retiming.limits import MotorsFile
from pinfric.sweeps.file import SweepFile

FORMATS: dict[str, type[Entry]] = {
    "scene": SceneFile,
    "waypoints": WayPointFile,
    "columns": ColumnsFile,
    "sweep": SweepFile,
    "motors": MotorsFile,
    "catalog": CatalogFile,
    "table": TableMapping,
}


class _InOrder(GenerateJsonSchema):
    """Keeps keys in the order of the class's fields."""

    def sort(self, value: JsonSchemaValue, parent_key: str | None = None) -> JsonSchemaValue:
        return value


_BOUNDS = {"ge": "minimum", "gt": "exclusiveMinimum", "le": "maximum", "lt": "exclusiveMaximum"}


def json_schema(name: str) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of a format, registered kinds included.

    Args:
        name: of `FORMATS`.

    Raises:
        PinfricError: there is no such format.
    """
    if name not in FORMATS:
        raise PinfricError(f"there is no format {name!r}; {choose_from(name, FORMATS)}")
    form: dict[str, Any] = _in_its_words(FORMATS[name].model_json_schema(schema_generator=_InOrder))
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **form}


def _in_its_words(schema: Any) -> Any:
    """Rename pydantic's bounds to JSON schema's; drop titles that repeat the key, and infinite
    defaults.
    """
    if isinstance(schema, list):
        return [_in_its_words(entry) for entry in schema]
    if not isinstance(schema, dict):
        return schema
    plain = {
        key: value
        for key, value in schema.items()
        if not (key == "title" and isinstance(value, str) and schema.get("type") != "object")
        and not (key == "default" and value in (None, math.inf))
    }
    return {_BOUNDS.get(key, key): _in_its_words(value) for key, value in plain.items()}
