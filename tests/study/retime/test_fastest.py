"""Cycle time beside mass, and what `retime` and `size --fastest` print and draw."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from envelopes import result_of
from sizing_cases import GEAR, MOTOR, turntable, write_catalog

import pinfric as pf
from pinfric import cli
from pinfric.study.retime.fastest import fastest_sets

WAY = """pinfric_trajectory: 1
points:
  - {q: [0.0], hold: 0.2}
  - {q: [1.5], duration: 2.0, hold: 0.4}
  - {q: [0.0], duration: 2.0}
"""
URDF = """<robot name="table"><link name="base"/><link name="plate"><inertial><mass value="3"/>
  <inertia ixx="1" iyy="1" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="table" type="continuous"><parent link="base"/><child link="plate"/>
  <axis xyz="0 0 1"/><limit effort="40" velocity="3"/></joint></robot>"""


@pytest.fixture
def files(tmp_path, monkeypatch):
    (tmp_path / "table.urdf").write_text(URDF)
    (tmp_path / "table.yaml").write_text(
        "pinfric: 1\nrobot: {urdf: table.urdf}\n"
        "friction: {table: {coulomb: {static: 3.0, kinetic: 3.0}}}\n"
    )
    (tmp_path / "way.yaml").write_text(WAY)
    motors = {
        "small": MOTOR | {"peak_torque": 0.6},
        "large": MOTOR | {"peak_torque": 1.2, "mass": 0.9},
    }
    write_catalog(tmp_path / "catalog.yaml", motors, {"G": GEAR | {"repeated_peak_torque": 95.0}})
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    return ended.value.code


def test_heavier_motors_buy_time(tmp_path):
    scene = turntable()
    motors = {
        "small": MOTOR,
        "large": MOTOR | {"peak_torque": 3.0, "mass": 0.9, "continuous_torque": 2.0},
        "heavy": MOTOR | {"mass": 2.0},
    }
    catalog = write_catalog(tmp_path / "catalog.yaml", motors)
    path = pf.Path.from_waypoints([[0.0], [1.0]])
    t = np.linspace(0.0, 4.0, 801)
    move = pf.Trajectory.from_arrays(
        scene, t, np.sin(t)[:, None], np.cos(t)[:, None], -np.sin(t)[:, None]
    )
    report = pf.size(scene, move, catalog)
    sets = fastest_sets(report, path)
    light, large = (
        next(x for x in sets if x.drives["table"].startswith(name)) for name in ("small", "large")
    )
    assert light.best
    assert large.best
    assert large.duration < 0.95 * light.duration
    assert not any(x.best for x in sets if x.drives["table"].startswith("heavy"))
    assert light.mass == pytest.approx(MOTOR["mass"] + GEAR["mass"])
    demand = pf.size(scene, move)
    with pytest.raises(pf.RetimeError, match="needs a drive for every joint"):
        fastest_sets(demand, path)


def test_retime_prints_writes_and_its_trajectory_is_one_for_all(files, capsys):
    assert run("retime", "table.yaml", "way.yaml", "--sensitivity", "--out", "out") == 0
    out, _ = capsys.readouterr()
    assert max(map(len, out.splitlines())) <= 80
    assert "effort" in out
    assert {f.name for f in Path("out").iterdir()} == {
        "trajectory.csv",
        "retime.png",
        "summary.json",
    }
    summary = result_of(Path("out/summary.json").read_text())
    # 40 N m, 3 of them friction, at 2 kg m^2, up to 3 rad/s
    up, down = 37.0 / 2.0, 43.0 / 2.0
    move = 1.5 / 3.0 + 0.5 * 3.0 * (1 / up + 1 / down)
    assert summary["duration"] == pytest.approx(2 * move + 0.6, rel=1e-4)
    assert summary["drives"][0]["sensitivity"].keys() == {"effort", "joint speed"}
    assert run("inverse", "table.yaml", "out/trajectory.csv", "--json") == 0
    (joint,) = result_of(capsys.readouterr().out)["joints"]
    assert joint["peak"] == pytest.approx(40.0, rel=1e-3)
    assert run("retime", "table.yaml", "out/trajectory.csv", "--json", "--smooth", "10") == 0
    again = result_of(capsys.readouterr().out)
    assert again["duration"] == pytest.approx(summary["duration"] + 0.02, rel=1e-3)
    assert again["before"] == pytest.approx(summary["duration"], abs=2e-3)


def test_retime_of_what_cannot_be_is_one_line(files, capsys):
    Path("motors.yaml").write_text("pinfric_motors: 1\ndrives: {table: {peak_torque: 2.0}}\n")
    assert run("retime", "table.yaml", "way.yaml", "--motors", "motors.yaml") == cli.BAD_INPUT
    error = capsys.readouterr().err
    assert "drive 'table' cannot break away: needs 3 N m of its motor, has 2" in error
    assert error.count("\n") == 1
    assert run("retime", "four_bar", "way.yaml") == cli.BAD_INPUT
    assert "retime is for open chains" in capsys.readouterr().err
    assert run("retime", "table.yaml", "none.yaml") == cli.BAD_INPUT


def test_motors_file_in_the_guide_fits_the_panda(tmp_path):
    page = (Path(__file__).parents[3] / "notebooks/guide/retime.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```yaml\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (tmp_path / "motors.yaml").write_text(example)
    scene = pf.load_scene("panda_pick_and_place")
    found = pf.retime(scene, "panda_pick_and_place.csv", tmp_path / "motors.yaml", points=100)
    assert found.excess < 1e-3
    assert found.duration < found.before


def test_size_with_fastest(files, capsys):
    arguments = "size", "table.yaml", "way.yaml", "--catalog", "catalog.yaml", "--fastest"
    assert run(*arguments, "--out", "out") == 0
    out, _ = capsys.readouterr()
    assert "fastest motion along the path" in out
    assert (files / "out" / "fastest.png").stat().st_size > 5000
    sets = result_of(Path("out/sizing.json").read_text())["fastest"]
    assert [x["drives"]["table"] for x in sets if x["best"]] == ["small + G", "large + G"]
    assert sets[0]["duration"] > sets[1]["duration"]


def test_plot_and_summary_of_a_result(files):
    scene = pf.load_scene("table.yaml")
    found = pf.retime(scene, "way.yaml", points=60)
    assert len(found.plot().axes) == 2
    assert found.summary().loc["table", "effort"] == pytest.approx(1.0, abs=1e-3)
    assert "table: " in repr(found)
