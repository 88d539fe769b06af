"""Sizing on elastic gears: the safe resonance rule, and requirements of the whole robot."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example, lump
from cli_cases import told
from mechanisms import shifted
from sizing_cases import GEAR, one_drive, write_catalog

import pinfric as pf
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status
from pinfric.drives.inertia import joint_inertias
from pinfric.errors import CatalogError, SizingError
from pinfric.model.springs import StiffnessLines
from pinfric.show.pages.sizing import sizing_page
from pinfric.sizing.summary import sizing_summary

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*(is outside the usual range|is a radius of gyration|continuous torque)"
)

TAU = 2 * np.pi
LINES = {"k1": 1e4, "k2": 1.4e4, "k3": 1.6e4, "t1": 3.9, "t2": 12}


@pytest.fixture(scope="module")
def arm():
    """Two vertical axes in a chain: no gravity, inertias that are written down."""
    links = [
        ("a", pin.JointModelRZ(), lump(2.0, [0.2, 0, 0], 0.02)),
        (
            "b",
            pin.JointModelRZ(),
            lump(1.0, [0.15, 0, 0]),
            [0.4, 0.0, 0.0],
        ),
    ]
    model = chain(*links)
    place = shifted(0.3)
    model.addFrame(pin.Frame("tool", 2, 0, place, pin.FrameType.BODY))
    friction = {name: dry(2.0, 1.5) for name in "ab"}
    scene = pf.Scene(model, friction=friction, tool="tool")
    s = np.linspace(0, 1, 201)
    shape = 10 * s**3 - 15 * s**4 + 6 * s**5
    t = np.concatenate([s, 1.0 + s[1:]])
    q = np.concatenate([shape, np.ones(200)])[:, None] * [[0.5, -0.3]]
    v = np.concatenate([30 * s**2 - 60 * s**3 + 30 * s**4, np.zeros(200)])[:, None] * [[0.5, -0.3]]
    a = np.concatenate([60 * s - 180 * s**2 + 120 * s**3, np.zeros(200)])[:, None] * [[0.5, -0.3]]
    v[200] = a[200] = 0.0
    return scene, pf.Trajectory.from_arrays(scene, t, q, v, a)


def sized(arm, tmp_path, gear=None, **conditions):
    scene, motion = arm
    catalog = one_drive(tmp_path, gear={"mass": 1e-6, **(gear or {})}, motor={"mass": 1e-6})
    wanted = {"resonance_base": 0.1, **conditions}
    return pf.size(scene, motion, catalog, conditions=wanted, on_miss="ignore")


def criterion(report, name):
    return next(c for c in report.arm_criteria if c.name == name)


def reversal(report, joint="a"):
    return report.reversals[report.scene.actuator_names.index(joint)]


def test_a_joints_resonance_is_that_with_all_others_rigid(arm, tmp_path):
    """f = sqrt(K/J)/(2 pi) of each joint; that of the whole arm is lower, and said, too."""
    report = sized(arm, tmp_path)
    for joint in report.joints:
        found = next(c for c in joint.choice.criteria if c.name == "gear resonance")
        assert found.available == pytest.approx(
            np.sqrt(GEAR["stiffness"] / joint.load_inertia) / TAU
        )
    first = next(c for c in report.joints[0].choice.criteria if c.name == "gear resonance")
    assert report.elastic.frequency.min() < first.available
    judged = sized(arm, tmp_path, resonance_base=1.01 * first.available)
    assert [c.name for c in judged.joint("a").nearest.failed] == ["gear resonance"]
    assert "conditions.resonance_base = " in judged.verdict.failing[0]
    assert "default 8)" in judged.verdict.failing[0]


def test_lowest_frequency_and_tool_of_the_chosen_gears(arm, tmp_path):
    report = sized(
        arm,
        tmp_path,
        gear={"stiffness": LINES},
        lowest_frequency=0.5,
        tool_sag=1e-3,
        tool_interval=1e-3,
        tool_reversal=1e-3,
    )
    gears = {drive.transmission.stiffness for drive in report.scene.drives}
    assert gears == {StiffnessLines(**LINES)}
    found = criterion(report, "lowest frequency")
    assert found.status == Status.PASSES
    assert found.available == report.elastic.frequency.min()
    rest = report.elastic.rests[-1].tool
    assert criterion(report, "tool interval").required == pytest.approx(rest.farthest)
    assert criterion(report, "tool reversal error").required == pytest.approx(rest.reversal)
    assert criterion(report, "tool sag").required == pytest.approx(0.0, abs=1e-12)
    assert report.verdict.failing == ()


@pytest.mark.parametrize("masses", ["with_drives", "without_drives"])
def test_the_lightest_gears_that_swing_fast_enough_are_taken(masses, arm, tmp_path):
    """The light ones up to their own frequency, and beyond it not both of them."""
    scene, motion = arm
    gears = {"light": GEAR | {"mass": 0.1}, "stiff": GEAR | {"stiffness": 9e4}}
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", gears=gears))

    def taken(**more):
        given = {"resonance_base": 0.1, "inertia_ratio": 1e3, **more}
        return pf.size(scene.with_(masses=masses), motion, catalog, conditions=given)

    alone = taken()
    lowest = float(alone.elastic.frequency.min())
    names = [
        {joint.choice.candidate.gear_name for joint in report.joints}
        for report in (alone, *(taken(lowest_frequency=x * lowest) for x in (0.999, 1.001)))
    ]
    assert names[:2] == [{"light"}] * 2
    assert "stiff" in names[2]


@pytest.mark.parametrize("which", [1, 3, 5, 7])
def test_of_all_sets_that_swing_fast_enough_the_lightest_is_taken(which, arm, tmp_path):
    """Against all pairs of three gears, by eigenvalues of K^-1 M; links weigh as in the scene."""
    scene, motion = arm
    figures = {"light": (0.1, 1e4), "middle": (0.3, 4e4), "stiff": (0.8, 9e4)}
    gears = {name: GEAR | {"mass": m, "stiffness": K} for name, (m, K) in figures.items()}
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", gears=gears))
    M = [pin.crba(scene.model, scene.model.createData(), q).copy() for q in motion.q]
    sets = []
    for (own, K_a), (other, K_b) in product(figures.values(), repeat=2):
        slowest = max(np.linalg.eigvals(m / [[K_a], [K_b]]).real.max() for m in M)
        sets.append((slowest**-0.5 / TAU, own + other))
    lowest = sorted(sets)[which][0] * (1.0 - 1e-6)
    report = pf.size(
        scene.with_(masses="with_drives"),
        motion,
        catalog,
        conditions={"resonance_base": 0.1, "inertia_ratio": 1e3, "lowest_frequency": lowest},
    )
    assert report.elastic.frequency.min() >= lowest
    taken = sum(figures[joint.choice.candidate.gear_name][0] for joint in report.joints)
    assert taken == pytest.approx(min(mass for frequency, mass in sets if frequency >= lowest))


def test_reversal_error_of_a_joint_is_its_wind_up_either_way_and_its_backlash(arm, tmp_path):
    """No gravity: kinetic friction of 1.5 N m winds each gear up by 1.5/K either way."""
    gear = {"stiffness": 1e4, "backlash": 2e-4}
    report = sized(arm, tmp_path, gear=gear, reversal_error=5.1e-4, backlash=1e-4)
    for name in "ab":
        found = reversal(report, name)
        assert found.required == pytest.approx(2 * 1.5 / 1e4 + 2e-4, rel=1e-6)
        assert (found.status, found.unit) == (Status.PASSES, "rad")
        row = next(c for c in report.joint(name).nearest.criteria if c.name == "backlash")
        assert (row.required, row.available, row.status) == (2e-4, 1e-4, Status.FAILS)
    # the maker's hysteresis counts where it is more than the friction winds up
    wide = {**gear, "hysteresis": 6e-4}
    found = reversal(sized(arm, tmp_path, gear=wide, reversal_error=1e-3))
    assert found.required == pytest.approx(6e-4 + 2e-4)


def test_a_reversal_error_known_in_part_can_only_fail(arm, tmp_path):
    unknown = sized(arm, tmp_path, reversal_error=1e-3)
    found = reversal(unknown)
    assert (found.status, found.note) == (Status.NOT_CHECKED, "no figure (backlash of the gear)")
    failing = reversal(sized(arm, tmp_path, reversal_error=1e-4))
    assert failing.status == Status.FAILS
    assert failing.required == pytest.approx(3e-4)
    short = sized(arm, tmp_path, reversal_error=1e-4)
    assert short.verdict.failing[0].startswith(
        "a: reversal error: needs 0.0003 rad, has 0.0001 rad"
    )
    (row,) = (row for row in sizing_summary(unknown).unchecked if row.criterion == failing.name)
    assert (row.joints, row.missing) == (("a", "b"), "backlash of the gear")
    assert not any(c.name == "backlash" for c in sized(arm, tmp_path).joint("a").choice.criteria)


def test_what_is_asked_in_vain_is_an_error(arm, tmp_path):
    report = sized(arm, tmp_path, lowest_frequency=500.0, tool_interval=1e-9)
    assert [line.split(":")[1].strip() for line in report.verdict.failing] == [
        "lowest frequency",
        "tool interval",
    ]
    with pytest.raises(SizingError, match="robot: lowest frequency: needs 500 Hz, has"):
        report.check()


def test_gears_without_stiffness_are_not_judged_as_rigid_ones(arm, tmp_path):
    report = sized(arm, tmp_path, gear={"stiffness": None}, lowest_frequency=1.0, tool_sag=1e-3)
    assert report.elastic is None
    for found in report.arm_criteria:
        assert found.status == Status.NOT_CHECKED
        assert found.note == "no figure (stiffness of a, b)"


def test_a_tool_must_be_named(arm, tmp_path):
    scene, motion = arm
    with pytest.raises(CatalogError, match=r"conditions\.tool_sag: .* names no `tool`"):
        pf.size(scene.with_(tool=None), motion, conditions={"tool_sag": 1e-3})


def test_the_scenes_own_gears_are_judged_without_a_catalogue(capsys):
    scene, motion = example("ur10_machine_tending")
    report = pf.size(
        scene, motion, conditions={"tool_interval": 1e-4, "tool_sag": 3e-3}, on_miss="ignore"
    )
    assert [c.status for c in report.arm_criteria] == [Status.PASSES, Status.FAILS]
    assert report.verdict.failing[0].startswith(
        "robot: tool interval: needs 0.0002232 m, has 0.0001 m"
    )
    printed = told(capsys, "size", "ur10_machine_tending", "ur10_machine_tending").out
    assert "lowest frequency, motors held: 8.17 Hz" in printed


@pytest.mark.slow
def test_the_page_says_it_too(arm, tmp_path):
    page = sizing_page(sized(arm, tmp_path, gear={"stiffness": LINES}, tool_sag=1e-3))
    assert "<h2>Elastic gears</h2>" in page
    assert "<li>lowest frequency, motors held: " in page
    assert "<li>tool sag: needs 0 m, has 0.001 m" in page


def test_sizing_of_rigid_gears_says_nothing_of_it(capsys, tmp_path):
    found = told(capsys, "size", "pendulum", "pendulum", "--json", "--out", tmp_path).out
    assert "Elastic gears" not in (tmp_path / "report.html").read_text()
    assert '"elasticity": null' in found
    assert '"robot"' not in found


def test_inertias_are_those_of_pinocchio_one_by_one():
    scene, motion = example("ur5_pick_and_place")
    result = pf.inverse_dynamics(scene, motion)
    found = joint_inertias(scene, result.states)
    for sample in (0, 400, 900):
        carried = [n for n, on in zip(scene.payloads, motion.attached[sample], strict=True) if on]
        model = scene.loaded_model(carried)
        data = model.createData()
        expected = pin.crba(model, data, motion.q[sample]).diagonal() - model.armature
        np.testing.assert_allclose(found[sample], expected, rtol=1e-10)


def test_the_catalogues_lines_are_the_makers():
    """Harmonic Drive engineering data 1018854 8/2018, tables 54.3, 54.4, ratio above 50."""
    gears = load_catalog("default").gears
    printed = {"17": (10, 14, 16, 3.9, 12), "20": (16, 25, 29, 7, 25), "25": (31, 50, 57, 14, 48)}
    for size, (k1, k2, k3, t1, t2) in printed.items():
        lines = gears[f"Harmonic Drive CSG-{size}-100"].stiffness
        assert lines == StiffnessLines(k1=k1 * 1e3, k2=k2 * 1e3, k3=k3 * 1e3, t1=t1, t2=t2)
        assert gears[f"Harmonic Drive CSG-{size}-100"].hysteresis == pytest.approx(
            np.pi / 10800  # 1 arcmin
        )
