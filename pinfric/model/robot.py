"""Read a URDF into a checked `pin.Model`; finds errors that Pinocchio reads silently."""

from __future__ import annotations

import copy
import math
import os
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.errors import FindingWarning, PinfricWarning, RobotError, choose_from
from pinfric.model.file_loops import FileLoops, file_loops
from pinfric.model.floating import set_base
from pinfric.model.mimics import link_of, lock_joints, numbers_before_names
from pinfric.model.mjcf import BALL, MARK, keyframes
from pinfric.model.schema import Payload
from pinfric.model.urdf import (
    UrdfDynamics,
    bodies,
    check_urdf,
    dynamics,
    mesh_file,
    reductions,
    warn_of_missing_meshes,
)
from pinfric.model.urdf_file import read_xml
from pinfric.model.yamlfile import brief, brief_path

#: A negative eigenvalue of the mass matrix within this fraction of the largest is rounding.
_ROUNDING = 1e-12
#: Poses at which a robot with negative moments of inertia is tested, and as many near the worst.
_POSES = 300


#: Share of a joint's inertia by which its sum here and Pinocchio's may differ: rounding.
_SAME_BODY = 1e-9

#: Prefix of a bundled robot's name.
BUNDLED = "example-robot-data:"


@dataclass(frozen=True)
class Robot:
    """A URDF as read: the model, data that Pinocchio does not read, and folders of its meshes.

    Attributes:
        closures: the loops that the file closes, which `model`, a tree, does not have.
    """

    model: pin.Model
    urdf: Path
    package_dirs: tuple[Path, ...]
    dynamics: Mapping[str, UrdfDynamics]
    reductions: Mapping[str, float]
    locked: Mapping[str, float] = field(default_factory=dict)
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    floating: bool | None = None
    closures: FileLoops = field(default_factory=FileLoops)

    @property
    def key(self) -> str:
        """How a scene names its file: `robot.urdf` or `robot.mjcf`."""
        return "mjcf" if MARK in self._root.attrib else "urdf"

    @property
    def dynamics_words(self) -> str:
        """What of its file gives friction, for messages."""
        if self.key == "mjcf":
            return "MJCF gives frictionloss, damping or armature"
        return "URDF's <dynamics> gives friction or damping"

    @property
    def gravity(self) -> list[float] | None:
        """(3,) of an MJCF that states it, m/s^2; else None."""
        text = self._root.get("gravity") if self.key == "mjcf" else None
        return None if text is None else [float(word) for word in text.split()]

    @property
    def keyframes(self) -> dict[str, dict[str, float]]:
        """Keyframe of an MJCF -> position (rad or m) by joint."""
        return keyframes(self._root)

    def xml(self) -> ElementTree.Element:
        """Return a copy of its root element, xacro expanded, its base as free as the model's."""
        root = self.file_xml()
        set_base(root, self.urdf, self.floating)
        return root

    def file_xml(self) -> ElementTree.Element:
        """Return a copy of the file's root element, xacro expanded; see `read_xml`."""
        return copy.deepcopy(self._root)

    @cached_property
    def _root(self) -> ElementTree.Element:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PinfricWarning)  # said when the robot was read
            return read_xml(self.urdf, self.xacro_args)

    @property
    def gears(self) -> dict[str, float]:
        """Joint of the model -> its reduction, for gears: finite, in magnitude neither 0 nor 1."""
        return {
            name: ratio
            for name, ratio in self.reductions.items()
            if name in self.model.names and math.isfinite(ratio) and abs(ratio) not in (0.0, 1.0)
        }


def example_robot_data() -> Path:
    """Return the folder `robots` of the installed example-robot-data wheel (it has no module)."""
    return Path(pin.__file__).parents[4] / "share/example-robot-data/robots"


def locator(urdf: Path, folder: str | Path | None) -> str:
    """How a scene in `folder` names the URDF."""
    full = urdf.resolve()
    bundled = example_robot_data().resolve()
    if full.is_relative_to(bundled):
        return f"example-robot-data:{full.relative_to(bundled).as_posix()}"
    if folder is None:
        return str(full)
    return Path(os.path.relpath(full, Path(folder).resolve())).as_posix()


