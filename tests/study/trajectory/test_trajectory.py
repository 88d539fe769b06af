"""Trajectories: profiles, way-points, CSV, and every kind of bad file in one message."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, pick_and_place

from pinfric.errors import PinfricError, TrajectoryError
from pinfric.study.trajectory.log.reading import ReadingOptions
from pinfric.study.trajectory.trajectory import Trajectory, load_trajectory


def arm_scene(**attached):
    """A revolute joint a (+-2 rad, 1 rad/s), a slide b (0 to 0.5 m, 0.5 m/s), a wheel c."""
    model = chain(("a", pin.JointModelRZ()), ("b", pin.JointModelPX()), ("c", pin.JointModelRUBY()))
    model.velocityLimit[:2] = 1.0, 0.5
    model.lowerPositionLimit[:2], model.upperPositionLimit[:2] = (-2.0, 0.0), (2.0, 0.5)
    payloads = {name: SimpleNamespace(attached=value) for name, value in attached.items()}
    return SimpleNamespace(model=model, payloads=payloads)


def one_joint_scene(**attached):
    model = chain(("a", pin.JointModelRZ()))
    model.velocityLimit[:] = 1.5
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -2.0, 2.0
    payloads = {name: SimpleNamespace(attached=value) for name, value in attached.items()}
    return SimpleNamespace(model=model, payloads=payloads)


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def message(path, scene) -> str:
    with pytest.raises(TrajectoryError) as caught:
        load_trajectory(path, scene)
    assert isinstance(caught.value, PinfricError)
    assert str(path) in str(caught.value)
    return str(caught.value)


# --- way-points -----------------------------------------------------------------------------------


def test_waypoints_make_the_closed_form_motion(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
sample_rate: 100
points:
  - {q: [0.0, 0.1, 0.0], hold: 0.5}
  - {q: [1.0, 0.3, -4.0], duration: 2.0, hold: 0.25}
""",
    )
    motion = load_trajectory(path, arm_scene())
    assert motion.duration == pytest.approx(2.75)
    assert motion.t.size == 276
    middle = np.searchsorted(motion.t, 1.5 - 1e-9)
    np.testing.assert_allclose(motion.v[middle], 1.875 / 2 * np.array([1.0, 0.2, -4.0]), rtol=1e-12)
    quarter = np.searchsorted(motion.t, 1.0 - 1e-9)
    np.testing.assert_allclose(
        motion.a[quarter], 5.625 / 4 * np.array([1.0, 0.2, -4.0]), rtol=1e-12
    )
    np.testing.assert_allclose(motion.q[quarter, 0], 0.103515625, rtol=1e-12)
    np.testing.assert_allclose(motion.q[-1], [1.0, 0.3, np.cos(-4.0), np.sin(-4.0)], rtol=1e-12)


def test_waypoint_holds_are_exactly_still(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
profile: trapezoidal
sample_rate: 100
points:
  - {q: [0.1], hold: 0.3}
  - {q: [0.7], duration: 0.7, hold: 0.2}
  - {q: [-0.3], duration: 1.0}
""",
    )
    motion = load_trajectory(path, one_joint_scene())
    holds = motion.holds()
    assert [(h.start, h.end) for h in holds] == [(0.0, 0.3), (1.0, 1.2)]
    for hold in holds:
        inside = slice(hold.first, hold.last + 1)
        assert (motion.v[inside] == 0).all()
        assert (motion.a[inside] == 0).all()
        assert np.ptp(motion.q[inside]) == 0
    # elsewhere it moves, except where it arrives
    still = (motion.v[:, 0] == 0) & (motion.a[:, 0] == 0)
    assert still.sum() == 31 + 21 + 1
    assert still[-1]


def test_a_point_without_hold_takes_the_next_moves_acceleration(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
profile: trapezoidal
ramp: 0.5
sample_rate: 100
points: [{q: [0.0]}, {q: [1.0], duration: 1.0}, {q: [0.5], duration: 1.0}]
""",
    )
    motion = load_trajectory(path, one_joint_scene())
    assert motion.a[0, 0] == pytest.approx(4.0)
    assert motion.v[100, 0] == 0.0
    assert motion.a[100, 0] == pytest.approx(-2.0)  # -0.5 x 4 / 1 s^2
    assert motion.holds() == ()


