"""A starting scene for any URDF: it loads, runs, and lists its guesses."""

import hashlib
import re
import warnings

import numpy as np
import pinocchio as pin
import pytest
import yaml
from robot_cases import each_robot

import pinfric as pf
from pinfric.checking.estimated_masses import estimated_masses
from pinfric.checking.joint_loads import limit_remarks
from pinfric.checking.robot import RobotFacts
from pinfric.errors import PinfricError, PinfricWarning, RobotError, SceneError
from pinfric.model.robot import example_robot_data, locate_urdf, read_robot
from pinfric.model.scene_file import bundled_folder
from pinfric.new_scene import Begun, new_scene, new_waypoints, write_new

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
#: No joint that moves, or no valid URDF: `test_example_robots`.
REFUSED = {"quadrotor_base", "iris_simple", "ur3", "bluevolta", "falcon"}
ARM = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.5 0 0"/><mass value="4"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="rod"><inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{name}" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="{lower}" upper="3" effort="{effort}" velocity="5"/></joint>
  <joint name="slide" type="prismatic"><parent link="upper"/><child link="rod"/>
    <origin xyz="1 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0.1" upper="0.5" effort="0" velocity="1"/></joint>
</robot>"""


def arm(folder, name="shoulder", lower=-3.0, effort=100.0):
    file = folder / "arm.urdf"
    file.write_text(ARM.format(name=name, lower=lower, effort=effort))
    return file


def entries(urdf, folder=None):
    return yaml.safe_load(new_scene(Begun.read(urdf), folder))


@pytest.mark.parametrize("urdf", each_robot())
def test_every_robot_that_loads_gets_a_scene_that_runs(urdf, tmp_path):
    try:
        read_robot(urdf, {})
    except RobotError as refused:
        assert urdf.stem in REFUSED
        with pytest.raises(RobotError, match=re.escape(str(refused))):  # `new` says so, too
            write_new(urdf, tmp_path)
        return
    scene_file, way_file = write_new(urdf, tmp_path)
    scene = pf.load_scene(scene_file)
    one_axis = [joint for joint in scene.model.joints[1:] if joint.nv <= 1]
    massless = scene_file.read_text().count("moves no mass; its friction")
    assert len(scene.sites) + massless == len(one_axis) > 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)
        trajectory = pf.load_trajectory(way_file, scene)
        result = pf.inverse_dynamics(scene, trajectory)
    assert trajectory.warnings == ()
    assert np.isfinite(result.effort_upper).all()
    assert result.sticking.any()
    assert not result.sticking.all()
    assert (result.normal_load >= 0).all()


def test_bundled_urdfs_are_named_as_scenes_name_them(tmp_path):
    urdf = locate_urdf("example-robot-data:ur_description/urdf/ur5_robot.urdf", tmp_path)
    assert entries(urdf)["robot"]["urdf"] == "example-robot-data:ur_description/urdf/ur5_robot.urdf"


def test_urdf_is_named_from_where_the_scene_lies(tmp_path, monkeypatch):
    (tmp_path / "urdf").mkdir()
    (tmp_path / "scenes").mkdir()
    urdf = arm(tmp_path / "urdf")
    assert entries(urdf, tmp_path / "scenes")["robot"]["urdf"] == "../urdf/arm.urdf"
    assert entries(urdf)["robot"]["urdf"] == str(urdf.resolve())
    monkeypatch.chdir(tmp_path)
    scene_file, _ = write_new("urdf/arm.urdf", "scenes/deep")
    assert pf.load_scene(scene_file).joint_names == ("shoulder", "slide")


def test_bearings_are_sized_by_the_effort_limit(tmp_path):
    friction = entries(arm(tmp_path, effort=100.0))["friction"]
    shaft = (16 * 100 / (np.pi * 20e6)) ** (1 / 3)
    pin = friction["shoulder"]["bearing"]
    assert pin["kind"] == "pin"
    assert pin["radius"] == pytest.approx(0.75 * shaft, rel=0.05)  # two digits
    assert pin["length"] == pytest.approx(2 * pin["radius"], rel=0.05)
    assert all(entry["includes_drive"] for entry in friction.values())
    guide = friction["slide"]["bearing"]
    assert guide == {"kind": "guide", "length": 0.2, "width": 0.2}  # half of 0.4 m
    # no limit: three times the weight of 1 kg
    assert friction["slide"]["coulomb"]["kinetic"] == pytest.approx(0.05 * 3 * 9.81, rel=0.05)


@pytest.mark.parametrize("effort", [20.0, 60.0, 100.0, 1000.0, 1e6])
def test_friction_is_guessed_by_the_lesser_of_limit_and_weight(tmp_path, effort):
    text = new_scene(Begun.read(arm(tmp_path, effort=effort)))
    assert ("1e+06 N m, looks like a placeholder" in text) == (effort == 1e6)
    found = yaml.safe_load(text)["friction"]["shoulder"]
    least = min(effort, 3 * 9.81 * (4 * 0.5 + 1 * 1.0))  # 4 kg at 0.5 m and 1 kg at 1 m
    assert found["coulomb"]["kinetic"] == pytest.approx(0.05 * least, rel=0.05)
    assert found["viscous"] == pytest.approx(0.2 * least / 5, rel=0.05)  # limit 5 rad/s


@pytest.mark.parametrize(
    ("drive", "share"),
    [("strain_wave", 0.04), ("cycloidal", 0.022), ("direct", 0.01), ("servo", 0.15)],
)
def test_friction_of_a_kind_of_drive_is_its_share_of_a_limit_that_is_believed(
    tmp_path, drive, share
):
    for effort, load in (100.0, 100.0), (1e6, 3 * 9.81 * 3):  # the second is a placeholder
        text = new_scene(Begun.read(arm(tmp_path, effort=effort), drive))
        found = yaml.safe_load(text)["friction"]["shoulder"]["coulomb"]["kinetic"]
        assert found == pytest.approx(share * load, rel=0.05)
        assert f"--drive {drive}" in yaml.safe_load(text)["assumed"]["by"]
    with pytest.raises(RobotError, match="drive 'worm': there are: strain_wave, cyc"):
        Begun.read(arm(tmp_path), "worm")


MEASURED = {
    "ur5e": "strain_wave",
    "ur10e": "strain_wave",
    "fr3": "strain_wave",
    "panda": "strain_wave",
    "kr300": "cycloidal",
    "go2": "direct",
    "so101": "servo",
}


@pytest.mark.slow
def test_a_known_kind_of_drive_brings_the_guess_nearer_to_what_was_measured():
    """Coulomb friction of 50 joints: a factor of 2.7 (rms) in place of 4.2."""
    away = []
    for name, drive in MEASURED.items():
        scene = pf.load_scene(name)
        found = {site.name: site.friction.coulomb for site in scene.sites}
        guessed = [
            yaml.safe_load(new_scene(Begun.read(scene.robot.urdf, kind)))["friction"]
            for kind in (drive, None)
        ]
        for joint, law in found.items():
            if (true := getattr(law, "kinetic", 0)) > 0:
                away.append([np.log(g[joint]["coulomb"]["kinetic"] / true) for g in guessed])
    assert len(away) == 50
    by_drive, by_all = np.exp(np.sqrt(np.mean(np.square(away), axis=0)))
    assert by_drive == pytest.approx(2.7, abs=0.1)
    assert by_all == pytest.approx(4.2, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("by", "low", "high"), [("hulls", 0.73, 1.81), ("lengths", 0.56, 1.25)])
def test_a_mass_that_is_shared_bears_nearly_the_torque_of_known_arms(by, low, high, monkeypatch):
    """The largest torque of any joint against the robot's own weight, in the worst posture."""
    ratios = {}
    for name in ("panda", "ur3_robot", "ur5_robot", "ur10_robot", "z1", "xarm7", "kinova", "so1*"):
        for urdf in example_robot_data().rglob(f"{name}.urdf"):
            if urdf.stem == "ur3_robot" and "ur_description" not in str(urdf):
                continue
            facts, model = RobotFacts.of(urdf), read_robot(urdf, {}).model
            total = sum(facts.masses.values())
            if by == "lengths":
                facts.__dict__["shapes"] = {}
            with monkeypatch.context() as patched:
                patched.setattr(RobotFacts, "masses", dict.fromkeys(facts.masses, 0.0))
                parts, said = estimated_masses(facts, total)
            assert by in said
            shared = model.copy()
            for j in range(1, model.njoints):
                shared.inertias[j] = pin.Inertia.Zero()
            for link, body in parts.items():
                frame = shared.frames[shared.getFrameId(link, pin.FrameType.BODY)]
                shared.appendBodyToJoint(frame.parentJoint, body, frame.placement)
            torques = [max(limit_remarks(m, 1.0)[1].values()) for m in (shared, model)]
            ratios[urdf.stem] = torques[0] / torques[1]
    assert len(ratios) == 9
    assert min(ratios.values()) == pytest.approx(low, abs=0.01)
    assert max(ratios.values()) == pytest.approx(high, abs=0.01)
    assert np.exp(np.sqrt(np.mean(np.square(np.log(list(ratios.values())))))) < 1.35


