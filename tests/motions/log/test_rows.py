"""Rows of a log: torn, lost, repeated, held; stamps that wander or are rounded."""

import numpy as np
import pytest
from log_cases import NAMES, PLAIN, Q, T, load, noisy, refused, swung, table
from numpy.testing import assert_allclose, assert_array_equal

from pinfric.motions.log.frame import Remarks
from pinfric.motions.log.motion import _stamps_are_better
from pinfric.motions.log.rows import mended_effort


def rows_of(text):
    head, *rows = text.splitlines()
    return head, rows


def test_few_torn_rows_and_stamps_are_left_out_and_said(tmp_path):
    head, rows = rows_of(PLAIN)
    rows[100] = rows[100][:9]  # torn
    rows.insert(200, rows[200])  # doubled
    rows[300] = rows[300].replace(rows[300].split(",")[1], "nan")
    motion = load(tmp_path, "\n".join([head, *rows]))
    assert motion.reading.dropped == 3
    assert motion.reading.samples == len(motion.t) == 398
    assert (
        "left out 2 rows of 401: the header has 3 columns; rows with another" in motion.warnings[0]
    )
    assert (
        "left out 1 row with repeated or backward time stamps, the first in line"
        in motion.warnings[1]
    )
    assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=1e-3)


@pytest.mark.parametrize("whole", [False, True])
def test_of_two_stamps_that_are_exchanged_neither_row_is_kept(tmp_path, whole):
    """Of the stamps alone, or of the rows: what is left is right in both cases."""
    head, rows = rows_of(PLAIN)
    rows[200], rows[201] = (
        (rows[201], rows[200])
        if whole
        else (
            ",".join([rows[201].split(",")[0], *rows[200].split(",")[1:]]),
            ",".join([rows[200].split(",")[0], *rows[201].split(",")[1:]]),
        )
    )
    motion = load(tmp_path, "\n".join([head, *rows]))
    assert "left out 2 rows with repeated or backward time stamps" in motion.warnings[0]
    assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=1e-3)


def test_many_torn_rows_are_an_error_that_names_them(tmp_path):
    head, rows = rows_of(PLAIN)
    for i in range(10, 60, 10):
        rows[i] = "0.5"
    message = refused(tmp_path, "\n".join([head, *rows]))
    assert "rows with another number of cells: line 12 (1), line 22 (1)" in message
    rows = rows_of(PLAIN)[1]
    for i in range(10, 60, 10):
        rows[i] = rows[i - 1]
    assert "time must increase; it does not at line 12" in refused(
        tmp_path, "\n".join([head, *rows])
    )


def test_lost_rows_of_a_noisy_log_are_interpolated(tmp_path):
    t = np.delete(T, [50, 51, 210])
    motion = load(tmp_path, table(("t", *NAMES), t, noisy(t)))
    assert motion.reading.resampled == 3
    assert "3 lost rows interpolated, the first at 0.25 s" in motion.warnings
    assert motion.t[0] < T[50]
    assert motion.t[-1] > T[210]
    assert_allclose(np.diff(motion.t), 0.005, atol=1e-9)
    assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=0.2)


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_measurements_at_wandering_stamps_are_interpolated_on_them(noise, tmp_path):
    """Taken as regular, their accelerations were 20 times too large."""
    rng = np.random.default_rng(0)
    t = np.cumsum(0.002 * (1.0 + 0.1 * rng.exponential(size=4000)))
    q = swung(t)
    q += noise * rng.normal(size=q.shape)
    rows = table(("t", *NAMES, *(f"{n}/effort" for n in NAMES)), t, q, 7.0 * q, form="%.17g")
    motion = load(tmp_path, rows)
    assert motion.warnings[0].startswith("time stamps deviate by ")
    assert "RMS from regular time (steps of 2 ms to " in motion.warnings[0]
    assert "interpolated from them at 45" in motion.warnings[0]
    assert np.ptp(np.diff(motion.t)) < 1e-9  # what filters efforts expects
    assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=0.1)
    effort = motion.reading.effort["base_turn"]
    assert_allclose(effort, 5.6 * np.sin(2 * motion.t), atol=1e-3)


