"""Cost of frequencies of elastic gears beside the inverse dynamics of the same motion.

python -m pytest benchmarks/test_elastic.py -n 0 -s
"""

from __future__ import annotations

from measure import median_seconds

import pinfric as pf
from pinfric.elastic.motion import elasticity, trajectory_frequencies

ROUNDS = 60


def test_frequencies_cost_no_more_than_the_motion():
    """A UR10's cycle of 2351 samples, mass matrices included; measured 0.92."""
    scene = pf.load_scene("ur10_machine_tending")
    motion = pf.load_trajectory("ur10_machine_tending", scene)
    result = pf.inverse_dynamics(scene, motion)
    seconds = median_seconds(
        {
            "inverse": lambda: pf.inverse_dynamics(scene, motion),
            "frequencies": lambda: trajectory_frequencies(result),
            "all": lambda: elasticity(result),
        },
        ROUNDS,
    )
    ratios = {name: value / seconds["inverse"] for name, value in seconds.items()}
    print({name: round(ratio, 2) for name, ratio in ratios.items()})
    assert ratios["frequencies"] <= 1.0
