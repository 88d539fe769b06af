"""Files of an identification run as they are, and are swept row by row."""

from dataclasses import replace

import numpy as np
import pytest
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


def test_a_scene_without_a_urdf_cannot_be_written(found, tmp_path):
    bare = replace(found, scene=found.scene.with_(robot=None))
    with pytest.raises(IdentificationError, match="has no URDF"):
        bare.save(tmp_path)
