"""An arm in closed loop at 1 kHz without friction compensation, with tanh, and with the load known.

    python benchmarks/closed_loop.py [--seconds 4] [--stability]

A UR10 with 2.8 kg in its hand, gears that lose 5-7 % of their load, break-away 1.25 times kinetic
friction. PD control of positions of 19 bits with a delay of 1 ms; rigid body, payload and friction
are fed forward at the desired motion. tanh is fitted to the arm without the payload, as it is to a
robot's own logs. Printed are RMS tracking errors of joints 1-3 in mrad.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import pinocchio as pin

import pinfric as pf
from pinfric.exporting.constants import joint_constants
from pinfric.motions.joint_columns import joint_columns

COULOMB = np.array([12.5, 13.3, 5.0, 2.0, 2.7, 2.3])
VISCOUS = np.array([21.3, 20.2, 10.4, 3.6, 2.5, 3.0])
EFFICIENCY = np.array([0.94, 0.93, 0.94, 0.95, 0.95, 0.95])
RATIO, ROTOR = 101.0, np.array([1e-4, 1e-4, 1e-4, 2e-5, 2e-5, 2e-5])
STIFFNESS = np.array([2000.0, 2000.0, 2000.0, 500.0, 300.0, 300.0])
DAMPING = np.array([250.0, 250.0, 130.0, 25.0, 15.0, 12.0])
HOME = np.array([0.0, -1.1, 1.3, -1.5, -1.5, 0.0])
AMPLITUDE = np.array([0.6, 0.4, 0.5, 0.4, 0.4, 0.6])
PERIOD, BITS, LOW_PASS = 1e-3, 19, 100.0  # s, of a turn, Hz
TANH = 30.0  # s/rad: what logs choose


def arm():
    """The arm; its payload is `load`."""
    base = pf.load_scene("ur10_machine_tending")
    friction = {
        name: {
            "coulomb": {"static": 1.25 * COULOMB[i], "kinetic": COULOMB[i]},
            "viscous": VISCOUS[i],
            "stribeck": {"velocity": 0.02},
        }
        for i, name in enumerate(base.joint_names)
    }
    actuators = [
        {
            "joint": name,
            "transmission": {
                "ratio": RATIO,
                "efficiency": EFFICIENCY[i],
                "back_efficiency": 2 - 1 / EFFICIENCY[i],
                "rotor_inertia": ROTOR[i],
            },
        }
        for i, name in enumerate(base.joint_names)
    ]
    load = {
        "link": "tool0",
        "mass": 2.8,
        "com": [0.0, 0.0, 0.06],
        "inertia": [0.005, 0.0, 0.0, 0.005, 0.0, 0.005],
    }
    return base.with_(
        friction=friction, actuators=actuators, payloads={"load": load}, simulation=None
    )


def desired(kind, seconds):
    """(T, 6) positions, velocities and accelerations at 1 kHz.

    fast: there and back again and again, 0.7 s each with holds of 0.3 s. slow: sines of 50 mrad/s.
    """
    t = np.arange(round(seconds / PERIOD) + 1) * PERIOD
    if kind == "slow":
        w = 0.05 / (0.5 * AMPLITUDE)
        phase = w * t[:, None]
        q = 0.5 * AMPLITUDE * (1.0 - np.cos(phase))
        return HOME + q, 0.05 * np.sin(phase), 0.05 * w * np.cos(phase)
    x = np.clip((t % 1.0) / 0.7, 0.0, 1.0)[:, None]
    back = (np.floor(t) % 2 == 1)[:, None]
    s = 10 * x**3 - 15 * x**4 + 6 * x**5
    ds, dds = 30 * x**2 - 60 * x**3 + 30 * x**4, 60 * x - 180 * x**2 + 120 * x**3
    sign = np.where(back, -1.0, 1.0) * AMPLITUDE
    return HOME + np.where(back, 1.0 - s, s) * AMPLITUDE, sign * ds / 0.7, sign * dds / 0.49


def tanh_of(scene, q, v, a):
    """Coulomb and viscous constants (6,), (6,) fitted to a motion without the payload."""
    t = np.arange(len(q)) * PERIOD
    free = pf.inverse_dynamics(scene, q, v, a, t=t, attached=np.zeros((len(q), 1), dtype=bool))
    fitted = joint_constants(free, joint_columns(scene.model))
    return np.array([(joint.frictionloss, joint.damping) for joint in fitted]).T


def feed_forward(scene, q, v, a, friction):
    """(T, 6) N m at the joints: rigid body, rotors, and friction."""
    model = scene.loaded_model(["load"])
    data = model.createData()
    plain = np.array([pin.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])
    return plain + RATIO**2 * ROTOR * a + friction


def knowing_the_load(scene, q, v, a, scale):
    """(T, 6) what the compensator gives along the desired motion."""
    solver = scene.solver(["load"])
    options = pf.CompensationOptions(scale=scale, viscous_scale=scale)
    return np.array(
        [
            solver.compensate(*state, state[1], options=options)
            for state in zip(q, v, a, strict=True)
        ]
    )


class Controller:
    """PD at 1 kHz on quantized positions, its torque a period late; called by `pf.simulate`."""

    def __init__(self, q, torque):
        self.q, self.torque, self.tick = q, torque, -1
        self.last, self.rate, self.now = q[0], np.zeros(6), torque[0] / RATIO
        self.late = self.now

    def __call__(self, t, q, v):
        tick = min(int(t / PERIOD + 1e-6), len(self.q) - 1)
        if tick > self.tick:
            step = 2 * np.pi / 2**BITS
            measured = np.round(q / step) * step
            share = 1.0 - np.exp(-2 * np.pi * LOW_PASS * PERIOD)
            error = self.q[tick] - measured
            if self.tick >= 0:
                self.rate = self.rate + share * ((error - self.last) / PERIOD - self.rate)
            self.last, self.tick, self.now = error, tick, self.late
            u = self.torque[tick] + STIFFNESS * error + DAMPING * self.rate
            self.late = u / RATIO
        return self.now


def track(scene, q, v, torque, dt=0.5e-3):
    """Return the RMS tracking error (6,) in mrad of the last three quarters."""
    controller = Controller(q, torque)
    t_end = (len(q) - 1) * PERIOD
    motion = pf.simulate(
        scene,
        q[0],
        v[0],
        motor_torque=controller,
        t_end=t_end,
        method="timestepping",
        dt=dt,
        attached=["load"],
        progress=False,
        sample_step=PERIOD,
    )
    at = np.column_stack(
        [np.interp(np.arange(len(q)) * PERIOD, motion.t, motion.q[:, i]) for i in range(6)]
    )
    error = (at - q)[len(q) // 4 :]
    return 1e3 * np.sqrt(np.mean(error**2, axis=0))


def laws(scene, q, v, a, fitted):
    """What is fed forward for friction: name -> (T, 6)."""
    coulomb, viscous = fitted
    tanh = coulomb * np.tanh(TANH * v) + viscous * v
    whole = knowing_the_load(scene, q, v, a, 1.0)
    return {
        "no friction compensation": 0.0 * tanh,
        "tanh, fitted without load": tanh,
        "load-aware": whole,
        "tanh, 20 % too large": 1.2 * tanh,
        "load-aware, 20 % too large": 1.2 * whole,
        "load-aware, scale 0.8": knowing_the_load(scene, q, v, a, 0.8),
    }


class Guided:
    """Gravity and friction compensated at the measured velocity; the lift is pushed for 0.3 s."""

    def __init__(self, scene, scale):
        self.solver, self.model = scene.solver(["load"]), scene.loaded_model(["load"])
        self.options = pf.CompensationOptions(scale=scale, viscous_scale=scale)
        self.data, self.rate, self.tick, self.torque = self.model.createData(), np.zeros(6), -1, 0.0
        self.last = HOME

    def __call__(self, t, q, v):
        tick = int(t / PERIOD + 1e-6)
        if tick > self.tick:
            step, share = 2 * np.pi / 2**BITS, 1.0 - np.exp(-2 * np.pi * LOW_PASS * PERIOD)
            measured = np.round(q / step) * step
            self.rate = self.rate + share * ((measured - self.last) / PERIOD - self.rate)
            self.last, self.tick = measured, tick
            u = pin.computeGeneralizedGravity(self.model, self.data, measured)
            u = u + self.solver.compensate(measured, None, None, self.rate, options=self.options)
            u[1] += 25.0 if t < 0.3 else 0.0
            self.torque = u / RATIO
        return self.torque


def guided(scene, scale, seconds=2.8):
    """Return the lift's speed (mrad/s) at the end of a push, and 2.5 s later."""
    motion = pf.simulate(
        scene,
        HOME,
        np.zeros(6),
        motor_torque=Guided(scene, scale),
        t_end=seconds,
        method="timestepping",
        dt=PERIOD,
        attached=["load"],
        progress=False,
        sample_step=PERIOD,
    )
    return [1e3 * float(np.interp(t, motion.t, motion.v[:, 1])) for t in (0.3, seconds)]


