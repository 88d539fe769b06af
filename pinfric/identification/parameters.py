"""Coefficients with the keys of a scene: key, unit and interval; r is the gear ratio.

    c+, c-   friction.J.coulomb.positive, .negative  or  transmission.J.no_load_torque.* = c/|r|
    k, p     friction.J.viscous {k, p}               or  transmission.J.motor_viscous = k/|r|^(1+p)
    mu       friction.J.mu
    g+, g-   transmission.J.efficiency = 1/(1 + g+), back_efficiency = 1 - g-, and their product
    J        transmission.J.rotor_inertia = J/r^2

With friction on the motor's side the second form holds, else the first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple
from typing import Any

import numpy as np
from pydantic import ValidationError

from pinfric.errors import IdentificationError
from pinfric.identification.columns import Rows
from pinfric.identification.estimate import Estimate, scale_is_known
from pinfric.identification.laws import (
    BEARING,
    COULOMB,
    FORWARD,
    GEARS,
    INERTIA,
    RESTS_ON,
    SPEEDS,
    STRIBECK,
    STRIBECK_BACKWARD,
    STRIBECK_FORWARD,
    STRIBECK_LOAD,
    STRIBECK_VELOCITY,
    K,
    Law,
)
from pinfric.identification.recordings import STILL, stick_velocity
from pinfric.identification.rest import BreakAway
from pinfric.identification.uncertainty import Uncertainty
from pinfric.identification.ways import BLOCKS, Way
from pinfric.model.arrays import FloatArray
from pinfric.model.bearings import Gear
from pinfric.model.described import PLACE, SPEED, described, quantity, unit_at
from pinfric.model.scene import Scene
from pinfric.model.schema import Actuator, Friction
from pinfric.model.transmission import Transmission

#: A standard error of more than this share of a coefficient leaves it undetermined.
_VAGUE = 0.5
#: With exponents up to this one friction at rest is what the slowest logged sliding shows: the
#: law's own Coulomb friction is extrapolated down a steep curve that no log has seen. With larger
#: ones below 1 it is friction at the slowest speed that counts as sliding.
_STEEP = 0.5
#: Quantile of the logged speeds that counts as the slowest.
_SLOWEST = 0.02


#: Of a joint whose scene names no friction.
NO_FRICTION = Friction()
#: Why one efficiency of two is not known.
_ONE_LOSS = "with free masses only the product of both efficiencies is known"
#: Keys of a transmission that logs of the motor's effort replace.
_LOSSES = {
    *("efficiency", "back_efficiency", "no_load_torque", "motor_viscous", "rotor_inertia"),
    "presliding",
}
_DRIVEN = [slot for (_, way), slot in GEARS.items() if way == "driven"]


@described
class Parameter:
    """One coefficient with its key in the scene."""

    section: str = quantity("section of the scene: friction, transmission", heading="section")
    joint: str = quantity("its joint: elbow_joint", heading="joint", name=True)
    name: str = quantity("its key: coulomb.positive", heading="coefficient")
    unit: str = quantity("unit of all figures here", heading="unit")
    value: float = quantity("the estimate, in `unit`", heading="value")
    low: float = quantity("lower end of the 95 % interval; NaN: at its bound", heading="from")
    high: float = quantity("upper end of the 95 % interval; NaN: at its bound", heading="to")
    standard_error: float = quantity("within logs and between them")
    determined: bool = quantity("whether the logs determine it")
    why: str = quantity("why it is not determined", default="")

    @property
    def key(self) -> str:
        """Its name in sweeps: friction.elbow_joint.coulomb.positive."""
        return f"{self.section}.{self.joint}.{self.name}"


def on_motor(law: Law) -> bool:
    """Whether friction acts before the gear, on the motor's shaft."""
    return law.side == "motor"


