"""Stepper motors: the pull-out curve against a search, printed points, and rows by hand."""

import numpy as np
import pytest
import yaml
from sizing_cases import (
    ACCELERATION,
    COULOMB,
    CYCLE,
    GEAR,
    INERTIA,
    MOTOR,
    PAUSE,
    RATE,
    one_drive,
    sized_cycle,
    trapezoid,
    turntable,
    write_catalog,
)
from tables import table

import pinfric as pf
from pinfric.drives.criterion import Status
from pinfric.drives.kinds.stepper import Stepper, pull_out_torque
from pinfric.drives.policy import Conditions
from pinfric.errors import CatalogError, RetimeError
from pinfric.retiming.limits import read_limits
from pinfric.show.pages.sizing import sizing_page
from pinfric.show.report.drives import bus_lines, product_lines
from pinfric.sizing.summary import sizing_summary

RPM = np.pi / 30
ELECTRIC = {"holding_torque": 3.0, "current": 4.2, "resistance": 0.88, "inductance": 3.4e-3}
#: StepperOnline 23HS45-4204S at a DM556T of 36 V, rpm: N m, read from the maker's curve.
PRINTED = {210: 2.82, 600: 1.29, 990: 0.78, 1200: 0.42}


def searched(stepper, speed, voltage):
    """The largest torque of all currents of two phases, on a grid, that the voltage allows."""
    most = np.sqrt(2) * stepper.current
    k, w = stepper.holding_torque / most, speed * stepper.steps / 4
    size, angle = np.meshgrid(np.linspace(0, most, 1201), np.linspace(-1, 1, 1441) * np.pi / 2)
    across, along = size * np.cos(angle), size * np.sin(angle)  # beside and along the flux
    drop = stepper.resistance * across - w * stepper.inductance * along + k * speed
    other = stepper.resistance * along + w * stepper.inductance * across
    able = drop**2 + other**2 <= voltage**2
    return k * max(across[able].max(initial=0.0), 0.0)


@pytest.mark.parametrize(
    ("voltage", "change"),
    [
        (12.0, {}),
        (36.0, {"steps": 400}),
        (60.0, {"resistance": 6.8, "inductance": 9.5e-3, "current": 0.67}),
    ],
)
def test_a_computed_curve_is_half_of_what_any_currents_give(voltage, change):
    stepper = Stepper(**ELECTRIC | change)
    speeds = np.array([0.0, 5.0, 22.0, 40.0, 63.0, 104.0, 200.0, 900.0])
    found = pull_out_torque(stepper, speeds, voltage)
    expected = [0.5 * searched(stepper, w, voltage) for w in speeds]
    assert found == pytest.approx(expected, rel=4e-3, abs=4e-3)
    assert found[0] == 0.5 * min(
        3.0, 3.0 * voltage / np.sqrt(2) / stepper.current / stepper.resistance
    )


def test_the_half_is_below_printed_curves_and_never_far():
    """At four speeds 0.94, 0.82, 0.82 and 0.53 of the whole are printed."""
    speeds = RPM * np.array(list(PRINTED))
    half = pull_out_torque(Stepper(**ELECTRIC), speeds, 36.0)
    share = np.array(list(PRINTED.values())) / (2 * half)
    assert share == pytest.approx([0.94, 0.82, 0.82, 0.53], abs=5e-3)


def test_a_printed_curve_is_taken_as_it_is_and_ends():
    points = [(n * RPM, torque) for n, torque in PRINTED.items()]
    stepper = Stepper(holding_torque=3.0, current=4.2, pull_out=points, voltage=36.0)
    speeds = RPM * np.array([0.0, 210, 795, 1200, 1201])
    expected = [2.82, 2.82, (1.29 + 0.78) / 2, 0.42, 0.0]
    assert pull_out_torque(stepper, speeds, 48.0) == pytest.approx(expected)
    # a driver of two thirds of the voltage reaches two thirds of the speeds
    assert pull_out_torque(stepper, speeds * 2 / 3, 24.0) == pytest.approx(expected)


