"""Machines sized with the bundled catalogue: what is chosen, and what cannot be signed.

    python tools/machines.py

prints the table of the evidence page: every machine under the default conditions.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pinfric as pf
from pinfric.new_scene import write_new

#: Scenes; xarm7 is not among the bundled ones, see `xarm7`.
MACHINES = (
    *("ur10_machine_tending", "ur5_pick_and_place", "panda_pick_and_place", "xarm7"),
    *("scara", "delta", "gantry", "excavator"),
)


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
    """UFACTORY's xArm7 of example-robot-data as `pinfric new` writes it: its friction is guessed.

    It carries 3 kg, invented, from one side to the other; of its gears the URDF says 1:100.
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


def limit_of(scene: pf.Scene, joint: str) -> float | None:
    """The effort that the URDF gives a joint, or None."""
    if not scene.model.existJointName(joint):
        return None
    number = scene.model.getJointId(joint)
    limit = float(scene.model.upperEffortLimit[scene.model.idx_vs[number]])
    return limit if 0 < limit < 1e4 else None


def main() -> None:
    """Print the table of the evidence page, all machines or those named; then seconds."""
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


if __name__ == "__main__":
    main()
