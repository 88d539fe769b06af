"""Ways over which friction builds up, found from logs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from identify_cases import (
    DELAY,
    NAMES,
    PLAIN,
    Motion,
    count_goes_on,
    guess,
    log,
    logged,
    motor_effort,
    truth,
)
from identify_wrong_models import WAY, wrong_log

import pinfric as pf
from pinfric.identification import ways
from pinfric.identification.columns import prepare, shares
from pinfric.identification.inertias import urdf_prior
from pinfric.identification.notes import _of_ways
from pinfric.identification.prediction import after_reversals
from pinfric.identification.recordings import read_recordings
from pinfric.identification.uncertainty import uncertainty
from pinfric.identification.ways import TRIED, Build, Way, _refusal, find_ways
from pinfric.motions.log.reading import ReadingOptions


@pytest.fixture(scope="module")
def building():
    """Friction of six joints that builds up over 5 mrad, after Dahl, from 30 s of log."""
    log, told = wrong_log("presliding", 21, 30.0, 125.0), list[tuple[int, int]]()
    found = pf.identify(guess(21), log, laws=PLAIN, progress=lambda *step: told.append(step))
    count_goes_on(told)  # though it is fitted once more, without ways
    return found


def test_each_way_is_found_and_its_interval_holds_it(building):
    ways = {p.joint: p for p in building.parameters if p.name == "presliding.way"}
    assert set(ways) == set(NAMES)
    for name in (NAMES[0], *NAMES[3:]):  # the gears of two joints lose by their load, too
        p = ways[name]
        assert p.low < WAY < p.high, name
        assert p.high / p.low < 1.8, name
        assert p.determined
    entries = [building.scene.friction[name].presliding for name in NAMES]
    assert {entry.shape for entry in entries} == {"gradual"}
    # a gradual shape is found up to some ms early: the delay's error says so
    assert 2e-3 < building.estimate.delay.standard_error < 3e-3
    assert any("friction builds up gradually after reversals" in note for note in building.notes)


def test_intervals_hold_the_errors_of_ways_and_of_their_delay(building, monkeypatch):
    whole = uncertainty(building.estimate, building.misfits)
    monkeypatch.setattr("pinfric.identification.uncertainty._other_ways", lambda *_: iter(()))
    taken_as_known = uncertainty(building.estimate, building.misfits)
    wider = np.sqrt(np.diag(whole.within) / np.diag(taken_as_known.within))
    assert wider.min() >= 1.0
    assert wider.max() > 2.0


def test_errors_after_reversals_are_those_elsewhere(building):
    """Without the ways they are several times as large, and a doubt names presliding."""
    for name, error in building.errors.items():
        assert error.reversal_error < 2.0 * error.error, name
    assert not any("presliding" in doubt for doubt in building.doubts)


def test_where_friction_jumps_no_way_is_found(found):
    assert not found.estimate.builds_up
    assert not any("presliding" in p.name for p in found.parameters)
    assert all(entry.presliding is None for entry in found.scene.friction.values())


@pytest.mark.slow
@pytest.mark.parametrize("case", ["delay", "motor turn", "filter"])
def test_what_only_looks_like_a_way_is_none(case):
    found = pf.identify(guess(31), wrong_log(case, 31, 40.0, 125.0), laws=PLAIN)
    assert not found.estimate.builds_up


def ways_of(log):
    """Ways and delay of a log by themselves, no laws chosen."""
    scene = guess(21)
    (recording,) = read_recordings(scene, [log], {}, {}, ReadingOptions())
    prior = urdf_prior(scene.model, kept=False)
    return find_ways([prepare(scene, recording)], prior, np.ones(6, dtype=bool))


def test_what_falls_from_rest_makes_no_way_shorter_and_no_effort_later(monkeypatch):
    """LuGre's bristles with half more friction at rest, over 5 mrad."""
    log = wrong_log("lugre", 21, 20.0, 125.0)
    build = ways_of(log)
    assert build.delay == pytest.approx(DELAY, abs=1.5e-3)
    for j in (0, 3, 4, 5):  # the gears of two joints lose by their load, too
        way = build.ways[j]
        assert abs(np.log(way.value / WAY)) < 1.96 * way.error, j
    monkeypatch.setattr(ways, "_with_falling", lambda logs, fit: fit)
    alone = ways_of(log)
    assert alone.delay > DELAY + 1e-2
    found = [alone.ways[j] for j in (0, 3, 4, 5)]
    assert all(way is None or way.value < 0.5 * WAY for way in found)


