"""What the kernels of derivatives read, and where they write."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pinfric.dynamics.problem.machine import Machine
from pinfric.kernels.arrays import array, make
from pinfric.kernels.records import record
from pinfric.model.drives import Gears, lossy_gears
from pinfric.model.scene import Scene, SiteTables
from pinfric.model.twin import Twin


class Tables(NamedTuple):
    """Constants of one scene, and buffers; changes are by q, v, a; least before greatest.

    Attributes:
        sites: `Scene.site_tables`. gears: of its drives.
        delivery, rate: (na, nv), efforts u = P tau, rates S v.
        ideal: (na,) bool, whether a drive's gear loses nothing.
        velocity, acceleration, force: (1 + nj, 6) about the world's origin, moments first; row 0
            is the ground.
        motion: (nf, 6) S of every freedom.
        drift: (nj, 6, 3) B of all that a joint carries.
        wrench_change: (nj, 6, 3 nv) of each joint's wrench, in the world, seen from its child.
        load, gradient, by_place: (ns,), (ns, 6), (ns,) c, dc/dw in the child's frame, dc/dq.
        sharp: (ns,) bool, whether a contact force is 0 and does not stay so.
        by_load: (2, ns) dphi/dc.
        joint, joint_change: (2, nv), (2, nv, 3 nv) efforts of the joints.
        effort, effort_change: (2, na), (2, na, 3 nv).
        geared, geared_change: the same of `joint_effort`. motor, motor_change: of motor torques.
        through: (2, 3, na) derivatives of motor torques by the ends of `effort`, and the effort
            of each torque.
        kink, joint_kink: (na,), (nv,) bool, whether derivatives are one-sided.
        equation, answer: (nv + nc, ...) of accelerations and of sticking friction.
        row, contact, maps: scratch.
    """

    sites: SiteTables = array("0")
    gears: Gears = array("0")
    delivery: np.ndarray = array("0")
    rate: np.ndarray = array("0")
    ideal: np.ndarray = array("0")
    velocity: np.ndarray = array("links 6")
    acceleration: np.ndarray = array("links 6")
    force: np.ndarray = array("links 6")
    motion: np.ndarray = array("nf 6")
    drift: np.ndarray = array("nj 6 3")
    wrench_change: np.ndarray = array("nj 6 changes")
    load: np.ndarray = array("ns")
    gradient: np.ndarray = array("ns 6")
    by_place: np.ndarray = array("ns")
    sharp: np.ndarray = array("ns", bool)
    by_load: np.ndarray = array("2 ns")
    joint: np.ndarray = array("2 nv")
    joint_change: np.ndarray = array("2 nv changes")
    effort: np.ndarray = array("2 na")
    effort_change: np.ndarray = array("2 na changes")
    geared: np.ndarray = array("2 na")
    geared_change: np.ndarray = array("2 na changes")
    motor: np.ndarray = array("2 na")
    motor_change: np.ndarray = array("2 na changes")
    through: np.ndarray = array("2 3 na")
    kink: np.ndarray = array("na", bool)
    joint_kink: np.ndarray = array("nv", bool)
    equation: np.ndarray = array("unknowns unknowns")
    answer: np.ndarray = array("unknowns columns")
    row: np.ndarray = array("changes")
    contact: np.ndarray = array("3")
    maps: np.ndarray = array("3 6")


record_tables = record(Tables)


def make_tables(scene: Scene, twin: Twin, machine: Machine) -> Tables:
    """Make the tables of an open chain with the masses of one payload."""
    drives, gears = machine.plan.drives, scene.gears(brakes=False)
    x = make(
        Tables,
        nj=twin.n_joints,
        links=1 + twin.n_joints,
        nf=len(machine.tree.freedom_velocity),
        nv=twin.nv,
        na=len(scene.drives),
        ns=len(scene.sites),
        changes=3 * twin.nv,
        unknowns=twin.nv + len(machine.modes.stuck),
        columns=2 * twin.nv + len(scene.drives),
    )
    x.acceleration[0, :3] = -machine.tree.gravity
    return x._replace(
        sites=scene.site_tables,
        gears=gears,
        ideal=~lossy_gears(gears),
        delivery=drives.delivery,
        rate=drives.rate_row,
    )
