"""Logs that do not fit the robot: signs, gains, two robots, too little motion."""

from __future__ import annotations

import re
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from identify_cases import (
    DELAY,
    NAMES,
    PLAIN,
    excitation,
    fit_of,
    guess,
    log,
    one_joint,
    rows_of,
    short,
    true_friction,
    truth,
)
from identify_wrong_models import wrong_log

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.checks import _scale, check_efforts, check_one_robot
from pinfric.identification.columns import joint_rows, prepare
from pinfric.identification.identify import beside_measured
from pinfric.identification.laws import BACKWARD, FORWARD, Law
from pinfric.identification.normal import Fit
from pinfric.identification.recordings import read_recordings
from pinfric.motions.log.reading import ReadingOptions


def test_currents_without_a_gain_and_turned_signs_are_refused_by_name():
    current = replace(short(), effort=short().effort * np.array([1, 0.07, 1, 1, 1, 1]))
    with pytest.raises(IdentificationError, match=rf"{NAMES[1]}: its effort is 0\.0\d+ times"):
        pf.identify(guess(0), current)
    turned = replace(short(), effort=short().effort * np.array([1, 1, -1, 1, 1, 1]))
    with pytest.raises(
        IdentificationError, match=f"^log: joint {NAMES[2]}: its effort falls where"
    ):
        pf.identify(guess(0), turned)
    # no weight tells it at the last joint: its friction does
    turned = replace(short(), effort=short().effort * np.array([1, 1, 1, 1, 1, -1]))
    with pytest.raises(IdentificationError, match=f"{NAMES[5]}: its effort acts against"):
        pf.identify(guess(0), turned)


@pytest.mark.parametrize("factor", [6.0, 10.0, 100.0, 1000.0])
def test_efforts_off_by_a_factor_are_asked_about_at_joints_that_carry(factor):
    wrong = replace(short(), effort=factor * short().effort)
    with pytest.raises(
        IdentificationError, match=rf"{NAMES[1]}: its effort is [\d.e+]+ times"
    ) as e:
        pf.identify(guess(0), wrong)
    told = float(re.search(rf"{NAMES[1]}: its effort is ([\d.e+]+) times", str(e.value))[1])
    assert 0.7 * factor < told < 1.4 * factor  # the URDF's masses are wrong by 20 %


@pytest.mark.parametrize(
    ("joint", "factor"), [(1, 0.7), pytest.param(2, 0.7, marks=pytest.mark.slow), (1, 1.3)]
)
def test_efforts_off_by_a_factor_are_refused_where_masses_are_kept(joint, factor):
    """No gain of 0.7 is within what a URDF's masses are wrong by, but for those that are kept."""
    scale = np.where(np.arange(6) == joint, factor, 1.0)
    given = replace(short(), effort=scale * short().effort)
    with pytest.raises(IdentificationError, match=f"joint {NAMES[joint]}: its effort holds") as e:
        pf.identify(truth(), given, inertia="keep", laws=PLAIN)
    told, reach = re.search(r"holds ([\d.]+) \+- ([\d.]+) times", str(e.value)).groups()
    assert abs(float(told) - factor) < float(reach) + 0.02 * factor < 0.05  # losses differ by 0.02
    confirmed = pf.identify(truth(), given, inertia="keep", laws=PLAIN, gain={NAMES[joint]: 1.0})
    assert f"{NAMES[joint]} {told} +- " in "\n".join(confirmed.notes)


def test_efforts_without_gravity_are_named_and_give_friction_but_no_inertias():
    motion, scene, nothing = excitation(0, 20.0, 100.0), truth(), np.zeros(6)
    model, data = scene.model, scene.model.createData()
    gravity = np.array([pin.rnea(model, data, q, nothing, nothing) for q in motion.q])
    late = np.column_stack([np.interp(motion.t - DELAY, motion.t, g) for g in gravity.T])
    laws = PLAIN | {NAMES[1]: Law(load="gear"), NAMES[2]: Law(load="bearing")}
    found = pf.identify(guess(0), replace(short(), effort=short().effort - late), laws=laws)
    assert any(line.startswith("the efforts hold no gravity") for line in found.doubts)
    assert found.keeps_inertias
    kept = zip(found.scene.model.inertias, guess(0).model.inertias, strict=True)
    assert all(one == other for one, other in kept)
    inside = [p.low <= x <= p.high for p, x in true_friction(found)]
    assert np.mean(inside) > 0.8
    assert abs(found.delay - DELAY) < 2.5 * found.estimate.delay.standard_error < 4e-3
    # efforts beside computed ones are whole again
    result, judged = beside_measured(found)
    lift = judged.reading.effort[NAMES[1]]
    off = lift - 0.5 * (result.effort_lower + result.effort_upper)[:, 1]
    assert np.sqrt(np.mean(off**2)) < 0.35 * np.sqrt(np.mean(lift**2))


