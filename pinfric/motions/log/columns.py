"""Which column of a log is what: time, a joint's position, velocity, effort, a payload.

Recognised are the joint's own name, alone or with a quantity before or after it (`elbow_joint`,
`/joint_states/elbow_joint/position`, `q_elbow_joint`), and numbered columns beside columns of names
(`position_0`, `name_0`). A mapping file says the rest.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import model_validator

from pinfric.dynamics.inverse.result import ACTUATOR_QUANTITIES, SITE_QUANTITIES
from pinfric.dynamics.simulation.motion import SITE_ARRAYS
from pinfric.errors import TrajectoryError, choose_from
from pinfric.model.entry import Entry, Forms, Number, Positive, key, optional, parse
from pinfric.model.yamlfile import brief, cut, read_yaml
from pinfric.motions.joint_columns import JointColumn, listing
from pinfric.motions.log.base import BaseMapping, WrenchMapping, wrench_columns
from pinfric.motions.log.episodes import EPISODES
from pinfric.motions.log.frame import Remarks

PAYLOAD = "payload."
#: Words for the quantities, in lower case.
_WORDS = {
    "position": ("position", "positions", "pos", "q", "angle", "actual_position", "rad", "deg"),
    "velocity": ("velocity", "velocities", "vel", "v", "qd", "dq", "speed"),
    "acceleration": ("acceleration", "accelerations", "acc", "a", "qdd", "ddq"),
    "effort": ("effort", "efforts", "eff", "torque", "torques", "tau"),
    "current": ("current", "currents", "amps"),
}
_QUANTITY = {word: quantity for quantity, words in _WORDS.items() for word in words}
_QUANTITY |= {"pos_estimate": "position", "vel_estimate": "velocity", "torque_estimate": "effort"}
#: Units in brackets that imply a quantity, without blanks and dots.
_UNITS = {
    "nm": "effort",
    "n": "effort",
    "a": "current",
    "rad/s": "velocity",
    "deg/s": "velocity",
    "m/s": "velocity",
    "rad/s^2": "acceleration",
    "rad/s2": "acceleration",
    "rad/s²": "acceleration",
    "turn": "position",
    "turns": "position",
    "rev": "position",
    "turn/s": "velocity",
    "turns/s": "velocity",
    "rev/s": "velocity",
}
_UNIT = re.compile(r"[ _]*[\[(]\s*([^\])]*[^\])\d][^\])]*)[\])]$")
#: The unit at the end of an angle's or angular velocity's name; `base_turn` is a name.
_ANGLE = re.compile(
    r"[\[(_ /](deg|rad)(?:rees|ians)?(?:/s|_s)?[\])]?$|[\[(](turn|rev)s?(?:/s)?[\])]$",
    re.IGNORECASE,
)
#: What loggers of robots and drives call columns that number the joints -> in our words: ODrive's
#: odrivetool and ROS 2 node; KUKA's RSI, which sends actual positions of axes in degrees;
#: PlotJuggler's exports of Unitree's LowState.
_DIALECTS = (
    (
        re.compile(
            r"(?:odrv0\.|/?odrive_)?axis(\d+)[./]"
            r"(?:encoder\.|motor\.|controller_status/)?(pos|vel|torque)_estimate"
        ),
        r"joint_\2_\1",
    ),
    (
        re.compile(r"(?:.*[/.])?motor_state(?:\[|\.)(\d+)\]?[/.](q|dq|tau)(?:_est)?"),
        r"joint_\2_\1",
    ),
    (re.compile(r"(?:\w+\.)?AIPos\.A(\d)"), r"joint_position_\1"),
    (re.compile(r"(?:\w+\.)?GearTorque\.A(\d)"), r"joint_effort_\1"),
    (re.compile(r"(?:\w+\.)?MACur\.A(\d)", re.IGNORECASE), r"joint_current_\1"),
)
_MOTOR_STATE = re.compile(r"(?:^|[/.])motor_state[\[.]\d")
#: The order of Unitree's motors, which is not that of all its URDFs: of quadrupeds, and of the G1.
_QUADRUPED = tuple(
    f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf")
)
_LEG = "hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll"
_ARM = (
    *("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"),
    *("wrist_roll", "wrist_pitch", "wrist_yaw"),
)
_G1 = (
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _LEG),
    *("waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint"),
    *(f"{side}_{part}_joint" for side in ("left", "right") for part in _ARM),
)
_WAIST = "waist_yaw_joint"
#: Parts of joints' names of robots whose motors may have another order than the scene.
_LEGGED = re.compile(r"left|right|hip|knee|thigh|calf", re.IGNORECASE)
_KUKA_DEGREES = re.compile(r"(?:^|\.)AIPos\.A\d$")
#: The counter of KUKA's interpolation cycles, in ms; a log may have that of the answer, too.
_KUKA_MILLISECONDS = re.compile(r"(?:\w+\.)?IPOC", re.IGNORECASE)
_ODRIVE = re.compile(r"(?:^|[./])pos_estimate$", re.IGNORECASE)
#: Words beside the quantity in names of columns that only number the joints: `actual_q_0`,
#: `j1_rad`, `observation.state_0`; of `A1` the word is no acceleration, but an axis.
_FILLERS = {"actual", "measured", "joint", "joints", "axis", "state", "states", "j", "observation"}
_AXIS = "A"
#: What `pinfric inverse` and `simulate` write beside the motion.
_COMPUTED = tuple(
    f".{quantity}" for quantity in (*ACTUATOR_QUANTITIES, *SITE_QUANTITIES, *SITE_ARRAYS)
)
#: What was asked of a joint is not what it did.
_WANTED = re.compile(r"command|desired|target|reference|setpoint|error", re.IGNORECASE)
_TIME = re.compile(
    r"^(?:t|%?time|__time|timestamp|time_?stamp|elapsed|stamp)"
    r"(?:[ _]?[\[(]?(s|sec|ms|us|ns)[\])]?)?$",
    re.IGNORECASE,
)
#: What `rostopic echo -p` writes; its numbers stand without a mark behind the quantity.
_ROSTOPIC, _ROSTOPIC_STAMP = "field.", "field.header.stamp"
_STAMP = re.compile(r"header[./_]stamp[./_](secs?|nsecs?|nanosec)$", re.IGNORECASE)
_NUMBERED = re.compile(r"^(.*?)([A-Za-z]+)(?:_(\d+)|\[(\d+)\]|\.(\d+))$")
#: No tool writes longer names; they would only take time.
_LONGEST_NAME = 400
_SPLIT = re.compile(r"[/.:\s\[\]()]+")


class JointMapping(Entry):
    """Where a log has a joint: position = sign (scale raw + offset), offset in rad or m.

    effort = sign effort_scale raw.
    """

    position: str = key("its column", "J3")
    velocity: str | None = optional("its column, used for comparison only", "dJ3")
    effort: str | None = optional("its column", "tau3")
    current: str | None = optional("its column, instead of an effort", "I3")
    scale: Number = key("of the position", 0.01, "1", default=1.0)
    effort_scale: Number = key(
        "N m or N per logged unit, of a current N m per A", 11.5, "1", default=1.0
    )
    sign: Literal[-1, 1] = key("-1 if the log counts in the other direction", -1, "1", default=1)
    offset: Number = key("of the position", 1.5707963, "rad or m", default=0.0)
    unit: Literal["rad", "deg", "turn"] | None = optional("of the logged angle", "deg")


class TimeMapping(Entry):
    """Which column is time, and its unit; or the rate of rows without time."""

    column: str | None = optional("its name", "stamp")
    rate: Positive | None = optional("of the rows, where no column is their time", 50, "Hz")
    unit: Literal["s", "ms", "us", "ns"] | None = optional(
        "of its numbers; left out: from their steps", "us"
    )

    @model_validator(mode="after")
    def _either(self) -> TimeMapping:
        if (self.column is None) == (self.rate is None):
            raise ValueError("give either `column`, or `rate` in Hz where there is no time")
        return self


class ColumnsFile(Entry):
    """A mapping file: time, recording, and per joint a column's name or more."""

    time: Annotated[str | TimeMapping, Forms(str, TimeMapping)] | None = optional(
        "its column", {"column": "stamp", "unit": "us"}
    )
    unit: Literal["rad", "deg", "turn"] | None = optional("of all logged angles", "deg")
    episode: int | None = optional(
        "number of the recording that is read, where the column `episode_index` has several", 3
    )
    joints: dict[str, Annotated[str | JointMapping, Forms(str, JointMapping)]] = key(
        "by joint: its position column, or more keys",
        {"elbow": {"position": "J3", "unit": "deg", "sign": -1}, "wrist": "J4"},
        default_factory=dict,
    )
    base: BaseMapping | None = optional(
        "the pose of a base that floats", {"position": ["x", "y", "z"], "quaternion": list("abcd")}
    )
    external: dict[str, WrenchMapping] = key(
        "by frame: the force on it, as of a foot",
        {"left_foot": {"force": ["lfx", "lfy", "lfz"], "axes": "world"}},
        default_factory=dict,
    )


