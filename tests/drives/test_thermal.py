"""Winding temperatures against closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from sizing_cases import MOTOR

from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.drivetrain import Ratings
from pinfric.drives.thermal import Thermal, mean_winding_temperature, no_load_heat, winding_cycle

THERMAL = Thermal(**MOTOR["thermal"])
R_WH, R_HA, TAU_W, TAU_H = 2.0, 3.0, 20.0, 300.0
RESISTANCE, AMBIENT, ALPHA = 0.8, 40.0, 0.0039
CONDUCTANCE = 1 / R_WH, 1 / R_HA
CAPACITY = TAU_W / R_WH, TAU_H / R_HA


def square(on, off, current, samples=50):
    """Current for `on` seconds, nothing for `off` seconds."""
    t = np.concatenate([np.linspace(0, on, samples), np.linspace(on + 1e-10, on + off, samples)])
    return t, np.concatenate([np.full(samples, current), np.zeros(samples)])


@pytest.mark.parametrize("other", [3.0, -3.0])
def test_constant_current_settles_at_the_closed_form(other):
    """Worst cases of opposite sign, between which the motor does not rest, heat as one of them."""
    # T_w - T_a = r P0 w/(1 - alpha r P0), P0 = R i^2, w the resistance's rise at ambient
    t, i = np.linspace(0, 7, 100), np.where(np.arange(100) % 2, other, 3.0)
    heat, r = RESISTANCE * 9.0, R_WH + R_HA
    warm = 1 + ALPHA * (AMBIENT - 25)
    rise = r * heat * warm / (1 - ALPHA * r * heat)
    found = winding_cycle(t, i, RESISTANCE, THERMAL, AMBIENT)
    np.testing.assert_allclose(found.winding, AMBIENT + rise, rtol=1e-9)
    # through the housing flows all heat: T_h - T_a = R_ha/(R_wh + R_ha) of the rise
    np.testing.assert_allclose(found.housing, AMBIENT + rise * R_HA / r, rtol=1e-9)
    assert mean_winding_temperature(t, i, RESISTANCE, THERMAL, AMBIENT) == pytest.approx(
        AMBIENT + rise, rel=1e-12
    )


@pytest.mark.parametrize("ambient", [20.0, 25.0, 26.0, 40.0, 60.0])
def test_winding_and_housing_by_integration_of_the_makers_equations(ambient):
    """C_w T_w' = R (1 + alpha (T_w - 25)) i^2 - (T_w - T_h)/R_wh, and so on, until it repeats."""
    on, off, current = 3.0, 4.0, 4.0

    def rates(t, T, i):
        heat = RESISTANCE * (1 + ALPHA * (T[0] - 25.0)) * i**2
        across = (T[0] - T[1]) / R_WH
        return [(heat - across) / CAPACITY[0], (across - (T[1] - ambient) / R_HA) / CAPACITY[1]]

    def run(T):
        hot = solve_ivp(rates, (0, on), T, args=(current,), rtol=1e-10, atol=1e-9).y[:, -1]
        return hot, solve_ivp(rates, (0, off), hot, args=(0.0,), rtol=1e-10, atol=1e-9).y[:, -1]

    # one cycle is affine: its fixed point from three runs
    zero, winding, housing = (run(T)[1] for T in ([0.0, 0.0], [1.0, 0.0], [0.0, 1.0]))
    start = np.linalg.solve(np.eye(2) - np.transpose([winding - zero, housing - zero]), zero)
    hottest, end = run(start)
    np.testing.assert_allclose(end, start, atol=1e-6)
    found = winding_cycle(*square(on, off, current), RESISTANCE, THERMAL, ambient)
    assert found.peak == pytest.approx(hottest[0], abs=1e-5)
    assert found.winding[0] == pytest.approx(start[0], abs=1e-5)
    assert found.housing[0] == pytest.approx(start[1], abs=1e-5)


def test_short_cycles_see_the_mean_heat():
    t, i = square(0.01, 0.03, 6.0)
    found = winding_cycle(t, i, RESISTANCE, THERMAL, AMBIENT)
    assert found.peak == pytest.approx(
        mean_winding_temperature(t, i, RESISTANCE, THERMAL, AMBIENT), rel=1e-3
    )


def test_runaway_is_told_from_the_last_current_that_settles():
    # constant current runs away at alpha (R_wh + R_ha) R i^2 = 1
    limit = np.sqrt(1 / (ALPHA * (R_WH + R_HA) * RESISTANCE))
    t = np.linspace(0, 5, 20)
    for factor, runs_away in ((0.999, False), (1.001, True)):
        i = np.full(20, factor * limit)
        found = winding_cycle(t, i, RESISTANCE, THERMAL, AMBIENT)
        assert found.runaway is runs_away
        assert np.isinf(found.peak) == runs_away
        at_mean = mean_winding_temperature(t, i, RESISTANCE, THERMAL, AMBIENT)
        assert np.isinf(at_mean) == runs_away


