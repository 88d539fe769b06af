"""Forward dynamics at one instant: Pinocchio without friction, closed forms, thresholds, errors."""

import numpy as np
import pinocchio as pin
import pytest
from builders import (
    block,
    chain,
    dry,
    guided,
    lump,
    plane_friction,
    random_friction,
    random_states,
    random_tree,
    sliding_block,
)
from judges.fewest_slips import fewest_slips
from mechanisms import beside, four_bar, pin_friction
from numpy.testing import assert_allclose, assert_array_equal
from tables import arguments, table

import pinfric as pf
from pinfric.errors import (
    AmbiguousAcceleration,
    NoConsistentAcceleration,
    RollMomentError,
    SceneError,
    StateError,
    UndecidedAcceleration,
)
from pinfric.friction import search

G = 9.81


def gentle(friction: dict) -> dict:
    """The random friction with a fifth of the coefficients, so that random guides do not jam."""
    for entry in friction.values():
        entry["mu"] = {key: 0.2 * value for key, value in entry["mu"].items()}
    return friction


def pinned_body(b: float, mu_static: float | None = None) -> pf.Scene:
    """A body on a pin, no gravity: friction over inertia torque is b, a = -b |(a, v^2)|.

    b = mu R m l / J about the pin, with m = l = J = 1 and R = 0.1.
    """
    body = pin.Inertia(1.0, np.array([1.0, 0, 0]), np.zeros((3, 3)))
    model = chain(("pin", pin.JointModelRZ(), body), gravity=0.0)
    mu = b / 0.1
    static = mu if mu_static is None else mu_static
    with pytest.warns(pf.PinfricWarning) if static > 2 else _nothing():
        return pf.Scene(
            model=model,
            friction={"pin": pin_friction(mu, 0.1, static=static)},
        )


class _nothing:  # noqa: N801
    def __enter__(self): ...
    def __exit__(self, *_): ...


@pytest.mark.parametrize("seed", range(6))
def test_without_friction_it_is_aba(seed):
    model = random_tree(seed, 7)
    q, v, u = random_states(model, seed, 5)
    scene = pf.Scene(model=model)
    data = model.createData()
    for i in range(5):
        instant = pf.forward_dynamics(scene, q[i], v[i], u[i])
        assert_allclose(instant.a, pin.aba(model, data, q[i], v[i], u[i]), rtol=1e-9)
        assert instant.modes.shape == instant.friction.shape == (0,)
        assert instant.wrench.shape == (0, 6)


@pytest.mark.parametrize("seed", range(24))
def test_inverse_dynamics_gives_the_efforts_back(seed):
    joints = 1 + seed % 8 if seed < 20 else 24
    model = random_tree(seed, joints)
    model.armature = np.linspace(0, 0.2, model.nv)
    friction = gentle(random_friction(model, seed))
    friction = {name: f for i, (name, f) in enumerate(friction.items()) if (i + seed) % 4}
    scene = pf.Scene(model=model, friction=friction)
    rng = np.random.default_rng(seed)
    q, v, u = random_states(model, seed, 4)
    u *= 3
    v[2:][rng.random((2, model.nv)) < 0.5] = 0.0
    if joints == 24:
        v[2:] = np.where(np.arange(24) < 5, 0.0, rng.normal(size=(2, 24)))
    for i in range(4):
        instant = pf.forward_dynamics(scene, q[i], v[i], u[i])
        inverse = pf.inverse_dynamics(scene, q[i], v[i], instant.a)
        scale = max(1.0, np.abs(inverse.effort_frictionless).max())
        assert (inverse.effort_lower[0] - u[i]).max() < 1e-9 * scale
        assert (u[i] - inverse.effort_upper[0]).max() < 1e-9 * scale
        slides = np.ones(model.nv, bool)
        slides[scene.site_tables.velocity_index[inverse.sticking[0]]] = False
        assert_allclose(inverse.effort_lower[0][slides], u[i][slides], atol=1e-9 * scale)
        if inverse.wrench is not None:
            assert_allclose(instant.wrench, inverse.wrench[0], atol=1e-9 * scale)
        assert_allclose(instant.normal_load, inverse.normal_load[0], atol=1e-9 * scale)
        # the friction itself closes the balance, sticking or not
        total = u[i].copy()
        t = scene.site_tables
        np.add.at(total, t.velocity_index, t.ratio * instant.friction)
        assert_allclose(total, inverse.effort_frictionless[0], atol=1e-9 * scale)
        assert (instant.a[t.velocity_index[instant.modes == 0]] == 0.0).all()


