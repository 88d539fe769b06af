"""What forward dynamics with friction costs, as ratios and per right-hand side.

python -m pytest tests/benchmarks/test_forward.py -n 0 -s
"""

from __future__ import annotations

import time

import numpy as np
import pinocchio as pin

import pinfric as pf
from pinfric.model.robot import example_robot_data

ROUNDS, CALLS = 60, 300


def per_call(contestants):
    """Least microseconds a call of each contestant, all of them timed in every round."""
    best = dict.fromkeys(contestants, np.inf)
    for _ in range(ROUNDS):
        for name, run in contestants.items():
            run()
            start = time.perf_counter()
            for _ in range(CALLS):
                run()
            best[name] = min(best[name], (time.perf_counter() - start) / CALLS * 1e6)
    return best


def test_one_call_against_aba():
    urdf = example_robot_data() / "ur_description/urdf/ur5_robot.urdf"
    model = pin.buildModelFromUrdf(str(urdf))
    pin_bearing = {"bearing": {"kind": "pin", "radius": 0.05, "length": 0.1},
                   "mu": {"static": 0.15, "kinetic": 0.1}}  # fmt: skip
    scene = pf.Scene(model=model, friction=dict.fromkeys(tuple(model.names)[1:], pin_bearing))
    rng = np.random.default_rng(0)
    q, v, u = rng.uniform(-2, 2, 6), rng.uniform(-2, 2, 6), rng.uniform(-20, 20, 6)
    data = model.createData()
    found = per_call(
        {
            "pin.aba": lambda: pin.aba(model, data, q, v, u),
            "moving": lambda: pf.forward_dynamics(scene, q, v, u),
        }
    )
    for name, us in found.items():
        print(f"{name:8} {us:7.1f} us  {us / found['pin.aba']:5.1f} x aba")
    assert found["moving"] <= 15 * found["pin.aba"]


def test_the_paper_s_robot_for_one_second():
    scene = pf.load_scene("three_link")
    run = lambda: pf.simulate(scene, np.zeros(3), [1.0, -1.0, 1.0], None, 1.0, rtol=1e-8)  # noqa: E731
    motion, seconds = run(), []
    for _ in range(10):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    best = min(seconds)
    each = best / motion.evaluations * 1e6
    print(f"{best:.3f} s, {motion.evaluations} right-hand sides, {each:.1f} us each")
    assert best <= 0.25
