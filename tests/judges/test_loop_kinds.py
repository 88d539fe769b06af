"""Loops of every kind: spatial mechanisms, cuts elsewhere, closed forms, and what is refused."""

import numpy as np
import pinocchio as pin
import pytest
import yaml
from judges.verdict import judge
from mechanisms import add_link, crank_rates, cut_slider_crank, grounded_model, spatial_loop
from numpy.testing import assert_allclose
from tables import table

import pinfric as pf
from pinfric.dynamics.samples.closure import consistent_motion, working_rates
from pinfric.errors import SceneError
from pinfric.model.closure import action_maps, loop_state

KINDS = ("spherical", "revolute", "fixed", "prismatic", "cylindrical", "universal")
#: The joints that a loop's joint is made of, in a row.
_TURNS, _SLIDES = pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned
JOINTS = {
    "fixed": [],
    "revolute": [_TURNS],
    "prismatic": [_SLIDES],
    "cylindrical": [_SLIDES, _TURNS],
    "universal": [_TURNS, _TURNS],
}


def spatial_motion(kind, seed, mu=0.01, samples=3):
    """(scene, q, v, a, driven joints) of a random closed mechanism."""
    scene, q, driven = spatial_loop(kind, seed, mu)
    rng, guess, found = np.random.default_rng(seed), q, []
    index = [scene.model.joints[scene.model.getJointId(name)].idx_q for name in driven]
    for _ in range(samples):
        found.append(scene.close(guess, driven))
        guess = found[-1].copy()
        guess[index] += 0.02
    rates = rng.normal(size=(2, samples, len(driven)))
    return scene, np.array(found), *consistent_motion(scene, np.array(found), driven, *rates), index


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("kind", KINDS)
def test_gaps_rates_and_their_derivatives_agree_with_differences(kind, seed):
    scene, q, v, a, _ = spatial_motion(kind, seed)
    twin, linkage, h = scene.twin(), scene.linkage, 1e-6
    rows, rng = linkage.lambdas, np.random.default_rng(seed)
    state = loop_state(twin, linkage, q, v, a)
    for relation in (state.gap, state.rate, state.rate_derivative):
        assert np.abs(relation[:, rows]).max() < 2e-13
    J = action_maps(twin, linkage, state.p, state.R)[1]
    assert_allclose(np.einsum("txv,tv->tx", J, v), state.rate, atol=1e-13)

    def later(step, rates, accelerations):
        moved = np.array(
            [pin.integrate(scene.model, x, step * y) for x, y in zip(q, rates, strict=True)]
        )
        return loop_state(twin, linkage, moved, rates + step * accelerations, accelerations)

    derivative = (later(h, v, a).rate - later(-h, v, a).rate) / (2 * h)
    assert_allclose(derivative, state.rate_derivative, atol=1e-7)
    # any motion from a closed place, those too that open the loop: what Newton's steps need
    w = rng.normal(size=v.shape)
    opened = (later(h, w, 0 * w).gap - later(-h, w, 0 * w).gap)[:, rows] / (2 * h)
    assert_allclose(opened, np.einsum("txv,tv->tx", J, w)[:, rows], atol=1e-7)


@pytest.mark.parametrize("kind", KINDS)
def test_power_is_balanced_and_forward_dynamics_gives_the_motion_back(kind):
    scene, q, v, a, index = spatial_motion(kind, 1)
    result = pf.inverse_dynamics(scene, q, v, a)
    assert (result.status == 0).all()
    residuals = judge(result)
    assert max(residuals.equilibrium, residuals.friction_law, residuals.wrench) < 1e-11
    model = scene.model
    tau = np.array(
        [pin.rnea(model, model.createData(), *state) for state in zip(q, v, a, strict=True)]
    )
    rates = working_rates(scene, q, v)[1]
    power = (result.effort_lower * v[:, index]).sum(axis=1)
    lost = (result.friction_lower * rates).sum(axis=1)
    assert (lost < 0).all()
    assert_allclose((tau * v).sum(axis=1), power + lost, atol=1e-12)
    back = pf.forward_dynamics(scene, q[1], v[1], result.effort_lower[1])
    assert_allclose(back.a, a[1], atol=1e-11)


