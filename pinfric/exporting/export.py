"""`pf.export`: a scene for another engine, with the error of each constant."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinfric.dynamics.forward.compensation import check_compensated
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.random_states import random_states
from pinfric.dynamics.samples.states import MotionLike
from pinfric.errors import PinfricError, PinfricWarning, choose_from
from pinfric.exporting.actuator import ActuatorForm, actuator_forms, actuators
from pinfric.exporting.constants import JointConstants, joint_constants
from pinfric.exporting.controller import compensator, level_uncertainty
from pinfric.exporting.cpp import check_frames, default_frames, header_name
from pinfric.exporting.engines import shortfalls
from pinfric.exporting.mjcf import MjcfJoint, creep_velocity, mjcf, soft
from pinfric.exporting.ros2 import package, package_files
from pinfric.exporting.sdf import sdf
from pinfric.exporting.tree import bodies, check_plain_tree, rotor_inertias
from pinfric.exporting.urdf import urdf
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.described import INERTIA, SPEED, described, in_json, quantity, unit_at
from pinfric.model.effects import effects
from pinfric.model.files import check_writable, write_file, write_folder
from pinfric.model.floating import stands
from pinfric.model.mass_matrix import mass_matrices
from pinfric.model.massless import massless, massless_joints
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.spring_entries import Spring, TensionSpring, TorsionSpring
from pinfric.model.upward import Shown
from pinfric.model.urdf import implausible_body


@dataclass(frozen=True)
class Format:
    """Names of the constants in a format, and its remarks.

    Attributes:
        title: for people.
        terms: constant -> its name in the format; others are 0.
        suffix: of the file.
        at_rest: friction in its engine where a joint stands still, v = a = 0.
        write: makes the file's text of the scene, the constants, their lines and the heading; None:
            it is the header of a compensator, with files beside it in its folder.
        lacks: what it does not hold of any scene.
        models: whether it holds models of each joint, which `write` gets in place of the lines.
        given: what stands in place of friction. beside: where its errors stand.
        package: whether these are a package, whose folder holds nothing else.
    """

    title: str
    terms: dict[str, str]
    suffix: str
    at_rest: str
    write: Callable[..., str] | None = None
    lacks: tuple[str, ...] = ()
    models: bool = False
    given: str = "constants"
    beside: str = "each joint their error against the scene's torque while the joint moves"
    package: bool = False


#: Effects that no constant holds: what they are called here.
_LEFT_OUT = {
    "load": "friction that grows with a bearing's load",
    "static": "break-away friction above that in motion",
    "stribeck": "the fall of friction from rest to fast motion",
    "gear": "gear losses in proportion to the load",
}


@described
class Exported(Shown):
    """A scene in another engine's format, with the errors of its constants.

    Attributes:
        scene: name of its file.
        text: the file.
        beside: name -> text of further files.
        name: of the file without its suffix; empty: the scene's.
    """

    scene: str
    trajectory: str = quantity("name of its file")
    to: str = quantity("the format")
    samples: int = quantity("of the trajectory")
    joints: tuple[JointConstants, ...] = quantity(
        "the constants and their errors, in the model's order; for cpp, the errors that constants "
        "would make and the header does not"
    )
    left_out: tuple[str, ...] = quantity("parts of the scene that the file does not have")
    notes: tuple[str, ...] = quantity("what the constants were fitted with, and where they fail")
    text: str
    beside: Mapping[str, str] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = quantity(
        "drive -> relative uncertainty e of its friction, if known",
        default_factory=dict,
    )
    file: str = quantity("path of the written file; empty: not written yet", default="")
    forms: tuple[ActuatorForm, ...] = quantity(
        "of actuator: each joint's models and their errors, in the order of the joints", default=()
    )
    name: str = ""

    def __repr__(self) -> str:
        moved = [joint for joint in self.joints if joint.moving]
        errors = [f"{j.error_peak:.3g} of {j.torque_peak:.3g}" for j in moved]
        return screen(
            "Exported",
            f"{file_name(self.scene)} to {FORMATS[self.to].title}",
            {
                "trajectory": f"{file_name(self.trajectory)}, {counted(self.samples, 'sample')}",
                "errors": f"{listed([j.joint for j in moved], errors)} (peaks, N m or N)",
                "left out": "; ".join(self.left_out),
                "more": ".write(path) .summary() .text",
            },
        )

    @property
    def default_name(self) -> str:
        """Default name of the file."""
        return f"{self.name or Path(self.scene).stem}{FORMATS[self.to].suffix}"

    def write(self, path: str | Path) -> Path:
        """Write the file and its companions, each completely or not at all.

        Args:
            path: the file; of "cpp" and "ros2" the folder, as files include others by their names.

        Raises:
            PinfricError: it cannot be written, or a package's folder has other files.
        """
        if FORMATS[self.to].write is not None:
            return write_file(path, self.text)
        if FORMATS[self.to].package:
            _check_own(Path(path), [self.default_name, *self.beside])
        return write_folder(path, {self.default_name: self.text, **self.beside})[0]


def places(scene: Scene, to: str, out: Path | None = None, namespace: str = "") -> list[Path]:
    """Return where an export's files will stand, the main one first, or refuse the place.

    Args:
        out: the user's file or folder; None: here, of a package a folder of its name.

    Raises:
        PinfricError: no such format; a namespace that C++ does not allow; a place that cannot be
            written; for a package, a folder that has other files.
    """
    _check_format(to)
    form, suffix = FORMATS[to], FORMATS[to].suffix
    names = [f"{Path(scene.source).stem}{suffix}"]
    if form.write is None:
        called = header_name(scene.source, namespace)
        names = [f"{called}{suffix}", f"{called}_test.cpp"]
        names += package_files(called) if form.package else []
        out = Path(called.lower()) if out is None and form.package else out
    out = out or Path()
    if form.write is None or out.is_dir() or not (out.suffix or out.exists()):
        folder = out
    else:
        folder, names = out.parent, [out.name]
    check_writable(folder, names)
    if form.package:
        _check_own(folder, names)
    return [folder / name for name in names]


def _check_own(folder: Path, names: Sequence[str]) -> None:
    """Refuse a folder with files that are no package's; hidden ones, as of Git, are none."""
    others = sorted(p.name for p in folder.glob("[!.]*")) if folder.is_dir() else []
    if others := [name for name in others if name not in names]:
        raise PinfricError(
            f"{folder}: has {others[0]!r} in it, and a package needs a folder of its own; name "
            "another place (--out)"
        )


