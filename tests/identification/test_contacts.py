"""A robot that was touched for a while."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
from identify_cases import excitation, guess, logged, motor_effort, truth

import pinfric as pf
from pinfric.identification.contacts import contacts


def test_a_push_is_named_with_its_time_and_left_out(found):
    true, motion = truth(), excitation(90, 30.0, 125.0)
    effort, pushed = (
        motor_effort(true, motion),
        np.flatnonzero((motion.t > 12.0) & (motion.t < 14.0)),
    )
    data, wrist = true.model.createData(), true.model.njoints - 1
    for i in pushed:
        J = pin.computeJointJacobian(true.model, data, motion.q[i], wrist)
        effort[i] += J.T @ np.array([30.0, 20.0, 30.0, 0.0, 0.0, 0.0])
    with_push = pf.identify(guess(90), logged(90, motion, effort))
    (said,) = (line for line in with_push.doubts if "as of a contact" in line)
    assert with_push.doubts == (said,)
    (one,) = with_push.estimate.question.contacts
    assert abs(one.start - 12.0) < 0.15
    assert abs(one.end - 14.0) < 0.15
    # as if it had not been: the same log, its efforts missing
    lacks = logged(90, motion, effort)
    measured = np.array(lacks.effort)
    measured[(motion.t > one.start - 0.25) & (motion.t < one.end + 0.25)] = np.nan
    without = pf.identify(guess(90), replace(lacks, effort=measured))
    assert without.estimate.question.contacts == ()
    for a, b in zip(with_push.parameters, without.parameters, strict=True):
        assert a.key == b.key
        assert abs(a.value - b.value) < 0.1 * max(a.standard_error, 1e-3 * abs(a.value)), a.key
    assert contacts(found.estimate.prepared, found.estimate.rows, found.estimate.fit) == ()
