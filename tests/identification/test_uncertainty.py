"""Differences between logs, and friction at rest, against figures worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from identify_cases import (
    BACK_EFFICIENCY,
    DELAY,
    EFFICIENCY,
    KEPT,
    MU,
    NAMES,
    PIN,
    PLAIN,
    RATIO,
    VISCOUS,
    excitation,
    fit_of,
    guess,
    one_joint,
    parameter,
    prepared_of,
    rows_of,
    short,
    true_friction,
)

import pinfric as pf
from pinfric.identification.choice import Problem
from pinfric.identification.columns import shares
from pinfric.identification.files import scene_text
from pinfric.identification.laws import (
    BACKWARD,
    FORWARD,
    GEARS,
    SLOTS,
    STRIBECK,
    STRIBECK_VELOCITY,
    Law,
)
from pinfric.identification.misfit import TIME, Misfit
from pinfric.identification.normal import BlockProducts, FrictionNormalEquations, Prior
from pinfric.identification.stribeck import StribeckFit, with_stribeck
from pinfric.identification.uncertainty import (
    Uncertainty,
    _drifts,
    _other_exponents,
    _other_ways,
    between_logs,
    bias,
    for_a_further_log,
    uncertainty,
)
from pinfric.identification.ways import Build, Way


@pytest.mark.parametrize(
    ("factors", "spread"),
    [
        # means 1.0 and 1.2, variance 0.02; blocks: variance 0.02 over 2 each, 0.01 taken off
        ([[1.1, 0.9], [1.3, 1.1]], 0.1),
        ([[1.0, 1.0], [1.2, 1.2]], np.sqrt(0.02)),
        ([[1.3, 0.7], [1.2, 0.8]], 0.0),
    ],
)
def test_what_blocks_of_one_log_scatter_is_no_difference_between_logs(factors, spread):
    """One joint with 2 N m of Coulomb friction, ten rows in each block."""
    effort, block = 2.0 * np.repeat(np.ravel(factors), 10), np.repeat(np.arange(4), 10)
    rows = rows_of(effort, {FORWARD: 1.0}, block=block, log=block // 2)
    found = SimpleNamespace(prepared=[None, None], rows=[rows], fit=fit_of({FORWARD: 2.0}))
    assert between_logs(found) == pytest.approx([spread], abs=1e-9)


def test_coefficients_lie_in_their_intervals(found):
    known = [
        (parameter(found, "friction", 2, "mu"), MU),
        (parameter(found, "transmission", 1, "efficiency_product"), EFFICIENCY * BACK_EFFICIENCY),
    ]
    alone = parameter(found, "transmission", 1, "efficiency")  # the scale of masses is free
    assert not alone.determined
    assert alone.low < EFFICIENCY < alone.high
    assert f"of both directions {known[1][0].value:.4g}" in scene_text(
        found, found.scene.robot, Path()
    )
    known += true_friction(found)
    inside = [p.low <= value <= p.high for p, value in known]
    assert np.mean(inside) > 0.8
    assert all(abs(p.value - value) < 0.15 * abs(value) for p, value in known)
    # standard errors of samples taken as independent would be three times too small
    assert parameter(found, "friction", 1, "coulomb.positive").standard_error > 0.1


def test_the_posterior_scatters_as_the_intervals_say(found):
    p = parameter(found, "friction", 1, "coulomb.positive")
    draws = found.posterior[p.key]
    assert np.mean((draws > p.low) & (draws < p.high)) == pytest.approx(0.95, abs=0.03)


def test_a_gear_that_loses_more_leaves_less_to_coulomb_friction():
    """A pendulum of known mass, against (A^T A)^-1 of its four columns."""
    t = np.arange(0.0, 40.0, 0.01)
    q = (1.2 * np.sin(1.3 * t) + 0.7 * np.sin(0.47 * t))[:, None]
    friction = {"arm": {"coulomb": {"static": 0.5, "kinetic": 0.5}, "viscous": 0.2}}
    drive = {"ratio": RATIO, "efficiency": 0.8, "back_efficiency": "same_loss"}
    scene = one_joint(friction=friction, actuators=[{"joint": "arm", "transmission": drive}])
    motion = pf.Trajectory.from_arrays(scene, t, q)
    result = pf.inverse_dynamics(scene, motion)
    effort = 0.5 * RATIO * (result.motor_torque_lower + result.motor_torque_upper)
    given = pf.Log(t, q, effort + 0.3 * np.random.default_rng(2).normal(size=effort.shape))
    plain = one_joint(actuators=[{"joint": "arm", "transmission": {"ratio": RATIO}}])
    found = pf.identify(plain, given, inertia="keep", laws={"arm": Law(load="gear")})
    known = uncertainty(found.estimate)
    own = np.searchsorted(known.place, [FORWARD, GEARS["joint", "both"]])
    (c, both), (_, g) = known.within[np.ix_(own, own)]
    assert both < -0.25 * np.sqrt(c * g)
    v, load = motion.v[:, 0], np.abs(result.effort_frictionless[:, 0])
    A = np.column_stack((v > 0.0, -1.0 * (v < 0.0), v, load * np.sign(v)))[np.abs(v) > 0.05]
    covariance = np.linalg.inv(A.T @ A)
    alone = covariance[0, 3] / np.sqrt(covariance[0, 0] * covariance[3, 3])
    assert both / np.sqrt(c * g) == pytest.approx(alone, abs=0.1)


def test_an_interval_covers_both_laws_where_logs_do_not_tell_whether_a_load_counts():
    """A pendulum of known mass on a pin: no bearing is chosen, and 0.7 N m are fitted for 0.5."""
    t = np.arange(0.0, 60.0, 0.01)
    q = (0.9 * np.sin(1.3 * t) + 0.7 * np.sin(0.47 * t))[:, None]
    bearing = {"bearing": PIN, "mu": {"static": 0.2, "kinetic": 0.2}}
    rough = {"coulomb": {"static": 0.5, "kinetic": 0.5}, "viscous": 0.2}
    scene = one_joint(friction={"arm": rough | bearing})
    motion = pf.Trajectory.from_arrays(scene, t, q)
    effort = pf.inverse_dynamics(scene, motion).effort_lower
    given = pf.Log(t, q, effort + 0.3 * np.random.default_rng(2).normal(size=effort.shape))
    found = pf.identify(one_joint(friction={"arm": bearing}), given, inertia="keep")
    assert found.laws["arm"] == Law()
    for p in (p for p in found.parameters if p.name.startswith("coulomb")):
        assert 0.4 < p.low < 0.5 < 0.68 < p.value < p.high < 1.0  # was 0.67 to 0.72


@pytest.mark.slow
def test_two_logs_say_how_much_friction_differs_between_them():
    other = short(3)
    warm = replace(other, effort=other.effort - 0.3 * drag(3, 20.0, 100.0), name="warm")
    found = pf.identify(guess(0), [short(), warm], laws=PLAIN)
    # a third of joint 6's viscous friction was taken off in one of them, and it is most of it
    assert 0.05 < found.spread[NAMES[5]] < 0.25
    assert found.delay == pytest.approx(DELAY, abs=0.0015)
    assert "delay of the efforts from each log, with standard error: log " in "\n".join(found.notes)
    viscous = parameter(found, "friction", 5, "viscous")
    assert viscous.standard_error > 0.8 * found.spread[NAMES[5]] * viscous.value


def drag(seed: int, duration: float, rate: float) -> np.ndarray:
    return excitation(seed, duration, rate).v * np.array(VISCOUS)


@pytest.mark.parametrize("logs", [2, 3, 5])
def test_an_interval_covers_a_further_log(logs):
    """Coulomb friction of 2 N m, times a factor that scatters by 5 % from log to log."""
    rng, slot, inside, fit = np.random.default_rng(logs), FORWARD, [], fit_of({FORWARD: 2.0})
    of_row = {"block": np.repeat(np.arange(2 * logs), 2), "log": np.repeat(np.arange(logs), 4)}
    for _ in range(600):
        factors = 1.0 + 0.05 * rng.normal(size=logs + 1)
        effort = 2.0 * np.repeat(factors[:-1] / factors[:-1].mean(), 4)
        rows = [rows_of(effort, {slot: 1.0}, **of_row)]
        given = SimpleNamespace(rows=rows, fit=fit, prepared=[None] * logs)
        between, count = for_a_further_log(given, np.array([slot]))
        known = Uncertainty(np.array([slot]), 1e-12 * np.eye(1), between, 20, count, np.zeros(1))
        _, reach = known.of({slot: 1.0})
        inside.append(abs(2.0 * factors[-1] / factors[:-1].mean() - 2.0) <= reach)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)


def test_a_bias_is_by_how_much_the_shape_changes_least_squares():
    """Of all rows, the prior as rows of its own; solved with and without the shape's columns."""
    rng, n, p, viscous = np.random.default_rng(6), 60, 2, 3
    rigid, own, shape = (rng.normal(size=(n, k)) for k in (p, 2, 2))
    effort, weight = own @ [5.0, 4.0] + shape @ [0.3, -0.2], rng.uniform(0.1, 1.0, n)
    rows = rows_of(effort, {FORWARD: own[:, 0], viscous: own[:, 1]}, rigid)
    prior = Prior(np.array([0.5, -0.5]), np.array([0.3, 2.0]), np.ones(p))
    drawn = np.sqrt(n * prior.weight)

    def solved(*columns: np.ndarray) -> np.ndarray:
        left = np.hstack((rigid, own, *columns)) * np.sqrt(4.0 * weight)[:, None]
        left = np.vstack((left, np.eye(p, left.shape[1]) * drawn[:, None]))
        right = np.append(effort * np.sqrt(4.0 * weight), drawn * prior.center)
        return np.linalg.lstsq(left, right)[0][: p + 2]

    alone, place = solved(), np.array([FORWARD, viscous])
    found = SimpleNamespace(
        rows=[rows],
        row_weights=[weight],
        fit=fit_of(dict(zip(place.tolist(), alone[p:], strict=True)), alone[:p]),
        problem=Problem(
            grams=[BlockProducts.of(rows, weight, 1)],
            weights=np.array([4.0]),
            prior=prior,
            laws=(),
            folds=np.zeros(1, dtype=int),
            rotor=False,
        ),
    )
    normal = found.problem.normal()
    free = FrictionNormalEquations(normal, prior).fit([place])
    assert np.append(free.theta, free.slots[0, place]) == pytest.approx(alone, rel=1e-6)
    expected = (solved(shape) - alone)[p:]
    assert bias(found, [Misfit(0, "", 1.0, 1.0, shape, 2)], place) == pytest.approx(
        expected, rel=1e-6
    )


