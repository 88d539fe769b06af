"""Whether friction holds a robot at rest: closed forms, an independent search, thresholds."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, plane_friction, sliding_block
from cases import ball_tripod, resting_four_bar
from friction_cases import G, near_the_limit, random_chain
from judges.limits_apart import WORM, least_use, random_mechanism
from mechanisms import (
    add_link,
    bar,
    beside,
    four_bar,
    grounded_model,
    pin_friction,
    shifted,
    spatial_loop,
    two_ball_loops,
)
from scipy.optimize import minimize

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.errors import StateError, UndecidedAcceleration
from pinfric.friction import holding, search


def best_of_many_starts(scene, q, effort, rng, starts=6):
    """Least max |x_k| / limit_k by SLSQP on the whole problem, with no code of `holding`."""
    ws = Workspace(scene)
    ws.assemble(q, np.zeros(scene.model.nv), np.asarray(effort, dtype=float))
    p, n = ws.problem, len(ws.problem.rate_free)
    scale = np.abs(p.rate_slope).max()

    def limit(x):
        force = p.contact[:, 0] + np.tensordot(x, p.contact[:, 1:], (0, 1))
        load = np.linalg.norm(force, axis=1) * p.mu_stick[p.contact_entry]
        return np.bincount(p.coordinate[p.contact_entry], load, n)

    rows = {
        "type": "eq",
        "fun": lambda y: (p.rate_free + p.rate_slope @ y[:-1]) / scale,
        "jac": lambda y: np.column_stack([p.rate_slope / scale, np.zeros(n)]),
    }
    inside = {
        "type": "ineq",
        "fun": lambda y: np.r_[y[-1] * limit(y[:-1]) - y[:-1], y[-1] * limit(y[:-1]) + y[:-1]],
    }
    x0 = -np.linalg.lstsq(p.rate_slope, p.rate_free, rcond=1e-12)[0]
    free = np.linalg.svd(p.rate_slope)[2][np.linalg.matrix_rank(p.rate_slope, 1e-9 * scale) :]
    best = np.inf
    for k in range(starts):
        x = x0 + (rng.normal(size=len(free)) @ free) * np.abs(x0).max() * (k > 0)
        start = np.r_[x, (np.abs(x) / limit(x)).max()]
        found = minimize(
            lambda y: y[-1],
            start,
            jac=lambda y: np.eye(n + 1)[-1],
            method="SLSQP",
            constraints=[rows, inside],
            options={"maxiter": 60},
        )
        x = (
            found.x[:-1]
            - np.linalg.lstsq(p.rate_slope, p.rate_free + p.rate_slope @ found.x[:-1], rcond=1e-12)[
                0
            ]
        )
        best = min(best, float((np.abs(x) / limit(x)).max()))
    return best


@pytest.mark.filterwarnings("ignore:.*radius:pinfric.PinfricWarning")
@pytest.mark.parametrize("count", [8, pytest.param(25, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("pins", "strong"),
    [
        (4, False),
        (5, False),
        *(pytest.param(*x, marks=pytest.mark.slow) for x in ((6, False), (5, True))),
    ],
)
@pytest.mark.filterwarnings("ignore:.*usually at most")
def test_no_search_finds_a_stick_where_there_is_none_and_sticks_are_sticks(pins, strong, count):
    rng = np.random.default_rng(pins + 10 * strong)
    held = []
    for _ in range(count):
        scene, q = random_chain(rng, pins, strong)
        balance, push = near_the_limit(rng, scene, q)
        answer = pf.holds(scene, q, balance + push)
        held.append(answer.held)
        if answer.held:  # its own certificate: equilibrium and limits
            static = np.array([site.law.static.mu for site in scene.sites])
            assert (np.abs(answer.friction) <= static * answer.normal_load * (1 + 1e-9)).all()
            instant = pf.forward_dynamics(scene, q, np.zeros(scene.model.nv), balance + push)
            assert (instant.modes == 0).all()
            assert (instant.a == 0.0).all()
        else:
            assert answer.held is False
            assert answer.proved or strong
            assert best_of_many_starts(scene, q, balance + push, rng, 3) > 1.0
    assert {True, False} <= set(held)


@pytest.mark.filterwarnings("ignore::pinfric.PinfricWarning")
@pytest.mark.parametrize(("seed", "pins", "strong"), [(10_532, 4, False), (12_020, 5, True)])
def test_what_holds_is_held_where_its_friction_is_no_fixed_point(seed, pins, strong):
    """Passes that share friction diverge there, which says nothing of another friction."""
    rng = np.random.default_rng(seed)
    scene, q = random_chain(rng, pins, strong)
    balance, push = near_the_limit(rng, scene, q)
    assert pf.holds(scene, q, balance + push).held
    instant = pf.forward_dynamics(scene, q, np.zeros(scene.model.nv), balance + push)
    assert (instant.modes == 0).all()


def test_a_search_towards_friction_without_bound_comes_back():
    """Friction of this loop could almost wedge itself; less of it has the least use."""
    scene, q, _ = spatial_loop("universal", 8, mu=0.2)
    effort = np.array([1611.1197100341865, 4084.982190410973, 138.01920479405646])
    for k in range(-10, 11):
        found = pf.holds(scene, q, effort * (1 + k * 1e-15))
        assert found.held is False
        assert found.use == pytest.approx(2.6273818957, rel=1e-9)
        assert np.abs(found.friction).max() < 6e3


@pytest.mark.filterwarnings("ignore:.*radius:pinfric.PinfricWarning")
@pytest.mark.parametrize("count", [4, pytest.param(12, marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore:.*usually at most")
def test_three_cuts_one_verdict(count):
    seen = set()
    for seed in range(count):
        verdicts = []
        for cut in (4, 2, 1):
            scene, q = random_chain(np.random.default_rng(seed), 5, seed % 2 == 0, cut)
            no_push, still = np.zeros(len(scene.drives)), np.zeros(scene.model.nv)
            found = pf.holds(scene, q, no_push)
            moved = pf.forward_dynamics(scene, q, still, no_push)
            assert bool((moved.modes == 0).all()) == found.held
            verdicts.append(found)
        assert len({v.held for v in verdicts}) == 1
        assert [v.use for v in verdicts] == pytest.approx([verdicts[0].use] * 3, rel=1e-6)
        seen.add(verdicts[0].held)
    assert seen == {True, False}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*radius:pinfric.PinfricWarning")
@pytest.mark.parametrize("seed", [17, 51])
def test_a_five_bar_breaks_away_where_no_stick_is_left(seed):
    """A search from one start ends above the limits on a ramp's states although one holds.

    Judges: bisection of the verdict, its least use by SLSQP, and the simulated break-away.
    """
    rng = np.random.default_rng(2)
    for _ in range(seed + 1):
        scene, q = random_chain(rng, 5)
        balance, push = near_the_limit(rng, scene, q)
    low, high = 0.0, 1.0
    while pf.holds(scene, q, balance + high * push).held:
        high *= 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (
            (middle, high) if pf.holds(scene, q, balance + middle * push).held else (low, middle)
        )
    assert best_of_many_starts(scene, q, balance + (1 + 1e-3) * low * push, rng) > 1.0
    still = np.zeros(scene.model.nv)
    motion = pf.simulate(scene, q, still, lambda t, q, v: balance + low * t * push, 1.05)
    assert motion.events[0].kind == "slip"
    assert motion.events[0].time == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("angle", [0.1, 0.3, 0.33, 0.34])
def test_a_block_on_an_incline_needs_tan_over_mu(angle):
    scene = sliding_block(plane_friction(0.35, 0.3), angle)
    found = pf.holds(scene, [0.0], [0.0])
    assert found.use == pytest.approx(np.tan(angle) / 0.35, rel=1e-12)
    assert found.held == (np.tan(angle) <= 0.35)
    assert found.proved
    assert found.at_limit == ("slide",)


def test_four_pins_of_one_freedom_are_used_alike_and_the_interval_ends_at_use_1():
    case = resting_four_bar(3)
    result = case.inverse()
    for i in range(3):
        low, high = result.effort_lower[i, 0], result.effort_upper[i, 0]
        for share, held in ((0.0, True), (0.5, True), (-1e-6, False), (1.0 + 1e-6, False)):
            found = pf.holds(case.scene, case.q[i], [low + share * (high - low)])
            assert found.held is held or (share == 0.0 and found.use == pytest.approx(1, abs=1e-8))
        found = pf.holds(case.scene, case.q[i], [0.3 * low + 0.7 * high])
        used = np.abs(found.friction) / (0.3 * found.normal_load)
        assert used == pytest.approx([found.use] * 4, rel=1e-8)
        assert set(found.at_limit) == set(case.scene.site_names)


@pytest.mark.parametrize("decades", [0, 3, 6, 9, 12])
def test_a_small_limit_counts_beside_a_large_one(decades):
    """A hoist with a self-locking gear beside an uncoupled pan that needs 0.05 of 0.03 N m."""
    model = grounded_model((0.0, 0.0, -G))
    add_link(model, 0, pin.JointModelPZ(), shifted(0.0), "hoist", bar(10.0**decades, 0.3))
    add_link(model, 0, pin.JointModelRZ(), shifted(2.0), "pan", bar(1.0, 0.1))
    gears = {"hoist": WORM, "pan": {"ratio": 1.0}}
    drives = [{"joint": name, "transmission": gear} for name, gear in gears.items()]
    friction = {"pan": dry(0.03)}
    scene = pf.Scene(model=model, friction=friction, actuators=drives)
    for need, held in ((0.05, False), (0.03 * (1 + 1e-9), False), (0.03 * (1 - 1e-9), True)):
        found = pf.holds(scene, [0.0, 0.0], motor_torque=[0.0, need])
        assert found.held is held
        assert found.proved
        assert found.use == pytest.approx(need / 0.03, rel=1e-12)
        assert found.at_limit == ("pan",)


def decided_like_the_judge(seed):
    """Whether pinfric's use of a random mechanism is that of the exact program."""
    case = random_mechanism(seed)
    found = pf.holds(case.scene, case.q, motor_torque=case.effort)
    least = least_use(case)
    assert found.proved
    assert found.held is (least <= 1.0)
    assert found.use == pytest.approx(least, rel=1e-8, abs=1e-9)
    return found.held


