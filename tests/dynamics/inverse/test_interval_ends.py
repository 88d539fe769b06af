"""Ends of efforts where pins and balls stick, and the friction of balls, with loops."""

import dataclasses
import itertools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from cases import (
    Case,
    ball_tripod,
    four_bars_in_a_row,
    resting_four_bar,
    reversing_ball,
    turning_four_bar,
)
from judges.verdict import judge
from mechanisms import (
    add_link,
    bar,
    beside,
    four_bar,
    grounded_model,
    pin_friction,
    shifted,
    two_ball_loops,
)

import pinfric as pf
from pinfric.dynamics.inverse import interval_ends, linkage
from pinfric.dynamics.inverse.interval_ends import MOST_PASSES
from pinfric.dynamics.inverse.solutions import one_sample
from pinfric.dynamics.samples.outcome import Status

# ---------------------------------------------------------------- without drives


@pytest.mark.parametrize("rubbing", ["ABC", "AB", ""])
def test_pins_of_a_structure_that_nothing_drives_have_intervals_all_the_same(rubbing):
    """Two bars that lean on each other; moments about A and B by hand, at all eight corners."""
    model, length, span, g = grounded_model(), 0.3, 0.4, np.array([0.0, -9.81])
    for name, x in (("A", 0.0), ("B", span)):
        add_link(model, 0, pin.JointModelRZ(), shifted(x), name, bar(1.0, length))
    sides = {side: {"link": link, "xyz": [length, 0, 0]} for side, link in (("a", "A"), ("b", "B"))}
    friction = {name: pin_friction(0.1, 0.01, static=0.2) for name in rubbing}
    scene = pf.Scene(
        model=model,
        friction=friction,
        actuators=[],
        loops=[{"name": "C", "kind": "planar_pin", **sides}],
    )
    q = scene.close([0.8, 2.3])
    still = np.zeros((1, 2))
    result = pf.inverse_dynamics(scene, q[None], still, still)
    assert result.effort_lower.shape == (1, 0)
    assert judge(result).passed(1e-12)
    along = length * np.column_stack([np.cos(q), np.sin(q)])
    arms = np.array([[-along[0, 1], along[0, 0]], [along[1, 1], -along[1, 0]]])
    weights = 0.5 * (along[:, 0] * g[1] - along[:, 1] * g[0])
    mu = np.array([0.2 * 0.01 * (name in rubbing) for name in "ABC"])
    every = []
    for signs in itertools.product((-1.0, 1.0), repeat=3):
        x = np.zeros(3)
        for _ in range(60):  # friction at A and B on the bars, at C of the first on the second
            force = np.linalg.solve(arms, -weights - x[:2] - [-x[2], x[2]])
            x = signs * mu * [np.linalg.norm(f) for f in (force + g, force - g, force)]
        every.append([value for value, name in zip(x, "ABC", strict=True) if name in rubbing])
    ends = np.min(every, axis=0), np.max(every, axis=0)
    np.testing.assert_allclose(result.friction_lower[0], ends[0], atol=1e-13)
    np.testing.assert_allclose(result.friction_upper[0], ends[1], atol=1e-13)


# ---------------------------------------------------------------- creeping


@pytest.mark.parametrize("viscous", [0.0, 0.5, 5.0])
@pytest.mark.parametrize("dry", [True, False])
def test_what_slides_just_above_the_stick_velocity_lies_in_the_interval_below_it(viscous, dry):
    """The same states, with a stick velocity above and below their speeds."""
    friction = pin_friction(0.2, 0.02, static=0.25) if dry else {}
    slides, creeps = (
        dataclasses.replace(
            turning_four_bar(
                24, rate=0.2, friction=friction | {"viscous": viscous, "stick_velocity": stick}
            ),
            t=None,
        ).inverse()
        for stick in (1e-6, 10.0)
    )
    assert not slides.sticking.any()
    assert creeps.sticking.all()
    assert (slides.effort_lower == slides.effort_upper).all()
    rounding = 1e-12 * np.abs(slides.effort_lower).max()
    assert (creeps.effort_lower <= slides.effort_lower + rounding).all()
    assert (slides.effort_upper <= creeps.effort_upper + rounding).all()
    assert judge(creeps).passed(1e-10)
    if not dry:  # nothing to stick by: the drag, and no interval
        np.testing.assert_allclose(creeps.effort_upper, slides.effort_upper, atol=rounding)
        np.testing.assert_allclose(creeps.effort_lower, slides.effort_lower, atol=rounding)


