"""Gears in forward dynamics: closed forms, inverse after forward, where self-locking gears jam."""

from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, geared_arm, lump, random_states, random_tree
from judges.gear_enumeration import Arm, fewest, judge, locking_arm, random_arm, random_state

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.samples.closure import consistent_motion
from pinfric.errors import (
    AmbiguousAcceleration,
    GearJam,
    NoConsistentAcceleration,
    SceneError,
    StateError,
    UndecidedAcceleration,
)
from pinfric.friction.problem import SearchOutcome
from pinfric.model.friction_terms import CoulombFriction

G = 9.81
ROBOTS = Path(__file__).resolve().parents[2] / "robots"


def hoist(gear: dict, mass: float = 10.0, friction: dict | None = None) -> pf.Scene:
    """A load on a vertical slide: M = mass, h = mass g; a joint drive with the given gear."""
    body = lump(mass)
    model = chain(("lift", pin.JointModelPZ(), body))
    actuators = [{"joint": "lift", "transmission": gear}]
    friction = {"lift": {"coulomb": friction}} if friction else {}
    return pf.Scene(model=model, friction=friction, actuators=actuators)


def forward(scene: pf.Scene, v: float, torque: float) -> pf.Instant:
    return pf.forward_dynamics(scene, [0.0], [v], motor_torque=[torque])


LOSSY = {
    "ratio": -50.0,
    "efficiency": 0.8,
    "back_efficiency": 0.7,
    "no_load_torque": 0.02,
    "motor_viscous": 1e-3,
    "rotor_inertia": 2e-3,
}
WORM = {"ratio": 50.0, "efficiency": 0.4, "back_efficiency": -0.2, "no_load_torque": 0.02}


@pytest.mark.parametrize("v", [0.3, -0.3])
@pytest.mark.parametrize("u", [300.0, 20.0, -300.0])
def test_each_quadrant_of_a_hoist(u, v):
    """I a + s (M a + h) = u - r^2 c v - sigma n, s by the quadrant; which is right, by hand.

    M = 10, h = 98.1, I = 50^2 0.002 = 5, r^2 c = 2.5, n = 50 0.02 = 1. Both slopes are tried: one
    of the two answers has its t = M a + h on its own side, for this gear never both.
    """
    sigma, answers = np.sign(v), []
    for drives, slope in ((True, 1 / 0.8), (False, 0.7)):
        a = (u - 2.5 * v - sigma - slope * 98.1) / (5.0 + 10.0 * slope)
        t = 10.0 * a + 98.1
        if (sigma * t > 0) == drives:
            answers.append((a, t))
    found = forward(hoist(LOSSY), v, u / -50.0)
    assert len(answers) == 1
    assert [found.a[0], found.effort[0]] == pytest.approx(answers[0], rel=1e-12)


def test_at_rest_a_gear_holds_between_lowering_and_lifting():
    """|a| = 0 for 0.7 98.1 - 1 <= u <= 98.1/0.8 + 1; the joint gets what it needs, 98.1."""
    scene, ends = hoist(LOSSY), (0.7 * 98.1 - 1.0, 98.1 / 0.8 + 1.0)
    for u, a_sign in (
        (ends[0] - 1e-8, -1),
        (ends[0] + 1e-8, 0),
        (ends[1] - 1e-8, 0),
        (ends[1] + 1e-8, 1),
    ):
        found = forward(scene, 0.0, u / -50.0)
        assert np.sign(found.a[0]) == a_sign
        assert found.effort[0] == pytest.approx(98.1, abs=1e-7)
    above = forward(scene, 0.0, (ends[1] + 1.0) / -50.0)
    assert above.a[0] == pytest.approx(1.0 / (5.0 + 10.0 / 0.8), rel=1e-9)  # (I + s M) a = 1


