import pickle
import threading

import numpy as np
import pytest
from builders import plane_friction, sliding_block
from cases import rocker_driven_four_bar, turning_four_bar
from mechanisms import FIVE_BAR, five_bar, pin_friction
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace, workspace
from pinfric.dynamics.samples.closure import consistent_motion

# Constraints: what the constraints of a mechanism do with velocities.


@pytest.mark.parametrize("pin", range(4))
def test_one_pin_that_stops_stops_a_mechanism_of_one_freedom(pin):
    case = turning_four_bar(3)
    ws, stopped = Workspace(case.scene), np.arange(4) == pin
    for q, v in zip(case.q, 1e-8 * case.v, strict=True):
        slower, rests = ws.constraints.stop(q, v, stopped)
        assert np.abs(slower).max() < 1e-20
        assert rests.all()


def test_a_pin_that_rests_at_its_dead_centre_stops_nothing():
    """Crank and coupler are in line: the rocker's pin has no speed, and the crank turns on."""
    case = rocker_driven_four_bar([0.0])
    ws = Workspace(case.scene)
    speed = ws.constraints.rates(case.q[0], case.v[0])
    assert (np.abs(speed) < 1e-12).sum() == 1
    stopped = np.abs(speed) < 1e-12
    v, rests = ws.constraints.stop(case.q[0], case.v[0], stopped)
    assert_allclose(v, case.v[0], atol=1e-15)
    assert_array_equal(rests, stopped)


@pytest.mark.parametrize("pin", range(4))
def test_a_stop_that_would_take_away_a_speed_changes_nothing(pin):
    case, stopped = turning_four_bar(3), np.arange(4) == pin
    v, rests = Workspace(case.scene).constraints.stop(case.q[0], case.v[0], stopped)
    assert_array_equal(v, case.v[0])
    assert_array_equal(rests, stopped)


def test_a_pin_that_stops_in_a_fast_mechanism_has_no_speed_left():
    scene, q = five_bar("B", dict.fromkeys(FIVE_BAR, pin_friction(0.1)))
    v = consistent_motion(scene, q[None], ["O", "A"], [[5.0, 1e-8]], [[0.0, 0.0]])[0][0]
    stopped = np.array([name == "A" for name in scene.site_names])
    slower, rests = Workspace(scene).constraints.stop(q, v, stopped)
    index = scene.joint_names.index("A")
    assert abs(slower[index]) < 1e-15
    assert 0.0 < np.abs(slower - v).max() < 1e-6
    assert_array_equal(rests, stopped)


# Workspace: workspaces: of their own for each thread, and unchanged from call to call.


def test_nothing_of_an_instant_changes_with_the_next_call():
    scene = sliding_block(plane_friction(0.35, 0.3), 0.5)
    first = pf.forward_dynamics(scene, [0.0], [1.0], [0.0])
    kept = [np.copy(x) for x in first]
    pf.forward_dynamics(scene, [0.3], [-2.0], [5.0])
    for now, then in zip(first, kept, strict=True):
        assert_array_equal(now, then)


def test_threads_and_pickles_have_workspaces_of_their_own():
    scene = sliding_block(plane_friction(0.35, 0.3), 0.5)
    mine = workspace(scene)
    assert workspace(scene) is mine
    other: list[Workspace] = []
    thread = threading.Thread(target=lambda: other.append(workspace(scene)))
    thread.start()
    thread.join()
    assert other[0] is not mine
    copied = pickle.loads(pickle.dumps(scene))
    a = [pf.forward_dynamics(s, [0.0], [1.0], [0.0]).a[0] for s in (scene, copied)]
    assert a[0] == a[1]


def test_the_last_solution_is_no_guess_where_there_may_be_several(monkeypatch):
    """Newton's method found another solution from it; a search depends on the state alone."""
    scene = sliding_block(plane_friction(0.35, 0.3), 0.5)
    ws, guesses = Workspace(scene), []
    seek = Workspace.search
    monkeypatch.setattr(
        Workspace, "search", lambda ws: (guesses.append(ws.modes.friction[0]), seek(ws))[1]
    )
    ws.solve(np.zeros(1), np.ones(1), np.zeros(1))
    ws.solve(np.zeros(1), np.zeros(1), np.full(1, 20.0))
    assert np.isnan(guesses).all()
    assert len(guesses) == 1
