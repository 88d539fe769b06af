"""MuJoCo and Drake on the same robot with the same constant friction, in the same run.

The robot is rebuilt from Pinocchio's model, so that each engine's reading of a URDF has no effect.
MuJoCo has dry friction of joints as a soft constraint (`frictionloss`). Drake has none; as its
users do, F tanh(v / velocity) is added as a system. Both run their own loops in C++ without Python:
MuJoCo by `rollout`, Drake by `Simulator`, its efforts and friction as symbolic expressions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from pinfric.accuracy.explain import with_constant_friction
from pinfric.accuracy.study import (
    Contestant,
    JudgedTrack,
    TimedRun,
    compete,
    contestants,
    judge_of,
    reference,
)
from pinfric.dynamics.forward.efforts import make_effort
from pinfric.dynamics.inverse.result import StickInterval, runs
from pinfric.dynamics.simulation.start import start_state
from pinfric.errors import PinfricError
from pinfric.exporting.mjcf import MjcfJoint, mjcf
from pinfric.exporting.tree import MovedBody, bodies
from pinfric.model.scene import Scene
from pinfric.model.schema import SineEffort, TableEffort
from pinfric.motions.joint_columns import configurations, single_positions

#: Speeds (rad/s or m/s) below which a peer's joint may count as at rest, for none of them stands
#: still; of these the one is taken that serves the peer best.
STANDSTILL = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)
#: Steps of MuJoCo over the whole motion.
STEPS = (100, 400, 1600, 6400, 25_600, 102_400)
#: Velocities (rad/s or m/s) of Drake's tanh; the integrator's accuracy is a tenth of them.
VELOCITIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
#: MuJoCo's friction constraint: as it comes, and as hard and quick as it allows (a time constant
#: of two steps).
_KINDS = ("MuJoCo", "MuJoCo, stiff")
_NOT_INSTALLED = 'not installed; pip install "pinfric[bench]" brings it'


@dataclass(frozen=True, eq=False)
class _Robot:
    """A scene with constant friction as a peer needs it.

    Attributes:
        bodies: one per joint, as many as degrees of freedom.
        friction: (n,) dry friction of each joint, N m or N.
        efforts: (n,) of each joint as the scene's `simulation` gives it.
        q0, v0: (n,) angles or lengths and rates at t = 0.
        effort: time -> (n,), N m or N.
    """

    scene: Scene
    bodies: tuple[MovedBody, ...]
    friction: tuple[float, ...]
    efforts: tuple[Any, ...]
    q0: np.ndarray
    v0: np.ndarray
    t_end: float
    effort: Callable[[float], np.ndarray]

    def track(
        self, t: np.ndarray, angles: np.ndarray, rates: np.ndarray, steps: int
    ) -> JudgedTrack:
        """Return a peer's motion for the judge: t (T,) s, angles, rates (T, n)."""
        readings = tuple(
            tuple(
                StickInterval(body.joint.name, float(t[first]), float(t[last]))
                for j, body in enumerate(self.bodies)
                if self.friction[j] > 0.0
                for first, last in runs(np.abs(rates[:, j]) <= speed)
            )
            for speed in STANDSTILL
        )
        nq = self.scene.model.nq
        if not np.isfinite(angles).all():
            return JudgedTrack(t, np.full((len(t), nq), np.nan), readings, steps)
        columns = [body.joint for body in self.bodies]
        return JudgedTrack(t, configurations(columns, angles, nq), readings, steps)


def compete_with_peers(
    scene: Scene, constants: Mapping[str, float], rounds: int = 3
) -> tuple[tuple[TimedRun, ...], list[str]]:
    """Simulate a scene's motion with constant friction, by pinfric and by the peers installed.

    Args:
        scene: with a `simulation` section.
        constants: site -> friction, static as kinetic (N m or N).
        rounds: timings of each contestant.

    Returns:
        the runs, and a line for each peer that is not installed.

    Raises:
        PinfricError: loops, joints of several degrees of freedom or mimics, which are not handed to
            the peers; the motion cannot be simulated.
    """
    constant = with_constant_friction(scene, constants)
    robot = _robot(constant)
    entries = contestants(constant, ("event", "timestepping"))
    missing = []
    if find_spec("mujoco"):
        entries += [_mujoco_contestant(robot, kind, n) for kind in _KINDS for n in STEPS]
    else:
        missing.append(f"MuJoCo: {_NOT_INSTALLED}")
    if find_spec("pydrake"):
        entries += [_drake_contestant(robot, velocity) for velocity in VELOCITIES]
    else:
        missing.append(f"Drake: {_NOT_INSTALLED}")
    return compete(entries, judge_of(reference(constant)), rounds=rounds), missing


