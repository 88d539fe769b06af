"""Normal loads of contacts against the bearings' formulas in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from builders import random_friction, random_tree

import pinfric as pf
from pinfric.dynamics.judge.plain_laws import plain_normal_load

pytestmark = pytest.mark.usefixtures("interpreted_kernels")


@pytest.mark.parametrize("seed", range(8))
def test_contact_maps_give_the_normal_load(seed):
    rng = np.random.default_rng(seed)
    model = random_tree(seed, 6, sliding=0.5)
    scene = pf.Scene(model=model, friction=random_friction(model, seed))
    contacts = scene.site_tables.contacts
    for k, site in enumerate(scene.sites):
        B, C = contacts.map[contacts.site == k], contacts.map_moved[contacts.site == k]
        wrench, s = rng.normal(size=6) * 10, float(rng.normal())
        load = contacts.constant[k] + np.linalg.norm((B + s * C) @ wrench, axis=1).sum()
        assert load == pytest.approx(plain_normal_load(site, wrench, s), rel=1e-13)
