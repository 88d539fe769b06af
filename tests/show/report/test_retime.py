"""`pinfric retime` as a shell sees it."""

from pathlib import Path

import numpy as np
import pytest
from cli_cases import refused, results_in, run, told
from envelopes import result_of
from matplotlib.patches import StepPatch
from printed import assert_printed

import pinfric as pf
from pinfric import cli


def test_retime_prints_writes_and_its_trajectory_is_one_for_all(files, capsys):
    out = told(capsys, "retime", "table.yaml", "way.yaml", "--out", "out").out
    assert max(map(len, out.splitlines())) <= 80
    assert_printed(__file__, "retime", out)
    assert set(results_in("out")) == {
        "trajectory.csv",
        "retime.pdf",
        "retime.png",
        "summary.json",
    }
    summary = result_of(Path("out/summary.json").read_text())
    # 40 N m, 3 of them friction, at 2 kg m^2, up to 3 rad/s
    up, down = 37.0 / 2.0, 43.0 / 2.0
    move = 1.5 / 3.0 + 0.5 * 3.0 * (1 / up + 1 / down)
    assert summary["duration"] == pytest.approx(2 * move + 0.6, rel=1e-4)
    (joint,) = result_of(told(capsys, "inverse", "table.yaml", "out/trajectory.csv", "--json").out)[
        "joints"
    ]
    assert joint["peak"] == pytest.approx(40.0, rel=1e-3)
    again = result_of(
        told(capsys, "retime", "table.yaml", "out/trajectory.csv", "--json", "--smooth", "10").out
    )
    assert again["duration"] == pytest.approx(summary["duration"] + 0.02, rel=1e-3)
    assert again["before"] == pytest.approx(summary["duration"], abs=2e-3)


def test_retime_of_what_cannot_be_is_one_line(files, capsys):
    Path("motors.yaml").write_text("pinfric_motors: 1\ndrives: {table: {peak_torque: 2.0}}\n")
    error = refused(capsys, "retime", "table.yaml", "way.yaml", "--motors", "motors.yaml")
    assert "drive 'table' cannot break away: needs 3 N m of its motor, has 2" in error
    assert "retime is for open chains" in refused(capsys, "retime", "four_bar", "way.yaml")
    assert run("retime", "table.yaml", "none.yaml") == cli.BAD_INPUT


def test_plot_and_summary_of_a_result(files):
    scene = pf.load_scene("table.yaml")
    found = pf.retime(scene, "way.yaml", points=60)
    _, low = found.plot().axes  # a drive's strip is as high as the used part of its nearest limit
    strips = [patch.get_data() for patch in low.patches if isinstance(patch, StepPatch)]
    used = sum(strip.baseline - strip.values for strip in strips) / 0.84
    middle = 0.5 * (strips[0].edges[:-1] + strips[0].edges[1:])
    most = found.usage.max(axis=(1, 2))
    near = np.interp(middle, found.trajectory.t, most)
    assert np.quantile(np.abs(used - near), 0.95) < 0.02
    assert used.max() == pytest.approx(1.0, abs=1e-3)
    assert found.summary().loc["table", "effort"] == pytest.approx(1.0, abs=1e-3)
    assert "table: " in repr(found)
