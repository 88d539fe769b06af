"""Columns of a log: joints by name and by number, mappings, currents."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from log_cases import DIALECTS, NAMES, PLAIN, Q, T, V, arm, load, refused, swung, table
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.errors import TrajectoryError
from pinfric.motions.log.reading import ReadingOptions


def test_extra_columns_are_named_in_one_line(tmp_path):
    motion = load(tmp_path, table(("t", *NAMES, "temperature", "mode"), T, Q, Q))
    assert motion.warnings == ("columns not used: 'temperature', 'mode'",)


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


def test_currents_that_a_mapping_uses_are_used(tmp_path):
    (tmp_path / "log.columns.yaml").write_text("""
joints:
  base_turn: {position: base_turn, current: base_turn/current, effort_scale: 11.5}
  arm_lift: arm_lift
""")
    text = table(("t", *NAMES, "base_turn/current", "arm_lift/current"), T, Q, V)
    motion = load(tmp_path, text)
    assert_allclose(motion.reading.effort["base_turn"], 11.5 * V[:, 0], atol=1e-9)
    assert [line for line in motion.warnings if "not used" in line] == [
        "columns not used: 'arm_lift/current'"
    ]


def test_time_column_that_is_not_there_is_named(tmp_path):
    (tmp_path / "log.columns.yaml").write_text(
        "time: {column: zeit}\njoints: {base_turn: a, arm_lift: b}"
    )
    found = refused(tmp_path, table(("t", "a", "b"), T, Q))
    assert "columns: time: there is no column 'zeit'; there are: t, a, b" in found


def test_rows_without_a_time_have_the_rate_that_a_person_gives(tmp_path):
    text = table(NAMES, Q)
    assert "`time: {rate: 50}`" in refused(tmp_path, text)
    (tmp_path / "log.columns.yaml").write_text("time: {rate: 200}")
    motion = load(tmp_path, text)
    assert_allclose((motion.t, *motion.q.T), (T, *Q.T), atol=1e-11)
    assert "no column is the time: rows taken as written at 200 Hz" in motion.warnings
    lines = text.splitlines(keepends=True)
    torn = load(tmp_path, "".join([*lines[:50], "0.1\n", *lines[51:]]))  # its time is kept
    assert_allclose(torn.t, np.delete(T, 49), atol=1e-9)
    for wrong in ("{rate: 0}", "{rate: 50, column: t}", "{unit: s}"):
        (tmp_path / "log.columns.yaml").write_text(f"time: {wrong}")
        assert "log.columns.yaml: `time" in refused(tmp_path, text)


@pytest.mark.parametrize("read", [False, True])
def test_currents_of_the_ur_are_read_or_not_used_but_not_both(read, tmp_path):
    header = ("t", "actual_q_0", "actual_q_1", "actual_current_0", "actual_current_1")
    (tmp_path / "log.csv").write_text(table(header, T, Q, V))
    options = ReadingOptions(currents=frozenset(NAMES if read else ()))
    said = pf.load_trajectory(tmp_path / "log.csv", arm(), options).warnings
    assert any("columns actual_current_0 to" in line for line in said) is read
    assert any("not used" in line and "current" in line for line in said) is not read


def test_a_table_of_efforts_is_a_motion_again_without_a_word(tmp_path):
    motion = load(tmp_path, PLAIN)
    efforts = pf.inverse_dynamics(arm(), motion).to_dataframe().to_csv(index=False)
    again = load(tmp_path, efforts)
    assert again.warnings == ()
    assert_allclose(again.a, motion.a, atol=1e-12)
    scene = pf.Scene(model=arm().model, friction={"arm_lift": {"viscous": 0.1}})
    falls = (
        pf.simulate(scene, [0.1, 0.2], [0.0, 0.0], [0.0, 0.0], 0.2)
        .to_dataframe()
        .to_csv(index=False)
    )
    assert not any("columns not used" in line for line in load(tmp_path, falls).warnings)


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
    assert_allclose(motion.t, T, atol=1e-12)
    assert_allclose(motion.q, Q, atol=1e-9)
    assert_allclose(motion.reading.effort["arm_lift"], 11.5 * 2 * V[:, 1], atol=1e-9)
    (tmp_path / "other.yaml").write_text("joints: {base_turn: J9, arm_lft: J2}")
    with pytest.raises(TrajectoryError) as caught:
        pf.load_trajectory(
            tmp_path / "log.csv", arm(), ReadingOptions(columns=tmp_path / "other.yaml")
        )
    assert "there is no column 'J9'" in str(caught.value)
    assert "no joint 'arm_lft'" in str(caught.value)


def rsi(t=T, q=Q, axes=2, first=123_645_634_560, prefix="", **others):
    """A log of KUKA's RSI: telegrams of the robot every 4 ms, in degrees, as the loggers of PCs."""
    tags = {
        "AIPos": np.degrees(q),
        "ASPos": np.degrees(-q),
        "MACur": 9.0 * q,
        "GearTorque": 7.0 * q,
    }
    columns = [(f"{prefix}{tag}.A{i + 1}", x[:, i]) for tag, x in tags.items() for i in range(axes)]
    header = ("Timestamp", f"{prefix}RIst.X", *(name for name, _ in columns), f"{prefix}IPOC")
    ipoc = first + 4 * np.arange(t.size)
    rows = zip(ipoc, zip(*(x for _, x in columns), strict=True), strict=True)
    lines = [f"30-11-2026 10:00:00.{i % 7},1,{','.join(map(repr, x))},{i}" for i, x in rows]
    return "\n".join([",".join(header), *lines]).replace("np.float64(", "").replace(")", "")


