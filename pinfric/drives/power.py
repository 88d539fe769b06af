"""The bus that feeds all drives: its power over time, the energy fed back, and how to absorb it.

    P(t) = sum over drives of T_m omega + R(T_w) i^2

A supply of voltage U_0 and resistance R_s holds U = U_0 - R_s P/U,

    U = U_0/2 + sqrt(U_0^2/4 - R_s P),      P <= U_0^2/(4 R_s).

The largest single return of energy lifts the bus from U to at most U_max where its capacitors
take it, C (U_max^2 - U^2)/2; the rest is a resistor's, or a supply's that feeds back.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinfric.drives.criterion import Criterion, Status, compare
from pinfric.drives.demand import power_figures
from pinfric.drives.drivetrain import MotorCycle
from pinfric.drives.duty import Schedule
from pinfric.drives.policy import Conditions, stated
from pinfric.dynamics.inverse.result import runs
from pinfric.model.described import derived, described, quantity
from pinfric.motions.summary import rms

_BRAKING = "braking energy"
#: Of the largest power: less is rounding of its parts.
_ROUNDING = 1e-9


@described
class BusPower:
    """The sum of all drives' electrical power over the period.

    Attributes:
        power: (T,) W, into the drives; each cycle once.
    """

    power: np.ndarray
    known: int = quantity("drives with a motor")
    left_out: tuple[str, ...] = quantity("drives without a motor: left out")
    mechanical: tuple[str, ...] = quantity("drives whose copper loss is not known: left out")
    peak: float = quantity("largest power from the bus", "W", "peak")
    braking: float = quantity("largest power fed back", "W", "braking")
    drawn: float = quantity("energy from the bus over a period", "J", "drawn")
    returned: float = quantity("energy fed back over a period", "J", "fed back")
    mean: float = quantity("mean power over the period", "W", "mean")
    burst: float = quantity("largest energy fed back without a break", "J", "in one\ngo")
    current: float = quantity("greatest P/U", "A", "peak\ncurrent")
    rms_current: float = quantity("root mean square of P/U", "A", "RMS\ncurrent")
    resistor: float | None = quantity(
        "largest resistance that takes the braking power at the highest voltage; none: no energy "
        "is fed back",
        "ohm",
    )
    resistor_power: float | None = quantity("mean power of that resistor", "W")
    capacitance: float | None = quantity(
        "capacitance that takes the burst instead of a resistor; none: the bus has no limit, or "
        "no energy is fed back",
        "F",
    )
    criteria: tuple[Criterion, ...] = quantity("of the supply and of the bus")
    lowest: float | None = quantity(
        "lowest bus voltage, sagging by the supply's resistance; none: not known, or it collapses",
        "V",
        "lowest\nvoltage",
        default=None,
    )

    @property
    def feeds(self) -> bool:
        """Whether it feeds any drive: cylinders take none of it."""
        return bool(self.known or self.left_out)

    @property
    def at_least(self) -> bool:
        """Whether not all power that is drawn is known."""
        return bool(self.left_out or self.mechanical)

    @property
    @derived()
    def remedy(self) -> str:
        """How to absorb the energy that is fed back, in words."""
        if not self.known:
            return "not known: no drive has a motor with the needed data"
        if self.resistor is None or self.resistor_power is None:
            if self.left_out:
                drives = self.known + len(self.left_out)
                return (
                    f"{self.known} of {drives} drives feed nothing back; the others are not known"
                )
            return "no energy is fed back: neither resistor nor regeneration is needed"
        resistor = (
            f"a resistor of at most {_with_prefix(self.resistor)}ohm, mean "
            f"{self.resistor_power:.3g} W, peak {self.braking:.3g} W"
        )
        if self.capacitance is None:
            return f"{resistor}, or feeding back"
        if any(c.name == _BRAKING and c.status == Status.PASSES for c in self.criteria):
            return "the bus capacitors take it"
        capacitors = f"capacitors of {_with_prefix(self.capacitance)}F"
        return f"{capacitors}, or {resistor}, or feeding back"


def _with_prefix(x: float) -> str:
    """Return three digits and the unit's prefix: "27.7 k", "450 ", "12.0 m"."""
    rounded, steps = float(f"{x:.2e}"), ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"))
    factor, prefix = next((step for step in steps if rounded >= step[0]), (1e-6, "u"))
    return f"{x / factor:.3g} {prefix}"


