"""Files of an identification run as they are, and can be swept row by row."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from cli_cases import URDF, WAY, results_in, run
from identify_cases import (
    NAMES,
    PLAIN,
    RATIO,
    excitation,
    guess,
    motor_effort,
    short,
)

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.laws import Law
from pinfric.model.robot import Robot, example_robot_data
from pinfric.model.scene_text import robot_with_bodies
from pinfric.model.urdf import mesh_file


def test_the_files_run_as_they_are(found, tmp_path):
    scene = replace(found, scene=found.scene.with_(robot=pf.load_scene("ur5_pick_and_place").robot))
    scene.save(tmp_path)
    read = pf.load_scene(tmp_path / "scene.yaml")
    motion = excitation(98, 2.0, 100.0)
    assert motor_effort(read, motion) == pytest.approx(motor_effort(found.scene, motion), abs=1e-5)
    text = (tmp_path / "scene.yaml").read_text()
    viscous = found.scene.friction[NAMES[0]].viscous.coefficient
    assert f"viscous: {viscous:.10g} #" in text
    header, *rows = (tmp_path / "posterior.csv").read_text().splitlines()
    assert f"friction.{NAMES[1]}.coulomb.positive" in header.split(",")
    assert len(rows) >= 200


@pytest.mark.slow
def test_a_folder_has_the_files_of_its_last_run_only(tmp_path, monkeypatch):
    """`--inertia keep` writes no robot: that of an earlier run would stand beside its scene."""
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(URDF)
    Path("arm.yaml").write_text("pinfric: 1\nrobot: {urdf: arm.urdf}\n")
    t, terms = np.arange(0.0, 16.0, 0.02), np.array([0.7, 1.3, 2.1])
    angles = np.outer(t, terms) + np.arange(3)
    q, v = 0.4 * np.sin(angles).sum(axis=1), 0.4 * np.cos(angles) @ terms
    a, mass = -0.4 * np.sin(angles) @ terms**2, 2.2
    effort = (0.1 + 0.25 * mass) * a - 0.5 * 9.81 * mass * np.cos(q) + 1.5 * np.sign(v) + 0.4 * v
    rows = np.column_stack((t, q, effort))
    np.savetxt("log.csv", rows, "%.9g", ",", header="t,shoulder,shoulder/effort", comments="")
    assert run("identify", "arm.yaml", "log.csv", "--out", "found") == 0
    assert "robot.urdf" in results_in("found")
    assert run("identify", "arm.yaml", "log.csv", "--inertia", "keep", "--out", "found") == 0
    assert "robot.urdf" not in results_in("found")
    assert run("inverse", "found/scene.yaml", "log.csv", "--out", "again") == 0
    assert "measured.png" in results_in("again")
    Path("way.yaml").write_text(WAY)
    assert run("inverse", "found/scene.yaml", "way.yaml", "--out", "again") == 0
    assert "measured.png" not in results_in("again")


def test_the_posterior_is_swept_row_by_row(found, tmp_path):
    scene = replace(found, scene=found.scene.with_(robot=pf.load_scene("ur5_pick_and_place").robot))
    scene.save(tmp_path)
    motion = excitation(98, 1.0, 50.0)
    cycle = pf.Trajectory.from_arrays(found.scene, motion.t, motion.q, motion.v, motion.a)
    swept = pf.sweep(found.scene, cycle, tmp_path / "sweep.yaml", processes=1)
    assert np.isfinite(swept.figures).all()
    rows = np.loadtxt(tmp_path / "posterior.csv", delimiter=",", skiprows=1)
    for sample in swept.values:  # whole rows: what belongs together stays together
        assert (np.abs(rows - sample) < 1e-12).all(axis=1).any()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*hysteresis")
def test_what_no_log_tells_of_a_drive_stays_in_the_scene(tmp_path):
    """Before, the scene that was written had lost all of these."""
    stiffness, brake = {"k1": 3e4, "k2": 5e4, "k3": 6e4, "t1": 14.0, "t2": 48.0}, {"torque": 3.0}
    kept = {"stiffness": stiffness, "hysteresis": 1e-4, "momentary_peak": 500.0}
    kept |= {"brake": brake | {"engage_time": 0.02}}
    actuators = [
        {"joint": name, "name": f"{name}_drive", "encoder": "joint"}
        | {"transmission": kept | {"ratio": RATIO, "motor_viscous": 9.0}}
        for name in NAMES
    ]
    stops = {
        "category": 1,
        "reaction_time": 0.02,
        "deceleration": {f"{name}_drive": 9.0 for name in NAMES},
    }
    robot = pf.load_scene("ur5_pick_and_place").robot
    scene = guess(0).with_(actuators=actuators, stops=stops, robot=robot)
    laws = PLAIN | {NAMES[1]: Law(load="gear")}
    for at in ("reflected", "joint"):
        taken = laws if at == "reflected" else PLAIN
        found = pf.identify(scene, short(), laws=taken, effort_at=at, inertia="keep")
        found.save(tmp_path)
        read = pf.load_scene(tmp_path / "scene.yaml")
        assert read.stops == scene.stops
        for before, after, ours in zip(
            scene.actuators, read.actuators, found.scene.actuators, strict=True
        ):
            assert (after.name, after.encoder) == (before.name, "joint")
            assert after == ours
            for key in ("ratio", *kept):
                assert getattr(after.transmission, key) == getattr(before.transmission, key)
            drag = after.transmission.motor_viscous  # the joint's friction holds it
            assert (drag is None) == (at == "reflected")


def test_a_written_robot_has_the_inertias_found_and_finds_its_meshes_from_anywhere(tmp_path):
    bundled = "package://ur_description/meshes/ur5/visual/base.dae"
    (tmp_path / "own").mkdir()
    for name in ("part.stl", "own/part.stl"):
        (tmp_path / name).touch()
    names = "part.stl", "package://own/part.stl", bundled
    visuals = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>' for name in names
    )
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(
        f'<robot name="r"><link name="base">{visuals}</link><link name="arm"/><link name="tip"/>'
        '<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/></joint>'
        '<joint name="weld" type="fixed"><parent link="arm"/><child link="tip"/></joint></robot>'
    )
    model = pin.buildModelFromUrdf(str(urdf))
    model.inertias[1] = pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.diag([0.04, 0.05, 0.06]))
    text = robot_with_bodies(Robot(model, urdf, (tmp_path, example_robot_data()), {}, {}), model)
    assert pin.buildModelFromXML(text).inertias[1].isApprox(model.inertias[1])
    written = re.findall('mesh filename="(.*)"', text)
    assert written[2] == bundled
    assert all(mesh_file(name, tmp_path / "other" / "robot.urdf", ()) for name in written[:2])


def test_a_scene_without_a_urdf_cannot_be_written(found, tmp_path):
    bare = replace(found, scene=found.scene.with_(robot=None))
    with pytest.raises(IdentificationError, match="has no URDF"):
        bare.save(tmp_path)
