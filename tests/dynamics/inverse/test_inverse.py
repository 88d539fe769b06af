"""Inverse dynamics against closed forms, Pinocchio, and invariants."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from builders import (
    block,
    chain,
    dry,
    lump,
    plane_friction,
    random_friction,
    random_states,
    random_tree,
    scene_of,
    sliding_block,
)
from cases import turning_four_bar
from judges.verdict import judge
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.errors import StateError


@pytest.mark.parametrize("seed", range(8))
def test_without_friction_it_is_pinocchios_rnea(seed):
    model = random_tree(seed)
    q, v, a = random_states(model, seed)
    result = pf.inverse_dynamics(pf.Scene(model=model), q, v, a)
    data = model.createData()
    expected = np.array([pin.rnea(model, data, *s) for s in zip(q, v, a, strict=True)])
    assert_allclose(result.effort_lower, expected, rtol=0, atol=1e-12 * 100)
    assert_array_equal(result.effort_lower, result.effort_upper)
    assert result.wrench is None  # nothing looked at reactions, none were computed


@pytest.mark.parametrize("seed", range(8))
def test_sliding_friction_only_ever_takes_power(seed):
    scene = scene_of(seed)
    q, v, a = random_states(scene.model, seed, 30)
    result = pf.inverse_dynamics(scene, q, v, a)
    power = result.friction_lower * v, result.friction_upper * v
    slides = ~result.sticking & ~result.reversal
    assert slides.any()
    assert (power[0][slides] <= 0).all()
    assert (power[1][slides] <= 0).all()
    # what friction takes, the drives give beyond what the motion takes
    given = (result.effort_lower - result.effort_frictionless) * v
    assert_allclose(given[slides], -power[0][slides], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_random_trees_satisfy_their_own_check(seed):
    scene = scene_of(seed, stick_velocity=0.1)
    q, v, a = random_states(scene.model, seed, 30)
    check = judge(pf.inverse_dynamics(scene, q, v, a))
    assert check.passed(1e-12), check


@pytest.mark.parametrize(
    ("v1", "v2", "expected"),
    [(1.0, 0.2, 1.0), (0.2, 1.0, -1.0), (0.5, 0.5, None)],
    ids=["ahead", "behind", "sticks"],
)
def test_block_on_a_moving_body(v1, v2, expected):
    """Paper eq. 18-22: F = m a1 + mu_k N sign(v1 - v2), or an interval of +- mu_s N."""
    m, a1, a2, mu_s, mu_k = 2.0, 0.7, -0.4, 0.5, 0.3
    model = chain(
        ("carrier", pin.JointModelPX(), lump(5.0, moment=1.0)),
        ("slide", pin.JointModelPX(), lump(m, moment=1.0)),
    )
    scene = pf.Scene(model=model, friction={"slide": plane_friction(mu_s, mu_k)})
    result = pf.inverse_dynamics(scene, [[0.0, 0.0]], [[v2, v1 - v2]], [[a2, a1 - a2]])
    N = m * 9.81
    assert result.normal_load[0, 0] == pytest.approx(N)
    force = result.effort_lower[0, 1], result.effort_upper[0, 1]
    if expected is None:
        assert force == pytest.approx((m * a1 - mu_s * N, m * a1 + mu_s * N))
        assert result.sticking[0, 0]
    else:
        assert force == pytest.approx((m * a1 + expected * mu_k * N,) * 2)


def test_pendulum_on_a_pin():
    """u = J theta'' + m g c sin(theta) + mu R |F| sign(theta'), F by hand."""
    m, c, J, R, mu, g = 1.3, 0.25, 0.05, 0.02, 0.3, 9.81
    body = pin.Inertia(m, np.array([c, 0.0, 0.0]), np.diag([J, J, J]))
    model = chain(("pivot", pin.JointModelRZ(), body))
    model.gravity.linear = np.array([g, 0.0, 0.0])
    bearing = {"kind": "pin", "radius": R}
    scene = pf.Scene(
        model=model, friction={"pivot": {"bearing": bearing, "mu": {"static": mu, "kinetic": mu}}}
    )
    theta, rate, acc = 0.7, -2.0, 3.0
    along = -m * c * rate**2 - m * g * np.cos(theta)  # force on the bar, towards the pin
    across = m * c * acc + m * g * np.sin(theta)
    friction = mu * R * np.hypot(along, across)
    expected = (J + m * c**2) * acc + m * g * c * np.sin(theta) - friction
    result = pf.inverse_dynamics(scene, [[theta]], [[rate]], [[acc]])
    assert result.effort_lower[0, 0] == pytest.approx(expected, rel=1e-13)
    assert result.effort_upper[0, 0] == pytest.approx(expected, rel=1e-13)


def test_a_reversal_between_samples_is_an_interval_at_the_slower_one():
    scene = sliding_block(plane_friction(0.5, 0.3))
    v = np.array([[0.3], [0.1], [-0.2], [-0.4]])
    result = pf.inverse_dynamics(scene, np.zeros((4, 1)), v, np.zeros((4, 1)), t=np.arange(4.0))
    N = 2.0 * 9.81
    assert result.reversal[:, 0].tolist() == [False, True, False, False]
    assert result.effort_lower[:, 0] == pytest.approx(np.array([0.3, -0.5, -0.3, -0.3]) * N)
    assert result.effort_upper[:, 0] == pytest.approx(np.array([0.3, 0.5, -0.3, -0.3]) * N)


def test_passing_through_a_sticking_sample_is_no_second_interval():
    scene = sliding_block(plane_friction(0.5, 0.3))
    v = np.array([[0.3], [0.0], [-0.2]])
    result = pf.inverse_dynamics(scene, np.zeros((3, 1)), v, np.zeros((3, 1)), t=np.arange(3.0))
    assert not result.reversal.any()
    assert result.sticking[:, 0].tolist() == [False, True, False]


@pytest.mark.parametrize("chunks", [1, 7, 1000])
def test_chunks_are_the_whole_in_pieces(chunks):
    model = random_tree(4)
    payloads = {"box": {"link": "tool", "mass": 2.0, "com": [0.0, 0.1, 0.0]}}
    model.addFrame(pin.Frame("tool", 6, pin.SE3.Random(), pin.FrameType.BODY))
    scene = pf.Scene(
        model=model,
        friction=random_friction(model, 4),
        payloads=payloads,
        actuators=[
            {
                "joint": f"joint_{j}",
                "transmission": {"ratio": 20.0, "efficiency": 0.9, "back_efficiency": 0.8},
            }
            for j in range(1, 7)
        ],
    )
    q, v, a = random_states(model, 4, 50)
    more = {
        "external": {"tool": np.random.default_rng(0).normal(size=(50, 6))},
        "t": np.linspace(0, 1, 50),
        "attached": (np.arange(50) // 9 % 2 == 1)[:, None],
    }
    whole = pf.inverse_dynamics(scene, q, v, a, **more)
    pieces = list(pf.inverse_dynamics(scene, q, v, a, **more, chunks=chunks))
    assert len(pieces) == -(-50 // chunks)
    for name in ("effort_lower", "effort_upper", "motor_torque_lower", "wrench", "reversal", "t"):
        joined = np.concatenate([getattr(piece, name) for piece in pieces])
        assert_allclose(joined, getattr(whole, name), rtol=1e-13, atol=1e-12)
    assert all(judge(piece).passed() for piece in pieces)


def test_a_payload_acts_only_while_it_is_attached():
    model = block(mass=2.0)
    model.addBodyFrame("table", 1, pin.SE3.Identity(), 0)
    payloads = {"box": {"link": "table", "mass": 3.0, "com": [0.0, 0.0, 0.1], "attached": False}}
    scene = pf.Scene(model=model, friction={"slide": plane_friction(0.5, 0.5)}, payloads=payloads)
    attached = np.array([[False], [True], [True], [False]])
    zero, one = np.zeros((4, 1)), np.ones((4, 1))
    result = pf.inverse_dynamics(scene, zero, one, one, attached=attached)
    mass = np.array([2.0, 5.0, 5.0, 2.0])
    assert_allclose(result.effort_lower[:, 0], mass * (1.0 + 0.5 * 9.81), rtol=1e-13)
    assert judge(result).passed()
    by_default = pf.inverse_dynamics(scene, zero, one, one)
    assert_allclose(by_default.effort_lower[:, 0], 2.0 * (1.0 + 0.5 * 9.81))


def test_mimic_followers_give_their_friction_to_the_leader():
    urdf = """<robot name="gripper"><link name="base"/>
      <link name="a"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <link name="b"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="a_lead" type="prismatic"><parent link="base"/><child link="a"/>
        <axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
      <joint name="b_follow" type="prismatic"><parent link="base"/><child link="b"/>
        <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
        <mimic joint="a_lead" multiplier="-2.0" offset="0.1"/></joint></robot>"""
    model = pin.buildModelFromXML(urdf, mimic=True)
    friction = {
        "a_lead": dry(4.0, 3.0),
        "b_follow": {
            "coulomb": {
                "positive": {"static": 7.0, "kinetic": 5.0},
                "negative": {"static": 13.0, "kinetic": 11.0},
            }
        },
    }
    scene = pf.Scene(model=model, friction=friction)
    for v, lower, upper in (
        (0.5, 3 + 2 * 11, 3 + 2 * 11),
        (-0.5, -3 - 2 * 5, -3 - 2 * 5),
        (0.0, -4 - 2 * 7, 4 + 2 * 13),
    ):
        result = pf.inverse_dynamics(scene, [[0.0]], [[v]], [[0.0]])
        assert result.effort_lower[0, 0] == pytest.approx(lower)
        assert result.effort_upper[0, 0] == pytest.approx(upper)
        assert judge(result).passed()


def test_a_scene_survives_pickling():
    scene = scene_of(2)
    q, v, a = random_states(scene.model, 2, 5)
    before = pf.inverse_dynamics(scene, q, v, a)
    after = pf.inverse_dynamics(pickle.loads(pickle.dumps(scene)), q, v, a)
    assert_array_equal(before.effort_upper, after.effort_upper)


def test_a_motion_made_for_another_robot_or_other_payloads_is_refused_or_reordered():
    model = block(mass=2.0)
    model.addBodyFrame("table", 1, pin.SE3.Identity(), 0)
    one, two = ({"link": "table", "mass": m, "com": [0.0, 0.0, 0.0]} for m in (1.0, 10.0))
    there = pf.Scene(model=model, payloads={"one": one, "two": two})
    here = pf.Scene(model=model, payloads={"two": two, "one": one})
    t, zero, a = np.array([0.0, 1.0]), np.zeros((2, 1)), np.ones((2, 1))
    carried = {"one": [True, False], "two": [False, False]}
    motion = pf.Trajectory.from_arrays(there, t, zero, zero, a, carried)
    assert pf.inverse_dynamics(there, motion).effort_lower[:, 0].tolist() == [3.0, 2.0]
    assert pf.inverse_dynamics(here, motion).effort_lower[:, 0].tolist() == [3.0, 2.0]
    with pytest.raises(StateError, match=r"payloads \['one', 'two'\], the scene has \['one'\]"):
        pf.inverse_dynamics(pf.Scene(model=model, payloads={"one": one}), motion)
    other = random_tree(0, 1)
    with pytest.raises(StateError, match=r"joints \['slide'\], the scene has \['joint_1'\]"):
        pf.inverse_dynamics(pf.Scene(model=other, payloads={}), motion)
    with pytest.raises(StateError, match="has its own"):
        pf.inverse_dynamics(there, motion, zero)


@pytest.mark.parametrize("chunks", [None, 7])
def test_states_without_times_know_nothing_of_their_neighbours(chunks):
    """At random speeds nothing rests, and another order changes nothing."""
    model = random_tree(4)
    scene = pf.Scene(model=model, friction=random_friction(model, 4))
    states = random_states(model, 4, 100)
    order = np.random.default_rng(0).permutation(100)

    def ends(q, v, a):
        parts = list(pf.inverse_dynamics(scene, q, v, a, chunks=chunks or 100))
        return [
            np.concatenate([getattr(part, f"effort_{end}") for part in parts])
            for end in ("lower", "upper")
        ]

    lower, upper = ends(*states)
    assert_array_equal(lower, upper)
    assert_allclose(upper[order], ends(*(x[order] for x in states))[1], atol=1e-9)


def test_states_of_a_loop_without_times_know_nothing_of_their_neighbours():
    case = turning_four_bar(40)
    sign = np.where(np.arange(40) % 2, -1.0, 1.0)[:, None]  # a v v' stays: the loop still closes
    result = pf.inverse_dynamics(case.scene, case.q, sign * case.v, case.a)
    assert_array_equal(result.effort_lower, result.effort_upper)
