from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from identify_cases import (
    BACK_EFFICIENCY,
    COULOMB,
    EFFICIENCY,
    KEPT,
    NAMES,
    PLAIN,
    RATIO,
    excitation,
    fit_of,
    guess,
    logged,
    motor_effort,
    one_joint,
    parameter,
    prepared_of,
    rows_of,
    short,
    truth,
)
from identify_wrong_models import FALL, STATIC, found, hits, wrong_log
from scipy.optimize import lsq_linear

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification import advice
from pinfric.identification.advice import advice_text
from pinfric.identification.columns import joint_rows, with_loads
from pinfric.identification.estimate import _at_an_end, _beyond_a_gear, _worse
from pinfric.identification.excitation import Reach, informative_moves
from pinfric.identification.files import posterior_text
from pinfric.identification.findings import HeldOut
from pinfric.identification.information import Criterion
from pinfric.identification.laws import (
    BACKWARD,
    FORWARD,
    GEARS,
    SLOTS,
    STRIBECK,
    STRIBECK_VELOCITY,
    Law,
)
from pinfric.identification.normal import (
    BlockProducts,
    Normal,
    non_negative,
    residuals,
    weighted,
)
from pinfric.identification.parameters import _entries, _rest_excess, parameters, scene_key
from pinfric.identification.stribeck import StribeckFit, with_stribeck
from pinfric.identification.uncertainty import Uncertainty

# Advice: the advised next recording does what was promised.


def test_advice_is_what_a_further_log_does(found):
    again = next(one for one in found.advice if one.name == "As fast as before")
    slow = next(one for one in found.advice if one.name == "At a fifth of the speed")
    key = f"friction.{NAMES[5]}.coulomb.positive"
    assert slow.factors[key] < again.factors[key] < 1.0  # Coulomb friction shows where it is slow
    loaded = next(one for one in found.advice if one.load > 0.0)
    gear = f"transmission.{NAMES[1]}.efficiency"
    assert loaded.factors[gear] < again.factors[gear]


def test_as_much_again_as_was_logged_makes_errors_smaller_by_the_square_root_of_two(monkeypatch):
    rng = np.random.default_rng(2)
    rows = rows_of(rng.normal(size=40), {FORWARD: rng.normal(size=40), 3: rng.normal(size=40)})
    grams = [BlockProducts.of(rows, np.ones(40), 1)]
    problem = SimpleNamespace(weights=np.ones(1), prior=KEPT, slots=lambda laws: [laws[0].slots])
    found = SimpleNamespace(
        scene=one_joint(),
        known=(0,),
        choice=SimpleNamespace(laws=[Law()]),
        problem=problem,
        fit=fit_of({FORWARD: 1.0, 3: 1.0}),
    )
    monkeypatch.setattr(advice, "_grams", lambda *_: grams)
    now = Normal.of(grams, np.ones(1, dtype=bool), np.ones(1))
    factors = advice._weighed(found, now, "the same", (), 0.0).factors
    assert list(factors) == ["friction.arm.coulomb.positive", "friction.arm.viscous"]
    assert list(factors.values()) == pytest.approx([np.sqrt(0.5)] * 2)


def test_advised_postures_are_logged_ones():
    scene, draws = pf.load_scene("three_link"), np.random.default_rng(0)
    q = draws.uniform(size=(50, 3)) * [0.5, 3.0, 1.0]
    reach = Reach(q.min(axis=0), q.max(axis=0), np.ones(3), np.ones(3))
    criterion = Criterion.of(scene, q)
    known = criterion.products(q, *draws.normal(size=(2, 50, 3)))
    points = informative_moves(criterion, known, reach, q, 20.0)
    assert len({point.q for point in points}) > 4
    assert all(np.abs(q - point.q).max(axis=1).min() < 1e-12 for point in points)


def test_the_advised_way_points_run_and_leave_rest_on_their_own(found, tmp_path):
    path = tmp_path / "advice.waypoints.yaml"
    path.write_text(advice_text(found.advice[0], found.scene))
    motion = pf.load_trajectory(path, found.scene)
    assert not motion.warnings
    assert motion.duration > 60.0
    # the first departure: joint 1 alone, its inertia far below its friction
    moving = np.flatnonzero(np.abs(motion.v).sum(axis=1) > 0.0)[:50]
    assert (motion.v[moving, 1:] == 0.0).all()
    assert np.abs(motion.a[moving, 0]).max() < 0.05


