"""Losses of gears as makers give them, against closed forms and published figures."""

import math

import numpy as np
import pytest
import yaml
from tables import table

from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.drivetrain import gear_transmission
from pinfric.errors import PinfricWarning, SceneError
from pinfric.model.drives import gear_drag, gear_line, gear_table, motor_torque_bounds
from pinfric.model.entry import parse
from pinfric.model.transmission import Transmission

RPM = math.pi / 30.0
#: CSD-20/25-100 at rated load, as its catalogue's curves were read (500 to 3500 rpm, by deg C).
CSD = {20: (0.76, 0.71, 0.64, 0.57), 0: (0.63, 0.54, 0.44, 0.36), -10: (0.52, 0.42, 0.31, 0.24)}
SPEEDS = [500 * RPM, 1000 * RPM, 2000 * RPM, 3500 * RPM]


def transmission(**entry):
    return parse(Transmission, {"ratio": 100.0, **entry}, "x")


def over_speed(degrees, load=40.0, **more):
    points = [[w, eta] for w, eta in zip(SPEEDS, CSD[degrees], strict=True)]
    return {"over_speed": points, "load": load, **more}


def torques(gear, effort, velocity):
    """Motor torque (least, greatest) at one effort and velocity, no acceleration."""
    found = motor_torque_bounds(
        gear, *(np.array([x]) for x in (effort, effort, velocity, 0.0, False)), 1e-6
    )
    return found[0][0], found[1][0]


def test_rated_efficiency_with_no_load_torque_is_the_makers_curve_over_the_load():
    """HFUC-20-80, 1000 rpm: 0.78 at rated torque T, times K(0.57) = 0.93 at 0.57 T (maker).

    u/t = 1/eta0 + n/t makes K(V) = 1/(1 + kappa (1/V - 1)), kappa = eta(1) n/T: of K(0.57) = 0.93
    kappa = (1/0.93 - 1)/(1/0.57 - 1) = 0.0998, n/T = 0.128, eta0 = 0.866.
    """
    kappa = (1 / 0.93 - 1) / (1 / 0.57 - 1)
    T, n = 34.0, kappa / 0.78 * 34.0 / 80.0
    gear = transmission(
        ratio=80.0, efficiency={"rated": 0.78, "load": T}, back_efficiency=0.9, no_load_torque=n
    )
    assert kappa == pytest.approx(0.0998, abs=5e-5)
    assert n == pytest.approx(0.054, abs=5e-4)
    assert 1 / (1 + gear.losses()[0].slopes[0]) == pytest.approx(0.866, abs=5e-4)
    for share, k in ((1.0, 1.0), (0.57, 0.93)):
        taken = torques(gear, share * T, 1.0)[0]
        assert share * T / 80.0 / taken == pytest.approx(0.78 * k, rel=1e-12)


def test_no_pair_exists_for_a_gear_that_would_gain():
    """SHG-20-80: 0.63 and K(0.8) = 0.9 make n/T = 0.706 and eta0 = 1.13."""
    n = (1 / (0.63 * 0.9) - 1 / 0.63) / (1 / 0.8 - 1) * 34.0 / 80.0
    with pytest.raises(SceneError, match=r"no_load_torque.*1\.13, above 1.*maker's curve"):
        transmission(
            ratio=80.0,
            efficiency={"rated": 0.63, "load": 34.0},
            back_efficiency=0.9,
            no_load_torque=n,
        )
    with pytest.raises(SceneError, match="the load's part would be inf, above 1"):  # 80 of 34 N m
        transmission(
            ratio=80.0,
            efficiency={"rated": 0.63, "load": 34.0},
            back_efficiency=0.9,
            no_load_torque=1.0,
        )


@pytest.mark.parametrize(("degrees", "points"), [(20, 0.14), (0, 0.065), (-10, 0.51)])
def test_a_power_of_two_thirds_fits_a_strain_wave_gear_over_the_speed(degrees, points):
    gear = transmission(efficiency=over_speed(degrees), back_efficiency="same_loss")
    loss = gear.losses()[0]
    assert 100 * loss.error <= points
    for w, eta in zip(SPEEDS, CSD[degrees], strict=True):
        taken = torques(gear, 40.0, w / 100.0)[0]
        assert 0.4 / taken == pytest.approx(eta, abs=1.01e-2 * points)
    assert gear.losses()[1] == loss


