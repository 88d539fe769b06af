"""Reactions and reversals of samples."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import block, plane_friction, sliding_block
from mechanisms import shifted

import pinfric as pf
from pinfric.dynamics.samples.reversals import reversals

# Reactions: wrenches at joints and links by name.


def test_a_tool_wrench_loads_the_bearings_too():
    model = block(mass=2.0)
    model.addFrame(pin.Frame("table", 1, pin.SE3.Identity(), pin.FrameType.BODY))
    scene = pf.Scene(model=model, friction={"slide": plane_friction(0.5, 0.5)})
    # pressed down by 100 N and pulled back by 7 N
    tool = np.array([-7.0, 0.0, -100.0, 0.0, 0.0, 0.0])
    result = pf.inverse_dynamics(scene, [[0.0]], [[1.0]], [[0.0]], {"table": tool})
    assert result.effort_upper[0, 0] == pytest.approx(7.0 + 0.5 * (2.0 * 9.81 + 100.0))


def test_a_link_with_a_joints_name_is_the_link():
    model = block(mass=2.0)
    model.addFrame(pin.Frame("slide", 1, pin.SE3.Identity(), pin.FrameType.JOINT))
    lifted = shifted(0.0, 0.5)
    model.addFrame(pin.Frame("slide", 1, lifted, pin.FrameType.BODY))
    scene = pf.Scene(model=model)
    push = np.array([10.0, 0, 0, 0, 0, 0])
    wrench = pf.joint_wrenches(scene, [[0.0]], [[0.0]], [[0.0]], {"slide": push})
    assert wrench[0, 0, 4] == pytest.approx(-10.0 * 0.5)
    bare = pf.joint_wrenches(sliding_block(), [[0.0]], [[0.0]], [[0.0]], {"slide": push})
    assert bare[0, 0, 0] == pytest.approx(-10.0)


# Reversals: reversals between samples, also between the parts of two threads.


def test_a_reversal_between_two_threads_parts_is_seen_once():
    """Four parts of two samples: the sign changes at every border, and each time slower behind."""
    velocity = np.array([3.0, 2.0, -1.0, -2.0, 1.0, 2.0, -1.0, -2.0])[:, None]
    expected = [False, False, True, False, True, False, True, False]
    for threads in (1, 2, 3, 4):
        found = reversals(velocity, np.zeros(1), threads)
        assert found[:, 0].tolist() == expected, threads