@pytest.mark.parametrize(
    ("profile", "factor"), [("quintic", 15 / 8), ("trapezoidal", 1.5), ("ramp", 1 / 0.8)]
)
def test_missing_duration_uses_the_slowest_joints_velocity_limit(tmp_path, profile, factor):
    kind = "{profile: trapezoidal, ramp: 0.2" if profile == "ramp" else f"{{profile: {profile}"
    path = write(
        tmp_path,
        "move.yaml",
        f"""{kind}, pinfric_trajectory: 1, speed: 0.5,
sample_rate: 1000, points: [{{q: [0, 0, 0]}}, {{q: [1.0, 0.1, 0.0]}}]}}""",
    )
    motion = load_trajectory(path, arm_scene())
    needed = factor * 1.0 / (0.5 * 1.0)
    assert needed <= motion.duration + 1e-12 < needed + 0.001 + 1e-9
    assert np.abs(motion.v[:, 0]).max() == pytest.approx(0.5, rel=1e-3)
    assert motion.warnings == ()


def test_missing_duration_without_limits_is_an_error(tmp_path):
    path = write(
        tmp_path, "move.yaml", "{pinfric_trajectory: 1, points: [{q: [0,0,0]}, {q: [0,0,1]}]}"
    )
    assert "points[1]: needs a `duration`" in message(path, arm_scene())
    assert message(path, arm_scene()).endswith("for c")


def test_end_off_the_sample_grid_is_a_sample(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
{pinfric_trajectory: 1, sample_rate: 10, points: [{q: [0.0]}, {q: [1.0], duration: 0.95}]}
""",
    )
    motion = load_trajectory(path, one_joint_scene())
    np.testing.assert_allclose(motion.t[-2:], [0.9, 0.95])
    assert motion.q[-1, 0] == 1.0
    assert motion.v[-1, 0] == 0.0


def test_waypoint_joint_order_is_free(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
{pinfric_trajectory: 1, joints: [c, a, b], points: [{q: [0.3, 1.0, 0.2], hold: 0.01}]}
""",
    )
    motion = load_trajectory(path, arm_scene())
    np.testing.assert_allclose(motion.joint_positions()[0], [1.0, 0.2, 0.3])
    assert motion.joint_names == ("a", "b", "c")


def test_payload_phases_begin_on_arrival(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
sample_rate: 10
points:
  - {q: [0.0], detach: tool}
  - {q: [1.0], duration: 1.0, hold: 0.5, attach: [box]}
  - {q: [0.0], duration: 1.0, hold: 0.2, detach: box}
""",
    )
    motion = load_trajectory(path, one_joint_scene(box=False, tool=True, cable=True))
    assert motion.payload_names == ("box", "tool", "cable")
    carried = motion.t[motion.attached[:, 0]]
    assert carried[0] == pytest.approx(1.0)
    assert carried[-1] == pytest.approx(2.4)
    assert not motion.attached[:, 1].any()
    assert motion.attached[:, 2].all()


def test_bad_waypoints_are_listed_together(tmp_path, monkeypatch):
    monkeypatch.setattr("pinfric.errors._MOST_PROBLEMS", 99)
    path = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
ramp: 0.2
joints: [a, bb, c]
points:
  - {q: [0, 0, 0], duration: 1.0, attach: box}
  - {q: [0, 0], duration: 1.0, attach: bax}
""",
    )
    text = message(path, arm_scene(box=True))
    for part in (
        "7 problems",
        "unknown joint 'bb'; did you mean 'b'?",
        "missing b",
        "points[0].duration",
        "'box' is attached already",
        "unknown payload 'bax'; did you mean 'box'?",
        "points[1].q: 2 numbers for 3 joints",
        "ramp: belongs to profile: trapezoidal",
    ):
        assert part in text, part


