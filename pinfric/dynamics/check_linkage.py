"""The judge of scenes with loops, cylinders and forces: nothing of the solver's kernels.

Jacobians come from Pinocchio's joint Jacobians, wrenches from `data.f` of its RNEA with every
closure force, drive and friction torque as external forces, laws from plain NumPy (`plain_laws`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinfric.dynamics.outcome import Solution, Status
from pinfric.dynamics.plain_laws import plain_displacement, plain_friction, plain_normal_load
from pinfric.model.scene import Scene, Site

if TYPE_CHECKING:
    from pinfric.dynamics.result import InverseResult


@dataclass(frozen=True)
class Pair:
    """A wrench of side a on side b: where it acts and on whom, at one sample.

    Attributes:
        name: of the loop or the drive.
        a, b: joint ids of the two links, 0 for the ground.
        at: (3,) where it acts, world. frame: (3, 3) frame b. direction: (6,) unit wrench of a
            drive in the world's axes at `at`; of a loop along what moves, of a universal about
            the common normal of its axes.
        along_line: whether it is a cylinder, along whose line its friction acts, too.
    """

    name: str
    a: int
    b: int
    at: np.ndarray
    frame: np.ndarray
    direction: np.ndarray
    along_line: bool = False


def linkage_residuals(
    result: InverseResult, model: pin.Model, data: pin.Data, i: int
) -> tuple[np.ndarray, float]:
    """Return (equilibrium, friction law, wrench) residuals of one sample, and its largest effort.

    Args:
        result: of a scene with loops or drives off the joints.
        model, data: with the payloads of this sample.
        i: the sample.
    """
    if result.status[i] in (Status.JAMMED, Status.NOT_CONVERGED, Status.SINGULAR):
        return np.zeros(3), 0.0
    scene, states = result.scene, result.states
    pin.computeJointJacobians(model, data, states.q[i])
    pairs = _pairs(scene, model, data)
    worst = np.zeros(3)
    if (result.sticking[i] | result.reversal[i]).any() or result.status[i] == Status.AMBIGUOUS:
        ends = result.solutions(i)
        worst[0] = _ends(result, i, np.array([end.effort for end in ends]))
    else:
        ends = (_reported(result, model, data, pairs, i),)
        low, high = result.effort_lower[i], result.effort_upper[i]
        worst[0] = np.abs(low - high).max(initial=0.0)
        worst[1] = np.abs(result.friction_lower[i] - result.friction_upper[i]).max(initial=0.0)
    for end in ends:
        worst = np.maximum(worst, _residuals(result, model, data, pairs, i, end))
    worst[0] = max(worst[0], _frictionless(result, model, data, pairs, i))
    return worst, max((float(np.abs(end.effort).max(initial=0.0)) for end in ends), default=0.0)


def _reported(
    result: InverseResult, model: pin.Model, data: pin.Data, pairs: dict[str, Pair], i: int
) -> Solution:
    """The result's own figures of a sample where everything slides."""
    assert result.wrench is not None
    assert result.multipliers is not None
    parts = [np.zeros(0)]
    for site, size in zip(result.scene.sites, result.friction_lower[i], strict=True):
        velocity = _site_velocity(result, site, pairs, model, data, i)
        speed = float(np.linalg.norm(velocity))
        parts.append(size * velocity / speed if site.ball else np.array([size]))
    return Solution(result.effort_lower[i], result.friction_lower[i], np.concatenate(parts),
                    result.normal_load[i], result.wrench[i], result.multipliers[i])  # fmt: skip


def _site_velocity(
    result: InverseResult, site: Site, pairs: dict[str, Pair], model: pin.Model, data: pin.Data,
    i: int,
) -> np.ndarray:  # fmt: skip
    """(1,) relative velocity of a site, (3,) in frame b for a ball."""
    v = result.states.v[i]
    if site.pair < 0:
        return np.array([site.ratio * v[site.velocity_index]])
    pair = pairs[site.name]
    units = np.eye(3) if site.ball else np.ones((1, 1))
    wrenches = [_friction_in_world(pair, site, unit) for unit in units]
    return np.array([_generalized(model, data, pair, wrench) @ v for wrench in wrenches])


def _ends(result: InverseResult, i: int, efforts: np.ndarray) -> float:
    """How far the reported ends are from the least and greatest of the solutions."""
    if not efforts.size:  # of no drive
        return 0.0
    return max(
        float(np.abs(result.effort_lower[i] - efforts.min(axis=0)).max(initial=0.0)),
        float(np.abs(result.effort_upper[i] - efforts.max(axis=0)).max(initial=0.0)),
    )


