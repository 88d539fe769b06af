"""A prepared solver: the same numbers as the functions of batches, in memory of its own."""

import pickle
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import (
    block,
    chain,
    lump,
    plane_friction,
    random_friction,
    random_states,
    random_tree,
    sliding_block,
)
from cases import (
    ball_tripod,
    drawer_scene,
    jamming_drawer,
    painleve_rod,
    resting_four_bar,
    turning_four_bar,
)
from mechanisms import crank_rates, cut_slider_crank, four_bar, pin_friction
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace, lent
from pinfric.dynamics.problem import plan
from pinfric.dynamics.samples.outcome import Status
from pinfric.errors import (
    AccelerationError,
    LoopMotionError,
    PinfricError,
    RollMomentError,
    SceneError,
    StateError,
)
from pinfric.model.robot import example_robot_data

GEAR = {
    "ratio": 80.0,
    "efficiency": 0.8,
    "back_efficiency": 0.7,
    "no_load_torque": 0.02,
    "motor_viscous": 1e-4,
    "rotor_inertia": 2e-5,
}
WORM = {"ratio": -50.0, "efficiency": 0.4, "back_efficiency": -0.5}
PAYLOAD = {"mass": 1.5, "com": [0.0, 0.05, 0.1], "inertia": [0.01, 0.0, 0.0, 0.01, 0.0, 0.01]}


def floating(model):
    """The model with its first joint on a floating base."""
    base = pin.Model()
    root = base.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    base.appendBodyToJoint(root, lump(2.0, [0.0, 0.1, 0.0], 0.1), pin.SE3.Identity())
    base.addBodyFrame("trunk", root, pin.SE3.Identity(), 0)
    return pin.appendModel(base, model, base.getFrameId("trunk"), pin.SE3.Identity())


def tree(seed, *, base=False, gears=False):
    """A random tree with continuous and sliding joints, armature and every kind of friction."""
    model = random_tree(seed, 6, sliding=0.4)
    friction = random_friction(model, seed)
    for entry in friction.values():  # random guides jam in forward dynamics otherwise
        entry["mu"] = {key: 0.1 * value for key, value in entry["mu"].items()}
    friction.pop(model.names[2])  # one joint without: its wrench is no site's
    if base:
        model = floating(model)
    model.armature = np.linspace(0.0, 0.3, model.nv)
    geared = {model.names[-1]: GEAR, model.names[-2]: WORM} if gears else {}
    names = [n for n in model.names[1:] if n != "base"]
    actuators = None if base else [{"joint": n, "transmission": geared.get(n)} for n in names]
    return pf.Scene(model=model, friction=friction, actuators=actuators)


def panda():
    """A 7-axis arm whose second finger mimics the first, pins in every joint, and a payload."""
    urdf = example_robot_data() / "panda_description/urdf/panda.urdf"
    model = pin.buildModelFromUrdf(str(urdf), mimic=True)
    assert len(model.mimicking_joints) == 1
    model.armature = np.linspace(0.1, 0.8, model.nv)
    turning = pin_friction(0.1, 0.05, static=0.15, length=0.1)
    sliding = {
        "coulomb": {"static": 3.0, "kinetic": 2.0},
        "viscous": 4.0,
        "bearing": {"kind": "guide", "length": 0.1, "width": 0.1, "on": "parent"},
        "mu": {"static": 0.1, "kinetic": 0.1},
    }
    friction = {n: sliding if "finger" in n else turning for n in model.names[1:]}
    box = {"link": "panda_link7", "attached": True, **PAYLOAD}
    return pf.Scene(model=model, friction=friction, payloads={"box": box})


def slider_crank():
    scene, joints = cut_slider_crank(cut="W")
    angles = np.array([0.4, 2.0, 4.0])
    q, rates = joints(angles), crank_rates(angles, 5.0, 2.0)
    v, a = pf.consistent_motion(scene, q, ["O"], rates[0][:, :1], rates[1][:, :1])
    return scene, q, v, a


def states(scene, seed):
    """Moving samples, then the same with every second joint, and with all joints, at rest."""
    q, v, a = random_states(scene.model, seed, 12)
    v[4:8, ::2], v[8:] = 0.0, 0.0
    return q, v, a


