"""Isaac Lab's configuration, held against its documented keys: it cannot be installed here."""

from __future__ import annotations

import re
import sys
import types

import numpy as np
import pytest
from builders import example

import pinfric as pf

#: Fields of ActuatorBaseCfg and ImplicitActuatorCfg that Isaac Lab 2.3.2 and 3.0 both document.
DOCUMENTED = {
    "class_type",
    "joint_names_expr",
    "stiffness",
    "damping",
    "armature",
    "friction",
    "dynamic_friction",
    "viscous_friction",
    "effort_limit",
    "velocity_limit",
}


@pytest.fixture
def documented(monkeypatch):
    """A module of that name whose class takes the documented keys alone."""

    class ImplicitActuatorCfg:
        def __init__(self, **given):
            assert given.keys() <= DOCUMENTED
            self.__dict__.update(given)

    actuators = types.ModuleType("isaaclab.actuators")
    actuators.ImplicitActuatorCfg = ImplicitActuatorCfg
    monkeypatch.setitem(sys.modules, "isaaclab", types.ModuleType("isaaclab"))
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", actuators)


@pytest.mark.usefixtures("documented")
def test_the_configuration_holds_the_constants():
    made = pf.export(*example("ur5_pick_and_place", "ur5_pick_and_place.csv"), "isaaclab")
    read = {}
    exec(made.text, read)
    arm = read["ACTUATORS"]["arm"]
    for joint in made.joints:
        (name,) = [key for key in arm.friction if re.fullmatch(key, joint.joint)]
        assert name in arm.joint_names_expr
        assert arm.dynamic_friction[name] == joint.frictionloss
        assert arm.viscous_friction[name] == joint.damping
        assert arm.armature[name] == pytest.approx(joint.armature)
        width = 0.5 * (joint.rest_upper - joint.rest_lower)
        assert arm.friction[name] == pytest.approx(max(width, joint.frictionloss))
        assert arm.friction[name] >= arm.dynamic_friction[name]  # PhysX refuses less
        assert f"# {joint.joint}" in made.text
    assert not any("break-away" in line for line in made.left_out)
    assert any("gear losses" in line for line in made.left_out)


@pytest.mark.usefixtures("documented")
def test_odd_names_are_no_patterns():
    base = pf.load_scene("pendulum")
    model = base.model.copy()
    model.names[1] = "hinge.1+(a)"
    scene = pf.Scene(model, friction={"hinge.1+(a)": {"viscous": 1.0}})
    read = {}
    exec(pf.export(scene, to="isaaclab").text, read)
    (name,) = read["ACTUATORS"]["arm"].joint_names_expr
    assert re.fullmatch(name, "hinge.1+(a)")
    assert not re.fullmatch(name, "hingex1+(a)")
    assert np.isclose(read["VISCOUS_FRICTION"][name], 1.0)
