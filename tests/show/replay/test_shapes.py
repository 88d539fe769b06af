"""The look of a robot: visuals, or shapes from inertias."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from builders import random_tree
from replay_cases import arm, drawn

import pinfric as pf
from pinfric.errors import PinfricWarning
from pinfric.show.replay.shapes import robot_shapes

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def test_robot_without_urdf_is_drawn_from_its_inertias():
    scene = pf.Scene(model=random_tree(2, joints=4))
    shapes = robot_shapes(scene)
    assert [shape.joint for shape in shapes if shape.kind == "body"] == [1, 2, 3, 4]
    assert sum(shape.kind == "line" for shape in shapes) == 4
    window = drawn(scene)
    assert (
        sum(b"/body_" in command and b"set_object" in command for command in window.commands) == 4
    )


OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def test_mesh_beside_the_urdf_is_scaled_and_painted(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "plate.obj").write_text(OBJ)
    scene = arm(tmp_path, "meshes/plate.obj")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shapes = robot_shapes(scene)
    (plate,) = [shape for shape in shapes if shape.joint == 1]
    assert plate.kind == "visual"
    np.testing.assert_allclose(plate.mesh.vertices.max(axis=0), [2, 2, 0])
    assert tuple(plate.mesh.visual.vertex_colors[0]) == (255, 0, 0, 128)


def test_missing_and_broken_meshes_become_shapes_with_one_warning(tmp_path):
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    scene = arm(tmp_path, "package://nowhere/a.dae", "broken.stl", "c.obj")
    with pytest.warns(PinfricWarning) as caught:
        shapes = robot_shapes(scene)
    assert len(caught) == 1
    text = str(caught[0].message)
    assert all(name in text for name in ("nowhere/a.dae", "broken.stl", "c.obj", "arm.urdf"))
    assert [shape.joint for shape in shapes if shape.kind == "body"] == [1]
