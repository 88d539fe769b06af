"""Units of a log are recognised by clear evidence; otherwise the user is asked."""

import re

import numpy as np
import pytest
from log_cases import (
    DIALECTS,
    NAMES,
    Q,
    T,
    V,
    arm,
    load,
    noisy,
    refused,
    swung,
    table,
)
from numpy.testing import assert_allclose

from pinfric.errors import TrajectoryError
from pinfric.motions.joint_columns import joint_columns
from pinfric.motions.log.frame import Remarks
from pinfric.motions.log.reader import read_log
from pinfric.motions.log.reading import ReadingOptions


def test_units_in_brackets_say_the_quantity(tmp_path):
    motion = load(tmp_path, DIALECTS["units of all"])
    assert_allclose(motion.reading.effort["base_turn"], 7.0 * Q[:, 0], atol=1e-9)
    assert not any("not used" in line for line in motion.warnings)


def test_degrees_are_recognised_by_the_limits(tmp_path):
    motion = load(tmp_path, table(("t", *NAMES), T, np.degrees(Q)))
    assert motion.warnings[0].startswith("angles are in degrees (as radians beyond the limits: ")
    assert_allclose(motion.q, Q, atol=1e-10)


def test_mixed_angles_are_refused_with_the_choice(tmp_path):
    text = table(("t", *NAMES), T, np.degrees(Q[:, 0]), Q[:, 1])
    assert (
        "angles look like degrees (base_turn 45.84), but may be radians (arm_lift 0.5)"
        in refused(tmp_path, text)
    )
    assert "--unit deg" in refused(tmp_path, text)
    assert np.abs(load(tmp_path, text, unit="deg").q[:, 1]).max() < 0.01


@pytest.mark.parametrize(("what", "header"), [("position", "{}"), ("velocity", "{}.v")])
def test_numbers_beyond_any_motion_are_refused_before_they_are_asked(tmp_path, what, header):
    """Their squares and speeds overflow, of which NumPy warns (an error in tests)."""
    absurd = Q.copy()
    absurd[::2, 1] = 1e308
    columns = (Q, absurd) if what == "velocity" else (absurd,)
    names = [*(NAMES if what == "velocity" else ()), *map(header.format, NAMES)]
    text = table(("t", *names), T, *columns)
    says = f"log.csv: {what} of arm_lift: 1e+308 is beyond 1e+18"
    assert refused(tmp_path, text).endswith(says)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_time_units_are_recognised_by_the_step(unit, factor, tmp_path):
    motion = load(tmp_path, table(("timestamp", *NAMES), factor * T, Q))
    assert motion.warnings == (
        f"column timestamp is in {unit}: steps of {factor / 200:.6g} are 200 Hz",
    )
    assert_allclose(motion.t, T, atol=1e-12)


def test_steps_that_may_be_either_are_refused(tmp_path):
    still = table(("time", *NAMES), 5.0 * np.arange(400), np.full((400, 2), 0.5))
    message = refused(tmp_path, still)
    assert "steps of 5 may be ms (200 Hz) or s (0.2 Hz); give --time-unit ms or" in message
    assert load(tmp_path, still, time_unit="s").duration == 1995.0
    assert load(tmp_path, still, time_unit="ms").duration == pytest.approx(1.995)


@pytest.mark.parametrize("name", ["t", "timestamp"])
def test_milliseconds_of_slow_logs_are_recognised(name, tmp_path):
    motion = load(tmp_path, table((name, *NAMES), 1e3 * T[::20], Q[::20]))
    assert motion.warnings == (f"column {name} is in ms: steps of 100 are 10 Hz",)
    assert_allclose(motion.t, T[::20], atol=1e-12)


def test_whole_numbers_that_count_by_one_may_be_milliseconds(tmp_path):
    t = np.arange(2000) / 1000.0
    q = swung(t)
    text = table(("t", *NAMES), np.arange(2000), q)
    assert "steps of 1 may be ms (1000 Hz) or s (1 Hz); give" in refused(tmp_path, text)
    assert_allclose(load(tmp_path, text, time_unit="ms").t, t)


def test_a_clock_of_seconds_stays_one(tmp_path):
    slow = table(("t", *NAMES), 1.7e9 + 5.0 * np.arange(400), Q)
    assert load(tmp_path, slow).duration == 1995.0


