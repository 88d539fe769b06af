"""The maps of one instant: against Pinocchio, of a tree as a linkage, and interpreted."""

from operator import attrgetter

import numpy as np
import pinocchio as pin
import pytest
from builders import random_friction, random_states, random_tree
from mechanisms import cut_slider_crank, four_bar
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.dynamics.problem import instant
from pinfric.dynamics.problem.machine import Pinocchio
from pinfric.dynamics.samples.closure import independent_joints
from pinfric.kernels.interpreted import plain


def tree(seed, joints=7):
    model = random_tree(seed, joints)
    model.armature = np.linspace(0.0, 0.3, model.nv)
    friction = random_friction(model, seed)
    for entry in friction.values():  # a fifth of it: random guides jam otherwise
        entry["mu"] = {key: 0.2 * value for key, value in entry["mu"].items()}
    return pf.Scene(model=model, friction=friction)


def columns(model, q):
    """M by Pinocchio's RNEA, column by column, for any numbering of the joints."""
    data, zero = model.createData(), np.zeros(model.nv)
    rest = pin.rnea(model, data, q, zero, zero).copy()
    return np.array([pin.rnea(model, data, q, zero, unit) - rest for unit in np.eye(model.nv)]).T


@pytest.mark.parametrize("seed", range(8))
def test_mass_matrix_accelerations_and_wrenches_are_pinocchio_s(seed):
    scene = tree(seed)
    model = scene.model
    (q, *_), (v, *_), (u, *_) = random_states(model, seed, 1)
    ws = Workspace(scene)
    ws.assemble(q, v, u)
    M = columns(model, q)
    assert_allclose(ws.machine.maps.M, M, atol=1e-11 * np.abs(M).max())
    x = np.random.default_rng(seed).normal(size=len(ws.modes.friction))
    a = ws.machine.maps.acceleration @ np.r_[1.0, x]
    effort = u + np.bincount(ws.plan.coordinates.velocity_index, x, model.nv)
    data = model.createData()
    assert_allclose(a, pin.aba(model, data, q, v, effort), atol=1e-9 * np.abs(a).max())
    wrench = ws.machine.maps.wrench @ np.r_[1.0, x]
    wanted = pf.joint_wrenches(scene, q, v, a)[0][np.unique(ws.plan.sites.joint)]
    assert_allclose(wrench, wanted, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(6))
def test_a_tree_is_a_linkage_without_loops(seed):
    """A drive that pushes a link is a wrench from outside on a link that a joint drives."""
    free = tree(seed, 3)
    model = free.model
    link = model.names[3]
    model.addBodyFrame(link, 3, pin.SE3.Identity(), 0)
    free = pf.Scene(model=model, friction=free.friction)
    at, way = np.array([0.1, -0.2, 0.3]), np.array([0.6, 0.0, 0.8])
    drives = [{"joint": model.names[j]} for j in (1, 2)]
    drives.append(
        {"force": {"name": "push", "link": link, "xyz": at.tolist(), "direction": way.tolist()}}
    )
    linked = pf.Scene(model=model, friction=free.friction, actuators=drives)
    (q, *_), (v, *_), _ = random_states(model, seed, 1)
    for still in (False, True):
        v = 0.0 * v if still else v
        ours = pf.forward_dynamics(linked, q, v, [0.3, -0.2, 5.0])
        outside = {link: 5.0 * np.r_[way, np.cross(at, way)]}
        wanted = pf.forward_dynamics(free, q, v, [0.3, -0.2, 0.0], outside)
        size = np.abs(wanted.a).max(initial=1.0)
        assert_allclose(ours.a, wanted.a, atol=1e-10 * size)
        assert_allclose(ours.friction, wanted.friction, atol=1e-9)
        assert (ours.modes == wanted.modes).all()


def states():
    """Scenes with one moving state each: trees, some with sliding joints, loops of two kinds."""
    yield tree(1), *(x[0] for x in random_states(tree(1).model, 1, 1))
    for scene in (four_bar("A")[0], cut_slider_crank("G", "prismatic")[0]):
        q = scene.close(
            pin.integrate(
                scene.model, pin.neutral(scene.model), np.linspace(0.3, 0.9, scene.model.nv)
            )
        )
        first = independent_joints(scene, q)
        v, _ = pf.consistent_motion(scene, q[None], first, np.array([[2.0]]), np.array([[0.0]]))
        yield scene, q, v[0], np.full(len(scene.drives), 0.7)


@pytest.mark.parametrize("case", list(states()), ids=["tree", "four_bar", "slider_crank"])
def test_interpreted_maps_are_the_compiled_ones(case):
    scene, q, v, u = case
    u = np.ascontiguousarray(u[: len(scene.drives)])
    compiled, interpreted = Workspace(scene), Workspace(scene)
    for ws in (compiled, interpreted):
        ws.pinocchio.at(q, v, None)
    given = q, v, u, 0.0, instant.UNSOLVED
    assert instant.solve_instant(compiled.argument, *given)[0] == 0
    assert plain(instant.solve_instant)(interpreted.machine, *given)[0] == 0
    maps = "M", "acceleration", "wrench", "multiplier"
    numbers = "rate_free", "rate_slope", "contact", "mu_slip", "coulomb_slip", "drag"
    for name in (*(f"maps.{one}" for one in maps), *(f"problem.{one}" for one in numbers)):
        ours, theirs = (attrgetter(name)(ws.machine) for ws in (compiled, interpreted))
        size = np.abs(ours).max(initial=1e-9)
        assert_allclose(theirs, ours, atol=1e-12 * size, err_msg=name)


@pytest.mark.parametrize("joints", [1, 2, 6])
def test_what_pinocchio_holds_is_seen_without_a_copy_and_else_copied(joints, monkeypatch):
    twin = tree(3, joints).twin()
    (q, *_), (v, *_), _ = random_states(twin.model, 3, 1)
    live = Pinocchio(twin)
    assert live.copies == []

    def somewhere_else(self, arrays):
        out = np.zeros((len(arrays), *arrays[0].shape))
        self.copies.append((out, arrays))
        return out

    monkeypatch.setattr(Pinocchio, "_rows", somewhere_else)
    copied = Pinocchio(twin)
    assert copied.copies
    for pinocchio in (live, copied):
        pinocchio.at(q, v, None)
    data = live.data
    for ours, theirs, name in zip(live.views, copied.views, live.views._fields, strict=True):
        assert_array_equal(ours, theirs, err_msg=name)
    for j in range(twin.model.njoints):
        assert_array_equal(live.views.p[j], data.oMi[j].translation)
        assert_array_equal(live.views.force[j], data.f[j].vector)
        full = data.oYcrb[j].inertia
        assert_array_equal(live.views.inertia[j], full[np.tril_indices(3)])


def test_friction_that_is_not_a_number_gives_no_acceleration():
    ws = Workspace(tree(1))
    q, v, u = (x[0] for x in random_states(ws.scene.model, 1, 1))
    ws.solve(q, v, u)
    ws.modes.stuck[:], ws.modes.friction[:] = True, np.nan
    assert np.isnan(ws.accelerations()).all()
