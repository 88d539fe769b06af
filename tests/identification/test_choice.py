"""Laws of joints: the smallest that is as good on held-out blocks."""

from dataclasses import replace

import numpy as np
import pytest
from identify_cases import (
    DELAY,
    LOGS,
    NAMES,
    RATIO,
    VISCOUS,
    excitation,
    guess,
    kr300,
    motor_effort,
    needs_logs,
    one_joint,
    truth,
)

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.choice import (
    free_errors,
    held_out_parts,
    not_ruled_out,
    simplest_adequate_law,
)
from pinfric.identification.laws import Law, candidates

#: What a UR10's held-out errors may be beside those of Coulomb and viscous friction.
UR10 = (0.70, 0.52, 0.75, 0.82, 1.05, 1.10)


def test_the_laws_that_made_the_log_are_found(found):
    loads = [law.load for law in found.laws.values()]
    assert loads == ["", "gear", "bearing", "", "", ""]
    assert all(law.exponent == 1.0 for law in found.laws.values())
    assert found.delay == pytest.approx(DELAY, abs=1.5e-3)


@pytest.mark.slow
def test_a_gear_is_offered_whose_own_loss_makes_the_coulomb_friction_large():
    scene = truth()
    dry = {"static": 8.0, "kinetic": 8.0}
    friction = scene.friction | {
        NAMES[2]: {"coulomb": {"positive": dry, "negative": dry}, "viscous": VISCOUS[2]}
    }
    gears = [
        {
            "joint": drive.name,
            "transmission": {"ratio": RATIO}
            | ({"efficiency": 0.7, "back_efficiency": 0.65} if drive.name == NAMES[2] else {}),
        }
        for drive in scene.drives
    ]
    robot, motion = scene.with_(friction=friction, actuators=gears), excitation(0, 20.0, 100.0)
    given = pf.Log(motion.t, motion.q, motor_effort(robot, motion))
    laws = {name: Law() for name in NAMES if name != NAMES[2]}
    found = pf.identify(guess(0), given, laws=laws)
    assert found.laws[NAMES[2]].load == "gear"
    assert found.errors[NAMES[2]].error < 0.5 * found.errors[NAMES[2]].plain
    assert any(NAMES[2] in line for line in found.notes if line.startswith("with free masses"))
    assert found.advice[0].load > 0.0  # nothing else tells the scale of masses and losses


def test_two_losses_are_weighed_whatever_is_known_of_the_masses(found):
    weighed = found.estimate.choice.errors[1]
    assert any(law.load == "gear" and not law.both_ways for law in weighed)
    assert found.laws[NAMES[1]].both_ways  # losses of 5 and 7 % are as good as one
    assert found.advice[0].load > 0.0


def test_of_laws_that_are_as_good_the_viscous_one_is_taken():
    rows, powers = np.full(4, 100.0), {1.0: 101.0, 0.8: 100.0, 0.5: 150.0}
    noise = np.array([-1.0, 1.0, -2.0, 2.0])
    errors = {Law(exponent=p): total / 4 + (0.1 + p) * noise for p, total in powers.items()}
    assert simplest_adequate_law(errors, rows) == Law()
    assert simplest_adequate_law(errors | {Law(): np.full(4, 40.0)}, rows) == Law(exponent=0.8)


def test_other_loads_and_two_losses_stay_unless_they_are_clearly_worse():
    chosen, both = Law(load="gear"), Law(load="gear", both_ways=False)
    noise, rows = np.array([-1.0, 1.0, -1.0, 1.0]), np.full(4, 100.0)
    worse = {Law(): 1.0, Law(load="bearing"): 3.0, both: 0.5, Law(load="bearing", exponent=0.5): 0}
    errors = {chosen: np.full(4, 9.0)} | {law: 9.0 + x + noise for law, x in worse.items()}
    # 2 standard errors of the sum are 2 sqrt(4 * 4/3) = 4.6; the last has another power
    assert not_ruled_out(chosen, errors, rows) == (both, Law())


def test_a_fall_is_offered_where_a_scene_can_state_it():
    falls = {(law.load, law.side) for law in candidates(True, True, True, True) if law.stribeck}
    assert falls == {("", "joint"), ("bearing", "joint"), ("gear", "joint")}
    assert not any(law.stribeck for law in candidates(True, True, True))