def test_a_worm_at_rest_with_a_bearing_holds_over_the_whole_interval_of_its_load():
    """h = -98.1, b = 10, eta 0.4, eta_b -0.2, n 1: it holds up to u = 0.2 108.1 + 1 = 22.62.

    There the load pulls the way the motor pushes, t = h - b = -108.1; F_+(h + b) is 18.62 only.
    Above it slips: with the bearing's kinetic 10, t = M a - 88.1, and -0.2 t + 1 + I a = u.
    """
    worm = {**WORM, "rotor_inertia": 2e-3}
    scene = hoist(worm, friction={"static": 10.0, "kinetic": 10.0})
    scene = scene.with_(gravity=[0, 0, 9.81])
    assert forward(scene, 0.0, (22.62 - 1e-9) / 50).a[0] == 0.0
    found = forward(scene, 0.0, (22.62 + 1e-6) / 50)
    assert found.a[0] == pytest.approx((22.62 + 1e-6 - 1.0 - 0.2 * 88.1) / (5.0 - 2.0), rel=1e-9)
    assert forward(scene, 0.0, -(22.62 + 1e3) / 50).a[0] < 0.0


@pytest.mark.parametrize("u", [0.0, 100.0])
def test_a_worm_that_holds_any_load_leaves_its_bearing_the_middle_of_its_limits(u):
    """Bearing: -10 to 2, so -4; the gear has the rest, t - 4 = 98.1."""
    ways = {
        "positive": {"static": 10.0, "kinetic": 8.0},
        "negative": {"static": 2.0, "kinetic": 1.0},
    }
    found = forward(hoist(WORM, friction=ways), 0.0, u / 50)
    assert found.a[0] == 0.0
    assert [found.effort[0], found.friction[0]] == pytest.approx([102.1, -4.0], rel=1e-12)


def test_a_wedged_worm_gets_what_it_holds_and_its_bearing_the_middle_of_the_rest():
    """h = -6, u = 3: the gear slips for t from -10 to 0.8, since -0.2 t + 1 < 3 and t/0.4 + 1 < 3.

    The bearing adds up to 7.5, t + phi = -6: so t is at most -10, phi from 4 to 7.5, and 5.75.
    """
    scene = hoist(WORM, 6.0 / G, {"static": 7.5, "kinetic": 7.0}).with_(gravity=[0, 0, G])
    found = forward(scene, 0.0, 3.0 / 50)
    assert found.a[0] == 0.0
    assert [found.effort[0], found.friction[0]] == pytest.approx([-11.75, 5.75], rel=1e-12)
    motion = pf.simulate(scene, [0.0], [0.0], t_end=0.01, motor_torque=[3.0 / 50])
    assert motion.effort == pytest.approx(-11.75, rel=1e-12)
    assert motion.friction == pytest.approx(5.75, rel=1e-12)


def test_two_worms_on_one_joint_share_a_load_that_each_may_hold():
    """u = 3 and 0, h = -6: the first slips for t from -10 to 0.8 and holds -10, the second all."""
    scene = hoist(WORM, 6.0 / G).with_(gravity=[0, 0, G])
    gear = {"joint": "lift", "transmission": WORM}
    scene = scene.with_(actuators=[{**gear, "name": "one"}, {**gear, "name": "other"}])
    found = pf.forward_dynamics(scene, [0.0], [0.0], motor_torque=[3.0 / 50, 0.0])
    assert found.a[0] == 0.0
    assert found.effort.sum() == pytest.approx(-6.0, rel=1e-12)
    assert found.effort[0] <= -10.0 + 1e-12 or found.effort[0] >= 0.8 - 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 40])
def test_what_gears_and_bearings_at_rest_get_obeys_the_law_of_each(first):
    """min(t/eta, eta_b t) - n <= u <= max(t/eta, eta_b t) + n; bearings within their limits."""
    wedged = 0
    for seed in range(first, first + 40):
        scene, rng = geared_arm(seed, locks=0.8)
        (q,), (v,), _ = random_states(scene.model, seed, 1)
        ratio = np.array([drive.transmission.ratio for drive in scene.drives])
        torque = 6.0 * rng.normal(size=len(ratio)) / ratio
        found = pf.forward_dynamics(scene, q, 0.0 * v, motor_torque=torque)
        slack = 1e-9 * np.abs(ratio * torque).max()
        for d, drive in enumerate(scene.drives):
            gear, t, u = drive.transmission, found.effort[d], ratio[d] * torque[d]
            if found.a[d] != 0.0:
                continue
            ends = t / gear.efficiency, gear.back_efficiency * t
            n = abs(ratio[d]) * gear.no_load_torque.at_rest().forward
            assert min(ends) - n - slack <= u <= max(ends) + n + slack
            wedged += gear.back_efficiency <= 0.0 and t * u < 0.0
        for s, site in enumerate(scene.sites):
            if found.modes[s] == 0:
                assert abs(found.friction[s]) <= site.law.static.forward + slack
    assert wedged > 3


