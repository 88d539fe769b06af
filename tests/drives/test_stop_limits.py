"""The load on a gear when its brake closes, by hand, and the stops of the chosen drive."""

import re

import numpy as np
import pinocchio as pin
import pytest
from mechanisms import add_link, bar, five_bar, grounded_model, shifted
from sizing_cases import GEAR, MOTOR, one_drive, sized_cycle, trapezoid, turntable, write_catalog

import pinfric as pf
from pinfric.drives.criterion import Status
from pinfric.drives.limits import SHOCK
from pinfric.errors import SizingError
from pinfric.stops.machines import Machines, stop_settings
from pinfric.stops.screen import PEAK_RESERVE, screened_stops

BRAKE = {
    "source": "invented",
    "grade": "R",
    "torque": 0.5,
    "torque_max": 0.7,
    "engage_time": 0.02,
    "stop_energy": 20.0,
    "rotor_inertia": 1e-5,
}
STOPS = {"category": 0, "reaction_time": 0.01, "per_hour": 4}
#: The rotor at the joint: 100^2 of motor, gear and brake; beside 2 kg m^2 of table.
HEAVY = 1e4 * (5e-5 + 1e-5 + 1e-5) / 2.0


def sized(tmp_path, brake=BRAKE, gear=None, stops=STOPS, **given):
    scene = turntable().with_(stops=stops)
    catalog = one_drive(tmp_path, MOTOR, {**GEAR, **(gear or {})}, brakes={"B": brake})
    required = {"holding_brake": "all"}
    given = {"conditions": required, "on_miss": "ignore", **given}
    return sized_cycle(catalog, scene, **given)


def row(report):
    (found,) = [c for c in report.joints[0].assessments[0].criteria if c.name == SHOCK]
    return found


@pytest.fixture(scope="module")
def braked(tmp_path_factory):
    """A gear that bears 130 N m, more than both reserves ask of the algebra."""
    return sized(tmp_path_factory.mktemp("braked"), gear={"momentary_peak_torque": 130.0})


@pytest.mark.parametrize("factor", [1.3, 1.5])
@pytest.mark.parametrize("stops", [STOPS, None])
def test_peak_of_a_closing_brake_by_hand(tmp_path, stops, factor):
    """0.7 N m x 100 on a gear that passes 0.7 of the load on, with a reserve, simulated or not."""
    peak = factor * 70.0 / (0.7 + HEAVY)
    reserve = {} if factor == 1.3 else {"stop_factor": factor}  # the default
    required = {"holding_brake": "all", **reserve}
    gear = {"momentary_peak_torque": 130.0}
    found = row(sized(tmp_path, gear=gear, stops=stops, conditions=required))
    assert found.required == pytest.approx(peak, rel=1e-6)
    assert (found.available, found.status) == (130.0, Status.PASSES)
    gears = {
        "G": {**GEAR, "momentary_peak_torque": peak - 1.0},
        "H": {**GEAR, "mass": 1.5, "momentary_peak_torque": peak + 1.0},
    }
    path = write_catalog(tmp_path / "c.yaml", gears=gears, brakes={"B": BRAKE})
    scene = turntable().with_(stops=stops)
    report = sized_cycle(path, scene, conditions=required, on_miss="ignore")
    assert report.joints[0].choice.candidate.gear_name == "H"


def test_stops_in_the_scene_demand_no_less_of_a_gear(tmp_path):
    """One reserve: simulated, the row of the stop asks 1.3 times the peak of a rigid gear, too."""
    without, beside = (row(sized(tmp_path, stops=stops)).required for stops in (None, STOPS))
    assert beside == pytest.approx(without, rel=1e-9)
    tight = {"momentary_peak_torque": 1.2 * (70.0 - HEAVY * 3.0) / (0.7 + HEAVY)}
    for stops in (None, STOPS):
        assert not sized(tmp_path, gear=tight, stops=stops).verdict.signed


def test_a_brake_of_unknown_mass_and_inertia_loads_its_gear_too(tmp_path):
    """Twice 0.5 N m x 100, J_r of motor and gear alone: its own inertia may be next to none."""
    bare = {"source": "invented", "grade": "R", "torque": 0.5}
    report = sized(tmp_path, gear={"momentary_peak_torque": 200.0}, brake=bare, stops=None)
    heavy = 1e4 * (5e-5 + 1e-5) / 2.0
    assert row(report).required == pytest.approx(1.3 * 100.0 / (0.7 + heavy), rel=1e-6)
    assert report.joints[0].installed.candidate.brake == "B"
    assert "B: largest torque taken as 2 x 0.5 N m, mass taken as 0.28 T^0.7" in report.notes[-1]


