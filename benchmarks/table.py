"""Every goal for speed, measured in one run, as one table of ratios.

    python benchmarks/table.py                      some minutes
    python benchmarks/table.py --peers              MuJoCo and Drake, too: more minutes
    python benchmarks/table.py --against REVISION   what moved by more than 10 % since then

Contestants of one row are timed in turn, round by round; medians count. `--rows STUDY` measures
the rows of one function. Against a revision, each is run by this file with the package here and
with that revision's in turn, in processes of their own; a row that one of them lacks is named.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pinfric as pf  # isort: skip - before Pinocchio loads: it sets how threads wait

import numpy as np
import pinocchio as pin

if __name__ == "__main__":
    TESTS = Path(__file__).parents[1] / "tests"
    sys.path[:0] = [str(TESTS / "helpers"), str(TESTS)]  # cases, as pytest finds them

from pinfric.model.robot import example_robot_data  # isort: skip
from measure import all_seconds, machine, median_seconds, states, ur5, with_pins  # isort: skip
from peers import compete_with_peers  # isort: skip

SAMPLES = 20_000
ROOT = Path(__file__).parents[1]
#: Rounds in turn against another revision; what moved by more is shown.
ROUNDS, MOVED = 3, 0.1
GEAR = {
    "ratio": 100.0,
    "efficiency": 0.8,
    "back_efficiency": 0.7,
    "no_load_torque": 0.01,
    "rotor_inertia": 1e-5,
}


@dataclass(frozen=True)
class Row:
    """One goal: subject, rival, figure and its limit (same unit)."""

    what: str
    against: str
    figure: float
    goal: float
    unit: str = "x"
    at_least: bool = False
    more: str = ""

    @property
    def met(self):
        return self.figure >= self.goal if self.at_least else self.figure <= self.goal

    def cells(self):
        unit = "" if self.unit == "x" else f" {self.unit}"
        sign = "≥" if self.at_least else "≤"
        met = "yes" if self.met else "no"
        figure = f"{self.figure:.3g}{unit}" if self.figure > 0 else "-"
        return (self.what, self.against, figure, f"{sign} {self.goal:g}{unit}", met, self.more)


def inverse():
    """20,000 samples of the UR5 on one thread, with six pins and without friction."""
    model = ur5()
    scene, plain, (q, v, a) = with_pins(model), pf.Scene(model=model), states(model, SAMPLES)
    data, pool, out = model.createData(), pin.ModelPool(model, 1), np.empty((SAMPLES, 6))
    t = np.arange(float(SAMPLES))  # as a motion: with its reversals

    def loop():
        for i in range(SAMPLES):
            pin.rnea(model, data, q[i], v[i], a[i])

    s = median_seconds(
        {
            "loop": loop,
            "parallel": lambda: pin.rneaInParallel(1, pool, q.T, v.T, a.T, out.T),
            "pins": lambda: pf.inverse_dynamics(scene, q, v, a, t=t, threads=1),
            "plain": lambda: pf.inverse_dynamics(plain, q, v, a, t=t, threads=1),
        },
        rounds=15,
    )
    each = {name: 1e6 * seconds / SAMPLES for name, seconds in s.items()}
    what = "inverse dynamics, UR5, six pins"
    return [
        Row(
            what,
            "Python loop over pin.rnea, no friction",
            s["pins"] / s["loop"],
            0.9,
            more=f"{each['pins']:.2f} to {each['loop']:.2f} us a sample",
        ),
        Row(
            what,
            "rneaInParallel, no friction",
            s["pins"] / s["parallel"],
            1.7,
            more=f"{each['pins']:.2f} to {each['parallel']:.2f} us a sample",
        ),
        Row(
            "inverse dynamics, UR5, frictionless",
            "rneaInParallel",
            s["plain"] / s["parallel"],
            1.15,
            more=f"{each['plain']:.2f} to {each['parallel']:.2f} us a sample",
        ),
    ]


def threads():
    """Four threads against one, beside the gain of Pinocchio's own batch on this machine.

    The best runs count, as the nearest to the goal's four idle cores.
    """
    model = ur5()
    scene, (q, v, a) = with_pins(model), states(model, 100_000)
    out, t = np.empty((100_000, 6)), np.arange(100_000.0)
    pools = {n: pin.ModelPool(model, n) for n in (1, 4)}
    ours = {n: lambda n=n: pf.inverse_dynamics(scene, q, v, a, t=t, threads=n) for n in (1, 4)}
    bare = {-n: lambda n=n: pin.rneaInParallel(n, pools[n], q.T, v.T, a.T, out.T) for n in (1, 4)}
    times = all_seconds(ours | bare, rounds=25)
    s = {n: min(values) for n, values in times.items()}
    median = np.median(times[1]) / np.median(times[4])
    more = f"medians {median:.2f}; rneaInParallel alone {s[-1] / s[-4]:.2f}; needs four idle cores"
    return [
        Row(
            "inverse dynamics, UR5, four threads",
            "one thread",
            s[1] / s[4],
            2.5,
            at_least=True,
            more=more,
        )
    ]


#: Prints MB on top of q, v, a, in a process of its own.
MEMORY = """
import sys
sys.path.insert(0, {folder!r})
import pinfric as pf
from measure import states, ur5, with_pins
def resident(key):
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) / 1024
model = ur5(); scene = with_pins(model)
q, v, a = states(model, 1_000_000)
for warm in pf.inverse_dynamics(scene, q[:1000], v[:1000], a[:1000], threads=1, chunks=500): pass
open("/proc/self/clear_refs", "w").write("5")  # the peak counts from here
before = resident("VmRSS")
for part in pf.inverse_dynamics(scene, q, v, a, threads=1, chunks=20_000): pass
print(resident("VmHWM") - before)
"""


def memory_in_chunks():
    code = MEMORY.format(folder=str(Path(__file__).parent))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    used = max(float(done.stdout), 0.1)
    return [Row("memory for 1,000,000 samples, in chunks", "q, v, a alone", used, 300, "MB")]


def forward():
    """One call of forward dynamics where all slides: UR5, two loops, a coupled guide."""
    model = ur5()
    rng = np.random.default_rng(0)
    q, v, u = rng.uniform(-2, 2, 6), rng.uniform(-2, 2, 6), rng.uniform(-20, 20, 6)
    data = model.createData()
    states = {"UR5, six pins": (with_pins(model), q, v, u, 8)}
    for name, goal in (("drawer", 10), ("four_bar", 12), ("slider_crank", 12)):
        scene = pf.load_scene(name)
        motion = pf.load_trajectory(f"{name}.waypoints.yaml", scene)
        moving = int(np.argmax(np.abs(motion.v).min(axis=1)))
        states[name] = scene, motion.q[moving], motion.v[moving], np.ones(len(scene.drives)), goal
    rows = []
    for name, (scene, *state, goal) in states.items():
        s = median_seconds(
            {
                "aba": lambda: pin.aba(model, data, q, v, u),
                "pinfric": lambda scene=scene, state=state: pf.forward_dynamics(scene, *state),
            },
            rounds=41,
            calls=200,
        )
        more = f"{1e6 * s['pinfric']:.1f} to {1e6 * s['aba']:.1f} us a call"
        rows.append(
            Row(
                f"forward dynamics, {name}",
                "pin.aba of the UR5",
                s["pinfric"] / s["aba"],
                goal,
                more=more,
            )
        )
    return rows


def solver():
    """A prepared solver, one state at a time, everything sliding: a 7-axis arm with gears, UR5."""
    rng, arm, model = np.random.default_rng(0), pf.load_scene("panda_pick_and_place"), ur5()
    state = tuple(rng.uniform(-1, 1, (3, 7)))  # rows of an array would be made at every call
    q, v, u = rng.uniform(-2, 2, 6), rng.uniform(-2, 2, 6), rng.uniform(-20, 20, 6)
    arm_data, data = arm.model.createData(), model.createData()
    inverse, scene = arm.solver().inverse, with_pins(model)
    forward, geared = (
        scene.solver().forward,
        scene.with_(
            actuators=[{"joint": name, "transmission": GEAR} for name in tuple(model.names)[1:]]
        )
        .solver()
        .forward,
    )
    torque = u / GEAR["ratio"]
    s = median_seconds(
        {
            "rnea": lambda: pin.rnea(arm.model, arm_data, *state),
            "inverse": lambda: inverse(*state),
            "aba": lambda: pin.aba(model, data, q, v, u),
            "forward": lambda: forward(q, v, u),
            "geared": lambda: geared(q, v, motor_torque=torque),
        },
        rounds=101,
        calls=30,
    )
    return [
        Row(
            "`Solver.inverse`, 7-axis arm with gears",
            "pin.rnea",
            s["inverse"] / s["rnea"],
            6,
            more=f"{1e6 * s['inverse']:.1f} to {1e6 * s['rnea']:.1f} us a call",
        ),
        Row(
            "`Solver.forward`, UR5, six pins",
            "pin.aba",
            s["forward"] / s["aba"],
            8,
            more=f"{1e6 * s['forward']:.1f} to {1e6 * s['aba']:.1f} us a call",
        ),
        Row(
            "the same with six gears, motor torque given",
            "without gears",
            s["geared"] / s["forward"],
            1.3,
            more=f"{1e6 * s['geared']:.1f} us a call",
        ),
    ]


def at_rest_and_moving():
    """One second of a slider-crank that friction locks, and of a six-bar that swings."""
    from mechanisms import cut_slider_crank, six_bar

    locked, _ = cut_slider_crank()
    locked = locked.with_(
        friction={
            name: {
                **entry.model_dump(exclude_none=True),
                "coulomb": {"static": 8.0, "kinetic": 8.0},
            }
            for name, entry in locked.friction.items()
        }
    )
    scene, q = six_bar()
    v, _ = pf.consistent_motion(scene, q[None], ["crank"], np.array([[6.0]]), np.array([[0.0]]))
    still, none = np.zeros(locked.model.nv), np.zeros(1)
    start = locked.close(pin.neutral(locked.model))
    s = median_seconds(
        {
            "locked": lambda: pf.simulate(locked, start, still, none, 1.0),
            "moving": lambda: pf.simulate(scene, q, v[0], none, 1.0),
        },
        rounds=5,
    )
    return [
        Row("simulate a locked slider-crank 1 s", "", s["locked"], 1.0, "s"),
        Row("simulate a six-bar 1 s", "", s["moving"], 2.0, "s"),
    ]


def simulation():
    """One second of the paper's three links."""
    scene = pf.load_scene("three_link")

    def run():
        return pf.simulate(scene, np.zeros(3), [1.0, -1.0, 1.0], None, 1.0, rtol=1e-8)

    seconds = median_seconds({"run": run}, rounds=9)["run"]
    count = run().evaluations
    more = f"{count} right-hand sides, {1e6 * seconds / count:.0f} us each"
    return [Row("simulate three_link 1 s, rtol 1e-8", "", seconds, 0.25, "s", more=more)]


