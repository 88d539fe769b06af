"""Friction that builds up over a way, in MuJoCo."""

import re

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from numpy.testing import assert_array_equal

import pinfric as pf
from pinfric.errors import PinfricError

mujoco = pytest.importorskip("mujoco")


def pendulum(way=2e-3, **gear):
    friction = {"coulomb": 10.0, "viscous": 2.0, "presliding": {"way": way}}
    model = chain(("j", pin.JointModelRY(), lump(5.0, [0.0, 0.0, -0.4], 0.2)))
    drive = {"joint": "j"} | ({"transmission": gear} if gear else {})
    return pf.Scene(model, friction={"j": friction}, actuators=[drive], source="pendulum.yaml")


def simulated(scene, effort, t_end, q=0.3, dt=2.5e-4):
    """Angle at each step, and shares, with the effort of the joint as a function of time."""
    model = mujoco.MjModel.from_xml_string(pf.export(scene).text)
    model.opt.timestep = dt
    friction, data = pf.mujoco_friction(scene, model), None
    data = mujoco.MjData(model)
    data.qpos[:] = q
    data.ctrl[:] = effort(0.0)
    friction.start(data)
    angles, shares = [], []
    for k in range(round(t_end / dt)):
        data.ctrl[:] = effort(k * dt)
        friction.step(data)
        angles.append(data.qpos[0])
        shares.append(friction.share[0])
    assert not data.qfrc_applied.any()
    return np.array(angles), np.array(shares)


def integrated(way, effort, t_end, q=0.3, step=5e-6):
    """The same by small steps of the law itself."""
    inertia, weight, v = 5.0 * 0.16 + 0.2, 5.0 * 0.4 * 9.81, 0.0
    z = -weight * np.sin(q) / 10.0
    for k in range(round(t_end / step)):
        v += step * (effort(k * step) - weight * np.sin(q) - 2.0 * v - 10.0 * z) / inertia
        q += step * v
        z = min(max(z + step * v / way, -1.0), 1.0)
    return q, z


def test_the_bridge_follows_the_law():
    def effort(t):
        return 25.0 * np.sin(9.0 * t)

    angles, shares = simulated(pendulum(), effort, 1.0)
    q, z = integrated(2e-3, effort, 1.0)
    assert angles[-1] == pytest.approx(q, abs=3e-3)
    assert shares[-1] == pytest.approx(z, abs=0.05)
    assert np.ptp(angles) > 0.2


def test_it_goes_on_from_what_was_saved_and_not_from_another_robots():
    """The same positions to the bit; a share above 1 is refused."""
    scene = pendulum()
    model = mujoco.MjModel.from_xml_string(pf.export(scene).text)
    model.opt.timestep = 2.5e-4
    friction, data = pf.mujoco_friction(scene, model), mujoco.MjData(model)
    data.qpos[:] = 0.3
    friction.start(data)
    for _ in range(37):
        data.ctrl[:] = 15.0
        friction.step(data)
    kept, again = friction.save(data), mujoco.MjData(model)
    assert 0.05 < abs(kept[1, 0]) < 1.0
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_setState(model, again, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    friction.restore(again, kept)
    for _ in range(50):
        friction.step(data)
        friction.step(again)
    assert_array_equal(again.qpos, data.qpos)
    kept[1, 0] = 1.5
    with pytest.raises(PinfricError, match=r"share 1.5 of drive 0; allowed is -1 to 1: is it of"):
        friction.restore(again, kept)


def test_a_hold_yields_and_does_not_creep():
    angles, shares = simulated(pendulum(), lambda t: 9.0 * min(t, 1.0), 6.0, q=0.0)
    assert angles[-1] == pytest.approx(9.0 / (10.0 / 2e-3 + 5.0 * 0.4 * 9.81), rel=1e-3)
    late, last = angles[-8000:-4000].mean(), angles[-4000:].mean()  # of what still rings
    assert abs(last - late) < 1e-7
    assert shares[-1] == pytest.approx(0.9, abs=0.01)


def test_a_step_too_long_and_the_callback_are_refused():
    model = mujoco.MjModel.from_xml_string(pf.export(pendulum(1e-6)).text)
    names = ("dof_armature", "dof_damping", "dof_frictionloss", "dof_solref", "dof_invweight0")
    before = [getattr(model, name).copy() for name in names]
    with pytest.raises(PinfricError, match=r"a time step of 0.001 s is too long .* below"):
        pf.mujoco_friction(pendulum(1e-6), model)
    for name, values in zip(names, before, strict=True):  # it is as it was
        np.testing.assert_array_equal(getattr(model, name), values)
    scene = pendulum()
    friction = pf.mujoco_friction(scene, mujoco.MjSpec.from_string(pf.export(scene).text))
    with (
        pytest.raises(PinfricError, match=r"presliding: .* is in `step` only"),
        friction.installed(),
    ):
        pass


def test_the_parameters_of_its_lugre_law_have_the_loops_and_creep():
    """The export states them at its loads; a held joint yields by a hundred ways in 40 swings."""
    scene = pendulum(2e-3)
    assert not any("builds up" in line for line in pf.export(scene.without_presliding).left_out)
    exported = pf.export(scene)
    (line,) = (x for x in exported.left_out if "builds up over 0.002" in x)
    numbers = line.split('lugre="')[1].split('"')[0]
    loss = exported.joints[0].frictionloss
    assert [float(x) for x in numbers.split()] == pytest.approx([loss / 2e-3, 0, loss, loss, 0])
    rubs = (
        '<dcmotor name="rubs" joint="j" input="none" motorconst="0" resistance="1" '
        f'lugre="{numbers}"/></actuator>'
    )
    text = re.sub(' frictionloss="[^"]*"', "", exported.text).replace("</actuator>", rubs)
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.gravity[:] = 0.0
    model.opt.timestep = 2.5e-4
    data, angles = mujoco.MjData(model), []
    for k in range(40_000):
        swing = 0.4 + 0.55 * np.sin(2.0 * np.pi * 4.0 * k * 2.5e-4)
        data.qfrc_applied[:] = loss * swing
        mujoco.mj_step(model, data)
        angles.append(data.qpos[0])
    period = 1000
    assert angles[-1] - angles[-1 - 20 * period] > 2e-3


def test_no_other_format_has_it_and_each_says_so():
    scene = pf.load_scene("ur10_machine_tending")
    entry = scene.friction["elbow_joint"].model_dump(exclude_defaults=True)
    entry["presliding"] = {"way": 1e-4}
    scene = scene.with_(friction={**scene.friction, "elbow_joint": entry})
    (line,) = (x for x in pf.export(scene, to="urdf").left_out if "builds up" in x)
    assert "elbow_joint builds up over 0.0001" in line
    assert line.endswith("it acts at once")
