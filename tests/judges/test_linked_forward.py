"""Forward dynamics at one instant of closed mechanisms and of drives off the joints."""

import numpy as np
import pinocchio as pin
import pytest
from cases import (
    ball_tripod,
    boxer,
    drawer_forces,
    drawer_scene,
    four_bar_of_masses,
    four_bars_in_a_row,
    jamming_drawer,
    long_chain,
    painleve_rod,
    resting_four_bar,
    rocker_driven_four_bar,
    slider_crank,
    turning_four_bar,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from judges.planar_newton_euler import FourBar, crank_torque
from mechanisms import four_bar, two_ball_loops

import pinfric as pf
from pinfric.dynamics.forward.workspace import workspace
from pinfric.dynamics.samples.closure import consistent_motion
from pinfric.dynamics.simulation.start import start_state
from pinfric.errors import (
    LoopMotionError,
    NoConsistentAcceleration,
    StateError,
    ToggleError,
    UndecidedAcceleration,
)
from pinfric.friction import search
from pinfric.friction.problem import SearchOutcome
from pinfric.friction.sharing import share

MOVING = {
    "four-bar": lambda: turning_four_bar(6),
    "redundant four-bar": lambda: turning_four_bar(6, kind="revolute", gravity=(2.0, -9.0, 3.0)),
    "slider-crank": lambda: slider_crank([0.4, 1.3, 2.9]),
    "drawer": lambda: jamming_drawer(0.45),
    "ball": ball_tripod,
    "chain held at its tip": lambda: long_chain(25),
    "masses 1, 1e3, 1e6": lambda: four_bar_of_masses(1e3),
    "masses 1, 1e-3, 1e-6": lambda: four_bar_of_masses(1e-3),
}


@pytest.mark.parametrize("case", MOVING)
def test_forward_dynamics_gives_back_what_inverse_dynamics_was_asked_for(case):
    case = MOVING[case]()
    scale = np.abs(case.a).max() + np.abs(case.v).max() ** 2
    for q, v, a in zip(case.q, case.v, case.a, strict=True):  # alone: no reversal in between
        result = pf.inverse_dynamics(case.scene, q[None], v[None], a[None])
        instant = pf.forward_dynamics(case.scene, q, v, result.effort_lower[0])
        assert np.abs(instant.a - a).max() <= 1e-8 * scale
        load = result.normal_load[0]
        assert np.abs(instant.normal_load - load).max() <= 1e-8 * load.max()
        size = np.abs(result.wrench[0]).max()
        assert np.abs(instant.wrench - result.wrench[0]).max() <= 1e-8 * size


def test_a_four_bar_speeds_up_as_newton_and_euler_have_it():
    """Independent: the crank's torque at the acceleration found, by `planar_newton_euler`."""
    scene, _ = four_bar()
    case = turning_four_bar(8)
    for i, angle in enumerate(case.known["angles"]):
        for torque in (-1.0, 0.2, 3.0):
            instant = pf.forward_dynamics(scene, case.q[i], case.v[i], [torque])
            expected = crank_torque(FourBar(), angle, 6.28, float(instant.a[0]))[0]
            assert expected == pytest.approx(torque, abs=1e-9)


@pytest.mark.parametrize("gravity", [(0.0, -9.81, 0.0), (3.0, -8.0, 4.0)])
@pytest.mark.parametrize("rate", [0.0, 6.28])
def test_where_a_redundant_loop_is_cut_does_not_matter(gravity, rate):
    """Also at rest, where four pins share their friction; z moments only in the plane's gravity."""
    accelerations, loads = [], []
    for cut in "ABC":
        case = turning_four_bar(5, cut=cut, kind="revolute", rate=rate, gravity=gravity)
        instants = [
            pf.forward_dynamics(case.scene, q, v, [2.5])
            for q, v in zip(case.q, case.v, strict=True)
        ]
        accelerations.append([i.a[case.scene.drives[0].velocity_index] for i in instants])
        order = [case.scene.site_names.index(pin) for pin in "OABC"]
        loads.append([i.normal_load[order] for i in instants])
    for cut in (1, 2):
        assert accelerations[cut] == pytest.approx(accelerations[0], rel=1e-9)
        assert np.allclose(loads[cut], loads[0], rtol=1e-8)


RESTING = {
    "four-bar": lambda: resting_four_bar(5),
    "static above kinetic": lambda: resting_four_bar(5, static=0.5),
    "ten pins, one freedom": lambda: four_bars_in_a_row(2),
    "redundant": lambda: resting_four_bar(3, kind="revolute", gravity=(1.0, -9.0, 2.0)),
}


@pytest.mark.parametrize("name", RESTING)
def test_a_mechanism_at_rest_breaks_away_where_its_interval_ends(name):
    """Thresholds from both sides; the interval is inverse dynamics', from corners of friction."""
    case = RESTING[name]()
    result = case.inverse()
    for i in range(len(case.q)):
        low, high = result.effort_lower[i, 0], result.effort_upper[i, 0]
        margin = 1e-6 * (high - low)

        def motion(effort, i=i):
            return pf.forward_dynamics(case.scene, case.q[i], case.v[i], [effort])

        for effort in (low + margin, 0.5 * (low + high), high - margin):
            held = motion(effort)
            assert (held.modes == 0).all()
            assert (held.a == 0.0).all()
            assert (np.abs(held.friction) <= 0.5 * held.normal_load + 1e-12).all()
        for effort, way in ((low - margin, -1.0), (high + margin, 1.0)):
            gone = motion(effort)
            assert (gone.modes != 0).all()
            assert way * gone.a[0] > 0.0


def test_pins_that_rest_together_are_used_alike():
    """One freedom: the utilization |friction| / limit of all four is the same (sharing rule)."""
    case = resting_four_bar(3)
    result = case.inverse()
    for i in range(3):
        low, high = result.effort_lower[i, 0], result.effort_upper[i, 0]
        held = pf.forward_dynamics(case.scene, case.q[i], case.v[i], [0.3 * low + 0.7 * high])
        used = np.abs(held.friction) / (0.3 * held.normal_load)
        assert used == pytest.approx([used[0]] * 4, rel=1e-6)  # kinks are rounded so much


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), freedoms=st.integers(1, 4), more=st.integers(1, 5))
def test_shared_friction_is_what_linear_programming_finds(seed, freedoms, more):
    from scipy.optimize import linprog

    rng = np.random.default_rng(seed)
    n = freedoms + more
    A, b = rng.normal(size=(freedoms, n)), rng.normal(size=freedoms)
    limit = rng.uniform(0.1, 2.0, n)
    x, _ = share(A, b, limit, np.arange(n))
    assert A @ x == pytest.approx(b, abs=1e-9)
    # least t with A x = b, |x_k| <= t limit_k
    bound = np.block([[np.eye(n), -limit[:, None]], [-np.eye(n), -limit[:, None]]])
    best = linprog(
        np.r_[np.zeros(n), 1.0],
        bound,
        np.zeros(2 * n),
        np.column_stack([A, np.zeros(freedoms)]),
        b,
        bounds=[(None, None)] * (n + 1),
    )
    assert (np.abs(x) / limit).max() == pytest.approx(best.x[-1], rel=1e-4)


