import numpy as np
from builders import block, lump, plane_friction, row
from mechanisms import pin_friction

import pinfric as pf

G = 9.81


def slope(angle: float = 0.0, **model_changes) -> pf.Scene:
    model = block(angle)
    for name, value in model_changes.items():
        setattr(model, name, np.array(value))
    return pf.Scene(model=model, friction={"slide": plane_friction(0.3, 0.25)})


#: Each method's steps are short enough to meet what happens at 0.5 s.
SHORT = {"event": {"max_step": 0.01}, "timestepping": {}, "regularized": {"max_step": 0.01}}


def swing(method="event", **options) -> pf.Motion:
    return pf.simulate(
        slope(), [0.0], [0.0], lambda t, q, v: [9 * np.sin(4 * t)], 2.0, method, **options
    )


class Belt:
    """A block on a moving belt, held by a spring; coordinates relative to the belt.

    From rest on the belt the spring force grows until break-away at mu_s N; the block slips back
    and comes to rest again, always in the same way (closed form; m = 2 kg, load N = m g).
    """

    mass, stiffness, speed, static, kinetic = 2.0, 50.0, 0.4, 0.35, 0.25

    def __init__(self, **more):
        friction = {"slide": plane_friction(self.static, self.kinetic, **more)}
        self.scene = pf.Scene(model=block(0.0, self.mass), friction=friction)
        self.omega = np.sqrt(self.stiffness / self.mass)
        self.holds = self.static * self.mass * G  # force at break-away
        drop = (self.static - self.kinetic) * self.mass * G
        angle = np.arctan(drop * self.omega / (self.stiffness * self.speed))
        self.slip_time = 2 / self.omega * (np.pi - angle)
        self.stick_time = 2 * drop / (self.stiffness * self.speed)
        self.period = self.slip_time + self.stick_time
        # the block starts unstretched and at rest on the belt
        self.first_slip = self.holds / (self.stiffness * self.speed)

    def effort(self, t, q, v):
        """Spring from the ground: the block is at q on a belt that has gone `speed` t."""
        return -self.stiffness * (q + self.speed * t)

    def run(self, t_end, method="event", **options):
        return pf.simulate(self.scene, [0.0], [0.0], self.effort, t_end, method, **options)

    def position(self, t):
        """Relative to the belt, at any time: from the phase of its period."""
        t = t - self.first_slip
        if t <= 0:
            return 0.0
        cycles, t = divmod(t, self.period)
        stretch = self.holds / self.stiffness  # at the start of every slip
        middle = self.kinetic * self.mass * G / self.stiffness
        rest = 2 * middle - stretch
        start = -(self.period * self.speed) * cycles  # the cycle moves with the ground
        if t > self.slip_time:
            return start + rest - stretch - self.speed * self.slip_time
        x = (
            middle
            + (stretch - middle) * np.cos(self.omega * t)
            + self.speed / self.omega * np.sin(self.omega * t)
        )
        return start + x - stretch - self.speed * t


def arm() -> pf.Scene:
    """Two links under gravity, horizontal, held by the static friction of their pins."""
    names = ("pin_0", "pin_1")
    friction = dict.fromkeys(names, pin_friction(0.2, 0.05, static=0.25, preload=500.0))
    return pf.Scene(row(names, lump(1.0, [0.1, 0, 0]), 0.2), friction=friction)
