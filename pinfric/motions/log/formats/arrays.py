"""Files of arrays: Parquet, MATLAB, NumPy, JSON and JSON lines."""

from __future__ import annotations

import json
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinfric.errors import TrajectoryError
from pinfric.model.yamlfile import NOT_UTF_8, refuse_result
from pinfric.motions.log.formats.registry import opens
from pinfric.motions.log.frame import FEWEST, MOST_BYTES, OpenedLog, arrays_log, check_size

#: Keys of a file under which the joints' names stand.
_NAMES = {"name", "names", "joint_names", "joints"}
#: Bytes that are decompressed at a time.
_PART = 2**20


@opens(".parquet")
def open_parquet(path: Path) -> OpenedLog:
    """Open a Parquet file; times, of any zone, count as whole ns; lists of numbers are columns.

    Raises:
        TrajectoryError: damaged, too large, no rows, names twice, or pyarrow is missing.
    """
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        raise TrajectoryError(
            f"{path}: Parquet needs pyarrow: pip install 'pinfric[logs]'"
        ) from None
    try:
        with path.open("rb") as opened, parquet.ParquetFile(opened) as file:
            kinds = {field.name: _arrow_type(field.type) for field in file.schema_arrow}
            twice = len(kinds) < len(file.schema_arrow)
            used = [name for name, kind in kinds.items() if kind is not None]
            rows = file.metadata.num_rows
            check_size(path, rows, len(used))
            columns = {
                name: _arrow_numbers(file.read([name]).column(name).cast(kinds[name]), kinds[name])
                for name in (() if twice else used)
            }
            lists = [field.name for field in file.schema_arrow if _is_list(field.type)]
            for name in () if twice else lists:
                columns |= _arrow_lists(name, file.read([name]).column(name))
    except (OSError, ValueError, KeyError) as problem:  # pyarrow's errors are ValueErrors, OSErrors
        reason = " ".join(str(problem).split())[:200]
        raise TrajectoryError(f"{path}: cannot be read as a Parquet file: {reason}") from None
    if twice:
        raise TrajectoryError(f"{path}: two columns have the same name; names must differ")
    if not rows:
        raise TrajectoryError(f"{path}: has no rows")
    units = {name: "ns" for name in used if str(kinds[name]).endswith("[ns]")}
    return arrays_log(columns, units)


def _arrow_type(kind: Any) -> Any:
    """The type to which a column of numbers or times is cast; None: neither."""
    import pyarrow as pa

    if pa.types.is_timestamp(kind):
        return pa.timestamp("ns")
    if pa.types.is_duration(kind):
        return pa.duration("ns")
    if pa.types.is_decimal(kind):
        return pa.float64()
    plain = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)
    return kind if plain else None


def _is_list(kind: Any) -> bool:
    """Whether a column holds lists of numbers, as LeRobot's `observation.state`."""
    import pyarrow as pa

    lists = pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind)
    return bool(lists and _arrow_type(kind.value_type) is not None)


def _arrow_lists(name: str, column: Any) -> dict[str, NDArray[Any]]:
    """Columns `name_0` and on of lists of equal length; else none."""
    rows = column.to_pylist()
    lengths = {len(row) for row in rows if row is not None}
    if len(lengths) != 1 or not (width := lengths.pop()):
        return {}
    values = np.array([row or [None] * width for row in rows], dtype=np.float64)
    return {f"{name}_{i}": each for i, each in enumerate(values.T)}


def _arrow_numbers(column: Any, kind: Any) -> NDArray[Any]:
    """A column's numbers, NaN where none; times with gaps from the first one on."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if str(kind).endswith("[ns]"):
        column = column.cast(pa.int64())
        if column.null_count:  # a float would round the ns since 1970
            column = pc.subtract(column, pc.min(column))
    values: NDArray[Any] = column.to_numpy()
    return values


@opens(".mat")
def open_matlab(path: Path) -> OpenedLog:
    """Open a MATLAB file; rows or columns of arrays are named `struct.field_1` and on.

    Raises:
        TrajectoryError: damaged, of a version that SciPy does not read, too large, no arrays.
    """
    from scipy.io import loadmat

    check_size(path, 0, inflated=_inflated(path))
    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise TrajectoryError(f"{path}: is of MATLAB's version 7.3; save it with -v7") from None
    except Exception as problem:  # zlib's, struct's, NumPy's: whatever a cut file ends in
        reason = " ".join(str(problem).split())[:200] or type(problem).__name__
        raise TrajectoryError(f"{path}: cannot be read as a MATLAB file: {reason}") from None
    return _arrays_opened(path, dict(_matlab_arrays("", content)))


@opens(".npz")
def open_numpy(path: Path) -> OpenedLog:
    """Open a file of `np.savez`; rows or columns of arrays are named as those of MATLAB files.

    Raises:
        TrajectoryError: damaged, too large, no arrays of numbers.
    """
    try:
        with zipfile.ZipFile(path) as parts:
            check_size(path, 0, inflated=sum(member.file_size for member in parts.infolist()))
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
    except Exception as problem:  # zipfile, zlib, struct, NumPy have a dozen for damaged files
        reason = " ".join(str(problem).split())[:200] or type(problem).__name__
        raise TrajectoryError(f"{path}: cannot be read as a NumPy file: {reason}") from None
    return _mapping_opened(path, arrays)


@opens(".json")
def open_json(path: Path) -> OpenedLog:
    """Open a JSON file: arrays by name, or a list of records.

    Raises:
        TrajectoryError: damaged, too large, no arrays of numbers, names of joints that change.
    """
    try:
        check_size(path, 0, inflated=path.stat().st_size)
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as problem:
        reason = " ".join(str(problem).split())[:200]
        raise TrajectoryError(f"{path}: cannot be read as JSON: {reason}") from None
    content = _by_key(content) if _is_records(content) else content
    content = content if isinstance(content, dict) else {}
    refuse_result(path, content, TrajectoryError)
    return _mapping_opened(path, content)


@opens(".jsonl", ".ndjson")
def open_json_lines(path: Path) -> OpenedLog:
    """Open a file with one JSON record a line.

    Raises:
        TrajectoryError: a line that is no record, and as `open_json`.
    """
    try:
        check_size(path, 0, inflated=path.stat().st_size)
        lines = path.read_text(encoding="utf-8-sig").split("\n")
    except UnicodeDecodeError:
        raise TrajectoryError(f"{path}: {NOT_UTF_8}") from None
    except OSError as problem:
        raise TrajectoryError(f"{path}: cannot be read: {problem.strerror}") from None
    records = [_record(path, n, line) for n, line in enumerate(lines, 1) if line.strip()]
    if not records:
        raise TrajectoryError(f"{path}: has no records")
    return _mapping_opened(path, _by_key(records))


def _record(path: Path, number: int, line: str) -> dict[str, Any]:
    """The mapping that a line of a file holds."""
    try:
        record = json.loads(line)
        if isinstance(record, dict):
            return record
        reason = "no names with values, as in {...}"
    except (ValueError, RecursionError) as problem:
        reason = " ".join(str(problem).split())[:200]
    raise TrajectoryError(
        f"{path}: line {number} cannot be read as a JSON record ({reason}); if the log was cut "
        "off there, leave the line out"
    )


def _mapping_opened(path: Path, content: Mapping[str, Any]) -> OpenedLog:
    leaves = dict(_leaves("", content))
    return _arrays_opened(path, dict(_arrays(leaves)), _joint_names(path, leaves))


def _is_records(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(x, dict) for x in value)


def _by_key(records: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Key -> its values in all records, None where it is missing."""
    keys = dict.fromkeys(key for record in records for key in record)
    return {key: [record.get(key) for record in records] for key in keys}


