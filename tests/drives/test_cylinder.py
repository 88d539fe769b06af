"""Cylinders: pressures, buckling and choice against plain arithmetic; masses; entries refused."""

import csv
from math import pi
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import example
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status
from pinfric.drives.kinds.cylinder import Cylinder
from pinfric.errors import CatalogError, RetimeError
from pinfric.retiming.limits import read_limits
from pinfric.show.inverse_summary import inverse_summary
from pinfric.show.pages.sizing import sizing_page
from pinfric.show.report.drives import amplifier_lines
from pinfric.show.report.inverse import inverse_report
from pinfric.sizing.summary import sizing_summary

FOLDER = Path(pf.__file__).parent / "catalog"
STEEL, EULER = 2.1e11, 3.5
CYLINDER = yaml.safe_load("""
source: invented
grade: R
medium: pneumatic
bore: 0.04
rod: 0.016
strokes: [0.05, 0.1]
rated_pressure: 1.0e+6
max_speed: 0.5
load_share: 0.7
mass: 0.5
mass_per_stroke: 2.0
""")
#: A gantry whose z axis a pneumatic cylinder lifts; nothing holds it without power.
LIFT = {"cylinders": "z", "medium": "pneumatic", "holding_brake": "any"}


def lifted(tmp_path, cylinder=None, **conditions):
    """The lift's joint, sized with one cylinder, and its criteria by name."""
    entry = {k: v for k, v in {**CYLINDER, **(cylinder or {})}.items() if v is not None}
    catalog = {"pinfric_catalog": 1, "cylinders": {"C": entry}}
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(catalog))
    scene, motion = example("gantry")
    asked = LIFT | conditions
    report = pf.size(scene, motion, tmp_path / "c.yaml", conditions=asked, on_miss="ignore")
    joint = report.joints[2]
    rows = {} if joint.installed is None else {c.name: c for c in joint.installed.criteria}
    return report, joint, rows


@pytest.fixture(scope="module")
def excavator():
    scene, motion = example("excavator", "excavator.waypoints.yaml")
    soil = scene.payloads["soil"].model_copy(update={"inertia": (40.0, 0.0, 0.0, 40.0, 0.0, 40.0)})
    return pf.size(scene.with_(payloads={"soil": soil}), motion, "default"), motion


def distances(scene, motion):
    """(T, 3) of the pins, by Pinocchio's frames alone."""
    data = scene.model.createData()
    found = np.empty((len(motion.t), 3))
    for i, q in enumerate(motion.q):
        pin.framesForwardKinematics(scene.model, data, q)
        for k, actuator in enumerate(scene.actuators):
            a, b = (
                data.oMf[scene.model.getFrameId(end.link)].act(np.array(end.xyz))
                for end in (actuator.cylinder.a, actuator.cylinder.b)
            )
            found[i, k] = np.linalg.norm(b - a)
    return found


def test_an_excavator_gets_cylinders_whose_pressures_are_force_over_area(excavator):
    report, motion = excavator
    assert report.verdict.failing == ()
    assert report.settled
    result, length = pf.inverse_dynamics(report.scene, motion), distances(report.scene, motion)
    still = pf.inverse_dynamics(
        report.scene, result.states.q, 0 * result.states.v, 0 * result.states.a,
        attached=result.states.attached,
    ).effort_frictionless  # fmt: skip
    for k, joint in enumerate(report.joints):
        rows = {c.name: c for c in joint.choice.criteria}
        own = joint.choice.candidate.ratings.special
        piston, rod = pi * own.bore**2 / 4, pi * own.rod**2 / 4
        push, pull = max(result.effort_upper[:, k]), max(-result.effort_lower[:, k])
        bars = {
            "cylinder push pressure": push / (0.9 * piston) / 1e5,
            "cylinder pull pressure": max(pull, 0.0) / (0.9 * (piston - rod)) / 1e5,
            "cylinder holding pressure": max(
                *still[:, k] / piston / 1e5, *-still[:, k] / (piston - rod) / 1e5
            ),
        }
        for name, pressure in bars.items():
            assert rows[name].required == pytest.approx(pressure, rel=1e-6, abs=1e-9)
            assert rows[name].available == 160.0
        second_moment = pi * own.rod**4 / 64
        buckles = pi**2 * STEEL * second_moment / length[:, k].max() ** 2
        assert rows["rod buckling"].required == pytest.approx(EULER * push, rel=1e-6)
        assert rows["rod buckling"].available == pytest.approx(buckles)
        rate = np.gradient(length[:, k], motion.t)
        flow = max((rate * piston).max(), (-rate * (piston - rod)).max()) * 6e4
        assert rows["cylinder flow"].required == pytest.approx(flow, rel=5e-3)
        assert rows["cylinder stroke"].required == pytest.approx(np.ptp(length[:, k]))
        assert rows["cylinder closed length"].available == pytest.approx(length[:, k].min())


