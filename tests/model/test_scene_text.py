"""A scene that is written is the scene that is read back."""

import numpy as np
import pytest
from replay_cases import ROBOTS
from standing_cases import biped

import pinfric as pf
from pinfric.model.scene_text import robot_with_bodies, scene_content
from pinfric.model.schema import Assumed, SceneFile
from pinfric.model.yamlfile import yaml_text

SCENES = sorted(p.stem for p in ROBOTS.glob("*.yaml") if p.name.count(".") == 1)
#: Keys that no bundled scene has, as the scenes of the tests have them.
RARE = {
    "assumed": Assumed(by="us", date="", version="1", values={"friction.crank_pin.mu": "0.1"}),
    "loop_tolerance": {"angle": 2e-5},
    "redundancy_length": 0.2,
    "stops": {"category": 0, "reaction_time": 0.02},
    "sized": {"joints": {"crank_pin": 1.5}},
}


@pytest.mark.filterwarnings("ignore::pinfric.PinfricWarning")
def test_bundled_scenes_and_rare_keys_are_read_back(tmp_path):
    said = set()
    standing = biped(tmp_path, more="feet:\n  left_foot: {length: 0.2, width: 0.1}\n")
    for name in (*SCENES, standing):
        scene = pf.load_scene(name)
        if name == "four_bar":
            scene = scene.with_(**RARE)
        (tmp_path / "robot.urdf").write_text(robot_with_bodies(scene.robot, scene.model))
        for urdf in ("", "robot.urdf"):
            content = scene_content(scene, scene.robot, tmp_path, urdf)
            (tmp_path / "scene.yaml").write_text(yaml_text(content))
            read = pf.load_scene(tmp_path / "scene.yaml")
            for key in ("friction", "actuators", "payloads", "simulation", "measured", "springs"):
                assert getattr(read, key) == getattr(scene, key), (name, key)
            for key in ("stops", "tool", "feet", "masses_hold", "stick_velocity", *RARE):
                assert getattr(read, key) == getattr(scene, key), (name, key)
            for ours, theirs in zip(read.loops, scene.loops, strict=True):
                assert np.allclose(ours.a.xyz, theirs.a.xyz, atol=1e-9)
            for ours, theirs in zip(read.model.inertias, scene.model.inertias, strict=True):
                assert ours.isApprox(theirs, 1e-9), name
            said |= content.keys()
    assert said == SceneFile.model_fields.keys()
