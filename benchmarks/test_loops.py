"""What friction costs where it couples: the four-bar with four pins, against itself without.

    python -m pytest benchmarks/test_loops.py -n0 -s

Every round times the contestants one after the other.
"""

from __future__ import annotations

import statistics
import time

import numpy as np
from cases import Case, turning_four_bar
from mechanisms import four_bar

import pinfric as pf

SAMPLES, ROUNDS = 20_000, 9


def median_seconds(contestants):
    """Median seconds of each contestant, all of them timed in every round."""
    for run in contestants.values():
        run()
    times = {name: [] for name in contestants}
    for _ in range(ROUNDS):
        for name, run in contestants.items():
            start = time.perf_counter()
            run()
            times[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in times.items()}


def test_four_pins_against_none(benchmark):
    figures = {}
    for kind in ("planar_pin", "revolute"):
        case = turning_four_bar(SAMPLES, "B", kind)
        plain, _ = four_bar("B", kind, friction={})
        bare = Case(plain, case.q, case.v, case.a)
        seconds = median_seconds(
            {
                "friction": lambda case=case: case.inverse(threads=1),
                "without": lambda bare=bare: bare.inverse(threads=1),
            }
        )
        each = {name: 1e6 * s / SAMPLES for name, s in seconds.items()}
        ratio = seconds["friction"] / seconds["without"]
        print(
            f"\nfour-bar, {kind}, one thread, us per sample: without friction "
            f"{each['without']:.2f}, four pins {each['friction']:.2f} (goal 30); "
            f"ratio {ratio:.2f} (goal 5)"
        )
        figures[kind] = (ratio, each["friction"])
    ratio, each = figures["planar_pin"]
    benchmark.extra_info.update(ratio=ratio, microseconds=each)
    benchmark.pedantic(lambda: turning_four_bar(2000).inverse(), rounds=3)
    assert ratio < 5.0
    assert each < 30.0


def test_four_pins_at_rest_and_a_scene_that_is_made():
    case = turning_four_bar(2000)
    rest = Case(case.scene, case.q, 0 * case.v, 0 * case.a)
    seconds = median_seconds(
        {
            "rest": lambda: rest.inverse(threads=1),
            "scene": lambda: pf.Scene(
                model=case.scene.model,
                friction=case.scene.friction,
                loops=case.scene.loops,
                actuators=case.scene.actuators,
            ),
        }
    )
    print(
        f"\nfour-bar at rest, 16 corners: {1e6 * seconds['rest'] / 2000:.1f} us per sample; "
        f"making its scene (closing it, counting freedoms): {1e3 * seconds['scene']:.1f} ms"
    )
    assert seconds["rest"] / 2000 < 1e-3
    assert np.isfinite(seconds["scene"])