def test_no_lighter_cylinder_of_the_catalogue_would_do(excavator):
    """A plain search of the table, with the loads of the machine that was chosen."""
    report, motion = excavator
    result, length = pf.inverse_dynamics(report.scene, motion), distances(report.scene, motion)
    with (FOLDER / "cylinders.csv").open() as table:
        sizes = [(r["name"], *(float(r[c]) / 1e3 for c in ("bore mm", "rod mm")))
                 for r in csv.DictReader(table)]  # fmt: skip
    strokes = yaml.safe_load((FOLDER / "cylinders.columns.yaml").read_text())["every"]["strokes"]
    for k, joint in enumerate(report.joints):
        push, pull = max(result.effort_upper[:, k]), max(*-result.effort_lower[:, k], 0.0)
        fitting = []
        for name, bore, rod in sizes:
            piston, ring = pi * bore**2 / 4, pi * (bore**2 - rod**2) / 4
            buckles = pi**3 * STEEL * rod**4 / 64 / max(length[:, k]) ** 2
            strong = push <= 0.9 * 1.6e7 * piston and pull <= 0.9 * 1.6e7 * ring
            for stroke in strokes:
                fits = np.ptp(length[:, k]) <= stroke <= min(length[:, k]) - 3 * bore - 0.15
                block = (1.6 * bore) ** 2 * (2 * bore + 0.1) + 1.25**2 * piston * stroke
                if strong and fits and EULER * push <= buckles:
                    fitting.append((7850 * block, f"{name}, stroke {stroke:g} m"))
        mass, name = min(fitting)
        lightest = [n for m, n in fitting if m < mass * (1 + 1e-9)]  # rods of one bore weigh alike
        assert joint.choice.name in lightest
        assert joint.choice.mass == pytest.approx(mass)


def test_half_of_a_cylinder_is_at_each_of_its_pins(excavator):
    """The house is the ground: of the boom's cylinder it bears half."""
    report, _ = excavator
    boom, stick, bucket = (joint.choice.mass for joint in report.joints)
    ends = {
        "boom_pin": [(boom / 2, [1.6, 0, 0.1]), (stick / 2, [1.6, 0, 0.5])],
        "stick_pin": [(stick / 2, [-0.4, 0, 0.25]), (bucket / 2, [0.3, 0, 0.4])],
        "bucket_pin": [(bucket / 2, [0.05, 0, 0.35])],
    }
    for name, own in ends.items():
        mass = sum(m for m, _ in own)
        joint = report.scene.model.getJointId(name)
        before, after = (x.model.inertias[joint] for x in (report.given, report.scene))
        assert after.mass == pytest.approx(before.mass + mass)
        moment = before.mass * before.lever + sum(m * np.array(at) for m, at in own)
        assert_allclose(after.mass * after.lever, moment, rtol=1e-12)
    assert any("half of boom_cylinder, stick_cylinder" in note for note in report.notes)
    assert (report.bus.known, report.bus.left_out) == (0, ())
    standing = [s.torque for s in report.standstills]
    assert all(c.status == Status.NOT_REQUIRED and "locks the oil in" in c.note for c in standing)


def test_cylinders_have_no_shaft(excavator):
    report, motion = excavator
    assert all(drive.transmission is not None for drive in report.scene.drives)
    result = pf.inverse_dynamics(report.scene, motion)
    summary = inverse_summary(result, motion.source)
    assert [joint.motor_unit for joint in summary.joints] == ["N"] * 3
    titles = [getattr(part, "title", "") for part in inverse_report(result, summary)]
    assert any("excavator" in title for title in titles)
    assert not any("shafts" in title for title in titles)


def test_a_machine_of_cylinders_has_no_bus(excavator):
    """No criterion of a supply, no volts, no power of it, no amplifiers on the page."""
    report, _ = excavator
    assert report.bus.criteria == ()
    page = sizing_page(report)
    assert "All drives together" in page
    for said in ("Power from the bus", "peak power of all drives", "48.0 V", "Currents are"):
        assert said not in page, said
    assert not amplifier_lines(sizing_summary(report))


