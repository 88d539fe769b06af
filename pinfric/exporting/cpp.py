"""A scene as constants of a C++ header, before a fixed text that computes with them.

The text, `compensator.hpp`, is the same for every robot: rigid-body dynamics by Newton and Euler,
normal loads, friction, gears, and the compensation D(v) of `notebooks/theory/compensation.md`.
Bodies' axes are turned so that each joint's is z.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from pinfric import __version__
from pinfric.dynamics.forward.compensation import (
    LARGEST_ACCELERATION,
    LARGEST_ERROR,
    MEASURED_SCALE,
    check_compensated,
    freedom_names,
    measured_ways,
    reach,
    ways_of_drives,
)
from pinfric.errors import PinfricError, choose_from, one_line
from pinfric.model.bearings import axes_along, contacts
from pinfric.model.couples import delivery, rate_rows, taking_part
from pinfric.model.files import file_hash
from pinfric.model.magnitudes import LARGEST
from pinfric.model.robot import link_frame, plausible_distance
from pinfric.model.scene import Scene
from pinfric.model.twin import PRISMATIC

_Z = np.array([0.0, 0.0, 1.0])
#: A payload added at run time, over the mass of all that moves: more is a mass in grams.
_HEAVIEST = 10.0
#: Names that C++ and its libraries keep.
_KEYWORDS = (
    "alignas|alignof|and|asm|auto|bitand|bitor|bool|break|case|catch|char|class|compl|"
    "concept|const|constexpr|continue|decltype|default|delete|do|double|else|enum|explicit|"
    "export|extern|false|float|for|friend|goto|if|inline|int|long|mutable|namespace|new|"
    "noexcept|not|nullptr|operator|or|private|protected|public|register|requires|return|"
    "short|signed|sizeof|static|struct|switch|template|this|throw|true|try|typedef|typeid|"
    "typename|union|unsigned|using|virtual|void|volatile|while|xor|posix|std"
)


class CppFiles(NamedTuple):
    """The two files of a compensator.

    Attributes:
        header: the compensator.
        test: a main that compares it with embedded states, or replays a trajectory's CSV.
    """

    header: str
    test: str


class Bounds(NamedTuple):
    """Defaults of a header's options, (na,) each.

    Attributes:
        limit: of the compensation (N m or N). joint_effort_limit: of the whole `joint_effort`.
        stable_scale: 1/(1 + e), the largest at a measured velocity; 1 where e is unknown.
    """

    limit: Sequence[float]
    joint_effort_limit: Sequence[float]
    stable_scale: Sequence[float]

    @classmethod
    def none(cls, drives: int) -> Bounds:
        """Return bounds without effect."""
        return cls([np.inf] * drives, [np.inf] * drives, [1.0] * drives)


class EmbeddedState(NamedTuple):
    """One state with pinfric's results.

    Attributes:
        q, v, a: (nv,) rad, m and per second.
        least, greatest: (na,) motors' torques (N m).
        friction: (na,) compensation at v with default options (N m or N at the joint).
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    least: np.ndarray
    greatest: np.ndarray
    friction: np.ndarray


def check_frames(scene: Scene, frames: Sequence[str]) -> None:
    """Refuse frames for payloads and wrenches that do not exist, or stand on the ground.

    Raises:
        PinfricError: names the frame.
    """
    for name in frames:
        _frame(scene, name)


