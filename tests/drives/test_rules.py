"""Rules of makers against the examples that makers print."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from sizing_cases import write_catalog

import pinfric as pf
from pinfric.drives.catalog import Screw
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status
from pinfric.drives.rules import buckling_load, critical_speed, dn_speed


def screw(d, length, supports, **more):
    return Screw(root_diameter=d, length=length, supports=supports, **more)


def test_buckling_as_makers_print_it():
    # THK KR: fixed-fixed, 1300 mm, 17.5 mm at the root: 11 000 N printed
    assert buckling_load(screw(0.0175, 1.3, "fixed-fixed")) == pytest.approx(11e3, rel=0.01)
    # MISUMI: diameter 15, lead 5, 12.5 mm at the root, 820 mm, fixed-supported: 3630 N printed
    assert buckling_load(screw(0.0125, 0.82, "fixed-supported")) == pytest.approx(3630, rel=0.005)


@pytest.mark.parametrize(
    ("supports", "printed"),
    [
        ("fixed-free", 3.4),
        ("supported-supported", 9.7),
        ("fixed-supported", 15.1),
        ("fixed-fixed", 21.9),
    ],
)
def test_critical_speed_by_the_coefficients_of_a_catalogue(supports, printed):
    """THK: 10^7 x coefficient x d/l^2 rpm, in mm."""
    rpm = critical_speed(screw(0.0125, 0.79, supports)) * 30 / np.pi
    assert rpm == pytest.approx(printed * 12.5 / 790**2 * 1e7, rel=0.015)


def test_dn_value():
    given = screw(0.0125, 0.79, "fixed-free", ball_circle=0.0155, max_dn=70_000.0)
    assert dn_speed(given) * 30 / np.pi == pytest.approx(70_000 / 15.5)
    assert dn_speed(screw(0.0125, 0.79, "fixed-free")) is None


def lifted(tmp_path, entry, mass):
    """A slide that is lifted by 0.2 m in a second, on one screw."""
    model = chain(("lift", pin.JointModelPZ(), lump(mass)))
    scene = pf.Scene(model=model)
    t = np.linspace(0.0, 2.0, 201)
    q = 0.1 * (1 - np.cos(np.pi * t))
    motion = pf.Trajectory.from_arrays(scene, t, q[:, None])
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", gears={"S": entry}))
    (joint,) = pf.size(scene, motion, catalog, on_miss="ignore").joints
    return joint


def test_a_screw_without_a_length_is_not_judged(tmp_path):
    entry = {
        "source": "invented",
        "grade": "R",
        "kind": "ball screw",
        "output": "linear",
        "ratio": 2 * np.pi / 0.005,
        "mass": 0.5,
        "input_inertia": 1e-6,
        "efficiency": 0.9,
        "bearing": {"kind": "ball screw", "static_rating": 2e4, "dynamic_rating": 1e4},
    }
    unknown = lifted(tmp_path, entry, 10.0)
    assert unknown.choice is None
    assert unknown.assessments[0].lacks == ("maximum input speed", "stroke")
    # a complete unit: its maker rates it for its stroke
    unit = {**entry, "max_input_speed": 700.0, "rated_torque": 300.0, "stroke": 0.25}
    whole = lifted(tmp_path, unit, 10.0)
    assert whole.choice is not None
    found = {c.name: c for c in whole.assessments[0].criteria}["screw buckling"]
    assert (found.available, found.note) == (
        300.0,
        "the maker's rated force of a unit of 0.25 m stroke",
    )
    entry["screw"] = {"root_diameter": 0.0125, "length": 0.5, "supports": "fixed-supported"}
    known = lifted(tmp_path, entry, 10.0)
    assert known.choice is not None
    found = {c.name: c for c in known.assessments[0].criteria}
    speed = found["screw critical speed"]
    assert speed.required == pytest.approx(0.1 * np.pi * entry["ratio"], rel=1e-3)
    assert speed.available == pytest.approx(15.09 * 12.5 / 500**2 * 1e7 * np.pi / 30, rel=2e-3)
    force = found["screw buckling"]
    assert force.required == pytest.approx(10 * (9.81 + 0.1 * np.pi**2), rel=1e-3)
    assert force.status == Status.PASSES
    entry["screw"] = {"root_diameter": 0.004, "length": 1.5, "supports": "fixed-free"}
    slender = lifted(tmp_path, entry, 10.0)
    assert {c.name for c in slender.assessments[0].failed} >= {
        "screw critical speed",
        "screw buckling",
    }


def test_pressure_and_pv_of_a_plastic_nut(tmp_path):
    """PV = F/A times the thread's sliding speed, helix length per turn sqrt((pi d)^2 + lead^2)."""
    lead, d, area = 0.005, 0.011, 1.5e-4
    entry = {
        "source": "invented",
        "grade": "R",
        "kind": "lead screw",
        "output": "linear",
        "ratio": 2 * np.pi / lead,
        "mass": 0.5,
        "input_inertia": 1e-6,
        "efficiency": 0.5,
        "screw": {"root_diameter": 0.0085, "length": 0.3, "supports": "fixed-supported"},
    }
    bare = lifted(tmp_path, entry, 5.0)
    assert bare.assessments[0].lacks == ("permissible force",)
    nut = {"diameter": d, "contact_area": area, "max_pressure": 1e6, "max_pv": 2e5}
    joint = lifted(tmp_path, {**entry, "nut": nut}, 5.0)
    t = np.linspace(0.0, 2.0, 201)
    force = 5 * (9.81 + 0.1 * np.pi**2 * np.cos(np.pi * t))
    turns = 0.1 * np.pi * np.abs(np.sin(np.pi * t)) / lead  # per second
    found = {c.name: c for c in joint.assessments[0].criteria}
    assert found["nut pressure"].required == pytest.approx(force.max() / area, rel=1e-6)
    pv = (force / area * turns * np.hypot(np.pi * d, lead)).max()
    assert found["nut PV value"].required == pytest.approx(pv, rel=1e-6)
    assert found["nut PV value"].margin == pytest.approx(1 - pv / 2e5, rel=1e-6)
    assert "screw loads" not in found  # a nut that slides has no rolling elements
    assert not joint.assessments[0].lacks
    unknown = lifted(tmp_path, {**entry, "nut": {"diameter": d, "contact_area": area}}, 5.0)
    notes = {c.name: c.note for c in unknown.assessments[0].not_checked}
    assert notes["nut PV value"] == "no figure (nut: diameter, contact_area and max_pv)"


