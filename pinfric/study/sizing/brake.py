"""Which joints stay where they are without power, and the brakes that hold the others.

Power may fail anywhere along a cycle. At every pose of it, at rest and with the payloads carried
there, statics leaves the effort that holds a joint an interval: friction in joints and gears may
help or oppose, as its history left it. A brake at the motor's shaft that bears the interval's worst
end, where friction helps least, never slips; one that bears its least end holds once it has slipped
until friction helps. Without a brake a joint stays where friction alone bears the load.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinfric.dynamics.forward.holds import holds
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.errors import PinfricError
from pinfric.model.described import EFFORT, derived, described, quantity
from pinfric.study.sizing.catalog import Brake, Conditions
from pinfric.study.sizing.criterion import Criterion, Status, compare
from pinfric.study.sizing.demand import largest
from pinfric.study.summary import effort_unit, ends_by_magnitude

_SOURCE = "Machine Design, Mechantronics Q & A: Hold it steady (2007): factor 1.5 to 3"
_STATICS = (
    "limits of static friction (pinfric.holds) at the pose that takes most of them; Harmonic "
    "Drive: back-driving torque must not be counted on to hold a load"
)
#: Of the robot's largest load: what is smaller is rounding, and a joint without load stays.
_NOTHING = 1e-9
_HOLDING, _BRAKE = "holding without power", "holding brake"


@described
class Standstill:
    """What it takes to keep a joint where it is when power fails, worst case along the cycle.

    Attributes:
        criteria: holding without power, and the brake.
    """

    effort: tuple[float, float] = quantity(
        "(least, worst) at the joint: friction helps as much, or as little, as may be",
        EFFORT,
        "at the\njoint",
    )
    shaft: tuple[float, float] | None = quantity(
        "the same at the motor's shaft; none without a transmission",
        "N m",
        "at the\nmotor",
    )
    use: float | None = quantity(
        "part of static friction's limits, in joint and gear, that holding without power takes "
        "where it takes most, all other joints held; none: it moves, or is not known",
        heading="without\nbrake",
    )
    held: bool | None = quantity("friction alone holds it there; none: not known")
    time: float = quantity("when the cycle is there", "s")
    brake: str | None = quantity(
        "smallest of the catalogue that bears `shaft`, if any", heading="smallest brake"
    )
    criteria: tuple[Criterion, ...]

    @property
    @derived(heading="margin", cell="{margin:%}")
    def margin(self) -> float | None:
        """What the brake has left of its torque; none: not known, or none is needed."""
        return self.criteria[-1].margin


def standstills(
    result: InverseResult, brakes: Mapping[str, Brake], conditions: Conditions
) -> tuple[Standstill, ...]:
    """Return what keeps each drive's joint in place without power, in the order of the drives.

    Args:
        result: of the cycle; its scene has the gears.
        brakes: of the catalogue. conditions: whether a brake is required, and its reserve.
    """
    zero, states = np.zeros_like(result.states.v), result.states
    still = inverse_dynamics(result.scene, states.q, zero, zero, attached=states.attached)
    return tuple(_standstill(result, still, i, brakes, conditions)
                 for i in range(len(result.scene.drives)))  # fmt: skip


def _standstill(
    result: InverseResult,
    still: InverseResult,
    i: int,
    brakes: Mapping[str, Brake],
    conditions: Conditions,
) -> Standstill:
    worst, least = ends_by_magnitude(still.effort_lower[:, i], still.effort_upper[:, i])
    effort, shaft = (largest(least), largest(worst)), None
    gear = still.scene.drives[i].transmission
    slides = effort_unit(still.scene, i) == "N"
    if gear is not None and not (slides and gear.ratio == 1.0):  # a linear motor has no shaft
        worst, least = ends_by_magnitude(
            still.motor_torque_lower[:, i], still.motor_torque_upper[:, i]
        )
        shaft = largest(least), largest(worst)
    pose = _hardest(still, i)
    use, held = _use(still, i, pose)
    needed = conditions.holding_brake == "required" or (
        conditions.holding_brake == "where_needed" and not held
    )
    name, brake = _braked(shaft, brakes, conditions.brake_factor, needed)
    assert result.t is not None  # size refuses a motion without times
    return Standstill(effort, shaft, use, held, float(result.t[pose]), name,
                      (_unpowered(use, held), brake))  # fmt: skip


def _hardest(still: InverseResult, i: int) -> int:
    """The pose at which friction must bear most of what it can: load over limit is greatest."""
    lower, upper = still.motor_torque_lower[:, i], still.motor_torque_upper[:, i]
    gear = still.scene.drives[i].transmission
    load = still.effort_frictionless[:, i] / (1.0 if gear is None else gear.ratio)
    limit = np.where(load > 0, load - lower, upper - load)
    return int(np.argmax(np.abs(load) / np.maximum(limit, 1e-12 * max(largest(load), 1.0))))


def _use(still: InverseResult, i: int, pose: int) -> tuple[float | None, bool | None]:
    """Return the part of its friction that a joint takes, the others held, and whether it holds."""
    ends = still.motor_torque_lower[pose, i], still.motor_torque_upper[pose, i]
    if not still.scene.loops:  # in an open chain each joint's statics is its own
        if not ends[0] <= 0.0 <= ends[1]:
            return None, False
        if abs(still.effort_frictionless[pose, i]) <= _NOTHING * largest(still.effort_frictionless):
            return 0.0, True
    scene, effort = still.scene, still.effort_frictionless[pose].copy()
    effort[i] = 0.0
    carried = still.states.attached
    attached = None if carried is None else [
        name for name, on in zip(scene.payloads, carried[pose], strict=True) if on
    ]  # fmt: skip
    given = {"effort": effort}
    ratios = [None if d.transmission is None else d.transmission.ratio for d in scene.drives]
    if None not in ratios:
        given = {"motor_torque": effort / np.array(ratios, dtype=float)}
    try:
        found = holds(scene, still.states.q[pose], attached=attached, **given)
    except PinfricError:
        return None, None
    return (found.use if found.held else None), found.held


def _unpowered(use: float | None, held: bool | None) -> Criterion:
    formula = "static friction needed / its limit <= 1, power off and all other joints held"
    if held is not False:
        return compare(_HOLDING, use, 1.0, "", formula, _STATICS, "a statics that is decided")
    return Criterion(_HOLDING, Status.NOT_REQUIRED, None, 1.0, "", None, formula, _STATICS,
                     "it moves: friction alone does not hold it")  # fmt: skip


def _braked(
    shaft: tuple[float, float] | None, brakes: Mapping[str, Brake], factor: float, needed: bool
) -> tuple[str | None, Criterion]:
    """The brake of least torque that bears the worst end, of equal ones the lightest, then that of
    least power; and its criterion. (Stops at speed are not looked at: few makers print limits.)"""
    wanted = None if shaft is None else factor * shaft[1]
    formula = f"{factor:g} max |T_m| at rest, friction helping least <= torque of the brake"
    unknown = np.inf
    ranked = sorted(brakes, key=lambda name: (brakes[name].torque, brakes[name].mass or unknown,
                                              brakes[name].power or unknown))  # fmt: skip
    name = next((n for n in ranked if wanted is not None and brakes[n].torque >= wanted), None)
    if name is not None:
        return name, compare(_BRAKE, wanted, brakes[name].torque, "N m", formula, _SOURCE,
                             note=f"{name}: {_described(brakes[name])}")  # fmt: skip
    strongest = brakes[ranked[-1]].torque if ranked else None
    found = compare(_BRAKE, wanted, strongest, "N m", formula, _SOURCE,
                    "brakes in the catalogue" if wanted is not None else "gear and motor",
                    "" if strongest is None else f"{ranked[-1]}, the strongest")  # fmt: skip
    if needed:
        return None, found
    return None, Criterion(_BRAKE, Status.NOT_REQUIRED, wanted, strongest, "N m", None, formula,
                           _SOURCE, "none of the catalogue bears it" * bool(ranked))  # fmt: skip


def _described(brake: Brake) -> str:
    parts = [f"{brake.torque:g} N m"]
    for value, text in ((brake.voltage, "{:g} V"), (brake.power, "{:g} W"),
                        (brake.release_time, "opens in {:g} s"),
                        (brake.engage_time, "closes in {:g} s"),
                        (brake.stop_energy, "{:g} J a stop")):  # fmt: skip
        parts += [text.format(value)] if value is not None else []
    return ", ".join(parts) + f" ({brake.grade}: {brake.source})"
