"""Load-dependent friction inside MuJoCo: its friction limits are set anew at every step.

With the wrench w of a joint from MuJoCo's reactions of the last step (`cfrc_int`, contacts
included) and the direction d of motion, or of the motion that would start,

    B = mu c(w) + coulomb            static where the joint sticks, else kinetic
    t = tau + d B + drag(v)          what passes the gear; tau = w about (along) the axis
    frictionloss = d (F_d(t) - tau) - viscous |v|,      F_d: `drives.gear_line`

A gear's loss acts back on tau with the gain (F' - 1) M/(M + J) per unit of frictionloss, so in
motion the change is divided by 1 + that gain (Newton's step): without it gears of low efficiency
zigzag. Where that is not above 0 the gear jams, which is refused.

Where friction builds up over a way d it is no limit but a force, of the share z that the positions
say: - (1+z)/2 B_+ + (1-z)/2 B_-, with B_+- the limits above for either direction of motion and
z <- clip(z + dq/d, -1, 1). It is explicit: its spring needs a step below sqrt(M d/B).
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary, ref

import numpy as np
import pinocchio as pin

from pinfric.dynamics.forward.compensation import check_compensated
from pinfric.errors import PinfricError, choose_from
from pinfric.exporting.mujoco_callback import Callback, jams, mark, with_memory
from pinfric.exporting.tree import MovedBody, bodies
from pinfric.kernels.compiled import compiling, kernel
from pinfric.model.bearings import normal_loads
from pinfric.model.drives import Gears, gear_drag, gear_line
from pinfric.model.laws import Laws, law_at
from pinfric.model.scene import Scene, expect_scene

#: Least friction limit (N m or N): MuJoCo has no row for a joint without any.
_LEAST = 1e-9
#: Holds any joint while its first load is found (N m or N).
_HELD = 1e9
#: Impedance of the friction constraint from the first on: what is held creeps least.
_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
#: Flags of MuJoCo without which there is no friction, or no damping.
_FLAGS = ("FRICTIONLOSS", "CONSTRAINT", "DAMPER")
#: What is written to a model at first.
_WRITTEN = (
    "dof_armature",
    "dof_damping",
    "dof_frictionloss",
    "dof_solref",
    "dof_solimp",
)
#: Relative difference of reactions, and absolute one of poses (m, rad), that counts as the same.
_SAME_WRENCH, _SAME_POSE = 1e-6, 1e-7


class MujocoFriction:
    """The friction of scenes in one MuJoCo model; see `mujoco_friction`.

    Arrays have one entry for each drive, or each joint with friction, scene after scene.

    Attributes:
        scenes: prefix of their joints -> scene.
        model: its `dof_frictionloss` changes at every step; one per thread. Several MjData of it
            may be stepped in turn.
        dofs: (na,) MuJoCo's degree of freedom of each drive.
    """

    def __init__(self, scenes: Mapping[str, Scene], model: Any) -> None:
        self._mujoco = mujoco = _mujoco()
        self.scenes, self.model = dict(scenes), model
        self._original = self.scenes  # what is compiled, without factors
        _check_options(mujoco, model)
        self._robots = tuple(_Robot(mujoco, x, model, prefix) for prefix, x in scenes.items())
        self.dofs = np.concatenate([robot.dofs for robot in self._robots])
        if len(set(self.dofs.tolist())) < self.dofs.size:
            raise PinfricError("mujoco_friction: two scenes have the same joint of the model")
        self._timestep = float(model.opt.timestep)
        self._callback: list[Callback] = []  # one, once compiled; shared by those of one robot
        self._calls = False  # whether it is installed
        self._mark = mark(mujoco, model)
        #: Of each MjData that was begun; of the present one it stands in the model and the robots.
        self._kept: WeakKeyDictionary[Any, np.ndarray] = WeakKeyDictionary()
        self._present: Any = lambda: None
        before = [getattr(model, name).copy() for name in _WRITTEN]
        try:
            for robot in self._robots:
                robot.write_constants(mujoco)
            with compiling():
                self.start(mujoco.MjData(model))
        except PinfricError:
            for name, values in zip(_WRITTEN, before, strict=True):
                getattr(model, name)[:] = values
            mujoco.mj_setConst(model, mujoco.MjData(model))
            raise

    def start(self, data: Any) -> None:
        """Set the limits for the state in `data`: joints at or below their stick velocity rest.

        Args:
            data: MjData of the model, with its `qpos`, `qvel` and `ctrl`.

        Raises:
            PinfricError: a gear jams; a step too long for what builds up; a state that is not
                finite; a MjData of another model.
        """
        self._check(data)
        self._leave()
        limits = []
        for robot in self._robots:
            robot.write(np.where(robot.resting(data), _HELD, _LEAST))
        for _ in range(2):  # the second: with the friction of what moves
            self._mujoco.mj_forward(self.model, data)
            self._mujoco.mj_rnePostConstraint(self.model, data)
            limits = [robot.first(data) for robot in self._robots]
            for robot, robot_limits in zip(self._robots, limits, strict=True):
                robot.write(np.where(robot.resting(data), _HELD, robot_limits))
        for robot, robot_limits in zip(self._robots, limits, strict=True):
            robot.write(robot_limits)
            robot.begin_to_build_up(data, robot_limits)
        self._present = ref(data)
        self._kept[data] = self._now()

    def save(self, data: Any) -> np.ndarray:
        """Return (3, na) what friction remembers of `data` from one step to the next.

        Limits (N m or N), shares that have built up, and their forces; `restore` goes on with it.
        """
        return self._now() if self._present() is data else self._of(data).copy()

    def restore(self, data: Any, saved: np.ndarray) -> None:
        """Let `step` go on in `data`, whose state was restored, with what `save` returned.

        Raises:
            PinfricError: another shape, a share of friction that this robot cannot have, or a state
                that is not finite.
        """
        kept = np.array(saved, dtype=float)
        if kept.shape != (3, len(self.dofs)) or not np.isfinite(kept).all():
            raise PinfricError(
                f"mujoco_friction: restore: saved has the shape {kept.shape}, or is not finite; "
                f"give the (3, {len(self.dofs)}) that `save` returned"
            )
        most = np.concatenate([robot.builds for robot in self._robots]).astype(float)
        if (bad := np.abs(kept[1]) > most).any():
            d = int(np.argmax(bad))
            allowed = "-1 to 1" if most[d] else "0, because friction acts at once there"
            raise PinfricError(
                f"mujoco_friction: restore: share {kept[1, d]:g} of drive {d}; allowed is "
                f"{allowed}: is it of another robot?"
            )
        self._check(data)
        if self._present() is data:
            self._present = lambda: None
        self._kept[data] = kept

    def _check(self, data: Any) -> None:
        model = self.model
        if (data.qpos.size, data.qvel.size) != (model.nq, model.nv):
            raise PinfricError("mujoco_friction: this MjData is of another model than `model`")
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            raise PinfricError(
                f"mujoco_friction: at t = {data.time:.4g} s positions or velocities are not "
                "finite; MuJoCo would begin anew: reset the data and call `start`"
            )

    def _now(self) -> np.ndarray:
        """What stands in the model and the robots, as `save`."""
        robots = self._robots
        shares, forces = ([getattr(r, name) for r in robots] for name in ("share", "built_up"))
        limits = self.model.dof_frictionloss[self.dofs]
        return np.array([limits, np.concatenate(shares), np.concatenate(forces)])

    def _leave(self) -> None:
        """Keep what stands in the model for the present data."""
        if (data := self._present()) is not None:
            self._kept[data] = self._now()
        self._present = lambda: None

    def _of(self, data: Any) -> np.ndarray:
        if data not in self._kept:
            raise PinfricError(
                "mujoco_friction: this MjData was not begun: call `start` for each (or `restore`, "
                "with what `save` returned)"
            )
        return self._kept[data]

    def _enter(self, data: Any) -> None:
        """Let the model and the robots be those of the data."""
        if self._present() is data:
            return
        kept = self._of(data)
        self._leave()
        first = 0
        for robot in self._robots:
            last = first + len(robot.dofs)
            robot.resume(data, *kept[:, first:last])
            first = last
        self._present = ref(data)

    def step(self, data: Any) -> None:
        """Advance by one time step, then set the limits of the next: `mj_step` with friction.

        Several MjData may be stepped in turn: friction remembers its limits for each.

        Args:
            data: MjData of the model, after `start`.

        Raises:
            PinfricError: a gear jams; the time step, the integrator, a flag, armature or damping
                was changed; a step too long for what builds up; data that were not begun; a state
                that is not finite.
        """
        mujoco, model = self._mujoco, self.model
        if model.opt.timestep != self._timestep:
            raise PinfricError(
                f"mujoco_friction: the time step is {model.opt.timestep:g} s and was "
                f"{self._timestep:g} s: make the friction anew for another one"
            )
        _check_options(mujoco, model)
        self._check(data)
        for robot in self._robots:
            robot.check_constants()
        self._enter(data)
        before = data.qvel.copy()
        for robot in self._robots:
            data.qfrc_applied[robot.dofs] += robot.built_up
        mujoco.mj_step(model, data)
        for robot in self._robots:
            data.qfrc_applied[robot.dofs] -= robot.built_up
        after = data.qvel.copy()
        data.qvel[:] = before  # reactions belong to the state at which they were solved
        mujoco.mj_rnePostConstraint(model, data)
        data.qvel[:] = after
        for robot in self._robots:
            robot.write(robot.next(data))

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Let MuJoCo itself call friction, compiled: in `mj_step` and in `mujoco.rollout`.

        `model` must come from an MjSpec. MuJoCo then calls for every `MjData` of `model` and its
        copies, also in several threads; `start` and `step` are not needed. A motion begins as by
        `start` wherever a state does not follow from the last step, so at each rollout's start.
        Frictions of other models may be installed at the same time.

        Raises:
            PinfricError: friction that builds up over a way (`step` has it); no C++ compiler; no
                MjSpec was given; another control or sensor callback is set, or this one; at the end
                of the `with`: a gear jammed; the time step, the integrator, a flag, armature or
                damping was changed; a model of another friction ran that was not installed.

        Source: MuJoCo documentation, API reference: physics callbacks.
        """
        for scene in self.scenes.values():
            if scene.ways is not None:
                raise PinfricError(
                    f"{scene.source}: presliding: friction that builds up over a way is in `step` "
                    "only, not in MuJoCo's callback; take `step`, or leave it out "
                    "(`scene.without_presliding`)"
                )
        with self._compiled().installed(
            self.model, self._mark, {robot.prefix: robot.places for robot in self._robots}
        ):
            self._calls = True
            try:
                yield
            finally:
                self._calls = False

    def _compiled(self) -> Callback:
        if not self._callback:
            refused = sum(_bit(self._mujoco, flag) for flag in _FLAGS)
            constants = {"LEAST": _LEAST, "HELD": _HELD, "REFUSED": refused}
            self._callback.append(Callback(self._mujoco, self._original, constants))
        return self._callback[0]

    def randomised(
        self,
        rng: np.random.Generator,
        scale: Any = (0.7, 1.3),
        count: int = 1,
    ) -> MujocoFrictions:
        """Return frictions of so many environments, each with a model of its own, for training.

        The friction of each joint (load-dependent, Coulomb, viscous) is multiplied by a number that
        is drawn uniformly; gears and rotors keep theirs. The same rng in the same state gives the
        same environments, whatever threads run them.

        Args:
            rng: numpy's generator.
            scale: (low, high) of all joints, or joint -> (low, high), with the joints' prefix.
            count: of environments.

        Raises:
            PinfricError: no such joint, or a range that is none.
        """
        if not isinstance(rng, np.random.Generator):
            raise PinfricError(
                f"randomised: rng is a {type(rng).__name__}, not a numpy.random.Generator: "
                "give np.random.default_rng(seed)"
            )
        if not (isinstance(count, int | np.integer) and count > 0):
            raise PinfricError(f"randomised: count: should be a number above 0; found {count!r}")
        names = [robot.prefix + site.name for robot in self._robots for site in robot.scene.sites]
        low, high = _ranges(scale, names)
        factors = low + (high - low) * rng.random((count, len(names)))
        return MujocoFrictions(tuple(self._varied(row) for row in factors), factors)

    def _varied(self, factors: np.ndarray) -> MujocoFriction:
        """This friction times factors (ns,), in a copy of the model."""
        other = copy.copy(self)
        other.model = copy.copy(self.model)
        other._mark, other._calls = mark(self._mujoco, other.model), False
        other._kept, other._present = WeakKeyDictionary(), lambda: None
        robots, first = [], 0
        for robot in self._robots:
            last = first + len(robot.scene.sites)
            robots.append(robot.varied(other.model, factors[first:last]))
            robots[-1].write_constants(self._mujoco)
            first = last
        other._robots = tuple(robots)
        other.scenes = {robot.prefix: robot.scene for robot in robots}
        other.start(self._mujoco.MjData(other.model))
        return other

    def sticking(self, data: Any) -> np.ndarray:
        """Return (na,) bool, whether each joint stuck in the last step, or had not slipped."""
        sticks = np.concatenate([_sticking(*robot.last(data)) for robot in self._robots])
        builds = np.concatenate([robot.builds for robot in self._robots])
        return (
            np.where(builds, np.abs(self.save(data)[1]) < 1.0, sticks) if builds.any() else sticks
        )

    @property
    def share(self) -> np.ndarray:
        """(na,) share z of friction that has built up in the last step; 0 where it acts at once."""
        return np.concatenate([robot.share for robot in self._robots])

    def limit(self, data: Any) -> np.ndarray:
        """Return (na,) the friction limits of the next step (N m or N)."""
        if self._calls:
            return np.concatenate([robot.next(data) for robot in self._robots])
        return self.save(data)[0]

    def normal_load(self, data: Any) -> np.ndarray:
        """Return (ns,) the normal loads of the joints with friction (N m or N)."""
        return np.concatenate([robot.loads(data, robot.wrench(data)) for robot in self._robots])

    def wrench(self, data: Any) -> np.ndarray:
        """Return (nj, 6) parent on child in the child's joint frame, linear first (N, N m)."""
        return np.concatenate([robot.wrench(data) for robot in self._robots])


