"""Limits of each drive: motor, gear, joint; from numbers, catalogue or URDF.

They are the rows of the table of limits (`drives.limits`) that bound every instant of a motion. The
speed-torque line is that of a winding as hot as it may be.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, SkipValidation

from pinfric.drives.catalog import Catalog
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.drivetrain import Candidate
from pinfric.drives.installed import actuator_of, check_masses, installed_drive
from pinfric.drives.limit import Limit, idle
from pinfric.drives.limits import LIMITS, instant_limits
from pinfric.drives.parts import check_names, named_drive
from pinfric.drives.policy import Conditions, GivenConditions, parse_conditions
from pinfric.drives.reading import read_drive
from pinfric.drives.robot import equip
from pinfric.errors import CatalogError, RetimeError, choose_from
from pinfric.model.drives import Drive
from pinfric.model.entry import Entry, Positive, Version, key, optional, parse
from pinfric.model.scene import Scene
from pinfric.model.yamlfile import brief, read_yaml
from pinfric.motions.joint_columns import stated_limit


class DriveLimits(Entry):
    """The limits of one drive; what is left out is no limit."""

    peak_torque: Positive = key("at the motor's shaft", 1.0, "N m", default=math.inf)
    stall_torque: Positive = key(
        "start of the speed-torque line; needs `no_load_speed`", 2.4, "N m", default=math.inf
    )
    no_load_speed: Positive = key(
        "of the motor, end of that line", 400.0, "rad/s", default=math.inf
    )
    max_speed: Positive = key("of the motor", 450.0, "rad/s", default=math.inf)
    effort: Positive = key("largest output of the gear", 60.0, "N m or N", default=math.inf)
    input_speed: Positive = key("of the gear", 680.0, "rad/s", default=math.inf)
    velocity: Positive = key("of the joint", 2.0, "rad/s or m/s", default=math.inf)
    acceleration: Positive = key("of the joint", 20.0, "rad/s^2 or m/s^2", default=math.inf)
    continuous_torque: Positive = key(
        "at the motor's shaft, RMS over the cycle", 0.45, "N m", default=math.inf
    )
    motor: str = key("name shown in tables", "left shoulder", default="")

    @property
    def from_catalog(self) -> tuple[Candidate, Conditions] | None:
        """The drive of the catalogue and its conditions; None: limits are numbers."""
        return None

    def bound(self, limit: Limit) -> float:
        """Return the bound of a row of the table; infinite if there is none.

        Torques and speeds are at the motor's shaft; of the speed-torque line the stall torque.
        """
        return float(getattr(self, limit.key)) if limit.key else math.inf

    def least(self, signal: str) -> float:
        """Return the least bound of a signal (`limit.SIGNALS`)."""
        rows = (limit for limit in instant_limits() if limit.need == signal)
        return min((self.bound(limit) for limit in rows), default=math.inf)

    @property
    def over_time(self) -> tuple[float, str]:
        """The least bound of the motor's RMS torque, N m, and its row's name."""
        rows = [limit for limit in LIMITS if limit.need == "motor RMS torque"]
        tightest = min(rows, key=self.bound)
        return self.bound(tightest), tightest.name

    @property
    def driven(self) -> bool:
        """Whether its torque is limited; else the motion has no limit."""
        line = math.isfinite(self.stall_torque) and math.isfinite(self.no_load_speed)
        return line or math.isfinite(min(self.least("motor torque"), self.least("effort")))


class CatalogLimits(DriveLimits):
    """The limits of a drive of the catalogue.

    Attributes:
        rows: row of the table -> its bound, where no key gives it.
        drive, conditions: of the catalogue, and what is demanded of it.
    """

    rows: dict[str, float]
    drive: SkipValidation[Candidate]
    conditions: SkipValidation[Conditions]

    @property
    def from_catalog(self) -> tuple[Candidate, Conditions]:
        """See `DriveLimits`."""
        return self.drive, self.conditions

    def bound(self, limit: Limit) -> float:
        """See `DriveLimits`."""
        return super().bound(limit) if limit.key else self.rows.get(limit.name, math.inf)


class NamedDrive(DriveLimits):
    """A drive of the catalogue; limits given here replace its own."""

    drive: str | None = optional("motor and gear as `pinfric size` names them", "CubeMars AK80-64")


#: Limits as a file has them, read by `_limits` once the catalogue is known.
_Given = Annotated[Any, BeforeValidator(lambda x: x, json_schema_input_type=str | NamedDrive)]


class MotorsFile(Entry):
    """A file of motors: for each drive limits, or a drive of the catalogue."""

    pinfric_motors: Version = key("version of the format", 1)
    robot: str | None = optional(
        "whose drives `pinfric size` chose; only a scene that has them goes with it", "ur10"
    )
    catalog: str = key(
        "file, from the folder of this one, or `default` for the bundled one",
        "default",
        default="default",
    )
    conditions: GivenConditions = key(
        "values that replace those of the catalogue", {"bus_voltage": 24.0}, default_factory=dict
    )
    drives: dict[str, _Given] = key(
        "limits, or a drive of the catalogue, by the scene's drives",
        {
            "panda_joint1": {"peak_torque": 1.0},
            "panda_joint2": {"drive": "CubeMars AK80-64", "acceleration": 20.0},
        },
        default_factory=dict,
    )
    others: _Given = optional("limits of all drives that are not named", {"peak_torque": 0.5})


#: What `retime` takes as limits.
LimitsLike = Mapping[str, Any] | str | Path | None


def read_limits(scene: Scene, limits: LimitsLike) -> tuple[DriveLimits, ...]:
    """Return the limits of every drive, in the order of the scene's.

    Args:
        limits: drive name -> `DriveLimits`, a mapping as in `MotorsFile.drives`, a `Candidate` or
            the name of a drive of the bundled catalogue ("motor + gear"); such a file;
            "default:NAME" for all drives; None: effort and velocity of the URDF.

    Raises:
        RetimeError: no limits for a drive, or none of its torque; a name that is not there.
        CatalogError: as reading a catalogue raises it.
    """
    catalog, others, where = "default", None, "limits"
    conditions: Mapping[str, Any] = {}
    if limits is None:
        return tuple(_stated(scene, i) for i in range(len(scene.drives)))
    given: Mapping[str, Any] = {}
    if isinstance(limits, Mapping):
        given = limits
    elif str(limits).startswith("default:"):
        others = str(limits).partition(":")[2]
    elif not isinstance(limits, str | os.PathLike):
        raise RetimeError(
            f"limits: should be a motors file, 'default:NAME' or drive -> limits, found "
            f"{brief(limits)}"
        )
    else:
        content = read_yaml(Path(limits), CatalogError, "pinfric_motors")
        file = parse(MotorsFile, content, str(limits), CatalogError)
        given, others, conditions = file.drives, file.others, file.conditions
        if file.robot is not None:
            _check_robot(scene, str(limits), file.robot)
        where = f"{limits}: drives"
        if file.catalog != "default":
            catalog = str(Path(limits).parent / file.catalog)
    for name in given:
        if name not in scene.actuator_names:
            raise RetimeError(
                f"{where}: there is no drive {name!r}; {choose_from(name, scene.actuator_names)}"
            )
    entries = [*given.values(), others]
    chosen, wanted = None, Conditions()
    if any(_name_of(entry) is not None for entry in entries):
        try:
            chosen = load_catalog(catalog)
        except CatalogError as problem:
            raise CatalogError(f"{limits}: catalog: {problem}") from None
        wanted = parse_conditions(conditions, chosen.conditions)
        check_names(scene, wanted, chosen)
    read = []
    for i, drive in enumerate(scene.drives):
        entry = given.get(drive.name, others)
        if entry is None:
            raise RetimeError(
                f"{where}: none for drive {drive.name!r}; give at least peak_torque "
                "(N m, at the motor's shaft), or a motor by name"
            )
        key = drive.name if drive.name in given or where == "limits" else None
        place = f"{where}.{key}" if key else f"{limits}: others"
        read.append(_limits(scene, i, place, entry, chosen, wanted))
    return tuple(read)


def _check_robot(scene: Scene, file: str, robot: str) -> None:
    """Refuse a scene that has not the drives that `size` chose: it wrote one that has."""
    if scene.model.name != robot:
        raise RetimeError(
            f"{file}: its drives are of the robot {robot!r}, {scene.source} is of "
            f"{scene.model.name!r}: give files of one `pinfric size --out`"
        )
    for i, name in enumerate(scene.actuator_names):
        if actuator_of(scene, i).installed is None:
            raise RetimeError(
                f"{file}: {scene.source} has no product (`installed`) at {name}: give "
                "sized.scene.yaml, which stands beside this file and has gears, rotors and brakes; "
                "if it is that file, an older version wrote it: run `pinfric size --out` again"
            )
    check_masses(scene)


def limited_scene(scene: Scene, limits: Sequence[DriveLimits]) -> Scene:
    """Return the scene with drives of a catalogue where it has no gear, else as it is.

    Raises:
        SizingError: as `equip`.
    """
    taken = {
        i: x.from_catalog
        for i, x in enumerate(limits)
        if x.from_catalog is not None and actuator_of(scene, i).transmission is None
    }
    if not taken:
        return scene
    drives = {i: candidate for i, (candidate, _) in taken.items()}
    return equip(scene, drives, next(iter(taken.values()))[1])


def candidate_limits(candidate: Candidate, conditions: Conditions) -> DriveLimits:
    """Return the limits of a drive of a catalogue, at the temperature and voltage of conditions.

    Each row of the table has its reserve; a gearmotor's figures are brought to its motor's shaft.

    Raises:
        RetimeError: a figure is missing that the motor's torque needs; it is not retimed.
    """
    ratings, ratio = candidate.ratings, candidate.ratio
    if ratings.special is not None:
        raise RetimeError(f"{candidate.name}: {ratings.special.NOT_RETIMED}")
    if candidate.transmission is None:
        raise RetimeError(
            f"{candidate.name}: not known: {', '.join(candidate.missing)}; without "
            "it the motor's torque cannot be computed"
        )
    torque, speed = (1 / ratio, ratio) if candidate.at_output else (1.0, 1.0)
    to_shaft = {"motor torque": torque, "motor RMS torque": torque, "motor speed": speed}
    judged = read_drive(candidate, None, idle(conditions))
    bounds = {
        limit: to_shaft.get(limit.need, 1.0) * limit.bound(judged)
        for limit in LIMITS
        if isinstance(limit.need, str) and limit.need != "voltage"
    }
    values = {limit.key: bound for limit, bound in bounds.items() if limit.key}
    if ratings.has_line:
        ones, none, volts = np.ones(1), np.zeros(1), candidate.voltage(conditions)
        hot = ratings.hottest(conditions)
        values["stall_torque"] = torque * volts / float(ratings.voltage(ones, none, hot)[0])
        values["no_load_speed"] = speed * volts / float(ratings.voltage(none, ones)[0])
    known: dict[str, Any] = {key: bound for key, bound in values.items() if math.isfinite(bound)}
    rows = {limit.name: bound for limit, bound in bounds.items() if not limit.key}
    return CatalogLimits(
        **known, motor=candidate.name, rows=rows, drive=candidate, conditions=conditions
    )


def _limits(
    scene: Scene, i: int, where: str, entry: Any, catalog: Catalog | None, conditions: Conditions
) -> DriveLimits:
    """The limits of drive i, which stand at `where`."""
    limits: DriveLimits | None = None
    name = _name_of(entry)
    if isinstance(entry, dict):
        entry = {key: value for key, value in entry.items() if key != "drive"}
    if name is not None and catalog is not None:
        try:
            named = named_drive(scene, i, name.removeprefix("default:"), catalog, conditions)
            named = installed_drive(scene, i, named, catalog.brakes)
        except CatalogError as problem:
            raise RetimeError(f"{where}: {problem}") from None
        limits = candidate_limits(named, conditions)
    elif isinstance(entry, Candidate):
        limits = candidate_limits(installed_drive(scene, i, entry, {}), Conditions())
    if not isinstance(entry, str | Candidate):
        own = parse(DriveLimits, entry, where, RetimeError)
        changed = {key: getattr(own, key) for key in own.model_fields_set}
        limits = own if limits is None else limits.model_copy(update=changed)
    assert limits is not None
    _check_settled(where, limits)
    if math.isfinite(limits.stall_torque) != math.isfinite(limits.no_load_speed):
        raise RetimeError(
            f"{where}: the speed-torque line needs both stall_torque and no_load_speed"
        )
    if not limits.driven:
        raise RetimeError(
            f"{where}: nothing limits its torque; give peak_torque, "
            "stall_torque with no_load_speed, or effort"
        )
    return limits


def _name_of(entry: Any) -> str | None:
    name = entry.get("drive") if isinstance(entry, dict) else entry
    return name if isinstance(name, str) else None


#: Of each of these rows at least one must bound a drive of the catalogue.
_MUST = (
    ("peak torque", "speed-torque line"),
    ("motor speed", "speed-torque line", "joint speed"),
    ("gear repeated peak torque", "screw buckling", "effort"),
    ("gear maximum input speed", "screw critical speed", "joint speed"),
)


def _check_settled(where: str, limits: DriveLimits) -> None:
    """Refuse a drive of the catalogue whose gear or motor nothing limits."""
    if limits.from_catalog is None:
        return
    candidate, conditions = limits.from_catalog
    judged = read_drive(candidate, None, idle(conditions))
    for names_ in _MUST:
        rows = [limit for limit in instant_limits() if limit.name in names_]
        known = any(math.isfinite(limits.bound(limit)) for limit in rows)
        if known or not any(limit.concerns(judged) for limit in rows):
            continue
        names = " or ".join(limit.name for limit in rows if limit.key != "velocity")
        keys = " or ".join(limit.key for limit in rows if limit.key)
        raise RetimeError(
            f"{where}: {candidate.name} cannot be checked: the catalogue has no value for "
            f"its {names}; give {keys} beside `drive`"
        )


def _stated(scene: Scene, i: int) -> DriveLimits:
    drive = scene.drives[i]
    effort = stated_limit(float(scene.model.effortLimit[drive.velocity_index]))
    if not math.isfinite(effort):
        raise RetimeError(
            f"limits: the robot states no effort limit for {drive.name!r} ({scene.drives[i].unit})"
            "; give limits of its drives (--motors)"
        )
    return DriveLimits(effort=effort)


def joint_speeds(scene: Scene) -> np.ndarray:
    """Return (nv,) the URDF's velocity limits (rad/s or m/s)."""
    return np.array([stated_limit(float(speed)) for speed in scene.model.velocityLimit])


def drive_speeds(drives: Sequence[Drive], limits: Sequence[DriveLimits]) -> np.ndarray:
    """Return (na,) greatest speeds behind the gears: limits, motor and gear (rad/s or m/s)."""
    turning = [min(x.least("motor speed"), x.least("input speed")) for x in limits]
    return np.array(
        [
            min(x.least("speed"), most / abs(drive.ratio))
            for drive, x, most in zip(drives, limits, turning, strict=True)
        ]
    )