def test_draws_scatter_by_both_covariances_and_by_their_few_samples():
    """Student's t of n degrees of freedom has the variance n/(n - 2)."""
    place, own, other = np.array([FORWARD, 3]), np.array([[4.0, 1.0], [1.0, 9.0]]), np.eye(2)
    values = 100.0 + np.arange(float(len(SLOTS)))[None, :]
    draws = Uncertainty(place, own, other, 10, 8, np.zeros(1)).draws(values, 40_000, 1)
    assert np.cov(draws[:, place].T) == pytest.approx(own * 10 / 8 + other * 7 / 5, abs=0.3)
    assert draws.mean(axis=0) == pytest.approx(values[0], abs=0.1)
    assert draws[0, 5] == values[0, 5]


def test_another_exponent_changes_the_coefficients_as_a_fit_beside_that_fall():
    v = np.linspace(-1.0, 1.0, 80)
    fall, other = StribeckFit(0.2, 1.0, 3.0, 2.0), StribeckFit(0.3, 2.0, 2.0, 1.5)
    columns = {FORWARD: 1.0 * (v > 0.0), BACKWARD: -1.0 * (v < 0.0), 3: v}
    given = with_stribeck(prepared_of(v, columns), (fall,))
    rows, rest = rows_of(5.0 * v, dict(enumerate(given.slots[:, 0].T))), [FORWARD, BACKWARD, 3]
    weight = np.random.default_rng(0).uniform(0.1, 1.0, v.size)

    def beside(one: StribeckFit) -> np.ndarray:
        """Least squares of the others, this fall taken as known."""
        left = np.exp(-(np.abs(v / one.velocity) ** one.exponent))
        y = rows.effort - left * np.where(v > 0.0, one.forward, -one.backward)
        root = np.sqrt(weight)
        return np.linalg.lstsq(rows.slots[:, rest] * root[:, None], y * root)[0]

    place = np.sort([*rest, *STRIBECK, STRIBECK_VELOCITY])
    found = SimpleNamespace(
        stribeck=[replace(fall, others=(other,))],
        choice=SimpleNamespace(laws=[Law(stribeck=True)]),
        prepared=[given],
        rows=[rows],
        row_weights=[weight],
        fit=fit_of({}),
        problem=problem_of(rows, weight),
    )
    (off,) = _other_exponents(found, place)
    expected = dict(zip(rest, beside(other) - beside(fall), strict=True))
    expected |= dict(zip([*STRIBECK, STRIBECK_VELOCITY], [-1.0, -0.5, np.log(1.5)], strict=True))
    assert off == pytest.approx([expected[slot] for slot in place], rel=1e-5)