def weightless(folder, shape=""):
    """Rods along x of 0.3, 0.2 and 0.1 m without an <inertial>; the last has no length."""
    ends = (0, 0.3, 0.2, 0.1)
    text = (
        "".join(
            f'<link name="l{i}">{shape.format(end=0.5 * end, long=end)}</link>'
            for i, end in enumerate([0.4, *ends[1:], 0][:4])
        )
        + '<link name="l4"/>'
    )
    text += "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="{end} 0 0"/>{LEVEL}{limits(-2, 2, 0)}</joint>'
        for i, end in enumerate(ends)
    )
    file = folder / "bare.urdf"
    file.write_text(f'<robot name="bare">{text}</robot>')
    return file


BOX = '<visual><origin xyz="{end} 0 0"/><geometry><box size="{long} 0.1 0.1"/></geometry></visual>'


@pytest.mark.parametrize(
    ("shape", "parts"),
    [
        (BOX, {"l0": 4, "l1": 3, "l2": 2, "l3": 1}),  # the first stands on the ground
        # 0.63 m, 0.03 of which stand for the last link
        (
            "",
            {
                "l1": 0.63**2 - 0.33**2,
                "l2": 0.33**2 - 0.13**2,
                "l3": 0.13**2 - 0.03**2,
                "l4": 0.03**2,
            },
        ),
    ],
    ids=["by hulls", "by lengths"],
)
def test_a_mass_is_shared_where_a_robot_has_none(tmp_path, shape, parts):
    files = write_new(weightless(tmp_path, shape), tmp_path / "out", mass=10.0)
    assert [file.name for file in files] == ["bare.yaml", "bare.waypoints.yaml", "bare.masses.urdf"]
    scene = pf.load_scene(files[0])
    total = sum(parts.values())
    moved = [10 * parts.get(f"l{k}", 0) / total for k in range(1, 5)]
    assert [body.mass for body in scene.model.inertias][1:] == pytest.approx(moved)
    levers = [body.lever[0] for body in scene.model.inertias][1:4]
    assert levers == pytest.approx([0.15, 0.1, 0.05])
    assert "10 kg, shared by the" in scene.assumed.values["robot.urdf"]
    assert scene.masses == "with_drives"
    own = 9.81 * np.dot(moved, [0.15, 0.4, 0.55, 0.6])
    friction = scene.friction["j0"].coulomb.kinetic
    assert friction == pytest.approx(0.05 * 3 * own, rel=0.05)
    assert pf.check(files[0]).errors == 0