def test_the_gear_in_a_gearmotor_has_no_figure_and_a_direct_drive_no_gear(tmp_path):
    entry = {
        "source": "invented",
        "grade": "R",
        "continuous_torque": 40.0,
        "peak_torque": 90.0,
        "rotor_inertia": 5e-5,
        "mass": 1.0,
        "max_speed": 6.0,
    }
    drives = {"A": {**entry, "ratio": 100.0}, "D": {**entry, "ratio": 1.0}}
    path = write_catalog(
        tmp_path / "c.yaml", motors={}, gears={}, gearmotors=drives, brakes={"B": BRAKE}
    )
    required = {"holding_brake": "all"}
    report = sized_cycle(path, conditions=required, on_miss="ignore")
    lacks = {
        a.candidate.name: [c.lacks for c in a.criteria if c.name == SHOCK]
        for a in report.joints[0].assessments
    }
    assert lacks == {"A": ["momentary peak of the gear in the gearmotor"], "D": []}


def test_another_peak_stands_in_for_a_momentary_one(tmp_path):
    """T2B of a planetary gear stands in for an unprinted T2Not, and the report says so."""
    found = row(sized(tmp_path, gear={"momentary_peak_torque": None}))
    assert (found.available, found.status) == (60.0, Status.FAILS)
    assert found.note.endswith("the repeated peak torque: no higher limit is known")


def test_stops_of_the_chosen_drive_are_in_the_report(braked):
    """Friction of the table slows it, too: 0.7 t = -70 - J_r (t - 3)/2 of 71 N m without it."""
    (axis,) = braked.stops.axes
    assert axis.peak == pytest.approx((70.0 - HEAVY * 3.0) / (0.7 + HEAVY), rel=1e-6)
    by_name = {c.name: c for c in axis.criteria}
    gear = by_name["gear momentary peak torque"]
    assert (gear.required, gear.available) == (pytest.approx(1.3 * axis.peak), 130.0)
    assert by_name["brake energy of a stop"].available == 20.0
    assert by_name["brake stops in an hour"].status == Status.NOT_CHECKED
    assert not braked.verdict.failing


def test_the_stops_are_computed_while_it_sizes(tmp_path, monkeypatch):
    steps = []
    monkeypatch.setattr("pinfric.sizing.choice.cycle_peaks", lambda *_: np.full(1, np.nan))
    report = sized(tmp_path, progress=steps.append)
    assert "stops of the chosen drives" in steps
    counts = [step for step in steps if step.startswith("stops of the chosen drives: ")]
    assert re.fullmatch(r"stops of .* drives: (\d+) of about \1", counts[-1])
    assert steps[-1] == "the robot with these drives"
    monkeypatch.setattr("pinfric.stops.search.stop_motion", None)  # nothing is stopped later
    assert report.verdict.failing == ()


def rows_of_stops(report):
    return {c.name: c for c in report.screened.criteria[0]}


#: The table turns at 1.5 rad/s; a brake's least torque is 50 N m at the joint.
KINETIC = (2.0 + 2.0 * HEAVY) * 1.5**2 / 2.0
#: Its way until the command takes effect, until the brake closes, and until it stands.
WAY = 1.5 * 0.03 + KINETIC / 50.0


def test_stops_that_algebra_settles_are_not_simulated(braked):
    """The brake takes at most all there is; the gear's peak with both reserves."""
    found = rows_of_stops(braked)
    assert not braked.screened.search.found
    assert found["brake energy of a stop"].required == pytest.approx(KINETIC)
    assert found["gear momentary peak torque"].required == pytest.approx(
        PEAK_RESERVE * 1.3 * 70.0 / (0.7 + HEAVY), rel=1e-6
    )
    assert braked.stops.axes[0].energy < KINETIC
    assert braked.stops.axes[0].travel < WAY