def locate_urdf(locator: str, relative_to: Path) -> Path:
    """Resolve a scene's `robot.urdf`: a path, or `example-robot-data:<path below its robots>`."""
    if locator.startswith(BUNDLED):
        relative = locator.removeprefix(BUNDLED)
        folder = example_robot_data()
        path = folder / relative
        if not os.path.isfile(path):
            there = sorted(str(p.relative_to(folder)) for p in folder.rglob("*.urdf"))
            near = choose_from(relative, there)
            raise RobotError(f"robot.urdf: example-robot-data has no {brief(relative)}; {near}")
        return path
    path = Path(os.path.abspath(relative_to / os.path.expanduser(locator)))
    if not os.path.isfile(path):
        raise RobotError(f"robot.urdf: there is no file {brief_path(path)}")
    return path


def urdf_file(name: str | Path) -> Path:
    """Return the URDF of a path, or of the name of a bundled robot as in a scene.

    Raises:
        RobotError: there is no such file.
    """
    if str(name).startswith(BUNDLED):
        return locate_urdf(str(name), Path())
    if not os.path.isfile(name):
        raise RobotError(
            f"there is no file {name}; give a URDF, or `{BUNDLED}PATH` of example-robot-data"
        )
    return Path(name)


def read_robot(
    urdf: Path,
    locked: Mapping[str, float],
    xacro_args: Mapping[str, str] | None = None,
    floating: bool | None = None,
) -> Robot:
    """Read and check a URDF; joints in `locked` are fixed at a position (rad or m) and removed.

    `floating`: whether its base is free (`set_base`).

    Raises:
        RobotError: not XML, not a URDF, an impossible mass, inertia or axis, an unknown joint, a
            base that cannot float.
    """
    root = read_xml(urdf, xacro_args)
    check_urdf(root, urdf)
    set_base(root, urdf, floating)
    package_dirs = mesh_folders(urdf)
    warn_of_missing_meshes(root, urdf, package_dirs)
    closures = file_loops(root, urdf)
    for text in closures.said:
        warnings.warn(f"{urdf}: {text}", FindingWarning, stacklevel=2)
    lock_joints(root, locked, urdf)
    model = _pinocchio_model(root, urdf)
    _check_bodies(model, root, urdf)
    if model.nv == 0:
        raise RobotError(f"{urdf}: no joint of this robot can move; there is nothing to drive")
    check_kinetic_energy(model, str(urdf))
    data = dynamics(root), reductions(root)
    return Robot(model, urdf, package_dirs, *data, locked, xacro_args or {}, floating, closures)


def mesh_folders(urdf: Path) -> tuple[Path, ...]:
    """Return folders for `package://` names: the URDF's, those above it, then the bundled one."""
    share = example_robot_data()
    return (*urdf.resolve().parents, share.parents[1], share.parent, share)


def check_kinetic_energy(model: pin.Model, source: str) -> None:
    """Refuse a robot with negative kinetic energy, v^T M v / 2 < 0, for some q, v.

    M is positive definite if all bodies' moments are positive. With negative moments it must be so
    at all poses that a search within the joints' ranges tries.
    """
    if model.nv == 0:
        return

    def least(q: np.ndarray) -> tuple[float, np.ndarray]:
        values, vectors = np.linalg.eigh(mass_matrix(model, q))
        return float(values[0] / max(np.abs(values).max(), 1e-300)), vectors[:, 0]

    worst = pin.neutral(model)
    moments = [np.linalg.eigvalsh(inertia.inertia) for inertia in model.inertias]
    if any(J[0] < -_ROUNDING * np.abs(J).max() for J in moments):
        worst = _worst_pose(model, lambda q: least(q)[0])
    value, vector = least(worst)
    if value < -_ROUNDING:
        column = int(np.abs(vector).argmax())
        joint = next(
            n
            for n, j in zip(model.names, model.joints, strict=True)
            if j.idx_v <= column < j.idx_v + j.nv
        )
        raise RobotError(
            f"{source}: the links that joint {joint!r} moves have a negative kinetic energy at "
            f"q = {np.array2string(worst, precision=3, separator=', ', max_line_width=10_000)}; "
            "correct the <inertia> of its links"
        )


