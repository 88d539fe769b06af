"""Belts: lengths against a contour, torque and stiffness by a catalogue's own example."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from sizing_cases import GEAR, MOTOR, sized_cycle, write_catalog

from pinfric.drives.catalog import Belt
from pinfric.drives.catalog_file import load_catalog
from pinfric.errors import CatalogError
from pinfric.show.report.drives import provisional_table
from pinfric.sizing.summary import sizing_summary

#: AT5-16 at 600 rpm; of a tooth 29.1 N/cm.
AT5 = {
    **{"source": "invented", "grade": "R", "pitch": 0.005, "width": 0.016},
    **{"teeth_in": 20.0, "teeth_out": 20.0, "length": 1.1, "allowable_tension": 1120.0},
    **{"specific_stiffness": 280e3, "mass_per_length": 0.05, "max_input_speed": 419.0},
    **{"tooth_load": [[0.0, 3640.0], [62.8, 2910.0], [419.0, 1800.0]], "most_teeth": 12.0},
}


@pytest.mark.parametrize("teeth", [(20, 20), (20, 60), (80, 16)])
@pytest.mark.parametrize("length", [0.6, 1.1])
def test_a_belt_goes_around_its_pulleys(teeth, length):
    """The hull of two circles at its centre distance is as long as it is."""
    belt = Belt(**AT5 | {"teeth_in": teeth[0], "teeth_out": teeth[1], "length": length})
    around = np.linspace(0, 2 * np.pi, 20_001)[:, None]
    circle = np.hstack([np.cos(around), np.sin(around)])
    first, second = belt.radii
    points = np.vstack([first * circle, second * circle + [belt.distance, 0.0]])
    assert ConvexHull(points).area == pytest.approx(length, rel=1e-6)  # in a plane: its perimeter
    assert belt.gear.ratio == teeth[1] / teeth[0]


def test_torque_and_stiffness_of_the_makers_example():
    """Ten teeth of 1.6 cm bear 466 N or 7.4 N m; two strands of 0.5 m are 283 N m/rad."""
    gear = Belt(**AT5 | {"service_factor": 1.0}).gear
    assert gear.effort_curve[1] == (62.8, pytest.approx(7.4, rel=5e-3))
    assert gear.stiffness == pytest.approx(283, rel=3e-3)
    half = Belt(**AT5 | {"most_teeth": 6.0}).gear  # welded, and with 1.5 on its peak
    assert half.effort_curve[1][1] == pytest.approx(7.41 * 0.6 / 1.5, rel=1e-2)
    assert half.rated_torque == half.effort_curve[0][1]
    cords = Belt(**AT5 | {"tooth_load": None}).gear
    assert (cords.rated_torque, cords.effort_curve) == (pytest.approx(1120 * 0.0159155 / 1.5), None)
    disc = np.pi * 0.0159155**2 * 0.016 * 2700
    assert gear.mass == pytest.approx(2 * disc + 0.05 * 1.1)
    assert gear.input_inertia == pytest.approx((disc + 0.055) * 0.0159155**2, rel=1e-5)


def test_a_belt_shorter_than_its_pulleys_is_refused(tmp_path):
    path = write_catalog(tmp_path / "c.yaml", belts={"B": AT5 | {"length": 0.16}})
    with pytest.raises(CatalogError, match=r"belts.B.: length 0.16 m is shorter than its pulleys"):
        load_catalog(path)


def test_a_joint_behind_a_belt_needs_a_bearing_of_its_own(tmp_path):
    """With it the drive is signed; without, provisional, and the bearing's loads are printed."""
    wide = {"width": 0.1, "allowable_tension": 7e3, "specific_stiffness": 17.5e5, "length": 1.6}
    belt = AT5 | wide | {"teeth_in": 12.0, "teeth_out": 240.0, "mass_per_length": 0.34}
    ratings = {"kind": "crossed roller", "max_moment": 1e5, "max_radial": 1e6, "max_axial": 1e6}
    own = {key: GEAR[key] for key in ("source", "grade")} | {"mu": 0.001, "ratings": ratings}
    motors = {"M": MOTOR | {"continuous_torque": 5.0, "peak_torque": 20.0, "thermal": None}}
    parts = {"gears": {}, "belts": {"B": belt}, "bearings": {"R": own}}
    path = write_catalog(tmp_path / "c.yaml", motors, **parts)
    given = {"inertia_ratio": 1e4, "resonance_base": 1.0}
    report = sized_cycle(path, conditions=given, on_miss="ignore")
    (bare,) = report.joints
    assert bare.nearest.lacks == ("output bearing",)
    assert bare.no_fit.endswith(
        "provisional: give the joint a bearing of its own: conditions.bearings"
    )
    table = provisional_table(sizing_summary(report))  # its maker has nothing to say
    assert table.title == "not signed"
    assert "N of a bearing of the joint's own (conditions.bearings)" in bare.nearest.would[-1]
    (joint,) = sized_cycle(path, conditions=given | {"bearings": {"table": "R"}}).joints
    assert joint.choice.candidate.name == "M + B"
    assert "efficiency: by rule: 0.9" in joint.choice.candidate.stand_ins
