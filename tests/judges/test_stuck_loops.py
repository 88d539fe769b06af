"""Sticking joints stand still exactly: by every method, joints of the tree and of loops alike."""

import numpy as np
import pinocchio as pin
import pytest
from builders import dry
from judges.planar_newton_euler import FourBar, bar_angles, bar_rates
from mechanisms import FIVE_BAR, LENGTHS, five_bar, four_bar, spatial_loop
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.model.closure import action_maps, loop_state
from pinfric.model.loops import stand_still

METHODS = {"event": {"rtol": 1e-11, "atol": 1e-13}, "timestepping": {"dt": 4e-3}}


def link_rotations(motion, links):
    """Rotations (n, links, 3, 3) in the world, by Pinocchio."""
    model, found = motion.scene.model, []
    data, ids = model.createData(), [model.getFrameId(x, pin.FrameType.BODY) for x in links]
    for q in motion.q:
        pin.framesForwardKinematics(model, data, q)
        found.append([data.oMf[i].rotation.copy() for i in ids])
    return np.array(found)


def pin_angles(motion, pins):
    """Angles (n, pins) between the two bars of each pin of a planar mechanism."""
    bars = sorted({bar for pair in pins.values() for bar in pair})
    R = link_rotations(motion, bars)
    columns = []
    for first, second in pins.values():
        a, b = R[:, bars.index(first), :, 0], R[:, bars.index(second), :, 0]
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        columns.append(np.unwrap(np.arctan2(cross, (a * b).sum(axis=1))))
    return np.column_stack(columns)


def coulomb(static, viscous=0.0):
    return dry(static, 0.8 * static, viscous=viscous)


def swinging_five_bar(stuck, cut, method, static=20.0):
    """Both arms are driven to and fro for 2 s; one pin never slips."""
    friction = dict.fromkeys(FIVE_BAR, coulomb(0.02, 0.05)) | {stuck: coulomb(static)}
    scene, q = five_bar(cut, friction, gravity=(0.0, 0.0, 0.0))
    effort = {"O": lambda t: 0.2 * np.sin(4 * t), "D": lambda t: 0.15 * np.sin(4 * t + 1)}
    return pf.simulate(
        scene, q, np.zeros(4), effort, 2.0, method, sample_step=0.02, **METHODS[method]
    )


# Safeguard: a loop's stuck pin is closed at the angle at which it stopped. Without: it turns by
# 3e-4 rad with time stepping and by 4e-13 rad with events where the loop is cut at it.
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("stuck", ["A", *(pytest.param(s, marks=pytest.mark.slow) for s in "BD")])
def test_a_stuck_pin_keeps_its_angle_wherever_the_loop_is_cut(stuck, method):
    """Five-bar: one pin sticks for 2 s, the remaining freedom moves, sticks and slips."""
    found = []
    for cut in dict.fromkeys([stuck, "O", "C"]):
        motion = swinging_five_bar(stuck, cut, method)
        angles = pin_angles(motion, FIVE_BAR)
        here = list(FIVE_BAR).index(stuck)
        assert np.abs(angles[:, here] - angles[0, here]).max() < 1e-13
        assert (np.delete(np.ptp(angles, axis=0), here) > 0.15).all()
        events = sorted((round(e.time, 6), e.name, e.kind, e.time) for e in motion.events)
        found.append((motion.t, angles, events))
    t, angles, events = found[0]
    assert len(events) >= 8
    for other_t, other_angles, other_events in found[1:]:
        assert [e[1:3] for e in other_events] == [e[1:3] for e in events]
        if method == "event":  # one motion; time stepping closes the loop of its cut, first order
            assert_allclose(other_t, t, rtol=0, atol=1e-9)
            assert_allclose(other_angles, angles, rtol=0, atol=1e-9)
        else:
            assert_allclose(other_angles, angles, rtol=0, atol=1e-3)


