"""Files of a sizing for the commands that follow: the scene with its drives, and a motors file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pinfric.drives.installed import sized_for
from pinfric.model.robot import locator
from pinfric.model.scene_text import robot_with_bodies, scene_content
from pinfric.model.yamlfile import yaml_text
from pinfric.sizing.verdict import JointState, JointVerdict

if TYPE_CHECKING:  # a command asks for the names before it imports what takes time
    from pinfric.sizing.report import SizingReport

#: What `size --out` writes where drives are chosen: parts, scene, robot, limits of the motors.
CHOSEN = "bom.csv", "sized.scene.yaml", "sized.urdf", "motors.yaml"
_, _SCENE, _ROBOT, _MOTORS = CHOSEN


def sized_files(report: SizingReport, folder: Path) -> dict[str, str]:
    """Return name -> text of the files; none where a joint has no drive that fits.

    The scene has gears, rotors and brakes of the chosen drives, its robot their masses; the motors
    file has their limits for `retime`. What fails is marked in both. A rated payload beside a cycle
    is no payload of the scene: nothing says when it is carried.

    Args:
        folder: where they will stand; files are named relative to it.
    """
    catalog, robot = report.catalog, report.given.robot
    drives = {j.name: {"drive": j.choice.name} for j in report.joints if j.choice is not None}
    if catalog is None or robot is None or len(drives) < len(report.joints):
        return {}
    by = f"# Drives chosen by `pinfric size`: {report.verdict.headline}.\n"
    wrong = [joint for joint in report.verdict.joints if joint.state != JointState.SIGNED]
    bundled = catalog.source == "default"
    asked, there = (x.model_dump(mode="json") for x in (report.conditions, catalog.conditions))
    motors = {
        "pinfric_motors": 1,
        "robot": report.scene.model.name,
        "catalog": "default" if bundled else locator(Path(catalog.source), folder),
        "conditions": {key: value for key, value in asked.items() if value != there[key]},
        "drives": drives,
    }
    scene, rating = report.scene, report.rating
    if rating is not None and rating.cycles:
        scene = replace(scene, payloads=rating.rated.given.payloads)
    old, new = report.given.model.inertias, scene.model.inertias
    heavier = any(not a.isApprox(b, 0.0) for a, b in zip(old, new, strict=True))
    scene = replace(scene, sized=sized_for(scene))
    content = scene_content(scene, robot, folder, _ROBOT if heavier else "")
    actuators = [a.drive_name for a in scene.actuators or ()]
    limits = {key: value for key, value in motors.items() if value}
    texts = {
        _MOTORS: by + yaml_text(limits, {("drives", j.name): _mark(j) for j in wrong}),
        _SCENE: by
        + yaml_text(
            content,
            {("actuators", str(actuators.index(j.name)), "joint"): _mark(j) for j in wrong},
        ),
    }
    if heavier:
        texts[_ROBOT] = robot_with_bodies(robot, scene.model)
    return texts


def _mark(joint: JointVerdict) -> str:
    why = f": {joint.why}" if joint.why else ""
    return f"NOT SIGNED, {joint.state}{why}"