@dataclass(frozen=True)
class Use:
    """A column and how its numbers become SI: factor raw + offset; `unit` if known."""

    column: str
    factor: float = 1.0
    offset: float = 0.0
    unit: str | None = None


@dataclass
class Columns:
    """What the columns of a log are; joints by name.

    `planned`: velocities and accelerations count (`<joint>.v`, `.a` of our own files); measured
    ones are only compared. `unclear`: what is wrong where nobody states the angles' unit.
    """

    time: str = ""
    rate: float | None = None
    time_unit: str | None = None
    by_header: bool = False
    nanoseconds: str | None = None
    position: dict[str, Use] = field(default_factory=dict)
    velocity: dict[str, Use] = field(default_factory=dict)
    acceleration: dict[str, Use] = field(default_factory=dict)
    effort: dict[str, Use] = field(default_factory=dict)
    planned: bool = True
    payloads: list[str] = field(default_factory=list)
    wrench: dict[str, dict[int, str]] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)
    unclear: str = ""

    def used(self) -> list[str]:
        """Every column that is read, time first."""
        uses = (self.position, self.velocity, self.acceleration, self.effort)
        names = [name for name in (self.time, self.nanoseconds) if name]
        names += [use.column for uses_of in uses for use in uses_of.values()]
        names += [column for parts in self.wrench.values() for column in parts.values()]
        return list(dict.fromkeys([*names, *(PAYLOAD + name for name in self.payloads)]))


