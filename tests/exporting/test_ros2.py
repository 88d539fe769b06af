"""The package of ROS 2, compiled against stand-ins and driven as ros2_control's manager does."""

import re
import subprocess
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import chain, dry, lump
from cli_cases import refused, results_in, run
from export_cases import COMPILER, needs_compiler, planar, rich
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.errors import PinfricError

HERE = Path(__file__).parent
FLAGS = [
    *("-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion"),
    *("-Wsign-conversion", "-Wold-style-cast"),
]
ARM = "ur10_machine_tending"
#: Names as users give them, so that messages show what they did.
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


@cache
def arm():
    return pf.load_scene(ARM)


def program(folder, scene, made=None):
    """The program of a package, compiled without a warning."""
    made = made or pf.export(scene, to="ros2")
    made.write(folder)
    (source,) = folder.glob("*_controller.cpp")
    command = [COMPILER, *FLAGS, "-I", HERE / "ros2_stand_ins", "-I", folder]
    command += [f'-DCONTROLLER="{source.name}"', HERE / "ros2_driver.cpp", "-o", folder / "drive"]
    subprocess.run(command, check=True, timeout=120)
    return folder / "drive"


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    return program(tmp_path_factory.mktemp("ros2"), arm())


def drive(program, *lines, code=0):
    """What the controller's driver answers to lines of words and arrays."""
    text = "\n".join(
        " ".join(
            word if isinstance(word, str) else " ".join(map(repr, np.ravel(word).tolist()))
            for word in (line if isinstance(line, tuple) else (line,))
        )
        for line in lines
    )
    done = subprocess.run([program], input=text, capture_output=True, text=True, timeout=60)
    assert done.returncode == code, done.stderr
    return done.stdout.splitlines()


def cycles(answers):
    """(return codes, efforts) of the cycles in the answers."""
    rows = [[float(x) for x in line.split()] for line in answers if re.match(r"[01] ", line)]
    return [int(row[0]) for row in rows], np.array([row[1:] for row in rows])


def followed(count=12):
    """Measured states and references of random motions, some slow and some at rest."""
    rng, motions = np.random.default_rng(5), []
    for k in range(count):
        q = rng.uniform(-1.5, 1.5, 6)
        v, a = rng.normal(size=6) * 0.2 * 0.1 ** (k % 4), rng.normal(size=6)
        v[rng.random(6) < 0.2] = 0.0
        seen, speed = q + rng.normal(size=6) * 1e-4, v + rng.normal(size=6) * 1e-3
        motions.append((q, v, a, rng.normal(size=6), seen, speed))
    return motions


def asked(motions):
    for q, v, a, effort, seen, speed in motions:
        yield "references", q, v, a, effort
        yield "states", seen, speed
        yield "cycle"


@needs_compiler
@pytest.mark.parametrize("rigid_body", [True, False])
def test_efforts_are_those_of_python(driver, rigid_body):
    motions, gains = followed(), np.array([900.0, 800.0, 400.0, 90.0, 80.0, 70.0])
    payload = ("payload.frame", "string tool0"), ("payload.mass", "numbers", [2.0])
    held = ("hold_error", "numbers", [1e-3]), ("scale", "numbers", [0.9])
    codes, efforts = cycles(
        drive(
            driver,
            *payload,
            ("payload.com", "numbers", [0.0, 0.02, 0.1]),
            ("rigid_body", "bool", str(rigid_body).lower()),
            ("stiffness", "numbers", gains),
            ("damping", "numbers", [7.0]),
            "start",
            "states" + " 0" * 12,
            "activate",
            "chained",
            *held,  # as a user sets them while it runs
            *asked(motions),
        )
    )
    tool = {"link": "tool0", "mass": 2.0, "com": [0, 0.02, 0.1], "inertia": [0] * 6}
    solver = arm().with_(payloads={"tool": tool | {"attached": True}}).solver()
    options = pf.CompensationOptions(hold_error=1e-3, scale=0.9, viscous_scale=0.9)
    call = solver.joint_effort if rigid_body else solver.compensate
    assert codes == [0] * len(motions)
    for (q, v, a, effort, seen, speed), found in zip(motions, efforts, strict=True):
        known = call(q, v, a, error=q - seen, v_now=speed, options=options)
        known = known + gains * (q - seen) + 7.0 * (v - speed) + effort
        assert_allclose(found, known, rtol=1e-10, atol=1e-9)