@pytest.mark.parametrize("permitted", [2.3, 2.2])
def test_an_energy_that_algebra_leaves_open_is_that_of_simulated_stops(braked, permitted):
    """More than the brake may take by the bound; at its greatest it takes 2.22 J, 2.20 at least."""
    (drive,) = braked.scene.actuators
    gear = drive.transmission
    weak = gear.brake.model_copy(update={"stop_energy": permitted})
    gear = gear.model_copy(update={"brake": weak})
    scene = braked.scene.with_(actuators=[drive.model_copy(update={"transmission": gear})])
    motion = trapezoid(scene)
    machines = Machines(scene, stop_settings(scene, None), ())
    found = screened_stops(machines, motion, np.array([60.0]), lambda *_: None)
    judged = {c.name: c for c in found.criteria[0]}
    energy = judged["brake energy of a stop"]
    assert energy.required == pytest.approx(2.2226, rel=1e-3)
    assert energy.fails == (permitted < energy.required)
    assert {case.kind.greatest for case in found.search.found} == {False, True}
    assert judged["gear momentary peak torque"].source.startswith("algebra")
    assert energy.required == found.result.axes[0].energy
    strong = screened_stops(machines, motion, None, lambda *_: None)  # algebra tells no peak
    assert {case.kind.greatest for case in strong.search.found} == {False, True}
    assert strong.peaks == {0: found.result.axes[0].peak}


@pytest.mark.parametrize("room", [0.3, 0.1, 0.08])
def test_a_place_that_algebra_leaves_open_is_that_of_simulated_stops(tmp_path, room):
    """A limit beyond the end of the cycle: farther than 2.2 times the way, nearer, too near."""
    scene = turntable().with_(stops=STOPS)
    motion = trapezoid(scene)
    model = scene.model.copy()
    model.lowerPositionLimit[:] = -10.0
    model.upperPositionLimit[:] = motion.q[:, 0].max() + room
    limited = scene.with_(model=model)
    gear = {**GEAR, "momentary_peak_torque": 130.0}
    catalog = one_drive(tmp_path, MOTOR, gear, brakes={"B": BRAKE})
    required = {"holding_brake": "all"}
    report = pf.size(limited, motion, catalog, conditions=required, on_miss="ignore")
    found = rows_of_stops(report)["position limit"]
    assert bool(report.screened.search.found) == found.source.startswith("simulated")
    whole = {c.name: c for c in report.stops.axes[0].criteria}["position limit"]
    assert found.fails == whole.fails
    if not report.screened.search.found:
        assert found.required >= whole.required
    else:
        assert found.required == whole.required


def test_a_stop_that_is_not_met_is_unmet(tmp_path):
    report = sized(tmp_path, brake={**BRAKE, "stop_energy": None, "stops_per_hour": 2.0})
    assert any("brake stops in an hour: needs 4" in line for line in report.verdict.failing)
    with pytest.raises(SizingError, match="brake stops in an hour"):
        report.check()
    unknown = sized(tmp_path, brake={**BRAKE, "engage_time": None})
    assert unknown.stops is None
    assert any("has no `engage_time`" in line for line in unknown.verdict.failing)


def test_without_a_section_on_stops_nothing_is_stopped(tmp_path):
    report = sized(tmp_path, stops=None)
    assert report.stops is None
    assert not report.verdict.failing


def test_a_stopped_robot_gets_a_brake_that_is_known_to_close(tmp_path):
    scene = turntable().with_(stops=STOPS)
    brakes = {"A": {**BRAKE, "torque": 0.4, "torque_max": 0.6, "engage_time": None}, "B": BRAKE}
    catalog = one_drive(tmp_path, MOTOR, GEAR, brakes=brakes)
    required = {"holding_brake": "all"}
    report = sized_cycle(catalog, scene, conditions=required, on_miss="ignore")
    assert report.standstills[0].brake == "B"
    assert report.no_stops == ""


def test_stops_that_a_brake_without_a_time_prevents_say_which_brake(tmp_path):
    report = sized(tmp_path, brake={**BRAKE, "engage_time": None})
    assert report.stops is None
    assert report.no_stops.startswith("stops: B of the catalogue has no `engage_time`; give it")


