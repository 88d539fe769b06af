"""Computing time against accuracy: simulation, sampling of a trajectory, models of friction.

Studies of one scene: `precision` simulates it by three methods with many settings,
`sampling` thins its motion, `ladder`
climbs from no friction to all of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pinfric.accuracy.ladder import Rung, ladder
from pinfric.accuracy.precision import (
    Run,
    compete,
    contestants,
    judge_of,
    reference,
)
from pinfric.accuracy.sampling import Sampled, sampling
from pinfric.dynamics.samples.states import MotionLike
from pinfric.dynamics.simulation.motion import Motion
from pinfric.errors import PinfricError, SceneError
from pinfric.model.brief import file_name, screen
from pinfric.model.described import described, quantity
from pinfric.model.scene import Scene
from pinfric.model.upward import Shown
from pinfric.motions.trajectory import Trajectory

#: Samples of the scene's own motion where no trajectory is given.
_SAMPLES = 2001


@described
class Accuracy(Shown):
    """Computing time against accuracy for one scene."""

    def __repr__(self) -> str:
        methods = dict.fromkeys(run.method for run in self.runs)
        return screen(
            "Accuracy",
            f"{file_name(self.scene.source)}: {self.trajectory}",
            {
                "simulations": f"{len(self.runs)}, by {', '.join(methods)}" if methods else "",
                "more": ".runs .sampling .ladder .summary() .plot()",
            },
        )

    scene: Scene
    trajectory: str = quantity(
        "name of the motion used for the sampling and for the friction models"
    )
    runs: tuple[Run, ...] = quantity("simulations; empty if the scene has no `simulation`")
    sampling: tuple[Sampled, ...] = quantity("the motion with fewer samples")
    ladder: tuple[Rung, ...] = quantity("models of friction")
    notes: tuple[str, ...] = quantity("parts that could not be studied, and why")


def accuracy(
    scene: Scene,
    trajectory: Trajectory | None = None,
    *,
    rounds: int = 3,
) -> Accuracy:
    """Measure computing time against accuracy.

    Args:
        scene: the robot; its `simulation` section is simulated.
        trajectory: motion for inverse dynamics; None takes the simulated motion.
        rounds: timings of each contestant, of which the median counts.

    Raises:
        SceneError: there is neither a `simulation` section nor a trajectory.
        PinfricError: the motion has no solution.
    """
    if scene.simulation is None and trajectory is None:
        raise SceneError(
            f"{scene.source}: has no `simulation` section; give it one, or name a trajectory"
        )
    notes: list[str] = []
    motion = _reference(scene, notes)
    runs: tuple[Run, ...] = ()
    if motion is not None:
        runs = compete(contestants(scene), judge_of(motion), rounds)
    given: MotionLike
    if trajectory is not None:
        given, name = trajectory, Path(trajectory.source).name
    elif motion is not None:
        given = motion.sample(np.linspace(0.0, motion.t[-1], _SAMPLES))
        name = "its own simulation"
    else:
        raise PinfricError(f"{scene.source}: {notes[0]}; a trajectory can be studied")
    return Accuracy(
        scene=scene,
        trajectory=name,
        runs=runs,
        sampling=sampling(scene, given),
        ladder=ladder(scene, given, rounds),
        notes=tuple(notes),
    )


def _reference(scene: Scene, notes: list[str]) -> Motion | None:
    """The scene's own motion; None, with a note, where there is none."""
    if scene.simulation is None:
        notes.append("simulation: not studied, the scene has no `simulation` section")
        return None
    try:
        return reference(scene)
    except PinfricError as problem:
        reason = " ".join(str(problem).split()).removeprefix(f"{scene.source}: ")
        notes.append(f"simulation: not studied, {reason}")
        return None
