"""Provisional drives: bounds of a missing figure, against the choice with that figure given."""

import re
from math import pi

import numpy as np
import pytest
from builders import example
from sizing_cases import (
    ACCELERATION,
    COULOMB,
    GEAR,
    INERTIA,
    MOTOR,
    RATE,
    one_drive,
    sized_cycle,
    write_catalog,
)

import pinfric as pf
from pinfric.drives.criterion import Status
from pinfric.drives.drivetrain import motor_with_gear
from pinfric.drives.limits import LIMITS
from pinfric.show.pages.sizing import sizing_page
from pinfric.show.report.drives import lighter_table, provisional_table
from pinfric.show.report.sizing import sizing_report, verdict
from pinfric.sizing.drive_search import DriveSearch, Parts
from pinfric.sizing.provisional import provisional
from pinfric.sizing.summary import sizing_summary

UP = INERTIA * ACCELERATION + COULOMB


def sized(tmp_path, gear=None, motor=None, **more):
    return sized_cycle(one_drive(tmp_path, motor, gear, **more), on_miss="ignore")


def would(report):
    """Figure -> the numbers in its bound, of the only joint's drive."""
    (joint,) = report.joints
    assert joint.choice is None
    assert joint.nearest is not None
    numbers = {}
    for text in joint.nearest.would:
        for part in re.sub(r", the worst.*|\(.*", "", text).split(", "):
            words, found = re.match(r"([a-z ]+?) (?:[<>]= )?([\d.].*)", part).groups()
            numbers[words] = [float(x) for x in re.findall(r"\d[\d.]*(?:e[+-]?\d+)?", found)]
    return numbers


#: Figure -> what it must be at least, by hand: K = (2 pi f)^2 J, the speeds of the cycle.
LEAST = {
    "stiffness": (2 * pi * 8.0) ** 2 * INERTIA,
    "max_input_speed": GEAR["ratio"] * RATE,
}


@pytest.mark.parametrize("figure", LEAST)
def test_a_missing_limit_is_the_need_of_its_row(tmp_path, figure):
    others = {} if figure == "stiffness" else {"average_input_speed": None, "rated_speed": None}
    report = sized(tmp_path, {figure: None, **others})
    (value,) = would(report)["maximum input speed" if "speed" in figure else figure]
    assert value == pytest.approx(LEAST[figure], rel=5e-3)
    for factor, fits in ((1.01, True), (0.98, False)):  # the same joint with that figure
        known = sized(tmp_path, {figure: factor * LEAST[figure], **others})
        assert (known.joints[0].choice is not None) == fits


def test_a_missing_inertia_is_between_what_the_ratio_and_the_motor_permit(tmp_path):
    """J_load <= 10 r^2 (J_m + J): 1.5e-5 at least; at most what the peak torque accelerates."""
    weak = {"continuous_torque": 0.45, "peak_torque": 0.5, "rotor_inertia": 5e-6, "thermal": None}
    report = sized(tmp_path, {"input_inertia": None}, weak)
    least, most, _ = would(report)["input inertia"]
    assert least == pytest.approx(INERTIA / (10 * 1e4) - 5e-6, rel=0.05)
    drag = UP / GEAR["efficiency"] / GEAR["ratio"]
    shaft = (0.5 / 1.2 - drag) / (GEAR["ratio"] * ACCELERATION)
    assert most == pytest.approx(shaft - 5e-6, rel=0.05)
    for inertia, fits in (
        (least, True),
        (most, True),
        (0.9 * least, False),
        (1.06 * most, False),
    ):
        known = sized(tmp_path, {"input_inertia": inertia}, weak)
        assert (known.joints[0].choice is not None) == fits


def test_bounds_of_a_missing_inertia_rule_out_nothing_that_fits(tmp_path):
    """The rows of heat and voltage, judged exactly with any inertia, have no greater margin."""
    motors = {f"M{x}": MOTOR | {"continuous_torque": x} for x in (0.2, 0.3, 0.45, 0.7)}
    motors["other"] = MOTOR | {"nominal_voltage": 400.0, "resistance": None, "thermal": None}
    motors = {name: {k: v for k, v in m.items() if v is not None} for name, m in motors.items()}
    gear = {k: v for k, v in GEAR.items() if k != "input_inertia"}
    path = write_catalog(tmp_path / "c.yaml", motors=motors, gears={"G": gear})
    (joint,) = sized_cycle(path, on_miss="ignore").joints
    search, group = joint.search, joint.search.arrays.groups[0]
    (bounds,) = search.any_inertia(0, np.array([0]))
    rows = {limit.name for limit in LIMITS if limit.stage == "pair"} - {"inertia ratio"}
    for inertia in (0.0, 1e-5, 1e-4):
        for m, bound in enumerate(bounds):
            entry = group.entries[0].model_copy(update={"input_inertia": inertia})
            drive = motor_with_gear(group.motor_names[m], group.motors[m], "G", entry, 100.0, 25.0)
            judged = search.assess(drive)
            exact = min(
                c.margin for c in judged.criteria if c.name in rows and c.margin is not None
            )
            assert bound >= exact - 1e-9
            for allowed in ((), ("continuous torque", "short-term torque")):
                failed = any(c.name not in allowed for c in judged.failed)
                assert judged.falls_short(allowed) == failed
    assert (bounds < 0).any()
    assert (bounds > 0).any()


