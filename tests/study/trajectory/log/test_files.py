"""Logs in the dialects of robots and their tools: columns, units, rows, bags, and bad files."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain

import pinfric as pf
from pinfric.errors import TrajectoryError
from pinfric.study.trajectory.log import csv_file
from pinfric.study.trajectory.log.judged import judge_log
from pinfric.study.trajectory.log.reading import ReadingOptions
from pinfric.study.trajectory.waypoints import quintic

SHARED = Path(__file__).parents[5] / "shared" / "data" / "ur10"
T = np.arange(400) / 200.0
Q = np.column_stack((0.8 * np.sin(2 * T), 0.3 + 0.2 * np.cos(3 * T)))
V = np.column_stack((1.6 * np.cos(2 * T), -0.6 * np.sin(3 * T)))


def arm(lower=-2.0, upper=2.0, speed=4.0):
    """Two joints, `base_turn` and `arm_lift`, both limited."""
    body = pin.Inertia(2.0, np.array([0.3, 0, 0]), 0.02 * np.eye(3))
    model = chain(("base_turn", pin.JointModelRZ(), body), ("arm_lift", pin.JointModelRY(), body))
    model.effortLimit[:], model.velocityLimit[:] = 100.0, speed
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = lower, upper
    return pf.Scene(model=model)


def table(header, *columns, mark=",", form="%.12g"):
    lines = [mark.join(form % x for x in row) for row in np.column_stack(columns)]
    return "\n".join([mark.join(header), *lines]) + "\n"


def load(folder, text, name="log.csv", scene=None, **options):
    (folder / name).write_text(text)
    return pf.load_trajectory(folder / name, scene or arm(), ReadingOptions(**options))


def refused(folder, text, **options):
    with pytest.raises(TrajectoryError) as caught:
        load(folder, text, **options)
    return str(caught.value)


NAMES = ("base_turn", "arm_lift")
PLAIN = table(("t", *NAMES), T, Q)
JUGGLED = [f"/joint_states/{n}/{k}" for k in ("position", "velocity") for n in NAMES]
WANTED = [f"desired/{name}/position" for name in NAMES]
MORE = [f"{n}{k}" for k in (" [rad/s]", " [Nm]") for n in NAMES]
PAIRS = list(zip(T.tolist(), *Q.T.tolist(), strict=True))
DIALECTS = {
    "semicolons": table(("time", *NAMES), T, Q, mark=";"),
    "tabs": table(("timestamp", *NAMES), T, Q, mark="\t"),
    "decimal commas": table(("t", *NAMES), T, Q, mark=";").replace(".", ","),
    "plotjuggler": table(("__time", *JUGGLED), T, Q, V),
    "dots": table(("Time", *(f"joint_states.{n}.pos" for n in NAMES)), T, Q),
    "brackets": table(("time [s]", *(f"{n} [rad]" for n in NAMES)), T, Q),
    "prefix": table(("t", *(f"q_{n}" for n in NAMES)), T, Q),
    "degrees by name": table(("t", *(f"{n} [deg]" for n in NAMES)), T, np.degrees(Q)),
    "milliseconds by name": table(("t_ms", *NAMES), 1e3 * T, Q),
    "comment header of np.savetxt": "# " + table(("t", *NAMES), T, Q),
    "comment header of np.savetxt, spaces": "# made by\n# " + table(("t", *NAMES), T, Q, mark=" "),
    "spaces": table(("t", *NAMES), T, Q, mark=" "),
    "aligned by spaces": table(("t", *NAMES), T, Q, mark="   ", form="%18.12g"),
    "spaces and decimal commas": table(("t", *NAMES), T, Q, mark=" ").replace(".", ","),
    "units of all": table(("t", *NAMES, *MORE), T, Q, V, 7.0 * Q),
    "recorder of the UR": table(
        (
            "timestamp",
            "target_q_0",
            "target_q_1",
            "actual_q_0",
            "actual_q_1",
            "actual_qd_0",
            "actual_qd_1",
            "actual_TCP_pose_0",
            "actual_TCP_pose_1",
        ),
        T,
        -Q,
        Q,
        V,
        -Q,
        mark=" ",
    ),
    "numbered from 1": table(("t", "joint_1_position", "joint_2_position"), T, Q),
    "numbered from 0": table(("t", "q_0", "q_1"), T, Q),
    "a desired one beside": table(("t", *NAMES, *WANTED), T, Q, -Q),
    "numbered": "time,name_0,name_1,position_0,position_1\n"
    + "".join(f"{t!r},arm_lift,base_turn,{b!r},{a!r}\n" for t, a, b in PAIRS),
    "ros header": "header.stamp.secs,header.stamp.nsecs,base_turn,arm_lift\n"
    + "".join(f"{1700000000 + int(t)},{round(t % 1 * 1e9)},{a!r},{b!r}\n" for t, a, b in PAIRS),
    "ns since 1970": "timestamp,base_turn,arm_lift\n"
    + "".join(f"{1700000000123456789 + round(t * 1e9)},{a!r},{b!r}\n" for t, a, b in PAIRS),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_dialects_give_the_motion_of_the_plain_file(dialect, tmp_path):
    plain, motion = load(tmp_path, PLAIN), load(tmp_path, DIALECTS[dialect])
    np.testing.assert_allclose(motion.t, plain.t, atol=1e-9)
    np.testing.assert_allclose(motion.q, plain.q, atol=1e-11)
    np.testing.assert_allclose(motion.v, plain.v, atol=1e-7)
    np.testing.assert_allclose(motion.a, plain.a, atol=1e-4)


@pytest.mark.parametrize("row", ["0;0;1.000,5", "0;0;12.500"])
def test_points_where_commas_are_decimal_are_refused(row, tmp_path):
    text = DIALECTS["decimal commas"].replace("0;0;0,5", row)
    assert "line 2 has a point, but the file has decimal commas" in refused(tmp_path, text)


def test_extra_columns_are_named_in_one_line(tmp_path):
    motion = load(tmp_path, table(("t", *NAMES, "temperature", "mode"), T, Q, Q))
    assert motion.warnings == ("columns not used: 'temperature', 'mode'",)


@pytest.mark.parametrize("quantities", [1, 2, 3])
def test_what_ros2_topic_echo_writes_has_no_header(quantities, tmp_path):
    numbers = [Q, V, 7.0 * V][:quantities]
    rows = [
        [
            str(1_700_000_000 + k // 200),
            str(k % 200 * 5_000_000),
            "base",
            *NAMES,
            *(f"{x:.12g}" for part in numbers for x in part[k]),
        ]
        for k in range(400)
    ]
    motion = load(tmp_path, "\n".join(map(",".join, rows)) + "\n")
    np.testing.assert_allclose(motion.t, T, atol=1e-9)
    np.testing.assert_allclose(motion.q, Q, atol=1e-10)
    assert ("arm_lift" in motion.reading.effort) == (quantities == 3)
    assert motion.warnings[0].startswith("columns not used: 'header.frame_id'")
    assert "name_0" not in motion.warnings[0]


def test_what_ros2_topic_echo_writes_may_change_its_order(tmp_path):
    """Read by the first row's names, the joints changed places in mid-file."""
    rows = []
    for k in range(400):
        order = [0, 1] if k < 150 else [1, 0]
        names = [NAMES[i] for i in order] if k % 100 != 70 else ["left", "right"]
        numbers = (x for part in (Q[k], V[k], 7.0 * Q[k]) for x in part[order])
        rows.append(
            ",".join(
                [
                    str(1_700_000_000 + k // 200),
                    str(k % 200 * 5_000_000),
                    "base",
                    *names,
                    *(f"{x:.12g}" for x in numbers),
                ]
            )
        )
    motion = load(tmp_path, "\n".join(rows) + "\n")
    np.testing.assert_allclose(motion.q, Q, atol=1e-6)  # four rows interpolated
    assert "or their order, change in 251 rows, first in line 71" in motion.warnings[0]
    np.testing.assert_allclose(motion.reading.effort["arm_lift"], 7.0 * Q[:, 1], atol=1e-3)


def test_units_in_brackets_say_the_quantity(tmp_path):
    motion = load(tmp_path, DIALECTS["units of all"])
    np.testing.assert_allclose(motion.reading.effort["base_turn"], 7.0 * Q[:, 0], atol=1e-9)
    assert not any("not used" in line for line in motion.warnings)


def test_joints_by_number_are_taken_in_order_and_said(tmp_path):
    motion = load(tmp_path, DIALECTS["recorder of the UR"])
    words = "columns actual_q_0 to actual_q_1 are read in the scene's order, base_turn to arm_lift"
    assert words in motion.warnings
    assert any(line.startswith("columns not used: 'target_q_0'") for line in motion.warnings)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (("t", "q_0", "q_1", "q_2"), "no column is a joint of the scene"),  # three for two joints
        (("t", "q_1", "q_3", "x"), "no column is a joint of the scene"),
        (("t", "tool_q_0", "tool_q_1", "x"), "no column is a joint of the scene"),
        (("t", "tau_0", "tau_1", "x"), "has effort of the joints, but no positions"),
    ],
)
def test_numbers_that_do_not_fit_are_no_joints(header, said, tmp_path):
    assert said in refused(tmp_path, table(header, T, Q, Q[:, 0]))