def _check_format(to: str) -> None:
    if to not in FORMATS:
        raise PinfricError(f"export: to {to!r}: {choose_from(to, FORMATS)}")


def export(
    scene: Scene,
    trajectory: MotionLike | None = None,
    to: str = "mjcf",
    *,
    frames: Sequence[str] = (),
    posterior: str | Path | None = None,
    namespace: str = "",
) -> Exported:
    """Return the scene for another engine: constants in place of friction, each with its error.

        r T_m - tau_id = frictionloss sign(v) + damping v + armature a,    all three >= 0

    by least squares over the samples in which the joint moves; see `joint_constants`.

    Args:
        scene: an open chain with drives at its joints.
        trajectory: or a simulated motion, with its payloads; None takes 1000 seeded random states
            inside the limits.
        to: "mjcf" (MuJoCo), "urdf" (`<dynamics>`), "sdf", "constants" (JSON, for any engine),
            "actuator" (JSON, models of friction that trainers run), "cpp"
            (a header for controllers, which uses the present load and needs no constants), "ros2"
            (the same header in a package of ROS 2, with a controller of ros2_control).
        frames: of "cpp" and "ros2", links for payloads and wrenches at run time; none: those that
            carry payloads and the last of each branch.
        posterior: of these, the table that `identify` wrote; None: `posterior.csv` beside the
            scene's file, if there is one.
        namespace: of these, the header's, and the name of its file; empty: pinfric_SCENE.

    Raises:
        PinfricError: no such format, or one that cannot hold a named part of the scene.
    """
    expect_scene(scene, "export")
    _check_format(to)
    form = FORMATS[to]
    if form.write is None:
        called = header_name(scene.source, namespace)
        return _with_header(scene, trajectory, to, frames, posterior, called)
    if frames or namespace or posterior is not None:
        raise PinfricError(
            f"export: frames, posterior and namespace are for 'cpp' and 'ros2' only, not for {to!r}"
        )
    columns = check_plain_tree(scene, free_base=to == "constants")
    result, name = _along(scene, trajectory)
    joints = joint_constants(result, columns, tuple(form.terms))
    left_out = (*_left_out(scene, to), *_builds_up(scene, to, joints))
    lines = {joint.joint: joint_line(joint, form) for joint in joints}
    notes, creep = _loads(scene, result), np.zeros(len(joints))
    if to == "mjcf":
        mobility = _mobility(scene, joints)
        notes += _soft(scene, result, joints, mobility)
        pairs = zip(joints, mobility, strict=True)
        creep = np.array([creep_velocity(joint.frictionloss, A) for joint, A in pairs])
    notes += shortfalls(to, joints, rotor_inertias(scene), creep)
    header = [
        f"{file_name(scene.source)} for {form.title}, written by pinfric.",
        f"Friction is given by {form.given}, fitted to the motor's torque times the ratio, less "
        f"that of the frictionless robot, over {file_name(name)} ({len(result.status)} samples); "
        f"beside {form.beside}.",
        *(f"Not in this file: {line}." for line in left_out),
        *(f"{line[0].upper()}{line[1:]}." for line in notes),
        f"While a joint rests the scene has a torque range, given at each joint: {form.at_rest}.",
    ]
    forms = actuator_forms(result, columns) if form.models else ()
    text = form.write(scene, joints, forms or lines, header)
    if to == "mjcf" and (held := massless_joints(scene)):
        warnings.warn(
            f"{scene.source}: {', '.join(held)} {'moves' if len(held) == 1 else 'move'} no mass: "
            "written without the joint, for MuJoCo refuses it; give the link an <inertial>",
            PinfricWarning,
            stacklevel=2,
        )
    samples = len(result.status)
    return Exported(scene.source, name, to, samples, joints, left_out, notes, text, forms=forms)


