"""Transmissions: ratio, rotor and the losses of a gear, from makers' figures.

Let t be the effort that the joint receives (N m or N), r the ratio, sigma the joint's direction, w
the motor's speed and n the no-load torque at the motor. Seen from the joint, the effort at the
input of a moving gear is

    u = t + sigma (g(w) L(|t|) + |r| n),     g(w) = c + d |w|^p

without the motor's viscous friction and rotor. L is the loss due to the load, a piecewise linear
function through 0, different where the motor drives (sigma t > 0) and where the load drives (sigma
t < 0). See `notebooks/theory/gears.md`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple, Self, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from pinfric.errors import choose_from
from pinfric.model.brakes import HoldingBrake
from pinfric.model.entry import (
    USUALLY,
    Entry,
    Forms,
    NonNegative,
    Number,
    Positive,
    key,
    not_vanishing,
    optional,
    register_kind,
    unlikely,
)
from pinfric.model.friction_terms import (
    CoulombFriction,
    DirectedCoulombFriction,
    Presliding,
    Viscous,
    constant_friction,
)
from pinfric.model.springs import Stiffness

Share = Annotated[Positive, Field(le=1)]
#: A number is used for both directions, at rest and in motion.
NoLoadTorque = Annotated[
    CoulombFriction | DirectedCoulombFriction,
    Forms(
        Annotated[NonNegative, AfterValidator(constant_friction)],
        CoulombFriction,
        DirectedCoulombFriction,
    ),
]
#: Allowed difference of the curves over load and over speed where they meet.
_APART = 0.02

#: rad, 4 arcmin: our choice, a third above the largest hysteresis loss that we read of a maker,
#: "< 3 arcmin" at ratio 30 (Harmonic Drive, CHA engineering data 1018854; from 50 on "< 1").
_LARGEST_HYSTERESIS = 1.2e-3


class Temperature(Entry):
    """Effect of the temperature on the part of a loss that grows with the speed: a factor on d.

    temperature: {factor: 2.7, source: "CSD-20-100 curves: 0.71 at 0 C over 0.26 at 20 C"}
    """

    factor: Positive = key("on the part that grows with the speed", 2.7, "1")
    source: str = key("source of the factor", "maker's curves at 0 and 20 C", min_length=1)


class MakersEfficiency(Entry):
    """A data sheet's efficiency, which includes all losses, also `no_load_torque`.

    Loads are torques (or forces) at the output, N m (N); speeds are the motor's, rad/s.

        efficiency: {rated: 0.77, load: 52.0, speed: 209.4}
        efficiency: {over_load: [[8, 0.52], [20, 0.70], [34, 0.78]], speed: 104.7}
        efficiency: {over_speed: [[52.4, 0.76], [104.7, 0.71], [209.4, 0.64]], load: 40.0}

    At `speed` the loss includes `motor_viscous`. A curve over the speed is fitted by a loss
    c + d w^exponent; with both curves, the one over load is for the speed `speed`.
    """

    rated: Share | None = optional("efficiency at `load` and `speed`", 0.77, "1")
    load: Positive | None = optional("at the output, for `rated` or `over_speed`", 52.0, "N m or N")
    speed: NonNegative = key(
        "of the motor, for `rated` or `over_load`", 209.4, "rad/s", default=0.0
    )
    over_load: tuple[tuple[Positive, Share], ...] = key(
        "efficiency at rising loads (N m or N)", [[8, 0.52], [20, 0.7], [34, 0.78]], default=()
    )
    over_speed: tuple[tuple[NonNegative, Share], ...] = key(
        "efficiency at rising speeds of the motor (rad/s)",
        [[52.4, 0.76], [209.4, 0.64]],
        default=(),
    )
    exponent: Positive = key(
        "power of the speed in the loss, at most 4", 0.667, "1", le=4.0, default=2.0 / 3.0
    )
    temperature: Temperature | None = optional(
        "a factor on the part that grows with the speed",
        {"factor": 2.7, "source": "curves at 0 and 20 C"},
    )

    def with_losses(self, factor: float) -> MakersEfficiency:
        """Return the efficiencies of a gear with all losses times a factor."""
        update: dict[str, Any] = {
            name: tuple((at, _with_losses(eta, factor)) for at, eta in getattr(self, name))
            for name in ("over_load", "over_speed")
        }
        if self.rated is not None:
            update["rated"] = _with_losses(self.rated, factor)
        return self.model_copy(update=update)

    @model_validator(mode="after")
    def _complete(self) -> MakersEfficiency:
        curve = "over_speed" if self.over_speed else "over_load" if self.over_load else None
        if (self.rated is None) == (curve is None):
            raise ValueError(
                f"give either `rated` or `{curve}`"
                if curve
                else "needs `rated`, `over_load` or `over_speed`"
            )
        if self.load is None and (self.rated is not None or self.over_speed):
            raise ValueError(
                f"`{'over_speed' if self.over_speed else 'rated'}` needs `load`, the "
                "torque at the output (N m, N) at which it was measured"
            )
        if self.over_load and self.over_speed and "speed" not in self.model_fields_set:
            raise ValueError("with `over_speed`, `over_load` needs the `speed` of its curve")
        for name in {"exponent", "temperature"} & self.model_fields_set:
            if not self.over_speed:
                raise ValueError(
                    f"`{name}` is for losses that grow with the speed and needs `over_speed`"
                )
        for name, points in (("over_load", self.over_load), ("over_speed", self.over_speed)):
            if points and (len(points) < 2 or any(b[0] <= a[0] for a, b in pairwise(points))):
                raise ValueError(f"`{name}` needs at least two points in ascending order")
        return self


def _with_losses(efficiency: float, factor: float) -> float:
    """An efficiency with its loss, 1/efficiency - 1, times a factor."""
    return 1.0 / (1.0 + factor * (1.0 / efficiency - 1.0))


class BackDriving(Entry):
    """Torques at which an unloaded gear starts to turn, driven at its input or at its output.

        back_efficiency: {starting_torque: 0.029, back_driving_torque: 3.06}

    With no motor torque, F_b at the output drives the input with eta_b F_b against |r| n_s, so
    eta_b = |ratio| starting_torque/back_driving_torque.
    """

    starting_torque: Positive = key("at the input", 0.029, "N m")
    back_driving_torque: Positive = key("at the output", 3.06, "N m or N")


Efficiency = Annotated[float | MakersEfficiency, Forms(Share, MakersEfficiency)]
BackEfficiency = Annotated[
    float | BackDriving | Literal["same_loss"],
    Forms(Annotated[Number, Field(le=1)], BackDriving, Literal["same_loss"]),
]


class LoadLoss(NamedTuple):
    """Loss due to the load, g(w) L(|t|): L piecewise linear, g = constant + rise w^exponent.

    Attributes:
        loads: at which its lines begin, the first at 0 (N m or N at the output).
        losses, slopes: L there (N m or N), and its slope from there on (1).
        constant, rise, exponent: of the factor g; w is the motor's speed (rad/s).
        error: largest error of the fit to the maker's efficiencies over the speed (1).
    """

    loads: tuple[float, ...]
    losses: tuple[float, ...]
    slopes: tuple[float, ...]
    constant: float = 1.0
    rise: float = 0.0
    exponent: float = 1.0
    error: float = 0.0

    def scaled(self, factor: float) -> LoadLoss:
        """Return the loss times a factor."""
        losses, slopes = (tuple(factor * x for x in of) for of in (self.losses, self.slopes))
        return self._replace(losses=losses, slopes=slopes)


class Transmission(Entry):
    """Ratio and losses between motor and joint; torques and inertia at the motor's shaft.

    `efficiency` as a number is t/u due to the load alone, with `no_load_torque` added to the loss;
    as a mapping it is the maker's (`MakersEfficiency`). A `back_efficiency` of 0 or less means a
    self-locking gear; `same_loss` uses the loss of the driving motor also where the load drives.
    `no_load_torque` is a number, or {static, kinetic}, or these by the motor's direction,
    {positive: ..., negative: ...}.

        transmission: {ratio: 100, efficiency: {rated: 0.77, load: 52.0, speed: 209.4},
                       back_efficiency: {starting_torque: 0.037, back_driving_torque: 3.89},
                       no_load_torque: {static: 0.037, kinetic: 0.030},
                       motor_viscous: {coefficient: 0.0021, exponent: 0.667}}
    """

    ratio: Number = key("motor turns per turn of the joint; rad/m if it slides", 100.0, "1")
    efficiency: Efficiency = key(
        "t/u of the load alone, or maker's",
        {"rated": 0.77, "load": 52.0, "speed": 209.4},
        "1",
        default=1.0,
    )
    back_efficiency: BackEfficiency | None = optional(
        "efficiency where the load drives, at most 1, 0 or less if self-locking; or the "
        "torques that start the gear, or `same_loss`",
        0.89,
        "1",
    )
    no_load_torque: NoLoadTorque | None = optional(
        "torque that turns the unloaded gear", 0.037, "N m"
    )
    motor_viscous: Viscous = optional(
        "friction that grows with the motor's speed", 5e-05, "N m at 1 rad/s"
    )
    rotor_inertia: NonNegative = key(
        "of all parts that turn with the motor", 5e-05, "kg m^2", default=0.0
    )
    momentary_peak: Positive | None = optional(
        "permissible effort of the gear at the joint in a stop or a collision", 143.0, "N m or N"
    )
    brake: HoldingBrake | None = optional(
        "that holds the motor's shaft without power; needed for stops",
        {"torque": 0.5, "engage_time": 0.015},
    )
    stiffness: Stiffness | None = optional(
        "of the gear at the joint, with the motor held: one number, the lines of a strain wave "
        "gear, or those of a gear with lost motion",
        {"k1": 31000, "k2": 50000, "k3": 57000, "t1": 14, "t2": 48},
        "N m/rad or N/m",
    )
    hysteresis: Positive | None = optional(
        "the gear's hysteresis loss, full width at zero torque; it limits the friction behind "
        "the spring",
        0.00029,
        "rad or m",
    )
    presliding: Presliding | None = optional(
        "the way of the joint (of a coupled drive its own) over which friction and losses build up "
        "after a reversal; or give `friction.JOINT.presliding`",
        {"way": 0.001},
    )

    @classmethod
    def key_names(cls) -> list[str]:
        """Return the keys that a mapping may have; an added kind has no efficiencies."""
        own = cls is not Transmission
        return [name for name in super().key_names() if not (own and name in _NOT_ITS_OWN)] + (
            [] if own or not GEAR_KINDS else ["kind"]
        )

    @classmethod
    def kinds(cls) -> list[str]:
        """See `Entry.kinds`."""
        return list(GEAR_KINDS)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """A transmission, or any of the added kinds."""
        if cls is not Transmission or not GEAR_KINDS:
            return handler(core)
        for kind in GEAR_KINDS.values():
            kind.model_rebuild()  # it may be deferred
        kinds = [handler(kind.__pydantic_core_schema__) for kind in GEAR_KINDS.values()]
        return {"anyOf": [handler(core), *kinds]}

    @model_validator(mode="wrap")
    @classmethod
    def _of_its_kind(cls, value: Any, read: ModelWrapValidatorHandler[Self]) -> Self:
        """Read a mapping with a key `kind` as the class that was added under this name."""
        if cls is Transmission and isinstance(value, dict) and "kind" in value:
            if value["kind"] in GEAR_KINDS:
                gear: Any = GEAR_KINDS[value["kind"]].model_validate(value)
                return gear
            if GEAR_KINDS:
                raise ValueError(
                    f"there is no kind {value['kind']!r}; "
                    f"{choose_from(str(value['kind']), list(GEAR_KINDS))}"
                )
        return read(value)

    def losses(self) -> tuple[LoadLoss, LoadLoss]:
        """Return the losses due to the load where the motor drives, and where the load drives.

        Where the motor drives, a number eta gives L = (1/eta - 1) |t|; a maker's efficiencies give
        L = |t| (1/eta - 1) - |r| n(w) at each point, straight between them, in proportion to the
        load beyond the last. Where the load drives: L = (1 - eta_b) |t|, or the same.

        Raises:
            ValueError: an impossible gear: the loss is negative, or the motor's torque falls while
                the load grows.
        """
        driving, back = _makers_loss(self), self.back_efficiency
        if back == "same_loss":
            return driving, driving
        if isinstance(back, BackDriving):
            back = abs(self.ratio) * back.starting_torque / back.back_driving_torque
        return driving, LoadLoss((0.0,), (0.0,), (0.0 if back is None else 1.0 - back,))

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        if self.ratio == 0:
            raise ValueError("ratio must not be 0; give motor turns per joint turn")
        not_vanishing(abs(self.ratio))
        if self.hysteresis is not None and self.stiffness is None:
            raise ValueError("`hysteresis` needs `stiffness`: it limits friction behind the spring")
        driving, driven = self.losses()  # refuses efficiencies that cannot be
        if self.efficiency != 1 and self.back_efficiency is None:
            equal = (
                "take `same_loss`"
                if isinstance(self.efficiency, MakersEfficiency)
                else f"give 2 - 1/efficiency = {2 - 1 / self.efficiency:.3g}"
            )
            raise ValueError(
                "`efficiency` below 1 needs `back_efficiency`, which catalogues rarely"
                f" print; equal losses both ways {equal}"
            )
        _check_back_driving(self)
        _check_lead(driving, driven)
        return self

    def without_load_loss(self) -> Transmission:
        """Return the transmission without the losses due to the load."""
        return self.model_copy(update={"efficiency": 1.0, "back_efficiency": None})

    def with_losses(self, factor: float) -> Transmission:
        """Return the transmission with all its losses times a factor, exactly at every load.

        eta becomes 1/(1 + factor (1/eta - 1)), a back efficiency 1 - factor (1 - eta_b).
        """
        update: dict[str, Any] = {
            name: term.scaled(factor)
            for name in ("no_load_torque", "motor_viscous")
            if (term := getattr(self, name)) is not None
        }
        efficiency, back = self.efficiency, self.back_efficiency
        if isinstance(efficiency, MakersEfficiency):
            update["efficiency"] = efficiency.with_losses(factor)
        else:
            update["efficiency"] = _with_losses(efficiency, factor)
        if isinstance(back, BackDriving):
            back = abs(self.ratio) * back.starting_torque / back.back_driving_torque
        if isinstance(back, float):
            update["back_efficiency"] = 1.0 - factor * (1.0 - back)
        return self.model_copy(update=update)

    def questions(self) -> Iterator[str]:
        """Yield warnings for an unusual ratio or rotor inertia, and for a poor fit."""
        driving, _ = self.losses()
        if driving.error > _APART:
            yield (
                f"efficiency.over_speed: the fit misses the maker's efficiencies by "
                f"{driving.error:.2g} ({USUALLY} {_APART:g}); try another `exponent` than "
                f"{driving.exponent:.3g}"
            )
        if abs(self.ratio) != 1.0:  # without a gear it is a joint's, of any size
            hint = "kg cm^2 entered?" if self.rotor_inertia < 10.0 else "g cm^2 entered?"
            yield from unlikely("rotor_inertia", self.rotor_inertia, 0.1, "kg m^2", hint)
        yield from unlikely("ratio", abs(self.ratio), 1000.0, "")
        yield from unlikely(
            "hysteresis", self.hysteresis, _LARGEST_HYSTERESIS, "rad", "arcmin or degrees entered?"
        )


#: Keys of a transmission that follow from the formula of a kind of one's own.
_NOT_ITS_OWN = ("efficiency", "back_efficiency")
#: The added classes of transmissions, by their names in a scene file.
GEAR_KINDS: dict[str, type[OwnTransmission]] = {}


class OwnTransmission(Transmission):
    """Base class of transmissions whose losses follow from keys of their own.

    A subclass with the decorator `gear_kind` is a new kind. It has a key `kind`, a `Literal` of one
    word, keys of its own, and `load_losses`, but no efficiencies.
    """

    kind: str
    loss_factor: NonNegative = key("on the losses due to the load", 1.0, "1", default=1.0)

    @model_validator(mode="before")
    @classmethod
    def _without_efficiencies(cls, data: Any) -> Any:
        for name in _NOT_ITS_OWN:
            if isinstance(data, dict) and name in data:
                raise ValueError(f"`{name}` follows from its `kind`; leave it out")
        return data

    @abstractmethod
    def load_losses(self) -> tuple[LoadLoss, LoadLoss]:
        """Return the losses due to the load where the motor drives, and where the load drives."""

    def losses(self) -> tuple[LoadLoss, LoadLoss]:
        """See `Transmission.losses`."""
        driving, driven = (loss.scaled(self.loss_factor) for loss in self.load_losses())
        return _rising(driving), driven

    def with_losses(self, factor: float) -> Transmission:
        """See `Transmission.with_losses`."""
        scaled = super().with_losses(factor)
        return scaled.model_copy(update={"loss_factor": factor * self.loss_factor})

    def without_load_loss(self) -> Transmission:
        """See `Transmission.without_load_loss`."""
        return self.model_copy(update={"loss_factor": 0.0})


_Gear = TypeVar("_Gear", bound=OwnTransmission)


def gear_kind(cls: type[_Gear]) -> type[_Gear]:
    """Decorate a class of transmissions: scene files can then use its `kind`.

    Raises:
        SceneError: another class has this kind; a class that is run again replaces itself.
    """
    register_kind(GEAR_KINDS, cls)
    return cls


def load_part(efficiency: float, load: float, no_load: float) -> float:
    """Return the load's part of a total loss: load (1/efficiency - 1) - no_load, N m or N.

    `efficiency` is the total at this load; `load` and `no_load` are at the output.
    """
    return load * (1.0 / efficiency - 1.0) - no_load


def _makers_loss(gear: Transmission) -> LoadLoss:
    """See `Transmission.losses`, where the motor drives."""
    efficiency = gear.efficiency
    if not isinstance(efficiency, MakersEfficiency):
        return LoadLoss((0.0,), (0.0,), (1.0 / efficiency - 1.0,))
    if efficiency.rated is not None:
        assert efficiency.load is not None  # the entry requires it
        lost = _load_part(gear, efficiency.rated, efficiency.load, efficiency.speed)
        return LoadLoss((0.0,), (0.0,), (lost / efficiency.load,))
    points = efficiency.over_load
    loads = [0.0, *(load for load, _ in points)]
    losses = [0.0, *(_load_part(gear, eta, load, efficiency.speed) for load, eta in points)]
    slopes = [
        (after - before) / (end - start)
        for (start, end), (before, after) in zip(pairwise(loads), pairwise(losses), strict=True)
    ]
    slopes.append(losses[-1] / loads[-1] if points else 1.0)
    if not efficiency.over_speed:
        return _rising(LoadLoss(tuple(loads), tuple(losses), tuple(slopes)))
    assert efficiency.load is not None  # the entry requires it
    there = float(np.interp(efficiency.load, loads, losses)) if points else efficiency.load
    if points and efficiency.load > loads[-1]:
        there = efficiency.load * slopes[-1]
    return _rising(
        LoadLoss(tuple(loads), tuple(losses), tuple(slopes), *_over_speed(gear, efficiency, there))
    )


def driven_efficiency(gear: Transmission) -> float:
    """Return 1 - g(0) L' at large loads; the gear is self-locking if this is 0 or less."""
    _, loss = gear.losses()
    return 1.0 - loss.constant * loss.slopes[-1]


