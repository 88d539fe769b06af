"""Reports of a log by the commands: on stderr, in tables, in JSON, in the figure."""

import numpy as np
import pytest
from builders import example
from cli_cases import refused, told
from envelopes import result_of

SCENE = """pinfric: 1
robot: {urdf: "example-robot-data:ur_description/urdf/ur10_robot.urdf"}
"""
JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)


@pytest.fixture
def log(tmp_path, monkeypatch):
    """A UR10 that swings at 500 Hz with 2e-5 rad of noise, and the effort of its second joint."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ur10.yaml").write_text(SCENE)
    t = np.arange(1500) / 500
    swing = np.outer(np.sin(2 * t), [0.3, 0.2, 0.4, 0.0, 0.0, 0.5])
    swing += np.array([0, -1.2, 1, -1.5, -1.5, 0])
    swing += 2e-5 * np.random.default_rng(1).normal(size=swing.shape)
    header = ",".join(["t", *JOINTS, "shoulder_lift_joint/effort"])
    np.savetxt(
        tmp_path / "log.csv",
        np.column_stack((t, swing, np.full(t.size, 100.0))),
        delimiter=",",
        header=header,
        comments="",
        fmt="%.12g",
    )
    return "log.csv"


@pytest.mark.slow
def test_inverse_says_how_far_efforts_are_known(log, capsys, tmp_path):
    out, err = told(capsys, "inverse", "ur10.yaml", log, "--out", "out")
    assert "warning: log.csv: filtered at" in err
    assert "rad, peak efforts known to" in out.replace("\n", " ").replace("  ", " ")
    assert out.count("±") == 1  # no joint's effort is known to no better than a tenth
    found = result_of((tmp_path / "out" / "summary.json").read_text())["input"]
    assert found["samples"] + found["dropped"] == 1500
    assert found["samples"] > 1400
    assert found["resampled"] == 0
    assert found["noise"]["elbow_joint"] == pytest.approx(2e-5, rel=0.05)
    assert 2.0 < found["cutoff"]["elbow_joint"] < 20.0
    assert found["cutoff"]["wrist_2_joint"] is None  # it stands still
    assert 0.0 < found["peak_uncertainty"]["shoulder_lift_joint"] < 3.0
    assert set(found["measured"]) == {"shoulder_lift_joint"}
    assert found["measured"]["shoulder_lift_joint"]["rms"] == pytest.approx(100.0)


def test_a_cutoff_is_set_or_forbidden_on_every_command(log, capsys):
    out = told(capsys, "inverse", "ur10.yaml", log, "--cutoff", "5", "--json").out
    assert result_of(out)["input"]["cutoff"]["elbow_joint"] == 5.0
    out = told(capsys, "inverse", "ur10.yaml", log, "--cutoff", "none", "--json").out
    found = result_of(out)["input"]
    assert set(found["cutoff"].values()) == {None}
    out = told(capsys, "inverse", "ur10.yaml", log, "--cutoff", "none").out
    assert out.count("±") > 4  # beside the peaks
    assert found["peak_uncertainty"]["shoulder_lift_joint"] > 100.0
    for command in ("size", "explain"):
        err = told(capsys, command, "ur10.yaml", log, "--cutoff", "5").err
        assert "filtered at 5 Hz" in err
    for command in ("sweep", "replay"):
        out = told(capsys, command, "--help").out
        assert all(f"--{o}" in out for o in ("columns", "unit", "time-unit", "cutoff"))


def test_units_that_there_are_not(log, capsys):
    err = refused(capsys, "inverse", "ur10.yaml", log, "--unit", "grad")
    assert err == "pinfric: error: --unit grad: did you mean 'rad'? there are: rad, deg, turn\n"


@pytest.mark.filterwarnings("ignore:.*(filtered at|left out)")
def test_the_figure_says_how_far_efforts_are_known(log):
    import pinfric as pf
    from pinfric.motions.log.judged import judge_log
    from pinfric.show.figure.efforts import effort_figure

    scene, motion = example("ur10.yaml", log)
    result = pf.inverse_dynamics(scene, motion)
    figure = effort_figure(result, log, log=judge_log(result, motion.reading))
    text = figure.legends[0].get_title().get_text()
    assert "filtered at" in text
    assert "peak efforts known to ±" in text


def test_efforts_of_zero_in_a_log_have_no_relative_error(log, capsys, tmp_path):
    rows = (tmp_path / log).read_text().replace("100\n", "0\n")
    (tmp_path / log).write_text(rows)
    out, _ = told(capsys, "inverse", "ur10.yaml", log)
    assert "nan" not in out
