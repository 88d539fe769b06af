"""Derivatives of efforts by coefficients of friction, of gears, and by inertias of links.

    d tau/d theta = E^T W - D (dphi/dc) g . W_k,     W the regressor of the opened twin

Friction and losses of gears are linear in their coefficients: a derivative is what one unit more
changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.derivatives.derivatives import Differentiator
from pinfric.errors import SceneError, StateError
from pinfric.model.closure import embedded
from pinfric.model.couples import deliver_interval
from pinfric.model.drives import write_motor_torques
from pinfric.model.laws import friction_bounds, friction_law, law_table
from pinfric.model.scene import Scene
from pinfric.model.twin import project

#: Most joints that are opened: Pinocchio's `Data` holds arrays of nv^3 numbers, 55 MB for 20 opened
#: joints, 1.5 GB for 60.
_LARGEST = 20
#: The parameters of a link in Pinocchio's order: m, m c, inertia about its joint's origin.
INERTIA = ("m", "mx", "my", "mz", "xx", "xy", "yy", "xz", "yz", "zz")
#: Last words of the keys that friction is linear in; coefficients of gears.
_LINEAR = ("static", "kinetic", "coefficient")
_OF_GEARS = (
    "loss.driving",
    "loss.driven",
    "no_load_torque.static",
    "no_load_torque.kinetic",
    "motor_viscous",
    "rotor_inertia",
)


class ParameterDerivatives(NamedTuple):
    """Derivatives of the ends of efforts and motor torques by parameters.

    Attributes:
        names: of the n parameters, such as "joint_1.mu.kinetic" or "joint_1.inertia.m".
        effort_lower, effort_upper, motor_torque_lower, motor_torque_upper: (na, n).
    """

    names: tuple[str, ...]
    effort_lower: np.ndarray
    effort_upper: np.ndarray
    motor_torque_lower: np.ndarray
    motor_torque_upper: np.ndarray


def by_parameters(
    derived: Differentiator, q: np.ndarray, v: np.ndarray, a: np.ndarray, names: Sequence[str]
) -> ParameterDerivatives:
    """Return the derivatives at the state of the last call of `derived.at`.

    Args: see `Solver.parameter_derivatives`.
    """
    scene, x, labels = derived.scene, derived.tables, []
    columns = [np.zeros((4, 0, len(scene.drives)))]  # as `ParameterDerivatives`
    for name in [names] if isinstance(names, str) else names:
        if name in _OF_GEARS:
            own, motors = _of_gears(scene, x, v, a, name)
            ends = np.concatenate([np.zeros_like(motors), motors])
        else:
            own, joints = (
                _of_inertias(derived, q, v, a) if name == "inertia" else _of_term(scene, x, v, name)
            )
            efforts = np.array(deliver_interval(x.delivery, *joints))
            motors = np.einsum("med,end->mnd", x.through[:, :2], efforts)
            ends = np.concatenate([efforts, motors])
        if not own:
            raise StateError(
                f"parameter_derivatives: nothing has {name!r}; give inertia, viscous, mu.static, "
                "mu.kinetic, coulomb.static, coulomb.kinetic or coulomb.positive.kinetic; of gears "
                f"{', '.join(_OF_GEARS)}"
            )
        labels += own
        columns.append(ends)
    return ParameterDerivatives(tuple(labels), *np.concatenate(columns, axis=1).transpose(0, 2, 1))


def _of_gears(
    scene: Scene, x: Any, v: np.ndarray, a: np.ndarray, name: str
) -> tuple[list[str], np.ndarray]:
    """By one coefficient of every transmission; of a loss, by its slope."""
    gears, torques, geared = x.gears, [], [d.transmission is not None for d in scene.drives]
    key, _, kind = name.partition(".")
    if key == "loss":
        k, more = int(kind == "driven"), np.zeros_like(gears.slope)
        for first, last in zip(gears.first[:, k], gears.last[:, k], strict=True):
            more[first:last] = 1.0
        changed = gears._replace(slope=gears.slope + more, loss=gears.loss + more * gears.load)
    elif key == "no_load_torque":
        field = "no_load_static" if kind == "static" else "no_load"
        more = getattr(gears, field) + np.abs(gears.ratio)[:, None]
        changed = gears._replace(**{field: more})
    else:
        field = key.replace("motor_", "")
        changed = gears._replace(**{field: getattr(gears, field) + 1.0})
    effort, at_rest = x.through[:, 2], np.zeros(x.effort.shape, dtype=bool)
    rates = [np.tile(x.rate @ y, (2, 1)) for y in (v, a)]
    for table in (gears, changed):
        lower, upper = np.empty((2, *effort.shape))
        write_motor_torques(table, effort, effort, *rates, at_rest, lower, upper)
        torques.append(np.array([lower[0], upper[1]]))
    ends = np.eye(len(geared))[geared] * (torques[1] - torques[0])[:, None]
    return [f"{n}.{name}" for n, own in zip(scene.actuator_names, geared, strict=True) if own], ends


def _of_term(scene: Scene, x: Any, v: np.ndarray, name: str) -> tuple[list[str], np.ndarray]:
    """By one coefficient of every site that has it."""
    path = (f"{name}.coefficient" if name == "viscous" else name).split(".")
    own, laws = [], [site.law for site in scene.sites]
    for s, site in enumerate(scene.sites):
        entries: list[Any] = [site.friction]
        while entries[-1] is not None and len(entries) <= len(path):
            entries.append(getattr(entries[-1], path[len(entries) - 1], None))
        if path[-1] in _LINEAR and isinstance(entries[-1], float | int):
            changed: Any = entries[-1] + 1.0
            for entry, word in zip(entries[-2::-1], path[::-1], strict=True):
                changed = entry.model_copy(update={word: changed})
            laws[s] = friction_law(changed, site.law.stick_velocity)
            own.append(s)
    ratio, index = x.sites.ratio, x.sites.velocity_index
    ends = np.zeros((2, 2, 1, len(laws)))
    for row, table in zip(ends, (x.sites.laws, law_table(laws)), strict=True):
        flags = np.zeros((2, 1, len(laws)), dtype=bool)
        friction_bounds((ratio * v[index])[None], x.load[None], table, flags[0], *row, flags[1])
    rubs = -ratio * (ends[1] - ends[0])[:, 0]
    change = np.zeros((2, len(own), v.size))
    change[:, np.arange(len(own)), index[own]] = np.where(ratio > 0.0, rubs[::-1], rubs)[:, own]
    return [f"{scene.sites[s].name}.{name}" for s in own], change


def opened(model: pin.Model) -> pin.Model:
    """Return the wrench twin's model: a free joint in place of every joint."""
    free = pin.Model()
    free.gravity = model.gravity
    for index in range(1, model.njoints):
        added = free.addJoint(
            model.parents[index],
            pin.JointModelFreeFlyer(),
            model.jointPlacements[index],
            model.names[index],
        )
        free.appendBodyToJoint(added, model.inertias[index], pin.SE3.Identity())
    return free


