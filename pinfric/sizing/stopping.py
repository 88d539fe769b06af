"""The stops of a robot with the drives that were chosen for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pinfric.drives.brake import Standstill
from pinfric.drives.catalog import Brake
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import StopError
from pinfric.motions.trajectory import Trajectory
from pinfric.stops.study import StopResult, stop


def chosen_stops(
    result: InverseResult, holding: Sequence[Standstill], brakes: Mapping[str, Brake], cycle: str
) -> tuple[StopResult | None, str]:
    """Return the stops of a cycle with the chosen drives and brakes, or why there are none.

    Args:
        result: of the cycle; its scene has the chosen drives and says in `stops` how it is stopped.
        holding: of each drive, with the brake that it needs.
        brakes: of the catalogue. cycle: the trajectory's file.
    """
    scene, states = result.scene, result.states
    if scene.stops is None:
        return None, ""
    names = {
        drive.name: still.brake
        for drive, still in zip(scene.drives, holding, strict=True)
        if still.fitted and still.brake is not None
    }
    if slow := sorted({n for n in names.values() if brakes[n].engage_time is None}):
        return None, (
            f"stops: {', '.join(slow)} of the catalogue has no `engage_time`; give it the time (s) "
            "from power-off until it holds, as its maker states it"
        )
    actuators = []
    for actuator in scene.actuators or ():
        name, gear = names.get(actuator.drive_name), actuator.transmission
        if gear is not None and name is not None:
            braked = gear.model_copy(update={"brake": brakes[name].holding})
            actuator = actuator.model_copy(update={"transmission": braked})
        actuators.append(actuator)
    assert states.t is not None  # size refuses a motion without times
    carried = states.attached
    attached = {} if carried is None else dict(zip(scene.payloads, carried.T, strict=True))
    motion = Trajectory.from_arrays(
        scene, states.t, states.q, states.v, states.a, attached, source=cycle
    )
    try:
        return stop(scene.with_(actuators=actuators), motion), ""
    except StopError as problem:
        return None, str(problem)
