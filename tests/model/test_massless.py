"""Joints that move no mass, in every computation: an arm with a weightless gripper finger."""

import re

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, still
from cases import slider_crank
from numpy.testing import assert_allclose
from sizing_cases import GEAR, MOTOR, write_catalog

import pinfric as pf
from pinfric.errors import PinfricError, PinfricWarning, SizingError
from pinfric.model.massless import massless_joints
from pinfric.model.schema import Payload
from pinfric.show.pages.sizing import sizing_page

FRICTION = {"grip": dry(0.3, 0.2)}


def point(place):
    return pin.Inertia(0.5, np.array(place, dtype=float), np.zeros((3, 3)))


def arm(finger=None, mass=2.0, **options):
    """`shoulder` carries 2 kg at 0.25 m, J 0.0416 kg m^2, `grip` nothing or a body at its end."""
    body = pin.Inertia(mass, np.array([0.25, 0, 0]), np.diag([0.001, 0.0416, 0.0416]))
    grip = ("grip", pin.JointModelRY(), finger or pin.Inertia.Zero(), [0.5, 0, 0])
    model = chain(("shoulder", pin.JointModelRY(), *[body] * bool(mass)), grip)
    model.addJointFrame(1)
    model.addBodyFrame("finger", 2, pin.SE3.Identity(), int(model.addJointFrame(2)))
    return pf.Scene(model, **{"friction": FRICTION, **options})


def rotor(inertia):
    gear = {"ratio": 50, "rotor_inertia": inertia}
    return [{"joint": "shoulder"}, {"joint": "grip", "transmission": gear}]


@pytest.mark.parametrize(
    ("finger", "options", "names"),
    [
        (None, {}, ("grip",)),
        (point([0, 0, 0]), {}, ("grip",)),  # a point mass on the axis
        (point([0, 0.1, 0]), {}, ("grip",)),
        (point([0.1, 0, 0]), {}, ()),
        (None, {"actuators": rotor(1e-6)}, ()),
        (None, {"actuators": rotor(1e-15)}, ()),  # 2.5e-12 of it at the joint, 50^2 times
        (None, {"payloads": {"box": Payload(link="finger", mass=0.1, com=[0.1, 0, 0])}}, ()),
        (
            None,
            {"payloads": {"b": Payload(link="finger", mass=1, com=[0.1, 0, 0], attached=False)}},
            (),
        ),
    ],
)
def test_which_joints_move_no_mass(finger, options, names):
    scene = arm(finger, **options)
    assert massless_joints(scene, scene.payloads) == names


def test_what_a_loop_takes_along_is_no_joint_without_mass():
    """A piston of 0.8 kg on a weightless crank and rod: with the loop both move it."""
    scene = slider_crank([0.3]).scene
    assert massless_joints(scene) == ()
    assert massless_joints(scene.with_(loops=(), actuators=None)) == ("crank", "rod")


def test_a_mass_on_the_axis_at_the_start_alone_is_moved():
    model = chain(("roll", pin.JointModelRX()), ("bend", pin.JointModelRY(), point([0.5, 0, 0])))
    assert massless_joints(pf.Scene(model)) == ()


def test_efforts_do_not_depend_on_it():
    """-4.905 cos q at rest, M = 0.0416 + 2 x 0.0625: by hand, whatever `grip` does."""
    rng = np.random.default_rng(1)
    q, v, a = rng.normal(size=(3, 20, 2))
    v[:, 0] = 0.0
    found = pf.inverse_dynamics(arm(friction={}), q, v, a)
    wanted = -4.905 * np.cos(q[:, 0]) + 0.1666 * a[:, 0]
    assert_allclose(found.effort_frictionless[:, 0], wanted, atol=1e-13)
    assert_allclose(found.effort_frictionless[:, 1], 0.0, atol=1e-13)


@pytest.mark.parametrize("finger", [None, point([0, 0, 0])])
@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_it_is_held_where_it_starts(method, finger):
    """The shoulder swings as in the same arm with `grip` fixed."""
    scene = arm(finger)
    with pytest.warns(PinfricWarning, match="grip moves no mass: held at the start position"):
        motion = pf.simulate(scene, [0.3, 0.7], [1.0, 5.0], [0.5, 0.25], 0.5, method)
    fixed = pin.buildReducedModel(scene.model, [2], np.array([0.3, 0.7]))
    alone = pf.simulate(pf.Scene(fixed), [0.3], [1.0], [0.5], 0.5, method)
    assert_allclose(motion.q[-1], [alone.q[-1, 0], 0.7], rtol=0, atol=1e-9)
    assert not motion.v[:, 1].any()


@pytest.mark.filterwarnings("ignore:.*held at the start")
@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
@pytest.mark.parametrize(
    ("effort", "friction"),
    [([0, 0.31], FRICTION), ([0, 1e-6], {}), (lambda t, q, v: [0, -t], FRICTION)],
)
def test_more_than_its_friction_is_refused(method, effort, friction):
    scene = arm(friction=friction)
    with pytest.raises(PinfricError, match="grip moves no mass and gets an effort beyond"):
        pf.simulate(scene, [0, 0], [0, 0], effort, 1.0, method)


def test_forward_dynamics_is_that_of_the_arm_alone():
    found = pf.forward_dynamics(arm(), [0.3, 0.1], [0.5, 2.0], [1.0, -0.29])
    assert_allclose(found.a, [(1.0 + 4.905 * np.cos(0.3)) / 0.1666, 0.0], rtol=1e-12)
    assert found.friction[0] == pytest.approx(0.29)
    with pytest.raises(PinfricError, match="grip moves no mass"):
        pf.forward_dynamics(arm(), [0.3, 0.1], [0.5, 0.0], [1.0, -0.31])


def test_it_is_not_sized(tmp_path):
    path = write_catalog(tmp_path / "c.yaml", {"M": MOTOR}, {"G": GEAR})
    scene = arm()
    given = {"inertia_ratio": 1e4, "thermal_time": 1.0, "holding_brake": "any"}
    report = pf.size(scene.with_(masses="without_drives"), still(scene), path, conditions=given)
    states = {joint.name: str(joint.state) for joint in report.verdict.joints}
    assert states["grip"] == "moves no mass"
    assert "grip: moves no mass, not sized" in report.verdict.headline
    assert not any("grip" in line for line in report.verdict.failing)
    assert report.verdict.headline.startswith(f"{report.verdict.fitted} of 1 joints can be signed")
    assert [j.margin for j in report.verdict.joints if j.name == "grip"] == [None]
    (section,) = re.findall("<h2>grip.*?</section>", sizing_page(report), re.DOTALL)
    assert "grip: not sized" in section
    assert "<svg" not in section
    nothing = arm(mass=0.0)
    with pytest.raises(SizingError, match="no link that moves has a mass"):
        pf.size(nothing, still(nothing), path, conditions=given)


def test_mujoco_gets_a_body_without_the_joint():
    with pytest.warns(PinfricWarning, match="grip moves no mass: written without the joint"):
        made = pf.export(arm(), to="mjcf")
    model = mujoco.MjModel.from_xml_string(made.text)
    assert [model.joint(j).name for j in range(model.njnt)] == ["shoulder"]
    assert model.body("finger").pos.tolist() == [0.5, 0, 0]
    data = mujoco.MjData(model)
    data.qacc[:] = 1.0
    mujoco.mj_inverse(model, data)
    assert data.qfrc_inverse[0] == pytest.approx(0.1666 - 4.905, rel=1e-6)
