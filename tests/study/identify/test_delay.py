"""Delay of logged efforts behind the motion."""

from __future__ import annotations

import numpy as np
import pytest

from pinfric.study.identify.delay import Delay, LogDelay, common_delay, disagreement, other_delays


def test_logs_that_differ_in_their_delay_by_more_than_they_know_leave_it_open():
    near = common_delay([LogDelay(0.0040, 1e-3), LogDelay(0.0050, 1e-3)])
    assert near.value == pytest.approx(0.0045)
    assert near.standard_error == pytest.approx(1e-3 / np.sqrt(2))
    far = common_delay([LogDelay(0.0, 1e-3), LogDelay(0.010, 1e-3)])
    assert far.standard_error == pytest.approx(0.010 / 2)  # of the two values' own mean
    assert (far.value, far.determined) == (0.0, False)


def test_a_search_that_ends_at_its_bound_determines_no_delay():
    """Before, it was printed as -30 +- 20 ms."""
    alone = common_delay([LogDelay(-0.03, np.inf)])
    assert (alone.value, alone.determined) == (0.0, False)
    both = common_delay([LogDelay(-0.03, np.inf), LogDelay(0.004, 1e-3)])
    assert (both.value, both.standard_error) == (0.004, 1e-3)


def test_a_delay_of_its_own_is_named():
    alike = {0: (0.004, 1e-3), 1: (0.005, 1e-3), 2: (0.003, 2e-3)}
    assert other_delays(Delay(0.004, 1e-3, (), alike)) == {}
    apart = alike | {3: (-0.014, 1e-3)}
    assert 3 in other_delays(Delay(0.004, 1e-3, (), apart))


def test_a_delay_that_joints_do_not_agree_on_is_less_certain():
    alike = [(0.004, 1e-3), (0.005, 1e-3), (0.003, 2e-3)]
    assert disagreement(0.0042, alike) == 1.0
    # what position-dependent friction did: each joint is sure of another delay
    apart = [(-0.03, 1e-3), (-0.014, 1.5e-3), (0.006, 1e-3), (0.002, 1e-3)]
    assert 1.5e-3 * disagreement(-0.0144, apart) > 2.5e-3  # then it is not determined
    # a joint that knows little has little to say
    assert disagreement(0.0042, [*alike, (0.05, 1e-2)]) == 1.0