def _pairs(scene: Scene, model: pin.Model, data: pin.Data) -> dict[str, Pair]:
    """All pairs of one sample by name, from the scene's own entries."""
    pairs = {}

    def place(link: str, xyz: tuple[float, ...], rpy: tuple[float, ...] = (0.0, 0.0, 0.0)):  # type: ignore[no-untyped-def]
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        local = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
        return frame.parentJoint, data.oMi[frame.parentJoint] * frame.placement * local

    for loop in scene.loops:
        a, start = place(loop.a.link, loop.a.xyz, loop.a.rpy)
        b, pose = place(loop.b.link, loop.b.xyz, loop.b.rpy)
        axis = pose.rotation @ np.array(loop.axis) / np.linalg.norm(loop.axis)
        if loop.kind == "universal":
            axis = np.cross(start.rotation @ loop.axis, pose.rotation @ loop.axis_b)
            axis /= np.linalg.norm(axis)
        still = np.zeros(3)
        direction = np.concatenate([axis, still] if loop.kind == "prismatic" else [still, axis])
        pairs[loop.name] = Pair(loop.name, a, b, pose.translation, pose.rotation, direction)
    for actuator in scene.actuators or ():
        if actuator.cylinder is not None:
            a, start = place(actuator.cylinder.a.link, actuator.cylinder.a.xyz)
            b, end = place(actuator.cylinder.b.link, actuator.cylinder.b.xyz)
            line = end.translation - start.translation
            direction = np.concatenate([line / np.linalg.norm(line), np.zeros(3)])
            name = actuator.cylinder.name
            pairs[name] = Pair(name, a, b, end.translation, end.rotation, direction, True)
        elif actuator.force is not None:
            force = actuator.force
            b, pose = place(force.link, force.xyz)
            along = np.array(force.direction) / np.linalg.norm(force.direction)
            direction = np.concatenate([pose.rotation @ along, np.zeros(3)])
            pairs[force.name] = Pair(force.name, 0, b, pose.translation, pose.rotation, direction)
        elif actuator.joint in pairs:  # of a loop, under the drive's own name
            pairs[actuator.drive_name] = pairs[actuator.joint]
    return pairs


def _generalized(model: pin.Model, data: pin.Data, pair: Pair, wrench: np.ndarray) -> np.ndarray:
    """(nv,) effort of a wrench (world, at the pair's place) on b and its opposite on a."""
    total = np.zeros(model.nv)
    for joint, sign in ((pair.b, 1.0), (pair.a, -1.0)):
        if joint:
            J = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            arm = pair.at - data.oMi[joint].translation
            moment = wrench[3:] + np.cross(arm, wrench[:3])
            total += sign * (J[:3].T @ wrench[:3] + J[3:].T @ moment)
    return total


def _in_world(pair: Pair, wrench: np.ndarray) -> np.ndarray:
    return np.concatenate([pair.frame @ wrench[:3], pair.frame @ wrench[3:]])


def _friction_in_world(pair: Pair, site: Site, phi: np.ndarray) -> np.ndarray:
    """(6,) friction of a on b, world axes, at the pair's place; a cylinder's is along its line."""
    if pair.along_line:
        return phi[0] * pair.direction
    return _in_world(pair, _pair_friction(site, phi))


def _pair_friction(site: Site, phi: np.ndarray) -> np.ndarray:
    """(6,) friction of a on b in frame b, of a cylinder in axes whose z is its line."""
    along = phi if site.ball else phi[0] * site.axis
    none = np.zeros(3)
    return np.concatenate([along, none] if site.sliding else [none, along])


def _split(scene: Scene, phi: np.ndarray) -> list[np.ndarray]:
    counts = np.cumsum([3 if site.ball else 1 for site in scene.sites])
    return np.split(phi, counts[:-1]) if len(counts) else []


def _residuals(
    result: InverseResult, model: pin.Model, data: pin.Data, pairs: dict[str, Pair], i: int,
    end: Solution,
) -> np.ndarray:  # fmt: skip
    scene, s = result.scene, result.states
    forces = [pin.Force.Zero() for _ in range(model.njoints)]
    for applied in result.external:
        forces[applied.joint + 1] += pin.Force(applied.wrench[i])
    acting = _acting(scene, pairs, end)
    drive_effort = _joint_efforts(scene, model, end)
    for pair, wrench in acting:
        for joint, sign in ((pair.b, 1.0), (pair.a, -1.0)):
            moment = wrench[3:] + np.cross(pair.at, wrench[:3])  # about the world's origin
            whole = pin.Force(sign * wrench[:3], sign * moment)
            forces[joint] += data.oMi[joint].actInv(whole)
    forces[0] = pin.Force.Zero()
    vector = pin.StdVec_Force()
    vector.extend(forces)
    left = pin.rnea(model, model.createData(), s.q[i], s.v[i], s.a[i], vector) - drive_effort
    if not result.interval_exact[i]:  # ends are bounds, of whatever balances what is undriven
        left[list(scene.mobility.undriven)] = 0.0
    work = model.createData()
    pin.rnea(model, work, s.q[i], s.v[i], s.a[i], vector)
    wrenches = np.array([f.vector for f in work.f][1:]).reshape(-1, 6)
    law = wrench_error = 0.0
    for k, (site, phi) in enumerate(zip(scene.sites, _split(scene, end.friction_coordinates),
                                        strict=True)):  # fmt: skip
        if site.pair >= 0:
            w = _pair_friction(site, phi)
            if not pairs[site.name].along_line:
                w = w + end.multipliers[site.pair]
            for drive, effort in zip(scene.drives, end.effort, strict=True):
                if drive.velocity_index < 0 and pairs[drive.name] is pairs[site.name]:
                    w = w + effort * _pair_friction(site, np.ones(1))
        else:
            w = wrenches[site.joint]
        wrench_error = max(wrench_error, float(np.abs(end.wrench[k] - w).max()))
        law = max(law, _law_error(result, pairs, model, data, i, k, end, phi, w))
    return np.array([float(np.abs(left).max(initial=0.0)), law, wrench_error])


