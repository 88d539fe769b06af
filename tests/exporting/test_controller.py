"""The controller's limits, its written test, how well friction is known."""

import re
import subprocess

import numpy as np
import pytest
from export_cases import (
    assert_columns,
    compiled,
    needs_compiler,
)

import pinfric as pf
from pinfric.errors import PinfricError
from pinfric.exporting.controller import compensation


@pytest.mark.slow
@needs_compiler
def test_the_written_test_agrees_replays_and_notices(tmp_path):
    scene = pf.load_scene("ur10_machine_tending")
    motion = pf.load_trajectory("ur10_machine_tending", scene)
    made = pf.export(scene, motion, "cpp")
    made.write(tmp_path)
    (test,) = tmp_path.glob("*_test.cpp")
    compiled(test, tmp_path / "check", "-O2")
    said = subprocess.run([tmp_path / "check"], capture_output=True, text=True, timeout=60)
    assert said.returncode == 0
    assert said.stdout.count(": agrees") == 6
    motion.to_csv(tmp_path / "motion.csv", digits=17)
    done = subprocess.run(
        [tmp_path / "check", tmp_path / "motion.csv"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    replayed = done.stdout.splitlines()
    assert (
        done.stderr
        == "column payload.blank is not read: nothing is carried here, see add_payload\n"
    )
    rows = np.array([[float(x) for x in line.split(",")] for line in replayed[1:]])
    result = pf.inverse_dynamics(scene, motion.q, motion.v, motion.a)
    assert_columns(rows[:, 3::4], result.motor_torque_lower, "least")
    assert_columns(rows[:, 4::4], result.motor_torque_upper, "greatest")
    for cell in ("abc", "", "1x"):
        lines = (tmp_path / "motion.csv").read_text().splitlines()[:3]
        lines[2] = ",".join([lines[2].split(",")[0], cell, *lines[2].split(",")[2:]])
        (tmp_path / "wrong.csv").write_text("\n".join(lines))
        broken = subprocess.run(
            [tmp_path / "check", tmp_path / "wrong.csv"], capture_output=True, text=True, timeout=60
        )
        assert broken.returncode == 1
        assert "line 3 is no state of the robot" in broken.stderr
    (tmp_path / "motion.csv").write_text("t,elbow_joint\n0,1\n")
    broken = subprocess.run(
        [tmp_path / "check", tmp_path / "motion.csv"], capture_output=True, text=True, timeout=60
    )
    assert broken.returncode == 1
    assert "shoulder_pan_joint is missing" in broken.stderr
    (hpp,) = tmp_path.glob("*.hpp")
    hpp.write_text(hpp.read_text().replace("now.mu * c + now.coulomb[1] - drag", "now.mu * c"))
    compiled(test, tmp_path / "check", "-O2")
    said = subprocess.run([tmp_path / "check"], capture_output=True, text=True, timeout=60)
    assert said.returncode == 1
    assert "DIFFERS" in said.stdout


def test_limits_are_above_what_the_motion_takes():
    scene = pf.load_scene("panda_pick_and_place")
    motion = pf.load_trajectory("panda_pick_and_place.csv", scene)
    text = pf.export(scene, motion, "cpp").text
    limits = [float(x) for x in re.search(r"default_limit\[\] = \{(.*)\};", text)[1].split(",")]
    result = pf.inverse_dynamics(scene, motion)
    lost = [np.abs(compensation(result, end)).max(axis=0) for end in ("lower", "upper")]
    np.testing.assert_allclose(limits, 1.5 * np.max(lost, axis=0), rtol=5e-3)


def identified(folder):
    """A scene of one hinge with a posterior beside it: levels known to 10 %, drag to 30 %."""
    (folder / "arm.urdf").write_text(
        '<robot name="arm"><link name="a"/><link name="b"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="hinge" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    (folder / "scene.yaml").write_text(
        "pinfric: 1\nrobot: {urdf: arm.urdf}\nfriction: {hinge: {coulomb: {static: 3, kinetic: 3}}}"
    )
    draws = 1.0 + 0.1 * np.linspace(-1.0, 1.0, 400)
    lines = ["friction.hinge.coulomb", *(f"{x:.6f}" for x in draws)]
    (folder / "posterior.csv").write_text("\n".join(lines) + "\n")
    return pf.load_scene(folder / "scene.yaml")


def test_an_identified_scene_says_how_far_its_level_is_known(tmp_path):
    made = pf.export(identified(tmp_path), to="cpp")
    assert made.uncertainty["hinge"] == pytest.approx(0.095, abs=1e-4)  # 95 % of +-10 %
    assert "friction known to 9.5%" in made.text
    assert "1/(1+e) = 0.913" in made.text
    (tmp_path / "posterior.csv").rename(tmp_path / "elsewhere.csv")
    scene = pf.load_scene(tmp_path / "scene.yaml")
    assert pf.export(scene, to="cpp").uncertainty == {}
    again = pf.export(scene, to="cpp", posterior=tmp_path / "elsewhere.csv")
    assert again.uncertainty == made.uncertainty
    with pytest.raises(PinfricError, match="are for 'cpp' and 'ros2' only"):
        pf.export(scene, to="mjcf", posterior=tmp_path / "elsewhere.csv")
