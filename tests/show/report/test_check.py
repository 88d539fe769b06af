"""`pinfric check` as a shell sees it."""

import pytest
from check_cases import TIP, J, arm
from cli_cases import refused, run, told
from envelopes import result_of, validated
from printed import assert_printed


def test_exit_codes_and_json(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    good = arm(tmp_path)
    assert run("check", good, "--strict") == 0
    doubtful = arm(tmp_path, low=0, high=0)
    assert told(capsys, "check", doubtful)
    out, err = told(capsys, "check", doubtful, "--strict", code=2)
    assert len(err.splitlines()) == 1
    assert "joint swing: limits 0 to 0" in err
    assert_printed(__file__, "check", out.replace(str(doubtful.parent), "."))
    wrong = arm(tmp_path, low=-180, high=180)
    found = result_of(told(capsys, "check", wrong, "--json", code=2).out)
    assert found["errors"] == 1
    assert found["findings"][0]["if_unit"].startswith("if they are in degrees")
    assert found["findings"][0]["severity"] == "error"


@pytest.mark.parametrize("content", ["", "<sdf/>", "<mujoco/>", "a: 1", "<robot name='r'/>"])
def test_what_is_no_robot_is_one_line(tmp_path, capsys, content):
    file = tmp_path / "robot.urdf"
    file.write_text(content)
    assert "robot.urdf" in refused(capsys, "check", file)


@pytest.mark.parametrize("command", ["inverse", "size", "explain", "replay", "simulate"])
def test_the_warning_of_an_implausible_body_reaches_every_commands_json(
    tmp_path, capsys, monkeypatch, command
):
    monkeypatch.chdir(tmp_path)
    arm(tmp_path, tip=TIP.format(J=J.replace('izz="0.0008"', 'izz="0.9"')))
    (tmp_path / "scene.yaml").write_text(
        "pinfric: 1\nrobot: {urdf: arm.urdf}\nfriction: {swing: {viscous: 0.1}}\n"
        "simulation: {t_end: 0.01}\n"
    )
    rows = "".join(f"{0.1 * i:.1f},{0.01 * i},0\n" for i in range(12))
    (tmp_path / "motion.csv").write_text("t,swing,turn\n" + rows)
    motion = [] if command == "simulate" else ["motion.csv"]
    said = told(capsys, command, "scene.yaml", *motion, "--json")
    assert sum("'tip'" in line for line in said.err.splitlines()) == 1
    assert any("'tip'" in text for text in validated(said.out)["warnings"])
