"""Versions of file formats."""

from __future__ import annotations

import pytest

from pinfric.errors import PinfricError
from pinfric.formats import FORMATS
from pinfric.model.entry import parse


@pytest.mark.parametrize("version", [True, 2, "1"])
@pytest.mark.parametrize("name", ["scene", "waypoints", "sweep", "motors", "catalog"])
def test_other_versions_are_refused(name, version):
    key = next(key for key in FORMATS[name].model_fields if key.startswith("pinfric"))
    with pytest.raises(PinfricError, match=f"`{key}`: (should be a number|should be 1)"):
        parse(FORMATS[name], {key: version}, "file", PinfricError)