def test_limits_over_twelve_decades_are_told_apart():
    """Rings, arms and hoists in one scene, limits of 1e-6 to 1e6 and none; see `limits_apart`."""
    assert {decided_like_the_judge(seed) for seed in range(12)} == {True, False}


@pytest.mark.slow
def test_limits_over_twelve_decades_are_told_apart_300_times():
    held = [decided_like_the_judge(seed) for seed in range(300)]
    assert 80 < sum(held) < 220


@pytest.mark.filterwarnings("ignore:.*radius:pinfric.PinfricWarning")
@pytest.mark.parametrize(("pins", "strong"), [(4, False), (5, True), (6, False)])
@pytest.mark.filterwarnings("ignore:.*usually at most")
def test_the_unit_of_mass_does_not_matter(pins, strong):
    """All forces 2^-50 to 2^36 times as large: the same digits (powers of two round nothing)."""
    rng = np.random.default_rng(pins)
    scene, q = random_chain(rng, pins, strong)
    balance, push = near_the_limit(rng, scene, q)
    one = pf.holds(scene, q, balance + push)
    for power in (-50, -37, -25, 25, 36):
        model, unit = scene.model.copy(), 2.0**power
        for j in range(1, model.njoints):
            body = model.inertias[j]
            model.inertias[j] = pin.Inertia(body.mass * unit, body.lever, body.inertia * unit)
        found = pf.holds(scene.with_(model=model), q, (balance + push) * unit)
        assert (found.held, found.proved, found.at_limit) == (one.held, one.proved, one.at_limit)
        assert found.use == pytest.approx(one.use, rel=1e-12)
        assert found.friction == pytest.approx(one.friction * unit, rel=1e-9)


