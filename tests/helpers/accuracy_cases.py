from functools import cache

import pytest

import pinfric as pf
from pinfric.accuracy import study

_FEW_STEPS = (50, 500)


def of(runs, method):
    return [run for run in runs if run.method == method]


@cache
def studied_pendulum():
    """The whole study of the paper's pendulum; of the slow methods two settings each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "STEPS", _FEW_STEPS)
        patch.setattr(study, "VELOCITIES", (1e-1, 1e-2))
        return study.accuracy(pf.load_scene("pendulum"), rounds=1)