def bus_power(
    drives: Mapping[str, MotorCycle | None],
    t: np.ndarray,
    duty: Schedule,
    conditions: Conditions,
    voltages: Mapping[str, np.ndarray | None],
) -> BusPower:
    """Return the power of all drives from their bus.

    Args:
        drives: name -> its motor over the period; None where there is none.
        voltages: name -> what the motor takes of the bus, (T,) V; None where its line is not known.
        t: (T,) s, each cycle once. duty: which samples are which cycle of the period.
    """
    power, stretched = np.zeros(len(t)), duty.stretched(t)
    known = {name: motor for name, motor in drives.items() if motor is not None}
    for motor in known.values():
        power += motor.power
    power[np.abs(power) < _ROUNDING * np.abs(power).max()] = 0.0  # or it would be fed back
    flow = power_figures(stretched, power)
    burst = _burst(t, power, duty)
    voltage, period = conditions.bus_voltage, float(stretched[-1] - stretched[0])
    limit = conditions.bus_limit
    room = None if limit is None else (limit**2 - voltage**2) / 2  # of each F
    stored = conditions.bus_capacitance
    flows = flow.braking > 0
    held, left_out = held_voltage(power, conditions), tuple(n for n in drives if n not in known)
    mechanical = tuple(name for name, motor in known.items() if not motor.copper)
    return BusPower(
        power=power,
        known=len(known),
        left_out=left_out,
        mechanical=mechanical,
        peak=flow.driving,
        braking=flow.braking,
        drawn=flow.delivered,
        returned=flow.returned,
        mean=(flow.delivered - flow.returned) / period,
        burst=burst,
        current=flow.driving / voltage,
        rms_current=rms(stretched, power) / voltage,
        resistor=(limit or voltage) ** 2 / flow.braking if flows else None,
        resistor_power=flow.returned / period if flows else None,
        capacitance=burst / room if room and flows else None,
        criteria=()
        if not drives
        else (
            _supply(flow.driving, conditions, bool(left_out or mechanical)),
            compare(
                _BRAKING,
                burst,
                None if room is None or stored is None else stored * room,
                "J",
                "largest single return <= C (U_max^2 - U^2)/2",
                "Servotronix CDHD2 manual, regeneration: E_bus = C/2 (V_max^2 - V_nom^2)",
                "conditions.bus_capacitance and bus_limit",
                condition=stated(conditions, "bus_capacitance", "bus_limit", "bus_voltage"),
            ),
            _sag(held, voltages, bool(left_out or mechanical), conditions),
        ),
        lowest=None if held is None or np.isnan(held).any() else float(held.min()),
    )


def held_voltage(power: np.ndarray, conditions: Conditions) -> np.ndarray | None:
    """Return the bus voltage U (T,) under a power, NaN where it collapses; None: not known.

    Power that is fed back does not lift it here.

    Args:
        power: (T,) W, from the bus. conditions: U_0 and R_s.
    """
    if conditions.supply_resistance is None:
        return None
    half, drawn = conditions.bus_voltage / 2, np.maximum(power, 0.0)
    room = half**2 - conditions.supply_resistance * drawn
    return half + np.sqrt(np.where(room < 0, np.nan, room))


def _sag(
    held: np.ndarray | None,
    voltages: Mapping[str, np.ndarray | None],
    at_least: bool,
    conditions: Conditions,
) -> Criterion:
    needed, has = None, None
    lines = [taken for taken in voltages.values() if taken is not None]
    missing = "conditions.supply_resistance"
    if held is not None and np.isnan(held).any():
        needed, has = np.inf, 0.0
    elif held is not None and lines:
        most = np.max(lines, axis=0)
        k = int(np.argmax(most / held))
        needed, has = float(most[k]), float(held[k])
    if held is not None and (at_least or len(lines) < len(voltages)):
        missing = "the power and the speed-torque line of all drives"
        if needed is not None and has is not None and needed <= has:
            needed = None  # what is known in part can fail, not pass
    return compare(
        "bus voltage under load",
        needed,
        has,
        "V",
        "max over drives |R T_m/k + k omega|/share <= U, U = U_0/2 + sqrt(U_0^2/4 - R_s P)",
        "voltage divider of supply and drives",
        missing,
        "the supply cannot deliver this power through its resistance" if needed == np.inf else "",
        stated(conditions, "supply_resistance", "bus_voltage"),
    )


def _supply(peak: float, conditions: Conditions, at_least: bool) -> Criterion:
    """Power that is known in part can fail a supply, not pass it."""
    supply = conditions.supply_power
    decided = not at_least or (supply is not None and peak > supply)
    missing = (
        "conditions.supply_power"
        if supply is None
        else (f"power of all drives; without those not known, or their copper loss, {peak:.4g} W")
    )
    return compare(
        "supply power",
        peak if decided else None,
        supply,
        "W",
        "max sum(T_m omega + R i^2) <= power of the supply",
        "power balance of the bus",
        missing,
        condition=stated(conditions, "supply_power"),
    )


def _burst(t: np.ndarray, power: np.ndarray, duty: Schedule) -> float:
    """The most energy (J) that flows back without a break, across cycles too."""
    order, times = duty.played(t, 1e-9)  # each cycle into itself, if it is run again
    order = np.concatenate([order, order])  # a period into the next
    times = np.concatenate([times, times[-1] + times])
    played = power[order]
    # the samples of each time in which power flows back, with one more on each side
    parts = [slice(max(first - 1, 0), last + 2) for first, last in runs(played < 0)]
    bursts = (power_figures(times[part], played[part]).returned for part in parts)
    return max(bursts, default=0.0)
