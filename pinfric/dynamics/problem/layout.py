"""Where everything of a scene stands: freedoms, actions, drives, friction and contact forces.

A tree is a linkage without loops: its actions are none. Friction acts on *coordinates*, relative
velocities: of a joint of the tree (a mimic's sites share their leader's) or along an action of a
loop's joint or of a cylinder. A site has one *entry* in the problem, a ball three, one along each
axis of frame b. Where motors drive, a gear that loses has one, too, on the coordinate that it
drives: what keeps it from moving at rest.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pinfric.dynamics.problem.motor_torques import scene_gears
from pinfric.model.couples import delivery, rate_rows
from pinfric.model.drives import Gears, gear_table, lossy_gears
from pinfric.model.laws import Laws
from pinfric.model.scene import Scene
from pinfric.model.twin import Twin


class Layout(NamedTuple):
    """The tables of a scene; nothing in it changes.

    Attributes:
        n_tree: number of joints of the tree; the loops' joints follow them, then the cylinders.
        sharing: number of joints, the loops' too: what reactions that are not unique are shared by.
        drive_v, drive_action: (na,) velocity of each drive, its action; -1 where it has none.
        balanced: (nr,) velocities that no joint drive moves: only actions balance them.
        drive_row: (na, nv) its rate per unit velocity; 0 off the joints.
        part: (na,) of its joint's effort that each joint drive delivers; 1 off the joints.
        delivery: (na, na) what of it each does where drives are coupled, else (0, 0): `couples`.
        cost: (na,) 1 / share of redundant drives, else 0.
        shifts: number of ways to shift work between drives that are not on one joint.
        freedoms: degrees of freedom that the loops leave.
        off_joint, solved: number of drives off the joints, and with the multipliers.
        gears: of the drives, where motors drive them; else without drives.
        gear_entry, gear_coordinate: (na,) of each drive's gear; -1: it loses nothing.
        joint: (ns,) row of each site's joint.
        first_entry, entry_count: (ns,) the entries of each site.
        entry_site, entry_coordinate: (ne,).
        entry_ratio: (ne,) site velocity per coordinate velocity; 1 but for mimic joints.
        entry_v, entry_action: (ne,) the same of an entry's coordinate.
        coordinate_v, coordinate_action: (nc,) the velocity of a tree's, the action of a loop's, of
            a cylinder's or of another drive off the joints; -1, both of a coupled gear's.
        coordinate_row: (nc, nv) its rate per unit velocity; 0 along an action.
        viscous: (nc,) N m s/rad or N s/m.
        dry: (nc,) bool, whether anything on it can stick.
        stick_velocity: (nc,) at or below this speed it is at rest (rad/s or m/s).
        block, ball: (nc,) first coordinate of its joint; whether that is a ball.
        laws: of the sites. constant: (ns,) constant part of each load.
        contact_site: (nt,) site of each contact force. contact_rank: rows of its maps.
        contact_map, contact_map_moved: (nt, 3, 6), see `bearings.Contacts`.
        displacement_q, displacement_ratio, displacement_shift: (ns,) how a site's displacement
            along its axis follows from q; ratio 0 where it does not matter.
        rubs: (ns,) whether its friction depends on its load.
        varies: (ns,) whether, with the motion given, its load depends on friction, too.
        guides: sites whose bearing cannot resist a moment about its axis.
        roll_lever: (ns,) length that such a moment is compared with (m).
        inverse_length: 1/l of the weights that share reactions of redundant closures (1/m).
        scale: size of the levers and directions in Jacobians; what is small beside it is 0.
    """

    n_tree: int
    sharing: int
    drive_v: np.ndarray
    drive_action: np.ndarray
    balanced: np.ndarray
    drive_row: np.ndarray
    part: np.ndarray
    delivery: np.ndarray
    cost: np.ndarray
    shifts: int
    freedoms: int
    off_joint: int
    solved: int
    gears: Gears
    gear_entry: np.ndarray
    gear_coordinate: np.ndarray
    joint: np.ndarray
    first_entry: np.ndarray
    entry_count: np.ndarray
    entry_site: np.ndarray
    entry_coordinate: np.ndarray
    entry_ratio: np.ndarray
    entry_v: np.ndarray
    entry_action: np.ndarray
    coordinate_v: np.ndarray
    coordinate_action: np.ndarray
    coordinate_row: np.ndarray
    viscous: np.ndarray
    dry: np.ndarray
    stick_velocity: np.ndarray
    block: np.ndarray
    ball: np.ndarray
    laws: Laws
    constant: np.ndarray
    contact_site: np.ndarray
    contact_rank: np.ndarray
    contact_map: np.ndarray
    contact_map_moved: np.ndarray
    displacement_q: np.ndarray
    displacement_ratio: np.ndarray
    displacement_shift: np.ndarray
    rubs: np.ndarray
    varies: np.ndarray
    guides: np.ndarray
    roll_lever: np.ndarray
    inverse_length: float
    scale: float

    @property
    def coordinate(self) -> np.ndarray:
        """(ns,) first coordinate of each site."""
        return np.asarray(self.entry_coordinate[self.first_entry])

    @property
    def off_joints(self) -> bool:
        """Whether friction acts where a loop closes, along a cylinder, or in a coupled gear."""
        return bool((self.coordinate_v < 0).any())


def make_layout(scene: Scene, motors: bool = False) -> Layout:
    """Tabulate a scene.

    Args:
        scene: the robot with its friction and drives.
        motors: whether torques of motors are given, so that gears take part; else efforts.
    """
    linkage, sites, t = scene.linkage, scene.sites, scene.site_tables
    n_tree = scene.model.njoints - 1
    drive_v = np.array([d.velocity_index for d in scene.drives], dtype=np.int64)
    drive_action = np.array([d.column for d in scene.drives], dtype=np.int64)
    part, cost, shifts = _shares(scene, drive_v)
    bearings = [site.friction.bearing for site in sites]
    levers = [None if bearing is None else bearing.roll_lever() for bearing in bearings]
    rubs = t.laws.loaded & np.isin(np.arange(len(sites)), t.contacts.site)
    # with the motion given, a tree joint's wrench changes with what is solved for only
    felt = np.zeros(n_tree, dtype=bool)
    if linkage is not None:
        felt = np.abs(linkage.support).max(axis=0, initial=0) > 0
    feels = np.array([s.pair >= 0 or bool(felt[s.joint]) for s in sites], dtype=bool)
    return Layout(
        n_tree=n_tree,
        sharing=n_tree + len(scene.loops),
        drive_v=drive_v,
        drive_action=drive_action,
        balanced=np.setdiff1d(np.arange(scene.model.nv), drive_v[drive_v >= 0]).astype(np.int64),
        drive_row=rate_rows(scene.drives, scene.model.nv),
        part=part,
        delivery=delivery(scene.drives, scene.model.nv),
        cost=cost,
        shifts=shifts,
        freedoms=scene.mobility.freedoms,
        off_joint=0 if linkage is None else linkage.off_joint,
        solved=0 if linkage is None else linkage.solved,
        joint=np.ascontiguousarray(t.joint),
        laws=t.laws,
        constant=t.contacts.constant,
        contact_site=t.contacts.site,
        contact_rank=t.contacts.rank,
        contact_map=t.contacts.map,
        contact_map_moved=t.contacts.map_moved,
        rubs=rubs,
        varies=rubs & feels,
        guides=np.array([s for s, lever in enumerate(levers) if lever is not None], dtype=np.int64),
        roll_lever=np.array([lever or 0.0 for lever in levers], dtype=float),
        inverse_length=1.0 / scene.redundancy_length,
        scale=1.0 if linkage is None else min(1.0, linkage.size),
        **_coordinates(scene, motors),
        **_displacements(scene.twin(), t.joint, t.contacts.moves),
    )


def make_inverse_layout(scene: Scene) -> Layout:
    """Tabulate a scene with an imagined drive, after its own, on what no drive moves.

    A motion that the scene can do needs none of them.
    """
    layout, undriven = make_layout(scene), np.array(scene.mobility.undriven, dtype=np.int64)
    count = len(undriven)
    if not count:
        return layout
    P = layout.delivery
    if P.size:
        P = np.block([[P, np.zeros((len(P), count))], [np.zeros((count, len(P))), np.eye(count)]])
    return layout._replace(
        delivery=P,
        drive_v=np.concatenate([layout.drive_v, undriven]),
        drive_action=np.concatenate([layout.drive_action, np.full(count, -1)]),
        balanced=np.setdiff1d(layout.balanced, undriven),
        part=np.concatenate([layout.part, np.ones(count)]),
        cost=np.concatenate([layout.cost, np.zeros(count)]),
    )


def _shares(scene: Scene, drive_v: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Part, cost and shifts: how redundant drives share the work, where all of them say so."""
    mobility = scene.mobility
    share, cost = np.ones(len(drive_v)), np.zeros(len(drive_v))
    if not mobility.redundant:
        return share, cost, 0
    for d in mobility.redundant:
        share[d] = scene.drives[d].share or 1.0
        cost[d] = 1.0 / share[d]
    together = np.where(drive_v[:, None] < 0, np.eye(len(drive_v)), drive_v[:, None] == drive_v)
    on_joints = len(np.unique(drive_v[drive_v >= 0]))
    driven = mobility.freedoms - len(mobility.undriven)
    shifts = on_joints + int((drive_v < 0).sum()) - driven
    return share / (together @ share), cost, shifts