def _loads(scene: Scene, result: InverseResult) -> tuple[str, ...]:
    carried, samples, parts = result.states.attached, len(result.status), []
    for k, (name, payload) in enumerate(scene.payloads.items()):
        count = samples * payload.attached if carried is None else int(carried[:, k].sum())
        if count:
            often = "all samples" if count == samples else f"{count} of {samples} samples"
            parts.append(f"{name!r} ({payload.mass:g} kg at {payload.link}) in {often}")
    if not parts:
        return ()
    return (
        f"fitted with the payload {', '.join(parts)}; the stated errors hold for an engine whose "
        "robot carries the same in the same samples: without it there, its torque lacks the "
        "payload's own as well",
    )


def _mobility(scene: Scene, joints: Sequence[JointConstants]) -> np.ndarray:
    """(n,) diagonal of (M + armature)^-1 at q = 0; 0 where a joint moves no mass."""
    tree = [body for body in bodies(scene) if body.follows is None]
    mass = mass_matrices(scene.twin(), pin.neutral(scene.model)[None])[0]
    armature = [joint.armature + body.armature for joint, body in zip(joints, tree, strict=True)]
    held = massless(scene)  # the file does not have these joints
    inverse = np.linalg.inv(mass + np.diag(np.where(held, 1.0, armature)))
    return np.where(held, 0.0, np.diag(inverse))


def _soft(
    scene: Scene, result: InverseResult, joints: Sequence[JointConstants], mobility: np.ndarray
) -> tuple[str, ...]:
    """Count samples in which MuJoCo's friction is not whole and errs by more than is stated."""
    tree, parts = [body for body in bodies(scene) if body.follows is None], []
    for joint, body, A in zip(joints, tree, mobility, strict=True):
        v, a = (x[:, body.joint.index_v] for x in (result.states.v, result.states.a))
        near = soft(v, a, joint.frictionloss, A) & (np.abs(v) > 0.0)
        if near.any():
            parts.append(f"{joint.joint} {counted(int(near.sum()), 'sample')}")
    where = f" ({', '.join(parts)} of this motion)" if parts else ""
    return (
        "near rest MuJoCo's friction is soft and follows a + 1000 v, not v: where v and a have "
        "opposite signs and |v| < |a| / 1000, or where |a + 1000 v| < 0.001 frictionloss "
        "(M^-1)_jj, mj_inverse misses by up to twice the frictionloss more than is stated"
        f"{where}",
    )