def test_a_missing_efficiency_is_the_worst_of_its_kind(tmp_path):
    """Beside a gear of 0.7 that is too weak; the drive is judged by it."""
    unknown = {k: v for k, v in GEAR.items() if k not in ("efficiency", "back_efficiency")}
    small = {**GEAR, "efficiency": 0.7, "repeated_peak_torque": 12.0, "average_torque": 8.0}
    gears = {"G": unknown, "small": {**small, "rated_torque": 8.0}}
    report = sized_cycle(write_catalog(tmp_path / "c.yaml", gears=gears), on_miss="ignore")
    assert would(report) == {"efficiency": [0.7]}
    (peak,) = (c for c in report.joints[0].nearest.criteria if c.name == "peak torque")
    rotor = GEAR["ratio"] * (MOTOR["rotor_inertia"] + GEAR["input_inertia"]) * ACCELERATION
    assert peak.required == pytest.approx(1.2 * (UP / 0.7 / GEAR["ratio"] + rotor), rel=1e-6)


def test_the_lightest_of_several_is_provisional(tmp_path):
    unknown = {key: value for key, value in GEAR.items() if key != "stiffness"}
    motors = {f"{mass} kg": {**MOTOR, "mass": mass} for mass in (1.5, 1.0, 2.0)}
    catalog = write_catalog(tmp_path / "c.yaml", motors=motors, gears={"G": unknown})
    (joint,) = sized_cycle(catalog, on_miss="ignore").joints
    assert joint.nearest.name == "1.0 kg + G"


@pytest.mark.parametrize(
    ("gear", "motor"),
    [
        ({"rated_torque": None, "average_torque": None}, {}),  # a rating of torque
        ({}, {"continuous_torque": None}),
        (
            {
                "stiffness": None,
                "max_input_speed": 120.0,
                "average_input_speed": 100.0,
                "rated_speed": 90.0,
            },
            {},
        ),  # a known row fails
        ({k: None for k in ("stiffness", "bearing", "input_inertia", "efficiency")}, {}),  # four
        (
            {
                **dict.fromkeys(("stiffness", "bearing", "input_inertia")),
                **dict.fromkeys(("max_input_speed", "average_input_speed", "rated_speed")),
            },
            {},
        ),  # four, for each of which something stands in
    ],
)
def test_what_is_not_eligible_is_not_shown(tmp_path, gear, motor):
    (joint,) = sized(tmp_path, gear, motor).joints
    assert joint.installed is None or not joint.installed.would


def test_what_fails_beside_a_provisional_drive_is_said_too(tmp_path):
    """A brake is required, and the catalogue has none."""
    path = one_drive(tmp_path, None, {"stiffness": None})
    report = sized_cycle(path, conditions={"holding_brake": "all"}, on_miss="ignore")
    (joint,) = report.verdict.joints
    assert joint.state == "provisional"
    provisional_, brake = joint.failing
    assert "ask its maker for stiffness" in provisional_
    assert "holding brake" in brake


def test_a_provisional_drive_never_competes_and_is_shown_apart(tmp_path):
    light = {**{k: v for k, v in GEAR.items() if k != "stiffness"}, "mass": 0.1}
    path = write_catalog(tmp_path / "c.yaml", gears={"G": GEAR, "light": light})
    signed = sized_cycle(path)
    assert signed.joints[0].choice.candidate.gear_name == "G"
    assert provisional_table(sizing_summary(signed)) is None
    report = sized(tmp_path, {"stiffness": None})
    assert report.verdict.headline.startswith(
        "0 of 1 joints can be signed, 1 provisional; 1.50 kg provisional"
    )
    table = provisional_table(sizing_summary(report))
    assert table.title.startswith("not signed: ask for stiffness")
    page = sizing_page(report)
    lacking = [c for c in report.joints[0].nearest.criteria if c.status == Status.NOT_CHECKED]
    assert f"{len(lacking)} criteria not checked" in verdict(report)
    assert f"<b>{len(lacking)}</b><span>criteria not checked" in page
    assert "<h3>Not signed: ask for stiffness" in page.partition("<h2>What cannot be signed")[2]
    assert "Signature" not in page
    (line,) = report.verdict.failing
    assert "M + G is provisional: ask its maker for stiffness" in line