def loops():
    """The four-bar turning, friction in all four pins."""
    from cases import Case, turning_four_bar
    from mechanisms import four_bar

    case = turning_four_bar(SAMPLES, "B", "planar_pin")
    bare = Case(four_bar("B", "planar_pin", friction={})[0], case.q, case.v, case.a)
    s = median_seconds(
        {"pins": lambda: case.inverse(threads=1), "bare": lambda: bare.inverse(threads=1)}, rounds=7
    )
    each = {name: 1e6 * seconds / SAMPLES for name, seconds in s.items()}
    what = "inverse dynamics, four-bar, four pins"
    return [
        Row(
            what,
            "the same without friction",
            s["pins"] / s["bare"],
            5,
            more=f"{each['pins']:.1f} to {each['bare']:.1f} us a sample",
        ),
        Row(what, "", each["pins"], 30, "us"),
    ]


def without_loads():
    """Measured robots whose friction no load changes, everything sliding, against plain ABA."""
    rows, rng = [], np.random.default_rng(0)
    for name in ("ur10", "panda"):
        scene = pf.load_scene(name)
        data, solver = scene.model.createData(), scene.solver()
        q, v, u = (row.copy() for row in rng.uniform(0.5, 1, (3, scene.model.nv)))
        contestants = {
            "aba": partial(pin.aba, scene.model, data, q, v, u),
            "rnea": partial(pin.rnea, scene.model, data, q, v, u),
            "forward": partial(solver.forward, q, v, u),
            "inverse": partial(solver.inverse, q, v, u),
        }
        s = median_seconds(contestants, rounds=41, calls=200)
        for what, plain in (("forward", "aba"), ("inverse", "rnea")):
            more = f"{1e6 * s[what]:.1f} to {1e6 * s[plain]:.1f} us a call"
            ratio = s[what] / s[plain]
            rows.append(Row(f"`Solver.{what}`, {name}", f"pin.{plain}", ratio, 2.5, more=more))
    return rows


