"""Boxes with a body's mass and inertia."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import lump

from pinfric.model.equivalent_box import equivalent_box

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def test_box_of_equal_inertia_has_the_bodys_moments():
    edges = np.array([0.3, 0.2, 0.7])
    mass, turn = 2.5, pin.exp3(np.array([0.4, -0.2, 0.9]))
    moments = mass / 12 * (edges @ edges - edges**2)
    body = pin.Inertia(mass, np.array([0.1, 0.2, 0.3]), turn @ np.diag(moments) @ turn.T)
    box = equivalent_box(body)
    np.testing.assert_allclose(np.sort(box.edges), np.sort(edges), rtol=1e-9)
    axes = box.placement.rotation
    back = axes @ np.diag(mass / 12 * (box.edges @ box.edges - box.edges**2)) @ axes.T
    np.testing.assert_allclose(back, body.inertia, atol=1e-12)
    np.testing.assert_array_equal(box.placement.translation, body.lever)
    assert equivalent_box(pin.Inertia.Zero()) is None


@pytest.mark.parametrize(("mass", "drawn"), [(1.0, True), (1e-300, False), (1e-30, False)])
def test_an_inertia_without_mass_is_no_box_beyond_every_machine(mass, drawn):
    """0.1 kg m^2 with 1e-300 kg is a cube of 8e149 m, which single precision does not hold."""
    box = equivalent_box(lump(mass, moment=0.1))
    assert (box is not None) == drawn
    if drawn:
        np.testing.assert_allclose(box.edges, np.sqrt(0.6), rtol=1e-12)