def of_cases(*cases):
    return [(c.scene, c.q, c.v, c.a) for c in cases]


TREES = [tree(0), tree(1, gears=True), tree(2, base=True), tree(3, gears=True), panda()]
LINKAGES = [
    *of_cases(turning_four_bar(5), turning_four_bar(4, "A"), resting_four_bar(3)),
    *of_cases(jamming_drawer(0.4), ball_tripod()),
    slider_crank(),
]
EVERY = [(scene, *states(scene, 5 + n)) for n, scene in enumerate(TREES)] + LINKAGES
IDS = [
    "tree",
    "gears",
    "floating",
    "worm",
    "panda",
    "four-bar",
    "four-bar A",
    "rests",
    "drawer",
    "tripod",
    "slider-crank",
]
FIGURES = (
    *(name for name in pf.InverseInstant._fields if name != "gear_ratio"),
    *("joint_effort_lower", "joint_effort_upper"),
)


def assert_equal(found, expected, name):
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    assert_allclose(found, expected, rtol=0, atol=1e-12 * scale, err_msg=name)


@pytest.mark.parametrize(("scene", "q", "v", "a"), EVERY, ids=IDS)
def test_inverse_is_that_of_batches(scene, q, v, a):
    batch, solver = pf.inverse_dynamics(scene, q, v, a), scene.solver()
    assert batch.sticking.any() or np.abs(v).min() > 0.0
    for i in range(len(q)):
        found = solver.inverse(q[i], v[i], a[i])
        for name in FIGURES:
            assert_equal(getattr(found, name), getattr(batch, name)[i], name)


@pytest.mark.parametrize(("scene", "q", "v", "a"), EVERY, ids=IDS)
def test_forward_is_that_of_one_instant(scene, q, v, a):
    result, solver = pf.inverse_dynamics(scene, q, v, a), scene.solver()
    solved = 0
    for i in range(len(q)):
        effort = 0.7 * result.effort_lower[i] + 0.3 * result.effort_upper[i] + 0.1
        solver.inverse(q[i], v[i], a[i])  # the two share Pinocchio's data
        try:
            expected = pf.forward_dynamics(scene, q[i], v[i], effort)
        except AccelerationError as problem:
            with pytest.raises(type(problem)):
                solver.forward(q[i], v[i], effort)
            continue
        found, solved = solver.forward(q[i], v[i], effort), solved + 1
        for name in ("a", "modes", "friction", "multipliers", "normal_load", "wrench"):
            assert_equal(getattr(found, name), getattr(expected, name), name)
        assert found.status == expected.status
    assert solved > len(q) // 2


def test_a_solver_says_of_which_scene_and_payload_it_is():
    scene = pf.load_scene("panda_pick_and_place")
    shown = repr(pf.Solver(scene, next(iter(scene.payloads))))
    assert shown.startswith("<Solver of Scene panda_pick_and_place.yaml: 7 joints")
    assert "\n" not in shown
    assert shown.endswith(f", carries {next(iter(scene.payloads))}>")


def test_the_plan_of_a_robot_with_leg_drives_only_is_kept(monkeypatch):
    """Its base falls freely; the first call makes the plan by hundreds of `pin.rnea`."""
    legs = random_tree(3, 4, sliding=0.0)
    model = floating(legs)
    names = [{"joint": name} for name in list(model.names)[2:]]
    scene = pf.Scene(model=model, friction=random_friction(legs, 3), actuators=names)
    q, v = pin.neutral(model), np.zeros(model.nv)
    a = pin.aba(model, model.createData(), q, v, v)
    solver, calls = scene.solver(), []
    first = solver.inverse(q, v, a).effort_lower.copy()
    friction = solver.inverse(q, v, a).friction_upper
    monkeypatch.setattr(plan, "_choose_contacts", lambda *given: calls.append(given))
    assert_array_equal(solver.inverse(q, v, a).effort_lower, first)
    assert_allclose(first, -friction, atol=1e-10)
    assert not calls