def test_a_creeping_balls_sphere_holds_its_drag():
    case = ball_tripod()
    friction = {n: f.model_dump(exclude_unset=True) for n, f in case.scene.friction.items()}
    found = []
    for stick in (1e-6, 100.0):
        for entry in friction.values():
            entry |= {"viscous": 2.0, "stick_velocity": stick}
        scene = dataclasses.replace(case.scene, friction=friction)
        found.append(Case(scene, case.q[:3], case.v[:3], case.a[:3]).inverse())
    slides, creeps = found
    assert creeps.sticking.all()
    assert not slides.sticking.any()
    assert (creeps.effort_lower <= slides.effort_lower).all()
    assert (slides.effort_upper <= creeps.effort_upper).all()
    assert judge(creeps).passed(1e-9)


# ---------------------------------------------------------------- balls


def test_ball_friction_opposes_the_relative_angular_velocity():
    case = ball_tripod()
    result = case.inverse()
    assert judge(result).passed(1e-12)  # checks the vector in frame b, component by component
    ball = result.site_names.index("ball")
    force = np.linalg.norm(result.multipliers[:, 0, :3], axis=1)
    np.testing.assert_allclose(result.normal_load[:, ball], 0.02 * force, rtol=1e-12)
    (solution,) = result.solutions(1)
    assert np.linalg.norm(solution.friction_coordinates[-3:]) == pytest.approx(
        0.3 * result.normal_load[1, ball], rel=1e-12
    )


def test_the_loss_at_a_ball_is_its_moment_times_the_relative_rotation():
    case = ball_tripod()
    result, free = case.inverse(), ball_tripod(mu=0.0).inverse()
    given = ((result.effort_lower - free.effort_lower) * result.actuator_velocity).sum(axis=1)
    data = case.scene.model.createData()
    for i in range(len(case.q)):
        pin.forwardKinematics(case.scene.model, data, case.q[i], case.v[i])
        spin = [
            pin.getVelocity(case.scene.model, data, j, pin.ReferenceFrame.WORLD).angular
            for j in (4, 5)
        ]
        loads = dict(zip(result.site_names, result.normal_load[i], strict=True))
        loss = 0.3 * (
            loads["ball"] * np.linalg.norm(spin[1] - spin[0]) + loads["rocker"] * abs(case.v[i, 4])
        )
        assert given[i] == pytest.approx(loss, rel=1e-10)


def test_a_sticking_balls_ends_are_those_of_its_sphere():
    """Against 20,000 directions of the ball's friction, the pins' limits tried too."""
    case = ball_tripod(mu=0.5, radius=0.05)
    result = Case(case.scene, case.q[:1], 0 * case.v[:1], 0 * case.a[:1]).inverse()
    assert result.sticking.all()
    assert not result.interval_exact[0]
    plan, samples = one_sample(result, 0)
    effort, contact = samples.effort[0], samples.contact[0]
    directions = np.random.default_rng(0).normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for sign in (-1.0, 1.0):
        along = np.column_stack([np.full(len(directions), sign), directions])
        phi = np.zeros((len(directions), 4))
        for _ in range(100):
            forces = contact[:, 0] + np.einsum("tke,mk->mte", contact[:, 1:], phi)
            load = np.linalg.norm(forces, axis=2) @ np.eye(2)[plan.contacts.site]
            phi = along * load[:, plan.entries.site] * [0.5, 0.6, 0.6, 0.6]
        efforts = effort[:, 0] + phi @ effort[:, 1:].T
        low, high = np.minimum(low, efforts.min(axis=0)), np.maximum(high, efforts.max(axis=0))
    width = high - low
    assert (result.effort_lower[0] <= low + 1e-9 * width).all()
    assert (result.effort_upper[0] >= high - 1e-9 * width).all()
    # and not beyond: the samples come close to the sphere's extreme
    np.testing.assert_allclose(result.effort_lower[0], low, atol=2e-3 * width.max())
    np.testing.assert_allclose(result.effort_upper[0], high, atol=2e-3 * width.max())


