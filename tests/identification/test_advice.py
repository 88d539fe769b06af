"""The advised next recording does what was promised."""

import numpy as np
from identify_cases import NAMES

import pinfric as pf
from pinfric.identification.advice import advice_text


def test_advice_is_what_a_further_log_does(found):
    again = next(one for one in found.advice if one.name == "As fast as before")
    slow = next(one for one in found.advice if one.name == "At a fifth of the speed")
    key = f"friction.{NAMES[5]}.coulomb.positive"
    assert slow.factors[key] < again.factors[key] < 1.0  # Coulomb friction shows where it is slow
    loaded = next(one for one in found.advice if one.load > 0.0)
    gear = f"transmission.{NAMES[1]}.efficiency"
    assert loaded.factors[gear] < again.factors[gear]


def test_the_advised_way_points_run_and_leave_rest_on_their_own(found, tmp_path):
    path = tmp_path / "advice.waypoints.yaml"
    path.write_text(advice_text(found.advice[0], found.scene))
    motion = pf.load_trajectory(path, found.scene)
    assert not motion.warnings
    assert motion.duration > 60.0
    # the first departure: joint 1 alone, its inertia far below its friction
    moving = np.flatnonzero(np.abs(motion.v).sum(axis=1) > 0.0)[:50]
    assert (motion.v[moving, 1:] == 0.0).all()
    assert np.abs(motion.a[moving, 0]).max() < 0.05
