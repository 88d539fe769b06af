"""Primitives and meshes of a URDF."""

from __future__ import annotations

import numpy as np
import pytest
from replay_cases import ROBOTS

import pinfric as pf
from pinfric.show.replay.meshes import urdf_visuals

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def test_urdfs_primitives_are_drawn_as_they_are():
    scene = pf.load_scene(ROBOTS / "three_link.yaml")
    visuals, missing = urdf_visuals(scene.model, scene.robot)
    assert (len(visuals), missing) == (6, {})
    bar = visuals[1]  # link_1's box, 0.07 x 0.4 x 0.07 at (0, 0.2, 0), red
    assert bar.joint == 1
    np.testing.assert_allclose(np.ptp(bar.mesh.vertices, axis=0), [0.07, 0.4, 0.07])
    np.testing.assert_array_equal(bar.placement.translation, [0, 0.2, 0])
    assert tuple(bar.mesh.visual.vertex_colors[0]) == (204, 76, 64, 255)