def cpp_files(
    scene: Scene,
    frames: Sequence[str],
    bounds: Bounds,
    states: Sequence[EmbeddedState],
    lines: Iterable[str],
    name: str = "",
) -> CppFiles:
    """Return the header and its test.

    Args:
        frames: names of links for payloads and wrenches at run time; none: see `default_frames`.
        lines: the comment at the top of the header.
        name: of the namespace and the files; empty: see `header_name`.

    Raises:
        PinfricError: see `check_compensated`, `check_frames` and `header_name`.
    """
    check_compensated(scene)
    check_frames(scene, frames)
    frames = tuple(dict.fromkeys(frames)) or default_frames(scene)
    name = header_name(scene.source, name)
    title = "\n".join(f"// {_comment(line)}".rstrip() for line in lines).removeprefix("// ")
    constants = "\n".join(_constants(scene, frames, bounds))
    header = named(template("compensator.hpp").replace("// @@CONSTANTS\n", constants + "\n"), name)
    digest = hashlib.sha256(header.encode()).hexdigest()[:12]
    files = [Path(scene.source), *([] if scene.robot is None else [scene.robot.urdf])]
    hashes = [f"{file.name} sha256 {file_hash(file)}" for file in files if file.is_file()]
    said = f"pinfric {__version__}, {', '.join(hashes) or 'a scene made in Python'}"
    said = _comment(said).replace('"', "'")
    made_of = f"{name}: {said}, constants and code {digest}"
    for mark, text in (("HASH", digest), ("MADE_OF", made_of), ("TITLE", title)):
        header = header.replace(f"@@{mark}", text)
    rows = "\n".join(f"    {{{', '.join(_array(array) for array in state)}}}," for state in states)
    test = template("compensator_test.cpp").replace("// @@STATES\n", rows + "\n")
    return CppFiles(header, named(test, name).replace("@@HEADER", f"{name}.hpp"))


def header_name(source: str, name: str = "") -> str:
    """Return the namespace of a scene's header, also the name of its file: pinfric_SCENE.

    Args:
        source: the scene's file. name: the user's; empty: made from the source.

    Raises:
        PinfricError: a name that C++ does not allow or reserves.
    """
    if not name:
        stem = re.sub(r"[\W_]+", "_", Path(source).stem, flags=re.ASCII)
        return f"pinfric_{stem.strip('_')}".rstrip("_")
    if not re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", name) or re.fullmatch(_KEYWORDS, name):
        raise PinfricError(
            f"--namespace {name!r}: should be a name of C++: letters, digits and single "
            "underscores, a letter first, no keyword"
        )
    return name


def default_frames(scene: Scene) -> tuple[str, ...]:
    """Return the links that carry payloads, and the last link of each branch."""
    model = scene.model
    ends = set(range(1, model.njoints)) - {int(parent) for parent in model.parents}
    last: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.parentJoint in ends:
            last[frame.parentJoint] = frame.name
    carrying = [
        payload.link
        for payload in scene.payloads.values()
        if model.frames[link_frame(model, payload.link)].parentJoint > 0
    ]
    return tuple(dict.fromkeys([*carrying, *last.values()]))


def _frame(scene: Scene, name: str) -> pin.Frame:
    """The frame of that name; a link's before others."""
    model = scene.model
    frames = [frame for frame in model.frames if frame.name == name]
    frames.sort(key=lambda frame: frame.type != pin.FrameType.BODY)
    if not frames:
        if model.existJointName(name):  # a model made in Python need not have frames
            joint = model.getJointId(name)
            return pin.Frame(name, joint, pin.SE3.Identity(), pin.FrameType.JOINT)
        links = (f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint)
        names = [link.name for link in links] or list(scene.joint_names)
        raise PinfricError(
            f"{scene.source}: --frame: there is no link {name!r}; {choose_from(name, names)}"
        )
    if frames[0].parentJoint == 0:
        raise PinfricError(
            f"{scene.source}: --frame: {name!r} is fixed to the ground, so a force there "
            "loads no joint: give a link that moves"
        )
    return frames[0]


