"""Criteria of one drive against figures worked out by hand (see `sizing_cases`)."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import chain, lump
from numpy.testing import assert_allclose, assert_array_equal
from sizing_cases import (
    ACCELERATION,
    COULOMB,
    CYCLE,
    GEAR,
    INERTIA,
    MOTOR,
    PAUSE,
    PLATEAU,
    RAMP,
    RATE,
    one_drive,
    sized_cycle,
    trapezoid,
    turntable,
    write_catalog,
)
from sweep_cases import sweep_of

import pinfric as pf
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import LEAST_MARGIN, Status, compare
from pinfric.drives.demand import DriveCycle
from pinfric.drives.drivetrain import gear_transmission, motor_cycle, motor_with_gear, ratings_of
from pinfric.drives.limit import JointCase, Limit, never, signals
from pinfric.drives.limits import LIMITS, add_limit, check
from pinfric.drives.policy import Conditions, parse_conditions
from pinfric.drives.rules import gear_life
from pinfric.errors import CatalogError, SizingError
from pinfric.model.drives import motor_torque_bounds
from pinfric.model.schema import Actuator
from pinfric.retiming.limits import read_limits
from pinfric.show.report.drives import backlash_line
from pinfric.sizing.drive_search import DriveSearch
from pinfric.sizing.summary import sizing_summary

# efforts at the joint: speeding up, running, slowing down; at rest anything in +-COULOMB
UP, RUN, DOWN = (INERTIA * ACCELERATION + COULOMB, COULOMB, -INERTIA * ACCELERATION + COULOMB)
RATIO, ETA, ETA_BACK = GEAR["ratio"], GEAR["efficiency"], GEAR["back_efficiency"]
ROTOR = MOTOR["rotor_inertia"] + GEAR["input_inertia"]
# at the motor: driving quadrants divide by eta, the braking one multiplies by eta_b
SPIN = RATIO * ROTOR * ACCELERATION
#: Resistance of a winding without thermal figures at 105 C, class A, over that at 25 C.
HOT = 1 + 0.0039 * 80
MOTOR_UP, MOTOR_RUN = UP / ETA / RATIO + SPIN, RUN / ETA / RATIO
MOTOR_DOWN, MOTOR_REST = DOWN * ETA_BACK / RATIO - SPIN, COULOMB / ETA / RATIO
PARTS = np.array([RAMP, PLATEAU, RAMP, PAUSE])
ANGLE = np.array([RATE * RAMP / 2, RATE * PLATEAU, RATE * RAMP / 2])  # turned in each part, rad


def sized(tmp_path, motor=None, gear=None, conditions=None, scene=None, on_miss="warn"):
    scene = scene or turntable()
    catalog = one_drive(tmp_path, motor, gear)
    report = sized_cycle(catalog, scene, conditions=conditions, on_miss=on_miss)
    (joint,) = report.joints
    return joint


def criterion(joint, name):
    (found,) = [c for c in joint.assessments[0].criteria if c.name == name]
    return found


def test_half_the_rated_torque_on_rollers_and_on_balls():
    """412 N m and 15 rpm rated, 206 N m at 1.5 rad/s: 6000 pi/3 2^(10/3) h; balls 8 times, a fifth.

    Halves of a cycle and a pause, by hand: N_m = 22/1.4 rpm, T_m = 540 N m, 3992 h by the clock.
    """
    rated = 15 * np.pi / 30
    assert round(gear_life(6000.0, rated, 412.0, 1.5, 206.0, 10 / 3)) == 63_331
    assert round(gear_life(6000.0, rated, 412.0, 1.5, 206.0)) == 10_053
    assert gear_life(6000.0, rated, 412.0, 0.0, 10.0) == np.inf
    turns, torque = np.array([3.0, 16.0, 3.0]), np.array([900.0, 250.0, 600.0])
    worn = (turns @ torque ** (10 / 3) / turns.sum()) ** 0.3
    assert round(worn) == 540
    clock = gear_life(6000.0, rated, 412.0, 22 / 2.4 * np.pi / 30, worn, 10 / 3)
    assert clock == pytest.approx(3992, rel=1e-3)


def test_the_peaks_of_planetary_gears_are_counted_as_their_makers_count_them(tmp_path):
    """Above T2N while it speeds up: by way in Neugart's gears, by times in Wittenstein's."""
    gear = {"kind": "planetary", "rated_torque": 14.0, "peak_turns": 3e4, "peaks_per_hour": 1e3}
    found = {}
    for life in (None, 5000.0):
        joint = sized(tmp_path, gear=gear, conditions={"life": life}, on_miss="ignore")
        found[life] = criterion(joint, "gear turns above rated torque")
        cycles = (life or 20_000.0) * 3600 / CYCLE
        turns = cycles * ANGLE[0] / (2 * np.pi)
        assert found[life].required == pytest.approx(turns, rel=1e-2)
        assert found[life].available == 3e4
    assert found[None].status == Status.FAILS
    times = criterion(joint, "gear peaks per hour")
    assert (times.required, times.available) == pytest.approx((3600 / CYCLE, 1e3))
    scene = turntable()
    half = pf.Duty([(trapezoid(scene), 1.0)], on=0.5)  # switched off the other half of the time
    found_ = pf.size(scene, half, one_drive(tmp_path, None, gear), on_miss="ignore").joints[0]
    assert criterion(found_, times.name).required == pytest.approx(1800 / CYCLE, rel=1e-3)
    strong = sized(tmp_path, gear=gear | {"rated_torque": 16.0})
    rows = [criterion(strong, name) for name in (found[None].name, times.name)]
    assert [(row.required, row.status) for row in rows] == [(0.0, Status.PASSES)] * 2


def test_a_motor_for_mains_has_less_torque_the_faster_it_turns(tmp_path):
    """0.6 N m at standstill, 0.4 at 600 rad/s; its mass by rule of the larger."""
    motor = {"continuous_stall_torque": 0.6, "continuous_torque": 0.4, "rated_speed": 600.0}
    motor |= {"mass": None, "thermal": None, "nominal_voltage": 48.0}
    joint = sized(tmp_path, motor)
    speed = RATIO * ANGLE.sum() / CYCLE
    row = criterion(joint, "continuous torque")
    assert row.available == pytest.approx(0.6 - 0.2 * speed / 600.0, rel=1e-6)
    assert "along a line" in row.note
    heavy = 1.94 * 0.6**0.75
    assert joint.choice.candidate.mass == pytest.approx(heavy + GEAR["mass"])


def test_a_cycloidal_gear_has_peaks_and_a_speed_of_its_own(tmp_path):
    """2.5 and 5 times the rating where nothing is printed; the mean speed while it moves."""
    printed = {"repeated_peak_torque": 66.0, "momentary_peak_torque": 99.0}
    for own, peaks in ((printed, [66.0, 99.0]), (dict.fromkeys(printed), [75.0, 150.0])):
        gear = {"kind": "cycloidal", "rated_torque": 30.0, "average_torque": None} | own
        joint = sized(tmp_path, gear=gear, conditions={"collision_effort": {"table": 1.0}})
        rows = [criterion(joint, f"gear {x} peak torque") for x in ("repeated", "momentary")]
        assert [row.available for row in rows] == peaks
    assert "5 x the rated torque of a cycloidal gear, by rule" in rows[1].note
    moving = criterion(joint, "gear speed under load")
    assert moving.required == pytest.approx(RATIO * ANGLE.sum() / (CYCLE - PAUSE), rel=1e-3)
    assert moving.available == GEAR["max_input_speed"]
    assert "gear average input speed" not in {c.name for c in joint.assessments[0].criteria}
    efforts = np.abs([UP, RUN, DOWN])
    worn = (ANGLE @ efforts ** (10 / 3) / ANGLE.sum()) ** 0.3
    assert criterion(joint, "gear average torque").required == pytest.approx(worn, rel=1e-6)


@pytest.mark.parametrize("kind", ["", "strain wave", "cycloidal", "planetary"])
@pytest.mark.parametrize("nominal", [35_000.0, None])
def test_life_is_that_of_the_kind_of_gear(tmp_path, kind, nominal):
    """Balls: cube, a fifth; rollers: 10/3, 6000 h where none is printed; planets: no law."""
    gear = {"kind": kind, "nominal_life": nominal, "rated_torque": 30.0}
    joint = sized(tmp_path, gear=gear)
    row = criterion(joint, "gear life L10")
    ways = np.array([RATE * RAMP / 2, RATE * PLATEAU, RATE * RAMP / 2])
    efforts = np.abs([INERTIA * ACCELERATION + COULOMB, COULOMB, COULOMB - INERTIA * ACCELERATION])
    speed = RATIO * ways.sum() / CYCLE
    turns = GEAR["rated_speed"] / speed
    power = 10 / 3 if kind == "cycloidal" else 3.0
    wear = (ways @ efforts**power / ways.sum()) ** (1 / power)
    life = turns * (30.0 / wear) ** power
    expected = {
        "": nominal and life * nominal / 5,
        "strain wave": nominal and life * nominal / 5,
        "cycloidal": life * (nominal or 6000.0),
        "planetary": 20_000.0,
    }[kind]
    assert row.available == (expected and pytest.approx(expected, rel=1e-6))
    if kind == "planetary":  # beyond its ratings nothing is known
        weak = sized(tmp_path, gear=gear | {"rated_torque": 14.9}, on_miss="ignore")
        assert criterion(weak, "gear life L10").available is None


def test_hot_winding_takes_more_voltage(tmp_path):
    joint = sized(tmp_path)
    k, r = MOTOR["torque_constant"], MOTOR["resistance"]
    hot = 1 + 0.0039 * (joint.motor.figures.peak_temperature - 25)
    assert criterion(joint, "speed-torque line").required == pytest.approx(
        hot * r * MOTOR_UP / k + k * RATIO * RATE, rel=1e-6
    )


def test_electrical_energy_drawn_and_regenerated(tmp_path):
    figures = sized(tmp_path, motor={"thermal": None}).motor.figures
    k, r, omega = MOTOR["torque_constant"], MOTOR["resistance"], RATIO * RATE
    copper = HOT * r * (np.array([MOTOR_UP, MOTOR_RUN, MOTOR_DOWN, MOTOR_REST]) / k) ** 2
    assert figures.driving_power == pytest.approx(MOTOR_UP * omega + copper[0], rel=1e-6)
    assert figures.braking_power == pytest.approx(-MOTOR_DOWN * omega - copper[2], rel=1e-6)
    # slowing down, the motor feeds back until copper loss eats it: from omega to omega_0
    least = copper[2] / -MOTOR_DOWN
    back = -MOTOR_DOWN * (omega - least) ** 2 / 2 * RAMP / omega
    assert figures.regenerated == pytest.approx(back, rel=1e-6)
    tail = -MOTOR_DOWN * least**2 / 2 * RAMP / omega
    drawn = MOTOR_UP * omega * RAMP / 2 + MOTOR_RUN * omega * PLATEAU + tail
    drawn += copper[0] * RAMP + copper[1] * PLATEAU + copper[3] * PAUSE
    assert figures.energy == pytest.approx(drawn, rel=1e-6)


def test_catalogue_efficiency_and_no_load_torque_do_not_count_twice(tmp_path):
    # Schaeffler RT1-H-CS 25: 87 N m, 77 %, 195 mN m running at 2000 rpm, 69 mN m starting
    gear = one_drive(
        tmp_path,
        gear={
            "rated_torque": 87.0,
            "repeated_peak_torque": 204.0,
            "momentary_peak_torque": 369.0,
            "efficiency": 0.77,
            "back_efficiency": None,
            "no_load_running_torque": 0.195,
            "no_load_speed": 209.44,
            "starting_torque": 0.069,
        },
    ).gears["G"]
    transmission, text = gear_transmission(gear, 100.0, 0.0)
    assert transmission.efficiency == pytest.approx(0.87 / (0.87 / 0.77 - 0.195), rel=1e-12)
    assert transmission.efficiency == pytest.approx(0.93, abs=0.005)
    assert transmission.no_load_torque.kinetic == 0.069
    # at rated torque and speed the input takes what the catalogue's efficiency says
    at_input = 0.87 / transmission.efficiency + transmission.no_load_torque.kinetic
    at_input += transmission.motor_viscous.coefficient * 209.44
    assert at_input == pytest.approx(0.87 / 0.77, rel=1e-12)
    assert transmission.back_efficiency == pytest.approx(2 - 1 / transmission.efficiency)
    assert "assumed" in text


def test_a_makers_curve_over_speed_drives_the_candidates_motor(tmp_path):
    """0.71 at 104.7 rad/s and 87 N m, the no-load loss in it; slower it loses less."""
    curve = {
        "over_speed": [[52.4, 0.76], [104.7, 0.71], [209.4, 0.64], [366.5, 0.57]],
        "load": 87.0,
    }
    figures = {
        "efficiency": curve,
        "back_efficiency": None,
        "starting_torque": 0.069,
        "no_load_running_torque": 0.195,
        "no_load_speed": 209.44,
    }
    gear = one_drive(tmp_path, gear=figures).gears["G"]
    transmission, text = gear_transmission(gear, 100.0, 0.0)
    assert "maker's curve; backwards the same loss (assumed)" in text
    for speed, eta in ((104.7, 0.71), (366.5, 0.57)):
        one = (np.array([x]) for x in (87.0, 87.0, speed / 100.0, 0.0, False))
        assert 0.87 / motor_torque_bounds(transmission, *one, 1e-6)[0][0] == pytest.approx(
            eta, abs=2e-3
        )
    with pytest.raises(CatalogError, match=r"gears\.G`: `efficiency` 0.64 .*which is impossible"):
        one_drive(tmp_path, gear={**figures, "no_load_running_torque": 0.5})


@pytest.mark.filterwarnings("ignore:.*cannot be signed")
@pytest.mark.parametrize(
    ("part", "figure", "name"),
    [
        ("gear", "stiffness", "gear resonance"),
        ("gear", "backlash", "backlash"),
        ("gear", "none", "gear momentary peak torque"),  # no collision was stated
        ("motor", "thermal", "winding temperature"),
        ("motor", "max_speed", "motor speed"),
        ("motor", "resistance", "speed-torque line"),
    ],
)
def test_missing_figure_is_never_a_pass(tmp_path, part, figure, name):
    found = criterion(sized(tmp_path, **{part: {figure: None}}, conditions={"backlash": 1.0}), name)
    assert (found.status, found.margin) == (Status.NOT_CHECKED, None)
    assert found.note.startswith("no figure (")


def test_a_lower_limit_that_is_printed_stands_in_for_one_that_is_not(tmp_path):
    name = "gear repeated peak torque"
    for missing, figure in (
        ({}, "repeated_peak_torque"),
        ({"repeated_peak_torque": None}, "average_torque"),
        ({"repeated_peak_torque": None, "average_torque": None}, "rated_torque"),
    ):
        found = criterion(sized(tmp_path, gear=missing), name)
        assert found.available == GEAR[figure]
        assert found.note == (
            "" if not missing else f"the {figure.replace('_', ' ')}: no higher limit is known"
        )
    found = criterion(sized(tmp_path, gear={"max_input_speed": None}), "gear maximum input speed")
    assert found.available == GEAR["average_input_speed"]


def test_without_a_figure_for_the_motor_torque_nothing_is_chosen(tmp_path):
    for part in (
        {"gear": {"efficiency": None, "back_efficiency": None}},
        {"gear": {"input_inertia": None}},
        {"motor": {"rotor_inertia": None}},
        {"motor": {"continuous_torque": None, "thermal": None}},
    ):
        with pytest.warns(pf.PinfricWarning, match=r"be signed.*: ask its maker for"):
            joint = sized(tmp_path, **part)
        assert joint.choice is None
        assert joint.assessments[0].lacks
        assert not joint.assessments[0].failed


def test_mean_heat_can_refuse_a_motor_without_time_constants_but_not_pass_it(tmp_path):
    thermal = {"winding_housing": 2.0, "housing_ambient": 3.0, "max_winding": 125.0}
    found = criterion(sized(tmp_path, motor={"thermal": thermal}), "winding temperature")
    assert found.status == Status.NOT_CHECKED
    assert "at the mean heat" in found.note
    hot = {**thermal, "winding_housing": 60.0, "housing_ambient": 90.0}
    with pytest.warns(pf.PinfricWarning, match="winding temperature"):
        found = criterion(sized(tmp_path, motor={"thermal": hot}), "winding temperature")
    assert found.status == Status.FAILS


def test_run_away_fails_whatever_the_limit(tmp_path):
    for times in ({"winding_time": 20.0, "housing_time": 300.0}, {}):
        thermal = {"winding_housing": 600.0, "housing_ambient": 900.0, **times}
        with pytest.warns(pf.PinfricWarning, match="winding temperature: thermal runaway"):
            found = criterion(sized(tmp_path, motor={"thermal": thermal}), "winding temperature")
        assert found.status == Status.FAILS
        assert (found.required, found.available) == (np.inf, 80.0)  # of class A


def test_resistance_at_the_mean_heat_where_no_peak_is_known(tmp_path):
    thermal = {"winding_housing": 2.0, "housing_ambient": 3.0}
    figures = sized(tmp_path, motor={"thermal": thermal}).motor.figures
    assert figures.peak_temperature is None
    assert figures.hot == pytest.approx(1 + 0.0039 * (figures.mean_temperature - 25))
    assert figures.hot > 1.01


CURVE = {"thermal": None, "ambient_curve": [[40.0, 1.0], [60.0, 0.8]], "rated_ambient": 40.0}
CURVE["continuous_stall_torque"] = 0.4


@pytest.mark.parametrize(
    ("motor", "conditions", "left", "note"),
    [
        ({}, {"ambient": 75.0}, 0.5**0.5, "0.707 of the rating at 25 C"),
        ({}, {"ambient": 0.0}, 1.0, ""),  # no rating grows in the cold
        # the limit of the conditions stands in for the maker's, else that of the lowest class, A
        ({"thermal": None}, {"ambient": 75.0, "max_winding": 125.0}, 0.5**0.5, "0.707"),
        ({"thermal": None}, {"ambient": 60.0}, (45 / 80) ** 0.5, "0.75"),
        ({"rated_ambient": 40.0}, {"ambient": 75.0}, (50 / 85) ** 0.5, "at 40 C"),
        (CURVE, {"ambient": 50.0}, 0.9, "0.9"),
        (CURVE, {"ambient": 70.0}, None, "the maker's curve ends at 60 C; ambient temperature 70"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*(lack ratings|cannot be signed)")
def test_ambient_derates_the_continuous_torque(tmp_path, motor, conditions, left, note):
    joint = sized(tmp_path, motor, conditions=conditions)
    found = criterion(joint, "continuous torque")
    assert found.available == (left and pytest.approx(left * MOTOR["continuous_torque"]))
    assert note in found.note
    assert note or not found.note
    if left == 0.9:  # stall ratings, too
        assert joint.choice.candidate.ratings.stall_at(Conditions(ambient=50.0)) == pytest.approx(
            0.36
        )


@pytest.mark.parametrize(
    ("current", "resistance_of", "loss"),
    [
        ("dc", "terminals", 1.0),
        ("rms", "terminals", 1.5),
        ("rms", "phase", 3.0),
        ("peak", "terminals", 0.75),
        ("peak", "phase", 1.5),
    ],
)
def test_copper_loss_and_voltage_by_what_the_constant_is_printed_for(
    tmp_path, current, resistance_of, loss
):
    """Three phases lose 3 R_ph i_rms^2; the bus gives sqrt(3) times a phase's peak voltage."""
    convention = {"current": current, "resistance_of": resistance_of, "thermal": None}
    motor = sized(tmp_path, convention).motor
    k, r, torque = MOTOR["torque_constant"], MOTOR["resistance"], motor.torque_upper
    assert_allclose(
        motor.power - torque * motor.speed, loss * HOT * r * (torque / k) ** 2, rtol=1e-9, atol=1e-9
    )
    if current == "dc":
        return
    to_peak, phase = {"rms": np.sqrt(2), "peak": 1.0}[current], {"phase": 1.0, "terminals": 0.5}
    peak = to_peak * torque / k
    volts = np.sqrt(3) * np.abs(phase[resistance_of] * r * peak + (k / to_peak) / 1.5 * motor.speed)
    found = sized(tmp_path, convention).choice.candidate.ratings.voltage(torque, motor.speed)
    assert_allclose(found, volts, rtol=1e-9)


