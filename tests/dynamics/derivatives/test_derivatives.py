"""Derivatives of one state against differences of the solver, the opened twin, and Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump, random_friction, random_states, random_tree
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.derivatives.derivatives import check_differentiable
from pinfric.dynamics.derivatives.parameters import opened
from pinfric.errors import AmbiguousAcceleration, SceneError, StateError
from pinfric.model.couples import rate_rows, reaches
from pinfric.model.friction_terms import STEEP
from pinfric.model.robot import example_robot_data

GEAR = {
    "ratio": 80.0,
    "efficiency": 0.8,
    "back_efficiency": 0.7,
    "no_load_torque": 0.02,
    "motor_viscous": {"coefficient": 1e-4, "exponent": 0.7},
    "rotor_inertia": 2e-5,
}
WORM = {"ratio": -50.0, "efficiency": 0.4, "back_efficiency": -0.5, "rotor_inertia": 1e-5}
PAYLOAD = {"mass": 1.5, "com": [0.0, 0.05, 0.1], "inertia": [0.01, 0.0, 0.0, 0.01, 0.0, 0.01]}
ENDS = pf.InverseDerivatives._fields[:-1]
BY = ("dtau_dq", "dtau_dv", "dtau_da")
MODES = {"slip": slice(0, 0), "mixed": slice(None, None, 2), "rest": slice(None)}


def arm(seed):
    """The bodies and joints of a random tree, as one chain.

    Pinocchio's derivatives and mass matrix are wrong where joints are not numbered depth first.
    """
    given, model = random_tree(seed, 4 + seed % 4, sliding=0.3), pin.Model()
    model.gravity = given.gravity
    for j in range(1, given.njoints):
        model.addJoint(j - 1, given.joints[j], given.jointPlacements[j], given.names[j])
        model.appendBodyToJoint(j, given.inertias[j], pin.SE3.Identity())
    return model


def scene_of(seed, *, base=False, geared=True, mild=1.0, worm=True):
    """A random arm or, of odd seeds, tree of 4 to 7 joints: friction of every kind, some gears."""
    model = arm(seed) if seed % 2 == 0 or base else random_tree(seed, 4 + seed % 4, sliding=0.3)
    friction = random_friction(model, seed)
    for entry in friction.values():
        entry["mu"] = {key: mild * value for key, value in entry["mu"].items()}
        if seed % 3 == 0:
            entry["viscous"] = {"coefficient": 0.4, "exponent": 0.667}
    if base:
        root = pin.Model()
        at = root.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
        root.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
        root.addBodyFrame("trunk", at, pin.SE3.Identity(), 0)
        frame = root.getFrameId("trunk")
        model = pin.appendModel(root, model, frame, pin.SE3.Identity())
    model.armature = np.append(np.linspace(0.0, 0.3, model.nv - 2), [0.0, 0.0])
    names = [name for name in model.names[1:] if name != "base"]
    of = {names[-1]: GEAR, names[-2]: WORM if worm else GEAR} if geared else {}
    drives = [{"joint": name, "transmission": of.get(name, {"ratio": 1.0})} for name in names]
    return pf.Scene(model=model, friction=friction, actuators=drives)


def panda():
    """One finger mimics the other, and the hand carries a payload."""
    scene = pf.load_scene("panda")
    urdf = example_robot_data() / "panda_description/urdf/panda.urdf"
    model = pin.buildModelFromUrdf(str(urdf), mimic=True)
    return pf.Scene(model=model, friction=dict(scene.friction))


def quotients(f, model, state, steps):
    """(3, ...) central differences of f(q, v, a) with Richardson, of each of some steps (h)."""
    q, *rest = state

    def at(n, e):
        moved = [x.copy() for x in rest]
        if n:
            moved[n - 1] += e
        return f(pin.integrate(model, q, e) if n == 0 else q, *moved)

    def central(n, h):
        units = h * np.eye(model.nv if n < 2 else len(rest[n - 1]))
        return np.stack([(at(n, e) - at(n, -e)) / (2 * h) for e in units], axis=-1)

    for h in steps:
        yield [(4 * central(n, h) - central(n, 2 * h)) / 3 for n in range(len(state))]


def assert_close(found, f, model, state, tolerance, free=None, steps=(1e-3, 2e-4, 2e-5)):
    """Blocks (3, k, ...) against the best of some differences.

    Wide steps err where laws bend, short ones by the rounding of f, which is allowed for.
    """
    rounding = 4e-16 * np.abs(f(*state)).reshape(len(found[0]), -1).max(axis=1) / min(steps)
    judges = list(quotients(f, model, state, steps))
    for n, block in enumerate(found):
        for k, one in enumerate(block):
            errors = []
            for judge in judges:
                error = np.abs(one - judge[n][k])
                if free is not None and n == 1:
                    error = error[~free] if error.ndim == 1 else np.where(free, 0.0, error)
                errors.append(error.max() / max(np.abs(one).max(), 1e-9))
            allowed = tolerance + rounding[k] / max(np.abs(one).max(), 1e-9)
            assert min(errors) < allowed, (n, k, errors, allowed)


def inverse_case(scene, seed, rest):
    solver, model = scene.solver(), scene.model
    q, v, a = (x[0] for x in random_states(model, seed, 1))
    v[model.nv - len(scene.joint_names) if model.joints[1].nv == 6 else 0 :][rest] = 0.0
    return solver, model, (q, v, a)


def ends_of(solver):
    def f(q, v, a):
        found = solver.inverse(q, v, a)
        return np.array([getattr(found, name) for name in ENDS])

    return f


def blocks(derivatives):
    return np.array([[getattr(getattr(derivatives, end), by) for end in ENDS] for by in BY])


def check_inverse(scene, seed, rest):
    solver, model, state = inverse_case(scene, seed, rest)
    found = solver.inverse_derivatives(*state)
    assert np.isfinite(blocks(found)).all()
    own = reaches(scene.drives, model.nv) | (rate_rows(scene.drives, model.nv) != 0.0)
    free = own & (np.abs(state[1]) <= 1e-6)  # rest has no derivative by its own speed
    assert_close(blocks(found), ends_of(solver), model, state, 1e-9, free)


@pytest.mark.parametrize("rest", MODES.values(), ids=MODES)
@pytest.mark.parametrize("name", ["ur10", "panda", "so101", "scara"])
def test_inverse_of_bundled_arms_against_differences(name, rest):
    check_inverse(pf.load_scene(name), 3, rest)


@pytest.mark.parametrize("rest", MODES.values(), ids=MODES)
@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(s, marks=pytest.mark.slow) for s in range(2, 40))]
)
def test_inverse_of_random_arms_against_differences(seed, rest):
    """Pins, guides on either link, Stribeck, powers of the speed, gears that lock themselves."""
    check_inverse(scene_of(seed), seed, rest)


def couples():
    scene = scene_of(5, geared=False)
    names = list(scene.actuator_names)
    drives = [{"joint": name, "transmission": GEAR} for name in names]
    drives[2]["couples"] = {names[3]: -0.5}
    return scene.with_(actuators=drives)


@pytest.mark.parametrize("rest", MODES.values(), ids=MODES)
def test_coupled_drives_against_differences(rest):
    check_inverse(couples(), 2, rest)


def test_a_mimic_joint_adds_to_its_leader():
    check_inverse(panda(), 4, MODES["slip"])


#: Friction, gear and velocity of the second of two sliders.
RARE = {
    "pads that stay on the parent": (
        {
            "bearing": {"kind": "guide", "length": 0.2, "width": 0.1, "on": "parent"},
            "mu": {"static": 0.3, "kinetic": 0.2},
        },
        None,
        0.4,
    ),
    "creep": (dry(2.0, 1.0) | {"viscous": 3.0}, None, 0.02),
    "losses that grow with speed": (
        {"viscous": 3.0},
        {
            "ratio": 50.0,
            "efficiency": {"load": 20.0, "over_speed": [[5.0, 0.8], [50.0, 0.6]]},
            "back_efficiency": "same_loss",
        },
        0.4,
    ),
    "a worm that turns while its joint rests": (dry(30.0, 20.0), WORM, 0.0),
}


@pytest.mark.parametrize("follows", [1.0, -0.7])
@pytest.mark.parametrize("case", RARE.values(), ids=RARE)
def test_what_random_arms_seldom_meet(case, follows):
    """Each beside a coupled drive, and a joint that follows another."""
    friction, gear, speed = case
    model = chain(
        ("a", pin.JointModelPX(), lump(2.0, (0.1, 0.2, 0.1))),
        ("b", pin.JointModelPY(), lump(1.0, (0.3, 0.1, 0.2))),
        ("c", pin.JointModelRX(), lump(1.5, (0.2, 0.1, 0.3), 0.1), (0.1, 0.2, 0.3)),
    )
    if follows < 0.0:
        model = pin.transformJointIntoMimic(model, 1, 2, follows, 0.1)
    names = "abc" if follows > 0.0 else "ac"
    drives = [{"joint": n, "transmission": {"ratio": 1.0} if n == "c" else gear} for n in names]
    drives[-2]["couples"] = {"c": -0.3}
    scene = pf.Scene(model, friction={"b": friction}, actuators=drives, stick_velocity=0.05)
    v, a = np.linspace(0.7, 0.9, model.nv), np.linspace(-0.4, 0.6, model.nv)
    v[-2] = speed / abs(follows)
    state = np.linspace(0.2, 0.4, model.nq), v, a
    solver = scene.solver()
    found = blocks(solver.inverse_derivatives(*state))
    rests = np.outer(v == 0.0, v == 0.0)
    assert_close(found, ends_of(solver), model, state, 1e-8, rests)
    if speed == 0.4 and gear is not None:  # and back, from torques of motors
        state = *state[:2], solver.inverse(*state).motor_torque_lower.copy()
        ahead = solver.forward_derivatives(*state[:2], motor_torque=state[2])
        assert_close(
            [x[None].copy() for x in ahead[:3]],
            lambda q, v, u: solver.forward(q, v, motor_torque=u).a[None],
            model,
            state,
            1e-7,
        )


def test_a_payload_and_a_wrench_from_outside_are_carried():
    scene = pf.load_scene("ur10")
    link = scene.model.frames[-1].name
    scene = scene.with_(payloads={"box": {"link": link, **PAYLOAD}})
    solver = scene.solver(attached=["box"])
    q, v, a = (x[0] for x in random_states(scene.model, 1, 1))
    push = {link: np.arange(1.0, 7.0)}

    def f(q, v, a):
        found = solver.inverse(q, v, a, external=push)
        return np.array([getattr(found, name) for name in ENDS])

    found = blocks(solver.inverse_derivatives(q, v, a, external=push))
    assert_close(found, f, scene.model, (q, v, a), 1e-9)
    without = blocks(scene.solver().inverse_derivatives(q, v, a))
    assert not np.allclose(found, without, rtol=1e-3)


@pytest.mark.parametrize("seed", [0, 2, 4, 6])
def test_loads_are_those_of_the_opened_twin(seed):
    """dw = d(RNEA of the twin) E, E the constant embedding of the joints in free ones."""
    scene = scene_of(seed, base=seed > 2)
    solver, twin = scene.solver(), scene.twin()
    q, v, a = (x[0] for x in random_states(scene.model, seed, 1))
    solver.inverse_derivatives(q, v, a)
    x = solver._differentiator(motors=False).tables
    E = np.zeros((6 * twin.n_joints, twin.nv))
    for j in range(twin.n_joints):
        if twin.components[j, 0] < 0:
            E[6 * j : 6 * j + 6, twin.v_index[j]] = twin.ratio[j] * twin.axis[j]
        for n, c in enumerate(twin.components[j][twin.components[j] >= 0]):
            E[6 * j + c, twin.v_index[j] + n] = 1.0
    free_model = opened(scene.model)
    data, free = free_model.createData(), pin.neutral(free_model)
    plain = twin.model.createData()
    pin.forwardKinematics(twin.model, plain, q)
    for j in range(twin.n_joints):
        fixed = twin.model.jointPlacements[j + 1]
        free[7 * j : 7 * j + 7] = pin.SE3ToXYZQUAT(fixed.actInv(plain.liMi[j + 1]))
    pin.computeRNEADerivatives(free_model, data, free, E @ v, E @ a)
    whole = np.triu(data.M) + np.triu(data.M, 1).T
    dw = np.hstack([judge @ E for judge in (data.dtau_dq, data.dtau_dv, whole)])
    for j, judge in enumerate(dw.reshape(twin.n_joints, 6, 3 * twin.nv)):
        found = plain.oMi[j + 1].inverse().toDualActionMatrix() @ x.wrench_change[j]
        assert_allclose(found, judge, rtol=0, atol=1e-13 * np.abs(judge).max())


@pytest.mark.parametrize("seed", [0, 2, 4, 6])
def test_without_friction_they_are_pinocchios(seed):
    scene = scene_of(seed, geared=False, base=seed > 2).with_(friction={})
    solver, model, data = scene.solver(), scene.model, scene.model.createData()
    q, v, a = (x[0] for x in random_states(model, seed, 1))
    rows = [drive.velocity_index for drive in scene.drives]
    found = solver.inverse_derivatives(q, v, a)
    pin.computeRNEADerivatives(model, data, q, v, a)
    whole = np.triu(data.M) + np.triu(data.M, 1).T
    for one, judge in zip(found.effort_lower, (data.dtau_dq, data.dtau_dv, whole), strict=True):
        scale = np.abs(judge).max()
        assert_allclose(one, judge[rows], rtol=0, atol=1e-14 * scale)
    u = np.random.default_rng(seed).normal(size=len(rows))
    tau = np.zeros(model.nv)
    tau[rows] = u
    ahead = solver.forward_derivatives(q, v, u)
    pin.computeABADerivatives(model, data, q, v, tau)
    inverse = (np.triu(data.Minv) + np.triu(data.Minv, 1).T)[:, rows]
    for one, judge in zip(ahead[:3], (data.ddq_dq, data.ddq_dv, inverse), strict=True):
        assert_allclose(one, judge, rtol=0, atol=1e-10 * np.abs(judge).max())


def forward_case(scene, seed, rest, motors):
    """A state, and efforts near those of its motion: joints at rest hold, or start."""
    solver, model, (q, v, a) = inverse_case(scene, seed, rest)
    found = solver.inverse(q, v, a)
    name = "motor_torque" if motors else "effort"
    low, high = (getattr(found, f"{name}_{end}") for end in ("lower", "upper"))
    share = np.random.default_rng(seed).choice([0.3, 0.6, 2.5], size=len(low))
    return solver, model, (q, v, low + share * (high - low)), name


def check_forward(scene, seed, rest, motors, tolerance=1e-7):
    solver, model, state, name = forward_case(scene, seed, rest, motors)
    try:
        found = solver.forward_derivatives(*state[:2], **{name: state[2]})
    except AmbiguousAcceleration:
        pytest.skip("several accelerations obey the laws here, so there is no derivative")
    modes, still = found.modes.copy(), np.abs(state[1]) <= 1e-6
    unit = np.abs(state[2]).max()
    derivatives = [
        found.ddq_dq[None].copy(),
        found.ddq_dv[None].copy(),
        unit * found.ddq_dtau[None],
    ]
    assert all(np.isfinite(x).all() for x in derivatives)
    stuck = [site.velocity_index for site, m in zip(scene.sites, modes, strict=True) if m == 0]
    assert all((x[0][stuck] == 0.0).all() for x in derivatives)

    def f(q, v, u):
        if (v != state[1]).any():
            v = np.where(still, state[1], v)  # modes of what rests are not those beside it
        return solver.forward(q, v, **{name: unit * u}).a[None]

    free, state = np.broadcast_to(still, (model.nv,) * 2), (*state[:2], state[2] / unit)
    try:
        assert_close(derivatives, f, model, state, tolerance, free, (2e-4, 1e-5, 1e-6))
    except AmbiguousAcceleration:  # of one seed, less than 2e-4 rad beside the state
        assert_close(derivatives, f, model, state, tolerance, free, (1e-5, 1e-6))
    return modes


@pytest.mark.parametrize("motors", [False, True], ids=["efforts", "motors"])
@pytest.mark.parametrize("rest", MODES.values(), ids=MODES)
@pytest.mark.parametrize("name", ["ur10", "panda", "so101"])
def test_forward_of_bundled_arms_against_differences(name, rest, motors):
    scene = pf.load_scene(name)
    if motors and any(d.transmission is None for d in scene.drives):
        scene = scene.with_(
            actuators=[{"joint": n, "transmission": GEAR} for n in scene.actuator_names]
        )
    check_forward(scene, 3, rest, motors)


@pytest.mark.parametrize("motors", [False, True], ids=["efforts", "motors"])
@pytest.mark.parametrize("rest", MODES.values(), ids=MODES)
@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(s, marks=pytest.mark.slow) for s in range(2, 40))]
)
def test_forward_of_random_arms_against_differences(seed, rest, motors):
    check_forward(scene_of(seed, mild=0.1, worm=False), seed, rest, motors)


@pytest.mark.parametrize("seed", [0, 31])
def test_near_rest_only_steps_that_turn_no_joint_round_judge_derivatives(seed):
    """Friction jumps where a joint turns round: wide steps err by more than the largest entry.

    Each has a step for which differences of the sixth order agree.
    """
    solver, _, (q, v, a) = inverse_case(scene_of(seed, mild=0.1, worm=False), seed, slice(0, 0))
    v *= 1e-3
    effort = solver.inverse(q, v, a).effort_lower.copy()
    found = solver.forward_derivatives(q, v, effort).ddq_dv.copy()

    def error(h):
        def ahead(e):
            return solver.forward(q, v + h * e, effort).a.copy()

        weights = {1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
        units = np.eye(len(v))
        columns = [
            sum(w * (ahead(k * e) - ahead(-k * e)) for k, w in weights.items()) for e in units
        ]
        return np.abs(np.transpose(columns) / h - found).max() / np.abs(found).max()

    assert error(np.abs(v).min() / 30.0) < 1e-6
    assert error(np.abs(v).max()) > 1.0


@pytest.mark.parametrize("speed", [0.0, 0.7])
def test_no_effort_depends_on_how_a_joint_without_mass_accelerates(speed):
    """The inertia that forward dynamics lends such a joint is in M alone."""
    links = [(n, pin.JointModelRY(), lump(2.0, (0.2, 0.01, 0.0), 0.05)) for n in ("a", "b")]
    model = chain(*links, ("tip", pin.JointModelRX(), pin.Inertia.Zero()))
    drives = [{"joint": "a"}, {"joint": "b", "transmission": GEAR}, {"joint": "tip"}]
    pinned = {
        "mu": {"static": 0.2, "kinetic": 0.1},
        "bearing": {"kind": "pin", "radius": 0.02, "length": 0.04},
    }
    scene = pf.Scene(
        model=model, friction={"b": pinned, "tip": dry(0.5, viscous=0.2)}, actuators=drives
    )
    solver, _, state = inverse_case(scene, 4, slice(0, 0))
    state[1][-1], tip = speed, np.arange(model.nv) == model.nv - 1
    found = solver.inverse_derivatives(*state)
    assert_close(blocks(found), ends_of(solver), model, state, 1e-9, tip if speed == 0.0 else None)
    for end in ENDS:
        assert (getattr(found, end).dtau_da[:, tip] == 0.0).all()


def test_smooth_forward_dynamics_lets_a_joint_without_mass_rest():
    links = [(n, pin.JointModelRY(), lump(2.0, (0.2, 0.01, 0.0), 0.05)) for n in ("a", "b")]
    tip, friction = ("tip", pin.JointModelRX(), pin.Inertia.Zero()), {"a": dry(0.5, viscous=0.2)}
    q, v, u = np.array([0.3, 0.5, 0.2]), np.array([0.4, -0.6, 0.0]), np.array([15.0, 4.0, 0.0])
    drives = [{"joint": n, "transmission": {"ratio": 1.0}} for n in ("a", "b", "tip")]
    for how in "effort", "motor_torque":
        found, judge = (
            pf.Scene(model=chain(*links, *more), friction=friction, actuators=drives[:n])
            .solver()
            .smoothed(0.1)
            .forward(q[:n], v[:n], **{how: u[:n]})
            for n, more in ((3, (tip,)), (2, ()))
        )
        for one, other in zip(found[:4], judge[:4], strict=True):
            at = (slice(0, 2),) * other.ndim
            assert_allclose(one[at], other, rtol=1e-12, atol=1e-12 * np.abs(other).max())
            assert (one[2] == 0.0).all()


def test_a_joint_that_moves_no_mass_stays_and_moves_nothing():
    """Without friction no mode holds it; differences are of the scene without it."""
    links = [(n, pin.JointModelRY(), lump(2.0, (0.2, 0.01, 0.0), 0.05)) for n in ("a", "b")]
    friction = {n: dry(0.5, viscous=0.2) for n in ("a", "b")}
    tip = ("tip", pin.JointModelRX(), pin.Inertia.Zero())
    q, v, u = np.array([0.3, 0.5, 0.2]), np.array([0.4, -0.6, 0.0]), np.array([15.0, 4.0, 0.0])
    whole, bare = (
        pf.Scene(model=chain(*links, *more), friction=friction).with_(gravity=[0.0, 0.0, -9.81])
        for more in ((tip,), ())
    )
    found = whole.solver().forward_derivatives(q, v, u)
    judge = bare.solver().forward_derivatives(q[:2], v[:2], u[:2])
    for one, other in zip(found[:3], judge[:3], strict=True):
        assert np.abs(one[:2, :2] - other).max() < 1e-12 * np.abs(other).max()
        assert (one[2] == 0.0).all()


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("excavator", "the drive off the joints 'boom_cylinder'"),
        ("delta", "the loop 'ball_1'"),
        ("kr300", "a spring acts on its links"),
    ],
)
def test_what_has_no_derivatives_yet_is_named(name, what):
    with pytest.raises(SceneError, match=what):
        check_differentiable(pf.load_scene(name))


def test_bad_input_is_refused_in_one_line():
    solver = pf.load_scene("four_bar").solver()
    nothing = [np.zeros(n) for n in (solver.scene.model.nq, *[solver.scene.model.nv] * 2)]
    for call in (
        lambda: solver.inverse_derivatives(*nothing),
        lambda: solver.forward_derivatives(*nothing[:2], [0.0] * len(solver.scene.drives)),
    ):
        with pytest.raises(SceneError, match=r"the loop .*; should be an open chain") as refused:
            call()
        assert "\n" not in str(refused.value)
    solver = pf.load_scene("pendulum").solver()
    with pytest.raises(StateError, match="a: shape"):
        solver.inverse_derivatives([0.0], [0.0], [0.0, 0.0])
    with pytest.raises(StateError, match="is nan"):
        solver.inverse_derivatives([0.0], [np.nan], [0.0])


def test_kinks_are_flagged_and_never_nan():
    """No contact force; a gear at no load; a steep power of the speed at rest."""
    model = random_tree(1, 1, sliding=0.0)
    model.gravity.linear = np.zeros(3)
    pin_ = {"bearing": {"kind": "pin", "radius": 0.05}, "mu": {"static": 0.2, "kinetic": 0.1}}
    free = {"viscous": {"coefficient": 1.0, "exponent": 0.5}}
    for friction, gear, v, kink in (
        (pin_, None, 0.0, True),
        (pin_, None, 1.0, False),
        (free, None, 0.0, True),
        (free, None, 10 * STEEP, False),
        ({"viscous": 1.0}, {"ratio": 10.0, "efficiency": 0.8, "back_efficiency": 0.7}, 0.0, True),
        ({"viscous": 1.0}, {"ratio": 10.0, "efficiency": 0.8, "back_efficiency": 0.7}, 1.0, False),
    ):
        drives = [{"joint": "joint_1", "transmission": gear}]
        scene = pf.Scene(model=model, friction={"joint_1": friction}, actuators=drives)
        q = pin.neutral(model)
        found = scene.solver().inverse_derivatives(q, np.array([v]), np.zeros(1))
        assert found.kink.tolist() == [kink], (friction, gear, v)
        assert np.isfinite(blocks(found)).all()
