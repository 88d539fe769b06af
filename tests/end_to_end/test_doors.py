"""Some of the doors that `.ci/run` opens (`python tools/doors.py`), and that it opens all."""

import subprocess
import sys
from pathlib import Path

import doors
import pytest

import pinfric as pf
from pinfric import errors
from pinfric.cli import app

#: They compile all they need before they return: `dynamics/forward/test_solver.py`.
COMPILING = {"Solver", "warm_up", "pinfric warm-up"}
#: What the functions return, take or raise.
CLASSES = {
    "InverseResult",
    "StickInterval",
    "Instant",
    "InverseInstant",
    "InverseDerivatives",
    "ForwardDerivatives",
    "ParameterDerivatives",
    "Smoothed",
    "StaticHold",
    "Standing",
    "Motion",
    "Trajectory",
    "Log",
    "ReadingOptions",
    "Exported",
    "Elasticity",
    "MujocoFriction",
    "Excitation",
    "Identified",
    "SizingReport",
    "StopResult",
    "Duty",
    "CheckReport",
    "RetimeResult",
    "SweepResult",
    *vars(errors),
    "__version__",
}


def test_every_public_function_and_every_command_is_a_door():
    assert {*pf.__all__} - CLASSES - COMPILING == {*doors.FUNCTIONS}
    commands = {command.name or command.callback.__name__ for command in app.registered_commands}
    assert {f"pinfric {name}" for name in commands} - COMPILING == {
        f"pinfric {name}" for name in doors.COMMANDS
    }


def open_doors(*names, **changes):
    return subprocess.run(
        [sys.executable, Path(doors.__file__), *names],
        capture_output=True,
        text=True,
        timeout=300,
        **changes,
    )


@pytest.mark.slow
def test_some_doors_open_with_an_empty_cache():
    done = open_doors("holds", "pinfric catalog")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 doors in" in done.stdout


@pytest.mark.slow
def test_a_door_that_does_not_open_is_seen():
    code = "import sys, doors; doors.FUNCTIONS = {'x': '1 / 0'}; sys.argv[1:] = ['x']; doors.main()"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=Path(doors.__file__).parent,
    )
    assert done.returncode == 1
    assert "exit 1: ZeroDivisionError: division by zero" in done.stdout