def breaking_away():
    """Robots at rest about to move, each effort 0.6 to 1.6 half widths off the holding one."""
    rows, rng = [], np.random.default_rng(0)
    for name, given in (
        ("panda", "effort"),
        ("ur10", "effort"),
        ("panda_pick_and_place", "effort"),
        ("ur10_machine_tending", "motor_torque"),
    ):
        scene = pf.load_scene(name)
        n, solver, times = scene.model.nv, scene.solver(), []
        still = np.zeros(n)
        for _ in range(60):
            q = pin.integrate(scene.model, pin.neutral(scene.model), rng.normal(size=n))
            found = pf.inverse_dynamics(scene, q[None], still[None], still[None])
            low, high = (getattr(found, f"{given}_{end}")[0] for end in ("lower", "upper"))
            off = 0.5 * (high - low) * rng.choice([-1, 1], n) * rng.uniform(0.6, 1.6, n)
            effort = {given: 0.5 * (low + high) + off}
            with contextlib.suppress(pf.errors.AmbiguousAcceleration):
                run = partial(solver.forward, q, still, **effort)
                times.append(median_seconds({"run": run}, rounds=3)["run"])
        most = f"99 % {1e3 * np.quantile(times, 0.99):.2f} ms"
        what = f"`Solver.forward`, {name} about to move, {given}"
        rows.append(Row(what, "", 1e3 * np.median(times), 0.2, "ms", more=most))
    return rows


