"""Residuals of a result by Pinocchio's plain RNEA: `result.check()`.

    RNEA(q, v, a, wrenches) = S^T u + D^T phi

The wrenches are multipliers, and efforts and friction off the joints of the tree. With loops,
cylinders or forces, the states of friction at the ends of the efforts are solved again, sample by
sample, for this equation and the friction laws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pinfric.dynamics.inverse.solutions import solve_sample
from pinfric.dynamics.inverse.undriven import narrow_friction
from pinfric.dynamics.problem.plan import drive_delivery
from pinfric.dynamics.samples.outcome import Solution, SolvedMotion, Status
from pinfric.friction.several import distinct
from pinfric.model.bearings import axes_along, normal_loads
from pinfric.model.brief import listed, screen
from pinfric.model.closure import loop_state, velocity_names
from pinfric.model.couples import drive_rates, rate_rows
from pinfric.model.laws import friction_bounds, law_at
from pinfric.model.loops import CYLINDER
from pinfric.model.scene import Scene

#: Given motions may leave loops open by this much (`samples.closure`), relative to what cancels.
_CLOSED = 1e-6
#: Where a residual this small is largest says nothing.
_ROUNDING = 1e-12
#: What is NaN where there is no solution, and only there.
_ARRAYS = (
    *("effort_lower", "effort_upper", "motor_torque_lower", "motor_torque_upper", "normal_load"),
    *("friction_lower", "friction_upper", "wrench", "multipliers"),
)


class Residual(NamedTuple):
    """The largest residual of one kind.

    Attributes:
        size: relative to the largest of the terms that cancel.
        sample, joint: where; `joint` may be a drive or a loop.
    """

    size: float = 0.0
    sample: int = 0
    joint: str = ""


@dataclass(frozen=True, repr=False)
class Check:
    """What a result leaves of the equations: the largest `Residual` of each.

    Attributes:
        equilibrium: RNEA(q, v, a, wrenches) - S^T u - D^T phi, wrenches and multipliers.
        laws: friction beyond its limits, or off the law where it slides, and normal loads.
        closure: gaps of loops, their rates and accelerations.
        power: of drives, friction and external wrenches, less the rate of the robot's energy.
        rates: of what the drives move, and their derivatives.
        wrong: samples whose status, `sticking`, `contraction` or `interval_searched` is false, or
            whose numbers are not there exactly where there is a solution.
    """

    equilibrium: Residual
    laws: Residual
    closure: Residual
    power: Residual
    rates: Residual
    wrong: tuple[int, ...]

    def passed(self, relative: float = 1e-11) -> bool:
        """Return whether all residuals are at most `relative`, and no sample is wrong.

        Loops may be open by 1e-6, as in `inverse_dynamics`.
        """
        closed = self.closure.size <= max(relative, _CLOSED)
        sizes = self.equilibrium.size, self.laws.size, self.power.size, self.rates.size
        return closed and max(sizes) <= relative and not self.wrong

    def __repr__(self) -> str:
        facts = {
            name: f"{residual.size:.1e}"
            + f" at sample {residual.sample}, {residual.joint}" * (residual.size > _ROUNDING)
            for name, residual in vars(self).items()
            if name != "wrong"
        }
        facts["wrong"] = listed([f"sample {i}" for i in self.wrong]) or "no sample"
        return screen("Check", "the largest residuals, relative to their terms", facts)


def _actions(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return what unit efforts of the drives, then unit frictions do.

    (nx, nv) on the joints of the tree, (nx, np, 6) as wrenches of a on b in frame b.
    """
    linkage, na, nv = scene.linkage, len(scene.drives), scene.model.nv
    units = [(s, unit) for s in scene.sites for unit in (np.eye(3) if s.ball else s.axis[None])]
    rows = np.concatenate([rate_rows(scene.drives, nv), np.zeros((len(units), nv))])
    pairs = np.zeros((len(rows), 0 if linkage is None else len(linkage.pair_kind), 6))
    for d, drive in enumerate(scene.drives):
        if linkage is not None and drive.velocity_index < 0:
            unit = linkage.unit[drive.column]  # 0 of a cylinder, which pushes along its z
            pairs[d, linkage.column_pair[drive.column]] = unit if unit.any() else np.eye(6)[2]
    for x, (site, unit) in enumerate(units, na):
        if site.pair < 0:
            rows[x, site.velocity_index] = site.ratio
        else:
            pairs[x, site.pair, slice(0, 3) if site.sliding else slice(3, 6)] = unit
    return rows, pairs


