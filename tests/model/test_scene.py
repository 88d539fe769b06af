"""Scenes are immutable: a changed model is noticed, `with_` makes changed scenes."""

import copy
import pickle
import re
import warnings

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import block, chain, dry, lump, plane_friction, sliding_block
from mechanisms import four_bar
from numpy.testing import assert_allclose, assert_array_equal
from tables import table

import pinfric as pf
from pinfric.errors import PinfricWarning, SceneError
from pinfric.model.entry import parse
from pinfric.model.schema import Assumed, Friction

ZERO = np.zeros((1, 1))
FRICTION = {"slide": plane_friction(0.5, 0.3)}
BOX = {"box": {"link": "tray", "mass": 1.0, "com": [0.0, 0.0, 0.1], "attached": False}}


def made(**more):
    model = block()
    model.addBodyFrame("tray", 1, pin.SE3.Identity(), 0)
    return pf.Scene(model=model, friction=FRICTION, payloads=BOX, **more)


def upper(scene, **more):
    return pf.inverse_dynamics(scene, ZERO, ZERO, ZERO, **more).effort_upper[0, 0]


USES = {
    "inverse_dynamics": upper,
    "inverse_dynamics with a payload": lambda s: upper(s, attached=[[True]]),
    "forward_dynamics": lambda s: pf.forward_dynamics(s, [0.0], [0.0], [1.0]),
    "simulate": lambda s: pf.simulate(s, [0.0], [0.0], [1.0], 0.01),
    "joint_wrenches": lambda s: pf.joint_wrenches(s, ZERO, ZERO, ZERO),
    "pickle": pickle.dumps,
    "with_": lambda s: s.with_(stick_velocity=1e-3),
    "loaded_model": lambda s: s.loaded_model(),
}
CHANGES = {
    "gravity": lambda m: setattr(m.gravity, "linear", np.array([0.0, 0.0, -1.62])),
    "inertias": lambda m: setattr(m.inertias[1], "mass", 5.0),
    "jointPlacements": lambda m: setattr(m.jointPlacements[1], "translation", np.ones(3)),
    "armature": lambda m: m.armature.__setitem__(0, 1.0),
    "velocityLimit": lambda m: m.velocityLimit.__setitem__(0, 1.0),
}


@pytest.mark.parametrize("use", USES)
def test_a_model_changed_in_place_is_noticed_at_the_next_use(use):
    scene = made()
    USES[use](scene)  # what is computed once is there
    scene.model.gravity.linear = np.array([0.0, 0.0, -1.62])
    with pytest.raises(SceneError, match=r"changed \(gravity\).*with_\(gravity=\[0.0, 0.0, -1.62"):
        USES[use](scene)
    scene.model.gravity.linear = np.array([0.0, 0.0, -9.81])  # undone, it is the same again
    USES[use](scene)


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_of_the_model_is_named(change):
    scene = made()
    CHANGES[change](scene.model)
    with pytest.raises(SceneError, match=rf"scene\.model was changed \({change}\)") as error:
        upper(scene)
    assert "\n" not in str(error.value)


def test_what_a_result_was_computed_from_is_noticed_by_its_judge():
    scene = made()
    result = pf.inverse_dynamics(scene, ZERO, ZERO, ZERO)
    scene.model.inertias[1].mass = 5.0
    with pytest.raises(SceneError, match=r"changed \(inertias\)"):
        result.check()


def test_a_replay_does_not_draw_the_efforts_of_one_model_on_another():
    scene = made()
    result = pf.inverse_dynamics(scene, ZERO, ZERO, ZERO, t=[0.0])
    scene.model.jointPlacements[1].translation = np.ones(3)
    with pytest.raises(SceneError, match=r"changed \(jointPlacements\)"):
        pf.replay(scene, result)


def test_a_change_is_noticed_in_a_model_that_holds_nan():
    model = made().model
    model.effortLimit[0] = np.nan
    scene = pf.Scene(model=model)
    upper(scene)  # nothing was changed
    scene.model.gravity.linear = np.zeros(3)
    with pytest.raises(SceneError, match=r"changed \(gravity\)"):
        upper(scene)


