"""Gears against every mode times every line: random machines, closed forms, a compliant shaft."""

import re
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump
from judges.every_line import Gear, Loss, System, answers
from judges.geared_states import KINDS, bars, compare, plain_gear
from judges.test_gears import WORM, hoist
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.errors import AccelerationError, GearJam, UndecidedAcceleration
from pinfric.friction import gears as gears_module
from pinfric.friction.gears import one_answer
from pinfric.friction.tree import Tree
from pinfric.model.drives import gear_table, held_efforts
from pinfric.model.transmission import Transmission

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seeds", [range(12), pytest.param(range(100), marks=pytest.mark.slow)])
def test_forward_dynamics_says_what_every_line_says(kind, seeds):
    """The one stable answer of those with the fewest slips, else a refusal."""
    outcomes = {seed: compare(kind, seed)[0] for seed in seeds}
    assert not {seed: says for seed, says in outcomes.items() if "WRONG" in says}
    assert sum("same" in says for says in outcomes.values()) >= len(seeds) // 3


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("five-bars", 101),
        *(
            pytest.param("couples", seed, marks=pytest.mark.slow)
            for seed in (112, 20056, 60521, 71320)
        ),
        ("couples", 20198),
        ("cylinders", 50524),
    ],
)
def test_what_locks_beside_what_slips_is_held(kind, seed):
    """A limit of zero beside an infinite one hid what two gears hold: a = -26 instead of 0.

    Beside a gear on a falling line, rates of sticking joints had been subtracted with wrong signs.
    In two couples three gears wedge two joints; in two they share a load in many ways while the
    third joint slips. A cylinder of rate 5e-17 rests beside its pivot.
    """
    says, (a, wanted) = compare(kind, seed)
    assert says == "same: 1 answers, 1 stable"
    assert_allclose(a, wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("kind", "seed", "many"), [("couples", 126, 2), ("couples", 128, 4)])
def test_answers_that_slip_less_but_do_not_last_are_counted(kind, seed, many):
    """The stable answer slips more than the unstable ones; the result says that these exist."""
    assert compare(kind, seed)[0] == f"same: {many} answers, 1 stable"
    scene, q, v, torque, _ = KINDS[kind](np.random.default_rng([list(KINDS).index(kind), seed]))
    assert pf.forward_dynamics(scene, q, v, motor_torque=torque).answers == many


# ---------------------------------------------------------------- one worm, by hand

#: M = 10, h = 98.1, eta 0.4, eta_b -0.2, n 1, and I = 1: below -eta_b M = 2.
LIGHT = {**WORM, "rotor_inertia": 1.0 / 50**2}
MASS, LOAD = 10.0, 98.1


def lowered(u: float) -> dict[float, tuple[float, float]]:
    """Slope -> (a, t) of the worm that sinks: t = M a + h, u - I a = slope t - n, on its side."""
    found = {}
    for slope in (1 / 0.4, -0.2):
        a = (u + 1.0 - slope * LOAD) / (1.0 + slope * MASS)
        t = MASS * a + LOAD
        if (t < 0.0) == (slope > 0.0):
            found[slope] = a, t
    return found


@pytest.mark.parametrize("u", [-15.0, -20.0, -40.0])
def test_of_two_answers_a_light_worm_has_the_stable_one(u):
    """Its motor pushes the load; where the load drives a little more effort stops the rotor."""
    by_hand = lowered(u)
    assert len(by_hand) == 2
    found = pf.forward_dynamics(hoist(LIGHT), [0.0], [-0.1], motor_torque=[u / 50])
    assert (found.a[0], found.effort[0]) == pytest.approx(by_hand[1 / 0.4], rel=1e-12)
    assert (found.answers, found.driving.tolist()) == (2, [1])
    assert "2, this is the stable one; driving [1]" in repr(found)


