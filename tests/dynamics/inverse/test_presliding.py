"""Friction that builds up over a way, in inverse dynamics."""

import re

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from export_cases import rich, with_ways, worm
from mechanisms import four_bar
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.errors import PinfricError
from pinfric.model.hysteresis import contradictions
from pinfric.model.schema import Actuator, Friction

FIGURES = [
    *("effort_lower", "effort_upper", "motor_torque_lower", "motor_torque_upper"),
    *("friction_lower", "friction_upper", "normal_load", "effort_frictionless"),
]


def swinging(scene, seed=0, samples=400, size=0.05):
    """A motion with reversals, holds, and a start at rest."""
    rng, nv = np.random.default_rng(seed), scene.model.nv
    t = np.linspace(0.0, 4.0, samples)
    w, phase = rng.uniform(2.0, 9.0, nv), rng.uniform(0.0, 6.0, nv)
    moving = np.clip(t, 0.3, None)[:, None]
    angle = size * np.sin(w * moving + phase)
    held = (t < 0.3) | ((t > 2.0) & (t < 2.3))
    v = np.where(held[:, None], 0.0, size * w * np.cos(w * moving + phase))
    a = np.where(held[:, None], 0.0, -size * w**2 * np.sin(w * moving + phase))
    angle[held & (t > 1.0)] = angle[np.argmax(t > 2.0)]
    base = pin.neutral(scene.model)
    return t, np.array([pin.integrate(scene.model, base, x) for x in angle]), v, a


SCENES = [rich(1), rich(2), rich(7, couples=True), rich(4, mimic=True), worm()]


def solved(scene, motion, **more):
    t, q, v, a = motion
    return pf.inverse_dynamics(scene, q, v, a, t=t, **more)


@pytest.mark.parametrize("shape", ["sharp", "gradual"])
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.source)
def test_a_way_of_nothing_is_the_law_without(scene, shape):
    """Bit for bit wherever all slides; and inside its two ends for any way."""
    motion = swinging(scene)
    plain = solved(scene, motion)
    tiny = solved(with_ways(scene, 1e-12, shape), motion)
    slides = ~(plain.sticking | plain.reversal).any(axis=1)
    rate = plain.actuator_velocity
    turns = (np.diff(rate > 0.0, axis=0) | (rate[1:] == 0.0)).any(axis=1)
    slides[1:] &= ~turns
    slides[:-1] &= ~turns
    assert slides.sum() > 100
    for name in FIGURES:
        assert_array_equal(getattr(tiny, name)[slides], getattr(plain, name)[slides])
    rests = plain.sticking.all(axis=1)
    assert rests.sum() > 30
    for name in FIGURES:
        assert_array_equal(getattr(tiny, name)[rests], getattr(plain, name)[rests])


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.source)
def test_all_residuals_vanish_and_efforts_lie_between_the_ends(scene):
    t, q, v, a = swinging(scene)
    result = solved(with_ways(scene, 2e-3), (t, q, v, a))
    assert result.check().passed()
    built = result.presliding
    part = (built.lower > -1.0) & (built.upper < 1.0)
    assert part.any()
    laws = scene.site_tables.laws
    size = laws.mu_static * result.normal_load + laws.coulomb_static.max(axis=1)
    drag = np.abs(laws.viscous * v[:, scene.site_tables.velocity_index])
    if not len(laws.mu):
        assert (np.abs(result.friction_upper) <= size + drag + 1e-12).all()
    chunks = list(solved(with_ways(scene, 2e-3), (t, q, v, a), chunks=37))
    for name in FIGURES:
        together = np.concatenate([getattr(chunk, name) for chunk in chunks])
        assert_array_equal(together, getattr(result, name))


def hinge(**gear):
    """10 N m of friction and, behind a gear, what it loses."""
    friction = {"j": {"coulomb": 10.0, "viscous": 2.0, "presliding": {"way": 1e-3}}}
    drive = {"joint": "j", "transmission": {"ratio": 50.0} | gear}
    model = chain(("j", pin.JointModelRY(), lump(1.0, [0.3, 0.0, 0.0], 0.1)))
    return pf.Scene(model, friction=friction, actuators=[drive])