@pytest.mark.parametrize("kind", ["prismatic", "cylindrical", "universal"])
def test_a_simulation_keeps_the_loop_closed(kind):
    scene, q, v, _, index = spatial_motion(kind, 0)
    motion = pf.simulate(scene, q[0], v[0], np.zeros(len(index)), 0.3)
    assert motion.status == "finished"
    state = loop_state(scene.twin(), scene.linkage, motion.q, motion.v, motion.a)
    rows = scene.linkage.lambdas
    assert np.abs(motion.q[-1] - q[0]).max() > 0.05
    assert np.abs(state.gap[:, rows]).max() < 1e-12
    assert np.abs(state.rate[:, rows]).max() < 1e-12


def accelerations_by_pinocchio(scene, kind, q, v, tau):
    """Accelerations with the loop as joints of links without mass, closed by a fixed constraint."""
    model, loop = scene.model.copy(), scene.loops[0]
    sides = []
    for entry in (loop.a, loop.b):
        frame = model.frames[model.getFrameId(entry.link, pin.FrameType.BODY)]
        local = pin.SE3(pin.rpy.rpyToMatrix(*entry.rpy), np.array(entry.xyz))
        sides.append((frame.parentJoint, frame.placement * local))
    (joint, place), (b, place_b) = sides
    data, axis = model.createData(), np.array(loop.axis)
    pin.forwardKinematics(model, data, q)
    apart = (data.oMi[joint] * place).actInv(data.oMi[b] * place_b)
    kinds = JOINTS[kind]
    axes = [axis, axis if loop.axis_b is None else np.array(loop.axis_b)]
    nv = model.nv
    # the joints of the loop are at zero here: how far apart the frames are stands between them
    for n, made in enumerate(kinds):
        joint = model.addJoint(joint, made(axes[n]), place, f"free_{n}")
        place = apart if n == 0 else pin.SE3.Identity()
    ends = [
        model.addFrame(pin.Frame(name, *end, pin.FrameType.OP_FRAME))
        for name, end in (("end_a", (joint, place)), ("end_b", (b, place_b)))
    ]
    data, world = model.createData(), pin.ReferenceFrame.WORLD
    q = np.concatenate([q, np.zeros(model.nq - nv)])
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    left = data.oMf[ends[0]].actInv(data.oMf[ends[1]])
    assert_allclose(left.homogeneous, np.eye(4), atol=1e-12)
    J = np.subtract(*(pin.getFrameJacobian(model, data, end, world) for end in ends))
    v = np.concatenate([v, np.linalg.lstsq(J[:, nv:], -J[:, :nv] @ v, rcond=None)[0]])
    assert np.abs(J @ v).max() < 1e-12
    pin.forwardKinematics(model, data, q, v, 0 * v)
    bias = np.subtract(*(pin.getFrameAcceleration(model, data, end, world).vector for end in ends))
    M = pin.crba(model, model.createData(), q)
    M = np.triu(M) + np.triu(M, 1).T
    h = pin.nonLinearEffects(model, model.createData(), q, v)
    K = np.block([[M, J.T], [J, np.zeros((6, 6))]])
    tau = np.concatenate([tau, np.zeros(model.nv - nv)])
    return np.linalg.solve(K, np.concatenate([tau - h, -bias]))[:nv]


@pytest.mark.parametrize("kind", ["fixed", "revolute", "prismatic", "cylindrical", "universal"])
def test_accelerations_are_those_of_links_without_mass_by_pinocchio(kind):
    scene, q, v, _, index = spatial_motion(kind, 2, mu=0.0)
    effort = np.random.default_rng(5).normal(scale=3.0, size=len(index))
    tau = np.zeros(scene.model.nv)
    tau[index] = effort
    expected = accelerations_by_pinocchio(scene, kind, q[1], v[1], tau)
    found = pf.forward_dynamics(scene, q[1], v[1], effort).a
    assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max())