class Integrating(Controller):
    """PID that steps by 20 mrad and holds; friction at the desired or the measured velocity."""

    def __init__(self, scene, measured):
        self.target = HOME + 0.02 * (AMPLITUDE > 0.0)
        super().__init__(np.repeat(self.target[None], 1, axis=0), np.zeros((1, 6)))
        self.solver, self.model = scene.solver(["load"]), scene.loaded_model(["load"])
        self.options = pf.CompensationOptions(scale=0.8, viscous_scale=0.8)
        self.data, self.measured, self.sum = self.model.createData(), measured, np.zeros(6)
        self.ticks = -1

    def __call__(self, t, q, v):
        tick = int(t / PERIOD + 1e-6)
        if tick > self.ticks:
            step, share = 2 * np.pi / 2**BITS, 1.0 - np.exp(-2 * np.pi * LOW_PASS * PERIOD)
            error = self.target - np.round(q / step) * step
            if self.ticks >= 0:
                self.rate = self.rate + share * ((error - self.last) / PERIOD - self.rate)
            self.last, self.ticks, self.now = error, tick, self.late
            self.sum = self.sum + PERIOD * error
            u = pin.computeGeneralizedGravity(self.model, self.data, q)
            u = u + STIFFNESS * (error + 5.0 * self.sum) + DAMPING * self.rate
            if self.measured:
                u = u + self.solver.compensate(q, None, None, -self.rate, options=self.options)
            self.late = u / RATIO
        return self.now


