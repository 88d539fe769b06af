"""Whether a robot weighs what robots of its size weigh, with the unit that would explain it.

Moving mass over L^3, with L its reach along the joints, is 3.2 kg/m^3 and more in the 258 of 484
public URDFs whose masses are right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pinfric.model.mistaken_units import LENGTHS, MASSES, in_unit, likely_unit

#: A robot reaches no farther, m.
_FARTHEST = 50.0
#: Moving mass over the cube of the way, kg/m^3: Kinova's Jaco, the lightest arm made, has 3.2 in
#: its URDF. Of robots with fewer joints, or a shorter way (m), that is not known.
_LIGHT, _JOINTS, _WAY = 2.0, 3, 0.1
#: All mass over the same: at most 293 in robots with a way of 0.3 m or more. Below, only what is
#: `_FAR` times that is doubted.
_HEAVY, _HEAVY_WAY = 500.0, 0.3
#: Mass over the convex hulls of the shapes, kg/m^3: arms have 380 to 2600.
THIN, DENSE = 150.0, 6000.0
#: So many times beyond these it is impossible.
_FAR = 10.0
#: Of a unit that explains it.
_USUAL_WAY, _USUAL_HULL = (3.0, 300.0), (300.0, 3000.0)


@dataclass(frozen=True)
class MassDoubt:
    """Why the mass of a robot as a whole, or its lengths, are doubted.

    Attributes:
        found, why, if_unit: what it is, why it is implausible, and in which unit it would not be.
        excess: factor beyond the threshold.
        light: it is too light for its way.
        impossible: no robot can be so; what is computed with such masses is wrong.
    """

    found: str
    why: str
    if_unit: str
    excess: float
    light: bool
    impossible: bool

    @property
    def text(self) -> str:
        """The doubt in a line."""
        return f"{self.found}: {self.why}" + (f"; {self.if_unit}" if self.if_unit else "")


def doubted_mass(model: pin.Model) -> MassDoubt | None:
    """Return why the mass of a robot without a URDF is doubted as a whole; None: it is not."""
    masses = [body.mass for body in model.inertias]
    moving = float(sum(masses[1:]))
    return doubted_total(moving, moving + masses[0], reach_of(model), model.njoints - 1)


def doubted_reach(reach: float) -> MassDoubt | None:
    """Return why lengths, and so all masses, are doubted; None: they are not.

    `reach`: m, see `reach_of`.
    """
    if reach <= _FARTHEST:
        return None
    unit = likely_unit(LENGTHS, lambda size: 0.05 < size * reach < 20.0)
    why = "no robot is so large; all lengths look wrong"
    what, mistaken = f"its joints reach {reach:.0f} m", in_unit(unit, "m", reach)
    return MassDoubt(what, why, mistaken, reach / _FARTHEST, light=False, impossible=True)


def is_usual(moving: float, total: float, reach: float, joints: int) -> bool:
    """Return whether a mass is that of a usual robot of such a reach; arguments as below.

    Shapes beside which it is impossible are then in another unit themselves: they only doubt it.
    """
    least, most = (each * reach**3 for each in _USUAL_WAY)
    return joints >= _JOINTS and reach >= _WAY and least <= moving <= total <= most


def doubted_total(
    moving: float, total: float, reach: float, joints: int, density: float | None = None
) -> MassDoubt | None:
    """Return why a mass is doubted, beside the way along the joints and the volume of the shapes.

    Args:
        moving, total: kg; the second with what stands on the ground.
        reach: m, see `reach_of`.
        joints: how many move.
        density: over the convex hulls of the shapes, kg/m^3; None: not known.
    """
    cube, said, excess, light = max(reach, 1e-3) ** 3, list[str](), 1.0, False
    if 0 < moving < _LIGHT * cube and joints >= _JOINTS and reach >= _WAY:
        what, light = f"{moving:.3g} kg move on {reach:.3g} m of joints", True
        each = shown_density(moving / cube)
        said.append(f"{each} kg/m^3 of that length cubed; the lightest arms have 3.2")
        excess = _LIGHT / (moving / cube)
    elif reach >= _WAY and total > _HEAVY * cube * (1.0 if reach >= _HEAVY_WAY else _FAR):
        what = f"{total:.4g} kg on {reach:.3g} m of joints"
        each = shown_density(total / cube)
        said.append(f"{each} kg/m^3 of that length cubed; robots have up to 300")
        excess = total / cube / _HEAVY
    else:
        what = f"moving mass {moving:.4g} kg"
    if density is not None and not THIN <= density <= DENSE:
        said.append(f"its shapes have {shown_density(density)} kg/m^3 (arms: 380 to 2600)")
        excess = max(excess, THIN / density, density / DENSE)
        if is_usual(moving, total, reach, joints):
            excess = min(excess, _FAR)
    if not said:
        return None

    def explains(size: float) -> bool:
        by_way = reach < _HEAVY_WAY or _USUAL_WAY[0] <= size * moving / cube <= _USUAL_WAY[1]
        by_hull = density is None or _USUAL_HULL[0] <= size * density <= _USUAL_HULL[1]
        return by_way and by_hull

    unit = likely_unit(MASSES, explains)
    mistaken = in_unit(unit, "kg", moving)
    return MassDoubt(what, "; ".join(said), mistaken, excess, light, impossible=excess > _FAR)


def reach_of(model: pin.Model) -> float:
    """Return a robot's reach: the longest way along its joints' origins after the first to move, m.

    Pedestals do not count, links fixed behind the last joint do.
    """
    straight = np.zeros(model.njoints)  # of a model made in Python, which may have no frames
    for j in range(1, model.njoints):
        if parent := int(model.parents[j]):
            step = np.linalg.norm(model.jointPlacements[j].translation)
            straight[j] = straight[parent] + step
    far = np.full(model.nframes, -np.inf)
    for k, frame in enumerate(model.frames):
        moves = frame.type == pin.FrameType.JOINT
        if moves or frame.type in (pin.FrameType.FIXED_JOINT, pin.FrameType.BODY):
            above = model.frames[frame.parentFrame].placement.translation
            place = model.jointPlacements[frame.parentJoint] if moves else frame.placement
            far[k] = far[frame.parentFrame] + np.linalg.norm(place.translation - above)
            if moves:
                far[k] = max(far[k], 0.0)
    return float(max(far.max(), straight.max()))


def shown_density(density: float) -> str:
    """Return kg/m^3 with two digits, or as a whole number."""
    return f"{density:.2g}" if density < 100 else f"{density:.0f}"