@pytest.mark.parametrize("stamps_are_right", [True, False])
def test_a_small_jitter_is_that_of_samples_or_of_stamps(stamps_are_right):
    """It changes the noise by some 3 % only: before, three of twelve were not believed."""
    even = np.arange(0.0, 20.0, 0.008)
    for seed in range(12):
        rng = np.random.default_rng(seed)
        stamps = even + 1.6e-4 * rng.normal(size=even.size)
        taken = stamps if stamps_are_right else even
        size, phase = rng.uniform(0.2, 0.8, 6), rng.uniform(0.0, 6.0, 6)
        q = size * np.sin(np.outer(taken, 2.0 * np.pi * rng.uniform(0.1, 0.8, 6)) + phase)
        q += 7e-4 * rng.normal(size=q.shape)
        assert _stamps_are_better(q, stamps, even, None) is stamps_are_right


def test_stamps_of_writing_are_refused(tmp_path):
    """Rows written in bursts of ten: positions are smooth from row to row, not over the stamps."""
    t = np.arange(4000) / 500.0
    q = 0.1 * swung(t)
    q += 1e-5 * np.random.default_rng(0).normal(size=q.shape)
    written = np.arange(4000) // 10 * 0.02 + np.arange(4000) % 10 * 1e-3
    message = refused(tmp_path, table(("t", *NAMES), written, q))
    assert "the stamps are write times, not measuring times" in message


def test_a_plan_with_steps_of_its_own_stays_a_plan(tmp_path):
    t = np.cumsum(np.where(np.arange(400) % 80 < 40, 0.002, 0.008))
    q = swung(t)
    motion = load(tmp_path, table(("t", *NAMES), t, q, form="%.17g"))
    assert motion.warnings == ()
    assert_array_equal(motion.t, t)


def test_a_long_gap_in_a_noisy_log_is_refused(tmp_path):
    t = np.delete(T, np.arange(100, 130))
    assert "gaps longer than 20 sample periods: 0.495 to 0.65 s" in refused(
        tmp_path, table(("t", *NAMES), t, noisy(t))
    )


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_a_clock_that_rounds_stamps_adds_no_acceleration(noise, tmp_path):
    """Stamps off by 0.4 us at 500 Hz would be 0.8 rad/s^2 (RMS) by a spline through them."""
    t = np.arange(1000) / 500.0
    q = swung(t)
    q += noise * np.random.default_rng(5).normal(size=q.shape)
    stamps = 1.7e9 + t + 4e-7 * np.random.default_rng(6).normal(size=t.size)
    motion = load(tmp_path, table(("__time", *NAMES), stamps, q, form="%.17g"))
    assert motion.reading.resampled == 0
    truth = -3.2 * np.sin(2 * motion.t)
    assert_allclose(motion.a[100:-100, 0], truth[100:-100], atol=0.1)


@pytest.mark.parametrize("rows", [4, 10])
def test_positions_held_from_a_slower_source(rows, tmp_path):
    held = Q[np.arange(400) // rows * rows]  # of 10 rows, steps are as of 4 times the limit
    motion = load(tmp_path, table(("t", *NAMES), T, held))
    assert motion.warnings[0].startswith(
        f"positions change in every {rows}th row only: the {400 - 400 // rows} rows"
    )
    assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=0.01)


def test_rows_that_repeat_a_slower_source_are_left_out(tmp_path):
    """A recorder of 30 Hz writes the state of a source of 29.2 Hz: now and then twice the same."""
    source, recorder = np.arange(600) / 29.2, (np.arange(600) + 0.5) / 30.0
    q = swung(source)
    q += 1e-5 * np.random.default_rng(5).normal(size=q.shape)
    last = np.floor(recorder * 29.2).astype(int)
    motion = load(tmp_path, table(("t", *NAMES), recorder, q[last]))
    assert motion.warnings[0].startswith(f"left out {600 - last[-1] - 1} rows that repeat")
    assert "the source has 29.2 Hz" in motion.warnings[0]
    assert max(motion.reading.noise.values()) < 1.5e-5
    inner = slice(60, -60)
    at = motion.t - recorder[0] * 0.5  # held for half a step of the recorder on average
    assert_allclose(motion.a[inner, 0], -3.2 * np.sin(2 * at[inner]), atol=0.1)


def test_a_late_source_is_not_one_of_a_lower_rate(tmp_path):
    again = np.arange(600)
    again[50::97] -= 1  # nothing new had come
    t = np.arange(600) / 30.0
    q = swung(t)
    q += 1e-5 * np.random.default_rng(5).normal(size=q.shape)
    motion = load(tmp_path, table(("t", *NAMES), t, q[again]))
    assert motion.warnings[0] == "left out 6 rows that repeat the row before"
    assert "6 lost rows interpolated" in motion.warnings[1]
    truth = -3.2 * np.sin(2 * motion.t)
    assert_allclose(motion.a[60:-60, 0], truth[60:-60], atol=0.1)