def test_a_mass_is_not_guessed_where_that_misleads(tmp_path):
    with pytest.raises(RobotError, match="link upper has a mass; only that of a robot without any"):
        Begun.read(arm(tmp_path), mass=20.0)
    with pytest.raises(RobotError, match="mass -1 kg: give what the robot weighs"):
        Begun.read(weightless(tmp_path), mass=-1.0)
    names = [("l0", "a1"), ("a1", "a2"), ("a2", "a3"), ("l0", "b1"), ("b1", "b2"), ("b2", "b3")]
    text = '<link name="l0"/>' + "".join(
        f'<link name="{end}"/><joint name="{end}" type="continuous"><parent link="{start}"/>'
        f'<child link="{end}"/></joint>'
        for start, end in names
    )
    file = tmp_path / "two.urdf"
    file.write_text(f'<robot name="two">{text}</robot>')
    with pytest.raises(RobotError, match="l0 carries several arms or legs"):
        Begun.read(file, mass=20.0)


def test_every_number_that_is_a_guess_says_so(tmp_path):
    text = new_scene(
        Begun.read(locate_urdf("example-robot-data:panda_description/urdf/panda.urdf", tmp_path))
    )
    for line in text.splitlines():
        if line.lstrip().startswith(("bearing:", "mu:", "coulomb:", "viscous:")):
            assert re.search(r"  # guess: \S", line), line
    assert sum("# guess:" in line for line in text.splitlines()) == 4 * 9
    assert "masses" not in yaml.safe_load(text)["robot"]
    assert all(f"# masses: {word}_drives" in text for word in ("with", "without"))
    assert "follows panda_finger_joint1" in text
    assert "urdf_dynamics: ignore" in text
    friction = yaml.safe_load(text)["friction"]
    assert friction["panda_finger_joint2"]["bearing"]["kind"] == "guide"