@pytest.mark.parametrize("prefix", ["", "Receive."])
@pytest.mark.parametrize("first", [0, 123_645_634_560])
def test_telegrams_of_kuka(prefix, first, tmp_path):
    t = 0.004 * np.arange(T.size)
    motion = load(tmp_path, rsi(q=swung(t), first=first, prefix=prefix))
    assert_allclose(motion.t, t, atol=1e-9)
    assert_allclose(motion.q, swung(t), atol=1e-9)
    assert_allclose(motion.reading.effort["arm_lift"], 7.0 * swung(t)[:, 1], atol=1e-9)
    said = "".join(motion.warnings)
    assert f"columns {prefix}AIPos.A1 to {prefix}AIPos.A2 are read in the scene's order" in said
    slow = 1e-3 * swung(t)  # which would be a motion in radians, too
    assert "degrees" in refused(tmp_path, rsi(q=slow))
    assert_allclose(load(tmp_path, rsi(q=slow), unit="deg").q, slow, atol=1e-9)


def test_telegrams_of_kuka_that_are_no_log(tmp_path):
    whole = rsi(q=swung(0.004 * np.arange(T.size)))
    lines = whole.split("\n")
    for text, says in (
        ("\n".join(lines[:201] + lines[1:200]), "at line 202"),
        (rsi(axes=1), "no column is a joint of the scene"),
        (
            whole.replace("AIPos.A2", "AIPos.A3"),
            "AIPos.A1, AIPos.A3 are not one for each joint, numbered",
        ),
        (lines[0], "has a header and no samples"),
        (whole.replace("AIPos", "X"), "has current and effort of the joints, but no positions"),
        (whole.replace("IPOC", "Delay"), "times are seconds"),
    ):
        said = refused(tmp_path, text)
        assert says in said
        assert "\n" not in said


def lowstate(motors, rows):
    """PlotJuggler's export of Unitree's LowState: motor -> (positions, velocities, torques)."""
    header = ["__time", "/lowstate/tick"]
    columns = [1_700_000_000 + rows, np.rint(1e3 * rows)]
    for number, of_motor in motors.items():
        of_motor = [0 * rows, *of_motor, of_motor[0] + 1.0, 30 + 0 * rows]
        words = ("mode", "q", "dq", "tau_est", "q_raw", "temperature")
        header += [f"/lowstate/motor_state[{number}]/{word}" for word in words]
        columns += of_motor
    return table(header, *columns, form="%.16g")


def legs(*names):
    """A tree of joints, each with a body, in this order."""
    body = lump(2.0, [0.3, 0, 0], 0.02)
    model = chain(*((name, pin.JointModelRY(), body) for name in names))
    model.effortLimit[:], model.velocityLimit[:] = 100.0, 4.0
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -2.0, 2.0
    return pf.Scene(model=model)


def test_motors_of_unitree_are_those_of_its_joints(tmp_path):
    """A Go2's motors begin with FR, its URDF with FL; a G1 has 35 motors for 29 joints."""
    scaled = {i: (Q[:, 0] / (i + 1), V[:, 0] / (i + 1), i * Q[:, 1]) for i in range(35)}
    go2 = "FL_hip_joint", "FL_thigh_joint", "FR_hip_joint", "RL_calf_joint"
    g1 = "left_knee_joint", "waist_yaw_joint", "right_wrist_yaw_joint", "left_elbow_joint"
    for names, places, count in ((go2, (3, 4, 0, 11), 20), (g1, (3, 12, 28, 18), 35)):
        text = lowstate({i: scaled[i] for i in range(count)}, T)
        motion = load(tmp_path, text, scene=legs(*names))
        for k, place in enumerate(places):
            assert_allclose(motion.q[:, k], Q[:, 0] / (place + 1), atol=1e-9)
            effort = motion.reading.effort[names[k]]
            assert_allclose(effort, place * Q[:, 1], atol=1e-7)
        assert any("numbered in Unitree's order" in line for line in motion.warnings)
        gone = {i: scaled[i] for i in range(count) if i != places[1]}
        with pytest.raises(TrajectoryError, match=f"joints without a column: {names[1]}"):
            load(tmp_path, lowstate(gone, T), scene=legs(*names))


def test_motors_of_others_are_taken_in_order_where_there_is_one(tmp_path):
    motors = {i: (Q[:, i], V[:, i], 7.0 * Q[:, i]) for i in (0, 1)}
    motion = load(tmp_path, lowstate(motors, T))
    assert_allclose(motion.q, Q, atol=1e-9)
    assert_allclose(motion.reading.effort["arm_lift"], 7.0 * Q[:, 1], atol=1e-8)
    assert any("are read in the scene's order" in line for line in motion.warnings)
    text = lowstate(motors, T)
    with pytest.raises(TrajectoryError, match="no column is a joint of the scene"):
        load(tmp_path, text, scene=legs("left_knee_joint", "left_elbow_joint"))
    more = motors | {2: motors[0]}
    assert "no column is a joint of the scene" in refused(tmp_path, lowstate(more, T))
    lines = text.split("\n")
    assert "at line 202" in refused(tmp_path, "\n".join([*lines[:201], *lines[1:200]]))
    assert "no samples" in refused(tmp_path, lines[0][:200])