@pytest.mark.filterwarnings("ignore:.*(lack ratings|not below the winding's limit)")
def test_surroundings_hotter_than_the_winding_may_be_are_said_plainly(tmp_path):
    joint = sized(tmp_path, conditions={"ambient": 130.0})
    for name in ("continuous torque", "short-term torque", "winding temperature"):
        text = "ambient temperature 130 C, not below the winding's limit, 125 C ("
        assert f"{name}: {text}" in criterion(joint, name).why


def test_a_voltage_that_passes_hides_no_tighter_criterion(tmp_path):
    """A motor of the bus's own voltage with only a speed printed: 0 % by construction."""
    bare = {"torque_constant": None, "resistance": None, "thermal": None}
    line = {"nominal_voltage": 48.0, "max_speed": None, "rated_speed": 400.0}
    joint = sized(tmp_path, bare | line)
    assert criterion(joint, "motor voltage").margin == 0.0
    assert joint.choice.margin > 0.05
    low = sized(tmp_path, bare | line, conditions={"bus_voltage": 24.0}, on_miss="ignore")
    assert criterion(low, "motor voltage").scaled  # there it fails


def test_bus_voltage_far_above_the_motors_own(tmp_path):
    motor = {"nominal_voltage": 48.0}
    any_winding = criterion(sized(tmp_path, {"nominal_voltage": 12.0}), "bus voltage")
    assert (any_winding.status, any_winding.available) == (Status.PASSES, None)  # up to 60 V DC
    assert any_winding.note.startswith("extra-low voltage")
    joint = sized(tmp_path, conditions={"bus_voltage": 72.0})
    assert criterion(joint, "bus voltage").status == Status.NOT_CHECKED
    stated = sized(tmp_path, {**motor, "max_voltage": 80.0}, conditions={"bus_voltage": 75.0})
    assert criterion(stated, "bus voltage").available == 80.0
    assert criterion(stated, "bus voltage").note == "nominal voltage 48 V"
    unknown = sized(tmp_path, {"max_voltage": 80.0}, conditions={"bus_voltage": 75.0})
    assert criterion(unknown, "bus voltage").note == ""  # said to be nan V
    joint = sized(tmp_path, motor, conditions={"bus_voltage": 72.0})
    assert criterion(joint, "bus voltage").status == Status.PASSES
    assert joint.choice.margin > 0  # at its limit, but that is no tightness
    with pytest.warns(pf.PinfricWarning, match="bus voltage: needs 400 V, has 72 V"):
        joint = sized(tmp_path, motor, conditions={"bus_voltage": 400.0})
    assert joint.choice is None


