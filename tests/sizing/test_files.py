"""Files of `size --out` for the commands that follow."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from cli_cases import refused, run, told
from sizing_cases import GEAR, MOTOR, write_catalog

import pinfric as pf
from pinfric.errors import CatalogError, RetimeError, SizingError
from pinfric.model.scene_text import scene_content
from pinfric.model.schema import Assumed
from pinfric.retiming.limits import limited_scene, read_limits
from pinfric.sizing.files import judge_files, sized_files


def test_the_sized_scene_is_the_reports_and_goes_with_it(tmp_path, capsys):
    catalog = write_catalog(tmp_path / "catalog.yaml", conditions={"holding_brake": "any"})
    size = "size", "three_link", "three_link", "--catalog", catalog, "--out", tmp_path / "out"
    assert run(*size) == 0
    scene = pf.load_scene("three_link")
    motion = pf.load_trajectory("three_link", scene)
    report = pf.size(scene, motion, catalog)
    read = pf.load_scene(tmp_path / "out/sized.scene.yaml")
    motors = yaml.safe_load((tmp_path / "out/motors.yaml").read_text())
    assert motors["catalog"] == "../catalog.yaml"  # both may move together
    limits = read_limits(read, tmp_path / "out/motors.yaml")
    assert limited_scene(read, limits) is read  # a file of motors replaces nothing
    found = pf.inverse_dynamics(read, motion)
    assert np.allclose(found.effort_upper, report.result.effort_upper, rtol=1e-9, atol=1e-9)
    for drive, limit, chosen in zip(read.drives, limits, report.drives, strict=True):
        assert drive.transmission == chosen.transmission
        assert limit.from_catalog[0] == chosen
    heavier = read.model.inertias[2].mass - scene.model.inertias[2].mass
    assert heavier > 0
    again = "size", tmp_path / "out/sized.scene.yaml", *size[2:3], *size[-2:]
    assert "sized.scene.yaml: is an input of this command" in told(capsys, *again, code=2).err
    told(capsys, *size, "--condition", "peak_factor=900", code=2)
    assert not (tmp_path / "out/sized.scene.yaml").exists()
    assert not (tmp_path / "out/bom.csv").exists()


@pytest.fixture(scope="module")
def braked(tmp_path_factory):
    """Folder with files of a sizing with brakes, for a cycle and beside it a rating; its report."""
    folder = tmp_path_factory.mktemp("braked")
    brake = {"source": "invented", "grade": "R", "torque": 2.0, "mass": 0.3, "rotor_inertia": 4e-6}
    strong = dict.fromkeys(("rated_torque", "average_torque", "repeated_peak_torque"), 500.0)
    catalog = write_catalog(
        folder / "catalog.yaml",
        {"M": MOTOR | {"continuous_torque": 2.0, "torque_constant": 0.5, "max_voltage": 400.0}},
        {"G": GEAR | strong | {"momentary_peak_torque": 5e3}},
        brakes={"B": brake},
        conditions={"holding_brake": "all", "peak_factor": 1.5},
    )
    part = {"part": {"link": "link_3", "mass": 0.5, "com": [0, 0, 0.1]}}
    scene = pf.load_scene("three_link").with_(payloads=part)
    speed = dict.fromkeys(scene.joint_names, 1.0)
    report = pf.size(
        scene,
        pf.load_trajectory("three_link", scene),
        catalog,
        rating={"payload": 1.0, "speed": speed},
        conditions={"peak_factor": 1.2, "bus_voltage": 400.0, "reversal_error": 1e-9},
        on_miss="ignore",
    )
    for name, text in sized_files(report, folder).items():
        (folder / name).write_text(text)
    return folder, report


def test_a_scene_is_judged_with_the_brakes_that_it_has(braked):
    """`retime` has the rotor of motor, gear and brake; its conditions are those of `size`."""
    folder, report = braked
    scene = pf.load_scene(folder / "sized.scene.yaml")
    limits = read_limits(scene, folder / "motors.yaml")
    for actuator, limit in zip(scene.actuators, limits, strict=True):
        candidate, conditions = limit.from_catalog
        assert actuator.installed.model_dump() == {"drive": "M + G", "brake": "B"}
        assert candidate.rotor_inertia == pytest.approx(5e-5 + 1e-5 + 4e-6)
        assert candidate.transmission == actuator.transmission
        assert conditions == report.conditions
        assert candidate.mass == pytest.approx(0.6 + 0.9 + 0.3)


def test_a_rated_payload_beside_a_cycle_is_no_payload_of_the_scene(braked):
    folder, report = braked
    assert list(report.scene.payloads) == ["part", "rated"]
    assert list(pf.load_scene(folder / "sized.scene.yaml").payloads) == ["part"]


def test_files_are_read_back_and_judged_before_they_are_written(braked, monkeypatch):
    _, report = braked
    judge_files(report)
    monkeypatch.setattr(
        "pinfric.sizing.files.scene_content",
        lambda scene, *more: scene_content(replace(scene, payloads={}), *more),
    )
    with pytest.raises(SizingError, match=r"sized.scene.yaml: read back, it has efforts up to .*"):
        judge_files(report)


@pytest.mark.slow
def test_files_of_a_loop_are_read_back_alike():
    """Reversals between samples are those of the cycle, with its times."""
    scene = pf.load_scene("four_bar")
    judge_files(pf.size(scene, pf.load_trajectory("four_bar", scene), "default"))


def test_joints_that_are_not_signed_are_marked(braked):
    folder, report = braked
    wrong = [joint.name for joint in report.verdict.joints if joint.state != "can be signed"]
    assert wrong
    for name, row in (("motors.yaml", "{}: {{drive"), ("sized.scene.yaml", "joint: {}")):
        lines = (folder / name).read_text().splitlines()
        marked = [line for line in lines if "NOT SIGNED" in line]
        assert len(marked) == len(wrong)
        for joint, line in zip(wrong, marked, strict=True):
            assert row.format(joint) in line


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("sized.scene.yaml", "mass: 0.5", "mass: 0.7", "payload part: 0.7 kg, but .* for 0.5 kg"),
        ("sized.urdf", r'(?<=<mass value=")[^"]*', "9", "joint joint_1: 9 kg, but the drives"),
        (
            "sized.scene.yaml",
            "ratio: 100.0",
            "ratio: 80.0",
            r"transmission.ratio is 80, but 100 of",
        ),
        (
            "sized.scene.yaml",
            "rotor_inertia: 6.4e-05",
            "rotor_inertia: 6.0e-05",
            r"transmission.rotor_inertia is 6e-05, but 6.4e-05 of M \+ G with B",
        ),
        ("sized.scene.yaml", "torque: 2.0", "torque: 3.0", "transmission.brake.torque is 3, but 2"),
        ("sized.scene.yaml", "drive: M", "drive: N", r"`installed` is N \+ G, not M \+ G"),
        ("sized.scene.yaml", "brake: B", "brake: C", "no brake 'C' .*; there are: B"),
        ("sized.scene.yaml", r"\n    installed: .*", "", "no product .* an older version wrote it"),
        (
            "motors.yaml",
            "robot: .*",
            "robot: other",
            "are of the robot 'other', .* of 'three_link'",
        ),
    ],
)
def test_a_scene_that_was_changed_since_is_refused(braked, tmp_path, file, old, new, says):
    for name in ("catalog.yaml", "sized.scene.yaml", "sized.urdf", "motors.yaml"):
        text = (braked[0] / name).read_text()
        if name == file:
            assert re.search(old, text)
            text = re.sub(old, new, text)
        (tmp_path / name).write_text(text)
    scene = pf.load_scene(tmp_path / "sized.scene.yaml")
    with pytest.raises((CatalogError, RetimeError), match=says):
        read_limits(scene, tmp_path / "motors.yaml")


def test_motors_of_a_sizing_need_its_scene(braked):
    """A scene without gears is not the machine that was sized: it lacks brakes, maybe masses."""
    motors = braked[0] / "motors.yaml"
    with pytest.raises(RetimeError, match=r"no product .* at joint_1: give sized.scene.yaml"):
        read_limits(pf.load_scene("three_link"), motors)


def test_motors_that_pinfric_did_not_write_stay(tmp_path, capsys):
    (tmp_path / "motors.yaml").write_text("mine")
    size = "size", "pendulum", "pendulum", "--out", tmp_path
    for more in ([], ["--catalog", "default"]):
        assert "motors.yaml: is there already" in refused(capsys, *size, *more)
    told(capsys, "--overwrite", *size)  # it writes none
    assert (tmp_path / "motors.yaml").read_text() == "mine"


def test_without_jinja2_all_but_the_page_is_written(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pinfric.terminal.find_spec", lambda name: None)
    said = told(capsys, "size", "pendulum", "pendulum", "--out", tmp_path / "out")
    assert "report.html is left out: it needs jinja2: pip install" in said.err
    assert (tmp_path / "out/sizing.json").exists()
    assert not (tmp_path / "out/report.html").exists()
    for place in (
        (tmp_path / "out/sizing.json", "pendulum"),
        ("pendulum", tmp_path / "out/sizing.json"),
    ):
        error = refused(capsys, "stop", *place)
        assert "is what `pinfric size` found" in error
        assert "sized.scene.yaml" in error


def test_what_drives_replace_is_no_guess_of_the_sized_scene(tmp_path):
    scene = pf.load_scene("three_link")
    friction = {**scene.friction, "joint_23": {"coulomb": 1.0, "viscous": 2.0}}
    values = {
        "friction.joint_23.coulomb": "5 %",
        "friction.joint_23.viscous": "20 %",
        "payloads": "5 kg",
    }
    assumed = Assumed(by="pinfric new", date="2026-11-28", version="0.1.0", values=values)
    scene = scene.with_(friction=friction, assumed=assumed)
    catalog = write_catalog(tmp_path / "catalog.yaml", conditions={"holding_brake": "any"})
    report = pf.size(scene, pf.load_trajectory("three_link", scene), catalog)
    written = yaml.safe_load(sized_files(report, tmp_path)["sized.scene.yaml"])
    assert written["friction"]["joint_23"]["viscous"] == 0.0
    assert written["assumed"]["values"] == {"payloads": "5 kg"}