def test_a_hinge_by_hand_blends_the_ends_of_its_gear():
    scene = hinge(efficiency=0.8, back_efficiency=0.7, no_load_torque=0.01, rotor_inertia=1e-4)
    t = np.arange(12) * 0.1
    q = np.concatenate([np.linspace(-0.1, 0.0, 7), [-0.0002, -0.0006, -0.001, -0.0016, -0.003]])
    v, a = np.where(np.arange(12) < 7, 0.5, -0.5), np.full(12, 0.3)
    found = solved(scene, (t, q[:, None], v[:, None], a[:, None]))
    z = found.presliding.lower[7:, 0]
    turn = 0.5 * 0.5 * 0.05  # v t/2 until it turns, a tenth of a second after the 7th sample
    dq = -0.0002
    first = turn + 0.5 * dq
    assert first > 1e-3
    expected = [max(1.0 + (dq - first) / 1e-3, -1.0)]
    assert_allclose(z[0], expected[0])
    rigid = found.effort_frictionless[7:, 0]
    ahead, back = rigid + 10.0 - 1.0, rigid - 10.0 - 1.0
    assert_allclose(found.effort_lower[7:, 0], 0.5 * (1 + z) * ahead + 0.5 * (1 - z) * back)

    def losses(sigma, e):
        loss = (1 / 0.8 - 1) if sigma * e > 0 else 1 - 0.7
        return e + sigma * (loss * abs(e) + 0.5)

    forward = np.array([losses(1.0, e) for e in ahead])
    backward = np.array([losses(-1.0, e) for e in back])
    whole = 0.5 * (1 + z) * forward + 0.5 * (1 - z) * backward + 50.0**2 * 1e-4 * 0.3
    assert_allclose(found.motor_torque_lower[7:, 0], whole / 50.0)
    assert_array_equal(found.motor_torque_lower[7:], found.motor_torque_upper[7:])


def test_a_coupled_gear_blends_its_ends_at_the_load_that_its_joints_need():
    """t is one number, whatever the gear's own share: (1 + z)/2 F_+(t) + (1 - z)/2 F_-(t)."""
    key = {"presliding": {"way": 2e-3}}
    gear = {"ratio": 40.0, "efficiency": 0.8, "back_efficiency": 0.6}
    model = chain(
        ("a", pin.JointModelRY(), lump(1.0, [0.3, 0.0, 0.0], 0.1)),
        ("b", pin.JointModelRX(), lump(1.0, [0.3, 0.2, 0.0], 0.1)),
    )
    scene = pf.Scene(
        model,
        friction={name: {"coulomb": 3.0} | key for name in "ab"},
        actuators=[
            {"joint": "a", "transmission": gear | key},
            {"joint": "b", "transmission": gear | key, "couples": {"a": 0.5}},
        ],
    )
    t, q, v, a = swinging(scene, size=0.01)
    found = solved(scene, (t, q, v, a))
    z, rate = found.presliding.drive_lower, found.actuator_velocity
    shared = (np.abs(z) < 1.0) & (z == found.presliding.drive_upper) & (rate != 0.0)
    shared &= np.abs(found.presliding.lower[:, :1]) < 1.0  # the joints' friction has its own share
    shared &= (found.presliding.lower == found.presliding.upper).all(axis=1)[:, None]
    assert (shared.sum(axis=0) > 10).all()
    effort = found.effort_lower
    assert_allclose(effort[shared], found.effort_upper[shared], rtol=1e-12)
    lost = np.abs(effort)
    ahead = effort + np.where(effort > 0.0, 1.0 / 0.8 - 1.0, 1.0 - 0.6) * lost
    back = effort - np.where(effort < 0.0, 1.0 / 0.8 - 1.0, 1.0 - 0.6) * lost
    torque = (0.5 * (1.0 + z) * ahead + 0.5 * (1.0 - z) * back) / 40.0
    assert_allclose(found.motor_torque_lower[shared], torque[shared], rtol=1e-9)
    assert_allclose(found.motor_torque_upper[shared], torque[shared], rtol=1e-9)


def test_partial_shares_by_hand():
    scene, t = hinge(), np.arange(5) * 0.1
    q = np.array([-0.01, 0.0, -0.0004, -0.0012, -0.01])
    v = np.array([0.1, 1e-4, -1e-4, -0.01, -0.1])
    found = solved(scene, (t, q[:, None], v[:, None], 0.0 * v[:, None]))
    z = found.presliding.lower[:, 0]
    assert_allclose(z[1:3], [1.0, 0.6], atol=0.01)
    assert_allclose(z[3:], [z[2] - 0.8, -1.0])
    assert_allclose(found.friction_lower[1:, 0], -10.0 * z[1:] - 2.0 * v[1:])