def test_wrenches_from_outside_act():
    model = random_tree(4, 5)
    q, v, u = random_states(model, 4, 1)
    frame = model.addFrame(pin.Frame("tool", 4, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    wrench = np.array([3.0, -1, 2, 0.5, 1, -2])
    scene = pf.Scene(model=model)
    instant = pf.forward_dynamics(scene, q[0], v[0], u[0], {"tool": wrench})
    forces = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
    forces[4] = model.frames[frame].placement.act(pin.Force(wrench))
    expected = pin.aba(model, model.createData(), q[0], v[0], u[0], forces)
    assert_allclose(instant.a, expected, rtol=1e-9)
    again = pf.forward_dynamics(scene, q[0], v[0], u[0])  # nothing stays behind
    plain = pin.aba(model, model.createData(), q[0], v[0], u[0])
    assert_allclose(again.a, plain, rtol=1e-9)


def test_a_floating_base_and_continuous_joints():
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, pin.Inertia.Random(), pin.SE3.Identity())
    wheel = model.addJoint(base, pin.JointModelRUBX(), pin.SE3.Random(), "wheel")
    model.appendBodyToJoint(wheel, pin.Inertia.Random(), pin.SE3.Identity())
    scene = pf.Scene(
        model=model,
        friction={"wheel": pin_friction(0.1, 0.02, static=0.2, length=0.1)},
    )
    q, v, u = random_states(model, 1, 3)
    for i in range(3):
        instant = pf.forward_dynamics(scene, q[i], v[i], u[i])
        inverse = pf.inverse_dynamics(scene, q[i], v[i], instant.a)
        assert_allclose(inverse.effort_lower[0], u[i], atol=1e-9)
    with pytest.warns(pf.PinfricWarning, match="manifold"):
        pf.forward_dynamics(scene, 1.5 * q[0], v[0], u[0])


def mimic_scene(static: float = 0.3) -> pf.Scene:
    """Two fingers, the second mimics the first backwards at 0.7; friction in both."""
    fingers = ((f"finger_{k}", pin.JointModelPX(), pin.Inertia.Random()) for k in (1, 2))
    model = pin.transformJointIntoMimic(chain(*fingers, beside=True), 1, 2, -0.7, 0.1)
    entry = {
        "coulomb": {
            "positive": {"static": static + 1, "kinetic": static + 0.5},
            "negative": {"static": static, "kinetic": static},
        }
    }
    return pf.Scene(model=model, friction={"finger_1": entry, "finger_2": entry})


def test_mimic_joints_share_one_coordinate():
    scene = mimic_scene()
    # forward: 1.3 at the leader, and 0.7 x 0.3 of the follower, which moves backward
    limit, kinetic = 1.3 + 0.7 * 0.3, 0.8 + 0.7 * 0.3
    held = pf.forward_dynamics(scene, [0.0], [0.0], [0.999999 * limit])
    assert held.modes.tolist() == [0, 0]
    assert held.a[0] == 0.0
    assert_allclose(held.friction, [-1.3, 0.3], rtol=1e-5)
    freed = pf.forward_dynamics(scene, [0.0], [0.0], [1.000001 * limit])
    assert freed.modes.tolist() == [1, -1]
    assert_allclose(freed.friction, [-0.8, 0.3], rtol=1e-12)
    inverse = pf.inverse_dynamics(scene, [0.0], [1e-3], freed.a)
    assert inverse.effort_lower[0, 0] == pytest.approx(1.000001 * limit, rel=1e-12)
    assert freed.a[0] > 0
    assert kinetic < limit


@pytest.mark.parametrize("sign", [1, -1])
def test_a_block_on_an_incline_starts_at_the_static_threshold(sign):
    mu = 0.35
    for eps, modes in ((-1e-9, [0]), (1e-9, [sign])):
        angle = np.arctan(mu * (1 + eps))
        scene = sliding_block(plane_friction(mu, 0.3), sign * angle)
        instant = pf.forward_dynamics(scene, [0.0], [0.0], [0.0])
        assert instant.modes.tolist() == modes
        if modes != [0]:
            expected = sign * G * (np.sin(angle) - 0.3 * np.cos(angle))
            assert instant.a[0] == pytest.approx(expected, rel=1e-12)


def test_a_sliding_block_speeds_up_or_slows_down_at_the_kinetic_threshold():
    mu = 0.3
    for eps in (-1e-3, 1e-3):
        angle = np.arctan(mu * (1 + eps))
        scene = sliding_block(plane_friction(0.35, mu), angle)
        down = pf.forward_dynamics(scene, [0.0], [1.0], [0.0]).a[0]
        up = pf.forward_dynamics(scene, [0.0], [-1.0], [0.0]).a[0]
        assert np.sign(down) == np.sign(eps)
        assert down == pytest.approx(G * (np.sin(angle) - mu * np.cos(angle)), rel=1e-9)
        assert up == pytest.approx(G * (np.sin(angle) + mu * np.cos(angle)), rel=1e-12)


def test_held_between_the_two_limits_stick_has_priority():
    angle = np.arctan(0.32)  # above kinetic 0.3, below static 0.35: both are consistent
    scene = sliding_block(plane_friction(0.35, 0.3), angle)
    assert pf.forward_dynamics(scene, [0.0], [0.0], [0.0]).modes.tolist() == [0]


def test_at_rest_a_stribeck_law_starts_from_its_static_value():
    friction = plane_friction(0.35, 0.3, stribeck={"velocity": 0.1})
    angle = np.arctan(0.36)
    scene = sliding_block(friction, angle)
    instant = pf.forward_dynamics(scene, [0.0], [0.0], [0.0])
    expected = G * (np.sin(angle) - 0.35 * np.cos(angle))
    assert instant.a[0] == pytest.approx(expected, rel=1e-10)


def test_viscous_friction_alone_never_sticks():
    scene = sliding_block({"viscous": 2.0}, 1e-8)
    assert pf.forward_dynamics(scene, [0.0], [0.0], [0.0]).a[0] == pytest.approx(G * 1e-8)
    moving = pf.forward_dynamics(scene, [0.0], [3.0], [0.0])
    assert moving.a[0] == pytest.approx(G * 1e-8 - 3.0)
    assert moving.friction[0] == pytest.approx(-6.0)


def test_below_its_stick_velocity_a_joint_sticks():
    friction = plane_friction(0.35, 0.3, stick_velocity=1e-3)
    scene = sliding_block(friction, 0.1)
    assert pf.forward_dynamics(scene, [0.0], [1e-3], [0.0]).modes.tolist() == [0]
    assert pf.forward_dynamics(scene, [0.0], [1.001e-3], [0.0]).modes.tolist() == [1]


@pytest.mark.parametrize("b", [0.3, 0.9, 1 - 1e-6])
def test_a_spinning_body_slows_down_by_the_closed_form(b):
    """J a = -b J |(a, v^2)| gives |a| = v^2 b / sqrt(1 - b^2)."""
    instant = pf.forward_dynamics(pinned_body(b), [0.4], [2.0], [0.0])
    assert instant.a[0] == pytest.approx(-4 * b / np.sqrt(1 - b**2), rel=1e-9)
    assert instant.contraction == pytest.approx(b, rel=1e-12)


@pytest.mark.parametrize("b", [1 + 1e-9, 1.2, 8.0])
def test_beyond_the_critical_radius_no_acceleration_is_consistent(b):
    with pytest.raises(NoConsistentAcceleration, match=r"'pin': 0 in 1 mode .*contr") as error:
        pf.forward_dynamics(pinned_body(b), [0.4], [2.0], [0.0])
    assert (error.value.q, error.value.v, error.value.site) == ([0.4], [2.0], "pin")
    assert error.value.time is None


def test_at_the_critical_radius_the_one_acceleration_found_may_not_be_the_only_one():
    says = r"ended undecided.*'pin': 1 in 1 mode tried, others are not ruled out; .*contraction 1\)"
    with pytest.raises(UndecidedAcceleration, match=says):
        pf.forward_dynamics(pinned_body(1.0), [0.4], [2.0], [9.0])


def test_beyond_it_a_torque_has_no_solution_or_two_from_a_threshold_on():
    """b |(a, v^2)| + a = u/J: none below v^2 sqrt(b^2 - 1), two above."""
    b, v = 1.5, 2.0
    threshold = v**2 * np.sqrt(b**2 - 1)
    with pytest.raises(NoConsistentAcceleration):
        pf.forward_dynamics(pinned_body(b), [0.4], [v], [threshold * (1 - 1e-6)])
    with pytest.raises(AmbiguousAcceleration, match=r"several.*: 2 in 1 mode .*less friction"):
        pf.forward_dynamics(pinned_body(b), [0.4], [v], [threshold * (1 + 1e-6)])


def test_wrenches_from_outside_that_name_no_frame_are_refused_in_one_line():
    """NumPy's error on the truth value of an array had been raised."""
    scene = pf.load_scene("pendulum")
    with pytest.raises(pf.PinfricError, match="external: should be a mapping"):
        pf.forward_dynamics(scene, [0.0], [0.0], [0.0], external=np.ones(6))
    with pytest.raises(pf.PinfricError, match="external: should be a mapping"):
        pf.holds(scene, [0.0], [0.0], external=np.ones(6))


def test_at_rest_a_body_without_load_is_held_by_the_load_of_its_own_drive():
    """No gravity: the pin's load is m l |a|, 0 at rest, so any effort moves the body."""
    instant = pf.forward_dynamics(pinned_body(0.5), [0.0], [0.0], [1.0])
    assert instant.a[0] == pytest.approx(1.0 / 1.5, rel=1e-12)  # J a = u - b J |a|
    with pytest.raises(NoConsistentAcceleration):  # static < kinetic cannot be entered; b > 1 can
        pf.forward_dynamics(pinned_body(1.5), [0.0], [1.0], [0.0])


def test_a_guide_without_width_refuses_a_roll_moment():
    with pytest.raises(RollMomentError):
        pf.forward_dynamics(guided(0.1), [0.0], [1.0], [0.0])


def many_blocks(n: int, mu: float = 0.3) -> tuple[pf.Scene, np.ndarray]:
    """n independent blocks on planes of rising slope; those above atan(mu) slip."""
    model = pin.Model()
    angles = np.linspace(0.05, 0.55, n)
    for i, angle in enumerate(angles):
        tilted = pin.SE3(pin.rpy.rpyToMatrix(0.0, angle, 0.0), np.zeros(3))
        joint = model.addJoint(0, pin.JointModelPX(), tilted, f"block_{i}")
        body = lump(1.0 + i)
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    names = list(model.names)[1:]
    return pf.Scene(model=model, friction={n: plane_friction(mu, mu) for n in names}), angles


@pytest.mark.parametrize("n", [3, 8, 12])
def test_each_of_many_blocks_slips_where_its_slope_is_too_steep(n):
    scene, angles = many_blocks(n)
    instant = pf.forward_dynamics(scene, np.zeros(n), np.zeros(n), np.zeros(n))
    slips = np.tan(angles) > 0.3
    assert instant.modes.tolist() == slips.astype(int).tolist()
    expected = np.where(slips, G * (np.sin(angles) - 0.3 * np.cos(angles)), 0.0)
    assert_allclose(instant.a, expected, rtol=1e-10)


def test_payloads_count_where_they_are_attached():
    payload = {"link": "universe", "mass": 1.0, "com": [0, 0, 0]}
    model = block(0.5)
    model.addBodyFrame("body", 1, pin.SE3.Identity(), 0)
    payload["link"] = "body"
    scene = pf.Scene(model=model, payloads={"box": payload})
    with_box = pf.forward_dynamics(scene, [0.0], [0.0], [6.0]).a[0]
    without = pf.forward_dynamics(scene, [0.0], [0.0], [6.0], attached=[]).a[0]
    assert with_box == pytest.approx(G * np.sin(0.5) + 6 / 3)
    assert without == pytest.approx(G * np.sin(0.5) + 6 / 2)
    # a generator can be read once; the second call would use the workspace that it left behind
    bare = pf.Scene(model=model, payloads={"box": payload | {"attached": False}})
    for attached in ((name for name in ["box"]), ["box"], "box"):
        assert pf.forward_dynamics(bare, [0.0], [0.0], [6.0], attached=attached).a[0] == with_box
        solver = bare.solver(attached if attached != "box" else iter(["box"]))
    assert solver.forward([0.0], [0.0], [6.0]).a[0] == with_box
    assert bare.solver("box").forward([0.0], [0.0], [6.0]).a[0] == with_box
    moved = pf.simulate(bare, [0.0], [0.0], [6.0], 0.1, attached=iter(["box"]))
    assert moved.a[-1, 0] == pytest.approx(with_box)
    assert moved.carried == ("box",)


WRONG = r"""
q=[0.0, 1.0]     q: shape \(2,\); should be \(1,\)
v=[[0.0]]        v: shape
effort=[]        effort: shape
effort=["a"]     effort: is not an array
effort=[1j]      effort: is not an array
q=[0j]           q: is not an array
v=[None]         v: is not an array
q=[np.nan]       q: column 0 is nan
v=[np.inf]       v: column 0 is inf
effort=[np.nan]  effort: column 0 is nan
"""


@pytest.mark.parametrize(("change", "message"), table(WRONG, arguments, str))
@pytest.mark.parametrize("friction", [{}, {"slide": plane_friction(0.35, 0.3)}])
def test_bad_input(change, message, friction):
    scene = pf.Scene(model=block(0.5), friction=friction)
    with pytest.raises(StateError, match=message):
        pf.forward_dynamics(scene, **{"q": [0.0], "v": [0.0], "effort": [0.0]} | change)


def test_a_joint_that_moves_no_mass_is_an_error():
    model = chain(("slide", pin.JointModelPX()))
    with pytest.raises(SceneError, match="slide moves no mass"):
        pf.forward_dynamics(pf.Scene(model=model), [0.0], [0.0], [1.0])


def test_the_joint_that_moves_no_mass_is_named_among_others():
    away, turn = [0.3, 0.0, 0.0], pin.JointModelRZ()
    bodies = {"first": lump(1.0, away), "second": lump(1.0, away), "third": pin.Inertia.Zero()}
    model = chain(*((name, turn, body, away) for name, body in bodies.items()))
    with pytest.raises(SceneError, match="third moves no mass"):
        pf.forward_dynamics(pf.Scene(model=model), np.zeros(3), np.zeros(3), np.ones(3))


@pytest.mark.parametrize(
    "bearing",
    [
        {"kind": "linear", "preload": 10.0},
        {"kind": "guide", "length": 0.2, "width": 0.1, "preload": 10.0},
    ],
)
def test_a_preload_brakes_with_and_without_other_loads(bearing):
    """m a = u - mu (preload + the weight a guide carries), sliding and breaking away."""
    model = block(mass=2.0)
    friction = {"bearing": bearing, "mu": {"static": 0.5, "kinetic": 0.4}}
    scene = pf.Scene(model=model, friction={"slide": friction})
    load = 10.0 + (2.0 * G if bearing["kind"] == "guide" else 0.0)
    sliding = pf.forward_dynamics(scene, [0.0], [1.0], [0.0])
    assert sliding.a[0] == pytest.approx(-0.4 * load / 2.0)
    assert sliding.friction[0] == pytest.approx(-0.4 * load)
    held = pf.forward_dynamics(scene, [0.0], [0.0], [0.5 * load * (1 - 1e-9)])
    assert held.a[0] == 0.0
    loose = pf.forward_dynamics(scene, [0.0], [0.0], [0.5 * load * (1 + 1e-9)])
    assert loose.a[0] == pytest.approx(0.1 * load / 2.0)


@pytest.mark.parametrize("seed", range(20))
def test_joints_that_nothing_pushes_do_not_accelerate_beside_sticking_ones(seed):
    """Without gravity, at rest, pushed where friction holds alone: M a = 0 exactly."""
    model, rng = random_tree(seed, joints=6), np.random.default_rng(seed)
    model.gravity.linear = np.zeros(3)
    dry = rng.random(6) < 0.5
    names = np.array(model.names)[1:][dry].tolist()
    friction = {name: {"coulomb": {"static": 500.0, "kinetic": 400.0}} for name in names}
    q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv))
    push = np.zeros(model.nv)
    push[[model.joints[model.getJointId(name)].idx_v for name in names]] = rng.uniform(
        -300.0, 300.0, len(names)
    )
    scene = pf.Scene(model, friction=friction)
    found = pf.forward_dynamics(scene, q, np.zeros(model.nv), push)
    assert not found.modes.any()
    assert not found.a.any()