def test_a_gear_that_a_stop_overloads_gives_way_to_one_that_bears_it(tmp_path, monkeypatch):
    monkeypatch.setattr("pinfric.sizing.choice.cycle_peaks", lambda *_: np.array([110.0]))
    gears = {"G": GEAR, "H": {**GEAR, "mass": 1.5, "momentary_peak_torque": 150.0}}
    path = write_catalog(tmp_path / "c.yaml", gears=gears, brakes={"B": BRAKE})
    steps, required = [], {"holding_brake": "all"}
    scene = turntable().with_(stops=STOPS)
    given = {"conditions": required, "on_miss": "ignore", "progress": steps.append}
    report = sized_cycle(path, scene, **given)
    assert report.joints[0].choice.candidate.gear_name == "H"
    (found,) = [c for c in report.joints[0].choice.criteria if c.name == SHOCK]
    assert (found.required, found.available) == (1.3 * 110.0, 150.0)
    assert steps.count("peaks of all gears in stops, by algebra") == 2
    assert steps.count("stops of the chosen drives") == 1
    alone = one_drive(tmp_path, MOTOR, GEAR, brakes={"B": BRAKE})
    with pytest.raises(SizingError, match="no gear of the catalogue bears the stop"):
        sized_cycle(alone, scene, conditions=required, on_miss="raise")


def test_what_a_simulated_stop_overloads_must_bear_a_little_more(tmp_path, monkeypatch):
    """The algebra says nothing here; 1.3 times the simulated 65.7 N m is more than the 85 of G."""
    monkeypatch.setattr("pinfric.sizing.choice.cycle_peaks", lambda *_: np.full(1, np.nan))
    gears = {
        "G": {**GEAR, "momentary_peak_torque": 85.0},
        "H": {**GEAR, "mass": 1.5, "momentary_peak_torque": 86.0},
        "I": {**GEAR, "mass": 2.0, "momentary_peak_torque": 88.0},
    }
    path = write_catalog(tmp_path / "c.yaml", gears=gears, brakes={"B": BRAKE})
    scene = turntable().with_(stops=STOPS)
    report = sized_cycle(path, scene, conditions={"holding_brake": "all"}, on_miss="ignore")
    peak = 1.3 * (70.0 - HEAVY * 3.0) / (0.7 + HEAVY)
    assert 85.0 < peak < 86.0 < 1.02 * peak < 88.0
    assert report.joints[0].choice.candidate.gear_name == "I"
    (found,) = [c for c in report.joints[0].choice.criteria if c.name == SHOCK]
    assert found.required == pytest.approx(1.02 * peak, rel=1e-6)


def test_a_gear_that_only_a_simulated_stop_overloads_is_not_signed(tmp_path):
    """0.06 N m of its own drag brake beside the brake's 0.7 N m; the algebra leaves friction out.

    1.3 x 66.7 N m by algebra, 1.3 x 71.4 N m of (70 + 6 - 3 J_r)/(0.7 + J_r) of the stop.
    """
    drags = {**GEAR, "no_load_running_torque": 0.06}
    gears = {
        "G": {**drags, "momentary_peak_torque": 90.0},
        "H": {**drags, "mass": 1.5, "momentary_peak_torque": 105.0},
    }
    peak = (76.0 - HEAVY * 3.0) / (0.7 + HEAVY)
    assert 1.3 * 70.0 / (0.7 + HEAVY) < 90.0 < 1.3 * peak < 105.0
    scene, required = turntable().with_(stops=STOPS), {"holding_brake": "all"}
    given = {"conditions": required, "on_miss": "ignore"}
    brakes = {"B": BRAKE}
    alone = write_catalog(tmp_path / "a.yaml", gears={"G": gears["G"]}, brakes=brakes)
    report = sized_cycle(alone, scene, **given)
    assert not report.verdict.signed
    assert not sized_cycle(alone, turntable(), **given).verdict.failing  # no `stops`
    both = sized_cycle(
        write_catalog(tmp_path / "b.yaml", gears=gears, brakes=brakes), scene, **given
    )
    assert both.verdict.signed
    assert both.joints[0].choice.candidate.gear_name == "H"
    found = rows_of_stops(both)["gear momentary peak torque"]
    assert found.required == pytest.approx(1.3 * peak, rel=1e-6)
    assert found.source.startswith("simulated")


