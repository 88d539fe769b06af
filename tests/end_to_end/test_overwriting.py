"""No command replaces what it reads, nor, unasked, what pinfric did not write.

Every command against every file: as its result itself, and through links, in a folder.
"""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from cli_cases import refused, results_in, run
from fuzz import ARM_CSV, ARM_SCENE, ARM_URDF, ARM_WAY, CATALOG, STL, SWEEP, yaml_text
from tables import table

import pinfric as pf
from pinfric import cli
from pinfric.model.files import RECORD

SIMULATED = ARM_SCENE["simulation"] | {"effort": {"shoulder": {"table": "efforts.csv"}}}
FILES = {
    "arm.yaml": yaml_text(ARM_SCENE | {"simulation": SIMULATED}),
    "arm.urdf": ARM_URDF,
    "part.stl": STL,
    "efforts.csv": "t,shoulder\n0,5\n1,5\n",
    "way.yaml": yaml_text(ARM_WAY),
    "log.csv": ARM_CSV,
    "columns.yaml": "time: t\n",
    "sweep.yaml": yaml_text(SWEEP),
    "motors.yaml": yaml_text({"pinfric_motors": 1, "motors": SWEEP["motors"]}),
    "catalog.yaml": yaml_text(CATALOG),
    "table.csv": "name,mass\nM,1\n",
    "table.columns.yaml": "section: motors\n",
    "motion.npz": "not read before its place is checked",
}
SCENE = {"arm.yaml", "arm.urdf", "part.stl", "efforts.csv"}
#: The command before its folder or file, what it reads beside the scene, what it may write there.
FOLDERS = """
inverse arm.yaml way.yaml  way.yaml  efforts.csv efforts.png tool.pdf
inverse arm.yaml log.csv --columns columns.yaml  log.csv  efforts.csv summary.json
simulate arm.yaml  -  motion.csv motion.npz motion.png motion.pdf summary.json
size arm.yaml way.yaml  way.yaml  sizing.json report.html sized.urdf motors.yaml
size arm.yaml way.yaml --catalog catalog.yaml  catalog.yaml way.yaml  bom.csv
size arm.yaml --cycle way.yaml:1 --cycle log.csv:2  log.csv way.yaml  bom.csv
stop arm.yaml way.yaml  way.yaml  report.html stop.png stop.pdf summary.json
retime arm.yaml way.yaml  way.yaml  trajectory.csv retime.png retime.pdf summary.json
retime arm.yaml log.csv --motors motors.yaml  log.csv motors.yaml  trajectory.csv
sweep arm.yaml way.yaml sweep.yaml  sweep.yaml way.yaml  sweep.png sweep.pdf summary.json
excite arm.yaml  -  excitation.csv excitation.waypoints.yaml summary.json
identify arm.yaml log.csv --columns columns.yaml  columns.yaml log.csv  scene.yaml posterior.csv
identify arm.yaml log.csv  log.csv  sweep.yaml report.html advice.waypoints.yaml robot.urdf
identify arm.yaml log.csv --held-out way.yaml  log.csv way.yaml  summary.json
accuracy arm.yaml  -  accuracy.png accuracy.pdf accuracy.csv summary.json
export arm.yaml --to cpp  -  pinfric_arm.hpp pinfric_arm_test.cpp
export arm.yaml --to ros2  -  pinfric_arm.hpp package.xml CMakeLists.txt
export arm.yaml --to mjcf  -  arm.mjcf.xml
"""
SINGLE = """
export arm.yaml --to mjcf --out  -
export arm.yaml --to urdf --trajectory log.csv --out  log.csv
replay arm.yaml --html  -
replay arm.yaml way.yaml --motors motors.yaml --html  motors.yaml way.yaml
replay arm.yaml motion.npz --html  motion.npz
catalog table.csv --out  table.columns.yaml table.csv
"""


