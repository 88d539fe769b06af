"""pinfric: load-dependent joint friction, stiction intervals and motor sizing on Pinocchio."""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pinfric.model import upward

# Pinocchio's OpenMP threads would otherwise spin after each batch and starve the next kernel;
# it must be set before Pinocchio loads.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

__version__ = "0.1.0"

#: Public name -> its module, which is imported at first use so that `pinfric --help` starts fast.
_PUBLIC = {
    "Scene": "pinfric.model.scene",
    "load_scene": "pinfric.model.scene_file",
    "inverse_dynamics": "pinfric.dynamics.inverse.inverse",
    "InverseResult": "pinfric.dynamics.inverse.result",
    "StickInterval": "pinfric.dynamics.inverse.result",
    "joint_wrenches": "pinfric.dynamics.samples.reactions",
    "consistent_motion": "pinfric.dynamics.samples.closure",
    "forward_dynamics": "pinfric.dynamics.forward.forward",
    "Instant": "pinfric.dynamics.forward.forward",
    "Solver": "pinfric.dynamics.forward.solver",
    "InverseInstant": "pinfric.dynamics.forward.solver",
    "CompensationOptions": "pinfric.dynamics.forward.compensation",
    "warm_up": "pinfric.study.warm_up",
    "holds": "pinfric.dynamics.forward.holds",
    "StaticHold": "pinfric.dynamics.forward.holds",
    "simulate": "pinfric.dynamics.simulation.simulate",
    "Motion": "pinfric.dynamics.simulation.motion",
    "load_motion": "pinfric.dynamics.simulation.motion_file",
    "run_scene": "pinfric.study.scene_run",
    "Trajectory": "pinfric.study.trajectory.trajectory",
    "load_trajectory": "pinfric.study.trajectory.trajectory",
    "Log": "pinfric.study.trajectory.log.arrays",
    "ReadingOptions": "pinfric.study.trajectory.log.reading",
    "elasticity": "pinfric.study.elastic.motion",
    "Elasticity": "pinfric.study.elastic.motion",
    "export": "pinfric.study.export.export",
    "Exported": "pinfric.study.export.export",
    "mujoco_friction": "pinfric.study.export.mujoco_bridge",
    "MujocoFriction": "pinfric.study.export.mujoco_bridge",
    "identify": "pinfric.study.identify.identify",
    "Identified": "pinfric.study.identify.identify",
    "size": "pinfric.study.sizing.size",
    "SizingReport": "pinfric.study.sizing.size",
    "Duty": "pinfric.study.sizing.duty",
    "load_catalog": "pinfric.study.sizing.catalog_file",
    "check": "pinfric.study.check.plausibility",
    "CheckReport": "pinfric.study.check.findings",
    "plot": "pinfric.show.views",
    "summary": "pinfric.show.views",
    "retime": "pinfric.study.retime.retime",
    "RetimeResult": "pinfric.study.retime.retime",
    "Path": "pinfric.study.retime.path",
    "RetimeError": "pinfric.errors",
    "stop": "pinfric.study.stop.study",
    "StopResult": "pinfric.study.stop.study",
    "sweep": "pinfric.study.sweep.run",
    "SweepResult": "pinfric.study.sweep.result",
    "replay": "pinfric.show.replay.replay",
    "PinfricError": "pinfric.errors",
    "PinfricWarning": "pinfric.errors",
}

__all__ = [*_PUBLIC, "__version__"]

if TYPE_CHECKING:  # the same names for type checkers, which do not run __getattr__
    from pinfric.dynamics.forward.compensation import CompensationOptions as CompensationOptions
    from pinfric.dynamics.forward.forward import Instant as Instant
    from pinfric.dynamics.forward.forward import forward_dynamics as forward_dynamics
    from pinfric.dynamics.forward.holds import StaticHold as StaticHold
    from pinfric.dynamics.forward.holds import holds as holds
    from pinfric.dynamics.forward.solver import InverseInstant as InverseInstant
    from pinfric.dynamics.forward.solver import Solver as Solver
    from pinfric.dynamics.inverse.inverse import inverse_dynamics as inverse_dynamics
    from pinfric.dynamics.inverse.result import InverseResult as InverseResult
    from pinfric.dynamics.inverse.result import StickInterval as StickInterval
    from pinfric.dynamics.samples.closure import consistent_motion as consistent_motion
    from pinfric.dynamics.samples.reactions import joint_wrenches as joint_wrenches
    from pinfric.dynamics.simulation.motion import Motion as Motion
    from pinfric.dynamics.simulation.motion_file import load_motion as load_motion
    from pinfric.dynamics.simulation.simulate import simulate as simulate
    from pinfric.errors import PinfricError as PinfricError
    from pinfric.errors import PinfricWarning as PinfricWarning
    from pinfric.errors import RetimeError as RetimeError
    from pinfric.model.scene import Scene as Scene
    from pinfric.model.scene_file import load_scene as load_scene
    from pinfric.show.replay.replay import replay as replay
    from pinfric.show.views import plot as plot
    from pinfric.show.views import summary as summary
    from pinfric.study.check.findings import CheckReport as CheckReport
    from pinfric.study.check.plausibility import check as check
    from pinfric.study.elastic.motion import Elasticity as Elasticity
    from pinfric.study.elastic.motion import elasticity as elasticity
    from pinfric.study.export.export import Exported as Exported
    from pinfric.study.export.export import export as export
    from pinfric.study.export.mujoco_bridge import MujocoFriction as MujocoFriction
    from pinfric.study.export.mujoco_bridge import mujoco_friction as mujoco_friction
    from pinfric.study.identify.identify import Identified as Identified
    from pinfric.study.identify.identify import identify as identify
    from pinfric.study.retime.path import Path as Path
    from pinfric.study.retime.retime import RetimeResult as RetimeResult
    from pinfric.study.retime.retime import retime as retime
    from pinfric.study.scene_run import run_scene as run_scene
    from pinfric.study.sizing.catalog_file import load_catalog as load_catalog
    from pinfric.study.sizing.duty import Duty as Duty
    from pinfric.study.sizing.size import SizingReport as SizingReport
    from pinfric.study.sizing.size import size as size
    from pinfric.study.stop.study import StopResult as StopResult
    from pinfric.study.stop.study import stop as stop
    from pinfric.study.sweep.result import SweepResult as SweepResult
    from pinfric.study.sweep.run import sweep as sweep
    from pinfric.study.trajectory.log.arrays import Log as Log
    from pinfric.study.trajectory.log.reading import ReadingOptions as ReadingOptions
    from pinfric.study.trajectory.trajectory import Trajectory as Trajectory
    from pinfric.study.trajectory.trajectory import load_trajectory as load_trajectory
    from pinfric.study.warm_up import warm_up as warm_up


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        found = getattr(import_module(_PUBLIC[name]), name)
        globals()[name] = found  # later accesses skip this function, which takes 3 us
        return found
    raise AttributeError(f"module 'pinfric' has no attribute {name!r}")


def _from_below(name: str) -> Any:
    """Return a function that calls a public name, which is imported at its first call."""
    return lambda *given, **named: __getattr__(name)(*given, **named)


for _name in upward.NAMES:
    upward.register(_name, _from_below(_name))


def __dir__() -> list[str]:
    return sorted(__all__)
