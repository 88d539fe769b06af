"""Files of an identification: scene with intervals, robot, posterior."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pinfric.errors import IdentificationError
from pinfric.identification.advice import advice_text
from pinfric.identification.findings import Findings
from pinfric.identification.laws import PLAIN
from pinfric.identification.parameters import Parameter, on_motor
from pinfric.identification.standing import on_base
from pinfric.model.robot import Robot
from pinfric.model.scene_text import robot_with_bodies, scene_content
from pinfric.model.yamlfile import yaml_text

#: Columns of the posterior that a sweep sets as they are; all others are factors on the scene's.
_ABSOLUTE = ("efficiency", "back_efficiency")
_SAMPLES = 200
_ROBOT = "robot.urdf"


def identified_files(findings: Findings, folder: Path) -> dict[str, str]:
    """Return file name -> text: scene, robot (if corrected), posterior, sweep, advice.

    Raises:
        IdentificationError: the scene has no URDF that a file could name.
    """
    robot = findings.scene.robot
    if robot is None:
        raise IdentificationError(
            f"{findings.scene.source}: was made in Python and has no URDF; a "
            "scene file needs one (`found.scene` is complete)"
        )
    texts = {
        "scene.yaml": scene_text(findings, robot, folder),
        "posterior.csv": posterior_text(findings),
        "sweep.yaml": _SWEEP,
    }
    if findings.advice:
        texts["advice.waypoints.yaml"] = advice_text(findings.advice[0], findings.scene)
    if not findings.keeps_inertias:
        texts[_ROBOT] = robot_with_bodies(robot, findings.scene.model)
    return texts


_SWEEP = f"""# The uncertainty that the logs leave: each sample is a row of posterior.csv.
#
#   pinfric sweep scene.yaml TRAJECTORY sweep.yaml
pinfric_sweep: 1
samples: {_SAMPLES}
seed: 1
table: posterior.csv
"""


def posterior_text(findings: Findings) -> str:
    """Return the draws as a sweep's table: factors on the scene's values, but efficiencies."""
    values = {p.key: p.value for p in findings.parameters}
    for key in findings.posterior:  # one way only was logged, and its friction taken for the other
        head, _, direction = key.rpartition(".")
        if key not in values:
            values[key] = values[f"{head}.{'negative' if direction == 'positive' else 'positive'}"]
    columns = {
        key: draws if key.rpartition(".")[2] in _ABSOLUTE else draws / values[key]
        for key, draws in findings.posterior.items()
    }
    lines = [",".join(columns)]
    rows = np.column_stack(list(columns.values())) if columns else np.zeros((0, 0))
    return "\n".join([*lines, *(",".join(f"{x:.6g}" for x in row) for row in rows)]) + "\n"


def scene_text(findings: Findings, robot: Robot, folder: Path) -> str:
    """Return the identified scene as a commented file in `folder`."""
    scene, floating = findings.scene, findings.estimate.question.floating
    if floating is not None:
        scene = on_base(scene, floating)
    scene = replace(scene, sized=None)  # its masses are the logs' now
    content = scene_content(scene, robot, folder, "" if findings.keeps_inertias else _ROBOT)
    logs, at = ", ".join(log.name for log in findings.recordings), findings.estimate.question.at
    lines = [
        f"# Friction identified from {logs} by `pinfric identify`.",
        "# Beside each value: its 95 % interval, computed from blocks of the logs. Values marked",
        "# `not determined` fit best, but these logs do not determine them.",
        "# static: the break-away effort if it was logged; else the kinetic value, or, if the",
        "# law is steep at rest, friction at the slowest logged sliding.",
        "#",
        f"#   pinfric inverse scene.yaml LOG --effort-at {at}      # measured beside computed",
        "#   pinfric sweep scene.yaml TRAJECTORY sweep.yaml    # with what is uncertain",
        "#",
        *(f"#   {line}" for line in findings.notes),
    ]
    return "\n".join([*lines, yaml_text(content, _comments(findings))])


def _comments(findings: Findings) -> dict[tuple[str, ...], str]:
    comments = {}
    order = [
        name for name in findings.scene.joint_names if name not in findings.estimate.question.base
    ]
    products = {p.joint: p for p in findings.parameters if p.name == "efficiency_product"}
    for parameter in findings.parameters:
        where: tuple[str, ...] = ("friction", parameter.joint)
        if parameter.section == "transmission":
            where = ("actuators", str(order.index(parameter.joint)), "transmission")
        where += tuple(parameter.name.split("."))
        comments[where] = _interval(parameter)
        if parameter.name == "efficiency" and (product := products.get(parameter.joint)):
            comments[where] += f"; of both directions {product.value:.4g}, {_interval(product)}"
    comments |= {
        ("friction", name): "not explained by the logs: value of the scene"
        for name in findings.errors.keys() - findings.laws.keys()
    }
    for name, law in findings.laws.items():
        error = findings.errors[name]
        where = ("actuators", str(order.index(name))) if on_motor(law) else ("friction", name)
        comments[where] = (
            f"{law}: held-out error {100 * error.moving_share:.1f} % moving, "
            f"{100 * error.share:.1f} % in fitted rows "
            f"({error.of_plain:.2f} of that with {PLAIN})"
        )
    return comments


def _interval(parameter: Parameter) -> str:
    if np.isnan(parameter.high):
        return f"not determined: {parameter.why}"
    text = f"{parameter.low:.3g} to {parameter.high:.3g} {parameter.unit}".rstrip()
    return text if parameter.determined else f"not determined: {parameter.why} ({text})"
