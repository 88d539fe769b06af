"""Formats of logs, found by the ends of their files' names.

A new one is a function from a path to an `OpenedLog` with `opens` above it, in a module of this
folder.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pinfric.errors import TrajectoryError
from pinfric.model.neighbours import import_neighbours
from pinfric.motions.log.frame import OpenedLog

_Open = TypeVar("_Open", bound=Callable[..., OpenedLog])
#: End of a name -> what opens the file.
_KNOWN: dict[str, Callable[..., OpenedLog]] = {}
#: Endings of files that are not read -> what they are, and what makes a log of them.
_CONVERTED = {
    (".h5", ".hdf5", ".hdf"): (
        "HDF5",
        "import h5py, numpy; d = {}; h5py.File('log.h5').visititems(lambda name, x: "
        "d.update({name: x[()]}) if hasattr(x, 'dtype') and x.dtype.kind in 'fiu' else None); "
        "numpy.savez('log.npz', **d)",
    ),
    (".feather", ".arrow"): (
        "Arrow",
        "import pandas; pandas.read_feather('log.feather').to_parquet('log.parquet')",
    ),
    (".xlsx", ".xls", ".ods"): ("a spreadsheet", "save the sheet as CSV"),
    (".npy", ".pkl", ".pickle"): (
        "an array without names",
        "import numpy; numpy.savez('log.npz', t=TIMES, JOINT=POSITIONS)",
    ),
}


def opens(*endings: str) -> Callable[[_Open], _Open]:
    """Let a function open the files whose names end so."""

    def register(open_: _Open) -> _Open:
        _KNOWN.update(dict.fromkeys(endings, open_))
        return open_

    return register


def opener(path: Path) -> Callable[..., OpenedLog]:
    """Return what opens a file.

    Raises:
        TrajectoryError: no format's files end so.
    """
    import_neighbours(__name__)
    name = path.name.lower()
    for ending, found in _KNOWN.items():
        if name.endswith(ending):
            return found
    for endings, (kind, conversion) in _CONVERTED.items():
        if name.endswith(endings):
            raise TrajectoryError(f"{path}: is {kind}, which is not read; convert it: {conversion}")
    known = ", ".join(sorted(_KNOWN))
    raise TrajectoryError(
        f"{path}: a trajectory ends in .csv, .yaml or .yml; a log in {known}; write another format "
        "as CSV"
    )
