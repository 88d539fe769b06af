"""Way-points of the tool or a free base: postures that put frames where they are wanted.

Levenberg-Marquardt from the posture before, e = log6(M(q)^-1 M_wanted), J its Jacobian:

    dq = (J^T J + (|e|^2/2 + w) 1)^-1 J^T e,    within the joints' limits

w is 1e-12. After `_PASSES` steps, which go to and fro beside a goal that is out of reach, only
those are taken that bring the tool nearer; the others raise w tenfold.

On a straight line the tool turns about one axis; quintic splines join `_KNOTS` postures. Damping:
Sugihara, Solvability-Unconcerned Inverse Kinematics by the Levenberg-Marquardt Method, IEEE Trans.
Robotics 27(5), 2011.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from pinfric.errors import TrajectoryError
from pinfric.model.arrays import FloatArray
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import JointColumn, configurations
from pinfric.motions.log.reading import ANGLE_UNITS
from pinfric.motions.waypoints import WayPointFile

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_PASSES = 500
#: Damping w, (m, rad)^2.
_LEAST = 1e-12
#: m and rad: what a posture may be off.
_REACHED = 1e-9
_KNOTS = 65
#: rad or m from knot to knot: more is a jump to another posture.
_JUMP = 0.3


class Tool:
    """A frame by the joints' positions x (nj,), rad or m, in the model's order.

    Args:
        columns: (nj,) all joints. frame: its link's. moving: names of those that bring it
            somewhere; None: all. xyz: (3,) where it is in the link's frame, m.
    """

    def __init__(
        self,
        model: pin.Model,
        columns: Sequence[JointColumn],
        frame: int,
        moving: Sequence[str] | None = None,
        xyz: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        self.columns, self.model = columns, model
        self.data, self.joint = model.createData(), model.frames[frame].parentJoint
        self.within = model.frames[frame].placement * pin.SE3(np.eye(3), np.array(xyz))
        self.moving = np.array([c.name in moving if moving is not None else True for c in columns])
        self.low, self.high = (
            np.array([getattr(c, x) for c in columns]) for x in ("lower", "upper")
        )

    @classmethod
    def of(cls, scene: Any, columns: Sequence[JointColumn], source: str) -> Tool:
        """Return the scene's tool."""
        if not isinstance(scene, Scene) or scene.tool is None:
            raise TrajectoryError(
                f"{source}: way-points of the tool need the scene's `tool`: name its link there, "
                "e.g. tool: tool0"
            )
        if scene.loops:
            raise TrajectoryError(
                f"{source}: way-points of the tool are for open chains; give `q` where loops close"
            )
        moving = [column.name for column in columns if not column.free]
        return cls(scene.model, columns, scene.model.getFrameId(scene.tool), moving)

    def place(self, x: FloatArray) -> pin.SE3:
        """Return where the tool is."""
        q = configurations(self.columns, x[None], self.model.nq)[0]
        pin.computeJointJacobians(self.model, self.data, q)  # and where the joints are
        at, within = self.joint, self.within
        self.jacobian = pin.getFrameJacobian(self.model, self.data, at, within, pin.LOCAL)
        return self.data.oMi[at] * within

    def reach(self, goal: pin.SE3, x: FloatArray, rows: int = 6) -> tuple[FloatArray, FloatArray]:
        """Return the posture nearest to a goal, from the posture x on, and what it is off (rows,).

        rows: 6, or 3 for the position alone.
        """
        x = np.clip(x, self.low, self.high)
        e, J = self._off(goal, x, rows)
        damping = _LEAST
        for number in range(2 * _PASSES):
            if np.linalg.norm(e) < 1e-3 * _REACHED:
                break
            moved = np.clip(x + self._step(x, e, J, damping), self.low, self.high)
            if np.abs(moved - x).max(initial=0.0) < 1e-14:
                break
            there = self._off(goal, moved, rows)
            if number < _PASSES or there[0] @ there[0] < e @ e:
                x, (e, J), damping = moved, there, max(0.1 * damping, _LEAST)
            else:
                damping *= 10.0
        return x, e

    def _off(self, goal: pin.SE3, x: FloatArray, rows: int) -> tuple[FloatArray, FloatArray]:
        """Return what x is off, e (rows,), and its rate, J (rows, nj)."""
        off = self.place(x).actInv(goal)
        J = self.jacobian[:, [column.index_v for column in self.columns]] * self.moving
        if rows == 6:
            return pin.log6(off).vector, pin.Jlog6(off.inverse()) @ J
        return off.translation, J[:3]

    def _step(self, x: FloatArray, e: FloatArray, J: FloatArray, damping: float) -> FloatArray:
        """Return dq; joints at a limit do not push against it."""
        free, step = self.moving.copy(), np.zeros(x.size)
        for _ in range(x.size):
            step = np.zeros(x.size)
            A = J[:, free]
            damped = A.T @ A + (0.5 * e @ e + damping) * np.eye(free.sum())
            step[free] = np.linalg.solve(damped, A.T @ e)
            stuck = (x + step > self.high) & (x >= self.high)
            stuck |= (x + step < self.low) & (x <= self.low)
            if not (stuck & free).any():
                break
            free &= ~stuck
        return step

    def missed(self, goal: pin.SE3, x: FloatArray, e: FloatArray) -> str:
        """Return how far a goal is out of reach; empty if it is reached."""
        if np.abs(e).max() < _REACHED:
            return ""
        distance = np.linalg.norm(self.reach(goal, x, 3)[1])
        if distance > _REACHED:
            return f"the tool is out of reach, by {distance:.3g} m within the joints' limits"
        short, turn = np.linalg.norm(e[:3]), np.degrees(np.linalg.norm(e[3:]))
        return (
            f"the tool is there only if turned: it comes within {short:.2g} m and {turn:.2g} deg "
            "within the joints' limits"
        )


