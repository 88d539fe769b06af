"""How large links are: boxes know distances."""

from __future__ import annotations

import numpy as np

from pinfric.checking.link_extent import Extent


def test_boxes_know_distances():
    box = Extent(np.array([0.0, 0.0, 0.0]), np.array([1.0, 2.0, 2.0]))
    assert box.diagonal == 3.0
    assert box.distance(np.array([0.5, 1.0, 1.0])) == 0.0
    assert box.distance(np.array([4.0, 6.0, 1.0])) == 5.0
    assert box.farthest(np.array([0.0, 0.0, 0.0])) == 3.0
