"""Typical arms with their typical drives: each gets an answer."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump

import pinfric as pf

AXES = {"x": pin.JointModelRX, "y": pin.JointModelRY, "z": pin.JointModelRZ}
RING = "Harmonic Drive CSG/HFUC-2UH-32 output bearing"
#: A hobby arm: no brakes, bearings of its own, softer than an industrial one.
SOFT = {"holding_brake": "any", "resonance_base": 3.0, "resonance_hand": 5.0, "bus_voltage": 36.0}
#: Axes, lengths (m) and masses (kg) of bare links with their load, reaches (rad), s, conditions.
ARMS = {
    "AR4-like": (
        *("zyyxyx", [0.06, 0.3, 0.22, 0.05, 0.05, 0.05], [1.0, 1.2, 0.9, 0.4, 0.3, 1.0]),
        *([1.5, 0.8, -0.8, 1.0, 0.8, 1.0], 4.0, SOFT),
    ),
    "Moveo-like": (
        *("zyyxy", [0.05, 0.22, 0.22, 0.1, 0.1], [0.5, 0.6, 0.4, 0.2, 0.3]),
        *([1.2, 0.8, -0.8, 0.8, 0.8], 6.0, SOFT),
    ),
    "palletiser, 40 kg": (
        *("zyyyz", [0.3, 1.1, 1.0, 0.2, 0.1], [60.0, 40.0, 25.0, 10.0, 45.0]),
        *([1.5, 0.6, -0.6, 0.3, 1.5], 4.0, {"bus_voltage": 565.0}),
    ),
    "Go2 leg": (
        *("xyy", [0.09, 0.21, 0.21], [0.68, 1.15, 4.0], [0.4, 0.6, -0.9], 0.8),
        {"holding_brake": "any", "bus_voltage": 28.8},
    ),
}


def sized(name, catalog):
    axes, lengths, masses, reaches, period, conditions = ARMS[name]
    places = [[0.0, 0.0, 0.0], *([x, 0.0, 0.0] for x in lengths)]
    links = [
        (f"{k + 1}", AXES[axis](), lump(masses[k], [lengths[k] / 2, 0.0, 0.0]), places[k])
        for k, axis in enumerate(axes)
    ]
    scene = pf.Scene(model=chain(*links), masses="without_drives")
    t, reach = np.linspace(0.0, period, 301), np.array(reaches)
    w = 2 * np.pi / period
    parts = [(1 - np.cos(w * t)) / 2, w * np.sin(w * t) / 2, w**2 * np.cos(w * t) / 2]
    motion = pf.Trajectory.from_arrays(scene, t, *(np.outer(part, reach) for part in parts))
    own = {"bearings": dict.fromkeys(scene.actuator_names, RING)} if conditions is SOFT else {}
    return pf.size(scene, motion, catalog, conditions=conditions | own, on_miss="ignore")


def built_of(name):
    """The part of the bundled catalogue that such a machine is built of."""
    whole = pf.load_catalog()
    steppers = {n: m for n, m in whole.motors.items() if m.stepper}
    kinds = {n: g for n, g in whole.gears.items() if g.kind in ("planetary", "belt")}
    if name == "Go2 leg":
        return replace(whole, motors={}, gears={})
    if name.startswith("palletiser"):
        return replace(whole, motors={n: m for n, m in whole.motors.items() if "Fagor" in n})
    return replace(whole, motors=steppers, gears=kinds, gearmotors={}, brakes={})


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_every_joint_gets_an_answer(name):
    """Signed, or provisional with what to ask for; `-s` prints the table of the evidence."""
    report = sized(name, built_of(name))
    for joint in report.joints:
        taken = joint.installed
        state = f"{taken.margin:.0%}" if joint.choice else f"ask for {', '.join(taken.lacks)}"
        drive = taken.candidate
        peak = f"{joint.demand.peak:.3g} N m"
        print(f"| {name} | {joint.name} | {peak} | {drive.name} | {drive.mass:.2f} | {state} |")
        assert joint.choice or taken.would, joint.no_fit
    signed = [joint.choice is not None for joint in report.joints]
    drives = [joint.installed.candidate for joint in report.joints]
    if name == "Go2 leg":
        assert not any(signed)
    elif name.startswith("palletiser"):
        assert signed == [False, False, True, True, True]
        assert [drive.gear.kind for drive in drives[:2]] == ["cycloidal"] * 2
        assert all("input inertia" in joint.installed.lacks for joint in report.joints[:2])
    else:
        assert all(signed)
        assert all(drive.ratings.special for drive in drives)
