"""How cost grows: with joints, samples, friction sites, coupled sites, threads; memory, too.

    python benchmarks/scaling.py          prints the curves and draws scaling.png beside it

A fitted exponent p means cost ~ n^p: the slope of log cost over log n by least squares.
"""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pinfric as pf  # isort: skip - before Pinocchio loads: it sets how threads wait

import numpy as np
import pinocchio as pin

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # builders, as pytest finds them

from builders import random_inertia  # isort: skip
from measure import machine, median_seconds, states, ur5, with_pins  # isort: skip

JOINTS = (6, 10, 18, 32, 56, 100)
SAMPLES = (100, 1_000, 10_000, 100_000, 1_000_000)
CHUNK = 20_000
#: So little friction that long chains have an answer: the work is the same.
LIGHT = {"bearing": {"kind": "pin", "radius": 1e-3}, "mu": {"static": 0.01, "kinetic": 0.01}}


@dataclass(frozen=True)
class Curve:
    """Cost over size: `cost` in `unit`; the exponent where the cost should be a power."""

    what: str
    size: str
    n: tuple[int, ...]
    cost: tuple[float, ...]
    unit: str

    @property
    def exponent(self):
        return float(np.polyfit(np.log(self.n), np.log(self.cost), 1)[0])

    def line(self):
        values = "  ".join(f"{n}: {c:.3g}" for n, c in zip(self.n, self.cost, strict=True))
        return f"{self.what} ({self.unit}) over {self.size}\n    {values}"


def chain(joints):
    """Turning joints one after the other, about y and z in turn."""
    rng, model = np.random.default_rng(joints), pin.Model()
    for j in range(joints):
        kind = pin.JointModelRY() if j % 2 else pin.JointModelRZ()
        offset = pin.SE3(np.eye(3), np.array([0.1, 0.0, 0.0]))
        added = model.addJoint(j, kind, offset, f"joint_{j + 1}")
        model.appendBodyToJoint(added, random_inertia(rng), pin.SE3.Identity())
    return model


def over_joints(samples=2_000, rounds=7):
    """us per sample of inverse dynamics with a pin in every joint, and of Pinocchio without."""
    runs = {}
    for n in JOINTS:
        model = chain(n)
        scene, (q, v, a) = with_pins(model), states(model, samples)
        pool, out = pin.ModelPool(model, 1), np.empty((samples, n))
        runs["pinfric", n] = lambda s=scene, x=(q, v, a): pf.inverse_dynamics(s, *x, threads=1)
        runs["rneaInParallel", n] = lambda p=pool, x=(q, v, a), o=out: pin.rneaInParallel(
            1, p, *(part.T for part in x), o.T
        )
    seconds = median_seconds(runs, rounds)
    return [
        Curve(
            f"inverse dynamics, {who}",
            "joints",
            JOINTS,
            tuple(1e6 * seconds[who, n] / samples for n in JOINTS),
            "us per sample",
        )
        for who in ("pinfric", "rneaInParallel")
    ]


def forward_over_joints(rounds=9, calls=20):
    """us per call of forward dynamics, all joints sliding on pins, and of pin.aba."""
    runs = {}
    for n in JOINTS:
        model = chain(n)
        scene = pf.Scene(model=model, friction=dict.fromkeys(tuple(model.names)[1:], LIGHT))
        q, v, u = (x[0] for x in states(model, 1))
        data = model.createData()
        runs["pinfric", n] = lambda s=scene, x=(q, v, u): pf.forward_dynamics(s, *x)
        runs["pin.aba", n] = lambda m=model, d=data, x=(q, v, u): pin.aba(m, d, *x)
    seconds = median_seconds(runs, rounds, calls)
    return [
        Curve(
            f"forward dynamics, {who}",
            "joints",
            JOINTS,
            tuple(1e6 * seconds[who, n] for n in JOINTS),
            "us per call",
        )
        for who in ("pinfric", "pin.aba")
    ]


def over_samples(rounds=3, most=SAMPLES[-1]):
    """ms of a whole motion of the UR5 with six pins, in chunks."""
    model = ur5()
    scene = with_pins(model)
    sizes = tuple(n for n in SAMPLES if n <= most)
    q, v, a = states(model, sizes[-1])

    def solve(n):
        for _ in pf.inverse_dynamics(scene, q[:n], v[:n], a[:n], threads=1, chunks=CHUNK):
            pass

    seconds = median_seconds({n: lambda n=n: solve(n) for n in sizes}, rounds)
    return [
        Curve(
            "inverse dynamics, UR5, six pins, one thread",
            "samples",
            sizes,
            tuple(1e3 * seconds[n] for n in sizes),
            "ms",
        )
    ]


def over_sites(joints=32, samples=2_000, rounds=7):
    """us per sample of a chain with pins in 0, 1, 2, 4 ... all of its joints."""
    model = chain(joints)
    q, v, a = states(model, samples)
    counts = (0, 1, 2, 4, 8, 16, joints)
    scenes = {n: with_pins(model, n) for n in counts}
    seconds = median_seconds(
        {n: lambda s=s: pf.inverse_dynamics(s, q, v, a, threads=1) for n, s in scenes.items()},
        rounds,
    )
    cost = tuple(1e6 * seconds[n] / samples for n in counts)
    return [Curve(f"inverse dynamics, {joints} joints", "sites", counts, cost, "us per sample")]