def test_a_worm_that_wedges_is_refused_with_the_rotor_that_it_needs():
    """No answer above u = -I g - n."""
    assert not lowered(-10.0)
    with pytest.raises(GearJam, match=r"'lift': no acceleration .* above 0.0008 kg m\^2"):
        pf.forward_dynamics(hoist(LIGHT), [0.0], [-0.1], motor_torque=[-10.0 / 50])
    bare = {**WORM, "rotor_inertia": 0.0}
    with pytest.raises(GearJam, match=r"'lift': .*its rotor has no inertia"):
        pf.forward_dynamics(hoist(bare), [0.0], [-0.1], motor_torque=[0.0])


@pytest.mark.parametrize(
    ("kind", "seed", "many", "says"),
    [
        ("four-bars", 68, "1 answers, 0 stable", "the one acceleration that obeys its law is unst"),
        ("four-bars", 114, "2 answers, 0 stable", "2 in 1 mode tried, none of them stable"),
        ("curves", 84, "3 answers, 2 stable", "3 in 1 mode tried, 2 of them stable"),
    ],
)
def test_a_refusal_says_how_many_answers_there_are(kind, seed, many, says):
    """As many as the judge finds."""
    outcome, error = compare(kind, seed)
    assert outcome == f"refused: {many}"
    assert says in error.reason


@pytest.mark.parametrize(
    ("kind", "seed", "count"),
    [("four-bars", 12, 1), ("five-bars", 31, 2), ("couples", 0, 3), ("arms 60 light", 4, 4)],
)
def test_with_the_rotors_that_a_refusal_names_there_is_one_answer(kind, seed, count):
    """It named one, or inf, where several gears lock; with smaller rotors nothing is certain."""
    _, error = compare(kind, seed)
    scene, q, v, torque, system = KINDS[kind](
        np.random.default_rng([list(KINDS).index(kind), seed])
    )
    text = f"{error.reason}".replace(" kg m^2, or", f" ({error.site}) kg m^2, or" * (count == 1))
    named = {name: float(x) for x, name in re.findall(r"([\d.e+-]+) \((\w+)\)", text)}
    assert len(named) == count
    for share, certain in ((1.0 + 1e-4, True), (1.0 - 1e-4, False)):
        drives, gears = list(scene.actuators), list(system.gears)
        for d, drive in enumerate(scene.drives):
            gear = drive.transmission
            size = max(named.get(drive.name, 0.0) * share, gear.rotor_inertia)
            heavy = gear.model_copy(update={"rotor_inertia": size})
            drives[d] = drives[d].model_copy(update={"transmission": heavy})
            gears[d] = gears[d]._replace(inertia=gear.ratio**2 * size)
        changed = scene.with_(actuators=drives)
        ws = Workspace(changed, motors=True)
        ws.assemble(q, v, torque * [drive.transmission.ratio for drive in scene.drives])
        ws.modes.stuck[:] = False
        ws.modes.direction[:] = np.sign(ws.machine.kinematics.coordinate_rate)
        assert one_answer(ws.problem, ws.modes) == certain
        if certain:
            (answer,) = answers(system._replace(gears=gears))
            found = pf.forward_dynamics(changed, q, v, motor_torque=torque)
            assert_allclose(found.a, answer.a, rtol=1e-6, atol=1e-9)
            assert answer.stable


def test_where_no_rotor_is_heavy_enough_it_is_said():
    """Two worms that move together: the sum of their energy is of rank one."""
    _, error = compare("four-bars", 9)
    assert "no rotor inertia makes sure of one answer, only fewer gears that lock" in error.reason


def test_more_lines_than_are_tried_leave_it_undecided(monkeypatch):
    """It had said that no acceleration obeys, where one does."""
    monkeypatch.setattr(gears_module, "_MOST_LINES", 1)
    with pytest.raises(UndecidedAcceleration, match=r"0 in \d modes? tried; .* lines"):
        pf.forward_dynamics(hoist(LIGHT), [0.0], [-0.1], motor_torque=[-15.0 / 50])


