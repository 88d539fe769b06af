"""Open ports of pinfric: who reaches one from another machine is not a user.

The kernel's own tables are read (`ss` is not everywhere), for this process and all its descendants.
"""

import os

import pytest
from builders import example
from processes import listening, workers

import pinfric as pf

pytestmark = pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning")


def test_a_sweep_on_two_processes_opens_no_port():
    scene, trajectory = example("panda_pick_and_place", "panda_pick_and_place.csv")
    sweep = {
        "pinfric_sweep": 1,
        "samples": 8,
        "seed": 1,
        "parameters": {"friction.*.mu": {"lognormal": {"median": 1.0, "sigma": 0.3}}},
    }
    before, seen, working = listening(os.getpid()), set(), set()

    def look(done, total):
        seen.update(listening(os.getpid()))
        working.update(workers(os.getpid()))

    pf.sweep(scene, trajectory, sweep, processes=2, progress=look)
    assert len(working) == 2
    assert seen == before
