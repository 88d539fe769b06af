"""Names of files where a scene, a model or a motion is wanted: the error says how to load them."""

import re
from pathlib import Path

import numpy as np
import pytest

import pinfric as pf

THREE = np.zeros(3)
CALLS = {
    "inverse_dynamics": lambda name: pf.inverse_dynamics(name, THREE, THREE, THREE),
    "joint_wrenches": lambda name: pf.joint_wrenches(name, THREE, THREE, THREE),
    "consistent_motion": lambda name: pf.consistent_motion(name, THREE, ["a"], [1.0], [1.0]),
    "forward_dynamics": lambda name: pf.forward_dynamics(name, THREE, THREE, THREE),
    "simulate": lambda name: pf.simulate(name, THREE, THREE, THREE, 1.0),
    "holds": lambda name: pf.holds(name, THREE, THREE),
    "Solver": lambda name: pf.Solver(name),
    "warm_up": lambda name: pf.warm_up(name),
    "load_trajectory": lambda name: pf.load_trajectory("three_link", name),
    "load_motion": lambda name: pf.load_motion("motion.npz", name),
    "size": lambda name: pf.size(name, "three_link"),
    "stop": lambda name: pf.stop(name, "three_link"),
    "retime": lambda name: pf.retime(name, "three_link"),
    "sweep": lambda name: pf.sweep(name, "three_link", "a.yaml"),
    "identify": lambda name: pf.identify(name, ["a.csv"]),
    "export": lambda name: pf.export(name),
    "mujoco_friction": lambda name: pf.mujoco_friction(name, None),
    "replay": lambda name: pf.replay(name, "three_link"),
}


@pytest.mark.parametrize("function", CALLS)
def test_a_scenes_name_is_no_scene(function):
    with pytest.raises(pf.PinfricError) as caught:
        CALLS[function]("three_link")
    assert str(caught.value) == (
        f"{function}: scene is a str, not a Scene; give pf.load_scene('three_link')"
    )


def test_every_public_function_of_a_scene_is_asked():
    """Those whose documentation has an argument `scene`, but results' and solvers' classes."""
    taken = set()
    for name in pf.__all__:
        function = getattr(pf, name)
        lines = (function.__doc__ or "") if callable(function) else ""
        if re.search(r"Args:.*^\s+(\w+, )*scene(, \w+)*: ", lines, re.S | re.M):
            taken.add(name)
    classes = {name for name in taken if name[0].isupper()} - {"Solver"}
    assert taken - classes <= set(CALLS)
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
