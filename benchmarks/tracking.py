"""How a simulated UR10 tracks: no compensation, constants, pinfric; by encoder and delay.

PD at 1 kHz on encoder counts, velocities by differences, low-passed at 40 Hz; MuJoCo with the
scene's friction at 0.5 ms. Prints the RMS error (mrad) of the worst and of the best joint; for hand
guiding the least share of the push that moves the arm.

    python benchmarks/tracking.py [--bits 14 17 19] [--delay 0 1 2]
"""

from __future__ import annotations

import argparse
import warnings

import mujoco
import numpy as np
import pinocchio as pin

import pinfric as pf

REST = np.array([0.0, -1.2, 1.0, -1.3, -1.57, 0.0])
INERTIA = np.array([9.0, 9.0, 4.0, 0.7, 0.7, 0.6])
GAINS = np.array([2000.0, 2000.0, 1200.0, 300.0, 300.0, 300.0])
#: task -> largest velocity (rad/s), frequency (Hz), factor on the gains.
TASKS = {"slow": (0.01, 0.25, 1.0), "fast": (1.0, 0.5, 1.0), "impedance": (0.1, 0.25, 0.1)}


class Loop:
    """The arm in MuJoCo, and what its controller knows."""

    def __init__(self) -> None:
        self.scene = pf.load_scene("ur10_machine_tending").with_(payloads={})
        exported = pf.export(self.scene)
        spec = mujoco.MjSpec.from_string(exported.text)
        spec.option.timestep = 5e-4
        self.friction = pf.mujoco_friction(self.scene, spec)
        self.constants = np.array([[j.frictionloss, j.damping] for j in exported.joints])
        self.solver, self.model = self.scene.solver(), self.scene.model
        self.data = self.model.createData()
        self.ratio = np.array([drive.ratio for drive in self.scene.drives])
        self.rotors = self.ratio**2 * np.array(self.scene.gears().rotor_inertia)

    def torque(self, how: str, q: np.ndarray, v: np.ndarray, a: np.ndarray, **now: np.ndarray):
        data, model = self.data, self.model
        if how == "none":
            return pin.rnea(model, data, q, v, a) + self.rotors * a
        if how == "constants":
            loss, damping = self.constants.T
            rigid = pin.rnea(model, data, q, v, a) + self.rotors * a
            return rigid + loss * np.tanh(v / 0.01) + damping * v
        if how == "pinfric":
            return self.solver.joint_effort(q, v, a)
        options = pf.CompensationOptions(hold_error=1e-4 if how == "hold" else 1e-2)
        return self.solver.joint_effort(q, v, a, options=options, **now)

    def run(self, task: str, how: str, bits: int, delay: int) -> np.ndarray:
        """RMS error of each joint, rad."""
        peak, frequency, share = TASKS[task]
        omega, still = 2.0 * np.pi * frequency, np.zeros(6)
        model, data = self.friction.model, mujoco.MjData(self.friction.model)
        data.qpos[:] = before = REST
        held = pin.rnea(self.model, self.data, REST, still, still)
        sent, slow, errors = [held] * (delay + 1), still, []
        damping, count = 1.4 * np.sqrt(GAINS * INERTIA), 2.0 * np.pi / 2**bits
        for k in range(5000):
            t = k * 1e-3
            rise = min(t, 1.0) ** 2 * (3.0 - 2.0 * min(t, 1.0))
            way = peak / omega * rise
            q = REST + way * (1.0 - np.cos(omega * t))
            v = way * omega * np.sin(omega * t) + still
            a = way * omega**2 * np.cos(omega * t) + still
            seen = np.round(data.qpos / count) * count
            slow = slow + 0.22 * ((seen - before) / 1e-3 - slow)
            before, error = seen, q - seen
            effort = self.torque(how, q, v, a, error=error, v_now=slow)
            effort = effort + share * GAINS * error + np.sqrt(share) * damping * (v - slow)
            sent.append(effort)
            data.ctrl[:] = sent[-1 - delay] / self.ratio
            mujoco.mj_step(model, data, 2)
            if t > 2.0:
                errors.append(q - data.qpos)
        return np.sqrt(np.mean(np.square(errors), axis=0))

    def guide(self, how: str, bits: int, delay: int) -> np.ndarray:
        """Torque (N m) at which each joint moves by hand, others at rest."""
        model, still, found = self.friction.model, np.zeros(6), np.zeros(6)
        options, count = pf.CompensationOptions(), 2.0 * np.pi / 2**bits
        for joint in range(6):
            data = mujoco.MjData(model)
            data.qpos[:] = before = REST
            self.solver.reset_compensation()
            sent, slow = [pin.rnea(self.model, self.data, REST, still, still)] * 3, still
            for k in range(4000):
                seen = np.round(data.qpos / count) * count
                slow = slow + 0.22 * ((seen - before) / 1e-3 - slow)
                before = seen
                effort = pin.rnea(self.model, self.data, seen, still, still)
                if how == "constants":
                    effort = effort + 0.8 * self.constants[:, 0] * np.tanh(slow / 0.02)
                if how == "pinfric":
                    effort = effort + self.solver.compensate_measured(seen, slow, options=options)
                sent.append(effort)
                push = 15e-3 * k * self.constants[joint, 0] / 30.0
                data.qfrc_applied[joint] = push
                data.ctrl[:] = sent[-1 - delay] / self.ratio
                mujoco.mj_step(model, data, 2)
                if abs(data.qpos[joint] - REST[joint]) > 0.02:
                    break
            found[joint] = push
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bits", type=int, nargs="+", default=[14, 17, 19])
    parser.add_argument("--delay", type=int, nargs="+", default=[0, 1, 2])
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    loop = Loop()
    with loop.friction.installed():
        for task in TASKS:
            for how in ("none", "constants", "pinfric", "hold", "soft hold"):
                for bits in asked.bits:
                    for delay in asked.delay:
                        error = 1e3 * loop.run(task, how, bits, delay)
                        print(
                            f"{task:10} {how:10} {bits} bits {delay} ms: "
                            f"{error.min():.3g} to {error.max():.3g} mrad",
                            flush=True,
                        )
        for how in ("none", "constants", "pinfric"):
            for bits in asked.bits:
                for delay in asked.delay:
                    push = loop.guide(how, bits, delay)
                    print(f"guiding    {how:10} {bits} bits {delay} ms: {push.round(1)} N m")


if __name__ == "__main__":
    main()
