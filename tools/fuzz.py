"""Mutated scenes, URDFs, logs, way-points, motions, sweeps and catalogues against the command line.

    python tools/fuzz.py --count 10000 --seed 1      all of it; 30 minutes of one core
    python tools/fuzz.py --case 4711 --keep DIR      one case again, its files kept

First every file and command runs without a mutation and must end in exit 0, which also compiles the
kernels. Each case, which depends on its seed alone, mutates one input of one command and must end
in exit 0 with numbers that are numbers, or in exit 2 and one line on stderr that names the place.
Everything else is a finding: exit 70, an exception, a number that is none, a changed input (in one
case of seven the results' place is an input, a link to one or their folder), Python's own warnings,
a hang, the death of the interpreter (cases run in a process of their own, which tells the case it
dies of).
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import gzip
import io
import json
import math
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/helpers"))
from mutations import NAMES, NUMBERS, Mutator
from sizing_cases import GEAR, MOTOR

ROOT = Path(__file__).parents[1]
ROBOTS = ROOT / "robots"
#: A case that takes longer (s) hangs.
LIMIT = 30.0
#: Way-points with more samples than this are refused, as those beyond 20 million are outside.
MAX_SAMPLES = 200_000
FOUND = {"exit 0", "exit 2"}

ARM_URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper_arm"><inertial><origin xyz="0.5 0 0" rpy="0 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="part.stl" scale="1 1 1"/></geometry></visual>
    <visual><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.02" length="0.1"/></geometry>
    <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material></visual></link>
  <link name="ram"><inertial><origin xyz="0 0.1 0"/><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><origin xyz="0 0 0.3" rpy="0 0.1 0"/>
    <parent link="base"/><child link="upper_arm"/><dynamics damping="0.1" friction="0.2"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="50"/></joint>
  <joint name="extension" type="prismatic"><parent link="upper_arm"/><child link="ram"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" effort="50" velocity="50"/></joint>
</robot>
"""
ARM_SCENE = {
    "pinfric": 1,
    "robot": {
        "urdf": "arm.urdf",
        "gravity": [0.0, 0.0, -9.81],
        "urdf_dynamics": "use",
        "masses": {"shoulder": "with_drives", "others": "without_drives"},
        "payloads": {
            "box": {
                "link": "ram",
                "mass": 1.0,
                "com": [0.0, 0.0, 0.1],
                "attached": False,
                "inertia": [0.01, 0.0, 0.0, 0.01, 0.0, 0.01],
            }
        },
    },
    "friction": {
        "shoulder": {
            "bearing": {"kind": "pin", "radius": 0.05, "length": 0.1},
            "mu": {"static": 0.2, "kinetic": 0.1},
            "stribeck": {"velocity": 0.02},
            "coulomb": {"static": 1.0, "kinetic": 0.8},
            "viscous": 0.5,
        },
        "extension": {
            "bearing": {"kind": "guide", "length": 0.2, "width": 0.1},
            "mu": {"static": 0.2, "kinetic": 0.1},
        },
    },
    "actuators": [
        {
            "joint": "shoulder",
            "transmission": {
                "ratio": 100.0,
                "efficiency": 0.8,
                "back_efficiency": 0.75,
                "no_load_torque": 0.01,
                "motor_viscous": 1e-4,
                "rotor_inertia": 1e-5,
                "brake": {"torque": 2.0, "engage_time": 0.02},
            },
        },
        {
            "joint": "extension",
            "transmission": {
                "ratio": 500.0,
                "rotor_inertia": 1e-5,
                "brake": {"torque": 0.5, "engage_time": 0.02},
            },
        },
    ],
    "stops": {"category": 0, "reaction_time": 0.01},
    "stick": {"velocity": 1e-6},
    "simulation": {
        "start": {"q": {"shoulder": 0.1, "extension": 0.2}, "v": {"shoulder": 0.5}},
        "effort": {
            "shoulder": 5.0,
            "extension": {"sine": {"amplitude": 3.0, "angular_frequency": 4.0}},
        },
        "t_end": 0.05,
    },
}
ARM_CSV = "t,shoulder,extension,payload.box\n" + "".join(
    f"{0.02 * i:.2f},{0.3 * math.sin(0.1 * i):.6f},{0.2 + 0.1 * math.sin(0.07 * i):.6f},"
    f"{int(i > 30)}\n"
    for i in range(60)
)
LOG = [[float(cell) for cell in line.split(",")] for line in ARM_CSV.splitlines()[1:]]
LOG_COLUMNS = dict(zip(("t", "shoulder", "extension"), zip(*LOG, strict=True), strict=False))
LOG_MESSAGES = [
    (1_700_000_000_000_000_000 + round(1e9 * t), ("shoulder", "extension"), places)
    for t, *places, _ in LOG
]
#: Forms of the arm's log, by the ending of its file.
LOGS = ("csv", "csv.gz", "parquet", "db3", "mcap")
ARM_WAY = {
    "pinfric_trajectory": 1,
    "profile": "quintic",
    "sample_rate": 50,
    "points": [
        {"q": [0.0, 0.1], "hold": 0.1},
        {"q": [0.5, 0.2], "duration": 0.5, "hold": 0.2, "attach": "box"},
        {"q": [0.0, 0.1], "duration": 0.4, "detach": "box"},
    ],
}
SWEEP = {
    "pinfric_sweep": 1,
    "samples": 4,
    "sampling": "random",
    "seed": 1,
    "parameters": {
        "friction.*.mu": {"lognormal": {"median": 1.0, "sigma": 0.3}},
        "friction.*.viscous": {"uniform": {"low": 0.5, "high": 2.0}, "each": True},
        "payload.box.mass": {"truncated_normal": {"mean": 2.0, "std": 0.2, "low": 1.0}},
        "speed": {"uniform": {"low": 0.9, "high": 1.1}},
        "mounting.pitch": {"normal": {"mean": 0.0, "std": 0.02}},
    },
    "motors": {"shoulder": {"drive": "CubeMars AK80-64"}},
}
MOTORS = {
    "pinfric_motors": 1,
    "drives": {"shoulder": {"continuous_torque": 0.4, "peak_torque": 1.0, "max_speed": 400.0}},
}
TABLE = "Type,Mn,n,Weight,gap\nA,100,3000,250,\nB,150.5,4000,300.5,x\nC,200,3500,400,\n"
TABLE_COLUMNS = {
    "section": "motors",
    "columns": {
        "name": "Type",
        "continuous_torque": {"column": "Mn", "unit": "mN m"},
        "max_speed": {"column": "n", "unit": "rpm"},
        "mass": {"column": "Weight", "unit": "g"},
    },
    "every": {
        "peak_torque": 2.0,
        "rotor_inertia": 1e-5,
        "thermal": {"winding_housing": 1.0, "housing_ambient": 4.0},
        "source": "a maker",
        "grade": "R",
    },
}
CATALOG = {
    "pinfric_catalog": 1,
    "motors": {"M": MOTOR},
    "gears": {"G": GEAR},
    "conditions": {"holding_brake": "any"},  # there is none
}
STL = (
    "solid part\n"
    + "".join(
        f"facet normal 0 0 1\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet\n"
        for a, b, c in (("0 0 0", "0.1 0 0", "0 0.1 0"), ("0 0 0", "0 0 0.1", "0.1 0 0"))
    )
    + "endsolid part\n"
)


