"""Springs and hoses of a scene: closed forms, the gradient of their potential, refusals."""

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import chain, dry, lump, random_states, random_tree
from numpy.testing import assert_allclose
from tables import table

import pinfric as pf
from pinfric.errors import PinfricError, SceneError, StateError

G, MASS, LEVER = 9.81, 2.0, 0.5


def lever(*springs, **more):
    """A weight on a lever that turns about y; at q = 0 it lies along x, q < 0 lifts it."""
    model = chain(("arm", pin.JointModelRY(), lump(MASS, (LEVER, 0.0, 0.0), 1e-6)))
    model.addBodyFrame("base", 0, pin.SE3.Identity(), 0)
    model.addBodyFrame("arm_link", 1, pin.SE3.Identity(), 0)
    return pf.Scene(model, springs=springs, **more)


def line(kind, b=(0.3, 0.0, 0.0), a=(0.0, 0.0, 0.4), **more):
    """From a point above the axis to one on the lever."""
    ends = {"a": {"link": "base", "xyz": a}, "b": {"link": "arm_link", "xyz": b}}
    return {"kind": kind, "name": "rod", **ends, **more}


def along(q, a=0.4, b=0.3):
    """Length of `line` and its derivative by q: the law of cosines."""
    length = np.sqrt(a**2 + b**2 + 2.0 * a * b * np.sin(q))
    return length, a * b * np.cos(q) / length


def tension(q, k=800.0, free=0.45, initial=20.0):
    length, rate = along(q)
    return -np.where(length > free, initial + k * (length - free), 0.0) * rate


def gas(q, force=400.0, length=0.7, stroke=0.5, p=1.4):
    now, rate = along(q)
    return force / (1.0 - (1.0 - 1.0 / p) * (length - now) / stroke) * rate


TORSION = {"kind": "torsion", "name": "coil", "joint": "arm", "stiffness": 7.0}
GAS = line("gas", force=400.0, length=0.7, stroke=0.5, progression=1.4)
PULL = line("tension", stiffness=800.0, free_length=0.45, initial_tension=20.0)
CLOSED_FORMS = [
    (TORSION | {"rest": 0.4, "preload": -3.0}, lambda q: -3.0 - 7.0 * (q - 0.4)),
    ({"kind": "hose", "name": "hose", "joint": "arm", "torque": 1.5}, lambda q: 0 * q + 1.5),
    (PULL, tension),
    (
        line("tension", stiffness=800.0, free_length=0.45, pushes=True),
        lambda q: -800.0 * (along(q)[0] - 0.45) * along(q)[1],
    ),
    (GAS, gas),
    (line("gas", force=400.0, length=0.7, stroke=0.6), lambda q: 400.0 * along(q)[1]),
]


@pytest.mark.parametrize(("spring", "torque"), CLOSED_FORMS)
def test_effort_and_acceleration_on_a_lever_by_the_closed_form(spring, torque):
    scene, q = lever(spring), np.linspace(-0.9, 1.2, 25)
    zero = np.zeros((25, 1))
    weight = MASS * G * LEVER * np.cos(q)  # turns it on: forward
    efforts = pf.inverse_dynamics(scene, q[:, None], zero, zero)
    assert_allclose(efforts.effort_lower[:, 0], -weight - torque(q), atol=1e-12)
    assert efforts.check().passed()
    for angle in q[::6]:
        a = pf.forward_dynamics(scene, [angle], [0.7], [0.0]).a[0]
        inertia = MASS * LEVER**2 + 1e-6
        at = np.array([angle])
        assert a * inertia == pytest.approx(
            (MASS * G * LEVER * np.cos(at) + torque(at))[0], rel=1e-12
        )
    one = scene.solver().inverse(q[3:4], np.zeros(1), np.zeros(1)).effort_lower[0]
    assert one == pytest.approx(efforts.effort_lower[3, 0], abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "seed"), [(k, s) for k in ("torsion", "line", "both") for s in (1, 2)]
)
def test_springs_of_random_trees_are_the_gradient_of_their_energy(kind, seed):
    """Numeric gradient of an energy written here, for links anywhere; the wrenches by Pinocchio."""
    model, rng = random_tree(seed, 6), np.random.default_rng(seed)
    for j in range(1, model.njoints):
        model.addBodyFrame(f"link_{j}", j, pin.SE3.Random(), 0)
    names, data = list(model.names)[1:], model.createData()
    singles = [n for n in names if model.joints[model.getJointId(n)].nq == 1]
    points = rng.normal(size=(2, 3))
    coil = {
        "kind": "torsion",
        "name": "coil",
        "joint": singles[-1],
        "stiffness": 31.0,
        "rest": 0.3,
        "preload": 4.0,
    }
    rod = {
        "kind": "tension",
        "name": "rod",
        "stiffness": 170.0,
        "free_length": 0.2,
        "pushes": True,
        "a": {"link": "link_2", "xyz": points[0].tolist()},
        "b": {"link": "link_6", "xyz": points[1].tolist()},
    }
    springs = {"torsion": [coil], "line": [rod], "both": [coil, rod]}[kind]
    scene = pf.Scene(model, springs=springs)

    def energy(q):
        pin.forwardKinematics(model, data, q)
        total = 0.0
        for spring in springs:
            if spring["kind"] == "torsion":
                x = q[model.joints[model.getJointId(spring["joint"])].idx_q] - 0.3
                total += 0.5 * 31.0 * x**2 - 4.0 * x
            else:
                pin.updateFramePlacements(model, data)
                frames = [data.oMf[model.getFrameId(f"link_{j}")] for j in (2, 6)]
                a, b = frames[0].act(points[0]), frames[1].act(points[1])
                total += 0.5 * 170.0 * (np.linalg.norm(b - a) - 0.2) ** 2
        return total

    q, v, a = random_states(model, seed, 4)
    with_, without = (
        pf.inverse_dynamics(s, q, v, a).effort_lower for s in (scene, scene.with_(springs=[]))
    )
    h = 1e-5
    for i in range(4):
        slope = [
            (energy(pin.integrate(model, q[i], h * e)) - energy(pin.integrate(model, q[i], -h * e)))
            / (2 * h)
            for e in np.eye(model.nv)
        ]
        assert_allclose((with_ - without)[i], slope, atol=2e-6 * np.abs(slope).max())