# Columns: rows of a joint in all logs.


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_direction_that_hardly_slides_has_the_friction_of_the_other(way):
    """Two logs of one coefficient, 3 N m; efforts lag by 0.05 s behind the motion."""
    t = 0.1 * np.arange(100)
    v = way * np.where(t < 1.0, -1.0, 1.0)
    given = prepared_of(
        v,
        {FORWARD: v > 0.0, BACKWARD: -1.0 * (v < 0.0)},
        effort=lambda s: np.interp(s - 0.05, t, 3.0 * v)[:, None],
    )
    rows = joint_rows([given, given], 0, 0.05)
    taken, other = (FORWARD, BACKWARD) if way > 0.0 else (BACKWARD, FORWARD)
    assert not rows.slots[:, other].any()
    assert 3.0 * rows.slots[:, taken] == pytest.approx(rows.effort)
    assert set(rows.block[rows.log == 0]).isdisjoint(rows.block[rows.log == 1])


def test_a_gears_columns_are_the_load_that_drives_and_the_load_that_is_driven():
    """A pendulum beside which friction takes 5 N m of the motor; loads by Pinocchio's RNEA."""
    scene = one_joint()
    t = 0.1 * np.arange(60)
    motion = pf.Trajectory.from_arrays(
        scene, t, *(x[:, None] for x in (np.sin(t), np.cos(t), -np.sin(t)))
    )
    v, inner = motion.v[:, 0], 5.0 * np.sign(motion.v)
    given = prepared_of(v, {})
    given.recording.trajectory = motion
    slots = with_loads(given, scene, inner).slots[:, 0]
    model, data = scene.model, scene.model.createData()
    effort = np.array(
        [pin.rnea(model, data, *x)[0] for x in zip(motion.q, motion.v, motion.a, strict=True)]
    )
    for side, load in (("motor", effort), ("joint", effort + inner[:, 0])):
        lost, drives = np.sign(v) * np.abs(load), load * v > 0.0
        assert 0.2 < drives.mean() < 0.95
        assert slots[:, GEARS[side, "driving"]] == pytest.approx(lost * drives)
        assert slots[:, GEARS[side, "driven"]] == pytest.approx(lost * ~drives)
        assert slots[:, GEARS[side, "both"]] == pytest.approx(lost)


# Estimate: doubts; estimates at the ends of what is possible.


def test_laws_are_trusted_by_the_squares_of_all_rows():
    """Better at 900 rows by 19 %, worse at 100 rows of the same spread by more than twice."""
    errors = np.array([0.9, 1.5]), np.ones(2)
    rows = [SimpleNamespace(effort=np.zeros(n)) for n in (900, 100)]
    problem = SimpleNamespace(weights=np.ones(2))
    given = SimpleNamespace(rows=rows, problem=problem, errors=errors)
    assert _worse(given).tolist() == [False, False]
    given.rows.reverse()
    assert _worse(given).tolist() == [False, True]  # the other joint keeps its law


def test_of_two_losses_one_that_is_zero_is_the_end_of_the_masses_scale(found):
    """Masses larger by 1/eta leave a gear without loss driving: then one loss is taken.

    So it is where no gear has both, eta_b <= -1/eta.
    """
    one, two = Law(load="gear"), Law(load="gear", both_ways=False)
    driving, driven = GEARS["joint", "driving"], GEARS["joint", "driven"]
    slots = np.zeros((4, len(SLOTS)))
    slots[[0, 2], driven], slots[1, [driving, driven]] = 0.1, (0.05, 0.1)
    choice = replace(found.estimate.choice, laws=(two, two, two, one))
    problem = replace(found.estimate.problem, laws=((one, two), (one, two), (two,), (one, two)))
    fit = replace(found.estimate.fit, slots=slots)
    assert _at_an_end(problem, choice, fit, scale=False) == [0]  # the third was asked for
    assert _at_an_end(problem, choice, fit, scale=True) == []
    for loss, ends in ((2.04, []), (2.06, [1])):  # 1/eta = 1.05
        slots[1, driven] = loss
        assert _at_an_end(problem, choice, fit, scale=True) == ends


