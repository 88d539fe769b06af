"""Parquet and MATLAB files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError
from pinfric.study.trajectory.log.frame import FEWEST, OpenedLog, arrays_log


def open_parquet(path: Path) -> OpenedLog:
    """Open a Parquet file; a column of time stamps counts as whole ns.

    Raises:
        TrajectoryError: damaged, no table, or pyarrow is missing.
    """
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        raise TrajectoryError(
            f"{path}: Parquet needs pyarrow: pip install 'pinfric[logs]'"
        ) from None
    try:
        frame = parquet.read_table(path).to_pandas()
    except (OSError, ValueError, KeyError) as problem:  # pyarrow's errors are ValueErrors, OSErrors
        reason = " ".join(str(problem).split())[:200]
        raise TrajectoryError(f"{path}: cannot be read as a Parquet file: {reason}") from None
    frame = frame.reset_index() if frame.index.name else frame
    columns: dict[str, NDArray[Any]] = {}
    units = {}
    for name in frame.columns:
        values = frame[name]
        if values.dtype.kind == "M":
            columns[str(name)] = values.to_numpy().astype("datetime64[ns]").astype(np.int64)
            units[str(name)] = "ns"
        elif values.dtype.kind in "iufb":
            columns[str(name)] = values.to_numpy()
    return arrays_log(columns, units)


def open_matlab(path: Path) -> OpenedLog:
    """Open a MATLAB file; rows or columns of arrays are named `struct.field_1` and on.

    Raises:
        TrajectoryError: damaged, of a version that SciPy does not read, no arrays.
    """
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise TrajectoryError(f"{path}: is of MATLAB's version 7.3; save it with -v7") from None
    except Exception as problem:  # zlib's, struct's, NumPy's: whatever a cut file ends in
        reason = " ".join(str(problem).split())[:200] or type(problem).__name__
        raise TrajectoryError(f"{path}: cannot be read as a MATLAB file: {reason}") from None
    arrays = dict(_matlab_arrays("", content))
    sizes = [max(x.shape) for x in arrays.values() if max(x.shape) >= FEWEST]
    count = max(sizes, key=lambda size: (sizes.count(size), size), default=0)
    columns: dict[str, NDArray[Any]] = {}
    for name, values in arrays.items():
        if values.shape == (count,):
            columns[name] = values
        elif values.ndim == 2 and count in values.shape:
            each = values if values.shape[1] == count else values.T
            columns |= {f"{name}_{i}": row for i, row in enumerate(each, 1)}
    if not columns:
        raise TrajectoryError(f"{path}: holds no arrays of numbers")
    return arrays_log(columns, {}, recorded=True)


def _matlab_arrays(prefix: str, content: Mapping[str, Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of numbers in variables and structs of structs."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            fields = {field: getattr(value, field) for field in value._fieldnames}
            yield from _matlab_arrays(f"{prefix}{name}.", fields)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb" and value.ndim in (1, 2):
            yield f"{prefix}{name}", value
