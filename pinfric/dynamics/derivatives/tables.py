"""What the kernels of derivatives read, and where they write."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.dynamics.problem.machine import Machine
from pinfric.dynamics.samples.motor_torques import scene_gears
from pinfric.kernels.arrays import array, make
from pinfric.kernels.compiled import record
from pinfric.model.drives import Gears, lossy_gears
from pinfric.model.mass_matrix import bodies
from pinfric.model.scene import Scene, SiteTables
from pinfric.model.twin import Twin


class Tables(NamedTuple):
    """Constants of one scene, and buffers; nr = nf + ns + 1 rows, in pairs least before greatest.

    Attributes:
        sites: `Scene.site_tables`. gears: of its drives.
        delivery, rate: (na, nv) of the drives: efforts u = P tau, rates S v.
        carries: (nj, nj) bool, whether joint j carries joint k, or is k.
        mass, moment, spread: (nj,), (nj, 3), (nj, 3, 3) of each link: m, m c, int r r^T dm about
            its joint's origin, in its axes.
        velocity, acceleration, force: (1 + nj, 6) in the world, about its origin; first the ground.
        motion: (nf, 6) S of every freedom.
        carried, momentum, flow: (nj, 10), (nj, 3), (nj, 3, 3) Y, l, P of all that a joint carries.
        dv, da, df: (2, nf, 3) rotations of dV by q, v; (3, nf, 6) each dA, dF by q, v, a.
        axis, row_joint: (nr, 6), (nr,) what each row's change is along, and of which joint.
        change: (3, nr, nv) by q, v, a: wrenches along freedoms, then loads; the last row is free.
        load, gradient, by_place: (ns,), (ns, 6), (ns,) c, dc/dw in the child's frame, dc/ds.
        sharp: (ns,) bool, whether a contact force is 0 and does not stay so.
        by_load, by_rate: (2, ns) dphi/dc and dphi/dv.
        joint, joint_change: (2, nv), (2, 3, nv, nv) efforts of the joints.
        effort, effort_change: (2, na), (2, 3, na, nv).
        ideal: (na,) bool, whether a drive's gear loses nothing.
        geared, geared_change: the same of `joint_effort`. motor, motor_change: of motor torques.
        kink, joint_kink: (na,), (nv,) bool, whether derivatives are of one side.
        equation, answer: (nv + nc, ...) of accelerations and of the friction of what sticks.
        half, contact, maps: scratch.
    """

    sites: SiteTables = array("0")
    gears: Gears = array("0")
    delivery: np.ndarray = array("0")
    rate: np.ndarray = array("0")
    carries: np.ndarray = array("nj nj", bool)
    mass: np.ndarray = array("0")
    moment: np.ndarray = array("0")
    spread: np.ndarray = array("nj 3 3")
    velocity: np.ndarray = array("links 6")
    acceleration: np.ndarray = array("links 6")
    force: np.ndarray = array("links 6")
    motion: np.ndarray = array("nf 6")
    carried: np.ndarray = array("nj 10")
    momentum: np.ndarray = array("nj 3")
    flow: np.ndarray = array("nj 3 3")
    dv: np.ndarray = array("2 nf 3")
    da: np.ndarray = array("3 nf 6")
    df: np.ndarray = array("3 nf 6")
    axis: np.ndarray = array("nr 6")
    row_joint: np.ndarray = array("nr", np.int64)
    change: np.ndarray = array("3 nr nv")
    load: np.ndarray = array("ns")
    gradient: np.ndarray = array("ns 6")
    by_place: np.ndarray = array("ns")
    sharp: np.ndarray = array("ns", bool)
    by_load: np.ndarray = array("2 ns")
    by_rate: np.ndarray = array("2 ns")
    joint: np.ndarray = array("2 nv")
    joint_change: np.ndarray = array("2 3 nv nv")
    effort: np.ndarray = array("2 na")
    effort_change: np.ndarray = array("2 3 na nv")
    ideal: np.ndarray = array("na", bool)
    geared: np.ndarray = array("2 na")
    geared_change: np.ndarray = array("2 3 na nv")
    motor: np.ndarray = array("2 na")
    motor_change: np.ndarray = array("2 3 na nv")
    kink: np.ndarray = array("na", bool)
    joint_kink: np.ndarray = array("nv", bool)
    equation: np.ndarray = array("unknowns unknowns")
    answer: np.ndarray = array("unknowns columns")
    half: np.ndarray = array("3 3")
    contact: np.ndarray = array("3")
    maps: np.ndarray = array("3 6")


record_tables = record(Tables)


def make_tables(scene: Scene, twin: Twin, machine: Machine) -> Tables:
    """Make the tables of an open chain with the masses of one payload."""
    links, tree, drives = bodies(twin), machine.tree, machine.plan.drives
    nj, nv, na, ns = twin.n_joints, twin.nv, len(scene.drives), len(scene.sites)
    nc = len(machine.modes.stuck)
    x = make(
        Tables,
        nj=nj,
        links=1 + nj,
        nf=len(links.column),
        nr=len(links.column) + ns + 1,
        nv=nv,
        na=na,
        ns=ns,
        unknowns=nv + nc,
        columns=2 * nv + na,
    )
    for j in range(nj):
        k = j
        while k >= 0:
            x.carries[k, j] = True
            k = tree.parent[k]
        m, c, about = links.mass[j], links.com[j], links.inertia[j]
        second = 0.5 * np.trace(about) * np.eye(3) - about  # int r r^T dm about the com
        x.spread[j] = second + m * np.outer(c, c)
    x.acceleration[0, :3] = -tree.gravity
    x.row_joint[: len(links.joint) + ns] = np.concatenate([links.joint, scene.site_tables.joint])
    gears = scene_gears(scene, brakes=False)
    return x._replace(
        sites=scene.site_tables,
        gears=gears,
        ideal=~lossy_gears(gears),
        delivery=drives.delivery,
        rate=drives.rate_row,
        mass=links.mass,
        moment=links.mass[:, None] * links.com,
    )