def test_a_ball_at_rest_holds_by_its_sphere():
    """The support function of the ball's limit, by inverse dynamics, on a path through the rest."""
    case = ball_tripod()
    q, zero = case.q[:1], 0 * case.v[:1]
    result = pf.inverse_dynamics(case.scene, q, zero, zero)
    middle = 0.5 * (result.effort_lower[0] + result.effort_upper[0])
    width = result.effort_upper[0] - result.effort_lower[0]
    held = pf.forward_dynamics(case.scene, q[0], zero[0], middle)
    assert (held.modes == 0).all()
    for axis in range(2):  # beyond its own interval no friction holds, whatever the others do
        for side in (-1.0, 1.0):
            effort = middle.copy()
            effort[axis] += side * 0.5001 * width[axis]
            gone = pf.forward_dynamics(case.scene, q[0], zero[0], effort)
            assert (gone.modes != 0).any()
            assert np.abs(gone.a).max() > 0.0


def test_a_ball_that_slips_from_rest_rubs_against_its_motion():
    """friction . (angular acceleration) = - mu radius |F| |angular acceleration|."""
    case = ball_tripod()
    q, zero = case.q[0], 0 * case.v[0]
    effort = case.inverse().effort_lower[0] + [3.0, -2.0]
    instant = pf.forward_dynamics(case.scene, q, zero, effort)
    after = 1e-7 * instant.a
    moving = pf.forward_dynamics(case.scene, q, after, effort)
    assert instant.a == pytest.approx(moving.a, rel=1e-4)
    ball = case.scene.site_names.index("ball")
    assert instant.friction[ball] == pytest.approx(-0.3 * instant.normal_load[ball], rel=1e-9)