CURVE = yaml.safe_load("""
holding_torque: 0.9
current: 2.0
pull_out:
- [0.0, 0.8]
- [100.0, 0.7]
- [200.0, 0.5]
voltage: 48.0
""")


NONE = ("continuous_torque", "peak_torque", "torque_constant", "resistance", "max_speed", "thermal")


def report_of(tmp_path, stepper, **conditions):
    motor = dict.fromkeys(NONE) | {"stepper": stepper}
    return sized_cycle(one_drive(tmp_path, motor), conditions=conditions, on_miss="ignore")


def sized(tmp_path, stepper, **conditions):
    (joint,) = report_of(tmp_path, stepper, **conditions).joints
    return joint, {c.name: c for c in joint.assessments[0].criteria}


def test_a_stepper_is_judged_at_every_speed_by_its_curve(tmp_path):
    """Where it accelerates up to the plateau, 150 rad/s: 0.6 N m there, of 1.5 times the need."""
    joint, rows = sized(tmp_path, CURVE)
    assert joint.choice is not None
    row = rows["stepper pull-out torque"]
    rotor = GEAR["ratio"] * 6e-5 * ACCELERATION
    up = (INERTIA * ACCELERATION + COULOMB) / GEAR["efficiency"] / GEAR["ratio"] + rotor
    assert GEAR["ratio"] * RATE == 150.0
    assert (row.required, row.available) == (pytest.approx(1.5 * up / 0.6, rel=1e-6), 1.0)
    heat = rows["stepper winding"]
    moving = (CYCLE - PAUSE) / CYCLE
    assert heat.required == pytest.approx(80 * (moving + 0.25 * (1 - moving)), rel=2e-3)
    assert heat.available == 130 - 25
    assert not {"winding temperature", "motor speed", "speed-torque line"} & set(rows)
    assert rows["bus voltage"].available == 60.0
    hot, _ = sized(tmp_path, CURVE, ambient=50.0, pull_out_factor=2.0)
    assert hot.choice is not None


@pytest.mark.parametrize(
    ("resistance", "says"),
    [(1.4, "at most 11.2 W more, 2 R I^2"), (None, "1 has no resistance")],
)
def test_the_bus_lacks_the_heat_that_a_steppers_driver_keeps_up(tmp_path, resistance, says):
    """2 x 1.4 ohm x (2 A)^2, whatever the torque."""
    *_, line = bus_lines(report_of(tmp_path, CURVE | {"resistance": resistance}))
    assert "the heat of 1 stepper is not in the bus power" in line
    assert line.endswith(says)


def test_a_stepper_that_is_switched_off_is_not_heated(tmp_path):
    scene, moving = turntable(), (CYCLE - PAUSE) / CYCLE
    path = one_drive(tmp_path, dict.fromkeys(NONE) | {"stepper": CURVE})
    (joint,) = pf.size(scene, pf.Duty([(trapezoid(scene), 1.0)], on=0.5), path).joints
    heat = next(c for c in joint.choice.criteria if c.name == "stepper winding")
    assert heat.required == pytest.approx(40 * (moving + 0.25 * (1 - moving)), rel=5e-3)


def test_no_stepper_is_ruled_out_that_bears_a_sample(tmp_path):
    """The search finds at most a sample's share of the curve, at rest of the holding torque."""
    stepper = CURVE | {
        "pull_out": [[0.0, 0.2], [100.0, 0.7], [200.0, 0.5]],
        "standstill_current": 1,
    }
    (joint,) = report_of(tmp_path, stepper).joints
    search, torque = joint.search, 0.13
    (block,) = (x for x in search.arrays.groups if any(m.stepper for m in x.motors))
    for speed, most in ((0.0, 0.9), (50.0, 0.45), (150.0, 0.6), (-150.0, 0.6)):
        sample = np.full((1, 1), 0.1), np.full((1, 1), 0.03), np.full((1, 1), speed)
        (share,) = search._least_pull_out(block, [sample])[0]
        assert 0.999 * torque / most < share <= torque / most