def test_a_cylinder_on_a_sliding_joint_is_judged_by_hand(tmp_path):
    """Head and tool, 3 kg, 7 N of friction at rest; its rod goes out upwards."""
    _, joint, rows = lifted(tmp_path)
    piston = pi * 0.04**2 / 4
    assert joint.choice.name == "C, stroke 0.1 m"  # the motion takes 0.06 m
    assert joint.choice.mass == pytest.approx(0.5 + 2.0 * 0.1)
    push = 3.0 * 9.81 + 7.0
    row = rows["cylinder push pressure"]
    assert row.required == pytest.approx(push / (0.7 * piston) / 1e5, rel=1e-6)
    assert (row.available, row.unit) == (6.0, "bar")
    assert rows["cylinder pull pressure"].required == 0.0
    assert rows["cylinder holding pressure"].required == pytest.approx(
        3.0 * 9.81 / piston / 1e5, rel=1e-6
    )
    pinned = 0.1 + 3 * 0.04 + 0.15 + 0.1  # rod out, by rule
    buckles = pi**3 * STEEL * 0.016**4 / 64 / pinned**2
    assert rows["rod buckling"].available == pytest.approx(buckles)
    assert rows["cylinder stroke"].required == pytest.approx(0.06)
    assert (
        "0.12 m between the joint's limits: its stroke ends before" in rows["cylinder stroke"].note
    )
    others = {"cylinder closed length", "cylinder flow", "continuous torque", "inertia ratio"}
    assert not others & rows.keys()


def test_air_holds_nothing_without_power(tmp_path):
    """Oil in locked chambers does; locked air yields, and there is no brake for the lift."""
    report, joint, _ = lifted(tmp_path, holding_brake="where_needed")
    assert not joint.choice or not report.verdict.signed
    held = report.standstills[2].torque
    assert held.status not in (Status.PASSES, Status.NOT_REQUIRED)
    assert "locked air yields" in held.note
    _, _, oil = lifted(tmp_path, {"medium": "hydraulic"}, medium="hydraulic", holding_brake="any")
    assert oil["cylinder holding pressure"].status == Status.PASSES
    oily, *_ = lifted(
        tmp_path, {"medium": "hydraulic"}, medium="hydraulic", holding_brake="where_needed"
    )
    assert oily.standstills[2].torque.status == Status.NOT_REQUIRED


def test_conditions_set_pressure_mounting_and_reserve(tmp_path):
    asked = {"pneumatic_pressure": 4e5, "buckling_length": 2.0, "buckling_factor": 5.0}
    _, _, rows = lifted(tmp_path, **asked)
    _, _, usual = lifted(tmp_path)
    assert rows["cylinder push pressure"].available == 4.0
    ends = rows["rod buckling"], usual["rod buckling"]
    assert ends[0].available == pytest.approx(ends[1].available / 4)
    assert ends[0].required == pytest.approx(ends[1].required * 5.0 / 3.5)
    _, _, above = lifted(tmp_path, pneumatic_pressure=1.2e6)
    assert above["cylinder push pressure"].available == 10.0
    assert "a valve brings 12 bar down to its 10 bar" in above["cylinder push pressure"].note


@pytest.mark.parametrize(
    ("cylinder", "conditions", "said"),
    [
        ({"rod": None}, {}, "C, stroke 0.1 m cannot be signed: ask its maker for rod diameter"),
        (
            {"rod": 0.0},
            {},
            "rod buckling: pushes 36.43 N, pulls 0 N, and it has no rod side",
        ),
        ({"strokes": [0.05]}, {}, "cylinder stroke: needs 0.06 m, has 0.05 m (short by 20 %)"),
        ({}, {"pneumatic_pressure": 3e4}, "cylinder push pressure: needs 0.4141 bar, has 0.3 bar"),
        ({"rated_pressure": None}, {}, "cannot be signed: ask its maker for rated pressure"),
    ],
)
def test_a_cylinder_that_cannot_be_signed_says_by_which_figure(
    tmp_path, cylinder, conditions, said
):
    report, joint, _ = lifted(tmp_path, cylinder, **conditions)
    assert joint.choice is None
    (line,) = (text for text in report.verdict.failing if text.startswith("z:"))
    assert said in line


def test_a_cylinder_whose_speed_is_not_printed_is_provisional(tmp_path):
    report, joint, _ = lifted(tmp_path, {"max_speed": None})
    assert joint.choice is None
    assert joint.nearest.name == "C, stroke 0.1 m"
    assert joint.nearest.lacks == ("largest speed",)
    assert joint.nearest.would == ("largest speed >= 0.075 m/s",)
    assert report.verdict.joints[2].state == "provisional"


