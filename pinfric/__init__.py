"""pinfric: load-dependent joint friction, stiction intervals and motor sizing on Pinocchio."""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pinfric.model import upward

# Pinocchio's OpenMP threads would otherwise spin after each batch and starve the next kernel;
# it must be set before Pinocchio loads.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

__version__ = "1.0.0"

#: Errors and warnings, as documented.
_ERRORS = (
    "PinfricError",
    "SceneError",
    "RobotError",
    "TrajectoryError",
    "StateError",
    "LoopMotionError",
    "ClosureError",
    "UndrivenMotionError",
    "ToggleError",
    "RollMomentError",
    "AccelerationError",
    "NoConsistentAcceleration",
    "AmbiguousAcceleration",
    "UndecidedAcceleration",
    "GearJam",
    "SimulationError",
    "SimulationInterrupted",
    "StopError",
    "IdentificationError",
    "CatalogError",
    "SizingError",
    "RetimeError",
    "SweepError",
    "PinfricWarning",
)
#: Public name -> its module, which is imported at first use so that `pinfric --help` starts fast.
_PUBLIC = {
    "Scene": "pinfric.model.scene",
    "load_scene": "pinfric.model.scene_file",
    "inverse_dynamics": "pinfric.dynamics.inverse.inverse",
    "InverseResult": "pinfric.dynamics.inverse.result",
    "stand": "pinfric.dynamics.inverse.standing",
    "Standing": "pinfric.dynamics.inverse.standing",
    "StickInterval": "pinfric.dynamics.inverse.result",
    "joint_wrenches": "pinfric.dynamics.samples.reactions",
    "consistent_motion": "pinfric.dynamics.samples.closure",
    "forward_dynamics": "pinfric.dynamics.forward.forward",
    "Instant": "pinfric.dynamics.forward.forward",
    "Solver": "pinfric.dynamics.forward.solver",
    "InverseInstant": "pinfric.dynamics.forward.solver",
    "InverseDerivatives": "pinfric.dynamics.derivatives.derivatives",
    "ForwardDerivatives": "pinfric.dynamics.derivatives.derivatives",
    "ParameterDerivatives": "pinfric.dynamics.derivatives.parameters",
    "Smoothed": "pinfric.dynamics.derivatives.smoothed",
    "CompensationOptions": "pinfric.dynamics.forward.compensation",
    "warm_up": "pinfric.dynamics.warm_up",
    "holds": "pinfric.dynamics.forward.holds",
    "StaticHold": "pinfric.dynamics.forward.holds",
    "simulate": "pinfric.dynamics.simulation.simulate",
    "Motion": "pinfric.dynamics.simulation.motion",
    "load_motion": "pinfric.dynamics.simulation.motion_file",
    "Trajectory": "pinfric.motions.trajectory",
    "load_trajectory": "pinfric.motions.trajectory",
    "Log": "pinfric.motions.log.frame",
    "ReadingOptions": "pinfric.motions.log.reading",
    "elasticity": "pinfric.elastic.motion",
    "Elasticity": "pinfric.elastic.motion",
    "export": "pinfric.exporting.export",
    "Exported": "pinfric.exporting.export",
    "actuator_law": "pinfric.exporting.actuator_law",
    "mujoco_friction": "pinfric.exporting.mujoco_bridge",
    "MujocoFriction": "pinfric.exporting.mujoco_bridge",
    "excite": "pinfric.identification.excite",
    "Excitation": "pinfric.identification.excite",
    "identify": "pinfric.identification.identify",
    "Identified": "pinfric.identification.identify",
    "size": "pinfric.sizing.size",
    "SizingReport": "pinfric.sizing.report",
    "Duty": "pinfric.drives.duty",
    "load_catalog": "pinfric.drives.catalog_file",
    "check": "pinfric.checking.plausibility",
    "CheckReport": "pinfric.checking.findings",
    "plot": "pinfric.show.views",
    "summary": "pinfric.show.views",
    "retime": "pinfric.retiming.retime",
    "RetimeResult": "pinfric.retiming.retime",
    "Path": "pinfric.retiming.path",
    "stop": "pinfric.stops.study",
    "StopResult": "pinfric.stops.study",
    "sweep": "pinfric.sweeps.run",
    "SweepResult": "pinfric.sweeps.result",
    "replay": "pinfric.show.replay.replay",
    **dict.fromkeys(_ERRORS, "pinfric.errors"),
}

__all__ = [*_PUBLIC, "__version__"]

