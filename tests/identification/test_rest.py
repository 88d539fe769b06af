"""Friction at rest: break-away and holding friction."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain
from identify_cases import (
    COULOMB,
    NAMES,
    PLAIN,
    excitation,
    guess,
    log,
    motor_effort,
    parameter,
    short,
    slow_departures,
    truth,
)

import pinfric as pf
from pinfric.identification.laws import BACKWARD, FORWARD, GEARS, SLOTS, Law
from pinfric.identification.normal import Fit
from pinfric.identification.recordings import STILL, Recording, stick_velocity
from pinfric.identification.rest import _held, break_aways


@pytest.mark.slow
def test_static_friction_shows_where_joints_break_away_slowly():
    logs = [short(), slow_departures((0, 3), 1.3)]
    # the elbow stands in the second log, and its bearing has no load to vary there
    laws = PLAIN | {NAMES[2]: Law(load="bearing")}
    found = pf.identify(guess(0), logs, laws=laws)
    for joint in (0, 3):
        for way, kinetic in zip(("positive", "negative"), COULOMB[joint], strict=True):
            static = parameter(found, "friction", joint, f"coulomb.{way}.static")
            assert static.value == pytest.approx(1.3 * kinetic, rel=0.05)
            entry = getattr(found.scene.friction[NAMES[joint]].coulomb, way)
            assert entry.static == pytest.approx(static.value, rel=1e-5)
    # joint 6 rested all the time, and what held it says little
    assert found.rest[NAMES[5]].seconds > 20.0
    ways = found.scene.friction[NAMES[5]].coulomb
    half = 0.5 * (ways.positive.static + ways.negative.static)
    assert found.rest[NAMES[5]].share == pytest.approx(found.rest[NAMES[5]].largest / half)
    assert found.rest[NAMES[5]].share < 1.0
    assert all(found.rest[NAMES[j]].inside > 0.985 for j in (0, 3, 4, 5))
    assert not any(p.joint == NAMES[5] and p.name.endswith("static") for p in found.parameters)
    assert "only bounded from below" in "\n".join(found.notes)


@pytest.mark.slow
def test_joints_stick_up_to_what_noise_makes_of_their_velocities():
    motion, rng = excitation(0, 20.0, 100.0), np.random.default_rng(1)
    noisy = motion.q + 2e-5 * rng.normal(size=motion.q.shape)
    given = pf.Log(motion.t, noisy, motor_effort(truth(), motion))
    found = pf.identify(guess(0), given, laws=PLAIN)
    seen = found.recordings[0].trajectory
    here = motion.v[np.rint(100.0 * seen.t).astype(int)]
    off = np.std((seen.v - here)[100:-100], axis=0).max()
    assert 2.0 * off < found.scene.stick_velocity < 6.0 * off
    assert any(line.startswith("the scene's `stick` velocity is") for line in found.notes)


@pytest.mark.slow
def test_a_jump_of_effort_at_departure_is_no_break_away():
    logs = [short(), slow_departures((0, 3), 1.0, rise=0.04)]
    found = pf.identify(guess(0), logs, laws=PLAIN)
    assert found.rest[NAMES[0]].seconds > 5.0
    assert not any(p.name.endswith("static") for p in found.parameters)


@pytest.mark.slow
def test_a_hold_beside_a_motion_bounds_friction_at_rest_and_changes_nothing_else():
    hold = log(0, 20.0, 100.0, still=tuple(range(6)), name="hold")
    alone, both = (pf.identify(guess(0), logs, laws=PLAIN) for logs in (short(), [short(), hold]))
    assert "no joint slides in hold: used for bounds on friction at rest" in both.notes
    assert any(line.startswith("one log only") for line in both.notes)
    assert both.delay == pytest.approx(alone.delay, rel=1e-9)
    values = [p.value for p in both.parameters]
    assert values == pytest.approx([p.value for p in alone.parameters], rel=1e-6)
    assert min(bound.seconds for bound in both.rest.values()) == pytest.approx(20.0, abs=0.1)


def test_a_drive_as_slow_as_noise_is_held_where_holds_have_settled():
    t = np.arange(0.0, 6.0, 0.01)
    slow = (t > 1.0) & (t < 2.0)  # long enough; not so where it turns about
    v = np.where(slow, 1e-4 * np.sin(40.0 * t), np.sin(3.0 * t))[:, None]
    scene = pf.Scene(chain(("turntable", pin.JointModelRZ(), pin.Inertia.Random())))
    motion = pf.Trajectory.from_arrays(scene, t, np.cumsum(v, axis=0) * 0.01, v, np.ones_like(v))
    recording = Recording.of(scene, "", motion, 0.01, v, np.array([1e-4]))
    assert _held(recording, 1e-6).sum() == 0
    settled = (t > 1.255) & (t < 1.895)  # 0.25 s after the stop, 0.1 s before the departure
    assert (_held(recording, 3e-4)[:, 0] == settled).all()
    short_rest = np.where(slow, 1.0, 0.0) * (
        t < 1.4
    )  # a reversal, where filters and presliding act
    still = v * (1.0 - short_rest[:, None])
    turned = replace(recording, velocity=still, acceleration=np.where(still == 0.0, 0.0, 1.0))
    assert turned.rests.sum() > 30
    assert _held(turned, 1e-6).sum() == 0
    assert stick_velocity(scene, [recording]) == pytest.approx(3e-4)
    assert stick_velocity(scene, [replace(recording, noise=np.array([1.0]))]) == STILL


@pytest.mark.parametrize("side", ["motor", "joint"])
@pytest.mark.parametrize("way", [FORWARD, BACKWARD])
def test_a_gears_loss_is_taken_out_of_what_a_joint_broke_away_at(side, way):
    """A load of 10 N m, a gear that loses a tenth of it driving and driven, some 2 N m of friction.

    Of three values 4.3027 standard errors are the interval's reach (Student's, two degrees).
    """
    sign, load, loss = (1.0 if way == FORWARD else -1.0), 10.0, 0.1
    held, moved = np.arange(1, 41) / 40, np.full(15, 0.75)
    friction = np.outer([1.8, 2.2, 2.0], np.concatenate((held, moved))).ravel()
    rests = np.tile(np.arange(55) < 40, 3)
    losing = 1.0 + sign * loss  # the load is lifted forward, let down backward
    effort = (
        (load + sign * friction) * losing if side == "joint" else load * losing + sign * friction
    )
    slots = (loss * (np.arange(len(SLOTS)) == GEARS[side, "both"]))[None, :]
    recording = SimpleNamespace(
        trajectory=SimpleNamespace(t=0.02 * np.arange(165)),
        step=0.02,
        rests=rests[:, None],
        velocity=np.where(rests, 0.0, sign)[:, None],
        effort=effort[:, None],
    )
    found = SimpleNamespace(
        choice=SimpleNamespace(laws=[SimpleNamespace(load="gear", side=side)]),
        fit=Fit(np.zeros(10), slots),
        delay=SimpleNamespace(value=0.0),
        prepared=[
            SimpleNamespace(
                recording=recording, load=np.full((165, 1), load), missing=np.zeros((165, 1))
            )
        ],
    )
    ((key, broke),) = break_aways(found).items()
    assert key == (0, way)
    reach = 4.3027 * 0.2 / np.sqrt(3.0)
    ends = broke.mean, broke.low, broke.high
    assert ends == pytest.approx((2.0, 2.0 - reach, 2.0 + reach), rel=1e-4)