def test_two_sets_of_numbered_joints_are_asked_about(tmp_path):
    text = table(("t", "q_0", "q_1", "actual_q_0", "actual_q_1"), T, Q, Q)
    assert "'q_0', 'actual_q_0' may all be the position of joint base_turn" in refused(
        tmp_path, text
    )


def test_gzipped_files_with_a_mapping_beside_them(tmp_path):
    import gzip

    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(PLAIN.encode()))
    np.testing.assert_allclose(pf.load_trajectory(tmp_path / "log.csv.gz", arm()).q, Q, atol=1e-11)
    (tmp_path / "log.columns.yaml").write_text("joints: {base_turn: arm_lift, arm_lift: base_turn}")
    turned = pf.load_trajectory(tmp_path / "log.csv.gz", arm()).q
    np.testing.assert_allclose(turned, Q[:, ::-1], atol=1e-11)
    whole = (tmp_path / "log.csv.gz").read_bytes()
    for content in (
        whole[: len(whole) // 2],
        b"t,base_turn",
        whole[:200] + bytes(50) + whole[250:],
    ):
        (tmp_path / "log.csv.gz").write_bytes(content)
        with pytest.raises(
            TrajectoryError, match=r"log\.csv\.gz: (cannot be read|is not)"
        ) as caught:
            pf.load_trajectory(tmp_path / "log.csv.gz", arm())
        assert "\n" not in str(caught.value)


def test_matlab_files_with_a_mapping(tmp_path):
    from scipy.io import savemat

    rec = {"time": T, "deg": np.degrees(Q).T, "tau": 7.0 * Q, "note": "a text", "gear": 101.0}
    savemat(tmp_path / "log.mat", {"rec": rec, "other": np.zeros((3, 4)), "long": np.zeros(999)})
    (tmp_path / "log.columns.yaml").write_text("""
time: {column: rec.time, unit: s}
unit: deg
joints:
  base_turn: {position: rec.deg_1, effort: rec.tau_1}
  arm_lift: {position: rec.deg_2, effort: rec.tau_2}
""")
    motion = pf.load_trajectory(tmp_path / "log.mat", arm())
    np.testing.assert_allclose(motion.q, Q, atol=1e-12)
    np.testing.assert_allclose(motion.reading.effort["arm_lift"], 7.0 * Q[:, 1], atol=1e-12)
    (tmp_path / "log.columns.yaml").unlink()
    with pytest.raises(TrajectoryError, match=r"there are: rec\.time, rec\.deg_1, rec\.deg_2"):
        pf.load_trajectory(tmp_path / "log.mat", arm())
    whole = (tmp_path / "log.mat").read_bytes()
    newer = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"  # the header of version 7.3
    damaged, other = "cannot be read as a MATLAB file: ", "is of MATLAB's version 7.3; save it"
    for content, message in (
        (whole[: len(whole) // 2], damaged),
        (b"", damaged),
        (b"MATLAB 7.3" + bytes(200), damaged),
        (newer + bytes(512), other),
    ):
        (tmp_path / "log.mat").write_bytes(content)
        with pytest.raises(TrajectoryError, match=rf"log\.mat: {message}") as caught:
            pf.load_trajectory(tmp_path / "log.mat", arm())
        assert "\n" not in str(caught.value)


def test_currents_that_a_mapping_uses_are_used(tmp_path):
    (tmp_path / "log.columns.yaml").write_text("""
joints:
  base_turn: {position: base_turn, current: base_turn/current, effort_scale: 11.5}
  arm_lift: arm_lift
""")
    text = table(("t", *NAMES, "base_turn/current", "arm_lift/current"), T, Q, V)
    motion = load(tmp_path, text)
    np.testing.assert_allclose(motion.reading.effort["base_turn"], 11.5 * V[:, 0], atol=1e-9)
    assert "columns not used: 'arm_lift/current'" in motion.warnings


def test_a_table_of_efforts_is_a_motion_again_without_a_word(tmp_path):
    motion = load(tmp_path, PLAIN)
    efforts = pf.inverse_dynamics(arm(), motion).to_dataframe().to_csv(index=False)
    again = load(tmp_path, efforts)
    assert again.warnings == ()
    np.testing.assert_allclose(again.a, motion.a, atol=1e-12)
    scene = pf.Scene(model=arm().model, friction={"arm_lift": {"viscous": 0.1}})
    falls = (
        pf.simulate(scene, [0.1, 0.2], [0.0, 0.0], [0.0, 0.0], 0.2)
        .to_dataframe()
        .to_csv(index=False)
    )
    assert not any("columns not used" in line for line in load(tmp_path, falls).warnings)


def test_parquet(tmp_path):
    import pandas as pd

    stamps = pd.to_datetime(1_700_000_000_000_000_000 + np.rint(T * 1e9).astype(np.int64))
    frame = pd.DataFrame({"timestamp": stamps, "base_turn": Q[:, 0], "arm_lift": Q[:, 1]})
    frame.to_parquet(tmp_path / "log.parquet")
    motion = pf.load_trajectory(tmp_path / "log.parquet", arm())
    np.testing.assert_allclose(motion.t, T, atol=1e-9)
    np.testing.assert_array_equal(motion.q, Q)
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "log.parquet").read_bytes()[:-100])
    with pytest.raises(TrajectoryError, match="cannot be read as a Parquet file") as caught:
        pf.load_trajectory(tmp_path / "cut.parquet", arm())
    assert "\n" not in str(caught.value)


def test_a_mapping_says_what_names_do_not(tmp_path):
    text = table(
        ("stamp_us", "J1", "J2", "I2"), 1e6 * T, -np.degrees(Q[:, 0]) + 10.0, Q[:, 1], 2 * V
    )
    (tmp_path / "log.csv").write_text(text.replace("I2\n", "I1,I2\n", 1))
    (tmp_path / "log.columns.yaml").write_text("""
time: {column: stamp_us, unit: us}
joints:
  base_turn: {position: J1, sign: -1, unit: deg, offset: -0.17453292519943295}
  arm_lift: {position: J2, current: I2, effort_scale: 11.5}
""")
    motion = pf.load_trajectory(tmp_path / "log.csv", arm())
    np.testing.assert_allclose(motion.t, T, atol=1e-12)
    np.testing.assert_allclose(motion.q, Q, atol=1e-9)
    np.testing.assert_allclose(motion.reading.effort["arm_lift"], 11.5 * 2 * V[:, 1], atol=1e-9)
    (tmp_path / "other.yaml").write_text("joints: {base_turn: J9, arm_lft: J2}")
    with pytest.raises(TrajectoryError) as caught:
        pf.load_trajectory(
            tmp_path / "log.csv", arm(), ReadingOptions(columns=tmp_path / "other.yaml")
        )
    assert "there is no column 'J9'" in str(caught.value)
    assert "no joint 'arm_lft'; did you mean 'arm_lift'" in str(caught.value)


# --- units ----------------------------------------------------------------------------------------


def test_degrees_are_recognised_by_the_limits(tmp_path):
    motion = load(tmp_path, table(("t", *NAMES), T, np.degrees(Q)))
    assert motion.warnings[0].startswith("angles are in degrees (as radians beyond the limits: ")
    np.testing.assert_allclose(motion.q, Q, atol=1e-10)


def test_mixed_angles_are_refused_with_the_choice(tmp_path):
    text = table(("t", *NAMES), T, np.degrees(Q[:, 0]), Q[:, 1])
    assert (
        "angles look like degrees (base_turn 45.84), but may be radians (arm_lift 0.5)"
        in refused(tmp_path, text)
    )
    assert "--unit deg" in refused(tmp_path, text)
    assert np.abs(load(tmp_path, text, unit="deg").q[:, 1]).max() < 0.01


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_time_units_are_recognised_by_the_step(unit, factor, tmp_path):
    motion = load(tmp_path, table(("timestamp", *NAMES), factor * T, Q))
    assert motion.warnings == (
        f"column timestamp is in {unit}: steps of {factor / 200:.6g} are 200 Hz",
    )
    np.testing.assert_allclose(motion.t, T, atol=1e-12)


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
    np.testing.assert_allclose(motion.t, T[::20], atol=1e-12)


def test_whole_numbers_that_count_by_one_may_be_milliseconds(tmp_path):
    t = np.arange(2000) / 1000.0
    q = np.column_stack((0.8 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t)))
    text = table(("t", *NAMES), np.arange(2000), q)
    assert "steps of 1 may be ms (1000 Hz) or s (1 Hz); give" in refused(tmp_path, text)
    np.testing.assert_allclose(load(tmp_path, text, time_unit="ms").t, t)