def problem_of(rows: object, weight: np.ndarray) -> Problem:
    """One joint whose links are kept, all its rows in one block."""
    return Problem(
        grams=[BlockProducts.of(rows, weight, 1)],
        weights=np.ones(1),
        prior=KEPT,
        laws=(),
        folds=np.zeros(1, dtype=int),
        rotor=False,
    )


def hand_made(v: np.ndarray, effort: np.ndarray, columns: dict, log: object, **more: object):
    """An estimate of one joint whose links are kept: its rows, weights and problem."""
    rows = rows_of(effort, columns, velocity=v)
    weight = np.random.default_rng(0).uniform(0.1, 1.0, v.size)
    problem = problem_of(rows, weight)
    return SimpleNamespace(
        prepared=[log], rows=[rows], row_weights=[weight], problem=problem, **more
    )


def test_friction_that_drifts_is_uncertain_by_its_farther_end():
    t = np.linspace(-1.0, 1.0, 400)
    v = np.sin(40.0 * t)
    columns = {FORWARD: 1.0 * (v > 0.0), BACKWARD: -1.0 * (v < 0.0), 3: v}
    changes = {FORWARD: (1.0, 0.3), BACKWARD: (-0.5, 0.0), 3: (0.0, 0.6)}
    effort = sum(
        columns[slot] * (5.0 + a * t + b * (t**2 - 1.0 / 3.0)) for slot, (a, b) in changes.items()
    )
    log, fit = prepared_of(v, columns, slides=np.ones((v.size, 1), dtype=bool)), fit_of({3: 5.0})
    given, place = hand_made(v, effort, columns, log, fit=fit), np.array(sorted(columns))
    (off,) = _drifts(given, [Misfit(0, TIME, 1.0, 1.0, v[:, None], 1)], place)
    ends = {slot: abs(a) + b * 2.0 / 3.0 for slot, (a, b) in changes.items()}
    assert off * np.sqrt(3.0) == pytest.approx([ends[slot] for slot in place], rel=1e-6)
    assert not list(_drifts(given, [Misfit(0, "the speed", 1.0, 1.0, v[:, None], 1)], place))