def test_unknown_waypoint_keys_name_the_nearest(tmp_path):
    path = write(
        tmp_path,
        "move.yaml",
        """
{pinfric_trajectory: 1, sample_rat: 100, points: [{q: [0.0], hlod: 1.0}, {q: [.nan]}]}
""",
    )
    text = message(path, one_joint_scene())
    assert "unknown key `sample_rat`; did you mean 'sample_rate'?" in text
    assert "unknown key `points[0].hlod`; did you mean 'hold'?" in text
    assert "points[1].q[0]" in text


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("points: [{q: [0.0]}]", "`pinfric_trajectory` is missing"),
        ("{pinfric_trajectory: 1, points: []}", "points"),
        ("[1, 2]", "should be a mapping"),
        ("", "an empty file"),
        ("{points: [", "not valid YAML"),
        ("{pinfric_trajectory: 1, points: [{q: [true]}]}", "points[0].q[0]"),
        ("{pinfric_trajectory: 1, points: [{q: [0.0]}, {q: [1.0], duration: 1.0e+9}]}", "samples"),
        (
            "{pinfric_trajectory: 1, points: [{q: [0.0]}, {q: [2.5]}]}",
            "joint a: 2.5 rad is above its upper limit 2 (first at t = ",
        ),
    ],
)
def test_bad_waypoint_files(tmp_path, text, part):
    assert part in message(write(tmp_path, "move.yaml", text), one_joint_scene())


# --- CSV -----------------------------------------------------------------------------------------


def test_csv_without_derivatives(tmp_path):
    t = np.linspace(0, 2, 201)
    rows = np.column_stack((t, np.sin(t), 0.25 + 0.1 * np.cos(t), 3 * t))
    path = tmp_path / "m.csv"
    np.savetxt(path, rows, delimiter=",", header="t, a, b, c", comments="", fmt="%.15g")
    motion = load_trajectory(path, arm_scene())
    assert motion.q.shape == (201, 4)
    np.testing.assert_allclose(motion.q[:, 2], np.cos(3 * t), atol=1e-14)
    np.testing.assert_allclose(motion.q[:, 3], np.sin(3 * t), atol=1e-14)
    np.testing.assert_allclose(motion.v[:, 0], np.cos(t), atol=1e-9)
    np.testing.assert_allclose(motion.v[:, 2], 3.0, atol=1e-9)
    np.testing.assert_allclose(motion.a[:, 1], -0.1 * np.cos(t), atol=1e-6)
    np.testing.assert_allclose(motion.joint_positions()[:, 2], 3 * t, atol=1e-14)
    assert motion.joint_nq == (1, 1, 2)


def test_csv_column_order_comments_blank_lines_and_bom(tmp_path):
    path = write(tmp_path, "m.csv", "\ufeff# a comment\nc,b,t,a\n\n0,0.1,0,1\n# more\n0,0.1,1,1\n")
    motion = load_trajectory(path, arm_scene())
    np.testing.assert_array_equal(motion.t, [0, 1])
    np.testing.assert_array_equal(motion.q, [[1, 0.1, 1, 0]] * 2)


def test_given_derivatives_are_kept(tmp_path):
    path = write(tmp_path, "m.csv", "t,a,a.v,a.a\n0,0,5,7\n1,0,6,8\n2,1,-1,9\n")
    motion = load_trajectory(path, one_joint_scene())
    np.testing.assert_array_equal(motion.v[:, 0], [5, 6, -1])
    np.testing.assert_array_equal(motion.a[:, 0], [7, 8, 9])
    assert motion.warnings == (
        "joint a: reaches 6 rad/s, above its velocity limit 1.5 (first at t = 0 s; "
        "samples beyond it: 2)",
    )


def test_acceleration_from_given_velocity_and_velocity_beside_given_acceleration(tmp_path):
    t = np.linspace(0, 1, 101)
    for column, values in (("a.v", np.cos(t)), ("a.a", np.full(101, 4.0))):
        path = tmp_path / "m.csv"
        np.savetxt(
            path,
            np.column_stack((t, np.sin(t), values)),
            delimiter=",",
            header=f"t,a,{column}",
            comments="",
            fmt="%.15g",
        )
        motion = load_trajectory(path, one_joint_scene())
        np.testing.assert_allclose(motion.v[:, 0], np.cos(t), atol=1e-8)
        expected = -np.sin(t) if column == "a.v" else np.full(101, 4.0)
        np.testing.assert_allclose(motion.a[:, 0], expected, atol=1e-8)