@pytest.mark.parametrize(
    ("side", "loss", "stated", "beyond"),
    [
        ("joint", 0.88, False, [0]),
        ("motor", 0.88, False, [0]),
        ("motor", 0.45, False, []),
        ("joint", 0.88, True, []),
    ],
)
def test_a_gear_that_loses_more_than_a_gear_does_is_not_taken(side, loss, stated, beyond):
    """Beside friction that depends on the angle a base's gear "lost" 94 %: unseen error 77 %."""
    gear = Law(exponent=None, load="gear", side=side, both_ways=True)
    slots = np.zeros((1, len(SLOTS)))
    slots[0, GEARS[side, "both"]] = loss
    estimate = SimpleNamespace(
        choice=SimpleNamespace(laws=[gear]),
        fit=SimpleNamespace(slots=slots),
        problem=SimpleNamespace(laws=[[gear] if stated else [Law(), gear]]),
    )
    assert _beyond_a_gear(estimate) == beyond


# Findings: errors of joints; what is found of friction behind a drive belongs to that drive.


def test_errors_are_shares_of_the_effort_and_of_plain_frictions():
    error = HeldOut(rms=2.0, error=1.0, plain=4.0, moving_rms=5.0, moving_error=2.0)
    assert (error.share, error.moving_share, error.of_plain) == (0.5, 0.4, 0.25)
    still = HeldOut(0.0, 1.0, 0.0, 0.0, 1.0)
    assert np.isnan([still.share, still.moving_share, still.of_plain]).all()


def test_friction_seen_through_the_drives_goes_when_other_drives_are_sized(found):
    through = {name for name, entry in found.scene.friction.items() if entry.includes_drive}
    assert through == set(NAMES) - {NAMES[1]}  # its gear's losses grow with it: it is the joint's


# Inertias: inertias of links: physically possible, or kept.


def test_corrected_links_can_exist(found):
    for inertia in tuple(found.scene.model.inertias)[1:]:
        pseudo = pin.PseudoInertia.FromInertia(inertia).toMatrix()
        assert np.linalg.eigvalsh(pseudo)[0] > 0.0
    masses = [inertia.mass for inertia in tuple(found.scene.model.inertias)[1:]]
    guessed = [inertia.mass for inertia in tuple(guess(0).model.inertias)[1:]]
    assert masses != pytest.approx(guessed)


def test_kept_inertias_stay_and_an_effort_behind_the_gear_needs_no_rotor():
    found = pf.identify(truth(), short(), inertia="keep", effort_at="joint", laws=PLAIN)
    assert found.scene.model == truth().model
    assert all(p.section == "friction" for p in found.parameters)
    assert "inertias were kept" in "\n".join(found.notes)


# Laws: candidate laws of joints: gears' losses, joints that never move.


@pytest.mark.slow
def test_both_losses_of_a_gear_show_where_masses_are_known():
    gear = Law(load="gear", both_ways=False)
    laws = PLAIN | {NAMES[1]: gear, NAMES[2]: Law(load="bearing")}
    found = pf.identify(truth(), short(), inertia="keep", laws=laws)
    drives, driven = (
        parameter(found, "transmission", 1, name).value
        for name in ("efficiency", "back_efficiency")
    )
    assert drives == pytest.approx(EFFICIENCY, abs=0.01)
    assert driven == pytest.approx(BACK_EFFICIENCY, abs=0.02)
    transmission = found.scene.drives[1].transmission
    assert (transmission.efficiency, transmission.back_efficiency) == pytest.approx(
        (drives, driven), rel=1e-5
    )