@dataclass(frozen=True, eq=False)
class MujocoFrictions:
    """Frictions of several environments; see `MujocoFriction.randomised`.

    Attributes:
        each: of every environment.
        factors: (N, ns) on the friction of each joint, scene after scene.
    """

    each: tuple[MujocoFriction, ...]
    factors: np.ndarray

    @property
    def models(self) -> list[Any]:
        """The environments' models, for `mujoco.rollout.rollout(models, data, ...)`."""
        return [friction.model for friction in self.each]

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Let MuJoCo call the friction of each model; compiled once. See `MujocoFriction`."""
        with ExitStack() as stack:
            for friction in self.each:
                stack.enter_context(friction.installed())
            yield


def _ranges(scale: Any, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """(ns,) the lowest and the highest factors of the joints of those names."""
    given = scale if isinstance(scale, Mapping) else dict.fromkeys(names, scale)
    out = np.ones((2, len(names)))
    for name, pair in given.items():
        if name not in names:
            raise PinfricError(
                f"randomised: scale: no joint {name!r} has friction; {choose_from(name, names)}"
            )
        ends = np.asarray(pair, dtype=float) if np.shape(pair) == (2,) else np.full(2, np.nan)
        if not (0.0 <= ends[0] <= ends[1] < np.inf):
            raise PinfricError(
                f"randomised: scale: {name}: should be (low, high), not below 0; found {pair!r}"
            )
        out[:, names.index(name)] = ends
    return out[0], out[1]


class _Follower(NamedTuple):
    """A joint that an equality moves with a drive's joint.

    Attributes:
        row: of its body in the scene's tree. drive: that carries it.
        ratio: of its motion to the drive's joint's. armature: of its link (kg m^2 or kg).
        joint, dof: in the model. axis: (6,) its direction, linear first.
    """

    row: int
    drive: int
    ratio: float
    armature: float
    joint: int
    dof: int
    axis: np.ndarray


class _Robot:
    """The joints of one scene in a model; see `MujocoFriction`.

    Attributes:
        counts: (na,) bool, whether the drive's joint has friction or a gear; the others stay as in
            the model.
    """

    def __init__(self, mujoco: Any, scene: Scene, model: Any, prefix: str) -> None:
        self._mujoco = mujoco
        self.scene, self.model, self.prefix = scene, model, prefix
        self._tree = tree = bodies(scene)
        self.joint = joint = np.array(_joints(mujoco, scene, model, prefix))
        self.body = np.array(model.jnt_bodyid[joint])
        self._root = np.array(model.body_rootid[self.body])
        # of the drives: a joint that follows another has none
        self.row = np.array([k for k, body in enumerate(tree) if body.follows is None])
        own = [tree[k] for k in self.row]
        self._joint = joint[self.row]
        self.dofs = np.array(model.jnt_dofadr[self._joint])
        self._qpos = np.array(model.jnt_qposadr[self._joint])
        rubs = {site.name for site in scene.sites}
        geared = [drive.transmission is not None for drive in scene.drives]
        named = zip(own, geared, strict=True)
        self.counts = np.array([gear or body.joint.name in rubs for body, gear in named])
        self._written = self.dofs[self.counts]
        self.led = _followers(scene, model, tree, joint, self.counts, rubs)
        _check_solver(mujoco, self)
        _check_same_robot(mujoco, self, tree)
        self._axis = np.array([_axis(body) for body in own])
        self._tables, self._gears = scene.site_tables, scene.gears()
        self._site = np.full(len(own), -1)
        self._site[self._tables.velocity_index] = np.arange(len(scene.sites))
        self._armature = np.array([body.armature for body in own])
        ways = scene.ways
        self._way = np.zeros(len(own)) if ways is None else ways.way[ways.of_drive]
        self.builds = self._way > 0.0
        self.share, self.built_up, self._at = np.zeros((3, len(own)))
        self.factors = np.ones(len(scene.sites))  # on the friction that the callback compiled

    def varied(self, model: Any, factors: np.ndarray) -> _Robot:
        """The same robot in another model, its joints' friction times factors (ns,)."""
        other, sites = copy.copy(self), self.scene.sites
        pairs = zip(sites, factors.tolist(), strict=True)
        scaled = {site.name: site.friction.scaled(factor) for site, factor in pairs}
        scene = self.scene.with_coefficients(scaled)
        assert scene is not None  # an open chain
        other.scene, other.model, other._tables = scene, model, scene.site_tables
        other.factors = self.factors * factors
        other.share, other.built_up, other._at = np.zeros((3, len(self.dofs)))
        return other

    def names(self) -> dict[int, str]:
        """Joints of the model that count, and what follows them -> name."""
        own = zip(self._joint.tolist(), self.counts, self.row, strict=True)
        joints = {j: k for j, counts, k in own if counts}
        joints |= {one.joint: one.row for one in self.led}
        return {j: self.prefix + self._tree[k].joint.name for j, k in joints.items()}

    def leader(self, one: _Follower) -> int:
        return int(self._joint[one.drive])

    def is_mimic(self, equality: int, pair: tuple[int, int]) -> bool:
        """Whether an equality moves a follower and its leader as the scene says."""
        model, law = self.model, np.polynomial.Polynomial(self.model.eq_data[equality, :5])
        (one,) = (x for x in self.led if x.joint == pair[0])
        _, ratio, shift = self._tree[one.row].follows or ("", 0.0, 0.0)
        follower, leader = model.qpos0[model.jnt_qposadr[list(pair)]]
        places = np.array([-1.0, 0.0, 1.0])
        apart = follower + law(places - leader) - (ratio * places + shift)
        return bool(model.eq_active0[equality] and np.abs(apart).max() <= _SAME_POSE)

    def write_constants(self, mujoco: Any) -> None:
        """Set what does not depend on the load: rotors, damping, hardness of the constraint."""
        model, gears, laws, on = self.model, self._gears, self._tables.laws, self.counts
        linear = np.where(gears.power == 1.0, gears.viscous, 0.0) * gears.ratio**2
        viscous = np.where(self._site >= 0, laws.viscous[self._site] if laws.viscous.size else 0, 0)
        rotor = gears.ratio**2 * gears.rotor_inertia
        model.dof_armature[self._written] = (rotor + self._armature)[on]
        model.dof_damping[self._written] = (viscous + linear)[on]
        model.dof_solref[self._written] = 2.0 * float(model.opt.timestep), 1.0
        model.dof_solimp[self._written] = _SOLIMP
        model.dof_frictionloss[self._written] = _LEAST
        self._constants = {
            name: getattr(model, name)[self._written].copy()
            for name in ("dof_armature", "dof_damping")
        }
        dofs = [one.dof for one in self.led]
        model.dof_frictionloss[dofs] = model.dof_damping[dofs] = 0.0
        model.dof_armature[dofs] = [one.armature for one in self.led]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        mobility = model.dof_invweight0
        inertia = 1.0 / mobility[self.dofs]
        for one in self.led:
            inertia[one.drive] += one.ratio**2 / mobility[one.dof]
        self._mobility = 1.0 / inertia
        self._share = 1.0 - rotor * self._mobility  # M/(M + J)

    @property
    def places(self) -> tuple[np.ndarray, ...]:
        """What the callback needs of joints and followers; see `Callback`."""
        led = self.led
        followers = (
            np.array([(one.joint, one.row, one.drive) for one in led], dtype=int).reshape(-1, 3),
            np.array([(one.ratio, one.armature) for one in led]).reshape(-1, 2),
        )
        own = self._joint, self.row, self._armature, self._share, self.counts
        return (*own, *followers, self.factors)

    def check_constants(self) -> None:
        """Refuse a model whose armature or damping is no longer what friction wrote."""
        for name, wanted in self._constants.items():
            found = getattr(self.model, name)[self._written]
            if (found != wanted).any():
                d = int(np.argmax(found != wanted))
                raise PinfricError(
                    f"mujoco_friction: {name} of joint {list(self.names().values())[d]!r} is "
                    f"{found[d]:g} and was {wanted[d]:g}: friction and rotors are the scene's; "
                    "change them there and make the friction anew"
                )

    def resume(
        self, data: Any, limits: np.ndarray, share: np.ndarray, built_up: np.ndarray
    ) -> None:
        """Go on in data with what was kept (na,) of them."""
        self.write(limits)
        self.share, self.built_up = share.copy(), built_up.copy()
        self._at = data.qpos[self._qpos].copy()

    def write(self, limits: np.ndarray) -> None:
        """Set the limits (na,) of the joints that count; what builds up is a force, see `step`."""
        self.model.dof_frictionloss[self._written] = limits[self.counts]

    def begin_to_build_up(self, data: Any, limits: np.ndarray) -> None:
        """Begin with the friction (na,) that holds a joint, or of one that moves."""
        if self.builds.any():
            held = -self.last(data)[0] / np.maximum(limits, _LEAST)
            moving = np.sign(data.qvel[self.dofs])
            share = np.where(self.resting(data), np.clip(held, -1.0, 1.0), moving)
            self.share, self._at = np.where(self.builds, share, 0.0), data.qpos[self._qpos].copy()
            self.write(self._build_up(data, limits))

    def _build_up(self, data: Any, limits: np.ndarray) -> np.ndarray:
        """Write the forces of what builds up; return the limits (na,) of all others."""
        if not self.builds.any():
            return limits
        there = data.qpos[self._qpos]
        moved = np.where(self.builds, there - self._at, 0.0)
        self._at = there.copy()
        share = np.clip(self.share + moved / np.where(self.builds, self._way, 1.0), -1.0, 1.0)
        self.share = np.where(self.builds, share, 0.0)
        moves, none = np.zeros(len(self.dofs), dtype=bool), np.full(len(self.dofs), np.nan)
        ahead, back = (
            self._limits(data, moves, np.full(len(self.dofs), way), none) for way in (1.0, -1.0)
        )
        z, mobility = self.share, self._mobility
        force = 0.5 * (1.0 - z) * back - 0.5 * (1.0 + z) * ahead
        self.built_up = np.where(self.builds, force, 0.0)
        stiff = np.maximum(ahead, back) / np.where(self.builds, self._way, np.inf)
        fast = float(self.model.opt.timestep) * np.sqrt(stiff * mobility)
        if (fast >= 1.0).any():
            d = int(np.argmax(fast))
            raise PinfricError(
                f"{self.scene.source}: presliding: {self.scene.drives[d].name}: a time step of "
                f"{self.model.opt.timestep:g} s is too long for friction that builds up over "
                f"{self._way[d]:g}: take one below {self.model.opt.timestep / fast[d]:.2g} s, or "
                "leave it out"
            )
        return np.where(self.builds, _LEAST, limits)

    def resting(self, data: Any) -> np.ndarray:
        """(na,) bool, whether a joint is at or below its stick velocity."""
        return np.abs(data.qvel[self.dofs]) <= self._gears.stick_velocity

    def first(self, data: Any) -> np.ndarray:
        resting, old = self.resting(data), self.model.dof_frictionloss[self.dofs]
        direction = np.where(resting, -self.last(data)[0], data.qvel[self.dofs])
        return self._limits(data, resting, direction, np.where(resting, old, np.nan))

    def next(self, data: Any) -> np.ndarray:
        """(na,) limits after a step with known reactions."""
        (force, used), rate = self.last(data), data.qvel[self.dofs]
        sticks = _sticking(force, used)
        fast = ~sticks & (np.abs(rate) > self._gears.stick_velocity)
        limits = self._limits(data, sticks, np.where(fast, rate, -force), used)
        return self._build_up(data, limits)

    def loads(self, data: Any, wrench: np.ndarray) -> np.ndarray:
        tables, load = self._tables, np.zeros((1, len(self.scene.sites)))
        place = np.zeros_like(load)
        place[0] = data.qpos[self._qpos][tables.velocity_index]
        normal_loads(wrench[None], tables.joint, tables.contacts, place, load)
        return load[0]

    def wrench(self, data: Any) -> np.ndarray:
        """As `MujocoFriction.wrench`."""
        out = np.empty((len(self.joint), 6))
        places = data.subtree_com, data.xpos, data.xmat
        write_wrenches(data.cfrc_int, *places, self.body, self._root, out)
        return out

    def last(self, data: Any) -> tuple[np.ndarray, np.ndarray]:
        """(na,) friction of the last step, on the child along the joint, and its limits."""
        force, used = np.zeros(self.model.nv), np.zeros(self.model.nv)
        start, end = data.ne, data.ne + data.nf
        of = data.efc_id[start:end]
        if self.model.ntendon:  # their friction comes after that of joints
            kind = self._mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
            of = of[data.efc_type[start:end] == kind]
        end = start + of.size
        force[of], used[of] = data.efc_force[start:end], data.efc_frictionloss[start:end]
        return force[self.dofs], used[self.dofs]

    def _stops(self, data: Any) -> np.ndarray:
        """(nv,) forces beside the drives: stops and springs at the joints (N m or N)."""
        model, beside = self.model, np.array(data.qfrc_spring)
        if data.nl:
            kind = self._mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
            for row in np.flatnonzero(data.efc_type == kind):
                j = data.efc_id[row]
                low, high = model.jnt_range[j]
                below = 2.0 * data.qpos[model.jnt_qposadr[j]] < low + high
                force = data.efc_force[row] if below else -data.efc_force[row]
                beside[model.jnt_dofadr[j]] += force
        return beside

    def _limits(
        self, data: Any, sticks: np.ndarray, direction: np.ndarray, old: np.ndarray
    ) -> np.ndarray:
        """Limits (na,) of the next step; old: the last ones, NaN for none."""
        wrench, beside = self.wrench(data), self._stops(data)
        tau = (wrench[self.row] * self._axis).sum(axis=1) + self._armature * data.qacc[self.dofs]
        tau -= beside[self.dofs]
        for one in self.led:  # the drive carries what follows it, through the equality
            taken = wrench[one.row] @ one.axis + one.armature * data.qacc[one.dof]
            tau[one.drive] += one.ratio * (taken - beside[one.dof])
        out = np.empty(len(self.dofs))
        d = write_limits(
            self._tables.laws,
            self._gears,
            self._site,
            self.loads(data, wrench),
            tau,
            data.qvel[self.dofs],
            np.where(direction < 0.0, -1.0, 1.0),
            sticks,
            self._share,
            old,
            out,
        )
        if d >= 0:
            raise jams(self.scene, d, f"at t = {data.time:.4g} s")
        return out