# ---------------------------------------------------------------- intervals


def test_ends_at_rest_are_the_extremes_of_every_corner():
    """Against all 2^4 corners solved by the independent judge's fixed point, one by one."""
    case = resting_four_bar(5, friction=pin_friction(0.3, 0.05, static=0.4))
    result = case.inverse()
    assert result.interval_exact.all()
    for i in range(len(case.q)):
        plan, samples = one_sample(result, i)
        effort, contact = samples.effort[0, 0], samples.contact[0]
        corners = []
        for corner in np.ndindex(2, 2, 2, 2):
            sign, phi = np.array(corner) * 2.0 - 1, np.zeros(4)
            for _ in range(500):
                forces = contact[:, 0] + np.einsum("tke,k->te", contact[:, 1:], phi)
                load = np.zeros(4)
                np.add.at(load, plan.contacts.site, np.linalg.norm(forces, axis=1))
                phi = sign * 0.4 * load
            corners.append(effort[0] + effort[1:] @ phi)
        assert result.effort_lower[i, 0] == pytest.approx(min(corners), rel=1e-11)
        assert result.effort_upper[i, 0] == pytest.approx(max(corners), rel=1e-11)
    assert judge(result).passed(1e-12)


def test_twenty_mechanisms_beside_each_other_have_the_ends_of_each_alone():
    bars, angles = four_bar(static=0.4)
    q = [bars.close(angles(np.array([1.0 + 0.05 * n, 0.3, 1.2]))) for n in range(20)]
    together, still = np.concatenate(q)[None], np.zeros((1, 60))
    found = pf.inverse_dynamics(beside(*[bars] * 20), together, still, still)
    assert found.interval_exact.all()
    alone = pf.inverse_dynamics(bars, np.array(q), np.zeros((20, 3)), np.zeros((20, 3)))
    for end in ("effort_lower", "effort_upper"):
        np.testing.assert_allclose(getattr(found, end)[0], getattr(alone, end)[:, 0], rtol=1e-11)


def test_inside_the_interval_at_rest_sliding_solutions_tend_to_its_ends():
    """Creeping either way, all pins slide with kinetic = static friction: inside or at an end."""
    rest = resting_four_bar(6).inverse()
    for rate in (1e-4, -1e-4):
        creeping = turning_four_bar(6, rate=rate, acceleration=0.0).inverse()
        slack = 1e-6 * np.abs(rest.effort_upper - rest.effort_lower)
        assert (creeping.effort_lower >= rest.effort_lower - slack).all()
        assert (creeping.effort_upper <= rest.effort_upper + slack).all()


def test_single_flips_find_what_enumeration_finds(monkeypatch):
    """Ten pins at rest: without enumeration and branch and bound the result says so."""
    case = four_bars_in_a_row(radius=0.03)
    exact = case.inverse()
    assert exact.sticking.all()
    assert exact.sticking.shape[1] == 10
    assert exact.interval_exact.all()
    monkeypatch.setattr(interval_ends, "ENUMERATED", 1 << 8)
    monkeypatch.setattr(interval_ends, "NODES", 0)
    with pytest.warns(pf.PinfricWarning, match="may be too narrow"):
        searched = case.inverse()
    assert searched.interval_searched.all()
    assert not searched.interval_exact.any()
    np.testing.assert_allclose(searched.effort_lower, exact.effort_lower, rtol=1e-12)
    np.testing.assert_allclose(searched.effort_upper, exact.effort_upper, rtol=1e-12)
    assert (exact.effort_upper - exact.effort_lower > 0.01).all()


def test_flips_alone_agree_with_enumeration_on_the_four_bar(monkeypatch):
    case = resting_four_bar(40, friction=pin_friction(0.5, 0.03))
    exact = case.inverse()
    monkeypatch.setattr(interval_ends, "ENUMERATED", 1)
    monkeypatch.setattr(interval_ends, "NODES", 0)
    with pytest.warns(pf.PinfricWarning, match="may be too narrow"):
        searched = case.inverse()
    np.testing.assert_allclose(searched.effort_lower, exact.effort_lower, rtol=1e-12)
    np.testing.assert_allclose(searched.effort_upper, exact.effort_upper, rtol=1e-12)


