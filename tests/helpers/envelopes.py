"""Output of `--json`, held against the schema of `pinfric schema result`."""

import json
from functools import cache

from jsonschema import Draft202012Validator

from pinfric.cli import result_classes
from pinfric.show.report.envelope import result_schema


@cache
def validators() -> dict[str, list[Draft202012Validator]]:
    """Of each command's envelopes: one where `oneOf` has one, so that errors name the key."""
    schema = result_schema(result_classes())
    Draft202012Validator.check_schema(schema)
    found: dict[str, list[Draft202012Validator]] = {}
    for kind in schema["oneOf"]:
        own = Draft202012Validator({**kind, "$defs": schema["$defs"]})
        found.setdefault(kind["properties"]["command"]["const"], []).append(own)
    return found


def validated(text: str) -> dict:
    """The envelope in a command's output."""
    envelope = json.loads(text)
    errors = [list(kind.iter_errors(envelope)) for kind in validators()[envelope["command"]]]
    fewest = min(errors, key=len)
    assert not fewest, [(list(error.absolute_path), error.message[:200]) for error in fewest[:3]]
    return envelope


def result_of(text: str) -> dict:
    """The result in a command's output."""
    return validated(text)["result"]