def test_heat_of_turning_warms_winding_and_housing_alike():
    """T_w - T_a = (r P w + R_ha P_0)/(1 - alpha r P); all heat leaves through R_ha."""
    t, i = np.linspace(0, 7, 100), np.full(100, 3.0)
    heat, r, warm, turning = RESISTANCE * 9.0, R_WH + R_HA, 1 + ALPHA * (AMBIENT - 25), 4.0
    rise = (r * heat * warm + R_HA * turning) / (1 - ALPHA * r * heat)
    found = winding_cycle(t, i, RESISTANCE, THERMAL, AMBIENT, no_load=np.full(100, turning))
    np.testing.assert_allclose(found.winding, AMBIENT + rise, rtol=1e-9)
    copper = heat * (warm + ALPHA * rise)
    np.testing.assert_allclose(found.housing, AMBIENT + R_HA * (copper + turning), rtol=1e-9)
    at_mean = mean_winding_temperature(t, i, RESISTANCE, THERMAL, AMBIENT, no_load=turning)
    assert at_mean == pytest.approx(AMBIENT + rise, rel=1e-12)


def test_heat_of_turning_that_comes_and_goes():
    """Two parts of a cycle, one of which turns, against matrix exponentials."""
    (g1, g2), (c1, c2) = CONDUCTANCE, CAPACITY
    on, off, current, turning = 15.0, 40.0, 2.0, 6.0
    p, warm = RESISTANCE * current**2, 1 + ALPHA * (AMBIENT - 25)

    def step(loss, span):
        rows = [
            [(ALPHA * p - g1) / c1, g1 / c1, p * warm / c1],
            [g1 / c2, -(g1 + g2) / c2, loss / c2],
            [0.0, 0.0, 0.0],
        ]
        return expm(np.array(rows) * span)

    first, second = step(turning, on), step(0.0, off)
    whole = second @ first
    start = np.append(np.linalg.solve(np.eye(2) - whole[:2, :2], whole[:2, 2]), 1.0)
    t = np.concatenate([np.linspace(0, on - 1e-9, 300), np.linspace(on, on + off, 300)])
    loss = np.where(t < on - 5e-10, turning, 0.0)
    found = winding_cycle(t, np.full(600, current), RESISTANCE, THERMAL, AMBIENT, no_load=loss)
    assert found.winding[0] - AMBIENT == pytest.approx(start[0], rel=1e-6)
    assert found.winding[299] - AMBIENT == pytest.approx((first @ start)[0], rel=1e-6)


#: maxon: nominal current in print, A; the current at which copper alone heats it to its limit.
MAXON = [
    ("RE 50 200 W 578298", 4.58, 4.95),
    ("EC-i 40 100 W 496661", 2.72, 3.45),
    ("EC 90 flat 260 W 500267", 4.06, 4.87),
    ("EC-i 52 180 W 579165", 4.56, 7.78),
]


@pytest.mark.parametrize(("name", "printed", "by_copper"), MAXON)
def test_maxons_nominal_torque_is_that_at_its_nominal_speed(name, printed, by_copper):
    """Copper alone would let it carry up to 71 % more; the rest is the loss of turning."""
    motor = load_catalog().motors[f"maxon {name}"]
    assert motor.continuous_current == printed
    thermal, room = motor.thermal, motor.thermal.max_winding - 25
    hot = motor.resistance * (1 + ALPHA * room)
    through = thermal.winding_housing + thermal.housing_ambient
    assert np.sqrt(room / hot / through) == pytest.approx(by_copper, rel=5e-3)
    current = motor.continuous_torque / motor.torque_constant
    rate = no_load_heat(thermal, current, motor.resistance, motor.rated_speed, 25.0)
    assert rate > 0
    t, i = np.linspace(0, 1, 10), np.full(10, current)
    turning = np.full(10, rate * motor.rated_speed)
    found = winding_cycle(t, i, motor.resistance, thermal, 25.0, no_load=turning)
    assert found.peak == pytest.approx(thermal.max_winding, rel=1e-9)
    slow = winding_cycle(t, i, motor.resistance, thermal, 25.0)
    assert slow.peak < thermal.max_winding - 5
    assert no_load_heat(None, 1.0, 1.0, 1.0, 25.0) == 0.0
    assert no_load_heat(thermal, 3 * current, motor.resistance, 100.0, 25.0) == 0.0


@pytest.mark.parametrize("lacks", ["winding_time", "housing_time"])
def test_a_temperature_over_time_needs_both_time_constants(lacks):
    thermal = THERMAL.model_copy(update={lacks: None})
    with pytest.raises(ValueError, match="both time constants"):
        winding_cycle(np.linspace(0, 1, 5), np.ones(5), RESISTANCE, thermal, AMBIENT)


def test_the_heat_of_turning_follows_from_the_nominal_point():
    """At the nominal point copper and turning heat the winding just to its limit."""
    k, torque, speed = 0.1, 0.3, 400.0
    ratings = Ratings(torque, torque_constant=k, resistance=0.8, rated_speed=speed, thermal=THERMAL)
    limit = THERMAL.max_winding
    copper = (R_WH + R_HA) * 0.8 * (1 + ALPHA * (limit - 25.0)) * (torque / k) ** 2
    turning = R_HA * ratings.no_load_heat * speed
    assert copper < limit - 25.0
    assert copper + turning == pytest.approx(limit - 25.0, rel=0.01)  # the coefficient's digits