@dataclasses.dataclass
class Case:
    """Files and the command line that reads them; `mutated` describes the mutation."""

    files: dict[str, bytes]
    arguments: list[str]
    mutated: str


def yaml_text(tree):
    import yaml

    return yaml.safe_dump(tree, allow_unicode=True, sort_keys=False)


def bag(rows, ending):
    """The file of a bag of joint states: (time in ns, names, positions)."""
    import numpy as np
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types, kind = get_typestore(Stores.LATEST), "sensor_msgs/msg/JointState"
    make, none = types.types, np.array([])
    plugin = StoragePlugin.MCAP if ending == "mcap" else StoragePlugin.SQLITE3
    with tempfile.TemporaryDirectory() as folder:
        with Writer(Path(folder) / "bag", version=9, storage_plugin=plugin) as writer:
            topic = writer.add_connection("/joint_states", kind, typestore=types)
            for at, names, places in rows:
                stamp = make["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
                header = make["std_msgs/msg/Header"](stamp=stamp, frame_id="")
                message = make[kind](header, list(names), np.array(places, float), none, none)
                writer.write(topic, at, types.serialize_cdr(message, kind))
        return next((Path(folder) / "bag").glob(f"*.{ending}")).read_bytes()


def log_file(ending, mutate=None):
    """The arm's log in one of its forms; mutated by a Mutator."""
    import pyarrow as pa
    import pyarrow.parquet as parquet

    if ending.startswith("csv"):
        content = (mutate.table(ARM_CSV) if mutate else ARM_CSV).encode("utf-8", "surrogatepass")
        content = gzip.compress(content, mtime=0) if ending == "csv.gz" else content
        wounded = mutate and ending == "csv.gz" and mutate.chance.random() < 0.2
        return mutate.damaged(content) if wounded else content
    if ending == "parquet":
        made = io.BytesIO()
        parquet.write_table(pa.table(LOG_COLUMNS), made)
        return mutate.parquet(LOG_COLUMNS) if mutate else made.getvalue()
    return bag(mutate.messages(LOG_MESSAGES) if mutate else LOG_MESSAGES, ending)


@contextlib.contextmanager
def _quiet():
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def saved_motion(name):
    """The npz of a bundled scene's first instants."""
    import pinfric as pf

    with tempfile.TemporaryDirectory() as folder:
        motion = pf.simulate(pf.load_scene(name), t_end=0.05)
        return motion.save(Path(folder) / "m.npz").read_bytes()


def bundled(name):
    from pinfric.errors import PinfricError
    from pinfric.model.yamlfile import read_yaml

    scene = read_yaml(ROBOTS / f"{name}.yaml", PinfricError)
    if "simulation" in scene:
        scene["simulation"]["t_end"] = 0.03
    way = read_yaml(ROBOTS / f"{name}.waypoints.yaml", PinfricError)
    way["sample_rate"] = 60
    return scene, (ROBOTS / f"{name}.urdf").read_text(), way


class Maker:
    """Makes the case of a seed."""

    BUNDLED = ("pendulum", "three_link", "drawer", "four_bar", "slider_crank", "excavator")
    CHAINS = ("pendulum", "three_link", "arm")  # with drives at their joints

    def __init__(self):
        from pinfric.motions import waypoints

        # a hold of days is computed, in minutes and not in a case's seconds: refused sooner here
        waypoints._MAX_SAMPLES = MAX_SAMPLES
        self.robots = {name: bundled(name) for name in self.BUNDLED}
        self.robots["arm"] = (ARM_SCENE, ARM_URDF, ARM_WAY)
        self.motions = {name: saved_motion(name) for name in ("pendulum", "four_bar")}

    def bases(self):
        """Cases without a mutation: every file that is mutated, and every command that reads it."""
        chance = Mutator(0).chance
        for name in self.robots:
            motions = ["way.yaml", *(f"motion.{e}" for e in LOGS if name == "arm")]
            for motion in motions:
                yield Case(self._files(name, motion), ["inverse", f"{name}.yaml", motion], name)
            commands = self._commands(chance, name, "way.yaml")
            commands["explain"] = ["explain", f"{name}.yaml", "way.yaml"]
            chosen = ["explain", "replay", "new", "check"]
            chosen += ["simulate"] if "simulation" in self.robots[name][0] else []
            chosen += ["export", "retime"] if name in self.CHAINS else []
            chosen += ["sweep", "stop", "catalog"] if name == "arm" else []
            for command in chosen:
                yield Case(self._files(name, "way.yaml"), commands[command], name)
            if name in ("pendulum", "three_link"):
                sized = [*commands["size"], "--catalog", "catalog.yaml"]
                yield Case(self._files(name, "way.yaml"), sized, name)
            if name in self.motions:
                files = self._files(name, "way.yaml") | {"motion.npz": self.motions[name]}
                replay = ["replay", f"{name}.yaml", "motion.npz", "--html", "page.html"]
                yield Case(files, replay, name)

    def check_bases(self):
        """Run them, which also compiles the kernels, so that no case waits for these."""
        for case in self.bases():
            with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
                found, detail, _ = run_case(case, Path(folder))
            what = f"{' '.join(case.arguments)}, not mutated: {found}: {detail}"
            assert found == "exit 0", what

    def _files(self, name, motion):
        scene, urdf, way = self.robots[name]
        texts = {
            f"{name}.yaml": yaml_text(scene),
            f"{name}.urdf": urdf,
            "way.yaml": yaml_text(way),
            "catalog.yaml": yaml_text(CATALOG),
        }
        if name == "arm":
            texts |= {"sweep.yaml": yaml_text(SWEEP), "part.stl": STL}
            texts |= {"motors.yaml": yaml_text(MOTORS), "table.csv": TABLE}
            texts |= {"table.columns.yaml": yaml_text(TABLE_COLUMNS)}
        files = {name: text.encode() for name, text in texts.items()}
        if motion.startswith("motion."):
            files[motion] = log_file(motion.removeprefix("motion."))
        return files

    def case(self, seed):
        mutate = Mutator(seed)
        chance = mutate.chance
        what = chance.choices(
            (
                "scene",
                "trajectory",
                "urdf",
                "motion",
                "sweep",
                "catalog",
                "mesh",
                "motors",
                "table",
                "options",
                "names",
            ),
            (30, 30, 24, 8, 7, 5, 2, 4, 6, 4, 4),
        )[0]
        name = chance.choice((*self.robots, "arm", "arm"))
        if what in ("sweep", "mesh", "motors", "table", "names") or (
            what == "trajectory" and chance.random() < 0.5
        ):
            name = "arm"
        elif what == "catalog":
            name = chance.choice(("pendulum", "three_link"))
        elif what == "motion":
            name = chance.choice(list(self.motions))
        scene, _, way = self.robots[name]
        motion = f"motion.{chance.choice(LOGS)}" if name == "arm" else "way.yaml"
        motion = "way.yaml" if chance.random() < 0.3 else motion
        files = self._files(name, motion)
        arguments = self._command(chance, what, name, motion)
        if what == "motion":
            files["motion.npz"] = mutate.archive(self.motions[name])
        elif what == "trajectory" and motion != "way.yaml":
            files[motion] = log_file(motion.removeprefix("motion."), mutate)
        elif what == "names":
            old, new = chance.choice(("shoulder", "ram", "box")), chance.choice(NAMES)
            for file in (f"{name}.yaml", f"{name}.urdf", "sweep.yaml", "motion.csv"):
                if file in files:
                    files[file] = files[file].replace(old.encode(), new.encode())
        file = {
            "scene": f"{name}.yaml",
            "trajectory": "way.yaml" if motion == "way.yaml" else None,
            "urdf": f"{name}.urdf",
            "sweep": "sweep.yaml",
            "catalog": "catalog.yaml",
            "mesh": "part.stl",
            "motors": "motors.yaml",
            "table": "table.csv" if chance.random() < 0.5 else "table.columns.yaml",
        }.get(what)
        if file is not None:
            trees = {f"{name}.yaml": scene, "way.yaml": way}
            trees |= {"sweep.yaml": SWEEP, "catalog.yaml": CATALOG, "motors.yaml": MOTORS}
            trees |= {"table.columns.yaml": TABLE_COLUMNS}
            if file == "table.csv":
                files[file] = mutate.table(TABLE).encode("utf-8", "surrogatepass")
            else:
                files[file] = self._mutated(mutate, files[file].decode(), trees.get(file), what)
        self._placed(chance, files, arguments)
        return Case(files, arguments, f"{what} of {name}")

    @staticmethod
    def _placed(chance, files, arguments):
        """Sometimes name an input, a link to one or their folder as the place of the results."""
        option = {"replay": "--html", "check": "", "explain": ""}.get(arguments[0], "--out")
        if not option or chance.random() > 0.15:
            return
        place = chance.choice((*files, ".", "soft.x", "hard.x", "out"))
        if option in arguments:
            arguments[arguments.index(option) + 1] = place
        else:
            arguments += [option, place]
        scene = next(iter(files))  # an input of these commands
        if (
            place in (scene, ".")
            and arguments[0] not in ("new", "catalog")
            and chance.random() < 0.5
        ):
            arguments.append("--overwrite")

    @staticmethod
    def _mutated(mutate, text, tree, what):
        chance = mutate.chance
        if tree is not None and chance.random() >= 0.25:
            text = yaml_text(mutate.tree(tree))
        else:
            text = (mutate.xml if what == "urdf" else mutate.text)(text)
        content = bytearray(text.encode("utf-8", "surrogatepass"))
        if chance.random() < 0.03:
            content[chance.randrange(len(content) or 1) : 1] = chance.randbytes(3)
        return bytes(content)

    @staticmethod
    def _commands(chance, name, motion):
        scene = f"{name}.yaml"
        return {
            "inverse": ["inverse", scene, motion],
            "explain": ["explain", scene, *chance.choice(([], [motion]))],
            "size": ["size", scene, motion],
            "sweep": ["sweep", scene, motion, "sweep.yaml", "--processes", "1"],
            "replay": ["replay", scene, motion, "--html", "page.html"],
            "stop": ["stop", scene, "way.yaml", *chance.choice(([], ["--category", "1"]))],
            "retime": [
                "retime",
                scene,
                "way.yaml" if motion.endswith((".db3", ".mcap")) else motion,
                *(["--motors", "motors.yaml"] if name == "arm" and chance.random() < 0.7 else []),
            ],
            "export": [
                "export",
                scene,
                *("--to", chance.choice(("mjcf", "urdf", "sdf", "constants", "cpp"))),
                *("--out", "made"),
                *chance.choice(([], ["--trajectory", motion])),
            ],
            "catalog": ["catalog", "table.csv", "--out", "made.yaml"],
            "simulate": [
                "simulate",
                scene,
                "--t-end",
                "0.03",
                "--method",
                chance.choice(("event", "timestepping", "regularized")),
            ],
            "new": ["new", f"{name}.urdf", "--out", "new"],
            "check": ["check", chance.choice((scene, f"{name}.urdf"))],
        }

    def _command(self, chance, what, name, motion):
        commands, scene = self._commands(chance, name, motion), f"{name}.yaml"
        simulated = "simulation" in self.robots[name][0]
        if what == "catalog" or chance.random() < 0.5:
            commands["size"] += ["--catalog", "catalog.yaml"]
        weights = {
            "inverse": 8,
            "explain": 2,
            "size": 3,
            "replay": 2,
            "stop": 3 if name == "arm" else 0,
            "retime": 2 if name in self.CHAINS else 0,
            "export": 3 if name in self.CHAINS else 0,
            "simulate": 6 if simulated else 0,
            "sweep": 2 if name == "arm" else 0,
            "new": 4 if what == "urdf" else 0,
            "check": 3 if what in ("urdf", "scene") else 0,
        }
        if what == "trajectory":
            weights["simulate"] = 0
        only = {"motion": "replay", "sweep": "sweep", "catalog": "size", "mesh": "replay"}
        only = (only | {"motors": "retime", "table": "catalog"}).get(what)
        chosen = only or chance.choices(list(weights), list(weights.values()))[0]
        arguments = commands[chosen]
        if what == "motion":
            arguments[2] = "motion.npz"
        elif what == "motors":
            arguments = [*arguments[:3], "--motors", "motors.yaml"]
        if what == "options":
            arguments = self._options(chance, scene, arguments)
        if chosen not in ("new", "catalog") and chance.random() < 0.7:
            arguments.append("--json")
        if chosen in ("inverse", "simulate", "size") and chance.random() < 0.03:
            arguments += ["--out", "out"]
        return arguments

    @staticmethod
    def _options(chance, scene, arguments):
        # not so long a motion or so short a step that it is honest work
        value = chance.choice([*NUMBERS[:12], "x", "0.02", "0.001"])
        option = chance.choice(("--t-end", "--rtol", "--dt", "name", "threads", "method"))
        long = chance.choice(("y" * 5000, "a/" * 3000, "nul\x00l", "no\nfile", "é\udcff", ""))
        if option == "name":
            place = chance.randrange(1, len(arguments))
            return [*arguments[:place], long, *arguments[place + 1 :]]
        if option == "threads":
            return ["inverse", scene, "way.yaml", "--threads", value]
        method = chance.choice(("event", "timestepping", "regularized", long))
        run = ["simulate", scene, "--method", method]
        short = [] if option == "--t-end" else ["--t-end", "0.01"]
        return [*run, *short] if option == "method" else [*run, *short, f"{option}={value}"]


def numbers_in(node, path=""):
    """(path, number) of every number in a JSON tree."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from numbers_in(value, f"{path}.{key}")
    elif isinstance(node, list):
        for i, value in enumerate(node):
            yield from numbers_in(value, f"{path}[{i}]")
    elif isinstance(node, float):
        yield path, node


def verdict(case, code, out, err):
    """What is wrong with how a case ended, or `exit 0` or `exit 2`."""
    lines = err.split("\n")[:-1]
    if any(not line.startswith("pinfric: ") or not line.isprintable() for line in lines):
        odd = next(x for x in lines if not x.startswith("pinfric: ") or not x.isprintable())
        return "raw text on stderr", odd
    errors = [line for line in lines if line.startswith(("pinfric: error", "pinfric: internal"))]
    if "internal error" in out:  # of a sample, in what is printed
        return "an internal error", out[max(0, out.index("internal error") - 100) :]
    if code == 0 and not errors:
        found, detail = _numbers(case, out)
        return (found, detail) if found != "exit 0" else _words(case, [*_texts(case, out), *lines])
    if code != 2 or len(errors) != 1:
        return f"exit {code}, {len(errors)} errors", (errors or lines or [""])[-1]
    if len(errors[0]) > 6500:
        return "a line without end", errors[0]
    if not _names_a_place(case, errors[0]):
        return "names no place", errors[0]
    return "exit 2", errors[0]


def _numbers(case, out):
    if "--json" in case.arguments:
        try:
            content = json.loads(out)
        except ValueError as problem:
            return "stdout is no JSON", str(problem)
        for path, number in numbers_in(content):
            if not math.isfinite(number):
                return "a number that is none", f"{path} = {number}"
        status = content.get("status") if case.arguments[0] == "inverse" else None
        if status and not any(n for name, n in status.items() if name != "converged"):
            for joint in content["joints"]:  # null only where a sample has no solution, and says so
                if joint["peak"] is None or joint["rms"] is None:
                    return "null without a reason", joint["name"]
        return "exit 0", ""
    return "exit 0", ""


def _texts(case, out):
    """Printed texts: those of a JSON tree, or all of it."""
    if "--json" not in case.arguments:
        return out.splitlines()
    found, left = [], [json.loads(out)]
    while left:
        node = left.pop()
        found += [node] if isinstance(node, str) else []
        left += node if isinstance(node, list) else []
        left += [*node, *node.values()] if isinstance(node, dict) else []
    return found


def _words(case, lines):
    """A number that is none in a sentence or a table, unless an input contains the word."""
    for line in lines:
        for found in re.finditer(
            r"(?<![\w.'`])-?(nan|inf|infinity|∞)(?![\w'`])", line, re.IGNORECASE
        ):
            said = found.group(1).encode()
            if not any(said.lower() in content.lower() for content in case.files.values()):
                return "a number that is none", line
    return "exit 0", ""


def _names_a_place(case, line):
    places = [*case.files, *case.arguments[1:], "--"]
    places += [word for name in case.files for word in (Path(name).stem,)]
    from pinfric.errors import one_line

    return any(len(p) > 1 and one_line(p)[:40] in line for p in places) or re.search(
        r"joint|loop|site|sample|friction\.|motion|t = |robot\.|trajectory|actuators|gear"
        r"|^pinfric: error: the name of the "
        r"|^pinfric: error: (method|rtol|atol|dt|t_end) ",
        line,
    )


def run_case(case, folder):
    """Run one case in this process; returns (verdict, detail, seconds)."""
    from pinfric import cli

    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    first = next(iter(case.files))
    (folder / "hard.x").hardlink_to(folder / first)
    (folder / "soft.x").symlink_to(first)
    out, err = io.StringIO(), io.StringIO()
    before, code, detail = os.getcwd(), None, ""
    os.chdir(folder)
    start = perf_counter()
    with tempfile.TemporaryFile() as raw:
        saved = [(os.dup(number), number) for number in (1, 2)]
        for _, number in saved:
            os.dup2(raw.fileno(), number)  # what C libraries print
        try:
            with (
                contextlib.redirect_stdout(out),
                contextlib.redirect_stderr(err),
                warnings.catch_warnings(),
            ):
                warnings.simplefilter("default")
                warnings.filterwarnings("ignore", category=DeprecationWarning)
                warnings.filterwarnings("always", category=RuntimeWarning)
                cli.main(case.arguments)
        except SystemExit as ended:
            code = ended.code
        except BaseException as problem:
            detail = " ".join(f"{type(problem).__name__}: {problem}".split())
        finally:
            for copy, number in saved:
                os.dup2(copy, number)
                os.close(copy)
            os.chdir(before)
        raw.seek(0)
        said = raw.read().decode(errors="replace")
    seconds = perf_counter() - start
    changed = [n for n, content in case.files.items() if (folder / n).read_bytes() != content]
    if changed:
        return "a changed input", ", ".join(changed), seconds
    if detail:
        return "exception", detail, seconds
    return (*verdict(case, code, out.getvalue(), err.getvalue() + said), seconds)


def work():
    """Read seeds from stdin, run their cases, print a JSON line before and after each."""
    os.environ["PINFRIC_TRACEBACK"] = ""
    with _quiet():
        maker = Maker()
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what is printed late is no answer
    try:
        maker.check_bases()
    except AssertionError as problem:
        answers.write(f"{problem}\n")
        return
    answers.write("ready\n")
    for line in sys.stdin:
        seed = int(line)
        case = maker.case(seed)
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            found, detail, seconds = run_case(case, Path(folder))
        answers.write(
            json.dumps([seed, found, detail[:600], round(seconds, 3), case.mutated, case.arguments])
            + "\n"
        )


class Worker:
    """The process that the cases run in; a new one replaces one that dies."""

    def __init__(self):
        self.process = None

    def _start(self):
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--work"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        answer = self._answer(1800.0)
        assert answer == "ready\n", answer or "the worker does not start"

    def _answer(self, limit):
        ready, _, _ = select.select([self.process.stdout], [], [], limit)
        return self.process.stdout.readline() if ready else None

    def run(self, seed):
        if self.process is None:
            self._start()
        self.process.stdin.write(f"{seed}\n")
        self.process.stdin.flush()
        answer = self._answer(LIMIT)
        if answer:
            return json.loads(answer)
        if answer is None:
            found = f"no end in {LIMIT:g} s"
        else:
            found = f"the interpreter died ({self.process.wait()})"
        self.close()
        return [seed, found, "", LIMIT, "", []]

    def close(self):
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
            self.process = None


def fuzz(count, seed, tell=lambda answer: None):
    """Run `count` cases; returns the findings' answers, and counts by outcome."""
    worker, findings, counts = Worker(), [], Counter()
    try:
        for number in range(seed * 1_000_000, seed * 1_000_000 + count):
            answer = worker.run(number)
            counts[answer[1]] += 1
            tell(answer)
            if answer[1] not in FOUND:
                findings.append(answer)
    finally:
        worker.close()
    return findings, counts


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="run one case alone, with its output")
    parser.add_argument("--keep", type=Path, help="where the files of --case are written")
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work:
        work()
    elif given.case is not None:
        case = Maker().case(given.case)
        folder = given.keep or Path(tempfile.mkdtemp(prefix="fuzz-"))
        folder.mkdir(parents=True, exist_ok=True)
        found, detail, seconds = run_case(case, folder)
        print(f"{case.mutated}: pinfric {' '.join(map(repr, case.arguments))}")
        print(f"{found} in {seconds:.2f} s, in {folder}\n{detail}")
        if given.keep is None:
            shutil.rmtree(folder)
    else:
        start = perf_counter()

        def tell(answer):
            if answer[1] not in FOUND:
                print(json.dumps(answer, ensure_ascii=False)[:900], flush=True)

        findings, counts = fuzz(given.count, given.seed, tell)
        print(
            f"{given.count} cases in {perf_counter() - start:.0f} s: "
            + ", ".join(f"{n} {what}" for what, n in counts.most_common())
        )
        sys.exit(bool(findings))


if __name__ == "__main__":
    main()