@pytest.fixture
def files(tmp_path, monkeypatch):
    """The folder of all files; no command gets as far as a result."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "answer", lambda *_, **__: pytest.fail("it has computed"))
    for name, content in FILES.items():
        Path(name).write_text(content)
    return tmp_path


def contents():
    return {name: Path(name).read_text() for name in FILES}


@pytest.mark.parametrize(("command", "reads", "results"), table(FOLDERS, str, str.split, str.split))
def test_results_in_a_folder(files, capsys, command, reads, results):
    for number, source in enumerate(FILES):
        Path("out").mkdir(exist_ok=True)
        file = Path("out") / results[number % len(results)]
        (file.hardlink_to if number % 2 else file.symlink_to)(Path(source).absolute())
        given = *command.split(), "--out", "out"
        if source in {*SCENE, *reads}:
            said = refused(capsys, *given, "--overwrite")
            assert f"{file}: is an input of this command (it is " in said
        else:
            said = refused(capsys, *given)
            assert f"{file}: is there already; name another place, or replace it: --ov" in said
        file.unlink()
    assert "is a file; name a folder" in refused(capsys, *command.split(), "--out", source) or (
        "export" in command
    )
    assert contents() == FILES
    assert list(Path("out").iterdir()) == []


@pytest.mark.parametrize(("command", "reads"), table(SINGLE, str, str.split))
def test_a_result_in_one_file(files, capsys, command, reads):
    scene = set() if command.startswith("catalog") else SCENE
    for number, source in enumerate(FILES):
        Path("hard.x").hardlink_to(source)
        Path("soft.x").symlink_to(source)
        file = (source, "hard.x", "soft.x", f"../{files.name}/{source}")[number % 4]
        if source in {*scene, *reads}:
            said = refused(capsys, *command.split(), file, "--overwrite")
            assert f"{file}: is an input of this command" in said
        else:
            said = refused(capsys, *command.split(), file)
            assert f"{file}: is there already; name another place" in said
        Path("hard.x").unlink()
        Path("soft.x").unlink()
    assert contents() == FILES


@pytest.fixture
def whole(tmp_path, monkeypatch):
    """The folder of all files, for commands that run to their end."""
    monkeypatch.chdir(tmp_path)
    for name, content in FILES.items():
        Path(name).write_text(content)
    return tmp_path


def test_results_of_an_earlier_run_are_replaced_unless_somebody_changed_them(whole, capsys):
    given, result = (
        ("export", "arm.yaml", "--to", "mjcf", "--out", "made"),
        Path("made/arm.mjcf.xml"),
    )
    assert [run(*given), run(*given)] == [0, 0]
    first = result.read_bytes()
    assert run("export", "arm.yaml", "--to", "urdf", "--out", "made") == 0  # the record keeps both
    result.write_text("changed")
    capsys.readouterr()
    assert "was changed since pinfric wrote it; name another place" in refused(capsys, *given)
    assert result.read_text() == "changed"
    assert [run(*given, "--overwrite"), run(*given)] == [0, 0]
    assert result.read_bytes() == first
    (Path("made") / RECORD).write_text("[no record")
    capsys.readouterr()
    assert "is there already; name another place, or replace it" in refused(capsys, *given)


def test_functions_write_where_they_are_told(whole):
    scene = pf.load_scene("arm.yaml")
    motion = pf.load_trajectory("way.yaml", scene)
    motion.to_csv("log.csv")
    assert Path("log.csv").read_text() != FILES["log.csv"]
    assert not Path(RECORD).exists()


COMMANDS = """
inverse arm.yaml log.csv --columns columns.yaml --out out
simulate arm.yaml --t-end 0.01
size arm.yaml way.yaml --catalog catalog.yaml
sweep arm.yaml way.yaml sweep.yaml --processes 1
retime arm.yaml way.yaml --motors motors.yaml
replay arm.yaml log.csv --html out/page.html
catalog table.csv --out out/catalog.yaml
check arm.yaml
"""
#: Prints for each command what Python opened to read in this folder, and what it noted.
WATCH = """
import os, shlex, sys
from pinfric import cli
from pinfric.model import inputs
opened, running = set(), None
def watch(event, given):
    global running
    running = inputs.running() or running
    if event == "open" and isinstance(given[0], str) and set(given[1] or "w") <= set("rbtU"):
        opened.add(os.path.realpath(given[0]))
sys.addaudithook(watch)
for line in sys.stdin.read().split("\\n"):
    opened.clear()
    try:
        cli.main(shlex.split(line))
    except SystemExit as ended:
        here = os.getcwd()
        read = {name for name in opened if os.path.dirname(name) == here}
        noted = {str(path.resolve()) for path in running.inputs}
        print("READ", ended.code, sorted(read - noted), len(read))
"""


@pytest.mark.slow
def test_every_file_that_is_opened_is_noted(whole):
    """Judge: Python's own audit of opened files."""
    ended = subprocess.run(
        [sys.executable, "-c", WATCH], input=COMMANDS.strip(), capture_output=True, text=True
    )
    lines = [line.split() for line in ended.stdout.splitlines() if line.startswith("READ")]
    assert [line[2] for line in lines] == ["[]"] * 8, ended
    assert all(int(line[3]) >= 1 for line in lines), ended


@pytest.mark.slow
def test_a_full_disk_a_pipe_links_and_odd_names(whole, capfd):
    """Judge: the files afterwards; each refusal is one line, all other results are written."""
    given = "export", "arm.yaml", "--to", "mjcf", "--out"
    said = refused(capfd, *given, "/dev/full")
    assert "/dev/full: cannot be written: No space left on device" in said
    said = refused(capfd, "replay", "arm.yaml", "way.yaml", "--html", "/dev/full")
    assert "No space left on device" in said
    os.mkfifo("pipe.yaml")
    text = FILES["way.yaml"]
    writer = threading.Thread(target=lambda: Path("pipe.yaml").write_text(text), daemon=True)
    writer.start()
    Path("linked.yaml").symlink_to("arm.yaml")
    out = ("--out", "out\udcff")  # of no UTF-8, as a shell hands it on
    assert run("inverse", "linked.yaml", "pipe.yaml", *out) == 0
    writer.join(9)
    assert results_in(out[1]) == ["efforts.csv", "efforts.pdf", "efforts.png", "summary.json"]
    os.mkfifo("pipe.csv")
    capfd.readouterr()
    assert "pipe.csv: is a pipe" in refused(capfd, "inverse", "arm.yaml", "pipe.csv")
    with open("/dev/full", "w") as full:
        command = sys.executable, "-m", "pinfric", "robots"
        printed = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    told = "pinfric: error: standard output cannot be written: No space left on device\n"
    assert (printed.returncode, printed.stderr) == (2, told)
    Path("arm.urdf").write_text(ARM_URDF.replace("shoulder", "\u5173\u8282"))
    Path("arm.yaml").write_text(FILES["arm.yaml"].replace("shoulder", "\u5173\u8282"))
    Path("efforts.csv").write_text("t,\u5173\u8282\n0,5\n1,5\n")
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "named") == 0
    assert "\u5173\u8282" in (Path("named") / "efforts.csv").read_text("utf-8")
