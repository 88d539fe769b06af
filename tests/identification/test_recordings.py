"""Logs as identification sees them: payloads, gains, parts of long logs, what is missing."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from identify_cases import (
    NAMES,
    PLAIN,
    csv_log,
    excitation,
    guess,
    log,
    logged,
    motor_effort,
    short,
    truth,
)
from log_cases import write_csv

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification import columns
from pinfric.identification.columns import blocks, prepare, thinning
from pinfric.identification.laws import Law
from pinfric.identification.recordings import read_recordings
from pinfric.motions.log.reading import ReadingOptions, Thinning


def test_a_payload_is_of_the_log_at_its_path(tmp_path):
    box = {"link": "tool0", "mass": 1.0, "com": (0.0, 0.0, 0.1), "attached": False}
    scene = guess(0).with_(payloads={"box": box})
    paths = [tmp_path / day / "log.csv" for day in ("monday", "tuesday")]
    for seed, path in enumerate(paths):
        path.parent.mkdir()
        csv_log(path, seed, 40.0)
    read = read_recordings(scene, paths, {}, {str(paths[1]): "box"}, pf.ReadingOptions())
    assert [one.trajectory.attached.any() for one in read] == [False, True]
    assert [one.name for one in read] == [str(path) for path in paths]
    with pytest.raises(IdentificationError, match="there is no log 'log"):
        read_recordings(scene, paths, {}, {"log.csv": "box"}, pf.ReadingOptions())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"gain": {"elbow": 2.0}}, "there is no joint 'elbow'"),
        ({"gain": {NAMES[2]: 0.0}}, "should be finite, not zero"),
        ({"gain": {NAMES[2]: np.nan}}, "should be finite, not zero"),
        ({"payloads": {"log": "box"}}, "has no payload 'box'"),
        ({"payloads": {"lgo": "box"}}, "there is no log 'lgo'"),
        ({"options": ReadingOptions(without=["elbow"])}, "without: there is no joint 'elbow'"),
        ({"options": ReadingOptions(without=NAMES)}, "nothing is left to identify"),
        ({"effort_at": "shaft"}, "--effort-at shaft"),
        ({"inertia": "new"}, "--inertia new"),
        ({"laws": {"elbow": Law()}}, "there is no joint 'elbow'"),
        ({"logs": lambda x: replace(x, effort=None)}, "no measured effort of shoulder_pan_joint"),
        (
            {"logs": lambda x: replace(x, t=x.t[:90], q=x.q[:90], effort=x.effort[:90])},
            "samples can be used; at least 100 are needed",
        ),
        ({"logs": lambda _: []}, "needs a log"),
        ({"logs": lambda x: [x, replace(x, name="again")]}, "are the same log"),
    ],
)
def test_what_is_not_there_or_no_log_is_named(change, said):
    given = {"logs": lambda x: x} | change
    logs = given.pop("logs")(short())
    with pytest.raises(IdentificationError, match=said):
        pf.identify(guess(0), logs, **given)


def test_way_points_are_no_log():
    with pytest.raises(IdentificationError, match="holds way-points"):
        pf.identify(pf.load_scene("ur5_pick_and_place"), "ur5_pick_and_place.waypoints.yaml")


def test_what_springs_give_is_taken_out_of_a_log():
    """The same motion with less effort by a hose's torque, and the hose in the scene."""
    hose = {"kind": "hose", "name": "hose", "joint": truth().joint_names[1], "torque": 9.0}
    motion = excitation(0, 10.0, 100.0)
    effort = motor_effort(truth(), motion)
    helped = effort - 9.0 * (np.arange(effort.shape[1]) == 1)
    plain, sprung = (
        prepare(
            scene,
            read_recordings(scene, [pf.Log(motion.t, motion.q, y)], {}, {}, pf.ReadingOptions())[0],
        )
        for scene, y in ((truth(), effort), (truth().with_(springs=[hose]), helped))
    )
    t = motion.t[50:-50]
    np.testing.assert_allclose(sprung.effort(t), plain.effort(t), atol=1e-6)