def test_all_joints_that_stop_at_once_repeat_a_row_in_truth(tmp_path):
    t = (np.arange(601) - 300.5) / 100.0
    both = 0.1 * np.column_stack((t**2, -0.3 * t**2))  # they turn between two rows
    slower = 0.05 * np.column_stack((t**3, -0.3 * t**3))  # they go on
    for q in (both, slower):
        motion = load(tmp_path, table(("t", *NAMES), t - t[0], q))
        assert motion.warnings == ()
        assert motion.t.size == 601


def test_stamps_beyond_reason_are_refused_in_our_words(tmp_path):
    """Their squared distances from a line overflow, of which NumPy warns (an error in tests)."""
    t = np.cumsum(10.0 ** np.linspace(-3, 200, 400))
    t[[5, 6]] = t[[6, 5]]  # backward stamps are compared with regular ones
    message = refused(tmp_path, table(("t", *NAMES), t, Q, form="%.17g"))
    assert "times beyond 1e+10 s are refused" in message


TIMES = np.arange(2000) / 100.0
EFFORT = 20.0 + 5.0 * np.sin(TIMES) + 3.0 * np.sign(np.cos(0.7 * TIMES))


def mended(effort, position=np.sin(TIMES)):  # noqa: B008
    said = Remarks()
    lines = range(2, 2 + effort.size)
    return mended_effort("elbow", effort, position, lines, said), said.problems, said.notes


@pytest.mark.parametrize("every", [8.0, 30.0])
@pytest.mark.parametrize("rate", [25.0, 100.0, 1000.0])
def test_efforts_that_the_joints_own_motion_explains_are_no_spikes(every, rate):
    t, rng = np.arange(0.0, 120.0, 1.0 / rate), np.random.default_rng(0)
    s = np.clip(np.mod(t, every) / 0.2, 0.0, 1.0)
    position = (np.floor(t / every) + s**3 * (10 - 15 * s + 6 * s**2)) % 2.0
    push = np.where(s < 1.0, 4.4 * np.sin(2.0 * np.pi * s), 0.0)
    effort = push + 0.05 * rng.normal(size=t.size)
    assert mended(effort, position)[0] is effort
    lost = effort.copy()
    lost[int(5.0 * rate)] = 9.0  # amid rest
    result, problems, notes = mended(lost, position)
    assert (problems, len(notes)) == ([], 1)
    assert np.abs(result - effort).max() < 0.5


def test_the_flanks_of_a_peak_are_no_spikes():
    """Few rows of a smooth peak are beyond the others: another joint moves this one's load."""
    peak = 40.0 * np.exp(-(((TIMES - 10.0) / 0.02) ** 2))
    effort = np.sin(TIMES) + peak
    assert mended(effort, 0.0 * TIMES)[0] is effort


@pytest.mark.parametrize(("value", "said"), [(0.0, "exactly 0"), (9999.0, "up to 9999")])
def test_few_samples_that_were_not_measured_are_left_out_and_many_refused(value, said):
    """Before, 10 % of zeros made everything 10 % low, without a word."""
    rng = np.random.default_rng(0)
    few, many = EFFORT.copy(), EFFORT.copy()
    at = np.sort(rng.choice(np.arange(1, 1999), 16, replace=False))
    few[at] = value
    many[rng.random(2000) < (0.1 if value == 0.0 else 0.02)] = value
    result, problems, notes = mended(few)
    assert problems == []
    assert f"{said}" in notes[0]
    assert f"16 rows of 2000, the first in line {at[0] + 2}" in notes[0]
    assert np.abs(result - EFFORT).max() < 6.1  # of a step of friction at a lost sample
    assert np.median(np.abs(result - EFFORT)[at]) < 0.01
    _, problems, _ = mended(many)
    assert problems[0].startswith(f"joint elbow: its effort is {said}")


@pytest.mark.parametrize(
    "effort",
    [
        EFFORT,
        np.where(TIMES < 10.0, 0.0, EFFORT),  # a brake that holds
        5.0 * np.sign(np.sin(TIMES)),  # passes through zero with friction
        np.rint(5.0 * np.sin(0.1 * TIMES)),  # coarse
        np.zeros(2000),
        np.where((TIMES > 5.0) & (TIMES < 5.2), 300.0, EFFORT),  # a push of 0.2 s
    ],
)
def test_efforts_that_may_be_real_stay_as_they_are(effort):
    result, problems, notes = mended(effort)
    assert result is effort
    assert (problems, notes) == ([], [])
