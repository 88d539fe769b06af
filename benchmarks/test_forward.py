"""What forward dynamics with friction costs: a call against `pin.aba`, a second of a simulation.

    python -m pytest benchmarks/test_forward.py -n 0 -s

`table.py` measures; here its rows are held to their goals.
"""

from __future__ import annotations

import pytest
from table import at_rest_and_moving, forward, simulation, solver


@pytest.mark.parametrize("measure", [forward, solver, at_rest_and_moving])
def test_goals_are_met(measure):
    rows = measure()
    print(*("  ".join(row.cells()) for row in rows), sep="\n")
    assert all(row.met for row in rows)


def test_the_paper_s_robot_for_one_second():
    (row,) = simulation()
    print("\n", *row.cells(), sep="  ")
    assert row.met