def test_a_clock_of_seconds_stays_one(tmp_path):
    slow = table(("t", *NAMES), 1.7e9 + 5.0 * np.arange(400), Q)
    assert load(tmp_path, slow).duration == 1995.0


def test_small_angles_in_degrees_are_found_by_their_speed(tmp_path):
    text = table(("t", *NAMES), T, np.degrees(0.25 * Q))  # 11.5 at most
    model = arm(lower=-12.5, upper=12.5)
    with pytest.raises(TrajectoryError, match=r"base_turn 22\.9 rad/s, limit 4\).*--unit deg or"):
        load(tmp_path, text, scene=model)
    np.testing.assert_allclose(load(tmp_path, text, scene=model, unit="deg").q, 0.25 * Q)
    assert load(tmp_path, text, scene=model, unit="rad").q[:, 0].max() > 11.0


# --- rows -----------------------------------------------------------------------------------------


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
    np.testing.assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=1e-3)


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


def test_a_log_cut_off_while_it_was_written(tmp_path):
    motion = load(tmp_path, PLAIN.rstrip()[:-25])
    assert motion.reading.dropped == 1
    assert len(motion.t) == 399


def noisy(t, seed=5):
    rng = np.random.default_rng(seed)
    return np.column_stack((0.8 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t))) + 1e-5 * rng.normal(
        size=(t.size, 2)
    )


