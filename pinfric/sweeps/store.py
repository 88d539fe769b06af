"""A sweep's samples on disk: every finished batch is a Parquet file, and a run goes on from them.

While a sweep runs, DIR/batches holds one file per finished batch; once all are there, they become
DIR/samples.parquet. Each file knows which sweep it belongs to: samples of another one (another
seed, scene, trajectory) are refused, not mixed in.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import SweepError
from pinfric.model.files import only_one
from pinfric.model.yamlfile import brief
from pinfric.sweeps.cycle import ELASTIC_FIGURES, FIGURES, NOT_CHECKED, Block, Study

SAMPLES, BATCHES, LOCK = "samples.parquet", "batches", ".sweep.lock"
_KEY, _DIGEST = b"pinfric_sweep", b"pinfric_digest"


#: Of the columns in a part: raised when they change, so that older parts are not continued.
_FORMAT = "4"


def identity(study: Study, values: np.ndarray, version: str) -> dict[str, str]:
    """Return what a sample's figures depend on, hashed part by part, to compare runs."""
    scene, motion = study.scene, study.trajectory
    linkage = [scene.loops, scene.redundancy_length, scene.start_configuration.tobytes()]
    linkage += [scene.tool] if scene.tool is not None else []
    parts: dict[str, list[Any]] = {
        "scene": [
            pickle.dumps(scene.model),
            scene.friction,
            scene.payloads,
            scene.actuators,
            scene.stick_velocity,
            *linkage,
        ],
        "trajectory": [getattr(motion, k).tobytes() for k in ("t", "q", "v", "a", "attached")],
        "sweep": [[(t.name, t.section, t.key, t.names) for t in study.targets], values.tobytes()],
    }
    hashes = {name: hashlib.sha256() for name in parts}
    for name, contents in parts.items():
        for content in contents:
            hashes[name].update(content if isinstance(content, bytes) else repr(content).encode())
    return {
        "pinfric": version,
        "format": _FORMAT,
        **{name: h.hexdigest()[:16] for name, h in hashes.items()},
    }