def test_a_joint_without_friction_does_not_rest():
    """The crank has friction, the rest of a chain hangs free: it swings."""
    model = grounded_model()
    arm = add_link(model, 0, pin.JointModelRZ(), pin.SE3.Identity(), "arm", bar(1.0, 0.3))
    add_link(model, arm, pin.JointModelRZ(), shifted(0.3), "hand", bar(0.5, 0.2))
    scene = pf.Scene(model=model, friction={"arm": dry(50)})
    found = pf.holds(scene, [0.2, 0.1], [0.0, 0.0])
    assert found.held is False
    assert found.moving == ("hand",)
    hanging = pf.holds(scene, [0.2, -np.pi / 2 - 0.2], [0.0, 0.0])
    assert hanging.held
    assert hanging.moving == ()


@pytest.mark.parametrize("push", [1e-12, 1.0, 1e12])
def test_a_joint_without_friction_moves_however_weakly_it_is_pushed(push):
    model = grounded_model()
    for name in ("block", "free"):
        add_link(model, 0, pin.JointModelPX(), pin.SE3.Identity(), name, bar(1.0, 0.1))
    scene = pf.Scene(model=model, friction={"block": plane_friction(0.5, 0.5)})
    assert pf.holds(scene, [0.0, 0.0], [0.0, push]).moving == ("free",)
    assert pf.holds(scene, [0.0, 0.0], [0.0, 0.0]).held


