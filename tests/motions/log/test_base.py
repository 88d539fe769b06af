"""Logs of robots whose base floats: its pose, and the forces on the feet."""

import warnings
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from rich.console import Console
from standing_cases import FEET, biped, efforts, squat

import pinfric as pf
from pinfric.errors import PinfricError
from pinfric.model.coordinates import WRENCH
from pinfric.model.described import in_json
from pinfric.model.entry import parse
from pinfric.model.floating import POSE, base_configuration, base_motion, base_numbers, base_rates
from pinfric.motions.log.columns import ColumnsFile
from pinfric.motions.log.judged import judge_log
from pinfric.show.inverse_summary import inverse_summary
from pinfric.show.report.inverse import inverse_report, verdict

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
QUATERNION = tuple("xyzw")
ODOMETRY = "/odom/pose/pose/"


def recorded(tmp_path, friction="coulomb: 2.0", noise=0.0):
    """A scene, its squat, and a log's columns: ROS's odometry, joints, wrenches by foot."""
    scene = pf.load_scene(biped(tmp_path, friction))
    case = squat(scene)
    q, rng = case.motion.q, np.random.default_rng(0)
    columns = {"t": case.columns["t"]}
    columns |= {f"{ODOMETRY}position/{x}": q[:, k] for k, x in enumerate("xyz")}
    columns |= {f"{ODOMETRY}orientation/{x}": q[:, 3 + k] for k, x in enumerate(QUATERNION)}
    columns |= {name: x for name, x in case.columns.items() if not name.startswith(("t", "root"))}
    columns = {n: x + noise * rng.normal(size=x.shape) * (n != "t") for n, x in columns.items()}
    for foot in FEET:
        for k, part in enumerate("xyz"):
            columns[f"/{foot}/wrench/force/{part}"] = case.forces[foot][:, k]
            columns[f"/{foot}/wrench/torque/{part}"] = case.forces[foot][:, 3 + k]
    return scene, case, columns


def write(folder, columns, mapping=None, name="log.csv"):
    file = folder / name
    table = pd.DataFrame(columns)
    if file.suffix == ".parquet":
        table.to_parquet(file)
    else:
        table.to_csv(file, index=False)
    if mapping is not None:
        (folder / "log.columns.yaml").write_text(yaml.safe_dump(mapping))
    return file


def test_numbers_and_motions_of_a_base_are_those_of_pinocchio():
    """Derivatives by finite differences of poses through Pinocchio's own free flyer."""
    import pinocchio as pin

    rng, step = np.random.default_rng(1), 1e-4
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    numbers, rates, bends = (rng.uniform(-1.2, 1.2, (50, 6)) for _ in range(3))
    v, a = base_motion(numbers, rates, bends)

    def pose(t):
        return base_configuration(numbers + t * rates + t**2 / 2 * bends)

    for i in range(50):
        before, here, after = (pose(t)[i] for t in (-step, 0.0, step))
        ahead = pin.difference(model, here, after)
        back = pin.difference(model, before, here)
        np.testing.assert_allclose((ahead + back) / 2 / step, v[i], atol=1e-6)
        rate = [
            base_motion(numbers + t * rates, rates + t * bends, bends)[0][i] for t in (-step, step)
        ]
        np.testing.assert_allclose((rate[1] - rate[0]) / 2 / step, a[i], atol=1e-6)
    again = base_rates(numbers, v, a)
    np.testing.assert_allclose(base_numbers(base_configuration(numbers)), numbers, atol=1e-12)
    np.testing.assert_allclose(again, (rates, bends), atol=1e-11)


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_a_log_has_base_and_feet(tmp_path, name):
    scene, case, columns = recorded(tmp_path)
    motion = pf.load_trajectory(write(tmp_path, columns, name=name), scene)
    assert list(motion.external) == list(FEET)
    inner = slice(20, -20)
    np.testing.assert_allclose(motion.q, case.motion.q, atol=1e-9)
    np.testing.assert_allclose(motion.v[inner], case.motion.v[inner], atol=1e-5)
    np.testing.assert_allclose(motion.a[inner], case.motion.a[inner], atol=2e-3)
    result = pf.inverse_dynamics(scene, motion)
    expected = efforts(scene.model, case.motion.q, case.motion.v, case.motion.a, case.forces)
    found = result.effort_frictionless
    np.testing.assert_allclose(found[inner], expected[inner, 6:], atol=0.05)
    assert np.abs(result.base_residual[inner]).max() < 0.1
    assert any("quaternion x, y, z, w" in note for note in motion.warnings)


