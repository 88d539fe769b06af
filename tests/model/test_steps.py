import numpy as np
import pytest
import yaml
from mechanisms import four_bar
from tables import table

import pinfric as pf
from pinfric.errors import (
    SceneError,
    UndrivenMotionError,
)
from pinfric.model.brief import screen

# Brief: short texts about an object.


def test_a_screen_keeps_its_width_whatever_it_is_told():
    text = screen("Thing", "word " * 100, {"fact": "x" * 500, "none": "", "many": "a b " * 300})
    assert max(map(len, text.splitlines())) <= 100
    assert len(text.splitlines()) <= 6
    assert "none" not in text


# Loops: loops of a scene that cannot be are refused by name.


CASES = r"""
{a: {link: couplet}}  loops\[0\] \(B\)\.a\.link: there is no link 'couplet'
{name: A}             the name 'A' is taken
{axis: [0, 0, 0]}     loops\[0\] \(B\)\.axis: .* has no direction
{b: {link: coupler}}  both sides are on the same rigid body
{kind: hinge}         kind
{c: 1}                unknown key `loops\[0\].c`
"""


@pytest.mark.parametrize(
    ("change", "says"),
    table(CASES, yaml.safe_load, str),
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


# Mobility: actuators against the freedoms that loops leave.


def scene_with(actuators, **more):
    scene, _ = four_bar()
    return pf.Scene(model=scene.model, loops=scene.loops, actuators=actuators, **more)


ROWS = """
[]  0 for 1 degree of freedom; undriven: A, where this motion needs 0.389 .* sample 0
[{joint: O}, {joint: A}]  2 for 1 degree of freedom: .*keep only 1 of O, A
null                      3 for 1 degree of freedom: .*keep only 1 of O, A, C
[{joint: X}]              joint 'X' is not there
[{joint: O}, {joint: O}]  'O' is listed twice
"""


@pytest.mark.parametrize(
    ("actuators", "says"),
    table(ROWS, yaml.safe_load, str),
)
def test_actuators_are_counted_against_the_freedoms_that_loops_leave(actuators, says):
    q = four_bar()[0].close(np.full(3, 0.5))
    with pytest.raises((SceneError, UndrivenMotionError), match=says):
        pf.inverse_dynamics(scene_with(actuators), q, np.zeros(3), np.zeros(3))
