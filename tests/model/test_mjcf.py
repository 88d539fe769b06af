"""MJCF as a robot: MuJoCo itself judges bodies, efforts, ranges and what equalities hold."""

import numpy as np
import pytest
from cli_cases import told
from mjcf_cases import FOUR_BAR, GRIPPER, MODELS, mjcf

import pinfric as pf
from pinfric.dynamics.samples.closure import consistent_motion
from pinfric.errors import PinfricWarning, RobotError, SceneError
from pinfric.new_scene import write_new

mujoco = pytest.importorskip("mujoco")

#: mj_inverse and pinfric agree to this times the effort, N m or N.
_SAME = 1e-9
_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """MuJoCo writes its warnings into a file of the current folder."""
    monkeypatch.chdir(tmp_path)


def files(folder, text, robot="", more=""):
    """A scene of an MJCF."""
    (folder / "x.xml").write_text(text)
    (folder / "x.yaml").write_text(f"pinfric: 1\nrobot: {{mjcf: x.xml{robot}}}\n{more}\n")
    return folder / "x.yaml"


def compiled(folder, friction=False):
    """MuJoCo's own model; without friction and rotors, or with rotors alone."""
    model = mujoco.MjModel.from_xml_path(str(folder / "x.xml"))
    model.dof_damping[:] = model.dof_frictionloss[:] = model.jnt_stiffness[:] = 0.0
    if not friction:
        model.dof_armature[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    mujoco.mj_setConst(model, mujoco.MjData(model))  # of bodies on slides it keeps mass and rotor
    return model


def as_pinocchio(model, q, v, a, tau):
    """A state of MuJoCo's and its efforts as Pinocchio has them: quaternions, free bodies' axes."""
    q, v, a, tau = q.copy(), v.copy(), a.copy(), tau.copy()
    for kind, p, d in zip(model.jnt_type, model.jnt_qposadr, model.jnt_dofadr, strict=True):
        if (free := kind == _FREE) or kind == _BALL:
            p = p + 3 * free
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, q[p : p + 4])
            turn = turn.reshape(3, 3)
            q[p : p + 4] = q[p + 1], q[p + 2], q[p + 3], q[p]
            if free:
                v[d : d + 3], tau[d : d + 3] = turn.T @ v[d : d + 3], turn.T @ tau[d : d + 3]
                a[d : d + 3] = turn.T @ a[d : d + 3] - np.cross(v[d + 3 : d + 6], v[d : d + 3])
    return q, v, a, tau


def states(model, count=50, seed=0):
    """Random states and MuJoCo's efforts of them, as Pinocchio has them."""
    rng, data, rows = np.random.default_rng(seed), mujoco.MjData(model), []
    for _ in range(count):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
        data.qvel[:], data.qacc[:] = rng.normal(size=(2, model.nv))
        mujoco.mj_inverse(model, data)
        tau = data.qfrc_inverse
        rows.append(as_pinocchio(model, data.qpos, data.qvel, data.qacc, tau))
    return [np.array(column) for column in zip(*rows, strict=True)]


@pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
@pytest.mark.parametrize("name", MODELS)
def test_efforts_are_those_of_mj_inverse(tmp_path, name):
    """10 models, 50 states each: efforts of all joints, in MuJoCo's order."""
    scene = pf.load_scene(files(tmp_path, MODELS[name]))
    model = compiled(tmp_path)
    q, v, a, tau = states(model)
    found = pf.inverse_dynamics(scene, q, v, a).effort_frictionless
    np.testing.assert_allclose(found, tau, atol=_SAME * np.abs(tau).max())
    named = [model.joint(i).name for i in range(model.njnt)]
    assert [n for n in named if n] == [
        n for n, of in zip(scene.joint_names, named, strict=True) if of
    ]


@pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
@pytest.mark.parametrize("name", MODELS)
def test_bodies_and_ranges_are_those_of_mujoco(tmp_path, name):
    scene = pf.load_scene(files(tmp_path, MODELS[name]))
    model, read = compiled(tmp_path), scene.model
    moved = sum(m for m, w in zip(model.body_mass, model.body_weldid, strict=True) if w)
    assert sum(body.mass for body in list(read.inertias)[1:]) == pytest.approx(moved, rel=1e-12)
    for i in range(model.njnt):
        joint = read.joints[i + 1]
        if joint.nq != 1:
            continue
        low, high = read.lowerPositionLimit[joint.idx_q], read.upperPositionLimit[joint.idx_q]
        if model.jnt_limited[i]:
            assert (low, high) == pytest.approx(tuple(model.jnt_range[i]), abs=1e-12)
        else:
            assert low < -1e300
            assert high > 1e300


