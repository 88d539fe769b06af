"""Machines sized with the bundled catalogue: what is chosen, and what cannot be signed.

    python tools/machines.py

prints, under the default conditions, what the evidence page summarizes: every machine by its cycle,
and published arms by their ratings.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pinfric as pf
from pinfric.model.robot import read_robot, urdf_file
from pinfric.new_scene import write_new

#: Scenes; xarm7 is not among the bundled ones, see `xarm7`.
MACHINES = (
    *("ur10_machine_tending", "ur5_pick_and_place", "panda_pick_and_place", "xarm7"),
    *("scara", "delta", "gantry", "excavator"),
)

#: Name -> URDF of example-robot-data, what its maker prints (kg; the Panda's 3 kg less its hand),
#: link, top speeds where the URDF's are another robot's (rad/s).
RATED = {
    "ur10": ("ur_description/urdf/ur10_robot.urdf", 10.0, "tool0", [2.09] * 2 + [3.14] * 4),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", 5.0, "tool0", [3.14] * 6),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", 3.0, "tool0", [3.14] * 3 + [6.28] * 3),
    "panda": ("panda_description/urdf/panda.urdf", 2.27, "panda_link8", []),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", 3.5, "link_eef", []),
}


class Row(NamedTuple):
    """One axis: its demand, what the robot's own joint gives (its URDF), and what is chosen.

    Attributes:
        machine, axis: by name. peak: of the demand, in `unit`; limit: of the URDF, or None.
        choice: names; bears: the gear's repeated peak (a gearmotor's peak), or None.
        mass: kg. tightest: row of the least margin, and the margin. asked: products that cannot be
            signed; why: nothing fits.
    """

    machine: str
    axis: str
    unit: str
    peak: float
    limit: float | None
    choice: str | None
    bears: float | None
    mass: float | None
    tightest: str
    asked: tuple[str, ...]
    why: str


def rows(name: str, **conditions: object) -> Iterator[Row]:
    """Yield the axes of one machine."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where nothing fits, the row says it
        scene, motion = xarm7() if name == "xarm7" else bundled(name)
        report = pf.size(scene, motion, "default", conditions=conditions or None)
    for i, joint in enumerate(report.joints):
        taken, bears, tightest = joint.choice, None, ""
        choice = taken and taken.candidate
        if taken is not None and choice is not None:
            gear = choice.gear
            bears = choice.ratings.peak_torque if gear is None else gear.repeated_peak_torque
            scaled = [c for c in taken.criteria if c.margin is not None and c.scaled]
            least = min(scaled, key=lambda c: c.margin)
            tightest = f"{least.name} {100 * least.margin:.0f} %"
        yield Row(
            name,
            joint.name,
            joint.demand.unit,
            joint.demand.peak,
            limit_of(scene, scene.drives[i].name),
            None if choice is None else choice.name,
            bears,
            None if choice is None else choice.mass,
            tightest,
            tuple(ask.name for ask in joint.ask),
            joint.no_fit,
        )


def bundled(name: str) -> tuple[pf.Scene, pf.Trajectory]:
    """A scene of the package and its cycle."""
    scene = pf.load_scene(name)
    return scene, pf.load_trajectory(name, scene)