def test_a_belts_force_falls_with_its_speed(tmp_path):
    entry = {
        "source": "invented",
        "grade": "R",
        "kind": "belt",
        "output": "linear",
        "ratio": 30.0,
        "mass": 0.5,
        "input_inertia": 1e-6,
        "efficiency": 0.95,
        "repeated_peak_torque": 1000.0,
        "max_input_speed": 300.0,
        "effort_curve": [[0.0, 70.0], [3.0, 60.0], [10.0, 50.0]],
    }
    joint = lifted(tmp_path, entry, 5.0)
    t = np.linspace(0.0, 2.0, 201)
    force = 5 * (9.81 + 0.1 * np.pi**2 * np.cos(np.pi * t))
    allowed = np.interp(30 * 0.1 * np.pi * np.abs(np.sin(np.pi * t)), [0, 3, 10], [70, 60, 50])
    found = {c.name: c for c in joint.assessments[0].criteria}["gear effort at its speed"]
    assert found.margin == pytest.approx((1 - force / allowed).min(), rel=1e-6)
    short = lifted(tmp_path, {**entry, "effort_curve": [[0.0, 70.0], [3.0, 60.0]]}, 5.0)
    found = {c.name: c for c in short.assessments[0].criteria}["gear effort at its speed"]
    assert found.note == "no figure (the maker's curve ends below the input speed)"