def _along(scene: Scene, trajectory: MotionLike | None) -> tuple[InverseResult, str]:
    """Inverse dynamics along a motion or of random states, and its name."""
    if trajectory is None:
        if stands(scene):
            raise PinfricError(
                f"{scene.source}: export: forces at the feet hold this robot: give a motion that "
                "has them (--trajectory)"
            )
        q, v, a = random_states(scene)
        result = inverse_dynamics(scene, q, v, a)
        return result, f"{len(q)} random states inside the limits"
    result = inverse_dynamics(scene.without_presliding, trajectory)  # no engine lets it build up
    return result, str(getattr(trajectory, "source", "a simulated motion"))


def _with_header(
    scene: Scene,
    trajectory: MotionLike | None,
    to: str,
    frames: Sequence[str],
    posterior: str | Path | None,
    called: str,
) -> Exported:
    """Return a compensator, with the constants that a controller would have without it."""
    check_compensated(scene)
    check_frames(scene, frames)
    if scene.springs:
        raise PinfricError(
            f"{scene.source}: springs: the header's rigid body has no {scene.springs[0].name!r}; "
            "leave `springs` out and add their torques yourself, or call scene.solver()"
        )
    coupled = any(drive.couples for drive in scene.drives)  # no joint has constants of its own
    columns = () if coupled and not FORMATS[to].package else check_plain_tree(scene)
    result, name = _along(scene, trajectory)
    joints = joint_constants(result, columns, tuple(FORMATS[to].terms))
    unknown = level_uncertainty(scene, result, posterior)
    files = compensator(scene, result, frames, unknown, called)
    beside = {f"{called}_test.cpp": files.test}
    if FORMATS[to].package:
        beside |= package(scene, files, tuple(frames) or default_frames(scene), called)
    samples = len(result.status)
    compensator_files = files.header, beside, unknown
    return Exported(
        scene.source, name, to, samples, joints, (), (), *compensator_files, name=called
    )


def _mjcf(
    scene: Scene, joints: Sequence[JointConstants], lines: dict[str, str], header: Sequence[str]
) -> str:
    tree = bodies(scene)
    for body in tree:
        if why := implausible_body(body.inertia.mass, body.inertia.inertia):
            raise PinfricError(
                f"{scene.source}: joint {body.joint.name!r} moves a body that MuJoCo refuses: "
                f"{why}; correct the <inertia> of its links"
            )
    by_name = {joint.joint: joint for joint in joints}
    entries, held = [], massless_joints(scene)  # MuJoCo refuses bodies that move without mass
    for body in tree:
        if (body.joint.name if body.follows is None else body.follows[0]) in held:
            said = f"the joint {body.joint.name} moves no mass and is left out: the body is fixed"
            entries.append(MjcfJoint(0.0, 0.0, 0.0, comment=said, fixed=True))
            continue
        if body.follows is not None:
            leader, ratio, shift = body.follows
            said = f"{body.joint.name} = {ratio:g} {leader} {shift:+g}, its friction is {leader}'s"
            entries.append(MjcfJoint(0.0, 0.0, 0.0, comment=said))
            continue
        joint = by_name[body.joint.name]
        armature = joint.armature + body.armature
        constants = joint.frictionloss, joint.damping, armature, joint.ratio
        entries.append(MjcfJoint(*constants, lines[joint.joint]))
    name = Path(scene.source).stem
    springs = scene.twin().springs
    return mjcf(name, tree, entries, scene.model.gravity.linear, comment=header, springs=springs)


