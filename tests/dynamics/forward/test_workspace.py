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
