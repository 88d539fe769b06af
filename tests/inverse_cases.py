"""What the tests of dynamics/inverse share."""

from __future__ import annotations

from builders import random_friction, random_tree

import pinfric as pf


def scene_of(seed, joints=6, **more):
    model = random_tree(seed, joints)
    return pf.Scene(model=model, friction=random_friction(model, seed), **more)