#: Identified on a UR10e (robots/ur10e.yaml): N m and N m s/rad.
UR10E = [12.5, 13.3, 5.0, 2.0, 2.7, 2.3], [21.3, 20.2, 10.4, 3.6, 2.5, 3.0]


@pytest.mark.parametrize("limited", [True, False], ids=["effort limits", "SolidWorks' zeros"])
def test_guesses_of_a_ur10_are_within_a_factor_of_two_of_what_was_identified(tmp_path, limited):
    urdf = locate_urdf("example-robot-data:ur_description/urdf/ur10_robot.urdf", tmp_path)
    text = urdf.read_text() if limited else re.sub('effort="[^"]*"', 'effort="0"', urdf.read_text())
    (tmp_path / "ur10.urdf").write_text(text)
    friction = list(entries(tmp_path / "ur10.urdf")["friction"].values())
    coulomb = np.array([entry["coulomb"]["kinetic"] for entry in friction])
    viscous = np.array([entry["viscous"] for entry in friction])
    assert (coulomb > np.multiply(0.5, UR10E[0])).all()
    assert (coulomb < np.multiply(2.0, UR10E[0])).all()
    assert (viscous > np.multiply(0.5, UR10E[1])).all()
    assert (viscous < np.multiply(2.0, UR10E[1])).all()
    assert min(entry["bearing"]["radius"] for entry in friction) > 0.01


def test_guesses_are_data_that_every_command_names(tmp_path):
    urdf = arm(tmp_path)
    scene_file, _ = write_new(urdf, tmp_path / "out")
    found = yaml.safe_load(scene_file.read_text())
    assumed = found["assumed"]
    names = ("bearing", "mu", "coulomb", "viscous")
    guessed = {f"friction.{j}.{k}" for j in ("shoulder", "slide") for k in names}
    assert set(assumed["values"]) == guessed
    assert assumed["inputs"] == {"arm.urdf": hashlib.sha256(urdf.read_bytes()).hexdigest()}
    assert assumed["by"] == "pinfric new ../arm.urdf"  # from where the scene lies
    with pytest.warns(PinfricWarning, match=r"8 entries are guesses of `.*` \(bear"):
        scene = pf.load_scene(scene_file)
    assert scene.assumed.values == assumed["values"]
    assert scene.with_(gravity=[0.0, 0.0, -1.6]).assumed == scene.assumed


