"""Friction along cylinders (seals), by virtual work: the drive's and friction's power is F L'."""

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import dry
from judges.verdict import judge
from mechanisms import pin_friction, shifted
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.errors import SceneError
from pinfric.model.effects import with_effects
from pinfric.show.replay.markers import site_marker
from pinfric.show.replay.shapes import robot_shapes
from pinfric.show.timeline.frames import site_rates

M, ARM, INERTIA, G = 40.0, 0.8, 6.0, 9.81
A, B = np.array([0.1, 0.0, -0.5]), np.array([0.6, 0.0, 0.0])
RAM = {
    "cylinder": {
        "name": "ram",
        "a": {"link": "ground", "xyz": list(A)},
        "b": {"link": "boom", "xyz": list(B)},
    }
}
SEAL = yaml.safe_load("""
bearing: {kind: seal, preload: 10.0}
mu: {static: 0.06, kinetic: 0.05}
coulomb: {static: 300.0, kinetic: 200.0}
viscous: {coefficient: 80.0, exponent: 0.5}
""")
PIN = pin_friction(0.1, 0.03, static=0.15)


def with_ground(joint):
    model = pin.Model()
    row = model.addJoint(0, joint, pin.SE3.Identity(), "pivot")
    model.addBodyFrame("ground", 0, pin.SE3.Identity(), 0)
    model.addBodyFrame("boom", row, pin.SE3.Identity(), 0)
    return model, row


def boom(friction):
    """A boom that turns about y, on one cylinder."""
    model, row = with_ground(pin.JointModelRY())
    inertia = pin.Inertia(M, np.array([ARM, 0.0, 0.0]), np.diag([1.0, INERTIA, INERTIA]))
    model.appendBodyToJoint(row, inertia, pin.SE3.Identity())
    return pf.Scene(model=model, friction=friction, actuators=[RAM])


def line(angle):
    """Length of the cylinder and dL/dq."""

    def length(q):
        return np.hypot(B[0] * np.cos(q) - A[0], -B[0] * np.sin(q) - A[2])

    slope = B[0] * (A[0] * np.sin(angle) + A[2] * np.cos(angle)) / length(angle)
    return length(angle), slope


def needed(q, a):
    """Force along the cylinder that the motion needs: (I a - m g arm cos q)/(dL/dq)."""
    return ((INERTIA + M * ARM**2) * a - M * G * ARM * np.cos(q)) / line(q)[1]


def friction_of(force, speed):
    """Size of the seal's friction in motion."""
    return 0.05 * (abs(force) + 10.0) + 200.0 + 80.0 * np.sqrt(speed)


MOTIONS = [(0.1, 0.5, 1.0), (-0.3, -0.4, 2.0), (0.5, 0.05, -3.0)]


@pytest.mark.parametrize(("q", "v", "a"), MOTIONS)
def test_both_directions_have_the_closed_form_of_virtual_work(q, v, a):
    """F = (I a - m g x)/L', u = F + sign(L'v) (mu (|F| + preload) + F_c + c sqrt|L'v|)."""
    scene = boom({"ram": SEAL})
    force, rate = needed(q, a), line(q)[1] * v
    expected = force + np.sign(rate) * friction_of(force, abs(rate))
    found = pf.inverse_dynamics(scene, [[q]], [[v]], [[a]])
    assert found.effort_lower[0, 0] == pytest.approx(expected, rel=1e-13)
    assert found.effort_upper[0, 0] == pytest.approx(expected, rel=1e-13)
    assert found.normal_load[0, 0] == pytest.approx(abs(force) + 10.0, rel=1e-13)
    assert judge(found).passed()
    instant = pf.forward_dynamics(scene, [q], [v], [expected])
    assert instant.a[0] == pytest.approx(a, rel=1e-12)
    assert instant.friction[0] == pytest.approx(force - expected, rel=1e-12)