def test_csv_holds_are_exactly_still(tmp_path):
    t, q, v, _ = pick_and_place(17)
    path = tmp_path / "m.csv"
    np.savetxt(path, np.column_stack((t, q)), delimiter=",", header="t,a", comments="", fmt="%.6f")
    motion = load_trajectory(path, one_joint_scene())
    assert len(motion.holds()) == 3
    for hold, start, end in zip(motion.holds(), (0, 2, 3.5), (1, 2.5, 4), strict=True):
        assert hold.start == pytest.approx(start, abs=0.01)
        assert hold.end == pytest.approx(end, abs=0.01)
    np.testing.assert_allclose(motion.v[:, 0], v, atol=2e-3)


def test_coarse_positions_are_filtered_or_pointed_out(tmp_path):
    t, q, _, true = pick_and_place(17)
    scene, path = one_joint_scene(), tmp_path / "m.csv"
    for digits in (4, 9):
        np.savetxt(
            path,
            np.column_stack((t, q)),
            delimiter=",",
            header="t,a",
            comments="",
            fmt=f"%.{digits}f",
        )
        motion = load_trajectory(path, scene)
        noisy = [w for w in motion.warnings if "noise" in w]
        assert [re.sub(r"at [\d.]+ Hz", "at x Hz", w) for w in noisy] == (
            [] if digits == 9 else ["filtered at x Hz, noise 2.9e-05 rad"]
        )
        assert np.abs(motion.a).max() == pytest.approx(np.abs(true).max(), rel=0.01)
        if digits == 4:
            plain = load_trajectory(path, scene, ReadingOptions(cutoff="none")).warnings[0]
            assert plain.startswith(
                "not filtered, noise 2.9e-05 rad, error left in accelerations 1.4e+02"
            )


def test_a_joint_that_stands_still_has_no_noise_to_warn_of(tmp_path):
    path = tmp_path / "still.csv"
    path.write_text("t,a\n" + "\n".join(f"{0.001 * i:.3f},0.123" for i in range(200)))
    motion = load_trajectory(path, one_joint_scene())
    assert motion.warnings == ()
    assert not motion.a.any()


def test_csv_payload_columns_and_defaults(tmp_path):
    path = write(tmp_path, "m.csv", "t,a,payload.box\n0,0,0\n1,0,1\n2,0,1\n3,0,0\n")
    motion = load_trajectory(path, one_joint_scene(tool=True, box=True))
    np.testing.assert_array_equal(motion.attached, [[1, 0], [1, 1], [1, 1], [1, 0]])


def test_round_trip_keeps_every_bit(tmp_path):
    yaml = write(
        tmp_path,
        "move.yaml",
        """
pinfric_trajectory: 1
sample_rate: 250
points:
  - {q: [0.0, 0.1, 0.0], hold: 0.1}
  - {q: [1.0, 0.3, -7.0], duration: 2.0, hold: 0.1, attach: box}
""",
    )
    scene = arm_scene(box=False)
    first = load_trajectory(yaml, scene)
    second = load_trajectory(first.to_csv(tmp_path / "exact.csv", digits=17), scene)
    for name in ("t", "v", "a", "attached"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(first.q[:, :2], second.q[:, :2])
    np.testing.assert_allclose(first.q, second.q, atol=3e-15)  # cos, sin -> angle -> cos, sin
    third = load_trajectory(first.to_csv(tmp_path / "nine.csv"), scene)
    np.testing.assert_allclose(first.a, third.a, rtol=1e-8)
    assert [(h.first, h.last) for h in third.holds()] == [(h.first, h.last) for h in first.holds()]
    assert "-0," not in (tmp_path / "nine.csv").read_text()


def test_all_problems_of_a_csv_in_one_error(tmp_path, monkeypatch):
    monkeypatch.setattr("pinfric.errors._MOST_PROBLEMS", 99)
    path = write(
        tmp_path,
        "m.csv",
        "\n".join(
            [
                "t,a,bb,c,payload.bax,a.w,c",
                "0,0,0,0,0,0,0",
                "1,nan,0,0,0,0,0",
                "1,3.5,0,0,0,0,0",
                "2,-4,0,0,0,0",
                "3,inf,0,oops,0,0,0",
                "2.5,-2.5,0,,0,0,0",
            ]
        ),
    )
    text = message(path, arm_scene(box=True))
    for part in (
        "unknown payload in column 'payload.bax'; did you mean 'box'?",
        "column 'c' occurs 2 times",
        "joints without a column: b (columns not used: 'bb', 'a.w')",
        "the header has 7 columns; rows with another number of cells: line 5 (6)",
        "not a number: line 6, column c: 'oops', line 7, column c: ''",
        "column a: nan at sample 1 (line 3), inf at sample 3 (line 6)",
        "time must increase; it does not at line 4 (t = 1 after 1), line 7 (t = 2.5 after 3)",
        "joint a: 3.5 rad is above its upper limit 2 (first at t = 1 s",
        "joint a: -2.5 rad is below its lower limit -2 (first at t = 2.5 s",
    ):
        assert part in text, part
    assert ": 9 problems:" in text


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "is empty"),
        ("# only a comment\n", "is empty"),
        ("t,a\n", "no samples below"),
        ("0,1\n1,1\n", "has no header: its first line holds numbers"),
        ("s,a\n0,1\n1,1\n", "there is no column t (time, s), nor time, timestamp or __time"),
        ("t,a\n0,1\n", "one sample has no derivatives: give .v and .a for a"),
        ("t,a,a.v\n0,1,0\n", "one sample has no derivatives: give .v and .a for a"),
        ("t,a,payload.box\n0,1,0.5\n1,1,1\n", "column payload.box: 1 (carried) or 0, found 0.5"),
        ("t,a\n0,1,2\n1,2,3\n", "rows with another number of cells: line 2 (3), line 3 (3)"),
        ("t,a\nx,1\n", "not a number: line 2, column t: 'x'"),
    ],
)
def test_bad_csv_files(tmp_path, text, part):
    assert part in message(write(tmp_path, "m.csv", text), one_joint_scene(box=True))