@pytest.mark.slow
def test_a_long_log_is_prepared_in_parts_as_in_one(monkeypatch):
    motion = excitation(0, 30.0, 100.0)
    given = pf.Log(motion.t, motion.q, motor_effort(truth(), motion))
    (recording,) = read_recordings(truth(), [given], {}, {}, pf.ReadingOptions())
    whole = prepare(truth(), recording)
    monkeypatch.setattr(columns, "PART", 500)
    tracemalloc.start()
    parts = prepare(truth(), recording)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert parts.rigid == pytest.approx(whole.rigid, abs=1e-9 * np.abs(whole.rigid).max())
    # the regressor of all samples would be 3000 x 6 x 60 numbers, and twice that to filter it
    assert most - parts.rigid.nbytes < 1.5 * 3000 * 6 * 60 * 8
    assert thinning([recording] * 120) == 8
    assert prepare(truth(), recording, 5).kept.size == pytest.approx(whole.kept.size / 5, abs=1)
    assert blocks(np.arange(0.0, 3600.0, 0.1))[0] == 200


@pytest.mark.filterwarnings(
    "ignore:.*(column t is|filtered at|left out|reaches .* above its velocity limit)"
)
def test_samples_beyond_what_is_fitted_are_left_out():
    fast, slow = log(0, 10.0, 500.0), log(0, 10.0, 125.0)
    given = [
        read_recordings(truth(), [one], {}, {}, pf.ReadingOptions())[0] for one in (fast, slow)
    ]
    assert [one.step for one in given] == pytest.approx([0.008, 0.008])
    place = np.rint(given[0].trajectory.t / 0.002).astype(int)
    assert given[0].trajectory.t == pytest.approx(place * 0.002, abs=1e-6)
    assert np.all(np.diff(place) == 4)
    assert place.size > 1200  # but for the ends
    # four samples of noise are averaged to one
    noise = [np.std(np.diff(one.effort[:, 5], 2)) for one in given]
    assert noise[0] < 0.8 * noise[1]
    exact = excitation(0, 10.0, 500.0).a[place]
    assert given[0].trajectory.a[50:-50] == pytest.approx(exact[50:-50], abs=0.05)
    # what noise leaves and what the log says are those of the samples kept
    options = ReadingOptions(thinning=Thinning(125.0, 40.0))
    reading = pf.load_trajectory(fast, truth(), options).reading
    assert reading.uncertain is not None
    assert len(reading.uncertain.moving) == len(reading.effort[NAMES[0]]) == place.size


def test_a_gain_makes_efforts_of_logged_currents(tmp_path):
    motion = excitation(3, 12.0, 250.0)
    log = logged(3, motion, motor_effort(truth(), motion))
    names = truth().joint_names
    header = [f"{n}/{kind}" for kind in ("position", "current") for n in names]
    table = np.hstack((log.q, log.effort / 10.0))
    path = write_csv(tmp_path / "log.csv", log.t, header, table, "%.18e")
    found = read_recordings(guess(3), [path], dict.fromkeys(names, 10.0), {}, ReadingOptions())
    direct = read_recordings(guess(3), [log], {}, {}, ReadingOptions())
    np.testing.assert_allclose(found[0].effort, direct[0].effort, rtol=1e-6, atol=1e-6)
    with pytest.raises(IdentificationError, match=r"no measured effort.*--gain"):
        read_recordings(guess(3), [path], {}, {}, ReadingOptions())


def test_joints_without_usable_efforts_are_left_out_and_still_move(tmp_path):
    """Their columns are empty; the other joints' friction is that of the whole log."""
    one, given = short(), {"laws": PLAIN, "inertia": "keep"}
    header = [*NAMES, *(f"{name}/effort" for name in NAMES)]
    path = write_csv(tmp_path / "log.csv", one.t, header, np.hstack((one.q, one.effort)), "%.17g")
    rows = path.read_text().splitlines()
    path.write_text("\n".join([rows[0], *(row.rsplit(",", 2)[0] + ",," for row in rows[1:])]))
    with pytest.raises(pf.errors.TrajectoryError):
        pf.identify(truth(), path, **given)
    found = pf.identify(truth(), path, options=ReadingOptions(without=NAMES[4:]), **given)
    whole = pf.identify(truth(), one, **given)
    assert set(found.laws) == set(NAMES[:4])
    assert {p.joint for p in found.parameters} == set(NAMES[:4])
    for name in NAMES[4:]:
        assert found.scene.friction[name] == truth().friction[name]
    same = {p.key: p.value for p in whole.parameters}
    for p in found.parameters:
        assert p.value == pytest.approx(same[p.key], rel=0.02, abs=0.02)
    said = f"left out by --without, keeps the scene's friction: {', '.join(NAMES[4:])}"
    assert said in found.notes
    assert not any("never slides" in line for line in found.notes)