def test_a_guess_whose_entry_is_gone_is_refused(tmp_path):
    scene_file, _ = write_new(arm(tmp_path), tmp_path / "out")
    found = yaml.safe_load(scene_file.read_text())
    found["assumed"]["values"]["robot.masses"] = "as older versions guessed"
    scene_file.write_text(yaml.safe_dump(found))
    with pytest.raises(SceneError, match=r"has `robot\.masses`, which this scene does not have"):
        pf.load_scene(scene_file)
    found["robot"]["masses"] = "with_drives"
    scene_file.write_text(yaml.safe_dump(found))
    assert pf.load_scene(scene_file).masses is None  # a guess signs nothing: `size` asks
    del found["friction"]["slide"]["mu"], found["friction"]["slide"]["bearing"]
    scene_file.write_text(yaml.safe_dump(found))
    with pytest.raises(SceneError, match=r"has `friction.slide.\w+`, which this scene does"):
        pf.load_scene(scene_file)


@pytest.mark.parametrize(
    "name", ["on", "y", "1", "1e3", "a: b", "joint #1", "-", "schulter ü", "~"]
)
def test_awkward_names_survive(tmp_path, name):
    scene_file, way_file = write_new(arm(tmp_path, name=name), tmp_path)
    scene = pf.load_scene(scene_file)
    assert scene.site_names == (name, "slide")
    assert pf.load_trajectory(way_file, scene).joint_names == (name, "slide")


def test_first_motion_stays_inside_narrow_limits(tmp_path):
    urdf = arm(tmp_path, lower=2.9)  # 2.9 to 3.0: zero is outside
    points = yaml.safe_load(new_waypoints(Begun.read(urdf)))["points"]
    for point in points:
        assert 2.9 <= point["q"][0] <= 3.0
        assert 0.1 <= point["q"][1] <= 0.5
    assert points[0]["q"] == points[2]["q"] != points[1]["q"]


def test_simulation_of_the_new_scene_runs(tmp_path):
    scene_file, _ = write_new(arm(tmp_path), tmp_path)
    scene = pf.load_scene(scene_file)
    motion = pf.simulate(scene, scene.start_configuration, [0, 0], None, 0.1)
    assert motion.status == "finished"
    assert motion.q[-1, 0] > 1e-3  # the arm falls: it turns about +y, and weighs at +x


def test_what_a_killed_run_left_is_completed(tmp_path):
    files = write_new(arm(tmp_path), tmp_path)
    before = [file.read_bytes() for file in files]
    files[1].unlink()
    assert write_new(tmp_path / "arm.urdf", tmp_path) == files
    assert [file.read_bytes() for file in files] == before
    files[0].write_text(files[0].read_text() + "# mine\n")
    with pytest.raises(PinfricError, match=r"arm\.yaml: exists already"):
        write_new(tmp_path / "arm.urdf", tmp_path)


def test_nothing_is_overwritten_and_nothing_half_written(tmp_path, monkeypatch):
    urdf = arm(tmp_path)
    (tmp_path / "arm.waypoints.yaml").write_text("mine")
    with pytest.raises(PinfricError, match=r"arm\.waypoints\.yaml: exists already"):
        write_new(urdf, tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["arm.urdf", "arm.waypoints.yaml"]
    (tmp_path / "file").write_text("")
    with pytest.raises(PinfricError, match="cannot be written"):
        write_new(urdf, tmp_path / "file")


@pytest.mark.parametrize(
    ("content", "message"), [(None, "there is no file"), ("<robot", "not well-formed XML")]
)
def test_bad_urdf_is_one_clear_error(tmp_path, content, message):
    file = tmp_path / "bad.urdf"
    if content is not None:
        file.write_text(content)
    with pytest.raises(RobotError, match=rf"bad\.urdf.*{message}|{message}.*bad\.urdf"):
        Begun.read(file)


BODY = """<inertial><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>"""
LEVEL = '<axis xyz="0 1 0"/>'


def limits(lower, upper, effort=10, velocity=2):
    return f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"/>'


def chain(folder, *joints, body=BODY):
    """A URDF of links in a row; joints as (name, type, what else)."""
    links = "".join(f'<link name="link{i}">{body}</link>' for i in range(len(joints) + 1))
    row = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="link{i}"/><child link="link{i + 1}"/>'
        f'<origin xyz="0.2 0 0"/>{more}</joint>'
        for i, (name, kind, more) in enumerate(joints)
    )
    file = folder / "chain.urdf"
    file.write_text(f'<robot name="chain">{links}{row}</robot>')
    return file


