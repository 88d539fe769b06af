"""The scan against an optimizer, and between its points."""

from dataclasses import replace

import numpy as np
import pytest
from retime_cases import MOTORS, WAVE, planar
from scipy.optimize import minimize

import pinfric as pf
from pinfric.motions.joint_columns import joint_columns
from pinfric.retiming.limits import read_limits
from pinfric.retiming.problem import Policy
from pinfric.retiming.retime import _Retiming, retime
from pinfric.retiming.tables import natural_points


def test_within_every_limit_between_the_points_too():
    found = retime(planar(), WAVE, MOTORS, points=300)
    assert 0.9 < found.usage.max() < 1.0 + 1e-3
    assert found.excess < 1e-3
    assert found.profile.holes == 0
    finest = retime(planar(), WAVE, MOTORS, points=1600)
    assert found.duration == pytest.approx(finest.duration, rel=3e-3)


def test_no_other_profile_is_faster():
    """SLSQP on the squares of the speeds, judged by `inverse_dynamics`, on the same coarse grid."""
    scene, natural = planar(), natural_points(WAVE.pieces[0], np.eye(2))
    s = np.union1d(np.linspace(0.0, 3.0, 10), natural)
    run = _Retiming(scene, WAVE, joint_columns(scene.model), read_limits(scene, MOTORS), Policy())
    run.constant = [(0, 0.0, 3.0)]
    problem = run.problem([s])
    # this search knows friction against the motion only: nor at the start both signs
    problem = replace(problem, mode=np.zeros_like(problem.mode))
    best = problem.solve()
    step, curve = np.diff(s), WAVE.pieces[0]
    sliding = scene.with_(stick_velocity=1e-12)

    def duration(x):
        z = np.sqrt(np.concatenate(([0.0], x, [0.0])))
        return 2.0 * (step / (z[1:] + z[:-1])).sum()

    def spare(x):
        """The rest of each limit just inside both ends of every interval."""
        full = np.maximum(np.concatenate(([0.0], x, [0.0])), 0.0)
        u = np.diff(full) / (2.0 * step)
        at = np.concatenate((s[:-1] + 1e-6, s[1:] - 1e-6))
        xs = np.concatenate((full[:-1], full[1:])) + 1e-6
        us = np.concatenate((u, u))
        v = curve(at, 1) * np.sqrt(xs)[:, None]
        a = curve(at, 1) * us[:, None] + curve(at, 2) * xs[:, None]
        found = pf.inverse_dynamics(sliding, curve(at), v, a)
        torque = np.maximum(np.abs(found.motor_torque_lower), np.abs(found.motor_torque_upper))
        return (1.0 - torque / [0.32, 0.12]).ravel()

    def slope(x):
        """Of `spare`: an interval depends on the speeds at its two ends, so three steps suffice."""
        rows = np.repeat(np.tile(np.arange(len(step)), 2), 2)
        base, found = spare(x), np.zeros((len(rows), len(x)))
        for k in range(3):
            moved = x.copy()
            moved[k::3] += 1e-6
            change = (spare(moved) - base) / 1e-6
            for near in (rows - 1, rows):
                mine = (near % 3 == k) & (near >= 0) & (near < len(x))
                found[mine, near[mine]] = change[mine]
        return found

    assert spare(best.x[1:-1]).min() > -1e-4
    found = minimize(
        duration,
        best.scaled(0.7).x[1:-1],
        method="SLSQP",
        bounds=[(1e-4, None)] * (len(s) - 2),
        constraints={"type": "ineq", "fun": spare, "jac": slope},
        options={"maxiter": 400, "ftol": 1e-8},
    )
    assert found.fun == pytest.approx(best.duration[0], rel=2e-3)
