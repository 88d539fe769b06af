"""The friction of actuator models that trainers run, M1 to M6 of BAM, in NumPy or JAX.

Friction of a joint is a budget: what stops it, but at most frictionloss + damping |v| against the
motion. The budget follows the motor's torque, the external one, and the speed:

    F = friction_base + L + s (friction_stribeck + L_s + Q)
    s = exp(-|v / dtheta_stribeck|^alpha)
    L = load_friction_base |external - motor|                                              M3, M4
    L = |load_friction_external external - load_friction_motor motor|                      M5, M6
    Q = load_friction_external_quad external^2  where |external| < |motor|,                M6
        load_friction_motor_quad motor^2  where |external| > |motor|, both where their signs differ

L_s is L with the coefficients that end in _stribeck; M1 and M2 have no L.

Source: Duclusaud, Passault, Padois, Ly, Extended Friction Models for the Physics Simulation of
Servo Actuators, ICRA 2025; the keys are those of their files.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import PinfricError
from pinfric.exporting.cpp import body_rows
from pinfric.exporting.tree import check_plain_tree
from pinfric.model.scene import Scene, expect_scene

#: Keys of each model, the simplest first.
MODELS: dict[str, tuple[str, ...]] = {"m1": ("friction_base", "friction_viscous")}
_STRIBECK = ("friction_stribeck", "dtheta_stribeck", "alpha")
_DIRECTED = ("load_friction_motor", "load_friction_external")
MODELS["m2"] = (*MODELS["m1"], *_STRIBECK)
MODELS["m3"] = (*MODELS["m1"], "load_friction_base")
MODELS["m4"] = (*MODELS["m2"], "load_friction_base", "load_friction_stribeck")
MODELS["m5"] = (*MODELS["m2"], *_DIRECTED, *(f"{key}_stribeck" for key in _DIRECTED))
MODELS["m6"] = (*MODELS["m5"], *(f"{key}_quad" for key in _DIRECTED))

#: (q, v, motor torque) -> frictionloss and damping of each joint.
Law = Callable[..., tuple[Any, Any]]


def friction_budget(
    parameters: Mapping[str, float], v: Any, motor: Any, external: Any, numpy: Any = np
) -> tuple[Any, Any]:
    """Return frictionloss F and damping of one joint, of which at most F + damping |v| acts.

    Args:
        parameters: of one model of `MODELS`, by its keys; those that are missing are 0.
        v: velocities (rad/s or m/s), of any shape. motor: torques at the joint (N m or N).
        external: those of gravity, motion and contacts, along the joint (N m or N).
        numpy: or jax.numpy, torch: any that has abs, exp, sign and where.
    """
    xp, of = numpy, lambda key: parameters.get(key, 0.0)
    budget = of("friction_base") + 0.0 * v
    share = xp.exp(-(xp.abs(v / of("dtheta_stribeck")) ** of("alpha"))) if of("alpha") else 0.0
    if "load_friction_motor" in parameters:
        load, fading = (
            xp.abs(
                of(f"load_friction_external{end}") * external
                - of(f"load_friction_motor{end}") * motor
            )
            for end in ("", "_stribeck")
        )
        ours, theirs = xp.abs(motor), xp.abs(external)
        quad = xp.where(
            theirs < ours,
            of("load_friction_external_quad") * theirs**2,
            xp.where(theirs > ours, of("load_friction_motor_quad") * ours**2, 0.0),
        )
        fading = fading + xp.where(xp.sign(external) != xp.sign(motor), quad, 0.0)
    else:
        load = of("load_friction_base") * xp.abs(external - motor)
        fading = of("load_friction_stribeck") * xp.abs(external - motor)
    budget = budget + load + share * (of("friction_stribeck") + fading)
    return budget, of("friction_viscous") + 0.0 * v


def actuator_law(scene: Scene, file: Any, numpy: Any = np) -> Law:
    """Return what `export --to actuator` wrote as a pure function of q, v and the motors' torques.

        frictionloss, damping = law(q, v, motor)         (nv,) each, N m and N m s/rad or N, N s/m

    The external torque is -h(q, v): gravity, Coriolis and centrifugal forces of the scene. With
    `external=` (nv,) contacts are added. With jax.numpy the function may be compiled, mapped over
    environments and differentiated.

    Args:
        scene: that of the file.
        file: path of the file, or what `export` returned.
        numpy: or jax.numpy.

    Raises:
        PinfricError: a file that cannot be read or is of another robot.
    """
    expect_scene(scene, "actuator_law")
    rows = read_actuators(file)
    index = {column.name: column.index_v for column in check_plain_tree(scene)}
    if [*rows] != [*index]:
        raise PinfricError(
            f"{scene.source}: has the joints {', '.join(index)}; the actuators are of "
            f"{', '.join(rows)}: export this scene"
        )
    taken = {index[name]: row["models"][row["take"]] for name, row in rows.items()}
    bodies = [fields for _, fields in body_rows(scene)]
    gravity = scene.model.gravity.linear.copy()

    def law(q: Any, v: Any, motor: Any, external: Any = None) -> tuple[Any, Any]:
        pull = -bias(bodies, gravity, q, v, numpy)
        pull = pull if external is None else pull + external
        found = [
            friction_budget(taken[i], v[i], motor[i], pull[i], numpy) for i in range(len(taken))
        ]
        return numpy.stack([x[0] for x in found]), numpy.stack([x[1] for x in found])

    return law


def read_actuators(file: Any) -> dict[str, dict[str, Any]]:
    """Return what a file of `export --to actuator` holds: joint -> its row.

    Args:
        file: its path, or what `export` returned.

    Raises:
        PinfricError: no such file, or one of another kind.
    """
    text = getattr(file, "text", None)
    try:
        content = json.loads(Path(file).read_text(encoding="utf-8") if text is None else text)
        rows = {row["joint"]: row for row in content["joints"]}
        complete = all(row["take"] in row["models"] for row in rows.values())
    except OSError as problem:
        raise PinfricError(f"{file}: cannot be read: {problem.strerror}") from None
    except (ValueError, KeyError, TypeError):
        content, complete = {}, False
    if not complete or content.get("pinfric_actuator") != 1:
        raise PinfricError(f"{file}: is no file of `pinfric export --to actuator`")
    return rows


def bias(bodies: list[list[Any]], gravity: np.ndarray, q: Any, v: Any, numpy: Any = np) -> Any:
    """Return h(q, v) (nv,): what gravity and motion without acceleration take (N m or N).

    Newton and Euler, outwards and inwards, without assignments, as JAX needs it.

    Args:
        bodies: `body_rows`. gravity: (3,) m/s^2. q, v: (nv,) one number per degree of freedom.
    """
    xp = numpy
    motions: list[tuple[Any, ...]] = []
    wrenches: list[tuple[Any, Any]] = []
    z = np.array([0.0, 0.0, 1.0])
    for parent, turns, freedom, ratio, shift, rotation, place, _, mass, com, inertia in bodies:
        w, dw, a = motions[parent][:3] if parent >= 0 else (np.zeros(3), np.zeros(3), -gravity)
        at, rate = ratio * q[freedom] + shift, ratio * v[freedom]
        R, p = rotation, place
        if turns:
            s, c, one, no = xp.sin(at), xp.cos(at), 1.0 + 0.0 * at, 0.0 * at
            turn = xp.stack([xp.stack([c, -s, no]), xp.stack([s, c, no]), xp.stack([no, no, one])])
            R = rotation @ turn
        else:
            p = place + at * rotation[:, 2]
        a = R.T @ (a + xp.cross(dw, p) + xp.cross(w, xp.cross(w, p)))
        w, dw = R.T @ w, R.T @ dw
        if turns:
            dw, w = dw + xp.cross(w, rate * z), w + rate * z
        else:
            a = a + 2.0 * xp.cross(w, rate * z)
        xx, xy, xz, yy, yz, zz = inertia
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        force = mass * (a + xp.cross(dw, com) + xp.cross(w, xp.cross(w, com)))
        moment = moments @ dw + xp.cross(w, moments @ w) + xp.cross(com, force)
        motions.append((w, dw, a, R, p))
        wrenches.append((force, moment))
    efforts = [0.0 * q[i] for i in range(len(q))]
    for b in range(len(bodies) - 1, -1, -1):
        parent, turns, freedom, ratio = bodies[b][:4]
        force, moment = wrenches[b]
        efforts[freedom] = efforts[freedom] + ratio * (moment if turns else force)[2]
        if parent >= 0:
            R, p = motions[b][3:]
            on, about = R @ force, R @ moment
            before = wrenches[parent]
            wrenches[parent] = (before[0] + on, before[1] + about + xp.cross(p, on))
    return xp.stack(efforts)
