"""Time stepping of friction that builds up, against an integration of the law by small steps."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump

import pinfric as pf
from pinfric.errors import PinfricError, PinfricWarning

MASS, ARM, MOMENT, GRAVITY = 5.0, 0.4, 0.2, 9.81


def pendulum(way=None, static=10.0, **more):
    friction = {"coulomb": {"static": static, "kinetic": 10.0}, "viscous": 2.0}
    if way:
        friction["presliding"] = {"way": way} | more
    model = chain(("j", pin.JointModelRY(), lump(MASS, [0.0, 0.0, -ARM], MOMENT)))
    return pf.Scene(model, friction={"j": friction})


def pushed(t, q, v):
    return np.array([25.0 * np.sin(9.0 * t)])


def simulated(scene, dt, t_end=1.0, effort=pushed, q=0.3):
    return pf.simulate(scene, [q], [0.0], effort, t_end, "timestepping", dt=dt, sample_step=1e-2)


def integrated(way, t_end=1.0, step=5e-6, q=0.3):
    """(q, v) at the end, by the law itself; it begins with the friction that holds the joint."""
    inertia, weight, v = MASS * ARM**2 + MOMENT, MASS * ARM * GRAVITY, 0.0
    z = -weight * np.sin(q) / 10.0
    for k in range(round(t_end / step)):
        effort = 25.0 * np.sin(9.0 * k * step)
        v += step * (effort - weight * np.sin(q) - 2.0 * v - 10.0 * z) / inertia
        q += step * v
        z = min(max(z + step * v / way, -1.0), 1.0)
    return q, v


@pytest.mark.parametrize("way", [3e-3, 1e-4])
def test_it_is_first_order_and_needs_no_small_step(way):
    expected = integrated(way)[0]
    errors = [abs(simulated(pendulum(way), dt).q[-1, 0] - expected) for dt in (2e-3, 1e-3, 5e-4)]
    assert errors[0] < 5e-3
    for coarse, fine in pairwise(errors):
        assert 1.6 < coarse / fine < 2.6


def test_a_small_way_is_the_law_without():
    plain = simulated(pendulum(), 1e-3).q
    apart = [np.abs(simulated(pendulum(way), 1e-3).q - plain).max() for way in (1e-3, 1e-4, 1e-6)]
    assert apart[0] > apart[1] > apart[2]
    assert apart[2] < 2e-4


@pytest.mark.parametrize("static", [10.0, 14.0])
def test_a_hold_yields_and_does_not_drift(static):
    """Under 9 N m (13, which only friction at rest holds) by d 9/10, and then not at all."""
    load = 9.0 if static == 10.0 else 13.0
    scene = pendulum(2e-3, static)
    motion = simulated(scene, 1e-3, 8.0, lambda t, q, v: np.array([load * min(t, 1.0)]), q=0.0)
    weight = MASS * ARM * GRAVITY
    angle = load / (10.0 / 2e-3 + weight)  # of the spring and gravity
    assert motion.q[-1, 0] == pytest.approx(angle, rel=1e-3)
    assert abs(motion.q[-1, 0] - motion.q[-200, 0]) < 1e-9
    back = simulated(
        scene, 1e-3, 4.0, lambda t, q, v: np.array([load * max(1.0 - abs(t - 1.0), 0.0)]), q=0.0
    )
    assert abs(back.q[-1, 0]) < 1e-6  # a spring comes back


def test_joints_with_and_without_a_way_share_an_arm():
    """Two joints, loads by bearing; energy is never made, and the other one rests exactly."""
    pin_ = {"bearing": {"kind": "pin", "radius": 0.05}, "mu": {"static": 0.3, "kinetic": 0.2}}
    model = chain(
        ("a", pin.JointModelRY(), lump(2.0, [0.3, 0.0, 0.0], 0.1)),
        ("b", pin.JointModelRY(), lump(1.0, [0.3, 0.0, 0.0], 0.05)),
    )
    friction = {"a": pin_ | {"presliding": {"way": 1e-3}}, "b": {"coulomb": 20.0}}
    scene = pf.Scene(model, friction=friction)
    motion = pf.simulate(
        scene, [0.1, 0.2], [0.0, 0.0], [5.0, 0.0], 2.0, "timestepping", dt=1e-3, sample_step=1e-2
    )
    assert np.ptp(motion.q[:, 1]) == 0.0
    assert np.ptp(motion.q[:, 0]) > 0.1
    alone = pf.simulate(
        scene.without_presliding, [0.1, 0.2], [0.0, 0.0], [5.0, 0.0], 2.0, "timestepping", dt=1e-3,
        sample_step=1e-2,
    )  # fmt: skip
    assert np.abs(motion.q[:, 0] - alone.q[:, 0]).max() < 0.02


def test_what_is_not_simulated_is_said():
    scene = pendulum(1e-3)
    for method in ("event", "regularized"):
        with pytest.raises(PinfricError, match=f"presliding: {method} has no friction that builds"):
            pf.simulate(scene, [0.3], [0.0], [0.0], 0.1, method)
    with pytest.warns(PinfricWarning, match="gradual: simulated as sharp"):
        simulated(pendulum(1e-3, shape="gradual"), 1e-3, 0.05)
    gear = {"joint": "j", "transmission": {"ratio": 50.0, "no_load_torque": 0.01}}
    geared = scene.with_(actuators=[gear])
    with pytest.raises(PinfricError, match="presliding: losses of gears do not build up"):
        pf.simulate(geared, [0.3], [0.0], t_end=0.1, method="timestepping", motor_torque=[0.0])
    assert pf.simulate(geared, [0.3], [0.0], [0.0], 0.1, "timestepping").status == "finished"
