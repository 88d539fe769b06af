"""Machines sized with the bundled catalogue: what is chosen, what cannot be judged.

    python tests/machines.py

prints the table of the evidence page. Arms are asked for at most 1 arcmin of backlash, as their
makers' gears have it, and light arms for 4 Hz: the rule of 8 and 15 Hz is for stiffer robots.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import pinfric as pf

ARCMIN = np.pi / 10800
LIGHT = {"backlash": ARCMIN, "resonance_base": 4.0, "resonance_hand": 4.0}
#: Scene, conditions.
MACHINES = {
    "ur10_machine_tending": LIGHT,
    "ur5_pick_and_place": LIGHT,
    "panda_pick_and_place": LIGHT,
    "scara": {"backlash": ARCMIN},
    "delta": {},
    "gantry": {},
    "excavator": {},
}


class Row(NamedTuple):
    """One axis: its demand, what the robot's own joint gives (its URDF), and what is chosen.

    Attributes:
        machine, axis: by name. peak: of the demand, in `unit`; limit: of the URDF, or None.
        choice: names; bears: the gear's repeated peak (a gearmotor's peak), or None.
        mass: kg. unjudged: names of gears and gearmotors that lack a figure; why: what is missing.
    """

    machine: str
    axis: str
    unit: str
    peak: float
    limit: float | None
    choice: str | None
    bears: float | None
    mass: float | None
    unjudged: tuple[str, ...]
    why: str


def rows(name: str) -> Iterator[Row]:
    """Yield the axes of one machine."""
    scene = pf.load_scene(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # where nothing fits, the row says it
        report = pf.size(
            scene, pf.load_trajectory(name, scene), "default", conditions=MACHINES[name]
        )
    for i, joint in enumerate(report.joints):
        limit = limit_of(scene, scene.drives[i].name)
        choice = joint.choice and joint.choice.candidate
        bears = None
        if choice is not None:
            gear = choice.gear
            bears = choice.ratings.peak_torque if gear is None else gear.repeated_peak_torque
        open_ = [a for a in joint.assessments if a.missing_figures and not a.failed]
        named = dict.fromkeys(a.candidate.gear_name or a.candidate.name for a in open_)
        yield Row(
            name,
            joint.name,
            joint.demand.unit,
            joint.demand.peak,
            limit,
            None if choice is None else choice.name,
            bears,
            None if choice is None else choice.mass,
            tuple(named),
            joint.no_fit,
        )


def limit_of(scene: pf.Scene, joint: str) -> float | None:
    """The effort that the URDF gives a joint, or None."""
    if not scene.model.existJointName(joint):
        return None
    number = scene.model.getJointId(joint)
    limit = float(scene.model.upperEffortLimit[scene.model.idx_vs[number]])
    return limit if 0 < limit < 1e4 else None


def main() -> None:
    """Print the table of the evidence page, all machines or those named."""
    print(
        "| machine | axis | peak | its own joint gives | drive chosen | bears | kg | not judged |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or MACHINES:
        for row in rows(name):
            own, bears = (f"{x:.3g}" if x else "" for x in (row.limit, row.bears))
            mass = f"{row.mass:.2f}" if row.mass else ""
            drive = row.choice or row.why.partition(": ")[2].partition(";")[0].partition(": ")[0]
            peak = f"{row.peak:.3g} {row.unit}"
            cells = (name, row.axis, peak, own, drive, bears, mass, str(len(row.unjudged)))
            print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