def mass_matrix(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Return M(q) (nv, nv), rotors (armatures) included, by columns of RNEA without gravity.

    `crba` is wrong where joints are not numbered depth first, as in some models made in Python.
    """
    light = pin.Model(model)
    light.gravity = pin.Motion.Zero()
    data, still = light.createData(), np.zeros(model.nv)
    M = np.array([pin.rnea(light, data, q, still, a) for a in np.eye(model.nv)])
    return np.asarray(0.5 * (M + M.T))


def _worst_pose(model: pin.Model, value: Callable[[np.ndarray], float]) -> np.ndarray:
    """Return the pose (nq,) with the least value within the joints' ranges.

    Random poses are tried, then smaller and smaller changes of the best.
    """
    rng, neutral = np.random.default_rng(0), pin.neutral(model)
    lower, upper = (
        np.maximum(model.lowerPositionLimit, -1e3),
        np.minimum(model.upperPositionLimit, 1e3),
    )
    single = [j.idx_q for j in model.joints if j.nq == 1]

    def pose(start: np.ndarray, change: np.ndarray) -> np.ndarray:
        q = np.asarray(pin.integrate(model, start, change))
        q[single] = np.clip(q[single], lower[single], upper[single])
        return q

    tried = [neutral, *(pose(neutral, rng.uniform(-np.pi, np.pi, model.nv)) for _ in range(_POSES))]
    worst = min(tried, key=value)
    for size in np.geomspace(1.0, 1e-3, _POSES):
        other = pose(worst, size * rng.normal(size=model.nv))
        worst = min(worst, other, key=value)
    return worst


def _pinocchio_model(root: ElementTree.Element, urdf: Path) -> pin.Model:
    """Build a model whose mimic joints come after the joints they follow."""
    numbers = numbers_before_names(root, urdf)
    if numbers:
        root = copy.deepcopy(root)
        for joint in root.findall("joint"):
            for named, key in ((joint, "name"), (joint.find("mimic"), "joint")):
                if named is not None:
                    named.set(key, numbers[named.attrib[key]] + named.attrib[key])
    with _silent_stderr() as said:
        try:
            balls = any(joint.get("type") == BALL for joint in root.findall("joint"))
            model = _with_balls(root, urdf) if balls else _from_xml(root)
        except RobotError:
            raise
        except Exception as problem:
            reason = said() or str(problem)
            raise RobotError(f"{urdf}: Pinocchio cannot build it: {reason}") from None
    if numbers:
        name_of = {number + name: name for name, number in numbers.items()}
        for index in range(1, model.njoints):
            model.names[index] = name_of[model.names[index]]
        for frame in model.frames:
            if frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT):
                frame.name = name_of.get(frame.name, frame.name)
    return model


def _from_xml(root: ElementTree.Element) -> pin.Model:
    return pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"), mimic=True)


#: Type of a joint -> Pinocchio's, about or along an axis.
_OF_TYPE = {
    "revolute": pin.JointModelRevoluteUnaligned,
    "prismatic": pin.JointModelPrismaticUnaligned,
}


def _with_balls(root: ElementTree.Element, urdf: Path) -> pin.Model:
    """Build an MJCF's model that has ball joints, which Pinocchio's reader of URDFs refuses.

    Raises:
        RobotError: a joint that follows another.
    """
    model = pin.Model()
    model.name = root.get("name", "")
    below: dict[str, list[ElementTree.Element]] = {}
    for joint in sorted(root.findall("joint"), key=lambda joint: joint.attrib["name"]):
        if joint.find("mimic") is not None:
            name = joint.attrib["name"].partition(" ")[2]
            raise RobotError(f"{urdf}: joint {name!r} follows another: not beside ball joints")
        below.setdefault(link_of(joint, "parent"), []).append(joint)
    bodies_of, origins = bodies(root), {x.get("name"): x for x in root.findall("link")}

    def numbers(element: ElementTree.Element | None, key: str) -> np.ndarray:
        text = "0 0 0" if element is None else element.get(key, "0 0 0")
        return np.array([float(word) for word in text.split()])

    def add(link: str, parent: int, place: pin.SE3) -> None:
        """Add a link at a place of a joint, and all that it carries."""
        model.addFrame(pin.Frame(link, parent, place, pin.FrameType.BODY))
        if link in bodies_of:
            mass, inertia = bodies_of[link]
            com = numbers(origins[link].find("inertial/origin"), "xyz")
            model.appendBodyToJoint(parent, pin.Inertia(mass, com, inertia), place)
        for joint in below.get(link, []):
            name, kind = joint.attrib["name"], joint.attrib["type"]
            at, limit = joint.find("origin"), joint.find("limit")
            there = place * pin.SE3(pin.rpy.rpyToMatrix(*numbers(at, "rpy")), numbers(at, "xyz"))
            if kind == "fixed":
                add(link_of(joint, "child"), parent, there)
                continue
            if limit is None:
                free = pin.JointModelSpherical() if kind == BALL else pin.JointModelFreeFlyer()
                index = model.addJoint(parent, free, there, name)
            else:
                axis = numbers(joint.find("axis"), "xyz")
                keys = ("effort", "velocity", "lower", "upper")
                ends = (np.array([float(limit.attrib[key])]) for key in keys)
                model_of = _OF_TYPE[kind](axis / np.linalg.norm(axis))
                index = model.addJoint(parent, model_of, there, name, *ends)
            model.addJointFrame(index, -1)
            add(link_of(joint, "child"), index, pin.SE3.Identity())

    add("world", 0, pin.SE3.Identity())
    return model


def _check_bodies(model: pin.Model, root: ElementTree.Element, urdf: Path) -> None:
    """Check that the model's joints carry the bodies of the document: urdfdom drops some silently.

    Each joint's 6 x 6 inertia about its origin is compared with the sum of its links'.
    """
    written, links = np.zeros((model.njoints, 6, 6)), [list[str]() for _ in range(model.njoints)]
    origins = {link.get("name"): link.find("inertial/origin") for link in root.findall("link")}
    for name, (mass, inertia) in bodies(root).items():
        frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        origin = origins[name]
        com, rpy = (
            [float(x) for x in ("0 0 0" if origin is None else origin.get(key, "0 0 0")).split()]
            for key in ("xyz", "rpy")
        )
        axes, arm = pin.rpy.rpyToMatrix(*rpy), pin.skew(np.array(com))
        about_origin = axes @ inertia @ axes.T - mass * arm @ arm
        body = np.block([[mass * np.eye(3), -mass * arm], [mass * arm, about_origin]])
        place = frame.placement
        body = place.toDualActionMatrix() @ body @ place.toActionMatrixInverse()
        written[frame.parentJoint] += body
        links[frame.parentJoint].append(name)
    for joint in range(1, model.njoints):
        read, size = model.inertias[joint].matrix(), np.abs(written[joint]).max()
        if not np.abs(read - written[joint]).max() <= _SAME_BODY * size:
            raise RobotError(
                f"{urdf}: Pinocchio reads another mass or inertia of link "
                f"{' or '.join(map(repr, links[joint])) or model.names[joint]} ({read[0, 0]:g} kg) "
                f"than is written ({written[joint, 0, 0]:g} kg); write its numbers plainly"
            )


class _silent_stderr:  # noqa: N801 - used like a function
    """Capture stderr of C libraries: urdfdom reports its reasons only there."""

    def __enter__(self) -> Any:
        import tempfile

        self._file = tempfile.TemporaryFile()
        self._saved = os.dup(2)
        os.dup2(self._file.fileno(), 2)

        def said() -> str:
            """The first reason; the lines after it are places in urdfdom."""
            self._file.seek(0)
            lines = self._file.read().decode(errors="replace").splitlines()
            reasons = [line.split("Error:")[1].strip() for line in lines if "Error:" in line]
            return reasons[0] if reasons else ""

        return said

    def __exit__(self, *_: object) -> None:
        os.dup2(self._saved, 2)
        os.close(self._saved)
        self._file.close()


def robot_text(robot: Robot, inertias: Mapping[str, pin.Inertia | None]) -> str:
    """Return a robot's URDF with other inertias; its meshes are named in full.

    `inertias`: link -> its own, about its centre of mass; None: it has none. Its base is the
    file's: a scene says that it floats.
    """
    root = robot.file_xml()
    for link in root.findall("link"):
        if (name := link.attrib["name"]) in inertias:
            for old in link.findall("inertial"):
                link.remove(old)
            if (own := inertias[name]) is not None:
                link.insert(0, _inertial(own))
    bundled = example_robot_data().resolve()
    for mesh in root.iter("mesh"):
        file = mesh_file(mesh.get("filename"), robot.urdf, robot.package_dirs)
        named = str(mesh.get("filename")).startswith("package:")
        if file is not None and not (named and file.resolve().is_relative_to(bundled)):
            mesh.set("filename", f"file://{file.resolve()}")
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _inertial(inertia: pin.Inertia) -> ElementTree.Element:
    def numbers(values: Any) -> str:
        return " ".join(f"{x:.10g}" for x in values)

    element = ElementTree.Element("inertial")
    ElementTree.SubElement(element, "origin", xyz=numbers(inertia.lever), rpy="0 0 0")
    ElementTree.SubElement(element, "mass", value=f"{inertia.mass:.10g}")
    I = inertia.inertia  # noqa: E741 - the moments
    moments = {f"i{'xyz'[i]}{'xyz'[k]}": f"{I[i, k]:.10g}" for i in range(3) for k in range(i, 3)}
    ElementTree.SubElement(element, "inertia", moments)
    return element


def payload_inertia(payload: Payload) -> pin.Inertia:
    """Return a payload as Pinocchio's inertia, in the link's axes."""
    return pin.Inertia(payload.mass, np.array(payload.com), inertia_matrix(payload))


def inertia_matrix(payload: Payload) -> np.ndarray:
    """Return a payload's (3, 3) inertia about its centre of mass, kg m^2, in the link's axes.

    0 where it has none: a point.
    """
    ixx, ixy, ixz, iyy, iyz, izz = payload.inertia or (0.0,) * 6
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


#: No payload is so many times as far from its link as the robot is long, or at least so far (m).
#: (The length ends at the last frame; what is beyond may be longer than all before it.)
_BEYOND, _LEAST_BEYOND = 3.0, 0.3


def length_of(model: pin.Model) -> float:
    """Return the longest way from the root along the origins of joints and links (m)."""
    far = np.zeros(model.njoints)
    for j in range(1, model.njoints):
        far[j] = far[model.parents[j]] + np.linalg.norm(model.jointPlacements[j].translation)
    ends = [far[f.parentJoint] + np.linalg.norm(f.placement.translation) for f in model.frames]
    return float(max(ends, default=0.0))


def plausible_distance(model: pin.Model) -> float:
    """Return how far from its link a payload may be (m); infinite if the robot has no length."""
    length = length_of(model)
    return max(_BEYOND * length, _LEAST_BEYOND) if length > 0.0 else np.inf


def link_frame(model: pin.Model, link: str) -> int:
    """Return the id of a link's body frame, also of a link fixed to another."""
    if not model.existFrame(link, pin.FrameType.BODY):
        links = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise RobotError(f"there is no link {link!r}; {choose_from(link, links)}")
    return int(model.getFrameId(link, pin.FrameType.BODY))


#: Parts of a model that users change, in the order of the message; the rest is its structure.
_CHANGEABLE = (
    "gravity",
    "inertias",
    "jointPlacements",
    "armature",
    "lowerPositionLimit",
    "upperPositionLimit",
    "velocityLimit",
    "effortLimit",
    "frames",
)


def changed_parts(model: pin.Model, other: pin.Model) -> list[str]:
    """Return the names of the parts that differ in two models: masses, placements, limits, ..."""

    def differs(name: str) -> bool:
        ours, theirs = getattr(model, name), getattr(other, name)
        if isinstance(ours, pin.Motion):
            return bool(ours != theirs)
        if isinstance(ours, np.ndarray):
            return not np.array_equal(ours, theirs, equal_nan=True)
        # Pinocchio's lists compare by identity, their elements by value
        return len(ours) != len(theirs) or any(a != b for a, b in zip(ours, theirs, strict=True))

    return [name for name in _CHANGEABLE if differs(name)]


def with_payloads(model: pin.Model, payloads: Mapping[str, Payload]) -> pin.Model:
    """Return a copy of the model that carries the payloads."""
    loaded = model.copy()
    for payload in payloads.values():
        frame = loaded.frames[link_frame(loaded, payload.link)]
        loaded.appendBodyToJoint(frame.parentJoint, payload_inertia(payload), frame.placement)
    return loaded


def mention_reductions(robot: Robot, where: str) -> None:
    """Warn about gears in the URDF: they have ratios but no losses, so they are not used."""
    gears = robot.gears
    if gears:
        ratios = ", ".join(f"{name} {ratio:g}" for name, ratio in list(gears.items())[:4])
        more = f" and {len(gears) - 4} more" if len(gears) > 4 else ""
        warnings.warn(
            f"{where}: the URDF's <transmission> gives reductions ({ratios}{more}), which are not "
            "used; to get motor torques, give ratio, losses and inertia in `actuators`",
            PinfricWarning,
            stacklevel=3,
        )