# Safeguard: every step of the integrator knows what stood still in it. Without: samples taken later
# hold a pin where it stands at the end of the motion.
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
@pytest.mark.parametrize("method", METHODS)
def test_a_pin_that_stops_and_lets_go_stands_in_between(method, kind):
    """Pin B of the five-bar sticks, breaks away, and stops elsewhere; the arms move on."""
    found = []
    for cut in "BOC":
        friction = dict.fromkeys(FIVE_BAR, coulomb(0.01, 0.05)) | {"B": coulomb(0.2)}
        scene, q = five_bar(cut, friction, kind, gravity=(0.0, 0.0, 0.0))
        push = {"O": lambda t: 0.7 * np.sin(4 * t), "D": lambda t: 0.5 * np.sin(4 * t + 1)}
        motion = pf.simulate(
            scene, q, np.zeros(4), push, 1.5, method, sample_step=0.005, **METHODS[method]
        )
        rests = [x for x in motion.stick_intervals() if x.site == "B" and x.end - x.start > 0.05]
        stood = []
        # what lies between samples, too, and after the pin has stood elsewhere
        fine = motion if motion.dense is None else motion.sample(np.linspace(0, 1.5, 577))
        coarse, dense = (pin_angles(x, FIVE_BAR) for x in (motion, fine))
        for rest in rests:
            stood.append(coarse[motion.t.searchsorted(rest.start), 2])
            for seen, angles in ((motion, coarse), (fine, dense)):
                inside = (seen.t >= rest.start) & (seen.t <= rest.end)
                assert np.abs(angles[inside, 2] - stood[-1]).max() < 1e-13
                assert np.ptp(angles[inside, 0]) > 0.01
        assert len(rests) >= 2
        assert np.ptp(stood) > 0.05
        found.append([[x.start, x.end] for x in rests])
    allowed = {"event": 1e-8, "timestepping": 0.01}[method]
    for times in found[1:]:
        assert_allclose(times, found[0], rtol=0, atol=allowed)


@pytest.mark.parametrize("cut", ["O", "A", "B", "C"])
@pytest.mark.parametrize("method", METHODS)
def test_what_is_locked_does_not_move_at_all_and_breaks_away_when_it_did(cut, method):
    """Four-bar: all pins stop together, stand, and break away by virtual work as torque grows."""
    scene, joints = four_bar(cut, friction=coulomb(0.2), gravity=(0.0, 0.0, 0.0))
    bars = bar_angles(FourBar(), 0.5)
    v = joints(bar_rates(FourBar(), bars, 4.0, 0.0)[0])
    torque = {"O": lambda t: 5.0 * max(t - 0.5, 0.0)}
    more = {"breakpoints": [0.5]} if method == "event" else {}
    motion = pf.simulate(
        scene, joints(bars), v, torque, 0.8, method, sample_step=0.005, **more, **METHODS[method]
    )
    rests = motion.stick_intervals()
    assert {x.site for x in rests} == set("OABC")
    assert len({(x.start, x.end) for x in rests}) == 1
    allowed = {"event": 1e-8, "timestepping": 4e-3}[method]
    assert rests[0].start == pytest.approx(0.0541402311, abs=allowed)  # of every cut
    inside = (motion.t >= rests[0].start) & (motion.t <= rests[0].end)
    assert inside.sum() > 100
    assert (motion.q[inside] == motion.q[inside][0]).all()
    crank, coupler, rocker = pin_rates_of_bars(motion, np.argmax(inside))
    turned = [crank, coupler - crank, rocker - coupler, rocker]
    needed = 0.2 * np.abs(turned).sum() / abs(crank)
    assert rests[0].end == pytest.approx(0.5 + needed / 5.0, abs=allowed)


def pin_rates_of_bars(motion, sample):
    """Rates of crank, coupler and rocker, up to a factor, at one sample of a four-bar."""
    R = link_rotations(motion, ["crank", "coupler", "rocker"])[sample]
    (x, y), (z, w), (f, g) = ((LENGTHS[n] * R[k, :2, 0]) for k, n in enumerate(LENGTHS))
    # crank + coupler = ground + rocker, differentiated, with the rocker's rate 1
    return (*np.linalg.solve([[-y, -w], [x, z]], [-g, f]), 1.0)