@pytest.mark.parametrize("degrees", [0, 20, 45, 60, 80])
def test_what_is_balanced_to_rounding_is_held_by_the_least_friction(degrees):
    """A ton at 3 m: the effort that balances it is known to 1e-11 N m at best."""
    body = pin.Inertia(1000.0, np.array([3.0, 0, 0]), np.zeros((3, 3)))
    model = chain(("arm", pin.JointModelRY(), body))
    scene = pf.Scene(model=model, friction={"arm": dry(1e-14)})
    q = np.array([np.radians(degrees)])
    balance = -1000.0 * 9.81 * 3.0 * np.cos(q)
    for effort in (balance * (1 - 4e-16), balance, balance * (1 + 4e-16)):
        assert pf.holds(scene, q, effort).held
    for effort in (balance - 1e-6, balance + 1e-6):
        assert pf.holds(scene, q, effort).held is False


def test_what_is_asked_before_does_not_matter():
    rng = np.random.default_rng(5)
    scene, q = random_chain(rng, 5)
    balance, push = near_the_limit(rng, scene, q)
    first = pf.holds(scene, q, balance + push)
    for factor in (0.1, 3.0, -1.0):
        pf.holds(scene, q, balance + factor * push)
        pf.forward_dynamics(scene, q, np.zeros(scene.model.nv), balance + factor * push)
    again = pf.holds(scene, q, balance + push)
    assert again.use == first.use
    assert (again.friction == first.friction).all()


def test_bad_input_is_named():
    scene, _ = four_bar()
    with pytest.raises(StateError, match="effort"):
        pf.holds(scene, np.zeros(3), [0.0, 1.0])
    with pytest.raises(StateError, match="open"):
        pf.holds(scene, np.zeros(3), [0.0])


def test_wrenches_from_outside_count_where_balls_rest_too():
    """It holds where forward dynamics stays; where it moves by far, holding is disproved."""
    case = ball_tripod()
    q, still = case.q[0], 0 * case.v[0]
    result = pf.inverse_dynamics(case.scene, q[None], still[None], still[None])
    middle = 0.5 * (result.effort_lower[0] + result.effort_upper[0])
    seen = set()
    for axis in range(6):
        for size in (-3.0, 0.01, 3.0):
            push = {"rocker": size * np.eye(6)[axis]}
            instant = pf.forward_dynamics(case.scene, q, still, middle, push)
            found = pf.holds(case.scene, q, middle, push)
            stays = (instant.modes == 0).all()
            assert found.held in ((True,) if stays else (False, None))
            assert found.proved is (found.held is not None)
            seen.add(found.held)
    assert seen == {True, False}


@pytest.mark.parametrize("seed", range(6))
def test_that_no_friction_of_balls_holds_is_proved_only_where_none_does(seed):
    """Pushed ever harder: the bound is below the use of the friction that holds, and near it."""
    base, rng = pf.load_scene("delta"), np.random.default_rng(seed)
    q = pf.load_trajectory("delta.waypoints.yaml", base).q[rng.integers(300)]
    still = np.zeros((1, base.model.nv))
    found = pf.inverse_dynamics(base, q[None], still, still)
    low, high = found.effort_lower[0], found.effort_upper[0]
    push, middle = 0.5 * (high - low) * rng.choice([-1, 1], 3), 0.5 * (low + high)
    held = [pf.holds(base, q, middle + share * push).held for share in (0.2, 0.5, 1.5, 2.5)]
    assert held[0] is True
    assert held[3] is False
    assert sorted(held, key=[True, None, False].index) == held


# ---------------------------------------------------------------- self-locking gears