def many_joints():
    """Trees of 50 and 200 joints that slide, and 20 four-bars at rest beside each other."""
    from builders import random_states, random_tree
    from mechanisms import beside, four_bar

    rows = []
    for n, goal in ((50, 12), (200, 20)):
        model = random_tree(1, n, 0.0)
        data, ((q, *_), (v, *_), (u, *_)) = model.createData(), random_states(model, 0, 1)
        entry = {"coulomb": {"static": 1.0, "kinetic": 0.8}}
        forward = (
            pf.Scene(model=model, friction=dict.fromkeys(model.names[1:], entry)).solver().forward
        )
        contestants = {
            "aba": partial(pin.aba, model, data, q, v, u),
            "forward": partial(forward, q, v, u),
        }
        s = median_seconds(contestants, rounds=21, calls=10)
        more = f"{1e6 * s['forward']:.0f} to {1e6 * s['aba']:.0f} us a call"
        what = f"`Solver.forward`, {n} joints, constant friction"
        rows.append(Row(what, "pin.aba", s["forward"] / s["aba"], goal, more=more))
    bars, angles = four_bar(static=0.4)
    q, many = bars.close(angles(np.array([1.0, 0.3, 1.2]))), beside(*[bars] * 20)
    one, all_of_them = bars.solver().forward, many.solver().forward
    s = median_seconds(
        {
            "one": lambda: one(q, np.zeros(3), np.array([9.0])),
            "all": lambda: all_of_them(np.tile(q, 20), np.zeros(60), np.full(20, 9.0)),
        },
        rounds=3,
    )
    what, more = "20 four-bars that break away", f"{1e3 * s['all']:.0f} to {1e3 * s['one']:.1f} ms"
    return [*rows, Row(what, "20 times one", s["all"] / s["one"] / 20, 2, more=more)]


