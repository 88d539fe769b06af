"""`pinfric check` as a shell sees it."""

from __future__ import annotations

import pytest
from check_cases import TIP, J, arm
from envelopes import result_of, validated

from pinfric import cli


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as left:
        cli.main(["check", *map(str, arguments)])
    said = capsys.readouterr()
    return left.value.code, said.out, said.err


def test_exit_codes_and_json(tmp_path, capsys):
    good = arm(tmp_path)
    assert run(capsys, good, "--strict")[0] == 0
    doubtful = arm(tmp_path, low=0, high=0)
    assert run(capsys, doubtful)[0] == 0
    code, out, err = run(capsys, doubtful, "--strict")
    assert (code, len(err.splitlines())) == (2, 1)
    assert "joint swing: limits 0 to 0" in err
    assert "1 warning" in out
    wrong = arm(tmp_path, low=-180, high=180)
    code, out, err = run(capsys, wrong, "--json")
    assert code == 2
    found = result_of(out)
    assert found["errors"] == 1
    assert found["findings"][0]["if_unit"].startswith("if they are in degrees")
    assert found["findings"][0]["severity"] == "error"


@pytest.mark.parametrize("content", ["", "<sdf/>", "<mujoco/>", "a: 1", "<robot name='r'/>"])
def test_what_is_no_robot_is_one_line(tmp_path, capsys, content):
    file = tmp_path / "robot.urdf"
    file.write_text(content)
    code, out, err = run(capsys, file)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "robot.urdf" in err


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
    with pytest.raises(SystemExit) as left:
        cli.main([command, "scene.yaml", *motion, "--json"])
    said = capsys.readouterr()
    assert left.value.code == 0
    assert sum("'tip'" in line for line in said.err.splitlines()) == 1
    assert any("'tip'" in text for text in validated(said.out)["warnings"])