def test_where_loops_start_is_not_changed_by_who_asked():
    scene = made()
    scene.start_configuration[0] = 0.7
    assert scene.start_configuration[0] == 0.0


def test_a_loaded_model_is_the_callers_own():
    scene = made()
    scene.loaded_model().gravity.linear = np.zeros(3)
    assert upper(scene) == pytest.approx(0.5 * 2.0 * 9.81)


def test_friction_and_payloads_cannot_be_assigned():
    scene = made()
    for entries in (scene.friction, scene.payloads):
        with pytest.raises(TypeError):
            entries["slide"] = None


def test_a_base_that_floats_is_not_driven_without_a_word():
    base = "base", pin.JointModelFreeFlyer(), pin.Inertia.Random()
    model = chain(base, ("leg", pin.JointModelRY(), pin.Inertia.Random()))
    with pytest.warns(pf.PinfricWarning, match=r"base 'base' gets six.*actuators=(.*)$") as caught:
        pf.Scene(model=model)
    (said,) = caught
    offered = str(said.message).partition("actuators=")[2]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = pf.Scene(model=model, actuators=eval(offered))  # what the line says to write
        assert scene.actuator_names == ("leg",)
        sliding_block()  # a joint on the ground may be driven


def test_scenes_are_keys_as_they_are_equal():
    scene, same, other = made(), made(), made(stick_velocity=1e-3)
    assert scene == same
    assert hash(scene) == hash(same)
    assert {scene: 1, other: 2}[same] == 1
    assert len({scene, same, other}) == 2


def test_with_gives_a_changed_scene_and_leaves_the_first():
    scene = made()
    moon = scene.with_(gravity=[0, 0, -1.62])
    assert upper(moon) == pytest.approx(0.5 * 2.0 * 1.62)
    assert upper(moon, attached=[[True]]) == pytest.approx(0.5 * 3.0 * 1.62)  # no mixed variants
    assert upper(scene) == pytest.approx(0.5 * 2.0 * 9.81)
    assert upper(scene.with_(friction={})) == 0.0
    heavy = scene.with_(payloads={"box": BOX["box"] | {"mass": 4.0, "attached": True}})
    assert upper(heavy) == pytest.approx(0.5 * 6.0 * 9.81)
    model = scene.model.copy()
    model.inertias[1].mass = 10.0
    assert upper(scene.with_(model=model)) == pytest.approx(0.5 * 10.0 * 9.81)
    both = scene.with_(model=model, gravity=[0.0, 0.0, -1.0])
    assert upper(both) == pytest.approx(0.5 * 10.0)
    assert model.gravity.linear[2] == -9.81
    with pytest.raises(SceneError, match=r"scene: `simulation\.t_end`.*greater than 0"):
        scene.with_(simulation={"t_end": 0})
    assert scene.with_(simulation={"t_end": 2}).simulation.t_end == 2.0
    geared = scene.with_(actuators=[{"joint": "slide", "transmission": {"ratio": 10.0}}])
    assert geared.drives[0].transmission.ratio == 10.0
    assert scene.with_(stick_velocity=0.1).sites[0].law.stick_velocity == 0.1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"gravity": [0.0, -9.81]}, "gravity: should be three finite numbers"),
        ({"gravity": [0.0, 0.0, np.nan]}, "gravity: should be three finite numbers"),
        ({"gravity": [0.0, 0.0, 1j]}, "gravity: .*complex numbers"),
        ({"gravity": [0.0, 0.0, -9810.0]}, "robot.gravity: should be at most 250 m/s.2, found"),
        ({"fricton": {}}, "with_: there is no 'fricton'"),
        ({"friction": {"slid": {}}}, "there is no joint 'slid'"),
        ({"payloads": {"box": {"link": "tray", "mass": -1.0}}}, "payloads.box"),
    ],
)
def test_with_checks_like_the_first_time(change, says):
    with pytest.raises(SceneError, match=says):
        made().with_(**change)