def test_a_batch_is_its_states_one_by_one():
    """Inverse dynamics, which has its own code, gives the motion back."""
    scene = pf.load_scene("ur10_machine_tending")
    rng = np.random.default_rng(3)
    q, v, a = rng.normal(size=(3, 6, scene.model.nv))
    motion = pf.inverse_dynamics(scene, q, v, a)
    batch = pf.forward_dynamics(scene, q, v, motion.effort_lower)
    assert_allclose(batch.a, a, rtol=0, atol=1e-9)
    assert_allclose(batch.wrench, motion.wrench, rtol=0, atol=1e-8)
    assert {len(figure) for figure in batch} == {6}
    assert "6 samples" in repr(batch)
    push = np.arange(36.0).reshape(6, 6)
    pushed = pf.inverse_dynamics(scene, q, v, a, external={"tool0": push})
    both = pf.forward_dynamics(scene, q, v, pushed.effort_lower, {"tool0": push})
    assert_allclose(both.a, a, rtol=0, atol=1e-9)
    one_effort = pf.forward_dynamics(scene, q, v, {})
    assert_array_equal(one_effort.effort, np.zeros((6, 6)))


BATCH = r"""
v=np.ones((2, 1))       v has shape \(2, 1\); q has 3 samples, so v needs 3 rows
v=np.ones(1)            v has shape \(1,\); q has 3 samples
effort=np.ones((2, 1))  effort needs 3 rows
q=np.ones((0, 1))       q has no samples; give at least one state
q=np.ones((3, 2))       sample 0: q: shape \(2,\); should be \(1,\)
v=np.array([[0.0], [1.0], [np.nan]])  sample 2: v: .*should be finite
"""