@needs_compiler
def test_guiding_by_hand_is_that_of_python(driver):
    scene, lines = arm(), ["start", "states" + " 0" * 12, "activate"]
    solver, model = scene.solver(), scene.loaded_model()
    t = np.linspace(0.0, 1.0, 40)
    q = 0.3 * np.sin(4.0 * t[:, None] + np.arange(6))
    v = 1.2 * np.cos(4.0 * t[:, None] + np.arange(6))
    effort = np.linspace(0.0, 1.0, 6)
    for position, speed in zip(q, v, strict=True):
        lines += [("states", position, speed), ("references", np.zeros(18), effort), "cycle"]
    codes, efforts = cycles(drive(driver, "guide bool true", "stiffness numbers 500", *lines))
    solver.reset_compensation()
    data, none = model.createData(), np.zeros(6)
    for position, speed, found in zip(q, v, efforts, strict=True):
        known = solver.compensate_measured(position, speed) + effort
        known = known + pin.rnea(model, data, position, none, none)
        assert_allclose(found, known, rtol=1e-10, atol=1e-9)
    assert codes == [0] * len(q)


@needs_compiler
def test_it_holds_the_posture_of_its_activation_until_it_is_chained(driver):
    scene, q = arm(), np.array([0.3, -1.0, 1.2, -0.4, 0.8, 0.1])
    still = "states", q, np.zeros(6)
    away = "states", q - 0.01, np.zeros(6)
    answers = drive(
        driver, "stiffness numbers 100", "start", still, "activate", away, "cycle", "stop"
    )
    codes, efforts = cycles(answers[2:-1])
    known = scene.solver().joint_effort(q, np.zeros(6), np.zeros(6)) + 100.0 * 0.01
    assert codes == [0]
    assert_allclose(efforts[0], known, atol=1e-9)
    assert [float(x) for x in answers[-1].split()] == [0.0] * 6  # it stops without effort


@needs_compiler
@pytest.mark.parametrize("place", ["states", "references"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 180.0])  # degrees
def test_a_bad_state_is_one_line_and_commands_nothing(driver, place, bad):
    good = np.zeros(24)
    rows = {"states": good[:12], "references": good.copy()}
    given = [(name, row) for name, row in rows.items()]
    wrong = rows[place].copy()
    wrong[1] = bad
    answers = drive(
        driver,
        "start",
        *given,
        "activate",
        "cycle",
        (place, wrong),
        "cycle",
        "cycle",
        *given,
        "cycle",
    )
    (codes, efforts), errors = cycles(answers), [x for x in answers if x.startswith("error")]
    assert codes == [0, 1, 1, 0]
    assert_allclose(efforts, efforts[[0]].repeat(4, axis=0), rtol=0, atol=0)
    assert len(errors) == 1  # once, not in each cycle
    assert "not finite, or far beyond" in errors[0]


@needs_compiler
@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("scale numbers -1", "negative"),
        ("scale numbers nan", "negative"),
        ("stiffness numbers -1", "stiffness, damping: should be finite"),
        ("stiffness numbers 1 2", "stiffness: should have one number, or one for each of shoulder"),
        ("measured_scale numbers 1.2", "above stable_scale"),
        ("payload.mass numbers 2800", "payload.frame: should be one of tool0"),
        ("payload.frame string tool", "payload.frame: should be one of tool0"),
        ("payload.com numbers 1 2", r"payload: should have mass"),
        ("joints strings elbow_joint", "joints: should be, in this order, shoulder_pan_joint, "),
        ("prefix string left_", "prefix: names the interfaces"),
    ],
)
def test_a_bad_parameter_changes_nothing(driver, line, said):
    states = ("states", [0.1, -1.0, 1.2, 0.3, 0.2, 0.1], np.zeros(6)), "activate", "cycle"
    answers = drive(driver, "start", *states, line, "cycle")
    codes, efforts = cycles(answers)
    assert re.search(f"refused: .*{said}", answers[-2])
    assert codes == [0, 0]
    assert_allclose(efforts[0], efforts[1], rtol=0, atol=0)
    if not line.startswith("prefix"):  # the same in a file of parameters
        told = drive(driver, line, "start", code=1)
        assert re.fullmatch(f"error .*{said}.*", told[0])
    else:
        assert drive(driver, line, "start")[0].startswith("left_shoulder_pan_joint/effort ")


@needs_compiler
def test_joints_in_another_order_and_payloads_in_grams_are_refused(driver):
    other = " ".join(f"{name}_joint" for name in reversed(JOINTS))
    assert (
        "in this order, shoulder_pan"
        in drive(driver, f"joints strings {other}", "start", code=1)[0]
    )
    same = " ".join(f"{name}_joint" for name in JOINTS)
    assert len(drive(driver, f"joints strings {same}", "start")) == 1
    grams = "payload.frame string tool0", "payload.mass numbers 2800"
    assert "no body has such a mass" in drive(driver, *grams, "start", code=1)[0]


