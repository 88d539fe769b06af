"""What `retime` writes is judged: limits kept exactly, and never slower than a given motion."""

import numpy as np
import pytest
from retime_cases import MOTORS, STOPS, planar

import pinfric as pf
from pinfric.retiming.problem import usage
from pinfric.retiming.retime import retime


@pytest.mark.parametrize("part", [None, 0.6])
def test_a_motion_read_back_is_within_all_limits_that_were_stated(tmp_path, part):
    """Inverse dynamics of the same scene, along the file that is written."""
    scene = planar()
    limits = {
        name: entry if part is None else entry | {"continuous_torque": part * entry["peak_torque"]}
        for name, entry in MOTORS.items()
    }
    found = retime(scene, STOPS, limits)
    assert found.excess == 0.0
    found.trajectory.to_csv(tmp_path / "t.csv")
    read = pf.inverse_dynamics(scene, pf.load_trajectory(tmp_path / "t.csv", scene))
    moving = (read.states.v != 0.0).any(axis=1)
    assert usage(read, found.problem.limits)[moving].max() <= 1.0
    if part is not None:
        worst = np.maximum(np.abs(read.motor_torque_lower), np.abs(read.motor_torque_upper))
        mean = np.sqrt(np.trapezoid(worst**2, read.times, axis=0) / read.times[-1])
        assert (mean / [entry["continuous_torque"] for entry in limits.values()]).max() <= 1.0


def test_a_given_motion_that_is_possible_is_the_slowest_answer():
    """A drive that uses all its continuous torque in the given time is not refused."""
    scene = planar()
    slow = retime(
        scene, STOPS, {n: x | {"peak_torque": 0.8 * x["peak_torque"]} for n, x in MOTORS.items()}
    )
    motion = slow.trajectory.with_speed(0.9)
    result = pf.inverse_dynamics(scene, motion)
    worst = np.maximum(np.abs(result.motor_torque_lower), np.abs(result.motor_torque_upper))
    used = np.sqrt(np.trapezoid(worst**2, result.times, axis=0) / motion.duration)
    limits = {
        name: entry | {"continuous_torque": 1.0001 * float(mean)}
        for (name, entry), mean in zip(MOTORS.items(), used, strict=True)
    }
    found = retime(scene, motion, limits)
    assert found.before == pytest.approx(motion.duration)
    assert found.duration <= motion.duration
    assert found.excess == 0.0
    assert found.rms.max() <= 1.0