if TYPE_CHECKING:  # the same names for type checkers, which do not run __getattr__
    from pinfric.checking.findings import CheckReport as CheckReport
    from pinfric.checking.plausibility import check as check
    from pinfric.drives.catalog_file import load_catalog as load_catalog
    from pinfric.drives.duty import Duty as Duty
    from pinfric.dynamics.derivatives.derivatives import ForwardDerivatives as ForwardDerivatives
    from pinfric.dynamics.derivatives.derivatives import InverseDerivatives as InverseDerivatives
    from pinfric.dynamics.derivatives.parameters import ParameterDerivatives as ParameterDerivatives
    from pinfric.dynamics.derivatives.smoothed import Smoothed as Smoothed
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
    from pinfric.dynamics.inverse.standing import Standing as Standing
    from pinfric.dynamics.inverse.standing import stand as stand
    from pinfric.dynamics.samples.closure import consistent_motion as consistent_motion
    from pinfric.dynamics.samples.reactions import joint_wrenches as joint_wrenches
    from pinfric.dynamics.simulation.motion import Motion as Motion
    from pinfric.dynamics.simulation.motion_file import load_motion as load_motion
    from pinfric.dynamics.simulation.simulate import simulate as simulate
    from pinfric.dynamics.warm_up import warm_up as warm_up
    from pinfric.elastic.motion import Elasticity as Elasticity
    from pinfric.elastic.motion import elasticity as elasticity
    from pinfric.errors import AccelerationError as AccelerationError
    from pinfric.errors import AmbiguousAcceleration as AmbiguousAcceleration
    from pinfric.errors import CatalogError as CatalogError
    from pinfric.errors import ClosureError as ClosureError
    from pinfric.errors import GearJam as GearJam
    from pinfric.errors import IdentificationError as IdentificationError
    from pinfric.errors import LoopMotionError as LoopMotionError
    from pinfric.errors import NoConsistentAcceleration as NoConsistentAcceleration
    from pinfric.errors import PinfricError as PinfricError
    from pinfric.errors import PinfricWarning as PinfricWarning
    from pinfric.errors import RetimeError as RetimeError
    from pinfric.errors import RobotError as RobotError
    from pinfric.errors import RollMomentError as RollMomentError
    from pinfric.errors import SceneError as SceneError
    from pinfric.errors import SimulationError as SimulationError
    from pinfric.errors import SimulationInterrupted as SimulationInterrupted
    from pinfric.errors import SizingError as SizingError
    from pinfric.errors import StateError as StateError
    from pinfric.errors import StopError as StopError
    from pinfric.errors import SweepError as SweepError
    from pinfric.errors import ToggleError as ToggleError
    from pinfric.errors import TrajectoryError as TrajectoryError
    from pinfric.errors import UndecidedAcceleration as UndecidedAcceleration
    from pinfric.errors import UndrivenMotionError as UndrivenMotionError
    from pinfric.exporting.actuator_law import actuator_law as actuator_law
    from pinfric.exporting.export import Exported as Exported
    from pinfric.exporting.export import export as export
    from pinfric.exporting.mujoco_bridge import MujocoFriction as MujocoFriction
    from pinfric.exporting.mujoco_bridge import mujoco_friction as mujoco_friction
    from pinfric.identification.excite import Excitation as Excitation
    from pinfric.identification.excite import excite as excite
    from pinfric.identification.identify import Identified as Identified
    from pinfric.identification.identify import identify as identify
    from pinfric.model.scene import Scene as Scene
    from pinfric.model.scene_file import load_scene as load_scene
    from pinfric.motions.log.frame import Log as Log
    from pinfric.motions.log.reading import ReadingOptions as ReadingOptions
    from pinfric.motions.trajectory import Trajectory as Trajectory
    from pinfric.motions.trajectory import load_trajectory as load_trajectory
    from pinfric.retiming.path import Path as Path
    from pinfric.retiming.retime import RetimeResult as RetimeResult
    from pinfric.retiming.retime import retime as retime
    from pinfric.show.replay.replay import replay as replay
    from pinfric.show.views import plot as plot
    from pinfric.show.views import summary as summary
    from pinfric.sizing.report import SizingReport as SizingReport
    from pinfric.sizing.size import size as size
    from pinfric.stops.study import StopResult as StopResult
    from pinfric.stops.study import stop as stop
    from pinfric.sweeps.result import SweepResult as SweepResult
    from pinfric.sweeps.run import sweep as sweep


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        value = _load(name)
        globals()[name] = value  # later accesses skip this function, which takes 3 us
        return value
    raise AttributeError(f"module 'pinfric' has no attribute {name!r}")


#: What lower rooms call and users do not.
_INTERNAL = {"findings_of": "pinfric.checking.plausibility"}


def _load(name: str) -> Any:
    return getattr(import_module((_PUBLIC | _INTERNAL)[name]), name)


def _from_below(name: str) -> Any:
    """Return a function that imports a name at its first call and calls it."""
    return lambda *given, **named: _load(name)(*given, **named)


for _name in upward.NAMES:
    upward.register(_name, _from_below(_name))


def __dir__() -> list[str]:
    return sorted(__all__)
