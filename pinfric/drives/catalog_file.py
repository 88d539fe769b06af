"""Read catalogues: a YAML file, or the bundled one, which is a folder of files and tables.

A file with `extends: default` adds to the bundled catalogue: its entries go before bundled ones of
the same name, its conditions apply.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from pinfric.drives.catalog import Catalog, CatalogFile
from pinfric.drives.doubts import doubts
from pinfric.drives.policy import Conditions
from pinfric.drives.table import import_table, mapping_of
from pinfric.errors import CatalogError, PinfricWarning, choose_from
from pinfric.model.entry import parse
from pinfric.model.yamlfile import brief, read_yaml

#: The bundled catalogue's name, and its folder.
DEFAULT = "default"
_FOLDER = Path(__file__).parents[1] / "catalog"
_SECTIONS = ("motors", "gears", "gearmotors", "bearings", "brakes", "amplifiers")


def load_catalog(name: str | Path = DEFAULT) -> Catalog:
    """Read a catalogue: a YAML file, or "default" for the bundled motors, gears and bearings.

    A file that says `extends: default` has the bundled entries beside its own.

    Args:
        name: the file.

    Raises:
        CatalogError: it cannot be read, has unknown keys or figures that cannot be.

    Warns:
        PinfricWarning: a figure is so unusual that a wrong unit is likelier; an entry replaces a
            bundled one of its name.
    """
    if str(name) == DEFAULT and not os.path.isfile(name):
        catalog = replace(_merged(DEFAULT, _bundled()), files=(str(_FOLDER),))
    else:
        file = _read(Path(name))
        if file.extends is None and not any(getattr(file, section) for section in _SECTIONS):
            raise CatalogError(
                f"{name}: no motors, gears, gearmotors, bearings, brakes or amplifiers in it; "
                "`extends: default` takes the bundled ones"
            )
        bundled = _bundled() if file.extends else ()
        replaced = tuple(_replaced(bundled, file))
        files = (*([str(_FOLDER)] if bundled else []), str(name))
        catalog = replace(_merged(str(name), [*bundled, file]), replaced=replaced, files=files)
        for text in replaced:
            warnings.warn(f"{name}: {text}", PinfricWarning, stacklevel=2)
    for where, text in doubts(catalog):
        warnings.warn(f"{catalog.source}: {where}: {text}", PinfricWarning, stacklevel=2)
    return catalog


@cache
def _bundled() -> tuple[CatalogFile, ...]:
    tables = sorted(_FOLDER.glob("*.csv"))
    mappings = {mapping_of(table) for table in tables}
    files = [_read(path) for path in sorted(_FOLDER.glob("*.yaml")) if path not in mappings]
    return *files, *(_parsed(import_table(table), table) for table in tables)


def _merged(source: str, files: Sequence[CatalogFile]) -> Catalog:
    """All entries of the files; of the same name, and of the conditions, the last file's."""
    entries: dict[str, Any] = {
        section: {name: entry for file in files for name, entry in getattr(file, section).items()}
        for section in _SECTIONS
    }
    return Catalog(source, **entries, conditions=files[-1].conditions or Conditions())


def _replaced(bundled: Sequence[CatalogFile], file: CatalogFile) -> Iterator[str]:
    """Say which bundled entries a file's own take the place of."""
    for section in _SECTIONS:
        there = {name for other in bundled for name in getattr(other, section)}
        for name in getattr(file, section):
            if name in there:
                yield f"{section}.{name} replaces the bundled entry of that name"


def _read(path: Path) -> CatalogFile:
    if not os.path.exists(path) and path.suffix not in (".yaml", ".yml"):
        raise CatalogError(
            f"there is no catalogue {brief(str(path))}; "
            f"{choose_from(path, [DEFAULT])}, or a YAML file"
        )
    return _parsed(read_yaml(path, CatalogError, "pinfric_catalog"), path)


def _parsed(content: dict[str, Any], path: Path) -> CatalogFile:
    return parse(CatalogFile, content, str(path), CatalogError)