@pytest.mark.parametrize("excess", [1e-9, -1e-9])
def test_a_worm_lowers_its_load_if_its_rotor_is_heavy_enough_and_else_jams(excess):
    """t = M a + h, I a + eta_b t = u + n while lowering: I > -eta_b M = 2 decides.

    At u = eta_b h - n = -20.62 the load sinks at constant speed. With a lighter rotor
    u - I a = F(t) has no answer above u = -I g - n, there t = 0 at the kink of F, and two below.
    """
    worm = {**WORM, "rotor_inertia": (2.0 + excess) / 50**2}
    lower = (-0.2 * 98.1 - 1.0) / 50.0
    if excess < 0:
        with pytest.raises(GearJam, match=r"joint 'lift': no acc.* above 0.0008 kg m\^2"):
            forward(hoist(worm), -0.1, lower + 1e-6)
        found = forward(hoist(worm), -0.1, lower - 0.01)
        assert found.a[0] == pytest.approx((-20.62 - 0.5 + 1.0 - 98.1 / 0.4) / 27.0, rel=1e-9)
        assert found.effort[0] < 0.0  # the motor pushes the load down, which is stable
    else:
        assert abs(forward(hoist(worm), -0.1, lower).a[0]) < 1e-4  # rounding times 1e9
    assert forward(hoist(worm), 0.0, 0.0).a[0] == 0.0  # it locks, whatever its rotor
    assert forward(hoist(worm), 0.0, (98.1 / 0.4 + 0.999) / 50).a[0] == 0.0


@pytest.mark.parametrize("count", [1, 5])
def test_worms_side_by_side_are_lowered_at_once(count):
    """Each alone: (I + eta_b M) a = u + n - eta_b h, I = 5, so 3 a = -30 + 1 + 19.62.

    Motor and load push the same way: each holds small and large loads and slips between.
    """
    lifts = [(f"lift_{k}", pin.JointModelPZ(), lump(10.0)) for k in range(count)]
    model = chain(*lifts, beside=True)
    gear = {**WORM, "rotor_inertia": 5.0 / 50**2}
    actuators = [{"joint": name, "transmission": gear} for name in tuple(model.names)[1:]]
    scene = pf.Scene(model=model, actuators=actuators)
    still, torque = np.zeros(count), np.full(count, -30.0 / 50)
    found = pf.forward_dynamics(scene, still, still, motor_torque=torque)
    np.testing.assert_allclose(found.a, -9.38 / 3, rtol=1e-12)


@pytest.mark.parametrize("count", [8, 9, pytest.param(12, marks=pytest.mark.slow)])
@pytest.mark.parametrize("lowered", [0, 2])
def test_one_of_many_joints_at_rest_slips_whatever_else_rests(count, lowered):
    """Pushed with 10: t = 0.8 10 = 8, 1 kg, friction 1: a = 7. Worms: as those side by side above.

    Beyond eight joints at rest loads of slipping gears overwrote the result.
    """
    kinds = [(pin.JointModelPZ(), 10.0)] * lowered + [(pin.JointModelPX(), 1.0)] * (count - lowered)
    slides = [(f"slide_{k}", kind, lump(mass)) for k, (kind, mass) in enumerate(kinds)]
    model = chain(*slides, beside=True)
    names = tuple(model.names)[1:]
    lossy = {"ratio": 1.0, "efficiency": 0.8, "back_efficiency": 0.7}
    worm = {**WORM, "rotor_inertia": 5.0 / 50**2}
    actuators = [
        {"joint": name, "transmission": worm if k < lowered else lossy}
        for k, name in enumerate(names)
    ]
    coulomb = dry(1.0)
    scene = pf.Scene(
        model=model, friction=dict.fromkeys(names[lowered:], coulomb), actuators=actuators
    )
    still, torque, wanted = np.zeros(count), np.zeros(count), np.zeros(count)
    torque[:lowered], wanted[:lowered] = -30.0 / 50, -9.38 / 3
    torque[lowered], wanted[lowered] = 10.0, 7.0
    found = pf.forward_dynamics(scene, still, still, motor_torque=torque)
    np.testing.assert_allclose(found.a, wanted, rtol=1e-12)
    assert found.friction[0] == pytest.approx(-1.0)
    for method in ("event", "timestepping"):
        motion = pf.simulate(scene, still, still, None, 0.1, method, motor_torque=torque)
        np.testing.assert_allclose(motion.v[-1], 0.1 * wanted, rtol=1e-9)


