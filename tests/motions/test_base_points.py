"""Way-points of a free base: its feet stay where they are, to the micrometre."""

import numpy as np
import pinocchio as pin
import pytest
from standing_cases import FEET, LINK, biped

import pinfric as pf
from pinfric.errors import TrajectoryError
from pinfric.model.floating import POSE, base_numbers

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
MORE = "feet: {left_foot: {length: 0.2, width: 0.1}, right_foot: {length: 0.2, width: 0.1}}\n"
STAND = [0, 0, 2 * LINK * np.cos(0.4), 0, 0, 0.5, *[-0.4, 0.8, -0.4] * 2]


def points(folder, base, more=MORE, first=STAND):
    """A scene, and a way-point file from a stand to a pose of its base."""
    scene = pf.load_scene(biped(folder, more=more))
    file = folder / "squat.waypoints.yaml"
    file.write_text(
        "pinfric_trajectory: 1\nsample_rate: 100\npoints:\n"
        f"  - {{q: [{', '.join(f'{x:.12g}' for x in first)}], hold: 0.1}}\n"
        f"  - {{base: {base}, duration: 1.0, hold: 0.1}}\n"
    )
    return scene, file


def test_a_base_goes_down_while_its_feet_stay(tmp_path):
    ahead = [0.01 * np.cos(0.5), 0.01 * np.sin(0.5), 0.55]  # the legs have no joint to the side
    scene, file = points(tmp_path, f"{{xyz: {[float(f'{x:.12g}') for x in ahead]}}}")
    motion = pf.load_trajectory(file, scene)
    data, places = scene.model.createData(), []
    for q in motion.q:
        pin.framesForwardKinematics(scene.model, data, q)
        places.append([data.oMf[scene.model.getFrameId(foot)].homogeneous for foot in FEET])
    assert np.ptp(np.array(places), axis=0).max() < 1e-6
    numbers = base_numbers(motion.q)
    np.testing.assert_allclose(numbers[-1], [*ahead, 0, 0, 0.5], atol=1e-11)
    # v and a are derivatives of q
    step = motion.t[51] - motion.t[50]
    rate = pin.difference(scene.model, motion.q[49], motion.q[51]) / (2 * step)
    np.testing.assert_allclose(rate, motion.v[50], atol=2e-3)
    np.testing.assert_allclose((motion.v[51] - motion.v[49]) / (2 * step), motion.a[50], atol=5e-2)


def test_without_base_points_the_base_has_columns_like_a_joint(tmp_path):
    scene, file = points(tmp_path, "{xyz: [0, 0, 0.5]}")
    names = [*(f"root_joint.{part}" for part in POSE), *scene.joint_names[1:]]
    text = file.read_text().replace("points:", f"joints: [{', '.join(names)}]\npoints:")
    file.write_text(text)
    motion = pf.load_trajectory(file, scene)
    assert motion.joint_names == scene.joint_names
    assert motion.q[-1, 2] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("base", "more", "says"),
    [
        ("{xyz: [0, 0, 0.9]}", MORE, "% of the way left_foot leaves its place by .* too short"),
        ("{xyz: [0, 0, 0.5]}", "", "only of a robot whose base floats and that has `feet`"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path, base, more, says):
    scene, file = points(tmp_path, base, more)
    with pytest.raises(TrajectoryError, match=says) as refused:
        pf.load_trajectory(file, scene)
    assert "\n" not in str(refused.value)