def read_mapping(path: Path, stated: Path | str | None) -> ColumnsFile | None:
    """Read the mapping file that was named, or LOG.columns.yaml beside the log; None: no such file.

    Raises:
        TrajectoryError: unreadable, unknown keys, values that cannot be.
    """
    stem = Path(path.stem).stem if path.suffix.lower() == ".gz" else path.stem
    beside = path.with_name(f"{stem}.columns.yaml")
    file = Path(stated) if stated else beside if beside.is_file() else None
    if file is None:
        return None
    return parse(ColumnsFile, read_yaml(file, TrajectoryError), str(file), TrajectoryError)


def find_columns(
    header: Sequence[str],
    first: Sequence[str],
    joints: Sequence[JointColumn],
    payloads: Sequence[str],
    mapping: ColumnsFile | None,
    said: Remarks,
    currents: Collection[str] = (),
    frames: Collection[str] = (),
) -> Columns:
    """Say which column is what.

    Args:
        frames: of the robot, on which forces may have columns.
        first: the first row's texts. mapping: what a person says.
        joints, payloads: those that may have columns.
        said: what is missing, twice there or unknown is added here.
        currents: joints whose current is read where there is no effort.
    """
    columns, problems = Columns(), said.problems
    names = [joint.name for joint in joints]
    driven = [joint.name for joint in joints if not joint.free]  # those that columns may number
    columns.wrench = wrench_columns(
        header, frames, {} if mapping is None else mapping.external, problems
    )
    forces = {column for parts in columns.wrench.values() for column in parts.values()}
    claims: dict[tuple[str, str], list[str]] = {}
    numbered = {}  # number -> joint, from columns `name_0` or `name[0]` that hold the joints' names
    for column, cell in zip(header, first, strict=False):
        match = _NUMBERED.match(_marked(column[:_LONGEST_NAME]))
        if match and match[2].lower() == "name":
            numbered[next(x for x in match.groups()[2:] if x is not None)] = cell.strip()
    if any(map(_MOTOR_STATE.search, header)) and (order := _unitree_order(driven)):
        numbered = {str(number): joint for number, joint in enumerate(order)}
        said.notes.append(f"motors are numbered in Unitree's order: {listing(order)}")
    for column in (name for name in dict.fromkeys(header) if name not in forces):
        meaning = meaning_of(column, names, numbered)
        if column.startswith(PAYLOAD):
            short = column.removeprefix(PAYLOAD)
            if short in payloads:
                columns.payloads.append(short)
            else:
                problems.append(
                    f"unknown payload in column {brief(column)}; {choose_from(short, payloads)}"
                )
        elif meaning is not None and not _WANTED.search(column):
            claims.setdefault(meaning, []).append(column)
        elif not (
            _TIME.match(column)
            or is_counter(column)
            or column in EPISODES
            or column.endswith(_COMPUTED)
        ):
            columns.ignored.append(column)
    _find_time(header, first, mapping, columns, problems)
    named = {c for c, cell in zip(header, first, strict=False) if cell in numbered.values()}
    if mapping is not None:
        _apply(mapping, header, names, claims, columns, problems)
    uneven = ""
    if not any(n in columns.position or (n, "position") in claims for n in driven):
        uneven = _take_in_order(header, driven, claims, said, currents)
    _settle(claims, columns, problems, currents)
    turned = [use.column for use in columns.position.values() if _ODRIVE.search(use.column)]
    if any(use.unit is None for use in columns.position.values() if use.column in turned):
        columns.unclear = (
            f"columns {listing(turned)} may be in turns of ODrives' motors: give --unit turn where "
            "the joints turn with them, else `{unit: turn, scale: 1/RATIO}` by joint in a file "
            "given by --columns; --unit rad takes them as they are"
        )
    used = {*columns.used(), *named}
    columns.ignored = [column for column in dict.fromkeys(columns.ignored) if column not in used]
    for name in columns.used():
        if name and header.count(name) > 1:
            problems.append(f"column {brief(name)} occurs {header.count(name)} times")
    other = sorted({quantity for _, quantity in claims})
    if not columns.position and names and other:
        problems.append(
            f"{uneven}has {' and '.join(other)} of the joints, but no positions, which are needed"
        )
    elif not columns.position and names:
        problems.append(
            f"no column is a joint of the scene ({listing(names)}); {uneven}there are: "
            f"{_shown(header)}; map them by --columns FILE, a YAML file with "
            f"`joints: {{{names[0]}: COLUMN}}`"
        )
    return columns