def test_a_gear_that_may_jam_does_not_hide_how_the_search_ended():
    """The jam is the error only if no acceleration was found; else it is added."""
    worm = {**WORM, "rotor_inertia": (2.0 - 1e-9) / 50**2}
    ws = Workspace(hoist(worm), motors=True)
    still, down = np.zeros(1), np.array([-0.1])
    ws.assemble(still, down, np.array([-0.2 * 98.1 - 1.0]))
    for found, kind in (
        (SearchOutcome.NONE, GearJam),
        (SearchOutcome.AMBIGUOUS, AmbiguousAcceleration),
        (SearchOutcome.UNDECIDED, UndecidedAcceleration),
        (SearchOutcome.NOT_CONVERGED, NoConsistentAcceleration),
    ):
        error = ws.failures.failure(found, ws.state)
        assert type(error) is kind
        assert "above 0.0008 kg m^2" in str(error)


@pytest.mark.parametrize(
    "first", [0, 50, *(pytest.param(x, marks=pytest.mark.slow) for x in range(100, 300, 50))]
)
def test_inverse_dynamics_gives_the_motor_torques_back(first):
    """Motor torque -> a -> motor torque, or an interval around it, at 1e-9 of the forces there."""
    seen = 0
    for seed in range(first, first + 50):
        scene, rng = geared_arm(seed, mimic=seed % 10 == 0)
        (q,), (v,), _ = random_states(scene.model, seed, 1)
        v = v * (rng.random(len(v)) < (0.0, 0.5, 1.0)[seed % 3])
        ratio = np.array([drive.transmission.ratio for drive in scene.drives])
        torque = 10.0 * rng.normal(size=len(ratio)) / ratio
        found = pf.forward_dynamics(scene, q, v, motor_torque=torque)
        wanted = pf.inverse_dynamics(scene, q, v, found.a)
        ends = wanted.motor_torque_lower[0], wanted.motor_torque_upper[0]
        size = np.abs(ratio * torque).max() + np.abs(wanted.effort_frictionless).max()
        beyond = np.maximum(ends[0] - torque, torque - ends[1]) * np.abs(ratio)
        assert beyond.max() < 1e-9 * size
        moving = v != 0.0
        assert np.abs(ends[1] - ends[0])[moving[: len(ratio)]].max(initial=0.0) < 1e-9 * size
        seen += 1
    assert seen == 50


def test_a_lossless_gear_is_armature_and_ratio():
    """a of r T_m with M + r^2 J on the diagonal, by Pinocchio's aba with armature."""
    model = random_tree(3, 5)
    actuators = [
        {"joint": name, "transmission": {"ratio": 30.0, "rotor_inertia": 1e-4}}
        for name in tuple(model.names)[1:]
    ]
    (q,), (v,), (torque,) = random_states(model, 3, 1)
    found = pf.Scene(model=model, actuators=actuators).solver()
    found = found.forward(q, v, motor_torque=torque)
    model.armature = np.full(model.nv, 0.09)
    wanted = pin.aba(model, model.createData(), q, v, 30.0 * torque)
    np.testing.assert_allclose(found.a, wanted, rtol=1e-10)


