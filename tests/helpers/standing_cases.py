"""A biped that squats: its URDF, scene, motion, and forces at its feet that balance it."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

import pinfric as pf
from pinfric.model.floating import POSE, base_configuration, base_motion

FEET = ("left_foot", "right_foot")
LEGS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle"))
#: m: of thigh and shank; of the hips, beside the base's origin.
LINK, WIDTH = 0.4, 0.1


def _link(name, mass, com, moments):
    xyz, (x, y, z) = " ".join(map(str, com)), moments
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}"/><mass value="{mass}"/>'
        f'<inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/></inertial></link>'
    )


def _joint(name, parent, child, xyz, limits):
    lower, upper, effort, velocity = limits
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{" ".join(map(str, xyz))}"/><axis xyz="0 1 0"/><limit lower="{lower}" '
        f'upper="{upper}" effort="{effort}" velocity="{velocity}"/></joint>'
    )


def biped(folder: Path, friction="coulomb: 2.0", more="") -> Path:
    """Write biped.urdf, 33 kg that hang, and biped.yaml, whose base floats; return the scene."""
    parts = [_link("pelvis", 20, (0, 0, 0.1), (0.3, 0.3, 0.2))]
    for side, y in (("left", WIDTH), ("right", -WIDTH)):
        thigh, shank, foot = (f"{side}_{part}" for part in ("thigh", "shank", "foot"))
        parts += [
            _joint(f"{side}_hip", "pelvis", thigh, (0, y, 0), (-1.5, 1.5, 200, 20)),
            _link(thigh, 4, (0, 0, -0.2), (0.06, 0.06, 0.01)),
            _joint(f"{side}_knee", thigh, shank, (0, 0, -LINK), (0, 2, 300, 14)),
            _link(shank, 2, (0, 0, -0.2), (0.03, 0.03, 0.005)),
            _joint(f"{side}_ankle", shank, foot, (0, 0, -LINK), (-0.9, 0.9, 40, 9)),
            _link(foot, 0.5, (0.03, 0, -0.03), (0.001, 0.002, 0.002)),
        ]
    (folder / "biped.urdf").write_text(f'<robot name="biped">{"".join(parts)}</robot>')
    laws = "".join(f"  {name}: {{{friction}}}\n" for name in LEGS) if friction else "  {}\n"
    file = folder / "biped.yaml"
    file.write_text(
        f"pinfric: 1\nrobot: {{urdf: biped.urdf, floating: true}}\nfriction:\n{laws}{more}"
    )
    return file


class Squat(NamedTuple):
    """A motion, its numbers by column, and the wrenches on the feet that balance it, (T, 6)."""

    motion: pf.Trajectory
    columns: dict[str, np.ndarray]
    forces: dict[str, np.ndarray]


def squat(scene, heading=0.7, count=401, seconds=4.0, times=2) -> Squat:
    """The knees bend from 0.6 to 1.4 rad and back; the feet stay flat where they are."""
    t = np.linspace(0.0, seconds, count)
    w = 2.0 * np.pi * times / seconds
    bend = [0.3 + 0.2 * (1 - np.cos(w * t)), 0.2 * w * np.sin(w * t), 0.2 * w**2 * np.cos(w * t)]
    b, db, ddb = bend
    z = [
        2 * LINK * np.cos(b),
        -2 * LINK * np.sin(b) * db,
        -2 * LINK * (np.cos(b) * db**2 + np.sin(b) * ddb),
    ]
    base = [np.zeros((count, 6)) for _ in range(3)]
    base[0][:, [0, 1, 5]] = 1.5, -0.4, heading
    for numbers, height in zip(base, z, strict=True):
        numbers[:, 2] = height
    legs = [np.outer(x, [-1.0, 2.0, -1.0] * 2) for x in bend]
    q = np.hstack([base_configuration(base[0]), legs[0]])
    (v, a) = (
        np.hstack([own, rates]) for own, rates in zip(base_motion(*base), legs[1:], strict=True)
    )
    forces = balancing(scene.model, q, v, a)
    motion = pf.Trajectory.from_arrays(scene, t, q, v, a, external=forces)
    names = [f"root_joint.{part}" for part in POSE]
    columns = dict(zip([*names, *LEGS], np.hstack([base[0], legs[0]]).T, strict=True))
    return Squat(motion, {"t": t} | columns, forces)


def jacobians(model, q, feet=FEET):
    """Return the feet's Jacobians in their own axes, (6 feet, nv)."""
    data = model.createData()
    return np.vstack(
        [pin.computeFrameJacobian(model, data, q, model.getFrameId(f), pin.LOCAL) for f in feet]
    )


def balancing(model, q, v, a, feet=FEET):
    """Return the least wrenches on the feet that the base's equations ask for, by Pinocchio."""
    data, rows = model.createData(), []
    for state in zip(q, v, a, strict=True):
        needed = pin.rnea(model, data, *state)[:6]
        rows.append(np.linalg.pinv(jacobians(model, state[0], feet)[:, :6].T) @ needed)
    return {f: np.array(rows)[:, 6 * i : 6 * i + 6] for i, f in enumerate(feet)}


def efforts(model, q, v, a, forces):
    """Return tau - J^T f (T, nv) by Pinocchio."""
    data, feet = model.createData(), list(forces)
    on = np.hstack([forces[f] for f in feet])
    return np.array(
        [
            pin.rnea(model, data, *state) - jacobians(model, state[0], feet).T @ on[i]
            for i, state in enumerate(zip(q, v, a, strict=True))
        ]
    )