def test_a_motor_with_a_housing_of_unknown_mass_is_signed_as_a_heavy_one(tmp_path):
    (joint,) = sized(tmp_path, {}, {"mass": None}).joints
    mass = 1.94 * MOTOR["continuous_torque"] ** 0.75
    assert joint.choice.candidate.mass == pytest.approx(mass + GEAR["mass"])
    assert "mass: 1.94 T^0.75 = 1.2 kg, by rule" in joint.choice.candidate.stand_ins
    kit = sized(tmp_path, {"kind": "strain wave"}, {"mass": None, "mounting": "frameless"})
    assert kit.joints[0].choice is None


@pytest.mark.slow
def test_the_servos_of_the_so101_hold_it_with_pauses():
    """A fifth of 1.91 N m at 40 C; the motors hold the arm and run hot where gravity acts."""
    scene, motion = example("so101")
    servo = pf.load_catalog("default").gearmotors["Feetech STS3215 7.4 V"]
    catalog = pf.drives.catalog.Catalog("servos", gearmotors={"STS3215": servo})
    report = pf.size(scene, motion, catalog, conditions={"bus_voltage": 7.4}, on_miss="ignore")
    whole = pf.size(scene, motion, "default", conditions={"bus_voltage": 12.0}, on_miss="ignore")
    taken = [joint.nearest for joint in whole.joints]
    assert {a.candidate.name for a in taken} == {"Feetech STS3215 12 V"}  # what is built
    assert whole.drive_mass == pytest.approx(6 * 0.055)
    assert not any(a.candidate.brake for a in taken)  # they have no shaft for one
    light = "cannot hold 2.77 kg of drives that can be signed: lighter ones, of at most 0.089 kg"
    assert light in whole.verdict.headline
    assert "none of " in whole.joints[0].no_fit
    assert "that its link can hold can be signed" in whole.joints[0].no_fit
    assert {joint.state for joint in report.verdict.joints} == {"provisional"}
    assert report.contradiction == ""  # six servos of 55 g are in 0.49 kg
    rms = np.array([joint.motor.figures.rms for joint in report.joints])
    has = 0.2 * 1.91 * np.sqrt((105 - 40) / (105 - 25))
    hot = ["runs hot" in " ".join(joint.nearest.would) for joint in report.joints]
    assert hot == list(rms > has)
    assert 1 <= sum(hot) < 6


def test_lighter_drives_are_sought_up_to_the_first_joint_without_one(monkeypatch):
    """For the other joints of an SO-101, and for the nearest, nothing is judged."""
    sought = {}

    def counted(search):
        found = provisional(search)
        sought.setdefault(search.parts.most, []).append(found is not None)
        return found

    monkeypatch.setattr("pinfric.sizing.memory.provisional", counted)
    scene, motion = example("so101")
    report = pf.size(scene, motion, "default", on_miss="ignore")
    assert "cannot hold" in report.contradiction
    light = [found for most, found in sought.items() if np.isfinite(most)]
    assert light
    for found in light:
        assert found.count(False) == 1
        assert not found[-1]


def test_a_banned_drive_is_not_provisional(tmp_path):
    """Of two equal drives the other is."""
    gears = {n: GEAR | {"stiffness": None, "mass": m} for n, m in (("G", 0.5), ("H", 0.6))}
    path = write_catalog(tmp_path / "c.yaml", gears=gears)
    (joint,) = sized_cycle(path, on_miss="ignore").joints
    search = joint.search
    assert provisional(search).candidate.gear_name == "G"
    banned = Parts(banned=frozenset([provisional(search).candidate.name]))
    other = DriveSearch(search.arrays, search.case, banned)
    assert provisional(other).candidate.gear_name == "H"


@pytest.mark.parametrize(("heavy", "shown"), [(1.5, True), (0.3, False)])
def test_drives_that_outweigh_what_they_move_have_a_light_provisional_one_beside(
    tmp_path, heavy, shown
):
    """A turntable of 1 kg; the light gear lacks its stiffness."""
    light = {k: v for k, v in GEAR.items() if k != "stiffness"} | {"mass": 0.1}
    motors = {"M": {**MOTOR, "mass": 0.2}}
    file = write_catalog(tmp_path / "c.yaml", motors, {"G": {**GEAR, "mass": heavy}, "L": light})
    report = sized_cycle(str(file), on_miss="ignore")
    summary = sizing_summary(report)
    assert report.verdict.headline.startswith("1 of 1 joints can be signed")
    rows = [(row.name, row.drive, row.mass, row.ask) for row in summary.lighter]
    assert rows == [("table", "M + L", pytest.approx(0.3), ("stiffness",))] * shown
    table = lighter_table(summary)
    assert (table is not None) == shown
    if shown:
        (needed,) = re.findall(r"stiffness >= ([\d.e+]+)", summary.lighter[0].would)
        assert float(needed) == pytest.approx(LEAST["stiffness"], rel=5e-3)
        assert table.title == "lighter, 0.300 kg in all, but not signed: ask for stiffness"
        shown_too = sizing_report(report, verbose=False)
        assert table.title in [part.title for part in shown_too if hasattr(part, "title")]
        assert "Lighter, 0.300 kg in all, but not signed" in sizing_page(report)
