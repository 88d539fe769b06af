"""Inertias about drives and peaks of gears in stops of loops, by virtual work and Lagrange.

Loops are judged as a tree whose ends must meet: their Jacobian by differences of Pinocchio's
frames, the motions that it allows from its null space, efforts from one linear system of
accelerations, loop forces and drive efforts. Nothing of it knows the drives' own coordinates.
"""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg
from builders import example
from mechanisms import five_bar
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.drives.inertia import joint_inertias
from pinfric.dynamics.samples.states import States
from pinfric.stops.machines import Machines, full_load, stop_settings
from pinfric.stops.motion import BrakedMachine
from pinfric.stops.peaks import cycle_peaks, gear_peaks

#: Step of differences, rad.
_STEP = 1e-5
BACK, ROTOR, RATIO = 0.8, 2e-5, 20.0
GEAR = {
    "ratio": RATIO,
    "efficiency": 0.9,
    "back_efficiency": BACK,
    "rotor_inertia": ROTOR,
    "brake": {"torque": 0.3, "torque_max": 0.6, "engage_time": 0.02},
}


def two_arms():
    """A five-bar in the plane, driven at both its ground pins, at three places."""
    scene, q = five_bar("B", {})
    q = [scene.close(q + np.array([0.0, turn, 0.0, 0.0])) for turn in (0.0, 0.2, -0.3)]
    return geared(scene), (np.array(q), np.random.default_rng(1).uniform(-2.0, 2.0, (3, 2)))


def geared(scene):
    """The scene with `GEAR` at each drive."""
    drives = [{"joint": a.joint, "transmission": GEAR} for a in scene.actuators]
    return scene.with_(actuators=drives)


def three_arms():
    """The bundled delta robot at six samples of its motion."""
    scene, motion = example("delta", "delta.waypoints.yaml")
    some = np.linspace(0, len(motion.t) - 1, 6).astype(int)
    return geared(scene), (motion.q[some], np.random.default_rng(2).uniform(-3.0, 3.0, (6, 3)))


def gap(scene, model, q):
    """The ends of all loops, apart: (m,); in a plane its normal is left out."""
    data, apart = model.createData(), []
    pin.framesForwardKinematics(model, data, q)
    for loop in scene.loops:
        at = [
            data.oMf[model.getFrameId(side.link)].act(np.array(side.xyz))
            for side in (loop.a, loop.b)
        ]
        apart.append((at[0] - at[1])[: 2 if loop.kind == "planar_pin" else 3])
    return np.concatenate(apart)


def jacobian(scene, model, q):
    """(m, nv) of `gap`, by central differences."""
    rows = []
    for step in _STEP * np.eye(model.nv):
        ends = (gap(scene, model, pin.integrate(model, q, way * step)) for way in (1, -1))
        rows.append(np.subtract(*ends) / (2 * _STEP))
    return np.array(rows).T


def moved_alone(scene, model, q):
    """B (nv, na): of the motions that the loops allow, unit rate of each drive."""
    free = scipy.linalg.null_space(jacobian(scene, model, q), rcond=1e-7)
    own = [drive.velocity_index for drive in scene.drives]
    return free @ np.linalg.inv(free[own])


CASES = {"five-bar": two_arms, "delta": three_arms}


@pytest.fixture(scope="module", params=CASES)
def mechanism(request):
    return CASES[request.param]()


def test_inertia_about_a_drive_is_twice_the_energy_at_its_unit_rate(mechanism):
    scene, (q, _) = mechanism
    model = scene.model
    found = joint_inertias(scene, States(q, np.zeros((len(q), model.nv)), None))
    for k, place in enumerate(q):
        B = moved_alone(scene, model, place)
        energy = [
            pin.computeKineticEnergy(model, model.createData(), place, column) for column in B.T
        ]
        assert_allclose(found[k], 2.0 * np.array(energy), rtol=1e-6)


def by_lagrange(scene, model, q, rate, sign, closed):
    """(na,) the largest efforts of one state over all sets of drives that still move.

    M a - J^T f - D^T t = -h,   J a = -dJ/dt v,   D a = 0 of what rests,
    t = -r T_b/eta_b sign u - r^2 J_r/eta_b D a of what moves.
    """
    own = [drive.velocity_index for drive in scene.drives]
    na, nv, most = len(own), model.nv, np.zeros(len(own))
    D, B = np.eye(nv)[own], moved_alone(scene, model, q)
    data = model.createData()
    M, J = pin.crba(model, data, q), jacobian(scene, model, q)
    M = np.triu(M) + np.triu(M, 1).T
    push, heavy = RATIO * 0.6 / BACK * closed, RATIO**2 * ROTOR / BACK
    for still in product((False, True), repeat=na):
        rest = np.array(still)
        if rest.all():
            continue
        v = B @ np.where(rest, 0.0, rate)
        h, step = pin.rnea(model, data, q, v, np.zeros(nv)), _STEP * v
        ahead, back = (jacobian(scene, model, pin.integrate(model, q, s)) for s in (step, -step))
        drift = (ahead - back) @ v / (2 * _STEP)
        nc = len(J)
        A = np.zeros((nv + nc + na, nv + nc + na))
        A[:nv] = np.hstack([M, -J.T, -D.T])
        A[nv : nv + nc, :nv] = J
        A[nv + nc :, :nv] = np.where(rest[:, None], 1.0, heavy) * D
        A[nv + nc :, nv + nc :] = np.diag(~rest)
        b = np.concatenate([-h, -drift, np.where(rest, 0.0, -push * sign)])
        t = np.abs(np.linalg.solve(A, b)[nv + nc :])
        most = np.maximum(most, np.where(rest, np.minimum(t, push), t))
    return most


def test_peaks_of_a_loop_by_lagrange(mechanism):
    scene, (q, rate) = mechanism
    model, names = scene.model, scene.actuator_names
    sign = np.sign(rate)
    v = np.array([moved_alone(scene, model, x) @ u for x, u in zip(q, rate, strict=True)])
    torque, delay = dict.fromkeys(names, 0.6), dict.fromkeys(names, 0.02)
    found = gear_peaks(BrakedMachine(scene, (), {}, {}, {}, None), torque, delay, q, v, sign)
    states = zip(q, rate, sign, strict=True)
    judged = [by_lagrange(scene, model, *state, closed=1.0) for state in states]
    assert_allclose(found, judged, rtol=2e-5)


@pytest.mark.slow
def test_simulated_stops_of_a_delta_load_its_gears_as_the_algebra_says():
    scene, _ = three_arms()
    scene = scene.with_(stops={"category": 0, "reaction_time": 0.01})
    motion = pf.load_trajectory("delta.waypoints.yaml", scene)
    found = pf.stop(scene, motion)
    machines = Machines(scene, stop_settings(scene, None), full_load(scene, motion))
    algebra = cycle_peaks(machines, motion, ())
    simulated = np.array([axis.peak for axis in found.axes])
    assert_allclose(simulated / algebra, 0.97, atol=0.1)
