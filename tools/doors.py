"""Every public function and every command once, as on a machine where pinfric has just arrived.

    python tools/doors.py                  all of them: a minute of two cores
    python tools/doors.py holds simulate   some

Tests run compiled kernels, many in one process; here each function runs in a process of its own,
with no compiled kernel, an empty cache, and all the patience for which kernels are interpreted.
Findings are exceptions, exit codes, numbers that are none, and processes that do not end. Processes
are forked from one that has imported pinfric and called no kernel; what they compile is not kept.
Solvers compile all they need, so a test has them (`tests/dynamics/forward/test_solver.py`,
`.ci/run`).
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).parents[1]
#: A process that takes longer (s of processor time, whatever else runs) does not end.
LIMIT = 40.0
#: These compute for long, and then compile: nothing wrong in so long is enough.
LONG = ("stop", "pinfric stop", "retime", "pinfric retime", "pinfric accuracy", "pinfric paper")
LONG_LIMIT = 8.0

BEGIN = """
import pathlib

import numpy as np
import pinfric as pf
arm, loop = pf.load_scene("three_link"), pf.load_scene("four_bar")
q, v, a = np.random.default_rng(1).normal(size=(3, 5, 3))
closed, still = loop.close(loop.start_configuration), np.zeros(loop.model.nv)
def is_number(*found):
    assert all(np.isfinite(x).all() for x in found), found
def motion(scene=arm):
    return pf.load_trajectory("way.yaml" if scene is arm else "loop.yaml", scene)
"""
#: Public name -> what calls it. Classes of results are made by the functions beside them.
FUNCTIONS = {
    "Scene": "pf.Scene(model=arm.model, friction=arm.friction); print(arm)",
    "load_scene": "print(loop)",
    "inverse_dynamics": """
for scene in (arm, loop):
    result = pf.inverse_dynamics(scene, motion(scene))
    is_number(result.effort_lower)
    assert result.check().passed(1e-9)
is_number(pf.inverse_dynamics(arm, q[0], v[0], a[0]).effort_upper)
list(pf.inverse_dynamics(arm, q, v, a, chunks=2))
""",
    "stand": """
legs = "{pinfric: 1, robot: {urdf: 'example-robot-data:go2_description/urdf/go2.urdf', "
feet = ", ".join(f"{end}_foot: {{}}" for end in ("FL", "FR", "RL", "RR"))
pathlib.Path("dog.yaml").write_text(f"{legs}floating: true}}, feet: {{{feet}}}}}")
dog = pf.load_scene("dog.yaml")
stood = np.array([[0.0] * 6 + [1.0] + [0.0, 0.8, -1.5] * 4])
rest = np.zeros((1, dog.model.nv))
found = pf.stand(dog, pf.Trajectory.from_arrays(dog, [0.0], stood, rest, rest))
is_number(found.effort_lower, found.effort_upper)
""",
    "joint_wrenches": "is_number(pf.joint_wrenches(arm, q, v, a))",
    "consistent_motion": """
names = [loop.joint_names[0]]
is_number(*pf.consistent_motion(loop, closed[None], names, np.ones((1, 1)), np.zeros((1, 1))))
""",
    "forward_dynamics": """
is_number(pf.forward_dynamics(arm, q[0], v[0], a[0]).a)
is_number(pf.forward_dynamics(arm, q[0], 0 * v[0], a[0]).a)
is_number(pf.forward_dynamics(loop, closed, still, np.zeros(len(loop.drives))).a)
""",
    "holds": "pf.holds(arm, q[0], a[0]); pf.holds(loop, closed, np.zeros(len(loop.drives)))",
    "simulate": """
for method in ("event", "timestepping", "regularized"):
    found = pf.simulate(arm, q[0], v[0], a[0], 0.02, method)
    is_number(found.q, found.v)
    found.energy()
""",
    "load_motion": "pf.simulate(arm, t_end=0.02).save('m.npz'); pf.load_motion('m.npz', arm)",
    "load_trajectory": "motion()",
    "elasticity": """
lines = {"k1": 3e4, "k2": 5e4, "t1": 14}
gear = {"ratio": 100, "stiffness": lines}
elastic = [{"joint": name, "transmission": gear} for name in arm.joint_names]
pf.elasticity(pf.inverse_dynamics(arm.with_(actuators=elastic), motion())).summary()
""",
    "export": "pf.export(arm, motion()); pf.export(arm, motion(), 'cpp')",
    "actuator_law": """