def resting_loops():
    """Bundled loops held along their paths, against their own motion."""
    rows = []
    for name, goal in (("four_bar", 2), ("slider_crank", 2), ("excavator", 2), ("delta", 10)):
        scene = pf.load_scene(name)
        motion = pf.load_trajectory(f"{name}.waypoints.yaml", scene)
        q, v, a = motion.q, motion.v, motion.a
        moves = ~pf.inverse_dynamics(scene, q, v, a).sticking.any(axis=1)
        held, solve = q[:: 1 + len(q) // 500], partial(pf.inverse_dynamics, scene, threads=1)
        still = np.zeros((len(held), scene.model.nv))
        contestants = {
            "rest": partial(solve, held, still, still),
            "moving": partial(solve, q[moves], v[moves], a[moves]),
        }
        s = median_seconds(contestants, rounds=7)
        rest, moving = 1e6 * s["rest"] / len(held), 1e6 * s["moving"] / moves.sum()
        more = f"{rest:.1f} to {moving:.1f} us a sample"
        rows.append(
            Row(f"inverse dynamics, {name} at rest", "moving", rest / moving, goal, more=more)
        )
    return rows


def hard_inverse():
    """The delta at rest, where balls hold, and a legged robot with wrenches on its feet."""
    scene = pf.load_scene("delta")
    q, still = pf.load_trajectory("delta.waypoints.yaml", scene).q[0], np.zeros(scene.model.nv)
    robot = example_robot_data() / "solo_description/robots/solo12.urdf"
    model = pin.buildModelFromUrdf(str(robot), pin.JointModelFreeFlyer())
    entry, drives = {"coulomb": {"static": 0.1, "kinetic": 0.1}}, list(model.names)[2:]
    base = [f"root_joint.{x}" for x in ("vx", "vy", "vz", "wx", "wy", "wz")]
    legs = pf.Scene(
        model=model,
        friction={name: entry for name in drives},
        actuators=[{"joint": name} for name in [*base, *drives]],
    )
    feet = {f"{leg}_FOOT": np.r_[0.0, 0.0, 6.0, np.zeros(3)] for leg in ("FL", "FR", "HL", "HR")}
    place, moving = pin.neutral(model), np.full(model.nv, 0.1)
    driven, free = legs.solver(), legs.with_(actuators=legs.actuators[6:]).solver()
    base = driven.inverse(place, moving, moving, external=feet).effort_lower[:6].copy()
    contestants = {
        "rest": partial(scene.solver().inverse, q, still, still),
        "feet": partial(driven.inverse, place, moving, moving, external=feet),
        "free": partial(free.inverse, place, moving, moving, external=feet | {"base_link": base}),
    }
    s = median_seconds(contestants, rounds=15, calls=5)
    return [
        Row("`Solver.inverse`, delta at rest", "", 1e3 * s["rest"], 1, "ms"),
        Row("`Solver.inverse`, solo12 with feet", "", 1e6 * s["feet"], 15, "us"),
        Row("the same, its base undriven", "", 1e6 * s["free"], 15, "us"),
    ]


def sweeps():
    """A cycle of a bundled sweep, with drives on trial and without, against inverse dynamics."""
    from pinfric.sweeps.file import load_sweep

    scene = pf.load_scene("panda_pick_and_place")
    motion = pf.load_trajectory("panda_pick_and_place.csv", scene)
    entries = load_sweep("panda_pick_and_place.sweep.yaml")[0]
    bare = entries.model_copy(update={"motors": {}})
    run = partial(pf.sweep, scene, motion, processes=1)
    s = median_seconds(
        {
            "inverse": lambda: pf.inverse_dynamics(scene, motion, threads=1),
            "drives": lambda: run(entries),
            "bare": lambda: run(bare),
        },
        rounds=3,
        clock=time.process_time,
    )
    rows = []
    for name, what, goal in (("drives", "with drives on trial", 0.2), ("bare", "bare", 0.15)):
        each, sample = s[name] / entries.samples, 1e6 / len(motion.t)
        more = f"{each * sample:.2f} to {s['inverse'] * sample:.2f} us a sample, {s[name]:.2f} s"
        what = f"sweep panda_pick_and_place, {what}, a cycle"
        rows.append(Row(what, "inverse dynamics", each / s["inverse"], goal, more=more))
    return rows


def commands():
    """What commands compute for one scene each, in processor time."""
    from identify_cases import guess, log

    arm, braked = pf.load_scene("ur10_machine_tending"), pf.load_scene("ur10_braked")
    cycle = pf.load_trajectory("ur10_machine_tending", arm)
    panda, measured = pf.load_scene("panda_pick_and_place"), log(0, 20.0, 125.0)
    path, bar = pf.load_trajectory("panda_pick_and_place.csv", panda), pf.load_scene("four_bar")
    identify = partial(pf.identify, guess(0), [measured])
    runs = {
        "check ur10_machine_tending": (lambda: pf.check("ur10_machine_tending"), 0.08, 9),
        "size ur10_machine_tending": (lambda: pf.size(arm, cycle, "default"), 0.7, 5),
        "retime panda_pick_and_place": (lambda: pf.retime(panda, path), 0.3, 5),
        "identify a UR5, a log of 20 s": (identify, 7.0, 1),
        "simulate four_bar": (lambda: pf.simulate(bar), 1.2, 5),
        "stop ur10_braked": (lambda: pf.stop(braked, cycle), 15.0, 1),
    }
    rows = []
    for what, (run, goal, rounds) in runs.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pf.PinfricWarning)
            seconds = median_seconds({"": run}, rounds, clock=time.process_time)[""]
        rows.append(Row(what, "", seconds, goal, "s"))
    return rows


