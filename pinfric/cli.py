"""The command line: each command reads files, calls the library, and prints or writes.

A command is a short function under `@app.command()`: `load`, compute (inside `working`), `answer`.
Heavy imports are inside functions: `pinfric --help` needs neither NumPy nor Pinocchio.
"""

from __future__ import annotations

import errno
import math
import os
import shlex
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from pinfric import __version__
from pinfric.errors import (
    PinfricError,
    PinfricWarning,
    SimulationInterrupted,
    SizingError,
    plain,
)
from pinfric.kernels import NOTICES
from pinfric.model.inputs import note_input, running, running_command
from pinfric.terminal import (
    answer,
    argument,
    facts,
    inputs,
    load,
    load_motion_of,
    option,
    pairs,
    picture_files,
    pictures,
    pictures_of,
    print_line,
    progress,
    run,
    say,
    show,
    takes_logs,
    warnings_as_notices,
    weighted,
    working,
    xacro_arguments,
)

#: Exit codes: what was given is wrong; a defect of pinfric (sysexits.h's EX_SOFTWARE); stopped by
#: Ctrl-C. (`terminal.NO_READER`: the reader of our output left.)
BAD_INPUT, INTERNAL_ERROR, INTERRUPTED = 2, 70, 130
#: Letters of a line at most, and where none are given. Bytes of address space with which all
#: modules can be loaded.
_WIDEST, _WIDE, _MEMORY = 1000, 80, 10**9

#: Files that a command writes with --out, by name, as `model.files.Writer`.
Files = dict[str, str | Callable[[Path], object]]

app = typer.Typer(
    name="pinfric",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Joint friction that depends on the load: efforts, stiction and motors of URDF robots.",
)


def _effort_place(value: str) -> str:
    """Refuse an unknown place at once: with way-points nothing else reads it."""
    if value not in ("reflected", "motor", "joint"):
        raise typer.BadParameter(f"{value!r}; should be reflected, motor or joint")
    return value


# What commands share.
SceneName = Annotated[str, argument("Scene file or bundled scene.", "SCENE")]
TrajectoryName = Annotated[str, argument("Log, CSV or way-points; file or bundled.", "TRAJECTORY")]
OutFolder = Annotated[Path | None, option("Also write the results to this folder.", "DIR", "--out")]
AsJson = Annotated[bool, option("Print JSON instead of tables.", "", "--json")]
EffortAt = Annotated[
    str,
    option(
        "A log's efforts: motor torques times gear ratios; at the shafts; behind the gears.",
        "reflected|motor|joint",
        callback=_effort_place,
    ),
]
OneCycle = Annotated[str | None, argument("The cycle; for several use --cycle.", "TRAJECTORY")]
Cycles = Annotated[
    list[str] | None,
    option(
        "A cycle and its share of the time, or its count; in a scene with another gravity.",
        "[SCENE:]FILE:SHARE",
    ),
]
On = Annotated[float, option("Share of the period switched on (S3 duty).", "PART")]
Period = Annotated[
    float,
    option("Period of shares and of --on; 600 s by IEC 60034-1.", "SECONDS"),
]
Motors = Annotated[str | None, option("Limits of the drives (YAML), or default:NAME.", "FILE")]
XacroArgs = Annotated[
    list[str] | None,
    option("Argument of a robot that is xacro.", "NAME:=VALUE", "--xacro-arg"),
]
Threads = Annotated[int | None, option("Threads; by default chosen automatically.", "N", min=1)]


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    version: Annotated[bool, option("Print the version.", "", "--version", "-V")] = False,
    quiet: Annotated[
        bool, option("Print only verdicts and errors, no notices.", "", "--quiet", "-q")
    ] = False,
    verbose: Annotated[
        bool,
        option("Print all tables and notes; files, versions, time.", "", "--verbose", "-v"),
    ] = False,
    overwrite: Annotated[
        bool,
        option("Replace files that pinfric did not write; never inputs.", "", "--overwrite"),
    ] = False,
) -> None:
    run.quiet, run.verbose = quiet, verbose
    NOTICES["compiling"] = not quiet
    if (command := running()) is not None:
        command.overwrite = overwrite
    if version:
        print_line(f"pinfric {__version__}")
    elif context.invoked_subcommand is None:
        print_line(context.get_help())


@app.command()
@takes_logs
def inverse(
    *,
    scene_name: SceneName,
    trajectory_name: TrajectoryName,
    out: OutFolder = None,
    as_json: AsJson = False,
    threads: Threads = None,
    effort_at: EffortAt = "reflected",
    log: Any,
) -> None:
    """Compute the efforts that a motion needs.

    One value while a joint slides, a torque range while it sticks; with elastic gears also the
    tool's position at rest and natural frequencies. A robot that stands needs the forces at its
    feet: without them the efforts have a range, too. --out writes efforts.csv, summary.json
    and the pictures (PNG and PDF) efforts, for a log with efforts measured, for elastic gears tool.
    """
    names = ["efforts.csv", *picture_files("efforts", "measured", "tool"), "summary.json"]
    scene, trajectory = load(scene_name, trajectory_name, log, out, names)
    from pinfric.dynamics.inverse.inverse import inverse_dynamics
    from pinfric.dynamics.inverse.standing import needs_forces, stand
    from pinfric.elastic.motion import elasticity
    from pinfric.motions.log.judged import judge_log
    from pinfric.show.figure.measured import measured_figure
    from pinfric.show.inverse_summary import inverse_summary
    from pinfric.show.report.inverse import inverse_report, verdict

    name = Path(trajectory.source).name
    standing = None
    if needs_forces(scene, trajectory):
        with progress("forces at the feet, samples") as tell:
            standing = stand(scene, trajectory, tell)
    with working(f"inverse dynamics of {len(trajectory.t)} samples"):
        on = None if standing is None else standing.external
        result = inverse_dynamics(scene, trajectory, external=on, threads=threads)
        elastic = elasticity(result) if scene.elastic else None
        reading = trajectory.reading
        judged = None if reading is None else judge_log(result, reading, effort_at)
        summary = inverse_summary(result, trajectory.source, judged, elastic, standing)
    files: Files = {
        "efforts.csv": lambda path: result.to_dataframe().to_csv(path, index=False),
        **pictures_of(out, result, trajectory=name, log=judged),
    }
    if judged is not None and judged.measured:
        files |= pictures(measured=lambda: measured_figure(result, judged, name))
    if elastic is not None and elastic.worst is not None:
        files |= pictures_of(out, elastic, title=name)
    report = partial(inverse_report, result, summary, judged, run.verbose)
    said = partial(verdict, result, summary)
    answer(
        "inverse",
        summary,
        report,
        as_json,
        out,
        files,
        verdict=said,
        scene=scene,
        judged=True,
        outdated=names,
    )