def balls_between_worms(seed):
    """Chains that two balls join, two joints driven by worms; state and the torques' generator."""
    scene, q, rng = two_ball_loops(seed, (4, 2, 2))
    names = [drive.name for drive in scene.drives]
    worms = [{"joint": name, "transmission": {**WORM, "no_load_torque": 0.002}} for name in names]
    return scene.with_(actuators=worms), q, rng.normal(size=2)


@pytest.mark.parametrize("seed", [2, 5, pytest.param(110, marks=pytest.mark.slow)])
def test_balls_between_worms_rest_where_the_motors_torques_may_be(seed, monkeypatch):
    """The interval's ends are another code; the friction is looked for once, not for each way."""
    scene, q, way = balls_between_worms(seed)
    still, solves, plain = np.zeros((1, scene.model.nv)), [], search.solve_modes
    ends = pf.inverse_dynamics(scene, q[None], still, still)
    low, high = ends.motor_torque_lower[0], ends.motor_torque_upper[0]
    torque = 0.5 * (low + high) + 0.1 * (high - low) * way / np.abs(way).max()
    monkeypatch.setattr(
        search, "solve_modes", lambda *given, **more: solves.append(1) or plain(*given, **more)
    )
    held = pf.holds(scene, q, motor_torque=torque)
    assert held.held
    assert held.proved
    assert len(solves) <= 2
    found = pf.forward_dynamics(scene, q, still[0], motor_torque=torque)
    assert not found.modes.any()
    np.testing.assert_allclose(held.friction, found.friction, rtol=1e-9)


@pytest.mark.parametrize("seed", [116, pytest.param(23, marks=pytest.mark.slow)])
def test_balls_between_worms_are_decided_or_not_in_bounded_time(seed, monkeypatch):
    """They turned through 320 changes of modes, each for all lines of both gears: 25 s."""
    scene, q, way = balls_between_worms(seed)
    still, solves, plain = np.zeros(scene.model.nv), [], search.solve_modes
    monkeypatch.setattr(
        search, "solve_modes", lambda *given, **more: solves.append(1) or plain(*given, **more)
    )
    with pytest.raises(UndecidedAcceleration, match=r"in \d+ modes tried of \d+"):
        pf.forward_dynamics(scene, q, still, motor_torque=0.5 * way)
    assert len(solves) < 400


#: 4.905 N m on a bearing of 0.5 N m, held by a worm: efficiencies, ratio, no-load torque.
_LOAD, _BEARING, _AHEAD, _BACK, _RATIO, _IDLE = -4.905, 0.5, 0.6, -0.1, 50.0, 0.002


def worm_use(torque):
    """The least use by hand: of the bearing beside a worm that holds, or of both alike.

    What arrives is u = r T, and the worm delivers t. It holds t >= e (u - n), and t <= (u - n)/e_b
    on the other side, where it is not used; for u < 0 all with its signs turned. What is left,
    |load - t|, the bearing bears. Within the first interval the worm is used by
    (u - t)/(u - e (u - n)).
    """
    u, load = _RATIO * torque, _LOAD
    if u < 0.0:
        u, load = -u, -load
    idle = _RATIO * _IDLE
    first, other = _AHEAD * (u - idle), (u - idle) / _BACK
    beyond = max(load - other, 0.0) / _BEARING
    if load >= u:  # the worm takes what is above u
        return min(0.0, beyond)
    both = (u - load) / (_BEARING + u - first)
    return min(both, beyond)


def worm_beside_bearing():
    """A bar that gravity loads, on a bearing and a worm."""
    arm = chain(("j0", pin.JointModelRY(), pin.Inertia(1.0, np.array([0.5, 0, 0]), np.eye(3))))
    drive = {
        "ratio": _RATIO,
        "efficiency": _AHEAD,
        "back_efficiency": _BACK,
        "rotor_inertia": 2e-5,
        "no_load_torque": _IDLE,
    }
    return pf.Scene(
        arm,
        friction={"j0": {"coulomb": _BEARING}},
        actuators=[{"joint": "j0", "transmission": drive}],
    )


