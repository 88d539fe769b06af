"""Stepper motors: entry, pull-out torque, rows, needs, and what is said of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import ClassVar

import numpy as np
from pydantic import model_validator

from pinfric.drives.demand import mean
from pinfric.drives.kinds.kind import Kind
from pinfric.drives.limit import Candidates, Figures, Limit, columns
from pinfric.drives.policy import EXTRA_LOW_VOLTAGE, Conditions
from pinfric.model.entry import NonNegative, Number, Positive, key, optional

#: Part of a computed pull-out curve that counts: printed ones are 0.5 to 0.95 of it (23HS45-4204S,
#: 36 V: 0.94 at 210, 0.88 to 0.81 at 300 to 990, 0.53 at 1200 rpm; a NEMA 34: 0.51 to 0.58).
COMPUTED_CURVE = 0.5


class Stepper(Kind):
    """What a stepper motor has in place of continuous, peak torque and speed-torque line.

    It follows its steps up to the pull-out torque of its speed. Without the maker's curve half of
    that of resistance, inductance and holding torque counts (`pull_out_torque`).
    """

    NAME: ClassVar[str] = "stepper"
    NEEDS: ClassVar[dict[str, str]] = {
        "mass": "mass mass_taken",
        "rotor inertia": "rotor_inertia",
    }
    REPLACED: ClassVar[frozenset[str]] = frozenset(
        ("speed-torque line", "motor speed", "winding temperature")
    )
    UNFED: ClassVar[str] = "a stepper motor takes a driver of its own current"
    NOT_RETIMED: ClassVar[str] = (
        "a stepper motor, whose pull-out curve `retime` does not follow; give the peak_torque and "
        "the max_speed that it has at all speeds of the motion"
    )

    holding_torque: Positive = key("at rest, both phases on at the rated current", 0.59, "N m")
    current: Positive = key("rated, of each phase", 2.0, "A")
    steps: Positive = key("full steps per turn", 200, "1", default=200.0)
    resistance: Positive | None = optional("of a phase, end to end", 1.4, "Ohm")
    inductance: Positive | None = optional("of a phase", 0.003, "H")
    pull_out: tuple[tuple[NonNegative, Positive], ...] | None = optional(
        "the maker's curve: points of speed (rad/s) and pull-out torque (N m)",
        [[22.0, 2.82], [62.8, 1.29], [103.7, 0.78]],
    )
    voltage: Positive | None = optional("of the driver of that curve", 36.0, "V")
    driver: str = key("of that curve, with its current", "DM556T, 4.1 A", default="")
    detent_torque: NonNegative | None = optional("without current", 0.015, "N m")
    standstill_current: Number = key(
        "share of the current, and of the holding torque, that its driver leaves at rest",
        0.5,
        "1",
        gt=0,
        le=1,
        default=0.5,
    )
    temperature_rise: Positive = key(
        "of the winding at the rated current in both phases", 80.0, "K", default=80.0
    )
    max_winding: Number = key("highest of the winding: class B", 130.0, "deg C", default=130.0)

    @model_validator(mode="after")
    def _has_a_curve(self) -> Stepper:
        if self.pull_out is None and (self.resistance is None or self.inductance is None):
            raise ValueError(
                "no `pull_out`, and no `resistance` with `inductance`: its torque in motion is not "
                "known; take the maker's curve with its voltage and driver, or measure resistance "
                "and inductance of one phase, its shaft held"
            )
        if self.pull_out is not None and self.voltage is None:
            raise ValueError("pull_out: give the `voltage` of the driver for which it is printed")
        at = [speed for speed, _ in self.pull_out or ()]
        if any(b <= a for a, b in pairwise(at)) or len(at) == 1:
            raise ValueError("pull_out: points [rad/s, N m], rad/s ascending, two or more")
        most = max((torque for _, torque in self.pull_out or ()), default=0.0)
        if most > self.holding_torque:
            raise ValueError(
                f"pull_out: {most:g} N m is more than holding_torque {self.holding_torque:g} N m: "
                "swapped, or a unit?"
            )
        return self

    @property
    def by_rule(self) -> str:
        """Say that its pull-out torque is computed; empty: its maker prints the curve."""
        words = f"pull-out torque by rule, {COMPUTED_CURVE:g} of that of resistance and inductance"
        return words * (self.pull_out is None)

    @property
    def driver_heat(self) -> float | None:
        """Of a current that its driver keeps up, W."""
        return self.resistance and 2 * self.resistance * self.current**2

    @property
    def highest_voltage(self) -> float:
        """Of the bus, where its maker prints none, V."""
        return EXTRA_LOW_VOLTAGE

    @property
    def torques(self) -> tuple[float, str]:
        """What stands for its continuous and peak torque, N m, and why."""
        said = "holding torque: its current heats it, not the load; see the pull-out torque"
        return self.holding_torque, said

    def available(self, speed: np.ndarray, standing: np.ndarray, voltage: float) -> np.ndarray:
        """Return the torque (T,) at which it falls out of step, N m, less at rest."""
        held = self.standstill_current * self.holding_torque
        return np.where(standing, held, pull_out_torque(self, speed, voltage))

    def share(
        self, torque: np.ndarray, speed: np.ndarray, standing: np.ndarray, conditions: Conditions
    ) -> float:
        """Return the largest share of its torque that a cycle takes.

        Args:
            torque, speed, standing: (T,), the torque's worst end. conditions: the bus voltage.
        """
        most, worst = self.available(speed, standing, conditions.bus_voltage), np.abs(torque)
        with np.errstate(divide="ignore"):
            return float(np.where(worst > 0, worst / most, 0.0).max())

    @classmethod
    def least_shares(
        cls,
        kinds: Sequence[Kind],
        torque: np.ndarray,
        speed: np.ndarray,
        slow: float,
        conditions: Conditions,
    ) -> np.ndarray:
        """See `Kind`. At speeds that may be rest the greater torque counts."""
        steppers = [kind for kind in kinds if isinstance(kind, cls)]
        most, voltage = np.empty(torque.shape), conditions.bus_voltage
        printed = np.array([stepper.pull_out is not None for stepper in steppers])
        for m in np.flatnonzero(printed):
            most[..., m] = pull_out_torque(steppers[m], speed, voltage)
        computed = [stepper for stepper in steppers if stepper.pull_out is None]
        most[..., ~printed] = _computed(columns(computed, _FIGURES), speed[..., None], voltage)
        held = np.array([x.standstill_current * x.holding_torque for x in steppers])
        most = np.where(speed[..., None] <= slow, np.maximum(most, held), most)
        share = torque * (1 - 1e-9) / np.maximum(most, 1e-300)
        least: np.ndarray = np.fmax.reduce(np.minimum(share, 1e9))
        return least


def pull_out_torque(stepper: Stepper, speed: np.ndarray, voltage: float) -> np.ndarray:
    """Return the torque (T,) at which a stepper motor falls out of step, N m.

    The maker's curve, its speeds by the ratio of voltages where his driver has more; 0 beyond its
    end. Without one half of what two sinusoidal phases can give, of amplitude i at the best lead
    angle,

        max k Re(i):   |i| <= sqrt(2) I,   |k w + (R + j (n/4) w L) i| <= V,   k = T_h/(sqrt(2) I).

    Args:
        speed: (T,) of the shaft, rad/s. voltage: V of the bus.

    Source: two-phase hybrid motor of n steps as a synchronous machine of n/4 pole pairs; half by
    rule.
    """
    w = np.abs(np.asarray(speed, dtype=float))
    if stepper.pull_out is not None:
        at, torque = np.transpose(stepper.pull_out)
        w = w * max(1.0, (stepper.voltage or voltage) / voltage)
        return np.interp(w, at, torque, right=0.0)
    return _computed(columns([stepper], _FIGURES).each(np.squeeze), w, voltage)


#: What the torque by rule follows from.
_FIGURES = "current", "holding_torque", "resistance", "inductance", "steps"


def _computed(stepper: Figures, w: np.ndarray, voltage: float) -> np.ndarray:
    """Return the torque by rule, of figures of one stepper or of several, at speeds |omega|."""
    most = 2.0**0.5 * stepper.current
    k = stepper.holding_torque / most
    z = stepper.resistance + 0.25j * stepper.steps * w * stepper.inductance
    middle, reach = -k * w / z, voltage / np.abs(z)  # currents that the voltage permits: a disc
    # the two discs' intersection of largest real part
    far = np.maximum(np.abs(middle), 1e-9 * most)
    along = (far**2 + most**2 - reach**2) / (2 * far)
    across = np.sqrt(np.maximum(most**2 - along**2, 0.0))
    best = (along * middle.real + across * np.abs(middle.imag)) / far
    best = np.where(far > most + reach, 0.0, best)  # the back-EMF alone takes more
    inner = middle + reach
    best = np.where(np.abs(inner) <= most, inner.real, best)
    best = np.where(np.abs(most - middle) <= reach, most, best)
    return COMPUTED_CURVE * k * np.maximum(best, 0.0)


def _of(d: Candidates) -> Stepper:
    own = d.ratings.special
    assert isinstance(own, Stepper)  # its rows are for steppers
    return own


def _steps(d: Candidates) -> bool:
    return d.kind is Stepper


def _source(d: Candidates) -> str:
    stepper = _of(d)
    if stepper.pull_out is None:
        return f"by rule: {COMPUTED_CURVE:g} of the curve of resistance, inductance, holding torque"
    curve = f"maker's figures: curve at {stepper.voltage:g} V"
    return curve + f", {stepper.driver}" * bool(stepper.driver)


def _note(d: Candidates) -> str:
    stepper, speed = _of(d), (1.0 if d.at_output else d.ratio) * d.demand.speed
    bus = d.conditions.bus_voltage
    top = float(pull_out_torque(stepper, np.array([speed]), bus)[0])
    lower = stepper.pull_out is not None and (stepper.voltage or bus) > bus
    scaled = f"; its speeds scaled to {bus:g} V, by rule" * lower
    return f"{top:.3g} N m at {speed:.4g} rad/s, its fastest; a lost step is not seen" + scaled


def _held_heat(d: Candidates) -> float:
    """Temperature rise, K, of a current that falls at rest."""
    stepper, cycle = _of(d), d.case.cycle
    share = np.where(cycle.standing, stepper.standstill_current, 1.0) * cycle.powered
    return stepper.temperature_rise * mean(cycle.stretched, share**2)


# fmt: off
LIMITS = [
    Limit("stepper pull-out torque", lambda d: d.asked.pull_out, lambda _: 1.0, "",
          lambda d: f"{d.conditions.pull_out_factor:g} max |T_m|/T_pull-out(|omega|) <= 1, at rest "
          f"of {_of(d).standstill_current:g} x holding torque", _source,
          "pull-out curve", _note, reserve="pull_out_factor", condition=("bus_voltage",),
          stage="pair", applies=lambda d: d.one is None or _steps(d)),
    Limit("stepper winding", _held_heat, lambda d: _of(d).max_winding - d.conditions.ambient,
          "K", "rise at rated current x mean (I/I_rated)^2 <= highest winding temperature - T_a",
          "80 K and class B (SongYang SY28STH45 data sheet)", condition=("ambient",),
          applies=_steps),
]
# fmt: on