@pytest.mark.parametrize(("change", "says"), table(BATCH, arguments, str))
def test_a_wrong_batch_names_its_sample(change, says):
    given = {"q": np.ones((3, 1)), "v": np.ones((3, 1)), "effort": np.ones((3, 1))} | change
    with pytest.raises(StateError, match=says):
        pf.forward_dynamics(pf.load_scene("pendulum"), **given)


def two_on_one_mass(others: int) -> pf.Scene:
    """Two sliders that push one mass along x, masses 1 kg, and others beside them, all dry."""
    body = lump(1.0)
    model = chain(("a", pin.JointModelPX(), body), ("b", pin.JointModelPX(), body), gravity=0.0)
    for i in range(others):
        joint = model.addJoint(0, pin.JointModelPY(), pin.SE3.Identity(), f"c{i}")
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    return pf.Scene(model=model, friction=dict.fromkeys(model.names[1:], dry(2.0, 1.0)))


@pytest.mark.parametrize("others", [0, 6, 7, 10, 14])
def test_the_verdict_does_not_depend_on_what_rests_elsewhere(others):
    """By hand: 2.5 N on each breaks away one of two, a = (0, 1.5) or (0.75, 0); 3.5 N only b.

    With a at rest, b moves by (F - 1) / 1, and a holds F - (F - 1) = 1 N less than 2. With b at
    rest, a moves by (F - 1) / 2, and b has to hold F - (F - 1) / 2: 1.75 N of 2.5, 2.25 N of 3.5.
    """
    scene = two_on_one_mass(others)
    still, push = np.zeros(2 + others), np.eye(2 + others)[:2].sum(axis=0)
    with pytest.raises(AmbiguousAcceleration, match="'a': 2 in"):
        pf.forward_dynamics(scene, still, still, 2.5 * push)
    push[2:] = 3.0  # every other one breaks away, too
    found = pf.forward_dynamics(scene, still, still, push * ([3.5, 3.5] + [1.0] * others))
    assert_allclose(found.a, [0.0, 2.5] + [2.0] * others, atol=1e-12)
    assert found.answers == 1


