"""Files of an identification run as they are, and are swept row by row."""

from dataclasses import replace

import numpy as np
import pytest
from identify_cases import (
    NAMES,
    excitation,
    motor_effort,
)

import pinfric as pf
from pinfric.errors import IdentificationError


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


def test_a_scene_without_a_urdf_cannot_be_written(found, tmp_path):
    bare = replace(found, scene=found.scene.with_(robot=None))
    with pytest.raises(IdentificationError, match="has no URDF"):
        bare.save(tmp_path)