def first_motion(urdf, folder):
    """The trajectory of `new`; loading refuses what exceeds a limit."""
    scene_file, way_file = write_new(urdf, folder / "out")
    return pf.load_trajectory(way_file, pf.load_scene(scene_file))


def test_first_motion_keeps_followers_inside_their_limits_too(tmp_path):
    follower = limits(0, 0.04) + '<mimic joint="jaw" multiplier="-2" offset="0.01"/>'
    urdf = chain(tmp_path, ("jaw", "prismatic", limits(0, 0.06)), ("other", "prismatic", follower))
    trajectory = first_motion(urdf, tmp_path)  # the jaw may go to 5 mm, not to 60
    assert 0 <= trajectory.q.min() < trajectory.q.max() <= 0.005


@pytest.mark.parametrize(("lower", "upper"), [(0.0, 1e-4), (0.500010, 0.500020)])
def test_first_motion_moves_joints_of_small_travel(tmp_path, lower, upper):
    urdf = chain(tmp_path, ("j", "revolute", LEVEL + limits(lower, upper)))
    trajectory = first_motion(urdf, tmp_path)
    assert lower <= trajectory.q.min() < trajectory.q.max() <= upper
    plain = yaml.safe_load((tmp_path / "out/chain.waypoints.yaml").read_text())["points"][1]["q"]
    assert isinstance(plain[0], float)  # 6e-05 would be text to others' YAML readers


def test_first_motion_of_a_slow_joint_is_short_instead_of_long(tmp_path):
    urdf = chain(tmp_path, ("j", "revolute", LEVEL + limits(-1, 1, velocity=1e-4)))
    trajectory = first_motion(urdf, tmp_path)
    assert trajectory.t[-1] < 30.0
    assert np.ptp(trajectory.q) > 0


def test_bundled_robots_are_found_by_the_name_that_scenes_give_them(tmp_path):
    name = "example-robot-data:ur_description/urdf/ur5_robot.urdf"
    scene_file, way_file = write_new(name, tmp_path)
    assert scene_file.name == "ur5_robot.yaml"
    assert yaml.safe_load(scene_file.read_text())["robot"]["urdf"] == name
    assert pf.load_trajectory(way_file, pf.load_scene(scene_file)).t[-1] > 1.0
    with pytest.raises(RobotError, match="ur5_robot"):
        write_new(name.replace("ur5_robot", "ur5_robt"), tmp_path)


def test_absurd_limit_of_a_joint_without_lever_is_a_placeholder(tmp_path):
    urdf = chain(tmp_path, ("j", "revolute", LEVEL + limits(0, 0, effort=1e30)))
    text = new_scene(Begun.read(urdf))  # its only body is centred on its axis
    assert "1e+30 N m, looks like a placeholder" in text
    assert "turns, no limits" in text  # 0 to 0 is what a URDF without them reads as
    assert yaml.safe_load(text)["friction"]["j"]["bearing"]["radius"] < 0.1


def test_example_of_a_drive_names_a_joint_that_can_have_one(tmp_path):
    joint = ("j", "revolute", LEVEL + limits(-1, 1))
    text = new_scene(Begun.read(chain(tmp_path, ("base", "planar", ""), joint)))
    assert "#   - joint: j\n" in text
    assert "# base: 3 degrees of freedom" in text
    free = new_scene(Begun.read(chain(tmp_path, ("base", "floating", ""), joint)))
    assert yaml.safe_load(free)["actuators"] == [{"joint": "j"}]  # nothing drives a free base
    assert "# base: 6 degrees of freedom" in free