def xarm7() -> tuple[pf.Scene, pf.Trajectory]:
    """UFACTORY's xArm7 of example-robot-data as `pinfric new` writes it, with guessed friction.

    It carries 3 kg, invented, from one side to the other; the URDF gives only 1:100 of its gears.
    """
    ready, above_a = [0, 0, 0, 0.8, 0, 0.8, 0], [-0.8, 0.25, 0, 0.9, 0, 0.65, 0]
    above_b = [0.8, 0.2, 0, 0.9, 0, 0.7, 0]
    down_a, down_b = [-0.8, 0.45, 0, 1.2, 0, 0.75, 0], [0.8, 0.4, 0, 1.2, 0, 0.8, 0]
    points = [
        {"q": ready, "hold": 0.2},
        {"q": above_a, "duration": 1.0},
        {"q": down_a, "duration": 0.6, "hold": 0.4, "attach": "box"},
        {"q": above_a, "duration": 0.6},
        {"q": above_b, "duration": 1.4},
        {"q": down_b, "duration": 0.6, "hold": 0.4, "detach": "box"},
        {"q": above_b, "duration": 0.6},
        {"q": ready, "duration": 1.0, "hold": 0.2},
    ]
    cycle = {"pinfric_trajectory": 1, "profile": "quintic", "sample_rate": 250, "points": points}
    cycle["joints"] = [f"joint{k}" for k in range(1, 8)]
    box = {"link": "link_eef", "mass": 3.0, "com": [0.0, 0.0, 0.05], "attached": False}
    with tempfile.TemporaryDirectory() as folder:
        write_new("example-robot-data:xarm_description/urdf/xarm7.urdf", folder)
        file = Path(folder, "cycle.yaml")
        file.write_text(json.dumps(cycle))
        scene = pf.load_scene(Path(folder, "xarm7.yaml"))
        scene = scene.with_(payloads={"box": box}, masses="with_drives")
        return scene, pf.load_trajectory(file, scene)


def rated(name: str) -> tuple[pf.Scene, dict[str, object]]:
    """A published arm whose links hold its drives, without friction, and the keys of its rating."""
    urdf, payload, link, speeds = RATED[name]
    file = urdf_file(f"example-robot-data:{urdf}")
    robot = read_robot(file, {})
    scene = pf.Scene(robot.model, robot=robot, masses="with_drives", source=str(file))
    named = dict(zip(scene.joint_names, speeds, strict=False))
    return scene, {"payload": payload, "link": link, "speed": named}


def limit_of(scene: pf.Scene, joint: str) -> float | None:
    """The effort that the URDF gives a joint, or None."""
    if not scene.model.existJointName(joint):
        return None
    number = scene.model.getJointId(joint)
    limit = float(scene.model.upperEffortLimit[scene.model.idx_vs[number]])
    return limit if 0 < limit < 1e4 else None


def main() -> None:
    """Print a row for each axis of all machines, or of the named ones; then seconds."""
    print("| machine | axis | peak | its own joint gives | drive chosen | bears | kg | tightest |")
    print("|---|---|---|---|---|---|---|---|")
    seconds = {}
    for name in sys.argv[1:] or MACHINES:
        started = time.process_time()
        for row in rows(name):
            own, bears = (f"{x:.3g}" if x else "" for x in (row.limit, row.bears))
            mass = f"{row.mass:.2f}" if row.mass else ""
            drive = row.choice or row.why.partition(": ")[2].partition(";")[0].partition(": ")[0]
            peak = f"{row.peak:.3g} {row.unit}"
            print(f"| {name} | {row.axis} | {peak} | {own} | {drive} | {bears} | {mass} | ", end="")
            print(f"{row.tightest} |")
        seconds[name] = time.process_time() - started
    print({name: round(spent, 2) for name, spent in seconds.items()})
    if sys.argv[1:]:
        return
    print("| rated arm | held, N m | gears (size of CSG), kg | s |\n|---|---|---|---|")
    for name in RATED:
        scene, keys = rated(name)
        started = time.process_time()
        report = pf.size(scene, catalog="default", rating=keys, on_miss="ignore")
        spent = time.process_time() - started
        held = " ".join(f"{round(lift.held, 2):.3g}" for lift in report.rating.rated.lifts)
        sizes = [
            re.search(r"CS.-(\d+)", j.choice.candidate.name) for j in report.joints if j.choice
        ]
        gears = " ".join(size[1] for size in sizes if size)
        print(f"| {name} | {held} | {gears}, {report.verdict.mass:.3g} kg | {spent:.2f} |")


if __name__ == "__main__":
    main()
