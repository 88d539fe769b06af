"""A URDF as the checks see it: shapes measured where they stand, meshes in their unit."""

from __future__ import annotations

import numpy as np
import trimesh
from check_cases import TIP, arm

from pinfric.checking.robot import RobotFacts
from pinfric.show.replay.meshes import read_mesh


def test_shapes_are_measured_where_they_stand(tmp_path):
    """A cylinder along z, turned by 90 degrees about x and moved, lies along y."""
    shape = """<visual><origin xyz="1 0 0" rpy="1.5707963267948966 0 0"/><geometry>
      <cylinder radius="0.1" length="2"/></geometry></visual>"""

    file = arm(tmp_path, tip=TIP + shape)
    extent = RobotFacts.of(file).extents["tip"]
    np.testing.assert_allclose(extent.low, [0.9, -1.0, -0.1], atol=1e-12)
    np.testing.assert_allclose(extent.high, [1.1, 1.0, 0.1], atol=1e-12)


def test_collada_meshes_are_in_the_unit_that_they_name(tmp_path):
    """As RViz and Gazebo read them: a box of 40 mm is 0.04 m."""
    box = trimesh.creation.box(extents=(40.0, 20.0, 10.0))
    text = trimesh.exchange.dae.export_collada(box).decode()
    unit = '<unit name="millimeter" meter="0.001"/>'
    text = text.replace("</created>", f"</created>\n{unit}", 1)
    assert unit in text
    (tmp_path / "box.dae").write_text(text)
    mesh = '<visual><geometry><mesh filename="box.dae"/></geometry></visual>'
    file = arm(tmp_path, tip=TIP + mesh)
    size = RobotFacts.of(file).extents["tip"].size
    np.testing.assert_allclose(size, [0.04, 0.02, 0.01], rtol=1e-6)
    np.testing.assert_allclose(np.ptp(read_mesh(tmp_path / "box.dae").vertices, axis=0), size)