def _sticking(force: np.ndarray, used: np.ndarray) -> np.ndarray:
    return np.abs(force) < (1.0 - 1e-12) * used


@kernel
def write_wrenches(
    reaction: np.ndarray,
    com: np.ndarray,
    place: np.ndarray,
    turn: np.ndarray,
    body: np.ndarray,
    root: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write MuJoCo's reactions (nj, 6) at the joints, in their children's axes, linear first.

    Args:
        reaction, com, place, turn: `cfrc_int`, `subtree_com`, `xpos`, `xmat` of the bodies.
        body, root: (nj,) of each joint, and the first of its tree.
        out: (nj, 6) parent on child, overwritten.
    """
    for j in range(body.size):
        b, c = body[j], com[root[j]] - place[body[j]]
        m, f = reaction[b, :3], reaction[b, 3:]
        moment = (
            m[0] + c[1] * f[2] - c[2] * f[1],
            m[1] + c[2] * f[0] - c[0] * f[2],
            m[2] + c[0] * f[1] - c[1] * f[0],
        )
        for k in range(3):
            out[j, k] = out[j, 3 + k] = 0.0
            for i in range(3):
                out[j, k] += turn[b, 3 * i + k] * f[i]
                out[j, 3 + k] += turn[b, 3 * i + k] * moment[i]


@kernel
def write_limits(
    laws: Laws,
    gears: Gears,
    site: np.ndarray,
    load: np.ndarray,
    tau: np.ndarray,
    velocity: np.ndarray,
    direction: np.ndarray,
    sticks: np.ndarray,
    share: np.ndarray,
    old: np.ndarray,
    out: np.ndarray,
) -> int:
    """Write the friction limit (na,) of each drive, and return the drive that jams, or -1.

    Args:
        site: (na,) row of the joint's friction; -1: none. load: (ns,) normal loads.
        tau: (na,) wrenches about or along the axes. velocity: (na,). direction: (na,) 1 or -1.
        sticks: (na,) bool. share: (na,) M/(M + J). old: (na,) last limits, or NaN.
        out: (na,), overwritten (N m or N).
    """
    for d in range(out.size):
        way, speed, v = direction[d], 0.0, 0.0
        if not sticks[d]:
            v, speed = velocity[d], abs(velocity[d])
        dry = drag = viscous = 0.0
        if site[d] >= 0:
            law, c = law_at(laws, site[d], way * max(speed, 1e-300)), load[site[d]]
            if sticks[d]:
                dry = law.static_mu * c + (law.static_forward if way > 0 else law.static_backward)
            else:
                dry = law.mu * c + (law.forward if way > 0 else law.backward)
                drag, viscous = law.drag_mu * c + law.drag, law.viscous * v
        t = tau[d] + way * (dry + drag) + viscous
        slope, offset, _, _ = gear_line(gears, d, way, speed, sticks[d], t)
        limit = way * (slope * t + offset - tau[d] - viscous)
        if gears.power[d] != 1.0:
            limit += abs(gear_drag(gears, d, v))
        if sticks[d]:  # a self-locking gear may need more for the load that friction lets it bear
            other = tau[d] - way * dry
            slope, offset, _, _ = gear_line(gears, d, way, 0.0, True, other)
            limit = max(limit, way * (slope * other + offset - tau[d]))
        elif old[d] == old[d]:
            gain = 1.0 + (slope - 1.0) * share[d]
            if gain <= 0.0:
                return d
            limit = old[d] + (limit - old[d]) / gain
        out[d] = max(limit, _LEAST)
    return -1


def mujoco_friction(scene: Scene | Mapping[str, Scene], model: Any) -> MujocoFriction:
    """Return the friction of a scene for a MuJoCo model: its limits follow the load at every step.

    frictionloss = d (F_d(tau + d B + drag) - tau) - viscous |v|; see the module's text. Armature
    (rotors), damping and `solref` are set for joints with friction or a gear only.

    Args:
        scene: an open chain with a drive at each joint; or several robots of one model, by the
            prefix of their joints' names: {"left_": scene, "right_": other}.
        model: mujoco.MjModel of the same robot, with the payloads that the scene carries by
            default: joints of the same names, axes and frames, as `pf.export(scene)` writes it; or
            a mujoco.MjSpec of it, which `installed` needs. Joints that the scene locks may move.

    Raises:
        PinfricError: MuJoCo is not installed; loops, cylinders, coupled joints; a model whose
            joints, axes, frames or masses differ, named; an equality or a fixed tendon on a joint
            with friction or a gear, but for that of a mimic joint; an actuator that pulls a link;
            the integrator RK4; a gear that jams (by `start` and `step`).

    Source: MuJoCo documentation, Computation: constraint model, friction loss.
    """
    scenes = scene if isinstance(scene, Mapping) else {"": scene}
    if not scenes:
        raise PinfricError(
            "mujoco_friction: no scene given; give one, or scenes by the prefix of their joints"
        )
    for robot in scenes.values():
        expect_scene(robot, "mujoco_friction")
        check_compensated(robot)
        if robot.springs:
            raise PinfricError(
                f"{robot.source}: springs: mujoco_friction takes loads without springs, but there "
                f"is {robot.springs[0].name!r}; take pf.export's constants, or leave `springs` out"
            )
    mujoco = _mujoco()
    if isinstance(model, mujoco.MjSpec):
        sizes = {prefix: len(robot.drives) for prefix, robot in scenes.items()}
        model = with_memory(mujoco, model, sizes)
    if not isinstance(model, mujoco.MjModel):
        raise PinfricError(
            f"mujoco_friction: model is a {type(model).__name__}, not a mujoco.MjModel or MjSpec: "
            "give mujoco.MjModel.from_xml_string(pf.export(scene).text)"
        )
    return MujocoFriction(scenes, model)


def _mujoco() -> Any:
    try:
        return import_module("mujoco")
    except ImportError:
        raise PinfricError("mujoco_friction needs mujoco: pip install 'pinfric[mujoco]'") from None


def _joints(mujoco: Any, scene: Scene, model: Any, prefix: str) -> list[int]:
    indices, kind = [], mujoco.mjtJoint
    for body in bodies(scene):
        name = prefix + body.joint.name
        j = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if j < 0:
            names = [model.joint(i).name for i in range(model.njnt)]
            raise PinfricError(
                f"{scene.source}: the MuJoCo model has no joint {name!r}; "
                f"{choose_from(name, names)}"
            )
        wanted = kind.mjJNT_SLIDE if body.joint.unit == "m" else kind.mjJNT_HINGE
        if model.jnt_type[j] != wanted:
            raise PinfricError(
                f"{scene.source}: joint {name!r} is of another kind in the MuJoCo model: "
                f"{kind(model.jnt_type[j]).name}, not {wanted.name}"
            )
        if not np.allclose(model.jnt_axis[j], body.axis, rtol=0.0, atol=_SAME_POSE):
            raise PinfricError(
                f"{scene.source}: the axis of joint {name!r} is {model.jnt_axis[j].tolist()} in "
                f"the MuJoCo model and {body.axis.tolist()} in the scene"
            )
        indices.append(j)
    # Refuse further joints in the robot; a cart under it may have some
    for j, body in zip(indices, bodies(scene), strict=True):
        above = int(model.jnt_bodyid[indices[body.parent]]) if body.parent >= 0 else None
        at = int(model.jnt_bodyid[j])
        while True:
            first, count = model.body_jntadr[at], model.body_jntnum[at]
            for more in {*range(first, first + count)} - {j}:
                raise PinfricError(
                    f"{scene.source}: the MuJoCo model has the joint {model.joint(more).name!r} "
                    f"beside or above {body.joint.name!r}, which the scene has not: its robot is "
                    "another"
                )
            at = int(model.body_parentid[at])
            if above is None or at in (above, 0):
                break
    return indices


def _axis(body: MovedBody) -> np.ndarray:
    """(6,) direction of a joint's motion, linear first."""
    out = np.zeros(6)
    out[slice(0, 3) if body.joint.unit == "m" else slice(3, 6)] = body.axis
    return out


def _followers(
    scene: Scene,
    model: Any,
    tree: Sequence[MovedBody],
    joints: np.ndarray,
    counts: np.ndarray,
    rubs: set[str],
) -> tuple[_Follower, ...]:
    """The mimic joints of drives that count; refuse friction of their own."""
    own = [body.joint.name for body in tree if body.follows is None]
    found = []
    for row, body in enumerate(tree):
        if body.follows is None:
            continue
        leader, ratio, _ = body.follows
        drive, j = own.index(leader), int(joints[row])
        if body.joint.name in rubs:
            raise PinfricError(
                f"{scene.source}: joint {body.joint.name!r} mimics {leader!r} and has friction of "
                f"its own, which MuJoCo would not pass to the drive: state it at {leader!r} "
                "(times the ratio)"
            )
        if counts[drive]:
            dof = int(model.jnt_dofadr[j])
            found.append(_Follower(row, drive, ratio, body.armature, j, dof, _axis(body)))
    return tuple(found)


def _bit(mujoco: Any, flag: str) -> int:
    return int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))