@pytest.mark.parametrize("neighbours", ["loops", "locking gears"])
def test_neither_loops_nor_locking_gears_nearby_change_the_verdict(neighbours):
    """Beside three four-bars (twelve pins), or eight locking gears: as the two sliders alone."""
    two, (bars, angles) = two_on_one_mass(0), four_bar(static=0.4, gravity=(0.0, 0.0, 0.0))
    if neighbours == "loops":
        scene = beside(two, *[bars] * 3)
        q = np.concatenate([np.zeros(2), *[bars.close(angles(np.array([1.0, 0.3, 1.2])))] * 3])
        others, given = [0.5, 9.0, 0.5], "effort"
    else:
        body = chain(*((f"c{i}", pin.JointModelPX(), lump(1.0)) for i in range(8)), beside=True)
        gear = {"efficiency": 0.4, "back_efficiency": -0.2, "rotor_inertia": 0.1, "ratio": 1.0}
        drives = [{"joint": f"c{i}", "transmission": gear} for i in range(8)]
        scene = beside(
            two.with_(actuators=[{"joint": x, "transmission": {"ratio": 1.0}} for x in "ab"]),
            pf.Scene(
                model=body, friction={f"c{i}": dry(2.0, 1.0) for i in range(8)}, actuators=drives
            ),
        )
        q, others, given = np.zeros(10), [1.0] * 8, "motor_torque"
    still = np.zeros(scene.model.nv)
    with pytest.raises(AmbiguousAcceleration, match="'a_0': 2 in"):
        pf.forward_dynamics(scene, q, still, **{given: np.array([2.5, 2.5, *others])})
    found = pf.forward_dynamics(scene, q, still, **{given: np.array([3.5, 3.5, *others])})
    assert_allclose(found.a[:2], [0.0, 2.5], atol=1e-12)
    assert found.answers == 1
    if neighbours == "loops":
        held, moved = (pf.forward_dynamics(bars, q[2:5], still[:3], [u]).a for u in (0.5, 9.0))
        assert_array_equal(found.a[2:], [*held, *moved, *held])
        assert moved.any()


