"""Load-dependent friction inside MuJoCo beside `pf.simulate`: random motions of several robots.

    python benchmarks/mujoco_bridge.py [--motions 10] [--only NAME]

Motor torques hold the first pose without friction, plus two sines per joint of up to twice its
limit at rest: joints stick about half the time. Printed are, for steps of 1 and 0.25 ms, median and
greatest of the worst joint's error at the end, and the share of joint time with another stick
state; the same with the constants of `pf.export`; and the time of a step. With `--motions 0` only
times are measured.
"""

from __future__ import annotations

import argparse
import itertools
import time

import pinfric as pf  # isort: skip - before Pinocchio loads: it sets how threads wait
import mujoco
import numpy as np
import pinocchio as pin
from mujoco.rollout import rollout

from pinfric.errors import AmbiguousAcceleration

SECONDS, SAMPLE = 2.0, 1e-3


def slider():
    """One joint that slides up a slope of 30 degrees under 20 kg, with a screw that loses 30 %."""
    model, slope = pin.Model(), pin.SE3(pin.exp3(np.array([0.0, -np.pi / 6.0, 0.0])), np.zeros(3))
    joint = model.addJoint(0, pin.JointModelPX(), slope, "slide")
    body = pin.Inertia(20.0, np.array([0.05, 0.0, 0.1]), 0.1 * np.eye(3))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    model.addFrame(pin.Frame("carriage", joint, pin.SE3.Identity(), pin.FrameType.BODY))
    guide = {"kind": "guide", "length": 0.2, "width": 0.1}
    friction = {"bearing": guide, "mu": {"static": 0.12, "kinetic": 0.08}, "viscous": 20.0}
    gear = {"ratio": 400.0, "rotor_inertia": 2e-4, "efficiency": 0.7, "back_efficiency": 0.57}
    actuators = [{"joint": "slide", "transmission": gear}]
    return pf.Scene(model, friction={"slide": friction}, actuators=actuators, source="slider.yaml")


def loaded(scene, link, mass):
    """The scene with a payload there."""
    moment = 0.4 * mass * 0.05**2
    tool = {
        "link": link,
        "mass": mass,
        "com": [0.0, 0.0, 0.05],
        "inertia": [moment, 0.0, 0.0, moment, 0.0, moment],
        "attached": True,
    }
    return scene.with_(payloads={"load": tool})


SCENES = {
    "ur10": lambda: pf.load_scene("ur10_machine_tending").with_(payloads={}),
    "ur10 + 5 kg": lambda: loaded(pf.load_scene("ur10_machine_tending"), "tool0", 5.0),
    "so101": lambda: pf.load_scene("so101").with_(payloads={}),
    "pendulum": lambda: pf.load_scene("pendulum"),
    "slider": slider,
}


def made(scene, dt):
    """The exported model, as an MjSpec, without stops and limits of torque."""
    spec = mujoco.MjSpec.from_string(pf.export(scene).text)
    spec.option.timestep = dt
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    for joint in spec.joints:
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    return spec


def random_motion(scene, seed):
    """First pose (nv,) and the motors' torques as a function of time."""
    rng, nv = np.random.default_rng(seed), scene.model.nv
    q = rng.uniform(-1.0, 1.0, nv) * (0.2 if nv == 1 else 1.0)
    held = scene.solver().inverse(q, np.zeros(nv), np.zeros(nv))
    middle = 0.5 * (held.motor_torque_lower + held.motor_torque_upper)
    half = 0.5 * (held.motor_torque_upper - held.motor_torque_lower)
    rates = 2.0 * np.pi * rng.uniform(0.3, 1.2, (2, nv))
    phase, size = rng.uniform(0.0, 2.0 * np.pi, (2, nv)), rng.uniform(0.4, 1.0, (2, nv))

    def torque(t):
        return middle + half * (size * np.sin(rates * t + phase)).sum(axis=0)

    return q, torque


