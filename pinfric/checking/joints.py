"""Implausible values of a robot's joints, and parts of a URDF that need a decision."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pinfric.checking.findings import Finding, Severity, error, note, warning
from pinfric.checking.joint_loads import in_kgf_cm, joint_loads, one_limit
from pinfric.checking.robot import JointFacts, RobotFacts
from pinfric.checking.robot_masses import believed_weight
from pinfric.model.mistaken_units import ANGLES, LENGTHS, in_unit, likely_unit
from pinfric.model.robot import Robot
from pinfric.model.urdf import reductions

#: An infinite limit is written as the largest float: none is meant.
_UNLIMITED = 1e300
#: A turning joint rarely has a limit beyond so many rad; as degrees it would be at most that.
_MOST_ANGLE, _MOST_DEGREES = 20.0, 720.0
#: A sliding joint rarely goes so many m, nor so many times the robot's length.
_MOST_TRAVEL, _TRAVEL_OVER_LENGTH = 5.0, 3.0
#: Few joints turn faster than so many rad/s, or slide faster than so many m/s.
_FASTEST, _FASTEST_SLIDING = 60.0, 20.0
#: Roll, pitch and yaw are within a turn.
_TURN = 2.0 * math.pi + 0.01
_MOVING = ("revolute", "continuous", "prismatic", "planar")


def joint_findings(
    facts: RobotFacts, robot: Robot | None, meshes: bool = True
) -> Iterator[Finding]:
    """Yield findings joint by joint, then those on the URDF's drives and friction, if it loads.

    Effort limits are judged by masses, and these by meshes: without them they are left out.
    """
    for joint in facts.joints:
        yield from _placement(joint)
        if joint.type in _MOVING:
            yield from _limits(joint, facts.length)
            if not joint.has_axis:
                read, place = "read as 1 0 0, its x axis", f"joint {joint.name}"
                yield warning("axis", place, "no <axis>", read)
            yield from _masses(joint, facts)
            yield from _friction(joint)
    for name, leader in facts.lost.items():
        yield warning(
            "mimic",
            f"joint {name}",
            f"mimics {leader}",
            "which does not exist; the joint gets its own drive",
        )
    if robot is not None:
        if meshes:
            yield from _efforts(robot, facts)
        movable = set(robot.model.names)
        stated = {name: d for name, d in robot.dynamics.items() if name in movable and any(d)}
        if stated:
            name, d = next(iter(stated.items()))
            more = f" and {len(stated) - 1} more" if len(stated) > 1 else ""
            rotor = f", armature {d.armature:g}" if d.armature else ""
            yield note(
                "dynamics",
                "robot",
                f"{'<dynamics> of' if robot.key == 'urdf' else 'joint'} {name} (friction "
                f"{d.friction:g}, damping {d.damping:g}{rotor}){more}",
                "`pinfric new` notes it beside its guesses; `urdf_dynamics: use` in a scene uses "
                "it",
            )
        if gears := robot.gears:
            shown = ", ".join(f"{name} {ratio:g}" for name, ratio in list(gears.items())[:3])
            more = f" and {len(gears) - 3} more" if len(gears) > 3 else ""
            yield note(
                "reductions",
                "robot",
                f"<transmission> gives {shown}{more}",
                "`pinfric new` writes these ratios, without losses or rotor inertia: a URDF has "
                "none",
            )
    for name, ratio in reductions(facts.root).items():
        if all(joint.name != name for joint in facts.joints):
            said = "a <transmission> names it", "there is no such joint"
        elif not math.isfinite(ratio) or ratio == 0.0:
            said = f"<mechanicalReduction> {ratio:g}", "connects nothing"
        else:
            continue
        yield warning("transmission", f"joint {name}", *said)


def _placement(joint: JointFacts) -> Iterator[Finding]:
    worst = max(map(abs, joint.rpy), default=0.0)
    if worst > _TURN:
        unit = likely_unit(ANGLES, lambda size: size * worst <= _TURN)
        yield Finding(
            Severity.ERROR if unit else Severity.WARNING,
            "rpy",
            f"joint {joint.name}",
            f"origin rpy {' '.join(f'{x:g}' for x in joint.rpy)} rad",
            "more than a turn",
            in_unit(unit, "rad", worst),
            worst / _TURN,
        )


def _limits(joint: JointFacts, length: float) -> Iterator[Finding]:
    place = f"joint {joint.name}"
    if joint.limit is None:
        return
    low, high = joint.stated("lower"), joint.stated("upper")
    widest = max(abs(end) for end in (low, high, 0.0) if abs(end) < _UNLIMITED)
    if joint.type in ("revolute", "prismatic") and low == high == 0.0:
        yield warning(
            "no range",
            place,
            "limits 0 to 0",
            "it could not move; read as a joint without limits",
        )
    elif joint.type in ("revolute", "prismatic") and low == high:
        yield note("no range", place, f"limits {low:g} to {high:g}", "it cannot move")
    elif joint.type == "revolute" and _MOST_ANGLE < widest <= _MOST_DEGREES:
        yield error(
            "range",
            place,
            f"limits {low:g} to {high:g} rad",
            f"{widest / (2 * math.pi):.3g} turns",
            f"if they are in degrees: {math.radians(low):.3g} to {math.radians(high):.3g} rad",
            widest / _MOST_ANGLE,
        )
    elif joint.type == "prismatic" and widest > max(_MOST_TRAVEL, _TRAVEL_OVER_LENGTH * length):
        unit = likely_unit(LENGTHS, lambda size: size * widest < 0.2 * _MOST_TRAVEL)
        yield Finding(
            Severity.ERROR if unit else Severity.WARNING,
            "range",
            place,
            f"limits {low:g} to {high:g} m",
            f"the robot is {length:.3g} m long",
            in_unit(unit, "m", widest),
            widest / _MOST_TRAVEL,
        )
    speed, sliding = joint.stated("velocity"), joint.type == "prismatic"
    fastest = _FASTEST_SLIDING if sliding else _FASTEST
    if fastest < speed < math.inf:
        unit = None if sliding else likely_unit(ANGLES, lambda size: speed <= _MOST_DEGREES)
        yield note(
            "speed",
            place,
            f"velocity limit {speed:g} {'m' if sliding else 'rad'}/s",
            "a placeholder?" if sliding else f"{speed * 30 / math.pi:.3g} revolutions per minute",
            in_unit(unit, "rad/s", speed).replace("degrees", "degrees per second"),
            speed / fastest,
        )


def _masses(joint: JointFacts, facts: RobotFacts) -> Iterator[Finding]:
    masses = facts.masses
    own = facts.fixed_to(joint.child)
    if facts.moved_mass(joint) > 0.0 and all(masses[link] == 0.0 for link in own):
        shaped = any(link in facts.drawn and link in facts.shapes for link in own)
        yield Finding(
            Severity.WARNING if shaped else Severity.NOTE,
            "massless link",
            f"link {joint.child}",
            "has shapes and no mass" if shaped else "has no mass",
            f"it moves with joint {joint.name}",
        )


def _friction(joint: JointFacts) -> Iterator[Finding]:
    """Friction above what the drive can give: it would never move."""
    effort, friction = joint.stated("effort"), joint.friction
    if 0.0 < effort < friction:
        unit = "N" if joint.type == "prismatic" else "N m"
        yield warning(
            "friction",
            f"joint {joint.name}",
            f"<dynamics> friction {friction:g} {unit}",
            f"its effort limit is {effort:g} {unit}",
            excess=friction / effort,
        )


def _efforts(robot: Robot, facts: RobotFacts) -> Iterator[Finding]:
    held_out = believed_weight(facts, robot.model)
    loads = joint_loads(robot.model, held_out)
    unit = ""
    if held_out and any(load.remark and not load.sliding for load in loads):
        unit = in_kgf_cm(robot.model, held_out)
    for load in loads:
        driven = load.degrees == 1 and load.leader is None
        place = f"joint {load.name}"
        if load.remark or (driven and load.limit == 0.0):
            kind, remark = ("effort limit" if load.remark else "no effort limit"), load.remark
            why = f"`pinfric new` sizes its bearing for {load.why}"
            yield note(kind, place, remark or kind, why, unit if remark else "")
        elif 0.0 < load.limit < load.held:
            yield warning(
                "weak limit",
                place,
                f"its effort limit, {load.limit:.4g} N m",
                f"its weight alone needs {load.held:.4g} N m: it cannot hold itself, unless a "
                "spring helps",
                excess=load.held / load.limit,
            )
    turning = [x for x in loads if x.limit > 0 and not x.sliding and x.leader is None]
    limits, own = [x.limit for x in turning], [x.held for x in turning]
    if held_out and not any(x.remark for x in turning) and one_limit(limits, own, held_out):
        yield note(
            "equal limits",
            "robot",
            f"all {len(limits)} effort limits are {limits[0]:.4g} N m",
            "one motor everywhere, or a placeholder",
        )
