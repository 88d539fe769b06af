"""The bus of all drives, the next smaller drives, and sets that trade off, by brute force."""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from sizing_cases import GEAR, MOTOR, load_catalog, one_drive, trapezoid, turntable, write_catalog

import pinfric as pf
from pinfric.errors import CatalogError
from pinfric.show.report.drives import sets_table
from pinfric.study.sizing.criterion import Status
from pinfric.study.summary import ends_by_magnitude


def tables(second=1.0):
    """Two turntables on one ground; the second's inertia is a multiple of the first's."""
    model = pin.Model()
    for k, scale in enumerate((1.0, second)):
        model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), f"table_{k}")
        body = pin.Inertia(1.0, np.zeros(3), scale * np.diag([1.0, 1.0, 2.0]))
        model.appendBodyToJoint(k + 1, body, pin.SE3.Identity())
    return pf.Scene(model=model, stick_velocity=0.0)


def turning(scene, delay=0, samples=60):
    """Both turn as `trapezoid`, the second some samples later."""
    one = trapezoid(turntable(), samples)
    part = [np.roll(x[:, 0], k * delay) for x in (one.v, one.a) for k in range(2)]
    v, a = np.column_stack(part[:2]), np.column_stack(part[2:])
    return pf.Trajectory.from_arrays(scene, one.t, 0 * v, v, a)


@pytest.mark.parametrize("delay", [0, 60, 100])
def test_the_bus_carries_the_sum_of_all_drives(tmp_path, delay):
    """What one drive feeds back while the other draws never reaches the supply."""
    scene = tables()
    conditions = {"inertia_ratio": 100, "bus_limit": 60.0, "bus_capacitance": 1e-3,
                  "supply_power": 40.0}  # fmt: skip
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
    supply, capacitors = bus.criteria
    assert supply.status == (Status.PASSES if power.max() <= 40 else Status.FAILS)
    assert capacitors.available == pytest.approx(1e-3 / 2 * (60**2 - 48**2))
    assert ("bus: supply power: needs" in " ".join(report.short)) == (power.max() > 40)


@pytest.mark.parametrize(("supply", "status"), [(1.0, Status.FAILS), (1e3, Status.NOT_CHECKED)])
def test_power_known_in_part_passes_no_supply(tmp_path, supply, status):
    scene, catalog = turntable(), one_drive(tmp_path, {"resistance": None, "thermal": None})
    conditions = {"supply_power": supply}
    bus = pf.size(scene, trapezoid(scene), catalog, conditions=conditions, on_miss="ignore").bus
    assert bus.at_least
    assert bus.criteria[0].status == status


def test_a_bus_may_rise_to_its_limit_only():
    scene = turntable()
    with pytest.raises(CatalogError, match="bus_limit 40 V is not above bus_voltage 48 V"):
        pf.size(scene, trapezoid(scene), conditions={"bus_limit": 40.0})


def test_a_bus_into_which_nothing_flows_needs_nothing(tmp_path):
    scene = turntable(friction={"table": {"coulomb": {"static": 40.0, "kinetic": 40.0}}})
    bus = pf.size(scene, trapezoid(scene), one_drive(tmp_path), on_miss="ignore").bus
    assert (bus.returned, bus.resistor, bus.capacitance) == (0.0, None, None)
    assert bus.remedy.startswith("nothing flows back")


MOTORS = {  # heavier ones with less resistance, or cheaper ones
    name: {k: v for k, v in MOTOR.items() if k != "thermal"}  # they stay as cold as they are
          | {"mass": mass, "resistance": resistance, "rotor_inertia": inertia, "price": price}
    for name, mass, resistance, inertia, price in (
        ("light", 0.5, 2.0, 5e-5, 300.0), ("medium", 0.8, 0.9, 6e-5, 300.0),
        ("heavy", 1.2, 0.4, 2e-4, 300.0), ("cheap", 0.9, 2.1, 7e-5, 100.0),
        ("poor", 1.3, 2.2, 3e-4, 400.0))
}  # fmt: skip


def test_no_set_is_better_than_those_found(tmp_path):
    scene = tables(1.5)
    gears = {"G": {**GEAR, "price": 50.0}}
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", MOTORS, gears))
    report = pf.size(scene, turning(scene, 30, 20), catalog, conditions={"inertia_ratio": 100})
    t, found = report.result.t, []
    for pair in product(*(joint.assessments for joint in report.joints)):
        power = 0.0
        for judged, cycle in report.judge(dict(enumerate(pair))):
            assert judged.fits
            single = next(a for a in pair if a.candidate is judged.candidate)
            torque = cycle.effort_upper  # no friction in the joints: one value
            ratio, eta, back = GEAR["ratio"], GEAR["efficiency"], GEAR["back_efficiency"]
            load = np.where(torque * cycle.velocity > 0, torque / eta, torque * back) / ratio
            shaft = load + ratio * single.candidate.rotor_inertia * cycle.acceleration
            power = power + shaft * ratio * cycle.velocity
            power = power + single.candidate.ratings.resistance * (shaft / 0.1) ** 2
        mass = sum(a.candidate.mass for a in pair)
        price = sum(MOTORS[a.candidate.motor]["price"] + 50 for a in pair)
        energy = np.trapezoid(np.maximum(power, 0), t)
        found.append((mass, energy, power.max(), price))
    for kept in report.sets:
        for mass, energy, peak, price in found:  # none is better by more than 1 % of each
            assert not (mass < kept.mass and price <= kept.price and energy < 0.99 * kept.energy
                        and peak < 0.99 * kept.peak_power)  # fmt: skip
    for mass, energy, peak, price in found:  # and each is reached
        assert any(s.mass <= 1.011 * mass and s.price <= 1.011 * price
                   and s.energy < 1.011 * energy and s.peak_power < 1.011 * peak
                   for s in report.sets)  # fmt: skip
    assert report.sets[0].mass == pytest.approx(report.drive_mass)
    assert len(report.sets) >= 4
    assert not any("poor" in drive for s in report.sets for drive in s.drives.values())


def test_a_motor_whose_copper_loss_is_not_known_betters_none_whose_is(tmp_path):
    """It seems to draw less, for its loss is not in the sum."""
    silent = {k: v for k, v in MOTORS["light"].items() if k != "resistance"}
    motors = {"light": MOTORS["light"], "silent": {**silent, "mass": 0.4, "price": 200.0}}
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", motors, {"G": {**GEAR, "price": 50}}))
    scene = turntable()
    report = pf.size(scene, trapezoid(scene), catalog, conditions={"inertia_ratio": 100})
    silent, light = report.sets
    assert (silent.copper, light.copper) == (False, True)
    assert silent.mass < light.mass
    assert silent.energy < light.energy
    assert "tried betters (≥: without the copper loss of some, and" in sets_table(report).title


def test_the_next_smaller_says_what_it_lacks(tmp_path):
    motors = {
        "small": {**MOTOR, "mass": 0.3, "continuous_torque": 0.06, "thermal": None},
        "tiny": {**MOTOR, "mass": 0.1, "continuous_torque": 0.02, "thermal": None},
        "large": {**MOTOR, "mass": 1.0, "thermal": None},
    }
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", motors))
    scene = turntable()
    (joint,) = pf.size(scene, trapezoid(scene), catalog).joints
    assert joint.choice.candidate.motor == "large"
    assert joint.next_smaller.candidate.motor == "small"
    short = joint.next_smaller.failed[0]
    assert short.name in ("continuous torque", "short-term torque")
    assert short.shortfall == f"{100 * (joint.motor.figures.rms / 0.06 - 1):.3g} %"