def test_lost_rows_of_a_noisy_log_are_interpolated(tmp_path):
    t = np.delete(T, [50, 51, 210])
    motion = load(tmp_path, table(("t", *NAMES), t, noisy(t)))
    assert motion.reading.resampled == 3
    assert "3 lost rows interpolated, the first at 0.25 s" in motion.warnings
    assert motion.t[0] < T[50]
    assert motion.t[-1] > T[210]
    np.testing.assert_allclose(np.diff(motion.t), 0.005, atol=1e-9)
    np.testing.assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=0.2)


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_measurements_at_wandering_stamps_are_interpolated_on_them(noise, tmp_path):
    """Taken as regular, their accelerations were 20 times too large."""
    rng = np.random.default_rng(0)
    t = np.cumsum(0.002 * (1.0 + 0.1 * rng.exponential(size=4000)))
    q = np.column_stack((0.8 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t)))
    q += noise * rng.normal(size=q.shape)
    rows = table(("t", *NAMES, *(f"{n}/effort" for n in NAMES)), t, q, 7.0 * q, form="%.17g")
    motion = load(tmp_path, rows)
    assert motion.warnings[0].startswith("time stamps deviate by ")
    assert "RMS from regular time (steps of 2 ms to " in motion.warnings[0]
    assert "interpolated from them at 45" in motion.warnings[0]
    assert np.ptp(np.diff(motion.t)) < 1e-9  # what filters efforts expects
    np.testing.assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=0.1)
    effort = motion.reading.effort["base_turn"]
    np.testing.assert_allclose(effort, 5.6 * np.sin(2 * motion.t), atol=1e-3)


