"""Workspaces: of their own for each thread, and unchanged from call to call."""

from __future__ import annotations

import pickle
import threading

import numpy as np
from builders import block, plane_friction

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace, workspace


def test_nothing_of_an_instant_changes_with_the_next_call():
    scene = pf.Scene(model=block(0.5), friction={"slide": plane_friction(0.35, 0.3)})
    first = pf.forward_dynamics(scene, [0.0], [1.0], [0.0])
    kept = [np.copy(x) for x in first]
    pf.forward_dynamics(scene, [0.3], [-2.0], [5.0])
    for now, then in zip(first, kept, strict=True):
        np.testing.assert_array_equal(now, then)


def test_threads_and_pickles_have_workspaces_of_their_own():
    scene = pf.Scene(model=block(0.5), friction={"slide": plane_friction(0.35, 0.3)})
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
    """Newton's method found another of them from it; a search starts from the state alone."""
    scene = pf.Scene(model=block(0.5), friction={"slide": plane_friction(0.35, 0.3)})
    ws, guesses = Workspace(scene), []
    seek = Workspace.search
    monkeypatch.setattr(
        Workspace, "search", lambda ws: (guesses.append(ws.modes.friction[0]), seek(ws))[1]
    )
    ws.solve(np.zeros(1), np.ones(1), np.zeros(1))
    ws.solve(np.zeros(1), np.zeros(1), np.full(1, 20.0))
    assert np.isnan(guesses).all()
    assert len(guesses) == 1