def test_joint_that_stands_while_others_move_is_called_stalled(tmp_path):
    t, zero, nobody = np.linspace(0, 1, 11), np.zeros(11), np.zeros(11, dtype=bool)
    catalog = one_drive(tmp_path)
    candidate = motor_with_gear("M", catalog.motors["M"], "G", catalog.gears["G"], RATIO)
    effort = np.where(t < 0.25, 80.0, 5.0)  # 80 N m/100/0.8 = 1 N m at the motor
    cycle = DriveCycle(t, effort, effort, effort, zero, zero, ~nobody, nobody, 0.0)
    motor = motor_cycle(candidate, cycle, catalog.conditions)
    assert motor.figures.holding is None
    assert motor.figures.standing == pytest.approx(80 / RATIO / ETA)
    case = JointCase(sized(tmp_path).demand, cycle, 1.0, False, catalog.conditions)
    found = check(candidate, motor, case)
    assert "at standstill it needs up to 1 N m" in found[0].note
    # one sample at v = 0 is a reversal, not a stop
    turning = DriveCycle(t, effort, effort, effort, t - 0.5, zero, nobody, nobody, 0.0)
    assert not turning.standing.any()


@pytest.fixture
def coupling():
    """A row that no module knows: the torque of the coupling on the motor's shaft."""
    row = Limit(
        "coupling torque",
        need="motor torque",
        gives=lambda _: 0.3,
        unit="torque",
        formula="1.1 max |T_m| <= torque of the coupling",
        source="data sheet of the coupling",
        reserve=1.1,
    )
    add_limit(row)
    yield row
    LIMITS.remove(row)