def test_stamps_of_writing_are_refused(tmp_path):
    """Rows written in bursts of ten: positions are smooth from row to row, not over the stamps."""
    t = np.arange(4000) / 500.0
    q = 0.1 * np.column_stack((0.8 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t)))
    q += 1e-5 * np.random.default_rng(0).normal(size=q.shape)
    written = np.arange(4000) // 10 * 0.02 + np.arange(4000) % 10 * 1e-3
    message = refused(tmp_path, table(("t", *NAMES), written, q))
    assert "the stamps are write times, not measuring times" in message


def test_a_plan_with_steps_of_its_own_stays_a_plan(tmp_path):
    t = np.cumsum(np.where(np.arange(400) % 80 < 40, 0.002, 0.008))
    q = np.column_stack((0.8 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t)))
    motion = load(tmp_path, table(("t", *NAMES), t, q, form="%.17g"))
    assert motion.warnings == ()
    np.testing.assert_array_equal(motion.t, t)


def test_a_long_gap_in_a_noisy_log_is_refused(tmp_path):
    t = np.delete(T, np.arange(100, 130))
    assert "gaps longer than 20 sample periods: 0.495 to 0.65 s" in refused(
        tmp_path, table(("t", *NAMES), t, noisy(t))
    )


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_a_clock_that_rounds_stamps_adds_no_acceleration(noise, tmp_path):
    """Stamps off by 0.4 us at 500 Hz would be 0.8 rad/s^2 (RMS) by a spline through them."""
    t = np.arange(1000) / 500.0
    q = np.column_stack((0.8 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t)))
    q += noise * np.random.default_rng(5).normal(size=q.shape)
    stamps = 1.7e9 + t + 4e-7 * np.random.default_rng(6).normal(size=t.size)
    motion = load(tmp_path, table(("__time", *NAMES), stamps, q, form="%.17g"))
    assert motion.reading.resampled == 0
    truth = -3.2 * np.sin(2 * motion.t)
    np.testing.assert_allclose(motion.a[100:-100, 0], truth[100:-100], atol=0.1)


def test_a_recording_of_few_rows_says_that_it_is_not_judged(tmp_path):
    motion = load(tmp_path, table(("t", *NAMES), T[:15], noisy(T)[:15]))
    assert motion.warnings == ("15 rows: too few to separate noise from motion, not filtered",)
    by_hand = Q[:1] + quintic(np.linspace(0.0, 1.0, 15))[0][:, None]  # from rest to rest
    assert not load(tmp_path, table(("t", *NAMES), T[:15] * 20, by_hand)).warnings


