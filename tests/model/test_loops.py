"""Loops of a scene that cannot be are refused by name."""

from __future__ import annotations

import pytest
from mechanisms import four_bar

import pinfric as pf
from pinfric.errors import (
    SceneError,
)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"a": {"link": "couplet"}},
            r"loops\[0\] \(B\)\.a\.link: there is no link 'couplet'",
        ),
        ({"name": "A"}, "the name 'A' is taken"),
        ({"axis": [0, 0, 0]}, r"loops\[0\] \(B\)\.axis: .* has no direction"),
        ({"b": {"link": "coupler"}}, "both sides are on the same rigid body"),
        ({"kind": "hinge"}, "kind"),
        ({"c": 1}, r"unknown key `loops\[0\].c`"),
    ],
)
def test_bad_loops_are_refused(change, says):
    scene, _ = four_bar()
    loop = {**scene.loops[0].model_dump(), **change}
    with pytest.raises(SceneError, match=says):
        pf.Scene(model=scene.model, loops=[loop], actuators=[{"joint": "O"}])


@pytest.mark.parametrize(
    ("kind", "bearing", "says"),
    [
        ("planar_pin", {"kind": "ball", "radius": 0.01}, "a ball does not fit a planar_pin loop"),
        ("planar_pin", {"kind": "pin", "radius": 0.01, "length": 0.1}, "carries no bending moment"),
        ("revolute", {"kind": "guide", "length": 0.1}, "a guide does not fit a revolute loop"),
        ("fixed", {"kind": "pin", "radius": 0.01}, "cannot move"),
    ],
)
def test_bearings_that_do_not_fit_their_loop_are_refused(kind, bearing, says):
    scene, _ = four_bar()
    loop = {**scene.loops[0].model_dump(), "kind": kind}
    friction = {"B": {"bearing": bearing, "mu": {"static": 0.1, "kinetic": 0.1}}}
    with pytest.raises(SceneError, match=says):
        pf.Scene(model=scene.model, loops=[loop], actuators=[{"joint": "O"}], friction=friction)