def _robot(scene: Scene) -> _Robot:
    tree = bodies(scene)
    assert scene.simulation is not None
    if scene.simulation.motor_torque:
        raise PinfricError(
            f"{scene.source}: simulation.motor_torque: peers know no gears that "
            "lose; give `simulation.effort`"
        )
    q, v = start_state(scene)
    made = make_effort(scene, None)
    constants = {site.name: site.law.kinetic.forward for site in scene.sites}
    names = [body.joint.name for body in tree]
    angles = single_positions(q[None, :], [body.joint.nq for body in tree])[0]
    return _Robot(
        scene,
        tree,
        tuple(constants.get(name, 0.0) for name in names),
        tuple(scene.simulation.effort.get(name, 0.0) for name in names),
        angles,
        v,
        scene.simulation.t_end,
        lambda t: np.asarray(made.function(t, q, v)),
    )


# ---------------------------------------------------------------- MuJoCo


def _mujoco_contestant(robot: _Robot, name: str, steps: int) -> Contestant:
    mujoco: Any = import_module("mujoco")
    rollout: Any = import_module("mujoco.rollout")
    dt = robot.t_end / steps
    start = np.concatenate([[0.0], robot.q0, robot.v0])

    @cache  # compiled at first use, and not part of what is timed
    def ready() -> tuple[Any, Any, np.ndarray]:
        model = mujoco.MjModel.from_xml_string(mujoco_xml(robot, dt, name == _KINDS[1]))
        times = dt * (np.arange(steps) + 0.5)
        return model, mujoco.MjData(model), np.array([robot.effort(t) for t in times])

    def bare() -> np.ndarray:
        model, data, efforts = ready()
        states, _ = rollout.rollout(
            model,
            data,
            initial_state=start,
            control=efforts,
            control_spec=int(mujoco.mjtState.mjSTATE_QFRC_APPLIED),
        )
        return np.asarray(states)[0]

    def judged() -> JudgedTrack:
        try:
            states = np.vstack([start, bare()])
        except ValueError as problem:
            raise PinfricError(f"MuJoCo refuses the robot: {problem}") from None
        n = len(robot.bodies)
        t = np.linspace(0.0, robot.t_end, steps + 1)  # its own clock sums its steps
        return robot.track(t, states[:, 1 : 1 + n], states[:, 1 + n :], steps)

    return Contestant(name, f"dt {dt:.2e} s", bare, judged)


def mujoco_xml(robot: _Robot, dt: float, stiff: bool) -> str:
    """Return the robot in MuJoCo's format, for a step dt (s).

    `stiff` makes friction as hard as MuJoCo allows.
    """
    hard = {"solimpfriction": "0.9999 0.9999 0.001", "solreffriction": f"{2 * dt!r} 1"}
    joints = [
        MjcfJoint(friction, 0.0, body.armature)
        for body, friction in zip(robot.bodies, robot.friction, strict=True)
    ]
    gravity = robot.scene.model.gravity.linear
    return mjcf(
        "peer",
        robot.bodies,
        joints,
        gravity,
        timestep=dt,
        limits=False,
        friction=hard if stiff else {},
    )


# ---------------------------------------------------------------- Drake


def _drake_contestant(robot: _Robot, velocity: float) -> Contestant:
    ready = cache(partial(_drake_simulator, robot, velocity))

    def bare() -> Any:
        simulator, plant = ready()
        context = simulator.get_mutable_context()
        context.SetTime(0.0)
        state = np.concatenate([robot.q0, robot.v0])
        plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), state)
        simulator.Initialize()
        simulator.get_mutable_integrator().ResetStatistics()
        try:
            simulator.AdvanceTo(robot.t_end)
        except RuntimeError as problem:
            raise PinfricError(f"Drake: {str(problem)[:150]}") from None
        return simulator

    def judged() -> JudgedTrack:
        simulator, plant = ready()
        rows: list[np.ndarray] = []

        def look(context: Any) -> None:
            own = plant.GetMyContextFromRoot(context)
            rows.append(np.append(context.get_time(), plant.GetPositionsAndVelocities(own)))

        simulator.set_monitor(look)
        try:
            bare()
        finally:
            simulator.clear_monitor()
        evaluations = simulator.get_integrator().get_num_derivative_evaluations()
        n = len(robot.bodies)
        table = np.array(rows)
        table = table[np.append(True, np.diff(table[:, 0]) > 0.0)]
        return robot.track(table[:, 0], table[:, 1 : 1 + n], table[:, 1 + n :], int(evaluations))

    accuracy = 0.1 * velocity
    setting = f"velocity {velocity:.0e}, accuracy {accuracy:.0e}"
    return Contestant("Drake", setting, bare, judged)


