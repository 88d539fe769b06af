"""Files of a sizing for the commands that follow: the scene with its drives, and a motors file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pinfric.model.robot import locator
from pinfric.model.scene_text import robot_with_bodies, scene_content
from pinfric.model.yamlfile import yaml_text

if TYPE_CHECKING:  # a command asks for the names before it imports what takes time
    from pinfric.sizing.report import SizingReport

#: What `size --out` writes where drives are chosen: parts, scene, robot, limits of the motors.
CHOSEN = "bom.csv", "sized.scene.yaml", "sized.urdf", "motors.yaml"
_, _SCENE, _ROBOT, _MOTORS = CHOSEN


def sized_files(report: SizingReport, folder: Path) -> dict[str, str]:
    """Return name -> text of the files; none where a joint has no drive that fits.

    The scene has gears, rotors and brakes of the chosen drives, its robot their masses; the motors
    file names them for `retime`.

    Args:
        folder: where they will stand; files are named relative to it.
    """
    catalog, robot = report.catalog, report.given.robot
    drives = {j.name: {"drive": j.choice.name} for j in report.joints if j.choice is not None}
    if catalog is None or len(drives) < len(report.joints):
        return {}
    by = f"# Drives chosen by `pinfric size`: {report.verdict.headline}.\n"
    bundled = catalog.source == "default"
    motors = {
        "pinfric_motors": 1,
        "catalog": "default" if bundled else locator(Path(catalog.source), folder),
        "conditions": report.conditions.model_dump(mode="json", exclude_defaults=True),
        "drives": drives,
    }
    texts = {_MOTORS: by + yaml_text({key: value for key, value in motors.items() if value})}
    if robot is not None:  # a scene file names a URDF
        heavier = any(
            not old.isApprox(new, 0.0)
            for old, new in zip(
                report.given.model.inertias, report.scene.model.inertias, strict=True
            )
        )
        content = scene_content(report.scene, robot, folder, _ROBOT if heavier else "")
        texts[_SCENE] = by + yaml_text(content)
        if heavier:
            texts[_ROBOT] = robot_with_bodies(robot, report.scene.model)
    return texts