@pytest.mark.parametrize(("scene", "q", "v", "a"), EVERY, ids=IDS)
def test_wrenches_from_outside_are_those_of_batches(scene, q, v, a):
    """On the first and the last link; the next call without them does not see them."""
    force = 3.0 * np.random.default_rng(8).normal(size=(2, 6))
    if scene.linkage is not None:  # its guides have no width: no moment about their axis
        force[:, 3:] = 0.0
    external = dict(zip((scene.joint_names[0], scene.joint_names[-1]), force, strict=False))
    batch, alone = (pf.inverse_dynamics(scene, q, v, a, given) for given in (external, None))
    solver, solved = scene.solver(), 0
    for i in range(len(q)):
        for expected, given in ((batch, external), (alone, None)):
            found = solver.inverse(q[i], v[i], a[i], external=given)
            for name in FIGURES:
                assert_equal(getattr(found, name), getattr(expected, name)[i], name)
        effort = 0.7 * batch.effort_lower[i] + 0.3 * batch.effort_upper[i] + 0.1
        try:
            expected = pf.forward_dynamics(scene, q[i], v[i], effort, external)
        except AccelerationError:
            continue
        found, solved = solver.forward(q[i], v[i], effort, external=external), solved + 1
        for name in ("a", "modes", "friction", "multipliers", "normal_load", "wrench"):
            assert_equal(getattr(found, name), getattr(expected, name), name)
    assert solved > len(q) // 2
    assert np.abs(batch.effort_lower - alone.effort_lower).max() > 1e-3


def solo12(friction):
    """A quadruped on a floating base that nothing drives, with drives at its legs."""
    urdf = example_robot_data() / "solo_description/robots/solo12.urdf"
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    legs = list(model.names)[2:]
    return pf.Scene(
        model=model,
        friction=dict.fromkeys(legs, friction) if friction else {},
        actuators=[{"joint": name} for name in legs],
    )


def standing(model, speed, seed):
    """A state (q, v, a) on four feet, the wrenches at the feet, and Pinocchio's list of them."""
    rng, data = np.random.default_rng(seed), model.createData()
    bent = np.r_[0.1 * rng.normal(size=6), np.tile([0.1, 0.8, -1.6], 4)]
    q = pin.integrate(model, pin.neutral(model), bent + 0.05 * rng.normal(size=model.nv))
    v, a = speed * rng.normal(size=model.nv), 2.0 * rng.normal(size=model.nv)
    feet = [model.frames[model.getFrameId(f"{leg}_FOOT")] for leg in ("FL", "FR", "HL", "HR")]
    base = pin.rnea(model, data, q, v, a)[:6]
    J = [
        pin.computeFrameJacobian(model, data, q, model.getFrameId(foot.name), pin.LOCAL)[:, :6]
        for foot in feet
    ]
    wrenches = np.linalg.lstsq(np.vstack(J).T, base, rcond=None)[0].reshape(4, 6)
    on_joints = [pin.Force.Zero() for _ in range(model.njoints)]
    for foot, wrench in zip(feet, wrenches, strict=True):
        on_joints[foot.parentJoint] += foot.placement.act(pin.Force(wrench))
    given = {foot.name: wrench for foot, wrench in zip(feet, wrenches, strict=True)}
    return (q, v, a), given, on_joints