def _check_options(mujoco: Any, model: Any) -> None:
    """Refuse options that would change friction; they may be set at any time."""
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise PinfricError(
            "mujoco_friction: the integrator RK4 solves friction four times a step; "
            "take implicitfast"
        )
    if not model.opt.timestep > 0.0:
        raise PinfricError(
            f"mujoco_friction: the model's time step is {model.opt.timestep:g} s; give one above 0"
        )
    for flag in _FLAGS:
        if model.opt.disableflags & _bit(mujoco, flag):
            raise PinfricError(
                f"mujoco_friction: the model's flag {flag.lower()} is disabled; enable it"
            )


def _check_solver(mujoco: Any, robot: _Robot) -> None:
    """Refuse what acts on the joints that count otherwise than through their drives."""
    model, name = robot.model, robot.names()
    joints, dofs = np.array(list(name), dtype=int), robot.dofs[robot.counts]
    awaited = {(one.joint, robot.leader(one)) for one in robot.led}
    for e in range(model.neq):
        pair = (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
        if model.eq_type[e] != mujoco.mjtEq.mjEQ_JOINT:
            continue
        if pair in awaited and robot.is_mimic(e, pair):
            awaited.remove(pair)
        elif hit := name.keys() & {*pair}:
            raise PinfricError(
                f"mujoco_friction: an equality acts on joint {name[hit.pop()]!r}: its torque would "
                "count as the gear's"
            )
    for follower, leader in awaited:
        raise PinfricError(
            f"{robot.scene.source}: joint {model.joint(follower).name!r} mimics "
            f"{model.joint(leader).name!r}, and no active equality of the MuJoCo model moves it "
            "so; `pf.export(scene)` writes a model that fits"
        )
    for w in range(model.nwrap):
        joint = int(model.wrap_objid[w])
        if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT and joint in name:
            raise PinfricError(
                f"mujoco_friction: a fixed tendon acts on joint {name[joint]!r}: its torque would "
                "count as the gear's"
            )
    sprung = (model.tendon_stiffness != 0.0) | model.tendon_stiffnesspoly.any(axis=1)
    data, lengths = mujoco.MjData(model), []
    for place in np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(joints))):
        data.qpos[model.jnt_qposadr[joints]] = place
        mujoco.mj_fwdPosition(model, data)
        lengths.append(data.ten_length.copy())
    for k in np.flatnonzero(sprung & (lengths[0] != lengths[1])):
        raise PinfricError(
            f"mujoco_friction: tendon {model.tendon(k).name!r} pulls the robot with a spring, "
            "whose force would count twice: use a limit of its length"
        )
    direct = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    for u in range(model.nu):
        if model.actuator_trntype[u] in direct:
            continue
        data.ctrl[:], data.act[:] = np.arange(model.nu) == u, 1.0
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        with_it = data.qfrc_actuator[dofs].copy()
        data.ctrl[:] = data.act[:] = 0.0
        mujoco.mj_fwdActuation(model, data)
        if (with_it != data.qfrc_actuator[dofs]).any():
            raise PinfricError(
                f"mujoco_friction: actuator {model.actuator(u).name!r} pulls a link, not a joint: "
                "its force would count as the joints' load; use motors of joints, or xfrc_applied"
            )


