"""Files of a sizing for the commands that follow: the scene with its drives, and a motors file."""

from __future__ import annotations

import datetime
import warnings
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from pinfric import __version__
from pinfric.drives.installed import sized_for
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.errors import PinfricWarning, SizingError
from pinfric.model.robot import locator
from pinfric.model.scene import Scene
from pinfric.model.scene_file import load_scene
from pinfric.model.scene_text import robot_with_bodies, scene_content
from pinfric.model.schema import Assumed
from pinfric.model.yamlfile import yaml_text
from pinfric.sizing.verdict import JointState, JointVerdict

if TYPE_CHECKING:  # a command asks for the names before it imports what takes time
    from pinfric.sizing.report import SizingReport

#: What `size --out` writes where drives are chosen: parts, scene, robot, limits of the motors.
CHOSEN = "bom.csv", "sized.scene.yaml", "sized.urdf", "motors.yaml"
_, _SCENE, _ROBOT, _MOTORS = CHOSEN
#: What is judged of files that are read back, and by which part of the largest it may be off.
_JUDGED = {
    "effort_lower": "efforts",
    "effort_upper": "efforts",
    "motor_torque_lower": "motor torques",
    "motor_torque_upper": "motor torques",
}
_READ_BACK = 1e-5


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
        own = rating.rated.given.payloads
        scene = replace(scene, payloads={name: scene.payloads[name] for name in own})
    old, new = report.given.model.inertias, scene.model.inertias
    heavier = any(not a.isApprox(b, 0.0) for a, b in zip(old, new, strict=True))
    scene = replace(scene, sized=sized_for(scene), assumed=_guesses(report, scene))
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


def _guesses(report: SizingReport, scene: Scene) -> Assumed | None:
    """The guesses of a scene, with the inertias of its payloads that `size` guessed."""
    places = {f"robot.payloads.{name}.inertia" for name in scene.payloads}
    guessed = {place: why for place, why in report.bodies.items() if place in places}
    if not guessed:
        return scene.assumed
    today = datetime.date.today().isoformat()
    own = scene.assumed or Assumed(by="pinfric size", date=today, version=__version__, values={})
    return own.model_copy(update={"values": {**own.values, **guessed}})


def judge_files(report: SizingReport) -> None:
    """Read the files of a sizing back, and judge that their machine does what was sized.

    Raises:
        SizingError: an effort or a motor's torque is another.
    """
    rating, states = report.rating, report.result.states
    part = rating.own if rating is not None and rating.cycles else slice(None)
    t, q, v, a = (x[part] for x in (report.result.times, states.q, states.v, states.a))
    with TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)  # said of the scene that was given
        folder = Path(name)
        for file, text in sized_files(report, folder).items():
            (folder / file).write_text(text, encoding="utf-8")
        if not (folder / _SCENE).exists():
            return
        scene = load_scene(folder / _SCENE)
        carried = states.attached
        if carried is not None:
            names = list(report.scene.payloads)
            carried = carried[part][:, [names.index(payload) for payload in scene.payloads]]
        read = inverse_dynamics(scene, q, v, a, t=t, attached=carried)
    for key, what in _JUDGED.items():
        mine, theirs = (getattr(x, key)[: len(t) - 1] for x in (read, report.result))
        largest = np.abs(theirs).max(axis=0)
        off = np.abs(mine - theirs).max(axis=0) > _READ_BACK * np.maximum(largest, 1e-2)
        for i in np.flatnonzero(off):
            raise SizingError(
                f"{_SCENE}: read back, it has {what} up to {np.abs(mine[:, i]).max():.6g} at "
                f"{report.joints[i].name}, where {largest[i]:.6g} was judged: nothing is written; "
                "this is a defect of pinfric, please report it with the scene"
            )


def _mark(joint: JointVerdict) -> str:
    why = f": {joint.why}" if joint.why else ""
    return f"NOT SIGNED, {joint.state}{why}"
