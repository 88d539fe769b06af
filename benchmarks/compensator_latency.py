"""Latency of one state at a time beside `pin.rnea`, in turn: median and 99th percentile in us.

    python benchmarks/compensator_latency.py [--calls 100000]

Robots: the UR10 and the Panda of the scenes; solo12 on its four feet, whose base no drive moves.
"""

from __future__ import annotations

import argparse
import gc
import time
import warnings

import pinfric as pf  # isort: skip - before Pinocchio loads: it sets how threads wait
import numpy as np
import pinocchio as pin

from pinfric.model.robot import example_robot_data

STATES = 64
PUSH = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])


def solo12():
    """A quadruped with gears, its base free."""
    urdf = example_robot_data() / "solo_description/robots/solo12.urdf"
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    names = list(model.names)[2:]
    gear = {"ratio": 9.0, "efficiency": 0.9, "back_efficiency": 0.889, "rotor_inertia": 1e-5}
    return pf.Scene(
        model,
        friction={name: {"coulomb": 0.2, "viscous": 0.01} for name in names},
        actuators=[{"joint": name, "transmission": gear} for name in names],
        source="solo12",
    )


def timed(calls, count):
    """Median and 99th percentile (us) of each call, all in turn."""
    taken, now = {name: np.empty(count) for name in calls}, time.perf_counter
    for call in calls.values():
        for i in range(500):
            call(i % STATES)
    gc.disable()
    for i in range(count):
        for name, call in calls.items():
            start = now()
            call(i % STATES)
            taken[name][i] = now() - start
    gc.enable()
    return {name: np.percentile(1e6 * x, [50.0, 99.0]) for name, x in taken.items()}


def calls_of(scene, external, driven):
    """The calls of one robot by their names."""
    model, solver, rng = scene.loaded_model(), scene.solver(), np.random.default_rng(0)
    data = model.createData()
    steps = rng.uniform(-0.5, 0.5, (STATES, model.nv))
    q = [pin.integrate(model, pin.neutral(model), step) for step in steps]
    v, a = rng.uniform(-1.0, 1.0, (STATES, model.nv)), rng.uniform(-3.0, 3.0, (STATES, model.nv))
    v, a = list(v), list(a)
    calls = {"pin.rnea": lambda i: pin.rnea(model, data, q[i], v[i], a[i])}
    if driven:
        calls["inverse"] = lambda i: solver.inverse(q[i], v[i], a[i])
        calls["inverse, external"] = lambda i: solver.inverse(q[i], v[i], a[i], external=external)
    push = None if driven else external
    calls["joint_effort"] = lambda i: solver.joint_effort(q[i], v[i], a[i], external=push)
    calls["compensate"] = lambda i: solver.compensate(q[i], v[i], a[i], v[i], external=push)
    calls["compensate_measured"] = lambda i: solver.compensate_measured(q[i], v[i], external=push)
    return calls


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=100_000)
    count = parser.parse_args().calls
    warnings.simplefilter("ignore", pf.PinfricWarning)
    legs = solo12()
    feet = {f.name: PUSH for f in legs.model.frames if f.name.endswith("_FOOT")}
    robots = {
        "UR10": (pf.load_scene("ur10_machine_tending"), {"tool0": PUSH}, True),
        "Panda": (pf.load_scene("panda_pick_and_place"), {"panda_link8": PUSH}, True),
        "solo12, wrenches on four feet": (legs, feet, False),
        "solo12, base driven": (legs.with_(actuators=None), feet, True),
    }
    for name, robot in robots.items():
        for call, (middle, late) in timed(calls_of(*robot), count).items():
            print(f"{name:30} {call:20} {middle:7.2f} {late:7.2f}", flush=True)


if __name__ == "__main__":
    main()
