"""`explain`: changes by hand, costs that are figures, and the command."""

from __future__ import annotations

import json

import numpy as np
import pytest
from builders import block

import pinfric as pf
from pinfric.cli import main
from pinfric.study.explain import explain
from pinfric.study.trajectory.trajectory import Trajectory


def test_changes_are_those_of_the_drive_by_hand():
    friction = {"slide": {"coulomb": {"static": 3.0, "kinetic": 3.0}, "viscous": 2.0}}
    scene = pf.Scene(model=block(mass=2.0), friction=friction)
    t = np.linspace(0.0, 1.0, 101)
    v = np.full((101, 1), 0.5)
    motion = Trajectory.from_arrays(scene, t, 0.5 * t[:, None], v, np.zeros((101, 1)))
    found = {e.name: e for e in explain(scene, motion).effects}
    assert found["coulomb"].peak_change == pytest.approx(3.0)
    assert found["coulomb"].rms_change == pytest.approx(3.0)
    assert found["viscous"].peak_change == pytest.approx(1.0)
    assert found["viscous"].drive == "slide"
    assert not found["load"].on
    assert np.isnan(found["load"].cost_us)


def test_the_command_prints_what_it_measured(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["explain", "three_link", "three_link.waypoints.yaml", "--json"])
    assert stop.value.code == 0
    answer = json.loads(capsys.readouterr().out)
    load = next(e for e in answer["effects"] if e["name"] == "load")
    assert load["on"]
    assert load["why"] == "friction.joint_12.bearing"
    assert load["peak_change"] > 0
    assert answer["total_us"] > 0  # not compared: a busy machine turns timings around
    assert answer["plain_us"] > 0
    off = next(e for e in answer["effects"] if e["name"] == "payload")
    assert off["cost_us"] is None
    with pytest.raises(SystemExit):
        main(["explain", "three_link"])
    assert "friction.joint_12.bearing" in capsys.readouterr().out
