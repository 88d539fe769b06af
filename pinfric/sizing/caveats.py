"""Assumptions and limits of a sizing, in words for its reader."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from pinfric.drives.catalog import Catalog
from pinfric.drives.duty import Schedule
from pinfric.drives.friction import drive_friction
from pinfric.drives.policy import KIT
from pinfric.drives.way import pins
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.states import States
from pinfric.errors import LoopMotionError
from pinfric.model.scene import Scene

#: Part of a joint's travel, and of its largest velocity, by which a cycle may miss its start.
_CLOSES = 1e-3
#: Samples looked at to see how far joints travel.
_LOOKED_AT = 1000
#: Gaps of a cycle that a note lists; the others are counted.
_MOST_GAPS = 4
#: Begins, and ends, a gap that no return move closes.
_PAYLOAD, _REST = "payload ", ", and its load depends on the angle: add the rest of the turn"
#: Entries of q (cosine and sine) and of v of an axis without end.
_ENDLESS = 2, 1


def unclosed(result: InverseResult, duty: Schedule) -> tuple[str, ...]:
    """Return in words how a cycle's end differs from its start; empty if it closes.

    Allowed are 0.1 % of a joint's travel, at least 1e-4 rad or m, and of its largest velocity, at
    least the stick velocity: a log closes no better. An axis without end may turn on, if the
    efforts of the next cycle are the same.
    """
    gaps = []
    for name, samples in duty.parts():
        where, states = f"{name}: " if len(duty.names) > 1 else "", result.states.part(samples)
        found = _gaps(result.scene, states)
        on = _turned_on(result.scene, states) if found else None
        if on is not None and _same_efforts(result, samples, on):
            states = replace(states, q=np.concatenate([on.q[:1], states.q[1:]]))
            found = _gaps(result.scene, states)
        gaps += [where + gap for gap in found]
    return tuple(gaps)


def _turned_on(scene: Scene, states: States) -> States | None:
    """The next cycle: axes without end begin it where this one ends; None: there are none."""
    away = pin.difference(scene.model, states.q[0], states.q[-1])
    endless = np.zeros(scene.model.nv)
    for joint in list(scene.model.joints)[1:]:
        if (joint.nq, joint.nv) == _ENDLESS:
            endless[joint.idx_v] = away[joint.idx_v]
    if not endless.any():
        return None
    return replace(states, q=np.array([pin.integrate(scene.model, q, endless) for q in states.q]))


def _same_efforts(result: InverseResult, samples: slice, on: States) -> bool:
    """Whether the efforts of some samples are those of the same cycle, turned on."""
    try:
        turned = inverse_dynamics(result.scene, on.q, on.v, on.a, t=on.t, attached=on.attached)
    except LoopMotionError:  # rounding opens a loop: the cycle cannot be told to go on
        return False
    ends = (
        (getattr(result, name)[samples], getattr(turned, name))
        for name in ("effort_lower", "effort_upper")
    )
    return all(
        np.allclose(ours, theirs, rtol=0, atol=_CLOSES * np.abs(ours).max())
        for ours, theirs in ends
    )


def discontinuities(result: InverseResult, duty: Schedule) -> tuple[str, ...]:
    """Return in words the cycles of a period that do not begin where the one before ends."""
    return tuple(
        f"{duty.names[k]} does not begin where {duty.names[k - 1]} ends"
        for k, (_, samples) in enumerate(duty.parts())
        if k
        and _gaps(result.scene, result.states.part(slice(samples.start - 1, samples.start + 1)))
    )


def _gaps(scene: Scene, states: States) -> list[str]:
    gaps = []
    away = pin.difference(scene.model, states.q[0], states.q[-1])
    some = states.q[:: len(states.q) // _LOOKED_AT + 1]
    ways = np.array([pin.difference(scene.model, states.q[0], q) for q in some])
    for joint, name in zip(list(scene.model.joints)[1:], scene.joint_names, strict=True):
        columns = slice(joint.idx_v, joint.idx_v + joint.nv)
        slides = joint.shortname().startswith("JointModelP")  # a planar joint: m and rad
        unit = "m" if slides else "rad"
        speed = np.linalg.norm(states.v[:, columns], axis=1)
        gap = float(np.linalg.norm(away[columns]))
        jump = float(np.linalg.norm(states.v[-1, columns] - states.v[0, columns]))
        if gap > max(_CLOSES * float(np.linalg.norm(ways[:, columns], axis=1).max()), 1e-4):
            turns = (joint.nq, joint.nv) == _ENDLESS
            gaps.append(f"{name} ends {gap:.3g} {unit} from where it began" + _REST * turns)
        if jump > max(_CLOSES * float(speed.max()), scene.stick_velocity):
            gaps.append(f"{name} ends with a velocity {jump:.3g} {unit}/s from that at its start")
    resting = bool((np.abs(states.v[[0, -1]]) <= scene.stick_velocity).all())
    if states.attached is not None and not (resting and not gaps):  # gripped there, at rest
        for name, first, last in zip(scene.payloads, *states.attached[[0, -1]], strict=True):
            if first != last:
                gaps.append(
                    f"{_PAYLOAD}{name} is carried at the {'start' if first else 'end'} only: "
                    f"{'attach' if first else 'detach'} it where the robot stands"
                )
    return gaps


def caveats(
    scene: Scene,
    catalog: Catalog | None,
    gaps: Sequence[str],
    jumps: Sequence[str] = (),
    beyond: Sequence[str] = (),
) -> tuple[str, ...]:
    """Return the assumptions of a sizing, in sentences.

    Args:
        catalog: what was chosen from; None: nothing was.
        gaps: of `unclosed`. jumps: of `discontinuities`. beyond: of `beyond_limits`.
    """
    opening = _of_the_motion(gaps, jumps)
    if beyond:
        opening.append(
            f"Beyond its limit: {'; '.join(beyond)}: is the limit that of the motion's robot, and "
            "are its masses, payloads and times right?"
        )
    if catalog is None:
        return tuple(opening)
    pinned = [drive.name for i, drive in enumerate(scene.drives) if pins(scene, i)]
    notes = [
        *opening,
        _of_masses(scene),
        "Each motor and gear is a point mass on its joint's parent link, at the joint's origin; "
        "the drive of the first joint stands on the ground"
        + (f"; half of {', '.join(pinned)} is at each of its ends." if pinned else "."),
        f"Housing, shaft and bearings of a frameless kit are {KIT:.0%} of its mass and its gear's; "
        "couplings, cables and encoders have none. A gear takes the motors that its maker names, a "
        "frameless kit goes into a strain wave gear; else a motor with a shaft is taken to fit.",
        "A joint gets the smallest brake that holds its load without any help of the gear, unless "
        "the load is at most half of dry friction that is known to be the joint's own, or 2 % of "
        "its largest effort, or the gear is self-locking"
        + (
            "; where it moves, one that stops it within 0.5 s."
            if scene.stops is not None
            else ". Without power the others coast and can be pushed: add `stops`."
        ),
        "Output bearings carry the whole wrench of the joint, about the joint's origin, which is "
        "assumed to lie on the output flange; conditions.bearings names another bearing instead.",
        "Magnets are assumed cold: the torque constant does not fall with temperature.",
    ]
    notes += [f"{catalog.source}: {text}." for text in catalog.replaced]
    notes.append(_of_friction(scene))
    if scene.assumed is not None:
        listed = "; ".join(f"{place} ({why})" for place, why in scene.assumed.values.items())
        notes.append(f"Guesses of `{scene.assumed.by}`, {scene.assumed.date}: {listed}.")
    if any(drive.transmission is not None for drive in scene.drives):
        notes.append("The scene's transmissions are replaced by the candidates'.")
    return tuple(notes)


def _of_masses(scene: Scene) -> str:
    """Say whose masses are in the links."""
    held = [
        name for name, hold in zip(scene.actuator_names, scene.masses_hold, strict=True) if hold
    ]
    if len(held) == len(scene.drives):
        return (
            "The links' masses hold the drives (`robot.masses`): those chosen replace them and are "
            "not added; conditions.mass_in_urdf gives what is there, to replace it exactly."
        )
    kept = f" but those of {', '.join(held)}, which its links hold" if held else ""
    return f"The masses of the drives are added to the robot's links{kept} (`robot.masses`)."


def _of_the_motion(gaps: Sequence[str], jumps: Sequence[str]) -> list[str]:
    opening = []
    if jumps:
        opening.append(
            f"{'; '.join(jumps)}: the move between them is not in the figures; add it as a cycle."
        )
    if gaps:
        more = f" and {len(gaps) - _MOST_GAPS} more" if len(gaps) > _MOST_GAPS else ""
        returns = any(_PAYLOAD not in gap and _REST not in gap for gap in gaps)
        opening.append(
            f"The cycle does not close: {'; '.join(gaps[:_MOST_GAPS])}{more}. RMS, energies, "
            "temperatures, overload and gear life assume that it repeats without a pause"
            + (
                ", and that the return move takes no time and no torque. For valid figures add the "
                "return move and the pause to the trajectory."
                if returns
                else "."
            )
        )
    return opening


def _of_friction(scene: Scene) -> str:
    replaced, said = drive_friction(scene), []
    if gears := [name for name, keys in replaced.items() if "mu" in keys]:
        said.append(
            f"The losses of the gears of {', '.join(gears)} (`bearing: {{kind: gear}}`) are the "
            "old ones'; the candidates' replace them."
        )
    if whole := [name for name, keys in replaced.items() if keys.keys() - {"mu"}]:
        said.append(
            f"Coulomb and viscous friction of {', '.join(whole)} include the old drive "
            "(`includes_drive`, a guess, or motor currents); the candidates' losses replace them. "
            "So friction of the joint's own bearings and seals is missing, and all of it if a "
            "candidate's no-load torque is not known."
        )
    return " ".join(said) or (
        "The candidates' losses are added to the scene's friction. Friction identified from "
        "motor currents already includes the old drive: mark it `includes_drive: true`, so that "
        "the drive counts once."
    )