def test_steppers_are_bounded_together_as_each_by_itself():
    """One with its maker's curve, two without, at samples of rest and of motion."""
    steppers = [Stepper(**ELECTRIC), Stepper(**CURVE), Stepper(**ELECTRIC | {"current": 3.0})]
    torque = np.random.default_rng(2).uniform(0.01, 2.0, (2, 4, 3))
    speed = np.array([[0.0, 3.0, 80.0, 900.0], [0.0, 0.1, 150.0, 5000.0]])
    asked = speed, 0.5, Conditions(bus_voltage=36.0)
    found = Stepper.least_shares(steppers, torque, *asked)
    for m, stepper in enumerate(steppers):
        curve = pull_out_torque(stepper, speed, 36.0)
        held = stepper.standstill_current * stepper.holding_torque
        most = np.where(speed <= 0.5, np.maximum(curve, held), curve)
        share = np.minimum((torque[..., m] / np.maximum(most, 1e-300)).max(axis=0), 1e9)
        assert found[:, m] == pytest.approx(share, rel=2e-9)


def test_at_rest_half_of_the_holding_torque_is_left(tmp_path):
    """The friction of the joint, which may load the motor at rest; beside it a strong curve."""
    weak = {**CURVE, "standstill_current": 0.04}
    joint, rows = sized(tmp_path, weak)
    rest = COULOMB / GEAR["efficiency"] / GEAR["ratio"]
    row = rows["stepper pull-out torque"]
    assert row.required == pytest.approx(1.5 * rest / (0.04 * 0.9), rel=1e-6)
    assert row.status == Status.FAILS
    assert joint.choice is None
    by_rule = {k: v for k, v in CURVE.items() if k not in ("pull_out", "voltage")}
    report = report_of(tmp_path, by_rule | {"resistance": 1.0, "inductance": 2e-3})
    assert report.joints[0].choice is not None
    assert "by rule: 0.5 of the curve" in sizing_page(report)


def test_of_equal_steppers_a_printed_curve_goes_before_a_computed_one(tmp_path):
    """Though the computed one leaves more; where it is taken the first screen names the rule."""
    base = {k: v for k, v in MOTOR.items() if k not in NONE}
    rule = {"holding_torque": 2.0, "current": 8.0, "resistance": 0.3, "inductance": 2e-4}
    weak = CURVE | {"pull_out": [[w, 0.7 * torque] for w, torque in CURVE["pull_out"]]}
    motors = {"A": base | {"stepper": rule}, "M": base | {"stepper": weak}}
    path = write_catalog(tmp_path / "two.yaml", motors)
    for most in (1, 12):
        first, *others = sized_cycle(path).joints[0].search.fitting(most)
        assert first.candidate.motor == "M"
        assert [a.candidate.motor for a in others] == ["A"] * (most > 1)
    assert others[0].margin > first.margin
    assert "by rule" not in shown(sized_cycle(path))
    alone = sized_cycle(write_catalog(tmp_path / "one.yaml", {"A": motors["A"]}))
    assert "A: pull-out torque by rule, 0.5 of that of resistance and inductance" in shown(alone)


def shown(report):
    return "; ".join(product_lines(sizing_summary(report)))


CASES = """
{pull_out: null, voltage: null}         measure resistance and inductance of one phase
{pull_out: null, resistance: 1.0}       no `pull_out`, and no `resistance` with
{voltage: null}                         give the `voltage` of the driver
{pull_out: [[0.0, 8.0], [100.0, 7.0]]}  8 N m is more than holding_torque 0.9
{pull_out: [[100.0, 0.7], [0.0, 0.8]]}  rad/s ascending
"""


@pytest.mark.parametrize(
    ("change", "says"),
    table(CASES, yaml.safe_load, str),
)
def test_a_stepper_without_a_curve_says_what_to_measure(tmp_path, change, says):
    with pytest.raises(CatalogError, match="motors.M.stepper.*" + says):
        sized(tmp_path, {k: v for k, v in {**CURVE, **change}.items() if v is not None})


def test_retiming_refuses_a_stepper(tmp_path):
    joint, _ = sized(tmp_path, CURVE)
    with pytest.raises(
        RetimeError, match="a stepper motor, whose pull-out curve `retime` does not"
    ):
        read_limits(turntable(), {"table": joint.choice.candidate})