def _take_in_order(
    header: Sequence[str],
    names: Sequence[str],
    claims: dict[tuple[str, str], list[str]],
    said: Remarks,
    currents: Collection[str],
) -> str:
    """Take columns that number the joints in the scene's order, if there is one for each.

    For example `actual_q_0` to `actual_q_5`, `q1` to `q6`, `A1`. Returned is a clause on positions
    of which there is not one for each.
    """
    uneven = ""
    groups: dict[tuple[str, str], dict[int, str]] = {}
    for column in dict.fromkeys(header):
        match = re.fullmatch(r"(\D*?)[_\[.]?(\d+)\]?(\D*)", _in_words(column[:_LONGEST_NAME]))
        if match and not _WANTED.search(column):
            groups.setdefault((match[1], match[3]), {})[int(match[2])] = column
    legged = any(map(_LEGGED.search, names))  # Unitree's H1 has another order than its URDF
    for template, group in groups.items():
        words = [
            word.lower()
            for part in template
            for word in re.split(r"[^A-Za-z]+", part)
            if word and (word, part) != (_AXIS, template[0])
        ]
        axes = template[0] == _AXIS
        kinds = {_QUANTITY[word] for word in words if word in _QUANTITY}
        known = all(word in _QUANTITY or word in _FILLERS for word in words)
        known &= not (legged and any(map(_MOTOR_STATE.search, group.values())))
        numbers = sorted(group)
        if not known or not (words or axes) or len(kinds) > 1 or "acceleration" in kinds:
            continue
        if numbers != list(range(min(numbers[0], 1), min(numbers[0], 1) + len(names))):
            if kinds <= {"position"} and len(group) > 1:
                uneven = (
                    f"{listing(group.values())} are not one for each joint, numbered from 0 or 1; "
                )
            continue
        ordered, kind = [group[number] for number in numbers], next(iter(kinds), "position")
        for name, column in zip(names, ordered, strict=True):
            claims.setdefault((name, kind), []).append(column)
        if kind == "current" and not currents:
            continue  # they are not read
        said.notes.append(
            f"columns {ordered[0]} to {ordered[-1]} are read in the scene's order, "
            f"{names[0]} to {names[-1]}"
        )
    return uneven