def test_what_holds_has_the_interval_unless_positions_are_known():
    scene = hinge()
    t = np.arange(6) * 0.1
    q = np.array([-0.02, -0.01, 0.0, -0.0002, -0.0002, -0.0002])
    v = np.array([0.1, 0.1, 0.1, 0.0, 0.0, 0.0])
    motion = t, q[:, None], v[:, None], 0.0 * v[:, None]
    plain, known = solved(scene, motion), solved(scene, motion, position_known=1e-4)
    assert_allclose(plain.friction_lower[3:, 0], -10.0)
    assert_allclose(plain.friction_upper[3:, 0], 10.0)
    assert_allclose(known.friction_lower[3:, 0], -9.0)
    assert_allclose(known.friction_upper[3:, 0], -7.0)
    assert_array_equal(solved(scene, motion, position_known=2e-3).friction_lower[3:], -10.0)
    assert known.check().passed()


def test_states_without_order_have_no_history():
    scene = hinge()
    _, q, v, a = swinging(scene)
    plain = pf.inverse_dynamics(scene.without_presliding, q, v, a)
    found = pf.inverse_dynamics(scene, q, v, a)
    assert found.presliding is None
    assert_array_equal(found.effort_lower, plain.effort_lower)
    table = solved(scene, swinging(scene)).to_dataframe()
    assert {"j.presliding_lower", "j.presliding_upper"} <= set(table.columns)


@pytest.mark.parametrize("known", [-1.0, np.nan, np.inf, [1.0, 2.0], "1"])
def test_a_position_known_that_is_no_size_is_refused(known):
    with pytest.raises(PinfricError, match="position_known"):
        solved(hinge(), swinging(hinge()), position_known=known)


def test_a_position_known_that_does_nothing_is_refused():
    scene = hinge()
    t, q, v, a = swinging(scene)
    with pytest.raises(PinfricError, match="give `t`"):
        pf.inverse_dynamics(scene, q, v, a, position_known=1e-4)
    with pytest.raises(PinfricError, match="no `presliding`"):
        solved(scene.without_presliding, (t, q, v, a), position_known=1e-4)


def test_tasks_take_friction_that_acts_at_once():
    """Bounds: sizes, retiming and sweeps are those without the key."""
    scene = hinge(rotor_inertia=1e-4)
    motion = pf.Trajectory.from_arrays(scene, *swinging(scene))
    plain = scene.without_presliding
    assert plain.ways is None
    sizes = [pf.size(s, motion).joints[0].demand.peak for s in (scene, plain)]
    assert sizes[0] == sizes[1]
    assert pf.inverse_dynamics(scene, motion).effort_upper.max() <= sizes[0]
    t = np.linspace(0.0, 4.0, 400)
    w = np.pi / 4.0
    stroke = [1.0 - np.cos(w * t), w * np.sin(w * t), w**2 * np.cos(w * t)]
    motion = pf.Trajectory.from_arrays(scene, t, *(x[:, None] for x in stroke))
    limits = {"j": {"effort": 40.0, "velocity": 2.0}}
    assert pf.retime(scene, motion, limits).duration == pf.retime(plain, motion, limits).duration


REFUSED = [
    ({"way": 0.0}, "greater than 0"),
    ({"way": -1e-3}, "greater than 0"),
    ({"way": np.nan}, "finite"),
    ({"way": 1e-3, "shape": "round"}, "sharp"),
    ({"shape": "sharp"}, "way"),
    (1e-3, "presliding"),
]


@pytest.mark.parametrize(("key", "message"), REFUSED)
def test_a_key_that_cannot_be_is_refused_in_one_line(key, message):
    with pytest.raises(PinfricError, match=message) as problem:
        hinge().with_(friction={"j": {"coulomb": 1.0, "presliding": key}})
    assert "\n" not in str(problem.value)