def test_a_limit_added_in_one_row_is_in_size_sweep_and_retime(tmp_path, coupling):
    scene, motion = turntable(), trapezoid(turntable())
    joint = sized(tmp_path)
    found = criterion(joint, "coupling torque")
    assert found.required == pytest.approx(1.1 * MOTOR_UP, rel=1e-9)
    assert (found.available, found.unit) == (0.3, "N m")
    assert "1.1 max |T_m|" in found.formula
    sweep = sweep_of(
        motors={"table": {"drive": "M + G"}},
        sampling="grid",
        speed={"choice": {"values": [0.9, 1.0, 1.1, 1.3]}},
    )
    swept = pf.sweep(
        scene, motion, sweep | {"catalog": str(tmp_path / "catalog.yaml")}, processes=1
    )
    (trial,) = swept.trials
    met = 1.1 * swept.figure("motor_peak")[:, 0] <= 0.3
    assert met.any()
    assert not met.all()
    assert_array_equal(swept.met(trial)["coupling torque"], met)
    limits = {"table": joint.assessments[0].candidate}
    path = pf.Path.from_waypoints([[0.0], [2.0]])
    slow = pf.retime(scene, path, limits, heat=False, points=60)
    assert slow.limiting["table"]["coupling torque"] > 0.5
    torque = pf.inverse_dynamics(slow.problem.scene, slow.trajectory).motor_torque_upper
    assert np.abs(torque).max() == pytest.approx(0.3 / 1.1, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"name": "coupling torque"}, "limit 'coupling torque': exists already"),
        ({"need": "motor torqe"}, "need 'motor torqe'.*did you mean 'motor torque'"),
        ({"gives": "peak torq"}, "gives 'peak torq': give a function"),
        ({"unit": "rpm"}, "unit 'rpm': 'motor torque' is in SI: .*torque"),
    ],
)
def test_a_limit_that_cannot_be_is_refused(coupling, change, says):
    with pytest.raises(SizingError, match=says):
        add_limit(dataclasses.replace(coupling, **{"name": "typo"} | change))


