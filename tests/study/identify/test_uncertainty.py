"""What logs say of each other's friction, against figures worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pinfric.study.identify.columns import Rows
from pinfric.study.identify.laws import FORWARD, SLOT, SLOTS
from pinfric.study.identify.normal import Fit
from pinfric.study.identify.uncertainty import between_logs


@pytest.mark.parametrize(
    ("factors", "spread"),
    [
        # means 1.0 and 1.2, variance 0.02; blocks: variance 0.02 over 2 each, 0.01 taken off
        ([[1.1, 0.9], [1.3, 1.1]], 0.1),
        ([[1.0, 1.0], [1.2, 1.2]], np.sqrt(0.02)),
        ([[1.3, 0.7], [1.2, 0.8]], 0.0),
    ],
)
def test_what_blocks_of_one_log_scatter_is_no_difference_between_logs(factors, spread):
    """One joint with 2 N m of Coulomb friction, ten rows in each block."""
    factor = np.repeat(np.ravel(factors), 10)
    slots = np.zeros((40, len(SLOTS)))
    slots[:, SLOT[FORWARD]] = 1.0
    still = np.zeros(40)
    rows = Rows(np.zeros((40, 10)), slots, 2.0 * factor, np.repeat(np.arange(4), 10),
                np.repeat([0, 1], 20), still, still, still)  # fmt: skip
    fit = Fit(np.zeros(10), 2.0 * (np.arange(len(SLOTS)) == SLOT[FORWARD])[None, :])
    found = SimpleNamespace(prepared=[None, None], rows=[rows], fit=fit)
    assert between_logs(found) == pytest.approx([spread], abs=1e-9)