@pytest.mark.parametrize(("static", "seed"), [(1.0, 3), (1.3, 3), (1.3, 4), (1.3, 17)])
def test_more_joints_than_are_enumerated_have_the_fewest_slips(static, seed, monkeypatch):
    """Ten sliders in a chain, against every set of them that may slip."""
    n, body = 10, lump(1.0)
    links = [(f"s{i}", pin.JointModelPX(), body) for i in range(n)]
    scene = pf.Scene(
        model=chain(*links, gravity=0.0),
        friction={name: dry(static, 1.0) for name, *_ in links},
    )
    push, still = np.random.default_rng(seed).normal(scale=1.2, size=n), np.zeros(n)
    R = np.linalg.inv(pin.crba(scene.model, scene.model.createData(), push))
    answers = fewest_slips(R, R @ push, np.full(n, static), np.ones(n))
    if len(answers) > 1:
        with pytest.raises(AmbiguousAcceleration, match=f"{len(answers)} in .* of 59049"):
            pf.forward_dynamics(scene, still, still, push)
        return
    found = pf.forward_dynamics(scene, still, still, push)
    assert_allclose(found.friction, answers[0], atol=1e-6)
    assert (found.answers, found.a.any()) == (1, True)
    monkeypatch.setattr(search, "_in_tree", lambda *_: None)  # without a proof
    found = pf.forward_dynamics(scene, still, still, push)
    assert found.answers == 0
    assert "others may exist" in repr(found)
    assert pf.forward_dynamics(scene, still, still, 0.1 * push).answers == 1  # none breaks away