def _drake_simulator(robot: _Robot, velocity: float) -> tuple[Any, Any]:
    """A simulator of a continuous plant with error control, and the plant.

    Runge-Kutta 3 is the fastest at equal error on the UR5 of it, Bogacki-Shampine 3, Radau 3, the
    implicit and the velocity-implicit Euler method.
    """
    analysis: Any = import_module("pydrake.systems.analysis")
    builder: Any = import_module("pydrake.systems.framework").DiagramBuilder()
    plant = builder.AddSystem(import_module("pydrake.multibody.plant").MultibodyPlant(0.0))
    _fill_plant(plant, robot)
    forces = builder.AddSystem(_drake_forces(robot, velocity))
    builder.Connect(plant.get_state_output_port(), forces.get_input_port())
    builder.Connect(forces.get_output_port(), plant.get_actuation_input_port())
    simulator = analysis.Simulator(builder.Build())
    analysis.ResetIntegratorFromFlags(simulator, "runge_kutta3", 0.1)
    integrator = simulator.get_mutable_integrator()
    integrator.set_target_accuracy(0.1 * velocity)
    integrator.set_maximum_step_size(0.1 * robot.t_end)
    return simulator, plant


def _fill_plant(plant: Any, robot: _Robot) -> None:
    tree: Any = import_module("pydrake.multibody.tree")
    pose: Any = import_module("pydrake.math").RigidTransform
    links: list[Any] = []
    for b in robot.bodies:
        i = b.inertia.inertia
        about = tree.RotationalInertia(i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
        body = tree.SpatialInertia.MakeFromCentralInertia(b.inertia.mass, b.inertia.lever, about)
        link = plant.AddRigidBody(b.joint.name, body)
        base = plant.world_frame() if b.parent < 0 else links[b.parent].body_frame()
        offset = pose(b.placement.homogeneous)
        frame = plant.AddFrame(tree.FixedOffsetFrame(f"{b.joint.name}_origin", base, offset))
        kind = tree.PrismaticJoint if b.joint.unit == "m" else tree.RevoluteJoint
        joint = plant.AddJoint(kind(b.joint.name, frame, link.body_frame(), b.axis))
        actuator = plant.AddJointActuator(b.joint.name, joint)
        actuator.set_default_gear_ratio(1.0)
        actuator.set_default_rotor_inertia(b.armature)
        links.append(link)
    plant.mutable_gravity_field().set_gravity_vector(robot.scene.model.gravity.linear)
    plant.Finalize()


def _drake_forces(robot: _Robot, velocity: float) -> Any:
    """Efforts and smoothed friction as symbolic expressions of time and state."""
    symbolic: Any = import_module("pydrake.symbolic")
    primitives: Any = import_module("pydrake.systems.primitives")
    n, time = len(robot.bodies), symbolic.Variable("t")
    state = [symbolic.Variable(f"x{i}") for i in range(2 * n)]
    out = []
    for j, given in enumerate(robot.efforts):
        if isinstance(given, TableEffort):
            raise PinfricError("Drake: is given sines and constants as efforts, not tables")
        if isinstance(given, SineEffort):
            s = given.sine
            effort = s.amplitude * symbolic.sin(s.angular_frequency * time + s.phase)
        else:
            effort = symbolic.Expression(float(given))
        out.append(effort - robot.friction[j] * symbolic.tanh(state[n + j] / velocity))
    idle = symbolic.Variable("idle")  # without a state of its own it refuses to be integrated
    return primitives.SymbolicVectorSystem(
        time=time, state=[idle], input=state, dynamics=[symbolic.Expression(0.0)], output=out
    )