@pytest.mark.parametrize("spring", [TORSION, PULL | {"initial_tension": 0.0}, GAS, "all"])
def test_a_simulation_with_springs_keeps_its_energy(spring):
    """No friction: kinetic energy, weight and springs, by forms written here; slack on the way."""
    springs = (
        [TORSION, GAS, PULL | {"name": "slack", "free_length": 0.5}]
        if spring == "all"
        else [spring]
    )
    motion = pf.simulate(lever(*springs), [-0.3], [0.0], [0.0], t_end=0.6, rtol=1e-12, atol=1e-13)

    def energy(q, v):
        total = 0.5 * (MASS * LEVER**2 + 1e-6) * v**2 - MASS * G * LEVER * np.sin(q)
        length = along(q)[0]
        for one in springs:
            if one["kind"] == "torsion":
                total = total + 0.5 * 7.0 * q**2
            elif one["kind"] == "gas":
                c = (1.0 - 1.0 / 1.4) / 0.5
                total = total - 400.0 / c * np.log(1.0 - c * (0.7 - length))
            else:
                total = (
                    total
                    + 0.5 * 800.0 * np.maximum(length - one["free_length"], 0.0) ** 2
                    + (one["initial_tension"] * np.maximum(length - one["free_length"], 0.0))
                )
        return total

    whole = energy(motion.q[:, 0], motion.v[:, 0])
    scale = np.abs(motion.v).max() ** 2 * 0.5 * MASS * LEVER**2
    assert np.ptp(whole) < 1e-9 * scale
    assert abs(motion.energy().residual) < 1e-9 * scale


def test_a_torsion_pendulum_swings_by_the_closed_form():
    scene = lever(TORSION | {"rest": 0.4, "preload": -3.0}).with_(gravity=[0, 0, 0])
    motion = pf.simulate(scene, [0.1], [0.5], [0.0], t_end=2.0, rtol=1e-11, atol=1e-12)
    middle, rate = 0.4 - 3.0 / 7.0, np.sqrt(7.0 / (MASS * LEVER**2 + 1e-6))
    phase = rate * motion.t
    expected = middle + (0.1 - middle) * np.cos(phase) + 0.5 / rate * np.sin(phase)
    assert_allclose(motion.q[:, 0], expected, atol=1e-9)


