"""Criteria of the whole robot on elastic gears: lowest frequency, the tool's place at rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pinfric.drives.criterion import Criterion, compare
from pinfric.drives.policy import Conditions, stated
from pinfric.elastic.motion import Elasticity, ToolPlace
from pinfric.errors import CatalogError
from pinfric.model.scene import Scene

_SOURCE = "pinfric: wind-up of the gears at rest, first order"
#: Condition -> what is compared, how far the tool is off, the formula.
_PLACES: dict[str, tuple[str, Callable[[ToolPlace], float | None], str]] = {
    "tool_sag": ("tool sag", lambda tool: tool.sag_distance, "max |J f(h)| at rest"),
    "tool_interval": (
        "tool interval",
        lambda tool: tool.farthest,
        "max half width in which static friction can hold the tool",
    ),
    "tool_reversal": (
        "tool reversal error",
        lambda tool: tool.reversal,
        "max |J (f(h + b) - f(h - b))| between opposite approaches",
    ),
}


def check_tool(scene: Scene, conditions: Conditions) -> None:
    """Refuse conditions on a tool that the scene does not name: `CatalogError`."""
    for key in _PLACES:
        if getattr(conditions, key) is not None and scene.tool is None:
            raise CatalogError(
                f"conditions.{key}: {scene.source} names no `tool`; name its link in the scene"
            )


def arm_criteria(
    scene: Scene, elastic: Elasticity | None, conditions: Conditions
) -> tuple[Criterion, ...]:
    """Return the criteria that the conditions ask for.

    Args:
        scene: with the chosen drives. elastic: what its elastic gears do; None without any.
    """
    unknown = [drive.name for drive in scene.drives if drive.spring is None]
    missing = f"stiffness of {', '.join(unknown)}" if unknown else ""
    criteria = []
    if conditions.lowest_frequency is not None:
        known = elastic is not None and not unknown
        criteria.append(
            compare(
                "lowest frequency",
                conditions.lowest_frequency,
                float(elastic.frequency[elastic.slowest])
                if elastic is not None and known
                else None,
                "Hz",
                "motors held, each gear with its tangent at the least torque it holds",
                "pinfric: natural frequencies over the cycle",
                missing,
                condition=stated(conditions, "lowest_frequency"),
            )
        )
    tools = [rest.tool for rest in elastic.rests if rest.tool is not None] if elastic else []
    for key, (name, figure, formula) in _PLACES.items():
        allowed = getattr(conditions, key)
        if allowed is not None:
            figures = [figure(tool) for tool in tools]
            known_figures = [] if unknown else [x for x in figures if x is not None]
            needed = max(known_figures, default=None)
            why = missing or "the cycle has no rest"
            said = stated(conditions, key)
            criteria.append(
                compare(name, needed, allowed, "m", formula, _SOURCE, why, condition=said)
            )
    return tuple(criteria)


def reversal_criteria(
    scene: Scene,
    elastic: Elasticity | None,
    conditions: Conditions,
    backlash: Sequence[float | None],
) -> tuple[Criterion, ...]:
    """Return the reversal error of each drive's joint; none where it is not asked for.

    Backlash, and wind-up by friction or, where greater, the gear's hysteresis, which is the same
    wind-up as its maker found it.

    Args:
        backlash: of each drive's gear, rad (m); None: not known.
    """
    if (allowed := conditions.reversal_error) is None:
        return ()
    criteria = []
    for d, drive in enumerate(scene.drives):
        wound = [
            abs(float(rest.wind_up_approach[d] - rest.wind_up_opposite[d]))
            for rest in (() if elastic is None else elastic.rests)
            if rest.wind_up_approach is not None and rest.wind_up_opposite is not None
        ]
        own = None if drive.transmission is None else drive.transmission.hysteresis
        least = max([*wound, own or 0.0]) + (backlash[d] or 0.0)
        lacks = [] if drive.spring is not None else ["stiffness"]
        lacks += ["backlash of the gear"] * (backlash[d] is None)
        if not lacks and not wound:
            lacks = ["the cycle has no rest that a motion leads to"]
        criteria.append(
            compare(
                "reversal error",
                least if not lacks or least > allowed else None,  # known in part it can only fail
                allowed,
                scene.drives[d].place_unit,
                "max |f(h + b) - f(h - b)| between opposite approaches + backlash",
                _SOURCE,
                ", ".join(lacks),
                condition=stated(conditions, "reversal_error"),
            )
        )
    return tuple(criteria)
