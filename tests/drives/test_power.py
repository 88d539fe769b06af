"""The bus of all drives, by independent sums."""

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry
from sizing_cases import MOTOR, one_drive, sized_cycle, trapezoid, turntable

import pinfric as pf
from pinfric.drives.criterion import Status
from pinfric.drives.duty import once
from pinfric.drives.policy import Conditions
from pinfric.drives.power import _with_prefix, bus_power
from pinfric.errors import CatalogError
from pinfric.motions.summary import ends_by_magnitude


def tables(second=1.0):
    """Two turntables on one ground; the second's inertia is a multiple of the first's."""
    bodies = [pin.Inertia(1.0, np.zeros(3), x * np.diag([1.0, 1.0, 2.0])) for x in (1.0, second)]
    both = ((f"table_{k}", pin.JointModelRZ(), body) for k, body in enumerate(bodies))
    return pf.Scene(chain(*both, beside=True), stick_velocity=0.0)


def turning(scene, delay=0, samples=60):
    """Both turn as `trapezoid`, the second some samples later."""
    one = trapezoid(turntable(), samples)
    part = [np.roll(x[:, 0], k * delay) for x in (one.v, one.a) for k in range(2)]
    v, a = np.column_stack(part[:2]), np.column_stack(part[2:])
    return pf.Trajectory.from_arrays(scene, one.t, 0 * v, v, a)


@pytest.mark.parametrize("delay", [0, 60, 100])
def test_the_bus_carries_the_sum_of_all_drives(tmp_path, delay):
    """Power that one drive feeds back while the other draws never reaches the supply."""
    scene = tables()
    conditions = {
        "inertia_ratio": 100,
        "bus_limit": 60.0,
        "bus_capacitance": 1e-3,
        "supply_power": 40.0,
    }
    catalog = one_drive(tmp_path)
    report = pf.size(scene, turning(scene, delay), catalog, conditions=conditions, on_miss="ignore")
    t, power = report.result.t, 0.0
    for joint in report.joints:
        torque = ends_by_magnitude(joint.motor.torque_lower, joint.motor.torque_upper)[0]
        hot = 1 + 0.0039 * (joint.motor.winding.winding - 25)
        current = torque / MOTOR["torque_constant"]
        power += torque * joint.motor.speed + MOTOR["resistance"] * hot * current**2
    fine = np.linspace(t[0], t[-1], 400_001)
    at = np.interp(fine, t, power)
    back, bursts, run = np.maximum(-at, 0) * (fine[1] - fine[0]), [0.0], 0.0
    for x in np.concatenate([back, back]):  # a cycle into the next
        run = run + x if x > 0 else 0.0
        bursts.append(run)
    bus = report.bus
    assert (bus.peak, bus.braking) == pytest.approx((power.max(), -power.min()))
    assert (bus.returned, bus.burst) == pytest.approx((back.sum(), max(bursts)), rel=1e-3)
    assert bus.drawn - bus.returned == pytest.approx(np.trapezoid(power, t))
    assert bus.current == pytest.approx(power.max() / 48)
    assert bus.resistor == pytest.approx(60**2 / -power.min())
    assert bus.resistor_power == pytest.approx(bus.returned / (t[-1] - t[0]))
    assert bus.capacitance == pytest.approx(bus.burst / ((60**2 - 48**2) / 2))
    supply, capacitors, _ = bus.criteria
    assert supply.status == (Status.PASSES if power.max() <= 40 else Status.FAILS)
    assert capacitors.available == pytest.approx(1e-3 / 2 * (60**2 - 48**2))
    assert ("bus: supply power: needs" in " ".join(report.verdict.failing)) == (power.max() > 40)


@pytest.mark.parametrize(("supply", "status"), [(1.0, Status.FAILS), (1e3, Status.NOT_CHECKED)])
def test_power_known_in_part_passes_no_supply(tmp_path, supply, status):
    scene, catalog = turntable(), one_drive(tmp_path, {"resistance": None, "thermal": None})
    conditions = {"supply_power": supply}
    bus = sized_cycle(catalog, scene, conditions=conditions, on_miss="ignore").bus
    assert bus.at_least
    assert bus.criteria[0].status == status


def test_a_bus_may_rise_to_its_limit_only():
    with pytest.raises(CatalogError, match="bus_limit 40 V is not above bus_voltage 48 V"):
        sized_cycle(conditions={"bus_limit": 40.0})


def test_a_bus_into_which_nothing_flows_needs_nothing(tmp_path):
    scene = turntable(friction={"table": dry(40.0)})
    bus = sized_cycle(one_drive(tmp_path), scene, on_miss="ignore").bus
    assert (bus.returned, bus.resistor, bus.capacitance) == (0.0, None, None)
    assert bus.remedy.startswith("no energy is fed back")
    unknown = one_drive(tmp_path, motor={"rotor_inertia": None})
    bus = sized_cycle(unknown, scene, on_miss="ignore").bus
    assert bus.remedy == "not known: no drive has a motor with the needed data"