law = pf.actuator_law(arm, pf.export(arm, to="actuator"))
is_number(*law(q[0], v[0], a[0]))
""",
    "mujoco_friction": """
import mujoco
model = mujoco.MjModel.from_xml_string(pf.export(arm).text)
friction, data = pf.mujoco_friction(arm, model), mujoco.MjData(model)
friction.start(data)
friction.step(data)
is_number(friction.limit(data), friction.normal_load(data))
""",
    "size": "pf.size(arm, motion())",
    "load_catalog": "pf.load_catalog('default')",
    "check": "pf.check('robots/three_link.urdf')",
    "plot": "pf.plot(pf.inverse_dynamics(arm, motion()))",
    "summary": "pf.summary(pf.inverse_dynamics(arm, motion()))",
    "stop": "pf.stop(pf.load_scene('braked.yaml'), motion()).summary()",
    "retime": "pf.retime(arm, motion(), 'motors.yaml')",
    "sweep": "pf.sweep(arm, motion(), 'sweep.yaml', processes=1)",
    "replay": "pf.replay(arm, pf.simulate(arm, t_end=0.02), html='page.html')",
    "excite": "pf.excite(pf.load_scene('pendulum'), duration=20.0)",
    "identify": "pf.identify(pf.load_scene('pendulum'), ['log.csv'], effort_at='joint')",
    "Path": "pf.Path.from_trajectory(motion())",
    "CompensationOptions": "pf.CompensationOptions(scale=1.0)",
}
#: Arguments of every command.
COMMANDS = {
    "inverse": ["three_link", "way.yaml", "--out", "inverse"],
    "simulate": ["three_link", "--t-end", "0.02"],
    "size": ["three_link", "way.yaml"],
    "catalog": ["makers.csv"],
    "stop": ["braked.yaml", "way.yaml"],
    "retime": ["three_link", "way.yaml", "--motors", "motors.yaml"],
    "sweep": ["three_link", "way.yaml", "sweep.yaml", "--processes", "1"],
    "excite": ["pendulum", "--duration", "20"],
    "identify": ["pendulum", "log.csv", "--effort-at", "joint"],
    "replay": ["three_link", "way.yaml"],
    "new": ["robots/three_link.urdf", "--out", "new"],
    "robots": [],
    "schema": ["scene"],
    "check": ["three_link"],
    "explain": ["three_link", "way.yaml"],
    "export": ["three_link", "--to", "mjcf", "--trajectory", "way.yaml"],
    "accuracy": ["pendulum"],
    "paper": [],
}
WAY = """pinfric_trajectory: 1
sample_rate: 20
points:
  - {q: [0.0, 0.0, 0.0], hold: 0.1}
  - {q: [0.6, -0.5, 0.4], duration: 0.8}
  - {q: [0.2, -0.5, 0.9], duration: 0.6}
"""
LOOP = """pinfric_trajectory: 1
sample_rate: 20
joints: [crank_pin]
points: [{q: [0.5], hold: 0.1}, {q: [1.5], duration: 0.5}]
"""
GEAR = "{ratio: 50, rotor_inertia: 1.0e-4, brake: {torque: 1.0, engage_time: 0.02}}"
BRAKED = f"""pinfric: 1
robot: {{urdf: robots/three_link.urdf}}
actuators:
  - {{joint: joint_1, transmission: {GEAR}}}
  - {{joint: joint_12, transmission: {GEAR}}}
  - {{joint: joint_23, transmission: {GEAR}}}
stops: {{category: 0, reaction_time: 0.01}}
"""
MOTORS = "pinfric_motors: 1\nothers: {peak_torque: 200.0, max_speed: 20.0}\n"
TABLE = "Type,Mn,Mmax,J,n\nM1,0.5,2.0,5e-5,600\n"
COLUMNS = """section: motors
columns:
  name: Type
  continuous_torque: {column: Mn, unit: N m}
  peak_torque: {column: Mmax, unit: N m}
  rotor_inertia: {column: J, unit: kg m^2}
  max_speed: {column: n, unit: rad/s}