#: What a coordinate's rate is: that of a velocity, of an action, or of a coupled drive; else -1.
_Key = tuple[int, int, int]


def _coordinates(scene: Scene, motors: bool) -> dict[str, Any]:
    """Entries of all sites and gears, and the coordinates they act on."""
    laws, linkage = scene.site_tables.laws, scene.linkage
    keys: list[_Key] = []
    entries: list[tuple[int, int, float]] = []  # (site, coordinate, ratio)
    first, count = [], []
    for s, site in enumerate(scene.sites):
        first.append(len(entries))
        count.append(3 if site.ball else 1)
        for i in range(count[-1]):
            key = (int(site.velocity_index), -1, -1)
            if site.pair >= 0:
                assert linkage is not None
                key = (-1, int(linkage.friction_column[site.pair]) + i, -1)
            if key not in keys:
                keys.append(key)
            entries.append((s, keys.index(key), float(site.ratio)))
    geared = _gear_coordinates(scene, keys, len(entries), motors)
    nc = len(keys)
    dry, stick, viscous = np.zeros(nc, dtype=bool), np.full(nc, np.inf), np.zeros(nc)
    block, ball = np.arange(nc), np.zeros(nc, dtype=bool)
    for s, c, ratio in entries:
        viscous[c] += ratio**2 * laws.viscous[s]
        ball[c] = scene.sites[s].ball
        block[c] = min(block[c], entries[first[s]][1])
        if laws.dry[s]:
            dry[c], stick[c] = True, min(stick[c], laws.stick_velocity[s] / abs(ratio))
    rows, S = np.zeros((nc, scene.model.nv)), rate_rows(scene.drives, scene.model.nv)
    for c, (v, _, drive) in enumerate(keys):
        if drive >= 0:
            rows[c] = S[drive]
        elif v >= 0:
            rows[c, v] = 1.0
    for c, slowest in zip(geared["gear_coordinate"], geared["gears"].stick_velocity, strict=True):
        if c >= 0:
            dry[c], stick[c] = True, min(stick[c], slowest)
    return geared | {
        "first_entry": np.array(first, dtype=np.int64),
        "entry_count": np.array(count, dtype=np.int64),
        "entry_site": np.array([s for s, _, _ in entries], dtype=np.int64),
        "entry_coordinate": np.array([c for _, c, _ in entries], dtype=np.int64),
        "entry_ratio": np.array([ratio for _, _, ratio in entries], dtype=float),
        "entry_v": np.array([keys[c][0] for _, c, _ in entries], dtype=np.int64),
        "entry_action": np.array([keys[c][1] for _, c, _ in entries], dtype=np.int64),
        "coordinate_v": np.array([key[0] for key in keys], dtype=np.int64),
        "coordinate_action": np.array([key[1] for key in keys], dtype=np.int64),
        "coordinate_row": rows,
        "viscous": viscous,
        "dry": dry,
        "stick_velocity": stick,
        "block": block,
        "ball": ball,
    }