def test_small_angles_in_degrees_are_found_by_their_speed(tmp_path):
    text = table(("t", *NAMES), T, np.degrees(0.25 * Q))  # 11.5 at most
    model = arm(lower=-12.5, upper=12.5)
    with pytest.raises(TrajectoryError, match=r"base_turn 22\.9 rad/s, limit 4\).*--unit deg\)"):
        load(tmp_path, text, scene=model)
    assert_allclose(load(tmp_path, text, scene=model, unit="deg").q, 0.25 * Q)
    assert load(tmp_path, text, scene=model, unit="rad").q[:, 0].max() > 11.0


def test_a_header_of_degrees_over_radians_is_asked_about(tmp_path):
    text = table(("t", *(f"{name} [deg]" for name in NAMES)), T, Q)
    said = refused(tmp_path, text)
    assert "the header says degrees, but then no joint exceeds" in said
    assert "give --unit deg or --unit rad" in said
    assert_allclose(load(tmp_path, text, unit="rad").q, Q, atol=1e-10)
    # faster than its limits, of which degrees would be 2.5 %
    assert "as radians 14" in refused(tmp_path, text, scene=arm(speed=1.1))
    # joints without limits of speed
    assert "the header says degrees" in refused(tmp_path, text, scene=arm(speed=np.inf))


def test_a_header_of_degrees_is_right_where_radians_would_leave_the_limits(tmp_path):
    text = table(("t", *(f"{name} [deg]" for name in NAMES)), T, 4.0 + 0.05 * np.degrees(Q))
    assert_allclose(load(tmp_path, text).q, np.radians(4.0) + 0.05 * Q, atol=1e-10)


def test_velocities_have_the_unit_of_their_own_header(tmp_path):
    header = [f"{n}{k}" for k in (" [deg]", " [rad/s]") for n in NAMES]
    assert not load(tmp_path, table(("t", *header), T, np.degrees(Q), V)).warnings
    said = refused(tmp_path, table(("t", *header), T, np.degrees(Q), 57 * V))
    assert "base_turn 57 [57, 57], arm_lift 57 [57, 57]" in said


TURN = 2.0 * np.pi
ODRIVES = (
    [f"axis{i}.encoder.{kind}_estimate" for kind in ("pos", "vel") for i in (0, 1)],
    [f"odrv0.axis{i}.{kind}_estimate" for kind in ("pos", "vel") for i in (0, 1)],
    [f"/odrive_axis{i}/controller_status/{k}_estimate" for k in ("pos", "vel") for i in (0, 1)],
    [f"{joint}/{kind}_estimate" for kind in ("pos", "vel") for joint in NAMES],
)


@pytest.mark.parametrize("columns", ODRIVES)
def test_turns_of_an_odrive(columns, tmp_path):
    torque = columns[0].replace("encoder", "motor").replace("pos", "torque")
    header = ("t", *columns, torque, torque.replace("axis0", "axis1").replace(*NAMES))
    text = table(header, T, Q / TURN, V / TURN, 7.0 * Q)
    motion = load(tmp_path, text, unit="turn")
    assert_allclose(motion.q, Q, atol=1e-9)
    assert_allclose(motion.reading.effort["arm_lift"], 7.0 * Q[:, 1], atol=1e-8)
    assert "not used" not in "".join(motion.warnings)
    assert "may be in turns of ODrives' motors: give --unit turn" in refused(tmp_path, text)
    assert_allclose(load(tmp_path, text, unit="rad").q, Q / TURN, atol=1e-9)
    wrong = table(header, T, Q / TURN, V, Q)
    assert "logged velocities are a multiple" in refused(tmp_path, wrong, unit="turn")


def test_turns_of_an_odrive_that_are_no_log(tmp_path):
    whole = table(("t", *ODRIVES[0]), T, Q / TURN, V / TURN)
    lines = whole.split("\n")
    for text, says in (
        (table(("t", *ODRIVES[0][::2]), T, Q[:, 0], V[:, 0]), "no column is a joint of the scene"),
        (lines[0], "has a header and no samples"),
        ("\n".join([*lines[:201], *lines[1:200]]), "at line 202"),
        (whole.replace("axis1", "axis2"), "are not one for each joint, numbered"),
    ):
        said = refused(tmp_path, text, unit="turn")
        assert says in said
        assert "\n" not in said