def amplified(tmp_path, current, conditions=None, **figures):
    amplifier = {"source": "invented", "grade": "R", "current": current, **figures}
    catalog = one_drive(tmp_path, amplifiers={"A": amplifier})
    wanted = {"amplifiers": {"others": "A"}, **(conditions or {})}
    (joint,) = sized_cycle(catalog, conditions=wanted).joints
    return catalog, joint


@pytest.mark.parametrize(
    ("current", "factor"), [("dc", 1.0), ("rms", 1.5**0.5), ("peak", 0.75**0.5)]
)
def test_an_amplifier_limits_torque_by_its_currents(tmp_path, current, factor):
    """k per A DC is sqrt(3/2) k per A RMS and sqrt(3)/2 k per A of the peak of a phase."""
    k = MOTOR["torque_constant"]
    figures = {"continuous_current": 1.5, "peak_current": 12.0, "peak_time": 0.3}
    _, joint = amplified(tmp_path, current, **figures)
    peak = criterion(joint, "amplifier peak current")
    assert (peak.required, peak.available) == pytest.approx((MOTOR_UP, k * factor * 12.0), rel=1e-6)
    assert peak.note == f"12 A {current}"
    mean = criterion(joint, "amplifier continuous current")
    torques = np.array([MOTOR_UP, MOTOR_RUN, MOTOR_DOWN, MOTOR_REST])
    assert mean.required == pytest.approx(np.sqrt(PARTS @ torques**2 / CYCLE), rel=1e-6)
    assert mean.available == pytest.approx(k * factor * 1.5)
    # only speeding up takes more than it gives for ever
    assert MOTOR_UP > k * factor * 1.5 > max(np.abs(torques[1:]))
    overload = criterion(joint, "amplifier overload")
    assert (overload.required, overload.available) == pytest.approx((RAMP, 0.3), rel=1e-6)


def test_an_amplifier_without_figures_is_not_judged(tmp_path):
    open_ = criterion(sized(tmp_path), "amplifier currents")
    assert (open_.status, open_.note) == (
        Status.NOT_CHECKED,
        "no figure (conditions.amplifiers: which amplifier feeds it)",
    )
    _, joint = amplified(tmp_path, "dc", continuous_current=1.0)
    notes = {c.name: c.note for c in joint.assessments[0].not_checked}
    assert notes["amplifier peak current"] == "no figure (peak_current of the amplifier)"
    assert notes["amplifier overload"].startswith("no figure (continuous_current and peak_time")
    _, joint = amplified(tmp_path, "dc", continuous_current=30.0)
    assert criterion(joint, "amplifier overload").note == "never above its continuous current"
    for given, says in (
        ({"others": "B"}, "conditions.amplifiers.others: there is no amplifier 'B'"),
        ({"tabel": "A"}, "conditions.amplifiers: there is no drive 'tabel'"),
    ):
        with pytest.raises(CatalogError, match=says):
            amplified(tmp_path, "dc", {"amplifiers": given})


def test_the_smallest_amplifier_that_feeds_the_motor_is_named(tmp_path):
    """By hand: peak current MOTOR_UP/k, RMS of the four parts; 0.25 s above it for `short`."""
    k = MOTOR["torque_constant"]
    torques = np.array([MOTOR_UP, MOTOR_RUN, MOTOR_DOWN, MOTOR_REST])
    peak, mean = MOTOR_UP / k, float(np.sqrt(PARTS @ torques**2 / CYCLE)) / k
    assert peak > 1.2 * mean
    good = {"source": "invented", "grade": "R", "current": "dc", "peak_time": 0.3}
    good |= {"continuous_current": 1.1 * mean, "peak_current": 1.1 * peak}
    good |= {"min_voltage": 10.0, "max_voltage": 60.0}
    amplifiers = {
        "low peak": good | {"peak_current": 0.99 * peak},
        "weak": good | {"continuous_current": 0.99 * mean},
        "short": good | {"peak_time": 0.9 * RAMP},
        "low bus": good | {"max_voltage": 47.0},
        "high bus": good | {"min_voltage": 49.0},
        "unknown bus": {x: y for x, y in good.items() if x != "max_voltage"},
        "larger": good | {"continuous_current": 1.2 * mean, "peak_current": 1.2 * peak},
        # per A RMS of a phase it gives sqrt(3/2) times the torque
        "phase": good | {"current": "rms", "continuous_current": 0.85 * mean},
        "good": good,
    }
    catalog = one_drive(tmp_path, amplifiers=amplifiers)
    report = sized_cycle(catalog)
    motor = report.joints[0].motor.figures
    assert (motor.peak_current, motor.rms_current) == pytest.approx((peak, mean), rel=1e-6)
    assert motor.current_kind == "dc"
    assert report.amplifiers == (("phase", ""),)
    (row,) = [c for c in report.criteria[0] if c.name == "amplifier currents"]
    assert (row.status, row.scaled) == (Status.PASSES, False)
    del amplifiers["phase"], amplifiers["good"]
    report = sized_cycle(one_drive(tmp_path, amplifiers=amplifiers))
    assert report.amplifiers == (("larger", ""),)
    del amplifiers["larger"]
    report = sized_cycle(one_drive(tmp_path, amplifiers=amplifiers))
    assert report.amplifiers == (("", "no amplifier of the catalogue fits"),)
    (row,) = [c for c in report.criteria[0] if c.name == "amplifier currents"]
    assert row.unchecked
    assert row.lacks.startswith("no amplifier of the catalogue fits")