def over_coupled_sites(rounds=5):
    """us per sample of the four-bar with friction in 0 to 4 of its pins."""
    whole = pf.load_scene("four_bar")
    motion = pf.load_trajectory("four_bar.waypoints.yaml", whole)
    moving = (np.abs(motion.v) > 1e-3).all(axis=1)
    q, v, a = (np.tile(x[moving], (3, 1)) for x in (motion.q, motion.v, motion.a))
    names = list(whole.friction)
    scenes = {
        n: dataclasses.replace(whole, friction={k: whole.friction[k] for k in names[:n]})
        for n in range(len(names) + 1)
    }
    seconds = median_seconds(
        {n: lambda s=s: pf.inverse_dynamics(s, q, v, a, threads=1) for n, s in scenes.items()},
        rounds,
    )
    cost = tuple(1e6 * seconds[n] / len(q) for n in scenes)
    return [
        Curve("inverse dynamics, four-bar", "coupled sites", tuple(scenes), cost, "us per sample")
    ]


def over_threads(samples=100_000, rounds=7):
    """Times faster than one thread: the UR5 with six pins."""
    model = ur5()
    scene, (q, v, a) = with_pins(model), states(model, samples)
    counts = tuple(n for n in (1, 2, 4, 8) if n <= (os.cpu_count() or 1))
    seconds = median_seconds(
        {n: lambda n=n: pf.inverse_dynamics(scene, q, v, a, threads=n) for n in counts}, rounds
    )
    faster = tuple(seconds[1] / seconds[n] for n in counts)
    return [
        Curve("inverse dynamics, UR5, six pins", "threads", counts, faster, "times faster than one")
    ]


_MEMORY = """
import sys
sys.path.insert(0, {folder!r})
import pinfric as pf
from measure import states, ur5, with_pins
def resident(key):
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) / 1024
model = ur5(); scene = with_pins(model)
q, v, a = states(model, {samples})
for warm in pf.inverse_dynamics(scene, q[:1000], v[:1000], a[:1000], threads=1, chunks=500): pass
open("/proc/self/clear_refs", "w").write("5")  # the peak counts from here
before = resident("VmRSS")
for part in pf.inverse_dynamics(scene, q, v, a, threads=1, chunks={chunk}): pass
print(resident("VmHWM") - before)
"""


def memory(most=SAMPLES[-1]):
    """MB on top of q, v, a: the whole result at once, and in chunks."""
    sizes, curves = tuple(n for n in SAMPLES if 10_000 <= n <= most), []
    for what, chunk in (("at once", most), (f"in chunks of {CHUNK:,}", CHUNK)):
        used = []
        for n in sizes:
            code = _MEMORY.format(folder=str(Path(__file__).parent), samples=n, chunk=chunk)
            done = subprocess.run(
                [sys.executable, "-c", code], capture_output=True, text=True, check=True
            )
            used.append(max(float(done.stdout), 0.1))
        curves.append(Curve(f"memory, UR5, six pins, {what}", "samples", sizes, tuple(used), "MB"))
    return curves


def measure_all():
    return [
        *over_joints(),
        *forward_over_joints(),
        *over_samples(),
        *over_sites(),
        *over_coupled_sites(),
        *over_threads(),
        *memory(),
    ]


def figure(curves):
    """Every curve, one panel for each kind of size and unit."""
    from matplotlib.figure import Figure

    kinds = list(dict.fromkeys((c.size, c.unit) for c in curves))
    made = Figure(figsize=(12.0, 3.6 * -(-len(kinds) // 3)), dpi=130, layout="constrained")
    panels = made.subplots(-(-len(kinds) // 3), 3, squeeze=False).ravel()
    colors = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
    for axes, kind in zip(panels, kinds, strict=False):
        for color, curve in zip(
            colors, (c for c in curves if (c.size, c.unit) == kind), strict=False
        ):
            power = kind[0] in ("joints", "samples")
            label = curve.what + (f"  ~ n^{curve.exponent:.2f}" if power else "")
            axes.plot(
                curve.n,
                curve.cost,
                color=color,
                marker="o",
                markeredgecolor="white",
                linewidth=1.8,
                label=label,
            )
            if power:
                axes.set_xscale("log")
                axes.set_yscale("log")
        bottom, top = axes.get_ylim()  # room for the legend above the curves
        axes.set_ylim(bottom if power else 0.0, 6 * top if power else 1.25 * top)
        axes.set_title(f"{kind[1]} over {kind[0]}", loc="left", fontsize=10.5)
        axes.grid(True, color="#E4E4E4", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, fontsize=8, loc="upper left")
    for unused in panels[len(kinds) :]:
        unused.set_visible(False)
    return made


def main():
    print(machine())
    curves = measure_all()
    for curve in curves:
        print(curve.line())
        if curve.size in ("joints", "samples"):
            print(f"    grows as n^{curve.exponent:.2f}")
    path = Path(__file__).with_name("scaling.png")
    figure(curves).savefig(path)
    print(f"drawn: {path}")


if __name__ == "__main__":
    main()