def test_a_turned_sign_shows_by_inertia_where_it_is_more_than_friction(tmp_path):
    t = np.arange(0.0, 12.0, 0.01)
    model = chain(("turntable", pin.JointModelRZ(), lump(5.0, moment=1.0)))
    effort = 0.5 * np.sign(np.cos(3.0 * t)) - 9.0 * np.sin(3.0 * t)
    given = pf.Log(t, np.sin(3.0 * t)[:, None], effort[:, None])
    found = pf.identify(pf.Scene(model), given, laws={"turntable": Law()})
    assert found.errors["turntable"].error < 0.05 * found.errors["turntable"].rms
    with pytest.raises(IdentificationError, match="turntable: its effort acts against") as turned:
        pf.identify(pf.Scene(model), replace(given, effort=-effort[:, None]))
    # what it says to do
    assert "`effort_scale: -1` turns the effort alone" in str(turned.value)
    rows = np.column_stack((t, given.q, -effort))
    header = "t,turntable,drive"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", fmt="%.9g", header=header, comments="")
    (tmp_path / "log.columns.yaml").write_text(
        "joints: {turntable: {position: turntable, effort: drive, effort_scale: -1}}\n"
    )
    mended = pf.identify(pf.Scene(model), tmp_path / "log.csv", laws={"turntable": Law()})
    for own, before in zip(mended.parameters, found.parameters, strict=True):
        assert own.value == pytest.approx(before.value, rel=1e-3, abs=1e-6)


def test_efforts_that_were_not_measured_and_logs_that_hardly_move_are_refused():
    dead = short().effort * np.array([1, 1, 0, 1, 1, 1])
    with pytest.raises(IdentificationError, match=f"joint {NAMES[2]}: its effort is always 0"):
        pf.identify(guess(0), replace(short(), effort=dead))
    # 5 s of 20: then it comes to rest
    rate, since = 100.0, np.maximum(np.arange(len(short().q)) - 500, 0)[:, None] / 100.0
    runs_out = 0.1 * rate * (short().q[500] - short().q[499]) * (1.0 - np.exp(-since / 0.1))
    stays = np.where(since > 0.0, short().q[500] + runs_out, short().q)
    with pytest.raises(IdentificationError, match="in 3 blocks of"):
        pf.identify(guess(0), replace(short(), q=stays))


@pytest.mark.slow
def test_logs_of_two_robots_are_refused():
    other = replace(short(3), effort=2.2 * short(3).effort, name="other")
    with pytest.raises(IdentificationError, match=r"logs of two robots.* LOG=none"):
        pf.identify(guess(0), [short(), other], laws=PLAIN)
    carry = {"log": "none", "other": "none"}
    assert pf.identify(guess(0), [short(), other], laws=PLAIN, payloads=carry).doubts


@pytest.mark.parametrize(
    ("load", "second", "loss", "refused"),
    [
        (1.0, 2.0, 0.0, True),
        (0.05, 2.0, 0.0, False),  # it hardly carries
        (1.0, 1.0, 0.27, False),  # a gear that no law has: it lifts in one log, lowers in another
    ],
)
def test_two_robots_are_logs_that_carry_and_explain_each_other_worse_than_themselves(
    load, second, loss, refused
):
    """Efforts are the load of 1 kg, `second` in the second log, friction, and a gear's loss."""
    sway, log, way = np.sin(np.linspace(0.0, 40.0, 400)), np.repeat([0, 1], 200), np.ones(400)
    way[200:] = -1.0  # what is lifted in one log is lowered in the other, but for a tenth of rows
    way[::10] *= -1.0
    rigid = load * (2.0 + sway)[:, None]
    effort = rigid[:, 0] * (np.where(log, second, 1.0) + loss * way) + way
    rows = rows_of(effort, {FORWARD: way}, rigid, log=log)

    def fit(part: np.ndarray) -> Fit:
        return fit_of({FORWARD: 1.0}, np.linalg.lstsq(rigid[part], (effort - way)[part])[0])

    fits = [fit(part) for part in (log >= 0, log == 0, log == 1)]
    with pytest.raises(IdentificationError, match="two robots") if refused else nullcontext():
        check_one_robot(["a"], [rows], fits, ["one", "two"])