def test_where_no_gear_moves_there_is_one_choice_of_lines():
    """A solve that did not converge beside gears at rest ended in an IndexError."""
    ws = Workspace(hoist(LIGHT), motors=True)
    ws.assemble(np.zeros(1), np.zeros(1), np.zeros(1))
    ws.modes.stuck[:] = True
    ((efforts, stable),) = gears_module.choices_of_lines(ws.problem, ws.modes)
    assert (efforts.shape, stable) == ((1,), True)


def with_a_shaft(
    drive: Callable[[float], float],
    M: np.ndarray,
    h: np.ndarray,
    friction: np.ndarray,
    t_end: float,
    delivered: float,
    v: np.ndarray,
    inertia: float = 1.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, w, v (m, n) and t of a worm that moves the first of some slides through a shaft.

    I w' = u(t) - F(t), or w = 0 while F_-(t) <= u <= F_+(t);  M v' = e t - h - friction of slides;
    t = k x + c x', x' = w - v. In small steps; slides keep the direction of their friction until
    they stop, and then hold up to that.

    Args:
        drive: time -> u. M, h: (n, n), (n,), constant. friction: (n,) of slides.
        delivered: t at first, of all that moves with v (n,).
    """
    stiffness, dt = 1e6, 2e-5
    damping, w, v = 2.0 * np.sqrt(stiffness * inertia), float(v[0]), v.copy()
    x, t, out = delivered / stiffness, delivered, []
    inverse, e = np.linalg.inv(M), np.eye(len(h))[0]

    def loss(t: float, way: float) -> float:
        return way * max(way * t / 0.4, way * -0.2 * t) + way

    for time in np.arange(0.0, t_end, dt):
        u = drive(time)
        way = np.sign(w) or float(u > loss(t, 1.0)) - float(u < loss(t, -1.0))
        new = w + dt / inertia * (u - loss(t, way)) if way else 0.0
        w = 0.0 if new * way < 0.0 else new
        rubs = -friction * np.sign(v)
        for k in np.flatnonzero(v == 0.0):  # of the last slide: what would keep it at rest
            row = inverse @ (e * t - h + rubs)
            rubs[k] = np.clip(-row[k] / inverse[k, k], -friction[k], friction[k])
        new_v = v + dt * inverse @ (e * t - h + rubs)
        new_v[(new_v * v < 0.0) & (friction > 0.0)] = 0.0
        v, x = new_v, x + dt * (w - new_v[0])
        t = stiffness * x + damping * (w - v[0])
        out.append((time + dt, w, *v, t))
    found = np.array(out)
    return found[:, 0], found[:, 1], found[:, 2:-1], found[:, -1]


ONE = np.array([[MASS]]), np.array([LOAD]), np.zeros(1)


@pytest.mark.parametrize("u", [-15.0, -20.0])
def test_a_shaft_that_yields_settles_at_the_stable_answer_or_wedges(u):
    """From an effort below the unstable answer's; from above it, or without any, it stops."""
    by_hand = lowered(u)
    (_, stable), (_, unstable) = by_hand[1 / 0.4], by_hand[-0.2]

    def ends(u: float, t: float) -> tuple[float, bool]:
        _, w, _, found = with_a_shaft(lambda _: u, *ONE, 20e-3, t, np.array([-0.1]))
        return float(found[-1]), bool((w == 0.0).any())

    for share in (-0.3, 0.0, 0.5, 0.9):
        t, stops = ends(u, share * unstable)
        assert t == pytest.approx(stable, abs=0.02 * unstable)
        assert not stops
    assert ends(u, 1.3 * unstable)[1]
    assert ends(-5.0, 0.0)[1]
    assert ends(-5.0, 50.0)[1]


def test_with_a_heavy_rotor_a_shaft_that_yields_lowers_steadily_and_stops():
    """I = 3: u = eta_b h - n lowers at constant speed; then u = 0, (I + eta_b M) a = -u."""
    lower = -0.2 * LOAD - 1.0
    t, w, (v,), delivered = (
        part.T
        for part in with_a_shaft(
            lambda t: lower * (t < 0.1), *ONE, 0.15, LOAD, np.array([-0.2]), 3.0
        )
    )
    steady = t < 0.1
    assert [w[steady][-1], v[steady][-1]] == pytest.approx([-0.2, -0.2], abs=1e-6)
    assert delivered[steady][-1] == pytest.approx(LOAD, rel=1e-6)
    assert t[w == 0.0][0] == pytest.approx(0.1 + 0.2 / -lower, abs=2e-3)
    assert v[-1] == pytest.approx(0.0, abs=2e-3)


def test_the_stable_answer_is_one_that_slips_more_than_another():
    """A worm carries a slide, inclined by 4/5, on which 20 N act that friction (12, 2) cannot hold.

    So the slide breaks away, and then the worm does not hold. That the worm alone slips obeys, too:
    its load falls so fast that the slide stays. But with I = 1.6, below -eta_b M = 2, this is
    unstable; with the slide free M is 10 - 4.8^2/6 = 6.16, -eta_b M 1.232.
    """
    inertia, u, push, kinetic, static = 1.6, -18.22, 27.088, 2.0, 12.0
    M, g = np.array([[10.0, 4.8], [4.8, 6.0]]), np.array([10.0, 4.8]) * 9.81
    one = (u + 1.0 + 0.2 * g[0]) / (inertia - 0.2 * M[0, 0])
    assert abs(M[1, 0] * one + g[1] - push) < static < g[1] - push
    h = g - (0.0, push)
    lossy = np.array([[inertia, 0.0], [0.0, 0.0]]) + np.diag([-0.2, 1.0]) @ M
    wanted = np.linalg.solve(lossy, [u + 1.0 + 0.2 * h[0], kinetic - h[1]])
    assert (wanted < 0.0).all()
    incline = pin.JointModelPrismaticUnaligned(np.array([0.6, 0.0, 0.8]))
    slides = ("lift", pin.JointModelPZ(), lump(4.0)), ("slide", incline, lump(6.0))
    gear = {**WORM, "rotor_inertia": inertia / 50**2}
    scene = pf.Scene(
        model=chain(*slides),
        friction={"slide": dry(static, kinetic)},
        actuators=[
            {"joint": "lift", "transmission": gear},
            {"joint": "slide", "transmission": {"ratio": 1.0}},
        ],
    )
    still, torque = np.zeros(2), np.array([u / 50, push])
    found = pf.forward_dynamics(scene, still, still, motor_torque=torque)
    assert_allclose(found.a, wanted, rtol=1e-10)
    assert found.answers == 2
    friction = np.array([0.0, kinetic])
    for delivered in (h[0], 0.5 * h[0]):
        path = with_a_shaft(lambda _: u, M, h, friction, 0.2, delivered, still, inertia)
        settled = path[0] > 0.1
        for speed, a in ((path[1], wanted[0]), *zip(path[2].T, wanted, strict=True)):
            assert np.polyfit(path[0][settled], speed[settled], 1)[0] == pytest.approx(a, rel=1e-3)
        assert path[3][-1] == pytest.approx(found.effort[0], rel=1e-3)
    for method in "event", "timestepping":
        motion = pf.simulate(scene, still, still, None, 0.1, method, motor_torque=torque)
        assert_allclose(motion.v[-1], 0.1 * wanted, rtol=1e-9)


@pytest.mark.slow
def test_a_worm_lifts_holds_is_lowered_and_wedges():
    """Event by event: up with (I + M/eta) a = u - n - h/eta, down with u + n - h/eta.

    A compliant shaft does the same.
    """
    row = 1.0 + MASS / 0.4
    up, brake = (256.25 - 1.0 - LOAD / 0.4) / row, (200.0 - 1.0 - LOAD / 0.4) / row
    stop = 0.2 - 0.2 * up / brake
    down, slower = (-25.0 + 1.0 - LOAD / 0.4) / row, (-15.0 + 1.0 - LOAD / 0.4) / row
    times = np.array([0.2, 0.5, 0.6, 0.7])

    def drive(t):
        return np.array([256.25, 200.0, -25.0, -15.0, -5.0])[np.searchsorted(times, t, "right")]

    def torque(t, q, v):
        return [drive(t) / 50]

    def run(t_end, method="event"):
        return pf.simulate(
            hoist(LIGHT),
            [0.0],
            [0.0],
            t_end=t_end,
            motor_torque=torque,
            breakpoints=times,
            method=method,
        )

    found = run(0.7)
    v = [np.interp(t, found.t, found.v[:, 0]) for t in (0.1, 0.3, 0.55, 0.65)]
    by_hand = [0.1 * up, 0.0, 0.05 * down, 0.1 * down + 0.05 * slower]
    assert v == pytest.approx(by_hand, abs=1e-6)
    top = 0.02 * up - 0.5 * (0.2 * up) ** 2 / brake
    assert np.interp(0.4, found.t, found.q[:, 0]) == pytest.approx(top, abs=1e-9)
    assert stop == pytest.approx(next(e.time for e in found.events if e.kind == "stick"), abs=1e-9)
    t, w, (speed,), _ = (part.T for part in with_a_shaft(drive, *ONE, 0.75, LOAD, np.zeros(1)))
    spans = (0.05, 0.15, up), (0.3, 0.45, 0.0), (0.53, 0.59, down), (0.63, 0.69, slower)
    for first, last, a in spans:
        span = (t > first) & (t < last)
        slopes = [np.polyfit(t[span], speeds[span], 1)[0] for speeds in (w, speed)]
        assert slopes == pytest.approx([a, a], abs=2e-3 * abs(slower))
    assert t[(t > 0.7) & (w == 0.0)][0] < 0.72
    for method in "event", "timestepping":
        with pytest.raises(GearJam, match=r"t = 0\.7 s"):
            run(0.8, method=method)


@pytest.mark.parametrize("kind", ["worms", "couples"])
@pytest.mark.parametrize(
    "seeds",
    [range(1, 2), *(pytest.param(x, marks=pytest.mark.slow) for x in (range(2), range(2, 24)))],
)
def test_time_stepping_jams_where_events_do(kind, seeds):
    """It had gone on with a jump to rest, and with any velocity of the other joints."""
    jams = 0
    for seed in seeds:
        scene, q, v, torque, _ = KINDS[kind](np.random.default_rng(seed))
        found = []
        for method in "event", "timestepping":
            try:
                motion = pf.simulate(
                    scene,
                    q,
                    v,
                    t_end=0.2,
                    method=method,
                    motor_torque=lambda t, q, v, torque=torque: torque * np.cos(8.0 * t),
                )
                found.append((motion.v[-1], np.inf))
            except GearJam as problem:
                found.append((np.zeros(len(v)), problem.time))
        (events, first), (steps, second) = found
        assert (first == second == np.inf) or abs(first - second) < 2e-3, seed
        assert_allclose(steps, events, atol=0.02 * max(1.0, np.abs(events).max()))
        jams += first < np.inf
    assert jams >= len(seeds) // 4


@pytest.mark.slow
def test_what_others_hold_does_not_break_away():
    """Friction is shared anew where a gear reaches its limit: it had slipped, then jammed."""
    scene, q, v, torque, _ = KINDS["five-bars"](np.random.default_rng(1002))

    def drive(t, q, v):
        return torque * np.cos(8.0 * t)

    found = pf.simulate(scene, q, v, t_end=0.2, motor_torque=drive)
    assert [event.kind for event in found.events] == ["stick"] * 3
    ends = [
        pf.simulate(scene, q, v, t_end=t_end, motor_torque=drive, method="timestepping").effort[-1]
        for t_end in (0.05, 0.2)
    ]
    assert np.abs(ends[1] - ends[0]).max() > 0.1
    assert_allclose(found.effort[-1], ends[1], rtol=0, atol=2e-3)


# ---------------------------------------------------------------- what a gear at rest holds


def test_a_gear_that_locks_at_small_loads_holds_islands():
    """L rises by 2 t up to 10, then by 0.2: F_- = t - L falls from 0 to -10, then rises by 0.8.

    So F_- <= -5 from t = 5 to 16.25, an island, and from -5/3 down, as far as F_+ >= -5: -28.75.
    """
    curve = {"over_load": [[10.0, 1 / 3], [60.0, 60 / 90]]}
    entry = {"ratio": 1.0, "efficiency": curve, "back_efficiency": "same_loss"}
    gears = gear_table([Transmission(**entry)], [0.0])
    room = np.empty((20, 2))
    for u in np.linspace(-40.0, 40.0, 81) + 0.123:
        count = held_efforts(gears, 0, u, room)
        assert_allclose(room[:count], plain_gear(entry).held(u), rtol=1e-12)
    count = held_efforts(gears, 0, -5.0, room)
    assert_allclose(room[:count], [[-28.75, -5.0 / 3.0], [5.0, 16.25]])


def test_the_judge_finds_both_answers_of_a_worm_and_which_lasts():
    gear = Gear(Loss(((0.0, 0.0),), 1.5), Loss(((0.0, 0.0),), 1.2), (1.0, 1.0), (1.0, 1.0), 1.0)
    one, none = np.eye(1), np.zeros((0, 1))
    system = System(
        10.0 * one, np.array([LOAD]), none, np.zeros(0), one, np.zeros(1), np.array([-0.1]),
        np.array([-15.0]), [gear], none, np.zeros(0), np.zeros(0), [],
    )  # fmt: skip
    found = sorted((float(a[0]), stable) for a, _, stable in answers(system))
    by_hand = sorted(((a, slope > 0.0) for slope, (a, _) in lowered(-15.0).items()))
    assert [stable for _, stable in found] == [stable for _, stable in by_hand]
    assert_allclose([a for a, _ in found], [a for a, _ in by_hand], rtol=1e-12)


# ---------------------------------------------------------------- bad input


def test_a_back_efficiency_that_no_gear_has_is_refused():
    with pytest.raises(
        ValueError, match=r"-3 is at or below -1/efficiency = -2: lead and friction"
    ):
        Transmission(ratio=50.0, efficiency=0.5, back_efficiency=-3.0)
    with pytest.raises(ValueError, match="at or below"):
        Transmission(ratio=50.0, efficiency=0.5, back_efficiency=-2.0)
    Transmission(ratio=50.0, efficiency=0.5, back_efficiency=-1.99)


@pytest.mark.parametrize("five", [False, True], ids=["four-bars", "five-bars"])
def test_friction_beside_gears_that_lock_themselves_is_in_the_box_of_the_tree(five):
    """They hold any load, but friction does no work, and a ring has fewer freedoms than joints."""
    shares = []
    for seed in range(24):
        scene, q, v, torque, _ = bars(np.random.default_rng([87, seed]), five)
        ws = Workspace(scene, None, motors=True)
        with suppress(AccelerationError):
            ws.solve(q, 0.0 * v, torque)
            n = len(ws.modes.stuck)
            tree = Tree(ws.problem, np.ones(n, dtype=bool), np.zeros(n), closed=True)
            if (ws.problem.gear_lines[..., 0] <= 0.0).any() and tree.ends:
                off = np.abs(ws.modes.friction - tree.bounds.middle)
                shares.append((off / tree.bounds.box).max())
    assert len(shares) > 5
    assert max(shares) <= 1.0
