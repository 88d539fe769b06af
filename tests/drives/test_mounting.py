"""How a robot is mounted, and drives for any mounting."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, example, lump
from sizing_cases import GEAR, MOTOR, write_catalog

import pinfric as pf
from pinfric.drives.mounting import mounting, mountings
from pinfric.sizing.summary import sizing_summary

G = 9.81
BRAKE = {"source": "invented", "grade": "R", "torque": 0.2, "mass": 0.2, "rotor_inertia": 1e-6}


def slew(gravity):
    """An arm about a vertical axis, its centre of mass 0.3 m off it."""
    model = chain(("slew", pin.JointModelRZ(), lump(3.0, [0.3, 0.0, 0.0])))
    model.gravity.linear[:] = gravity
    return pf.Scene(model=model, stick_velocity=1e-9)


@pytest.mark.parametrize(
    ("gravity", "words"),
    [
        ((0, 0, -G), "standing"),
        ((0, 0, G), "hanging"),
        ((G, 0, 0), "on a wall"),
        ((0, -0.6 * G, -0.8 * G), "tilted by 36.9 degrees"),
        ((0, 0, 0), "without gravity"),
    ],
)
def test_the_scenes_gravity_says_how_it_is_mounted(gravity, words):
    scene = slew(gravity)
    assert mounting(scene) == words
    others = np.array(list(mountings(scene).values()))
    assert len(others) == {"tilted by 36.9 degrees": 6, "without gravity": 0}.get(words, 5)


def test_any_mounting_asks_for_what_the_hardest_one_takes(tmp_path):
    """Standing the arm weighs nothing about its axis; on a wall 8.8 N m: motor and brake."""
    bare = {**MOTOR, "thermal": None}
    motors = {f"M{c}": {**bare, "continuous_torque": c, "mass": c} for c in (0.05, 1.0)}
    path = write_catalog(tmp_path / "c.yaml", motors, {"G": GEAR}, brakes={"B": BRAKE})
    t = np.linspace(0.0, 1.0, 101)
    q = 0.02 * np.sin(2 * np.pi * t)[:, None]

    def sized(gravity, **given):
        scene = slew(gravity)
        motion = pf.Trajectory.from_arrays(scene, t, q)
        conditions = {"inertia_ratio": 1e3, "thermal_time": 1.0, **given}
        return pf.size(scene, motion, path, conditions=conditions, on_miss="ignore")

    found = {
        (words, given): sized(gravity, mounting=given)
        for words, gravity in (("standing", (0, 0, -G)), ("wall", (0, G, 0)))
        for given in ("scene", "any")
    }
    drives = {key: report.joints[0].choice.candidate for key, report in found.items()}
    assert (drives["standing", "scene"].motor, drives["standing", "scene"].brake) == ("M0.05", "")
    for key in (("standing", "any"), ("wall", "scene"), ("wall", "any")):
        assert (drives[key].motor, drives[key].brake) == ("M1.0", "B")
    assert any("for all six ways" in note for note in found["standing", "any"].notes)


def test_cycles_of_scenes_with_another_gravity_ask_for_the_hardest_by_joint(tmp_path):
    """A slew and a lift: on the wall the slew bears weight, standing only the lift does.

    The wall's cycle is another motion with other samples; each joint must bear what a sizing of
    that scene alone gives.
    """
    motors = {
        f"M{c}": {**MOTOR, "thermal": None, "continuous_torque": c, "mass": c} for c in (0.05, 1)
    }
    path = write_catalog(
        tmp_path / "c.yaml", motors, {"G": GEAR}, brakes={"B": {**BRAKE, "torque": 0.5}}
    )
    body = lump(3.0, [0.3, 0.0, 0.0])
    model = chain(("slew", pin.JointModelRZ(), body), ("lift", pin.JointModelRY(), body))
    floor = pf.Scene(model=model, stick_velocity=1e-9, source="floor.yaml")
    wall = dataclasses.replace(floor.with_(gravity=[0, G, 0]), source="wall.yaml")
    motions = []
    for scene, samples, size in ((floor, 101, 0.02), (wall, 61, 0.03)):
        t = np.linspace(0.0, 1.0, samples)
        q = size * np.sin(2 * np.pi * t)[:, None] * np.ones(2)
        motions.append(pf.Trajectory.from_arrays(scene, t, q))
    given = {"conditions": {"inertia_ratio": 1e3, "thermal_time": 1.0}, "on_miss": "ignore"}
    there = pf.Duty(((motions[1], 1),))
    both = pf.size(floor, pf.Duty(((motions[0], 1),), elsewhere=((wall, there),)), path, **given)
    alone = [
        pf.size(scene, motion, path, **given)
        for scene, motion in zip((floor, wall), motions, strict=True)
    ]
    table = [(x.rms_in, x.peak_in) for x in sizing_summary(both).mountings]
    assert table == [("wall.yaml", "wall.yaml"), ("floor.yaml", "floor.yaml")]
    for k, (joint, hard) in enumerate(zip(both.joints, (1, 0), strict=True)):
        apart = [report.joints[k] for report in alone]
        heaviest = max(apart, key=lambda one: one.choice.candidate.mass)
        assert joint.choice.candidate.motor == heaviest.choice.candidate.motor
        assert joint.choice.candidate.brake == "B"  # the largest load of both holds it
        rms, peak = joint.mountings[("floor.yaml", "wall.yaml")[hard]]
        assert rms == pytest.approx(apart[hard].demand.rms, rel=1e-3)  # masses of drives differ
        assert peak == pytest.approx(apart[hard].demand.peak, rel=1e-3)
        assert joint.demand.rms == pytest.approx(joint.mountings["floor.yaml"][0])
    assert any("chosen for wall.yaml as well" in note for note in both.notes)
    rubbing = wall.with_(friction={"lift": {"viscous": 1.0}})
    for other, said in ((rubbing, "found: friction; copy"), (floor, "gravity is the same")):
        with pytest.raises(pf.PinfricError, match=said):
            pf.size(floor, pf.Duty(((motions[0], 1),), elsewhere=((other, there),)))


@pytest.mark.slow
def test_an_arm_for_any_mounting_is_no_lighter_than_for_one():
    scene, motion = example("ur5_pick_and_place")
    every = pf.size(scene, motion, "default", conditions={"mounting": "any"})
    for gravity in ([0, 0, -G], [0, 0, G], [G, 0, 0], [0, G, 0]):
        one = pf.size(scene.with_(gravity=gravity), motion, "default")
        pairs = zip(every.joints, one.joints, strict=True)
        assert all(a.choice.candidate.mass >= b.choice.candidate.mass for a, b in pairs)