def test_a_gears_loss_shows_beside_friction_that_is_larger_than_the_load():
    """Before, no gear was offered there, and the residual was doubted to depend on the load."""
    elbow, friction = NAMES[2], dict(truth().friction)
    del friction[elbow]
    dry = 25.0 / RATIO
    geared = {"efficiency": 0.85, "back_efficiency": 0.8, "motor_viscous": 7.0 / RATIO**2}
    geared |= {"ratio": RATIO, "no_load_torque": {"static": dry, "kinetic": dry}}
    others = [one for one in truth().actuators if one.joint != elbow]
    scene = truth().with_(
        friction=friction, actuators=[*others, {"joint": elbow, "transmission": geared}]
    )
    motion = excitation(1, 30.0, 125.0)
    laws = {name: Law() for name in NAMES if name != elbow}
    given = logged(1, motion, motor_effort(scene, motion))
    found = pf.identify(guess(1, bearing=False), given, laws=laws)
    load = found.estimate.rows[2].load
    assert np.sqrt(np.mean(load**2)) < 0.6 * 25.0
    assert (found.laws[elbow].load, found.laws[elbow].side) == ("gear", "motor")
    product = parameter(found, "transmission", 2, "efficiency_product")
    assert product.low < 0.85 * 0.8 < product.high
    assert not any("the effort that it transmits" in doubt for doubt in found.doubts)


def test_a_joint_that_never_moves_keeps_what_the_scene_says():
    found = pf.identify(guess(1), short(still=(2,)), laws=PLAIN)
    assert f"keeps the scene's friction: {NAMES[2]}" in "\n".join(found.notes)
    assert found.scene.friction[NAMES[2]] == guess(1).friction[NAMES[2]]
    assert all(p.joint != NAMES[2] for p in found.parameters)
    moves = short(still=(2,))
    frozen = replace(moves, q=np.where(np.arange(6) == 2, moves.q[0], moves.q))
    said = pf.identify(guess(1), frozen, laws=PLAIN).given
    (line,) = (line for line in said if line.startswith("its angle never changes"))
    assert line.endswith(f": {NAMES[2]}")


# Normal: least squares from summed normal equations.


def test_held_out_errors_count_outliers_in_full():
    bursts = np.zeros_like(short().effort)
    bursts[np.arange(len(bursts)) % 200 < 20, 5] = 2.0
    log = replace(short(), effort=short().effort + bursts)
    found = pf.identify(guess(0), log, laws=PLAIN)
    fitted = residuals(found.estimate.rows[5], found.estimate.fit, 5)
    assert found.errors[NAMES[5]].error > np.sqrt(np.mean(fitted**2))


def test_coefficients_are_the_least_squares_that_are_not_negative():
    rng = np.random.default_rng(3)
    A, y = rng.normal(size=(12, 30, 6)), rng.normal(size=(12, 30))
    A[::2, :, 5] += 3.0 * A[::2, :, 4] - 2.0 * A[::2, :, 3]  # columns that hang together
    ours = non_negative(np.einsum("fni,fnj->fij", A, A), np.einsum("fni,fn->fi", A, y))
    for columns, effort, x in zip(A, y, ours, strict=True):
        judge = lsq_linear(columns, effort, (0.0, np.inf), method="bvls", tol=1e-12).x
        assert x == pytest.approx(judge, abs=1e-6)


@pytest.mark.parametrize(("effort", "column", "most"), [(1e-9, 0.0, 1e12), (1e3, 1e3, 1.0)])
def test_an_effort_that_is_fitted_exactly_has_a_weight_with_an_end(effort, column, most):
    """A micro-newton-metre, or a thousandth of the effort: no fit counts as better."""
    rows = rows_of(np.full(9, effort), {FORWARD: column})
    of_rows, of_joint = weighted([rows], fit_of({FORWARD: 1.0}))
    assert (of_rows[0] == 1.0).all()
    assert of_joint == pytest.approx([most], rel=1e-6)


# Parameters: coefficients under the keys of a scene.