def test_at_rest_it_holds_up_to_its_static_limit():
    """|F - u| <= mu_s (|F| + preload) + F_s."""
    scene = boom({"ram": SEAL})
    force = needed(0.2, 0.0)
    limit = 0.06 * (abs(force) + 10.0) + 300.0
    found = pf.inverse_dynamics(scene, [[0.2]], [[0.0]], [[0.0]])
    assert found.effort_lower[0, 0] == pytest.approx(force - limit, rel=1e-13)
    assert found.effort_upper[0, 0] == pytest.approx(force + limit, rel=1e-13)
    for side in (-1.0, 1.0):
        for share, holds in ((0.0, True), (1.0 - 1e-9, True), (1.0 + 1e-9, False)):
            assert pf.holds(scene, [0.2], [force + side * share * limit]).held == holds
        a = pf.forward_dynamics(scene, [0.2], [0.0], [force + side * 1.001 * limit]).a[0]
        assert a * side * line(0.2)[1] > 0.0


@pytest.mark.parametrize(("q", "v", "a"), MOTIONS)
def test_seal_and_pin_on_one_freedom_agree_with_the_judge_and_with_forward_dynamics(q, v, a):
    scene = boom({"ram": SEAL, "pivot": PIN})
    found = pf.inverse_dynamics(scene, [[q]], [[v]], [[a]])
    assert judge(found).passed()
    assert scene.site_names == ("pivot", "ram")
    instant = pf.forward_dynamics(scene, [q], [v], found.effort_lower[0])
    assert instant.a[0] == pytest.approx(a, rel=1e-11)
    at_rest = pf.inverse_dynamics(scene, [[q]], [[0.0]], [[0.0]])
    assert judge(at_rest).passed()
    middle = 0.5 * (at_rest.effort_lower + at_rest.effort_upper)[0]
    assert pf.holds(scene, [q], middle).held


@pytest.mark.parametrize(("method", "tolerance"), [("event", 1e-9), ("timestepping", 2e-3)])
def test_a_slide_in_line_with_its_cylinder_stops_and_stays(method, tolerance):
    """m dv/dt = -F_c: it stops after m v0/F_c, having gone m v0^2/(2 F_c)."""
    model, row = with_ground(pin.JointModelPX())
    model.gravity.linear = np.zeros(3)
    model.appendBodyToJoint(row, pin.Inertia.FromSphere(2.0, 0.1), pin.SE3.Identity())
    ram = {
        "cylinder": {
            "name": "ram",
            "a": {"link": "ground", "xyz": [-1.0, 0.0, 0.0]},
            "b": {"link": "boom"},
        }
    }
    friction = {"ram": dry(5.0, 4.0)}
    scene = pf.Scene(model=model, friction=friction, actuators=[ram])
    motion = pf.simulate(scene, [0.0], [1.0], [0.0], 1.0, method)
    moved = np.minimum(motion.t, 0.5)
    assert_allclose(motion.q[:, 0], moved - moved**2, rtol=0, atol=tolerance)
    assert motion.v[-1, 0] == 0.0
    assert [(event.name, event.kind) for event in motion.events] == [("ram", "stick")]


def test_power_goes_into_heat_and_motion_alone(tmp_path):
    """Pushed to and fro through stick and slip, with friction in a pin, too."""
    scene = boom({"ram": SEAL, "pivot": PIN})
    motion = pf.simulate(
        scene,
        [0.1],
        [0.0],
        lambda t, q, v: [700.0 + 550.0 * np.sin(9 * t) + 2e4 * (q[0] - 0.1)],
        0.8,
    )
    shown = pf.replay(scene, motion, tmp_path / "boom.html", rate=10.0)
    assert {interval.site for interval in shown.stick_intervals} == {"pivot", "ram"}
    energy = motion.energy()
    assert {event.kind for event in motion.events if event.name == "ram"} >= {"slip", "stick"}
    assert (energy.friction_loss > 0.0).all()
    assert abs(energy.residual) < 1e-9 * energy.friction_loss.sum()