def test_cold_is_a_factor_on_what_grows_with_the_speed():
    """The fits' d at 0 C over that at 20 C is 2.71 (rad/s)^(2/3); c stays as it is."""
    warm, cold = (
        transmission(efficiency=over_speed(20, **more), back_efficiency=0.9).losses()[0]
        for more in ({}, {"temperature": {"factor": 2.71, "source": "CSD"}})
    )
    assert (cold.constant, cold.rise) == (warm.constant, 2.71 * warm.rise)
    fitted = transmission(efficiency=over_speed(0), back_efficiency=0.9).losses()[0]
    assert fitted.rise == pytest.approx(cold.rise, rel=1e-3)


def test_losses_that_grow_faster_than_their_power_leave_no_gain_at_rest():
    """1/eta - 1 = 0.10, 0.22 at w, 2 w: the line through them is -0.02 at 0; d = 0.54/(5 w)."""
    curve = {"over_speed": [[100.0, 1 / 1.10], [200.0, 1 / 1.22]], "load": 40.0, "exponent": 1.0}
    loss = transmission(efficiency=curve, back_efficiency=0.9).losses()[0]
    assert loss.constant == 0.0
    assert loss.rise == pytest.approx(0.54 / 500.0)


CURVE = [[10.0, 0.55], [20.0, 0.70], [40.0, 0.80]]


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_curve_over_the_load_is_met_at_its_points_and_straight_between(direction):
    """u = t/eta at each point, no-load torque and drag included; 40 N m and 80 N m lose alike."""
    n, c, speed = 0.01, 2e-4, 30.0
    gear = transmission(
        efficiency={"over_load": CURVE, "speed": speed},
        back_efficiency=0.9,
        no_load_torque=n,
        motor_viscous={"coefficient": c, "exponent": 0.5},
    )
    taken = [torques(gear, direction * t, direction * speed / 100.0)[0] for t, _ in CURVE]
    np.testing.assert_allclose(taken, [direction * t / eta / 100.0 for t, eta in CURVE], rtol=1e-13)
    halfway = torques(gear, direction * 30.0, direction * speed / 100.0)[0]
    assert halfway == pytest.approx(0.5 * (taken[1] + taken[2]), rel=1e-13)
    drag = direction * (n + c * speed**0.5)
    twice = torques(gear, direction * 80.0, direction * speed / 100.0)[0]
    assert twice - drag == pytest.approx(2.0 * (taken[2] - drag), rel=1e-13)


def test_both_curves_meet_at_the_load_and_speed_they_share():
    """g(w) L(t): at 40 N m as over_speed says, at 10 N m in the share that over_load gives."""
    curve = [[10.0, 0.52], [40.0, 0.71]]
    gear = transmission(
        efficiency=over_speed(20, over_load=curve, speed=SPEEDS[1]), back_efficiency=0.9
    )
    loss = [[100 * torques(gear, t, w / 100.0)[0] - t for t, _ in curve] for w in SPEEDS]
    for row, eta in zip(loss, CSD[20], strict=True):
        assert 40.0 / (40.0 + row[1]) == pytest.approx(eta, abs=1.5e-3)
        assert row[0] / row[1] == pytest.approx((10 / 0.52 - 10) / (40 / 0.71 - 40), rel=1e-12)
    with pytest.raises(SceneError, match=r"load 40.*`over_load` gives 0\.71, `over_speed` 0\.57"):
        transmission(
            efficiency=over_speed(20, over_load=curve, speed=SPEEDS[3]), back_efficiency=0.9
        )


