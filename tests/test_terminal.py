"""What every command does the same way: errors, interrupts, pipes, help."""

import os
import re
import subprocess
import sys
import time
import tomllib
from contextlib import contextmanager
from pathlib import Path

import pytest
import typer
from cli_cases import ROOT, refused, run, told

import pinfric as pf
import pinfric.elastic.motion
import pinfric.motions.log.judged
import pinfric.motions.rating  # all that `inverse` loads, before a test breaks a function of it
from pinfric import __version__, cli, terminal
from pinfric.errors import (
    PinfricError,
    SceneError,
    choose_from,
    one_line,
    problems_line,
)
from pinfric.formats import FORMATS
from pinfric.kernels import NOTICES
from pinfric.model.brief import time_left
from pinfric.model.csv_text import number_of
from pinfric.model.entry import parse


def shell(*arguments, **options):
    code = "from pinfric.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        **options,
    )


def test_numbers_of_an_option_may_be_listed():
    given = ["A=1,B=2.5", "C=3", "A,B=4"]
    assert terminal.pairs(given[:2], "--gain", number_of) == {"A": 1.0, "B": 2.5, "C": 3.0}
    assert terminal.pairs(["a,b.csv=box"], "--payload", str) == {"a,b.csv": "box"}
    with pytest.raises(typer.BadParameter, match="'A': should be NAME=VALUE"):
        terminal.pairs(given, "--gain", number_of)


@pytest.mark.parametrize("number", ["1_0", "\N{FULLWIDTH DIGIT ONE}"])
def test_numbers_of_options_have_ascii_digits_as_those_of_files(number):
    with pytest.raises(typer.BadParameter, match="should be NAME=VALUE"):
        terminal.pairs([f"A={number}"], "--gain", number_of)
    assert terminal.weighted(f"way.csv:{number}") == (f"way.csv:{number}", 1.0)


def test_on_a_pipe_a_line_says_how_far_a_command_is(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "PERIOD", 0.02)
    for busy in (False, True):
        monkeypatch.setitem(NOTICES, "busy", busy)
        with terminal.working("sizing"):
            time.sleep(0.1)
        with terminal.progress("stops") as tell:
            tell(3, 7)
            time.sleep(0.1)
        said = set(capsys.readouterr().err.splitlines())
        lines = {"pinfric: sizing: 0 s so far", "pinfric: stops: 3 of 7 done"}
        assert said == (set() if busy else lines)  # kernels that compile say their own


@pytest.mark.parametrize(
    ("passed", "left"), [(0.5, ""), (30.0, ", about 90 s left"), (3600.0, ", about 3 h left")]
)
def test_of_many_steps_the_time_left_is_told(monkeypatch, capsys, passed, left):
    monkeypatch.setattr(terminal, "_FIRST", 0.02)
    monkeypatch.setitem(NOTICES, "busy", False)
    clock = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    with terminal.progress("cycles") as tell:
        tell(25, 100)
        clock[0] = passed
        time.sleep(0.2)
    assert capsys.readouterr().err == f"pinfric: cycles: 25 of 100 done{left}\n"


def test_the_first_line_comes_sooner_than_the_next(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "_FIRST", 0.02)
    monkeypatch.setitem(NOTICES, "busy", False)
    with terminal.working("sizing") as tell:
        tell("drive 2 of 3")
        time.sleep(0.2)
    assert capsys.readouterr().err == "pinfric: sizing: 0 s so far (drive 2 of 3)\n"


def test_sizing_says_at_which_drive_it_is_until_its_end(files, monkeypatch, capsys):
    said = list[str]()

    @contextmanager
    def heard(_):
        yield said.append

    monkeypatch.setattr(terminal, "working", heard)
    monkeypatch.setattr(cli, "working", heard)
    run("size", "arm.yaml", "way.yaml", "--catalog", "default")
    capsys.readouterr()
    assert said[0] == "inverse dynamics of the cycle"
    rounds = [text for text in said if text.startswith("round ")]
    count = len(pf.load_scene("arm.yaml").drives)
    assert re.fullmatch(rf"round 1: \w+, drive 1 of {count}", rounds[0])
    assert any(f"drive {count} of {count}" in text for text in rounds)
    assert re.match(rf"what else fits: \w+, drive 1 of {count}", said[-count - 1])
    assert said[-1] == "what to ask for"


def test_time_is_left_in_proportion_to_like_steps_that_are_done(monkeypatch):
    monkeypatch.setattr("pinfric.model.brief.time.monotonic", lambda: 130.0)
    assert time_left(100.0, 10, 40) == ", about 90 s left"
    assert time_left(100.0, 0, 40) == ""  # nothing is known
    assert time_left(100.0, 39, 40) == ""  # less than a second
    assert time_left(100.0, 40, 40) == ""


