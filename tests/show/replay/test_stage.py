"""The robot and its sites in the viewer."""

import warnings

import numpy as np
import pinocchio as pin
import pytest
from builders import example, lump, random_tree
from mechanisms import add_link, bar, four_bar, grounded_model, pin_friction, shifted
from numpy.testing import assert_allclose, assert_array_equal
from replay_cases import ROBOTS, arm, drawn

import pinfric as pf
from pinfric.errors import PinfricWarning
from pinfric.show.replay.meshes import fewer_triangles, painted, urdf_visuals
from pinfric.show.replay.page import RecordingWindow
from pinfric.show.replay.shapes import equivalent_box, robot_shapes
from pinfric.show.replay.stage import SEGMENTS, SIDES, _tube, set_stage, tool_stops
from pinfric.show.timeline.frames import make_frames

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def boom():
    """A bar lifted by a cylinder between two points 0.3 m and 0.7 m from its hinge."""
    model = grounded_model(gravity=(0.0, 0.0, -9.81))
    add_link(
        model,
        0,
        pin.JointModelRY(),
        shifted(0, 0.5),
        "boom",
        bar(20.0, 1.5),
    )
    ends = {"a": {"link": "ground", "xyz": [0.3, 0, 0]}, "b": {"link": "boom", "xyz": [0.7, 0, 0]}}
    return pf.Scene(
        model=model,
        friction={"boom": pin_friction(0.15)},
        actuators=[{"cylinder": {"name": "lift", **ends}}],
    )


def test_loops_and_cylinders_are_drawn_where_they_act():
    import meshcat

    closed, _ = four_bar()
    window = RecordingWindow()
    rest = np.tile([0, 0, 0, 0, 0, 0, 1.0], (1, 3, 1))
    staged = set_stage(meshcat.Visualizer(window=window), closed, rest)
    loop = closed.site_names.index("B")
    place = staged.markers[loop]
    frame = closed.linkage.frame_p[0, 1]
    assert_allclose(place.placement.translation, frame)
    assert closed.joint_names[place.joint - 1] in staged.site_paths[loop]
    assert staged.site_paths[loop].endswith("site B")
    lifted = boom()
    staged = set_stage(meshcat.Visualizer(window=RecordingWindow()), lifted, rest[:, :1])
    (cylinder,) = staged.cylinders
    assert cylinder.path == "world/cylinder lift"
    assert (cylinder.a[0], cylinder.b[0]) == (0, 1)
    assert_array_equal(cylinder.b[1], [0.7, 0, 0])