@needs_compiler
def test_an_endless_joint_is_held_the_short_way_round(tmp_path):
    body = lump(2.0, moment=0.1)
    model = chain(("wheel", pin.JointModelRUBZ(), body), ("slide", pin.JointModelPX(), body))
    scene = pf.Scene(
        model,
        friction={"wheel": dry(0.5), "slide": dry(2.0)},
        actuators=[{"joint": "wheel"}, {"joint": "slide"}],
        source="Endless.yaml",
    )
    made = pf.export(scene, to="ros2")
    assert ElementTree.fromstring(made.beside["package.xml"])[0].text == "pinfric_endless"
    answers = drive(
        program(tmp_path / "made", scene, made),
        "stiffness numbers 10",
        "start",
        ("states", [3.1, 0.4], [0.0, 0.0]),
        ("activate"),
        ("references", [-3.1, 0.5], np.zeros(6)),
        "cycle",
    )
    (code,), (found,) = cycles(answers)
    assert code == 0
    assert_allclose(found, [10.0 * (2.0 * np.pi - 6.2), 10.0 * 0.1], atol=1e-12)


@needs_compiler
def test_a_tree_with_a_joint_that_follows_another_compiles(tmp_path):
    scene = rich(3, mimic=True)
    drive(program(tmp_path / "made", scene), "start", "states" + " 0" * 10, "activate", "cycle")


def test_the_package_is_whole_and_names_itself(tmp_path):
    made = pf.export(arm(), to="ros2", frames=["tool0", "wrist_1_link"], namespace="left_arm")
    made.write(tmp_path / "made")
    folder = tmp_path / "made"
    package = ElementTree.parse(folder / "package.xml").getroot()
    plugin = ElementTree.parse(folder / "controller_plugin.xml").getroot()
    kind = plugin.find("class")
    assert package.findtext("name") == plugin.get("path") == "left_arm"
    assert kind.get("name") == "left_arm/Controller"
    source = (folder / "left_arm_controller.cpp").read_text()
    assert f"PLUGINLIB_EXPORT_CLASS({kind.get('type')}, {kind.get('base_class_type')})" in source
    build = (folder / "CMakeLists.txt").read_text()
    named = re.findall(r"[\w.]+\.(?:cpp|xml|yaml)", build)
    assert {*named, "package.xml", "CMakeLists.txt", "left_arm.hpp"} == set(results_in(folder))
    needed = re.search(r"set\(NEEDED (.*)\)", build)[1].split()
    assert needed == [entry.text for entry in package.iter("depend")]
    example = yaml.safe_load((folder / "controllers.yaml").read_text())
    given = example["friction"]["ros__parameters"]
    assert given["joints"] == [f"{name}_joint" for name in JOINTS]
    declared = set(re.findall(r'"([\w.]+)"', source.split("numbers[] = {")[1].split("}")[0]))
    flat = {*given, *(f"payload.{key}" for key in given["payload"])} - {"payload"}
    assert declared - {"measured_scale"} <= flat
    assert "@@" not in "".join(path.read_text() for path in folder.glob("*"))
    assert (
        made.text
        == pf.export(arm(), to="cpp", frames=["tool0", "wrist_1_link"], namespace="left_arm").text
    )  # the law stands once


def test_what_the_package_does_not_hold_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(PinfricError, match="several degrees of freedom"):
        pf.export(planar(), to="ros2")
    with pytest.raises(PinfricError, match="is coupled with another joint"):
        pf.export(rich(7, couples=True), to="ros2")
    assert "the loop 'rocker_pin'" in refused(capsys, "export", "four_bar", "--to", "ros2")
    assert list(tmp_path.iterdir()) == []
    Path("full").mkdir()
    Path("full", "notes.txt").write_text("mine")
    given = "export", "pendulum", "--to", "ros2"
    said = refused(capsys, *given, "--out", "full")
    assert "full: has 'notes.txt' in it, and a package needs a folder of its own" in said
    assert [p.name for p in Path("full").iterdir()] == ["notes.txt"]
    assert run(*given) == 0
    assert run(*given) == 0  # its own folder it may write again
    assert len(results_in("pinfric_pendulum")) == 7
    with pytest.raises(PinfricError, match="a package needs a folder of its own"):
        pf.export(pf.load_scene("pendulum"), to="ros2").write("full")