@pytest.mark.parametrize("of_width", [-0.5, -0.05, -1e-3, 1e-3, 0.5, 0.999, 1.001, 1.05, 1.5])
def test_a_worm_beside_a_bearing_is_used_as_by_hand(of_width):
    scene = worm_beside_bearing()
    still = pf.inverse_dynamics(scene, *np.zeros((3, 1, 1)))
    low, high = still.motor_torque_lower[0, 0], still.motor_torque_upper[0, 0]
    torque = low + of_width * (high - low)
    hold = pf.holds(scene, [0.0], motor_torque=[torque])
    assert hold.use == pytest.approx(worm_use(torque), rel=1e-6)
    assert hold.held == (0.0 <= of_width <= 1.0)
    assert hold.proved
    assert hold.least
    assert hold.at_limit == (("j0",) if hold.use else ())


def test_six_worms_are_used_as_the_one_that_is_used_most():
    """All 64 ways in which they can hold are looked at, in 18 ms (90 before)."""
    scene = beside(*[worm_beside_bearing()] * 6)
    rng, seen = np.random.default_rng(2), set()
    still = pf.inverse_dynamics(scene, *np.zeros((3, 1, 6)))
    low, high = still.motor_torque_lower[0], still.motor_torque_upper[0]
    for k in range(8):
        torque = low + (high - low) * rng.uniform(-0.3 * (k % 2), 0.95, 6)
        uses = [worm_use(x) for x in torque]
        hold = pf.holds(scene, np.zeros(6), motor_torque=torque)
        assert hold.use == pytest.approx(max(uses), rel=1e-6)
        assert hold.held == (max(uses) <= 1.0)
        assert hold.proved
        assert hold.least
        assert hold.at_limit == (f"j0_{np.argmax(uses)}",)
        seen.add(hold.held)
    assert seen == {True, False}


def worm_and_four_bar(seed):
    """A four-bar at rest in a random posture, its crank driven by a worm; and the worm."""
    rng = np.random.default_rng(seed)
    mu = rng.choice([0.05, 0.1, 0.2])
    friction = {pin: pin_friction(mu, rng.uniform(0.005, 0.03), 1.2 * mu) for pin in "OABC"}
    case = resting_four_bar(40, friction=friction)
    drive = {
        "ratio": 50.0,
        "efficiency": rng.uniform(0.5, 0.95),
        "back_efficiency": rng.uniform(-0.3, -0.01),
        "rotor_inertia": 2e-5,
        "no_load_torque": rng.uniform(2e-5, 2e-3),
    }
    drives = [{"joint": "O", "transmission": drive}]
    return dataclasses.replace(case.scene, actuators=drives), case.q[rng.integers(40)], drive


@pytest.mark.parametrize("seed", range(12))
def test_beside_a_gear_that_locks_itself_the_least_use_is_found_in_bounded_time(seed, monkeypatch):
    """Once 100,000 proofs lowered a use of 3.9e9 by a millionth each: no end within minutes.

    A gear that holds an effort t is used at most wholly, so the use is at most 1 or that by effort
    t, for each t that it holds; outside the motor's interval it is above 1.
    """
    scene, q, gear = worm_and_four_bar(seed)
    still = pf.inverse_dynamics(scene, q[None], *np.zeros((2, 1, len(q))))
    low, high = still.motor_torque_lower[0, 0], still.motor_torque_upper[0, 0]
    mine = still.effort_lower[0, 0], still.effort_upper[0, 0]
    proofs = []
    proved = holding.prove
    monkeypatch.setattr(holding, "prove", lambda *a: proofs.append(1) or proved(*a))
    width, idle = high - low, gear["ratio"] * gear["no_load_torque"]
    for torque in (
        low - 1e-3 * width,
        low + 1e-3 * width,
        high - 1e-3 * width,
        high + 1e-3 * width,
    ):
        proofs.clear()
        hold = pf.holds(scene, q, motor_torque=[torque])
        assert len(proofs) <= 200
        assert hold.held == (low <= torque <= high)
        assert hold.proved
        assert hold.held == (hold.use <= 1.0)
        assert hold.at_limit
        u, (ahead, back) = gear["ratio"] * torque, (gear["efficiency"], gear["back_efficiency"])
        ends = [ahead * (u - idle), (u - idle) / back, ahead * (u + idle), (u + idle) / back]
        for t in (*ends, *np.linspace(2 * mine[0] - mine[1], 2 * mine[1] - mine[0], 5)):
            lower, upper = min(t / ahead, back * t) - idle, max(t / ahead, back * t) + idle
            if lower <= u <= upper:
                least = pf.holds(scene, q, effort=[t]).use
                assert hold.use <= max(1.0, least) * (1 + 1e-5)
