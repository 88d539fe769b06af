"""The paper's examples: their initial states and what cannot be an input."""

from __future__ import annotations

import numpy as np

from pinfric.paper.equations import (
    body_speeds,
    place,
    relative_jacobian,
)
from pinfric.paper.examples import pendulum, three_link


def test_initial_state_is_the_papers_tables():
    case = three_link()
    q = place(case.mechanism, case.position[None])
    speed = body_speeds(relative_jacobian(case.mechanism, q), case.rate[None]).reshape(3, 6)
    table = [[-0.2, 0, 0, 0, 0, 1], [-0.4, -0.25, 0, -1, 0, 1], [-0.4, -0.35, -0.15, -1, 1, 1]]
    np.testing.assert_allclose(speed, table, atol=1e-15)
    np.testing.assert_array_equal(q.euler_parameters[0], np.tile([0, 0, 0, 1.0], (4, 1)))
    case = pendulum()
    q = place(case.mechanism, case.position[None])
    speed = body_speeds(relative_jacobian(case.mechanism, q), case.rate[None])[0]
    np.testing.assert_allclose(q.position[0, 0, :2], [0.217, 0.125], atol=6e-4)  # as printed
    np.testing.assert_allclose(speed[[0, 1, 5]], [-0.125, 0.217, 1.0], atol=6e-4)
