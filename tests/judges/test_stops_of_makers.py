"""Stopping times that a maker prints, beside those of its robot's scene."""

from __future__ import annotations

import numpy as np
import pytest

import pinfric as pf
from pinfric.study.stop.motion import Machine, stop_motion

#: Universal Robots UR10/CB3 user manual, 1.6.2 (2009-2020, p. 14): speed of the tool, m/s, and
#: longest stopping time of the safety system, s; arm extended horizontally, 10 kg, category 0 or 1.
#: The fourth row is printed as a second "1.5 m/s" between 2.0 and 3.0: read as 2.5.
PRINTED = {1.0: 0.450, 1.5: 0.500, 2.0: 0.550, 2.5: 0.600, 3.0: 0.650}
#: Brakes of the large and of the small joints, N m: not printed, the first is fitted to the slope.
LARGE, SMALL = 3.5, 2.45


def shoulder_stop(speed):
    """Time and way in which the falling shoulder of a UR10 stops, category 0, no delay."""
    scene = pf.load_scene("ur10_machine_tending")
    load = {"link": "tool0", "mass": 10.0, "com": [0.0, 0.0, 0.0]}
    scene = scene.with_(payloads={"load": load})
    names = scene.actuator_names
    torque = dict(zip(names, [LARGE] * 3 + [SMALL] * 3, strict=True))
    machine = Machine(scene, ("load",), torque, dict.fromkeys(names, 1e-4), {}, None)
    v = np.zeros(6)
    v[1] = speed / 1.2117  # the tool's distance from the vertical axis, arm extended
    found = stop_motion(machine, np.zeros(6), v)
    return found.rest_time[1], found.travel[-1][1]


def test_a_ur10_stops_the_slower_the_faster_it_was_as_its_maker_prints():
    """One brake torque and one reaction, detection included, give the five times to 2 %."""
    times = np.array([shoulder_stop(speed)[0] for speed in PRINTED])
    printed = np.array(list(PRINTED.values()))
    reaction = float((printed - times).mean())
    assert reaction == pytest.approx(0.326, abs=0.01)
    assert times + reaction == pytest.approx(printed, abs=0.012)
    assert np.diff(times).min() > 0.03
