"""One joint that is held, breaks away, is let go and turns back, in every engine that runs here.

    python benchmarks/engines.py

A hinge of 1 kg m^2 with 3 N m of dry friction and 0.5 N m s/rad. 1 s at 2 N m, which friction
holds; a ramp from 2 to 5 N m in 1.5 s; then nothing, until it rests; then the same the other way.
Printed are how far it creeps while it is held, the effort at which it breaks away (1 mrad/s), and
how long it takes to come to rest (1 mrad/s), forward / backward, beside the closed form. Constants
come from `pinfric export` to each engine's format; steps are 1 ms.
"""

from __future__ import annotations

import tempfile
from importlib.util import find_spec
from pathlib import Path

import pinfric as pf  # isort: skip - before Pinocchio loads: it sets how threads wait

import numpy as np
import pinocchio as pin

DRY, VISCOUS, STEP, SLOW = 3.0, 0.5, 1e-3, 1e-3
HOLD, RAMP, REST = 1.0, 1.5, 2.0  # s
HALF = HOLD + RAMP + REST


def hinge():
    """The scene."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("arm", joint, pin.SE3.Identity(), pin.FrameType.BODY))
    model.gravity.linear = np.zeros(3)
    friction = {"hinge": {"coulomb": {"static": DRY, "kinetic": DRY}, "viscous": VISCOUS}}
    return pf.Scene(model, friction=friction, source="hinge.yaml")


def effort(t):
    """N m at the time t (s)."""
    way = 1.0 if t < HALF else -1.0
    t = t % HALF
    if t < HOLD:
        return way * 2.0
    return way * (2.0 + 2.0 * (t - HOLD)) if t < HOLD + RAMP else 0.0


TIMES = np.arange(round(2 * HALF / STEP)) * STEP


def stepped(step):
    """(T, 2) positions and velocities of an engine whose `step(effort)` returns both."""
    return np.array([step(effort(t)) for t in TIMES])


def pinfric_run(scene):
    """Our own time steps, of the same length."""
    motion = pf.simulate(
        scene,
        [0.0],
        [0.0],
        lambda t, q, v: np.array([effort(t)]),
        2 * HALF,
        "timestepping",
        dt=STEP,
        sample_step=STEP,
        progress=False,
    )
    at = TIMES + STEP
    return np.column_stack([np.interp(at, motion.t, x[:, 0]) for x in (motion.q, motion.v)])


def mujoco_run(scene, soft=False):
    """MuJoCo with the exported MJCF; `soft`: with MuJoCo's own default of friction."""
    import mujoco

    text = pf.export(scene).text
    if soft:
        text = text.replace('solreffriction="0.002 1" solimpfriction="0.9999 0.9999"', "")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)

    def step(u):
        data.qfrc_applied[0] = u
        mujoco.mj_step(model, data)
        return data.qpos[0], data.qvel[0]

    return stepped(step)


def pinocchio_run(scene):
    """Pinocchio 4: its joint friction constraint and its projected Gauss-Seidel solver."""
    model, (joint,) = scene.model.copy(), pf.export(scene).joints
    model.damping[0], bound = joint.damping, np.array([joint.frictionloss])
    joints = pin.StdVec_Index()
    joints.append(1)
    constraint = pin.JointFrictionConstraintModel(model, joints, -bound, bound)
    data, q, v = model.createData(), np.zeros(1), np.zeros(1)
    constraint.setTimeStep(STEP)
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    models.append(pin.ConstraintModel(constraint))
    datas.append(models[0].createData())
    settings, result = pin.PGSSolverSettings(), pin.PGSSolverResult()
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = 1e-12
    solver = pin.PGSConstraintSolver(1)

    def step(u):
        M = pin.crba(model, data, q) + STEP * np.diag(model.damping)  # damping implicit
        free = np.linalg.solve(M, pin.crba(model, data, q) @ v + STEP * np.array([u]))
        solver.solve(
            pin.DelassusOperatorDense(np.linalg.inv(M)), free, models, datas, settings, result
        )
        v[:] = free + np.linalg.solve(M, result.retrieveConstraintImpulses())
        q[:] += STEP * v
        return q[0], v[0]

    return stepped(step)


def drake_run(scene):
    """Drake with the exported SDF: it reads damping, and has no dry friction in joints."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.systems.analysis import Simulator

    plant = MultibodyPlant(STEP)
    with tempfile.TemporaryDirectory() as folder:
        Parser(plant).AddModels(str(pf.export(scene, to="sdf").write(Path(folder) / "hinge.sdf")))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plant.Finalize()
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    port = plant.get_actuation_input_port()

    def step(u):
        port.FixValue(context, np.array([u]))
        simulator.AdvanceTo(context.get_time() + STEP)
        return plant.GetPositions(context)[0], plant.GetVelocities(context)[0]

    return stepped(step)


def figures(track):
    """Creep (mrad), break-away (N m), time to rest (s) of both halves; NaN: there is none."""
    q, v = track.T
    found = []
    for start in (0.0, HALF):
        way = 1.0 if start == 0.0 else -1.0
        first, held = (round((start + t) / STEP) for t in (0.0, HOLD))
        before = q[first - 1] if first else 0.0
        ramp = slice(held, held + round(RAMP / STEP))
        broken = np.flatnonzero(way * v[ramp] > SLOW)
        free = slice(ramp.stop, round((start + HALF) / STEP))
        rests = np.flatnonzero(np.abs(v[free]) <= SLOW)
        found.append(
            (
                1e3 * way * (q[held - 1] - before),
                2.0 + 2.0 * STEP * broken[0] if broken.size else np.nan,
                STEP * (rests[0] + 1) if rests.size else np.nan,
            )
        )
    return np.array(found)


def closed_form():
    """What Newton's law and Coulomb's give: no creep, 3 N m and the speed that grows from there."""
    start = HOLD + (DRY - 2.0) / 2.0
    s, d = RAMP + HOLD - start, VISCOUS
    # v' = 2 t - d v from rest: v = 2/d (t - (1 - exp(-d t))/d)
    v = 2.0 / d * (s - (1.0 - np.exp(-d * s)) / d)
    slow = DRY + SLOW * d
    at = np.sqrt(SLOW)  # v = t^2 at first
    return np.array([[0.0, DRY + 2.0 * at, np.log((DRY + d * v) / slow) / d]] * 2)


RUNS = {
    "pinfric, timestepping": (pinfric_run, None),
    "MuJoCo, as exported": (mujoco_run, "mujoco"),
    "MuJoCo, its default": (lambda scene: mujoco_run(scene, soft=True), "mujoco"),
    "Pinocchio 4, constraint": (pinocchio_run, None),
    "Drake": (drake_run, "pydrake"),
}


def main():
    """Print the table."""
    print(f"{'':24} creep, mrad       break-away, N m   decay, s       (forward / backward)")
    rows = {"closed form": closed_form()}
    for name, (run, needs) in RUNS.items():
        if needs and find_spec(needs) is None:
            print(f"{name:24} {needs} is not installed")
            continue
        rows[name] = figures(run(hinge()))
    for name, row in rows.items():
        cells = (f"{row[0, k]:7.3f} / {row[1, k]:7.3f}" for k in range(3))
        print(f"{name:24} {'   '.join(cells)}")


if __name__ == "__main__":
    main()