class _Sample:
    """One sample in Pinocchio: `model` carries its payloads, `actions` are of `_actions`."""

    def __init__(
        self, result: SolvedMotion, i: int, model: pin.Model, actions: tuple[np.ndarray, ...]
    ) -> None:
        states, linkage = result.states, result.scene.linkage
        self.result, self.i, (self.rows, self.units) = result, i, actions
        self.model, self.data = model, model.createData()
        self.motion = states.q[i], states.v[i], states.a[i]
        pin.forwardKinematics(model, self.data, *self.motion[:2])
        self.pairs, self.twist, place = [], np.zeros(self.units.shape[1:]), self.data.oMi
        self.pulls, twin = [], result.scene.twin()
        if twin.springs is not None:
            p, R = (
                np.array([[getattr(M, x) for M in list(place)[1:]]])
                for x in ("translation", "rotation")
            )
            moved = twin.displacements(twin.springs.joint, self.motion[0][None])
            self.pulls = twin.springs.wrenches(moved, p, R)
        for row in range(len(self.twist)):
            assert linkage is not None
            a, b = (linkage.frame_joint[row] + 1).tolist()
            p, R = linkage.frame_p[row], linkage.frame_R[row]
            pose = place[b] * pin.SE3(R[1], p[1])
            if linkage.pair_kind[row] == CYLINDER:  # its z is the line between its ends
                line = pose.translation - place[a].act(p[0])
                pose.rotation = axes_along(line / np.linalg.norm(line)).T
            apart = place[b].act(self.data.v[b]) - place[a].act(self.data.v[a])
            self.pairs.append((a, b, pose))
            self.twist[row] = pose.actInv(apart).vector
        #: (nx,) along the actions; of each site (1,), of a ball (3,); (ns,), of a ball the speed
        self.rate = self.rows @ self.motion[1] + np.tensordot(self.units, self.twist, 2)
        self.slip = self.of_sites(self.rate)
        speeds = [slip[0] if len(slip) == 1 else np.linalg.norm(slip) for slip in self.slip]
        self.speed = np.array(speeds, dtype=float)

    def of_sites(self, x: np.ndarray) -> list[np.ndarray]:
        """Split the frictions' part of x (nx,) by site."""
        counts = [len(self.result.scene.drives), *(1 + 2 * s.ball for s in self.result.scene.sites)]
        return np.split(x, np.cumsum(counts))[1:-1]

    def left(self, x: np.ndarray, multipliers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual (nv,) of efforts and frictions (nx,), and wrenches (nj + np, 6)."""
        forces, place = pin.StdVec_Force(), self.data.oMi
        forces.extend([pin.Force.Zero() for _ in range(self.model.njoints)])
        for applied in self.result.external:
            forces[applied.joint + 1] += pin.Force(applied.wrench[self.i])
        for joint, wrench in self.pulls:
            forces[joint + 1] += pin.Force(wrench[0])
        between = np.tensordot(x, self.units, 1)
        between[: len(multipliers)] += multipliers
        for (a, b, pose), wrench in zip(self.pairs, between, strict=True):
            force = pose.act(pin.Force(wrench))
            forces[b] += place[b].actInv(force)
            forces[a] -= place[a].actInv(force)
        tau = pin.rnea(self.model, self.data, *self.motion, forces)
        wrenches = [force.vector for force in self.data.f][1:] + list(between)
        return tau - x @ self.rows, np.array(wrenches).reshape(-1, 6)

    def laws(self, wrench: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return loads, least and greatest friction (1, ns) under these wrenches."""
        scene, ns = self.result.scene, len(self.speed)
        tables, twin = scene.site_tables, scene.twin()
        (load, low, high), sticks = np.empty((3, 1, ns)), np.empty((1, ns), dtype=bool)
        moved, tree = np.zeros((1, ns)), tables.joint[tables.joint < twin.n_joints]
        moved[:, : len(tree)] = twin.displacements(tree, self.motion[0][None])
        normal_loads(wrench[None], tables.joint, tables.contacts, moved, load)
        at_rest = self.result.reversal[self.i][None]
        friction_bounds(self.speed[None], load, tables.laws, at_rest, low, high, sticks)
        if self.result.presliding is not None:
            self._build_up(load, low, high, sticks)
        return load, low, high

    def _build_up(
        self, load: np.ndarray, low: np.ndarray, high: np.ndarray, sticks: np.ndarray
    ) -> None:
        """Change the ends of friction (1, ns) to those of the shares that the result states."""
        built, ways = self.result.presliding, self.result.scene.ways
        assert built is not None
        assert ways is not None
        laws = self.result.scene.site_tables.laws
        for s, site in enumerate(self.result.scene.sites):
            shares = np.array([built.upper[self.i, s], built.lower[self.i, s]])
            if not ways.way[site.velocity_index] > 0.0:
                continue
            full = np.array([low[0, s], high[0, s]])
            if not sticks[0, s]:
                law, v, c = law_at(laws, s, self.speed[s]), self.speed[s], load[0, s]
                drag = law.viscous * v + np.copysign(law.drag_mu * c + law.drag, v)
                full = np.array([-law.mu * c - law.forward, law.mu * c + law.backward]) - drag
            blended = 0.5 * (full.sum() - shares * (full[1] - full[0]))
            low[0, s], high[0, s] = blended

    def beyond(self, friction: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return how far friction (nx,) is from the law (ns,); a sticking ball's is in a sphere."""
        out = np.empty(len(low))
        for s, phi in enumerate(self.of_sites(friction)):
            way, ends = np.ones(1), (low[s], high[s])
            if len(phi) == 3:
                sticks = low[s] < high[s]
                way, ends = (phi, (0.0, max(-low[s], high[s]))) if sticks else (self.slip[s], ends)
                way = way / (np.linalg.norm(way) or 1.0)
            out[s] = np.linalg.norm(phi - np.clip(phi @ way, *ends) * way)
        return out


class _Largest:
    """The largest residual of each kind, and the largest of its terms."""

    def __init__(self) -> None:
        kinds = ("equilibrium", "laws", "closure", "power", "rates")
        self.found, self.term = dict.fromkeys(kinds, Residual()), dict.fromkeys(kinds, 1e-300)

    def note(self, kind: str, names: Sequence[str], residual: np.ndarray, i: int = -1) -> None:
        """Note residuals (m, number of names), of sample i or of m samples."""
        if residual.size:
            each = np.nan_to_num(np.abs(residual), nan=np.inf).reshape(-1, len(names))
            row, column = divmod(int(np.argmax(each)), len(names))
            if (size := float(each[row, column])) > self.found[kind].size:
                self.found[kind] = Residual(size, row if i < 0 else i, names[column])

    def beside(self, kind: str, *terms: np.ndarray) -> None:
        """Note terms that cancel."""
        sizes = [np.abs(term).max(initial=0.0) for term in terms]
        self.term[kind] = float(np.fmax.reduce([self.term[kind], *sizes]))


def check_result(result: SolvedMotion) -> Check:
    """Recompute the residuals of a result, see `Check`."""
    scene, largest, wrong = result.scene, _Largest(), []
    _check_motion(result, largest)
    actions = _actions(scene)
    for start, stop, carried in result.states.phases(scene):
        model = scene.loaded_model(carried)
        for i in range(start, stop):
            if not _check_sample(_Sample(result, i, model, actions), largest):
                wrong.append(i)
    terms = largest.term | {"laws": largest.term["equilibrium"], "closure": 1.0, "rates": 1.0}
    residuals = {
        kind: residual._replace(size=residual.size / terms[kind])
        for kind, residual in largest.found.items()
    }
    return Check(**residuals, wrong=tuple(wrong))


def _check_motion(result: SolvedMotion, largest: _Largest) -> None:
    """Note gaps of loops and errors of the drives' rates, relative to the motion."""
    scene, v, a, linkage = result.scene, result.states.v, result.states.a, result.scene.linkage
    rate, slope = v[:, :0], v[:, :0]
    if linkage is not None:
        state, rows = loop_state(scene.twin(), linkage, result.states.q, v, a), linkage.lambdas
        names = [linkage.name_of_row(row) for row in range(linkage.multipliers)]
        rate, slope, length = state.rate, state.rate_derivative, np.full(len(names), linkage.size)
        length[linkage.turning[: len(names)]] = 1.0
        scale = np.maximum(state.scale[:, linkage.column_pair[rows]], 1e-300)
        largest.note("closure", names, state.gap[:, rows] / length)
        largest.note("closure", names, rate[:, rows] / scale[:, :, 0])
        largest.note("closure", names, slope[:, rows] / scale[:, :, 1])
    fastest = float(np.abs(v).max(initial=0.0))
    steepest = float(np.abs(a).max(initial=0.0)) + fastest**2
    rate = result.actuator_velocity - drive_rates(scene.drives, v, rate)
    slope = result.actuator_acceleration - drive_rates(scene.drives, a, slope)
    largest.note("rates", scene.actuator_names, rate / max(fastest, 1e-300))
    largest.note("rates", scene.actuator_names, slope / max(steepest, 1e-300))


def _check_sample(sample: _Sample, largest: _Largest) -> bool:
    """Note a sample's residuals; return whether its status and certificates are right."""
    result, scene, i = sample.result, sample.result.scene, sample.i
    drives, sites, na = scene.actuator_names, scene.site_names, len(scene.drives)
    at, least, greatest = scene.site_tables.joint, result.effort_lower[i], result.effort_upper[i]
    low, high = result.friction_lower[i], result.friction_upper[i]
    undriven = np.isin(np.arange(scene.model.nv), scene.mobility.undriven)
    slack = free = np.where(undriven, np.inf, 0.0)  # there friction balances the motion

    def note(kind: str, names: Sequence[str], *residuals: np.ndarray) -> None:
        for residual in residuals:
            largest.note(kind, names, residual, i)

    # 1. Numbers are there where there is a solution, and only there.
    status = Status(int(result.status[i]))
    failed = status not in (Status.CONVERGED, Status.AMBIGUOUS)
    arrays = [x[i] for name in _ARRAYS if (x := getattr(result, name)) is not None]
    right = all((np.isnan(x) == failed).all() for x in arrays)
    sticks = np.abs(sample.speed) <= scene.site_tables.laws.stick_velocity
    right &= bool((sticks == result.sticking[i]).all())
    certificates = status, result.contraction[i], result.interval_searched[i]

    # 2. The states to judge: without friction, that of the wrenches, those at the ends of efforts.
    if scene.linkage is None:
        right &= certificates == (Status.CONVERGED, 0.0, False)
        total, wrench = sample.left(0.0 * sample.rate, np.zeros((0, 6)))
        load, *limits = sample.laws(wrench)
        narrow_friction(scene, total[None], *limits)
        note("laws", sites, load - result.normal_load[i], low - limits[0], high - limits[1])
        half, D = (limits[1] - limits[0])[0] / 2.0, sample.rows[na:].T
        spread = np.abs(drive_delivery(scene) @ D) @ half  # joints' frictions are independent
        note("equilibrium", drives, (greatest - least) / 2.0 - spread)
        stated = wrench[at] if result.wrench is None else result.wrench[i]
        phi, u = (low + high) / 2.0, (least + greatest) / 2.0
        state = Solution(u, phi, phi, result.normal_load[i], stated, np.zeros((0, 6)))
        states = [replace(state, friction_coordinates=0.0 * phi), state]
        slack = np.where(undriven, np.abs(D) @ half, 0.0)
    else:
        again, solution = solve_sample(result, i)
        once_more = again.status[0], again.contraction[0], again.searched[0]
        right &= np.allclose(certificates, once_more, rtol=1e-9, atol=0.0)
        if Status.SINGULAR in (status, again.status[0]):
            return bool(right and np.isnan(result.effort_frictionless[i]).all())
        states = [solution(0.0 * sample.rate[na:])]
        if not failed:
            usual, names = solution(again.phi[0]), ("normal_load", "wrench", "multipliers")
            stated = {name: getattr(result, name)[i] for name in names}
            ends = again.ends.reshape(2 * again.ends.shape[1], again.phi.shape[1])
            at_ends = [*map(solution, distinct(ends[~np.isnan(ends).any(axis=1)]))]
            states += [replace(usual, **stated), *at_ends]
            efforts = np.array([state.effort for state in at_ends or [usual]])
            note("equilibrium", drives, least - efforts.min(axis=0), greatest - efforts.max(axis=0))
            note("laws", sites, low - again.friction_lower[0], high - again.friction_upper[0])
            loops = [loop.name for loop in scene.loops]
            note("equilibrium", loops, (stated["multipliers"] - usual.multipliers).T)
    states[0] = replace(states[0], effort=result.effort_frictionless[i])

    # 3. Equilibrium and wrenches of each state, the law of friction, and the power of one.
    for n, state in enumerate(states):
        x = np.concatenate([state.effort, state.friction_coordinates])
        remainder, wrench = sample.left(x, state.multipliers)
        beside = remainder.copy()
        if result.base_residual is not None:  # what forces leave at a free base is stated
            beside[:6] -= result.base_residual[i]
        excess = np.abs(beside) - (slack if n else free)
        note("equilibrium", velocity_names(scene.model), np.maximum(excess, 0.0))
        note("equilibrium", sites, (wrench[at] - state.wrench).T)
        largest.beside("equilibrium", state.effort, wrench)
        load, (lower,), (upper,) = sample.laws(wrench)
        if n and scene.linkage is not None:
            note("laws", sites, load - state.normal_load, sample.beyond(x, lower, upper))
        if n == 1:
            v, terms = (
                sample.motion[1],
                [x * np.append(result.actuator_velocity[i], sample.rate[na:])],
            )
            terms += [remainder[undriven] * v[undriven]]
            terms += [(state.multipliers * sample.twist[: len(state.multipliers)]).ravel()]
            terms += [f.wrench[i] * sample.data.v[f.joint + 1].vector for f in result.external]
            terms += [pull[0] * sample.data.v[row + 1].vector for row, pull in sample.pulls]
            terms += [-v * pin.rnea(sample.model, sample.data, *sample.motion)]
            largest.beside("power", *terms)
            if na:
                strongest = drives[int(np.argmax(np.abs(terms[0][:na])))]
                note("power", [strongest], np.concatenate(terms).sum(keepdims=True))
    return bool(right)
