"""Legs' friction from logs with the base's pose and the forces at the feet."""

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from standing_cases import FEET, LEGS, biped, efforts, squat

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.standing import motion_on_chain, on_base, on_chain

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
COULOMB, VISCOUS = 2.0, 0.8
POSE = "/odom/pose/pose/"


def written(folder, scene, seed=1, forces=True, times=1.0):
    """A log of 24 squats in 40 s, its efforts by Pinocchio, friction, and noise of .3 N m.

    `times`: factor on the forces that it holds.
    """
    case, rng = squat(scene, count=5001, seconds=40.0, times=24), np.random.default_rng(seed)
    q, v, a = case.motion.q, case.motion.v, case.motion.a
    legs = efforts(scene.model, q, v, a, case.forces)[:, 6:]
    legs += COULOMB * np.sign(v[:, 6:]) + VISCOUS * v[:, 6:] + 0.3 * rng.normal(size=legs.shape)
    columns = {"t": case.motion.t}
    columns |= {f"{POSE}position/{x}": q[:, k] for k, x in enumerate("xyz")}
    columns |= {f"{POSE}orientation/{x}": q[:, 3 + k] for k, x in enumerate("xyzw")}
    columns |= {name: case.columns[name] for name in LEGS}
    columns |= {f"{name}/effort": effort for name, effort in zip(LEGS, legs.T, strict=True)}
    for foot in FEET if forces else ():
        for k, part in enumerate("xyz"):
            columns[f"/{foot}/wrench/force/{part}"] = times * case.forces[foot][:, k]
            columns[f"/{foot}/wrench/torque/{part}"] = times * case.forces[foot][:, 3 + k]
    pd.DataFrame(columns).to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("standing")
    scene = pf.load_scene(biped(folder, friction="coulomb: 1.0"))
    log = written(folder, scene)
    return scene, log, pf.identify(scene, log)


def test_six_joints_move_as_the_free_base(tmp_path):
    """Efforts of the legs are those of the free base; of the six, what the forces leave of it."""
    scene = pf.load_scene(biped(tmp_path))
    model = scene.model.copy()
    model.armature = np.r_[np.zeros(6), 0.1 * np.arange(1.0, 7.0)]
    scene = scene.with_(model=model)
    motion = squat(scene).motion
    tilted = motion.q.copy()
    turn = pin.Quaternion(pin.rpy.rpyToMatrix(0.3, -0.4, 0.0)).coeffs()
    tilted[:, 3:7] = turn
    for moved in (
        motion,
        pf.Trajectory.from_arrays(
            scene, motion.t, tilted, motion.v, motion.a, external=motion.external
        ),
    ):
        chain = on_chain(scene)
        there = motion_on_chain(moved, scene)
        by_chain = pf.inverse_dynamics(chain, there).effort_frictionless[:, 6:]
        expected = efforts(scene.model, moved.q, moved.v, moved.a, moved.external)[:, 6:]
        np.testing.assert_allclose(by_chain, expected, atol=1e-9)
    back = on_base(chain, scene)
    assert back.model == scene.model
    assert [drive.name for drive in back.drives] == [drive.name for drive in scene.drives]


def test_friction_of_legs_is_inside_its_intervals(case):
    _, _, found = case
    inside = [
        p.low <= (VISCOUS if p.name == "viscous" else COULOMB) <= p.high
        for p in found.parameters
        if p.name == "viscous" or p.name.startswith("coulomb")
    ]
    assert len(inside) == 18
    assert sum(inside) >= 16
    for p in found.parameters:
        if p.name.startswith("coulomb"):
            assert p.value == pytest.approx(COULOMB, rel=0.03)
    assert found.doubts == ()
    assert set(found.laws) == set(LEGS)
    assert not any("root_joint" in note for note in found.notes)


def test_what_is_written_stands_again(case, tmp_path):
    """The file has the free base, and its efforts along the log are the measured ones."""
    scene, log, found = case
    files = found.save(tmp_path)
    assert "advice.waypoints.yaml" not in [file.name for file in files]
    text = (tmp_path / "scene.yaml").read_text()
    assert "floating: true" in text
    assert "root_joint" not in text
    there = pf.load_scene(tmp_path / "scene.yaml")
    assert list(there.joint_names) == list(scene.joint_names)
    motion = pf.load_trajectory(log, there)
    result = pf.inverse_dynamics(there, motion)
    for i, name in enumerate(LEGS):
        off = motion.reading.effort[name] - result.effort_upper[:, i]
        moves = np.abs(motion.v[:, 6 + i]) > 0.1
        assert np.sqrt(np.mean(off[moves] ** 2)) < 0.35


def test_forces_are_needed(case, tmp_path):
    scene, _, _ = case
    with pytest.raises(IdentificationError, match="no forces at the feet: without them each"):
        pf.identify(scene, written(tmp_path, scene, forces=False))


def test_forces_that_do_not_balance_the_base_are_doubted_or_refused(case, tmp_path):
    """As `inverse` says: a fifth too low, and with the other sign."""
    scene, _, _ = case
    found = pf.identify(scene, written(tmp_path, scene, times=0.8))
    (line,) = [line for line in found.doubts if "do not balance the motion" in line]
    assert "they leave 20 % of the weight" in line
    with pytest.raises(IdentificationError, match="with the other sign, as forces of the ground"):
        pf.identify(scene, written(tmp_path, scene, times=-1.0))