def test_without_a_rod_side_nothing_pulls():
    bare = Cylinder(**CYLINDER | {"rod": 0.0})
    assert bare.areas == (pytest.approx(pi * 0.04**2 / 4), 0.0)
    assert np.isnan(Cylinder(**CYLINDER | {"rod": None}).areas[1])


def test_a_mass_by_rule_is_no_less_than_a_printed_one():
    """SMC CP96, bore and stroke of 100 mm: 4.76 kg (CAT.ES20-204B)."""
    figures = {"bore": 0.1, "rod": 0.025, "strokes": (0.1,), "mass": None, "mass_per_stroke": None}
    light, heavy = (
        Cylinder(**CYLINDER | figures | {"medium": medium}).mass_taken
        for medium in ("pneumatic", "hydraulic")
    )
    assert 4.76 < light == pytest.approx(2700 * (0.16**2 * 0.3 + pi / 4 * 0.125**2 * 0.1))
    assert heavy == pytest.approx(light * 7850 / 2700)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rod": 0.04}, "rod 0.04 m is not thinner than bore 0.04 m"),
        ({"rated_pressure": 10.0}, "rated_pressure 10 Pa is below that of the air: in bar?"),
        ({"mass": None}, "mass, mass_per_stroke: give both, or none of them"),
        ({"strokes": []}, "strokes"),
        ({"bor": 0.04}, "unknown key `cylinders.C.bor`"),
    ],
)
def test_impossible_figures_are_refused_in_a_line(tmp_path, change, said):
    with pytest.raises(CatalogError, match=r"c\.yaml.*C") as refused:
        lifted(tmp_path, change)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_conditions_of_cylinders_are_checked(tmp_path):
    scene, motion = example("pendulum")
    with pytest.raises(CatalogError, match=r"conditions\.cylinders: 'joint_1' turns"):
        pf.size(scene, motion, "default", conditions={"cylinders": "joint_1"})
    with pytest.raises(CatalogError, match=r"conditions\.cylinders: there is no drive 'w'"):
        lifted(tmp_path, cylinders="w")
    with pytest.raises(CatalogError, match="hydraulic_pressure"):
        lifted(tmp_path, hydraulic_pressure=160)


def test_sliding_joints_get_no_cylinder_unasked():
    gantry = pf.size(*example("gantry"), "default", on_miss="ignore")
    assert all("Pneumax" not in j.choice.name for j in gantry.joints if j.choice)
    assert not any("CMB" in a.name for j in gantry.joints for a in j.assessments)


def test_a_named_cylinder_is_taken_and_not_retimed(tmp_path):
    name = "C, stroke 0.1 m"
    report, joint, _ = lifted(tmp_path, {"strokes": [0.08, 0.1]}, take={"z": name})
    assert joint.choice.name == name
    motors = {
        "pinfric_motors": 1,
        "catalog": str(tmp_path / "c.yaml"),
        "drives": {joint: {"drive": name} for joint in "xyz"},
    }
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(motors))
    with pytest.raises(RetimeError, match="a cylinder, whose pressures `retime` does not bound"):
        read_limits(report.given, tmp_path / "m.yaml")


def test_the_bundled_cylinders_have_the_ratios_of_areas_that_the_maker_prints():
    """CMB: 1.25 with the thin rod, 2 with the thick one; Pneumax: ring areas in dm^2."""
    own = load_catalog("default").kinds.values()
    oil = [c for c in own if c.medium == "hydraulic"]
    ratios = {(c.bore, c.rod): c.areas[0] / c.areas[1] for c in oil}
    assert len(ratios) == 20
    assert all(min(abs(r / 1.25 - 1), abs(r / 2.0 - 1)) < 0.055 for r in ratios.values())
    rings = {c.bore: 100 * c.areas[1] for c in own if c.medium == "pneumatic"}
    printed = {0.032: 0.06908, 0.04: 0.10550, 0.05: 0.16485, 0.063: 0.28017, 0.08: 0.45334,
               0.1: 0.73594, 0.125: 1.14618, 0.16: 1.88400, 0.2: 3.01440}  # fmt: skip
    assert rings == pytest.approx(printed, rel=1e-3)


def test_the_summary_of_an_excavator_names_pressures(excavator):
    summary = sizing_summary(excavator[0])
    said = {c.name for joint in summary.joints for c in joint.installed.criteria}
    assert {"cylinder push pressure", "cylinder pull pressure", "rod buckling"} <= said
