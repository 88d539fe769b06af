"""Normal loads: closed forms, limits, and the kernel against formulas written out in NumPy."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, random_friction, random_states, random_tree
from judges.plain_laws import plain_normal_load
from judges.verdict import judge

import pinfric as pf
from pinfric.errors import RollMomentError

MU = {"static": 0.3, "kinetic": 0.3}


def load_of(bearing, force, moment, joint=None, q=0.0, mu=MU):
    """The normal load of one joint whose child is weightless and pushed by an outside wrench."""
    model = pin.Model()
    added = model.addJoint(0, joint or pin.JointModelRZ(), pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(added, pin.Inertia.Zero(), pin.SE3.Identity())
    model.addFrame(pin.Frame("child", added, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    scene = pf.Scene(model=model, friction={"joint": {"bearing": bearing, "mu": mu}})
    # the parent holds against what acts on the child
    wrench = -np.concatenate([force, moment]).astype(float)
    result = pf.inverse_dynamics(
        scene, np.full((1, 1), q), np.ones((1, 1)), np.zeros((1, 1)), {"child": wrench}
    )
    assert judge(result).passed()
    return result.normal_load[0, 0]


def test_pin_without_length_takes_the_radial_force_only():
    bearing = {"kind": "pin", "radius": 0.1}
    assert load_of(bearing, [3, 4, 100], [7, 8, 9]) == pytest.approx(0.1 * 5)


def test_pin_with_length_carries_a_bending_moment_as_a_couple_of_end_forces():
    # M along x, k along z: the couple is M x k / d = (0, -M/d, 0): F_r/2 +- (0, 20, 0)
    bearing = {"kind": "pin", "radius": 0.08, "length": 0.1}
    expected = 0.08 * (np.hypot(3, 20) + np.hypot(3, 20))
    assert load_of(bearing, [6, 0, 50], [2, 0, 9]) == pytest.approx(expected)


def test_pin_thrust_and_preload_add():
    bearing = {"kind": "pin", "radius": 0.1, "thrust_radius": 0.05, "preload": 20.0}
    assert load_of(bearing, [3, 4, -100], [0, 0, 0]) == pytest.approx(0.1 * 25 + 0.05 * 100)


@pytest.mark.filterwarnings("ignore:.*usually at most")
def test_a_very_long_pin_is_a_pin_without_length():
    short = {"kind": "pin", "radius": 0.1}
    long = {"kind": "pin", "radius": 0.1, "length": 1e9}
    wrench = [3, -4, 5], [7, 8, 9]
    assert load_of(long, *wrench) == pytest.approx(load_of(short, *wrench), rel=1e-9)


def test_guide_with_an_offset_load_tilts_onto_its_ends():
    # a load P at distance e along the guide beyond its middle: ends carry P (e/L +- 1/2)
    P, e, L = 50.0, 0.3, 0.2
    bearing = {"kind": "guide", "length": L}
    load = load_of(bearing, [0, 0, P], [0, -e * P, 0], pin.JointModelPX())
    assert load == pytest.approx(P * (e / L + 0.5) + P * (e / L - 0.5))
    # inside the guide both ends push the same way: the load is the weight, wherever it sits
    load = load_of(bearing, [0, 0, P], [0, -0.05 * P, 0], pin.JointModelPX())
    assert load == pytest.approx(P)


def test_guide_roll_moment_acts_on_the_width():
    bearing = {"kind": "guide", "length": 0.2, "width": 0.05, "preload": 3.0}
    load = load_of(bearing, [0, 0, 0], [4, 0, 0], pin.JointModelPX())
    assert load == pytest.approx(2 * 4 / 0.05 + 3)


def test_roll_moment_on_a_guide_without_width_is_refused_with_its_sample():
    with pytest.raises(RollMomentError, match=r"joint.*sample 0.*width"):
        load_of({"kind": "guide", "length": 0.2}, [0, 0, 5], [4, 0, 0], pin.JointModelPX())


def test_a_bushing_fixed_to_the_parent_does_not_move_with_the_rod():
    # force at the child's origin: seen from a bushing at rest, the lever is the displacement
    force, L, q = 10.0, 0.2, 0.5
    on_child = {"kind": "guide", "length": L, "on": "child"}
    on_parent = {"kind": "guide", "length": L, "on": "parent"}
    arguments = [0, 0, force], [0, 0, 0], pin.JointModelPX(), q
    assert load_of(on_child, *arguments) == pytest.approx(force)
    assert load_of(on_parent, *arguments) == pytest.approx(2 * force * q / L)


def test_offset_moves_the_middle_along_the_axis():
    # a force at the bearing's middle, described at the joint's origin, bends nothing
    bearing = {"kind": "pin", "radius": 0.1, "length": 0.05, "offset": 0.3}
    force = np.array([5.0, 0.0, 0.0])
    moment = np.cross([0, 0, 0.3], force)
    assert load_of(bearing, force, moment) == pytest.approx(0.1 * 5)


def test_slewing_ring_of_a_catalogue():
    # M = mu/2 (4.1 M_k + F_a D + 2.05 F_r D): radial 1.025 D, axial 0.5 D, moment 2.05
    D = 0.4
    bearing = {"kind": "linear", "radial": 1.025 * D, "axial": 0.5 * D, "moment": 2.05}
    load = load_of(bearing, [30, 40, 200], [6, 8, 1])
    assert load == pytest.approx(0.5 * (4.1 * 10 + 200 * D + 2.05 * 50 * D))


@pytest.mark.parametrize(
    "bearing",
    [
        {"kind": "pin", "radius": 0.1, "length": 0.1, "thrust_radius": 0.1},
        {"kind": "pin", "radius": 0.1},
        {"kind": "linear", "radial": 1.0, "axial": 1.0, "moment": 1.0},
    ],
)
def test_zero_load_gives_zero_and_no_nan(bearing):
    assert load_of(bearing, [0, 0, 0], [0, 0, 0]) == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_kernel_equals_the_formulas_written_out(seed):
    model = random_tree(seed, joints=7, sliding=0.4)
    scene = pf.Scene(model=model, friction=random_friction(model, seed))
    q, v, a = random_states(model, seed, 15)
    result = pf.inverse_dynamics(scene, q, v, a)
    wrenches = pf.joint_wrenches(scene, q, v, a)
    twin = scene.twin()
    for i in range(len(q)):
        for s, site in enumerate(scene.sites):
            along = q[i, twin.q_index[site.joint]]
            expected = plain_normal_load(site, wrenches[i, site.joint], along)
            assert result.normal_load[i, s] == pytest.approx(expected, rel=1e-12)


def test_horizontal_pin_under_weight():
    # a disc of 3 kg hung on a horizontal pin through its centre: friction mu R m g, no more
    disc = pin.Inertia(3.0, np.zeros(3), np.diag([0.1, 0.2, 0.1]))
    model = chain(("pin", pin.JointModelRY(), disc))
    bearing = {"kind": "pin", "radius": 0.02, "length": 0.1}
    scene = pf.Scene(
        model=model, friction={"pin": {"bearing": bearing, "mu": {"static": 0.4, "kinetic": 0.25}}}
    )
    weight = 0.02 * 3.0 * 9.81
    for v, lower, upper in ((2.0, 0.25, 0.25), (-2.0, -0.25, -0.25), (0.0, -0.4, 0.4)):
        result = pf.inverse_dynamics(scene, [[0.0]], [[v]], [[0.0]])
        assert result.effort_lower[0, 0] == pytest.approx(lower * weight, rel=1e-12)
        assert result.effort_upper[0, 0] == pytest.approx(upper * weight, rel=1e-12)
