"""Inverse dynamics of scenes with loops, cylinders or forces, where reactions and friction couple.

    M a + h - J_ext^T f_ext = S u + J_c^T lambda + D phi,     phi_k = -sign(v_k) mu_k c_k(w)

(design 2.2-2.4; paper eq. 16, 17 solved together). One RNEA batch on the twin gives the wrenches
without multipliers; `effort_maps` makes everything affine in phi; `coupled_solve` finds phi.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.closure import PairRates, pair_rates
from pinfric.dynamics.coupled_solve import Answer, Solver
from pinfric.dynamics.effort_maps import EffortTables, Maps, map_friction, write_wrenches
from pinfric.dynamics.inverse import (
    check_roll_moments,
    constant_payloads,
    displacements,
    reversals,
)
from pinfric.dynamics.layout import Layout, make_layout
from pinfric.dynamics.reactions import (
    CHUNK,
    AppliedWrench,
    Batch,
    generalized_effort,
    reactions,
    relieve,
    threads_for,
)
from pinfric.dynamics.result import InverseResult
from pinfric.dynamics.states import States
from pinfric.model.closure import action_maps, tree_tables
from pinfric.model.drives import motor_torque_bounds
from pinfric.model.kinematics import place_links
from pinfric.model.loops import Linkage
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin

#: What of each batch's answer stays.
_KEPT = ("lower", "upper", "load", "friction_lower", "friction_upper", "status", "iterations",
         "contraction", "exact")  # fmt: skip


@dataclass(frozen=True)
class Samples:
    """A batch as `coupled_solve` takes it: maps, and what wrenches follow from.

    Attributes:
        maps: `effort_maps.Maps`.
        wrench: (n, nj, 6) of the tree without multipliers.
        X: (n, nj + loops, 6, nx), `kinematics.act_on_joints`.
    """

    maps: Maps
    wrench: np.ndarray
    X: np.ndarray


def solve_coupled(
    scene: Scene, states: States, applied: list[AppliedWrench], whole: slice, threads: int | None
) -> InverseResult:
    """Solve the samples of one slice; the samples beside it only tell reversals.

    Args, raises: see `inverse.inverse_dynamics`; besides, `closure.pair_rates`.
    """
    linkage = scene.linkage
    assert linkage is not None
    T, threads = whole.stop - whole.start, threads_for(whole.stop - whole.start, threads)
    layout = make_layout(scene)
    around = states.around(whole)
    rates = pair_rates(scene, states, around, whole)
    wider = friction_velocities(layout, states.v[around], rates)
    inner = slice(whole.start - around.start, whole.stop - around.start)
    velocity = np.ascontiguousarray(wider[inner])
    reversal = np.zeros((T, len(scene.sites)), dtype=bool)
    if states.t is not None:
        reversal = site_reversals(layout, wider)[inner]
    answer = Answer.of(layout, T)
    frictionless = np.empty((T, len(scene.drives)))
    wrench, solved = np.empty((T, len(scene.sites), 6)), np.empty((T, layout.solved))
    batch = Batch.of(scene.twin(), min(T, CHUNK * threads))
    for part, twin in constant_payloads(scene, states, whole, CHUNK * threads):
        here = slice(part.start - whole.start, part.stop - whole.start)
        now = batch.first(part.stop - part.start)
        samples = friction_maps(layout, linkage, twin, states, applied, part, now, threads)
        frictionless[here] = samples.maps.effort[:, :, 0]
        found = Solver(layout, samples.maps, velocity[here], reversal[here]).solve()
        for name in _KEPT:
            getattr(answer, name)[here] = getattr(found, name)
        write_wrenches(
            EffortTables.of(layout),
            samples.wrench,
            samples.X,
            samples.maps.y,
            found.phi,
            wrench[here],
            solved[here],
        )
    check_roll_moments(scene, wrench, whole.start)
    drive_rates = actuator_rates(scene, states, rates, around, whole)
    motor_lower, motor_upper = _motor_torques(scene, answer, *drive_rates)
    return InverseResult(
        scene=scene,
        states=states.part(whole),
        external=tuple(AppliedWrench(w.joint, w.wrench[whole]) for w in applied),
        effort_lower=answer.lower,
        effort_upper=answer.upper,
        effort_frictionless=frictionless,
        motor_torque_lower=motor_lower,
        motor_torque_upper=motor_upper,
        sticking=site_speeds(layout, velocity) <= layout.laws.stick_velocity,
        reversal=reversal,
        normal_load=answer.load,
        friction_lower=answer.friction_lower,
        friction_upper=answer.friction_upper,
        wrench=wrench,
        iterations=answer.iterations,
        contraction=answer.contraction,
        status=answer.status,
        multipliers=loop_wrenches(linkage, solved),
        interval_exact=answer.exact,
        redundant=layout.solved > len(layout.balanced),
        actuator_velocity=drive_rates[0][:, :, 0],
        actuator_acceleration=drive_rates[0][:, :, 1],
    )


def friction_maps(
    layout: Layout,
    linkage: Linkage,
    twin: Twin,
    states: States,
    applied: list[AppliedWrench],
    part: slice,
    batch: Batch,
    threads: int,
) -> Samples:
    """Return everything of a batch as affine functions of the friction (`effort_maps`).

    Args:
        layout, linkage: of the scene.
        twin: with the payloads of this batch.
        states, applied: of all samples.
        part: the samples of this batch.
        batch: buffers of as many samples.
        threads: of Pinocchio.
    """
    q, a, n = states.q[part], states.a[part], part.stop - part.start
    reactions(twin, q, states.v[part], a, batch, threads)
    relieve(twin, applied, part, batch)
    tau = np.empty((n, twin.nv))
    generalized_effort(twin, batch.wrench, a, tau)
    p, R = np.empty((n, twin.n_joints, 3)), np.empty((n, twin.n_joints, 3, 3))
    place_links(batch.q, *tree_tables(twin), p, R)
    X, J = action_maps(twin, linkage, p, R)
    maps = Maps.of(layout, n)
    moved = np.zeros((0, 0))
    tree = layout.joint < layout.n_tree
    if layout.contact_map_moved.any():
        moved = np.zeros((n, len(layout.joint)))
        moved[:, tree] = displacements(twin, layout.joint[tree], q)
    map_friction(EffortTables.of(layout), batch.wrench, tau, X, J, moved, maps)
    return Samples(maps, batch.wrench, X)


def friction_velocities(layout: Layout, v: np.ndarray, rates: PairRates) -> np.ndarray:
    """Return the relative velocity (n, ne) along each friction coordinate (rad/s or m/s)."""
    out = layout.entry_ratio * v[:, layout.entry_v]
    loop = layout.entry_action >= 0
    out[:, loop] = rates.rate[:, layout.entry_action[loop]]
    return np.ascontiguousarray(out)


def site_speeds(layout: Layout, velocity: np.ndarray) -> np.ndarray:
    """Return the speed (n, ns) of each site; a ball's is the length of its angular velocity."""
    squares = np.add.reduceat(velocity**2, layout.first_entry, axis=1) if len(layout.joint) else (
        np.zeros((len(velocity), 0)))  # fmt: skip
    return np.asarray(np.sqrt(squares))


