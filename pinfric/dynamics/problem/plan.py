"""Indices of a scene's parts in arrays: drives, sites of friction, coordinates, contacts, closure.

Friction acts on *coordinates*, which are relative velocities: of a joint of the tree (a mimic's
sites share their leader's) or along an action of a loop's joint or of a cylinder. A site has one
*entry* in the problem; a ball has three, one along each axis of frame b. If motor torques are
given, a gear with losses also has an entry, on the coordinate that it drives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeVar, cast

import numpy as np

from pinfric.kernels.compiled import KernelArgument
from pinfric.kernels.records import record
from pinfric.model.closure import actions_of
from pinfric.model.couples import delivery, rate_rows
from pinfric.model.drives import Gears, gear_table, lossy_gears
from pinfric.model.kinematics import Actions
from pinfric.model.laws import Laws
from pinfric.model.loops import no_linkage
from pinfric.model.scene import Scene

Made = TypeVar("Made")


class Drives(NamedTuple):
    """The na drives of a scene.

    Attributes:
        velocity_index, action: (na,) velocity of each drive, its action; -1 where it has none.
        rate_row: (na, nv) its rate per unit velocity; 0 off the joints.
        delivery: (na, nv) what each delivers of the joints' efforts, see `drive_delivery`.
        cost: (na,) 1 / share of redundant drives, else 0.
        shifts: number of ways to shift work between drives that are not on one joint.
        gears: of the drives, where motors drive them; else without drives.
        gear_entry, gear_coordinate: (na,) of each drive's gear; -1: it loses nothing.
    """

    velocity_index: np.ndarray
    action: np.ndarray
    rate_row: np.ndarray
    delivery: np.ndarray
    cost: np.ndarray
    shifts: int
    gears: Gears
    gear_entry: np.ndarray
    gear_coordinate: np.ndarray


class Sites(NamedTuple):
    """The ns sites of friction.

    Attributes:
        joint: (ns,) row of each site's joint: of the tree, then of loops, then of cylinders.
        first_entry, entry_count: (ns,) its entries.
        laws: of friction. constant: (ns,) constant part of each load.
        varies: (ns,) whether, with the motion given, its load depends on friction, too.
        displacement_q, displacement_ratio, displacement_shift: (ns,) how a site's displacement
            along its axis follows from q; ratio 0 where it does not matter.
        guides: sites whose bearing cannot resist a moment about its axis.
        roll_lever: (ns,) length that such a moment is compared with (m).
    """

    joint: np.ndarray
    first_entry: np.ndarray
    entry_count: np.ndarray
    laws: Laws
    constant: np.ndarray
    varies: np.ndarray
    displacement_q: np.ndarray
    displacement_ratio: np.ndarray
    displacement_shift: np.ndarray
    guides: np.ndarray
    roll_lever: np.ndarray


class Entries(NamedTuple):
    """The friction of sites, one along each axis, ne entries; `Problem` has those of gears, too.

    Attributes:
        site, coordinate: (ne,).
        ratio: (ne,) site velocity per coordinate velocity; 1 but for mimic joints.
        velocity_index, action: (ne,) of the entry's coordinate, see `Coordinates`.
    """

    site: np.ndarray
    coordinate: np.ndarray
    ratio: np.ndarray
    velocity_index: np.ndarray
    action: np.ndarray


class Coordinates(NamedTuple):
    """The relative velocities on which friction acts, nc coordinates.

    Attributes:
        velocity_index, action: (nc,) the velocity of a tree's, the action of a loop's, of a
            cylinder's or of another drive off the joints; -1 else. A coupled gear has neither.
        rate_row: (nc, nv) its rate per unit velocity; 0 along an action.
        viscous: (nc,) N m s/rad or N s/m.
        dry: (nc,) bool, whether anything on it can stick.
        stick_velocity: (nc,) at or below this speed it is at rest (rad/s or m/s).
        block, ball: (nc,) first coordinate of its joint; whether that is a ball.
        direction_size: (nc,) 0, but for what slides: it has levers for directions, all of which
            vanish at a dead centre (m).
    """

    velocity_index: np.ndarray
    action: np.ndarray
    rate_row: np.ndarray
    viscous: np.ndarray
    dry: np.ndarray
    stick_velocity: np.ndarray
    block: np.ndarray
    ball: np.ndarray
    direction_size: np.ndarray


class ContactForces(NamedTuple):
    """The nt contact forces as functions of nr wrenches.

    Attributes:
        joint: (nr,) the joints whose wrenches are wanted; where reactions are shared, all of the
            tree and of loops, and first.
        site_row: (ns,) row of each site's joint among them.
        owner, site: (nt,) whose load each force adds to, the site that is at. The owner is the
            entry in forward dynamics, the site in inverse dynamics.
        rank: (nt,) how many rows of its map are used.
        map, map_moved: (nt, 3, 6), see `bearings.Contacts`.
    """

    joint: np.ndarray
    site_row: np.ndarray
    owner: np.ndarray
    site: np.ndarray
    rank: np.ndarray
    map: np.ndarray
    map_moved: np.ndarray


class Closure(NamedTuple):
    """How loops, cylinders and forces join the links of the tree.

    Attributes:
        actions: of loops and drives off the joints.
        off_joint, multipliers: number of drives off the joints, which come first among the
            actions, and of multipliers, which follow them.
        balanced: (nr,) velocities that no joint drive moves: only actions balance them.
        freedoms: degrees of freedom that the loops leave.
        dependent: whether coordinates may depend on each other: loops close, or friction acts
            along a cylinder or in a coupled gear.
        shared: number of joints, the loops' too, that share reactions; 0 where they are unique.
        inverse_length: 1/l of the weights that share reactions of redundant closures (1/m).
        scale: size of the levers and directions in Jacobians; what is small beside it is 0.
        planar: (number of loops,) whether the axes of a loop's sides must be parallel unforced.
    """

    actions: Actions
    off_joint: int
    multipliers: int
    balanced: np.ndarray
    freedoms: int
    dependent: bool
    shared: int
    inverse_length: float
    scale: float
    planar: np.ndarray

    @property
    def solved(self) -> int:
        """Number of efforts off the joints and multipliers, which are solved for together."""
        return self.off_joint + self.multipliers


class Plan(NamedTuple):
    """A scene as constant arrays."""

    drives: Drives
    sites: Sites
    entries: Entries
    coordinates: Coordinates
    contacts: ContactForces
    closure: Closure

    @property
    def site_coordinate(self) -> np.ndarray:
        """(ns,) first coordinate of each site."""
        return np.asarray(self.entries.coordinate[self.sites.first_entry])

    @property
    def off_joints(self) -> bool:
        """Whether friction acts where a loop closes, along a cylinder, or in a coupled gear."""
        return bool((self.coordinates.velocity_index < 0).any())


for _part in (Drives, Sites, Entries, Coordinates, ContactForces, Closure, Plan):
    record(_part)


def make_plan(scene: Scene, motors: bool = False) -> Plan:
    """Number the parts of a scene for forward dynamics.

    Args:
        motors: whether torques of motors are given, so that gears take part; else efforts.
    """
    rubs = scene.site_tables.laws.loaded & np.isin(
        np.arange(len(scene.sites)), scene.site_tables.contacts.site
    )
    keys, entries, sites = _number_entries(scene, rubs)
    drives = _number_drives(scene, keys, len(entries.site), motors)
    coordinates = _tabulate_coordinates(scene, keys, entries, sites, drives)
    off_joints = any(v < 0 for v, *_ in keys)
    closure = _close(scene, drives.velocity_index, off_joints)
    contact_site = scene.site_tables.contacts.site
    chosen = [
        (e, i)
        for e, s in enumerate(entries.site)
        for i in np.flatnonzero(contact_site == s)
        if rubs[s]
    ]
    owner, force = np.array(chosen, dtype=np.int64).reshape(-1, 2).T
    contacts = _choose_contacts(scene, closure, np.ascontiguousarray(owner), force)
    return Plan(drives, sites, entries, coordinates, contacts, closure)


def make_inverse_plan(scene: Scene) -> Plan:
    """Number the parts of a scene for inverse dynamics.

    Each undriven coordinate gets an imaginary drive, after the scene's own, of which a possible
    motion needs no effort. Each contact force loads its site.
    """
    plan, undriven = make_plan(scene), np.array(scene.mobility.undriven, dtype=np.int64)
    site = scene.site_tables.contacts.site
    plan = plan._replace(contacts=_choose_contacts(scene, plan.closure, site, np.arange(len(site))))
    count = len(undriven)
    if not count:
        return plan
    drives, closure = plan.drives, plan.closure
    return plan._replace(
        drives=drives._replace(
            velocity_index=np.concatenate([drives.velocity_index, undriven]),
            action=np.concatenate([drives.action, np.full(count, -1)]),
            delivery=np.vstack([drives.delivery, np.eye(scene.model.nv)[undriven]]),
            cost=np.concatenate([drives.cost, np.zeros(count)]),
        ),
        closure=closure._replace(balanced=np.setdiff1d(closure.balanced, undriven)),
    )


def kept_plan(scene: Scene, asked: str) -> KernelArgument[Plan]:
    """Return a plan, made at first.

    Args:
        asked: "inverse", or what forward dynamics is given: "effort" or "motor_torque".
    """

    def made() -> KernelArgument[Plan]:
        inverse, motors = asked == "inverse", asked == "motor_torque"
        return KernelArgument(make_inverse_plan(scene) if inverse else make_plan(scene, motors))

    return _kept(scene, asked, made)


def drive_delivery(scene: Scene) -> np.ndarray:
    """Return P (na, nv): u = P tau, tau the joints' efforts; rows off the joints are 0.

    Drives of one joint share its effort (`_shares`); coupled ones see `couples.delivery`.
    """

    def made() -> np.ndarray:
        alone = [replace(drive, couples=()) for drive in scene.drives]
        own, P = rate_rows(alone, scene.model.nv), delivery(scene.drives, scene.model.nv)
        return np.asarray(P @ own if P.size else _shares(scene)[0][:, None] * own)

    return _kept(scene, "delivery", made)


def _kept(scene: Scene, what: str, make: Callable[[], Made]) -> Made:
    """Return what is made once for a scene; of scenes that share a twin, for the last one."""
    pools, key = scene.twin().pools, ("plan", what)
    known, value = pools.get(key, (None, None))
    if known is not scene:
        value = make()
        pools[key] = scene, value
    return cast("Made", value)


#: What a coordinate's rate is: that of a velocity, of an action, or of a coupled drive; else -1.
_Key = tuple[int, int, int]


def _number_entries(scene: Scene, rubs: np.ndarray) -> tuple[list[_Key], Entries, Sites]:
    """Return the sites' coordinates, entries and sites.

    `rubs`: (ns,) whether a site's friction depends on its load.
    """
    linkage, tables = scene.linkage, scene.site_tables
    keys: list[_Key] = []
    numbered: list[tuple[int, int, float]] = []  # (site, coordinate, ratio)
    first = []
    for s, site in enumerate(scene.sites):
        first.append(len(numbered))
        for i in range(3 if site.ball else 1):
            key = (int(site.velocity_index), -1, -1)
            if site.pair >= 0:
                assert linkage is not None
                key = (-1, int(linkage.friction_column[site.pair]) + i, -1)
            if key not in keys:
                keys.append(key)
            numbered.append((s, keys.index(key), float(site.ratio)))
    entries = Entries(
        site=np.array([s for s, _, _ in numbered], dtype=np.int64),
        coordinate=np.array([c for _, c, _ in numbered], dtype=np.int64),
        ratio=np.array([ratio for _, _, ratio in numbered], dtype=float),
        velocity_index=np.array([keys[c][0] for _, c, _ in numbered], dtype=np.int64),
        action=np.array([keys[c][1] for _, c, _ in numbered], dtype=np.int64),
    )
    bearings = [site.friction.bearing for site in scene.sites]
    levers = [None if bearing is None else bearing.roll_lever() for bearing in bearings]
    # with the motion given, a tree joint's wrench changes with what is solved for only
    felt = np.zeros(scene.model.njoints - 1, dtype=bool)
    if linkage is not None:
        felt = np.abs(linkage.support).max(axis=0, initial=0) > 0
    feels = np.array([s.pair >= 0 or bool(felt[s.joint]) for s in scene.sites], dtype=bool)
    twin, joint = scene.twin(), np.ascontiguousarray(tables.joint)
    moves = tables.contacts.moves & (joint < twin.n_joints)
    row = np.where(moves, joint, 0)
    return (
        keys,
        entries,
        Sites(
            joint=joint,
            first_entry=np.array(first, dtype=np.int64),
            entry_count=np.diff([*first, len(numbered)]).astype(np.int64),
            laws=tables.laws,
            constant=tables.contacts.constant,
            varies=rubs & feels,
            displacement_q=np.where(moves, twin.q_index[row], 0).astype(np.int64),
            displacement_ratio=np.where(moves, twin.ratio[row], 0.0),
            displacement_shift=np.where(moves, twin.shift[row], 0.0),
            guides=np.array(
                [s for s, lever in enumerate(levers) if lever is not None], dtype=np.int64
            ),
            roll_lever=np.array([lever or 0.0 for lever in levers], dtype=float),
        ),
    )


def _number_drives(scene: Scene, keys: list[_Key], entries: int, motors: bool) -> Drives:
    """Return drives, and the entries of their gears, which follow those of the sites.

    Args:
        keys: of the sites' coordinates; those of gears alone are added.
        entries: of the sites.
        motors: whether motors drive.
    """
    velocity_index = np.array([d.velocity_index for d in scene.drives], dtype=np.int64)
    _, cost, shifts = _shares(scene)
    geared = scene.drives if motors else ()
    gears = scene.gears() if motors else gear_table([], [])
    entry, coordinate = np.full((2, len(geared)), -1, dtype=np.int64)
    for d in np.flatnonzero(lossy_gears(gears)):
        key = int(geared[d].velocity_index), geared[d].column, -1
        if geared[d].couples:
            key = -1, -1, int(d)
        if key[1] >= 0 and scene.linkage is not None:  # friction acts along the same line
            column = scene.linkage.friction_column[scene.linkage.column_pair[key[1]]]
            key = key if column < 0 else (-1, int(column), -1)
        if key not in keys:
            keys.append(key)
        entry[d], coordinate[d] = entries + (entry >= 0).sum(), keys.index(key)
    return Drives(
        velocity_index=velocity_index,
        action=np.array([d.column for d in scene.drives], dtype=np.int64),
        rate_row=rate_rows(scene.drives, scene.model.nv),
        delivery=drive_delivery(scene),
        cost=cost,
        shifts=shifts,
        gears=gears,
        gear_entry=entry,
        gear_coordinate=coordinate,
    )


def _shares(scene: Scene) -> tuple[np.ndarray, np.ndarray, int]:
    """Each drive's part of its joint's effort, cost and shifts: how redundant drives share work."""
    velocity_index = np.array([d.velocity_index for d in scene.drives], dtype=np.int64)
    mobility, na = scene.mobility, len(velocity_index)
    share, cost = np.ones(na), np.zeros(na)
    if not mobility.redundant:
        return share, cost, 0
    for d in mobility.redundant:
        share[d] = scene.drives[d].share or 1.0
        cost[d] = 1.0 / share[d]
    same = velocity_index[:, None] == velocity_index
    together = np.where(velocity_index[:, None] < 0, np.eye(na), same)
    on_joints = len(np.unique(velocity_index[velocity_index >= 0]))
    driven = mobility.freedoms - len(mobility.undriven)
    shifts = on_joints + int((velocity_index < 0).sum()) - driven
    return share / (together @ share), cost, shifts


def _tabulate_coordinates(
    scene: Scene, keys: list[_Key], entries: Entries, sites: Sites, drives: Drives
) -> Coordinates:
    laws, linkage, nc = sites.laws, scene.linkage, len(keys)
    dry, stick, viscous = np.zeros(nc, dtype=bool), np.full(nc, np.inf), np.zeros(nc)
    block, ball = np.arange(nc), np.zeros(nc, dtype=bool)
    for s, c, ratio in zip(entries.site, entries.coordinate, entries.ratio, strict=True):
        viscous[c] += ratio**2 * laws.viscous[s]
        ball[c] = scene.sites[s].ball
        block[c] = min(block[c], entries.coordinate[sites.first_entry[s]])
        if laws.dry[s]:
            dry[c], stick[c] = True, min(stick[c], laws.stick_velocity[s] / abs(ratio))
    for c, slowest in zip(drives.gear_coordinate, drives.gears.stick_velocity, strict=True):
        if c >= 0:
            dry[c], stick[c] = True, min(stick[c], slowest)
    rows, direction_size = np.zeros((nc, scene.model.nv)), np.zeros(nc)
    for c, (v, action, drive) in enumerate(keys):
        if drive >= 0:
            rows[c] = drives.rate_row[drive]
        elif v >= 0:
            rows[c, v] = 1.0
        else:
            assert linkage is not None
            unit = linkage.unit[action]
            if action < linkage.off_joint or unit[:3].any() or not unit.any():
                direction_size[c] = min(1.0, linkage.size)
    return Coordinates(
        velocity_index=np.array([key[0] for key in keys], dtype=np.int64),
        action=np.array([key[1] for key in keys], dtype=np.int64),
        rate_row=rows,
        viscous=viscous,
        dry=dry,
        stick_velocity=stick,
        block=block,
        ball=ball,
        direction_size=direction_size,
    )


def _close(scene: Scene, velocity_index: np.ndarray, off_joints: bool) -> Closure:
    linkage = scene.linkage
    multipliers = 0 if linkage is None else linkage.multipliers
    kinds = [] if linkage is None else [loop.kind for loop in linkage.loops]
    driven = velocity_index[velocity_index >= 0]
    redundant = multipliers > scene.model.nv - scene.mobility.freedoms
    return Closure(
        actions=actions_of(scene.twin(), linkage or no_linkage(scene.model)),
        off_joint=0 if linkage is None else linkage.off_joint,
        multipliers=multipliers,
        balanced=np.setdiff1d(np.arange(scene.model.nv), driven).astype(np.int64),
        freedoms=scene.mobility.freedoms,
        dependent=multipliers > 0 or off_joints,
        shared=scene.twin().n_joints + len(scene.loops) if redundant else 0,
        inverse_length=1.0 / scene.redundancy_length,
        scale=1.0 if linkage is None else min(1.0, linkage.size),
        planar=np.array([kind == "planar_pin" for kind in kinds], dtype=bool),
    )


def _choose_contacts(
    scene: Scene, closure: Closure, owner: np.ndarray, force: np.ndarray
) -> ContactForces:
    """Return contact forces, each with its owner, and the joints whose wrenches they need.

    `owner`, `force`: (nt,) each force's owner, and which of the scene's it is.
    """
    contacts, tables = scene.site_tables.contacts, scene.site_tables
    joint = np.union1d(np.arange(closure.shared), tables.joint).astype(np.int64)
    return ContactForces(
        joint=joint,
        site_row=np.searchsorted(joint, tables.joint).astype(np.int64),
        owner=owner,
        site=contacts.site[force],
        rank=contacts.rank[force],
        map=contacts.map[force],
        map_moved=contacts.map_moved[force],
    )
