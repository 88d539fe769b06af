"""Names of files instead of a scene, a model or a motion: the error says how to load them."""

import re
from pathlib import Path

import numpy as np
import pytest
from tables import table

import pinfric as pf

THREE = np.zeros(3)
CALLS = """
inverse_dynamics(name, THREE, THREE, THREE)
joint_wrenches(name, THREE, THREE, THREE)
consistent_motion(name, THREE, ["a"], [1.0], [1.0])
forward_dynamics(name, THREE, THREE, THREE)
simulate(name, THREE, THREE, THREE, 1.0)
holds(name, THREE, THREE)
stand(name, "three_link")
Solver(name)
warm_up(name)
load_trajectory("three_link", name)
load_motion("motion.npz", name)
size(name, "three_link")
stop(name, "three_link")
retime(name, "three_link")
sweep(name, "three_link", "a.yaml")
identify(name, ["a.csv"])
export(name)
actuator_law(name, {})
mujoco_friction(name, None)
replay(name, "three_link")
"""


@pytest.mark.parametrize("call", [call for (call,) in table(CALLS)])
def test_a_scenes_name_is_no_scene(call):
    function = call.partition("(")[0]
    with pytest.raises(pf.PinfricError) as caught:
        eval(f"pf.{call}", {"pf": pf, "THREE": THREE, "name": "three_link"})
    assert str(caught.value) == (
        f"{function}: scene is a str, not a Scene; give pf.load_scene('three_link')"
    )


def test_every_public_function_of_a_scene_is_asked():
    """Those documented with an argument `scene`, without results' and solvers' classes."""
    taken = set()
    for name in pf.__all__:
        function = getattr(pf, name)
        lines = (function.__doc__ or "") if callable(function) else ""
        if re.search(r"Args:.*^\s+(\w+, )*scene(, \w+)*: ", lines, re.S | re.M):
            taken.add(name)
    classes = {name for name in taken if name[0].isupper()} - {"Solver"}
    assert taken - classes <= {call.partition("(")[0] for (call,) in table(CALLS)}
    assert len(taken - classes) >= 14


def test_another_thing_is_named_by_its_type():
    with pytest.raises(
        pf.PinfricError, match=r"scene is a dict, not a Scene; give the result of pf.load"
    ):
        pf.holds({}, THREE, THREE)


@pytest.mark.parametrize("given", ["a.urdf", Path("a.urdf"), None, 3])
def test_a_model_is_pinocchios(given):
    with pytest.raises(
        pf.PinfricError, match=r"should be a pin.Model; for a URDF, `pinfric new"
    ) as e:
        pf.Scene(model=given)
    assert type(given).__name__ in str(e.value)
    assert ("a.urdf" in str(e.value)) == (type(given) in (str, type(Path())))
    with pytest.raises(pf.PinfricError, match=r"should be a pin.Model"):
        pf.load_scene("pendulum").with_(model=given)


def test_a_motion_that_is_a_name_is_not_missing_v_and_a():
    scene = pf.load_scene("three_link")
    for name in ("three_link", Path("three_link")):
        with pytest.raises(pf.PinfricError) as caught:
            pf.inverse_dynamics(scene, name)
        assert str(caught.value) == (
            "inverse_dynamics: the motion is a file's name, 'three_link'; give "
            "pf.load_trajectory('three_link', scene)"
        )