def _follow(mujoco: Any, model: Any, data: Any) -> None:
    """Move joints coupled by an equality to where their leader has them."""
    at, start = model.jnt_qposadr, model.qpos0
    for e in np.flatnonzero(model.eq_type == int(mujoco.mjtEq.mjEQ_JOINT)):
        follower, leader = model.eq_obj1id[e], model.eq_obj2id[e]
        if leader >= 0:
            moved = data.qpos[at[leader]] - start[at[leader]]
            law = np.polynomial.Polynomial(model.eq_data[e, :5])
            data.qpos[at[follower]] = start[at[follower]] + law(moved)


def _check_same_robot(mujoco: Any, friction: _Robot, tree: Any) -> None:
    """Refuse another robot: poses of joints and reactions at random states must be the scene's.

    Joints that the scene locks are put where it has them; later they may move.
    """
    scene, plain = friction.scene, copy.deepcopy(friction.model)
    bits = mujoco.mjtDisableBit
    plain.opt.disableflags |= bits.mjDSBL_CONSTRAINT | bits.mjDSBL_ACTUATION
    plain.dof_armature[:] = plain.tendon_stiffness[:] = plain.tendon_damping[:] = 0.0
    locked = {} if scene.robot is None else dict(scene.robot.locked)
    kind = mujoco.mjtObj.mjOBJ_JOINT
    ids = {n: mujoco.mj_name2id(plain, kind, friction.prefix + n) for n in locked}
    leader = {body.joint.name: row for row, body in enumerate(tree)}
    data, pins = mujoco.MjData(plain), scene.loaded_model()
    of, rng = pins.createData(), np.random.default_rng(0)
    for _ in range(3):
        q, v, a = rng.uniform(-1.0, 1.0, (3, scene.model.nv))
        motion = np.zeros((3, len(tree)))
        motion[:, friction.row] = q, v, a
        for row, body in enumerate(tree):
            if body.follows is not None:
                name, ratio, shift = body.follows
                motion[:, row] = ratio * motion[:, leader[name]] + [shift, 0.0, 0.0]
        mujoco.mj_resetData(plain, data)
        for name, j in ids.items():
            if j >= 0:
                data.qpos[plain.jnt_qposadr[j]] = locked[name]
        _follow(mujoco, plain, data)
        data.qpos[plain.jnt_qposadr[friction.joint]] = motion[0]
        dofs = plain.jnt_dofadr[friction.joint]
        data.qvel[dofs], data.qacc[dofs] = motion[1:]
        mujoco.mj_fwdPosition(plain, data)
        mujoco.mj_fwdVelocity(plain, data)
        mujoco.mj_rnePostConstraint(plain, data)
        # Pinocchio's q of one number per joint
        full = pin.neutral(pins)
        for joint in list(pins.joints)[1:]:
            if joint.nq == 2:
                full[joint.idx_q : joint.idx_q + 2] = np.cos(q[joint.idx_v]), np.sin(q[joint.idx_v])
            elif joint.nq == 1:
                full[joint.idx_q] = q[joint.idx_v]
        pin.rnea(pins, of, full, v, a)
        pin.updateGlobalPlacements(pins, of)
        wrenches = friction.wrench(data)
        for row, body in enumerate(tree):
            here, above = friction.body[row], friction.body[body.parent]
            turn, place = data.xmat[here].reshape(3, 3), data.xpos[here]
            if body.parent < 0:
                theirs, ours = plain.opt.gravity, scene.model.gravity.linear
                apart = turn.T @ theirs - of.oMi[row + 1].rotation.T @ ours
                if np.abs(apart).max() > _SAME_POSE * max(np.abs(theirs).max(), 1.0):
                    raise PinfricError(
                        f"{scene.source}: gravity has another direction or size at joint "
                        f"{body.joint.name!r} in the MuJoCo model, where gravity is "
                        f"{theirs.tolist()}: its base is turned, or gravity differs; give it as "
                        "the base sees it (scene.with_(gravity=...))"
                    )
            else:
                base = data.xmat[above].reshape(3, 3)
                turn, place = base.T @ turn, base.T @ (place - data.xpos[above])
                apart = of.liMi[row + 1].rotation.T @ turn
                far = np.linalg.norm(place - of.liMi[row + 1].translation)
                angle = np.linalg.norm(pin.log3(apart))
                if max(far, angle) > _SAME_POSE:
                    raise PinfricError(
                        f"{scene.source}: joint {body.joint.name!r} is another in the MuJoCo "
                        f"model: its body stands {far:.3g} m and {angle:.3g} rad from where the "
                        "scene has it (axis, place, zero or order of joints); `pf.export(scene)` "
                        "writes a model that fits"
                    )
        for row, body in reversed(list(enumerate(tree))):
            wanted = of.f[row + 1].vector
            missed = np.abs(wrenches[row] - wanted).max()
            if missed > _SAME_WRENCH * max(np.abs(wanted).max(), 1.0):
                theirs, ours = _masses_beyond(plain, friction.body[row], pins, row + 1)
                why = (
                    f"{theirs:.4g} kg there, {ours:.4g} kg in the scene: is a payload carried in "
                    "one of the two?"
                )
                if abs(theirs - ours) <= _SAME_WRENCH * max(theirs, ours):
                    why = (
                        "the same mass is elsewhere: a joint that the scene lacks or locks stands "
                        "at another position (MuJoCo's is qpos0), or inertias differ"
                    )
                raise PinfricError(
                    f"{scene.source}: masses beyond joint {body.joint.name!r} differ in the "
                    f"MuJoCo model: a reaction by {missed:.3g} of {np.abs(wanted).max():.3g} N "
                    f"or N m; {why}"
                )


def _masses_beyond(model: Any, body: int, pins: pin.Model, joint: int) -> tuple[float, float]:
    """Masses (kg) that a joint carries in MuJoCo's model and in Pinocchio's."""
    ours = sum(pins.inertias[j].mass for j in pins.subtrees[joint])
    return float(model.body_subtreemass[body]), float(ours)
