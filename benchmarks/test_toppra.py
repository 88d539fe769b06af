"""`retime` beside toppra: the same answer without friction, and the times of both."""

from __future__ import annotations

import numpy as np
import pytest
from measure import median_seconds

import pinfric as pf  # measure first: it sets how kernels are compiled
from pinfric.model.effects import with_effects
from pinfric.motions.joint_columns import joint_columns
from pinfric.retiming.limits import read_limits
from pinfric.retiming.path import Path
from pinfric.retiming.problem import Policy
from pinfric.retiming.retime import _Retiming

toppra = pytest.importorskip("toppra")
POINTS = 1001
LARGE = {"peak_torque": 0.9, "stall_torque": 2.2, "no_load_speed": 330.0, "max_speed": 300.0}
SMALL = {"peak_torque": 0.2, "stall_torque": 0.5, "no_load_speed": 420.0, "max_speed": 400.0}


def case(name, seed):
    """A scene and a random spline within half of its joints' ranges."""
    scene = pf.load_scene(name)
    low, high = scene.model.lowerPositionLimit, scene.model.upperPositionLimit
    way = np.random.default_rng(seed).uniform(-1, 1, (6, scene.model.nq))
    return scene, 0.5 * (low + high) + 0.25 * np.minimum(high - low, 6.0) * way


def ours(scene, q, limits):
    path = Path.spline(np.arange(6.0), q)
    columns = joint_columns(scene.model)
    run = _Retiming(scene, path, columns, read_limits(scene, limits), Policy())
    grid = np.linspace(0.0, 5.0, POINTS)

    def duration(constant):
        run.constant = [(0, 0.0, 5.0)] if constant else []
        return float(run.problem([grid]).solve().duration[0])

    return duration


def theirs(scene, q, torque):
    model = scene.model
    data = model.createData()
    path = toppra.SplineInterpolator(np.arange(6.0), q)
    import pinocchio as pin

    def inverse(q, v, a):
        return pin.rnea(model, data, q, v, a)

    speeds = np.stack([-model.velocityLimit, model.velocityLimit], axis=1)
    limits = [
        toppra.constraint.JointVelocityConstraint(speeds),
        toppra.constraint.JointTorqueConstraint(
            inverse,
            np.stack([-torque, torque], axis=1),
            np.zeros(model.nv),
            discretization_scheme=toppra.constraint.DiscretizationType.Interpolation,
        ),
    ]

    def duration():
        solver = toppra.algorithm.TOPPRA(
            limits, path, gridpoints=np.linspace(0.0, 5.0, POINTS), solver_wrapper="seidel"
        )
        _, rate, _ = solver.compute_parameterization(0.0, 0.0)
        return float(2.0 * (np.diff(np.linspace(0, 5, POINTS)) / (rate[1:] + rate[:-1])).sum())

    return duration


@pytest.mark.parametrize("name", ["panda_pick_and_place", "ur5_pick_and_place"])
@pytest.mark.parametrize("seed", range(3))
def test_without_friction_as_toppra(name, seed):
    scene, q = case(name, seed)
    bare = with_effects(scene, only=["payload"])
    torque = np.array(bare.model.effortLimit)
    limits = {
        d.name: {"effort": t, "transmission": {"ratio": 1.0}}
        for d, t in zip(bare.drives, torque, strict=True)
    }
    assert ours(bare, q, limits)(True) == pytest.approx(theirs(bare, q, torque)(), rel=1e-3)


def test_time_beside_toppra(capsys):
    scene, q = case("panda_pick_and_place", 0)
    bare = with_effects(scene, only=["payload"])
    torque = np.array(bare.model.effortLimit)
    drives = {d.name: {"effort": t} for d, t in zip(bare.drives, torque, strict=True)}
    motors = {d.name: LARGE if i < 4 else SMALL for i, d in enumerate(scene.drives)}
    seconds = median_seconds(
        {
            "toppra": theirs(bare, q, torque),
            "frictionless": lambda: ours(bare, q, drives)(True),
            "linear": lambda: ours(bare, q, drives)(False),
            "everything": lambda: ours(scene, q, motors)(False),
        },
        rounds=5,
    )
    with capsys.disabled():
        print("", {name: f"{1e3 * value:.1f} ms" for name, value in seconds.items()})
    assert seconds["frictionless"] < 1.5 * seconds["toppra"]
    assert seconds["everything"] < 5.0 * seconds["toppra"]