def _of_inertias(
    derived: Differentiator, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[list[str], np.ndarray]:
    """By the ten parameters of every link, payloads included."""
    scene, x, twin = derived.scene, derived.tables, derived.pinocchio.twin
    if twin.n_joints > _LARGEST:
        raise SceneError(f"{scene.source}: parameter_derivatives: too many joints for inertia")
    if "opened" not in twin.pools:
        twin.pools["opened"] = opened(twin.model)
    model = twin.pools["opened"]
    free = [array[0] for array in embedded(twin, q[None], v[None], a[None])]
    W = pin.computeJointTorqueRegressor(model, model.createData(), *free)
    wrench = np.ascontiguousarray(W.T).reshape(-1, twin.n_joints, 6)
    rigid = np.empty((len(wrench), v.size))
    still = np.zeros_like(rigid)
    project(wrench, twin.embedding, np.zeros(v.size), still, rigid)
    ends = np.stack([rigid, rigid])
    for s, site in enumerate(scene.sites):
        load = wrench[:, site.joint] @ x.gradient[s]
        rubs = -site.ratio * x.by_load[:, s, None] * load
        ends[:, :, site.velocity_index] += rubs[::-1] if site.ratio > 0.0 else rubs
    return [f"{joint}.inertia.{k}" for joint in scene.joint_names for k in INERTIA], ends
