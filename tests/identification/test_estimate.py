"""Estimates at the ends of what is possible."""

from dataclasses import replace

import numpy as np

from pinfric.identification.estimate import _at_an_end
from pinfric.identification.laws import SLOT, SLOTS, Law


def test_of_two_losses_one_that_is_zero_is_the_end_of_the_masses_scale(found):
    """Masses larger by 1/eta leave a gear without loss driving: then one loss is taken."""
    one, two = Law(load="gear"), Law(load="gear", both_ways=False)
    driving, driven = SLOT["gear driving, joint side"], SLOT["gear driven, joint side"]
    slots = np.zeros((4, len(SLOTS)))
    slots[[0, 2], driven], slots[1, [driving, driven]] = 0.1, (0.05, 0.1)
    choice = replace(found.estimate.choice, laws=(two, two, two, one))
    problem = replace(found.estimate.problem, laws=((one, two), (one, two), (two,), (one, two)))
    fit = replace(found.estimate.fit, slots=slots)
    assert _at_an_end(problem, choice, fit) == [0]  # the third was asked for
