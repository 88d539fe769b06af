"""Implausible masses and limits of a robot as a whole, by deliberate faults."""

import itertools
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import trimesh
import yaml
from robot_cases import INERTIA, urdf
from tables import table

import pinfric as pf
from pinfric.checking.findings import Severity
from pinfric.checking.robot import RobotFacts
from pinfric.model.robot import example_robot_data

WHOLE = ("no mass", "masses", "equal masses", "one density", "equal inertias")


def on_the_whole(report):
    return {f.kind: f for f in report.findings if f.place == "robot" and f.kind in WHOLE}


#: Arms, legs, a humanoid and a hand whose masses are their maker's.
ROBOTS = [
    next(example_robot_data().rglob(name))
    for name in ("ur5_robot.urdf", "panda.urdf", "z1.urdf", "anymal.urdf", "talos_reduced.urdf")
]


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda p: p.stem)
@pytest.mark.parametrize(
    ("factor", "severity", "unit"),
    [(1.0, 0, ""), (1e3, 3, "in g: "), (1e-3, 3, "in t: "), (0.05, 2, "")],
)
def test_a_wrong_unit_of_all_masses_is_one_finding(tmp_path, robot, factor, severity, unit):
    tree = ElementTree.parse(robot)
    for mass, inertia in zip(tree.iter("mass"), tree.iter("inertia"), strict=True):
        mass.set("value", repr(factor * float(mass.get("value"))))
        for key, value in inertia.attrib.items():
            inertia.set(key, repr(factor * float(value)))
    for mesh in tree.iter("mesh"):  # where the copy finds them
        mesh.set("filename", mesh.get("filename"))
    tree.write(tmp_path / "robot.urdf")
    found = on_the_whole(pf.check(tmp_path / "robot.urdf"))
    assert ("masses" in found) == (severity > 0)
    if severity:
        assert found["masses"].severity >= severity
        assert unit in found["masses"].if_unit


def arm(masses, limits=(), speeds=(), inertia=None, shape=""):
    """Level rods of 0.5 m about y axes."""
    parts, parent = [], "base"
    for i, mass in enumerate(masses):
        moment = mass * 0.5**2 / 12
        own = inertia or (
            f'<inertia ixx="{moment / 50}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/>'
        )
        parts.append(
            f'<link name="l{i}"><inertial><origin xyz="0.25 0 0"/><mass value="{mass}"/>{own}'
            f"</inertial>{shape.format(i)}</link>"
            f'<joint name="j{i}" type="revolute"><parent link="{parent}"/><child link="l{i}"/>'
            f'<origin xyz="{0.5 * (i > 0)} 0 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" '
            f'effort="{(limits or [9] * len(masses))[i]}" '
            f'velocity="{(speeds or [3] * len(masses))[i]}"/></joint>'
        )
        parent = f"l{i}"
    return parts


@pytest.mark.parametrize(
    ("masses", "inertia", "kinds"),
    [
        ((10, 6, 4), None, []),
        ((12, 12, 12, 12, 12), None, ["equal masses"]),
        ((2, 2, 2, 2), None, []),  # too few on one way
        ((12, 12, 12, 11, 12, 13), None, []),  # 4 of 6
        ((0, 0, 0), INERTIA, ["no mass"]),
        ((3, 2, 1), INERTIA, ["equal inertias"]),
    ],
)
def test_placeholders_of_masses_are_one_finding(tmp_path, masses, inertia, kinds):
    report = pf.check(urdf(tmp_path, *arm(masses, inertia=inertia)))
    assert list(on_the_whole(report)) == kinds
    assert (report.errors > 0) == (kinds == ["no mass"])


BOXES = (
    (0.2, 0.1, 0.1),
    (0.3, 0.1, 0.08),
    (0.25, 0.08, 0.08),
    (0.1, 0.07, 0.07),
    (0.05, 0.06, 0.06),
)


