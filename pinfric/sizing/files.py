"""Files of a sizing for the commands that follow: the scene with its drives, and a motors file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pinfric.model.files import Writer
from pinfric.model.scene_text import robot_with_bodies, scene_content
from pinfric.model.yamlfile import yaml_text
from pinfric.sizing.size import SizingReport

_SCENE, _ROBOT, _MOTORS = "sized.scene.yaml", "sized.urdf", "motors.yaml"


def sized_files(report: SizingReport, folder: Path) -> dict[str, Writer]:
    """Return name -> what writes that file; none where a joint of the scene has no drive that fits.

    The scene has the gears, rotors and brakes of the chosen drives, its robot their masses; the
    motors file names them for `retime`.

    Args:
        report: of `size`.
        folder: where they will stand; files are named relative to it.
    """
    catalog, robot = report.catalog, report.given.robot
    drives = {
        j.name: {"drive": j.choice.candidate.name} for j in report.joints if j.choice is not None
    }
    if catalog is None or len(drives) < len(report.joints):
        return {}
    by = f"# Drives chosen by `pinfric size`: {report.verdict.headline}.\n"
    bundled = catalog.source == "default"
    motors = {
        "pinfric_motors": 1,
        "catalog": "default" if bundled else str(Path(catalog.source).resolve()),
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

    def writer(text: str) -> Callable[[Path], object]:
        return lambda path: path.write_text(text, encoding="utf-8")

    return {name: writer(text) for name, text in texts.items()}
