from functools import cache

import pytest
from builders import example
from exporting.conftest import headers, ur5
from identification.conftest import found
from retiming.conftest import files
from sweep_cases import swept_panda

import pinfric as pf

__all__ = ["files", "found", "headers", "ur5"]


@pytest.fixture
def panda():
    return swept_panda()


@cache
def elastic_door():
    scene, motion = example("ur10_machine_tending")
    return pf.elasticity(pf.inverse_dynamics(scene, motion))


@pytest.fixture
def door():
    return elastic_door()
