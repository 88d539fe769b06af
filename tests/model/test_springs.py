"""Stiffness lines against makers' printed figures, and refusals."""

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import chain, lump
from tables import table

import pinfric as pf
from pinfric.model.springs import (
    LostMotionStiffness,
    StiffnessLines,
    largest_friction,
    softest,
    spring_of,
)
from pinfric.model.transmission import Transmission

HFUC_32 = StiffnessLines(k1=6.7e4, k2=1.1e5, k3=1.2e5, t1=29, t2=108)
CSG_25 = StiffnessLines(k1=3.1e4, k2=5.0e4, k3=5.7e4, t1=14, t2=48)
ARCMIN = np.pi / 180 / 60


def test_the_makers_example():
    """Harmonic Drive 1019659 11/2014, p. 23: 60 N m on an HFUC-32-100 twist 7.15e-4 rad."""
    found = spring_of(HFUC_32).wind_up(60.0)
    assert found == pytest.approx(7.15e-4, abs=0.005e-4)
    assert found == pytest.approx(29 / 6.7e4 + 31 / 1.1e5, rel=1e-14)
    assert found / ARCMIN == pytest.approx(2.5, abs=0.05)


def test_three_lines_their_tangents_and_back():
    spring = spring_of(HFUC_32)
    torque = np.array([-200.0, -108.0, -60.0, -1.0, 0.0, 1.0, 28.9, 29.0, 107.9, 108.0, 300.0])
    angle = spring.wind_up(torque)
    np.testing.assert_allclose(spring.torque(angle), torque, atol=1e-11)
    np.testing.assert_allclose(angle, -spring.wind_up(-torque))
    assert (np.diff(angle) > 0).all()
    above = spring.tangent(torque)
    np.testing.assert_array_equal(
        above, [1.2e5, 1.2e5, 1.1e5, *[6.7e4] * 4, 1.1e5, 1.1e5, 1.2e5, 1.2e5]
    )
    third = 29 / 6.7e4 + 79 / 1.1e5 + 192 / 1.2e5
    assert spring.wind_up(300.0) == pytest.approx(third, rel=1e-14)


def test_one_stiffness():
    assert spring_of(2e4).wind_up(-10.0) == -5e-4
    assert softest(2e4) == 2e4


def test_strain_wave_gears_show_their_lost_motion_by_k1_alone():
    """Harmonic Drive states "< 1 arcmin" at 4 % of the rated torque: sizes 17, 25, 32."""
    for k1, rated, arcmin in ((1.0e4, 24, 0.66), (3.1e4, 67, 0.59), (6.7e4, 137, 0.56)):
        assert 2 * spring_of(k1).wind_up(0.04 * rated) / ARCMIN == pytest.approx(arcmin, abs=0.006)


def test_lost_motion_is_the_width_at_its_share():
    given = LostMotionStiffness(k=3.9e5, lost_motion=2.9e-4, rated_torque=412.0, share=0.03)
    spring = spring_of(given)
    assert 2 * spring.wind_up(0.03 * 412.0) == pytest.approx(2.9e-4, rel=1e-14)
    assert spring.tangent(100.0) == 3.9e5
    rise = spring.wind_up(400.0) - spring.wind_up(100.0)
    assert rise == pytest.approx(300.0 / 3.9e5, rel=1e-12)


def test_hysteresis_and_friction_are_each_others_inverse():
    """With friction b behind the spring the output follows after the torque has changed by 2 b."""
    spring = spring_of(CSG_25)
    assert 2.0 * spring.wind_up(15.0) / ARCMIN == pytest.approx(3.24, abs=0.005)
    for b in (0.5, 14.0, 80.0):
        assert largest_friction(spring, 2.0 * float(spring.wind_up(b))) == pytest.approx(b)
    assert largest_friction(spring, ARCMIN) == pytest.approx(0.5 * ARCMIN * 3.1e4)


@pytest.mark.parametrize(
    "given", [CSG_25, LostMotionStiffness(k=4e5, lost_motion=3e-4, rated_torque=400.0)]
)
def test_scaled_lines_wind_up_in_proportion(given):
    torque = np.linspace(-300, 300, 61)
    twice = spring_of(given.scaled(2.0)).wind_up(torque)
    np.testing.assert_allclose(twice, 0.5 * spring_of(given).wind_up(torque), rtol=1e-13)


WRONG = r"""
0.0                                          stiffness`: should be greater than 0, found 0
-1.0e+4                                      greater than 0
stiff                                        should be a number
{k1: 5.0e+4, k2: 3.0e+4, t1: 14}             stiffness falls with torque: k2 30000 is below k1
{k1: 3.0e+4, k2: 5.0e+4, k3: 4.0e+4, t1: 14, t2: 48}  k3 40000 is below k2 50000
{k1: 3.0e+4, k2: 5.0e+4, k3: 6.0e+4, t1: 48, t2: 14}  t2 14 is not above t1 48
{k1: 3.0e+4, k2: 5.0e+4, k3: 6.0e+4, t1: 14}  `k3` and `t2` belong together
{k1: 3.0e+4, k2: 5.0e+4}                     t1` is missing
{k1: 3.0e+4, k2: 5.0e+4, t1: 14, k4: 1.0}    unknown key
{k: 1.0e+4, lost_motion: 3.0e-4, rated_torque: 400}  stiffness falls with torque
{k: 4.0e+5, lost_motion: 0.0, rated_torque: 400}     greater than 0
"""


@pytest.mark.parametrize(("stiffness", "message"), table(WRONG, yaml.safe_load, str))
def test_stiffness_that_cannot_be(stiffness, message):
    gear = {"ratio": 100.0, "stiffness": stiffness}
    with pytest.raises(pf.PinfricError, match=message):
        pf.Scene(_pendulum(), actuators=[{"joint": "pin", "transmission": gear}])


def test_hysteresis_needs_a_stiffness_and_a_plausible_unit():
    with pytest.raises(ValueError, match="needs `stiffness`"):
        Transmission(ratio=100.0, hysteresis=3e-4)
    gear = {"ratio": 100.0, "stiffness": 1e4, "hysteresis": 1.0}
    with pytest.warns(pf.PinfricWarning, match=r"hysteresis = 1 rad: usually at most 0.0012 rad"):
        pf.Scene(_pendulum(), actuators=[{"joint": "pin", "transmission": gear}])


@pytest.mark.parametrize(
    ("tool", "says"),
    [
        ("tol0", "tool: there is no link 'tol0'"),
        ("base_link", "tool: 'base_link' is fixed to the ground"),
    ],
)
def test_a_tool_that_cannot_be_is_refused(tool, says):
    with pytest.raises(pf.PinfricError, match=says):
        pf.load_scene("ur10_machine_tending").with_(tool=tool)
    with pytest.raises(pf.PinfricError, match=r"scene: tool: there is no link"):
        pf.Scene(_pendulum(), tool=tool)


def _pendulum():
    body = lump(1.0, [0.0, 0.0, 0.5])
    return chain(("pin", pin.JointModelRX(), body))