def site_reversals(layout: Layout, velocity: np.ndarray) -> np.ndarray:
    """Return (n, ns) at which samples a site passes through rest beside them.

    A ball does where the straight line between two angular velocities comes as near to zero as its
    stick velocity; of the two samples the slower one is marked (the earlier if equal).

    Args:
        layout: `Layout`.
        velocity: (n, ne), `friction_velocities`.
    """
    stick = layout.laws.stick_velocity
    marked = reversals(np.ascontiguousarray(velocity[:, layout.first_entry]), stick)
    for s in np.flatnonzero(layout.entry_count == 3):
        w = velocity[:, layout.first_entry[s] : layout.first_entry[s] + 3]
        change = np.diff(w, axis=0)
        square = np.maximum((change**2).sum(axis=1), 1e-300)
        share = np.clip(-(w[:-1] * change).sum(axis=1) / square, 0.0, 1.0)
        nearest = np.linalg.norm(w[:-1] + share[:, None] * change, axis=1)
        speed = np.linalg.norm(w, axis=1)
        moving = (speed[:-1] > stick[s]) & (speed[1:] > stick[s])
        passes = np.flatnonzero((nearest <= stick[s]) & moving)
        marked[:, s] = False
        marked[np.where(speed[passes] <= speed[passes + 1], passes, passes + 1), s] = True
    return marked


def actuator_rates(
    scene: Scene, states: States, rates: PairRates, around: slice, whole: slice
) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, na, 2) velocity and acceleration of what each drive moves, (n, na) reversals."""
    n = around.stop - around.start
    both = np.empty((n, len(scene.drives), 2))
    stick = np.empty(len(scene.drives))
    for d, drive in enumerate(scene.drives):
        column = getattr(drive, "column", -1)
        if column >= 0:
            both[:, d, 0], both[:, d, 1] = rates.rate[:, column], rates.rate_derivative[:, column]
        else:
            both[:, d, 0] = states.v[around, drive.velocity_index]
            both[:, d, 1] = states.a[around, drive.velocity_index]
        same = [s.law.stick_velocity for s in scene.sites if s.name == drive.name]
        stick[d] = same[0] if same else scene.stick_velocity
    turns = np.zeros(both.shape[:2], dtype=bool)
    if states.t is not None:
        turns = reversals(np.ascontiguousarray(both[:, :, 0]), stick)
    inner = slice(whole.start - around.start, whole.stop - around.start)
    return both[inner], turns[inner]


def _motor_torques(
    scene: Scene, answer: Answer, rates: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(T, na) least and greatest motor torque; the efforts themselves where no gear is."""
    lower, upper = answer.lower.copy(), answer.upper.copy()
    for d, drive in enumerate(scene.drives):
        if drive.transmission is not None:
            same = [s.law.stick_velocity for s in scene.sites if s.name == drive.name]
            lower[:, d], upper[:, d] = motor_torque_bounds(
                drive.transmission, answer.lower[:, d], answer.upper[:, d], rates[:, d, 0],
                rates[:, d, 1], turns[:, d], same[0] if same else scene.stick_velocity,
            )  # fmt: skip
    return lower, upper


def loop_wrenches(linkage: Linkage, solved: np.ndarray) -> np.ndarray:
    """Return the multipliers (n, number of loops, 6) as wrenches of a on b in frame b."""
    out = np.zeros((len(solved), len(linkage.loops), 6))
    for c in range(linkage.off_joint, linkage.solved):
        out[:, linkage.column_pair[c]] += solved[:, c, None] * linkage.unit[c]
    return out