def shock_efficiency(gear: Transmission) -> float:
    """Return eta_b of a gear that a brake stops.

    Both the ratio of its starting torques and 2 - 1/eta are models; the smaller makes the larger
    shock.
    """
    back, eta = driven_efficiency(gear), gear.efficiency
    return min(back, 2 - 1 / eta) if isinstance(eta, float) else back


def _no_load(gear: Transmission, speed: float) -> float:
    """The loss without load at a motor's speed, at the output; the mean of both directions."""
    term, viscous = gear.no_load_torque, gear.motor_viscous
    lost = 0.0 if viscous is None else viscous.coefficient * speed**viscous.exponent
    if term is not None:
        kinetic = term.rows(None)[0][1]
        lost += 0.5 * (kinetic.forward + kinetic.backward)
    return abs(gear.ratio) * lost


def _load_part(gear: Transmission, efficiency: float, load: float, speed: float) -> float:
    no_load = _no_load(gear, speed)
    loss = load_part(efficiency, load, no_load)
    if loss < -1e-12 * load:
        eta = load / (load + loss) if load + loss > 0.0 else np.inf
        raise ValueError(
            f"`efficiency` {efficiency:g} at load {load:g} loses {loss + no_load:.4g} N m (N), "
            f"`no_load_torque` and `motor_viscous` alone {no_load:.4g} at the output: the load's "
            f"part would be {eta:.3g}, above 1, which is impossible; give the "
            "maker's curve (`over_load`), or no_load_torque at the motor's shaft in N m"
        )
    return max(loss, 0.0)


