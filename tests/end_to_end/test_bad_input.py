"""Every bad input ends in one line that names the culprit, exit code 2, and nothing written."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

import pinfric as pf
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


@dataclasses.dataclass(frozen=True)
class Case:
    """In `file`, `old` becomes `new` (None: the file is not there; no `old`: `new` is all of it).

    The error must have all of `words`.
    """

    file: str
    old: str | None
    new: str | None
    words: tuple[str, ...]
    name: str


def case(name, file, old, new, *words):
    return Case(file, old, new, words, name)


FILES = {"arm.urdf": URDF, "arm.yaml": SCENE, "motion.csv": MOTION, "way.yaml": WAY}

SCENE_CASES = [
    case("missing", "arm.yaml", None, None, "arm.yaml", "no file"),
    case("malformed", "arm.yaml", "{kind: pin,", "{kind: pin", "arm.yaml, line", "not valid YAML"),
    case("tab", "arm.yaml", "  urdf", "\turdf", "arm.yaml, line 3", "not valid YAML"),
    case("not text", "arm.yaml", None, "\x00\x01", "arm.yaml", "not"),
    case("no version", "arm.yaml", "pinfric: 1\n", "", "arm.yaml", "pinfric", "missing"),
    case(
        "unknown deep key",
        "arm.yaml",
        "radius: 0.05",
        "radus: 0.05",
        "arm.yaml",
        "friction.shoulder.bearing.radus",
        "'radius'",
    ),
    case(
        "unknown joint",
        "arm.yaml",
        "  shoulder:",
        "  sholder:",
        "arm.yaml",
        "'sholder'",
        "'shoulder'",
        "extension",
    ),
    case(
        "unknown driven joint",
        "arm.yaml",
        "joint: extension",
        "joint: extensio",
        "actuators",
        "'extensio'",
        "'extension'",
    ),
    case(
        "unknown link",
        "arm.yaml",
        "link: ram",
        "link: rem",
        "robot.payloads.box.link",
        "'rem'",
        "'ram'",
        "upper_arm",
    ),
    case(
        "unknown locked joint",
        "arm.yaml",
        "  urdf:",
        "  locked: {elbow: 0.0}\n  urdf:",
        "robot.locked",
        "'elbow'",
        "shoulder",
    ),
    case(
        "bearing of a slider on a hinge",
        "arm.yaml",
        "{kind: pin, radius: 0.05, length: 0.10}",
        "{kind: guide, length: 0.10}",
        "shoulder.bearing",
        "guide",
        "turning",
    ),
    case("undriven joint", "arm.yaml", "  - {joint: extension}\n", "", "actuators", "extension"),
    case("driven twice", "arm.yaml", "joint: extension", "joint: shoulder", "shoulder", "twice"),
    case(
        "loop without sides",
        "arm.yaml",
        "actuators:",
        "loops: [{name: a}]\nactuators:",
        "`loops[0].kind` is missing",
        "`loops[0].a` is missing",
        "`loops[0].b` is missing",
    ),
    case(
        "cylinder without ends",
        "arm.yaml",
        "  - {joint: extension}",
        "  - {cylinder: {name: boom}}",
        "`actuators[1].cylinder.a` is missing",
    ),
    case(
        "unphysical payload",
        "arm.yaml",
        "com: [0, 0, 0]",
        "com: [0, 0, 0], inertia: [1, 0, 0, 1, 0, 9]",
        "payloads.box",
        "triangle",
    ),
    case(
        "negative moment",
        "arm.yaml",
        "com: [0, 0, 0]",
        "com: [0, 0, 0], inertia: [-1, 0, 0, 1, 0, 1]",
        "payloads.box",
        "negative",
    ),
    case(
        "payload of no machine",
        "arm.yaml",
        "mass: 1.0",
        "mass: 1.0e+304",
        "payloads.box.mass",
        "at most 1e+12",
    ),
    case(
        "ratio of no machine",
        "arm.yaml",
        "ratio: 100",
        "ratio: 9.0e+300",
        "actuators[0].transmission.ratio",
        "at most 1e+12",
    ),
    case(
        "vanishing efficiency",
        "arm.yaml",
        "efficiency: 0.8",
        "efficiency: 8.0e-301",
        "actuators[0].transmission.efficiency",
        "at least 1e-12",
    ),
    case(
        "vanishing ratio",
        "arm.yaml",
        "ratio: 100",
        "ratio: 1.0e-300",
        "actuators[0].transmission",
        "at least 1e-12",
    ),
    case(
        "an integer of 400 digits",
        "arm.yaml",
        "0.05",
        "9" * 400,
        "shoulder.bearing.radius",
        "at most 1e+12",
    ),
    case("path of 5000 letters", "arm.yaml", "arm.urdf", "a" * 5000, "arm.yaml", "robot.urdf"),
    case("path of 2000 folders", "arm.yaml", "arm.urdf", "a/" * 2500, "arm.yaml", "robot.urdf"),
    case("missing URDF", "arm.yaml", "arm.urdf", "leg.urdf", "arm.yaml", "robot.urdf", "leg.urdf"),
    case(
        "unknown example robot",
        "arm.yaml",
        "arm.urdf",
        "example-robot-data:panda_description/urdf/pandas.urdf",
        "pandas.urdf",
        "panda.urdf",
    ),
]

URDF_CASES = [
    case("empty", "arm.urdf", None, "", "arm.urdf", "is empty"),
    case("not XML", "arm.urdf", "</robot>", "", "arm.urdf", "XML"),
    case("not a robot", "arm.urdf", None, "<sdf/>", "arm.urdf", "sdf"),
    case("no links", "arm.urdf", None, "<robot name='a'/>", "arm.urdf", "link"),
    case(
        "unknown parent",
        "arm.urdf",
        '<parent link="base"/>',
        '<parent link="bse"/>',
        "arm.urdf",
        "'shoulder'",
        "'bse'",
        "'base'",
    ),
    case("unknown type", "arm.urdf", 'type="revolute"', 'type="rotary"', "arm.urdf", "rotary"),
    case(
        "negative mass",
        "arm.urdf",
        '<mass value="2"/>',
        '<mass value="-2"/>',
        "arm.urdf",
        "'upper_arm'",
        "-2",
    ),
    case("mass is no number", "arm.urdf", '<mass value="2"/>', '<mass value="2 kg"/>', "arm.urdf"),
    case(
        "negative moment",
        "arm.urdf",
        'iyy="0.1"',
        'iyy="-2.0"',
        "arm.urdf",
        "'shoulder'",
        "negative kinetic energy",
    ),
    case(
        "zero axis",
        "arm.urdf",
        'axis xyz="0 1 0"',
        'axis xyz="0 0 0"',
        "arm.urdf",
        "'shoulder'",
        "axis",
    ),
    case(
        "mass of no machine",
        "arm.urdf",
        '<mass value="2"/>',
        '<mass value="1e304"/>',
        "arm.urdf",
        "'upper_arm'",
        "at most 1e+12",
    ),
    case(
        "two parents",
        "arm.urdf",
        '<parent link="upper_arm"/><child link="ram"/>',
        '<parent link="ram"/><child link="upper_arm"/>',
        "arm.urdf",
        "upper_arm",
    ),
]

MOTION_CASES = [
    case(
        "speed of no machine",
        "motion.csv",
        "0.2,0.2,0.14",
        "0.2,1e300,0.14",
        "motion.csv",
        "1e+300",
    ),
    case("missing", "motion.csv", None, None, "motion.csv", "no file"),
    case("empty", "motion.csv", None, "", "motion.csv", "empty"),
    case("no samples", "motion.csv", None, "t,shoulder,extension\n", "motion.csv", "no samples"),
    case(
        "one sample",
        "motion.csv",
        None,
        "t,shoulder,extension\n0,0,0.1\n",
        "motion.csv",
        "one sample",
        "shoulder",
        ".v",
    ),
    case("NaN", "motion.csv", "0.2,0.14", "nan,0.14", "motion.csv", "shoulder", "nan", "sample 2"),
    case("infinite", "motion.csv", "0.14", "inf", "motion.csv", "extension", "inf", "sample 2"),
    case("text", "motion.csv", "0.14", "far", "motion.csv", "extension", "'far'", "line 4"),
    case("time not increasing", "motion.csv", "0.2,0.2", "0.1,0.2", "motion.csv", "time", "line 4"),
    case("short row", "motion.csv", "0.2,0.2,0.14", "0.2,0.2", "motion.csv", "line 4", "3 columns"),
    case("missing joint", "motion.csv", None, "t,shoulder\n0,0\n1,0\n", "motion.csv", "extension"),
    case("beyond a limit", "motion.csv", "0.18", "0.88", "motion.csv", "extension", "0.88", "0.5"),
    case("no time", "motion.csv", None, "shoulder,extension\n0,0\n1,0.1\n", "motion.csv", "time"),
]

WAY_CASES = [
    case("unknown payload", "way.yaml", "attach: box", "attach: bix", "way.yaml", "bix", "box"),
    case("too few joints", "way.yaml", "[0.5, 0.2]", "[0.5]", "way.yaml", "2"),
    case("unknown key", "way.yaml", "duration", "durtion", "way.yaml", "durtion", "duration"),
    case("beyond a limit", "way.yaml", "[0.5, 0.2]", "[0.5, 2]", "way.yaml", "extension", "0.5"),
    case(
        "no points", "way.yaml", None, "pinfric_trajectory: 1\npoints: []\n", "way.yaml", "points"
    ),
    case("a scene", "way.yaml", None, SCENE, "way.yaml", "is a scene, not a trajectory"),
]


def run(folder, monkeypatch, capsys, changes, trajectory):
    """Write the files, run `pinfric inverse --out`, and return its exit code and stderr."""
    for name, text in {**FILES, **changes}.items():
        if text is not None:
            (folder / name).write_text(text)
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    with pytest.raises(SystemExit) as ended:
        cli.main(["inverse", "arm.yaml", trajectory, "--out", "results", "--json"])
    streams = capsys.readouterr()
    if ended.value.code:
        assert streams.out == ""
        assert sorted(folder.rglob("*")) == before
    return ended.value.code, streams.err


def changed(bad):
    if bad.old is None:
        return {bad.file: bad.new}
    text = FILES[bad.file]
    assert bad.old in text, "the case would change nothing"
    return {bad.file: text.replace(bad.old, bad.new, 1)}


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


@pytest.mark.parametrize(
    "bad", SCENE_CASES + URDF_CASES + MOTION_CASES, ids=lambda bad: f"{bad.file}: {bad.name}"
)
def test_bad_file(bad, tmp_path, monkeypatch, capsys):
    expect_one_line(*run(tmp_path, monkeypatch, capsys, changed(bad), "motion.csv"), bad.words)


@pytest.mark.parametrize("bad", WAY_CASES, ids=lambda bad: bad.name)
def test_bad_way_points(bad, tmp_path, monkeypatch, capsys):
    expect_one_line(*run(tmp_path, monkeypatch, capsys, changed(bad), "way.yaml"), bad.words)


def test_roll_moment_on_a_guide_without_width(tmp_path, monkeypatch, capsys):
    # the ram's 1 kg is 0.1 m beside its axis; it falls behind gravity by Coriolis' 2 w v = 0.4:
    # (9.81 - 0.4) 0.1 = 0.941 N m, which is what `width` is for
    changes = {"arm.yaml": SCENE.replace(", width: 0.1", "")}
    code, error = run(tmp_path, monkeypatch, capsys, changes, "motion.csv")
    expect_one_line(code, error, ("friction.extension.bearing", "sample 0", "0.941", "width"))


def test_all_that_is_beyond_limits_is_listed(tmp_path, monkeypatch, capsys):
    changes = {"motion.csv": MOTION.replace("0.3,0.3,0.16", "0.3,4.3,0.96")}
    code, error = run(tmp_path, monkeypatch, capsys, changes, "motion.csv")
    assert code == cli.BAD_INPUT
    assert len(error.splitlines()) == 1
    assert "shoulder" in error
    assert "4.3" in error
    assert "extension" in error
    assert "0.96" in error


def test_several_problems_stand_in_one_message(tmp_path, monkeypatch, capsys):
    changes = {"motion.csv": "t,shoulder,extensoin\n0,0,0\n0,0,0\n"}
    code, error = run(tmp_path, monkeypatch, capsys, changes, "motion.csv")
    assert code == cli.BAD_INPUT
    assert len(error.splitlines()) == 1
    assert error.startswith("pinfric: error: motion.csv: 2 problems:")
    for word in ("'extensoin'", "without a column: extension", "time must increase"):
        assert word in error


def test_missing_mesh_does_not_matter_to_efforts(tmp_path, monkeypatch, capsys):
    mesh = '<link name="ram"><visual><geometry><mesh filename="no.stl"/></geometry></visual>'
    changes = {"arm.urdf": URDF.replace('<link name="ram">', mesh)}
    code, _ = run(tmp_path, monkeypatch, capsys, changes, "motion.csv")
    assert code == 0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["inverse", "", "motion.csv"], "the name of the scene is empty"),
        (
            ["replay", "arm.yaml", "motion.csv", "--html", ""],
            "Invalid value for --html: is not a file name",
        ),
        (["inverse", "arm.yaml", ""], "the name of the trajectory is empty"),
        (["sweep", "arm.yaml", "motion.csv", ""], "the name of the sweep is empty"),
        (["inverse", "parts", "motion.csv"], "parts is a folder"),
        (["inverse", "arm.yaml", "parts"], "parts is a folder"),
        *[
            (
                [*command, "--effort-at", "x"],
                "Invalid value for '--effort-at': 'x'; should be reflected, motor or joint",
            )
            for command in (
                ["inverse", "arm.yaml", "way.yaml"],
                ["replay", "arm.yaml"],
                ["identify", "arm.yaml", "motion.csv"],
            )
        ],
        (["simulate", "pendulum", "--dt", "0.01"], "dt = 0.01: is for timestepping; event takes"),
        (
            ["simulate", "pendulum", "--method", "timestepping", "--rtol", "1e-6"],
            "rtol = 1e-06: is for event and regularized; timestepping takes dt",
        ),
    ],
)
def test_a_name_that_is_none_or_a_folders(given, words, tmp_path, monkeypatch, capsys):
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "parts").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        cli.main(given)
    error = capsys.readouterr().err
    assert ended.value.code == cli.BAD_INPUT
    assert error.startswith(f"pinfric: error: {words}")
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize("corner", ["nan 0 0", "inf 0 0", "1e308 1e308 0", "0.1 0"])
def test_a_mesh_that_is_nowhere_costs_no_more_than_itself(corner, tmp_path, monkeypatch, capsys):
    solid = "solid part\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 0.1 0\n"
    (tmp_path / "part.stl").write_text(
        f"{solid}vertex {corner}\nendloop\nendfacet\nendsolid part\n"
    )
    mesh = '<link name="ram"><visual><geometry><mesh filename="part.stl"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(URDF.replace('<link name="ram">', mesh))
    (tmp_path / "arm.yaml").write_text(SCENE)
    (tmp_path / "motion.csv").write_text(MOTION)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        cli.main(["replay", "arm.yaml", "motion.csv", "--html", "page.html"])
    assert ended.value.code == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("pinfric: warning: ")
    assert "part.stl" in line


@pytest.mark.parametrize(
    ("file", "says"),
    [
        ("robots/three_link.urdf", "is a robot, not a scene; `pinfric new"),
        ("robots/ur10_machine_tending.waypoints.yaml", "is a trajectory, not a scene"),
    ],
)
def test_what_is_no_scene_is_said(file, says):
    root = Path(__file__).parents[2]
    with pytest.raises(pf.PinfricError, match=says):
        pf.load_scene(root / file)
