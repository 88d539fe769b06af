"""The robots of example-robot-data (69 in version 6, 77 in 5): which load, why others cannot."""

import warnings

import numpy as np
import pinocchio as pin
import pytest

from pinfric.errors import PinfricWarning, RobotError
from pinfric.model.robot import example_robot_data, read_robot

URDFS = sorted(example_robot_data().rglob("*.urdf"))
#: What cannot be computed with, and how Pinocchio sees it.
NO_JOINTS = {"quadrotor_base", "iris_simple", "bluevolta"}
INVALID = {"ur3": "has no <link>", "falcon": "names link 'Z_propeller'"}
#: Bodies that no matter could form: read as they are written, with a word about it.
IMPLAUSIBLE = {
    "alex_psyonic_hands",
    "allegro_left_hand",
    "allegro_right_hand",
    "bolt",
    "hyq_no_sensors",
    "pr2",
    "romeo_laas_small",
    "romeo_small",
}
#: Followers that stand before their leaders in Pinocchio's order.
REORDERED = {"romeo", "talos_full_v2", "talos_full_v2_box"}


def read_all():
    """Stem -> the robot, or the error; stem -> the warnings."""
    found, said = {}, {}
    for urdf in URDFS:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", PinfricWarning)
            try:
                found[urdf] = read_robot(urdf, {})
            except RobotError as refused:
                found[urdf] = refused
        said[urdf.stem] = [str(warning.message) for warning in caught]
    return found, said


@pytest.fixture(scope="module")
def robots():
    return read_all()


def test_all_robots_load_except_those_that_pinocchio_cannot_move_either(robots):
    found, _ = robots
    refused = {urdf.stem: str(e) for urdf, e in found.items() if isinstance(e, RobotError)}
    assert len(found) >= 69
    assert {"quadrotor_base", "iris_simple", "ur3"} <= refused.keys() <= NO_JOINTS | {*INVALID}
    for urdf in found:
        if urdf.stem in NO_JOINTS:
            assert "no joint of this robot can move" in refused[urdf.stem]
            assert pin.buildModelFromUrdf(str(urdf)).nv == 0
        if urdf.stem in INVALID:
            assert INVALID[urdf.stem] in refused[urdf.stem]
            with pytest.raises(ValueError, match="does not contain a valid URDF"):
                pin.buildModelFromUrdf(str(urdf))


def test_what_is_read_is_what_pinocchio_reads(robots):
    found, _ = robots
    for urdf, robot in found.items():
        if isinstance(robot, RobotError) or urdf.stem in REORDERED | {"alex_psyonic_hands"}:
            continue
        assert robot.model == pin.buildModelFromUrdf(str(urdf), mimic=True), urdf.stem


def test_implausible_bodies_are_one_warning_for_each_robot(robots):
    _, said = robots
    about = {stem: [t for t in texts if "used as written" in t] for stem, texts in said.items()}
    assert {stem for stem, texts in about.items() if texts} == IMPLAUSIBLE
    assert all(len(texts) <= 1 for texts in about.values())
    for foot in ("lf_foot", "rf_foot", "lh_foot", "rh_foot"):
        assert foot in about["hyq_no_sensors"][0]


def test_followers_before_their_leaders_move_with_them(robots):
    """Virtual work: u = G^T tau of the tree without mimicry, v_tree = G v."""
    found, _ = robots
    for urdf, robot in found.items():
        if urdf.stem not in REORDERED:
            continue
        model, tree = robot.model, pin.buildModelFromUrdf(str(urdf))
        assert sorted(model.names) == sorted(tree.names)
        G, shift = np.zeros((tree.nv, model.nv)), np.zeros(tree.nq)
        for joint in range(1, tree.njoints):
            mine = model.joints[model.getJointId(tree.names[joint])]
            row = tree.joints[joint].idx_v
            if mine.nv:
                G[row, mine.idx_v] = 1.0
                continue
            mimic = mine.extract()
            leaders = list(model.mimicking_joints)
            leader = model.mimicked_joints[leaders.index(mine.id)]
            G[row, model.joints[leader].idx_v] = mimic.scaling
            shift[row] = mimic.offset
        q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, model.nv))
        tau = pin.rnea(tree, tree.createData(), G @ q + shift, G @ v, G @ a)
        np.testing.assert_allclose(
            pin.rnea(model, model.createData(), q, v, a), G.T @ tau, rtol=1e-10, atol=1e-10
        )
        data, tree_data = model.createData(), tree.createData()
        pin.framesForwardKinematics(model, data, q)
        pin.framesForwardKinematics(tree, tree_data, G @ q + shift)
        for frame in tree.frames:
            there = data.oMf[model.getFrameId(frame.name, frame.type)]
            assert there.isApprox(tree_data.oMf[tree.getFrameId(frame.name, frame.type)], 1e-10)