def _over_speed(
    gear: Transmission, stated: MakersEfficiency, there: float
) -> tuple[float, float, float, float]:
    """Constant, rise and exponent of g, and its error against the maker's efficiencies.

    Least squares of g(w_i) `there` = load (1/eta_i - 1) - |r| n(w_i), with constant, rise >= 0;
    `there` is L at their load (N m or N).
    """
    assert stated.load is not None  # the entry requires it
    load, factor = stated.load, 1.0 if stated.temperature is None else stated.temperature.factor
    speeds, eta = np.array(stated.over_speed).T
    if there <= 0.0:
        raise ValueError("`over_load` has no loss at `load`, so `over_speed` has no effect")
    parts = [_load_part(gear, e, load, w) for w, e in zip(speeds, eta, strict=True)]
    powers, right = speeds**stated.exponent, np.array(parts) / there
    columns = np.stack([np.ones_like(powers), powers], axis=1)
    constant, rise = (float(x) for x in np.linalg.lstsq(columns, right, rcond=None)[0])
    if rise < 0.0:
        constant, rise = float(right.mean()), 0.0
    elif constant < 0.0:
        constant, rise = 0.0, float(powers @ right / (powers @ powers))
    no_load = np.array([_no_load(gear, w) for w in speeds])
    fitted = load / (load + (constant + rise * powers) * there + no_load)
    if stated.over_load:
        _check_meeting(gear, stated, there, constant + rise * stated.speed**stated.exponent)
    return constant, rise * factor, stated.exponent, float(np.abs(fitted - eta).max())


