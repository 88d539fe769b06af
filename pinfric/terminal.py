"""What all commands share: read inputs, show progress, print and write results.

Heavy imports are inside functions: `pinfric --help` needs neither NumPy nor Pinocchio.
"""

from __future__ import annotations

import inspect
import json
import os
import re
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from pinfric import __version__
from pinfric.errors import PinfricWarning, one_line
from pinfric.kernels import NOTICES
from pinfric.model.brief import time_left

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import RenderableType

    from pinfric.model.files import Writer
    from pinfric.model.scene import Scene
    from pinfric.motions.log.reading import ReadingOptions
    from pinfric.motions.trajectory import Trajectory

#: Exit code where the reader of our output left.
NO_READER = 141
#: Seconds until the first line that says how far a command is, and between two, where its output is
#: no terminal.
_FIRST, PERIOD = 4.0, 10.0
#: Of so many steps that are done the time left is told.
_EVEN = 20

#: What matplotlib warns of where a font has no such letter.
_NO_LETTER = re.compile(r"Glyph \d+ .*missing from")


@dataclass
class Run:
    """One call of the command line.

    Attributes:
        words: as typed behind `pinfric`; a page to sign states them.
        quiet: print verdicts and errors only. verbose: print all tables and notes, and `facts`.
        read: files read, for the JSON. warnings: each once, for the JSON.
    """

    words: list[str] = field(default_factory=list)
    quiet: bool = False
    verbose: bool = False
    read: list[str | Path] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def begin(self, words: list[str]) -> None:
        """Forget the previous call: tests and scripts make several in one process."""
        vars(self).update(vars(Run(words)))


#: The one of this process.
run = Run()
#: Endings of files of shapes: they are drawn, and change no figure.
_SHAPES = (".dae", ".stl", ".obj", ".ply", ".glb", ".png", ".jpg", ".jpeg", ".mtl")


def option(text: str, metavar: str = "", *names: str, **more: Any) -> Any:
    """Return an option of a command: its help, its value's placeholder, its names (`typer`)."""
    return typer.Option(*names, metavar=metavar or None, help=text, **more)


def argument(text: str, metavar: str) -> Any:
    """Return an argument of a command, as `option`."""
    return typer.Argument(metavar=metavar, help=text)


#: The options of every command that reads a trajectory: name, annotation.
_LOG_OPTIONS = {
    "columns": Annotated[
        Path | None,
        option("YAML file that says which column of a log is what.", "FILE", "--columns"),
    ],
    "unit": Annotated[
        str | None,
        option("Unit of a log's angles; by default recognised.", "rad|deg|turn", "--unit"),
    ],
    "time_unit": Annotated[
        str | None,
        option("Unit of a log's time; by default recognised.", "s|ms|us|ns", "--time-unit"),
    ],
    "cutoff": Annotated[
        str | None,
        option("Low pass on a log's positions; by default chosen.", "HZ|none", "--cutoff"),
    ],
}