def test_friction_and_rotors_count_where_the_scene_asks(tmp_path):
    """Ignored with a warning; used, armature is in mj_inverse's efforts, too."""
    with pytest.warns(PinfricWarning, match="MJCF gives frictionloss, damping or armature for sh"):
        ignored = pf.load_scene(files(tmp_path, MODELS["arm"]))
    assert not ignored.friction
    used = pf.load_scene(files(tmp_path, MODELS["arm"], ", urdf_dynamics: use"))
    assert used.friction["shoulder"].coulomb.static == 0.4
    assert used.friction["shoulder"].viscous.coefficient == 1.0
    q, v, a, tau = states(compiled(tmp_path, friction=True))
    found = pf.inverse_dynamics(used, q, v, a)
    np.testing.assert_allclose(found.effort_frictionless, tau, atol=_SAME * np.abs(tau).max())
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "x.xml"))
    np.testing.assert_array_equal(used.model.armature, model.dof_armature)


TIES = {
    "connect": '<connect name="t" body1="coupler" body2="rocker" anchor="0.3 0 0"/>',
    "connect, sites": '<connect name="t" site1="a" site2="b"/>',
    "connect, world": '<connect name="t" body1="coupler" anchor="0.3 0 0"/>',
    "weld": '<weld name="t" body1="coupler" body2="rocker"/>',
    "weld, pose": '<weld name="t" body1="coupler" body2="rocker" relpose=".3 0 -.2 1 .1 .2 0"/>',
    "weld, sites": '<weld name="t" site1="a" site2="b"/>',
}


@pytest.mark.parametrize("name", TIES)
def test_what_an_equality_holds_is_a_loop(tmp_path, name):
    """Where pinfric's gap is 0 MuJoCo's is: a free body is put where the loop has it."""
    text = FOUR_BAR.format(TIES[name]).replace(
        '<body name="rocker" pos="0.3 0 0"><joint name="j3" axis="0 1 0"/>',
        '<body name="rocker" pos="0.3 0 0"><freejoint name="free"/>',
    )
    drives = "actuators: [{joint: j1}, {joint: j2}]"
    scene = pf.load_scene(files(tmp_path, text, more=drives))
    assert [(loop.name, loop.kind) for loop in scene.loops] == [
        ("t", "spherical" if "connect" in name else "fixed")
    ]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "x.xml"))
    rng, data = np.random.default_rng(2), mujoco.MjData(model)
    for _ in range(10):
        guess = np.r_[rng.uniform(-0.3, 0.3, 2), 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        q = scene.close(guess)
        data.qpos[:] = q
        data.qpos[5:] = q[[8, 5, 6, 7]]
        mujoco.mj_forward(model, data)
        assert data.ne == (3 if "connect" in name else 6)
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-8
        data.qpos[0] += 0.1
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() > 1e-3


def test_a_four_bar_moves_as_its_pin_lets_it(tmp_path):
    """Efforts of the driven crank against MuJoCo's M, bias and the connect's Jacobian."""
    scene = pf.load_scene(
        files(tmp_path, FOUR_BAR.format(TIES["connect"]), more="actuators: [{joint: j1}]")
    )
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "x.xml"))
    data, rng = mujoco.MjData(model), np.random.default_rng(5)
    q = np.array([scene.close(x) for x in rng.uniform(-0.4, 0.4, (20, 3))])
    v, a = consistent_motion(scene, q, ["j1"], *rng.normal(size=(2, 20, 1)))
    efforts = pf.inverse_dynamics(scene, q, v, a).effort_frictionless
    for state, effort in zip(zip(q, v, a, strict=True), efforts, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_forward(model, data)
        J = data.efc_J.reshape(-1, model.nv)[: data.ne]
        right = np.zeros(3)
        mujoco.mj_mulM(model, data, right, state[2])
        right += data.qfrc_bias
        # u e_1 + J^T lambda = right
        both = np.column_stack([[1.0, 0.0, 0.0], J.T])
        solution = np.linalg.lstsq(both, right, rcond=1e-9)[0]
        np.testing.assert_allclose(both @ solution, right, atol=1e-7)
        assert effort[0] == pytest.approx(solution[0], abs=1e-7)


@pytest.mark.parametrize("swap", [False, True])
def test_a_joint_that_an_equality_ties_follows_another(tmp_path, swap):
    """MuJoCo's residual of the equality is 0 where pinfric has the follower."""
    text = GRIPPER.replace('name="left" type="slide"', 'name="left" type="slide" ref="0.02"')
    if swap:
        text = text.replace('joint1="left" joint2="right"', 'joint1="right" joint2="left"')
    scene = pf.load_scene(files(tmp_path, text))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "x.xml"))
    data = mujoco.MjData(model)
    follower, leader = ("right", "left") if swap else ("left", "right")
    assert scene.actuator_names == (leader,)
    (mimic,) = scene.robot.xml().findall("joint/mimic")
    for x in (-0.1, 0.0, 0.2):
        place = float(mimic.get("multiplier")) * x + float(mimic.get("offset"))
        for name, value in ((leader, x), (follower, place)):
            data.qpos[model.jnt_qposadr[model.joint(name).id]] = value
        mujoco.mj_forward(model, data)
        assert data.efc_pos[0] == pytest.approx(0.0, abs=1e-12)