def _acting(scene: Scene, pairs: dict[str, Pair], end: Solution) -> list[tuple[Pair, np.ndarray]]:
    """Everything that acts between pairs in one solution, world axes, at the pair's place."""
    acting = [(pairs[loop.name], _in_world(pairs[loop.name], end.multipliers[row]))
              for row, loop in enumerate(scene.loops)]  # fmt: skip
    for drive, effort in zip(scene.drives, end.effort, strict=True):
        if drive.velocity_index < 0:
            acting.append((pairs[drive.name], effort * pairs[drive.name].direction))
    for site, phi in zip(scene.sites, _split(scene, end.friction_coordinates), strict=True):
        if site.pair >= 0:
            acting.append((pairs[site.name], _friction_in_world(pairs[site.name], site, phi)))
    return acting


def _joint_efforts(scene: Scene, model: pin.Model, end: Solution) -> np.ndarray:
    """(nv,) what drives and friction on the tree's joints contribute."""
    total = np.zeros(model.nv)
    for drive, effort in zip(scene.drives, end.effort, strict=True):
        if drive.velocity_index >= 0:
            total[drive.velocity_index] += effort
        for v, factor in drive.couples:
            total[v] += factor * effort
    for site, phi in zip(scene.sites, _split(scene, end.friction_coordinates), strict=True):
        if site.pair < 0:
            total[site.velocity_index] += site.ratio * phi[0]
    return total


def _law_error(
    result: InverseResult, pairs: dict[str, Pair], model: pin.Model, data: pin.Data, i: int,
    k: int, end: Solution, phi: np.ndarray, w: np.ndarray,
) -> float:  # fmt: skip
    """How far one site's load and friction are from the formulas."""
    site = result.scene.sites[k]
    velocity = _site_velocity(result, site, pairs, model, data, i)
    moved = plain_displacement(result.scene, site, result.states.q[i]) if site.pair < 0 else 0.0
    load = plain_normal_load(site, w, moved)
    error = abs(end.normal_load[k] - load)
    if not site.ball:
        least, most = plain_friction(site, float(velocity[0]), load, bool(result.reversal[i, k]))
        return max(error, least - phi[0], phi[0] - most)
    speed = float(np.linalg.norm(velocity))
    least, most = plain_friction(site, speed, load, bool(result.reversal[i, k]))
    if least < most:
        return max(error, float(np.linalg.norm(phi)) - max(-least, most))
    return max(error, float(np.abs(phi - least * velocity / max(speed, 1e-300)).max()))


def _frictionless(
    result: InverseResult, model: pin.Model, data: pin.Data, pairs: dict[str, Pair], i: int
) -> float:
    """How far `effort_frictionless` is from the least-squares solution of the equilibrium.

    Of all that balances along the motions that loops and undriven joints leave, the sum of
    effort^2 / share is least.
    """
    scene, s = result.scene, result.states
    forces = pin.StdVec_Force()
    forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
    for applied in result.external:
        forces[applied.joint + 1] += pin.Force(applied.wrench[i])
    tau = pin.rnea(model, model.createData(), s.q[i], s.v[i], s.a[i], forces)
    columns = []
    for drive in scene.drives:
        unit = np.zeros(model.nv)
        if drive.velocity_index >= 0:
            unit[drive.velocity_index] = 1.0
            unit[[v for v, _ in drive.couples]] = [factor for _, factor in drive.couples]
        else:
            unit = _generalized(model, data, pairs[drive.name], pairs[drive.name].direction)
        columns.append(unit)
    passive = list(np.eye(model.nv)[list(scene.mobility.undriven)])
    linkage = scene.linkage
    assert linkage is not None
    for c in range(linkage.off_joint, linkage.solved):
        pair = pairs[scene.loops[linkage.column_pair[c]].name]
        turns = (
            scene.loops[linkage.column_pair[c]].kind == "universal" and linkage.unit[c, 3:].any()
        )
        wrench = pair.direction if turns else _in_world(pair, linkage.unit[c])
        passive.append(_generalized(model, data, pair, wrench))
    root = np.sqrt([drive.share or 1.0 for drive in scene.drives])
    S = np.array(columns).reshape(-1, model.nv).T
    still, size, _ = np.linalg.svd(np.array(passive).reshape(-1, model.nv).T)
    rank = int((size > 1e-12 * size.max(initial=0.0)).sum())
    free = still[:, rank:].T
    u = root * np.linalg.lstsq(free @ S * root, free @ tau, rcond=1e-12)[0]
    error = np.abs(result.effort_frictionless[i] - u).max(initial=0.0)
    return max(float(error), float(np.abs(free @ (S @ u - tau)).max(initial=0.0)))