@pytest.mark.parametrize(
    ("effort", "torque", "says"),
    [
        (None, None, "neither of effort and motor_torque; give one of them"),
        ([1.0], [1.0], "both of effort and motor_torque"),
        (None, [1.0, 2.0], r"motor_torque: shape \(2,\); should be \(1,\)"),
        (None, [np.nan], "motor_torque: column 0 is nan"),
    ],
)
def test_what_cannot_be_given_is_said(effort, torque, says):
    with pytest.raises(StateError, match=says):
        pf.forward_dynamics(hoist(LOSSY), [0.0], [0.0], effort, motor_torque=torque)


def test_a_torque_of_a_motor_needs_a_transmission():
    with pytest.raises(SceneError, match="motor_torque: drive 'lift' has no transmission"):
        forward(hoist(LOSSY).with_(actuators=None), 0.0, 1.0)


@pytest.fixture(scope="module")
def ur10():
    """All its Coulomb friction at the joints, none in the gears, which makes its states hard."""
    scene = pf.load_scene(ROBOTS / "ur10_machine_tending.yaml")
    friction = {
        name: entry.model_copy(update={"coulomb": CoulombFriction(static=1.2 * b, kinetic=b)})
        for (name, entry), b in zip(
            scene.friction.items(), (12.5, 13.3, 5.0, 2.0, 2.7, 2.3), strict=True
        )
    }
    gears = [
        a.model_copy(
            update={"transmission": a.transmission.model_copy(update={"no_load_torque": None})}
        )
        for a in scene.actuators
    ]
    scene = scene.with_(friction=friction, actuators=gears)
    return Arm(scene, ["blank"]), pf.Solver(scene, ["blank"])


def test_lines_and_modes_do_not_go_round_in_circles(ur10):
    """Modes found with the lines of other modes changed the lines, those the modes, without end."""
    arm, solver = ur10
    q = np.array([-0.0328801, -1.2424, 1.96476, -2.09188, -1.22191, 0.0])
    v = np.array([0.0, 0.118859, 2.5152, 0.0, 0.428122, 0.0])
    torque = np.array([0.0162468, -0.489816, 0.160368, 0.0515622, -0.0332032, 0.0022235])
    (expected,) = fewest(arm.accelerations(q, v, torque))
    found = solver.forward(q, v, motor_torque=torque)
    np.testing.assert_allclose(found.a, expected, rtol=1e-8, atol=1e-10)


def test_two_joints_of_which_either_may_break_away_are_ambiguous(ur10):
    """Static friction is 1.2 times kinetic: where pan slips wrist 2 holds, and the other way round.

    The enumeration finds both; the refusal had also said that neither is consistent.
    """
    arm, solver = ur10
    q = np.array(
        [
            0.28027033836016546,
            0.9161849401694764,
            -1.8617013051871907,
            -0.6225658831916898,
            -1.450212776659248,
            0.15554410495236493,
        ]
    )
    v = np.array([0.0, -0.2727723675851683, -0.287227370334989, 1.5430093303162002, 0.0, 0.0])
    torque = np.array(
        [
            0.16592212704326922,
            -1.2592262444726743,
            -0.46829833354924244,
            -0.07571156262728078,
            0.05825397463002632,
            0.004712728112175737,
        ]
    )
    pan, wrist = sorted(fewest(arm.accelerations(q, v, torque)), key=lambda a: abs(a[4]))
    assert pan[0] > 0.4
    assert pan[4] == 0.0
    assert wrist[0] == 0.0
    assert wrist[4] > 2.0
    with pytest.raises(AmbiguousAcceleration, match=r"2 in 7 modes.*one set of joints may break"):
        solver.forward(q, v, motor_torque=torque)
    options = {"motor_torque": torque, "attached": ["blank"], "dt": 1e-6}
    stepped = pf.simulate(solver.scene, q, v, None, 1e-5, "timestepping", **options)
    M, h = arm.mass_matrix(q), pin.rnea(arm.model, arm.data, q, v, np.zeros(6)).copy()
    held = np.arange(6) == 5  # a step may let both go, which obeys as well
    sign = np.where(held, 0.0, np.sign(v) + np.sign(stepped.a[0]) * (v == 0.0))
    lines = product(*[(1.0, -1.0) if each else (1.0,) for each in arm.loses & ~held])
    both = [
        arm._on_lines(q, v, arm.ratio * torque, M, h, sign, held, np.array(side)) for side in lines
    ]
    (both,) = [a for a in both if a is not None]
    np.testing.assert_allclose(stepped.a[0], both, rtol=1e-3)
    assert stepped.status == "finished"


