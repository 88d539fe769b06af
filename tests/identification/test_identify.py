"""Identification against hidden truth, against a robot's own log, and against bad logs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from cli_cases import refused, told
from identify_cases import (
    COULOMB,
    DELAY,
    NAMES,
    PLAIN,
    ROTOR,
    VISCOUS,
    csv_log,
    excitation,
    guess,
    log,
    motor_effort,
    one_joint,
    parameter,
    short,
    truth,
)
from printed import assert_printed

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.files import scene_text
from pinfric.identification.identify import beside_measured
from pinfric.identification.prediction import unseen_errors
from pinfric.identification.summary import identify_summary
from pinfric.model.described import in_json
from pinfric.model.schema import Assumed
from pinfric.show.timeline.frames import make_frames

#: rad over which friction builds up after a reversal.
WAY = 8e-3


def test_an_unseen_motion_takes_the_efforts_that_the_true_robot_needs(found):
    motion = excitation(99, 20.0, 100.0)
    true, ours = (motor_effort(scene, motion) for scene in (truth(), found.scene))
    error = np.sqrt(np.mean((true - ours) ** 2, axis=0) / np.mean(true**2, axis=0))
    assert (error < 0.03).all(), error


def test_what_follows_the_urdf_is_as_uncertain_as_that(found):
    # a rotor on a vertical axis: its inertia is told from that of the links by the URDF alone
    rotor = parameter(found, "transmission", 0, "rotor_inertia")
    assert rotor.low < ROTOR[0] < rotor.high
    assert not rotor.determined


def test_a_held_out_log_is_predicted_to_its_noise(found):
    errors = found.unseen["other"]
    assert all(error.error < 0.03 * error.rms for error in errors.values())


def test_friction_that_builds_up_is_in_the_error_of_all_that_moves(found):
    recording = found.recordings[0]
    t, v = recording.trajectory.t, recording.velocity
    lacks, since = np.zeros_like(v), np.ones(6)  # F_C sign v exp(-x/WAY), and x of each joint
    for k in range(1, t.size):
        since = np.where(v[k] * v[k - 1] <= 0.0, 0.0, since + np.abs(v[k]) * (t[k] - t[k - 1]))
        lacks[k] = np.where(v[k] < 0.0, *np.array(COULOMB).T[::-1] * np.sign(v[k]))
        lacks[k] *= np.exp(-since / WAY)
    late = np.column_stack([np.interp(t - DELAY, t, column) for column in lacks.T])
    other = replace(recording, effort=recording.effort - late)
    before, after = (unseen_errors(found.estimate, found.scene, x) for x in (recording, other))
    for name, added in zip(before, np.sqrt(np.mean(lacks**2, axis=0)), strict=True):
        grew = np.sqrt(after[name].moving_error ** 2 - before[name].moving_error ** 2)
        assert 0.6 * added < grew < 1.05 * added, name  # the low pass takes some of it
        assert before[name].moving_error < 1.1 * before[name].error, name
        assert after[name].moving_error > 1.1 * after[name].error, name


@pytest.mark.slow
def test_a_log_as_it_is_has_one_error_in_identify_and_inverse(found, tmp_path):
    """`inverse` of the written scene along the log says what the identified scene says."""
    found.save(tmp_path)
    result, log = beside_measured(found)
    again = pf.inverse_dynamics(pf.load_scene(tmp_path / "scene.yaml"), result.states)
    for ours, theirs in (
        (result.joint_effort_lower, again.joint_effort_lower),
        (result.joint_effort_upper, again.joint_effort_upper),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9)
    assert set(log.measured) == set(found.errors)


def test_a_replay_marks_where_the_log_is_off(found):
    result, log = beside_measured(found)
    good = make_frames(found.scene, result, 10.0, log).off
    effort = {
        name: (1.5 if name == NAMES[1] else 1.0) * y for name, y in log.reading.effort.items()
    }
    wrong = replace(log, reading=replace(log.reading, effort=effort))
    bad = make_frames(found.scene, result, 10.0, wrong).off

    def length(spans) -> float:
        return sum(end - start for start, end in spans)

    assert list(good) == list(NAMES)
    for name in NAMES:
        (_, strong), (mild, now_strong) = good[name], bad[name]
        assert length(strong) < 0.05 * result.t[-1]
        assert (length(now_strong) > 0.3 * result.t[-1]) == (name == NAMES[1])
        assert length(mild) >= length(now_strong)


@pytest.mark.slow
def test_joints_that_the_model_does_not_explain_are_named_and_get_no_laws(tmp_path):
    turned = replace(short(), q=short().q * np.array([1, -1, 1, 1, 1, 1]))
    guesses = {f"friction.{NAMES[j]}.viscous": "2 % of its load" for j in (0, 2)}
    assumed = Assumed(by="pinfric new arm.urdf", date="2026-11-22", version="0", values=guesses)
    found = pf.identify(guess(0).with_(assumed=assumed), turned, inertia="keep", laws=PLAIN)
    assert set(found.scene.assumed.values) == {f"friction.{NAMES[2]}.viscous"}
    line = next(line for line in found.notes if line.startswith("the model does not explain it"))
    assert NAMES[1] in line
    assert NAMES[2] in line
    assert (
        set(found.laws) == {NAMES[j] for j in (0, 3, 4, 5)} == {p.joint for p in found.parameters}
    )
    assert found.law_of(NAMES[1]) == "not explained"
    assert found.scene.friction[NAMES[2]] == guess(0).friction[NAMES[2]]
    assert not any(NAMES[1] in key for key in (*found.posterior, *found.advice[0].factors))
    robot = pf.load_scene("ur5_pick_and_place").robot
    text = scene_text(found, robot, tmp_path)
    assert f"  {NAMES[2]}: # not explained by the logs: value of the scene\n" in text
    assert list(yaml.safe_load(text)["assumed"]["values"]) == [f"friction.{NAMES[2]}.viscous"]
    text = in_json(identify_summary(found))["joints"][1]
    assert (text["law"], text["error"]["error"] > 0.5 * text["error"]["rms"]) == (None, True)
    noise = np.random.default_rng(0).normal(size=short().effort.shape)
    with pytest.raises(IdentificationError, match="the model explains no joint's effort"):
        pf.identify(guess(0), replace(short(), effort=noise), inertia="keep", laws=PLAIN)


@pytest.mark.slow
def test_a_log_of_six_seconds_is_taken_with_wider_intervals():
    brief = replace(short(), t=short().t[:600], q=short().q[:600], effort=short().effort[:600])
    steps = []
    less = pf.identify(guess(0), brief, laws=PLAIN, progress=lambda *step: steps.append(step))
    more = pf.identify(guess(0), short(), laws=PLAIN)
    assert steps == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert less.estimate.problem.folds.size == 6
    width = [
        [(p.high - p.low) / p.value for p in one.parameters if p.name == "viscous"]
        for one in (less, more)
    ]
    # a third of the time is the square root of three; few blocks, and what they pull, come on top
    assert np.nanmedian(np.divide(*width)) > 1.8
    inside = [
        p.low <= VISCOUS[NAMES.index(p.joint)] <= p.high
        for p in less.parameters
        if p.name == "viscous" and p.determined
    ]
    assert np.mean(inside) > 0.8


@pytest.mark.slow
def test_the_command_writes_what_runs(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    urdf = "example-robot-data:ur_description/urdf/ur5_robot.urdf"
    Path("arm.yaml").write_text(f"pinfric: 1\nrobot: {{urdf: '{urdf}'}}\n")
    csv_log(tmp_path / "arm.csv", 2, rate=40.0)
    given = "identify", "arm.yaml", "arm.csv"
    out = told(capsys, *given, "--inertia", "keep", "--out", "found").out
    assert_printed(__file__, "identify", out)
    written = {path.name for path in Path("found").iterdir()}
    assert {"scene.yaml", "posterior.csv", "sweep.yaml", "report.html", "summary.json"} <= written
    assert "robot.urdf" not in written
    again = "inverse", "found/scene.yaml", "arm.csv", "--effort-at", "motor", "--out", "again"
    out = told(capsys, *again).out
    assert_printed(__file__, "inverse_of_a_log", out)
    assert Path("again/measured.png").stat().st_size > 10_000
    for bad, said in (
        (("--gain", "elbow"), "should be NAME=VALUE"),
        (("--effort-at", "shaft"), "'--effort-at': 'shaft'"),
    ):
        assert said in refused(capsys, *given, *bad)


@pytest.mark.parametrize("gap", [8.0, 30.0])
def test_a_wrist_that_turns_seldom_and_fast_is_taken_with_a_doubt(gap):
    """20 Hz, turns of 0.2 s: two or three samples of each slide, all at one speed."""
    random, t = np.random.default_rng(0), np.arange(0.0, 240.0, 0.05)
    q, effort = np.zeros_like(t), 0.02 * random.normal(size=t.size)
    for k, start in enumerate(np.arange(4.0, 236.0, gap)):
        s = np.clip((t - start) / 0.2, 0.0, 1.0)
        v = (-1) ** k * 2.5 * (30.0 * s**2 - 60.0 * s**3 + 30.0 * s**4)
        q += (-1) ** k * 0.5 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
        effort += np.sign(v) * (np.abs(v) > 1e-9) * (2.0 + 0.5 * np.abs(v))
    found = pf.identify(one_joint(), pf.Log(t, q[:, None], effort[:, None]))
    (error,) = found.errors.values()
    assert error.moving_share > 10.0 * error.share
    assert "far above that of the fitted ones" in found.doubts[0]
    assert all(p.name != "rotor_inertia" for p in found.parameters)
    entry = found.scene.friction["arm"].coulomb.positive
    assert 1.0 < entry.kinetic < 10.0


def test_a_joint_that_moves_in_one_log_of_five_keeps_its_friction():
    """Before, whole logs were held out, and with one of them all that was known of the joint."""
    pairs = [(0, 3), (1, 4), (2, 5), (0, 3), (1, 4)]
    logs = [
        log(60 + k, 15.0, 125.0, still=set(range(6)) - set(pair)) for k, pair in enumerate(pairs)
    ]
    found = pf.identify(guess(60), logs, laws=PLAIN)
    assert set(found.laws) == set(NAMES)
    assert all(error.share < 0.1 for error in found.errors.values())