@pytest.mark.parametrize(
    ("densities", "says"),
    [
        ((1000,) * 5, "all links have 1000 kg/m^3 of their meshes"),
        ((1000, 1000, 2700, 1000, 1000), "4 of 5 links have 1000"),
        ((1700, 900, 2400, 1200, 600), ""),
    ],
)
def test_masses_computed_from_meshes_of_one_density_are_noted(tmp_path, densities, says):
    faces = "".join(
        f"f {' '.join(face)}\n"
        for face in (
            "132",
            "143",
            "567",
            "578",
            "126",
            "165",
            "237",
            "276",
            "348",
            "387",
            "415",
            "458",
        )
    )
    masses = []
    for i, (box, density) in enumerate(zip(BOXES, densities, strict=True)):
        ring = ((0, -1), (1, -1), (1, 1), (0, 1))
        corners = [(a * box[0], b * box[1] / 2, c * box[2] / 2) for c in (-1, 1) for a, b in ring]
        text = "".join("v {} {} {}\n".format(*corner) for corner in corners)
        (tmp_path / f"b{i}.obj").write_text(text + faces)
        masses.append(density * float(np.prod(box)))
    shape = '<visual><geometry><mesh filename="b{}.obj"/></geometry></visual>'
    found = on_the_whole(pf.check(urdf(tmp_path, *arm(masses, shape=shape))))
    assert ("one density" in found) == bool(says)
    if says:
        assert found["one density"].found.startswith(says)
        assert found["one density"].severity == Severity.NOTE


def test_one_density_of_the_drawing_is_seen_beside_other_collision_shapes(tmp_path):
    """Every second visual lacks a triangle, and all collision shapes are larger boxes."""
    masses, shapes = [], []
    for i in range(7):
        size = np.array([0.1 + 0.01 * i, 0.12, 0.15 + 0.02 * i])
        drawn = trimesh.creation.box(extents=size)
        drawn.update_faces(np.arange(len(drawn.faces)) >= i % 2)
        drawn.export(tmp_path / f"v{i}.stl")
        trimesh.creation.box(extents=(1.04 + 0.03 * i) * size).export(tmp_path / f"c{i}.stl")
        masses.append(1000.0 * float(size.prod()))
        shapes = '<visual><geometry><mesh filename="v{0}.stl"/></geometry></visual>'
        shapes += '<collision><geometry><mesh filename="c{0}.stl"/></geometry></collision>'
    found = on_the_whole(pf.check(urdf(tmp_path, *arm(masses, shape=shapes))))
    assert "1000 kg/m^3 of their meshes" in found["one density"].text


@pytest.mark.parametrize(("odd", "says"), [(0, "all links have 1000"), (2, "")])
def test_one_density_is_seen_where_links_have_it_in_different_drawings(tmp_path, odd, says):
    """Closed visuals of every second link, collision shapes of the others: 999 to 1001 kg/m^3."""
    masses = []
    for i in range(6):
        size = np.array([0.1 + 0.02 * i, 0.12, 0.15 + 0.03 * i])
        for name, drawn in (("v", i % 2 == 0), ("c", i % 2 == 1)):
            box = trimesh.creation.box(extents=size if drawn else (1.1 + 0.05 * i) * size)
            box.export(tmp_path / f"{name}{i}.stl")
        density = 999.0 + 0.4 * i if i >= odd else 1500.0 + 400.0 * i
        masses.append(density * float(size.prod()))
    shapes = '<visual><geometry><mesh filename="v{0}.stl"/></geometry></visual>'
    shapes += '<collision><geometry><mesh filename="c{0}.stl"/></geometry></collision>'
    found = on_the_whole(pf.check(urdf(tmp_path, *arm(masses, shape=shapes))))
    assert ("one density" in found) == bool(says)
    if says:
        assert says in found["one density"].text


