"""The `simulation` section of a scene file, run."""

from __future__ import annotations

import pytest

import pinfric as pf
from pinfric.errors import SimulationError


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
@pytest.mark.parametrize("t_end", [0, 0.0, -1.0])
def test_an_end_that_is_given_is_not_replaced_by_the_scenes(method, t_end):
    """At 0 the scene's own two seconds ran."""
    with pytest.raises(SimulationError, match="t_end"):
        pf.run_scene(pf.load_scene("pendulum"), t_end=t_end, method=method)


def test_without_an_end_it_is_the_scenes():
    scene = pf.load_scene("pendulum")
    assert pf.run_scene(scene).t[-1] == scene.simulation.t_end
    assert pf.run_scene(scene, t_end=0.25).t[-1] == 0.25
