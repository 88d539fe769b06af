"""Every bad input ends in one line that names the culprit, exit code 2, and nothing written."""

import pytest
from cli_cases import refused, told
from cli_cases import run as command
from tables import table

from pinfric import cli

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper_arm"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="ram"><inertial><origin xyz="0 0.1 0"/><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper_arm"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="50"/></joint>
  <joint name="extension" type="prismatic"><parent link="upper_arm"/><child link="ram"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" effort="50" velocity="50"/></joint>
</robot>
"""
SCENE = """\
pinfric: 1
robot:
  urdf: arm.urdf
  payloads: {box: {link: ram, mass: 1.0, com: [0, 0, 0], attached: false}}
friction:
  shoulder:
    bearing: {kind: pin, radius: 0.05, length: 0.10}
    mu: {static: 0.2, kinetic: 0.1}
  extension:
    bearing: {kind: guide, length: 0.2, width: 0.1}
    mu: {static: 0.2, kinetic: 0.1}
actuators:
  - {joint: shoulder, transmission: {ratio: 100, efficiency: 0.8, back_efficiency: 0.75}}
  - {joint: extension}
"""
MOTION = """\
t,shoulder,extension
0.0,0.0,0.10
0.1,0.1,0.12
0.2,0.2,0.14
0.3,0.3,0.16
0.4,0.4,0.18
"""
WAY = """\
pinfric_trajectory: 1
points:
  - {q: [0.0, 0.1], hold: 0.1}
  - {q: [0.5, 0.2], duration: 0.5, attach: box}
