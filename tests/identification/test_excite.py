"""Excitations stay within limits, begin and end at rest, and tell more than motions of chance."""

import numpy as np
import pinocchio as pin
import pytest
from cli_cases import refused, told
from tables import table

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification import excitation
from pinfric.identification.excitation import Reach, informative_series, random_series
from pinfric.identification.information import Criterion

JOINTS = ("joint_1", "joint_12", "joint_23")
GIVEN = {
    "duration": 40.0,
    "rate": 100.0,
    "ranges": {"joint_1": (-0.4, 1.0)},
    "speeds": {"joint_1": 8.0, "joint_12": 0.9, "joint_23": 5.0},
    "accelerations": {"joint_1": 60.0, "joint_23": 2.0},
}


@pytest.fixture(scope="module")
def excited():
    """The limit of the effort of the first joint slows it down."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(excitation, "_EVALUATIONS", 150)
        scene = pf.load_scene("three_link")
        return pf.excite(scene, **GIVEN)


def motions(excited, folder):
    excited.save(folder)
    for name in ("excitation.csv", "excitation.waypoints.yaml"):
        yield pf.load_trajectory(folder / name, excited.scene)


def test_both_files_keep_all_limits_between_their_samples_too(excited, tmp_path):
    model = excited.scene.model
    for motion in motions(excited, tmp_path):
        q, v = motion.joint_positions(), motion.v
        t = np.linspace(0.0, motion.t[-1], 20 * motion.t.size)
        fine = np.column_stack([np.interp(t, motion.t, x) for x in v.T])
        # speeds are linear between samples to within a step of the acceleration
        assert (np.abs(fine).max(axis=0) <= [8.0, 0.9, 5.0]).all()
        way = np.cumsum(fine[:-1] + fine[1:], axis=0) * 0.5 * t[1] + q[0]
        assert (way[:, 0].min(), way[:, 0].max()) == pytest.approx((-0.4, 1.0), abs=0.15)
        assert q[:, 0].min() >= -0.4
        assert q[:, 0].max() <= 1.0
        assert np.abs(q).max() <= 0.5 * np.pi
        assert np.abs(motion.a[:, 2]).max() <= 2.0
        assert (v[[0, -1]] == 0.0).all()
        assert (motion.a[[0, -1]] == 0.0).all()
        assert q[-1] == pytest.approx(q[0], abs=1e-4)
        result = pf.inverse_dynamics(excited.scene, motion)
        for ends in (result.effort_lower, result.effort_upper):
            assert (np.abs(ends) <= 0.8 * model.effortLimit * (1.0 + 1e-4)).all()


def test_samples_are_one_motion(excited):
    """The trapezoidal rule over accelerations is the velocity, over velocities the position."""
    motion = excited.trajectory
    dt = np.diff(motion.t)
    assert dt == pytest.approx(0.01)
    jump = 0.5 * 0.01 * np.abs(motion.a).max() * (1.0 + 1e-9)  # a ramp begins between two samples
    for x, rate, most in (
        (motion.joint_positions(), motion.v, 0.01 * jump),
        (motion.v, motion.a, jump),
    ):
        step = 0.5 * dt[:, None] * (rate[1:] + rate[:-1])
        assert np.abs(np.diff(x, axis=0) - step).max() <= most
    assert excited.summary.slowed > 1.0
    assert max(x.effort / x.effort_limit for x in excited.summary.joints) <= 0.8


def test_each_joint_moves_alone_at_three_speeds(excited):
    late = excited.trajectory.t > excited.summary.staircases_from
    v = excited.trajectory.v[late]
    assert ((v != 0.0).sum(axis=1) <= 1).all()
    for own in v.T:
        speeds, counts = np.unique(np.round(own[own > 0.0], 5), return_counts=True)
        forward = speeds[counts > 20]
        assert len(forward) == 3
        assert min(forward) < 0.15 * max(forward)


def own_errors(scene, q, v, a):
    """Standard errors of Coulomb by direction and viscous friction, by ordinary least squares.

    Links' parameters are free, to a thousandth of what the largest of them shows.
    """
    model, data = scene.model, scene.model.createData()
    rows = [
        pin.computeJointTorqueRegressor(model, data, *x).copy() for x in zip(q, v, a, strict=True)
    ]
    blocks = []
    for j in range(model.nv):
        own = np.zeros((len(q), 4 * model.nv))
        own[:, 4 * j : 4 * j + 4] = np.column_stack(
            [v[:, j] > 0, -1.0 * (v[:, j] < 0), v[:, j], a[:, j]]
        )
        blocks.append(np.hstack([np.array(rows)[:, j], own])[np.abs(v[:, j]) > 0.02])
    columns = np.concatenate(blocks)
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9] / size[size > 1e-9]
    covariance = np.linalg.inv(columns.T @ columns + 1e-6 * np.eye(columns.shape[1]))
    errors = np.sqrt(np.diag(covariance)) / size[size > 1e-9]
    places = np.flatnonzero(size > 1e-9)
    friction = [10 * model.nv + 4 * j + k for j in range(model.nv) for k in range(3)]
    return errors[np.isin(places, friction)]


@pytest.mark.parametrize("seed", range(3))
def test_the_value_is_log_det_of_what_links_and_rotors_leave_of_friction(seed):
    """By rows stacked over all unknowns, in longer numbers, without a Schur complement."""
    scene, draws = pf.load_scene("three_link"), np.random.default_rng(seed)
    q, v, a = draws.uniform(-1.0, 1.0, (3, 60, 3))
    criterion = Criterion.of(scene, q)
    model, data = scene.model, scene.model.createData()
    theta = np.concatenate([link.toDynamicParameters() for link in model.inertias[1:]])
    rows, friction = [np.diag(np.sqrt(np.append(criterion.links, np.zeros(15))))], []
    for j in range(3):
        own = 30 + 5 * j
        friction += [own + 1, own + 2, own + 3, *[own + 4] * bool(criterion.loaded[j])]
        Y = np.array(
            [pin.computeJointTorqueRegressor(model, data, *x)[j] for x in zip(q, v, a, strict=True)]
        )
        w = v[:, j]
        terms = [a[:, j], w > 0.0, -1.0 * (w < 0.0), w, np.sign(w) * np.abs(Y @ theta)]
        block = np.zeros((len(q), 45))
        block[:, :30], block[:, own : own + 5] = Y, np.column_stack(terms)
        slides = np.abs(w) > 0.01 * np.abs(w).max()
        rows.append(block[slides] / (0.02 * criterion.size[j]))
    unknown = np.setdiff1d(np.flatnonzero(np.vstack(rows).any(axis=0)), friction)
    whole = np.vstack(rows)[:, [*unknown, *friction]]
    R = np.abs(np.diag(np.linalg.qr(whole / np.linalg.norm(whole, axis=0), mode="r")))
    size = np.linalg.norm(whole, axis=0)[unknown.size :]
    expected = 2.0 * np.log(R[unknown.size :] * size).sum()
    assert criterion.value(criterion.products(q, v, a)) == pytest.approx(expected, abs=1e-3)


@pytest.mark.slow
def test_the_series_tells_more_than_motions_of_chance_within_the_same_limits():
    scene = pf.load_scene("three_link")
    one = np.ones(3)
    reach = Reach(-1.2 * one, 1.2 * one, 2.0 * one, 5.0 * one)
    draws = np.random.default_rng(3)
    criterion = Criterion.of(scene, draws.uniform(reach.low, reach.high, (100, 3)))
    found = informative_series(criterion, reach, 30.0, 0)
    t = np.arange(0.0, 30.0, 0.02)
    others = [random_series(reach, found.period, draws) for _ in range(9)]
    errors = [np.log(own_errors(scene, *x.motion(reach, t))).mean() for x in (found, *others)]
    assert errors[0] < min(errors[1:])
    assert errors[0] < np.median(errors[1:]) + np.log(0.8)


def test_the_command_writes_both_files(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(excitation, "_EVALUATIONS", 5)
    options = "--duration", "20", "--rate", "50", "--range", "joint_1=-1:1", "--out", tmp_path
    out = told(capsys, "excite", "pendulum", *options).out
    assert "from rest" not in out
    assert "collisions" in out
    assert "joint_1" in out
    for name in ("excitation.csv", "excitation.waypoints.yaml"):
        motion = pf.load_trajectory(tmp_path / name, pf.load_scene("pendulum"))
        assert np.abs(motion.q).max() <= 1.0


BAD = """
--duration 3              duration 3 s: should be
--rate 5                  rate 5 Hz: should be 20 to 10000 Hz
--share 0                 share 0: should be above 0, at most 1
--share nan               share nan: should be above 0, at most 1
--range elbow=-1:1        range: there is no joint 'elbow'; there
--range joint_1=1:-1      range joint_1=1:-1: should rise
--range joint_1=0:99      range joint_1=0:99: should rise; the URDF allows
--range joint_1=1         'joint_1=1': should be JOINT=LOW:HIGH
--speed joint_1=99        speed joint_1=99: should be above 0; the URDF allows
--speed joint_1=nan       should be above 0
--acceleration joint_1=0  acceleration joint_1=0: should be above 0
"""


@pytest.mark.parametrize(("given", "said"), table(BAD))
def test_what_cannot_be_is_one_line(given, said, capsys):
    assert said in refused(capsys, "excite", "three_link", *given.split())


def test_an_effort_that_does_not_hold_the_robot_is_named():
    scene = pf.load_scene("three_link")
    model = scene.model.copy()
    model.effortLimit[1] = 2.0
    with pytest.raises(IdentificationError, match=r"do not hold .*weight.*: joint_12 .*limit 2"):
        pf.excite(scene.with_(model=model))
    model.effortLimit[1] = 100.0
    model.velocityLimit[2] = 0.0
    with pytest.raises(IdentificationError, match="no speed of joint_23: give it"):
        pf.excite(scene.with_(model=model))
