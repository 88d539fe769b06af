"""Typical mistakes of the first hour: one line each, with what to do.

Messages that a module's own tests have are not repeated.
"""

import re
import warnings

import numpy as np
import pytest
from cli_cases import told
from tables import table

import pinfric as pf
from pinfric import cli
from pinfric.errors import PinfricError, PinfricWarning
from pinfric.model.scene_file import bundled_folder

ROBOTS = bundled_folder()
SCENE = f"pinfric: 1\nrobot: {{urdf: {ROBOTS}/pendulum.urdf}}\n"
BEARING = "bearing: {kind: pin, radius: 0.02}"
ROWS = "t,joint_1\n" + "\n".join(f"{i},{0.2 * i}" for i in range(6))
FILES = {
    "stops.csv": ROWS,
    "names.csv": ROWS.replace("joint_1", "arm"),
    "table.csv": "name;torque\nM1;2\n",
    "mu.yaml": f"{SCENE}friction: {{joint_1: {{{BEARING}, mu: 0.003}}}}\n",
    "gravity.yaml": f"{SCENE}gravity: 9.81\n",
    "mm.yaml": SCENE.replace("{urdf", "{gravity: [0, 0, -9810], urdf"),
    "down.yaml": SCENE.replace("{urdf", "{gravity: 9.81, urdf"),
    "points.yaml": "pinfric_trajectory: 1\npoints: []\n",
    "motors.yaml": "pinfric_motors: 1\ncatalog: nix.yaml\ndrives: {joint_1: {drive: M + G}}\n",
    "report.html": "<html>a: b: c</html>",
    "retimed.json": '{"pinfric": "0.1", "command": "retime"}',
    "swept.json": '{"pinfric": "0.1", "command": "sweep"}',
    "arm.constants.json": '{"pinfric_constants": 1}',
    "comma.yaml": f"{SCENE}friction: {{joint_1: {{bearing: {{kind: pin, radius: 0,02}}}}}}\n",
    "quoted.yaml": f"{SCENE}stick: {{velocity: '1,5'}}\n",
    "parent.yaml": f"{SCENE}friction:\n  joint_1:\n  {BEARING}\n    mu: 0.1\n",
    "more.yaml": "pinfric: 1\nrobot:\n  urdf: a.urdf\n   gravity: [0, 0, 0]\n",
    "less.yaml": "pinfric: 1\nrobot:\n    urdf: a.urdf\n  gravity: [0, 0, 0]\n",
    "start.yaml": f"{SCENE}simulation: {{start: {{q: {{joint_1: 0.1}}}}}}\n",
}
PENDULUM = "pendulum.waypoints.yaml"
SWEEP = "panda_pick_and_place.sweep.yaml"
PANDA, UR10 = "panda_pick_and_place", "ur10_machine_tending"