@pytest.mark.parametrize(
    "body",
    [
        "",
        '<inertial><mass value="1"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
        "</inertial>",  # a point on the joint's axis
    ],
)
def test_robot_that_moves_no_mass_gets_no_simulation_that_would_fail(tmp_path, body):
    urdf = chain(tmp_path, ("j", "revolute", LEVEL + limits(-1, 1)), body=body)
    assert entries(urdf).keys() == {"pinfric", "robot", "friction"}
    assert "j: moves no mass" in new_scene(Begun.read(urdf))
    assert np.ptp(first_motion(urdf, tmp_path).q) > 0


@pytest.mark.parametrize("name", ["a,b", "x, y: z", "[arm]", "{arm}", "#1", "it's", "null"])
def test_names_with_characters_of_yaml_are_quoted(tmp_path, name):
    """Of files, joints and links."""
    urdf = chain(tmp_path, (name, "revolute", LEVEL + limits(-1, 1)))
    urdf = urdf.rename(tmp_path / f"{name}.urdf")
    scene_file, waypoints, rating = write_new(urdf, tmp_path / "new", 1.0)
    scene = pf.load_scene(scene_file)
    assert scene.actuator_names == (name,)
    assert len(pf.load_trajectory(waypoints, scene).t) > 1
    assert pf.load_trajectory(rating, scene).rating.payload == 1.0
    written = yaml.safe_load(scene_file.read_text())
    assert list(written["assumed"]["inputs"]) == [f"{name}.urdf"]


def test_ratings_of_two_robots_stand_in_one_folder(tmp_path):
    for name in ("one", "two"):
        urdf = chain(tmp_path, ("j", "revolute", LEVEL + limits(-1, 1)))
        files = write_new(urdf.rename(tmp_path / f"{name}.urdf"), tmp_path / "new", 1.0)
        assert files[-1].name == f"{name}.rating.waypoints.yaml"
    assert len(list((tmp_path / "new").glob("*.rating.waypoints.yaml"))) == 2


def test_a_rated_payload_goes_into_the_scene_and_into_a_motion(tmp_path):
    urdf = "example-robot-data:xarm_description/urdf/xarm7.urdf"
    scene_file, _, way_file = write_new(urdf, tmp_path, 3.5)
    assert way_file.name == "xarm7.rating.waypoints.yaml"
    scene = pf.load_scene(scene_file)
    payload = scene.payloads["rated"]
    assert (payload.link, payload.mass, payload.com) == ("link_eef", 3.5, (0.0, 0.0, 0.1))
    motion = pf.load_trajectory(way_file, scene)
    across = scene.payloads["rated_across"]
    assert across.com[2] == pytest.approx(0.1)
    assert np.hypot(*across.com[:2]) == pytest.approx(0.1)
    assert (motion.attached.sum(axis=1) == 1).all()
    result = pf.inverse_dynamics(scene, motion)
    held = {f.place: f for f in pf.check(scene_file).findings if f.kind == "held payload"}
    assert set(held) == {"joint joint2", "joint joint3", "joint joint4"}
    assert "takes 62.24 N m at rest" in held["joint joint2"].why
    for finding in held.values():
        drive = scene.actuator_names.index(finding.place.removeprefix("joint "))
        still = (motion.v == 0).all(axis=1)
        worst = np.abs(result.effort_frictionless[still, drive]).max()
        assert float(re.search(r"takes (\S+) N m", finding.why)[1]) == pytest.approx(
            worst, rel=0.03
        )
    with pytest.raises(PinfricError, match="greater than 0"):
        write_new(urdf, tmp_path / "other", 0.0)


def test_two_ends_of_a_plane_tree_may_close_a_loop():
    shown = new_scene(Begun.read(bundled_folder() / "four_bar.urdf"))
    (line,) = [x for x in shown.splitlines() if "planar_pin" in x]
    (entry,) = yaml.safe_load(line.removeprefix("#"))
    assert {entry[side]["link"] for side in "ab"} == {"coupler", "rocker"}
    for name in ("z1_description/urdf/z1.urdf", "a1_description/urdf/a1.urdf"):
        assert "planar_pin" not in new_scene(Begun.read(f"example-robot-data:{name}"))