def test_first_faces_of_an_arc_are_its_beginning():
    tube = _tube(1.0, 0.01, np.deg2rad(90.0))
    assert len(tube.faces) == 2 * SEGMENTS * SIDES
    quarter = tube.vertices[tube.faces[: len(tube.faces) // 4]].reshape(-1, 3)
    angle = np.arctan2(quarter[:, 1], quarter[:, 0])
    assert np.rad2deg(angle.max()) == pytest.approx(22.5)


def test_marks_stand_where_the_tool_stops():
    """At the five places of the way-points, and nowhere for a scene without a tool."""
    scene, motion = example("ur10_machine_tending")
    frames = make_frames(scene, pf.inverse_dynamics(scene, motion), 30.0)
    data, frame, wanted = scene.model.createData(), scene.model.getFrameId("tool0"), []
    for t in (0.1, 1.2, 2.0, 5.0, 7.2):  # ready, above A, A, door, chuck
        pin.framesForwardKinematics(scene.model, data, motion.q[np.searchsorted(motion.t, t)])
        wanted.append(data.oMf[frame].translation.copy())
    found = tool_stops(scene, frames.placement)
    assert len(found) == len(wanted)
    for place in wanted:
        assert np.linalg.norm(found - place, axis=1).min() < 1e-3
    assert not len(tool_stops(scene.with_(tool=None), frames.placement))


def test_a_payload_that_stands_off_its_link_is_held_by_a_rod(tmp_path):
    """At the link's own frame nothing is drawn."""
    scene = arm(tmp_path)
    for com, rods in (([0.0, 0.0, 0.14], 1), ([0.0, 0.0, 0.0], 0)):
        blank = {"link": "link", "mass": 5.0, "com": com}
        held = drawn(scene.with_(payloads={"blank": blank})).commands
        assert sum(b"payload blank/held" in c for c in held) == rods


# The look of a robot: visuals, or shapes from inertias.


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
    assert_allclose(plate.mesh.vertices.max(axis=0), [2, 2, 0])
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


@pytest.mark.slow
def test_a_mesh_with_too_many_triangles_keeps_its_shape_and_its_edges():
    """A can of 0.2 m and a cube beside it: on cells of 0.3 mm or more, normals to 2 degrees."""
    from trimesh import creation

    can = painted(creation.cylinder(0.1, 0.2, sections=50_000))
    cube = painted(creation.box([0.1, 0.1, 0.1]))
    few = fewer_triangles([can, cube], 0.3)
    assert sum(len(mesh.faces) for mesh in few) <= 80_000 < len(can.faces)
    for mesh, given in zip(few, (can, cube), strict=True):
        assert_allclose(mesh.bounds, given.bounds, atol=2e-3)
        assert mesh.area == pytest.approx(given.area, rel=1e-2)
        assert mesh.volume == pytest.approx(given.volume, rel=1e-2)
    side = np.abs(few[0].vertex_normals[:, 2]) < 0.5
    outward = few[0].vertices[side, :2] / 0.1
    assert_allclose(few[0].vertex_normals[side, :2], outward, atol=0.05)
    assert (np.abs(few[0].vertex_normals[~side, 2]) > 0.99).all()  # the edge stays sharp
    (same,) = fewer_triangles([cube], 0.1)
    assert same is cube


# Primitives and meshes of a URDF.


def test_urdfs_primitives_are_drawn_as_they_are():
    scene = pf.load_scene(ROBOTS / "three_link.yaml")
    visuals, missing = urdf_visuals(scene.model, scene.robot)
    assert (len(visuals), missing) == (6, {})
    bar = visuals[1]  # link_1's box, 0.07 x 0.4 x 0.07 at (0, 0.2, 0), red
    assert bar.joint == 1
    assert_allclose(np.ptp(bar.mesh.vertices, axis=0), [0.07, 0.4, 0.07])
    assert_array_equal(bar.placement.translation, [0, 0.2, 0])
    assert tuple(bar.mesh.visual.vertex_colors[0]) == (204, 76, 64, 255)


def test_box_of_equal_inertia_has_the_bodys_moments():
    edges = np.array([0.3, 0.2, 0.7])
    mass, turn = 2.5, pin.exp3(np.array([0.4, -0.2, 0.9]))
    moments = mass / 12 * (edges @ edges - edges**2)
    body = pin.Inertia(mass, np.array([0.1, 0.2, 0.3]), turn @ np.diag(moments) @ turn.T)
    box = equivalent_box(body)
    assert_allclose(np.sort(box.edges), np.sort(edges), rtol=1e-9)
    axes = box.placement.rotation
    back = axes @ np.diag(mass / 12 * (box.edges @ box.edges - box.edges**2)) @ axes.T
    assert_allclose(back, body.inertia, atol=1e-12)
    assert_array_equal(box.placement.translation, body.lever)
    assert equivalent_box(pin.Inertia.Zero()) is None


@pytest.mark.parametrize(("mass", "drawn"), [(1.0, True), (1e-300, False), (1e-30, False)])
def test_an_inertia_without_mass_is_no_box_beyond_every_machine(mass, drawn):
    """0.1 kg m^2 with 1e-300 kg is a cube of 8e149 m, which single precision does not hold."""
    box = equivalent_box(lump(mass, moment=0.1))
    assert (box is not None) == drawn
    if drawn:
        assert_allclose(box.edges, np.sqrt(0.6), rtol=1e-12)