def test_a_guess_that_is_replaced_is_no_guess_any_more():
    guesses = {
        "by": "pinfric new tray.urdf",
        "date": "2026-11-22",
        "version": "0.1.0",
        "values": {"friction.slide.coulomb": "5 %", "friction.slide.viscous": "2 %"},
    }
    dry = {"static": 2.5, "kinetic": 2.0}
    rod = {"slide": {"coulomb": dry, "viscous": 3.0}}
    scene = pf.Scene(model=block(), friction=rod, assumed=parse(Assumed, guesses, "tray.yaml"))
    assert set(scene.with_(stick_velocity=1e-3).assumed.values) == set(guesses["values"])
    measured = scene.with_(friction={"slide": {"coulomb": dry | {"static": 2.6}, "viscous": 3.0}})
    assert measured.assumed.values == {"friction.slide.viscous": "2 %"}
    assert measured.assumed.by == guesses["by"]
    assert scene.with_(friction={}).assumed is None


def test_the_base_is_not_counted_among_what_moves():
    model = block(mass=2.0)
    model.inertias[0] = lump(7.0, moment=1.0)
    assert "1 joint, 2 kg that move" in repr(pf.Scene(model=model))


def test_gears_stick_by_the_friction_that_a_scene_has():
    drives = [{"joint": "slide", "transmission": {"ratio": 10.0}}]
    scene = sliding_block(dry(1.0), actuators=drives)
    assert scene.gears().stick_velocity == [scene.stick_velocity]
    other = {"slide": parse(Friction, dry(1.0, stick_velocity=0.02), "")}
    for changed in (scene.with_(friction=other), scene.with_coefficients(other)):
        assert changed.gears().stick_velocity == [0.02]
    assert scene.gears().stick_velocity == [scene.stick_velocity]


def test_copies_are_scenes_like_the_first():
    scene = made()
    for again in (pickle.loads(pickle.dumps(scene)), copy.deepcopy(scene), copy.copy(scene)):
        assert upper(again, attached=[[True]]) == upper(scene, attached=[[True]])
        again.model.gravity.linear = np.zeros(3)
        with pytest.raises(SceneError, match="changed"):
            upper(again)
        with pytest.raises(TypeError):
            again.friction["slide"] = None
        again.model.gravity.linear = np.array([0.0, 0.0, -9.81])


def test_mimic_joints_are_not_sent_to_other_processes():
    """Pinocchio's pickle of them ends the process that uses it."""
    both = ((n, pin.JointModelRZ(), pin.Inertia.Random()) for n in ("leader", "follower"))
    model = chain(*both, beside=True)
    followed = pin.transformJointIntoMimic(model, 1, 2, 0.5, 0.0)
    assert pickle.loads(pickle.dumps(pf.Scene(model=model))).joint_names == ("leader", "follower")
    scene = pf.Scene(model=followed)
    with pytest.raises(SceneError, match="mimic joints cannot be sent"):
        pickle.dumps(scene)
    state = np.array([0.3]), np.array([0.5]), np.array([2.0])
    here, again = (pf.inverse_dynamics(x, *state) for x in (scene, copy.copy(scene)))
    assert_array_equal(again.effort_lower, here.effort_lower)  # a sweep's samples do


def test_loops_made_in_code_close_near_their_start():
    """Two ways to assemble a four-bar: each start gives the nearest."""
    scene, joints = four_bar()
    angles = np.array([[0.9, 0.4, 1.6], [0.9, -0.9, -1.9]])  # crank, coupler, rocker
    q = [scene.close(joints(guess), ["O"]) for guess in angles]
    assert np.abs(q[0] - q[1]).max() > 0.5
    for near in q:
        start = dict(zip(scene.joint_names, near + 0.02, strict=True))
        for given in (start, near + 0.02):
            moved = scene.with_(start=given)
            assert_allclose(moved.start_configuration, near + 0.02, rtol=0, atol=1e-15)
            closed = moved.close(moved.start_configuration)
            assert_allclose(closed, near, rtol=0, atol=0.05)
            again = pickle.loads(pickle.dumps(moved))
            assert again == moved
            assert moved != scene