@pytest.mark.parametrize("mu", [0.49, 0.499, 0.501, 0.6])
def test_the_pushed_drawer_at_its_critical_mu(mu):
    """Force -> acceleration -> force, below mu = length / (2 offset); beyond, the push jams it."""
    scene = drawer_scene(mu)
    load = np.array([0.0]), np.array([0.1])
    if mu < 0.5:
        push = drawer_forces(mu, 2.0)[0]
        instant = pf.forward_dynamics(scene, *load, [push])
        assert instant.a[0] == pytest.approx(2.0, rel=1e-9)
        assert instant.contraction < 1.0
    else:  # a hard push brakes it: friction grows faster than the force
        gentle = pf.forward_dynamics(scene, *load, [100.0])
        hard = pf.forward_dynamics(scene, *load, [1000.0])
        assert hard.a[0] < gentle.a[0] < 0.0
        assert hard.contraction == pytest.approx(0.0)  # the push is given: nothing to iterate


# Safeguard: every solution's residual is verified. Without (any residual will do): two solutions
# are claimed beyond mu_crit, where there is none.
@pytest.mark.parametrize("tangent", [1.0, 2.0, 3.5])
def test_the_painleve_rod_at_its_critical_mu(tangent):
    """mu_crit = (1 + 3 cos^2 t) / (3 sin t cos t), least 4/3 at tan t = 2; from both sides."""
    t = np.arctan(tangent)
    critical = (1 + 3 * np.cos(t) ** 2) / (3 * np.sin(t) * np.cos(t))
    assert critical >= 4.0 / 3.0 - 1e-15
    if tangent == 2.0:
        assert critical == pytest.approx(4.0 / 3.0)
    below = painleve_rod((1 - 1e-6) * critical, t)
    instant = pf.forward_dynamics(below.scene, below.q[0], below.v[0], [0.0, 0.0])
    assert instant.contraction == pytest.approx(1 - 1e-6, abs=1e-9)
    # the closed form: N (1 - mu / mu_crit) = what the rod presses without friction
    assert instant.normal_load[0] == pytest.approx(below.known["free"] / 1e-6, rel=1e-6)
    above = painleve_rod((1 + 1e-6) * critical, t)
    with pytest.raises(NoConsistentAcceleration):
        pf.forward_dynamics(above.scene, above.q[0], above.v[0], [0.0, 0.0])


# Safeguard: joints that can only move together share their friction. Without (each held by its own
# equation, which is the same one): AmbiguousAcceleration.
@pytest.mark.parametrize("side", [-1, 1])
def test_a_rocker_driven_near_its_toggle_holds_against_any_push(side):
    """Self-locking: |x| <= limit(x) for however large a torque; farther off it gives way."""
    push = 1e4 * side
    near = rocker_driven_four_bar([0.02])
    held = pf.forward_dynamics(near.scene, near.q[0], 0 * near.v[0], [push])
    assert (held.modes == 0).all()
    assert (held.a == 0.0).all()
    far = rocker_driven_four_bar([0.6])
    moves = pf.forward_dynamics(far.scene, far.q[0], 0 * far.v[0], [push])
    assert np.abs(moves.a).max() > 0.0


def test_a_toggle_with_more_freedoms_is_named():
    """A parallelogram laid flat: crank and rocker may now turn in opposite directions."""
    scene = parallelogram()
    with pytest.raises(ToggleError, match=r"wrist.*2 degrees of freedom here and 1 elsewhere"):
        pf.forward_dynamics(scene, np.zeros(3), np.zeros(3), [0.0])


def parallelogram(**friction):
    from judges.test_linked_simulate import parallelogram_scene

    return parallelogram_scene(**friction)