def test_robots_whose_efforts_no_log_tells_apart_are_refused():
    with pytest.raises(IdentificationError, match="the loop"):
        pf.identify(pf.load_scene("four_bar"), short())


def test_an_unknown_payload_is_no_factor_on_efforts():
    """Both enlarge joints' efforts; a factor is still asked about."""

    logs = {case: wrong_log(case, 200, 10.0, 125.0) for case in ("payload", "true")}

    def check(case: str, factor: np.ndarray | float) -> None:
        given = replace(logs[case], effort=logs[case].effort * factor)
        (one,) = read_recordings(truth(), [given], {}, {}, ReadingOptions())
        columns = prepare(truth(), one)
        check_efforts(truth(), [joint_rows([columns], j, 0.0) for j in range(6)], "log", ())

    check("payload", 1.0)
    for joints in ([1], range(6)):
        with pytest.raises(IdentificationError, match="shoulder_lift_joint: its effort is 2"):
            check("true", np.where(np.isin(np.arange(6), joints), 2.0, 1.0))


@pytest.mark.parametrize("factor", [10.0, 1000.0])
def test_efforts_of_a_wrist_beyond_its_limit_are_refused(factor):
    """Before, N mm gave Coulomb friction of thousands of N m at a joint with a limit of 28."""
    scale = np.where(np.arange(6) == 5, factor, 1.0)  # no weight tells its unit
    given = replace(short(), effort=short().effort * scale)
    with pytest.raises(IdentificationError, match=f"joint {NAMES[5]}: its .* limits it to 28"):
        pf.identify(guess(0), given, laws=PLAIN)


@pytest.mark.parametrize(("slope", "refused"), [(1.7, False), (4.0, True)])
def test_a_small_load_is_asked_about_where_masses_wrong_by_20_percent_do_not_explain_it(
    slope, refused
):
    """A pendulum whose weight makes a tenth of its effort: eight deviations are a factor of 2.6."""
    scene = one_joint()
    q, rng, still = np.linspace(0.0, 6.0, 200), np.random.default_rng(0), np.zeros(1)
    model, data = scene.model, scene.model.createData()
    rigid = [pin.computeJointTorqueRegressor(model, data, x[None], still, still) for x in q]
    forward = rng.choice([0.0, 1.0], 200)
    columns = {FORWARD: forward, BACKWARD: forward - 1.0}
    effort = 80.0 * (2.0 * forward - 1.0) - slope * 9.81 * np.cos(q)
    with pytest.raises(IdentificationError, match="is 4 times") if refused else nullcontext():
        check_efforts(scene, [rows_of(effort, columns, np.reshape(rigid, (200, 10)))], "log", ())


@pytest.mark.parametrize(("wrong", "where"), [("effort", [0]), ("speed", [0, 1, 2])])
def test_kept_links_are_judged_by_their_inertia(wrong, where):
    """An effort at the upright axis carries no weight; stamps do not change what others carry."""
    given, said = log(3, 30.0, 125.0), "times the inertia of the URDF's links"
    right = pf.identify(truth(), given, laws=PLAIN, inertia="keep")
    assert not any(said in line for line in right.notes)
    assert any("stamped time over true time is [0.9" in line for line in right.notes)
    stamps, effort = given.t, np.array(given.effort)
    if wrong == "effort":
        effort[:, 0] *= 0.65
    else:
        stamps = stamps[0] + 2 * (stamps - stamps[0])
    given = replace(given, t=stamps, effort=effort)
    doubts = pf.identify(truth(), given, laws=PLAIN, inertia="keep").doubts
    (line,) = (line for line in doubts if said in line)
    assert all(NAMES[j] in line for j in where), line
    clock = [line for line in doubts if line.startswith("stamped time over true time is [1.")]
    assert len(clock) == (wrong == "speed"), doubts


def test_gravity_is_the_same_share_of_an_effort_times_a_factor():
    """Before, of 1.5 times the effort it was two thirds of that share, and too little to judge."""
    random = np.random.default_rng(4)
    column, block = random.normal(size=200), np.arange(200) // 20
    effort = 1.5 * column + 5.0 * random.normal(size=200)
    one, three = (
        _scale(rows_of(k * effort, {}, block=block), column, np.ones((200, 1))) for k in (1.0, 3.0)
    )
    assert three.value == pytest.approx(3.0 * one.value)
    assert one.value > 1.0
    assert three.share == pytest.approx(one.share)