# Safeguard: what sticks from the start stands where its loops are closed. Without: pins held at an
# open place leave a loop that "cannot close", 6e-9 m.
@pytest.mark.slow
@pytest.mark.parametrize("cut", ["A", "B"])
@pytest.mark.parametrize("method", METHODS)
def test_what_sticks_in_a_loop_given_slightly_open_stands_where_it_is_closed(cut, method):
    friction = dict.fromkeys(FIVE_BAR, coulomb(0.5))
    for held in (friction, friction | {"O": coulomb(0.001)}):
        scene, q = five_bar(cut, held, gravity=(0.0, 0.0, 0.0))
        q = q + 1e-7 * np.array([1.0, -1.0, 0.5, 0.3])
        motion = pf.simulate(scene, q, np.zeros(4), [0.1, 0.1], 0.5, method, **METHODS[method])
        assert (motion.modes == 0).all()
        assert (motion.q[2:] == motion.q[2]).all()
        gap = loop_state(scene.twin(), scene.linkage, motion.q[2:3], *np.zeros((2, 1, 4))).gap
        assert np.abs(gap[0, scene.linkage.lambdas]).max() < 1e-14


def loop_frames(scene, q):
    """Places of all joints, the ground first, and of the first loop's frames a and b."""
    model, loop = scene.model, scene.loops[0]
    data, ends = model.createData(), []
    pin.framesForwardKinematics(model, data, q)
    for side in (loop.a, loop.b):
        local = pin.SE3(pin.rpy.rpyToMatrix(*side.rpy), np.array(side.xyz))
        ends.append(data.oMf[model.getFrameId(side.link, pin.FrameType.BODY)] * local)
    return list(data.oMi), *ends


@pytest.mark.parametrize(
    "kind", ["prismatic", "revolute", pytest.param("spherical", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("method", METHODS)
def test_a_stuck_loop_of_any_kind_keeps_its_frames_together(kind, method):
    """In space: the loop's joint sticks, one freedom moves."""
    scene, q, driven = spatial_loop(kind, 0)
    friction = dict.fromkeys(scene.joint_names, coulomb(0.0, 0.3)) | {"loop": coulomb(500.0)}
    scene = pf.Scene(
        model=scene.model, loops=scene.loops, actuators=scene.actuators, friction=friction
    )
    effort = {name: lambda t, k=k: 5 * np.sin(4 * t + k) for k, name in enumerate(driven)}
    motion = pf.simulate(
        scene, q, np.zeros(7), effort, 1.0, method, sample_step=0.01, **METHODS[method]
    )
    assert (motion.modes[:, -1] == 0).all()
    apart = []
    for x in motion.q:
        _, a, b = loop_frames(scene, x)
        apart.append(a.actInv(b).homogeneous)
    assert np.abs(np.array(apart) - apart[0]).max() < 1e-13
    assert np.ptp(motion.q, axis=0).max() > 0.5


@pytest.mark.parametrize("kind", ["prismatic", "revolute", "spherical"])
def test_what_stands_still_is_closed_and_its_gap_is_how_far_it_has_moved(kind):
    """Gaps against frames by Pinocchio, Jacobians against differences."""
    scene, q, _ = spatial_loop(kind, 3, mu=0.1)
    twin, plain, h = scene.twin(), scene.linkage, 1e-6
    rng = np.random.default_rng(0)

    def closed(at):
        zero = np.zeros((1, scene.model.nv))
        state = loop_state(twin, linkage, at[None], zero, zero)
        J = action_maps(twin, linkage, state.p, state.R)[1]
        return state.gap[0, linkage.closed], J[0, linkage.closed]

    columns = np.arange(plain.solved, len(plain.column_pair))
    joints, a, b = loop_frames(scene, q)
    linkage = stand_still(plain, plain, columns, joints)
    held = a.actInv(b)
    assert len(linkage.closed) == 6
    gap, J = closed(q)
    assert np.abs(gap).max() < 1e-15
    w = rng.normal(size=scene.model.nv)
    moved = [closed(pin.integrate(scene.model, q, step * w))[0] for step in (h, -h)]
    assert_allclose((moved[0] - moved[1]) / (2 * h), J @ w, atol=1e-8)
    away = pin.integrate(scene.model, q, 0.3 * w)
    _, a, b = loop_frames(scene, away)
    apart = (a * held).actInv(b)
    expected = np.concatenate([apart.rotation.T @ apart.translation, pin.log3(apart.rotation)])
    assert_allclose(closed(away)[0], linkage.unit[linkage.closed] @ expected, atol=1e-13)
    again = stand_still(plain, linkage, columns, loop_frames(scene, away)[0])
    assert (again.frame_p == linkage.frame_p).all()  # what stands already stays where it is
    assert (again.frame_R == linkage.frame_R).all()