def many(kind, count):
    return pytest.param(kind, count, marks=pytest.mark.slow)


@pytest.mark.parametrize(
    ("kind", "count"), [("arms", 40), ("ur10", 60), many("arms", 300), many("ur10", 500)]
)
def test_every_refusal_of_gears_that_do_not_lock_is_a_true_one(kind, count, ur10):
    """A sample of `gear_enumeration.py`; answers are compared, too.

    Where many joints rest the enumeration takes seconds, so it judges refusals only.
    """
    for seed in range(count):
        if kind == "arms":
            scene, arm, q, v, torque = random_arm(seed)
            solver = pf.Solver(scene)
        else:
            arm, solver = ur10
            q, v, torque = random_state(arm, np.random.default_rng(seed))
        a, error, true = judge(solver, arm, q, v, torque)
        assert true, (seed, error)
        quick = len(v) <= 5 if kind == "arms" else seed < 12 and np.count_nonzero(v == 0.0) <= 3
        if a is not None and quick:
            (expected,) = fewest(arm.accelerations(q, v, torque))
            np.testing.assert_allclose(a, expected, rtol=1e-7, atol=1e-9)


def test_many_self_locking_gears_at_rest_move_as_an_enumeration_of_their_lines_says():
    """A sample of `gear_enumeration.py locking`, arms for which it is fast."""
    compared = 0
    for seed in range(60):
        scene, arm, q, v, torque = locking_arm(seed)
        if len(q) <= 5:
            _, error, true = judge(pf.Solver(scene), arm, q, v, torque, compare=True)
            assert true, (seed, error)
            compared += 1
    assert compared > 15


@pytest.mark.parametrize(
    ("turn", "speed", "back", "rotor", "torque"),
    [
        (
            38,
            1.2833098926141853,
            -0.025978252568037673,
            1.4124462937451952e-08,
            8.886806136529596e-06,
        ),
        (
            53,
            1.8616903696795846,
            -0.37088417388148864,
            1.3808277087192359e-07,
            -0.00119152304087971,
        ),
    ],
)
def test_pins_steady_a_gear_on_the_line_that_falls(turn, speed, back, rotor, torque):
    """Its rotor is too light beside the mechanism alone; the pins' loads add what is missing.

    r T = r^2 I a + F(t(a)) with t by inverse dynamics, pins included: it rises where it is met.
    """
    plain = pf.load_scene("slider_crank").with_(actuators=[{"joint": "crank_pin"}])
    q = plain.close(plain.start_configuration)

    def motion(speed, a):
        made = consistent_motion(plain, q[None], ["crank_pin"], [[speed]], [[a]])
        return made[0][0], made[1][0]

    for _ in range(turn):
        q = plain.close(pin.integrate(plain.model, q, 0.1 * motion(1.0, 0.0)[0]))
    v, start = motion(speed, 0.0)
    along, a = motion(speed, 1.0)[1] - start, 3000.0 * np.linspace(-1.0, 1.0, 4001) ** 3
    states = [np.tile(x, (len(a), 1)) for x in (q, v)]
    t = pf.inverse_dynamics(plain, *states, start + a[:, None] * along).effort_lower[:, 0]
    u = 2500.0 * rotor * a + np.where(np.sign(speed) * t > 0.0, t / 0.6, back * t)
    (k,) = np.flatnonzero(np.diff(np.sign(u - 50.0 * torque)))
    assert u[k + 1] > u[k]
    gear = {"ratio": 50.0, "rotor_inertia": rotor, "efficiency": 0.6, "back_efficiency": back}
    scene = plain.with_(actuators=[{"joint": "crank_pin", "transmission": gear}])
    found = pf.forward_dynamics(scene, q, v, motor_torque=[torque])
    assert a[k] <= found.a[0] <= a[k + 1]
    assert found.answers == 1
