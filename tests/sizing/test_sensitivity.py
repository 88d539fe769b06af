"""Which joint needs another drive first: against sizings of the scaled loads, by themselves."""

import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump
from sizing_cases import COULOMB, GEAR, INERTIA, RATE, one_drive, trapezoid, turntable

import pinfric as pf
from pinfric.show.pages.sizing import sizing_page
from pinfric.show.report.drives import sensitivity_table
from pinfric.sizing.sensitivity import FACTORS
from pinfric.sizing.summary import sizing_summary

#: A gear without losses: of friction only the table's own is left.
LOSSLESS = {"efficiency": 1.0, "back_efficiency": 1.0}


def loaded(friction=1.0, load=1.0):
    """A turntable whose payload turns with it."""
    table = turntable(friction={"table": dry(friction * COULOMB)})
    model = table.model.copy()
    model.addBodyFrame("table", 1, pin.SE3.Identity(), 0)
    half = 0.5 * INERTIA * load
    body = {"link": "table", "mass": 1.0 * load, "com": [0.0, 0.0, 0.0]}
    payload = body | {"inertia": (half, 0.0, 0.0, half, 0.0, half)}
    return pf.Scene(
        model=model, friction=table.friction, payloads={"disc": payload}, stick_velocity=0.0
    )


def holds(catalog, scene, speed=1.0):
    """Whether the only drive fits."""
    motion = trapezoid(scene).with_speed(speed)
    return pf.size(scene, motion, catalog, on_miss="ignore").joints[0].choice is not None


@pytest.mark.parametrize("torque", [0.32, 0.36, 0.5, 0.6])
def test_the_first_factor_is_that_of_sizings_of_the_scaled_loads(tmp_path, torque):
    limits = {"peak_torque": 1.2 * torque, "continuous_torque": torque, "thermal": None}
    catalog = one_drive(tmp_path, limits, LOSSLESS)
    scene = loaded()
    report = pf.size(scene, trapezoid(scene), catalog, on_miss="ignore", sensitivity=True)
    assert report.verdict.signed
    alone = {
        "friction and losses": lambda f: holds(catalog, loaded(friction=f)),
        "payload": lambda f: holds(catalog, loaded(load=f)),
        "speed of the cycle": lambda f: holds(catalog, scene, f),
    }
    assert [row.what for row in report.sensitivity] == list(alone)
    for row in report.sensitivity:
        wanted = next((f for f in FACTORS if not alone[row.what](f)), None)
        assert row.factor == wanted
        assert row.joints == (() if wanted is None else ("table",))
        assert bool(row.why) == (wanted is not None)
    found = {row.factor for row in report.sensitivity}
    assert len(found) > 1  # they differ


def test_losses_of_the_chosen_gear_grow_with_friction(tmp_path):
    """Without friction of its own the table needs more of the motor by the gear's losses alone."""
    scene = turntable(friction={})
    motors = {"peak_torque": 0.24, "continuous_torque": 0.2, "thermal": None}
    rows = []
    for efficiency in (1.0, GEAR["efficiency"]):
        gear = {"efficiency": efficiency, "back_efficiency": efficiency}
        catalog = one_drive(tmp_path, motors, gear)
        report = pf.size(scene, trapezoid(scene), catalog, on_miss="ignore", sensitivity=True)
        assert report.verdict.signed
        rows.append(report.sensitivity[0].factor)
    assert rows[0] is None
    assert rows[1] in FACTORS


def test_a_joint_that_does_not_fit_as_given_is_not_said_to_change(tmp_path):
    model = chain(
        *(
            (f"t{k}", pin.JointModelRZ(), pin.Inertia(1.0, np.zeros(3), x * np.eye(3)))
            for k, x in enumerate((INERTIA, 40.0 * INERTIA))
        ),
        beside=True,
    )
    scene = pf.Scene(model=model, stick_velocity=0.0)
    one = trapezoid(turntable())
    v, a = np.repeat(one.v, 2, axis=1), np.repeat(one.a, 2, axis=1)
    motion = pf.Trajectory.from_arrays(scene, one.t, 0 * v, v, a)
    report = pf.size(scene, motion, one_drive(tmp_path), on_miss="ignore", sensitivity=True)
    assert [joint.choice is not None for joint in report.joints] == [True, False]
    assert {name for row in report.sensitivity for name in row.joints} <= {"t0"}
    summary, table = sizing_summary(report), sensitivity_table(sizing_summary(report))
    assert summary.sensitivity == report.sensitivity
    assert len(table.rows) == len(report.sensitivity)
    assert "where the choice changes first" in sizing_page(report).replace("Where", "where")
    assert sensitivity_table(sizing_summary(replace(report, sensitivity=()))) is None


def test_a_larger_brake_is_a_change(tmp_path):
    """m g r through the gear: the small brake bears 1.2 times the payload, the gear twice."""
    arm = chain(("lift", pin.JointModelRY(), lump(1.0, [0.1, 0.0, 0.0])))
    arm.addBodyFrame("arm", 1, pin.SE3.Identity(), 0)
    bag = {"link": "arm", "mass": 10.0, "com": [0.2, 0.0, 0.0], "inertia": (0.1, 0, 0, 0.1, 0, 0.1)}
    scene = pf.Scene(model=arm, payloads={"bag": bag}, stick_velocity=0.0)
    held = [9.81 * (0.1 * 1.0 + factor * 0.2 * 10.0) / GEAR["ratio"] for factor in (1.2, 3.0)]
    brake = {"source": "invented", "grade": "R", "mass": 0.1, "rotor_inertia": 1e-6}
    brakes = {f"B{k}": brake | {"torque": torque} for k, torque in enumerate(held)}
    motor = {"continuous_torque": 2.0, "peak_torque": 5.0, "thermal": None, "resistance": 0.1}
    catalog = one_drive(tmp_path, motor, LOSSLESS, brakes=brakes)
    motion = pf.Trajectory.from_arrays(scene, [0.0, 1.0], *np.zeros((3, 2, 1)))
    conditions = {"holding_brake": "all", "brake_factor": 1.0, "inertia_ratio": 1e3}
    report = pf.size(scene, motion, catalog, conditions=conditions, sensitivity=True)
    assert report.joints[0].choice.candidate.brake == "B0"
    (payload,) = [row for row in report.sensitivity if row.what == "payload"]
    assert (payload.factor, payload.why) == (1.25, "holding brake")


def test_loads_that_are_only_tried_are_not_warned_of(tmp_path):
    """The cycle is as fast as friction was measured; at 1.05 times the speed it is faster."""
    measured = {"robot": "a table", "side": "joint", "source": "invented", "grade": "A"}
    scene = turntable(measured=measured | {"speed": (0.0, 1.01 * RATE)})
    catalog = one_drive(tmp_path, {"continuous_torque": 5.0, "peak_torque": 9.0})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pf.size(scene, trapezoid(scene), catalog, on_miss="ignore", sensitivity=True)
    with pytest.warns(pf.PinfricWarning, match="faster than friction was measured"):
        pf.size(scene, trapezoid(scene).with_speed(1.05), catalog, on_miss="ignore")