@pytest.mark.parametrize("way", [-1.0, 0.0, 1.0])
def test_the_seal_of_a_gas_spring_rubs_along_its_line(way):
    scene = lever(GAS, friction={"rod": dry(30.0, 25.0, viscous=40.0)})
    q, zero = np.linspace(-0.9, 1.2, 25)[:, None], np.zeros((25, 1))
    found = pf.inverse_dynamics(scene, q, zero + 0.3 * way, zero)
    free = -MASS * G * LEVER * np.cos(q) - gas(q)
    lever_arm = np.abs(along(q)[1])
    rubs = 25.0 * way * lever_arm + 40.0 * 0.3 * way * lever_arm**2
    low, high = (
        (free - 30.0 * lever_arm, free + 30.0 * lever_arm) if way == 0.0 else (free + rubs,) * 2
    )
    assert_allclose(found.effort_lower, low, atol=1e-11)
    assert_allclose(found.effort_upper, high, atol=1e-11)
    assert found.check().passed()
    one = scene.solver().inverse(q[3], zero[3] + 0.3 * way, zero[3])
    assert_allclose(one.effort_upper, high[3], atol=1e-11)


@pytest.mark.parametrize("beyond", [-1e-6, 1e-6])
@pytest.mark.parametrize(
    ("spring", "site"), [(TORSION, "arm"), (PULL, "arm"), (GAS, "arm"), (GAS, "rod")]
)
def test_friction_holds_a_spring_up_to_its_limit_and_not_beyond(spring, site, beyond):
    """At q = 0.5 friction bears the difference of weight and spring, by the closed forms."""
    q = np.array([0.5])
    torque = {"torsion": -7.0 * q, "tension": tension(q), "gas": gas(q)}[spring["kind"]]
    left = abs(float((MASS * G * LEVER * np.cos(q) + torque)[0]))
    limit = left if site == "arm" else left / float(along(q)[1][0])
    scene = lever(spring, friction={site: dry((1.0 - beyond) * limit)})
    assert pf.holds(scene, q, [0.0]).held == (beyond < 0.0)


@pytest.mark.parametrize("angle", [-1e-4, 1e-4])
def test_a_spring_at_its_free_length_holds_only_where_it_is_taut(angle):
    """Weightless: friction bears the initial tension alone, which begins at the free length."""
    q = np.arcsin((0.45**2 - 0.25) / 0.24) + angle
    scene = lever(PULL, friction={"arm": dry(1.0)}).with_(gravity=[0, 0, 0])
    assert pf.holds(scene, [q], [0.0]).held == (angle < 0.0)


LINE = line("tension", stiffness=800.0, free_length=0.45)
SPRINGS = {"line": LINE, "gas": GAS, "torsion": TORSION}
WRONG = r"""
line     {stiffness: -1.0}       springs\[0\].stiffness`: should be at least 0
line     {b: {link: hand}}       \(rod\).b.link: there is no link 'hand'; there are: base
line     {b: {link: base}}       ends are on the same rigid body
line     {b: {link: arm_link, xyz: [0, 0, 0.4]}}  one point at the start; measure
line     {free_length: 0.7}      never more than 0.7 m apart, so it is always slack; measure
line     {pushes: true, initial_tension: 3.0}     which cannot push
gas      {stroke: 0.7}           stroke 0.7 m is not below the length 0.7 m
gas      {progression: 0.9}      progression`: should be at least 1
gas      {kind: gass}            there is no 'gass'; did you mean 'gas'
torsion  {joint: elbow}          there is no joint 'elbow'
torsion  {name: arm}             the name 'arm' is taken
torsion  {preload: null}         preload
"""


@pytest.mark.parametrize(("spring", "change", "said"), table(WRONG, str, yaml.safe_load, str))
def test_a_wrong_spring_is_named_with_what_to_measure(spring, change, said):
    with pytest.raises(SceneError, match=said) as found:
        lever(SPRINGS[spring] | change)
    assert "\n" not in str(found.value)


def test_a_joint_that_turns_without_end_has_no_spring():
    model = chain(("arm", pin.JointModelRUBY(), lump(1.0)))
    with pytest.raises(SceneError, match="turns without end"):
        pf.Scene(model, springs=[TORSION])


@pytest.mark.parametrize(("spring", "site"), [(TORSION, "coil"), (LINE, "rood")])
def test_friction_of_a_spring_is_an_entry_of_its_name(spring, site):
    with pytest.raises(
        SceneError, match=r"friction.coil: a torsion is in joint 'arm'|'rood'; did you mean 'rod'"
    ):
        lever(spring, friction={site: dry(1.0)})


def test_a_gas_spring_beyond_its_stroke_is_refused_with_the_sample():
    scene, q = lever(GAS), np.array([[0.0], [-1.2]])
    with pytest.raises(
        StateError, match=r"rod: its ends are 0.1622 m apart at sample 1, it is 0.175"
    ):
        pf.inverse_dynamics(scene, q, 0 * q, 0 * q)
    with pytest.raises(PinfricError, match=r"at t = .* rod: its ends are"):
        pf.simulate(scene, [-0.9], [-20.0], [0.0], t_end=1.0)
