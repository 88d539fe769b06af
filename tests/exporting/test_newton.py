"""Newton with the exported constants: loaded and stepped where it is installed (on a CPU)."""

from __future__ import annotations

import types

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump

import pinfric as pf


def hinge():
    body = lump(1.0, moment=1.0)
    friction = dry(3.0, viscous=0.5)
    return pf.Scene(chain(("hinge", pin.JointModelRZ(), body)), friction={"hinge": friction})


def set_friction(scene, builder):
    read = {}
    exec(pf.export(scene, to="newton").text, read)
    read["set_friction"](builder)


def test_constants_go_to_the_joints_of_their_names():
    """A builder with the documented lists; labels may hold the path of an asset."""
    scene = pf.load_scene("ur5_pick_and_place")
    made = pf.export(scene, pf.load_trajectory("ur5_pick_and_place.csv", scene), "newton")
    labels = [f"ur5/{name}" for name in reversed(scene.joint_names)]
    builder = types.SimpleNamespace(
        joint_label=["base", *labels],
        joint_qd_start=[0, *range(6, 12)],
        joint_friction=[0.0] * 12,
        joint_damping=[0.0] * 12,
        joint_armature=[0.0] * 12,
    )
    read = {}
    exec(made.text, read)
    read["set_friction"](builder)
    assert builder.joint_friction[6:] == [j.frictionloss for j in reversed(made.joints)]
    assert builder.joint_damping[6:] == [j.damping for j in reversed(made.joints)]
    np.testing.assert_allclose(
        builder.joint_armature[6:], [j.armature for j in reversed(made.joints)]
    )
    assert not any(builder.joint_friction[:6])
    builder.joint_label[3] = "another"
    with pytest.raises(KeyError, match="there are no joints"):
        read["set_friction"](builder)


@pytest.mark.slow
# Newton warns of another MuJoCo than it was made with, and of its own calls.
@pytest.mark.filterwarnings("ignore:MuJoCo dependency version", "ignore:set_const_.* is deprecated")
def test_newton_holds_and_slips_by_the_constants():
    newton = pytest.importorskip("newton", reason="Newton is not installed")
    wp = pytest.importorskip("warp")
    pytest.importorskip("mujoco_warp", reason="Newton's SolverMuJoCo needs mujoco_warp")
    wp.config.quiet = True
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    link = builder.add_link(mass=1.0, inertia=wp.mat33(np.eye(3)))
    joint = builder.add_joint_revolute(-1, link, axis=newton.Axis.Z, label="hinge")
    builder.add_articulation([joint])
    set_friction(hinge(), builder)
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverMuJoCo(model)
    speeds = []
    for effort in (2.0, 5.0):
        state, after, control = model.state(), model.state(), model.control()
        control.joint_f.assign([effort])
        for _ in range(500):
            solver.step(state, after, control, None, 1e-3)
            state, after = after, state
        speeds.append(float(state.joint_qd.numpy()[0]))
    assert abs(speeds[0]) < 0.05  # it holds, softly
    wanted = (5.0 - 3.0) / 0.5 * (1.0 - np.exp(-0.5 * 0.5))
    assert speeds[1] == pytest.approx(wanted, rel=0.02)
