"""Shared by the benchmarks: robots, states, and timings that a busy machine slows all alike."""

from __future__ import annotations

import os
import platform
import statistics
import time
from pathlib import Path

import pinfric as pf  # isort: skip - before Pinocchio loads: it sets how threads wait

import numpy as np
import pinocchio as pin

from pinfric.kernels import interpreted
from pinfric.model.robot import example_robot_data

interpreted.PATIENCE = 0.0  # what is timed is compiled

PIN = {
    "bearing": {"kind": "pin", "radius": 0.05, "length": 0.1},
    "mu": {"static": 0.15, "kinetic": 0.1},
}


def ur5():
    return pin.buildModelFromUrdf(str(example_robot_data() / "ur_description/urdf/ur5_robot.urdf"))


def with_pins(model, sites=None):
    """The model with a pin in its first joints, or in all if `sites` is None."""
    return pf.Scene(model=model, friction=dict.fromkeys(tuple(model.names)[1:][:sites], PIN))


def states(model, samples):
    rng = np.random.default_rng(0)
    return [rng.uniform(-1, 1, (samples, model.nv)) for _ in range(3)]


def median_seconds(contestants, rounds=9, calls=1, clock=time.perf_counter):
    """Median seconds of each contestant's call, all of them timed in every round."""
    found = all_seconds(contestants, rounds, calls, clock)
    return {name: statistics.median(values) for name, values in found.items()}


def all_seconds(contestants, rounds=9, calls=1, clock=time.perf_counter):
    """Seconds of each contestant's call in every round."""
    for run in contestants.values():
        run()
    times = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, run in contestants.items():
            start = clock()
            for _ in range(calls):
                run()
            times[name].append((clock() - start) / calls)
    return times


def machine():
    """One line: processor, cores, load, versions."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    processor = names[0] if names else platform.processor() or platform.machine()
    return (
        f"{processor}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; Python "
        f"{platform.python_version()}, pin {pin.__version__}, numpy {np.__version__}"
    )
