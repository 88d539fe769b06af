"""Viscous friction that is a power of the speed, coefficient |v|^exponent."""

import numpy as np
import pytest
import yaml
from builders import sliding_block
from judges.verdict import judge
from numpy.testing import assert_allclose
from tables import table

import pinfric as pf
from pinfric.errors import SceneError
from pinfric.model.schema import Friction

DRAG, POWER, M = 2.0, 2.0 / 3.0, 1.0
METHODS = [("event", 1e-6), ("timestepping", 1e-3), ("regularized", 1e-6)]


def sliding(viscous, **more):
    return sliding_block({"viscous": viscous, **more}, mass=M)


def test_a_number_is_the_coefficient_of_the_speed_itself():
    assert Friction(viscous=3.0) == Friction(viscous={"coefficient": 3.0, "exponent": 1.0})
    assert Friction(viscous=3.0).model_dump()["viscous"] == {"coefficient": 3.0, "exponent": 1.0}
    assert Friction(viscous=0.0) == Friction()
    assert sliding({"coefficient": 3.0}).sites[0].law.viscous == 3.0


def test_effort_at_a_speed_has_the_closed_form_and_its_judge_agrees():
    """u = M a + sign(v) (F_c + c |v|^p); at rest anything within the static limits, no drag."""
    scene = sliding(
        {"coefficient": DRAG, "exponent": POWER}, coulomb={"static": 3.0, "kinetic": 1.0}
    )
    v = np.array([2.0, -0.3, 0.0])
    result = pf.inverse_dynamics(scene, np.zeros((3, 1)), v[:, None], np.full((3, 1), 0.5))
    moved = np.sign(v[:2]) * (1.0 + DRAG * np.abs(v[:2]) ** POWER)
    assert_allclose(result.effort_lower[:, 0], 0.5 * M + np.append(moved, -3.0), rtol=1e-14)
    assert_allclose(result.effort_upper[:, 0], 0.5 * M + np.append(moved, 3.0), rtol=1e-14)
    assert judge(result).passed()


def test_drag_at_rest_is_none_and_below_a_micrometre_per_second_a_straight_line():
    scene = sliding({"coefficient": DRAG, "exponent": POWER}, stick_velocity=0.0)
    v = np.array([0.0, 1e-7, -5e-7, 1e-6])
    result = pf.inverse_dynamics(scene, np.zeros((4, 1)), v[:, None], np.zeros((4, 1)))
    expected = DRAG * v * 1e-6 ** (POWER - 1.0)
    assert_allclose(result.effort_lower[:, 0], expected, rtol=1e-12)
    assert judge(result).passed()


@pytest.mark.parametrize(("method", "tolerance"), METHODS)
def test_a_body_runs_out_in_finite_time_and_stays(method, tolerance):
    """M dv/dt = -c v^p: v^(1-p) falls in proportion to t, to 0 at M v0^(1-p)/((1-p) c)."""
    scene = sliding({"coefficient": DRAG, "exponent": POWER})
    stops = M / ((1 - POWER) * DRAG)
    motion = pf.simulate(scene, [0.0], [1.0], [0.0], 1.2 * stops, method)
    expected = np.maximum(1 - motion.t / stops, 0.0) ** (1 / (1 - POWER))
    assert_allclose(motion.v[:, 0], expected, rtol=0, atol=tolerance)


WRONG = r"""
{coefficient: -1.0}                  viscous\.coefficient`: .*at least 0, found -1
{coefficient: 1.0, exponent: 0.0}    viscous\.exponent`: .*greater than 0
{coefficient: 1.0, exponent: 40.0}   viscous\.exponent`: .*at most 4
{exponent: 0.5}                      viscous\.coefficient` is missing
{coeficient: 1.0}                    'coefficient'
"""


@pytest.mark.parametrize(("viscous", "says"), table(WRONG, yaml.safe_load, str))
def test_what_cannot_be_is_named(viscous, says):
    with pytest.raises(SceneError, match=says):
        sliding(viscous)


@pytest.mark.parametrize("size", [5.0, 0, 0.0])
def test_a_number_is_coulomb_friction_at_rest_and_in_motion(size):
    both = {"static": size, "kinetic": size}
    scenes = [sliding_block({"coulomb": form}) for form in (size, both)]
    for v in (0.0, 1.0, -1.0):
        found = [pf.inverse_dynamics(s, [[0.0]], [[v]], [[0.0]]) for s in scenes]
        assert found[0].effort_upper == found[1].effort_upper
        assert found[0].effort_lower == found[1].effort_lower
    with pytest.raises(SceneError, match="coulomb`: should be at least 0, found -1"):
        sliding_block({"coulomb": -1.0})