@pytest.mark.parametrize("limit", [{"max_voltage": 47.0}, {"min_voltage": 49.0}])
def test_an_amplifier_of_another_bus_is_not_signed(tmp_path, limit):
    figures = {"continuous_current": 30.0, "peak_current": 90.0, **limit}
    with pytest.warns(pf.PinfricWarning, match="amplifier (bus|least) voltage: needs 4"):
        _, joint = amplified(tmp_path, "dc", **figures)
    assert joint.choice is None


@pytest.mark.parametrize("kind", ["dc", "rms", "peak"])
def test_currents_are_torque_over_the_constant_that_the_maker_prints(tmp_path, kind):
    catalog = one_drive(tmp_path, motor={"current": kind})
    (joint,) = sized_cycle(catalog).joints
    figures = joint.motor.figures
    peak = MOTOR_UP / MOTOR["torque_constant"]
    assert (figures.peak_current, figures.current_kind) == (pytest.approx(peak, rel=1e-6), kind)


@pytest.mark.filterwarnings("ignore:.*cannot be signed")
def test_an_amplifier_feeds_a_gearmotor_by_its_constant_at_the_output(tmp_path):
    actuator = {
        "source": "invented",
        "grade": "R",
        "ratio": 50.0,
        "continuous_torque": 20.0,
        "peak_torque": 60.0,
        "max_speed": 10.0,
        "rotor_inertia": 5e-5,
        "mass": 1.0,
        "torque_constant": 4.0,
        "current": "rms",
        "backlash": 1e-4,
    }
    amplifier = {"source": "invented", "grade": "R", "peak_current": 6.0}
    more = {"gearmotors": {"A": actuator}, "amplifiers": {"P": amplifier}}
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", {}, {}, **more))
    scene, conditions = turntable(), {"amplifiers": {"others": "P"}, "backlash": 2e-4}
    (joint,) = sized_cycle(catalog, scene, conditions=conditions, on_miss="ignore").joints
    peak = criterion(joint, "amplifier peak current")
    assert (peak.available, peak.unit) == (pytest.approx(4.0 * 6.0), "N m")
    assert peak.required == pytest.approx(UP + 50**2 * 5e-5 * ACCELERATION)
    assert criterion(joint, "backlash").margin == pytest.approx(0.5)


SERVO = {
    **{key: GEAR[key] for key in ("source", "grade", "stiffness", "bearing")},
    **{"ratio": 200.0, "stall_torque": 200.0, "nominal_voltage": 12.0, "no_load_speed": 3.0},
    **{"rotor_inertia": 1e-6, "mass": 0.2, "max_voltage": 14.8},
}


def test_a_servo_of_which_only_the_stall_is_printed(tmp_path):
    """A fifth of it for ever, all of it for a moment, and the line from there to no load."""
    found = {}
    for name, more in {
        "stall": {},
        "printed": {"continuous_torque": 55.0, "peak_torque": 150.0},
        "current": {"torque_constant": 10.0, "peak_current": 5.0, "current": "peak"},
    }.items():
        content = {"motors": {}, "gears": {}, "gearmotors": {"S": SERVO | more}}
        catalog = load_catalog(write_catalog(tmp_path / "c.yaml", **content))
        given = {"bus_voltage": 12.0, "inertia_ratio": 1e4}
        (joint,) = sized_cycle(catalog, conditions=given, on_miss="ignore").joints
        found[name] = {c.name: c for c in joint.assessments[0].criteria}
    heat = [found[name]["continuous torque"] for name in ("stall", "printed")]
    assert [row.available for row in heat] == [40.0, 55.0]
    assert "0.2 x the stall torque, by rule (ROBOTIS, Torque Ratings, 2020)" in heat[0].note
    peaks = {name: rows["peak torque"] for name, rows in found.items()}
    assert {n: p.available for n, p in peaks.items()} == dict(stall=200, printed=150, current=50)
    assert "momentary" in peaks["stall"].note
    assert peaks["current"].note == "torque constant x largest current of its electronics"
    line = found["stall"]["speed-torque line"]
    up = UP + 200.0**2 * 1e-6 * ACCELERATION
    assert line.required == pytest.approx(12 * (HOT * up / 200 + RATE / 3), rel=1e-6)
    high = sized_cycle(catalog, conditions={"bus_voltage": 48.0}, on_miss="ignore").joints[0]
    bus = next(c for c in high.assessments[0].criteria if c.name == "bus voltage")
    assert (bus.status, bus.available) == (Status.FAILS, 14.8)


def test_an_amplifier_bounds_a_retimed_motion(tmp_path):
    amplified(tmp_path, "dc", peak_current=12.0)
    path = tmp_path / "motors.yaml"
    drive = "others: {drive: M + G}"
    fed = "conditions: {amplifiers: {table: A}}"
    path.write_text(f"pinfric_motors: 1\ncatalog: {tmp_path / 'catalog.yaml'}\n{fed}\n{drive}\n")
    (found,) = read_limits(turntable(), path)
    assert found.least("motor torque") == pytest.approx(12.0 * MOTOR["torque_constant"])