def takes_logs(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options for reading a log, passed to it as its argument `log`."""

    def with_options(**arguments: Any) -> None:
        from pinfric.motions.log.reading import ReadingOptions

        reading = {name: arguments.pop(name) for name in _LOG_OPTIONS}
        command(**arguments, log=ReadingOptions(**reading))

    signature = inspect.signature(command, eval_str=True)
    own = [p for p in signature.parameters.values() if p.name != "log"]
    added = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
        for name, kind in _LOG_OPTIONS.items()
    ]
    with_options.__name__, with_options.__doc__ = command.__name__, command.__doc__
    with_options.__signature__ = signature.replace(parameters=[*own, *added])  # type: ignore[attr-defined]
    with_options.__annotations__ = {p.name: p.annotation for p in (*own, *added)}
    return with_options


def load(
    scene_name: str,
    trajectory_name: str | None = None,
    log: ReadingOptions | None = None,
    out: Path | None = None,
    names: Sequence[str] = (),
    later: Sequence[str | Path | None] = (),
    remarked: bool = False,
) -> tuple[Scene, Any]:
    """Read a scene, and a trajectory if one is named (else None).

    Results that could not be written, or would replace files they must not, are refused first.

    Args:
        scene_name, trajectory_name: files or bundled.
        log: how the trajectory is read.
        out: the folder of the results.
        names: the files that the command may write there.
        later: other inputs of the command; strings that name no file are ignored.
        remarked: the command's report has a place for what is doubted of the scene; else it is said
            here.
    """
    from pinfric.checking.findings import remarks
    from pinfric.model.files import check_writable
    from pinfric.model.inputs import note_input
    from pinfric.model.scene_file import load_scene

    if out is not None:
        check_writable(out)
    scene = load_scene(scene_name)
    note_input(*(name for name in (trajectory_name, *later) if name))
    if out is not None:
        check_writable(out, names)
    run.read.append(scene.source)
    if scene.robot is not None:
        run.read.append(scene.robot.urdf)
    unsaid = (f for f in scene.quick_findings if f.kind != "question")  # loading asks these
    for line in () if remarked else remarks(unsaid):
        notice(line)
    if trajectory_name is None or log is None:
        return scene, None
    return scene, load_motion_of(scene, trajectory_name, log)


def load_motion_of(scene: Scene, trajectory_name: str, log: ReadingOptions) -> Trajectory:
    """Read a trajectory of a scene."""
    from pinfric.motions.trajectory import load_trajectory

    trajectory = load_trajectory(trajectory_name, scene, log)
    run.read.append(trajectory.source)
    if log.columns is not None:
        run.read.append(log.columns)
    return trajectory


def pairs(
    texts: Sequence[str] | None,
    option: str,
    kind: Callable[[str], Any],
    form: str = "NAME=VALUE",
) -> dict[str, Any]:
    """Return an option's NAME=VALUE by name; numbers may be listed: A=1,B=2.

    Raises:
        typer.BadParameter: not such a pair, or a value of another kind.
    """
    from pinfric.model.csv_text import number_of

    values: dict[str, Any] = {}
    listed = [
        pair for text in texts or () for pair in (text.split(",") if kind is number_of else [text])
    ]
    for text in listed:
        split = text.strip().partition if kind is str else text.strip().rpartition
        name, equals, value = split("=")  # names of products have signs of equality
        try:
            values[name] = kind(value)
        except ValueError:
            equals = ""
        if not (equals and name):
            raise typer.BadParameter(f"{text!r}: should be {form}", param_hint=option)
    return values


def xacro_arguments(texts: Sequence[str] | None) -> dict[str, str]:
    """Return `--xacro-arg`'s NAME:=VALUE by name.

    Raises:
        typer.BadParameter: not such a pair.
    """
    values = {}
    for text in texts or ():
        name, sign, value = text.strip().partition(":=")
        if not (sign and name):
            raise typer.BadParameter(f"{text!r}: should be NAME:=VALUE", param_hint="--xacro-arg")
        values[name] = value
    return values


def weighted(text: str) -> tuple[str, float]:
    """Return the file and the number of FILE:NUMBER (FILE may be SCENE:FILE); without a number 1.

    Raises:
        typer.BadParameter: an existing FILE is followed by something that is no number.
    """
    from pinfric.model.csv_text import number_of

    name, _, number = text.rpartition(":")
    try:
        return (name, number_of(number)) if name else (text, 1.0)
    except ValueError:
        of_scene = name.lower().endswith((".yaml", ".yml")) and Path(number).suffix
        if Path(name).is_file() and not Path(text).exists() and not of_scene:
            raise typer.BadParameter(
                f"{text!r}: should be FILE:SHARE, with a number behind the colon",
                param_hint="--cycle",
            ) from None
        return text, 1.0


def inputs() -> list[str | Path]:
    """Return the files that this command read, without shapes and those in a folder it names."""
    from pinfric.model.inputs import running

    folders = {Path(name).resolve() for name in run.read if name and Path(name).is_dir()}
    noted = () if (command := running()) is None else command.inputs
    return [
        *run.read,
        *(
            path
            for path in noted
            if not path.name.lower().endswith(_SHAPES)
            and folders.isdisjoint(path.resolve().parents)
        ),
    ]


def show(answer: Mapping[str, Any] | Sequence[RenderableType]) -> None:
    """Print a dictionary as JSON, anything else with rich."""
    if isinstance(answer, Mapping):
        print_line(as_text(answer))
        return
    from rich.console import Console

    console = Console(highlight=False)
    with console.capture() as captured:
        console.print(*answer, sep="\n", crop=False)
    lines = captured.get().rstrip().split("\n")
    print_line("\n".join(line.rstrip() for line in lines))


def picture_files(*names: str) -> list[str]:
    """Return the files of pictures: each is a PNG for the screen and a PDF for print."""
    return [f"{name}.{kind}" for name in names for kind in ("png", "pdf")]


def pictures_of(out: Path | None, result: Any, **options: Any) -> dict[str, Writer]:
    """Return what writes the figures of a result into a folder, if there is one (`pictures`)."""
    if out is None:
        return {}
    from pinfric.show.figure.registry import figures_of

    return pictures(**{f.name: partial(f.draw, result, **options) for f in figures_of(result)})


def pictures(**figures: Callable[[], Figure]) -> dict[str, Writer]:
    """Return what writes the files of pictures (`picture_files`); each is drawn once."""

    def write(draw: Callable[[], Figure], path: Path) -> None:
        dateless = {"CreationDate": None} if path.suffix == ".pdf" else {}
        draw().savefig(path, metadata=dateless)  # the same run writes the same bytes

    writers: dict[str, Writer] = {}
    for name, figure in figures.items():
        draw = cache(figure)
        writers |= {file: partial(write, draw) for file in picture_files(name)}
    return writers


def answer(
    command: str,
    result: Any,
    report: Callable[[], Sequence[RenderableType]],
    as_json: bool,
    out: Path | None = None,
    files: Mapping[str, Writer] | None = None,
    *,
    verdict: Callable[[], str] | None = None,
    name: str = "summary.json",
    scene: Scene | None = None,
    judged: bool = False,
    outdated: Iterable[str] = (),
) -> None:
    """Print what a command computed, and write its files into a folder, all or none.

    Args:
        result: described; its JSON in its envelope is one of the files.
        report: makes the tables.
        as_json: print the JSON, not the tables.
        out: the folder; None writes nothing.
        files: name -> what writes it.
        verdict: makes the line that --quiet prints instead of the tables; None: the tables.
        name: of the JSON file.
        scene: what it is about; its findings are part of the JSON, and errors are the first lines.
        judged: `verdict` and `report` say these themselves.
        outdated: names of files of an earlier run to delete if this run does not write them.
    """
    from pinfric.checking.findings import errors
    from pinfric.show.report.envelope import envelope

    summary = envelope(command, result, scene, inputs(), run.warnings)
    wrong = [] if scene is None or judged else errors(scene.quick_findings)
    first = [f"! not to be used: {line}" for line in wrong]
    if out is not None:
        from pinfric.model.files import write_folder

        if "report.html" in (files := dict(files or {})) and find_spec("jinja2") is None:
            del files["report.html"]
            say("report.html is left out: it needs jinja2: pip install 'pinfric[report]'")
        with working(f"writing {out}"):
            contents = {**files, name: as_text(summary)}
            written = write_folder(
                out, contents, [other for other in outdated if other not in contents]
            )
        say(f"wrote {', '.join(map(str, written))}")
    if as_json:
        show(summary)
    elif verdict is not None and run.quiet:
        print_line("\n".join([*first, verdict()]))
    else:
        from rich.text import Text

        show([*map(Text, first), *report()])


@contextmanager
def _repeated(line: Callable[[], str]) -> Iterator[None]:
    """Say a line each `PERIOD` s from a thread; not while kernels compile, which say their own."""
    done = threading.Event()

    def tell() -> None:
        wait = min(_FIRST, PERIOD)
        while not done.wait(wait):
            wait = PERIOD
            if not NOTICES["busy"]:
                say(line())

    threading.Thread(target=tell, daemon=True).start()
    try:
        yield
    finally:
        done.set()


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """Show that something takes time: on a terminal at once, else in a line each 10 s.

    Gives a function of a line that says at what it is.
    """
    if not sys.stderr.isatty():
        began, steps = time.monotonic(), deque([""], maxlen=1)

        def line() -> str:
            step = f" ({steps[-1]})" if steps[-1] else ""
            return f"{what}: {time.monotonic() - began:.0f} s so far{step}"

        with _repeated(line):
            yield steps.append
        return
    from rich.console import Console

    with Console(stderr=True).status(what) as status:
        yield lambda step: status.update(f"{what}: {step}")


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Give a function of the counts done and in total; on a terminal it draws a bar."""
    if not sys.stderr.isatty():
        counts, began = deque([(0, 0)], maxlen=1), time.monotonic()

        def line() -> str:
            done, total = counts[-1]
            left = time_left(began, done, total, PERIOD) if done >= _EVEN else ""
            return f"{what}: {done} of {total or '?'} done{left}"

        with _repeated(line):
            yield lambda done, total: counts.append((done, total))
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = "{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def as_text(content: Mapping[str, Any]) -> str:
    """Return JSON as printed and written; surrogates (bytes that are not UTF-8) are escaped."""
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    return re.sub("[\ud800-\udfff]", lambda half: f"\\u{ord(half[0]):04x}", text)


def print_line(text: str) -> None:
    """Print and flush; exit here, not at the program's end, if the reader has gone (`| head`)."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(NO_READER) from None


def say(text: str, *, error: bool = False) -> None:
    """Print one line on stderr, beside the results; with --quiet errors only."""
    if error or not run.quiet:
        print(f"pinfric: {one_line(text)}", file=sys.stderr)


def facts(started: float) -> None:
    """Say which files a command read, the versions, and how long it took.

    Args:
        started: `time.perf_counter()` at its beginning, s.
    """
    from importlib.metadata import version

    for file in dict.fromkeys(str(file) for file in run.read if file):
        say(f"read {file}")
    packages = ", ".join(f"{name} {version(name)}" for name in ("pin", "numpy", "numba"))
    say(f"versions: pinfric {__version__}, Python {sys.version.split()[0]}, {packages}")
    say(f"took {time.perf_counter() - started:.1f} s")


def notice(text: str) -> None:
    """Show a warning as one line on stderr, each text once."""
    if text not in run.warnings:
        run.warnings.append(text)
        say(f"warning: {text}")


@contextmanager
def warnings_as_notices() -> Iterator[None]:
    """Within, show a `PinfricWarning` as a notice, other warnings as Python does."""
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
                notice(str(message))
            elif _NO_LETTER.match(str(message)):  # matplotlib's, once per letter
                notice(
                    "the pictures show boxes for letters of names that no font here has; install "
                    "one that has them, such as Noto Sans CJK"
                )
            else:
                as_python_does(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        warnings.simplefilter("always", PinfricWarning)
        yield
