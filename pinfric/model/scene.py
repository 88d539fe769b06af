"""A scene: a robot, the friction in its joints, its drives and its payloads."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

import numpy as np
import pinocchio as pin

from pinfric.errors import PinfricWarning, RobotError, SceneError, choose_from, cut
from pinfric.model.alignment import align_axes, shift_frames
from pinfric.model.arrays import real_numbers
from pinfric.model.bearings import Contacts, Gear, contacts
from pinfric.model.brief import counted, file_name, listed, screen
from pinfric.model.closure import close, velocity_indices, velocity_names
from pinfric.model.coordinates import from_angles
from pinfric.model.couples import check_couples, taking_part
from pinfric.model.drives import Drive, Gears, gear_table
from pinfric.model.entry import parse
from pinfric.model.floating import free_joint
from pinfric.model.laws import FrictionLaw, Laws, checked_law, friction_law, law_table
from pinfric.model.loops import (
    Linkage,
    check_bearing,
    make_linkage,
    rubs,
    slides,
)
from pinfric.model.magnitudes import LARGEST
from pinfric.model.mobility import Mobility, mobility_of_linkage, mobility_of_tree
from pinfric.model.presliding import Ways, refuse_presliding, ways_of
from pinfric.model.robot import (
    Robot,
    changed_parts,
    check_kinetic_energy,
    inertia_matrix,
    link_frame,
    with_payloads,
)
from pinfric.model.schema import (
    OTHERS,
    Actuator,
    Assumed,
    Foot,
    Friction,
    Loop,
    LoopTolerance,
    MassesHold,
    Measured,
    Payload,
    Simulation,
    Sized,
    Stops,
    guesses_left,
)
from pinfric.model.spring_entries import LineSpring, Spring, SpringList
from pinfric.model.spring_forces import make_springs
from pinfric.model.twin import PRISMATIC, Twin, make_twin
from pinfric.model.upward import find, make_solver
from pinfric.model.urdf import implausible_body

if TYPE_CHECKING:
    from pinfric.model.upward import Finding, Solver

#: m/s^2; ten times that of the largest planet, above which it is in mm/s^2.
_LARGEST_GRAVITY = 250.0
#: Fields that are mappings; their read-only views cannot be pickled.
_MAPPINGS = ("friction", "payloads", "feet")
_COMPONENT_NAMES = ("vx", "vy", "vz", "wx", "wy", "wz")


@dataclass(frozen=True)
class Site:
    """A place with friction: a one-degree joint, the joint that closes a loop, or a cylinder.

    Attributes:
        joint: its row in the twin; rows of loops, then of cylinders, follow those of the tree.
        sliding: True for a prismatic joint or a cylinder (friction in N), else False (N m).
        velocity_index, ratio: its velocity is ratio * v[velocity_index] (ratio 1 except for mimic
            joints); -1 for a loop's joint and for a cylinder.
        axis: (3,) unit joint axis in the child's frame (a loop: in frame b; a cylinder: z).
        law, friction: the law of the scene's entry, and the entry.
        pair: row among the pairs of the linkage; -1 for a joint of the tree.
        ball: True for a spherical loop joint, whose friction opposes a relative angular velocity.
    """

    name: str
    joint: int
    sliding: bool
    velocity_index: int
    ratio: float
    axis: np.ndarray
    law: FrictionLaw
    friction: Friction
    pair: int = -1
    ball: bool = False


class SiteTables(NamedTuple):
    """All sites as arrays for the kernels, one row per site."""

    joint: np.ndarray
    axis: np.ndarray
    contacts: Contacts
    laws: Laws
    velocity_index: np.ndarray
    ratio: np.ndarray


def payload_names(attached: Iterable[str] | None) -> tuple[str, ...] | None:
    """Return the names of the payloads carried, given as one name or several, as a tuple.

    None, the payloads attached by default, stays None.
    """
    if attached is None:
        return None
    return (attached,) if isinstance(attached, str) else tuple(attached)


def expect_scene(scene: object, where: str) -> None:
    """Refuse anything that is not a `Scene`, such as a file's name.

    Raises:
        SceneError: names `where`, the function called, and says how to make a scene.
    """
    if not isinstance(scene, Scene):
        how = "the result of pf.load_scene"
        if isinstance(scene, str | os.PathLike):
            how = f"pf.load_scene({str(scene)!r})"
        raise SceneError(f"{where}: scene is a {type(scene).__name__}, not a Scene; give {how}")


@dataclass(frozen=True)
class Scene:
    """A robot with friction in its joints: the immutable input of all dynamics.

    `with_` returns a changed scene. A change of `scene.model` itself is refused at the next use,
    because derived quantities are computed once (`check_unchanged`).

    Args:
        model: Pinocchio's model, without the payloads; copied.
        friction: joint name -> friction, as `Friction` or as the mapping of a scene file.
        actuators: the drives; None is one ideal drive per joint. The columns of efforts are in the
            order of `actuator_names`, which may differ from that of this list.
        payloads: name -> payload; those with `attached` are carried unless a trajectory differs.
        stick_velocity: default of all sites (rad/s or m/s).
        robot: the URDF as read; None for a model made in Python.
        simulation: input of `pinfric simulate`.
        source: the file's name, for messages.
        loops: joints that close loops, as `Loop` or as the mappings of a scene file.
        redundancy_length: l (m): where reactions are not unique, the sum over all joints of |F|^2 +
            |M/l|^2 is minimized.
        loop_tolerance: largest errors of axes and frames of loops that are corrected (`alignment`).
        tool: link whose frame is the tool's, for its position error due to elastic gears.
        masses: "with_drives" or "without_drives": whether the links' masses hold the drives; or by
            drive, and for `others`; None: not known.
        masses_confirmed: whether its owner confirms the robot's mass where it is doubted.
        assumed: which entries are guesses.
        measured: where its friction was measured; other friction in `with_` drops it.
        stops: input of `pinfric stop`.
        sized: the masses for which its drives were chosen; other masses in `with_` keep it.
        closed_brakes: drive -> torque (N m) of a closed brake at its motor's shaft: dry friction
            there, in forward dynamics with torques of motors given.
        springs: springs and hoses, as `Spring` or as the mappings of a scene file.
        feet: link -> foot on which a robot with a free base stands, as `Foot` or as mappings.
        start: near which the loops close: joint -> position (rad or m), 0 for those left out, or an
            array (nq,); None: that of `simulation`.

    Attributes:
        mobility: degrees of freedom, undriven velocities and redundant drives.

    Raises:
        SceneError: an impossible entry, or one that names an unknown joint or link.
    """

    model: pin.Model
    friction: Mapping[str, Friction] = field(default_factory=dict)
    actuators: Sequence[Actuator] | None = None
    payloads: Mapping[str, Payload] = field(default_factory=dict)
    stick_velocity: float = 1e-6
    robot: Robot | None = None
    simulation: Simulation | None = None
    source: str = "scene"
    loops: Sequence[Loop] = ()
    redundancy_length: float = 0.1
    loop_tolerance: LoopTolerance = field(default_factory=LoopTolerance)
    tool: str | None = None
    masses: str | Mapping[str, str] | None = None
    masses_confirmed: bool = False
    assumed: Assumed | None = None
    measured: Measured | None = None
    stops: Stops | None = None
    sized: Sized | None = None
    closed_brakes: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] | Sequence[float] | None = None
    springs: Sequence[Spring] = ()
    feet: Mapping[str, Foot] = field(default_factory=dict)
    mobility: Mobility = field(init=False, repr=False)

    def __post_init__(self) -> None:
        def entries(kind: type[Any], section: str, mapping: Mapping[str, Any]) -> dict[str, Any]:
            at = tuple(section.split("."))
            if not isinstance(mapping, Mapping):
                raise SceneError(
                    f"{self.source}: {section} is a {type(mapping).__name__}; should be a mapping "
                    "of names"
                )
            return {
                name: parse(kind, entry, self.source, at=(*at, name))
                for name, entry in mapping.items()
            }

        if not isinstance(self.model, pin.Model):
            given = f" ({self.model!r})" if isinstance(self.model, str | os.PathLike) else ""
            raise SceneError(
                f"{self.source}: model is a {type(self.model).__name__}{given}; should be a "
                "pin.Model; for a URDF, `pinfric new URDF` writes a scene file that pf.load_scene "
                "reads"
            )
        set_ = object.__setattr__  # the one way to normalize a frozen dataclass's own fields
        set_(self, "model", self.model.copy())  # later changes of the caller's model have no effect
        friction = entries(Friction, "friction", self.friction)
        set_(self, "friction", MappingProxyType(friction))
        payloads = entries(Payload, "robot.payloads", self.payloads)
        set_(self, "payloads", MappingProxyType(payloads))
        set_(self, "feet", MappingProxyType(entries(Foot, "feet", self.feet)))
        if self.actuators is not None:
            listed = enumerate(self.actuators)
            drives = [parse(Actuator, x, self.source, at=("actuators", i)) for i, x in listed]
            set_(self, "actuators", tuple(drives))
        loops = [parse(Loop, x, self.source, at=("loops", i)) for i, x in enumerate(self.loops)]
        set_(self, "loops", tuple(loops))
        springs = parse(SpringList, {"springs": list(self.springs)}, self.source).springs
        set_(self, "springs", tuple(springs))
        kinds: dict[str, type[Any]] = {
            "loop_tolerance": LoopTolerance,
            "measured": Measured,
            "simulation": Simulation,
            "sized": Sized,
            "stops": Stops,
        }
        for name, kind in kinds.items():
            if (entry := getattr(self, name)) is not None:
                set_(self, name, parse(kind, entry, self.source, at=(name,)))
        self._check_gravity()
        self._check_start()
        self._check_bodies()
        self._check_payloads()
        self._check_tool()
        self._check_feet()
        doubts = self._align() if self.loops else {}
        # errors are raised now, not at first use
        _ = self._made_of, self.linkage, self.sites, self.drives, self.ways, self.twin()
        self._check_brakes()
        self._check_gears()
        self._check_masses()
        set_(self, "mobility", self._mobility(doubts))
        self._mention_driven_base()
        self._mention_unused()

    def _check_gravity(self) -> None:
        linear = self.model.gravity.linear
        if not np.linalg.norm(linear) <= _LARGEST_GRAVITY:
            raise SceneError(
                f"{self.source}: robot.gravity: should be at most {_LARGEST_GRAVITY:g} m/s^2, "
                f"found {linear.tolist()}; check the unit"
            )

    def _check_start(self) -> None:
        if self.start is None:
            return
        where = f"{self.source}: start"
        if not isinstance(self.start, Mapping):
            q = real_numbers(where, self.start, SceneError)
            if q.shape != (self.model.nq,) or not np.isfinite(q).all():
                raise SceneError(
                    f"{where}: should be a mapping joint -> position, or {self.model.nq} finite "
                    f"numbers (nq), found shape {q.shape}"
                )
            object.__setattr__(self, "start", tuple(q.tolist()))
            return
        for name, position in self.start.items():
            if name not in self.joint_names:
                raise SceneError(
                    f"{where}: there is no joint {name!r}; {choose_from(name, self.joint_names)}"
                )
            if np.shape(real_numbers(f"{where}.{name}", position, SceneError)) != ():
                raise SceneError(f"{where}.{name}: should be one number (rad or m)")
        object.__setattr__(self, "start", dict(self.start))

    def _mention_driven_base(self) -> None:
        """Warn that a floating base is driven if `actuators` are left out."""
        if self.actuators is not None:
            return
        for name, joint in zip(self.joint_names, tuple(self.model.joints)[1:], strict=True):
            if joint.shortname() == "JointModelFreeFlyer":
                text = (
                    f"{self.source}: without `actuators` the floating base {name!r} gets six ideal "
                    "drives; if nothing drives it, give actuators=[{'joint': name} for name in "
                    f"model.names[1:] if name != {name!r}]"
                )
                # of one place: Python's filter shows it once, not at every `with_`
                warnings.warn(text, PinfricWarning, stacklevel=1)

    def _mention_unused(self) -> None:
        """Warn of friction in the model, which does not count, and of rotors that count twice."""
        model, names, rubbing = self.model, velocity_names(self.model), set(self.friction)
        dry = np.abs([model.lowerDryFrictionLimit, model.upperDryFrictionLimit]).max(axis=0)
        values = zip(names, dry.tolist(), np.abs(model.damping).tolist(), strict=True)
        unused = {n: at for n, *at in values if max(at) > 0.0 and n not in rubbing}
        more = f" and {len(unused) - 4} more" if len(unused) > 4 else ""
        said = []
        if unused and self.robot is None:  # of a URDF `load_scene` says it
            laws = {
                n: {key: x for key, x in zip(("coulomb", "viscous"), at, strict=True) if x > 0.0}
                for n, at in unused.items()
                if n in model.names  # not of a ball or a floating base: they have no such friction
            }
            first = ", ".join(f"{n!r}: {law}" for n, law in list(laws.items())[:4])
            rest = ", ..." if len(laws) > 4 else ""
            count = f"give friction={{{first}{rest}}} if they should; " if laws else ""
            said.append(
                f"model.damping and model.friction of {', '.join(list(unused)[:4])}{more} do not "
                f"count: {count}set them to 0 if not"
            )
        for drive in self.drives:
            gear, v = drive.transmission, drive.velocity_index
            rotor = 0.0 if gear is None else gear.ratio**2 * gear.rotor_inertia
            if v >= 0 and rotor > 0.0 < model.armature[v]:
                said.append(
                    f"both the rotor of {drive.name!r} ({rotor:.3g} kg m^2 or kg at the joint) and "
                    f"model.armature ({model.armature[v]:.3g}) count, "
                    f"{rotor + model.armature[v]:.3g} together: if they are one rotor, set "
                    f"model.armature[{v}] to 0 or leave out rotor_inertia"
                )
        for text in said:  # of one place: Python's filter shows each once, not at every `with_`
            warnings.warn(f"{self.source}: {text}", PinfricWarning, stacklevel=1)

    def _mobility(self, doubts: Mapping[str, str]) -> Mobility:
        if self.linkage is None:
            return mobility_of_tree(self.model.nv, self.drives)
        mobility = mobility_of_linkage(
            self.twin(), self.linkage, self.drives, self.start_configuration, self.source, doubts
        )
        for d in set(taking_part(self.drives)).intersection(mobility.redundant):
            raise SceneError(
                f"{self.source}: actuators: {self.drives[d].name!r} is coupled, and "
                f"redundant: {mobility.counts(len(self.drives))}"
            )
        return mobility

    def _align(self) -> dict[str, str]:
        """Correct rounded axes and frames of loops, warn of it, and return the doubtful axes."""
        aligned = align_axes(self.model, self.loops, self.loop_tolerance, self.source)
        object.__setattr__(self, "model", aligned.model)
        object.__setattr__(self, "loops", aligned.loops)
        twin, linkage = self.twin(), make_linkage(self.model, self.loops, (), {}, self.source)
        loops, shift = shift_frames(twin, linkage, self.start_configuration, self.loop_tolerance)
        object.__setattr__(self, "loops", loops)
        said = []
        if turned := aligned.turned:
            said.append(
                f"{cut(', '.join(turned), 200)} turned by up to {max(turned.values()):.2g} "
                "rad: axes on one link are now parallel or perpendicular "
                "(loop_tolerance.angle)"
            )
        if shift > 1e-9 * linkage.size:
            said.append(f"frames b shifted by up to {shift:.2g} m (loop_tolerance.length)")
        if said:
            text = f"{self.source}: rounding corrected so that loops close: {'; '.join(said)}"
            warnings.warn(text, PinfricWarning, stacklevel=4)
        return aligned.doubts

    def with_(self, *, gravity: Any = None, **changes: Any) -> Scene:
        """Return a changed scene, which is checked again; this one stays unchanged.

        Args:
            gravity: (3,) m/s^2, in the world's axes.
            changes: arguments of `Scene` (`friction`, `payloads`, `actuators`, `stick_velocity`,
                `model` ...), each of which replaces the scene's own completely. A guess whose value
                `friction` replaces is no longer in `assumed`.

        Raises:
            SceneError: an unknown argument, or an impossible entry.
        """
        self.check_unchanged()
        names = [entry.name for entry in fields(self) if entry.init]
        for name in changes:
            if name not in names:
                raise SceneError(
                    f"{self.source}: with_: there is no {name!r}; "
                    f"{choose_from(name, ['gravity', *names])}"
                )
        if gravity is not None:
            where = f"{self.source}: with_: gravity"
            linear = real_numbers(where, gravity, SceneError)
            if linear.shape != (3,) or not np.isfinite(linear).all():
                raise SceneError(f"{where}: should be three finite numbers; e.g. [0, 0, -9.81]")
            changes["model"] = changes.get("model", self.model).copy()
            changes["model"].gravity.linear = linear
        try:
            changed = replace(self, **changes)
        except SceneError as problem:  # not the file is wrong, but what was given
            wrong = str(problem).removeprefix(f"{self.source}: ")
            raise SceneError(f"with_ of {file_name(self.source)}: {wrong}") from None
        if "friction" not in changes:
            return changed
        updates: dict[str, Any] = {}
        if self.assumed is not None and "assumed" not in changes:
            updates["assumed"] = guesses_left(self.assumed, self.friction, changed.friction)
        if self.measured is not None and "measured" not in changes:
            updates["measured"] = self.measured if changed.friction == self.friction else None
        return replace(changed, **updates) if updates else changed

    def with_coefficients(self, friction: Mapping[str, Friction]) -> Scene | None:
        """Return the scene with other coefficients of some joints' friction, sharing all else.

        None if a loop, or another bearing or joint, would need more than new laws.
        """
        known = {site.name: site for site in self.sites}
        if self.linkage is not None or any(
            name not in known or entry.bearing != known[name].friction.bearing
            for name, entry in friction.items()
        ):
            return None
        for name, entry in friction.items():
            law = friction_law(entry, self.stick_velocity)
            known[name] = replace(known[name], law=law, friction=entry)
        entries, sites = {**self.friction, **friction}, tuple(known.values())
        assumed = self.assumed and guesses_left(self.assumed, self.friction, entries)
        tables = self.site_tables._replace(laws=law_table([site.law for site in sites]))
        changed: dict[str, Any] = {
            "friction": MappingProxyType(entries),
            "assumed": assumed,
            "measured": None,
            "sites": sites,
            "site_tables": tables,
        }
        variant = object.__new__(type(self))
        variant.__dict__.update(self.__dict__ | changed)
        for found in ("findings", "quick_findings", "ways", "without_presliding"):
            variant.__dict__.pop(found, None)
        if "_gears" in variant.__dict__:  # of friction they have the stick velocities alone
            stick = np.array([variant.stick_velocity_of(drive) for drive in self.drives])
            both = tuple(gears._replace(stick_velocity=stick) for gears in self._gears)
            variant.__dict__["_gears"] = both
        return variant

    def solver(self, attached: Iterable[str] | None = None) -> Solver:
        """Return a solver for one state at a time, for controllers and optimizers; see `Solver`.

        Args:
            attached: names of the payloads carried; None takes those attached by default.

        Raises:
            SceneError: there is no such payload.
        """
        return make_solver(self, attached)

    def check_unchanged(self) -> None:
        """Refuse a changed `scene.model`: derived quantities were computed from the old one.

        Raises:
            SceneError: names the changed parts, and how to make a changed scene.
        """
        made_of = self._made_of
        if self.model == made_of:
            return
        what = changed_parts(self.model, made_of)
        if not what and self.model != self.model.copy():
            return  # it contains NaN, perhaps as a limit, and so never compares equal
        how = "model = scene.model.copy(), change that, scene.with_(model=model)"
        if what == ["gravity"]:
            how = f"scene.with_(gravity={self.model.gravity.linear.tolist()})"
        raise SceneError(
            f"{self.source}: scene.model was changed ({', '.join(what) or 'its structure'}) after "
            f"the scene was made, but computed quantities are of the old one; make another: {how}"
        )

    @cached_property
    def _made_of(self) -> pin.Model:
        """The model as it was given."""
        return self.model.copy()

    def __hash__(self) -> int:  # equal scenes have equal ones; mappings and models have none
        return hash((self.source, self.joint_names, frozenset(self.friction), self.stick_velocity))

    def __repr__(self) -> str:
        model, joints = self.model, self.joint_names
        mass = sum(inertia.mass for inertia in tuple(model.inertias)[1:])  # 0 is the ground
        title = (
            f"{file_name(self.source)}: {counted(len(joints), 'joint')}, {mass:.4g} kg that move"
        )
        geared = sum(drive.transmission is not None for drive in self.drives)
        none = [velocity_names(model)[v] for v in self.mobility.undriven]

        drive_names = [actuator.drive_name for actuator in self.actuators or ()]
        reordered = bool(drive_names) and drive_names != list(self.actuator_names)

        def among(names: Sequence[str]) -> str:
            return "at every joint" if tuple(names) == joints else listed(names)

        return screen(
            "Scene",
            title,
            {
                "joints": listed(joints),
                "friction": among(self.site_names) or "none",
                "drives": among(self.actuator_names)
                + ", in the model's order" * reordered
                + f"; {geared} with a transmission" * bool(geared),
                "undriven": listed(none),
                "payloads": listed(
                    list(self.payloads),
                    [f"{payload.mass:.4g} kg" for payload in self.payloads.values()],
                ),
                "loops": listed([loop.name for loop in self.loops]),
                "measured": self.measured.summary() if self.measured else "",
                "gravity": ", ".join(f"{x:.4g}" for x in model.gravity.linear) + " m/s^2",
                "stick": f"{self.stick_velocity:g} rad/s or m/s",
            },
        )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of all joints in the model's order, without the universe."""
        return tuple(self.model.names)[1:]

    @property
    def site_names(self) -> tuple[str, ...]:
        """Names of the places with friction, in the model's order, then the loops', cylinders'."""
        return tuple(site.name for site in self.sites)

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """Names of the drives: the columns of every effort.

        They are in the order of the model's joints; with loops or drives off the joints, in that of
        the list of actuators.
        """
        return tuple(drive.name for drive in self.drives)

    @cached_property
    def sites(self) -> tuple[Site, ...]:
        """The places with friction, in the order of `site_names`."""
        twin, names = self.twin(), self.joint_names
        loops = tuple(loop.name for loop in self.loops)
        cylinders = {} if self.linkage is None else self.linkage.cylinders
        for name in self.friction:
            if name not in (*names, *loops, *cylinders):
                lines = [s.name for s in self.springs if isinstance(s, LineSpring)]
                known = *names, *loops, *cylinders, *lines
                raise SceneError(
                    f"{self.source}: friction: there is no joint {name!r}; "
                    f"{choose_from(name, known)}"
                )
        return (
            *(
                self._site(name, row, twin)
                for row, name in enumerate(names)
                if name in self.friction
            ),
            *(
                self._pair_site(loop.name, row, loop.axis, slides(loop), loop.kind == "spherical")
                for row, loop in enumerate(self.loops)
                if loop.name in self.friction
            ),
            *(
                self._pair_site(name, row, (0.0, 0.0, 1.0), sliding=True)
                for name, row in cylinders.items()
                if name in self.friction
            ),
        )

    @cached_property
    def linkage(self) -> Linkage | None:
        """Loops, drives off the joints and springs with friction as arrays; None without any."""
        actuators = self.actuators or ()
        rubbing = any(rubs(spring, self.friction) for spring in self.springs)
        if not self.loops and all(a.joint is not None for a in actuators) and not rubbing:
            return None
        return make_linkage(
            self.model, self.loops, actuators, self.friction, self.source, self.springs
        )

    @property
    def closed_by(self) -> str:
        """What makes it more than an open chain with drives at its joints; "" if nothing does.

        There friction and reactions depend on each other across the joints.
        """
        if self.linkage is None:
            return ""
        kinds = {
            "the loop": [loop.name for loop in self.loops],
            "the drive off the joints": [drive.name for drive in self.linkage.drives],
            "friction along the spring": self.linkage.rods,
        }
        what, names = next((what, names) for what, names in kinds.items() if names)
        more = f" (and {len(names) - 1} more)" if len(names) > 1 else ""
        return f"{what} {names[0]!r}{more}"

    @property
    def start_configuration(self) -> np.ndarray:
        """(nq,) near which the loops close: `start`, `simulation.start.q`, else the neutral one."""
        if self.start is not None and not isinstance(self.start, Mapping):
            return np.array(self.start)
        start = self.simulation.start.q if self.simulation and self.start is None else self.start
        q = np.array(pin.neutral(self.model))
        for name, position in (start or {}).items():
            if name in self.joint_names:
                joint = self.model.joints[self.model.getJointId(name)]
                if joint.nq == 1:
                    q[joint.idx_q] = position
                elif joint.nv == 1:  # continuous: cos, sin
                    q[joint.idx_q : joint.idx_q + 2] = np.cos(position), np.sin(position)
        return q

    def close(self, q_guess: Any, independent: Sequence[str] | None = None) -> np.ndarray:
        """Return the configuration near a guess in which every loop is closed.

        Newton's method on Phi(q) = 0 (paper eq. 2), with the smallest steps that close.

        Args:
            q_guess: (nq,) rad, m.
            independent: names of joints that stay where the guess has them; None lets all move.

        Raises:
            SceneError: an unknown joint, or a wrong shape. StateError: not real numbers.
            ClosureError: it cannot close; gives the remaining distance of the frames.
        """
        held = np.zeros(self.model.nv, dtype=bool)
        where = f"{self.source}: close: independent"
        held[velocity_indices(self.model, independent or (), where)] = True
        q = np.array(real_numbers("q_guess", q_guess))
        if q.shape != (self.model.nq,):
            raise SceneError(
                f"{self.source}: close: q_guess has shape {q.shape}; should be ({self.model.nq},)"
                f"{from_angles(self.model, q.size)}"
            )
        return q if self.linkage is None else close(self.twin(), self.linkage, q, held)

    @cached_property
    def site_tables(self) -> SiteTables:
        """The sites as arrays for the kernels."""
        sites = self.sites
        return SiteTables(
            joint=np.array([s.joint for s in sites], dtype=np.int64),
            axis=np.array([s.axis for s in sites], dtype=float).reshape(-1, 3),
            contacts=contacts([s.friction.bearing for s in sites], [s.axis for s in sites]),
            laws=law_table([s.law for s in sites]),
            velocity_index=np.array([s.velocity_index for s in sites], dtype=np.int64),
            ratio=np.array([s.ratio for s in sites], dtype=float),
        )

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """The drives; a degree of freedom may have none, one or several (`mobility`).

        They are in the order of the model's velocities; with loops or drives off the joints in that
        of the list.
        """
        if self.actuators is None:
            joints = range(1, self.model.njoints)
            return tuple(drive for joint in joints for drive in self._ideal(joint))
        off_joint = {} if self.linkage is None else {d.name: d for d in self.linkage.drives}
        moving = {*self.joint_names, *(loop.name for loop in self.loops)}
        listed: dict[str, Drive] = {}
        for actuator in self.actuators:
            name = actuator.drive_name
            if name in listed:
                raise SceneError(
                    f"{self.source}: actuators: {name!r} is listed twice; several drives "
                    "on one joint need a `name` each"
                )
            if name != actuator.joint and name in moving:
                raise SceneError(
                    f"{self.source}: actuators: the name {name!r} is taken by a joint "
                    "or a loop that this drive does not move"
                )
            listed[name] = off_joint.get(name) or self._drive(actuator)
        ordered = list(listed.values())
        check_couples(ordered, velocity_names(self.model), self.source)
        if self.linkage is None:
            ordered.sort(key=lambda drive: drive.velocity_index)
        return tuple(ordered)

    @cached_property
    def ways(self) -> Ways | None:
        """The ways over which friction builds up; None where it acts at once everywhere."""
        actuators = self.actuators or ()
        if self.linkage is not None:
            refuse_presliding(self.friction, actuators, self.source)
            return None
        entries = [*self.friction.values(), *(a.transmission for a in actuators)]
        if not any(entry is not None and entry.presliding for entry in entries):
            return None
        nv, twin = self.model.nv, self.twin()
        own = {
            name: int(twin.v_index[row])
            for row, name in enumerate(self.joint_names)
            if self.model.joints[row + 1].shortname() != "JointModelMimic"
            and self.model.joints[row + 1].nv == 1
        }
        return ways_of(self.friction, actuators, self.drives, own, nv, self.source)

    @cached_property
    def without_presliding(self) -> Scene:
        """The scene whose friction acts at once: its efforts bound those of this one."""
        if self.ways is None:
            return self
        friction = {
            name: entry.model_copy(update={"presliding": None})
            for name, entry in self.friction.items()
        }
        actuators = self.actuators and [
            actuator.model_copy(
                update={
                    "transmission": actuator.transmission
                    and actuator.transmission.model_copy(update={"presliding": None})
                }
            )
            for actuator in self.actuators
        ]
        return replace(self, friction=friction, actuators=actuators)

    def gears(self, brakes: bool = True) -> Gears:
        """Return the drives' transmissions, and their closed brakes, as arrays for the kernels."""
        return self._gears[brakes]

    @cached_property
    def _gears(self) -> tuple[Gears, Gears]:
        """Without brakes, and with those that are closed."""
        gears = [drive.transmission for drive in self.drives]
        stick = [self.stick_velocity_of(drive) for drive in self.drives]
        closed = [self.closed_brakes.get(drive.name, 0.0) for drive in self.drives]
        return gear_table(gears, stick), gear_table(gears, stick, closed)

    def slides(self, column: int) -> bool:
        """Return whether a column of v is in m/s along an axis, not in rad/s about one."""
        ideal = (d for joint in range(1, self.model.njoints) for d in self._ideal(joint))
        return next(d.slides for d in ideal if d.velocity_index == column)

    def stick_velocity_of(self, drive: Drive) -> float:
        """Return the stick velocity of the drive's site, else the scene's default."""
        moved = drive.name
        if drive.column >= 0 and self.linkage is not None:
            pair = int(self.linkage.column_pair[drive.column])
            moved = self.loops[pair].name if pair < len(self.loops) else moved
        for site in self.sites:
            joint = site.velocity_index == drive.velocity_index >= 0 and site.ratio == 1.0
            if joint or site.name == moved:
                return site.law.stick_velocity
        return self.stick_velocity

    def _check_brakes(self) -> None:
        geared = [drive.name for drive in self.drives if drive.transmission is not None]
        for name, torque in self.closed_brakes.items():
            where = f"{self.source}: closed_brakes"
            if name not in geared:
                raise SceneError(
                    f"{where}: there is no drive {name!r} with a transmission; "
                    f"{choose_from(name, geared)}"
                )
            if not 0.0 <= torque <= LARGEST:
                raise SceneError(f"{where}.{name}: {torque!r}; should be a torque (N m), 0 or more")

    def _check_gears(self) -> None:
        for actuator in self.actuators or ():
            gear, entry = actuator.transmission, self.friction.get(actuator.joint or "")
            loses = gear is not None and any(any(loss.slopes) for loss in gear.losses())
            if not loses or entry is None or not isinstance(entry.bearing, Gear):
                continue
            if entry.mu is not None and entry.mu.static > 0.0:
                raise SceneError(
                    f"{self.source}: friction.{actuator.joint}.bearing: the losses of this gear "
                    "are also in its transmission's `efficiency` or `back_efficiency`: give one of "
                    "them"
                )

    def _check_masses(self) -> None:
        where, words = f"{self.source}: robot.masses", get_args(MassesHold)
        masses = self.masses if isinstance(self.masses, Mapping) else {OTHERS: self.masses}
        for name, word in masses.items():
            if name not in (known := (*self.actuator_names, OTHERS)):
                raise SceneError(f"{where}: there is no drive {name!r}; {choose_from(name, known)}")
            if word not in words and self.masses is not None:
                raise SceneError(f"{where}: should be {' or '.join(words)}, found {word!r}")

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What is implausible about scene and robot, the most severe first: `pf.check`."""
        return find(self, meshes=True)

    @cached_property
    def quick_findings(self) -> tuple[Finding, ...]:
        """All errors of `findings`, and those others for which no mesh is read."""
        return vars(self).get("findings") or find(self, meshes=False)

    @property
    def masses_hold(self) -> tuple[bool | None, ...]:
        """Whether the links' masses hold each drive, in the order of `drives`; None: not known."""
        masses = self.masses if isinstance(self.masses, Mapping) else {OTHERS: self.masses}
        words = (masses.get(name, masses.get(OTHERS)) for name in self.actuator_names)
        return tuple(None if word is None else word == "with_drives" for word in words)

    @property
    def elastic(self) -> tuple[int, ...]:
        """Indices of the drives whose gears have a `stiffness`."""
        return tuple(d for d, drive in enumerate(self.drives) if drive.spring is not None)

    @property
    def one_drive_each(self) -> bool:
        """Whether every degree of freedom has exactly one drive, which moves nothing else."""
        return self.own_drives and not self.mobility.undriven

    @property
    def own_drives(self) -> bool:
        """Whether every drive has a degree of freedom of its own, and moves nothing else."""
        open_ = self.linkage is None and not self.mobility.redundant
        return open_ and not taking_part(self.drives)

    def loaded_model(self, attached: Iterable[str] | None = None) -> pin.Model:
        """Return a model with the named payloads; None takes those attached by default."""
        return self._variant(attached)[0].copy()

    def twin(self, attached: Iterable[str] | None = None) -> Twin:
        """Return the wrench twin with the named payloads; None takes those attached by default."""
        return self._variant(attached)[1]

    @cached_property
    def _variants(self) -> dict[frozenset[str], tuple[pin.Model, Twin]]:
        return {}

    def _variant(self, attached: Iterable[str] | None) -> tuple[pin.Model, Twin]:
        self.check_unchanged()
        default = (name for name, payload in self.payloads.items() if payload.attached)
        asked = payload_names(attached) or ()
        if not all(isinstance(name, str) for name in asked):
            raise SceneError(
                f"{self.source}: attached: should be names of payloads "
                f"({', '.join(self.payloads) or 'there are none'}), not {type(asked[0]).__name__}; "
                "states are arguments of the solver's methods, `scene.solver().inverse(q, v, a)`"
            )
        names = frozenset(default if attached is None else asked)
        if names not in self._variants:
            for name in names - self.payloads.keys():
                raise SceneError(
                    f"{self.source}: there is no payload {name!r}; "
                    f"{choose_from(name, self.payloads)}"
                )
            carried = {name: self.payloads[name] for name in sorted(names)}
            model = with_payloads(self.model, carried)
            self._variants[names] = model, self._with_springs(make_twin(model))
        return self._variants[names]

    def _with_springs(self, twin: Twin) -> Twin:
        """The twin with the scene's springs."""
        parts = self.springs, self.friction, self.start_configuration, self.source
        return replace(twin, springs=make_springs(twin.model, twin.axis, *parts))

    def __copy__(self) -> Scene:
        """Return a copy without derived quantities; it works with mimic joints, unlike pickling."""
        again = object.__new__(type(self))
        again.__setstate__(self._given())
        return again

    def __getstate__(self) -> dict[str, Any]:
        if len(self.model.mimicking_joints):
            raise SceneError(
                f"{self.source}: a robot with mimic joints cannot be sent to another process: "
                "Pinocchio loses their leaders; use one process, or lock these joints"
            )
        return self._given()

    def _given(self) -> dict[str, Any]:
        self.check_unchanged()
        derived = {n for n, entry in vars(Scene).items() if isinstance(entry, cached_property)}
        kept = {key: value for key, value in self.__dict__.items() if key not in derived}
        return kept | {name: dict(getattr(self, name)) for name in _MAPPINGS}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for name in _MAPPINGS:
            self.__dict__[name] = MappingProxyType(state[name])

    def _check_bodies(self) -> None:
        """Check joints' masses; of links merged by fixed joints only the sum must be possible."""
        for name, inertia in zip(self.joint_names, tuple(self.model.inertias)[1:], strict=True):
            if not 0 <= inertia.mass <= LARGEST:
                raise SceneError(
                    f"{self.source}: joint {name!r} moves a mass of {inertia.mass:g} kg"
                )
        check_kinetic_energy(self.model, self.source)

    def _check_payloads(self) -> None:
        for name, payload in self.payloads.items():
            where = f"{self.source}: robot.payloads.{name}"
            try:
                link_frame(self.model, payload.link)
            except RobotError as problem:
                raise SceneError(f"{where}.link: {problem}") from None
            if problem_text := implausible_body(payload.mass, inertia_matrix(payload)):
                raise SceneError(f"{where}: {problem_text}")

    def _check_tool(self) -> None:
        if self.tool is None:
            return
        if not isinstance(self.tool, str):
            raise SceneError(f"{self.source}: tool: should be a link's name, found {self.tool!r}")
        try:
            frame = link_frame(self.model, self.tool)
        except RobotError as problem:
            raise SceneError(f"{self.source}: tool: {problem}") from None
        if self.model.frames[frame].parentJoint == 0:
            raise SceneError(
                f"{self.source}: tool: {self.tool!r} is fixed to the ground and cannot move; "
                "name a link that joints move"
            )

    def _check_feet(self) -> None:
        if self.feet and not free_joint(self.model):
            raise SceneError(
                f"{self.source}: feet: the base is fixed, and its feet carry nothing; write "
                "`floating: true` under `robot`, or leave `feet` out"
            )
        for name in self.feet:
            try:
                link_frame(self.model, name)
            except RobotError as problem:
                raise SceneError(f"{self.source}: feet: {problem}") from None

    def _site(self, name: str, row: int, twin: Twin) -> Site:
        friction = self.friction[name]
        where = f"{self.source}: friction.{name}"
        if twin.components[row, 0] >= 0:
            raise SceneError(
                f"{where}: a {self.model.joints[row + 1].shortname()} has no single axis; friction "
                "acts at revolute, continuous and prismatic joints"
            )
        sliding = bool(twin.kind[row] == PRISMATIC)
        check_bearing(friction, "prismatic joint" if sliding else "turning joint", where)
        axis = twin.axis[row, :3] if sliding else twin.axis[row, 3:]
        return Site(
            name=name,
            joint=row,
            sliding=sliding,
            velocity_index=int(twin.v_index[row]),
            ratio=float(twin.ratio[row]),
            axis=axis,
            law=checked_law(friction, self.stick_velocity),
            friction=friction,
        )

    def _pair_site(
        self, name: str, row: int, axis: Sequence[float], sliding: bool, ball: bool = False
    ) -> Site:
        """The site of a loop's joint, or of a cylinder: a pair of the linkage."""
        friction = self.friction[name]
        return Site(
            name=name,
            joint=self.model.njoints - 1 + row,
            sliding=sliding,
            velocity_index=-1,
            ratio=1.0,
            axis=np.array(axis, dtype=float) / np.linalg.norm(axis),
            law=checked_law(friction, self.stick_velocity),
            friction=friction,
            pair=row,
            ball=ball,
        )

    def _ideal(self, joint: int) -> list[Drive]:
        """One ideal drive per degree of freedom of a joint; none for a mimic follower."""
        model, twin = self.model, self.twin()
        name, count, first = model.names[joint], model.joints[joint].nv, model.joints[joint].idx_v
        if count == 1:
            return [Drive(name, first, bool(twin.kind[joint - 1] == PRISMATIC))]
        parts = twin.components[joint - 1, :count]
        return [
            Drive(f"{name}.{_COMPONENT_NAMES[c]}", first + n, bool(c < 3))
            for n, c in enumerate(parts)
        ]

    def _drive(self, actuator: Actuator) -> Drive:
        name = actuator.joint
        assert name is not None  # those off the joints are in the linkage
        couples = tuple(
            (self._velocity(other, f"{actuator.drive_name}.couples"), factor)
            for other, factor in actuator.couples.items()
        )
        column = self._velocity(name, "")
        return Drive(
            actuator.drive_name,
            column,
            self.slides(column),
            actuator.transmission,
            actuator.share,
            couples,
            encoder=actuator.encoder,
        )

    def _velocity(self, name: str, where: str) -> int:
        """The column of v that an actuator drives."""
        joints = range(1, self.model.njoints)
        driven = {d.name: d.velocity_index for joint in joints for d in self._ideal(joint)}
        if name in driven:
            return driven[name]
        follows = (
            " is a mimic joint, driven through its leader;" if name in self.joint_names else ""
        )
        raise SceneError(
            f"{self.source}: actuators: {where}{': ' * bool(where)}joint {name!r}"
            f"{follows or ' is not there;'} {choose_from(name, driven)}"
        )