def test_a_quadruped_stands_on_its_feet_as_pinocchio_has_it():
    scene = solo12(None)
    model, solver = scene.model, scene.solver()
    data = model.createData()
    for seed in range(4):
        (q, v, a), feet, on_joints = standing(model, 1.0, seed)
        expected = pin.rnea(model, data, q, v, a, on_joints)
        assert_allclose(expected[:6], 0.0, atol=1e-12)
        found = solver.inverse(q, v, a, external=feet)
        for effort in (found.effort_lower, found.effort_upper, found.effort_frictionless):
            assert_allclose(effort, expected[6:], atol=1e-11)
        assert_allclose(solver.forward(q, v, expected[6:], external=feet).a, a, atol=1e-8)
    with pytest.raises(pf.PinfricError, match="root_joint"):  # nothing holds its base
        solver.inverse(q, v, a)


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_quadruped_with_friction_stands_on_its_feet_as_in_batches(speed):
    pins = {"kind": "pin", "radius": 0.02, "length": 0.05}
    scene = solo12({"bearing": pins, "mu": {"static": 0.2, "kinetic": 0.15}})
    solver = scene.solver()
    for seed in range(3):
        (q, v, a), feet, _ = standing(scene.model, speed, seed)
        batch, found = (
            pf.inverse_dynamics(scene, q, v, a, feet),
            solver.inverse(q, v, a, external=feet),
        )
        assert batch.sticking.all() == (speed == 0.0)
        for name in FIGURES:
            assert_equal(getattr(found, name), getattr(batch, name)[0], name)
        effort = found.effort_lower.copy()
        expected = pf.forward_dynamics(scene, q, v, effort, feet)
        ahead = solver.forward(q, v, effort, external=feet)
        for name in ("a", "modes", "friction", "normal_load", "wrench"):
            assert_equal(getattr(ahead, name), getattr(expected, name), name)
        if speed:
            assert_allclose(ahead.a, a, atol=1e-7)


@pytest.mark.parametrize("method", ["inverse", "forward"])
@pytest.mark.parametrize(
    ("external", "error", "says"),
    [
        ({"foot": np.ones(6)}, SceneError, "there is no frame 'foot'"),
        ({EVERY[0][0].joint_names[0]: np.ones(3)}, StateError, r"shape \(3,\)"),
        (np.ones(6), StateError, "should be a mapping"),
    ],
)
def test_a_wrench_on_no_frame_is_refused(method, external, error, says):
    scene, *state = EVERY[0]
    with pytest.raises(error, match=says):
        getattr(scene.solver(), method)(*(x[0] for x in state), external=external)


def test_payloads_are_those_asked_for():
    scene = panda()
    (q,), (v,), (a,) = random_states(scene.model, 3, 1)
    for attached in ((), ("box",)):
        solver, flags = scene.solver(attached), np.array([[bool(attached)]])
        expected = pf.inverse_dynamics(scene, q, v, a, attached=flags)
        effort = expected.effort_lower[0]
        assert_equal(solver.inverse(q, v, a).effort_lower, effort, "effort")
        instant = pf.forward_dynamics(scene, q, v, effort, attached=attached)
        assert_equal(solver.forward(q, v, effort).a, instant.a, "a")
    with pytest.raises(SceneError, match="there is no payload 'ball'"):
        scene.solver(["ball"])


def test_payloads_of_linkages_are_those_asked_for():
    scene = four_bar()[0].with_(payloads={"box": {"link": "coupler", **PAYLOAD}})
    q, zero = turning_four_bar(3).q[1], np.zeros(3)
    for attached in ((), ("box",)):
        expected = pf.inverse_dynamics(scene, q, zero, zero, attached=np.array([[bool(attached)]]))
        found = scene.solver(attached).inverse(q, zero, zero)
        assert_equal(found.effort_upper, expected.effort_upper[0], "effort")
    assert found.effort_upper != scene.solver(()).inverse(q, zero, zero).effort_upper


def test_another_process_gets_a_solver_of_its_own():
    solver = TREES[1].solver()
    (q,), (v,), (a,) = random_states(solver.scene.model, 3, 1)
    other = pickle.loads(pickle.dumps(solver))
    assert_equal(other.inverse(q, v, a).wrench, solver.inverse(q, v, a).wrench, "wrench")
    assert not np.shares_memory(other.inverse(q, v, a).wrench, solver.inverse(q, v, a).wrench)


