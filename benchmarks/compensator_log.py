"""A robot's log: friction identified on its first two thirds, the header judged on the last.

    python benchmarks/compensator_log.py ur10_exciting_trajectory.db3

The rival is tanh: fc tanh(k v) + fv v + fo with k chosen for each joint. Inertias are free in both.
Printed is the RMS error in N m of the motors' torques where |v| > 0.02 rad/s.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import pinfric as pf

URDF = "example-robot-data:ur_description/urdf/ur10_robot.urdf"
SLOW, GAINS = 0.02, (5.0, 10.0, 20.0, 30.0, 50.0, 100.0, 200.0)


def read(bag, names):
    """Times, positions and efforts of a bag's joint states, columns in the order of `names`."""
    typestore = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([bag], default_typestore=typestore) as reader:
        chosen = [c for c in reader.connections if "JointState" in c.msgtype]
        messages = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages(chosen)
        ]
    order = [list(messages[0].name).index(name) for name in names]
    t = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages])
    q, effort = (
        np.array([getattr(m, key) for m in messages])[:, order] for key in ("position", "effort")
    )
    return t, q, effort


def regressors(model, motion, gains):
    """(T, nv, columns) of inertias, rotors and friction, linear in tanh's free parameters."""
    data, n, nv = model.createData(), len(motion.t), model.nv
    bodies = np.array(
        [
            pin.computeJointTorqueRegressor(model, data, *state)
            for state in zip(motion.q, motion.v, motion.a, strict=True)
        ]
    )
    own = np.zeros((n, nv, 4 * nv))
    for j in range(nv):
        v = motion.v[:, j]
        columns = motion.a[:, j], np.tanh(gains[j] * v), v, np.ones(n)
        own[:, j, 4 * j : 4 * j + 4] = np.column_stack(columns)
    return np.concatenate([bodies, own], axis=2)


def fitted(X, y):
    """Least squares over all joints, each weighted by its own effort."""
    weight = 1.0 / y.std(axis=0)
    rows = (X * weight[:, None]).reshape(-1, X.shape[2])
    size = np.linalg.norm(rows, axis=0)
    size[size == 0.0] = 1.0
    return np.linalg.lstsq(rows / size, (y * weight).ravel(), rcond=1e-6)[0] / size


def error(y, predicted, v):
    """(nv,) RMS where each joint moves."""
    moving = np.abs(v) > SLOW
    return np.sqrt(((y - predicted) ** 2 * moving).sum(axis=0) / moving.sum(axis=0))


def tanh_error(model, first, last):
    """(nv,) RMS of the tanh model on the second of two (motion, efforts), fitted to the first."""
    tried = []
    for gain in GAINS:
        X = regressors(model, first[0], [gain] * model.nv)
        tried.append(error(first[1], X @ fitted(X, first[1]), first[0].v))
    gains = np.array(GAINS)[np.argmin(tried, axis=0)]
    coefficients = fitted(regressors(model, first[0], gains), first[1])
    predicted = regressors(model, last[0], gains) @ coefficients
    return error(last[1], predicted, last[0].v), gains


def header_torque(scene, motion, folder):
    """(T, nv) feed-forward of the compiled header along a motion; None without a compiler."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        return None
    pf.export(scene, motion, "cpp").write(folder)
    motion.to_csv(folder / "motion.csv", digits=17)
    (test,) = folder.glob("*_test.cpp")
    subprocess.run([compiler, "-std=c++17", "-O2", test, "-o", folder / "test"], check=True)
    subprocess.run([folder / "test"], check=True)
    with (folder / "out.csv").open("w") as out:
        subprocess.run([folder / "test", folder / "motion.csv"], check=True, stdout=out)
    frame = pd.read_csv(folder / "out.csv")
    return frame[[f"{name}.feed_forward" for name in scene.actuator_names]].to_numpy()


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bag", type=Path)
    parser.add_argument("--part", type=float, default=2 / 3, help="of the log to identify from")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.yaml").write_text(f"pinfric: 1\nrobot: {{urdf: '{URDF}'}}\n")
        plain = pf.load_scene(folder / "arm.yaml")
        t, q, effort = read(given.bag, plain.joint_names)
        cut = round(len(t) * given.part)
        logs = [pf.Log(t[p], q[p], effort[p]) for p in (slice(0, cut), slice(cut, None))]
        found = pf.identify(plain, logs[0])
        found.save(folder / "found")
        scene = pf.load_scene(folder / "found" / "scene.yaml")
        motions = [pf.load_trajectory(log, scene) for log in logs]
        first, last = (
            (m, np.column_stack([m.reading.effort[n] for n in scene.joint_names])) for m in motions
        )
        torque, compiled = header_torque(scene, last[0], folder), "the compiled header"
        if torque is None:
            result, compiled = pf.inverse_dynamics(scene, last[0]), "pinfric (no compiler)"
            torque = 0.5 * (result.motor_torque_lower + result.motor_torque_upper)
        ratio = [1.0 if d.transmission is None else d.transmission.ratio for d in scene.drives]
        ours = error(last[1], torque * ratio, last[0].v)
        tanh, gains = tanh_error(plain.model, first, last)
        level = pf.export(scene, first[0], "cpp").uncertainty
    print(f"RMS error on the last part, N m: {compiled} beside tanh, ratio; e; law")
    for j, joint in enumerate(scene.joint_names):
        figures = f"{ours[j]:6.3f} {tanh[j]:6.3f} (k {gains[j]:g}) {ours[j] / tanh[j]:5.2f}"
        e = level.get(joint, np.nan)
        print(f"{joint:20} {figures}  e {e:.3f}  {found.laws.get(joint)}")


if __name__ == "__main__":
    main()
