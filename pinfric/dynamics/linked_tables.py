"""Friction of scenes with loops or drives off the joints, tabulated for `linked.py`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.constrained import Layout
from pinfric.dynamics.rest import Mechanism
from pinfric.dynamics.workspace import cannot_resist_roll
from pinfric.model.laws import Laws
from pinfric.model.scene import Scene


@dataclass(frozen=True, eq=False)
class LinkedTables:
    """What of a linked scene the assembly needs; a ball counts three times (see `Layout`).

    Attributes:
        coordinate: (ns,) first coordinate of each site.
        ratio: (ns,) site velocity per coordinate velocity.
        entry_site: (ne,) site of each entry: one per site, three for a ball.
        entry_coordinate, entry_ratio: (ne,). laws: of each entry.
        coordinate_v, column: (nc,) velocity of a tree coordinate, action of a loop's; else -1.
        viscous: (nc,) N m s/rad or N s/m.
        dry, stick_velocity: (nc,), see `workspace.Tables`.
        contact_row: (nt,) row of the joint whose wrench makes each contact force.
        contact_site: (nt,) its entry. contact_map, contact_map_moved: (nt, 3, 6).
        displacement_q, displacement_ratio, displacement_shift: (nt,) see `workspace.Tables`.
        joint: (ns,) row of each site's joint, the loops' after the tree's.
        guides: sites whose bearing cannot resist a moment about its axis.
    """

    coordinate: np.ndarray
    ratio: np.ndarray
    entry_site: np.ndarray
    entry_coordinate: np.ndarray
    entry_ratio: np.ndarray
    laws: Laws
    coordinate_v: np.ndarray
    column: np.ndarray
    viscous: np.ndarray
    dry: np.ndarray
    stick_velocity: np.ndarray
    contact_row: np.ndarray
    contact_site: np.ndarray
    contact_map: np.ndarray
    contact_map_moved: np.ndarray
    displacement_q: np.ndarray
    displacement_ratio: np.ndarray
    displacement_shift: np.ndarray
    joint: np.ndarray
    guides: tuple[int, ...]


def make_linked_tables(scene: Scene, layout: Layout) -> tuple[LinkedTables, Mechanism]:
    """Tabulate the friction of a linked scene for the assembly."""
    sites, t, twin = scene.sites, scene.site_tables, scene.twin()
    keys: list[tuple[int, int]] = []  # (velocity, column) of each coordinate
    entry_site, entry_coordinate, entry_ratio, first = [], [], [], []
    for s, site in enumerate(sites):
        for i in range(int(layout.phi_count[s])):
            column = int(layout.phi_column[layout.phi_start[s] + i])
            key = (-1, column) if column >= 0 else (int(site.velocity_index), -1)
            if key not in keys:
                keys.append(key)
            if i == 0:
                first.append(keys.index(key))
            entry_site.append(s)
            entry_coordinate.append(keys.index(key))
            entry_ratio.append(float(site.ratio))
    entry_of, nc = np.array(entry_site, dtype=np.int64), len(keys)
    laws = t.laws.of_sites(entry_of)
    dry, stick, viscous = np.zeros(nc, dtype=bool), np.full(nc, np.inf), np.zeros(nc)
    block, ball = np.arange(nc), np.zeros(nc, dtype=bool)
    for e, (s, c) in enumerate(zip(entry_site, entry_coordinate, strict=True)):
        viscous[c] += entry_ratio[e] ** 2 * laws.viscous[e]
        if laws.dry[e]:
            dry[c] = True
            stick[c] = min(stick[c], laws.stick_velocity[e] / abs(entry_ratio[e]))
        block[c] = min(block[c], first[s])
        ball[c] = sites[s].ball
    loaded = np.flatnonzero(t.laws.loaded[layout.contact_site])
    rows = [(e, k) for e, s in enumerate(entry_site) for k in loaded if layout.contact_site[k] == s]
    entries = np.array([e for e, _ in rows], dtype=np.int64)
    terms = np.array([k for _, k in rows], dtype=np.int64)
    of = entry_of[entries] if len(rows) else np.zeros(0, dtype=np.int64)
    joint = np.asarray(t.joint)[of]
    moves = np.logical_and(t.contacts.moves[of], joint < layout.n_tree)
    tree = np.where(moves, joint, 0)
    tables = LinkedTables(
        coordinate=np.array(first, dtype=np.int64),
        ratio=np.ascontiguousarray(t.ratio),
        entry_site=entry_of,
        entry_coordinate=np.array(entry_coordinate, dtype=np.int64),
        entry_ratio=np.array(entry_ratio, dtype=float),
        laws=laws,
        coordinate_v=np.array([v for v, _ in keys], dtype=np.int64),
        column=np.array([column for _, column in keys], dtype=np.int64),
        viscous=viscous,
        dry=dry,
        stick_velocity=stick,
        contact_row=joint,
        contact_site=entries,
        contact_map=layout.contact_map[terms],
        contact_map_moved=layout.contact_map_moved[terms],
        displacement_q=np.where(moves, twin.q_index[tree], 0),
        displacement_ratio=np.where(moves, twin.ratio[tree], 0.0),
        displacement_shift=np.where(moves, twin.shift[tree], 0.0),
        joint=np.ascontiguousarray(t.joint),
        guides=tuple(s for s, site in enumerate(sites) if cannot_resist_roll(site)),
    )
    return tables, Mechanism(np.zeros((0, nc)), block, ball, np.zeros(nc, dtype=bool), np.zeros(nc))