@pytest.mark.parametrize(
    ("start", "says"),
    [
        ({"O": 0.1, "Q": 0.2}, "start: there is no joint 'Q'; there are: O, "),
        ({"O": "up"}, "start.O: is not an array of numbers"),
        ({"O": [0.1, 0.2]}, "start.O: should be one number"),
        ([0.1], r"start: should be a mapping joint -> position, or 3 finite numbers \(nq\), found"),
        ([0.1, np.nan, 0.0], "or 3 finite numbers"),
    ],
)
def test_a_wrong_start_is_named(start, says):
    with pytest.raises(SceneError, match=says):
        four_bar()[0].with_(start=start)


def turning(damping=0.0, friction=0.0, armature=0.0):
    """A hinge whose model has more than a scene reads."""
    model = chain(("hinge", pin.JointModelRZ(), lump(1.0, moment=1.0)))
    model.damping[:], model.armature[:] = damping, armature
    model.upperDryFrictionLimit[:], model.lowerDryFrictionLimit[:] = friction, -friction
    return model


def test_friction_that_a_model_has_is_said_as_the_scene_takes_it():
    """A ball takes none; numbers are the model's own."""
    model = chain(
        ("ball", pin.JointModelSpherical(), lump(1.0, moment=1.0)),
        ("hinge", pin.JointModelRZ(), lump(1.0, moment=1.0)),
    )
    model.damping[:], model.upperDryFrictionLimit[-1] = 0.25, 1.5
    with pytest.warns(PinfricWarning, match=r"of ball\[0\], .*, hinge do not count") as said:
        scene = pf.Scene(model)
    (given,) = re.findall("give friction=(.*) if they should", str(said[0].message))
    scene = scene.with_(friction=yaml.safe_load(given))
    assert (scene.friction["hinge"].viscous.coefficient, scene.sites[0].name) == (0.25, "hinge")
    assert scene.friction["hinge"].coulomb.kinetic == 1.5


CASES = r"""
{damping: 1.0}  null  0.0  model\.damping and model\.friction of hinge do not count
{friction: 1.0}  null  0.0  "count: give friction={'hinge': {'coulomb': 1.0}} if they should; set"
{damping: 1.0, friction: 1.0}  {coulomb: 5.0}  0.0      null
{armature: 0.62}               null            6.1e-05  \(0\.61 kg .*\(0\.62\) count, 1\.23 together
{armature: 0.62}               null            0.0      null
{}                             null            6.1e-05  null
"""


@pytest.mark.parametrize(
    ("model", "entry", "rotor", "words"),
    table(CASES, yaml.safe_load, yaml.safe_load, float, yaml.safe_load),
)
def test_what_a_model_has_beside_the_scene_is_said(recwarn, model, entry, rotor, words):
    friction = {} if entry is None else {"hinge": entry}
    gear = {"ratio": 100.0, "rotor_inertia": rotor}
    drives = [{"joint": "hinge", "transmission": gear if rotor else None}]
    pf.Scene(turning(**model), friction=friction, actuators=drives)
    said = [str(one.message) for one in recwarn]
    assert [bool(re.search(words or "", text)) for text in said] == [True] * bool(words)


def test_a_copy_finds_by_itself_what_is_wrong_with_it():
    """A copy whose fields are replaced, as a sweep does, has findings of its own."""
    heavy = {"box": BOX["box"] | {"mass": 40.0}}
    scene = made()
    there = scene.findings, scene.gears()
    again = copy.copy(scene)
    object.__setattr__(again, "payloads", made().with_(payloads=heavy).payloads)
    assert again.findings == scene.with_(payloads=heavy).findings != there[0]
    assert again.gears() is not there[1]