#: What is typed, and what the answer must contain: the cause and what to do.
COMMANDS = f"""
inverse {ROBOTS}/pendulum.urdf pendulum  is a robot, not a scene; `pinfric new
inverse {PENDULUM} pendulum  is a trajectory, not a scene; commands take SCENE TRAJ
inverse pendulum pendulum.yaml  is a scene, not a trajectory; commands take SCENE TRAJ
inverse {PANDA} {SWEEP}  is a sweep, not a trajectory; commands take SCENE TRAJECTORY
sweep {PANDA} {PANDA} {PANDA}.yaml  is a scene, not a sweep; commands take SCENE
inverse stops.csv pendulum  is a log or a table, not a scene
inverse pendulum  Missing argument 'TRAJECTORY'. (see pinfric inverse --help)
inverse pendulum stops.csv  write them as a way-point file (`pinfric_trajectory: 1`
inverse ur10_machine_tending names.csv  map them by --columns FILE, a YAML file with
inverse mu.yaml pendulum  found 0.003; e.g. mu: {{static: 0.15, kinetic: 0.1}}
inverse gravity.yaml pendulum  unknown key `gravity`; it belongs under `robot`
inverse down.yaml pendulum  found 9.81; e.g. gravity: [0.0, 0.0, -9.81]
inverse pendulum points.yaml  wrong length, found []; e.g. points: [{{q: [0, 0, 0]
inverse mm.yaml pendulum  at most 250 m/s^2, found [0.0, 0.0, -9810.0]; check the unit
inverse {UR10} pendulum  1 number for 6 joints (3 such points); give one per joint
invers pendulum pendulum  Did you mean 'inverse'?
size pendulum --cycle stops.csv:x  should be FILE:SHARE, with a number behind the colon
size pendulum  --cycle for each of several, or --rating payload=KG
size ur10 --rating payload=0  rating: `payload`: should be greater than 0, found 0
size ur10 --rating payload=900  900 kg is more than 2 times the 28.7 kg
size ur10 --rating payloads=1  unknown key `payloads`; did you mean 'payload'?
size ur10 --rating payload=1 --rating speed.elbow=1  did you mean 'elbow_joint'?
size ur10 --rating payload=1 --on 0.4  belongs to cycles; there is only a rating
size delta --rating payload=1  a rating is for open chains; this one has loops
size go2 --rating payload=1  RL_foot, RR_calf, RR_foot; name it as `link`, or as the scene
new arm.urdf --link tool0  is the payload's: give --payload KG
size pendulum pendulum --catalog mu.yaml  is a scene, not a catalogue; --motors
size pendulum pendulum --catalog table.csv  `pinfric catalog table.csv` makes a catalogue
retime {UR10} {UR10} --motors default:EC  the nearest of
identify {UR10} {UR10}  holds way-points; a log has samples and efforts
new stops.csv  a URDF begins with <robot>
new mm.yaml  is YAML or JSON, no robot (
inverse report.html pendulum  is a page or a picture, not a scene (YAML, `pinfric: 1`); comm
sweep pendulum pendulum stops.csv  is a log or a table, not a sweep (YAML, `pinfric_sweep: 1`)
retime pendulum pendulum --motors report.html  not a motors file (YAML, `pinfric_motors: 1`);
retime pendulum pendulum --motors table.csv  `pinfric catalog table.csv` makes a catalogue
retime pendulum pendulum --motors motors.yaml  motors.yaml: catalog: there is no file nix.yaml
export ur10 --to cpp --frame tip  no link 'tip'; there are: shoulder_link, upper_arm_link, for
simulate retimed.json  `pinfric retime` found, no file for other commands; `pinfric retime --out` wr
check swept.json  swept.json: is what `pinfric sweep` found, no file for other commands
explain arm.constants.json  is what `pinfric export` found, no file for other commands
check comma.yaml  not valid YAML: 0,02: decimals have a point: 0.02
check quoted.yaml  `stick.velocity`: should be a number, found '1,5'; decimals have a point: 1.5
check parent.yaml  `bearing` in line 5 is not below `joint_1` of line 4: indent it by 4 blanks
check more.yaml  it is indented by 3 blanks, more than `urdf` in line 3 (2): keys of
check less.yaml  it is indented by 2 blanks, less than `urdf` in line 3 (4): keys of one mapping are
check comma.yml  and no bundled one of that name; did you mean 'comma.yaml'?
check ~/missing/comma.yaml  /missing/comma.yaml, and no
simulate start.yaml  `simulation.t_end` is missing; e.g. t_end: 1.0
accuracy start.yaml  `simulation.t_end` is missing; e.g. t_end: 1.0
replay pendulum pendulum --out x  No such option: --out; it writes one page: --html FILE (see pin
replay pendulum pendulum --html q.png  q.png: a page is HTML; name it q.html
catalog table.csv  it says which column of table.csv is which figure, and its unit
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("first")
    for name, text in FILES.items():
        (made / name).write_text(text)
    return made


@pytest.mark.parametrize(("typed", "answer"), table(COMMANDS))
def test_a_mistake_on_the_command_line_is_answered(folder, capsys, monkeypatch, typed, answer):
    monkeypatch.chdir(folder)
    *notices, error = told(capsys, *typed.split(), code=cli.BAD_INPUT).err.splitlines()
    assert error.startswith("pinfric: error: ")
    assert answer in error
    assert all(line.startswith("pinfric: ") for line in notices)


@pytest.fixture(scope="module")
def given(folder):
    pendulum, ur10 = pf.load_scene("pendulum"), pf.load_scene(UR10)
    return {
        "pf": pf,
        "np": np,
        "folder": folder,
        "pendulum": pendulum,
        "ur10": ur10,
        "motion": pf.load_trajectory("pendulum", pendulum),
        "states": np.zeros((5, 6)),
    }


PYTHON = """
pf.load_scene({'robot': 1})  the file is a dict; should be a name or a path
pf.load_trajectory(None, pendulum)  the file is a NoneType; should be a name or a path
pf.load_catalog(3)  the file is a int; should be a name or a path
pf.retime(pendulum, motion, smooth='5 ms')  smooth '5 ms': should be positive numbers
pf.load_trajectory(pendulum, 'pendulum')  not a Scene; give pf.load_scene('pendulum')
pf.load_trajectory('pendulum', ur10)  give one per joint, in the order of `joints`
pf.load_trajectory(folder / 'stops.csv', pendulum)  write them as a way-point file
pf.inverse_dynamics(pendulum, motion.q)  needs q, v and a, or one motion
pf.inverse_dynamics(ur10, states[:, :5], states, states)  should be (T, 6), samples first
pf.inverse_dynamics(pendulum, motion.q, motion.v, motion.a).plot()  give `t` to inverse
pf.identify(ur10, states)  give a file's name, or pf.Log(t, q, effort)
pf.retime(ur10, states)  give a trajectory, a file's name, or pf.Path.from_waypoints(q)
pf.retime(pendulum, motion, 3)  should be a motors file, 'default:NAME' or drive -> limi
pf.size(pendulum, 'pendulum')  give pf.load_trajectory('pendulum', scene)
pf.size(pendulum, motion, 'maxon')  there are: default, a YAML file, or a folder
pf.sweep(pendulum, motion, {'samples': 3})  is missing; e.g. pinfric_sweep: 1
pf.replay(pendulum, 'pendulum')  give a trajectory, or a result of pf.inverse_dynamics
ur10.solver(states[0])  states are arguments of the solver's methods, `scene.solver().
ur10.solver().inverse(states, states, states)  q: shape (5, 6); should be (6,), nq = 6
ur10.solver().forward(states[0], states[0], {'elbow': 1.0})  did you mean 'elbow_joint'?
pendulum.with_(friction={'joint1': {'viscous': 1}})  with_ of pendulum.yaml: friction:
pf.simulate(pendulum, [0.0], [0.0], effort=lambda t: 0.0, t_end=1.0)  it is called with (t, q, v)
"""


@pytest.mark.parametrize(("typed", "answer"), table(PYTHON))
def test_a_mistake_in_python_is_answered(given, typed, answer):
    with pytest.raises(PinfricError, match=re.escape(answer)) as caught:
        eval(typed, dict(given))
    assert "\n" not in str(caught.value)


def test_a_log_in_degrees_is_said_to_be(given, tmp_path):
    t = 0.01 * np.arange(300)
    rows = np.column_stack((t, 90.0 * (1.0 - np.cos(t))))
    np.savetxt(tmp_path / "deg.csv", rows, delimiter=",", header="t,joint_1", comments="")
    with pytest.warns(PinfricWarning, match=r"deg\.csv: angles are in degrees"):
        pf.load_trajectory(tmp_path / "deg.csv", given["pendulum"])


def test_angles_in_degrees_are_said_to_look_like_it(given):
    ur10, states = given["ur10"], given["states"]
    q = states + np.array([90.0, -45.0, 60.0, 0.0, 90.0, 0.0])
    with pytest.warns(PinfricWarning, match=r"'shoulder_pan_joint' is at 90 rad.*np\.radians\(q\)"):
        pf.inverse_dynamics(ur10, q, states, states)
    with warnings.catch_warnings():
        warnings.simplefilter("error", PinfricWarning)
        pf.inverse_dynamics(ur10, np.radians(q), states, states)