def reference(scene, q, torque):
    """Positions (n, nv) and stick states at steps of `SAMPLE`, by `pf.simulate`."""
    geared = all(drive.transmission is not None for drive in scene.drives)
    given = "motor_torque" if geared else "effort"  # without gears the same
    motion = pf.simulate(
        scene,
        q,
        np.zeros_like(q),
        t_end=SECONDS,
        **{given: lambda t, q, v: torque(t)},
        sample_step=SAMPLE,
        progress=False,
    )
    rest = np.abs(motion.v) <= scene.stick_velocity
    at = np.arange(1, round(SECONDS / SAMPLE) + 1) * SAMPLE
    row = np.clip(np.searchsorted(motion.t, at - 1e-9), 0, len(motion.t) - 1)
    return motion.q[-1], rest[row]


def bridged(scene, dt, q, torque):
    """The same in MuJoCo."""
    friction = pf.mujoco_friction(scene, made(scene, dt))
    data = mujoco.MjData(friction.model)
    data.qpos[friction.dofs] = q
    data.ctrl[:] = torque(0.0)
    friction.start(data)
    every, rest = round(SAMPLE / dt), []
    for k in range(round(SECONDS / dt)):
        data.ctrl[:] = torque((k + 0.5) * dt)
        friction.step(data)
        if (k + 1) % every == 0:
            rest.append(friction.sticking(data))
    return data.qpos[friction.dofs].copy(), np.array(rest)


def constant(scene, dt, q, torque):
    """The same with the constants that `pf.export` writes."""
    model = made(scene, dt).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = q
    for k in range(round(SECONDS / dt)):
        data.ctrl[:] = torque((k + 0.5) * dt)
        mujoco.mj_step(model, data)
    return data.qpos.copy()


def compare(scene, motions, steps=(1e-3, 2.5e-4)):
    """(motions, 1 + steps) errors at the end, constants first; (motions, steps) mismatches.

    Motions with a state in which several accelerations obey the laws are skipped.
    """
    errors, missed = [], []
    for seed in itertools.count():
        if len(errors) == motions:
            break
        q, torque = random_motion(scene, seed)
        try:
            end, rest = reference(scene, q, torque)
        except AmbiguousAcceleration:
            print(f"motion {seed}: ambiguous, passed over", flush=True)
            continue
        row, wrong = [np.abs(constant(scene, steps[0], q, torque) - end).max()], []
        for dt in steps:
            found, stuck = bridged(scene, dt, q, torque)
            row.append(np.abs(found - end).max())
            wrong.append(float((stuck != rest).mean()))
        errors.append(row)
        missed.append(wrong)
    return np.array(errors), np.array(missed)


def cost(scene, count=2000, rounds=9):
    """Times of a step (us): `mj_step` in `rollout`, the same with the callback, `step` in Python.

    The first two take turns; medians of all rounds.
    """
    friction = pf.mujoco_friction(scene, made(scene, 1e-3))
    model, kind = friction.model, mujoco.mjtState.mjSTATE_FULLPHYSICS
    data, state = mujoco.MjData(model), np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    friction.start(data)

    def rolled():
        rollout(model, mujoco.MjData(model), state, nstep=count)

    def callback():
        with friction.installed():
            rolled()

    def steps():
        for _ in range(count):
            friction.step(data)

    callback()  # compiled once
    times = np.empty((rounds, 3))
    for row in times:
        for k, run in enumerate((rolled, callback, steps)):
            start = time.perf_counter()
            run()
            row[k] = 1e6 * (time.perf_counter() - start) / count
    return np.median(times, axis=0)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motions", type=int, default=10)
    parser.add_argument("--only", choices=SCENES)
    given = parser.parse_args()
    print(
        "end, rad or m: median (max); mismatch of stick state; us a step: mj_step, with the "
        "callback (ratio), step in Python"
    )
    for name, make in SCENES.items():
        if given.only in (None, name):
            scene = make()
            if given.motions:
                errors, missed = compare(scene, given.motions)
                cells = [f"{np.median(column):.2g} ({column.max():.2g})" for column in errors.T]
                share = " ".join(f"{100 * x:.3f}%" for x in missed.mean(axis=0))
                print(
                    f"{name:12} constants {cells[0]}  1 ms {cells[1]}  0.25 ms {cells[2]}  "
                    f"mismatch {share}",
                    flush=True,
                )
            plain, called, ours = cost(scene)
            print(
                f"{name:12} {plain:.1f} {called:.1f} ({called / plain:.2f}) {ours:.1f}", flush=True
            )


if __name__ == "__main__":
    main()
