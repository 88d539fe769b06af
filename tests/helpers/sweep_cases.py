"""Sweeps whose figures can be worked out by hand: a block pushed along a plane."""

from functools import cache

import builders
import numpy as np
from builders import example

import pinfric as pf

MASS, MU, G = 2.0, 0.2, 9.81


#: A motor and gear of the bundled catalogue.
DRIVE = "Kollmorgen TBM-6051-A + Harmonic Drive CSF-17-100"
BOX = {"link": "slab", "mass": 1.0, "com": [0.0, 0.0, 0.0]}


def pushed_block(**more):
    """A 2 kg block on a level plane, mu = 0.2; a box of 1 kg can stand on it."""
    model = builders.block(0.0, MASS)
    frame = builders.pin.Frame(
        "slab", 1, 0, builders.pin.SE3.Identity(), builders.pin.FrameType.BODY
    )
    model.addFrame(frame)
    options = {"friction": {"slide": builders.plane_friction(MU, MU)}, **more}
    return pf.Scene(model=model, **options)


def steady(scene, rate=0.5, acceleration=0.0):
    """One second along +x."""
    t = np.linspace(0.0, 1.0, 11)
    v = rate + acceleration * t
    x = rate * t + acceleration * t * t / 2
    return pf.Trajectory.from_arrays(
        scene, t, x[:, None], v[:, None], np.full((11, 1), acceleration)
    )


def sweep_of(samples=200, sampling="random", seed=3, motors=None, **parameters):
    """A sweep's content; parameters by name, with __ for the dots and `all` for *."""
    named = {k.replace("__", ".").replace(".all.", ".*."): v for k, v in parameters.items()}
    content = {"pinfric_sweep": 1, "sampling": sampling, "seed": seed, "parameters": named}
    if sampling != "grid":
        content["samples"] = samples
    return {**content, "motors": motors or {}}


def uniform(low, high, **more):
    return {"uniform": {"low": low, "high": high}, **more}


def steps(low, high, count):
    return {"steps": {"low": low, "high": high, "count": count}}


def run(scene, motion, sweep, **more):
    return pf.sweep(scene, motion, sweep, processes=1, **more)


@cache
def swept_panda(drive=DRIVE):
    """A sweep of the bundled panda with a drive on trial at its second joint."""
    scene, motion = example("panda_pick_and_place", "panda_pick_and_place.csv")
    varied = sweep_of(
        40,
        payload__box__mass=uniform(1.0, 3.0),
        friction__all__coulomb=uniform(0.5, 2.0, each=True),
        motors={"panda_joint2": {"drive": drive}},
    )
    return pf.sweep(scene, motion, varied, processes=1)