def _unitree_order(names: Sequence[str]) -> tuple[str, ...]:
    """Return the joints in the order of a robot's motors; (): names do not tell which robot.

    A G1 is told from other humanoids, whose motors have another order, by its waist.
    """
    orders = [_QUADRUPED, *([_G1] if _WAIST in names else [])]
    return next((order for order in orders if set(names) <= set(order)), ())


def is_counter(column: str) -> bool:
    """Whether a column is a time since a controller started."""
    return _KUKA_MILLISECONDS.fullmatch(column) is not None


def _in_words(column: str) -> str:
    """Return a column's name with the quantity in place of a unit: tau [Nm]; see `_DIALECTS`."""
    for pattern, words in _DIALECTS:
        if match := pattern.fullmatch(column):
            return match.expand(words)
    unit = _UNIT.search(column)
    meant = _UNITS.get(re.sub(r"[ ·*.]", "", unit[1]).lower()) if unit else None
    return f"{column[: unit.start()]}/{meant}" if unit and meant else column


def _marked(column: str) -> str:
    """Return a column of `rostopic echo -p` with a marked number: field.position_0."""
    return re.sub(r"(\d+)$", r"_\1", column) if column.startswith(_ROSTOPIC) else column


def meaning_of(
    column: str, names: Sequence[str], numbered: dict[str, str]
) -> tuple[str, str] | None:
    """Return the joint and the quantity that a column's name says.

    `numbered`: number -> joint, of columns that only number the joints.
    """
    if len(column) > _LONGEST_NAME:
        return None
    column = _marked(_in_words(column))
    for ending, quantity in (("", "position"), (".v", "velocity"), (".a", "acceleration")):
        if column.endswith(ending) and column.removesuffix(ending) in names:
            return column.removesuffix(ending), quantity
    match = _NUMBERED.match(column)
    if match and numbered:
        number = next(x for x in match.groups()[2:] if x is not None)
        kind = _QUANTITY.get(match[2].lower())
        return (numbered[number], kind) if kind and numbered.get(number) in names else None
    for name in sorted(names, key=len, reverse=True):
        at = re.search(rf"(?:^|[/.:\s\[_-]){re.escape(name)}(?:$|[/.:\s\](_-])", column)
        if at is None:
            continue
        before, after = column[: at.start()], column[at.end() :]
        words = [word.lower() for part in (before, after) for word in _SPLIT.split(part) if word]
        words = [part for word in words for part in (word, word.rsplit("_", 1)[-1].strip("_-"))]
        kinds = [_QUANTITY[word] for word in words if word in _QUANTITY]
        unknown = [w for w in _SPLIT.split(after) if w and w.lower().strip("_-") not in _QUANTITY]
        if unknown:
            return None
        return (name, kinds[-1]) if kinds else (name, "position") if not after else None
    return None