@pytest.mark.parametrize("n", [pytest.param(1.0, marks=pytest.mark.slow), 2.0])
def test_friction_that_falls_with_speed_under_load_and_not_without_is_found(n):
    """An arm of 2 kg, 0.5 m out: 0.65 N m, and of what it carries 23 % at rest, 2 % in motion."""
    t, rest, moving, dry, falls = np.arange(0.0, 80.0, 0.01), 0.23, 0.02, 0.65, 0.12
    q = 1.2 * np.sin(0.5 * t) + 0.7 * np.sin(0.23 * t)
    v = 0.6 * np.cos(0.5 * t) + 0.161 * np.cos(0.23 * t)
    a = -0.3 * np.sin(0.5 * t) - 0.03703 * np.sin(0.23 * t)
    rigid = (2.0 * 0.25 + 0.01) * a - 2.0 * 9.81 * 0.5 * np.cos(q)
    mu = moving + (rest - moving) * np.exp(-((np.abs(v) / falls) ** n))
    effort = rigid + np.sign(v) * (mu * np.abs(rigid) + dry)
    noise = 0.05 * np.random.default_rng(2).normal(size=t.size)
    given = pf.Log(t, q[:, None], (effort + noise)[:, None])
    found = pf.identify(one_joint(), given, inertia="keep")
    assert found.laws["arm"] == Law(exponent=None, load="bearing", load_stribeck=True)
    assert found.doubts == ()
    true = {"mu": moving, "mu.static": rest, "stribeck.velocity": falls}
    true |= {"coulomb.positive": dry, "coulomb.negative": dry}
    known = [p for p in found.parameters if p.name in true]
    assert {p.name for p in known} == set(true)
    assert sum(p.low <= true[p.name] <= p.high for p in known) >= 4
    assert all(p.value == pytest.approx(true[p.name], rel=0.05) for p in known)
    entry = found.scene.friction["arm"]
    assert (entry.bearing.kind, entry.stribeck.exponent) == ("gear", n)
    for place, carried in ((0.0, 9.81), (np.pi / 2, 0.0)):
        for speed in (0.03, 0.3):  # as the scene computes it
            one = pf.inverse_dynamics(found.scene, [[place]], [[speed]], [[0.0]])
            excess = (rest - moving) * np.exp(-((speed / falls) ** n))
            friction = (moving + excess) * carried + dry
            off = one.effort_lower[0, 0] - one.effort_frictionless[0, 0] - friction
            assert abs(off) < 0.05 * friction, (place, speed)


def test_every_part_that_is_held_out_leaves_something_to_fit():
    sliding = np.repeat(np.arange(300, 304), 9)  # of 720 blocks of an hour
    one = np.zeros_like(sliding)
    assert len(set(held_out_parts(one, sliding, one)[300:])) == 4
    logs = np.repeat([1, 3], 18)  # of five logs
    assert len(set(held_out_parts(one, sliding, logs)[300:])) == 4
    each = np.repeat(np.arange(0, 12, 2), 9)
    assert held_out_parts(0 * each, each, each // 2)[::2].tolist() == [0, 1, 2, 3, 4, 5]


def test_no_part_takes_a_joint_that_moves_in_one_log_of_five():
    """Joint 0 in logs 0 and 3, joint 1 in 1 and 4, joint 2 in 2 alone, of 8 blocks each."""
    block = np.repeat(np.arange(40), 6)
    log = block // 8
    joint = log % 3
    parts = held_out_parts(joint, block, log)
    for j in range(3):
        taken = np.bincount(parts[block[joint == j]])
        assert taken.max() <= 0.25 * taken.sum()
    short = np.where(joint == 2, 17, block)  # one block cannot be divided
    assert held_out_parts(joint, short, log).max() < 10


@pytest.mark.slow
def test_a_ur10_is_told_better_than_by_coulomb_and_viscous_friction(ur10):
    share = [error.error / error.plain for error in ur10.errors.values()]
    assert (np.array(share) <= UR10).all(), share
    lift = tuple(ur10.laws.values())[1]
    assert (lift.load, lift.side) == ("gear", "motor")


@pytest.mark.slow
@needs_logs
def test_a_kr300_whose_signs_nobody_knows_says_how_far_it_is_off():
    scene, log = kr300(LOGS / "kr300" / "rec_2020-10-21_10s_FF_A_08ms.mat")
    found = pf.identify(scene, log, laws=dict.fromkeys(scene.joint_names, Law()))
    share = {name: error.error / error.rms for name, error in found.errors.items()}
    assert all(0.02 < one < 0.5 for one in share.values()), share
    missed = next(line for line in found.notes if line.startswith("the error is above 10 %"))
    assert max(share, key=share.__getitem__) in missed
    worse = next((line for line in found.notes if line.startswith("held-out errors are")), "")
    free = free_errors(found.estimate.problem, found.estimate.rows)
    for (name, error), least in zip(found.errors.items(), free, strict=True):
        assert (error.error > 1.03 * least) == (f"{name} by" in worse)
    turned = replace(log, q=-log.q, effort=-log.effort)
    with pytest.raises(IdentificationError, match="joint a4: its effort falls where"):
        pf.identify(scene, turned, laws=dict.fromkeys(scene.joint_names, Law()))
