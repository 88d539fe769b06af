"""Samples of a sweep are single runs of the changed scene."""

import dataclasses

import numpy as np
import pytest
from builders import example
from sweep_cases import run, sweep_of, uniform

import pinfric as pf
from pinfric.motions.summary import summarize
from pinfric.sweeps.cycle import FIGURES


def test_samples_are_single_runs_of_the_changed_scene():
    scene, motion = example("panda_pick_and_place", "panda_pick_and_place.csv")
    found = run(
        scene,
        motion,
        sweep_of(
            3,
            friction__panda_joint2__viscous=uniform(0.0, 3.0),
            **{
                "friction.panda_joint[45].coulomb": uniform(0.5, 2.0, each=True),
                "transmission.*.no_load_torque": uniform(0.5, 2.0),
                "payload.box.com.z": uniform(0.0, 0.2),
                "payload.box.mass": uniform(1.0, 3.0),
            },
            speed=uniform(0.5, 1.0),
            mounting__roll=uniform(0.5, 1.0),
            mounting__pitch=uniform(-1.0, -0.5),
        ),
    )
    assert found.parameter_names == (
        "friction.panda_joint2.viscous",
        "friction.panda_joint4.coulomb",
        "friction.panda_joint5.coulomb",
        "transmission.*.no_load_torque",
        "payload.box.com.z",
        "payload.box.mass",
        "speed",
        "mounting.roll",
        "mounting.pitch",
    )
    for values, figures in zip(found.values, found.figures, strict=True):
        friction = {
            name: entry.model_dump(exclude_none=True, exclude_unset=True)
            for name, entry in scene.friction.items()
        }
        friction["panda_joint2"]["viscous"]["coefficient"] *= values[0]
        for name, factor in (("panda_joint4", values[1]), ("panda_joint5", values[2])):
            for key in ("static", "kinetic"):
                friction[name]["coulomb"][key] *= factor
        actuators = [a.model_dump(exclude_none=True) for a in scene.actuators]
        for actuator in actuators:
            for key in ("static", "kinetic"):
                actuator["transmission"]["no_load_torque"][key] *= values[3]
        box = scene.payloads["box"].model_dump()
        box["com"] = (0.0, 0.0, values[4])
        box["inertia"] = [x * values[5] / box["mass"] for x in box["inertia"]]
        box["mass"] = values[5]
        roll, pitch = values[7:]
        turned = scene.model.copy()
        down = [np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)]
        turned.gravity.linear = 9.81 * np.array(down)  # in the axes of the turned base
        changed = dataclasses.replace(
            scene, model=turned, friction=friction, actuators=actuators, payloads={"box": box}
        )
        scaled = motion.with_speed(values[6])
        for row, s in zip(
            figures, summarize(pf.inverse_dynamics(changed, scaled, threads=1)), strict=True
        ):
            by_name = dict(zip(FIGURES, row, strict=True))
            for name in ("peak", "rms", "motor_peak", "motor_rms"):
                assert by_name[name] == pytest.approx(getattr(s, name), rel=1e-12), name
    np.testing.assert_allclose(
        found.figure("speed"), np.abs(motion.v).max(axis=0) * found.values[:, [6]], rtol=1e-12
    )
