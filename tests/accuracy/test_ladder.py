"""The ladder of friction models, by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from builders import block, plane_friction

import pinfric as pf
from pinfric.accuracy.ladder import fitted_constants, ladder, solve
from pinfric.motions.trajectory import Trajectory


def sliding(scene):
    """0.5 m/s forth, then back: friction is all there is."""
    t = np.linspace(0.0, 1.0, 101)
    v = np.where(t < 0.5, 0.5, -0.5)[:, None]
    q = np.minimum(t, 1.0 - t)[:, None] * 0.5
    return Trajectory.from_arrays(scene, t, q, v, np.zeros((101, 1)))


def test_rungs_by_hand():
    entry = plane_friction(0.4, 0.3, coulomb={"static": 3.0, "kinetic": 3.0}, viscous=2.0)
    scene = pf.Scene(model=block(mass=2.0), friction={"slide": entry})
    motion = sliding(scene)
    weight = 0.3 * 2.0 * 9.81
    constants = fitted_constants(solve(scene, motion))
    assert constants["slide"] == pytest.approx(weight + 3.0 + 1.0)
    rungs = {rung.name: rung for rung in ladder(scene, motion, rounds=1)}
    assert rungs["frictionless"].us > 0
    assert rungs["constant"].rms_change == pytest.approx(weight + 4.0)
    # the reversal between two samples is an interval of standstill there: its ends differ
    assert rungs["radial load"].rms_change == pytest.approx(-4.0, rel=0.01)
    assert rungs["+ coulomb"].rms_change == pytest.approx(3.0, rel=0.02)
    assert rungs["+ viscous"].rms_change == pytest.approx(1.0, rel=0.03)
    assert rungs["+ viscous"].distance == 0.0
    assert rungs["+ viscous"].drive == "slide"
    assert not rungs["+ bending"].on
    assert not rungs["+ coupling"].on
    assert rungs["frictionless"].distance == pytest.approx(1.0)


def test_coupling_is_what_one_pass_misses():
    scene = pf.load_scene("four_bar")
    motion = pf.load_trajectory("four_bar.waypoints.yaml", scene)
    thin = slice(200, 600, 10)
    short = dataclasses.replace(
        motion,
        t=motion.t[thin],
        q=motion.q[thin],
        v=motion.v[thin],
        a=motion.a[thin],
        attached=motion.attached[thin],
    )
    rungs = {rung.name: rung for rung in ladder(scene, short, rounds=1)}
    assert rungs["+ coupling"].on
    assert np.isnan(rungs["radial load"].us)
    assert 0 < rungs["+ coupling"].distance < rungs["radial load"].distance
    # what one pass misses is of second order in the coefficients
    gentle = {
        name: entry.model_copy(update={"mu": type(entry.mu)(static=0.03, kinetic=0.03)})
        for name, entry in scene.friction.items()
    }
    rungs = ladder(dataclasses.replace(scene, friction=gentle), short, rounds=1)
    one_pass = next(rung for rung in rungs if rung.name == "radial load")
    bare = next(rung for rung in rungs if rung.name == "frictionless")
    assert one_pass.distance < 0.1 * bare.distance