@pytest.mark.parametrize(
    ("size", "rated", "eta", "running", "starting", "driven", "mu", "back"),
    [
        (14, 10.0, 0.67, 0.035, 0.021, 2.21, 0.143, 0.950),
        (17, 31.0, 0.77, 0.051, 0.029, 3.06, 0.134, 0.948),
        (20, 52.0, 0.77, 0.105, 0.037, 3.89, 0.097, 0.951),
        (25, 87.0, 0.77, 0.195, 0.069, 7.26, 0.075, 0.950),
    ],
)
def test_the_torques_that_start_a_gear_without_load_say_how_it_is_driven(
    size, rated, eta, running, starting, driven, mu, back
):
    """Schaeffler RT1-H-CS, i = 100: eta_b = 100 starting/back-driving torque, 0.95 in all sizes."""
    gear = transmission(
        efficiency={"rated": eta, "load": rated, "speed": 209.44},
        back_efficiency={"starting_torque": starting, "back_driving_torque": driven},
        no_load_torque={"static": starting, "kinetic": starting * 0.9},
        motor_viscous=(running - 0.9 * starting) / 209.44,
    )
    assert gear.losses()[0].slopes[0] == pytest.approx(mu, abs=6e-4)
    assert 1 - gear.losses()[1].slopes[0] == pytest.approx(back, abs=6e-4)
    least, greatest = torques(gear, -driven, 0.0)  # what a load that just moves it asks: none
    assert greatest == pytest.approx(0.0, abs=1e-15)
    assert least < 0.0
    entry = load_catalog().gears[f"Schaeffler RT1-H-CS {size} i=100"]
    chosen, text = gear_transmission(entry, 100.0, 0.0)
    assert 1 - chosen.losses()[1].slopes[0] == pytest.approx(back, abs=6e-4)
    assert chosen.losses()[0].slopes[0] == pytest.approx(mu, abs=6e-4)
    assert "starting torque/back-driving torque" in text
    assert "assumed" not in text


@pytest.mark.parametrize("ratio", [50.0, -50.0])
def test_no_load_torque_by_the_motors_direction_breaks_away_at_its_static_value(ratio):
    both = {
        "positive": {"static": 0.04, "kinetic": 0.03},
        "negative": {"static": 0.02, "kinetic": 0.01},
    }
    gear = transmission(ratio=ratio, no_load_torque=both)
    for way in (1.0, -1.0):  # of the motor
        expected = 0.03 if way > 0 else -0.01
        assert torques(gear, 0.0, way / ratio) == pytest.approx((expected, expected))
    assert torques(gear, 0.0, 0.0) == pytest.approx((-0.02, 0.04))


def test_drag_of_the_motor_is_a_power_of_its_speed():
    drag = {"coefficient": 3e-3, "exponent": 0.6}
    gears = gear_table([transmission(ratio=-50.0, motor_viscous=drag)], [0.0])
    for v in (0.7, -0.7):
        expected = 50.0 * 3e-3 * 35.0**0.6 * np.sign(v)
        assert gear_drag(gears, 0, v) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("back", [0.9, -0.2, "same_loss"])
def test_lines_of_a_gear_join_and_hold_to_their_ends(direction, back):
    """u(t) is one broken line: each line begins where the one below ends, at the same value."""
    curve = over_speed(20, over_load=[[10.0, 0.52], [40.0, 0.71]], speed=SPEEDS[1])
    gears = gear_table(
        [transmission(efficiency=curve, back_efficiency=back, no_load_torque=0.01)], [0.0]
    )
    start, before, count = -np.inf, None, 0
    while start < np.inf:
        slope, offset, least, greatest = gear_line(gears, 0, direction, 2.0, False, start)
        assert least == start < greatest
        inside = gear_line(
            gears, 0, direction, 2.0, False, least + 1.0 if start > -np.inf else -1e3
        )
        assert inside == (slope, offset, least, greatest)
        if before is not None:
            assert slope * start + offset == pytest.approx(before, rel=1e-12)
        if direction * (least + greatest) > 0:  # the motor drives
            assert slope > 1.0
        before, start, count = slope * greatest + offset, greatest, count + 1
    assert count == (6 if back == "same_loss" else 4)


