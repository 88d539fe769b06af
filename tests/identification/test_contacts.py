"""A robot that was touched for a while."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from identify_cases import (
    count_goes_on,
    excitation,
    fit_of,
    guess,
    logged,
    motor_effort,
    prepared_of,
    rows_of,
    truth,
)

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
    told = list[tuple[int, int]]()
    with_push = pf.identify(
        guess(90), logged(90, motion, effort), progress=lambda *step: told.append(step)
    )
    (said,) = (line for line in with_push.doubts if "as of a contact" in line)
    assert with_push.doubts == (said,)
    (one,) = with_push.estimate.question.contacts
    count_goes_on(told)
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


@pytest.mark.parametrize(("samples", "named"), [(2, False), (3, False), (6, True)])
def test_only_what_lasts_is_a_contact(samples, named):
    """Ten samples a second: from 0.3 s on."""
    v = np.ones(100)
    log = prepared_of(v, {})
    left = np.where(np.arange(100) % 2 == 0, 1.0, -1.0)
    left[40 : 40 + samples] = 30.0
    rows = rows_of(left, {}, log=np.zeros(100, dtype=int))
    found = contacts([log], [rows], fit_of({}))
    assert [(x.log, x.joint, x.effort) for x in found] == [(0, 0, 30.0)] * named
    if named:
        assert 4.0 <= found[0].start < found[0].end <= 4.5