BODY = '<body name="a"><joint name="j"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (mjcf(BODY, after="<equality>\n<connect anchor='0 0 0'/></equality>"), "<connect>: has no"),
        (mjcf(BODY, after="\n<equality><weld body1='b'/></equality>"), "line 2, <weld>: body1 nam"),
        (mjcf(BODY, after="<equality><weld body1='a' body2='a'/></equality>"), "both sides are"),
        (mjcf(BODY, after="<equality><connect site1='s' site2='t'/></equality>"), "names site 's'"),
        (mjcf(BODY, after="<equality><connect body1='a'/></equality>"), "has no anchor"),
        (mjcf(BODY, after="<equality><joint joint1='k'/></equality>"), "names joint 'k'"),
        (mjcf("\n<replicate count='2'><body/></replicate>"), "line 2, <replicate>: makes elements"),
        (mjcf("<attach model='m'/>"), "<attach>: makes elements"),
        (mjcf("<include file='other.xml'/>"), "there is no file"),
        (mjcf("<body><joint class='k'/></body>"), "no default class 'k'"),
        (mjcf("<body><joint type='screw'/></body>"), "no type 'screw'"),
        (mjcf("<body><joint axis='0 0'/></body>"), "axis='0 0' should be 3 finite numbers"),
        (mjcf("<body><joint axis='0 0 0'/></body>"), "no direction"),
        (mjcf("<body><joint/><geom type='mesh' mesh='m'/></body>"), "a mass of a mesh"),
        (mjcf("<body><joint/><geom size='1' shellinertia='true'/></body>"), "saveinertial"),
        (mjcf("<body><joint/><geom type='box' size='1 1'/></body>"), "a box needs 3 positive"),
        (mjcf(2 * "<body name='a'/>"), "two bodies have this name"),
        (mjcf(2 * "<body><joint name='a'/></body>"), "two joints have this name"),
        (mjcf("<body><body><freejoint/></body></body>"), "a free joint is of a body of the world"),
        (mjcf("<body><inertial pos='0 0 0' mass='1'/></body>"), "neither diaginertia nor"),
        (mjcf(BODY, after="<keyframe><key qpos='1 2'/></keyframe>"), "should be 1 finite numbers"),
        (mjcf(""), "no joint of this robot can move"),
        ("<mujoco/>", "has no <worldbody>"),
        ("<mujoco><worldbody></mujoco>", "not well-formed"),
        ("<mujocoinclude/>", "name the file that includes it"),
        ("<sdf version='1.9'/>", "convert it, `sdf2mjcf model.sdf robot.xml`"),
    ],
)
def test_what_cannot_be_read_is_one_line(tmp_path, text, said):
    """It names the file, the line and the element."""
    with pytest.raises(RobotError, match=said) as refused:
        pf.load_scene(files(tmp_path, text))
    assert "x.xml: " in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (mjcf(BODY, "<option density='1000'/>"), "forces of a fluid"),
        (mjcf(BODY).replace('name="a"', 'gravcomp="1"'), "gravcomp"),
        (mjcf(BODY.replace('name="j"', 'name="j" stiffness="3" springref="90"')), "rest: 1.5708"),
        (mjcf(BODY, after="<tendon><spatial stiffness='2'/></tendon>"), "stiffness is not read"),
        (mjcf(BODY, after="<equality><tendon tendon1='t'/></equality>"), "<tendon> is not read"),
        (
            mjcf(BODY, after="<equality><joint joint1='j' polycoef='0 1 2 0 0'/></equality>"),
            "holds one joint",
        ),
        (mjcf(BODY, after="<equality><weld body1='a' active='false'/></equality>"), "not active"),
    ],
)
def test_forces_that_are_not_read_are_said(tmp_path, text, said):
    """By every command that loads it, and by `check`."""
    with pytest.warns(PinfricWarning, match=said):
        pf.load_scene(files(tmp_path, text))
    assert any(said in f.text for f in pf.check(tmp_path / "x.xml").findings)