def test_hulls_of_shapes_have_their_volume(tmp_path):
    """Boxes exactly; polygons within 2 % of cylinder and ball; two shapes are one hull."""
    at = '<origin xyz="0 0 1" rpy="0.3 0.2 0.1"/>'
    shapes = {
        '<box size="0.1 0.2 0.3"/>': 0.006,
        '<cylinder radius="0.1" length="0.3"/>': np.pi * 0.01 * 0.3,
        '<sphere radius="0.1"/>': 4 / 3 * np.pi * 1e-3,
    }
    for text, volume in shapes.items():
        shape = f"<visual>{at}<geometry>{text}</geometry></visual>"
        facts = RobotFacts.of(urdf(tmp_path, *arm((1, 1), shape=shape)))
        extents = facts.extents
        assert extents["l0"].hull == pytest.approx(volume, rel=1e-9 if "box" in text else 0.02)
        assert extents["l0"].hull <= volume * (1 + 1e-9)
    cubes = "".join(
        f'<visual><origin xyz="{x} 0 0"/><geometry><box size="1 1 1"/></geometry></visual>'
        for x in (0, 2)
    )
    facts = RobotFacts.of(urdf(tmp_path, *arm((1, 1), shape=cubes)))
    assert facts.extents["l0"].hull == pytest.approx(3.0)


#: m g L = 20 kg x 9.81 x 1.0 m = 196.2 N m; j0 bears 117.72 N m, j1 44.145, j2 9.81 of its weight.
LIMITED = """
[150, 60, 20]     [3, 3, 6]    {}
[150, 60, 60]     [3, 3, 6]    {}
[588, 588, 588]   [3, 3, 3]    {}
[589, 588, 588]   [3, 3, 3]    {j0: 'placeholder: the whole robot held out level needs 196'}
[150, 60, 20]     [3, 3, 110]  {j2: '20 N m and 110 rad/s, are 110 W for each kg'}
[100, 60, 20]     [3, 3, 6]    {j0: its weight alone needs 117.7 N m}
[1530, 612, 204]  [3, 3, 6]    {j0: 'kgf cm: 150, 60, 20 N m', j1: 'kgf cm: 150, 60, 20 N m'}
"""


@pytest.mark.parametrize(("limits", "speeds", "says"), table(LIMITED, *[yaml.safe_load] * 3))
def test_limits_against_the_whole_robot_and_the_own_weight(tmp_path, limits, speeds, says):
    report = pf.check(urdf(tmp_path, *arm((10, 6, 4), limits, speeds)))
    found = {f.place: f.text for f in report.findings if "limit" in f.kind}
    assert found.keys() == {f"joint {name}" for name in says}
    for name, text in says.items():
        assert text in found[f"joint {name}"]


@pytest.mark.parametrize(
    ("masses", "limit", "kinds"),
    [
        # five rods of 8 kg: m g L = 785 N m; own weights from 19.6 to 490, 25 times
        ((8, 7.9, 8, 8.1, 8), 500, {"equal limits"}),
        ((8, 7.9, 8, 8.1, 8), 390, {"weak limit"}),
        ((8, 7.9, 8, 8.1, 8), 800, {"effort limit"}),
        ((0.008, 0.0079, 0.008, 0.0081, 0.008), 500, set()),  # its masses are doubtful
    ],
)
def test_one_limit_everywhere_is_noted(tmp_path, masses, limit, kinds):
    report = pf.check(urdf(tmp_path, *arm(masses, [limit] * 5)))
    assert {f.kind for f in report.findings if "limit" in f.kind} == kinds


def test_a_limit_of_an_axis_that_bears_no_weight_counts_too(tmp_path):
    parts = arm((8, 7.9, 8, 8.1, 8), [500] * 5)
    parts[0] = parts[0].replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>')
    found = [f.found for f in pf.check(urdf(tmp_path, *parts)).findings if f.kind == "equal limits"]
    assert found == ["all 5 effort limits are 500 N m"]


def test_the_way_along_the_joints_leaves_pedestals_out(tmp_path):
    for pedestal, reach in itertools.product((0.0, 5.0), (1.0,)):
        parts = arm((10, 6, 4))
        parts[0] = parts[0].replace(
            '<origin xyz="0.0 0 0"/><axis', f'<origin xyz="0 0 {pedestal}"/><axis'
        )
        report = pf.check(urdf(tmp_path, *parts))
        assert report.figures["reach"] == pytest.approx(reach)
        assert report.figures["moving_mass"] == pytest.approx(20.0)