def _constants(scene: Scene, frames: Sequence[str], bounds: Bounds) -> list[str]:
    """All tables of a scene; their fields have the names of `compensator.hpp`."""
    nv, na = scene.model.nv, len(scene.drives)
    turns = _turns(scene)
    bodies = [(name, _array(fields)) for name, fields in body_rows(scene)]
    sites, terms, rows = _laws(scene)
    drives, lines = _drives(scene)
    placed = []
    for name in frames:
        frame = _frame(scene, name)
        turn, place = turns[frame.parentJoint], frame.placement
        at = _array([frame.parentJoint - 1, turn @ place.rotation, turn @ place.translation])
        placed.append((name, at))
    P, coupled = delivery(scene.drives, nv), set(taking_part(scene.drives))
    least, greatest, fastest = reach(scene)
    counts = {
        "bodies": len(bodies),
        "freedoms": nv,
        "sites": len(sites),
        "drives": na,
        "frame_count": len(placed),
    }
    return [
        "struct Robot {",
        *(f"  static constexpr int {name} = {count};" for name, count in counts.items()),
        f"  static constexpr bool coupled = {'true' if P.size else 'false'};",
        *_names("freedom_names", freedom_names(scene)),
        *_names("drive_names", scene.actuator_names),
        *_names("site_names", scene.site_names),
        *_names("frames", frames),
        "};",
        "",
        *_table("Body", "bodies", bodies),
        *_table("Site", "sites", sites),
        *_table("Term", "terms", terms),
        *_table("Row", "rows", rows),
        *_table("Drive", "drives", drives),
        *_table("Line", "lines", lines),
        *_table("Frame", "frames", placed),
        *_numbers("armature[]", scene.model.armature),
        *_numbers("default_gravity[]", scene.model.gravity.linear),
        *_numbers("default_limit[]", bounds.limit),
        *_numbers("default_joint_effort_limit[]", bounds.joint_effort_limit),
        "// At a measured velocity: 1/(1 + e), where e is how far friction is known.",
        *_numbers("stable_scale[]", bounds.stable_scale),
        *_numbers("default_measured_scale[]", np.minimum(MEASURED_SCALE, bounds.stable_scale)),
        *_numbers("default_measured_way[]", measured_ways(scene)),
        "// Over which friction builds up after a reversal (rad or m); 0: it acts at once.",
        *_numbers("presliding_way[]", ways_of_drives(scene)),
        f"inline constexpr bool presliding = {'true' if scene.ways is not None else 'false'};",
        "// No payload's centre of mass is farther from its frame (m).",
        *_numbers("farthest", min(plausible_distance(scene.model), LARGEST)),
        f"// No payload added is heavier (kg): {_HEAVIEST:g} times what moves.",
        *_numbers("heaviest", _heaviest(scene)),
        *_numbers(f"drive_rate[][{nv}]", rate_rows(scene.drives, nv)),
        *_numbers(f"delivery[][{na}]", P if P.size else np.eye(na)),
        f"inline constexpr bool together[] = {_array(d in coupled for d in range(na))};",
        "// States beyond these are refused: a turn (m) beyond the limits, ten times the fastest.",
        *_numbers("least_position[]", least),
        *_numbers("greatest_position[]", greatest),
        *_numbers("greatest_velocity[]", fastest),
        *_numbers("greatest_acceleration", LARGEST_ACCELERATION),
        *_numbers("greatest_error", LARGEST_ERROR),
    ]


def _numbers(name: str, values: object) -> list[str]:
    return [f"inline constexpr double {name} = {_value(np.asarray(values))};"]


def _heaviest(scene: Scene) -> float:
    """The heaviest payload that may be added (kg); a robot without masses says nothing."""
    moving = sum(inertia.mass for inertia in list(scene.loaded_model().inertias)[1:])
    return min(_HEAVIEST * moving, LARGEST) if moving > 0.0 else LARGEST


def _turns(scene: Scene) -> np.ndarray:
    """From the axes of each joint's child to those whose z is its axis; first of the ground."""
    twin = scene.twin()
    axes = np.where((twin.kind == PRISMATIC)[:, None], twin.axis[:, :3], twin.axis[:, 3:])
    return np.array([np.eye(3), *(axes_along(axis) for axis in axes)])


def body_rows(scene: Scene) -> list[tuple[str, list[Any]]]:
    """Return each joint's name, and its body by the fields of `Body` in `compensator.hpp`.

    Bodies' axes are turned so that each joint's is z; arrays are not flattened.
    """
    twin, model, rows, turns = scene.twin(), scene.loaded_model(), [], _turns(scene)
    for row, name in enumerate(scene.joint_names):
        parent, turn = int(model.parents[row + 1]), turns[row + 1]
        placement, inertia = model.jointPlacements[row + 1], model.inertias[row + 1]
        moments = turn @ inertia.inertia @ turn.T
        fields = [
            parent - 1,
            bool(twin.kind[row] != PRISMATIC),
            int(twin.v_index[row]),
            float(twin.ratio[row]),
            float(twin.shift[row]),
            turns[parent] @ placement.rotation @ turn.T,
            turns[parent] @ placement.translation,
            turn,
            float(inertia.mass),
            turn @ inertia.lever,
            moments[np.triu_indices(3)],
        ]
        rows.append((name, fields))
    return rows


