"""Open chains: one pass, no more reactions than friction needs."""

from __future__ import annotations

import numpy as np
import pytest
from builders import random_states, random_tree
from inverse_cases import scene_of

import pinfric as pf
from pinfric.dynamics.inverse import tree as inverse_tree


def test_an_open_chain_never_iterates(monkeypatch):
    scene = scene_of(7)
    passes = []
    original = inverse_tree.reactions
    monkeypatch.setattr(
        inverse_tree, "reactions", lambda *args: (passes.append(1), original(*args))[1]
    )
    result = pf.inverse_dynamics(scene, *random_states(scene.model, 7, 100))
    assert len(passes) == 1  # one batch, looked at once
    assert (result.iterations == 0).all()
    assert (result.contraction == 0).all()


def test_constant_friction_computes_no_reactions(monkeypatch):
    model = random_tree(6)
    scene = pf.Scene(
        model=model, friction={"joint_2": {"coulomb": {"static": 2.0, "kinetic": 1.0}}}
    )
    monkeypatch.setattr(inverse_tree, "reactions", lambda *_: pytest.fail("twin was called"))
    q, v, a = random_states(model, 6, 4)
    result = pf.inverse_dynamics(scene, q, np.abs(v), a)
    np.testing.assert_allclose((result.effort_lower - result.effort_frictionless)[:, 1], 1.0)
    assert result.check().passed()