def test_back_driving_demanded_and_forbidden(tmp_path):
    def status(gear=None, **conditions):
        return criterion(sized(tmp_path, gear=gear, conditions=conditions), "back-driving").status

    locking = {"back_efficiency": -0.2}
    assert status() == Status.NOT_REQUIRED
    assert status(back_driving="required") == Status.PASSES
    assert status(locking, back_driving="forbidden") == Status.PASSES
    with pytest.warns(pf.PinfricWarning, match="back-driving"):
        assert status(locking, back_driving="required") == Status.FAILS
    with pytest.warns(pf.PinfricWarning, match="needs a brake"):
        assert status(back_driving="forbidden") == Status.FAILS


@pytest.mark.parametrize(
    ("needs", "has", "note", "said"),
    [
        (3.0, 4.0, "", "needs 3 h, has 4 h (25 % in reserve)"),
        (4.0, 4.0, "", "needs 4 h, has 4 h (0 % in reserve)"),
        (5.0, 4.0, "", "needs 5 h, has 4 h (short by 25 %)"),
        (1e4, 1e-9, "P", "needs 1e+04 h, has 1e-09 h (short by a factor of more than ten)"),
        (5.0, 0.0, "", "needs 5 h, has 0 h (short by a factor of more than ten)"),
        (5.0, 0.0, "too hot", "too hot"),
        (np.inf, 4.0, "it never ends", "it never ends"),
    ],
)
def test_margin_is_the_part_of_the_limit_that_is_left(needs, has, note, said):
    found = compare("x", needs, has, "h", "", "", note=note)
    assert found.why == f"x: {said}"
    assert (found.status == Status.PASSES) == (needs <= has)
    if has > 1.0:
        assert found.margin == pytest.approx(max(1 - needs / has, LEAST_MARGIN))
    # a voltage just below the most that is allowed is no tight drive
    assert compare("bus voltage", needs, has, "V", "", "").scaled == (needs > has)
    assert compare("peak torque", needs, has, "N m", "", "").scaled
    assert not compare("back-driving", needs, has, "N m", "", "").scaled


def test_a_continuous_torque_from_a_current_says_so(tmp_path):
    """0.1 N m/A at 4 A; a current's rms is sqrt(2/3) of the equivalent DC motor's constant."""
    motor = {"continuous_torque": None, "continuous_current": 4.0, "current": "rms"}
    catalog = one_drive(tmp_path, motor)
    ratings = ratings_of(catalog.motors["M"])
    assert ratings.continuous_torque == pytest.approx(0.4)
    assert ratings.torque_constant == pytest.approx(0.1 * np.sqrt(2 / 3))
    assert [figure for figure, _ in ratings.derived] == ["continuous torque", "line"]
    found = criterion(sized(tmp_path, motor), "continuous torque")
    assert "continuous torque = torque constant x continuous current" in found.note
    assert "per A rms" not in found.note  # of the line


def test_what_a_sample_asks_of_a_drive_by_hand():
    """Speeding up, standing, slowing down; at rest friction may hold it, or stand in its way."""
    scene = turntable()
    v, a = np.array([[1.0], [0.0], [1.0]]), np.array([[ACCELERATION], [0.0], [-ACCELERATION]])
    result = pf.inverse_dynamics(scene, np.zeros((3, 1)), v, a)
    worst, needed = signals(result, 2.0), signals(result, 2.0, needed=True)
    assert worst["effort"][:, 0] == pytest.approx([UP, COULOMB, -DOWN])
    assert needed["effort"][:, 0] == pytest.approx([UP, 0.0, -DOWN])
    assert worst["voltage"][:, 0] == pytest.approx([UP + 2.0, COULOMB, -DOWN - 2.0])
    assert needed["voltage"][:, 0] == pytest.approx([UP + 2.0, 0.0, -DOWN - 2.0])
    assert worst["acceleration"][:, 0] == pytest.approx([ACCELERATION, 0.0, ACCELERATION])


#: Values beside the defaults that every row of the table can be computed with.
GIVEN = yaml.safe_load("""
life: 20000.0
backlash: 0.001
back_driving: required
collision_effort: {table: 50.0}
collisions: {count: 100, duration: 0.15}
thermal_time: 300.0
hydraulic_flow: 0.002
amplifiers: {table: A}
""")
#: What a condition moves in passing: a warmer winding needs more voltage.
IN_PASSING = {("speed-torque line", "ambient")}
SLIDE = {"ratio": 628.3, "output": "linear", "kind": "ball screw", "stroke": 0.5, "stiffness": 1e7}
SCREW_PARTS = yaml.safe_load("""
screw: {root_diameter: 0.01, length: 0.6, supports: fixed-fixed}
bearing: {kind: ball screw, dynamic_rating: 5000.0, static_rating: 9000.0}
""")
NUT_PARTS = {"nut": {"diameter": 0.01, "contact_area": 1e-4, "max_pv": 1e5, "max_pressure": 5e6}}
RATED = {"dynamic_rating": 2e4, "static_rating": 3e4, "pitch_diameter": 0.07}


def variants(tmp_path):
    """Drives, each with its joint, whose criteria are all rows of `size`'s table."""
    amplifier = {
        "source": "invented",
        "grade": "R",
        "continuous_current": 1.0,
        "peak_current": 20.0,
    }
    more = {"amplifiers": {"A": {**amplifier, "peak_time": 10.0}}}
    bearing = {**GEAR["bearing"], **RATED}
    curve = {"effort_curve": [[0.0, 60.0], [900.0, 50.0]]}
    line = {
        "nominal_voltage": 48.0,
        "no_load_speed": 480.0,
        "stall_torque": 5.0,
        "max_speed": 500.0,
    }
    only = {"nominal_voltage": 60.0, "torque_constant": None}
    brake = {"B": {"source": "invented", "grade": "R", "torque": 5.0}}
    turning = turntable()
    for motor, gear in (
        ({}, {"kind": "strain wave", "bearing": bearing, "backlash": 5e-4}),
        ({"thermal": None, **line}, curve),
        ({"thermal": None, "thermal_time": 900.0, **only}, {"stiffness": None}),
        ({"thermal": {**MOTOR["thermal"], "max_winding": None}}, {}),
        ({"ambient_curve": [[25.0, 1.0], [90.0, 0.5]]}, {}),
        (
            {
                "stepper": {
                    "holding_torque": 1.0,
                    "current": 2.0,
                    "resistance": 1.0,
                    "inductance": 2e-3,
                }
            },
            {},
        ),
        ({}, {"kind": "cycloidal", "peak_turns": 3e4, "peaks_per_hour": 1e3}),
    ):
        catalog = one_drive(tmp_path, motor, gear, brakes=brake, **more)
        yield turning, trapezoid(turning), catalog
    lift = pf.Scene(chain(("table", pin.JointModelPZ(), lump(2.0))), stick_velocity=0.0)
    for parts in (SCREW_PARTS, {**NUT_PARTS, "kind": "lead screw"}):
        gear = {**SLIDE, "bearing": None, "back_driving_torque": None, **parts}
        yield lift, trapezoid(lift), one_drive(tmp_path, {}, gear, brakes=brake, **more)
    arm = chain(("pin", pin.JointModelRY(), lump(5.0, [0.5, 0.0, 0.0])))
    arm.addBodyFrame("ground", 0, pin.SE3.Identity(), 0)
    arm.addBodyFrame("arm", 1, pin.SE3.Identity(), 0)
    pushed = {"name": "table", "a": {"link": "ground", "xyz": [0.0, 0.0, -0.8]}}
    pushed["b"] = {"link": "arm", "xyz": [0.4, 0.0, 0.0]}
    on_oil = pf.Scene(arm, actuators=[Actuator(cylinder=pushed)], stick_velocity=0.0)
    oil = {"source": "invented", "grade": "R", "medium": "hydraulic", "bore": 0.04, "rod": 0.02}
    oil |= {"strokes": [0.2], "rated_pressure": 1.6e7, "max_speed": 1.0}
    yield on_oil, trapezoid(on_oil), one_drive(tmp_path, cylinders={"C": oil}, **more)


