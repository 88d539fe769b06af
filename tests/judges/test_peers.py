"""MuJoCo and Drake as contestants: the benchmark's adapters simulate the same robot."""

import dataclasses

import peers
import pytest
from accuracy_cases import of

import pinfric as pf
from pinfric.accuracy import study
from pinfric.errors import PinfricError
from pinfric.model.schema import Simulation


def test_a_peer_that_is_not_there_is_one_line(monkeypatch):
    monkeypatch.setattr(peers, "find_spec", lambda name: None)
    monkeypatch.setattr(study, "STEPS", (50,))
    monkeypatch.setattr(study, "TOLERANCES", (1e-4,))
    runs, missing = peers.compete_with_peers(pf.load_scene("pendulum"), {"joint_1": 0.3}, rounds=1)
    assert {run.method for run in runs} == {"event", "timestepping"}
    assert missing == [
        'MuJoCo: not installed; pip install "pinfric[bench]" brings it',
        'Drake: not installed; pip install "pinfric[bench]" brings it',
    ]


def test_peers_converge_to_the_same_motion(monkeypatch):
    pytest.importorskip("mujoco")
    pytest.importorskip("pydrake")
    monkeypatch.setattr(study, "STEPS", (500,))
    monkeypatch.setattr(study, "TOLERANCES", (1e-4, 1e-8))
    monkeypatch.setattr(peers, "STEPS", (400, 6400))
    monkeypatch.setattr(peers, "VELOCITIES", (1e-2, 1e-4))
    scene = pf.load_scene("three_link")  # its constant: what the paper's pin has on average
    runs, missing = peers.compete_with_peers(scene, {"joint_12": 9.0}, rounds=1)
    assert not missing
    for method in ("MuJoCo, stiff", "Drake"):
        coarse, fine = of(runs, method)
        assert not fine.problem
        assert fine.error < 0.1 * coarse.error
        assert fine.error < 5e-3
        assert fine.missed == 0
    plain, finest = of(runs, "MuJoCo")
    assert finest.error < plain.error
    assert of(runs, "event")[1].error < 1e-6


def test_loops_are_not_handed_to_peers():
    base = pf.load_scene("four_bar")
    scene = dataclasses.replace(base, simulation=Simulation(start=base.simulation.start, t_end=1.0))
    with pytest.raises(PinfricError, match="loops"):
        peers.compete_with_peers(scene, {"crank_pin": 0.1})
