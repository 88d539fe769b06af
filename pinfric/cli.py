"""The command line: each command reads files, calls the library, and prints or writes.

A new command is a function under `@app.command()` of a few lines: `_load` what it names, compute
(inside `_working`), then `_write` files and `_show` tables or JSON. What is heavy is imported
inside functions: `pinfric --help` needs neither NumPy nor Pinocchio.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from pinfric import __version__
from pinfric.errors import PinfricError, PinfricWarning

if TYPE_CHECKING:
    from rich.console import RenderableType

    from pinfric.model.scene import Scene
    from pinfric.show.files import Writer
    from pinfric.study.trajectory import Trajectory

#: Exit codes: what was given is wrong; the reader of our output left; stopped by Ctrl-C.
BAD_INPUT, NO_READER, INTERRUPTED = 2, 141, 130

app = typer.Typer(
    name="pinfric", add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None,
    help="Joint friction that depends on the load: efforts, stiction and motors of URDF robots.",
)  # fmt: skip

# What commands share.
SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="Scene file or bundled scene.")]
TrajectoryName = Annotated[
    str, typer.Argument(metavar="TRAJECTORY", help="CSV or way-points (YAML), file or bundled.")
]
OutFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Write the results there, too.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Threads = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Threads; by default as many as pay off.")
]

#: The warnings of this run, for its JSON.
_noticed: list[str] = []


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        _print(f"pinfric {__version__}")
    elif context.invoked_subcommand is None:
        _print(context.get_help())


@app.command()
def inverse(
    scene_name: SceneName,
    trajectory_name: TrajectoryName,
    out: OutFolder = None,
    as_json: AsJson = False,
    threads: Threads = None,
) -> None:
    """Give the efforts that a motion takes.

    One value while a joint slides, an interval while it sticks. --out writes efforts.csv,
    efforts.png and summary.json.
    """
    scene, trajectory = _load(scene_name, trajectory_name, out)
    from pinfric.dynamics.inverse import inverse_dynamics
    from pinfric.show.report import inverse_json, inverse_report

    name = Path(trajectory.source).name
    with _working(f"inverse dynamics of {len(trajectory.t)} samples"):
        result = inverse_dynamics(scene, trajectory, threads=threads)
    summary = inverse_json(result, trajectory.source, _noticed)
    if out is not None:
        from pinfric.show.plots import effort_figure

        _write(out, {
            "efforts.csv": lambda path: result.to_dataframe().to_csv(path, index=False),
            "efforts.png": lambda path: effort_figure(result, name).savefig(path),
            "summary.json": lambda path: path.write_text(_as_text(summary), encoding="utf-8"),
        })  # fmt: skip
    _show(summary if as_json else inverse_report(result, name))


@app.command()
def explain(
    scene_name: SceneName,
    trajectory_name: Annotated[
        str | None,
        typer.Argument(metavar="[TRAJECTORY]", help="CSV or way-points; else random states."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Say which effects a scene calls for, why, and what each costs and changes."""
    from pinfric.model.scene import load_scene
    from pinfric.show.report import explain_json, explain_report
    from pinfric.study.explain import explain as measure
    from pinfric.study.trajectory import load_trajectory

    scene = load_scene(scene_name)
    trajectory = None if trajectory_name is None else load_trajectory(trajectory_name, scene)
    with _working("measuring"):
        explanation = measure(scene, trajectory)
    show = explain_json if as_json else explain_report
    _show(show(explanation, scene.source))


def _load(
    scene_name: str, trajectory_name: str, out: Path | None = None
) -> tuple[Scene, Trajectory]:
    """Read a scene and a trajectory; refuse a folder that could not be written before any work."""
    from pinfric.model.scene import load_scene
    from pinfric.show.files import check_writable
    from pinfric.study.trajectory import load_trajectory

    if out is not None:
        check_writable(out)
    scene = load_scene(scene_name)
    trajectory = load_trajectory(trajectory_name, scene)
    for text in trajectory.warnings:
        _notice(f"{trajectory.source}: {text}")
    return scene, trajectory


def _show(answer: Mapping[str, Any] | Sequence[RenderableType]) -> None:
    """Print a dictionary as JSON, anything else with rich."""
    if isinstance(answer, Mapping):
        _print(_as_text(answer))
        return
    from rich.console import Console

    console = Console(highlight=False)
    with console.capture() as captured:
        console.print(*answer, sep="\n")
    _print(captured.get().rstrip())


def _write(folder: Path, writers: Mapping[str, Writer]) -> None:
    """Write the results, all or none, and say where they are."""
    from pinfric.show.files import write_folder

    with _working(f"writing {folder}"):
        files = write_folder(folder, writers)
    print(f"pinfric: wrote {', '.join(map(str, files))}", file=sys.stderr)


@contextmanager
def _working(what: str) -> Iterator[None]:
    """Show on a terminal that something takes its time."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


def _as_text(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)


def _print(text: str) -> None:
    """Print and flush: a reader that has gone (`| head`) shows here, not at the program's end."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(NO_READER) from None


def _notice(text: str) -> None:
    """Show a warning as one line on stderr, each text once."""
    if text not in _noticed:
        _noticed.append(text)
        print(f"pinfric: warning: {text}", file=sys.stderr)


@contextmanager
def _warnings_as_notices() -> Iterator[None]:
    """Within, a `PinfricWarning` is a notice; others' warnings are shown as Python does."""
    with warnings.catch_warnings():
        as_python_does = warnings.showwarning

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if issubclass(category, PinfricWarning):
                _notice(str(message))
            else:
                as_python_does(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        warnings.simplefilter("always", PinfricWarning)
        yield


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit; bad input ends in one line on stderr and exit code 2.

    Args:
        arguments: what follows `pinfric`; None takes it from the shell.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal without UTF-8 gets "?", not a traceback
            stream.reconfigure(errors="replace")
    _noticed.clear()
    with _warnings_as_notices():
        sys.exit(_run(None if arguments is None else list(arguments)))


def _run(arguments: list[str] | None) -> int:
    # the root of typer's usage errors, by way of the one it exports: its copy of click moves
    usage_error: Any = typer.BadParameter.__mro__[1]
    try:
        code = app(arguments, prog_name="pinfric", standalone_mode=False) or 0
        message = "interrupted" if code == INTERRUPTED else ""
    except PinfricError as problem:
        message, code = str(problem), BAD_INPUT
    except usage_error as problem:
        command = problem.ctx.command_path if problem.ctx else "pinfric"
        message, code = f"{problem.format_message()} (see {command} --help)", BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):  # typer before 0.20 has Abort, later an exit code
        message, code = "interrupted", INTERRUPTED
    if message:
        print(f"pinfric: error: {message}", file=sys.stderr)
    return int(code)


if __name__ == "__main__":
    main()
