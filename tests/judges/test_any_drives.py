"""Scenes with fewer or more drives than freedoms: judged by closed forms, ABA, lstsq, power."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump, random_friction, random_states, random_tree, row
from judges.verdict import judge
from mechanisms import add_link, bar, four_bar, grounded_model, pin_friction, shifted
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.inverse.effort_maps import share_work
from pinfric.dynamics.problem.plan import make_inverse_plan
from pinfric.dynamics.samples.closure import working_rates
from pinfric.errors import SceneError, SimulationError, StateError, UndrivenMotionError

CART, POLE, LENGTH = 2.0, 0.5, 0.6
ARM = POLE * LENGTH / 2  # first moment about the pin
INERTIA = POLE * LENGTH**2 / 3
G = 9.81
RUBS = {
    "cart": dry(0.3, 0.2, viscous=0.1),
    "pole": dry(0.02, 0.01),
}


def cart_pole(friction=RUBS, actuators=({"joint": "cart"},)):
    """A cart on a level rail and a slender bar pinned to it; its angle is from the rail."""
    model = grounded_model()
    cart = pin.Inertia(CART, np.zeros(3), np.zeros((3, 3)))
    joint = add_link(model, 0, pin.JointModelPX(), pin.SE3.Identity(), "cart", cart)
    thin = pin.Inertia(POLE, np.array([LENGTH / 2, 0, 0]), np.diag([0, 1, 1]) * INERTIA / 4)
    add_link(model, joint, pin.JointModelRZ(), pin.SE3.Identity(), "pole", thin)
    return pf.Scene(model=model, friction=friction, actuators=actuators)


def boom(share=None, bucket=False, friction=None):
    """A bar that a motor at its pin and a cylinder raise together; a bucket hangs from its end."""
    model = grounded_model()
    arm = add_link(model, 0, pin.JointModelRZ(), pin.SE3.Identity(), "boom", bar(2.0, 1.0))
    if bucket:
        at = shifted(1.0)
        add_link(model, arm, pin.JointModelRZ(), at, "bucket", bar(0.7, 0.3))
    given = [{"share": w} for w in share] if share is not None else [{}, {}]
    ram = {
        "name": "ram",
        "a": {"link": "ground", "xyz": [0.3, -0.4, 0]},
        "b": {"link": "boom", "xyz": [0.6, 0, 0]},
    }
    drives = [{"joint": "boom", **given[0]}, {"cylinder": ram, **given[1]}]
    return pf.Scene(model=model, actuators=drives, friction=friction or {})


def ram_lever(angle):
    """Rate of the ram's length per rad of the boom: (b - a) . (z x b) / |b - a|."""
    b = 0.6 * np.array([np.cos(angle), np.sin(angle)])
    way = b - [0.3, -0.4]
    return way @ [-b[1], b[0]] / np.linalg.norm(way)