def sizings():
    """Yield `size` of the bundled scenes in processor time, warm, with drives, one by one."""
    for file in sorted((ROOT / "robots").glob("*.waypoints.yaml")):
        name = file.name.removesuffix(".waypoints.yaml")
        scene = pf.load_scene(name)
        motion = pf.load_trajectory(str(file), scene)
        found = []

        def run(scene=scene, motion=motion, found=found):
            found[:] = [pf.size(scene, motion, "default", on_miss="ignore")]

        seconds = median_seconds({"": run}, rounds=3, clock=time.process_time)[""]
        more = found[0].verdict.headline.split(";")[0]
        yield Row(f"size {name}", "", seconds, 0.25, "s", more=more)


# ---------------------------------------------------------------- peers


def swinging_ur5():
    """The UR5 of `robots/`, thrown about by sines for half a second, with its own constants."""
    from pinfric.model.schema import Simulation

    scene = pf.load_scene("ur5_pick_and_place")
    drive = dict(
        zip(scene.joint_names, ((30, 4), (60, 3), (25, 5), (6, 6), (6, 5), (5, 4)), strict=True)
    )
    sines = {
        name: {"sine": {"amplitude": amplitude, "angular_frequency": frequency}}
        for name, (amplitude, frequency) in drive.items()
    }
    start = {"q": {"shoulder_lift_joint": -1.2, "elbow_joint": 0.8}}
    simulation = Simulation.model_validate({"start": start, "effort": sines, "t_end": 0.5})
    constants = {name: entry.coulomb.kinetic for name, entry in scene.friction.items()}
    return dataclasses.replace(scene, simulation=simulation), constants