"""


FILES = {"arm.urdf": URDF, "arm.yaml": SCENE, "motion.csv": MOTION, "way.yaml": WAY}

#: One for each reader and each kind of check (each reader's own tests have the others): in `file`,
#: `old` becomes `new`; the error has all the words.
CASES = r"""
arm.yaml    ALL                  GONE                  arm.yaml; no file
arm.yaml    {kind: pin,          {kind: pin            arm.yaml, line
arm.yaml    ALL                  ZEROS                 arm.yaml; not
arm.yaml    radius: 0.05         radus: 0.05           arm.yaml; friction.shoulder.bearing.radus
arm.yaml    joint: extension     joint: extensio       actuators; 'extension'
arm.yaml    - {joint: extension}  NONE                 actuators; extension
arm.yaml    com: [0, 0, 0]       com: [0, 0, 0], inertia: [-1, 0, 0, 1, 0, 1]  payloads.box
arm.yaml    mass: 1.0            mass: 1.0e+304        payloads.box.mass; at most 1e+12
arm.yaml    ratio: 100           ratio: 9.0e+300       actuators[0].transmission.ratio; 1e+12
arm.yaml    ratio: 100           ratio: 1.0e-300       actuators[0].transmission; at least 1e-12
arm.yaml    efficiency: 0.8      efficiency: 8.0e-301  [0].transmission.efficiency; 1e-12
arm.yaml    0.05                 NINES                 shoulder.bearing.radius; at most 1e+12
arm.yaml    arm.urdf             LONG                  arm.yaml; robot.urdf
arm.yaml    arm.urdf             DEEP                  arm.yaml; robot.urdf
arm.urdf    </robot>             NONE                  arm.urdf
arm.urdf    parent link="base"   parent link="bse"     arm.urdf; 'shoulder'; 'bse'
motion.csv  0.2,0.2,0.14         0.2,1e300,0.14        motion.csv; 1e+300
motion.csv  0.2,0.14             nan,0.14              motion.csv; shoulder; sample 2
way.yaml    attach: box          attach: bix           way.yaml; bix; box
"""
MEANT = {"GONE": None, "NONE": "", "ZEROS": "\x00\x01"}
MEANT |= {"NINES": "9" * 400, "LONG": "a" * 5000, "DEEP": "a/" * 2500}


def run(folder, monkeypatch, capsys, changes, trajectory):
    """Write the files, run `pinfric inverse --out`, and return its exit code and stderr."""
    for name, text in {**FILES, **changes}.items():
        if text is not None:
            (folder / name).write_text(text)
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    code = command("inverse", "arm.yaml", trajectory, "--out", "results", "--json")
    streams = capsys.readouterr()
    if code:
        assert streams.out == ""
        assert sorted(folder.rglob("*")) == before
    return code, streams.err


def expect_one_line(code, error, words):
    assert code == cli.BAD_INPUT, error
    notices = [x for x in error.splitlines() if x.startswith("pinfric: warning: ")]
    assert notices == [] or error.startswith(notices[0])
    (line,) = error.splitlines()[len(notices) :]
    assert line.startswith("pinfric: error: ")
    for word in words:
        assert word in line


@pytest.mark.parametrize("trajectory", ["motion.csv", "way.yaml"])
def test_the_files_the_cases_start_from_are_good(trajectory, tmp_path, monkeypatch, capsys):
    code, error = run(tmp_path, monkeypatch, capsys, {}, trajectory)
    assert (code, error.count("\n")) == (0, 1)
    assert error.startswith("pinfric: wrote")


@pytest.mark.parametrize(("file", "old", "new", "words"), table(CASES))
def test_bad_file(file, old, new, words, tmp_path, monkeypatch, capsys):
    new = MEANT.get(new, new)
    assert old in f"ALL {FILES[file]}", "the case would change nothing"
    changes = {file: new if old == "ALL" else FILES[file].replace(old, new, 1)}
    motion = "way.yaml" if file == "way.yaml" else "motion.csv"
    expect_one_line(*run(tmp_path, monkeypatch, capsys, changes, motion), words.split("; "))


def test_roll_moment_on_a_guide_without_width(tmp_path, monkeypatch, capsys):
    # the ram's 1 kg is 0.1 m beside its axis; it falls behind gravity by Coriolis' 2 w v = 0.4:
    # (9.81 - 0.4) 0.1 = 0.941 N m, which is what `width` is for
    changes = {"arm.yaml": SCENE.replace(", width: 0.1", "")}
    code, error = run(tmp_path, monkeypatch, capsys, changes, "motion.csv")
    expect_one_line(code, error, ("friction.extension.bearing", "sample 0", "0.941", "width"))


def test_several_problems_stand_in_one_message(tmp_path, monkeypatch, capsys):
    changes = {"motion.csv": "t,shoulder,extensoin\n0,0,0\n0,4.3,0\n"}
    code, error = run(tmp_path, monkeypatch, capsys, changes, "motion.csv")
    expect_one_line(code, error, ("motion.csv: 3 problems:", "'extensoin'", "extension", "4.3"))


def test_missing_mesh_does_not_matter_to_efforts(tmp_path, monkeypatch, capsys):
    mesh = '<link name="ram"><visual><geometry><mesh filename="no.stl"/></geometry></visual>'
    changes = {"arm.urdf": URDF.replace('<link name="ram">', mesh)}
    code, _ = run(tmp_path, monkeypatch, capsys, changes, "motion.csv")
    assert code == 0


#: EMPTY is an empty word.
NAMES = """
inverse EMPTY motion.csv                     the name of the scene is empty
replay arm.yaml motion.csv --html EMPTY      Invalid value for --html: is not a file name
inverse arm.yaml EMPTY                       the name of the trajectory is empty
sweep arm.yaml motion.csv EMPTY              the name of the sweep is empty
inverse parts motion.csv                     parts is a folder
inverse arm.yaml parts                       parts is a folder; give a file
inverse loop.yaml motion.csv                 loop.yaml: its link leads to no file (loop.yaml)
inverse arm.yaml way.yaml --effort-at x      Invalid value for '--effort-at': 'x'; should be refl
replay arm.yaml --effort-at x                Invalid value for '--effort-at': 'x'; should be refl
identify arm.yaml motion.csv --effort-at x   Invalid value for '--effort-at': 'x'; should be refl
simulate pendulum --dt 0.01                  dt = 0.01: is for timestepping; event takes
simulate pendulum --method timestepping --rtol 1e-6  rtol = 1e-06: is for event and regularized; ti
"""


@pytest.mark.parametrize(("given", "words"), table(NAMES))
def test_a_name_that_is_none_or_a_folders(given, words, tmp_path, monkeypatch, capsys):
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "parts").mkdir()
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    monkeypatch.chdir(tmp_path)
    error = refused(capsys, *("" if word == "EMPTY" else word for word in given.split()))
    assert error.startswith(f"pinfric: error: {words}")


@pytest.mark.filterwarnings("always::RuntimeWarning")
@pytest.mark.parametrize("corner", ["nan 0 0", "inf 0 0", "0 0 1e400", "1e308 1e308 0", "0.1 0"])
def test_a_mesh_that_is_nowhere_costs_no_more_than_itself(
    corner, tmp_path, monkeypatch, capsys, recwarn
):
    solid = "solid part\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 0.1 0\n"
    (tmp_path / "part.stl").write_text(
        f"{solid}vertex {corner}\nendloop\nendfacet\nendsolid part\n"
    )
    mesh = '<link name="ram"><visual><geometry><mesh filename="part.stl"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(URDF.replace('<link name="ram">', mesh))
    (tmp_path / "arm.yaml").write_text(SCENE)
    (tmp_path / "motion.csv").write_text(MOTION)
    monkeypatch.chdir(tmp_path)
    said = told(capsys, "replay", "arm.yaml", "motion.csv", "--html", "page.html")
    (line,) = said.err.splitlines()
    assert line.startswith("pinfric: warning: ")
    assert "part.stl" in line
    assert [w for w in recwarn if issubclass(w.category, RuntimeWarning)] == []  # of NumPy
