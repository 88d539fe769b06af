"""Doubts about a robot's mass as a whole, by rods on a known way."""

import re

import numpy as np
import pytest
from builders import lump, row
from robot_cases import urdf

import pinfric as pf
from pinfric.checking.robot import RobotFacts
from pinfric.model.robot import read_robot
from pinfric.model.total_mass import doubted_mass, doubted_reach, reach_of
from pinfric.show.inverse_summary import inverse_summary
from pinfric.show.report.inverse import verdict


def arm(mass, length, joints=3):
    return row([f"j{k}" for k in range(joints)], lump(mass, [length / 2, 0, 0]), length)


@pytest.mark.parametrize(
    ("mass", "length", "says", "impossible"),
    [
        (2.0, 0.5, "", False),  # 6 kg on 1 m
        (0.7, 0.5, "", False),  # 2.1 kg/m^3
        (0.6, 0.5, "1.8 kg/m^3 of that length cubed; the lightest arms have 3.2", False),
        (0.006, 0.5, "0.018 kg/m^3 of that length cubed; the lightest arms have 3.2; if", True),
        (2000.0, 0.5, "6000 kg/m^3 of that length cubed; robots have up to 300; if", True),
        (200.0, 0.5, "600 kg/m^3 of that length cubed; robots have up to 300", False),
        (0.7, 0.1, "", False),  # a hand on 0.2 m: 262 kg/m^3
        (7.0, 0.1, "", False),
        (70.0, 0.1, "26250 kg/m^3 of that length cubed; robots have up to 300; if", True),
        (1.0, 500.0, "its joints reach 1000 m: no robot is so large", True),
    ],
)
def test_mass_over_the_way_cubed(mass, length, says, impossible):
    model = arm(mass, length)
    doubt = doubted_reach(reach_of(model)) or doubted_mass(model)
    assert (doubt is not None and doubt.impossible) == impossible
    assert ("" if doubt is None else doubt.text).count(says or "x") == bool(says)
    unit = {0.006: "t: 18 kg", 2000.0: "g: 6 kg", 70.0: "g: 0.21 kg", 1.0: "mm: 1 m"}.get(mass)
    assert (doubt.if_unit if doubt else "") == (f"if it is in {unit}" if unit else "")
    two = doubted_mass(arm(mass, length, joints=2))
    assert two is None or not two.light


def test_the_way_is_that_of_the_file_with_what_is_fixed(tmp_path):
    """0.3 m to the second joint, past a corner 0.5 m, 0.2 m to the flange; without the pedestal."""
    links = "".join(f'<link name="{name}"/>' for name in "abcd")
    text = "".join(
        f'<joint name="{parent}{child}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{xyz}"/><axis xyz="0 1 0"/></joint>'
        for parent, child, kind, xyz in (
            ("base", "a", "continuous", "0 0 9"),
            ("a", "b", "fixed", "0.3 0 0"),
            ("b", "c", "continuous", "0 0 0.5"),
            ("c", "d", "fixed", "0 0.2 0"),
        )
    )
    file = urdf(tmp_path, links, text)
    assert reach_of(read_robot(file, {}).model) == pytest.approx(1.0)
    assert RobotFacts.of(file).reach == pytest.approx(1.0)
    assert reach_of(read_robot(file, {"bc": 0.3}).model) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("mass", "step", "says"),
    [
        (2.0, 0.5, "the URDF limits no effort"),
        (0.002, 0.5, "not to be used: robot: 0.006 kg move on 1 m of joints"),
        (
            2.0,
            500.0,
            "not to be used: robot: its joints reach 1000 m: .* wrong; if it is in mm: 1 m$",
        ),
    ],
)
def test_inverse_repeats_what_cannot_be(mass, step, says):
    scene = pf.Scene(arm(mass, step))
    zero = np.zeros((2, 3))
    motion = pf.Trajectory.from_arrays(scene, np.array([0.0, 1.0]), zero, zero, zero)
    result = pf.inverse_dynamics(scene, motion)
    assert re.search(says, verdict(result, inverse_summary(result, "")))