def _leaves(prefix: str, content: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield all values that are no mappings, nor lists of mappings, by their dotted keys."""
    for name, value in content.items():
        inner = _by_key(value) if _is_records(value) else value
        if isinstance(inner, dict):
            yield from _leaves(f"{prefix}{name}.", inner)
        else:
            yield f"{prefix}{name}", value


def _joint_names(path: Path, leaves: Mapping[str, Any]) -> dict[str, list[str]]:
    """Prefix of keys -> the joints' names there, one list or the same one in every record."""
    found: dict[str, list[str]] = {}
    for key, value in leaves.items():
        prefix, _, last = key.rpartition(".")
        lists = value if isinstance(value, list) and value and isinstance(value[0], list) else None
        if last not in _NAMES:
            continue
        names = np.asarray(lists[0] if lists else value)
        if names.ndim != 1 or names.dtype.kind != "U":
            continue
        changed = [i for i, row in enumerate(lists or (), 1) if row != value[0]]
        if changed:
            raise TrajectoryError(
                f"{path}: the names of joints in {key}, or their order, change at record "
                f"{changed[0]}; log the same joints in every record"
            )
        found[prefix] = [str(name) for name in names]
    return found


def _arrays(leaves: Mapping[str, Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield arrays of numbers; None is NaN."""
    for name, value in leaves.items():
        try:
            array = np.asarray(value)
            if array.dtype == object:  # None beside numbers
                array = array.astype(np.float64)
        except (ValueError, TypeError, OverflowError):  # rows of several lengths, texts
            continue
        if array.dtype.kind in "iufb" and array.ndim in (1, 2):
            yield name, array


def _arrays_opened(
    path: Path,
    arrays: Mapping[str, NDArray[Any]],
    names: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> OpenedLog:
    """The log of the arrays with as many rows, or columns, as most have."""
    sizes = [max(x.shape) for x in arrays.values() if max(x.shape) >= FEWEST]
    count = max(sizes, key=lambda size: (sizes.count(size), size), default=0)
    columns: dict[str, NDArray[Any]] = {}
    for name, values in arrays.items():
        if values.shape == (count,):
            columns[name] = values
        elif values.ndim == 2 and count in values.shape:
            each = values if values.shape[1] == count else values.T
            numbers = [f"{name}_{i}" for i in range(1, len(each) + 1)]
            prefix, dot, last = name.rpartition(".")
            own = [f"{prefix}{dot}{joint}/{last}" for joint in names.get(prefix, ())]
            columns |= zip(own if len(own) == len(each) else numbers, each, strict=True)
    if not columns:
        raise TrajectoryError(f"{path}: holds no arrays of numbers")
    check_size(path, count, len(columns))
    return arrays_log(columns, {}, recorded=True)


def _inflated(path: Path) -> int:
    """Bytes in a MATLAB file's compressed variables, counted up to `MOST_BYTES`."""
    size, compressed = 0, 15
    with suppress(OSError, struct.error, zlib.error), path.open("rb") as file:  # said by SciPy
        order = ">" if file.read(128)[-2:] == b"MI" else "<"
        while (head := file.read(8)) and size <= MOST_BYTES:
            kind, length = struct.unpack(f"{order}II", head)
            data, inflate = file.read(length), zlib.decompressobj()
            while kind == compressed and data and size <= MOST_BYTES:
                size += len(inflate.decompress(data, _PART))
                data = inflate.unconsumed_tail
    return size


def _matlab_arrays(prefix: str, content: Mapping[str, Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            fields = {field: getattr(value, field) for field in value._fieldnames}
            yield from _matlab_arrays(f"{prefix}{name}.", fields)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb" and value.ndim in (1, 2):
            yield f"{prefix}{name}", value
