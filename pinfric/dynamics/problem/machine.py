"""What the kernels of `maps` and `gearing` read and write: a scene's tables, figures, buffers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.dynamics.problem.layout import Layout
from pinfric.friction.modes import Modes
from pinfric.friction.problem import Problem
from pinfric.kernels.compiled import record
from pinfric.model.kinematics import Actions


class Tables(NamedTuple):
    """A scene for the kernels: its layout, what its actions are, and the freedoms of its joints.

    Attributes:
        parent: (nj,) the joint that carries each, -1: the ground.
        mass: (nj,) of all that each joint carries (kg).
        gravity: (3,) m/s^2.
        first_freedom: (nj + 1,) where each joint's freedoms begin, one after the other.
        freedom_v, freedom_ratio: (nf,) which velocity, times what.
        unit_q, unit_count: (nu,) where in q the parts of length 1 begin, and how long they are.
        armature: (nv,) rotor inertia reflected to the joints.
        freedom_axis: (nf, 6) unit motion in the joint's child frame, linear first.
        wrench_row: (nr,) joints whose wrenches are wanted, the loops' after the tree's.
        contact_row: (nt,) row of its joint among those wanted. contact_site: its entry.
        contact_rank: (nt,) how many rows of its map are used.
        actions: of loops and drives off the joints.
        planar: (number of loops,) whether the axes of a loop's sides must be parallel unforced.
        direction_size: (nc,) 0, but for what slides: it has levers for directions, all of which
            vanish at a dead centre (m).
        site_row: (ns,) row of each site's joint among those wanted.
        dependent: whether coordinates may depend on each other: loops close, or friction acts along
            a cylinder.
    """

    layout: Layout
    parent: np.ndarray
    mass: np.ndarray
    gravity: np.ndarray
    first_freedom: np.ndarray
    freedom_v: np.ndarray
    freedom_ratio: np.ndarray
    freedom_axis: np.ndarray
    armature: np.ndarray
    unit_q: np.ndarray
    unit_count: np.ndarray
    wrench_row: np.ndarray
    contact_row: np.ndarray
    contact_site: np.ndarray
    contact_rank: np.ndarray
    contact_map: np.ndarray
    contact_map_moved: np.ndarray
    site_row: np.ndarray
    actions: Actions
    planar: np.ndarray
    direction_size: np.ndarray
    multipliers: int
    dependent: bool


class Supply(NamedTuple):
    """Pinocchio's figures at one state: views of its `Data` after `crba` (world) and `rnea`.

    The first row of each is the ground's, as in Pinocchio.

    Attributes:
        R, p: (1 + nj, 3, 3), (1 + nj, 3) of the joints' child frames in the world.
        velocity, acceleration: (1 + nj, 6) of the links in their joints' frames; accelerations at
            a = 0, of a ground that accelerates against gravity.
        force: (1 + nj, 6) wrench of each joint at a = 0, in its child's frame.
        lever, inertia: (1 + nj, 3), (1 + nj, 6) centre of mass of what a joint carries, and the
            inertia about that (xx, xy, yy, xz, yz, zz), in world axes.
        h: (nv,).
    """

    R: np.ndarray
    p: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray
    lever: np.ndarray
    inertia: np.ndarray
    h: np.ndarray


class Work(NamedTuple):
    """Buffers of one scene, overwritten by every solve.

    Attributes:
        R, p, velocity, acceleration: (1, nj, ...), of the links in world axes (`relate_pairs`).
        motion, momentum: (nf, 6) S and I S of each freedom about the world's origin.
        X, J: (1, nj + pairs, 6, nx), (1, nx, nv), `act_on_joints`.
        gap, rate, rate_derivative, tilt, terms: see `relate_pairs`.
        D, S: (nc, nv), (na, nv) rate of every coordinate, of every drive, per unit velocity.
        Z: (nv, nv) motions that loops allow. M: (nv, nv).
        factor: (nv, nc) A of rate_slope = A^T A, its first d rows.
        a_map: (nv, 1 + nc). multiplier_map: (nl, 1 + nc). wrench_map: (nr, 6, 1 + nc).
        coordinate_rate: (nc,) relative velocity of each coordinate.
        drag, damping: (nc,) of a time step: what opposes it now, and per unit of it at the end.
        idle: (nc,) whether a joint is near its dead centre.
        given, size, push, a_closure: (nv,), lower: (nv, nv), right: (nv, 1 + nc), below, above:
            (nj, 1 + nc, 6), row (6,): of intermediate results.
        freedoms: (1,) int.
        modes: of the coupled problem. least, most: (nc,) static limits.
        a, phi, load, wrench: (nv,), (ns,), (ns,), (ns, 6), of the solution.
        multiplier: (nl,). entry_phi: (ne + gears,). site_modes: (ns,) int8. effort: (na,) what
            drives deliver.
        gear_way: (na,) direction of the line that each gear follows; 0: without loss.
        delivered: (na,) the effort around which lines are chosen. delivered_map: (na, 1 + nc).
        slope, offset, reflected: (na,) of the lines, with drag, and the rotors' inertia; 1, 0, 0
            where efforts are given.
        line, held: (na, 2) efforts at which each line holds, and which the gear holds at rest.
        arriving: (na,) r T_m - drag at rest.
        problem: the coupled problem.
        locking: (1,) int, how many lines do not rise. push_size: (1,) sum of all |h|, |given|.
    """

    R: np.ndarray
    p: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    motion: np.ndarray
    momentum: np.ndarray
    X: np.ndarray
    J: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    rate_derivative: np.ndarray
    tilt: np.ndarray
    terms: np.ndarray
    D: np.ndarray
    S: np.ndarray
    Z: np.ndarray
    M: np.ndarray
    factor: np.ndarray
    a_map: np.ndarray
    multiplier_map: np.ndarray
    wrench_map: np.ndarray
    coordinate_rate: np.ndarray
    drag: np.ndarray
    damping: np.ndarray
    idle: np.ndarray
    given: np.ndarray
    size: np.ndarray
    push: np.ndarray
    a_closure: np.ndarray
    lower: np.ndarray
    right: np.ndarray
    below: np.ndarray
    above: np.ndarray
    row: np.ndarray
    freedoms: np.ndarray
    modes: Modes
    least: np.ndarray
    most: np.ndarray
    a: np.ndarray
    phi: np.ndarray
    load: np.ndarray
    wrench: np.ndarray
    multiplier: np.ndarray
    entry_phi: np.ndarray
    site_modes: np.ndarray
    effort: np.ndarray
    gear_way: np.ndarray
    delivered: np.ndarray
    delivered_map: np.ndarray
    slope: np.ndarray
    offset: np.ndarray
    reflected: np.ndarray
    line: np.ndarray
    held: np.ndarray
    arriving: np.ndarray
    locking: np.ndarray
    push_size: np.ndarray
    problem: Problem


class Machine(NamedTuple):
    """All that the kernels of one scene work on, as one argument."""

    tables: Tables
    supply: Supply
    work: Work


box_layout, box_tables, box_supply = record(Layout), record(Tables), record(Supply)
box_work, box_machine = record(Work), record(Machine)