def test_a_reversing_pins_interval_holds_sliding_and_both_limits():
    case = turning_four_bar(400)
    result = case.inverse()
    turning = np.flatnonzero(result.reversal.any(axis=1))
    assert len(turning) >= 2  # pin B and pin C reverse in a turn
    for i in turning:
        (s,) = np.flatnonzero(result.reversal[i])
        before = pf.inverse_dynamics(case.scene, case.q[i], case.v[i], case.a[i])
        assert result.effort_lower[i, 0] <= before.effort_lower[0, 0] <= result.effort_upper[i, 0]
        assert result.friction_lower[i, s] < 0 < result.friction_upper[i, s]
    assert (result.effort_lower == result.effort_upper)[~result.reversal.any(axis=1)].all()


@pytest.mark.parametrize(("large", "small"), [(1e6, 0.3), (4e5, 0.3), (1e3, 1e-4), (10.0, 4e-6)])
def test_a_small_pins_two_limits_are_two_solutions_beside_a_large_one(large, small):
    """The boom slides in a pin of large friction while the stick rests in one of little.

    Compared by the largest friction, the stick's two limits were one solution, and `check` could
    not find the interval's other end (1.49 N of 1.4e6 N in the first case).
    """
    excavator = pf.load_scene("excavator")
    dry = {"boom_pin": large, "stick_pin": small}
    friction = {n: {"coulomb": {"static": c, "kinetic": c}} for n, c in dry.items()}
    friction["stick_pin"] |= {  # its own load, so that nothing is constant
        "bearing": {"kind": "pin", "radius": 0.05},
        "mu": {"static": 1e-12, "kinetic": 1e-12},
    }
    scene = replace(excavator, friction=friction)
    q, v = scene.start_configuration[None], np.array([[0.3, 0.0, 0.0]])
    result = pf.inverse_dynamics(scene, q, v, np.zeros((1, 3)))
    found = result.solutions(0)
    assert len(found) == 2
    held = sorted(solution.friction[1] for solution in found)
    np.testing.assert_allclose(held, [-small, small], rtol=1e-3)
    ends = sorted(solution.effort[1] for solution in found)
    np.testing.assert_allclose(
        ends, [result.effort_lower[0, 1], result.effort_upper[0, 1]], rtol=1e-12
    )
    assert judge(result).passed(1e-12)


@pytest.mark.parametrize("cut", "OABC")
def test_the_interval_encloses_a_third_solution(cut):
    """Wide rough pins: three frictions obey the laws, none of them at a limit of another."""
    friction = pin_friction(2.0, 0.1)
    case = turning_four_bar(60, cut=cut, rate=6.0, acceleration=3.0, friction=friction)
    here = slice(29, 35)
    result = Case(case.scene, case.q[here], case.v[here], case.a[here]).inverse()
    for sample in range(1, 5):
        efforts = [solution.effort[0] for solution in result.solutions(sample)]
        assert len(efforts) == 3
        assert result.effort_lower[sample, 0] == pytest.approx(min(efforts), rel=1e-9)
        assert result.effort_upper[sample, 0] == pytest.approx(max(efforts), rel=1e-9)
    assert judge(result).passed(1e-9)


@pytest.mark.parametrize("most", [2_000, pytest.param(MOST_PASSES, marks=pytest.mark.slow)])
def test_the_search_for_ends_stops_at_its_bound_and_says_so(most, monkeypatch):
    """Three balls at rest whose friction turns for ever, as loads grow with it: contraction 2.5.

    Found among random states of the delta robot.
    """
    for module in (interval_ends, linkage):
        monkeypatch.setattr(module, "MOST_PASSES", most)
    scene, rng = pf.load_scene("delta"), np.random.default_rng(1)
    start, still = scene.start_configuration, np.zeros((1, scene.model.nv))
    q = [start + rng.normal(scale=0.8, size=len(start)) for _ in range(12)][-1]
    with pytest.warns(
        pf.PinfricWarning, match=rf"sample 0: undecided.*{most} passes .*reduce `mu`"
    ):
        found = pf.inverse_dynamics(scene, scene.close(q)[None], still, still)
    assert found.status[0] == Status.NOT_CONVERGED
    assert np.isnan(found.effort_lower).all()
    # the last call's searches from many starts end at the bound, its turns take what one takes
    assert most < found.iterations[0] < 2 * most + 10_000
    assert judge(found).undecided == 1


