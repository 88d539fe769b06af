"""Rules of makers against the examples that makers print."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from sizing_cases import write_catalog

import pinfric as pf
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status


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


BALL_SCREW = {
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


def test_a_screw_without_a_length_is_not_judged(tmp_path):
    entry = BALL_SCREW.copy()
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


def test_a_plastic_nut_is_judged_by_its_figures(tmp_path):
    """A nut that slides has no rolling elements."""
    entry = BALL_SCREW | {"kind": "lead screw", "efficiency": 0.5, "bearing": None}
    entry["screw"] = {"root_diameter": 0.0085, "length": 0.3, "supports": "fixed-supported"}
    nut = {"diameter": 0.011, "contact_area": 1.5e-4}
    for more in (None, nut, nut | {"max_pressure": 1e6, "max_pv": 2e5}):
        found = lifted(tmp_path, entry | {"nut": more}, 5.0).assessments[0]
        assert found.lacks == (("permissible force",) if more is None else ())
        criteria = {c.name: c for c in found.criteria}
        if more and "max_pv" in more:
            pv = criteria["nut PV value"]
            assert pv.margin == pytest.approx(1 - pv.required / 2e5)
            assert "screw loads" not in criteria
        elif more:
            note = criteria["nut PV value"].note
            assert note == "no figure (nut: diameter, contact_area and max_pv)"


def test_a_belts_force_falls_with_its_speed(tmp_path):
    entry = BALL_SCREW | {"kind": "belt", "ratio": 30.0, "efficiency": 0.95, "bearing": None}
    entry |= {"repeated_peak_torque": 1000.0, "max_input_speed": 300.0}
    entry["effort_curve"] = [[0.0, 70.0], [3.0, 60.0], [10.0, 50.0]]
    joint = lifted(tmp_path, entry, 5.0)
    t = np.linspace(0.0, 2.0, 201)
    force = 5 * (9.81 + 0.1 * np.pi**2 * np.cos(np.pi * t))
    allowed = np.interp(30 * 0.1 * np.pi * np.abs(np.sin(np.pi * t)), [0, 3, 10], [70, 60, 50])
    found = {c.name: c for c in joint.assessments[0].criteria}["gear effort at its speed"]
    assert found.margin == pytest.approx((1 - force / allowed).min(), rel=1e-6)
    short = lifted(tmp_path, {**entry, "effort_curve": [[0.0, 70.0], [3.0, 60.0]]}, 5.0)
    found = {c.name: c for c in short.assessments[0].criteria}["gear effort at its speed"]
    assert found.note == "no figure (the maker's curve ends below the input speed)"