def _find_time(
    header: Sequence[str],
    first: Sequence[str],
    mapping: ColumnsFile | None,
    columns: Columns,
    problems: list[str],
) -> None:
    if mapping is not None and mapping.time is not None:
        time = mapping.time if isinstance(mapping.time, TimeMapping) else None
        columns.rate = time.rate if time else None
        if columns.rate is not None:
            return
        columns.time = str(time.column if time else mapping.time)
        columns.time_unit = time.unit if time else None
        if columns.time not in header:
            problems.append(
                f"columns: time: there is no column {brief(columns.time)}; "
                f"{choose_from(columns.time, header)}"
            )
            columns.time = ""
        return
    candidates = [name for name in dict.fromkeys(header) if _TIME.match(name)]
    stamped = dict(zip(header, first, strict=False)).get(_ROSTOPIC_STAMP, "0")
    if stamped.strip("0"):  # when it was measured; %time says when it was written
        candidates = [_ROSTOPIC_STAMP]
    if counters := list(
        filter(is_counter, header)
    ):  # when the robot was there; a time beside it is that of the logger
        columns.time, columns.time_unit = counters[0], "ms"
        return
    stamps = {m[1][0].lower(): name for name in header if (m := _STAMP.search(name))}
    if len(candidates) > 1:
        problems.append(
            f"columns {listing(map(repr, candidates))} may all be the time; name it in a YAML file "
            f"with `time: {candidates[0]}`, given by --columns"
        )
    elif candidates:
        columns.time = candidates[0]
        unit = (_TIME.match(candidates[0]) or [None, None])[1]
        columns.time_unit = {"sec": "s"}.get(unit.lower(), unit.lower()) if unit else None
    elif len(stamps) == 2:
        columns.time, columns.nanoseconds = stamps["s"], stamps["n"]
    else:
        problems.append(
            f"there is no column t (time, s), nor time, timestamp or __time; there are: "
            f"{_shown(header)}; name it by --columns FILE, a YAML file with `time: NAME`, or with "
            "the rows' rate in Hz, `time: {rate: 50}`, if they have none"
        )


def _apply(
    mapping: ColumnsFile,
    header: Sequence[str],
    names: Sequence[str],
    claims: dict[tuple[str, str], list[str]],
    columns: Columns,
    problems: list[str],
) -> None:
    """A mapping overrules what names suggest."""
    for joint, entry in mapping.joints.items():
        if joint not in names:
            problems.append(
                f"columns: joints: there is no joint {joint!r}; {choose_from(joint, names)}"
            )
            continue
        to = entry
        if isinstance(to, str):  # another name: other columns with that name belong to it, too
            own = {x: f"{to}/{x}" for x in ("velocity", "effort") if f"{to}/{x}" in header}
            to = JointMapping.model_validate({"position": to, **own})
        turn, turn_effort = to.sign * to.scale, to.sign * to.effort_scale
        unit = to.unit or mapping.unit
        for quantity, column, use in (
            ("position", to.position, Use(to.position, turn, to.sign * to.offset, unit)),
            ("velocity", to.velocity, Use(to.velocity or "", turn, 0.0, unit)),
            ("effort", to.effort or to.current, Use(to.effort or to.current or "", turn_effort)),
        ):
            claims.pop((joint, quantity), None)
            if column is None:
                continue
            if column not in header:
                problems.append(
                    f"columns: joints.{joint}.{quantity}: there is no column "
                    f"{brief(column)}; {choose_from(column, header)}"
                )
                continue
            getattr(columns, quantity)[joint] = use


def _settle(
    claims: dict[tuple[str, str], list[str]],
    result: Columns,
    problems: list[str],
    currents: Collection[str],
) -> None:
    for (joint, quantity), columns in claims.items():
        exact = [c for c in columns if c in (joint, f"{joint}.v", f"{joint}.a")]
        chosen = exact or columns
        if len(chosen) > 1:
            problems.append(
                f"columns {listing(map(repr, chosen))} may all be the {quantity} of "
                f"joint {joint}; name it by --columns FILE"
            )
        result.ignored += [c for c in columns if c not in chosen[:1]]
        if quantity == "current":
            if joint in currents and (joint, "effort") not in claims:
                result.effort.setdefault(joint, Use(chosen[0]))
            else:
                result.ignored.append(chosen[0])  # a current is an effort only with a gain
            continue
        unit = _ANGLE.search(chosen[0])
        word = next(x for x in unit.groups() if x).lower() if unit and quantity != "effort" else ""
        word = "deg" if _KUKA_DEGREES.search(chosen[0]) else word
        known = {"rev": "turn"}.get(word, word) or None
        getattr(result, quantity)[joint] = Use(chosen[0], unit=known)
        result.by_header |= known is not None and quantity == "position"
        if quantity in ("velocity", "acceleration") and not exact:
            result.planned = False


def _shown(header: Sequence[str]) -> str:
    return listing(cut(name, 80) for name in header)
