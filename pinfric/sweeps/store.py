"""A sweep's samples on disk: every finished batch is a Parquet file that is not computed again.

While a sweep runs, DIR/batches holds one file per finished batch; once all are there, they become
DIR/samples.parquet. Each file knows which sweep it belongs to: samples of another one (another
seed, scene, trajectory) are refused, not mixed in.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pinfric import __version__
from pinfric.dynamics.simulation.motion import scene_digests
from pinfric.errors import SweepError
from pinfric.model.yamlfile import brief
from pinfric.sweeps.cycle import Study

if TYPE_CHECKING:
    import pandas as pd

SAMPLES, BATCHES = "samples.parquet", "batches"
_KEY = "pinfric_sweep"


def identity(study: Study, values: np.ndarray) -> dict[str, str]:
    """Return what a sample's figures depend on, hashed part by part, to compare runs."""
    scene, motion = study.scene, study.trajectory
    start = scene.start_configuration.tolist()
    targets = [(t.name, t.section, t.key, t.names) for t in study.targets]
    parts = {
        "scene": repr((scene.loops, scene.redundancy_length, start, scene.tool)).encode(),
        "trajectory": b"".join(getattr(motion, k).tobytes() for k in ("t", "q", "v", "a")),
        "attached": motion.attached.tobytes(),
        "sweep": repr((targets, study.trials)).encode() + values.tobytes(),
    }
    hashes = {name: hashlib.sha256(content).hexdigest()[:16] for name, content in parts.items()}
    return {"pinfric": __version__, **scene_digests(scene, "motor_torque"), **hashes}


@dataclass(frozen=True)
class Store:
    """A folder of samples, and which sweep they belong to (`identity`)."""

    folder: Path
    identity: Mapping[str, str]

    def read(self) -> list[pd.DataFrame]:
        """Return the samples that are there already, as `cycle.compute` made them.

        Raises:
            SweepError: they belong to another sweep, or a file cannot be read.
        """
        batches = sorted((self.folder / BATCHES).glob("*.parquet"))
        return [self._read(f) for f in (self.folder / SAMPLES, *batches) if f.is_file()]

    def write(self, batch: pd.DataFrame) -> None:
        """Write one finished batch; it appears as a whole or not at all.

        Raises:
            SweepError: the folder cannot be written, or pyarrow is missing.
        """
        rows = batch["sample"]
        name = f"{rows.iloc[0]:08d}-{rows.iloc[-1]:08d}.parquet"
        self._write(self.folder / BATCHES / name, batch)

    def finish(self, samples: pd.DataFrame) -> None:
        """Write all samples in one file and remove the batches."""
        self._write(self.folder / SAMPLES, samples)
        shutil.rmtree(self.folder / BATCHES, ignore_errors=True)

    def _write(self, path: Path, samples: pd.DataFrame) -> None:
        part = path.with_name(f".{path.name}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            samples.attrs[_KEY] = {**self.identity, "content": _content(samples)}
            with part.open("wb") as opened:  # Arrow takes no name that is not in UTF-8
                samples.to_parquet(opened, engine="pyarrow", index=False, write_page_checksum=True)
            os.replace(part, path)
        except ImportError:
            raise SweepError(
                "samples are written as Parquet, which needs pyarrow: "
                'pip install "pinfric[cluster]"'
            ) from None
        except OSError as problem:
            reason = problem.strerror or problem
            raise SweepError(f"{self.folder}: cannot be written: {reason}") from None

    def _read(self, file: Path) -> pd.DataFrame:
        import pandas as pd

        try:
            with file.open("rb") as opened:
                samples = pd.read_parquet(opened, "pyarrow", page_checksum_verification=True)
            found = samples.attrs[_KEY]
            if found["content"] != _content(samples):  # pages have checksums, their directory not
                raise ValueError("its values differ from those that were written")
        except Exception as problem:  # Arrow and Thrift have a dozen for damaged files
            reason = brief(" ".join(str(problem).split()))
            raise SweepError(
                f"{file}: cannot be read, or is damaged ({reason}); remove it to "
                "compute its samples again"
            ) from None
        other = [name for name, value in self.identity.items() if found.get(name) != value]
        if other:
            raise SweepError(
                f"{file}: holds samples of another sweep (different: {', '.join(other)}); name "
                "another folder, or remove it"
            )
        return samples


def _content(samples: pd.DataFrame) -> str:
    """A digest of the columns' names and values."""
    from pandas.util import hash_pandas_object

    rows = hash_pandas_object(samples, index=False).to_numpy().tobytes()
    return hashlib.sha256(repr(list(samples.columns)).encode() + rows).hexdigest()[:16]