@pytest.mark.filterwarnings("ignore:.*undecided")
def test_passes_from_many_starts_count_towards_the_bound(monkeypatch):
    """Eight sites, two of them balls: 64 searches in one call took 24 s before they counted."""
    for module in (interval_ends, linkage):
        monkeypatch.setattr(module, "MOST_PASSES", 20_000)
    scene, q, _ = two_ball_loops(0)
    still = np.zeros((1, scene.model.nv))
    found = pf.inverse_dynamics(scene, q[None], still, still)
    assert found.status[0] == Status.NOT_CONVERGED
    assert found.iterations[0] <= 20_000 + 60 * (200 + 64)  # only the last search goes beyond it


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*undecided")
@pytest.mark.parametrize("seed", [0, 4])
def test_a_sample_that_jams_is_not_searched_on(seed):
    scene, q, _ = two_ball_loops(seed)
    still = np.zeros((1, scene.model.nv))
    found = pf.inverse_dynamics(scene, q[None], still, still)
    assert found.status[0] in (Status.JAMMED, Status.NOT_CONVERGED)
    assert found.iterations[0] < 2.2 * MOST_PASSES  # a call begins below the bound, and ends at it


# ---------------------------------------------------------------- loads that friction does not move


@pytest.mark.parametrize("loop", [True, False])
def test_a_block_at_rest_or_turning_round_has_its_own_interval_beside_a_loop_or_alone(loop):
    """At rest -2 <= phi <= 6 N; at 0.1 m/s it slides with -(1 + 30 * 0.1) N, beyond that."""
    if loop:
        scene, _ = four_bar()
        model, loops, q = scene.model.copy(), scene.loops, scene.close(resting_four_bar(1).q[0])
    else:
        model, loops, q = grounded_model(), (), np.zeros(0)
    add_link(model, 0, pin.JointModelPX(), pin.SE3.Identity(), "slide", bar(2.0, 0.0))
    friction = {
        "coulomb": {
            "positive": {"static": 2.0, "kinetic": 1.0},
            "negative": {"static": 6.0, "kinetic": 5.0},
        },
        "viscous": 30.0,
    }
    drives = [{"joint": name} for name in (["O"] if loop else []) + ["slide"]]
    scene = pf.Scene(model=model, loops=loops, friction={"slide": friction}, actuators=drives)
    v, a = np.zeros((2, 4, model.nv))
    v[:, -1], a[:, -1] = [0.3, 0.1, -0.2, 0.0], 0.5
    result = pf.inverse_dynamics(scene, np.tile([*q, 0.0], (4, 1)), v, a, t=np.arange(4.0))
    assert result.reversal[:, 0].tolist() == [False, True, False, False]
    np.testing.assert_allclose(result.effort_lower[:, -1], 1.0 + np.array([10, -6, -11, -6]))
    np.testing.assert_allclose(result.effort_upper[:, -1], 1.0 + np.array([10, 4, -11, 2]))
    assert judge(result).passed(1e-12)


# ---------------------------------------------------------------- balls that turn round


@pytest.mark.parametrize("enumerated", [256, 1])
@pytest.mark.parametrize("viscous", [5.0, 0.0, 0.3, 50.0])
def test_a_ball_that_turns_round_rests_or_slides(viscous, enumerated, monkeypatch):
    """Its viscous friction may exceed what holds it at rest."""
    monkeypatch.setattr(interval_ends, "ENUMERATED", enumerated)
    case = reversing_ball(viscous)
    result = case.inverse()
    assert result.reversal.tolist() == [[False] * 2, [True] * 2, [False] * 2, [False] * 2]
    assert judge(result).passed(1e-12)
    assert (result.effort_upper[1] > result.effort_lower[1] + 0.1).all()
    slides = pf.inverse_dynamics(case.scene, case.q, case.v, case.a)
    assert (slides.effort_lower[1] >= result.effort_lower[1] - 1e-12).all()
    assert (slides.effort_upper[1] <= result.effort_upper[1] + 1e-12).all()