def solve_tool_points(
    waypoints: WayPointFile, scene: Any, columns: Sequence[JointColumn], source: str
) -> tuple[WayPointFile, dict[int, BSpline]]:
    """Return the file with positions of all joints, and the joints' paths of straight moves.

    A base that moves over feet which stay goes straight, too.

    The latter are number of a point -> spline of (nj,) positions over its move, from 0 to 1.

    Raises:
        TrajectoryError: no tool, a place out of reach (by how far), a line on which the posture
            jumps.
    """
    if all(point.q for point in waypoints.points):
        return waypoints, {}
    names = [column.name for column in columns]
    order = [names.index(n) for n in waypoints.joints or names if n in names]
    turns = np.array([column.unit == "rad" for column in columns])
    angle = ANGLE_UNITS[waypoints.unit]
    unit = np.where(turns, angle, 1.0)[order]
    points, lines, x = [], dict[int, Any](), np.zeros(len(columns))
    for index, point in enumerate(waypoints.points):
        where, of = f"{source}: points[{index}]", point.tool or point.base
        if of is None:
            if len(order) != len(names) or len(point.q) != len(names):
                return waypoints, {}  # refused where positions are checked
            x = x.copy()
            x[order] = np.array(point.q) * unit
            points.append(point)
            continue
        turned = None if of.rpy is None else angle * np.array(of.rpy)
        if point.base is not None:
            lines[index] = _stance(scene, columns, x, np.array(of.xyz), turned, f"{where}.base")
            x = lines[index](1.0)
        else:
            tool, before, where = Tool.of(scene, columns, source), x, f"{where}.tool"
            begin = tool.place(x)
            goal = pin.SE3(begin.rotation, np.array(of.xyz))
            if turned is not None:
                goal.rotation = pin.rpy.rpyToMatrix(turned)
            if point.tool is not None and point.tool.line:
                lines[index] = _line(tool, begin, goal, x, where)
                x = lines[index](1.0)
            else:
                x, e = tool.reach(goal, x)
                if missed := tool.missed(goal, before, e):
                    raise TrajectoryError(
                        f"{where}: {missed}; move the point, or give another before it"
                    )
        points.append(point.model_copy(update={"q": tuple((x[order] / unit).tolist())}))
    return waypoints.model_copy(update={"points": tuple(points)}), lines


def _stance(
    scene: Any,
    columns: Sequence[JointColumn],
    x: FloatArray,
    xyz: FloatArray,
    rpy: FloatArray | None,
    where: str,
) -> BSpline:
    """Return the way (nj,) on which a free base goes straight to a pose while its feet stay."""
    from scipy.interpolate import make_interp_spline

    free = [k for k, column in enumerate(columns) if column.free]
    feet = scene.feet if isinstance(scene, Scene) else {}
    if not free or not feet:
        raise TrajectoryError(
            f"{where}: only of a robot whose base floats and that has `feet`: write both into the "
            "scene (`pinfric new --floating`)"
        )
    legs = []
    for name, foot in feet.items():
        frame = scene.model.getFrameId(name)
        joints = scene.model.supports[scene.model.frames[frame].parentJoint]
        moving = [scene.model.names[j] for j in joints]
        tool = Tool(scene.model, columns, frame, moving, foot.xyz)
        legs.append((name, tool, tool.place(x), 6 if foot.length or foot.width else 3))
    goal = x.copy()
    goal[free] = np.concatenate([xyz, x[free][3:] if rpy is None else rpy])
    way, postures = np.linspace(0.0, 1.0, _KNOTS), [x]
    for s in way[1:]:
        there = postures[-1].copy()
        there[free] = x[free] + s * (goal[free] - x[free])
        for name, tool, place, rows in legs:
            there, e = tool.reach(place, there, rows)
            if np.abs(e).max() > _REACHED:
                raise TrajectoryError(
                    f"{where}: at {100 * s:.0f} % of the way {name} leaves its place by "
                    f"{np.linalg.norm(e[:3]):.3g} m, since its leg is too short or its joints at "
                    "their limits: move the base less far"
                )
        if (step := np.abs(there - postures[-1])).max() > _JUMP:
            joint = columns[int(step.argmax())].name
            raise TrajectoryError(
                f"{where}: at {100 * s:.0f} % of the way {joint} jumps by {step.max():.2g}: the "
                "leg is stretched there; move the base less far"
            )
        postures.append(there)
    return make_interp_spline(way, np.array(postures), k=5)


def _line(tool: Tool, begin: pin.SE3, goal: pin.SE3, x: FloatArray, where: str) -> BSpline:
    from scipy.interpolate import make_interp_spline

    way = np.linspace(0.0, 1.0, _KNOTS)
    turn = pin.log3(begin.rotation.T @ goal.rotation)
    postures = [x]
    for s in way[1:]:
        middle = begin.translation + s * (goal.translation - begin.translation)
        here = pin.SE3(begin.rotation @ pin.exp3(s * turn), middle)
        x, e = tool.reach(here, postures[-1])
        if missed := tool.missed(here, postures[-1], e):
            raise TrajectoryError(
                f"{where}: at {100 * s:.0f} % of the straight line {missed}; leave `line` out, or "
                "give a point between"
            )
        step = np.abs(x - postures[-1])
        if step.max() > _JUMP:
            joint = tool.columns[int(step.argmax())].name
            raise TrajectoryError(
                f"{where}: at {100 * s:.0f} % of the straight line {joint} jumps by "
                f"{step.max():.2g}: the arm is stretched there or its axes align; leave `line` "
                "out, or give a point between"
            )
        postures.append(x)
    return make_interp_spline(way, np.array(postures), k=5)