every: {source: invented, grade: R}
"""
SWEEP = """pinfric_sweep: 1
samples: 2
seed: 1
parameters: {friction.*.mu: {uniform: {low: 0.8, high: 1.2}}}
"""


def write_inputs(folder: Path) -> None:
    """Write small files: with few numbers kernels are interpreted."""
    import numpy as np
    import pinocchio as pin

    import pinfric as pf

    for name, text in {
        "way.yaml": WAY,
        "loop.yaml": LOOP,
        "braked.yaml": BRAKED,
        "motors.yaml": MOTORS,
        "sweep.yaml": SWEEP,
        "makers.csv": TABLE,
        "makers.columns.yaml": COLUMNS,
    }.items():
        (folder / name).write_text(text)
    shutil.copytree(ROOT / "robots", folder / "robots")
    model = pf.load_scene("pendulum").model
    t = np.arange(0.0, 12.0, 0.02)
    w = np.array([0.7, 1.9, 3.1])
    q = (np.sin(np.outer(t, w)) / w).sum(axis=1)
    v, a = np.cos(np.outer(t, w)).sum(axis=1), -(np.sin(np.outer(t, w)) * w).sum(axis=1)
    data, rng = model.createData(), np.random.default_rng(2)
    u = [
        pin.rnea(model, data, *np.array([[x], [y], [z]]))[0]
        for x, y, z in zip(q, v, a, strict=True)
    ]
    u = u + 0.5 * np.sign(v) + 0.1 * v + 0.01 * rng.normal(size=len(t))
    rows = np.column_stack([t, q, u])
    np.savetxt(
        folder / "log.csv", rows, "%.9g", ",", header="t,joint_1,joint_1.effort", comments=""
    )


def open_door(name: str, call: Callable[[], object], said: Path, folder: Path) -> NoReturn:
    """Do in a forked process what a user does in a new one; end it."""
    signal.setitimer(signal.ITIMER_PROF, LONG_LIMIT if name in LONG else LIMIT)
    os.chdir(folder)
    with said.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    code = 0
    try:
        call()
    except SystemExit as ended:
        code = int(ended.code or 0)
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    os._exit(code)


def run(calls: list[tuple[str, Callable[[], object]]], work: Path) -> int:
    """Run each door in a process of its own, as many at once as there are cores; count failures."""
    waiting, running, failed = calls[::-1], {}, 0
    while waiting or running:
        while waiting and len(running) < (os.cpu_count() or 1):
            name, call = waiting.pop()
            folder, said = work / name.replace(" ", "_"), work / f"{len(waiting)}.txt"
            shutil.copytree(work / "inputs", folder)
            child = os.fork()
            if child == 0:
                open_door(name, call, said, folder)
            running[child] = name, said, time.perf_counter()
        child, status = os.wait()
        name, said, start = running.pop(child)
        lines = said.read_text().strip().splitlines() or [""]
        code = os.waitstatus_to_exitcode(status)
        if code == -signal.SIGPROF:
            wrong = "" if name in LONG else f"no end in {LIMIT:g} s"
        else:
            wrong = f"exit {code}: {lines[-1]}" if code else ""
        print(f"{name:26} {time.perf_counter() - start:5.1f} s  {wrong or 'ok'}", flush=True)
        failed += bool(wrong)
    return failed


def doors(names: list[str]) -> list[tuple[str, Callable[[], object]]]:
    """Return (name, what it does) of those named, or of all."""
    from pinfric import cli

    found: list[tuple[str, Callable[[], object]]] = [
        (name, partial(exec, BEGIN + code, {})) for name, code in FUNCTIONS.items()
    ]
    found += [
        (f"pinfric {name}", partial(cli.main, [name, *given])) for name, given in COMMANDS.items()
    ]
    return [door for door in found if not names or door[0] in names]


def main() -> None:
    """Run the named doors, or all, and exit with 1 if one does not open."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        os.environ |= {"NUMBA_CACHE_DIR": str(work / "empty"), "MPLBACKEND": "agg"}
        sys.path.insert(0, str(ROOT))
        (work / "inputs").mkdir()
        write_inputs(work / "inputs")
        calls = doors(sys.argv[1:])
        failed = run(calls, work)
    print(f"{len(calls)} doors in {time.perf_counter() - begin:.0f} s, {failed} do not open")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
