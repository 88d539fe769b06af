import numpy as np
import pytest
import trimesh
from check_cases import TIP, J, arm, errors
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.checking.findings import Severity
from pinfric.checking.link_extent import Extent
from pinfric.checking.robot import RobotFacts
from pinfric.show.replay.meshes import read_mesh

# Link extent: how large links are: boxes know distances.


def test_boxes_know_distances():
    box = Extent(np.array([0.0, 0.0, 0.0]), np.array([1.0, 2.0, 2.0]))
    assert box.diagonal == 3.0
    assert box.distance(np.array([0.5, 1.0, 1.0])) == 0.0
    assert box.distance(np.array([4.0, 6.0, 1.0])) == 5.0
    assert box.farthest(np.array([0.0, 0.0, 0.0])) == 3.0


# Links: links whose masses or centres of mass do not fit their shapes.


@pytest.mark.parametrize(
    ("shape", "severity"), [("0.05 0.05 0.4", "WARNING"), ("1e-3 " * 3, "NOTE")]
)
def test_a_link_with_shapes_should_have_a_mass(tmp_path, shape, severity):
    """Without one it is a frame between two joints, and its weight is missing silently."""
    file = arm(tmp_path)
    rod = f'<inertial><origin xyz="0 0 0.2"/><mass value="2"/>{J}</inertial>'
    text = file.read_text()
    assert rod in text
    file.write_text(text.replace(rod, "").replace("0.05 0.05 0.4", shape))
    (found,) = (f for f in pf.check(file).findings if f.kind == "massless link")
    assert (found.severity.name, found.place) == (severity, "link rod")


def test_centre_of_mass_against_the_link_itself(tmp_path):
    """The rod is 0.05 x 0.05 x 0.4 about (0, 0, 0.2): 0.3 m beside it is 0.275 m outside."""
    file = arm(tmp_path)
    file.write_text(
        file.read_text().replace('<origin xyz="0 0 0.2"/><mass', '<origin xyz="0.3 0 0.2"/><mass')
    )
    (found,) = (f for f in pf.check(file).findings if f.kind == "centre of mass")
    assert "0.275 m outside" in found.text
    assert found.if_unit == ""


def test_a_last_link_without_shapes_may_be_longer_than_the_rest(tmp_path):
    """The URDF of one rod on a short stand tells no length: 0.1 m says nothing of 0.25 m."""
    file = tmp_path / "rod.urdf"
    for stand in (0.0, 0.1):
        file.write_text(f"""<robot name="r"><link name="base"/>
          <link name="rod"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>{J}</inertial></link>
          <joint name="j" type="continuous"><parent link="base"/><child link="rod"/>
          <origin xyz="0 0 {stand}"/><axis xyz="0 1 0"/></joint></robot>""")
        assert not pf.check(file).count(Severity.WARNING)
    file.write_text(file.read_text().replace("0.25 0 0", "250 0 0"))
    (found,) = errors(pf.check(file))
    assert found.if_unit == "if it is in mm: 0.25 m"


# Robot: a URDF as the checks see it: shapes measured where they stand, meshes in their unit.


def test_shapes_are_measured_where_they_stand(tmp_path):
    """A cylinder along z, turned by 90 degrees about x and moved, lies along y."""
    shape = """<visual><origin xyz="1 0 0" rpy="1.5707963267948966 0 0"/><geometry>
      <cylinder radius="0.1" length="2"/></geometry></visual>"""

    file = arm(tmp_path, tip=TIP + shape)
    extent = RobotFacts.of(file).extents["tip"]
    assert_allclose(extent.low, [0.9, -1.0, -0.1], atol=1e-12)
    assert_allclose(extent.high, [1.1, 1.0, 0.1], atol=1e-12)


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
    assert_allclose(size, [0.04, 0.02, 0.01], rtol=1e-6)
    assert_allclose(np.ptp(read_mesh(tmp_path / "box.dae").vertices, axis=0), size)