def peer_rows():
    """Time of `event` to an error of q below a bound, against the fastest peer that reaches it."""
    rows = []
    cases = {
        "pendulum": (pf.load_scene("pendulum"), {"joint_1": 0.29}),
        "three_link": (pf.load_scene("three_link"), {"joint_12": 9.1}),
        "UR5": swinging_ur5(),
    }
    for name, (scene, constants) in cases.items():
        runs, missing = compete_with_peers(scene, constants)
        for line in missing:
            print(line)
        for bound in (1e-3, 1e-4, 1e-5):
            rows += [
                row for who in ("MuJoCo", "Drake") if (row := _against(name, runs, who, bound))
            ]
    return rows


def _against(name, runs, who, bound):
    """Our time over theirs at one bound; None if the peer is not installed."""

    def quickest(method):
        there = [r.wall_s for r in runs if r.method.startswith(method) and r.error <= bound]
        return min(there, default=float("inf"))

    if not any(run.method.startswith(who) for run in runs):
        return None
    ours, theirs = quickest("event"), quickest(who)
    reached = np.isfinite(theirs)
    more = f"{1e3 * ours:.3g} ms to {f'{1e3 * theirs:.3g} ms' if reached else 'never'}"
    return Row(
        f"simulate {name} to {bound:.0e} rad, constant friction", who, ours / theirs, 1, more=more
    )


#: In the README's order.
STUDIES = (
    inverse,
    memory_in_chunks,
    threads,
    forward,
    solver,
    simulation,
    at_rest_and_moving,
    loops,
    without_loads,
    breaking_away,
    many_joints,
    resting_loops,
    hard_inverse,
    sweeps,
    commands,
    sizings,
)


def moves(revision, studies):
    """Yield what each study's rows moved by since a revision: row, ratio of each round."""
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder) / "tree"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", str(there), revision], check=True)
        try:
            for study in studies:
                ours, theirs = ({}, {})
                for _ in range(ROUNDS):
                    for tree, figures in ((ROOT, ours), (there, theirs)):
                        for what, figure in _measured_in(tree, study.__name__).items():
                            figures.setdefault(what, []).append(figure)
                for what in ours.keys() & theirs.keys():
                    yield what, [a / b for a, b in zip(ours[what], theirs[what], strict=True)]
                for what in ours.keys() ^ theirs.keys():
                    yield f"{what}, measured {'here' if what in ours else 'there'} only", []
        finally:
            subprocess.run([*git, "remove", "--force", str(there)], check=True)


def _measured_in(tree, study):
    """The figures of a study's rows with a tree's package, which may lack what it calls."""
    command = [sys.executable, __file__, "--rows", study, "--json"]
    environment = os.environ | {"PYTHONPATH": str(tree)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        print(f"{study} fails with {tree}: {done.stderr.strip().splitlines()[-1]}")
    return dict(json.loads(line) for line in done.stdout.splitlines())


def main():
    known = {study.__name__: study for study in (*STUDIES, peer_rows)}
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--peers", action="store_true")
    options.add_argument("--rows", choices=known, action="append")
    options.add_argument("--against", metavar="REVISION")
    options.add_argument("--json", action="store_true")
    given = options.parse_args()
    studies = [known[name] for name in given.rows or ()] or list(STUDIES)
    if given.peers:
        studies.append(peer_rows)
    if given.against:
        print(machine())
        for what, ratios in moves(given.against, studies):
            ratio = statistics.median(ratios or [1.0])
            if not ratios:
                print(what, flush=True)
            elif abs(ratio - 1.0) > MOVED:
                ends = f"{min(ratios):.2f} to {max(ratios):.2f}"
                print(f"{what}: {ratio:.2f} times ({ends})", flush=True)
        return
    if not given.json:
        print(machine())
        print("\n| | against | measured | goal | met | |\n|---|---|---|---|---|---|", flush=True)
    for study in studies:
        for row in study():
            cells, pair = row.cells(), [f"{row.what} | {row.against}", row.figure]
            print(json.dumps(pair) if given.json else f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
