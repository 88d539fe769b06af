"""Effects: which are on, what remains without them, and what is then not evaluated."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import random_states, random_tree
from cases import drawer_scene, turning_four_bar
from mechanisms import pin_friction
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.inverse import effort_maps, interval_ends
from pinfric.dynamics.inverse import tree as inverse_tree
from pinfric.dynamics.samples import motor_torques
from pinfric.errors import SceneError
from pinfric.model.effects import STRUCTURAL, effects, switchable, with_effects

NAMES = switchable()
EVERYTHING = yaml.safe_load("""
bearing: {kind: pin, radius: 0.05, length: 0.1}
mu: {static: 0.3, kinetic: 0.2}
stribeck: {velocity: 0.1}
coulomb: {static: 0.5, kinetic: 0.4}
viscous: 0.1
""")


def whole_scene(seed=1, joints=4):
    model = random_tree(seed, joints, sliding=0.0)
    model.addBodyFrame("tool", joints, pin.SE3.Identity(), 0)
    gear = {"ratio": 50.0, "efficiency": 0.9, "back_efficiency": 0.85, "rotor_inertia": 1e-5}
    return pf.Scene(
        model=model,
        friction={f"joint_{j}": EVERYTHING for j in range(1, joints + 1)},
        actuators=[{"joint": f"joint_{j}", "transmission": gear} for j in range(1, joints + 1)],
        payloads={"box": {"link": "tool", "mass": 2.0, "com": [0.0, 0.0, 0.1]}},
        springs=[{"kind": "torsion", "name": "coil", "joint": "joint_1", "stiffness": 5.0}],
    )


def on(scene):
    return {effect.name for effect in effects(scene) if effect.on}


def test_a_scene_with_everything_has_every_effect_and_says_why():
    found = effects(whole_scene())
    assert [e.name for e in found] == [*NAMES, *STRUCTURAL]
    assert all(e.on == (e.name in NAMES) for e in found)  # an open chain couples nothing
    why = {e.name: e.why for e in found}
    assert why["stribeck"] == "friction.joint_1.stribeck and 3 more"
    assert why["payload"] == "robot.payloads.box"
    off = effects(pf.Scene(model=random_tree(1)))
    assert not any(e.on for e in off)
    assert {e.name: e.why for e in off}["viscous"] == "no friction.<name>.viscous"


@pytest.mark.parametrize("gear", [{}, {"efficiency": 1.0, "back_efficiency": "same_loss"}])
def test_gears_without_losses_are_not_denied(gear):
    ideal = [{"joint": f"joint_{j}", "transmission": {"ratio": 50.0} | gear} for j in range(1, 5)]
    found = effects(pf.Scene(model=whole_scene().model, actuators=ideal))
    assert not any(effect.on for effect in found)
    gears = next(effect for effect in found if effect.name == "transmission")
    assert not gears.on
    assert gears.why == "actuators[].transmission have ratios only, no losses"


@pytest.mark.parametrize("name", NAMES)
def test_an_effect_taken_out_is_off_and_the_others_stay(name):
    left = on(with_effects(whole_scene(), without=[name]))
    # bending needs a load; the Stribeck curve lies between static and kinetic; a gear transmits
    follow = {"load": {"bending"}, "static": {"stribeck"}, "transmission": {"gear"}}.get(
        name, set()
    )
    assert left == set(NAMES) - {name} - follow


@pytest.mark.parametrize("name", NAMES)
def test_a_single_effect_can_be_kept(name):
    needs = {
        "bending": {"load"},
        "stribeck": {"load", "static"},
        "static": {"load"},
        "gear": {"transmission"},
    }
    kept = {name} | needs.get(name, set())
    assert on(with_effects(whole_scene(), only=kept)) == kept


def test_nothing_kept_is_pinocchios_rnea():
    scene = with_effects(whole_scene(), only=[])
    q, v, a = random_states(scene.model, 0, 5)
    data = scene.model.createData()
    expected = np.array([pin.rnea(scene.model, data, *s) for s in zip(q, v, a, strict=True)])
    found = pf.inverse_dynamics(scene, q, v, a)
    assert_allclose(found.effort_upper, expected, rtol=0, atol=1e-11)
    assert_allclose(found.motor_torque_upper * 50.0, expected, rtol=0, atol=1e-11)
    assert scene.site_names == ()


def test_each_effect_adds_what_its_formula_says():
    """One joint at v = 0.2 rad/s: the parts of phi, one by one."""
    model = random_tree(3, 1, sliding=0.0)
    scene = pf.Scene(
        model=model, friction={"joint_1": {**EVERYTHING, "stribeck": {"velocity": 0.2}}}
    )
    q, v, a = random_states(model, 0, 1)
    v[:] = 0.2

    def friction(**which):
        result = pf.inverse_dynamics(with_effects(scene, **which), q, v, a)
        return result.friction_upper[0, 0] if result.friction_upper.size else 0.0

    load = pf.inverse_dynamics(scene, q, v, a).normal_load[0, 0]
    blend = np.exp(-1.0)
    assert friction(only=["viscous"]) == pytest.approx(-0.1 * 0.2)
    assert friction(only=["coulomb"]) == pytest.approx(-0.4)
    assert friction(only=["load", "bending"]) == pytest.approx(-0.2 * load)
    everything = (0.2 + 0.1 * blend) * load + 0.4 + 0.1 * blend + 0.02
    assert friction(without=["payload"]) == pytest.approx(-everything)
    assert abs(friction(only=["load"])) < 0.2 * load  # the radial force alone


def count_calls(monkeypatch, solve):
    """How often each part of inverse dynamics is called while `solve` runs."""
    counts = {}

    def counted(module, name):
        original = getattr(module, name)

        def call(*arguments):
            counts[name] = counts.get(name, 0) + 1
            return original(*arguments)

        monkeypatch.setattr(module, name, call)

    for name in ("reactions", "write_plain_efforts"):
        counted(inverse_tree, name)
    for name in ("reactions", "map_friction"):
        counted(effort_maps, name)
    counted(motor_torques, "write_motor_torques")
    counted(interval_ends, "solve_samples")
    solve()
    return counts


@pytest.mark.parametrize(
    ("only", "expected"),
    [
        ([], {"write_plain_efforts": 1, "write_motor_torques": 1}),
        (["coulomb", "viscous"], {"write_plain_efforts": 1, "write_motor_torques": 1}),
        (["load"], {"reactions": 1, "write_motor_torques": 1}),
        (NAMES, {"reactions": 1, "write_motor_torques": 1}),
    ],
    ids=["nothing", "constant friction", "bearings", "everything"],
)
def test_what_is_off_is_not_evaluated(monkeypatch, only, expected):
    scene = with_effects(whole_scene(), only=only)
    states = random_states(scene.model, 0, 30)
    assert count_calls(monkeypatch, lambda: pf.inverse_dynamics(scene, *states)) == expected


@pytest.mark.parametrize(
    ("friction", "expected"),
    [
        ({}, {"reactions": 1, "map_friction": 1}),
        (pin_friction(0.3), {"reactions": 1, "map_friction": 1, "solve_samples": 1}),
    ],
    ids=["loops alone", "coupled"],
)
def test_loops_and_coupling_are_evaluated_where_there_are_any(monkeypatch, friction, expected):
    case = turning_four_bar(30, friction=friction)
    slides = slice(3, 12)  # no pin reverses there
    parts = {name: getattr(case, name)[slides] for name in ("t", "q", "v", "a")}
    some = dataclasses.replace(case, **parts)
    assert count_calls(monkeypatch, some.inverse) == expected


def test_loops_and_coupling_say_why_they_are_on():
    found = {e.name: e for e in effects(turning_four_bar(2).scene)}
    assert (found["loops"].on, found["loops"].why) == (True, "loops[0] (B)")
    assert (found["coupling"].on, found["coupling"].why) == (True, "friction.O.bearing and 3 more")
    off = {e.name: e for e in effects(turning_four_bar(2, friction={}).scene)}
    assert off["loops"].on
    assert (off["coupling"].on, off["coupling"].why) == (False, "no friction.<name>.bearing")
    drawer = {e.name: e for e in effects(drawer_scene(0.3))}
    assert not drawer["loops"].on
    assert drawer["coupling"].on  # pushed off its joint


def test_unknown_effects_are_refused():
    with pytest.raises(SceneError, match="'stribeck'"):
        with_effects(whole_scene(), without=["striebeck"])
    with pytest.raises(SceneError, match="either"):
        with_effects(whole_scene())