@app.command()
def simulate(
    scene_name: SceneName,
    method: Annotated[str, option("event (exact), timestepping or regularized.")] = "event",
    t_end: Annotated[float | None, option("End time (s); by default the scene's.")] = None,
    rtol: Annotated[
        float | None, option("Tolerance of event and regularized; default 1e-8.")
    ] = None,
    dt: Annotated[float | None, option("Step of timestepping (s); default 1e-3.")] = None,
    out: OutFolder = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a scene under its own efforts, with stick and slip.

    Runs the scene's `simulation` section. --out writes motion.csv, motion.npz, motion.png,
    motion.pdf and summary.json.
    """
    names = ["motion.csv", "motion.npz", *picture_files("motion"), "summary.json"]
    scene, _ = load(scene_name, out=out, names=names)
    from pinfric.dynamics.simulation.simulate import simulate
    from pinfric.show.motion_summary import motion_summary
    from pinfric.show.report.motion import motion_report

    numbers = {"rtol": rtol, "atol": None if rtol is None else 1e-2 * rtol, "dt": dt}
    settings: Any = {name: value for name, value in numbers.items() if value is not None}
    interrupted: SimulationInterrupted | None = None
    end = t_end or (scene.simulation and scene.simulation.t_end) or 0.0
    try:
        with progress("ms simulated") as tell:
            settings["progress"] = lambda t: tell(int(1e3 * t), math.ceil(1e3 * end))
            motion = simulate(scene, t_end=t_end, method=method, **settings)
    except SimulationInterrupted as interrupt:  # what was computed is shown and written
        interrupted, motion = interrupt, interrupt.motion
    summary = motion_summary(motion)
    files: Files = {
        "motion.csv": lambda path: motion.to_dataframe().to_csv(path, index=False),
        "motion.npz": motion.save,
        **pictures_of(out, motion),
    }
    report = partial(motion_report, motion, summary)
    answer("simulate", summary, report, as_json, out, files, scene=scene)
    if interrupted is not None:
        raise interrupted


@app.command(short_help="Reproduce the paper's examples by two formulations.")
def paper(
    reading: Annotated[
        str, option("consistent, or literal: the data as they are printed.")
    ] = "consistent",
    out: OutFolder = None,
    as_json: AsJson = False,
) -> None:
    """Reproduce both examples of the paper, forward and inverse, and a loop, in two formulations.

    --out writes the paper's figures 5, 6, 8, 9, 10 (PNG and PDF) and summary.json.
    """
    from pinfric.model.files import check_writable
    from pinfric.paper import reproduction
    from pinfric.paper.figures import paper_figures
    from pinfric.paper.report import literal_report, paper_report

    if reading not in ("consistent", "literal"):
        raise typer.BadParameter(
            f"{reading!r}: there are consistent, literal", param_hint="--reading"
        )
    if out is not None:
        names = picture_files(*(f"figure_{n}" for n in (5, 6, 8, 9, 10)))
        check_writable(out, [*names, "summary.json"])
    if reading == "literal":
        with working("simulating both examples as printed"):
            literal = [reproduction.read_literally(example) for example in reproduction.EXAMPLES]
        reproduced: Any = reproduction.LiteralExamples(tuple(literal))
        report, figures = literal_report(literal), {}
    else:
        with working("simulating both examples, twice"):
            examples = [reproduction.reproduce(example) for example in reproduction.EXAMPLES]
            loop = reproduction.closed_loop_difference()
        reproduced = reproduction.Examples(tuple(examples), loop)
        report = paper_report(examples, loop)
        figures = paper_figures(*examples) if out is not None else {}
    files = pictures(**{name: partial(figures.__getitem__, name) for name in figures})
    answer("paper", reproduced, lambda: report, as_json, out, files)


@app.command(short_help="Size the drives for a cycle that repeats, or for a rating.")
@takes_logs
def size(  # noqa: PLR0913 - options
    *,
    scene_name: SceneName,
    trajectory_name: OneCycle = None,
    cycle: Cycles = None,
    on: On = 1.0,
    period: Period = 600.0,
    catalog: Annotated[
        str | None,
        option("Catalogue file, or `default` (the bundled one).", "FILE", "--catalog"),
    ] = None,
    rating: Annotated[
        list[str] | None,
        option("Rated for payload=KG in place of a cycle, or beside it.", "KEY=VALUE"),
    ] = None,
    condition: Annotated[
        list[str] | None,
        option("A condition in place of the catalogue's.", "KEY=VALUE", "--condition"),
    ] = None,
    take: Annotated[
        list[str] | None,
        option("The drive that a joint gets, named as the page does.", "JOINT=NAME", "--take"),
    ] = None,
    sensitivity: Annotated[
        bool,
        option("At which friction, payload and speed it changes.", "", "--sensitivity"),
    ] = False,
    out: OutFolder = None,
    as_json: AsJson = False,
    log: Any,
) -> None:
    """Size the drives for a cycle that repeats, or for a rated payload.

    Without a catalogue: what each joint demands. With one: the lightest motor and gear that
    meets it. --out writes sizing.json, report.html, bom.csv and, for the commands that follow,
    sized.scene.yaml, sized.urdf and motors.yaml. A duty of several cycles: --cycle pick.csv:0.7
    --cycle wait.csv:0.3, or counts. Several mountings: --cycle wall.yaml:pick.csv is a cycle of the
    same robot in a scene with another gravity; each joint gets what bears the hardest. Before
    there is a cycle: --rating payload=10 (kg), held and lifted in the worst posture of each joint.
    """
    from pinfric.sizing.files import CHOSEN, judge_files, sized_files

    by_scene = _cycles(trajectory_name, cycle, rating is not None)
    names = "sizing.json", "report.html", *CHOSEN
    others = [*by_scene, *(file for own in by_scene.values() for file, _ in own), catalog]
    scene, _ = load(scene_name, out=out, names=names, later=others, remarked=True)

    def motions(scene: Any, cycles: list[tuple[str, float]]) -> tuple[tuple[Any, float], ...]:
        return tuple((load_motion_of(scene, file, log), share) for file, share in cycles)

    weighed = motions(scene, by_scene.pop(""))
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    from pinfric.drives.duty import Duty
    from pinfric.model.csv_text import number_of
    from pinfric.show.pages.sizing import sizing_page
    from pinfric.show.report.bill import bill_of_materials
    from pinfric.show.report.sizing import sizing_report, verdict
    from pinfric.sizing.size import size
    from pinfric.sizing.summary import sizing_summary

    if not weighed and (on, period) != (1.0, 600.0):
        raise typer.BadParameter("belongs to cycles; there is only a rating", param_hint="--on")
    elsewhere = tuple(
        (other := load(name)[0], Duty(motions(other, own), on, period))
        for name, own in by_scene.items()
    )
    duty = Duty(weighed, on, period, elsewhere=elsewhere) if weighed else None

    def number_or_name(text: str) -> Any:
        if text.startswith(("{", "[")):  # as a file has it
            try:
                return YAML(typ="safe").load(text)
            except YAMLError as problem:
                raise ValueError(text) from problem
        try:
            return number_of(text)
        except ValueError:  # `required`
            return text

    conditions = pairs(condition, "--condition", number_or_name)
    if taken := pairs(take, "--take", str):
        conditions = {**(conditions or {}), "take": taken}
    asked = _nested(pairs(rating, "--rating", number_or_name)) if rating else None
    with working(f"sizing {len(scene.drives)} drives") as tell:
        report = size(
            scene,
            duty,
            catalog,
            rating=asked,
            conditions=conditions,
            on_miss="ignore",
            sensitivity=sensitivity,
            progress=tell,
        )
        summary = sizing_summary(report, tell)
    if report.catalog is not None:
        run.read.extend(report.catalog.files)
    page = partial(sizing_page, report, shlex.join(["pinfric", *run.words]), inputs())
    files: Files = {"report.html": lambda path: path.write_text(page(), encoding="utf-8")}
    if bill := bill_of_materials(report):
        files["bom.csv"] = bill
    if out is not None:
        files |= sized_files(report, out)
        judge_files(report)
    show_it = partial(sizing_report, report, run.verbose, out is not None)
    answer(
        "size",
        summary,
        show_it,
        as_json,
        out,
        files,
        verdict=partial(verdict, report),
        name="sizing.json",
        scene=report.given,
        judged=True,
        outdated=names,
    )
    if report.verdict.failing:  # the last line, and the exit code (2)
        raise SizingError(report.verdict.headline, report)


def _cycles(
    trajectory_name: str | None, cycle: list[str] | None, rated: bool
) -> dict[str, list[tuple[str, float]]]:
    """Return the cycles of each scene named as SCENE:FILE, each with its share or count.

    The key "" holds those of the command's own scene; beside a rating there may be none.
    """
    weighed = [weighted(text) for text in cycle or ()]
    alone = [] if trajectory_name is None else [(trajectory_name, 1.0)]
    if bool(weighed) == bool(alone) and (weighed or not rated):
        raise typer.BadParameter(
            "give one TRAJECTORY after SCENE, --cycle for each of several, or --rating payload=KG",
            param_hint="--cycle",
        )
    by_scene: dict[str, list[tuple[str, float]]] = {"": []}
    for name, share in weighed or alone:
        scene, colon, file = name.partition(":")
        there = colon and scene.lower().endswith((".yaml", ".yml"))
        by_scene.setdefault(scene if there else "", []).append((file if there else name, share))
    if len(by_scene) > 1 and not by_scene[""]:
        raise typer.BadParameter(
            "all cycles name another scene; give one of SCENE itself, too", param_hint="--cycle"
        )
    return by_scene


def _nested(options: dict[str, Any]) -> dict[str, Any]:
    nested: dict[str, Any] = {}
    for name, value in options.items():
        key, dot, inner = name.partition(".")
        if dot:
            nested.setdefault(key, {})[inner] = value
        else:
            nested[key] = value
    return nested


@app.command(short_help="Make a catalogue for `size` from a table of parts.")
def catalog(
    table: Annotated[Path, argument("One part per row.", "TABLE.csv")],
    columns: Annotated[
        Path | None,
        option("Meaning and unit of the columns; default TABLE.columns.yaml.", "FILE"),
    ] = None,
    out: Annotated[Path | None, option("By default TABLE.yaml beside it.", "FILE", "--out")] = None,
) -> None:
    """Make a catalogue for `size` from a table of motors, gears, gearmotors, bearings or brakes."""
    from pinfric.drives.catalog_file import load_catalog
    from pinfric.drives.table import import_table, mapping_of, write_catalog
    from pinfric.model.brief import counted
    from pinfric.model.files import check_writable
    from pinfric.show.report.imported import imported_report

    file = out or table.with_suffix(".yaml")
    note_input(table, columns or mapping_of(table))
    check_writable(file.parent, [file.name])
    imported = import_table(table, columns)
    write_catalog(imported.content, file, table.name)
    load_catalog(file)  # questions units that are unlikely
    show(imported_report(imported))
    ((section, entries),) = ((k, v) for k, v in imported.content.items() if k != "pinfric_catalog")
    say(f"wrote {file}: {counted(len(entries), section.removesuffix('s'))}")


@app.command(short_help="Find the worst stops of a cycle: times, ways, brakes, gears.")
@takes_logs
def stop(
    *,
    scene_name: SceneName,
    trajectory_name: TrajectoryName,
    category: Annotated[int | None, option("0 or 1; by default the scene's.", min=0, max=1)] = None,
    out: OutFolder = None,
    as_json: AsJson = False,
    log: Any,
) -> None:
    """Find the worst stops of a cycle, commanded anywhere along it.

    Stopping time and travel of each axis, the tool's path, sag, energy of brakes and peaks of
    gears, by payload and speed. --out writes summary.json, report.html, stop.png
    and stop.pdf.
    """
    names = ["report.html", *picture_files("stop"), "summary.json"]
    scene, trajectory = load(scene_name, trajectory_name, log, out, names)
    from pinfric.checking.findings import errors
    from pinfric.show.pages.stop import stop_page
    from pinfric.show.report.stop import stop_report, verdict
    from pinfric.stops.study import stop, stop_summary

    with progress("stops") as report:
        result = stop(scene, trajectory, category=category, progress=report)
    summary = stop_summary(result)
    files: Files = {
        "report.html": lambda path: path.write_text(stop_page(result), encoding="utf-8"),
        **pictures_of(out, result),
    }
    tables = partial(stop_report, scene.source, summary, run.verbose, out is not None)
    said = partial(verdict, summary)
    answer("stop", summary, tables, as_json, out, files, verdict=said, scene=scene)
    result.check()  # what is not met is the last line, and the exit code (2)
    if wrong := errors(scene.quick_findings):
        raise PinfricError("; ".join(wrong))


@app.command(short_help="Find the fastest motion along a path for given drives.")
def retime(
    scene_name: SceneName,
    path_name: Annotated[
        str,
        argument("Way-points (`via: true`: no stop) or a trajectory.", "PATH"),
    ],
    motors: Motors = None,
    heat: Annotated[
        bool,
        option("Keep the continuous torques over the repeated cycle.", "", "--heat/--no-heat"),
    ] = True,
    smooth: Annotated[float, option("Ramp accelerations over this time.", "MS", min=0.0)] = 0.0,
    out: OutFolder = None,
    as_json: AsJson = False,
) -> None:
    """Find the fastest motion along a path, and the drives that limit it.

    Limits: motor torque, speed-torque line, heat, gear and joint (without --motors the URDF's).
    All friction and gear losses are included. --out writes trajectory.csv, retime.png,
    retime.pdf and summary.json.
    """
    names = ["trajectory.csv", *picture_files("retime"), "summary.json"]
    scene, _ = load(scene_name, out=out, names=names, later=[path_name, motors])
    from pinfric.retiming.retime import retime
    from pinfric.retiming.summary import retime_summary
    from pinfric.show.report.retime import retime_report, verdict

    with working("retiming"):
        result = retime(scene, path_name, motors, heat=heat, smooth=1e-3 * smooth)
    run.read.extend([result.problem.path.source, motors or ""])
    summary = retime_summary(result)
    files: Files = {
        "trajectory.csv": result.trajectory.to_csv,
        **pictures_of(out, result),
    }
    report = partial(retime_report, result, summary, run.verbose, out is not None)
    said = partial(verdict, summary)
    answer("retime", summary, report, as_json, out, files, verdict=said, scene=scene)


@app.command()
@takes_logs
def sweep(
    *,
    scene_name: SceneName,
    trajectory_name: TrajectoryName,
    sweep_name: Annotated[str, argument("Parameters and distributions: file or bundled.", "SWEEP")],
    processes: Annotated[
        int | None,
        option("Number of processes; by default chosen automatically.", "N", min=1),
    ] = None,
    cluster: Annotated[
        str | None,
        option("Address of a Dask cluster that computes instead.", "ADDRESS"),
    ] = None,
    out: OutFolder = None,
    as_json: AsJson = False,
    log: Any,
) -> None:
    """Vary friction, payload, speed and mounting of a cycle.

    Gives percentiles of each joint's peak and RMS, how often a motor suffices, and the most
    influential parameters. --out writes samples.csv, sweep.png, sweep.pdf and
    summary.json.
    """
    names = ["samples.csv", *picture_files("sweep"), "summary.json"]
    scene, trajectory = load(scene_name, trajectory_name, log, out, names, [sweep_name])
    from pinfric.show.report.sweep import sweep_report
    from pinfric.sweeps.run import sweep
    from pinfric.sweeps.summary import sweep_summary
    from pinfric.sweeps.workers import on_cluster

    if processes and cluster:
        raise typer.BadParameter("has its own processes", param_hint="--cluster")
    with progress("cycles") as report, on_cluster(cluster) if cluster else nullcontext():
        result = sweep(scene, trajectory, sweep_name, processes=processes, progress=report)
    run.read.append(result.sweep)
    with working(f"percentiles and correlations of {result.samples} cycles"):
        summary = sweep_summary(result)

    def write_samples(path: Path) -> None:
        with progress("rows of samples.csv") as report:
            result.write_csv(path, report)

    files: Files = {
        "samples.csv": write_samples,
        **pictures_of(out, result),
    }
    tables = partial(sweep_report, result, summary)
    answer("sweep", summary, tables, as_json, out, files, scene=scene)


@app.command(short_help="Write a motion, within limits, whose log will show friction.")
def excite(
    scene_name: SceneName,
    duration: Annotated[
        float | None, option("Of the motion, about (s); by default 20 a joint.", "SECONDS")
    ] = None,
    rate: Annotated[float, option("Of the samples (Hz).", "HZ")] = 250.0,
    share: Annotated[float, option("Of the URDF's speed and effort limits, used.", "PART")] = 0.8,
    range_: Annotated[
        list[str] | None,
        option("Where a joint may move; at most 90 degrees each way.", "JOINT=LOW:HIGH", "--range"),
    ] = None,
    speed: Annotated[
        list[str] | None, option("Top speed, in place of the share.", "JOINT=SPEED")
    ] = None,
    acceleration: Annotated[
        list[str] | None, option("Largest; else top speed in 0.4 s.", "JOINT=VALUE")
    ] = None,
    seed: Annotated[int, option("Of the search.", "N", min=0)] = 0,
    out: OutFolder = None,
    as_json: AsJson = False,
) -> None:
    """Write a motion whose log will show the friction of each joint, for `identify`.

    All joints move along Fourier series that tell most about friction, then each alone at rising
    speeds, from rest to rest within all limits. Collisions are not checked. --out writes
    excitation.csv (samples), excitation.waypoints.yaml (from point to point) and summary.json.
    """
    names = "excitation.csv", "excitation.waypoints.yaml", "summary.json"
    scene, _ = load(scene_name, out=out, names=names)
    from pinfric.identification.excite import excitation_files, excite
    from pinfric.model.csv_text import number_of
    from pinfric.show.report.excite import excite_report, verdict

    def span(text: str) -> tuple[float, float]:
        low, _, high = text.partition(":")
        return number_of(low), number_of(high)

    with working("searching a motion"):
        found = excite(
            scene,
            duration=duration,
            rate=rate,
            share=share,
            ranges=pairs(range_, "--range", span, "JOINT=LOW:HIGH"),
            speeds=pairs(speed, "--speed", number_of),
            accelerations=pairs(acceleration, "--acceleration", number_of),
            seed=seed,
        )
    report = partial(excite_report, found, out is not None)
    files = excitation_files(found)
    said = partial(verdict, found)
    answer("excite", found.summary, report, as_json, out, files, verdict=said, scene=scene)


@app.command(short_help="Identify friction from a robot's own logs, with intervals.")
@takes_logs
def identify(
    *,
    scene_name: SceneName,
    logs: Annotated[list[str], argument("Logs with measured efforts.", "LOG")],
    gain: Annotated[
        list[str] | None,
        option("Factor from a logged effort to N m.", "JOINT=FACTOR"),
    ] = None,
    effort_at: EffortAt = "reflected",
    inertia: Annotated[
        str,
        option("Link inertias: correct or keep the URDF's.", "consistent|keep"),
    ] = "consistent",
    payload: Annotated[
        list[str] | None,
        option("A payload of the scene, or none, that this log carries.", "LOG=NAME"),
    ] = None,
    without: Annotated[
        list[str] | None,
        option("Joints whose friction is not fitted: efforts unusable.", "JOINT,..."),
    ] = None,
    held_out: Annotated[
        list[str] | None,
        option("A log that is predicted only, not fitted.", "LOG"),
    ] = None,
    out: OutFolder = None,
    as_json: AsJson = False,
    log: Any,
) -> None:
    """Identify the friction of a robot's joints from its own logs, with 95 % intervals.

    --out writes scene.yaml, robot.urdf, posterior.csv, sweep.yaml, report.html, summary.json and
    advice.waypoints.yaml.
    """
    texts = "scene.yaml", "robot.urdf", "posterior.csv", "sweep.yaml", "advice.waypoints.yaml"
    names, later = (*texts, "report.html", "summary.json"), [*logs, *(held_out or ()), log.columns]
    scene, _ = load(scene_name, out=out, names=names, later=later)
    from dataclasses import replace

    from pinfric.identification.files import identified_files
    from pinfric.identification.identify import identify
    from pinfric.identification.summary import identify_summary
    from pinfric.model.csv_text import number_of
    from pinfric.show.pages.identification import identification_page
    from pinfric.show.report.identify import identify_report, verdict

    with progress("steps") as report:
        identified = identify(
            scene,
            logs,
            gain=pairs(gain, "--gain", number_of),
            effort_at=effort_at,  # type: ignore[arg-type]  # checked before
            inertia=inertia,  # type: ignore[arg-type]  # checked there
            payloads=pairs(payload, "--payload", str),
            held_out=held_out or (),
            options=replace(
                log, without=[name.strip() for x in without or () for name in x.split(",")]
            ),
            progress=report,
        )
    run.read.extend(logs)
    summary = identify_summary(identified)
    files: Files = {
        **(identified_files(identified, out) if out is not None else {}),
        "report.html": lambda path: path.write_text(
            identification_page(identified), encoding="utf-8"
        ),
    }
    tables = partial(identify_report, identified, summary, run.verbose, out is not None)
    said = partial(verdict, summary)
    answer(
        "identify", summary, tables, as_json, out, files, verdict=said, scene=scene, outdated=names
    )


@app.command()
@takes_logs
def replay(
    *,
    scene_name: SceneName,
    motion_name: Annotated[
        str | None,
        argument("By default the scene's own simulation.", "TRAJECTORY | MOTION.npz"),
    ] = None,
    html: Annotated[
        Path | None,
        option("The page to write; by default SCENE.replay.html here.", "FILE", "--html"),
    ] = None,
    open_browser: Annotated[bool, option("Show it in a browser.", "", "--open")] = False,
    motors: Motors = None,
    effort_at: EffortAt = "reflected",
    as_json: AsJson = False,
    log: Any,
) -> None:
    """Show a motion in 3D: which joints slide, which stick, and when.

    The page is one file that plays without a network. It marks where a log's own efforts differ
    from the computed ones; with --motors, which drive limits the motion.
    """
    from pinfric.model.files import check_writable
    from pinfric.model.scene_file import load_scene
    from pinfric.show.replay.replay import replay, replay_lines
    from pinfric.show.timeline.motion import motion_to_replay

    scene = load_scene(scene_name)
    note_input(*(name for name in (motion_name, motors, log.columns) if name))
    if html is not None and not html.name:
        raise typer.BadParameter("is not a file name", param_hint="--html")
    if html is not None and html.suffix.lower() in (".png", ".jpg", ".pdf", ".svg", ".gif", ".mp4"):
        raise typer.BadParameter(
            f"{html}: a page is HTML; name it {html.with_suffix('.html')}", param_hint="--html"
        )
    html = html or Path(f"{Path(scene.source).stem}.replay.html")
    check_writable(html.parent, [html.name])
    interrupted: SimulationInterrupted | None = None
    with working("computing the motion"):
        try:
            motion, judged = motion_to_replay(scene, motion_name, log, effort_at)
        except SimulationInterrupted as interrupt:  # what was computed is shown
            interrupted, motion, judged = interrupt, interrupt.motion, None
    title = Path(scene.source).stem + (f" · {Path(motion_name).name}" if motion_name else "")
    with working(f"writing {html}"):
        shown = replay(scene, motion, html=html, title=title, log=judged, limits=motors)
    opened = shown.open() if open_browser else None
    urdf = "" if scene.robot is None else scene.robot.urdf
    run.read.extend([scene.source, urdf, motion_name or "", log.columns or "", motors or ""])
    lines = partial(replay_lines, shown, opened)
    answer("replay", shown, lines, as_json, scene=scene)
    if interrupted is not None:
        raise interrupted


@app.command(short_help="Write a starting scene and motion for a URDF, guesses marked.")
def new(
    urdf: Annotated[Path, argument("The robot.", "URDF")],
    out: Annotated[Path, option("Folder for the files.", "DIR", "--out")] = Path(),
    payload: Annotated[
        float | None,
        option("Rated payload: also its scene entry and NAME.rating.waypoints.yaml.", "KG"),
    ] = None,
    link: Annotated[
        str | None,
        option("That carries the payload; by default the last.", "LINK"),
    ] = None,
    drive: Annotated[
        str | None,
        option(
            "What the drives are; friction is guessed as measured on such.",
            "strain_wave|cycloidal|direct|servo",
        ),
    ] = None,
    mass: Annotated[
        float | None,
        option("Of a robot whose URDF has none: shared by its links.", "KG"),
    ] = None,
    floating: Annotated[
        bool,
        option("The base is free and stands on its legs: also a squat.", "", "--floating"),
    ] = False,
    xacro_arg: XacroArgs = None,
) -> None:
    """Write a starting scene and a first motion for a URDF; every guess is marked.

    With --payload also NAME.rating.waypoints.yaml: the payload held in the worst posture of each
    joint, and lifted from there by it alone. With --mass also NAME.masses.urdf, the robot with that
    mass.
    """
    if link is not None and payload is None:
        raise typer.BadParameter("is the payload's: give --payload KG", param_hint="--link")
    from pinfric.checking.plausibility import check
    from pinfric.model.scene_file import load_scene
    from pinfric.new_scene import first_command, write_new
    from pinfric.show.report.check import doubts

    with working("reading the robot and its meshes"), warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)  # what they say is among the doubts
        arguments = xacro_arguments(xacro_arg)
        given = {"drive": drive, "mass": mass, "floating": floating, "xacro_args": arguments}
        files = write_new(urdf, out, payload, link, **given)
        scene = payload is not None or mass is not None or floating
        report = check(files[0]) if scene else check(urdf, arguments)
        started = load_scene(files[0])
        command, motion = first_command(started, files)
    show(doubts(report))
    for file in files:
        print_line(f"wrote {file}")
    if mass is None and not started.feet:  # `size` does not take what stands on its feet
        print_line(
            "do the links' masses hold the motors and gears? Write `robot.masses`: until then "
            "`size` tries both and takes the heavier drives"
        )
    named = " ".join(map(str, [files[0], *motion]))
    print_line(f"try: pinfric {command} {named}")
    if payload is not None:
        of = "" if link is None else f" --rating link={link}"
        print_line(f"or: pinfric size {named} --rating payload={payload:g}{of} --catalog default")


@app.command(short_help="List the bundled robots whose friction was measured.")
def robots() -> None:
    """List the bundled robots whose friction was measured: to which speed, on which side, by whom.

    Then the bundled scenes and URDFs by name. A scene's name is a SCENE of all commands: `pinfric
    export ur5e --to mjcf`. The header of its file says what is not known and what contradicts it.
    """
    from pinfric.show.report.robots import robots_report

    show(robots_report())


@app.command(short_help="Print the JSON schema of a file's format, for editors.")
def schema(
    name: Annotated[
        str,
        argument(
            "scene, waypoints, columns, sweep, motors, catalog, table; result (of --json).",
            "FORMAT",
        ),
    ],
) -> None:
    """Print the JSON schema of a file's format; editors use it to complete and check such files.

    `pinfric schema result` is the schema of everything that `--json` prints.
    """
    if name == "result":
        from pinfric.show.report.envelope import result_schema

        show(result_schema(result_classes()))
        return
    from pinfric.formats import json_schema

    show(json_schema(name))


@app.command(short_help="List implausible values of a robot or a scene.")
def check(
    source: Annotated[str, argument("The robot, or a scene with its robot.", "URDF | SCENE")],
    strict: Annotated[
        bool, option("Treat warnings as errors (exit code 2).", "", "--strict")
    ] = False,
    xacro_arg: XacroArgs = None,
    as_json: AsJson = False,
) -> None:
    """List implausible values of a robot or a scene, and the units that would explain them."""
    from pinfric.checking.plausibility import check, is_urdf
    from pinfric.model.scene_file import load_scene
    from pinfric.show.report.check import check_report

    with working("reading the robot and its meshes"), warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)  # what they say is among the findings
        scene = None if is_urdf(source) else load_scene(source)
        report = check(scene or source, xacro_arguments(xacro_arg))
    run.read.extend(report.files)
    answer("check", report, partial(check_report, report), as_json, scene=scene, judged=True)
    report.check(strict)  # errors are the last line, and the exit code (2)


@app.command("warm-up", short_help="Compile a scene's kernels, so that no later run waits.")
def warm_up(
    scene_name: Annotated[str | None, argument("Scene file or bundled scene.", "SCENE")] = None,
    everything: Annotated[bool, option("What all commands need.", "", "--all")] = False,
) -> None:
    """Compile what the dynamics of a scene need, so that no later run waits for the compiler.

    Takes a minute or two with an empty cache, seconds if everything is compiled already. --all
    takes two minutes or three: open chains, loops, and what size, retime, sweep and stop need.
    """
    if everything == (scene_name is not None):
        raise PinfricError("warm-up: give a scene, or --all")
    from pinfric.dynamics.warm_up import warm_up
    from pinfric.show.report.values import digits

    start = time.monotonic()
    with working("compiling"), warnings.catch_warnings():
        if scene_name is not None:
            warm_up(load(scene_name)[0])
        else:
            warnings.simplefilter("ignore")  # of bundled scenes, whose results are not shown
            warm_up(load("delta")[0])
            scene, _ = load("ur10_braked")
            warm_up(scene)
            _warm_up_studies(scene)
    what = f"{Path(scene_name).stem}: all" if scene_name else "all"
    print_line(f"{what} kernels are ready, after {digits(time.monotonic() - start)} s")


def _warm_up_studies(scene: Any) -> None:
    from pinfric.motions.trajectory import load_trajectory
    from pinfric.retiming.retime import retime
    from pinfric.sizing.size import size
    from pinfric.stops.study import stop
    from pinfric.sweeps.run import sweep

    motion = load_trajectory("ur10_machine_tending", scene)
    size(scene, motion, "default", on_miss="ignore")
    stop(scene, motion)
    retime(scene, motion)
    speed = {"uniform": {"low": 0.9, "high": 1.1}}
    varied = {"pinfric_sweep": 1, "samples": 2, "parameters": {"speed": speed}}
    sweep(scene, motion, varied, processes=1)


@app.command(short_help="Measure computing time against accuracy.")
def accuracy(scene_name: SceneName, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Measure computing time against accuracy of each method of simulation.

    --out writes accuracy.png, accuracy.pdf, accuracy.csv and summary.json.
    """
    names = [*picture_files("accuracy"), "accuracy.csv", "summary.json"]
    scene, _ = load(scene_name, out=out, names=names)
    from pinfric.accuracy.study import accuracy
    from pinfric.show.report.accuracy import accuracy_report

    with working("measuring, half a minute or more; minutes with closed loops"):
        measured = accuracy(scene)
    files: Files = {
        **pictures_of(out, measured),
        "accuracy.csv": lambda path: measured.summary().to_csv(path),
    }
    report = partial(accuracy_report, measured)
    answer("accuracy", measured, report, as_json, out, files, scene=scene)


@app.command(short_help="List the effects in a scene, with cost and change of each.")
@takes_logs
def explain(
    *,
    scene_name: SceneName,
    trajectory_name: Annotated[
        str | None,
        argument("Log, CSV or way-points; else random states.", "TRAJECTORY"),
    ] = None,
    as_json: AsJson = False,
    log: Any,
) -> None:
    """List the effects in a scene, the keys that cause them, and what each costs and changes."""
    scene, trajectory = load(scene_name, trajectory_name, log)
    from pinfric.accuracy.explain import explain
    from pinfric.show.report.explain import explain_report

    with working("measuring"):
        explanation = explain(scene, trajectory)
    report = partial(explain_report, explanation, scene.source)
    answer("explain", explanation, report, as_json, scene=scene)


@app.command(short_help="Write the robot for other engines, or for C++ controllers.")
@takes_logs
def export(
    *,
    scene_name: SceneName,
    to: Annotated[
        str,
        option("mjcf, urdf, sdf, constants, actuator (both JSON), cpp, ros2.", "FORMAT", "--to"),
    ],
    trajectory_name: Annotated[
        str | None,
        option("Motion to fit constants to; else random states.", "FILE", "--trajectory"),
    ] = None,
    out: Annotated[
        Path | None,
        option("By default SCENE.mjcf.xml, ... here.", "FILE | DIR", "--out"),
    ] = None,
    frame: Annotated[
        list[str] | None,
        option("cpp, ros2: a link for payloads and wrenches at run time.", "LINK", "--frame"),
    ] = None,
    namespace: Annotated[
        str,
        option("cpp, ros2: of the header and its file; for two arms.", "NAME", "--namespace"),
    ] = "",
    as_json: AsJson = False,
    log: Any,
) -> None:
    """Write the robot for other engines, with constants in place of its friction, or for C++.

    For each constant its error against the scene along the trajectory is given. `--to cpp` writes
    a header for controllers, which uses the present load and needs no constants, and its test; it
    prints the error that constants would make. `--to ros2` writes a package of ROS 2 around it,
    `--to actuator` models of each joint's friction as trainers take them, with their errors.
    """
    from dataclasses import replace

    from pinfric.exporting.export import export, places
    from pinfric.show.report.export import export_report

    scene, _ = load(scene_name, later=[trajectory_name])
    file, *beside = places(scene, to, out, namespace)
    trajectory = None if trajectory_name is None else load_motion_of(scene, trajectory_name, log)
    exported = export(scene, trajectory, to, frames=frame or (), namespace=namespace)
    exported.write(file.parent if beside else file)
    say(f"wrote {' and '.join([str(file), *(other.name for other in beside)])}")
    exported = replace(exported, file=str(file))
    answer("export", exported, partial(export_report, exported), as_json, scene=scene)


#: Command -> module and described classes of what its `--json` holds as its result.
_RESULTS = {
    "inverse": "show.inverse_summary InverseSummary",
    "simulate": "show.motion_summary MotionSummary",
    "paper": "paper.reproduction Examples LiteralExamples",
    "size": "sizing.summary SizingSummary",
    "stop": "stops.study StopSummary",
    "retime": "retiming.summary RetimeSummary",
    "sweep": "sweeps.summary SweepSummary",
    "excite": "identification.excite ExciteSummary",
    "identify": "identification.summary IdentifySummary",
    "replay": "show.replay.replay Replay",
    "check": "checking.findings CheckReport",
    "accuracy": "accuracy.study Accuracy",
    "explain": "accuracy.explain Explanation",
    "export": "exporting.export Exported",
}


def result_classes() -> dict[str, list[type]]:
    """Return the classes of `_RESULTS`."""
    classes = {}
    for command, words in _RESULTS.items():
        module, *names = words.split()
        classes[command] = [getattr(import_module(f"pinfric.{module}"), name) for name in names]
    return classes


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit; bad input ends in one line on stderr and exit code 2.

    Args:
        arguments: what follows `pinfric`; None takes it from the shell.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a terminal without UTF-8 gets "?", not a traceback
            stream.reconfigure(errors="replace")
    run.begin(sys.argv[1:] if arguments is None else list(arguments))
    os.environ["MPLBACKEND"] = "agg"  # pictures are written, never shown
    if (
        columns := os.environ.get("COLUMNS", "")
    ).isdecimal():  # rich fills so many, or says nothing
        os.environ["COLUMNS"] = str(int(min(float(columns) or _WIDE, _WIDEST)))
    with warnings_as_notices(), running_command():
        # the flags that all commands take go before the command: people write them at the end
        known = ("-q", "--quiet", "-v", "--verbose", "--overwrite")
        flags = [word for word in run.words if word in known]
        sys.exit(_run(flags + [word for word in run.words if word not in flags]))


@cache
def _program() -> Any:
    """Make the commands from their functions, which takes typer 9 ms: once in a process."""
    return typer.main.get_command(app)


def _run(arguments: list[str]) -> int:
    started = time.perf_counter()
    # the root of typer's usage errors, by way of the one it exports: its copy of click moves
    usage_error: Any = typer.BadParameter.__mro__[1]
    try:
        code = _program()(arguments, prog_name="pinfric", standalone_mode=False) or 0
        message = "interrupted" if code == INTERRUPTED else ""
    except PinfricError as problem:
        message, code = str(problem), BAD_INPUT
    except usage_error as problem:
        command = problem.ctx.command_path if problem.ctx else "pinfric"
        before, said, complaint = problem.format_message().partition("Input ")
        said = plain(complaint) if said else ""  # typer says of numbers what pydantic says
        pages = problem.ctx and any("--html" in x.opts for x in problem.ctx.command.params)
        if pages and getattr(problem, "option_name", "") == "--out":
            before = "No such option: --out; it writes one page: --html FILE"
        message, code = f"{before}{said} (see {command} --help)", BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):  # typer before 0.20 has Abort, later an exit code
        message, code = "interrupted", INTERRUPTED
    except Exception as problem:
        if os.environ.get("PINFRIC_TRACEBACK"):
            raise
        message, code = _unexpected(problem)
    if run.verbose:
        facts(started)
    if message:
        kind = "internal error" if code == INTERNAL_ERROR else "error"
        say(f"{kind}: {message}", error=True)
    return int(code)


def _environment() -> str:
    """What surrounds the process and lets no command work; empty if nothing is found."""
    import resource

    threads = os.environ.get("NUMBA_NUM_THREADS")
    if threads is not None and (not threads.isdecimal() or int(threads) < 1):
        return f"NUMBA_NUM_THREADS={threads}: should be a whole number from 1; correct or unset it"
    try:
        os.getcwd()
    except FileNotFoundError:
        return "the working folder was removed; change to one that is there"
    try:
        tempfile.gettempdir()
    except FileNotFoundError:
        return "no folder for temporary files can be written; name one that can: TMPDIR"
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most != resource.RLIM_INFINITY and most < _MEMORY:
        return (
            f"memory is limited to {most / 1e6:.0f} MB (ulimit -v); small robots need "
            f"{_MEMORY / 1e6:.0f} MB"
        )
    return ""


def _unexpected(problem: Exception) -> tuple[str, int]:
    if around := _environment():
        return around, BAD_INPUT
    if isinstance(problem, MemoryError):
        return "the memory is full; give fewer samples, or close other programs", BAD_INPUT
    if isinstance(problem, OSError) and problem.filename is not None:  # a disk, a name, a right
        name = str(problem.filename)
        name = name if len(name) <= 250 else f"{name[:80]}..."
        return f"{name}: {problem.strerror}", BAD_INPUT
    if isinstance(problem, OSError) and problem.errno == errno.ENOSPC:  # of what is printed
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing more is tried
        return f"standard output cannot be written: {problem.strerror}", BAD_INPUT
    text = " ".join(f"{type(problem).__name__}: {problem}".split())[:200]
    return f"{text}; run with PINFRIC_TRACEBACK=1 to see where", INTERNAL_ERROR


if __name__ == "__main__":
    main()
