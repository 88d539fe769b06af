"""Links whose masses or centres of mass do not fit their shapes."""

from __future__ import annotations

import pytest
from check_cases import J, arm, errors

import pinfric as pf
from pinfric.checking.findings import Severity


@pytest.mark.parametrize(
    ("shape", "severity"), [("0.05 0.05 0.4", "WARNING"), ("1e-3 " * 3, "NOTE")]
)
def test_a_link_with_shapes_should_have_a_mass(tmp_path, shape, severity):
    """Without one it is a frame between two joints; its weight would be missing silently."""
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
    """Of one rod on a short stand the URDF tells no length: 0.1 m says nothing of 0.25 m."""
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