def test_turns_before_a_gear_and_by_header(tmp_path):
    pairs = zip(NAMES, ODRIVES[0], ODRIVES[0][2:], strict=False)
    (tmp_path / "gear.yaml").write_text(
        "joints:\n"
        + "".join(
            f"  {name}: {{position: {q}, velocity: {v}, unit: turn, scale: 0.125}}\n"
            for name, q, v in pairs
        )
    )
    text = table(("t", *ODRIVES[0]), T, 8.0 * Q / TURN, 8.0 * V / TURN)
    assert_allclose(load(tmp_path, text, columns=tmp_path / "gear.yaml").q, Q, atol=1e-9)
    header = [f"{n} [{unit}]" for unit in ("turns", "rev/s") for n in NAMES]
    motion = load(tmp_path, table(("t", *header), T, Q / TURN, V / TURN))
    assert_allclose(motion.q, Q, atol=1e-9)
    assert not motion.warnings
    assert "are a multiple" in refused(tmp_path, table(("t", *header), T, Q / TURN, V))


@pytest.mark.parametrize(
    ("clock", "factors", "noise", "named"),
    [
        (2.0, (1.0, 1.0), 0.0, {"base_turn": 2.0, "arm_lift": 2.0}),
        (1.0, (1.0, -1.0), 0.0, {"arm_lift": -1.0}),
        (1.0, (1.05, 1.0), 0.02, {"base_turn": 1.05}),
        (1.0, (1.01, 1.0), 0.0, {}),  # by how much a gear's ratio is rounded
        (1.0, (1.03, 1.0), 0.5, {}),  # within the interval
        (1.0, (0.0, 0.0), 0.5, {}),  # nothing but noise is no multiple
    ],
)
def test_a_factor_between_velocities_and_positions_is_named(clock, factors, noise, named, tmp_path):
    seeded = np.random.default_rng(3)
    text = table(
        ("t", *NAMES, *(f"{name}/velocity" for name in NAMES)),
        clock * T,
        Q + 1e-5 * seeded.normal(size=Q.shape),
        V * factors + noise * seeded.normal(size=V.shape),
    )
    if not named:
        load(tmp_path, text)
        return
    found = re.findall(r"(\w+) (-?[\d.]+) \[(-?[\d.]+), (-?[\d.]+)\]", refused(tmp_path, text))
    assert [name for name, *_ in found] == list(named)
    for name, *figures in found:
        middle, low, high = map(float, figures)
        assert low <= named[name] <= high
        assert middle == pytest.approx(named[name], rel=0.01)


def test_velocities_that_lag_or_miss_rows_have_no_factor(tmp_path):
    lag = np.column_stack((1.6 * np.cos(2 * (T - 0.03)), -0.6 * np.sin(3 * (T - 0.03))))
    kept = np.delete(np.arange(T.size), [80, 81, 200])
    header = ("t", *NAMES, *(f"{name}/velocity" for name in NAMES))
    load(tmp_path, table(header, T[kept], noisy(T)[kept], lag[kept]))


def test_a_frozen_encoder_is_named_by_its_jump(tmp_path):
    frozen, at = Q.copy(), np.arange(120, 280)
    frozen[at, 0] = frozen[at[0], 0]
    said = refused(tmp_path, table(("t", *NAMES), T, frozen))
    assert "joint base_turn: its angle stands still from" in said
    assert f"in line {at[-1] + 3}" in said
    assert "its encoder was frozen" in said


def test_a_frozen_encoder_is_named_by_its_stop_from_full_motion(tmp_path):
    frozen = Q.copy()
    at = 100 + int(np.argmax(np.abs(V[100:200, 0])))
    frozen[at:, 0] = frozen[at, 0]
    said = refused(tmp_path, table(("t", *NAMES), T, frozen), scene=arm(speed=3.0))
    assert f"joint base_turn: its angle stands still from {T[at]:.6g} to" in said
    assert f"within a row, line {at + 3}" in said


@pytest.mark.parametrize("held", [1, 5])
def test_rows_that_were_cut_out_are_named_by_the_jump(held, tmp_path):
    t = np.arange(4000) / 200.0
    q = swung(t)[np.arange(4000) // held * held]  # of a source that is as slow as that
    load(tmp_path, table(("t", *NAMES), t, q))
    kept = np.delete(np.arange(4000), np.arange(1000, 1300))
    said = refused(tmp_path, table(("t", *NAMES), t[: kept.size], q[kept]))
    way = abs(q[1300, 0] - q[999, 0])
    assert f"joint base_turn: it jumps by {way:.3g} rad in line 1002, at 5 s, which no" in said


def test_the_last_digit_of_degrees_is_one_of_radians(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(table(("t", *NAMES), T, np.degrees(Q), form="%.3f"))
    columns = joint_columns(arm().model, "")
    read = read_log(path, columns, (), lambda *_: columns, ReadingOptions(unit="deg"), Remarks())
    assert_allclose(read[1].resolution, np.radians(1e-3))