def _gear_coordinates(scene: Scene, keys: list[_Key], entries: int, motors: bool) -> dict[str, Any]:
    """Gears, their entries, which follow those of the sites, and their coordinates.

    Args:
        scene: with the drives.
        keys: of the sites' coordinates; those of gears alone are added.
        entries: of the sites.
        motors: whether motors drive.
    """
    drives = scene.drives if motors else ()
    gears = scene_gears(scene) if motors else gear_table([], [])
    entry, coordinate = np.full((2, len(drives)), -1, dtype=np.int64)
    for d in np.flatnonzero(lossy_gears(gears)):
        key = int(drives[d].velocity_index), drives[d].column, -1
        if drives[d].couples:
            key = -1, -1, int(d)
        if key[1] >= 0 and scene.linkage is not None:  # friction acts along the same line
            column = scene.linkage.friction_column[scene.linkage.column_pair[key[1]]]
            key = key if column < 0 else (-1, int(column), -1)
        if key not in keys:
            keys.append(key)
        entry[d], coordinate[d] = entries + (entry >= 0).sum(), keys.index(key)
    return {"gears": gears, "gear_entry": entry, "gear_coordinate": coordinate}


def _displacements(twin: Twin, joint: np.ndarray, moves: np.ndarray) -> dict[str, Any]:
    moves = moves & (joint < twin.n_joints)
    row = np.where(moves, joint, 0)
    return {
        "displacement_q": np.where(moves, twin.q_index[row], 0).astype(np.int64),
        "displacement_ratio": np.where(moves, twin.ratio[row], 0.0),
        "displacement_shift": np.where(moves, twin.shift[row], 0.0),
    }