def test_a_scene_says_which_kind_of_file_it_names(tmp_path):
    file = files(tmp_path, MODELS["gears"])
    for entry, said in (
        ("{urdf: x.xml}", "is an MJCF: write `mjcf: x.xml`"),
        ("{urdf: a.urdf, mjcf: x.xml}", "not both"),
        ("{}", "give `urdf`"),
    ):
        file.write_text(f"pinfric: 1\nrobot: {entry}\n")
        with pytest.raises((RobotError, SceneError), match=said):
            pf.load_scene(file)


def test_gravity_and_limits_of_actuators_are_the_files(tmp_path):
    """A scene's own gravity counts before the file's."""
    scene = pf.load_scene(files(tmp_path, MODELS["leg"]))
    assert scene.model.gravity.linear.tolist() == [0.3, 0.0, -9.7]
    stated = pf.load_scene(files(tmp_path, MODELS["leg"], ", gravity: [0, 0, -1.62]"))
    assert stated.model.gravity.linear.tolist() == [0.0, 0.0, -1.62]
    geared = pf.load_scene(files(tmp_path, MODELS["gears"]))
    assert geared.model.effortLimit.tolist() == [7.0, 100.0, 3.0]  # j: its joint's; motors: gear


def test_new_begins_at_the_first_keyframe(tmp_path, monkeypatch):
    """The written scene names the MJCF, and its motion runs."""
    monkeypatch.chdir(tmp_path)
    files(tmp_path, MODELS["arm"])
    write_new("x.xml", "new")
    scene = pf.load_scene("new/x.yaml")
    assert scene.robot.key == "mjcf"
    assert scene.simulation.start.q == {"shoulder": 0.1, "elbow": 0.2, "wrist": 0.05}
    motion = pf.load_trajectory("new/x.waypoints.yaml", scene)
    assert motion.q[0].tolist() == [0.1, 0.2, 0.05]
    assert np.isfinite(pf.inverse_dynamics(scene, motion).effort_upper).all()
    assert pf.check("x.xml").errors == 0


def test_includes_are_read_in_their_place(tmp_path):
    """Bodies and defaults of other files, whose lines messages name."""
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>\n{BODY}</mujocoinclude>")
    (tmp_path / "set.xml").write_text("<mujoco><default><joint axis='1 0 0'/></default></mujoco>")
    text = mjcf("<include file='part.xml'/>", "<include file='set.xml'/>")
    scene = pf.load_scene(files(tmp_path, text))
    assert scene.joint_names == ("j",)
    model = compiled(tmp_path)
    assert model.jnt_axis[0].tolist() == [1.0, 0.0, 0.0]
    np.testing.assert_allclose(scene.twin().axis[0, 3:], [1.0, 0.0, 0.0])
    broken = BODY.replace('name="j"', 'axis="1"')
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>\n{broken}</mujocoinclude>")
    with pytest.raises(RobotError, match=r"line 2 of part.xml, <joint>"):
        pf.load_scene(tmp_path / "x.yaml")


def test_new_suggests_only_what_runs(tmp_path, capsys):
    """A hand that is welded to a free body has no first motion from a file, nor random states."""
    text = FOUR_BAR.format(TIES["weld"]).replace(
        '<body name="rocker" pos="0.3 0 0"><joint name="j3" axis="0 1 0"/>',
        '<body name="rocker" pos="0.3 0 0"><freejoint name="free"/>',
    )
    for name, content, command in (
        ("welded", text, "check"),
        ("arm", MODELS["arm"], "inverse"),
        ("leg", MODELS["leg"], "check"),  # one leg: no forces are known to hold its base
        ("bar", FOUR_BAR.format(TIES["connect"]), "inverse"),
    ):
        (tmp_path / f"{name}.xml").write_text(content)
        said = told(capsys, "new", f"{name}.xml").out.splitlines()[-1]
        assert said.startswith(f"try: pinfric {command} {name}.yaml")
        told(capsys, *said.removeprefix("try: pinfric ").split())
