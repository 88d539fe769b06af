import numpy as np
import pytest

from pinfric.kernels import interpreted


@pytest.fixture
def interpreted_kernels(monkeypatch):
    """Interpret kernels: tuples of arrays would compile them anew (30 s).

    Forward dynamics has records; `dynamics/problem/test_instant.py` tests that both agree.
    """
    monkeypatch.setattr(interpreted, "PATIENCE", np.inf)