def test_long_lists_of_problems_are_cut_and_counted(tmp_path):
    rows = "\n".join(f"{i},nan" for i in range(5000))
    text = message(write(tmp_path, "m.csv", f"t,a\n{rows}\n"), one_joint_scene())
    assert "(5000 in all)" in text
    assert len(text) < 1000


def test_one_sample_with_derivatives_is_fine(tmp_path):
    path = write(tmp_path, "m.csv", "t,a,a.v,a.a\n0,1,0.5,-3\n")
    motion = load_trajectory(path, one_joint_scene())
    assert (motion.duration, motion.v[0, 0], motion.a[0, 0]) == (0.0, 0.5, -3.0)


def test_moving_across_a_gap_is_an_error_and_holding_across_it_is_not(tmp_path):
    scene = one_joint_scene()
    moving = "\n".join(f"{t},{0.1 * t}" for t in [*np.arange(0, 1, 0.01), *np.arange(5, 6, 0.01)])
    text = message(write(tmp_path, "m.csv", "t,a\n" + moving), scene)
    assert "joint a: moves across gaps in time (0.99 to 5 s)" in text
    held = "\n".join(f"{t},0.5" for t in [*np.arange(0, 1, 0.01), *np.arange(5, 6, 0.01)])
    assert (load_trajectory(write(tmp_path, "h.csv", "t,a\n" + held), scene).v == 0).all()


def test_files_that_cannot_be_read(tmp_path):
    scene = one_joint_scene()
    assert "there is no file" in message(tmp_path / "none.csv", scene)
    assert "there is no file" in message(tmp_path / "none.yaml", scene)
    assert "ends in .csv, .yaml or .yml" in message(write(tmp_path, "m.doc", "t,a"), scene)
    binary = tmp_path / "b.csv"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    assert "not a text file" in message(binary, scene)


def test_planar_and_floating_joints_are_for_python_only(tmp_path):
    model = chain(("base", pin.JointModelFreeFlyer()), ("a", pin.JointModelRZ()))
    scene = SimpleNamespace(model=model, payloads={})
    path = write(tmp_path, "m.csv", "t,a\n0,0\n1,0\n")
    assert "not enough for base (6 degrees of freedom)" in message(path, scene)
    q = np.tile(pin.neutral(model), (3, 1))
    motion = Trajectory.from_arrays(scene, [0, 1, 2], q, np.zeros((3, 7)), np.zeros((3, 7)))
    assert motion.joint_names == ("base", "a")
    with pytest.raises(TrajectoryError, match="have several positions"):
        motion.to_csv(tmp_path / "out.csv")
    with pytest.raises(TrajectoryError, match="needs v and a given"):
        Trajectory.from_arrays(scene, [0, 1, 2], q)


