import numpy as np
import pinocchio as pin
from builders import chain, lump
from mechanisms import pin_friction

import pinfric as pf
from pinfric.retiming.path import Path


def one_joint(inertia=2.0, friction=None, transmission=None):
    """A joint about the vertical that turns a body whose inertia is `inertia`."""
    body = pin.Inertia(1.0, np.zeros(3), np.diag([inertia] * 3))
    model = chain(("j", pin.JointModelRZ(), body), gravity=0.0)
    actuators = None
    if transmission is not None:
        actuators = [{"joint": "j", "transmission": transmission}]
    return pf.Scene(model=model, friction=friction or {}, actuators=actuators)


def straight(end, start=0.0):
    return Path.from_waypoints([[start], [end]])


def planar(friction=True):
    """Two hanging links with all kinds of friction and lossy gears."""
    upper = lump(3.0, [0, 0, -0.2], 0.05)
    lower = lump(1.5, [0, 0, -0.15], 0.02)
    model = chain(("a", pin.JointModelRY(), upper), ("b", pin.JointModelRY(), lower, [0, 0, -0.4]))
    entry = pin_friction(0.1, 0.03, static=0.15) | {
        "coulomb": {
            "positive": {"static": 0.5, "kinetic": 0.4},
            "negative": {"static": 0.4, "kinetic": 0.3},
        },
        "viscous": 0.2,
        "stribeck": {"velocity": 0.3},
    }
    gear = {
        "ratio": 60.0,
        "efficiency": 0.85,
        "back_efficiency": 0.8,
        "rotor_inertia": 3e-5,
        "no_load_torque": 0.01,
        "motor_viscous": 2e-5,
    }
    return pf.Scene(
        model=model,
        friction=dict.fromkeys("ab", entry) if friction else {},
        actuators=[{"joint": name, "transmission": gear} for name in "ab"],
    )


WAVE = Path.spline(np.arange(4.0), [[0.0, 0.0], [1.2, -0.8], [0.4, 0.5], [-0.5, 1.0]])


STOPS = Path.from_waypoints([[0.0, 0.0], [1.0, 0.4], [0.2, -0.5]], holds=[0.0, 0.3, 0.1])


MOTORS = {"a": {"peak_torque": 0.32}, "b": {"peak_torque": 0.12}}


def lifting():
    """A joint about a horizontal axis, with a weight at 0.5 m: 9.81 N m at q = 90 deg."""
    weight = lump(2.0, [0, 0, -0.5], 1e-3)
    model = chain(("j", pin.JointModelRY(), weight))
    model.upperPositionLimit[:] = 3.0
    model.lowerPositionLimit[:] = -3.0
    return pf.Scene(model=model)


WAY = """pinfric_trajectory: 1
points:
  - {q: [0.0], hold: 0.2}
  - {q: [1.5], duration: 2.0, hold: 0.4}
  - {q: [0.0], duration: 2.0}
"""


URDF = """<robot name="table"><link name="base"/><link name="plate"><inertial><mass value="3"/>
  <inertia ixx="1" iyy="1" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="table" type="continuous"><parent link="base"/><child link="plate"/>
  <axis xyz="0 0 1"/><limit effort="40" velocity="3"/></joint></robot>"""