def test_positions_held_from_a_slower_source(tmp_path):
    held = Q[np.arange(400) // 4 * 4]
    motion = load(tmp_path, table(("t", *NAMES), T, held))
    assert motion.warnings[0].startswith("positions change in every 4th row only: the 300 rows")
    np.testing.assert_allclose(motion.a[:, 0], -3.2 * np.sin(2 * motion.t), atol=0.01)


def test_rows_that_repeat_a_slower_source_are_left_out(tmp_path):
    """A recorder of 30 Hz writes the state of a source of 29.2 Hz: now and then twice the same."""
    source, recorder = np.arange(600) / 29.2, (np.arange(600) + 0.5) / 30.0
    q = np.column_stack((0.8 * np.sin(2 * source), 0.3 + 0.2 * np.cos(3 * source)))
    q += 1e-5 * np.random.default_rng(5).normal(size=q.shape)
    last = np.floor(recorder * 29.2).astype(int)
    motion = load(tmp_path, table(("t", *NAMES), recorder, q[last]))
    assert motion.warnings[0].startswith(f"left out {600 - last[-1] - 1} rows that repeat")
    assert "the source has 29.2 Hz" in motion.warnings[0]
    assert max(motion.reading.noise.values()) < 1.5e-5
    inner = slice(60, -60)
    at = motion.t - recorder[0] * 0.5  # held for half a step of the recorder on average
    np.testing.assert_allclose(motion.a[inner, 0], -3.2 * np.sin(2 * at[inner]), atol=0.1)


def test_a_late_source_is_not_one_of_a_lower_rate(tmp_path):
    again = np.arange(600)
    again[50::97] -= 1  # nothing new had come
    t = np.arange(600) / 30.0
    q = np.column_stack((0.8 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t)))
    q += 1e-5 * np.random.default_rng(5).normal(size=q.shape)
    motion = load(tmp_path, table(("t", *NAMES), t, q[again]))
    assert motion.warnings[0] == "left out 6 rows that repeat the row before"
    assert "6 lost rows interpolated" in motion.warnings[1]
    truth = -3.2 * np.sin(2 * motion.t)
    np.testing.assert_allclose(motion.a[60:-60, 0], truth[60:-60], atol=0.1)


def test_all_joints_that_stop_at_once_repeat_a_row_in_truth(tmp_path):
    t = (np.arange(601) - 300.5) / 100.0
    both = 0.1 * np.column_stack((t**2, -0.3 * t**2))  # they turn between two rows
    slower = 0.05 * np.column_stack((t**3, -0.3 * t**3))  # they go on
    for q in (both, slower):
        motion = load(tmp_path, table(("t", *NAMES), t - t[0], q))
        assert motion.warnings == ()
        assert motion.t.size == 601


@pytest.mark.parametrize("joint", [pin.JointModelRZ, pin.JointModelRUBZ])
def test_wrapped_angles_take_no_effort(joint, tmp_path):
    """At constant speed about a vertical axis nothing is needed, also where the angle wraps."""
    model = chain(("wheel", joint(), pin.Inertia(2.0, np.zeros(3), 0.5 * np.eye(3))))
    wrapped = np.angle(np.exp(1j * (2.0 + 1.5 * T)))
    motion = load(tmp_path, table(("t", "wheel"), T, wrapped), scene=pf.Scene(model=model))
    effort = pf.inverse_dynamics(pf.Scene(model=model), motion).effort_upper
    assert np.abs(effort).max() < 1e-3  # 12 digits are written
    assert motion.warnings[0] == "joint wheel: 1 jump of a whole turn removed"


def test_short_logs_are_judged_too(tmp_path):
    motion = load(tmp_path, table(("t", *NAMES), T[:25], noisy(T)[:25]))
    assert "filtered at" in motion.warnings[0]
    assert np.abs(motion.a).max() < 6.0  # 19 by a spline; 1.8 is true


def test_a_log_in_which_nothing_moves_is_a_hold(tmp_path):
    rows = 0.5 + 1e-5 * np.random.default_rng(0).normal(size=Q.shape)
    motion = load(tmp_path, table(("t", *NAMES), T, rows))
    assert motion.warnings == ("every joint is at rest, noise 1.0e-05 to 1.1e-05 rad",)
    assert [(hold.first, hold.last) for hold in motion.holds()] == [(0, 399)]


@pytest.mark.parametrize("cutoff", ["100", "0.5"])
def test_cutoffs_that_cannot_be(cutoff, tmp_path):
    message = refused(tmp_path, table(("t", *NAMES), T, noisy(T)), cutoff=cutoff)
    assert f"--cutoff {cutoff}: this log can be filtered from 1 to 100 Hz" in message


# --- bags -----------------------------------------------------------------------------------------