def test_places_that_cannot_have_a_way_are_refused():
    key = {"presliding": {"way": 1e-3}}
    with pytest.raises(PinfricError, match="needs `mu` or `coulomb`"):
        hinge().with_(friction={"j": {"viscous": 1.0} | key})
    with pytest.raises(PinfricError, match=r"transmission.presliding: is also given by friction.j"):
        hinge(**key)
    loop = four_bar()[0]
    name = next(iter(loop.friction))
    entry = loop.friction[name].model_dump(exclude_defaults=True)
    with pytest.raises(PinfricError, match=rf"friction.{name}.presliding: .* open chains"):
        loop.with_(friction={**loop.friction, name: entry | key})
    scene = rich(4, mimic=True)
    joints = zip(scene.model.names, scene.model.joints, strict=True)
    follower = next(n for n, j in joints if j.shortname() == "JointModelMimic")
    with pytest.raises(PinfricError, match="follows another joint"):
        scene.with_(friction={follower: {"coulomb": 1.0} | key})


def test_a_way_beyond_the_gears_hysteresis_is_doubted():
    gear = {"ratio": 100.0, "stiffness": 3e4, "hysteresis": 3e-4, "presliding": {"way": 2e-4}}
    drive = Actuator(joint="j", transmission=gear)
    friction = {"j": Friction.model_validate({"coulomb": 1e-3})}
    (found,) = contradictions(friction, [drive])
    assert found.place == "actuators[0].transmission.presliding.way"
    assert "0.0004 rad" in found.text
    friction = {"j": Friction.model_validate({"coulomb": 1e-3, "presliding": {"way": 1.4e-4}})}
    without = drive.transmission.model_copy(update={"presliding": None})
    assert not list(contradictions(friction, [drive.model_copy(update={"transmission": without})]))


def sine(amplitude, joints=2):
    """Ten strokes of all joints by the same sine: motion for `solved`."""
    t, w = np.linspace(0.0, 5.0, 500), 2.0 * np.pi
    column = amplitude * np.column_stack([np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)])
    return t, *(np.repeat(own[:, None], joints, axis=1) for own in column.T)


@pytest.mark.parametrize("amplitude", [0.01, 0.07])
def test_a_way_above_a_quarter_of_the_amplitude_is_named(amplitude, recwarn):
    """Of joint `b` alone."""
    model = chain(
        ("a", pin.JointModelRY(), lump(1.0, [0.3, 0.0, 0.0], 0.1)),
        ("b", pin.JointModelRX(), lump(1.0, [0.3, 0.2, 0.0], 0.1)),
    )
    ways = {"a": 1e-3, "b": 0.015}
    friction = {name: {"coulomb": 3.0, "presliding": {"way": way}} for name, way in ways.items()}
    solved(pf.Scene(model, friction=friction), sine(amplitude))
    said = [str(w.message) for w in recwarn if issubclass(w.category, pf.PinfricWarning)]
    if amplitude > 4.0 * ways["b"]:
        assert not said
        return
    (line,) = said
    assert "presliding: b has a way of 0.015, and its usual amplitude between reversals is" in line
    usual, smallest = (float(x) for x in re.findall(r"(?:is|smallest) (0\.0[0-9]*)", line))
    assert (usual, smallest) == pytest.approx((0.01, 0.005), rel=0.01)  # the last is half a stroke
    assert "a has" not in line


def test_a_way_of_a_coupled_drive_is_that_of_its_own_angle(recwarn):
    """The drive turns by the sum of both angles; a joint that rests has no stroke to judge by."""
    model = chain(
        ("a", pin.JointModelRY(), lump(1.0, [0.3, 0.0, 0.0], 0.1)),
        ("b", pin.JointModelRX(), lump(1.0, [0.3, 0.2, 0.0], 0.1)),
    )
    gear = {"ratio": 40.0, "no_load_torque": 0.1, "presliding": {"way": 0.015}}
    actuators = [
        {"joint": "a", "transmission": {"ratio": 40.0}},
        {"joint": "b", "name": "wrist drive", "transmission": gear, "couples": {"a": 1.0}},
    ]
    solved(pf.Scene(model, actuators=actuators), sine(0.01))
    (line,) = [str(w.message) for w in recwarn if issubclass(w.category, pf.PinfricWarning)]
    assert (
        "wrist drive has a way of 0.015, and its usual amplitude between reversals is 0.02" in line
    )
    t, q, v, a = sine(0.01)
    solved(pf.Scene(model, actuators=actuators), (t, 0.0 * q, 0.0 * v, 0.0 * a))
    assert len([w for w in recwarn if issubclass(w.category, pf.PinfricWarning)]) == 1
