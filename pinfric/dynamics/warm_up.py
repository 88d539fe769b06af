"""Compile kernels before they are needed: for control loops, containers, demonstrations."""

from __future__ import annotations

import time
from contextlib import suppress

import numpy as np

from pinfric.dynamics.forward.holds import holds
from pinfric.dynamics.forward.solver import Solver
from pinfric.dynamics.forward.workspace import closed_configuration
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.simulation.simulate import METHODS, simulate
from pinfric.errors import PinfricError
from pinfric.kernels.compiled import compiling
from pinfric.model.scene import Scene, expect_scene

#: What is simulated (s): methods compile the same for any time.
_MOMENT = 1e-3


def warm_up(scene: Scene) -> float:
    """Compile the kernels that the dynamics of a scene need; return how long it took (s).

    They are those of `scene.solver()`, of `inverse_dynamics` on one thread and on several, of
    `forward_dynamics`, `holds` and `simulate` by every method. They are kept in numba's cache, from
    which later runs load them in a second or two. All open chains need the same kernels; gears,
    loops and drives off the joints need some more. A line on stderr says when something is
    compiled.
    """
    expect_scene(scene, "warm_up")
    start = time.perf_counter()
    q, zero, none = (
        closed_configuration(scene),
        np.zeros(scene.model.nv),
        np.zeros(len(scene.drives)),
    )
    with compiling():
        Solver(scene)
        rest = np.tile(q, (2, 1)), np.tile(zero, (2, 1)), np.tile(zero, (2, 1))
        for threads in (1, 2):
            with suppress(PinfricError):  # a scene whose drives cannot hold it has other kernels
                inverse_dynamics(scene, *rest, t=np.array([0.0, 1.0]), threads=threads)
        with suppress(PinfricError):
            holds(scene, q)
        for method in METHODS:
            with suppress(PinfricError):
                simulate(scene, q, zero, none, _MOMENT, method, progress=False).energy()
    return time.perf_counter() - start