# ---------------------------------------------------------------- one slider-crank, four cuts


def slider_crank_motion(cut, rate=10.0, acceleration=5.0, **more):
    """(scene, q, v, a) of the slider-crank over a turn, at angles that are no dead centre."""
    scene, joints = cut_slider_crank(cut, **more)
    angles = np.linspace(0.2, 6.1, 20)
    known, q = ("A" if cut == "O" else "O"), joints(angles)
    column = "OA".index(known)
    sign = -1.0 if cut == "O" else 1.0  # its A runs from the rod to the crank
    rates = [sign * x[:, [column]] for x in crank_rates(angles, rate, acceleration)]
    return scene, q, *consistent_motion(scene, q, [known], *rates)


@pytest.mark.parametrize("drive", ["O", "G"])
@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize(
    ("kind", "gravity"), [("planar_pin", (0.0, -9.81, 0.0)), ("revolute", (2.0, -7.0, 5.0))]
)
def test_a_slider_crank_cut_at_its_guide_is_the_one_cut_at_its_pins(kind, gravity, rest, drive):
    mu, found = (0.08 if drive == "O" else 0.02), {}
    for cut in "WGAO":
        scene, q, v, a = slider_crank_motion(cut, kind=kind, gravity=gravity, mu=mu, drive=drive)
        still = 0.0 if rest else 1.0
        result = pf.inverse_dynamics(scene, q, still * v, still * a)
        loads = result.normal_load[:, [scene.site_names.index(name) for name in "OAWG"]]
        guide = result.wrench[:, scene.site_names.index("G")]
        found[cut] = result.effort_lower, result.effort_upper, loads, guide
        if cut == "G":
            assert scene.sites[-1].sliding
            assert drive == "O" or scene.linkage.drives[0].unit == "N"
            residuals = judge(result)
            assert max(residuals.friction_law, residuals.wrench) < 1e-10
    for cut in "GAO":
        for ours, theirs in zip(found[cut], found["W"], strict=True):
            size = np.nanmax(np.abs(theirs))
            assert_allclose(ours, theirs, rtol=0, atol=1e-12 * size)


@pytest.mark.slow
@pytest.mark.parametrize("drive", ["O", "G"])
def test_a_guide_that_is_a_loop_slips_and_sticks_when_a_joint_would(drive):
    motions = {}
    for cut in "WG":
        scene, q, v, _ = slider_crank_motion(cut, mu=0.05, static=0.08, drive=drive)
        motions[cut] = pf.simulate(scene, q[0], v[0], np.zeros(1), 0.6, rtol=1e-11, atol=1e-13)
    ours, theirs = (
        sorted(motions[cut].events, key=lambda e: (round(e.time, 4), e.name)) for cut in "GW"
    )
    assert len(theirs) > 8  # dead centres, where the guide turns round, among them
    assert [(e.name, e.kind) for e in ours] == [(e.name, e.kind) for e in theirs]
    assert_allclose([e.time for e in ours], [e.time for e in theirs], atol=1e-8)
    state = loop_state(scene.twin(), scene.linkage, motions["G"].q, motions["G"].v, motions["G"].a)
    assert np.abs(state.gap[:, scene.linkage.lambdas]).max() < 1e-13


# ---------------------------------------------------------------- a universal joint between shafts


def cardan(angle, drag=0.3):
    """Two shafts that meet at an angle (rad), the second with viscous friction."""
    model = grounded_model((0.0, 0.0, 0.0))
    inertia = pin.Inertia(1.0, np.zeros(3), np.diag([0.02, 0.03, 0.03]))
    bent = pin.SE3(pin.rpy.rpyToMatrix(0, 0, angle), np.zeros(3))
    add_link(model, 0, pin.JointModelRX(), pin.SE3.Identity(), "first", inertia)
    add_link(model, 0, pin.JointModelRX(), bent, "second", inertia)
    cross = {
        "name": "cross",
        "kind": "universal",
        "axis": [0, 1, 0],
        "axis_b": [0, 0, 1],
        "a": {"link": "first"},
        "b": {"link": "second"},
    }
    return pf.Scene(
        model=model,
        loops=[cross],
        actuators=[{"joint": "first"}],
        friction={"second": {"viscous": drag}},
    )


