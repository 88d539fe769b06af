"""Actuators against the freedoms that loops leave."""

from __future__ import annotations

import numpy as np
import pytest
from mechanisms import four_bar

import pinfric as pf
from pinfric.errors import (
    SceneError,
    UndrivenMotionError,
)


def scene_with(actuators, **more):
    scene, _ = four_bar()
    return pf.Scene(model=scene.model, loops=scene.loops, actuators=actuators, **more)


@pytest.mark.parametrize(
    ("actuators", "says"),
    [
        ([], "0 for 1 degree of freedom; undriven: A, where this motion needs 0.389 .* sample 0"),
        ([{"joint": "O"}, {"joint": "A"}], "2 for 1 degree of freedom: .*keep only 1 of O, A"),
        (None, "3 for 1 degree of freedom: .*keep only 1 of O, A, C"),
        ([{"joint": "X"}], "joint 'X' is not there"),
        ([{"joint": "O"}, {"joint": "O"}], "'O' is listed twice"),
    ],
)
def test_actuators_are_counted_against_the_freedoms_that_loops_leave(actuators, says):
    q = four_bar()[0].close(np.full(3, 0.5))
    with pytest.raises((SceneError, UndrivenMotionError), match=says):
        pf.inverse_dynamics(scene_with(actuators), q, np.zeros(3), np.zeros(3))