def power_left(scene, q, v, effort, found):
    """Power of drives and friction less that of motion and height, and the larger of the two."""
    moved = v @ pin.rnea(scene.model, scene.model.createData(), q, v, found.a)
    drives, sites = (rates[0] for rates in working_rates(scene, q[None], v[None]))
    given = drives @ np.asarray(effort) + sites @ found.friction
    return abs(given - moved), max(abs(given), abs(moved), 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_cart_pole_accelerates_as_written_by_hand(seed):
    """(M + m) x'' - m c sin w' = u + X + m c cos w^2, J w' - m c sin x'' = T - m g c cos."""
    scene, rng = cart_pole(), np.random.default_rng(seed)
    q, v, u = rng.normal(size=2), rng.normal(size=2), rng.normal()
    sine, cosine = np.sin(q[1]), np.cos(q[1])
    slide = -0.2 * np.sign(v[0]) - 0.1 * v[0]
    turn = -0.01 * np.sign(v[1])
    M = [[CART + POLE, -ARM * sine], [-ARM * sine, INERTIA]]
    by_hand = np.linalg.solve(M, [u + slide + ARM * cosine * v[1] ** 2, turn - ARM * G * cosine])
    for found in (pf.forward_dynamics(scene, q, v, [u]), scene.solver().forward(q, v, [u])):
        assert_allclose(found.a, by_hand, rtol=1e-12)
    left, size = power_left(scene, q, v, [u], found)
    assert left <= 1e-12 * size
    back = pf.inverse_dynamics(scene, q, v, by_hand)
    assert_allclose(back.effort_lower, [[u]], rtol=1e-9, atol=1e-12)
    assert back.effort_upper == pytest.approx(back.effort_lower)
    assert judge(back).passed()
    assert_array_equal(scene.solver().inverse(q, v, by_hand).effort_lower, back.effort_lower[0])


@pytest.mark.parametrize("seed", range(6))
def test_a_tree_with_some_drives_goes_there_and_back(seed):
    model = random_tree(seed)
    rng = np.random.default_rng(seed)
    driven = sorted(rng.choice(6, size=seed, replace=False))
    actuators = [{"joint": f"joint_{j + 1}"} for j in driven]
    (q,), (v,), _ = random_states(model, seed, 1)
    u, tau = rng.normal(size=seed) * 5.0, np.zeros(6)
    tau[driven] = u
    plain = pf.Scene(model=model, actuators=actuators)
    aba = pin.aba(model, model.createData(), q, v, tau)
    assert_allclose(pf.forward_dynamics(plain, q, v, u).a, aba, rtol=1e-9, atol=1e-9)
    light = {"mu": {"static": 0.03, "kinetic": 0.02}}  # no joint jams
    friction = {name: {**f, **light} for name, f in random_friction(model, seed).items()}
    scene = plain.with_(friction=friction)
    found = pf.forward_dynamics(scene, q, v, u)
    left, size = power_left(scene, q, v, u, found)
    assert left <= 1e-10 * size
    back = pf.inverse_dynamics(scene, q, v, found.a)
    assert_allclose(back.effort_lower, u[None], rtol=1e-9, atol=1e-9)
    assert judge(back).passed()
    assert back.actuator_velocity.tolist() == [v[driven].tolist()]


def test_a_motion_that_an_undriven_joint_does_not_do_is_refused_with_joint_sample_and_effort():
    scene = cart_pole()
    q, v = np.array([[0.0, -np.pi / 2]] * 3), np.zeros((3, 2))
    a = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    # hanging: the cart's acceleration takes m c x'' at the pole; static friction holds 0.02
    taken = 2.0 * ARM - 0.02
    with pytest.raises(UndrivenMotionError, match=r"1 for 2 .* undriven: pole") as said:
        pf.inverse_dynamics(scene, q, v, a)
    assert (said.value.joint, said.value.sample) == ("pole", 2)
    assert said.value.effort == pytest.approx(taken, rel=1e-9)
    assert pf.inverse_dynamics(scene, q[:1], v[:1], a[:1]).effort_upper[0, 0] == 0.3


def test_all_joints_without_a_drive_that_need_one_are_named_in_one_line():
    scene = chain_of_three()
    zero = np.zeros(3)
    with pytest.raises(UndrivenMotionError, match=r"1 for 3 .*; add drives for them") as said:
        pf.inverse_dynamics(scene, zero, zero, zero)
    assert {said.value.joint, *said.value.others} == {"b", "c"}
    assert len(said.value.others) == 1
    assert "\n" not in str(said.value)


def chain_of_three():
    """Three level links one after the other; only the first has a drive."""
    return pf.Scene(row("abc", lump(1.0, [0.2, 0.0, 0.0]), 0.4), actuators=[{"joint": "a"}])


@pytest.mark.parametrize("digits", [16, 4])
def test_a_pole_that_hangs_without_friction_needs_no_drive_whatever_its_digits(digits):
    q = np.array([0.0, round(-np.pi / 2, digits)])
    assert pf.inverse_dynamics(cart_pole({}), q, np.zeros(2), np.zeros(2)).effort_upper == 0.0


def test_a_pole_swung_without_gravity_needs_no_drive_whatever_its_digits():
    """Rounding is measured by inertia forces, too, not by weights alone."""
    scene = cart_pole({}).with_(gravity=np.zeros(3))
    q, v = np.array([0.0, 0.4]), np.array([0.5, 3.0])
    a = pf.forward_dynamics(scene, q, v, np.array([5.0])).a
    found = pf.inverse_dynamics(scene, q, v, a.round(6))
    assert_allclose(found.effort_lower, [[5.0]], rtol=1e-6)
    with pytest.raises(UndrivenMotionError, match="pole"):
        pf.inverse_dynamics(scene, q, v, a.round(2))


def test_friction_at_rest_of_an_undriven_joint_is_what_balances_it():
    held = {"pole": dry(2.0, 1.0)}
    scene = cart_pole(held)
    q, still = np.array([0.0, 0.3]), np.zeros(2)
    found = pf.inverse_dynamics(scene, q, still, still)
    torque = ARM * G * np.cos(0.3)
    assert_allclose([found.friction_lower, found.friction_upper], torque, rtol=1e-12)
    assert judge(found).passed()
    assert pf.holds(scene, q, [0.0]).held
    assert pf.holds(scene, q, [0.0]).use == pytest.approx(torque / 2.0)
    assert not pf.holds(cart_pole(), q, [0.0]).held


@pytest.mark.slow
def test_a_simulated_cart_pole_takes_the_effort_it_was_given():
    scene = cart_pole()
    motion = pf.simulate(scene, [0.0, 0.4], [0.1, 0.2], [0.5], 0.3)
    found = pf.inverse_dynamics(scene, motion)
    inside = (found.effort_lower - 1e-9 <= 0.5) & (found.effort_upper + 1e-9 >= 0.5)
    assert inside.all()
    assert judge(found).passed()


def test_a_mechanism_without_drives_keeps_its_energy():
    scene = four_bar()[0].with_(actuators=[], friction={})
    q = scene.close(np.array([0.5, 1.0, 0.5]))
    motion = pf.simulate(scene, q, np.zeros(3), [], 0.2, rtol=1e-9)
    data = scene.model.createData()
    energy = [
        pin.computeMechanicalEnergy(scene.model, data, *s)
        for s in zip(motion.q, motion.v, strict=True)
    ]
    kinetic = pin.computeKineticEnergy(scene.model, data, motion.q[-1], motion.v[-1])
    assert kinetic > 0.1
    assert_allclose(energy, energy[0], atol=1e-7 * kinetic)
    assert motion.summary().empty
    found = pf.inverse_dynamics(scene, motion)
    assert found.summary().empty
    with pytest.raises(StateError, match="has no drives"):
        found.plot()


@pytest.mark.parametrize("still", [False, True])
def test_a_passive_loop_goes_there_and_back(still):
    scene = four_bar()[0].with_(actuators=[])
    q = scene.close(np.array([0.5, 1.0, 0.5]))
    v = pf.consistent_motion(scene, q[None], ["O"], [[1.0 - still]], [[0.0]])[0][0]
    found = pf.forward_dynamics(scene, q, v, [])
    left, size = power_left(scene, q, v, [], found)
    assert left <= 1e-10 * size
    back = pf.inverse_dynamics(scene, q, v, found.a)
    assert judge(back).passed()
    assert back.interval_exact[0] != still
    faster = found.a + pf.consistent_motion(scene, q[None], ["O"], [[1.0]], [[0.0]])[0][0]
    with pytest.raises(UndrivenMotionError, match="0 for 1 degree of freedom; undriven: "):
        pf.inverse_dynamics(scene, q, v, faster)


def test_a_hanging_bucket_lets_the_boom_be_computed_at_rest_and_says_it_is_a_bound():
    scene = boom(
        (1.0, 1.0),
        bucket=True,
        friction={
            "boom": dry(0.5, 0.4),
            "bucket": pin_friction(0.1, radius=0.02, static=0.2),
        },
    )
    q = np.array([0.4, -np.pi / 2 - 0.4])
    found = pf.inverse_dynamics(scene, q, np.zeros(2), np.zeros(2))
    assert not found.interval_exact[0]
    assert judge(found).passed()
    torque = 2.0 * G * 0.5 * np.cos(0.4) + 0.7 * G * np.cos(0.4)
    part = 1.0 / (1.0 + ram_lever(0.4) ** 2)
    middle = (found.effort_lower + found.effort_upper) / 2
    assert_allclose(middle[0, 0], part * torque, rtol=1e-9)


def test_two_motors_on_one_joint_share_as_stated():
    one = cart_pole(actuators=None)
    drives = [
        {"joint": "cart", "name": "left", "share": 30},
        {"joint": "pole"},
        {"joint": "cart", "name": "right", "share": 70},
    ]
    two = one.with_(actuators=drives)
    assert two.actuator_names == ("left", "right", "pole")
    q, v, a = np.array([0.0, 0.3]), np.array([0.0, 0.5]), np.array([1.0, -2.0])  # the cart rests
    whole, found = pf.inverse_dynamics(one, q, v, a), pf.inverse_dynamics(two, q, v, a)
    for name in ("effort_lower", "effort_upper", "effort_frictionless"):
        cart, pole = getattr(whole, name)[0]
        assert_allclose(getattr(found, name)[0], [0.3 * cart, 0.7 * cart, pole])
    assert found.effort_lower[0, 0] < found.effort_upper[0, 0]
    assert judge(found).passed()
    v[0] = 0.4
    effort = pf.inverse_dynamics(two, q, v, a).effort_lower[0]
    assert_allclose(pf.forward_dynamics(two, q, v, effort).a, a, rtol=1e-12)
    left, size = power_left(two, q, v, effort, pf.forward_dynamics(two, q, v, effort))
    assert left <= 1e-12 * size
    unsaid = one.with_(actuators=[*drives[:2], {**drives[2], "share": None}])
    assert_allclose(pf.forward_dynamics(unsaid, q, v, effort).a, a, rtol=1e-12)
    for ask in (unsaid.solver().inverse, lambda *s: pf.inverse_dynamics(unsaid, *s)):
        with pytest.raises(SceneError, match="a `share`, or keep only 1 of left, r"):
            ask(q, v, a)


def test_a_cylinder_and_a_motor_on_one_joint_share_by_their_levers():
    """s1 = 1, s2 = dL/dq: u_d = w_d s_d tau / sum(w s^2) makes the sum of u^2 / w least."""
    angle, a, shares = 0.4, 1.3, np.array([2.0, 5.0])
    tau = 2.0 / 3 * a + 2.0 * G * 0.5 * np.cos(angle)
    levers = np.array([1.0, ram_lever(angle)])
    by_hand = shares * levers * tau / (shares @ levers**2)
    found = pf.inverse_dynamics(boom(shares), [angle], [0.7], [a])
    assert_allclose(found.effort_lower[0], by_hand, rtol=1e-12)
    assert judge(found).passed()
    rubs = {"boom": dry(3.0, 2.0)}
    rest = pf.inverse_dynamics(boom(shares, friction=rubs), [angle], [0.0], [a])
    for end, side in ((rest.effort_lower, -3.0), (rest.effort_upper, 3.0)):
        assert_allclose(end[0], by_hand * (1.0 + side / tau), rtol=1e-12)
    back = pf.forward_dynamics(boom(), np.array([angle]), np.array([0.7]), by_hand)
    assert_allclose(back.a, [a], rtol=1e-12)


@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
def test_three_motors_of_a_four_bar_are_what_lstsq_makes_of_one_freedom(kind):
    shares = np.array([1.0, 3.0, 0.5])
    drives = [{"joint": joint, "share": w} for joint, w in zip("OAC", shares, strict=True)]
    scene = four_bar(kind=kind)[0].with_(actuators=drives)
    q = scene.close(np.array([0.5, 1.0, 0.5]))
    v, a = pf.consistent_motion(scene, q[None], ["O"], [[1.0]], [[0.3]])
    found = pf.inverse_dynamics(scene, q, v, a)
    assert found.redundant == (kind == "revolute")
    assert judge(found).passed()
    # along the one motion v the loop does no work, and friction takes the rest
    order = [scene.joint_names.index(drive["joint"]) for drive in drives]
    rates = v[0, order]
    tau = v[0] @ pin.rnea(scene.model, scene.model.createData(), q, v[0], a[0])
    root = np.sqrt(shares)
    free = root * np.linalg.lstsq((rates * root)[None], [tau], rcond=None)[0]
    assert_allclose(found.effort_frictionless[0], free, rtol=1e-9)
    lost = working_rates(scene, q[None], v)[1][0] @ found.friction_lower[0]
    with_friction = root * np.linalg.lstsq((rates * root)[None], [tau - lost], rcond=None)[0]
    assert_allclose(found.effort_lower[0], with_friction, rtol=1e-9)
    back = pf.forward_dynamics(scene, q, v[0], found.effort_lower[0])
    assert_allclose(back.a, a[0], rtol=1e-9, atol=1e-9)


def test_what_sharing_leaves_free_moves_no_drive_in_any_basis():
    """Shares of work mixed with redundant reactions: each is solved in its own space."""
    drives = [{"joint": joint, "share": w} for joint, w in zip("OAC", (1, 3, 0.5), strict=True)]
    plan = make_inverse_plan(four_bar(kind="revolute")[0].with_(actuators=drives))
    tables = plan.drives
    chance = np.random.default_rng(1)
    ny, nv = 6, 3
    J, y, total = (chance.normal(size=shape) for shape in ((ny, nv), (ny, 2), nv))
    by_y = -tables.delivery @ J.T  # of the drives' efforts
    still = np.linalg.svd(by_y)[2][3:].T
    moving = chance.normal(size=(ny, tables.shifts))
    free = np.hstack((moving, still)) @ chance.normal(size=(tables.shifts + still.shape[1],) * 2)
    left = np.empty((ny, free.shape[1] - tables.shifts))
    assert share_work(tables, plan.entries, total, J, free, y, left)
    assert_allclose(by_y @ left, 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(left) == still.shape[1]
    effort = by_y @ y[:, 0] + tables.delivery @ total
    assert_allclose((by_y @ moving).T @ (tables.cost * effort), 0.0, atol=1e-12)


def test_two_motors_at_the_joint_that_closes_a_loop():
    drives = [{"joint": "B", "name": n, "share": w} for n, w in (("one", 1.0), ("two", 4.0))]
    scene = four_bar(cut="B", kind="revolute")[0]
    single, double = (scene.with_(actuators=x) for x in ([{"joint": "B"}], drives))
    q = scene.close(np.array([0.5, 1.0, 0.5]))
    v, a = pf.consistent_motion(scene, q[None], ["O"], [[1.0]], [[0.3]])
    whole, found = (pf.inverse_dynamics(s, q, v, a) for s in (single, double))
    assert_allclose(found.effort_lower, whole.effort_lower * [0.2, 0.8], rtol=1e-9)
    assert judge(found).passed()


@pytest.mark.parametrize(
    ("actuators", "says"),
    [
        ([{"joint": "cart"}, {"joint": "cart"}], "'cart' is listed twice; .* need a `name` each"),
        ([{"joint": "cart", "name": "pole"}], "the name 'pole' is taken by a joint"),
        ([{"joint": "cart", "share": 0}], "share"),
        (
            [{"force": {"name": "f", "link": "cart", "direction": [1, 0, 0]}, "name": "g"}],
            "give `name` inside `force`",
        ),
    ],
)
def test_drives_that_cannot_be_are_refused(actuators, says):
    with pytest.raises(SceneError, match=says):
        cart_pole(actuators=actuators)


def test_a_scene_says_what_no_drive_moves():
    assert "undriven  1: pole" in repr(cart_pole())
    assert "undriven" not in repr(cart_pole(actuators=None))


# ---------------------------------------------------------------- efforts by name


def listed_backwards():
    """Two sliders on one another; the list of drives begins with the outer one."""
    slides = [(n, pin.JointModelPX(), lump(m, moment=0.1)) for n, m in (("inner", 2), ("outer", 3))]
    model = chain(*slides, gravity=0.0)
    ratios = {"outer": 2.0, "inner": 5.0}
    drives = [{"joint": name, "transmission": {"ratio": ratio}} for name, ratio in ratios.items()]
    return pf.Scene(model=model, actuators=drives)


GIVEN = {"outer": 3.0, "inner": 1.0}
#: (2 + 3) a_1 + 3 a_2 = 1, 3 (a_1 + a_2) = 3
BY_HAND = [-1.0, 2.0]


def test_efforts_by_name_do_not_depend_on_an_order():
    scene, zero = listed_backwards(), np.zeros(2)
    assert scene.actuator_names == ("inner", "outer")
    assert "drives    at every joint, in the model's order" in repr(scene)
    solver = scene.solver()
    for given in (GIVEN, dict(reversed(GIVEN.items())), np.array([1.0, 3.0])):
        assert pf.forward_dynamics(scene, zero, zero, given).a == pytest.approx(BY_HAND)
        assert solver.forward(zero, zero, given).a == pytest.approx(BY_HAND)
    torque = {"outer": 1.5, "inner": 0.2}
    assert pf.forward_dynamics(scene, zero, zero, motor_torque=torque).a == pytest.approx(BY_HAND)
    alone = pf.forward_dynamics(scene, zero, zero, {"outer": 3.0})
    assert alone.a == pytest.approx([-1.5, 2.5])
    with pytest.raises(StateError, match=r"'oter'.*'outer'"):
        pf.forward_dynamics(scene, zero, zero, {"oter": 1.0})
    with pytest.raises(StateError, match=r"effort\['outer'\]: shape \(2,\); should be a number"):
        pf.forward_dynamics(scene, zero, zero, {"outer": [1.0, 2.0]})


@pytest.mark.parametrize(
    "effort",
    [
        GIVEN,
        {"outer": lambda t, q, v: 3.0 + 0.0 * v[0], "inner": lambda t: 1.0},
        {"outer": lambda t, scale=3.0: scale, "inner": 1.0},
        lambda t, q, v: GIVEN,
        lambda t, q, v: [1.0, 3.0],
    ],
)
def test_a_simulation_takes_efforts_by_name(effort):
    scene, zero = listed_backwards(), np.zeros(2)
    motion = pf.simulate(scene, zero, zero, effort, 1.0)
    assert_allclose(motion.q[-1], 0.5 * np.array(BY_HAND), rtol=1e-9)


def test_a_function_that_names_no_drive_says_so():
    scene, zero = listed_backwards(), np.zeros(2)
    with pytest.raises(SimulationError, match=r"at t = 0 s: .*'oter'"):
        pf.simulate(scene, zero, zero, lambda t, q, v: {"oter": 1.0}, 1.0)
