"""Derivatives of efforts by coefficients of friction and by inertial parameters of links.

    d tau/d theta = E^T W - D (dphi/dc) g . W_k,     W the regressor of the opened twin

Masses reach friction through the loads. Friction is linear in its coefficients.
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
from pinfric.model.laws import friction_bounds, friction_law, law_table
from pinfric.model.scene import Scene
from pinfric.model.twin import project

#: The parameters of a link in Pinocchio's order: m, m c, inertia about its joint's origin.
INERTIA = ("m", "mx", "my", "mz", "xx", "xy", "yy", "xz", "yz", "zz")
#: Last words of the keys that friction is linear in.
_LINEAR = ("static", "kinetic", "coefficient")


class ParameterDerivatives(NamedTuple):
    """Derivatives of efforts by parameters.

    Attributes:
        names: of the n parameters, such as "joint_1.mu.kinetic" or "joint_1.inertia.m".
        effort_lower, effort_upper: (na, n) of the ends of `effort`.
    """

    names: tuple[str, ...]
    effort_lower: np.ndarray
    effort_upper: np.ndarray


def by_parameters(
    derived: Differentiator, q: np.ndarray, v: np.ndarray, a: np.ndarray, names: Sequence[str]
) -> ParameterDerivatives:
    """Return the derivatives of efforts at the state of the last call of `derived.at`.

    Args: see `Solver.parameter_derivatives`.
    """
    scene, x = derived.scene, derived.tables
    labels: list[str] = []
    ends: list[np.ndarray] = []  # (2, n, nv) of the joints' efforts
    for name in [names] if isinstance(names, str) else names:
        found = _of_inertias(derived, q, v, a) if name == "inertia" else _of_term(scene, x, v, name)
        labels += found[0]
        ends.append(found[1])
    lower, upper = np.concatenate([np.zeros((2, 0, scene.model.nv)), *ends], axis=1)
    lower, upper = deliver_interval(x.delivery, lower, upper)
    return ParameterDerivatives(tuple(labels), lower.T, upper.T)


def _of_term(scene: Scene, x: Any, v: np.ndarray, name: str) -> tuple[list[str], np.ndarray]:
    """By one coefficient of every site that has it: what one unit more of it changes."""
    path = (f"{name}.coefficient" if name == "viscous" else name).split(".")
    labels, found = [], []
    for s, site in enumerate(scene.sites):
        entries: list[Any] = [site.friction]
        while entries[-1] is not None and len(entries) <= len(path):
            entries.append(getattr(entries[-1], path[len(entries) - 1], None))
        if path[-1] not in _LINEAR or not isinstance(entries[-1], float | int):
            continue
        changed: Any = entries[-1] + 1.0
        for entry, word in zip(entries[-2::-1], path[::-1], strict=True):
            changed = entry.model_copy(update={word: changed})
        ends = np.zeros((2, 2, 1, 1))
        for row, friction in enumerate((site.friction, changed)):
            laws = law_table([friction_law(friction, site.law.stick_velocity)])
            speed = np.array([[site.ratio * v[site.velocity_index]]])
            flags = np.zeros((2, 1, 1), dtype=bool)
            friction_bounds(speed, x.load[None, s : s + 1], laws, flags[0], *ends[row], flags[1])
        change = np.zeros((2, 1, v.size))
        rubs = -site.ratio * (ends[1] - ends[0])[:, 0, 0]
        change[:, 0, site.velocity_index] = rubs[::-1] if site.ratio > 0.0 else rubs
        labels.append(f"{site.name}.{name}")
        found.append(change)
    if not found:
        raise StateError(
            f"parameter_derivatives: no friction has {name!r}; give inertia, viscous, mu.static, "
            "mu.kinetic, coulomb.static, coulomb.kinetic or coulomb.positive.kinetic"
        )
    return labels, np.concatenate(found, axis=1)


def _of_inertias(
    derived: Differentiator, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[list[str], np.ndarray]:
    """By the ten parameters of every link, payloads included."""
    scene, x, twin = derived.scene, derived.tables, derived.supplier.twin
    if twin.opened is None:
        raise SceneError(f"{scene.source}: parameter_derivatives: too many joints for inertia")
    free = [one[0] for one in embedded(twin, q[None], v[None], a[None])]
    W = pin.computeJointTorqueRegressor(twin.opened, twin.opened.createData(), *free)
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