def test_a_linkage_that_was_made_to_fit_stays_as_it_is():
    """Its placements were turned when the scene was made; the solver's are the same."""
    rng = np.random.default_rng(0)
    with pytest.warns(pf.PinfricWarning, match="axes on one link are now parallel"):
        scene, _ = cut_slider_crank(turned=lambda: pin.exp3(1e-7 * rng.normal(size=3)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solver = scene.solver()
    assert solver.scene.model == scene.model


def test_results_stay_in_the_same_memory():
    scene = TREES[1]
    solver, (q, v, a) = scene.solver(), states(scene, 1)
    first = solver.inverse(q[0], v[0], a[0])
    before = first.effort_lower.copy()
    second = solver.inverse(q[1], v[1], a[1])
    assert second is first
    assert (first.effort_lower != before).all()
    one = solver.forward(q[0], v[0], before)
    other = solver.forward(q[1], v[1], before)
    for name in ("modes", "friction", "normal_load", "wrench"):
        assert np.shares_memory(getattr(one, name), getattr(other, name)), name
        assert not np.shares_memory(getattr(one, name), first.effort_lower)
    assert not np.shares_memory(one.a, other.a)


def test_the_caller_s_arrays_stay_his():
    """They are copied: neither changed, nor read after the call."""
    scene = TREES[0]
    solver, (q, v, a) = scene.solver(), states(scene, 2)
    kept = [x.copy() for x in (q, v, a)]
    effort = solver.inverse(q[0], v[0], a[0]).effort_lower  # the solver's own as an argument
    expected = pf.forward_dynamics(scene, q[0], v[0], effort.copy()).a
    assert_equal(solver.forward(q[0], v[0], effort).a, expected, "a")
    for before, after in zip(kept, (q, v, a), strict=True):
        assert_array_equal(before, after)


@pytest.mark.parametrize("kind", ["list", "single", "strided", "whole"])
def test_states_may_come_as_other_numbers(kind):
    scene = sliding_block(plane_friction(0.3, 0.2), 0.1)
    given = np.array([1.0]), np.array([2.0]), np.array([3.0])
    changed = {
        "list": lambda x: x.tolist(),
        "single": np.float32,
        "whole": lambda x: x.astype(int),
        "strided": lambda x: np.repeat(x, 2)[::2],
    }[kind]
    solver = scene.solver()
    expected = solver.inverse(*given).effort_lower.copy(), solver.forward(*given).a.copy()
    others = [changed(x) for x in given]
    assert_equal(solver.inverse(*others).effort_lower, expected[0], "effort")
    assert_equal(solver.forward(*others).a, expected[1], "a")


def test_a_configuration_off_its_manifold_is_normalized():
    scene = TREES[2]
    solver, (q, v, a) = scene.solver(), random_states(scene.model, 4, 1)
    effort = pf.inverse_dynamics(scene, q, v, a).effort_lower[0]
    expected = solver.forward(q[0], v[0], effort).a.copy()
    longer = q[0].copy()
    longer[3:7] *= 1.1  # the base's quaternion
    with pytest.warns(pf.PinfricWarning, match="not on the configuration manifold"):
        assert_equal(solver.inverse(longer, v[0], a[0]).effort_lower, effort, "effort")
    with pytest.warns(pf.PinfricWarning, match="not on the configuration manifold"):
        assert_equal(solver.forward(longer, v[0], effort).a, expected, "a")


BAD = [
    ("q", np.zeros(5), r"^q: shape \(5,\); should be \(6,\), nq = 6$"),
    ("v", np.zeros((1, 6)), r"^v: shape \(1, 6\); should be \(6,\), nv = 6$"),
    ("last", np.zeros(7), r"^(a|effort): shape \(7,\); should be \(6,\), n[av] = 6$"),
    ("q", np.full(6, np.nan), "^q: .*nan"),
    ("v", np.full(6, np.inf), "^v: .*inf"),
    ("last", np.full(6, np.nan), "^(a|effort): .*nan"),
    ("v", np.full(6, 1e200), "1e\\+200|overflow|too large"),
    ("q", ["a"] * 6, "^q: "),
    ("last", np.ones(6) * 1j, "^(a|effort): "),
]


@pytest.mark.parametrize("method", ["inverse", "forward"])
@pytest.mark.parametrize(("which", "wrong", "said"), BAD)
def test_what_is_no_state_is_refused_and_leaves_no_trace(method, which, wrong, said):
    model = pin.buildModelFromUrdf(str(example_robot_data() / "ur_description/urdf/ur5_robot.urdf"))
    scene = pf.Scene(model=model, friction={model.names[2]: pin_friction(0.1)})
    solver, good = scene.solver(), dict.fromkeys(("q", "v", "last"), np.full(6, 0.3))
    before = [np.copy(x) for x in getattr(solver, method)(*good.values())[:6]]
    with pytest.raises(StateError, match=said) as caught:
        getattr(solver, method)(*(good | {which: wrong}).values())
    assert "\n" not in str(caught.value)
    for x, y in zip(before, getattr(solver, method)(*good.values())[:6], strict=True):
        assert_equal(y, x, method)


def test_an_effort_that_overflows_is_refused():
    model = block()
    model.armature = np.array([1e300])
    with pytest.raises(StateError, match=r"^the effort of slide .* overflows"):
        pf.Scene(model=model).solver().inverse([0.0], [0.0], [1e9])


def test_a_guide_that_cannot_carry_a_moment_is_refused():
    body = lump(1.0, [0.0, 0.1, 0.0])
    model = chain(("slide", pin.JointModelPX(), body))
    guide = {"bearing": {"kind": "guide", "length": 0.2}, "mu": {"static": 0.1, "kinetic": 0.1}}
    solver = pf.Scene(model=model, friction={"slide": guide}).solver()
    for method in (solver.inverse, solver.forward):
        with pytest.raises(RollMomentError):
            method([0.0], [0.0], [0.0])


def test_an_open_loop_is_refused_as_in_one_instant():
    case = turning_four_bar(3)
    scene, q, v, a = case.scene, case.q[1], case.v[1], case.a[1]
    effort, solver = case.inverse().effort_lower[1], case.scene.solver()
    solver.forward(q, v, effort)
    second = np.array([0.0, 1.0, 0.0])
    for state in ((q + 0.01 * second, v), (q, v + 0.1 * second)):
        with pytest.raises(LoopMotionError) as expected:
            pf.forward_dynamics(scene, *state, effort)
        with pytest.raises(LoopMotionError) as found:
            solver.forward(*state, effort)
        assert str(found.value) == str(expected.value)
        with pytest.raises(LoopMotionError):
            solver.inverse(*state, a)
    # what an integrator leaves open is let pass, as there
    nearly = q + 1e-5 * second
    assert_equal(
        solver.forward(nearly, v, effort).a, pf.forward_dynamics(scene, nearly, v, effort).a, "a"
    )


def test_a_jam_is_said():
    case = jamming_drawer(0.6)
    found = case.scene.solver().inverse(case.q[0], case.v[0] + 1.0, case.a[0])
    assert found.status == Status.JAMMED
    assert np.isnan(found.effort_lower).all()


def test_a_refused_state_leaves_no_trace_in_the_next_one():
    case = painleve_rod(1.4, np.arctan(2.0))
    solver = case.scene.solver()
    with pytest.raises(AccelerationError):
        solver.forward(case.q[0], case.v[0], np.zeros(2))
    assert solver.forward(np.array([0.0, -0.1]), case.v[0], np.zeros(2)).answers == 1


def test_a_workspace_that_was_lent_before_is_as_new():
    scene = pf.load_scene("three_link")
    with lent(scene, None, False) as first:
        first.solve(np.ones(3), np.array([1.0, -1.0, 0.0]), np.ones(3), None)
    with lent(scene, None, False) as second:
        assert second is first
        new = Workspace(scene, None)
        for found, expected in (
            *zip(second.modes, new.modes, strict=True),
            *zip(second.machine.results, new.machine.results, strict=True),
        ):
            assert_array_equal(found, expected)


def test_a_refusal_names_the_joint_whose_load_grows_most():
    """Beside the rod slides a drawer whose load grows, too, but almost without friction."""
    case = painleve_rod(1.4, np.arctan(2.0))
    model = case.scene.model.copy()
    drawer = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "drawer")
    model.appendBodyToJoint(drawer, lump(1.0, [0.0, 0.3, 0.0], 0.1), pin.SE3.Identity())
    guide = {"bearing": {"kind": "guide", "length": 0.1}, "mu": {"static": 1e-3, "kinetic": 1e-3}}
    for friction in (
        {"drawer": guide, **case.scene.friction},
        {**case.scene.friction, "drawer": guide},
    ):
        scene = pf.Scene(model=model, friction=friction)
        with pytest.raises(AccelerationError, match="'slider'"):
            scene.solver().forward(
                np.append(case.q[0], 0.0), np.append(case.v[0], 1.0), np.zeros(3)
            )


def test_a_model_changed_later_does_not_reach_the_solver():
    for scene in (drawer_scene(0.2), sliding_block(angle=0.3)):
        solver, one = scene.solver(), np.ones(1)
        before = (
            solver.inverse(one, one, one).effort_lower.copy(),
            solver.forward(one, one, one).a.copy(),
        )
        scene.model.gravity.linear = np.array([1.0, 2.0, 3.0])
        assert_equal(solver.inverse(one, one, one).effort_lower, before[0], "effort")
        assert_equal(solver.forward(one, one, one).a, before[1], "a")
        with pytest.raises(SceneError, match=r"scene.model was changed \(gravity\)"):
            scene.solver()


@pytest.mark.parametrize("given", ["effort", "motor_torque"])
def test_threads_that_share_a_solver_do_not_meet(given):
    """Two threads, 10,000 calls, interrupted often; with shared buffers dozens were wrong."""
    scene = TREES[1]
    if given == "motor_torque":
        geared = [{"joint": name, "transmission": GEAR} for name in scene.actuator_names]
        scene = scene.with_(actuators=geared)
    (q, v, a), solver = random_states(scene.model, 8, 40), scene.solver()
    batch, drive = pf.inverse_dynamics(scene, q, v, a), np.zeros(len(scene.drives))
    alone = pf.forward_dynamics(scene, q, v, **{given: np.tile(drive, (40, 1))})
    order = np.arange(5000) % 40

    def run(start):
        efforts, accelerations = [], []
        for i in (order + start) % 40:
            efforts.append(solver.inverse(q[i], v[i], a[i]).effort_upper.copy())
            if i == start:
                accelerations.append(solver.forward(q[i], v[i], **{given: drive}).a)
        return efforts, accelerations

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            found = list(pool.map(run, (0, 20)))
    finally:
        sys.setswitchinterval(interval)
    for start, (efforts, accelerations) in zip((0, 20), found, strict=True):
        assert_equal(efforts, batch.effort_upper[(order + start) % 40], "effort")
        assert_equal(accelerations, [alone.a[start]] * 125, "acceleration")


def test_a_scene_without_friction_and_one_without_joints():
    scene = pf.Scene(model=random_tree(4))
    solver, (q, v, a) = scene.solver(), states(scene, 1)
    found = solver.inverse(q[0], v[0], a[0])
    data = scene.model.createData()
    assert_equal(found.effort_lower, pin.rnea(scene.model, data, q[0], v[0], a[0]), "effort")
    assert_equal(solver.forward(q[0], v[0], found.effort_upper).a, a[0], "a")
    empty = pf.Scene(model=pin.Model()).solver()
    assert empty.inverse(*np.zeros((3, 0))).effort_lower.shape == (0,)


IN_A_LOOP = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[1:]
import test_solver
from numba.core.dispatcher import Dispatcher
from pinfric.errors import PinfricError
from pinfric.kernels.interpreted import CLOCK

def compiled():
    kernels = {x for module in list(sys.modules.values()) for x in vars(module).values()
               if Dispatcher in type(x).__mro__}
    return {(kernel.py_func.__name__, types) for kernel in kernels for types in kernel.overloads}

for (scene, q, v, a), name in zip(test_solver.EVERY, test_solver.IDS, strict=True):
    solver = scene.solver()
    before, clock, calls = compiled(), CLOCK.here, 0
    for i in range(len(q)):
        for call in (lambda: solver.inverse(q[i], v[i], a[i]),
                     lambda: solver.forward(q[i], v[i], [0.1] * len(scene.drives)),
                     lambda: solver.forward(q[i], 0 * v[i], [0.1] * len(scene.drives))):
            try:
                call()
            except PinfricError:
                pass
            calls += 1
    print(name, calls, compiled() - before or "none", CLOCK.here - clock)
"""


@pytest.mark.slow
def test_no_kernel_is_compiled_or_interpreted_after_a_solver_is_made():
    """In a process of its own, without calls of other tests."""
    tests = Path(__file__).parents[2]
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            IN_A_LOOP,
            str(tests),
            f"{tests}/helpers",
            str(Path(__file__).parent),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [line.rsplit(maxsplit=3) for line in done.stdout.splitlines()]
    assert [name for name, *_ in lines] == IDS
    for name, calls, compiled, interpreted in lines:
        assert int(calls) >= 3, name
        assert (compiled, float(interpreted)) == ("none", 0.0), name


#: Kernels that a solver of an open chain compiles from an empty cache: a third of a second each.
KERNELS = 100
ARE_REACHED = """
import pinfric as pf
from pinfric.kernels.compiled import _KERNELS
from pinfric.kernels.progress import _reached

pf.load_scene("ur5e").solver()
made = (each for alike in _KERNELS.values() for each in alike if each.overloads)
print(len(set().union(*(_reached(each.py_func) for each in made))))
"""


@pytest.mark.slow
def test_a_solver_compiles_no_more_kernels_than_its_budget():
    """A commit that changes the number says what it bought."""
    done = subprocess.run(
        [sys.executable, "-c", ARE_REACHED], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) <= KERNELS


@pytest.mark.parametrize("index", range(len(EVERY)), ids=IDS)
def test_a_solver_of_other_friction_is_that_of_a_new_scene(index):
    """The old one is unchanged, and both may be called in turn."""
    scene, q, v, a = EVERY[index]
    solver = scene.solver()
    friction = {n: f.scaled(1.3) for n, f in list(scene.friction.items())[1:]}
    for n in list(friction)[:1]:  # gears rest by it, too
        friction[n] = friction[n].model_copy(update={"stick_velocity": 0.5})
    other, fresh = (
        solver.with_friction(friction),
        scene.with_(friction={**scene.friction, **friction}).solver(),
    )
    for i in range(len(q)):
        for found, expected in ((other, fresh), (solver, scene.solver())):
            ours = {
                name: np.array(getattr(found.inverse(q[i], v[i], a[i]), name)) for name in FIGURES
            }
            theirs = expected.inverse(q[i], v[i], a[i])
            for name, figure in ours.items():
                assert_equal(figure, getattr(theirs, name), name)
    effort = 0.7 * pf.inverse_dynamics(fresh.scene, q, v, a).effort_lower[0] + 0.1
    for found, expected in ((other, fresh), (solver, scene.solver())):
        with suppress(PinfricError):
            assert_equal(
                found.forward(q[0], v[0], effort).a, expected.forward(q[0], v[0], effort).a, "a"
            )


def test_other_coefficients_need_no_new_tables(monkeypatch):
    """No kernels, workspaces or checked scene are made; another bearing needs them."""
    scene = pf.load_scene("ur10_machine_tending")
    solver, friction = scene.solver(), {n: f.scaled(0.9) for n, f in scene.friction.items()}
    state = np.zeros(6), np.full(6, 0.3), np.ones(6)
    wanted = scene.with_(friction=friction).solver().compensate(*state, state[1])

    def refuse(*_, **__):
        raise AssertionError

    with monkeypatch.context() as patched:
        for made in ("Workspace", "rehearse"):
            patched.setattr(f"pinfric.dynamics.forward.solver.{made}", refuse)
        patched.setattr(pf.Scene, "__post_init__", refuse)
        other = solver.with_friction(friction)
        assert other.inverse(*state).normal_load.shape == (6,)
        assert_array_equal(other.compensate(*state, state[1]), wanted)
        with pytest.raises(AssertionError):
            solver.with_friction({"elbow_joint": {"coulomb": 1.0}})
    assert (
        solver.with_friction({"elbow_joint": {"coulomb": 1.0}})
        .scene.friction["elbow_joint"]
        .bearing
        is None
    )
    with pytest.raises(SceneError, match="there is no joint 'elbow'"):
        solver.with_friction({"elbow": {"coulomb": 1.0}})