@pytest.mark.parametrize("kind", ["nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"])
def test_a_bag_has_base_and_feet(tmp_path, kind):
    """Their messages come at other times than the joints'; a quaternion changes its sign."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    scene, case, _ = recorded(tmp_path)
    types = get_typestore(Stores.LATEST)
    make, (q, t) = types.types, (case.motion.q, case.motion.t)

    def header(at):
        at = 1_700_000_000_000_000_000 + round(at * 1e9)
        stamp = make["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
        return at, make["std_msgs/msg/Header"](stamp=stamp, frame_id="")

    def vector(name, *numbers):
        return make[f"geometry_msgs/msg/{name}"](*map(float, numbers))

    kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/odom": kind}
    kinds |= {f"/{foot}/wrench": "geometry_msgs/msg/WrenchStamped" for foot in FEET}
    later = np.minimum(t + 0.002, t[-1])  # linear between samples 10 ms apart
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        to = {x: writer.add_connection(x, own, typestore=types) for x, own in kinds.items()}
        for i in range(len(t)):
            names, none = [name for name in scene.joint_names if name != "root_joint"], np.zeros(0)
            place = q[i, :7] if i == len(t) - 1 else q[i, :7] + 0.2 * (q[i + 1, :7] - q[i, :7])
            point, turn = place[:3], (-1) ** i * place[3:]
            pose = make["geometry_msgs/msg/Pose"](
                vector("Point", *point), vector("Quaternion", *turn)
            )
            made = {"/joint_states": (t[i], (names, q[i, 7:], none, none))}
            if kind.endswith("Odometry"):
                covered = make["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
                still = make["geometry_msgs/msg/Twist"](
                    vector("Vector3", 0, 0, 0), vector("Vector3", 0, 0, 0)
                )
                moved = make["geometry_msgs/msg/TwistWithCovariance"](still, np.zeros(36))
                made["/odom"] = later[i], ("base", covered, moved)
            else:
                made["/odom"] = later[i], (pose,)
            for foot in FEET:
                f = case.forces[foot][i]
                wrench = vector("Vector3", *f[:3]), vector("Vector3", *f[3:])
                made[f"/{foot}/wrench"] = t[i], (make["geometry_msgs/msg/Wrench"](*wrench),)
            for topic, (at, content) in made.items():
                stamp, head = header(at)
                message = make[kinds[topic]](head, *content)
                writer.write(to[topic], stamp, types.serialize_cdr(message, kinds[topic]))
    motion = pf.load_trajectory(tmp_path / "bag", scene)
    assert list(motion.external) == list(FEET)
    np.testing.assert_allclose(motion.q, q, atol=2e-5)
    for foot in FEET:
        np.testing.assert_allclose(motion.external[foot], case.forces[foot], atol=1e-9)


def test_noise_is_filtered_as_any_joints(tmp_path):
    scene, case, columns = recorded(tmp_path, noise=1e-4)
    motion = pf.load_trajectory(write(tmp_path, columns), scene)
    at = np.searchsorted(case.columns["t"], motion.t)
    true = case.motion.a[at]
    raw = np.gradient(np.gradient(columns["left_knee"], 0.01), 0.01)[at]
    assert motion.reading.filtered
    assert np.std(motion.a[:, 7] - true[:, 7]) < 0.3 * np.std(raw - true[:, 7])
    assert np.std(motion.a[:, 2] - true[:, 2]) < 0.5
    np.testing.assert_allclose(motion.external[FEET[0]], case.forces[FEET[0]][at], atol=1e-9)


def test_its_own_files_are_trajectories_again(tmp_path):
    scene, case, _ = recorded(tmp_path)
    file = case.motion.to_csv(tmp_path / "own.csv", digits=17)
    again = pf.load_trajectory(file, scene)
    for name in ("t", "q", "v", "a"):
        np.testing.assert_allclose(getattr(again, name), getattr(case.motion, name), atol=1e-12)
    np.testing.assert_allclose(again.external[FEET[1]], case.forces[FEET[1]], atol=1e-12)
    result = pf.inverse_dynamics(scene, again)
    table = result.to_dataframe()
    assert {f"root_joint.{part}.{x}" for part in POSE for x in "qva"} <= set(table)
    table.to_csv(tmp_path / "efforts.csv", index=False)
    third = pf.load_trajectory(tmp_path / "efforts.csv", scene)
    np.testing.assert_allclose(third.v, again.v, atol=1e-9)
    np.testing.assert_allclose(third.external["left_ankle"], again.external[FEET[0]], atol=1e-9)


def test_columns_may_be_named_in_a_file_and_forces_be_in_the_worlds_axes(tmp_path):
    scene, case, columns = recorded(tmp_path)
    names = [name for name in columns if name != "t"]
    short = dict(zip(["t", *(f"c{i}" for i in range(len(names)))], columns.values(), strict=True))
    at = dict(zip(names, list(short)[1:], strict=True))
    for foot in FEET:  # flat feet: their axes are turned by the heading
        c, s = np.cos(0.7), np.sin(0.7)
        for kind in ("force", "torque"):
            x, y = (at[f"/{foot}/wrench/{kind}/{part}"] for part in "xy")
            short[x], short[y] = c * short[x] - s * short[y], s * short[x] + c * short[y]
    mapping = {
        "joints": {name: at[name] for name in case.columns if name in at},
        "base": {
            "position": [at[f"{ODOMETRY}position/{x}"] for x in "xyz"],
            "quaternion": [at[f"{ODOMETRY}orientation/{x}"] for x in "xyzw"],
        },
        "external": {
            foot: {
                "force": [at[f"/{foot}/wrench/force/{x}"] for x in "xyz"],
                "moment": [at[f"/{foot}/wrench/torque/{x}"] for x in "xyz"],
                "axes": "world",
            }
            for foot in FEET
        },
    }
    motion = pf.load_trajectory(write(tmp_path, short, mapping), scene)
    np.testing.assert_allclose(motion.q, case.motion.q, atol=1e-9)
    for foot in FEET:
        np.testing.assert_allclose(motion.external[foot], case.forces[foot], atol=1e-9)


def spoiled(columns, how):
    """Columns with one thing wrong, and a mapping file or None."""
    turn = [f"{ODOMETRY}orientation/{x}" for x in QUATERNION]
    columns = dict(columns)
    if how == "length":
        columns |= {name: 1.1 * columns[name] for name in turn}
    if how == "order":  # w first, told as x, y, z, w
        values = [columns[name] for name in turn]
        columns |= dict(zip(turn, [values[3], *values[:3]], strict=True))
    if how == "numbered":
        for i, name in enumerate(turn):
            columns[f"quat_{i}"] = columns.pop(name)
    if how == "two":
        columns |= {
            name.replace("odom", "gps"): columns[name] for name in list(columns) if "odom" in name
        }
    if how == "frame":
        return columns, {"external": {"left_fot": {"force": ["left_knee"] * 3}}}
    if how == "column":
        return columns, {"base": {"position": list("abc"), "quaternion": turn}}
    return columns, None


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("length", "are no quaternion: their length is 1.1 at line 2 .rows: 401., and should be 1"),
        ("order", "hangs upside down or lies; as w, x, y, z it stands: write `quaternion:"),
        ("numbered", "no columns are the pose of the free base: name them by --columns FILE"),
        ("two", "several groups of columns may be the pose of the free base"),
        ("frame", "columns: external: there is no frame 'left_fot'; did you mean 'left_foot'"),
        ("column", "columns: base: there is no column 'a'"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, how, says):
    scene, _, columns = recorded(tmp_path)
    file = write(tmp_path, *spoiled(columns, how))
    with pytest.raises(PinfricError, match=says) as refused:
        pf.load_trajectory(file, scene)
    assert "\n" not in str(refused.value)


def test_a_fixed_base_has_no_pose(tmp_path):
    _, case, columns = recorded(tmp_path)
    fixed = (tmp_path / "biped.yaml").read_text().replace("floating: true", "floating: false")
    (tmp_path / "fixed.yaml").write_text(fixed)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        motion = pf.load_trajectory(
            write(tmp_path, columns), pf.load_scene(tmp_path / "fixed.yaml")
        )
    assert motion.q.shape[1] == 6
    assert any("columns not used" in str(w.message) and "odom" in str(w.message) for w in said)
    assert WRENCH[0] == "fx"
    assert case.motion.q.shape[1] == 13


@pytest.mark.parametrize(("low", "says"), [(0.97, "3 % of the weight"), (0.6, "is 10 %: check")])
def test_what_forces_leave_is_on_the_first_screen(tmp_path, low, says):
    scene, _, columns = recorded(tmp_path)
    columns = {n: x * (low if "wrench" in n else 1.0) for n, x in columns.items()}
    motion = pf.load_trajectory(write(tmp_path, columns), scene)
    result = pf.inverse_dynamics(scene, motion)
    summary = inverse_summary(result, "log.csv", judge_log(result, motion.reading))
    console = Console(file=StringIO(), width=200)
    console.print(*inverse_report(result, summary), sep="\n")
    assert says in console.file.getvalue()
    assert in_json(summary)["base"]["within"] == (low > 0.9)
    assert ("do not balance the base" in verdict(result, summary)) == (low < 0.9)


def test_the_guides_columns_are_a_columns_file():
    guide = Path(__file__).parents[3] / "notebooks/guide/legs.md"
    text = guide.read_text(encoding="utf-8").split("```yaml")[1].split("```")[0]
    entries = parse(ColumnsFile, yaml.safe_load(text), "legs.md")
    assert entries.base.quaternion == ("qx", "qy", "qz", "qw")
    assert [wrench.axes for wrench in entries.external.values()] == ["frame", "world"]
