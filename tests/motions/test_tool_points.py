"""Way-points of the tool: postures and straight lines beside Pinocchio's own kinematics."""

import re

import numpy as np
import pinocchio as pin
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.optimize import least_squares, minimize

import pinfric as pf
from pinfric.retiming.path import load_path

UR10 = "[0.0, -1.2, 1.5, -1.9, -1.57, 0.0]"
PANDA = "[0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.0]"


def arm(name):
    return pf.load_scene(name).with_(tool={"ur10": "tool0", "panda": "panda_hand_tcp"}[name])


def written(folder, *points, start=UR10, more=""):
    file = folder / "move.waypoints.yaml"
    lines = "\n".join(f"  - {point}" for point in (f"{{q: {start}}}", *points))
    file.write_text(f"pinfric_trajectory: 1\nsample_rate: 100\n{more}points:\n{lines}\n")
    return file


def places(scene, motion):
    data, frame, found = scene.model.createData(), scene.model.getFrameId(scene.tool), []
    for q, v in zip(motion.q, motion.v, strict=True):
        pin.forwardKinematics(scene.model, data, q, v)
        place = pin.updateFramePlacement(scene.model, data, frame).copy()
        twist = pin.getFrameVelocity(
            scene.model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        found.append((place, twist.linear))
    return found


@pytest.mark.parametrize(("name", "start"), [("ur10", UR10), ("panda", PANDA)])
def test_the_tool_is_where_it_is_wanted_and_moves_straight(name, start, tmp_path):
    scene = arm(name)
    begin, end = np.array([0.5, 0.1, 0.4]), np.array([0.45, -0.25, 0.3])
    file = written(
        tmp_path,
        f"{{tool: {{xyz: {begin.tolist()}, rpy: [180, 0, 0]}}, duration: 1.0}}",
        f"{{tool: {{xyz: {end.tolist()}, rpy: [180, 0, 40], line: true}}, duration: 2.0}}",
        start=f"{np.degrees(yaml.safe_load(start)).tolist()}",
        more="unit: deg\n",
    )
    motion = pf.load_trajectory(file, scene)
    model = scene.model
    assert (motion.q >= model.lowerPositionLimit).all()
    assert (motion.q <= model.upperPositionLimit).all()
    found = places(scene, motion)
    assert_allclose(found[100][0].translation, begin, atol=1e-9)
    assert_allclose(found[-1][0].translation, end, atol=1e-9)
    turned = pin.rpy.rpyToMatrix(np.radians([180.0, 0.0, 40.0]))
    assert_allclose(found[-1][0].rotation, turned, atol=1e-9)
    along = (end - begin) / np.linalg.norm(end - begin)
    for place, velocity in found[100:]:
        off = place.translation - begin
        assert np.linalg.norm(off - along * (off @ along)) < 1e-7
        assert np.linalg.norm(velocity - along * (velocity @ along)) < 1e-5
        assert abs(place.rotation[2, 2] + 1.0) < 1e-9  # it turns about the vertical only
    assert_allclose(np.gradient(motion.q, 0.01, axis=0)[3:-3], motion.v[3:-3], atol=5e-3)


def test_a_line_without_duration_keeps_the_speed_limits(tmp_path):
    scene = arm("ur10")
    there = "{tool: {xyz: [0.6, 0.2, 0.4]}, duration: 1.0}"
    back = "{tool: {xyz: [0.6, -0.4, 0.4], line: true}}"
    motion = pf.load_trajectory(written(tmp_path, there, back), scene)
    share = np.abs(motion.v[101:]) / scene.model.velocityLimit
    assert 0.8 < share.max() <= 1.0


def test_a_place_out_of_reach_is_refused_with_its_distance(tmp_path):
    scene = arm("ur10")
    model, goal = scene.model, np.array([1.6, 0.2, 0.4])
    data, frame = model.createData(), model.getFrameId("tool0")

    def distance(x):
        pin.framesForwardKinematics(model, data, x)
        return np.linalg.norm(data.oMf[frame].translation - goal)

    rng = np.random.default_rng(0)
    least = min(minimize(distance, rng.uniform(-2, 2, 6)).fun for _ in range(20))
    with pytest.raises(pf.PinfricError, match=r"points\[1\].tool: .*out of reach, by") as refused:
        pf.load_trajectory(written(tmp_path, f"{{tool: {{xyz: {goal.tolist()}}}}}"), scene)
    said = float(str(refused.value).split("out of reach, by ")[1].split(" m")[0])
    assert said == pytest.approx(least, abs=1e-3)


def test_a_place_that_a_stretched_arm_reaches_only_turned_is_refused_with_both_distances(tmp_path):
    """Steps went to and fro there: it was said to be off by 3e-4 deg alone."""
    scene = pf.load_scene("panda").with_(tool="panda_hand")
    model, begin = scene.model, np.array([0.0, 0.5, 0.0, -1.5, 0.0, 1.5, 0.7])
    data, frame = model.createData(), model.getFrameId("panda_hand")

    def place(q):
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[frame].copy()

    line = f"{{q: {begin.tolist()}}}, {{tool: {{xyz: [0.8, 0.0, 0.333], line: true}}, duration: 1}}"
    (tmp_path / "w.yaml").write_text(f"pinfric_trajectory: 1\npoints: [{line}]\n")
    with pytest.raises(pf.PinfricError, match=r"at 59 % .* only if turned") as refused:
        pf.load_trajectory(tmp_path / "w.yaml", scene)
    goal = place(begin)
    goal.translation += 38 / 64 * (np.array([0.8, 0.0, 0.333]) - goal.translation)
    ends = model.lowerPositionLimit, model.upperPositionLimit
    rng, least = np.random.default_rng(0), np.inf
    for _ in range(8):
        found = least_squares(
            lambda q: pin.log6(place(q).actInv(goal)).vector,
            np.clip(begin + rng.uniform(-0.5, 0.5, 7), ends[0] + 1e-6, ends[1] - 1e-6),
            bounds=ends,
        )
        least = min(least, np.sqrt(2.0 * found.cost))
    short, turn = re.search(r"within (\S+) m and (\S+) deg", str(refused.value)).groups()
    assert np.hypot(float(short), np.radians(float(turn))) == pytest.approx(least, rel=0.03)


@pytest.mark.parametrize(
    ("point", "said"),
    [
        ("{tool: {xyz: [1.6, 0.2, 0.4], line: true}}", "% of the straight line the tool is "),
        ("{tool: {xyz: [-0.6, -0.2, 0.4], line: true}}", "jumps by"),
        ("{tool: {xyz: [0.6, 0.2]}}", "points[1].tool.xyz"),
        ("{hold: 1.0}", "give one of `q`, a number per joint, `tool` and `base`"),
        (f"{{q: {UR10}, tool: {{xyz: [0.6, 0.2, 0.4]}}}}", "give one of `q`"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(point, said, tmp_path):
    with pytest.raises(pf.PinfricError) as refused:
        pf.load_trajectory(written(tmp_path, point), arm("ur10"))
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_who_has_no_tool_and_where_the_motion_starts(tmp_path):
    point = "{tool: {xyz: [0.6, 0.2, 0.4]}}"
    with pytest.raises(pf.PinfricError, match="need the scene's `tool`"):
        pf.load_trajectory(written(tmp_path, point), pf.load_scene("ur10"))
    file = tmp_path / "first.yaml"
    file.write_text(f"pinfric_trajectory: 1\npoints:\n  - {point}\n")
    with pytest.raises(pf.PinfricError, match=r"points\[0\].tool: .*give `q` here"):
        pf.load_trajectory(file, arm("ur10"))


def test_retiming_takes_the_tools_points_but_no_lines(tmp_path):
    scene = arm("ur10")
    via = written(
        tmp_path,
        "{tool: {xyz: [0.6, 0.2, 0.4]}, via: true}",
        "{q: [1.0, -0.8, 1.2, -1.9, -1.2, 0.4]}",
    )

    path = load_path(via, scene)
    assert len(path.pieces) == 1
    line = written(tmp_path, "{tool: {xyz: [0.6, 0.2, 0.4], line: true}}")
    with pytest.raises(pf.PinfricError, match="give `via` points along the line"):
        load_path(line, scene)