def test_a_motor_that_cannot_brake_at_the_deceleration_of_a_stop_does_not_fit(tmp_path):
    """2 kg m^2 x 5 less 3 N m of friction drive the gear, 0.7 of it arrive; the rotor is added."""
    decelerated = {"category": 1, "reaction_time": 0.01, "deceleration": {"table": 5.0}}
    report = sized(tmp_path, stops=decelerated)
    by_name = {c.name: c for c in report.joints[0].choice.criteria}
    found = by_name["peak torque of braking"]
    assert found.required == pytest.approx(7.0 * 0.7 / 100.0 + 100.0 * 7e-5 * 5.0, rel=1e-6)
    assert found.available == 2.0
    hard = {**decelerated, "deceleration": {"table": 300.0}}
    (joint,) = sized(tmp_path, stops=hard).joints
    assert joint.choice is None
    assert "peak torque of braking" in joint.no_fit


def parallelogram(tmp_path, **given):
    """`sized` of a crank that carries a level bar on a circle, turning in a level plane.

    Two cranks of 0.2 m and 3 kg, and a bar of 5 kg that turns with neither: about the driven crank
    2 x 3 x 0.2^2/3 + 5 x 0.2^2 kg m^2.
    """
    model = grounded_model(gravity=(0.0, 0.0, -9.81))
    crank = add_link(model, 0, pin.JointModelRZ(), shifted(0.0), "crank", bar(3.0, 0.2))
    other = add_link(model, 0, pin.JointModelRZ(), shifted(0.5), "other", bar(3.0, 0.2))
    add_link(model, crank, pin.JointModelRZ(), shifted(0.2), "level", bar(5.0, 0.5))
    assert other == 2
    a, b = {"link": "level", "xyz": [0.5, 0, 0]}, {"link": "other", "xyz": [0.2, 0, 0]}
    loop = {"name": "pin", "kind": "planar_pin", "axis": [0, 0, 1], "a": a, "b": b}
    scene = pf.Scene(model, loops=[loop], actuators=[{"joint": "crank"}], masses="without_drives")
    t = np.linspace(0.0, 1.0, 101)
    angle, rate, turn = 0.5 + 0.75 * t**2 - 0.5 * t**3, 1.5 * (t - t**2), 1.5 - 3.0 * t
    each = np.array([1.0, 1.0, -1.0])  # the bar stays level
    motion = pf.Trajectory.from_arrays(scene, t, *(np.outer(x, each) for x in (angle, rate, turn)))
    catalog = one_drive(tmp_path, MOTOR, GEAR, brakes={"B": BRAKE})
    return pf.size(scene, motion, catalog, on_miss="ignore", **given)


def test_peak_and_inertia_of_a_crank_in_a_loop_by_hand(tmp_path):
    """As of a chain: 70 N m on a gear that passes 0.7 of the load, 1.3 times; J_load is 0.28."""
    load = 2 * 3.0 * 0.2**2 / 3 + 5.0 * 0.2**2
    report = parallelogram(tmp_path, conditions={"holding_brake": "all", "inertia_ratio": 0.42})
    rows = {c.name: c for c in report.joints[0].installed.criteria}
    assert rows["inertia ratio"].required == pytest.approx(load / (1e4 * 7e-5), rel=1e-9)
    peak = 1.3 * 70.0 / (0.7 + 1e4 * 7e-5 / load)
    assert rows[SHOCK].required == pytest.approx(peak, rel=1e-6)
    assert report.verdict.signed


def test_where_several_drives_share_a_motion_stops_must_be_simulated(tmp_path):
    """Three drives of a five-bar with two freedoms: no algebra tells what a closing brake does."""
    scene, q = five_bar("B", {}, gravity=(0.0, 0.0, -9.81))
    scene = scene.with_(actuators=[{"joint": name, "share": 0.5} for name in ("O", "D", "A")])
    still = np.tile(scene.close(q), (2, 1))
    motion = pf.Trajectory.from_arrays(scene, [0.0, 1.0], still, 0 * still, 0 * still)
    catalog = one_drive(tmp_path, MOTOR, GEAR, brakes={"B": BRAKE})
    required = {"holding_brake": "all", "inertia_ratio": 1e3}
    report = pf.size(scene, motion, catalog, conditions=required, on_miss="ignore")
    assert all(joint.choice for joint in report.joints)
    assert not report.verdict.signed
    assert report.verdict.failing[0].startswith(
        "O: stop: gear momentary peak torque: fails: drives do not determine the motion"
    )
    assert not report.verdict.question