def scene_key(scene: Scene, joint: int, law: Law, slot: int) -> tuple[str, str, str]:
    """Return section, name and unit of one coefficient in a scene."""
    effort, motor = scene.drives[joint].unit, on_motor(law)
    section = "transmission" if motor else "friction"
    if slot in COULOMB:
        # a negative ratio turns the motor backwards where the joint moves forwards
        turned = motor and scene.drives[joint].ratio < 0.0
        direction = "positive" if (slot == FORWARD) != turned else "negative"
        return (
            section,
            f"{'no_load_torque' if motor else 'coulomb'}.{direction}",
            ("N m" if motor else effort),
        )
    if slot in STRIBECK:
        direction = "positive" if slot == STRIBECK_FORWARD else "negative"
        return section, f"coulomb.{direction}.static", effort
    if slot in SPEEDS:
        speed = unit_at(SPEED, "N m" if motor else effort)
        power = "" if law.exponent == 1.0 else f"^{law.exponent:g}"
        unit = f"{'N m' if motor else effort}/({speed}){power}"
        return section, "motor_viscous" if motor else "viscous", unit
    if slot in (BEARING, STRIBECK_LOAD):
        return "friction", "mu" if slot == BEARING else "mu.static", ""
    if slot == INERTIA:
        return "transmission", "rotor_inertia", "kg m^2"
    return "transmission", "back_efficiency" if slot in _DRIVEN else "efficiency", ""


def scene_value(law: Law, slot: int, value: Any, ratio: float) -> Any:
    """Return a coefficient (a number or an array of draws) in the scene's terms.

    Args:
        law: of its joint. slot: which coefficient. value: at the joint, as in the linear model.
        ratio: |motor turns per joint turn|.
    """
    if slot == INERTIA:
        return value / ratio**2
    if slot in GEARS.values():
        return 1.0 - value if slot in _DRIVEN else 1.0 / (1.0 + value)
    if on_motor(law):
        return value / ratio ** (1.0 + (law.exponent or 0.0) * (slot in SPEEDS))
    return value


def parameters(
    estimate: Estimate, known: Uncertainty, static: Mapping[tuple[int, int], BreakAway]
) -> tuple[Parameter, ...]:
    """Return every coefficient of the laws found, in the scene's terms.

    Args:
        estimate: the coefficients. known: their uncertainty.
        static: joint, FORWARD or BACKWARD -> friction at which it broke away.
    """
    from scipy.special import stdtrit

    slots, result = estimate.problem.slots(estimate.choice.laws), []
    for j in estimate.known:
        law, ratio = estimate.choice.laws[j], abs(estimate.scene.drives[j].ratio)
        fitted, name = estimate.fit.slots[j], estimate.scene.joint_names[j]
        for slot in slots[j]:
            own = [slot]
            if slot in RESTS_ON:  # at rest it adds to the friction in motion
                own.append(RESTS_ON[slot])
            x = float(fitted[own].sum())
            error, reach = known.of({j * K + at: 1.0 for at in own})
            ends = (float(scene_value(law, slot, max(x + d, 0.0), ratio)) for d in (-reach, reach))
            low, high = sorted(ends)
            value, why = float(scene_value(law, slot, x, ratio)), ""
            if x == 0.0:
                why, high = "at its bound, zero", np.nan
            elif slot in GEARS.values() and law.both_ways and not scale_is_known(estimate):
                # equal losses are an assumption: each efficiency is between the product and 1
                low, high, why = _both_losses(estimate, known, j)[1], 1.0, _ONE_LOSS
            elif x <= reach:
                why = "its interval contains zero"
            elif error > _VAGUE * x:
                why = "its standard error exceeds half of it"
            error *= abs(float(scene_value(law, slot, x + 1e-6, ratio)) - value) / 1e-6
            section, key, unit = scene_key(estimate.scene, j, law, slot)
            result.append(
                Parameter(section, name, key, unit, value, low, high, error, not why, why)
            )
            if broke := static.get((j, slot)):
                x, low, high, error = (
                    float(scene_value(law, slot, x, ratio)) for x in astuple(broke)
                )
                key = f"{key}.static"
                result.append(Parameter(section, name, key, unit, x, low, high, error, True))
        if law.load == "gear" and fitted[list(GEARS.values())].any():
            value, low, high, error = _both_losses(estimate, known, j)
            why = "" if high < 1.0 else "its interval contains 1"
            key = "efficiency_product"
            result.append(
                Parameter("transmission", name, key, "", value, low, high, error, not why, why)
            )
        if fitted[list(RESTS_ON)].any():  # of the speed the logarithm has a standard error
            stribeck, unit = estimate.stribeck[j], unit_at(SPEED, estimate.scene.drives[j].unit)
            assert stribeck is not None  # its law has one
            v, (error, reach) = stribeck.velocity, known.of({j * K + STRIBECK_VELOCITY: 1.0})
            why = "its standard error exceeds half of it" if error > _VAGUE else ""
            low, high = (v * float(np.exp(np.clip(x, -700.0, 700.0))) for x in (-reach, reach))
            key = "stribeck.velocity"
            result.append(
                Parameter("friction", name, key, unit, v, low, high, error * v, not why, why)
            )
        if way := way_of(estimate, j):
            reach = float(stdtrit(BLOCKS - 1, 0.975)) * way.error
            least, most = (way.value * float(np.exp(x)) for x in (-reach, reach))
            unit = unit_at(PLACE, estimate.scene.drives[j].unit)
            section, key = "transmission" if on_motor(law) else "friction", "presliding.way"
            error = way.error * way.value
            result.append(Parameter(section, name, key, unit, way.value, least, most, error, True))
    return tuple(result)