@dataclass(frozen=True)
class Store:
    """A folder of samples.

    Attributes:
        folder: where they are.
        identity: which sweep they belong to.
        parameters, actuators: names of the columns.
        criteria: the columns of verdicts, `Study.criteria`.
    """

    folder: Path
    identity: Mapping[str, str]
    parameters: tuple[str, ...]
    actuators: tuple[str, ...]
    criteria: tuple[tuple[int, str], ...] = ()

    @contextmanager
    def held(self) -> Iterator[None]:
        """Make the folder, keep other sweeps out of it, and remove what a killed one left there.

        Raises:
            SweepError: pyarrow is missing, another sweep is writing into the folder, or it cannot
                be written.
        """
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            raise SweepError(
                "samples are written as Parquet, which needs pyarrow: "
                'pip install "pinfric[cluster]"'
            ) from None
        with ExitStack() as stack:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                alone = stack.enter_context(only_one(self.folder / LOCK))
                if alone:
                    (self.folder / BATCHES).mkdir(exist_ok=True)
                    for rest in (
                        *self.folder.glob(".*.parquet.part"),
                        *(self.folder / BATCHES).glob(".*.parquet.part"),
                    ):
                        rest.unlink()
            except OSError as problem:
                raise self._unwritable(problem) from None
            if not alone:
                raise SweepError(
                    f"{self.folder}: another sweep is writing into this folder (it holds "
                    f"{self.folder / LOCK}); wait for it, or name another folder"
                )
            yield
            with suppress(OSError):  # batches of a sweep that goes on another time stay
                (self.folder / BATCHES).rmdir()

    @property
    def complete(self) -> bool:
        """Whether all samples are in one file already."""
        return (self.folder / SAMPLES).is_file()

    def read(self) -> Iterator[Block]:
        """Yield the samples that are there already.

        Raises:
            SweepError: they belong to another sweep, or a file cannot be read.
        """
        for file in (self.folder / SAMPLES, *sorted((self.folder / BATCHES).glob("*.parquet"))):
            if file.is_file():
                yield self._read(file)

    def write(self, block: Block, values: np.ndarray) -> None:
        """Write one finished batch; it appears as a whole or not at all.

        Args:
            block: its figures. values: (k, np), its samples' parameters.
        """
        name = f"{block.rows[0]:08d}-{block.rows[-1]:08d}.parquet"
        self._write(self.folder / BATCHES / name, block, values)

    def finish(self, block: Block, values: np.ndarray) -> Path:
        """Write all samples in one file and remove the batches; returns the file."""
        path = self.folder / SAMPLES
        self._write(path, block, values)
        with suppress(OSError):
            for file in (self.folder / BATCHES).glob("*.parquet"):
                file.unlink()
        return path

    def _columns(self, block: Block, values: np.ndarray) -> dict[str, Any]:
        columns: dict[str, Any] = {"sample": block.rows}
        columns |= {name: values[:, j] for j, name in enumerate(self.parameters)}
        columns |= {
            f"{drive}.{figure}": block.figures[:, i, k]
            for i, drive in enumerate(self.actuators)
            for k, figure in enumerate(FIGURES)
        }
        columns |= {
            self._verdict(k): booleans(block.verdicts[:, k]) for k in range(len(self.criteria))
        }
        names = ELASTIC_FIGURES if block.elastic.shape[1] else ()
        columns |= {name: block.elastic[:, k] for k, name in enumerate(names)}
        return columns | {"unsolved": block.unsolved, "problem": list(block.problems)}

    def _verdict(self, k: int) -> str:
        actuator, criterion = self.criteria[k]
        return f"{self.actuators[actuator]}.{criterion}"

    def _write(self, path: Path, block: Block, values: np.ndarray) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = self._columns(block, values)
        types = {self._verdict(k): pa.bool_() for k in range(len(self.criteria))}
        arrays = {name: pa.array(column, types.get(name)) for name, column in columns.items()}
        table = pa.table(arrays).replace_schema_metadata(
            {_KEY: json.dumps(dict(self.identity)).encode(), _DIGEST: _digest(columns)}
        )
        part = path.with_name(f".{path.name}.part")
        try:
            with part.open("wb") as opened:  # Arrow takes no name that is not in UTF-8
                pq.write_table(table, opened, write_page_checksum=True)
            os.replace(part, path)
        except OSError as problem:
            part.unlink(missing_ok=True)
            raise self._unwritable(problem) from None

    def _read(self, file: Path) -> Block:
        try:
            found, columns = _contents(file)
        except Exception as problem:  # Arrow and Thrift have a dozen for damaged files
            reason = brief(" ".join(str(problem).split()))
            raise SweepError(
                f"{file}: cannot be read, or is damaged ({reason}); remove it to "
                "compute its samples again"
            ) from None
        if found != dict(self.identity):
            other = [name for name, value in self.identity.items() if found.get(name) != value]
            raise SweepError(
                f"{file}: holds samples of another sweep (different: {', '.join(other)}); name "
                "another folder, or remove it"
            )
        figures = np.stack(
            [
                np.column_stack([columns[f"{drive}.{figure}"] for figure in FIGURES])
                for drive in self.actuators
            ],
            axis=1,
        )
        verdicts = np.full((len(figures), len(self.criteria)), NOT_CHECKED, dtype=np.int8)
        for k in range(len(self.criteria)):
            verdicts[:, k] = _codes(columns[self._verdict(k)])
        known = [columns[name] for name in ELASTIC_FIGURES if name in columns]
        elastic = np.column_stack(known) if known else np.empty((len(figures), 0))
        return Block(
            columns["sample"],
            figures,
            verdicts,
            columns["unsolved"],
            tuple(map(str, columns["problem"])),
            elastic,
        )

    def _unwritable(self, problem: OSError) -> SweepError:
        return SweepError(f"{self.folder}: cannot be written: {problem.strerror or problem}")


def booleans(codes: np.ndarray) -> np.ndarray:
    """Return verdicts as True, False and None (not checked)."""
    return np.array([False, True, None], dtype=object)[codes]


def _codes(column: np.ndarray) -> np.ndarray:
    return np.array([NOT_CHECKED if met is None else int(met) for met in column], dtype=np.int8)


def _contents(file: Path) -> tuple[dict[str, str], dict[str, Any]]:
    """The identity and the columns of a file; raises where they are not those that were written.

    Parquet's own checksums cover the pages, not the directory that says which page is which.
    """
    import pyarrow.parquet as pq

    with file.open("rb") as opened:
        table = pq.read_table(opened, page_checksum_verification=True)
    about = table.schema.metadata or {}
    columns = {
        name: table.column(name).to_numpy(zero_copy_only=False) for name in table.column_names
    }
    identity = dict(json.loads(about.get(_KEY, b"{}")))
    if identity.get("format") == _FORMAT and about.get(_DIGEST) != _digest(columns):
        raise ValueError("its values differ from those that were written")
    return identity, columns


def _digest(columns: Mapping[str, Any]) -> bytes:
    """A digest of the columns' names and values."""
    digest = hashlib.blake2b(digest_size=16)
    for name, column in columns.items():
        numbers = name != "problem"
        content = np.asarray(column, dtype=float).tobytes() if numbers else repr(list(column))
        digest.update(f"{name} {len(content)} ".encode())
        digest.update(content if isinstance(content, bytes) else content.encode())
    return digest.hexdigest().encode()
