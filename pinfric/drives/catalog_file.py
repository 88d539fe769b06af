"""Read catalogues: a YAML file, or a folder of files and tables, as the bundled one is."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from pinfric.drives.catalog import SECTIONS, Catalog, CatalogFile
from pinfric.drives.doubts import doubts
from pinfric.drives.kinds import KindSections
from pinfric.drives.policy import Conditions
from pinfric.drives.sourced import Sourced
from pinfric.drives.table import import_table, mapping_of
from pinfric.errors import CatalogError, PinfricWarning, choose_from
from pinfric.model.brief import counted
from pinfric.model.entry import parse
from pinfric.model.yamlfile import brief, path_of, read_yaml

#: The bundled catalogue's name, and its folder.
DEFAULT = "default"
_FOLDER = Path(__file__).parents[1] / "catalog"


def load_catalog(name: str | Path = DEFAULT) -> Catalog:
    """Read a catalogue: a YAML file, a folder, or "default" for the bundled one.

    A file with `extends: default` has the bundled entries, too: its own replace those of the same
    name. Of a folder all catalogues (YAML) and tables (CSV, each with its mapping beside it) are
    one.

    Raises:
        CatalogError: it cannot be read, has unknown keys or figures that cannot be.

    Warns:
        PinfricWarning: a figure is so unusual that a wrong unit is likelier; an entry replaces a
            bundled one of its name.
    """
    name = path_of(name, CatalogError)
    if str(name) == DEFAULT and not os.path.isfile(name):
        catalog = replace(_merged(DEFAULT, _bundled()), files=(str(_FOLDER),))
        doubted: Iterable[tuple[str, str]] = _bundled_doubts()
    else:
        own = _of_folder(name) if os.path.isdir(name) else (_read(name),)
        extends = any(file.extends for file in own)
        if not extends and not any(getattr(f, section) for f in own for section in SECTIONS):
            named = [*SECTIONS]
            raise CatalogError(
                f"{name}: no {', '.join(named[:-1])} or {named[-1]} in it; "
                "`extends: default` takes the bundled ones"
            )
        bundled = _bundled() if extends else ()
        replaced = tuple(text for file in own for text in _replaced(bundled, file))
        files = (*([str(_FOLDER)] if bundled else []), str(name))
        catalog = replace(_merged(str(name), [*bundled, *own]), replaced=replaced, files=files)
        for text in replaced:
            warnings.warn(f"{name}: {text}", PinfricWarning, stacklevel=2)
        doubted = doubts(catalog)
    for where, text in doubted:
        warnings.warn(f"{catalog.source}: {where}: {text}", PinfricWarning, stacklevel=2)
    return catalog


@cache
def _bundled() -> tuple[CatalogFile, ...]:
    return _of_folder(_FOLDER)


@cache
def _bundled_doubts() -> tuple[tuple[str, str], ...]:
    return tuple(doubts(_merged(DEFAULT, _bundled())))


def _of_folder(folder: Path) -> tuple[CatalogFile, ...]:
    """The catalogues of a folder, tables after files, with the same figures for every entry."""
    tables = sorted(folder.glob("*.csv"))
    mappings = {mapping_of(table) for table in tables}
    own = [path for path in sorted(folder.glob("*.yaml")) if path not in mappings]
    files = {path: _read(path) for path in own}
    for table in tables:
        imported = import_table(table)
        if imported.left_out:
            first, *others = imported.left_out
            more = f" (and {counted(len(others), 'row')} more: `pinfric catalog`)" if others else ""
            warnings.warn(f"{table}: left out: {first}{more}", PinfricWarning, stacklevel=3)
        # each row is validated already
        files[table] = CatalogFile(pinfric_catalog=1).model_copy(
            update={imported.section: imported.entries}
        )
    known: dict[tuple[str, str], tuple[Path, Sourced]] = {}
    for path, file in files.items():
        for section in SECTIONS:
            for name, entry in getattr(file, section).items():
                other, same = known.setdefault((section, name), (path, entry))
                if same is not entry and same != entry:
                    raise CatalogError(
                        f"{folder}: {section}.{name}: its figures in {other.name} and in "
                        f"{path.name} differ; keep one of them"
                    )
    return tuple(files.values())


def _merged(source: str, files: Sequence[CatalogFile]) -> Catalog:
    """All entries; of one name, and of the conditions, the last file's."""
    stated = [file.conditions for file in files if file.conditions is not None]
    entries: dict[str, Any] = {
        section: {name: entry for file in files for name, entry in getattr(file, section).items()}
        for section in SECTIONS
    }
    entries["kinds"] = {
        n: x for section in KindSections.model_fields for n, x in entries.pop(section).items()
    }
    belts = {name: belt.gear for name, belt in entries.pop("belts").items()}
    entries["gears"] = belts | entries["gears"]
    return Catalog(source, **entries, conditions=stated[-1] if stated else Conditions())


def _replaced(bundled: Sequence[CatalogFile], file: CatalogFile) -> Iterator[str]:
    for section in SECTIONS:
        there = {name for other in bundled for name in getattr(other, section)}
        for name in getattr(file, section):
            if name in there:
                yield f"{section}.{name} replaces the bundled entry of that name"


def _read(path: Path) -> CatalogFile:
    if not os.path.exists(path) and path.suffix not in (".yaml", ".yml"):
        raise CatalogError(
            f"there is no catalogue {brief(str(path))}; "
            f"{choose_from(path, [DEFAULT])}, a YAML file, or a folder of them and of tables"
        )
    return _parsed(read_yaml(path, CatalogError, "pinfric_catalog"), path)


def _parsed(content: dict[str, Any], path: Path) -> CatalogFile:
    return parse(CatalogFile, content, str(path), CatalogError)