def _constants(
    scene: Scene, joints: Sequence[JointConstants], lines: dict[str, str], header: Sequence[str]
) -> str:
    model, terms = scene.model, FORMATS["constants"].terms
    rows = []
    for joint in joints:
        row = {
            "joint": joint.joint,
            "unit": joint.unit,
            **{label: getattr(joint, term) for term, label in terms.items()},
            "error_rms": joint.error_rms,
            "error_peak": joint.error_peak,
            "at_rest": [joint.rest_lower, joint.rest_upper],
            "load": list(joint.loads),
            "speed": list(joint.speeds),
            "about": lines[joint.joint],
        }
        row["armature"] += float(model.armature[model.joints[model.getJointId(joint.joint)].idx_v])
        rows.append(row)
    content = {"pinfric_constants": 1, "about": list(header), "joints": rows}
    return json.dumps(in_json(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def joint_line(joint: JointConstants, form: Format) -> str:
    """Return a joint's line in the file: constants, their error, torque range at rest."""
    unit, name = joint.unit, joint.joint
    at_rest = ""
    if np.isfinite(joint.rest_lower):
        at_rest = f"; standing still {joint.rest_lower:.3g} to {joint.rest_upper:.3g} {unit}"
    if not joint.moving:
        return f"{name}: cannot move and has no constants{at_rest}"
    known = ""
    if joint.unmoved:
        name = f"{name} (never moves in this motion: constants of random states)"
        if "armature" in form.terms:
            known = (
                f"; the armature is ratio^2 times the rotor inertia, fitting it instead leaves an "
                f"rms of {joint.fitted_rms:.5g} {unit}"
            )
    units = {
        "frictionloss": unit,
        "damping": unit_at("N m s/rad or N s/m", unit),
        "armature": unit_at(INERTIA, unit),
    }
    constants = ", ".join(
        f"{label} {getattr(joint, term):.4g} {units[term]}" for term, label in form.terms.items()
    )
    at = f"t {joint.worst_time:.4g} s, " if np.isfinite(joint.worst_time) else ""
    load = joint.worst_load if abs(joint.worst_load) > 1e-9 * joint.torque_peak else 0.0
    doubt = "" if joint.apart else "; the motion does not determine each of these constants"
    return (
        f"{name}: {constants}; error rms {joint.error_rms:.5g}, peak {joint.error_peak:.5g} {unit} "
        f"(at {at}load {load:.3g} {unit}, {joint.worst_speed:.3g} "
        f"{unit_at(SPEED, unit)}) of a torque of rms {joint.torque_rms:.4g}, peak "
        f"{joint.torque_peak:.4g} {unit}, {counted(joint.moving, 'moving sample')}{at_rest}{known}"
        f"{doubt}"
    )


def _holds_spring(to: str, spring: Spring) -> bool:
    """Whether a format holds a spring exactly, by a stiffness and a place without force."""
    if isinstance(spring, TensionSpring):
        return to == "mjcf" and not spring.initial_tension
    return isinstance(spring, TorsionSpring) and spring.stiffness > 0.0 and to in ("mjcf", "sdf")


def _builds_up(scene: Scene, to: str, joints: Sequence[JointConstants]) -> Iterator[str]:
    """Say of each joint that its friction builds up, and with what MuJoCo can imitate it."""
    if scene.ways is None:
        return
    ways = scene.ways.way[scene.ways.of_drive]
    for drive, way in zip(scene.drives, ways.tolist(), strict=True):
        if not way > 0.0:
            continue
        lugre = ""
        for joint in joints if to in ("mjcf", "constants") else ():
            if joint.joint == drive.name and joint.frictionloss > 0.0:
                size = joint.frictionloss
                lugre = (
                    '; MuJoCo has `dcmotor` with input="none", motorconst="0", resistance="1" and '
                    f'lugre="{size / way:.6g} 0 {size:.6g} {size:.6g} 0" in place of the '
                    "frictionloss: LuGre's law with the same loops at the loads of these constants "
                    "and away from rest, but what it holds creeps under a load that swings"
                )
        yield (
            f"that the friction of {drive.name} builds up over {way:g} rad or m after a reversal: "
            f"it acts at once{lugre}"
        )


def _left_out(scene: Scene, to: str) -> tuple[str, ...]:
    """Name what the file lacks of the scene, with the key of the first place."""
    lines = [
        f"{_LEFT_OUT[effect.name]} ({effect.why})"
        for effect in effects(scene)
        if effect.on and effect.name in _LEFT_OUT and not FORMATS[to].models
    ]
    for name, friction in scene.friction.items():
        lines += [
            f"the direction of friction.{name}.{key}: one constant for both directions"
            for key, term in friction.named_terms.items()
            if term.directed
        ]
    for key in ("stiffness", "hysteresis"):
        if soft := [d.name for d in scene.drives if getattr(d.transmission, key, None) is not None]:
            lines.append(f"the {key} of the gear of {', '.join(soft)}: the joint is rigid there")
    for name, payload in scene.payloads.items():
        if not payload.attached and to in ("mjcf", "urdf", "sdf"):
            lines.append(
                f"the payload {name!r} ({payload.mass:g} kg at {payload.link}), which the "
                "scene does not carry by default"
            )
    lines += [
        f"the {spring.kind} {spring.name!r} (springs[{i}]): add its forces, without which the "
        "robot needs other torques"
        for i, spring in enumerate(scene.springs)
        if not _holds_spring(to, spring)
    ]
    if to == "mjcf" and (held := massless_joints(scene)):
        lines.append(
            f"the joints {', '.join(held)}, which move no mass, as MuJoCo refuses: their bodies "
            "are fixed where the joints stand at 0"
        )
    lines += FORMATS[to].lacks
    gravity = scene.model.gravity.linear
    if to in ("urdf", "sdf") and not np.allclose(gravity, [0.0, 0.0, -9.81]):
        lines.append(f"gravity, {gravity.tolist()} m/s^2")
    return tuple(lines)


#: Name of each format, in the order in which they are listed.
FORMATS = {
    "mjcf": Format(
        "MJCF (MuJoCo)",
        {"frictionloss": "frictionloss", "damping": "damping", "armature": "armature"},
        ".mjcf.xml",
        "mj_inverse has no friction there, mj_step holds with up to frictionloss",
        _mjcf,
        ("meshes (capsules stand for the links) and speed limits",),
    ),
    "urdf": Format(
        "URDF",
        {"frictionloss": "friction", "damping": "damping"},
        ".constants.urdf",
        "engines that read <dynamics> hold with up to `friction`, or not at all",
        urdf,
    ),
    "sdf": Format(
        "SDF (Gazebo, Drake)",
        {"frictionloss": "friction", "damping": "damping"},
        ".sdf",
        "Gazebo holds with up to `friction`, Drake does not hold",
        sdf,
        ("meshes and shapes",),
    ),
    "constants": Format(
        "constants (JSON)",
        {"frictionloss": "dry", "damping": "viscous", "armature": "armature"},
        ".constants.json",
        "an engine with dry friction holds with up to `dry`",
        _constants,
        ("links, masses and geometry: the file only has constants for a robot that you load",),
    ),
    "actuator": Format(
        "actuator models (JSON; M1 to M6 of BAM)",
        {"frictionloss": "frictionloss", "damping": "damping", "armature": "armature"},
        ".actuator.json",
        "an engine holds with up to the model's budget, of constants with up to `frictionloss`",
        actuators,
        ("links, masses and geometry: the file only has models for a robot that you load",),
        models=True,
        given="models of each joint",
        beside="each model its errors against the scene's friction in that motion, at "
        "accelerations up to the motors' limits (pushed) and at break-away (rest); `take` names "
        "the simplest whose three errors, as one RMS, are below 5 % of the friction or 1.1 times "
        "the least of any model",
    ),
    "cpp": Format(
        "C++ (a compensator that knows the load)",
        {"frictionloss": "Coulomb", "damping": "viscous", "armature": "rotor inertia"},
        ".hpp",
        "within its speed band the compensator moves from one end to the other",
    ),
}
FORMATS["ros2"] = replace(
    FORMATS["cpp"], title="ROS 2 (a controller that knows the load)", package=True
)