def way_of(estimate: Estimate, joint: int) -> Way | None:
    """Return the way over which a joint's friction builds up, or None: at once."""
    return None if estimate.build is None else estimate.build.ways[joint]


def _both_losses(
    estimate: Estimate, known: Uncertainty, joint: int
) -> tuple[float, float, float, float]:
    """Return the product of a gear's two efficiencies, its 95 % interval, and standard error.

        eta eta_b = (1 - g-) / (1 + g+)

    Free masses scale 1 + g+ and 1 - g- alike, so the product is known without them.
    """
    law, fitted = estimate.choice.laws[joint], estimate.fit.slots[joint]
    driving, driven = (
        GEARS[law.side, "both" if law.both_ways else way] for way in ("driving", "driven")
    )
    whole = 1.0 + float(fitted[driving])
    product = (1.0 - float(fitted[driven])) / whole
    slopes = {joint * K + driving: -product / whole}
    slopes[joint * K + driven] = slopes.get(joint * K + driven, 0.0) - 1.0 / whole
    error, reach = known.of(slopes)
    return product, product - reach, min(product + reach, 1.0), error


def identified_scene(estimate: Estimate, static: Mapping[tuple[int, int], BreakAway]) -> Scene:
    """Return the question's scene with what was found in it; other joints keep what it says.

    Joints stick up to the velocity that noise gives them at rest. `static`: see `parameters`.
    """
    scene = estimate.scene
    friction: dict[str, Any] = dict(scene.friction)
    stated = {actuator.joint: actuator for actuator in scene.actuators or ()}
    actuators = []
    for j, name in enumerate(scene.joint_names):
        drive = stated.get(name) or Actuator(joint=name)
        if j in estimate.known:
            friction[name], losses = _entries(estimate, j, static)
            if estimate.question.motor:  # an effort measured after the gear says nothing of it
                given_gear = drive.transmission  # all else of it is what the scene says
                fields = set(Transmission.model_fields)  # of a kind of one's own only these
                kept = (
                    given_gear.model_dump(exclude_unset=True, include=fields)
                    if given_gear
                    else {"ratio": 1.0}
                )
                kept = {key: value for key, value in kept.items() if key not in _LOSSES}
                try:
                    gear = Transmission.model_validate({**kept, **losses})
                except ValidationError as problem:  # two losses that were asked for
                    raise IdentificationError(
                        f"{scene.source}: joint {name}: its logs ask for a gear that cannot be "
                        f"({problem.errors()[0]['msg']}): take one loss, `both_ways`"
                    ) from None
                drive = drive.model_copy(update={"transmission": gear})
        actuators.append(drive)
    friction = {name: entry for name, entry in friction.items() if entry}
    stick = stick_velocity(scene, estimate.question.recordings)
    return scene.with_(friction=friction, actuators=actuators, stick_velocity=stick)


