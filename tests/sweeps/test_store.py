"""A sweep's folder: what is there is not computed again; other or damaged samples are refused."""

from __future__ import annotations

import random
import shutil

import numpy as np
import pandas as pd
import pytest
from sweep_cases import pushed_block, run, steady, sweep_of, uniform

import pinfric as pf
from pinfric.errors import SweepError
from pinfric.sweeps.store import Store

pytest.importorskip("pyarrow")


SWEEP = sweep_of(40, speed=uniform(0.5, 2.0), friction__all__mu=uniform(0.5, 2.0))


def stored(out, **more):
    scene = pushed_block()
    return pf.sweep(scene, steady(scene), SWEEP, out=out, processes=1, **more)


@pytest.mark.slow
def test_flipped_bits_are_refused_or_change_nothing(tmp_path):
    written = stored(tmp_path / "first")
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
            found = stored(folder)
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


class Stopped(Exception):  # noqa: N818 - a person who stops it, no error
    pass


def stop_after(count):
    calls = []

    def progress(done, total):
        calls.append(done)
        if len(calls) > count:
            raise Stopped

    return progress


def test_a_batch_that_is_there_is_not_computed_again(tmp_path):
    """A part with figures of its own shows that it was read, the other rows that they were not."""
    scene = pushed_block()
    sweep = sweep_of(600, speed=uniform(0.5, 2.0))
    whole = run(scene, steady(scene), sweep)
    with pytest.raises(Stopped):
        run(scene, steady(scene), sweep, out=tmp_path, progress=stop_after(1))
    (batch,) = (tmp_path / "batches").glob("*.parquet")
    table = pd.read_parquet(batch)
    of_the_sweep = {k: x for k, x in table.attrs["pinfric_sweep"].items() if k != "content"}
    table["slide.peak"] += 7.0
    Store(tmp_path, of_the_sweep).write(table)
    resumed = run(scene, steady(scene), sweep, out=tmp_path)
    assert resumed.resumed == len(table) < 600
    expected = whole.figure("peak")[:, 0].copy()
    expected[table["sample"]] += 7.0
    np.testing.assert_array_equal(resumed.figure("peak")[:, 0], expected)


def test_interrupted_sweep_goes_on_from_what_is_on_disk(tmp_path):
    scene = pushed_block()
    sweep = sweep_of(600, speed=uniform(0.5, 2.0), friction__all__mu=uniform(0.5, 2.0))
    whole = run(scene, steady(scene), sweep)
    with pytest.raises(Stopped):
        run(scene, steady(scene), sweep, out=tmp_path, progress=stop_after(2))
    batches = sorted((tmp_path / "batches").glob("*.parquet"))
    assert len(batches) == 2
    before = [batch.stat().st_mtime_ns for batch in batches]
    (tmp_path / "batches" / ".half.parquet.part").write_bytes(b"half a batch")
    done = []
    with pytest.raises(Stopped):  # and once more
        run(scene, steady(scene), sweep, out=tmp_path, progress=stop_after(1))
    assert [batch.stat().st_mtime_ns for batch in batches] == before  # not computed again
    resumed = run(
        scene, steady(scene), sweep, out=tmp_path, progress=lambda now, total: done.append(now)
    )
    assert resumed.resumed == done[0] > 0
    assert done == sorted(done)
    assert done[-1] == 600
    np.testing.assert_array_equal(resumed.figures, whole.figures)
    assert [path.name for path in tmp_path.iterdir()] == ["samples.parquet"]
    finished = run(scene, steady(scene), sweep, out=tmp_path)
    assert finished.resumed == 600
    np.testing.assert_array_equal(finished.figures, whole.figures)


def test_folder_of_another_sweep_is_refused(tmp_path):
    scene = pushed_block()
    sweep = sweep_of(8, speed=uniform(0.5, 2.0))
    run(scene, steady(scene), sweep, out=tmp_path)
    heavier = pushed_block(friction={"slide": {"viscous": 1.0}})
    for other, motion, given, part in (
        (scene, steady(scene), {**sweep, "seed": 4}, "sweep"),
        (scene, steady(scene, 0.6), sweep, "trajectory"),
        (heavier, steady(heavier), sweep, "friction"),
    ):
        with pytest.raises(SweepError, match=rf"another sweep \(different: {part}\)"):
            run(other, motion, given, out=tmp_path)
    (tmp_path / "samples.parquet").write_bytes(b"no parquet")
    with pytest.raises(SweepError, match=r"samples\.parquet: cannot be read"):
        run(scene, steady(scene), sweep, out=tmp_path)


def test_samples_can_be_read_by_others(tmp_path):
    scene = pushed_block()
    found = run(scene, steady(scene), sweep_of(8, speed=uniform(0.5, 2.0)), out=tmp_path)
    frame = pd.read_parquet(tmp_path / "samples.parquet")
    np.testing.assert_array_equal(frame["speed"], found.values[:, 0])
    np.testing.assert_array_equal(frame["slide.peak"], found.figure("peak")[:, 0])
    assert list(frame["problem"]) == [""] * 8


def test_folder_that_cannot_be_written_is_said(tmp_path):
    (tmp_path / "file").write_text("x")
    scene = pushed_block()
    with pytest.raises(SweepError, match="cannot be written"):
        run(scene, steady(scene), sweep_of(2, speed=uniform(1, 2)), out=tmp_path / "file")
