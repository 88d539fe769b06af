"""What several files of this folder use."""

import numpy as np
import pytest

from pinfric.kernels import interpreted


@pytest.fixture
def interpreted_kernels(monkeypatch):
    """For tuples of arrays they would be compiled anew, 30 s: forward dynamics takes records.

    That both forms agree is tested in `dynamics/problem/test_instant.py`.
    """
    monkeypatch.setattr(interpreted, "PATIENCE", np.inf)
