"""Cost grows as it should: fitted exponents of measured curves.

    python -m pytest benchmarks/test_scaling.py -n 0 -s

`scaling.py` measures, prints and draws the same curves in full.
"""

from __future__ import annotations

import scaling


def test_inverse_dynamics_is_linear_in_joints():
    ours, bare = scaling.over_joints(samples=1000, rounds=5)
    print("\n", ours.line(), f"n^{ours.exponent:.2f}", bare.line(), f"n^{bare.exponent:.2f}")
    assert ours.exponent < 1.35


def test_forward_dynamics_is_below_cubic_in_joints():
    ours, _ = scaling.forward_over_joints(rounds=5, calls=5)
    print("\n", ours.line(), f"n^{ours.exponent:.2f}")
    assert ours.exponent < 2.5


def test_samples_cost_their_number():
    (curve,) = scaling.over_samples(most=100_000)
    print("\n", curve.line(), f"n^{curve.exponent:.2f}")
    assert 0.7 < curve.exponent < 1.15
    each = [cost / n for cost, n in zip(curve.cost, curve.n, strict=True)]
    assert each[-1] < 1.5 * each[-2]


def test_sites_cost_little_beside_the_wrenches():
    (curve,) = scaling.over_sites(rounds=5)
    print("\n", curve.line())
    none, one, *_, every = curve.cost
    assert none < one
    assert every < 2 * one


def test_coupled_sites_stay_within_their_number():
    (curve,) = scaling.over_coupled_sites()
    print("\n", curve.line())
    assert curve.cost[-1] < 3 * curve.cost[1]  # four sites against one


def test_memory_in_chunks_does_not_grow():
    whole, chunks = scaling.memory(most=100_000)
    print("\n", whole.line(), chunks.line())
    assert whole.cost[-1] > 3 * whole.cost[0]
    assert chunks.cost[-1] < 2 * chunks.cost[0] + 20