@pytest.mark.filterwarnings("ignore:.*(columns not used|in degrees|above its velocity limit)")
@pytest.mark.parametrize("unit", [1.0, np.pi / 180.0])  # degrees: of the others, who say so
@pytest.mark.parametrize(("way", "refused"), [(0.7, True), (0.01, False)])
def test_a_joint_that_the_scene_locks_and_that_moves_is_refused(way, refused, unit, tmp_path):
    urdf = "example-robot-data:ur_description/urdf/ur10_robot.urdf"
    text = f"pinfric: 1\nrobot: {{urdf: '{urdf}', locked: {{{NAMES[4]}: 0.5}}}}\n"
    (tmp_path / "ur10.yaml").write_text(text)
    q = excitation(3, 4.0, 100.0).q
    q[:, 4] = 0.5 + way * np.sin(np.arange(len(q)) / 50.0)
    path = write_csv(tmp_path / "log.csv", np.arange(len(q)) / 100.0, NAMES, q / unit)
    scene = pf.load_scene(tmp_path / "ur10.yaml")
    if not refused:
        pf.load_trajectory(path, scene)
        return
    said = (
        rf"joint {NAMES[4]}: the scene locks it at 0.5, .* from -0.2 to 1.2,.*--without {NAMES[4]}"
    )
    with pytest.raises(pf.errors.TrajectoryError, match=said):
        pf.load_trajectory(path, scene)


def test_a_locked_slide_moves_in_m_where_angles_are_in_degrees(tmp_path):
    joints = "".join(
        f"<link name='{link}'><inertial><mass value='1'/><origin xyz='.1 0 0'/><inertia ixx='.1' "
        f"iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/></inertial></link><joint name='{name}' "
        f"type='{kind}'><parent link='{parent}'/><child link='{link}'/><axis xyz='0 0 1'/>"
        "<limit lower='-3' upper='3' effort='9' velocity='9'/></joint>"
        for name, kind, parent, link in (
            ("turn", "revolute", "base", "arm"),
            ("slide", "prismatic", "arm", "tool"),
        )
    )
    (tmp_path / "arm.urdf").write_text(f"<robot name='arm'><link name='base'/>{joints}</robot>")
    text = "pinfric: 1\nrobot: {urdf: arm.urdf, locked: {slide: 0.1}}\n"
    (tmp_path / "arm.yaml").write_text(text)
    t = np.arange(400) / 100.0
    columns = np.column_stack((np.degrees(np.sin(t)), 0.2 + 0.2 * np.sin(2.0 * t)))
    path = write_csv(tmp_path / "log.csv", t, ["turn [deg]", "slide"], columns)
    with pytest.raises(pf.errors.TrajectoryError, match=r"locks it at 0.1, .* from \S+ to 0.4,"):
        pf.load_trajectory(path, pf.load_scene(tmp_path / "arm.yaml"))


@pytest.mark.slow
def test_torques_at_the_shafts_are_multiplied_by_the_ratios():
    given = {"inertia": "keep", "laws": PLAIN}
    scene, one = guess(0), short()
    ratio = np.array([drive.ratio for drive in scene.drives])
    found, reflected = (
        pf.identify(scene, replace(one, effort=effort), effort_at=at, **given)
        for at, effort in (("motor", one.effort / ratio), ("reflected", one.effort))
    )
    values, same = (np.array([p.value for p in x.parameters]) for x in (found, reflected))
    np.testing.assert_allclose(values, same, rtol=1e-9)
    assert any("torques at the motors' shafts (ratio" in line for line in found.notes)
