"""The judge of results: recomputes equilibrium and friction laws independently, sample by sample.

This module uses neither the twin nor a compiled kernel. Wrenches come from `data.f` of Pinocchio's
RNEA with external forces, loads and friction from `plain_laws`. `linkage` judges scenes with loops,
cylinders or forces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.dynamics.judge.linkage import Verdict, judge_linkage, wrong_rates
from pinfric.dynamics.judge.plain_laws import plain_displacement, plain_friction, plain_normal_load
from pinfric.dynamics.samples.outcome import Solution, SolvedMotion, Status


@dataclass(frozen=True)
class Check:
    """Largest residuals over all samples, and the number of wrong statuses.

    All fields are judged, except `reversal` (taken as given: it depends on samples beside those of
    the result), `iterations`, `redundant`, the size of motor torques (they follow from efforts by
    the gears' losses), and accelerations of drives off the joints.

    Attributes:
        equilibrium: |M a + h - J^T f_ext - u - D phi| at both ends of every interval (N m or N).
        friction_law: |phi - law(v, c)| at both ends (N m or N).
        wrench: |w - data.f| (N or N m); 0 where no wrench was needed.
        ends: how far the intervals' ends are from those that the judge finds (N m or N).
        wrong_status: number of samples whose `Status` the judge contradicts: jammed although a
            state of friction obeys the laws, converged although none does, or several do.
        wrong_fields: number of samples with another false field: a number where there is no
            solution, none where there is one, rates of drives, `sticking`, `contraction` below a
            spectral radius or above its bound, `interval_exact` or `interval_searched` without or
            in spite of a reason.
        undecided: number of samples where the judge's search is not complete: its states of
            friction are confirmed, but there may be others.
        scale: largest effort in the result, to compare the residuals with.
        sample: the sample of the largest of these residuals, or the first that is wrong.
    """

    equilibrium: float
    friction_law: float
    wrench: float
    ends: float
    wrong_status: int
    wrong_fields: int
    undecided: int
    scale: float
    sample: int

    def passed(self, relative: float = 1e-9) -> bool:
        """Return whether every residual is below `relative` times the scale, nothing wrong."""
        worst = np.max([self.equilibrium, self.friction_law, self.wrench, self.ends])
        small = bool(worst <= relative * max(self.scale, 1e-300))
        return small and not self.wrong_status and not self.wrong_fields


def check_result(result: SolvedMotion, solutions: Callable[[int], tuple[Solution, ...]]) -> Check:
    """Recompute the residuals of a result (see `Check`).

    Args:
        result: the result to judge.
        solutions: returns the states of friction that were found at a sample; also judged.
    """
    states, scene = result.states, result.scene
    every = (result.effort_lower, result.effort_upper, result.effort_frictionless)
    scale = max(float(np.abs(np.nan_to_num(efforts)).max(initial=0)) for efforts in every)
    verdicts: list[Verdict] = []
    for start, stop, carried in states.phases(scene):
        model = scene.loaded_model(carried)
        data = model.createData()
        for i in range(start, stop):
            if scene.linkage is None:
                verdicts.append(_judge_tree(result, model, data, i))
            else:
                verdicts.append(judge_linkage(result, solutions, model, data, i))
    residuals = np.array([verdict[:4] for verdict in verdicts]).reshape(-1, 4)
    status = np.array([verdict.wrong_status for verdict in verdicts], dtype=bool)
    fields = np.array([verdict.wrong_field for verdict in verdicts], dtype=bool)
    wrong = status | fields
    each = np.where(wrong, np.inf, np.nan_to_num(residuals, nan=np.inf).max(axis=1, initial=0.0))
    equilibrium, friction_law, wrench, ends = residuals.max(axis=0, initial=0.0).tolist()
    return Check(
        equilibrium,
        friction_law,
        wrench,
        ends,
        wrong_status=int(status.sum()),
        wrong_fields=int(fields.sum()),
        undecided=sum(verdict.undecided for verdict in verdicts),
        scale=max([scale, *(verdict.scale for verdict in verdicts)]),
        sample=int(np.argmax(each)) if len(each) else 0,
    )


def _plain_rnea(
    model: pin.Model, data: pin.Data, result: SolvedMotion, i: int
) -> tuple[np.ndarray, np.ndarray]:
    """(nv,) tau_id and (nj, 6) joint wrenches of one sample, by the ordinary RNEA."""
    forces = pin.StdVec_Force()
    forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
    for applied in result.external:
        forces[applied.joint + 1] += pin.Force(applied.wrench[i])
    s = result.states
    total = pin.rnea(model, data, s.q[i], s.v[i], s.a[i], forces)
    return total, np.array([f.vector for f in data.f][1:]).reshape(-1, 6)


def _judge_tree(result: SolvedMotion, model: pin.Model, data: pin.Data, i: int) -> Verdict:
    """Judge one sample of an open chain: every end is a closed form of its site's limits."""
    total, wrenches = _plain_rnea(model, data, result, i)
    scene, states = result.scene, result.states
    D, law, wrench = np.zeros((len(total), len(scene.sites))), 0.0, 0.0
    low, high = np.zeros((2, len(scene.sites)))
    for s, site in enumerate(scene.sites):
        D[site.velocity_index, s] = site.ratio
        w = wrenches[site.joint]
        if result.wrench is not None:
            wrench = float(np.max([wrench, np.abs(result.wrench[i, s] - w).max()]))
        load = plain_normal_load(site, w, plain_displacement(scene, site, states.q[i]))
        v = site.ratio * states.v[i, site.velocity_index]
        low[s], high[s] = plain_friction(site, v, load, bool(result.reversal[i, s]))
        law = float(np.max([law, abs(result.normal_load[i, s] - load)]))
    most, fewest = _ends(D, low, high)
    undriven = list(scene.mobility.undriven)
    beyond = float(np.maximum(total - most, fewest - total)[undriven].max(initial=0.0))
    low, high = _left_by_others(D, total, low, high, undriven)
    law = float(
        np.max(
            [law, *np.abs(result.friction_lower[i] - low), *np.abs(result.friction_upper[i] - high)]
        )
    )
    S = _drive_matrix(result, len(total))
    root = np.sqrt([drive.share or 1.0 for drive in scene.drives])[:, None]
    drives = root * np.linalg.pinv((root * S).T)  # of all u with S^T u = tau least u^2 / share
    velocity = [
        np.atleast_1d(site.ratio * states.v[i, site.velocity_index]) for site in scene.sites
    ]
    u, (taken, left) = drives @ total, _ends(drives @ D, low, high)
    ends = np.concatenate([u - taken - result.effort_lower[i], u - left - result.effort_upper[i]])
    frictionless = np.abs(u - result.effort_frictionless[i]).max(initial=0)
    return Verdict(
        equilibrium=float(np.max([frictionless, beyond])),
        friction_law=law,
        wrench=wrench,
        ends=float(np.abs(ends).max(initial=0)),
        scale=float(np.abs(wrenches).max(initial=0)),
        wrong_status=bool(result.status[i] != Status.CONVERGED),  # there is always one state
        wrong_field=result.contraction[i] != 0.0
        or not result.interval_exact[i]
        or bool(result.interval_searched[i])
        or bool(np.isnan([result.motor_torque_lower[i], result.motor_torque_upper[i]]).any())
        or wrong_rates(result, i, velocity, (S @ states.v[i], S @ states.a[i])),
    )


def _left_by_others(
    D: np.ndarray, total: np.ndarray, low: np.ndarray, high: np.ndarray, undriven: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Narrow the range of friction where it alone balances a joint: D phi = total there.

    Each site has what the others on that joint leave.
    """
    low, high = low.copy(), high.copy()
    for v in undriven:
        on = np.flatnonzero(D[v])
        ends = np.sort(D[v, on] * np.array([low[on], high[on]]), axis=0)
        for n, s in enumerate(on):
            others = np.delete(ends, n, axis=1).sum(axis=1)
            own = np.clip(total[v] - others[::-1], *ends[:, n]) / D[v, s]
            low[s], high[s] = own.min(), own.max()
    return low, high


def _ends(D: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Greatest and least D phi over phi from low to high, by the sign of each entry."""
    return (
        np.where(D >= 0, D * high, D * low).sum(axis=1),
        np.where(D >= 0, D * low, D * high).sum(axis=1),
    )


def _drive_matrix(result: SolvedMotion, nv: int) -> np.ndarray:
    """(na, nv) S: how much of each drive's effort acts along each coordinate."""
    S = np.zeros((len(result.scene.drives), nv))
    for d, drive in enumerate(result.scene.drives):
        S[d, drive.velocity_index] = 1.0
        S[d, [v for v, _ in drive.couples]] = [factor for _, factor in drive.couples]
    return S