def write_bag(folder, storage, topic="/joint_states", kind="sensor_msgs/msg/JointState"):
    """A bag of the arm's motion, as ros2 bag record writes it."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.LATEST)
    make, plugin = types.types, getattr(StoragePlugin, storage)
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection(topic, kind, typestore=types)
        for t, q in zip(T, Q, strict=True):
            at = 1_700_000_000_000_000_000 + round(t * 1e9)
            if kind.endswith("JointState"):
                stamp = make["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
                message = make[kind](
                    header=make["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
                    name=["arm_lift", "gripper", "base_turn"],
                    position=np.array([q[1], 0.0, q[0]]),
                    velocity=np.array([]),
                    effort=np.array([1.0, 0.0, 2.0]),
                )
            else:
                message = make[kind](data=float(t))
            writer.write(connection, at, types.serialize_cdr(message, kind))
    return folder


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_bags_as_folder_and_as_file(storage, tmp_path):
    folder = write_bag(tmp_path / "bag", storage)
    file = next(p for p in folder.iterdir() if p.suffix in (".db3", ".mcap"))
    alone = shutil.copy(file, tmp_path / file.name)
    for path in (folder, file, alone):
        motion = pf.load_trajectory(path, arm())
        np.testing.assert_allclose(motion.t, T, atol=1e-9)
        np.testing.assert_array_equal(motion.q, Q)
        np.testing.assert_array_equal(motion.reading.effort["base_turn"], 2.0)
        assert "columns not used: 'gripper', 'gripper/effort'" in motion.warnings
    renamed = {"arm_lift": "base_turn", "base_turn": "arm_lift"}
    (tmp_path / "names.yaml").write_text(f"joints: {renamed}")
    other = pf.load_trajectory(folder, arm(), ReadingOptions(columns=tmp_path / "names.yaml"))
    np.testing.assert_array_equal(other.q, Q[:, ::-1])
    np.testing.assert_array_equal(other.reading.effort["arm_lift"], 2.0)
    cut = tmp_path / f"cut{file.suffix}"
    cut.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(TrajectoryError, match="the bag is damaged or truncated") as caught:
        pf.load_trajectory(cut, arm())
    assert "\n" not in str(caught.value)


def test_a_bag_without_joint_states_says_what_it_has(tmp_path):
    folder = write_bag(tmp_path / "bag", "SQLITE3", "/battery", "std_msgs/msg/Float64")
    with pytest.raises(
        TrajectoryError,
        match=r"no sensor_msgs/msg/JointState; its topics: "
        r"/battery \(std_msgs/msg/Float64\)",
    ):
        pf.load_trajectory(folder, arm())


@pytest.mark.parametrize(
    ("name", "package"), [("log.db3", "rosbags.highlevel"), ("log.parquet", "pyarrow.parquet")]
)
def test_a_missing_reader_names_the_extra(name, package, tmp_path, monkeypatch):
    (tmp_path / name).write_bytes(b"")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(TrajectoryError, match=r"pip install 'pinfric\[logs\]'"):
        pf.load_trajectory(tmp_path / name, arm())


@pytest.mark.skipif(not SHARED.is_dir(), reason="real logs are not in the repository")
def test_a_real_ur10_beside_its_measured_efforts(tmp_path):
    urdf = "example-robot-data:ur_description/urdf/ur10_robot.urdf"
    (tmp_path / "ur10.yaml").write_text(f'pinfric: 1\nrobot: {{urdf: "{urdf}"}}\n')
    scene = pf.load_scene(tmp_path / "ur10.yaml")
    motion = pf.load_trajectory(SHARED / "ur10_exciting_trajectory.db3", scene)
    assert (motion.reading.samples, motion.reading.dropped, motion.reading.resampled) == (
        3441,
        0,
        0,
    )
    assert max(motion.reading.noise.values()) < 1e-11
    assert not motion.reading.filtered
    measured = judge_log(pf.inverse_dynamics(scene, motion), motion.reading).measured
    for joint, plain in (("shoulder_lift_joint", 0.33), ("elbow_joint", 0.51)):
        assert measured[joint].relative_error == pytest.approx(plain, abs=0.02)


@pytest.mark.skipif(not SHARED.is_dir(), reason="real logs are not in the repository")
def test_a_real_panda_is_filtered_to_its_advantage(tmp_path):
    """Under the names of another release; its recorder repeated 14 rows of a slower source.

    The bars are what was left where these rows were taken as samples, and filtered harder for it.
    """
    names = {f"panda_joint{i}": f"fer_joint{i}" for i in range(1, 8)}
    (tmp_path / "names.yaml").write_text(f"joints: {names}")
    scene = pf.load_scene("panda_pick_and_place")
    bag, off = SHARED / "panda_exciting_trajectory.db3", {}
    for cutoff in (None, "none"):
        options = ReadingOptions(columns=tmp_path / "names.yaml", cutoff=cutoff)
        motion = pf.load_trajectory(bag, scene, options)
        measured = judge_log(pf.inverse_dynamics(scene, motion), motion.reading, "joint").measured
        assert motion.warnings[0].startswith("left out 14 rows that repeat the row before")
        off[cutoff] = np.array([measured[joint].relative_error for joint in motion.joint_names])
    assert (off[None] < [0.894, 0.1, 0.148, 0.141, 0.643, 0.459, 0.236]).all()
    assert (off[None][:6] < off["none"][:6]).all()  # joint 7 hardly accelerates
    assert (off[None][:2] < 0.75 * off["none"][:2]).all()


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "columns", "parts"),
    [
        (
            NAMES,
            (Q,),
            ("there is no column t (time, s)", "there are: base_turn, arm_lift", "`time: NAME`"),
        ),
        (
            ("time", "timestamp", *NAMES),
            (T, T, Q),
            ("'time', 'timestamp' may all be the time", "`time: time`"),
        ),
        (
            ("t", "joint_a", "joint_b"),
            (T, Q),
            (
                "no column is a joint of the scene (base_turn, "
                "arm_lift); there are: t, joint_a, joint_b",
                "joints: {base_turn: COLUMN}",
            ),
        ),
        (
            ("t", "base_turn", "elbow"),
            (T, Q),
            ("joints without a column: arm_lift (columns not used: 'elbow')",),
        ),
        (
            ("t", "base_turn/effort", "arm_lift/effort"),
            (T, Q),
            ("has effort of the joints, but no positions",),
        ),
        (
            ("t", "a/base_turn/position", "b/base_turn/position", "arm_lift"),
            (T, Q, Q[:, 0]),
            (
                "'a/base_turn/position', 'b/base_turn/position' may all be the position of joint "
                "base_turn",
                "--columns",
            ),
        ),
    ],
)
def test_what_cannot_be_known_is_refused_in_one_line(header, columns, parts, tmp_path):
    message = refused(tmp_path, table(header, *columns))
    for part in parts:
        assert part in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "options", [{"unit": "grad"}, {"time_unit": "min"}, {"cutoff": "0"}, {"cutoff": "fast"}]
)
def test_options_that_say_nothing_are_refused(options):
    with pytest.raises(TrajectoryError, match=r"^--"):
        ReadingOptions(**options)


def test_a_long_file_is_parsed_in_parts_to_the_same_numbers(tmp_path, monkeypatch):
    rng, rows = np.random.default_rng(0), 4000
    stamps = 1_700_000_000_000_000_000 + 2_000_001 * np.arange(rows)
    numbers = rng.normal(size=(rows, 2)).round(6)
    lines = [f"{t},{a:.6f},{b:.6f}" for t, (a, b) in zip(stamps, numbers, strict=True)]
    path = tmp_path / "long.csv"
    monkeypatch.setattr(csv_file, "_SMALL", 0)
    monkeypatch.setattr(csv_file, "_PART", 300)
    monkeypatch.setattr(csv_file, "_HEAD", 40)
    path.write_text("\n".join(["# made by a test", "stamp,a,b", *lines]))
    monkeypatch.setattr(csv_file, "_read_by_line", None)  # nothing is unusual in it
    found = csv_file.open_csv(path).read(("stamp", "b"), [])
    assert found.column("stamp").tolist() == (stamps - stamps[0]).tolist()  # no digit is lost
    assert found.origin == {"stamp": int(stamps[0])}
    assert found.column("b").tolist() == numbers[:, 1].tolist()
    assert (found.lines[0], found.lines[-1]) == (3, rows + 2)
    assert found.resolution["b"] == pytest.approx(1e-6)


@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
def test_both_ways_to_read_a_file_give_the_same(mark, tmp_path, monkeypatch):
    """In parts by pandas, and line by line."""
    path = tmp_path / "log.csv"
    path.write_text(table(("t", *NAMES), 1e15 + T, 1e3 * Q, mark=mark, form="%.17g"))
    by_line = csv_file.open_csv(path).read(("t", *NAMES), [])
    monkeypatch.setattr(csv_file, "_SMALL", 0)
    monkeypatch.setattr(csv_file, "_read_by_line", None)
    in_parts = csv_file.open_csv(path).read(("t", *NAMES), [])
    assert in_parts.values.tolist() == by_line.values.tolist()
    assert (in_parts.resolution, in_parts.origin) == (by_line.resolution, by_line.origin)
    assert list(in_parts.lines) == list(by_line.lines)


@pytest.mark.parametrize(
    ("row", "named"),
    [
        ("0.5,1", "the header has 3 columns; rows with another number of cells: line 1001 (2)"),
        ("0.5,1,2,3", "the header has 3 columns; rows with another number of cells: line 1001 (4)"),
        ("0.5,1,x", "not a number: line 1001, column b: 'x'"),
        (",1,2", "not a number: line 1001, column t: ''"),
        ("0.5,1,nan", "column b: nan at sample 999 (line 1001); every value must be finite"),
        ("0.5,1,1e999", "column b: inf at sample 999 (line 1001); every value must be finite"),
    ],
)
def test_what_is_wrong_in_a_long_file_is_said_as_of_any_other(row, named, tmp_path, monkeypatch):
    monkeypatch.setattr(csv_file, "_SMALL", 0)
    monkeypatch.setattr(csv_file, "_PART", 300)
    lines = [f"{k},0,{k}" for k in range(4000)]
    lines[999] = row
    path = tmp_path / "long.csv"
    path.write_text("\n".join(["t,a,b", *lines]))
    found = csv_file.open_csv(path).read(("t", "b"), [])
    assert (found.dropped, found.why, len(found.values)) == (1, named, 3999)