def test_without_friction_multipliers_are_those_of_inverse_dynamics():
    case = turning_four_bar(4, friction={})
    result = case.inverse()
    for i in range(4):
        instant = pf.forward_dynamics(case.scene, case.q[i], case.v[i], result.effort_lower[i])
        force = result.multipliers[i, 0, :3]  # of a on b, in frame b
        assert np.linalg.norm(instant.multipliers) == pytest.approx(np.linalg.norm(force))


def test_without_friction_it_is_pinocchio_s_constrained_dynamics():
    """Spherical loops as `RigidConstraintModel`s: accelerations and forces of the delta."""
    scene = pf.load_scene("delta")
    scene = pf.Scene(
        model=scene.model, loops=scene.loops, actuators=scene.actuators, simulation=scene.simulation
    )
    model, linkage = scene.model, scene.linkage
    data = model.createData()
    constraints = pin.StdVec_RigidConstraintModel()
    for pair in range(len(scene.loops)):
        sides = [
            (
                int(linkage.frame_joint[pair, s]) + 1,
                pin.SE3(linkage.frame_R[pair, s], linkage.frame_p[pair, s]),
            )
            for s in (0, 1)
        ]
        constraints.append(
            pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D, model, *sides[0], *sides[1], pin.ReferenceFrame.LOCAL
            )
        )
    datas = pin.StdVec_RigidConstraintData()
    datas.extend(constraint.createData() for constraint in constraints)
    pin.initConstraintDynamics(model, data, constraints, datas)
    q0, _ = start_state(scene)
    leading = [drive.name for drive in scene.drives]
    rng = np.random.default_rng(7)
    for _ in range(5):
        guess = q0.copy()
        guess[[drive.velocity_index for drive in scene.drives]] += rng.uniform(-0.2, 0.2, 3)
        q = scene.close(guess, leading)
        v, _ = consistent_motion(scene, q[None], leading, rng.normal(size=(1, 3)), np.zeros((1, 3)))
        effort = rng.normal(size=3)
        tau = np.zeros(model.nv)
        tau[[drive.velocity_index for drive in scene.drives]] = effort
        expected = pin.constraintDynamics(
            model, data, q, v[0], tau, constraints, datas, pin.ProximalSettings(1e-14, 0.0, 20)
        )
        instant = pf.forward_dynamics(scene, q, v[0], effort)
        scale = np.abs(expected).max()
        assert np.abs(instant.a - expected).max() <= 1e-9 * scale
        for pair, constraint in enumerate(datas):
            force = np.linalg.norm(instant.multipliers[3 * pair : 3 * pair + 3])
            assert force == pytest.approx(np.linalg.norm(constraint.contact_force.linear), rel=1e-8)


# ---------------------------------------------------------------- what a reviewer found


# Safeguard: only joints beyond their limits by more than rounding decide which break away. Without:
# the crank is held by friction 16 times its limit, status CONVERGED.
def test_a_brake_is_overcome_although_nothing_loads_the_pins():
    """No gravity: all loads are rounding, and 0.05 N m at the crank is all that holds."""
    case = boxer(cylinders=1, angle=1.0)
    held = pf.forward_dynamics(case.scene, case.q[0], 0 * case.v[0], [0.04])
    assert (held.a == 0.0).all()
    gone = pf.forward_dynamics(case.scene, case.q[0], 0 * case.v[0], [0.8])
    assert gone.a[0] > 10.0
    assert (gone.modes != 0).all()


def test_viscous_friction_beside_a_ball_opposes_the_motion():
    case = ball_tripod()
    friction = {**case.scene.friction, "arm": {"viscous": 0.5}}
    scene = pf.Scene(
        model=case.scene.model,
        loops=case.scene.loops,
        friction=friction,
        actuators=case.scene.actuators,
    )
    arm = scene.site_names.index("arm")
    for q, v in zip(case.q, case.v, strict=True):
        instant = pf.forward_dynamics(scene, q, v, [0.0, 0.0])
        assert instant.friction[arm] == pytest.approx(-0.5 * v[0], rel=1e-12)