def test_errors_of_a_way_and_of_the_delay_change_coefficients_as_fits_beside_them():
    t = 0.1 * np.arange(300)
    q, v = np.sin(t), np.cos(t)
    way, late = Way(0.2, 0.1, gradual=True, gain=0.5), 0.01
    log = prepared_of(v, {}, slides=np.ones((v.size, 1), dtype=bool))
    log.recording.position = q[:, None]

    def columns(d: float) -> dict[int, np.ndarray]:
        z = shares(log.recording, 0, d, gradual=True)
        return {FORWARD: np.maximum(z, 0.0), BACKWARD: np.minimum(z, 0.0), 3: v}

    truth, place = np.array([5.0, 4.0, 2.0]), np.array([FORWARD, BACKWARD, 3])
    own, longer = (np.array(list(columns(d).values())).T for d in (0.2, 0.2 * np.exp(0.1)))
    rates = np.gradient(own, t, axis=0)
    log.slot_rates[:, 0, place] = rates
    given = hand_made(
        v,
        own @ truth,
        columns(0.2),
        log,
        fit=fit_of(dict(zip(place.tolist(), truth, strict=True))),
        build=Build((way,), 0.0, late, {}),
        builds_up=True,
    )
    root = np.sqrt(given.row_weights[0])

    def changed(effort: np.ndarray) -> np.ndarray:
        """Least squares of a further effort."""
        return np.linalg.lstsq(own * root[:, None], effort * root)[0]

    of_way, of_delay = _other_ways(given, place)
    assert of_way == pytest.approx(changed((own - longer) @ truth), rel=1e-6)
    assert of_delay == pytest.approx(changed(late * rates @ truth), rel=1e-5)
    given.builds_up = False
    assert not list(_other_ways(given, place))