def test_joints_that_reverse_three_times_are_not_asked_and_it_says_so():
    t, rate = np.arange(0.0, 20.0, 0.01), 0.16 * np.pi
    phase = rate * (t[:, None] - np.array([2.0, 2.7, 3.4, 4.1, 4.8, 5.5]))
    middle = np.array([0.0, -1.2, 1.2, -0.5, 0.5, 0.0])
    motion = Motion(t, middle + np.cos(phase), -rate * np.sin(phase), -(rate**2) * np.cos(phase))
    found = pf.identify(guess(3), logged(3, motion, motor_effort(truth(), motion)), laws=PLAIN)
    assert not found.estimate.builds_up
    (said,) = (note for note in found.notes if "is not determined" in note and "a way" in note)
    assert said.startswith("a way over which friction builds up is not determined: shoulder_pan")
    assert said.count("reverses 3 times, and 6 are needed") == len(NAMES)
    assert "\n" not in said


def test_of_few_samples_a_second_ways_are_not_asked_and_it_says_so():
    found = pf.identify(
        guess(3), [log(3, 20.0, 50.0), log(4, 20.0, 100.0, name="fine")], laws=PLAIN
    )
    assert found.estimate.build is None
    (said,) = (note for note in found.notes if "a way over which" in note)
    assert said.endswith("is not looked for below 64 samples a second: log has 50")


def test_a_way_that_no_log_can_tell_is_refused():
    strokes = np.array([0.1, 0.2, 0.2])
    assert _refusal(1e-3, 1e-5, strokes) == ""
    assert "below three times the noise" in _refusal(1e-4, 5e-5, strokes)
    assert "which no log tells from a delay" in _refusal(3e-5, 1e-6, strokes)
    assert "no yielding of contacts" in _refusal(TRIED[-1], 1e-5, 100.0 * strokes)
    assert "a quarter of the amplitude of its motion, 0.1" in _refusal(0.028, 1e-5, strokes)


def test_the_share_of_a_log_is_that_of_its_positions():
    t = np.arange(200) * 0.01
    q = 0.01 * np.sin(4.0 * t)
    recording = SimpleNamespace(
        trajectory=SimpleNamespace(t=t),
        position=q[:, None],
        velocity=0.04 * np.cos(4.0 * t)[:, None],
    )
    expected = np.zeros(200)
    for k in range(1, 200):
        expected[k] = np.clip(expected[k - 1] + (q[k] - q[k - 1]) / 2e-3, -1.0, 1.0)
    found = shares(recording, 0, 2e-3, gradual=False)
    turns = np.diff(np.sign(recording.velocity[:, 0]), prepend=1.0) != 0.0
    late = (t > 0.3) & ~turns
    assert np.abs(found - expected)[late].max() < 0.05  # turning points between samples
    assert np.array_equal(
        shares(recording, 0, 0.0, gradual=False), np.sign(recording.velocity[:, 0])
    )


def test_what_was_found_and_refused_is_said():
    way = Way(2e-3, 0.1, gradual=False, gain=0.4)
    build = Build((way, None), 0.004, 1e-4, {1: "0.03 or more: that is no yielding"})
    scene = SimpleNamespace(joint_names=("elbow", "wrist"))
    found, refused = _of_ways(SimpleNamespace(build=build, scene=scene, prepared=()))
    assert "builds up evenly after reversals (presliding)" in found
    assert found.endswith("elbow 0.002 (40 % of the square)")
    assert refused.endswith("is not determined: wrist 0.03 or more: that is no yielding")
    assert _of_ways(SimpleNamespace(build=None, scene=scene, prepared=())) == []


def test_rows_after_a_reversal_are_those_of_three_tenths_of_a_second():
    v = np.where(np.arange(100) < 50, 1.0, -1.0)[:, None]
    recording = SimpleNamespace(velocity=v, step=0.1, slowest=np.array([0.1]))
    assert np.flatnonzero(after_reversals(recording)[:, 0]).tolist() == [50, 51, 52]


def test_an_unseen_motion_has_the_efforts_of_the_true_law():
    """All moving rows, reversals among them, of another log of the same robot."""
    other = pf.identify(
        guess(21),
        wrong_log("presliding", 21, 30.0, 125.0),
        laws=PLAIN,
        held_out=[wrong_log("presliding", 22, 20.0, 125.0)],
    )
    (errors,) = other.unseen.values()
    for name, error in errors.items():
        assert error.moving_share < 0.05, name


def test_ways_that_the_chosen_laws_make_needless_are_not_taken(ur10):
    """Beside plain friction four ways and a delay of -18 ms fit it, and predicted it worse."""
    assert not ur10.estimate.builds_up
    assert ur10.estimate.question.jumps
    assert abs(ur10.delay) < 0.01
    assert not any("as of a contact" in line for line in ur10.doubts)
    assert not any("do not fit one robot" in line for line in ur10.doubts)
