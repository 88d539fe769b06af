"""Cycle time beside mass, and what `retime` and `size --fastest` print and draw."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from envelopes import result_of
from retime_cases import run
from sizing_cases import GEAR, MOTOR, turntable, write_catalog

import pinfric as pf
from pinfric.study.retime.fastest import fastest_sets


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
