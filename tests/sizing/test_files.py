"""Files of `size --out` for the commands that follow."""

import numpy as np
import yaml
from cli_cases import refused, run, told
from sizing_cases import write_catalog

import pinfric as pf
from pinfric.model.schema import Assumed
from pinfric.retiming.limits import limited_scene, read_limits
from pinfric.sizing.files import sized_files


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