def test_mimic_followers_have_no_column(tmp_path):
    urdf = """<robot name="hand"><link name="base"/>{}
<joint name="left" type="prismatic"><parent link="base"/><child link="l"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
<joint name="right" type="prismatic"><parent link="base"/><child link="r"/><axis xyz="-1 0 0"/>
<mimic joint="left"/><limit lower="0" upper="0.04" effort="1" velocity="1"/></joint>
</robot>""".format(
        "".join(
            f'<link name="{n}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" '
            'iyz="0" izz="1"/></inertial></link>'
            for n in "lr"
        )
    )
    model = pin.buildModelFromXML(urdf, mimic=True)
    scene = SimpleNamespace(model=model, payloads={})
    motion = load_trajectory(write(tmp_path, "m.csv", "t,left\n0,0.01\n1,0.01\n"), scene)
    assert motion.joint_names == ("left",)
    assert motion.q.shape == (2, model.nq) == (2, 1)
    path = write(tmp_path, "n.csv", "t,left,right\n0,0.01,0.01\n1,0.01,0.01\n")
    assert load_trajectory(path, scene).warnings == ("columns not used: 'right'",)


# --- the object ----------------------------------------------------------------------------------


def test_with_speed_scales_time_and_derivatives():
    t = np.linspace(1, 3, 201)
    scene = one_joint_scene(box=True)
    slow = Trajectory.from_arrays(scene, t, np.sin(t)[:, None])
    fast = slow.with_speed(2.0)
    assert fast.duration == pytest.approx(1.0)
    again = Trajectory.from_arrays(scene, fast.t, fast.q)
    np.testing.assert_allclose(fast.v, again.v, atol=1e-8)
    np.testing.assert_allclose(fast.a, again.a, atol=1e-5)
    for bad in (0.0, -1.0, np.nan):
        with pytest.raises(TrajectoryError, match="speed scale"):
            slow.with_speed(bad)


def test_from_arrays_checks_everything():
    scene = arm_scene(box=True)
    good = np.tile([0.0, 0.1, 1.0, 0.0], (3, 1))
    with pytest.raises(TrajectoryError, match=r"2 problems: q has shape \(3, 3\).*; v has shape"):
        Trajectory.from_arrays(scene, [0, 1, 2], good[:, :3], v=np.zeros((2, 3)))
    with pytest.raises(TrajectoryError, match="unknown payload 'bix'; did you mean 'box'"):
        Trajectory.from_arrays(scene, [0, 1, 2], good, attached={"bix": True})
    with pytest.raises(TrajectoryError, match="time must increase; it does not after samples 1"):
        Trajectory.from_arrays(scene, [0, 1, 1], good)
    with pytest.raises(TrajectoryError, match="joint a: 9 rad is above"):
        Trajectory.from_arrays(scene, [0, 1, 2], good + np.array([9, 0, 0, 0]))
    with pytest.raises(TrajectoryError, match=r"q\[2:4\] is \(cos, sin\).*samples 0, 1, 2"):
        Trajectory.from_arrays(scene, [0, 1, 2], good * 1.1)
    with pytest.raises(TrajectoryError, match="q is not finite at samples 1"):
        Trajectory.from_arrays(scene, [0, 1, 2], np.where([[0], [1], [0]], np.nan, good))
    kept = Trajectory.from_arrays(scene, [0, 1, 2], good, attached={"box": [1, 0, 1]})
    np.testing.assert_array_equal(kept.attached[:, 0], [True, False, True])


def test_trajectory_refuses_arrays_that_do_not_agree():
    three, two = np.zeros((3, 1)), np.zeros((2, 1))
    none = np.zeros((3, 0), bool)
    with pytest.raises(TrajectoryError, match=r"here: a has shape \(2, 1\)"):
        Trajectory(np.arange(3), three, three, two, none, (), ("a",), "here")
    with pytest.raises(TrajectoryError, match="no samples"):
        Trajectory(np.empty(0), *(np.empty((0, 1)),) * 3, np.empty((0, 0)), (), ("a",), "here")


def test_time_steps_that_cannot_be_meant(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("t,a\n0,0\n1e-300,0.1\n1,0.2\n2,0.3\n")
    assert "time steps below 1e-09 s are refused: line 3" in message(file, one_joint_scene())