def _entries(
    estimate: Estimate, joint: int, static: Mapping[tuple[int, int], BreakAway]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """A joint's friction entry and its drive's losses, as a scene file has them."""
    scene, law, fitted = estimate.scene, estimate.choice.laws[joint], estimate.fit.slots[joint]
    friction: dict[str, Any] = {}
    gear: dict[str, Any] = {}
    ratio = abs(scene.drives[joint].ratio)
    excess = _rest_excess(estimate.rows[joint], law, fitted)
    dry = law.coulomb and fitted[COULOMB].any()
    for slot in (INERTIA, *law.slots):
        section, key, _ = scene_key(scene, joint, law, slot)
        target = friction if section == "friction" else gear
        value = _rounded(scene_value(law, slot, float(fitted[slot]), ratio))
        if slot in COULOMB and dry:
            head, _, direction = key.partition(".")
            at_rest = float(fitted[slot]) + excess
            at_rest += float(fitted[STRIBECK_FORWARD if slot == FORWARD else STRIBECK_BACKWARD])
            if (joint, slot) in static:
                at_rest = max(
                    at_rest if law.stribeck else float(fitted[slot]), static[joint, slot].mean
                )
            at_rest = _rounded(scene_value(law, slot, at_rest, ratio))
            target.setdefault(head, {})[direction] = {"static": at_rest, "kinetic": value}
        elif slot in SPEEDS and value:
            target[key] = {"coefficient": value, "exponent": law.exponent}
        elif slot == BEARING and (value or fitted[STRIBECK_LOAD]):
            stated = estimate.question.scene.friction.get(scene.joint_names[joint], NO_FRICTION)
            share = stated.mu.static / stated.mu.kinetic if stated.mu and stated.mu.kinetic else 1.0
            at_rest = (1.0 if law.stribeck_slots else share) * value + float(fitted[STRIBECK_LOAD])
            target["bearing"] = stated.bearing or Gear(kind="gear")
            target["mu"] = {"static": _rounded(at_rest), "kinetic": value}
        elif value and slot not in RESTS_ON:
            target[key] = value
    if fitted[list(law.stribeck_slots)].any():
        stribeck = estimate.stribeck[joint]
        assert stribeck is not None  # its law has one
        friction["stribeck"] = {
            "velocity": _rounded(stribeck.velocity),
            "exponent": stribeck.exponent,
        }
    if way := way_of(estimate, joint):
        entry = {"way": _rounded(way.value), "shape": "gradual" if way.gradual else "sharp"}
        (friction if {"coulomb", "mu"} & friction.keys() else gear)["presliding"] = entry
    if law.load == "gear" and law.both_ways:
        gear["back_efficiency"] = "same_loss"
    # behind a gear whose losses grow with this friction, it is the joint's own
    if estimate.question.motor and law.load != "gear" and {"coulomb", "viscous"} & friction.keys():
        friction["includes_drive"] = True
    return friction, gear


def _rest_excess(rows: Rows, law: Law, slots: FloatArray) -> float:
    """Friction at rest less Coulomb friction: k v^p at the slowest speed v."""
    if law.exponent is None or law.exponent >= 1.0:
        return 0.0
    slowest = STILL
    if law.exponent <= _STEEP:
        slowest = float(np.quantile(np.abs(rows.velocity), _SLOWEST))
    return sum(float(slots[at]) * slowest**p for at, p in SPEEDS.items() if p == law.exponent)


def _rounded(value: float) -> float:
    """Six digits: more than any log determines."""
    return float(f"{value:.6g}")