def hunted(scene, measured, seconds=8.0):
    """Return the peak-to-peak motion (3,) in mrad of joints 1-3 over the last 3 s of a hold."""
    controller = Integrating(scene, measured)
    motion = pf.simulate(
        scene,
        HOME,
        np.zeros(6),
        motor_torque=controller,
        t_end=seconds,
        method="timestepping",
        dt=0.5e-3,
        attached=["load"],
        progress=False,
        sample_step=PERIOD,
    )
    last = motion.q[motion.t > seconds - 3.0, :3]
    return 1e3 * np.ptp(last, axis=0)


def stability(scene):
    """Print what the measured velocity does to a free arm, and to an integrator."""
    print("a free arm, compensated at the measured velocity; the lift pushed for 0.3 s:")
    for scale in (0.6, 0.8, 0.9, 0.95, 1.0, 1.05):
        pushed, later = guided(scene, scale)
        print(f"scale {scale:4}: {pushed:6.0f} mrad/s after the push, {later:6.0f} 2.5 s later")
    print("PID after a step of 20 mrad, peak to peak over 3 s of hold, joints 1-3, mrad:")
    for name, measured in (
        ("no friction at rest (desired velocity)", False),
        ("friction at the measured velocity", True),
    ):
        print(f"{name:40} {'  '.join(f'{x:6.2f}' for x in hunted(scene, measured))}")


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=4.0, help="of each run")
    parser.add_argument("--stability", action="store_true", help="of the measured velocity")
    given, scene = parser.parse_args(), arm()
    if given.stability:
        stability(scene)
        return
    seconds = given.seconds
    fitted = tanh_of(scene, *desired("fast", seconds))
    print("RMS error of joints 1-3, mrad")
    for kind in ("fast", "slow"):
        q, v, a = desired(kind, seconds)
        for name, friction in laws(scene, q, v, a, fitted).items():
            start = time.perf_counter()
            error = track(scene, q, v, feed_forward(scene, q, v, a, friction))
            figures = "  ".join(f"{x:7.3f}" for x in error[:3])
            print(
                f"{kind:5} {name:28} {figures}   ({time.perf_counter() - start:.1f} s)", flush=True
            )


if __name__ == "__main__":
    main()
