"""A sweep's folder: damaged samples are refused, and only one sweep at a time writes there."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from sweep_cases import pushed_block, steady, sweep_of, uniform

import pinfric as pf
from pinfric.errors import SweepError

pytest.importorskip("pyarrow")
TESTS = Path(__file__).parents[2]
SWEEP = sweep_of(40, speed=uniform(0.5, 2.0), friction__all__mu=uniform(0.5, 2.0))


def run(out, **more):
    scene = pushed_block()
    return pf.sweep(scene, steady(scene), SWEEP, out=out, processes=1, **more)


def test_flipped_bits_are_refused_or_change_nothing(tmp_path):
    written = run(tmp_path / "first")
    content = (tmp_path / "first" / "samples.parquet").read_bytes()
    chance, refused, folder = random.Random(2), 0, tmp_path / "damaged"
    file = folder / "samples.parquet"
    for _ in range(300):
        damaged = bytearray(content)
        place = chance.randrange(len(content))
        damaged[place] ^= 1 << chance.randrange(8)
        folder.mkdir(exist_ok=True)
        file.write_bytes(damaged)
        try:
            found = run(folder)
        except SweepError as problem:
            refused, said = refused + 1, str(problem)
        else:
            np.testing.assert_array_equal(found.figures, written.figures)
            np.testing.assert_array_equal(found.unsolved, written.unsolved)
            assert found.problems == written.problems
            continue
        assert len(said.splitlines()) == 1
        assert str(file) in said
        assert "remove it" in said
    assert refused > 150
    shutil.rmtree(folder)


def test_figures_that_were_not_written_are_refused_though_their_checksums_are_right(tmp_path):
    import pyarrow.parquet as pq

    run(tmp_path)
    file = tmp_path / "samples.parquet"
    table = pq.read_table(file)
    swapped = table.select([0, 2, 1, *range(3, table.num_columns)]).rename_columns(
        table.schema.names
    )
    pq.write_table(swapped.replace_schema_metadata(table.schema.metadata), file)
    with pytest.raises(SweepError, match="differ from those that were written"):
        run(tmp_path)


HOLDER = """
    import sys, time
    sys.path.insert(0, {tests!r})
    from sweep_cases import *
    scene = pushed_block()
    def wait(done, total):
        print("begun", flush=True)
        time.sleep(60)
    pf.sweep(scene, steady(scene), {sweep!r}, out={out!r}, processes=1, progress=wait)
"""


def test_a_second_sweep_into_one_folder_is_refused_and_a_killed_one_blocks_nobody(tmp_path):
    script = textwrap.dedent(HOLDER.format(tests=str(TESTS), sweep=SWEEP, out=str(tmp_path)))
    first = subprocess.Popen(
        [sys.executable, "-c", script],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(TESTS.parent)},
    )
    try:
        assert first.stdout.readline() == "begun\n"
        with pytest.raises(SweepError, match=r"another sweep is writing.*\.sweep\.lock"):
            run(tmp_path)
        first.send_signal(signal.SIGKILL)
    finally:
        first.kill()
        first.wait()
        first.stdout.close()
    half = tmp_path / "batches" / ".half.parquet.part"
    half.write_bytes(b"half a batch")
    assert run(tmp_path).solved.all()
    assert [path.name for path in tmp_path.iterdir()] == ["samples.parquet"]