def test_a_cylinder_that_sticks_keeps_its_length_while_the_mechanism_moves_on():
    """A ram over two joints sticks; the arm moves as the four-bar that it makes then."""
    model, row = with_ground(pin.JointModelRY())
    bar = pin.Inertia(3.0, np.array([0.4, 0.0, 0.0]), np.diag([0.01, 0.2, 0.2]))
    model.appendBodyToJoint(row, bar, pin.SE3.Identity())
    elbow = model.addJoint(row, pin.JointModelRY(), shifted(0.8), "elbow")
    model.appendBodyToJoint(elbow, bar, pin.SE3.Identity())
    model.addBodyFrame("forearm", elbow, pin.SE3.Identity(), 0)
    ram = {
        "cylinder": {
            "name": "ram",
            "a": {"link": "ground", "xyz": [0.3, 0.0, -0.6]},
            "b": {"link": "forearm", "xyz": [0.5, 0.0, 0.0]},
        }
    }
    friction = {"ram": dry(5e3)}
    scene = pf.Scene(model=model, friction=friction, actuators=[ram, {"joint": "elbow"}])
    motion = pf.simulate(scene, [0.1, 0.3], [0.0, 0.0], [0.0, 0.0], 1.0)
    fore = 0.8 * np.stack([np.cos(motion.q[:, 0]), -np.sin(motion.q[:, 0])], axis=1)
    angle = motion.q.sum(axis=1)
    end = fore + 0.5 * np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    length = np.hypot(end[:, 0] - 0.3, end[:, 1] + 0.6)
    assert np.ptp(motion.q[:, 0]) > 0.2
    assert np.ptp(length) < 1e-12
    assert abs(motion.energy().residual) < 1e-7  # J, of some 10 that swing


def test_seals_on_the_excavators_cylinders_rub_beside_its_pins():
    scene = pf.load_scene("excavator")
    rubbing = scene.with_(friction={**scene.friction, **dict.fromkeys(scene.actuator_names, SEAL)})
    path = pf.load_trajectory("excavator.waypoints.yaml", scene)
    some = slice(60, 560, 100)
    q, v, a = path.q[some], path.v[some], path.a[some]
    found, without = (pf.inverse_dynamics(s, q, v, a) for s in (rubbing, scene))
    assert judge(found).passed()
    rate, moves = found.actuator_velocity, ~found.sticking.any(axis=1)
    assert moves.any()
    more = (found.effort_lower - without.effort_lower) * np.sign(rate)
    assert (more[moves] > 200.0).all()
    for i in np.flatnonzero(moves):
        again = pf.forward_dynamics(rubbing, q[i], v[i], found.effort_lower[i])
        assert_allclose(again.a, a[i], rtol=0, atol=1e-9)
    bare = with_effects(rubbing, without=["load", "coulomb", "viscous"])
    assert bare.site_names == ()


def test_a_replays_ring_lies_round_the_line_of_the_cylinder():
    scene = boom({"ram": SEAL})
    marker = site_marker(scene, scene.sites[0], robot_shapes(scene), 1.0)
    assert_allclose(marker.placement.translation, B)
    assert_allclose(marker.placement.rotation[:, 2], (B - A) / np.linalg.norm(B - A))
    rates = site_rates(scene, np.array([[0.0]]), np.array([[0.7]]))
    assert_allclose(rates[0, 0], [0.0, 0.0, 0.7 * line(0.0)[1]])


@pytest.mark.parametrize(
    ("friction", "says"),
    [
        ({"rum": SEAL}, "friction: there is no joint 'rum'"),
        ({"ram": PIN}, r"friction\.ram\.bearing: a pin does not fit a cylinder; take seal"),
        ({"pivot": SEAL}, r"friction\.pivot\.bearing: a seal does not fit a turning joint"),
    ],
)
def test_what_does_not_fit_is_named(friction, says):
    with pytest.raises(SceneError, match=says):
        boom(friction)