def _laws(scene: Scene) -> tuple[list[tuple[str, str]], ...]:
    laws = scene.site_tables.laws
    loads = contacts([site.friction.bearing for site in scene.sites], [_Z] * len(scene.sites))
    sites = []
    for s, site in enumerate(scene.sites):
        first, last = np.searchsorted(loads.site, [s, s + 1]).tolist()
        fields = [
            site.joint,
            site.velocity_index,
            site.ratio,
            laws.mu_static[s],
            laws.mu_kinetic[s],
            laws.coulomb_static[s],
            laws.coulomb_kinetic[s],
            laws.viscous[s],
            laws.stick_velocity[s],
            loads.constant[s],
            first,
            last,
            int(laws.row_start[s]),
            int(laws.row_end[s]),
        ]
        sites.append((site.name, _array(fields)))
    terms = [
        ("", _array([int(loads.rank[t]), bool(loads.moves[s]), loads.map[t], loads.map_moved[t]]))
        for t, s in enumerate(loads.site)
    ]
    shapes = zip(laws.mu, laws.coulomb, laws.power, laws.velocity, laws.exponent, strict=True)
    return sites, terms, [("", _array(fields)) for fields in shapes]


def _drives(scene: Scene) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    gears = scene.gears()
    fields = (
        "ratio",
        "rotor_inertia",
        "viscous",
        "power",
        "stick_velocity",
        "no_load",
        "no_load_static",
        "constant",
        "rise",
        "exponent",
        "first",
        "last",
    )
    drives = [
        (drive.name, _array([getattr(gears, field)[d] for field in fields]))
        for d, drive in enumerate(scene.drives)
    ]
    lines = zip(gears.load, gears.loss, gears.slope, strict=True)
    return drives, [("", _array(line)) for line in lines]


def _table(kind: str, name: str, entries: Sequence[tuple[str, str]]) -> list[str]:
    """One table; C++ has no empty arrays, so an empty one gets an entry that nothing reads."""
    if not entries:
        return [f"inline constexpr {kind} {name}[1] = {{}};", ""]
    lines = [f"    {text},{f'  // {_comment(label)}' if label else ''}" for label, text in entries]
    return [f"inline constexpr {kind} {name}[] = {{", *lines, "};", ""]


def _names(name: str, values: Sequence[str]) -> list[str]:
    quoted = ", ".join('"' + _comment(x).replace('"', r"\"") + '"' for x in values) or '""'
    return [f"  static constexpr const char* {name}[] = {{{quoted}}};"]


def _comment(text: str) -> str:
    """The text on one line, unable to end or continue a comment or a string."""
    return one_line(text).replace("\\", "/")


def _value(x: object) -> str:
    """A number or an array in C++, with all digits."""
    if isinstance(x, np.ndarray) and x.ndim:
        if x.ndim == 2 and x.shape != (3, 3):
            return f"{{{', '.join(map(_array, x))}}}"
        return _array(x.ravel())
    if isinstance(x, bool | np.bool_):
        return "true" if x else "false"
    if isinstance(x, int | np.integer):
        return str(int(x))
    number = float(x) + 0.0  # type: ignore[arg-type]
    return {np.inf: "inf", -np.inf: "-inf"}.get(number, repr(number))


def _array(values: Iterable[object]) -> str:
    return f"{{{', '.join(_value(x) for x in values)}}}"


def template(name: str) -> str:
    """Return a C++ file that is the same for every robot, by name."""
    return (resources.files("pinfric.exporting") / name).read_text(encoding="utf-8")


def named(text: str, name: str) -> str:
    """Return a template's text with the names of one robot's header."""
    guard = f"PINFRIC_{name.upper().removeprefix('PINFRIC_')}"
    return text.replace("PINFRIC_SCENE", guard).replace("pinfric_scene", name)