def changed(conditions, key):
    """The conditions with another value of one key; None if there is none to try."""
    given = getattr(conditions, key)
    others = {
        "collision_effort": {"table": 60.0},
        "collisions": {"count": 200, "duration": 0.15},
        "back_driving": "forbidden",
    }
    if isinstance(given, float | int):
        others[key] = 1.07 * given
    return parse_conditions({key: others[key]}, conditions) if key in others else None


def test_every_row_names_the_conditions_that_set_it_and_their_defaults(tmp_path):
    """Each condition is changed alone: the rows whose figures change are those that name it."""
    seen, named = set(), set()
    for scene, motion, catalog in variants(tmp_path):
        first = parse_conditions({**GIVEN, "holding_brake": "all"}, Conditions())
        joint = pf.size(scene, motion, catalog, conditions=first, on_miss="ignore").joints[0]

        def judged(conditions, joint=joint):
            search = joint.search
            case = search.case._replace(conditions=conditions)
            trial = DriveSearch(search.arrays, case, search.parts)
            return {c.name: c for c in trial.judge(0, 0, 0).criteria}

        before = judged(first)
        seen |= set(before)
        for key in Conditions.model_fields:
            if (conditions := changed(first, key)) is None:
                continue
            for name, after in judged(conditions).items():
                figures = [(c.status, c.required, c.available) for c in (before[name], after)]
                if figures[0] == figures[1] or (name, key) in IN_PASSING:
                    continue
                named.add((name, key))
                assert f"conditions.{key}" in before[name].condition, (name, key)
        for c in before.values():
            for part in filter(None, c.condition.split("; ")):
                key = part.split()[0].strip(",").removeprefix("conditions.")
                default = getattr(Conditions(), key)
                shown = f"{default:g}" if isinstance(default, float) else default or "none"
                own = key not in GIVEN
                assert part.endswith(", its default" if own else f", default {shown}")
            if c.status == Status.FAILS:
                assert c.condition in c.why
    rows = {limit.name for limit in LIMITS if limit.applies is not never}
    assert rows - seen <= {
        "guide static safety",
        "amplifier currents",
        "peak torque of braking",
        *(f"{what} loads" for what in ("guide", "screw", "bearing")),
    }
    assert len(named) > 20


@pytest.mark.parametrize(
    ("given", "row", "said"),
    [
        ({"supply_power": 1.0}, "supply power", "supply_power = 1, default none"),
        (
            {"supply_resistance": 50.0},
            "bus voltage under load",
            "supply_resistance = 50, default none; conditions.bus_voltage = 48, its default",
        ),
        (
            {"bus_limit": 49.0, "bus_capacitance": 1e-6},
            "braking energy",
            "bus_capacitance = 1e-06, default none; conditions.bus_limit = 49, default none; "
            "conditions.bus_voltage = 48, its default",
        ),
        ({"reversal_error": 1e-9}, "reversal error", "reversal_error = 1e-09, default none"),
        ({"lowest_frequency": 90.0}, "lowest frequency", "lowest_frequency = 90, default none"),
        (
            {"holding_brake": "all", "brake_factor": 9.0},
            "holding brake",
            "brake_factor = 9, default 1.5; conditions.holding_brake = all, default where_needed",
        ),
    ],
)
def test_what_brakes_bus_and_robot_miss_names_its_condition_too(tmp_path, given, row, said):
    """A swinging arm on one gear; its brake holds 4 times the load."""
    model = chain(("table", pin.JointModelRY(), lump(2.0, [0.3, 0.0, 0.0])))
    scene = pf.Scene(model, stick_velocity=0.0)
    brake = {"source": "invented", "grade": "R", "torque": 4 * 2.0 * 9.81 * 0.3 / 100}
    catalog = one_drive(tmp_path, {}, {"backlash": 1e-4}, brakes={"B": brake})
    t = np.linspace(0.0, 1.0, 201)
    q = 0.4 * np.sin(2 * np.pi * t)
    motion = pf.Trajectory.from_arrays(scene, t, q[:, None])
    report = pf.size(scene, motion, catalog, conditions=given, on_miss="ignore")
    assert report.joints[0].choice is not None
    (missed,) = [text for text in report.verdict.failing if row in text]
    assert f"conditions.{said}" in missed


@pytest.mark.parametrize(("arcmin", "said"), [(15.0, True), (3.1, True), (3.0, False)])
def test_backlash_beyond_that_of_robots_gears_is_said(arcmin, said, tmp_path):
    catalog = one_drive(tmp_path, gear={"backlash": float(np.radians(arcmin / 60.0))})
    lines = backlash_line(sizing_summary(sized_cycle(catalog, on_miss="ignore")))
    assert (
        lines
        == [f"backlash, arcmin at the joint: table {arcmin:.3g}; conditions.backlash limits it"]
        * said
    )