# Safeguard: as for the boxer in time. Without: NoConsistentAcceleration at and beside the centre.
@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-9, 1e-7, 1e-5])
@pytest.mark.parametrize("rate", [0.0, 1.0, 10.0])
def test_two_pistons_pass_their_dead_centres_at_once(offset, rate):
    """Opposed pistons at rest while the crank turns: the limit from both sides, and at rest."""
    case = boxer(cylinders=2, angle=offset, rate=rate)
    beside = boxer(cylinders=2, angle=3e-5, rate=rate)
    instants = [pf.forward_dynamics(c.scene, c.q[0], c.v[0], [0.8]) for c in (case, beside)]
    assert instants[0].a[0] == pytest.approx(instants[1].a[0], rel=1e-3)
    pistons = [case.scene.site_names.index(f"piston_{k}") for k in (1, 2)]
    assert (instants[0].modes[pistons] == -1).all()  # both leave inwards


def test_states_that_are_open_or_not_numbers_are_refused_by_name():
    case = turning_four_bar(1)
    q, v = case.q[0], case.v[0]
    with pytest.raises(LoopMotionError, match=r"'B' is open.*by 0\.0"):
        pf.forward_dynamics(case.scene, q + 0.1, v, [0.0])
    with pytest.raises(LoopMotionError, match=r"'B' is violated by the velocities"):
        pf.forward_dynamics(case.scene, q, v + 0.1, [0.0])
    for name, state in (
        ("q", (q * np.nan, v, [0.0])),
        ("v", (q, v * np.nan, [0.0])),
        ("effort", (q, v, [np.inf])),
    ):
        with pytest.raises(StateError, match=f"{name}: column 0 is"):
            pf.forward_dynamics(case.scene, *state)


def check_obeys(scene, found):
    """Check that an instant at rest obeys the laws by plain formulas: limits, and ways of slip."""
    for s, site in enumerate(scene.sites):
        load, friction, law = found.normal_load[s], found.friction[s], site.friction.mu
        if found.modes[s] == 0:
            assert abs(friction) <= law.static * load * (1 + 1e-6)
        else:
            assert abs(friction) == pytest.approx(law.kinetic * load, rel=1e-6)
            if not site.ball:
                assert friction * found.modes[s] <= 0.0
                if site.velocity_index >= 0 and site.joint >= 0:
                    assert found.a[site.velocity_index] * found.modes[s] >= -1e-9


@pytest.mark.parametrize("seed", range(1, 5))
def test_eight_sites_two_of_them_balls_at_rest_are_decided_by_few_solves(seed, monkeypatch):
    """Two freedoms: of 3^6 2^2 choices kinematics leaves some dozens; all took minutes."""
    solves = []
    plain = search.solve_modes
    monkeypatch.setattr(
        search, "solve_modes", lambda *given, **more: solves.append(1) or plain(*given, **more)
    )
    scene, q, rng = two_ball_loops(seed)
    effort = rng.normal(scale=8.0, size=2)
    found = pf.forward_dynamics(scene, q, np.zeros(8), effort)
    check_obeys(scene, found)
    assert len(solves) < 1000


def test_balls_hold_with_friction_that_loads_them():
    """Limits that did not follow their friction were exceeded: the mechanism was said to move."""
    scene, q, rng = two_ball_loops(1)
    found = pf.forward_dynamics(scene, q, np.zeros(8), rng.normal(scale=8.0, size=2))
    assert not found.modes.any()
    check_obeys(scene, found)
    p, x = workspace(scene).problem, workspace(scene).modes.friction
    left = p.rate_free + p.rate_slope @ x  # in equilibrium
    np.testing.assert_allclose(left, 0.0, atol=1e-9 * np.abs(p.rate_free).max())


def test_a_search_that_comes_to_its_bound_says_so(monkeypatch):
    scene, q, rng = two_ball_loops(3)
    monkeypatch.setattr(search, "MOST_PASSES", 0)
    monkeypatch.setattr(search, "guess_modes", lambda *_: None)
    says = r"0 in \d+ modes? tried of 2916; the direction in which a ball slips is searched"
    with pytest.raises(UndecidedAcceleration, match=says):
        pf.forward_dynamics(scene, q, np.zeros(8), rng.normal(scale=8.0, size=2))


@pytest.mark.parametrize("count", [2, 3, 5])
def test_however_many_solutions_obey_it_is_ambiguous(count):
    assert search.outcome_of(count, count) == SearchOutcome.AMBIGUOUS