def test_the_bus_sags_by_the_resistance_of_its_supply(tmp_path):
    """U (U_0 - U) = R_s P at every instant; the drives need their voltage at that instant."""
    scene, catalog = tables(), one_drive(tmp_path)

    def bus(resistance):
        conditions = {"inertia_ratio": 100, "supply_resistance": resistance}
        report = pf.size(scene, turning(scene), catalog, conditions=conditions, on_miss="ignore")
        found = {c.name: c for c in report.bus.criteria}
        return report, report.bus, found["bus voltage under load"]

    report, found, sag = bus(0.5)
    drawn = found.power.max()
    assert found.lowest * (48.0 - found.lowest) == pytest.approx(0.5 * drawn)
    held = 24 + np.sqrt(24**2 - 0.5 * np.maximum(found.power, 0))
    worst = 0.0
    for joint in report.joints:
        k, r = MOTOR["torque_constant"], MOTOR["resistance"]
        hot = 1 + 0.0039 * (joint.motor.winding.peak - 25)
        for torque in (joint.motor.torque_lower, joint.motor.torque_upper):
            needed = np.abs(hot * r / k * torque + k * joint.motor.speed)
            worst = max(worst, (needed / 0.9 / held).max())  # 0.9: of the amplifier
    assert sag.required / sag.available == pytest.approx(worst)
    assert (sag.status, sag.margin) == (Status.PASSES, pytest.approx(1 - worst))
    _, found, sag = bus(1.01 * 24**2 / drawn)  # beyond U_0^2/(4 P)
    assert found.lowest is None
    assert (sag.status, sag.note) == (
        Status.FAILS,
        "the supply cannot deliver this power through its resistance",
    )


def test_a_sag_that_lacks_a_figure_is_not_judged(tmp_path):
    scene, catalog = turntable(), one_drive(tmp_path)
    bus = sized_cycle(catalog, scene, on_miss="ignore").bus
    sag = bus.criteria[2]
    assert (sag.status, sag.note) == (
        Status.NOT_CHECKED,
        "no figure (conditions.supply_resistance)",
    )
    unknown = one_drive(tmp_path, {"resistance": None, "thermal": None})
    conditions = {"supply_resistance": 0.1}
    bus = sized_cycle(unknown, scene, conditions=conditions, on_miss="ignore").bus
    assert bus.criteria[2].status == Status.NOT_CHECKED


@pytest.mark.parametrize("known", ["all", "power", "voltage"])
def test_a_sag_passes_only_where_power_and_voltage_of_all_drives_are_known(tmp_path, known):
    scene, conditions = tables(), {"inertia_ratio": 100, "supply_resistance": 0.1}
    report = pf.size(scene, turning(scene), one_drive(tmp_path), conditions=conditions)
    motors = {joint.name: joint.motor for joint in report.joints}
    voltages = {name: np.full(len(report.result.t), 40.0) for name in motors}
    if known == "power":
        voltages["table_1"] = None
    if known == "voltage":
        motors["table_1"] = None
    bus = bus_power(motors, report.result.t, report.duty, report.conditions, voltages)
    sag = bus.criteria[2]
    if known == "all":
        assert (sag.status, sag.required) == (Status.PASSES, 40.0)
    else:
        assert (sag.status, sag.required) == (Status.NOT_CHECKED, None)
        assert "the power and the speed-torque line of all drives" in sag.note


@pytest.mark.parametrize(
    ("value", "said"),
    [(2.77e4, "27.7 k"), (656.0, "656 "), (999.6, "1 k"), (0.012, "12 m"), (3.4e-5, "34 u")],
)
def test_values_of_parts_have_the_prefix_of_their_unit(value, said):
    assert _with_prefix(value) == said


def test_rounding_of_a_drives_powers_feeds_nothing_back():
    """It asked for a resistor of 1.7e12 Mohm."""
    t, driven = np.linspace(0.0, 1.0, 5), np.array([1.0, 0.1, 0.2, 0.7, 1.0])

    def bus(rest):
        motors = {name: SimpleNamespace(power=x, copper=True) for name, x in rest.items()}
        return bus_power(motors, t, once(5), Conditions(), {})

    rounded = bus({"a": driven, "b": np.array([0.0, -0.1 - 1e-14, 0.0, 0.0, 0.0])})
    assert rounded.resistor is None
    assert rounded.remedy.startswith("no energy is fed back")
    assert bus({"a": driven, "b": np.array([0.0, -0.1001, 0.0, 0.0, 0.0])}).resistor is not None


def test_drives_that_feed_nothing_back_do_not_speak_for_others(tmp_path):
    still = dry(40.0)
    scene = tables().with_(friction={"table_0": still, "table_1": still})
    catalog = one_drive(tmp_path)
    report = pf.size(scene, turning(scene), catalog, on_miss="ignore")
    assert report.bus.remedy.startswith("no energy is fed back")
    motors = {joint.name: joint.motor for joint in report.joints} | {"table_1": None}
    bus = bus_power(motors, report.result.t, report.duty, report.conditions, {})
    assert bus.remedy == "1 of 2 drives feed nothing back; the others are not known"
