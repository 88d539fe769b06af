"""What forward dynamics with friction costs: a call against `pin.aba`, a second of a simulation.

    python -m pytest tests/benchmarks/test_forward.py -n 0 -s

`table.py` measures; here its rows are held to their goals.
"""

from __future__ import annotations

from table import forward, simulation


def test_one_call_against_aba():
    (row,) = forward()
    print("\n", *row.cells(), sep="  ")
    assert row.met


def test_the_paper_s_robot_for_one_second():
    (row,) = simulation()
    print("\n", *row.cells(), sep="  ")
    assert row.met
