"""Do the links hold the drives: their weight beside that of the drives, by hand."""

import pytest
from builders import lump, row, still
from sizing_cases import GEAR, MOTOR, one_drive, write_catalog

import pinfric as pf
from pinfric.drives.held import Held, doubted_masses, held_drives
from pinfric.errors import SizingError

DRIVE = MOTOR["mass"] + GEAR["mass"]
STRONG = 1.2 + GEAR["mass"]
LENGTH = 0.2


def arm(mass, masses):
    """Links of equal mass held out level in a chain; the first drive is on the ground."""
    names = [f"joint_{k + 1}" for k in range(3)]
    model = row(names, lump(mass, [LENGTH / 2, 0, 0]), LENGTH)
    return pf.Scene(model, masses=masses, stick_velocity=0.0)


def sized(tmp_path, mass, masses, **conditions):
    """The drive of `sizing_cases`, up to 40 N m, and one with a heavier and stronger motor."""
    ratings = "continuous_torque", "continuous_stall_torque", "peak_torque"
    strong = dict.fromkeys(ratings, 4.0)
    motor = {key: x for key, x in MOTOR.items() if key != "thermal"}
    motor["continuous_stall_torque"] = MOTOR["continuous_torque"]
    motors = {"M": motor, "S": {**motor, **strong, "mass": 1.2}}
    path = write_catalog(tmp_path / "c.yaml", motors)
    scene = arm(mass, masses)
    given = {"inertia_ratio": 1e4, "thermal_time": 1.0, "holding_brake": "any", **conditions}
    return pf.size(scene, still(scene), path, conditions=given, on_miss="ignore")


def test_drives_are_held_by_the_link_before_their_joint():
    scene = arm(2.0, "with_drives")
    held = held_drives(scene, {0: 1.0, 1: 0.5, 2: 0.25}, {})
    assert held == [
        Held("", 0.75, 6.0),
        Held("joint_1", 0.75, 6.0),
        Held("joint_2", 0.25, 4.0),
        Held("joint_3", 0.0, 2.0),
    ]
    assert [h.drives for h in held_drives(scene, {1: 0.5, 2: None}, {"joint_2": 0.4})] == [0.0] * 4
    part = scene.with_(masses={"joint_3": "with_drives", "others": "without_drives"})
    assert held_drives(part, {0: 1.0, 1: 0.5, 2: 0.25}, {})[0].drives == 0.25


@pytest.mark.parametrize(
    ("all_of", "branch", "says"),
    [(0.64, 0.74, ""), (0.66, 0.74, "66% of the mass of all moving links"), (0.5, 0.8, "80% of")],
)
def test_much_of_the_links_is_questioned(all_of, branch, says):
    """The xArm7 with 0.60 and UR3 with 0.65 beyond a joint stay silent."""
    found = doubted_masses([Held("", all_of, 1.0), Held("j", branch, 1.0)])
    assert says in found
    assert bool(found) == bool(says)


@pytest.mark.parametrize(
    ("mass", "masses", "added", "failing"),
    [
        (2.0, "with_drives", 0.0, ""),
        (2.0, "without_drives", DRIVE, ""),
        (2.0, None, DRIVE, ""),
        (0.4, "with_drives", DRIVE, "all moving links weigh 1.2 kg and cannot hold 3 kg of drives"),
        (0.4, "without_drives", DRIVE, ""),
        (0.4, None, DRIVE, "not written: moving links of 1.2 kg cannot hold 3 kg of drives"),
        (0.04, None, DRIVE, "0.12 kg move on 0.4 m of joints: 1.9 kg/m^3"),
        (0.04, "without_drives", DRIVE, "moving links of 0.12 kg would carry 3 kg of drives"),
        (0.004, "without_drives", DRIVE, "0.19 kg/m^3 of that length cubed; the lightest arms"),
    ],
)
def test_links_that_are_too_light_are_refused_and_the_safe_side_is_shown(
    tmp_path, mass, masses, added, failing
):
    """The drive at the base bears links and the two drives beyond it, of the same kind."""
    verdict = (report := sized(tmp_path, mass, masses)).verdict
    own = 9.81 * mass * LENGTH * (0.5 + 1.5 + 2.5)
    assert report.joints[0].demand.peak == pytest.approx(own + 9.81 * added * LENGTH * (1 + 2))
    assert (verdict.question, verdict.signed) == ("", not failing)
    said = any("the same drives are chosen" in text for text in verdict.remarks)
    assert said == (masses is None and mass == 2.0)
    assert any(failing in line for line in verdict.failing) == bool(failing)
    if not failing:
        assert verdict.fitted == 3
        return
    assert {joint.state for joint in verdict.joints} == {"provisional"}
    assert verdict.headline.startswith("0 of 3 joints can be signed, 3 provisional; 4.50 kg")
    if masses == "with_drives":
        assert "4.50 kg of drives so, 4.50 kg where added" in verdict.failing[0]


def test_where_it_is_not_said_both_are_sized_and_the_headline_gives_both(tmp_path):
    """4 kg links: 35 N m at the base, 44 with the drives beyond: more than the motor's 40."""
    open_ = sized(tmp_path, 4.0, None)
    bare, held = (sized(tmp_path, 4.0, f"{word}_drives") for word in ("without", "with"))
    masses = [sum(j.mass for j in x.verdict.joints) for x in (open_, bare, held)]
    assert masses == pytest.approx([2 * DRIVE + STRONG, 2 * DRIVE + STRONG, 3 * DRIVE])
    assert open_.other_mass == pytest.approx(3 * DRIVE)
    asked = "5.10 kg if the links are bare, 4.50 kg if they hold the drives: write `robot.masses`"
    assert open_.verdict.question == asked
    assert asked in open_.verdict.headline
    assert open_.verdict.signed
    assert (bare.verdict.question, held.verdict.question) == ("", "")


def test_a_drive_whose_mass_is_given_is_not_doubted(tmp_path):
    known = {"mass_in_urdf": {"joint_2": 0.1, "joint_3": 0.1}}
    assert sized(tmp_path, 0.4, "with_drives", **known).verdict.signed


def test_without_gravity_nothing_is_chosen(tmp_path):
    scene = arm(2.0, "with_drives").with_(gravity=[0.0, 0.0, 0.0])
    motion = still(scene)
    assert pf.size(scene, motion).joints[0].demand.peak == 0.0
    with pytest.raises(SizingError, match=r"robot.gravity is \[0, 0, 0\]: .* give the gravity"):
        pf.size(scene, motion, one_drive(tmp_path))