def test_products_of_matrices_take_one_thread():
    """Of the command line's process: set before NumPy loads, if nobody else did."""
    code = (
        "import os, sys; sys.argv = ['pinfric', '--version']; from pinfric.__main__ import main\n"
        "try: main()\nexcept SystemExit: print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    for given, taken in ((None, "1"), ("2", "2")):
        env = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
        env |= {"PYTHONPATH": str(ROOT)} | (
            {} if given is None else {"OPENBLAS_NUM_THREADS": given}
        )
        done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
        assert done.stdout.splitlines()[-1] == taken


def test_defect_is_one_line_unless_a_traceback_is_asked_for(files, capsys, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("first line\nsecond line" + 999 * " long")

    monkeypatch.setattr("pinfric.dynamics.inverse.inverse.inverse_dynamics", broken)
    assert run("inverse", "arm.yaml", "way.yaml") == cli.INTERNAL_ERROR == 70
    error = capsys.readouterr().err
    assert error.startswith("pinfric: internal error: ZeroDivisionError: first line second line")
    assert error.endswith("; run with PINFRIC_TRACEBACK=1 to see where\n")
    assert error.count("\n") == 1
    assert len(error) < 350
    monkeypatch.setenv("PINFRIC_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        cli.main(["inverse", "arm.yaml", "way.yaml"])


@pytest.mark.parametrize(
    ("arguments", "culprit"),
    [
        (["nope"], "nope"),
        (["inverse"], "SCENE"),
        (["inverse", "a", "b", "--jsn"], "--jsn"),
        (["inverse", "a", "b", "--threads", "0"], "--threads"),
    ],
)
def test_wrong_usage_is_one_line(arguments, culprit, capsys):
    assert culprit in refused(capsys, *arguments)


@pytest.mark.slow
@pytest.mark.parametrize("form", [["--json"], []])
def test_reader_that_leaves_early_sees_no_traceback(files, form):
    process = shell("inverse", "arm.yaml", "way.yaml", *form)
    process.stdout.close()  # before anything is printed
    assert process.stderr.read() == b""
    assert process.wait(60) == terminal.NO_READER


def test_a_long_simulation_says_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "PERIOD", 0.02)
    assert run("simulate", "pendulum", "--method", "timestepping") == 0
    assert re.search(r"pinfric: ms simulated: [1-9]\d* of 2000 done", capsys.readouterr().err)


@pytest.mark.parametrize("threads", ["0", "-2", "many"])
def test_impossible_numbers_of_threads_are_named(threads, files, capsys, monkeypatch):
    def numba_fails(*_, **__):
        raise ValueError("Number of threads specified must be > 0.")

    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    monkeypatch.setattr("pinfric.dynamics.inverse.inverse.inverse_dynamics", numba_fails)
    assert f"NUMBA_NUM_THREADS={threads}: should be a" in refused(
        capsys, "inverse", "arm.yaml", "way.yaml"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "said"),
    [
        ("exec 2>&-;", ""),
        ("exec 1>&-;", ""),
        ("export NUMBA_NUM_THREADS=0;", "pinfric: error: NUMBA_NUM_THREADS=0: should be"),
        ("ulimit -v 400000;", "pinfric: error: memory is limited to 410 MB"),
        ("mkdir gone; cd gone; rmdir ../gone;", "pinfric: error: the working folder was removed"),
        ("export MPLBACKEND=nonsense COLUMNS=999999999;", ""),
        ("export NUMBA_DISABLE_JIT=1;", "pinfric: error: NUMBA_DISABLE_JIT=1: "),
        ("ulimit -f 0;", "pinfric: error: no folder for temporary files can be written; name"),
    ],
)
def test_surroundings_end_in_one_line_or_do_no_harm(before, said, files):
    command = f"{before} {sys.executable} -m pinfric -q inverse pendulum pendulum.waypoints.yaml"
    if not said:
        command += " --out out"
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=files,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == (cli.BAD_INPUT if said else 0), done.stderr
    assert done.stderr.startswith(said)
    assert len(done.stderr.splitlines()) <= 1
    assert (files / "out" / "summary.json").exists() == (not said)


def test_interrupt_exits_130_with_one_line(files, capsys, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("pinfric.dynamics.inverse.inverse.inverse_dynamics", stopped)
    assert run("inverse", "arm.yaml", "way.yaml", "--out", "out") == cli.INTERRUPTED == 130
    assert capsys.readouterr().err == "pinfric: error: interrupted\n"
    assert not (files / "out").exists()


def test_quiet_leaves_verdicts_and_errors(capsys, tmp_path):
    command = ("inverse", "pendulum", "pendulum", "--out", str(tmp_path))
    loud = told(capsys, *command)
    assert "wrote" in loud.err
    verdict = "all 2801 samples solved; efforts are within the URDF's limits\n"
    assert loud.out.startswith(verdict)
    assert told(capsys, "-q", *command) == (verdict, "")
    assert told(capsys, *command, "--quiet") == (verdict, "")
    assert "there is no file" in refused(capsys, "-q", "inverse", "pendulum", "nowhere.csv")


def test_verbose_adds_files_versions_and_time(capsys):
    lines = told(capsys, "check", "pendulum", "-v").err.splitlines()
    assert [Path(line).name for line in lines[:2]] == ["pendulum.yaml", "pendulum.urdf"]
    assert lines[2].startswith(f"pinfric: versions: pinfric {__version__}, Python 3.")
    assert lines[3].startswith("pinfric: took ")
    assert (
        told(capsys, "-v", "check", "nowhere.yaml", code=cli.BAD_INPUT)
        .err.splitlines()[-1]
        .startswith("pinfric: error: there is no file")
    )


# Every message is one line of a readable length, whatever the names in it hold.


HOSTILE = "a\nb\r\x1b[2Kc\x00\x85\u2028\ud800"


def test_a_message_has_no_letter_that_a_terminal_obeys():
    text = str(PinfricError(HOSTILE))
    assert text == r"a\nb\r\x1b[2Kc\x00\x85\u2028\ud800"
    assert len(text.splitlines()) == 1
    text.encode()  # no half of a surrogate pair
    assert one_line("μ 0.5 – µm") == "μ 0.5 – µm"  # noqa: RUF001 - letters that are shown
    assert str(SceneError("x" * 100_000)).startswith("xxx")
    assert len(str(SceneError("x" * 100_000))) < 10_000


def test_problems_are_counted_and_cut():
    assert problems_line("m.csv", ["one"]) == "m.csv: one"
    assert problems_line("m.csv", ["one", "two", "one"]) == "m.csv: 2 problems: one; two"
    many = problems_line("m.csv", [f"no {i}" for i in range(1000)])
    assert many == "m.csv: 1000 problems: no 0; no 1; no 2; no 3; no 4; and 995 more"


@pytest.mark.parametrize(
    ("name", "allowed", "taken", "says"),
    [
        ("swnig", ("swing", "lift"), (), "did you mean 'swing'? there are: swing, lift"),
        ("zzz", ("swing", "lift"), (), "there are: swing, lift"),
        ("t21", ("t1", "t2"), ("t1",), "did you mean 't2'? there are: t1, t2"),
        ("swnig", ("swing",), ("swing",), "there are: swing"),
        ("swing", (), (), "there are none"),
    ],
)
def test_the_nearest_name_that_is_free_is_offered(name, allowed, taken, says):
    assert choose_from(name, allowed, taken=taken) == says


def test_of_long_lists_the_nearest_three_names_are_said():
    names = [f"joint{i}" for i in range(1000)]
    text = choose_from("jiont7", names)
    assert text.startswith("the nearest of 1000: 'joint7', ")
    assert text.count("'") == 6
    assert choose_from("INT99", names) == "the nearest of 1000: 'joint99', 'joint990', 'joint991'"
    strange = [c * n for n in (8, 9) for c in "acdfghijkmnpqrstuvxyz"]
    found = choose_from("elbow", ["elbows", "w", "lb", *strange])
    assert found == "the nearest of 45: 'elbows', 'lb', 'w'"  # two that are hardly alike, too


@pytest.mark.parametrize("command", ["explain", "inverse", "replay", "new", "simulate"])
def test_a_file_name_cannot_break_the_line(command, tmp_path, capsys):
    name = str(tmp_path / "no\nsuch\x1b[31m\rfile")
    more = ["ur5_pick_and_place.csv"] if command == "inverse" else []
    error = refused(capsys, command, name, *more)
    assert error.strip().isprintable()
    assert r"no\nsuch\x1b[31m\rfile" in error


@pytest.mark.parametrize("columns", ["0", "000", "9" * 5000])
def test_a_terminal_of_no_or_endless_width_gets_the_table(columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    assert "\njoint_1 " in told(capsys, "inverse", "pendulum", "pendulum").out


# The start of a process: help without heavy imports.


def test_help_and_version(capsys):
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    for arguments, expected in (
        ((), "inverse"),
        (("--help",), "inverse"),
        (("inverse", "--help"), "--threads"),
        (("--version",), declared),
    ):
        assert expected in told(capsys, *arguments).out


def test_importing_the_command_line_imports_nothing_heavy():
    heavy = "numpy", "pinocchio", "numba", "matplotlib", "pandas", "pydantic", "yaml", "scipy"
    code = f"import sys, pinfric.cli; print([m for m in {heavy} if m in sys.modules])"
    out = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert out.stdout.strip() == "[]"


def test_the_list_of_commands_is_whole_and_options_have_short_names(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert "..." not in told(capsys, "-h").out.replace("[ARGS]...", "")
    assert run("-V") == run("--version") == 0
    assert len(set(capsys.readouterr().out.splitlines())) == 1


# Versions of file formats.


@pytest.mark.parametrize("version", [True, 2, "1"])
@pytest.mark.parametrize("name", ["scene", "waypoints", "sweep", "motors", "catalog"])
def test_other_versions_are_refused(name, version):
    key = next(key for key in FORMATS[name].model_fields if key.startswith("pinfric"))
    with pytest.raises(PinfricError, match=f"`{key}`: (should be a number|should be 1)"):
        parse(FORMATS[name], {key: version}, "file", PinfricError)
