"""Demand of a path on each drive: followers, guides, gears."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from retime_cases import WAVE, one_joint, planar, straight

import pinfric as pf
from pinfric.retiming.retime import retime

MIMIC = """<robot name="pair"><link name="base"/>{}</robot>"""


TURNING = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="{1}" ixy="0"
  ixz="0" iyz="0"/></inertial></link><joint name="j{0}" type="revolute"><parent link="base"/>
  <child link="{0}"/><axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="10" velocity="9"/>
  {2}</joint>"""


def test_followers_rub_at_their_own_speed_and_direction(tmp_path):
    """The follower turns twice as fast, and backwards: J = 1 + 4 x 0.5, friction 1 + 2 x 0.7."""
    follows = '<mimic joint="ja" multiplier="-2"/>'
    links = TURNING.format("a", 1.0, "") + TURNING.format("b", 0.5, follows)
    (tmp_path / "pair.urdf").write_text(MIMIC.format(links))
    (tmp_path / "pair.yaml").write_text("""pinfric: 1
robot: {urdf: pair.urdf}
friction:
  ja: {coulomb: {static: 1.0, kinetic: 1.0}}
  jb: {coulomb: {positive: {static: 2.0, kinetic: 2.0}, negative: {static: 0.7, kinetic: 0.7}}}
""")
    scene = pf.load_scene(tmp_path / "pair.yaml")
    up, down = (10.0 - 2.4) / 3.0, (10.0 + 2.4) / 3.0
    found = retime(scene, straight(2.0))
    assert found.duration == pytest.approx(np.sqrt(2 * 2.0 * (1 / up + 1 / down)), rel=1e-4)
    assert found.excess < 1e-3


def test_guides_on_the_parent():
    body = lump(2.0)
    model = chain(("lead", pin.JointModelPX(), body))
    guide = {"kind": "guide", "length": 0.2, "width": 0.1, "on": "parent", "preload": 5.0}
    scene = pf.Scene(
        model=model,
        friction={
            "lead": {"bearing": guide, "mu": {"static": 0.2, "kinetic": 0.1}, "viscous": 3.0}
        },
    )
    found = retime(scene, straight(0.5), {"lead": {"peak_torque": 40.0}})
    assert found.excess < 1e-3
    assert found.usage.max() > 0.999


def test_gears_as_makers_give_them():
    """An efficiency that rises with the load: in acceleration it is that at the torque."""
    curve = [[2.0, 0.5], [5.0, 0.7], [10.0, 0.8]]
    gear = {
        "ratio": 50.0,
        "efficiency": {"over_load": curve},
        "back_efficiency": "same_loss",
        "no_load_torque": {"static": 0.02, "kinetic": 0.01},
    }
    scene = one_joint(inertia=2.0, transmission=gear)
    # at 10 N m the motor gives 10/0.8 N m/50 with all losses
    found = retime(scene, straight(3.0), {"j": {"peak_torque": 10.0 / 0.8 / 50.0}})
    most = found.trajectory.a.max()  # but for the start, which takes the static torque
    assert most == pytest.approx(10.0 / 2.0, rel=1e-3)
    assert found.excess < 1e-3
    arm = planar()
    gears = arm.with_(
        actuators=[{"joint": name, "transmission": gear | {"rotor_inertia": 3e-5}} for name in "ab"]
    )
    motors = {"a": {"peak_torque": 0.5}, "b": {"peak_torque": 0.25}}
    moved = retime(gears, WAVE, motors)
    assert moved.excess < 1e-3
    assert moved.usage.max() > 0.999
    assert moved.duration == pytest.approx(
        retime(gears, WAVE, motors, points=900).duration, rel=3e-3
    )
