"""Paths that cannot be retimed are named."""

import numpy as np
import pytest
import yaml
from retime_cases import lifting, straight
from tables import table

import pinfric as pf
from pinfric.retiming.path import Path
from pinfric.retiming.retime import retime


def test_a_payload_that_is_too_heavy_is_named():
    scene, way = pf.load_scene("panda_pick_and_place"), "panda_pick_and_place.waypoints.yaml"
    move = pf.load_trajectory(way, scene)
    still = pf.inverse_dynamics(scene, move.q, 0 * move.v, 0 * move.a, attached=move.attached)
    need = np.abs(still.effort_frictionless[:, 1])
    carried = move.attached[:, 0]
    between = 0.5 * (need[~carried].max() + need[carried].max())
    limits = {name: {"effort": 200.0} for name in scene.actuator_names}
    limits["panda_joint2"] = {"effort": between}
    with pytest.raises(pf.RetimeError, match=r"stop 2, carrying box: drive 'panda_joint2' cannot"):
        retime(scene, way, limits)


WRONG = r"""
[1.5707963, 0]  {j: {peak_torque: 9}}    path: stop 1: drive 'j' cannot hold: needs 9.81 N m of it
[1.8, -1.8]     {j: {peak_torque: 9}}    stop 0: drive 'j' cannot hold
[1.0]           {}                       limits: none for drive 'j'
[1.0]           {j: {max_speed: 3}}      limits.j: nothing limits its torque
[1.0]           {k: {}}                  there is no drive 'k'
[1.0]           {j: {peak: 3}}           unknown key `peak`
[1.0]           {j: {stall_torque: 3}}   needs both
[4.0]           {j: {peak_torque: 90}}   joint j: 4 rad at 100 % of piece 0
[1.0]           {j: no such + thing}     has no drive 'no such
[1.0]           null                     states no effort limit for 'j'
"""


@pytest.mark.parametrize(
    ("path", "limits", "message"), table(WRONG, yaml.safe_load, yaml.safe_load, str)
)
def test_what_cannot_be_is_said_in_one_line(path, limits, message):
    path = straight(*path)
    with pytest.raises(pf.PinfricError, match=message) as caught:
        retime(lifting(), path, limits)
    assert "\n" not in str(caught.value)


def test_swinging_over_a_place_where_it_could_not_stand():
    """From -100 to 100 degrees with less than the weight's moment: momentum carries it over."""
    scene = lifting()
    weak = {"j": {"peak_torque": 9.7}}
    found = retime(scene, straight(1.4, -1.4), weak)
    assert found.excess < 1e-3
    with pytest.raises(pf.RetimeError, match=r"cannot hold: needs 9.81"):
        retime(scene, straight(np.pi / 2, -1.4), weak)


def test_loops_are_refused_by_name():
    with pytest.raises(pf.RetimeError, match=r"open chains .* loop '"):
        retime(pf.load_scene("four_bar"), Path.from_waypoints([[0.0], [1.0]]))
    with pytest.raises(pf.RetimeError, match="the drive off the joints"):
        retime(pf.load_scene("drawer"), Path.from_waypoints([[0.0], [1.0]]))