def test_a_universal_joint_turns_its_shaft_as_cardan_says():
    angle, drag, rate, n = 0.6, 0.3, 2.0, 40
    scene, theta = cardan(angle, drag), np.linspace(0, 2 * np.pi, 40)
    q = np.column_stack([theta, np.arctan2(np.sin(theta), np.cos(angle) * np.cos(theta))])
    one = np.ones((n, 1))
    q = np.array([scene.close(x, ["first"]) for x in q])
    v, a = consistent_motion(scene, q, ["first"], rate * one, 0 * one)
    # the first cross axis starts in the plane of the shafts
    across = 1 - np.sin(angle) ** 2 * np.cos(theta) ** 2
    ratio = np.cos(angle) / across
    assert_allclose(v[:, 1], ratio * rate, rtol=1e-12)
    change = -np.cos(angle) * np.sin(angle) ** 2 * np.sin(2 * theta) / across**2 * rate**2
    assert_allclose(a[:, 1], change, atol=1e-12)
    result = pf.inverse_dynamics(scene, q, v, a)
    torque = ratio * (0.02 * change + drag * ratio * rate)
    assert_allclose(result.effort_lower[:, 0], torque, atol=1e-13)
    # the cross turns the shaft by a moment about the normal of its axes
    moment = result.multipliers[:, 0, 3:]
    assert_allclose(moment[:, 2], 0.0, atol=1e-14)
    assert_allclose(moment[:, 0], 0.02 * change + drag * ratio * rate, atol=1e-13)
    assert judge(result).equilibrium < 1e-12


# ---------------------------------------------------------------- what is refused


CASES = r"""
G  {}  {kind: pin, radius: 0.01}  a pin does not fit a prismatic loop
G  {}                                    {kind: guide, length: 0.1, 'on': parent}  exchange a and b
G  {}  {kind: linear, axial: 0.1, radial: 0.1}  no force along its axis
W  {kind: cylindrical}  {kind: pin, radius: 0.01}  two degrees of freedom
W  {kind: universal, axis_b: [1, 0, 0]}  {kind: ball, radius: 0.01}                two
W  {kind: universal}  null  a universal loop needs `axis_b`
W  {axis_b: [1, 0, 0]}  null  a revolute loop has one axis: leave `axis_b` out
W  {kind: universal, axis_b: [0, 0, 0]}  null  \(W\)\.axis_b: .* no direction
"""


@pytest.mark.parametrize(
    ("cut", "change", "friction", "says"),
    table(CASES, str, yaml.safe_load, yaml.safe_load, str),
)
def test_what_loops_cannot_have_is_refused(cut, change, friction, says):
    scene, _ = cut_slider_crank(cut, friction=False)
    loop = {**scene.loops[0].model_dump(exclude_none=True), **change}
    rubs = {cut: {"bearing": friction, "mu": {"static": 0.1, "kinetic": 0.1}}} if friction else {}
    with pytest.raises(SceneError, match=says):
        pf.Scene(model=scene.model, loops=[loop], actuators=[{"joint": "O"}], friction=rubs)


@pytest.mark.parametrize(
    ("kind", "more"), [("cylindrical", {}), ("universal", {"axis_b": [1, 0, 0]})]
)
def test_a_loop_that_moves_in_two_ways_has_no_axis_to_drive(kind, more):
    scene, _ = cut_slider_crank("W", friction=False)
    loop = {**scene.loops[0].model_dump(exclude_none=True), "kind": kind, **more}
    with pytest.raises(SceneError, match=f"loop 'W' is {kind}: it has no single axis to drive"):
        pf.Scene(model=scene.model, loops=[loop], actuators=[{"joint": "W"}])
