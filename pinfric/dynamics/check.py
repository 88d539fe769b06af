"""The solver's judge: equilibrium and friction laws recomputed in another way, sample by sample.

Nothing here calls the twin or a compiled kernel: wrenches come from `data.f` of Pinocchio's RNEA
with external forces, loads and friction from `plain_laws`. Scenes with loops, cylinders or forces
are judged in `check_linkage`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from pinfric.dynamics.check_linkage import linkage_residuals
from pinfric.dynamics.plain_laws import plain_displacement, plain_friction, plain_normal_load

if TYPE_CHECKING:
    from pinfric.dynamics.result import InverseResult


@dataclass(frozen=True)
class Check:
    """Largest residuals over all samples.

    Attributes:
        equilibrium: |M a + h - J^T f_ext - u - D phi| at both ends of every interval (N m or N).
        friction_law: |phi - law(v, c)| at both ends (N m or N).
        wrench: |w - data.f| (N or N m); 0 where no wrench was needed.
        scale: largest effort in the result, to compare the residuals with.
        sample: the sample of the largest equilibrium residual.
    """

    equilibrium: float
    friction_law: float
    wrench: float
    scale: float
    sample: int

    def passed(self, relative: float = 1e-9) -> bool:
        """Say whether every residual is below `relative` times the scale."""
        worst = max(self.equilibrium, self.friction_law, self.wrench)
        return bool(worst <= relative * max(self.scale, 1e-300))


def check_result(result: InverseResult) -> Check:
    """Recompute the residuals of a result (see `Check`)."""
    states, scene = result.states, result.scene
    worst = np.zeros(3)
    worst_sample = 0
    every = (result.effort_lower, result.effort_upper, result.effort_frictionless)
    scale = max(float(np.abs(np.nan_to_num(efforts)).max(initial=0)) for efforts in every)
    for start, stop, carried in states.phases(scene):
        model = scene.loaded_model(carried)
        data = model.createData()
        for i in range(start, stop):
            total, wrenches = _plain_rnea(model, data, result, i)
            if scene.linkage is None:
                residuals = _residuals(result, i, total, wrenches)
            else:
                residuals, largest = linkage_residuals(result, model, data, i)
                scale = max(scale, largest)
            if residuals[0] > worst[0]:
                worst_sample = i
            worst = np.maximum(worst, residuals)
            scale = max(scale, float(np.abs(wrenches).max(initial=0)))
    equilibrium, friction_law, wrench = (float(w) for w in worst)
    return Check(equilibrium, friction_law, wrench, scale, worst_sample)


def _plain_rnea(
    model: pin.Model, data: pin.Data, result: InverseResult, i: int
) -> tuple[np.ndarray, np.ndarray]:
    """(nv,) tau_id and (nj, 6) joint wrenches of one sample, by the ordinary RNEA."""
    forces = pin.StdVec_Force()
    forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
    for applied in result.external:
        forces[applied.joint + 1] += pin.Force(applied.wrench[i])
    s = result.states
    total = pin.rnea(model, data, s.q[i], s.v[i], s.a[i], forces)
    return total, np.array([f.vector for f in data.f][1:]).reshape(-1, 6)


def _residuals(
    result: InverseResult, i: int, total: np.ndarray, wrenches: np.ndarray
) -> np.ndarray:
    sites, states = result.scene.sites, result.states
    undriven = list(result.scene.mobility.undriven)
    D = np.zeros((len(total), len(sites)))
    law = wrench = 0.0
    for s, site in enumerate(sites):
        D[site.velocity_index, s] = site.ratio
        w = wrenches[site.joint]
        if result.wrench is not None:
            wrench = max(wrench, float(np.abs(result.wrench[i, s] - w).max()))
        load = plain_normal_load(site, w, plain_displacement(result.scene, site, states.q[i]))
        v = site.ratio * states.v[i, site.velocity_index]
        least, greatest = plain_friction(site, v, load, bool(result.reversal[i, s]))
        ends = result.friction_lower[i, s] - least, greatest - result.friction_upper[i, s]
        # what balances an undriven joint is less than what friction can do
        off = max(-min(ends), 0.0) if site.velocity_index in undriven else np.abs(ends).max()
        law = max(law, off, abs(result.normal_load[i, s] - load))
    # the friction that gives each end of each effort, by the sign of its column
    phi_low, phi_high = result.friction_lower[i], result.friction_upper[i]
    drives = _drive_matrix(result, len(total))
    u, (taken, left) = drives @ total, _ends(drives @ D, phi_low, phi_high)
    most, fewest = _ends(D, phi_low, phi_high)
    equilibrium = max(
        float(np.abs(u - taken - result.effort_lower[i]).max(initial=0)),
        float(np.abs(u - left - result.effort_upper[i]).max(initial=0)),
        float(np.abs(u - result.effort_frictionless[i]).max(initial=0)),
        float(np.maximum(total - most, fewest - total)[undriven].max(initial=0)),
    )
    return np.array([equilibrium, law, wrench])


def _ends(D: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Greatest and least D phi over phi from low to high, by the sign of each entry."""
    return (np.where(D >= 0, D * high, D * low).sum(axis=1),
            np.where(D >= 0, D * low, D * high).sum(axis=1))  # fmt: skip


def _drive_matrix(result: InverseResult, nv: int) -> np.ndarray:
    """(na, nv) that gives drives' efforts: of all u with S^T u = tau the least u^2 / share."""
    drives = result.scene.drives
    S, root = np.zeros((len(drives), nv)), np.sqrt([drive.share or 1.0 for drive in drives])
    for d, drive in enumerate(drives):
        S[d, drive.velocity_index] = 1.0
        S[d, [v for v, _ in drive.couples]] = [factor for _, factor in drive.couples]
    return np.asarray(root[:, None] * np.linalg.pinv((root[:, None] * S).T))