def _check_meeting(gear: Transmission, stated: MakersEfficiency, there: float, g: float) -> None:
    """Refuse curves over load and over speed that differ where both are valid."""
    assert stated.load is not None  # the entry requires it
    no_load = _no_load(gear, stated.speed)
    by_load, by_speed = (stated.load / (stated.load + x + no_load) for x in (there, g * there))
    if abs(by_load - by_speed) > _APART:
        raise ValueError(
            f"at load {stated.load:g} and speed {stated.speed:g} `over_load` gives "
            f"{by_load:.3g}, `over_speed` {by_speed:.3g}: one of them holds "
            "elsewhere"
        )


def _rising(loss: LoadLoss) -> LoadLoss:
    """Refuse a loss with which the motor's torque falls while the load grows."""
    for start, slope in zip(loss.loads, loss.slopes, strict=True):
        if 1.0 + loss.constant * slope <= 1e-9 or (slope < 0.0 < loss.rise):
            why = (
                "the loss falls while the load grows, without limit at speed"
                if loss.rise
                else "the motor's torque falls while the load grows"
            )
            raise ValueError(f"`over_load`: from {start:g} on {why}; smooth the curve")
    return loss


def _check_lead(driving: LoadLoss, driven: LoadLoss) -> None:
    """Refuse eta_b <= -1/eta: F rises on average, (1/eta + eta_b)/2 > 0, in every gear that turns.

    Of a screw 1/eta + eta_b = sin 2L / (tan L cos(L + R) cos(L - R)): positive for L + R < 90 deg.
    """
    forth, back = (loss.constant * max(loss.slopes) for loss in (driving, driven))
    if back >= 2.0 + forth:
        raise ValueError(
            f"`back_efficiency` {1.0 - back:.4g} is at or below -1/efficiency = "
            f"{-1.0 - forth:.4g}: lead and friction angle of such a screw are 90 degrees or more "
            "together, so not even its motor turns it; give the torques that start the gear "
            "(`starting_torque`, `back_driving_torque`), or a greater number"
        )


def _check_back_driving(gear: Transmission) -> None:
    """Refuse impossible no-load torques, and a starting torque that contradicts them."""
    back, term = gear.back_efficiency, gear.no_load_torque
    if not isinstance(back, BackDriving):
        return
    eta = abs(gear.ratio) * back.starting_torque / back.back_driving_torque
    if eta > 1.0:
        raise ValueError(
            f"`back_efficiency`: starting_torque {back.starting_torque:g} N m x ratio = "
            f"{abs(gear.ratio) * back.starting_torque:.4g} is more than back_driving_torque "
            f"{back.back_driving_torque:g}: eta_b {eta:.3g}, above 1; the first is at the input, "
            "the second at the output, both in N m"
        )
    if term is None or term == term.without_static():
        return  # the file gives no static no-load torque
    static = term.at_rest().forward
    if abs(static - back.starting_torque) > 0.01 * static:
        raise ValueError(
            f"`no_load_torque.static` {static:g} and `back_efficiency.starting_torque`"
            f" {back.starting_torque:g} are the same torque but differ; correct one of them"
        )