@pytest.mark.slow
def test_a_joint_that_moves_one_way_has_the_same_friction_the_other_way():
    motion = excitation(0, 20.0, 100.0)
    t = motion.t
    motion.q[:, 5] = 0.3 * t - 0.25 * np.cos(0.8 * t)
    motion.v[:, 5], motion.a[:, 5] = 0.3 + 0.2 * np.sin(0.8 * t), 0.16 * np.cos(0.8 * t)
    log = pf.Log(t, motion.q, motor_effort(truth(), motion))
    found = pf.identify(guess(0), log, laws=PLAIN)
    assert (
        "hardly slides backward, the Coulomb friction of the other direction is used: "
        f"{NAMES[5]}" in found.notes
    )
    assert not any((p.joint, p.name) == (NAMES[5], "coulomb.negative") for p in found.parameters)
    coulomb = found.scene.friction[NAMES[5]].coulomb
    assert coulomb.negative == coulomb.positive
    assert coulomb.positive.kinetic == pytest.approx(COULOMB[5][0], rel=0.05)
    assert all(np.isfinite(x) for one in found.advice for x in one.factors.values())
    ways = [f"friction.{NAMES[5]}.coulomb.{way}" for way in ("positive", "negative")]
    assert (found.posterior[ways[0]] == found.posterior[ways[1]]).all()
    assert np.ptp(found.posterior[ways[0]]) > 0.0
    assert ways[1] in posterior_text(found).splitlines()[0].split(",")


@pytest.mark.parametrize(
    ("law", "slot", "scene_term"),
    [
        (Law(), FORWARD, lambda x: x),
        (Law(side="motor"), BACKWARD, lambda x: x / 50.0),
        (Law(side="motor"), 3, lambda x: x / 50.0**2),
        (Law(load="gear"), GEARS["joint", "both"], lambda x: 1.0 / (1.0 + x)),
    ],
)
def test_intervals_and_errors_of_a_coefficient_are_those_in_the_scenes_terms(law, slot, scene_term):
    """Of 0.3 with a standard error of 0.01, from eleven blocks: 2.228 of these (Student's)."""
    drive = {"joint": "arm", "transmission": {"ratio": 50.0}}
    scene = one_joint(actuators=[drive])
    found = SimpleNamespace(
        scene=scene,
        known=(0,),
        choice=SimpleNamespace(laws=[law]),
        problem=SimpleNamespace(slots=lambda laws: [laws[0].slots]),
        fit=fit_of({slot: 0.3}),
        question=SimpleNamespace(inertias_stay=True),
        build=None,
    )
    sure = Uncertainty(np.array([slot]), 1e-4 * np.eye(1), np.zeros((1, 1)), 10, 1, np.zeros(1))
    one, *product = (p for p in parameters(found, sure, {}) if not p.why)
    ends = sorted(scene_term(0.3 + x) for x in (-0.02228, 0.02228))
    assert (one.low, one.value, one.high) == pytest.approx(
        (ends[0], scene_term(0.3), ends[1]), rel=1e-4
    )
    slope = (scene_term(0.301) - scene_term(0.299)) / 0.002
    assert one.standard_error == pytest.approx(0.01 * abs(slope), rel=1e-3)
    for p in product:  # (1 - g)/(1 + g) has the slope -2/(1 + g)^2
        spread = 0.01 * 2.0 / 1.3**2
        assert (p.value, p.standard_error) == pytest.approx((0.7 / 1.3, spread))
        assert p.high == pytest.approx(0.7 / 1.3 + 2.228 * spread, rel=1e-4)
    assert len(product) == (law.load == "gear")


@pytest.mark.parametrize(("ratio", "way"), [(0.5, "positive"), (-0.5, "negative")])
def test_a_negative_ratio_turns_the_motors_directions(ratio, way):
    drive = {"joint": "arm", "transmission": {"ratio": ratio}}
    scene = one_joint(actuators=[drive])
    key = scene_key(scene, 0, Law(side="motor"), FORWARD)
    assert key == ("transmission", f"no_load_torque.{way}", "N m")


def test_a_joint_without_friction_gets_no_entry():
    scene = one_joint()
    found = SimpleNamespace(
        scene=scene,
        choice=SimpleNamespace(laws=[Law()]),
        fit=fit_of({}),
        rows=[None],
        question=SimpleNamespace(motor=True),
        build=None,
    )
    assert _entries(found, 0, {}) == ({}, {})