def test_bounds_enclose_every_effort_of_an_interval_tightly():
    """Brute force over the interval, of a gear with curves that is self-locking when driven."""
    curve = over_speed(-10, over_load=[[10.0, 0.2], [40.0, 0.42]], speed=SPEEDS[1])
    gear = transmission(efficiency=curve, back_efficiency="same_loss", no_load_torque=0.01)
    gears, rng = gear_table([gear], [1e-6]), np.random.default_rng(1)
    for velocity in (2.0, -2.0):
        for _ in range(8):
            low, high = np.sort(rng.uniform(-60, 60, 2))
            found = motor_torque_bounds(
                gear, *(np.array([x]) for x in (low, high, velocity, 0.0, False)), 1e-6
            )
            every = []
            for t in np.linspace(low, high, 2001):
                slope, offset, *_ = gear_line(gears, 0, np.sign(velocity), 2.0, False, t)
                every.append(slope * t + offset)
            assert found[0][0] == pytest.approx(min(every) / 100, abs=2e-3)
            assert found[1][0] == pytest.approx(max(every) / 100, abs=2e-3)
            assert found[0][0] <= min(every) / 100 + 1e-12
            assert found[1][0] >= max(every) / 100 - 1e-12


#: Entries of gears; CURVE and OVER_SPEED stand for those above, START for torques without a load.
WRONG = r"""
efficiency: 1.2                                   `efficiency`: .*at most 1, found 1\.2
efficiency: {rated: 0.8}                          `rated` needs `load`
efficiency: {load: 3.0}                           needs `rated`, `over_load` or `over_speed`
efficiency: {rated: 0.7, over_load: CURVE, load: 9}        give either
efficiency: {over_load: [[10, 0.5]]}              at least two points in
efficiency: {over_load: [[20, 0.5], [10, 0.4]]}   at least two points in
efficiency: {over_load: [[10, 0.5], [20, 0.6], [21, 0.97]]}  from 20 on the motor's torque falls wh
{efficiency: {over_load: CURVE}, no_load_torque: 0.2}      above 1, which is
efficiency: {OVER_SPEED, over_load: CURVE}        `over_load` needs the `speed`
efficiency: {OVER_SPEED, over_load: [[39, 0.5], [40, 0.71]], speed: 104.72}  from 39 on the loss fal
efficiency: {rated: 0.7, load: 9.0, exponent: 0.5}         needs `over_speed`
efficiency: {OVER_SPEED, temperature: {factor: 2.7}}       temperature.source` is mis
{efficiency: 0.8, back_efficiency: 1.1}           `back_efficiency`: .*at most 1
{efficiency: 0.8, back_efficiency: same}          should be 'same_loss', found 'same'
{efficiency: 0.8, back_efficiency: null}          needs `back_efficiency`.*0.75
{efficiency: {over_load: CURVE}, back_efficiency: null}    take `same_loss`
back_efficiency: {starting_torque: 3.0, back_driving_torque: 3.06}  eta_b 98, above 1.*input
{back_efficiency: START, no_load_torque: {static: 0.05, kinetic: 0.02}}  0.05 and .*_torque` 0.03
no_load_torque: {static: 0.01, kinetic: 0.02}     no_load_torque`: static 0.01 is
no_load_torque: -1.0                              no_load_torque`: .*at least 0
motor_viscous: {coefficient: 1.0, exponent: 0.0}  motor_viscous.exponent`
"""
MEANT = {
    "CURVE": str(CURVE),
    "START": "{starting_torque: 0.03, back_driving_torque: 3.06}",
    "OVER_SPEED": str(over_speed(20))[1:-1],
}


@pytest.mark.parametrize(("entry", "says"), table(WRONG))
def test_what_is_no_gear_is_named(entry, says):
    for word, meaning in MEANT.items():
        entry = entry.replace(word, meaning)
    with pytest.raises(SceneError, match=says):
        transmission(**{"back_efficiency": 0.5} | yaml.safe_load(entry))


def test_an_exponent_that_does_not_fit_is_said():
    with pytest.warns(PinfricWarning, match=r"over_speed: the fit misses .* by 0\.0\d+ \(usually"):
        transmission(efficiency=over_speed(-10, exponent=2.0), back_efficiency=0.5)
