"""Sweeps on 1, 2, 4 processes, and 10,000 panda cycles: run with `pytest -n0 -s`."""

import os
import resource
from time import perf_counter

import numpy as np
import pytest

import pinfric as pf

SWEEP = {
    "pinfric_sweep": 1,
    "sampling": "random",
    "parameters": {
        "friction.*.mu": {"lognormal": {"median": 1.0, "sigma": 0.34}},
        "friction.*.coulomb": {"lognormal": {"median": 1.0, "sigma": 0.42}, "each": True},
        "payload.box.mass": {"uniform": {"low": 1.0, "high": 3.0}},
        "speed": {"uniform": {"low": 0.9, "high": 1.1}},
        "mounting.roll": {"normal": {"mean": 0.0, "std": 0.0175}},
    },
}
CORES = len(os.sched_getaffinity(0))


@pytest.fixture(scope="module")
def panda():
    """The pick-and-place as 1,000 samples."""
    scene = pf.load_scene("panda_pick_and_place")
    whole = pf.load_trajectory("panda_pick_and_place.csv", scene)
    rows = np.linspace(0, len(whole.t) - 1, 1000).round().astype(int)
    return scene, pf.Trajectory.from_arrays(
        scene, whole.t[rows], whole.q[rows], whole.v[rows], whole.a[rows],
        {"box": whole.attached[rows, 0]},
    )  # fmt: skip


def timed(panda, samples, processes, **more):
    """The result, its whole time, and the cycles per second from the first batch on."""
    times = []
    start = perf_counter()
    result = pf.sweep(*panda, {**SWEEP, "samples": samples}, processes=processes,
                      progress=lambda done, total: times.append((perf_counter(), done)),
                      **more)  # fmt: skip
    whole = perf_counter() - start
    (first, early), (last, late) = times[1], times[-1]
    return result, whole, (late - early) / (last - first)


def test_more_processes_are_faster(panda):
    rates, results = {}, {}
    for processes in (1, 2, 4):
        results[processes], whole, rates[processes] = timed(panda, 3000, processes)
        print(f"\n{processes} processes: {rates[processes]:.0f} cycles/s, speed-up "
              f"{rates[processes] / rates[1]:.2f}; {whole:.1f} s with start")  # fmt: skip
    for processes in (2, 4):
        np.testing.assert_array_equal(results[processes].figures, results[1].figures)
    if CORES >= 2:
        assert rates[2] > 1.3 * rates[1]


def test_ten_thousand_cycles_in_bounded_memory(panda, tmp_path):
    result, whole, rate = timed(panda, 10_000, min(CORES, 4), out=tmp_path)
    assert result.solved.all()
    here = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    workers = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    size = (tmp_path / "samples.parquet").stat().st_size / 2**20
    print(f"\n10,000 cycles of 1,000 samples: {whole:.0f} s, {rate:.0f} cycles/s on "
          f"{result.processes} processes; {here:.0f} MiB here, {workers:.0f} MiB in the largest "
          f"worker; {size:.1f} MiB of Parquet")  # fmt: skip
    assert here < 1000
    assert workers < 1000