@pytest.mark.parametrize(
    ("exponent", "speed"), [(None, 0.0), (1.0, 0.0), (0.8, 0.01), (0.67, 0.01), (0.33, 0.1)]
)
def test_friction_that_rises_steeply_from_rest_holds_what_slow_sliding_shows(exponent, speed):
    """Before, exponents above a half had none: 97.1 % of a lift's holds were inside, not 98.5 %."""
    law, rows = Law(exponent=exponent), SimpleNamespace(velocity=np.full(9, 0.1))
    slots = 20.0 * np.isin(SLOTS, law.slots[2:])
    expected = 20.0 * speed ** (exponent or 1.0)
    assert _rest_excess(rows, law, slots) == pytest.approx(expected, rel=1e-12)


# Stribeck: stribeck friction is found where it is and only there.


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_the_slope_of_a_fall_is_its_change_with_the_logarithm_of_its_speed(exponent):
    v, speed, size = np.linspace(-0.6, 0.5, 40), 0.2, 1e-5

    def falls(x: float) -> np.ndarray:
        """3 N m at rest forward, 2 N m backward; x: change of the logarithm."""
        left = np.exp(-(np.abs(v / (speed * np.exp(x))) ** exponent))
        return left * np.where(v > 0.0, 3.0, -2.0)

    (columns,) = with_stribeck(
        prepared_of(v, {}), (StribeckFit(speed, exponent, 3.0, 2.0),)
    ).slots.swapaxes(0, 1)
    expected = (falls(size) - falls(-size)) / (2.0 * size)
    assert columns[:, STRIBECK_VELOCITY] == pytest.approx(expected, abs=1e-8)
    assert columns[:, STRIBECK] @ [3.0, 2.0] == pytest.approx(falls(0.0))


@pytest.mark.slow
def test_stribeck_friction_is_identified_as_such():
    one = found("stribeck", stribeck=True)
    inside = hits(one, stribeck=True)
    assert len(inside) == 20 + 18
    assert np.mean(list(inside.values())) >= 0.85, inside
    entry = one.scene.friction[NAMES[0]]
    assert entry.stribeck.velocity == pytest.approx(FALL, rel=0.2)
    assert entry.coulomb.positive.static == pytest.approx(STATIC * COULOMB[0][0], rel=0.1)
    assert entry.coulomb.positive.kinetic == pytest.approx(COULOMB[0][0], rel=0.1)


@pytest.mark.slow
def test_intervals_contain_every_exponent_of_the_fall_that_blocks_do_not_reject():
    one = found("stribeck 1", stribeck=True, seed=704)
    inside = hits(one, stribeck=True)
    assert np.mean(list(inside.values())) >= 0.85, inside
    exponents = [one.scene.friction[name].stribeck.exponent for name in NAMES]
    line = next(line for line in one.notes if "do not tell with which exponent" in line)
    for name, n in zip(NAMES, exponents, strict=True):
        assert n == 1.0 or f"{name} 1, " in line, line  # where another one fits, so does 1


@pytest.mark.slow
def test_stribeck_friction_is_chosen_where_it_is_and_only_there():
    for case, stribeck in (("stribeck", True), ("true", False)):
        one = pf.identify(guess(22), wrong_log(case, 22))
        assert all(law.stribeck == stribeck for law in one.laws.values()), one.laws


# Links: what their masses tell.


@pytest.mark.slow
def test_masses_or_loads_tell_a_zero_that_is_off_by_a_quarter_turn():

    def turned(joint: int, angle: float) -> pf.Log:
        return replace(short(), q=short().q + angle * (np.arange(6) == joint))

    line = next(
        line
        for line in pf.identify(guess(0), turned(3, np.pi / 2), laws=PLAIN).notes
        if line.startswith("masses that differ from the URDF's by more than 50 %")
    )
    assert NAMES[4] in line
    with pytest.raises(IdentificationError, match=f"{NAMES[1]}: its effort is"):
        pf.identify(guess(0), turned(2, -np.pi / 2), laws=PLAIN)


def test_masses_are_said_beside_the_urdfs(found):
    line = next(line for line in found.notes if "kg in the URDF -> found" in line)
    for name, one in zip(NAMES, tuple(found.scene.model.inertias)[1:], strict=True):
        assert re.search(rf"{name} [\d.]+ -> {one.mass:.3g}", line)
    assert not any(line.startswith("masses that differ from the URDF's") for line in found.notes)
