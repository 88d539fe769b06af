"""Sweeps against inverse dynamics, on 1, 2, 4 processes, and of 10,000 panda cycles.

python -m pytest -n0 -s benchmarks/test_sweep.py
"""

import os
import resource
from time import perf_counter

import measure
import numpy as np
import pytest

import pinfric as pf
from pinfric.sweeps.cycle import Study, compute, cycle_figures
from pinfric.sweeps.file import load_sweep
from pinfric.sweeps.motors import motors_on_trial
from pinfric.sweeps.parameters import draw, resolve

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
        scene,
        whole.t[rows],
        whole.q[rows],
        whole.v[rows],
        whole.a[rows],
        {"box": whole.attached[rows, 0]},
    )


DRIVE = "Kollmorgen TBM-6025-A + Harmonic Drive CSG-20-100"


@pytest.mark.parametrize(("drives", "faster"), [(0, 8.0), (1, 4.0), (7, 2.5)])
def test_sums_of_cycles_are_faster_than_inverse_dynamics(panda, drives, faster):
    scene, motion = panda
    on_trial = {name: {"drive": DRIVE} for name in scene.actuator_names[:drives]}
    entries, source = load_sweep({**SWEEP, "samples": 400, "motors": on_trial})
    targets = resolve(scene, entries, source)
    equipped, trials = motors_on_trial(scene, entries, source)
    study, values = Study(equipped, motion, targets, trials), draw(targets, entries)

    def general():
        return np.array([cycle_figures(study, sample)[0] for sample in values[:10]])

    def sums():
        return compute(study, values).figures

    seconds = measure.median_seconds({"general": general, "sums": sums}, rounds=5)
    each, summed = seconds["general"] / 10, seconds["sums"] / 400
    print(
        f"\n{drives} catalogue drives on trial: {1e3 * each:.2f} ms a cycle by inverse dynamics, "
        f"{1e3 * summed:.3f} ms as a sum, {each / summed:.1f} times as fast; "
        f"{measure.machine()}"
    )
    found = general()
    assert (np.abs(sums()[:10] - found) <= 1e-12 * np.abs(found).max(axis=(0, 1))).all()
    assert each > faster * summed


def timed(panda, samples, processes):
    """The result, its whole time, and the cycles per second from the first batch on."""
    times = []
    start = perf_counter()
    result = pf.sweep(
        *panda,
        {**SWEEP, "samples": samples},
        processes=processes,
        progress=lambda done, total: times.append((perf_counter(), done)),
    )
    whole = perf_counter() - start
    (first, early), (last, late) = times[1], times[-1]
    return result, whole, (late - early) / (last - first)


def test_more_processes_are_faster(panda):
    rates, results = dict.fromkeys((1, 2, 4), 0.0), {}
    for _ in range(3):  # what else runs makes rates smaller only: the greatest of each is compared
        for processes in rates:
            results[processes], whole, rate = timed(panda, 12_000, processes)
            rates[processes] = max(rate, rates[processes])
            print(
                f"\n{processes} processes: {rate:.0f} cycles/s, speed-up "
                f"{rates[processes] / rates[1]:.2f}; {whole:.1f} s with start"
            )
        for processes in (2, 4):
            np.testing.assert_array_equal(results[processes].figures, results[1].figures)
        if CORES < 2 or rates[2] > 1.3 * rates[1]:
            return
    pytest.fail(f"two processes are {rates[2] / rates[1]:.2f} times as fast as one")


def test_ten_thousand_cycles_in_bounded_memory(panda):
    result, whole, rate = timed(panda, 10_000, min(CORES, 4))
    assert result.solved.all()
    here = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    workers = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(
        f"\n10,000 cycles of 1,000 samples: {whole:.0f} s, {rate:.0f} cycles/s on "
        f"{result.processes} processes; {here:.0f} MiB here, {workers:.0f} in the largest worker"
    )
    assert here < 1000
    assert workers < 1000
